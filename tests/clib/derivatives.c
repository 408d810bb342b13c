/* derivatives.c: what tests call of acceleration_derivatives.h, of one state and of one in every lane. */
#include "lanes.h"

#include "state_one.h"
#include "acceleration_derivatives.h"
#include "state_lanes.h"
#include "acceleration_derivatives.h"

#define MOST 8 /* coordinates, and rows */

int tree(int n, const int *parent, const int *known, double *out);
int tree_in_lanes(int n, const int *parent, const int *known, size_t count, double *out);
int closed(int n, const int *parent, const int *known, const eom_constraint_rows *rows, const double *D, double *out);
int closed_in_lanes(int n, const int *parent, const int *known, const eom_constraint_rows *rows, int size, const double *D, double *out);

int tree(int n, const int *parent, const int *known, double *out)
{
    double M[MOST * MOST];
    double pivot[2 * MOST];
    eom_accelerations_by(n, parent, known, M, pivot, out);
    return eom_singular(n, pivot);
}

/* The same of up to EOM_LANES states, (count, 3, n, n). */
int tree_in_lanes(int n, const int *parent, const int *known, size_t count, double *out)
{
    lanes M[MOST * MOST];
    lanes pivot[2 * MOST];
    lanes all[3 * MOST * MOST];
    eom_gather(out, (size_t)(3 * n * n), count, 0, 3 * n * n, all);
    eom_accelerations_by_lanes(n, parent, known, M, pivot, all);
    eom_scatter(all, NULL, count, 0, 3 * n * n, (size_t)(3 * n * n), out);
    return eom_singular_lanes(n, 100, pivot);
}

int closed(int n, const int *parent, const int *known, const eom_constraint_rows *rows, const double *D, double *out)
{
    double M[MOST * MOST];
    double pivot[2 * MOST];
    double work[6][3 * MOST * MOST];
    double more[4][MOST];
    eom_closed_accelerations_by(n, parent, known, rows, D, M, pivot, work[0], work[1], work[2], work[3], more[0], more[1], more[2], more[3], out);
    return eom_singular(n, pivot);
}

/* The same of EOM_LANES states, D being (EOM_LANES, size). */
int closed_in_lanes(int n, const int *parent, const int *known, const eom_constraint_rows *rows, int size, const double *D, double *out)
{
    lanes M[MOST * MOST];
    lanes pivot[2 * MOST];
    lanes all[3 * MOST * MOST];
    lanes blocks[4 * MOST * MOST];
    lanes work[6][3 * MOST * MOST];
    lanes more[4][MOST];
    eom_gather(D, (size_t)size, EOM_LANES, 0, size, blocks);
    eom_gather(out, (size_t)(3 * n * n), EOM_LANES, 0, 3 * n * n, all);
    eom_closed_accelerations_by_lanes(n, parent, known, rows, blocks, M, pivot, work[0], work[1], work[2], work[3], more[0], more[1], more[2], more[3], all);
    eom_scatter(all, NULL, EOM_LANES, 0, 3 * n * n, (size_t)(3 * n * n), out);
    return eom_singular_lanes(n, 100, pivot);
}
