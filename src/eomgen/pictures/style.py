"""The style of all figures: for print, in vectors or in pixels by the file's ending, labelled with units.

Matplotlib is imported when a plot is made, not with this file; figures are drawn without a display.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..files import FIGURE_ENDINGS, check_ending, write_atomically
from ..optional import optional_import
from ..simulation.result import SimulationResult

COLORS = {  # Okabe and Ito: told apart by colour-blind readers
    "m": {"x": "#0072b2", "y": "#d55e00", "z": "#009e73"},
    "rad": {"alpha": "#56b4e9", "beta": "#e69f00", "gamma": "#cc79a7"},
}
PROGRAM_COLOR, TOOL_COLOR, GRID_COLOR = "#777777", "#cc3311", "#dddddd"
DPI = 200
FULL_WIDTH = 7.4  # inches: the widest figure; the others take their part of a page's width, so that type is as large
TYPE_SIZE = 8.0  # points, of all text in all figures
RC = {
    "font.size": TYPE_SIZE,
    "axes.titlesize": TYPE_SIZE,
    "axes.labelsize": TYPE_SIZE,
    "xtick.labelsize": TYPE_SIZE,
    "ytick.labelsize": TYPE_SIZE,
    "legend.fontsize": TYPE_SIZE,
    "axes.grid": True,
    "grid.color": GRID_COLOR,
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "svg.fonttype": "none",  # text that can be searched and edited
    "pdf.fonttype": 42,
    "svg.hashsalt": "eomgen",  # the same figure is the same bytes
}

UNDATED = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "u"), (1e9, "n"), (1e12, "p"))


def mark_end(panel: Any, result: SimulationResult) -> None:
    """A dotted line where the program comes to rest."""
    moving = np.flatnonzero(np.any(result.program_q != result.program_q[-1], axis=1))
    if moving.size and moving[-1] + 1 < result.trajectory.t.size:
        panel.axvline(result.trajectory.t[moving[-1] + 1], color=PROGRAM_COLOR, linestyle=":", linewidth=0.9)


def title_of(figure: Any, text: str) -> None:
    left, top = 0.12 / figure.get_figwidth(), 1.0 - 0.08 / figure.get_figheight()
    figure.text(left, top, literal(text), fontweight="bold", ha="left", va="top")


def ticker() -> Any:
    from matplotlib import ticker

    return ticker


def _figure(width: float, height: float) -> tuple[Any, Any]:
    """Matplotlib, and a figure of that size in inches that needs no display and leaves pyplot's state alone."""
    with optional_import("Matplotlib", "plots need"):
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    return matplotlib, figure


@contextmanager
def canvas(width: float, height: float, path: Path | str) -> Iterator[Any]:
    """A figure of that size in inches, in the style of all figures, that is written when all is drawn.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    target = check_ending(path, *FIGURE_ENDINGS)
    mpl, figure = _figure(width, height)
    with mpl.rc_context(RC):
        yield figure
        about = UNDATED[target.suffix]
        write_atomically(
            target, lambda stream: figure.savefig(stream, format=target.suffix[1:], dpi=DPI, metadata=about)
        )


def literal(text: str) -> str:
    """A text that Matplotlib does not read as mathematics."""
    return text.replace("$", r"\$")


def scale_of(values: Any, unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which the largest of the values is at least 1: (1e6, "um")."""
    largest = float(np.abs(values).max(initial=0.0))
    for factor, prefix in PREFIXES:
        if factor * largest >= 1.0 or largest == 0.0:
            return factor, prefix + unit
    factor, prefix = PREFIXES[-1]
    return factor, prefix + unit
