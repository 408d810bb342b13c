/* input_sensitivities.h: adjoints and tangents of the forces of drives and inputs in a step; of one state.
 *
 * Adjoints go back: they add, to derivatives of a sum by what is in front of them, those that come by what is behind.  Tangents
 * carry rates along directions forwards. */

/* Add derivatives by gains in the matrix of a step, by coordinate, to those by gains of the controller and of tracking
 * control. */
EOM_LOCAL void EOM(gains_adjoint)(const EOM(interval) *restrict interval, int i, EOM_SCALAR by_kp, EOM_SCALAR by_kd, const EOM(slopes) *restrict slopes)
{
    const eom_tracking *const control = (interval->inputs == NULL) ? NULL : interval->inputs->control;
    const int gains = eom_gains_of(control);
    if (interval->drive->kp != NULL) {
        slopes->kp[i] += by_kp;
        slopes->kd[i] += by_kd;
    }
    for (int k = 0; k < gains; ++k) {
        const double ratio = control->ratio[k] * control->ratio[k];
        if (control->program.place[k] != i) { continue; }
        slopes->loads->kp[k] += (double)by_kp / ratio;
        slopes->loads->kd[k] += (double)by_kd / ratio;
    }
}

/* Add derivatives by parameters. */
EOM_LOCAL void EOM(parameters_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict gradient, const EOM(slopes) *restrict slopes)
{
    const int count = EOM(sizes_of)(interval)->parameters;
    EOM_SCALAR *restrict const by = slopes->parameters;
    for (int i = 0; i < count; ++i) { by[i] += gradient[i]; }
}

/* Add derivatives by a spline's columns at a time, their rates and accelerations to those by its coefficients; its profile
 * counts as constant. */
EOM_LOCAL void eom_spline_adjoint(const eom_spline *restrict spline, eom_instant at, const double *restrict by_x, const double *restrict by_dx, const double *restrict by_ddx, double *restrict slope)
{
    const size_t columns = (size_t)spline->columns;
    double ds = 1.0;
    double dds = 0.0;
    double ahead = 0.0;
    int inside = 0;
    const eom_instant where = (spline->profile == NULL) ? at : eom_profile_at(spline->profile, at, &ds, &dds);
    const int piece = eom_piece_at(spline, where, &ahead, &inside);
    double *const piece_slope = &slope[(size_t)piece * ((size_t)spline->degree + 1U) * columns];
    for (size_t i = 0; i < columns; ++i) {
        const double by_rate = (inside != 0) ? (by_dx[i] * ds + by_ddx[i] * dds) : 0.0;
        const double by_second = (inside != 0) ? (by_ddx[i] * ds * ds) : 0.0;
        double value = 1.0;
        double rate = 0.0;
        double second = 0.0;
        for (int power = 0; power <= spline->degree; ++power) { /* ahead to this power, and its derivatives */
            piece_slope[(size_t)power * columns + i] += by_x[i] * value + by_rate * rate + by_second * second;
            second = second * ahead + 2.0 * rate;
            rate = rate * ahead + value;
            value *= ahead;
        }
    }
}

/* Add derivatives by prescribed motions, their rates and accelerations, n numbers each, to those by their signals.  work: 3 n. */
EOM_LOCAL void eom_prescribed_adjoint(const eom_prescribed *restrict motions, int n, eom_instant at, const double *restrict by, const eom_input_slopes *restrict slopes, double *restrict work)
{
    for (int k = 0; k < motions->count; ++k) {
        const eom_track *const track = &motions->tracks[k];
        for (int i = 0; i < track->signal->columns; ++i) {
            const int place = track->place[i];
            int last = 1; /* a later track may stand in its place */
            for (int later = k + 1; later < motions->count; ++later) {
                for (int j = 0; j < motions->tracks[later].signal->columns; ++j) { last = (motions->tracks[later].place[j] == place) ? 0 : last; }
            }
            for (int order = 0; order < 3; ++order) { work[order * n + i] = (last != 0) ? by[order * n + place] : 0.0; }
        }
        eom_spline_adjoint(track->signal, at, work, &work[n], &work[2 * n], slopes->tracks[k]);
    }
}

/* Go back from a state into which prescribed motions were put, if there are any. */
EOM_LOCAL void EOM(prescribe_adjoint)(const EOM(interval) *restrict interval, eom_instant at, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes)
{
    const eom_prescribed *const motions = EOM(prescribed_of)(interval);
    const int nq = EOM(positions_of)(interval);
    double *const by = interval->room.input;
    if (motions == NULL) { return; }
    (void)memset(by, 0, (size_t)(3 * nq) * sizeof *by);
    for (int i = 0; i < motions->size; ++i) {
        by[i] = (double)by_q[motions->place[i]];
        by[nq + i] = (double)by_v[motions->place[i]];
        by_q[motions->place[i]] = EOM_C(0.0);
        by_v[motions->place[i]] = EOM_C(0.0);
    }
    eom_prescribed_adjoint(motions, nq, at, by, slopes->loads, &by[3 * nq]);
}

/* Go back through a wrench in points or axes of a frame, from derivatives by what acts on its link, by_row, to those by its
 * numbers, row, and by the frame's pose. */
EOM_LOCAL void EOM(framed_wrench_adjoint)(const eom_wrench *restrict wrench, const EOM_SCALAR *restrict pose, const double *restrict row, double *restrict by_row, EOM_SCALAR *restrict by_pose)
{
    double turned_row[6];
    double arm[3];
    double by_arm[3] = { 0.0, 0.0, 0.0 };
    EOM(turn_wrench)(wrench, pose, row, turned_row, arm);
    eom_add_cross(&by_row[3], arm, by_row);
    eom_add_cross(turned_row, &by_row[3], by_arm);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            double sum = by_arm[i] * wrench->arm[j];
            if (wrench->turns != 0) { sum += by_row[i] * row[j] + by_row[3 + i] * row[3 + j]; }
            by_pose[4 * i + j] += (EOM_SCALAR)sum;
        }
    }
    if (wrench->turns != 0) {
        (void)memcpy(turned_row, by_row, sizeof turned_row);
        EOM(turn_vector)(pose, 0, turned_row, by_row);
        EOM(turn_vector)(pose, 0, &turned_row[3], &by_row[3]);
    }
}

/* Add what wrenches do, by weights of the forces that they make, to derivatives by where they act, by their signals and by
 * parameters.  work: 4 nq + 2 wrench + 2 parameters + poses. */
EOM_LOCAL void EOM(wrenches_adjoint)(const EOM(interval) *restrict interval, eom_instant at, const double *restrict position, const double *restrict weight, double *restrict by_position, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(inputs) *const inputs = interval->inputs;
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int behind = nq + sizes->wrench;
    EOM_SCALAR *const q = work;
    EOM_SCALAR *const total = &q[nq];
    EOM_SCALAR *const pushed = &total[sizes->wrench];
    EOM_SCALAR *const gradient = &pushed[nq];
    EOM_SCALAR *const by_poses = &gradient[behind + sizes->parameters];
    EOM_SCALAR *const turned = &by_poses[EOM_KNOWN(interval->derivatives)->poses];
    int framed = 0;
    (void)memset(by_poses, 0, (size_t)EOM_KNOWN(interval->derivatives)->poses * sizeof *by_poses);
    for (int i = 0; i < nq; ++i) {
        q[i] = (EOM_SCALAR)position[i];
        pushed[i] = (eom_is_prescribed(sizes, i) != 0) ? EOM_C(0.0) : (EOM_SCALAR)weight[eom_force_place(sizes, i)];
    }
    eom_wrenches_at(inputs, sizes->wrench, at, q, total);
    (void)inputs->force_back(inputs->force_back_h, q, total, pushed, gradient);
    for (size_t k = 0; k < inputs->wrenches; ++k) {
        const eom_wrench *const wrench = &inputs->wrench[k];
        const double none[6] = { 0.0, 0.0, 0.0, 0.0, 0.0, 0.0 };
        double row[6];
        double by_row[6];
        eom_wrench_at(wrench, at, row);
        for (int i = 0; i < 6; ++i) { by_row[i] = (double)gradient[nq + 6 * wrench->link + i]; }
        if (wrench->frame >= 0) {
            EOM_SCALAR pose[16];
            framed = 1;
            (void)inputs->frame_pose(inputs->frame_h, q, wrench->frame, pose);
            EOM(framed_wrench_adjoint)(wrench, pose, row, by_row, &by_poses[12 * wrench->frame]);
        }
        if ((wrench->t0 <= at.beside) && (at.beside < wrench->t1)) { eom_spline_adjoint(wrench->signal, at, by_row, none, none, slopes->loads->wrench[k]); }
    }
    if (framed != 0) {
        (void)inputs->pose_back(inputs->pose_back_h, q, by_poses, turned);
        for (int i = 0; i < nq; ++i) { gradient[i] += turned[i]; }
        for (int i = 0; i < sizes->parameters; ++i) { gradient[behind + i] += turned[nq + i]; }
    }
    for (int i = 0; i < nq; ++i) { by_position[i] += (double)gradient[i]; }
    EOM(parameters_adjoint)(interval, &gradient[behind], slopes);
}

/* Add what computed torque does, by weights of its forces, to derivatives by where it acts, by its reference, x, dx and ddx of
 * which derivatives are by_x, by its bandwidth and by prescribed accelerations.  work: 4 n. */
EOM_LOCAL void eom_computed_torque_adjoint(const eom_computed_torque *restrict model, int n, const double *restrict x, const double *restrict asked, const double *restrict weight, double *restrict by_position, double *restrict by_rate, double *restrict by_prescribed, double *restrict by_x, const eom_input_slopes *restrict slopes, double *restrict work)
{
    const double b = model->bandwidth;
    double *const answer = work;
    double *const gradient = &answer[n];
    for (int i = 0; i < model->size; ++i) { answer[i] = (model->given[i] < 0) ? (weight[model->place[i]] / model->ratio[i]) : 0.0; }
    (void)model->back(model->back_h, asked, &asked[n], &asked[2 * n], answer, gradient);
    for (int i = 0; i < model->size; ++i) {
        const int column = model->column[i];
        const int place = model->place[i];
        const double by_a = (model->holds != 0) ? 0.0 : gradient[2 * model->size + i];
        double by_q = gradient[i];
        double by_v = gradient[model->size + i];
        if ((model->holds == 0) && (column >= 0)) {
            by_x[column] += b * b * by_a;
            by_x[n + column] += 2.0 * b * by_a;
            by_x[2 * n + column] += by_a;
            by_q -= b * b * by_a;
            by_v -= 2.0 * b * by_a;
            *slopes->bandwidth += by_a * 2.0 * (b * (x[column] - asked[i]) + (x[n + column] - asked[n + i]));
        } else if ((model->holds == 0) && (model->given[i] >= 0)) {
            by_prescribed[model->given[i]] += by_a / model->ratio[i];
        } else {
            by_v = (model->holds != 0) ? 0.0 : by_v;
        }
        by_position[place] += by_q / model->ratio[i];
        by_rate[place] += by_v / model->ratio[i];
    }
}

/* Add what tracking control and computed torque do, by weights of their forces, to derivatives by where they act, by what they
 * are made of and by prescribed accelerations.  work: 10 n. */
EOM_LOCAL void eom_control_adjoint(const eom_tracking *restrict control, const eom_computed_torque *restrict model, int n, eom_instant at, const double *restrict position, const double *restrict rate, const double *restrict asked, const double *restrict weight, double *restrict by_position, double *restrict by_rate, double *restrict by_prescribed, const eom_input_slopes *restrict slopes, double *restrict work)
{
    double *const x = work;
    double *const by_x = &x[3 * n];
    (void)memset(by_x, 0, (size_t)(3 * n) * sizeof *by_x);
    eom_spline_at(control->program.signal, at, x, &x[n], &x[2 * n]);
    for (int i = 0; i < eom_gains_of(control); ++i) {
        const int place = control->program.place[i];
        const double ratio = control->ratio[i];
        const double force = weight[place] / ratio;
        by_x[i] += control->kp[i] * force;
        by_x[n + i] += control->kd[i] * force;
        by_position[place] -= control->kp[i] * force / ratio;
        by_rate[place] -= control->kd[i] * force / ratio;
        slopes->kp[i] += force * (x[i] - position[place] / ratio);
        slopes->kd[i] += force * (x[n + i] - rate[place] / ratio);
    }
    if (model != NULL) { eom_computed_torque_adjoint(model, n, x, asked, weight, by_position, by_rate, by_prescribed, by_x, slopes, &by_x[3 * n]); }
    eom_spline_adjoint(control->program.signal, at, by_x, &by_x[n], &by_x[2 * n], slopes->program);
}

/* Add what inputs do, by derivatives by forces, to those by q and v and by what inputs are made of; by_u become derivatives by
 * the drives in front of saturation, zero of forces that prescribed accelerations replace. */
EOM_LOCAL void EOM(inputs_adjoint)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict slope, EOM_SCALAR *restrict by_u, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes)
{
    const EOM(inputs) *const inputs = interval->inputs;
    const eom_prescribed *const moved = inputs->given;
    const eom_instant at = EOM(instant_within)(interval, share);
    const eom_instant within = eom_within_span(inputs->first, inputs->last, at);
    const int nq = EOM(positions_of)(interval);
    const int nu = EOM(inputs_of)(interval);
    double *const position = interval->room.input;
    double *const rate = &position[nq];
    double *const prescribed = &rate[EOM(rates_of)(interval)];
    double *const asked = &prescribed[nu];
    double *const weight = &asked[3 * nu];
    double *const pull = &weight[nu];
    double *const force = &pull[nu]; /* zeros: forces, and derivatives by position, by rate and by prescribed motions */
    double *const by_position = &force[nu];
    double *const by_rate = &by_position[nq];
    double *const by = &by_rate[nq];
    double *const rest = &by[3 * nu];
    (void)memset(force, 0, (size_t)(rest - force) * sizeof *force);
    EOM(evaluate_inputs)(interval, share, ahead, q, v, position, rate, force, prescribed, asked, rest);
    for (int i = 0; i < nu; ++i) { weight[i] = (double)by_u[i]; }
    for (int i = 0; (moved != NULL) && (i < moved->size); ++i) { /* accelerations stand in their places */
        by[2 * nu + i] = weight[moved->place[i]];
        weight[moved->place[i]] = 0.0;
        by_u[moved->place[i]] = EOM_C(0.0);
    }
    (void)memcpy(pull, weight, (size_t)nu * sizeof *pull);
    for (int i = 0; i < nu; ++i) {
        weight[i] *= (double)slope[i];
        by_u[i] *= slope[i];
    }
    if (inputs->torque != NULL) {
        for (int i = 0; i < inputs->torque->signal->columns; ++i) { rest[i] = weight[inputs->torque->place[i]]; }
        eom_spline_adjoint(inputs->torque->signal, within, rest, &by[nu], &by[nu], slopes->loads->torque);
    }
    if (inputs->control != NULL) { eom_control_adjoint(inputs->control, inputs->model, nu, within, position, rate, asked, weight, by_position, by_rate, &by[2 * nu], slopes->loads, rest); }
    if (inputs->wrenches > 0U) { EOM(wrenches_adjoint)(interval, within, position, pull, by_position, slopes, &interval->room.state[2 * nu]); }
    if (moved != NULL) { /* position and rate are where these motions are */
        for (int i = 0; i < moved->size; ++i) {
            by[i] += by_position[moved->place[i]];
            by[nu + i] += by_rate[moved->place[i]];
            by_position[moved->place[i]] = 0.0;
            by_rate[moved->place[i]] = 0.0;
        }
        eom_prescribed_adjoint(moved, nu, at, by, slopes->loads, rest);
    }
    for (int i = 0; i < nq; ++i) {
        by_q[i] += (EOM_SCALAR)by_position[i];
        by_v[i] += ahead * (EOM_SCALAR)by_position[i] + (EOM_SCALAR)by_rate[i];
    }
}

/* Add what forces_within does, by derivatives by its forces, to those by q and v, by drives, by the controller and by inputs;
 * by_u become derivatives by the drives in front of saturation. */
EOM_LOCAL void EOM(forces_adjoint)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict by_u, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes)
{
    const EOM(drive) *const drive = interval->drive;
    const int nu = EOM(inputs_of)(interval);
    EOM_SCALAR *restrict const by_drive = &slopes->u[interval->row * drive->u_step];
    EOM_SCALAR *restrict const slope = interval->room.state;
    EOM(saturation_within)(interval, share, ahead, q, v, slope);
    if (interval->inputs != NULL) { EOM(inputs_adjoint)(interval, share, ahead, q, v, slope, by_u, by_q, by_v, slopes); }
    for (int i = 0; (interval->inputs == NULL) && (i < nu); ++i) { by_u[i] *= slope[i]; }
    for (int i = 0; i < nu; ++i) { by_drive[i] += by_u[i]; }
    if (drive->kp == NULL) { return; }
    EOM_SCALAR *restrict const by_target = &slopes->target[interval->row * drive->target_step];
    const EOM_SCALAR *const target = &drive->target[interval->row * drive->target_step];
    for (int i = 0; i < EOM(positions_of)(interval); ++i) {
        by_q[i] -= drive->kp[i] * by_u[i];
        by_v[i] -= (drive->kp[i] * ahead + drive->kd[i]) * by_u[i];
        by_target[i] += drive->kp[i] * by_u[i];
        slopes->kp[i] += by_u[i] * (target[i] - q[i] - ahead * v[i]);
        slopes->kd[i] -= by_u[i] * v[i];
    }
}

/* Set rates of prescribed coordinates to zero: their motions move along no direction. */
EOM_LOCAL void EOM(prescribe_tangent)(const EOM(interval) *restrict interval, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv)
{
    const eom_prescribed *const motions = EOM(prescribed_of)(interval);
    for (int i = 0; (motions != NULL) && (i < motions->size); ++i) {
        dq[motions->place[i]] = EOM_C(0.0);
        dv[motions->place[i]] = EOM_C(0.0);
    }
}

/* Rates of what a wrench in points or axes of a frame does to its link, along those of the frame's pose, dpose. */
EOM_LOCAL void EOM(framed_wrench_tangent)(const eom_wrench *restrict wrench, const EOM_SCALAR *restrict pose, const EOM_SCALAR *restrict dpose, const double *restrict row, double *restrict moved_row)
{
    double turned_row[6];
    double arm[3];
    double moved_arm[3];
    EOM(turn_wrench)(wrench, pose, row, turned_row, arm);
    EOM(turn_wrench)(wrench, dpose, row, moved_row, moved_arm);
    if (wrench->turns == 0) { (void)memset(moved_row, 0, sizeof turned_row); }
    eom_add_cross(moved_arm, turned_row, &moved_row[3]);
    eom_add_cross(arm, moved_row, &moved_row[3]);
}

/* Rates of the forces that wrenches make, along those of q and of parameters.  work: 2 nq + 2 wrench + 2 poses. */
EOM_LOCAL void EOM(wrenches_tangent)(const EOM(interval) *restrict interval, eom_instant at, const double *restrict position, const EOM_SCALAR *restrict dq, const EOM_SCALAR *restrict dp, EOM_SCALAR *restrict force, EOM_SCALAR *restrict work)
{
    const EOM(inputs) *const inputs = interval->inputs;
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int poses = EOM_KNOWN(interval->derivatives)->poses;
    const int nq = EOM_POSITIONS_OF(sizes);
    EOM_SCALAR *const q = work;
    EOM_SCALAR *const more = &q[nq];
    EOM_SCALAR *const total = &more[nq];
    EOM_SCALAR *const dtotal = &total[sizes->wrench];
    EOM_SCALAR *const turning = &dtotal[sizes->wrench];
    EOM_SCALAR *const turning_too = &turning[poses];
    int framed = 0;
    for (int i = 0; i < nq; ++i) { q[i] = (EOM_SCALAR)position[i]; }
    (void)memset(dtotal, 0, (size_t)sizes->wrench * sizeof *dtotal);
    eom_wrenches_at(inputs, sizes->wrench, at, q, total);
    for (size_t k = 0; k < inputs->wrenches; ++k) { framed = (inputs->wrench[k].frame >= 0) ? 1 : framed; }
    if (framed != 0) {
        (void)inputs->pose_along(inputs->pose_along_h, q, dq, turning);
        (void)inputs->pose_by(inputs->pose_by_h, q, dp, turning_too);
        for (int i = 0; i < poses; ++i) { turning[i] += turning_too[i]; }
    }
    for (size_t k = 0; k < inputs->wrenches; ++k) {
        const eom_wrench *const wrench = &inputs->wrench[k];
        EOM_SCALAR pose[16];
        double row[6];
        double moved_row[6];
        if (wrench->frame < 0) { continue; }
        (void)inputs->frame_pose(inputs->frame_h, q, wrench->frame, pose);
        eom_wrench_at(wrench, at, row);
        EOM(framed_wrench_tangent)(wrench, pose, &turning[12 * wrench->frame], row, moved_row);
        for (int i = 0; i < 6; ++i) { dtotal[6 * wrench->link + i] += (EOM_SCALAR)moved_row[i]; }
    }
    (void)inputs->force_along(inputs->force_along_h, q, total, dq, dtotal, force);
    (void)inputs->force_by(inputs->force_by_h, q, total, dp, more);
    for (int i = 0; i < nq; ++i) { force[i] += more[i]; }
}

/* Add rates of tracking control and computed torque along those of q and v to those of forces.  work: 4 n. */
EOM_LOCAL void EOM(control_tangent)(const eom_tracking *restrict control, const eom_computed_torque *restrict model, int n, const double *restrict asked, const EOM_SCALAR *restrict dq, const EOM_SCALAR *restrict dv, double *restrict force, double *restrict work)
{
    for (int k = 0; k < eom_gains_of(control); ++k) {
        const int place = control->program.place[k];
        const double ratio = control->ratio[k];
        force[place] -= (control->kp[k] * (double)dq[place] + control->kd[k] * (double)dv[place]) / (ratio * ratio);
    }
    if (model != NULL) {
        const double b = model->bandwidth;
        double *const moving = work;
        double *const answer = &moving[3 * n];
        for (int i = 0; i < model->size; ++i) {
            const int place = model->place[i];
            moving[i] = (double)dq[place] / model->ratio[i];
            moving[n + i] = (model->holds != 0) ? 0.0 : ((double)dv[place] / model->ratio[i]);
            moving[2 * n + i] = ((model->holds != 0) || (model->column[i] < 0)) ? 0.0 : (-b * (b * moving[i] + 2.0 * moving[n + i]));
        }
        (void)model->along(model->along_h, asked, &asked[n], &asked[2 * n], moving, &moving[n], &moving[2 * n], answer);
        for (int i = 0; i < model->size; ++i) {
            if (model->given[i] < 0) { force[model->place[i]] += answer[i] / model->ratio[i]; }
        }
    }
}

/* Add rates of the forces of inputs, along those of q, v and parameters, to du, rates of drives; none where these saturate. */
EOM_LOCAL void EOM(inputs_tangent)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict slope, const EOM_SCALAR *restrict dq, const EOM_SCALAR *restrict dv, const EOM_SCALAR *restrict dp, EOM_SCALAR *restrict du)
{
    const EOM(inputs) *const inputs = interval->inputs;
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    double *const position = interval->room.input;
    double *const rate = &position[nq];
    double *const force = &rate[EOM_RATES_OF(sizes)];
    double *const prescribed = &force[nu];
    double *const asked = &prescribed[nu];
    double *const rest = &asked[3 * nu];
    EOM_SCALAR *const moved = &interval->room.state[2 * nu];
    EOM_SCALAR *const speed = &moved[nq];
    EOM_SCALAR *const pushed = &speed[nq];
    (void)memset(force, 0, (size_t)nu * sizeof *force);
    EOM(evaluate_inputs)(interval, share, ahead, q, v, position, rate, force, prescribed, asked, rest);
    for (int i = 0; i < nq; ++i) {
        moved[i] = dq[i] + ahead * dv[i];
        speed[i] = dv[i];
    }
    for (int i = 0; i < nu; ++i) { force[i] = (double)du[i]; }
    EOM(prescribe_tangent)(interval, moved, speed);
    if (inputs->control != NULL) { EOM(control_tangent)(inputs->control, inputs->model, nu, asked, moved, speed, force, rest); }
    for (int i = 0; i < nu; ++i) { force[i] *= (double)slope[i]; }
    for (int i = 0; (inputs->given != NULL) && (i < inputs->given->size); ++i) { force[inputs->given->place[i]] = 0.0; }
    for (int i = 0; i < nu; ++i) { du[i] = (EOM_SCALAR)force[i]; }
    if (inputs->wrenches > 0U) {
        EOM(wrenches_tangent)(interval, eom_within_span(inputs->first, inputs->last, EOM(instant_within)(interval, share)), position, moved, dp, pushed, &pushed[nq]);
        for (int i = 0; i < nq; ++i) { du[eom_force_place(sizes, i)] += (eom_is_prescribed(sizes, i) != 0) ? EOM_C(0.0) : pushed[i]; }
    }
}

/* Rates of the forces of forces_within along a direction. */
EOM_LOCAL void EOM(forces_tangent)(const EOM(interval) *restrict interval, double share, EOM_SCALAR ahead, const EOM(rates) *restrict rates, size_t direction, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict dq, const EOM_SCALAR *restrict dv, EOM_SCALAR *restrict du)
{
    const EOM(drive) *const drive = interval->drive;
    const int nu = EOM(inputs_of)(interval);
    EOM_SCALAR *restrict const slope = interval->room.state;
    (void)memcpy(du, &rates->u[direction * rates->u_direction + interval->row * rates->u_step], (size_t)nu * sizeof *du);
    for (int i = 0; (i < EOM(positions_of)(interval)) && (drive->kp != NULL); ++i) { du[i] -= drive->kp[i] * (dq[i] + ahead * dv[i]) + drive->kd[i] * dv[i]; }
    EOM(saturation_within)(interval, share, ahead, q, v, slope);
    if (interval->inputs != NULL) { EOM(inputs_tangent)(interval, share, ahead, q, v, slope, dq, dv, &rates->parameters[direction * (size_t)EOM(sizes_of)(interval)->parameters], du); }
    for (int i = 0; (interval->inputs == NULL) && (i < nu); ++i) { du[i] *= slope[i]; }
}
