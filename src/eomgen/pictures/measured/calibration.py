"""Calibrations: residuals of variants, identified values with intervals, and a page of both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...identification.calibration.result import CalibrationResult
from ...identification.calibration.variants import VARIANTS
from ...shown import scale_of
from ..report import Report, Table, drawn, sorted_notes
from ..style import COLORS, PROGRAM_COLOR, Plotted, check_kind, literal, sheet
from .tables import ends, merged_table, number, table, weak_table

_KINDS = (("position", "m"), ("orientation", "rad"))
_UNITS = {"position": "mm", "orientation": "mrad"}
_MOST = 40  # parameters of a panel
_ROW = 0.14  # inches of one of them


def calibration_page(calibration: CalibrationResult) -> Report:
    """A page about a calibration: residuals, values with deviations, identifiability, outliers."""
    lines = [f"{calibration.rows} poses of {calibration.source}" if calibration.source else f"{calibration.rows} poses"]
    ranks = f"rank {calibration.rank}, {calibration.rank_above_noise} combinations above the noise"
    lines.append(f"{ranks}; values of {calibration.variant!r}")
    lines += calibration.summary_lines()
    figures = [("residuals", "Rms of residuals per axis by variant, fitted and held out.", plot_calibration)]
    if _changed(calibration):
        text = (
            f"Changes from the description, with {100 * calibration.confidence:g} % intervals; identifiable ones alone."
        )
        figures.append(("changes", text, plot_changes))
    mistrusted = [(str(row), f"{weight:.2f}") for row, weight in calibration.mistrusted]
    return Report(
        title=f"{calibration.robot}: calibration by {calibration.rows} poses",
        summary=tuple(lines),
        warnings=sorted_notes(calibration.notes)[0],
        notes=sorted_notes(calibration.notes)[1],
        figures=drawn(calibration, figures),
        tables=(
            _residual_table(calibration),
            _value_table(calibration),
            *merged_table(calibration.merged),
            *weak_table(calibration.weak),
            *table("Rows down-weighted as outliers", ("row", "weight"), mistrusted),
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
    rows = tuple(
        (
            name,
            number(calibration.values[i], 1.0, 7),
            number(calibration.deviations[i], 1.0, 2),
            *ends(low[i], high[i]),
            number(calibration.described[i], 1.0, 7),
            calibration.units[i],
        )
        for i, name in enumerate(calibration.names)
        if name not in calibration.merged
    )
    share = f"{100 * calibration.confidence:g} %"
    head = ("parameter", "value", "std. deviation", f"{share} from", f"{share} to", "described", "unit")
    return Table("Values", head, rows)


def plot_calibration(calibration: CalibrationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot the rms of residuals by variant, of positions and orientations.

    Args:
        calibration: of ``identification.calibrate``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, one for positions, one for orientations where they were measured.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``calibration`` is something else, or as of ``style.sheet``.
    """
    check_kind(calibration, CalibrationResult, "calibration", "identification.calibrate")
    kinds = [entry for entry in _KINDS if entry[0] in calibration.residuals["full"]["fitted"]]
    title = f"{calibration.robot}: rms of residuals of {calibration.rows} poses"
    with sheet(3.6 * len(kinds), 3.0, path, title, ax) as drawn:
        room = {"top": 0.8, "bottom": 0.12, "left": 0.22 / len(kinds), "right": 0.98, "wspace": 0.3}
        panels = drawn.panels(
            len(kinds), lambda figure: figure.subplots(1, len(kinds), squeeze=False, gridspec_kw=room)
        )
        for axes, (kind, unit) in zip(panels, kinds, strict=True):
            _bars(calibration, axes, kind, unit)
        panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
    return drawn.outcome


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


def plot_changes(calibration: CalibrationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot changes of what is identifiable from the description with intervals, lengths and angles.

    Of each unit those are drawn that are changed by most of their intervals.

    Args:
        calibration: of ``identification.calibrate``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, one for each unit.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``calibration`` is something else, or as of ``style.sheet``.
    """
    check_kind(calibration, CalibrationResult, "calibration", "identification.calibrate")
    panels = _changed(calibration)
    height = 1.1 + _ROW * max((len(places) for places in panels.values()), default=0)
    if not panels:
        raise InputError(f"calibration: of {calibration.robot} nothing that is identifiable was changed")
    with sheet(3.7 * len(panels), height, path, f"{calibration.robot}: changes from the description", ax) as drawn:
        top, bottom = 1.0 - 0.35 / height, 0.5 / height
        room = {"top": top, "bottom": bottom, "left": 0.52 / len(panels), "right": 0.98, "wspace": 1.1}
        drawn_on = drawn.panels(
            len(panels), lambda figure: figure.subplots(1, len(panels), squeeze=False, gridspec_kw=room)
        )
        for axes, (unit, places) in zip(drawn_on, panels.items(), strict=True):
            _intervals(calibration, axes, unit, places)
    return drawn.outcome


def _changed(calibration: CalibrationResult) -> dict[str, list[int]]:
    """Places of the parameters to draw, by their unit: m and rad."""
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
