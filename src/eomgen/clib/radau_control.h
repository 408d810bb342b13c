/* radau_control.h: a step of Radau IIA from its start to its error, its length by that and by Newton's iteration, and what it
 * leaves to the next one; adaptive_rollouts.h includes it. */

/* One over what is allowed of the numbers of a lane's state, with increments of its last stage if there are some. */
EOM_LOCAL void EOM_F(scale_radau)(const EOM_F(integration) *restrict it, int l, const EOM_REAL *restrict last, EOM_REAL *restrict scale)
{
    const EOM(tolerance) *const allowed = EOM_F(tolerance_of)(it, l);
    for (int i = 0; i < EOM_STATE_OF(it->problem.motion.robot->sizes); ++i) {
        const double begin = fabs((double)EOM_LANE_OF(it->step.x[i], l));
        const double end = (last == NULL) ? begin : fabs((double)EOM_LANE_OF(it->step.x[i], l) + (double)EOM_LANE_OF(last[i], l));
        const int place = EOM_F(place_of)(&it->problem.motion, l, i);
        EOM_LANE_OF(scale[i], l) = (EOM_SCALAR)(1.0 / ((double)allowed->atol[place] + allowed->rtol * ((begin > end) ? begin : end)));
    }
}

/* Measure the first changes of lanes by where they lead to, where that is beyond all numbers beside what is allowed where they
 * begin. */
EOM_LOCAL void EOM_F(measure_radau)(EOM_F(integration) *restrict it, const EOM_REAL *restrict last, EOM_REAL *restrict sum)
{
    const EOM_F(radau) *const radau = &it->radau;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        EOM_SCALAR squares = EOM_C(0.0);
        if ((radau->solves[l] == 0) || ((double)EOM_LANE_OF(*sum, l) < HUGE_VAL)) { continue; }
        EOM_F(scale_radau)(it, l, last, radau->scale);
        for (int i = 0; i < EOM_STATE_OF(it->problem.motion.robot->sizes); ++i) {
            const EOM_SCALAR scaled = EOM_LANE_OF(last[i], l) * EOM_LANE_OF(radau->scale[i], l);
            squares += scaled * scaled;
        }
        EOM_LANE_OF(*sum, l) = squares;
    }
}

/* Take a step of all lanes that go on: its ends, and its errors, which of lanes whose iteration does not converge are the
 * increments that it came to. */
EOM_LOCAL void EOM_F(take_radau_step)(EOM_F(integration) *restrict it, EOM_REAL dt, EOM_F(workspace) work)
{
    const EOM_F(problem) *const problem = &it->problem;
    const EOM_F(step) *const step = &it->step;
    EOM_F(radau) *const radau = &it->radau;
    const int nx = EOM_STATE_OF(problem->motion.robot->sizes);
    const EOM_REAL *const last = &radau->z[(EOM_RADAU_STAGES - 1) * EOM_PADDED_TO_BLOCKS(nx)];
    double enough[EOM_WIDTH];
    double before[EOM_WIDTH];
    int failed_before[EOM_WIDTH];
    EOM_REAL sum;
    int some = 1;
    int again = 0;
    int where = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        const EOM(tolerance) *const allowed = EOM_F(tolerance_of)(it, l);
        const double most = sqrt(allowed->rtol);
        const double least = (allowed->rtol > 0.0) ? (10.0 * (double)EOM_ROUND_OFF / allowed->rtol) : HUGE_VAL;
        const double usual = (most < 0.03) ? most : 0.03;
        radau->solves[l] = it->going[l];
        radau->solved[l] = 0;
        radau->rounds[l] = 0;
        before[l] = 0.0;
        enough[l] = (least > usual) ? least : usual;
        EOM_F(scale_radau)(it, l, NULL, radau->scale);
    }
    EOM_F(renew_radau)(problem, step, radau, work);
    EOM_F(begin_radau)(problem, radau);
    for (int round = 0; (round < EOM_RADAU_ROUNDS) && (some != 0); ++round) {
        int masked = 0;
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            if (radau->solves[l] == 0) { masked = 1; }
        }
        EOM_F(rates_of_radau)(problem, step, radau, work);
        EOM_F(iterate_radau)(problem, dt, masked, radau, &sum);
        if (round == 0) { EOM_F(measure_radau)(it, last, &sum); }
        some = EOM_F(look_at_radau)(round, enough, sum, problem->failed, before, radau);
    }
    for (int i = 0; i < nx; ++i) { step->x_end[i] = step->x[i] + last[i]; }
    EOM_F(error_of_radau)(problem, dt, step->dx, radau, step->error);
    if (problem->clock.inputs[0] != NULL) { EOM_F(put_prescribed_ends)(problem, step, work.input); }
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        radau->solves[l] = ((radau->solved[l] != 0) && !(EOM_F(error_norm)(&problem->motion, EOM_F(tolerance_of)(it, l), l, step, &where) <= 1.0)) ? 1 : 0;
        if (radau->solves[l] != 0) { again = 1; }
    }
    if (again != 0) { /* an error that is too great may be that of stiff parts alone, which rates where it leads to do not have */
        for (int i = 0; i < nx; ++i) { radau->here[i] = step->x[i] + step->error[i]; }
        (void)memcpy(failed_before, problem->failed, sizeof failed_before);
        EOM_F(rate)(problem, 0.0, EOM_INSIDE_STAGE, radau->here, radau->rates, work);
        EOM_F(forget_failures)(radau, failed_before, problem->failed);
        EOM_F(error_of_radau)(problem, dt, radau->rates, radau, radau->scale);
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            for (int i = 0; (radau->solves[l] != 0) && (i < nx); ++i) { EOM_LANE_OF(step->error[i], l) = EOM_LANE_OF(radau->scale[i], l); }
        }
        if (problem->clock.inputs[0] != NULL) { EOM_F(put_prescribed_ends)(problem, step, work.input); }
    }
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (it->going[l] != 0) { radau->evaluations[l] += (double)(1 + EOM_RADAU_STAGES * radau->rounds[l] + radau->solves[l]); }
        for (int i = 0; (radau->solved[l] == 0) && (i < nx); ++i) { EOM_LANE_OF(step->error[i], l) = EOM_LANE_OF(last[i], l); }
    }
}

/* Whether a lane's step is taken, and the length of the next one: by the error, with a predictive controller (K. Gustafsson,
 * "Control-theoretic techniques for stepsize selection in implicit Runge-Kutta methods", ACM Transactions on Mathematical Software
 * 20, 1994, 496), and by the iterations that it took. */
EOM_LOCAL int EOM_F(judge_radau)(EOM_F(radau) *restrict radau, eom_progress *restrict p, double excess, int l, double length, double duration, int where)
{
    const int taken = ((radau->solved[l] != 0) && (excess <= 1.0)) ? 1 : 0;
    const double most = 2.0 * (double)EOM_RADAU_ROUNDS;
    double factor = 0.9 * (most + 1.0) / (most + (double)radau->rounds[l]) * pow(excess, -1.0 / (double)(EOM_RADAU_STAGES + 1));
    if ((taken != 0) && (radau->last[l] > 0.0) && (excess > 0.0)) {
        const double bent = factor * (length / radau->last[l]) * pow(radau->excess[l] / excess, 1.0 / (double)(EOM_RADAU_STAGES + 1));
        factor = (bent < factor) ? bent : factor;
    }
    factor = (factor > 8.0) ? 8.0 : ((factor < 0.2) ? 0.2 : factor);
    if (taken != 0) {
        if ((factor > 1.0) && (factor < 1.2)) { factor = 1.0; } /* factors of this length serve again */
        radau->excess[l] = (excess > 1e-2) ? excess : 1e-2;
        if (!(radau->slowness[l] < EOM_RADAU_SLOW)) { radau->factored[l] = 0.0; }
    } else if (radau->solved[l] == 0) { /* factors of where the step begins, or if they are, a shorter step */
        factor = (radau->young[l] == 0) ? 1.0 : ((radau->last[l] > 0.0) ? 0.5 : 0.1);
        radau->factored[l] = 0.0;
        radau->slowness[l] = 1.0;
    } else {
        /* the error says how much shorter */
    }
    EOM_F(go_on)(p, taken, factor, excess, length, duration, where);
    return taken;
}

/* Keep the polynomials of steps that are taken. */
EOM_LOCAL void EOM_F(keep_inside)(EOM_F(integration) *restrict it)
{
    EOM_F(radau) *const radau = &it->radau;
    const int nx = EOM_STATE_OF(it->problem.motion.robot->sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(nx);
    for (int k = 0; k < EOM_RADAU_STAGES; ++k) {
        EOM_REAL *const kept = &radau->inside[k * apart];
        EOM_REAL *const made = (EOM_WIDTH > 1) ? radau->here : kept;
        if ((EOM_WIDTH == 1) && (it->taken[0] == 0)) { continue; }
        EOM_F(weigh)(nx, EOM_RADAU_STAGES, eom_radau_inside[k], radau->z, apart, made);
        for (int l = 0; (EOM_WIDTH > 1) && (l < (int)EOM_WIDTH); ++l) {
            for (int i = 0; (it->taken[l] != 0) && (i < nx); ++i) { EOM_LANE_OF(kept[i], l) = EOM_LANE_OF(made[i], l); }
        }
    }
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (it->taken[l] != 0) { radau->last[l] = it->length[l]; }
    }
}
