/* A kernel called once per state, behind the arguments of its batch: (count, h, q, step, ..., out). */
#include <stddef.h>
#include <string.h>

typedef struct {
    void (*code)(void); /* the kernel for one state */
    const double *h;
    size_t size; /* numbers of a result */
} Single;

typedef int (*Of1)(const double *, const double *, double *);
typedef int (*Of3)(const double *, const double *, const double *, const double *, double *);

long long one_by_one_1(size_t count, const double *handle, const double *q, size_t step, double *out)
{
    const Single *s = (const Single *)(const void *)handle;
    for (size_t i = 0; i < count; ++i)
        if (((Of1)s->code)(s->h, q + i * step, out + i * s->size)) return (long long)i;
    return -1;
}

long long one_by_one_3(size_t count, const double *handle, const double *q, size_t q_step, const double *v, size_t v_step, const double *x, size_t x_step, double *out)
{
    const Single *s = (const Single *)(const void *)handle;
    for (size_t i = 0; i < count; ++i)
        if (((Of3)s->code)(s->h, q + i * q_step, v + i * v_step, x + i * x_step, out + i * s->size)) return (long long)i;
    return -1;
}

/* Of any number of arrays, of one state each time: (h, x, count, array after array, ..., out) with n numbers a state. */
#define NEXT(k) x[k] + i * n
typedef const double *In;
typedef int (*Of4)(In, In, In, In, In, double *);
typedef int (*Of5)(In, In, In, In, In, In, double *);
typedef int (*Of6)(In, In, In, In, In, In, In, double *);
typedef int (*Of7)(In, In, In, In, In, In, In, In, double *);

int in_turn(void (*code)(void), const double *h, const double *const *x, int reads, size_t n, size_t count, double *out)
{
    int failed = 0;
    for (size_t i = 0; i < count; ++i) {
        if (reads == 3) failed |= ((Of3)code)(h, NEXT(0), NEXT(1), NEXT(2), out);
        if (reads == 4) failed |= ((Of4)code)(h, NEXT(0), NEXT(1), NEXT(2), NEXT(3), out);
        if (reads == 5) failed |= ((Of5)code)(h, NEXT(0), NEXT(1), NEXT(2), NEXT(3), NEXT(4), out);
        if (reads == 6) failed |= ((Of6)code)(h, NEXT(0), NEXT(1), NEXT(2), NEXT(3), NEXT(4), NEXT(5), out);
        if (reads == 7) failed |= ((Of7)code)(h, NEXT(0), NEXT(1), NEXT(2), NEXT(3), NEXT(4), NEXT(5), NEXT(6), out);
    }
    return failed;
}

/* Whatever lay in the caches: the arguments are any batch's, and none is read. */
long long forget(void)
{
    static unsigned char other[1 << 27];
    static unsigned char turn;
    memset(other, ++turn, sizeof other);
    return -1;
}
