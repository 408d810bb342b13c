/* parameter_checks.h: run-time parameters that go together; for hosts that change them, as FMUs and WebAssembly. */
#include <math.h>
#include <stddef.h>

enum { EOM_MATRIX_ROWS = 6, EOM_SPEEDS = 4000 }; /* most rows of a matrix; velocities at which damping of bristles is looked at */

/* Whether a symmetric matrix m of n rows, without negative numbers on its diagonal, has no direction of negative energy: as units
 * are mixed, it is scaled by its diagonal, and then may be negative by round_off per row.  m is overwritten by its factors. */
static inline int eom_is_semidefinite(size_t n, double *m, double round_off)
{
    double size[EOM_MATRIX_ROWS];
    double allowed = 0.0;
    for (size_t i = 0; i < n; ++i) {
        size[i] = sqrt(m[n * i + i]);
        allowed += (size[i] > 0.0) ? round_off : 0.0;
    }
    for (size_t i = 0; i < n; ++i) {
        for (size_t j = 0; j < n; ++j) {
            const double scale = size[i] * size[j];
            if (!(scale > 0.0) && (m[n * i + j] != 0.0)) { return 0; }
            m[n * i + j] = (scale > 0.0) ? (m[n * i + j] / scale) : ((i == j) ? 1.0 : 0.0);
            m[n * i + j] += (i == j) ? allowed : 0.0;
        }
    }
    for (size_t p = 0; p < n; ++p) {
        if (!(m[n * p + p] > 0.0)) { return 0; }
        for (size_t i = p + 1; i < n; ++i) {
            const double share = m[n * i + p] / m[n * p + p];
            for (size_t j = p; j < n; ++j) { m[n * i + j] -= share * m[n * p + j]; }
        }
    }
    return 1;
}

/* Whether damping exp(-(v / fade)^2) v of bristles is at most 4 times what they slide at, coulomb + more exp(-(v / bell)^2), at any
 * velocity v, so that they give no energy back; bell is 0 where the friction is the same at all velocities. */
static inline int eom_bristles_fade(double coulomb, double damping, double fade, double more, double bell)
{
    const double own = 4.0 * coulomb / fmax(damping, 1e-12);
    const double curve = (bell > 0.0) ? bell : 1.0;
    const double least = 1e-3 * fmin(fmin(fade, own), (bell > 0.0) ? bell : own);
    const double most = 10.0 * fmax(fmax(fade, own), (bell > 0.0) ? bell : own);
    for (int k = 0; k < EOM_SPEEDS; ++k) {
        const double v = least * pow(most / least, (double)k / (EOM_SPEEDS - 1));
        const double far = v / fade;
        const double near = v / curve;
        const double slides = coulomb + more * exp(-fmin(near * near, 700.0));
        if (!(damping * exp(-fmin(far * far, 700.0)) * v <= 4.0 * slides)) { return 0; }
    }
    return 1;
}
