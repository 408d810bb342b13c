/* combinations.h: linear combinations of states, of one state or of one in every lane.  No sum is reordered.
 *
 * Where sizes are not known when this is compiled, arrays are padded to blocks of so many numbers that loops over coordinates
 * are whole vectors, whatever the number of coordinates: what stands behind the last one is never looked at. */
#define EACH(i, n) for (int block = 0; block < (n); block += BLOCK) for (int i = block; i < block + BLOCK; ++i)

/* y = x. */
EOM_INLINE void F(copy)(int n, const REAL *restrict x, REAL *restrict y)
{
    EACH(i, n) { y[i] = x[i]; }
}

/* y = x + scale (weight[0] increment[0] + weight[1] increment[1] + ...); increments lie apart numbers from each other. */
EOM_INLINE void F(advance)(int n, int stages, const EOM_SCALAR *restrict weight, REAL scale, const REAL *restrict increment, int apart, const REAL *restrict x, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = weight[0] * increment[i];
        UNROLL(8)
        for (int s = 1; s < stages; ++s) { sum += weight[s] * increment[s * apart + i]; }
        y[i] = x[i] + scale * sum;
    }
}

/* y = x + weight[0] increment[0] + weight[1] increment[1] + ... */
EOM_INLINE void F(accumulate)(int n, int stages, const EOM_SCALAR *restrict weight, const REAL *restrict increment, int apart, const REAL *restrict x, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = x[i];
        UNROLL(8)
        for (int s = 0; s < stages; ++s) { sum += weight[s] * increment[s * apart + i]; }
        y[i] = sum;
    }
}

/* y = weight[0] increment[0] + weight[1] increment[1] + ... */
EOM_INLINE void F(weigh)(int n, int stages, const EOM_SCALAR *restrict weight, const REAL *restrict increment, int apart, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = weight[0] * increment[i];
        UNROLL(8)
        for (int s = 1; s < stages; ++s) { sum += weight[s] * increment[s * apart + i]; }
        y[i] = sum;
    }
}

/* The same with weights that are those of lanes: values of a polynomial without its constant by powers of where it is asked for. */
EOM_INLINE void F(follow)(int n, int powers, const REAL *restrict power, const REAL *restrict increment, int apart, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = power[0] * increment[i];
        UNROLL(8)
        for (int s = 1; s < powers; ++s) { sum += power[s] * increment[s * apart + i]; }
        y[i] = sum;
    }
}

/* y = y + x. */
EOM_INLINE void F(add_to)(int n, const REAL *restrict x, REAL *restrict y)
{
    EACH(i, n) { y[i] += x[i]; }
}

/* z = x + y. */
EOM_INLINE void F(add)(int n, const REAL *restrict x, const REAL *restrict y, REAL *restrict z)
{
    EACH(i, n) { z[i] = x[i] + y[i]; }
}

/* z = scale (x + y). */
EOM_INLINE void F(add_scaled)(int n, REAL scale, const REAL *restrict x, const REAL *restrict y, REAL *restrict z)
{
    EACH(i, n) { z[i] = scale * (x[i] + y[i]); }
}

/* z + i t = (c + i d) ((x + y) + i (u + w)). */
EOM_INLINE void F(add_turned)(int n, REAL c, REAL d, const REAL *restrict x, const REAL *restrict y, const REAL *restrict u, const REAL *restrict w, REAL *restrict z, REAL *restrict t)
{
    EACH(i, n) {
        const REAL real = x[i] + y[i];
        const REAL imaginary = u[i] + w[i];
        z[i] = c * real - d * imaginary;
        t[i] = c * imaginary + d * real;
    }
}

/* The sum of the squares of x[i] y[i], four sums side by side. */
EOM_INLINE REAL F(sum_of_squares)(int n, const REAL *restrict x, const REAL *restrict y)
{
    const int whole = n / 4 * 4;
    REAL sum[4];
    for (int k = 0; k < 4; ++k) { sum[k] = WHOLE(C(0.0)); }
    for (int block = 0; block < whole; block += 4) {
        for (int k = 0; k < 4; ++k) {
            const REAL scaled = x[block + k] * y[block + k];
            sum[k] += scaled * scaled;
        }
    }
    for (int i = whole; i < n; ++i) {
        const REAL scaled = x[i] * y[i];
        sum[i - whole] += scaled * scaled;
    }
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}
#undef EACH
