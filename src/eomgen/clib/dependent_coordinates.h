/* dependent_coordinates.h: states of a closed mechanism whose dependent coordinates follow the others; of one state. */

/* Constraints of closed loops: g(q), its Jacobian J(q), (m, n), and the bias J' v of its second derivative; the size of g that
 * is met, and that which round-off may leave. */
typedef struct {
    int (*residual)(const EOM_SCALAR *h, const EOM_SCALAR *q, EOM_SCALAR *g);
    int (*jacobian)(const EOM_SCALAR *h, const EOM_SCALAR *q, EOM_SCALAR *J);
    int (*bias)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, EOM_SCALAR *bias);
    EOM_SCALAR met;
    EOM_SCALAR left;
} EOM(constraint);

/* Solve rows of J, (rank, n), for the dependent columns by the method of Gauss and Jordan with pivots out of each column: what is
 * in these columns becomes their inverse, the other columns their products with it.  row: which of g's rows they are, exchanged
 * with them. */
EOM_LOCAL void EOM(eliminate_dependent)(int n, int rank, const int *restrict dependent, EOM_SCALAR *restrict J, int *restrict row)
{
    for (int p = 0; p < rank; ++p) {
        const int column = dependent[p];
        int best = p;
        for (int r = p + 1; r < rank; ++r) {
            if (EOM_MATH(fabs)(J[n * r + column]) > EOM_MATH(fabs)(J[n * best + column])) { best = r; }
        }
        if (best != p) {
            const int other = row[p];
            row[p] = row[best];
            row[best] = other;
            for (int i = 0; i < n; ++i) {
                const EOM_SCALAR x = J[n * p + i];
                J[n * p + i] = J[n * best + i];
                J[n * best + i] = x;
            }
        }
        const EOM_SCALAR pivot = J[n * p + column];
        J[n * p + column] = EOM_C(1.0);
        for (int i = 0; i < n; ++i) { J[n * p + i] /= pivot; }
        for (int r = 0; r < rank; ++r) {
            const EOM_SCALAR factor = J[n * r + column];
            if ((r == p) || (factor == EOM_C(0.0))) { continue; }
            J[n * r + column] = EOM_C(0.0);
            for (int i = 0; i < n; ++i) { J[n * r + i] -= factor * J[n * p + i]; }
        }
    }
}

/* Evaluate the constraint at out = q, and eliminate the rows that are solved, on top of J then; the largest size of g.  NaN is
 * larger than any. */
EOM_LOCAL EOM_SCALAR EOM(linearise_constraint)(const EOM(constraint) *restrict constraint, int n, int m, int rank, const EOM_SCALAR *restrict h, const EOM_SCALAR *restrict solved, const int *restrict dependent, EOM_SCALAR *restrict out, int *restrict row)
{
    EOM_SCALAR *const J = &out[3 * n];
    EOM_SCALAR *const g = &out[3 * n + m * n];
    EOM_SCALAR violation = EOM_C(0.0);
    int top = 0;
    (void)constraint->residual(h, out, g);
    (void)constraint->jacobian(h, out, J);
    for (int r = 0; r < m; ++r) {
        if (!(EOM_MATH(fabs)(g[r]) <= violation)) { violation = EOM_MATH(fabs)(g[r]); }
    }
    for (int r = 0; r < m; ++r) {
        if ((solved[r] > EOM_C(0.5)) && (top < rank)) {
            for (int i = 0; (top < r) && (i < n); ++i) { J[n * top + i] = J[n * r + i]; }
            row[top] = r;
            ++top;
        }
    }
    EOM(eliminate_dependent)(n, rank, dependent, J, row);
    return violation;
}

/* Let the dependent velocities and accelerations follow, by what linearise_constraint left in J.  bias: m. */
EOM_LOCAL void EOM(follow_motion)(const EOM(constraint) *restrict constraint, int n, int m, int rank, const EOM_SCALAR *restrict h, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict a, const EOM_SCALAR *restrict chart, const int *restrict dependent, const int *restrict row, EOM_SCALAR *restrict out, EOM_SCALAR *restrict bias)
{
    EOM_SCALAR *const J = &out[3 * n];
    for (int p = 0; p < rank; ++p) {
        EOM_SCALAR rate = EOM_C(0.0);
        for (int i = 0; i < n; ++i) {
            if (chart[i] <= EOM_C(0.5)) { rate -= J[n * p + i] * v[i]; }
        }
        out[n + dependent[p]] = rate;
    }
    (void)constraint->bias(h, out, &out[n], bias);
    for (int p = 0; p < rank; ++p) {
        EOM_SCALAR rate = EOM_C(0.0);
        for (int s = 0; s < rank; ++s) { rate -= J[n * p + dependent[s]] * bias[row[s]]; }
        for (int i = 0; i < n; ++i) {
            if (chart[i] <= EOM_C(0.5)) { rate -= J[n * p + i] * a[i]; }
        }
        out[2 * n + dependent[p]] = rate;
    }
    for (int r = 0; r < m; ++r) {
        for (int i = 0; i < n; ++i) {
            J[n * r + i] = ((r < rank) && (chart[i] <= EOM_C(0.5))) ? (EOM_C(0.0) - J[n * r + i]) : EOM_C(0.0);
        }
    }
}

/* Solve the constraint for dependent coordinates near a guess q, and let v and a follow.  chart: 1 for every coordinate that is
 * dependent; 1 for every row of the constraint that is solved for them, as many; the most steps of Newton's method; an
 * assembled state and, per dependent coordinate, its derivatives by all others there, along which the guess is changed first.
 * out: q, v, a; the same derivatives at this q, (m, n); g, m.  What becomes violating, or goes farther than half a metre or rad
 * from the guess, is left with the g that says so.  work: 2 m; index: 2 m. */
EOM_LOCAL void EOM(solve_dependent)(const EOM(constraint) *restrict constraint, int n, int m, const EOM_SCALAR *restrict h, const EOM_SCALAR *restrict q, const EOM_SCALAR *restrict v, const EOM_SCALAR *restrict a, const EOM_SCALAR *restrict chart, EOM_SCALAR *restrict out, EOM_SCALAR *restrict work, int *restrict index)
{
    const EOM_SCALAR *const last = &chart[n + m + 1];
    const EOM_SCALAR *const J = &out[3 * n];
    const EOM_SCALAR *const g = &out[3 * n + m * n];
    EOM_SCALAR *const expected = work;
    int *const dependent = index;
    int *const row = &index[m];
    int marked = 0;
    int rank = 0;
    for (int i = 0; i < n; ++i) {
        out[i] = q[i];
        out[n + i] = v[i];
        out[2 * n + i] = a[i];
        if ((chart[i] > EOM_C(0.5)) && (marked < m)) {
            dependent[marked] = i;
            ++marked;
        }
    }
    for (int r = 0; r < m; ++r) {
        if ((chart[n + r] > EOM_C(0.5)) && (rank < marked)) { ++rank; }
    }
    for (int p = 0; p < rank; ++p) {
        for (int i = 0; i < n; ++i) { out[dependent[p]] += last[n * (p + 1) + i] * (q[i] - last[i]); }
        expected[p] = out[dependent[p]];
    }
    EOM_SCALAR before = EOM_C(0.0);
    const int most = (int)chart[n + m];
    int going = 1;
    for (int pass = 0; (going != 0) && (pass <= most); ++pass) {
        const EOM_SCALAR violation = EOM(linearise_constraint)(constraint, n, m, rank, h, &chart[n], dependent, out, row);
        if ((violation <= constraint->met) || (pass == most)) { going = 0; }
        if (pass > 0) { /* Newton's method has come to round-off, or does not converge */
            if ((violation <= constraint->left) && (violation >= EOM_C(0.1) * before)) { going = 0; }
            if (!((violation <= constraint->left) || (violation <= EOM_C(0.7) * before))) { going = 0; }
        }
        before = violation;
        const int steps = (going != 0) ? rank : 0;
        for (int p = 0; p < steps; ++p) {
            for (int s = 0; s < rank; ++s) { out[dependent[p]] -= J[n * p + dependent[s]] * g[row[s]]; }
            if (!(EOM_MATH(fabs)(out[dependent[p]] - expected[p]) <= EOM_C(0.5))) { going = 0; }
        }
    }
    EOM(follow_motion)(constraint, n, m, rank, h, v, a, chart, dependent, row, out, &work[m]);
}
