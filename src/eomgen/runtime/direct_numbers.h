/* Plain calls, below all else: loops over numbers; direct_calls.h includes it. */
#include "direct_data.h"

/* Exponents with all bits set are those of NaN and infinity: adding one to such an exponent carries into the sign.  With
 * vectors as wide as the processor has them that takes a quarter of the time. */
#if defined(__GNUC__)
enum { LINE = 64 }; /* bytes that are looked at together */
#define LOOK(WORD, EXPONENT, ONE)                                                                                      \
    typedef WORD words __attribute__((vector_size(LINE)));                                                             \
    const char *from = numbers;                                                                                        \
    const size_t size = (size_t)count * sizeof(WORD);                                                                  \
    size_t at = 0;                                                                                                     \
    words carries = {0};                                                                                               \
    WORD carry = 0;                                                                                                    \
    for (; at + LINE <= size; at += LINE) {                                                                            \
        words bits;                                                                                                    \
        memcpy(&bits, from + at, sizeof bits);                                                                         \
        carries |= (bits & (EXPONENT)) + (ONE);                                                                        \
    }                                                                                                                  \
    for (size_t i = 0; i < LINE / sizeof(WORD); ++i) carry |= carries[i];                                              \
    for (; at < size; at += sizeof(WORD)) {                                                                            \
        WORD bits;                                                                                                     \
        memcpy(&bits, from + at, sizeof bits);                                                                         \
        carry |= (bits & (EXPONENT)) + (ONE);                                                                          \
    }                                                                                                                  \
    return !(carry >> (8 * sizeof carry - 1));
#else
#define LOOK(WORD, EXPONENT, ONE)                                                                                      \
    const char *from = numbers;                                                                                        \
    WORD carry = 0;                                                                                                    \
    for (npy_intp i = 0; i < count; ++i) {                                                                             \
        WORD bits;                                                                                                     \
        memcpy(&bits, from + (size_t)i * sizeof bits, sizeof bits);                                                    \
        carry |= (bits & (EXPONENT)) + (ONE);                                                                          \
    }                                                                                                                  \
    return !(carry >> (8 * sizeof carry - 1));
#endif
#define DEFINE_FINITE(NAME, WORD, EXPONENT, ONE, TARGET)                                                               \
    TARGET static int NAME(const void *numbers, npy_intp count) { LOOK(WORD, EXPONENT, ONE) }
#define DEFINE_BOTH(LEVEL, TARGET)                                                                                     \
    DEFINE_FINITE(finite_double##LEVEL, uint64_t, UINT64_C(0x7ff0000000000000), UINT64_C(0x0010000000000000), TARGET)  \
    DEFINE_FINITE(finite_float##LEVEL, uint32_t, UINT32_C(0x7f800000), UINT32_C(0x00800000), TARGET)
DEFINE_BOTH(, )

#if defined(__GNUC__) && defined(__x86_64__)
DEFINE_BOTH(_avx2, __attribute__((target("avx2"))))
DEFINE_BOTH(_avx512, __attribute__((target("avx512f"))))
static int (*look_at[2])(const void *, npy_intp) = {finite_double, finite_float};

/* Choose by the processor; a module does so before its first call. */
static void choose_loops(void)
{
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f"))
        look_at[0] = finite_double_avx512, look_at[1] = finite_float_avx512;
    else if (__builtin_cpu_supports("avx2"))
        look_at[0] = finite_double_avx2, look_at[1] = finite_float_avx2;
}
#else
static int (*const look_at[2])(const void *, npy_intp) = {finite_double, finite_float};
static void choose_loops(void) {}
#endif

/* to[i] = from[i] + sign * what[i], states of so many numbers each; one state stands for all where there are fewer. */
#define DEFINE_SUM(REAL)                                                                                               \
    static void sum_##REAL(const void *from, npy_intp from_step, const void *what, npy_intp what_step, REAL sign,      \
                           npy_intp states, npy_intp size, void *to)                                                   \
    {                                                                                                                  \
        const REAL *x = from, *y = what;                                                                               \
        REAL *out = to;                                                                                                \
        for (npy_intp k = 0; k < states; ++k)                                                                          \
            for (npy_intp i = 0; i < size; ++i)                                                                        \
                out[k * size + i] = x[k * from_step + i] + sign * y[k * what_step + i];                                \
    }
DEFINE_SUM(double)
DEFINE_SUM(float)

static int all_finite(const Function *f, const void *numbers, npy_intp count)
{
    return look_at[f->dtype->type_num != NPY_DOUBLE](numbers, count);
}

static npy_intp bytes_of(const Function *f, npy_intp count)
{
    return count * (f->dtype->type_num == NPY_DOUBLE ? (npy_intp)sizeof(double) : (npy_intp)sizeof(float));
}

/* to = from + sign * what, each of one state for all or of as many as there are. */
static void add(const Function *f, const void *from, npy_intp from_step, const void *what, npy_intp what_step,
                double sign, npy_intp states, npy_intp size, void *to)
{
    if (f->dtype->type_num == NPY_DOUBLE)
        sum_double(from, from_step, what, what_step, sign, states, size, to);
    else
        sum_float(from, from_step, what, what_step, (float)sign, states, size, to);
}

/* Copy what calls return of all that the code has written. */
static void keep_leading(const Function *f, const char *whole, npy_intp states, char *out)
{
    const int last = f->result.axes - 1;
    const npy_intp size = f->result.lengths[last], kept = bytes_of(f, f->returned.lengths[last]);
    const npy_intp rows = last > 0 ? f->result.lengths[last - 1] : 1;
    const npy_intp kept_rows = last > 0 ? f->returned.lengths[last - 1] : 1;
    for (npy_intp row = 0; row < states * f->result.size / size; ++row) {
        if (row % rows >= kept_rows) continue;
        memcpy(out, whole + bytes_of(f, row * size), (size_t)kept);
        out += kept;
    }
}
