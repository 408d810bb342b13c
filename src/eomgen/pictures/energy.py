"""Figures of a simulation: tracking errors, and where energy comes from and goes to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..robot.coordinates import index_of, unit_of
from ..shown import scale_of
from ..simulation.balance import TERMS
from ..simulation.result import SimulationResult
from .style import (
    COLORS,
    PROGRAM_COLOR,
    TOOL_COLOR,
    Plotted,
    check_kind,
    literal,
    mark_end,
    panel_grid,
    sheet,
    ticker,
)

ACROSS = 3
SOURCE = "simulate, run_scenario or load_result"  # of results
WORK_COLORS = dict(
    zip(
        TERMS,
        (COLORS["m"]["x"], COLORS["rad"]["alpha"], COLORS["m"]["z"], COLORS["rad"]["beta"], TOOL_COLOR),
        strict=True,
    )
)


def plot_tracking(result: SimulationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot every driven coordinate over time beside its reference trajectory, and below its tracking error.

    Args:
        result: of a simulation.
        path: to write to, .png, .svg or .pdf.
        ax: two axes for each driven coordinate: first all upper ones, then all lower ones.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``result`` is something else, there is no reference trajectory, or as of ``style.sheet``.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    names = result.program_coordinates
    count = len(names)
    if not (result.programmed and names):
        raise InputError(f"{result.robot} had no reference trajectory to be drawn against")
    across = min(ACROSS, count)
    rows = 2 * -(-count // across)
    width, height = max(4.4, 2.45 * across), 1.3 * rows + 0.75
    reality = result.trajectory.q[:, index_of(result.trajectory.coordinates, names)]

    def grid(figure: Any) -> list[Any]:
        panels = panel_grid(figure, rows, across, head=0.72, hspace=0.36, wspace=0.34)
        for k in range(count, rows // 2 * across):
            panels[k // across * 2, k % across].set_visible(False)
            panels[k // across * 2 + 1, k % across].set_visible(False)
        return [panels[k // across * 2 + row, k % across] for row in (0, 1) for k in range(count)]

    with sheet(
        width, height, path, f"{result.robot}: driven coordinates against their reference trajectory", ax
    ) as drawn:
        panels = drawn.panels(2 * count, grid)
        for k, name in enumerate(names):
            upper, lower = panels[k], panels[count + k]
            _draw_coordinate(upper, lower, result, name, result.program_q[:, k], reality[:, k])
            last = k + across >= count or not drawn.is_new
            lower.tick_params(labelbottom=last)
            lower.set_xlabel("time, s" if last else "")
        drawn.legend(
            panels[0].get_lines()[:2],
            ["reference trajectory", "simulation"],
            loc="upper left",
            ncols=2,
            bbox_to_anchor=(0.12 / width, 1.0 - 0.24 / height),
        )
    return drawn.outcome


def _draw_coordinate(
    upper: Any, lower: Any, result: SimulationResult, name: str, program: Array, reality: Array
) -> None:
    t, unit = result.trajectory.t, unit_of(name)
    upper.plot(t, program, color=PROGRAM_COLOR, linestyle="--", linewidth=1.6)
    upper.plot(t, reality, color=COLORS["m"]["x"], linewidth=0.9)
    upper.set_title(literal(f"{name}, {unit}"), loc="left", pad=3.0)
    upper.tick_params(labelbottom=False)
    factor, small = scale_of(reality - program, unit)
    lower.plot(t, factor * (reality - program), color=TOOL_COLOR)
    lower.set_title(f"tracking error, {small}", loc="left", pad=3.0)
    for panel in (upper, lower):
        panel.set_xlim(t[0], t[-1])
        panel.margins(y=0.12)
        panel.yaxis.set_major_locator(ticker().MaxNLocator(4, steps=[1, 2, 5, 10]))
        mark_end(panel, result)


def plot_energy(result: SimulationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot changes of energy and work integrals over time, and below what their balance leaves.

    Args:
        result: of a simulation.
        path: to write to, .png, .svg or .pdf.
        ax: two axes.

    Returns:
        The path where there is one, else the figure and its two axes.

    Raises:
        InputError: ``result`` is something else, it has no balance, or as of ``style.sheet``.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    balance, t = result.balance, result.trajectory.t
    if balance is None:
        raise InputError(f"the result of {result.robot} was written by an eomgen without an energy balance")
    with sheet(6.4, 4.4, path, f"{result.robot}: energy and work", ax) as drawn:
        place = {"left": 0.11, "right": 0.76, "top": 0.9, "bottom": 0.11, "height_ratios": (2.6, 1.0), "hspace": 0.22}
        upper, lower = drawn.panels(2, lambda figure: figure.subplots(2, 1, sharex=True, gridspec_kw=place))
        factor, unit = scale_of(np.concatenate([balance.work, balance.energy - balance.energy[0]], axis=1), "J")
        for name, values, style in zip(("kinetic", "potential"), balance.energy.T, ("-", "--"), strict=True):
            upper.plot(t, factor * (values - values[0]), color="#000000", linestyle=style, label=f"{name} energy")
        for term in TERMS:
            if balance.of(term).any():
                label = "dissipated" if term == "dissipated" else f"work of {term}"
                upper.plot(t, factor * balance.of(term), color=WORK_COLORS[term], label=label)
        upper.set_ylabel(f"since the start, {unit}")
        upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.6)
        factor, unit = scale_of(balance.residue, "J")
        lower.plot(t, factor * balance.residue, color=PROGRAM_COLOR)
        lower.set_ylabel(f"residue, {unit}")
        lower.set_xlabel("time, s")
        lower.set_xlim(t[0], t[-1])
        share = f"at most {balance.relative_residue:.1g}\nof the largest term"
        lower.text(1.03, 0.95, share, transform=lower.transAxes, va="top")
        drawn.figure.align_ylabels([upper, lower])
    return drawn.outcome
