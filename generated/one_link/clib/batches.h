/* batches.h: bodies of functions of many states, NAME(count, h, x, x_step, ..., out): number i of state k is x[k * x_step + i], out
 * holds results one after the other, and the value is -1, or state * statuses + i of the first failure. */
#ifndef EOM_BATCHES_H
#define EOM_BATCHES_H

/* Call a function of one state after the other; STATE(x) is where the numbers of this one are, RESULT(size) where its go. */
#define STATE(x) (&(x)[state * x##_step])
#define RESULT(size) (&out[state * (size_t)(size)])
#define ONE_BY_ONE(statuses, CALL) \
    for (size_t state = 0; state < count; ++state) { \
        const int status = CALL; \
        if (status != 0) { return (long long)state * (statuses) + status - 1; } \
    } \
    return -1;

#if !defined(EOMGEN_SINGLES_ONLY)
/* Call a function of LANES states at a time, x of which READ_LANES(x, size) brings into x_lanes, after SPREAD(h, size) has put
 * those of all states into h_lanes; size results go from out_lanes into out: WRITE_LANES(size), or WRITE_PLACES(size, place) where
 * number i of a result is number place[i] of what differs among them.  Memory is asked for results ahead of time where these are
 * too many for a cache. */
#define SPREAD(x, size) lanes x##_lanes[size]; spread(size, x, x##_lanes);
#define READ_LANES(x, size) lanes x##_lanes[size]; gather(STATE(x), x##_step, here, more, size, x##_lanes);
#define WRITE_LANES(size) scatter(out_lanes, NULL, here, more, size, size, RESULT(size));
#define WRITE_PLACES(size, place) scatter(out_lanes, place, here, (more != 0) && (count * sizeof *out > MANY / (size)), size, size, RESULT(size));
#define BY_LANES(statuses, GATHER, size, CALL, SCATTER) \
    for (size_t state = 0; state < count; state += LANES) { \
        const size_t here = (count - state < LANES) ? (count - state) : LANES; \
        const int more = (count - state >= AHEAD + LANES) ? 1 : 0; \
        lanes out_lanes[size]; \
        GATHER \
        const int status = CALL; \
        SCATTER \
        if (status != 0) { return (long long)state * (statuses) + status - 1; } \
    } \
    return -1;

/* Write size numbers each from its place among those that differ. */
EOM_INLINE void unpack(int size, const unsigned short *restrict place, const lanes *restrict different, lanes *restrict out)
{
    for (int i = 0; i < size; ++i) { out[i] = different[place[i]]; }
}
#endif
#endif
