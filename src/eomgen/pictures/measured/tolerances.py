"""Accuracy by tolerances drawn and as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.tolerances.result import PARTS, ToleranceResult
from ..report import Report, drawn, sorted_notes
from ..style import BAR_ROOM, COLORS, FULL_WIDTH, PROGRAM_COLOR, Plotted, bars_in_pairs, check_kind, sheet
from .tables import number, table

_MOST = 20  # contributions that are drawn
_ROW = 0.2  # inches of one
_OUTLINES = 40  # of ellipsoids in a map
_ELLIPSE = 0.05  # of the poses' extent: the largest half axis
_UNITS = ("mm", "mrad")


def tolerance_page(tolerance: ToleranceResult) -> Report:
    """A page about what tolerances make of a tool's pose: regions, worst cases, and what they come from."""
    figures = [("shares", "Shares of the variance by contribution.", plot_shares)]
    if len(tolerance.q) > 1:
        text = f"What holds the deviation with {100 * tolerance.confidence:g} % at each pose, and its worst case."
        figures.append(("regions", text, plot_regions))
        text = "Where the poses are, by the radius of their region, with the ellipses of the largest ones exaggerated."
        figures.append(("map", text, plot_tolerance))
    count = len(tolerance.q)
    return Report(
        title=f"{tolerance.robot}, {tolerance.frame}: accuracy by {len(tolerance.names)} tolerances",
        summary=(
            f"{count} pose{'s' * (count != 1)}",
            f"worst position by the exact model at the vertices: {1e3 * tolerance.exact_worst:.4g} mm",
            f"the exact model is off a linear one by {100 * tolerance.nonlinearity:.2g} % of the worst case",
        ),
        warnings=sorted_notes(tolerance.notes)[0],
        notes=sorted_notes(tolerance.notes)[1],
        figures=drawn(tolerance, figures),
        tables=(*table("Accuracy", *_accuracy(tolerance)), *table("Contributions", *_contributions(tolerance))),
    )


def _accuracy(tolerance: ToleranceResult) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows: mean and greatest over the poses of coverage radius, largest half-axis and worst case."""
    several = (("", np.max),) if len(tolerance.q) == 1 else ((", mean", np.mean), (", greatest", np.max))
    rows = []
    for quantity, unit in zip(PARTS, _UNITS, strict=True):
        for kind, function in several:
            values = [float(function(x[quantity])) for x in (tolerance.radius, tolerance.direction, tolerance.farthest)]
            rows.append((f"{quantity}{kind}", *(number(value, 1e3, 4) for value in values), unit))
    share = f"{100 * tolerance.confidence:g} % coverage"
    return ("", share, "largest half-axis", "worst case", "unit"), rows


def _contributions(tolerance: ToleranceResult) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    rows = [
        (
            tolerance.names[k],
            number(tolerance.deviations[k], 1.0, 3),
            number(tolerance.bounds[k], 1.0, 3),
            tolerance.units[k],
            *(number(tolerance.shares[quantity][k], 100.0, 3) for quantity in PARTS),
        )
        for k in tolerance.by_share.tolist()
    ]
    return ("parameter", "std. deviation", "bound", "unit", "share of position, %", "share of orientation, %"), rows


def plot_shares(tolerance: ToleranceResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot the largest shares of the variance by contribution.

    Args:
        tolerance: of ``identification.tolerance``.
        path: to write to, .png, .svg or .pdf.
        ax: axes to draw in.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``tolerance`` is something else, or as of ``style.sheet``.
    """
    check_kind(tolerance, ToleranceResult, "tolerance", "identification.tolerance")
    chosen = tolerance.by_share[:_MOST].tolist()
    shares = {quantity: 100.0 * tolerance.shares[quantity][chosen] for quantity in PARTS}
    names, title = (
        [tolerance.names[k] for k in chosen],
        f"{tolerance.robot}: what the deviation of {tolerance.frame} comes from",
    )
    with sheet(6.4, BAR_ROOM + _ROW * len(names), path, title, ax) as drawn:
        bars_in_pairs(drawn, names, shares, "share of the variance, %", left=0.32)
    return drawn.outcome


def plot_tolerance(tolerance: ToleranceResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot a map of the frame's poses from above and from the side, coloured by the radius of the region of position.

    Outlines of some ellipsoids are exaggerated.

    Args:
        tolerance: of ``identification.tolerance``.
        path: to write to, .png, .svg or .pdf.
        ax: two axes.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``tolerance`` is something else, or as of ``style.sheet``.
    """
    check_kind(tolerance, ToleranceResult, "tolerance", "identification.tolerance")
    places, radius = 1e3 * tolerance.positions, 1e3 * tolerance.radius["position"]
    half, axes = tolerance.ellipsoids()
    extent = max(float(np.ptp(places, axis=0).max()), 1e-3)
    factor = _ELLIPSE * extent / max(1e3 * float(half.max()), 1e-12)
    around = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack([np.cos(around), np.sin(around)])
    chosen = np.argsort(-radius, kind="stable")[:_OUTLINES]
    title = f"{tolerance.robot}: regions of {tolerance.frame}, outlines times {factor:.3g}"
    with sheet(FULL_WIDTH, 3.6, path, title, ax) as drawn:
        room = {"top": 0.88, "bottom": 0.14, "left": 0.09, "right": 0.86, "wspace": 0.3}
        panels = drawn.panels(2, lambda figure: figure.subplots(1, 2, gridspec_kw=room))
        for panel, (i, j) in zip(panels, ((0, 1), (0, 2)), strict=True):
            drawn_points = panel.scatter(places[:, i], places[:, j], c=radius, s=9.0, cmap="viridis")
            for k in chosen:
                shape = (axes[k] * (1e3 * half[k]) ** 2) @ axes[k].T
                variances, turn = np.linalg.eigh(shape[np.ix_((i, j), (i, j))])
                outline = factor * turn @ (np.sqrt(np.maximum(variances, 0.0))[:, np.newaxis] * circle)
                panel.plot(places[k, i] + outline[0], places[k, j] + outline[1], color=PROGRAM_COLOR, linewidth=0.8)
            panel.set_aspect("equal", adjustable="datalim")
            panel.set_xlabel(f"{'xyz'[i]}, mm")
            panel.set_ylabel(f"{'xyz'[j]}, mm")
        place: dict[str, Any] = {"ax": panels}
        if drawn.is_new:
            place = {"cax": drawn.figure.add_axes((0.885, 0.14, 0.02, 0.74))}
        bar = drawn.figure.colorbar(drawn_points, **place)
        bar.set_label(f"{100 * tolerance.confidence:g} % coverage radius, mm")
    return drawn.outcome


def plot_regions(tolerance: ToleranceResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot radii of regions and worst cases over poses, or time.

    Args:
        tolerance: of ``identification.tolerance``.
        path: to write to, .png, .svg or .pdf.
        ax: two axes.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``tolerance`` is something else, or as of ``style.sheet``.
    """
    check_kind(tolerance, ToleranceResult, "tolerance", "identification.tolerance")
    over = np.arange(len(tolerance.q)) if tolerance.t is None else tolerance.t
    style = "." if tolerance.t is None else "-"
    title = f"{tolerance.robot}: deviation of {tolerance.frame} by tolerances"
    with sheet(6.4, 4.4, path, title, ax) as drawn:
        room = {"top": 0.87, "bottom": 0.11, "left": 0.11, "right": 0.97}
        panels = drawn.panels(2, lambda figure: figure.subplots(2, 1, sharex=True, gridspec_kw=room))
        for panel, quantity, unit in zip(panels, PARTS, _UNITS, strict=True):
            label = f"{100 * tolerance.confidence:g} % coverage"
            panel.plot(over, 1e3 * tolerance.radius[quantity], style, color=COLORS["m"]["x"], label=label)
            panel.plot(over, 1e3 * tolerance.farthest[quantity], style, color=COLORS["m"]["y"], label="worst case")
            most = max(float(tolerance.radius[quantity].max()), float(tolerance.farthest[quantity].max()))
            panel.set_ylim(0.0, 1.1e3 * most if most > 0.0 else 1.0)
            panel.set_ylabel(f"{quantity}, {unit}")
        panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
        panels[1].set_xlabel("pose" if tolerance.t is None else "time, s")
    return drawn.outcome
