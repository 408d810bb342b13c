/* operations.h: functions of the operations of programs, of one number and of vectors, and constants of sines and
 * cosines.
 * Generated from codegen/program/operations.py by `make operations`; included by lanes.h. */
#if defined(EOM_SINGLE)
#define EOM_LARGEST_ANGLE 5000.0f
#define EOM_TWO_OVER_PI 0.63661975f /* 2/pi */
#define EOM_ROUNDING_SHIFT 12582912.0f /* brings a number's units into the lowest bits */
#define EOM_REDUCED_ANGLE(x, k) ((x) - (k)*1.5703125f - (k)*0.0004837513f - (k)*7.5495336e-08f - (k)*2.563344e-12f)
#define EOM_SIN_SERIES(z) (-0.16666655f + (z)*(0.008332161f + (z)*-0.00019515296f))
#define EOM_COS_SERIES(z) (0.041666646f + (z)*(-0.0013887316f + (z)*2.4433157e-05f))
#else
#define EOM_LARGEST_ANGLE 1000000.0
#define EOM_TWO_OVER_PI 0.6366197723675814 /* 2/pi */
#define EOM_ROUNDING_SHIFT 6755399441055744.0 /* brings a number's units into the lowest bits */
#define EOM_REDUCED_ANGLE(x, k) ((x) - (k)*1.5707963267341256 - (k)*6.077100506303966e-11 - (k)*2.0222662487959506e-21)
#define EOM_SIN_SERIES(z) (-0.16666666666666632 + (z)*(0.00833333333332249 + (z)*(-0.0001984126982985795 + \
    (z)*(2.7557313707070068e-06 + (z)*(-2.5050760253406863e-08 + (z)*1.58969099521155e-10)))))
#define EOM_COS_SERIES(z) (0.0416666666666666 + (z)*(-0.001388888888887411 + (z)*(2.480158728947673e-05 + \
    (z)*(-2.7557314351390663e-07 + (z)*(2.087572321298175e-09 + \
    (z)*-1.1359647557788195e-11)))))
#endif

EOM_INLINE EOM_SCALAR eom_abs(EOM_SCALAR x) { return EOM_MATH(fabs)(x); }
EOM_INLINE EOM_SCALAR eom_max(EOM_SCALAR x, EOM_SCALAR y) { return (x < y) ? y : x; }
EOM_INLINE EOM_SCALAR eom_heaviside(EOM_SCALAR x) { return (x > EOM_C(0.0)) ? EOM_C(1.0) : EOM_C(0.0); }
EOM_INLINE EOM_SCALAR eom_select(EOM_SCALAR gate, EOM_SCALAR x, EOM_SCALAR y) { return (gate > EOM_C(0.0)) ? x : y; }
EOM_INLINE EOM_SCALAR eom_sqrt(EOM_SCALAR x) { return EOM_MATH(sqrt)(x); }
EOM_INLINE EOM_SCALAR eom_atan2(EOM_SCALAR y, EOM_SCALAR x) { return EOM_MATH(atan2)(y, x); }
EOM_INLINE EOM_SCALAR eom_exp(EOM_SCALAR x) { return EOM_MATH(exp)(x); }
EOM_INLINE EOM_SCALAR eom_log(EOM_SCALAR x) { return EOM_MATH(log)(x); }

#if EOM_VECTOR_BYTES
EOM_INLINE lanes eom_abs_lanes(lanes x)
{
    const lanes none = { EOM_C(0.0) };
    return (lanes)((bits)x & ~(bits)-none);
}
EOM_INLINE lanes eom_max_lanes(lanes x, lanes y)
{
    const bits holds = (bits)(x < y);
    return (lanes)((holds & (bits)y) | (~holds & (bits)x));
}
EOM_INLINE lanes eom_heaviside_lanes(lanes x)
{
    const lanes none = { EOM_C(0.0) };
    return (lanes)((bits)(x > none) & (bits)(none + EOM_C(1.0)));
}
EOM_INLINE lanes eom_select_lanes(lanes gate, lanes x, lanes y)
{
    const lanes none = { EOM_C(0.0) };
    const bits holds = (bits)(gate > none);
    return (lanes)((holds & (bits)x) | (~holds & (bits)y));
}
#else
EOM_INLINE lanes eom_abs_lanes(lanes x) { return eom_abs(x); }
EOM_INLINE lanes eom_max_lanes(lanes x, lanes y) { return eom_max(x, y); }
EOM_INLINE lanes eom_heaviside_lanes(lanes x) { return eom_heaviside(x); }
EOM_INLINE lanes eom_select_lanes(lanes gate, lanes x, lanes y) { return eom_select(gate, x, y); }
#endif
EOM_INLINE lanes eom_sqrt_lanes(lanes x)
{
    lanes value = x;
    for (int l = 0; l < EOM_LANES; ++l) { EOM_LANE(value, l) = eom_sqrt(EOM_LANE(x, l)); }
    return value;
}
EOM_INLINE lanes eom_atan2_lanes(lanes y, lanes x)
{
    lanes value = y;
    for (int l = 0; l < EOM_LANES; ++l) { EOM_LANE(value, l) = eom_atan2(EOM_LANE(y, l), EOM_LANE(x, l)); }
    return value;
}
EOM_INLINE lanes eom_exp_lanes(lanes x)
{
    lanes value = x;
    for (int l = 0; l < EOM_LANES; ++l) { EOM_LANE(value, l) = eom_exp(EOM_LANE(x, l)); }
    return value;
}
EOM_INLINE lanes eom_log_lanes(lanes x)
{
    lanes value = x;
    for (int l = 0; l < EOM_LANES; ++l) { EOM_LANE(value, l) = eom_log(EOM_LANE(x, l)); }
    return value;
}
