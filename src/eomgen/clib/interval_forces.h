/* interval_forces.h: a step that is differentiated, and the forces of drives and inputs in it; of one state. */

/* Derivatives of the robot's equations: those passed in, or with EOM_DERIVATIVES those of that name, which compilers then call
 * without a table. */
#if defined(EOM_DERIVATIVES)
#define EOM_KNOWN(derivatives) (&EOM_DERIVATIVES)
#else
#define EOM_KNOWN(derivatives) (derivatives)
#endif

/* A step that is differentiated: its method, from when to when, s, with times inside beside both where inputs jump there, which
 * row of drives acts, and room for what forces need. */
typedef struct {
#if !defined(EOM_DERIVATIVES)
    const EOM(robot_derivatives) *derivatives;
#endif
    const EOM_SCALAR *h;
    const EOM(drive) *drive;
    const EOM(inputs) *inputs; /* NULL: none */
    size_t row;
    double begin;
    double end;
    double after;
    double before;
    EOM_SCALAR dt;
    int method;
    EOM(workspace) room; /* forces_room scalars: nu slopes, nu forces, and what wrenches need; and 24 nv doubles */
} EOM(interval);

#define EOM_BESIDE 1e-3 /* of a step: where inputs jump, signals are asked that far inside for their pieces */

/* Numbers of room that forces of an interval need. */
EOM_INLINE size_t EOM(forces_room)(const EOM(robot_derivatives) *restrict derivatives)
{
    const EOM(sizes) *const sizes = EOM_KNOWN(derivatives)->robot->sizes;
    (void)derivatives;
    return (size_t)(7 * EOM_RATES_OF(sizes) + 2 * (sizes->wrench + sizes->parameters + EOM_KNOWN(derivatives)->poses));
}

/* Step k of a sequence; work begins with room for its forces. */
EOM_LOCAL EOM(interval) EOM(interval_of)(const EOM(robot_derivatives) *restrict derivatives, const EOM_SCALAR *restrict h, const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, const EOM(step_sequence) *restrict steps, size_t k, EOM(workspace) work)
{
    EOM(interval) interval;
    (void)derivatives;
#if !defined(EOM_DERIVATIVES)
    interval.derivatives = derivatives;
#endif
    interval.h = h;
    interval.drive = drive;
    interval.inputs = inputs;
    interval.row = (size_t)steps->row[k];
    interval.begin = (inputs == NULL) ? 0.0 : steps->times[k];
    interval.end = (inputs == NULL) ? 0.0 : steps->times[k + 1U];
    interval.after = interval.begin;
    interval.before = interval.end;
    interval.dt = steps->dt[k];
    interval.method = steps->method;
    interval.room = work;
    if ((inputs != NULL) && (inputs->stops > 0U)) {
        const double aside = EOM_BESIDE * (interval.end - interval.begin);
        if (eom_jumps_at(inputs->stop, inputs->stops, interval.begin) != 0) { interval.after += aside; }
        if (eom_jumps_at(inputs->stop, inputs->stops, interval.end) != 0) { interval.before -= aside; }
    }
    return interval;
}

/* The time at a share of a step; at its ends, and of stages outside, with one that is inside. */
EOM_LOCAL eom_instant EOM(instant_within)(const EOM(interval) *restrict interval, double share)
{
    eom_instant at;
    at.t = ((share < 1.0) || (share > 1.0)) ? (interval->begin + share * (interval->end - interval->begin)) : interval->end;
    at.beside = (share > 0.0) ? ((share < 1.0) ? at.t : interval->before) : interval->after;
    return at;
}

/* Sizes of the robot, and its numbers of positions, rates and inputs. */
EOM_INLINE const EOM(sizes) *EOM(sizes_of)(const EOM(interval) *restrict interval)
{
    (void)interval;
    return EOM_KNOWN(interval->derivatives)->robot->sizes;
}

EOM_INLINE int EOM(positions_of)(const EOM(interval) *restrict interval)
{
    (void)interval;
    return EOM_POSITIONS_OF(EOM(sizes_of)(interval));
}

EOM_INLINE int EOM(rates_of)(const EOM(interval) *restrict interval)
{
    (void)interval;
    return EOM_RATES_OF(EOM(sizes_of)(interval));
}

EOM_INLINE int EOM(inputs_of)(const EOM(interval) *restrict interval)
{
    (void)interval;
    return EOM_INPUTS_OF(EOM(sizes_of)(interval));
}

/* Add a share of x to y: separate pointers, so that compilers know that numbers do not overlap. */
EOM_INLINE void EOM(add_share)(int n, EOM_SCALAR share, const EOM_SCALAR *restrict x, EOM_SCALAR *restrict y)
{
    for (int i = 0; i < n; ++i) { y[i] += share * x[i]; }
}

/* Prescribed motions of a step, or NULL. */
EOM_INLINE const eom_prescribed *EOM(prescribed_of)(const EOM(interval) *restrict interval)
{
    return (interval->inputs == NULL) ? NULL : interval->inputs->given;
}

/* Put prescribed motions at a time into q and v, if there are any. */
EOM_LOCAL void EOM(prescribe)(const EOM(interval) *restrict interval, eom_instant at, EOM_SCALAR *restrict q, EOM_SCALAR *restrict v)
{
    const eom_prescribed *const motions = EOM(prescribed_of)(interval);
    const int nq = EOM(positions_of)(interval);
    double *const work = interval->room.input;
    if (motions == NULL) { return; }
    eom_prescribed_at(motions, nq, at, work, &work[nq], &work[2 * nq], &work[3 * nq]);
    for (int i = 0; i < motions->size; ++i) {
        q[motions->place[i]] = (EOM_SCALAR)work[i];
        v[motions->place[i]] = (EOM_SCALAR)work[nq + i];
    }
}

/* Evaluate inputs at a share of a step: where they act, q + ahead v, what a model of computed torque is asked, and prescribed
 * accelerations; forces of the drives are added to u.  work: 5 nu. */
EOM_LOCAL void EOM(evaluate_inputs)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, double *restrict position, double *restrict rate, double *restrict u, double *restrict prescribed, double *restrict asked, double *restrict work)
{
    for (int i = 0; i < EOM(positions_of)(interval); ++i) { position[i] = (double)(q[i] + ahead * v[i]); }
    for (int i = 0; i < EOM(rates_of)(interval); ++i) { rate[i] = (double)v[i]; }
    eom_inputs_at(interval->inputs, EOM(inputs_of)(interval), EOM(instant_within)(interval, share), position, rate, u, prescribed, asked, work);
}

/* Add what inputs do at a share of a step to the forces, drives within their limits; slope, if it is not NULL, becomes 0 where
 * these saturate, else 1. */
EOM_LOCAL void EOM(add_input_forces)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict u, EOM_SCALAR *restrict slope)
{
    const EOM(inputs) *const inputs = interval->inputs;
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const eom_computed_torque *const model = (inputs->control == NULL) ? NULL : inputs->model;
    const int nu = EOM_INPUTS_OF(sizes);
    double *const position = interval->room.input;
    double *const rate = &position[EOM_POSITIONS_OF(sizes)];
    double *const force = &rate[EOM_RATES_OF(sizes)];
    double *const prescribed = &force[nu];
    double *const asked = &prescribed[nu];
    double *const answer = &asked[3 * nu];
    double *const rest = &answer[nu];
    for (int i = 0; i < nu; ++i) { force[i] = (double)u[i]; }
    EOM(evaluate_inputs)(interval, share, ahead, q, v, position, rate, force, prescribed, asked, rest);
    if (model != NULL) { (void)model->inverse_dynamics(model->h, asked, &asked[nu], &asked[2 * nu], answer); }
    eom_finish_drives(inputs, nu, prescribed, answer, force, rest);
    if (slope != NULL) {
        for (int i = 0; i < nu; ++i) { slope[i] = (inputs->effort == NULL) ? EOM_C(1.0) : (EOM_SCALAR)rest[i]; }
    }
    if (inputs->wrenches > 0U) {
        eom_wrench_forces(sizes, inputs, interval->h, EOM(instant_within)(interval, share), position, rest, &interval->room.state[2 * nu]);
        eom_add_forces(sizes, rest, force);
    }
    for (int i = 0; i < nu; ++i) { u[i] = (EOM_SCALAR)force[i]; }
}

/* Forces u + kp (target - q - ahead v) - kd v of a row of drives and those of inputs at a share of a step, drives within their
 * limits; slope, if it is not NULL, becomes 0 where these saturate, else 1. */
EOM_LOCAL void EOM(forces_within)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict u, EOM_SCALAR *restrict slope)
{
    const EOM(drive) *const drive = interval->drive;
    const int nu = EOM(inputs_of)(interval);
    (void)memcpy(u, &drive->u[interval->row * drive->u_step], (size_t)nu * sizeof *u);
    if (drive->kp != NULL) {
        const EOM_SCALAR *const target = &drive->target[interval->row * drive->target_step];
        for (int i = 0; i < EOM(positions_of)(interval); ++i) { u[i] += drive->kp[i] * (target[i] - q[i] - ahead * v[i]) - drive->kd[i] * v[i]; }
    }
    if ((interval->inputs == NULL) && (drive->effort != NULL)) { EOM(saturate)(drive, nu, u, slope); }
    if (interval->inputs != NULL) { EOM(add_input_forces)(interval, share, ahead, q, v, u, slope); }
}

/* Write 0 where drives saturate at a share of a step, else 1. */
EOM_LOCAL void EOM(saturation_within)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict slope)
{
    const int nu = EOM(inputs_of)(interval);
    for (int i = 0; i < nu; ++i) { slope[i] = EOM_C(1.0); }
    if ((interval->inputs == NULL) ? (interval->drive->effort == NULL) : (interval->inputs->effort == NULL)) { return; }
    EOM(forces_within)(interval, share, ahead, q, v, &interval->room.state[nu], slope);
}

/* Number of coordinates on which tracking control, or NULL, has gains. */
EOM_LOCAL int eom_gains_of(const eom_tracking *restrict control)
{
    return ((control == NULL) || (control->kp == NULL)) ? 0 : control->program.signal->columns;
}

/* Gains of the controller and of tracking control in the matrix of a step, by coordinate, none where drives saturate: there
 * slope is 0, else 1; in kp inputs of drives with states, where forces beside them stand. */
EOM_LOCAL void EOM(gains_within)(const EOM(interval) *restrict interval, EOM_SCALAR ahead, double share, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kp, EOM_SCALAR *restrict kd, EOM_SCALAR *restrict slope)
{
    const EOM(drive) *const drive = interval->drive;
    const eom_tracking *const control = (interval->inputs == NULL) ? NULL : interval->inputs->control;
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int gains = eom_gains_of(control);
    const int nu = EOM_INPUTS_OF(sizes);
    for (int i = 0; i < nu; ++i) {
        kp[i] = (drive->kp == NULL) ? EOM_C(0.0) : drive->kp[i];
        kd[i] = (drive->kp == NULL) ? EOM_C(0.0) : drive->kd[i];
    }
    for (int k = 0; k < gains; ++k) {
        const double ratio = control->ratio[k] * control->ratio[k];
        kp[control->program.place[k]] += (EOM_SCALAR)(control->kp[k] / ratio);
        kd[control->program.place[k]] += (EOM_SCALAR)(control->kd[k] / ratio);
    }
    EOM(saturation_within)(interval, share, ahead, q, v, slope);
    for (int i = 0; i < nu; ++i) {
        kp[i] *= slope[i];
        kd[i] *= slope[i];
    }
    if (sizes->beside != NULL) {
        EOM_SCALAR *const force = &interval->room.state[nu];
        EOM(forces_within)(interval, share, ahead, q, v, force, NULL);
        for (int i = 0; i < EOM_POSITIONS_OF(sizes); ++i) {
            if (eom_force_place(sizes, i) != i) { kp[eom_force_place(sizes, i)] = force[i]; }
        }
    }
}
