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

/* States in rows, (states, size), from and into tiles, (ceil(states / W), size, W), W numbers of a line each: number i of
 * state k is at (k / W * size + i) * W + k % W.  Blocks of as many states and numbers as 16 bytes hold turn in registers;
 * so that the last one ends with a state's last number it may overlap the one before. */
#if defined(__GNUC__) && defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define TURNS
#endif
#endif
enum { TILE_BYTES = 64 };

#if defined(TURNS)
typedef double twos __attribute__((vector_size(16)));
typedef float fours __attribute__((vector_size(16)));

static inline void turn_double(const double *x, npy_intp x_step, double *y, npy_intp y_step)
{
    twos a, b;
    memcpy(&a, x, sizeof a), memcpy(&b, x + x_step, sizeof b);
    const twos low = __builtin_shufflevector(a, b, 0, 2), high = __builtin_shufflevector(a, b, 1, 3);
    memcpy(y, &low, sizeof low), memcpy(y + y_step, &high, sizeof high);
}

static inline void turn_float(const float *x, npy_intp x_step, float *y, npy_intp y_step)
{
    fours a, b, c, d;
    memcpy(&a, x, sizeof a), memcpy(&b, x + x_step, sizeof b);
    memcpy(&c, x + 2 * x_step, sizeof c), memcpy(&d, x + 3 * x_step, sizeof d);
    const fours e = __builtin_shufflevector(a, b, 0, 4, 1, 5), f = __builtin_shufflevector(c, d, 0, 4, 1, 5);
    const fours g = __builtin_shufflevector(a, b, 2, 6, 3, 7), h = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    a = __builtin_shufflevector(e, f, 0, 1, 4, 5), b = __builtin_shufflevector(e, f, 2, 3, 6, 7);
    c = __builtin_shufflevector(g, h, 0, 1, 4, 5), d = __builtin_shufflevector(g, h, 2, 3, 6, 7);
    memcpy(y, &a, sizeof a), memcpy(y + y_step, &b, sizeof b);
    memcpy(y + 2 * y_step, &c, sizeof c), memcpy(y + 3 * y_step, &d, sizeof d);
}
#define BLOCK(REAL) (16 / (npy_intp)sizeof(REAL))
#else
static inline void turn_double(const double *x, npy_intp x_step, double *y, npy_intp y_step)
{
    (void)x_step, (void)y_step, *y = *x;
}
static inline void turn_float(const float *x, npy_intp x_step, float *y, npy_intp y_step)
{
    (void)x_step, (void)y_step, *y = *x;
}
#define BLOCK(REAL) ((npy_intp)1)
#endif

#define DEFINE_TILES(REAL)                                                                                             \
    static void turn_tile_##REAL(const REAL *x, npy_intp size, int back, REAL *y)                                      \
    {                                                                                                                  \
        const npy_intp width = TILE_BYTES / (npy_intp)sizeof(REAL), block = size < BLOCK(REAL) ? 1 : BLOCK(REAL);      \
        for (npy_intp i = 0; i < size; i += block) {                                                                   \
            const npy_intp at = i + block <= size ? i : size - block;                                                  \
            for (npy_intp l = 0; l < width; l += block) {                                                              \
                const npy_intp row = l * size + at, line = at * width + l;                                             \
                if (block == 1)                                                                                        \
                    y[back ? row : line] = x[back ? line : row];                                                       \
                else if (back)                                                                                         \
                    turn_##REAL(x + line, width, y + row, size);                                                       \
                else                                                                                                   \
                    turn_##REAL(x + row, size, y + line, width);                                                       \
            }                                                                                                          \
        }                                                                                                              \
    }                                                                                                                  \
    /* The last state fills the tile that it stands in. */                                                             \
    static void into_tiles_##REAL(const void *from, npy_intp states, npy_intp size, void *to)                          \
    {                                                                                                                  \
        const npy_intp width = TILE_BYTES / (npy_intp)sizeof(REAL), whole = states / width * width;                    \
        const REAL *x = from;                                                                                          \
        REAL *y = to;                                                                                                  \
        for (npy_intp k = 0; k < whole; k += width) turn_tile_##REAL(x + k * size, size, 0, y + k * size);             \
        for (npy_intp i = 0; i < size && whole < states; ++i)                                                          \
            for (npy_intp l = 0; l < width; ++l)                                                                       \
                y[whole * size + i * width + l] = x[(whole + l < states ? whole + l : states - 1) * size + i];         \
    }                                                                                                                  \
    static void out_of_tiles_##REAL(const void *from, npy_intp states, npy_intp size, void *to)                        \
    {                                                                                                                  \
        const npy_intp width = TILE_BYTES / (npy_intp)sizeof(REAL), whole = states / width * width;                    \
        const REAL *x = from;                                                                                          \
        REAL *y = to;                                                                                                  \
        for (npy_intp k = 0; k < whole; k += width) turn_tile_##REAL(x + k * size, size, 1, y + k * size);             \
        for (npy_intp k = whole; k < states; ++k)                                                                      \
            for (npy_intp i = 0; i < size; ++i) y[k * size + i] = x[whole * size + i * width + k - whole];             \
    }
DEFINE_TILES(double)
DEFINE_TILES(float)
