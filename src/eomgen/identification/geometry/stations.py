"""A robot as stations: places where six coordinates act, one after the other, for all rows at once.

The first station is the base's placement before the measuring device, then come the joints that have coordinates, then
one for each measured frame, its placement on its link.  Joints without coordinates are constants between stations.  A
prismatic joint moves along its axis before its angles turn what it carries, so that these cannot tilt the axis: a
station in front of it does, and makes the error model complete.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...robot.joint_types import OWN_COORDINATES
from ...robot.value import COORDINATES, Joint, Placement, Robot
from .rotations import pose_from, pose_of


@dataclass(frozen=True)
class Station:
    """Six coordinates behind a constant pose.

    name: that of the joint or frame, "" of the base; parent: index of the station before, -1 of the base.
    before: pose of its axes in those of its parent, (4, 4).  joint: None of the base, of frames and of tilts.
    is_tilt: whether it tilts the first axis of the joint of that name, about the axes ``tilts`` (3, 4 or 5).
    offset: constants that the description adds to the coordinates, (6,).
    mass, com: of the links that hang on it (kg; m, its axes).
    """

    name: str
    parent: int
    before: Array
    joint: Joint | None = None
    offset: Array | None = None
    mass: float = 0.0
    com: Array | None = None
    is_tilt: bool = False
    tilts: tuple[int, ...] = ()

    @property
    def principal(self) -> int | None:
        """Index of the joint's principal coordinate among the six; None where it has none."""
        kind = self.joint.principal if self.joint is not None else ""
        return COORDINATES.index(kind) if kind else None


@dataclass(frozen=True)
class Chain:
    """Stations in an order in which parents come first; ``tools`` has that of every measured frame.

    ``link_pose``: station that a link hangs on and its pose there, by the link's name.  ``cuts``: stations of the two
    frames of every loop.
    """

    stations: tuple[Station, ...]
    tools: Mapping[str, int]
    link_pose: Mapping[str, tuple[int, Array]]
    cuts: tuple[tuple[int, int], ...] = ()

    def ancestors(self, station: int) -> list[int]:
        """Return the station and those before it, from the base on."""
        ancestors = [station]
        while self.stations[ancestors[-1]].parent >= 0:
            ancestors.append(self.stations[ancestors[-1]].parent)
        return ancestors[::-1]

    @property
    def reach(self) -> float:
        """A length that the robot does not exceed, m, but for its translations: all constant ones in a row."""
        steps = (
            float(np.linalg.norm(station.before[:3, 3]))
            for station in self.stations
            if station.joint or station.is_tilt
        )
        return max(sum(steps), 1e-3)


@dataclass(frozen=True)
class Located:
    """Stations in N rows: R (S, N, 3, 3) and p (S, N, 3) behind their coordinates, in the device's axes.

    axes: directions of the six coordinates, (S, N, 6, 3), three translations and three rotations.
    """

    R: Array
    p: Array
    axes: Array


def check_rigid(robot: Robot) -> None:
    """Refuse links that bend.

    Raises:
        InputError: names one.
    """
    for link in robot.links:
        if link.modes is not None:
            raise InputError(
                f"links.{link.name}.modes: errors of poses are known of rigid links alone; allowed: robots whose links"
                " are rigid (Robot.rigid()), and [[beams]], which are chains of segments (fit finds stiffness of modes,"
                " from motions)"
            )


def chain_of(robot: Robot, frames: Mapping[str, tuple[str, Array]]) -> Chain:
    """Return stations of a robot; ``frames`` has link and pose on it, (4, 4), of every measured frame.

    Raises:
        InputError: a link bends; names it.
    """
    check_rigid(robot)
    stations = [Station("", -1, np.eye(4))]
    where: dict[str, tuple[int, Array]] = {robot.base: (0, np.eye(4))}
    for joint in robot.joints:
        parent, pose = where[joint.parent]
        turn = pose_of(joint.axis_turn)
        before = pose @ matrix_of(joint.placement) @ turn
        offset = np.array([value or 0.0 for value in joint.offset])
        if joint.coordinates:
            tilts = _tilts(robot, joint)
            if tilts:
                stations.append(Station(joint.name, parent, before, is_tilt=True, tilts=tilts))
                parent, before = len(stations) - 1, np.eye(4)
            stations.append(Station(joint.name, parent, before, joint, offset))
            where[joint.child] = len(stations) - 1, turn.T
        else:
            where[joint.child] = parent, before @ pose_from(offset) @ turn.T
    stations = _with_masses(robot, stations, where)
    cuts = []
    for loop in robot.loops:
        for side, (link, placement) in enumerate(zip(loop.links, loop.placements, strict=True)):
            parent, on = where[link]
            stations.append(Station(f"loops.{loop.name}.{side}", parent, on @ matrix_of(placement)))
        cuts.append((len(stations) - 2, len(stations) - 1))
    tools = {}
    for name, (link, pose) in frames.items():
        parent, on = where[link]
        tools[name] = len(stations)
        stations.append(Station(name, parent, on @ pose))
    return Chain(tuple(stations), tools, where, tuple(cuts))


def _tilts(robot: Robot, joint: Joint) -> tuple[int, ...]:
    """Return angles that offsets of a joint cannot stand for.

    They would have to come before its first coordinate that moves.

    Of joints of one type that turn about several axes alone where loops show them: in a tree the next joint's
    offsets do the same.
    """
    if joint.slides:
        return (3, 4)
    moving = [c for c in (3, 4, 5) if COORDINATES[c] in joint.coordinates]
    if not robot.loops or OWN_COORDINATES[joint.type] or not moving or len(moving) == 3:
        return ()
    return tuple(c for c in (3, 4, 5) if c > moving[0])


def _with_masses(robot: Robot, stations: Sequence[Station], where: Mapping[str, tuple[int, Array]]) -> list[Station]:
    """Return the stations with mass and centre of mass of what hangs on each, up to the next ones."""
    mass, moment = np.zeros(len(stations)), np.zeros((len(stations), 3))
    for link in robot.links:
        at, pose = where[link.name]
        mass[at] += link.mass
        moment[at] += link.mass * (pose[:3, :3] @ np.array(link.com) + pose[:3, 3])
    return [
        replace(s, mass=float(m), com=d / m if m > 0.0 else np.zeros(3))
        for s, m, d in zip(stations, mass, moment, strict=True)
    ]


def matrix_of(placement: Placement) -> Array:
    """Return a placement as a pose, (4, 4)."""
    return pose_of(placement.rotation, placement.xyz)


def located(chain: Chain, values: Array, bases: Array) -> Located:
    """Return poses of stations by their six coordinates, (N, S, 6), m and rad.

    bases: pose of the base in the device's axes, (N, 4, 4), in front of the base's six coordinates.
    """
    count, many = len(chain.stations), len(values)
    R, p, axes = np.empty((count, many, 3, 3)), np.empty((count, many, 3)), np.empty((count, many, 6, 3))
    sines, cosines = np.sin(values[:, :, 3:]), np.cos(values[:, :, 3:])
    for k, station in enumerate(chain.stations):
        if station.parent < 0:
            turned, origin = bases[:, :3, :3], bases[:, :3, 3]
        else:
            turned = R[station.parent] @ station.before[:3, :3]
            origin = p[station.parent] + R[station.parent] @ station.before[:3, 3]
        ex, ey, ez = turned[:, :, 0], turned[:, :, 1], turned[:, :, 2]
        s, c = sines[:, k, :, np.newaxis], cosines[:, k, :, np.newaxis]
        axes[k, :, :3] = turned.transpose(0, 2, 1)
        p[k] = origin + np.einsum("nij,nj->ni", turned, values[:, k, :3])
        ey, ez = c[:, 0] * ey + s[:, 0] * ez, c[:, 0] * ez - s[:, 0] * ey  # about ex
        axes[k, :, 3], axes[k, :, 4] = ex, ey
        ex, ez = c[:, 1] * ex - s[:, 1] * ez, c[:, 1] * ez + s[:, 1] * ex  # about ey
        axes[k, :, 5] = ez
        R[k, :, :, 0], R[k, :, :, 1], R[k, :, :, 2] = c[:, 2] * ex + s[:, 2] * ey, c[:, 2] * ey - s[:, 2] * ex, ez
    return Located(R, p, axes)


def jacobian(chain: Chain, at: Located, tool: int) -> tuple[list[int], Array]:
    """Return the Jacobian of a station's origin and axes by its coordinates and those of the stations before it.

    Returns:
        indices of these stations, K of them, and (N, 6, K, 6): displacement and small rotation in the device's axes.
    """
    before = chain.ancestors(tool)
    axes = at.axes[before]  # (K, N, 6, 3)
    arm = at.p[tool] - at.p[before]  # (K, N, 3)
    by_place = np.zeros((len(arm[0]), 6, len(before), 6))
    by_place[:, :3, :, :3] = axes[:, :, :3].transpose(1, 3, 0, 2)
    by_place[:, 3:, :, 3:] = axes[:, :, 3:].transpose(1, 3, 0, 2)
    by_place[:, :3, :, 3:] = cross(axes[:, :, 3:], arm[:, :, np.newaxis]).transpose(1, 3, 0, 2)
    return before, by_place


def cross(a: Array, b: Array) -> Array:
    """Return cross products along the last axis; numpy.cross takes several times as long."""
    first = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    second = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    return np.stack([first, second, a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]], axis=-1)


def forces_on(chain: Chain, at: Located, gravity: Array, wrenches: Mapping[int, Array]) -> Array:
    """Return generalized forces of gravity and of loads at the six coordinates of every station, (N, S, 6), N and N m.

    gravity: m/s^2, robot's base frame, (3,).  wrenches: force and moment at the origins of stations, there, (N, 6).
    """
    count, many = len(chain.stations), at.p.shape[1]
    base = at.R[0]
    force, moment = np.zeros((count, many, 3)), np.zeros((count, many, 3))  # moments about the device's origin
    down = base @ gravity
    for k, station in enumerate(chain.stations):
        if station.mass > 0.0 and station.com is not None:
            force[k] = station.mass * down
            moment[k] = cross(at.p[k] + at.R[k] @ station.com, force[k])
    for k, wrench in wrenches.items():
        push = np.einsum("nij,nj->ni", base, wrench[:, :3])
        force[k] += push
        moment[k] += np.einsum("nij,nj->ni", base, wrench[:, 3:]) + cross(at.p[k], push)
    for k in range(count - 1, 0, -1):
        force[chain.stations[k].parent] += force[k]
        moment[chain.stations[k].parent] += moment[k]
    about = moment - cross(at.p, force)
    forces = np.empty((many, count, 6))
    forces[:, :, :3] = np.einsum("snca,sna->nsc", at.axes[:, :, :3], force)
    forces[:, :, 3:] = np.einsum("snca,sna->nsc", at.axes[:, :, 3:], about)
    return forces
