/* one_link.c: equations of motion of the robot one_link, written by eomgen 0.1.0.
 * What the arrays hold is said in one_link.h.  No heap, no state: every call is re-entrant.
 * Equation numbers are those of the paper "Mathematics Model for 6-DOF Joints Manipulation Robots". */
#include "one_link.h"

#include <math.h>

#if defined(__GNUC__)
#define EOMGEN_PART static __attribute__((noinline))
#else
#define EOMGEN_PART static
#endif

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

/* Mass matrix M(q), eq. (11). */
int one_link_mass_matrix(const double *restrict h, const double *restrict q, double *restrict out)
{
    (void)h;

    out[0] = 1.0;
    out[3] = 0.3333333333333333;
    const double t1 = sin(q[1]);
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = out[2] = -0.5*t1;

    return 0;
}

long long one_link_mass_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_mass_matrix(h, q + i * q_step, out + i * 4);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
int one_link_bias_force(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    (void)h;

    out[1] = 0.0;
    const double t2 = cos(q[1]);
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = t2*(-0.5*(v[1]*v[1]));

    return 0;
}

long long one_link_bias_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_bias_force(h, q + i * q_step, v + i * v_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
int one_link_generalized_force(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    (void)v;

    const double t5 = sin(q[1]);
    const double t6 = cos(q[1]);
    const double t12 = h[0]*t5 - h[1]*t6;
    out[1] = -0.5*t12;
    out[0] = t6*(h[0]*t6 + h[1]*t5) + t5*t12 - q[0]*h[3];

    return 0;
}

long long one_link_generalized_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_generalized_force(h, q + i * q_step, v + i * v_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Q_F of eq. (14), its moment term corrected; base axes. */
int one_link_external_force(const double *restrict h, const double *restrict q, const double *restrict wrench, double *restrict out)
{
    (void)h;

    const double t1 = sin(q[1]);
    const double t2 = cos(q[1]);
    const double t11 = t2*wrench[1] - t1*wrench[0];
    out[1] = wrench[5] + 0.5*t11;
    out[0] = t2*(t2*wrench[0] + t1*wrench[1]) - t1*t11;

    return 0;
}

long long one_link_external_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict wrench, size_t wrench_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_external_force(h, q + i * q_step, wrench + i * wrench_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
int one_link_residual(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, const double *restrict u, double *restrict out)
{
    const double t10 = sin(q[1]);
    const double t11 = cos(q[1]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded */
    const double t12 = a[0] - h[0];
    const double t18 = t10*t12 + h[1]*t11;
    /* joint1: traces against its tangents, eq. (5) */
    const double t33 = t11*(t11*t12 - h[1]*t10 - 0.5*(v[1]*v[1])) - t10*(0.5*a[1] - t18) + q[0]*h[3];
    out[0] = t33 - u[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t18 - u[1];

    return 0;
}

long long one_link_residual_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, const double *restrict u, size_t u_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_residual(h, q + i * q_step, v + i * v_step, a + i * a_step, u + i * u_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* The drives u that make the residual zero. */
int one_link_inverse_dynamics(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    const double t8 = sin(q[1]);
    const double t9 = cos(q[1]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded */
    const double t10 = a[0] - h[0];
    const double t16 = t8*t10 + h[1]*t9;
    /* force and moment of every link: P = K H */
    out[1] = 0.3333333333333333*a[1] - 0.5*t16;
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = t9*(t9*t10 - h[1]*t8 - 0.5*(v[1]*v[1])) - t8*(0.5*a[1] - t16) + q[0]*h[3];

    return 0;
}

long long one_link_inverse_dynamics_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_inverse_dynamics(h, q + i * q_step, v + i * v_step, a + i * a_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Accelerations under the drives u. */
int one_link_forward_dynamics(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, double *restrict out)
{
    double pivot[4];

    pivot[1] = 1.0;
    pivot[2] = pivot[3] = 0.3333333333333333;
    const double t8 = sin(q[1]);
    const double t9 = cos(q[1]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded */
    const double t15 = h[0]*t8 - h[1]*t9;
    /* joint1: traces against its tangents, eq. (5) */
    const double t27 = u[1] - 0.5*t15;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    const double t31 = 1.5*t8;
    const double t34 = 1.0 - 0.5*t8*t31;
    pivot[0] = t34;
    const double t37 = u[0] - (q[0]*h[3] - (t9*(h[0]*t9 + h[1]*t8 + 0.5*(v[1]*v[1])) + t8*t15)) + t27*t31;
    const double t38 = 1.0/t34*t37;
    out[0] = t38;
    out[1] = 3.0*t27 + t31*t38;

    for (int i = 0; i < 2; ++i)
        if (!(pivot[2 * i] > 1e-12 * pivot[2 * i + 1])) return 1 + i;
    return 0;
}

long long one_link_forward_dynamics_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict u, size_t u_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_forward_dynamics(h, q + i * q_step, v + i * v_step, u + i * u_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
int one_link_coriolis_matrix(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    (void)h;

    out[0] = out[2] = 0.0;
    const double t3 = sin(q[1]);
    const double t4 = cos(q[1]);
    const double t5 = v[0]*t4;
    const double t6 = v[0]*t3;
    const double t10 = 0.5*t5;
    const double t12 = 0.3333333333333333*v[1] - 0.5*t6;
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = t4*(t6 - 0.5*v[1]) - t3*t5;
    out[3] = t4*(t4*t10) - t3*(t4*t12) + (t3*(t3*t10) + t4*(t3*t12)) - v[0]*(0.5*t4);

    return 0;
}

long long one_link_coriolis_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_coriolis_matrix(h, q + i * q_step, v + i * v_step, out + i * 4);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Christoffel symbols of the first kind, the tensor C of eq. (12). */
int one_link_christoffel(const double *restrict h, const double *restrict q, double *restrict out)
{
    (void)h;

    out[0] = out[1] = out[2] = out[4] = out[5] = out[6] = out[7] = 0.0;
    const double t1 = cos(q[1]);
    out[3] = -0.5*t1;

    return 0;
}

long long one_link_christoffel_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_christoffel(h, q + i * q_step, out + i * 8);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Frames [R | X], bodies' origins, coordinates' axes; eqs. (1)-(3). */
static int one_link_kinematics(const double *restrict h, const double *restrict q, double *restrict out)
{
    (void)h;

    for (size_t i = 0; i < 45; ++i) out[i] = 0.0;
    out[10] = out[12] = out[17] = out[22] = out[34] = out[39] = out[44] = 1.0;
    out[27] = out[36] = q[0];
    const double t2 = sin(q[1]);
    out[4] = out[7] = out[28] = t2;
    const double t3 = cos(q[1]);
    out[0] = out[5] = out[24] = out[29] = t3;
    out[1] = out[25] = -t2;
    out[3] = q[0] + t3;

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
int one_link_energy(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    const double t6 = sin(q[1]);
    const double t7 = cos(q[1]);
    const double t8 = v[0]*t7;
    const double t9 = v[0]*t6;
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(0.3333333333333333*v[1] - 0.5*t9));
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*t7) + h[1]*(0.5*t6));

    return 0;
}

long long one_link_energy_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_energy(h, q + i * q_step, v + i * v_step, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Force and moment on each joint's child link, moved joint's axes. */
int one_link_reactions(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    out[2] = h[5];
    out[3] = 0.0;
    out[4] = h[6];
    const double t6 = sin(q[1]);
    const double t7 = cos(q[1]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded */
    const double t9 = a[0] - h[0];
    const double t15 = t6*t9 + h[1]*t7;
    /* force and moment of every link: P = K H */
    out[0] = t7*t9 - h[1]*t6 - 0.5*(v[1]*v[1]);
    out[1] = 0.5*a[1] - t15;
    out[5] = 0.3333333333333333*a[1] - 0.5*t15;

    return 0;
}

long long one_link_reactions_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) {
        const int status = one_link_reactions(h, q + i * q_step, v + i * v_step, a + i * a_step, out + i * 6);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

/* Pose of a frame in the base, 4x4; eqs. (1) and (2). */
int one_link_frame_pose(const double *restrict h, const double *restrict q, int frame, double *restrict out)
{
    double k[45];
    one_link_kinematics(h, q, k);
    for (int i = 0; i < 12; ++i) out[i] = k[12 * frame + i];
    out[12] = out[13] = out[14] = 0.0;
    out[15] = 1.0;
    return 0;
}

/* Linear velocity of a frame's origin (rows 0 to 2) and angular velocity (rows 3 to 5) per coordinate, base axes. */
int one_link_frame_jacobian(const double *restrict h, const double *restrict q, int frame, double *restrict out)
{
    static const int body_of[3] = { 0, -1, 0 };
    static const int parent[1] = { -1 };
    static const int first[1] = { 0 };
    static const int count[1] = { 2 };
    static const int is_rotation[2] = { 0, 1 };
    double k[45];
    one_link_kinematics(h, q, k);
    for (int i = 0; i < 12; ++i) out[i] = 0.0;
    for (int body = body_of[frame]; body >= 0; body = parent[body]) {
        const double *origin = k + 36 + 3 * body;
        const double arm[3] = { k[12 * frame + 3] - origin[0], k[12 * frame + 7] - origin[1], k[12 * frame + 11] - origin[2] };
        for (int s = first[body]; s < first[body] + count[body]; ++s) {
            const double *axis = k + 39 + 3 * s;
            if (is_rotation[s]) {
                out[s] = axis[1] * arm[2] - axis[2] * arm[1];
                out[2 + s] = axis[2] * arm[0] - axis[0] * arm[2];
                out[4 + s] = axis[0] * arm[1] - axis[1] * arm[0];
                for (int i = 0; i < 3; ++i) out[(3 + i) * 2 + s] = axis[i];
            } else {
                for (int i = 0; i < 3; ++i) out[i * 2 + s] = axis[i];
            }
        }
    }
    return 0;
}

long long one_link_frame_pose_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, int frame, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) one_link_frame_pose(h, q + i * q_step, frame, out + i * 16);
    return -1;
}

long long one_link_frame_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, int frame, double *restrict out)
{
    for (size_t i = 0; i < count; ++i) one_link_frame_jacobian(h, q + i * q_step, frame, out + i * 12);
    return -1;
}
