/* The controller: encoders in, torques out, once a sample; double precision, no heap, no state but its own struct.
 *
 * Computed torque: u = u* + M(q) (kp (m* - m) + kd (m*' - m')) / ratio^2, with the motors' angles m* and torques u* by
 * the feed-forward of their elastic gears, the mass matrix M of the arm with rigid gears, and q, m, m' by a Kalman filter.
 * A torque acts one sample after the encoders that it follows from: the filter predicts the state of that time. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include "task.h"
#include "ur5_model_feedforward.h"
#include "ur5_model_observer.h"

#include <eomgen/ur5_model_rigid.h>

typedef struct {
    ur5_model_observer observer;       /* of both sides of the gears, from the encoders of the motors */
    ur5_model_feedforward feedforward; /* of the gears */
    double h[UR5_MODEL_RIGID_HOISTED]; /* of the arm with rigid gears */
    double u[JOINTS];                  /* N m, torques of the motors that act now */
    long sample;
} controller;

/* Begin at rest, near the beginning of the reference, with the motors at y (rad); c->u then holds the arm there.
 * Returns 0, or the status of the function that failed. */
int controller_start(controller *c, const double *y);

/* Take the motors' angles y (rad) at a sample, and put the torques into c->u that act from the next sample on. */
int controller_step(controller *c, const double *y);

#endif
