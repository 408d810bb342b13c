/* A mass on a spring, which has no accelerations beyond one metre: bounded METHOD STIFFNESS q v FIRST_STEP. */
#include "eom.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *a)
{
    (void)v;
    a[0] = u[0] - h[0] * q[0];
    return (fabs(q[0]) < 1.0) ? 0 : 1;
}

static int stage_factors(const double *h, const double *q, const double *v, const double *kp, const double *kd, const double *times, double *factors)
{
    (void)v;
    (void)kp;
    (void)kd;
    factors[0] = times[0];
    factors[1] = h[0];
    factors[2] = 1.0 + times[1] * h[0];
    return (fabs(q[0]) < 1.0) ? 0 : 1;
}

static int stage_solution(const double *h, const double *factors, const double *right, const double *shifts, double *w)
{
    (void)h;
    w[0] = (right[0] - factors[0] * factors[1] * shifts[0]) / factors[2] - right[0];
    return 0;
}

static int pair_factors(const double *h, const double *q, const double *v, const double *kp, const double *kd, const double *times, const double *spans, double *factors)
{
    (void)v;
    (void)kp;
    (void)kd;
    (void)spans;
    factors[0] = times[0];
    factors[1] = times[2];
    factors[2] = h[0];
    factors[3] = 1.0 + times[1] * h[0];
    factors[4] = times[3] * h[0];
    return (fabs(q[0]) < 1.0) ? 0 : 1;
}

static int pair_solution(const double *h, const double *factors, const double *right, const double *shifts, double *w)
{
    const double size = factors[3] * factors[3] + factors[4] * factors[4];
    const double real = right[0] - factors[2] * (factors[0] * shifts[0] - factors[1] * shifts[1]);
    const double imaginary = right[1] - factors[2] * (factors[0] * shifts[1] + factors[1] * shifts[0]);
    (void)h;
    w[0] = (real * factors[3] + imaginary * factors[4]) / size - right[0];
    w[1] = (imaginary * factors[3] - real * factors[4]) / size - right[1];
    return 0;
}

int main(int count, char **words)
{
    static const eom_sizes sizes = { .positions = 1, .rates = 1, .inputs = 1, .hoisted = 1, .factors = 3, .pair_factors = 5, .wrench = 6 };
    static const double none = 0.0, atol[2] = { 1e-10, 1e-10 }, times[2] = { 0.0, 2.0 };
    double state[EOM_STATE_ROOM(1, 0, 1, 3, 6, 0, 0) + EOM_RADAU_ROOM(1, 0, 3, 5)], input[EOM_INPUT_ROOM(1, 1, 0)], q_out[2], v_out[2];
    int index[EOM_INDEX_ROOM(1, 1, 0)];
    const eom_robot robot = { &sizes, forward_dynamics, NULL, stage_factors, stage_solution, NULL, pair_factors, pair_solution };
    const eom_workspace work = { input, index, state };
    const eom_drive drive = { .u = &none };
    const eom_tolerance allowed = { 1e-10, atol, 1000000 };
    eom_progress progress;
    if (count < 6) return 1;
    const double h = atof(words[2]);
    double q = atof(words[3]), v = atof(words[4]);
    memset(&progress, 0, sizeof progress);
    progress.next = atof(words[5]);
    eom_integrate_adaptive(&robot, &h, &drive, NULL, &allowed, times, 1, words[1][0] - '0', &q, &v, q_out, v_out, &progress, NULL, work);
    printf("%d %lld %lld %.17g %.17g %.17g\n", progress.reason, progress.steps, progress.rejected, progress.t, q, v);
    return 0;
}
