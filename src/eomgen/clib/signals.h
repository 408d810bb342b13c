/* signals.h: inputs over time, in double precision and for one state: splines, prescribed motions, tracking control, computed
 * torque, wrenches, and the powers of an energy balance. */

/* A time, and one beside it by which pieces of splines are chosen: where signals jump, both sides have one. */
typedef struct {
    double t;
    double beside;
} eom_instant;

/* A time whose side is itself: behind what jumps there. */
EOM_LOCAL eom_instant eom_instant_of(double t)
{
    eom_instant at;
    at.t = t;
    at.beside = t;
    return at;
}

/* The nearest time within the span in which drives and wrenches act. */
EOM_LOCAL eom_instant eom_within_span(double first, double last, eom_instant at)
{
    eom_instant within;
    within.t = (at.t < first) ? first : ((at.t > last) ? last : at.t);
    within.beside = (at.beside < first) ? first : ((at.beside > last) ? last : at.beside);
    return within;
}

/* The number of jumps that are not behind t. */
EOM_LOCAL size_t eom_stops_until(const double *restrict stop, size_t stops, double t)
{
    size_t low = 0U;
    size_t high = stops;
    while (low < high) {
        const size_t middle = low + (high - low) / 2U;
        if (stop[middle] <= t) { low = middle + 1U; } else { high = middle; }
    }
    return low;
}

/* Whether inputs jump at t. */
EOM_LOCAL int eom_jumps_at(const double *restrict stop, size_t stops, double t)
{
    const size_t count = eom_stops_until(stop, stops, t);
    return ((count > 0U) && !(stop[count - 1U] < t)) ? 1 : 0;
}

/* The piece of a spline at a time, and how far that is from its beginning; not inside before the first and behind the last. */
EOM_LOCAL int eom_piece_at(const eom_spline *restrict spline, eom_instant at, double *restrict ahead, int *restrict inside)
{
    const double *const knot = spline->knot;
    int low = 0;
    int high = spline->pieces;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (at.beside < knot[middle]) { high = middle; } else { low = middle; }
    }
    *inside = ((at.beside >= knot[0]) && (at.beside <= knot[spline->pieces])) ? 1 : 0;
    *ahead = (at.beside < knot[low]) ? 0.0 : ((at.beside > knot[low + 1]) ? (knot[low + 1] - knot[low]) : (at.t - knot[low]));
    return low;
}

/* Evaluate a spline without its profile: values, first and second derivatives of its columns. */
EOM_LOCAL void eom_pieces_at(const eom_spline *restrict spline, eom_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    double ahead = 0.0;
    int inside = 0;
    const int piece = eom_piece_at(spline, at, &ahead, &inside);
    const size_t columns = (size_t)spline->columns;
    const double *const coefficient = &spline->coefficient[(size_t)piece * ((size_t)spline->degree + 1U) * columns];
    for (size_t i = 0; i < columns; ++i) {
        double value = 0.0;
        double rate = 0.0;
        double half = 0.0;
        for (int power = spline->degree; power >= 0; --power) {
            half = half * ahead + rate;
            rate = rate * ahead + value;
            value = value * ahead + coefficient[(size_t)power * columns + i];
        }
        x[i] = value;
        dx[i] = (inside != 0) ? rate : 0.0;
        ddx[i] = (inside != 0) ? (2.0 * half) : 0.0;
    }
}

/* The argument that a profile puts in the place of a time, with its rate and acceleration there. */
EOM_LOCAL eom_instant eom_profile_at(const eom_spline *restrict profile, eom_instant at, double *restrict ds, double *restrict dds)
{
    eom_instant argument;
    double rate = 0.0;
    double second = 0.0;
    eom_pieces_at(profile, eom_instant_of(at.beside), &argument.beside, &rate, &second);
    eom_pieces_at(profile, at, &argument.t, ds, dds);
    return argument;
}

/* Evaluate a spline: values, rates and accelerations of its columns. */
EOM_LOCAL void eom_spline_at(const eom_spline *restrict spline, eom_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    if (spline->profile == NULL) {
        eom_pieces_at(spline, at, x, dx, ddx);
    } else {
        double ds = 0.0;
        double dds = 0.0;
        eom_pieces_at(spline, eom_profile_at(spline->profile, at, &ds, &dds), x, dx, ddx);
        for (int i = 0; i < spline->columns; ++i) {
            ddx[i] = ddx[i] * ds * ds + dx[i] * dds;
            dx[i] = dx[i] * ds;
        }
    }
}

/* Positions, velocities and accelerations of prescribed coordinates.  work: 3 n. */
EOM_LOCAL void eom_prescribed_at(const eom_prescribed *restrict motions, int n, eom_instant at, double *restrict x, double *restrict dx, double *restrict ddx, double *restrict work)
{
    double *const value = work;
    double *const rate = &work[n];
    double *const acceleration = &work[2 * n];
    for (int i = 0; i < motions->size; ++i) {
        const double *const wave = &motions->wave[4 * i];
        const double angle = wave[1] * at.t + wave[2];
        const double sine = wave[0] * sin(angle);
        x[i] = wave[3] + sine;
        dx[i] = wave[0] * wave[1] * cos(angle);
        ddx[i] = -(wave[1] * wave[1]) * sine;
    }
    for (int k = 0; k < motions->count; ++k) {
        const eom_track *const track = &motions->tracks[k];
        eom_spline_at(track->signal, at, value, rate, acceleration);
        for (int i = 0; i < track->signal->columns; ++i) {
            x[track->place[i]] = value[i];
            dx[track->place[i]] = rate[i];
            ddx[track->place[i]] = acceleration[i];
        }
    }
}

/* Add tracking control to u, and write what computed torque asks its model: q, v and a, n numbers each.  work: 3 n. */
EOM_LOCAL void eom_track_reference(const eom_tracking *restrict control, const eom_computed_torque *restrict model, int n, eom_instant at, const double *restrict q, const double *restrict v, const double *restrict prescribed, double *restrict u, double *restrict asked, double *restrict work)
{
    double *const x = work;
    double *const dx = &work[n];
    double *const ddx = &work[2 * n];
    eom_spline_at(control->program.signal, at, x, dx, ddx);
    if (control->kp != NULL) {
        for (int i = 0; i < control->program.signal->columns; ++i) {
            const int place = control->program.place[i];
            const double ratio = control->ratio[i];
            u[place] += (control->kp[i] * (x[i] - q[place] / ratio) + control->kd[i] * (dx[i] - v[place] / ratio)) / ratio;
        }
    }
    if (model != NULL) {
        double *const q_model = asked;
        double *const v_model = &asked[n];
        double *const a_model = &asked[2 * n];
        for (int i = 0; i < model->size; ++i) {
            const int column = model->column[i];
            q_model[i] = q[model->place[i]] / model->ratio[i];
            v_model[i] = (model->holds != 0) ? 0.0 : (v[model->place[i]] / model->ratio[i]);
            a_model[i] = 0.0;
            if (model->holds == 0) {
                if (column >= 0) {
                    a_model[i] = ddx[column] + model->bandwidth * (model->bandwidth * (x[column] - q_model[i]) + 2.0 * (dx[column] - v_model[i]));
                } else if (model->given[i] >= 0) {
                    a_model[i] = prescribed[model->given[i]] / model->ratio[i];
                } else {
                    a_model[i] = 0.0;
                }
            }
        }
    }
}

/* Add forces of n drives but for those of computed torque, and write what that asks its model; positions and velocities of
 * prescribed coordinates are put into q and v, their accelerations into prescribed.  work: 5 n. */
EOM_LOCAL void eom_inputs_at(const EOM(inputs) *restrict inputs, int n, eom_instant at, double *restrict q, double *restrict v, double *restrict u, double *restrict prescribed, double *restrict asked, double *restrict work)
{
    const eom_instant within = eom_within_span(inputs->first, inputs->last, at);
    double *const x = work;
    double *const dx = &work[n];
    (void)memset(prescribed, 0, (size_t)n * sizeof *prescribed);
    if (inputs->given != NULL) {
        eom_prescribed_at(inputs->given, n, at, x, dx, prescribed, &work[2 * n]);
        for (int i = 0; i < inputs->given->size; ++i) {
            q[inputs->given->place[i]] = x[i];
            v[inputs->given->place[i]] = dx[i];
        }
    }
    if (inputs->torque != NULL) {
        eom_spline_at(inputs->torque->signal, within, x, dx, &work[2 * n]);
        for (int i = 0; i < inputs->torque->signal->columns; ++i) { u[inputs->torque->place[i]] += x[i]; }
    }
    if (inputs->control != NULL) { eom_track_reference(inputs->control, inputs->model, n, within, q, v, prescribed, u, asked, work); }
}

/* Add what computed torque answers, saturate drives, and put accelerations of prescribed coordinates in their places; slope, if
 * it is not NULL, becomes 0 where drives saturate, else 1. */
EOM_LOCAL void eom_finish_drives(const EOM(inputs) *restrict inputs, int n, const double *restrict prescribed, const double *restrict answer, double *restrict u, double *restrict slope)
{
    const eom_computed_torque *const model = (inputs->control == NULL) ? NULL : inputs->model;
    if (model != NULL) {
        for (int i = 0; i < model->size; ++i) {
            if (model->given[i] < 0) { u[model->place[i]] += answer[i] / model->ratio[i]; }
        }
    }
    for (int i = 0; (inputs->effort != NULL) && (i < n); ++i) {
        const double most = inputs->effort[i];
        if (slope != NULL) { slope[i] = ((u[i] > most) || (u[i] < -most)) ? 0.0 : 1.0; }
        u[i] = (u[i] > most) ? most : ((u[i] < -most) ? -most : u[i]);
    }
    if (inputs->given != NULL) {
        for (int i = 0; i < inputs->given->size; ++i) { u[inputs->given->place[i]] = prescribed[i]; }
    }
}

/* Multiply a vector by the axes of a frame: from its numbers along them to those in the base frame, or back. */
EOM_LOCAL void EOM(turn_vector)(const EOM_SCALAR *restrict pose, int there, const double *restrict x, double *restrict out)
{
    for (int i = 0; i < 3; ++i) {
        out[i] = 0.0;
        for (int j = 0; j < 3; ++j) { out[i] += (double)pose[(there != 0) ? (4 * i + j) : (4 * j + i)] * x[j]; }
    }
}

/* Add the cross product of two vectors. */
EOM_LOCAL void eom_add_cross(const double *restrict a, const double *restrict b, double *restrict out)
{
    for (int i = 0; i < 3; ++i) { out[i] += a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]; }
}

/* A wrench's six numbers at a time, zeros where it does not act. */
EOM_LOCAL void eom_wrench_at(const eom_wrench *restrict wrench, eom_instant at, double *restrict row)
{
    double rate[6];
    double second[6];
    (void)memset(row, 0, 6U * sizeof *row);
    if ((wrench->t0 <= at.beside) && (at.beside < wrench->t1)) { eom_spline_at(wrench->signal, at, row, rate, second); }
}

/* A wrench's row and arm by the axes of its frame; where it does not turn, its row as it is. */
EOM_LOCAL void EOM(turn_wrench)(const eom_wrench *restrict wrench, const EOM_SCALAR *restrict pose, const double *restrict row, double *restrict turned_row, double *restrict arm)
{
    EOM(turn_vector)(pose, 1, wrench->arm, arm);
    if (wrench->turns != 0) {
        EOM(turn_vector)(pose, 1, row, turned_row);
        EOM(turn_vector)(pose, 1, &row[3], &turned_row[3]);
    } else {
        for (int i = 0; i < 6; ++i) { turned_row[i] = row[i]; }
    }
}

/* Wrenches on all links, (links, 6), in the base frame. */
EOM_LOCAL void eom_wrenches_at(const EOM(inputs) *restrict inputs, int size, eom_instant at, const EOM_SCALAR *restrict q, EOM_SCALAR *restrict total)
{
    const eom_instant within = eom_within_span(inputs->first, inputs->last, at);
    (void)memset(total, 0, (size_t)size * sizeof *total);
    for (size_t k = 0; k < inputs->wrenches; ++k) {
        const eom_wrench *const wrench = &inputs->wrench[k];
        double row[6];
        eom_wrench_at(wrench, within, row);
        if (wrench->frame >= 0) {
            EOM_SCALAR pose[16];
            double arm[3];
            double turned[6];
            (void)inputs->frame_pose(inputs->frame_h, q, wrench->frame, pose);
            EOM(turn_wrench)(wrench, pose, row, turned, arm);
            eom_add_cross(arm, turned, &turned[3]);
            (void)memcpy(row, turned, sizeof row);
        }
        for (int i = 0; i < 6; ++i) { total[6 * wrench->link + i] += (EOM_SCALAR)row[i]; }
    }
}

/* Generalized forces of wrenches on all coordinates; here is h of the state.  work: 2 nq + wrench. */
EOM_LOCAL void eom_wrench_forces(const EOM(sizes) *restrict sizes, const EOM(inputs) *restrict inputs, const EOM_SCALAR *here, eom_instant at, const double *restrict q, double *restrict force, EOM_SCALAR *restrict work)
{
    const int nq = EOM_POSITIONS_OF(sizes);
    EOM_SCALAR *const q_here = work;
    EOM_SCALAR *const pushed = &work[nq];
    EOM_SCALAR *const total = &work[2 * nq];
    for (int i = 0; i < nq; ++i) { q_here[i] = (EOM_SCALAR)q[i]; }
    eom_wrenches_at(inputs, sizes->wrench, at, q_here, total);
    (void)inputs->external_force((inputs->force_h == NULL) ? here : inputs->force_h, q_here, total, pushed);
    for (int i = 0; i < nq; ++i) { force[i] = (double)pushed[i]; }
}

/* Whether a coordinate is prescribed: in the place of its force stands its acceleration. */
EOM_LOCAL int eom_is_prescribed(const EOM(sizes) *restrict sizes, int i)
{
    return ((sizes->is_prescribed != NULL) && (sizes->is_prescribed[i] != 0)) ? 1 : 0;
}

/* Where a force on a coordinate stands in arrays of drives. */
EOM_LOCAL int eom_force_place(const EOM(sizes) *restrict sizes, int i)
{
    return (sizes->beside == NULL) ? i : sizes->beside[i];
}

/* Add forces of wrenches to those of drives. */
EOM_LOCAL void eom_add_forces(const EOM(sizes) *restrict sizes, const double *restrict force, double *restrict u)
{
    for (int i = 0; i < EOM_POSITIONS_OF(sizes); ++i) {
        if (eom_is_prescribed(sizes, i) == 0) { u[eom_force_place(sizes, i)] += force[i]; }
    }
}

/* Powers of drives and of wrenches, and what dampers and friction dissipate, W.  Of drives with states the power that they take
 * in; where motions are prescribed power[1] is how much more that is than they give to coordinates.  work: nq + 4 nv. */
EOM_LOCAL void eom_powers_at(const EOM(sizes) *restrict sizes, const EOM(energy_balance) *restrict balance, const double *restrict q, const double *restrict v, const double *restrict u, const double *restrict pushed, double *restrict power, EOM_SCALAR *restrict work)
{
    const int nq = EOM_POSITIONS_OF(sizes);
    const int nv = EOM_RATES_OF(sizes);
    EOM_SCALAR *const q_here = work;
    EOM_SCALAR *const v_here = &q_here[nq];
    EOM_SCALAR *const rest = &v_here[nv];
    EOM_SCALAR *const still = &rest[nv];
    EOM_SCALAR *const moving = &still[nv];
    (void)memset(rest, 0, (size_t)nv * sizeof *rest);
    for (int i = 0; i < nq; ++i) { q_here[i] = (EOM_SCALAR)q[i]; }
    for (int i = 0; i < nv; ++i) { v_here[i] = (EOM_SCALAR)v[i]; }
    (void)balance->generalized_force(balance->passive_h, q_here, rest, still);
    (void)balance->generalized_force(balance->passive_h, q_here, v_here, moving);
    for (int w = 0; w < EOM_WORKS; ++w) { power[w] = 0.0; }
    for (int i = 0; i < nv; ++i) { power[3] += ((double)still[i] - (double)moving[i]) * v[i]; }
    for (int i = 0; i < nq; ++i) {
        power[2] += pushed[i] * v[i];
        if ((eom_is_prescribed(sizes, i) == 0) && (balance->drive_forces == NULL)) { power[0] += u[i] * v[i]; }
    }
    if (balance->drive_forces != NULL) {
        for (int i = 0; i < EOM_INPUTS_OF(sizes); ++i) { rest[i] = (EOM_SCALAR)u[i]; }
        (void)balance->drive_forces(balance->drive_h, q_here, v_here, rest, moving);
        for (int i = 0; i < nv; ++i) {
            const double part = ((i >= nq) || (eom_is_prescribed(sizes, i) == 0)) ? (double)moving[i] * v[i] : 0.0;
            power[0] += part;
            if ((sizes->is_prescribed != NULL) && (i >= nq)) { power[1] += part; }
        }
    }
}
