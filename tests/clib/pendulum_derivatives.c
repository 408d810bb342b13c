/* Derivatives of a pendulum's motion, written by hand: m l^2 a = u - m g l sin(q) - d v, under a force on its end.
 *
 * Of each method, without and with inputs, a line: the derivative along one direction, of state, drives, parameters and torque, of
 * a weighted sum of states: by the adjoint, by the tangent without torque, the adjoint without torque, and by differences; then
 * whether kept numbers change a bit.  EOM_SINGLE: in single precision.  INCLUDED: with the library included in this file. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(INCLUDED)
#define EOM_POSITIONS 1
#define EOM_RATES 1
#define EOM_INPUTS 1
#define EOM_M 0
#define EOM_ROTATIONS 0
#define EOM_DERIVATIVES pendulum_derivatives
#endif
#include "eom.h"

#if defined(EOM_SINGLE)
typedef float real;
#define E(name) eomf_##name
#else
typedef double real;
#define E(name) eom_##name
#endif

#include "pendulum.h"

enum { FACTORS = 5, WRENCH = 6, STEPS = 40, PIECES = 2, DEGREE = 2 };

static int forward_dynamics_adjoint(const real *h, const real *q, const real *v, const real *u, const real *weights, real *out)
{
    const real m = h[MASS], l = h[LENGTH], inertia = m * l * l, w = weights[0];
    const real rest = u[0] - h[DAMPING] * v[0];
    out[0] = -w * h[GRAVITY] * cosine(q[0]) / l;
    out[1] = -w * h[DAMPING] / inertia;
    out[2] = w / inertia;
    out[3 + MASS] = -w * rest / (m * inertia);
    out[3 + LENGTH] = w * (h[GRAVITY] * sine(q[0]) / (l * l) - (real)2.0 * rest / (inertia * l));
    out[3 + GRAVITY] = -w * sine(q[0]) / l;
    out[3 + DAMPING] = -w * v[0] / inertia;
    return 0;
}

static int forward_dynamics_tangent(const real *h, const real *q, const real *v, const real *u, const real *dq, const real *dv, const real *du, const real *dp, real *out)
{
    const real one = (real)1.0;
    real by[3 + NUMBERS];
    (void)forward_dynamics_adjoint(h, q, v, u, &one, by);
    out[0] = by[0] * dq[0] + by[1] * dv[0] + by[2] * du[0];
    for (int i = 0; i < NUMBERS; ++i) { out[0] += by[3 + i] * dp[i]; }
    return 0;
}

static int implicit_step_adjoint(const real *h, const real *q, const real *v, const real *u, const real *added, const real *times, const real *weights, real *out)
{
    const real m = h[MASS], l = h[LENGTH], g = h[GRAVITY], s = sine(q[0]);
    const real w = weights[0] / (m * l * l + times[0] * h[DAMPING] + added[0]);
    real a;
    (void)implicit_step(h, q, v, u, added, times, &a);
    out[0] = -w * m * g * l * cosine(q[0]);
    out[1] = -w * h[DAMPING];
    out[2] = w;
    out[3] = -w * a;
    out[4 + MASS] = -w * (g * l * s + a * l * l);
    out[4 + LENGTH] = -w * m * (g * s + (real)2.0 * a * l);
    out[4 + GRAVITY] = -w * m * l * s;
    out[4 + DAMPING] = -w * (v[0] + a * times[0]);
    return 0;
}

static int implicit_step_tangent(const real *h, const real *q, const real *v, const real *u, const real *added, const real *times, const real *dq, const real *dv, const real *du, const real *dp, real *out)
{
    const real one = (real)1.0;
    real by[4 + NUMBERS];
    (void)implicit_step_adjoint(h, q, v, u, added, times, &one, by);
    out[0] = by[0] * dq[0] + by[1] * dv[0] + by[2] * du[0];
    for (int i = 0; i < NUMBERS; ++i) { out[0] += by[4 + i] * dp[i]; }
    return 0;
}

static int stage_factors_adjoint(const real *h, const real *q, const real *v, const real *kp, const real *kd, const real *times, const real *weights, real *out)
{
    const real m = h[MASS], l = h[LENGTH], g = h[GRAVITY], c = cosine(q[0]);
    const real by_d = weights[0] + times[0] * weights[4], by_k = weights[1] + times[1] * weights[4], by_m = weights[2] + weights[4];
    (void)v;
    (void)kp;
    (void)kd;
    out[0] = -by_k * m * g * l * sine(q[0]);
    out[1] = (real)0.0;
    out[2] = by_k;
    out[3] = by_d;
    out[4 + MASS] = by_k * g * l * c + by_m * l * l;
    out[4 + LENGTH] = by_k * m * g * c + (real)2.0 * by_m * m * l;
    out[4 + GRAVITY] = by_k * m * l * c;
    out[4 + DAMPING] = by_d;
    return 0;
}

static int stage_factors_tangent(const real *h, const real *q, const real *v, const real *kp, const real *kd, const real *times, const real *dq, const real *dv, const real *dp, real *out)
{
    (void)dv;
    for (int k = 0; k < FACTORS; ++k) {
        real weights[FACTORS] = { (real)0.0 }, by[4 + NUMBERS];
        weights[k] = (real)1.0;
        (void)stage_factors_adjoint(h, q, v, kp, kd, times, weights, by);
        out[k] = by[0] * dq[0];
        for (int i = 0; i < NUMBERS; ++i) { out[k] += by[4 + i] * dp[i]; }
    }
    return 0;
}

static int stage_solution_adjoint(const real *h, const real *factors, const real *right, const real *shifts, const real *weights, real *out)
{
    const real w = weights[0] / factors[4];
    (void)h;
    out[0] = (real)0.0;
    out[1] = -w * factors[3] * shifts[0];
    out[2] = w * right[0];
    out[3] = -w * factors[1] * shifts[0];
    out[4] = -w * (factors[2] * right[0] - factors[3] * factors[1] * shifts[0]) / factors[4];
    out[5] = w * factors[2] - weights[0];
    out[6] = -w * factors[3] * factors[1];
    for (int i = 0; i < NUMBERS; ++i) { out[7 + i] = (real)0.0; }
    return 0;
}

static int stage_solution_tangent(const real *h, const real *factors, const real *right, const real *shifts, const real *dfactors, const real *dright, const real *dshifts, const real *dp, real *out)
{
    const real one = (real)1.0;
    real by[7 + NUMBERS];
    (void)dp;
    (void)stage_solution_adjoint(h, factors, right, shifts, &one, by);
    out[0] = by[5] * dright[0] + by[6] * dshifts[0];
    for (int i = 0; i < FACTORS; ++i) {
        if (i != 3) { out[0] += by[i] * dfactors[i]; }
    }
    return 0;
}

/* Generalized force of a wrench on the end, q from the downward vertical, -y, and its derivatives. */
static int external_force(const real *h, const real *q, const real *wrench, real *out)
{
    out[0] = h[LENGTH] * (wrench[0] * cosine(q[0]) + wrench[1] * sine(q[0])) + wrench[5];
    return 0;
}

static int external_force_adjoint(const real *h, const real *q, const real *wrench, const real *weights, real *out)
{
    const real c = cosine(q[0]), s = sine(q[0]), w = weights[0];
    memset(out, 0, (1 + WRENCH + NUMBERS) * sizeof *out);
    out[0] = w * h[LENGTH] * (wrench[1] * c - wrench[0] * s);
    out[1] = w * h[LENGTH] * c;
    out[2] = w * h[LENGTH] * s;
    out[6] = w;
    out[7 + LENGTH] = w * (wrench[0] * c + wrench[1] * s);
    return 0;
}

static int external_force_tangent(const real *h, const real *q, const real *wrench, const real *dq, const real *dwrench, real *out)
{
    const real one = (real)1.0;
    real by[1 + WRENCH + NUMBERS];
    (void)external_force_adjoint(h, q, wrench, &one, by);
    out[0] = by[0] * dq[0];
    for (int i = 0; i < WRENCH; ++i) { out[0] += by[1 + i] * dwrench[i]; }
    return 0;
}

static int external_force_parameter_tangent(const real *h, const real *q, const real *wrench, const real *dp, real *out)
{
    const real one = (real)1.0;
    real by[1 + WRENCH + NUMBERS];
    (void)external_force_adjoint(h, q, wrench, &one, by);
    out[0] = by[7 + LENGTH] * dp[LENGTH];
    return 0;
}

static const E(sizes) sizes = { .positions = 1, .rates = 1, .inputs = 1, .hoisted = NUMBERS, .parameters = NUMBERS, .factors = FACTORS, .wrench = WRENCH };
static const E(robot) robot = { &sizes, forward_dynamics, implicit_step, stage_factors, stage_solution, NULL, NULL, NULL };
static const E(robot_derivatives) pendulum_derivatives = {
    .robot = &robot,
    .forward_dynamics_adjoint = forward_dynamics_adjoint,
    .implicit_step_adjoint = implicit_step_adjoint,
    .stage_factors_adjoint = stage_factors_adjoint,
    .stage_solution_adjoint = stage_solution_adjoint,
    .forward_dynamics_tangent = forward_dynamics_tangent,
    .implicit_step_tangent = implicit_step_tangent,
    .stage_factors_tangent = stage_factors_tangent,
    .stage_solution_tangent = stage_solution_tangent,
};

#if defined(INCLUDED)
#include "integrate.c"
#endif

/* What a motion is made of: all that derivatives are taken by, and the rest. */
typedef struct {
    real state[2];
    real u[STEPS];
    real gains[3]; /* kp, kd, target */
    real h[NUMBERS];
    double torque[PIECES * (DEGREE + 1)];
} motion;

static real dt[STEPS], weights[2][STEPS + 1];
static double times[STEPS + 1];
static long long row[STEPS];

/* Integrate a motion: its states, and their weighted sum; with by its derivatives, and with along the rate of the sum. */
static double integrate(int method, int loaded, const motion *x, int keeps, motion *by, const motion *along)
{
    static const int place = 0;
    static const double knots[PIECES + 1] = { 0.0, 0.17, 0.4 }, pull[6] = { 1.5, -0.7, 0.0, 0.0, 0.0, 0.3 }, twenty = 20.0, two = 2.0, one = 1.0;
    static const double effort = 60.0;
    real *const room = malloc(sizeof(real) * (EOM_SENSITIVITY_ROOM(1, 0, NUMBERS, FACTORS, WRENCH, NUMBERS, 0)));
    double *const input = malloc(sizeof(double) * EOM_SENSITIVITY_INPUT_ROOM(1));
    real *const kept = malloc(sizeof(real) * STEPS * (size_t)EOM_KEPT_NUMBERS(1, 0, method) + 1U);
    const E(workspace) work = { input, NULL, room };
    const eom_spline signal = { knots, x->torque, NULL, PIECES, DEGREE, 1 };
    const double never[2] = { 0.0, 0.4 };
    const eom_spline constant = { never, pull, NULL, 1, 0, 6 };
    const eom_track torque = { &signal, &place }, program = { &signal, &place };
    const eom_tracking control = { program, &one, &twenty, &two };
    const eom_wrench wrench = { &constant, 0.05, 0.3, { 0.0, 0.0, 0.0 }, 0, -1, 0 };
    const E(inputs) inputs = {
        .last = 0.4, .torque = &torque, .control = &control, .wrench = &wrench, .wrenches = 1U, .effort = &effort,
        .external_force = external_force, .force_h = x->h,
        .force_back = external_force_adjoint, .force_back_h = x->h,
        .force_along = external_force_tangent, .force_along_h = x->h,
        .force_by = external_force_parameter_tangent, .force_by_h = x->h,
    };
    const E(drive) drive = { .u = x->u, .u_step = 1U, .kp = &x->gains[0], .kd = &x->gains[1], .target = &x->gains[2] };
    real q[STEPS + 1], v[STEPS + 1];
    double sum = 0.0;
    const E(inputs) *const acting = (loaded != 0) ? &inputs : NULL;
    const E(step_sequence) steps = { dt, times, row, STEPS, method };
    q[0] = x->state[0];
    v[0] = x->state[1];
    if (along != NULL) {
        real dq[STEPS + 1], dv[STEPS + 1];
        const E(rates) rates = { along->u, 0U, 1U, along->h };
        dq[0] = along->state[0];
        dv[0] = along->state[1];
        if (E(rollout_sensitivity)(&pendulum_derivatives, x->h, &drive, acting, &steps, 1U, &rates, q, v, dq, dv, work) != -1) { exit(3); }
        for (int k = 0; k <= STEPS; ++k) { sum += (double)weights[0][k] * (double)dq[k] + (double)weights[1][k] * (double)dv[k]; }
    } else {
        if (E(rollout_states)(&pendulum_derivatives, x->h, &drive, acting, &steps, q, v, (keeps != 0) ? kept : NULL, work) != -1) { exit(4); }
        for (int k = 0; k <= STEPS; ++k) { sum += (double)weights[0][k] * (double)q[k] + (double)weights[1][k] * (double)v[k]; }
    }
    if (by != NULL) {
        double unused[PIECES * (DEGREE + 1) + 8] = { 0.0 };
        double *by_wrench[1] = { &unused[2] };
        const eom_input_slopes loads = { by->torque, by->torque, &unused[0], &unused[1], NULL, NULL, by_wrench };
        const E(slopes) slopes = { by->u, &by->gains[2], &by->gains[0], &by->gains[1], by->h, &loads };
        real by_q[STEPS + 1], by_v[STEPS + 1];
        memset(by, 0, sizeof *by);
        memcpy(by_q, weights[0], sizeof by_q);
        memcpy(by_v, weights[1], sizeof by_v);
        E(rollout_gradient)(&pendulum_derivatives, x->h, &drive, acting, &steps, q, v, (keeps != 0) ? kept : NULL, by_q, by_v, &slopes, work);
        by->state[0] = by_q[0];
        by->state[1] = by_v[0];
    }
    free(room);
    free(input);
    free(kept);
    return sum;
}

/* x + size direction. */
static motion moved(const motion *x, double size, const motion *direction)
{
    motion y = *x;
    for (int i = 0; i < 2; ++i) { y.state[i] += (real)size * direction->state[i]; }
    for (int i = 0; i < STEPS; ++i) { y.u[i] += (real)size * direction->u[i]; }
    for (int i = 0; i < 3; ++i) { y.gains[i] += (real)size * direction->gains[i]; }
    for (int i = 0; i < NUMBERS; ++i) { y.h[i] += (real)size * direction->h[i]; }
    for (int i = 0; i < PIECES * (DEGREE + 1); ++i) { y.torque[i] += size * direction->torque[i]; }
    return y;
}

/* The product of derivatives and a direction: of what a tangent moves, and of all. */
static double product(const motion *by, const motion *direction, int all)
{
    double sum = 0.0;
    for (int i = 0; i < 2; ++i) { sum += (double)by->state[i] * (double)direction->state[i]; }
    for (int i = 0; i < STEPS; ++i) { sum += (double)by->u[i] * (double)direction->u[i]; }
    for (int i = 0; i < NUMBERS; ++i) { sum += (double)by->h[i] * (double)direction->h[i]; }
    for (int i = 0; (all != 0) && (i < 3); ++i) { sum += (double)by->gains[i] * (double)direction->gains[i]; }
    for (int i = 0; (all != 0) && (i < PIECES * (DEGREE + 1)); ++i) { sum += by->torque[i] * direction->torque[i]; }
    return sum;
}

int main(void)
{
    static const motion x = { { (real)1.2, (real)0.3 }, { (real)0.0 }, { (real)15.0, (real)1.0, (real)0.4 }, { (real)1.5, (real)0.8, (real)9.81, (real)0.05 }, { 0.5, 2.0, -3.0, 1.0, -1.0, 4.0 } };
    motion direction = { { (real)0.7, (real)-0.4 }, { (real)0.0 }, { (real)2.0, (real)0.3, (real)-0.5 }, { (real)0.2, (real)-0.1, (real)0.3, (real)0.02 }, { 0.3, -0.7, 1.1, 0.9, -0.2, 0.5 } };
    for (int k = 0; k <= STEPS; ++k) {
        weights[0][k] = (real)(0.3 + 0.01 * k);
        weights[1][k] = (real)(0.2 - 0.01 * k);
        times[k] = 0.01 * k;
        if (k < STEPS) {
            dt[k] = (real)0.01;
            row[k] = k;
            direction.u[k] = (real)(0.5 - 0.02 * k);
        }
    }
    for (int k = 0; k < 4; ++k) {
        static const int methods[] = { EOM_EXPLICIT, EOM_EXPLICIT + EOM_KINDS, EOM_IMPLICIT_EULER, EOM_ROSENBROCK };
        const int method = methods[k];
        for (int loaded = 0; loaded < 2; ++loaded) {
            motion by, again, there = moved(&x, 1e-5, &direction), back = moved(&x, -1e-5, &direction);
            (void)integrate(method, loaded, &x, 1, &by, NULL);
            (void)integrate(method, loaded, &x, 0, &again, NULL);
            const double along = integrate(method, loaded, &x, 0, NULL, &direction);
            const double slope = (integrate(method, loaded, &there, 0, NULL, NULL) - integrate(method, loaded, &back, 0, NULL, NULL)) / 2e-5;
            const int same = (memcmp(&by, &again, sizeof by) == 0) ? 1 : 0;
            printf("%d %d %.17g %.17g %.17g %.17g %d\n", method, loaded, product(&by, &direction, 1), along, product(&by, &direction, 0), slope, same);
        }
    }
    return 0;
}
