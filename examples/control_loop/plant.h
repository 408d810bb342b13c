/* The plant: a simulated UR5 with elastic gears, with more friction than its model has, and encoders on the motors. */
#ifndef PLANT_H
#define PLANT_H

#include "task.h"

#include <eomgen/ur5_plant.h>

typedef struct {
    double h[UR5_PLANT_HOISTED];
    double q[STATES]; /* rad */
    double v[STATES]; /* rad/s */
    uint64_t noise;   /* state of the generator */
} plant;

/* Begin at rest, off the beginning of the reference, with gears that carry nothing yet. */
void plant_start(plant *arm);

/* Read the encoders: angles of the motors with noise, in ticks. */
void plant_read(plant *arm, double *y);

/* Go on by a sample under torques u of the motors (N m).  Returns whether that succeeded. */
int plant_step(plant *arm, const double *u);

#endif
