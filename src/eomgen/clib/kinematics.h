/* kinematics.h: poses of frames and their Jacobians, eqs. (1) to (3), of one state or of one in every lane: from the
 * base to a frame, run by run, and sines and cosines of all angles on the way at once.  EOM_FRAMES names the tables of
 * frames.h of a robot. */
#include "frames.h"

/* A robot's equations of a run, up to the node last: origins of its bodies and their axes, in the base, and what later
 * runs take of kept; or the pose of a frame, [R | X] by rows. */
typedef void EOM_F(run)(int run, int last, const EOM_SCALAR *h, const EOM_REAL *q, const EOM_REAL *sine,
        const EOM_REAL *cosine, EOM_REAL *kept, EOM_REAL *pose, EOM_REAL *origins, EOM_REAL *axes);

/* Room on the way to a frame: a node per run; angles, their sines and cosines, EOM_PADDED; and numbers that runs hand
 * on. */
typedef struct {
    int *way;
    EOM_REAL *angle;
    EOM_REAL *sine;
    EOM_REAL *cosine;
    EOM_REAL *kept;
} EOM_F(way);

/* Compute the pose of a frame, and the origins and axes of the bodies between the base and it; angle is where the
 * places of angles are: q, or what follows from it. */
EOM_IN_PLACE void EOM_F(forward_kinematics)(EOM_F(run) *run, const EOM_SCALAR *restrict h, const EOM_REAL *q,
        const EOM_REAL *angle, int frame, EOM_REAL *restrict pose, EOM_REAL *restrict origins, EOM_REAL *restrict axes,
        EOM_F(way) room)
{
    int count = 0;
    int angles = 0;
    int done = 0;
    for (int i = 0; (EOM_WIDTH == 1) && (i < EOM_PADDED(EOM_FRAMES.angles)); ++i) {
        room.angle[i] = EOM_WHOLE(EOM_C(0.0));
    }
    for (int node = EOM_FRAMES.first_frame + frame; node >= 0; node = EOM_FRAMES.behind[EOM_FRAMES.run_of[node]]) {
        room.way[count] = node;
        ++count;
    }
    for (int i = count - 1; i >= 0; --i) {
        const int first = EOM_FRAMES.first[EOM_FRAMES.run_of[room.way[i]]];
        for (int k = 0; k < EOM_FRAMES.turned[room.way[i]]; ++k) {
            room.angle[angles] = angle[EOM_FRAMES.place[first + k]];
            ++angles;
        }
    }
    const size_t padded = EOM_PADDED((size_t)angles * EOM_WIDTH);
    if ((EOM_WIDTH > 1) && (angles == 0)) { room.angle[0] = EOM_WHOLE(EOM_C(0.0)); }
    eom_sin_cos((const EOM_SCALAR *)room.angle, padded, (EOM_SCALAR *)room.sine, (EOM_SCALAR *)room.cosine);
    while (count > 0) {
        --count;
        const int last = room.way[count];
        run(EOM_FRAMES.run_of[last], last, h, q, &room.sine[done], &room.cosine[done], room.kept, pose, origins, axes);
        done += EOM_FRAMES.turned[last];
    }
}

/* Complete a pose to a matrix, 4x4. */
EOM_IN_PLACE void EOM_F(last_row)(EOM_REAL *restrict pose)
{
    for (int i = 12; i < 15; ++i) { pose[i] = EOM_WHOLE(EOM_C(0.0)); }
    pose[15] = EOM_WHOLE(EOM_C(1.0));
}

/* Put x where a number is, or add it where several axes may be of one coordinate. */
EOM_IN_PLACE void EOM_F(put)(EOM_REAL x, EOM_REAL *restrict number)
{
    *number = (EOM_FRAMES.has_columns != 0) ? (*number + x) : x;
}

/* Compute the Jacobian of a frame, (6, n): the linear velocity of its origin and the angular velocity per coordinate,
 * in the base. */
EOM_IN_PLACE void EOM_F(frame_jacobian)(int frame, const EOM_REAL *restrict pose, const EOM_REAL *restrict origins,
        const EOM_REAL *restrict axes, EOM_REAL *restrict out)
{
    const int n = EOM_FRAMES.n;
    for (int i = 0; (EOM_FRAMES.is_full[frame] == 0) && (i < 6 * n); ++i) { out[i] = EOM_WHOLE(EOM_C(0.0)); }
    for (int body = EOM_FRAMES.body_of[frame]; body >= 0; body = EOM_FRAMES.parent[body]) {
        const EOM_REAL *const origin = &origins[3 * body];
        const EOM_REAL arm[3] = { pose[3] - origin[0], pose[7] - origin[1], pose[11] - origin[2] };
        for (int s = EOM_FRAMES.first_axis[body]; s < EOM_FRAMES.first_axis[body] + EOM_FRAMES.count[body]; ++s) {
            const EOM_REAL *const axis = &axes[3 * s];
            const int c = (EOM_FRAMES.has_columns != 0) ? EOM_FRAMES.column[s] : s;
            if (EOM_FRAMES.is_rotation[s] != 0) {
                EOM_F(put)(axis[1] * arm[2] - axis[2] * arm[1], &out[c]);
                EOM_F(put)(axis[2] * arm[0] - axis[0] * arm[2], &out[n + c]);
                EOM_F(put)(axis[0] * arm[1] - axis[1] * arm[0], &out[2 * n + c]);
                for (int i = 0; i < 3; ++i) { EOM_F(put)(axis[i], &out[(3 + i) * n + c]); }
            } else {
                for (int i = 0; i < 3; ++i) { EOM_F(put)(axis[i], &out[i * n + c]); }
            }
        }
    }
}
