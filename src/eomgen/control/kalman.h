/* kalman.h: covariances of extended Kalman filters of robots, by the covariance P or by its square root.
 *
 * A state x of N = 2 n + p numbers has n coordinates q, n velocities v and p numbers that drift (parameters, wrenches).  A step
 * ends at q + dt v and v, v being the velocity of its end, whose derivatives by number d of the state at the step's beginning
 * are by[n d + i], (N, n): that is all of the transition matrix that is not known beforehand.
 *
 * P is stored whole, (N, N), and is symmetric to the bit.  The square root is U, upper triangular, (N, N), with P = U^T U:
 * what is 0 below its diagonal stays 0.  Measurements are taken one number after the other, each with a variance of its own.
 * Times depend on which derivatives of measurements are 0 alone.  precision.h comes before this file, math.h as well. */
#ifndef EOM_KALMAN_H
#define EOM_KALMAN_H

#include <string.h>

#define EOM_KALMAN_ROOM(N) (2 * (N) * ((N) + 2)) /* numbers of work, for all of it */

/* Write the derivatives of a step's end velocities by q and v, (2 n, n), from those of the residual by q, v and a, D, (3, n, n), at
 * the step's accelerations, where stiffness K and damping B, (n, n), are constant: the step is then
 * (M + dt B + dt^2 K) a = u - b(q, v) - K (q + dt v) - B v.  Returns 0, or 1 + the number of a pivot that vanishes.
 * work: 3 n n. */
EOM_LOCAL int EOM(kalman_linear_step)(int n, EOM_SCALAR dt, const EOM_SCALAR *restrict D, const EOM_SCALAR *restrict K, const EOM_SCALAR *restrict B, EOM_SCALAR *restrict by, EOM_SCALAR *restrict work)
{
    EOM_SCALAR *const W = work;       /* (n, n), factored as L D L^T below its diagonal */
    EOM_SCALAR *const X = &W[n * n];  /* (n, 2 n) */
    const int columns = 2 * n;
    for (int i = 0; i < n * n; ++i) { W[i] = D[2 * n * n + i] + dt * (B[i] + dt * K[i]); }
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            X[columns * i + j] = -D[n * i + j];
            X[columns * i + n + j] = -(D[n * n + n * i + j] + dt * K[n * i + j]);
        }
    }
    for (int k = 0; k < n; ++k) {
        const EOM_SCALAR pivot = W[(n + 1) * k];
        if (!(pivot > (EOM_SCALAR)0.0)) { return 1 + k; }
        for (int i = k + 1; i < n; ++i) {
            const EOM_SCALAR factor = W[n * k + i] / pivot;
            for (int j = i; j < n; ++j) { W[n * i + j] -= factor * W[n * k + j]; } /* of the upper half */
            for (int j = 0; j < columns; ++j) { X[columns * i + j] -= factor * X[columns * k + j]; }
        }
    }
    for (int k = n - 1; k >= 0; --k) {
        const EOM_SCALAR inverse = (EOM_SCALAR)1.0 / W[(n + 1) * k];
        for (int i = k + 1; i < n; ++i) {
            for (int j = 0; j < columns; ++j) { X[columns * k + j] -= W[n * k + i] * X[columns * i + j]; }
        }
        for (int j = 0; j < columns; ++j) { X[columns * k + j] *= inverse; }
    }
    for (int i = 0; i < n; ++i) {
        for (int d = 0; d < columns; ++d) { by[n * d + i] = dt * X[columns * i + d]; }
        by[n * (n + i) + i] += (EOM_SCALAR)1.0;
    }
    return 0;
}

/* Whether U^T U is finite: variances are, and so what is between them. */
EOM_LOCAL int EOM(kalman_root_finite)(int N, const EOM_SCALAR *restrict U)
{
    int is_finite = 1;
    for (int j = 0; j < N; ++j) {
        EOM_SCALAR sum = (EOM_SCALAR)0.0;
        for (int k = 0; k <= j; ++k) { sum += U[N * k + j] * U[N * k + j]; }
        if (EOM(all_finite)(1, &sum) == 0) { is_finite = 0; }
    }
    return is_finite;
}

/* Where P or U is kept while it is changed: behind all that this takes of work. */
#define EOM_KALMAN_KEPT(N) (EOM_KALMAN_ROOM(N) - (N) * ((N) + 1) / 2)

/* Keep the upper triangle of X, P or U. */
EOM_LOCAL void EOM(kalman_keep)(int N, const EOM_SCALAR *restrict X, EOM_SCALAR *restrict kept)
{
    int place = 0;
    for (int i = 0; i < N; ++i) {
        (void)memcpy(&kept[place], &X[(N + 1) * i], (size_t)(N - i) * sizeof *X);
        place += N - i;
    }
}

/* Make X what it was. */
EOM_LOCAL void EOM(kalman_restore)(int N, int is_root, const EOM_SCALAR *restrict kept, EOM_SCALAR *restrict X)
{
    int place = 0;
    for (int i = 0; i < N; ++i) {
        (void)memcpy(&X[(N + 1) * i], &kept[place], (size_t)(N - i) * sizeof *X);
        place += N - i;
        for (int j = 0; j < i; ++j) { X[N * i + j] = (is_root != 0) ? (EOM_SCALAR)0.0 : X[N * j + i]; }
    }
}

/* Carry P over a step; noise: N variances that the step adds, those of velocities to positions as well, as dt times them.
 * work: n N. */
EOM_LOCAL void EOM(kalman_predict)(int n, int p, EOM_SCALAR dt, const EOM_SCALAR *restrict by, const EOM_SCALAR *restrict noise, EOM_SCALAR *restrict P, EOM_SCALAR *restrict work)
{
    const int N = 2 * n + p;
    EOM_SCALAR *const T = work; /* (n, N): covariances of end velocities with the state at the beginning */
    for (int i = 0; i < n; ++i) {
        EOM_SCALAR *restrict const row = &T[N * i];
        for (int k = 0; k < N; ++k) { row[k] = (EOM_SCALAR)0.0; }
        for (int fours = 0; fours < N / 4; ++fours) {
            const int d = 4 * fours;
            const EOM_SCALAR a = by[n * d + i];
            const EOM_SCALAR b = by[n * (d + 1) + i];
            const EOM_SCALAR c = by[n * (d + 2) + i];
            const EOM_SCALAR e = by[n * (d + 3) + i];
            const EOM_SCALAR *restrict const from = &P[N * d];
            for (int k = 0; k < N; ++k) { row[k] += (a * from[k] + b * from[N + k]) + (c * from[2 * N + k] + e * from[3 * N + k]); }
        }
        for (int d = N - N % 4; d < N; ++d) {
            for (int k = 0; k < N; ++k) { row[k] += by[n * d + i] * P[N * d + k]; }
        }
    }
    for (int i = 0; i < n; ++i) { /* velocities, the lower half */
        EOM_SCALAR *restrict const row = &P[N * (n + i) + n];
        for (int j = 0; j <= i; ++j) { row[j] = (EOM_SCALAR)0.0; }
        for (int d = 0; d < N; ++d) {
            for (int j = 0; j <= i; ++j) { row[j] += T[N * i + d] * by[n * d + j]; }
        }
        row[i] += noise[n + i];
    }
    for (int i = 0; i < n; ++i) { /* positions */
        for (int j = 0; j <= i; ++j) { P[N * i + j] += dt * (T[N * i + j] + T[N * j + i] + dt * P[N * (n + i) + n + j]); }
        P[(N + 1) * i] += noise[i];
        for (int j = 0; j < n; ++j) { /* velocity i with position j */
            const EOM_SCALAR both = (j <= i) ? P[N * (n + i) + n + j] : P[N * (n + j) + n + i];
            P[N * (n + i) + j] = T[N * i + j] + dt * both;
        }
    }
    for (int r = 2 * n; r < N; ++r) { /* numbers that drift */
        for (int i = 0; i < n; ++i) {
            P[N * r + i] += dt * T[N * i + r];
            P[N * r + n + i] = T[N * i + r];
        }
        P[(N + 1) * r] += noise[r];
    }
    for (int i = 0; i < N; ++i) {
        for (int j = 0; j < i; ++j) { P[N * j + i] = P[N * i + j]; }
    }
}

/* Take one measurement: row, N, its derivatives by x, variance, and error, what is measured less what is expected at x + change.
 * change, N, gets what the state moves by.  Returns the innovation by its standard deviation.  work: N. */
EOM_LOCAL EOM_SCALAR EOM(kalman_update)(int N, const EOM_SCALAR *restrict row, EOM_SCALAR variance, EOM_SCALAR error, EOM_SCALAR *restrict P, EOM_SCALAR *restrict change, EOM_SCALAR *restrict work)
{
    EOM_SCALAR *const covariance = work; /* of the state with what is measured, by the latter's standard deviation in the end */
    EOM_SCALAR sum = variance;
    for (int k = 0; k < N; ++k) { covariance[k] = (EOM_SCALAR)0.0; }
    for (int d = 0; d < N; ++d) {
        const EOM_SCALAR slope = row[d];
        if ((slope > (EOM_SCALAR)0.0) || (slope < (EOM_SCALAR)0.0)) {
            for (int k = 0; k < N; ++k) { covariance[k] += slope * P[N * d + k]; }
        }
    }
    for (int d = 0; d < N; ++d) { sum += row[d] * covariance[d]; }
    const EOM_SCALAR inverse = (EOM_SCALAR)1.0 / EOM_MATH(sqrt)(sum);
    const EOM_SCALAR normalized = error * inverse;
    for (int i = 0; i < N; ++i) {
        covariance[i] *= inverse;
        change[i] += covariance[i] * normalized;
    }
    for (int i = 0; i < N; ++i) {
        const EOM_SCALAR here = covariance[i];
        for (int j = 0; j < N; ++j) { P[N * i + j] -= here * covariance[j]; }
    }
    return normalized;
}

/* Fold the (m, width) numbers of B into the (k, width) numbers of T, whose first k columns are upper triangular, by reflections:
 * T^T T + B^T B stays as it was, and the first k columns of B vanish; they are not written.  Rows of both are N apart.
 * work: m + width. */
EOM_LOCAL void EOM(kalman_fold)(int k, int m, int width, int N, EOM_SCALAR *restrict T, EOM_SCALAR *restrict B, EOM_SCALAR *restrict work)
{
    EOM_SCALAR *restrict const mirror = work;
    EOM_SCALAR *restrict const product = &work[m];
    const int fours = m - m % 4;
    for (int j = 0; j < k; ++j) {
        EOM_SCALAR *restrict const top = &T[N * j];
        const EOM_SCALAR head = top[j];
        EOM_SCALAR square = head * head;
        for (int r = 0; r < m; ++r) {
            mirror[r] = B[N * r + j];
            square += mirror[r] * mirror[r];
        }
        const EOM_SCALAR size = EOM_MATH(sqrt)(square);
        const EOM_SCALAR end = (head > (EOM_SCALAR)0.0) ? -size : size;
        top[j] = end;
        if (!(size > (EOM_SCALAR)0.0)) { continue; }
        const EOM_SCALAR inverse = (EOM_SCALAR)1.0 / (head - end);
        const EOM_SCALAR twice = (EOM_SCALAR)1.0 + EOM_MATH(fabs)(head) / size; /* by the mirror's square, whose head is 1 */
        for (int r = 0; r < m; ++r) { mirror[r] *= inverse; }
        for (int i = j + 1; i < width; ++i) { product[i] = top[i]; }
        for (int r = 0; r < fours; r += 4) {
            const EOM_SCALAR *restrict const row = &B[N * r];
            for (int i = j + 1; i < width; ++i) {
                product[i] += (mirror[r] * row[i] + mirror[r + 1] * row[N + i]) + (mirror[r + 2] * row[2 * N + i] + mirror[r + 3] * row[3 * N + i]);
            }
        }
        for (int r = fours; r < m; ++r) {
            for (int i = j + 1; i < width; ++i) { product[i] += mirror[r] * B[N * r + i]; }
        }
        for (int i = j + 1; i < width; ++i) {
            product[i] *= twice;
            top[i] -= product[i];
        }
        for (int r = 0; r < fours; r += 4) {
            EOM_SCALAR *restrict const first = &B[N * r];
            EOM_SCALAR *restrict const second = &B[N * (r + 1)];
            EOM_SCALAR *restrict const third = &B[N * (r + 2)];
            EOM_SCALAR *restrict const fourth = &B[N * (r + 3)];
            for (int i = j + 1; i < width; ++i) {
                first[i] -= mirror[r] * product[i];
                second[i] -= mirror[r + 1] * product[i];
                third[i] -= mirror[r + 2] * product[i];
                fourth[i] -= mirror[r + 3] * product[i];
            }
        }
        for (int r = fours; r < m; ++r) {
            for (int i = j + 1; i < width; ++i) { B[N * r + i] -= mirror[r] * product[i]; }
        }
    }
}

/* Carry the square root U over a step; deviations: N standard deviations that the step adds, as of kalman_predict.
 * work: EOM_KALMAN_ROOM.
 *
 * U is taken to (q, v+, p) first, where its rows of q stay triangular, and then to q+ = q + dt v+.  What is triangular
 * already, and noise, which is diagonal, is never reflected as a whole. */
EOM_LOCAL void EOM(kalman_root_predict)(int n, int p, EOM_SCALAR dt, const EOM_SCALAR *restrict by, const EOM_SCALAR *restrict deviations, EOM_SCALAR *restrict U, EOM_SCALAR *restrict work)
{
    const int N = 2 * n + p;
    const int lower = N * n;                   /* where rows of velocities begin */
    const int last = 2 * lower;                /* and those of numbers that drift */
    EOM_SCALAR *const W = work;                /* (N + n, N): rows of U, and those that noise of positions leaves */
    EOM_SCALAR *const rest = &work[N * N + lower]; /* 3 N */
    EOM_SCALAR largest = (EOM_SCALAR)0.0;
    int rows = n + p; /* below those of positions */
    (void)memcpy(W, U, (size_t)(N * N) * sizeof *U);
    for (int k = 0; k < N; ++k) {
        EOM_SCALAR *restrict const row = &W[N * k + n];
        const EOM_SCALAR *restrict const from = &U[N * k];
        for (int i = 0; i < n; ++i) { row[i] = (EOM_SCALAR)0.0; }
        for (int fours = 0; fours < (N - k) / 4; ++fours) {
            const int d = k + 4 * fours;
            const EOM_SCALAR *restrict const slopes = &by[n * d];
            for (int i = 0; i < n; ++i) {
                row[i] += (from[d] * slopes[i] + from[d + 1] * slopes[n + i]) + (from[d + 2] * slopes[2 * n + i] + from[d + 3] * slopes[3 * n + i]);
            }
        }
        for (int d = N - (N - k) % 4; d < N; ++d) {
            for (int i = 0; i < n; ++i) { row[i] += from[d] * by[n * d + i]; }
        }
    }
    (void)memset(U, 0, (size_t)(N * N) * sizeof *U);
    for (int d = 0; d < N; ++d) {
        U[(N + 1) * d] = deviations[d];
        if (d < n) { largest = (deviations[d] > largest) ? deviations[d] : largest; }
    }
    if (largest > (EOM_SCALAR)0.0) { /* positions have noise of their own */
        EOM(kalman_fold)(n, n, N, N, U, W, rest);
        (void)memcpy(&W[N * N], W, (size_t)lower * sizeof *W);
        (void)memcpy(W, U, (size_t)lower * sizeof *W);
        rows += n;
    }
    EOM(kalman_fold)(n, rows, n + p, N, &U[lower + n], &W[lower + n], rest);
    EOM(kalman_fold)(p, rows, p, N, &U[last + 2 * n], &W[lower + 2 * n], rest);
    for (int k = 0; k < n; ++k) {
        for (int i = 0; i < n; ++i) {
            W[N * k + i] += dt * W[N * k + n + i];
            U[N * k + i] = dt * U[lower + N * k + n + i];
        }
        for (int i = n; i < N; ++i) { U[N * k + i] = U[lower + N * k + i]; }
    }
    EOM(kalman_fold)(n, n, N, N, U, W, rest);
    for (int k = 0; k < n; ++k) { /* what is left of W is square */
        EOM_SCALAR *const corner = &W[(N + 1) * k + n];
        EOM(kalman_fold)(1, n - 1 - k, n + p - k, N, corner, &corner[N], rest);
        (void)memcpy(&U[lower + (N + 1) * k + n], corner, (size_t)(n + p - k) * sizeof *U);
    }
}

/* Take one measurement into the square root U, by rotations from the last row to the first; else as kalman_update.  work: 2 N. */
EOM_LOCAL EOM_SCALAR EOM(kalman_root_update)(int N, const EOM_SCALAR *restrict row, EOM_SCALAR variance, EOM_SCALAR error, EOM_SCALAR *restrict U, EOM_SCALAR *restrict change, EOM_SCALAR *restrict work)
{
    EOM_SCALAR *const covariance = work; /* of the state with what is measured, by the latter's standard deviation */
    EOM_SCALAR *const slopes = &work[N]; /* of the measurement by each row of U */
    EOM_SCALAR deviation = EOM_MATH(sqrt)(variance);
    int rows = 0; /* that the measurement depends on */
    for (int i = 0; i < N; ++i) {
        covariance[i] = (EOM_SCALAR)0.0;
        slopes[i] = (EOM_SCALAR)0.0;
    }
    for (int d = 0; d < N; ++d) {
        if (!((row[d] > (EOM_SCALAR)0.0) || (row[d] < (EOM_SCALAR)0.0))) { continue; }
        for (int k = 0; k <= d; ++k) { slopes[k] += U[N * k + d] * row[d]; }
        rows = d + 1;
    }
    for (int k = rows - 1; k >= 0; --k) {
        EOM_SCALAR *restrict const own = &U[N * k];
        const EOM_SCALAR slope = slopes[k];
        const EOM_SCALAR whole = EOM_MATH(sqrt)(deviation * deviation + slope * slope);
        const EOM_SCALAR c = deviation / whole;
        const EOM_SCALAR s = slope / whole;
        for (int i = k; i < N; ++i) {
            const EOM_SCALAR before = own[i];
            own[i] = c * before - s * covariance[i];
            covariance[i] = c * covariance[i] + s * before;
        }
        deviation = whole;
    }
    const EOM_SCALAR normalized = error / deviation;
    for (int i = 0; i < N; ++i) { change[i] += covariance[i] * normalized; }
    return normalized;
}
#endif
