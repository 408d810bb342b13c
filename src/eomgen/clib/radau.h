/* radau.h: steps of Radau IIA, a fully implicit method of five stages and order 9, of one state, or of one in every lane.
 *
 * With the increments z of its stages transformed by the eigenvectors of its matrix, a simplified Newton iteration solves one
 * real and two complex systems (E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", section IV.8), each with the
 * robot's own elimination: M + c D + c^2 K for c = h / eigenvalue, as stages of the Rosenbrock method have it.  Slopes that these
 * leave out, of gravity, velocities and inertia, cost iterations, not order.  Factors are kept from step to step where its
 * length stays and iterations converge fast. */

/* What steps of lanes compute with, and what one leaves to the next: increments of stages, transformed, and rates there;
 * coefficients of the polynomial of the last step, from the first power on, and how long that was, 0 where there is none; states
 * and gains that factors are of, and for how long a step; and what Newton's iteration came to. */
typedef struct {
    EOM_REAL *z;      /* (stages, nx), nx = nq + nv */
    EOM_REAL *w;      /* (stages, nx) */
    EOM_REAL *rates;  /* (stages, 2 nv + 3 m) */
    EOM_REAL *inside; /* (stages, nx) */
    EOM_REAL *here;   /* 2 nv */
    EOM_REAL *scale;  /* nx: one over what is allowed */
    EOM_REAL *change; /* 2 nx: of w, real, then imaginary parts */
    EOM_REAL *right;  /* 2 nx: right-hand sides, real, then imaginary parts */
    EOM_REAL *pairs;  /* 2 nx: those of q, then of v, both real, then imaginary parts */
    EOM_REAL *rise;   /* 2 nv: changes of rates, real, then imaginary parts */
    EOM_REAL *at;     /* nx + 2 nu: q, v, gains of coordinates, of velocities */
    EOM_REAL *factors[1 + EOM_RADAU_PAIRS];
    double factored[EOM_WIDTH];
    double last[EOM_WIDTH];
    double excess[EOM_WIDTH];   /* error of the last step beside what is allowed */
    double slowness[EOM_WIDTH]; /* what an iteration leaves of an error, over what it takes away */
    unsigned long long turned[EOM_WIDTH]; /* how joints of three rotations are turned, as a code */
    int rounds[EOM_WIDTH];
    int solves[EOM_WIDTH]; /* whether a lane iterates */
    int solved[EOM_WIDTH];
    double evaluations[EOM_WIDTH];  /* of rates, so far */
    double eliminations[EOM_WIDTH]; /* of all matrices */
    int young[EOM_WIDTH]; /* whether factors are of the state where the step begins */
} EOM_F(radau);

/* Take room from a workspace. */
EOM_LOCAL void EOM_F(carve_radau)(const EOM(sizes) *restrict sizes, EOM_F(radau) *restrict radau, EOM_F(workspace) *restrict work)
{
    const int nv = EOM_RATES_OF(sizes);
    const int pair = EOM_PADDED_TO_BLOCKS(EOM_STATE_OF(sizes));
    radau->z = work->state;
    radau->w = &radau->z[EOM_RADAU_STAGES * pair];
    radau->inside = &radau->w[EOM_RADAU_STAGES * pair];
    radau->rates = &radau->inside[EOM_RADAU_STAGES * pair];
    radau->here = &radau->rates[EOM_RADAU_STAGES * EOM_PADDED_TO_BLOCKS(2 * nv + 3 * EOM_M_OF(sizes))];
    radau->scale = &radau->here[EOM_PADDED_TO_BLOCKS(2 * nv)];
    radau->change = &radau->scale[pair];
    radau->right = &radau->change[2 * pair];
    radau->pairs = &radau->right[2 * pair];
    radau->rise = &radau->pairs[2 * pair];
    radau->at = &radau->rise[2 * EOM_PADDED_TO_BLOCKS(nv)];
    radau->factors[0] = &radau->at[EOM_PADDED_TO_BLOCKS(EOM_STATE_OF(sizes) + 2 * EOM_INPUTS_OF(sizes))];
    radau->factors[1] = &radau->factors[0][EOM_PADDED_TO_BLOCKS(sizes->factors)];
    for (int k = 2; k <= EOM_RADAU_PAIRS; ++k) { radau->factors[k] = &radau->factors[k - 1][EOM_PADDED_TO_BLOCKS(sizes->pair_factors)]; }
    work->state = &radau->factors[EOM_RADAU_PAIRS][EOM_PADDED_TO_BLOCKS(sizes->pair_factors)];
    (void)memset(radau->z, 0, (size_t)(work->state - radau->z) * sizeof *radau->z);
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        radau->factored[l] = 0.0;
        radau->last[l] = 0.0;
        radau->excess[l] = 1.0;
        radau->slowness[l] = 1.0;
        radau->turned[l] = 0U;
        radau->rounds[l] = 0;
        radau->solves[l] = 0;
        radau->solved[l] = 0;
        radau->young[l] = 0;
        radau->evaluations[l] = 0.0;
        radau->eliminations[l] = 0.0;
    }
}

/* Forget what the steps of a lane have left: its next one begins anew. */
EOM_LOCAL void EOM_F(forget_radau)(const EOM(sizes) *restrict sizes, EOM_F(radau) *restrict radau, int l)
{
    const int apart = EOM_PADDED_TO_BLOCKS(EOM_STATE_OF(sizes));
    (void)sizes;
    radau->factored[l] = 0.0;
    radau->last[l] = 0.0;
    radau->slowness[l] = 1.0;
    for (int i = 0; i < EOM_RADAU_STAGES * apart; ++i) { EOM_LANE_OF(radau->inside[i], l) = EOM_C(0.0); }
}

/* Look at how lanes' joints of three rotations are turned, and forget what steps of lanes have left that turned one since. */
EOM_LOCAL void EOM_F(look_at_charts)(const EOM(sizes) *restrict sizes, const EOM_F(charts) *restrict charts, EOM_F(radau) *restrict radau, int since)
{
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        unsigned long long code = 0U;
        for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) { code = 3U * code + ((charts->is_turned[l * EOM_ROTATIONS_OF(sizes) + k] != 0) ? 1U : 0U); }
        if ((since != 0) && (code != radau->turned[l])) { EOM_F(forget_radau)(sizes, radau, l); }
        radau->turned[l] = code;
    }
}

/* Factors of all matrices at the states and for the steps that lanes have them of; those that are known already become the same. */
EOM_LOCAL void EOM_F(factor_radau)(const EOM_F(problem) *restrict problem, EOM_F(radau) *restrict radau)
{
    const EOM_REAL *const at = radau->at;
    const EOM_REAL *const v = &at[EOM_POSITIONS_OF(problem->motion.robot->sizes)];
    const EOM_REAL *const kp = &v[EOM_RATES_OF(problem->motion.robot->sizes)];
    const EOM_REAL *const kd = &kp[EOM_INPUTS_OF(problem->motion.robot->sizes)];
    EOM_REAL dt = EOM_WHOLE(EOM_C(1.0));
    EOM_REAL times[6]; /* two of them its spans */
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (radau->factored[l] > 0.0) { EOM_LANE_OF(dt, l) = (EOM_SCALAR)radau->factored[l]; }
    }
    times[0] = dt / eom_radau_real;
    times[1] = times[0] * times[0];
    EOM_F(solve_or_note)(problem, EOM_F(factors_of_stage), at, v, kp, kd, times, radau->factors[0]);
    for (int k = 0; k < EOM_RADAU_PAIRS; ++k) {
        const EOM_SCALAR a = eom_radau_pairs[k][0];
        const EOM_SCALAR b = eom_radau_pairs[k][1];
        const EOM_SCALAR square = a * a + b * b;
        times[0] = (a / square) * dt;
        times[2] = (-b / square) * dt;
        times[1] = times[0] * times[0] - times[2] * times[2];
        times[3] = EOM_C(2.0) * (times[0] * times[2]);
        times[4] = dt / EOM_MATH(sqrt)(square);
        times[5] = times[4] * times[4];
        EOM_F(solve_or_note)(problem, EOM_F(factors_of_pair), at, v, kp, kd, times, radau->factors[1 + k]);
    }
}

/* Have factors of where steps begin in lanes whose present ones are for a step of another length, or led to slow iterations. */
EOM_LOCAL void EOM_F(renew_radau)(const EOM_F(problem) *restrict problem, const EOM_F(step) *restrict step, EOM_F(radau) *restrict radau, EOM_F(workspace) work)
{
    const int nx = EOM_STATE_OF(problem->motion.robot->sizes);
    const int nu = EOM_INPUTS_OF(problem->motion.robot->sizes);
    EOM_REAL *const gains = radau->change;
    int some = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        radau->young[l] = ((radau->solves[l] != 0) && !(radau->factored[l] == problem->clock.step[l])) ? 1 : 0;
        if (radau->young[l] != 0) { some = 1; }
    }
    if (some == 0) { return; }
    EOM_F(gains)(problem, step->x, gains, &gains[nu], work);
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (radau->young[l] == 0) { continue; }
        radau->factored[l] = problem->clock.step[l];
        radau->eliminations[l] += 1.0;
        for (int i = 0; i < nx; ++i) { EOM_LANE_OF(radau->at[i], l) = EOM_LANE_OF(step->x[i], l); }
        for (int i = 0; i < 2 * nu; ++i) { EOM_LANE_OF(radau->at[nx + i], l) = EOM_LANE_OF(gains[i], l); }
    }
    EOM_F(factor_radau)(problem, radau);
}

/* Read what steps of a lane have left from kept, where the last call put it, or with keep put it there for the next one. */
EOM_LOCAL void EOM_F(carry_radau)(const EOM_F(problem) *restrict problem, int keep, int l, double *restrict kept, EOM_F(radau) *restrict radau)
{
    const int nx = EOM_STATE_OF(problem->motion.robot->sizes);
    const int held = nx + 2 * EOM_INPUTS_OF(problem->motion.robot->sizes);
    (void)problem; /* where sizes are constants */
    double *const number[6] = { &radau->factored[l], &radau->last[l], &radau->excess[l], &radau->slowness[l], &radau->evaluations[l], &radau->eliminations[l] };
    for (int i = 0; i < 6; ++i) {
        if (keep != 0) { kept[i] = *number[i]; } else { *number[i] = kept[i]; }
    }
    for (int i = 0; i < held + EOM_RADAU_STAGES * nx; ++i) {
        const int k = i - held; /* among coefficients of the polynomial */
        EOM_REAL *const own = (k < 0) ? &radau->at[i] : &radau->inside[k / nx * EOM_PADDED_TO_BLOCKS(nx) + k % nx];
        if (keep != 0) { kept[6 + i] = (double)EOM_LANE_OF(*own, l); } else { EOM_LANE_OF(*own, l) = (EOM_SCALAR)kept[6 + i]; }
    }
}

/* Go on with what the last call kept of the states at place. */
EOM_LOCAL void EOM_F(resume_radau)(const EOM_F(problem) *restrict problem, const size_t *restrict place, const eom_progress *restrict progress, EOM_F(radau) *restrict radau)
{
    int some = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        double *const kept = progress[place[l]].kept;
        if ((kept == NULL) || !(kept[2] > 0.0)) { continue; }
        EOM_F(carry_radau)(problem, 0, l, kept, radau);
        if (kept[0] > 0.0) { some = 1; }
    }
    if (some != 0) { EOM_F(factor_radau)(problem, radau); }
}

/* Keep for the next call what steps of the states at place have left. */
EOM_LOCAL void EOM_F(keep_radau)(const EOM_F(problem) *restrict problem, const size_t *restrict place, const eom_progress *restrict progress, EOM_F(radau) *restrict radau)
{
    for (int l = 0; l < problem->clock.here; ++l) {
        if (progress[place[l]].kept != NULL) { EOM_F(carry_radau)(problem, 1, l, progress[place[l]].kept, radau); }
    }
}

/* Increments of stages to begin with, on the polynomial of the last step, and what they are transformed. */
EOM_LOCAL void EOM_F(begin_radau)(const EOM_F(problem) *restrict problem, EOM_F(radau) *restrict radau)
{
    const int pair = EOM_STATE_OF(problem->motion.robot->sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(pair);
    EOM_REAL ratio = EOM_WHOLE(EOM_C(1.0));
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (radau->last[l] > 0.0) { EOM_LANE_OF(ratio, l) = (EOM_SCALAR)(problem->clock.step[l] / radau->last[l]); }
    }
    for (int s = 0; s < EOM_RADAU_STAGES; ++s) {
        const EOM_REAL share = (EOM_SCALAR)eom_radau_shares[s] * ratio + EOM_C(1.0);
        EOM_REAL power[EOM_RADAU_STAGES];
        EOM_REAL whole = share;
        for (int k = 0; k < EOM_RADAU_STAGES; ++k) {
            power[k] = whole - EOM_C(1.0);
            whole = whole * share;
        }
        EOM_F(follow)(pair, EOM_RADAU_STAGES, power, radau->inside, apart, &radau->z[s * apart]);
    }
    for (int s = 0; s < EOM_RADAU_STAGES; ++s) { EOM_F(weigh)(pair, EOM_RADAU_STAGES, eom_radau_ahead[s], radau->z, apart, &radau->w[s * apart]); }
}

/* Lanes that do not iterate any more have not failed since. */
EOM_LOCAL void EOM_F(forget_failures)(const EOM_F(radau) *restrict radau, const int *restrict before, int *restrict failed)
{
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (radau->solves[l] == 0) { failed[l] = before[l]; }
    }
}

/* Rates at all stages, and their powers, which stay what they were in lanes that do not iterate any more. */
EOM_LOCAL void EOM_F(rates_of_radau)(const EOM_F(problem) *restrict problem, const EOM_F(step) *restrict step, EOM_F(radau) *restrict radau, EOM_F(workspace) work)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const int nx = EOM_STATE_OF(robot->sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(nx);
    const int rows = EOM_PADDED_TO_BLOCKS(2 * EOM_RATES_OF(robot->sizes) + 3 * EOM_M_OF(robot->sizes));
    int failed_before[EOM_WIDTH];
    (void)memcpy(failed_before, problem->failed, sizeof failed_before);
    for (int s = 0; s < EOM_RADAU_STAGES; ++s) {
        double *const power = (problem->clock.power == NULL) ? NULL : &problem->clock.power[(1 + s) * EOM_WORKS * (int)EOM_WIDTH];
        double before[EOM_WORKS * EOM_WIDTH];
        if (power != NULL) { (void)memcpy(before, power, sizeof before); }
        EOM_F(add)(nx, step->x, &radau->z[s * apart], radau->here);
        if (robot->sizes->has_redundant_rows != 0) { (void)EOM_F(assemble)(robot, problem->motion.h, radau->here, &radau->here[EOM_POSITIONS_OF(robot->sizes)], work.state, problem->failed); }
        EOM_F(rate)(problem, eom_radau_shares[s], 1 + s, radau->here, &radau->rates[s * rows], work);
        if (power == NULL) { continue; }
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            for (int w = 0; (w < EOM_WORKS) && (radau->solves[l] == 0); ++w) { power[w * (int)EOM_WIDTH + l] = before[w * (int)EOM_WIDTH + l]; }
        }
    }
    EOM_F(forget_failures)(radau, failed_before, problem->failed);
}

/* A right-hand side, of q, then of v: transformed rates less (real w_row - imaginary other) / h. */
EOM_INLINE void EOM_F(radau_right)(const EOM_F(radau) *restrict radau, int pair, int rows, int row, int beside, EOM_REAL real, EOM_REAL imaginary, EOM_REAL *restrict right)
{
    const int apart = EOM_PADDED_TO_BLOCKS(pair);
    const EOM_REAL *const w_row = &radau->w[row * apart];
    const EOM_REAL *const other = &radau->w[beside * apart];
    const EOM_SCALAR *const weight = eom_radau_ahead[row];
    const EOM_REAL *restrict const rates = radau->rates;
    for (int block = 0; block < pair; block += EOM_BLOCK) {
        for (int i = block; i < block + EOM_BLOCK; ++i) {
            EOM_REAL sum = weight[0] * rates[i];
            EOM_UNROLL(5)
            for (int s = 1; s < EOM_RADAU_STAGES; ++s) { sum += weight[s] * rates[s * rows + i]; }
            right[i] = sum - (real * w_row[i] - imaginary * other[i]);
        }
    }
}

/* Add changes to a row of w, but for lanes that do not iterate, and their squares beside what is allowed to a sum. */
EOM_INLINE void EOM_F(change_radau)(int pair, int masked, EOM_REAL *restrict change, EOM_REAL *restrict w, EOM_REAL *restrict sum, const EOM_F(radau) *restrict radau)
{
    for (int l = 0; (masked != 0) && (l < (int)EOM_WIDTH); ++l) {
        for (int i = 0; (radau->solves[l] == 0) && (i < pair); ++i) { EOM_LANE_OF(change[i], l) = EOM_C(-0.0); }
    }
    EOM_F(add_to)(pair, change, w);
    *sum += EOM_F(sum_of_squares)(pair, change, radau->scale);
}

/* One iteration: w and z by the rates there.  Squares of changes are summed up. */
EOM_LOCAL void EOM_F(iterate_radau)(const EOM_F(problem) *restrict problem, EOM_REAL dt, int masked, EOM_F(radau) *restrict radau, EOM_REAL *restrict sum)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const EOM_REAL *const h = problem->motion.h;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int nx = nq + nv;
    const int apart = EOM_PADDED_TO_BLOCKS(nx);
    const int rows = EOM_PADDED_TO_BLOCKS(2 * nv + 3 * EOM_M_OF(robot->sizes));
    const size_t q_size = (size_t)nq * sizeof *radau->w;
    const size_t v_size = (size_t)nv * sizeof *radau->w;
    const EOM_REAL inverse = EOM_WHOLE(EOM_C(1.0)) / dt;
    EOM_REAL *const right = radau->right;
    EOM_REAL *const other = &right[apart];
    EOM_REAL *const change = radau->change;
    EOM_REAL *const turned = &change[apart];
    EOM_REAL *const by_q = radau->pairs;
    EOM_REAL *const by_v = &by_q[2 * nq];
    EOM_REAL *const v = radau->rise;
    EOM_REAL *const v_turned = &v[EOM_PADDED_TO_BLOCKS(nv)];
    EOM_REAL *const w = radau->here;
    *sum = EOM_WHOLE(EOM_C(0.0));
    {
        const EOM_REAL time = dt / eom_radau_real;
        EOM_F(radau_right)(radau, nx, rows, 0, 0, eom_radau_real * inverse, *sum, right);
        (void)robot->stage_solution(h, radau->factors[0], &right[nq], right, w);
        EOM_F(add_scaled)(nv, time, &right[nq], w, v);
        EOM_F(add_scaled)(nq, time, v, right, change);
        (void)memcpy(&change[nq], v, v_size);
        EOM_F(change_radau)(nx, masked, change, radau->w, sum, radau);
    }
    for (int k = 0; k < EOM_RADAU_PAIRS; ++k) {
        const EOM_SCALAR a = eom_radau_pairs[k][0];
        const EOM_SCALAR b = eom_radau_pairs[k][1];
        const EOM_SCALAR square = a * a + b * b;
        const EOM_REAL real = a * inverse;
        const EOM_REAL imaginary = b * inverse;
        const EOM_REAL c = (a / square) * dt;
        const EOM_REAL d = (-b / square) * dt;
        const int row = 1 + 2 * k;
        EOM_F(radau_right)(radau, nx, rows, row, row + 1, real, imaginary, right);
        EOM_F(radau_right)(radau, nx, rows, row + 1, row, real, -imaginary, other);
        (void)memcpy(by_q, right, q_size);
        (void)memcpy(&by_q[nq], other, q_size);
        (void)memcpy(by_v, &right[nq], v_size);
        (void)memcpy(&by_v[nv], &other[nq], v_size);
        (void)robot->pair_solution(h, radau->factors[1 + k], by_v, by_q, w);
        EOM_F(add_turned)(nv, c, d, &right[nq], w, &other[nq], &w[nv], v, v_turned);
        EOM_F(add_turned)(nq, c, d, v, right, v_turned, other, change, turned);
        (void)memcpy(&change[nq], v, v_size);
        (void)memcpy(&turned[nq], v_turned, v_size);
        EOM_F(change_radau)(nx, masked, change, &radau->w[row * apart], sum, radau);
        EOM_F(change_radau)(nx, masked, turned, &radau->w[(row + 1) * apart], sum, radau);
    }
    for (int s = 0; s < EOM_RADAU_STAGES; ++s) { EOM_F(weigh)(nx, EOM_RADAU_STAGES, eom_radau_back[s], radau->w, apart, &radau->z[s * apart]); }
}

/* Look at the norms of changes: lanes whose iteration has converged, or will not, or in which equations failed, end theirs.
 * Whether any goes on. */
EOM_LOCAL int EOM_F(look_at_radau)(int round, const double *restrict enough, EOM_REAL sum, const int *restrict failed, double *restrict before, EOM_F(radau) *restrict radau)
{
    int some = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (radau->solves[l] == 0) { continue; }
        const double size = (failed[l] != 0) ? HUGE_VAL : sqrt((double)EOM_LANE_OF(sum, l) / (double)EOM_RADAU_STAGES);
        const double ratio = (round > 0) ? (size / before[l]) : 0.0;
        double left = radau->slowness[l];
        radau->rounds[l] = round + 1;
        if (round == 0) { /* as in the last step, but what begins within this one, a contact say, is not known of */
            left = (left > EOM_RADAU_TRUST) ? left : EOM_RADAU_TRUST;
        } else if (ratio < 1.0) {
            left = ratio / (1.0 - ratio);
        } else {
            left = HUGE_VAL;
        }
        if (round > 0) { radau->slowness[l] = left; }
        if ((size == 0.0) || (left * size < enough[l]) || ((round > 0) && (size < EOM_RADAU_ROUNDING) && (ratio > 0.3))) {
            radau->solved[l] = 1;
            radau->solves[l] = 0;
        } else if (!(size < HUGE_VAL) || ((round > 0) && !(left * pow(ratio, (double)(EOM_RADAU_ROUNDS - 1 - round)) * size < enough[l]))) {
            radau->solves[l] = 0;
        } else {
            some = 1;
        }
        before[l] = size;
    }
    return some;
}

/* The error of a step by the rates dx of some state where it begins, in the place of ``error``. */
EOM_LOCAL void EOM_F(error_of_radau)(const EOM_F(problem) *restrict problem, EOM_REAL dt, const EOM_REAL *restrict dx, EOM_F(radau) *restrict radau, EOM_REAL *restrict error)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const EOM_REAL inverse = EOM_WHOLE(EOM_C(1.0)) / dt;
    const EOM_REAL time = dt / eom_radau_real;
    EOM_REAL *restrict const right = radau->right;
    EOM_REAL *restrict const w = radau->change;
    EOM_F(advance)(nq + nv, EOM_RADAU_STAGES, eom_radau_error, inverse, radau->z, EOM_PADDED_TO_BLOCKS(nq + nv), dx, right);
    (void)robot->stage_solution(problem->motion.h, radau->factors[0], &right[nq], right, w);
    for (int i = 0; i < nv; ++i) { error[nq + i] = time * (right[nq + i] + w[i]); }
    for (int i = 0; i < nq; ++i) { error[i] = time * (error[nq + i] + right[i]); }
}
