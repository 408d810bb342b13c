/* eom.h: time integration of equations of motion  M(q) a + b(q, v) = u  of a robot, of one state or of many.
 *
 * Nothing here knows a robot.  A robot is its sizes and its equations (eom_robot), generated or written by hand; steps
 * of fixed length, steps with error control, input signals, energy balances and loops that stay assembled are written
 * once.
 *
 * SI units and radians; nq positions q; nv rates v, of which the first nq are velocities and the others internal states
 * of forces, and their derivatives a; nu inputs u, generalized forces first; matrices are stored by rows.  No heap and
 * no state: all memory is the caller's, and every call is re-entrant.  Names that begin with eom_ are in double
 * precision, those with eomf_ in single precision. */
#ifndef EOM_H
#define EOM_H

#include <stddef.h>

/* Piecewise polynomials of t - knot[k] between knot[k] and knot[k + 1], constant outside: coefficient is (pieces,
 * degree + 1, columns), the constant first.  With a profile, of one column, that column stands in the place of t. */
typedef struct eom_spline {
    const double *knot; /* s, pieces + 1 */
    const double *coefficient;
    const struct eom_spline *profile;
    int pieces;
    int degree;
    int columns;
} eom_spline;

/* A signal: column i of a spline is of coordinate place[i]. */
typedef struct {
    const eom_spline *signal;
    const int *place;
} eom_track;

/* PD tracking control on the driving side of gears: (kp (reference - q / ratio) + kd (its rate - v / ratio)) /
 * ratio. */
typedef struct {
    eom_track program; /* the reference trajectory */
    const double *ratio;
    const double *kp; /* N/m or Nm/rad, or NULL: none */
    const double *kd; /* N s/m or Nm s/rad */
} eom_tracking;

/* One parametrisation of a mechanism's dependent coordinates: chart has 1 where a coordinate follows, turned the joints
 * of three rotations whose other angles are taken. */
typedef struct {
    const double *following_h;
    const double *residual_h;
    const double *chart;
    const int *turned;
} eom_chart;

/* Closed loops of the model of computed torque: forces are those of the drives, driven being 1, along which all else
 * follows by one of so many charts; not finite where it does not close.  angles and origin are the places of a joint's
 * angles and of its x, or -1. */
typedef struct {
    int (*following)(const double *h, const double *q, const double *v, const double *a, const double *chart,
            double *out);
    int (*residual)(const double *h, const double *q, const double *v, const double *a, const double *u, double *out);
    const eom_chart *charts;
    const int *driven;
    const int *angles;
    const int *origin;
    int count;
    int joints;
    int gaps;
} eom_mechanism;

/* Computed torque: inverse dynamics of a rigid model, of size coordinates at place behind gears, at accelerations that
 * make errors of the reference die out by the bandwidth, 1/s; if it holds, at rest (gravity compensation).  Many states
 * that have one model are asked for at a time by inverse_dynamics_batch, with batch_h, if that is not NULL.  back and
 * along are the model's adjoint and tangent, for derivatives. */
typedef struct {
    int (*inverse_dynamics)(const double *h, const double *q, const double *v, const double *a, double *out);
    const double *h;
    long long (*inverse_dynamics_batch)(size_t count, const double *h, const double *q, size_t q_step, const double *v,
            size_t v_step, const double *a, size_t a_step, double *out);
    const double *batch_h;
    const int *place;
    const double *ratio;
    const int *column; /* of the reference that drives a coordinate, or -1 */
    const int *given;  /* which of the prescribed motions it follows, or -1 */
    int (*back)(const double *h, const double *q, const double *v, const double *a, const double *weights, double *out);
    const double *back_h;
    int (*along)(const double *h, const double *q, const double *v, const double *a, const double *dq, const double *dv,
            const double *da, double *out);
    const double *along_h;
    double bandwidth;
    int size;
    int holds;
    const eom_mechanism *mechanism; /* NULL: a tree */
} eom_computed_torque;

/* Motions of prescribed coordinates: offset + amplitude sin(frequency t + phase), or signals, whose places are among
 * them.  They are put into q and v, and their accelerations into the drives. */
typedef struct {
    const int *place;
    const double *wave; /* (size, 4): amplitude, angular frequency rad/s, phase rad, offset */
    const eom_track *tracks;
    int size;
    int count;
} eom_prescribed;

/* A force and a moment, N and Nm, on the centre of mass of a link from t0 until t1, in the base frame, or in the axes
 * of a frame if it turns. */
typedef struct {
    const eom_spline *signal;
    double t0;
    double t1;
    double arm[3]; /* m, of the force, in the frame's axes */
    int link;
    int frame; /* -1: none */
    int turns;
} eom_wrench;

/* Derivatives by what input signals are made of, added to. */
typedef struct {
    double *torque;
    double *program;
    double *kp;
    double *kd;
    double *bandwidth;
    double **tracks;
    double **wrench;
} eom_input_slopes;

enum { EOM_WORKS = 4 }; /* of drives, of what moves prescribed coordinates, of wrenches, and dissipated */

/* Where an integration goes on; all zeros at its beginning. */
typedef struct {
    double t;        /* s */
    double next;     /* step that is tried next, s */
    double largest;
    double smallest;
    double looked;
    double excess;   /* error of the last step beside what is allowed */
    double work[4];  /* J */
    double *works;   /* NULL, or (samples + 1, EOM_WORKS) */
    long long steps;
    long long rejected;
    long long counted;
    size_t sample;
    int refused;
    /* 0: goes on; 1: at its end; 2 + i: no step is short enough for number i of the state; 2 + nq + nv + i: there is no
     * acceleration of coordinate i, as the mass matrix cannot be inverted; 2 + 2 nq + nv + r: constraint r stays
     * violated */
    int reason;
    /* NULL, or of Radau IIA room for what steps leave to the next call, EOM_KEPT_ROOM numbers of any value */
    double *kept;
} eom_progress;

/* Automatic stiffness switching: which of the two methods with error control takes the next steps. */
typedef struct {
    double worth[2];  /* time that each led on by for its cost, s */
    double led;       /* since its turn began, s */
    long long taken;  /* steps since then, rejected too */
    long long left;   /* until one is chosen anew */
    int method;
    int tried[2];
    int settled;      /* whether one proved better, */
    int better;       /* which, */
    int length;       /* and for how many trials' lengths it goes on */
} eom_switching;

/* Sizes of a workspace: of scalars or lanes, of doubles, and of integers; n is nv, which is at least nq and nu. */
#define EOM_STATE_ROOM(n, m, hoisted, factors, wrench, parameters, rotations) \
    (52 * (n) + 40 * (m) + 5 * (hoisted) + (factors) + (wrench) + (parameters) + 4 * (rotations) + 104)
#define EOM_INPUT_ROOM(n, lanes, gaps) \
    ((9 * (lanes) + 18) * (n) + (((gaps) > 0) ? ((n) * (n) + (gaps) * ((n) + 1)) : 0))
#define EOM_INDEX_ROOM(n, lanes, rotations) (2 * (n) + ((lanes) + 1) * (rotations))

/* Methods of steps that are differentiated: their kind + EOM_KINDS times their number in it (of explicit ones 0 is the
 * classical Runge-Kutta method, 1 Tsitouras'); numbers that are kept of a step; sizes of a workspace for them, of
 * scalars and of doubles. */
enum { EOM_EXPLICIT, EOM_IMPLICIT_EULER, EOM_ROSENBROCK, EOM_KINDS };
#define EOM_KEPT_NUMBERS(n, m, method) \
    ((n) * (((method) % EOM_KINDS == EOM_ROSENBROCK) ? (((m) > 0) ? 36 : 12) \
            : (((method) % EOM_KINDS == EOM_IMPLICIT_EULER) ? (((m) > 0) ? 1 : 0) : (((m) > 0) ? 18 : 6))))
#define EOM_SENSITIVITY_ROOM(n, m, hoisted, factors, wrench, parameters, poses) \
    (147 * (n) + 4 * (m) + (hoisted) + 3 * (factors) + 2 * (wrench) + 5 * (parameters) + 2 * (poses))
#define EOM_SENSITIVITY_INPUT_ROOM(n) (24 * (n))

/* More scalars or lanes for Radau IIA (method 2), and what that keeps of a state between calls. */
#define EOM_KEPT_ROOM(n) (14 * (n) + 6)
#define EOM_RADAU_ROOM(n, m, factors, pair_factors) (62 * (n) + 15 * (m) + (factors) + 2 * (pair_factors) + 96)

/* Equations, of numbers that are scalars or lanes. */
#define EOM_EQUATIONS(real) \
    int (*forward_dynamics)(const real *h, const real *q, const real *v, const real *u, real *a); \
    int (*implicit_step)(const real *h, const real *q, const real *v, const real *u, const real *added, \
            const real *times, real *a); \
    int (*stage_factors)(const real *h, const real *q, const real *v, const real *kp, const real *kd, \
            const real *times, real *factors); \
    int (*stage_solution)(const real *h, const real *factors, const real *right, const real *shifts, real *w); \
    int (*settling)(const real *h, const real *q, const real *v, real *change); \
    int (*pair_factors)(const real *h, const real *q, const real *v, const real *kp, const real *kd, \
            const real *pair_times, const real *spans, real *factors); \
    int (*pair_solution)(const real *h, const real *factors, const real *right, const real *shifts, real *w)

#define EOM(name) eom_##name
#define EOM_SCALAR double
#include "eom_types.h"
#include "eom_robot.h"
#undef EOM
#undef EOM_SCALAR

#define EOM(name) eomf_##name
#define EOM_SCALAR float
#include "eom_types.h"
#include "eom_robot.h"
#undef EOM
#undef EOM_SCALAR

#endif
