/* forces.h: what steps are of, and limits of drives; of one state or of one in every lane. */

/* A motion: a robot, its numbers h as joints are turned, how they are, and its drives. */
typedef struct {
    const EOM_F(robot) *robot;
    const EOM_REAL *h;
#if !defined(EOM_WITHOUT_CHARTS)
    EOM_F(charts) *charts; /* NULL without joints of three rotations */
#endif
    const EOM(drive) *drive;
} EOM_F(motion);

/* Where lanes are in their steps: from when on, how long and to when, with times inside beside both ends where inputs
 * jump there, the next such time, and by which inputs, NULL for all or for none; powers of all stages, W, number w of
 * stage s of lane l at [(s * EOM_WORKS + w) * EOM_WIDTH + l], where works are asked for. */
typedef struct {
    const EOM(inputs) *inputs[EOM_WIDTH];
    double *power;
    double begin[EOM_WIDTH];
    double step[EOM_WIDTH];
    double end[EOM_WIDTH];
    double after[EOM_WIDTH];
    double before[EOM_WIDTH];
    double stop[EOM_WIDTH];
    int here;
} EOM_F(clock);

/* What steps are of: a motion, its forces and targets, and where its lanes are.  failed: of each lane 0, or what the
 * first of its equations said that could not be solved in this step; NULL where steps are of fixed length and end at
 * once.  spare: of lanes nq + nv + 2 nu + 6 + hoisted. */
typedef struct {
    EOM_F(motion) motion;
    const EOM_REAL *u;
    const EOM_REAL *target;
    EOM_F(clock) clock;
    int *failed;
    EOM_REAL *spare;
} EOM_F(problem);

/* Saturate n drives at their limits; slope, if it is not NULL, becomes 0 where they do, else 1. */
EOM_LOCAL void EOM_F(saturate)(const EOM(drive) *restrict drive, int n, EOM_REAL *restrict u, EOM_REAL *restrict slope)
{
    for (int l = 0; l < (int)EOM_WIDTH; ++l) {
        for (int i = 0; i < n; ++i) {
            const EOM_SCALAR most = drive->effort[i];
            const EOM_SCALAR x = EOM_LANE_OF(u[i], l);
            const int over = ((x > most) || (x < -most)) ? 1 : 0;
            if (slope != NULL) { EOM_LANE_OF(slope[i], l) = (over != 0) ? EOM_C(0.0) : EOM_C(1.0); }
            if (over != 0) { EOM_LANE_OF(u[i], l) = (x > most) ? most : -most; }
        }
    }
}
