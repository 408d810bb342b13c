"""Figures of the analyses about a state, in the style of ``style``.

Each function draws on a new figure, or in the caller's ``ax``, and returns (Figure, Axes); with a path it writes the
figure there instead, vector graphics by the file's ending, and returns the path.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.compliance import ComplianceMap
from ..analysis.frequency import Response
from ..analysis.modal_result import Modes, TrackedModes
from ..analysis.statics import Deflection
from ..analysis.tool_budget import Budget
from ..bending.beams.resultants import COMPONENTS
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..names import show
from ..shown import scale_of
from .scene import Array, axis_points, bent_axes, capsules, extent, link_poses, placed, slides_along_beams
from .style import (
    BESIDE,
    CYCLE,
    PROGRAM_COLOR,
    TOOL_COLOR,
    Plotted,
    check_kind,
    literal,
    set_space,
    sheet,
    ticker,
)

DASHES = ("-", "--", ":")  # of the first colours, the second and the third
COLUMNS = 3  # of shapes beside each other
SWING = 0.12  # largest displacement that is drawn, of the robot's size
NOISE = 1e-9  # of the largest response in a unit: round-off, which is not drawn
DEPTH = 1e-6  # of a response's largest value: below that its scale ends, as in a notch of round-off


def _line(k: int) -> dict[str, Any]:
    """Return colour and dashes of the k-th of several curves."""
    return {"color": CYCLE[k % len(CYCLE)], "linestyle": DASHES[k // len(CYCLE) % len(DASHES)]}


def plot_tracks(
    tracked: TrackedModes,
    path: Path | str | None = None,
    *,
    most: int = 12,
    times: NDArray[np.float64] | None = None,
    ax: Any = None,
) -> Plotted:
    """Plot natural frequencies and damping ratios of the lowest tracks over the poses, or over time.

    Args:
        tracked: of ``modes_along``.
        path: to write to, .png, .svg or .pdf.
        most: tracks to draw, the lowest ones.
        times: of the poses, (P,), s.
        ax: two axes to draw in, frequencies above ratios.

    Returns:
        The path where there is one, else the figure and its two axes.

    Raises:
        InputError: ``tracked`` is something else, Matplotlib is not installed, the ending is none of FIGURE_ENDINGS,
            the file cannot be written, or ``ax`` does not fit.
    """
    check_kind(tracked, TrackedModes, "tracked", "analysis.modes_along")
    with sheet(6.4, 4.8, path, f"{tracked.modes[0].robot}: the lowest modes along the path", ax) as drawn:
        room = {"top": 0.9, "bottom": 0.1, "left": 0.11, "right": 0.86}
        upper, lower = drawn.panels(2, lambda figure: figure.subplots(2, 1, sharex=True, gridspec_kw=room))
        frequencies, ratios = tracked.values("frequencies"), tracked.values("damping_ratios")
        over = np.arange(len(frequencies)) if times is None else times
        for k in range(min(most, frequencies.shape[1])):
            upper.plot(over, frequencies[:, k], label=f"{k + 1}", **_line(k))
            lower.plot(over, 100.0 * ratios[:, k], **_line(k))
        upper.legend(title="mode", **BESIDE)
        upper.set_ylabel("natural frequency, Hz")
        lower.set_ylabel("damping ratio, %")
        if 100.0 * float(np.nanmax(np.abs(ratios), initial=0.0)) < 1e-6:  # round-off of undamped modes
            lower.set_ylim(-0.05, 1.0)
        lower.set_xlabel("pose along the path" if times is None else "time, s")
        if times is None:
            lower.xaxis.set_major_locator(ticker().MaxNLocator(integer=True))
    return drawn.outcome


def plot_mode_shapes(
    modes: Modes, robot: RobotLike, path: Path | str | None = None, *, most: int = 6, ax: Any = None
) -> Plotted:
    """Plot links as lines in the lowest modes, in equilibrium and displaced to both sides, base frame, m.

    Links that bend are drawn along their axes.

    Displacements are those of small motions, enlarged until the largest of a mode is an eighth of the robot's size, so
    that closed loops stay closed; of a complex shape the real part is drawn.

    Args:
        modes: of this robot, from ``modes``.
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: .png, .svg or .pdf.
        most: modes to draw, the lowest ones.
        ax: axes in space to draw in, one for each mode.

    Returns:
        As ``plot_tracks``.

    Raises:
        InputError: the modes are of another robot, or there are none; else as of ``plot_tracks``.
    """
    check_kind(modes, Modes, "modes", "analysis.modes")
    robot = as_robot(robot)
    if modes.robot != robot.name:
        raise InputError(f"modes: are of robot {show(modes.robot)}; allowed: those of {show(robot.name)}")
    shown = min(most, len(modes.eigenvalues))
    if shown < 1:
        raise InputError(f"modes: there are none to draw of {show(robot.name)}; allowed: one or more")
    lines = [(capsule.link, np.stack([capsule.begin, capsule.end])) for capsule in capsules(robot)]
    bent = bent_axes(robot)
    on_beams = slides_along_beams(robot)
    slides = [x for x in robot.joints if x.slides and x not in on_beams]  # between their links there is no capsule

    def lines_of(q: Array) -> list[Array]:
        """Return the points of all lines, (P, 3) each, m: two of those that are straight."""
        poses = link_poses(robot, modes.coordinates, q)
        ends = [line @ poses[link][:3, :3].T + poses[link][:3, 3] for link, line in lines]
        for joint in slides:
            begin = poses[joint.parent] @ placed(joint.placement)
            ends.append(np.stack([begin[:3, 3], poses[joint.child][:3, 3]]))
        return ends + [axis_points(axis, poses, modes.coordinates, q) for axis in bent]

    rest, size = lines_of(modes.q), extent(robot)
    rows = -(-shown // COLUMNS)

    def grid(figure: Any) -> list[Any]:
        room = {"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0 - 0.52 / figure.get_figheight(), "wspace": 0.0}
        figure.subplots_adjust(**room)
        return [figure.add_subplot(rows, COLUMNS, k + 1, projection="3d") for k in range(shown)]

    with sheet(7.4, 0.5 + 2.2 * rows, path, f"{modes.robot}: shapes of the lowest modes", ax) as drawn:
        from matplotlib.lines import Line2D

        panels = drawn.panels(shown, grid, range(shown))
        for k, axes in enumerate(panels):
            shape = modes.shapes[k].real
            step = 1e-6 / max(float(np.abs(shape).max()), 1e-300)
            both = zip(lines_of(modes.q + step * shape), lines_of(modes.q - step * shape), strict=True)
            moved = [(there - back) / (2.0 * step) for there, back in both]
            largest = float(np.linalg.norm(np.concatenate(moved), axis=-1).max())
            scale = SWING * size / max(largest, 1e-300)
            _draw_lines(axes, rest, PROGRAM_COLOR, 0.8)
            for sign, color, width in ((-1.0, CYCLE[3], 0.8), (1.0, CYCLE[0], 1.4)):
                displaced = [line + sign * scale * way for line, way in zip(rest, moved, strict=True) if way.any()]
                _draw_lines(axes, displaced, color, width)
            set_space(axes, np.concatenate(rest), 0.55, 1.4, (22.0, -58.0))
            axes.set_axis_off()
            axes.set_title(_mode_title(modes, k), y=0.98)
        handles = [Line2D([], [], color=color) for color in (PROGRAM_COLOR, CYCLE[0], CYCLE[3])]
        place = (0.12 / 7.4, 1.0 - 0.22 / (0.5 + 2.2 * rows))
        labels = ["equilibrium", "displaced", "displaced the other way"]
        drawn.legend(handles, labels, loc="upper left", ncols=3, bbox_to_anchor=place, borderaxespad=0.0)
    return drawn.outcome


def _mode_title(modes: Modes, k: int) -> str:
    """Return number, frequency and damping ratio of a mode."""
    ratio = float(modes.damping_ratios[k])
    damping = f", {100.0 * ratio:.2g} %" if abs(ratio) > NOISE else ""
    return f"mode {k + 1}: {modes.frequencies[k]:.4g} Hz{damping}"


def _draw_lines(axes: Any, lines: Iterable[Array], color: str, width: float) -> None:
    for line in lines:
        axes.plot(*line.T, color=color, linewidth=width, clip_on=False)


def plot_response(
    response: Response, path: Path | str | None = None, *, most: int = len(CYCLE), ax: Any = None
) -> Plotted:
    """Plot magnitude and phase of the largest frequency responses (Bode plot); what is round-off is left out.

    Args:
        response: of ``analysis.response``.
        path: to write to, .png, .svg or .pdf.
        most: pairs of output and input to draw, the largest of each unit first.
        ax: two axes to draw in, magnitude above phase.

    Returns:
        As ``plot_tracks``, which has the errors, too.
    """
    check_kind(response, Response, "response", "analysis.response")
    pairs = _largest(response)[:most]
    names = [f"{y} from {x}" for y, x in pairs]
    units = [response.unit(y, x) for y, x in pairs]
    title = f"{response.robot}: frequency response"
    with sheet(6.4, 4.8 + 0.18 * len(pairs), path, title, ax) as drawn:
        height = 4.8 + 0.18 * len(pairs)
        room = {"top": 1.0 - (0.42 + 0.18 * len(pairs)) / height, "bottom": 0.45 / height, "left": 0.13, "right": 0.97}
        upper, lower = drawn.panels(2, lambda figure: figure.subplots(2, 1, sharex=True, gridspec_kw=room))
        floor = np.inf
        for k, ((y, x), name, unit) in enumerate(zip(pairs, names, units, strict=True)):
            H = response.of(y, x)
            size = np.abs(H)
            floor = min(floor, max(float(size.min()), DEPTH * float(size.max())))
            upper.plot(response.frequencies, size, label=literal(f"{name}, {unit}"), **_line(k))
            lower.plot(response.frequencies, np.degrees(np.angle(H)), **_line(k))
        if pairs:
            upper.set_yscale("log")
            upper.set_ylim(bottom=0.7 * floor)
            upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        if (response.frequencies > 0.0).all():
            lower.set_xscale("log")
        same = len(set(units)) == 1
        upper.set_ylabel(f"{response.kind}, {units[0]}" if same else f"{response.kind} per input")
        lower.set_ylabel("phase, deg")
        lower.set_yticks([-180, -90, 0, 90, 180])
        lower.set_xlabel("frequency, Hz")
    return drawn.outcome


def _largest(response: Response) -> list[tuple[str, str]]:
    """Return pairs of output and input, the largest first, without those that are round-off beside others in a unit."""
    sizes = {(y, x): float(np.abs(response.of(y, x)).max()) for y in response.outputs for x in response.inputs}
    most: dict[str, float] = {}
    for (y, x), size in sizes.items():
        unit = response.unit(y, x)
        most[unit] = max(most.get(unit, 0.0), size)
    shown = {pair: size for pair, size in sizes.items() if size > NOISE * most[response.unit(*pair)]}
    return sorted(shown, key=lambda pair: -shown[pair] / most[response.unit(*pair)])


def plot_budget(budget: Budget, path: Path | str | None = None, *, most: int = 6, ax: Any = None) -> Plotted:
    """Plot the largest contributions to the displacement of a frame over time.

    Args:
        budget: of ``analysis.budget``.
        path: to write to, .png, .svg or .pdf.
        most: contributions to draw, the largest ones.
        ax: axes to draw in.

    Returns:
        As ``plot_tracks``, which has the errors, too.
    """
    check_kind(budget, Budget, "budget", "analysis.budget")
    rows = budget.table()[:-1][:most]
    curves = {budget.frame: (budget.deviation[:, :3], {"color": TOOL_COLOR, "linewidth": 1.6})}
    for k, row in enumerate(rows):
        curves[row.name] = (budget.contributions[:, budget.coordinates.index(row.name), :3], _line(k))
    curves["second order"] = (budget.remainder[:, :3], {"color": PROGRAM_COLOR, "linestyle": "--"})
    factor, unit = scale_of(np.concatenate([np.linalg.norm(values, axis=1) for values, _ in curves.values()]), "m")
    with sheet(6.4, 3.8, path, f"{budget.robot}: contributions to the displacement of {budget.frame}", ax) as drawn:
        [axes] = drawn.panels(1, lambda figure: figure.add_axes((0.11, 0.13, 0.63, 0.74)))
        for name, (values, look) in curves.items():
            axes.plot(budget.t, factor * np.linalg.norm(values, axis=1), label=literal(name), **look)
        axes.set_xlabel("time, s")
        axes.set_ylabel(f"displacement, {unit}")
        axes.set_ylim(bottom=0.0)
        axes.legend(**BESIDE)
    return drawn.outcome


def plot_compliance(compliance: ComplianceMap, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot the compliance in the softest direction over a plane, in the coordinates of the base frame where it can be.

    Args:
        compliance: of ``compliance_map``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in.

    Returns:
        As ``plot_tracks``, which has the errors, too.
    """
    check_kind(compliance, ComplianceMap, "compliance", "analysis.compliance_map")
    corner = compliance.points[0, 0]
    edges = compliance.points[-1, 0] - corner, compliance.points[0, -1] - corner
    first = edges[0] / np.linalg.norm(edges[0])
    second = edges[1] - (edges[1] @ first) * first  # square axes in the plane
    second /= np.linalg.norm(second)
    names = [_base_axis(direction) for direction in (first, second)]
    if None in names:
        across = (compliance.points - corner) @ np.stack([first, second], axis=1)
        labels = [f"along {_place(edges[0])} from {_place(corner)}, m", f"across it, towards {_place(edges[1])}, m"]
        at = ""
    else:
        kept = ["xyz".index(name or "") for name in names]
        [left] = {0, 1, 2} - set(kept)
        across = compliance.points[..., kept]
        labels = [f"{name}, m" for name in names]
        at = f" at {'xyz'[left]} = {corner[left]:.4g} m"
    factor, unit = scale_of(compliance.softest, "m/N")
    title = f"{compliance.robot}: static compliance of {compliance.frame}{at}"
    with sheet(5.6, 4.4, path, title, ax) as drawn:
        [axes] = drawn.panels(1, lambda figure: figure.add_axes((0.13, 0.12, 0.7, 0.76)))
        mesh = axes.pcolormesh(
            across[..., 0], across[..., 1], factor * compliance.softest, shading="nearest", cmap="viridis"
        )
        mesh.set_rasterized(True)
        axes.set_aspect("equal")
        axes.grid(visible=False)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        drawn.figure.colorbar(mesh, ax=axes, label=f"compliance in the softest direction, {unit}")
    return drawn.outcome


def plot_stress_resultants(deflection: Deflection, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot stress resultants of beams along them: forces above moments, above stress where sections are known.

    Args:
        deflection: of ``analysis.deflection``, of a robot with links that are beams.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, row by row; a column is a beam.

    Returns:
        As ``plot_tracks``.

    Raises:
        InputError: no link is a beam; else as of ``plot_tracks``.
    """
    check_kind(deflection, Deflection, "deflection", "analysis.deflection")
    beams = deflection.beams
    if not beams:
        raise InputError(f"deflection: is of {show(deflection.robot)}; allowed: of a robot with links that are beams")
    rows = 2 + any(beam.stress is not None for beam in beams)
    width, height = 1.4 + 3.6 * len(beams), 0.9 + 1.6 * rows
    room = {"top": 1.0 - 0.6 / height, "bottom": 0.5 / height, "left": 0.8 / width, "right": 1.0 - 0.8 / width}

    def grid(figure: Any) -> Any:
        return figure.subplots(rows, len(beams), sharex="col", squeeze=False, gridspec_kw=room)

    with sheet(width, height, path, f"{deflection.robot}: stress resultants of beams", ax) as drawn:
        table = np.array(drawn.panels(rows * len(beams), grid), dtype=object).reshape(rows, len(beams))
        for beam, column in zip(beams, table.T, strict=True):
            column[0].set_title(literal(beam.link))
            column[-1].set_xlabel("distance from the root, m")
            for part, (axes, unit) in enumerate(zip(column, ("N", "N m"), strict=False)):
                values = beam.resultants[:, 3 * part : 3 * part + 3]
                factor, unit = scale_of(values, unit)
                for k, name in enumerate(COMPONENTS[3 * part : 3 * part + 3]):
                    axes.plot(beam.x, factor * values[:, k], label=name, **_line(k))
                axes.set_ylabel(f"{('force', 'moment')[part]}, {unit}")
            if beam.stress is not None:
                column[2].plot(beam.x, 1e-6 * beam.stress, color=TOOL_COLOR)
                column[2].set_ylabel("stress, MPa")
                column[2].set_ylim(bottom=0.0)
        for axes in table[:2, -1]:
            axes.legend(**BESIDE)
    return drawn.outcome


def _base_axis(direction: Any) -> str | None:
    """Return the name of the axis of the base that a unit vector points along; None where it is along none."""
    k = int(np.abs(direction).argmax())
    return "xyz"[k] if direction[k] > 1.0 - 1e-9 else None


def _place(point: Any) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in point) + ")"
