/* robot_lanes.h: a robot whose equations take a state in every lane of a vector, and functions that integrate many
 * states of it; included behind the types of lanes.h. */
#ifndef EOM_ROBOT_LANES_H
#define EOM_ROBOT_LANES_H
#include "eom.h"

#include "lanes.h"

/* Equations of a state in every lane. */
typedef struct {
    const EOM(sizes) *sizes;
    EOM_EQUATIONS(lanes);
} EOM(robot_lanes);

/* Room for numbers of all lanes. */
typedef struct {
    double *input;
    int *index;
    lanes *state;
} EOM(workspace_lanes);

#if !defined(EOM_RATES)
/* Integrate count states as integrate_fixed does, EOM_LANES at a time; what one of them does changes no bit of another.
 * -1, or (state * steps + step) * statuses + i of the first failure. */
long long EOM_WIDE(integrate_fixed_batch)(const EOM(robot_lanes) *robot, size_t count, const EOM_SCALAR *h,
        const EOM_SCALAR *q, size_t q_step, const EOM_SCALAR *v, size_t v_step, const EOM(drive) *drive, EOM_SCALAR dt,
        size_t steps, size_t every, int method, EOM_SCALAR *q_out, EOM_SCALAR *v_out, EOM(workspace_lanes) work);
#endif

#if !defined(EOM_RATES) || defined(EOM_LINKED)
/* Integrate count states as integrate_adaptive does, each by steps of its length, those at place, or the first ones. */
void EOM_WIDE(integrate_adaptive_batch)(const EOM(robot_lanes) *robot, size_t count, const size_t *place,
        const EOM_SCALAR *h, size_t h_step, const EOM(drive) *drive, const EOM(inputs) *inputs, size_t inputs_step,
        const EOM(tolerance) *allowed, size_t allowed_step, const double *times, size_t samples, int method,
        EOM_SCALAR *q, EOM_SCALAR *v, EOM_SCALAR *q_out, EOM_SCALAR *v_out, eom_progress *progress,
        EOM(workspace_lanes) work);
#endif

#endif
