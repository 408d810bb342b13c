"""Figure of a robot in one pose: meshes or capsules of its links, axes of its joints, springs between points."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..analysis.at_rest import closed
from ..description import RobotLike, as_robot
from ..errors import EomgenWarning, InputError, UnknownNameError
from ..names import nearest, show
from ..pipeline.building import build
from ..pipeline.mechanisms import assembly_kernels
from ..robot.model import build_model
from ..robot.value import Robot
from .scene import Array, Faces, bent_axes, extent, link_poses, placed, spring_lines
from .shapes import meshes_of, urdf_shapes
from .style import PROGRAM_COLOR, TOOL_COLOR, Plotted, set_space, sheet, ticker

LINK_COLORS = ("#999999", "#0072b2", "#d55e00", "#009e73", "#882255", "#cc79a7", "#56b4e9")  # the base, then in turn
SPRING_COLOR = "#117733"
LIGHT = np.array([0.3, -0.5, 0.8])  # from where faces are lit, base frame
FLAT = 0.3  # height by width below which a robot is one in a plane
AXIS_LENGTH = 0.09  # of a joint's axis, of the robot's size
NAMED = 3  # meshes that are missing, in a warning
MOST_FACES = 20_000  # of a mesh that are drawn, evenly chosen


VIEWS: Mapping[str, tuple[float, float] | None] = {  # elevation and azimuth, degrees; None is chosen by the robot
    "oblique": None,
    "side": (0.0, -90.0),
    "back": (0.0, 180.0),
    "front": (0.0, 0.0),
    "top": (90.0, -90.0),
}
ALONG = {"side": "y", "back": "x", "front": "x", "top": "z"}  # the axis of the base that a view looks along


def plot_robot(
    robot: RobotLike,
    path: Path | str | None = None,
    pose: Mapping[str, float] | None = None,
    *,
    view: Literal["oblique", "side", "front", "back", "top"] = "oblique",
    ax: Any = None,
) -> Plotted:
    """Plot the robot at rest in one pose, in the base frame, m.

    Links are the meshes of a URDF, else capsules from their origin to whatever is on them, and those that bend tubes
    along their bent axes; dashes are the z axes of
    joints that move, those that are cut among them, dots frames, broken lines springs between points.  A warning names
    meshes that are missing.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: to write to, .png, .svg or .pdf.
        pose: coordinates by name, m or rad; the others are at home, or where they close loops and keep couplings.
        view: "oblique", which sees a robot in a plane from above; or without perspective along an axis of the base:
            "side" along y, "front" from the tip of x, "back" towards it, "top" from the tip of z.
        ax: axes in space to draw in.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        UnknownNameError: the robot has no such coordinate.
        LoopError: the mechanism cannot be assembled near the pose.
        InputError: the view is another one; or see ``style.sheet``.
    """
    robot = as_robot(robot)
    if view not in VIEWS:
        raise InputError(f"view: {show(view)}{nearest(view, VIEWS)}; allowed: {', '.join(VIEWS)}")
    model = build_model(robot)
    names = model.coordinates
    for name in pose or {}:
        if name not in names:
            raise UnknownNameError(f"pose: {show(name)} is unknown{nearest(name, names)}; allowed: {', '.join(names)}")
    q = np.array([(pose or {}).get(name, home) for name, home in zip(names, model.home, strict=True)])
    if model.constraints:
        kernel = build(robot, kernels=assembly_kernels(robot))
        q = closed(kernel, q, np.isin(names, list(pose or ())))
    poses = link_poses(robot, names, q)
    shapes, notes = urdf_shapes(robot)
    if notes:
        more = f"; and {len(notes) - NAMED} more" if len(notes) > NAMED else ""
        warnings.warn(f"{robot.name}: {'; '.join(notes[:NAMED])}{more}", EomgenWarning, stacklevel=2)
    with sheet(4.2, 4.0, path, robot.name, ax) as drawn:
        [axes] = drawn.panels(1, lambda figure: figure.add_axes((0.02, 0.04, 0.9, 0.88), projection="3d"), (0,))
        bodies = meshes_of(robot, shapes)
        values = {name: np.asarray(x) for name, x in zip(names, q, strict=True)}
        bodies += [(axis.link, *axis.mesh(values)) for axis in bent_axes(robot)]
        points = [_draw_links(axes, robot, poses, bodies), _draw_joints(axes, robot, poses)]
        for ends in spring_lines(robot, poses):
            axes.plot(*ends.T, color=SPRING_COLOR, linewidth=1.4, linestyle=(0, (2, 1)))
            points.append(ends)
        for frame in robot.frames:
            axes.scatter(*poses[frame.name][:3, 3], color=TOOL_COLOR, s=18, depthshade=False, zorder=20)
        _set_view(axes, np.concatenate(points), view)
    return drawn.outcome


def _set_view(axes: Any, points: Array, view: str) -> None:
    """Look at points (P, 3), m, with ticks of which none stands on another."""
    extents = np.ptp(points, axis=0)
    flat = (62.0, -75.0) if extents[2] < FLAT * extents.max() else (22.0, -58.0)
    set_space(
        axes, points, 0.52, 0.95 if view == "oblique" else 1.3, VIEWS[view] or flat, -3.0 if view == "oblique" else 2.0
    )
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(ticker().MaxNLocator(4, steps=[1, 2, 5, 10], prune="both"))
    axes.tick_params(pad=-1.0 if view == "oblique" else 2.0)
    if view != "oblique":
        axes.set_proj_type("ortho")
        name = ALONG[view]
        getattr(axes, f"set_{name}ticks")([])
        getattr(axes, f"set_{name}label")("")


def _draw_links(
    axes: Any, robot: Robot, poses: Mapping[str, Array], bodies: Sequence[tuple[str, Array, Faces]]
) -> Array:
    """Draw shaded meshes of links; returns their vertices (V, 3), m.

    ``bodies``: link, vertices in its frame, m, and faces.
    """
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    light, drawn = LIGHT / np.linalg.norm(LIGHT), []
    for link, vertices, faces in bodies:
        color = np.array(to_rgb(_color(robot, link)))
        vertices = vertices @ poses[link][:3, :3].T + poses[link][:3, 3]
        faces = faces[:: -(-len(faces) // MOST_FACES)]
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
    """The z axis of each joint that moves or is cut, but of nodes, through its origin; returns their ends (P, 3), m."""
    half, ends = AXIS_LENGTH * extent(robot), []
    places = []
    for joint in robot.joints:
        if joint.coordinates and joint.name not in robot.nodes:
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
