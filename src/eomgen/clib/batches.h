/* batches.h: bodies of functions of many states, NAME(count, h, x, x_step, ..., out): number i of state k is x[k * x_step + i], out
 * holds results one after the other, and the value is -1, or state * statuses + i of the first failure.  Functions of LANES states
 * at a time take tiles as well, see TILES. */
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
/* A step that stands for tiles, (count / TILE, size, TILE): number i of state k is x[(k / TILE * size + i) * TILE + k % TILE].  A tile
 * has the same width on all processors, a line of memory for each number of its states; count is a multiple of it, and out is in
 * tiles where an argument is. */
#define TILES ((size_t)-1)
#define TILE ((size_t)LINE)
#define SHARE (LANES < TILE ? LANES : TILE) /* numbers that a vector takes of one tile */

/* Ask memory for a line of the next tile, to read or to write it: it comes while this one is computed. */
#if defined(__GNUC__)
#define NEXT_TILE(x, size, writes) __builtin_prefetch(&(x)[(size_t)(size) * TILE], writes, 3);
#else
#define NEXT_TILE(x, size, writes)
#endif

/* Vectors that are taken at once: those of a whole tile, and at least so many. */
#define VECTORS(least) ((least) * LANES > TILE ? (size_t)(least) : TILE / LANES)

/* Read size numbers of so many vectors of count states from tiles, one vector behind the other; the last tile fills the lanes that
 * are left. */
EOM_LOCAL void from_tiles(const EOM_SCALAR *restrict x, size_t state, size_t count, size_t vectors, int size, lanes *restrict y)
{
    for (size_t l = 0; l < vectors * LANES; l += TILE) {
        const size_t k = (l < count - state) ? (state + l) : (count - TILE);
        const int more = (count - k > TILE) ? 1 : 0;
        const EOM_SCALAR *const tile = &x[k * (size_t)size];
        for (size_t i = 0; i < (size_t)size; ++i) {
            if (more != 0) { NEXT_TILE(&tile[i * TILE], size, 0) }
            for (size_t j = 0; j < TILE; j += SHARE) {
                const size_t vector = (l + j) / LANES;
                EOM_SCALAR *const to = (EOM_SCALAR *)&y[vector * (size_t)size + i];
                (void)memcpy(&to[l + j - vector * LANES], &tile[i * TILE + j], SHARE * sizeof *to);
            }
        }
    }
}

/* Write size numbers of so many vectors into tiles: number i of a state is x[place[i]], or x[i] without places, of different ones. */
EOM_LOCAL void into_tiles(const lanes *restrict x, const unsigned short *restrict place, int different, size_t state, size_t count, size_t vectors, int size, EOM_SCALAR *restrict y)
{
    for (size_t l = 0; (l < vectors * LANES) && (l < count - state); l += TILE) {
        const size_t k = state + l;
        const int more = (count - k > TILE) ? 1 : 0;
        EOM_SCALAR *const tile = &y[k * (size_t)size];
        for (size_t i = 0; i < (size_t)size; ++i) {
            if (more != 0) { NEXT_TILE(&tile[i * TILE], size, 1) }
            for (size_t j = 0; j < TILE; j += SHARE) {
                const size_t vector = (l + j) / LANES;
                const EOM_SCALAR *const from = (const EOM_SCALAR *)&x[vector * (size_t)different + ((place != NULL) ? place[i] : i)];
                (void)memcpy(&tile[i * TILE + j], &from[l + j - vector * LANES], SHARE * sizeof *from);
            }
        }
    }
}

/* Whether tiles of x are vectors as they lie: as wide, and where vectors may stand. */
#define STRAIGHT(x) ((LANES == TILE) && ((size_t)(x) % sizeof(lanes) == 0U))
#define AT_ONCE 1024 /* numbers of a result that are written where they belong; memory would keep the vectors of more waiting */

/* Work on at least so many vectors at a time, used of which have states: READ_LANES(x, size, least) brings those of x into x_lanes, one
 * vector's numbers behind the other's, after SPREAD(h, size) has put those of all states into h_lanes.  CALL sets status: by
 * ONE_VECTOR(statuses, function) for each, which finds x_lanes by VECTOR(x, size), or at once.  size results of each go from
 * out_lanes into out: with ROOM_LANES(size, least) by WRITE_LANES(size), or with ROOM_PLACES(different, least) by WRITE_PLACES(size,
 * place, different) where number i of a result is number place[i] of what differs among them.  tiled: whether an argument is in
 * tiles; where these are vectors as they lie, nothing is moved but what is so small that it stays in registers.  Memory is asked for
 * results ahead of time where these are too many for a cache. */
#define SPREAD(x, size) lanes x##_lanes[size]; spread(size, x, x##_lanes);
#define EACH_VECTOR for (size_t k = 0, at = state; k < used; ++k, at += LANES)
#define VECTOR(x, size) (&x##_lanes[k * (size)])
#define HERE ((count - at < LANES) ? (count - at) : LANES)
#define MORE ((count - at >= AHEAD + LANES) ? 1 : 0)
#define READ_LANES(x, size, least) \
    lanes x##_room[VECTORS(least) * (size)]; \
    const lanes *x##_lanes = x##_room; \
    if (x##_step != TILES) { EACH_VECTOR { gather(&x[at * x##_step], x##_step, HERE, MORE, size, &x##_room[k * (size)]); } } \
    else if (((size) >= LANES) && STRAIGHT(x)) { x##_lanes = (const lanes *)&x[state * (size)]; } \
    else { from_tiles(x, state, count, used, size, x##_room); }
#define ROOM_LANES(size, least) \
    lanes out_room[VECTORS(least) * (size)]; \
    lanes *const out_lanes = (tiled && ((size) <= AT_ONCE) && STRAIGHT(out)) ? (lanes *)&out[state * (size)] : out_room;
#define ROOM_PLACES(different, least) lanes out_lanes[VECTORS(least) * (different)];
#define ONE_VECTOR(statuses, function) \
    EACH_VECTOR { \
        const int failed = function; \
        if ((failed != 0) && (status == 0)) { status = (int)(k * LANES) * (statuses) + failed; } \
    }
#define WRITE_LANES(size) \
    if (!tiled) { EACH_VECTOR { scatter(&out_lanes[k * (size)], NULL, HERE, MORE, size, size, &out[at * (size)]); } } \
    else if (out_lanes == out_room) { into_tiles(out_lanes, NULL, size, state, count, used, size, out); }
#define WRITE_PLACES(size, place, different) \
    if (tiled) { into_tiles(out_lanes, place, different, state, count, used, size, out); } \
    else { EACH_VECTOR { scatter(&out_lanes[k * (different)], place, HERE, MORE && (count * sizeof *out > MANY / (size)), size, size, &out[at * (size)]); } }
/* Written twice where tiles are wider than vectors: rows are taken vector by vector. */
#define BLOCKS(statuses, most, GATHER, CALL, SCATTER) \
    for (size_t state = 0; state < count; state += (most) * LANES) { \
        const size_t left = (count - state + LANES - 1) / LANES; \
        const size_t used = (((most) == 1U) || (left > (most))) ? (most) : left; \
        int status = 0; \
        GATHER \
        CALL \
        SCATTER \
        if (status != 0) { return (long long)state * (statuses) + status - 1; } \
    }
#define BY_LANES(statuses, least, IS_TILED, GATHER, CALL, SCATTER) \
    const int tiled = (IS_TILED) ? 1 : 0; \
    if ((VECTORS(least) == (least)) || !tiled) { BLOCKS(statuses, (size_t)(least), GATHER, CALL, SCATTER) } \
    else { BLOCKS(statuses, VECTORS(least), GATHER, CALL, SCATTER) } \
    return -1;

/* Write size numbers each from its place among those that differ. */
EOM_INLINE void unpack(int size, const unsigned short *restrict place, const lanes *restrict different, lanes *restrict out)
{
    for (int i = 0; i < size; ++i) { out[i] = different[place[i]]; }
}
#endif
#endif
