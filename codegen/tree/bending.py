"""Bodies as their modes have bent them: pseudo-inertias and moments of modes where q is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eomgen.robot.model import FIXED_BODY, Model

from .bound import Bound, BoundBody
from .followers import Followers
from .modal import NOTHING, Bent, Moment
from .spatial import Mat, PseudoInertia, Scalar, add, mat3, scale, sum_mat


def bent(model: Model, bound: Bound, q: Sequence[Scalar], followers: Followers) -> Bound:
    """Return the bodies as the modes at q have bent them.

    Args:
        followers: where q is (``Followers.place``); those of nodes are handed to their bodies.
    """
    if not any(body.modes for body in model.bodies):
        return bound
    bodies = []
    for body, own in zip(model.bodies, bound.bodies, strict=True):
        made = _bent(own, body.modes, q) if body.modes else own
        parent = model.bodies[body.parent].modes if body.parent != FIXED_BODY else ()
        shares = {i: followers.shares[i] for i in body.indices if i in followers.shares}
        nodes = all(not set(share).isdisjoint(parent) for share in shares.values())
        bodies.append(replace(made, shares=shares) if shares and nodes else made)
    return replace(bound, bodies=tuple(bodies))


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
