/* Linearly implicit steps of a rollout behind a kernel's arguments: (h, q, v, u, out), out being q and v after them; and
 * of many states, likewise.  A null out copies no result. */
#include <stddef.h>
#include <string.h>

typedef struct { /* as every generated header declares it for its robot */
    const double *u;
    size_t u_state, u_step;
    const double *kp, *kd, *target;
    size_t target_state, target_step;
    const double *effort;
} Drive;

typedef long long (*Rollout)(const double *h, const double *q, const double *v, const Drive *drive, double dt, size_t steps, size_t every, int method, double *q_out, double *v_out);

typedef long long (*Batch)(size_t count, const double *h, const double *q, size_t q_step, const double *v, size_t v_step, const Drive *drive, double dt, size_t steps, size_t every, int method, double *q_out, double *v_out);

enum { LARGEST = 64, STEPS = 10 };

typedef struct {
    Rollout rollout;
    const double *h;
    double dt;
    size_t n; /* at most LARGEST */
    Batch batch;
    double *q_out, *v_out; /* of all states of a batch, the beginning and the end of each */
} Peer;

int ours_step(const double *handle, const double *q, const double *v, const double *u, double *out)
{
    const Peer *p = (const Peer *)(const void *)handle;
    const Drive drive = { u, 0, 0, NULL, NULL, NULL, 0, 0, NULL };
    double q_out[2 * LARGEST], v_out[2 * LARGEST]; /* the beginning, the end */
    const long long failed = p->rollout(p->h, q, v, &drive, p->dt, STEPS, STEPS, 1, q_out, v_out);
    if (out) memcpy(out, q_out + p->n, p->n * sizeof(double));
    if (out) memcpy(out + p->n, v_out + p->n, p->n * sizeof(double));
    return failed >= 0;
}

long long ours_step_batch(size_t count, const double *handle, const double *q, size_t q_step, const double *v, size_t v_step, const double *u, size_t u_step, double *out)
{
    const Peer *p = (const Peer *)(const void *)handle;
    const Drive drive = { u, u_step, 0, NULL, NULL, NULL, 0, 0, NULL };
    const long long failed = p->batch(count, p->h, q, q_step, v, v_step, &drive, p->dt, STEPS, STEPS, 1, p->q_out, p->v_out);
    for (size_t i = 0; out && i < count; ++i) {
        memcpy(out + 2 * i * p->n, p->q_out + (2 * i + 1) * p->n, p->n * sizeof(double));
        memcpy(out + (2 * i + 1) * p->n, p->v_out + (2 * i + 1) * p->n, p->n * sizeof(double));
    }
    return failed;
}
