"""Figure of a robot in one pose: capsules along its links, axes of its joints, springs between points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.at_rest import closed
from ..description import RobotLike, as_robot
from ..errors import UnknownNameError
from ..names import nearest, show
from ..pipeline.closing import closing_kernels
from ..pipeline.stages import build
from ..robot.model import build_model
from ..robot.value import Robot
from .scene import Array, capsule_mesh, capsules, extent, link_poses, placed, spring_lines
from .style import PROGRAM_COLOR, TOOL_COLOR, canvas, set_space

LINK_COLORS = ("#999999", "#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9")  # the base, then in turn
SPRING_COLOR = "#117733"
LIGHT = np.array([0.3, -0.5, 0.8])  # from where faces are lit, base axes
FLAT = 0.3  # height by width below which a robot is one in a plane
AXIS_LENGTH = 0.09  # of a joint's axis, of the robot's size


def plot_robot(robot: RobotLike, path: Path | str, pose: Mapping[str, float] | None = None) -> Path:
    """Draw the robot at rest in one pose, in base axes, m; returns the path.

    Links are capsules from their origin to whatever is on them; dashes are the z axes of joints that move, those that
    are cut among them, dots frames, broken lines springs between points.  A robot in a plane is seen from above.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: .png, .svg or .pdf.
        pose: coordinates by name, m or rad; the others are at home, or where they close loops and keep couplings.

    Raises:
        UnknownNameError: the robot has no such coordinate.
        LoopError: the mechanism does not close near the pose.
        InputError: see ``style.canvas``.
    """
    robot = as_robot(robot)
    model = build_model(robot)
    names = model.coordinates
    for name in pose or {}:
        if name not in names:
            raise UnknownNameError(f"pose: {show(name)} is unknown{nearest(name, names)}; allowed: {', '.join(names)}")
    q = np.array([(pose or {}).get(name, home) for name, home in zip(names, model.home, strict=True)])
    if model.constraints:
        kernel = build(robot, kernels=closing_kernels(robot))
        q = closed(kernel, q, np.isin(names, list(pose or ())))
    poses = link_poses(robot, names, q)
    with canvas(4.2, 4.0, path, robot.name) as figure:
        axes = figure.add_axes((0.0, 0.02, 0.96, 0.9), projection="3d")
        points = [_draw_links(axes, robot, poses), _draw_joints(axes, robot, poses)]
        for ends in spring_lines(robot, poses):
            axes.plot(*ends.T, color=SPRING_COLOR, linewidth=1.4, linestyle=(0, (2, 1)))
            points.append(ends)
        for frame in robot.frames:
            axes.scatter(*poses[frame.name][:3, 3], color=TOOL_COLOR, s=18, depthshade=False, zorder=20)
        seen = np.concatenate(points)
        extents = np.ptp(seen, axis=0)
        view = (62.0, -75.0) if extents[2] < FLAT * extents.max() else (22.0, -58.0)
        set_space(axes, seen, 0.52, 0.95, view, -4.0)
    return Path(path)


def _draw_links(axes: Any, robot: Robot, poses: Mapping[str, Array]) -> Array:
    """Shaded capsules; returns their vertices (V, 3), m."""
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    light, drawn = LIGHT / np.linalg.norm(LIGHT), []
    for capsule in capsules(robot):
        color = np.array(to_rgb(_color(robot, capsule.link)))
        vertices, faces = capsule_mesh(capsule.begin, capsule.end, capsule.radius)
        vertices = vertices @ poses[capsule.link][:3, :3].T + poses[capsule.link][:3, 3]
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        shade = 0.62 + 0.38 * np.clip(normals / np.maximum(lengths, 1e-300) @ light, -1.0, 1.0)
        mesh = Poly3DCollection(corners, facecolors=np.clip(color * shade[:, np.newaxis], 0.0, 1.0), rasterized=True)
        axes.add_collection3d(mesh)
        drawn.append(vertices)
    return np.concatenate(drawn)


def _color(robot: Robot, link: str) -> str:
    names = [body.name for body in robot.links]
    return LINK_COLORS[0] if link == robot.base else LINK_COLORS[1 + names.index(link) % (len(LINK_COLORS) - 1)]


def _draw_joints(axes: Any, robot: Robot, poses: Mapping[str, Array]) -> Array:
    """The z axis of every joint with coordinates or cut, through its origin; returns the ends (2 joints, 3), m."""
    half, ends = AXIS_LENGTH * extent(robot), []
    places = []
    for joint in robot.joints:
        if joint.coordinates:
            pose = poses[joint.child]
            places.append((pose[:3, 3], (pose[:3, :3] @ np.array(joint.axis_turn))[:, 2]))
    for loop in robot.loops:
        pose = poses[loop.links[0]] @ placed(loop.placements[0])
        places.append((pose[:3, 3], pose[:3, 2]))
    for origin, axis in places:
        line = np.stack([origin - half * axis, origin + half * axis])
        axes.plot(*line.T, color=PROGRAM_COLOR, linewidth=0.9, zorder=5)
        ends.append(line)
    return np.concatenate(ends)
