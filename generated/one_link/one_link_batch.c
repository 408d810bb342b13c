/* one_link_batch.c: several states at a time: the statements of one_link.c on vectors, a state in every lane.
 * Written by eomgen 0.1.0.  What the arrays hold is said in one_link.h. */

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

/* Mass matrix M(q), eq. (11). */
static int one_link_mass_matrix_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);
    (void)h;

    out[0] = EOM_ALL_LANES(1.0);
    out[3] = EOM_ALL_LANES(EOM_C0);
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = -0.5*sine[0];
    out[2] = out[1];

    return 0;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
static int one_link_bias_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);
    (void)h;

    out[1] = EOM_ALL_LANES(0.0);
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = cosine[0]*(-0.5*(v[1]*v[1]));

    return 0;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
static int one_link_generalized_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);
    (void)v;

    const lanes t12 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = -0.5*t12;
    out[0] = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t12 - q[0]*h[3];

    return 0;
}

/* Q_F of eq. (14), its moment term corrected; base frame. */
static int one_link_external_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict wrench,
        lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);
    (void)h;

    const lanes t11 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[1] = wrench[5] + 0.5*t11;
    out[0] = cosine[0]*(cosine[0]*wrench[0] + sine[0]*wrench[1]) - sine[0]*t11;

    return 0;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
static int one_link_residual_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        const lanes *restrict a, const lanes *restrict u, lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t12 = a[0] - h[0];
    const lanes t18 = sine[0]*t12 + h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t31 = cosine[0]*(cosine[0]*t12 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t18);
    out[0] = t31 + q[0]*h[3] - u[0];
    out[1] = EOM_C0*a[1] - 0.5*t18 - u[1];

    return 0;
}

/* The drives u that make the residual zero. */
static int one_link_inverse_dynamics_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        const lanes *restrict a, lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t10 = a[0] - h[0];
    const lanes t16 = sine[0]*t10 + h[1]*cosine[0];
    out[1] = EOM_C0*a[1] - 0.5*t16;
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t29 = cosine[0]*(cosine[0]*t10 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t16);
    out[0] = t29 + q[0]*h[3];

    return 0;
}

/* Accelerations under the drives u. */
static int one_link_forward_dynamics_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        const lanes *restrict u, lanes *restrict out)
{
    lanes pivot[4];
    EOM_SIN_COS_AT(1, q + 1);

    pivot[1] = EOM_ALL_LANES(1.0);
    pivot[2] = EOM_ALL_LANES(EOM_C0);
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

    return eom_singular_lanes(2, 2, pivot);
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
static int one_link_coriolis_matrix_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);
    (void)h;

    out[0] = EOM_ALL_LANES(0.0);
    out[2] = out[0];
    const lanes t5 = v[0]*cosine[0];
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = cosine[0]*(v[0]*sine[0] - 0.5*v[1]) - sine[0]*t5;
    out[3] = 0.5*t5 - v[0]*(0.5*cosine[0]);

    return 0;
}

/* Forces that hold the links' weight, loops cut. */
static int one_link_gravity_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t10 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = 0.5*t10;
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = -(cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t10);

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
static int one_link_energy_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);

    const lanes t8 = v[0]*cosine[0];
    const lanes t9 = v[0]*sine[0];
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(EOM_C0*v[1] - 0.5*t9));
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*cosine[0]) + h[1]*(0.5*sine[0]));

    return 0;
}

/* Joint reaction wrenches: force and moment on child links, joint frames after the motion. */
static int one_link_reactions_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        const lanes *restrict a, lanes *restrict out)
{
    EOM_SIN_COS_AT(1, q + 1);

    out[2] = EOM_ALL_LANES(h[5]);
    out[3] = EOM_ALL_LANES(0.0);
    out[4] = EOM_ALL_LANES(h[6]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t9 = a[0] - h[0];
    const lanes t15 = sine[0]*t9 + h[1]*cosine[0];
    out[0] = cosine[0]*t9 - h[1]*sine[0] - 0.5*(v[1]*v[1]);
    out[1] = 0.5*a[1] - t15;
    out[5] = EOM_C0*a[1] - 0.5*t15;

    return 0;
}

/* (M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step. */
static int one_link_implicit_step_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v,
        const lanes *restrict u, const lanes *restrict added, const lanes *restrict dt, lanes *restrict out)
{
    lanes pivot[4];
    EOM_SIN_COS_AT(1, q + 1);

    const lanes t16 = h[3]*dt[1];
    /* joint1: eliminated, from the tips to the base */
    const lanes t23 = added[1] + EOM_C0;
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

    return eom_singular_lanes(2, 2, pivot);
}

#include "clib/state_lanes.h"
#include "clib/kinematics.h"

long long one_link_mass_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_ROOM_LANES(4, 1), EOM_ONE_VECTOR(2,
            one_link_mass_matrix_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(out, 4))), EOM_WRITE_LANES(4))
}

long long one_link_bias_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        const double *restrict v, size_t v_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_ROOM_LANES(2, 1), EOM_ONE_VECTOR(2,
            one_link_bias_force_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(out, 2))),
            EOM_WRITE_LANES(2))
}

long long one_link_generalized_force_batch(size_t count, const double *restrict h, const double *restrict q,
        size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_ROOM_LANES(2, 1), EOM_ONE_VECTOR(2,
            one_link_generalized_force_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(out, 2))),
            EOM_WRITE_LANES(2))
}

long long one_link_external_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        const double *restrict wrench, size_t wrench_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(wrench, 6, 1) EOM_ROOM_LANES(2, 1), EOM_ONE_VECTOR(2,
            one_link_external_force_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(wrench, 6), EOM_VECTOR(out, 2))),
            EOM_WRITE_LANES(2))
}

long long one_link_residual_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, const double *restrict u,
        size_t u_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_READ_LANES(a, 2, 1) EOM_READ_LANES(u, 2,
            1) EOM_ROOM_LANES(2, 1), EOM_ONE_VECTOR(2, one_link_residual_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v,
            2), EOM_VECTOR(a, 2), EOM_VECTOR(u, 2), EOM_VECTOR(out, 2))), EOM_WRITE_LANES(2))
}

long long one_link_inverse_dynamics_batch(size_t count, const double *restrict h, const double *restrict q,
        size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step,
        double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_READ_LANES(a, 2, 1) EOM_ROOM_LANES(2, 1),
            EOM_ONE_VECTOR(2, one_link_inverse_dynamics_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(a,
            2), EOM_VECTOR(out, 2))), EOM_WRITE_LANES(2))
}

long long one_link_forward_dynamics_batch(size_t count, const double *restrict h, const double *restrict q,
        size_t q_step, const double *restrict v, size_t v_step, const double *restrict u, size_t u_step,
        double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_READ_LANES(u, 2, 1) EOM_ROOM_LANES(2, 1),
            EOM_ONE_VECTOR(2, one_link_forward_dynamics_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(u,
            2), EOM_VECTOR(out, 2))), EOM_WRITE_LANES(2))
}

long long one_link_coriolis_matrix_batch(size_t count, const double *restrict h, const double *restrict q,
        size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_ROOM_LANES(4, 1), EOM_ONE_VECTOR(2,
            one_link_coriolis_matrix_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(out, 4))),
            EOM_WRITE_LANES(4))
}

long long one_link_gravity_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_ROOM_LANES(2, 1), EOM_ONE_VECTOR(2, one_link_gravity_lanes(h_lanes,
            EOM_VECTOR(q, 2), EOM_VECTOR(out, 2))), EOM_WRITE_LANES(2))
}

long long one_link_energy_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        const double *restrict v, size_t v_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_ROOM_LANES(2, 1), EOM_ONE_VECTOR(2,
            one_link_energy_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(out, 2))), EOM_WRITE_LANES(2))
}

long long one_link_reactions_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    EOM_SPREAD(h, 7)
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_READ_LANES(v, 2, 1) EOM_READ_LANES(a, 2, 1) EOM_ROOM_LANES(6, 1),
            EOM_ONE_VECTOR(2, one_link_reactions_lanes(h_lanes, EOM_VECTOR(q, 2), EOM_VECTOR(v, 2), EOM_VECTOR(a, 2),
            EOM_VECTOR(out, 6))), EOM_WRITE_LANES(6))
}

EOM_PART void one_link_kinematics0_lanes(const lanes *restrict q, const lanes *restrict sine,
        const lanes *restrict cosine, int last, lanes *restrict origins, lanes *restrict axes, lanes *restrict kept)
{
    origins[0] = q[0];
    origins[1] = EOM_ALL_LANES(0.0);
    origins[2] = origins[1];
    axes[1] = origins[1];
    axes[2] = origins[1];
    axes[3] = origins[1];
    axes[4] = origins[1];
    axes[0] = EOM_ALL_LANES(1.0);
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
    pose[2] = EOM_ALL_LANES(0.0);
    pose[6] = pose[2];
    pose[8] = pose[2];
    pose[9] = pose[2];
    pose[11] = pose[2];
    pose[4] = given[2];
    pose[7] = pose[4];
    pose[10] = EOM_ALL_LANES(1.0);
    pose[3] = q[0] + given[0];
}

EOM_PART void one_link_kinematics2_lanes(lanes *restrict pose)
{
    pose[0] = EOM_ALL_LANES(1.0);
    pose[5] = pose[0];
    pose[10] = pose[0];
    pose[1] = EOM_ALL_LANES(0.0);
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
    pose[2] = EOM_ALL_LANES(0.0);
    pose[6] = pose[2];
    pose[7] = pose[2];
    pose[8] = pose[2];
    pose[9] = pose[2];
    pose[11] = pose[2];
    pose[3] = q[0];
    pose[4] = given[2];
    pose[10] = EOM_ALL_LANES(1.0);
}

/* A run of bodies up to the last one that is wanted, or a frame. */
static void one_link_run_lanes(int run, int last, const double *h, const lanes *q, const lanes *sine,
        const lanes *cosine, lanes *kept, lanes *pose, lanes *origins, lanes *axes)
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
static void one_link_forward_kinematics_lanes(const double *restrict h, const lanes *restrict q, int frame,
        lanes *restrict pose, lanes *restrict origins, lanes *restrict axes)
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
static int one_link_frame_jacobian_lanes(const double *restrict h, const lanes *restrict q, int frame,
        lanes *restrict out)
{
    lanes pose[12];
    lanes origins[3];
    lanes axes[6];
    one_link_forward_kinematics_lanes(h, q, frame, pose, origins, axes);
    eom_frame_jacobian_lanes(frame, pose, origins, axes, out);
    return 0;
}

long long one_link_frame_pose_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        int frame, double *restrict out)
{
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_ROOM_LANES(16, 1), EOM_ONE_VECTOR(2, one_link_frame_pose_lanes(h,
            EOM_VECTOR(q, 2), frame, EOM_VECTOR(out, 16))), EOM_WRITE_LANES(16))
}

long long one_link_frame_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        int frame, double *restrict out)
{
    EOM_BY_LANES(2, 1, EOM_READ_LANES(q, 2, 1) EOM_ROOM_LANES(12, 1), EOM_ONE_VECTOR(2, one_link_frame_jacobian_lanes(h,
            EOM_VECTOR(q, 2), frame, EOM_VECTOR(out, 12))), EOM_WRITE_LANES(12))
}

#include "clib/robot_lanes.h"
#include "clib/integrate_lanes.c"

static const eom_robot_lanes one_link_robot_lanes = {
    .sizes = &one_link_sizes,
    .forward_dynamics = one_link_forward_dynamics_lanes,
    .implicit_step = one_link_implicit_step_lanes,
};

/* Several states over many steps; -1, or (state * steps + step) * 2 + i of the first failure. */
long long one_link_rollout_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step,
        const double *restrict v, size_t v_step, const one_link_drive *restrict drive, double dt, size_t steps,
        size_t every, int method, double *restrict q_out, double *restrict v_out)
{
    lanes state[EOM_STATE_ROOM(2, 0, 7, 0, 6, 4, 0)];
    double input[EOM_INPUT_ROOM(2, EOM_LANES, 0)];
    int index[EOM_INDEX_ROOM(2, EOM_LANES, 0)];
    const eom_workspace_lanes work = { input, index, state };

    return EOM_WIDE(integrate_fixed_batch)(&one_link_robot_lanes, count, h, q, q_step, v, v_step, drive, dt, steps,
            every, method, q_out, v_out, work);
}
