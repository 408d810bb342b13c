/* combinations.h: linear combinations of states, of one state or of one in every lane.  No sum is reordered.
 *
 * Where sizes are not known when this is compiled, arrays are padded to blocks of so many numbers that loops over
 * coordinates are whole vectors, whatever the number of coordinates: what stands behind the last one is never looked
 * at. */
#define EOM_FOR_EACH(i, n) \
    for (int block = 0; block < (n); block += EOM_BLOCK) for (int i = block; i < block + EOM_BLOCK; ++i)

/* y = x. */
EOM_INLINE void EOM_F(copy)(int n, const EOM_REAL *restrict x, EOM_REAL *restrict y)
{
    EOM_FOR_EACH(i, n) { y[i] = x[i]; }
}

/* y = x + scale (weight[0] increment[0] + weight[1] increment[1] + ...); increments lie apart numbers from each
 * other. */
EOM_INLINE void EOM_F(advance)(int n, int stages, const EOM_SCALAR *restrict weight, EOM_REAL scale,
        const EOM_REAL *restrict increment, int apart, const EOM_REAL *restrict x, EOM_REAL *restrict y)
{
    EOM_FOR_EACH(i, n) {
        EOM_REAL sum = weight[0] * increment[i];
        EOM_UNROLL(8)
        for (int s = 1; s < stages; ++s) { sum += weight[s] * increment[s * apart + i]; }
        y[i] = x[i] + scale * sum;
    }
}

/* y = x + weight[0] increment[0] + weight[1] increment[1] + ... */
EOM_INLINE void EOM_F(accumulate)(int n, int stages, const EOM_SCALAR *restrict weight,
        const EOM_REAL *restrict increment, int apart, const EOM_REAL *restrict x, EOM_REAL *restrict y)
{
    EOM_FOR_EACH(i, n) {
        EOM_REAL sum = x[i];
        EOM_UNROLL(8)
        for (int s = 0; s < stages; ++s) { sum += weight[s] * increment[s * apart + i]; }
        y[i] = sum;
    }
}

/* y = weight[0] increment[0] + weight[1] increment[1] + ... */
EOM_INLINE void EOM_F(weigh)(int n, int stages, const EOM_SCALAR *restrict weight, const EOM_REAL *restrict increment,
        int apart, EOM_REAL *restrict y)
{
    EOM_FOR_EACH(i, n) {
        EOM_REAL sum = weight[0] * increment[i];
        EOM_UNROLL(8)
        for (int s = 1; s < stages; ++s) { sum += weight[s] * increment[s * apart + i]; }
        y[i] = sum;
    }
}

/* The same with weights that are those of lanes: values of a polynomial without its constant by powers of where it is
 * asked for. */
EOM_INLINE void EOM_F(follow)(int n, int powers, const EOM_REAL *restrict power, const EOM_REAL *restrict increment,
        int apart, EOM_REAL *restrict y)
{
    EOM_FOR_EACH(i, n) {
        EOM_REAL sum = power[0] * increment[i];
        EOM_UNROLL(8)
        for (int s = 1; s < powers; ++s) { sum += power[s] * increment[s * apart + i]; }
        y[i] = sum;
    }
}

/* y = y + x. */
EOM_INLINE void EOM_F(add_to)(int n, const EOM_REAL *restrict x, EOM_REAL *restrict y)
{
    EOM_FOR_EACH(i, n) { y[i] += x[i]; }
}

/* z = x + y. */
EOM_INLINE void EOM_F(add)(int n, const EOM_REAL *restrict x, const EOM_REAL *restrict y, EOM_REAL *restrict z)
{
    EOM_FOR_EACH(i, n) { z[i] = x[i] + y[i]; }
}

/* z = scale (x + y). */
EOM_INLINE void EOM_F(add_scaled)(int n, EOM_REAL scale, const EOM_REAL *restrict x, const EOM_REAL *restrict y,
        EOM_REAL *restrict z)
{
    EOM_FOR_EACH(i, n) { z[i] = scale * (x[i] + y[i]); }
}

/* z + i t = (c + i d) ((x + y) + i (u + w)). */
EOM_INLINE void EOM_F(add_turned)(int n, EOM_REAL c, EOM_REAL d, const EOM_REAL *restrict x, const EOM_REAL *restrict y,
        const EOM_REAL *restrict u, const EOM_REAL *restrict w, EOM_REAL *restrict z, EOM_REAL *restrict t)
{
    EOM_FOR_EACH(i, n) {
        const EOM_REAL real = x[i] + y[i];
        const EOM_REAL imaginary = u[i] + w[i];
        z[i] = c * real - d * imaginary;
        t[i] = c * imaginary + d * real;
    }
}

/* The sum of the squares of x[i] y[i], four sums side by side. */
EOM_INLINE EOM_REAL EOM_F(sum_of_squares)(int n, const EOM_REAL *restrict x, const EOM_REAL *restrict y)
{
    const int whole = n / 4 * 4;
    EOM_REAL sum[4];
    for (int k = 0; k < 4; ++k) { sum[k] = EOM_WHOLE(EOM_C(0.0)); }
    for (int block = 0; block < whole; block += 4) {
        for (int k = 0; k < 4; ++k) {
            const EOM_REAL scaled = x[block + k] * y[block + k];
            sum[k] += scaled * scaled;
        }
    }
    for (int i = whole; i < n; ++i) {
        const EOM_REAL scaled = x[i] * y[i];
        sum[i - whole] += scaled * scaled;
    }
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}
#undef EOM_FOR_EACH
