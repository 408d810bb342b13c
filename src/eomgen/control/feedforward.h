/* feedforward.h: deflections e of elastic gears from the forces f that they transmit, phi(e) + d e' = f.
 *
 * Springs phi rise with the deflection.  Without a damper d they are inverted, by Newton's method between bounds that close in.
 * With one the deflection obeys a stable differential equation, over polynomials between samples of f and its time
 * derivatives: of straight lines exactly, of other springs by Radau's method of order 5.  All loops have a bound.
 * precision.h comes before this file, math.h as well. */
#ifndef EOM_FEEDFORWARD_H
#define EOM_FEEDFORWARD_H

#define EOM_FEEDFORWARD_TRIES 100                /* evaluations of springs that are inverted, at most; about 5 are usual */
#define EOM_FEEDFORWARD_STEPS 20                 /* of Newton's method in a step of Radau's, at most */
#define EOM_FEEDFORWARD_ROOM(n) (12 * (n))       /* numbers of work, for all of it */
#define EOM_FARTHEST ((EOM_SCALAR)1e9)           /* m or rad */
#define EOM_ENOUGH ((EOM_SCALAR)4.0 * (EOM_SCALAR)EOM_ROUND_OFF)
#if defined(EOM_SINGLE)
#define EOM_CLOSE EOM_C(1e-4) /* of its scale: what a force is off where it is the one that is wanted */
#define EOM_FLAT EOM_C(1e-6)  /* of the steepest slope of a spring: below it there is none */
#else
#define EOM_CLOSE EOM_C(1e-9)
#define EOM_FLAT EOM_C(1e-9)
#endif

/* Writes forces phi of n springs at deflections e, their first and their second derivatives, (3, n). */
typedef void (*EOM(feedforward_springs))(const EOM_SCALAR *h, const EOM_SCALAR *e, EOM_SCALAR *phi);

/* Find the deflections e, n, at which springs have the forces f.  still: phi and slopes at e = 0, (2, n).  phi, (3, n), gets what
 * springs say at e.  Returns 0, or 1 + the number of a spring that has no such force, or none that rises there.  work: 4 n. */
EOM_LOCAL int EOM(feedforward_wind)(int n, EOM(feedforward_springs) springs, const EOM_SCALAR *h, const EOM_SCALAR *f, const EOM_SCALAR *still, EOM_SCALAR *e, EOM_SCALAR *phi, EOM_SCALAR *work)
{
    EOM_SCALAR *const low = work;
    EOM_SCALAR *const high = &work[n];
    EOM_SCALAR *const before = &work[2 * n]; /* the last change; 0 of a spring that is done */
    EOM_SCALAR *const steepest = &work[3 * n];
    for (int i = 0; i < n; ++i) {
        const EOM_SCALAR more = f[i] - still[i];
        const EOM_SCALAR slope = still[n + i];
        e[i] = (slope > EOM_C(0.0)) ? (more / slope) : EOM_C(0.0);
        low[i] = (more > EOM_C(0.0)) ? EOM_C(0.0) : -EOM_FARTHEST;
        high[i] = (more < EOM_C(0.0)) ? EOM_C(0.0) : EOM_FARTHEST;
        before[i] = EOM_C(4.0) * EOM_FARTHEST;
        steepest[i] = EOM_MATH(fabs)(slope);
    }
    int moving = n;
    for (int tries = 0; (tries < EOM_FEEDFORWARD_TRIES) && (moving > 0); ++tries) {
        moving = 0;
        springs(h, e, phi);
        for (int i = 0; i < n; ++i) {
            const EOM_SCALAR off = phi[i] - f[i];
            const EOM_SCALAR slope = phi[n + i];
            const EOM_SCALAR here = e[i];
            if (!(before[i] > EOM_C(0.0))) { continue; }
            if (slope > steepest[i]) { steepest[i] = slope; }
            if (off > EOM_C(0.0)) {
                high[i] = here;
            } else if (off < EOM_C(0.0)) {
                low[i] = here;
            } else {
                before[i] = EOM_C(0.0);
                continue;
            }
            const EOM_SCALAR newton = here - off / slope;
            const EOM_SCALAR change = EOM_MATH(fabs)(newton - here);
            const EOM_SCALAR enough = EOM_ENOUGH * (EOM_MATH(fabs)(f[i]) + EOM_MATH(fabs)(still[i]));
            EOM_SCALAR left = EOM_MATH(fabs)(off) - enough; /* not above 0 where the spring is done */
            if ((slope > EOM_C(0.0)) && (newton > low[i]) && (newton < high[i]) && ((left <= EOM_C(0.0)) || (EOM_C(2.0) * change < before[i]))) {
                e[i] = newton;
            } else if (left <= EOM_C(0.0)) {
                e[i] = here;
            } else if ((low[i] > -EOM_FARTHEST) && (high[i] < EOM_FARTHEST)) {
                e[i] = low[i] + EOM_C(0.5) * (high[i] - low[i]);
                left = high[i] - low[i] - EOM_ENOUGH * EOM_MATH(fabs)(here);
            } else {
                const EOM_SCALAR outwards = EOM_MATH(fabs)(here) + EOM_MATH(fabs)(off) / steepest[i];
                const EOM_SCALAR next = (off > EOM_C(0.0)) ? (here - outwards) : (here + outwards);
                e[i] = (next > -EOM_FARTHEST) ? ((next < EOM_FARTHEST) ? next : EOM_FARTHEST) : -EOM_FARTHEST;
            }
            before[i] = (left > EOM_C(0.0)) ? EOM_MATH(fabs)(e[i] - here) : EOM_C(0.0);
            moving += (before[i] > EOM_C(0.0)) ? 1 : 0;
        }
    }
    springs(h, e, phi);
    for (int i = 0; i < n; ++i) {
        const EOM_SCALAR scale = EOM_MATH(fabs)(f[i]) + EOM_MATH(fabs)(still[i]) + steepest[i] * EOM_MATH(fabs)(e[i]);
        const EOM_SCALAR off = EOM_MATH(fabs)(phi[i] - f[i]);
        if (!(off <= EOM_CLOSE * scale) || !(phi[n + i] > EOM_FLAT * steepest[i])) { return 1 + i; }
    }
    return 0;
}

/* Write the polynomial between two samples of a force, of rising powers of the part of the step, 2 order + 2 numbers of a.  from,
 * to: the force and its time derivatives up to the order, 1 or 2, a number each stride. */
EOM_LOCAL void EOM(feedforward_piece)(int order, int stride, EOM_SCALAR dt, const EOM_SCALAR *from, const EOM_SCALAR *to, EOM_SCALAR *a)
{
    const EOM_SCALAR rate = dt * from[stride];
    EOM_SCALAR off = to[0] - from[0] - rate;
    EOM_SCALAR off_rate = dt * (to[stride] - from[stride]);
    a[0] = from[0];
    a[1] = rate;
    if (order == 1) {
        a[2] = EOM_C(3.0) * off - off_rate;
        a[3] = off_rate - EOM_C(2.0) * off;
    } else {
        const EOM_SCALAR square = dt * dt;
        const EOM_SCALAR half = EOM_C(0.5) * square * from[2 * stride];
        const EOM_SCALAR off_second = square * (to[2 * stride] - from[2 * stride]);
        off -= half;
        off_rate -= EOM_C(2.0) * half;
        a[2] = half;
        a[3] = EOM_C(10.0) * off - EOM_C(4.0) * off_rate + EOM_C(0.5) * off_second;
        a[4] = EOM_C(7.0) * off_rate - EOM_C(15.0) * off - off_second;
        a[5] = EOM_C(6.0) * off - EOM_C(3.0) * off_rate + EOM_C(0.5) * off_second;
    }
}

/* Carry the rate w of a deflection behind a straight line and a damper, w' + k/d w = f'/d, over a step: decay and driven, 2 order +
 * 1, are exp(-k/d dt) and what the powers of the piece leave at its end, by d. */
EOM_LOCAL EOM_SCALAR EOM(feedforward_filter)(int order, EOM_SCALAR decay, const EOM_SCALAR *driven, const EOM_SCALAR *piece, EOM_SCALAR w)
{
    EOM_SCALAR sum = EOM_C(0.0);
    for (int m = 0; m <= 2 * order; ++m) { sum += driven[m] * piece[m + 1]; }
    return decay * w + sum;
}

/* Carry deflections e, n, of d e' + phi(e) = f over a step by Radau's method of order 5; forces: the pieces of f, (n, 6), of which
 * those of an order have 2 order + 2 numbers.  Returns 0, or 1 + the number of a gear that was not solved.  work: 12 n. */
EOM_LOCAL int EOM(feedforward_radau)(int n, EOM(feedforward_springs) springs, const EOM_SCALAR *h, int order, EOM_SCALAR dt, const EOM_SCALAR *d, const EOM_SCALAR *forces, EOM_SCALAR *e, EOM_SCALAR *work)
{
    static const EOM_SCALAR nodes[3] = { EOM_C(0.15505102572168219), EOM_C(0.6449489742783178), EOM_C(1.0) };
    static const EOM_SCALAR A[9] = {
        EOM_C(0.19681547722366044), EOM_C(-0.06553542585019839), EOM_C(0.023770974348220154),
        EOM_C(0.39442431473908727), EOM_C(0.29207341166522844), EOM_C(-0.04154875212599793),
        EOM_C(0.3764030627004673), EOM_C(0.5124858261884216), EOM_C(0.1111111111111111),
    };
    EOM_SCALAR *const stages = work;      /* (3, n) */
    EOM_SCALAR *const phi = &work[3 * n]; /* (3, 3, n) */
    int left = 0;
    for (int i = 0; i < 3 * n; ++i) { stages[i] = e[i % n]; }
    for (int tries = 0; tries < EOM_FEEDFORWARD_STEPS; ++tries) {
        int moving = 0;
        left = 0;
        for (int s = 0; s < 3; ++s) { springs(h, &stages[n * s], &phi[3 * n * s]); }
        for (int i = 0; i < n; ++i) {
            EOM_SCALAR rate[3];
            EOM_SCALAR off[3];
            EOM_SCALAR by[9];
            const EOM_SCALAR part = dt / d[i];
            for (int s = 0; s < 3; ++s) {
                EOM_SCALAR force = EOM_C(0.0);
                for (int m = 2 * order + 1; m >= 0; --m) { force = force * nodes[s] + forces[6 * i + m]; }
                rate[s] = force - phi[3 * n * s + i];
            }
            for (int r = 0; r < 3; ++r) {
                off[r] = stages[n * r + i] - e[i] - part * (A[3 * r] * rate[0] + A[3 * r + 1] * rate[1] + A[3 * r + 2] * rate[2]);
                for (int s = 0; s < 3; ++s) { by[3 * r + s] = part * A[3 * r + s] * phi[3 * n * s + n + i] + ((r == s) ? EOM_C(1.0) : EOM_C(0.0)); }
            }
            for (int k = 0; k < 3; ++k) { /* no pivot vanishes: all principal minors of A are above 0, slopes too */
                for (int r = k + 1; r < 3; ++r) {
                    const EOM_SCALAR factor = by[3 * r + k] / by[4 * k];
                    for (int s = k + 1; s < 3; ++s) { by[3 * r + s] -= factor * by[3 * k + s]; }
                    off[r] -= factor * off[k];
                }
            }
            off[2] /= by[8];
            off[1] = (off[1] - by[5] * off[2]) / by[4];
            off[0] = (off[0] - by[1] * off[1] - by[2] * off[2]) / by[0];
            for (int s = 0; s < 3; ++s) {
                const EOM_SCALAR size = EOM_MATH(fabs)(stages[n * s + i]) + EOM_MATH(fabs)(e[i]);
                stages[n * s + i] -= off[s];
                moving += (EOM_MATH(fabs)(off[s]) <= EOM_ENOUGH * size) ? 0 : 1;
                if (!(EOM_MATH(fabs)(off[s]) <= EOM_CLOSE * size)) { left = 1 + i; }
            }
        }
        if (moving == 0) { break; }
    }
    for (int i = 0; i < n; ++i) { e[i] = stages[2 * n + i]; }
    return left;
}
#endif
