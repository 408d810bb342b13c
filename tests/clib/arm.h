/* An arm whose upper link turns by q[0], and whose forearm slides out of it by q[1] and turns by q[2], or with FOLLOWS by q[0] as
 * well; of one state or of one in every lane. */
#include "kinematics.h"

/* kept: sine and cosine of the upper link's angle; and of the forearm's, and its origin. */
static void EOM_F(arm_run)(int run, int last, const EOM_SCALAR *h, const EOM_REAL *q, const EOM_REAL *sine, const EOM_REAL *cosine, EOM_REAL *kept, EOM_REAL *pose, EOM_REAL *origins, EOM_REAL *axes)
{
    const EOM_SCALAR upper = h[0], forearm = h[1];
    const EOM_REAL zero = EOM_WHOLE(EOM_C(0.0)), one = EOM_WHOLE(EOM_C(1.0));
    const EOM_REAL at_base[5] = { zero, one, zero, zero, zero };
    const EOM_REAL *const from = (run == 2) ? at_base : (run == 3) ? kept : &kept[2];
    switch (run) {
    case 0: /* the base and the upper link */
        if (last < 1) { return; }
        kept[0] = sine[0];
        kept[1] = cosine[0];
        for (int i = 0; i < 3; ++i) { origins[i] = zero; axes[i] = (i == 2) ? one : zero; }
        break;
    case 1: /* the forearm */
        kept[2] = kept[0] * cosine[0] + kept[1] * sine[0];
        kept[3] = kept[1] * cosine[0] - kept[0] * sine[0];
        kept[4] = (upper + q[1]) * kept[1];
        kept[5] = (upper + q[1]) * kept[0];
        origins[3] = kept[4];
        origins[4] = kept[5];
        origins[5] = zero;
        axes[3] = kept[1];
        axes[4] = kept[0];
        axes[5] = axes[6] = axes[7] = zero;
        axes[8] = one;
        break;
    default: /* frames of the base, of the upper link and of the forearm */
        for (int i = 0; i < 12; ++i) { pose[i] = zero; }
        pose[0] = pose[5] = from[1];
        pose[4] = from[0];
        pose[1] = -from[0];
        pose[10] = one;
        pose[3] = (run == 2) ? zero : (run == 3) ? upper * from[1] : from[2] + forearm * from[1];
        pose[7] = (run == 2) ? zero : (run == 3) ? upper * from[0] : from[3] + forearm * from[0];
        break;
    }
}

static void EOM_F(arm)(const EOM_SCALAR *h, const EOM_REAL *q, int frame, EOM_REAL *pose, EOM_REAL *jacobian)
{
    int way[3];
    EOM_REAL turning[EOM_PADDED(2)], sines[EOM_PADDED(2)], cosines[EOM_PADDED(2)], kept[6], origins[6], axes[9];
    const EOM_REAL angle[2] = { q[0], q[ARM_TURNS] };
    const EOM_F(way) room = { way, turning, sines, cosines, kept };
    EOM_F(forward_kinematics)(EOM_F(arm_run), h, q, angle, frame, pose, origins, axes, room);
    EOM_F(last_row)(pose);
    EOM_F(frame_jacobian)(frame, pose, origins, axes, jacobian);
}
