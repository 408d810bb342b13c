/* one_link.h: equations of motion of the robot one_link.
 *
 * Written by eomgen 0.1.0 in float64; this code belongs to whoever generated it.
 * Numbers are SI units and radians; matrices are stored by rows.
 *
 * Operations          mul    add    div  sincos
 *   mass_matrix           1      0      0      1
 *   bias_force            3      0      0      1
 *   generalized_force     8      4      0      1
 *   external_force        7      4      0      1
 *   residual             12     10      0      1
 *   inverse_dynamics     12      8      0      1
 *   forward_dynamics     17     10      1      1
 *   coriolis_matrix       8      3      0      1
 *   kinematics            0      2      0      1
 *   gravity               7      4      0      1
 *   energy               15      7      0      1
 *   reactions             9      6      0      1
 *   rollout              22     15      2      1
 *   parameters            2      1      0      0
 *
 * SymPy 1.14.0 derived A_(i-1)i of eq. (3) and its first and second derivatives for joints with the active
 * coordinates (x gamma), and proved which terms tr(dA/ds H dA^T) of M and tr(dA/ds H d2A^T) of C vanish:
 * M, eq. (11), entries s <= v: 3
 *           3  survive
 * C, eq. (12), entries v <= w: 6
 *           2  lemma (7): the second derivative by two translations vanishes
 *           2  sharper lemma: nothing at or after a joint turns its translations
 *           1  antisymmetry: C_i,jk = -C_k,ij for j <= min(i, k), so C_i,ji = 0
 *           1  survive
 *           1  of them independent up to sign by the antisymmetry
 *           1  when coaxial pairs of two joints are exchanged as well
 */
#ifndef EOMGEN_ONE_LINK_H
#define EOMGEN_ONE_LINK_H

#include <stddef.h>

#include "clib/eom.h"

#define ONE_LINK_DOF 2
#define ONE_LINK_LINKS 1
#define ONE_LINK_FRAMES 3
#define ONE_LINK_PARAMETERS 4
#define ONE_LINK_HOISTED 7
#define ONE_LINK_STATUSES 2 /* but ONE_LINK_OK */

/* Coordinates, in the order of q. */
enum {
    ONE_LINK_COORDINATE_joint1_x = 0, /* joint1.x */
    ONE_LINK_COORDINATE_joint1_gamma = 1 /* joint1.gamma */
};

/* Joints, in the order of reactions. */
enum {
    ONE_LINK_JOINT_joint1 = 0 /* joint1 */
};

/* Links, in the order of wrench. */
enum {
    ONE_LINK_LINK_link1 = 0 /* link1 */
};

/* Frames, by number. */
enum {
    ONE_LINK_FRAME_tcp = 0, /* tcp */
    ONE_LINK_FRAME_base = 1, /* base */
    ONE_LINK_FRAME_link1 = 2 /* link1 */
};

/* Run-time parameters, in the order of p. */
enum {
    ONE_LINK_PARAMETER_gravity_x = 0, /* gravity.x */
    ONE_LINK_PARAMETER_gravity_y = 1, /* gravity.y */
    ONE_LINK_PARAMETER_gravity_z = 2, /* gravity.z */
    ONE_LINK_PARAMETER_joints_joint1_x_stiffness = 3 /* joints.joint1.x.stiffness */
};

/* Parameters at the description's values: double p[] = ONE_LINK_DEFAULTS; */
#define ONE_LINK_DEFAULTS { \
    0.0, /* gravity.x */ \
    -9.81, /* gravity.y */ \
    0.0, /* gravity.z */ \
    10000.0 /* joints.joint1.x.stiffness */ \
}

/* Status of a kernel in a state: a reason, to which the number of a coordinate is added. */
enum {
    ONE_LINK_OK = 0,
    ONE_LINK_SINGULAR = 1 /* the mass matrix cannot be inverted at the coordinate */
};

#ifdef __cplusplus
extern "C" {
#endif

/* Reason of a status. */
static inline int one_link_status_reason(int status)
{
    return (status >= ONE_LINK_SINGULAR) ? ONE_LINK_SINGULAR : ONE_LINK_OK;
}

/* Number of the coordinate of a status; 0 of ONE_LINK_OK. */
static inline int one_link_status_index(int status)
{
    return status - one_link_status_reason(status);
}

/* What a status means, in words that name the coordinate. */
const char *one_link_status_text(int status);

/* Every kernel returns a status.  h is what one_link_setup makes of the parameters p; all arrays are the caller's, and
 * out overlaps no other.
 * A batch takes count states that lie step numbers apart (0: the same for all) and returns -1, or
 * state * ONE_LINK_STATUSES + i of the first failure; what out
 * holds of states behind it is left open. */

/* A rollout takes steps of length dt by the classical Runge-Kutta method (method 0) or linearly implicit ones (1), and
 * stores q and v of the beginning and of every so many steps.  Drives, held over a step, are u + kp (target - q) - kd
 * v;
 * those of state i at step k lie at i * u_state + k * u_step.  kp, kd (not 0 at principal coordinates alone) and target
 * may be NULL together.  effort: NULL, or 2 greatest sizes, at which drives are clipped, infinite where there is none.
 * It returns -1, or (state * steps + step) * ONE_LINK_STATUSES + i of the first failure. */

void one_link_setup(const double *p, double *h);
int one_link_mass_matrix(const double *h, const double *q, double *out);
long long one_link_mass_matrix_batch(size_t count, const double *h, const double *q, size_t q_step, double *out);
int one_link_bias_force(const double *h, const double *q, const double *v, double *out);
long long one_link_bias_force_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v,
        size_t v_step, double *out);
int one_link_generalized_force(const double *h, const double *q, const double *v, double *out);
long long one_link_generalized_force_batch(size_t count, const double *h, const double *q, size_t q_step,
        const double *v, size_t v_step, double *out);
int one_link_external_force(const double *h, const double *q, const double *wrench, double *out);
long long one_link_external_force_batch(size_t count, const double *h, const double *q, size_t q_step,
        const double *wrench, size_t wrench_step, double *out);
int one_link_residual(const double *h, const double *q, const double *v, const double *a, const double *u, double *out);
long long one_link_residual_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v,
        size_t v_step, const double *a, size_t a_step, const double *u, size_t u_step, double *out);
int one_link_inverse_dynamics(const double *h, const double *q, const double *v, const double *a, double *out);
long long one_link_inverse_dynamics_batch(size_t count, const double *h, const double *q, size_t q_step,
        const double *v, size_t v_step, const double *a, size_t a_step, double *out);
int one_link_forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *out);
long long one_link_forward_dynamics_batch(size_t count, const double *h, const double *q, size_t q_step,
        const double *v, size_t v_step, const double *u, size_t u_step, double *out);
int one_link_coriolis_matrix(const double *h, const double *q, const double *v, double *out);
long long one_link_coriolis_matrix_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v,
        size_t v_step, double *out);
int one_link_gravity(const double *h, const double *q, double *out);
long long one_link_gravity_batch(size_t count, const double *h, const double *q, size_t q_step, double *out);
int one_link_energy(const double *h, const double *q, const double *v, double *out);
long long one_link_energy_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v,
        size_t v_step, double *out);
int one_link_reactions(const double *h, const double *q, const double *v, const double *a, double *out);
long long one_link_reactions_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v,
        size_t v_step, const double *a, size_t a_step, double *out);
int one_link_frame_pose(const double *h, const double *q, int frame, double *out);
int one_link_frame_jacobian(const double *h, const double *q, int frame, double *out);
long long one_link_frame_pose_batch(size_t count, const double *h, const double *q, size_t q_step, int frame,
        double *out);
long long one_link_frame_jacobian_batch(size_t count, const double *h, const double *q, size_t q_step, int frame,
        double *out);
typedef eom_drive one_link_drive;
long long one_link_rollout(const double *h, const double *q, const double *v, const one_link_drive *drive, double dt,
        size_t steps, size_t every, int method, double *q_out, double *v_out);
long long one_link_rollout_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v,
        size_t v_step, const one_link_drive *drive, double dt, size_t steps, size_t every, int method, double *q_out,
        double *v_out);

#ifdef __cplusplus
}
#endif

#endif
