/* rosenbrock_sensitivities.h: steps of Rosenbrock methods with all that their derivatives need, their adjoints and tangents;
 * of one state.  A stage has six rows of n numbers: q and v, rates and shifts that are solved with, parts of q and v. */

enum { ROW_V = 1, ROW_RATE = 2, ROW_SHIFT = 3, ROW_PART = 4, ROW_PART_V = 5, STAGE_ROWS = 6 };

/* The method of a step. */
EOM_INLINE const EOM(rosenbrock_method) *EOM(rosenbrock_of)(const EOM(interval) *restrict interval)
{
    return &eom_rosenbrock_methods[interval->method / EOM_KINDS];
}

/* The state of a stage from the parts in front, or with the number of stages the end, or the same of rates. */
EOM_LOCAL void EOM(rosenbrock_state)(const EOM(interval) *restrict interval, int stage, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict stages, EOM_SCALAR *restrict q_here, EOM_SCALAR *restrict v_here)
{
    const int n = EOM(size_of)(interval);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR *const weight = (stage < method->stages) ? method->a[stage] : method->b;
    (void)memcpy(q_here, q, (size_t)n * sizeof *q);
    (void)memcpy(v_here, v, (size_t)n * sizeof *v);
    for (int j = 0; j < stage; ++j) {
        const EOM_SCALAR share = weight[j];
        const EOM_SCALAR *const increment = &stages[n * (STAGE_ROWS * j + ROW_PART)];
        for (int i = 0; i < n; ++i) {
            q_here[i] += share * increment[i];
            v_here[i] += share * increment[n + i];
        }
    }
}

/* Add what the parts in front add to shifts and rates of a stage. */
EOM_LOCAL void EOM(rosenbrock_added)(const EOM(interval) *restrict interval, int stage, const EOM_SCALAR *restrict stages, EOM_SCALAR *restrict shift, EOM_SCALAR *restrict rate)
{
    const int n = EOM(size_of)(interval);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR inverse = (EOM_SCALAR)1.0 / interval->dt;
    for (int j = 0; j < stage; ++j) {
        const EOM_SCALAR share = inverse * method->c[stage][j];
        const EOM_SCALAR *const increment = &stages[n * (STAGE_ROWS * j + ROW_PART)];
        for (int i = 0; i < n; ++i) {
            shift[i] += share * increment[i];
            rate[i] += share * increment[n + i];
        }
    }
}

/* Stages from what is kept of them: with closed loops they are; else into room, 36 n, once more.  work: n. */
EOM_LOCAL const EOM_SCALAR *EOM(rosenbrock_stages)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *kept, EOM_SCALAR *room, EOM_SCALAR *restrict work)
{
    const int n = EOM(size_of)(interval);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR time = method->diagonal * interval->dt;
    EOM_SCALAR *restrict const none = work;
    if (M_OF(EOM(sizes_of)(interval)) > 0) { return kept; }
    for (int s = 0; s < method->stages; ++s) {
        EOM_SCALAR *const here = &room[n * STAGE_ROWS * s];
        EOM_SCALAR *const shift = &here[n * ROW_SHIFT];
        EOM_SCALAR *const increment = &here[n * ROW_PART];
        EOM(rosenbrock_state)(interval, (method->begins[s] != 0) ? 0 : s, q, v, room, here, &here[n]);
        EOM(prescribe_within)(interval, method->shares[s], here, &here[n]);
        (void)memcpy(shift, &here[n], (size_t)n * sizeof *here);
        (void)memset(none, 0, (size_t)n * sizeof *none);
        EOM(rosenbrock_added)(interval, s, room, shift, none);
        (void)memcpy(&here[n * ROW_RATE], &kept[2 * n * s], (size_t)n * sizeof *here);
        (void)memcpy(&increment[n], &kept[2 * n * s + n], (size_t)n * sizeof *here);
        for (int i = 0; i < n; ++i) { increment[i] = time * (increment[n + i] + shift[i]); }
    }
    return room;
}

/* Gains in the matrix of a step, its times and its factors.  gains: 3 n, kp, kd, and slope, 0 where drives saturate, else 1. */
EOM_LOCAL int EOM(rosenbrock_factors)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict gains, EOM_SCALAR *restrict times, EOM_SCALAR *restrict factors)
{
    const int n = EOM(size_of)(interval);
    times[0] = EOM(rosenbrock_of)(interval)->diagonal * interval->dt;
    times[1] = times[0] * times[0];
    EOM(gains_within)(interval, (EOM_SCALAR)0.0, 0.0, q, v, gains, &gains[n], &gains[2 * n]);
    return KNOWN(interval->derivatives)->robot->stage_factors(interval->h, q, v, gains, &gains[n], times, factors);
}

/* Take a step of a Rosenbrock method.  work: 6 n + 3 m + factors, and 36 n of a tree, or what assembly
 * takes. */
EOM_LOCAL int EOM(rosenbrock_forward)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, EOM_SCALAR *restrict kept, EOM_SCALAR *restrict q_end, EOM_SCALAR *restrict v_end, EOM_SCALAR *restrict work)
{
    const EOM(robot) *const robot = KNOWN(interval->derivatives)->robot;
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const int n = N_OF(robot->sizes);
    const int closed = (M_OF(robot->sizes) > 0) ? 1 : 0;
    EOM_SCALAR *restrict const gains = work;
    EOM_SCALAR *restrict const u = &gains[3 * n];
    EOM_SCALAR *restrict const w = &u[n];
    EOM_SCALAR *restrict const a = &w[n];
    EOM_SCALAR *restrict const factors = &a[n + 3 * M_OF(robot->sizes)];
    EOM_SCALAR *const rest = &factors[robot->sizes->factors]; /* of assembly, or a tree's stages */
    EOM_SCALAR *const stages = (closed != 0) ? kept : rest;
    EOM_SCALAR times[2];
    const int unsolved = EOM(rosenbrock_factors)(interval, q, v, gains, times, factors);
    if (unsolved != 0) { return unsolved; }
    for (int s = 0; s < method->stages; ++s) {
        EOM_SCALAR *const here = &stages[n * STAGE_ROWS * s];
        EOM_SCALAR *const rate = &here[n * ROW_RATE];
        EOM_SCALAR *const shift = &here[n * ROW_SHIFT];
        EOM_SCALAR *const increment = &here[n * ROW_PART];
        if (method->begins[s] != 0) { /* where the first one is */
            (void)memcpy(here, stages, (size_t)(2 * n) * sizeof *here);
            (void)memcpy(a, &stages[n * ROW_RATE], (size_t)n * sizeof *a); /* nothing was added to those */
        } else {
            EOM(rosenbrock_state)(interval, s, q, v, stages, here, &here[n]);
            if ((s > 0) && (EOM(assembles_stages)(robot->sizes) != 0)) { /* redundant rows answer to violations */
                const int opened = EOM(assemble)(robot, interval->h, here, &here[n], rest, NULL);
                if (opened != 0) { return opened; }
            }
            EOM(prescribe_within)(interval, method->shares[s], here, &here[n]);
            EOM(forces_within)(interval, method->shares[s], (EOM_SCALAR)0.0, here, &here[n], u, NULL);
            const int status = robot->forward_dynamics(interval->h, here, &here[n], u, a);
            if (status != 0) { return status; }
        }
        (void)memcpy(rate, a, (size_t)n * sizeof *here);
        (void)memcpy(shift, &here[n], (size_t)n * sizeof *here);
        EOM(rosenbrock_added)(interval, s, stages, shift, rate);
        (void)robot->stage_solution(interval->h, factors, rate, shift, w);
        for (int i = 0; i < n; ++i) {
            increment[n + i] = times[0] * (rate[i] + w[i]);
            increment[i] = times[0] * (increment[n + i] + shift[i]);
        }
        if (closed == 0) {
            (void)memcpy(&kept[2 * n * s], rate, (size_t)n * sizeof *here);
            (void)memcpy(&kept[2 * n * s + n], &increment[n], (size_t)n * sizeof *here);
        }
    }
    EOM(rosenbrock_state)(interval, method->stages, q, v, stages, q_end, v_end);
    return 0;
}

/* Go back from the state of a stage, where its forces act, to its beginning: by_rate are derivatives by its accelerations, by_v
 * those by its shifts.  work: 6 n + parameters and what assembly takes. */
EOM_LOCAL void EOM(rosenbrock_state_adjoint)(const EOM(interval) *restrict interval, int s, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict stages, const EOM_SCALAR *restrict by_rate, EOM_SCALAR *restrict by_q, EOM_SCALAR *restrict by_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int n = N_OF(sizes);
    const double share = EOM(rosenbrock_of)(interval)->shares[s];
    const EOM_SCALAR *const here = &stages[n * STAGE_ROWS * s];
    EOM_SCALAR *restrict const u = work;
    EOM_SCALAR *const q_open = &u[n];
    EOM_SCALAR *const v_open = &q_open[n];
    EOM_SCALAR *restrict const gradient = &v_open[n];
    EOM(forces_within)(interval, share, (EOM_SCALAR)0.0, here, &here[n], u, NULL);
    EOM(refuse_failed)(KNOWN(interval->derivatives)->forward_dynamics_adjoint(interval->h, here, &here[n], u, by_rate, gradient), n, gradient);
    for (int i = 0; i < n; ++i) {
        by_q[i] = gradient[i];
        by_v[i] += gradient[n + i];
    }
    EOM(forces_adjoint)(interval, share, (EOM_SCALAR)0.0, here, &here[n], &gradient[2 * n], by_q, by_v, slopes);
    EOM(prescribe_within_adjoint)(interval, share, by_q, by_v, slopes);
    EOM(parameters_adjoint)(interval, &gradient[3 * n], slopes);
    if ((s > 0) && (EOM(assembles_stages)(sizes) != 0)) {
        EOM(rosenbrock_state)(interval, s, q, v, stages, q_open, v_open);
        EOM(assemble_adjoint)(interval, q_open, v_open, by_q, by_v, slopes, &gradient[3 * n + sizes->parameters]);
    }
}

/* Go back from the end of a step of a Rosenbrock method to its beginning: its stages, then the factors that all of them share.
 * work: 24 n + 3 factors + parameters, 36 n of a tree, and what a stage takes. */
EOM_LOCAL void EOM(rosenbrock_adjoint)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, EOM_SCALAR *restrict to_q, EOM_SCALAR *restrict to_v, const EOM(slopes) *restrict slopes, EOM_SCALAR *restrict work)
{
    const EOM(sizes) *const sizes = EOM(sizes_of)(interval);
    const int n = N_OF(sizes);
    const int size = sizes->factors;
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM_SCALAR inverse = (EOM_SCALAR)1.0 / interval->dt;
    EOM_SCALAR *restrict const gains = work;
    EOM_SCALAR *restrict const by_part = &gains[3 * n]; /* (stages, 2 n) */
    EOM_SCALAR *restrict const by_rate = &by_part[2 * n * ROSENBROCK_STAGES];
    EOM_SCALAR *restrict const by_shift = &by_rate[n];
    EOM_SCALAR *restrict const by_second = &by_shift[n];
    EOM_SCALAR *restrict const by_q = &by_second[n];
    EOM_SCALAR *restrict const by_w = &by_q[n];
    EOM_SCALAR *restrict const factors = &by_w[n];
    EOM_SCALAR *restrict const by_factors = &factors[size];
    EOM_SCALAR *restrict const gradient = &by_factors[size];
    EOM_SCALAR *const room = &gradient[size + 4 * n + sizes->parameters];
    EOM_SCALAR *const rest = (M_OF(sizes) > 0) ? room : &room[n * STAGE_ROWS * ROSENBROCK_STAGES];
    EOM_SCALAR times[2];
    const EOM_SCALAR *const stages = EOM(rosenbrock_stages)(interval, q, v, kept, room, rest);
    EOM(refuse_failed)(EOM(rosenbrock_factors)(interval, q, v, gains, times, factors), size, factors);
    for (int i = 0; i < size; ++i) { by_factors[i] = (EOM_SCALAR)0.0; }
    (void)memset(by_second, 0, (size_t)n * sizeof *by_second);
    for (int s = 0; s < method->stages; ++s) {
        for (int i = 0; i < n; ++i) {
            by_part[2 * n * s + i] = method->b[s] * to_q[i];
            by_part[2 * n * s + n + i] = method->b[s] * to_v[i];
        }
    }
    for (int s = method->stages - 1; s >= 0; --s) {
        const EOM_SCALAR *const here = &stages[n * STAGE_ROWS * s];
        for (int i = 0; i < n; ++i) {
            by_shift[i] = times[0] * by_part[2 * n * s + i];
            by_w[i] = times[0] * (by_part[2 * n * s + n + i] + by_shift[i]);
        }
        (void)KNOWN(interval->derivatives)->stage_solution_adjoint(interval->h, factors, &here[n * ROW_RATE], &here[n * ROW_SHIFT], by_w, gradient);
        for (int i = 0; i < size; ++i) { by_factors[i] += gradient[i]; }
        for (int i = 0; i < n; ++i) {
            by_rate[i] = by_w[i] + gradient[size + i];
            by_shift[i] += gradient[size + n + i];
        }
        for (int j = 0; j < s; ++j) {
            const EOM_SCALAR share = inverse * method->c[s][j];
            EOM(add_share)(n, share, by_shift, &by_part[2 * n * j]);
            EOM(add_share)(n, share, by_rate, &by_part[2 * n * j + n]);
        }
        EOM(parameters_adjoint)(interval, &gradient[size + 2 * n], slopes);
        if (method->begins[s] != 0) { /* where the first one is, whose accelerations it shares */
            for (int i = 0; i < n; ++i) {
                by_second[i] += by_rate[i];
                to_v[i] += by_shift[i];
            }
            continue;
        }
        for (int i = 0; (i < n) && (s == 0); ++i) { by_rate[i] += by_second[i]; }
        EOM(rosenbrock_state_adjoint)(interval, s, q, v, stages, by_rate, by_q, by_shift, slopes, rest);
        for (int i = 0; i < n; ++i) {
            to_q[i] += by_q[i];
            to_v[i] += by_shift[i];
        }
        for (int j = 0; j < s; ++j) {
            const EOM_SCALAR share = method->a[s][j];
            EOM(add_share)(n, share, by_q, &by_part[2 * n * j]);
            EOM(add_share)(n, share, by_shift, &by_part[2 * n * j + n]);
        }
    }
    EOM(refuse_failed)(KNOWN(interval->derivatives)->stage_factors_adjoint(interval->h, q, v, gains, &gains[n], times, by_factors, gradient), n, gradient);
    for (int i = 0; i < n; ++i) {
        to_q[i] += gradient[i];
        to_v[i] += gradient[n + i];
        EOM(gains_adjoint)(interval, i, gains[2 * n + i] * gradient[2 * n + i], gains[2 * n + i] * gradient[3 * n + i], slopes);
    }
    EOM(parameters_adjoint)(interval, &gradient[4 * n], slopes);
}

/* Carry rates dq and dv along directions from the beginning of a step of a Rosenbrock method to its end, in front of assembly.
 * work: 44 n + 2 factors, 36 n of a tree, and what assembly takes. */
EOM_LOCAL void EOM(rosenbrock_tangent)(const EOM(interval) *restrict interval, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict kept, size_t directions, const EOM(rates) *restrict rates, EOM_SCALAR *restrict dq, EOM_SCALAR *restrict dv, EOM_SCALAR *restrict work)
{
    const EOM(robot_derivatives) *const derivatives = KNOWN(interval->derivatives);
    const EOM(rosenbrock_method) *const method = EOM(rosenbrock_of)(interval);
    const EOM(sizes) *const sizes = derivatives->robot->sizes;
    const int n = N_OF(sizes);
    EOM_SCALAR *restrict const gains = work;
    EOM_SCALAR *restrict const u = &gains[3 * n];
    EOM_SCALAR *restrict const du = &u[n];
    EOM_SCALAR *restrict const dw = &du[n];
    EOM_SCALAR *restrict const end = &dw[n];
    EOM_SCALAR *restrict const moved = &end[2 * n];
    EOM_SCALAR *restrict const factors = &moved[n * STAGE_ROWS * ROSENBROCK_STAGES];
    EOM_SCALAR *restrict const moved_factors = &factors[sizes->factors];
    EOM_SCALAR *const room = &moved_factors[sizes->factors];
    EOM_SCALAR *const rest = (M_OF(sizes) > 0) ? room : &room[n * STAGE_ROWS * ROSENBROCK_STAGES];
    EOM_SCALAR times[2];
    const EOM_SCALAR *const stages = EOM(rosenbrock_stages)(interval, q, v, kept, room, rest);
    EOM(refuse_failed)(EOM(rosenbrock_factors)(interval, q, v, gains, times, factors), sizes->factors, factors);
    for (size_t d = 0; d < directions; ++d) {
        EOM_SCALAR *const dq_own = &dq[d * (size_t)n];
        EOM_SCALAR *const dv_own = &dv[d * (size_t)n];
        const EOM_SCALAR *const dp = &rates->parameters[d * (size_t)sizes->parameters];
        EOM(refuse_failed)(derivatives->stage_factors_tangent(interval->h, q, v, gains, &gains[n], times, dq_own, dv_own, dp, moved_factors), sizes->factors, moved_factors);
        for (int s = 0; s < method->stages; ++s) {
            const double share = method->shares[s];
            const EOM_SCALAR *const here = &stages[n * STAGE_ROWS * s];
            EOM_SCALAR *const there = &moved[n * STAGE_ROWS * s];
            EOM_SCALAR *const rate = &there[n * ROW_RATE];
            EOM_SCALAR *const shift = &there[n * ROW_SHIFT];
            EOM_SCALAR *const increment = &there[n * ROW_PART];
            if (method->begins[s] != 0) { /* where the first one is, whose accelerations it shares */
                (void)memcpy(there, moved, (size_t)(3 * n) * sizeof *there);
            } else {
                EOM(rosenbrock_state)(interval, s, dq_own, dv_own, moved, there, &there[n]);
                if ((s > 0) && (EOM(assembles_stages)(sizes) != 0)) {
                    EOM(rosenbrock_state)(interval, s, q, v, stages, end, &end[n]);
                    EOM(assemble_tangent)(interval, end, &end[n], dp, there, &there[n], rest);
                }
                EOM(prescribe_tangent)(interval, there, &there[n]);
                EOM(forces_within)(interval, share, (EOM_SCALAR)0.0, here, &here[n], u, NULL);
                EOM(forces_tangent)(interval, share, (EOM_SCALAR)0.0, rates, d, here, &here[n], there, &there[n], du);
                EOM(refuse_failed)(derivatives->forward_dynamics_tangent(interval->h, here, &here[n], u, there, &there[n], du, dp, rate), n, rate);
            }
            (void)memcpy(shift, &there[n], (size_t)n * sizeof *there);
            EOM(rosenbrock_added)(interval, s, moved, shift, rate);
            (void)derivatives->stage_solution_tangent(interval->h, factors, &here[n * ROW_RATE], &here[n * ROW_SHIFT], moved_factors, rate, shift, dp, dw);
            for (int i = 0; i < n; ++i) {
                increment[n + i] = times[0] * (rate[i] + dw[i]);
                increment[i] = times[0] * (increment[n + i] + shift[i]);
            }
        }
        EOM(rosenbrock_state)(interval, method->stages, dq_own, dv_own, moved, end, &end[n]);
        (void)memcpy(dq_own, end, (size_t)n * sizeof *end);
        (void)memcpy(dv_own, &end[n], (size_t)n * sizeof *end);
    }
}
