/* lanes.h: several states at a time, one in every lane of a vector of the compiler: types, arithmetic that C has no
 * operators for, and how states come into vectors and out.  Of one precision, as precision.h says.
 *
 * EOM_VECTOR_BYTES: bytes of a vector, 0 for none; by default the widest of the processor, but for functions of one
 * state (EOM_WITHOUT_LANES), whose few angles fill no wide one.  EOM_LIBM: sines and cosines are those of the C
 * library. */
#ifndef EOM_LANES_H
#define EOM_LANES_H
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "precision.h"

#if !defined(EOM_VECTOR_BYTES)
#if defined(__GNUC__) && defined(__AVX512F__) && !defined(EOM_WITHOUT_LANES)
#define EOM_VECTOR_BYTES 64
#elif defined(__GNUC__) && defined(__AVX__)
#define EOM_VECTOR_BYTES 32
#elif defined(__GNUC__) && (defined(__SSE2__) || defined(__ARM_NEON))
#define EOM_VECTOR_BYTES 16
#else
#define EOM_VECTOR_BYTES 0
#endif
#endif

#if defined(EOM_SINGLE)
#define EOM_BITS int
#define EOM_BYTES 4
#else
#define EOM_BITS long long
#define EOM_BYTES 8
#endif
#if (EOM_VECTOR_BYTES == 0) || (EOM_VECTOR_BYTES == EOM_BYTES)
#define EOM_LANES 1
#elif EOM_VECTOR_BYTES == 2 * EOM_BYTES
#define EOM_LANES 2
#elif EOM_VECTOR_BYTES == 4 * EOM_BYTES
#define EOM_LANES 4
#elif EOM_VECTOR_BYTES == 8 * EOM_BYTES
#define EOM_LANES 8
#elif EOM_VECTOR_BYTES == 16 * EOM_BYTES
#define EOM_LANES 16
#else
#error "EOM_VECTOR_BYTES: bytes of a vector of 1, 2, 4, 8 or 16 numbers; or 0"
#endif

/* Names of functions that other files call: what lanes of one number do is not what those of another do. */
#define EOM_WIDE(name) EOM_WIDE_OF(name, EOM_LANES)
#define EOM_WIDE_OF(name, width) EOM_JOINED(name, width)
#define EOM_JOINED(name, width) EOM(name##_x##width)

#if EOM_VECTOR_BYTES
typedef EOM_SCALAR lanes __attribute__((vector_size(EOM_VECTOR_BYTES)));
typedef EOM_BITS bits __attribute__((vector_size(EOM_VECTOR_BYTES)));
#define EOM_LANE(x, l) ((x)[l])
#define EOM_ALL_LANES(x) ((x) - (lanes){ EOM_C(0.0) })
#else
typedef EOM_SCALAR lanes;
#define EOM_LANE(x, l) (x)
#define EOM_ALL_LANES(x) (x)
#endif
#define EOM_PADDED(count) (((count) + EOM_LANES - 1) / EOM_LANES * EOM_LANES)

#include "operations.h"
#define EOM_SIGN_SHIFT (8 * EOM_BYTES - 2) /* from bit 1 to the sign */

/* Take sines and cosines of count angles, a multiple of EOM_LANES, within 2.5 units in the last place.  The nearest
 * multiple of pi/2 is taken off in parts, products of all but the last exact, and the rest r goes with z = r^2 into the
 * polynomials of fdlibm (Sun Microsystems 1993), or in single precision of the Cephes library (S. L. Moshier): r + r z
 * EOM_SIN_SERIES(z), 1 - z (1/2 - z EOM_COS_SERIES(z)).  Angles farther than EOM_LARGEST_ANGLE are left to the C
 * library; with EOM_LIBM all are.  Bits are the same with vectors and without. */
EOM_LOCAL void eom_sin_cos(const EOM_SCALAR *restrict angle, size_t count, EOM_SCALAR *restrict sine,
        EOM_SCALAR *restrict cosine)
{
#if EOM_VECTOR_BYTES && !defined(EOM_LIBM)
    bits far = { 0 };
    EOM_BITS any = 0;
    for (size_t i = 0; i < count; i += EOM_LANES) {
        lanes x;
        (void)memcpy(&x, &angle[i], sizeof x);
        far |= (bits)(x > EOM_LARGEST_ANGLE) | (bits)(x < -EOM_LARGEST_ANGLE);
        const lanes shifted = x*EOM_TWO_OVER_PI + EOM_ROUNDING_SHIFT;
        const lanes quarters = shifted - EOM_ROUNDING_SHIFT;
        const lanes r = EOM_REDUCED_ANGLE(x, quarters);
        const lanes z = r*r;
        const lanes s = r + r*z*EOM_SIN_SERIES(z);
        const lanes c = EOM_C(1.0) - z*(EOM_C(0.5) - z*EOM_COS_SERIES(z));
        const bits quarter = (bits)shifted;
        const bits odd = (bits)((quarter & 1) != 0);
        const bits s_bits = (odd & (bits)c) | (~odd & (bits)s);
        const bits c_bits = (odd & (bits)s) | (~odd & (bits)c);
        const bits s_signed = s_bits ^ ((quarter & 2) << EOM_SIGN_SHIFT);
        const bits c_signed = c_bits ^ (((quarter + 1) & 2) << EOM_SIGN_SHIFT);
        (void)memcpy(&sine[i], &s_signed, sizeof s_signed);
        (void)memcpy(&cosine[i], &c_signed, sizeof c_signed);
    }
    for (int l = 0; l < EOM_LANES; ++l) { any |= far[l]; }
    if (any == 0) { return; }
#endif
    for (size_t i = 0; i < count; ++i) {
#if !defined(EOM_LIBM)
        if ((angle[i] <= EOM_LARGEST_ANGLE) && (angle[i] >= -EOM_LARGEST_ANGLE)) {
#if !EOM_VECTOR_BYTES
            const EOM_SCALAR shifted = angle[i]*EOM_TWO_OVER_PI + EOM_ROUNDING_SHIFT;
            const EOM_SCALAR quarters = shifted - EOM_ROUNDING_SHIFT;
            const EOM_SCALAR r = EOM_REDUCED_ANGLE(angle[i], quarters);
            const EOM_SCALAR z = r*r;
            const EOM_SCALAR s = r + r*z*EOM_SIN_SERIES(z);
            const EOM_SCALAR c = EOM_C(1.0) - z*(EOM_C(0.5) - z*EOM_COS_SERIES(z));
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
#undef EOM_LARGEST_ANGLE
#undef EOM_TWO_OVER_PI
#undef EOM_ROUNDING_SHIFT
#undef EOM_SIGN_SHIFT
#undef EOM_REDUCED_ANGLE
#undef EOM_SIN_SERIES
#undef EOM_COS_SERIES

/* Declare sine and cosine of so many angles, and take them: of numbers, of vectors, and of vectors that stand side by
 * side. */
#define EOM_SIN_COS(count, ...) \
    const EOM_SCALAR angle[EOM_PADDED(count)] = { __VA_ARGS__ }; \
    EOM_SCALAR sine[EOM_PADDED(count)]; \
    EOM_SCALAR cosine[EOM_PADDED(count)]; \
    eom_sin_cos(angle, EOM_PADDED(count), sine, cosine)
#define EOM_SIN_COS_LANES(count, ...) \
    const lanes angle[count] = { __VA_ARGS__ }; \
    EOM_SIN_COS_AT(count, angle)
#define EOM_SIN_COS_AT(count, place) \
    lanes sine[count]; \
    lanes cosine[count]; \
    eom_sin_cos((const EOM_SCALAR *)(place), (count) * EOM_LANES, (EOM_SCALAR *)sine, (EOM_SCALAR *)cosine)

/* Tell whether a gate is greater than 0, of lanes any of them. */
EOM_INLINE int eom_any_positive(EOM_SCALAR gate) { return (gate > EOM_C(0.0)) ? 1 : 0; }
EOM_INLINE int eom_any_positive_lanes(lanes gate)
{
    for (int l = 0; l < EOM_LANES; ++l) {
        if (EOM_LANE(gate, l) > EOM_C(0.0)) { return 1; }
    }
    return 0;
}

/* Return 0, or 1 + i for the first of n coordinates whose pivot vanishes beside its scale, which stands behind it; what
 * is no number has vanished. */
EOM_LOCAL int eom_singular(int n, const EOM_SCALAR *restrict pivot)
{
    for (int i = 0; i < n; ++i) {
        if (!(pivot[2 * i] > EOM_VANISHED * pivot[2 * i + 1])) { return 1 + i; }
    }
    return 0;
}

#if !defined(EOM_WITHOUT_LANES)
/* Return 0, or 1 + i + l * statuses for the first lane l that has such a coordinate. */
EOM_LOCAL int eom_singular_lanes(int n, int statuses, const lanes *restrict pivot)
{
#if EOM_VECTOR_BYTES
    bits failed = { 0 };
    EOM_BITS any = 0;
    for (int i = 0; i < n; ++i) { failed |= ~(bits)(pivot[2 * i] > EOM_VANISHED * pivot[2 * i + 1]); }
    for (int l = 0; l < EOM_LANES; ++l) { any |= failed[l]; }
    if (any == 0) { return 0; }
#endif
    for (int l = 0; l < EOM_LANES; ++l) {
        for (int i = 0; i < n; ++i) {
            if (!(EOM_LANE(pivot[2 * i], l) > EOM_VANISHED * EOM_LANE(pivot[2 * i + 1], l))) {
                return 1 + i + l * statuses;
            }
        }
    }
    return 0;
}

#define EOM_CACHE_LINE (64 / EOM_BYTES)          /* numbers that memory brings at once */
#define EOM_PREFETCH_STATES (EOM_LANES < 8 ? 8 : EOM_LANES)  /* so many states later is what memory is asked for */
#define EOM_CACHE_BYTES ((size_t)1 << 24)         /* bytes of results: beyond that they hardly stay in a cache */

#if EOM_LANES == 1
#define EOM_EACH_LANE(DO) DO(0)
#elif EOM_LANES == 2
#define EOM_EACH_LANE(DO) DO(0) DO(1)
#elif EOM_LANES == 4
#define EOM_EACH_LANE(DO) DO(0) DO(1) DO(2) DO(3)
#elif EOM_LANES == 8
#define EOM_EACH_LANE(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7)
#else
#define EOM_EACH_LANE(DO) \
    DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) DO(8) DO(9) DO(10) DO(11) DO(12) DO(13) DO(14) DO(15)
#endif

#if EOM_VECTOR_BYTES && (EOM_LANES > 1) && defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define EOM_HAS_TRANSPOSE

/* A square of numbers, row k in xk, is transposed where it stands: blocks of 1, 2, 4 ... numbers swap across the
 * diagonal.  LOW and HIGH: what two rows hold then, as places in both, one behind the other. */
#define EOM_SWAP(a, b, size) { \
    const lanes low = __builtin_shufflevector(x##a, x##b, EOM_LOW##size); \
    x##b = __builtin_shufflevector(x##a, x##b, EOM_HIGH##size); \
    x##a = low; \
}
#if EOM_LANES == 2
#define EOM_LOW1 0, 2
#define EOM_HIGH1 1, 3
#define EOM_TRANSPOSE EOM_SWAP(0, 1, 1)
#elif EOM_LANES == 4
#define EOM_LOW1 0, 4, 2, 6
#define EOM_HIGH1 1, 5, 3, 7
#define EOM_LOW2 0, 1, 4, 5
#define EOM_HIGH2 2, 3, 6, 7
#define EOM_TRANSPOSE EOM_SWAP(0, 1, 1) EOM_SWAP(2, 3, 1) EOM_SWAP(0, 2, 2) EOM_SWAP(1, 3, 2)
#elif EOM_LANES == 8
#define EOM_LOW1 0, 8, 2, 10, 4, 12, 6, 14
#define EOM_HIGH1 1, 9, 3, 11, 5, 13, 7, 15
#define EOM_LOW2 0, 1, 8, 9, 4, 5, 12, 13
#define EOM_HIGH2 2, 3, 10, 11, 6, 7, 14, 15
#define EOM_LOW4 0, 1, 2, 3, 8, 9, 10, 11
#define EOM_HIGH4 4, 5, 6, 7, 12, 13, 14, 15
#define EOM_TRANSPOSE \
    EOM_SWAP(0, 1, 1) EOM_SWAP(2, 3, 1) EOM_SWAP(4, 5, 1) EOM_SWAP(6, 7, 1) \
    EOM_SWAP(0, 2, 2) EOM_SWAP(1, 3, 2) EOM_SWAP(4, 6, 2) EOM_SWAP(5, 7, 2) \
    EOM_SWAP(0, 4, 4) EOM_SWAP(1, 5, 4) EOM_SWAP(2, 6, 4) EOM_SWAP(3, 7, 4)
#else
#define EOM_LOW1 0, 16, 2, 18, 4, 20, 6, 22, 8, 24, 10, 26, 12, 28, 14, 30
#define EOM_HIGH1 1, 17, 3, 19, 5, 21, 7, 23, 9, 25, 11, 27, 13, 29, 15, 31
#define EOM_LOW2 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29
#define EOM_HIGH2 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31
#define EOM_LOW4 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27
#define EOM_HIGH4 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31
#define EOM_LOW8 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23
#define EOM_HIGH8 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31
#define EOM_TRANSPOSE \
    EOM_SWAP(0, 1, 1) EOM_SWAP(2, 3, 1) EOM_SWAP(4, 5, 1) EOM_SWAP(6, 7, 1) \
    EOM_SWAP(8, 9, 1) EOM_SWAP(10, 11, 1) EOM_SWAP(12, 13, 1) EOM_SWAP(14, 15, 1) \
    EOM_SWAP(0, 2, 2) EOM_SWAP(1, 3, 2) EOM_SWAP(4, 6, 2) EOM_SWAP(5, 7, 2) \
    EOM_SWAP(8, 10, 2) EOM_SWAP(9, 11, 2) EOM_SWAP(12, 14, 2) EOM_SWAP(13, 15, 2) \
    EOM_SWAP(0, 4, 4) EOM_SWAP(1, 5, 4) EOM_SWAP(2, 6, 4) EOM_SWAP(3, 7, 4) \
    EOM_SWAP(8, 12, 4) EOM_SWAP(9, 13, 4) EOM_SWAP(10, 14, 4) EOM_SWAP(11, 15, 4) \
    EOM_SWAP(0, 8, 8) EOM_SWAP(1, 9, 8) EOM_SWAP(2, 10, 8) EOM_SWAP(3, 11, 8) \
    EOM_SWAP(4, 12, 8) EOM_SWAP(5, 13, 8) EOM_SWAP(6, 14, 8) EOM_SWAP(7, 15, 8)
#endif

/* Read a square: EOM_LANES numbers of EOM_LANES states that lie step apart, a state in every lane of y.  With more,
 * memory is asked for what lies ahead: it comes while these are computed. */
EOM_INLINE void eom_transpose_in(const EOM_SCALAR *restrict x, size_t step, int more, lanes *restrict y)
{
#define EOM_READ(k) lanes x##k; (void)memcpy(&x##k, &x[k * step], sizeof x##k);
#define EOM_PREFETCH(k) __builtin_prefetch(&x[(EOM_PREFETCH_STATES + k) * step], 0, 3);
#define EOM_KEEP(k) y[k] = x##k;
    EOM_EACH_LANE(EOM_READ)
    if (more != 0) { EOM_EACH_LANE(EOM_PREFETCH) }
    EOM_TRANSPOSE
    EOM_EACH_LANE(EOM_KEEP)
#undef EOM_READ
#undef EOM_PREFETCH
#undef EOM_KEEP
}

/* Write a square: number i of a state is x[place[i]], or x[i] without places. */
EOM_INLINE void eom_transpose_out(const lanes *restrict x, const unsigned short *restrict place, size_t step, int more,
        EOM_SCALAR *restrict y)
{
#define EOM_PREFETCH(k) __builtin_prefetch(&y[(EOM_PREFETCH_STATES + k) * step], 0, 2);
#define EOM_TAKE(k) lanes x##k = x[(place != NULL) ? place[k] : k];
#define EOM_WRITE(k) (void)memcpy(&y[k * step], &x##k, sizeof x##k);
    if (more != 0) { EOM_EACH_LANE(EOM_PREFETCH) }
    EOM_EACH_LANE(EOM_TAKE)
    EOM_TRANSPOSE
    EOM_EACH_LANE(EOM_WRITE)
#undef EOM_PREFETCH
#undef EOM_TAKE
#undef EOM_WRITE
}
#endif
#endif

/* Read size numbers of here states, at most EOM_LANES, that lie step apart; the last one fills the lanes that are left.
 * more: whether there are states EOM_PREFETCH_STATES, which memory is asked for. */
EOM_LOCAL void eom_gather(const EOM_SCALAR *restrict x, size_t step, size_t here, int more, int size, lanes *restrict y)
{
    (void)more;
#if defined(EOM_HAS_TRANSPOSE)
    if ((size >= EOM_LANES) && (here == EOM_LANES)) {
        for (int i = 0; i < size; i += EOM_LANES) {
            /* the last square overlaps the one before */
            const int at = (i + EOM_LANES <= size) ? i : (size - EOM_LANES);
            eom_transpose_in(&x[at], step, more && i % EOM_CACHE_LINE == 0, &y[at]);
        }
        return;
    }
    if (size >= EOM_LANES) {
        for (int i = 0; i < size; i += EOM_LANES) {
            const int at = (i + EOM_LANES <= size) ? i : (size - EOM_LANES);
            EOM_SCALAR rows[EOM_LANES * EOM_LANES];
            for (size_t l = 0; l < EOM_LANES; ++l) {
                (void)memcpy(&rows[l * EOM_LANES], &x[((l < here) ? l : (here - 1U)) * step + (size_t)at],
                        sizeof(lanes));
            }
            eom_transpose_in(rows, EOM_LANES, 0, &y[at]);
        }
        return;
    }
#endif
    const EOM_SCALAR *state[EOM_LANES];
    for (size_t l = 0; l < EOM_LANES; ++l) { state[l] = &x[((l < here) ? l : (here - 1U)) * step]; }
#define EOM_ENTRY(l) state[l][i],
    for (int i = 0; i < size; ++i) { y[i] = (lanes){ EOM_EACH_LANE(EOM_ENTRY) }; }
#undef EOM_ENTRY
}

/* Write size numbers of here states, at most EOM_LANES, that lie step apart: number i of a state is x[place[i]], or
 * x[i] without places. */
EOM_INLINE void eom_scatter(const lanes *restrict x, const unsigned short *restrict place, size_t here, int more,
        int size, size_t step, EOM_SCALAR *restrict y)
{
    (void)more;
#if defined(EOM_HAS_TRANSPOSE)
    if ((size >= EOM_LANES) && (here == EOM_LANES)) {
        /* behind the last whole vector of memory */
        const int past = (place != NULL) ? (int)((size_t)y / sizeof *y % EOM_LANES) : 0;
        for (int i = 0; i < size; i += (i == 0) ? (EOM_LANES - past) : EOM_LANES) {
            const int at = (i + EOM_LANES <= size) ? i : (size - EOM_LANES);
            eom_transpose_out((place != NULL) ? x : &x[at], (place != NULL) ? &place[at] : NULL, step, more
                    && (i + past) % EOM_CACHE_LINE == 0, &y[at]);
        }
        return;
    }
    if (size >= EOM_LANES) {
        for (int i = 0; i < size; i += EOM_LANES) {
            const int at = (i + EOM_LANES <= size) ? i : (size - EOM_LANES);
            EOM_SCALAR rows[EOM_LANES * EOM_LANES];
            eom_transpose_out((place != NULL) ? x : &x[at], (place != NULL) ? &place[at] : NULL, EOM_LANES, 0, rows);
            for (size_t l = 0; l < here; ++l) {
                (void)memcpy(&y[l * step + (size_t)at], &rows[l * EOM_LANES], sizeof(lanes));
            }
        }
        return;
    }
#endif
    for (int i = 0; i < size; ++i) {
        for (size_t l = 0; l < here; ++l) { y[l * step + (size_t)i] = EOM_LANE(x[(place != NULL) ? place[i] : i], l); }
    }
}

/* Put numbers of all states, of which there are size, or none, into all lanes. */
EOM_LOCAL void eom_broadcast(int size, const EOM_SCALAR *restrict h, lanes *restrict y)
{
    for (int i = 0; i < size; ++i) { y[i] = EOM_ALL_LANES(h[i]); }
}
#endif
#endif
