/* steps.h: all that takes steps, of one state or of one in every lane; integrate.c and integrate_lanes.c say how states
 * are read and written. */
#include "combinations.h"
#if !defined(EOM_WITHOUT_CHARTS)
#include "charts.h"
#endif
#if !defined(EOM_WITHOUT_LOOPS)
#include "closed_loops.h"
#endif
#include "forces.h"
#if !defined(EOM_HELD)
#include "input_forces.h"
#endif
#include "fixed_steps.h"
#if !defined(EOM_FIXED_ONLY)
#include "adaptive_steps.h"
#if defined(EOM_HAS_RADAU)
#include "radau.h"
#endif
#include "adaptive_rollouts.h"
#endif
