"""The first look at a result in space: which way is up, where it is seen from, how far deviations are exaggerated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..names import kind_of
from ..robot.value import ANGULAR, Robot
from ..simulation.result import SimulationResult
from .scene import Array, axis_points, bent_axes, capsules, extent, link_poses, program_positions
from .shapes import Shape

SHOWN_PART = 0.1  # of the robot's size: what the largest deviation is drawn as at first
SHOWN_ANGLE = 0.5  # rad, likewise
ROUND_OFF = 1e-9  # of the robot's size, or rad: what is smaller is no deviation
TOLERANCE = 1e-6  # likewise of a rigid robot, whose tracking error is what integrators and drives leave
STEP = 0.05  # of the exaggeration's power of ten
MORE = 1.0  # powers of ten that can be added to the first exaggeration
FILLED = 0.8  # share of the window's height and width that is used
SAMPLES = 1000  # of a motion that is framed


@dataclass(frozen=True)
class Camera:
    """position, look_at: points (3,), m; up: (3,), a unit vector; fov: vertical field of view, rad."""

    position: Array
    look_at: Array
    up: Array
    fov: float


def up_of(robot: Robot) -> Array:
    """The direction against gravity, (3,), a unit vector in the base frame; +z where nothing weighs."""
    gravity = np.array(robot.gravity, dtype=np.float64)
    if not gravity.any():
        return np.array([0.0, 0.0, 1.0])
    gravity /= np.abs(gravity).max()
    return np.asarray(0.0 - gravity / np.linalg.norm(gravity))


def drawn_points(robot: Robot, coordinates: Sequence[str], q: ArrayLike, shapes: Sequence[Shape] = ()) -> Array:
    """Points within which the robot is drawn at q (..., n), m or rad: ends of capsules, corners around shapes.

    Of links that bend points of their axes.  They are in the base frame, (..., P, 3), m.
    """
    poses, axes = link_poses(robot, coordinates, q), bent_axes(robot)
    fixed = [(c.link, end) for c in capsules(robot, axes) for end in (c.begin, c.end)]
    for shape in shapes:
        ends = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        fixed += [(shape.link, np.array(corner)) for corner in product(*np.transpose(ends))]
    found = [np.stack([(poses[link] @ np.append(point, 1.0))[..., :3] for link, point in fixed], axis=-2)]
    found += [axis_points(axis, poses, coordinates, q) for axis in axes]
    return np.concatenate(found, axis=-2)


def visible_factor(result: SimulationResult, robot: Robot) -> float:
    """Factor that draws the largest deviation as a tenth of the robot's size, or as 0.5 rad; at least 1.

    It is a whole number of STEPs of a power of ten.  1 where nothing is off but by round-off; motors do not count.
    """
    names, program = result.trajectory.coordinates, program_positions(result)
    off = np.abs(result.trajectory.q - program).max(axis=0)
    rows = _rows(result)
    moved = drawn_points(robot, names, result.trajectory.q[rows]) - drawn_points(robot, names, program[rows])
    place = float(np.linalg.norm(moved, axis=-1).max()) / extent(robot)
    angle = max((float(x) for name, x in zip(names, off, strict=True) if kind_of(name) in ANGULAR), default=0.0)
    if max(place, angle) < (ROUND_OFF if result.deviation_coordinates else TOLERANCE):
        return 1.0
    share = max(place / SHOWN_PART, angle / SHOWN_ANGLE)
    return float(10.0 ** max(STEP * np.floor(-np.log10(share) / STEP), 0.0))


def first_factor(result: SimulationResult, robot: Robot) -> float:
    """Exaggeration that a view begins with: ``visible_factor``, and 1 for a robot whose joints are rigid."""
    return visible_factor(result, robot) if result.deviation_coordinates else 1.0


def largest_power(result: SimulationResult, robot: Robot) -> float:
    """The power of ten up to which deviations can be exaggerated: ten times as far as they are visible."""
    return float(np.log10(visible_factor(result, robot))) + MORE


def framed(points: ArrayLike, up: Array, fov: float, margin: float = 0.0) -> Camera:
    """The camera that sees all points (P, 3), m, in a window that is as wide as high, or wider.

    It looks along the direction in which they spread least, so that plane mechanisms are seen from the front, turned a
    little to the side and upwards.

    Args:
        points: at least one.
        up: a unit vector.
        fov: vertical field of view, rad.
        margin: m, what is drawn around a point.
    """
    places = np.asarray(points, dtype=np.float64)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    spread = np.cov((places - middle).T, bias=True) if len(places) > 1 else np.zeros((3, 3))
    spread += (1e-3 * float(np.trace(spread)) + 1e-12) * np.outer(up, up)  # of two that are the same the level one
    least = np.linalg.eigh(spread)[1][:, 0]
    ahead = least @ up
    least = least * np.sign(ahead if abs(ahead) > 0.1 else least[int(np.abs(least).argmax())])
    side = np.cross(up, least)
    if np.linalg.norm(side) < 0.1:
        side = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
    direction = least + 0.45 * side / np.linalg.norm(side) + 0.45 * up
    direction /= np.linalg.norm(direction)
    right = np.cross(up, direction)
    right /= np.linalg.norm(right)
    across = np.abs((places - middle) @ np.stack([right, np.cross(direction, right)], axis=1)).max(axis=1) + margin
    far = (places - middle) @ direction + margin + across / (FILLED * np.tan(0.5 * fov))
    return Camera(middle + max(float(far.max()), 1e-6) * direction, middle, up, fov)


def motion_points(result: SimulationResult, robot: Robot, factor: float, shapes: Sequence[Shape] = ()) -> Array:
    """``drawn_points`` all along a motion, (P, 3), m: on its program, and with its deviations times a factor."""
    names, program, rows = result.trajectory.coordinates, program_positions(result), _rows(result)
    real = program[rows] + factor * (result.trajectory.q[rows] - program[rows])
    return np.concatenate([drawn_points(robot, names, q, shapes).reshape(-1, 3) for q in (program[rows], real)])


def _rows(result: SimulationResult) -> NDArray[np.intp]:
    """Samples of a motion that stand for all of them."""
    count = result.trajectory.t.size
    return np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).astype(np.intp))
