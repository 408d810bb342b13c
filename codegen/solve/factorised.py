"""Linear solve with the mass matrix as a program: M = L^T D L, without fill-in along the branches of the tree.

Source: R. Featherstone, Rigid Body Dynamics Algorithms, section 6.5 (branch-induced sparsity).
"""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.robot.model import Model

from ..tree.composite import Rows
from ..tree.spatial import Scalar
from .articulated import inverse_or_zero


def coordinate_parents(model: Model) -> list[int]:
    """Index of the coordinate in front of each one on the way to the base, or -1; motors stand alone."""
    parents = [-1] * model.size
    last: dict[int, int] = {-1: -1}
    for k, body in enumerate(model.bodies):
        before = last[body.parent]
        for index in body.indices:
            parents[index] = before
            before = index
        last[k] = before
    return parents


def solve_operations(model: Model) -> dict[str, int]:
    """Operations of the factorisation in C and of its solutions for 3 n right sides."""
    parents, n = coordinate_parents(model), model.size
    depth: list[int] = []
    for parent in parents:
        depth.append(0 if parent < 0 else depth[parent] + 1)
    factors, squares = sum(depth), sum(d * (d + 1) // 2 for d in depth)
    couples = squares + 6 * n * factors
    return {"mul": couples, "add": couples + 2 * n * n, "div": factors + 3 * n * n, "sincos": 0}


def solve(model: Model, matrix: Rows, right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
    """x of M x = right, and the pivots D (all positive for a body that can be)."""
    parents = coordinate_parents(model)
    M, x = dict(matrix), list(right)
    pivots: list[Scalar] = [0.0] * model.size
    inverse: list[Scalar] = [0.0] * model.size
    factors: dict[tuple[int, int], Scalar] = {}
    for k in range(model.size - 1, -1, -1):
        pivots[k] = M[k, k]
        inverse[k] = inverse_or_zero(pivots[k])
        i = parents[k]
        while i >= 0:
            factors[k, i] = M.get((i, k), 0.0) * inverse[k]
            j = i
            while j >= 0:
                M[j, i] = M.get((j, i), 0.0) - factors[k, i] * M.get((j, k), 0.0)
                j = parents[j]
            i = parents[i]
    for k in range(model.size - 1, -1, -1):  # L^T y = right
        i = parents[k]
        while i >= 0:
            x[i] = x[i] - factors[k, i] * x[k]
            i = parents[i]
    for k in range(model.size):  # D L x = y
        x[k] = x[k] * inverse[k]
        i = parents[k]
        while i >= 0:
            x[k] = x[k] - factors[k, i] * x[i]
            i = parents[i]
    return x, pivots
