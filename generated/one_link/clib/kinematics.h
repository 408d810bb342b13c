/* kinematics.h: poses of frames and their Jacobians, eqs. (1) to (3), of one state or of one in every lane: from the base to a frame,
 * run by run, and sines and cosines of all angles on the way at once.  EOM_FRAMES names the tables of frames.h of a robot. */
#include "frames.h"

/* A robot's equations of a run, up to the node last: origins of its bodies and their axes, in the base, and what later runs take of
 * kept; or the pose of a frame, [R | X] by rows. */
typedef void F(run)(int run, int last, const EOM_SCALAR *h, const REAL *q, const REAL *sine, const REAL *cosine, REAL *kept, REAL *pose, REAL *origins, REAL *axes);

/* Room on the way to a frame: a node per run; angles, their sines and cosines, PADDED; and numbers that runs hand on. */
typedef struct {
    int *way;
    REAL *angle;
    REAL *sine;
    REAL *cosine;
    REAL *kept;
} F(way);

/* Compute the pose of a frame, and the origins and axes of the bodies between the base and it; angle is where the places of angles
 * are: q, or what follows from it. */
EOM_IN_PLACE void F(forward_kinematics)(F(run) *run, const EOM_SCALAR *restrict h, const REAL *q, const REAL *angle, int frame, REAL *restrict pose, REAL *restrict origins, REAL *restrict axes, F(way) room)
{
    int count = 0;
    int angles = 0;
    int done = 0;
    for (int i = 0; (WIDTH == 1) && (i < PADDED(EOM_FRAMES.angles)); ++i) { room.angle[i] = WHOLE(C(0.0)); }
    for (int node = EOM_FRAMES.first_frame + frame; node >= 0; node = EOM_FRAMES.behind[EOM_FRAMES.run_of[node]]) { room.way[count] = node; ++count; }
    for (int i = count - 1; i >= 0; --i) {
        const int first = EOM_FRAMES.first[EOM_FRAMES.run_of[room.way[i]]];
        for (int k = 0; k < EOM_FRAMES.turned[room.way[i]]; ++k) { room.angle[angles] = angle[EOM_FRAMES.place[first + k]]; ++angles; }
    }
    const size_t padded = PADDED((size_t)angles * WIDTH);
    if ((WIDTH > 1) && (angles == 0)) { room.angle[0] = WHOLE(C(0.0)); }
    turn((const EOM_SCALAR *)room.angle, padded, (EOM_SCALAR *)room.sine, (EOM_SCALAR *)room.cosine);
    while (count > 0) {
        --count;
        const int last = room.way[count];
        run(EOM_FRAMES.run_of[last], last, h, q, &room.sine[done], &room.cosine[done], room.kept, pose, origins, axes);
        done += EOM_FRAMES.turned[last];
    }
}

/* Complete a pose to a matrix, 4x4. */
EOM_IN_PLACE void F(last_row)(REAL *restrict pose)
{
    for (int i = 12; i < 15; ++i) { pose[i] = WHOLE(C(0.0)); }
    pose[15] = WHOLE(C(1.0));
}

/* Put x where a number is, or add it where several axes may be of one coordinate. */
EOM_IN_PLACE void F(put)(REAL x, REAL *restrict number)
{
    *number = (EOM_FRAMES.has_columns != 0) ? (*number + x) : x;
}

/* Compute the Jacobian of a frame, (6, n): the linear velocity of its origin and the angular velocity per coordinate, in the base. */
EOM_IN_PLACE void F(frame_jacobian)(int frame, const REAL *restrict pose, const REAL *restrict origins, const REAL *restrict axes, REAL *restrict out)
{
    const int n = EOM_FRAMES.n;
    for (int i = 0; i < 6 * n; ++i) { out[i] = WHOLE(C(0.0)); }
    for (int body = EOM_FRAMES.body_of[frame]; body >= 0; body = EOM_FRAMES.parent[body]) {
        const REAL *const origin = &origins[3 * body];
        const REAL arm[3] = { pose[3] - origin[0], pose[7] - origin[1], pose[11] - origin[2] };
        for (int s = EOM_FRAMES.first_axis[body]; s < EOM_FRAMES.first_axis[body] + EOM_FRAMES.count[body]; ++s) {
            const REAL *const axis = &axes[3 * s];
            const int c = (EOM_FRAMES.has_columns != 0) ? EOM_FRAMES.column[s] : s;
            if (EOM_FRAMES.is_rotation[s] != 0) {
                F(put)(axis[1] * arm[2] - axis[2] * arm[1], &out[c]);
                F(put)(axis[2] * arm[0] - axis[0] * arm[2], &out[n + c]);
                F(put)(axis[0] * arm[1] - axis[1] * arm[0], &out[2 * n + c]);
                for (int i = 0; i < 3; ++i) { F(put)(axis[i], &out[(3 + i) * n + c]); }
            } else {
                for (int i = 0; i < 3; ++i) { F(put)(axis[i], &out[i * n + c]); }
            }
        }
    }
}
