"""Figures of the analyses about a state; vector graphics by the file's ending, in the style of ``style``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.compliance import ComplianceMap
from ..analysis.frequency import Response
from ..analysis.modal_result import Modes, TrackedModes
from ..analysis.tool_budget import Budget
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..names import show
from .scene import Array, capsules, extent, link_poses, placed
from .style import COLORS, PROGRAM_COLOR, TOOL_COLOR, canvas, literal, set_space

CYCLE = tuple(color for colors in COLORS.values() for color in colors.values())
COLUMNS = 3  # of shapes beside each other
SWING = 0.12  # largest displacement that is drawn, of the robot's size


def plot_tracks(
    tracked: TrackedModes, path: Path | str, *, most: int = 12, times: NDArray[np.float64] | None = None
) -> Path:
    """Natural frequencies and damping ratios of the lowest tracks over the poses, or over their times (P,), s; returns
    the path.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    with canvas(6.4, 4.8, path, f"{tracked.modes[0].robot}: the lowest modes along the path") as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"top": 0.9, "bottom": 0.1, "left": 0.11})
        frequencies, ratios = tracked.values("frequencies"), tracked.values("damping_ratios")
        over = np.arange(len(frequencies)) if times is None else times
        for k in range(min(most, frequencies.shape[1])):
            color = CYCLE[k % len(CYCLE)]
            upper.plot(over, frequencies[:, k], color=color)
            lower.plot(over, 100.0 * ratios[:, k], color=color)
        upper.set_ylabel("natural frequency, Hz")
        lower.set_ylabel("damping ratio, %")
        lower.set_xlabel("pose along the path" if times is None else "time, s")
    return Path(path)


def plot_mode_shapes(modes: Modes, robot: RobotLike, path: Path | str, *, most: int = 6) -> Path:
    """Links as lines in the lowest modes, at rest and displaced to both sides, base axes; returns the path.

    Displacements are those of small motions, enlarged until the largest of a mode is an eighth of the robot's size, so
    that closed loops stay closed; of a complex shape the real part is drawn.

    Args:
        modes: of this robot, from ``modes``.
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: .png, .svg or .pdf.
        most: modes to draw, the lowest ones.

    Raises:
        InputError: the modes are of another robot, or there are none; else as of ``plot_tracks``.
    """
    robot = as_robot(robot)
    if modes.robot != robot.name:
        raise InputError(f"modes: are of robot {show(modes.robot)}; allowed: those of {show(robot.name)}")
    shown = min(most, len(modes.eigenvalues))
    if shown < 1:
        raise InputError(f"modes: there are none to draw of {show(robot.name)}; allowed: one or more")
    lines = [(capsule.link, np.stack([capsule.begin, capsule.end])) for capsule in capsules(robot)]
    slides = [joint for joint in robot.joints if joint.type == "prismatic"]  # between their links there is no capsule

    def drawn(q: Array) -> Array:
        """Ends of all lines, (lines, 2, 3), m."""
        poses = link_poses(robot, modes.coordinates, q)
        ends = [line @ poses[link][:3, :3].T + poses[link][:3, 3] for link, line in lines]
        for joint in slides:
            begin = poses[joint.parent] @ placed(joint.placement)
            ends.append(np.stack([begin[:3, 3], poses[joint.child][:3, 3]]))
        return np.array(ends)

    rest, size = drawn(modes.q), extent(robot)
    rows = -(-shown // COLUMNS)
    with canvas(7.4, 0.3 + 2.2 * rows, path, f"{modes.robot}: shapes of the lowest modes") as figure:
        for k in range(shown):
            shape = modes.shapes[k].real
            step = 1e-6 / max(float(np.abs(shape).max()), 1e-300)
            moved = (drawn(modes.q + step * shape) - drawn(modes.q - step * shape)) / (2.0 * step)
            moved *= SWING * size / max(float(np.linalg.norm(moved, axis=-1).max()), 1e-300)
            axes = figure.add_subplot(rows, COLUMNS, k + 1, projection="3d")
            moves = np.abs(moved).max(axis=(1, 2)) > 0.0
            _draw_lines(axes, rest, PROGRAM_COLOR, 0.8)
            _draw_lines(axes, (rest - moved)[moves], CYCLE[3], 0.8)
            _draw_lines(axes, (rest + moved)[moves], CYCLE[0], 1.4)
            set_space(axes, rest, 0.55, 1.4, (22.0, -58.0))
            axes.set_axis_off()
            axes.set_title(f"{k + 1}: {modes.frequencies[k]:.4g} Hz", y=0.98)
        figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=1.0 - 0.35 / figure.get_figheight(), wspace=0.0)
    return Path(path)


def _draw_lines(axes: Any, ends: Array, color: str, width: float) -> None:
    for line in ends:
        axes.plot(*line.T, color=color, linewidth=width)


def plot_response(response: Response, path: Path | str, *, most: int = len(CYCLE)) -> Path:
    """Size and phase of the largest responses over frequency; returns the path, errors as of ``plot_tracks``."""
    pairs = [(y, x) for y in response.outputs for x in response.inputs if np.abs(response.of(y, x)).max() > 0.0]
    pairs = sorted(pairs, key=lambda pair: -float(np.abs(response.of(*pair)).max()))[:most]
    with canvas(6.4, 4.8, path, f"{response.robot}: frequency response") as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"top": 0.9, "bottom": 0.1, "left": 0.13})
        for k, (y, x) in enumerate(pairs):
            H, color = response.of(y, x), CYCLE[k % len(CYCLE)]
            upper.plot(
                response.frequencies, np.abs(H), color=color, label=literal(f"{y} from {x}, {response.unit(y, x)}")
            )
            lower.plot(response.frequencies, np.degrees(np.angle(H)), color=color)
        if pairs:
            upper.set_yscale("log")
            upper.legend(loc="lower left")
        if (response.frequencies > 0.0).all():
            lower.set_xscale("log")
        upper.set_ylabel(response.kind + " per input")
        lower.set_ylabel("phase, deg")
        lower.set_yticks([-180, -90, 0, 90, 180])
        lower.set_xlabel("frequency, Hz")
    return Path(path)


def plot_budget(budget: Budget, path: Path | str, *, most: int = 6) -> Path:
    """The largest contributions to the displacement over time; returns the path, errors as of ``plot_tracks``."""
    rows = budget.table()[:-1][:most]
    with canvas(6.4, 3.8, path, f"{budget.robot}: contributions to the displacement of {budget.frame}") as figure:
        axes = figure.add_axes((0.11, 0.13, 0.86, 0.74))
        axes.plot(
            budget.t,
            1e6 * np.linalg.norm(budget.deviation[:, :3], axis=1),
            color=TOOL_COLOR,
            label=literal(budget.frame),
        )
        for k, row in enumerate(rows):
            contribution = budget.contributions[:, budget.coordinates.index(row.name), :3]
            axes.plot(
                budget.t,
                1e6 * np.linalg.norm(contribution, axis=1),
                color=CYCLE[k % len(CYCLE)],
                label=literal(row.name),
            )
        rest = 1e6 * np.linalg.norm(budget.remainder[:, :3], axis=1)
        axes.plot(budget.t, rest, color=PROGRAM_COLOR, linestyle="--", label="remainder of second order")
        axes.set_xlabel("time, s")
        axes.set_ylabel("displacement, um")
        axes.legend(ncols=2)
    return Path(path)


def plot_compliance(compliance: ComplianceMap, path: Path | str) -> Path:
    """The compliance in the softest direction over the plane; returns the path, errors as of ``plot_tracks``."""
    with canvas(5.6, 4.4, path, f"{compliance.robot}: static compliance of {compliance.frame}") as figure:
        axes = figure.add_axes((0.12, 0.12, 0.74, 0.76))
        corner, last = compliance.points[0, 0], compliance.points[-1, -1]
        edges = compliance.points[-1, 0] - corner, compliance.points[0, -1] - corner
        first = edges[0] / np.linalg.norm(edges[0])
        second = edges[1] - (edges[1] @ first) * first  # square axes in the plane
        second /= np.linalg.norm(second)
        across = (compliance.points - corner) @ np.stack([first, second], axis=1)
        drawn = axes.pcolormesh(
            across[..., 0], across[..., 1], 1e6 * compliance.softest, shading="nearest", cmap="viridis", rasterized=True
        )
        axes.set_aspect("equal")
        axes.set_xlabel(f"from {_place(corner)} along {_place(edges[0])}, m")
        axes.set_ylabel(f"towards {_place(last)}, m")
        figure.colorbar(drawn, ax=axes, label="compliance in the softest direction, um/N")
    return Path(path)


def _place(point: Any) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in point) + ")"
