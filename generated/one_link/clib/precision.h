/* precision.h: names and numbers of double precision, or with EOM_SINGLE of single precision; sizes, of the robot, or
 * where EOM_POSITIONS, EOM_RATES, EOM_INPUTS, EOM_M and EOM_ROTATIONS are known, constants; a check of numbers. */
#ifndef EOM_PRECISION_H
#define EOM_PRECISION_H
#if defined(EOM_SINGLE)
#define EOM(name) eomf_##name
#define EOM_SCALAR float
#define EOM_MATH(function) function##f
#define EOM_ROUND_OFF 1.1920929e-07F
#define EOM_VANISHED 1e-05F
#define EOM_C(x) x##F
#else
#define EOM(name) eom_##name
#define EOM_SCALAR double
#define EOM_MATH(function) function
#define EOM_ROUND_OFF 2.220446049250313e-16
#define EOM_VANISHED 1e-12 /* of its scale: pivots that vanish */
#define EOM_C(x) x
#endif

#if defined(EOM_RATES)
#define EOM_POSITIONS_OF(sizes) EOM_POSITIONS
#define EOM_RATES_OF(sizes) EOM_RATES
#define EOM_INPUTS_OF(sizes) EOM_INPUTS
#define EOM_M_OF(sizes) EOM_M
#define EOM_ROTATIONS_OF(sizes) EOM_ROTATIONS
#else
#define EOM_POSITIONS_OF(sizes) ((sizes)->positions)
#define EOM_RATES_OF(sizes) ((sizes)->rates)
#define EOM_INPUTS_OF(sizes) ((sizes)->inputs)
#define EOM_M_OF(sizes) ((sizes)->m)
#define EOM_ROTATIONS_OF(sizes) ((sizes)->rotations)
#endif
#define EOM_STATE_OF(sizes) (EOM_POSITIONS_OF(sizes) + EOM_RATES_OF(sizes))
#define EOM_PADDED_TO_BLOCKS(n) (((n) + EOM_BLOCK - 1) / EOM_BLOCK * EOM_BLOCK)

#if defined(EOM_RADAU) || !defined(EOM_RATES)
#define EOM_HAS_RADAU /* a robot's file says whether it has its equations */
#endif
#if defined(EOM_DERIVATIVES) || !defined(EOM_RATES)
#define EOM_HAS_DERIVATIVES
#endif

#if defined(__GNUC__)
#define EOM_LOCAL static __attribute__((unused))
#define EOM_PART static __attribute__((noinline)) /* of a long function */
#define EOM_INLINE static inline __attribute__((unused))
#define EOM_IN_PLACE static inline __attribute__((unused, always_inline)) /* where sizes are constants */
#define EOM_PRAGMA(words) _Pragma(#words)
#define EOM_UNROLL(times) EOM_PRAGMA(GCC unroll times)
#define EOM_ALIGNED __attribute__((aligned(64))) /* no vector crosses a line of the cache */
#else
#define EOM_LOCAL static
#define EOM_PART static
#define EOM_INLINE static
#define EOM_IN_PLACE static
#define EOM_UNROLL(times)
#define EOM_ALIGNED
#endif
#if defined(EOM_RATES)
#define EOM_PUBLIC EOM_LOCAL
#else
#define EOM_PUBLIC
#endif

#define EOM_LOOK 2000        /* steps and rejections between two looks at whether they lead anywhere */
#define EOM_LEAST_PART 1e-07 /* of the duration by which they do */

/* Whether numbers are finite. */
EOM_LOCAL int EOM(all_finite)(int count, const EOM_SCALAR *restrict x)
{
    int is_finite = 1;
    for (int i = 0; i < count; ++i) {
        if (!((x[i] - x[i]) >= EOM_C(0.0))) { is_finite = 0; }
    }
    return is_finite;
}
#endif
