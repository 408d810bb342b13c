/* closed_loops.h: states of mechanisms whose loops stay assembled; of one state or of one in every lane. */

/* Move a state to the nearest assembled one, in the metric of the kinetic energy: steps of Newton's method until what loops
 * violate before a step is round-off.  Velocities follow in that last step: at a violating state redundant rows block what is
 * free.  A lane that fails stays where it is, and takes the numbers of another one from then on: no lane's bits depend on what
 * happens in another.  0, or what the projection said, or 1 + nq + r where constraint r stays violated; 2 nq + 3 m more per lane.
 * failures, if it is not NULL, gets that of each lane, without what lanes add, where there is none yet.  work: 2 nq + 2 nv + m +
 * hoisted. */
EOM_LOCAL int F(assemble)(const F(robot) *restrict robot, const REAL *restrict h, REAL *restrict q, REAL *restrict v, REAL *restrict work, int *restrict failures)
{
    const EOM(sizes) *const sizes = robot->sizes;
    const int nq = POSITIONS_OF(sizes);
    const int nv = RATES_OF(sizes);
    const int m = M_OF(sizes);
    const int statuses = 2 * nq + 3 * m;
    REAL *const change = work;
    REAL *const violated = &change[nq + nv];
    REAL *const q_here = &violated[m];
    REAL *const v_here = &q_here[nq];
    REAL *const h_here = &v_here[nv];
    const REAL *parameters = h;
    int settled[WIDTH] = { 0 };
    int failed[WIDTH] = { 0 };
    int left = (int)WIDTH;
    int pass = 0;
    (void)memcpy(q_here, q, (size_t)nq * sizeof *q);
    (void)memcpy(v_here, v, (size_t)nv * sizeof *v);
    while ((left > 0) && (pass < 12)) {
        const int status = robot->settling(parameters, q_here, v_here, change);
        if (status != 0) {
            const int said = (WIDTH > 1) ? ((status - 1) / statuses) : 0;
            int one = 0;
            int other = 0;
            while (failed[one] != 0) { ++one; } /* the lane that those follow which have failed */
            const int lane = (failed[said] == 0) ? said : one;
            failed[lane] = 1 + ((WIDTH > 1) ? ((status - 1) % statuses) : (status - 1));
            left -= (settled[lane] != 0) ? 0 : 1;
            settled[lane] = 1;
            while ((other < (int)WIDTH) && (failed[other] != 0)) { ++other; }
            if (other == (int)WIDTH) { break; }
            if (parameters == h) {
                (void)memcpy(h_here, h, (size_t)sizes->hoisted * sizeof *h);
                parameters = h_here;
            }
            for (int l = 0; l < (int)WIDTH; ++l) {
                if (failed[l] == 0) { continue; }
                for (int i = 0; i < nq; ++i) { LANE_OF(q_here[i], l) = LANE_OF(q_here[i], other); }
                for (int i = 0; i < nv; ++i) { LANE_OF(v_here[i], l) = LANE_OF(v_here[i], other); }
                for (int i = 0; i < sizes->hoisted; ++i) { LANE_OF(h_here[i], l) = LANE_OF(h_here[i], other); }
            }
            continue;
        }
        for (int l = 0; l < (int)WIDTH; ++l) {
            if (settled[l] != 0) { continue; }
            settled[l] = 1;
            for (int r = 0; r < m; ++r) {
                if (!(EOM_MATH(fabs)(LANE_OF(violated[r], l)) <= sizes->closed_gap)) { settled[l] = 0; }
            }
            left -= settled[l];
            for (int i = 0; i < nq; ++i) {
                LANE_OF(q[i], l) += LANE_OF(change[i], l);
                LANE_OF(q_here[i], l) = LANE_OF(q[i], l);
            }
            for (int i = 0; ((settled[l] != 0) || (pass == 11)) && (i < nv); ++i) {
                LANE_OF(v[i], l) += LANE_OF(change[nq + i], l);
                LANE_OF(v_here[i], l) = LANE_OF(v[i], l);
            }
        }
        ++pass;
    }
    int first = 0;
    for (int l = (int)WIDTH - 1; l >= 0; --l) {
        for (int r = 0; (r < m) && (settled[l] == 0) && (failed[l] == 0); ++r) {
            if (!(EOM_MATH(fabs)(LANE_OF(violated[r], l)) <= sizes->open_gap)) { failed[l] = 1 + nq + r; }
        }
        if (failed[l] != 0) { first = failed[l] + l * statuses; }
        if ((failures != NULL) && (failures[l] == 0)) { failures[l] = failed[l]; }
    }
    return first;
}
