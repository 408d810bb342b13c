/* double_double.h: straight-line programs in extended precision: numbers are unevaluated sums of two doubles, beside each a bound
 * of what rounding has moved it by.  For one state, in both precisions: arrays become doubles and doubles arrays.
 *
 * Source of the arithmetic and of its bounds, in units u^2 with u = 2^-53: M. Joldes, J.-M. Muller, V. Popescu, "Tight and Rigorous
 * Error Bounds for Basic Building Blocks of Double-Word Arithmetic", ACM Trans. Math. Softw. 44, 2017: sums 3, products 7, quotients
 * 15; of the root: V. Lefevre et al., "Accurate Calculation of Euclidean Norms Using Double-Word Arithmetic", ACM Trans. Math.
 * Softw. 49, 2023: 25/8.  All are below DD_UNIT; products that lose digits at the lower end of doubles are off by DD_LEAST at most. */
#ifndef EOM_DOUBLE_DOUBLE_H
#define EOM_DOUBLE_DOUBLE_H
#include <math.h>

#include "precision.h"

/* What is added here is the rounding of products and sums: none of them may be one operation. */
#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#else
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

#define DD_UNIT 0x1p-102  /* 16 u^2 */
#define DD_CALLED 0x1p-50 /* of a function of the C library, which has its share of a double alone: 8 u, 2 units in the last place and more */
#define DD_LEAST 0x1p-1000
#define DD_UP(x) ((x) * (1.0 + 0x1p-48)) /* more than what a bound lost while it was computed */
#define DD_FARTHEST 0x1p30               /* rad: an angle beyond it has no bound */
#define DD_SINE_TERMS 13
#define DD_COSINE_TERMS 14

/* A number, high + low, and the bound of its error: a bound that is infinite or no number says that there is none. */
typedef struct {
    double high;
    double low;
} eom_pair;
typedef struct {
    eom_pair x;
    double error;
} eom_bounded;

/* A program: rows of operation, place of its value, and three arguments: places of values; array and element of an input, and
 * the array of how far it may be off, or 0; number of a constant.  Places are taken again when nobody needs what is there. */
typedef struct {
    int steps;
    int results;
    const unsigned short (*step)[5];
    const double *constant;
    const unsigned short *result; /* place of each */
} eom_extended_program;

enum { DD_CONST, DD_INPUT, DD_NEG, DD_ADD, DD_SUB, DD_MUL, DD_DIV, DD_SIN, DD_COS, DD_SQRT, DD_ABS, DD_MAX, DD_STEP, DD_CHOOSE, DD_EXP, DD_LOG, DD_ATAN2 };

/* pi/2 in three parts, and Taylor's coefficients from the last one on: (-1)^k / (2 k + 1)!, (-1)^k / (2 k)!. */
static const double eom_quarter[3] = { 0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54, -0x1.f1976b7ed8fbcp-110 };
static const eom_pair eom_sine_terms[DD_SINE_TERMS] = {
    { -0x1.d1ab1c2dccea3p-94, -0x1.054d0c78aea14p-149 },
    { 0x1.3f3ccdd165fa9p-84, -0x1.58ddadf344487p-139 },
    { -0x1.761b41316381ap-75, 0x1.3423c7d91404fp-130 },
    { 0x1.71b8ef6dcf572p-66, -0x1.d043ae40c4647p-120 },
    { -0x1.2f49b46814157p-57, -0x1.2650f61dbdcb4p-112 },
    { 0x1.952c77030ad4ap-49, 0x1.ac981465ddc6cp-103 },
    { -0x1.ae7f3e733b81fp-41, -0x1.1d8656b0ee8cbp-97 },
    { 0x1.6124613a86d09p-33, 0x1.f28e0cc748ebep-87 },
    { -0x1.ae64567f544e4p-26, 0x1.c062e06d1f209p-80 },
    { 0x1.71de3a556c734p-19, -0x1.c154f8ddc6cp-73 },
    { -0x1.a01a01a01a01ap-13, -0x1.a01a01a01a01ap-73 },
    { 0x1.1111111111111p-7, 0x1.1111111111111p-63 },
    { -0x1.5555555555555p-3, -0x1.5555555555555p-57 },
};
static const eom_pair eom_cosine_terms[DD_COSINE_TERMS] = {
    { 0x1.0a18a2635085dp-98, 0x1.b9e2e28e1aa54p-153 },
    { -0x1.88e85fc6a4e5ap-89, 0x1.71c37ebd1654p-143 },
    { 0x1.f2cf01972f578p-80, -0x1.9ada5fcc1ab14p-135 },
    { -0x1.0ce396db7f853p-70, 0x1.aebcdbd20331cp-124 },
    { 0x1.e542ba4020225p-62, 0x1.ea72b4afe3c2fp-120 },
    { -0x1.6827863b97d97p-53, -0x1.eec01221a8b0bp-107 },
    { 0x1.ae7f3e733b81fp-45, 0x1.1d8656b0ee8cbp-101 },
    { -0x1.93974a8c07c9dp-37, -0x1.05d6f8a2efd1fp-92 },
    { 0x1.1eed8eff8d898p-29, -0x1.2aec959e14c06p-83 },
    { -0x1.27e4fb7789f5cp-22, -0x1.cbbc05b4fa99ap-76 },
    { 0x1.a01a01a01a01ap-16, 0x1.a01a01a01a01ap-76 },
    { -0x1.6c16c16c16c17p-10, 0x1.f49f49f49f49fp-65 },
    { 0x1.5555555555555p-5, 0x1.5555555555555p-59 },
    { -0x1p-1, 0x0p+0 },
};

/* Return x + y and what rounding has taken of it, for |x| >= |y| or any; x y, by the halves of J. G. Dekker (1971). */
EOM_INLINE eom_pair eom_quick_sum(double x, double y)
{
    const double sum = x + y;
    const eom_pair z = { sum, y - (sum - x) };
    return z;
}

EOM_INLINE eom_pair eom_two_sum(double x, double y)
{
    const double sum = x + y;
    const double part = sum - x;
    const eom_pair z = { sum, (x - (sum - part)) + (y - part) };
    return z;
}

EOM_INLINE eom_pair eom_two_product(double x, double y)
{
    const double product = x * y;
    const double x_up = 134217729.0 * x;
    const double y_up = 134217729.0 * y;
    const double x_head = x_up - (x_up - x);
    const double y_head = y_up - (y_up - y);
    const double x_tail = x - x_head;
    const double y_tail = y - y_head;
    const eom_pair z = { product, (((x_head * y_head - product) + x_head * y_tail) + x_tail * y_head) + x_tail * y_tail };
    return z;
}

/* Return sums, products, quotients and roots of pairs. */
EOM_LOCAL eom_pair eom_pair_sum(eom_pair x, eom_pair y)
{
    const eom_pair s = eom_two_sum(x.high, y.high);
    const eom_pair t = eom_two_sum(x.low, y.low);
    const eom_pair v = eom_quick_sum(s.high, s.low + t.high);
    return eom_quick_sum(v.high, t.low + v.low);
}

EOM_LOCAL eom_pair eom_pair_product(eom_pair x, eom_pair y)
{
    const eom_pair c = eom_two_product(x.high, y.high);
    return eom_quick_sum(c.high, c.low + (x.high * y.low + x.low * y.high));
}

EOM_LOCAL eom_pair eom_pair_quotient(eom_pair x, eom_pair y)
{
    const double high = x.high / y.high;
    const eom_pair c = eom_two_product(y.high, high);
    const eom_pair t = eom_quick_sum(c.high, y.low * high);
    const eom_pair r = eom_quick_sum(t.high, t.low + c.low);
    return eom_quick_sum(high, ((x.high - r.high) + (x.low - r.low)) / y.high);
}

EOM_LOCAL eom_pair eom_pair_root(eom_pair x)
{
    const double high = sqrt(x.high);
    const eom_pair square = eom_two_product(high, high);
    const double rest = ((x.high - square.high) - square.low) + x.low;
    return eom_quick_sum(high, (high > 0.0) ? (rest / (2.0 * high)) : 0.0);
}

EOM_INLINE eom_pair eom_pair_negative(eom_pair x)
{
    const eom_pair z = { -x.high, -x.low };
    return z;
}

/* Return the sine of x + quarter pi/2, within 2 DD_UNIT: of the rest r of the nearest multiple of pi/2, below 0.786, the sine is
 * r + r (r^2 S), S of terms that are a tenth of r, or 1 + r^2 C. */
EOM_LOCAL eom_pair eom_pair_sine(eom_pair x, int quarter)
{
    const double quarters = floor(x.high * 0x1.45f306dc9c883p-1 + 0.5);
    if (!((x.high <= DD_FARTHEST) && (x.high >= -DD_FARTHEST))) {
        const eom_pair none = { NAN, NAN };
        return none;
    }
    eom_pair r = x;
    for (int i = 0; i < 3; ++i) { r = eom_pair_sum(r, eom_pair_negative(eom_two_product(quarters, eom_quarter[i]))); }
    const int turns = (int)(quarters - 4.0 * floor(quarters / 4.0)) + quarter;
    const int is_cosine = turns % 2;
    const eom_pair z = eom_pair_product(r, r);
    const eom_pair *const term = (is_cosine != 0) ? eom_cosine_terms : eom_sine_terms;
    const int terms = (is_cosine != 0) ? DD_COSINE_TERMS : DD_SINE_TERMS;
    eom_pair sum = term[0];
    for (int i = 1; i < terms; ++i) { sum = eom_pair_sum(eom_pair_product(sum, z), term[i]); }
    const eom_pair one = { 1.0, 0.0 };
    sum = eom_pair_product(sum, z);
    sum = (is_cosine != 0) ? eom_pair_sum(sum, one) : eom_pair_sum(eom_pair_product(sum, r), r);
    return ((turns % 4) >= 2) ? eom_pair_negative(sum) : sum;
}

/* Bound the size of a pair from above and, beside the bound of its error, from below. */
EOM_INLINE double eom_above(eom_pair x) { return fabs(x.high) + fabs(x.low); }
EOM_INLINE double eom_below(const eom_bounded *restrict x) { return (fabs(x->x.high) - fabs(x->x.low)) * (1.0 - 0x1p-48) - DD_UP(x->error); }
EOM_INLINE int eom_is_above(eom_pair x, eom_pair y) { return ((x.high > y.high) || ((x.high == y.high) && (x.low > y.low))) ? 1 : 0; }

/* Tell whether the sign of a number is sure: that of an exact one is, of 0 too. */
EOM_INLINE int eom_is_sure(const eom_bounded *restrict x) { return ((x->error <= 0.0) || (eom_below(x) > 0.0)) ? 1 : 0; }

/* Tell whether a number is exactly 0, and say the least error of a product or quotient: none where a factor or the dividend is. */
EOM_INLINE int eom_is_nothing(const eom_bounded *restrict x) { return ((x->error <= 0.0) && (fabs(x->x.high) <= 0.0)) ? 1 : 0; }
EOM_INLINE double eom_least_error(int is_nothing) { return (is_nothing != 0) ? 0.0 : DD_LEAST; }

/* Bound the error of a quotient, by its size. */
EOM_LOCAL double eom_error_of_quotient(const eom_bounded *restrict x, const eom_bounded *restrict y, double size)
{
    const double below = eom_below(y);
    const double least = eom_least_error(eom_is_nothing(x));
    return (below > 0.0) ? (DD_UP(x->error + DD_UP(size + least) * y->error) / below + DD_UNIT * size + least) : INFINITY;
}

/* Bound the error of a root: what an argument is off by over the root, or its own root; of what may be negative there is none. */
EOM_LOCAL double eom_error_of_root(const eom_bounded *restrict x, eom_pair found)
{
    const double least = fabs(found.high) - fabs(found.low);
    const double wide = sqrt(DD_UP(x->error));
    const double moved = (least > 0.0) ? fmin(DD_UP(x->error) / least, wide) : wide;
    return moved + DD_UNIT * eom_above(found) + DD_LEAST;
}

/* Return functions that the C library computes of the high part, corrected by the low one, with bounds. */
EOM_LOCAL eom_bounded eom_exponential(const eom_bounded *restrict x)
{
    const double high = exp(x->x.high);
    eom_bounded z = { { 0.0, 0.0 }, high * (DD_CALLED + DD_UP(x->error * exp(x->error))) + DD_LEAST };
    z.x = eom_quick_sum(high, high * x->x.low);
    return z;
}

EOM_LOCAL eom_bounded eom_logarithm(const eom_bounded *restrict x)
{
    const double high = log(x->x.high);
    const double below = eom_below(x);
    const double moved = (below > 0.0) ? (x->error / below) : INFINITY;
    eom_bounded z = { { 0.0, 0.0 }, DD_CALLED * fabs(high) + moved + DD_UNIT };
    z.x = eom_two_sum(high, x->x.low / x->x.high);
    return z;
}

/* Return the angle of the point (x, y); 1.58 > pi/2 is the arc over its chord.  Across the negative axis it jumps by 2 pi. */
EOM_LOCAL eom_bounded eom_angle(const eom_bounded *restrict y, const eom_bounded *restrict x)
{
    const double angle = atan2(y->x.high, x->x.high);
    const double moved = DD_UP(fabs(y->x.low) + fabs(x->x.low) + y->error + x->error);
    const double left = fmax(fabs(y->x.high), fabs(x->x.high)) * (1.0 - 0x1p-48) - moved;
    const double cut = ((x->x.high > 0.0) || (eom_below(y) > 0.0)) ? 0.0 : 6.2832;
    eom_bounded z = { { angle, 0.0 }, (left > 0.0) ? (1.58 * moved / left + DD_CALLED * fabs(angle) + cut) : 6.2832 };
    if (isnan(angle + moved) != 0) { z.error = NAN; }
    return z;
}

/* Return the larger one, y where it is, as of doubles, with its own error where it is so for sure; 1 where greater than 0, else 0;
 * x or y, as the gate is greater than 0. */
EOM_LOCAL eom_bounded eom_larger(const eom_bounded *restrict x, const eom_bounded *restrict y)
{
    eom_bounded z = (eom_is_above(y->x, x->x) != 0) ? *y : *x;
    eom_bounded apart = { { 0.0, 0.0 }, 0.0 };
    apart.x = eom_pair_sum(x->x, eom_pair_negative(y->x));
    apart.error = x->error + y->error + DD_UNIT * eom_above(apart.x);
    if (eom_is_sure(&apart) == 0) { z.error = (x->error >= y->error) ? x->error : y->error; }
    if (isnan(x->error + y->error) != 0) { z.error = NAN; }
    return z;
}

EOM_LOCAL eom_bounded eom_positive(const eom_bounded *restrict x)
{
    const eom_bounded z = { { (x->x.high > 0.0) ? 1.0 : 0.0, 0.0 }, (eom_is_sure(x) != 0) ? 0.0 : 1.0 };
    return z;
}

EOM_LOCAL eom_bounded eom_choice(const eom_bounded *restrict gate, const eom_bounded *restrict x, const eom_bounded *restrict y)
{
    eom_bounded z = (gate->x.high > 0.0) ? *x : *y;
    if (eom_is_sure(gate) == 0) { z.error = x->error + y->error + DD_UP(eom_above(eom_pair_sum(x->x, eom_pair_negative(y->x)))); }
    return z;
}

/* Compute the value of one operation on others, with the bound of its error. */
EOM_LOCAL eom_bounded eom_extended_value(int operation, const eom_bounded *restrict x, const eom_bounded *restrict y, const eom_bounded *restrict other)
{
    const eom_pair nothing = { 0.0, 0.0 };
    eom_bounded z = *x;
    switch (operation) {
    case DD_NEG:
        z.x = eom_pair_negative(x->x);
        break;
    case DD_ADD:
    case DD_SUB:
        z.x = eom_pair_sum(x->x, (operation == DD_SUB) ? eom_pair_negative(y->x) : y->x);
        z.error = x->error + y->error + DD_UNIT * eom_above(z.x);
        break;
    case DD_MUL:
        z.x = eom_pair_product(x->x, y->x);
        z.error = eom_above(x->x) * y->error + (eom_above(y->x) + y->error) * x->error + DD_UNIT * eom_above(z.x) + eom_least_error(((eom_is_nothing(x) != 0) || (eom_is_nothing(y) != 0)) ? 1 : 0);
        break;
    case DD_DIV:
        z.x = eom_pair_quotient(x->x, y->x);
        z.error = eom_error_of_quotient(x, y, eom_above(z.x));
        break;
    case DD_SIN:
    case DD_COS:
        z.x = eom_pair_sine(x->x, (operation == DD_COS) ? 1 : 0);
        z.error = isnan(z.x.high) ? NAN : (x->error + 2.0 * DD_UNIT);
        break;
    case DD_SQRT:
        z.x = eom_pair_root(x->x);
        z.error = eom_error_of_root(x, z.x);
        break;
    case DD_ABS:
        if (eom_is_above(nothing, x->x) != 0) { z.x = eom_pair_negative(x->x); }
        break;
    case DD_MAX:
        z = eom_larger(x, y);
        break;
    case DD_STEP:
        z = eom_positive(x);
        break;
    case DD_CHOOSE:
        z = eom_choice(x, y, other);
        break;
    case DD_EXP:
        z = eom_exponential(x);
        break;
    case DD_LOG:
        z = eom_logarithm(x);
        break;
    default:
        z = eom_angle(x, y);
        break;
    }
    z.error = DD_UP(z.error);
    return z;
}

/* Write results: high parts, then low parts, then bounds, results of each; a bound holds for the sum of both parts as they are written. */
EOM_LOCAL void EOM(write_extended)(int results, const unsigned short *restrict result, const eom_bounded *restrict value, EOM_SCALAR *restrict out)
{
    for (int i = 0; i < results; ++i) {
        const eom_bounded *const z = &value[result[i]];
        const EOM_SCALAR high = (EOM_SCALAR)z->x.high;
        const double rest = (z->x.high - (double)high) + z->x.low;
        const EOM_SCALAR low = (EOM_SCALAR)rest;
#if defined(EOM_SINGLE)
        const double error = DD_UP(z->error + fabs(rest - (double)low) + 0x1p-52 * fabs(rest));
        out[2 * results + i] = (error > 0.0) ? ((float)(error * (1.0 + 0x1p-22)) + 0x1p-149F) : (float)error;
#else
        out[2 * results + i] = z->error;
#endif
        out[i] = high;
        out[results + i] = low;
    }
}

/* Run a program on arrays, with so many values as it has places: the size of value. */
EOM_LOCAL void EOM(run_extended)(const eom_extended_program *restrict program, const EOM_SCALAR *const *restrict array, eom_bounded *restrict value, EOM_SCALAR *restrict out)
{
    for (int i = 0; i < program->steps; ++i) {
        const unsigned short *const step = program->step[i];
        eom_bounded *const z = &value[step[1]];
        if (step[0] == (unsigned short)DD_CONST) {
            const eom_bounded number = { { program->constant[step[2]], 0.0 }, 0.0 };
            *z = number;
        } else if (step[0] == (unsigned short)DD_INPUT) {
            const double radius = (step[4] > 0U) ? fabs((double)array[step[4]][step[3]]) : 0.0;
            const eom_bounded number = { { (double)array[step[2]][step[3]], 0.0 }, radius };
            *z = number;
        } else {
            *z = eom_extended_value((int)step[0], &value[step[2]], &value[step[3]], &value[step[4]]);
        }
    }
    EOM(write_extended)(program->results, program->result, value, out);
}

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC pop_options
#endif
#endif
