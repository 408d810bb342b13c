"""Figures of a sweep: how a recorded number is distributed, and what it goes with."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import as_path
from ..results.beside import SWEEP_FIGURES
from ..shown import scale_of
from ..sweep.result import SweepResult
from .style import COLORS, PROGRAM_COLOR, Plotted, check_kind, literal, sheet

MOST_BARS = 15


def plot_sweep(
    result: SweepResult, folder: Path | str | None = None, column: str | None = None, *, ax: Any = None
) -> Plotted:
    """Plot how a recorded number is distributed, and what it goes with: two files in a folder, or one figure.

    Args:
        result: of ``sweep.run`` or ``load_result``.
        folder: to write distribution.png and sensitivity.png to; made where it does not exist.
        column: of the record; the first where it is None.
        ax: two axes to draw in, instead of a folder.

    Returns:
        The two paths where there is a folder, else the figure and its two axes.

    Raises:
        UnknownNameError: there is no such column.
        InputError: ``result`` is something else, the folder is no path or cannot be written, there are both a folder
            and ``ax``, or Matplotlib is not installed.
    """
    target = None if folder is None else as_path(folder, "folder")
    if target is None:
        return plot_column(result, column, ax=ax)
    if ax is not None:
        raise InputError("ax: comes together with a folder, which has a file for each plot; allowed: one of both")
    column = _column(result, column)
    written: list[Path] = []
    for name, draw, left in zip(SWEEP_FIGURES, DRAWS, (0.1, 0.36), strict=True):
        with sheet(6.4, 3.8, target / f"{name}.png", f"{result.meta['robot']}: {column}") as drawn:
            [axes] = drawn.panels(1, partial(_single_panel, left=left))
            draw(result, column, axes)
            _legend_above(axes, 3)
        written.append(drawn.outcome)
    return written


def plot_column(
    result: SweepResult, column: str | None = None, path: Path | str | None = None, *, ax: Any = None
) -> Plotted:
    """Plot how a recorded number of a sweep is distributed, beside what it goes with, in one figure.

    Args:
        result, column: as of ``plot_sweep``.
        path: to write to, .png, .svg or .pdf.
        ax: two axes to draw in.

    Returns:
        The path where there is one, else the figure and its two axes.

    Raises:
        UnknownNameError: there is no such column.
        InputError: ``result`` is something else, or as of ``style.sheet``.
    """
    column = _column(result, column)
    with sheet(7.4, 3.6, path, f"{result.meta['robot']}: {column}", ax) as drawn:
        room = {"top": 0.76, "bottom": 0.14, "left": 0.08, "right": 0.98, "wspace": 0.62}
        panels = drawn.panels(2, lambda figure: figure.subplots(1, 2, gridspec_kw=room))
        for draw, axes in zip(DRAWS, panels, strict=True):
            draw(result, column, axes)
            _legend_above(axes, 2)
    return drawn.outcome


def _column(result: SweepResult, column: str | None) -> str:
    """Return the name of a column that the record of a sweep has; errors as of ``plot_sweep``."""
    check_kind(result, SweepResult, "result", "sweep.run or load_result")
    if column is None:
        return result.columns[0]
    result.of(column)  # or it is said that there is none
    return column


def _single_panel(figure: Any, left: float) -> Any:
    return figure.add_axes((left, 0.13, 0.96 - left, 0.68))


def _distribution(result: SweepResult, column: str, axes: Any) -> None:
    values = result.of(column)
    values = values[np.isfinite(values)]
    factor, unit = scale_of(values, result.units[column])
    axes.hist(factor * values, bins=min(60, max(5, int(np.sqrt(values.size)))), color="0.75")
    for share, style in ((50, "-"), (95, "--"), (99, ":")):
        at = factor * result.percentiles(column, (share,))[0]
        if np.isfinite(at):
            axes.axvline(at, color=COLORS["m"]["x"], linestyle=style, label=f"{share} %: {at:.3g}{unit and ' ' + unit}")
    axes.set_xlabel(literal(f"{column}, {unit or '1'}"))
    axes.set_ylabel(f"samples, of {values.size}")
    axes.grid(visible=False, axis="x")


def _sensitivity(result: SweepResult, column: str, axes: Any) -> None:
    sensitivity = result.sensitivity(column)
    chosen = sensitivity.ranking[:MOST_BARS][::-1]
    places = np.arange(len(chosen))
    label = f"regression, R$^2$ {sensitivity.r_squared:.2f}"
    axes.barh(places + 0.2, np.nan_to_num(sensitivity.regression[chosen]), 0.38, color=COLORS["m"]["x"], label=label)
    spearman = np.nan_to_num(sensitivity.spearman[chosen])
    axes.barh(places - 0.2, spearman, 0.38, color=COLORS["m"]["y"], label="rank correlation")
    noise = min(sensitivity.noise, 1.0)
    axes.axvspan(-noise, noise, color="0.9", zorder=0, label="chance")
    axes.axvline(0.0, color=PROGRAM_COLOR, linewidth=0.9)
    axes.set_yticks(places, [literal(sensitivity.names[i]) for i in chosen])
    axes.set_xlim(-1.05, 1.05)
    axes.set_xlabel("standardized coefficient, correlation")
    axes.grid(visible=False, axis="y")


def _legend_above(axes: Any, columns: int) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, handlelength=1.2, columnspacing=1.0)


DRAWS = (_distribution, _sensitivity)
