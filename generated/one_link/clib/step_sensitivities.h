/* step_sensitivities.h: steps with all that their derivatives need, their adjoints and tangents; of one state.
 *
 * A step is taken forwards, and numbers of its stages are kept: of an explicit method the accelerations of each, with closed
 * loops and q and v of each behind them; of the linearly implicit Euler method, with closed loops, its accelerations; of the
 * Rosenbrock method what each stage is solved for and the rates' parts, with closed loops all six rows of a stage: q and v,
 * rates and shifts that are solved with, and parts of q and v. */

/* Whether states of stages are assembled, too. */
EOM_LOCAL int EOM(assembles_stages)(const EOM(sizes) *restrict sizes)
{
    return ((M_OF(sizes) > 0) && (sizes->has_redundant_rows != 0)) ? 1 : 0;
}

/* Numbers of a function that failed are none, so that no derivative passes for one. */
EOM_LOCAL void EOM(refuse_failed)(int status, int count, EOM_SCALAR *restrict out)
{
    for (int i = 0; (i < count) && (status != 0); ++i) { out[i] = (EOM_SCALAR)NAN; }
}

/* Go back from an assembled state to the one, q and v, that assemble began with: its passes once more, then each of them back.
 * work: 18 n + 2 m + parameters. */
EOM_LOCAL void EOM(assemble_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = KNOWN(interval->derivatives)->robot;
    const int n = N_OF(robot->sizes);
    const int m = M_OF(robot->sizes);
    EOM_SCALAR *const on_way = work; /* (passes, n) */
    EOM_SCALAR *const change = &on_way[12 * n];
    EOM_SCALAR *const weight = &change[2 * n + m];
    EOM_SCALAR *const gradient = &weight[2 * n + m];
    int passes = 0;
    int settled = 0;
    (void)memcpy(on_way, q, (size_t)n * sizeof *on_way);
    while ((settled == 0) && (passes < 12)) {
        EOM_SCALAR *const here = &on_way[passes * n];
        EOM(refuse_failed)(robot->settling(interval->h, here, v, change), n, change);
        settled = 1;
        for (int r = 2 * n; r < 2 * n + m; ++r) {
            if (!(EOM_MATH(fabs)(change[r]) <= robot->sizes->closed_gap)) { settled = 0; }
        }
        ++passes;
        for (int i = 0; (i < n) && (passes < 12); ++i) { here[n + i] = here[i] + change[i]; }
    }
    for (int k = passes - 1; k >= 0; --k) {
        for (int i = 0; i < n; ++i) {
            weight[i] = by_q[i];
            weight[n + i] = (k == passes - 1) ? by_v[i] : (EOM_SCALAR)0.0;
        }
        for (int r = 2 * n; r < 2 * n + m; ++r) { weight[r] = (EOM_SCALAR)0.0; }
        EOM(refuse_failed)(KNOWN(interval->derivatives)->settling_adjoint(interval->h, &on_way[k * n], v, weight, gradient), n, gradient);
        for (int i = 0; i < n; ++i) {
            by_q[i] += gradient[i];
            by_v[i] += gradient[n + i];
        }
        EOM(parameters_adjoint)(interval, &gradient[2 * n], slopes);
    }
}

/* Carry rates dq and dv of the state that assemble begins with to those of the assembled one.  work: 5 n + 2 m. */
EOM_LOCAL void EOM(assemble_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict dp, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = KNOWN(interval->derivatives)->robot;
    const int n = N_OF(robot->sizes);
    const int m = M_OF(robot->sizes);
    EOM_SCALAR *const q_here = work;
    EOM_SCALAR *const change = &q_here[n];
    EOM_SCALAR *const moved = &change[2 * n + m];
    int settled = 0;
    (void)memcpy(q_here, q, (size_t)n * sizeof *q_here);
    for (int pass = 0; (pass < 12) && (settled == 0); ++pass) {
        EOM(refuse_failed)(robot->settling(interval->h, q_here, v, change), n, change);
        EOM(refuse_failed)(KNOWN(interval->derivatives)->settling_tangent(interval->h, q_here, v, dq, dv, dp, moved), n, moved);
        settled = 1;
        for (int r = 2 * n; r < 2 * n + m; ++r) {
            if (!(EOM_MATH(fabs)(change[r]) <= robot->sizes->closed_gap)) { settled = 0; }
        }
        for (int i = 0; i < n; ++i) {
            q_here[i] += change[i];
            dq[i] += moved[i];
        }
    }
    for (int i = 0; i < n; ++i) { dv[i] += moved[n + i]; }
}

/* The explicit method of a step. */
EOM_INLINE const EOM(explicit_method) *EOM(explicit_of)(const EOM(interval) *restrict interval)
{
    return &eom_explicit_methods[interval->method / EOM_KINDS];
}

/* The state in front of a stage of an explicit method, or behind the last one, from the stages' states (q, then v), of each at
 * 2 n stage, and accelerations a, or the same of rates. */
EOM_LOCAL void EOM(explicit_stage)(const EOM(interval) *restrict interval, int stage, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict a, const EOM_SCALAR *restrict states, EOM_SCALAR *restrict q_here, EOM_SCALAR *restrict v_here)
{
    const int n = EOM(size_of)(interval);
    (void)memcpy(q_here, q, (size_t)n * sizeof *q);
    (void)memcpy(v_here, v, (size_t)n * sizeof *v);
    for (int j = 0; j < stage; ++j) {
        const EOM_SCALAR share = interval->dt * EOM(explicit_of)(interval)->a[stage][j];
        const EOM_SCALAR *const rates = &states[2 * n * j + n];
        const EOM_SCALAR *const changes = &a[n * j];
        if (!(EOM_MATH(fabs)(share) > (EOM_SCALAR)0.0)) { continue; }
        for (int i = 0; i < n; ++i) {
            q_here[i] += share * rates[i];
            v_here[i] += share * changes[i];
        }
    }
}

/* States of all stages from what is kept: with closed loops they are; else into room, 12 n. */
EOM_INLINE const EOM_SCALAR *EOM(explicit_states)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *kept, EOM_SCALAR *room)
{
    const int n = EOM(size_of)(interval);
    if (M_OF(EOM(sizes_of)(interval)) > 0) { return &kept[n * EXPLICIT_STAGES]; }
    for (int s = 0; s < EOM(explicit_of)(interval)->stages; ++s) {
        EOM_SCALAR *const here = &room[2 * n * s];
        EOM(explicit_stage)(interval, s, q, v, kept, room, here, &here[n]);
        EOM(prescribe_within)(interval, EOM(explicit_of)(interval)->shares[s], here, &here[n]);
    }
    return room;
}

/* Take a step of an explicit method.  work: 2 n + 3 m, and 12 n of a tree, or what assembly takes. */
EOM_LOCAL int EOM(explicit_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = KNOWN(interval->derivatives)->robot;
    const int n = N_OF(robot->sizes);
    const int stages = EOM(explicit_of)(interval)->stages;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const a = &u[n];
    EOM_SCALAR *const rest = &a[n + 3 * M_OF(robot->sizes)]; /* of assembly, or states of a tree's stages */
    EOM_SCALAR *const states = (M_OF(robot->sizes) > 0) ? &kept[n * EXPLICIT_STAGES] : rest;
    for (int s = 0; s < stages; ++s) {
        const double share = EOM(explicit_of)(interval)->shares[s];
        EOM_SCALAR *const q_here = &states[2 * n * s];
        EOM_SCALAR *const v_here = &q_here[n];
        EOM(explicit_stage)(interval, s, q, v, kept, states, q_here, v_here);
        if ((s > 0) && (EOM(assembles_stages)(robot->sizes) != 0)) { /* redundant rows answer to violations */
            const int opened = EOM(assemble)(robot, interval->h, q_here, v_here, rest, NULL);
            if (opened != 0) { return opened; }
        }
        EOM(prescribe_within)(interval, share, q_here, v_here);
        EOM(forces_within)(interval, share, (EOM_SCALAR)0.0, q_here, v_here, u, NULL);
        const int status = robot->forward_dynamics(interval->h, q_here, v_here, u, a);
        if (status != 0) { return status; }
        (void)memcpy(&kept[n * s], a, (size_t)n * sizeof *a);
    }
    EOM(explicit_stage)(interval, stages, q, v, kept, states, q_end, v_end);
    return 0;
}

/* Go back from the end of a step of an explicit method to its beginning.  work: 20 n +
 * parameters, and 12 n of a tree, or what assembly takes. */
EOM_LOCAL void EOM(explicit_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, EOM_SCALAR *restrict to_q, EOM_SCALAR *restrict to_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int n = N_OF(sizes);
    const int count = EOM(explicit_of)(interval)->stages;
    EOM_SCALAR *restrict const by_rate = work; /* (stages, n) */
    EOM_SCALAR *restrict const by_a = &by_rate[n * EXPLICIT_STAGES];
    EOM_SCALAR *restrict const by_q = &by_a[n * EXPLICIT_STAGES];
    EOM_SCALAR *restrict const by_v = &by_q[n];
    EOM_SCALAR *restrict const u = &by_v[n];
    EOM_SCALAR *const q_open = &u[n];
    EOM_SCALAR *const v_open = &q_open[n];
    EOM_SCALAR *restrict const gradient = &v_open[n];
    EOM_SCALAR *const rest = &gradient[3 * n + sizes->parameters]; /* of assembly, or states of a tree's stages */
    const EOM_SCALAR *const states = EOM(explicit_states)(interval, q, v, kept, rest);
    for (int j = 0; j < count; ++j) { /* what the end adds */
        const EOM_SCALAR share = interval->dt * EOM(explicit_of)(interval)->a[count][j];
        for (int i = 0; i < n; ++i) {
            by_rate[n * j + i] = share * to_q[i];
            by_a[n * j + i] = share * to_v[i];
        }
    }
    for (int s = count - 1; s >= 0; --s) {
        const double stage_share = EOM(explicit_of)(interval)->shares[s];
        const EOM_SCALAR *const q_here = &states[2 * n * s];
        const EOM_SCALAR *const v_here = &q_here[n];
        EOM(forces_within)(interval, stage_share, (EOM_SCALAR)0.0, q_here, v_here, u, NULL);
        EOM(refuse_failed)(KNOWN(interval->derivatives)->forward_dynamics_adjoint(interval->h, q_here, v_here, u, &by_a[n * s], gradient), n, gradient);
        for (int i = 0; i < n; ++i) {
            by_q[i] = gradient[i];
            by_v[i] = gradient[n + i] + by_rate[n * s + i];
        }
        EOM(forces_adjoint)(interval, stage_share, (EOM_SCALAR)0.0, q_here, v_here, &gradient[2 * n], by_q, by_v, slopes);
        EOM(prescribe_within_adjoint)(interval, stage_share, by_q, by_v, slopes);
        EOM(parameters_adjoint)(interval, &gradient[3 * n], slopes);
        if ((s > 0) && (EOM(assembles_stages)(sizes) != 0)) {
            EOM(explicit_stage)(interval, s, q, v, kept, states, q_open, v_open);
            EOM(assemble_adjoint)(interval, q_open, v_open, by_q, by_v, slopes, rest);
        }
        for (int i = 0; i < n; ++i) {
            to_q[i] += by_q[i];
            to_v[i] += by_v[i];
        }
        for (int j = 0; j < s; ++j) {
            const EOM_SCALAR share = interval->dt * EOM(explicit_of)(interval)->a[s][j];
            if (!(EOM_MATH(fabs)(share) > (EOM_SCALAR)0.0)) { continue; }
            EOM(add_share)(n, share, by_q, &by_rate[n * j]);
            EOM(add_share)(n, share, by_v, &by_a[n * j]);
        }
    }
}

/* Carry rates dq and dv along directions from the beginning of a step of an explicit method to its end, in front of assembly.
 * work: 22 n, and 12 n of a tree, or what assembly takes. */
EOM_LOCAL void EOM(explicit_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int n = N_OF(sizes);
    const int count = EOM(explicit_of)(interval)->stages;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const du = &u[n];
    EOM_SCALAR *restrict const da = &du[n];                      /* (stages, n) */
    EOM_SCALAR *restrict const moved = &da[n * EXPLICIT_STAGES]; /* (stages, 2 n) */
    EOM_SCALAR *restrict const end = &moved[2 * n * EXPLICIT_STAGES];
    EOM_SCALAR *const rest = &end[2 * n]; /* of assembly, or states of a tree's stages */
    const EOM_SCALAR *const states = EOM(explicit_states)(interval, q, v, kept, rest);
    for (size_t d = 0; d < directions; ++d) {
        EOM_SCALAR *const dq_own = &dq[d * (size_t)n];
        EOM_SCALAR *const dv_own = &dv[d * (size_t)n];
        const EOM_SCALAR *const dp = &rates->parameters[d * (size_t)sizes->parameters];
        for (int s = 0; s < count; ++s) {
            const double share = EOM(explicit_of)(interval)->shares[s];
            const EOM_SCALAR *const q_here = &states[2 * n * s];
            const EOM_SCALAR *const v_here = &q_here[n];
            EOM_SCALAR *const dq_here = &moved[2 * n * s];
            EOM_SCALAR *const dv_here = &dq_here[n];
            EOM(explicit_stage)(interval, s, dq_own, dv_own, da, moved, dq_here, dv_here);
            if ((s > 0) && (EOM(assembles_stages)(sizes) != 0)) {
                EOM(explicit_stage)(interval, s, q, v, kept, states, end, &end[n]);
                EOM(assemble_tangent)(interval, end, &end[n], dp, dq_here, dv_here, rest);
            }
            EOM(prescribe_tangent)(interval, dq_here, dv_here);
            EOM(forces_within)(interval, share, (EOM_SCALAR)0.0, q_here, v_here, u, NULL);
            EOM(forces_tangent)(interval, share, (EOM_SCALAR)0.0, rates, d, q_here, v_here, dq_here, dv_here, du);
            EOM(refuse_failed)(KNOWN(interval->derivatives)->forward_dynamics_tangent(interval->h, q_here, v_here, u, dq_here, dv_here, du, dp, &da[n * s]), n, &da[n * s]);
        }
        EOM(explicit_stage)(interval, count, dq_own, dv_own, da, moved, end, &end[n]);
        (void)memcpy(dq_own, end, (size_t)n * sizeof *end);
        (void)memcpy(dv_own, &end[n], (size_t)n * sizeof *end);
    }
}

/* What the controller adds to the matrix of a step of the linearly implicit Euler method, nothing where drives saturate: there
 * slope is 0, else 1.  work: 2 n. */
EOM_LOCAL void EOM(implicit_added)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict added, EOM_SCALAR *restrict times, EOM_SCALAR *restrict slope, EOM_SCALAR *restrict work)
{
    const int n = EOM(size_of)(interval);
    const EOM_SCALAR dt = interval->dt;
    EOM_SCALAR *restrict const kp = work;
    EOM_SCALAR *restrict const kd = &work[n];
    times[0] = dt;
    times[1] = dt * dt;
    EOM(gains_within)(interval, dt, 1.0, q, v, kp, kd, slope);
    for (int i = 0; i < n; ++i) { added[i] = dt * (kd[i] + dt * kp[i]); }
}

/* The end of a step of the linearly implicit Euler method by its accelerations. */
EOM_LOCAL void EOM(implicit_end)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict a, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end)
{
    for (int i = 0; i < EOM(size_of)(interval); ++i) {
        v_end[i] = v[i] + interval->dt * a[i];
        q_end[i] = q[i] + interval->dt * v_end[i];
    }
}

/* Take a step of the linearly implicit Euler method.  work: 6 n. */
EOM_LOCAL int EOM(implicit_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = KNOWN(interval->derivatives)->robot;
    const int n = N_OF(robot->sizes);
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const added = &u[n];
    EOM_SCALAR *restrict const slope = &added[n];
    EOM_SCALAR *const a = (M_OF(robot->sizes) > 0) ? kept : &slope[n];
    EOM_SCALAR times[2];
    EOM(implicit_added)(interval, q, v, added, times, slope, &slope[2 * n]);
    EOM(forces_within)(interval, 1.0, interval->dt, q, v, u, NULL);
    const int status = robot->implicit_step(interval->h, q, v, u, added, times, a);
    if (status == 0) { EOM(implicit_end)(interval, q, v, a, q_end, v_end); }
    return status;
}

/* Go back from the end of a step of the linearly implicit Euler method to its beginning.  work: 8 n + parameters. */
EOM_LOCAL void EOM(implicit_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict to_q, EOM_SCALAR *restrict to_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const int n = EOM(size_of)(interval);
    const EOM_SCALAR dt = interval->dt;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const added = &u[n];
    EOM_SCALAR *restrict const slope = &added[n];
    EOM_SCALAR *restrict const by_a = &slope[n];
    EOM_SCALAR *restrict const gradient = &by_a[n]; /* 4 n + parameters */
    EOM_SCALAR times[2];
    EOM(implicit_added)(interval, q, v, added, times, slope, gradient);
    EOM(forces_within)(interval, 1.0, dt, q, v, u, NULL);
    for (int i = 0; i < n; ++i) {
        to_v[i] += dt * to_q[i];
        by_a[i] = dt * to_v[i];
    }
    EOM(refuse_failed)(KNOWN(interval->derivatives)->implicit_step_adjoint(interval->h, q, v, u, added, times, by_a, gradient), n, gradient);
    for (int i = 0; i < n; ++i) {
        to_q[i] += gradient[i];
        to_v[i] += gradient[n + i];
        EOM(gains_adjoint)(interval, i, slope[i] * dt * dt * gradient[3 * n + i], slope[i] * dt * gradient[3 * n + i], slopes);
    }
    EOM(forces_adjoint)(interval, 1.0, dt, q, v, &gradient[2 * n], to_q, to_v, slopes);
    EOM(parameters_adjoint)(interval, &gradient[4 * n], slopes);
}

/* Carry rates dq and dv along directions from the beginning of a step of the linearly implicit Euler method to its end, in front
 * of assembly.  work: 7 n. */
EOM_LOCAL void EOM(implicit_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int n = N_OF(sizes);
    const EOM_SCALAR dt = interval->dt;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const du = &u[n];
    EOM_SCALAR *restrict const da = &du[n];
    EOM_SCALAR *restrict const added = &da[n];
    EOM_SCALAR *restrict const slope = &added[n];
    EOM_SCALAR times[2];
    EOM(implicit_added)(interval, q, v, added, times, slope, &slope[n]);
    EOM(forces_within)(interval, 1.0, dt, q, v, u, NULL);
    for (size_t d = 0; d < directions; ++d) {
        EOM_SCALAR *const dq_own = &dq[d * (size_t)n];
        EOM_SCALAR *const dv_own = &dv[d * (size_t)n];
        EOM(forces_tangent)(interval, 1.0, dt, rates, d, q, v, dq_own, dv_own, du);
        EOM(refuse_failed)(KNOWN(interval->derivatives)->implicit_step_tangent(interval->h, q, v, u, added, times, dq_own, dv_own, du, &rates->parameters[d * (size_t)sizes->parameters], da), n, da);
        for (int i = 0; i < n; ++i) {
            dv_own[i] += dt * da[i];
            dq_own[i] += dt * dv_own[i];
        }
    }
}
