/* sensitivities.h: derivatives of motions over many steps, backwards and forwards; of one state.  A robot's file that names its
 * table, EOM_DERIVATIVES, may hand over NULL for it: then no address of an equation is taken, and compilers may inline it. */

#include "interval_forces.h"
#include "input_sensitivities.h"
#include "step_sensitivities.h"
#include "rosenbrock_sensitivities.h"

/* How many numbers are kept of a step. */
EOM_LOCAL size_t EOM(kept_of_step)(const EOM(sizes) *restrict sizes, int method)
{
    (void)sizes;
    return (size_t)EOM_KEPT_NUMBERS(EOM_RATES_OF(sizes), EOM_M_OF(sizes), method);
}

/* Take a step, in front of assembly; kept becomes what is kept of it. */
EOM_LOCAL int EOM(step_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    int status = 0;
    if (interval->method % EOM_KINDS == EOM_ROSENBROCK) {
        status = EOM(rosenbrock_forward)(interval, q, v, kept, q_end, v_end, work);
    } else if (interval->method % EOM_KINDS == EOM_IMPLICIT_EULER) {
        status = EOM(implicit_forward)(interval, q, v, kept, q_end, v_end, work);
    } else {
        status = EOM(explicit_forward)(interval, q, v, kept, q_end, v_end, work);
    }
    return status;
}

/* What the failure of a step says of all steps. */
EOM_LOCAL long long EOM(failure_of_step)(const EOM(sizes) *restrict sizes, size_t step, int status)
{
    const int statuses = EOM_POSITIONS_OF(sizes) + ((EOM_M_OF(sizes) > 0) ? (3 * EOM_M_OF(sizes) + EOM_POSITIONS_OF(sizes)) : 0);
    (void)sizes;
    return (long long)step * statuses + status - 1;
}

EOM_PUBLIC long long EOM(rollout_states)(const EOM(robot_derivatives) *restrict derivatives, const EOM_SCALAR *restrict h, const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, const EOM(step_sequence) *restrict steps, EOM_SCALAR *restrict q, EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM(workspace) work)
{
    const EOM(sizes) *const sizes = EOM_KNOWN(derivatives)->robot->sizes;
    const size_t nq = (size_t)EOM_POSITIONS_OF(sizes);
    const size_t nv = (size_t)EOM_RATES_OF(sizes);
    const size_t size = EOM(kept_of_step)(sizes, steps->method);
    EOM_SCALAR *const stages_here = &work.state[EOM(forces_room)(derivatives)];
    EOM_SCALAR *const rest = &stages_here[size];
    for (size_t k = 0; k < steps->count; ++k) {
        EOM_SCALAR *const q_end = &q[(k + 1U) * nq];
        EOM_SCALAR *const v_end = &v[(k + 1U) * nv];
        const EOM(interval) interval = EOM(interval_of)(derivatives, h, drive, inputs, steps, k, work);
        const int status = EOM(step_forward)(&interval, &q[k * nq], &v[k * nv], (kept == NULL) ? stages_here : &kept[k * size], q_end, v_end, rest);
        if (status != 0) { return EOM(failure_of_step)(sizes, k, status); }
        EOM(prescribe)(&interval, eom_instant_of(interval.end), q_end, v_end);
        if (EOM_M_OF(sizes) > 0) {
            const int opened = EOM(assemble)(EOM_KNOWN(derivatives)->robot, h, q_end, v_end, rest, NULL);
            if (opened != 0) { return EOM(failure_of_step)(sizes, k, opened); }
        }
    }
    return -1;
}

EOM_PUBLIC void EOM(rollout_gradient)(const EOM(robot_derivatives) *restrict derivatives, const EOM_SCALAR *restrict h, const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, const EOM(step_sequence) *restrict steps, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes, EOM(workspace) work)
{
    const EOM(sizes) *const sizes = EOM_KNOWN(derivatives)->robot->sizes;
    const size_t nq = (size_t)EOM_POSITIONS_OF(sizes);
    const size_t nv = (size_t)EOM_RATES_OF(sizes);
    const size_t size = EOM(kept_of_step)(sizes, steps->method);
    const int closed = (EOM_M_OF(sizes) > 0) ? 1 : 0;
    const int kind = steps->method % EOM_KINDS;
    EOM_SCALAR *const stages_here = &work.state[EOM(forces_room)(derivatives)];
    EOM_SCALAR *const q_end = &stages_here[size];
    EOM_SCALAR *const v_end = &q_end[nq];
    EOM_SCALAR *const to_q = &v_end[nv];
    EOM_SCALAR *const to_v = &to_q[nq];
    EOM_SCALAR *const rest = &to_v[nv];
    (void)memcpy(to_q, &by_q[steps->count * nq], nq * sizeof *to_q);
    (void)memcpy(to_v, &by_v[steps->count * nv], nv * sizeof *to_v);
    for (size_t behind = 0; behind < steps->count; ++behind) {
        const size_t k = steps->count - 1U - behind;
        const EOM_SCALAR *const q_here = &q[k * nq];
        const EOM_SCALAR *const v_here = &v[k * nv];
        const EOM(interval) interval = EOM(interval_of)(derivatives, h, drive, inputs, steps, k, work);
        const EOM_SCALAR *stages = stages_here;
        if (kept == NULL) {
            EOM(refuse_failed)(EOM(step_forward)(&interval, q_here, v_here, stages_here, q_end, v_end, rest), (int)size, stages_here);
        } else {
            stages = &kept[k * size];
            if (closed == 0) {
                /* the end is what the next step began with */
            } else if (kind == EOM_ROSENBROCK) {
                EOM(rosenbrock_state)(&interval, EOM(rosenbrock_of)(&interval)->stages, q_here, v_here, stages, q_end, v_end);
            } else if (kind == EOM_IMPLICIT_EULER) {
                EOM(implicit_end)(&interval, q_here, v_here, stages, q_end, v_end);
            } else {
                EOM(explicit_stage)(&interval, EOM(explicit_of)(&interval)->stages, q_here, v_here, stages, &stages[nv * EOM_EXPLICIT_STAGES], q_end, v_end);
            }
        }
        if (closed != 0) {
            EOM(prescribe)(&interval, eom_instant_of(interval.end), q_end, v_end);
            EOM(assemble_adjoint)(&interval, q_end, v_end, to_q, to_v, slopes, rest);
        }
        EOM(prescribe_adjoint)(&interval, eom_instant_of(interval.end), to_q, to_v, slopes);
        if (kind == EOM_ROSENBROCK) {
            EOM(rosenbrock_adjoint)(&interval, q_here, v_here, stages, to_q, to_v, slopes, rest);
        } else if (kind == EOM_IMPLICIT_EULER) {
            EOM(implicit_adjoint)(&interval, q_here, v_here, to_q, to_v, slopes, rest);
        } else {
            EOM(explicit_adjoint)(&interval, q_here, v_here, stages, to_q, to_v, slopes, rest);
        }
        for (size_t i = 0; i < nq; ++i) {
            to_q[i] += by_q[k * nq + i];
            by_q[k * nq + i] = to_q[i];
        }
        for (size_t i = 0; i < nv; ++i) {
            to_v[i] += by_v[k * nv + i];
            by_v[k * nv + i] = to_v[i];
        }
    }
}

EOM_PUBLIC long long EOM(rollout_sensitivity)(const EOM(robot_derivatives) *restrict derivatives, const EOM_SCALAR *restrict h, const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, const EOM(step_sequence) *restrict steps, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict q, EOM_SCALAR *restrict v, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM(workspace) work)
{
    const EOM(sizes) *const sizes = EOM_KNOWN(derivatives)->robot->sizes;
    const size_t nq = (size_t)EOM_POSITIONS_OF(sizes);
    const size_t nv = (size_t)EOM_RATES_OF(sizes);
    const int kind = steps->method % EOM_KINDS;
    EOM_SCALAR *const stages_here = &work.state[EOM(forces_room)(derivatives)];
    EOM_SCALAR *const rest = &stages_here[EOM(kept_of_step)(sizes, steps->method)];
    for (size_t k = 0; k < steps->count; ++k) {
        const EOM_SCALAR *const q_here = &q[k * nq];
        const EOM_SCALAR *const v_here = &v[k * nv];
        EOM_SCALAR *const q_end = &q[(k + 1U) * nq];
        EOM_SCALAR *const v_end = &v[(k + 1U) * nv];
        EOM_SCALAR *const dq_end = &dq[(k + 1U) * directions * nq];
        EOM_SCALAR *const dv_end = &dv[(k + 1U) * directions * nv];
        const EOM(interval) interval = EOM(interval_of)(derivatives, h, drive, inputs, steps, k, work);
        const int status = EOM(step_forward)(&interval, q_here, v_here, stages_here, q_end, v_end, rest);
        if (status != 0) { return EOM(failure_of_step)(sizes, k, status); }
        (void)memcpy(dq_end, &dq[k * directions * nq], directions * nq * sizeof *dq);
        (void)memcpy(dv_end, &dv[k * directions * nv], directions * nv * sizeof *dv);
        if (kind == EOM_ROSENBROCK) {
            EOM(rosenbrock_tangent)(&interval, q_here, v_here, stages_here, directions, rates, dq_end, dv_end, rest);
        } else if (kind == EOM_IMPLICIT_EULER) {
            EOM(implicit_tangent)(&interval, q_here, v_here, directions, rates, dq_end, dv_end, rest);
        } else {
            EOM(explicit_tangent)(&interval, q_here, v_here, stages_here, directions, rates, dq_end, dv_end, rest);
        }
        EOM(prescribe)(&interval, eom_instant_of(interval.end), q_end, v_end);
        for (size_t d = 0; d < directions; ++d) {
            EOM(prescribe_tangent)(&interval, &dq_end[d * nq], &dv_end[d * nv]);
            if (EOM_M_OF(sizes) > 0) { EOM(assemble_tangent)(&interval, q_end, v_end, &rates->parameters[d * (size_t)sizes->parameters], &dq_end[d * nq], &dv_end[d * nv], rest); }
        }
        if (EOM_M_OF(sizes) > 0) {
            const int opened = EOM(assemble)(EOM_KNOWN(derivatives)->robot, h, q_end, v_end, rest, NULL);
            if (opened != 0) { return EOM(failure_of_step)(sizes, k, opened); }
        }
    }
    return -1;
}
