/* The reference trajectory: from rest to rest by polynomials of degree nine, there and back, again and again. */
#ifndef REFERENCE_H
#define REFERENCE_H

#include "task.h"

enum { SERIES = 5 }; /* positions, velocities, accelerations, jerks, snaps: torques behind springs follow the snap */

/* Write the joints' series, (SERIES, JOINTS), at a sample. */
void reference(long sample, double *series);

#endif
