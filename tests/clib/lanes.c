/* lanes.c: what tests call of lanes.h. */
#include "lanes.h"

int width(void);
void pass_on(size_t count, const EOM_SCALAR *x, size_t x_step, int read, const unsigned short *place, int written, EOM_SCALAR *y, size_t y_step);
void whole(EOM_SCALAR x, EOM_SCALAR *y);
void by_numbers(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y);
void by_vectors(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y);
int vanished(int n, const EOM_SCALAR *pivot);
int vanished_in_lanes(int n, int statuses, const EOM_SCALAR *pivots);

int width(void) { return EOM_LANES; }

/* Read numbers of count states, EOM_LANES at a time, and write them, or those at place. */
void pass_on(size_t count, const EOM_SCALAR *x, size_t x_step, int read, const unsigned short *place, int written, EOM_SCALAR *y, size_t y_step)
{
    lanes numbers[64];
    for (size_t i = 0; i < count; i += EOM_LANES) {
        const size_t here = (count - i < EOM_LANES) ? (count - i) : EOM_LANES;
        const int more = count - i >= EOM_PREFETCH_STATES + EOM_LANES;
        eom_gather(&x[i * x_step], x_step, here, more, read, numbers);
        eom_scatter(numbers, place, here, more, written, y_step, &y[i * y_step]);
    }
}

/* Put a number into all lanes. */
void whole(EOM_SCALAR x, EOM_SCALAR *y)
{
    lanes numbers[1];
    eom_broadcast(1, &x, numbers);
    (void)memcpy(y, numbers, sizeof numbers);
}

#define EACH_FUNCTION(y, x, z, name) \
    (y)[0] = eom_max##name((x)[0], (x)[1]); \
    (y)[1] = eom_heaviside##name((x)[0]); \
    (y)[2] = eom_select##name((x)[0], (x)[1], z); \
    (y)[3] = eom_sqrt##name((x)[1]); \
    (y)[4] = eom_atan2##name((x)[0], (x)[1]); \
    (y)[5] = eom_exp##name((x)[0])

/* Compute all functions, six, of pairs of numbers, one pair after the other. */
void by_numbers(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y)
{
    for (size_t i = 0; i < count; ++i) { EACH_FUNCTION(&y[6 * i], &x[2 * i], EOM_C(-7.0), ); }
}

/* The same, EOM_LANES pairs at a time. */
void by_vectors(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y)
{
    for (size_t i = 0; i < count; i += EOM_LANES) {
        const size_t here = (count - i < EOM_LANES) ? (count - i) : EOM_LANES;
        lanes pair[2];
        lanes found[6];
        eom_gather(&x[2 * i], 2, here, 0, 2, pair);
        EACH_FUNCTION(found, pair, EOM_ALL_LANES(EOM_C(-7.0)), _lanes);
        eom_scatter(found, NULL, here, 0, 6, 6, &y[6 * i]);
    }
}

int vanished(int n, const EOM_SCALAR *pivot) { return eom_singular(n, pivot); }

/* Look at the pivots of EOM_LANES states, (EOM_LANES, 2 n). */
int vanished_in_lanes(int n, int statuses, const EOM_SCALAR *pivots)
{
    lanes pivot[32];
    eom_gather(pivots, 2 * (size_t)n, EOM_LANES, 0, 2 * n, pivot);
    return eom_singular_lanes(n, statuses, pivot);
}
