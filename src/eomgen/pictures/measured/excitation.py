"""Motions that excite drawn and as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.exciting.result import ExciteResult
from ...robot.coordinates import force_unit_of, unit_of
from ..report import Report, drawn, sorted_notes
from ..style import CYCLE, FULL_WIDTH, PROGRAM_COLOR, Plotted, check_kind, literal, sheet
from .accuracy import MOST
from .tables import number, table


def excitation_page(excitation: ExciteResult) -> Report:
    """A page about an exciting motion: its information beside others', limits, expected deviations."""
    compared = [
        (label, *(number(x, 1.0, 4) for x in (figure.found, figure.start, figure.random)))
        for label, figure in (
            ("condition number", excitation.condition),
            ("mean deviation over size", excitation.deviation),
        )
    ]
    limits = [
        (name, unit, *(number(x, 1.0, 4) for x in (*reached, *allowed)), number(used, 100.0, 3))
        for name, unit, allowed, reached, used in zip(
            excitation.limited,
            excitation.units,
            excitation.limits.tolist(),
            excitation.extremes.tolist(),
            excitation.used.tolist(),
            strict=True,
        )
    ]
    told = zip(excitation.base.names, excitation.deviations, excitation.sizes, strict=True)
    text = "Positions, rates and drives over the period with their limits."
    series = excitation.series
    return Report(
        title=f"{excitation.robot}: an exciting motion of {len(excitation.base)} base parameters",
        summary=(
            f"{series.duration:g} s, {series.harmonics} harmonics of {1.0 / series.duration:.4g} Hz,"
            f" {len(excitation.t)} samples",
            f"criterion {excitation.criterion}; median of {excitation.randoms} random motions, seed {excitation.seed}",
        ),
        warnings=sorted_notes(excitation.notes)[0],
        notes=sorted_notes(excitation.notes)[1],
        figures=drawn(excitation, [("motion", text, plot_excitation)]),
        tables=(
            *table("Beside others", ("", "this motion", "its start", "random"), compared),
            *table("Limits", ("of", "unit", "least", "greatest", "allowed from", "to", "used, %"), limits),
            *table(
                "Expected standard deviations, SI units",
                ("parameter", "std. deviation", "size"),
                [(name, number(deviation, 1.0, 3), number(size, 1.0, 3)) for name, deviation, size in told],
            ),
        ),
    )


def plot_excitation(excitation: ExciteResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot positions, velocities and drives over the period with their limits, of the first six coordinates.

    Args:
        excitation: of ``identification.excite``.
        path: to write to, .png, .svg or .pdf.
        ax: three axes for each coordinate, row by row.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``excitation`` is something else, or as of ``style.sheet``.
    """
    check_kind(excitation, ExciteResult, "excitation", "identification.excite")
    shown = excitation.coordinates[:MOST]
    height = 1.0 + 0.95 * len(shown)
    title = f"{excitation.robot}: an exciting motion of {len(excitation.base)} base parameters"
    with sheet(FULL_WIDTH, height, path, title, ax) as drawn:
        room = {"top": 1.0 - 0.5 / height, "bottom": 0.42 / height, "left": 0.1, "right": 0.985, "wspace": 0.32}
        panels = drawn.panels(
            3 * len(shown),
            lambda figure: figure.subplots(len(shown), 3, sharex=True, squeeze=False, gridspec_kw=room),
        )
        for i, name in enumerate(shown):
            row = panels[3 * i : 3 * i + 3]
            unit, values = unit_of(name), (excitation.q, excitation.v, excitation.u)
            units = (unit, f"{unit}/s", force_unit_of(name))
            for panel, kind, kept, panel_unit in zip(row, ("position", "rate", "drive"), values, units, strict=True):
                panel.plot(excitation.t, kept[:, i], color=CYCLE[i])
                panel.set_ylabel(panel_unit)
                for limit in _limits(excitation, f"{name} {kind}"):
                    panel.axhline(limit, color=PROGRAM_COLOR, linestyle="--", linewidth=0.9)
                if i == 0:
                    panel.set_title("velocity" if kind == "rate" else kind)
            row[0].set_ylabel(f"{literal(name)}\n{unit}")
        for panel in panels[-3:]:
            panel.set_xlabel("time, s")
    return drawn.outcome


def _limits(excitation: ExciteResult, name: str) -> list[float]:
    """Limits of that name, without infinite ones."""
    rows = [i for i, limited in enumerate(excitation.limited) if limited == name]
    return [float(x) for i in rows for x in excitation.limits[i] if np.isfinite(x)]
