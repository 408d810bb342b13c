"""Linear solve with the mass matrix as a program: M = L^T D L, without fill-in along the branches of the tree.

Source: R. Featherstone, Rigid Body Dynamics Algorithms, section 6.5 (branch-induced sparsity).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eomgen.robot.model import Model

from ..tree.composite import Rows
from ..tree.followers import coordinate_parents
from ..tree.spatial import Scalar
from .articulated import inverse_or_zero
from .rows import Response


def coordinates_in_front(model: Model) -> list[list[int]]:
    """Find the coordinates in front of each one on the way to the base, the nearest first."""
    ancestors: list[list[int]] = []
    for parent in coordinate_parents(model):
        ancestors.append([parent, *ancestors[parent]] if parent >= 0 else [])
    return ancestors


def solve_operations(model: Model) -> dict[str, int]:
    """Count operations of the factorisation in C and of its solutions for 3 n right sides."""
    depth, n = [len(front) for front in coordinates_in_front(model)], model.size
    factors, squares = sum(depth), sum(d * (d + 1) // 2 for d in depth)
    couples = squares + 6 * n * factors
    return {"mul": couples, "add": couples + 2 * n * n, "div": factors + 3 * n * n, "sincos": 0}


class Factors:
    """M = L^T D L: ``pivots`` D (all positive for a body that can be) and their inverses."""

    def __init__(self, model: Model, matrix: Rows, parents: Sequence[int] | None = None) -> None:
        """Factor a matrix over a model's coordinates; ``parents``: the way to the base, if it is not the model's."""
        self.parents, M, n = parents or coordinate_parents(model), dict(matrix), model.size
        self.pivots: list[Scalar] = [0.0] * n
        self.inverse: list[Scalar] = [0.0] * n
        self.factors: dict[tuple[int, int], Scalar] = {}
        for k in range(n - 1, -1, -1):
            self.pivots[k] = M[k, k]
            self.inverse[k] = inverse_or_zero(self.pivots[k])
            for i in self._before(k):
                self.factors[k, i] = M.get((i, k), 0.0) * self.inverse[k]
                for j in (i, *self._before(i)):
                    M[j, i] = M.get((j, i), 0.0) - self.factors[k, i] * M.get((j, k), 0.0)

    def _before(self, k: int) -> Iterator[int]:
        """Return the coordinates in front of k, the nearest first."""
        while (k := self.parents[k]) >= 0:
            yield k

    def back(self, x: list[Scalar]) -> list[Scalar]:
        """Apply L^-T to x, in place."""
        for k in range(len(x) - 1, -1, -1):
            for i in self._before(k):
                x[i] = x[i] - self.factors[k, i] * x[k]
        return x

    def forward(self, x: list[Scalar]) -> list[Scalar]:
        """Apply L^-1 to x, in place."""
        for k in range(len(x)):
            for i in self._before(k):
                x[k] = x[k] - self.factors[k, i] * x[i]
        return x

    def respond(self, push: list[Scalar], response: Response) -> Response:
        """Eliminate drives, (n,): what they leave at the pivots."""
        for index, left in enumerate(self.back(push)):
            response.put(index, left, left * self.inverse[index])
        return response

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """Solve M x = right for x."""
        return self.forward([x * inverse for x, inverse in zip(self.back(list(right)), self.inverse, strict=True)])
