/* charts.h: joints of three rotations.  Where their angles are nearly singular, the axes y, z and x of their frame take the
 * place of x, y and z, and they have other angles; what is stored and told is as the robot is described.  Of one state or of one
 * in every lane: included once for each. */

/* Charts of the states of all lanes. */
typedef struct {
    EOM_REAL *h;             /* as joints are turned */
    EOM_SCALAR *told;    /* (EOM_WIDTH, 3 rotations), angles as described */
    EOM_SCALAR *scratch; /* parameters + rotations + hoisted */
    int *is_turned;      /* (EOM_WIDTH, rotations) */
    int *stays;          /* rotations: a controller acts on its angles */
} EOM_F(charts);

/* Take room for charts from a workspace. */
EOM_LOCAL void EOM_F(carve_charts)(const EOM(sizes) *restrict sizes, EOM_F(charts) *restrict charts, EOM_F(workspace) *restrict work)
{
    const int count = EOM_ROTATIONS_OF(sizes);
    charts->h = work->state;
    work->state += sizes->hoisted;
    charts->told = (EOM_SCALAR *)(void *)work->state;
    work->state += 3 * count;
    charts->scratch = (EOM_SCALAR *)(void *)work->state;
    work->state += sizes->parameters + count + sizes->hoisted;
    charts->is_turned = work->index;
    work->index += (int)EOM_WIDTH * count;
    charts->stays = work->index;
    work->index += count;
}

/* Rates of the other angles of the same rotation: both have one angular velocity in the body's axes. */
EOM_LOCAL void EOM_F(other_rates)(const EOM_SCALAR *restrict angle, const EOM_SCALAR *restrict other, EOM_SCALAR *restrict rate)
{
    const EOM_SCALAR cb = EOM_MATH(cos)(angle[1]);
    const EOM_SCALAR sg = EOM_MATH(sin)(angle[2]);
    const EOM_SCALAR cg = EOM_MATH(cos)(angle[2]);
    const EOM_SCALAR x = cb * cg * rate[0] + sg * rate[1];
    const EOM_SCALAR y = cg * rate[1] - cb * sg * rate[0];
    const EOM_SCALAR z = EOM_MATH(sin)(angle[1]) * rate[0] + rate[2];
    const EOM_SCALAR s = EOM_MATH(sin)(other[2]);
    const EOM_SCALAR c = EOM_MATH(cos)(other[2]);
    EOM_SCALAR across = EOM_MATH(cos)(other[1]);
    if (EOM_MATH(fabs)(across) < EOM_ROUND_OFF) { across = EOM_ROUND_OFF; }
    rate[0] = (c * x - s * y) / across;
    rate[1] = s * x + c * y;
    rate[2] = z - EOM_MATH(sin)(other[1]) * rate[0];
}

/* Read three numbers of a lane from a place on. */
EOM_LOCAL void EOM_F(take)(const EOM_REAL *restrict x, int l, int first, EOM_SCALAR *restrict y)
{
    (void)l;
    for (int i = 0; i < 3; ++i) { y[i] = EOM_LANE_OF(x[first + i], l); }
}

/* Write three numbers of a lane, those so many places on first. */
EOM_LOCAL void EOM_F(give)(const EOM_SCALAR *restrict y, int l, int first, int places, EOM_REAL *restrict x)
{
    (void)l;
    for (int i = 0; i < 3; ++i) { EOM_LANE_OF(x[first + i], l) = y[(i + places) % 3]; }
}

/* Change a joint's coordinates and velocities to axes so many places on; the angles become other. */
EOM_LOCAL void EOM_F(change_axes)(const EOM(sizes) *restrict sizes, int joint, int places, int l, const EOM_SCALAR *restrict angle, const EOM_SCALAR *restrict other, EOM_REAL *restrict q, EOM_REAL *restrict v)
{
    const int at = sizes->angles_at[joint];
    const int origin = sizes->origin_at[joint];
    EOM_SCALAR rate[3];
    EOM_F(take)(v, l, at, rate);
    EOM_F(other_rates)(angle, other, rate);
    EOM_F(give)(other, l, at, 0, q);
    EOM_F(give)(rate, l, at, 0, v);
    if (origin >= 0) {
        EOM_F(take)(q, l, origin, rate);
        EOM_F(give)(rate, l, origin, places, q);
        EOM_F(take)(v, l, origin, rate);
        EOM_F(give)(rate, l, origin, places, v);
    }
}

/* Compute h of a lane, as its joints are turned now. */
EOM_LOCAL void EOM_F(set_up)(const EOM(sizes) *restrict sizes, EOM_F(charts) *restrict charts, int l)
{
    EOM_SCALAR *const p = charts->scratch;
    EOM_SCALAR *const h = &p[sizes->parameters + EOM_ROTATIONS_OF(sizes)];
    for (int i = 0; i < sizes->parameters; ++i) { p[i] = EOM_LANE_OF(charts->h[i], l); }
    for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) { p[sizes->parameters + k] = (charts->is_turned[l * EOM_ROTATIONS_OF(sizes) + k] != 0) ? EOM_C(1.0) : EOM_C(0.0); }
    sizes->setup(p, h);
    for (int i = 0; i < sizes->hoisted; ++i) { EOM_LANE_OF(charts->h[i], l) = h[i]; }
}

/* Turn the joints whose angles are nearly singular; angles of turned ones are followed as described, turn by turn.  Whether any
 * has changed. */
EOM_LOCAL int EOM_F(change_charts)(const EOM(sizes) *restrict sizes, EOM_F(charts) *restrict charts, EOM_REAL *restrict q, EOM_REAL *restrict v)
{
    int any = 0;
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        int changed = 0;
        for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
            int *const is_turned = &charts->is_turned[l * EOM_ROTATIONS_OF(sizes) + k];
            const int was_turned = *is_turned;
            EOM_SCALAR *const told = &charts->told[3 * (l * EOM_ROTATIONS_OF(sizes) + k)];
            EOM_SCALAR angle[3];
            EOM_SCALAR other[3] = { EOM_C(0.0), EOM_C(0.0), EOM_C(0.0) };
            EOM_F(take)(q, l, sizes->angles_at[k], angle);
            const int is_singular = ((EOM_MATH(fabs)(angle[1]) > EOM_C(1.0)) && (EOM_MATH(fabs)(EOM_MATH(cos)(angle[1])) < EOM_C(0.5))) ? 1 : 0;
            if (charts->stays[k] != 0) { continue; }
            if (was_turned != 0) { EOM(other_angles)(2, angle, told); }
            if (is_singular == 0) { continue; }
            if (was_turned == 0) { EOM(other_angles)(1, angle, other); }
            for (int i = 0; i < 3; ++i) {
                if (was_turned != 0) { other[i] = told[i]; } else { told[i] = angle[i]; }
            }
            EOM_F(change_axes)(sizes, k, (was_turned != 0) ? 2 : 1, l, angle, other, q, v);
            *is_turned = (was_turned != 0) ? 0 : 1;
            changed = 1;
        }
        if (changed != 0) {
            EOM_F(set_up)(sizes, charts, l);
            any = 1;
        }
    }
    return any;
}

/* Write q and v as described: angles as they were last told, or with near of a state between those at which charts change. */
EOM_LOCAL void EOM_F(describe)(const EOM(sizes) *restrict sizes, const EOM_F(charts) *restrict charts, int near, const EOM_REAL *restrict q, const EOM_REAL *restrict v, EOM_REAL *restrict q_told, EOM_REAL *restrict v_told)
{
    (void)memcpy(q_told, q, (size_t)EOM_POSITIONS_OF(sizes) * sizeof *q);
    (void)memcpy(v_told, v, (size_t)EOM_RATES_OF(sizes) * sizeof *v);
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
            const int joint = l * EOM_ROTATIONS_OF(sizes) + k;
            EOM_SCALAR angle[3];
            EOM_SCALAR told[3];
            if (charts->is_turned[joint] == 0) { continue; }
            for (int i = 0; i < 3; ++i) { told[i] = charts->told[3 * joint + i]; }
            EOM_F(take)(q, l, sizes->angles_at[k], angle);
            if (near != 0) { EOM(other_angles)(2, angle, told); }
            EOM_F(change_axes)(sizes, k, 2, l, angle, told, q_told, v_told);
        }
    }
}

/* Write a row of a lane as described; its angles follow those of the row before.  work: nq + nv. */
EOM_LOCAL void EOM_F(describe_row)(const EOM(sizes) *restrict sizes, EOM_F(charts) *restrict charts, int l, EOM_SCALAR *restrict q_row, EOM_SCALAR *restrict v_row, EOM_REAL *restrict work)
{
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    EOM_REAL *const q = work;
    EOM_REAL *const v = &work[nq];
    for (int i = 0; i < nq; ++i) { q[i] = EOM_WHOLE(q_row[i]); }
    for (int i = 0; i < nv; ++i) { v[i] = EOM_WHOLE(v_row[i]); }
    for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
        const int joint = l * EOM_ROTATIONS_OF(sizes) + k;
        EOM_SCALAR angle[3];
        EOM_SCALAR *const told = &charts->told[3 * joint];
        if (charts->is_turned[joint] == 0) { continue; }
        EOM_F(take)(q, l, sizes->angles_at[k], angle);
        EOM(other_angles)(2, angle, told);
        EOM_F(change_axes)(sizes, k, 2, l, angle, told, q, v);
    }
    for (int i = 0; i < nq; ++i) { q_row[i] = EOM_LANE_OF(q[i], l); }
    for (int i = 0; i < nv; ++i) { v_row[i] = EOM_LANE_OF(v[i], l); }
}

/* Make forces on described coordinates forces on those that there are: of the same power. */
EOM_LOCAL void EOM_F(turn_forces)(const EOM(sizes) *restrict sizes, const EOM_F(charts) *restrict charts, const EOM_REAL *restrict q, EOM_REAL *restrict u)
{
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
            const int joint = l * EOM_ROTATIONS_OF(sizes) + k;
            const int at = sizes->angles_at[k];
            const int origin = sizes->origin_at[k];
            EOM_SCALAR angle[3];
            EOM_SCALAR told[3];
            EOM_SCALAR force[3];
            if (charts->is_turned[joint] == 0) { continue; }
            if (origin >= 0) {
                EOM_F(take)(u, l, origin, force);
                EOM_F(give)(force, l, origin, 1, u);
            }
            EOM_F(take)(u, l, at, force);
            if ((force[0] == EOM_C(0.0)) && (force[1] == EOM_C(0.0)) && (force[2] == EOM_C(0.0))) { continue; }
            EOM_F(take)(q, l, at, angle);
            for (int i = 0; i < 3; ++i) { told[i] = charts->told[3 * joint + i]; }
            EOM(other_angles)(2, angle, told);
            const EOM_SCALAR s = EOM_MATH(sin)(told[2]);
            const EOM_SCALAR c = EOM_MATH(cos)(told[2]);
            const EOM_SCALAR sg = EOM_MATH(sin)(angle[2]);
            const EOM_SCALAR cg = EOM_MATH(cos)(angle[2]);
            EOM_SCALAR across = EOM_MATH(cos)(told[1]);
            if (EOM_MATH(fabs)(across) < EOM_ROUND_OFF) { across = EOM_ROUND_OFF; }
            across = (force[0] - EOM_MATH(sin)(told[1]) * force[2]) / across;
            const EOM_SCALAR x = c * across + s * force[1];
            const EOM_SCALAR y = c * force[1] - s * across;
            force[0] = EOM_MATH(cos)(angle[1]) * (cg * x - sg * y) + EOM_MATH(sin)(angle[1]) * force[2];
            force[1] = sg * x + cg * y;
            EOM_F(give)(force, l, at, 0, u);
        }
    }
}

/* Begin where q and v are, h as described; joints with a gain of a controller stay as they are. */
EOM_LOCAL void EOM_F(begin_charts)(const EOM(sizes) *restrict sizes, const EOM_REAL *restrict h, const EOM_SCALAR *kp, const EOM_SCALAR *kd, EOM_F(charts) *restrict charts, EOM_REAL *restrict q, EOM_REAL *restrict v)
{
    for (int i = 0; i < sizes->hoisted; ++i) { charts->h[i] = h[i]; }
    for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
        const int at = sizes->angles_at[k];
        const int origin = sizes->origin_at[k];
        const int begin = (origin < 0) ? at : origin;
        const int end = (kp == NULL) ? begin : (at + 3);
        charts->stays[k] = 0;
        for (int i = begin; i < end; ++i) {
            if ((kp[i] > EOM_C(0.0)) || (kd[i] > EOM_C(0.0))) { charts->stays[k] = 1; }
        }
        for (int l = 0; l < (int)EOM_WIDTH; ++l) {
            charts->is_turned[l * EOM_ROTATIONS_OF(sizes) + k] = 0;
            EOM_F(take)(q, l, at, &charts->told[3 * (l * EOM_ROTATIONS_OF(sizes) + k)]);
        }
    }
    (void)EOM_F(change_charts)(sizes, charts, q, v);
}

/* Numbers that a state keeps of its charts. */
EOM_LOCAL size_t EOM_F(kept_of_charts)(const EOM(sizes) *restrict sizes)
{
    (void)sizes;
    return (size_t)(1 + 4 * EOM_ROTATIONS_OF(sizes) + EOM_STATE_OF(sizes));
}

/* Go on where a rollout has ended that kept its charts, if one has. */
EOM_LOCAL void EOM_F(resume_charts)(const EOM(sizes) *restrict sizes, const EOM(drive) *restrict drive, const size_t *restrict place, EOM_F(charts) *restrict charts, EOM_REAL *restrict q, EOM_REAL *restrict v)
{
    const int count = EOM_ROTATIONS_OF(sizes);
    const size_t size = EOM_F(kept_of_charts)(sizes);
    if ((drive->turned == NULL) || !(drive->turned[place[0] * size] > EOM_C(0.0))) { return; }
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        const EOM_SCALAR *const kept = &drive->turned[place[l] * size + 1U];
        for (int k = 0; k < count; ++k) { charts->is_turned[l * count + k] = (kept[k] > EOM_C(0.0)) ? 1 : 0; }
        for (int i = 0; i < 3 * count; ++i) { charts->told[3 * l * count + i] = kept[count + i]; }
        for (int i = 0; i < EOM_POSITIONS_OF(sizes); ++i) { EOM_LANE_OF(q[i], l) = kept[4 * count + i]; }
        for (int i = 0; i < EOM_RATES_OF(sizes); ++i) { EOM_LANE_OF(v[i], l) = kept[4 * count + EOM_POSITIONS_OF(sizes) + i]; }
        EOM_F(set_up)(sizes, charts, l);
    }
}

/* Keep where a rollout ends, for one that goes on from there. */
EOM_LOCAL void EOM_F(keep_charts)(const EOM(sizes) *restrict sizes, const EOM(drive) *restrict drive, const size_t *restrict place, size_t here, const EOM_F(charts) *restrict charts, const EOM_REAL *restrict q, const EOM_REAL *restrict v)
{
    const int count = EOM_ROTATIONS_OF(sizes);
    if (drive->turned == NULL) { return; }
    for (int l = 0; l < (int)here; ++l) {
        EOM_SCALAR *const kept = &drive->turned[place[l] * EOM_F(kept_of_charts)(sizes)];
        kept[0] = EOM_C(1.0);
        for (int k = 0; k < count; ++k) { kept[1 + k] = (charts->is_turned[l * count + k] != 0) ? EOM_C(1.0) : EOM_C(0.0); }
        for (int i = 0; i < 3 * count; ++i) { kept[1 + count + i] = charts->told[3 * l * count + i]; }
        for (int i = 0; i < EOM_POSITIONS_OF(sizes); ++i) { kept[1 + 4 * count + i] = EOM_LANE_OF(q[i], l); }
        for (int i = 0; i < EOM_RATES_OF(sizes); ++i) { kept[1 + 4 * count + EOM_POSITIONS_OF(sizes) + i] = EOM_LANE_OF(v[i], l); }
    }
}

/* The place among a lane's of a described coordinate: the axes of turned joints have moved on by one; -1 of their angles. */
EOM_LOCAL int EOM_F(place_of_gain)(const EOM(sizes) *restrict sizes, const EOM_F(charts) *restrict charts, int l, int i)
{
    int place = i;
    for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
        const int angle = i - sizes->angles_at[k];
        const int axis = i - sizes->origin_at[k];
        if (charts->is_turned[l * EOM_ROTATIONS_OF(sizes) + k] == 0) { continue; }
        if ((angle >= 0) && (angle < 3)) { place = -1; }
        if ((sizes->origin_at[k] >= 0) && (axis >= 0) && (axis < 3)) { place = i - axis + (axis + 2) % 3; }
    }
    return place;
}

/* Which number of a described state stands at a place of a lane's. */
EOM_LOCAL int EOM_F(described_place)(const EOM(sizes) *restrict sizes, const EOM_F(charts) *restrict charts, int l, int i)
{
    int place = i;
    for (int k = 0; k < EOM_ROTATIONS_OF(sizes); ++k) {
        const int origin = sizes->origin_at[k];
        const int axis = ((i < EOM_POSITIONS_OF(sizes)) ? i : (i - EOM_POSITIONS_OF(sizes))) - origin;
        if ((charts->is_turned[l * EOM_ROTATIONS_OF(sizes) + k] != 0) && (origin >= 0) && (axis >= 0) && (axis < 3)) { place = i - axis + (axis + 1) % 3; }
    }
    return place;
}
