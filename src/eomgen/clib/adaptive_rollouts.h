/* adaptive_rollouts.h: from sample to sample by steps whose length the error controls, of one state, or of one in every lane. */

/* An integration that goes on: what it is of, its step, where it is, and what lanes do. */
typedef struct {
    EOM_F(problem) problem;
    EOM_F(step) step;
#if defined(EOM_HAS_RADAU)
    EOM_F(radau) radau;
#endif
    EOM_REAL *u;
    EOM_REAL *target;
    const EOM(tolerance) *allowed;
    size_t allowed_step;
    const size_t *place;
    const double *times;
    size_t samples;
    EOM_SCALAR *q_out;
    EOM_SCALAR *v_out;
    eom_progress *progress;
    double duration;
    double length[EOM_WIDTH];
    int going[EOM_WIDTH];
    int lands[EOM_WIDTH];  /* whether a lane's step ends at a sample or at a jump */
    int halts[EOM_WIDTH];  /* whether inputs jump there */
    int taken[EOM_WIDTH];
    int known[EOM_WIDTH];  /* whether dx has the rates at the beginning */
    int failed[EOM_WIDTH]; /* see problem */
    int left;          /* lanes that go on */
    int method;
    EOM_SCALAR diagonal; /* of a Rosenbrock method */
    int held;          /* whether drives are the same from sample to sample */
    int dense;         /* whether samples lie within steps */
    int works;
} EOM_F(integration);

/* Tolerances of a lane. */
EOM_LOCAL const EOM(tolerance) *EOM_F(tolerance_of)(const EOM_F(integration) *restrict it, int l)
{
    return &it->allowed[it->place[l] * it->allowed_step];
}

/* End a lane in this call. */
EOM_LOCAL void EOM_F(stop_lane)(EOM_F(integration) *restrict it, int l)
{
    it->going[l] = 0;
    it->left -= 1;
}

/* End those of some lanes in which equations cannot be solved: those that begin a step, or have taken one. */
EOM_LOCAL void EOM_F(end_failed)(EOM_F(integration) *restrict it, int *restrict some)
{
    const int nx = EOM_STATE_OF(it->problem.motion.robot->sizes);
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if ((some[l] == 0) || (it->failed[l] == 0)) { continue; }
        it->progress[it->place[l]].reason = 1 + nx + it->failed[l];
        EOM_F(stop_lane)(it, l);
        some[l] = 0;
    }
}

/* What steps of Radau IIA do besides. */
#if defined(EOM_HAS_RADAU)
#include "radau_control.h"
#define EOM_WITH_RADAU(kind, statements) if ((kind) == EOM_RADAU_KIND) { statements; }
#else
#define EOM_WITH_RADAU(kind, statements)
#endif

/* Begin with states at their beginning, or go on where progress is. */
EOM_LOCAL void EOM_F(begin_motion)(EOM_F(integration) *restrict it, const EOM(inputs) *restrict inputs, size_t inputs_step, int here)
{
    const EOM(drive) *const drive = it->problem.motion.drive;
    const EOM(sizes) *const sizes = it->problem.motion.robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    it->left = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        eom_progress *const p = &it->progress[it->place[l]];
        it->going[l] = ((l < here) && (p->reason == 0)) ? 1 : 0;
        it->length[l] = it->duration;
        it->lands[l] = 0;
        it->halts[l] = 0;
        it->known[l] = 0;
        it->left += it->going[l];
        it->problem.clock.inputs[l] = (inputs == NULL) ? NULL : &inputs[it->place[l] * inputs_step];
        EOM_F(hold)(sizes, drive, it->place[l], ((p->sample > 0U) && (p->sample <= it->samples)) ? (p->sample - 1U) : 0U, l, it->u, it->target);
        if ((it->going[l] != 0) && (p->sample == 0U)) {
            const size_t first = it->place[l] * (it->samples + 1U);
            for (int i = 0; i < nq; ++i) { it->q_out[first * (size_t)nq + (size_t)i] = EOM_LANE_OF(it->step.x[i], l); }
            for (int i = 0; i < nv; ++i) { it->v_out[first * (size_t)nv + (size_t)i] = EOM_LANE_OF(it->step.x[nq + i], l); }
            if (p->works != NULL) { (void)memcpy(p->works, p->work, sizeof p->work); }
            if (p->kept != NULL) { p->kept[2] = 0.0; } /* nothing yet: no error is 0 */
            p->sample = 1U;
            p->t = it->times[0];
            p->looked = it->times[0];
        }
    }
}

/* Look where lanes are, and when their inputs jump next; lanes that have taken their steps of this call end.  Whether the rates
 * of one that goes on are not known. */
EOM_LOCAL int EOM_F(look_at_clock)(EOM_F(integration) *restrict it, long long pass)
{
    EOM_F(clock) *const clock = &it->problem.clock;
    const double end = it->times[it->samples];
    int fresh = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        const eom_progress *const p = &it->progress[it->place[l]];
        const EOM(inputs) *const inputs = clock->inputs[l];
        it->failed[l] = 0;
        if ((it->going[l] != 0) && (pass >= EOM_F(tolerance_of)(it, l)->most)) { EOM_F(stop_lane)(it, l); }
        clock->begin[l] = p->t;
        clock->step[l] = 0.0;
        clock->end[l] = p->t;
        clock->after[l] = p->t;
        clock->before[l] = p->t;
        clock->stop[l] = HUGE_VAL;
        if ((inputs != NULL) && (inputs->stops > 0U)) {
            const size_t count = eom_stops_until(inputs->stop, inputs->stops, p->t);
            if (count < inputs->stops) { clock->stop[l] = inputs->stop[count]; }
            if (eom_jumps_at(inputs->stop, inputs->stops, p->t) != 0) { clock->after[l] = p->t + 1e-7 * (((clock->stop[l] < end) ? clock->stop[l] : end) - p->t); }
        }
        if ((it->going[l] != 0) && (it->known[l] == 0)) { fresh = 1; }
    }
    return fresh;
}

/* Choose the lengths of lanes' next steps, which end at samples where these are no dense output, and at jumps. */
EOM_LOCAL void EOM_F(choose_lengths)(EOM_F(integration) *restrict it, EOM_REAL *restrict dt)
{
    EOM_F(clock) *const clock = &it->problem.clock;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        eom_progress *const p = &it->progress[it->place[l]];
        it->known[l] = 1;
        if (it->going[l] == 0) { continue; }
        if (!(p->next > 0.0)) { p->next = EOM_F(first_step)(&it->problem.motion, EOM_F(tolerance_of)(it, l), l, &it->step); }
        double goal = (it->dense != 0) ? it->times[it->samples] : it->times[p->sample];
        const int stops = (clock->stop[l] <= goal) ? 1 : 0;
        if (stops != 0) { goal = clock->stop[l]; }
        const double rest = goal - p->t;
        it->lands[l] = (p->next * 1.000001 >= rest) ? 1 : 0;
        it->length[l] = (it->lands[l] != 0) ? rest : ((2.0 * p->next > rest) ? (0.5 * rest) : p->next);
        clock->step[l] = it->length[l];
        clock->end[l] = (it->lands[l] != 0) ? goal : (p->t + it->length[l]);
        it->halts[l] = ((it->lands[l] != 0) && (stops != 0)) ? 1 : 0;
        clock->before[l] = (it->halts[l] != 0) ? (clock->end[l] - 1e-3 * it->length[l]) : clock->end[l];
        EOM_LANE_OF(*dt, l) = (EOM_SCALAR)it->length[l];
    }
}

/* Judge lanes' steps by their errors, which are too great where equations failed; with closed loops their ends are assembled. */
EOM_LOCAL void EOM_F(judge_steps)(EOM_F(integration) *restrict it, EOM_REAL *restrict work)
{
    const EOM_F(motion) *const motion = &it->problem.motion;
    const eom_error_control *const control = &eom_error_controls[it->method];
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        eom_progress *const p = &it->progress[it->place[l]];
        int where = 0;
        it->taken[l] = 0;
        if (it->going[l] == 0) { continue; }
        const double excess = (it->failed[l] != 0) ? HUGE_VAL : EOM_F(error_norm)(motion, EOM_F(tolerance_of)(it, l), l, &it->step, &where);
        if (it->failed[l] != 0) { where = EOM_STATE_OF(motion->robot->sizes) + it->failed[l] - 1; }
#if defined(EOM_HAS_RADAU)
        if (control->kind == EOM_RADAU_KIND) {
            it->taken[l] = EOM_F(judge_radau)(&it->radau, p, excess, l, it->length[l], it->duration, where);
        } else
#endif
        {
            it->taken[l] = EOM_F(judge)(p, excess, control->exponent, it->length[l], it->duration, where);
        }
        if (p->reason != 0) {
            it->taken[l] = 0;
            EOM_F(stop_lane)(it, l);
        }
    }
    if (EOM_M_OF(motion->robot->sizes) > 0) {
        it->left -= EOM_F(assemble_ends)(motion, it->length, it->duration, it->going, it->taken, &it->step, it->place, it->progress, work);
    }
}

/* Prepare what lies within steps of a Rosenbrock method where a sample or doubtful works ask for it.  Whether any does. */
EOM_LOCAL int EOM_F(prepare_inside)(EOM_F(integration) *restrict it, EOM_REAL dt, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = it->problem.motion.robot->sizes;
    const eom_error_control *const control = &eom_error_controls[it->method];
    int inside = 0;
    for (int l = 0; (EOM_M_OF(sizes) == 0) && (control->kind == EOM_ROSENBROCK_KIND) && (l < (int)EOM_WIDTH); ++l) {
        const eom_progress *const p = &it->progress[it->place[l]];
        if (it->taken[l] == 0) { continue; }
        if ((it->dense != 0) && (it->times[p->sample] < it->problem.clock.end[l])) { inside = 1; }
        if ((it->works != 0) && (EOM_F(works_are_doubtful)(it->problem.clock.power, p->work, l, it->method, it->length[l], EOM_F(tolerance_of)(it, l)->rtol) != 0)) { inside = 1; }
    }
    if (inside != 0) {
        if (sizes->has_friction == 0) {
            EOM_F(rate)(&it->problem, 1.0, control->stages, it->step.x_end, it->step.dx_end, work);
            EOM_F(end_failed)(it, it->taken);
        }
        EOM_F(bend_of_step)(&it->problem, it->diagonal * dt, dt, &it->step, work.state);
    }
    return inside;
}

/* Store the samples that a lane's step has come to, with works up to there; share is that up to which doubtful works are
 * integrated. */
EOM_LOCAL double EOM_F(store_samples)(EOM_F(integration) *restrict it, int l, double began, int doubtful, const double *restrict works_began, EOM_F(workspace) work)
{
    const EOM_F(problem) *const problem = &it->problem;
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const double length = it->length[l];
    const size_t first = it->place[l] * (it->samples + 1U);
    eom_progress *const p = &it->progress[it->place[l]];
    double share = 0.0;
    while ((p->sample <= it->samples) && (((it->lands[l] != 0) || (it->dense != 0)) && (it->times[p->sample] <= p->t))) {
        EOM_SCALAR *const q_row = &it->q_out[(first + p->sample) * (size_t)nq];
        EOM_SCALAR *const v_row = &it->v_out[(first + p->sample) * (size_t)nv];
        double *const work_row = (p->works == NULL) ? NULL : &p->works[p->sample * EOM_WORKS];
        const double time = it->times[p->sample];
        const int inside = ((it->dense != 0) && (time < p->t)) ? 1 : 0;
        if (doubtful != 0) {
            const double until = (time < p->t) ? ((time - began) / length) : 1.0;
            EOM_F(integrate_works)(problem, l, it->method, share, until, EOM_F(tolerance_of)(it, l)->rtol, &it->step, p->work, work);
            share = until;
        }
        if (inside != 0) {
            EOM_F(dense_output)(sizes, (time - began) / length, length, l, it->method, &it->step, q_row, v_row);
        } else {
            if ((it->halts[l] != 0) && (EOM_M_OF(sizes) == 0)) { EOM_F(put_prescribed)(problem, l, eom_instant_of(p->t), it->step.x_end, work.input); }
            for (int i = 0; i < nq; ++i) { q_row[i] = EOM_LANE_OF(it->step.x_end[i], l); }
            for (int i = 0; i < nv; ++i) { v_row[i] = EOM_LANE_OF(it->step.x_end[nq + i], l); }
        }
        if ((work_row != NULL) && (inside != 0) && (doubtful == 0)) {
            EOM_F(works_between)((time - began) / length, length, l, it->method, problem->clock.power, works_began, p->work, work_row);
        } else if (work_row != NULL) {
            (void)memcpy(work_row, p->work, sizeof p->work);
        } else {
            /* no works are asked for */
        }
        if (EOM_ROTATIONS_OF(sizes) > 0) { EOM_F(describe_row)(sizes, problem->motion.charts, l, q_row, v_row, work.state); }
        p->sample += 1U;
        if ((it->held == 0) && (p->sample <= it->samples)) {
            EOM_F(hold)(sizes, problem->motion.drive, it->place[l], p->sample - 1U, l, it->u, it->target);
            it->known[l] = 0;
        }
    }
    return share;
}

/* Record a step of a lane. */
EOM_LOCAL void EOM_F(record_step)(EOM_F(integration) *restrict it, int l, double stiffness, EOM(record) *restrict record, EOM_REAL *restrict work)
{
    const EOM_F(motion) *const motion = &it->problem.motion;
    const int nq = EOM_POSITIONS_OF(motion->robot->sizes);
    const int nv = EOM_RATES_OF(motion->robot->sizes);
    EOM_SCALAR *const q = &record->q[record->count * (size_t)nq];
    EOM_SCALAR *const v = &record->v[record->count * (size_t)nv];
    record->t[record->count] = it->progress[it->place[l]].t;
    if (record->stiffness != NULL) { record->stiffness[record->count] = stiffness; }
    for (int i = 0; i < nq; ++i) { q[i] = EOM_LANE_OF(it->step.x[i], l); }
    for (int i = 0; i < nv; ++i) { v[i] = EOM_LANE_OF(it->step.x[nq + i], l); }
    if (EOM_ROTATIONS_OF(motion->robot->sizes) > 0) { EOM_F(describe_row)(motion->robot->sizes, motion->charts, l, q, v, work); }
    record->count += 1U;
}

/* y = x, of a lane. */
EOM_INLINE void EOM_F(copy_lane)(int n, int l, const EOM_REAL *restrict x, EOM_REAL *restrict y)
{
    (void)l; /* of one state there is one lane */
    for (int i = 0; i < n; ++i) { EOM_LANE_OF(y[i], l) = EOM_LANE_OF(x[i], l); }
}

/* Go on from the end of a lane's step. */
EOM_LOCAL void EOM_F(accept_step)(EOM_F(integration) *restrict it, int l, int inside, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = it->problem.motion.robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int closed = (EOM_M_OF(sizes) > 0) ? 1 : 0;
    const eom_error_control *const control = &eom_error_controls[it->method];
    const double length = it->length[l];
    const double rtol = EOM_F(tolerance_of)(it, l)->rtol;
    eom_progress *const p = &it->progress[it->place[l]];
    double *const power = it->problem.clock.power;
    const double began = p->t;
    double works_began[EOM_WORKS];
    const int doubtful = ((it->works != 0) && (closed == 0)) ? EOM_F(works_are_doubtful)(power, p->work, l, it->method, length, rtol) : 0;
    it->known[l] = ((closed == 0) && (it->halts[l] == 0) && (control->kind != EOM_RADAU_KIND) && ((sizes->has_friction != 0) || (control->kind == EOM_EXPLICIT_KIND) || (inside != 0))) ? 1 : 0;
    (void)memcpy(works_began, p->work, sizeof works_began);
    for (int w = 0; (it->works != 0) && (doubtful == 0) && (w < EOM_WORKS); ++w) { p->work[w] += EOM_F(work_of_step)(power, w, l, it->method, length, 1.0); }
    p->steps += 1;
    p->t = it->problem.clock.end[l];
    if (length > p->largest) { p->largest = length; }
    if ((p->steps == 1) || (length < p->smallest)) { p->smallest = length; }
    const double share = EOM_F(store_samples)(it, l, began, doubtful, works_began, work);
    if ((doubtful != 0) && (share < 1.0)) { EOM_F(integrate_works)(&it->problem, l, it->method, share, 1.0, rtol, &it->step, p->work, work); }
    if ((closed == 0) && (it->halts[l] != 0)) { EOM_F(put_prescribed)(&it->problem, l, eom_instant_of(p->t), it->step.x_end, work.input); }
    EOM_F(copy_lane)(nq + nv, l, it->step.x_end, it->step.x);
    EOM_F(copy_lane)(nq, l, &it->step.x_end[nq], it->step.dx); /* prescribed motions are in it */
    EOM_F(copy_lane)(nv - nq, l, &it->step.x_end[2 * nq], &it->step.dx[nq + nv]);
    EOM_F(copy_lane)(nv, l, &it->step.dx_end[nq], &it->step.dx[nq]);
    for (int w = 0; (it->works != 0) && (closed == 0) && (w < EOM_WORKS); ++w) { power[w * (int)EOM_WIDTH + l] = power[(control->stages * EOM_WORKS + w) * (int)EOM_WIDTH + l]; }
}

/* Take room for an integration from a workspace. */
EOM_LOCAL void EOM_F(carve_integration)(const EOM(sizes) *restrict sizes, EOM_F(integration) *restrict it, EOM_F(workspace) *restrict work)
{
    const int pair = EOM_PADDED_TO_BLOCKS(2 * EOM_RATES_OF(sizes));
    const int rates = EOM_PADDED_TO_BLOCKS(2 * EOM_RATES_OF(sizes) + 3 * EOM_M_OF(sizes));
    it->u = work->state;
    it->target = &it->u[EOM_PADDED_TO_BLOCKS(EOM_INPUTS_OF(sizes))];
    it->step.x_end = &it->target[EOM_PADDED_TO_BLOCKS(EOM_POSITIONS_OF(sizes))];
    it->step.error = &it->step.x_end[pair];
    it->step.bend = &it->step.error[pair];
    it->step.dx = &it->step.bend[EOM_PADDED_TO_BLOCKS(EOM_RATES_OF(sizes))];
    it->step.dx_end = &it->step.dx[rates];
    it->step.factors = &it->step.dx_end[rates];
    it->problem.failed = it->failed;
    it->problem.spare = &it->step.factors[EOM_PADDED_TO_BLOCKS(sizes->factors)];
    work->state = &it->problem.spare[(EOM_WIDTH > 1) ? (EOM_STATE_OF(sizes) + 2 * EOM_INPUTS_OF(sizes) + 6 + sizes->hoisted) : 0];
    it->problem.u = it->u;
    it->problem.target = it->target;
    (void)memset(it->u, 0, (size_t)(work->state - it->u) * sizeof *it->u);
}

/* Steps by each method, whose coefficients are constants there. */
#define EOM_TAKE_EXPLICIT(number, row) case number: EOM_F(explicit_step)(&it.problem, &eom_explicit_methods[row], dt, &it.step, EOM_F(tolerance_of)(&it, 0), estimate, work); break;
#define EOM_TAKE_ROSENBROCK(number, row) case number: it.diagonal = eom_rosenbrock_methods[row].diagonal; EOM_F(rosenbrock_step)(&it.problem, &eom_rosenbrock_methods[row], dt, &it.step, work); break;

/* Go on with up to EOM_WIDTH states, those at place, from where their progress is, each by steps of its length; at most so many in
 * this call.  The numbers at place behind the ones that are here are those of one of them.  x = (q, v), with room for nv - nq more. */
EOM_LOCAL void EOM_F(adapt)(const EOM_F(robot) *restrict robot, const EOM_REAL *restrict h, const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, size_t inputs_step, const EOM(tolerance) *restrict allowed, size_t allowed_step, const size_t *restrict place, int here, const double *restrict times, size_t samples, int method, EOM_REAL *restrict x, EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out, eom_progress *restrict progress, EOM(record) *restrict record, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nx = EOM_STATE_OF(sizes);
    const int kind = eom_error_controls[method].kind;
    EOM_F(integration) it;
    EOM_F(charts) charts;
    EOM_REAL dt = EOM_WHOLE(EOM_C(1.0));
    double power[EOM_STAGES_WITH_POWERS * EOM_WORKS * EOM_WIDTH];
    double stiffness = 0.0;
    double *const estimate = ((record == NULL) || (record->stiffness == NULL)) ? NULL : &stiffness;
    long long most = 0;
    it.problem.motion.robot = robot;
    it.problem.motion.h = h;
    it.problem.motion.charts = NULL;
    it.problem.motion.drive = drive;
    it.allowed = allowed;
    it.allowed_step = allowed_step;
    it.place = place;
    it.times = times;
    it.samples = samples;
    it.q_out = q_out;
    it.v_out = v_out;
    it.progress = progress;
    it.duration = times[samples] - times[0];
    it.method = method;
    it.diagonal = EOM_C(0.0);
    it.held = ((drive->u_step == 0U) && (drive->target_step == 0U)) ? 1 : 0;
    it.dense = ((it.held != 0) && (EOM_M_OF(sizes) == 0)) ? 1 : 0;
    it.works = ((EOM_ROTATIONS_OF(sizes) == 0) && (inputs != NULL) && (inputs->work != NULL)) ? 1 : 0;
    it.problem.clock.power = (it.works == 0) ? NULL : power;
    it.problem.clock.here = here;
    EOM_F(carve_integration)(sizes, &it, &work);
    it.step.x = x;
    for (int i = nx; i < 2 * EOM_RATES_OF(sizes); ++i) { x[i] = EOM_WHOLE(EOM_C(0.0)); }
    it.step.inside = NULL;
    EOM_WITH_RADAU(kind, EOM_F(carve_radau)(sizes, &it.radau, &work); it.step.inside = it.radau.inside)
    EOM_F(begin_motion)(&it, inputs, inputs_step, here);
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        const long long limit = EOM_F(tolerance_of)(&it, l)->most;
        most = (limit > most) ? limit : most;
    }
    if (EOM_ROTATIONS_OF(sizes) > 0) {
        EOM_F(carve_charts)(sizes, &charts, &work);
        it.problem.motion.charts = &charts;
        it.problem.motion.h = charts.h;
        EOM_F(begin_charts)(sizes, h, drive->kp, drive->kd, &charts, x, &x[nq]);
        EOM_F(resume_charts)(sizes, drive, place, &charts, x, &x[nq]);
    }
    EOM_WITH_RADAU(kind, EOM_F(resume_radau)(&it.problem, place, progress, &it.radau))
    for (long long pass = 0; (it.left > 0) && (pass < most) && ((record == NULL) || (record->count < record->room)); ++pass) {
        if (EOM_F(look_at_clock)(&it, pass) != 0) {
            EOM_F(rate)(&it.problem, 0.0, 0, x, it.step.dx, work);
            EOM_F(end_failed)(&it, it.going);
            if (it.left == 0) { break; }
        }
        EOM_F(choose_lengths)(&it, &dt);
        switch (method) {
            EOM_EACH_EXPLICIT(EOM_TAKE_EXPLICIT)
            EOM_EACH_ROSENBROCK(EOM_TAKE_ROSENBROCK)
            default:
#if defined(EOM_HAS_RADAU)
                EOM_F(take_radau_step)(&it, dt, work);
#endif
                break;
        }
        if ((inputs != NULL) && (kind != EOM_RADAU_KIND)) { EOM_F(put_prescribed_ends)(&it.problem, &it.step, work.input); }
        EOM_F(judge_steps)(&it, work.state);
        EOM_WITH_RADAU(kind, EOM_F(keep_inside)(&it))
        const int inside = EOM_F(prepare_inside)(&it, dt, work);
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            if (it.taken[l] == 0) { continue; }
            EOM_F(accept_step)(&it, l, inside, work);
            if (it.halts[l] != 0) { EOM_WITH_RADAU(kind, EOM_F(forget_radau)(sizes, &it.radau, l)) }
            if (record != NULL) { EOM_F(record_step)(&it, l, stiffness, record, work.state); }
            if ((progress[place[l]].sample > samples) && (it.failed[l] == 0)) {
                progress[place[l]].reason = 1;
                EOM_F(stop_lane)(&it, l);
            }
        }
        EOM_F(end_failed)(&it, it.taken); /* within a step, where works are integrated */
        if (EOM_ROTATIONS_OF(sizes) == 0) { continue; }
        EOM_WITH_RADAU(kind, EOM_F(look_at_charts)(sizes, &charts, &it.radau, 0))
        if (EOM_F(change_charts)(sizes, &charts, x, &x[nq]) != 0) {
            for (int l = 0; l < (int)EOM_WIDTH; ++l) { it.known[l] = 0; }
            EOM_WITH_RADAU(kind, EOM_F(look_at_charts)(sizes, &charts, &it.radau, 1))
        }
    }
    EOM_WITH_RADAU(kind, EOM_F(keep_radau)(&it.problem, place, progress, &it.radau))
    if (EOM_ROTATIONS_OF(sizes) > 0) {
        EOM_F(keep_charts)(sizes, drive, place, (size_t)here, &charts, x, &x[nq]);
        EOM_F(describe)(sizes, &charts, 0, x, &x[nq], it.step.x_end, &it.step.x_end[nq]);
        (void)memcpy(x, it.step.x_end, (size_t)nx * sizeof *x);
    }
}
#undef EOM_TAKE_EXPLICIT
#undef EOM_TAKE_ROSENBROCK
#undef EOM_WITH_RADAU
