/* explicit_methods.h: explicit methods, rows of coefficients for stages; EOM_C() makes numbers of the precision of
 * states. */

enum { EOM_EXPLICIT_STAGES = 6 };

/* An explicit method.  Behind the rows of its stages stands that of the step, which is the last stage with error
 * control. */
typedef struct {
    int stages; /* without the last one */
    EOM_SCALAR a[EOM_EXPLICIT_STAGES + 1][EOM_EXPLICIT_STAGES];
    EOM_SCALAR error[EOM_EXPLICIT_STAGES + 1];
    double shares[EOM_EXPLICIT_STAGES + 1];
} EOM(explicit_method);

#include "explicit_tableaus.h"
