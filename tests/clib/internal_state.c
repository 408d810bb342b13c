/* Two masses and a force with a state z of its own, which stands behind both velocities: m a = u + f(q, v, z), z' = g(q, v, z, u).
 *
 * POSITIONS: 2, or 3 with a number behind the coordinates that acts on nothing.  INPUTS: 2, or 3 with a force beside a drive.
 * DRIVEN: z follows the input of a drive on the second mass.  PRESCRIBED: the first mass moves as a wave.  CLOSED: both move
 * together, x = y + sin(y) / 10, which steps keep to.  The equations are
 * written once, on complex numbers, which give tangents, and these adjoints.  Lanes call them state by state. */
#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "eom.h"
#include "robot_lanes.h"

typedef double complex number;

enum { MASS, SPRING = 2, COUPLING = 4, DAMPING, SHARE = 7, TIME, NUMBERS };
enum { NQ = POSITIONS, NV = 3, NU = INPUTS, NX = NQ + NV, SLOPES = 16, FACTORS = SLOPES + 2, PAIRS = SLOPES + 4, WRENCH = 6 };
enum { DYNAMICS, IMPLICIT, STAGE_FACTORS, STAGE_SOLUTION, PAIR_FACTORS, PAIR_SOLUTION, SETTLING, WHATS };
enum { SAMPLES = 8, STATES = 3, STEPS = 12, DIRECTIONS = 2, MOST = 64 };

/* Numbers of the arguments of each function, in their order, but for h, which is the last one, and times; and of its results. */
static const int sizes_of[WHATS][4] = { { NQ, NV, NU }, { NQ, NV, NU, NU }, { NQ, NV, NU, NU }, { FACTORS, NV, NQ }, { NQ, NV, NU, NU }, { PAIRS, 2 * NV, 2 * NQ }, { NQ, NV } };
static const int results[WHATS] = { NV, NV, FACTORS, NV, PAIRS, 2 * NV, NX + CLOSED };

/* Let x satisfy x[0] + slope x[1] + rest = 0 by forces of the constraint. */
static void close(const number *h, number slope, number rest, number *x)
{
    const number force = CLOSED ? (x[0] + slope * x[1] + rest) / (1.0 / h[MASS] + slope * slope / h[MASS + 1]) : 0.0;
    x[0] -= force / h[MASS];
    x[1] -= force * slope / h[MASS + 1];
}

static number slope_at(const number *q) { return -1.0 - 0.1 * ccos(q[1]); }

/* Rates, and their slopes by both coordinates, (3, 2), and by v, (3, 3), where inputs have gains kp and kd. */
static void rates(const number *h, const number *q, const number *v, const number *u, number *a)
{
    const number load = h[COUPLING] * (q[1] - q[0]), z = v[2];
    a[0] = (u[0] - h[SPRING] * q[0] + load - h[DAMPING] * v[0] - (DRIVEN ? 0.0 : h[SHARE] * z)) / h[MASS];
    a[1] = ((DRIVEN ? h[SHARE] * z + u[NU - 1] : u[1]) - h[SPRING + 1] * csin(q[1]) - load - h[DAMPING + 1] * v[1]) / h[MASS + 1];
    a[2] = DRIVEN ? (u[1] - z) / h[TIME] : v[0] - z * (1.0 + z * z) / h[TIME];
    if (PRESCRIBED) a[0] = u[0];
}

static void slopes(const number *h, const number *q, const number *v, const number *kp, const number *kd, number *by)
{
    number *const by_v = &by[6];
    for (int i = 0; i < SLOPES; ++i) by[i] = 0.0;
    by[0] = -(h[SPRING] + h[COUPLING] + kp[0]) / h[MASS];
    by[1] = h[COUPLING] / h[MASS];
    by[2] = h[COUPLING] / h[MASS + 1];
    by[3] = -(h[SPRING + 1] * ccos(q[1]) + h[COUPLING] + (DRIVEN ? 0.0 : kp[1])) / h[MASS + 1];
    by_v[0] = -(h[DAMPING] + kd[0]) / h[MASS];
    by_v[4] = -(h[DAMPING + 1] + (DRIVEN ? 0.0 : kd[1])) / h[MASS + 1];
    if (DRIVEN) {
        by[5] = -kp[1] / h[TIME];
        by_v[7] = -kd[1] / h[TIME];
        by_v[5] = h[SHARE] / h[MASS + 1];
        by_v[8] = -1.0 / h[TIME] - 1e-9 * kp[NU - 1]; /* as if it depended on the input */
    } else {
        by_v[2] = -h[SHARE] / h[MASS];
        by_v[6] = 1.0;
        by_v[8] = -(1.0 + 3.0 * v[2] * v[2]) / h[TIME];
    }
    for (int i = 0; PRESCRIBED && (i < 3); ++i) by_v[i] = by[i % 2] = 0.0;
    by[SLOPES - 1] = slope_at(q);
}

/* Solve (1 - time by_v - time^2 by_q + added) x = right + time by_q shifts, with forces of the constraint. */
static void solve(const number *h, const number *by, number time, number square, const number *added, const number *right, const number *shifts, number *x)
{
    const number slope = by[SLOPES - 1];
    number W[9], pushed[3] = { 1.0 / h[MASS], slope / h[MASS + 1], 0.0 };
    for (int i = 0; i < 3; ++i) {
        x[i] = right[i] + time * (by[2 * i] * shifts[0] + by[2 * i + 1] * shifts[1]);
        for (int j = 0; j < 3; ++j) W[3 * i + j] = ((i == j) ? 1.0 : 0.0) - time * by[6 + 3 * i + j] - ((j < 2) ? square * by[2 * i + j] : 0.0) + added[3 * i + j];
    }
    for (int p = 0; p < 3; ++p) {
        for (int i = 0; i < 3; ++i) {
            const number factor = W[3 * i + p] / W[4 * p];
            for (int j = p; (i != p) && (j < 3); ++j) W[3 * i + j] -= factor * W[3 * p + j];
            if (i != p) { x[i] -= factor * x[p]; pushed[i] -= factor * pushed[p]; }
        }
    }
    for (int i = 0; i < 3; ++i) { x[i] /= W[4 * i]; pushed[i] /= W[4 * i]; }
    const number force = CLOSED ? (x[0] + slope * x[1]) / (pushed[0] + slope * pushed[1]) : 0.0;
    for (int i = 0; i < 3; ++i) x[i] -= force * pushed[i];
}

/* Evaluate a function, all of its arguments one behind the other. */
static void evaluate(int what, const double *times, const number *x, number *out)
{
    const number none[9] = { 0.0 };
    const int *const size = sizes_of[what];
    const number *const second = &x[size[0]], *const third = &second[size[1]], *const fourth = &third[size[2]], *const h = &fourth[size[3]];
    if (what == DYNAMICS) {
        rates(h, x, second, third, out);
        close(h, slope_at(x), 0.1 * csin(x[1]) * second[1] * second[1], out);
    } else if (what == IMPLICIT) {
        number by[SLOPES], right[3], added[9] = { 0.0 };
        slopes(h, x, second, none, none, by);
        rates(h, x, second, third, right);
        added[0] = PRESCRIBED ? 0.0 : fourth[0] / h[MASS];
        added[DRIVEN ? 7 : 4] = DRIVEN ? fourth[1] / h[TIME] : fourth[1] / h[MASS + 1];
        solve(h, by, times[0], times[1], added, right, second, out);
    } else if ((what == STAGE_FACTORS) || (what == PAIR_FACTORS)) {
        slopes(h, x, second, third, fourth, out);
        for (int i = SLOPES; i < results[what]; ++i) out[i] = times[i - SLOPES];
    } else if (what == STAGE_SOLUTION) {
        solve(h, x, x[SLOPES], x[SLOPES + 1], none, second, third, out);
        for (int i = 0; i < 3; ++i) out[i] -= second[i];
    } else if (what == SETTLING) {
        number change[2] = { 0.0, 0.0 }, speed[2] = { second[0], second[1] };
        const number violated = x[0] - x[1] - 0.1 * csin(x[1]);
        close(h, slope_at(x), violated, change);
        close(h, slope_at(x), 0.0, speed);
        for (int i = 0; i < results[what]; ++i) out[i] = 0.0;
        for (int i = 0; i < 2; ++i) { out[i] = change[i]; out[NQ + i] = speed[i] - second[i]; }
        out[NX] = violated;
    } else {
        number right[3], shifts[2], w[3];
        for (int i = 0; i < 3; ++i) right[i] = second[i] + I * second[NV + i];
        for (int i = 0; i < 2; ++i) shifts[i] = third[i] + I * third[NQ + i];
        solve(h, x, x[SLOPES] + I * x[SLOPES + 2], x[SLOPES + 1] + I * x[SLOPES + 3], none, right, shifts, w);
        for (int i = 0; i < 3; ++i) { out[i] = creal(w[i] - right[i]); out[NV + i] = cimag(w[i] - right[i]); }
    }
}

/* Put arguments one behind the other, with shares of rates as imaginary parts; how many they are. */
static int pack(int what, const double *const *arrays, const double *h, double share, const double *const *along, const double *dp, number *x)
{
    int count = 0;
    for (int k = 0; k < 4; ++k) {
        for (int i = 0; i < sizes_of[what][k]; ++i, ++count) x[count] = arrays[k][i] + ((along == NULL) ? 0.0 : I * share * along[k][i]);
    }
    for (int i = 0; i < NUMBERS; ++i, ++count) x[count] = h[i] + ((dp == NULL) ? 0.0 : I * share * dp[i]);
    return count;
}

static int call(int what, const double *h, const double *times, const double *const *arrays, double *out)
{
    number x[MOST], found[MOST];
    (void)pack(what, arrays, h, 0.0, NULL, NULL, x);
    evaluate(what, times, x, found);
    for (int i = 0; i < results[what]; ++i) out[i] = creal(found[i]);
    return 0;
}

static int tangent(int what, const double *h, const double *times, const double *const *arrays, const double *const *along, const double *dp, double *out)
{
    number x[MOST], found[MOST];
    (void)pack(what, arrays, h, 1e-30, along, dp, x);
    evaluate(what, times, x, found);
    for (int i = 0; i < results[what]; ++i) out[i] = cimag(found[i]) / 1e-30;
    return 0;
}

static int adjoint(int what, const double *h, const double *times, const double *const *arrays, const double *weights, double *out)
{
    number x[MOST], found[MOST];
    const int count = pack(what, arrays, h, 0.0, NULL, NULL, x);
    for (int k = 0; k < count; ++k) {
        x[k] += 1e-30 * I;
        evaluate(what, times, x, found);
        x[k] = creal(x[k]);
        out[k] = 0.0;
        for (int i = 0; i < results[what]; ++i) out[k] += weights[i] * cimag(found[i]) / 1e-30;
    }
    return 0;
}

static int call_lanes(int what, const lanes *h, const lanes *times, const lanes *const *arrays, lanes *out)
{
    for (int l = 0; l < EOM_LANES; ++l) {
        double own[4][MOST], h_own[NUMBERS], t[4] = { 0.0 }, found[MOST];
        const double *const all[4] = { own[0], own[1], own[2], own[3] };
        for (int k = 0; k < 4; ++k) {
            for (int i = 0; i < sizes_of[what][k]; ++i) own[k][i] = EOM_LANE(arrays[k][i], l);
        }
        for (int i = 0; i < NUMBERS; ++i) h_own[i] = EOM_LANE(h[i], l);
        for (int i = 0; (times != NULL) && (i < ((what == PAIR_FACTORS) ? 4 : 2)); ++i) t[i] = EOM_LANE(times[i], l);
        (void)call(what, h_own, t, all, found);
        for (int i = 0; i < results[what]; ++i) EOM_LANE(out[i], l) = found[i];
    }
    return 0;
}

/* The library's functions, of numbers and of lanes. */
#define ARRAYS(...) const double *const arrays[4] = { __VA_ARGS__ }
#define ALONG(...) const double *const along[4] = { __VA_ARGS__ }
#define X const double *
#define FUNCTIONS(real, name) \
    static int forward_dynamics##name(const real *h, const real *q, const real *v, const real *u, real *a) { const real *const x[4] = { q, v, u }; return call##name(DYNAMICS, h, NULL, x, a); } \
    static int implicit_step##name(const real *h, const real *q, const real *v, const real *u, const real *added, const real *times, real *a) { const real *const x[4] = { q, v, u, added }; return call##name(IMPLICIT, h, times, x, a); } \
    static int stage_factors##name(const real *h, const real *q, const real *v, const real *kp, const real *kd, const real *times, real *f) { const real *const x[4] = { q, v, kp, kd }; return call##name(STAGE_FACTORS, h, times, x, f); } \
    static int stage_solution##name(const real *h, const real *f, const real *right, const real *shifts, real *w) { const real *const x[4] = { f, right, shifts }; return call##name(STAGE_SOLUTION, h, NULL, x, w); } \
    static int settling##name(const real *h, const real *q, const real *v, real *change) { const real *const x[4] = { q, v }; return call##name(SETTLING, h, NULL, x, change); } \
    static int pair_factors##name(const real *h, const real *q, const real *v, const real *kp, const real *kd, const real *times, const real *spans, real *f) { const real *const x[4] = { q, v, kp, kd }; (void)spans; return call##name(PAIR_FACTORS, h, times, x, f); } \
    static int pair_solution##name(const real *h, const real *f, const real *right, const real *shifts, real *w) { const real *const x[4] = { f, right, shifts }; return call##name(PAIR_SOLUTION, h, NULL, x, w); }
FUNCTIONS(double, )
FUNCTIONS(lanes, _lanes)

static int forward_dynamics_adjoint(X h, X q, X v, X u, X weights, double *out) { ARRAYS(q, v, u); return adjoint(DYNAMICS, h, NULL, arrays, weights, out); }
static int implicit_step_adjoint(X h, X q, X v, X u, X added, X times, X weights, double *out) { ARRAYS(q, v, u, added); return adjoint(IMPLICIT, h, times, arrays, weights, out); }
static int stage_factors_adjoint(X h, X q, X v, X kp, X kd, X times, X weights, double *out) { ARRAYS(q, v, kp, kd); return adjoint(STAGE_FACTORS, h, times, arrays, weights, out); }
static int stage_solution_adjoint(X h, X f, X right, X shifts, X weights, double *out) { ARRAYS(f, right, shifts); return adjoint(STAGE_SOLUTION, h, NULL, arrays, weights, out); }
static int forward_dynamics_tangent(X h, X q, X v, X u, X dq, X dv, X du, X dp, double *out) { ARRAYS(q, v, u); ALONG(dq, dv, du); return tangent(DYNAMICS, h, NULL, arrays, along, dp, out); }
static int implicit_step_tangent(X h, X q, X v, X u, X added, X times, X dq, X dv, X du, X dp, double *out) { const double none[NU] = { 0.0 }; ARRAYS(q, v, u, added); ALONG(dq, dv, du, none); return tangent(IMPLICIT, h, times, arrays, along, dp, out); }
static int stage_factors_tangent(X h, X q, X v, X kp, X kd, X times, X dq, X dv, X dp, double *out) { const double none[NU] = { 0.0 }; ARRAYS(q, v, kp, kd); ALONG(dq, dv, none, none); return tangent(STAGE_FACTORS, h, times, arrays, along, dp, out); }
static int stage_solution_tangent(X h, X f, X right, X shifts, X df, X dright, X dshifts, X dp, double *out) { ARRAYS(f, right, shifts); ALONG(df, dright, dshifts); return tangent(STAGE_SOLUTION, h, NULL, arrays, along, dp, out); }

static int settling_adjoint(X h, X q, X v, X weights, double *out) { ARRAYS(q, v); return adjoint(SETTLING, h, NULL, arrays, weights, out); }
static int settling_tangent(X h, X q, X v, X dq, X dv, X dp, double *out) { ARRAYS(q, v); ALONG(dq, dv); return tangent(SETTLING, h, NULL, arrays, along, dp, out); }

/* What an energy balance asks for: forces without inputs, those of drives, and those that a motion needs; the state stores z^2 / 2. */
static int generalized_force(X h, X q, X v, double *out)
{
    const double none[NU] = { 0.0 };
    (void)forward_dynamics(h, q, v, none, out);
    for (int i = 0; i < 2; ++i) out[i] *= h[MASS + i];
    return 0;
}

static int drive_forces(X h, X q, X v, X u, double *out)
{
    (void)q;
    out[0] = u[0];
    out[1] = h[SHARE] * v[2] + u[NU - 1];
    out[2] = u[1];
    return 0;
}

static int needed(X h, X q, X v, X a, double *out)
{
    (void)generalized_force(h, q, v, out);
    for (int i = 0; i < 3; ++i) out[i] = ((i < 2) ? h[MASS + i] : 1.0) * a[i] - out[i];
    return 0;
}

static int external_force(X h, X q, X wrench, double *out)
{
    (void)h;
    for (int i = 0; i < NQ; ++i) out[i] = 0.0;
    out[0] = wrench[0];
    out[1] = cos(q[1]) * wrench[1];
    return 0;
}

static int force_adjoint(X h, X q, X wrench, X weights, double *out)
{
    (void)h;
    memset(out, 0, (NQ + WRENCH + NUMBERS) * sizeof *out);
    out[1] = -weights[1] * sin(q[1]) * wrench[1];
    out[NQ] = weights[0];
    out[NQ + 1] = weights[1] * cos(q[1]);
    return 0;
}

static int force_tangent(X h, X q, X wrench, X dq, X dwrench, double *out)
{
    (void)external_force(h, q, dwrench, out);
    out[1] -= sin(q[1]) * wrench[1] * dq[1];
    return 0;
}

static int force_parameter_tangent(X h, X q, X wrench, X dp, double *out)
{
    (void)h; (void)q; (void)wrench; (void)dp;
    memset(out, 0, NQ * sizeof *out);
    return 0;
}

static const int beside[3] = { 0, 2, 2 }, is_prescribed[3] = { 1, 0, 0 }, places[2] = { 0, 1 };
static const eom_sizes sizes = {
    .positions = NQ, .rates = NV, .inputs = NU, .m = CLOSED, .has_redundant_rows = CLOSED, .closed_gap = 1e-13, .open_gap = 1e-9, .hoisted = NUMBERS, .parameters = NUMBERS, .factors = FACTORS, .pair_factors = PAIRS, .wrench = WRENCH,
    .beside = DRIVEN ? beside : NULL, .is_prescribed = PRESCRIBED ? is_prescribed : NULL,
};
static const eom_robot robot = { &sizes, forward_dynamics, implicit_step, stage_factors, stage_solution, settling, pair_factors, pair_solution };
static const eom_robot_lanes robot_lanes = { &sizes, forward_dynamics_lanes, implicit_step_lanes, stage_factors_lanes, stage_solution_lanes, settling_lanes, pair_factors_lanes, pair_solution_lanes };
static const eom_robot_derivatives derivatives = {
    &robot, 0, forward_dynamics_adjoint, implicit_step_adjoint, stage_factors_adjoint, stage_solution_adjoint, settling_adjoint,
    forward_dynamics_tangent, implicit_step_tangent, stage_factors_tangent, stage_solution_tangent, settling_tangent,
};

enum { ROOM = EOM_STATE_ROOM(3, CLOSED, NUMBERS, FACTORS, WRENCH, NUMBERS, 0) + EOM_RADAU_ROOM(3, CLOSED, FACTORS, PAIRS), INPUT = EOM_INPUT_ROOM(3, EOM_LANES, 0), INDEX = EOM_INDEX_ROOM(3, EOM_LANES, 0) };
enum { SLOPE_ROOM = EOM_SENSITIVITY_ROOM(3, CLOSED, NUMBERS, FACTORS, WRENCH, NUMBERS, 0), SLOPE_INPUT = EOM_SENSITIVITY_INPUT_ROOM(3) };

static const double h[NUMBERS] = { 1.5, 0.8, 20.0, 12.0, 6.0, 0.2, 0.1, 3.0, 0.05 };
static const double kp[3] = { 4.0, 6.0, 0.0 }, kd[3] = { 0.3, 0.5, 0.0 }, effort[3] = { 2.5, 3.0, HUGE_VAL }, target[3] = { 0.3, -0.2, 0.0 }, pull[3] = { 0.7, -0.4, 0.0 };
static double all_h[STATES][NUMBERS], starts_q[STATES][NQ], starts_v[STATES][NV], times[SAMPLES + 1];

/* Write q and v of rows: what acts on nothing is left out. */
static void print(size_t rows, X q, X v)
{
    for (size_t k = 0; k < rows; ++k) {
        printf("%.17g %.17g %.17g %.17g %.17g\n", q[k * NQ], q[k * NQ + 1], v[k * NV], v[k * NV + 1], v[k * NV + 2]);
    }
}

static void begin(void)
{
    for (int s = 0; s < STATES; ++s) {
        memcpy(all_h[s], h, sizeof h);
        for (int i = 0; i < 2; ++i) starts_q[s][i] = 0.4 - 0.3 * i + 0.1 * s;
        for (int i = 0; i < NV; ++i) starts_v[s][i] = -0.2 + 0.3 * i - 0.1 * s;
        if (CLOSED) {
            starts_q[s][0] = starts_q[s][1] + 0.1 * sin(starts_q[s][1]);
            starts_v[s][0] = (1.0 + 0.1 * cos(starts_q[s][1])) * starts_v[s][1];
        }
    }
    for (int k = 0; k <= SAMPLES; ++k) times[k] = 0.05 * k;
}

/* Whether a number behind a room is what it was. */
static void look(const double *state, int room, const double *input, int more) { if ((state[room] != 4.0) || (input[more] != 4.0)) exit(3); }

static void fixed(const eom_drive *drive, const eom_inputs *inputs, eom_workspace work, eom_workspace_lanes work_lanes)
{
    double q_out[STATES * (SAMPLES + 1) * NQ], v_out[STATES * (SAMPLES + 1) * NV];
    for (int method = 0; method < 2; ++method) {
        if (eom_integrate_fixed(&robot, h, starts_q[0], starts_v[0], drive, inputs, 0.0, 0.002, 4 * SAMPLES, 4, method, q_out, v_out, work) != -1) exit(4);
        print(SAMPLES + 1, q_out, v_out);
        if (eom_integrate_fixed_one_by_one(&robot, STATES, h, starts_q[0], NQ, starts_v[0], NV, drive, 0.002, 4 * SAMPLES, 4, method, q_out, v_out, work) != -1) exit(4);
        print(STATES * (SAMPLES + 1), q_out, v_out);
        if (EOM_WIDE(integrate_fixed_batch)(&robot_lanes, STATES, h, starts_q[0], NQ, starts_v[0], NV, drive, 0.002, 4 * SAMPLES, 4, method, q_out, v_out, work_lanes) != -1) exit(4);
        print(STATES * (SAMPLES + 1), q_out, v_out);
    }
}

static void adaptive(const eom_drive *drive, const eom_inputs *inputs, eom_workspace work, eom_workspace_lanes work_lanes)
{
    static const double atol[6] = { 1e-7, 1e-7, (NQ > 2) ? HUGE_VAL : 1e-7, 1e-7, 1e-7, 1e-7 };
    for (int method = 0; method < 3; ++method) {
        for (int way = 0; way < 3; ++way) { /* alone, one by one in two calls, and in lanes */
            double q[STATES * NQ], v[STATES * NV], q_out[STATES * (SAMPLES + 1) * NQ], v_out[STATES * (SAMPLES + 1) * NV], kept[STATES][EOM_KEPT_ROOM(3)];
            double t[400], q_steps[400 * NQ], v_steps[400 * NV], stiffness[400];
            const size_t count = (way == 0) ? 1U : STATES;
            eom_tolerance allowed = { 1e-6, atol, (way == 1) ? 3 : 400 };
            eom_record record = { t, q_steps, v_steps, stiffness, 400U, 0U };
            eom_progress progress[STATES];
            memcpy(q, starts_q, sizeof q);
            memcpy(v, starts_v, sizeof v);
            memset(progress, 0, sizeof progress);
            for (int s = 0; s < STATES; ++s) progress[s].kept = kept[s];
            if (way == 0) {
                (void)eom_integrate_adaptive(&robot, h, drive, inputs, &allowed, times, SAMPLES, method, q, v, q_out, v_out, progress, &record, work);
                print(record.count, q_steps, v_steps);
                for (size_t k = 0; (method == 1) && (k < record.count); ++k) printf("%.17g %.17g 0 0 0\n", t[k], stiffness[k]);
            } else {
                for (int calls = 0; calls < ((way == 1) ? 200 : 1); ++calls) {
                    if (way == 1) eom_integrate_adaptive_one_by_one(&robot, count, NULL, all_h[0], NUMBERS, drive, inputs, 0U, &allowed, 0U, times, SAMPLES, method, q, v, q_out, v_out, progress, work);
                    if (way == 2) EOM_WIDE(integrate_adaptive_batch)(&robot_lanes, count, NULL, all_h[0], NUMBERS, drive, inputs, 0U, &allowed, 0U, times, SAMPLES, method, q, v, q_out, v_out, progress, work_lanes);
                }
            }
            print(count, q, v);
            for (size_t s = 0; s < count; ++s) {
                if (progress[s].reason != 1) exit(5);
                printf("%lld %.17g %.17g %.17g %.17g\n", progress[s].steps, progress[s].work[0], progress[s].work[1], progress[s].work[2], progress[s].work[3]);
            }
            printf("dense\n");
            print(count * (SAMPLES + 1), q_out, v_out);
            printf("end\n");
        }
    }
}

static double product(int size, X one, X other)
{
    double sum = 0.0;
    for (int i = 0; i < size; ++i) sum += one[i] * other[i];
    return sum;
}

static void differentiated(const eom_drive *drive, const eom_inputs *inputs, eom_workspace work)
{
    static const int methods[] = { EOM_EXPLICIT, EOM_EXPLICIT + EOM_KINDS, EOM_IMPLICIT_EULER, EOM_ROSENBROCK };
    double dt[STEPS], at[STEPS + 1];
    long long row[STEPS];
    for (int k = 0; k <= STEPS; ++k) at[k] = 0.01 * k;
    for (int k = 0; k < STEPS; ++k) { dt[k] = 0.01; row[k] = 0; }
    for (int m = 0; m < 4; ++m) {
        double q[(STEPS + 1) * NQ], v[(STEPS + 1) * NV], by_q[(STEPS + 1) * NQ] = { 0.0 }, by_v[(STEPS + 1) * NV], weights_q[(STEPS + 1) * NQ], weights_v[(STEPS + 1) * NV], kept[STEPS * EOM_KEPT_NUMBERS(3, CLOSED, EOM_ROSENBROCK)];
        double by_u[3] = { 0.0 }, by_target[3] = { 0.0 }, by_kp[3] = { 0.0 }, by_kd[3] = { 0.0 }, by_h[NUMBERS] = { 0.0 };
        double by_torque[4] = { 0.0 }, by_program[4] = { 0.0 }, by_gains[4] = { 0.0 }, by_wrench[WRENCH] = { 0.0 }, dq[(STEPS + 1) * DIRECTIONS * NQ] = { 0.0 }, dv[(STEPS + 1) * DIRECTIONS * NV] = { 0.0 };
        double *by_wrenches[1] = { by_wrench };
        const double du[DIRECTIONS * 3] = { 0.5, -0.3, [NU] = 0.1, 0.2 }, dp[DIRECTIONS * NUMBERS] = { 0.1, [4] = 0.2, [8] = 0.01, [12] = -0.3, [16] = 0.4 };
        const eom_step_sequence steps = { dt, at, row, STEPS, methods[m] };
        const eom_input_slopes loads = { by_torque, by_program, &by_gains[0], &by_gains[2], NULL, NULL, by_wrenches };
        const eom_slopes into = { by_u, by_target, by_kp, by_kd, by_h, &loads };
        const eom_rates along = { du, (size_t)NU, 0U, dp };
        memcpy(q, starts_q[0], sizeof starts_q[0]);
        memcpy(v, starts_v[0], sizeof starts_v[0]);
        for (int k = 0; k <= STEPS; ++k) {
            for (int i = 0; i < 2; ++i) by_q[k * NQ + i] = 0.3 - 0.1 * i + 0.02 * k;
            for (int i = 0; i < NV; ++i) by_v[k * NV + i] = 0.2 * i - 0.01 * k;
        }
        memcpy(weights_q, by_q, sizeof by_q);
        memcpy(weights_v, by_v, sizeof by_v);
        for (int d = 0; d < DIRECTIONS; ++d) {
            for (int i = 0; i < 2; ++i) dq[d * NQ + i] = 0.6 - 0.4 * i - 0.1 * d;
            for (int i = 0; i < NV; ++i) dv[d * NV + i] = (0.1 * d - 0.3) * i;
        }
        if (eom_rollout_states(&derivatives, h, drive, inputs, &steps, q, v, kept, work) != -1) exit(4);
        print(STEPS + 1, q, v);
        eom_rollout_gradient(&derivatives, h, drive, inputs, &steps, q, v, (m % 2 == 0) ? kept : NULL, by_q, by_v, &into, work);
        print(STEPS + 1, by_q, by_v);
        for (int i = 0; i < 2; ++i) printf("%.17g %.17g %.17g %.17g %.17g\n", by_u[i], by_target[i], by_kp[i], by_kd[i], DRIVEN ? by_u[2] : 0.0);
        for (int i = 0; i < NUMBERS; ++i) printf("%.17g %.17g %.17g %.17g %.17g\n", by_h[i], by_torque[i % 4], by_program[i % 4], by_gains[i % 4], by_wrench[i % 6]);
        if (eom_rollout_sensitivity(&derivatives, h, drive, inputs, &steps, DIRECTIONS, &along, q, v, dq, dv, work) != -1) exit(4);
        print((STEPS + 1) * DIRECTIONS, dq, dv);
        for (int d = 0; d < DIRECTIONS; ++d) { /* the rate of the weighted sum, by tangents and by the gradient */
            double ahead = 0.0, back = 0.0;
            for (int k = 0; k <= STEPS; ++k) ahead += product(NQ, &weights_q[k * NQ], &dq[(k * DIRECTIONS + d) * NQ]) + product(NV, &weights_v[k * NV], &dv[(k * DIRECTIONS + d) * NV]);
            back = product(NQ, by_q, &dq[d * NQ]) + product(NV, by_v, &dv[d * NV]) + product(NU, by_u, &du[d * NU]) + product(NUMBERS, by_h, &dp[d * NUMBERS]);
            printf("rate %.17g %.17g\n", ahead, back);
        }
    }
}

int main(int count, char **words)
{
    static double state[ROOM + 1], input[INPUT + 1], slope_state[SLOPE_ROOM + 1], slope_input[SLOPE_INPUT + 1];
    static lanes state_lanes[ROOM];
    int index[INDEX];
    const double knots[2] = { 0.0, 0.4 }, wave[4] = { 0.1, 5.0, 0.3, 0.0 }, torques[4] = { 0.3, -0.2, 1.0, 2.0 }, course[4] = { 0.1, 0.2, -0.5, 0.3 }, ratio[2] = { 1.5, 1.0 }, gains[2] = { 2.0, 3.0 }, force[WRENCH] = { 0.4, -0.7 };
    const eom_spline torque = { knots, torques, NULL, 1, 1, 2 }, program = { knots, course, NULL, 1, 1, 2 }, push = { knots, force, NULL, 1, 0, WRENCH };
    const eom_track track = { &torque, places };
    const eom_tracking control = { { &program, places }, ratio, gains, &gains[0] };
    const eom_prescribed given = { .place = places, .wave = wave, .size = 1 };
    const eom_wrench wrench = { .signal = &push, .t0 = -1.0, .t1 = 9.0, .frame = -1 };
    const eom_energy_balance balance = { generalized_force, h, DRIVEN ? drive_forces : NULL, h, needed, h, NULL };
    const eom_inputs inputs = {
        .last = 0.4, .work = &balance, .torque = &track, .control = &control, .given = PRESCRIBED ? &given : NULL, .wrench = &wrench, .wrenches = 1U, .effort = effort,
        .external_force = external_force, .force_h = h, .force_back = force_adjoint, .force_back_h = h, .force_along = force_tangent, .force_along_h = h, .force_by = force_parameter_tangent, .force_by_h = h,
    };
    const eom_workspace work = { input, index, state }, slope_work = { slope_input, NULL, slope_state };
    const eom_workspace_lanes work_lanes = { input, index, state_lanes };
    if (count < 2) return 1;
    state[ROOM] = input[INPUT] = slope_state[SLOPE_ROOM] = slope_input[SLOPE_INPUT] = 4.0;
    begin();
    for (int way = 0; way < 3; ++way) { /* drives alone, with a controller and limits, and with inputs */
        const eom_drive drive = { .u = pull, .kp = (way > 0) ? kp : NULL, .kd = kd, .target = target, .effort = (way == 1) ? effort : NULL };
        const eom_inputs *const acting = (way == 2) ? &inputs : NULL;
        if (words[1][0] == 'f') fixed(&drive, acting, work, work_lanes);
        if (words[1][0] == 'a') adaptive(&drive, acting, work, work_lanes);
        if (words[1][0] == 'd') differentiated(&drive, acting, slope_work);
        look(state, ROOM, input, INPUT);
        look(slope_state, SLOPE_ROOM, slope_input, SLOPE_INPUT);
    }
    return 0;
}
