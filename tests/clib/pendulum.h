/* A pendulum written by hand: m l^2 a = u - m g l sin(q) - d v, of real numbers. */
enum { MASS, LENGTH, GRAVITY, DAMPING, NUMBERS };

static real sine(real x) { return (real)sin((double)x); }
static real cosine(real x) { return (real)cos((double)x); }

static int forward_dynamics(const real *h, const real *q, const real *v, const real *u, real *a)
{
    const real inertia = h[MASS] * h[LENGTH] * h[LENGTH];
    a[0] = (u[0] - h[MASS] * h[GRAVITY] * h[LENGTH] * sine(q[0]) - h[DAMPING] * v[0]) / inertia;
    return 0;
}

/* (M + time D) a + added a = u - ...: dampers and the controller, whose part is added, at a step's end. */
static int implicit_step(const real *h, const real *q, const real *v, const real *u, const real *added, const real *times, real *a)
{
    const real inertia = h[MASS] * h[LENGTH] * h[LENGTH];
    a[0] = (u[0] - h[MASS] * h[GRAVITY] * h[LENGTH] * sine(q[0]) - h[DAMPING] * v[0]) / (inertia + times[0] * h[DAMPING] + added[0]);
    return 0;
}

/* Factors of a stage: D, K, M, time, and M + time D + time^2 K, with gravity's stiffness and the controller's gains. */
static int stage_factors(const real *h, const real *q, const real *v, const real *kp, const real *kd, const real *times, real *factors)
{
    (void)v;
    factors[0] = h[DAMPING] + kd[0];
    factors[1] = h[MASS] * h[GRAVITY] * h[LENGTH] * cosine(q[0]) + kp[0];
    factors[2] = h[MASS] * h[LENGTH] * h[LENGTH];
    factors[3] = times[0];
    factors[4] = factors[2] + times[0] * factors[0] + times[1] * factors[1];
    return 0;
}

/* What is to be added to right, so that the stage solves M x = M right - (time D + time^2 K) x - time K shifts. */
static int stage_solution(const real *h, const real *factors, const real *right, const real *shifts, real *w)
{
    (void)h;
    w[0] = (factors[2] * right[0] - factors[3] * factors[1] * shifts[0]) / factors[4] - right[0];
    return 0;
}
