"""Draw the picture of README.md, docs/picture.svg: python docs/picture.py (make picture)."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.pictures.scene import capsule_mesh, capsules, exaggerated, link_poses
from eomgen.pictures.style import COLORS, PROGRAM_COLOR, TOOL_COLOR, canvas, mark_end, set_space

TARGET = Path(__file__).parent / "picture.svg"
ROBOT, DURATION = "puma560_elastic", 0.5  # s
FACTOR = 500.0  # by which the deviations of the joints are exaggerated
LINK_COLOR = "#0072b2"
LIGHT = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)  # from where faces are lit, base frame


def draw(path: Path) -> None:
    """Simulate the elastic PUMA 560; draw it where its tool is furthest from the reference, and the error over time."""
    result = eomgen.simulate(ROBOT, duration=DURATION)
    robot = eomgen.load_robot(ROBOT)
    error = np.linalg.norm(result.tool_deviation, axis=1)
    worst, names = int(error.argmax()), result.trajectory.coordinates
    elastic = exaggerated(result, FACTOR)
    tool = link_poses(robot, names, elastic)[result.tool]
    with canvas(7.4, 3.3, path) as figure:
        axes = figure.add_axes((-0.14, -0.05, 0.54, 1.05), projection="3d")
        seen = [
            _draw_links(axes, robot, names, q[worst], color, alpha)
            for q, color, alpha in ((exaggerated(result, 0.0), PROGRAM_COLOR, 0.25), (elastic, LINK_COLOR, 1.0))
        ]
        axes.plot(*result.program_pose[:, :3, 3].T, color=PROGRAM_COLOR, linestyle="--", linewidth=1.0)
        axes.plot(*tool[:, :3, 3].T, color=TOOL_COLOR)
        set_space(axes, np.concatenate(seen), 0.5, 1.1, (18.0, -62.0), -3.0)
        axes.set_axis_off()
        lines = (
            ("elastic PUMA 560, 36 DOF", "black"),
            (f"deviations of the joints x {FACTOR:g}", LINK_COLOR),
            ("path of the TCP, deviations alike", TOOL_COLOR),
            ("rigid robot, reference trajectory", PROGRAM_COLOR),
        )
        for row, (text, color) in enumerate(lines):
            figure.text(0.215, 0.27 - 0.06 * row, text, color=color, fontweight="normal" if row else "bold")
        _draw_error(figure, result, error)


def _draw_links(axes: Any, robot: eomgen.Robot, names: Any, q: Any, color: str, alpha: float) -> Any:
    """Draw shaded capsules of all links; return their vertices, (V, 3), m."""
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    poses, found = link_poses(robot, names, q), []
    for capsule in capsules(robot):
        vertices, faces = capsule_mesh(capsule.begin, capsule.end, capsule.radius)
        vertices = vertices @ poses[capsule.link][:3, :3].T + poses[capsule.link][:3, 3]
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        shade = 0.62 + 0.38 * np.clip(normals / lengths @ LIGHT, -1.0, 1.0)
        colors = np.hstack([np.array(to_rgb(color)) * shade[:, np.newaxis], np.full((len(faces), 1), alpha)])
        axes.add_collection3d(Poly3DCollection(corners, facecolors=colors, rasterized=True))
        found.append(vertices)
    return np.concatenate(found)


def _draw_error(figure: Any, result: eomgen.SimulationResult, error: Any) -> None:
    """Draw the components of the TCP's error over time, and its length."""
    panel = figure.add_axes((0.57, 0.14, 0.415, 0.72))
    for axis, column in zip("xyz", result.tool_deviation.T, strict=True):
        panel.plot(result.trajectory.t, 1e6 * column, color=COLORS["m"][axis], label=axis)
    panel.plot(result.trajectory.t, 1e6 * error, color=TOOL_COLOR, linewidth=1.6, label="distance")
    panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, handlelength=1.4, borderaxespad=0.0)
    panel.set_xlabel("time, s")
    panel.set_ylabel("TCP error, um")
    panel.set_xlim(0.0, DURATION)
    mark_end(panel, result)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET)
