"""Generalized forces, eqs. (13) to (16): Q = Q_P + Q_F + Q_G + Q_D.

Q_P is linear in each coordinate and its rate (13).  Q_G is the residual's response to a base accelerated against
gravity, which is eq. (14) with the weights as forces.  Q_F is eq. (14) with its moment term corrected
(``kinematics.external_rows``).  Q_D are the drives themselves (16).
"""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.model import Model

from .bodies import Bound, Scalar
from .freeze import JointGeometry
from .recursion import inertial_rows


def elastic_rows(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
    """-Q_P of eq. (13): stiffness times coordinate plus damping times rate."""
    return [a * s + b * rate for a, b, s, rate in zip(bound.stiffness, bound.damping, q, v, strict=True)]


def gravity_rows(model: Model, bound: Bound, joints: Sequence[JointGeometry]) -> list[Scalar]:
    """-Q_G: what the joints must hold against gravity at rest."""
    still = [0.0] * model.size
    return inertial_rows(model, bound, joints, still, still, bound.gravity)[0]
