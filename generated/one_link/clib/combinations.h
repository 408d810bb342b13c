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

/* y = x + scale (weight[0] part[0] + weight[1] part[1] + ...); parts lie apart numbers from each other. */
EOM_INLINE void F(advance)(int n, int stages, const EOM_SCALAR *restrict weight, REAL scale, const REAL *restrict part, int apart, const REAL *restrict x, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = weight[0] * part[i];
        UNROLL(8)
        for (int s = 1; s < stages; ++s) { sum += weight[s] * part[s * apart + i]; }
        y[i] = x[i] + scale * sum;
    }
}

/* y = x + weight[0] part[0] + weight[1] part[1] + ... */
EOM_INLINE void F(accumulate)(int n, int stages, const EOM_SCALAR *restrict weight, const REAL *restrict part, int apart, const REAL *restrict x, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = x[i];
        UNROLL(8)
        for (int s = 0; s < stages; ++s) { sum += weight[s] * part[s * apart + i]; }
        y[i] = sum;
    }
}

/* y = weight[0] part[0] + weight[1] part[1] + ... */
EOM_INLINE void F(weigh)(int n, int stages, const EOM_SCALAR *restrict weight, const REAL *restrict part, int apart, REAL *restrict y)
{
    EACH(i, n) {
        REAL sum = weight[0] * part[i];
        UNROLL(8)
        for (int s = 1; s < stages; ++s) { sum += weight[s] * part[s * apart + i]; }
        y[i] = sum;
    }
}
#undef EACH
