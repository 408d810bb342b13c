/* forces.h: what steps are of, and limits of drives; of one state or of one in every lane. */

/* A motion: a robot, its numbers h as joints are turned, how they are, and its drives. */
typedef struct {
    const F(robot) *robot;
    const REAL *h;
#if !defined(EOM_WITHOUT_CHARTS)
    F(charts) *charts; /* NULL without joints of three rotations */
#endif
    const EOM(drive) *drive;
} F(motion);

/* Where lanes are in their steps: from when on, how long and to when, with times inside beside both ends where inputs jump
 * there, the next such time, and by which inputs, NULL for all or for none; powers of all stages, W, number w of stage s of lane
 * l at [(s * EOM_WORKS + w) * WIDTH + l], where works are asked for. */
typedef struct {
    const EOM(inputs) *inputs[WIDTH];
    double *power;
    double begin[WIDTH];
    double step[WIDTH];
    double end[WIDTH];
    double after[WIDTH];
    double before[WIDTH];
    double stop[WIDTH];
    int here;
} F(clock);

/* What steps are of: a motion, its forces and targets, and where its lanes are.  failed: of each lane 0, or what the first of its
 * equations said that could not be solved in this step; NULL where steps are of fixed length and end at once.  spare: of lanes
 * nq + nv + 2 nu + 6 + hoisted. */
typedef struct {
    F(motion) motion;
    const REAL *u;
    const REAL *target;
    F(clock) clock;
    int *failed;
    REAL *spare;
} F(problem);

/* Saturate n drives at their limits; slope, if it is not NULL, becomes 0 where they do, else 1. */
EOM_LOCAL void F(saturate)(const EOM(drive) *restrict drive, int n, REAL *restrict u, REAL *restrict slope)
{
    for (int l = 0; l < (int)WIDTH; ++l) {
        for (int i = 0; i < n; ++i) {
            const EOM_SCALAR most = drive->effort[i];
            const EOM_SCALAR x = LANE_OF(u[i], l);
            const int over = ((x > most) || (x < -most)) ? 1 : 0;
            if (slope != NULL) { LANE_OF(slope[i], l) = (over != 0) ? C(0.0) : C(1.0); }
            if (over != 0) { LANE_OF(u[i], l) = (x > most) ? most : -most; }
        }
    }
}
