/* computed_torque.h: inverse dynamics of a mechanism with closed loops, as forces of its drives; in double precision. */

/* Return the least |cos beta| of a mechanism's joints in the angles of a chart, 0 where they are singular; q_chart gets q in these. */
EOM_LOCAL double eom_chart_distance(const eom_mechanism *restrict mechanism, const eom_chart *restrict chart, int size, const double *restrict q, double *restrict q_chart)
{
    double least = 1.0;
    for (int i = 0; i < size; ++i) { q_chart[i] = q[i]; }
    for (int k = 0; k < mechanism->joints; ++k) {
        const int angles = mechanism->angles[k];
        const int origin = mechanism->origin[k];
        if (chart->turned[k] != 0) {
            double near[3] = { 0.0, 0.0, 0.0 };
            eom_other_angles(1, &q[angles], near);
            for (int i = 0; i < 3; ++i) {
                q_chart[angles + i] = near[i];
                if (origin >= 0) { q_chart[origin + i] = q[origin + (i + 1) % 3]; }
            }
        }
        const double far = fabs(cos(q_chart[angles + 1]));
        if (far < least) { least = far; }
    }
    return least;
}

/* Distribute forces along the freedoms over all drives, least in norm: with S, by which dependent driven coordinates follow, the
 * solution of (1 + S^T S) u = force, and S u.  factor: size x size. */
EOM_LOCAL void eom_distribute(const eom_mechanism *restrict mechanism, int size, const double *restrict slope, const int *restrict bound, int rank, const int *restrict ways, int freedoms, double *restrict force, double *restrict factor)
{
    int more = 0;
    for (int p = 0; p < rank; ++p) { more += mechanism->driven[bound[p]]; }
    if (more == 0) { return; }
    for (int i = 0; i < freedoms; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = (i == j) ? 1.0 : 0.0;
            for (int p = 0; p < rank; ++p) {
                if (mechanism->driven[bound[p]] != 0) { sum += slope[p * size + ways[i]] * slope[p * size + ways[j]]; }
            }
            for (int k = 0; k < j; ++k) { sum -= factor[i * freedoms + k] * factor[j * freedoms + k]; }
            factor[i * freedoms + j] = (i == j) ? sqrt(sum) : (sum / factor[j * freedoms + j]);
        }
    }
    for (int i = 0; i < freedoms; ++i) {
        for (int k = 0; k < i; ++k) { force[ways[i]] -= factor[i * freedoms + k] * force[ways[k]]; }
        force[ways[i]] /= factor[i * freedoms + i];
    }
    for (int i = freedoms - 1; i >= 0; --i) {
        for (int k = i + 1; k < freedoms; ++k) { force[ways[i]] -= factor[k * freedoms + i] * force[ways[k]]; }
        force[ways[i]] /= factor[i * freedoms + i];
    }
    for (int p = 0; p < rank; ++p) {
        double sum = 0.0;
        for (int i = 0; i < freedoms; ++i) { sum += slope[p * size + ways[i]] * force[ways[i]]; }
        if (mechanism->driven[bound[p]] != 0) { force[bound[p]] = sum; }
    }
}

/* Forces of the drives of a mechanism, the least ones where there are more than freedoms; not finite where its loops do not
 * close.  work: n^2 + (6 + gaps) n + gaps; index: 2 n. */
EOM_LOCAL void eom_drive_forces(const eom_computed_torque *restrict model, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict force, double *restrict work, int *restrict index)
{
    const eom_mechanism *const mechanism = model->mechanism;
    const eom_chart *chart = mechanism->charts;
    const int size = model->size;
    double *const q_chart = work;
    double *const left = &q_chart[size];
    double *const still = &left[size];
    double *const factor = &still[size];
    double *const solution = &factor[size * size]; /* q, v and a that follow, their slopes, and what loops violate */
    int *const bound = index;
    int *const ways = &index[size];
    int freedoms = 0;
    int closed = 1;
    int rank = 0;
    double farthest = eom_chart_distance(mechanism, chart, size, q, q_chart);
    for (int c = 1; c < mechanism->count; ++c) {
        const double far = (farthest < 0.5) ? eom_chart_distance(mechanism, &mechanism->charts[c], size, q, q_chart) : 0.0;
        if (far > farthest) {
            farthest = far;
            chart = &mechanism->charts[c];
        }
    }
    (void)eom_chart_distance(mechanism, chart, size, q, q_chart);
    (void)memset(still, 0, (size_t)size * sizeof *still);
    (void)mechanism->following(chart->following_h, q_chart, v, a, chart->chart, solution);
    (void)mechanism->residual(chart->residual_h, solution, &solution[size], &solution[2 * size], still, left);
    const double *const slope = &solution[3 * size];
    const double *const violation = &solution[3 * size + mechanism->gaps * size];
    for (int r = 0; r < mechanism->gaps; ++r) {
        if (!(fabs(violation[r]) <= 1e-11)) { closed = 0; }
    }
    for (int i = 0; i < size; ++i) {
        const int follows = (chart->chart[i] > 0.5) ? 1 : 0;
        force[i] = 0.0;
        if (follows != 0) {
            bound[rank] = i;
            ++rank;
        }
        if ((follows == 0) && (model->given[i] < 0)) {
            ways[freedoms] = i;
            ++freedoms;
        }
    }
    for (int f = 0; f < freedoms; ++f) { /* what is needed along the freedoms: the loops do no work */
        double needed = left[ways[f]];
        for (int p = 0; p < rank; ++p) { needed += left[bound[p]] * slope[p * size + ways[f]]; }
        force[ways[f]] = (closed != 0) ? needed : HUGE_VAL;
    }
    eom_distribute(mechanism, size, slope, bound, rank, ways, freedoms, force, factor);
}
