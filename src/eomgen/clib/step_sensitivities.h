/* step_sensitivities.h: steps with all that their derivatives need, their adjoints and tangents; of one state.
 *
 * A step is taken forwards, and numbers of its stages are kept: of an explicit method the accelerations of each, with closed
 * loops and q and v of each behind them; of the linearly implicit Euler method, with closed loops, its accelerations; of the
 * Rosenbrock method what each stage is solved for and the rates' parts, with closed loops all six rows of a stage: q and v,
 * rates and shifts that are solved with, and parts of q and v. */

/* Whether the state of a stage is assembled, too: redundant rows answer to violations. */
EOM_LOCAL int EOM(assembles_stage)(const EOM(sizes) *restrict sizes, int stage)
{
    return ((stage > 0) && (EOM_M_OF(sizes) > 0) && (sizes->has_redundant_rows != 0)) ? 1 : 0;
}

/* Numbers of a function that failed are none, so that no derivative passes for one. */
EOM_LOCAL void EOM(refuse_failed)(int status, int count, EOM_SCALAR *restrict out)
{
    for (int i = 0; (i < count) && (status != 0); ++i) { out[i] = (EOM_SCALAR)NAN; }
}

/* Go back from an assembled state to the one, q and v, that assemble began with: its passes once more, then each of them back.
 * work: 12 nq + 3 nx + 2 m + parameters, nx = nq + nv. */
EOM_LOCAL void EOM(assemble_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = EOM_KNOWN(interval->derivatives)->robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int nx = nq + nv;
    const int m = EOM_M_OF(robot->sizes);
    EOM_SCALAR *const on_way = work; /* (passes, nq) */
    EOM_SCALAR *const change = &on_way[12 * nq];
    EOM_SCALAR *const weight = &change[nx + m];
    EOM_SCALAR *const gradient = &weight[nx + m];
    int passes = 0;
    int settled = 0;
    (void)memcpy(on_way, q, (size_t)nq * sizeof *on_way);
    while ((settled == 0) && (passes < 12)) {
        EOM_SCALAR *const here = &on_way[passes * nq];
        EOM(refuse_failed)(robot->settling(interval->h, here, v, change), nq, change);
        settled = 1;
        for (int r = nx; r < nx + m; ++r) {
            if (!(EOM_MATH(fabs)(change[r]) <= robot->sizes->closed_gap)) { settled = 0; }
        }
        ++passes;
        for (int i = 0; (i < nq) && (passes < 12); ++i) { here[nq + i] = here[i] + change[i]; }
    }
    for (int k = passes - 1; k >= 0; --k) {
        for (int i = 0; i < nq; ++i) { weight[i] = by_q[i]; }
        for (int i = 0; i < nv; ++i) { weight[nq + i] = (k == passes - 1) ? by_v[i] : EOM_C(0.0); }
        for (int r = nx; r < nx + m; ++r) { weight[r] = EOM_C(0.0); }
        EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->settling_adjoint(interval->h, &on_way[k * nq], v, weight, gradient), nq, gradient);
        EOM(add_share)(nq, EOM_C(1.0), gradient, by_q);
        EOM(add_share)(nv, EOM_C(1.0), &gradient[nq], by_v);
        EOM(parameters_adjoint)(interval, &gradient[nx], slopes);
    }
}

/* Carry rates dq and dv of the state that assemble begins with to those of the assembled one.  work: nq + 2 nx + 2 m. */
EOM_LOCAL void EOM(assemble_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict dp, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = EOM_KNOWN(interval->derivatives)->robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int nx = nq + nv;
    const int m = EOM_M_OF(robot->sizes);
    EOM_SCALAR *const q_here = work;
    EOM_SCALAR *const change = &q_here[nq];
    EOM_SCALAR *const moved = &change[nx + m];
    int settled = 0;
    (void)memcpy(q_here, q, (size_t)nq * sizeof *q_here);
    for (int pass = 0; (pass < 12) && (settled == 0); ++pass) {
        EOM(refuse_failed)(robot->settling(interval->h, q_here, v, change), nq, change);
        EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->settling_tangent(interval->h, q_here, v, dq, dv, dp, moved), nq, moved);
        settled = 1;
        for (int r = nx; r < nx + m; ++r) {
            if (!(EOM_MATH(fabs)(change[r]) <= robot->sizes->closed_gap)) { settled = 0; }
        }
        for (int i = 0; i < nq; ++i) {
            q_here[i] += change[i];
            dq[i] += moved[i];
        }
    }
    for (int i = 0; i < nv; ++i) { dv[i] += moved[nq + i]; }
}

/* Accelerations at the state of a stage, here = (q, v) in front of assembly, which becomes the one in which its forces u act.
 * work: what assembly takes. */
EOM_LOCAL int EOM(stage_forward)(const EOM(interval) *restrict interval, int stage, double share, EOM_SCALAR *here, EOM_SCALAR *restrict u, EOM_SCALAR *restrict a, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = EOM_KNOWN(interval->derivatives)->robot;
    EOM_SCALAR *const v_here = &here[EOM_POSITIONS_OF(robot->sizes)];
    if (EOM(assembles_stage)(robot->sizes, stage) != 0) {
        const int opened = EOM(assemble)(robot, interval->h, here, v_here, work, NULL);
        if (opened != 0) { return opened; }
    }
    EOM(prescribe)(interval, EOM(instant_within)(interval, share), here, v_here);
    EOM(forces_within)(interval, share, EOM_C(0.0), here, v_here, u, NULL);
    return robot->forward_dynamics(interval->h, here, v_here, u, a);
}

/* Go back from the state of a stage, here, in which its forces act, to the one in front of assembly, open: by_a are derivatives
 * by its accelerations; by_q gets those by q, and to by_v are added those by v.  work: nx + 2 nu + parameters, and what assembly
 * takes. */
EOM_LOCAL void EOM(stage_adjoint)(const EOM(interval) *restrict interval, int stage, double share, const EOM_SCALAR *open, const EOM_SCALAR *here, const EOM_SCALAR *restrict by_a, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nx = EOM_STATE_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const gradient = &u[nu];
    EOM(forces_within)(interval, share, EOM_C(0.0), here, &here[nq], u, NULL);
    EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->forward_dynamics_adjoint(interval->h, here, &here[nq], u, by_a, gradient), nq, gradient);
    for (int i = 0; i < nq; ++i) { by_q[i] = gradient[i]; }
    EOM(add_share)(EOM_RATES_OF(sizes), EOM_C(1.0), &gradient[nq], by_v);
    EOM(forces_adjoint)(interval, share, EOM_C(0.0), here, &here[nq], &gradient[nx], by_q, by_v, slopes);
    EOM(prescribe_adjoint)(interval, EOM(instant_within)(interval, share), by_q, by_v, slopes);
    EOM(parameters_adjoint)(interval, &gradient[nx + nu], slopes);
    if (EOM(assembles_stage)(sizes, stage) != 0) { EOM(assemble_adjoint)(interval, open, &open[nq], by_q, by_v, slopes, &gradient[nx + nu + sizes->parameters]); }
}

/* Carry rates along direction d of the state of a stage in front of assembly, there, to those of the one in which its forces act,
 * and to those of its accelerations, da; open and here are these states.  work: 2 nu, and what assembly takes. */
EOM_LOCAL void EOM(stage_tangent)(const EOM(interval) *restrict interval, int stage, double share, const EOM_SCALAR *open, const EOM_SCALAR *here, const EOM(rates) *restrict rates, size_t d, EOM_SCALAR *there, EOM_SCALAR *restrict da, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const EOM_SCALAR *const dp = &rates->parameters[d * (size_t)sizes->parameters];
    const int nq = EOM_POSITIONS_OF(sizes);
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const du = &u[EOM_INPUTS_OF(sizes)];
    if (EOM(assembles_stage)(sizes, stage) != 0) { EOM(assemble_tangent)(interval, open, &open[nq], dp, there, &there[nq], &du[EOM_INPUTS_OF(sizes)]); }
    EOM(prescribe_tangent)(interval, there, &there[nq]);
    EOM(forces_within)(interval, share, EOM_C(0.0), here, &here[nq], u, NULL);
    EOM(forces_tangent)(interval, share, EOM_C(0.0), rates, d, here, &here[nq], there, &there[nq], du);
    EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->forward_dynamics_tangent(interval->h, here, &here[nq], u, there, &there[nq], du, dp, da), EOM_RATES_OF(sizes), da);
}

/* The explicit method of a step. */
EOM_INLINE const EOM(explicit_method) *EOM(explicit_of)(const EOM(interval) *restrict interval)
{
    return &eom_explicit_methods[interval->method / EOM_KINDS];
}

/* The state in front of a stage of an explicit method, or behind the last one, from the stages' states (q, then v), of each at
 * nx stage, and accelerations a, or the same of rates. */
EOM_LOCAL void EOM(explicit_stage)(const EOM(interval) *restrict interval, int stage, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict a, const EOM_SCALAR *restrict states, EOM_SCALAR *restrict q_here, EOM_SCALAR *restrict v_here)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    (void)memcpy(q_here, q, (size_t)nq * sizeof *q);
    (void)memcpy(v_here, v, (size_t)nv * sizeof *v);
    for (int j = 0; j < stage; ++j) {
        const EOM_SCALAR share = interval->dt * EOM(explicit_of)(interval)->a[stage][j];
        if (!(EOM_MATH(fabs)(share) > EOM_C(0.0))) { continue; }
        EOM(add_share)(nq, share, &states[(nq + nv) * j + nq], q_here);
        EOM(add_share)(nv, share, &a[nv * j], v_here);
    }
}

/* States of all stages from what is kept: with closed loops they are; else into room, 6 nx. */
EOM_INLINE const EOM_SCALAR *EOM(explicit_states)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *kept, EOM_SCALAR *room)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    if (EOM_M_OF(EOM(sizes_of)(interval)) > 0) { return &kept[nv * EOM_EXPLICIT_STAGES]; }
    for (int s = 0; s < EOM(explicit_of)(interval)->stages; ++s) {
        EOM_SCALAR *const here = &room[(nq + nv) * s];
        EOM(explicit_stage)(interval, s, q, v, kept, room, here, &here[nq]);
        EOM(prescribe)(interval, EOM(instant_within)(interval, EOM(explicit_of)(interval)->shares[s]), here, &here[nq]);
    }
    return room;
}

/* Take a step of an explicit method.  work: nu + nv + 3 m, and 6 nx of a tree, or what assembly takes. */
EOM_LOCAL int EOM(explicit_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    const int m = EOM_M_OF(EOM(sizes_of)(interval));
    const int stages = EOM(explicit_of)(interval)->stages;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const a = &u[EOM(inputs_of)(interval)];
    EOM_SCALAR *const rest = &a[nv + 3 * m]; /* of assembly, or states of a tree's stages */
    EOM_SCALAR *const states = (m > 0) ? &kept[nv * EOM_EXPLICIT_STAGES] : rest;
    for (int s = 0; s < stages; ++s) {
        EOM_SCALAR *const here = &states[(nq + nv) * s];
        EOM(explicit_stage)(interval, s, q, v, kept, states, here, &here[nq]);
        const int status = EOM(stage_forward)(interval, s, EOM(explicit_of)(interval)->shares[s], here, u, a, rest);
        if (status != 0) { return status; }
        (void)memcpy(&kept[nv * s], a, (size_t)nv * sizeof *a);
    }
    EOM(explicit_stage)(interval, stages, q, v, kept, states, q_end, v_end);
    return 0;
}

/* Go back from the end of a step of an explicit method to its beginning.  work: 9 nx +
 * 2 nu + parameters, and 6 nx of a tree, or what assembly takes. */
EOM_LOCAL void EOM(explicit_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, EOM_SCALAR *restrict to_q, EOM_SCALAR *restrict to_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nx = nq + nv;
    const int count = EOM(explicit_of)(interval)->stages;
    EOM_SCALAR *restrict const by_rate = work; /* (stages, nq) */
    EOM_SCALAR *restrict const by_a = &by_rate[nq * EOM_EXPLICIT_STAGES];
    EOM_SCALAR *restrict const by_q = &by_a[nv * EOM_EXPLICIT_STAGES];
    EOM_SCALAR *restrict const by_v = &by_q[nq];
    EOM_SCALAR *const open = &by_v[nv];
    EOM_SCALAR *const room = &open[nx]; /* of states of a tree's stages */
    EOM_SCALAR *const rest = (EOM_M_OF(sizes) > 0) ? room : &room[nx * EOM_EXPLICIT_STAGES];
    const EOM_SCALAR *const states = EOM(explicit_states)(interval, q, v, kept, room);
    for (int j = 0; j < count; ++j) { /* what the end adds */
        const EOM_SCALAR share = interval->dt * EOM(explicit_of)(interval)->a[count][j];
        for (int i = 0; i < nq; ++i) { by_rate[nq * j + i] = share * to_q[i]; }
        for (int i = 0; i < nv; ++i) { by_a[nv * j + i] = share * to_v[i]; }
    }
    for (int s = count - 1; s >= 0; --s) {
        for (int i = 0; i < nv; ++i) { by_v[i] = (i < nq) ? by_rate[nq * s + i] : EOM_C(0.0); }
        if (EOM(assembles_stage)(sizes, s) != 0) { EOM(explicit_stage)(interval, s, q, v, kept, states, open, &open[nq]); }
        EOM(stage_adjoint)(interval, s, EOM(explicit_of)(interval)->shares[s], open, &states[nx * s], &by_a[nv * s], by_q, by_v, slopes, rest);
        EOM(add_share)(nq, EOM_C(1.0), by_q, to_q);
        EOM(add_share)(nv, EOM_C(1.0), by_v, to_v);
        for (int j = 0; j < s; ++j) {
            const EOM_SCALAR share = interval->dt * EOM(explicit_of)(interval)->a[s][j];
            if (!(EOM_MATH(fabs)(share) > EOM_C(0.0))) { continue; }
            EOM(add_share)(nq, share, by_q, &by_rate[nq * j]);
            EOM(add_share)(nv, share, by_v, &by_a[nv * j]);
        }
    }
}

/* Carry rates dq and dv along directions from the beginning of a step of an explicit method to its end, in front of assembly.
 * work: 2 nu + 6 nv + 7 nx, and 6 nx of a tree, or what assembly takes. */
EOM_LOCAL void EOM(explicit_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nx = nq + nv;
    const int count = EOM(explicit_of)(interval)->stages;
    EOM_SCALAR *restrict const da = work;                         /* (stages, nv) */
    EOM_SCALAR *restrict const moved = &da[nv * EOM_EXPLICIT_STAGES]; /* (stages, nx) */
    EOM_SCALAR *restrict const end = &moved[nx * EOM_EXPLICIT_STAGES];
    EOM_SCALAR *const room = &end[nx]; /* of states of a tree's stages */
    EOM_SCALAR *const rest = (EOM_M_OF(sizes) > 0) ? room : &room[nx * EOM_EXPLICIT_STAGES];
    const EOM_SCALAR *const states = EOM(explicit_states)(interval, q, v, kept, room);
    for (size_t d = 0; d < directions; ++d) {
        EOM_SCALAR *const dq_own = &dq[d * (size_t)nq];
        EOM_SCALAR *const dv_own = &dv[d * (size_t)nv];
        for (int s = 0; s < count; ++s) {
            EOM_SCALAR *const there = &moved[nx * s];
            EOM(explicit_stage)(interval, s, dq_own, dv_own, da, moved, there, &there[nq]);
            if (EOM(assembles_stage)(sizes, s) != 0) { EOM(explicit_stage)(interval, s, q, v, kept, states, end, &end[nq]); }
            EOM(stage_tangent)(interval, s, EOM(explicit_of)(interval)->shares[s], end, &states[nx * s], rates, d, there, &da[nv * s], rest);
        }
        EOM(explicit_stage)(interval, count, dq_own, dv_own, da, moved, end, &end[nq]);
        (void)memcpy(dq_own, end, (size_t)nq * sizeof *end);
        (void)memcpy(dv_own, &end[nq], (size_t)nv * sizeof *end);
    }
}

/* What the controller adds to the matrix of a step of the linearly implicit Euler method, nothing where drives saturate: there
 * slope is 0, else 1.  work: 2 nu. */
EOM_LOCAL void EOM(implicit_added)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict added, EOM_SCALAR *restrict times, EOM_SCALAR *restrict slope, EOM_SCALAR *restrict work)
{
    const int nu = EOM(inputs_of)(interval);
    const EOM_SCALAR dt = interval->dt;
    EOM_SCALAR *restrict const kp = work;
    EOM_SCALAR *restrict const kd = &work[nu];
    times[0] = dt;
    times[1] = dt * dt;
    EOM(gains_within)(interval, dt, 1.0, q, v, kp, kd, slope);
    for (int i = 0; i < nu; ++i) { added[i] = dt * (kd[i] + dt * kp[i]); }
}

/* The end of a step of the linearly implicit Euler method by its accelerations. */
EOM_LOCAL void EOM(implicit_end)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict a, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end)
{
    for (int i = 0; i < EOM(rates_of)(interval); ++i) { v_end[i] = v[i] + interval->dt * a[i]; }
    for (int i = 0; i < EOM(positions_of)(interval); ++i) { q_end[i] = q[i] + interval->dt * v_end[i]; }
}

/* Take a step of the linearly implicit Euler method.  work: 5 nu + nv. */
EOM_LOCAL int EOM(implicit_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = EOM_KNOWN(interval->derivatives)->robot;
    const int nu = EOM_INPUTS_OF(robot->sizes);
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const added = &u[nu];
    EOM_SCALAR *restrict const slope = &added[nu];
    EOM_SCALAR *const a = (EOM_M_OF(robot->sizes) > 0) ? kept : &slope[nu];
    EOM_SCALAR times[2];
    EOM(implicit_added)(interval, q, v, added, times, slope, &slope[nu + EOM_RATES_OF(robot->sizes)]);
    EOM(forces_within)(interval, 1.0, interval->dt, q, v, u, NULL);
    const int status = robot->implicit_step(interval->h, q, v, u, added, times, a);
    if (status == 0) { EOM(implicit_end)(interval, q, v, a, q_end, v_end); }
    return status;
}

/* Go back from the end of a step of the linearly implicit Euler method to its beginning.  work: nx + nv + 5 nu + parameters. */
EOM_LOCAL void EOM(implicit_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict to_q, EOM_SCALAR *restrict to_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    const int nx = nq + nv;
    const int nu = EOM(inputs_of)(interval);
    const EOM_SCALAR dt = interval->dt;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const added = &u[nu];
    EOM_SCALAR *restrict const slope = &added[nu];
    EOM_SCALAR *restrict const by_a = &slope[nu];
    EOM_SCALAR *restrict const gradient = &by_a[nv]; /* nx + 2 nu + parameters */
    EOM_SCALAR times[2];
    EOM(implicit_added)(interval, q, v, added, times, slope, gradient);
    EOM(forces_within)(interval, 1.0, dt, q, v, u, NULL);
    EOM(add_share)(nq, dt, to_q, to_v);
    for (int i = 0; i < nv; ++i) { by_a[i] = dt * to_v[i]; }
    EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->implicit_step_adjoint(interval->h, q, v, u, added, times, by_a, gradient), nq, gradient);
    EOM(add_share)(nq, EOM_C(1.0), gradient, to_q);
    EOM(add_share)(nv, EOM_C(1.0), &gradient[nq], to_v);
    for (int i = 0; i < nu; ++i) { EOM(gains_adjoint)(interval, i, slope[i] * dt * dt * gradient[nx + nu + i], slope[i] * dt * gradient[nx + nu + i], slopes); }
    EOM(forces_adjoint)(interval, 1.0, dt, q, v, &gradient[nx], to_q, to_v, slopes);
    EOM(parameters_adjoint)(interval, &gradient[nx + 2 * nu], slopes);
}

/* Carry rates dq and dv along directions from the beginning of a step of the linearly implicit Euler method to its end, in front
 * of assembly.  work: nv + 6 nu. */
EOM_LOCAL void EOM(implicit_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nu = EOM_INPUTS_OF(sizes);
    const EOM_SCALAR dt = interval->dt;
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *restrict const du = &u[nu];
    EOM_SCALAR *restrict const da = &du[nu];
    EOM_SCALAR *restrict const added = &da[nv];
    EOM_SCALAR *restrict const slope = &added[nu];
    EOM_SCALAR times[2];
    EOM(implicit_added)(interval, q, v, added, times, slope, &slope[nu]);
    EOM(forces_within)(interval, 1.0, dt, q, v, u, NULL);
    for (size_t d = 0; d < directions; ++d) {
        EOM_SCALAR *const dq_own = &dq[d * (size_t)nq];
        EOM_SCALAR *const dv_own = &dv[d * (size_t)nv];
        EOM(forces_tangent)(interval, 1.0, dt, rates, d, q, v, dq_own, dv_own, du);
        EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->implicit_step_tangent(interval->h, q, v, u, added, times, dq_own, dv_own, du, &rates->parameters[d * (size_t)sizes->parameters], da), nv, da);
        EOM(add_share)(nv, dt, da, dv_own);
        EOM(add_share)(nq, dt, dv_own, dq_own);
    }
}
