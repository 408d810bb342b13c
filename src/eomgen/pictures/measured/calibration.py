"""Calibrations: residuals of variants, what was found with its intervals, and a page of both."""

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


def calibration_page(found: CalibrationResult) -> Report:
    """A page about a calibration: residuals, values with deviations, what merges, what is weak, what was mistrusted."""
    lines = [f"{found.rows} poses of {found.source}" if found.source else f"{found.rows} poses"]
    lines += [f"rank {found.rank}, {found.rank_above_noise} combinations above the noise; values of {found.variant!r}"]
    lines += found.summary_lines()
    figures = [("residuals", "Rms of residuals per axis by variant, fitted and held out.", plot_calibration)]
    if _changed(found):
        text = f"Changes from the description, with {100 * found.confidence:g} % intervals; what merges is left out."
        figures.append(("changes", text, plot_changes))
    mistrusted = [(str(row), f"{weight:.2f}") for row, weight in found.mistrusted]
    return Report(
        title=f"{found.robot}: calibration by {found.rows} poses",
        summary=tuple(lines),
        warnings=found.notes,
        figures=drawn(found, figures),
        tables=(
            _residual_table(found),
            _value_table(found),
            *merged_table(found.merged),
            *weak_table(found.weak),
            *table("Mistrusted rows", ("row", "weight"), mistrusted),
        ),
    )


def _residual_table(found: CalibrationResult) -> Table:
    kinds = [kind for kind, _ in _KINDS if kind in found.residuals["full"]["fitted"]]
    parts_of = {
        "fitted": "per axis",
        "fitted_norm": "norm",
        "held_out": "held out, per axis",
        "held_out_norm": "held out, norm",
    }
    head = [f"{kind}, {_UNITS[kind]}, {text}" for kind in kinds for text in parts_of.values()]
    rows = []
    for name in VARIANTS:
        if name in found.residuals:
            parts = found.residuals[name]
            cells = [number(parts.get(part, {}).get(kind), 1e3, 4) for kind in kinds for part in parts_of]
            rows.append((name, *cells))
    return Table("Rms of residuals", ("variant", *head), tuple(rows))


def _value_table(found: CalibrationResult) -> Table:
    low, high = found.intervals()
    columns = (found.values, found.deviations, low, high, found.described)
    digits = (7, 2, 7, 7, 7)
    rows = tuple(
        (name, *(number(x[i], 1.0, n) for x, n in zip(columns, digits, strict=True)), found.units[i])
        for i, name in enumerate(found.names)
        if name not in found.merged
    )
    share = f"{100 * found.confidence:g} %"
    head = ("quantity", "value", "std. deviation", f"{share} from", f"{share} to", "described", "unit")
    return Table("Values", head, rows)


def plot_calibration(found: CalibrationResult, path: Path | str) -> Path:
    """Draw rms of residuals by variant, of positions and orientations; returns the path, errors as of ``canvas``."""
    kinds = [entry for entry in _KINDS if entry[0] in found.residuals["full"]["fitted"]]
    with canvas(3.6 * len(kinds), 3.0, path, f"{found.robot}: rms of residuals of {found.rows} poses") as figure:
        room = {"top": 0.86, "bottom": 0.12, "left": 0.22 / len(kinds), "right": 0.98, "wspace": 0.3}
        panels = figure.subplots(1, len(kinds), squeeze=False, gridspec_kw=room)
        for axes, (kind, unit) in zip(panels[0], kinds, strict=True):
            _bars(found, axes, kind, unit)
        panels[0][0].legend(loc="upper right")
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


def plot_changes(found: CalibrationResult, path: Path | str) -> Path:
    """Changes of what is identifiable from the description with intervals, lengths and angles; returns the path.

    Of each unit those are drawn that are changed by most of their intervals.  Errors as of ``canvas``.
    """
    panels = _changed(found)
    rows = max(len(places) for places in panels.values())
    with canvas(3.7 * len(panels), 1.1 + _ROW * rows, path, f"{found.robot}: changes from the description") as figure:
        top, bottom = 1.0 - 0.35 / (1.1 + _ROW * rows), 0.5 / (1.1 + _ROW * rows)
        room = {"top": top, "bottom": bottom, "left": 0.52 / len(panels), "right": 0.98, "wspace": 1.1}
        drawn_on = figure.subplots(1, len(panels), squeeze=False, gridspec_kw=room)[0]
        for axes, (unit, places) in zip(drawn_on, panels.items(), strict=True):
            _intervals(found, axes, unit, places)
    return Path(path)


def _changed(found: CalibrationResult) -> dict[str, list[int]]:
    """Places of the quantities to draw, by their unit: m and rad."""
    changes = np.abs(found.values - found.described)
    panels = {}
    for unit in ("m", "rad"):
        places = [
            i
            for i, name in enumerate(found.names)
            if found.units[i] == unit and name not in found.merged and np.isfinite(changes[i])
        ]
        places.sort(key=lambda i: -changes[i] / max(found.deviations[i], 1e-300))
        if places:
            panels[unit] = places[:_MOST]
    return panels


def _intervals(found: CalibrationResult, axes: Any, unit: str, places: list[int]) -> None:
    changes = (found.values - found.described)[places]
    factor, prefixed = scale_of(changes, unit)
    half = factor * found.quantile * found.deviations[places]
    rows = np.arange(len(places))[::-1]
    axes.axvline(0.0, color=PROGRAM_COLOR, linewidth=0.9)
    axes.errorbar(factor * changes, rows, xerr=half, fmt="o", markersize=3.0, capsize=2.0, color=COLORS["m"]["x"])
    names = [found.names[i].removeprefix("joints.") for i in places]
    axes.set_yticks(rows, [literal(name) for name in names])
    axes.set_ylim(-0.7, len(places) - 0.3)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(f"change, {prefixed}")
