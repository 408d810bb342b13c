/* batches.h: bodies of functions of many states, NAME(count, h, x, x_step, ..., out): number i of state k is x[k *
 * x_step + i], out holds results one after the other, and the value is -1, or state * statuses + i of the first
 * failure. */
#ifndef EOM_BATCHES_H
#define EOM_BATCHES_H

/* Call a function of one state after the other; EOM_STATE(x) is where the numbers of this one are, EOM_RESULT(size)
 * where its go. */
#define EOM_STATE(x) (&(x)[state * x##_step])
#define EOM_RESULT(size) (&out[state * (size_t)(size)])
#define EOM_ONE_BY_ONE(statuses, CALL) \
    for (size_t state = 0; state < count; ++state) { \
        const int status = CALL; \
        if (status != 0) { return (long long)state * (statuses) + status - 1; } \
    } \
    return -1;

#if !defined(EOM_WITHOUT_LANES)
/* Work on `most` vectors at a time, of which `used` have states: EOM_READ_LANES(x, size, most) gathers those of x into
 * x_lanes, one vector's numbers behind the other's, after EOM_SPREAD(h, size) has put those of all states into h_lanes.
 * CALL sets status: by EOM_ONE_VECTOR(statuses, function) for each, which finds x_lanes by EOM_VECTOR(x, size), or at
 * once.  size results of each go from out_lanes, which EOM_ROOM_LANES(size, most) declares, into out: by
 * EOM_WRITE_LANES(size), or by EOM_WRITE_PLACES(size, place, different) where number i of a result is number place[i]
 * of what differs among them.  Memory is asked for results ahead of time where these are too many for a cache. */
#define EOM_SPREAD(x, size) lanes x##_lanes[size]; eom_broadcast(size, x, x##_lanes);
#define EOM_EACH_VECTOR for (size_t k = 0, at = state; k < used; ++k, at += EOM_LANES)
#define EOM_VECTOR(x, size) (&x##_lanes[k * (size)])
#define EOM_STATES_HERE ((count - at < EOM_LANES) ? (count - at) : EOM_LANES)
#define EOM_HAS_MORE ((count - at >= EOM_PREFETCH_STATES + EOM_LANES) ? 1 : 0)
#define EOM_READ_LANES(x, size, most) \
    lanes x##_lanes[(most) * (size)]; \
    EOM_EACH_VECTOR { \
        eom_gather(&x[at * x##_step], x##_step, EOM_STATES_HERE, EOM_HAS_MORE, size, &x##_lanes[k * (size)]); \
    }
#define EOM_ROOM_LANES(size, most) lanes out_lanes[(most) * (size)];
#define EOM_ONE_VECTOR(statuses, function) \
    EOM_EACH_VECTOR { \
        const int failed = function; \
        if ((failed != 0) && (status == 0)) { status = (int)(k * EOM_LANES) * (statuses) + failed; } \
    }
#define EOM_WRITE_LANES(size) \
    EOM_EACH_VECTOR { \
        eom_scatter(&out_lanes[k * (size)], NULL, EOM_STATES_HERE, EOM_HAS_MORE, size, size, &out[at * (size)]); \
    }
#define EOM_WRITE_PLACES(size, place, different) \
    EOM_EACH_VECTOR { \
        eom_scatter(&out_lanes[k * (different)], place, EOM_STATES_HERE, \
                EOM_HAS_MORE && (count * sizeof *out > EOM_CACHE_BYTES / (size)), size, size, &out[at * (size)]); \
    }
#define EOM_BY_LANES(statuses, most, GATHER, CALL, SCATTER) \
    for (size_t state = 0; state < count; state += (size_t)(most) * EOM_LANES) { \
        const size_t left = (count - state + EOM_LANES - 1) / EOM_LANES; \
        const size_t used = (((most) == 1) || (left > (size_t)(most))) ? (size_t)(most) : left; \
        int status = 0; \
        GATHER \
        CALL \
        SCATTER \
        if (status != 0) { return (long long)state * (statuses) + status - 1; } \
    } \
    return -1;

/* Write size numbers each from its place among those that differ. */
EOM_INLINE void eom_unpack(int size, const unsigned short *restrict place, const lanes *restrict different,
        lanes *restrict out)
{
    for (int i = 0; i < size; ++i) { out[i] = different[place[i]]; }
}
#endif
#endif
