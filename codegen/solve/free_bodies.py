"""Bodies behind joints with all six coordinates: free bodies that the drives hold.

Six traces against the tangents of such a joint determine its wrench, so force and moment follow from the drives alone
and no inertia is handed on.  The moment in the axes behind beta is (n_x, tau_beta, tau_gamma) and in front of it
(tau_alpha, tau_beta, n_z), with

    n_x = (tau_alpha - sin(beta) tau_gamma) / cos(beta),    n_z = (tau_gamma - sin(beta) tau_alpha) / cos(beta).

Only armatures of angles couple bodies: each takes psi = armature q_ddot from its drive.  With the dual vectors of the
angles (q_ddot = dual . w_dot of the body - reach . w_dot of its parent - drift) the psi solve a small linear system,

    (1 / armature + T) psi = b,    T = sum over the bodies of dual . I^-1 dual,

which is eliminated body by body from the tips.  A body's inertia stays a number, and so does its inverse.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass

from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.value import COORDINATES

from ..tree.bound import Bound
from ..tree.frozen_joints import PosedTree, unit
from ..tree.recursion import Acceleration, Wrench, acceleration
from ..tree.spatial import (
    ZERO,
    Mat,
    PseudoInertia,
    Scalar,
    Vec,
    add,
    cross,
    dot,
    is_zero,
    matvec,
    scale,
    transpose,
    vec3,
)
from .articulated import (
    NOTHING,
    Articulated,
    diagonal_product,
    gyroscopic_moment,
    inertia_tensor,
    inverse3,
    inverse_or_zero,
    less,
    symmetric,
)

SINGULAR = 1e-9  # a determinant below so much of the product of the diagonal is round-off


@dataclass(frozen=True)
class Speeds:
    """Angular velocities: in the joint's axes, behind every rotation; and the acceleration that velocities make."""

    joint: Vec
    behind: tuple[Vec, ...]
    drift: Vec  # of the origin, joint axes


@dataclass(frozen=True)
class _Solved:
    """A body without its armatures: w_dot = ``dot`` and acceleration of the centre of mass ``specific``, body axes."""

    inverse: Mat
    dot: Vec
    specific: Vec
    com: Vec
    inverse_cosine: Scalar


@dataclass(frozen=True)
class _Psi:
    """An armature's torque: ``dual`` in body axes, ``reach`` in the parent's, ``answer`` = I^-1 dual, and the drift."""

    index: int
    armature: Scalar
    dual: Vec
    reach: Vec
    answer: Vec
    drift: Scalar


@dataclass(frozen=True)
class _Row:
    """An eliminated psi = factor (right - sum of others' coefficient psi - reach . w_dot of the parent)."""

    index: int
    factor: Scalar
    right: Scalar
    others: tuple[tuple[int, Scalar], ...]
    reach: Vec


class FreeBodies:
    """The free bodies of a model.

    Attributes:
        accelerations, pivots: of all coordinates; those of free bodies are written where these are solved.
    """

    def __init__(
        self,
        tree: PosedTree,
        v: Sequence[Scalar],
        drives: Sequence[Scalar],
        *,
        alone: bool = False,
        coupled: Container[int] = (),
    ) -> None:
        """Find the free bodies.

        Args:
            alone: take those alone that no armature couples to others.
            coupled: indices of coordinates that slopes couple, whose bodies are none.
        """
        self.model, self.bound, self.joints, self.v, self.drives = tree.model, tree.bound, tree.joints, v, drives
        model = tree.model
        self.accelerations: list[Scalar] = [0.0] * model.size
        self.pivots: list[tuple[Scalar, Scalar]] = [(1.0, 1.0)] * model.size
        self.free = bodies_apart(model, tree.bound, alone=alone, coupled=coupled)
        self.solved: dict[int, _Solved] = {}
        self.torques: list[list[_Psi]] = [[] for _ in model.bodies]
        self.rows: list[list[_Row]] = [[] for _ in model.bodies]  # eliminated when this body was reached
        self.hanging: list[list[_Row]] = [[] for _ in model.bodies]  # of a joint that hangs on another kind of body
        self.answers: dict[int, Vec] = {}  # I^-1 reach of a psi, of the body in front of its joint
        self.T: dict[tuple[int, int], Scalar] = {}
        self.right: dict[int, Scalar] = {}
        self.psi: dict[int, Scalar] = {}

    def eliminate(self, k: int, load: Wrench, speeds: Speeds) -> Articulated:
        """Solve body k under the load of what hangs on it; the inertia that its parent feels, in the joint's axes."""
        joint, first, H = self.joints[k], self.model.bodies[k].first, self.bound.bodies[k].inertia
        held, moment, inverse_cosine = self._moments(k, self.drives)
        force = vec3(self.drives[first : first + 3])
        left = add(joint.inwards(force), scale(-1.0, load.force))  # m times the acceleration of the centre of mass
        com, J = about_com(H)
        turning = add(gyroscopic_moment(J, speeds.behind[-1]), cross(com, left))
        in_body = matvec(transpose(joint.rotations[-1].matrix), held)
        inertia = inertia_tensor(J)
        inverse, determinant = inverse3(inertia)
        self.pivots[joint.rotations[-1].index] = (determinant, diagonal_product(inertia))
        self.pivots[first] = (H.mass, 0.0)
        rate = matvec(inverse, add(in_body, scale(-1.0, add(load.moment, turning))))
        specific = scale(inverse_or_zero(H.mass), left)
        self.solved[k] = _Solved(inverse, rate, specific, com, inverse_cosine)
        self._couple(k, speeds)
        wrench = Wrench(force, moment)
        parent = self.model.bodies[k].parent
        if parent == FIXED_BODY or not self.free[parent]:
            return self._hand_on(k, wrench)
        return Articulated(NOTHING, NOTHING, NOTHING, wrench)

    def _moments(self, k: int, drives: Sequence[Scalar]) -> tuple[Vec, Vec, Scalar]:
        """Return the joint's moment behind beta, the same in the joint's axes, and 1 / cos(beta)."""
        alpha, beta, gamma = self.joints[k].rotations
        about_alpha, about_beta, about_gamma = (drives[turn.index] for turn in (alpha, beta, gamma))
        inverse_cosine = 1.0 / beta.cos
        self.pivots[beta.index] = (beta.cos * beta.cos, 1.0)
        n_x = (about_alpha - beta.sin * about_gamma) * inverse_cosine
        n_z = (about_gamma - beta.sin * about_alpha) * inverse_cosine
        held: Vec = (n_x, about_beta, about_gamma)
        return held, matvec(alpha.matrix, (about_alpha, about_beta, n_z)), inverse_cosine

    def _couple(self, k: int, speeds: Speeds) -> None:
        """Write the rows of the joint's psi; those of the joints behind are complete now and are eliminated."""
        body = self.solved[k]
        self.torques[k] = torques = self._psi(k, speeds)
        for i, one in enumerate(torques):
            self.right[one.index] = dot(one.dual, body.dot) - one.drift
            for other in torques[i:]:
                self.T[one.index, other.index] = dot(one.dual, other.answer)
        behind = [psi for child in self.model.children(k) for psi in self.torques[child]]
        self.answers.update((psi.index, matvec(body.inverse, psi.reach)) for psi in behind)
        for i, one in enumerate(behind):
            self.right[one.index] = self.right[one.index] - dot(one.reach, body.dot)
            for other in behind[i:]:
                pair = one.index, other.index
                self.T[pair] = self.T.get(pair, 0.0) + dot(one.reach, self.answers[other.index])
            for mine in torques:
                self.T[mine.index, one.index] = -1.0 * dot(mine.dual, self.answers[one.index])
        for i in range(len(behind) - 1, -1, -1):
            self.rows[k].append(self._eliminate(behind[i], [psi.index for psi in (*torques, *behind[:i])]))

    def _psi(self, k: int, speeds: Speeds) -> list[_Psi]:
        """Return the armatures of a joint, with the dual vectors of its angles."""
        joint, body = self.joints[k], self.solved[k]
        alpha, beta, gamma = joint.rotations
        in_front, behind = self._drifts(k, speeds)
        t, tangent = body.inverse_cosine, beta.sin * body.inverse_cosine
        duals: tuple[Vec, ...] = ((t, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0 * tangent, 0.0, 1.0))  # axes behind beta
        reaches: tuple[Vec, ...] = ((1.0, 0.0, -1.0 * tangent), (0.0, 1.0, 0.0), (0.0, 0.0, t))  # in front of beta
        torques = []
        for turn, dual, reach in zip(joint.rotations, duals, reaches, strict=True):
            armature = self.bound.armature[turn.index]
            if not is_zero(armature):
                drift = dot(dual, behind) + dot(reach, in_front)
                in_parent = matvec(joint.turn, matvec(alpha.matrix, reach))
                in_body = matvec(transpose(gamma.matrix), dual)
                torques.append(_Psi(turn.index, armature, in_body, in_parent, matvec(body.inverse, in_body), drift))
        return torques

    def _eliminate(self, psi: _Psi, others: list[int], reach: Vec = ZERO) -> _Row:
        """Take one psi out of the rows of the others."""
        j = psi.index
        factor = psi.armature / (1.0 + psi.armature * self.T[j, j])
        row = _Row(j, factor, self.right[j], tuple((i, self.T[min(i, j), max(i, j)]) for i in others), reach)
        for n, (i, coefficient) in enumerate(row.others):
            scaled = factor * coefficient
            self.right[i] = self.right[i] - scaled * row.right
            for other, entry in row.others[n:]:
                pair = min(i, other), max(i, other)
                self.T[pair] = self.T[pair] - scaled * entry
        return row

    def _hand_on(self, k: int, wrench: Wrench) -> Articulated:
        """Hand on the psi of a joint that hangs on a body of another kind, or on the base: what that feels of them."""
        turn, passed, moment = transpose(self.joints[k].turn), NOTHING, wrench.moment
        reaches = {psi.index: matvec(turn, psi.reach) for psi in self.torques[k]}
        for n in range(len(self.torques[k]) - 1, -1, -1):
            psi, others = self.torques[k][n], [other.index for other in self.torques[k][:n]]
            reach = reaches[psi.index]
            row = self._eliminate(psi, others, reach)
            self.hanging[k].append(row)
            for i, coefficient in row.others:
                reaches[i] = add(reaches[i], scale(-1.0 * row.factor * coefficient, reach))
            moment = add(moment, scale(-1.0 * row.factor * row.right, reach))
            passed = symmetric(less(passed, scale(-1.0 * row.factor, reach), reach))
        return Articulated(NOTHING, NOTHING, passed, Wrench(wrench.force, moment))

    def _drifts(self, k: int, speeds: Speeds) -> tuple[Vec, Vec]:
        """Return velocity terms of w_dot: the turn about alpha in the axes behind it, the other two behind beta."""
        alpha, beta, gamma = self.joints[k].rotations
        _, front, behind, _ = speeds.behind
        about_beta, about_gamma = unit(beta.axis, self.v[beta.index]), unit(gamma.axis, self.v[gamma.index])
        return (
            cross(front, unit(alpha.axis, self.v[alpha.index])),
            add(cross(behind, about_gamma), cross(behind, about_beta)),
        )

    def inertia_of(self, k: int) -> dict[tuple[int, int], Scalar]:
        """Return a body's mass and inertia about its centre of mass, by pairs of coordinates, as of ``respond``."""
        first, H = self.model.bodies[k].first, self.bound.bodies[k].inertia
        inertia = inertia_tensor(about_com(H)[1])
        masses = {(first + i, first + i): H.mass for i in range(3)}
        return masses | {(first + 3 + i, first + 3 + j): inertia[i][j] for i in range(3) for j in range(i, 3)}

    def respond(self, k: int, push: Sequence[Scalar], load: Wrench) -> tuple[Vec, Vec, Vec, Vec, Wrench]:
        """Answer drives and a load at rest, where no body is coupled to another by an armature.

        Args:
            load: of what hangs on the body, at its origin in its axes.

        Returns:
            Force on the body and acceleration of its centre of mass, moment about that and w_dot, all in body axes; and
            the wrench that the parent feels, in the joint's axes.
        """
        joint, first, body = self.joints[k], self.model.bodies[k].first, self.solved[k]
        held, moment, _ = self._moments(k, push)
        force = vec3(push[first : first + 3])
        left = add(joint.inwards(force), scale(-1.0, load.force))
        in_body = matvec(transpose(joint.rotations[-1].matrix), held)
        torque = add(in_body, scale(-1.0, add(load.moment, cross(body.com, left))))
        specific = scale(inverse_or_zero(self.bound.bodies[k].inertia.mass), left)
        return left, specific, torque, matvec(body.inverse, torque), Wrench(force, moment)

    def released(self, k: int, specific: Vec, rate: Vec, parent: tuple[Vec, Vec], accelerations: list[Scalar]) -> Vec:
        """Write accelerations of a body's joint, at rest, into ``accelerations``; return that of its origin, body axes.

        Args:
            specific, rate: acceleration of its centre of mass and w_dot, body axes.
            parent: acceleration at the joint's frame and w_dot of the parent, the joint's axes.
        """
        joint, first, (carried, turning) = self.joints[k], self.model.bodies[k].first, parent
        alpha, _, gamma = joint.rotations
        a = add(specific, scale(-1.0, cross(rate, self.solved[k].com)))
        accelerations[first : first + 3] = add(joint.outwards(a), scale(-1.0, carried))
        turned = matvec(transpose(alpha.matrix), turning)
        self._write_angles(k, matvec(gamma.matrix, rate), turned, accelerations)
        return a

    def release(self, k: int, parent: Acceleration, speeds: Speeds) -> tuple[Vec, Vec]:
        """Write the joint's accelerations; return that of the body's origin and w_dot, in body axes."""
        joint, body, first = self.joints[k], self.solved[k], self.model.bodies[k].first
        back = transpose(joint.turn)
        turning = matvec(back, parent.dot)
        for row in reversed((*self.rows[k], *self.hanging[k])):
            rest = sum((c * self.psi[i] for i, c in row.others), dot(row.reach, turning))
            self.psi[row.index] = row.factor * (row.right - rest)
        d = body.dot
        for psi in self.torques[k]:
            d = add(d, scale(-1.0 * self.psi[psi.index], psi.answer))
        for child in self.model.children(k):
            for psi in self.torques[child]:
                d = add(d, scale(self.psi[psi.index], self.answers[psi.index]))
        a = add(body.specific, scale(-1.0, matvec(acceleration(speeds.behind[-1], d, ZERO).U, body.com)))
        alpha, _, gamma = joint.rotations
        in_front, behind = self._drifts(k, speeds)
        turned = add(matvec(transpose(alpha.matrix), turning), in_front)
        self._write_angles(k, add(matvec(gamma.matrix, d), scale(-1.0, behind)), turned, self.accelerations)
        along = joint.outwards(a)
        carried = matvec(back, add(parent.origin, matvec(parent.U, joint.offset)))
        for index, axis in joint.translations:
            carried = add(carried, cross(scale(2.0, speeds.joint), unit(axis, self.v[index])))
        self.accelerations[first : first + 3] = add(along, scale(-1.0, carried))
        return a, d

    def _write_angles(self, k: int, w_dot: Vec, carried: Vec, accelerations: list[Scalar]) -> None:
        """Write accelerations of the angles, of w_dot of body and parent, in the axes behind beta and alpha."""
        alpha, beta, gamma = self.joints[k].rotations
        (x, y, z), t = w_dot, self.solved[k].inverse_cosine
        # cos(beta) (carried_x + alpha_ddot) = x + sin(beta) carried_z
        accelerations[alpha.index] = (x + beta.sin * carried[2]) * t - carried[0]
        accelerations[beta.index] = y - carried[1]
        accelerations[gamma.index] = z - (beta.sin * x + carried[2]) * t


def about_com(H: PseudoInertia) -> tuple[Vec, Mat]:
    """Return the centre of mass, and the second moments about it."""
    com = scale(inverse_or_zero(H.mass), H.first)
    return com, symmetric(less(H.second, com, H.first))


def bodies_apart(model: Model, bound: Bound, *, alone: bool = False, coupled: Container[int] = ()) -> list[bool]:
    """Find the bodies behind six coordinates whose children, all of that kind too, hand on no mass."""
    free, prescribed = [False] * len(model.bodies), frozenset(model.prescribed)
    for k in range(len(model.bodies) - 1, -1, -1):
        body = model.bodies[k]
        armature = bound.armature[body.first : body.first + len(body.active)]
        light = (
            body.active == COORDINATES and prescribed.isdisjoint(body.indices) and all(is_zero(c) for c in armature[:3])
        )
        bare = all(is_zero(c) for c in armature[3:]) or not (alone or _flat(bound.bodies[k].inertia))
        apart = not any(i in coupled for i in body.indices) and bound.bodies[k].modal is None
        free[k] = light and bare and apart and all(free[child] for child in model.children(k))
    return free


def _flat(H: PseudoInertia) -> bool:
    """Whether plain numbers say that a body does not resist every turn about its centre of mass: a rod, a point."""
    inertia = inertia_tensor(about_com(H)[1])
    _, determinant = inverse3(inertia)
    return isinstance(determinant, float) and determinant <= SINGULAR * diagonal_product(inertia)
