"""Parameters of all links that base parameters leave possible: those of bodies, as near to the drawing as they allow.

A body has mass everywhere or nowhere: its pseudo-inertia H is positive definite (P. Wensing, S. Kim, J.-J. Slotine
2018).  Among such parameters those are sought that minimise

    1/2 (B theta - beta)^T W (B theta - beta) + sum_k (tr(H0^-1 H) - log det H) / s^2,

the measured values beta weighted by their inverse variances, and the divergence of every link from the drawing's H0,
which is about half of its relative change squared, and infinite where H is no body's.  Armatures and friction are
positive, too, and count as bodies of one number; where they stand alone among base parameters, it is the measured
number that they are near to.  It is convex: Newton's method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..names import component_name, joint_of, kind_of, split_component
from ..robot.coordinates import is_mode
from ..robot.model import build_model
from ..robot.value import MOTOR, Coordinate, Friction, Joint, Link, LinkModes, Motor, Robot
from ..robot.value.modes import DIAGONALS
from .geometry.rotations import pose_from, pose_of
from .identifiable import BaseParameters

INERTIAL = ("m", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
THINNEST = 1e-4  # of the greatest number of its kind: what the drawing has at least of each
SPRINGS = ("stiffness", "damping")  # of transmissions and modes
WEAK = 1e-6  # of offsets: no drawing has them
SURE = 1e-5  # of a base value: the least standard deviation that counts
STEPS, ENOUGH = 200, 1e-10  # of Newton's method: most of them, and the decrement that ends it


def _units() -> Array:
    """Return derivatives of H by the ten numbers, (10, 4, 4); J = 1/2 tr(I) 1 - I."""
    units = np.zeros((10, 4, 4))
    units[0, 3, 3] = 1.0
    for i in range(3):
        units[1 + i, i, 3] = units[1 + i, 3, i] = 1.0
    for place, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), 4):
        inertia = np.zeros((3, 3))
        inertia[i, j] = inertia[j, i] = 1.0
        units[place, :3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return units


UNITS = _units()


def pseudo_inertias(links: Array) -> Array:
    """Return H, (k, 4, 4), of ten numbers per link, (k, 10)."""
    return np.asarray(np.einsum("ki,iab->kab", links, UNITS))


def numbers_of(H: Array) -> Array:
    """Return ten numbers per link, (k, 10), of H, (k, 4, 4)."""
    J = H[:, :3, :3]
    inertia = np.trace(J, axis1=1, axis2=2)[:, None, None] * np.eye(3) - J
    upper = np.triu_indices(3)
    return np.concatenate([H[:, 3, 3:], H[:, :3, 3], inertia[:, upper[0], upper[1]]], axis=1)


class Bodies:
    """The divergence of parameters from the drawing's: value, slope and curvature.

    Attributes:
        drawn: the drawing's parameters, (p,); thin links are made a little thicker, those without mass get some.
    """

    def __init__(self, names: tuple[str, ...], drawn: Array, size: float) -> None:
        """Prepare the divergence from a drawing.

        Args:
            names: of the parameters.
            drawn: the drawing's, (p,).
            size: of measured values, which links without mass in the drawing have about.
        """
        kinds = [name.rpartition(".")[2] for name in names]
        links = [i for i, kind in enumerate(kinds) if kind in INERTIAL]
        self.links = np.array(links, dtype=np.intp).reshape(-1, 10)
        self.free = np.array([kind == "offset" for kind in kinds], dtype=np.bool_)
        self.single = np.setdiff1d(np.flatnonzero(~self.free), self.links)
        self.drawn: Array = np.array(drawn)
        H = pseudo_inertias(self.drawn[self.links])
        H[np.trace(H, axis1=1, axis2=2) < THINNEST * size] = size * np.diag([0.01, 0.01, 0.01, 1.0])
        values, axes = np.linalg.eigh(H)
        values = np.maximum(values, THINNEST * max(float(values.max(initial=0.0)), 1e-6))
        self.drawn[self.links] = numbers_of(np.einsum("kai,ki,kbi->kab", axes, values, axes))
        self.inverse: Array = np.einsum("kai,ki,kbi->kab", axes, 1.0 / values, axes)
        for kind in {kinds[i] for i in self.single}:
            of_kind = [i for i in self.single if kinds[i] == kind]
            self.drawn[of_kind] = np.maximum(self.drawn[of_kind], max(0.1 * float(self.drawn[of_kind].max()), THINNEST))

    def value(self, theta: Array) -> float:
        """Return the divergence, infinite where parameters are no body's."""
        H, ratio = pseudo_inertias(theta[self.links]), theta[self.single] / self.drawn[self.single]
        if (ratio <= 0.0).any() or (np.linalg.eigvalsh(H) <= 0.0).any():
            return np.inf
        of_links = np.einsum("kab,kba->", self.inverse, H) - np.linalg.slogdet(H)[1].sum()
        return float(of_links + (ratio - np.log(ratio)).sum() + 0.5 * WEAK * (theta[self.free] ** 2).sum())

    def slopes(self, theta: Array) -> tuple[Array, Array]:
        """Return gradient, (p,), and Hessian, (p, p)."""
        slope, curvature = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
        for places, inverse in zip(self.links, self.inverse, strict=True):
            current = np.linalg.inv(pseudo_inertias(theta[places][None])[0])
            turned = np.einsum("ab,ibc->iac", current, UNITS)
            slope[places] = np.einsum("ab,iba->i", inverse - current, UNITS)
            curvature[np.ix_(places, places)] = np.einsum("iab,jba->ij", turned, turned)
        slope[self.single] = 1.0 / self.drawn[self.single] - 1.0 / theta[self.single]
        curvature[self.single, self.single] = 1.0 / theta[self.single] ** 2
        slope[self.free], curvature[self.free, self.free] = WEAK * theta[self.free], WEAK
        return slope, curvature


def doubt(base: BaseParameters, values: Array) -> Array:
    """Return the least doubt of base values, (b,), so that exact ones leave Newton's method some digits."""
    return SURE * np.maximum(np.abs(values), 1e-3 * largest(base, values))


def largest(base: BaseParameters, values: Array) -> float:
    """Return the greatest base value, stiffness and damping aside, which have sizes of their own."""
    kinds = [base.parameters[place].rpartition(".")[2] for place in base.chosen]
    others = [abs(x) for x, kind in zip(values.tolist(), kinds, strict=True) if kind not in SPRINGS]
    return float(max(others or np.abs(values)))


def nearest_bodies(base: BaseParameters, values: Array, covariance: Array, drawn: Array, spread: float) -> Array:
    """Return parameters of bodies, (p,), that fit base values and are near to the drawing's.

    Args:
        base: the combinations.
        values: of these, (b,).
        covariance: of these, (b, b).
        drawn: the drawing's parameters, (p,).
        spread: how far they are off, relative to themselves.
    """
    information = np.linalg.inv(covariance + np.diag(doubt(base, values) ** 2))
    alone = np.count_nonzero(base.matrix, axis=1) == 1
    near = drawn.copy()
    for place, value in zip(base.chosen[alone], values[alone], strict=True):
        if base.parameters[place].rpartition(".")[2] not in INERTIAL and value > 0.0:
            near[place] = value
    bodies, share = Bodies(base.parameters, near, largest(base, values)), 1.0 / spread**2
    theta = bodies.drawn.copy()
    normal = base.matrix.T @ information @ base.matrix

    def cost(x: Array) -> float:
        off = base.matrix @ x - values
        return float(0.5 * off @ information @ off) + share * bodies.value(x)

    now = cost(theta)
    for _ in range(STEPS):
        slope, curvature = bodies.slopes(theta)
        slope = share * slope + base.matrix.T @ (information @ (base.matrix @ theta - values))
        whole = normal + share * curvature
        size = 1.0 / np.sqrt(np.diagonal(whole))
        # what exact values leave to the drawing alone may be less than round-off: no step that way
        step = -size * np.linalg.lstsq(whole * np.outer(size, size), size * slope, rcond=None)[0]
        fall, length = float(-slope @ step), 1.0
        while length > 1e-12 and not (new := cost(theta + length * step)) <= now - 0.1 * length * fall:
            length *= 0.5
        if length <= 1e-12 or fall <= ENOUGH:
            break
        theta, now = theta + length * step, new
    return np.asarray(theta)


def with_parameters(robot: Robot, theta: Mapping[str, float]) -> Robot:
    """Return the robot with parameters of links, rotors and friction in the place of its values, by their names.

    A link that others are fixed to gets all that moves with it, and these have no mass then.  Of what is fixed to a
    node of a link that bends, the first link gets it.
    """
    model = build_model(robot)
    links: dict[str, Link] = {}
    for body in model.bodies:
        if f"{body.name}.m" in theta:
            links |= {name: Link(name, 0.0, (0.0,) * 3, (0.0,) * 6) for name in body.links}
            owner, numbers = body.name, np.array([theta[f"{body.name}.{key}"] for key in INERTIAL])
            if owner in robot.nodes:
                owner = carried_by(robot, body.links)
                numbers = numbers_of(_seen_from(robot, owner, body.name, pseudo_inertias(numbers[None])))[0]
            links[owner] = _link(owner, numbers)
    links |= {x.name: replace(x, modes=_modes(x, theta)) for x in robot.links if x.modes is not None}
    joints = [_joint(joint, theta) for joint in robot.joints]
    return replace(robot, links=tuple(links.get(x.name, x) for x in robot.links), joints=tuple(joints))


def carried_by(robot: Robot, links: Sequence[str]) -> str:
    """Return the first of a body's links that is no node, which has what was identified of all of them."""
    return next((name for name in links if name not in robot.nodes), links[0])


def _seen_from(robot: Robot, link: str, body: str, H: Array) -> Array:
    """Return pseudo-inertias, (k, 4, 4), of a body's frame in that of a link that is fixed to it."""
    above, pose = {joint.child: joint for joint in robot.joints}, np.eye(4)
    while link != body:
        joint = above[link]
        turn, offset = np.eye(4), np.array([x or 0.0 for x in joint.offset])
        turn[:3, :3] = np.array(joint.axis_turn)
        pose = pose_of(joint.placement.rotation, joint.placement.xyz) @ turn @ pose_from(offset) @ turn.T @ pose
        link = joint.parent
    back = np.linalg.inv(pose)
    return np.asarray(back @ H @ back.T)


def _modes(link: Link, theta: Mapping[str, float]) -> LinkModes:
    """Return the modes of a link with the stiffness and damping that were identified."""
    assert link.modes is not None
    changed: dict[str, Any] = {}
    for key, kind in DIAGONALS.items():
        matrix = [list(row) for row in getattr(link.modes, key)]
        for k, name in enumerate(link.modes.names):
            matrix[k][k] = theta.get(component_name(component_name(link.name, name), kind), matrix[k][k])
        changed[key] = tuple(map(tuple, matrix))
    return replace(link.modes, **changed)


def _link(name: str, numbers: Array) -> Link:
    """Return a link with its centre of mass, and the inertia about that."""
    mass, first = float(numbers[0]), numbers[1:4]
    com = first / mass
    xx, xy, xz, yy, yz, zz = numbers[4:]
    x, y, z = com
    moments = (xx - mass * (y * y + z * z), yy - mass * (x * x + z * z), zz - mass * (x * x + y * y))
    across = (xy + mass * x * y, xz + mass * x * z, yz + mass * y * z)
    a, b, c, d, e, f = (float(value) for value in (*moments, *across))
    return Link(name, mass, (float(x), float(y), float(z)), (a, b, c, d, e, f))


def _joint(joint: Joint, theta: Mapping[str, float]) -> Joint:
    """Return a joint with the numbers of its coordinates and its motor."""
    by_kind: dict[str, dict[str, Any]] = {}
    for name, value in theta.items():
        coordinate, key = split_component(name)
        if joint_of(coordinate) == joint.name and not is_mode(coordinate):
            by_kind.setdefault(kind_of(coordinate), {})[key] = value
    motor = joint.motor
    if motor is not None and MOTOR in by_kind:
        motor = _motor(motor, by_kind.pop(MOTOR))
    moved = {kind: _coordinate(joint.coordinates[kind], values) for kind, values in by_kind.items()}
    return replace(joint, coordinates={**joint.coordinates, **moved}, motor=motor)


def _motor(motor: Motor, values: Mapping[str, float]) -> Motor:
    """Return a motor with its rotor's inertia and friction, and its transmission's stiffness and damping."""
    friction, spring = motor.friction, motor.transmission
    if "dry" in values or "viscous" in values:
        old = friction or Friction()
        friction = _friction(old, values, values.get("viscous", old.viscous))
    spring_law: dict[str, Any] = {key: values[key] for key in ("stiffness", "damping") if key in values}
    inertia = values.get("inertia", motor.inertia)
    return replace(motor, inertia=inertia, friction=friction, transmission=replace(spring, **spring_law))


def _friction(old: Friction, values: Mapping[str, float], viscous: float | None) -> Friction:
    """Return identified Coulomb friction in the place of an old one, with Stribeck's where that was identified."""
    coulomb = values.get("dry", old.coulomb)
    bristles = {key: getattr(old, key) for key in ("bristle_stiffness", "bristle_damping", "fade")}
    if "breakaway" not in values:
        if old.bristle_stiffness is not None:
            return Friction(coulomb=coulomb, viscous=viscous, **bristles)
        return Friction(coulomb=coulomb, viscous=viscous, smoothing=old.smoothing)
    static, shape = coulomb + values["breakaway"], "gaussian" if "gaussian" in values else None
    rate = values["gaussian"] if shape else values["stribeck"]
    return Friction(coulomb=coulomb, static=static, stribeck=rate, viscous=viscous, shape=shape, **bristles)


def _coordinate(coordinate: Coordinate, values: Mapping[str, float]) -> Coordinate:
    """Return a coordinate with its armature, damping, Coulomb friction and preload."""
    more: dict[str, Any] = {}
    for key, name in (("armature", "armature"), ("viscous", "damping"), ("offset", "preload")):
        if key in values:
            more[name] = values[key]
    old = coordinate.friction or Friction()
    viscous = None if "viscous" in values else old.viscous
    if "dry" in values:
        more["friction"] = _friction(old, values, viscous)
    elif coordinate.friction:
        more["friction"] = replace(coordinate.friction, viscous=viscous)
    return replace(coordinate, **more)
