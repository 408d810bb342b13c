/* Computed torque for an arm: u = M(q) (a* + kd (v* - v) + kp (q* - q)) + bias - Q, in float, without a board. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include "puma560.h"

enum { DOF = PUMA560_DOF, HOISTED = (PUMA560_HOISTED > 0) ? PUMA560_HOISTED : 1 };

typedef struct {
    float h[HOISTED];     /* the kernel's parameters, prepared */
    float kp[DOF];        /* 1/s^2 */
    float kd[DOF];        /* 1/s */
    float from[DOF];      /* rad: at rest at time 0 */
    float distance[DOF];  /* rad: until at rest at the end */
    float duration;       /* s */
} controller;

/* From what task.h holds; parameters as puma560.h lists them. */
void controller_start(controller *c, const float *parameters, const float *kp, const float *kd, const float *from,
                      const float *to, float duration);

/* Drives u (N m) at time t (s) for the measured positions q (rad) and velocities v (rad/s). */
void controller_step(const controller *c, float t, const float *q, const float *v, float *u);

#endif
