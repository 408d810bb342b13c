"""Figures of ISO 9283 drawn and as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...identification.iso_9283.result import AccuracyResult
from ...shown import scale_of
from ..report import Report, Table, drawn, sorted_notes
from ..style import BESIDE, CYCLE, PROGRAM_COLOR, Plotted, check_kind, literal, sheet
from .tables import columns_of, table

MOST = len(CYCLE)  # poses, and paths, that are drawn


def accuracy_page(accuracy: AccuracyResult) -> Report:
    """A page about figures of ISO 9283: those of poses, distances, stops and paths, load and rate, notes."""
    figures = []
    if accuracy.poses or accuracy.paths:
        text = (
            "Attained positions less the command with a circle of the repeatability about each barycentre; along paths"
            " the offset of the barycentre and the repeatability."
        )
        figures.append(("accuracy", text, plot_accuracy))
    tables = list[Table]()
    for title, rows in accuracy.tables().items():
        if len(rows) > 1:
            head, *others = columns_of(rows)
            tables += table(title, head, others)
    return Report(
        title=f"{accuracy.robot or accuracy.frame}: accuracy by ISO 9283",
        summary=(f"frame {accuracy.frame}, {accuracy.source}", f"load: {accuracy.load}", f"rate: {accuracy.rate}"),
        warnings=sorted_notes(accuracy.notes)[0],
        notes=sorted_notes(accuracy.notes)[1],
        figures=drawn(accuracy, figures),
        tables=tuple(tables),
    )


def plot_accuracy(accuracy: AccuracyResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot attained positions less the command, with a circle of the repeatability about each barycentre, and the
    offset of the barycentre and the repeatability along paths; of the first six of each.

    Args:
        accuracy: of ``identification.accuracy``.
        path: to write to, .png, .svg or .pdf.
        ax: two axes for poses where there are some, then two for paths.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``accuracy`` is something else, or as of ``style.sheet``.
    """
    check_kind(accuracy, AccuracyResult, "accuracy", "identification.accuracy")
    count = bool(accuracy.poses) + bool(accuracy.paths)
    title = f"{accuracy.robot or accuracy.frame}: accuracy by ISO 9283, {accuracy.source}"

    def grid(figure: Any) -> list[Any]:
        panels, parts = [], figure.subfigures(count, 1, squeeze=False)[:, 0].tolist()
        if accuracy.poses:
            room = {"top": 0.86, "bottom": 0.15, "left": 0.11, "right": 0.8, "wspace": 0.38}
            panels += list(parts.pop(0).subplots(1, 2, gridspec_kw=room))
        if accuracy.paths:
            room = {"top": 0.9, "bottom": 0.15, "left": 0.11, "right": 0.8}
            panels += list(parts.pop(0).subplots(2, 1, sharex=True, gridspec_kw=room))
        return panels

    with sheet(6.4, 3.2 * count, path, title, ax) as drawn:
        panels = drawn.panels(2 * count, grid)
        if accuracy.poses:
            _poses(accuracy, panels[:2])
        if accuracy.paths:
            _paths(accuracy, panels[-2:])
    return drawn.outcome


def _poses(accuracy: AccuracyResult, panels: Sequence[Any]) -> None:
    from matplotlib.lines import Line2D

    shown = accuracy.poses[:MOST]
    off = [np.array(pose.attained) - pose.command for pose in shown]
    scale, unit = scale_of(np.concatenate(off), "m")
    for axis, panel in zip((1, 2), panels, strict=True):
        for color, pose, points in zip(CYCLE, shown, off, strict=False):
            drawn = scale * points
            middle = scale * np.array(pose.offset)
            panel.plot(drawn[:, 0], drawn[:, axis], ".", color=color, label=literal(f"pose {pose.name}"))
            panel.plot(middle[0], middle[axis], "+", color=color, markersize=9.0)
            angle = np.linspace(0.0, 2.0 * np.pi, 73)
            radius = scale * pose.repeatability
            panel.plot(middle[0] + radius * np.cos(angle), middle[axis] + radius * np.sin(angle), color=color)
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel(f"x less command, {unit}")
        panel.set_ylabel(f"{'xyz'[axis]} less command, {unit}")
        panel.axhline(0.0, color=PROGRAM_COLOR, linewidth=0.6)
        panel.axvline(0.0, color=PROGRAM_COLOR, linewidth=0.6)
    handles, names = panels[0].get_legend_handles_labels()
    grey: dict[str, Any] = {"color": PROGRAM_COLOR, "linestyle": ""}
    handles += [Line2D([], [], marker="+", **grey), Line2D([], [], marker="o", fillstyle="none", **grey)]
    panels[1].legend(handles, [*names, "barycentre", "repeatability"], **BESIDE)


def _paths(accuracy: AccuracyResult, panels: Sequence[Any]) -> None:
    shown = accuracy.paths[:MOST]
    for panel, name, title in zip(panels, ("offsets", "scatters"), ("barycentre off", "mean + 3 S"), strict=True):
        curves = [np.array(getattr(item, name)) for item in shown]
        scale, unit = scale_of(np.concatenate(curves), "m")
        for color, item, values in zip(CYCLE, shown, curves, strict=False):
            panel.plot(item.along, scale * values, color=color, label=literal(f"path {item.name}"))
        panel.set_ylabel(f"{title}, {unit}")
    panels[0].legend(**BESIDE)
    panels[1].set_xlabel("length along the path, m")
