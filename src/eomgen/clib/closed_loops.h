/* closed_loops.h: states of mechanisms whose loops stay assembled; of one state or of one in every lane. */

/* Move a state to the nearest assembled one, in the metric of the kinetic energy: steps of Newton's method until what loops
 * violate before a step is round-off.  Velocities follow in that last step: at a violating state redundant rows block what is
 * free.  A lane that fails stays where it is, and takes the numbers of another one from then on: no lane's bits depend on what
 * happens in another.  0, or what the projection said, or 1 + nq + r where constraint r stays violated; 2 nq + 3 m more per lane.
 * failures, if it is not NULL, gets that of each lane, without what lanes add, where there is none yet.  work: 2 nq + 2 nv + m +
 * hoisted. */
EOM_LOCAL int EOM_F(assemble)(const EOM_F(robot) *restrict robot, const EOM_REAL *restrict h, EOM_REAL *restrict q, EOM_REAL *restrict v, EOM_REAL *restrict work, int *restrict failures)
{
    const EOM(sizes) *const sizes = robot->sizes;
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    const int m = EOM_M_OF(sizes);
    const int statuses = 2 * nq + 3 * m;
    EOM_REAL *const change = work;
    EOM_REAL *const violated = &change[nq + nv];
    EOM_REAL *const q_here = &violated[m];
    EOM_REAL *const v_here = &q_here[nq];
    EOM_REAL *const h_here = &v_here[nv];
    const EOM_REAL *parameters = h;
    int settled[EOM_WIDTH] = { 0 };
    int failed[EOM_WIDTH] = { 0 };
    int left = (int)EOM_WIDTH;
    int pass = 0;
    (void)memcpy(q_here, q, (size_t)nq * sizeof *q);
    (void)memcpy(v_here, v, (size_t)nv * sizeof *v);
    while ((left > 0) && (pass < 12)) {
        const int status = robot->settling(parameters, q_here, v_here, change);
        if (status != 0) {
            const int said = (EOM_WIDTH > 1) ? ((status - 1) / statuses) : 0;
            int one = 0;
            int other = 0;
            while (failed[one] != 0) { ++one; } /* the lane that those follow which have failed */
            const int lane = (failed[said] == 0) ? said : one;
            failed[lane] = 1 + ((EOM_WIDTH > 1) ? ((status - 1) % statuses) : (status - 1));
            left -= (settled[lane] != 0) ? 0 : 1;
            settled[lane] = 1;
            while ((other < (int)EOM_WIDTH) && (failed[other] != 0)) { ++other; }
            if (other == (int)EOM_WIDTH) { break; }
            if (parameters == h) {
                (void)memcpy(h_here, h, (size_t)sizes->hoisted * sizeof *h);
                parameters = h_here;
            }
            for (int l = 0; l < (int)EOM_WIDTH; ++l) {
                if (failed[l] == 0) { continue; }
                for (int i = 0; i < nq; ++i) { EOM_LANE_OF(q_here[i], l) = EOM_LANE_OF(q_here[i], other); }
                for (int i = 0; i < nv; ++i) { EOM_LANE_OF(v_here[i], l) = EOM_LANE_OF(v_here[i], other); }
                for (int i = 0; i < sizes->hoisted; ++i) { EOM_LANE_OF(h_here[i], l) = EOM_LANE_OF(h_here[i], other); }
            }
            continue;
        }
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            if (settled[l] != 0) { continue; }
            settled[l] = 1;
            for (int r = 0; r < m; ++r) {
                if (!(EOM_MATH(fabs)(EOM_LANE_OF(violated[r], l)) <= sizes->closed_gap)) { settled[l] = 0; }
            }
            left -= settled[l];
            for (int i = 0; i < nq; ++i) {
                EOM_LANE_OF(q[i], l) += EOM_LANE_OF(change[i], l);
                EOM_LANE_OF(q_here[i], l) = EOM_LANE_OF(q[i], l);
            }
            for (int i = 0; ((settled[l] != 0) || (pass == 11)) && (i < nv); ++i) {
                EOM_LANE_OF(v[i], l) += EOM_LANE_OF(change[nq + i], l);
                EOM_LANE_OF(v_here[i], l) = EOM_LANE_OF(v[i], l);
            }
        }
        ++pass;
    }
    int first = 0;
    for (int l = (int)EOM_WIDTH - 1; l >= 0; --l) {
        for (int r = 0; (r < m) && (settled[l] == 0) && (failed[l] == 0); ++r) {
            if (!(EOM_MATH(fabs)(EOM_LANE_OF(violated[r], l)) <= sizes->open_gap)) { failed[l] = 1 + nq + r; }
        }
        if (failed[l] != 0) { first = failed[l] + l * statuses; }
        if ((failures != NULL) && (failures[l] == 0)) { failures[l] = failed[l]; }
    }
    return first;
}
