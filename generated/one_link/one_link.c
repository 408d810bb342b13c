/* one_link.c: equations of motion of the robot one_link, written by eomgen 0.1.0.
 * What the arrays hold is said in one_link.h.  No heap, no state: every call is re-entrant.
 * Equation numbers are those of the paper "Mathematics Model for 6-DOF Joints Manipulation Robots". */
#define EOM_POSITIONS 2
#define EOM_RATES 2
#define EOM_INPUTS 2
#define EOM_M 0
#define EOM_ROTATIONS 0
#include "one_link.h"

#include "clib/lanes.h"
#include "clib/batches.h"

EOM_LOCAL const eom_sizes one_link_sizes = {
    .positions = 2,
    .rates = 2,
    .inputs = 2,
    .hoisted = 7,
    .parameters = 4,
    .factors = 8,
    .wrench = 6,
    .closed_gap = 1e-11,
    .open_gap = 1e-09,
};

#define EOM_FRAMES one_link_frames
#include "clib/frames.h"

EOM_LOCAL const EOM_TABLES_OF_FRAMES(5, 4, 1, 3, 1, 2) one_link_frames = {
    .run_of = { 0, 0, 1, 2, 3 },
    .behind = { -1, 1, 0, 1 },
    .turned = { 0, 1, 0, 0, 0 },
    .first = { 0, 1, 1, 1 },
    .place = { 1 },
    .body_of = { 0, -1, 0 },
    .parent = { -1 },
    .first_axis = { 0 },
    .count = { 2 },
    .is_rotation = { 0, 1 },
    .first_frame = 2, .angles = 1, .n = 2,
};

#if !defined(EOMGEN_BATCHES_ONLY) || defined(EOMGEN_SETUP)

/* What depends on parameters alone: h holds p, then what kernels read of it. */
void one_link_setup(const double *restrict p, double *restrict h)
{
    (void)p;
    (void)h;

    h[0] = p[0];
    h[1] = p[1];
    h[2] = p[2];
    h[3] = p[3];
    h[4] = 0.5*p[3];
    h[5] = -p[2];
    h[6] = 0.5*p[2];
}
#endif

#if !defined(EOMGEN_BATCHES_ONLY) /* one state at a time */

/* Mass matrix M(q), eq. (11). */
int one_link_mass_matrix(const double *restrict h, const double *restrict q, double *restrict out)
{
    TURN(1, q[1]);
    (void)h;

    out[0] = 1.0;
    out[3] = 0.3333333333333333;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = -0.5*sine[0];
    out[2] = out[1];

    return 0;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
int one_link_bias_force(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    TURN(1, q[1]);
    (void)h;

    out[1] = 0.0;
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = cosine[0]*(-0.5*(v[1]*v[1]));

    return 0;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
int one_link_generalized_force(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    TURN(1, q[1]);
    (void)v;

    const double t12 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = -0.5*t12;
    out[0] = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t12 - q[0]*h[3];

    return 0;
}

/* Q_F of eq. (14), its moment term corrected; base frame. */
int one_link_external_force(const double *restrict h, const double *restrict q, const double *restrict wrench, double *restrict out)
{
    TURN(1, q[1]);
    (void)h;

    const double t11 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[1] = wrench[5] + 0.5*t11;
    out[0] = cosine[0]*(cosine[0]*wrench[0] + sine[0]*wrench[1]) - sine[0]*t11;

    return 0;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
int one_link_residual(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, const double *restrict u, double *restrict out)
{
    TURN(1, q[1]);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t12 = a[0] - h[0];
    const double t18 = sine[0]*t12 + h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const double t31 = cosine[0]*(cosine[0]*t12 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t18);
    out[0] = t31 + q[0]*h[3] - u[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t18 - u[1];

    return 0;
}

/* The drives u that make the residual zero. */
int one_link_inverse_dynamics(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    TURN(1, q[1]);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t10 = a[0] - h[0];
    const double t16 = sine[0]*t10 + h[1]*cosine[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t16;
    /* joint1: traces against its tangents, eq. (5) */
    const double t29 = cosine[0]*(cosine[0]*t10 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t16);
    out[0] = t29 + q[0]*h[3];

    return 0;
}

/* Accelerations under the drives u. */
int one_link_forward_dynamics(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, double *restrict out)
{
    double pivot[4];
    TURN(1, q[1]);

    pivot[1] = 1.0;
    pivot[2] = 0.3333333333333333;
    pivot[3] = 0.3333333333333333;
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t15 = h[0]*sine[0] - h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const double t23 = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0] + 0.5*(v[1]*v[1])) + sine[0]*t15;
    const double t27 = u[1] - 0.5*t15;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    const double t31 = 1.5*sine[0];
    const double t34 = 1.0 - 0.5*sine[0]*t31;
    pivot[0] = t34;
    const double t38 = 1.0/t34*(u[0] - (q[0]*h[3] - t23) + t27*t31);
    out[0] = t38;
    out[1] = 3.0*t27 + t31*t38;

    return singular(2, pivot);
}

/* Derivatives of the residual by q, v and a: three matrices. */
int one_link_residual_jacobian(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    TURN(1, q[1]);

    out[0] = h[3];
    out[2] = 0.0;
    out[4] = 0.0;
    out[6] = 0.0;
    out[8] = 1.0;
    out[11] = 0.3333333333333333;
    /* link1: velocity, acceleration, and what they are to the tangents of joint1 */
    const double t10 = a[0] - h[0];
    const double t13 = v[0]*cosine[0];
    /* joint1: rows and columns of the derivatives of eq. (5) */
    const double t33 = sine[0]*(0.5*(v[1]*v[1]) - (cosine[0]*t10 - h[1]*sine[0])) - cosine[0]*(0.5*a[1] - (sine[0]*t10 + h[1]*cosine[0]));
    const double t34 = 0.5*cosine[0];
    const double t35 = 0.5*sine[0];
    out[5] = cosine[0]*(2.0*(v[0]*sine[0]) - v[1]) - sine[0]*(2.0*t13);
    out[9] = -t35;
    out[10] = out[9];
    out[7] = t13 - 2.0*v[0]*t34;
    out[3] = h[1]*t35 - t10*t34;
    out[1] = t33 - h[1];

    return 0;
}

/* Derivatives of the accelerations by q, v and u: three matrices. */
int one_link_forward_dynamics_jacobian(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, double *restrict out)
{
    double pivot[4];
    TURN(1, q[1]);

    pivot[1] = 1.0;
    pivot[2] = 0.3333333333333333;
    pivot[3] = 0.3333333333333333;
    out[4] = 0.0;
    out[6] = 0.0;
    const double t4 = 0.5*sine[0];
    const double t6 = 1.5*sine[0];
    const double t8 = 1.0 - t4*t6;
    pivot[0] = t8;
    const double t11 = 1.0/t8;
    out[8] = t11;
    out[0] = -(h[3]*t11);
    const double t14 = t6*t11;
    out[10] = t14;
    out[9] = t14;
    out[2] = -(h[3]*t14);
    const double t25 = h[1]*sine[0];
    const double t29 = 0.5*(v[1]*v[1]);
    const double t33 = h[1]*cosine[0];
    const double t34 = h[0]*sine[0] - t33;
    const double t38 = u[0] - (q[0]*h[3] - (cosine[0]*(h[0]*cosine[0] + t25 + t29) + sine[0]*t34));
    const double t41 = u[1] - 0.5*t34;
    const double t44 = t11*(t38 + t41*t6);
    const double t45 = t44 - h[0];
    const double t59 = sine[0]*(cosine[0]*t45 - t25 - t29) + cosine[0]*(0.5*(3.0*t41 + t6*t44) - (t33 + sine[0]*t45));
    const double t60 = h[1] + t59;
    const double t63 = 0.5*cosine[0];
    const double t65 = h[1]*t4 - t63*t45;
    out[1] = t11*t60 - t65*t14;
    const double t70 = 3.0 + t6*t14;
    out[11] = t70;
    out[3] = t60*t14 - t65*t70;
    const double t75 = v[0]*cosine[0];
    const double t82 = sine[0]*(2.0*t75) + cosine[0]*(v[1] - 2.0*(v[0]*sine[0]));
    const double t86 = t75 - t63*(2.0*v[0]);
    out[5] = t11*t82 - t86*t14;
    out[7] = t82*t14 - t86*t70;

    return singular(2, pivot);
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
int one_link_coriolis_matrix(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    TURN(1, q[1]);
    (void)h;

    out[0] = 0.0;
    out[2] = 0.0;
    const double t5 = v[0]*cosine[0];
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = cosine[0]*(v[0]*sine[0] - 0.5*v[1]) - sine[0]*t5;
    out[3] = 0.5*t5 - v[0]*(0.5*cosine[0]);

    return 0;
}

/* Christoffel symbols of the first kind, the tensor C of eq. (12). */
int one_link_christoffel(const double *restrict h, const double *restrict q, double *restrict out)
{
    TURN(1, q[1]);
    (void)h;

    out[0] = 0.0;
    out[1] = 0.0;
    out[2] = 0.0;
    out[4] = 0.0;
    out[5] = 0.0;
    out[6] = 0.0;
    out[7] = 0.0;
    out[3] = -0.5*cosine[0];

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
int one_link_energy(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    TURN(1, q[1]);

    const double t8 = v[0]*cosine[0];
    const double t9 = v[0]*sine[0];
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(0.3333333333333333*v[1] - 0.5*t9));
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*cosine[0]) + h[1]*(0.5*sine[0]));

    return 0;
}

/* Joint reaction wrenches: force and moment on child links, joint frames after the motion. */
int one_link_reactions(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    TURN(1, q[1]);

    out[2] = h[5];
    out[3] = 0.0;
    out[4] = h[6];
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t9 = a[0] - h[0];
    const double t15 = sine[0]*t9 + h[1]*cosine[0];
    out[0] = cosine[0]*t9 - h[1]*sine[0] - 0.5*(v[1]*v[1]);
    out[1] = 0.5*a[1] - t15;
    out[5] = 0.3333333333333333*a[1] - 0.5*t15;

    return 0;
}

/* Joint reaction wrenches to external wrenches alone, joint frames after the motion. */
int one_link_external_reactions(const double *restrict h, const double *restrict q, const double *restrict wrench, double *restrict out)
{
    TURN(1, q[1]);
    (void)h;

    const double t14 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[4] = 0.5*wrench[2] - (cosine[0]*wrench[4] - sine[0]*wrench[3]);
    out[0] = -(cosine[0]*wrench[0] + sine[0]*wrench[1]);
    out[1] = -t14;
    out[2] = -wrench[2];
    out[3] = -(cosine[0]*wrench[3] + sine[0]*wrench[4]);
    out[5] = -(wrench[5] + 0.5*t14);

    return 0;
}

/* Y of inverse dynamics without springs and dampers, u = Y theta; loops cut. */
int one_link_regressor(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    TURN(1, q[1]);

    out[3] = 0.0;
    out[4] = 0.0;
    out[5] = 0.0;
    out[6] = 0.0;
    out[7] = 0.0;
    out[8] = 0.0;
    out[9] = 0.0;
    out[10] = 0.0;
    out[11] = 0.0;
    out[14] = 0.0;
    out[15] = 0.0;
    out[16] = 0.0;
    out[17] = 0.0;
    out[18] = 0.0;
    out[19] = 0.0;
    out[20] = a[1];
    out[21] = out[20];
    const double t8 = a[0] - h[0];
    const double t11 = cosine[0]*t8 - h[1]*sine[0];
    const double t14 = sine[0]*t8 + h[1]*cosine[0];
    out[12] = -t14;
    const double t16 = v[1]*v[1];
    /* link1: motions of its frame per unit rates, and columns of its inertial parameters */
    out[1] = -(cosine[0]*t16 + a[1]*sine[0]);
    out[2] = sine[0]*t16 - a[1]*cosine[0];
    out[0] = cosine[0]*t11 + sine[0]*t14;
    out[13] = -t11;

    return 0;
}

/* Cosine of beta of every joint with three angles, 1 for the others. */
int one_link_euler_cosines(const double *restrict h, const double *restrict q, double *restrict out)
{
    (void)h;
    (void)q;

    out[0] = 1.0;

    return 0;
}

/* (M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step. */
static int one_link_implicit_step(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, const double *restrict added, const double *restrict dt, double *restrict out)
{
    double pivot[4];
    TURN(1, q[1]);

    const double t16 = h[3]*dt[1];
    /* joint1: eliminated, from the tips to the base */
    const double t23 = added[1] + 0.3333333333333333;
    pivot[2] = t23;
    pivot[3] = t23;
    const double t25 = 1.0/t23;
    const double t26 = u[1]*t25;
    const double t33 = sine[0]*(1.0 - (1.0 - 0.25*t25));
    const double t35 = 1.0 - sine[0]*t33;
    const double t40 = t16 + t35;
    pivot[0] = t40;
    pivot[1] = t16 + 1.0;
    const double t42 = 1.0/t40;
    const double t43 = u[0] - h[3]*(q[0] + v[0]*dt[0]) + (cosine[0]*(0.5*(v[1]*v[1])) + sine[0]*(0.5*t26));
    /* joint1: accelerations, from the base to the tips */
    const double t50 = t42*t43 + (h[0]*(t35*t42) + h[1]*(cosine[0]*t33*t42));
    out[0] = t50;
    out[1] = t26 + 0.5*t25*(sine[0]*(t50 - h[0]) + h[1]*cosine[0]);

    return singular(2, pivot);
}

/* Factors of M + c B + c^2 K, for the stages of a Rosenbrock method. */
static int one_link_stage_factors(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict kp, const double *restrict kd, const double *restrict times, double *restrict out)
{
    double pivot[4];
    TURN(1, q[1]);
    (void)v;

    out[0] = sine[0];
    const double t7 = h[3]*times[1];
    out[1] = t7;
    out[2] = h[3]*times[0];
    const double t11 = kd[1]*times[0] + kp[1]*times[1];
    out[3] = t11;
    out[4] = kp[1]*times[0];
    /* joint1: eliminated, from the tips to the base */
    const double t14 = t11 + 0.3333333333333333;
    pivot[2] = t14;
    pivot[3] = t14;
    const double t16 = 1.0/t14;
    out[5] = t16;
    out[6] = 0.5*t16;
    const double t26 = t7 + (1.0 - sine[0]*(sine[0]*(1.0 - (1.0 - 0.25*t16))));
    pivot[0] = t26;
    pivot[1] = t7 + 1.0;
    out[7] = 1.0/t26;

    return singular(2, pivot);
}

/* w of (M + c B + c^2 K) w = -((c B + c^2 K) rates + c K shifts). */
static int one_link_stage_solution(const double *restrict h, const double *restrict kept, const double *restrict rates, const double *restrict shifts, double *restrict out)
{
    (void)h;

    /* joint1: eliminated, from the tips to the base */
    const double t16 = (rates[1]*kept[3] + shifts[1]*kept[4])*kept[5];
    const double t23 = kept[7]*(rates[0]*kept[1] + shifts[0]*kept[2] + kept[0]*(0.5*t16));
    out[0] = -t23;
    /* joint1: accelerations, from the base to the tips */
    out[1] = -(t16 + kept[6]*(kept[0]*t23));

    return 0;
}

#include "clib/state_one.h"
#include "clib/kinematics.h"

EOM_PART void one_link_kinematics0(const double *restrict q, const double *restrict sine, const double *restrict cosine, int last, double *restrict origins, double *restrict axes, double *restrict kept)
{
    origins[0] = q[0];
    origins[1] = 0.0;
    origins[2] = 0.0;
    axes[1] = 0.0;
    axes[2] = 0.0;
    axes[3] = 0.0;
    axes[4] = 0.0;
    axes[0] = 1.0;
    axes[5] = 1.0;
    kept[0] = cosine[0];
    kept[2] = sine[0];
    if (last <= 0) { return; }
    kept[1] = -sine[0];
}

EOM_PART void one_link_kinematics1(const double *restrict q, const double *restrict given, double *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = 0.0;
    pose[6] = 0.0;
    pose[8] = 0.0;
    pose[9] = 0.0;
    pose[11] = 0.0;
    pose[4] = given[2];
    pose[7] = pose[4];
    pose[10] = 1.0;
    pose[3] = q[0] + given[0];
}

EOM_PART void one_link_kinematics2(double *restrict pose)
{
    pose[0] = 1.0;
    pose[5] = 1.0;
    pose[10] = 1.0;
    pose[1] = 0.0;
    pose[2] = 0.0;
    pose[3] = 0.0;
    pose[4] = 0.0;
    pose[6] = 0.0;
    pose[7] = 0.0;
    pose[8] = 0.0;
    pose[9] = 0.0;
    pose[11] = 0.0;
}

EOM_PART void one_link_kinematics3(const double *restrict q, const double *restrict given, double *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = 0.0;
    pose[6] = 0.0;
    pose[7] = 0.0;
    pose[8] = 0.0;
    pose[9] = 0.0;
    pose[11] = 0.0;
    pose[3] = q[0];
    pose[4] = given[2];
    pose[10] = 1.0;
}

/* A run of bodies up to the last one that is wanted, or a frame. */
static void one_link_run(int run, int last, const double *h, const double *q, const double *sine, const double *cosine, double *kept, double *pose, double *origins, double *axes)
{
    const double *const given = kept;
    (void)h;
    switch (run) {
    case 0: one_link_kinematics0(q, sine, cosine, last, origins, axes, kept); break;
    case 1: one_link_kinematics1(q, given, pose); break;
    case 2: one_link_kinematics2(pose); break;
    case 3: one_link_kinematics3(q, given, pose); break;
    default: break;
    }
}

/* Pose of a frame, and origins and axes of the bodies between the base and it. */
static void one_link_forward_kinematics(const double *restrict h, const double *restrict q, int frame, double *restrict pose, double *restrict origins, double *restrict axes)
{
    int way[2];
    double turning[3][PADDED(1)];
    double kept[3];
    const eom_way room = { way, turning[0], turning[1], turning[2], kept };
    eom_forward_kinematics(one_link_run, h, q, q, frame, pose, origins, axes, room);
}

/* Pose of a frame in the base, 4x4; eqs. (1) and (2). */
int one_link_frame_pose(const double *restrict h, const double *restrict q, int frame, double *restrict out)
{
    double origins[3];
    double axes[6];
    one_link_forward_kinematics(h, q, frame, out, origins, axes);
    eom_last_row(out);
    return 0;
}

/* Linear velocity of a frame's origin (rows 0 to 2) and angular velocity (rows 3 to 5) per coordinate, base frame. */
int one_link_frame_jacobian(const double *restrict h, const double *restrict q, int frame, double *restrict out)
{
    double pose[12];
    double origins[3];
    double axes[6];
    one_link_forward_kinematics(h, q, frame, pose, origins, axes);
    eom_frame_jacobian(frame, pose, origins, axes, out);
    return 0;
}

static const eom_robot one_link_robot = {
    .sizes = &one_link_sizes,
    .forward_dynamics = one_link_forward_dynamics,
    .implicit_step = one_link_implicit_step,
    .stage_factors = one_link_stage_factors,
    .stage_solution = one_link_stage_solution,
};

#if !defined(EOM_LINKED) /* defined where the library's objects are linked; without it the library is compiled for this robot */
#include "clib/integrate.c"
#endif

/* One state over many steps. */
long long one_link_rollout(const double *restrict h, const double *restrict q, const double *restrict v, const one_link_drive *restrict drive, double dt, size_t steps, size_t every, int method, double *restrict q_out, double *restrict v_out)
{
    double state[EOM_STATE_ROOM(2, 0, 7, 8, 6, 4, 0)];
    double input[EOM_INPUT_ROOM(2, 1, 0)];
    int index[EOM_INDEX_ROOM(2, 1, 0)];
    const eom_workspace work = { state, input, index };

    return eom_integrate_fixed(&one_link_robot, h, q, v, drive, NULL, 0.0, dt, steps, every, method, q_out, v_out, work);
}

/* One state over all samples, or as far as allowed->most steps lead: q, v and progress are where it goes on then. */
int one_link_adaptive_rollout(const double *restrict h, const one_link_drive *restrict drive, const one_link_loads *restrict loads, const one_link_tolerance *restrict allowed, const double *restrict times, size_t samples, int method, double *restrict q, double *restrict v, double *restrict q_out, double *restrict v_out, one_link_progress *restrict progress, one_link_record *restrict record)
{
    double state[EOM_STATE_ROOM(2, 0, 7, 8, 6, 4, 0)];
    double input[EOM_INPUT_ROOM(2, 1, 0)];
    int index[EOM_INDEX_ROOM(2, 1, 0)];
    const eom_workspace work = { state, input, index };

    return eom_integrate_adaptive(&one_link_robot, h, drive, loads, allowed, times, samples, method, q, v, q_out, v_out, progress, record, work);
}

/* Drives of loads at times, and prescribed accelerations; prescribed motions are put into q and v. */
void one_link_loaded(size_t count, const one_link_loads *restrict loads, const double *restrict times, double *restrict q, double *restrict v, double *restrict u)
{
    double input[EOM_INPUT_ROOM(2, 1, 0)];
    int index[EOM_INDEX_ROOM(2, 1, 0)];
    eom_inputs_over_time(&one_link_sizes, count, loads, times, q, v, u, input, index);
}

#endif /* one state at a time */

#if !defined(EOMGEN_SINGLES_ONLY) /* several states at a time: the same statements on vectors, a state in every lane */

/* Mass matrix M(q), eq. (11). */
static int one_link_mass_matrix_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)h;

    out[0] = ALL(1.0);
    out[3] = ALL(0.3333333333333333);
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = -0.5*sine[0];
    out[2] = out[1];

    return 0;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
static int one_link_bias_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)h;

    out[1] = ALL(0.0);
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = cosine[0]*(-0.5*(v[1]*v[1]));

    return 0;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
static int one_link_generalized_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)v;

    const lanes t12 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = -0.5*t12;
    out[0] = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t12 - q[0]*h[3];

    return 0;
}

/* Q_F of eq. (14), its moment term corrected; base frame. */
static int one_link_external_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict wrench, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)h;

    const lanes t11 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[1] = wrench[5] + 0.5*t11;
    out[0] = cosine[0]*(cosine[0]*wrench[0] + sine[0]*wrench[1]) - sine[0]*t11;

    return 0;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
static int one_link_residual_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, const lanes *restrict u, lanes *restrict out)
{
    TURN_AT(1, q + 1);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t12 = a[0] - h[0];
    const lanes t18 = sine[0]*t12 + h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t31 = cosine[0]*(cosine[0]*t12 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t18);
    out[0] = t31 + q[0]*h[3] - u[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t18 - u[1];

    return 0;
}

/* The drives u that make the residual zero. */
static int one_link_inverse_dynamics_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    TURN_AT(1, q + 1);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t10 = a[0] - h[0];
    const lanes t16 = sine[0]*t10 + h[1]*cosine[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t16;
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t29 = cosine[0]*(cosine[0]*t10 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t16);
    out[0] = t29 + q[0]*h[3];

    return 0;
}

/* Accelerations under the drives u. */
static int one_link_forward_dynamics_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict u, lanes *restrict out)
{
    lanes pivot[4];
    TURN_AT(1, q + 1);

    pivot[1] = ALL(1.0);
    pivot[2] = ALL(0.3333333333333333);
    pivot[3] = pivot[2];
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t15 = h[0]*sine[0] - h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t23 = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0] + 0.5*(v[1]*v[1])) + sine[0]*t15;
    const lanes t27 = u[1] - 0.5*t15;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    const lanes t31 = 1.5*sine[0];
    const lanes t34 = 1.0 - 0.5*sine[0]*t31;
    pivot[0] = t34;
    const lanes t38 = 1.0/t34*(u[0] - (q[0]*h[3] - t23) + t27*t31);
    out[0] = t38;
    out[1] = 3.0*t27 + t31*t38;

    return singular_lanes(2, 2, pivot);
}

/* Derivatives of the residual by q, v and a: three matrices. */
static int one_link_residual_jacobian_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    TURN_AT(1, q + 1);

    out[0] = ALL(h[3]);
    out[2] = ALL(0.0);
    out[4] = out[2];
    out[6] = out[2];
    out[8] = ALL(1.0);
    out[11] = ALL(0.3333333333333333);
    /* link1: velocity, acceleration, and what they are to the tangents of joint1 */
    const lanes t10 = a[0] - h[0];
    const lanes t13 = v[0]*cosine[0];
    /* joint1: rows and columns of the derivatives of eq. (5) */
    const lanes t33 = sine[0]*(0.5*(v[1]*v[1]) - (cosine[0]*t10 - h[1]*sine[0])) - cosine[0]*(0.5*a[1] - (sine[0]*t10 + h[1]*cosine[0]));
    const lanes t34 = 0.5*cosine[0];
    const lanes t35 = 0.5*sine[0];
    out[5] = cosine[0]*(2.0*(v[0]*sine[0]) - v[1]) - sine[0]*(2.0*t13);
    out[9] = -t35;
    out[10] = out[9];
    out[7] = t13 - 2.0*v[0]*t34;
    out[3] = h[1]*t35 - t10*t34;
    out[1] = t33 - h[1];

    return 0;
}

/* Derivatives of the accelerations by q, v and u: three matrices. */
static int one_link_forward_dynamics_jacobian_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict u, lanes *restrict out)
{
    lanes pivot[4];
    TURN_AT(1, q + 1);

    pivot[1] = ALL(1.0);
    pivot[2] = ALL(0.3333333333333333);
    pivot[3] = pivot[2];
    out[4] = ALL(0.0);
    out[6] = out[4];
    const lanes t4 = 0.5*sine[0];
    const lanes t6 = 1.5*sine[0];
    const lanes t8 = 1.0 - t4*t6;
    pivot[0] = t8;
    const lanes t11 = 1.0/t8;
    out[8] = t11;
    out[0] = -(h[3]*t11);
    const lanes t14 = t6*t11;
    out[10] = t14;
    out[9] = t14;
    out[2] = -(h[3]*t14);
    const lanes t25 = h[1]*sine[0];
    const lanes t29 = 0.5*(v[1]*v[1]);
    const lanes t33 = h[1]*cosine[0];
    const lanes t34 = h[0]*sine[0] - t33;
    const lanes t38 = u[0] - (q[0]*h[3] - (cosine[0]*(h[0]*cosine[0] + t25 + t29) + sine[0]*t34));
    const lanes t41 = u[1] - 0.5*t34;
    const lanes t44 = t11*(t38 + t41*t6);
    const lanes t45 = t44 - h[0];
    const lanes t59 = sine[0]*(cosine[0]*t45 - t25 - t29) + cosine[0]*(0.5*(3.0*t41 + t6*t44) - (t33 + sine[0]*t45));
    const lanes t60 = h[1] + t59;
    const lanes t63 = 0.5*cosine[0];
    const lanes t65 = h[1]*t4 - t63*t45;
    out[1] = t11*t60 - t65*t14;
    const lanes t70 = 3.0 + t6*t14;
    out[11] = t70;
    out[3] = t60*t14 - t65*t70;
    const lanes t75 = v[0]*cosine[0];
    const lanes t82 = sine[0]*(2.0*t75) + cosine[0]*(v[1] - 2.0*(v[0]*sine[0]));
    const lanes t86 = t75 - t63*(2.0*v[0]);
    out[5] = t11*t82 - t86*t14;
    out[7] = t82*t14 - t86*t70;

    return singular_lanes(2, 2, pivot);
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
static int one_link_coriolis_matrix_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)h;

    out[0] = ALL(0.0);
    out[2] = out[0];
    const lanes t5 = v[0]*cosine[0];
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = cosine[0]*(v[0]*sine[0] - 0.5*v[1]) - sine[0]*t5;
    out[3] = 0.5*t5 - v[0]*(0.5*cosine[0]);

    return 0;
}

/* Christoffel symbols of the first kind, the tensor C of eq. (12). */
static int one_link_christoffel_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)h;

    out[0] = ALL(0.0);
    out[1] = out[0];
    out[2] = out[0];
    out[4] = out[0];
    out[5] = out[0];
    out[6] = out[0];
    out[7] = out[0];
    out[3] = -0.5*cosine[0];

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
static int one_link_energy_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    TURN_AT(1, q + 1);

    const lanes t8 = v[0]*cosine[0];
    const lanes t9 = v[0]*sine[0];
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(0.3333333333333333*v[1] - 0.5*t9));
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*cosine[0]) + h[1]*(0.5*sine[0]));

    return 0;
}

/* Joint reaction wrenches: force and moment on child links, joint frames after the motion. */
static int one_link_reactions_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    TURN_AT(1, q + 1);

    out[2] = ALL(h[5]);
    out[3] = ALL(0.0);
    out[4] = ALL(h[6]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t9 = a[0] - h[0];
    const lanes t15 = sine[0]*t9 + h[1]*cosine[0];
    out[0] = cosine[0]*t9 - h[1]*sine[0] - 0.5*(v[1]*v[1]);
    out[1] = 0.5*a[1] - t15;
    out[5] = 0.3333333333333333*a[1] - 0.5*t15;

    return 0;
}

/* Joint reaction wrenches to external wrenches alone, joint frames after the motion. */
static int one_link_external_reactions_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict wrench, lanes *restrict out)
{
    TURN_AT(1, q + 1);
    (void)h;

    const lanes t14 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[4] = 0.5*wrench[2] - (cosine[0]*wrench[4] - sine[0]*wrench[3]);
    out[0] = -(cosine[0]*wrench[0] + sine[0]*wrench[1]);
    out[1] = -t14;
    out[2] = -wrench[2];
    out[3] = -(cosine[0]*wrench[3] + sine[0]*wrench[4]);
    out[5] = -(wrench[5] + 0.5*t14);

    return 0;
}

/* Y of inverse dynamics without springs and dampers, u = Y theta; loops cut. */
static int one_link_regressor_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    TURN_AT(1, q + 1);

    out[3] = ALL(0.0);
    out[4] = out[3];
    out[5] = out[3];
    out[6] = out[3];
    out[7] = out[3];
    out[8] = out[3];
    out[9] = out[3];
    out[10] = out[3];
    out[11] = out[3];
    out[14] = out[3];
    out[15] = out[3];
    out[16] = out[3];
    out[17] = out[3];
    out[18] = out[3];
    out[19] = out[3];
    out[20] = a[1];
    out[21] = out[20];
    const lanes t8 = a[0] - h[0];
    const lanes t11 = cosine[0]*t8 - h[1]*sine[0];
    const lanes t14 = sine[0]*t8 + h[1]*cosine[0];
    out[12] = -t14;
    const lanes t16 = v[1]*v[1];
    /* link1: motions of its frame per unit rates, and columns of its inertial parameters */
    out[1] = -(cosine[0]*t16 + a[1]*sine[0]);
    out[2] = sine[0]*t16 - a[1]*cosine[0];
    out[0] = cosine[0]*t11 + sine[0]*t14;
    out[13] = -t11;

    return 0;
}

/* Cosine of beta of every joint with three angles, 1 for the others. */
static int one_link_euler_cosines_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    (void)h;
    (void)q;

    out[0] = ALL(1.0);

    return 0;
}

/* (M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step. */
static int one_link_implicit_step_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict u, const lanes *restrict added, const lanes *restrict dt, lanes *restrict out)
{
    lanes pivot[4];
    TURN_AT(1, q + 1);

    const lanes t16 = h[3]*dt[1];
    /* joint1: eliminated, from the tips to the base */
    const lanes t23 = added[1] + 0.3333333333333333;
    pivot[2] = t23;
    pivot[3] = t23;
    const lanes t25 = 1.0/t23;
    const lanes t26 = u[1]*t25;
    const lanes t33 = sine[0]*(1.0 - (1.0 - 0.25*t25));
    const lanes t35 = 1.0 - sine[0]*t33;
    const lanes t40 = t16 + t35;
    pivot[0] = t40;
    pivot[1] = t16 + 1.0;
    const lanes t42 = 1.0/t40;
    const lanes t43 = u[0] - h[3]*(q[0] + v[0]*dt[0]) + (cosine[0]*(0.5*(v[1]*v[1])) + sine[0]*(0.5*t26));
    /* joint1: accelerations, from the base to the tips */
    const lanes t50 = t42*t43 + (h[0]*(t35*t42) + h[1]*(cosine[0]*t33*t42));
    out[0] = t50;
    out[1] = t26 + 0.5*t25*(sine[0]*(t50 - h[0]) + h[1]*cosine[0]);

    return singular_lanes(2, 2, pivot);
}

/* Factors of M + c B + c^2 K, for the stages of a Rosenbrock method. */
static int one_link_stage_factors_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict kp, const lanes *restrict kd, const lanes *restrict times, lanes *restrict out)
{
    lanes pivot[4];
    TURN_AT(1, q + 1);
    (void)v;

    out[0] = sine[0];
    const lanes t7 = h[3]*times[1];
    out[1] = t7;
    out[2] = h[3]*times[0];
    const lanes t11 = kd[1]*times[0] + kp[1]*times[1];
    out[3] = t11;
    out[4] = kp[1]*times[0];
    /* joint1: eliminated, from the tips to the base */
    const lanes t14 = t11 + 0.3333333333333333;
    pivot[2] = t14;
    pivot[3] = t14;
    const lanes t16 = 1.0/t14;
    out[5] = t16;
    out[6] = 0.5*t16;
    const lanes t26 = t7 + (1.0 - sine[0]*(sine[0]*(1.0 - (1.0 - 0.25*t16))));
    pivot[0] = t26;
    pivot[1] = t7 + 1.0;
    out[7] = 1.0/t26;

    return singular_lanes(2, 2, pivot);
}

/* w of (M + c B + c^2 K) w = -((c B + c^2 K) rates + c K shifts). */
static int one_link_stage_solution_lanes(const lanes *restrict h, const lanes *restrict kept, const lanes *restrict rates, const lanes *restrict shifts, lanes *restrict out)
{
    (void)h;

    /* joint1: eliminated, from the tips to the base */
    const lanes t16 = (rates[1]*kept[3] + shifts[1]*kept[4])*kept[5];
    const lanes t23 = kept[7]*(rates[0]*kept[1] + shifts[0]*kept[2] + kept[0]*(0.5*t16));
    out[0] = -t23;
    /* joint1: accelerations, from the base to the tips */
    out[1] = -(t16 + kept[6]*(kept[0]*t23));

    return 0;
}

#include "clib/state_lanes.h"
#include "clib/kinematics.h"

long long one_link_mass_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) ROOM_LANES(4, 1), ONE_VECTOR(2, one_link_mass_matrix_lanes(h_lanes, VECTOR(q, 2), VECTOR(out, 4))), WRITE_LANES(4))
}

long long one_link_bias_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_bias_force_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_generalized_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_generalized_force_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_external_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict wrench, size_t wrench_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(wrench, 6, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_external_force_lanes(h_lanes, VECTOR(q, 2), VECTOR(wrench, 6), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_residual_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, const double *restrict u, size_t u_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(a, 2, 1) READ_LANES(u, 2, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_residual_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(a, 2), VECTOR(u, 2), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_inverse_dynamics_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(a, 2, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_inverse_dynamics_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(a, 2), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_forward_dynamics_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict u, size_t u_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(u, 2, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_forward_dynamics_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(u, 2), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_residual_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(a, 2, 1) ROOM_LANES(12, 1), ONE_VECTOR(2, one_link_residual_jacobian_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(a, 2), VECTOR(out, 12))), WRITE_LANES(12))
}

long long one_link_forward_dynamics_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict u, size_t u_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(u, 2, 1) ROOM_LANES(12, 1), ONE_VECTOR(2, one_link_forward_dynamics_jacobian_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(u, 2), VECTOR(out, 12))), WRITE_LANES(12))
}

long long one_link_coriolis_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) ROOM_LANES(4, 1), ONE_VECTOR(2, one_link_coriolis_matrix_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(out, 4))), WRITE_LANES(4))
}

long long one_link_christoffel_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) ROOM_LANES(8, 1), ONE_VECTOR(2, one_link_christoffel_lanes(h_lanes, VECTOR(q, 2), VECTOR(out, 8))), WRITE_LANES(8))
}

long long one_link_energy_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) ROOM_LANES(2, 1), ONE_VECTOR(2, one_link_energy_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(out, 2))), WRITE_LANES(2))
}

long long one_link_reactions_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(a, 2, 1) ROOM_LANES(6, 1), ONE_VECTOR(2, one_link_reactions_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(a, 2), VECTOR(out, 6))), WRITE_LANES(6))
}

long long one_link_external_reactions_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict wrench, size_t wrench_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(wrench, 6, 1) ROOM_LANES(6, 1), ONE_VECTOR(2, one_link_external_reactions_lanes(h_lanes, VECTOR(q, 2), VECTOR(wrench, 6), VECTOR(out, 6))), WRITE_LANES(6))
}

long long one_link_regressor_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) READ_LANES(v, 2, 1) READ_LANES(a, 2, 1) ROOM_LANES(22, 1), ONE_VECTOR(2, one_link_regressor_lanes(h_lanes, VECTOR(q, 2), VECTOR(v, 2), VECTOR(a, 2), VECTOR(out, 22))), WRITE_LANES(22))
}

long long one_link_euler_cosines_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    SPREAD(h, 7)
    BY_LANES(2, 1, READ_LANES(q, 2, 1) ROOM_LANES(1, 1), ONE_VECTOR(2, one_link_euler_cosines_lanes(h_lanes, VECTOR(q, 2), VECTOR(out, 1))), WRITE_LANES(1))
}

EOM_PART void one_link_kinematics0_lanes(const lanes *restrict q, const lanes *restrict sine, const lanes *restrict cosine, int last, lanes *restrict origins, lanes *restrict axes, lanes *restrict kept)
{
    origins[0] = q[0];
    origins[1] = ALL(0.0);
    origins[2] = origins[1];
    axes[1] = origins[1];
    axes[2] = origins[1];
    axes[3] = origins[1];
    axes[4] = origins[1];
    axes[0] = ALL(1.0);
    axes[5] = axes[0];
    kept[0] = cosine[0];
    kept[2] = sine[0];
    if (last <= 0) { return; }
    kept[1] = -sine[0];
}

EOM_PART void one_link_kinematics1_lanes(const lanes *restrict q, const lanes *restrict given, lanes *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = ALL(0.0);
    pose[6] = pose[2];
    pose[8] = pose[2];
    pose[9] = pose[2];
    pose[11] = pose[2];
    pose[4] = given[2];
    pose[7] = pose[4];
    pose[10] = ALL(1.0);
    pose[3] = q[0] + given[0];
}

EOM_PART void one_link_kinematics2_lanes(lanes *restrict pose)
{
    pose[0] = ALL(1.0);
    pose[5] = pose[0];
    pose[10] = pose[0];
    pose[1] = ALL(0.0);
    pose[2] = pose[1];
    pose[3] = pose[1];
    pose[4] = pose[1];
    pose[6] = pose[1];
    pose[7] = pose[1];
    pose[8] = pose[1];
    pose[9] = pose[1];
    pose[11] = pose[1];
}

EOM_PART void one_link_kinematics3_lanes(const lanes *restrict q, const lanes *restrict given, lanes *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = ALL(0.0);
    pose[6] = pose[2];
    pose[7] = pose[2];
    pose[8] = pose[2];
    pose[9] = pose[2];
    pose[11] = pose[2];
    pose[3] = q[0];
    pose[4] = given[2];
    pose[10] = ALL(1.0);
}

/* A run of bodies up to the last one that is wanted, or a frame. */
static void one_link_run_lanes(int run, int last, const double *h, const lanes *q, const lanes *sine, const lanes *cosine, lanes *kept, lanes *pose, lanes *origins, lanes *axes)
{
    const lanes *const given = kept;
    (void)h;
    switch (run) {
    case 0: one_link_kinematics0_lanes(q, sine, cosine, last, origins, axes, kept); break;
    case 1: one_link_kinematics1_lanes(q, given, pose); break;
    case 2: one_link_kinematics2_lanes(pose); break;
    case 3: one_link_kinematics3_lanes(q, given, pose); break;
    default: break;
    }
}

/* Pose of a frame, and origins and axes of the bodies between the base and it. */
static void one_link_forward_kinematics_lanes(const double *restrict h, const lanes *restrict q, int frame, lanes *restrict pose, lanes *restrict origins, lanes *restrict axes)
{
    int way[2];
    lanes turning[3][1];
    lanes kept[3];
    const eom_way_lanes room = { way, turning[0], turning[1], turning[2], kept };
    eom_forward_kinematics_lanes(one_link_run_lanes, h, q, q, frame, pose, origins, axes, room);
}

/* Pose of a frame in the base, 4x4; eqs. (1) and (2). */
static int one_link_frame_pose_lanes(const double *restrict h, const lanes *restrict q, int frame, lanes *restrict out)
{
    lanes origins[3];
    lanes axes[6];
    one_link_forward_kinematics_lanes(h, q, frame, out, origins, axes);
    eom_last_row_lanes(out);
    return 0;
}

/* Linear velocity of a frame's origin (rows 0 to 2) and angular velocity (rows 3 to 5) per coordinate, base frame. */
static int one_link_frame_jacobian_lanes(const double *restrict h, const lanes *restrict q, int frame, lanes *restrict out)
{
    lanes pose[12];
    lanes origins[3];
    lanes axes[6];
    one_link_forward_kinematics_lanes(h, q, frame, pose, origins, axes);
    eom_frame_jacobian_lanes(frame, pose, origins, axes, out);
    return 0;
}

long long one_link_frame_pose_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, int frame, double *restrict out)
{
    BY_LANES(2, 1, READ_LANES(q, 2, 1) ROOM_LANES(16, 1), ONE_VECTOR(2, one_link_frame_pose_lanes(h, VECTOR(q, 2), frame, VECTOR(out, 16))), WRITE_LANES(16))
}

long long one_link_frame_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, int frame, double *restrict out)
{
    BY_LANES(2, 1, READ_LANES(q, 2, 1) ROOM_LANES(12, 1), ONE_VECTOR(2, one_link_frame_jacobian_lanes(h, VECTOR(q, 2), frame, VECTOR(out, 12))), WRITE_LANES(12))
}

#if defined(EOM_LINKED)
#include "clib/robot_lanes.h"
#else
#include "clib/integrate_lanes.c"
#endif

static const eom_robot_lanes one_link_robot_lanes = {
    .sizes = &one_link_sizes,
    .forward_dynamics = one_link_forward_dynamics_lanes,
    .implicit_step = one_link_implicit_step_lanes,
    .stage_factors = one_link_stage_factors_lanes,
    .stage_solution = one_link_stage_solution_lanes,
};

/* Several states over many steps; -1, or (state * steps + step) * 2 + i of the first failure. */
long long one_link_rollout_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const one_link_drive *restrict drive, double dt, size_t steps, size_t every, int method, double *restrict q_out, double *restrict v_out)
{
    lanes state[EOM_STATE_ROOM(2, 0, 7, 8, 6, 4, 0)];
    double input[EOM_INPUT_ROOM(2, LANES, 0)];
    int index[EOM_INDEX_ROOM(2, LANES, 0)];
    const eom_workspace_lanes work = { state, input, index };

    return EOM_WIDE(integrate_fixed_batch)(&one_link_robot_lanes, count, h, q, q_step, v, v_step, drive, dt, steps, every, method, q_out, v_out, work);
}

/* Several states, each by separate steps, those at ``place``, or the first ones: what one of them does changes no bit of
 * another. */
void one_link_adaptive_rollout_batch(size_t count, const size_t *restrict place, const double *restrict h, size_t h_step, const one_link_drive *restrict drive, const one_link_loads *restrict loads, size_t loads_step, const one_link_tolerance *restrict allowed, size_t allowed_step, const double *restrict times, size_t samples, int method, double *restrict q, double *restrict v, double *restrict q_out, double *restrict v_out, one_link_progress *restrict progress)
{
    lanes state[EOM_STATE_ROOM(2, 0, 7, 8, 6, 4, 0)];
    double input[EOM_INPUT_ROOM(2, LANES, 0)];
    int index[EOM_INDEX_ROOM(2, LANES, 0)];
    const eom_workspace_lanes work = { state, input, index };

    EOM_WIDE(integrate_adaptive_batch)(&one_link_robot_lanes, count, place, h, h_step, drive, loads, loads_step, allowed, allowed_step, times, samples, method, q, v, q_out, v_out, progress, work);
}

#endif /* several states at a time */
