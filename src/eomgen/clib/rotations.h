/* rotations.h: rotations R = Rx(alpha) Ry(beta) Rz(gamma) in other angles; included for each precision. */

/* Angles of the same rotation, seen from axes that are so many places on: those next to the ones in near. */
EOM_LOCAL void EOM_ROTATION(other_angles)(int places, const EOM_ROTATION_SCALAR *restrict angle, EOM_ROTATION_SCALAR *restrict near)
{
    const EOM_ROTATION_SCALAR pi = (EOM_ROTATION_SCALAR)3.141592653589793;
    const EOM_ROTATION_SCALAR turn = (EOM_ROTATION_SCALAR)2.0 * pi;
    const EOM_ROTATION_SCALAR sa = EOM_ROTATION_MATH(sin)(angle[0]);
    const EOM_ROTATION_SCALAR ca = EOM_ROTATION_MATH(cos)(angle[0]);
    const EOM_ROTATION_SCALAR sb = EOM_ROTATION_MATH(sin)(angle[1]);
    const EOM_ROTATION_SCALAR cb = EOM_ROTATION_MATH(cos)(angle[1]);
    const EOM_ROTATION_SCALAR sg = EOM_ROTATION_MATH(sin)(angle[2]);
    const EOM_ROTATION_SCALAR cg = EOM_ROTATION_MATH(cos)(angle[2]);
    const EOM_ROTATION_SCALAR R[9] = {
        cb * cg, -cb * sg, sb,
        ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb,
        sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb
    };
    const EOM_ROTATION_SCALAR *const x = &R[3 * places];
    const EOM_ROTATION_SCALAR *const y = &R[3 * ((places + 1) % 3)];
    const EOM_ROTATION_SCALAR *const z = &R[3 * ((places + 2) % 3)];
    EOM_ROTATION_SCALAR candidate[2][3];
    EOM_ROTATION_SCALAR apart[2] = { (EOM_ROTATION_SCALAR)0.0, (EOM_ROTATION_SCALAR)0.0 };
    candidate[0][0] = EOM_ROTATION_MATH(atan2)(-y[2], z[2]);
    const EOM_ROTATION_SCALAR s = EOM_ROTATION_MATH(sin)(candidate[0][0]);
    const EOM_ROTATION_SCALAR c = EOM_ROTATION_MATH(cos)(candidate[0][0]);
    candidate[0][1] = EOM_ROTATION_MATH(atan2)(x[2], c * z[2] - s * y[2]);
    candidate[0][2] = EOM_ROTATION_MATH(atan2)(c * y[0] + s * z[0], c * y[1] + s * z[1]);
    candidate[1][0] = candidate[0][0] + pi;
    candidate[1][1] = pi - candidate[0][1];
    candidate[1][2] = candidate[0][2] + pi;
    for (int way = 0; way < 2; ++way) {
        for (int i = 0; i < 3; ++i) {
            candidate[way][i] += turn * EOM_ROTATION_MATH(round)((near[i] - candidate[way][i]) / turn);
            apart[way] += EOM_ROTATION_MATH(fabs)(near[i] - candidate[way][i]);
        }
    }
    const int nearest = (apart[1] < apart[0]) ? 1 : 0;
    for (int i = 0; i < 3; ++i) { near[i] = candidate[nearest][i]; }
}
