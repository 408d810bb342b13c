/* one_link.c: equations of motion of the robot one_link, written by eomgen 0.1.0.
 * What the arrays hold is said in one_link.h.  No heap, no state: every call is re-entrant.
 * Equation numbers are those of the paper "Mathematics Model for 6-DOF Joints Manipulation Robots". */
#define EOM_WITHOUT_LANES /* functions for several states side by side stand in one_link_batch.c */
#define EOM_POSITIONS 2
#define EOM_RATES 2
#define EOM_INPUTS 2
#define EOM_M 0
#define EOM_ROTATIONS 0
#define EOM_FIXED_ONLY
#if defined(EOM_FIXED_ONLY) && !defined(EOM_SIGNALS) /* defined by C that calls the integration with inputs over time */
#define EOM_HELD
#define EOM_WITHOUT_CHARTS
#define EOM_WITHOUT_LOOPS
#endif
#include "one_link.h"

#include "clib/lanes.h"
#include "clib/batches.h"

/* Numbers of the description, and what comes of them. */
/* (links.link1.inertia.yy + links.link1.inertia.zz) * 0.5 + links.link1.mass * links.link1.com.x * links.link1.com.x */
#define EOM_C0 0.3333333333333333

EOM_LOCAL const eom_sizes one_link_sizes = {
    .positions = 2,
    .rates = 2,
    .inputs = 2,
    .hoisted = 7,
    .parameters = 4,
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
    .is_full = { 0, 0, 0 },
    .parent = { -1 },
    .first_axis = { 0 },
    .count = { 2 },
    .is_rotation = { 0, 1 },
    .first_frame = 2, .angles = 1, .n = 2,
};

/* What depends on parameters alone: h holds p, then what kernels read of it. */
void one_link_setup(const double *restrict p, double *restrict h)
{
    (void)p;
    (void)h;

    h[0] = p[0]; /* gravity.x */
    h[1] = p[1]; /* gravity.y */
    h[2] = p[2]; /* gravity.z */
    h[3] = p[3]; /* joints.joint1.x.stiffness */
    h[4] = 0.5*p[3];
    h[5] = -p[2];
    h[6] = 0.5*p[2];
}

#if !defined(EOM_SETUP_ONLY)

const char *one_link_status_text(int status)
{
    static const char *const text[4] = {
        "ok", /* 0 */
        "joint1.x: the mass matrix cannot be inverted", /* 1 */
        "joint1.gamma: the mass matrix cannot be inverted", /* 2 */
        "unknown status",
    };
    return text[((status >= 0) && (status <= ONE_LINK_STATUSES)) ? status : (ONE_LINK_STATUSES + 1)];
}

/* Mass matrix M(q), eq. (11). */
int one_link_mass_matrix(const double *restrict h, const double *restrict q, double *restrict out)
{
    EOM_SIN_COS(1, q[1]);
    (void)h;

    out[0] = 1.0; /* joint1.x, joint1.x */
    out[3] = EOM_C0; /* joint1.gamma, joint1.gamma */
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = -0.5*sine[0]; /* joint1.x, joint1.gamma */
    out[2] = out[1]; /* joint1.gamma, joint1.x */

    return 0;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
int one_link_bias_force(const double *restrict h, const double *restrict q, const double *restrict v,
        double *restrict out)
{
    EOM_SIN_COS(1, q[1]);
    (void)h;

    out[1] = 0.0; /* joint1.gamma */
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = cosine[0]*(-0.5*(v[1]*v[1])); /* joint1.x */

    return 0;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
int one_link_generalized_force(const double *restrict h, const double *restrict q, const double *restrict v,
        double *restrict out)
{
    EOM_SIN_COS(1, q[1]);
    (void)v;

    const double t12 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = -0.5*t12; /* joint1.gamma */
    out[0] = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t12 - q[0]*h[3]; /* joint1.x */

    return 0;
}

/* Q_F of eq. (14), its moment term corrected; base frame. */
int one_link_external_force(const double *restrict h, const double *restrict q, const double *restrict wrench,
        double *restrict out)
{
    EOM_SIN_COS(1, q[1]);
    (void)h;

    const double t11 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[1] = wrench[5] + 0.5*t11; /* joint1.gamma */
    out[0] = cosine[0]*(cosine[0]*wrench[0] + sine[0]*wrench[1]) - sine[0]*t11; /* joint1.x */

    return 0;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
int one_link_residual(const double *restrict h, const double *restrict q, const double *restrict v,
        const double *restrict a, const double *restrict u, double *restrict out)
{
    EOM_SIN_COS(1, q[1]);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t12 = a[0] - h[0];
    const double t18 = sine[0]*t12 + h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const double t31 = cosine[0]*(cosine[0]*t12 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t18);
    out[0] = t31 + q[0]*h[3] - u[0]; /* joint1.x */
    out[1] = EOM_C0*a[1] - 0.5*t18 - u[1]; /* joint1.gamma */

    return 0;
}

/* The drives u that make the residual zero. */
int one_link_inverse_dynamics(const double *restrict h, const double *restrict q, const double *restrict v,
        const double *restrict a, double *restrict out)
{
    EOM_SIN_COS(1, q[1]);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t10 = a[0] - h[0];
    const double t16 = sine[0]*t10 + h[1]*cosine[0];
    out[1] = EOM_C0*a[1] - 0.5*t16; /* joint1.gamma */
    /* joint1: traces against its tangents, eq. (5) */
    const double t29 = cosine[0]*(cosine[0]*t10 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t16);
    out[0] = t29 + q[0]*h[3]; /* joint1.x */

    return 0;
}

/* Accelerations under the drives u. */
int one_link_forward_dynamics(const double *restrict h, const double *restrict q, const double *restrict v,
        const double *restrict u, double *restrict out)
{
    double pivot[4];
    EOM_SIN_COS(1, q[1]);

    pivot[1] = 1.0;
    pivot[2] = EOM_C0;
    pivot[3] = EOM_C0;
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
    out[0] = t38; /* joint1.x */
    out[1] = 3.0*t27 + t31*t38; /* joint1.gamma */

    return eom_singular(2, pivot);
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
int one_link_coriolis_matrix(const double *restrict h, const double *restrict q, const double *restrict v,
        double *restrict out)
{
    EOM_SIN_COS(1, q[1]);
    (void)h;

    out[0] = 0.0; /* joint1.x, joint1.x */
    out[2] = 0.0; /* joint1.gamma, joint1.x */
    const double t5 = v[0]*cosine[0];
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = cosine[0]*(v[0]*sine[0] - 0.5*v[1]) - sine[0]*t5; /* joint1.x, joint1.gamma */
    out[3] = 0.5*t5 - v[0]*(0.5*cosine[0]); /* joint1.gamma, joint1.gamma */

    return 0;
}

/* Forces that hold the links' weight, loops cut. */
int one_link_gravity(const double *restrict h, const double *restrict q, double *restrict out)
{
    EOM_SIN_COS(1, q[1]);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t10 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = 0.5*t10; /* joint1.gamma */
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = -(cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t10); /* joint1.x */

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
int one_link_energy(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    EOM_SIN_COS(1, q[1]);

    const double t8 = v[0]*cosine[0];
    const double t9 = v[0]*sine[0];
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(EOM_C0*v[1] - 0.5*t9)); /* kinetic */
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*cosine[0]) + h[1]*(0.5*sine[0])); /* potential */

    return 0;
}

/* Joint reaction wrenches: force and moment on child links, joint frames after the motion. */
int one_link_reactions(const double *restrict h, const double *restrict q, const double *restrict v,
        const double *restrict a, double *restrict out)
{
    EOM_SIN_COS(1, q[1]);

    out[2] = h[5]; /* joint1, force z */
    out[3] = 0.0; /* joint1, moment x */
    out[4] = h[6]; /* joint1, moment y */
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t9 = a[0] - h[0];
    const double t15 = sine[0]*t9 + h[1]*cosine[0];
    out[0] = cosine[0]*t9 - h[1]*sine[0] - 0.5*(v[1]*v[1]); /* joint1, force x */
    out[1] = 0.5*a[1] - t15; /* joint1, force y */
    out[5] = EOM_C0*a[1] - 0.5*t15; /* joint1, moment z */

    return 0;
}

/* (M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step. */
static int one_link_implicit_step(const double *restrict h, const double *restrict q, const double *restrict v,
        const double *restrict u, const double *restrict added, const double *restrict dt, double *restrict out)
{
    double pivot[4];
    EOM_SIN_COS(1, q[1]);

    const double t16 = h[3]*dt[1];
    /* joint1: eliminated, from the tips to the base */
    const double t23 = added[1] + EOM_C0;
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
    out[0] = t50; /* joint1.x */
    out[1] = t26 + 0.5*t25*(sine[0]*(t50 - h[0]) + h[1]*cosine[0]); /* joint1.gamma */

    return eom_singular(2, pivot);
}

#include "clib/state_one.h"
#include "clib/kinematics.h"

EOM_PART void one_link_kinematics0(const double *restrict q, const double *restrict sine, const double *restrict cosine,
        int last, double *restrict origins, double *restrict axes, double *restrict kept)
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
static void one_link_run(int run, int last, const double *h, const double *q, const double *sine, const double *cosine,
        double *kept, double *pose, double *origins, double *axes)
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
static void one_link_forward_kinematics(const double *restrict h, const double *restrict q, int frame,
        double *restrict pose, double *restrict origins, double *restrict axes)
{
    int way[2];
    double turning[3][EOM_PADDED(1)];
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
};

#include "clib/integrate.c"

/* One state over many steps. */
long long one_link_rollout(const double *restrict h, const double *restrict q, const double *restrict v,
        const one_link_drive *restrict drive, double dt, size_t steps, size_t every, int method, double *restrict q_out,
        double *restrict v_out)
{
    double state[EOM_STATE_ROOM(2, 0, 7, 0, 6, 4, 0)] EOM_ALIGNED;
    double input[EOM_INPUT_ROOM(2, 1, 0)];
    int index[EOM_INDEX_ROOM(2, 1, 0)];
    const eom_workspace work = { input, index, state };

    return eom_integrate_fixed(&one_link_robot, h, q, v, drive, NULL, 0.0, dt, steps, every, method, q_out, v_out,
            work);
}

#endif
