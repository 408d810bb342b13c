/* constraint_checks.h: whether states of a closed mechanism, and what drives it, satisfy its constraints; of one state or of one
 * in every lane.  Statuses of lane l are 2 n + 3 m higher per lane. */

/* The larger of a number and of the sizes of numbers of a lane. */
EOM_LOCAL EOM_SCALAR EOM_F(largest)(int count, const EOM_REAL *restrict x, int l, EOM_SCALAR than)
{
    EOM_SCALAR largest = than;
    (void)l;
    for (int i = 0; i < count; ++i) {
        const EOM_SCALAR size = EOM_MATH(fabs)(EOM_LANE_OF(x[i], l));
        if (size > largest) { largest = size; }
    }
    return largest;
}

/* Return the status of the first lane of two, each 0 or of a lane; of one lane the former. */
EOM_LOCAL int EOM_F(first_failure)(int n, int m, int one, int other)
{
    const int statuses = 2 * n + 3 * m;
    if ((one == 0) || (other == 0)) { return one + other; }
    return ((other - 1) / statuses < (one - 1) / statuses) ? other : one;
}

/* Check the constraint violations of lane l, m of them, and their rates, as many; the status, or 0. */
EOM_LOCAL int EOM_F(check_lane)(int n, int m, EOM_SCALAR allowed, const EOM_REAL *restrict v, const EOM_REAL *restrict violation, int l)
{
    const EOM_SCALAR fastest = EOM_F(largest)(n, v, l, EOM_C(1.0));
    for (int r = 0; r < 2 * m; ++r) {
        const EOM_SCALAR scale = (r < m) ? EOM_C(1.0) : fastest;
        if (!(EOM_MATH(fabs)(EOM_LANE_OF(violation[r], l)) <= scale * allowed)) { return 1 + n + r + l * (2 * n + 3 * m); }
    }
    return 0;
}

/* Check constraint violations and their rates, which may be the greater the faster a state is.  0, or 1 + n + r where constraint r
 * is violated, and m more where it is opening. */
EOM_LOCAL int EOM_F(check_constraints)(int n, int m, EOM_SCALAR allowed, const EOM_REAL *restrict v, const EOM_REAL *restrict violation)
{
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        const int status = EOM_F(check_lane)(n, m, allowed, v, violation, l);
        if (status != 0) { return status; }
    }
    return 0;
}

/* Check that drives make a motion; solution is that of constrained_drives: drives, multipliers, violations and their rates, then
 * second derivatives of the constraint that accelerations make and that velocities make, forces that no drive gives, and those
 * that are needed.  0, or a status of check_constraints, or 1 + n + 2 m + r where constraint r opens at the accelerations, or
 * 1 + n + 3 m + i where coordinate i needs a force that no drive gives. */
EOM_LOCAL int EOM_F(check_drives)(int n, int m, EOM_SCALAR allowed, const EOM_REAL *restrict v, const EOM_REAL *restrict a, const EOM_REAL *restrict solution)
{
    const EOM_REAL *const driven = &solution[n + 3 * m];
    const EOM_REAL *const bias = &solution[n + 4 * m];
    const EOM_REAL *const left = &solution[n + 5 * m];
    const EOM_REAL *const needed = &solution[2 * n + 5 * m];
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        const int status = EOM_F(check_lane)(n, m, allowed, v, &solution[n + m], l);
        if (status != 0) { return status; }
        const EOM_SCALAR fastest = EOM_F(largest)(m, bias, l, EOM_F(largest)(n, a, l, EOM_C(1.0)));
        const EOM_SCALAR largest = EOM_F(largest)(n, needed, l, EOM_C(1.0));
        for (int r = 0; r < m; ++r) {
            if (!(EOM_MATH(fabs)(EOM_LANE_OF(driven[r], l) + EOM_LANE_OF(bias[r], l)) <= fastest * allowed)) { return 1 + n + 2 * m + r + l * (2 * n + 3 * m); }
        }
        for (int i = 0; i < n; ++i) {
            if (!(EOM_MATH(fabs)(EOM_LANE_OF(left[i], l)) <= largest * allowed)) { return 1 + n + 3 * m + i + l * (2 * n + 3 * m); }
        }
    }
    return 0;
}
