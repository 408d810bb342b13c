/* adaptive_steps.h: steps whose length the error controls, of one state, or of one in every lane with a step of its length. */

/* A step: states x = (q, v) at its beginning and at its end, behind them integrals over the step of internal states, nv - nq,
 * by which dense output has these as it has velocities; their rates dx; its error, factors of its matrix, and its polynomial, or
 * what bends that. */
typedef struct {
    EOM_REAL *x;
    EOM_REAL *dx;
    EOM_REAL *x_end;
    EOM_REAL *dx_end;
    EOM_REAL *error;
    EOM_REAL *factors;
    EOM_REAL *bend;         /* nv */
    const EOM_REAL *inside; /* of Radau IIA: coefficients of its polynomial, (stages, nq + nv), from the first power on */
} EOM_F(step);

/* Equations that fail where a matrix is singular. */
enum EOM_F(solved) { EOM_F(rates_of_state), EOM_F(factors_of_stage), EOM_F(factors_of_pair) };

/* Solve one of them at a state: for accelerations under forces, or for factors with gains of coordinates and velocities. */
EOM_INLINE int EOM_F(solve)(const EOM_F(robot) *restrict robot, enum EOM_F(solved) what, const EOM_REAL *h, const EOM_REAL *q, const EOM_REAL *v, const EOM_REAL *first, const EOM_REAL *second, const EOM_REAL *times, EOM_REAL *restrict out)
{
    if (what == EOM_F(rates_of_state)) { return robot->forward_dynamics(h, q, v, first, out); }
    if (what == EOM_F(factors_of_stage)) { return robot->stage_factors(h, q, v, first, second, times, out); }
    return robot->pair_factors(h, q, v, first, second, times, &times[4], out);
}

#if defined(EOM_LANES_HERE)
/* Let lanes that failed have the numbers of another one. */
EOM_LOCAL void EOM_F(follow_lane)(int count, const int *restrict failed, int other, EOM_REAL *restrict x)
{
    (void)other; /* without vectors there is one lane */
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        for (int i = 0; (failed[l] != 0) && (i < count); ++i) { EOM_LANE_OF(x[i], l) = EOM_LANE_OF(x[i], other); }
    }
}

/* Find all lanes in which equations fail, behind the first one, which has said so: solve again and again with those that failed in
 * the place of another one.  The other lanes get the same results, to the bit. */
EOM_LOCAL void EOM_F(find_failures)(const EOM_F(problem) *restrict problem, enum EOM_F(solved) what, const EOM_REAL *q, const EOM_REAL *v, const EOM_REAL *first, const EOM_REAL *second, const EOM_REAL *times, EOM_REAL *restrict out, int status)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int nu = EOM_INPUTS_OF(robot->sizes);
    const int hoisted = robot->sizes->hoisted;
    const int statuses = (EOM_M_OF(robot->sizes) > 0) ? (2 * nq + 3 * EOM_M_OF(robot->sizes)) : nq;
    EOM_REAL *const state = problem->spare; /* q, v, and two more arrays */
    EOM_REAL *const one = &state[nq + nv];
    EOM_REAL *const two = &one[nu];
    EOM_REAL *const time = &two[nu];
    EOM_REAL *const h = &time[6];
    int shares = 0;
    int failed[EOM_WIDTH] = { 0 };
    int other = 0;
    int left = status;
    (void)memcpy(state, q, (size_t)nq * sizeof *q);
    (void)memcpy(&state[nq], v, (size_t)nv * sizeof *v);
    (void)memcpy(one, first, (size_t)nu * sizeof *first);
    (void)memcpy(two, (second == NULL) ? first : second, (size_t)nu * sizeof *first);
    (void)memcpy(h, problem->motion.h, (size_t)hoisted * sizeof *h);
    if (times != NULL) { shares = (what == EOM_F(factors_of_pair)) ? 6 : 2; }
    for (int i = 0; i < shares; ++i) { time[i] = times[i]; }
    while ((left != 0) && (other < (int)EOM_WIDTH)) {
        const int said = (left - 1) / statuses;
        failed[(failed[said] == 0) ? said : other] = 1 + (left - 1) % statuses; /* or the one that it follows */
        while ((other < (int)EOM_WIDTH) && (failed[other] != 0)) { ++other; }
        if (other == (int)EOM_WIDTH) { continue; }
        EOM_F(follow_lane)(nq + nv + 2 * nu + shares, failed, other, state);
        EOM_F(follow_lane)(hoisted, failed, other, h);
        left = EOM_F(solve)(robot, what, h, state, &state[nq], one, two, time, out);
    }
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (problem->failed[l] == 0) { problem->failed[l] = failed[l]; }
    }
}
#endif

/* Solve equations at a state, and note the lanes in which they fail: their steps are rejected. */
EOM_INLINE void EOM_F(solve_or_note)(const EOM_F(problem) *restrict problem, enum EOM_F(solved) what, const EOM_REAL *q, const EOM_REAL *v, const EOM_REAL *first, const EOM_REAL *second, const EOM_REAL *times, EOM_REAL *restrict out)
{
    const int status = EOM_F(solve)(problem->motion.robot, what, problem->motion.h, q, v, first, second, times, out);
    if (status == 0) { return; }
#if defined(EOM_LANES_HERE)
    EOM_F(find_failures)(problem, what, q, v, first, second, times, out, status);
#else
    if (problem->failed[0] == 0) { problem->failed[0] = status; }
#endif
}

/* Put prescribed motions at the ends of lanes' steps into q and v: as steps come to them, or where loops are closed as they go
 * on from there; they have no error. */
EOM_LOCAL void EOM_F(put_prescribed_ends)(const EOM_F(problem) *restrict problem, const EOM_F(step) *restrict step, double *restrict work)
{
    const int nq = EOM_POSITIONS_OF(problem->motion.robot->sizes);
    const int closed = (EOM_M_OF(problem->motion.robot->sizes) > 0) ? 1 : 0;
    for (int l = 0; l < problem->clock.here; ++l) {
        const eom_prescribed *const motions = (problem->clock.inputs[l] == NULL) ? NULL : problem->clock.inputs[l]->given;
        EOM_F(put_prescribed)(problem, l, (closed != 0) ? eom_instant_of(problem->clock.end[l]) : EOM_F(instant_at)(&problem->clock, l, 1.0), step->x_end, work);
        for (int k = 0; (motions != NULL) && (k < motions->size); ++k) {
            const int i = motions->place[k];
            EOM_LANE_OF(step->error[i], l) = EOM_C(0.0);
            EOM_LANE_OF(step->error[nq + i], l) = EOM_C(0.0);
        }
    }
}

/* Power of what moves prescribed coordinates: what the motion takes, less what drives and wrenches give; loops give none. */
EOM_LOCAL void EOM_F(power_of_prescribed)(const EOM_F(problem) *restrict problem, int stage, const EOM_REAL *restrict q, const EOM_REAL *restrict v, const EOM_REAL *restrict a, EOM_SCALAR *restrict work)
{
    const int nq = EOM_POSITIONS_OF(problem->motion.robot->sizes);
    const int nv = EOM_RATES_OF(problem->motion.robot->sizes);
    const int nu = EOM_INPUTS_OF(problem->motion.robot->sizes);
    EOM_SCALAR *const position = work;
    EOM_SCALAR *const rate = &position[nq];
    EOM_SCALAR *const second = &rate[nv];
    EOM_SCALAR *const needed = &second[nv];
    EOM_SCALAR *const none = &needed[nv];
    for (int l = 0; l < problem->clock.here; ++l) {
        const EOM(energy_balance) *const balance = problem->clock.inputs[l]->work;
        double *const power = &problem->clock.power[stage * EOM_WORKS * (int)EOM_WIDTH + l];
        for (int i = 0; i < nq; ++i) { position[i] = EOM_LANE_OF(q[i], l); }
        for (int i = 0; i < nv; ++i) {
            rate[i] = EOM_LANE_OF(v[i], l);
            second[i] = EOM_LANE_OF(a[i], l);
        }
        for (int i = 0; i < nu; ++i) { none[i] = EOM_C(0.0); }
        if (balance->residual != NULL) {
            (void)balance->residual(balance->needed_h, position, rate, second, none, needed);
        } else {
            (void)balance->needed(balance->needed_h, position, rate, second, needed);
        }
        double moving = power[(int)EOM_WIDTH] - power[0] - power[2 * (int)EOM_WIDTH];
        for (int i = 0; i < nv; ++i) { moving += (double)needed[i] * (double)rate[i]; }
        power[(int)EOM_WIDTH] = moving;
    }
}

/* The rate of a state (q, v), and of what stands behind it, at a share of the step; lanes in which there is none are noted. */
EOM_LOCAL void EOM_F(rate)(const EOM_F(problem) *restrict problem, double share, int stage, EOM_REAL *restrict x, EOM_REAL *restrict dx, EOM_F(workspace) work)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int held = EOM_F(drives_alone)(problem);
    EOM_REAL *restrict const force = work.state;
    work.state += EOM_PADDED_TO_BLOCKS(EOM_INPUTS_OF(robot->sizes));
    if (held == 0) { EOM_F(forces)(problem, share, stage, x, &x[nq], force, NULL, work); }
    EOM_F(solve_or_note)(problem, EOM_F(rates_of_state), x, &x[nq], (held != 0) ? problem->u : force, NULL, NULL, &dx[nq]);
    for (int i = 0; i < nq; ++i) { dx[i] = x[nq + i]; }
    for (int i = nq; i < nv; ++i) { dx[nv + i] = x[nq + i]; }
    if ((robot->sizes->is_prescribed != NULL) && (problem->clock.power != NULL)) { EOM_F(power_of_prescribed)(problem, stage, x, &x[nq], &dx[nq], (EOM_SCALAR *)(void *)work.state); }
}

/* Take one stage of a Rosenbrock method, a linear system with the step's matrix, from the rate dx there; increments:
 * (stages, 2 nv). */
EOM_IN_PLACE void EOM_F(rosenbrock_stage)(const EOM_F(problem) *restrict problem, const EOM(rosenbrock_method) *restrict method, int stage, const EOM_REAL *restrict factors, EOM_REAL time, EOM_REAL inverse, const EOM_REAL *restrict dx, EOM_REAL *restrict increments, EOM_REAL *restrict right, EOM_REAL *restrict w)
{
    const int nq = EOM_POSITIONS_OF(problem->motion.robot->sizes);
    const int nv = EOM_RATES_OF(problem->motion.robot->sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(2 * nv);
    EOM_REAL *restrict const increment = &increments[stage * apart];
    if (stage == 0) {
        EOM_F(copy)(2 * nv, dx, right);
    } else {
        EOM_F(advance)(2 * nv, stage, method->c[stage], inverse, increments, apart, dx, right);
    }
    (void)problem->motion.robot->stage_solution(problem->motion.h, factors, &right[nq], right, w);
    for (int i = 0; i < nv; ++i) { increment[nq + i] = time * (right[nq + i] + w[i]); }
    for (int i = 0; i < nq; ++i) { increment[i] = time * (increment[nq + i] + right[i]); }
    for (int i = nq; i < nv; ++i) { increment[nv + i] = time * (increment[nq + i] + right[nv + i]); }
}

/* Let an error be at least as large as x, lane by lane. */
EOM_INLINE void EOM_F(enlarge)(EOM_REAL x, EOM_REAL *restrict error)
{
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        if (fabs((double)EOM_LANE_OF(*error, l)) < fabs((double)EOM_LANE_OF(x, l))) { EOM_LANE_OF(*error, l) = EOM_LANE_OF(x, l); }
    }
}

/* Take a step of a Rosenbrock method from the rate at its beginning: its end, with friction the rate there, and its error. */
EOM_IN_PLACE void EOM_F(rosenbrock_step)(const EOM_F(problem) *restrict problem, const EOM(rosenbrock_method) *restrict method, EOM_REAL dt, const EOM_F(step) *restrict step, EOM_F(workspace) work)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const EOM_REAL *const h = problem->motion.h;
    double *const power = problem->clock.power;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(2 * nv);
    const EOM_REAL inverse = EOM_WHOLE(EOM_C(1.0)) / dt;
    EOM_REAL times[2];
    EOM_REAL *restrict const kp = work.state;
    EOM_REAL *restrict const kd = &kp[EOM_INPUTS_OF(robot->sizes)];
    EOM_REAL *restrict const w = &kp[apart];
    EOM_REAL *restrict const right = &w[EOM_PADDED_TO_BLOCKS(nv)];
    EOM_REAL *restrict const increments = &right[apart];               /* (stages, 2 nv) */
    EOM_REAL *restrict const dx = &increments[method->stages * apart]; /* 2 nv + 3 m */
    work.state = &dx[EOM_PADDED_TO_BLOCKS(2 * nv + 3 * EOM_M_OF(robot->sizes))];
    times[0] = method->diagonal * dt;
    times[1] = times[0] * times[0];
    EOM_F(gains)(problem, step->x, kp, kd, work);
    EOM_F(solve_or_note)(problem, EOM_F(factors_of_stage), step->x, &step->x[nq], kp, kd, times, step->factors);
    EOM_F(rosenbrock_stage)(problem, method, 0, step->factors, times[0], inverse, step->dx, increments, right, w);
    EOM_UNROLL(6)
    for (int stage = 1; stage < method->stages; ++stage) {
        if (method->begins[stage] != 0) {
            if (power != NULL) { (void)memcpy(&power[stage * EOM_WORKS * (int)EOM_WIDTH], power, (size_t)EOM_WORKS * (size_t)EOM_WIDTH * sizeof *power); }
            EOM_F(rosenbrock_stage)(problem, method, stage, step->factors, times[0], inverse, step->dx, increments, right, w);
            continue;
        }
        EOM_F(accumulate)(2 * nv, stage, method->a[stage], increments, apart, step->x, step->x_end);
        if (robot->sizes->has_redundant_rows != 0) { (void)EOM_F(assemble)(robot, h, step->x_end, &step->x_end[nq], work.state, problem->failed); } /* redundant rows answer to violations */
        EOM_F(rate)(problem, method->shares[stage], stage, step->x_end, dx, work);
        EOM_F(rosenbrock_stage)(problem, method, stage, step->factors, times[0], inverse, dx, increments, right, w);
    }
    EOM_F(accumulate)(2 * nv, method->stages, method->b, increments, apart, step->x, step->x_end);
    EOM_F(weigh)(nq + nv, method->stages, method->error, increments, apart, step->error);
    if (robot->sizes->has_friction != 0) {
        /* Friction that lets go within the step holds in its matrix, and both orders agree: what the matrix of the end leaves of
         * the difference between the end's rates and those of the last stage counts, too. */
        const int last = method->stages - 1;
        EOM_F(rate)(problem, 1.0, method->stages, step->x_end, step->dx_end, work);
        EOM_F(solve_or_note)(problem, EOM_F(factors_of_stage), step->x_end, &step->x_end[nq], kp, kd, times, step->factors);
        EOM_F(advance)(nq + nv, last, method->c[last], inverse, increments, apart, step->dx_end, right);
        for (int i = 0; i < nq + nv; ++i) { right[i] = times[0] * right[i] - increments[last * apart + i]; }
        (void)robot->stage_solution(h, step->factors, &right[nq], right, w);
        for (int i = 0; i < nv; ++i) {
            const EOM_REAL v_left = right[nq + i] + w[i];
            if (i < nq) { EOM_F(enlarge)(right[i] + times[0] * v_left, &step->error[i]); }
            EOM_F(enlarge)(v_left, &step->error[nq + i]);
        }
    }
}

/* Take a step of an explicit method from the rate at its beginning: its end, the rate there, and its error.  Where the last two
 * stages are at the same time and stiffness is not NULL, it becomes the step times what the difference of their accelerations is of
 * that of their velocities, by the tolerances, of the first lane (E. Hairer, G. Wanner, "Solving Ordinary Differential Equations
 * II", section IV.2). */
EOM_IN_PLACE void EOM_F(explicit_step)(const EOM_F(problem) *restrict problem, const EOM(explicit_method) *restrict method, EOM_REAL dt, const EOM_F(step) *restrict step, const EOM(tolerance) *restrict allowed, double *restrict stiffness, EOM_F(workspace) work)
{
    const EOM_F(robot) *const robot = problem->motion.robot;
    const int nq = EOM_POSITIONS_OF(robot->sizes);
    const int nv = EOM_RATES_OF(robot->sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(2 * nv + 3 * EOM_M_OF(robot->sizes));
    EOM_REAL *restrict const dx = work.state; /* (stages, 2 nv + 3 m) */
    const EOM_REAL *restrict const last = &dx[method->stages * apart];
    work.state = &dx[(method->stages + 1) * apart];
    EOM_F(copy)(2 * nv, step->dx, dx);
    EOM_UNROLL(6)
    for (int stage = 1; stage <= method->stages; ++stage) {
        EOM_F(advance)(2 * nv, stage, method->a[stage], dt, dx, apart, step->x, step->x_end);
        if (robot->sizes->has_redundant_rows != 0) { (void)EOM_F(assemble)(robot, problem->motion.h, step->x_end, &step->x_end[nq], work.state, problem->failed); } /* redundant rows answer to violations */
        EOM_F(rate)(problem, method->shares[stage], stage, step->x_end, &dx[stage * apart], work);
    }
    EOM_F(copy)(2 * nv, last, step->dx_end);
    EOM_F(weigh)(nq + nv, method->stages + 1, method->error, dx, apart, step->error);
    for (int i = 0; i < nq + nv; ++i) { step->error[i] = dt * step->error[i]; }
    if (stiffness != NULL) {
        const EOM_REAL *const before = &dx[(method->stages - 1) * apart];
        double change = 0.0;
        double moved = 0.0;
        for (int i = 0; i < nv; ++i) {
            const int rate = (i < nq) ? i : (nv + i);
            const double size = (double)allowed->atol[nq + i] + allowed->rtol * fabs((double)EOM_LANE_OF(step->x_end[nq + i], 0));
            const EOM_REAL change_v = last[nq + i] - before[nq + i];
            const EOM_REAL change_q = last[rate] - before[rate];
            const double by_a = (double)EOM_LANE_OF(change_v, 0) / size;
            const double by_v = (double)EOM_LANE_OF(change_q, 0) / size;
            change += by_a * by_a;
            moved += by_v * by_v;
        }
        *stiffness = (moved > 0.0) ? (problem->clock.step[0] * sqrt(change / moved)) : HUGE_VAL; /* nothing is known of it at rest */
    }
}

/* Hold drives and targets that act from a sample on, in a lane. */
EOM_LOCAL void EOM_F(hold)(const EOM(sizes) *restrict sizes, const EOM(drive) *restrict drive, size_t state, size_t sample, int l, EOM_REAL *restrict u, EOM_REAL *restrict target)
{
    const EOM_SCALAR *const row = &drive->u[state * drive->u_state + sample * drive->u_step];
    (void)sizes;
    (void)l;
    for (int i = 0; i < EOM_INPUTS_OF(sizes); ++i) { EOM_LANE_OF(u[i], l) = row[i]; }
    for (int i = 0; (drive->kp != NULL) && (i < EOM_POSITIONS_OF(sizes)); ++i) { EOM_LANE_OF(target[i], l) = drive->target[state * drive->target_state + sample * drive->target_step + (size_t)i]; }
}

/* The place among the tolerances of number i of a lane's state. */
EOM_LOCAL int EOM_F(place_of)(const EOM_F(motion) *restrict motion, int l, int i)
{
    const EOM(sizes) *const sizes = motion->robot->sizes;
    return (EOM_ROTATIONS_OF(sizes) > 0) ? EOM_F(described_place)(sizes, motion->charts, l, i) : i;
}

/* The greatest error of a lane's step beside what is allowed, and which number of the state has it; NaN counts as too great.
 * turns: whether there are joints of three rotations, whose tolerances have other places. */
EOM_IN_PLACE double EOM_F(greatest_error)(const EOM_F(motion) *restrict motion, const EOM(tolerance) *restrict allowed, int turns, int l, const EOM_F(step) *restrict step, int *restrict at)
{
    const int numbers = EOM_STATE_OF(motion->robot->sizes);
    double worst = 0.0;
    *at = (turns != 0) ? EOM_F(place_of)(motion, l, 0) : 0;
    (void)l;
    for (int i = 0; i < numbers; ++i) {
        const double begin = fabs((double)EOM_LANE_OF(step->x[i], l));
        const double end = fabs((double)EOM_LANE_OF(step->x_end[i], l));
        const int place = (turns != 0) ? EOM_F(place_of)(motion, l, i) : i;
        const double size = (double)allowed->atol[place] + allowed->rtol * ((begin > end) ? begin : end);
        const double ratio = fabs((double)EOM_LANE_OF(step->error[i], l)) / size;
        if (!(end < HUGE_VAL) || !(ratio <= worst)) {
            *at = place;
            worst = ratio;
            if (!(end < HUGE_VAL) || !(ratio < HUGE_VAL)) { return HUGE_VAL; }
        }
    }
    return worst;
}

EOM_LOCAL double EOM_F(error_norm)(const EOM_F(motion) *restrict motion, const EOM(tolerance) *restrict allowed, int l, const EOM_F(step) *restrict step, int *restrict where)
{
    if (EOM_ROTATIONS_OF(motion->robot->sizes) > 0) { return EOM_F(greatest_error)(motion, allowed, 1, l, step, where); }
    return EOM_F(greatest_error)(motion, allowed, 0, l, step, where);
}

/* A first step, s, from the sizes of the state and of its change. */
EOM_LOCAL double EOM_F(first_step)(const EOM_F(motion) *restrict motion, const EOM(tolerance) *restrict allowed, int l, const EOM_F(step) *restrict step)
{
    double size = 0.0;
    double change = 0.0;
    for (int i = 0; i < EOM_STATE_OF(motion->robot->sizes); ++i) {
        const int place = EOM_F(place_of)(motion, l, i);
        const double x = fabs((double)EOM_LANE_OF(step->x[i], l));
        const double rate = fabs((double)EOM_LANE_OF(step->dx[i], l));
        const double least = (double)allowed->atol[place] + allowed->rtol * x;
        if (x / least > size) { size = x / least; }
        if (rate / least > change) { change = rate / least; }
    }
    return ((size < 1e-5) || !(change > 1e-5)) ? 1e-6 : (0.01 * size / change);
}

/* What powers of a lane's stages make of a step, J: whole, or up to a share of one whose powers are a polynomial. */
EOM_LOCAL double EOM_F(work_of_step)(const double *restrict power, int work, int l, int method, double step, double share)
{
    const eom_error_control *const control = &eom_error_controls[method];
    double sum = 0.0;
    for (int stage = 0; stage < control->powers; ++stage) {
        double weight = (control->degree == 0) ? control->works[stage][0] : 0.0;
        for (int k = control->degree - 1; k >= 0; --k) { weight = share * (weight + control->works[stage][k]); }
        sum += weight * power[(stage * EOM_WORKS + work) * (int)EOM_WIDTH + l];
    }
    return step * sum;
}

/* What accelerations at both ends of a step of a Rosenbrock method say of velocities in between that coordinates and
 * velocities there do not, as its matrix damps that: accelerations of stiff coordinates are full of their errors.
 * work: nq + 2 nv. */
EOM_LOCAL void EOM_F(bend_of_step)(const EOM_F(problem) *restrict problem, EOM_REAL time, EOM_REAL dt, const EOM_F(step) *restrict step, EOM_REAL *restrict work)
{
    const int nq = EOM_POSITIONS_OF(problem->motion.robot->sizes);
    const int nv = EOM_RATES_OF(problem->motion.robot->sizes);
    EOM_REAL *restrict const right = work;
    EOM_REAL *restrict const shifts = &right[nv];
    EOM_REAL *restrict const w = &shifts[nq];
    for (int i = 0; i < nq; ++i) { shifts[i] = EOM_WHOLE(EOM_C(0.0)); }
    for (int i = 0; i < nv; ++i) {
        const EOM_REAL change = step->x_end[nq + i] - step->x[nq + i];
        right[i] = (dt * (step->dx[nq + i] + step->dx_end[nq + i]) - change - change) / time;
    }
    (void)problem->motion.robot->stage_solution(problem->motion.h, step->factors, right, shifts, w);
    for (int i = 0; i < nv; ++i) { step->bend[i] = time * (right[i] + w[i]); }
}

/* Dense output, a lane's state at a share of its step: of an explicit method the polynomial of degree 5 with its coordinates,
 * or integrals of internal states, velocities and accelerations, of a Rosenbrock method the cubic without the latter, and what is
 * bent, of Radau IIA the one through its stages. */
EOM_LOCAL void EOM_F(dense_output)(const EOM(sizes) *restrict sizes, double share, double length, int l, int method, const EOM_F(step) *restrict step, EOM_SCALAR *restrict q_out, EOM_SCALAR *restrict v_out)
{
    const double s = share;
    const int kind = eom_error_controls[method].kind;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int apart = EOM_PADDED_TO_BLOCKS(nq + nv);
    (void)sizes;
    (void)l;
    for (int i = 0; (kind == EOM_RADAU_KIND) && (i < nq + nv); ++i) {
        EOM_SCALAR *const out = (i < nq) ? &q_out[i] : &v_out[i - nq];
        double change = 0.0;
        EOM_UNROLL(5)
        for (int k = EOM_RADAU_STAGES - 1; k >= 0; --k) { change = s * (change + (double)EOM_LANE_OF(step->inside[k * apart + i], l)); }
        *out = (EOM_SCALAR)((double)EOM_LANE_OF(step->x[i], l) + change);
    }
    for (int i = 0; (kind != EOM_RADAU_KIND) && (i < nv); ++i) {
        const int integral = (i < nq) ? i : (nv + i);
        const double q0 = (double)EOM_LANE_OF(step->x[integral], l);
        const double d = (double)EOM_LANE_OF(step->x_end[integral], l) - q0;
        const double v0 = length * (double)EOM_LANE_OF(step->x[nq + i], l);
        const double v1 = length * (double)EOM_LANE_OF(step->x_end[nq + i], l);
        double c2 = 3.0 * d - 2.0 * v0 - v1;
        double c3 = v0 + v1 - 2.0 * d;
        double c4 = 0.0;
        double c5 = 0.0;
        if (kind == EOM_EXPLICIT_KIND) {
            const double a0 = 0.5 * length * length * (double)EOM_LANE_OF(step->dx[nq + i], l);
            const double a1 = 0.5 * length * length * (double)EOM_LANE_OF(step->dx_end[nq + i], l);
            c2 = a0;
            c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 3.0 * a0 + a1;
            c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 3.0 * a0 - 2.0 * a1;
            c5 = 6.0 * d - 3.0 * (v0 + v1) - a0 + a1;
        } else {
            c4 = 0.25 * length * (double)EOM_LANE_OF(step->bend[i], l);
            c2 += c4;
            c3 -= 2.0 * c4;
        }
        const double place = q0 + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        const double rate = (v0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / length;
        if (i < nq) { q_out[i] = (EOM_SCALAR)place; }
        v_out[i] = (EOM_SCALAR)rate;
    }
}

/* Works of a lane at a share of its step, J: by the method's weights there, or on the cubic with powers at both ends. */
EOM_LOCAL void EOM_F(works_between)(double share, double length, int l, int method, const double *restrict power, const double *restrict begin, const double *restrict end, double *restrict out)
{
    for (int w = 0; w < EOM_WORKS; ++w) {
        const double d = end[w] - begin[w];
        const double p0 = length * power[w * (int)EOM_WIDTH + l];
        const double p1 = length * power[(eom_error_controls[method].stages * EOM_WORKS + w) * (int)EOM_WIDTH + l];
        if (eom_error_controls[method].degree > 0) {
            out[w] = begin[w] + EOM_F(work_of_step)(power, w, l, method, length, share);
        } else {
            out[w] = begin[w] + share * (p0 + share * (3.0 * d - 2.0 * p0 - p1 + share * (p0 + p1 - 2.0 * d)));
        }
    }
}

/* Whether powers change too much within a lane's step for its stages to say what works are: the motion, of prescribed
 * coordinates, say, or of a mass that moves freely, may be without an error nevertheless. */
EOM_LOCAL int EOM_F(works_are_doubtful)(const double *restrict power, const double *restrict works, int l, int method, double length, double rtol)
{
    int doubtful = 0;
    for (int w = 0; w < EOM_WORKS; ++w) {
        double error = 0.0;
        double top = 0.0;
        for (int stage = 0; stage < eom_error_controls[method].powers; ++stage) {
            const double here = power[(stage * EOM_WORKS + w) * (int)EOM_WIDTH + l];
            error += eom_error_controls[method].errors[stage] * here;
            if (fabs(here) > top) { top = fabs(here); }
        }
        if (length * fabs(error) > 10.0 * rtol * (fabs(works[w]) + length * top)) { doubtful = 1; }
    }
    return doubtful;
}

/* Add works of a lane between two shares of its step, J, by Gauss's rule along its dense output, on halves until that changes
 * little. */
EOM_LOCAL void EOM_F(integrate_works)(const EOM_F(problem) *restrict problem, int l, int method, double from, double to, double rtol, const EOM_F(step) *restrict step, double *restrict works, EOM_F(workspace) work)
{
    const EOM(sizes) *const sizes = problem->motion.robot->sizes;
    const int nx = EOM_STATE_OF(sizes);
    const double length = problem->clock.step[l];
    const double *const power = &problem->clock.power[EOM_INSIDE_STAGE * EOM_WORKS * (int)EOM_WIDTH + l];
    EOM_REAL *const x_here = work.state;
    EOM_REAL *const dx_here = &x_here[EOM_PADDED_TO_BLOCKS(nx)];
    EOM_SCALAR *const output = (EOM_SCALAR *)(void *)&dx_here[EOM_PADDED_TO_BLOCKS(2 * EOM_RATES_OF(sizes) + 3 * EOM_M_OF(sizes))];
    double last[EOM_WORKS];
    double sum[EOM_WORKS];
    int settled = 0;
    work.state = (EOM_REAL *)(void *)output + EOM_PADDED_TO_BLOCKS(nx);
    (void)memset(last, 0, sizeof last);
    for (int pieces = 1; (pieces <= 64) && (settled == 0); pieces *= 2) {
        const double width = (to - from) / (double)pieces;
        double top[EOM_WORKS];
        (void)memset(sum, 0, sizeof sum);
        (void)memset(top, 0, sizeof top);
        for (int k = 0; k < 5 * pieces; ++k) {
            const int piece = k / 5;
            const double share = from + width * ((double)piece + eom_gauss_nodes[k % 5]);
            EOM_F(dense_output)(sizes, share, length, l, method, step, output, &output[EOM_POSITIONS_OF(sizes)]);
            for (int i = 0; i < nx; ++i) {
                x_here[i] = step->x_end[i];
                EOM_LANE_OF(x_here[i], l) = output[i];
            }
            EOM_F(rate)(problem, share, EOM_INSIDE_STAGE, x_here, dx_here, work);
            for (int w = 0; w < EOM_WORKS; ++w) {
                const double here = length * power[w * (int)EOM_WIDTH];
                sum[w] += width * eom_gauss_weights[k % 5] * here;
                if (fabs(here) > top[w]) { top[w] = fabs(here); }
            }
        }
        settled = (pieces > 1) ? 1 : 0;
        for (int w = 0; w < EOM_WORKS; ++w) {
            if (fabs(sum[w] - last[w]) > rtol * (fabs(works[w]) + (to - from) * top[w])) { settled = 0; }
            last[w] = sum[w];
        }
    }
    for (int w = 0; w < EOM_WORKS; ++w) { works[w] += last[w]; }
}

/* Try a step again, with another length; a lane in which that is too short ends by a reason. */
EOM_LOCAL void EOM_F(reject)(eom_progress *restrict p, double next, double duration, int reason)
{
    p->rejected += 1;
    p->refused = 1;
    p->next = next;
    if (p->next <= 1e-14 * duration) { p->reason = reason; }
}

/* Take a step or not: the next one is a factor of its length.  A lane whose work leads nowhere ends: that is no motion. */
EOM_LOCAL void EOM_F(go_on)(eom_progress *restrict p, int taken, double factor, double excess, double length, double duration, int where)
{
    if (taken == 0) {
        EOM_F(reject)(p, length * factor, duration, 2 + where);
    } else {
        const double next = length * (((p->refused != 0) && (factor > 1.0)) ? 1.0 : factor);
        p->refused = 0;
        p->excess = (excess > 1e-4) ? excess : 1e-4;
        if ((p->next < next) || !(length < p->next)) { p->next = next; }
    }
    if (p->steps + p->rejected >= p->counted + EOM_LOOK) {
        if (p->t - p->looked < EOM_LEAST_PART * duration) { p->reason = 2 + where; }
        p->looked = p->t;
        p->counted = p->steps + p->rejected;
    }
}

/* Whether a step is taken, and the length of the next one, by proportional-integral control; where a lane ends without a
 * motion, its reason. */
EOM_LOCAL int EOM_F(judge)(eom_progress *restrict p, double excess, double order, double length, double duration, int where)
{
    const int taken = (excess <= 1.0) ? 1 : 0;
    double factor = 0.9 * pow(excess, -order);
    if ((taken != 0) && (excess > 0.0)) { factor *= pow(excess, 0.06) * pow((p->excess > 0.0) ? p->excess : 1e-4, 0.08); }
    factor = (factor > 5.0) ? 5.0 : ((factor < 0.2) ? 0.2 : factor);
    EOM_F(go_on)(p, taken, factor, excess, length, duration, where);
    return taken;
}

/* Assemble the states that lanes have come to; one that cannot be is tried again, shorter, and the others are assembled from
 * where they were, so that no lane's bits depend on another.  Lanes that came to none follow one that did.  How many have ended. */
EOM_LOCAL int EOM_F(assemble_ends)(const EOM_F(motion) *restrict motion, const double *restrict length, double duration, int *restrict going, int *restrict taken, const EOM_F(step) *restrict step, const size_t *restrict place, eom_progress *restrict progress, EOM_REAL *restrict work)
{
    const EOM(sizes) *const sizes = motion->robot->sizes;
    const int nx = EOM_STATE_OF(sizes);
    const int statuses = 2 * EOM_POSITIONS_OF(sizes) + 3 * EOM_M_OF(sizes);
    EOM_REAL *const x_try = work;
    EOM_REAL *const h_try = &x_try[nx];
    EOM_REAL *const rest = &h_try[sizes->hoisted];
    int ended = 0;
    int opened = 1;
    while (opened != 0) {
        int one = -1;
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            if ((taken[l] != 0) && (one < 0)) { one = l; }
        }
        opened = 0;
        if (one >= 0) {
            (void)memcpy(x_try, step->x_end, (size_t)nx * sizeof *x_try);
            (void)memcpy(h_try, motion->h, (size_t)sizes->hoisted * sizeof *h_try);
            for (int l = 0; l < (int)EOM_WIDTH; ++l) {
                for (int i = 0; (i < nx) && (taken[l] == 0); ++i) { EOM_LANE_OF(x_try[i], l) = EOM_LANE_OF(step->x_end[i], one); }
                for (int i = 0; (i < sizes->hoisted) && (taken[l] == 0); ++i) { EOM_LANE_OF(h_try[i], l) = EOM_LANE_OF(motion->h[i], one); }
            }
            opened = EOM_F(assemble)(motion->robot, h_try, x_try, &x_try[EOM_POSITIONS_OF(sizes)], rest, NULL);
            if (opened == 0) { (void)memcpy(step->x_end, x_try, (size_t)nx * sizeof *x_try); }
        }
        if (opened != 0) {
            const int said = (EOM_WIDTH > 1) ? ((opened - 1) / statuses) : one;
            const int l = (taken[said] != 0) ? said : one;
            taken[l] = 0;
            EOM_F(reject)(&progress[place[l]], 0.25 * length[l], duration, 2 + nx + (opened - 1) % statuses);
            if (progress[place[l]].reason != 0) {
                going[l] = 0;
                ended += 1;
            }
        }
    }
    return ended;
}
