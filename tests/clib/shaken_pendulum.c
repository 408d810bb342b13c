/* A pendulum on a cart whose motion is prescribed, under inputs over time, by steps of fixed length:
 * m l^2 a = u - m g l sin(q) - d v - m l cos(q) x'', u of a signal that jumps, of tracking control, and of a force on the bob. */
#include "eom.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CART, ANGLE, N, ROOM = EOM_STATE_ROOM(N, 0, 4, 1, 6, 0, 0) };
enum { MASS, LENGTH, GRAVITY, DAMPING, NUMBERS };

static double inertia(const double *h) { return h[MASS] * h[LENGTH] * h[LENGTH]; }

static double moment(const double *h, const double *q, const double *v, const double *u)
{
    return u[ANGLE] - h[MASS] * h[GRAVITY] * h[LENGTH] * sin(q[ANGLE]) - h[DAMPING] * v[ANGLE] - h[MASS] * h[LENGTH] * cos(q[ANGLE]) * u[CART];
}

static int forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *a)
{
    a[CART] = u[CART];
    a[ANGLE] = moment(h, q, v, u) / inertia(h);
    return 0;
}

static int implicit_step(const double *h, const double *q, const double *v, const double *u, const double *added, const double *times, double *a)
{
    a[CART] = u[CART];
    a[ANGLE] = moment(h, q, v, u) / (inertia(h) + times[0] * h[DAMPING] + added[ANGLE]);
    return 0;
}

/* Forces on cart and angle of a force on the bob, which hangs down at q = 0. */
static int external_force(const double *h, const double *q, const double *wrench, double *out)
{
    out[CART] = wrench[0];
    out[ANGLE] = h[LENGTH] * (cos(q[ANGLE]) * wrench[0] + sin(q[ANGLE]) * wrench[1]);
    return 0;
}

int main(int count, char **words)
{
    static const double h[NUMBERS] = { 1.5, 0.8, 9.81, 0.05 }, wave[4] = { 0.05, 7.0, 0.0, 0.0 }, ratio = 2.0, kp = 3.0, kd = 0.2;
    static const double knots[3] = { 0.0, 0.25, 1.0 }, torques[4] = { 2.0, 1.0, -3.0, 0.5 }; /* jumps at 0.25 s */
    static const double times[2] = { 0.0, 1.0 }, reference[2] = { 0.1, 0.3 }, force[6] = { 1.0, 2.0 };
    static const int is_prescribed[N] = { 1, 0 }, cart = CART, angle = ANGLE;
    static const double jump = 0.25;
    const eom_sizes sizes = { .positions = N, .rates = N, .inputs = N, .hoisted = NUMBERS, .factors = 1, .wrench = 6, .is_prescribed = is_prescribed };
    const eom_robot robot = { .sizes = &sizes, .forward_dynamics = forward_dynamics, .implicit_step = implicit_step };
    const eom_spline torque = { .knot = knots, .coefficient = torques, .pieces = 2, .degree = 1, .columns = 1 };
    const eom_spline line = { .knot = times, .coefficient = reference, .pieces = 1, .degree = 1, .columns = 1 };
    const eom_spline pull = { .knot = times, .coefficient = force, .pieces = 1, .degree = 0, .columns = 6 };
    const eom_track track = { &torque, &angle };
    const eom_tracking control = { { &line, &angle }, &ratio, &kp, &kd };
    const eom_prescribed given = { .place = &cart, .wave = wave, .size = 1 };
    const eom_wrench wrench = { .signal = &pull, .t0 = -1.0, .t1 = 2.0, .frame = -1 };
    const eom_inputs inputs = { .first = -1.0, .last = 2.0, .torque = &track, .control = &control, .given = &given, .wrench = &wrench, .wrenches = 1, .stop = &jump, .stops = 1, .external_force = external_force };
    const double none[N] = { 0.0, 0.0 }, q[N] = { 0.0, 0.4 }, v[N] = { 0.35, -0.2 };
    const eom_drive drive = { .u = none };
    double state[ROOM + 1], input[EOM_INPUT_ROOM(N, 1, 0) + 1], q_out[2 * N], v_out[2 * N];
    int index[EOM_INDEX_ROOM(N, 1, 0) + 1];
    const eom_workspace work = { input, index, state };
    if (count < 3) { return 1; }
    const size_t steps = (size_t)atoi(words[2]);
    state[ROOM] = input[EOM_INPUT_ROOM(N, 1, 0)] = 4.0;
    index[EOM_INDEX_ROOM(N, 1, 0)] = 4;
    if (eom_integrate_fixed(&robot, h, q, v, &drive, &inputs, 0.0, 0.5 / (double)steps, steps, steps, atoi(words[1]), q_out, v_out, work) != -1) { return 2; }
    if ((state[ROOM] != 4.0) || (input[EOM_INPUT_ROOM(N, 1, 0)] != 4.0) || (index[EOM_INDEX_ROOM(N, 1, 0)] != 4)) { return 3; }
    printf("%.17g %.17g %.17g %.17g\n", q_out[N + CART], q_out[N + ANGLE], v_out[N + CART], v_out[N + ANGLE]);
    return 0;
}
