"""The style of all figures: for print, in vectors or in pixels by the file's ending, labelled with units.

Matplotlib is imported when a plot is made, not with this file; figures are drawn without a display.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import FIGURE_ENDINGS, check_ending, write_atomically
from ..optional import optional_import
from ..simulation.result import SimulationResult

COLORS = {  # Okabe and Ito: told apart by colour-blind readers
    "m": {"x": "#0072b2", "y": "#d55e00", "z": "#009e73"},
    "rad": {"alpha": "#56b4e9", "beta": "#e69f00", "gamma": "#cc79a7"},
}
PROGRAM_COLOR, TOOL_COLOR, GRID_COLOR = "#777777", "#cc3311", "#dddddd"
DPI = 200
FULL_WIDTH = 7.4  # inches: the widest figure; the others take their share of a page's width, so that type is as large
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
def canvas(width: float, height: float, path: Path | str, title: str = "") -> Iterator[Any]:
    """A figure of that size in inches, in the style of all figures, that is written when all is drawn.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    target = check_ending(path, *FIGURE_ENDINGS)
    mpl, figure = _figure(width, height)
    with mpl.rc_context(RC):
        yield figure
        if title:
            left, top = 0.12 / width, 1.0 - 0.08 / height
            figure.text(left, top, literal(title), fontweight="bold", ha="left", va="top")
        about = UNDATED[target.suffix]
        write_atomically(
            target, lambda stream: figure.savefig(stream, format=target.suffix[1:], dpi=DPI, metadata=about)
        )


def panel_grid(figure: Any, rows: int, across: int, *, head: float, right: float = 0.2, **options: Any) -> Any:
    """Make panels (rows, across) below a head and left of a margin, both in inches; ``options`` are of the grid."""
    width, height = figure.get_size_inches().tolist()
    room = {"left": 0.62 / width, "right": 1.0 - right / width, "top": 1.0 - head / height, "bottom": 0.4 / height}
    shared = options.pop("sharex", True)
    return figure.subplots(rows, across, sharex=shared, squeeze=False, gridspec_kw={**room, **options})


def row_panel(figure: Any, names: Sequence[str], left: float, width: float) -> tuple[Any, NDArray[np.intp]]:
    """Make a panel with a row for each name, parts of the figure's width; returns it and the rows, the first on top."""
    height = figure.get_figheight()
    axes = figure.add_axes((left, 0.45 / height, width, 1.0 - 0.8 / height))
    rows = np.arange(len(names))[::-1]
    axes.set_yticks(rows, [literal(name) for name in names])
    return axes, rows


def set_space(axes: Any, points: Any, share: float, zoom: float, view: tuple[float, float], pad: Any = None) -> None:
    """Set equal scales of axes in space around points (..., 3), m, and from where they are seen.

    Args:
        axes: in three dimensions.
        points: to be seen.
        share: half the edge of the cube that is shown, of the points' largest extent.
        zoom: of the cube.
        view: elevation and azimuth, degrees.
        pad: of the labels, points; none where there are none.
    """
    places = points.reshape(-1, 3)
    low, high = places.min(axis=0), places.max(axis=0)
    middle, half = 0.5 * (low + high), share * float((high - low).max())
    for name, center in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{name}lim")(center - half, center + half)
        if pad is not None:
            getattr(axes, f"set_{name}label")(f"{name}, m", labelpad=pad)
    if pad is not None:
        axes.tick_params(pad=-2.0)
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=zoom)
    axes.view_init(elev=view[0], azim=view[1])


def bars_in_pairs(
    path: Path | str,
    title: str,
    names: Sequence[str],
    values: Mapping[str, Any],
    label: str,
    *,
    left: float,
    row: float,
) -> Path:
    """Draw two bars for each name, values (names,) by what they are of; returns the path.

    Args:
        path, title: of the figure.
        names: of the rows.
        values: lengths of the bars.
        label: of their axis.
        left: room of the names, of the figure's width.
        row: height of a row, inches.
    """
    with canvas(6.4, 1.1 + row * len(names), path, title) as figure:
        axes, rows = row_panel(figure, names, left, 0.97 - left)
        for lift, color, (of, lengths) in zip((0.2, -0.2), COLORS["m"].values(), values.items(), strict=False):
            axes.barh(rows + lift, lengths, 0.38, color=color, label=of)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(label)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    return Path(path)


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
