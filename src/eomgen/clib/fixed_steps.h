/* fixed_steps.h: steps of fixed length, of one state or of one in every lane. */

/* Forces u + kp (target - q - ahead v) - kd v of drives at a step, saturated; slope as of saturate.  work: nq. */
EOM_LOCAL void EOM_F(held_forces)(const EOM_F(motion) *restrict motion, size_t state, size_t here, size_t step,
        const EOM_REAL *restrict q, const EOM_REAL *restrict v, EOM_SCALAR ahead, EOM_REAL *restrict u,
        EOM_REAL *restrict slope, EOM_REAL *restrict work)
{
    const EOM(drive) *const drive = motion->drive;
    const EOM(sizes) *const sizes = motion->robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    (void)sizes; /* where they are constants */
    EOM_F(load)(&drive->u[state * drive->u_state + step * drive->u_step], drive->u_state, here, nu, u);
#if !defined(EOM_WITHOUT_CHARTS)
    if (EOM_ROTATIONS_OF(sizes) > 0) { EOM_F(turn_forces)(sizes, motion->charts, q, u); }
#endif
    if (drive->kp != NULL) {
        EOM_F(load)(&drive->target[state * drive->target_state + step * drive->target_step], drive->target_state, here,
                nq, work);
        for (int i = 0; i < nq; ++i) { u[i] += drive->kp[i] * (work[i] - q[i] - ahead * v[i]) - drive->kd[i] * v[i]; }
    }
    if (drive->effort != NULL) { EOM_F(saturate)(drive, nu, u, slope); }
}

#if !defined(EOM_HELD)
/* Begin a step at a time, with the row of drives that it holds, where there are inputs; at its ends signals are asked a
 * little inside where they jump there. */
EOM_LOCAL void EOM_F(begin_fixed_step)(EOM_F(problem) *restrict problem, size_t state, size_t step, double begin,
        double end, EOM_REAL *restrict u, EOM_REAL *restrict target)
{
    EOM_F(clock) *const clock = &problem->clock;
    const EOM(inputs) *const inputs = clock->inputs[0];
    const EOM(drive) *const drive = problem->motion.drive;
    const size_t here = (size_t)clock->here;
    const double aside = 1e-3 * (end - begin);
    const double near = 1e-3 * aside; /* sums of steps are not quite where signals jump */
    double after = begin;
    double before = end;
    if (inputs->stops > 0U) {
        if (eom_stops_until(inputs->stop, inputs->stops, begin + near) > eom_stops_until(inputs->stop, inputs->stops,
                begin - near)) {
            after = begin + aside;
        }
        if (eom_stops_until(inputs->stop, inputs->stops, end + near) > eom_stops_until(inputs->stop, inputs->stops, end
                - near)) {
            before = end - aside;
        }
    }
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        clock->begin[l] = begin;
        clock->step[l] = end - begin;
        clock->end[l] = end;
        clock->after[l] = after;
        clock->before[l] = before;
    }
    EOM_F(load)(&drive->u[state * drive->u_state + step * drive->u_step], drive->u_state, here,
            EOM_INPUTS_OF(problem->motion.robot->sizes), u);
    if (drive->kp != NULL) {
        EOM_F(load)(&drive->target[state * drive->target_state + step * drive->target_step], drive->target_state, here,
                EOM_POSITIONS_OF(problem->motion.robot->sizes), target);
    }
    problem->u = u;
    problem->target = target;
}
#endif

/* Take a step of the classical Runge-Kutta method of order 4 for the state x = (q, v), drives held, inputs as they are
 * at each stage.  x is not restrict: GCC 12 at -O3 takes sums for what they were before some stages where it is. */
EOM_LOCAL int EOM_F(rk4_step)(const EOM_F(problem) *restrict problem, size_t state, size_t step, EOM_SCALAR dt,
        EOM_REAL *x, EOM_F(workspace) work)
{
    const EOM(explicit_method) *const method = &eom_explicit_methods[0];
    const EOM_F(motion) *const motion = &problem->motion;
    const EOM_F(robot) *const robot = motion->robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int nx = nq + nv;
    EOM_REAL *restrict const u = work.state;
    EOM_REAL *restrict const x_here = &u[EOM_PADDED_TO_BLOCKS(EOM_INPUTS_OF(robot->sizes))];
    EOM_REAL *restrict const sum = &x_here[EOM_PADDED_TO_BLOCKS(nx)];
    EOM_REAL *restrict const a = &sum[EOM_PADDED_TO_BLOCKS(nx)]; /* nv + 3 m, as what loops violate stands behind it */
    work.state = &a[nv + 3 * EOM_M_OF(robot->sizes)];
    EOM_F(copy)(nx, x, x_here);
    for (int i = 0; i < nx; ++i) { sum[i] = EOM_WHOLE(EOM_C(0.0)); }
    for (int stage = 0; stage < 4; ++stage) {
        const EOM_SCALAR weight = EOM_C(6.0) * method->a[4][stage]; /* whole numbers, by which sums are rounded once */
        const EOM_SCALAR ahead = (stage < 3) ? method->a[stage + 1][stage] : EOM_C(0.0);
#if !defined(EOM_WITHOUT_LOOPS)
        if ((robot->sizes->has_redundant_rows != 0) && (stage > 0)) { /* redundant rows answer to violations */
            const int opened = EOM_F(assemble)(robot, motion->h, x_here, &x_here[nq], work.state, NULL);
            if (opened != 0) { return opened; }
        }
#endif
        if (problem->clock.inputs[0] == NULL) {
            EOM_F(held_forces)(motion, state, (size_t)problem->clock.here, step, x_here, &x_here[nq], EOM_C(0.0), u,
                    NULL, work.state);
        }
#if !defined(EOM_HELD)
        if (problem->clock.inputs[0] != NULL) {
            EOM_F(forces)(problem, method->shares[stage], 0, x_here, &x_here[nq], u, NULL, work);
        }
#endif
        const int status = robot->forward_dynamics(motion->h, x_here, &x_here[nq], u, a);
        if (status != 0) { return status; }
        for (int i = 0; i < nq; ++i) {
            sum[i] += weight * x_here[nq + i];
            x_here[i] = x[i] + ahead * dt * x_here[nq + i];
        }
        for (int i = 0; i < nv; ++i) {
            sum[nq + i] += weight * a[i];
            x_here[nq + i] = x[nq + i] + ahead * dt * a[i];
        }
    }
    for (int i = 0; i < nx; ++i) { x[i] += dt / EOM_C(6.0) * sum[i]; }
    return 0;
}

/* Take a step of the linearly implicit Euler method: springs, dampers and controllers at its end, all else at its
 * beginning; inputs are those of its end, where velocities lead until then. */
EOM_LOCAL int EOM_F(implicit_euler_step)(const EOM_F(problem) *restrict problem, size_t state, size_t step,
        EOM_SCALAR dt, EOM_REAL *restrict x, EOM_F(workspace) work)
{
    const EOM_F(motion) *const motion = &problem->motion;
    const EOM(drive) *const drive = motion->drive;
    const int nq = EOM_POSITIONS_OF(motion->robot->sizes);
    const int nv = EOM_RATES_OF(motion->robot->sizes);
    const int nu = EOM_INPUTS_OF(motion->robot->sizes);
    EOM_REAL *const q = x;
    EOM_REAL *const v = &x[nq];
    EOM_REAL *restrict const u = work.state;
    EOM_REAL *restrict const a = &u[EOM_PADDED_TO_BLOCKS(nu)];
    EOM_REAL *restrict const added = &a[EOM_PADDED_TO_BLOCKS(nv)];
    EOM_REAL *restrict const slope = &added[nu];
    EOM_REAL times[2];
    work.state = &slope[nu];
    times[0] = EOM_WHOLE(dt);
    times[1] = EOM_WHOLE(dt * dt);
    if (problem->clock.inputs[0] == NULL) {
        for (int i = 0; i < nu; ++i) {
            added[i] = (drive->kp == NULL) ? EOM_WHOLE(EOM_C(0.0)) : EOM_WHOLE(dt * (drive->kd[i] + dt * drive->kp[i]));
        }
        EOM_F(held_forces)(motion, state, (size_t)problem->clock.here, step, q, v, dt, u, slope, work.state);
        for (int i = 0; (drive->effort != NULL) && (i < nu); ++i) { added[i] *= slope[i]; }
    }
#if !defined(EOM_HELD)
    if (problem->clock.inputs[0] != NULL) {
        EOM_REAL *restrict const x_end = work.state;
        work.state = &x_end[EOM_PADDED_TO_BLOCKS(nq + nv)];
        EOM_F(control_gains)(problem, added, slope);
        for (int i = 0; i < nu; ++i) {
            added[i] = dt * (slope[i] + dt * added[i]);
            slope[i] = EOM_WHOLE(EOM_C(1.0));
        }
        for (int i = 0; i < nq; ++i) { x_end[i] = q[i] + dt * v[i]; }
        for (int i = 0; i < nv; ++i) { x_end[nq + i] = v[i]; }
        EOM_F(forces)(problem, 1.0, 0, x_end, &x_end[nq], u, slope, work);
        for (int i = 0; i < nu; ++i) { added[i] *= slope[i]; }
    }
#endif
    const int status = motion->robot->implicit_step(motion->h, q, v, u, added, times, a);
    if (status != 0) { return status; }
    for (int i = 0; i < nv; ++i) {
        v[i] += dt * a[i];
        if (i < nq) { q[i] += dt * v[i]; }
    }
    return 0;
}

/* Take steps from one state to the next, from a time on where there are inputs; every so many are stored.  -1, or step
 * * (statuses in a call) + what the step said. */
EOM_LOCAL long long EOM_F(steps)(const EOM_F(robot) *restrict robot, const EOM_REAL *restrict h,
        const EOM(drive) *restrict drive, const EOM(inputs) *restrict inputs, double first, size_t state, size_t here,
        EOM_SCALAR dt, size_t steps, size_t every, int method, EOM_REAL *restrict x, EOM_SCALAR *restrict q_out,
        EOM_SCALAR *restrict v_out, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int statuses = nq + ((EOM_M_OF(sizes) > 0) ? (3 * EOM_M_OF(sizes) + nq) : 0);
    const long long statuses_of_a_step = (long long)statuses * (long long)EOM_WIDTH;
    const size_t rows = steps / every + 1U;
    (void)sizes;
    EOM_F(problem) problem;
    EOM_F(motion) *const motion = &problem.motion;
    EOM_REAL *told = x;
    motion->robot = robot;
    motion->h = h;
    motion->drive = drive;
    problem.clock.power = NULL;
    problem.failed = NULL;
    problem.spare = NULL;
    problem.clock.here = (int)here;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) { problem.clock.inputs[l] = inputs; }
    (void)first;
#if !defined(EOM_HELD)
    EOM_REAL *const u = work.state;
    EOM_REAL *const target = &u[EOM_PADDED_TO_BLOCKS(EOM_INPUTS_OF(sizes))];
    if (inputs != NULL) { work.state = &target[EOM_PADDED_TO_BLOCKS(nq)]; }
#endif
    EOM_F(store)(x, here, rows * (size_t)nq, nq, q_out);
    EOM_F(store)(&x[nq], here, rows * (size_t)nv, nv, v_out);
#if !defined(EOM_WITHOUT_CHARTS)
    EOM_F(charts) charts;
    size_t place[EOM_WIDTH] = { 0 };
    motion->charts = NULL;
    if (EOM_ROTATIONS_OF(sizes) > 0) {
        for (size_t l = 0; l < (size_t)EOM_WIDTH; ++l) { place[l] = state + ((l < here) ? l : (here - 1U)); }
        EOM_F(carve_charts)(sizes, &charts, &work);
        told = work.state;
        work.state += nq + nv;
        motion->charts = &charts;
        motion->h = charts.h;
        EOM_F(begin_charts)(sizes, h, drive->kp, drive->kd, &charts, x, &x[nq]);
        EOM_F(resume_charts)(sizes, drive, place, &charts, x, &x[nq]);
    }
#endif
    for (size_t step = 0; step < steps; ++step) {
#if !defined(EOM_HELD)
        if (inputs != NULL) {
            EOM_F(begin_fixed_step)(&problem, state, step, first + (double)step * (double)dt, first
                    + (double)(step + 1U) * (double)dt, u, target);
        }
#endif
        const int status = (method == 0) ? EOM_F(rk4_step)(&problem, state, step, dt, x, work)
                : EOM_F(implicit_euler_step)(&problem, state, step, dt, x, work);
        if (status != 0) { return (long long)step * statuses_of_a_step + status - 1; }
#if !defined(EOM_HELD)
        for (int l = 0; (inputs != NULL) && (l < (int)here); ++l) {
            EOM_F(put_prescribed)(&problem, l, (EOM_M_OF(sizes) > 0) ? eom_instant_of(problem.clock.end[l])
                    : EOM_F(instant_at)(&problem.clock, l, 1.0), x, work.input);
        }
#endif
#if !defined(EOM_WITHOUT_LOOPS)
        if (EOM_M_OF(sizes) > 0) {
            const int opened = EOM_F(assemble)(robot, motion->h, x, &x[nq], work.state, NULL);
            if (opened != 0) { return (long long)step * statuses_of_a_step + opened - 1; }
        }
#endif
#if !defined(EOM_WITHOUT_CHARTS)
        if (EOM_ROTATIONS_OF(sizes) > 0) { (void)EOM_F(change_charts)(sizes, &charts, x, &x[nq]); }
#endif
        if ((step + 1U) % every == 0U) {
#if !defined(EOM_WITHOUT_CHARTS)
            if (EOM_ROTATIONS_OF(sizes) > 0) { EOM_F(describe)(sizes, &charts, 0, x, &x[nq], told, &told[nq]); }
#endif
            EOM_F(store)(told, here, rows * (size_t)nq, nq, &q_out[(step + 1U) / every * (size_t)nq]);
            EOM_F(store)(&told[nq], here, rows * (size_t)nv, nv, &v_out[(step + 1U) / every * (size_t)nv]);
        }
    }
#if !defined(EOM_WITHOUT_CHARTS)
    if (EOM_ROTATIONS_OF(sizes) > 0) { EOM_F(keep_charts)(sizes, drive, place, here, &charts, x, &x[nq]); }
#endif
    return -1;
}
