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

#if !defined(EOM_WITHOUT_LANES)
/* Work on `most` vectors at a time, of which `used` have states: READ_LANES(x, size, most) gathers those of x into x_lanes,
 * one vector's numbers behind the other's, after SPREAD(h, size) has put those of all states into h_lanes.  CALL sets status: by
 * ONE_VECTOR(statuses, function) for each, which finds x_lanes by VECTOR(x, size), or at once.  size results of each go from
 * out_lanes, which ROOM_LANES(size, most) declares, into out: by WRITE_LANES(size), or by WRITE_PLACES(size, place, different) where
 * number i of a result is number place[i] of what differs among them.  Memory is asked for results ahead of time where these are
 * too many for a cache. */
#define SPREAD(x, size) lanes x##_lanes[size]; spread(size, x, x##_lanes);
#define EACH_VECTOR for (size_t k = 0, at = state; k < used; ++k, at += LANES)
#define VECTOR(x, size) (&x##_lanes[k * (size)])
#define HERE ((count - at < LANES) ? (count - at) : LANES)
#define MORE ((count - at >= AHEAD + LANES) ? 1 : 0)
#define READ_LANES(x, size, most) \
    lanes x##_lanes[(most) * (size)]; \
    EACH_VECTOR { gather(&x[at * x##_step], x##_step, HERE, MORE, size, &x##_lanes[k * (size)]); }
#define ROOM_LANES(size, most) lanes out_lanes[(most) * (size)];
#define ONE_VECTOR(statuses, function) \
    EACH_VECTOR { \
        const int failed = function; \
        if ((failed != 0) && (status == 0)) { status = (int)(k * LANES) * (statuses) + failed; } \
    }
#define WRITE_LANES(size) EACH_VECTOR { scatter(&out_lanes[k * (size)], NULL, HERE, MORE, size, size, &out[at * (size)]); }
#define WRITE_PLACES(size, place, different) \
    EACH_VECTOR { scatter(&out_lanes[k * (different)], place, HERE, MORE && (count * sizeof *out > MANY / (size)), size, size, &out[at * (size)]); }
#define BY_LANES(statuses, most, GATHER, CALL, SCATTER) \
    for (size_t state = 0; state < count; state += (size_t)(most) * LANES) { \
        const size_t left = (count - state + LANES - 1) / LANES; \
        const size_t used = (((most) == 1) || (left > (size_t)(most))) ? (size_t)(most) : left; \
        int status = 0; \
        GATHER \
        CALL \
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
