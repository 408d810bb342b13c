"""Derivatives of the residual with respect to q, v and a, by the recursion of the Coriolis matrix.

A unit rate of coordinate j moves all that hangs on it with the tangent D_j.  Seen from there, the base side turns
back instead: its W = A_dot A^-1 changes by X_j = [W, D_j] and its K = A_ddot A^-1 by [K, D_j], so that every body k
behind j gets

    dK_k/dq_j = Z_j + 2 X_j W_k,    dK_k/dv_j = 2 X_j + 2 D_j W_k,    dK_k/da_j = D_j

with Z_j = [W_dot, D_j] + [W, X_j].  With the composites H = sum H_k and G = sum W_k H_k behind the deeper coordinate
the traces of eq. (5) become

    dr_i/dq_j = tr(D_i (Z_j H + 2 X_j G)^T),   dr_i/dv_j = 2 tr(D_i (X_j H + D_j G)^T),   dr_i/da_j = tr(D_i H D_j^T),

and where i is in front of j the wrench P that hangs on j turns with it: [D_j, P] is added to dr_i/dq_j.  Same
structure, other derivation: S. Singh, R. Russell, P. Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics
Using Spatial Vector Algebra", IEEE Robotics and Automation Letters 7 (2022).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eomgen.robot.model import FIXED_BODY

from .composite import Momentum, Rows, front, momentum, momentum_to_parent, rotated, rotated_momentum, to_parent
from .frozen_joints import JointGeometry, PosedTree, unit
from .recursion import (
    Acceleration,
    Velocity,
    Wrench,
    acceleration,
    body_wrench,
    rotational_inertia,
    through_joint_back,
)
from .spatial import ZERO, PseudoInertia, Scalar, Vec, add, cross, dot, matvec, scale, trace, transpose


@dataclass(frozen=True)
class _Tangent:
    """Coordinate j in the axes in front of it: D about or along ``axis``, X, 2 X and Z as (turning, shift)."""

    index: int
    axis: Vec
    X: tuple[Vec, Vec]
    twice: tuple[Vec, Vec]
    Z: tuple[Vec, Vec]


@dataclass(frozen=True)
class _Moving:
    """A body's W and K, and its joint's tangents: translations, then rotations."""

    W: Velocity
    K: Acceleration
    translations: tuple[_Tangent, ...]
    rotations: tuple[_Tangent, ...]


@dataclass(frozen=True)
class Composite:
    """Composite of all that hangs on a joint: H, 2 G and the wrench P, in one frame."""

    H: PseudoInertia
    G: Momentum
    P: Wrench

    def __add__(self, other: Composite) -> Composite:
        return Composite(self.H + other.H, self.G + other.G, self.P + other.P)


@dataclass(frozen=True)
class _Reading:
    """Momenta that coordinate i hands towards the base: D_i H, the moment of 2 D_i G^T, its columns by q and v."""

    row: Wrench
    couple: Vec
    by_q: Wrench
    by_v: Wrench


@dataclass(frozen=True)
class Derivatives:
    """Entries (i, j) of dr/dq, dr/dv and dr/da; an absent pair is identically zero."""

    by_q: Rows
    by_v: Rows
    by_a: Rows


def residual_derivatives(tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar]) -> Derivatives:
    """Differentiate the residual with linear springs and dampers of coordinates and armatures, by q, v and a."""
    dr = Derivatives({}, {}, {})
    moving = _outwards(tree, v, a, scale(-1.0, tree.bound.gravity))
    composites = []
    for body, m in zip(tree.bound.bodies, moving, strict=True):
        twice = Velocity(scale(2.0, m.W.rate), scale(2.0, m.W.origin))
        composites.append(Composite(body.inertia, momentum(body.inertia, twice), body_wrench(m.K, body.inertia)))
    for k in range(len(tree.joints) - 1, -1, -1):
        tree.note(f"{tree.model.bodies[k].joint}: rows and columns of the derivatives of eq. (5)")
        readings, at_joint = _readings(composites[k], tree.joints[k], moving[k])
        for index, reading in readings:
            _read(tree, moving, k, index, reading, dr)
        parent = tree.model.bodies[k].parent
        if parent != FIXED_BODY:
            composites[parent] = composites[parent] + _behind(at_joint, tree.joints[k])
    for i in range(tree.model.size):
        law = tree.bound.laws[i]
        for rows, value in ((dr.by_q, law.stiffness), (dr.by_v, law.damping), (dr.by_a, tree.bound.armature[i])):
            rows[i, i] = rows.get((i, i), 0.0) + value
    return dr


def _outwards(tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar], base: Vec) -> list[_Moving]:
    """Compute W and K of every body, and the tangents on the way, from the base to the tips."""
    still = _Moving(Velocity(ZERO, ZERO), acceleration(ZERO, ZERO, base), (), ())
    bodies: list[_Moving] = []
    for body, joint in zip(tree.model.bodies, tree.joints, strict=True):
        tree.note(f"{body.name}: velocity, acceleration, and what they are to the tangents of {body.joint}")
        parent = still if body.parent == FIXED_BODY else bodies[body.parent]
        bodies.append(_through(parent, joint, v, a))
    return bodies


def _through(parent: _Moving, joint: JointGeometry, v: Sequence[Scalar], a: Sequence[Scalar]) -> _Moving:
    back, W, K = transpose(joint.turn), parent.W, parent.K
    w, d = matvec(back, W.rate), matvec(back, K.dot)
    shift = matvec(back, add(W.origin, cross(W.rate, joint.offset)))
    origin = matvec(back, add(K.origin, matvec(K.U, joint.offset)))
    U = acceleration(w, d, ZERO).U
    translations = []
    for index, axis in joint.translations:
        e = unit(axis)
        X = cross(w, e)
        translations.append(_Tangent(index, e, (ZERO, X), (ZERO, scale(2.0, X)), (ZERO, matvec(U, e))))
        shift = add(shift, unit(axis, v[index]))
        origin = add(origin, add(cross(scale(2.0, w), unit(axis, v[index])), unit(axis, a[index])))
    rotations = []
    for turn in joint.rotations:
        e, back = unit(turn.axis), transpose(turn.matrix)
        X = cross(w, e)
        slip = cross(shift, e)
        twice = (scale(2.0, X), scale(2.0, slip))
        Z = (matvec(acceleration(w, d, ZERO).U, e), add(cross(origin, e), cross(shift, twice[0])))
        rotations.append(_Tangent(turn.index, e, (X, slip), twice, Z))
        spin = unit(turn.axis, v[turn.index])
        w, shift, origin = matvec(back, w), matvec(back, shift), matvec(back, origin)
        d = add(add(matvec(back, d), cross(w, spin)), unit(turn.axis, a[turn.index]))
        w = add(w, spin)
    return _Moving(Velocity(w, shift), acceleration(w, d, origin), tuple(translations), tuple(rotations))


def _readings(here: Composite, joint: JointGeometry, moving: _Moving) -> tuple[list[tuple[int, _Reading]], Composite]:
    """Return every coordinate's reading in the axes in front of it, and the composite in the joint's axes."""
    readings = []
    for turn, tangent in reversed(list(zip(joint.rotations, moving.rotations, strict=True))):
        P = here.P.turned(turn.matrix)
        here = Composite(rotated(turn, here.H), rotated_momentum(turn, here.G), P)
        H, G, e = here.H, here.G, tangent.axis
        row = Wrench(cross(e, H.first), rotational_inertia(H, e))
        by_v = _inertial(H, tangent.twice) + Wrench(cross(e, G.linear), _turning(G, e))
        by_q = _inertial(H, tangent.Z) + Wrench(cross(tangent.X[0], G.linear), _turning(G, tangent.X[0]))
        by_q = by_q + Wrench(cross(e, P.force), cross(e, P.moment))
        couple = add(scale(trace(G.block), e), scale(-1.0, matvec(G.block, e)))
        readings.append((turn.index, _Reading(row, couple, by_q, by_v)))
    for tangent in moving.translations:
        H, G, P, e = here.H, here.G, here.P, tangent.axis
        row = Wrench(scale(H.mass, e), cross(H.first, e))
        by_q = _inertial(H, tangent.Z) + Wrench(ZERO, cross(e, P.force))
        readings.append((tangent.index, _Reading(row, cross(G.linear, e), by_q, _inertial(H, tangent.twice))))
    return readings, here


def _inertial(H: PseudoInertia, Y: tuple[Vec, Vec]) -> Wrench:
    """Read Y H off, for Y of turning and shift."""
    turning, shift = Y
    force = add(cross(turning, H.first), scale(H.mass, shift))
    return Wrench(force, add(rotational_inertia(H, turning), cross(H.first, shift)))


def _turning(G: Momentum, x: Vec) -> Vec:
    """Return the moment of skew(x) G: (tr 1 - block^T) x for the transposed block that G holds."""
    return add(scale(trace(G.block), x), scale(-1.0, matvec(transpose(G.block), x)))


def _behind(here: Composite, joint: JointGeometry) -> Composite:
    """Move the composite to the parent body's origin, in its axes."""
    P = through_joint_back(here.P, JointGeometry(joint.turn, joint.offset, (), ()), [])
    return Composite(to_parent(here.H, joint), momentum_to_parent(here.G, joint), P)


def _read(tree: PosedTree, moving: Sequence[_Moving], k: int, index: int, reading: _Reading, dr: Derivatives) -> None:
    """Read column ``index`` at and above it, and row ``index`` above it, from joint k to the base."""
    masses: list[Scalar] = [None] * tree.model.size
    by_q, by_v = list(masses), list(masses)
    row, couple, at_q, at_v = reading.row, reading.couple, reading.by_q, reading.by_v
    joint, body = front(tree.joints[k], index), k
    while True:
        couple = _read_row(row, couple, joint, moving[body], index, dr)
        row = through_joint_back(row, joint, masses)
        at_q, at_v = through_joint_back(at_q, joint, by_q), through_joint_back(at_v, joint, by_v)
        body = tree.model.bodies[body].parent
        if body == FIXED_BODY:
            break
        joint = tree.joints[body]
    for rows, read in ((dr.by_q, by_q), (dr.by_v, by_v), (dr.by_a, masses)):
        for other, value in enumerate(read):
            if value is not None and other <= index:
                rows[other, index] = value
                if read is masses:
                    rows[index, other] = value


def _read_row(row: Wrench, couple: Vec, joint: JointGeometry, moving: _Moving, index: int, dr: Derivatives) -> Vec:
    """Read dr_index/dq_j and dr_index/dv_j for every j of a joint in front; return the couple in the parent's axes."""
    force, moment = row.force, row.moment
    tangents = {tangent.index: tangent for tangent in moving.rotations}
    for turn in reversed(joint.rotations):
        force, moment, couple = (matvec(turn.matrix, x) for x in (force, moment, couple))
        if turn.index < index:
            j = tangents[turn.index]
            dr.by_q[index, j.index] = dot(moment, j.Z[0]) + dot(force, j.Z[1]) + dot(couple, j.X[0])
            dr.by_v[index, j.index] = dot(moment, j.twice[0]) + dot(force, j.twice[1]) + dot(couple, j.axis)
    for j in moving.translations:
        if j.index < index:
            dr.by_q[index, j.index], dr.by_v[index, j.index] = dot(force, j.Z[1]), dot(force, j.twice[1])
    return matvec(joint.turn, couple)
