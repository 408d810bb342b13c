/* inputs.h: what is the same for one state and for many: methods, inputs over time and models of computed torque, or
 * with EOM_HELD none of these two: drives are held in steps. */
#ifndef EOM_INPUTS_H
#define EOM_INPUTS_H
#include "eom.h"

#include <math.h>
#include <string.h>

#include "precision.h"
#if defined(EOM_HELD)
#include "explicit_methods.h"
#else
#include "signals.h"
#include "methods.h"
#endif

#if !defined(EOM_WITHOUT_CHARTS)
#define EOM_ROTATION(name) eom_##name
#define EOM_ROTATION_SCALAR double
#define EOM_ROTATION_MATH(function) function
#include "rotations.h"
#if defined(EOM_SINGLE)
#undef EOM_ROTATION
#undef EOM_ROTATION_SCALAR
#undef EOM_ROTATION_MATH
#define EOM_ROTATION(name) eomf_##name
#define EOM_ROTATION_SCALAR float
#define EOM_ROTATION_MATH(function) function##f
#include "rotations.h"
#endif
#endif
#if !defined(EOM_HELD)
#include "computed_torque.h"
#endif

#endif
