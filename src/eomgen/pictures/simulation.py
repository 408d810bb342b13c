"""Figures of a simulation: the tool against its program (Figure 1 of the paper), and every joint's deviations.

Matplotlib is imported when a plot is made, not with this file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..files import as_path
from ..names import component_name, joint_of, kind_of
from ..results.beside import SIMULATION_FIGURES
from ..robot.coordinates import MODE, unit_of
from ..shown import scale_of
from ..simulation.result import Series, SimulationResult
from .energy import SOURCE, plot_energy, plot_tracking
from .journals import plot_journals, result_journals
from .style import (
    COLORS,
    CYCLE,
    PROGRAM_COLOR,
    TOOL_COLOR,
    Plotted,
    Sheet,
    check_kind,
    literal,
    mark_end,
    panel_grid,
    set_space,
    sheet,
    ticker,
)

SHOWN_PART = 0.25  # a magnified deviation is about this share of the path's extent
WHISKERS = 25
LONG_LABEL = 20  # characters of a label beside a panel, from which on it is written small
MOST_STATES = 12  # of laws in a figure
ACROSS = 3  # panels beside each other
_BESIDE = 7  # entries of a legend beside each other
_OF_MODES = "1"
_SCALES = {"m": (1e6, "um"), "rad": (1e6, "urad"), _OF_MODES: (1.0, "1")}  # factor and unit in figures
_Colors = Mapping[str, str]


def plot_result(result: SimulationResult, folder: Path | str | None = None, ending: str = ".png") -> Any:
    """Plot all figures of a result: ``tool``, ``deviations`` and ``journals`` where the robot has some, ``tracking``
    where there is a reference, ``energy`` where there is a balance.

    Args:
        result: of a simulation.
        folder: to write to; made where it does not exist.
        ending: of files, one of FIGURE_ENDINGS.

    Returns:
        The paths that were written where there is a folder, else (Figure, Axes) by these names.

    Raises:
        InputError: ``result`` is something else, Matplotlib is not installed, the ending is another one, or a file
            cannot be written.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    draws: tuple[tuple[Callable[..., Any], Any], ...] = (  # and what a result must have for it
        (plot_tool, True),
        (plot_deviations, result.deviation_coordinates),
        (plot_journals, result_journals(result)),
        (plot_tracking, result.programmed and result.program_coordinates),
        (plot_energy, result.balance is not None),
        (plot_states, result.trajectory.internal_states),
    )
    plots = {name: plot for name, (plot, needed) in zip(SIMULATION_FIGURES, draws, strict=True) if needed}
    if folder is None:
        return {name: plot(result) for name, plot in plots.items()}
    target = as_path(folder, "folder")
    return [plot(result, target / f"{name}{ending}") for name, plot in plots.items()]


def plot_series(result: SimulationResult, *names: str, path: Path | str | None = None, ax: Any = None) -> Plotted:
    """Plot values of a result over time by their names; without names what ``plot_tool`` does.

    Values of one unit share a panel, with a prefix of the unit that fits them.

    Args:
        result: of a simulation.
        names: of series: "joint1.gamma", "joint1.gamma.drive", "energy.kinetic"; ``result.names`` has all.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, one for each unit in the order of the names.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        UnknownNameError: there is no series of that name.
        InputError: ``result`` is something else, or as of ``style.sheet``.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    if not names:
        return plot_tool(result, path, ax=ax)
    by_unit: dict[str, list[Series]] = {}
    for name in names:
        series = result.series(name)
        by_unit.setdefault(series.unit, []).append(series)
    count = len(by_unit)
    height = 0.9 + 1.9 * count
    with sheet(6.4, height, path, f"{result.robot}: over time", ax) as drawn:
        longest = max(len(label) for curves in by_unit.values() for label, *_ in _components(curves))
        small, right = longest > LONG_LABEL, 0.7 - min(max(0.0045 * (longest - LONG_LABEL), 0.0), 0.25)
        room = {"top": 1.0 - 0.4 / height, "bottom": 0.45 / height, "left": 0.12, "right": right}
        panels = drawn.panels(
            count, lambda figure: figure.subplots(count, 1, sharex=True, squeeze=False, gridspec_kw=room)
        )
        for panel, (unit, curves) in zip(panels, by_unit.items(), strict=True):
            factor, prefixed = scale_of(np.concatenate([np.ravel(series.values) for series in curves]), unit)
            for k, (label, t, values) in enumerate(_components(curves)):
                panel.plot(t, factor * values, color=CYCLE[k % len(CYCLE)], label=literal(label))
            panel.set_ylabel(prefixed)
            panel.set_xlim(curves[0].t[0], curves[0].t[-1])
            beside: dict[str, Any] = {"borderaxespad": 0.0, "handlelength": 1.4, **({"fontsize": 6.5} if small else {})}
            panel.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), **beside)
            mark_end(panel, result)
        panels[-1].set_xlabel("time, s")
    return drawn.outcome


def plot_states(result: SimulationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot the internal states over time, the largest ones where there are many.

    Arguments, what comes back and errors as of ``plot_series``.

    Raises:
        InputError: no law has a state.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    internal_states, z = result.trajectory.internal_states, result.trajectory.z
    if z is None or not internal_states:
        raise InputError(f"result: no law of {result.robot} has a state; allowed: results of robots with such laws")
    sizes = {name: float(np.abs(values).max()) for name, values in zip(internal_states, z.T, strict=True)}
    largest = set(sorted(internal_states, key=lambda name: -sizes[name])[:MOST_STATES])
    return plot_series(result, *(name for name in internal_states if name in largest), path=path, ax=ax)


def _components(curves: Sequence[Series]) -> Iterator[tuple[str, Array, Array]]:
    """Give label, times and values of every curve: of vectors one for each of x, y and z."""
    for series in curves:
        if series.values.ndim == 1:
            yield series.name, series.t, series.values
            continue
        for axis, values in zip("xyz", series.values.T, strict=True):
            yield f"{series.name} {axis}", series.t, values


def plot_tool(result: SimulationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot the tool's path with its deviation magnified, beside the deviations of position and orientation over time.

    Args:
        result: of a simulation.
        path: to write to, .png, .svg or .pdf.
        ax: four axes, the first of them in space.

    Returns:
        The path where there is one, else the figure and its four axes.

    Raises:
        InputError: see ``plot_result``.
    """
    check_kind(result, SimulationResult, "result", SOURCE)

    def grid(figure: Any) -> list[Any]:
        places = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0), left=0.01, right=0.975, top=0.885, bottom=0.095)
        places.update(wspace=0.24, hspace=0.18)
        space, upper = figure.add_subplot(places[:, 0], projection="3d"), figure.add_subplot(places[0, 1])
        return [space, upper, *(figure.add_subplot(places[row, 1], sharex=upper) for row in (1, 2))]

    with sheet(7.4, 4.6, path, f"{result.robot}: {result.tool} against its reference trajectory", ax) as drawn:
        space, *panels = drawn.panels(4, grid, (0,))
        _draw_path(space, result)
        _draw_tool_deviation(panels[0], panels[1], panels[2], result)
        drawn.figure.align_ylabels(panels)
    return drawn.outcome


def plot_deviations(result: SimulationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot every joint's deviations over time: linear in micrometres and, below, angular in microradians.

    Each panel has its scale; three stand side by side.  Joints that are rigid in a unit have none of it.  Below stand
    links that bend, with their modal coordinates.

    Args:
        result: of a simulation.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, one for each joint with linear deviations, then one for each with angular ones, then one
            for each link that bends.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: see ``plot_result``, or the robot has no deviations.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    pairs = dict.fromkeys((joint_of(name), unit_of(name)) for name in result.deviation_coordinates)
    if not pairs:
        raise InputError(f"{result.robot} has no deviations to plot")
    colors = _colors(result)
    joints = {unit: [joint for joint, its in pairs if its == unit] for unit in colors}
    across = min(ACROSS, max(map(len, joints.values())))
    lines = [line for unit, names in joints.items() for line in _rows(names, unit, across)]
    rows = len(lines)
    places = [(row, column, joint) for row, line in enumerate(lines) for column, joint in enumerate(line)]
    width = max(4.4, 2.45 * across)
    entries = sum(map(len, colors.values())) + 1  # of the legend
    columns = min(entries, _BESIDE) if width > 6.0 else 3
    head = 0.55 + 0.17 * -(-entries // columns)
    height = 1.35 * rows + head + 0.03

    def grid(figure: Any) -> list[Any]:
        panels = panel_grid(figure, rows, across, head=head, hspace=0.32, wspace=0.3)
        for row, line in enumerate(lines):
            for panel in panels[row, len(line) :]:
                panel.set_visible(False)
        return [panels[row, column] for row, column, _ in places]

    with sheet(width, height, path, f"{result.robot}: deviations in the joints", ax) as drawn:
        for (row, column, joint), panel in zip(places, drawn.panels(len(places), grid), strict=True):
            _draw_joint(panel, result, *joint, colors)
            last = all(column >= len(below) for below in lines[row + 1 :]) or not drawn.is_new
            panel.tick_params(labelbottom=last)
            panel.set_xlabel("time, s" if last else "")
        _legend(drawn, colors, columns, (width, height))
    return drawn.outcome


def _rows(joints: Sequence[str], unit: str, across: int) -> list[list[tuple[str, str]]]:
    """Joints and their unit, as many beside each other as there is room for."""
    return [[(joint, unit) for joint in joints[k : k + across]] for k in range(0, len(joints), across)]


def _draw_path(axes: Any, result: SimulationResult) -> None:
    """Draw reference trajectory and TCP in space; the TCP error is magnified, as whiskers from the one to the other."""
    program, deviation = result.program_pose[:, :3, 3], result.tool_deviation
    half = max(0.5 * float(np.ptp(program, axis=0).max()), 1e-3)
    factor = _round_factor(2.0 * half * SHOWN_PART / max(float(np.linalg.norm(deviation, axis=1).max()), 1e-15))
    shown = program + factor * deviation
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(program, axis=0), axis=1))])
    for at in np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], WHISKERS))):
        axes.plot(*np.stack([program[at], shown[at]]).T, color=TOOL_COLOR, linewidth=0.5, alpha=0.6)
    axes.plot(*program.T, color=PROGRAM_COLOR, linestyle="--", label="reference trajectory (rigid robot)")
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
    upper.set_title("components, base frame", loc="left")
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


def _draw_joint(panel: Any, result: SimulationResult, joint: str, unit: str, colors: Mapping[str, _Colors]) -> None:
    """The deviations of one joint, or the modal coordinates of one link, that have this unit."""
    t, factor, shown = result.trajectory.t, *_SCALES[unit]
    for name, color in colors[unit].items():
        full = component_name(joint, name)
        if full in result.deviation_coordinates:
            panel.plot(t, factor * result.deviations[:, result.deviation_coordinates.index(full)], color=color)
    panel.set_title(literal(f"{joint}, {shown}"), loc="left", pad=3.0)
    panel.set_xlim(t[0], t[-1])
    panel.yaxis.set_major_locator(ticker().MaxNLocator(4, steps=[1, 2, 5, 10]))
    panel.margins(y=0.12)
    mark_end(panel, result)


def _colors(result: SimulationResult) -> dict[str, _Colors]:
    """Colours of the kinds of deviations that occur, by their unit; modes in the order of their numbers."""
    present = {kind_of(name) for name in result.deviation_coordinates}
    modes = sorted((x for x in present if x.startswith(MODE)), key=lambda x: int(x.removeprefix(MODE)))
    every = {**COLORS, _OF_MODES: {name: CYCLE[k % len(CYCLE)] for k, name in enumerate(modes)}}
    return {unit: {name: color for name, color in own.items() if name in present} for unit, own in every.items()}


def _legend(drawn: Sheet, colors: Mapping[str, _Colors], columns: int, size: tuple[float, float]) -> None:
    """Put one legend for all panels; the figure's size in inches."""
    from matplotlib.lines import Line2D

    lines: list[Any] = [Line2D([], [], color=color) for own in colors.values() for color in own.values()]
    labels = [f"{name}, {_SCALES[unit][1]}" for unit, own in colors.items() for name in own]
    lines.append(Line2D([], [], color=PROGRAM_COLOR, linestyle=":", linewidth=0.9))
    place = (0.12 / size[0], 1.0 - 0.24 / size[1])
    labels.append("reference at a standstill")
    drawn.legend(lines, labels, loc="upper left", bbox_to_anchor=place, ncols=columns, handlelength=1.4)


def _round_factor(value: float) -> float:
    """The greatest of 1, 2, 5, 10, 20, ... that is not above the value; at least 1."""
    if value < 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= value * (1.0 + 1e-12)))
