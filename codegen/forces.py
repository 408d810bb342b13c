"""Generalized forces, eqs. (13) to (16): Q = Q_P + Q_F + Q_G + Q_D.

Q_P is linear in each coordinate and its rate (13), and whatever else the description gives of it (``laws``).  Q_G is
the residual's response to a base accelerated against gravity, which is eq. (14) with the weights as forces.  Q_F is
eq. (14) with its moment term corrected (``kinematics.external_rows``).  Q_D are the drives themselves (16).
"""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.model import Model

from .bodies import Bound, Scalar
from .freeze import JointGeometry
from .functions import Functions
from .laws import Effect, effect
from .recursion import inertial_rows


def elastic_rows(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
    """-Q_P of eq. (13): stiffness times coordinate plus damping times rate; without laws."""
    return [a * s + b * rate for a, b, s, rate in zip(bound.stiffness, bound.damping, q, v, strict=True)]


def effects(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> dict[int, Effect]:
    """What laws beyond eq. (13) do, by the index of the coordinate."""
    return {i: effect(law, bound.knots.get(i, ()), q[i], v[i], f) for i, law in bound.laws.items()}


def resisting_rows(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> list[Scalar]:
    """-Q_P: all forces of the coordinates themselves."""
    rows = elastic_rows(bound, q, v)
    for i, found in effects(bound, q, v, f).items():
        rows[i] = rows[i] + found.force
    return rows


def gravity_rows(model: Model, bound: Bound, joints: Sequence[JointGeometry]) -> list[Scalar]:
    """-Q_G: what the joints must hold against gravity at rest."""
    still = [0.0] * model.size
    return inertial_rows(model, bound, joints, still, still, bound.gravity)[0]
