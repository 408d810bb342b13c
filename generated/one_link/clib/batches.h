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

/* Read size numbers of LANES of count states from tiles; the last tile fills the lanes that are left. */
EOM_LOCAL void from_tiles(const EOM_SCALAR *restrict x, size_t state, size_t count, int size, lanes *restrict y)
{
    for (size_t l = 0; l < LANES; l += SHARE) {
        const size_t k = (l < count - state) ? (state + l) : (count - SHARE);
        const int more = (count - k > TILE) ? 1 : 0;
        const EOM_SCALAR *const from = &x[k / TILE * TILE * (size_t)size + k % TILE];
        for (int i = 0; i < size; ++i) {
            if (more != 0) { NEXT_TILE(&from[(size_t)i * TILE], size, 0) }
            (void)memcpy((EOM_SCALAR *)&y[i] + l, &from[(size_t)i * TILE], SHARE * sizeof *from);
        }
    }
}

/* Write size numbers of LANES of count states into tiles: number i of a state is x[place[i]], or x[i] without places. */
EOM_LOCAL void into_tiles(const lanes *restrict x, const unsigned short *restrict place, size_t state, size_t count, int size, EOM_SCALAR *restrict y)
{
    for (size_t l = 0; (l < LANES) && (l < count - state); l += SHARE) {
        const size_t k = state + l;
        const int more = (count - k > TILE) ? 1 : 0;
        EOM_SCALAR *const to = &y[k / TILE * TILE * (size_t)size + k % TILE];
        for (int i = 0; i < size; ++i) {
            if (more != 0) { NEXT_TILE(&to[(size_t)i * TILE], size, 1) }
            (void)memcpy(&to[(size_t)i * TILE], (const EOM_SCALAR *)&x[(place != NULL) ? place[i] : i] + l, SHARE * sizeof *to);
        }
    }
}

/* Call a function of LANES states at a time, x of which READ_LANES(x, size) brings into x_lanes, after SPREAD(h, size) has put
 * those of all states into h_lanes; size results go from out_lanes into out: WRITE_LANES(size), or WRITE_PLACES(size, place) where
 * number i of a result is number place[i] of what differs among them.  tiled: whether an argument is in tiles.  Memory is asked
 * for results ahead of time where these are too many for a cache. */
#define SPREAD(x, size) lanes x##_lanes[size]; spread(size, x, x##_lanes);
#define READ_LANES(x, size) \
    lanes x##_lanes[size]; \
    if (x##_step == TILES) { from_tiles(x, state, count, size, x##_lanes); } \
    else { gather(STATE(x), x##_step, here, more, size, x##_lanes); }
#define WRITE_LANES(size) \
    if (tiled) { into_tiles(out_lanes, NULL, state, count, size, out); } \
    else { scatter(out_lanes, NULL, here, more, size, size, RESULT(size)); }
#define WRITE_PLACES(size, place) \
    if (tiled) { into_tiles(out_lanes, place, state, count, size, out); } \
    else { scatter(out_lanes, place, here, (more != 0) && (count * sizeof *out > MANY / (size)), size, size, RESULT(size)); }
#define BY_LANES(statuses, IS_TILED, GATHER, size, CALL, SCATTER) \
    const int tiled = (IS_TILED) ? 1 : 0; \
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
