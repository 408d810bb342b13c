#include "controller.h"

#include "reference.h"

#include <eomgen/ur5_model_rigid.h>

#include <math.h>

int controller_start(controller *c, const double *y)
{
    const double parameters[UR5_MODEL_RIGID_PARAMETERS] = UR5_MODEL_RIGID_DEFAULTS;
    double q[STATES] = { 0.0 }, v[STATES] = { 0.0 }, series[SERIES * JOINTS], at[JOINTS], velocity[JOINTS];
    for (int i = 0; i < JOINTS; ++i) {
        q[motors[i]] = y[i];
        q[links[i]] = y[i] / ratio;
    }
    ur5_model_rigid_setup(parameters, c->h);
    ur5_model_observer_setup(&c->observer, q, v);
    ur5_model_feedforward_setup(&c->feedforward);
    c->sample = 0;
    reference(c->sample, series);
    return ur5_model_feedforward_step(&c->feedforward, series, at, velocity, c->u);
}

int controller_step(controller *c, const double *y)
{
    double held[STATES] = { 0.0 }, series[SERIES * JOINTS], at[JOINTS], velocity[JOINTS];
    double q[JOINTS], M[JOINTS * JOINTS], a[JOINTS];
    for (int i = 0; i < JOINTS; ++i) { held[motors[i]] = c->u[i]; }
    if (ur5_model_observer_update(&c->observer, y) < 0.0) { return UR5_MODEL_OBSERVER_NOT_FINITE; }
    int status = ur5_model_observer_predict(&c->observer, held);
    if (status != 0) { return status; }

    reference(++c->sample, series);
    status = ur5_model_feedforward_step(&c->feedforward, series, at, velocity, c->u);
    if (status != 0) { return status; }

    for (int i = 0; i < JOINTS; ++i) {
        const double error = at[i] - c->observer.q[motors[i]];
        const double slower = velocity[i] - c->observer.v[motors[i]];
        q[i] = c->observer.q[links[i]];
        a[i] = kp * error + kd * slower;
    }
    (void)ur5_model_rigid_mass_matrix(c->h, q, M);
    for (int i = 0; i < JOINTS; ++i) {
        for (int j = 0; j < JOINTS; ++j) { c->u[i] += M[JOINTS * i + j] * a[j] / (ratio * ratio); }
        c->u[i] = fmax(-torque[i], fmin(torque[i], c->u[i]));
    }
    return 0;
}
