"""Physically consistent parameters of all links near to base parameters and to the description.

The pseudo-inertia H of a body is positive definite (P. Wensing, S. Kim, J.-J. Slotine 2018).  Among such parameters
theta those are sought that minimise

    1/2 |W (B theta - beta)|^2 + 1/2 sum_k |F^-1 (H - H0) F^-T|^2 / s^2,

the base values beta weighted by a square root W of their information, and the relative change of every link from the
description's H0 over its spread s, with F F^T = H0, made a little thicker where H0 is thin.  Armatures, friction,
stiffness and damping are positive, and count as bodies of one number.  The problem is convex: clarabel solves it.
W has no weight in directions that the motion does not excite, so that nothing is inverted there.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array, Index, Mask
from ..names import component_name, joint_of, kind_of, split_component
from ..optional import optional_import
from ..robot.coordinates import is_mode
from ..robot.model import build_model
from ..robot.value import MOTOR, Coordinate, Friction, Joint, Link, LinkModes, Motor, Robot
from ..robot.value.modes import DIAGONALS
from .estimating import SOLVED
from .geometry.rotations import pose_from, pose_of
from .identifiable import BaseParameters

INERTIAL = ("m", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
THIN = 5e-3  # of a link's second moments about its centre of mass: by so much they change in thin directions, too
POINT = 0.1  # of the largest square of a radius of gyration: one that a point mass may get
SIZE = 0.1  # m, of a robot of point masses
UNKNOWN = 0.1  # of the largest number of its kind: one that is smaller in the description changes by so much
LEAST = 1e-4  # of these sizes: what remains of a link at least; and of a description's armature or friction
TRUNCATED = 1e-12  # of the greatest singular value of the information: directions below it have no weight
ROUND_OFF = 1e-6  # of coefficients of combinations
OPEN = 1e3  # N or N m, of offsets: no description has them


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


@dataclass(frozen=True)
class Consistent:
    """Physically consistent parameters, (p,), and "converged", or the reason why they are none."""

    theta: Array
    status: str


class Sizes:
    """Units of relative changes: theta = centre + change @ x, where x is about as large as the description's spread.

    Attributes:
        links: places of the ten numbers of each link, (k, 10).
        single: places of numbers that are positive by themselves.
        centre: the description's parameters, (p,).
        change: (p, p).  Ten x of a link are the upper triangle of F^-1 H F^-T by columns, those off its diagonal times
            the root of 2, so that the sum of squares is that of the matrix.
        least: x that remains at least, (p,), in the places of ``single``.
        is_known: whether the description has a size to compare with, (p,).
    """

    def __init__(self, base: BaseParameters, values: Array, deviations: Array, described: Array) -> None:
        """Prepare units, wider for numbers that are measured clearly above 0.

        Args:
            base: the combinations.
            values, deviations: of these and their standard deviations, (b,).
            described: the description's values of the parameters, (p,).
        """
        proven = np.zeros(len(described))
        proven[base.chosen] = np.abs(values) - 2.0 * deviations
        kinds = [name.rpartition(".")[2] for name in base.parameters]
        links = [i for i, kind in enumerate(kinds) if kind in INERTIAL]
        self.links = np.array(links, dtype=np.intp).reshape(-1, 10)
        free = np.array([kind == "offset" for kind in kinds], dtype=np.bool_)
        self.single = np.setdiff1d(np.flatnonzero(~free), self.links)
        self.centre = np.where(free, 0.0, described)
        self.change, self.least, self.is_known = np.diag(np.where(free, OPEN, 1.0)), np.zeros(len(kinds)), ~free
        measured = float(proven[self.links].max(initial=0.0)) or 1.0
        for places, F in zip(self.links, _factors(described[self.links], measured), strict=True):
            units = np.einsum("ac,icd,bd->iab", F, _TRIANGLE, F)
            self.change[np.ix_(places, places)] = numbers_of(units).T
        for kind in {kinds[i] for i in self.single}:
            places = np.array([i for i in self.single if kinds[i] == kind])
            largest = float(np.abs(described[places]).max())
            size = np.maximum(np.abs(described[places]), UNKNOWN * largest if largest else 1.0)
            self.is_known[places] = largest > 0.0
            scale = np.maximum(size, proven[places])
            self.change[places, places] = scale
            self.least[places] = (LEAST - 1.0) * described[places] / scale

    def slack(self, places: Index) -> Array:
        """Return how far a described link is above its bound, (10,), in units of x."""
        own = np.linalg.solve(self.change[np.ix_(places, places)], self.centre[places])
        return np.asarray(own - LEAST * _IDENTITY)

    def deviations(self, base: BaseParameters, spread: float) -> Array:
        """Return how far base values are off in a description with that relative spread, (b,); inf if it has none."""
        off = spread * np.linalg.norm(base.matrix @ self.change, axis=1)
        return np.where((np.abs(base.matrix) > ROUND_OFF)[:, ~self.is_known].any(axis=1), np.inf, off)


def _factors(links: Array, measured: float) -> Array:
    """Return F, (k, 4, 4), of links' ten numbers: F F^T is H, thicker where the link is thin or has no mass.

    Args:
        links: the description's, (k, 10).
        measured: a mass, kg, if the description has none.
    """
    H = pseudo_inertias(links)
    mass = H[:, 3, 3]
    mass = np.where(mass > 0.0, mass, mass.max(initial=0.0) or measured)
    com = H[:, :3, 3] / mass[:, None]
    central = H[:, :3, :3] - mass[:, None, None] * np.einsum("ki,kj->kij", com, com)
    own = np.trace(central, axis1=1, axis2=2) / mass
    robot = float((np.trace(H[:, :3, :3], axis1=1, axis2=2) / mass).max(initial=0.0)) or SIZE**2
    values, axes = np.linalg.eigh(central)
    thickness = mass * np.where(own > ROUND_OFF * robot, THIN * own, POINT * robot)
    F = np.zeros_like(H)
    F[:, :3, :3] = axes * np.sqrt(np.maximum(values, 0.0) + thickness[:, None])[:, None, :]
    F[:, :3, 3], F[:, 3, 3] = com * np.sqrt(mass)[:, None], np.sqrt(mass)
    return F


def _triangle() -> Array:
    """Return symmetric matrices of unit norm, (10, 4, 4): the upper triangle by columns."""
    units = []
    for j in range(4):
        for i in range(j + 1):
            unit = np.zeros((4, 4))
            unit[i, j] = unit[j, i] = 1.0 if i == j else np.sqrt(0.5)
            units.append(unit)
    return np.array(units)


_TRIANGLE = _triangle()
_IDENTITY = np.einsum("iaa->i", _TRIANGLE)


def nearest_bodies(
    base: BaseParameters,
    values: Array,
    root: Array,
    described: Array,
    sizes: Sizes,
    spread: float,
    fixed: Collection[str] = (),
) -> Consistent:
    """Return physically consistent parameters that fit base values and are near to the description's.

    Args:
        base: the combinations.
        values: of these, (b,).
        root: square root of their information, (k, b): root @ (true - values) has variance 1.
        described: the description's parameters, (p,).
        sizes: units of their changes.
        spread: how far they are off, relative to themselves.
        fixed: names of parameters that stay as described.
    """
    free = np.array([name not in fixed for name in base.parameters], dtype=np.bool_)
    start = np.where(free, sizes.centre, described)
    change = sizes.change[:, free]
    # the least |A x - b|^2 + |x|^2 / spread^2 is the least |z - z0|^2 of x = onto @ z: scaled well for any A
    left, singular, right = np.linalg.svd(root @ base.matrix @ change, full_matrices=False)
    kept = singular > TRUNCATED * singular.max(initial=0.0)
    stacked = np.vstack([singular[kept, None] * right[kept], np.eye(change.shape[1]) / spread])
    turned, scale, axes = np.linalg.svd(stacked, full_matrices=False)
    z0 = left[:, kept].T @ (root @ (values - base.matrix @ start)) @ turned[: kept.sum()]
    onto = axes.T / scale
    z, status = _project(z0, onto, sizes, free)
    theta = start + change @ (onto @ z)
    theta[sizes.single] = np.maximum(theta[sizes.single], 0.0)  # at their bounds, but for round-off
    return Consistent(theta, status)


def _project(z0: Array, onto: Array, sizes: Sizes, free: Mask) -> tuple[Array, str]:
    """Return the z nearest to z0 for which x = onto @ z is within bounds, and the status of its search.

    Numbers that are positive by themselves have an x from ``least`` on; of a link X + F^-1 H0 F^-T - LEAST is positive
    semidefinite.
    """
    with optional_import("clarabel", "physically consistent parameters need"):
        import clarabel
    with optional_import("SciPy", "physically consistent parameters need"):
        from scipy.sparse import csc_matrix, eye_array
    rows = np.cumsum(free) - 1
    single = sizes.single[free[sizes.single]]
    order = np.concatenate([rows[single], rows[sizes.links].ravel()])
    slack = np.concatenate([-sizes.least[single], *(sizes.slack(places) for places in sizes.links)])
    cones = [clarabel.NonnegativeConeT(len(single)), *(clarabel.PSDTriangleConeT(4) for _ in sizes.links)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    quadratic = csc_matrix(eye_array(len(z0)))
    found = clarabel.DefaultSolver(quadratic, -z0, csc_matrix(-onto[order]), slack, cones, settings).solve()
    solved = found.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return np.array(found.x), SOLVED if solved else f"physically consistent parameters: {found.status}"


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
