/* integrate_lanes.c: integration of many states, one in every lane of a vector; compile it once per width of vectors,
 * or include it in a robot's file that defines EOM_RATES.  It may be one part alone, as integrate.c. */
#include "inputs.h"

#include "robot_lanes.h"

#include "state_lanes.h"

/* Read a state in every lane. */
EOM_LOCAL void EOM(load_lanes)(const EOM_SCALAR *restrict x, size_t step, size_t here, int n, lanes *restrict y)
{
    eom_gather(x, step, here, 0, n, y);
}

/* Write the states of lanes. */
EOM_LOCAL void EOM(store_lanes)(const lanes *restrict x, size_t here, size_t stride, int n, EOM_SCALAR *restrict y)
{
    eom_scatter(x, NULL, here, 0, n, stride, y);
}

#define EOM_LANES_HERE
#include "steps.h"
#undef EOM_LANES_HERE

#if !defined(EOM_ADAPTIVE_ONLY)
EOM_PUBLIC long long EOM_WIDE(integrate_fixed_batch)(const EOM(robot_lanes) *restrict robot, size_t count,
        const EOM_SCALAR *restrict h, const EOM_SCALAR *restrict q, size_t q_step, const EOM_SCALAR *restrict v,
        size_t v_step, const EOM(drive) *restrict drive, EOM_SCALAR dt, size_t steps, size_t every, int method,
        EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, EOM(workspace_lanes) work)
{
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const long long statuses = nq + ((EOM_M_OF(robot->sizes) > 0) ? (3 * EOM_M_OF(robot->sizes) + nq) : 0);
    const size_t rows = steps / every + 1U;
    lanes *const h_lanes = work.state;
    lanes *const x = &h_lanes[robot->sizes->hoisted];
    work.state = &x[nq + nv];
    for (int i = 0; i < robot->sizes->hoisted; ++i) { h_lanes[i] = EOM_ALL_LANES(h[i]); }
    for (size_t i = 0; i < count; i += EOM_LANES) {
        const size_t here = (count - i < EOM_LANES) ? (count - i) : EOM_LANES;
        eom_gather(&q[i * q_step], q_step, here, 0, nq, x);
        eom_gather(&v[i * v_step], v_step, here, 0, nv, &x[nq]);
        const long long failed = EOM(steps_lanes)(robot, h_lanes, drive, NULL, 0.0, i, here, dt, steps, every, method,
                x, &q_out[i * rows * (size_t)nq], &v_out[i * rows * (size_t)nv], work);
        if (failed >= 0) {
            const long long step = failed / (statuses * (long long)EOM_LANES);
            const long long place = failed % (statuses * (long long)EOM_LANES);
            return (((long long)i + place / statuses) * (long long)steps + step) * statuses + place % statuses;
        }
    }
    return -1;
}
#endif

#if !defined(EOM_FIXED_ONLY)
EOM_PUBLIC void EOM_WIDE(integrate_adaptive_batch)(const EOM(robot_lanes) *restrict robot, size_t count,
        const size_t *restrict place, const EOM_SCALAR *restrict h, size_t h_step, const EOM(drive) *restrict drive,
        const EOM(inputs) *restrict inputs, size_t inputs_step, const EOM(tolerance) *restrict allowed,
        size_t allowed_step, const double *restrict times, size_t samples, int method, EOM_SCALAR *restrict q,
        EOM_SCALAR *restrict v, EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, eom_progress *restrict progress,
        EOM(workspace_lanes) work)
{
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const size_t q_row = (size_t)nq * sizeof *q;
    const size_t v_row = (size_t)nv * sizeof *v;
    lanes *const h_lanes = work.state;
    lanes *const x = &h_lanes[robot->sizes->hoisted];
    EOM_SCALAR *const q_rows = (EOM_SCALAR *)(void *)&x[2 * nv]; /* (EOM_LANES, nq) */
    EOM_SCALAR *const v_rows = &q_rows[(size_t)nq * EOM_LANES];                /* (EOM_LANES, nv) */
    work.state = &x[3 * nv + nq];
    for (size_t i = 0; i < count; i += EOM_LANES) {
        const size_t here = (count - i < EOM_LANES) ? (count - i) : EOM_LANES;
        size_t at[EOM_LANES];
        for (size_t l = 0; l < EOM_LANES; ++l) {
            const size_t k = i + ((l < here) ? l : 0U);
            at[l] = (place == NULL) ? k : place[k];
            (void)memcpy(&q_rows[l * (size_t)nq], &q[at[l] * (size_t)nq], q_row);
            (void)memcpy(&v_rows[l * (size_t)nv], &v[at[l] * (size_t)nv], v_row);
            if ((h_step != 0U) || (i == 0U)) {
                for (int j = 0; j < robot->sizes->hoisted; ++j) {
                    EOM_LANE(h_lanes[j], l) = h[at[l] * h_step + (size_t)j];
                }
            }
        }
        eom_gather(q_rows, (size_t)nq, EOM_LANES, 0, nq, x);
        eom_gather(v_rows, (size_t)nv, EOM_LANES, 0, nv, &x[nq]);
        EOM(adapt_lanes)(robot, h_lanes, drive, inputs, inputs_step, allowed, allowed_step, at, (int)here, times,
                samples, method, x, q_out, v_out, progress, NULL, work);
        eom_scatter(x, NULL, EOM_LANES, 0, nq, (size_t)nq, q_rows);
        eom_scatter(&x[nq], NULL, EOM_LANES, 0, nv, (size_t)nv, v_rows);
        for (size_t l = 0; l < here; ++l) {
            (void)memcpy(&q[at[l] * (size_t)nq], &q_rows[l * (size_t)nq], q_row);
            (void)memcpy(&v[at[l] * (size_t)nv], &v_rows[l * (size_t)nv], v_row);
        }
    }
}
#endif
