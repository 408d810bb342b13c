"""Forward dynamics in O(n): joints are eliminated from the tips, no mass matrix is formed.

A body with all that hangs on it answers an acceleration (a, w_dot) of its origin with the wrench

    [f; n] = [[L, C], [C^T, A]] [a; w_dot] + [p_f; p_n],

its articulated inertia; for a body alone L = m 1, C w_dot = w_dot x mc, A = I.  A coordinate along a unit axis takes
one rank-one term away (R. Featherstone, Rigid Body Dynamics Algorithms, chapter 7, one elementary step at a time).
Coordinates that slopes of an implicit step couple in one joint go together (``coupled``).

A joint with all six coordinates hands on no inertia at all: what hangs on such joints is a free body (``free_bodies``).

Modes of a body that bends are eliminated before its joint (``modal``).  The joints of its nodes have no coordinates of
their own: like prescribed ones these have accelerations that are known, once those of the modes are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from eomgen.robot.model import FIXED_BODY

from ..tree.frozen_joints import PosedTree, unit
from ..tree.modal import modal_wrench
from ..tree.recursion import NO_WRENCH, Acceleration, Wrench, acceleration
from ..tree.spatial import (
    ZERO,
    Mat,
    Scalar,
    Vec,
    add,
    cross,
    dot,
    is_zero,
    matmul,
    matvec,
    scale,
    sum_mat,
    transpose,
)
from .articulated import (
    NOTHING,
    Articulated,
    diagonal,
    gyroscopic_moment,
    inertia_tensor,
    inverse3,
    inverse_or_zero,
    less,
    rows_scaled,
    symmetric,
    to_parent,
    turned,
    with_row,
)
from .coupled import Coupled, directions_of, eliminate_coupled
from .free_bodies import FreeBodies, Speeds
from .modal import Modes

NO_COUPLINGS: Mapping[tuple[int, int], Scalar] = MappingProxyType({})


@dataclass(frozen=True)
class _Step:
    """An eliminated coordinate: acceleration = free - gain . (a, w_dot), free = inverse (drive - what is there)."""

    index: int
    row: int  # of its unit axis, 0-2 force, 3-5 moment
    free: Scalar
    gain: Wrench
    inverse: Scalar


@dataclass(frozen=True)
class _Block:
    """An eliminated block of a joint's translations: accelerations = free - yielding a - gain w_dot."""

    free: Vec
    yielding: Mat
    gain: Mat
    whole: Mat
    inverse: Mat
    coupling: Mat


class Elimination:
    """Forward dynamics of a model; ``accelerations`` are the result, ``pivots`` (value, scale) must stay positive."""

    def __init__(
        self,
        tree: PosedTree,
        v: Sequence[Scalar],
        drives: Sequence[Scalar],
        *,
        coupled: bool = False,
        slopes: Mapping[tuple[int, int], Scalar] = NO_COUPLINGS,
    ) -> None:
        """Eliminate all joints.

        Args:
            drives: of coordinates that follow modes their accelerations where these have none.
            slopes: what couples coordinates of one joint or modes of one link beside the diagonal, by their indices
                (i, j) with i < j; their armatures are not zero.
            coupled: whether rows of closed loops come on top, which ``respond`` to them needs; armatures then couple
                no free bodies.
        """
        self.model, self.bound, self.joints, self.note = tree.model, tree.bound, tree.joints, tree.note
        self.v, self.drives = v, list(drives)
        self.shares = {index: share for body in self.bound.bodies for index, share in body.shares.items()}
        self.prescribed, self.slopes = frozenset(self.model.prescribed).union(self.shares), slopes
        self.coupled: dict[int, Coupled] = {}
        self.modes: dict[int, Modes] = {}
        beside = {i for pair in slopes for i in pair}.union(self.shares)
        self.bodies = FreeBodies(tree, v, drives, alone=coupled, coupled=beside)
        self.free, self.accelerations, self.pivots = self.bodies.free, self.bodies.accelerations, self.bodies.pivots
        self.sizes = self._sizes()
        self.speeds = self._speeds()
        self.steps: list[list[_Step]] = [[] for _ in self.model.bodies]
        self.blocks: dict[int, _Block] = {}
        self._backward()
        self._forward()
        for index in self.prescribed:
            self.accelerations[index] = self.drives[index]

    def _speeds(self) -> list[Speeds]:
        speeds: list[Speeds] = []
        for body, joint in zip(self.model.bodies, self.joints, strict=True):
            parent = ZERO if body.parent == FIXED_BODY else speeds[body.parent].behind[-1]
            back = transpose(joint.turn)
            w = matvec(back, parent)
            drift = matvec(back, matvec(acceleration(parent, ZERO, ZERO).U, joint.offset))
            for index, axis in joint.translations:
                drift = add(drift, cross(scale(2.0, w), unit(axis, self.v[index])))
            behind = [w]
            for turn in joint.rotations:
                behind.append(add(matvec(transpose(turn.matrix), behind[-1]), unit(turn.axis, self.v[turn.index])))
            speeds.append(Speeds(w, tuple(behind), drift))
        return speeds

    def _backward(self) -> None:
        inertias = [self._body(k) for k in range(len(self.joints))]
        for k in range(len(self.joints) - 1, -1, -1):
            self.note(f"{self.model.bodies[k].joint}: eliminated, from the tips to the base")
            if k in self.modes:
                inertias[k] = self.modes[k].eliminate(inertias[k])
                for index, pivot in self.modes[k].pivots.items():
                    self.pivots[index] = pivot
            if self.free[k]:
                at_joint = self.bodies.eliminate(k, inertias[k].p, self.speeds[k])
            else:
                at_joint = self._eliminate_steps(k, inertias[k])
            parent = self.model.bodies[k].parent
            if parent != FIXED_BODY:
                if self.bound.bodies[k].shares:
                    self.modes[parent].add_node(k, at_joint, self.joints[k], self.bound.bodies[k].shares)
                inertias[parent] = inertias[parent] + to_parent(at_joint, self.joints[k])

    def _body(self, k: int) -> Articulated:
        """Return the body alone; one behind six coordinates brings its mass in itself (``FreeBodies``)."""
        if self.free[k]:
            return Articulated(NOTHING, NOTHING, NOTHING, NO_WRENCH)
        H, w = self.bound.bodies[k].inertia, self.speeds[k].behind[-1]
        x, y, z = H.first
        coupling: Mat = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))
        mass: Mat = (unit(0, H.mass), unit(1, H.mass), unit(2, H.mass))
        p = Wrench(matvec(acceleration(w, ZERO, ZERO).U, H.first), gyroscopic_moment(H.second, w))
        bent = self.bound.bodies[k].bent
        if bent is not None:
            p = p + Wrench(*modal_wrench(bent, w, self.v, [0.0] * self.model.size))
            self.modes[k] = Modes(bent, w, self.v, self.drives, self.bound.armature, self.slopes)
        return Articulated(mass, coupling, inertia_tensor(H.second), p)

    def _eliminate_steps(self, k: int, inertia: Articulated) -> Articulated:
        """Eliminate one coordinate after the other; the inertia that is left, in the joint's axes at its origin."""
        joint, speeds = self.joints[k], self.speeds[k]
        together = self._coupled_coordinates(k)
        for turn, w in reversed(list(zip(joint.rotations, speeds.behind[1:], strict=True))):
            drift = cross(w, unit(turn.axis, self.v[turn.index]))
            if turn.index in self.prescribed:
                drift = add(drift, unit(turn.axis, self.drives[turn.index]))
            inertia = replace(inertia, p=inertia.answer(ZERO, drift))
            if turn.index not in self.prescribed and turn.index not in together:
                inertia = self._eliminate(k, inertia, turn.index, 3 + turn.axis)
            inertia = turned(turn, inertia)
        inertia = replace(inertia, p=inertia.answer(self._known(k), ZERO))
        if together:
            inertia = self._eliminate_coupled(k, together, inertia)
        unknown = [(i, axis) for i, axis in joint.translations if i not in self.prescribed and i not in together]
        if len(unknown) == 3 and not any(is_zero(self.bound.armature[index]) for index, _ in unknown):
            return self._eliminate_translations(k, inertia)
        for index, axis in reversed(unknown):
            inertia = self._eliminate(k, inertia, index, axis)
        return inertia

    def _coupled_coordinates(self, k: int) -> list[int]:
        """Return unprescribed coordinates of a joint that slopes couple, and angles before them."""
        together = {i for pair in self.slopes for i in pair}.intersection(self.model.bodies[k].indices)
        angles = [turn.index for turn in self.joints[k].rotations]
        last = max((i for i in angles if i in together), default=-1)
        together |= {i for i in angles if i < last}
        return sorted(together.difference(self.prescribed))

    def _eliminate_coupled(self, k: int, together: Sequence[int], inertia: Articulated) -> Articulated:
        """Take coordinates that slopes couple out of the inertia in front of the joint's rotations."""
        slopes = {**self.slopes, **{(i, i): self.bound.armature[i] for i in together}}
        drives = []
        for i in together:
            drive = self.drives[i]
            for j in self.prescribed:
                drive = drive - slopes.get((min(i, j), max(i, j)), 0.0) * self.drives[j]
            drives.append(drive)
        directions = directions_of(self.joints[k], together)
        coupled, inertia = eliminate_coupled(inertia, directions, slopes, drives)
        self.coupled[k] = coupled
        for direction, pivot in zip(directions, coupled.pivots, strict=True):
            is_angle = any(turn.index == direction.index for turn in self.joints[k].rotations)
            size = self.sizes[k][is_angle] + self.bound.armature[direction.index]
            self.pivots[direction.index] = (pivot, size)
        return inertia

    def _known(self, k: int) -> Vec:
        """Return the origin's acceleration by velocities and prescribed translations, in the joint's axes."""
        known = self.speeds[k].drift
        for index, axis in self.joints[k].translations:
            if index in self.prescribed:
                known = add(known, unit(axis, self.drives[index]))
        return known

    def _eliminate(self, k: int, inertia: Articulated, index: int, row: int) -> Articulated:
        """Take a coordinate along unit axis ``row`` (0-2 force, 3-5 moment) out of the inertia."""
        axis = row % 3
        if row < 3:
            gain, here = Wrench(transpose(inertia.L)[axis], inertia.C[axis]), inertia.p.force[axis]
            diagonal = inertia.L[axis][axis]
        else:
            gain, here = Wrench(transpose(inertia.C)[axis], inertia.A[axis]), inertia.p.moment[axis]
            diagonal = inertia.A[axis][axis]
        armature = self.bound.armature[index]
        pivot = diagonal + armature
        self.pivots[index] = (pivot, self.sizes[k][row // 3] + armature)
        inverse = inverse_or_zero(pivot)
        free = (self.drives[index] - here) * inverse
        scaled = gain.scaled(inverse)
        self.steps[k].append(_Step(index, row, free, scaled, inverse))
        p = inertia.p + gain.scaled(free)
        left = Articulated(
            symmetric(less(inertia.L, scaled.force, gain.force)),
            less(inertia.C, scaled.force, gain.moment),
            symmetric(less(inertia.A, scaled.moment, gain.moment)),
            p,
        )
        share = armature * inverse  # of its row, that is all that the armature leaves
        return with_row(left, row, gain.scaled(share), self.drives[index] - armature * free)

    def _eliminate_translations(self, k: int, inertia: Articulated) -> Articulated:
        """Eliminate three translations with armatures D at once: one division, and no chain of three.

        L becomes D K L with K = (L + D)^-1, where off its diagonal K L = -K D and on it nothing cancels, however large
        D is.
        """
        first = self.joints[k].translations[0][0]
        D = (self.bound.armature[first], self.bound.armature[first + 1], self.bound.armature[first + 2])
        drives = (self.drives[first], self.drives[first + 1], self.drives[first + 2])
        L, C, A, p = inertia.L, inertia.C, inertia.A, inertia.p
        whole = sum_mat(L, diagonal(D))
        K, determinant = inverse3(whole)
        x, y, z = (self.sizes[k][0] + d for d in D)
        self.pivots[first] = (determinant, x * y * z)
        KL = (
            (dot(K[0], L[0]), -1.0 * (K[0][1] * D[1]), -1.0 * (K[0][2] * D[2])),
            (-1.0 * (K[1][0] * D[0]), dot(K[1], L[1]), -1.0 * (K[1][2] * D[2])),
            (-1.0 * (K[2][0] * D[0]), -1.0 * (K[2][1] * D[1]), dot(K[2], L[2])),
        )
        gain = matmul(K, C)
        free = matvec(K, add(drives, scale(-1.0, p.force)))
        self.blocks[k] = _Block(free, KL, gain, whole, K, C)
        for i in range(3):
            A = symmetric(less(A, C[i], gain[i]))
        held = (drives[0] - D[0] * free[0], drives[1] - D[1] * free[1], drives[2] - D[2] * free[2])
        p = Wrench(held, add(p.moment, matvec(transpose(C), free)))
        return Articulated(symmetric(rows_scaled(D, KL)), rows_scaled(D, gain), A, p)

    def _sizes(self) -> list[tuple[Scalar, Scalar]]:
        """Estimate mass and moments of inertia of each body with all that hangs on it: what a pivot is compared to.

        The body alone would not do: what comes from behind may be round-off of an inertia that is gone.  Bodies behind
        six coordinates hand on an exact zero and are left out.
        """
        inertias = [body.inertia for body in self.bound.bodies]
        masses = [H.mass for H in inertias]
        moments = [H.second[0][0] + H.second[1][1] + H.second[2][2] for H in inertias]
        for k in range(len(inertias) - 1, -1, -1):
            parent, offset = self.model.bodies[k].parent, self.bound.bodies[k].placement.origin
            if parent != FIXED_BODY and not self.free[k]:
                masses[parent] = masses[parent] + masses[k]
                moments[parent] = moments[parent] + (moments[k] + masses[k] * dot(offset, offset))
        return list(zip(masses, moments, strict=True))

    def _forward(self) -> None:
        accelerations: list[Acceleration] = []
        base = acceleration(ZERO, ZERO, scale(-1.0, self.bound.gravity))
        for k, body in enumerate(self.model.bodies):
            self.note(f"{body.joint}: accelerations, from the base to the tips")
            parent, speeds = base if body.parent == FIXED_BODY else accelerations[body.parent], self.speeds[k]
            if self.free[k]:
                a, d = self.bodies.release(k, parent, speeds)
            else:
                given = {i: self.drives[i] for i in body.indices if i in self.prescribed}
                turning = [
                    cross(w, unit(turn.axis, self.v[turn.index]))
                    for turn, w in zip(self.joints[k].rotations, speeds.behind[1:], strict=True)
                ]
                front = self.front(k, parent.origin, parent.dot)
                a, d = self.release(k, front, self._free(k), given, self.accelerations, (speeds.drift, turning))
            if k in self.modes:
                self.release_modes(self.modes[k].released(a, d), self.accelerations, self.drives)
            accelerations.append(acceleration(speeds.behind[-1], d, a))

    def _free(self, k: int) -> dict[int, Scalar]:
        """Return accelerations of a joint's coordinates under their drives where what is in front of it rests."""
        free = {step.index: step.free for step in self.steps[k]}
        if k in self.coupled:
            free |= zip(self.coupled[k].indices, self.coupled[k].free, strict=True)
        if k in self.blocks:
            free |= enumerate(self.blocks[k].free, self.joints[k].translations[0][0])
        return free

    def front(self, k: int, a: Vec, d: Vec) -> tuple[Vec, Vec]:
        """Return accelerations of a parent's origin and angle at a joint's frame, in the joint's axes."""
        joint, back = self.joints[k], transpose(self.joints[k].turn)
        return matvec(back, add(a, cross(d, joint.offset))), matvec(back, d)

    def release(
        self,
        k: int,
        front: tuple[Vec, Vec],
        free: Mapping[int, Scalar],
        given: Mapping[int, Scalar],
        accelerations: list[Scalar],
        drifts: tuple[Vec, Sequence[Vec]] = (ZERO, (ZERO, ZERO, ZERO)),
    ) -> tuple[Vec, Vec]:
        """Write accelerations of a joint's coordinates; return those of the body's origin and angle, in body axes.

        Args:
            front: as of ``front``.
            free: of eliminated coordinates where ``front`` vanishes, by index; absent ones are 0.
            given: of prescribed coordinates and followers, by index; absent ones are 0.
            drifts: of the origin by velocities, and of the angle behind each rotation.
        """
        joint, (a, d) = self.joints[k], front
        steps = {step.index: step for step in self.steps[k]}

        def released(index: int, a: Vec, d: Vec) -> Scalar:
            gain = steps[index].gain
            accelerations[index] = free.get(index, 0.0) - (dot(gain.force, a) + dot(gain.moment, d))
            return accelerations[index]

        if k in self.blocks:
            block, first = self.blocks[k], joint.translations[0][0]
            x, y, z = (free.get(first + i, 0.0) for i in range(3))
            moved = add((x, y, z), scale(-1.0, add(matvec(block.yielding, a), matvec(block.gain, d))))
            accelerations[first : first + 3] = moved
            a = add(a, moved)
        for index, axis in joint.translations:
            if index in steps:
                a = add(a, unit(axis, released(index, a, d)))
        together = self.coupled[k].moved(free, a, d) if k in self.coupled else {}
        known = drifts[0]
        for index, axis in joint.translations:
            a = add(a, unit(axis, together.get(index, 0.0)))
            known = add(known, unit(axis, given.get(index, 0.0)))
        a = add(a, known)
        for turn, drift in zip(joint.rotations, drifts[1], strict=False):
            back, index = transpose(turn.matrix), turn.index
            a, d = matvec(back, a), matvec(back, d)
            value = released(index, a, d) if index in steps else together.get(index, given.get(index, 0.0))
            d = add(add(d, drift), unit(turn.axis, value))
        for index, value in together.items():
            accelerations[index] = value
        return a, d

    def release_modes(self, found: Mapping[int, Scalar], accelerations: list[Scalar], following: list[Scalar]) -> None:
        """Write accelerations of a body's modes, and add to those of what follows them."""
        for index, value in found.items():
            accelerations[index] = value
        for follower, share in self.shares.items():
            for index, ratio in share.items():
                if index in found:
                    following[follower] = following[follower] + ratio * found[index]
