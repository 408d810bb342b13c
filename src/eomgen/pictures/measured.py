"""Figures about measurements: calibrations, identified drives, ISO 9283, motions that excite, corrected programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..identification.calibration.result import CalibrationResult
from ..identification.compensating.result import AXES, CompensationResult
from ..identification.dynamics.result import IdentifyResult
from ..identification.exciting.excited import ExciteResult
from ..identification.iso_9283.result import AccuracyResult
from ..robot.coordinates import force_unit_of, unit_of
from .style import COLORS, FULL_WIDTH, PROGRAM_COLOR, canvas, literal, scale_of, title_of

CYCLE = tuple(color for colors in COLORS.values() for color in colors.values())
MOST = len(CYCLE)  # poses, and paths, that are drawn
SAMPLES = 2000  # of a curve that are drawn
_KINDS = (("position", "m"), ("orientation", "rad"))


def plot_calibration(found: CalibrationResult, path: Path | str) -> Path:
    """Rms of residuals by variant, a panel for positions and one for orientations; returns the path.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    kinds = [entry for entry in _KINDS if entry[0] in found.residuals["full"]["fitted"]]
    with canvas(3.6 * len(kinds), 3.0, path) as figure:
        room = {"top": 0.86, "bottom": 0.12, "left": 0.18 / len(kinds), "right": 0.98, "wspace": 0.3}
        panels = figure.subplots(1, len(kinds), squeeze=False, gridspec_kw=room)
        for axes, (kind, unit) in zip(panels[0], kinds, strict=True):
            _bars(found, axes, kind, unit)
        panels[0][0].legend(loc="upper right")
        title_of(figure, f"{found.robot}: rms of residuals of {found.rows} poses")
    return Path(path)


def _bars(found: CalibrationResult, axes: Any, kind: str, unit: str) -> None:
    names = list(found.residuals)
    fitted = np.array([found.residuals[name]["fitted"][kind] for name in names])
    held = np.array([found.residuals[name]["held_out"].get(kind, np.nan) for name in names])
    factor, prefixed = scale_of(fitted, unit)
    places = np.arange(len(names))
    axes.bar(places - 0.2, factor * fitted, 0.38, color=COLORS["m"]["x"], label="fitted")
    if np.isfinite(held).any():
        axes.bar(places + 0.2, factor * held, 0.38, color=COLORS["m"]["y"], label="held out")
    axes.set_yscale("log")
    axes.set_xticks(places, names)
    axes.set_ylabel(f"{kind}, {prefixed}")


def plot_identification(found: IdentifyResult, path: Path | str) -> Path:
    """Measured and fitted drives over time, and what is left where it counts, of the first six; returns the path.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    names = list(found.residuals)[:MOST]
    every = max(1, len(found.t) // SAMPLES)
    t, drives, fitted = found.t[::every], found.drives[::every], found.fitted[::every]
    left = np.where(found.kept[::every], drives - fitted, np.nan)
    with canvas(6.4, 1.0 + 1.5 * len(names), path) as figure:
        height = 1.0 + 1.5 * len(names)
        room = {"top": 1.0 - 0.45 / height, "bottom": 0.55 / height, "left": 0.12, "right": 0.98, "hspace": 0.25}
        panels = figure.subplots(len(names), 1, sharex=True, squeeze=False, gridspec_kw=room)[:, 0]
        for row, (axes, name) in enumerate(zip(panels, names, strict=True)):
            axes.plot(t, drives[:, row], color=COLORS["m"]["x"], label="measured")
            axes.plot(t, fitted[:, row], color=COLORS["m"]["y"], label="fitted")
            axes.plot(t, left[:, row], color=COLORS["m"]["z"], label="residual")
            axes.set_ylabel(f"{literal(name)}, {force_unit_of(name)}")
        panels[0].legend(loc="upper right", ncols=3)
        panels[-1].set_xlabel("t, s")
        title_of(figure, f"{found.base.robot}: drives, measured and by what was identified")
    return Path(path)


def plot_accuracy(found: AccuracyResult, path: Path | str) -> Path:
    """Attained positions less the command, with a circle of the repeatability about each barycentre, and the offset of
    the barycentre and the repeatability along paths; of the first six of each.  Returns the path.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    with canvas(6.4, 3.4 * (bool(found.poses) + bool(found.paths)), path) as figure:
        rows = figure.subfigures(bool(found.poses) + bool(found.paths), 1, squeeze=False)[:, 0].tolist()
        if found.poses:
            _poses(found, rows.pop(0))
        if found.paths:
            _paths(found, rows.pop(0))
        title_of(figure, f"{found.robot or found.frame}: accuracy by ISO 9283, {found.source}")
    return Path(path)


def _poses(found: AccuracyResult, part: Any) -> None:
    panels = part.subplots(1, 2, gridspec_kw={"top": 0.86, "bottom": 0.15, "left": 0.11, "wspace": 0.35})
    shown = found.poses[:MOST]
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


def _paths(found: AccuracyResult, part: Any) -> None:
    panels = part.subplots(2, 1, sharex=True, gridspec_kw={"top": 0.9, "bottom": 0.15, "left": 0.11})
    shown = found.paths[:MOST]
    for panel, name, title in zip(panels, ("offsets", "scatters"), ("barycentre off", "mean + 3 S"), strict=True):
        curves = [np.array(getattr(item, name)) for item in shown]
        scale, unit = scale_of(np.concatenate(curves), "m")
        for color, item, values in zip(CYCLE, shown, curves, strict=False):
            panel.plot(item.along, scale * values, color=color, label=literal(f"path {item.name}"))
        panel.set_ylabel(f"{title}, {unit}")
    panels[0].legend()
    panels[1].set_xlabel("length along the path, m")


def plot_compensation(found: CompensationResult, path: Path | str) -> Path:
    """The tool's errors over time along and about its axes, without the correction above and with it below.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    colors = tuple(COLORS["m"].values())
    with canvas(6.8, 4.4, path) as figure:
        room = {"top": 0.88, "bottom": 0.12, "left": 0.1, "right": 0.98, "wspace": 0.3, "hspace": 0.2}
        panels = figure.subplots(2, 2, sharex=True, gridspec_kw=room)
        for row, (name, error) in zip(panels, (("before", found.before), ("after", found.after)), strict=True):
            for panel, first, unit in zip(row, (0, 3), ("m", "rad"), strict=True):
                part = error[:, first : first + 3]
                scale, prefixed = scale_of(part, unit)
                for color, axis, column in zip(colors, AXES[first:], part.T, strict=False):
                    panel.plot(found.times, scale * column, color=color, label=axis)
                panel.set_ylabel(f"{name}, {prefixed}")
        for panel in panels[0]:
            panel.legend(loc="upper right")
        for panel in panels[1]:
            panel.set_xlabel("t, s")
        title_of(figure, f"{found.robot}: {found.frame} off its program, in its own axes")
    return Path(path)


def plot_excitation(found: ExciteResult, path: Path | str) -> Path:
    """Positions, rates and drives over the period with their limits, a row for each of the first six coordinates;
    returns the path.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    shown = found.coordinates[:MOST]
    height = 1.0 + 0.95 * len(shown)
    with canvas(FULL_WIDTH, height, path) as figure:
        room = {"top": 1.0 - 0.5 / height, "bottom": 0.42 / height, "left": 0.1, "right": 0.985, "wspace": 0.32}
        panels = figure.subplots(len(shown), 3, sharex=True, squeeze=False, gridspec_kw=room)
        for i, (name, row) in enumerate(zip(shown, panels, strict=True)):
            unit, values = unit_of(name), (found.q, found.v, found.u)
            units = (unit, f"{unit}/s", force_unit_of(name))
            for panel, kind, kept, own in zip(row, ("position", "rate", "drive"), values, units, strict=True):
                panel.plot(found.t, kept[:, i], color=CYCLE[i])
                panel.set_ylabel(own)
                for limit in _limits(found, f"{name} {kind}"):
                    panel.axhline(limit, color=PROGRAM_COLOR, linestyle="--", linewidth=0.9)
                if i == 0:
                    panel.set_title(kind)
            row[0].set_ylabel(f"{literal(name)}\n{unit}")
        for panel in panels[-1]:
            panel.set_xlabel("time, s")
        title_of(figure, f"{found.robot}: a motion that excites {len(found.base)} base parameters")
    return Path(path)


def _limits(found: ExciteResult, name: str) -> list[float]:
    """Limits of that name, without infinite ones."""
    rows = [i for i, own in enumerate(found.limited) if own == name]
    return [float(x) for i in rows for x in found.limits[i] if np.isfinite(x)]
