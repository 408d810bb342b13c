/* radau_control.h: a step of Radau IIA from its start to its error, its length by that and by Newton's iteration, and what it
 * leaves to the next one; adaptive_rollouts.h includes it. */

/* One over what is allowed of the numbers of a lane's state, with increments of its last stage if there are some. */
EOM_LOCAL void F(scale_radau)(const F(integration) *restrict it, int l, const REAL *restrict last, REAL *restrict scale)
{
    const EOM(tolerance) *const allowed = F(tolerance_of)(it, l);
    for (int i = 0; i < STATE_OF(it->problem.motion.robot->sizes); ++i) {
        const double begin = fabs((double)LANE_OF(it->step.x[i], l));
        const double end = (last == NULL) ? begin : fabs((double)LANE_OF(it->step.x[i], l) + (double)LANE_OF(last[i], l));
        const int place = F(place_of)(&it->problem.motion, l, i);
        LANE_OF(scale[i], l) = (EOM_SCALAR)(1.0 / ((double)allowed->atol[place] + allowed->rtol * ((begin > end) ? begin : end)));
    }
}

/* Measure the first changes of lanes by where they lead to, where that is beyond all numbers beside what is allowed where they
 * begin. */
EOM_LOCAL void F(measure_radau)(F(integration) *restrict it, const REAL *restrict last, REAL *restrict sum)
{
    const F(radau) *const radau = &it->radau;
    for (int l = 0; l < (int)WIDTH; ++l) {
        EOM_SCALAR squares = C(0.0);
        if ((radau->solves[l] == 0) || ((double)LANE_OF(*sum, l) < HUGE_VAL)) { continue; }
        F(scale_radau)(it, l, last, radau->scale);
        for (int i = 0; i < STATE_OF(it->problem.motion.robot->sizes); ++i) {
            const EOM_SCALAR scaled = LANE_OF(last[i], l) * LANE_OF(radau->scale[i], l);
            squares += scaled * scaled;
        }
        LANE_OF(*sum, l) = squares;
    }
}

/* Take a step of all lanes that go on: its ends, and its errors, which of lanes whose iteration does not converge are the
 * increments that it came to. */
EOM_LOCAL void F(take_radau_step)(F(integration) *restrict it, REAL dt, F(workspace) work)
{
    const F(problem) *const problem = &it->problem;
    const F(step) *const step = &it->step;
    F(radau) *const radau = &it->radau;
    const int nx = STATE_OF(problem->motion.robot->sizes);
    const REAL *const last = &radau->z[(RADAU_STAGES - 1) * PADDED_TO_BLOCKS(nx)];
    double enough[WIDTH];
    double before[WIDTH];
    int failed_before[WIDTH];
    REAL sum;
    int some = 1;
    int again = 0;
    int where = 0;
    for (int l = 0; l < (int)WIDTH; ++l) {
        const EOM(tolerance) *const allowed = F(tolerance_of)(it, l);
        const double most = sqrt(allowed->rtol);
        const double least = (allowed->rtol > 0.0) ? (10.0 * (double)EOM_ROUND_OFF / allowed->rtol) : HUGE_VAL;
        const double usual = (most < 0.03) ? most : 0.03;
        radau->solves[l] = it->going[l];
        radau->solved[l] = 0;
        radau->rounds[l] = 0;
        before[l] = 0.0;
        enough[l] = (least > usual) ? least : usual;
        F(scale_radau)(it, l, NULL, radau->scale);
    }
    F(renew_radau)(problem, step, radau, work);
    F(begin_radau)(problem, radau);
    for (int round = 0; (round < RADAU_ROUNDS) && (some != 0); ++round) {
        int masked = 0;
        for (int l = 0; l < (int)WIDTH; ++l) {
            if (radau->solves[l] == 0) { masked = 1; }
        }
        F(rates_of_radau)(problem, step, radau, work);
        F(iterate_radau)(problem, dt, masked, radau, &sum);
        if (round == 0) { F(measure_radau)(it, last, &sum); }
        some = F(look_at_radau)(round, enough, sum, problem->failed, before, radau);
    }
    for (int i = 0; i < nx; ++i) { step->x_end[i] = step->x[i] + last[i]; }
    F(error_of_radau)(problem, dt, step->dx, radau, step->error);
    if (problem->clock.inputs[0] != NULL) { F(put_prescribed_ends)(problem, step, work.input); }
    for (int l = 0; l < (int)WIDTH; ++l) {
        radau->solves[l] = ((radau->solved[l] != 0) && !(F(error_norm)(&problem->motion, F(tolerance_of)(it, l), l, step, &where) <= 1.0)) ? 1 : 0;
        if (radau->solves[l] != 0) { again = 1; }
    }
    if (again != 0) { /* an error that is too great may be that of stiff parts alone, which rates where it leads to do not have */
        for (int i = 0; i < nx; ++i) { radau->here[i] = step->x[i] + step->error[i]; }
        (void)memcpy(failed_before, problem->failed, sizeof failed_before);
        F(rate)(problem, 0.0, INSIDE_STAGE, radau->here, radau->rates, work);
        F(forget_failures)(radau, failed_before, problem->failed);
        F(error_of_radau)(problem, dt, radau->rates, radau, radau->scale);
        for (int l = 0; l < (int)WIDTH; ++l) {
            for (int i = 0; (radau->solves[l] != 0) && (i < nx); ++i) { LANE_OF(step->error[i], l) = LANE_OF(radau->scale[i], l); }
        }
        if (problem->clock.inputs[0] != NULL) { F(put_prescribed_ends)(problem, step, work.input); }
    }
    for (int l = 0; l < (int)WIDTH; ++l) {
        if (it->going[l] != 0) { radau->evaluations[l] += (double)(1 + RADAU_STAGES * radau->rounds[l] + radau->solves[l]); }
        for (int i = 0; (radau->solved[l] == 0) && (i < nx); ++i) { LANE_OF(step->error[i], l) = LANE_OF(last[i], l); }
    }
}

/* Whether a lane's step is taken, and the length of the next one: by the error, with a predictive controller (K. Gustafsson,
 * "Control-theoretic techniques for stepsize selection in implicit Runge-Kutta methods", ACM Transactions on Mathematical Software
 * 20, 1994, 496), and by the iterations that it took. */
EOM_LOCAL int F(judge_radau)(F(radau) *restrict radau, eom_progress *restrict p, double excess, int l, double length, double duration, int where)
{
    const int taken = ((radau->solved[l] != 0) && (excess <= 1.0)) ? 1 : 0;
    const double most = 2.0 * (double)RADAU_ROUNDS;
    double factor = 0.9 * (most + 1.0) / (most + (double)radau->rounds[l]) * pow(excess, -1.0 / (double)(RADAU_STAGES + 1));
    if ((taken != 0) && (radau->last[l] > 0.0) && (excess > 0.0)) {
        const double bent = factor * (length / radau->last[l]) * pow(radau->excess[l] / excess, 1.0 / (double)(RADAU_STAGES + 1));
        factor = (bent < factor) ? bent : factor;
    }
    factor = (factor > 8.0) ? 8.0 : ((factor < 0.2) ? 0.2 : factor);
    if (taken != 0) {
        if ((factor > 1.0) && (factor < 1.2)) { factor = 1.0; } /* factors of this length serve again */
        radau->excess[l] = (excess > 1e-2) ? excess : 1e-2;
        if (!(radau->slowness[l] < RADAU_SLOW)) { radau->factored[l] = 0.0; }
    } else if (radau->solved[l] == 0) { /* factors of where the step begins, or if they are, a shorter step */
        factor = (radau->young[l] == 0) ? 1.0 : ((radau->last[l] > 0.0) ? 0.5 : 0.1);
        radau->factored[l] = 0.0;
        radau->slowness[l] = 1.0;
    } else {
        /* the error says how much shorter */
    }
    F(go_on)(p, taken, factor, excess, length, duration, where);
    return taken;
}

/* Keep the polynomials of steps that are taken. */
EOM_LOCAL void F(keep_inside)(F(integration) *restrict it)
{
    F(radau) *const radau = &it->radau;
    const int nx = STATE_OF(it->problem.motion.robot->sizes);
    const int apart = PADDED_TO_BLOCKS(nx);
    for (int k = 0; k < RADAU_STAGES; ++k) {
        REAL *const kept = &radau->inside[k * apart];
        REAL *const made = (WIDTH > 1) ? radau->here : kept;
        if ((WIDTH == 1) && (it->taken[0] == 0)) { continue; }
        F(weigh)(nx, RADAU_STAGES, eom_radau_inside[k], radau->z, apart, made);
        for (int l = 0; (WIDTH > 1) && (l < (int)WIDTH); ++l) {
            for (int i = 0; (it->taken[l] != 0) && (i < nx); ++i) { LANE_OF(kept[i], l) = LANE_OF(made[i], l); }
        }
    }
    for (int l = 0; l < (int)WIDTH; ++l) {
        if (it->taken[l] != 0) { radau->last[l] = it->length[l]; }
    }
}
