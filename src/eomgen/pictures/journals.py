"""Figures of journals in their bearings: the path of their centres inside the circle of the clearance.

Matplotlib is imported when a plot is made, not with this file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..shown import scale_of
from ..simulation.result import SimulationResult, simulated_robot
from ..state.journals import JournalContact, contacts_of
from .energy import SOURCE
from .style import COLORS, PROGRAM_COLOR, TOOL_COLOR, Plotted, check_kind, literal, panel_grid, sheet

ACROSS = 3
ENDS = {0: "", 1: ", end towards +z", -1: ", end towards -z"}


def result_journals(result: SimulationResult) -> list[JournalContact]:
    """Places where journals of a result may touch; none where the result does not keep its robot."""
    if not result.description:
        return []
    laws = {joint.name: joint.radial.law() for joint in simulated_robot(result).joints if joint.radial is not None}
    return contacts_of(laws, result.trajectory.coordinates)


def plot_journals(result: SimulationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot every journal's path in its bearing, each end of the bearing in a panel.

    Args:
        result: of a simulation.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, one for each end of a bearing that may touch.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``result`` is something else, the robot has no journals, or as of ``style.sheet``.
    """
    check_kind(result, SimulationResult, "result", SOURCE)
    places = result_journals(result)
    if not places:
        raise InputError(f"{result.robot} has no journals to plot")
    across = min(ACROSS, len(places))
    rows = -(-len(places) // across)
    width, height = max(3.0, 2.45 * across), 2.5 * rows + 0.3

    def grid(figure: Any) -> list[Any]:
        panels = panel_grid(figure, rows, across, head=0.5, right=0.15, sharex=False, hspace=0.36, wspace=0.34).ravel()
        for panel in panels[len(places) :]:
            panel.set_visible(False)
        return list(panels[: len(places)])

    with sheet(width, height, path, f"{result.robot}: journals in their bearings", ax) as drawn:
        for place, panel in zip(places, drawn.panels(len(places), grid), strict=True):
            draw_journal(panel, place.centre(result.trajectory.q), place.clearance)
            panel.set_title(literal(place.name + ENDS[place.end]), loc="left", pad=3.0)
    return drawn.outcome


def draw_journal(panel: Any, centre: Array, clearance: float) -> None:
    """Draw the path of a journal's centre, (T, 2), m, and the circle up to which it is free, m."""
    factor, unit = scale_of(np.append(centre, clearance), "m")
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = factor * clearance * np.stack([np.cos(turn), np.sin(turn)])
    panel.plot(*circle, color=PROGRAM_COLOR, linestyle="--", label="clearance")
    panel.plot(*(factor * centre.T), color=COLORS["m"]["x"], linewidth=0.7, label="path")
    panel.plot(*(factor * centre[:1].T), color=TOOL_COLOR, marker="o", markersize=3.0, linestyle="", label="start")
    panel.set_xlabel(f"x, {unit}")
    panel.set_ylabel(f"y, {unit}")
    panel.set_aspect("equal", adjustable="datalim")
