/* The pendulum behind the library's table of functions. */
#include "eom.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

typedef double real;
#include "pendulum.h"

/* The same with a complex time: M and K are real, so that 1 / (M + time D + time^2 K) alone is a pair. */
static int pair_factors(const double *h, const double *q, const double *v, const double *kp, const double *kd, const double *times, const double *spans, double *factors)
{
    const double inertia = h[MASS] * h[LENGTH] * h[LENGTH];
    double real, imaginary;
    (void)v;
    (void)spans;
    factors[0] = h[DAMPING] + kd[0];
    factors[1] = h[MASS] * h[GRAVITY] * h[LENGTH] * cos(q[0]) + kp[0];
    factors[2] = inertia;
    factors[3] = times[0];
    factors[4] = times[2];
    real = inertia + times[0] * factors[0] + times[1] * factors[1];
    imaginary = times[2] * factors[0] + times[3] * factors[1];
    factors[5] = real / (real * real + imaginary * imaginary);
    factors[6] = -imaginary / (real * real + imaginary * imaginary);
    return 0;
}

static int pair_solution(const double *h, const double *factors, const double *right, const double *shifts, double *w)
{
    const double real = factors[2] * right[0] - factors[1] * (factors[3] * shifts[0] - factors[4] * shifts[1]);
    const double imaginary = factors[2] * right[1] - factors[1] * (factors[3] * shifts[1] + factors[4] * shifts[0]);
    (void)h;
    w[0] = factors[5] * real - factors[6] * imaginary - right[0];
    w[1] = factors[5] * imaginary + factors[6] * real - right[1];
    return 0;
}

int main(int count, char **words)
{
    static const double h[NUMBERS] = { 1.5, 0.8, 9.81, 0.05 };
    static const eom_sizes sizes = { .positions = 1, .rates = 1, .inputs = 1, .hoisted = NUMBERS, .factors = 5, .pair_factors = 7, .wrench = 6 };
    double state[EOM_STATE_ROOM(1, 0, NUMBERS, 5, 6, 0, 0) + EOM_RADAU_ROOM(1, 0, 5, 7) + 1], input[EOM_INPUT_ROOM(1, 1, 0) + 1];
    int index[EOM_INDEX_ROOM(1, 1, 0) + 1];
    const double none = 0.0, q = 1.2, v = 0.3;
    double q_out[11], v_out[11], atol[2] = { 1e-9, 1e-9 }, times[11];
    state[sizeof state / sizeof *state - 1] = input[sizeof input / sizeof *input - 1] = 4.0;
    index[sizeof index / sizeof *index - 1] = 4;
    const eom_robot robot = { &sizes, forward_dynamics, implicit_step, stage_factors, stage_solution, NULL, pair_factors, pair_solution };
    const eom_workspace work = { input, index, state };
    const eom_drive drive = { .u = &none };
    const int method = (count > 1) ? words[1][0] - '0' : 0;
    for (int k = 0; k < 11; ++k) times[k] = 0.1 * k;
    if (method < 2) {
        if (eom_integrate_fixed(&robot, h, &q, &v, &drive, NULL, 0.0, 1e-4, 10000, 1000, method, q_out, v_out, work) != -1) return 1;
    } else {
        const eom_tolerance allowed = { 1e-9, atol, (count > 2) ? words[2][0] - '0' : 1000000 };
        double kept[EOM_KEPT_ROOM(1) + 1];
        eom_progress progress;
        double q_here = q, v_here = v;
        for (size_t k = 0; k < sizeof kept / sizeof *kept; ++k) kept[k] = 4.0;
        memset(&progress, 0, sizeof progress);
        progress.kept = (count > 2) ? kept : NULL;
        while (eom_integrate_adaptive(&robot, h, &drive, NULL, &allowed, times, 10, method - 2, &q_here, &v_here, q_out, v_out, &progress, NULL, work) == 0) {
            if (count <= 2) return 2;
        }
        if (progress.reason != 1) return 2;
        if (kept[EOM_KEPT_ROOM(1)] != 4.0) return 3;
    }
    if (state[sizeof state / sizeof *state - 1] != 4.0 || input[sizeof input / sizeof *input - 1] != 4.0 || index[sizeof index / sizeof *index - 1] != 4) return 3;
    for (int k = 0; k < 11; ++k) printf("%.17g %.17g\n", q_out[k], v_out[k]);
    return 0;
}
