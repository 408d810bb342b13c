"""Geometry of a result in space: where links, springs and reactions are at each time; nothing is drawn here.

Links that bend are tubes about their axes, which follow the modes (``BentAxis``).

Poses follow eqs. (1) to (3) in NumPy, so that no kernel is needed for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bending.beams.stations import Stations, circle, stations_of
from ..errors import InputError
from ..identification.tolerances.result import ToleranceResult
from ..kernel.complete import Kernel
from ..names import component_name, show
from ..robot.coordinates import index_of
from ..robot.mechanism import follower_positions
from ..robot.value import COORDINATES, LINEAR, Joint, Placement, Robot, node_link
from ..robot.value.nodes import SLIDING
from ..simulation.result import SimulationResult

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

SLENDER = 0.022  # radius of capsules, of the robot's size
THINNEST = 0.15  # least half thickness of a section that is drawn, of a capsule's radius
RINGS, SECTORS = 6, 20  # of a capsule's mesh: rings of each cap, and around


@dataclass(frozen=True)
class Capsule:
    """The points within ``radius`` (m) of the line from ``begin`` to ``end`` (3,), m, in its link's frame."""

    link: str
    begin: Array
    end: Array
    radius: float


@dataclass(frozen=True, eq=False)
class BentAxis:
    """An axis of a link that bends, with what is drawn around it.

    modes: names of the link's modal coordinates.  outline: of a section, from the axis, link frame, (K, 3), m,
    anticlockwise seen from its tip.  nodes: places of the link's nodes, link frame, m, by the links they are made of.
    """

    link: str
    modes: tuple[str, ...]
    stations: Stations
    outline: Array
    nodes: Mapping[str, tuple[float, ...]]

    def poses(self, values: Mapping[str, Array], shape: tuple[int, ...] = ()) -> Array:
        """Return poses of the sections in the link's frame, (*shape, S, 4, 4), m.

        Args:
            values: coordinates by name, *shape each; modes that are not among them are zero.
            shape: of what is asked for.
        """
        e = np.stack([np.broadcast_to(values.get(name, 0.0), shape) for name in self.modes], axis=-1)
        s = self.stations.coordinates(e)
        poses = _moved(np.moveaxis(s, -1, 0))
        poses[..., :3, 3] += self.stations.places
        return poses

    def mesh(self, values: Mapping[str, Array]) -> tuple[Array, Faces]:
        """Return vertices (V, 3), m, link frame, and triangles (F, 3) of the link as it is bent.

        Rings of vertices follow each other from the root to the tip; both ends come again, for their caps.
        """
        poses = self.poses(values)
        rings = np.einsum("sij,kj->ski", poses[:, :3, :3], self.outline) + poses[:, np.newaxis, :3, 3]
        return np.concatenate([*rings, rings[0], rings[-1]]), tube_faces(len(rings), len(self.outline))


class Region:
    """Region of a frame by tolerances: an ellipsoid around it, over a motion's time."""

    def __init__(self, tolerance: ToleranceResult, robot: str) -> None:
        """Take it from a result.

        Raises:
            InputError: it is of another robot than that of this name, or not along a motion.
        """
        if tolerance.robot != robot:
            raise InputError(f"tolerance: is of robot {show(tolerance.robot)}; allowed: one of {show(robot)}")
        if tolerance.t is None:
            raise InputError("tolerance: is at poses; allowed: one along the motion, tolerance(..., along=result)")
        self.frame, self._t = tolerance.frame, tolerance.t
        self._half, self._turn = tolerance.ellipsoids()

    def at(self, t: float) -> tuple[Array, Array]:
        """Half axes, (3,), m, and a pose, (4, 4), whose rotation has their directions, base frame; nearest in time."""
        k = int(np.abs(self._t - t).argmin())
        return self._half[k], turned(self._turn[k])


def link_poses(robot: Robot, coordinates: Sequence[str], q: ArrayLike) -> dict[str, Array]:
    """Poses of the base, all links and frames in the base, (..., 4, 4), m, by name.

    Args:
        robot: whose offsets count.
        coordinates: n names; those of the robot that are not among them are zero, or where these lead them.
        q: their values, (..., n), m or rad.
    """
    values = np.asarray(q, dtype=np.float64)
    column = {name: values[..., i] for i, name in enumerate(coordinates)}
    column = {**follower_positions(robot, column), **column}
    poses: dict[str, Array] = {robot.base: np.broadcast_to(np.eye(4), (*values.shape[:-1], 4, 4))}
    for joint in robot.joints:
        turn = turned(np.array(joint.axis_turn))
        moved = _motion(joint, column, values.shape[:-1])
        poses[joint.child] = poses[joint.parent] @ placed(joint.placement) @ turn @ moved @ turn.T
    for frame in robot.frames:
        poses[frame.name] = poses[frame.link] @ placed(frame.placement)
    return poses


def turned(rotation: Array) -> Array:
    """Return a rotation as a pose, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return pose


def placed(placement: Placement) -> Array:
    """A placement as a pose, (4, 4), m."""
    pose = turned(np.array(placement.rotation))
    pose[:3, 3] = placement.xyz
    return pose


def _motion(joint: Joint, column: Mapping[str, Array], shape: tuple[int, ...]) -> Array:
    """T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma) of eq. (3), (*shape, 4, 4)."""
    s = np.zeros((len(COORDINATES), *shape))
    for row, (name, offset) in enumerate(zip(COORDINATES, joint.offset, strict=True)):
        s[row] = offset or 0.0
        if name in joint.coordinates:
            s[row] += column.get(component_name(joint.name, name), 0.0)
    return _moved(s)


def _moved(s: Array) -> Array:
    """Poses of six coordinates, (6, ...), m and rad, as eq. (3) has them, (..., 4, 4)."""
    pose = np.zeros((*s.shape[1:], 4, 4))
    pose[..., range(4), range(4)] = 1.0
    pose[..., :3, 3] = np.moveaxis(s[:3], 0, -1)
    for axis, angle in enumerate(s[len(LINEAR) :]):
        turn = np.zeros_like(pose)
        turn[..., range(4), range(4)] = 1.0
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[..., i, i] = turn[..., j, j] = np.cos(angle)
        turn[..., j, i] = np.sin(angle)
        turn[..., i, j] = -turn[..., j, i]
        pose = pose @ turn
    return pose


def program_positions(result: SimulationResult) -> Array:
    """Coordinates of the rigid robot on its program, (T, n), m or rad: deviations and motors are zero.

    Coordinates that loops hold are where they are in reality.
    """
    motion = result.trajectory
    q = np.zeros_like(motion.q)
    driven = index_of(motion.coordinates, result.program_coordinates)
    prescribed = index_of(motion.coordinates, result.prescribed)
    passive = index_of(motion.coordinates, result.passive)
    q[:, driven], q[:, prescribed] = result.program_q, motion.q[:, prescribed]
    q[:, passive] = motion.q[:, passive]
    return q


def exaggerated(result: SimulationResult, factor: float) -> Array:
    """The program plus ``factor`` times what reality is off by, (T, n), m or rad; 1 is reality, 0 the program."""
    program = program_positions(result)
    positions: Array = program + factor * (result.trajectory.q - program)
    return positions


def extent(robot: Robot) -> float:
    """The robot's size, m: the largest distance between any two of its origins and attachments at home."""
    poses = link_poses(robot, tuple(robot.home), np.array(list(robot.home.values())))
    places = [pose[:3, 3] for pose in poses.values()]
    places += [(poses[c.link] @ np.append(end, 1.0))[:3] for c in _lines(robot) for end in (c.begin, c.end)]
    spread = np.ptp(np.array(places), axis=0)
    return float(np.linalg.norm(spread)) or 1.0


def capsules(robot: Robot, axes: Sequence[BentAxis] | None = None) -> tuple[Capsule, ...]:
    """Capsules in the place of links without meshes, the base among them: from a link's origin to each thing on it.

    Things are joints, cut ones too, frames, ends of springs; a link without any gets one to its centre of mass, one on
    which all is at the origin, as on both parts of a telescope, one to twice that: there an even rod would end.  Where
    begin and end are the same a capsule is a ball.  None leads to a node of a link that bends.

    Args:
        robot: whose links count.
        axes: that are drawn of links; by default those of the robot.
    """
    radius = SLENDER * extent(robot)
    bent = bent_axes(robot) if axes is None else axes
    drawn = {(axis.link, tuple(place)) for axis in bent for place in axis.nodes.values() if any(place)}
    hidden = {joint.child for joint in slides_along_beams(robot)}  # they move along the straight beam
    lines = (c for c in _lines(robot) if c.link not in hidden and (c.link, tuple(c.end.tolist())) not in drawn)
    return tuple(Capsule(c.link, c.begin, c.end, radius) for c in lines)


def slides_along_beams(robot: Robot) -> tuple[Joint, ...]:
    """Joints that slide along beams that bend: behind each stands a place that modes move, of the name of its child."""
    return tuple(joint for joint in robot.joints if joint.type == SLIDING and joint.child in robot.nodes)


def bent_axes(robot: Robot) -> tuple[BentAxis, ...]:
    """Axes of links that bend, from their roots to their nodes, with sections as large as they are.

    Sections whose form is not known are round, as capsules are; none is drawn thinner than can be seen.
    """
    radius, found = SLENDER * extent(robot), list[BentAxis]()
    for link in robot.links:
        if link.modes is None:
            continue
        modes = tuple(component_name(link.name, kind) for kind in link.modes.names)
        nodes = {node_link(link.name, node.name): node.place for node in link.modes.nodes}
        for stations in stations_of(link):
            outline = circle(radius) if stations.outline is None else stations.outline
            half = np.abs(outline).max(axis=0)
            seen = outline * np.maximum(half, THINNEST * radius) / half
            found.append(BentAxis(link.name, modes, stations, seen @ stations.axes[:, 1:].T, nodes))
    return tuple(found)


def axis_points(axis: BentAxis, poses: Mapping[str, Array], coordinates: Sequence[str], q: ArrayLike) -> Array:
    """Points of an axis in the base at q (..., n), m or rad, (..., S, 3), m; poses: of links there."""
    values = np.asarray(q, dtype=np.float64)
    column = {name: values[..., i] for i, name in enumerate(coordinates)}
    sections = poses[axis.link][..., np.newaxis, :, :] @ axis.poses(column, values.shape[:-1])
    return sections[..., :3, 3]


def tube_faces(rings: int, around: int) -> Faces:
    """Triangles (F, 3) of ``BentAxis.mesh``, anticlockwise seen from outside."""
    k, ahead = np.arange(around), (np.arange(around) + 1) % around
    faces = []
    for low in range(0, (rings - 1) * around, around):
        high = low + around
        faces.append(np.stack([low + k, low + ahead, high + ahead], axis=1))
        faces.append(np.stack([low + k, high + ahead, high + k], axis=1))
    first, last = rings * around, (rings + 1) * around
    inner, middle, outer = np.zeros(around - 2, dtype=np.intp), k[1:-1], k[2:]
    faces.append(first + np.stack([inner, outer, middle], axis=1))
    faces.append(last + np.stack([inner, middle, outer], axis=1))
    return np.concatenate(faces).astype(np.int32)


def _lines(robot: Robot) -> list[Capsule]:
    ends: dict[str, list[tuple[float, ...]]] = {name: [] for name in (robot.base, *(link.name for link in robot.links))}
    for joint in robot.joints:
        ends[joint.parent].append(joint.placement.xyz)
    for frame in robot.frames:
        ends[frame.link].append(frame.placement.xyz)
    for loop in robot.loops:
        for link, placement in zip(loop.links, loop.placements, strict=True):
            ends[link].append(placement.xyz)
    for element in robot.link_elements:
        for link, point in zip(element.links, element.origins(), strict=True):
            ends[link].append(point)
    for body in robot.links:
        if not any(any(end) for end in ends[body.name]):
            ends[body.name] = [tuple(2.0 * x for x in body.com)] if ends[body.name] else [body.com]
    return [
        Capsule(name, np.zeros(3), np.array(end), 0.0) for name, points in ends.items() for end in dict.fromkeys(points)
    ]


def capsule_mesh(begin: ArrayLike, end: ArrayLike, radius: float) -> tuple[Array, Faces]:
    """Vertices (V, 3), m, and triangles (F, 3), anticlockwise seen from outside, of a capsule."""
    first, last = np.asarray(begin, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(last - first))
    axis = (last - first) / length if length > 1e-12 else np.array([0.0, 0.0, 1.0])
    side = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    up = np.linspace(0.0, 0.5 * np.pi, RINGS + 1)
    around = np.arange(SECTORS) * 2.0 * np.pi / SECTORS
    circle = np.cos(around)[:, np.newaxis] * side + np.sin(around)[:, np.newaxis] * other
    rings = [first + radius * (np.cos(t) * circle - np.sin(t) * axis) for t in up[-2::-1]]
    rings += [last + radius * (np.cos(t) * circle + np.sin(t) * axis) for t in up[:-1]]
    vertices = np.concatenate([*rings, [first - radius * axis], [last + radius * axis]])
    k, ahead = np.arange(SECTORS), (np.arange(SECTORS) + 1) % SECTORS
    faces = []
    for ring in range(len(rings) - 1):
        low, high = ring * SECTORS, (ring + 1) * SECTORS
        faces.append(np.stack([low + k, low + ahead, high + ahead], axis=1))
        faces.append(np.stack([low + k, high + ahead, high + k], axis=1))
    bottom, top = len(vertices) - 2, len(vertices) - 1
    faces.append(np.stack([np.full(SECTORS, bottom), ahead, k], axis=1))
    last_ring = (len(rings) - 1) * SECTORS
    faces.append(np.stack([np.full(SECTORS, top), last_ring + k, last_ring + ahead], axis=1))
    return vertices, np.concatenate(faces).astype(np.int32)


def spring_lines(robot: Robot, poses: Mapping[str, Array]) -> Array:
    """Ends of the force elements between links in the base, (..., elements, 2, 3), m."""
    some = poses[robot.base]
    ends = np.zeros((*some.shape[:-2], len(robot.link_elements), 2, 3))
    for i, element in enumerate(robot.link_elements):
        for j, (link, point) in enumerate(zip(element.links, element.origins(), strict=True)):
            ends[..., i, j, :] = (poses[link] @ np.append(point, 1.0))[..., :3]
    return ends


def quaternions(poses: Array) -> Array:
    """Unit quaternions (w, x, y, z) of the rotations of poses (..., 4, 4), (..., 4), w at least 0."""
    R = poses[..., :3, :3]
    trace = np.trace(R, axis1=-2, axis2=-1)
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    # of w, x, y, z the largest comes from a root, the others from it
    squares = np.concatenate([(1.0 + trace)[..., np.newaxis], 1.0 + 2.0 * diagonal - trace[..., np.newaxis]], axis=-1)
    k = np.zeros((*R.shape[:-2], 4, 4))
    k[..., range(4), range(4)] = squares
    for a, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        k[..., 0, a + 1] = k[..., a + 1, 0] = R[..., j, i] - R[..., i, j]
        k[..., i + 1, j + 1] = k[..., j + 1, i + 1] = R[..., i, j] + R[..., j, i]
    row = np.take_along_axis(k, squares.argmax(axis=-1)[..., np.newaxis, np.newaxis], axis=-2)[..., 0, :]
    unit: Array = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.where(unit[..., :1] < 0.0, -unit, unit)


def accelerations(kernel: Kernel, result: SimulationResult) -> Array:
    """Accelerations, (T, n), m/s^2 or rad/s^2, from drives and wrenches; ``u`` has what moves prescribed coordinates.

    The kernel has ``residual`` and ``mass_matrix``.
    """
    motion = result.trajectory
    left = kernel.residual(motion.q, motion.v, np.zeros_like(motion.q), motion.u, wrench=result.wrench, z=motion.z)
    values: Array = -np.linalg.solve(kernel.mass_matrix(motion.q), left[..., np.newaxis])[..., 0]
    return values


def reaction_forces(kernel: Kernel, robot: Robot, result: SimulationResult) -> Array:
    """Force of each moving joint on its child link in the base frame, (T, joints, 3), N; with a payload as without it.

    The kernel has ``residual``, ``mass_matrix``, ``reactions`` and ``external_reactions``.
    """
    motion = result.trajectory
    wrenches = kernel.reactions(motion.q, motion.v, accelerations(kernel, result), wrench=result.wrench, z=motion.z)
    poses = link_poses(robot, motion.coordinates, motion.q)
    forces = np.zeros((motion.t.size, len(kernel.joints), 3))
    for i, name in enumerate(kernel.joints):
        joint = robot.joint(name)
        axes = poses[joint.child][:, :3, :3] @ np.array(joint.axis_turn)
        forces[:, i] = (axes @ wrenches[:, i, :3, np.newaxis])[..., 0]
    return forces
