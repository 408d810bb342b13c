/* one_link.c: equations of motion of the robot one_link, written by eomgen 0.1.0.
 * What the arrays hold is said in one_link.h.  No heap, no state: every call is re-entrant.
 * Equation numbers are those of the paper "Mathematics Model for 6-DOF Joints Manipulation Robots". */
#include "one_link.h"

#include <math.h>
#include <string.h>

#if defined(__GNUC__)
#define EOMGEN_PART static __attribute__((noinline))
#else
#define EOMGEN_PART static
#endif

#if !defined(EOMGEN_VECTOR) /* bytes of a vector; 0 for none; the few angles of one state fill no wide one */
#if defined(__GNUC__) && defined(__AVX512F__) && !defined(EOMGEN_SINGLES_ONLY)
#define EOMGEN_VECTOR 64
#elif defined(__GNUC__) && defined(__AVX__)
#define EOMGEN_VECTOR 32
#elif defined(__GNUC__) && (defined(__SSE2__) || defined(__ARM_NEON))
#define EOMGEN_VECTOR 16
#else
#define EOMGEN_VECTOR 0
#endif
#endif

#if EOMGEN_VECTOR
typedef double lanes __attribute__((vector_size(EOMGEN_VECTOR)));
typedef long long bits __attribute__((vector_size(EOMGEN_VECTOR)));
#define LANES (EOMGEN_VECTOR / 8)
#define EOMGEN_HELPER static __attribute__((unused))
#else
typedef double lanes;
#define LANES 1
#define EOMGEN_HELPER static
#endif
#define PADDED(count) (((count) + LANES - 1) / LANES * LANES)

/* Sines and cosines of count angles, a multiple of LANES; within 2.5 units in the last place.
 * The nearest multiple of pi/2 is taken off in parts, and the rest goes into the polynomials of
 * fdlibm (Sun Microsystems 1993).  Angles beyond 1e6 are left to the library. */
EOMGEN_HELPER void turn(const double *restrict angle, size_t count, double *restrict sine, double *restrict cosine)
{
#if EOMGEN_VECTOR
    bits far = { 0 };
    long long any = 0;
    for (size_t i = 0; i < count; i += LANES) {
        lanes x;
        (void)memcpy(&x, angle + i, sizeof x);
        far |= (bits)(x > 1e6) | (bits)(x < -1e6);
        const lanes shifted = x*0.63661977236758134308 + 0x1.8p52;
        const lanes quarters = shifted - 0x1.8p52;
        const lanes r = x - quarters*0x1.921fb544p+0 - quarters*0x1.0b4611a6p-34 - quarters*0x1.3198a2e037073p-69;
        const lanes z = r*r;
        const lanes s = r + r*z*(-1.66666666666666324348e-01 + z*(8.33333333332248946124e-03 + z*(-1.98412698298579493134e-04 + z*(2.75573137070700676789e-06 + z*(-2.50507602534068634195e-08 + z*1.58969099521155010221e-10)))));
        const lanes c = 1.0 - z*(0.5 - z*(4.16666666666666019037e-02 + z*(-1.38888888888741095749e-03 + z*(2.48015872894767294178e-05 + z*(-2.75573143513906633035e-07 + z*(2.08757232129817482790e-09 + z*-1.13596475577881948265e-11))))));
        const bits quarter = (bits)shifted, odd = (bits)((quarter & 1) != 0);
        const bits s_bits = (odd & (bits)c) | (~odd & (bits)s), c_bits = (odd & (bits)s) | (~odd & (bits)c);
        const bits s_signed = s_bits ^ ((quarter & 2) << 62), c_signed = c_bits ^ (((quarter + 1) & 2) << 62);
        (void)memcpy(sine + i, &s_signed, sizeof s_signed);
        (void)memcpy(cosine + i, &c_signed, sizeof c_signed);
    }
    for (int l = 0; l < LANES; ++l) { any |= far[l]; }
    if (any == 0) { return; }
#endif
    for (size_t i = 0; i < count; ++i) {
#if EOMGEN_VECTOR
        if (angle[i] <= 1e6 && angle[i] >= -1e6) { continue; }
#endif
        sine[i] = sin(angle[i]);
        cosine[i] = cos(angle[i]);
    }
}

#if !defined(EOMGEN_BATCHES_ONLY) || defined(EOMGEN_SETUP)

/* What depends on parameters alone: h holds p, then what kernels read of it. */
void one_link_setup(const double *restrict p, double *restrict h)
{
    (void)p;
    (void)h;

    h[0] = p[0];
    h[1] = p[1];
    h[2] = p[2];
    h[3] = p[3];
    h[4] = 0.5*p[3];
    h[5] = -p[2];
    h[6] = 0.5*p[2];
}
#endif

#if !defined(EOMGEN_BATCHES_ONLY) /* one state at a time */

/* 0, or 1 + i for the first coordinate i whose pivot vanishes beside its scale; NaN counts as vanished. */
static int one_link_failed(const double *restrict pivot)
{
    for (int i = 0; i < 2; ++i) {
        if (!(pivot[2 * i] > 1e-12 * pivot[2 * i + 1])) { return 1 + i; }
    }
    return 0;
}

/* Mass matrix M(q), eq. (11). */
int one_link_mass_matrix(const double *restrict h, const double *restrict q, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)h;

    out[0] = 1.0;
    out[3] = 0.3333333333333333;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = -0.5*sine[0];
    out[2] = out[1];

    return 0;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
int one_link_bias_force(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)h;

    out[1] = 0.0;
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = cosine[0]*(-0.5*(v[1]*v[1]));

    return 0;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
int one_link_generalized_force(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)v;

    const double t12 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = -0.5*t12;
    out[0] = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t12 - q[0]*h[3];

    return 0;
}

/* Q_F of eq. (14), its moment term corrected; base axes. */
int one_link_external_force(const double *restrict h, const double *restrict q, const double *restrict wrench, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)h;

    const double t11 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[1] = wrench[5] + 0.5*t11;
    out[0] = cosine[0]*(cosine[0]*wrench[0] + sine[0]*wrench[1]) - sine[0]*t11;

    return 0;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
int one_link_residual(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, const double *restrict u, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t12 = a[0] - h[0];
    const double t18 = sine[0]*t12 + h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const double t31 = cosine[0]*(cosine[0]*t12 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t18);
    out[0] = t31 + q[0]*h[3] - u[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t18 - u[1];

    return 0;
}

/* The drives u that make the residual zero. */
int one_link_inverse_dynamics(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t10 = a[0] - h[0];
    const double t16 = sine[0]*t10 + h[1]*cosine[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t16;
    /* joint1: traces against its tangents, eq. (5) */
    const double t29 = cosine[0]*(cosine[0]*t10 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t16);
    out[0] = t29 + q[0]*h[3];

    return 0;
}

/* Accelerations under the drives u. */
int one_link_forward_dynamics(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, double *restrict out)
{
    double pivot[4];
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    pivot[1] = 1.0;
    pivot[2] = 0.3333333333333333;
    pivot[3] = 0.3333333333333333;
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t15 = h[0]*sine[0] - h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const double t23 = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0] + 0.5*(v[1]*v[1])) + sine[0]*t15;
    const double t27 = u[1] - 0.5*t15;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    const double t31 = 1.5*sine[0];
    const double t34 = 1.0 - 0.5*sine[0]*t31;
    pivot[0] = t34;
    const double t38 = 1.0/t34*(u[0] - (q[0]*h[3] - t23) + t27*t31);
    out[0] = t38;
    out[1] = 3.0*t27 + t31*t38;

    return one_link_failed(pivot);
}

/* Derivatives of the residual by q, v and a: three matrices. */
int one_link_residual_jacobian(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    out[0] = h[3];
    out[2] = 0.0;
    out[4] = 0.0;
    out[6] = 0.0;
    out[8] = 1.0;
    out[11] = 0.3333333333333333;
    /* link1: velocity, acceleration, and what they are to the tangents of joint1 */
    const double t10 = a[0] - h[0];
    const double t13 = v[0]*cosine[0];
    /* joint1: rows and columns of the derivatives of eq. (5) */
    const double t33 = sine[0]*(0.5*(v[1]*v[1]) - (cosine[0]*t10 - h[1]*sine[0])) - cosine[0]*(0.5*a[1] - (sine[0]*t10 + h[1]*cosine[0]));
    const double t34 = 0.5*cosine[0];
    const double t35 = 0.5*sine[0];
    out[5] = cosine[0]*(2.0*(v[0]*sine[0]) - v[1]) - sine[0]*(2.0*t13);
    out[9] = -t35;
    out[10] = out[9];
    out[7] = t13 - 2.0*v[0]*t34;
    out[3] = h[1]*t35 - t10*t34;
    out[1] = t33 - h[1];

    return 0;
}

/* Derivatives of the accelerations by q, v and u: three matrices. */
int one_link_forward_dynamics_jacobian(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, double *restrict out)
{
    double pivot[4];
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    pivot[1] = 1.0;
    pivot[2] = 0.3333333333333333;
    pivot[3] = 0.3333333333333333;
    out[4] = 0.0;
    out[6] = 0.0;
    const double t4 = 0.5*sine[0];
    const double t6 = 1.5*sine[0];
    const double t8 = 1.0 - t4*t6;
    pivot[0] = t8;
    const double t11 = 1.0/t8;
    out[8] = t11;
    out[0] = -(h[3]*t11);
    const double t14 = t6*t11;
    out[10] = t14;
    out[9] = t14;
    out[2] = -(h[3]*t14);
    const double t25 = h[1]*sine[0];
    const double t29 = 0.5*(v[1]*v[1]);
    const double t33 = h[1]*cosine[0];
    const double t34 = h[0]*sine[0] - t33;
    const double t38 = u[0] - (q[0]*h[3] - (cosine[0]*(h[0]*cosine[0] + t25 + t29) + sine[0]*t34));
    const double t41 = u[1] - 0.5*t34;
    const double t44 = t11*(t38 + t41*t6);
    const double t45 = t44 - h[0];
    const double t59 = sine[0]*(cosine[0]*t45 - t25 - t29) + cosine[0]*(0.5*(3.0*t41 + t6*t44) - (t33 + sine[0]*t45));
    const double t60 = h[1] + t59;
    const double t63 = 0.5*cosine[0];
    const double t65 = h[1]*t4 - t63*t45;
    out[1] = t11*t60 - t65*t14;
    const double t70 = 3.0 + t6*t14;
    out[11] = t70;
    out[3] = t60*t14 - t65*t70;
    const double t75 = v[0]*cosine[0];
    const double t82 = sine[0]*(2.0*t75) + cosine[0]*(v[1] - 2.0*(v[0]*sine[0]));
    const double t86 = t75 - t63*(2.0*v[0]);
    out[5] = t11*t82 - t86*t14;
    out[7] = t82*t14 - t86*t70;

    return one_link_failed(pivot);
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
int one_link_coriolis_matrix(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)h;

    out[0] = 0.0;
    out[2] = 0.0;
    const double t5 = v[0]*cosine[0];
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = cosine[0]*(v[0]*sine[0] - 0.5*v[1]) - sine[0]*t5;
    out[3] = 0.5*t5 - v[0]*(0.5*cosine[0]);

    return 0;
}

/* Christoffel symbols of the first kind, the tensor C of eq. (12). */
int one_link_christoffel(const double *restrict h, const double *restrict q, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)h;

    out[0] = 0.0;
    out[1] = 0.0;
    out[2] = 0.0;
    out[4] = 0.0;
    out[5] = 0.0;
    out[6] = 0.0;
    out[7] = 0.0;
    out[3] = -0.5*cosine[0];

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
int one_link_energy(const double *restrict h, const double *restrict q, const double *restrict v, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    const double t8 = v[0]*cosine[0];
    const double t9 = v[0]*sine[0];
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(0.3333333333333333*v[1] - 0.5*t9));
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*cosine[0]) + h[1]*(0.5*sine[0]));

    return 0;
}

/* Force and moment on each joint's child link, moved joint's axes. */
int one_link_reactions(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    out[2] = h[5];
    out[3] = 0.0;
    out[4] = h[6];
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const double t9 = a[0] - h[0];
    const double t15 = sine[0]*t9 + h[1]*cosine[0];
    out[0] = cosine[0]*t9 - h[1]*sine[0] - 0.5*(v[1]*v[1]);
    out[1] = 0.5*a[1] - t15;
    out[5] = 0.3333333333333333*a[1] - 0.5*t15;

    return 0;
}

/* What external wrenches add to the reactions, moved joint's axes. */
int one_link_external_reactions(const double *restrict h, const double *restrict q, const double *restrict wrench, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)h;

    const double t14 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[4] = 0.5*wrench[2] - (cosine[0]*wrench[4] - sine[0]*wrench[3]);
    out[0] = -(cosine[0]*wrench[0] + sine[0]*wrench[1]);
    out[1] = -t14;
    out[2] = -wrench[2];
    out[3] = -(cosine[0]*wrench[3] + sine[0]*wrench[4]);
    out[5] = -(wrench[5] + 0.5*t14);

    return 0;
}

/* Y of inverse dynamics without springs and dampers, u = Y theta; loops cut. */
int one_link_regressor(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out)
{
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    out[3] = 0.0;
    out[4] = 0.0;
    out[5] = 0.0;
    out[6] = 0.0;
    out[7] = 0.0;
    out[8] = 0.0;
    out[9] = 0.0;
    out[10] = 0.0;
    out[11] = 0.0;
    out[14] = 0.0;
    out[15] = 0.0;
    out[16] = 0.0;
    out[17] = 0.0;
    out[18] = 0.0;
    out[19] = 0.0;
    out[20] = a[1];
    out[21] = out[20];
    const double t8 = a[0] - h[0];
    const double t11 = cosine[0]*t8 - h[1]*sine[0];
    const double t14 = sine[0]*t8 + h[1]*cosine[0];
    out[12] = -t14;
    const double t16 = v[1]*v[1];
    /* link1: motions of its frame per unit rates, and columns of its inertial parameters */
    out[1] = -(cosine[0]*t16 + a[1]*sine[0]);
    out[2] = sine[0]*t16 - a[1]*cosine[0];
    out[0] = cosine[0]*t11 + sine[0]*t14;
    out[13] = -t11;

    return 0;
}

/* Cosine of beta of every joint with three angles, 1 for the others. */
int one_link_euler_cosines(const double *restrict h, const double *restrict q, double *restrict out)
{
    (void)h;
    (void)q;

    out[0] = 1.0;

    return 0;
}

/* (M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step. */
static int one_link_implicit_step(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict u, const double *restrict added, const double *restrict dt, double *restrict out)
{
    double pivot[4];
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);

    const double t16 = h[3]*dt[1];
    /* joint1: eliminated, from the tips to the base */
    const double t23 = added[1] + 0.3333333333333333;
    pivot[2] = t23;
    pivot[3] = t23;
    const double t25 = 1.0/t23;
    const double t26 = u[1]*t25;
    const double t33 = sine[0]*(1.0 - (1.0 - 0.25*t25));
    const double t35 = 1.0 - sine[0]*t33;
    const double t40 = t16 + t35;
    pivot[0] = t40;
    pivot[1] = t16 + 1.0;
    const double t42 = 1.0/t40;
    const double t43 = u[0] - h[3]*(q[0] + v[0]*dt[0]) + (cosine[0]*(0.5*(v[1]*v[1])) + sine[0]*(0.5*t26));
    /* joint1: accelerations, from the base to the tips */
    const double t50 = t42*t43 + (h[0]*(t35*t42) + h[1]*(cosine[0]*t33*t42));
    out[0] = t50;
    out[1] = t26 + 0.5*t25*(sine[0]*(t50 - h[0]) + h[1]*cosine[0]);

    return one_link_failed(pivot);
}

/* Factors of M + c B + c^2 K, for the stages of a Rosenbrock method. */
static int one_link_stage_factors(const double *restrict h, const double *restrict q, const double *restrict v, const double *restrict kp, const double *restrict kd, const double *restrict times, double *restrict out)
{
    double pivot[4];
    const double angle[PADDED(1)] = { q[1] };
    double sine[PADDED(1)];
    double cosine[PADDED(1)];
    turn(angle, PADDED(1), sine, cosine);
    (void)v;

    out[0] = sine[0];
    const double t5 = h[3]*times[1];
    out[1] = t5;
    out[2] = h[3]*times[0];
    const double t11 = times[0]*kd[1] + times[1]*kp[1];
    out[3] = t11;
    out[4] = times[0]*kp[1];
    /* joint1: eliminated, from the tips to the base */
    const double t14 = t11 + 0.3333333333333333;
    pivot[2] = t14;
    pivot[3] = t14;
    const double t16 = 1.0/t14;
    out[5] = t16;
    out[6] = 0.5*t16;
    const double t26 = t5 + (1.0 - sine[0]*(sine[0]*(1.0 - (1.0 - 0.25*t16))));
    pivot[0] = t26;
    pivot[1] = t5 + 1.0;
    out[7] = 1.0/t26;

    return one_link_failed(pivot);
}

/* w of (M + c B + c^2 K) w = -((c B + c^2 K) rates + c K shifts). */
static int one_link_stage_solution(const double *restrict h, const double *restrict kept, const double *restrict rates, const double *restrict shifts, double *restrict out)
{
    (void)h;

    /* joint1: eliminated, from the tips to the base */
    const double t16 = (rates[1]*kept[3] + shifts[1]*kept[4])*kept[5];
    const double t23 = kept[7]*(rates[0]*kept[1] + shifts[0]*kept[2] + kept[0]*(0.5*t16));
    out[0] = -t23;
    /* joint1: accelerations, from the base to the tips */
    out[1] = -(t16 + kept[6]*(kept[0]*t23));

    return 0;
}

EOMGEN_PART void one_link_kinematics0(const double *restrict q, const double *restrict sine, const double *restrict cosine, int last, double *restrict origins, double *restrict axes, double *restrict kept)
{
    origins[0] = q[0];
    origins[1] = 0.0;
    origins[2] = 0.0;
    axes[1] = 0.0;
    axes[2] = 0.0;
    axes[3] = 0.0;
    axes[4] = 0.0;
    axes[0] = 1.0;
    axes[5] = 1.0;
    kept[0] = cosine[0];
    kept[2] = sine[0];
    if (last <= 0) { return; }
    kept[1] = -sine[0];
}

EOMGEN_PART void one_link_kinematics1(const double *restrict q, const double *restrict given, double *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = 0.0;
    pose[6] = 0.0;
    pose[8] = 0.0;
    pose[9] = 0.0;
    pose[11] = 0.0;
    pose[4] = given[2];
    pose[7] = pose[4];
    pose[10] = 1.0;
    pose[3] = q[0] + given[0];
}

EOMGEN_PART void one_link_kinematics2(double *restrict pose)
{
    pose[0] = 1.0;
    pose[5] = 1.0;
    pose[10] = 1.0;
    pose[1] = 0.0;
    pose[2] = 0.0;
    pose[3] = 0.0;
    pose[4] = 0.0;
    pose[6] = 0.0;
    pose[7] = 0.0;
    pose[8] = 0.0;
    pose[9] = 0.0;
    pose[11] = 0.0;
}

EOMGEN_PART void one_link_kinematics3(const double *restrict q, const double *restrict given, double *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = 0.0;
    pose[6] = 0.0;
    pose[7] = 0.0;
    pose[8] = 0.0;
    pose[9] = 0.0;
    pose[11] = 0.0;
    pose[3] = q[0];
    pose[4] = given[2];
    pose[10] = 1.0;
}

/* Pose [R | X] of a frame; origins of the bodies between the base and it, and axes of their coordinates; eqs. (1)-(3).
 * Nodes are the base, the bodies, and the frames, each behind its body; several bodies may be a run.  Sines and cosines
 * on the way are taken at once. */
static void one_link_on_the_way(const double *restrict h, const double *restrict q, int frame, double *restrict pose, double *restrict origins, double *restrict axes)
{
    static const int run_of[5] = { 0, 0, 1, 2, 3 };
    static const int behind[4] = { -1, 1, 0, 1 };
    int way[2];
    int count = 0;
    double kept[3];
    const double *const given = kept;
    static const int turned[5] = { 0, 1, 0, 0, 0 };
    static const int first[4] = { 0, 1, 1, 1 };
    static const int place[1] = { 1 };
    double turning[PADDED(1)] = { 0 };
    double sines[PADDED(1)];
    double cosines[PADDED(1)];
    int angles = 0;
    int done = 0;
    (void)h;
    (void)q;
    (void)given;
    for (int node = 2 + frame; node >= 0; node = behind[run_of[node]]) { way[count] = node; ++count; }
    for (int i = count - 1; i >= 0; --i) {
        const int *const own = &place[first[run_of[way[i]]]];
        for (int k = 0; k < turned[way[i]]; ++k) { turning[angles] = q[own[k]]; ++angles; }
    }
    const int padded = PADDED(angles);
    turn(turning, (size_t)padded, sines, cosines);
    while (count > 0) {
        --count;
        const int last = way[count];
        const double *const sine = &sines[done];
        const double *const cosine = &cosines[done];
        done += turned[last];
        switch (run_of[last]) {
        case 0: one_link_kinematics0(q, sine, cosine, last, origins, axes, kept); break;
        case 1: one_link_kinematics1(q, given, pose); break;
        case 2: one_link_kinematics2(pose); break;
        case 3: one_link_kinematics3(q, given, pose); break;
        default: break;
        }
    }
}

/* Pose of a frame in the base, 4x4; eqs. (1) and (2). */
int one_link_frame_pose(const double *restrict h, const double *restrict q, int frame, double *restrict out)
{
    double origins[3];
    double axes[6];
    one_link_on_the_way(h, q, frame, out, origins, axes);
    for (int i = 12; i < 15; ++i) { out[i] = 0.0; }
    out[15] = 1.0;
    return 0;
}

/* Linear velocity of a frame's origin (rows 0 to 2) and angular velocity (rows 3 to 5) per coordinate, base axes. */
int one_link_frame_jacobian(const double *restrict h, const double *restrict q, int frame, double *restrict out)
{
    static const int body_of[3] = { 0, -1, 0 };
    static const int parent[1] = { -1 };
    static const int first[1] = { 0 };
    static const int count[1] = { 2 };
    static const int is_rotation[2] = { 0, 1 };
    double pose[12];
    double origins[3];
    double axes[6];
    one_link_on_the_way(h, q, frame, pose, origins, axes);
    for (int i = 0; i < 12; ++i) { out[i] = 0.0; }
    for (int body = body_of[frame]; body >= 0; body = parent[body]) {
        const double *origin = &origins[3 * body];
        const double arm[3] = { pose[3] - origin[0], pose[7] - origin[1], pose[11] - origin[2] };
        for (int s = first[body]; s < first[body] + count[body]; ++s) {
            const double *axis = &axes[3 * s];
            if (is_rotation[s] != 0) {
                out[s] = axis[1] * arm[2] - axis[2] * arm[1];
                out[2 + s] = axis[2] * arm[0] - axis[0] * arm[2];
                out[4 + s] = axis[0] * arm[1] - axis[1] * arm[0];
                for (int i = 0; i < 3; ++i) { out[(3 + i) * 2 + s] = axis[i]; }
            } else {
                for (int i = 0; i < 3; ++i) { out[i * 2 + s] = axis[i]; }
            }
        }
    }
    return 0;
}

static void one_link_load(const double *restrict x, size_t step, size_t here, double *restrict y)
{
    (void)step;
    (void)here;
    (void)memcpy(y, x, 2U * sizeof *y);
}

static void one_link_store(const double *restrict x, size_t here, size_t stride, double *restrict y)
{
    (void)here;
    (void)stride;
    (void)memcpy(y, x, 2U * sizeof *x);
}

/* Clip drives at +-effort; slope, if it is not NULL, becomes 0 where they are clipped, else 1. */
static void one_link_saturated(const one_link_drive *restrict drive, double *restrict u, double *restrict slope)
{
    for (int i = 0; i < 2; ++i) {
        const double most = drive->effort[i];
        const int over = ((u[i] > most) || (u[i] < -most)) ? 1 : 0;
        if (slope != NULL) { slope[i] = (over != 0) ? 0.0 : 1.0; }
        if (over != 0) { u[i] = (u[i] > most) ? most : -most; }
    }
}

/* Drives at a step: u + kp (target - q - ahead v) - kd v, within their efforts; slope as of one_link_saturated. */
static void one_link_drives(const one_link_drive *restrict drive, size_t state, size_t here, size_t step, const double *restrict q, const double *restrict v, double ahead, double *restrict u, double *restrict slope)
{
    one_link_load(&drive->u[state * drive->u_state + step * drive->u_step], drive->u_state, here, u);
    if (drive->kp != NULL) {
        double target[2];
        one_link_load(&drive->target[state * drive->target_state + step * drive->target_step], drive->target_state, here, target);
        for (int i = 0; i < 2; ++i) {
            u[i] += drive->kp[i] * (target[i] - q[i] - ahead * v[i]) - drive->kd[i] * v[i];
        }
    }
    if (drive->effort != NULL) { one_link_saturated(drive, u, slope); }
}

/* One step of the classical Runge-Kutta method, drives held. */
static int one_link_rk4(const double *restrict h, const one_link_drive *restrict drive, size_t state, size_t here, size_t step, double dt, double *restrict q, double *restrict v)
{
    static const double part[4] = { 0.5, 0.5, 1.0, 0.0 };
    static const double weight[4] = { 1.0, 2.0, 2.0, 1.0 };
    double u[2];
    double a[2];
    double q_here[2];
    double v_here[2];
    double q_sum[2];
    double v_sum[2];
    for (int i = 0; i < 2; ++i) {
        q_here[i] = q[i];
        v_here[i] = v[i];
        q_sum[i] = 0.0;
        v_sum[i] = 0.0;
    }
    for (int stage = 0; stage < 4; ++stage) {
        one_link_drives(drive, state, here, step, q_here, v_here, 0.0, u, NULL);
        const int status = one_link_forward_dynamics(h, q_here, v_here, u, a);
        if (status != 0) { return status; }
        for (int i = 0; i < 2; ++i) {
            q_sum[i] += weight[stage] * v_here[i];
            v_sum[i] += weight[stage] * a[i];
            q_here[i] = q[i] + part[stage] * dt * v_here[i];
            v_here[i] = v[i] + part[stage] * dt * a[i];
        }
    }
    for (int i = 0; i < 2; ++i) {
        q[i] += dt / 6.0 * q_sum[i];
        v[i] += dt / 6.0 * v_sum[i];
    }
    return 0;
}

/* One linearly implicit step: springs, dampers and the controller at its end, all else at its beginning. */
static int one_link_implicit(const double *restrict h, const one_link_drive *restrict drive, size_t state, size_t here, size_t step, double dt, double *restrict q, double *restrict v)
{
    double u[2];
    double a[2];
    double added[2];
    double slope[2];
    double times[2];
    times[0] = dt;
    times[1] = dt * dt;
    for (int i = 0; i < 2; ++i) {
        added[i] = (drive->kp == NULL) ? 0.0 : dt * (drive->kd[i] + dt * drive->kp[i]);
    }
    one_link_drives(drive, state, here, step, q, v, dt, u, slope);
    for (int i = 0; (drive->effort != NULL) && (i < 2); ++i) { added[i] *= slope[i]; }
    const int status = one_link_implicit_step(h, q, v, u, added, times, a);
    if (status != 0) { return status; }
    for (int i = 0; i < 2; ++i) {
        v[i] += dt * a[i];
        q[i] += dt * v[i];
    }
    return 0;
}

/* Steps from one state to the next; every so many are stored.  -1, or step * states in a call + what the step said. */
static long long one_link_steps(const double *restrict h, const one_link_drive *restrict drive, size_t state, size_t here, double dt, size_t steps, size_t every, int method, double *restrict q, double *restrict v, double *restrict q_out, double *restrict v_out)
{
    const size_t stride = (steps / every + 1U) * 2U;
    one_link_store(q, here, stride, q_out);
    one_link_store(v, here, stride, v_out);
    for (size_t step = 0; step < steps; ++step) {
        const int status = method == 0 ? one_link_rk4(h, drive, state, here, step, dt, q, v)
                                       : one_link_implicit(h, drive, state, here, step, dt, q, v);
        if (status != 0) { return (long long)step * 2 + status - 1; }
        if ((step + 1U) % every == 0U) {
            one_link_store(q, here, stride, &q_out[(step + 1U) / every * 2U]);
            one_link_store(v, here, stride, &v_out[(step + 1U) / every * 2U]);
        }
    }
    return -1;
}

/* One state over many steps. */
long long one_link_rollout(const double *restrict h, const double *restrict q, const double *restrict v, const one_link_drive *restrict drive, double dt, size_t steps, size_t every, int method, double *restrict q_out, double *restrict v_out)
{
    double q_here[2];
    double v_here[2];
    (void)memcpy(q_here, q, sizeof q_here);
    (void)memcpy(v_here, v, sizeof v_here);
    return one_link_steps(h, drive, 0, 1, dt, steps, every, method, q_here, v_here, q_out, v_out);
}

#ifndef EOMGEN_LOADS
#define EOMGEN_LOADS

/* A time, and one beside it by which pieces of signals are chosen: where signals jump, both sides have their own. */
typedef struct {
    double t;
    double beside;
} one_link_instant;

/* A time that is its own side: behind what jumps there. */
static one_link_instant one_link_instant_of(double t)
{
    one_link_instant at;
    at.t = t;
    at.beside = t;
    return at;
}

/* When drives and wrenches are asked. */
static one_link_instant one_link_between_ends(const one_link_loads *restrict loads, one_link_instant at)
{
    one_link_instant found;
    found.t = (at.t < loads->first) ? loads->first : ((at.t > loads->last) ? loads->last : at.t);
    found.beside = (at.beside < loads->first) ? loads->first : ((at.beside > loads->last) ? loads->last : at.beside);
    return found;
}

/* How many of the times at which loads jump are not behind t. */
static size_t one_link_stops_until(const one_link_loads *restrict loads, double t)
{
    size_t low = 0U;
    size_t high = loads->stops;
    while (low < high) {
        const size_t middle = low + (high - low) / 2U;
        if (loads->stop[middle] <= t) { low = middle + 1U; } else { high = middle; }
    }
    return low;
}

/* Whether loads jump at t. */
static int one_link_jumps_at(const one_link_loads *restrict loads, double t)
{
    const size_t count = one_link_stops_until(loads, t);
    return ((count > 0U) && !(loads->stop[count - 1U] < t)) ? 1 : 0;
}

/* The piece of a signal at a time, and how far that is from its beginning; not inside before the first and behind the last. */
static int one_link_piece(const one_link_signal *restrict signal, one_link_instant at, double *restrict ahead, int *restrict inside)
{
    const double *const knot = signal->knot;
    int low = 0;
    int high = signal->pieces;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (at.beside < knot[middle]) { high = middle; } else { low = middle; }
    }
    *inside = ((at.beside >= knot[0]) && (at.beside <= knot[signal->pieces])) ? 1 : 0;
    *ahead = (at.beside < knot[low]) ? 0.0 : ((at.beside > knot[low + 1]) ? (knot[low + 1] - knot[low]) : (at.t - knot[low]));
    return low;
}

/* Columns of a signal at a time, its rates and accelerations, without its profile. */
static void one_link_column(const one_link_signal *restrict signal, one_link_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    double ahead = 0.0;
    int inside = 0;
    const int piece = one_link_piece(signal, at, &ahead, &inside);
    const size_t columns = (size_t)signal->columns;
    const double *const own = &signal->coefficient[(size_t)piece * ((size_t)signal->degree + 1U) * columns];
    for (size_t i = 0; i < columns; ++i) {
        double value = 0.0;
        double rate = 0.0;
        double half = 0.0;
        for (int power = signal->degree; power >= 0; --power) {
            half = half * ahead + rate;
            rate = rate * ahead + value;
            value = value * ahead + own[(size_t)power * columns + i];
        }
        x[i] = value;
        dx[i] = (inside != 0) ? rate : 0.0;
        ddx[i] = (inside != 0) ? (2.0 * half) : 0.0;
    }
}

/* What a signal's profile puts in the place of a time, with its rate and acceleration there. */
static one_link_instant one_link_profiled(const one_link_signal *restrict profile, one_link_instant at, double *restrict ds, double *restrict dds)
{
    one_link_instant found;
    double rate = 0.0;
    double second = 0.0;
    one_link_column(profile, one_link_instant_of(at.beside), &found.beside, &rate, &second);
    one_link_column(profile, at, &found.t, ds, dds);
    return found;
}

/* Columns of a signal at a time, its rates and accelerations. */
static void one_link_signal_at(const one_link_signal *restrict signal, one_link_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    if (signal->profile == NULL) {
        one_link_column(signal, at, x, dx, ddx);
    } else {
        double ds = 0.0;
        double dds = 0.0;
        one_link_column(signal, one_link_profiled(signal->profile, at, &ds, &dds), x, dx, ddx);
        for (int i = 0; i < signal->columns; ++i) {
            ddx[i] = ddx[i] * ds * ds + dx[i] * dds;
            dx[i] = dx[i] * ds;
        }
    }
}

/* Coordinates, rates and accelerations of prescribed coordinates at a time. */
static void one_link_given_at(const one_link_given *restrict given, one_link_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    for (int i = 0; i < given->size; ++i) {
        const double *const wave = &given->wave[4 * i];
        const double angle = wave[1] * at.t + wave[2];
        const double part = wave[0] * sin(angle);
        x[i] = wave[3] + part;
        dx[i] = wave[0] * wave[1] * cos(angle);
        ddx[i] = -(wave[1] * wave[1]) * part;
    }
    for (int k = 0; k < given->count; ++k) {
        double own[2];
        double rate[2];
        double acceleration[2];
        one_link_signal_at(given->tracks[k].signal, at, own, rate, acceleration);
        for (int i = 0; i < given->tracks[k].signal->columns; ++i) {
            x[given->tracks[k].place[i]] = own[i];
            dx[given->tracks[k].place[i]] = rate[i];
            ddx[given->tracks[k].place[i]] = acceleration[i];
        }
    }
}

/* What drives do by a program, added to u, and what they ask a model of the robot: q, v and a, 2 numbers each. */
static void one_link_controlled(const one_link_loads *restrict loads, one_link_instant at, const double *restrict q, const double *restrict v, const double *restrict given, double *restrict u, double *restrict asked)
{
    const one_link_control *const control = loads->control;
    const one_link_model *const model = loads->model;
    double x[2];
    double dx[2];
    double ddx[2];
    one_link_signal_at(control->program.signal, at, x, dx, ddx);
    if (control->kp != NULL) {
        for (int i = 0; i < control->program.signal->columns; ++i) {
            const int place = control->program.place[i];
            const double ratio = control->ratio[i];
            u[place] += (control->kp[i] * (x[i] - q[place] / ratio) + control->kd[i] * (dx[i] - v[place] / ratio)) / ratio;
        }
    }
    if (model != NULL) {
        double *const q_model = asked;
        double *const v_model = &asked[2];
        double *const a_model = &asked[4];
        for (int i = 0; i < model->size; ++i) {
            const int column = model->column[i];
            q_model[i] = q[model->place[i]] / model->ratio[i];
            v_model[i] = (model->holds != 0) ? 0.0 : (v[model->place[i]] / model->ratio[i]);
            a_model[i] = 0.0;
            if (model->holds == 0) {
                if (column >= 0) {
                    a_model[i] = ddx[column] + model->bandwidth * (model->bandwidth * (x[column] - q_model[i]) + 2.0 * (dx[column] - v_model[i]));
                } else if (model->given[i] >= 0) {
                    a_model[i] = given[model->given[i]] / model->ratio[i];
                } else {
                    a_model[i] = 0.0;
                }
            }
        }
    }
}

/* Drives at a time but for a model's, and what that is asked; motions that are given are put into q and v. */
static void one_link_asked(const one_link_loads *restrict loads, one_link_instant at, double *restrict q, double *restrict v, double *restrict u, double *restrict given, double *restrict asked)
{
    const one_link_instant between = one_link_between_ends(loads, at);
    (void)memset(given, 0, 2U * sizeof *given);
    if (loads->given != NULL) {
        double x[2];
        double dx[2];
        one_link_given_at(loads->given, at, x, dx, given);
        for (int i = 0; i < loads->given->size; ++i) {
            q[loads->given->place[i]] = x[i];
            v[loads->given->place[i]] = dx[i];
        }
    }
    if (loads->torque != NULL) {
        double force[2];
        double rate[2];
        double second[2];
        one_link_signal_at(loads->torque->signal, between, force, rate, second);
        for (int i = 0; i < loads->torque->signal->columns; ++i) { u[loads->torque->place[i]] += force[i]; }
    }
    if (loads->control != NULL) { one_link_controlled(loads, between, q, v, given, u, asked); }
}

/* Drives with what a model answers, within +-effort where there is one, and accelerations that are given; slope, if it is not
 * NULL, becomes 0 where they are clipped, else 1. */
static void one_link_answered(const one_link_loads *restrict loads, const double *restrict given, const double *restrict answer, double *restrict u, double *restrict slope)
{
    const one_link_model *const model = (loads->control == NULL) ? NULL : loads->model;
    if (model != NULL) {
        for (int i = 0; i < model->size; ++i) {
            if (model->given[i] < 0) { u[model->place[i]] += answer[i] / model->ratio[i]; }
        }
    }
    for (int i = 0; (loads->effort != NULL) && (i < 2); ++i) {
        const double most = loads->effort[i];
        if (slope != NULL) { slope[i] = ((u[i] > most) || (u[i] < -most)) ? 0.0 : 1.0; }
        u[i] = (u[i] > most) ? most : ((u[i] < -most) ? -most : u[i]);
    }
    if (loads->given != NULL) {
        for (int i = 0; i < loads->given->size; ++i) { u[loads->given->place[i]] = given[i]; }
    }
}

/* Wrenches at a time on all links, in the base's axes. */
static void one_link_pulling(const one_link_loads *restrict loads, one_link_instant at, const double *restrict q, double *restrict total)
{
    const one_link_instant between = one_link_between_ends(loads, at);
    (void)memset(total, 0, 6U * sizeof *total);
    for (size_t k = 0; k < loads->wrenches; ++k) {
        const one_link_wrench *const wrench = &loads->wrench[k];
        double row[6];
        double rate[6];
        double second[6];
        (void)memset(row, 0, sizeof row);
        if ((wrench->t0 <= between.beside) && (between.beside < wrench->t1)) { one_link_signal_at(wrench->signal, between, row, rate, second); }
        if (wrench->frame >= 0) {
            double pose[16];
            double arm[3];
            double turned[6];
            (void)loads->frame_pose(loads->frame_h, q, wrench->frame, pose);
            for (int i = 0; i < 3; ++i) {
                const double along[3] = { pose[4 * i], pose[4 * i + 1], pose[4 * i + 2] };
                arm[i] = along[0] * wrench->arm[0] + along[1] * wrench->arm[1] + along[2] * wrench->arm[2];
                turned[i] = (wrench->turns != 0) ? (along[0] * row[0] + along[1] * row[1] + along[2] * row[2]) : row[i];
                turned[3 + i] = (wrench->turns != 0) ? (along[0] * row[3] + along[1] * row[4] + along[2] * row[5]) : row[3 + i];
            }
            turned[3] += arm[1] * turned[2] - arm[2] * turned[1];
            turned[4] += arm[2] * turned[0] - arm[0] * turned[2];
            turned[5] += arm[0] * turned[1] - arm[1] * turned[0];
            (void)memcpy(row, turned, sizeof row);
        }
        for (int i = 0; i < 6; ++i) { total[6 * wrench->link + i] += row[i]; }
    }
}

/* Add forces of wrenches to drives. */
static void one_link_push(const double *restrict force, double *restrict u)
{
    for (int i = 0; i < 2; ++i) {
        u[i] += force[i];
    }
}

/* Powers of drives and of wrenches, and what dampers and friction take, W. */
static void one_link_powers(const one_link_work *restrict work, const double *restrict q, const double *restrict v, const double *restrict u, const double *restrict pushed, double *restrict power)
{
    double own[2];
    double rate[2];
    double rest[2];
    double still[2];
    double moving[2];
    (void)memset(rest, 0, sizeof rest);
    for (int i = 0; i < 2; ++i) {
        own[i] = q[i];
        rate[i] = v[i];
    }
    (void)work->generalized_force(work->passive_h, own, rest, still);
    (void)work->generalized_force(work->passive_h, own, rate, moving);
    for (int w = 0; w < 4; ++w) { power[w] = 0.0; }
    for (int i = 0; i < 2; ++i) {
        power[2] += pushed[i] * v[i];
        power[3] += (still[i] - moving[i]) * v[i];
        power[0] += u[i] * v[i];
    }
}

/* What wrenches do at a time, on all coordinates; ``here`` is h in which joints are as they are in q. */
static void one_link_wrenched(const one_link_loads *restrict loads, const double *here, one_link_instant at, const double *restrict q, double *restrict force)
{
    double own[2];
    double total[6];
    double found[2];
    for (int i = 0; i < 2; ++i) { own[i] = q[i]; }
    one_link_pulling(loads, at, own, total);
    (void)loads->external_force((loads->force_h == NULL) ? here : loads->force_h, own, total, found);
    for (int i = 0; i < 2; ++i) { force[i] = found[i]; }
}
#endif /* EOMGEN_LOADS */

/* Where lanes are in their steps: from when on, how long and to when, with times inside beside both ends where loads jump
 * there, the next such time, and by which loads, NULL for all or for none; powers of all stages, where works are asked for. */
typedef struct {
    const one_link_loads *loads[1];
    double *power;
    double begin[1];
    double step[1];
    double end[1];
    double after[1];
    double before[1];
    double stop[1];
    int here;
} one_link_clock;

/* Time at a share of a lane's step; at its ends, and of stages outside, with one that is inside. */
static one_link_instant one_link_instant_at(const one_link_clock *restrict clock, int l, double share)
{
    one_link_instant at;
    at.t = (share < 1.0 || share > 1.0) ? (clock->begin[l] + share * clock->step[l]) : clock->end[l];
    at.beside = (share > 0.0) ? ((share < 1.0) ? at.t : clock->before[l]) : clock->after[l];
    return at;
}

/* What a model of the robot, if drives know one, is asked by lanes, each its own: 6 numbers, and what it answers. */
static void one_link_modelled(const one_link_clock *restrict clock, const double *restrict asked, double *restrict force)
{
    for (int l = 0; l < clock->here; ++l) {
        const one_link_model *const model = (clock->loads[l]->control == NULL) ? NULL : clock->loads[l]->model;
        const double *const own = &asked[6 * l];
        if (model == NULL) { continue; }
        (void)model->inverse_dynamics(model->h, own, &own[2], &own[4], &force[2 * l]);
    }
}

/* Add what loads do at a part of lanes' steps to the forces, and put given motions into q and v; powers are a stage's. */
static void one_link_timed(const double *here, const one_link_clock *restrict clock, double share, int stage, double *restrict q, double *restrict v, double *restrict force, double *restrict slope)
{
    double own[1][2];
    double rate[1][2];
    double u[1][2];
    double given[1][2];
    double asked[1][6];
    double answer[1][2];
    one_link_instant t[1];
    for (int l = 0; l < clock->here; ++l) {
        for (int i = 0; i < 2; ++i) {
            own[l][i] = q[i];
            rate[l][i] = v[i];
            u[l][i] = force[i];
        }
    }
    for (int l = 0; l < clock->here; ++l) {
        t[l] = one_link_instant_at(clock, l, share);
        one_link_asked(clock->loads[l], t[l], own[l], rate[l], u[l], given[l], asked[l]);
    }
    one_link_modelled(clock, asked[0], answer[0]);
    int moved = 0;
    for (int l = 0; l < clock->here; ++l) {
        double inside[2];
        one_link_answered(clock->loads[l], given[l], answer[l], u[l], inside);
        if (slope != NULL) {
            for (int i = 0; i < 2; ++i) { slope[i] = (clock->loads[l]->effort == NULL) ? 1.0 : inside[i]; }
        }
        double pushed[2];
        (void)memset(pushed, 0, sizeof pushed);
        if (clock->loads[l]->wrenches > 0U) { one_link_wrenched(clock->loads[l], here, t[l], own[l], pushed); }
        if (clock->power != NULL) {
            double power[4];
            one_link_powers(clock->loads[l]->work, own[l], rate[l], u[l], pushed, power);
            for (int w = 0; w < 4; ++w) { clock->power[stage * 4 + w] = power[w]; }
        }
        if (clock->loads[l]->wrenches > 0U) { one_link_push(pushed, u[l]); }
        if (clock->loads[l]->given != NULL) { moved = 1; }
    }
    for (int l = 0; l < clock->here; ++l) {
        for (int i = 0; i < 2; ++i) {
            force[i] = u[l][i];
            if (moved != 0) {
                q[i] = own[l][i];
                v[i] = rate[l][i];
            }
        }
    }
}

/* Put given motions of a lane at a time into q and v. */
static void one_link_moves_to(const one_link_clock *restrict clock, int l, one_link_instant at, double *restrict q, double *restrict v)
{
    const one_link_given *const given = (clock->loads[l] == NULL) ? NULL : clock->loads[l]->given;
    double x[2];
    double dx[2];
    double ddx[2];
    if (given == NULL) { return; }
    one_link_given_at(given, at, x, dx, ddx);
    for (int k = 0; k < given->size; ++k) {
        const int i = given->place[k];
        q[i] = x[k];
        v[i] = dx[k];
    }
}

/* Put given motions at the ends of lanes' steps into q and v, as steps come to them; they have no error. */
static void one_link_placed(const one_link_clock *restrict clock, double *restrict q, double *restrict v, double *restrict error)
{
    for (int l = 0; l < clock->here; ++l) {
        const one_link_given *const given = (clock->loads[l] == NULL) ? NULL : clock->loads[l]->given;
        one_link_moves_to(clock, l, one_link_instant_at(clock, l, 1.0), q, v);
        for (int k = 0; (given != NULL) && (k < given->size); ++k) {
            const int i = given->place[k];
            error[i] = 0.0;
            error[2 + i] = 0.0;
        }
    }
}

/* Whether drives are clipped. */
static int one_link_clips(const one_link_drive *restrict drive, const one_link_clock *restrict clock)
{
    return (clock->loads[0] != NULL) ? (clock->loads[0]->effort != NULL) : (drive->effort != NULL);
}

/* Forces u + kp (target - q) - kd v and those of loads, drives within their efforts; slope, if it is not NULL, becomes 0 where
 * these are clipped, else 1. */
static void one_link_forces(const double *restrict h, const one_link_drive *restrict drive, const one_link_clock *restrict clock, double share, int stage, const double *restrict u, const double *restrict target, double *restrict q, double *restrict v, double *restrict force, double *restrict slope)
{
    for (int i = 0; i < 2; ++i) {
        force[i] = u[i];
        if (drive->kp != NULL) { force[i] += drive->kp[i] * (target[i] - q[i]) - drive->kd[i] * v[i]; }
    }
    if ((clock->loads[0] == NULL) && (drive->effort != NULL)) { one_link_saturated(drive, force, slope); }
    (void)h;
    if (clock->loads[0] != NULL) { one_link_timed(h, clock, share, stage, q, v, force, slope); }
}

/* Accelerations under these forces; what cannot be solved is seen in the error that it makes. */
static void one_link_accelerated(const double *restrict h, const one_link_drive *restrict drive, const one_link_clock *restrict clock, double share, int stage, const double *restrict u, const double *restrict target, double *restrict q, double *restrict v, double *restrict a)
{
    double force[2];
    one_link_forces(h, drive, clock, share, stage, u, target, q, v, force, NULL);
    (void)one_link_forward_dynamics(h, q, v, force, a);
}

/* One step of the Rosenbrock method from accelerations a, with the factors of its matrix, which are kept; the end, and
 * the error, first of q, then of v. */
static void one_link_rosenbrock(const double *restrict h, const one_link_drive *restrict drive, const one_link_clock *restrict clock, const double *restrict u, const double *restrict target, double dt, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict q_end, double *restrict v_end, double *restrict kept, double *restrict error)
{
    const double inverse = 1.0 / dt;
    double times[2];
    double kp[2];
    double kd[2];
    double right[2];
    double shifts[2];
    double w[2];
    double q_part[6][2];
    double v_part[6][2];
    times[0] = 0.3032708221029452 * dt;
    times[1] = times[0] * times[0];
    for (int i = 0; i < 2; ++i) {
        kp[i] = (drive->kp == NULL) ? 0.0 : drive->kp[i];
        kd[i] = (drive->kp == NULL) ? 0.0 : drive->kd[i];
    }
    for (int l = 0; (l < clock->here) && (clock->loads[0] != NULL); ++l) {
        const one_link_control *const control = clock->loads[l]->control;
        if ((control == NULL) || (control->kp == NULL)) { continue; }
        for (int k = 0; k < control->program.signal->columns; ++k) {
            const double ratio = control->ratio[k] * control->ratio[k];
            const int i = control->program.place[k];
            kp[i] += (control->kp[k] / ratio);
            kd[i] += (control->kd[k] / ratio);
        }
    }
    if (one_link_clips(drive, clock) != 0) { /* what is clipped does not answer to the state */
        double q_here[2];
        double v_here[2];
        double slope[2];
        (void)memcpy(q_here, q, sizeof q_here);
        (void)memcpy(v_here, v, sizeof v_here);
        one_link_forces(h, drive, clock, 0.0, 7, u, target, q_here, v_here, right, slope);
        for (int i = 0; i < 2; ++i) {
            kp[i] *= slope[i];
            kd[i] *= slope[i];
        }
    }
    (void)one_link_stage_factors(h, q, v, kp, kd, times, kept);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v[i];
        right[i] = a[i];
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[0][i] = times[0] * (right[i] + w[i]);
        q_part[0][i] = times[0] * (v_part[0][i] + shifts[i]);
    }
    if (clock->power != NULL) { (void)memcpy(&clock->power[4], clock->power, (size_t)(4) * sizeof *clock->power); }
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v[i] + inverse * (-1.8485366682621636 * q_part[0][i]);
        right[i] = a[i] + inverse * (-1.8485366682621636 * v_part[0][i]);
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[1][i] = times[0] * (right[i] + w[i]);
        q_part[1][i] = times[0] * (v_part[1][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 1.9577095275421397 * q_part[0][i] + 0.09624753940753493 * q_part[1][i];
        v_end[i] = v[i] + 1.9577095275421397 * v_part[0][i] + 0.09624753940753493 * v_part[1][i];
    }
    one_link_accelerated(h, drive, clock, 0.6065416442058904, 2, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (-17.631601587128756 * q_part[0][i] + 10.558804728186503 * q_part[1][i]);
        right[i] = right[i] + inverse * (-17.631601587128756 * v_part[0][i] + 10.558804728186503 * v_part[1][i]);
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[2][i] = times[0] * (right[i] + w[i]);
        q_part[2][i] = times[0] * (v_part[2][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + -12.640540988794982 * q_part[0][i] + 11.47406531595545 * q_part[1][i] + -2.184901588069644 * q_part[2][i];
        v_end[i] = v[i] + -12.640540988794982 * v_part[0][i] + 11.47406531595545 * v_part[1][i] + -2.184901588069644 * v_part[2][i];
    }
    one_link_accelerated(h, drive, clock, -0.35634633722581177, 3, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (43.65182054686954 * q_part[0][i] + -40.087802443765035 * q_part[1][i] + 10.279818576010475 * q_part[2][i]);
        right[i] = right[i] + inverse * (43.65182054686954 * v_part[0][i] + -40.087802443765035 * v_part[1][i] + 10.279818576010475 * v_part[2][i]);
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[3][i] = times[0] * (right[i] + w[i]);
        q_part[3][i] = times[0] * (v_part[3][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 45.22669571531797 * q_part[0][i] + -34.051994120856214 * q_part[1][i] + 9.233342776456102 * q_part[2][i] + -2.585735849637662 * q_part[3][i];
        v_end[i] = v[i] + 45.22669571531797 * v_part[0][i] + -34.051994120856214 * v_part[1][i] + 9.233342776456102 * v_part[2][i] + -2.585735849637662 * v_part[3][i];
    }
    one_link_accelerated(h, drive, clock, 1.1568159026419864, 4, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (-105.84058964242176 * q_part[0][i] + 89.65494156265976 * q_part[1][i] + -24.593504310310063 * q_part[2][i] + 8.468103283975356 * q_part[3][i]);
        right[i] = right[i] + inverse * (-105.84058964242176 * v_part[0][i] + 89.65494156265976 * v_part[1][i] + -24.593504310310063 * v_part[2][i] + 8.468103283975356 * v_part[3][i]);
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[4][i] = times[0] * (right[i] + w[i]);
        q_part[4][i] = times[0] * (v_part[4][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 44.59618164199451 * q_part[0][i] + -35.304949600239034 * q_part[1][i] + 9.10972197560695 * q_part[2][i] + -2.286091141567749 * q_part[3][i] + 0.18287548796164538 * q_part[4][i];
        v_end[i] = v[i] + 44.59618164199451 * v_part[0][i] + -35.304949600239034 * v_part[1][i] + 9.10972197560695 * v_part[2][i] + -2.286091141567749 * v_part[3][i] + 0.18287548796164538 * v_part[4][i];
    }
    one_link_accelerated(h, drive, clock, 1.0, 5, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (-132.02707597161847 * q_part[0][i] + 97.96337774644046 * q_part[1][i] + -31.303025590584195 * q_part[2][i] + 9.868030987977615 * q_part[3][i] + -1.7691899740810053 * q_part[4][i]);
        right[i] = right[i] + inverse * (-132.02707597161847 * v_part[0][i] + 97.96337774644046 * v_part[1][i] + -31.303025590584195 * v_part[2][i] + 9.868030987977615 * v_part[3][i] + -1.7691899740810053 * v_part[4][i]);
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[5][i] = times[0] * (right[i] + w[i]);
        q_part[5][i] = times[0] * (v_part[5][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 44.59618164199451 * q_part[0][i] + -35.304949600239034 * q_part[1][i] + 9.10972197560695 * q_part[2][i] + -2.286091141567749 * q_part[3][i] + 0.1828754879616454 * q_part[4][i] + 1.0 * q_part[5][i];
        v_end[i] = v[i] + 44.59618164199451 * v_part[0][i] + -35.304949600239034 * v_part[1][i] + 9.10972197560695 * v_part[2][i] + -2.286091141567749 * v_part[3][i] + 0.1828754879616454 * v_part[4][i] + 1.0 * v_part[5][i];
        error[i] = 0.7641522361446427 * q_part[0][i] + -0.6573679684815938 * q_part[1][i] + 0.14144711229099638 * q_part[2][i] + -0.01754850566540496 * q_part[3][i] + -0.030774661879316458 * q_part[4][i] + 0.08701562938055106 * q_part[5][i];
        error[2 + i] = 0.7641522361446427 * v_part[0][i] + -0.6573679684815938 * v_part[1][i] + 0.14144711229099638 * v_part[2][i] + -0.01754850566540496 * v_part[3][i] + -0.030774661879316458 * v_part[4][i] + 0.08701562938055106 * v_part[5][i];
    }
}

/* One step of the explicit method; ``a`` holds the accelerations at its beginning, ``a_end`` becomes those at its end.  The
 * last two stages are at the same time: where ``stiffness`` is no NULL, it becomes the step times what the difference of their
 * accelerations is of that of their rates, by the tolerances (E. Hairer, G. Wanner, "Solving Ordinary Differential Equations
 * II", section IV.2). */
static void one_link_tsit5(const double *restrict h, const one_link_drive *restrict drive, const one_link_clock *restrict clock, const double *restrict u, const double *restrict target, double dt, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict q_end, double *restrict v_end, double *restrict a_end, double *restrict error, const one_link_tolerance *restrict allowed, double *restrict stiffness)
{
    double q_rate[7][2];
    double v_rate[7][2];
    for (int i = 0; i < 2; ++i) {
        q_rate[0][i] = v[i];
        v_rate[0][i] = a[i];
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (0.161 * q_rate[0][i]);
        v_end[i] = v[i] + dt * (0.161 * v_rate[0][i]);
    }
    one_link_accelerated(h, drive, clock, 0.161, 1, u, target, q_end, v_end, v_rate[1]);
    (void)memcpy(q_rate[1], v_end, sizeof q_rate[1]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (-0.008480655492356989 * q_rate[0][i] + 0.335480655492357 * q_rate[1][i]);
        v_end[i] = v[i] + dt * (-0.008480655492356989 * v_rate[0][i] + 0.335480655492357 * v_rate[1][i]);
    }
    one_link_accelerated(h, drive, clock, 0.327, 2, u, target, q_end, v_end, v_rate[2]);
    (void)memcpy(q_rate[2], v_end, sizeof q_rate[2]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (2.8971530571054935 * q_rate[0][i] + -6.359448489975075 * q_rate[1][i] + 4.3622954328695815 * q_rate[2][i]);
        v_end[i] = v[i] + dt * (2.8971530571054935 * v_rate[0][i] + -6.359448489975075 * v_rate[1][i] + 4.3622954328695815 * v_rate[2][i]);
    }
    one_link_accelerated(h, drive, clock, 0.8999999999999999, 3, u, target, q_end, v_end, v_rate[3]);
    (void)memcpy(q_rate[3], v_end, sizeof q_rate[3]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (5.325864828439257 * q_rate[0][i] + -11.748883564062828 * q_rate[1][i] + 7.4955393428898365 * q_rate[2][i] + -0.09249506636175525 * q_rate[3][i]);
        v_end[i] = v[i] + dt * (5.325864828439257 * v_rate[0][i] + -11.748883564062828 * v_rate[1][i] + 7.4955393428898365 * v_rate[2][i] + -0.09249506636175525 * v_rate[3][i]);
    }
    one_link_accelerated(h, drive, clock, 0.9800255409045104, 4, u, target, q_end, v_end, v_rate[4]);
    (void)memcpy(q_rate[4], v_end, sizeof q_rate[4]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (5.86145544294642 * q_rate[0][i] + -12.92096931784711 * q_rate[1][i] + 8.159367898576159 * q_rate[2][i] + -0.071584973281401 * q_rate[3][i] + -0.028269050394068383 * q_rate[4][i]);
        v_end[i] = v[i] + dt * (5.86145544294642 * v_rate[0][i] + -12.92096931784711 * v_rate[1][i] + 8.159367898576159 * v_rate[2][i] + -0.071584973281401 * v_rate[3][i] + -0.028269050394068383 * v_rate[4][i]);
    }
    one_link_accelerated(h, drive, clock, 1.0, 5, u, target, q_end, v_end, v_rate[5]);
    (void)memcpy(q_rate[5], v_end, sizeof q_rate[5]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (0.09646076681806523 * q_rate[0][i] + 0.01 * q_rate[1][i] + 0.4798896504144996 * q_rate[2][i] + 1.379008574103742 * q_rate[3][i] + -3.290069515436081 * q_rate[4][i] + 2.324710524099774 * q_rate[5][i]);
        v_end[i] = v[i] + dt * (0.09646076681806523 * v_rate[0][i] + 0.01 * v_rate[1][i] + 0.4798896504144996 * v_rate[2][i] + 1.379008574103742 * v_rate[3][i] + -3.290069515436081 * v_rate[4][i] + 2.324710524099774 * v_rate[5][i]);
    }
    one_link_accelerated(h, drive, clock, 1.0, 6, u, target, q_end, v_end, v_rate[6]);
    (void)memcpy(q_rate[6], v_end, sizeof q_rate[6]);
    for (int i = 0; i < 2; ++i) {
        a_end[i] = v_rate[6][i];
        error[i] = dt * (-0.001780011052225771 * q_rate[0][i] + -0.0008164344596567469 * q_rate[1][i] + 0.007880878010261995 * q_rate[2][i] + -0.1447110071732629 * q_rate[3][i] + 0.5823571654525552 * q_rate[4][i] + -0.45808210592918697 * q_rate[5][i] + 0.015151515151515152 * q_rate[6][i]);
        error[2 + i] = dt * (-0.001780011052225771 * v_rate[0][i] + -0.0008164344596567469 * v_rate[1][i] + 0.007880878010261995 * v_rate[2][i] + -0.1447110071732629 * v_rate[3][i] + 0.5823571654525552 * v_rate[4][i] + -0.45808210592918697 * v_rate[5][i] + 0.015151515151515152 * v_rate[6][i]);
    }
    if (stiffness != NULL) {
        double change = 0.0;
        double moved = 0.0;
        for (int i = 0; i < 2; ++i) {
            const double size = (double)allowed->atol[2 + i] + allowed->rtol * fabs(v_end[i]);
            const double change_v = v_rate[6][i] - v_rate[5][i];
            const double change_q = q_rate[6][i] - q_rate[5][i];
            const double by_a = change_v / size;
            const double by_v = change_q / size;
            change += by_a * by_a;
            moved += by_v * by_v;
        }
        *stiffness = (moved > 0.0) ? (clock->step[0] * sqrt(change / moved)) : HUGE_VAL; /* nothing is known of it at rest */
    }
}

/* Drives and targets that act from a sample on, into a lane. */
static void one_link_hold(const one_link_drive *restrict drive, size_t state, size_t sample, int l, double *restrict u, double *restrict target)
{
    const double *const given = &drive->u[state * drive->u_state + sample * drive->u_step];
    (void)l;
    for (int i = 0; i < 2; ++i) {
        u[i] = given[i];
        if (drive->kp != NULL) { target[i] = drive->target[state * drive->target_state + sample * drive->target_step + (size_t)i]; }
    }
}

/* The greatest error of a lane's step beside what is allowed, and which number of the state has it; NaN counts as too great. */
static double one_link_excess(const one_link_tolerance *restrict allowed, int l, const double *restrict q, const double *restrict v, const double *restrict q_end, const double *restrict v_end, const double *restrict error, int *restrict where)
{
    double worst = 0.0;
    (void)l;
    *where = 0;
    for (int i = 0; i < 4; ++i) {
        const double begin = fabs((i < 2 ? q[i] : v[i - 2]));
        const double end = fabs((i < 2 ? q_end[i] : v_end[i - 2]));
        if (!(end < HUGE_VAL)) {
            *where = i;
            return HUGE_VAL;
        }
        const double size = (double)allowed->atol[i] + allowed->rtol * (begin > end ? begin : end);
        const double ratio = fabs(error[i]) / size;
        if (!(ratio <= worst)) {
            worst = ratio;
            *where = i;
            if (!(ratio < HUGE_VAL)) { return HUGE_VAL; }
        }
    }
    return worst;
}

/* A first step, from the sizes of the state and of its change. */
static double one_link_first(const one_link_tolerance *restrict allowed, int l, const double *restrict q, const double *restrict v, const double *restrict a)
{
    double size = 0.0;
    double change = 0.0;
    (void)l;
    for (int i = 0; i < 4; ++i) {
        const double x = fabs((i < 2 ? q[i] : v[i - 2]));
        const double rate = fabs((i < 2 ? v[i] : a[i - 2]));
        const double least = (double)allowed->atol[i] + allowed->rtol * x;
        if (x / least > size) { size = x / least; }
        if (rate / least > change) { change = rate / least; }
    }
    return (size < 1e-5 || !(change > 1e-5)) ? 1e-6 : 0.01 * size / change;
}

/* What powers of a lane's stages make of a step, J: whole, or up to a share of the explicit one. */
static double one_link_worked(const double *restrict power, int work, int l, int method, double step, double share)
{
    static const double rosenbrock[6] = { 2.66325806659267, -2.291088688834055, 0.49297789757946875, -0.0611608486626099, -0.10725724877841863, 0.3032708221029452 };
    static const double tsit5[7][4] = { { 1.0, -2.763706197274826, 2.9132554618219126, -1.0530884977290216 }, { 0.0, 0.1317, -0.2234, 0.1017 }, { 0.0, 3.9302962368947516, -5.941033872131505, 2.490627285651253 }, { 0.0, -12.411077166933676, 30.33818863028232, -16.548102889244902 }, { 0.0, 37.50931341651104, -88.1789048947664, 47.37952196281928 }, { 0.0, -27.896526289197286, 65.09189467479366, -34.87065786149661 }, { 0.0, 1.5, -4.0, 2.5 } };
    double found = 0.0;
    (void)l;
    for (int stage = 0; stage < ((method == 1) ? 7 : 6); ++stage) {
        double weight = 0.0;
        for (int k = 3; k >= 0; --k) { weight = share * (weight + tsit5[stage][k]); }
        if (method != 1) { weight = rosenbrock[stage]; }
        found += weight * power[stage * 4 + work];
    }
    return step * found;
}

/* What accelerations at both ends of a step of the Rosenbrock method say of rates in between that coordinates and rates there
 * do not, as its matrix damps that: accelerations of stiff coordinates are full of their errors. */
static void one_link_bent(const double *restrict h, const double *restrict kept, double dt, const double *restrict v, const double *restrict a, const double *restrict v_end, const double *restrict a_end, double *restrict bend)
{
    const double time = 0.3032708221029452 * dt;
    double right[2];
    double shifts[2];
    double w[2];
    for (int i = 0; i < 2; ++i) {
        shifts[i] = 0.0;
        right[i] = (dt * (a[i] + a_end[i]) - (v_end[i] - v[i]) - (v_end[i] - v[i])) / time;
    }
    (void)one_link_stage_solution(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) { bend[i] = time * (right[i] + w[i]); }
}

/* A lane's state at a share of its step: of the explicit method the polynomial of degree 5 with its coordinates, rates and
 * accelerations, of the other one the cubic without the latter, and what is bent. */
static void one_link_between(double share, double step, int l, int method, const double *restrict q, const double *restrict v, const double *restrict a, const double *restrict q_end, const double *restrict v_end, const double *restrict a_end, const double *restrict bend, double *restrict q_out, double *restrict v_out)
{
    const double s = share;
    (void)l;
    for (int i = 0; i < 2; ++i) {
        const double q0 = q[i];
        const double d = q_end[i] - q0;
        const double v0 = step * v[i];
        const double v1 = step * v_end[i];
        double c2 = 3.0 * d - 2.0 * v0 - v1;
        double c3 = v0 + v1 - 2.0 * d;
        double c4 = 0.0;
        double c5 = 0.0;
        if (method == 1) {
            const double a0 = 0.5 * step * step * a[i];
            const double a1 = 0.5 * step * step * a_end[i];
            c2 = a0;
            c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 3.0 * a0 + a1;
            c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 3.0 * a0 - 2.0 * a1;
            c5 = 6.0 * d - 3.0 * (v0 + v1) - a0 + a1;
        } else {
            c4 = 0.25 * step * bend[i];
            c2 += c4;
            c3 -= 2.0 * c4;
        }
        const double place = q0 + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        const double rate = (v0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / step;
        q_out[i] = place;
        v_out[i] = rate;
    }
}

/* The works of a lane at a share of its step, J: of the explicit method by its own weights there, of the other one on the
 * cubic with powers at both ends. */
static void one_link_works_between(double share, double step, int l, int method, const double *restrict power, const double *restrict begin, const double *restrict end, double *restrict out)
{
    (void)l;
    for (int w = 0; w < 4; ++w) {
        const double d = end[w] - begin[w];
        const double p0 = step * power[w];
        const double p1 = step * power[24 + w];
        if (method == 1) {
            out[w] = begin[w] + one_link_worked(power, w, l, method, step, share);
        } else {
            out[w] = begin[w] + share * (p0 + share * (3.0 * d - 2.0 * p0 - p1 + share * (p0 + p1 - 2.0 * d)));
        }
    }
}

/* Whether powers change too much within a lane's step for its stages to say what works are: the motion, of prescribed
 * coordinates, say, or of a mass that moves freely, may be without an error nevertheless. */
static int one_link_doubtful(const double *restrict power, const double *restrict work, int l, int method, double step, double rtol)
{
    static const double wrong[2][7] = { { 0.16149752429294262, -0.18684096907609637, 0.00912393277044904, 0.013322280951927667, -0.023492070397267834, 0.02638930145804491, 0.0 }, { -0.001780011052225771, -0.0008164344596567469, 0.007880878010261995, -0.1447110071732629, 0.5823571654525552, -0.45808210592918697, 0.015151515151515152 } };
    int found = 0;
    (void)l;
    for (int w = 0; w < 4; ++w) {
        double error = 0.0;
        double top = 0.0;
        for (int stage = 0; stage < ((method == 1) ? 7 : 6); ++stage) {
            const double here = power[stage * 4 + w];
            error += wrong[method][stage] * here;
            if (fabs(here) > top) { top = fabs(here); }
        }
        if (step * fabs(error) > 10.0 * rtol * (fabs(work[w]) + step * top)) { found = 1; }
    }
    return found;
}

/* Add works of a lane between two shares of its step, J, by Gauss's rule along the polynomial on which its samples lie, on
 * halves until that changes little. */
static void one_link_reckon(const double *restrict h, const one_link_drive *restrict drive, const one_link_clock *restrict clock, const double *restrict u, const double *restrict target, int l, int method, double from, double to, double rtol, const double *restrict q, const double *restrict v, const double *restrict a, const double *restrict q_end, const double *restrict v_end, const double *restrict a_end, const double *restrict bend, double *restrict work)
{
    static const double node[5] = { 0.04691007703066802, 0.23076534494715845, 0.5, 0.7692346550528415, 0.9530899229693319 };
    static const double weight[5] = { 0.11846344252809454, 0.23931433524968324, 0.2844444444444444, 0.23931433524968324, 0.11846344252809454 };
    const double *const power = &clock->power[28];
    double last[4];
    double found[4];
    int settled = 0;
    (void)memset(last, 0, sizeof last);
    for (int pieces = 1; (pieces <= 64) && (settled == 0); pieces *= 2) {
        const double part = (to - from) / (double)pieces;
        double top[4];
        (void)memset(found, 0, sizeof found);
        (void)memset(top, 0, sizeof top);
        for (int k = 0; k < 5 * pieces; ++k) {
            const int piece = k / 5;
            const double share = from + part * ((double)piece + node[k % 5]);
            double own[2];
            double rate[2];
            double q_here[2];
            double v_here[2];
            double a_here[2];
            one_link_between(share, clock->step[l], l, method, q, v, a, q_end, v_end, a_end, bend, own, rate);
            for (int i = 0; i < 2; ++i) {
                q_here[i] = q_end[i];
                v_here[i] = v_end[i];
                q_here[i] = own[i];
                v_here[i] = rate[i];
            }
            one_link_accelerated(h, drive, clock, share, 7, u, target, q_here, v_here, a_here);
            for (int w = 0; w < 4; ++w) {
                const double here = clock->step[l] * power[w];
                found[w] += part * weight[k % 5] * here;
                if (fabs(here) > top[w]) { top[w] = fabs(here); }
            }
        }
        settled = (pieces > 1) ? 1 : 0;
        for (int w = 0; w < 4; ++w) {
            if (fabs(found[w] - last[w]) > rtol * (fabs(work[w]) + (to - from) * top[w])) { settled = 0; }
            last[w] = found[w];
        }
    }
    for (int w = 0; w < 4; ++w) { work[w] += last[w]; }
}

/* Go on with up to 1 states, those at ``place``, from where their progress is, each by steps of its own; at most so
 * many in this call.  The numbers at ``place`` behind the ones that are here are those of one of them. */
static void one_link_adapt(const double *restrict h, const one_link_drive *restrict drive, const one_link_loads *restrict loads, size_t loads_step, const one_link_tolerance *restrict allowed, size_t allowed_step, const size_t *restrict place, int here, const double *restrict times, size_t samples, int method, double *restrict q, double *restrict v, double *restrict q_out, double *restrict v_out, one_link_progress *restrict progress, one_link_record *restrict record)
{
    const size_t stride = (samples + 1U) * 2U;
    const double end = times[samples];
    const double duration = end - times[0];
    const int held = ((drive->u_step == 0U) && (drive->target_step == 0U)) ? 1 : 0;
    const int dense = held;
    const double order = method == 1 ? 0.2 : 0.25;
    double u[2];
    double target[2];
    double a[2];
    double a_end[2];
    double q_end[2];
    double v_end[2];
    double error[4];
    double kept[8];
    double bend[2];
    double dt = 1.0;
    double stiffness = 0.0;
    one_link_clock clock;
    double step[1];
    long long most = 0;
    int going[1];
    int lands[1] = { 0 };
    int halts[1] = { 0 }; /* whether loads jump where it lands */
    int taken[1];
    int known[1] = { 0 }; /* whether a has the accelerations */
    int left = 0;
    double power[32];
    const int works = ((loads != NULL) && (loads->work != NULL)) ? 1 : 0;
    for (int l = 0; l < 1; ++l) {
        one_link_progress *const p = &progress[place[l]];
        const long long own = allowed[place[l] * allowed_step].most;
        most = (own > most) ? own : most;
        going[l] = ((l < here) && (p->reason == 0)) ? 1 : 0;
        step[l] = duration;
        left += going[l];
        clock.loads[l] = (loads == NULL) ? NULL : &loads[place[l] * loads_step];
        one_link_hold(drive, place[l], ((p->sample > 0U) && (p->sample <= samples)) ? p->sample - 1U : 0U, l, u, target);
        if ((going[l] != 0) && (p->sample == 0U)) {
            for (int i = 0; i < 2; ++i) {
                q_out[place[l] * stride + (size_t)i] = q[i];
                v_out[place[l] * stride + (size_t)i] = v[i];
            }
            if (p->works != NULL) { (void)memcpy(p->works, p->work, sizeof p->work); }
            p->sample = 1;
            p->t = times[0];
            p->looked = times[0];
        }
    }
    clock.power = (works == 0) ? NULL : power;
    clock.here = 1;
    (void)memset(a_end, 0, sizeof a_end);
    (void)memset(kept, 0, sizeof kept);
    (void)memset(bend, 0, sizeof bend);
    for (long long pass = 0; (left > 0) && (pass < most) && ((record == NULL) || (record->count < record->room)); ++pass) {
        int fresh = 0;
        for (int l = 0; l < 1; ++l) {
            const one_link_progress *const p = &progress[place[l]];
            if ((going[l] != 0) && (pass >= allowed[place[l] * allowed_step].most)) {
                going[l] = 0;
                left -= 1;
            }
            clock.begin[l] = p->t;
            clock.step[l] = 0.0;
            clock.end[l] = p->t;
            clock.after[l] = p->t;
            clock.before[l] = p->t;
            clock.stop[l] = HUGE_VAL;
            if ((clock.loads[l] != NULL) && (clock.loads[l]->stops > 0U)) {
                const size_t count = one_link_stops_until(clock.loads[l], p->t);
                if (count < clock.loads[l]->stops) { clock.stop[l] = clock.loads[l]->stop[count]; }
                if (one_link_jumps_at(clock.loads[l], p->t) != 0) { clock.after[l] = p->t + 1e-7 * (((clock.stop[l] < end) ? clock.stop[l] : end) - p->t); }
            }
            if ((going[l] != 0) && (known[l] == 0)) { fresh = 1; }
        }
        if (fresh != 0) { one_link_accelerated(h, drive, &clock, 0.0, 0, u, target, q, v, a); }
        for (int l = 0; l < 1; ++l) {
            one_link_progress *const p = &progress[place[l]];
            known[l] = 1;
            if (going[l] == 0) { continue; }
            if (!(p->next > 0.0)) { p->next = one_link_first(&allowed[place[l] * allowed_step], l, q, v, a); }
            double goal = (dense != 0) ? end : times[p->sample];
            const int stops = (clock.stop[l] <= goal) ? 1 : 0;
            if (stops != 0) { goal = clock.stop[l]; }
            const double rest = goal - p->t;
            lands[l] = (p->next * 1.000001 >= rest) ? 1 : 0;
            step[l] = (lands[l] != 0) ? rest : (2.0 * p->next > rest ? 0.5 * rest : p->next);
            clock.step[l] = step[l];
            clock.end[l] = (lands[l] != 0) ? goal : (p->t + step[l]);
            halts[l] = ((lands[l] != 0) && (stops != 0)) ? 1 : 0;
            clock.before[l] = (halts[l] != 0) ? (clock.end[l] - 1e-3 * step[l]) : clock.end[l];
            dt = step[l];
        }
        if (method == 0) {
            one_link_rosenbrock(h, drive, &clock, u, target, dt, q, v, a, q_end, v_end, kept, error);
        } else {
            one_link_tsit5(h, drive, &clock, u, target, dt, q, v, a, q_end, v_end, a_end, error, &allowed[place[0] * allowed_step], ((record == NULL) || (record->stiffness == NULL)) ? NULL : &stiffness);
        }
        if (loads != NULL) { one_link_placed(&clock, q_end, v_end, error); }
        for (int l = 0; l < 1; ++l) {
            taken[l] = 0;
            if (going[l] == 0) { continue; }
            one_link_progress *const p = &progress[place[l]];
            int where = 0;
            const double excess = one_link_excess(&allowed[place[l] * allowed_step], l, q, v, q_end, v_end, error, &where);
            double factor = 0.9 * pow(excess, -order);
            taken[l] = (excess <= 1.0) ? 1 : 0;
            if ((taken[l] != 0) && (excess > 0.0)) { factor *= pow(excess, 0.06) * pow(p->excess > 0.0 ? p->excess : 1e-4, 0.08); } /* proportional-integral control */
            factor = factor > 5.0 ? 5.0 : (factor < 0.2 ? 0.2 : factor);
            if (taken[l] == 0) {
                p->rejected += 1;
                p->refused = 1;
                p->next = step[l] * factor;
                if (p->next <= 1e-14 * duration) { p->reason = 2 + where; }
            } else {
                if ((p->refused != 0) && (factor > 1.0)) { factor = 1.0; }
                p->refused = 0;
                p->excess = excess > 1e-4 ? excess : 1e-4;
                if (p->next < step[l] * factor || !(step[l] < p->next)) { p->next = step[l] * factor; }
            }
            if (p->steps + p->rejected >= p->counted + 2000) { /* work that leads nowhere is no motion */
                if (p->t - p->looked < 1e-07 * duration) { p->reason = 2 + where; }
                p->looked = p->t;
                p->counted = p->steps + p->rejected;
            }
            if (p->reason != 0) {
                taken[l] = 0;
                going[l] = 0;
                left -= 1;
            }
        }
        int inside = 0; /* whether something asks for what is within a step */
        for (int l = 0; (method != 1) && (l < 1); ++l) {
            if (taken[l] == 0) { continue; }
            if ((dense != 0) && (times[progress[place[l]].sample] < clock.end[l])) { inside = 1; }
            if ((works != 0) && (one_link_doubtful(power, progress[place[l]].work, l, method, step[l], allowed[place[l] * allowed_step].rtol) != 0)) { inside = 1; }
        }
        if (inside != 0) {
            one_link_accelerated(h, drive, &clock, 1.0, 6, u, target, q_end, v_end, a_end);
            one_link_bent(h, kept, dt, v, a, v_end, a_end, bend);
        }
        for (int l = 0; l < 1; ++l) {
            if (taken[l] == 0) { continue; }
            one_link_progress *const p = &progress[place[l]];
            const double before = p->t;
            known[l] = ((halts[l] == 0) && ((method == 1) || (inside != 0))) ? 1 : 0;
            double worked[4];
            (void)memcpy(worked, p->work, sizeof worked);
            const int reckons = (works != 0) ? one_link_doubtful(power, p->work, l, method, step[l], allowed[place[l] * allowed_step].rtol) : 0;
            double share = 0.0; /* up to which works are reckoned */
            for (int w = 0; (works != 0) && (reckons == 0) && (w < 4); ++w) { p->work[w] += one_link_worked(power, w, l, method, step[l], 1.0); }
            p->steps += 1;
            p->t = clock.end[l];
            if (step[l] > p->largest) { p->largest = step[l]; }
            if (p->steps == 1 || step[l] < p->smallest) { p->smallest = step[l]; }
            while ((p->sample <= samples) && (((lands[l] != 0) || (dense != 0)) && (times[p->sample] <= p->t))) {
                double *const q_row = &q_out[place[l] * stride + p->sample * 2U];
                double *const v_row = &v_out[place[l] * stride + p->sample * 2U];
                double *const work_row = (p->works == NULL) ? NULL : &p->works[p->sample * 4U];
                const double time = times[p->sample];
                if (reckons != 0) {
                    const double until = (time < p->t) ? ((time - before) / step[l]) : 1.0;
                    one_link_reckon(h, drive, &clock, u, target, l, method, share, until, allowed[place[l] * allowed_step].rtol, q, v, a, q_end, v_end, a_end, bend, p->work);
                    share = until;
                }
                if ((dense != 0) && (time < p->t)) {
                    one_link_between((time - before) / step[l], step[l], l, method, q, v, a, q_end, v_end, a_end, bend, q_row, v_row);
                    if ((work_row != NULL) && (reckons != 0)) { (void)memcpy(work_row, p->work, sizeof p->work); }
                    if ((work_row != NULL) && (reckons == 0)) { one_link_works_between((time - before) / step[l], step[l], l, method, power, worked, p->work, work_row); }
                } else
                {
                    if (halts[l] != 0) { one_link_moves_to(&clock, l, one_link_instant_of(p->t), q_end, v_end); }
                    for (int i = 0; i < 2; ++i) {
                        q_row[i] = q_end[i];
                        v_row[i] = v_end[i];
                    }
                    if (work_row != NULL) { (void)memcpy(work_row, p->work, sizeof p->work); }
                }
                p->sample += 1U;
                if ((held == 0) && (p->sample <= samples)) {
                    one_link_hold(drive, place[l], p->sample - 1U, l, u, target);
                    known[l] = 0;
                }
            }
            if ((reckons != 0) && (share < 1.0)) { one_link_reckon(h, drive, &clock, u, target, l, method, share, 1.0, allowed[place[l] * allowed_step].rtol, q, v, a, q_end, v_end, a_end, bend, p->work); }
            if (halts[l] != 0) { one_link_moves_to(&clock, l, one_link_instant_of(p->t), q_end, v_end); }
            for (int i = 0; i < 2; ++i) {
                q[i] = q_end[i];
                v[i] = v_end[i];
                a[i] = a_end[i];
            }
            for (int w = 0; (works != 0) && (w < 4); ++w) { power[w] = power[24 + w]; }
            if (record != NULL) {
                record->t[record->count] = p->t;
                if (record->stiffness != NULL) { record->stiffness[record->count] = stiffness; }
                for (int i = 0; i < 2; ++i) {
                    record->q[record->count * 2U + (size_t)i] = q[i];
                    record->v[record->count * 2U + (size_t)i] = v[i];
                }
                record->count += 1U;
            }
            if (p->sample > samples) {
                p->reason = 1;
                going[l] = 0;
                left -= 1;
            }
        }
    }
}

/* One state over all samples, or as far as allowed->most steps lead: q, v and progress are where it goes on then. */
int one_link_adaptive_rollout(const double *restrict h, const one_link_drive *restrict drive, const one_link_loads *restrict loads, const one_link_tolerance *restrict allowed, const double *restrict times, size_t samples, int method, double *restrict q, double *restrict v, double *restrict q_out, double *restrict v_out, one_link_progress *restrict progress, one_link_record *restrict record)
{
    const size_t place = 0;
    one_link_adapt(h, drive, loads, 0, allowed, 0, &place, 1, times, samples, method, q, v, q_out, v_out, progress, record);
    return progress->reason;
}

/* Drives of loads at times, and accelerations that are given; motions that are given are put into q and v. */
void one_link_loaded(size_t count, const one_link_loads *restrict loads, const double *restrict times, double *restrict q, double *restrict v, double *restrict u)
{
    for (size_t k = 0; k < count; ++k) {
        one_link_clock clock;
        double own[2];
        double rate[2];
        double force[2];
        double given[2];
        double asked[6];
        double answer[2];
        for (int i = 0; i < 2; ++i) {
            const size_t place = k * 2U + (size_t)i;
            own[i] = q[place];
            rate[i] = v[place];
            force[i] = 0.0;
        }
        clock.loads[0] = loads;
        clock.here = 1;
        one_link_asked(loads, one_link_instant_of(times[k]), own, rate, force, given, asked);
        one_link_modelled(&clock, asked, answer);
        one_link_answered(loads, given, answer, force, NULL);
        for (int i = 0; i < 2; ++i) {
            const size_t place = k * 2U + (size_t)i;
            q[place] = own[i];
            v[place] = rate[i];
            u[place] = force[i];
        }
    }
}

#endif /* one state at a time */

#if !defined(EOMGEN_SINGLES_ONLY) /* several states at a time: the same statements on vectors, a state in every lane */

#if EOMGEN_VECTOR
#define LANE(x, l) ((x)[l])
#define ALL(x) ((x) - (lanes){ 0.0 })
#else
#define LANE(x, l) (x)
#define ALL(x) (x)
#endif
#define LINE (64 / 8) /* numbers that memory brings at once */
#define AHEAD (LANES < 8 ? 8 : LANES) /* so many states later is what memory is asked for */
#define MANY ((size_t)1 << 24) /* bytes of results: beyond that they hardly stay in a cache */

#if EOMGEN_VECTOR && defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define EOMGEN_TRANSPOSE
#if LANES == 2
/* A square of numbers turned over: LANES numbers of LANES states that lie step apart, a state in every lane of y.
 * If there are more, memory is asked for what lies ahead: it comes while these are computed. */
static inline void turned(const double *restrict x, size_t step, int more, lanes *restrict y)
{
    lanes x0, x1;
    memcpy(&x0, x + 0 * step, sizeof(lanes));
    memcpy(&x1, x + 1 * step, sizeof(lanes));
    if (more) {
        __builtin_prefetch(x + (AHEAD + 0) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 1) * step, 0, 3);
    }
    const lanes y1_0 = __builtin_shufflevector(x0, x1, 0, 2);
    const lanes y1_1 = __builtin_shufflevector(x0, x1, 1, 3);

    y[0] = y1_0;
    y[1] = y1_1;
}

/* The other way: number i of a state is x[place[i]], or x[i] without places. */
static inline void turned_back(const lanes *restrict x, const unsigned short *restrict place, size_t step, int more, double *restrict y)
{
    if (more) {
        __builtin_prefetch(y + (AHEAD + 0) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 1) * step, 0, 2);
    }
    const lanes x0 = x[place ? place[0] : 0], x1 = x[place ? place[1] : 1];
    const lanes y1_0 = __builtin_shufflevector(x0, x1, 0, 2);
    const lanes y1_1 = __builtin_shufflevector(x0, x1, 1, 3);

    memcpy(y + 0 * step, &y1_0, sizeof(lanes));
    memcpy(y + 1 * step, &y1_1, sizeof(lanes));
}
#endif
#if LANES == 4
/* A square of numbers turned over: LANES numbers of LANES states that lie step apart, a state in every lane of y.
 * If there are more, memory is asked for what lies ahead: it comes while these are computed. */
static inline void turned(const double *restrict x, size_t step, int more, lanes *restrict y)
{
    lanes x0, x1, x2, x3;
    memcpy(&x0, x + 0 * step, sizeof(lanes));
    memcpy(&x1, x + 1 * step, sizeof(lanes));
    memcpy(&x2, x + 2 * step, sizeof(lanes));
    memcpy(&x3, x + 3 * step, sizeof(lanes));
    if (more) {
        __builtin_prefetch(x + (AHEAD + 0) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 1) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 2) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 3) * step, 0, 3);
    }
    const lanes y1_0 = __builtin_shufflevector(x0, x1, 0, 4, 2, 6);
    const lanes y1_1 = __builtin_shufflevector(x0, x1, 1, 5, 3, 7);
    const lanes y1_2 = __builtin_shufflevector(x2, x3, 0, 4, 2, 6);
    const lanes y1_3 = __builtin_shufflevector(x2, x3, 1, 5, 3, 7);
    const lanes y2_0 = __builtin_shufflevector(y1_0, y1_2, 0, 1, 4, 5);
    const lanes y2_2 = __builtin_shufflevector(y1_0, y1_2, 2, 3, 6, 7);
    const lanes y2_1 = __builtin_shufflevector(y1_1, y1_3, 0, 1, 4, 5);
    const lanes y2_3 = __builtin_shufflevector(y1_1, y1_3, 2, 3, 6, 7);

    y[0] = y2_0;
    y[1] = y2_1;
    y[2] = y2_2;
    y[3] = y2_3;
}

/* The other way: number i of a state is x[place[i]], or x[i] without places. */
static inline void turned_back(const lanes *restrict x, const unsigned short *restrict place, size_t step, int more, double *restrict y)
{
    if (more) {
        __builtin_prefetch(y + (AHEAD + 0) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 1) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 2) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 3) * step, 0, 2);
    }
    const lanes x0 = x[place ? place[0] : 0], x1 = x[place ? place[1] : 1], x2 = x[place ? place[2] : 2], x3 = x[place ? place[3] : 3];
    const lanes y1_0 = __builtin_shufflevector(x0, x1, 0, 4, 2, 6);
    const lanes y1_1 = __builtin_shufflevector(x0, x1, 1, 5, 3, 7);
    const lanes y1_2 = __builtin_shufflevector(x2, x3, 0, 4, 2, 6);
    const lanes y1_3 = __builtin_shufflevector(x2, x3, 1, 5, 3, 7);
    const lanes y2_0 = __builtin_shufflevector(y1_0, y1_2, 0, 1, 4, 5);
    const lanes y2_2 = __builtin_shufflevector(y1_0, y1_2, 2, 3, 6, 7);
    const lanes y2_1 = __builtin_shufflevector(y1_1, y1_3, 0, 1, 4, 5);
    const lanes y2_3 = __builtin_shufflevector(y1_1, y1_3, 2, 3, 6, 7);

    memcpy(y + 0 * step, &y2_0, sizeof(lanes));
    memcpy(y + 1 * step, &y2_1, sizeof(lanes));
    memcpy(y + 2 * step, &y2_2, sizeof(lanes));
    memcpy(y + 3 * step, &y2_3, sizeof(lanes));
}
#endif
#if LANES == 8
/* A square of numbers turned over: LANES numbers of LANES states that lie step apart, a state in every lane of y.
 * If there are more, memory is asked for what lies ahead: it comes while these are computed. */
static inline void turned(const double *restrict x, size_t step, int more, lanes *restrict y)
{
    lanes x0, x1, x2, x3, x4, x5, x6, x7;
    memcpy(&x0, x + 0 * step, sizeof(lanes));
    memcpy(&x1, x + 1 * step, sizeof(lanes));
    memcpy(&x2, x + 2 * step, sizeof(lanes));
    memcpy(&x3, x + 3 * step, sizeof(lanes));
    memcpy(&x4, x + 4 * step, sizeof(lanes));
    memcpy(&x5, x + 5 * step, sizeof(lanes));
    memcpy(&x6, x + 6 * step, sizeof(lanes));
    memcpy(&x7, x + 7 * step, sizeof(lanes));
    if (more) {
        __builtin_prefetch(x + (AHEAD + 0) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 1) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 2) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 3) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 4) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 5) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 6) * step, 0, 3);
        __builtin_prefetch(x + (AHEAD + 7) * step, 0, 3);
    }
    const lanes y1_0 = __builtin_shufflevector(x0, x1, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_1 = __builtin_shufflevector(x0, x1, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y1_2 = __builtin_shufflevector(x2, x3, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_3 = __builtin_shufflevector(x2, x3, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y1_4 = __builtin_shufflevector(x4, x5, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_5 = __builtin_shufflevector(x4, x5, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y1_6 = __builtin_shufflevector(x6, x7, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_7 = __builtin_shufflevector(x6, x7, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y2_0 = __builtin_shufflevector(y1_0, y1_2, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_2 = __builtin_shufflevector(y1_0, y1_2, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y2_1 = __builtin_shufflevector(y1_1, y1_3, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_3 = __builtin_shufflevector(y1_1, y1_3, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y2_4 = __builtin_shufflevector(y1_4, y1_6, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_6 = __builtin_shufflevector(y1_4, y1_6, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y2_5 = __builtin_shufflevector(y1_5, y1_7, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_7 = __builtin_shufflevector(y1_5, y1_7, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y4_0 = __builtin_shufflevector(y2_0, y2_4, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_4 = __builtin_shufflevector(y2_0, y2_4, 4, 5, 6, 7, 12, 13, 14, 15);
    const lanes y4_1 = __builtin_shufflevector(y2_1, y2_5, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_5 = __builtin_shufflevector(y2_1, y2_5, 4, 5, 6, 7, 12, 13, 14, 15);
    const lanes y4_2 = __builtin_shufflevector(y2_2, y2_6, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_6 = __builtin_shufflevector(y2_2, y2_6, 4, 5, 6, 7, 12, 13, 14, 15);
    const lanes y4_3 = __builtin_shufflevector(y2_3, y2_7, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_7 = __builtin_shufflevector(y2_3, y2_7, 4, 5, 6, 7, 12, 13, 14, 15);

    y[0] = y4_0;
    y[1] = y4_1;
    y[2] = y4_2;
    y[3] = y4_3;
    y[4] = y4_4;
    y[5] = y4_5;
    y[6] = y4_6;
    y[7] = y4_7;
}

/* The other way: number i of a state is x[place[i]], or x[i] without places. */
static inline void turned_back(const lanes *restrict x, const unsigned short *restrict place, size_t step, int more, double *restrict y)
{
    if (more) {
        __builtin_prefetch(y + (AHEAD + 0) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 1) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 2) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 3) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 4) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 5) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 6) * step, 0, 2);
        __builtin_prefetch(y + (AHEAD + 7) * step, 0, 2);
    }
    const lanes x0 = x[place ? place[0] : 0], x1 = x[place ? place[1] : 1], x2 = x[place ? place[2] : 2], x3 = x[place ? place[3] : 3], x4 = x[place ? place[4] : 4], x5 = x[place ? place[5] : 5], x6 = x[place ? place[6] : 6], x7 = x[place ? place[7] : 7];
    const lanes y1_0 = __builtin_shufflevector(x0, x1, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_1 = __builtin_shufflevector(x0, x1, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y1_2 = __builtin_shufflevector(x2, x3, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_3 = __builtin_shufflevector(x2, x3, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y1_4 = __builtin_shufflevector(x4, x5, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_5 = __builtin_shufflevector(x4, x5, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y1_6 = __builtin_shufflevector(x6, x7, 0, 8, 2, 10, 4, 12, 6, 14);
    const lanes y1_7 = __builtin_shufflevector(x6, x7, 1, 9, 3, 11, 5, 13, 7, 15);
    const lanes y2_0 = __builtin_shufflevector(y1_0, y1_2, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_2 = __builtin_shufflevector(y1_0, y1_2, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y2_1 = __builtin_shufflevector(y1_1, y1_3, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_3 = __builtin_shufflevector(y1_1, y1_3, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y2_4 = __builtin_shufflevector(y1_4, y1_6, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_6 = __builtin_shufflevector(y1_4, y1_6, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y2_5 = __builtin_shufflevector(y1_5, y1_7, 0, 1, 8, 9, 4, 5, 12, 13);
    const lanes y2_7 = __builtin_shufflevector(y1_5, y1_7, 2, 3, 10, 11, 6, 7, 14, 15);
    const lanes y4_0 = __builtin_shufflevector(y2_0, y2_4, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_4 = __builtin_shufflevector(y2_0, y2_4, 4, 5, 6, 7, 12, 13, 14, 15);
    const lanes y4_1 = __builtin_shufflevector(y2_1, y2_5, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_5 = __builtin_shufflevector(y2_1, y2_5, 4, 5, 6, 7, 12, 13, 14, 15);
    const lanes y4_2 = __builtin_shufflevector(y2_2, y2_6, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_6 = __builtin_shufflevector(y2_2, y2_6, 4, 5, 6, 7, 12, 13, 14, 15);
    const lanes y4_3 = __builtin_shufflevector(y2_3, y2_7, 0, 1, 2, 3, 8, 9, 10, 11);
    const lanes y4_7 = __builtin_shufflevector(y2_3, y2_7, 4, 5, 6, 7, 12, 13, 14, 15);

    memcpy(y + 0 * step, &y4_0, sizeof(lanes));
    memcpy(y + 1 * step, &y4_1, sizeof(lanes));
    memcpy(y + 2 * step, &y4_2, sizeof(lanes));
    memcpy(y + 3 * step, &y4_3, sizeof(lanes));
    memcpy(y + 4 * step, &y4_4, sizeof(lanes));
    memcpy(y + 5 * step, &y4_5, sizeof(lanes));
    memcpy(y + 6 * step, &y4_6, sizeof(lanes));
    memcpy(y + 7 * step, &y4_7, sizeof(lanes));
}
#endif
#endif
#endif

/* Numbers of up to LANES states that lie step apart; the last one fills the lanes that are left.  more: whether there
 * are states so far ahead. */
static void gather(const double *restrict x, size_t step, size_t here, int more, int size, lanes *restrict y)
{
    (void)more;
#if defined(EOMGEN_TRANSPOSE)
    if (size >= LANES && here == LANES) {
        for (int i = 0; i < size; i += LANES) {
            const int at = i + LANES <= size ? i : size - LANES; /* the last square overlaps the one before */
            turned(x + at, step, more && i % LINE == 0, y + at);
        }
        return;
    }
    if (size >= LANES) {
        for (int i = 0; i < size; i += LANES) {
            const int at = i + LANES <= size ? i : size - LANES;
            double rows[LANES * LANES];
            for (size_t l = 0; l < LANES; ++l) memcpy(rows + l * LANES, x + (l < here ? l : here - 1) * step + at, sizeof(lanes));
            turned(rows, LANES, 0, y + at);
        }
        return;
    }
#endif
    const double *state[LANES];
    for (size_t l = 0; l < LANES; ++l) state[l] = x + (l < here ? l : here - 1) * step;
    for (int i = 0; i < size; ++i) {
#if LANES == 2
        y[i] = (lanes){ state[0][i], state[1][i] };
#endif
#if LANES == 4
        y[i] = (lanes){ state[0][i], state[1][i], state[2][i], state[3][i] };
#endif
#if LANES == 8
        y[i] = (lanes){ state[0][i], state[1][i], state[2][i], state[3][i], state[4][i], state[5][i], state[6][i], state[7][i] };
#endif
#if LANES == 1
        y[i] = state[0][i];
#endif
    }
}

/* The other way: number i of a state is x[place[i]], or x[i] without places. */
static inline void scatter(const lanes *restrict x, const unsigned short *restrict place, size_t here, int more, int size, size_t step, double *restrict y)
{
    (void)more;
#if defined(EOMGEN_TRANSPOSE)
    if (size >= LANES && here == LANES) {
        const int past = place ? (int)((size_t)y / sizeof *y % LANES) : 0; /* behind the last whole vector of memory */
        for (int i = 0; i < size; i += i == 0 ? LANES - past : LANES) {
            const int at = i + LANES <= size ? i : size - LANES;
            turned_back(place ? x : x + at, place ? place + at : NULL, step, more && (i + past) % LINE == 0, y + at);
        }
        return;
    }
    if (size >= LANES) {
        for (int i = 0; i < size; i += LANES) {
            const int at = i + LANES <= size ? i : size - LANES;
            double rows[LANES * LANES];
            turned_back(place ? x : x + at, place ? place + at : NULL, LANES, 0, rows);
            for (size_t l = 0; l < here; ++l) memcpy(y + l * step + at, rows + l * LANES, sizeof(lanes));
        }
        return;
    }
#endif
    for (int i = 0; i < size; ++i)
        for (size_t l = 0; l < here; ++l) y[l * step + (size_t)i] = LANE(x[place ? place[i] : i], l);
}

/* What depends on parameters alone, the same in all lanes. */
EOMGEN_HELPER void spread(const double *restrict h, lanes *restrict y)
{
    for (int i = 0; i < 7; ++i) y[i] = ALL(h[i]);
}

/* 0, or 1 + i + lane * 2 for the first lane with a pivot i that vanishes beside its scale. */
static int one_link_failed_lanes(const lanes *restrict pivot)
{
#if EOMGEN_VECTOR
    bits failed = { 0 };
    long long any = 0;
    for (int i = 0; i < 2; ++i) failed |= ~(bits)(pivot[2 * i] > 1e-12 * pivot[2 * i + 1]);
    for (int l = 0; l < LANES; ++l) any |= failed[l];
    if (any == 0) return 0;
#endif
    for (int l = 0; l < LANES; ++l)
        for (int i = 0; i < 2; ++i)
            if (!(LANE(pivot[2 * i], l) > 1e-12 * LANE(pivot[2 * i + 1], l))) return 1 + i + l * 2;
    return 0;
}

/* Mass matrix M(q), eq. (11). */
static int one_link_mass_matrix_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)h;

    out[0] = ALL(1.0);
    out[3] = ALL(0.3333333333333333);
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    out[1] = -0.5*sine[0];
    out[2] = out[1];

    return 0;
}

/* Coriolis and centrifugal terms, eq. (12) contracted. */
static int one_link_bias_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)h;

    out[1] = ALL(0.0);
    /* joint1: traces against its tangents, eq. (5) */
    out[0] = cosine[0]*(-0.5*(v[1]*v[1]));

    return 0;
}

/* Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14). */
static int one_link_generalized_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)v;

    const lanes t12 = h[0]*sine[0] - h[1]*cosine[0];
    out[1] = -0.5*t12;
    out[0] = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0]) + sine[0]*t12 - q[0]*h[3];

    return 0;
}

/* Q_F of eq. (14), its moment term corrected; base axes. */
static int one_link_external_force_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict wrench, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)h;

    const lanes t11 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[1] = wrench[5] + 0.5*t11;
    out[0] = cosine[0]*(cosine[0]*wrench[0] + sine[0]*wrench[1]) - sine[0]*t11;

    return 0;
}

/* M a + bias - Q - u, eq. (5) unexpanded; zero on a motion. */
static int one_link_residual_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, const lanes *restrict u, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t12 = a[0] - h[0];
    const lanes t18 = sine[0]*t12 + h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t31 = cosine[0]*(cosine[0]*t12 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t18);
    out[0] = t31 + q[0]*h[3] - u[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t18 - u[1];

    return 0;
}

/* The drives u that make the residual zero. */
static int one_link_inverse_dynamics_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t10 = a[0] - h[0];
    const lanes t16 = sine[0]*t10 + h[1]*cosine[0];
    out[1] = 0.3333333333333333*a[1] - 0.5*t16;
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t29 = cosine[0]*(cosine[0]*t10 - h[1]*sine[0] - 0.5*(v[1]*v[1])) - sine[0]*(0.5*a[1] - t16);
    out[0] = t29 + q[0]*h[3];

    return 0;
}

/* Accelerations under the drives u. */
static int one_link_forward_dynamics_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict u, lanes *restrict out)
{
    lanes pivot[4];
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    pivot[1] = ALL(1.0);
    pivot[2] = ALL(0.3333333333333333);
    pivot[3] = pivot[2];
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t15 = h[0]*sine[0] - h[1]*cosine[0];
    /* joint1: traces against its tangents, eq. (5) */
    const lanes t23 = cosine[0]*(h[0]*cosine[0] + h[1]*sine[0] + 0.5*(v[1]*v[1])) + sine[0]*t15;
    const lanes t27 = u[1] - 0.5*t15;
    /* joint1: columns of M from the composite pseudo-inertia, eq. (11) */
    const lanes t31 = 1.5*sine[0];
    const lanes t34 = 1.0 - 0.5*sine[0]*t31;
    pivot[0] = t34;
    const lanes t38 = 1.0/t34*(u[0] - (q[0]*h[3] - t23) + t27*t31);
    out[0] = t38;
    out[1] = 3.0*t27 + t31*t38;

    return one_link_failed_lanes(pivot);
}

/* Derivatives of the residual by q, v and a: three matrices. */
static int one_link_residual_jacobian_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    out[0] = ALL(h[3]);
    out[2] = ALL(0.0);
    out[4] = out[2];
    out[6] = out[2];
    out[8] = ALL(1.0);
    out[11] = ALL(0.3333333333333333);
    /* link1: velocity, acceleration, and what they are to the tangents of joint1 */
    const lanes t10 = a[0] - h[0];
    const lanes t13 = v[0]*cosine[0];
    /* joint1: rows and columns of the derivatives of eq. (5) */
    const lanes t33 = sine[0]*(0.5*(v[1]*v[1]) - (cosine[0]*t10 - h[1]*sine[0])) - cosine[0]*(0.5*a[1] - (sine[0]*t10 + h[1]*cosine[0]));
    const lanes t34 = 0.5*cosine[0];
    const lanes t35 = 0.5*sine[0];
    out[5] = cosine[0]*(2.0*(v[0]*sine[0]) - v[1]) - sine[0]*(2.0*t13);
    out[9] = -t35;
    out[10] = out[9];
    out[7] = t13 - 2.0*v[0]*t34;
    out[3] = h[1]*t35 - t10*t34;
    out[1] = t33 - h[1];

    return 0;
}

/* Derivatives of the accelerations by q, v and u: three matrices. */
static int one_link_forward_dynamics_jacobian_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict u, lanes *restrict out)
{
    lanes pivot[4];
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    pivot[1] = ALL(1.0);
    pivot[2] = ALL(0.3333333333333333);
    pivot[3] = pivot[2];
    out[4] = ALL(0.0);
    out[6] = out[4];
    const lanes t4 = 0.5*sine[0];
    const lanes t6 = 1.5*sine[0];
    const lanes t8 = 1.0 - t4*t6;
    pivot[0] = t8;
    const lanes t11 = 1.0/t8;
    out[8] = t11;
    out[0] = -(h[3]*t11);
    const lanes t14 = t6*t11;
    out[10] = t14;
    out[9] = t14;
    out[2] = -(h[3]*t14);
    const lanes t25 = h[1]*sine[0];
    const lanes t29 = 0.5*(v[1]*v[1]);
    const lanes t33 = h[1]*cosine[0];
    const lanes t34 = h[0]*sine[0] - t33;
    const lanes t38 = u[0] - (q[0]*h[3] - (cosine[0]*(h[0]*cosine[0] + t25 + t29) + sine[0]*t34));
    const lanes t41 = u[1] - 0.5*t34;
    const lanes t44 = t11*(t38 + t41*t6);
    const lanes t45 = t44 - h[0];
    const lanes t59 = sine[0]*(cosine[0]*t45 - t25 - t29) + cosine[0]*(0.5*(3.0*t41 + t6*t44) - (t33 + sine[0]*t45));
    const lanes t60 = h[1] + t59;
    const lanes t63 = 0.5*cosine[0];
    const lanes t65 = h[1]*t4 - t63*t45;
    out[1] = t11*t60 - t65*t14;
    const lanes t70 = 3.0 + t6*t14;
    out[11] = t70;
    out[3] = t60*t14 - t65*t70;
    const lanes t75 = v[0]*cosine[0];
    const lanes t82 = sine[0]*(2.0*t75) + cosine[0]*(v[1] - 2.0*(v[0]*sine[0]));
    const lanes t86 = t75 - t63*(2.0*v[0]);
    out[5] = t11*t82 - t86*t14;
    out[7] = t82*t14 - t86*t70;

    return one_link_failed_lanes(pivot);
}

/* Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T. */
static int one_link_coriolis_matrix_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)h;

    out[0] = ALL(0.0);
    out[2] = out[0];
    const lanes t5 = v[0]*cosine[0];
    /* joint1: columns and rows of C, eq. (12) contracted with the velocity */
    out[1] = cosine[0]*(v[0]*sine[0] - 0.5*v[1]) - sine[0]*t5;
    out[3] = 0.5*t5 - v[0]*(0.5*cosine[0]);

    return 0;
}

/* Christoffel symbols of the first kind, the tensor C of eq. (12). */
static int one_link_christoffel_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)h;

    out[0] = ALL(0.0);
    out[1] = out[0];
    out[2] = out[0];
    out[4] = out[0];
    out[5] = out[0];
    out[6] = out[0];
    out[7] = out[0];
    out[3] = -0.5*cosine[0];

    return 0;
}

/* Kinetic energy, eq. (4), and potential energy of gravity and springs. */
static int one_link_energy_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    const lanes t8 = v[0]*cosine[0];
    const lanes t9 = v[0]*sine[0];
    out[0] = 0.5*(t8*t8 - t9*(0.5*v[1] - t9) + v[1]*(0.3333333333333333*v[1] - 0.5*t9));
    out[1] = q[0]*(q[0]*h[4]) - (h[0]*(q[0] + 0.5*cosine[0]) + h[1]*(0.5*sine[0]));

    return 0;
}

/* Force and moment on each joint's child link, moved joint's axes. */
static int one_link_reactions_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    out[2] = ALL(h[5]);
    out[3] = ALL(0.0);
    out[4] = ALL(h[6]);
    /* link1: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H */
    const lanes t9 = a[0] - h[0];
    const lanes t15 = sine[0]*t9 + h[1]*cosine[0];
    out[0] = cosine[0]*t9 - h[1]*sine[0] - 0.5*(v[1]*v[1]);
    out[1] = 0.5*a[1] - t15;
    out[5] = 0.3333333333333333*a[1] - 0.5*t15;

    return 0;
}

/* What external wrenches add to the reactions, moved joint's axes. */
static int one_link_external_reactions_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict wrench, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)h;

    const lanes t14 = cosine[0]*wrench[1] - sine[0]*wrench[0];
    out[4] = 0.5*wrench[2] - (cosine[0]*wrench[4] - sine[0]*wrench[3]);
    out[0] = -(cosine[0]*wrench[0] + sine[0]*wrench[1]);
    out[1] = -t14;
    out[2] = -wrench[2];
    out[3] = -(cosine[0]*wrench[3] + sine[0]*wrench[4]);
    out[5] = -(wrench[5] + 0.5*t14);

    return 0;
}

/* Y of inverse dynamics without springs and dampers, u = Y theta; loops cut. */
static int one_link_regressor_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict out)
{
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    out[3] = ALL(0.0);
    out[4] = out[3];
    out[5] = out[3];
    out[6] = out[3];
    out[7] = out[3];
    out[8] = out[3];
    out[9] = out[3];
    out[10] = out[3];
    out[11] = out[3];
    out[14] = out[3];
    out[15] = out[3];
    out[16] = out[3];
    out[17] = out[3];
    out[18] = out[3];
    out[19] = out[3];
    out[20] = a[1];
    out[21] = out[20];
    const lanes t8 = a[0] - h[0];
    const lanes t11 = cosine[0]*t8 - h[1]*sine[0];
    const lanes t14 = sine[0]*t8 + h[1]*cosine[0];
    out[12] = -t14;
    const lanes t16 = v[1]*v[1];
    /* link1: motions of its frame per unit rates, and columns of its inertial parameters */
    out[1] = -(cosine[0]*t16 + a[1]*sine[0]);
    out[2] = sine[0]*t16 - a[1]*cosine[0];
    out[0] = cosine[0]*t11 + sine[0]*t14;
    out[13] = -t11;

    return 0;
}

/* Cosine of beta of every joint with three angles, 1 for the others. */
static int one_link_euler_cosines_lanes(const lanes *restrict h, const lanes *restrict q, lanes *restrict out)
{
    (void)h;
    (void)q;

    out[0] = ALL(1.0);

    return 0;
}

/* (M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step. */
static int one_link_implicit_step_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict u, const lanes *restrict added, const lanes *restrict dt, lanes *restrict out)
{
    lanes pivot[4];
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);

    const lanes t16 = h[3]*dt[1];
    /* joint1: eliminated, from the tips to the base */
    const lanes t23 = added[1] + 0.3333333333333333;
    pivot[2] = t23;
    pivot[3] = t23;
    const lanes t25 = 1.0/t23;
    const lanes t26 = u[1]*t25;
    const lanes t33 = sine[0]*(1.0 - (1.0 - 0.25*t25));
    const lanes t35 = 1.0 - sine[0]*t33;
    const lanes t40 = t16 + t35;
    pivot[0] = t40;
    pivot[1] = t16 + 1.0;
    const lanes t42 = 1.0/t40;
    const lanes t43 = u[0] - h[3]*(q[0] + v[0]*dt[0]) + (cosine[0]*(0.5*(v[1]*v[1])) + sine[0]*(0.5*t26));
    /* joint1: accelerations, from the base to the tips */
    const lanes t50 = t42*t43 + (h[0]*(t35*t42) + h[1]*(cosine[0]*t33*t42));
    out[0] = t50;
    out[1] = t26 + 0.5*t25*(sine[0]*(t50 - h[0]) + h[1]*cosine[0]);

    return one_link_failed_lanes(pivot);
}

/* Factors of M + c B + c^2 K, for the stages of a Rosenbrock method. */
static int one_link_stage_factors_lanes(const lanes *restrict h, const lanes *restrict q, const lanes *restrict v, const lanes *restrict kp, const lanes *restrict kd, const lanes *restrict times, lanes *restrict out)
{
    lanes pivot[4];
    lanes sine[1];
    lanes cosine[1];
    turn((const double *)(q + 1), 1 * LANES, (double *)sine, (double *)cosine);
    (void)v;

    out[0] = sine[0];
    const lanes t5 = h[3]*times[1];
    out[1] = t5;
    out[2] = h[3]*times[0];
    const lanes t11 = times[0]*kd[1] + times[1]*kp[1];
    out[3] = t11;
    out[4] = times[0]*kp[1];
    /* joint1: eliminated, from the tips to the base */
    const lanes t14 = t11 + 0.3333333333333333;
    pivot[2] = t14;
    pivot[3] = t14;
    const lanes t16 = 1.0/t14;
    out[5] = t16;
    out[6] = 0.5*t16;
    const lanes t26 = t5 + (1.0 - sine[0]*(sine[0]*(1.0 - (1.0 - 0.25*t16))));
    pivot[0] = t26;
    pivot[1] = t5 + 1.0;
    out[7] = 1.0/t26;

    return one_link_failed_lanes(pivot);
}

/* w of (M + c B + c^2 K) w = -((c B + c^2 K) rates + c K shifts). */
static int one_link_stage_solution_lanes(const lanes *restrict h, const lanes *restrict kept, const lanes *restrict rates, const lanes *restrict shifts, lanes *restrict out)
{
    (void)h;

    /* joint1: eliminated, from the tips to the base */
    const lanes t16 = (rates[1]*kept[3] + shifts[1]*kept[4])*kept[5];
    const lanes t23 = kept[7]*(rates[0]*kept[1] + shifts[0]*kept[2] + kept[0]*(0.5*t16));
    out[0] = -t23;
    /* joint1: accelerations, from the base to the tips */
    out[1] = -(t16 + kept[6]*(kept[0]*t23));

    return 0;
}

long long one_link_mass_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    lanes q_lanes[2], out_lanes[4];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        const int status = one_link_mass_matrix_lanes(h_lanes, q_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 4, 4, out + i * 4);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_bias_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        const int status = one_link_bias_force_lanes(h_lanes, q_lanes, v_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_generalized_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        const int status = one_link_generalized_force_lanes(h_lanes, q_lanes, v_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_external_force_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict wrench, size_t wrench_step, double *restrict out)
{
    lanes q_lanes[2], wrench_lanes[6], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(wrench + i * wrench_step, wrench_step, here, more, 6, wrench_lanes);
        const int status = one_link_external_force_lanes(h_lanes, q_lanes, wrench_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_residual_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, const double *restrict u, size_t u_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], a_lanes[2], u_lanes[2], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(a + i * a_step, a_step, here, more, 2, a_lanes);
        gather(u + i * u_step, u_step, here, more, 2, u_lanes);
        const int status = one_link_residual_lanes(h_lanes, q_lanes, v_lanes, a_lanes, u_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_inverse_dynamics_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], a_lanes[2], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(a + i * a_step, a_step, here, more, 2, a_lanes);
        const int status = one_link_inverse_dynamics_lanes(h_lanes, q_lanes, v_lanes, a_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_forward_dynamics_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict u, size_t u_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], u_lanes[2], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(u + i * u_step, u_step, here, more, 2, u_lanes);
        const int status = one_link_forward_dynamics_lanes(h_lanes, q_lanes, v_lanes, u_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_residual_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], a_lanes[2], out_lanes[12];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(a + i * a_step, a_step, here, more, 2, a_lanes);
        const int status = one_link_residual_jacobian_lanes(h_lanes, q_lanes, v_lanes, a_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 12, 12, out + i * 12);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_forward_dynamics_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict u, size_t u_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], u_lanes[2], out_lanes[12];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(u + i * u_step, u_step, here, more, 2, u_lanes);
        const int status = one_link_forward_dynamics_jacobian_lanes(h_lanes, q_lanes, v_lanes, u_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 12, 12, out + i * 12);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_coriolis_matrix_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], out_lanes[4];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        const int status = one_link_coriolis_matrix_lanes(h_lanes, q_lanes, v_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 4, 4, out + i * 4);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_christoffel_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    lanes q_lanes[2], out_lanes[8];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        const int status = one_link_christoffel_lanes(h_lanes, q_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 8, 8, out + i * 8);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_energy_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], out_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        const int status = one_link_energy_lanes(h_lanes, q_lanes, v_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 2, 2, out + i * 2);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_reactions_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], a_lanes[2], out_lanes[6];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(a + i * a_step, a_step, here, more, 2, a_lanes);
        const int status = one_link_reactions_lanes(h_lanes, q_lanes, v_lanes, a_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 6, 6, out + i * 6);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_external_reactions_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict wrench, size_t wrench_step, double *restrict out)
{
    lanes q_lanes[2], wrench_lanes[6], out_lanes[6];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(wrench + i * wrench_step, wrench_step, here, more, 6, wrench_lanes);
        const int status = one_link_external_reactions_lanes(h_lanes, q_lanes, wrench_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 6, 6, out + i * 6);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_regressor_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const double *restrict a, size_t a_step, double *restrict out)
{
    lanes q_lanes[2], v_lanes[2], a_lanes[2], out_lanes[22];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        gather(v + i * v_step, v_step, here, more, 2, v_lanes);
        gather(a + i * a_step, a_step, here, more, 2, a_lanes);
        const int status = one_link_regressor_lanes(h_lanes, q_lanes, v_lanes, a_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 22, 22, out + i * 22);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

long long one_link_euler_cosines_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, double *restrict out)
{
    lanes q_lanes[2], out_lanes[1];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        const int status = one_link_euler_cosines_lanes(h_lanes, q_lanes, out_lanes);
        scatter(out_lanes, NULL, here, more, 1, 1, out + i * 1);
        if (status != 0) return (long long)i * 2 + status - 1;
    }
    return -1;
}

EOMGEN_PART void one_link_kinematics0_lanes(const lanes *restrict q, const lanes *restrict sine, const lanes *restrict cosine, int last, lanes *restrict origins, lanes *restrict axes, lanes *restrict kept)
{
    origins[0] = q[0];
    origins[1] = ALL(0.0);
    origins[2] = origins[1];
    axes[1] = origins[1];
    axes[2] = origins[1];
    axes[3] = origins[1];
    axes[4] = origins[1];
    axes[0] = ALL(1.0);
    axes[5] = axes[0];
    kept[0] = cosine[0];
    kept[2] = sine[0];
    if (last <= 0) { return; }
    kept[1] = -sine[0];
}

EOMGEN_PART void one_link_kinematics1_lanes(const lanes *restrict q, const lanes *restrict given, lanes *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = ALL(0.0);
    pose[6] = pose[2];
    pose[8] = pose[2];
    pose[9] = pose[2];
    pose[11] = pose[2];
    pose[4] = given[2];
    pose[7] = pose[4];
    pose[10] = ALL(1.0);
    pose[3] = q[0] + given[0];
}

EOMGEN_PART void one_link_kinematics2_lanes(lanes *restrict pose)
{
    pose[0] = ALL(1.0);
    pose[5] = pose[0];
    pose[10] = pose[0];
    pose[1] = ALL(0.0);
    pose[2] = pose[1];
    pose[3] = pose[1];
    pose[4] = pose[1];
    pose[6] = pose[1];
    pose[7] = pose[1];
    pose[8] = pose[1];
    pose[9] = pose[1];
    pose[11] = pose[1];
}

EOMGEN_PART void one_link_kinematics3_lanes(const lanes *restrict q, const lanes *restrict given, lanes *restrict pose)
{
    pose[0] = given[0];
    pose[5] = pose[0];
    pose[1] = given[1];
    pose[2] = ALL(0.0);
    pose[6] = pose[2];
    pose[7] = pose[2];
    pose[8] = pose[2];
    pose[9] = pose[2];
    pose[11] = pose[2];
    pose[3] = q[0];
    pose[4] = given[2];
    pose[10] = ALL(1.0);
}

/* Pose [R | X] of a frame; origins of the bodies between the base and it, and axes of their coordinates; eqs. (1)-(3).
 * Nodes are the base, the bodies, and the frames, each behind its body; several bodies may be a run.  Sines and cosines
 * on the way are taken at once. */
static void one_link_on_the_way_lanes(const lanes *restrict h, const lanes *restrict q, int frame, lanes *restrict pose, lanes *restrict origins, lanes *restrict axes)
{
    static const int run_of[5] = { 0, 0, 1, 2, 3 };
    static const int behind[4] = { -1, 1, 0, 1 };
    int way[2];
    int count = 0;
    lanes kept[3];
    const lanes *const given = kept;
    static const int turned[5] = { 0, 1, 0, 0, 0 };
    static const int first[4] = { 0, 1, 1, 1 };
    static const int place[1] = { 1 };
    lanes turning[1];
    lanes sines[1];
    lanes cosines[1];
    int angles = 0;
    int done = 0;
    (void)h;
    (void)q;
    (void)given;
    for (int node = 2 + frame; node >= 0; node = behind[run_of[node]]) { way[count] = node; ++count; }
    for (int i = count - 1; i >= 0; --i) {
        const int *const own = &place[first[run_of[way[i]]]];
        for (int k = 0; k < turned[way[i]]; ++k) { turning[angles] = q[own[k]]; ++angles; }
    }
    if (angles == 0) { turning[0] = ALL(0.0); }
    turn((const double *)turning, (size_t)angles * LANES, (double *)sines, (double *)cosines);
    while (count > 0) {
        --count;
        const int last = way[count];
        const lanes *const sine = &sines[done];
        const lanes *const cosine = &cosines[done];
        done += turned[last];
        switch (run_of[last]) {
        case 0: one_link_kinematics0_lanes(q, sine, cosine, last, origins, axes, kept); break;
        case 1: one_link_kinematics1_lanes(q, given, pose); break;
        case 2: one_link_kinematics2_lanes(pose); break;
        case 3: one_link_kinematics3_lanes(q, given, pose); break;
        default: break;
        }
    }
}

/* Pose of a frame in the base, 4x4; eqs. (1) and (2). */
static int one_link_frame_pose_lanes(const lanes *restrict h, const lanes *restrict q, int frame, lanes *restrict out)
{
    lanes origins[3];
    lanes axes[6];
    one_link_on_the_way_lanes(h, q, frame, out, origins, axes);
    for (int i = 12; i < 15; ++i) { out[i] = ALL(0.0); }
    out[15] = ALL(1.0);
    return 0;
}

/* Linear velocity of a frame's origin (rows 0 to 2) and angular velocity (rows 3 to 5) per coordinate, base axes. */
static int one_link_frame_jacobian_lanes(const lanes *restrict h, const lanes *restrict q, int frame, lanes *restrict out)
{
    static const int body_of[3] = { 0, -1, 0 };
    static const int parent[1] = { -1 };
    static const int first[1] = { 0 };
    static const int count[1] = { 2 };
    static const int is_rotation[2] = { 0, 1 };
    lanes pose[12];
    lanes origins[3];
    lanes axes[6];
    one_link_on_the_way_lanes(h, q, frame, pose, origins, axes);
    for (int i = 0; i < 12; ++i) { out[i] = ALL(0.0); }
    for (int body = body_of[frame]; body >= 0; body = parent[body]) {
        const lanes *origin = &origins[3 * body];
        const lanes arm[3] = { pose[3] - origin[0], pose[7] - origin[1], pose[11] - origin[2] };
        for (int s = first[body]; s < first[body] + count[body]; ++s) {
            const lanes *axis = &axes[3 * s];
            if (is_rotation[s] != 0) {
                out[s] = axis[1] * arm[2] - axis[2] * arm[1];
                out[2 + s] = axis[2] * arm[0] - axis[0] * arm[2];
                out[4 + s] = axis[0] * arm[1] - axis[1] * arm[0];
                for (int i = 0; i < 3; ++i) { out[(3 + i) * 2 + s] = axis[i]; }
            } else {
                for (int i = 0; i < 3; ++i) { out[i * 2 + s] = axis[i]; }
            }
        }
    }
    return 0;
}

long long one_link_frame_pose_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, int frame, double *restrict out)
{
    lanes q_lanes[2], out_lanes[16];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        one_link_frame_pose_lanes(h_lanes, q_lanes, frame, out_lanes);
        scatter(out_lanes, NULL, here, more, 16, 16, out + i * 16);
    }
    return -1;
}

long long one_link_frame_jacobian_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, int frame, double *restrict out)
{
    lanes q_lanes[2], out_lanes[12];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        const int more = count - i >= AHEAD + LANES;
        gather(q + i * q_step, q_step, here, more, 2, q_lanes);
        one_link_frame_jacobian_lanes(h_lanes, q_lanes, frame, out_lanes);
        scatter(out_lanes, NULL, here, more, 12, 12, out + i * 12);
    }
    return -1;
}

static void one_link_load_lanes(const double *restrict x, size_t step, size_t here, lanes *restrict y)
{
    gather(x, step, here, 0, 2, y);
}

static void one_link_store_lanes(const lanes *restrict x, size_t here, size_t stride, double *restrict y)
{
    scatter(x, NULL, here, 0, 2, stride, y);
}

/* Clip drives at +-effort; slope, if it is not NULL, becomes 0 where they are clipped, else 1. */
static void one_link_saturated_lanes(const one_link_drive *restrict drive, lanes *restrict u, lanes *restrict slope)
{
    for (size_t l = 0; l < LANES; ++l) {
        for (int i = 0; i < 2; ++i) {
            const double most = drive->effort[i];
            const double x = LANE(u[i], l);
            const int over = ((x > most) || (x < -most)) ? 1 : 0;
            if (slope != NULL) { LANE(slope[i], l) = (over != 0) ? 0.0 : 1.0; }
            if (over != 0) { LANE(u[i], l) = (x > most) ? most : -most; }
        }
    }
}

/* Drives at a step: u + kp (target - q - ahead v) - kd v, within their efforts; slope as of one_link_saturated. */
static void one_link_drives_lanes(const one_link_drive *restrict drive, size_t state, size_t here, size_t step, const lanes *restrict q, const lanes *restrict v, double ahead, lanes *restrict u, lanes *restrict slope)
{
    one_link_load_lanes(&drive->u[state * drive->u_state + step * drive->u_step], drive->u_state, here, u);
    if (drive->kp != NULL) {
        lanes target[2];
        one_link_load_lanes(&drive->target[state * drive->target_state + step * drive->target_step], drive->target_state, here, target);
        for (int i = 0; i < 2; ++i) {
            u[i] += drive->kp[i] * (target[i] - q[i] - ahead * v[i]) - drive->kd[i] * v[i];
        }
    }
    if (drive->effort != NULL) { one_link_saturated_lanes(drive, u, slope); }
}

/* One step of the classical Runge-Kutta method, drives held. */
static int one_link_rk4_lanes(const lanes *restrict h, const one_link_drive *restrict drive, size_t state, size_t here, size_t step, double dt, lanes *restrict q, lanes *restrict v)
{
    static const double part[4] = { 0.5, 0.5, 1.0, 0.0 };
    static const double weight[4] = { 1.0, 2.0, 2.0, 1.0 };
    lanes u[2];
    lanes a[2];
    lanes q_here[2];
    lanes v_here[2];
    lanes q_sum[2];
    lanes v_sum[2];
    for (int i = 0; i < 2; ++i) {
        q_here[i] = q[i];
        v_here[i] = v[i];
        q_sum[i] = ALL(0.0);
        v_sum[i] = ALL(0.0);
    }
    for (int stage = 0; stage < 4; ++stage) {
        one_link_drives_lanes(drive, state, here, step, q_here, v_here, 0.0, u, NULL);
        const int status = one_link_forward_dynamics_lanes(h, q_here, v_here, u, a);
        if (status != 0) { return status; }
        for (int i = 0; i < 2; ++i) {
            q_sum[i] += weight[stage] * v_here[i];
            v_sum[i] += weight[stage] * a[i];
            q_here[i] = q[i] + part[stage] * dt * v_here[i];
            v_here[i] = v[i] + part[stage] * dt * a[i];
        }
    }
    for (int i = 0; i < 2; ++i) {
        q[i] += dt / 6.0 * q_sum[i];
        v[i] += dt / 6.0 * v_sum[i];
    }
    return 0;
}

/* One linearly implicit step: springs, dampers and the controller at its end, all else at its beginning. */
static int one_link_implicit_lanes(const lanes *restrict h, const one_link_drive *restrict drive, size_t state, size_t here, size_t step, double dt, lanes *restrict q, lanes *restrict v)
{
    lanes u[2];
    lanes a[2];
    lanes added[2];
    lanes slope[2];
    lanes times[2];
    times[0] = ALL(dt);
    times[1] = ALL(dt * dt);
    for (int i = 0; i < 2; ++i) {
        added[i] = (drive->kp == NULL) ? ALL(0.0) : ALL(dt * (drive->kd[i] + dt * drive->kp[i]));
    }
    one_link_drives_lanes(drive, state, here, step, q, v, dt, u, slope);
    for (int i = 0; (drive->effort != NULL) && (i < 2); ++i) { added[i] *= slope[i]; }
    const int status = one_link_implicit_step_lanes(h, q, v, u, added, times, a);
    if (status != 0) { return status; }
    for (int i = 0; i < 2; ++i) {
        v[i] += dt * a[i];
        q[i] += dt * v[i];
    }
    return 0;
}

/* Steps from one state to the next; every so many are stored.  -1, or step * states in a call + what the step said. */
static long long one_link_steps_lanes(const lanes *restrict h, const one_link_drive *restrict drive, size_t state, size_t here, double dt, size_t steps, size_t every, int method, lanes *restrict q, lanes *restrict v, double *restrict q_out, double *restrict v_out)
{
    const size_t stride = (steps / every + 1U) * 2U;
    one_link_store_lanes(q, here, stride, q_out);
    one_link_store_lanes(v, here, stride, v_out);
    for (size_t step = 0; step < steps; ++step) {
        const int status = method == 0 ? one_link_rk4_lanes(h, drive, state, here, step, dt, q, v)
                                       : one_link_implicit_lanes(h, drive, state, here, step, dt, q, v);
        if (status != 0) { return (long long)step * 2 * LANES + status - 1; }
        if ((step + 1U) % every == 0U) {
            one_link_store_lanes(q, here, stride, &q_out[(step + 1U) / every * 2U]);
            one_link_store_lanes(v, here, stride, &v_out[(step + 1U) / every * 2U]);
        }
    }
    return -1;
}

/* Several states over many steps; -1, or (state * steps + step) * 2 + i of the first failure. */
long long one_link_rollout_batch(size_t count, const double *restrict h, const double *restrict q, size_t q_step, const double *restrict v, size_t v_step, const one_link_drive *restrict drive, double dt, size_t steps, size_t every, int method, double *restrict q_out, double *restrict v_out)
{
    const size_t stride = (steps / every + 1) * 2;
    lanes q_lanes[2], v_lanes[2];
    lanes h_lanes[7];
    spread(h, h_lanes);
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        gather(q + i * q_step, q_step, here, 0, 2, q_lanes);
        gather(v + i * v_step, v_step, here, 0, 2, v_lanes);
        const long long failed = one_link_steps_lanes(h_lanes, drive, i, here, dt, steps, every, method, q_lanes, v_lanes, q_out + i * stride, v_out + i * stride);
        if (failed >= 0) {
            const long long step = failed / (2 * LANES), place = failed % (2 * LANES);
            return (((long long)i + place / 2) * (long long)steps + step) * 2 + place % 2;
        }
    }
    return -1;
}

#ifndef EOMGEN_LOADS
#define EOMGEN_LOADS

/* A time, and one beside it by which pieces of signals are chosen: where signals jump, both sides have their own. */
typedef struct {
    double t;
    double beside;
} one_link_instant;

/* A time that is its own side: behind what jumps there. */
static one_link_instant one_link_instant_of(double t)
{
    one_link_instant at;
    at.t = t;
    at.beside = t;
    return at;
}

/* When drives and wrenches are asked. */
static one_link_instant one_link_between_ends(const one_link_loads *restrict loads, one_link_instant at)
{
    one_link_instant found;
    found.t = (at.t < loads->first) ? loads->first : ((at.t > loads->last) ? loads->last : at.t);
    found.beside = (at.beside < loads->first) ? loads->first : ((at.beside > loads->last) ? loads->last : at.beside);
    return found;
}

/* How many of the times at which loads jump are not behind t. */
static size_t one_link_stops_until(const one_link_loads *restrict loads, double t)
{
    size_t low = 0U;
    size_t high = loads->stops;
    while (low < high) {
        const size_t middle = low + (high - low) / 2U;
        if (loads->stop[middle] <= t) { low = middle + 1U; } else { high = middle; }
    }
    return low;
}

/* Whether loads jump at t. */
static int one_link_jumps_at(const one_link_loads *restrict loads, double t)
{
    const size_t count = one_link_stops_until(loads, t);
    return ((count > 0U) && !(loads->stop[count - 1U] < t)) ? 1 : 0;
}

/* The piece of a signal at a time, and how far that is from its beginning; not inside before the first and behind the last. */
static int one_link_piece(const one_link_signal *restrict signal, one_link_instant at, double *restrict ahead, int *restrict inside)
{
    const double *const knot = signal->knot;
    int low = 0;
    int high = signal->pieces;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (at.beside < knot[middle]) { high = middle; } else { low = middle; }
    }
    *inside = ((at.beside >= knot[0]) && (at.beside <= knot[signal->pieces])) ? 1 : 0;
    *ahead = (at.beside < knot[low]) ? 0.0 : ((at.beside > knot[low + 1]) ? (knot[low + 1] - knot[low]) : (at.t - knot[low]));
    return low;
}

/* Columns of a signal at a time, its rates and accelerations, without its profile. */
static void one_link_column(const one_link_signal *restrict signal, one_link_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    double ahead = 0.0;
    int inside = 0;
    const int piece = one_link_piece(signal, at, &ahead, &inside);
    const size_t columns = (size_t)signal->columns;
    const double *const own = &signal->coefficient[(size_t)piece * ((size_t)signal->degree + 1U) * columns];
    for (size_t i = 0; i < columns; ++i) {
        double value = 0.0;
        double rate = 0.0;
        double half = 0.0;
        for (int power = signal->degree; power >= 0; --power) {
            half = half * ahead + rate;
            rate = rate * ahead + value;
            value = value * ahead + own[(size_t)power * columns + i];
        }
        x[i] = value;
        dx[i] = (inside != 0) ? rate : 0.0;
        ddx[i] = (inside != 0) ? (2.0 * half) : 0.0;
    }
}

/* What a signal's profile puts in the place of a time, with its rate and acceleration there. */
static one_link_instant one_link_profiled(const one_link_signal *restrict profile, one_link_instant at, double *restrict ds, double *restrict dds)
{
    one_link_instant found;
    double rate = 0.0;
    double second = 0.0;
    one_link_column(profile, one_link_instant_of(at.beside), &found.beside, &rate, &second);
    one_link_column(profile, at, &found.t, ds, dds);
    return found;
}

/* Columns of a signal at a time, its rates and accelerations. */
static void one_link_signal_at(const one_link_signal *restrict signal, one_link_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    if (signal->profile == NULL) {
        one_link_column(signal, at, x, dx, ddx);
    } else {
        double ds = 0.0;
        double dds = 0.0;
        one_link_column(signal, one_link_profiled(signal->profile, at, &ds, &dds), x, dx, ddx);
        for (int i = 0; i < signal->columns; ++i) {
            ddx[i] = ddx[i] * ds * ds + dx[i] * dds;
            dx[i] = dx[i] * ds;
        }
    }
}

/* Coordinates, rates and accelerations of prescribed coordinates at a time. */
static void one_link_given_at(const one_link_given *restrict given, one_link_instant at, double *restrict x, double *restrict dx, double *restrict ddx)
{
    for (int i = 0; i < given->size; ++i) {
        const double *const wave = &given->wave[4 * i];
        const double angle = wave[1] * at.t + wave[2];
        const double part = wave[0] * sin(angle);
        x[i] = wave[3] + part;
        dx[i] = wave[0] * wave[1] * cos(angle);
        ddx[i] = -(wave[1] * wave[1]) * part;
    }
    for (int k = 0; k < given->count; ++k) {
        double own[2];
        double rate[2];
        double acceleration[2];
        one_link_signal_at(given->tracks[k].signal, at, own, rate, acceleration);
        for (int i = 0; i < given->tracks[k].signal->columns; ++i) {
            x[given->tracks[k].place[i]] = own[i];
            dx[given->tracks[k].place[i]] = rate[i];
            ddx[given->tracks[k].place[i]] = acceleration[i];
        }
    }
}

/* What drives do by a program, added to u, and what they ask a model of the robot: q, v and a, 2 numbers each. */
static void one_link_controlled(const one_link_loads *restrict loads, one_link_instant at, const double *restrict q, const double *restrict v, const double *restrict given, double *restrict u, double *restrict asked)
{
    const one_link_control *const control = loads->control;
    const one_link_model *const model = loads->model;
    double x[2];
    double dx[2];
    double ddx[2];
    one_link_signal_at(control->program.signal, at, x, dx, ddx);
    if (control->kp != NULL) {
        for (int i = 0; i < control->program.signal->columns; ++i) {
            const int place = control->program.place[i];
            const double ratio = control->ratio[i];
            u[place] += (control->kp[i] * (x[i] - q[place] / ratio) + control->kd[i] * (dx[i] - v[place] / ratio)) / ratio;
        }
    }
    if (model != NULL) {
        double *const q_model = asked;
        double *const v_model = &asked[2];
        double *const a_model = &asked[4];
        for (int i = 0; i < model->size; ++i) {
            const int column = model->column[i];
            q_model[i] = q[model->place[i]] / model->ratio[i];
            v_model[i] = (model->holds != 0) ? 0.0 : (v[model->place[i]] / model->ratio[i]);
            a_model[i] = 0.0;
            if (model->holds == 0) {
                if (column >= 0) {
                    a_model[i] = ddx[column] + model->bandwidth * (model->bandwidth * (x[column] - q_model[i]) + 2.0 * (dx[column] - v_model[i]));
                } else if (model->given[i] >= 0) {
                    a_model[i] = given[model->given[i]] / model->ratio[i];
                } else {
                    a_model[i] = 0.0;
                }
            }
        }
    }
}

/* Drives at a time but for a model's, and what that is asked; motions that are given are put into q and v. */
static void one_link_asked(const one_link_loads *restrict loads, one_link_instant at, double *restrict q, double *restrict v, double *restrict u, double *restrict given, double *restrict asked)
{
    const one_link_instant between = one_link_between_ends(loads, at);
    (void)memset(given, 0, 2U * sizeof *given);
    if (loads->given != NULL) {
        double x[2];
        double dx[2];
        one_link_given_at(loads->given, at, x, dx, given);
        for (int i = 0; i < loads->given->size; ++i) {
            q[loads->given->place[i]] = x[i];
            v[loads->given->place[i]] = dx[i];
        }
    }
    if (loads->torque != NULL) {
        double force[2];
        double rate[2];
        double second[2];
        one_link_signal_at(loads->torque->signal, between, force, rate, second);
        for (int i = 0; i < loads->torque->signal->columns; ++i) { u[loads->torque->place[i]] += force[i]; }
    }
    if (loads->control != NULL) { one_link_controlled(loads, between, q, v, given, u, asked); }
}

/* Drives with what a model answers, within +-effort where there is one, and accelerations that are given; slope, if it is not
 * NULL, becomes 0 where they are clipped, else 1. */
static void one_link_answered(const one_link_loads *restrict loads, const double *restrict given, const double *restrict answer, double *restrict u, double *restrict slope)
{
    const one_link_model *const model = (loads->control == NULL) ? NULL : loads->model;
    if (model != NULL) {
        for (int i = 0; i < model->size; ++i) {
            if (model->given[i] < 0) { u[model->place[i]] += answer[i] / model->ratio[i]; }
        }
    }
    for (int i = 0; (loads->effort != NULL) && (i < 2); ++i) {
        const double most = loads->effort[i];
        if (slope != NULL) { slope[i] = ((u[i] > most) || (u[i] < -most)) ? 0.0 : 1.0; }
        u[i] = (u[i] > most) ? most : ((u[i] < -most) ? -most : u[i]);
    }
    if (loads->given != NULL) {
        for (int i = 0; i < loads->given->size; ++i) { u[loads->given->place[i]] = given[i]; }
    }
}

/* Wrenches at a time on all links, in the base's axes. */
static void one_link_pulling(const one_link_loads *restrict loads, one_link_instant at, const double *restrict q, double *restrict total)
{
    const one_link_instant between = one_link_between_ends(loads, at);
    (void)memset(total, 0, 6U * sizeof *total);
    for (size_t k = 0; k < loads->wrenches; ++k) {
        const one_link_wrench *const wrench = &loads->wrench[k];
        double row[6];
        double rate[6];
        double second[6];
        (void)memset(row, 0, sizeof row);
        if ((wrench->t0 <= between.beside) && (between.beside < wrench->t1)) { one_link_signal_at(wrench->signal, between, row, rate, second); }
        if (wrench->frame >= 0) {
            double pose[16];
            double arm[3];
            double turned[6];
            (void)loads->frame_pose(loads->frame_h, q, wrench->frame, pose);
            for (int i = 0; i < 3; ++i) {
                const double along[3] = { pose[4 * i], pose[4 * i + 1], pose[4 * i + 2] };
                arm[i] = along[0] * wrench->arm[0] + along[1] * wrench->arm[1] + along[2] * wrench->arm[2];
                turned[i] = (wrench->turns != 0) ? (along[0] * row[0] + along[1] * row[1] + along[2] * row[2]) : row[i];
                turned[3 + i] = (wrench->turns != 0) ? (along[0] * row[3] + along[1] * row[4] + along[2] * row[5]) : row[3 + i];
            }
            turned[3] += arm[1] * turned[2] - arm[2] * turned[1];
            turned[4] += arm[2] * turned[0] - arm[0] * turned[2];
            turned[5] += arm[0] * turned[1] - arm[1] * turned[0];
            (void)memcpy(row, turned, sizeof row);
        }
        for (int i = 0; i < 6; ++i) { total[6 * wrench->link + i] += row[i]; }
    }
}

/* Add forces of wrenches to drives. */
static void one_link_push(const double *restrict force, double *restrict u)
{
    for (int i = 0; i < 2; ++i) {
        u[i] += force[i];
    }
}

/* Powers of drives and of wrenches, and what dampers and friction take, W. */
static void one_link_powers(const one_link_work *restrict work, const double *restrict q, const double *restrict v, const double *restrict u, const double *restrict pushed, double *restrict power)
{
    double own[2];
    double rate[2];
    double rest[2];
    double still[2];
    double moving[2];
    (void)memset(rest, 0, sizeof rest);
    for (int i = 0; i < 2; ++i) {
        own[i] = q[i];
        rate[i] = v[i];
    }
    (void)work->generalized_force(work->passive_h, own, rest, still);
    (void)work->generalized_force(work->passive_h, own, rate, moving);
    for (int w = 0; w < 4; ++w) { power[w] = 0.0; }
    for (int i = 0; i < 2; ++i) {
        power[2] += pushed[i] * v[i];
        power[3] += (still[i] - moving[i]) * v[i];
        power[0] += u[i] * v[i];
    }
}

/* What wrenches do at a time, on all coordinates; ``here`` is h in which joints are as they are in q. */
static void one_link_wrenched(const one_link_loads *restrict loads, const double *here, one_link_instant at, const double *restrict q, double *restrict force)
{
    double own[2];
    double total[6];
    double found[2];
    for (int i = 0; i < 2; ++i) { own[i] = q[i]; }
    one_link_pulling(loads, at, own, total);
    (void)loads->external_force((loads->force_h == NULL) ? here : loads->force_h, own, total, found);
    for (int i = 0; i < 2; ++i) { force[i] = found[i]; }
}
#endif /* EOMGEN_LOADS */

/* Where lanes are in their steps: from when on, how long and to when, with times inside beside both ends where loads jump
 * there, the next such time, and by which loads, NULL for all or for none; powers of all stages, where works are asked for. */
typedef struct {
    const one_link_loads *loads[LANES];
    double *power;
    double begin[LANES];
    double step[LANES];
    double end[LANES];
    double after[LANES];
    double before[LANES];
    double stop[LANES];
    int here;
} one_link_clock_lanes;

/* Time at a share of a lane's step; at its ends, and of stages outside, with one that is inside. */
static one_link_instant one_link_instant_at_lanes(const one_link_clock_lanes *restrict clock, int l, double share)
{
    one_link_instant at;
    at.t = (share < 1.0 || share > 1.0) ? (clock->begin[l] + share * clock->step[l]) : clock->end[l];
    at.beside = (share > 0.0) ? ((share < 1.0) ? at.t : clock->before[l]) : clock->after[l];
    return at;
}

/* What a model of the robot, if drives know one, is asked by lanes, each its own: 6 numbers, and what it answers. */
static void one_link_modelled_lanes(const one_link_clock_lanes *restrict clock, const double *restrict asked, double *restrict force)
{
    const one_link_model *const first = clock->loads[0]->control == NULL ? NULL : clock->loads[0]->model;
    int alike = first != NULL && first->inverse_dynamics_batch != NULL;
    for (int l = 1; l < clock->here; ++l) {
        const one_link_model *const model = clock->loads[l]->control == NULL ? NULL : clock->loads[l]->model;
        alike = alike && model != NULL && model->inverse_dynamics_batch == first->inverse_dynamics_batch && model->batch_h == first->batch_h;
    }
    if (alike) {
        double packed[LANES * 2];
        (void)first->inverse_dynamics_batch((size_t)clock->here, first->batch_h, asked, 6, asked + 2, 6, asked + 4, 6, packed);
        for (int l = 0; l < clock->here; ++l)
            for (int i = 0; i < first->size; ++i) force[l * 2 + i] = packed[l * first->size + i];
        return;
    }
    for (int l = 0; l < clock->here; ++l) {
        const one_link_model *const model = (clock->loads[l]->control == NULL) ? NULL : clock->loads[l]->model;
        const double *const own = &asked[6 * l];
        if (model == NULL) { continue; }
        (void)model->inverse_dynamics(model->h, own, &own[2], &own[4], &force[2 * l]);
    }
}

/* Add what loads do at a part of lanes' steps to the forces, and put given motions into q and v; powers are a stage's. */
static void one_link_timed_lanes(const double *here, const one_link_clock_lanes *restrict clock, double share, int stage, lanes *restrict q, lanes *restrict v, lanes *restrict force, lanes *restrict slope)
{
    double own[LANES][2];
    double rate[LANES][2];
    double u[LANES][2];
    double given[LANES][2];
    double asked[LANES][6];
    double answer[LANES][2];
    one_link_instant t[LANES];
    scatter(q, NULL, (size_t)clock->here, 0, 2, 2, own[0]);
    scatter(v, NULL, (size_t)clock->here, 0, 2, 2, rate[0]);
    scatter(force, NULL, (size_t)clock->here, 0, 2, 2, u[0]);
    for (int l = 0; l < clock->here; ++l) {
        t[l] = one_link_instant_at_lanes(clock, l, share);
        one_link_asked(clock->loads[l], t[l], own[l], rate[l], u[l], given[l], asked[l]);
    }
    one_link_modelled_lanes(clock, asked[0], answer[0]);
    int moved = 0;
    for (int l = 0; l < clock->here; ++l) {
        double inside[2];
        one_link_answered(clock->loads[l], given[l], answer[l], u[l], inside);
        if (slope != NULL) {
            for (int i = 0; i < 2; ++i) { LANE(slope[i], l) = (clock->loads[l]->effort == NULL) ? 1.0 : inside[i]; }
        }
        double pushed[2];
        (void)memset(pushed, 0, sizeof pushed);
        if (clock->loads[l]->wrenches > 0U) { one_link_wrenched(clock->loads[l], here, t[l], own[l], pushed); }
        if (clock->power != NULL) {
            double power[4];
            one_link_powers(clock->loads[l]->work, own[l], rate[l], u[l], pushed, power);
            for (int w = 0; w < 4; ++w) { clock->power[(stage * 4 + w) * (int)LANES + l] = power[w]; }
        }
        if (clock->loads[l]->wrenches > 0U) { one_link_push(pushed, u[l]); }
        if (clock->loads[l]->given != NULL) { moved = 1; }
    }
    gather(u[0], 2, (size_t)clock->here, 0, 2, force);
    if (moved) {
        gather(own[0], 2, (size_t)clock->here, 0, 2, q);
        gather(rate[0], 2, (size_t)clock->here, 0, 2, v);
    }
}

/* Put given motions of a lane at a time into q and v. */
static void one_link_moves_to_lanes(const one_link_clock_lanes *restrict clock, int l, one_link_instant at, lanes *restrict q, lanes *restrict v)
{
    const one_link_given *const given = (clock->loads[l] == NULL) ? NULL : clock->loads[l]->given;
    double x[2];
    double dx[2];
    double ddx[2];
    if (given == NULL) { return; }
    one_link_given_at(given, at, x, dx, ddx);
    for (int k = 0; k < given->size; ++k) {
        const int i = given->place[k];
        LANE(q[i], l) = x[k];
        LANE(v[i], l) = dx[k];
    }
}

/* Put given motions at the ends of lanes' steps into q and v, as steps come to them; they have no error. */
static void one_link_placed_lanes(const one_link_clock_lanes *restrict clock, lanes *restrict q, lanes *restrict v, lanes *restrict error)
{
    for (int l = 0; l < clock->here; ++l) {
        const one_link_given *const given = (clock->loads[l] == NULL) ? NULL : clock->loads[l]->given;
        one_link_moves_to_lanes(clock, l, one_link_instant_at_lanes(clock, l, 1.0), q, v);
        for (int k = 0; (given != NULL) && (k < given->size); ++k) {
            const int i = given->place[k];
            LANE(error[i], l) = 0.0;
            LANE(error[2 + i], l) = 0.0;
        }
    }
}

/* Whether drives are clipped. */
static int one_link_clips_lanes(const one_link_drive *restrict drive, const one_link_clock_lanes *restrict clock)
{
    return (clock->loads[0] != NULL) ? (clock->loads[0]->effort != NULL) : (drive->effort != NULL);
}

/* Forces u + kp (target - q) - kd v and those of loads, drives within their efforts; slope, if it is not NULL, becomes 0 where
 * these are clipped, else 1. */
static void one_link_forces_lanes(const lanes *restrict h, const one_link_drive *restrict drive, const one_link_clock_lanes *restrict clock, double share, int stage, const lanes *restrict u, const lanes *restrict target, lanes *restrict q, lanes *restrict v, lanes *restrict force, lanes *restrict slope)
{
    for (int i = 0; i < 2; ++i) {
        force[i] = u[i];
        if (drive->kp != NULL) { force[i] += drive->kp[i] * (target[i] - q[i]) - drive->kd[i] * v[i]; }
    }
    if ((clock->loads[0] == NULL) && (drive->effort != NULL)) { one_link_saturated_lanes(drive, force, slope); }
    (void)h;
    if (clock->loads[0] != NULL) { one_link_timed_lanes(NULL, clock, share, stage, q, v, force, slope); }
}

/* Accelerations under these forces; what cannot be solved is seen in the error that it makes. */
static void one_link_accelerated_lanes(const lanes *restrict h, const one_link_drive *restrict drive, const one_link_clock_lanes *restrict clock, double share, int stage, const lanes *restrict u, const lanes *restrict target, lanes *restrict q, lanes *restrict v, lanes *restrict a)
{
    lanes force[2];
    one_link_forces_lanes(h, drive, clock, share, stage, u, target, q, v, force, NULL);
    (void)one_link_forward_dynamics_lanes(h, q, v, force, a);
}

/* One step of the Rosenbrock method from accelerations a, with the factors of its matrix, which are kept; the end, and
 * the error, first of q, then of v. */
static void one_link_rosenbrock_lanes(const lanes *restrict h, const one_link_drive *restrict drive, const one_link_clock_lanes *restrict clock, const lanes *restrict u, const lanes *restrict target, lanes dt, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict q_end, lanes *restrict v_end, lanes *restrict kept, lanes *restrict error)
{
    const lanes inverse = ALL(1.0) / dt;
    lanes times[2];
    lanes kp[2];
    lanes kd[2];
    lanes right[2];
    lanes shifts[2];
    lanes w[2];
    lanes q_part[6][2];
    lanes v_part[6][2];
    times[0] = 0.3032708221029452 * dt;
    times[1] = times[0] * times[0];
    for (int i = 0; i < 2; ++i) {
        kp[i] = (drive->kp == NULL) ? ALL(0.0) : ALL(drive->kp[i]);
        kd[i] = (drive->kp == NULL) ? ALL(0.0) : ALL(drive->kd[i]);
    }
    for (int l = 0; (l < clock->here) && (clock->loads[0] != NULL); ++l) {
        const one_link_control *const control = clock->loads[l]->control;
        if ((control == NULL) || (control->kp == NULL)) { continue; }
        for (int k = 0; k < control->program.signal->columns; ++k) {
            const double ratio = control->ratio[k] * control->ratio[k];
            const int i = control->program.place[k];
            LANE(kp[i], l) += (control->kp[k] / ratio);
            LANE(kd[i], l) += (control->kd[k] / ratio);
        }
    }
    if (one_link_clips_lanes(drive, clock) != 0) { /* what is clipped does not answer to the state */
        lanes q_here[2];
        lanes v_here[2];
        lanes slope[2];
        (void)memcpy(q_here, q, sizeof q_here);
        (void)memcpy(v_here, v, sizeof v_here);
        one_link_forces_lanes(h, drive, clock, 0.0, 7, u, target, q_here, v_here, right, slope);
        for (int i = 0; i < 2; ++i) {
            kp[i] *= slope[i];
            kd[i] *= slope[i];
        }
    }
    (void)one_link_stage_factors_lanes(h, q, v, kp, kd, times, kept);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v[i];
        right[i] = a[i];
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[0][i] = times[0] * (right[i] + w[i]);
        q_part[0][i] = times[0] * (v_part[0][i] + shifts[i]);
    }
    if (clock->power != NULL) { (void)memcpy(&clock->power[(4) * (int)LANES], clock->power, (size_t)((4) * (int)LANES) * sizeof *clock->power); }
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v[i] + inverse * (-1.8485366682621636 * q_part[0][i]);
        right[i] = a[i] + inverse * (-1.8485366682621636 * v_part[0][i]);
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[1][i] = times[0] * (right[i] + w[i]);
        q_part[1][i] = times[0] * (v_part[1][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 1.9577095275421397 * q_part[0][i] + 0.09624753940753493 * q_part[1][i];
        v_end[i] = v[i] + 1.9577095275421397 * v_part[0][i] + 0.09624753940753493 * v_part[1][i];
    }
    one_link_accelerated_lanes(h, drive, clock, 0.6065416442058904, 2, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (-17.631601587128756 * q_part[0][i] + 10.558804728186503 * q_part[1][i]);
        right[i] = right[i] + inverse * (-17.631601587128756 * v_part[0][i] + 10.558804728186503 * v_part[1][i]);
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[2][i] = times[0] * (right[i] + w[i]);
        q_part[2][i] = times[0] * (v_part[2][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + -12.640540988794982 * q_part[0][i] + 11.47406531595545 * q_part[1][i] + -2.184901588069644 * q_part[2][i];
        v_end[i] = v[i] + -12.640540988794982 * v_part[0][i] + 11.47406531595545 * v_part[1][i] + -2.184901588069644 * v_part[2][i];
    }
    one_link_accelerated_lanes(h, drive, clock, -0.35634633722581177, 3, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (43.65182054686954 * q_part[0][i] + -40.087802443765035 * q_part[1][i] + 10.279818576010475 * q_part[2][i]);
        right[i] = right[i] + inverse * (43.65182054686954 * v_part[0][i] + -40.087802443765035 * v_part[1][i] + 10.279818576010475 * v_part[2][i]);
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[3][i] = times[0] * (right[i] + w[i]);
        q_part[3][i] = times[0] * (v_part[3][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 45.22669571531797 * q_part[0][i] + -34.051994120856214 * q_part[1][i] + 9.233342776456102 * q_part[2][i] + -2.585735849637662 * q_part[3][i];
        v_end[i] = v[i] + 45.22669571531797 * v_part[0][i] + -34.051994120856214 * v_part[1][i] + 9.233342776456102 * v_part[2][i] + -2.585735849637662 * v_part[3][i];
    }
    one_link_accelerated_lanes(h, drive, clock, 1.1568159026419864, 4, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (-105.84058964242176 * q_part[0][i] + 89.65494156265976 * q_part[1][i] + -24.593504310310063 * q_part[2][i] + 8.468103283975356 * q_part[3][i]);
        right[i] = right[i] + inverse * (-105.84058964242176 * v_part[0][i] + 89.65494156265976 * v_part[1][i] + -24.593504310310063 * v_part[2][i] + 8.468103283975356 * v_part[3][i]);
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[4][i] = times[0] * (right[i] + w[i]);
        q_part[4][i] = times[0] * (v_part[4][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 44.59618164199451 * q_part[0][i] + -35.304949600239034 * q_part[1][i] + 9.10972197560695 * q_part[2][i] + -2.286091141567749 * q_part[3][i] + 0.18287548796164538 * q_part[4][i];
        v_end[i] = v[i] + 44.59618164199451 * v_part[0][i] + -35.304949600239034 * v_part[1][i] + 9.10972197560695 * v_part[2][i] + -2.286091141567749 * v_part[3][i] + 0.18287548796164538 * v_part[4][i];
    }
    one_link_accelerated_lanes(h, drive, clock, 1.0, 5, u, target, q_end, v_end, right);
    for (int i = 0; i < 2; ++i) {
        shifts[i] = v_end[i] + inverse * (-132.02707597161847 * q_part[0][i] + 97.96337774644046 * q_part[1][i] + -31.303025590584195 * q_part[2][i] + 9.868030987977615 * q_part[3][i] + -1.7691899740810053 * q_part[4][i]);
        right[i] = right[i] + inverse * (-132.02707597161847 * v_part[0][i] + 97.96337774644046 * v_part[1][i] + -31.303025590584195 * v_part[2][i] + 9.868030987977615 * v_part[3][i] + -1.7691899740810053 * v_part[4][i]);
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) {
        v_part[5][i] = times[0] * (right[i] + w[i]);
        q_part[5][i] = times[0] * (v_part[5][i] + shifts[i]);
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + 44.59618164199451 * q_part[0][i] + -35.304949600239034 * q_part[1][i] + 9.10972197560695 * q_part[2][i] + -2.286091141567749 * q_part[3][i] + 0.1828754879616454 * q_part[4][i] + 1.0 * q_part[5][i];
        v_end[i] = v[i] + 44.59618164199451 * v_part[0][i] + -35.304949600239034 * v_part[1][i] + 9.10972197560695 * v_part[2][i] + -2.286091141567749 * v_part[3][i] + 0.1828754879616454 * v_part[4][i] + 1.0 * v_part[5][i];
        error[i] = 0.7641522361446427 * q_part[0][i] + -0.6573679684815938 * q_part[1][i] + 0.14144711229099638 * q_part[2][i] + -0.01754850566540496 * q_part[3][i] + -0.030774661879316458 * q_part[4][i] + 0.08701562938055106 * q_part[5][i];
        error[2 + i] = 0.7641522361446427 * v_part[0][i] + -0.6573679684815938 * v_part[1][i] + 0.14144711229099638 * v_part[2][i] + -0.01754850566540496 * v_part[3][i] + -0.030774661879316458 * v_part[4][i] + 0.08701562938055106 * v_part[5][i];
    }
}

/* One step of the explicit method; ``a`` holds the accelerations at its beginning, ``a_end`` becomes those at its end. */
static void one_link_tsit5_lanes(const lanes *restrict h, const one_link_drive *restrict drive, const one_link_clock_lanes *restrict clock, const lanes *restrict u, const lanes *restrict target, lanes dt, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, lanes *restrict q_end, lanes *restrict v_end, lanes *restrict a_end, lanes *restrict error)
{
    lanes q_rate[7][2];
    lanes v_rate[7][2];
    for (int i = 0; i < 2; ++i) {
        q_rate[0][i] = v[i];
        v_rate[0][i] = a[i];
    }
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (0.161 * q_rate[0][i]);
        v_end[i] = v[i] + dt * (0.161 * v_rate[0][i]);
    }
    one_link_accelerated_lanes(h, drive, clock, 0.161, 1, u, target, q_end, v_end, v_rate[1]);
    (void)memcpy(q_rate[1], v_end, sizeof q_rate[1]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (-0.008480655492356989 * q_rate[0][i] + 0.335480655492357 * q_rate[1][i]);
        v_end[i] = v[i] + dt * (-0.008480655492356989 * v_rate[0][i] + 0.335480655492357 * v_rate[1][i]);
    }
    one_link_accelerated_lanes(h, drive, clock, 0.327, 2, u, target, q_end, v_end, v_rate[2]);
    (void)memcpy(q_rate[2], v_end, sizeof q_rate[2]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (2.8971530571054935 * q_rate[0][i] + -6.359448489975075 * q_rate[1][i] + 4.3622954328695815 * q_rate[2][i]);
        v_end[i] = v[i] + dt * (2.8971530571054935 * v_rate[0][i] + -6.359448489975075 * v_rate[1][i] + 4.3622954328695815 * v_rate[2][i]);
    }
    one_link_accelerated_lanes(h, drive, clock, 0.8999999999999999, 3, u, target, q_end, v_end, v_rate[3]);
    (void)memcpy(q_rate[3], v_end, sizeof q_rate[3]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (5.325864828439257 * q_rate[0][i] + -11.748883564062828 * q_rate[1][i] + 7.4955393428898365 * q_rate[2][i] + -0.09249506636175525 * q_rate[3][i]);
        v_end[i] = v[i] + dt * (5.325864828439257 * v_rate[0][i] + -11.748883564062828 * v_rate[1][i] + 7.4955393428898365 * v_rate[2][i] + -0.09249506636175525 * v_rate[3][i]);
    }
    one_link_accelerated_lanes(h, drive, clock, 0.9800255409045104, 4, u, target, q_end, v_end, v_rate[4]);
    (void)memcpy(q_rate[4], v_end, sizeof q_rate[4]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (5.86145544294642 * q_rate[0][i] + -12.92096931784711 * q_rate[1][i] + 8.159367898576159 * q_rate[2][i] + -0.071584973281401 * q_rate[3][i] + -0.028269050394068383 * q_rate[4][i]);
        v_end[i] = v[i] + dt * (5.86145544294642 * v_rate[0][i] + -12.92096931784711 * v_rate[1][i] + 8.159367898576159 * v_rate[2][i] + -0.071584973281401 * v_rate[3][i] + -0.028269050394068383 * v_rate[4][i]);
    }
    one_link_accelerated_lanes(h, drive, clock, 1.0, 5, u, target, q_end, v_end, v_rate[5]);
    (void)memcpy(q_rate[5], v_end, sizeof q_rate[5]);
    for (int i = 0; i < 2; ++i) {
        q_end[i] = q[i] + dt * (0.09646076681806523 * q_rate[0][i] + 0.01 * q_rate[1][i] + 0.4798896504144996 * q_rate[2][i] + 1.379008574103742 * q_rate[3][i] + -3.290069515436081 * q_rate[4][i] + 2.324710524099774 * q_rate[5][i]);
        v_end[i] = v[i] + dt * (0.09646076681806523 * v_rate[0][i] + 0.01 * v_rate[1][i] + 0.4798896504144996 * v_rate[2][i] + 1.379008574103742 * v_rate[3][i] + -3.290069515436081 * v_rate[4][i] + 2.324710524099774 * v_rate[5][i]);
    }
    one_link_accelerated_lanes(h, drive, clock, 1.0, 6, u, target, q_end, v_end, v_rate[6]);
    (void)memcpy(q_rate[6], v_end, sizeof q_rate[6]);
    for (int i = 0; i < 2; ++i) {
        a_end[i] = v_rate[6][i];
        error[i] = dt * (-0.001780011052225771 * q_rate[0][i] + -0.0008164344596567469 * q_rate[1][i] + 0.007880878010261995 * q_rate[2][i] + -0.1447110071732629 * q_rate[3][i] + 0.5823571654525552 * q_rate[4][i] + -0.45808210592918697 * q_rate[5][i] + 0.015151515151515152 * q_rate[6][i]);
        error[2 + i] = dt * (-0.001780011052225771 * v_rate[0][i] + -0.0008164344596567469 * v_rate[1][i] + 0.007880878010261995 * v_rate[2][i] + -0.1447110071732629 * v_rate[3][i] + 0.5823571654525552 * v_rate[4][i] + -0.45808210592918697 * v_rate[5][i] + 0.015151515151515152 * v_rate[6][i]);
    }
}

/* Drives and targets that act from a sample on, into a lane. */
static void one_link_hold_lanes(const one_link_drive *restrict drive, size_t state, size_t sample, int l, lanes *restrict u, lanes *restrict target)
{
    const double *const given = &drive->u[state * drive->u_state + sample * drive->u_step];
    (void)l;
    for (int i = 0; i < 2; ++i) {
        LANE(u[i], l) = given[i];
        if (drive->kp != NULL) { LANE(target[i], l) = drive->target[state * drive->target_state + sample * drive->target_step + (size_t)i]; }
    }
}

/* The greatest error of a lane's step beside what is allowed, and which number of the state has it; NaN counts as too great. */
static double one_link_excess_lanes(const one_link_tolerance *restrict allowed, int l, const lanes *restrict q, const lanes *restrict v, const lanes *restrict q_end, const lanes *restrict v_end, const lanes *restrict error, int *restrict where)
{
    double worst = 0.0;
    (void)l;
    *where = 0;
    for (int i = 0; i < 4; ++i) {
        const double begin = fabs(LANE((i < 2 ? q[i] : v[i - 2]), l));
        const double end = fabs(LANE((i < 2 ? q_end[i] : v_end[i - 2]), l));
        if (!(end < HUGE_VAL)) {
            *where = i;
            return HUGE_VAL;
        }
        const double size = (double)allowed->atol[i] + allowed->rtol * (begin > end ? begin : end);
        const double ratio = fabs(LANE(error[i], l)) / size;
        if (!(ratio <= worst)) {
            worst = ratio;
            *where = i;
            if (!(ratio < HUGE_VAL)) { return HUGE_VAL; }
        }
    }
    return worst;
}

/* A first step, from the sizes of the state and of its change. */
static double one_link_first_lanes(const one_link_tolerance *restrict allowed, int l, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a)
{
    double size = 0.0;
    double change = 0.0;
    (void)l;
    for (int i = 0; i < 4; ++i) {
        const double x = fabs(LANE((i < 2 ? q[i] : v[i - 2]), l));
        const double rate = fabs(LANE((i < 2 ? v[i] : a[i - 2]), l));
        const double least = (double)allowed->atol[i] + allowed->rtol * x;
        if (x / least > size) { size = x / least; }
        if (rate / least > change) { change = rate / least; }
    }
    return (size < 1e-5 || !(change > 1e-5)) ? 1e-6 : 0.01 * size / change;
}

/* What powers of a lane's stages make of a step, J: whole, or up to a share of the explicit one. */
static double one_link_worked_lanes(const double *restrict power, int work, int l, int method, double step, double share)
{
    static const double rosenbrock[6] = { 2.66325806659267, -2.291088688834055, 0.49297789757946875, -0.0611608486626099, -0.10725724877841863, 0.3032708221029452 };
    static const double tsit5[7][4] = { { 1.0, -2.763706197274826, 2.9132554618219126, -1.0530884977290216 }, { 0.0, 0.1317, -0.2234, 0.1017 }, { 0.0, 3.9302962368947516, -5.941033872131505, 2.490627285651253 }, { 0.0, -12.411077166933676, 30.33818863028232, -16.548102889244902 }, { 0.0, 37.50931341651104, -88.1789048947664, 47.37952196281928 }, { 0.0, -27.896526289197286, 65.09189467479366, -34.87065786149661 }, { 0.0, 1.5, -4.0, 2.5 } };
    double found = 0.0;
    (void)l;
    for (int stage = 0; stage < ((method == 1) ? 7 : 6); ++stage) {
        double weight = 0.0;
        for (int k = 3; k >= 0; --k) { weight = share * (weight + tsit5[stage][k]); }
        if (method != 1) { weight = rosenbrock[stage]; }
        found += weight * power[(stage * 4 + work) * (int)LANES + l];
    }
    return step * found;
}

/* What accelerations at both ends of a step of the Rosenbrock method say of rates in between that coordinates and rates there
 * do not, as its matrix damps that: accelerations of stiff coordinates are full of their errors. */
static void one_link_bent_lanes(const lanes *restrict h, const lanes *restrict kept, lanes dt, const lanes *restrict v, const lanes *restrict a, const lanes *restrict v_end, const lanes *restrict a_end, lanes *restrict bend)
{
    const lanes time = 0.3032708221029452 * dt;
    lanes right[2];
    lanes shifts[2];
    lanes w[2];
    for (int i = 0; i < 2; ++i) {
        shifts[i] = ALL(0.0);
        right[i] = (dt * (a[i] + a_end[i]) - (v_end[i] - v[i]) - (v_end[i] - v[i])) / time;
    }
    (void)one_link_stage_solution_lanes(h, kept, right, shifts, w);
    for (int i = 0; i < 2; ++i) { bend[i] = time * (right[i] + w[i]); }
}

/* A lane's state at a share of its step: of the explicit method the polynomial of degree 5 with its coordinates, rates and
 * accelerations, of the other one the cubic without the latter, and what is bent. */
static void one_link_between_lanes(double share, double step, int l, int method, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, const lanes *restrict q_end, const lanes *restrict v_end, const lanes *restrict a_end, const lanes *restrict bend, double *restrict q_out, double *restrict v_out)
{
    const double s = share;
    (void)l;
    for (int i = 0; i < 2; ++i) {
        const double q0 = LANE(q[i], l);
        const double d = LANE(q_end[i], l) - q0;
        const double v0 = step * LANE(v[i], l);
        const double v1 = step * LANE(v_end[i], l);
        double c2 = 3.0 * d - 2.0 * v0 - v1;
        double c3 = v0 + v1 - 2.0 * d;
        double c4 = 0.0;
        double c5 = 0.0;
        if (method == 1) {
            const double a0 = 0.5 * step * step * LANE(a[i], l);
            const double a1 = 0.5 * step * step * LANE(a_end[i], l);
            c2 = a0;
            c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 3.0 * a0 + a1;
            c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 3.0 * a0 - 2.0 * a1;
            c5 = 6.0 * d - 3.0 * (v0 + v1) - a0 + a1;
        } else {
            c4 = 0.25 * step * LANE(bend[i], l);
            c2 += c4;
            c3 -= 2.0 * c4;
        }
        const double place = q0 + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        const double rate = (v0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / step;
        q_out[i] = place;
        v_out[i] = rate;
    }
}

/* The works of a lane at a share of its step, J: of the explicit method by its own weights there, of the other one on the
 * cubic with powers at both ends. */
static void one_link_works_between_lanes(double share, double step, int l, int method, const double *restrict power, const double *restrict begin, const double *restrict end, double *restrict out)
{
    (void)l;
    for (int w = 0; w < 4; ++w) {
        const double d = end[w] - begin[w];
        const double p0 = step * power[(w) * (int)LANES + l];
        const double p1 = step * power[(24 + w) * (int)LANES + l];
        if (method == 1) {
            out[w] = begin[w] + one_link_worked_lanes(power, w, l, method, step, share);
        } else {
            out[w] = begin[w] + share * (p0 + share * (3.0 * d - 2.0 * p0 - p1 + share * (p0 + p1 - 2.0 * d)));
        }
    }
}

/* Whether powers change too much within a lane's step for its stages to say what works are: the motion, of prescribed
 * coordinates, say, or of a mass that moves freely, may be without an error nevertheless. */
static int one_link_doubtful_lanes(const double *restrict power, const double *restrict work, int l, int method, double step, double rtol)
{
    static const double wrong[2][7] = { { 0.16149752429294262, -0.18684096907609637, 0.00912393277044904, 0.013322280951927667, -0.023492070397267834, 0.02638930145804491, 0.0 }, { -0.001780011052225771, -0.0008164344596567469, 0.007880878010261995, -0.1447110071732629, 0.5823571654525552, -0.45808210592918697, 0.015151515151515152 } };
    int found = 0;
    (void)l;
    for (int w = 0; w < 4; ++w) {
        double error = 0.0;
        double top = 0.0;
        for (int stage = 0; stage < ((method == 1) ? 7 : 6); ++stage) {
            const double here = power[(stage * 4 + w) * (int)LANES + l];
            error += wrong[method][stage] * here;
            if (fabs(here) > top) { top = fabs(here); }
        }
        if (step * fabs(error) > 10.0 * rtol * (fabs(work[w]) + step * top)) { found = 1; }
    }
    return found;
}

/* Add works of a lane between two shares of its step, J, by Gauss's rule along the polynomial on which its samples lie, on
 * halves until that changes little. */
static void one_link_reckon_lanes(const lanes *restrict h, const one_link_drive *restrict drive, const one_link_clock_lanes *restrict clock, const lanes *restrict u, const lanes *restrict target, int l, int method, double from, double to, double rtol, const lanes *restrict q, const lanes *restrict v, const lanes *restrict a, const lanes *restrict q_end, const lanes *restrict v_end, const lanes *restrict a_end, const lanes *restrict bend, double *restrict work)
{
    static const double node[5] = { 0.04691007703066802, 0.23076534494715845, 0.5, 0.7692346550528415, 0.9530899229693319 };
    static const double weight[5] = { 0.11846344252809454, 0.23931433524968324, 0.2844444444444444, 0.23931433524968324, 0.11846344252809454 };
    const double *const power = &clock->power[(28) * (int)LANES + l];
    double last[4];
    double found[4];
    int settled = 0;
    (void)memset(last, 0, sizeof last);
    for (int pieces = 1; (pieces <= 64) && (settled == 0); pieces *= 2) {
        const double part = (to - from) / (double)pieces;
        double top[4];
        (void)memset(found, 0, sizeof found);
        (void)memset(top, 0, sizeof top);
        for (int k = 0; k < 5 * pieces; ++k) {
            const int piece = k / 5;
            const double share = from + part * ((double)piece + node[k % 5]);
            double own[2];
            double rate[2];
            lanes q_here[2];
            lanes v_here[2];
            lanes a_here[2];
            one_link_between_lanes(share, clock->step[l], l, method, q, v, a, q_end, v_end, a_end, bend, own, rate);
            for (int i = 0; i < 2; ++i) {
                q_here[i] = q_end[i];
                v_here[i] = v_end[i];
                LANE(q_here[i], l) = own[i];
                LANE(v_here[i], l) = rate[i];
            }
            one_link_accelerated_lanes(h, drive, clock, share, 7, u, target, q_here, v_here, a_here);
            for (int w = 0; w < 4; ++w) {
                const double here = clock->step[l] * power[(w) * (int)LANES];
                found[w] += part * weight[k % 5] * here;
                if (fabs(here) > top[w]) { top[w] = fabs(here); }
            }
        }
        settled = (pieces > 1) ? 1 : 0;
        for (int w = 0; w < 4; ++w) {
            if (fabs(found[w] - last[w]) > rtol * (fabs(work[w]) + (to - from) * top[w])) { settled = 0; }
            last[w] = found[w];
        }
    }
    for (int w = 0; w < 4; ++w) { work[w] += last[w]; }
}

/* Go on with up to LANES states, those at ``place``, from where their progress is, each by steps of its own; at most so
 * many in this call.  The numbers at ``place`` behind the ones that are here are those of one of them. */
static void one_link_adapt_lanes(const lanes *restrict h, const one_link_drive *restrict drive, const one_link_loads *restrict loads, size_t loads_step, const one_link_tolerance *restrict allowed, size_t allowed_step, const size_t *restrict place, int here, const double *restrict times, size_t samples, int method, lanes *restrict q, lanes *restrict v, double *restrict q_out, double *restrict v_out, one_link_progress *restrict progress, one_link_record *restrict record)
{
    const size_t stride = (samples + 1U) * 2U;
    const double end = times[samples];
    const double duration = end - times[0];
    const int held = ((drive->u_step == 0U) && (drive->target_step == 0U)) ? 1 : 0;
    const int dense = held;
    const double order = method == 1 ? 0.2 : 0.25;
    lanes u[2];
    lanes target[2];
    lanes a[2];
    lanes a_end[2];
    lanes q_end[2];
    lanes v_end[2];
    lanes error[4];
    lanes kept[8];
    lanes bend[2];
    lanes dt = ALL(1.0);
    one_link_clock_lanes clock;
    double step[LANES];
    long long most = 0;
    int going[LANES];
    int lands[LANES] = { 0 };
    int halts[LANES] = { 0 }; /* whether loads jump where it lands */
    int taken[LANES];
    int known[LANES] = { 0 }; /* whether a has the accelerations */
    int left = 0;
    double power[(32) * (int)LANES];
    const int works = ((loads != NULL) && (loads->work != NULL)) ? 1 : 0;
    for (int l = 0; l < LANES; ++l) {
        one_link_progress *const p = &progress[place[l]];
        const long long own = allowed[place[l] * allowed_step].most;
        most = (own > most) ? own : most;
        going[l] = ((l < here) && (p->reason == 0)) ? 1 : 0;
        step[l] = duration;
        left += going[l];
        clock.loads[l] = (loads == NULL) ? NULL : &loads[place[l] * loads_step];
        one_link_hold_lanes(drive, place[l], ((p->sample > 0U) && (p->sample <= samples)) ? p->sample - 1U : 0U, l, u, target);
        if ((going[l] != 0) && (p->sample == 0U)) {
            for (int i = 0; i < 2; ++i) {
                q_out[place[l] * stride + (size_t)i] = LANE(q[i], l);
                v_out[place[l] * stride + (size_t)i] = LANE(v[i], l);
            }
            if (p->works != NULL) { (void)memcpy(p->works, p->work, sizeof p->work); }
            p->sample = 1;
            p->t = times[0];
            p->looked = times[0];
        }
    }
    clock.power = (works == 0) ? NULL : power;
    clock.here = here;
    (void)memset(a_end, 0, sizeof a_end);
    (void)memset(kept, 0, sizeof kept);
    (void)memset(bend, 0, sizeof bend);
    for (long long pass = 0; (left > 0) && (pass < most) && ((record == NULL) || (record->count < record->room)); ++pass) {
        int fresh = 0;
        for (int l = 0; l < LANES; ++l) {
            const one_link_progress *const p = &progress[place[l]];
            if ((going[l] != 0) && (pass >= allowed[place[l] * allowed_step].most)) {
                going[l] = 0;
                left -= 1;
            }
            clock.begin[l] = p->t;
            clock.step[l] = 0.0;
            clock.end[l] = p->t;
            clock.after[l] = p->t;
            clock.before[l] = p->t;
            clock.stop[l] = HUGE_VAL;
            if ((clock.loads[l] != NULL) && (clock.loads[l]->stops > 0U)) {
                const size_t count = one_link_stops_until(clock.loads[l], p->t);
                if (count < clock.loads[l]->stops) { clock.stop[l] = clock.loads[l]->stop[count]; }
                if (one_link_jumps_at(clock.loads[l], p->t) != 0) { clock.after[l] = p->t + 1e-7 * (((clock.stop[l] < end) ? clock.stop[l] : end) - p->t); }
            }
            if ((going[l] != 0) && (known[l] == 0)) { fresh = 1; }
        }
        if (fresh != 0) { one_link_accelerated_lanes(h, drive, &clock, 0.0, 0, u, target, q, v, a); }
        for (int l = 0; l < LANES; ++l) {
            one_link_progress *const p = &progress[place[l]];
            known[l] = 1;
            if (going[l] == 0) { continue; }
            if (!(p->next > 0.0)) { p->next = one_link_first_lanes(&allowed[place[l] * allowed_step], l, q, v, a); }
            double goal = (dense != 0) ? end : times[p->sample];
            const int stops = (clock.stop[l] <= goal) ? 1 : 0;
            if (stops != 0) { goal = clock.stop[l]; }
            const double rest = goal - p->t;
            lands[l] = (p->next * 1.000001 >= rest) ? 1 : 0;
            step[l] = (lands[l] != 0) ? rest : (2.0 * p->next > rest ? 0.5 * rest : p->next);
            clock.step[l] = step[l];
            clock.end[l] = (lands[l] != 0) ? goal : (p->t + step[l]);
            halts[l] = ((lands[l] != 0) && (stops != 0)) ? 1 : 0;
            clock.before[l] = (halts[l] != 0) ? (clock.end[l] - 1e-3 * step[l]) : clock.end[l];
            LANE(dt, l) = step[l];
        }
        if (method == 0) {
            one_link_rosenbrock_lanes(h, drive, &clock, u, target, dt, q, v, a, q_end, v_end, kept, error);
        } else {
            one_link_tsit5_lanes(h, drive, &clock, u, target, dt, q, v, a, q_end, v_end, a_end, error);
        }
        if (loads != NULL) { one_link_placed_lanes(&clock, q_end, v_end, error); }
        for (int l = 0; l < LANES; ++l) {
            taken[l] = 0;
            if (going[l] == 0) { continue; }
            one_link_progress *const p = &progress[place[l]];
            int where = 0;
            const double excess = one_link_excess_lanes(&allowed[place[l] * allowed_step], l, q, v, q_end, v_end, error, &where);
            double factor = 0.9 * pow(excess, -order);
            taken[l] = (excess <= 1.0) ? 1 : 0;
            if ((taken[l] != 0) && (excess > 0.0)) { factor *= pow(excess, 0.06) * pow(p->excess > 0.0 ? p->excess : 1e-4, 0.08); } /* proportional-integral control */
            factor = factor > 5.0 ? 5.0 : (factor < 0.2 ? 0.2 : factor);
            if (taken[l] == 0) {
                p->rejected += 1;
                p->refused = 1;
                p->next = step[l] * factor;
                if (p->next <= 1e-14 * duration) { p->reason = 2 + where; }
            } else {
                if ((p->refused != 0) && (factor > 1.0)) { factor = 1.0; }
                p->refused = 0;
                p->excess = excess > 1e-4 ? excess : 1e-4;
                if (p->next < step[l] * factor || !(step[l] < p->next)) { p->next = step[l] * factor; }
            }
            if (p->steps + p->rejected >= p->counted + 2000) { /* work that leads nowhere is no motion */
                if (p->t - p->looked < 1e-07 * duration) { p->reason = 2 + where; }
                p->looked = p->t;
                p->counted = p->steps + p->rejected;
            }
            if (p->reason != 0) {
                taken[l] = 0;
                going[l] = 0;
                left -= 1;
            }
        }
        int inside = 0; /* whether something asks for what is within a step */
        for (int l = 0; (method != 1) && (l < LANES); ++l) {
            if (taken[l] == 0) { continue; }
            if ((dense != 0) && (times[progress[place[l]].sample] < clock.end[l])) { inside = 1; }
            if ((works != 0) && (one_link_doubtful_lanes(power, progress[place[l]].work, l, method, step[l], allowed[place[l] * allowed_step].rtol) != 0)) { inside = 1; }
        }
        if (inside != 0) {
            one_link_accelerated_lanes(h, drive, &clock, 1.0, 6, u, target, q_end, v_end, a_end);
            one_link_bent_lanes(h, kept, dt, v, a, v_end, a_end, bend);
        }
        for (int l = 0; l < LANES; ++l) {
            if (taken[l] == 0) { continue; }
            one_link_progress *const p = &progress[place[l]];
            const double before = p->t;
            known[l] = ((halts[l] == 0) && ((method == 1) || (inside != 0))) ? 1 : 0;
            double worked[4];
            (void)memcpy(worked, p->work, sizeof worked);
            const int reckons = (works != 0) ? one_link_doubtful_lanes(power, p->work, l, method, step[l], allowed[place[l] * allowed_step].rtol) : 0;
            double share = 0.0; /* up to which works are reckoned */
            for (int w = 0; (works != 0) && (reckons == 0) && (w < 4); ++w) { p->work[w] += one_link_worked_lanes(power, w, l, method, step[l], 1.0); }
            p->steps += 1;
            p->t = clock.end[l];
            if (step[l] > p->largest) { p->largest = step[l]; }
            if (p->steps == 1 || step[l] < p->smallest) { p->smallest = step[l]; }
            while ((p->sample <= samples) && (((lands[l] != 0) || (dense != 0)) && (times[p->sample] <= p->t))) {
                double *const q_row = &q_out[place[l] * stride + p->sample * 2U];
                double *const v_row = &v_out[place[l] * stride + p->sample * 2U];
                double *const work_row = (p->works == NULL) ? NULL : &p->works[p->sample * 4U];
                const double time = times[p->sample];
                if (reckons != 0) {
                    const double until = (time < p->t) ? ((time - before) / step[l]) : 1.0;
                    one_link_reckon_lanes(h, drive, &clock, u, target, l, method, share, until, allowed[place[l] * allowed_step].rtol, q, v, a, q_end, v_end, a_end, bend, p->work);
                    share = until;
                }
                if ((dense != 0) && (time < p->t)) {
                    one_link_between_lanes((time - before) / step[l], step[l], l, method, q, v, a, q_end, v_end, a_end, bend, q_row, v_row);
                    if ((work_row != NULL) && (reckons != 0)) { (void)memcpy(work_row, p->work, sizeof p->work); }
                    if ((work_row != NULL) && (reckons == 0)) { one_link_works_between_lanes((time - before) / step[l], step[l], l, method, power, worked, p->work, work_row); }
                } else
                {
                    if (halts[l] != 0) { one_link_moves_to_lanes(&clock, l, one_link_instant_of(p->t), q_end, v_end); }
                    for (int i = 0; i < 2; ++i) {
                        q_row[i] = LANE(q_end[i], l);
                        v_row[i] = LANE(v_end[i], l);
                    }
                    if (work_row != NULL) { (void)memcpy(work_row, p->work, sizeof p->work); }
                }
                p->sample += 1U;
                if ((held == 0) && (p->sample <= samples)) {
                    one_link_hold_lanes(drive, place[l], p->sample - 1U, l, u, target);
                    known[l] = 0;
                }
            }
            if ((reckons != 0) && (share < 1.0)) { one_link_reckon_lanes(h, drive, &clock, u, target, l, method, share, 1.0, allowed[place[l] * allowed_step].rtol, q, v, a, q_end, v_end, a_end, bend, p->work); }
            if (halts[l] != 0) { one_link_moves_to_lanes(&clock, l, one_link_instant_of(p->t), q_end, v_end); }
            for (int i = 0; i < 2; ++i) {
                LANE(q[i], l) = LANE(q_end[i], l);
                LANE(v[i], l) = LANE(v_end[i], l);
                LANE(a[i], l) = LANE(a_end[i], l);
            }
            for (int w = 0; (works != 0) && (w < 4); ++w) { power[(w) * (int)LANES + l] = power[(24 + w) * (int)LANES + l]; }
            if (record != NULL) {
                record->t[record->count] = p->t;
                for (int i = 0; i < 2; ++i) {
                    record->q[record->count * 2U + (size_t)i] = LANE(q[i], l);
                    record->v[record->count * 2U + (size_t)i] = LANE(v[i], l);
                }
                record->count += 1U;
            }
            if (p->sample > samples) {
                p->reason = 1;
                going[l] = 0;
                left -= 1;
            }
        }
    }
}

/* Several states, each by steps of its own, those at ``place``, or the first ones: what one of them does changes no bit of
 * another. */
void one_link_adaptive_rollout_batch(size_t count, const size_t *restrict place, const double *restrict h, size_t h_step, const one_link_drive *restrict drive, const one_link_loads *restrict loads, size_t loads_step, const one_link_tolerance *restrict allowed, size_t allowed_step, const double *restrict times, size_t samples, int method, double *restrict q, double *restrict v, double *restrict q_out, double *restrict v_out, one_link_progress *restrict progress)
{
    lanes h_lanes[7], q_lanes[2], v_lanes[2];
    double rows[2][LANES][2];
    for (size_t i = 0; i < count; i += LANES) {
        const size_t here = count - i < LANES ? count - i : LANES;
        size_t at[LANES];
        for (size_t l = 0; l < LANES; ++l) {
            const size_t k = i + (l < here ? l : 0);
            at[l] = place == NULL ? k : place[k];
            memcpy(rows[0][l], q + at[l] * 2, sizeof rows[0][l]);
            memcpy(rows[1][l], v + at[l] * 2, sizeof rows[1][l]);
            if (h_step != 0 || i == 0)
                for (int j = 0; j < 7; ++j) LANE(h_lanes[j], l) = h[at[l] * h_step + (size_t)j];
        }
        gather(rows[0][0], 2, LANES, 0, 2, q_lanes);
        gather(rows[1][0], 2, LANES, 0, 2, v_lanes);
        one_link_adapt_lanes(h_lanes, drive, loads, loads_step, allowed, allowed_step, at, (int)here, times, samples, method, q_lanes, v_lanes, q_out, v_out, progress, NULL);
        scatter(q_lanes, NULL, LANES, 0, 2, 2, rows[0][0]);
        scatter(v_lanes, NULL, LANES, 0, 2, 2, rows[1][0]);
        for (size_t l = 0; l < here; ++l) {
            memcpy(q + at[l] * 2, rows[0][l], sizeof rows[0][l]);
            memcpy(v + at[l] * 2, rows[1][l], sizeof rows[1][l]);
        }
    }
}

#endif /* several states at a time */
