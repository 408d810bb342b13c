"""Generalized forces, eqs. (13) to (16): Q = Q_P + Q_F + Q_G + Q_D.

Q_P is linear in each coordinate and its rate (13), and whatever else the description gives of it (``laws``).  Q_G is
the residual's response to a base accelerated against gravity, which is eq. (14) with the weights as forces.  Q_F is
eq. (14) with its moment term corrected (``kinematics.external_rows``).  Q_D are the drives themselves (16).

A transmission's force f in its deflection phi = motor / ratio - principal coordinate acts on both ends: f / ratio
resists the motor, and -f the joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eomgen.robot.model import Model

from ..tree.bound import Bound
from ..tree.composite import Rows
from ..tree.frozen_joints import JointGeometry
from ..tree.recursion import inertial_rows
from ..tree.spatial import Scalar
from .laws import Effect, effect, load_of, pressing
from .scalar_functions import Functions


def elastic_rows(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
    """-Q_P of eq. (13): stiffness times coordinate plus damping times rate; without laws."""
    return [a * s + b * rate for a, b, s, rate in zip(bound.stiffness, bound.damping, q, v, strict=True)]


@dataclass(frozen=True)
class Stretch:
    """Effects of a transmission: ``linear`` by its stiffness and damping, ``nonlinear`` by its laws."""

    linear: Effect
    nonlinear: Effect

    @property
    def whole(self) -> Effect:
        """Sum of both effects."""
        return self.linear + self.nonlinear


def stretches(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> dict[int, Stretch]:
    """Effects of transmissions by the index of the motor's coordinate; forces in units of the joint's side."""
    found = {}
    for motor, between in bound.transmissions.items():
        phi, rate = (x[motor] * between.inverse_ratio - x[between.principal] for x in (q, v))
        k, b = between.stiffness, between.damping
        linear = Effect(k * phi + b * rate, k, b, 0.5 * k * phi * phi)
        found[motor] = Stretch(linear, effect(between.law, between.knots, phi, rate, f))
    return found


def effects(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> dict[int, Effect]:
    """Effects of laws beyond eq. (13), by the index of the coordinate."""
    found = {}
    for i, law in bound.laws.items():
        load = load_of(_carried(bound, i, q, v, f), f)[0] if i in bound.carriers else 0.0
        found[i] = effect(law, bound.knots.get(i, ()), q[i], v[i], f, load)
    return found


def _carried(bound: Bound, i: int, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> list[Effect]:
    """Effects, without friction, of the coordinates that press on coordinate i."""
    return [
        pressing(bound.stiffness[j], bound.damping[j], bound.laws.get(j, {}), bound.knots.get(j, ()), q[j], v[j], f)
        for j in bound.carriers[i]
    ]


def resisting_rows(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> list[Scalar]:
    """-Q_P: all forces of the coordinates themselves."""
    rows = elastic_rows(bound, q, v)
    for i, found in effects(bound, q, v, f).items():
        rows[i] = rows[i] + found.force
    for motor, stretch in stretches(bound, q, v, f).items():
        between, force = bound.transmissions[motor], stretch.whole.force
        rows[motor] = rows[motor] + force * between.inverse_ratio
        rows[between.principal] = rows[between.principal] - force
    return rows


def resisting_slopes(bound: Bound, q: Sequence[Scalar], v: Sequence[Scalar], f: Functions) -> tuple[Rows, Rows]:
    """Derivatives of ``resisting_rows`` by q and v, without linear springs and dampers of single coordinates."""
    found = effects(bound, q, v, f)
    by_q: Rows = {(i, i): law.by_s for i, law in found.items()}
    by_v: Rows = {(i, i): law.by_rate for i, law in found.items()}
    for i, others in bound.carriers.items():
        carried = _carried(bound, i, q, v, f)
        for j, one, slope in zip(others, carried, load_of(carried, f)[1], strict=True):
            by_q[i, j] = found[i].by_load * slope * one.by_s
            by_v[i, j] = found[i].by_load * slope * one.by_v
    for motor, stretch in stretches(bound, q, v, f).items():
        between, whole = bound.transmissions[motor], stretch.whole
        for rows, slope in ((by_q, whole.by_s), (by_v, whole.by_rate)):
            for key, value in coupled(motor, between.principal, between.inverse_ratio, slope).items():
                rows[key] = rows.get(key, 0.0) + value
    return by_q, by_v


def coupled(motor: int, principal: int, inverse_ratio: Scalar, slope: Scalar) -> Rows:
    """Entries that a transmission's slope has in the rows and columns of its motor and its principal coordinate."""
    across = slope * inverse_ratio
    return {
        (motor, motor): across * inverse_ratio,
        (motor, principal): -across,
        (principal, motor): -across,
        (principal, principal): slope,
    }


def gravity_rows(model: Model, bound: Bound, joints: Sequence[JointGeometry]) -> list[Scalar]:
    """-Q_G: what the joints must hold against gravity at rest."""
    still = [0.0] * model.size
    return inertial_rows(model, bound, joints, still, still, bound.gravity)[0]
