"""Corrected programs drawn and as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...identification.compensating.result import AXES, CompensationResult
from ...shown import scale_of
from ..report import Report, drawn, sorted_notes
from ..style import COLORS, Plotted, check_kind, sheet
from .tables import number, table

_PARTS = ("before", "after", "beyond")


def compensation_page(compensation: CompensationResult) -> Report:
    """A page about a compensated path: errors without and with it, what is out of reach, limits, other robots."""
    errors = [
        (name, *(number(row[f"{stage}_{kind}"], 1e6, 4) for stage in _PARTS for kind in ("rms", "peak")))
        for name, row in compensation.figures().items()
    ]
    changes = np.abs(compensation.corrected - compensation.program).max(axis=0)
    corrections = [(name, number(x, 1.0, 4)) for name, x in zip(compensation.coordinates, changes, strict=True)]
    shares = [
        (axis, number(weight, 1.0, 3), number(share, 100.0, 3))
        for axis, weight, share in zip(AXES, compensation.weights.tolist(), compensation.shares, strict=True)
    ]
    limits = [
        (item.coordinate, number(item.seconds, 1.0, 3), number(item.position, 1e6, 4), number(item.orientation, 1e6, 4))
        for item in compensation.limits
    ]
    others = [
        (x.label, number(x.position_before, 1e6, 4), number(x.position_after, 1e6, 4), number(x.gain, 1.0, 3))
        for x in compensation.robustness
    ]
    head = ("", "before, rms", "peak", "after, rms", "peak", "out of reach, rms", "peak")
    text = "The tool's errors along and about its axes, without the correction above and with it below."
    return Report(
        title=f"{compensation.robot}, {compensation.frame}: a compensated path ({compensation.mode})",
        summary=(
            f"rms of the position's error {compensation.gain:.3g} times smaller",
            f"directions that can be corrected: {compensation.rank[0]} to {compensation.rank[1]}",
        ),
        warnings=sorted_notes(compensation.notes)[0],
        notes=sorted_notes(compensation.notes)[1],
        figures=drawn(compensation, [("errors", text, plot_compensation)]),
        tables=(
            *table("Errors of the tool, um and urad", head, errors),
            *table("Largest corrections, m or rad", ("coordinate", "correction"), corrections),
            *table("What no correction undoes", ("axis", "weight", "share of a small motion, %"), shares),
            *table("Held back by limits", ("coordinate", "for, s", "position, um", "orientation, urad"), limits),
            *table("Other robots, rms of position", ("robot", "before, um", "after, um", "times less"), others),
        ),
    )


def plot_compensation(compensation: CompensationResult, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot the tool's errors over time along and about its axes, without the correction above and with it below.

    Args:
        compensation: of ``identification.compensate``.
        path: to write to, .png, .svg or .pdf.
        ax: four axes: positions and orientations before, then after.

    Returns:
        The path where there is one, else the figure and its axes.

    Raises:
        InputError: ``compensation`` is something else, or as of ``style.sheet``.
    """
    check_kind(compensation, CompensationResult, "compensation", "identification.compensate")
    colors = tuple(COLORS["m"].values())
    title = f"{compensation.robot}: tracking error of {compensation.frame} in its axes"
    with sheet(6.8, 4.4, path, title, ax) as drawn:
        room = {"top": 0.84, "bottom": 0.12, "left": 0.1, "right": 0.98, "wspace": 0.3, "hspace": 0.2}
        panels = drawn.panels(4, lambda figure: figure.subplots(2, 2, sharex=True, gridspec_kw=room))
        stages = [("before", compensation.before), ("after", compensation.after)]
        blocks = [(*stage, first, unit) for stage in stages for first, unit in ((0, "m"), (3, "rad"))]
        for panel, (name, error, first, unit) in zip(panels, blocks, strict=True):
            components = error[:, first : first + 3]
            scale, prefixed = scale_of(components, unit)
            for color, axis, column in zip(colors, AXES[first:], components.T, strict=False):
                panel.plot(compensation.times, scale * column, color=color, label=axis)
            panel.set_ylabel(f"{name}, {prefixed}")
        for panel in panels[:2]:
            panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, handlelength=1.4)
        for panel in panels[2:]:
            panel.set_xlabel("time, s")
    return drawn.outcome
