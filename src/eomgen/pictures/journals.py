"""Figures of journals in their bearings: the path of their centres inside the circle of the clearance.

Matplotlib is imported when a plot is made, not with this file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..simulation.result import SimulationResult, simulated_robot
from ..state.journals import JournalContact, contacts_of
from .style import COLORS, PROGRAM_COLOR, TOOL_COLOR, canvas, literal, panel_grid, scale_of

ACROSS = 3
ENDS = {0: "", 1: ", end towards +z", -1: ", end towards -z"}


def result_journals(result: SimulationResult) -> list[JournalContact]:
    """Places where journals of a result may touch; none where the result does not keep its robot."""
    if not result.description:
        return []
    laws = {joint.name: joint.radial.law() for joint in simulated_robot(result).joints if joint.radial is not None}
    return contacts_of(laws, result.trajectory.coordinates)


def plot_journals(result: SimulationResult, path: Path | str) -> Path:
    """Every journal's path in its bearing, each end of the bearing in a panel; returns the path.

    Raises:
        InputError: the robot has no journals; or see ``style.canvas``.
    """
    places = result_journals(result)
    if not places:
        raise InputError(f"{result.robot} has no journals to plot")
    across = min(ACROSS, len(places))
    rows = -(-len(places) // across)
    width, height = max(3.0, 2.45 * across), 2.5 * rows + 0.3
    with canvas(width, height, path, f"{result.robot}: journals in their bearings") as figure:
        panels = panel_grid(figure, rows, across, head=0.5, right=0.15, sharex=False, hspace=0.36, wspace=0.34)
        for k, panel in enumerate(panels.ravel()):
            if k >= len(places):
                panel.set_visible(False)
                continue
            draw_journal(panel, places[k].centre(result.trajectory.q), places[k].clearance)
            panel.set_title(literal(places[k].name + ENDS[places[k].end]), loc="left", pad=3.0)
    return Path(path)


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
