/* integrate.c: integration of one state; compile it once, or include it in a robot's file that defines EOM_RATES, and
 * with its derivatives EOM_DERIVATIVES.  It may be one part alone: steps of fixed length (EOM_FIXED_ONLY), with
 * EOM_HELD those without inputs over time, or steps with error control (EOM_ADAPTIVE_ONLY), both without
 * derivatives. */
#include "inputs.h"

#include "state_one.h"

/* Read a state. */
EOM_LOCAL void EOM(load)(const EOM_SCALAR *restrict x, size_t step, size_t here, int n, EOM_SCALAR *restrict y)
{
    (void)step;
    (void)here;
    (void)memcpy(y, x, (size_t)n * sizeof *y);
}

/* Write a state. */
EOM_LOCAL void EOM(store)(const EOM_SCALAR *restrict x, size_t here, size_t stride, int n, EOM_SCALAR *restrict y)
{
    (void)here;
    (void)stride;
    (void)memcpy(y, x, (size_t)n * sizeof *x);
}

#include "steps.h"

#if !defined(EOM_ADAPTIVE_ONLY)
EOM_PUBLIC long long EOM(integrate_fixed)(const EOM(robot) *restrict robot, const EOM_SCALAR *restrict h,
        const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM(drive) *restrict drive,
        const EOM(inputs) *restrict inputs, double first, EOM_SCALAR dt, size_t steps, size_t every, int method,
        EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, EOM(workspace) work)
{
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    EOM_SCALAR *const x = work.state;
    work.state += EOM_PADDED_TO_BLOCKS(nq + nv);
    (void)memcpy(x, q, (size_t)nq * sizeof *q);
    (void)memcpy(&x[nq], v, (size_t)nv * sizeof *v);
    return EOM(steps)(robot, h, drive, inputs, first, 0, 1, dt, steps, every, method, x, q_out, v_out, work);
}

/* Integrate count states as integrate_fixed does, one after the other. */
EOM_PUBLIC long long EOM(integrate_fixed_one_by_one)(const EOM(robot) *restrict robot, size_t count,
        const EOM_SCALAR *restrict h, const EOM_SCALAR *restrict q, size_t q_step, const EOM_SCALAR *restrict v,
        size_t v_step, const EOM(drive) *restrict drive, EOM_SCALAR dt, size_t steps, size_t every, int method,
        EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, EOM(workspace) work)
{
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const size_t statuses = (size_t)(nq + ((EOM_M_OF(robot->sizes) > 0) ? (3 * EOM_M_OF(robot->sizes) + nq) : 0));
    const size_t rows = steps / every + 1U;
    EOM_SCALAR *const x = work.state;
    work.state += EOM_PADDED_TO_BLOCKS(nq + nv);
    for (size_t i = 0; i < count; ++i) {
        (void)memcpy(x, &q[i * q_step], (size_t)nq * sizeof *q);
        (void)memcpy(&x[nq], &v[i * v_step], (size_t)nv * sizeof *v);
        const long long failed = EOM(steps)(robot, h, drive, NULL, 0.0, i, 1, dt, steps, every, method, x,
                &q_out[i * rows * (size_t)nq], &v_out[i * rows * (size_t)nv], work);
        if (failed >= 0) { return (long long)(i * steps * statuses) + failed; }
    }
    return -1;
}
#endif

#if !defined(EOM_FIXED_ONLY)
/* Clear the room of a state: what stands behind the last coordinate of a block is computed with, and never looked at,
 * and denormal numbers there cost time. */
EOM_LOCAL void EOM(clear_room)(const EOM(sizes) *restrict sizes, int method, EOM_SCALAR *restrict state)
{
    const int more = (eom_error_controls[method].kind == EOM_RADAU_KIND)
            ? EOM_RADAU_ROOM(sizes->rates, sizes->m, sizes->factors, sizes->pair_factors) : 0;
    const int room = EOM_STATE_ROOM(sizes->rates, sizes->m, sizes->hoisted, sizes->factors, sizes->wrench,
            sizes->parameters, sizes->rotations) + more;
    if (EOM_BLOCK > 1) { (void)memset(state, 0, (size_t)room * sizeof *state); }
}

EOM_PUBLIC int EOM(integrate_adaptive)(const EOM(robot) *restrict robot, const EOM_SCALAR *restrict h,
        const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, const EOM(tolerance) *restrict allowed,
        const double *restrict times, size_t samples, int method, EOM_SCALAR *restrict q, EOM_SCALAR *restrict v,
        EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, eom_progress *restrict progress,
        EOM(record) *restrict record, EOM(workspace) work)
{
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const size_t place = 0;
    EOM_SCALAR *const x = work.state;
    EOM(clear_room)(robot->sizes, method, work.state);
    work.state += EOM_PADDED_TO_BLOCKS(2 * nv);
    (void)memcpy(x, q, (size_t)nq * sizeof *q);
    (void)memcpy(&x[nq], v, (size_t)nv * sizeof *v);
    EOM(adapt)(robot, h, drive, inputs, 0, allowed, 0, &place, 1, times, samples, method, x, q_out, v_out, progress,
            record, work);
    (void)memcpy(q, x, (size_t)nq * sizeof *q);
    (void)memcpy(v, &x[nq], (size_t)nv * sizeof *v);
    return progress->reason;
}

/* work: nq + nv + 12 nu and what computed torque takes; index: 2 nq. */
EOM_PUBLIC void EOM(inputs_over_time)(const EOM(sizes) *restrict sizes, size_t count,
        const EOM(inputs) *restrict inputs, const double *restrict times, EOM_SCALAR *restrict q,
        EOM_SCALAR *restrict v, EOM_SCALAR *restrict u, double *restrict work, int *restrict index)
{
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    double *const position = work;
    double *const rate = &position[nq];
    double *const force = &rate[nv];
    double *const prescribed = &force[nu];
    double *const asked = &prescribed[nu];
    double *const answer = &asked[3 * nu];
    double *const rest = &answer[nu];
    EOM(clock) clock;
    (void)sizes;
    clock.inputs[0] = inputs;
    clock.here = 1;
    for (size_t k = 0; k < count; ++k) {
        EOM_SCALAR *const q_row = &q[k * (size_t)nq];
        EOM_SCALAR *const v_row = &v[k * (size_t)nv];
        EOM_SCALAR *const u_row = &u[k * (size_t)nu];
        for (int i = 0; i < nq; ++i) { position[i] = (double)q_row[i]; }
        for (int i = 0; i < nv; ++i) { rate[i] = (double)v_row[i]; }
        for (int i = 0; i < nu; ++i) { force[i] = 0.0; }
        eom_inputs_at(inputs, nu, eom_instant_of(times[k]), position, rate, force, prescribed, asked, rest);
        EOM(ask_model)(&clock, nu, asked, answer, rest, index);
        eom_finish_drives(inputs, nu, prescribed, answer, force, NULL);
        for (int i = 0; i < nq; ++i) { q_row[i] = (EOM_SCALAR)position[i]; }
        for (int i = 0; i < nv; ++i) { v_row[i] = (EOM_SCALAR)rate[i]; }
        for (int i = 0; i < nu; ++i) { u_row[i] = (EOM_SCALAR)force[i]; }
    }
}

/* Integrate count states as integrate_adaptive does, one after the other, those at place, or the first ones. */
EOM_PUBLIC void EOM(integrate_adaptive_one_by_one)(const EOM(robot) *restrict robot, size_t count,
        const size_t *restrict place, const EOM_SCALAR *restrict h, size_t h_step, const EOM(drive) *restrict drive,
        const EOM(inputs) *restrict inputs, size_t inputs_step, const EOM(tolerance) *restrict allowed,
        size_t allowed_step, const double *restrict times, size_t samples, int method, EOM_SCALAR *restrict q,
        EOM_SCALAR *restrict v, EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, eom_progress *restrict progress,
        EOM(workspace) work)
{
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    EOM_SCALAR *const x = work.state;
    EOM(clear_room)(robot->sizes, method, work.state);
    work.state += EOM_PADDED_TO_BLOCKS(2 * nv);
    for (size_t i = 0; i < count; ++i) {
        const size_t k = (place == NULL) ? i : place[i];
        (void)memcpy(x, &q[k * (size_t)nq], (size_t)nq * sizeof *q);
        (void)memcpy(&x[nq], &v[k * (size_t)nv], (size_t)nv * sizeof *v);
        EOM(adapt)(robot, &h[k * h_step], drive, inputs, inputs_step, allowed, allowed_step, &k, 1, times, samples,
                method, x, q_out, v_out, progress, NULL, work);
        (void)memcpy(&q[k * (size_t)nq], x, (size_t)nq * sizeof *q);
        (void)memcpy(&v[k * (size_t)nv], &x[nq], (size_t)nv * sizeof *v);
    }
}
#endif

#if defined(EOM_HAS_DERIVATIVES) && !defined(EOM_FIXED_ONLY) && !defined(EOM_ADAPTIVE_ONLY)
#include "sensitivities.h"
#endif
