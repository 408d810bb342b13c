"""Fits of stiffness and damping, and identified masses and friction: drawn and as pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.dynamics.result import IdentifyResult
from ...identification.from_motion import ForcesResult
from ...identification.stiffness.result import Estimate, FitResult
from ...robot.coordinates import force_unit_of
from ..report import Report, drawn, sorted_notes
from ..style import (
    BAR_ROOM,
    COLORS,
    PROGRAM_COLOR,
    Plotted,
    bars_in_pairs,
    check_kind,
    label_rows,
    literal,
    row_panel,
    sheet,
)
from .tables import ends, number, table

_ROW = 0.22  # inches of a parameter, or of a drive
_MOST = 40
_PARTS = ("fitted", "held out")
_DRIVES, _SAMPLES = 6, 2000  # of drives over time, and of each


def fit_page(fit: FitResult) -> Report:
    """A page about a fit of stiffness and damping: values with intervals, beside what is described."""
    share = f"{100 * fit.confidence:g} %"
    estimates = fit.estimates
    rows = [
        (
            name,
            number(estimate.value),
            number(estimate.standard_error, 1.0, 2),
            *ends(estimate.low, estimate.high),
            number(estimate.described),
            number(estimate.width, 1.0, 3),
            number(estimate.unexplained, 100.0, 3),
        )
        for name, estimate in estimates.items()
    ]
    head = ("parameter", "value, SI", "std. error", f"{share} from", f"{share} to", "described", "filter, s")
    text = f"Fitted over described values, with {share} intervals."
    figures = [("fit", text, plot_fit)] if _drawn(estimates) else []
    noise = [(entry.coordinate, number(entry.noise, 1.0, 3)) for entry in fit.fitted]
    return Report(
        title=fit.title,
        summary=(_fitted_in_all(fit),),
        warnings=fit.warnings,
        notes=fit.notes,
        figures=drawn(fit, figures),
        tables=(
            *table("Numbers" if fit.numbers else "Stiffness and damping", (*head, "unexplained, %"), rows),
            *table("Noise of the coordinates", ("coordinate", "std. deviation, m or rad"), noise),
        ),
    )


def _fitted_in_all(fit: FitResult) -> str:
    if fit.numbers:
        return f"{len(fit.numbers)} parameters"
    entries = sum(len(matrix.entries) for matrix in fit.matrices)
    text = f"{len(fit.estimates) - entries} parameters of {len(fit.fitted)} coordinates"
    return f"{text}, {entries} entries of {len(fit.matrices)} matrices" if entries else text


def forces_page(forces: ForcesResult) -> Report:
    """A page about forces of a measured motion: the largest of each over time, with its unit."""
    facts = forces.as_dict()["coordinates"]
    rows = [
        (name, force_unit_of(name), *(number(entry["value"]) for entry in parts.values()))
        for name, parts in facts.items()
    ]
    return Report(
        title=f"{forces.robot}: forces of a measured motion",
        summary=(f"{len(forces.t)} samples, {len(rows)} coordinates",),
        warnings=sorted_notes(forces.notes)[0],
        notes=sorted_notes(forces.notes)[1],
        tables=(*table("Largest values over time", ("coordinate", "unit", *forces.parts), rows),),
    )


def _drawn(estimates: dict[str, Estimate]) -> list[str]:
    """Names of the estimates whose described value they can be compared with."""
    return [name for name, estimate in estimates.items() if estimate.described][:_MOST]


def plot_fit(fit: FitResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot fitted over described values with their intervals.

    Args:
        fit: of ``identification.fit``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``fit`` is something else, or as of ``style.sheet``.
    """
    check_kind(fit, FitResult, "fit", "identification.fit")
    estimates = fit.estimates
    names = _drawn(estimates)
    with sheet(6.4, 1.0 + _ROW * len(names), path, fit.title, ax) as drawn:
        [axes] = drawn.panels(1, lambda figure: row_panel(figure, 0.28, 0.69))
        rows = label_rows(axes, names)
        values = np.array([[x.low, x.value, x.high] for x in (estimates[name] for name in names)]).reshape(-1, 3)
        values /= np.array([[estimates[name].described] for name in names]).reshape(-1, 1)
        axes.axvline(1.0, color=PROGRAM_COLOR, linewidth=0.9)
        half = np.abs(np.diff(values, axis=1)).T
        axes.errorbar(values[:, 1], rows, xerr=half, fmt="o", markersize=3.0, capsize=2.0, color=COLORS["m"]["x"])
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("fitted over described")
    return drawn.outcome


def identify_page(identified: IdentifyResult) -> Report:
    """A page about identified masses and friction: base parameters, residuals of drives fitted and held out."""
    values = zip(
        identified.base_names, identified.base_values, identified.deviations, identified.described, strict=True
    )
    rows = [(name, number(x), number(deviation, 1.0, 2), number(said)) for name, x, deviation, said in values]
    drives = [
        (
            name,
            force_unit_of(name),
            number(x.fitted, 1.0, 4),
            number(x.held_out, 1.0, 4),
            *(number(share, 100.0, 3) for share in x.relative),
            str(x.samples),
        )
        for name, x in identified.residuals.items()
    ]
    head = ("drive", "unit", "fitted", "held out", "fitted, % of the drive's rms", "held out, %", "samples")
    single = [(name, number(value)) for name, value in identified.parameters.items()]
    text = "Rms of what is left over that of the drive, fitted and held out."
    figures = [("drives", text, plot_identified)]
    if identified.t.size:
        text = "Drives as measured and by what was identified, and what is left where it counts."
        figures.append(("over_time", text, plot_identification))
    others = [(name, number(x.value), number(x.deviation, 1.0, 2), x.unit) for name, x in identified.further.items()]
    return Report(
        title=f"{identified.base.robot}: {len(identified.base)} base parameters",
        summary=(f"{len(identified.residuals)} drives, filter of {number(identified.width, 1.0, 3)} s",),
        warnings=identified.warnings,
        notes=identified.notes,
        figures=drawn(identified, figures if drives else []),
        tables=(
            *table("Residuals of drives, rms", head, drives),
            *table("Base parameters, SI units", ("parameter", "value", "std. deviation", "described"), rows),
            *table("Further parameters", ("parameter", "value", "std. deviation", "unit"), others),
            *table("Bodies that have them, SI units", ("parameter", "value"), single),
        ),
    )


def plot_identified(identified: IdentifyResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot residuals of each drive over its rms, fitted and held out.

    Args:
        identified: of ``identification.identify``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``identified`` is something else, or as of ``style.sheet``.
    """
    check_kind(identified, IdentifyResult, "identified", "identification.identify")
    shares = {kind: [100.0 * x.relative[k] for x in identified.residuals.values()] for k, kind in enumerate(_PARTS)}
    title = f"{identified.base.robot}: what base parameters leave of the drives"
    label = "rms of the residual over that of the drive, %"
    with sheet(6.4, BAR_ROOM + _ROW * len(identified.residuals), path, title, ax) as drawn:
        bars_in_pairs(drawn, list(identified.residuals), shares, label, left=0.2)
    return drawn.outcome


def plot_identification(identified: IdentifyResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot measured and fitted drives over time, and the residual where it counts, of the first six.

    Args:
        identified: of ``identification.identify``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in, one for each drive.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``identified`` is something else, or as of ``style.sheet``.
    """
    check_kind(identified, IdentifyResult, "identified", "identification.identify")
    names = list(identified.residuals)[:_DRIVES]
    every = max(1, len(identified.t) // _SAMPLES)
    t, drives, fitted = identified.t[::every], identified.drives[::every], identified.fitted[::every]
    left = np.where(identified.kept[::every], drives - fitted, np.nan)
    height = 1.0 + 1.5 * len(names)
    title = f"{identified.base.robot}: drives, measured and by what was identified"
    with sheet(6.4, height, path, title, ax) as drawn:
        room = {"top": 1.0 - 0.6 / height, "bottom": 0.45 / height, "left": 0.12, "right": 0.98, "hspace": 0.25}
        panels = drawn.panels(
            len(names), lambda figure: figure.subplots(len(names), 1, sharex=True, squeeze=False, gridspec_kw=room)
        )
        for row, (axes, name) in enumerate(zip(panels, names, strict=True)):
            axes.plot(t, drives[:, row], color=COLORS["m"]["x"], label="measured")
            axes.plot(t, fitted[:, row], color=COLORS["m"]["y"], label="fitted")
            axes.plot(t, left[:, row], color=COLORS["m"]["z"], label="residual")
            axes.set_ylabel(f"{literal(name)}, {force_unit_of(name)}")
        panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
        panels[-1].set_xlabel("time, s")
    return drawn.outcome
