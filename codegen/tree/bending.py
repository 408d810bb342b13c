"""Bodies as their modes have bent them: pseudo-inertias and moments of modes where q is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eomgen.robot.model import Model

from .bound import Bound, BoundBody
from .modal import NOTHING, Bent, Moment
from .spatial import Mat, PseudoInertia, Scalar, add, mat3, scale, sum_mat


def bent(model: Model, bound: Bound, q: Sequence[Scalar]) -> Bound:
    """Return the bodies as the modes at q have bent them."""
    if not any(body.modes for body in model.bodies):
        return bound
    pairs = zip(model.bodies, bound.bodies, strict=True)
    return replace(bound, bodies=tuple(_bent(own, body.modes, q) if body.modes else own for body, own in pairs))


def _bent(body: BoundBody, indices: range, q: Sequence[Scalar]) -> BoundBody:
    assert body.modal is not None
    constants, H = body.modal, body.inertia
    G, first, second = list[Moment](), H.first, H.second
    for k, index in enumerate(indices):
        half = NOTHING
        for place, slope in zip(indices, constants.slopes[k], strict=True):
            half = half + slope.scaled(0.5).scaled(q[place])
        C = constants.first[k] + half
        G.append(C + half)
        first = add(first, scale(q[index], C.row))
        second = sum_mat(second, _symmetric(q[index], C.block))
    return replace(body, inertia=PseudoInertia(second, first, H.mass), bent=Bent(indices, constants, tuple(G)))


def _symmetric(factor: Scalar, X: Mat) -> Mat:
    """Return factor (X + X^T)."""
    entries = {(i, j): factor * (X[i][j] + X[j][i]) for i in range(3) for j in range(i, 3)}
    return mat3([entries[min(i, j), max(i, j)] for j in range(3)] for i in range(3))
