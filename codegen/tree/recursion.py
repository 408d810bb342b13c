"""Equation (5), left unexpanded, along the tree: r_s = sum_k tr(dA_0k/ds H_k A_ddot_0k^T).

A_ddot_0k = A_0k K_k with K_k = [[U, a], [0, 0]], U = skew(w_dot) + skew(w)^2 and a the acceleration of the link's
origin, both in link axes.  The rotation R_0k cancels in the trace, so link k contributes P_k = K_k H_k, and a trace
against a tangent reads off a force (last column of P) or a moment (its left block, antisymmetric).  Forces and
moments are collected from the tips to the base.  Every function runs on nodes of a program, on floats and on SymPy
expressions alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from eomgen.robot.model import FIXED_BODY

from .frozen_joints import JointGeometry, PosedTree, unit
from .modal import modal_energy, modal_rows, modal_wrench
from .spatial import (
    ZERO,
    Mat,
    PseudoInertia,
    Scalar,
    Vec,
    add,
    cross,
    dot,
    is_zero,
    mat3,
    matvec,
    scale,
    transpose,
    vec3,
)


@dataclass(frozen=True)
class Acceleration:
    """K of a frame in its axes: ``rate`` w, ``dot`` w_dot, ``origin`` a, and U with the squares of w."""

    rate: Vec
    dot: Vec
    origin: Vec
    squares: Vec
    U: Mat


@dataclass(frozen=True)
class Wrench:
    """A force, and the moment about a frame's origin, in the frame's axes."""

    force: Vec
    moment: Vec

    def __add__(self, other: Wrench) -> Wrench:
        return Wrench(add(self.force, other.force), add(self.moment, other.moment))

    def scaled(self, factor: Scalar) -> Wrench:
        """Return the wrench times a number."""
        return Wrench(scale(factor, self.force), scale(factor, self.moment))

    def plus(self, factor: Scalar, other: Wrench) -> Wrench:
        """Return the wrench and another one times a number."""
        if is_zero(factor):
            return self
        return Wrench(add(self.force, scale(factor, other.force)), add(self.moment, scale(factor, other.moment)))

    def turned(self, rotation: Mat) -> Wrench:
        """Return the wrench in other axes."""
        return Wrench(matvec(rotation, self.force), matvec(rotation, self.moment))


NO_WRENCH = Wrench(ZERO, ZERO)


def acceleration(rate: Vec, dot_rate: Vec, origin: Vec) -> Acceleration:
    """Return K from angular velocity, angular acceleration, and acceleration of the origin."""
    w, d = rate, dot_rate
    s = (w[0] * w[0], w[1] * w[1], w[2] * w[2])
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    U = (
        (-(s[1] + s[2]), xy - d[2], xz + d[1]),
        (xy + d[2], -(s[0] + s[2]), yz - d[0]),
        (xz - d[1], yz + d[0], -(s[0] + s[1])),
    )
    return Acceleration(rate, dot_rate, origin, s, U)


def _through_joint(
    parent: Acceleration, joint: JointGeometry, v: Sequence[Scalar], a: Sequence[Scalar]
) -> Acceleration:
    back = transpose(joint.turn)
    w, d = matvec(back, parent.rate), matvec(back, parent.dot)
    origin = matvec(back, add(parent.origin, matvec(parent.U, joint.offset)))
    for index, axis in joint.translations:
        origin = add(origin, cross(scale(2.0, w), unit(axis, v[index])))  # Coriolis
        origin = add(origin, unit(axis, a[index]))
    if len(joint.rotations) == 1 and any(row[joint.rotations[0].axis] in (-1.0, 1.0) for row in joint.turn):
        return _through_turn(parent, joint, (w, d, origin), v, a)
    for turn in joint.rotations:
        back, spin = transpose(turn.matrix), unit(turn.axis, v[turn.index])
        w, origin = matvec(back, w), matvec(back, origin)
        d = add(add(matvec(back, d), cross(w, spin)), unit(turn.axis, a[turn.index]))
        w = add(w, spin)
    return acceleration(w, d, origin)


def _through_turn(
    parent: Acceleration, joint: JointGeometry, at_joint: tuple[Vec, Vec, Vec], v: Sequence[Scalar], a: Sequence[Scalar]
) -> Acceleration:
    """Pass one rotation about an axis e of the parent's frame: U e is the same vector in front of it and behind it.

    Both bodies carry the axis with them.  So the column U e turns like any vector, w_dot across the axis follows from
    it, and the products of rates that carry w_dot through the joint are saved.
    """
    (turn,) = joint.rotations
    (w, d, origin), back = at_joint, transpose(turn.matrix)
    i, j, k = (turn.axis + 1) % 3, (turn.axis + 2) % 3, turn.axis
    w = add(matvec(back, w), unit(k, v[turn.index]))
    axis = vec3(row[k] for row in joint.turn)
    column = matvec(back, matvec(transpose(joint.turn), matvec(parent.U, axis)))
    across = {i: w[j] * w[k] - column[j], j: column[i] - w[i] * w[k], k: d[k] + a[turn.index]}
    moving = acceleration(w, (across[0], across[1], across[2]), matvec(back, origin))
    U = [list(row) for row in moving.U]
    U[i][k], U[j][k] = column[i], column[j]
    return replace(moving, U=mat3(U))


def accelerations(tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar]) -> list[Acceleration]:
    """Compute K of every body, with gravity as an acceleration of the base."""
    still = acceleration(ZERO, ZERO, scale(-1.0, tree.bound.gravity))
    moving: list[Acceleration] = []
    for body, joint in zip(tree.model.bodies, tree.joints, strict=True):
        moving.append(_through_joint(still if body.parent == FIXED_BODY else moving[body.parent], joint, v, a))
    return moving


def body_wrench(K: Acceleration, H: PseudoInertia) -> Wrench:
    """Read P = K H off: force U mc + m a, moment mc x a + the antisymmetric block of U J."""
    U, J, s = K.U, H.second, K.squares
    force = add(matvec(U, H.first), scale(H.mass, K.origin))
    turning = (
        J[1][1] * U[2][1] - J[2][2] * U[1][2] + J[1][2] * (s[2] - s[1]) + J[0][1] * U[2][0] - J[0][2] * U[1][0],
        J[2][2] * U[0][2] - J[0][0] * U[2][0] + J[0][2] * (s[0] - s[2]) + J[1][2] * U[0][1] - J[0][1] * U[2][1],
        J[0][0] * U[1][0] - J[1][1] * U[0][1] + J[0][1] * (s[1] - s[0]) + J[0][2] * U[1][2] - J[1][2] * U[0][2],
    )
    return Wrench(force, add(cross(H.first, K.origin), turning))


def collect(tree: PosedTree, wrenches: Sequence[Wrench]) -> tuple[list[Scalar], list[Wrench]]:
    """Sum wrenches from the tips to the base: the trace against every tangent, each joint's whole wrench in body axes.

    Args:
        wrenches: per body, at the body's origin in its axes.

    Returns:
        n rows, and the sum of wrenches of each body and of all that hangs on it.
    """
    total = list(wrenches)
    rows: list[Scalar] = [0.0] * tree.model.size
    for k in range(len(tree.model.bodies) - 1, -1, -1):
        _collect_body(tree, k, total, rows)
    return rows, total


def _collect_body(tree: PosedTree, k: int, total: list[Wrench], rows: list[Scalar]) -> None:
    """Collect rows of one joint, where all that hangs on its body is in ``total`` already; the parent's share."""
    tree.note(f"{tree.model.bodies[k].joint}: traces against its tangents, eq. (5)")
    at_parent = through_joint_back(total[k], tree.joints[k], rows)
    parent = tree.model.bodies[k].parent
    if parent != FIXED_BODY:
        total[parent] = total[parent] + at_parent


def through_joint_back(wrench: Wrench, joint: JointGeometry, rows: list[Scalar], whole: Mat | None = None) -> Wrench:
    """Read the joint's rows off a wrench in body axes, and move it to the parent body's origin and axes.

    ``whole`` is the product of the joint's rotations, where many wrenches pass: 9 products turn a force, not 12.
    """
    force, moment = wrench.force, wrench.moment
    for turn in reversed(joint.rotations):
        rows[turn.index] = moment[turn.axis]
        moment = matvec(turn.matrix, moment)
        force = matvec(turn.matrix, force) if whole is None else force
    force = force if whole is None else matvec(whole, force)
    for index, axis in joint.translations:
        rows[index] = force[axis]
    force = matvec(joint.turn, force)
    return Wrench(force, add(matvec(joint.turn, moment), cross(joint.offset, force)))


def inertial_rows(
    tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar], gravity: Vec
) -> tuple[list[Scalar], list[Wrench]]:
    """Compute eq. (5)'s left side less gravity's generalized force, per coordinate, and the joints' wrenches.

    A branch is collected before the next one begins, and a link's wrench is taken where its K is: values that wait are
    what registers cannot hold.
    """
    still = acceleration(ZERO, ZERO, scale(-1.0, gravity))
    moving: list[Acceleration] = []
    total: list[Wrench] = []
    rows: list[Scalar] = [0.0] * tree.model.size
    path: list[int] = []

    def back_to(parent: int) -> None:
        while path and path[-1] != parent:
            _collect_body(tree, path.pop(), total, rows)

    for k, body in enumerate(tree.model.bodies):
        back_to(body.parent)
        tree.note(f"{body.name}: w, w_dot, a and U of A_ddot = A K, eq. (6) unexpanded; its wrench P = K H")
        K = _through_joint(still if body.parent == FIXED_BODY else moving[body.parent], tree.joints[k], v, a)
        moving.append(K)
        total.append(body_wrench(K, tree.bound.bodies[k].inertia))
        bent = tree.bound.bodies[k].bent
        if bent is not None:
            total[k] = total[k] + Wrench(*modal_wrench(bent, K.rate, v, a))
            for index, row in modal_rows(bent, K.rate, K.U, K.origin, v, a).items():
                rows[index] = row
        path.append(k)
    back_to(FIXED_BODY)
    return [row + c * acc for row, c, acc in zip(rows, tree.bound.armature, a, strict=True)], total


@dataclass(frozen=True)
class Velocity:
    """W of a frame in its axes: angular velocity ``rate``, velocity of the ``origin``."""

    rate: Vec
    origin: Vec


STILL = Velocity(ZERO, ZERO)


def velocities(tree: PosedTree, v: Sequence[Scalar]) -> list[tuple[tuple[Velocity, ...], Velocity]]:
    """Compute angular velocities of each body: W, and W in front of every rotation of its joint, translations too."""
    bodies: list[tuple[tuple[Velocity, ...], Velocity]] = []
    for body, joint in zip(tree.model.bodies, tree.joints, strict=True):
        parent = STILL if body.parent == FIXED_BODY else bodies[body.parent][1]
        back = transpose(joint.turn)
        w, origin = matvec(back, parent.rate), matvec(back, add(parent.origin, cross(parent.rate, joint.offset)))
        for index, axis in joint.translations:
            origin = add(origin, unit(axis, v[index]))
        before = [Velocity(w, origin)]
        for turn in joint.rotations:
            back = transpose(turn.matrix)
            w = add(matvec(back, w), unit(turn.axis, v[turn.index]))
            origin = matvec(back, origin)
            before.append(Velocity(w, origin))
        bodies.append((tuple(before[:-1]) or (before[0],), before[-1]))
    return bodies


def kinetic_energy(tree: PosedTree, v: Sequence[Scalar]) -> Scalar:
    """Compute eq. (4): E = 1/2 sum_k tr(W_k H_k W_k^T), with the armatures."""
    energy: Scalar = 0.0
    for (_, W), body in zip(velocities(tree, v), tree.bound.bodies, strict=True):
        H = body.inertia
        momentum = add(scale(H.mass, W.origin), cross(W.rate, H.first))
        spin = add(rotational_inertia(H, W.rate), cross(H.first, W.origin))
        energy = energy + 0.5 * (dot(momentum, W.origin) + dot(spin, W.rate))
        if body.bent is not None:
            energy = energy + modal_energy(body.bent, W.rate, W.origin, v)
    n = len(tree.model.coordinates)  # internal states are no motion
    for c, rate in zip(tree.bound.armature[:n], v[:n], strict=True):
        energy = energy + 0.5 * c * rate * rate
    return energy


def rotational_inertia(H: PseudoInertia, w: Vec) -> Vec:
    """Return I w with I = tr(J) 1 - J."""
    J = H.second
    return (
        (J[1][1] + J[2][2]) * w[0] - J[0][1] * w[1] - J[0][2] * w[2],
        (J[0][0] + J[2][2]) * w[1] - J[0][1] * w[0] - J[1][2] * w[2],
        (J[0][0] + J[1][1]) * w[2] - J[0][2] * w[0] - J[1][2] * w[1],
    )
