"""Figures of ISO 9283 drawn and as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.iso_9283.result import AccuracyResult
from ..report import Report, Table, drawn
from ..style import COLORS, canvas, literal, scale_of
from .tables import columns_of, table

CYCLE = tuple(color for colors in COLORS.values() for color in colors.values())
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
        warnings=accuracy.notes,
        figures=drawn(accuracy, figures),
        tables=tuple(tables),
    )


def plot_accuracy(accuracy: AccuracyResult, path: Path | str) -> Path:
    """Draw attained positions less the command, with a circle of the repeatability about each barycentre, and the
    offset of the barycentre and the repeatability along paths; of the first six of each.  Returns the path.

    Raises:
        InputError: see ``style.canvas``.
    """
    with canvas(
        6.4,
        3.4 * (bool(accuracy.poses) + bool(accuracy.paths)),
        path,
        f"{accuracy.robot or accuracy.frame}: accuracy by ISO 9283, {accuracy.source}",
    ) as figure:
        rows = figure.subfigures(bool(accuracy.poses) + bool(accuracy.paths), 1, squeeze=False)[:, 0].tolist()
        if accuracy.poses:
            _poses(accuracy, rows.pop(0))
        if accuracy.paths:
            _paths(accuracy, rows.pop(0))
    return Path(path)


def _poses(accuracy: AccuracyResult, subfigure: Any) -> None:
    panels = subfigure.subplots(1, 2, gridspec_kw={"top": 0.86, "bottom": 0.15, "left": 0.11, "wspace": 0.35})
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
    panels[0].legend()


def _paths(accuracy: AccuracyResult, subfigure: Any) -> None:
    panels = subfigure.subplots(2, 1, sharex=True, gridspec_kw={"top": 0.9, "bottom": 0.15, "left": 0.11})
    shown = accuracy.paths[:MOST]
    for panel, name, title in zip(panels, ("offsets", "scatters"), ("barycentre off", "mean + 3 S"), strict=True):
        curves = [np.array(getattr(item, name)) for item in shown]
        scale, unit = scale_of(np.concatenate(curves), "m")
        for color, item, values in zip(CYCLE, shown, curves, strict=False):
            panel.plot(item.along, scale * values, color=color, label=literal(f"path {item.name}"))
        panel.set_ylabel(f"{title}, {unit}")
    panels[0].legend()
    panels[1].set_xlabel("length along the path, m")
