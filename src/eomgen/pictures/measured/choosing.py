"""Chosen poses drawn and as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.choosing.result import PosesResult
from ..report import Report, drawn, sorted_notes
from ..style import COLORS, Plotted, check_kind, label_rows, row_panel, sheet
from .tables import merged_table, number, table, weak_table

_ROW = 0.24  # inches of a coordinate


def poses_page(chosen: PosesResult) -> Report:
    """A page about chosen poses: where they are, expected deviations, what stays poorly observable."""
    poses = [(str(i + 1), *(f"{value:.6f}" for value in row)) for i, row in enumerate(chosen.q)]
    told = [
        (name, number(chosen.deviations[i], 1.0, 3), chosen.units[i])
        for i, name in enumerate(chosen.names)
        if name not in chosen.merged
    ]
    text = "Coordinates of the chosen poses, each over its range; the darker, the earlier it is to be measured."
    return Report(
        title=f"{chosen.robot}: {len(chosen.q)} poses to measure",
        summary=tuple(chosen.summary_lines()),
        warnings=sorted_notes(chosen.notes)[0],
        notes=sorted_notes(chosen.notes)[1],
        figures=drawn(chosen, [("poses", text, plot_poses)]),
        tables=(
            *table("Poses in the order to measure them, m and rad", ("pose", *chosen.coordinates), poses),
            *table("Expected standard deviations", ("parameter", "std. deviation", "unit"), told),
            *merged_table(chosen.merged),
            *weak_table(chosen.weak),
        ),
    )


def plot_poses(chosen: PosesResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot a strip for each coordinate with its least to greatest values; the darker, the earlier it is to be measured.

    Args:
        chosen: of ``identification.poses``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``chosen`` is something else, or as of ``style.sheet``.
    """
    check_kind(chosen, PosesResult, "chosen", "identification.poses")
    height = 1.0 + _ROW * len(chosen.coordinates)
    low, high = chosen.q.min(axis=0), chosen.q.max(axis=0)
    share = (chosen.q - low) / np.where(high > low, high - low, 1.0)
    age = np.linspace(1.0, 0.25, len(chosen.q))
    with sheet(6.4, height, path, f"{chosen.robot}: chosen poses", ax) as drawn:
        [axes] = drawn.panels(1, lambda figure: row_panel(figure, 0.22, 0.74))
        rows = label_rows(axes, chosen.coordinates)
        for k, row in enumerate(rows):
            axes.scatter(share[:, k], np.full(len(share), row), s=14.0, alpha=age, color=COLORS["m"]["x"])
            axes.annotate(f"{low[k]:.3g}", (0.0, row), (-4, 6), textcoords="offset points", ha="left")
            axes.annotate(f"{high[k]:.3g}", (1.0, row), (4, 6), textcoords="offset points", ha="right")
        axes.set_ylim(-0.6, len(rows) - 0.2)
        axes.set_xticks([])
        axes.set_xlabel("from the least to the greatest value, m or rad")
    return drawn.outcome
