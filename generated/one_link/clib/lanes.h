/* lanes.h: several states at a time, one in every lane of a vector of the compiler: types, arithmetic that C has no operators for,
 * and how states come into vectors and out.  Of one precision, as precision.h says.
 *
 * EOMGEN_VECTOR: bytes of a vector, 0 for none; by default the widest of the processor, but for functions of one state
 * (EOM_WITHOUT_LANES), whose few angles fill no wide one.
 * EOM_LIBM: sines and cosines are those of the C library. */
#ifndef EOM_LANES_H
#define EOM_LANES_H
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "precision.h"

#if !defined(EOMGEN_VECTOR)
#if defined(__GNUC__) && defined(__AVX512F__) && !defined(EOM_WITHOUT_LANES)
#define EOMGEN_VECTOR 64
#elif defined(__GNUC__) && defined(__AVX__)
#define EOMGEN_VECTOR 32
#elif defined(__GNUC__) && (defined(__SSE2__) || defined(__ARM_NEON))
#define EOMGEN_VECTOR 16
#else
#define EOMGEN_VECTOR 0
#endif
#endif

#if defined(EOM_SINGLE)
#define EOM_BITS int
#define EOM_BYTES 4
#else
#define EOM_BITS long long
#define EOM_BYTES 8
#endif
#if (EOMGEN_VECTOR == 0) || (EOMGEN_VECTOR == EOM_BYTES)
#define LANES 1
#elif EOMGEN_VECTOR == 2 * EOM_BYTES
#define LANES 2
#elif EOMGEN_VECTOR == 4 * EOM_BYTES
#define LANES 4
#elif EOMGEN_VECTOR == 8 * EOM_BYTES
#define LANES 8
#elif EOMGEN_VECTOR == 16 * EOM_BYTES
#define LANES 16
#else
#error "EOMGEN_VECTOR: bytes of a vector of 1, 2, 4, 8 or 16 numbers; or 0"
#endif

/* Names of functions that other files call: what lanes of one number do is not what those of another do. */
#define EOM_WIDE(name) EOM_WIDE_OF(name, LANES)
#define EOM_WIDE_OF(name, width) EOM_JOINED(name, width)
#define EOM_JOINED(name, width) EOM(name##_x##width)

#if EOMGEN_VECTOR
typedef EOM_SCALAR lanes __attribute__((vector_size(EOMGEN_VECTOR)));
typedef EOM_BITS bits __attribute__((vector_size(EOMGEN_VECTOR)));
#define LANE(x, l) ((x)[l])
#define ALL(x) ((x) - (lanes){ C(0.0) })
#else
typedef EOM_SCALAR lanes;
#define LANE(x, l) (x)
#define ALL(x) (x)
#endif
#define PADDED(count) (((count) + LANES - 1) / LANES * LANES)

#include "operations.h"
#define SIGN (8 * EOM_BYTES - 2) /* from bit 1 to the sign */

/* Take sines and cosines of count angles, a multiple of LANES, within 2.5 units in the last place.  The nearest multiple of pi/2
 * is taken off in parts, products of all but the last exact, and the rest r goes with z = r^2 into the polynomials of fdlibm (Sun
 * Microsystems 1993), or in single precision of the Cephes library (S. L. Moshier): r + r z SINE(z), 1 - z (1/2 - z COSINE(z)).
 * Angles farther than FARTHEST are left to the C library; with EOM_LIBM all are.  Bits are the same with vectors and without. */
EOM_LOCAL void turn(const EOM_SCALAR *restrict angle, size_t count, EOM_SCALAR *restrict sine, EOM_SCALAR *restrict cosine)
{
#if EOMGEN_VECTOR && !defined(EOM_LIBM)
    bits far = { 0 };
    EOM_BITS any = 0;
    for (size_t i = 0; i < count; i += LANES) {
        lanes x;
        (void)memcpy(&x, &angle[i], sizeof x);
        far |= (bits)(x > FARTHEST) | (bits)(x < -FARTHEST);
        const lanes shifted = x*QUARTERS + SHIFT;
        const lanes quarters = shifted - SHIFT;
        const lanes r = REST(x, quarters);
        const lanes z = r*r;
        const lanes s = r + r*z*SINE(z);
        const lanes c = C(1.0) - z*(C(0.5) - z*COSINE(z));
        const bits quarter = (bits)shifted;
        const bits odd = (bits)((quarter & 1) != 0);
        const bits s_bits = (odd & (bits)c) | (~odd & (bits)s);
        const bits c_bits = (odd & (bits)s) | (~odd & (bits)c);
        const bits s_signed = s_bits ^ ((quarter & 2) << SIGN);
        const bits c_signed = c_bits ^ (((quarter + 1) & 2) << SIGN);
        (void)memcpy(&sine[i], &s_signed, sizeof s_signed);
        (void)memcpy(&cosine[i], &c_signed, sizeof c_signed);
    }
    for (int l = 0; l < LANES; ++l) { any |= far[l]; }
    if (any == 0) { return; }
#endif
    for (size_t i = 0; i < count; ++i) {
#if !defined(EOM_LIBM)
        if ((angle[i] <= FARTHEST) && (angle[i] >= -FARTHEST)) {
#if !EOMGEN_VECTOR
            const EOM_SCALAR shifted = angle[i]*QUARTERS + SHIFT;
            const EOM_SCALAR quarters = shifted - SHIFT;
            const EOM_SCALAR r = REST(angle[i], quarters);
            const EOM_SCALAR z = r*r;
            const EOM_SCALAR s = r + r*z*SINE(z);
            const EOM_SCALAR c = C(1.0) - z*(C(0.5) - z*COSINE(z));
            EOM_BITS quarter;
            (void)memcpy(&quarter, &shifted, sizeof quarter);
            const int fourth = (int)(quarter & 3);
            const EOM_SCALAR across = ((fourth & 1) != 0) ? s : c;
            const EOM_SCALAR along = ((fourth & 1) != 0) ? c : s;
            sine[i] = ((fourth & 2) != 0) ? -along : along;
            cosine[i] = (((fourth + 1) & 2) != 0) ? -across : across;
#endif
            continue;
        }
#endif
        sine[i] = EOM_MATH(sin)(angle[i]);
        cosine[i] = EOM_MATH(cos)(angle[i]);
    }
}
#undef FARTHEST
#undef QUARTERS
#undef SHIFT
#undef SIGN
#undef REST
#undef SINE
#undef COSINE

/* Declare sine and cosine of so many angles, and take them: of numbers, of vectors, and of vectors that stand side by side. */
#define TURN(count, ...) \
    const EOM_SCALAR angle[PADDED(count)] = { __VA_ARGS__ }; \
    EOM_SCALAR sine[PADDED(count)]; \
    EOM_SCALAR cosine[PADDED(count)]; \
    turn(angle, PADDED(count), sine, cosine)
#define TURN_LANES(count, ...) \
    const lanes angle[count] = { __VA_ARGS__ }; \
    TURN_AT(count, angle)
#define TURN_AT(count, place) \
    lanes sine[count]; \
    lanes cosine[count]; \
    turn((const EOM_SCALAR *)(place), (count) * LANES, (EOM_SCALAR *)sine, (EOM_SCALAR *)cosine)

/* Tell whether a gate is greater than 0, of lanes any of them. */
EOM_INLINE int beyond(EOM_SCALAR gate) { return (gate > C(0.0)) ? 1 : 0; }
EOM_INLINE int beyond_lanes(lanes gate)
{
    for (int l = 0; l < LANES; ++l) {
        if (LANE(gate, l) > C(0.0)) { return 1; }
    }
    return 0;
}

/* Return 0, or 1 + i for the first of n coordinates whose pivot vanishes beside its scale, which stands behind it; what is no number
 * has vanished. */
EOM_LOCAL int singular(int n, const EOM_SCALAR *restrict pivot)
{
    for (int i = 0; i < n; ++i) {
        if (!(pivot[2 * i] > EOM_VANISHED * pivot[2 * i + 1])) { return 1 + i; }
    }
    return 0;
}

#if !defined(EOM_WITHOUT_LANES)
/* Return 0, or 1 + i + l * statuses for the first lane l that has such a coordinate. */
EOM_LOCAL int singular_lanes(int n, int statuses, const lanes *restrict pivot)
{
#if EOMGEN_VECTOR
    bits failed = { 0 };
    EOM_BITS any = 0;
    for (int i = 0; i < n; ++i) { failed |= ~(bits)(pivot[2 * i] > EOM_VANISHED * pivot[2 * i + 1]); }
    for (int l = 0; l < LANES; ++l) { any |= failed[l]; }
    if (any == 0) { return 0; }
#endif
    for (int l = 0; l < LANES; ++l) {
        for (int i = 0; i < n; ++i) {
            if (!(LANE(pivot[2 * i], l) > EOM_VANISHED * LANE(pivot[2 * i + 1], l))) { return 1 + i + l * statuses; }
        }
    }
    return 0;
}

#define LINE (64 / EOM_BYTES)          /* numbers that memory brings at once */
#define AHEAD (LANES < 8 ? 8 : LANES)  /* so many states later is what memory is asked for */
#define MANY ((size_t)1 << 24)         /* bytes of results: beyond that they hardly stay in a cache */

#if LANES == 1
#define EACH_LANE(DO) DO(0)
#elif LANES == 2
#define EACH_LANE(DO) DO(0) DO(1)
#elif LANES == 4
#define EACH_LANE(DO) DO(0) DO(1) DO(2) DO(3)
#elif LANES == 8
#define EACH_LANE(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7)
#else
#define EACH_LANE(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) DO(8) DO(9) DO(10) DO(11) DO(12) DO(13) DO(14) DO(15)
#endif

#if EOMGEN_VECTOR && (LANES > 1) && defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define EOMGEN_TRANSPOSE

/* A square of numbers, row k in xk, is transposed where it stands: blocks of 1, 2, 4 ... numbers swap across the diagonal.
 * LOW and HIGH: what two rows hold then, as places in both, one behind the other. */
#define SWAP(a, b, size) { const lanes low = __builtin_shufflevector(x##a, x##b, LOW##size); x##b = __builtin_shufflevector(x##a, x##b, HIGH##size); x##a = low; }
#if LANES == 2
#define LOW1 0, 2
#define HIGH1 1, 3
#define TRANSPOSE SWAP(0, 1, 1)
#elif LANES == 4
#define LOW1 0, 4, 2, 6
#define HIGH1 1, 5, 3, 7
#define LOW2 0, 1, 4, 5
#define HIGH2 2, 3, 6, 7
#define TRANSPOSE SWAP(0, 1, 1) SWAP(2, 3, 1) SWAP(0, 2, 2) SWAP(1, 3, 2)
#elif LANES == 8
#define LOW1 0, 8, 2, 10, 4, 12, 6, 14
#define HIGH1 1, 9, 3, 11, 5, 13, 7, 15
#define LOW2 0, 1, 8, 9, 4, 5, 12, 13
#define HIGH2 2, 3, 10, 11, 6, 7, 14, 15
#define LOW4 0, 1, 2, 3, 8, 9, 10, 11
#define HIGH4 4, 5, 6, 7, 12, 13, 14, 15
#define TRANSPOSE \
    SWAP(0, 1, 1) SWAP(2, 3, 1) SWAP(4, 5, 1) SWAP(6, 7, 1) \
    SWAP(0, 2, 2) SWAP(1, 3, 2) SWAP(4, 6, 2) SWAP(5, 7, 2) \
    SWAP(0, 4, 4) SWAP(1, 5, 4) SWAP(2, 6, 4) SWAP(3, 7, 4)
#else
#define LOW1 0, 16, 2, 18, 4, 20, 6, 22, 8, 24, 10, 26, 12, 28, 14, 30
#define HIGH1 1, 17, 3, 19, 5, 21, 7, 23, 9, 25, 11, 27, 13, 29, 15, 31
#define LOW2 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29
#define HIGH2 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31
#define LOW4 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27
#define HIGH4 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31
#define LOW8 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23
#define HIGH8 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31
#define TRANSPOSE \
    SWAP(0, 1, 1) SWAP(2, 3, 1) SWAP(4, 5, 1) SWAP(6, 7, 1) SWAP(8, 9, 1) SWAP(10, 11, 1) SWAP(12, 13, 1) SWAP(14, 15, 1) \
    SWAP(0, 2, 2) SWAP(1, 3, 2) SWAP(4, 6, 2) SWAP(5, 7, 2) SWAP(8, 10, 2) SWAP(9, 11, 2) SWAP(12, 14, 2) SWAP(13, 15, 2) \
    SWAP(0, 4, 4) SWAP(1, 5, 4) SWAP(2, 6, 4) SWAP(3, 7, 4) SWAP(8, 12, 4) SWAP(9, 13, 4) SWAP(10, 14, 4) SWAP(11, 15, 4) \
    SWAP(0, 8, 8) SWAP(1, 9, 8) SWAP(2, 10, 8) SWAP(3, 11, 8) SWAP(4, 12, 8) SWAP(5, 13, 8) SWAP(6, 14, 8) SWAP(7, 15, 8)
#endif

/* Read a square: LANES numbers of LANES states that lie step apart, a state in every lane of y.  With more, memory is asked for
 * what lies ahead: it comes while these are computed. */
EOM_INLINE void turned(const EOM_SCALAR *restrict x, size_t step, int more, lanes *restrict y)
{
#define READ(k) lanes x##k; (void)memcpy(&x##k, &x[k * step], sizeof x##k);
#define ASK(k) __builtin_prefetch(&x[(AHEAD + k) * step], 0, 3);
#define KEEP(k) y[k] = x##k;
    EACH_LANE(READ)
    if (more != 0) { EACH_LANE(ASK) }
    TRANSPOSE
    EACH_LANE(KEEP)
#undef READ
#undef ASK
#undef KEEP
}

/* Write a square: number i of a state is x[place[i]], or x[i] without places. */
EOM_INLINE void turned_back(const lanes *restrict x, const unsigned short *restrict place, size_t step, int more, EOM_SCALAR *restrict y)
{
#define ASK(k) __builtin_prefetch(&y[(AHEAD + k) * step], 0, 2);
#define TAKE(k) lanes x##k = x[(place != NULL) ? place[k] : k];
#define WRITE(k) (void)memcpy(&y[k * step], &x##k, sizeof x##k);
    if (more != 0) { EACH_LANE(ASK) }
    EACH_LANE(TAKE)
    TRANSPOSE
    EACH_LANE(WRITE)
#undef ASK
#undef TAKE
#undef WRITE
}
#endif
#endif

/* Read size numbers of here states, at most LANES, that lie step apart; the last one fills the lanes that are left.  more: whether
 * there are states AHEAD, which memory is asked for. */
EOM_LOCAL void gather(const EOM_SCALAR *restrict x, size_t step, size_t here, int more, int size, lanes *restrict y)
{
    (void)more;
#if defined(EOMGEN_TRANSPOSE)
    if ((size >= LANES) && (here == LANES)) {
        for (int i = 0; i < size; i += LANES) {
            const int at = (i + LANES <= size) ? i : (size - LANES); /* the last square overlaps the one before */
            turned(&x[at], step, more && i % LINE == 0, &y[at]);
        }
        return;
    }
    if (size >= LANES) {
        for (int i = 0; i < size; i += LANES) {
            const int at = (i + LANES <= size) ? i : (size - LANES);
            EOM_SCALAR rows[LANES * LANES];
            for (size_t l = 0; l < LANES; ++l) { (void)memcpy(&rows[l * LANES], &x[((l < here) ? l : (here - 1U)) * step + (size_t)at], sizeof(lanes)); }
            turned(rows, LANES, 0, &y[at]);
        }
        return;
    }
#endif
    const EOM_SCALAR *state[LANES];
    for (size_t l = 0; l < LANES; ++l) { state[l] = &x[((l < here) ? l : (here - 1U)) * step]; }
#define NUMBER(l) state[l][i],
    for (int i = 0; i < size; ++i) { y[i] = (lanes){ EACH_LANE(NUMBER) }; }
#undef NUMBER
}

/* Write size numbers of here states, at most LANES, that lie step apart: number i of a state is x[place[i]], or x[i] without
 * places. */
EOM_INLINE void scatter(const lanes *restrict x, const unsigned short *restrict place, size_t here, int more, int size, size_t step, EOM_SCALAR *restrict y)
{
    (void)more;
#if defined(EOMGEN_TRANSPOSE)
    if ((size >= LANES) && (here == LANES)) {
        const int past = (place != NULL) ? (int)((size_t)y / sizeof *y % LANES) : 0; /* behind the last whole vector of memory */
        for (int i = 0; i < size; i += (i == 0) ? (LANES - past) : LANES) {
            const int at = (i + LANES <= size) ? i : (size - LANES);
            turned_back((place != NULL) ? x : &x[at], (place != NULL) ? &place[at] : NULL, step, more && (i + past) % LINE == 0, &y[at]);
        }
        return;
    }
    if (size >= LANES) {
        for (int i = 0; i < size; i += LANES) {
            const int at = (i + LANES <= size) ? i : (size - LANES);
            EOM_SCALAR rows[LANES * LANES];
            turned_back((place != NULL) ? x : &x[at], (place != NULL) ? &place[at] : NULL, LANES, 0, rows);
            for (size_t l = 0; l < here; ++l) { (void)memcpy(&y[l * step + (size_t)at], &rows[l * LANES], sizeof(lanes)); }
        }
        return;
    }
#endif
    for (int i = 0; i < size; ++i) {
        for (size_t l = 0; l < here; ++l) { y[l * step + (size_t)i] = LANE(x[(place != NULL) ? place[i] : i], l); }
    }
}

/* Put numbers of all states, of which there are size, or none, into all lanes. */
EOM_LOCAL void spread(int size, const EOM_SCALAR *restrict h, lanes *restrict y)
{
    for (int i = 0; i < size; ++i) { y[i] = ALL(h[i]); }
}
#endif
#endif
