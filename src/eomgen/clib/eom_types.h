/* eom_types.h: types of one precision; eom.h includes it for each. */

/* Drives, held over a step or from a sample to the next (zero-order hold): u + kp (target - q) - kd v.  Those of state
 * s from sample k on lie at s * u_state + k * u_step.  kp, kd and target may be NULL together. */
typedef struct {
    const EOM_SCALAR *u; /* nu, N or Nm, or units of drives' inputs */
    size_t u_state;
    size_t u_step;
    const EOM_SCALAR *kp;     /* nu, N/m or Nm/rad */
    const EOM_SCALAR *kd;     /* nu, N s/m or Nm s/rad */
    const EOM_SCALAR *target; /* nq, m or rad */
    size_t target_state;
    size_t target_step;
    const EOM_SCALAR *effort; /* NULL, or nu limits, N or Nm, at which drives saturate, infinite where there is none */
    EOM_SCALAR *turned;       /* NULL, or per state how joints of three rotations are turned, kept for what goes on */
} EOM(drive);

/* What an energy balance needs of a robot: its passive forces, those of drives with states, NULL without any, and the
 * forces that a motion needs, by its inverse dynamics, or with closed loops by its residual: nv each, whose power is
 * that by v. */
typedef struct {
    int (*generalized_force)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, EOM_SCALAR *out);
    const EOM_SCALAR *passive_h;
    int (*drive_forces)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *u,
            EOM_SCALAR *out);
    const EOM_SCALAR *drive_h;
    int (*needed)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *a, EOM_SCALAR *out);
    const EOM_SCALAR *needed_h;
    int (*residual)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *a,
            const EOM_SCALAR *u, EOM_SCALAR *out);
} EOM(energy_balance);

/* Inputs that follow time itself, between first and last, beside drives; any of them may be NULL.  They jump at the
 * times of stop.  force_back, pose_back: adjoints of external_force and frame_pose; force_along, pose_along: their
 * tangents; force_by, pose_by: those by parameters. */
typedef struct {
    double first; /* s */
    double last;
    const EOM(energy_balance) *work;
    const eom_track *torque; /* forces */
    const eom_tracking *control;
    const eom_computed_torque *model;
    const eom_prescribed *given;
    const eom_wrench *wrench;
    size_t wrenches;
    const double *stop; /* s, in order */
    size_t stops;
    int (*frame_pose)(const EOM_SCALAR *h, const EOM_SCALAR *q, int frame, EOM_SCALAR *out);
    const EOM_SCALAR *frame_h;
    int (*external_force)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *wrench, EOM_SCALAR *out);
    const EOM_SCALAR *force_h; /* NULL: h of the rollout */
    int (*force_back)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *wrench, const EOM_SCALAR *weights,
            EOM_SCALAR *out);
    const EOM_SCALAR *force_back_h;
    int (*pose_back)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *weights, EOM_SCALAR *out);
    const EOM_SCALAR *pose_back_h;
    int (*force_along)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *wrench, const EOM_SCALAR *dq,
            const EOM_SCALAR *dwrench, EOM_SCALAR *out);
    const EOM_SCALAR *force_along_h;
    int (*force_by)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *wrench, const EOM_SCALAR *dp,
            EOM_SCALAR *out);
    const EOM_SCALAR *force_by_h;
    int (*pose_along)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *dq, EOM_SCALAR *out);
    const EOM_SCALAR *pose_along_h;
    int (*pose_by)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *dp, EOM_SCALAR *out);
    const EOM_SCALAR *pose_by_h;
    const double *effort; /* NULL, or nu limits, N or Nm, at which drives and these inputs' drives together saturate */
    const EOM_SCALAR *force_turned; /* h of external_force with all joints of three rotations turned */
} EOM(inputs);

/* Error control: the error of each number of the state is at most atol + rtol times its size. */
typedef struct {
    double rtol;
    const EOM_SCALAR *atol; /* nq + nv, of q, then of v */
    long long most;         /* steps in one call */
} EOM(tolerance);

/* Every step, as far as there is room. */
typedef struct {
    double *t; /* s */
    EOM_SCALAR *q;
    EOM_SCALAR *v;
    double *stiffness; /* NULL, or of the explicit method step times size of the largest eigenvalue, estimated */
    size_t room;
    size_t count;
} EOM(record);

/* Derivatives by drives, gains and parameters, added to; rows as of the drive. */
typedef struct {
    EOM_SCALAR *u;
    EOM_SCALAR *target;
    EOM_SCALAR *kp;
    EOM_SCALAR *kd;
    EOM_SCALAR *parameters;
    const eom_input_slopes *loads;
} EOM(slopes);

/* Directions along which derivatives are taken: rates of drives and of parameters. */
typedef struct {
    const EOM_SCALAR *u;
    size_t u_direction;
    size_t u_step;
    const EOM_SCALAR *parameters;
} EOM(rates);
