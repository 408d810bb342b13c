"""Elastic rows whose forces depend on other directions than they act along: a system without symmetry.

A damper between frames that turn against each other feels its rate J v change with the directions, d(J v)/dq, which is
no multiple of J.  With forces J^T lambda and R the derivatives of what resists them by the accelerations,

    (1 + R M^-1 J^T) lambda = -R a_free,    a = a_free + M^-1 J^T lambda;

of a row without such a slope, R = s J.  The matrix is factored without pivoting: it is the unit matrix where a step is
short, and where a spring or damper is stiff its symmetric part s J M^-1 J^T outweighs what turns within a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..tree.spatial import Scalar, is_zero
from .rows import Response, Row, Sparse

Matrix = list[list[Scalar]]


class UnsymmetricSystem:
    """The matrix of elastic rows, factored: L with ones on its diagonal below, U above."""

    def __init__(self, rows: Sequence[Row], responses: Sequence[Response], felt: Sequence[Response]) -> None:
        """Write and factor the matrix.

        Args:
            responses: to forces along each row.
            felt: to drives along what each row feels; the same as of the row where that is a multiple of it.
        """
        self.rows, self.kept = rows, [r for r, row in enumerate(rows) if row.jacobian_row]
        self.matrix: Matrix = [
            [(1.0 if r == s else 0.0) + scaled(rows[r], felt[r].product(responses[s])) for s in self.kept]
            for r in self.kept
        ]
        self.inverses: list[Scalar] = []
        self._factor()

    def _factor(self) -> None:
        A = self.matrix
        for i in range(len(A)):
            self.inverses.append(1.0 / A[i][i])
            for j in range(i + 1, len(A)):
                if is_zero(A[j][i]):
                    continue
                A[j][i] = A[j][i] * self.inverses[i]
                for k in range(i + 1, len(A)):
                    if not is_zero(A[i][k]):
                        A[j][k] = A[j][k] - A[j][i] * A[i][k]

    def multipliers(self, missing: Callable[[int], Scalar]) -> list[Scalar]:
        """Solve for lambda of all rows, 0 of empty ones; ``missing(r)``: -R a_free."""
        A, x = self.matrix, [missing(r) for r in self.kept]
        for j in range(len(A)):
            for i in range(j):
                if not is_zero(A[j][i]):
                    x[j] = x[j] - A[j][i] * x[i]
        for i in range(len(A) - 1, -1, -1):
            for k in range(i + 1, len(A)):
                if not is_zero(A[i][k]):
                    x[i] = x[i] - A[i][k] * x[k]
            x[i] = x[i] * self.inverses[i]
        found: Sparse = dict(zip(self.kept, x, strict=True))
        return [found.get(r, 0.0) for r in range(len(self.rows))]


def scaled(row: Row, along: Scalar) -> Scalar:
    """Return what a row feels of a product along what it feels, or along itself by its slope."""
    if row.felt is not None:
        return along
    return 0.0 if row.slope is None else row.slope * along
