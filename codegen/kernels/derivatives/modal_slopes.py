"""Derivatives of the equations of links that bend: what stands in the graph, differentiated.

Gyroscopic and centrifugal forces h are a quadratic form of the velocities, so that the matrix of Christoffel's symbols
is half of their derivative: h_i = c_ijk v_j v_k with c_ijk = c_ikj, C_ij = c_ijk v_k.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from ...program.accumulation import jacobian
from ...program.ir import Node
from ...tree.recursion import inertial_rows
from ...tree.spatial import ZERO, Scalar
from ..derivation import Derivation, Outputs, vector


def bends(d: Derivation) -> bool:
    """Whether some link bends."""
    return any(body.modal is not None for body in d.bound.bodies)


def modal_residual_jacobian(d: Derivation) -> Outputs:
    """Write derivatives of the forces that a motion needs by q, v and a, those of no drive among them."""
    needed = d.dynamics(d.v, d.a)
    for k in d.model.states_of_drives:  # of their rates the inertias alone
        needed[k] = d.bound.armature[k] * d.a[k]
    rows = d.followers.gather(needed)
    by_all = _slopes(d, [rows[i] for i in d.rates], [x[i] for x in (d.q, d.v, d.a) for i in d.rates])
    n = len(d.rates)
    return vector([row[block * n + j] for block in range(3) for row in by_all for j in range(n)])


def modal_coriolis_matrix(d: Derivation) -> Outputs:
    """Write C, half of the derivative of gyroscopic and centrifugal forces by v."""
    return vector([x for row in _coriolis(d) for x in row])


def modal_christoffel(d: Derivation) -> Outputs:
    """Write the derivatives of C by v, (n, n, n)."""
    entries = [x for row in _coriolis(d) for x in row]
    return vector([x for row in _slopes(d, entries, _active(d, d.v)) for x in row])


def _coriolis(d: Derivation) -> list[list[Scalar]]:
    bias = inertial_rows(d.tree, d.v, d.coasting, ZERO)[0]
    gathered = d.followers.gather(bias)
    rows = _slopes(d, [gathered[i] for i in d.active], _active(d, d.v))
    return [[0.5 * x for x in row] for row in rows]


def _active(d: Derivation, x: Sequence[Scalar]) -> list[Scalar]:
    return [x[i] for i in d.active]


def _slopes(d: Derivation, values: Sequence[Scalar], inputs: Sequence[Scalar]) -> list[list[Scalar]]:
    """Differentiate values of the graph by its inputs; numbers have no derivatives."""
    nodes = [x for x in values if isinstance(x, Node)]
    keys: list[Hashable] = [x.index if isinstance(x, Node) else ("none", place) for place, x in enumerate(inputs)]
    found = iter(jacobian(d.graph, [x.index for x in nodes], keys, {}))
    return [next(found) if isinstance(x, Node) else [0.0] * len(keys) for x in values]
