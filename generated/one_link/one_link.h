/* one_link.h: equations of motion of the robot one_link.
 *
 * Written by eomgen 0.1.0 in float64; this code belongs to whoever generated it.
 * Numbers are SI units and radians; matrices are stored by rows.
 *
 * Coordinates, in the order of q:
 *     0  joint1.x
 *     1  joint1.gamma
 *
 * Run-time parameters, in the order of p:
 *     0  gravity.x
 *     1  gravity.y
 *     2  gravity.z
 *     3  joints.joint1.x.stiffness
 *
 * Links, in the order of wrench:
 *     0  link1
 *
 * Frames, by number:
 *     0  tcp
 *     1  base
 *     2  link1
 *
 * Operations          mul    add    div  sincos
 *   mass_matrix           1      0      0      1
 *   bias_force            3      0      0      1
 *   generalized_force     8      4      0      1
 *   external_force        7      4      0      1
 *   residual             12     10      0      1
 *   inverse_dynamics     12      8      0      1
 *   forward_dynamics     17     10      1      1
 *   residual_jacobian    21     12      0      1
 *   forward_dynamics_jacobian    45     28      1      1
 *   coriolis_matrix       8      3      0      1
 *   christoffel           1      0      0      1
 *   kinematics            0      2      0      1
 *   energy               15      7      0      1
 *   reactions             9      6      0      1
 *   external_reactions    10     11      0      1
 *   regressor            11      9      0      1
 *   euler_cosines         0      0      0      0
 *   rollout              22     15      2      1
 *   adaptive_rollout     36     23      3      2
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

#ifdef __cplusplus
extern "C" {
#endif

/* Every kernel returns 0, or 1 + i where the mass matrix cannot be inverted at coordinate i.
 * h is what one_link_setup makes of the parameters p; all arrays are the caller's, and out overlaps no other.
 * A batch takes count states that lie step numbers apart (0: the same for all) and returns -1, or
 * state * ONE_LINK_DOF + i of the first failure; what out
 * holds of states behind it is left open. */

/* A rollout takes steps of length dt by the classical Runge-Kutta method (method 0) or linearly implicit ones (1), and
 * stores q and v of the beginning and of every so many steps.  Drives, held over a step, are u + kp (target - q) - kd v;
 * those of state i at step k lie at i * u_state + k * u_step.  kp, kd (not 0 at principal coordinates alone) and target
 * may be NULL together.  effort: NULL, or 2 greatest sizes, at which drives are clipped, infinite where there is none.
 * It returns -1, or (state * steps + step) * ONE_LINK_DOF + i of the first failure. */

/* An adaptive rollout goes from sample to sample, at samples + 1 times, by steps whose error is at most atol + rtol times
 * the size of each number (atol: 4 of them, of q, then of v): a Rosenbrock method (method 0) or an explicit one (1).
 * Drives, held from a sample to the next, are u + kp (target - q) - kd v; those of state i from sample k on lie at
 * i * u_state + k * u_step; kp, kd (not 0 at principal coordinates alone) and target may be NULL together, and effort, at which drives
 * are clipped, infinite where they are not, alone (with loads theirs counts, and wrenches are not clipped).  q, v and progress, all
 * zeros at the beginning, are where it goes on: a call takes most steps of a state at most, and one that records its steps
 * no more than there is room for.  progress->reason is 0 until it has ended: 1 at the last sample, 2 + i where no step is
 * short enough for number i of the state, 6 + i where the mass matrix cannot be inverted at coordinate i.
 * Of several states those at place go on, or the first ones without; parameters, loads and tolerances of state i lie at
 * i * h_step, i * loads_step and i * allowed_step, and with a step of 0 are the same for all.
 * Loads, or NULL, act beside the drives and follow time itself, between first and last:
 * - a signal is polynomials of t - knot[k] between knot[k] and knot[k + 1], coefficient (pieces, degree + 1, columns), and
 *   rests outside; with a profile, of one column, that column stands in the place of t.  Column i of a track is of the
 *   coordinate place[i].
 * - torque: forces.  control: kp (program - q / ratio) + kd (its rate - v / ratio), over the ratio.
 * - model: a rigid robot of so many coordinates, at place, behind gears.  Its inverse dynamics (in double precision) at
 *   the program's accelerations, with errors that die out by the bandwidth; column: of the program that drives it, or -1;
 *   given: which of the prescribed motions it follows, or -1.  If it holds, its inverse dynamics at rest.  Several states ask
 *   the same of many at a time, with batch_h, if that is not NULL and all of them know one model.
 * - given: motions of prescribed coordinates, whose q and v are put in place, and whose accelerations are u: waves (size, 4),
 *   amplitude, angular frequency, phase and offset, and the signals of ``count`` tracks, whose places are among them.
 * - wrench: on the centre of mass of a link, force and moment from t0 on until t1, in the base frame, or in a frame's axes if
 *   it turns, and the arm of the force in that frame's axes if that is not zero (then frame counts).  external_force takes
 *   force_h, or if that is NULL the h of the rollout.
 * - work: NULL, or with it works are integrated, J: of the drives, of what moves prescribed coordinates, of wrenches, and
 *   what dampers and friction take; progress->work has them, and progress->works those at all samples, (samples + 1, 4),
 *   where it is not NULL.  generalized_force is this robot's, and needed its inverse_dynamics (NULL if nothing is
 *   prescribed).  Steps and states have the same bits.  It is the same for all states, or NULL for all.
 * one_link_loaded gives drives (and prescribed accelerations) at times, and puts prescribed motions into q and v. */

void one_link_setup(const double *p, double *h);
int one_link_mass_matrix(const double *h, const double *q, double *out);
long long one_link_mass_matrix_batch(size_t count, const double *h, const double *q, size_t q_step, double *out);
int one_link_bias_force(const double *h, const double *q, const double *v, double *out);
long long one_link_bias_force_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, double *out);
int one_link_generalized_force(const double *h, const double *q, const double *v, double *out);
long long one_link_generalized_force_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, double *out);
int one_link_external_force(const double *h, const double *q, const double *wrench, double *out);
long long one_link_external_force_batch(size_t count, const double *h, const double *q, size_t q_step, const double *wrench, size_t wrench_step, double *out);
int one_link_residual(const double *h, const double *q, const double *v, const double *a, const double *u, double *out);
long long one_link_residual_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *a, size_t a_step, const double *u, size_t u_step, double *out);
int one_link_inverse_dynamics(const double *h, const double *q, const double *v, const double *a, double *out);
long long one_link_inverse_dynamics_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *a, size_t a_step, double *out);
int one_link_forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *out);
long long one_link_forward_dynamics_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *u, size_t u_step, double *out);
int one_link_residual_jacobian(const double *h, const double *q, const double *v, const double *a, double *out);
long long one_link_residual_jacobian_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *a, size_t a_step, double *out);
int one_link_forward_dynamics_jacobian(const double *h, const double *q, const double *v, const double *u, double *out);
long long one_link_forward_dynamics_jacobian_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *u, size_t u_step, double *out);
int one_link_coriolis_matrix(const double *h, const double *q, const double *v, double *out);
long long one_link_coriolis_matrix_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, double *out);
int one_link_christoffel(const double *h, const double *q, double *out);
long long one_link_christoffel_batch(size_t count, const double *h, const double *q, size_t q_step, double *out);
int one_link_energy(const double *h, const double *q, const double *v, double *out);
long long one_link_energy_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, double *out);
int one_link_reactions(const double *h, const double *q, const double *v, const double *a, double *out);
long long one_link_reactions_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *a, size_t a_step, double *out);
int one_link_external_reactions(const double *h, const double *q, const double *wrench, double *out);
long long one_link_external_reactions_batch(size_t count, const double *h, const double *q, size_t q_step, const double *wrench, size_t wrench_step, double *out);
int one_link_regressor(const double *h, const double *q, const double *v, const double *a, double *out);
long long one_link_regressor_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const double *a, size_t a_step, double *out);
int one_link_euler_cosines(const double *h, const double *q, double *out);
long long one_link_euler_cosines_batch(size_t count, const double *h, const double *q, size_t q_step, double *out);
int one_link_frame_pose(const double *h, const double *q, int frame, double *out);
int one_link_frame_jacobian(const double *h, const double *q, int frame, double *out);
long long one_link_frame_pose_batch(size_t count, const double *h, const double *q, size_t q_step, int frame, double *out);
long long one_link_frame_jacobian_batch(size_t count, const double *h, const double *q, size_t q_step, int frame, double *out);
typedef eom_drive one_link_drive;
typedef eom_spline one_link_signal;
typedef eom_track one_link_track;
typedef eom_tracking one_link_control;
typedef eom_computed_torque one_link_model;
typedef eom_prescribed one_link_given;
typedef eom_wrench one_link_wrench;
typedef eom_energy_balance one_link_work;
typedef eom_inputs one_link_loads;
long long one_link_rollout(const double *h, const double *q, const double *v, const one_link_drive *drive, double dt, size_t steps, size_t every, int method, double *q_out, double *v_out);
long long one_link_rollout_batch(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const one_link_drive *drive, double dt, size_t steps, size_t every, int method, double *q_out, double *v_out);
typedef eom_tolerance one_link_tolerance;
typedef eom_progress one_link_progress;
typedef eom_record one_link_record;
int one_link_adaptive_rollout(const double *h, const one_link_drive *drive, const one_link_loads *loads, const one_link_tolerance *allowed, const double *times, size_t samples, int method, double *q, double *v, double *q_out, double *v_out, one_link_progress *progress, one_link_record *record);
void one_link_loaded(size_t count, const one_link_loads *loads, const double *times, double *q, double *v, double *u);
void one_link_adaptive_rollout_batch(size_t count, const size_t *place, const double *h, size_t h_step, const one_link_drive *drive, const one_link_loads *loads, size_t loads_step, const one_link_tolerance *allowed, size_t allowed_step, const double *times, size_t samples, int method, double *q, double *v, double *q_out, double *v_out, one_link_progress *progress);

#ifdef __cplusplus
}
#endif

#endif
