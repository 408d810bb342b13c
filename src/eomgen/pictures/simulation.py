"""Figures of a simulation: the tool against its program (Figure 1 of the paper), and every joint's deviations.

Matplotlib is imported when a plot is made, not with this file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..names import component_name, joint_of, kind_of
from ..robot.coordinates import unit_of
from ..simulation.result import SimulationResult
from .energy import plot_energy, plot_tracking
from .journals import plot_journals, result_journals
from .style import COLORS, PROGRAM_COLOR, TOOL_COLOR, canvas, literal, mark_end, panel_grid, scale_of, set_space, ticker

SHOWN_PART = 0.25  # a magnified deviation is about this share of the path's extent
WHISKERS = 25
ACROSS = 3  # panels beside each other
MICRO = 1e6


def plot_result(result: SimulationResult, folder: Path | str, ending: str = ".png") -> list[Path]:
    """Write the figures of a result: ``tool``, ``deviations`` and ``journals`` where the robot has some, ``tracking``
    where there is a program, ``energy`` where there is a balance; returns their paths.

    Args:
        result: of a simulation.
        folder: to write to; made where it does not exist.
        ending: one of FIGURE_ENDINGS.

    Raises:
        InputError: Matplotlib is not installed, the ending is another one, or a file cannot be written.
    """
    target = Path(folder)
    written = [plot_tool(result, target / f"tool{ending}")]
    if result.deviation_coordinates:
        written.append(plot_deviations(result, target / f"deviations{ending}"))
    if result_journals(result):
        written.append(plot_journals(result, target / f"journals{ending}"))
    if result.programmed and result.program_coordinates:
        written.append(plot_tracking(result, target / f"tracking{ending}"))
    if result.balance is not None:
        written.append(plot_energy(result, target / f"energy{ending}"))
    return written


def plot_tool(result: SimulationResult, path: Path | str) -> Path:
    """The tool's path with its deviation magnified, beside those of place and axes over time; returns the path.

    Raises:
        InputError: see ``plot_result``.
    """
    with canvas(7.4, 4.6, path, f"{result.robot}: {result.tool} against its program") as figure:
        grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0), left=0.01, right=0.975, top=0.885, bottom=0.095)
        grid.update(wspace=0.24, hspace=0.18)
        _draw_path(figure.add_subplot(grid[:, 0], projection="3d"), result)
        upper = figure.add_subplot(grid[0, 1])
        middle, lower = (figure.add_subplot(grid[row, 1], sharex=upper) for row in (1, 2))
        _draw_tool_deviation(upper, middle, lower, result)
        figure.align_ylabels()
    return Path(path)


def plot_deviations(result: SimulationResult, path: Path | str) -> Path:
    """Every joint's deviations over time: linear in micrometres and, below, angular in microradians; returns the path.

    Each panel has its scale; three stand side by side.  Joints that are rigid in a unit have none of it.

    Raises:
        InputError: see ``plot_result``, or the robot has no deviations.
    """
    pairs = dict.fromkeys((joint_of(name), unit_of(name)) for name in result.deviation_coordinates)
    joints = {unit: [joint for joint, its in pairs if its == unit] for unit in COLORS}
    if not pairs:
        raise InputError(f"{result.robot} has no deviations to plot")
    across = min(ACROSS, max(map(len, joints.values())))
    drawn = [line for unit, names in joints.items() for line in _rows(names, unit, across)]
    rows = len(drawn)
    width = max(4.4, 2.45 * across)
    colors = _colors(result)
    columns = len(colors) + 1 if width > 6.0 else 3
    head = 0.55 + 0.17 * -(-(len(colors) + 1) // columns)
    height = 1.35 * rows + head + 0.03
    with canvas(width, height, path, f"{result.robot}: deviations in the joints") as figure:
        panels = panel_grid(figure, rows, across, head=head, hspace=0.32, wspace=0.3)
        for row, line in enumerate(drawn):
            for column, panel in enumerate(panels[row]):
                if column >= len(line):
                    panel.set_visible(False)
                    continue
                _draw_joint(panel, result, *line[column])
                last = all(column >= len(below) for below in drawn[row + 1 :])
                panel.tick_params(labelbottom=last)
                panel.set_xlabel("time, s" if last else "")
        _legend(figure, colors, columns)
    return Path(path)


def _rows(joints: Sequence[str], unit: str, across: int) -> list[list[tuple[str, str]]]:
    """Joints and their unit, as many beside each other as there is room for."""
    return [[(joint, unit) for joint in joints[k : k + across]] for k in range(0, len(joints), across)]


def _draw_path(axes: Any, result: SimulationResult) -> None:
    """Program and tool in space; the deviation is drawn magnified, as whiskers from the one to the other."""
    program, deviation = result.program_pose[:, :3, 3], result.tool_deviation
    half = max(0.5 * float(np.ptp(program, axis=0).max()), 1e-3)
    factor = _round_factor(2.0 * half * SHOWN_PART / max(float(np.linalg.norm(deviation, axis=1).max()), 1e-15))
    shown = program + factor * deviation
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(program, axis=0), axis=1))])
    for at in np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], WHISKERS))):
        axes.plot(*np.stack([program[at], shown[at]]).T, color=TOOL_COLOR, linewidth=0.5, alpha=0.6)
    axes.plot(*program.T, color=PROGRAM_COLOR, linestyle="--", label="program (rigid robot)")
    axes.plot(*shown.T, color=TOOL_COLOR, label=f"tool, deviation x {factor:g}")
    axes.scatter(*program[0], color=PROGRAM_COLOR, s=14, marker="o", label="start", depthshade=False)
    axes.scatter(*program[-1], color=PROGRAM_COLOR, s=18, marker="s", label="goal", depthshade=False)
    set_space(axes, np.concatenate([program, shown]), 0.52, 0.98, (24.0, -52.0), -3.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(ticker().MaxNLocator(4, steps=[1, 2, 5, 10], prune="both"))
    axes.legend(loc="upper left", bbox_to_anchor=(0.02, 1.06), ncols=2, handlelength=1.8)


def _draw_tool_deviation(upper: Any, middle: Any, lower: Any, result: SimulationResult) -> None:
    """Components and length of the tool's deviation over time, and the angle by which its axes are off."""
    t, deviation = result.trajectory.t, result.tool_deviation
    factor, unit = scale_of(deviation, "m")
    deviation = factor * deviation
    for axis, column in zip("xyz", deviation.T, strict=True):
        upper.plot(t, column, color=COLORS["m"][axis], label=axis)
    upper.set_ylabel(f"deviation, {unit}")
    upper.tick_params(labelbottom=False)
    upper.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, handlelength=1.4, borderaxespad=0.0)
    upper.set_title("components, base axes", loc="left")
    turned, angle_unit = scale_of(result.tool_rotation, "rad")
    for panel, values, label in (
        (middle, np.linalg.norm(deviation, axis=1), f"distance, {unit}"),
        (lower, turned * result.tool_rotation, f"rotation, {angle_unit}"),
    ):
        panel.plot(t, values, color=TOOL_COLOR)
        panel.fill_between(t, values, color=TOOL_COLOR, alpha=0.12, linewidth=0.0)
        panel.set_ylim(0.0, 1.12 * max(float(values.max()), 1e-12))
        panel.set_ylabel(label)
    middle.tick_params(labelbottom=False)
    lower.set_xlabel("time, s")
    lower.set_xlim(t[0], t[-1])
    for panel in (upper, middle, lower):
        mark_end(panel, result)


def _draw_joint(panel: Any, result: SimulationResult, joint: str, unit: str) -> None:
    """The deviations of one joint that have this unit."""
    t, values = result.trajectory.t, MICRO * result.deviations
    for name, color in COLORS[unit].items():
        full = component_name(joint, name)
        if full in result.deviation_coordinates:
            panel.plot(t, values[:, result.deviation_coordinates.index(full)], color=color)
    panel.set_title(literal(f"{joint}, u{unit}"), loc="left", pad=3.0)
    panel.set_xlim(t[0], t[-1])
    panel.yaxis.set_major_locator(ticker().MaxNLocator(4, steps=[1, 2, 5, 10]))
    panel.margins(y=0.12)
    mark_end(panel, result)


def _colors(result: SimulationResult) -> dict[str, str]:
    """Colours of the kinds of deviations that occur."""
    present = {kind_of(name) for name in result.deviation_coordinates}
    return {name: color for colors in COLORS.values() for name, color in colors.items() if name in present}


def _legend(figure: Any, colors: Mapping[str, str], columns: int) -> None:
    """One legend of all panels."""
    from matplotlib.lines import Line2D

    lines: list[Any] = [Line2D([], [], color=color) for color in colors.values()]
    labels = [f"{name}, {'um' if name in COLORS['m'] else 'urad'}" for name in colors]
    lines.append(Line2D([], [], color=PROGRAM_COLOR, linestyle=":", linewidth=0.9))
    place = (0.12 / figure.get_figwidth(), 1.0 - 0.24 / figure.get_figheight())
    figure.legend(
        lines, [*labels, "program at rest"], loc="upper left", bbox_to_anchor=place, ncols=columns, handlelength=1.4
    )


def _round_factor(value: float) -> float:
    """The greatest of 1, 2, 5, 10, 20, ... that is not above the value; at least 1."""
    if value < 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= value * (1.0 + 1e-12)))
