/* rosenbrock_sensitivities.h: steps of Rosenbrock methods with all that their derivatives need, their adjoints and tangents;
 * of one state.  A stage has three rows of nx = nq + nv numbers: q and v; rates, then shifts that are solved with; parts of q and v. */

enum { EOM_ROW_RATE = 1, EOM_ROW_PART = 2, EOM_STAGE_ROWS = 3 };

/* The method of a step. */
EOM_INLINE const EOM(rosenbrock_method) *EOM(rosenbrock_of)(const EOM(interval) *restrict interval)
{
    return &eom_rosenbrock_methods[interval->method / EOM_KINDS];
}

/* The state of a stage from the parts in front, or with the number of stages the end, or the same of rates. */
EOM_LOCAL void EOM(rosenbrock_state)(const EOM(interval) *restrict interval, int stage, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict stages, EOM_SCALAR *restrict q_here, EOM_SCALAR *restrict v_here)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR *const weight = (stage < method->stages) ? method->a[stage] : method->b;
    (void)memcpy(q_here, q, (size_t)nq * sizeof *q);
    (void)memcpy(v_here, v, (size_t)nv * sizeof *v);
    for (int j = 0; j < stage; ++j) {
        const EOM_SCALAR *const increment = &stages[(nq + nv) * (EOM_STAGE_ROWS * j + EOM_ROW_PART)];
        EOM(add_share)(nq, weight[j], increment, q_here);
        EOM(add_share)(nv, weight[j], &increment[nq], v_here);
    }
}

/* Add what the parts in front add to shifts and rates of a stage. */
EOM_LOCAL void EOM(rosenbrock_added)(const EOM(interval) *restrict interval, int stage, const EOM_SCALAR *restrict stages, EOM_SCALAR *restrict shift, EOM_SCALAR *restrict rate)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR inverse = EOM_C(1.0) / interval->dt;
    for (int j = 0; j < stage; ++j) {
        const EOM_SCALAR share = inverse * method->c[stage][j];
        const EOM_SCALAR *const increment = &stages[(nq + nv) * (EOM_STAGE_ROWS * j + EOM_ROW_PART)];
        EOM(add_share)(nq, share, increment, shift);
        EOM(add_share)(nv, share, &increment[nq], rate);
    }
}

/* Stages from what is kept of them: with closed loops they are; else into room, 18 nx, once more.  work: nv. */
EOM_LOCAL const EOM_SCALAR *EOM(rosenbrock_stages)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *kept, EOM_SCALAR *room, EOM_SCALAR *restrict work)
{
    const int nq = EOM(positions_of)(interval);
    const int nv = EOM(rates_of)(interval);
    const int nx = nq + nv;
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR time = method->diagonal * interval->dt;
    EOM_SCALAR *restrict const none = work;
    if (EOM_M_OF(EOM(sizes_of)(interval)) > 0) { return kept; }
    for (int s = 0; s < method->stages; ++s) {
        EOM_SCALAR *const here = &room[nx * EOM_STAGE_ROWS * s];
        EOM_SCALAR *const rate = &here[nx * EOM_ROW_RATE];
        EOM_SCALAR *const shift = &rate[nv];
        EOM_SCALAR *const increment = &here[nx * EOM_ROW_PART];
        EOM(rosenbrock_state)(interval, (method->begins[s] != 0) ? 0 : s, q, v, room, here, &here[nq]);
        EOM(prescribe)(interval, EOM(instant_within)(interval, method->shares[s]), here, &here[nq]);
        (void)memcpy(shift, &here[nq], (size_t)nq * sizeof *here);
        (void)memset(none, 0, (size_t)nv * sizeof *none);
        EOM(rosenbrock_added)(interval, s, room, shift, none);
        (void)memcpy(rate, &kept[2 * nv * s], (size_t)nv * sizeof *here);
        (void)memcpy(&increment[nq], &kept[2 * nv * s + nv], (size_t)nv * sizeof *here);
        for (int i = 0; i < nq; ++i) { increment[i] = time * (increment[nq + i] + shift[i]); }
    }
    return room;
}

/* Gains in the matrix of a step, its times and its factors.  gains: 3 nu, kp, kd, and slope, 0 where drives saturate, else 1. */
EOM_LOCAL int EOM(rosenbrock_factors)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict gains, EOM_SCALAR *restrict times, EOM_SCALAR *restrict factors)
{
    const int nu = EOM(inputs_of)(interval);
    times[0] = EOM(rosenbrock_of)(interval)->diagonal * interval->dt;
    times[1] = times[0] * times[0];
    EOM(gains_within)(interval, EOM_C(0.0), 0.0, q, v, gains, &gains[nu], &gains[2 * nu]);
    return EOM_KNOWN(interval->derivatives)->robot->stage_factors(interval->h, q, v, gains, &gains[nu], times, factors);
}

/* Take a step of a Rosenbrock method.  work: 4 nu + 2 nv + 3 m + factors, and 18 nx of a tree, or what
 * assembly takes. */
EOM_LOCAL int EOM(rosenbrock_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = EOM_KNOWN(interval->derivatives)->robot;
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int nx = nq + nv;
    const int nu = EOM_INPUTS_OF(robot->sizes);
    const int closed = (EOM_M_OF(robot->sizes) > 0) ? 1 : 0;
    EOM_SCALAR *restrict const gains = work;
    EOM_SCALAR *restrict const u = &gains[3 * nu];
    EOM_SCALAR *restrict const w = &u[nu];
    EOM_SCALAR *restrict const a = &w[nv];
    EOM_SCALAR *restrict const factors = &a[nv + 3 * EOM_M_OF(robot->sizes)];
    EOM_SCALAR *const rest = &factors[robot->sizes->factors]; /* of assembly, or a tree's stages */
    EOM_SCALAR *const stages = (closed != 0) ? kept : rest;
    EOM_SCALAR times[2];
    const int unsolved = EOM(rosenbrock_factors)(interval, q, v, gains, times, factors);
    if (unsolved != 0) { return unsolved; }
    for (int s = 0; s < method->stages; ++s) {
        EOM_SCALAR *const here = &stages[nx * EOM_STAGE_ROWS * s];
        EOM_SCALAR *const rate = &here[nx * EOM_ROW_RATE];
        EOM_SCALAR *const shift = &rate[nv];
        EOM_SCALAR *const increment = &here[nx * EOM_ROW_PART];
        if (method->begins[s] != 0) { /* where the first one is */
            (void)memcpy(here, stages, (size_t)nx * sizeof *here);
            (void)memcpy(a, &stages[nx * EOM_ROW_RATE], (size_t)nv * sizeof *a); /* nothing was added to those */
        } else {
            EOM(rosenbrock_state)(interval, s, q, v, stages, here, &here[nq]);
            const int status = EOM(stage_forward)(interval, s, method->shares[s], here, u, a, rest);
            if (status != 0) { return status; }
        }
        (void)memcpy(rate, a, (size_t)nv * sizeof *here);
        (void)memcpy(shift, &here[nq], (size_t)nq * sizeof *here);
        EOM(rosenbrock_added)(interval, s, stages, shift, rate);
        (void)robot->stage_solution(interval->h, factors, rate, shift, w);
        for (int i = 0; i < nv; ++i) { increment[nq + i] = times[0] * (rate[i] + w[i]); }
        for (int i = 0; i < nq; ++i) { increment[i] = times[0] * (increment[nq + i] + shift[i]); }
        if (closed == 0) {
            (void)memcpy(&kept[2 * nv * s], rate, (size_t)nv * sizeof *here);
            (void)memcpy(&kept[2 * nv * s + nv], &increment[nq], (size_t)nv * sizeof *here);
        }
    }
    EOM(rosenbrock_state)(interval, method->stages, q, v, stages, q_end, v_end);
    return 0;
}

/* Go back from the end of a step of a Rosenbrock method to its beginning: its stages, then the factors that all of them share.
 * work: 8 nx + 5 nu + 4 nv + nq + 3 factors + parameters, 18 nx of a tree, and what a stage takes. */
EOM_LOCAL void EOM(rosenbrock_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, EOM_SCALAR *restrict to_q, EOM_SCALAR *restrict to_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nx = nq + nv;
    const int nu = EOM_INPUTS_OF(sizes);
    const int size = sizes->factors;
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR inverse = EOM_C(1.0) / interval->dt;
    EOM_SCALAR *restrict const gains = work;
    EOM_SCALAR *restrict const by_part = &gains[3 * nu]; /* (stages, nx) */
    EOM_SCALAR *restrict const by_rate = &by_part[nx * EOM_ROSENBROCK_STAGES];
    EOM_SCALAR *restrict const by_v = &by_rate[nv]; /* shifts are the first nq of v */
    EOM_SCALAR *restrict const by_second = &by_v[nv];
    EOM_SCALAR *restrict const by_q = &by_second[nv];
    EOM_SCALAR *restrict const by_w = &by_q[nq];
    EOM_SCALAR *restrict const factors = &by_w[nv];
    EOM_SCALAR *restrict const by_factors = &factors[size];
    EOM_SCALAR *restrict const gradient = &by_factors[size];
    EOM_SCALAR *const room = &gradient[size + nx + 2 * nu + sizes->parameters];
    EOM_SCALAR *const open = (EOM_M_OF(sizes) > 0) ? room : &room[nx * EOM_STAGE_ROWS * EOM_ROSENBROCK_STAGES];
    EOM_SCALAR times[2];
    const EOM_SCALAR *const stages = EOM(rosenbrock_stages)(interval, q, v, kept, room, open);
    EOM(refuse_failed)(EOM(rosenbrock_factors)(interval, q, v, gains, times, factors), size, factors);
    for (int i = 0; i < size; ++i) { by_factors[i] = EOM_C(0.0); }
    (void)memset(by_second, 0, (size_t)nv * sizeof *by_second);
    for (int s = 0; s < method->stages; ++s) {
        for (int i = 0; i < nq; ++i) { by_part[nx * s + i] = method->b[s] * to_q[i]; }
        for (int i = 0; i < nv; ++i) { by_part[nx * s + nq + i] = method->b[s] * to_v[i]; }
    }
    for (int s = method->stages - 1; s >= 0; --s) {
        const EOM_SCALAR *const rate = &stages[nx * (EOM_STAGE_ROWS * s + EOM_ROW_RATE)];
        for (int i = 0; i < nv; ++i) {
            by_v[i] = (i < nq) ? (times[0] * by_part[nx * s + i]) : EOM_C(0.0);
            by_w[i] = times[0] * (by_part[nx * s + nq + i] + by_v[i]);
        }
        (void)EOM_KNOWN(interval->derivatives)->stage_solution_adjoint(interval->h, factors, rate, &rate[nv], by_w, gradient);
        for (int i = 0; i < size; ++i) { by_factors[i] += gradient[i]; }
        for (int i = 0; i < nv; ++i) { by_rate[i] = by_w[i] + gradient[size + i]; }
        EOM(add_share)(nq, EOM_C(1.0), &gradient[size + nv], by_v);
        for (int j = 0; j < s; ++j) {
            const EOM_SCALAR share = inverse * method->c[s][j];
            EOM(add_share)(nq, share, by_v, &by_part[nx * j]);
            EOM(add_share)(nv, share, by_rate, &by_part[nx * j + nq]);
        }
        EOM(parameters_adjoint)(interval, &gradient[size + nx], slopes);
        if (method->begins[s] != 0) { /* where the first one is, whose accelerations it shares */
            EOM(add_share)(nv, EOM_C(1.0), by_rate, by_second);
            EOM(add_share)(nv, EOM_C(1.0), by_v, to_v);
            continue;
        }
        if (s == 0) { EOM(add_share)(nv, EOM_C(1.0), by_second, by_rate); }
        if (EOM(assembles_stage)(sizes, s) != 0) { EOM(rosenbrock_state)(interval, s, q, v, stages, open, &open[nq]); }
        EOM(stage_adjoint)(interval, s, method->shares[s], open, &stages[nx * EOM_STAGE_ROWS * s], by_rate, by_q, by_v, slopes, &open[nx]);
        EOM(add_share)(nq, EOM_C(1.0), by_q, to_q);
        EOM(add_share)(nv, EOM_C(1.0), by_v, to_v);
        for (int j = 0; j < s; ++j) {
            const EOM_SCALAR share = method->a[s][j];
            EOM(add_share)(nq, share, by_q, &by_part[nx * j]);
            EOM(add_share)(nv, share, by_v, &by_part[nx * j + nq]);
        }
    }
    EOM(refuse_failed)(EOM_KNOWN(interval->derivatives)->stage_factors_adjoint(interval->h, q, v, gains, &gains[nu], times, by_factors, gradient), nq, gradient);
    EOM(add_share)(nq, EOM_C(1.0), gradient, to_q);
    EOM(add_share)(nv, EOM_C(1.0), &gradient[nq], to_v);
    for (int i = 0; i < nu; ++i) { EOM(gains_adjoint)(interval, i, gains[2 * nu + i] * gradient[nx + i], gains[2 * nu + i] * gradient[nx + nu + i], slopes); }
    EOM(parameters_adjoint)(interval, &gradient[nx + 2 * nu], slopes);
}

/* Carry rates dq and dv along directions from the beginning of a step of a Rosenbrock method to its end, in front of assembly.
 * work: 5 nu + nv + 19 nx + 2 factors, 18 nx of a tree, and what assembly takes. */
EOM_LOCAL void EOM(rosenbrock_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(robot_derivatives) *const derivatives = EOM_KNOWN(interval->derivatives);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM(sizes) *const sizes = derivatives->robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int nx = nq + nv;
    const int nu = EOM_INPUTS_OF(sizes);
    EOM_SCALAR *restrict const gains = work;
    EOM_SCALAR *restrict const dw = &gains[3 * nu];
    EOM_SCALAR *restrict const end = &dw[nv];
    EOM_SCALAR *restrict const moved = &end[nx];
    EOM_SCALAR *restrict const factors = &moved[nx * EOM_STAGE_ROWS * EOM_ROSENBROCK_STAGES];
    EOM_SCALAR *restrict const moved_factors = &factors[sizes->factors];
    EOM_SCALAR *const room = &moved_factors[sizes->factors];
    EOM_SCALAR *const rest = (EOM_M_OF(sizes) > 0) ? room : &room[nx * EOM_STAGE_ROWS * EOM_ROSENBROCK_STAGES];
    EOM_SCALAR times[2];
    const EOM_SCALAR *const stages = EOM(rosenbrock_stages)(interval, q, v, kept, room, rest);
    EOM(refuse_failed)(EOM(rosenbrock_factors)(interval, q, v, gains, times, factors), sizes->factors, factors);
    for (size_t d = 0; d < directions; ++d) {
        EOM_SCALAR *const dq_own = &dq[d * (size_t)nq];
        EOM_SCALAR *const dv_own = &dv[d * (size_t)nv];
        const EOM_SCALAR *const dp = &rates->parameters[d * (size_t)sizes->parameters];
        EOM(refuse_failed)(derivatives->stage_factors_tangent(interval->h, q, v, gains, &gains[nu], times, dq_own, dv_own, dp, moved_factors), sizes->factors, moved_factors);
        for (int s = 0; s < method->stages; ++s) {
            const EOM_SCALAR *const here = &stages[nx * EOM_STAGE_ROWS * s];
            EOM_SCALAR *const there = &moved[nx * EOM_STAGE_ROWS * s];
            EOM_SCALAR *const rate = &there[nx * EOM_ROW_RATE];
            EOM_SCALAR *const shift = &rate[nv];
            EOM_SCALAR *const increment = &there[nx * EOM_ROW_PART];
            if (method->begins[s] != 0) { /* where the first one is, whose accelerations it shares */
                (void)memcpy(there, moved, (size_t)(nx + nv) * sizeof *there);
            } else {
                EOM(rosenbrock_state)(interval, s, dq_own, dv_own, moved, there, &there[nq]);
                if (EOM(assembles_stage)(sizes, s) != 0) { EOM(rosenbrock_state)(interval, s, q, v, stages, end, &end[nq]); }
                EOM(stage_tangent)(interval, s, method->shares[s], end, here, rates, d, there, rate, rest);
            }
            (void)memcpy(shift, &there[nq], (size_t)nq * sizeof *there);
            EOM(rosenbrock_added)(interval, s, moved, shift, rate);
            (void)derivatives->stage_solution_tangent(interval->h, factors, &here[nx * EOM_ROW_RATE], &here[nx * EOM_ROW_RATE + nv], moved_factors, rate, shift, dp, dw);
            for (int i = 0; i < nv; ++i) { increment[nq + i] = times[0] * (rate[i] + dw[i]); }
            for (int i = 0; i < nq; ++i) { increment[i] = times[0] * (increment[nq + i] + shift[i]); }
        }
        EOM(rosenbrock_state)(interval, method->stages, dq_own, dv_own, moved, end, &end[nq]);
        (void)memcpy(dq_own, end, (size_t)nq * sizeof *end);
        (void)memcpy(dv_own, &end[nq], (size_t)nv * sizeof *end);
    }
}
