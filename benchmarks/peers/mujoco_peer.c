/* MuJoCo behind functions with a kernel's arguments: (h, arrays..., out), h being what mujoco_peer_load returns.
 *
 * Each call sets the state (a copy of some numbers) and runs MuJoCo's own pipeline; a null out copies no result. */
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    mjModel *model;
    mjData *data;
} Peer;

/* The model in an MJCF file, or null with what MuJoCo says in error (of 1000 characters). */
void *mujoco_peer_load(const char *path, char *error)
{
    mjModel *model = mj_loadXML(path, NULL, error, 1000);
    if (!model) return NULL;
    Peer *peer = malloc(sizeof *peer);
    if (!peer) return NULL;
    peer->model = model;
    peer->data = mj_makeData(model);
    return peer;
}

static const Peer *set(const double *h, const double *q, const double *v)
{
    const Peer *p = (const Peer *)(const void *)h;
    const size_t size = (size_t)p->model->nv * sizeof(double);
    memcpy(p->data->qpos, q, size);
    memcpy(p->data->qvel, v, size);
    return p;
}

static int done(const Peer *p, const double *first, const double *second, double *out)
{
    const size_t n = (size_t)p->model->nv;
    if (out) memcpy(out, first, n * sizeof(double));
    if (out && second) memcpy(out + n, second, n * sizeof(double));
    return 0;
}

int mujoco_inverse_dynamics(const double *h, const double *q, const double *v, const double *a, double *out)
{
    const Peer *p = set(h, q, v);
    memcpy(p->data->qacc, a, (size_t)p->model->nv * sizeof(double));
    mj_inverse(p->model, p->data);
    return done(p, p->data->qfrc_inverse, NULL, out);
}

int mujoco_forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *out)
{
    const Peer *p = set(h, q, v);
    memcpy(p->data->qfrc_applied, u, (size_t)p->model->nv * sizeof(double));
    mj_forward(p->model, p->data);
    return done(p, p->data->qacc, NULL, out);
}

enum { STEPS = 10 };

/* Steps of the model's own integrator and length; q and v after them. */
int mujoco_step(const double *h, const double *q, const double *v, const double *u, double *out)
{
    const Peer *p = set(h, q, v);
    memcpy(p->data->qfrc_applied, u, (size_t)p->model->nv * sizeof(double));
    for (int step = 0; step < STEPS; ++step) mj_step(p->model, p->data);
    return done(p, p->data->qpos, p->data->qvel, out);
}

static void quiet(const char *said)
{
    (void)said; /* MuJoCo would write a file about steps that are too long */
}

/* Steps of dt under the drives u from a state of rest of everything else; q of every one of so many, the beginning first,
 * into q_out.  The number of steps, or of those before what is not finite. */
long long mujoco_rollout(const double *h, double dt, long long steps, long long every, const double *q, const double *v, const double *u, double *q_out)
{
    const Peer *p = (const Peer *)(const void *)h;
    const size_t n = (size_t)p->model->nv, size = n * sizeof(double);
    p->model->opt.timestep = dt;
    p->model->opt.disableflags |= mjDSBL_AUTORESET; /* what diverges is seen, and not begun again */
    mju_user_warning = quiet;
    mj_resetData(p->model, p->data);
    set(h, q, v);
    memcpy(p->data->qfrc_applied, u, size);
    memcpy(q_out, q, size);
    for (long long step = 1; step <= steps; ++step) {
        mj_step(p->model, p->data);
        for (size_t i = 0; i < n; ++i) {
            if (!(p->data->qpos[i] > -1e10 && p->data->qpos[i] < 1e10)) return step - 1;
        }
        if (step % every == 0) memcpy(q_out + (size_t)(step / every) * n, p->data->qpos, size);
    }
    return steps;
}

/* The gradient of w . q after so many steps of dt under drives by row, as users of mjd_transitionFD get it: transition
 * matrices by finite differences in every step, and back through them.  (q0, v0, u of all steps) into out; the work is
 * 4 n^2 + 2 n^2 numbers for every step and 2 n more.  Motors must be the model's only actuators, one per coordinate. */
void mujoco_gradient(const double *h, double dt, long long steps, double eps, int centered, const double *q, const double *v, const double *u, const double *w, double *work, double *out)
{
    const Peer *p = (const Peer *)(const void *)h;
    const size_t n = (size_t)p->model->nv, size = n * sizeof(double), of_step = 6 * n * n;
    double *by = work + (size_t)steps * of_step;
    p->model->opt.timestep = dt;
    p->model->opt.disableflags |= mjDSBL_AUTORESET;
    mju_user_warning = quiet;
    mj_resetData(p->model, p->data);
    set(h, q, v);
    for (long long step = 0; step < steps; ++step) {
        double *by_state = work + (size_t)step * of_step, *by_drive = by_state + 4 * n * n;
        memcpy(p->data->ctrl, u + (size_t)step * n, size);
        mjd_transitionFD(p->model, p->data, eps, (mjtByte)centered, by_state, by_drive, NULL, NULL);
        mj_step(p->model, p->data);
    }
    memcpy(out, w, size);
    memset(out + n, 0, size);
    for (long long step = steps - 1; step >= 0; --step) {
        const double *by_state = work + (size_t)step * of_step, *by_drive = by_state + 4 * n * n;
        mju_mulMatTVec(out + (2 + (size_t)step) * n, by_drive, out, (int)(2 * n), (int)n);
        memcpy(by, out, 2 * size);
        mju_mulMatTVec(out, by_state, by, (int)(2 * n), (int)(2 * n));
    }
}
