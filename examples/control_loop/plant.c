#include "plant.h"

#include <eomgen/ur5_plant.h>

#include <math.h>
#include <string.h>

void plant_start(plant *arm)
{
    const double parameters[UR5_PLANT_PARAMETERS] = UR5_PLANT_DEFAULTS;
    ur5_plant_setup(parameters, arm->h);
    (void)memset(arm->v, 0, sizeof arm->v);
    for (int i = 0; i < JOINTS; ++i) {
        arm->q[links[i]] = from[i] + off;
        arm->q[motors[i]] = ratio * arm->q[links[i]];
    }
    arm->noise = seed;
}

static double uniform(plant *arm)
{
    arm->noise = factor * arm->noise + summand;
    return (double)(arm->noise >> 11) * 0x1p-53;
}

void plant_read(plant *arm, double *y)
{
    for (int i = 0; i < JOINTS; ++i) {
        const double first = uniform(arm);
        y[i] = tick * floor(arm->q[motors[i]] / tick + (first + uniform(arm)) - 0.5);
    }
}

int plant_step(plant *arm, const double *u)
{
    double held[STATES] = { 0.0 }, q[2 * STATES], v[2 * STATES];
    const ur5_plant_drive drive = { .u = held };
    for (int i = 0; i < JOINTS; ++i) { held[motors[i]] = u[i]; }
    /* linearly implicit steps: the gears' dampers are stiff */
    if (ur5_plant_rollout(arm->h, arm->q, arm->v, &drive, substep, SUBSTEPS, SUBSTEPS, 1, q, v) >= 0) { return 0; }
    (void)memcpy(arm->q, &q[STATES], sizeof arm->q);
    (void)memcpy(arm->v, &v[STATES], sizeof arm->v);
    return 1;
}
