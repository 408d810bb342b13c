/* A pendulum by hand in eomgen's C library: cc -I CLIB pendulum.c CLIB/integrate.c -lm, CLIB as of docs/library.md. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "eom.h"

/* Accelerations a of the equations of motion m l^2 a = u - m g l sin(q); h holds m, l and g. */
static int forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *a)
{
    (void)v;
    a[0] = (u[0] / h[0] / h[1] - h[2] * sin(q[0])) / h[1];
    return 0;
}

int main(void)
{
    const double h[3] = { 1.5, 0.8, 9.81 }, u = 0.0, times[3] = { 0.0, 0.5, 1.0 }, atol[2] = { 1e-9, 1e-9 };
    double q = 1.2, v = 0.3, q_out[3], v_out[3];
    double state[EOM_STATE_ROOM(1, 0, 3, 1, 0, 0, 0)], input[EOM_INPUT_ROOM(1, 1, 0)];
    int index[EOM_INDEX_ROOM(1, 1, 0)];
    const eom_sizes sizes = { .positions = 1, .rates = 1, .inputs = 1, .hoisted = 3, .factors = 1 };
    const eom_robot pendulum = { .sizes = &sizes, .forward_dynamics = forward_dynamics };
    const eom_drive drive = { .u = &u };
    const eom_tolerance tolerance = { .rtol = 1e-9, .atol = atol, .most = 1000000 };
    eom_progress progress;
    memset(&progress, 0, sizeof progress);
    const eom_workspace work = { input, index, state };
    const int reason = eom_integrate_adaptive(&pendulum, h, &drive, NULL, &tolerance, times, 2, 1, &q, &v, q_out, v_out, &progress, NULL, work);
    printf("%d, %lld steps\n", reason, progress.steps);
    for (int k = 0; k < 3; ++k) { printf("t = %.1f s: q = %.9f rad, v = %.9f rad/s\n", times[k], q_out[k], v_out[k]); }
    return 0;
}
