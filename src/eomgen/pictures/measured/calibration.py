"""Calibrations: residuals of variants, identified values with intervals, and a page of both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.calibration.result import CalibrationResult
from ...identification.calibration.variants import VARIANTS
from ..report import Report, Table, drawn
from ..style import COLORS, PROGRAM_COLOR, canvas, literal, scale_of
from .tables import merged_table, number, table, weak_table

_KINDS = (("position", "m"), ("orientation", "rad"))
_UNITS = {"position": "mm", "orientation": "mrad"}
_MOST = 40  # quantities of a panel
_ROW = 0.14  # inches of one of them


def calibration_page(calibration: CalibrationResult) -> Report:
    """A page about a calibration: residuals, values with deviations, what merges, what is weak, what was mistrusted."""
    lines = [f"{calibration.rows} poses of {calibration.source}" if calibration.source else f"{calibration.rows} poses"]
    ranks = f"rank {calibration.rank}, {calibration.rank_above_noise} combinations above the noise"
    lines.append(f"{ranks}; values of {calibration.variant!r}")
    lines += calibration.summary_lines()
    figures = [("residuals", "Rms of residuals per axis by variant, fitted and held out.", plot_calibration)]
    if _changed(calibration):
        text = (
            f"Changes from the description, with {100 * calibration.confidence:g} % intervals; what merges is left out."
        )
        figures.append(("changes", text, plot_changes))
    mistrusted = [(str(row), f"{weight:.2f}") for row, weight in calibration.mistrusted]
    return Report(
        title=f"{calibration.robot}: calibration by {calibration.rows} poses",
        summary=tuple(lines),
        warnings=calibration.notes,
        figures=drawn(calibration, figures),
        tables=(
            _residual_table(calibration),
            _value_table(calibration),
            *merged_table(calibration.merged),
            *weak_table(calibration.weak),
            *table("Mistrusted rows", ("row", "weight"), mistrusted),
        ),
    )


def _residual_table(calibration: CalibrationResult) -> Table:
    kinds = [kind for kind, _ in _KINDS if kind in calibration.residuals["full"]["fitted"]]
    parts_of = {
        "fitted": "per axis",
        "fitted_norm": "norm",
        "held_out": "held out, per axis",
        "held_out_norm": "held out, norm",
    }
    head = [f"{kind}, {_UNITS[kind]}, {text}" for kind in kinds for text in parts_of.values()]
    rows = []
    for name in VARIANTS:
        if name in calibration.residuals:
            parts = calibration.residuals[name]
            cells = [number(parts.get(residual, {}).get(kind), 1e3, 4) for kind in kinds for residual in parts_of]
            rows.append((name, *cells))
    return Table("Rms of residuals", ("variant", *head), tuple(rows))


def _value_table(calibration: CalibrationResult) -> Table:
    low, high = calibration.intervals()
    columns = (calibration.values, calibration.deviations, low, high, calibration.described)
    digits = (7, 2, 7, 7, 7)
    rows = tuple(
        (name, *(number(x[i], 1.0, n) for x, n in zip(columns, digits, strict=True)), calibration.units[i])
        for i, name in enumerate(calibration.names)
        if name not in calibration.merged
    )
    share = f"{100 * calibration.confidence:g} %"
    head = ("quantity", "value", "std. deviation", f"{share} from", f"{share} to", "described", "unit")
    return Table("Values", head, rows)


def plot_calibration(calibration: CalibrationResult, path: Path | str) -> Path:
    """Draw rms of residuals by variant, of positions and orientations; returns the path, errors as of ``canvas``."""
    kinds = [entry for entry in _KINDS if entry[0] in calibration.residuals["full"]["fitted"]]
    with canvas(
        3.6 * len(kinds), 3.0, path, f"{calibration.robot}: rms of residuals of {calibration.rows} poses"
    ) as figure:
        room = {"top": 0.86, "bottom": 0.12, "left": 0.22 / len(kinds), "right": 0.98, "wspace": 0.3}
        panels = figure.subplots(1, len(kinds), squeeze=False, gridspec_kw=room)
        for axes, (kind, unit) in zip(panels[0], kinds, strict=True):
            _bars(calibration, axes, kind, unit)
        panels[0][0].legend(loc="upper right")
    return Path(path)


def _bars(calibration: CalibrationResult, axes: Any, kind: str, unit: str) -> None:
    names = list(calibration.residuals)
    fitted = np.array([calibration.residuals[name]["fitted"][kind] for name in names])
    held = np.array([calibration.residuals[name]["held_out"].get(kind, np.nan) for name in names])
    factor, prefixed = scale_of(fitted, unit)
    places = np.arange(len(names))
    axes.bar(places - 0.2, factor * fitted, 0.38, color=COLORS["m"]["x"], label="fitted")
    if np.isfinite(held).any():
        axes.bar(places + 0.2, factor * held, 0.38, color=COLORS["m"]["y"], label="held out")
    axes.set_yscale("log")
    axes.set_xticks(places, names)
    axes.set_ylabel(f"{kind}, {prefixed}")


def plot_changes(calibration: CalibrationResult, path: Path | str) -> Path:
    """Changes of what is identifiable from the description with intervals, lengths and angles; returns the path.

    Of each unit those are drawn that are changed by most of their intervals.  Errors as of ``canvas``.
    """
    panels = _changed(calibration)
    rows = max(len(places) for places in panels.values())
    with canvas(
        3.7 * len(panels), 1.1 + _ROW * rows, path, f"{calibration.robot}: changes from the description"
    ) as figure:
        top, bottom = 1.0 - 0.35 / (1.1 + _ROW * rows), 0.5 / (1.1 + _ROW * rows)
        room = {"top": top, "bottom": bottom, "left": 0.52 / len(panels), "right": 0.98, "wspace": 1.1}
        drawn_on = figure.subplots(1, len(panels), squeeze=False, gridspec_kw=room)[0]
        for axes, (unit, places) in zip(drawn_on, panels.items(), strict=True):
            _intervals(calibration, axes, unit, places)
    return Path(path)


def _changed(calibration: CalibrationResult) -> dict[str, list[int]]:
    """Places of the quantities to draw, by their unit: m and rad."""
    changes = np.abs(calibration.values - calibration.described)
    panels = {}
    for unit in ("m", "rad"):
        places = [
            i
            for i, name in enumerate(calibration.names)
            if calibration.units[i] == unit and name not in calibration.merged and np.isfinite(changes[i])
        ]
        places.sort(key=lambda i: -changes[i] / max(calibration.deviations[i], 1e-300))
        if places:
            panels[unit] = places[:_MOST]
    return panels


def _intervals(calibration: CalibrationResult, axes: Any, unit: str, places: list[int]) -> None:
    changes = (calibration.values - calibration.described)[places]
    factor, prefixed = scale_of(changes, unit)
    half = factor * calibration.quantile * calibration.deviations[places]
    rows = np.arange(len(places))[::-1]
    axes.axvline(0.0, color=PROGRAM_COLOR, linewidth=0.9)
    axes.errorbar(factor * changes, rows, xerr=half, fmt="o", markersize=3.0, capsize=2.0, color=COLORS["m"]["x"])
    names = [calibration.names[i].removeprefix("joints.") for i in places]
    axes.set_yticks(rows, [literal(name) for name in names])
    axes.set_ylim(-0.7, len(places) - 0.3)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(f"change, {prefixed}")
