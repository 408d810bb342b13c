/* input_forces.h: forces on coordinates by inputs over time, and by control; of one state or of one in every lane. */

/* The time at a share of a lane's step; at its ends, and of stages outside, with one that is inside. */
EOM_LOCAL eom_instant EOM_F(instant_at)(const EOM_F(clock) *restrict clock, int l, double share)
{
    eom_instant at;
    at.t = ((share < 1.0) || (share > 1.0)) ? (clock->begin[l] + share * clock->step[l]) : clock->end[l];
    at.beside = (share > 0.0) ? ((share < 1.0) ? at.t : clock->before[l]) : clock->after[l];
    return at;
}

/* Forces of computed torque: what a model of the robot, if lanes have one, answers to q, v and a, n numbers apart. */
EOM_LOCAL void EOM_F(ask_model)(const EOM_F(clock) *restrict clock, int n, const double *restrict asked, double *restrict force, double *restrict work, int *restrict index)
{
#if defined(EOM_LANES_HERE)
    const eom_computed_torque *const first = (clock->inputs[0]->control == NULL) ? NULL : clock->inputs[0]->model;
    int alike = ((first != NULL) && (first->inverse_dynamics_batch != NULL)) ? 1 : 0;
    for (int l = 1; l < clock->here; ++l) {
        const eom_computed_torque *const model = (clock->inputs[l]->control == NULL) ? NULL : clock->inputs[l]->model;
        alike = ((alike != 0) && (model != NULL) && (model->inverse_dynamics_batch == first->inverse_dynamics_batch) && (model->batch_h == first->batch_h)) ? 1 : 0;
    }
    if (alike != 0) {
        const size_t apart = 3U * (size_t)n;
        (void)first->inverse_dynamics_batch((size_t)clock->here, first->batch_h, asked, apart, &asked[n], apart, &asked[2 * n], apart, work);
        for (int l = 0; l < clock->here; ++l) {
            for (int i = 0; i < first->size; ++i) { force[l * n + i] = work[l * first->size + i]; }
        }
        return;
    }
#endif
    for (int l = 0; l < clock->here; ++l) {
        const eom_computed_torque *const model = (clock->inputs[l]->control == NULL) ? NULL : clock->inputs[l]->model;
        const double *const state = &asked[3 * n * l];
        if (model == NULL) { continue; }
        if (model->mechanism != NULL) {
            eom_drive_forces(model, state, &state[n], &state[2 * n], &force[n * l], work, index);
        } else {
            (void)model->inverse_dynamics(model->h, state, &state[n], &state[2 * n], &force[n * l]);
        }
    }
}

/* Add what inputs do at a share of lanes' steps to the forces, and put prescribed motions into q and v; powers are a stage's.
 * Where joints change charts all is as described, and wrenches come later. */
EOM_LOCAL void EOM_F(add_inputs)(const EOM_F(problem) *restrict problem, double share, int stage, EOM_REAL *restrict q, EOM_REAL *restrict v, EOM_REAL *restrict force, EOM_REAL *restrict slope, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    const EOM_F(clock) *const clock = &problem->clock;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
#if defined(EOM_LANES_HERE) || defined(EOM_SINGLE)
    double *const position = work.input;
    double *const rate = &position[EOM_WIDTH * nq];
    double *const u = &rate[EOM_WIDTH * nv];
#else
    double *const position = q;
    double *const rate = v;
    double *const u = force;
#endif
    double *const prescribed = &work.input[EOM_WIDTH * (nq + nv + nu)];
    double *const asked = &prescribed[EOM_WIDTH * nu];
    double *const answer = &asked[3 * EOM_WIDTH * nu];
    double *const inside = &answer[EOM_WIDTH * nu];
    double *const pushed = &inside[nu];
    double *const rest = &pushed[nq];
    EOM_SCALAR *const scratch = (EOM_SCALAR *)(void *)work.state;
    eom_instant t[EOM_WIDTH];
#if defined(EOM_LANES_HERE) && !defined(EOM_SINGLE)
    eom_scatter(q, NULL, (size_t)clock->here, 0, nq, (size_t)nq, position);
    eom_scatter(v, NULL, (size_t)clock->here, 0, nv, (size_t)nv, rate);
    eom_scatter(force, NULL, (size_t)clock->here, 0, nu, (size_t)nu, u);
#elif defined(EOM_SINGLE)
    for (int l = 0; l < clock->here; ++l) {
        for (int i = 0; i < nq; ++i) { position[l * nq + i] = (double)EOM_LANE_OF(q[i], l); }
        for (int i = 0; i < nv; ++i) { rate[l * nv + i] = (double)EOM_LANE_OF(v[i], l); }
        for (int i = 0; i < nu; ++i) { u[l * nu + i] = (double)EOM_LANE_OF(force[i], l); }
    }
#endif
    for (int l = 0; l < clock->here; ++l) {
        t[l] = EOM_F(instant_at)(clock, l, share);
        eom_inputs_at(clock->inputs[l], nu, t[l], &position[l * nq], &rate[l * nv], &u[l * nu], &prescribed[l * nu], &asked[3 * l * nu], rest);
    }
    EOM_F(ask_model)(clock, nu, asked, answer, rest, work.index);
    for (int l = 0; l < clock->here; ++l) {
        const EOM(inputs) *const inputs = clock->inputs[l];
        eom_finish_drives(inputs, nu, &prescribed[l * nu], &answer[l * nu], &u[l * nu], inside);
        if (slope != NULL) {
            for (int i = 0; i < nu; ++i) { EOM_LANE_OF(slope[i], l) = (inputs->effort == NULL) ? EOM_C(1.0) : (EOM_SCALAR)inside[i]; }
        }
        if (EOM_ROTATIONS_OF(sizes) == 0) {
            (void)memset(pushed, 0, (size_t)nq * sizeof *pushed);
            if (inputs->wrenches > 0U) { eom_wrench_forces(sizes, inputs, EOM_HERE_OF(problem->motion.h), t[l], &position[l * nq], pushed, scratch); }
            if (clock->power != NULL) {
                double power[EOM_WORKS];
                eom_powers_at(sizes, inputs->work, &position[l * nq], &rate[l * nv], &u[l * nu], pushed, power, scratch);
                for (int w = 0; w < EOM_WORKS; ++w) { clock->power[(stage * EOM_WORKS + w) * (int)EOM_WIDTH + l] = power[w]; }
            }
            if (inputs->wrenches > 0U) { eom_add_forces(sizes, pushed, &u[l * nu]); }
        }
    }
#if defined(EOM_LANES_HERE) || defined(EOM_SINGLE) /* one state in double precision is changed where it is */
    int moved = 0;
    for (int l = 0; l < clock->here; ++l) {
        if (clock->inputs[l]->given != NULL) { moved = 1; }
    }
#if !defined(EOM_SINGLE)
    eom_gather(u, (size_t)nu, (size_t)clock->here, 0, nu, force);
    if (moved != 0) {
        eom_gather(position, (size_t)nq, (size_t)clock->here, 0, nq, q);
        eom_gather(rate, (size_t)nv, (size_t)clock->here, 0, nv, v);
    }
#else
    for (int l = 0; l < clock->here; ++l) {
        for (int i = 0; i < nu; ++i) { EOM_LANE_OF(force[i], l) = (EOM_SCALAR)u[l * nu + i]; }
        for (int i = 0; (moved != 0) && (i < nq); ++i) { EOM_LANE_OF(q[i], l) = (EOM_SCALAR)position[l * nq + i]; }
        for (int i = 0; (moved != 0) && (i < nv); ++i) { EOM_LANE_OF(v[i], l) = (EOM_SCALAR)rate[l * nv + i]; }
    }
#endif
#endif
}

/* Generalized forces of wrenches on the coordinates that there are; q as described, q_here as joints are turned.  Forces on the
 * coordinates of a joint are those of a state in which it is turned or not; other joints do not matter.  work: 3 nq + wrench. */
EOM_LOCAL void EOM_F(turned_wrench_forces)(const EOM(sizes) *restrict sizes, const EOM(inputs) *restrict inputs, const EOM_SCALAR *here, eom_instant at, const double *restrict q, const double *restrict q_here, const int *restrict is_turned, double *restrict force, EOM_SCALAR *restrict work)
{
    const int nq = EOM_POSITIONS_OF(sizes);
    const int count = EOM_ROTATIONS_OF(sizes);
    EOM_SCALAR *const position = work;
    EOM_SCALAR *const pushed = &work[nq];
    EOM_SCALAR *const other = &work[2 * nq];
    EOM_SCALAR *const total = &work[3 * nq];
    int turned = 0;
    for (int k = 0; k < count; ++k) { turned += is_turned[k]; }
    for (int i = 0; i < nq; ++i) { position[i] = (EOM_SCALAR)q[i]; }
    eom_wrenches_at(inputs, sizes->wrench, at, position, total);
    if (inputs->force_h == NULL) {
        for (int i = 0; i < nq; ++i) { position[i] = (EOM_SCALAR)q_here[i]; }
        (void)inputs->external_force(here, position, total, pushed);
        turned = 0;
    } else if (turned < count) {
        (void)inputs->external_force(inputs->force_h, position, total, pushed);
    } else {
        (void)here;
    }
    if (turned > 0) {
        for (int i = 0; i < nq; ++i) { position[i] = (EOM_SCALAR)q_here[i]; }
        for (int k = 0; k < count; ++k) {
            const int angles = sizes->angles_at[k];
            const int origin = sizes->origin_at[k];
            double near[3] = { 0.0, 0.0, 0.0 };
            if (is_turned[k] != 0) { continue; }
            eom_other_angles(1, &q[angles], near);
            for (int i = 0; i < 3; ++i) {
                position[angles + i] = (EOM_SCALAR)near[i];
                if (origin >= 0) { position[origin + i] = (EOM_SCALAR)q[origin + (i + 1) % 3]; }
            }
        }
        (void)inputs->external_force(inputs->force_turned, position, total, other);
        for (int k = 0; k < count; ++k) {
            const int begin = (sizes->origin_at[k] < 0) ? sizes->angles_at[k] : sizes->origin_at[k];
            if (is_turned[k] != 0) { continue; }
            for (int i = begin; i < sizes->angles_at[k] + 3; ++i) { other[i] = pushed[i]; }
        }
        (void)memcpy(pushed, other, (size_t)nq * sizeof *pushed);
    }
    for (int i = 0; i < nq; ++i) { force[i] = (double)pushed[i]; }
}

/* Add forces of inputs at a share of lanes' steps, as described, to those on the coordinates that there are. */
EOM_LOCAL void EOM_F(add_turned_inputs)(const EOM_F(problem) *restrict problem, double share, EOM_REAL *restrict q, EOM_REAL *restrict v, EOM_REAL *restrict force, EOM_REAL *restrict slope, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    const EOM_F(charts) *const charts = problem->motion.charts;
    const EOM_F(clock) *const clock = &problem->clock;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    EOM_REAL *const q_told = work.state;
    EOM_REAL *const v_told = &q_told[nq];
    double *const position = work.input;
    double *const here = &position[nq];
    double *const u = &here[nq];
    double *const pushed = &u[nu];
    work.state += EOM_STATE_OF(sizes);
    EOM_F(describe)(sizes, charts, 1, q, v, q_told, v_told);
    EOM_F(add_inputs)(problem, share, 0, q_told, v_told, force, slope, work);
    for (int l = 0; l < clock->here; ++l) {
        const eom_prescribed *const motions = clock->inputs[l]->given;
        for (int k = 0; (motions != NULL) && (k < motions->size); ++k) {
            const int i = motions->place[k];
            EOM_LANE_OF(q[i], l) = EOM_LANE_OF(q_told[i], l);
            EOM_LANE_OF(v[i], l) = EOM_LANE_OF(v_told[i], l);
        }
    }
    EOM_F(turn_forces)(sizes, charts, q, force);
    for (int l = 0; l < clock->here; ++l) {
        if (clock->inputs[l]->wrenches == 0U) { continue; }
        for (int i = 0; i < nq; ++i) {
            position[i] = (double)EOM_LANE_OF(q_told[i], l);
            here[i] = (double)EOM_LANE_OF(q[i], l);
        }
        for (int i = 0; i < nu; ++i) { u[i] = (double)EOM_LANE_OF(force[i], l); }
        EOM_F(turned_wrench_forces)(sizes, clock->inputs[l], EOM_HERE_OF(problem->motion.h), EOM_F(instant_at)(clock, l, share), position, here, &charts->is_turned[l * EOM_ROTATIONS_OF(sizes)], pushed, (EOM_SCALAR *)(void *)work.state);
        eom_add_forces(sizes, pushed, u);
        for (int i = 0; i < nu; ++i) { EOM_LANE_OF(force[i], l) = (EOM_SCALAR)u[i]; }
    }
}

/* Put prescribed motions of a lane at a time into x = (q, v).  work: 6 nq. */
EOM_LOCAL void EOM_F(put_prescribed)(const EOM_F(problem) *restrict problem, int l, eom_instant at, EOM_REAL *restrict x, double *restrict work)
{
    const int nq = EOM_POSITIONS_OF(problem->motion.robot->sizes);
    const eom_prescribed *const motions = (problem->clock.inputs[l] == NULL) ? NULL : problem->clock.inputs[l]->given;
    if (motions == NULL) { return; }
    eom_prescribed_at(motions, nq, at, work, &work[nq], &work[2 * nq], &work[3 * nq]);
    for (int k = 0; k < motions->size; ++k) {
        const int i = motions->place[k];
        EOM_LANE_OF(x[i], l) = (EOM_SCALAR)work[k];
        EOM_LANE_OF(x[nq + i], l) = (EOM_SCALAR)work[nq + k];
    }
}

/* Whether drives saturate at limits. */
EOM_LOCAL int EOM_F(saturates)(const EOM_F(problem) *restrict problem)
{
    const EOM(inputs) *const inputs = problem->clock.inputs[0];
    return ((inputs != NULL) ? (inputs->effort != NULL) : (problem->motion.drive->effort != NULL)) ? 1 : 0;
}

/* Whether held drives are all the forces: without control, limits, inputs, and joints that change charts. */
EOM_LOCAL int EOM_F(drives_alone)(const EOM_F(problem) *restrict problem)
{
    const EOM(drive) *const drive = problem->motion.drive;
    return ((EOM_ROTATIONS_OF(problem->motion.robot->sizes) == 0) && (problem->clock.inputs[0] == NULL) && (drive->kp == NULL) && (drive->effort == NULL)) ? 1 : 0;
}

/* Forces u + kp (target - q) - kd v and those of inputs, drives within their limits; slope, if it is not NULL, becomes 0 where
 * these saturate, else 1. */
EOM_LOCAL void EOM_F(forces)(const EOM_F(problem) *restrict problem, double share, int stage, EOM_REAL *restrict q, EOM_REAL *restrict v, EOM_REAL *restrict force, EOM_REAL *restrict slope, EOM_F(workspace) work)
{
    const EOM(drive) *const drive = problem->motion.drive;
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    const EOM(inputs) *const inputs = problem->clock.inputs[0];
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    int gained = 0; /* gains act on joints that stay in their angles, and come first where the sum saturates */
    EOM_F(copy)(nu, problem->u, force);
    if (EOM_ROTATIONS_OF(sizes) > 0) {
        if (inputs != NULL) {
            gained = EOM_F(saturates)(problem);
            for (int i = 0; (gained != 0) && (drive->kp != NULL) && (i < nq); ++i) { force[i] += drive->kp[i] * (problem->target[i] - q[i]) - drive->kd[i] * v[i]; }
            EOM_F(add_turned_inputs)(problem, share, q, v, force, slope, work);
        } else {
            EOM_F(turn_forces)(sizes, problem->motion.charts, q, force);
        }
    }
    if ((gained == 0) && (drive->kp != NULL)) {
        for (int i = 0; i < nq; ++i) { force[i] += drive->kp[i] * (problem->target[i] - q[i]) - drive->kd[i] * v[i]; }
    }
    if ((inputs == NULL) && (drive->effort != NULL)) { EOM_F(saturate)(drive, nu, force, slope); }
    if ((EOM_ROTATIONS_OF(sizes) == 0) && (inputs != NULL)) { EOM_F(add_inputs)(problem, share, stage, q, v, force, slope, work); }
}

/* Gains of drives and of tracking control, by coordinate and lane, whether drives saturate or not. */
EOM_LOCAL void EOM_F(control_gains)(const EOM_F(problem) *restrict problem, EOM_REAL *restrict kp, EOM_REAL *restrict kd)
{
    const EOM(drive) *const drive = problem->motion.drive;
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    for (int i = 0; i < EOM_INPUTS_OF(sizes); ++i) {
        kp[i] = (drive->kp == NULL) ? EOM_WHOLE(EOM_C(0.0)) : EOM_WHOLE(drive->kp[i]);
        kd[i] = (drive->kp == NULL) ? EOM_WHOLE(EOM_C(0.0)) : EOM_WHOLE(drive->kd[i]);
    }
    for (int l = 0; (l < problem->clock.here) && (problem->clock.inputs[0] != NULL); ++l) {
        const eom_tracking *const control = problem->clock.inputs[l]->control;
        if ((control == NULL) || (control->kp == NULL)) { continue; }
        for (int k = 0; k < control->program.signal->columns; ++k) {
            const double ratio = control->ratio[k] * control->ratio[k];
            const int place = control->program.place[k];
            const int i = (EOM_ROTATIONS_OF(sizes) > 0) ? EOM_F(place_of_gain)(sizes, problem->motion.charts, l, place) : place;
            if (i < 0) { continue; } /* gains of angles that are turned act on none: any matrix will do */
            EOM_LANE_OF(kp[i], l) += (EOM_SCALAR)(control->kp[k] / ratio);
            EOM_LANE_OF(kd[i], l) += (EOM_SCALAR)(control->kd[k] / ratio);
        }
    }
}

/* Gains of drives and of tracking control, by coordinate and lane, none where drives saturate; in kp inputs of drives with
 * states, where forces beside them stand.  work: as of forces, and nq + nv + 2 nu. */
EOM_LOCAL void EOM_F(gains)(const EOM_F(problem) *restrict problem, const EOM_REAL *restrict x, EOM_REAL *restrict kp, EOM_REAL *restrict kd, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    const int nu = EOM_INPUTS_OF(sizes);
    const int some = EOM_F(saturates)(problem); /* what saturates does not answer to the state */
    EOM_F(control_gains)(problem, kp, kd);
    if ((some != 0) || (sizes->beside != NULL)) {
        EOM_REAL *restrict const x_here = work.state;
        EOM_REAL *restrict const slope = &x_here[EOM_PADDED_TO_BLOCKS(EOM_STATE_OF(sizes))];
        EOM_REAL *restrict const force = &slope[EOM_PADDED_TO_BLOCKS(nu)];
        work.state = &force[EOM_PADDED_TO_BLOCKS(nu)];
        EOM_F(copy)(EOM_STATE_OF(sizes), x, x_here);
        EOM_F(forces)(problem, 0.0, EOM_INSIDE_STAGE, x_here, &x_here[EOM_POSITIONS_OF(sizes)], force, slope, work);
        for (int i = 0; (some != 0) && (i < nu); ++i) {
            kp[i] *= slope[i];
            kd[i] *= slope[i];
        }
        for (int i = 0; i < EOM_POSITIONS_OF(sizes); ++i) {
            if (eom_force_place(sizes, i) != i) { kp[eom_force_place(sizes, i)] = force[i]; }
        }
    }
}
