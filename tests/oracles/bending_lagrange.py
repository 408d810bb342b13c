"""An independent oracle: robots whose links bend, by Lagrange's equations of clouds of particles and complex steps.

A particle of a link is at rho0 + phi_k e_k + 1/2 psi_kl e_k e_l in the link's frame.  Energies are sums over particles,
to the second degree in the modal coordinates and velocities of the particle's own link, as constants H0, P and Q have
them; without psi they are exact.  Frames of links and nodes are products of eq. (3) and its first derivatives; what is
differentiated besides is differentiated by complex steps, exact to round-off.  Of eomgen the description is used alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from eomgen.robot.value import COORDINATES, Coupling, Frame, Joint, LinkModes, Placement, Robot

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Cloud:
    """Particles of a link in its frame.

    mass: (N,), kg.  place: (N, 3), m.  phi: (N, 3, m).  psi: (N, 3, m, m), symmetric in the modes; zeros where
    deflections are linear.
    """

    mass: Array
    place: Array
    phi: Array
    psi: Array

    @classmethod
    def of(cls, mass: float, com: Sequence[float], inertia: Sequence[float]) -> Cloud:
        """Return six particles of a rigid link: pairs about its centre of mass, on its principal axes."""
        xx, yy, zz, xy, xz, yz = inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        seconds, axes = np.linalg.eigh(np.trace(tensor) / 2 * np.eye(3) - tensor)
        arms = axes.T * np.sqrt(3.0 * np.maximum(seconds, 0.0) / mass)[:, None] if mass else np.zeros((3, 3))
        place = np.asarray(com) + np.vstack([arms, -arms])
        return cls(np.full(6, mass / 6), place, np.zeros((6, 3, 0)), np.zeros((6, 3, 0, 0)))

    @property
    def modes(self) -> int:
        """m, the number of modes."""
        return self.phi.shape[2]

    def constants(self) -> tuple[Array, Array, Array]:
        """Return H0 (m, 4, 3), P (m, m, 3, 3) and Q (m, m, 4, 3)."""
        rho0 = np.hstack([self.place, np.ones((len(self.mass), 1))])
        return (
            np.einsum("i,ia,ibk->kab", self.mass, rho0, self.phi),
            np.einsum("i,iak,ibl->klab", self.mass, self.phi, self.phi),
            np.einsum("i,ia,ibkl->klab", self.mass, rho0, self.psi),
        )


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame A, (4, 4), and its derivatives by all coordinates that lead, (n, 4, 4)."""

    A: Complex
    D: Complex

    def times(self, other: Pose) -> Pose:
        """Return the product of both."""
        return Pose(self.A @ other.A, self.D @ other.A + self.A @ other.D)


@dataclass(frozen=True, eq=False)
class Rail:
    """Functions of the place on a beam by which m modes move that, in the axes of the link.

    length: m.  first: (6, m, terms), second: (6, m, m, terms), symmetric in the modes: coefficients of Chebyshev's
    polynomials of 2 s / length - 1.
    """

    length: float
    first: Array
    second: Array

    def at(self, s: Any, e: Complex) -> tuple[Complex, Complex, Complex]:
        """Return the six coordinates, and their derivatives by s, (6,), and by the modes, (6, m)."""
        x = 2.0 * s / self.length - 1.0
        (p, b), (p_s, b_s) = (
            [np.asarray(chebyshev.chebval(x, np.moveaxis(series, -1, 0))) for series in parts]
            for parts in (
                (self.first, self.second),
                [chebyshev.chebder(part, scl=2.0 / self.length, axis=-1) for part in (self.first, self.second)],
            )
        )
        return p @ e + b @ e @ e / 2, p_s @ e + b_s @ e @ e / 2, p + b @ e


class BendingOracle:
    """Equations of motion of a tree whose links bend.

    Args:
        robot: a description in which nodes of links are no links yet: joints stand on links.
        clouds: particles of the links that bend, by their names; of the others they follow from the description.
        nodes: the node on which a joint stands, by the joint's name; others stand on the link's frame.
        names: coordinates in the order of q, those of modes "arm.mode1"; followers of couplings are not among them.
        rails: of joints that slide along their parents, by name.
    """

    def __init__(
        self,
        robot: Robot,
        clouds: Mapping[str, Cloud],
        nodes: Mapping[str, str],
        names: Sequence[str],
        rails: Mapping[str, Rail] | None = None,
    ) -> None:
        self.robot, self.nodes, self.names = robot, dict(nodes), tuple(names)
        self.rails = dict(rails or {})
        self.size = len(self.names)
        self.clouds = {x.name: clouds.get(x.name) or Cloud.of(x.mass, x.com, x.inertia) for x in robot.links}
        own = [f"{x.name}.{kind}" for x in robot.joints for kind in x.coordinates]
        own += [f"{x.name}.mode{k + 1}" for x in robot.links for k in range(self.clouds[x.name].modes)]
        self._every = {name: i for i, name in enumerate(own)}
        self._S, self._shift = _reduction(self._every, robot.couplings, self.names)

    def mass_matrix(self, q: Array) -> Array:
        """Return M, (n, n)."""
        return self._mass_matrix(np.asarray(q, complex)).real

    def bias_force(self, q: Array, v: Array) -> Array:
        """Return Coriolis and centrifugal terms, (n,)."""
        return self._inertial(np.asarray(q), np.asarray(v), np.zeros(self.size))

    def residual(self, q: Array, v: Array, a: Array, u: Array) -> Array:
        """Return M a + bias less what acts, (n,), N or N m."""
        q, v = np.asarray(q), np.asarray(v)
        slope = np.array([self._potential(q + 1j * STEP * e).imag for e in np.eye(self.size)]) / STEP
        return self._inertial(q, v, np.asarray(a)) + slope + self.dampers @ v - np.asarray(u)

    def energy(self, q: Array, v: Array) -> tuple[float, float]:
        """Return the kinetic and the potential energy, J; that of gravity is zero at the base's origin."""
        return float(v @ self.mass_matrix(q) @ v) / 2, float(self._potential(np.asarray(q, complex)).real)

    def pose(self, frame: Frame, q: Array, node: str | None = None) -> Array:
        """Return a frame of a link, or of a node of it, in the base, (4, 4)."""
        return self._frame(frame, np.asarray(q, complex), node).A.real

    def jacobian(self, frame: Frame, q: Array, node: str | None = None) -> Array:
        """Return linear and angular velocities of a frame by the rates, base axes, (6, n)."""
        return self._jacobian(frame, np.asarray(q, complex), node).real

    def acceleration(self, frame: Frame, s: tuple[Array, Array, Array], node: str | None = None) -> Array:
        """Return linear and angular acceleration of a frame in a state (q, v, a), base axes, (6,)."""
        q, v, a = s
        h = 1j * STEP
        moved: Array = (self._jacobian(frame, q + h * v, node) @ (v + h * a)).imag / STEP
        return moved

    def mass_matrix_rate(self, q: Array, v: Array) -> Array:
        """Return dM/dt, (n, n)."""
        return self._mass_matrix(q + 1j * STEP * v).imag / STEP

    def momentum(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the centre of mass, the linear momentum, and the angular one about it, base axes, (3,) each."""
        com, linear, angular = (x.real for x in self._momenta(np.asarray(q, complex), v))
        return com, linear, angular - np.cross(com, linear)

    def ground_wrench(self, q: Array, v: Array, a: Array) -> Array:
        """Return force and moment about the base's origin that the ground gives a moving robot, base axes, (6,)."""
        h = 1j * STEP
        com, _, _ = self._momenta(np.asarray(q, complex), v)
        _, linear, angular = (x.imag / STEP for x in self._momenta(q + h * v, v + h * a))
        weight = sum(cloud.mass.sum() for cloud in self.clouds.values()) * np.asarray(self.robot.gravity)
        return np.concatenate([linear - weight, angular - np.cross(com.real, weight)])

    def _momenta(self, q: Complex, v: Any) -> tuple[Complex, Complex, Complex]:
        """Return the centre of mass, the linear momentum, and the angular one about the base's origin."""
        first, linear, angular = np.zeros((3, 3), complex)
        for mass, x, rates in self._particles(q):
            x_dot = [np.tensordot(v, part, 1) for part in rates]
            first = first + mass @ sum(x)
            linear = linear + mass @ sum(x_dot)
            for i in range(3):
                angular = angular + sum(mass @ np.cross(x[i], x_dot[j]) for j in range(3 - i))
        return first / sum(cloud.mass.sum() for cloud in self.clouds.values()), linear, angular

    def christoffel(self, q: Array) -> Array:
        """Return Christoffel symbols of the first kind, C_s,vw, (n, n, n)."""
        by = np.array([self.mass_matrix_rate(q, e) for e in np.eye(self.size)])  # [w, s, v]
        symbols: Array = (by.transpose(1, 2, 0) + by.transpose(1, 0, 2) - by) / 2
        return symbols

    def _frame(self, frame: Frame, q: Complex, node: str | None) -> Pose:
        at = self._poses(q)[frame.link]
        at = at if node is None else self._node(at, frame.link, node, q)
        return at.times(self._still(_placed(frame.placement)))

    def _jacobian(self, frame: Frame, q: Complex, node: str | None) -> Complex:
        at = self._frame(frame, q, node)
        turning = at.D[:, :3, :3] @ at.A[:3, :3].T
        return np.vstack([at.D[:, :3, 3].T, turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]])

    def _inertial(self, q: Array, v: Array, a: Array) -> Array:
        """Return d/dt dT/dv - dT/dq."""
        h = 1j * STEP
        grown = (self._mass_matrix(q + h * v) @ (v + h * a)).imag
        slopes = np.array([(v @ self._mass_matrix(q + h * e) @ v).imag for e in np.eye(self.size)])
        inertial: Array = (grown - slopes / 2) / STEP
        return inertial

    def _mass_matrix(self, q: Complex) -> Complex:
        M = self._S.T * self._armature @ self._S + 0j
        for mass, _, (zeroth, first, second) in self._particles(q):
            for one, other in ((zeroth, zeroth + first + second), (first, zeroth + first), (second, zeroth)):
                M = M + np.einsum("i,pia,ria->pr", mass, one, other)
        return M

    def _potential(self, q: Complex) -> Any:
        every = self._S @ q + self._shift
        potential = every @ self._stiffness @ every / 2
        for mass, parts, _ in self._particles(q):
            potential = potential - mass @ sum(parts) @ np.asarray(self.robot.gravity)
        return potential

    def _particles(self, q: Complex) -> list[tuple[Array, list[Complex], list[Complex]]]:
        """Return of every link masses, places and their derivatives by q, (N,), (N, 3), (n, N, 3), by degree in e."""
        found = []
        for link, at in self._poses(q).items():
            if link == self.robot.base:
                continue
            cloud = self.clouds[link]
            e, e_q = self._modes(link, q)
            bent = cloud.phi @ e, 0.5 * cloud.psi @ e @ e
            rates = np.einsum("iak,kp->pia", cloud.phi, e_q), np.einsum("iakl,l,kp->pia", cloud.psi, e, e_q)
            R, D = at.A[:3, :3], at.D[:, :3, :3]
            places = [cloud.place @ R.T + at.A[:3, 3], *(part @ R.T for part in bent)]
            moves = [np.einsum("pab,ib->pia", D, cloud.place) + at.D[:, None, :3, 3]]
            moves += [np.einsum("pab,ib->pia", D, part) + rate @ R.T for part, rate in zip(bent, rates, strict=True)]
            found.append((cloud.mass, places, moves))
        return found

    def _poses(self, q: Complex) -> dict[str, Pose]:
        poses = {self.robot.base: self._still(np.eye(4))}
        every = self._S @ q + self._shift
        for joint in self.robot.joints:
            at = poses[joint.parent]
            if joint.name in self.nodes:
                at = self._node(at, joint.parent, self.nodes[joint.name], q)
            at = at.times(self._across(joint, every))
            poses[joint.child] = self._bent(joint, at, every, q) if joint.name in self.rails else at
        return poses

    def _bent(self, joint: Joint, at: Pose, every: Complex, q: Complex) -> Pose:
        """Return the place of a joint that slides along a beam as its modes move it."""
        rail = self.rails[joint.name]
        slides, (e, e_q) = self._every[f"{joint.name}.z"], self._modes(joint.parent, q)
        values, by_s, by_e = rail.at(every[slides], e)
        at = at.times(self._still(np.block([[np.array(joint.placement.rotation).T, np.zeros((3, 1))], [0, 0, 0, 1]])))
        slopes = by_s[:, None] * self._S[slides] + by_e @ e_q
        for kind, value, slope in zip(COORDINATES, values, slopes, strict=True):
            at = at.times(_moved(kind, value, slope))
        return at

    def _across(self, joint: Joint, every: Complex) -> Pose:
        turn = np.eye(4)
        turn[:3, :3] = np.array(joint.axis_turn)
        at = self._still(_placed(joint.placement) @ turn)
        for kind in joint.coordinates:
            index = self._every[f"{joint.name}.{kind}"]
            at = at.times(_moved(kind, every[index], self._S[index]))
        return at.times(self._still(turn.T))

    def _node(self, at: Pose, link: str, name: str, q: Complex) -> Pose:
        """Return the frame of a node of a link that is at a pose."""
        (node,) = (x for x in _modes_of(self.robot, link).nodes if x.name == name)
        e, e_q = self._modes(link, q)
        second = np.zeros((6, len(e), len(e)))
        second[:3] = 0.0 if node.Psi is None else np.array(node.Psi)
        slopes = np.array(node.Phi) + second @ e
        values = np.array(node.Phi) @ e + second @ e @ e / 2
        at = at.times(self._still(_placed(Placement(node.place))))
        for kind, value, slope in zip(COORDINATES, values, slopes @ e_q, strict=True):
            at = at.times(_moved(kind, value, slope))
        return at

    def _modes(self, link: str, q: Complex) -> tuple[Complex, Array]:
        """Return modal coordinates of a link, (m,), and their derivatives by q, (m, n)."""
        rows = [self._every[f"{link}.mode{k + 1}"] for k in range(self.clouds[link].modes)]
        return self._S[rows] @ q + self._shift[rows], self._S[rows]

    def _still(self, A: Array) -> Pose:
        return Pose(A + 0j, np.zeros((self.size, 4, 4), complex))

    @cached_property
    def _armature(self) -> Array:
        return self._of_joints("armature")

    @cached_property
    def _stiffness(self) -> Array:
        return self._matrix("stiffness", "K")

    @cached_property
    def springs(self) -> Array:
        """Stiffness of joints and modes by the coordinates, (n, n)."""
        K: Array = self._S.T @ self._stiffness @ self._S
        return K

    @cached_property
    def dampers(self) -> Array:
        """Damping of joints and modes by the coordinates, (n, n)."""
        D: Array = self._S.T @ self._matrix("damping", "D") @ self._S
        return D

    def _of_joints(self, key: str) -> Array:
        values = np.zeros(len(self._every))
        for joint in self.robot.joints:
            for kind, coordinate in joint.coordinates.items():
                values[self._every[f"{joint.name}.{kind}"]] = getattr(coordinate, key) or 0.0
        return values

    def _matrix(self, key: str, modal: str) -> Array:
        """Return a matrix of all coordinates: diagonal of joints, a block of each link's modes."""
        matrix = np.diag(self._of_joints(key))
        for link in self.robot.links:
            if link.modes is not None:
                rows = [self._every[f"{link.name}.mode{k + 1}"] for k in range(link.modes.count)]
                matrix[np.ix_(rows, rows)] = np.array(getattr(link.modes, modal))
        return matrix


def _placed(placement: Placement) -> Array:
    A = np.eye(4)
    A[:3, :3], A[:3, 3] = np.array(placement.rotation), placement.xyz
    return A


def _modes_of(robot: Robot, link: str) -> LinkModes:
    modes = robot.link(link).modes
    assert modes is not None, link
    return modes


def _moved(kind: str, value: Any, slope: Any) -> Pose:
    """Return eq. (3)'s factor of one coordinate, and its derivatives where the coordinate's are ``slope``, (n,)."""
    A, generator = np.eye(4, dtype=complex), np.zeros((4, 4))
    axis = COORDINATES.index(kind) % 3
    if kind in COORDINATES[:3]:
        A[axis, 3], generator[axis, 3] = value, 1.0
    else:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        A[i, i] = A[j, j] = np.cos(value)
        A[j, i], A[i, j] = np.sin(value), -np.sin(value)
        generator[j, i], generator[i, j] = 1.0, -1.0
    return Pose(A, np.asarray(slope)[:, None, None] * (A @ generator))


def _reduction(every: Mapping[str, int], couplings: Sequence[Coupling], names: Sequence[str]) -> tuple[Array, Array]:
    """Return S and c of all coordinates, S q + c, by those that follow no others."""
    R, offsets = np.zeros((len(every),) * 2), np.zeros(len(every))
    followers = {x.of for x in couplings if x.law is None}
    if set(names) != every.keys() - followers:
        raise ValueError(f"the coordinates are {sorted(every.keys() - followers)}, not {sorted(names)}")
    for x in couplings:
        if x.law is None:
            offsets[every[x.of]] = x.offset or 0.0
            for name, ratio in x.to.items():
                R[every[x.of], every[name]] = ratio
    inverse = np.linalg.inv(np.eye(len(every)) - R)
    return inverse[:, [every[name] for name in names]], inverse @ offsets
