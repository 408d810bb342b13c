"""Figures of a sweep: how a recorded number is distributed, and what it goes with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..files import as_path
from ..optional import optional_import
from ..sweep.result import SweepResult

MOST_BARS = 15


def plot_sweep(result: SweepResult, folder: Path | str, column: str | None = None) -> list[Path]:
    """Write distribution.png and sensitivity.png of a column (default: the first) and return their paths.

    Raises:
        InputError: Matplotlib is not installed, or the folder is no path.
    """
    target = as_path(folder, "folder")
    with optional_import("Matplotlib", "plots need"):
        import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot

    column = column or result.columns[0]
    written = []
    for name, draw in (("distribution.png", _distribution), ("sensitivity.png", _sensitivity)):
        figure, axes = pyplot.subplots(figsize=(8.0, 4.5), layout="constrained")
        draw(result, column, axes)
        target.mkdir(parents=True, exist_ok=True)
        figure.savefig(target / name, dpi=150)
        pyplot.close(figure)
        written.append(target / name)
    return written


def _distribution(result: SweepResult, column: str, axes: Any) -> None:
    values = result.of(column)
    values = values[np.isfinite(values)]
    axes.hist(values, bins=min(60, max(5, int(np.sqrt(values.size)))), color="0.75")
    for share, style in ((50, "-"), (95, "--"), (99, ":")):
        at = result.percentiles(column, (share,))[0]
        if np.isfinite(at):
            axes.axvline(at, color="C0", linestyle=style, label=f"{share} %: {at:.3g} {result.units[column]}")
    axes.set_xlabel(f"{column}, {result.units[column] or '1'}")
    axes.set_ylabel("samples")
    axes.legend()


def _sensitivity(result: SweepResult, column: str, axes: Any) -> None:
    sensitivity = result.sensitivity(column)
    chosen = sensitivity.ranking[:MOST_BARS][::-1]
    places = np.arange(len(chosen))
    axes.barh(
        places + 0.2,
        np.nan_to_num(sensitivity.regression[chosen]),
        0.4,
        label=f"regression, R$^2$ {sensitivity.r_squared:.2f}",
    )
    axes.barh(places - 0.2, np.nan_to_num(sensitivity.spearman[chosen]), 0.4, label="rank correlation")
    axes.axvspan(-min(sensitivity.noise, 1.0), min(sensitivity.noise, 1.0), color="0.9", zorder=0, label="chance")
    axes.set_yticks(places, [sensitivity.names[i] for i in chosen], fontsize="small")
    axes.set_xlim(-1.05, 1.05)
    axes.set_title(column)
    axes.legend(fontsize="small")
