/* eom_robot.h: a robot as the library knows it, and functions that integrate its motion; eom.h includes it for each
 * precision. */

/* Sizes of a robot, and what is particular about it. */
typedef struct {
    int positions;  /* nq, of q */
    int rates;      /* nv, of v: velocities of these coordinates, then internal states; at least nq and nu */
    int inputs;     /* nu, of u: at coordinates, then forces beside drives with states; at least nq */
    int m;          /* constraints of closed loops; 0 for a tree */
    int hoisted;    /* numbers h that setup makes of the parameters, at least 1 */
    int parameters; /* numbers that setup takes */
    int factors;    /* numbers that stage_factors hands to stage_solution */
    int wrench;     /* 6 per link */
    int gaps;       /* constraints of a computed torque model's loops, at most */
    int rotations;  /* joints of three rotations that change charts */
    int has_friction;         /* Coulomb friction: the error counts what the matrix of the end leaves */
    int has_redundant_rows;   /* states of stages are assembled, too */
    /* NULL without such drives; nq, where in u forces on a coordinate stand: there is the input of its drive at its own
     * place, and forces stand behind all coordinates */
    const int *beside;
    const int *is_prescribed; /* nq, or NULL */
    const int *angles_at;     /* first angle of each joint of three rotations */
    const int *origin_at;     /* its x, or -1 */
    EOM_SCALAR closed_gap;    /* m or rad: constraint violation that is round-off */
    EOM_SCALAR open_gap;      /* m or rad: more of it is none */
    /* NULL without rotations: behind parameters, which of them are turned */
    void (*setup)(const EOM_SCALAR *p, EOM_SCALAR *h);
    int pair_factors;         /* numbers that pair_factors hands to pair_solution; 0 without them */
} EOM(sizes);

/* Equations of a robot, of one state in each argument, or of a state in every lane: number i of state l at x[i][l].
 * They return 0, or 1 + the number of the pivot that vanishes; statuses of lane l are 2 nq + 3 m higher per lane, nq
 * for a tree.  forward_dynamics writes nv accelerations, with closed loops 3 m numbers behind them; settling nq changes
 * of q, nv of v and m violations.  added, kp and kd are nu numbers.  stage_factors, stage_solution: M + time D + time^2
 * K of a stage, times = (time, time^2), and the solution w, nv, by which accelerations differ from right, nv, of
 * changes of positions shifts, nq; where forces beside drives stand kp has the inputs of these, on which their slopes
 * depend.  pair_factors, pair_solution: the same with a complex time, all imaginary parts behind the real ones, spans =
 * (|time|, |time|^2); NULL where method 2 is not asked for. */
typedef struct {
    const EOM(sizes) *sizes;
    EOM_EQUATIONS(EOM_SCALAR);
} EOM(robot);

/* Derivatives of a robot's equations, for one state in each argument; one that is not differentiated needs none of
 * them.  Adjoints write the gradient of results, times weights, by the arguments in their order but for times, then by
 * the parameters; tangents what results change by along rates of arguments, and dp of the parameters.  Explicit methods
 * ask for those of forward_dynamics, the linearly implicit Euler method for those of implicit_step, the Rosenbrock
 * method for those of forward_dynamics, stage_factors and stage_solution, and closed loops for those of settling. */
typedef struct {
    const EOM(robot) *robot;
    int poses; /* numbers of the poses of all frames, 12 each; 0 without wrenches */
    int (*forward_dynamics_adjoint)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *u,
            const EOM_SCALAR *weights, EOM_SCALAR *out);
    int (*implicit_step_adjoint)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *u,
            const EOM_SCALAR *added, const EOM_SCALAR *times, const EOM_SCALAR *weights, EOM_SCALAR *out);
    int (*stage_factors_adjoint)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *kp,
            const EOM_SCALAR *kd, const EOM_SCALAR *times, const EOM_SCALAR *weights, EOM_SCALAR *out);
    int (*stage_solution_adjoint)(const EOM_SCALAR *h, const EOM_SCALAR *factors, const EOM_SCALAR *right,
            const EOM_SCALAR *shifts, const EOM_SCALAR *weights, EOM_SCALAR *out);
    int (*settling_adjoint)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *weights,
            EOM_SCALAR *out);
    int (*forward_dynamics_tangent)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *u,
            const EOM_SCALAR *dq, const EOM_SCALAR *dv, const EOM_SCALAR *du, const EOM_SCALAR *dp, EOM_SCALAR *out);
    int (*implicit_step_tangent)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *u,
            const EOM_SCALAR *added, const EOM_SCALAR *times, const EOM_SCALAR *dq, const EOM_SCALAR *dv,
            const EOM_SCALAR *du, const EOM_SCALAR *dp, EOM_SCALAR *out);
    int (*stage_factors_tangent)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *kp,
            const EOM_SCALAR *kd, const EOM_SCALAR *times, const EOM_SCALAR *dq, const EOM_SCALAR *dv,
            const EOM_SCALAR *dp, EOM_SCALAR *out);
    int (*stage_solution_tangent)(const EOM_SCALAR *h, const EOM_SCALAR *factors, const EOM_SCALAR *right,
            const EOM_SCALAR *shifts, const EOM_SCALAR *dfactors, const EOM_SCALAR *dright, const EOM_SCALAR *dshifts,
            const EOM_SCALAR *dp, EOM_SCALAR *out);
    int (*settling_tangent)(const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v, const EOM_SCALAR *dq,
            const EOM_SCALAR *dv, const EOM_SCALAR *dp, EOM_SCALAR *out);
} EOM(robot_derivatives);

/* Steps of a motion that is differentiated: lengths, s, and rows of drives, count of each, and with inputs times at
 * which they begin, and at which the last one ends, s. */
typedef struct {
    const EOM_SCALAR *dt;
    const double *times;
    const long long *row;
    size_t count;
    int method; /* EOM_EXPLICIT, EOM_IMPLICIT_EULER or EOM_ROSENBROCK, + EOM_KINDS times its number there */
} EOM(step_sequence);

/* Room for doubles, integers, and scalars for one state or lanes for several.  What changes on the way is last: a load
 * of the first two at once would wait for it. */
typedef struct {
    double *input;     /* EOM_INPUT_ROOM */
    int *index;        /* EOM_INDEX_ROOM */
    EOM_SCALAR *state; /* EOM_STATE_ROOM */
} EOM(workspace);

#ifdef __cplusplus
extern "C" {
#endif
#if !defined(EOM_RATES)
/* Take steps of length dt, s, from q and v; every so many states are stored.  method 0: the classical Runge-Kutta
 * method of order 4; 1: the linearly implicit Euler method.  Inputs, or NULL, act beside the drives, the first step
 * being from the time first on, s; prescribed coordinates begin where their motions are then.  -1, or step * statuses +
 * i of the first failure. */
long long EOM(integrate_fixed)(const EOM(robot) *robot, const EOM_SCALAR *h, const EOM_SCALAR *q, const EOM_SCALAR *v,
        const EOM(drive) *drive, const EOM(inputs) *inputs, double first, EOM_SCALAR dt, size_t steps, size_t every,
        int method, EOM_SCALAR *q_out, EOM_SCALAR *v_out, EOM(workspace) work);

/* The same for count states, one after the other, without inputs. */
long long EOM(integrate_fixed_one_by_one)(const EOM(robot) *robot, size_t count, const EOM_SCALAR *h,
        const EOM_SCALAR *q, size_t q_step, const EOM_SCALAR *v, size_t v_step, const EOM(drive) *drive, EOM_SCALAR dt,
        size_t steps, size_t every, int method, EOM_SCALAR *q_out, EOM_SCALAR *v_out, EOM(workspace) work);

/* Take steps from q, (count + 1, nq), and v, (count + 1, nv), in the first row on.  kept is NULL, or count times
 * EOM_KEPT_NUMBERS, which spare rollout_gradient work.  Joints of three rotations keep their angles.  -1, or step *
 * statuses + i of the first failure.  work.state: EOM_SENSITIVITY_ROOM, work.input: EOM_SENSITIVITY_INPUT_ROOM. */
long long EOM(rollout_states)(const EOM(robot_derivatives) *derivatives, const EOM_SCALAR *h, const EOM(drive) *drive,
        const EOM(inputs) *inputs, const EOM(step_sequence) *steps, EOM_SCALAR *q, EOM_SCALAR *v, EOM_SCALAR *kept,
        EOM(workspace) work);

/* Go back through the steps of rollout_states: by_q and by_v hold derivatives of a sum by each state as it stands
 * alone, and become those by the whole way from there on; slopes get what is added to them.  kept as of
 * rollout_states. */
void EOM(rollout_gradient)(const EOM(robot_derivatives) *derivatives, const EOM_SCALAR *h, const EOM(drive) *drive,
        const EOM(inputs) *inputs, const EOM(step_sequence) *steps, const EOM_SCALAR *q, const EOM_SCALAR *v,
        const EOM_SCALAR *kept, EOM_SCALAR *by_q, EOM_SCALAR *by_v, const EOM(slopes) *slopes, EOM(workspace) work);

/* Take the same steps with rates along directions beside the states: dq and dv, (count + 1, directions, nq or nv), hold
 * those of the first state, and get those at the end of each step. */
long long EOM(rollout_sensitivity)(const EOM(robot_derivatives) *derivatives, const EOM_SCALAR *h,
        const EOM(drive) *drive, const EOM(inputs) *inputs, const EOM(step_sequence) *steps, size_t directions,
        const EOM(rates) *rates, EOM_SCALAR *q, EOM_SCALAR *v, EOM_SCALAR *dq, EOM_SCALAR *dv, EOM(workspace) work);
#endif

#if !defined(EOM_RATES) || defined(EOM_LINKED)
/* Go from sample to sample, at samples + 1 times, by steps with error control.  method 0: a Rosenbrock method of order
 * 4(3) for stiff equations; 1: the explicit pair of Tsitouras of order 5(4); 2: Radau IIA of order 9 for stiff
 * equations, with more room (EOM_RADAU_ROOM).  Returns progress->reason. */
int EOM(integrate_adaptive)(const EOM(robot) *robot, const EOM_SCALAR *h, const EOM(drive) *drive,
        const EOM(inputs) *inputs, const EOM(tolerance) *allowed, const double *times, size_t samples, int method,
        EOM_SCALAR *q, EOM_SCALAR *v, EOM_SCALAR *q_out, EOM_SCALAR *v_out, eom_progress *progress, EOM(record) *record,
        EOM(workspace) work);

/* The same for count states, one after the other, those at place, or the first ones. */
void EOM(integrate_adaptive_one_by_one)(const EOM(robot) *robot, size_t count, const size_t *place, const EOM_SCALAR *h,
        size_t h_step, const EOM(drive) *drive, const EOM(inputs) *inputs, size_t inputs_step,
        const EOM(tolerance) *allowed, size_t allowed_step, const double *times, size_t samples, int method,
        EOM_SCALAR *q, EOM_SCALAR *v, EOM_SCALAR *q_out, EOM_SCALAR *v_out, eom_progress *progress,
        EOM(workspace) work);

/* Write the drives of inputs at times, (count, nu), with accelerations of prescribed coordinates, whose positions and
 * velocities are put into q and v. */
void EOM(inputs_over_time)(const EOM(sizes) *sizes, size_t count, const EOM(inputs) *inputs, const double *times,
        EOM_SCALAR *q, EOM_SCALAR *v, EOM_SCALAR *u, double *work, int *index);
#endif
#ifdef __cplusplus
}
#endif
