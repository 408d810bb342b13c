#include "reference.h"

#include <math.h>

void reference(long sample, double *series)
{
    const long samples = lround((move + rest) / dt); /* of one way */
    const double sign = (sample / samples % 2 == 0) ? 1.0 : -1.0;
    const double *const begin = (sign > 0.0) ? from : to;
    const double t = dt * (double)(sample % samples);
    const double x = (t < move) ? (t / move) : 1.0;
    const double p = x * (1.0 - x), slope = 1.0 - 2.0 * x, rate = 1.0 / move;
    const double profile[SERIES] = {
        x * x * x * x * x * (126.0 + x * (-420.0 + x * (540.0 + x * (70.0 * x - 315.0)))),
        630.0 * p * p * p * p * rate,
        2520.0 * p * p * p * slope * rate * rate,
        2520.0 * p * p * (3.0 * slope * slope - 2.0 * p) * rate * rate * rate,
        15120.0 * p * slope * (slope * slope - 3.0 * p) * rate * rate * rate * rate,
    };
    for (int i = 0; i < JOINTS; ++i) {
        const double way = sign * (to[i] - from[i]);
        for (int order = 0; order < SERIES; ++order) { series[JOINTS * order + i] = profile[order] * way; }
        series[i] += begin[i];
    }
}
