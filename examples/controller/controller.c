#include "controller.h"

void controller_start(controller *c, const float *parameters, const float *kp, const float *kd, const float *from,
                      const float *to, float duration)
{
    puma560_setup(parameters, c->h);
    c->duration = duration;
    for (int i = 0; i < DOF; i++) {
        c->kp[i] = kp[i];
        c->kd[i] = kd[i];
        c->from[i] = from[i];
        c->distance[i] = to[i] - from[i];
    }
}

void controller_step(const controller *c, float t, const float *q, const float *v, float *u)
{
    const float x = (t < c->duration) ? (t / c->duration) : 1.0f;
    const float rate = 1.0f / c->duration;
    /* The polynomial of fifth order that starts and ends at rest, and its derivatives. */
    const float s = x * x * x * (10.0f + x * (6.0f * x - 15.0f));
    const float s_dot = 30.0f * x * x * (1.0f + x * (x - 2.0f)) * rate;
    const float s_ddot = 60.0f * x * (1.0f + x * (2.0f * x - 3.0f)) * rate * rate;
    float a[DOF];
    for (int i = 0; i < DOF; i++) {
        const float ahead = c->from[i] + s * c->distance[i] - q[i];
        const float faster = s_dot * c->distance[i] - v[i];
        a[i] = s_ddot * c->distance[i] + c->kd[i] * faster + c->kp[i] * ahead;
    }
    (void)puma560_inverse_dynamics(c->h, q, v, a, u);
}
