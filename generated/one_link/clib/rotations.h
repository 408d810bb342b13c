/* rotations.h: rotations R = Rx(alpha) Ry(beta) Rz(gamma) in other angles; included for each precision. */

/* Angles of the same rotation, seen from axes that are so many places on: those next to the ones in near. */
EOM_LOCAL void ROTATION(other_angles)(int places, const ROTATION_SCALAR *restrict angle, ROTATION_SCALAR *restrict near)
{
    const ROTATION_SCALAR pi = (ROTATION_SCALAR)3.141592653589793;
    const ROTATION_SCALAR turn = (ROTATION_SCALAR)2.0 * pi;
    const ROTATION_SCALAR sa = ROTATION_MATH(sin)(angle[0]);
    const ROTATION_SCALAR ca = ROTATION_MATH(cos)(angle[0]);
    const ROTATION_SCALAR sb = ROTATION_MATH(sin)(angle[1]);
    const ROTATION_SCALAR cb = ROTATION_MATH(cos)(angle[1]);
    const ROTATION_SCALAR sg = ROTATION_MATH(sin)(angle[2]);
    const ROTATION_SCALAR cg = ROTATION_MATH(cos)(angle[2]);
    const ROTATION_SCALAR R[9] = {
        cb * cg, -cb * sg, sb,
        ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb,
        sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb
    };
    const ROTATION_SCALAR *const x = &R[3 * places];
    const ROTATION_SCALAR *const y = &R[3 * ((places + 1) % 3)];
    const ROTATION_SCALAR *const z = &R[3 * ((places + 2) % 3)];
    ROTATION_SCALAR candidate[2][3];
    ROTATION_SCALAR apart[2] = { (ROTATION_SCALAR)0.0, (ROTATION_SCALAR)0.0 };
    candidate[0][0] = ROTATION_MATH(atan2)(-y[2], z[2]);
    const ROTATION_SCALAR s = ROTATION_MATH(sin)(candidate[0][0]);
    const ROTATION_SCALAR c = ROTATION_MATH(cos)(candidate[0][0]);
    candidate[0][1] = ROTATION_MATH(atan2)(x[2], c * z[2] - s * y[2]);
    candidate[0][2] = ROTATION_MATH(atan2)(c * y[0] + s * z[0], c * y[1] + s * z[1]);
    candidate[1][0] = candidate[0][0] + pi;
    candidate[1][1] = pi - candidate[0][1];
    candidate[1][2] = candidate[0][2] + pi;
    for (int way = 0; way < 2; ++way) {
        for (int i = 0; i < 3; ++i) {
            candidate[way][i] += turn * ROTATION_MATH(round)((near[i] - candidate[way][i]) / turn);
            apart[way] += ROTATION_MATH(fabs)(near[i] - candidate[way][i]);
        }
    }
    const int nearest = (apart[1] < apart[0]) ? 1 : 0;
    for (int i = 0; i < 3; ++i) { near[i] = candidate[nearest][i]; }
}
