/* acceleration_derivatives.h: derivatives of accelerations by q, v and u, three matrices, out of those of the residual
 * r = M a + b(q, v) - u by q, v and a; of one state or of one in every lane.
 *
 * Of a tree they are -M^-1 dr/dq, -M^-1 dr/dv and M^-1.  M = L^T D L is factored along the branches: parent[i] is the coordinate
 * before coordinate i on the way to the base, or -1, and nothing outside of these is read.  known[i] is 1 where the acceleration of
 * coordinate i is prescribed (it is u then) and 0 elsewhere; NULL: nowhere.
 * Where loops are closed, M a - J^T lambda = u - b and J a = -J_dot v are differentiated, as the theorem on implicit functions
 * has it: what M^-1 alone makes of the right sides does not keep the loops closed, and changes of the multipliers make up for
 * it.  Rows of J may be redundant: J M^-1 J^T is factored with a little of its diagonal added, and refined. */
#ifndef EOM_ACCELERATION_DERIVATIVES_H
#define EOM_ACCELERATION_DERIVATIVES_H

/* Constraints of closed loops, in blocks that the same coordinates move, and those among them whose rows of J may differ from 0. */
typedef struct {
    int blocks;
    const int *first;  /* constraint of each block */
    const int *rows;   /* constraints of each block */
    const int *width;  /* coordinates that move each block */
    const int *moved;  /* they, block by block */
    int kept;          /* rows that may differ from 0 */
    const int *place;  /* of each constraint among them, or -1 */
    const int *start;  /* of the coordinates that move each of them, in moved */
    const int *count;  /* how many they are */
    const int *kind;   /* 0, 1, ...: rows of lengths and rows of angles have separate diagonals */
    int kinds;
    int refinements;
    EOM_SCALAR share;  /* added to the diagonal, of the sum over the kind */
    EOM_SCALAR floor;  /* and of that over all */
} EOM(constraint_rows);
#endif

/* Solve M x = x for so many columns of x, (n, columns), with the factors of M in place and its pivots. */
EOM_IN_PLACE void EOM_F(solve_branches)(int n, const int *restrict parent, const EOM_REAL *restrict M, const EOM_REAL *restrict pivot, int columns, EOM_REAL *restrict x)
{
    for (int k = n - 1; k >= 0; --k) {
        for (int i = parent[k]; i >= 0; i = parent[i]) {
            for (int j = 0; j < columns; ++j) { x[columns * i + j] -= M[n * k + i] * x[columns * k + j]; }
        }
    }
    for (int k = 0; k < n; ++k) {
        for (int j = 0; j < columns; ++j) { x[columns * k + j] /= pivot[2 * k]; }
        for (int i = parent[k]; i >= 0; i = parent[i]) {
            for (int j = 0; j < columns; ++j) { x[columns * k + j] -= M[n * k + i] * x[columns * i + j]; }
        }
    }
}

/* Take derivatives of the residual in out into those of accelerations; M, (n, n), and pivot, (n, 2) with a scale behind each, are
 * left as solve_branches reads them. */
EOM_IN_PLACE void EOM_F(accelerations_by)(int n, const int *restrict parent, const int *restrict known, EOM_REAL *restrict M, EOM_REAL *restrict pivot, EOM_REAL *restrict out)
{
    const EOM_REAL zero = EOM_WHOLE(EOM_C(0.0));
    const EOM_REAL one = EOM_WHOLE(EOM_C(1.0));
    EOM_REAL *const by_u = &out[2 * n * n];
    for (int i = 0; i < n * n; ++i) { M[i] = by_u[i]; }
    for (int i = 0; (known != NULL) && (i < n); ++i) { /* in the other rows, prescribed accelerations stand on the right */
        for (int j = 0; j < n; ++j) {
            if (known[i] != 0) {
                out[n * i + j] = zero;
                out[n * n + n * i + j] = zero;
            }
            if ((known[i] != 0) || (known[j] != 0)) { M[n * i + j] = zero; }
        }
        if (known[i] != 0) { M[(n + 1) * i] = one; }
    }
    for (int i = 0; i < n; ++i) { pivot[2 * i + 1] = M[(n + 1) * i]; }
    for (int k = n - 1; k >= 0; --k) {
        pivot[2 * k] = M[(n + 1) * k];
        for (int i = parent[k]; i >= 0; i = parent[i]) {
            const EOM_REAL factor = M[n * k + i] / pivot[2 * k];
            for (int j = i; j >= 0; j = parent[j]) { M[n * i + j] -= factor * M[n * k + j]; }
            M[n * k + i] = factor;
        }
    }
    for (int i = 0; i < 2 * n * n; ++i) { out[i] = -out[i]; }
    if (known != NULL) {
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) { by_u[n * i + j] = ((known[j] != 0) && (known[i] == 0)) ? -by_u[n * i + j] : zero; }
            by_u[(n + 1) * i] = one;
        }
    } else {
        for (int i = 0; i < n * n; ++i) { by_u[i] = zero; }
        for (int i = 0; i < n; ++i) { by_u[(n + 1) * i] = one; }
    }
    for (int matrix = 0; matrix < 3; ++matrix) { EOM_F(solve_branches)(n, parent, M, pivot, n, &out[n * n * matrix]); }
}

/* Read the blocks' derivatives D: those of their rows by q, which are J, then of J a + J_dot v by q and by v, and those of
 * J^T lambda by q, which the derivatives of the residual by q lose.  rows: (3, kept, n), J and what the rows lack otherwise. */
EOM_IN_PLACE void EOM_F(read_blocks)(int n, const EOM(constraint_rows) *restrict c, const EOM_REAL *restrict D, EOM_REAL *restrict rows, EOM_REAL *restrict by_q)
{
    const int matrix = c->kept * n;
    int at = 0;
    int column = 0;
    for (int i = 0; i < 3 * matrix; ++i) { rows[i] = EOM_WHOLE(EOM_C(0.0)); }
    for (int b = 0; b < c->blocks; ++b) {
        const int width = c->width[b];
        const int size = c->rows[b] * width;
        for (int i = 0; i < size; ++i) {
            const int row = c->place[c->first[b] + i / width];
            if (row >= 0) {
                const int entry = n * row + c->moved[column + i % width];
                rows[entry] = D[at + i];
                rows[matrix + entry] = -D[at + size + i];
                rows[2 * matrix + entry] = -D[at + 2 * size + i];
            }
        }
        at += 3 * size;
        for (int i = 0; i < width * width; ++i) {
            const int entry = n * c->moved[column + i / width] + c->moved[column + i % width];
            by_q[entry] = by_q[entry] - D[at + i];
        }
        at += width * width;
        column += width;
    }
}

/* Compute Y = J M^-1, a row per row of J without what is prescribed, A = Y J^T, and the factors of A with more on its diagonal. */
EOM_IN_PLACE void EOM_F(reduced_system)(int n, const int *restrict parent, const int *restrict known, const EOM(constraint_rows) *restrict c, const EOM_REAL *restrict M, const EOM_REAL *restrict pivot, const EOM_REAL *restrict J, EOM_REAL *restrict Y, EOM_REAL *restrict A, EOM_REAL *restrict factors, EOM_REAL *restrict added)
{
    const int k = c->kept;
    EOM_REAL whole = EOM_WHOLE(EOM_C(0.0));
    for (int r = 0; r < k; ++r) {
        EOM_REAL *const y = &Y[n * r];
        for (int i = 0; i < n; ++i) { y[i] = ((known != NULL) && (known[i] != 0)) ? EOM_WHOLE(EOM_C(0.0)) : J[n * r + i]; }
        EOM_F(solve_branches)(n, parent, M, pivot, 1, y);
    }
    for (int i = 0; i < c->kinds; ++i) { added[i] = EOM_WHOLE(EOM_C(0.0)); }
    for (int r = 0; r < k; ++r) {
        for (int s = 0; s <= r; ++s) {
            EOM_REAL product = EOM_WHOLE(EOM_C(0.0));
            for (int i = c->start[r]; i < c->start[r] + c->count[r]; ++i) { product += J[n * r + c->moved[i]] * Y[n * s + c->moved[i]]; }
            A[k * r + s] = product;
            A[k * s + r] = product;
        }
        added[c->kind[r]] += A[(k + 1) * r];
        whole += A[(k + 1) * r];
    }
    for (int i = 0; i < k * k; ++i) { factors[i] = A[i]; }
    for (int r = 0; r < k; ++r) { factors[(k + 1) * r] += added[c->kind[r]] * c->share + whole * c->floor; }
    for (int r = 0; r < k; ++r) {
        for (int s = r + 1; s < k; ++s) {
            const EOM_REAL factor = factors[k * s + r] / factors[(k + 1) * r];
            for (int t = r + 1; t <= s; ++t) { factors[k * s + t] -= factor * factors[k * t + r]; }
        }
    }
}

/* Solve A x = right by its factors, and refine; rest: k numbers of work. */
EOM_IN_PLACE void EOM_F(solve_reduced)(int k, int refinements, const EOM_REAL *restrict A, const EOM_REAL *restrict factors, const EOM_REAL *restrict right, EOM_REAL *restrict x, EOM_REAL *restrict rest)
{
    for (int r = 0; r < k; ++r) { x[r] = EOM_WHOLE(EOM_C(0.0)); }
    for (int pass = 0; pass <= refinements; ++pass) {
        for (int r = 0; r < k; ++r) {
            rest[r] = right[r];
            for (int s = 0; (s < k) && (pass > 0); ++s) { rest[r] -= A[k * r + s] * x[s]; }
        }
        for (int r = 0; r < k; ++r) {
            for (int s = 0; s < r; ++s) { rest[r] -= factors[k * r + s] * rest[s]; }
            rest[r] /= factors[(k + 1) * r];
        }
        for (int r = k - 1; r >= 0; --r) {
            EOM_REAL sum = EOM_WHOLE(EOM_C(0.0));
            for (int s = r + 1; s < k; ++s) { sum += factors[k * s + r] * rest[s]; }
            rest[r] -= sum / factors[(k + 1) * r];
            x[r] += rest[r];
        }
    }
}

/* Take derivatives of the residual in out into those of accelerations that keep the loops closed; D as in read_blocks.  Work: rows,
 * (3, kept, n), Y, (kept, n), A and factors, (kept, kept), right, change and rest, (kept), and added, (kinds): arrays of their
 * own, which compilers keep in registers where they are small. */
EOM_IN_PLACE void EOM_F(closed_accelerations_by)(int n, const int *restrict parent, const int *restrict known, const EOM(constraint_rows) *restrict c, const EOM_REAL *restrict D, EOM_REAL *restrict M, EOM_REAL *restrict pivot, EOM_REAL *restrict rows, EOM_REAL *restrict Y, EOM_REAL *restrict A, EOM_REAL *restrict factors, EOM_REAL *restrict right, EOM_REAL *restrict change, EOM_REAL *restrict rest, EOM_REAL *restrict added, EOM_REAL *restrict out)
{
    const int k = c->kept;
    EOM_F(read_blocks)(n, c, D, rows, out);
    EOM_F(accelerations_by)(n, parent, known, M, pivot, out);
    EOM_F(reduced_system)(n, parent, known, c, M, pivot, rows, Y, A, factors, added);
    for (int column = 0; column < 3 * n; ++column) {
        const int matrix = column / n;
        const int i = column % n;
        EOM_REAL *const x = &out[n * n * matrix + i];
        for (int r = 0; r < k; ++r) {
            right[r] = (matrix < 2) ? rows[(matrix + 1) * k * n + n * r + i] : EOM_WHOLE(EOM_C(0.0));
            for (int j = c->start[r]; j < c->start[r] + c->count[r]; ++j) { right[r] -= rows[n * r + c->moved[j]] * x[n * c->moved[j]]; }
        }
        EOM_F(solve_reduced)(k, c->refinements, A, factors, right, change, rest);
        for (int r = 0; r < k; ++r) {
            for (int j = 0; j < n; ++j) { x[n * j] += Y[n * r + j] * change[r]; }
        }
    }
}
