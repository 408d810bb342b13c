/* lanes.c: what tests call of lanes.h. */
#include "lanes.h"

int width(void);
void pass_on(size_t count, const EOM_SCALAR *x, size_t x_step, int read, const unsigned short *place, int written, EOM_SCALAR *y, size_t y_step);
void whole(EOM_SCALAR x, EOM_SCALAR *y);
void by_numbers(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y);
void by_vectors(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y);
int vanished(int n, const EOM_SCALAR *pivot);
int vanished_in_lanes(int n, int statuses, const EOM_SCALAR *pivots);

int width(void) { return LANES; }

/* Read numbers of count states, LANES at a time, and write them, or those at place. */
void pass_on(size_t count, const EOM_SCALAR *x, size_t x_step, int read, const unsigned short *place, int written, EOM_SCALAR *y, size_t y_step)
{
    lanes numbers[64];
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = (count - i < LANES) ? (count - i) : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(&x[i * x_step], x_step, here, more, read, numbers);
        scatter(numbers, place, here, more, written, y_step, &y[i * y_step]);
    }
}

/* Put a number into all lanes. */
void whole(EOM_SCALAR x, EOM_SCALAR *y)
{
    lanes numbers[1];
    spread(1, &x, numbers);
    (void)memcpy(y, numbers, sizeof numbers);
}

#define EACH_FUNCTION(y, x, z, name) \
    (y)[0] = larger##name((x)[0], (x)[1]); \
    (y)[1] = positive##name((x)[0]); \
    (y)[2] = chosen##name((x)[0], (x)[1], z); \
    (y)[3] = root##name((x)[1]); \
    (y)[4] = bearing##name((x)[0], (x)[1]); \
    (y)[5] = exponential##name((x)[0])

/* Compute all functions, six, of pairs of numbers, one pair after the other. */
void by_numbers(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y)
{
    for (size_t i = 0; i < count; ++i) { EACH_FUNCTION(&y[6 * i], &x[2 * i], C(-7.0), ); }
}

/* The same, LANES pairs at a time. */
void by_vectors(size_t count, const EOM_SCALAR *x, EOM_SCALAR *y)
{
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = (count - i < LANES) ? (count - i) : LANES;
        lanes pair[2];
        lanes found[6];
        gather(&x[2 * i], 2, here, 0, 2, pair);
        EACH_FUNCTION(found, pair, ALL(C(-7.0)), _lanes);
        scatter(found, NULL, here, 0, 6, 6, &y[6 * i]);
    }
}

int vanished(int n, const EOM_SCALAR *pivot) { return singular(n, pivot); }

/* Look at the pivots of LANES states, (LANES, 2 n). */
int vanished_in_lanes(int n, int statuses, const EOM_SCALAR *pivots)
{
    lanes pivot[32];
    gather(pivots, 2 * (size_t)n, LANES, 0, 2 * n, pivot);
    return singular_lanes(n, statuses, pivot);
}
