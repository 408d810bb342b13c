"""The style of all figures: for print, in vectors or in pixels by the file's ending, labelled with units.

Matplotlib is imported when a plot is made, not with this file; figures are drawn without a display.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import FIGURE_ENDINGS, check_ending, write_atomically
from ..names import show
from ..optional import optional_import
from ..results.beside import CREATOR
from ..simulation.result import SimulationResult

COLORS = {  # Okabe and Ito, told apart by colour-blind readers; without amber, which warnings alone have
    "m": {"x": "#0072b2", "y": "#d55e00", "z": "#009e73"},
    "rad": {"alpha": "#56b4e9", "beta": "#882255", "gamma": "#cc79a7"},
}
CYCLE = tuple(color for colors in COLORS.values() for color in colors.values())  # of several curves
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

Plotted: TypeAlias = (
    Any  # the Path that was written where a path was handed in, else (Figure, Axes), or an array of Axes
)

METADATA = {  # no dates, so that the same figure is the same bytes
    ".svg": {"Creator": CREATOR, "Date": None},
    ".pdf": {"Creator": CREATOR, "CreationDate": None},
    ".png": {"Software": CREATOR},
}
BESIDE: Mapping[str, Any] = MappingProxyType(  # where a legend stands beside the curves
    {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0, "handlelength": 1.6}
)
BAR_ROOM = 1.1  # inches of a figure of bars beside its rows


def mark_end(panel: Any, result: SimulationResult) -> None:
    """A dotted line where the program comes to rest."""
    moving = np.flatnonzero(np.any(result.program_q != result.program_q[-1], axis=1))
    if moving.size and moving[-1] + 1 < result.trajectory.t.size:
        panel.axvline(result.trajectory.t[moving[-1] + 1], color=PROGRAM_COLOR, linestyle=":", linewidth=0.9)


def ticker() -> Any:
    from matplotlib import ticker

    return ticker


def _figure(width: float, height: float) -> Any:
    """Return a figure of that size in inches that needs no display and leaves pyplot's state alone."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def _matplotlib() -> Any:
    """Return Matplotlib; InputError where it is not installed, or the environment asks for a backend that is none."""
    with optional_import("Matplotlib", "plots need"):
        try:
            import matplotlib
            import matplotlib.figure  # with what it needs itself
        except ValueError:  # of the environment, when it is imported first
            backend = show(os.environ.get("MPLBACKEND", ""))
            raise InputError(f"the environment's MPLBACKEND is {backend}; allowed: a backend of Matplotlib") from None
    return matplotlib


class Sheet:
    """A plot in the making, on a new figure or in axes of the caller.

    Attributes:
        figure: of Matplotlib, to draw on.
        is_new: whether the figure was made for this plot, so that its margins, titles and legends are the plot's.
        outcome: what plot functions return: the path that was written, or (figure, axes).
    """

    def __init__(self, figure: Any, title: str, ax: Any = None) -> None:
        self.figure, self.is_new = figure, ax is None
        self.axes: Any = None
        self.outcome: Plotted = None
        self._ax, self._title = ax, title

    def panels(self, count: int, make: Callable[[Any], Any], spatial: Sequence[int] = ()) -> list[Any]:
        """Return ``count`` axes to draw in: those that ``make(figure)`` makes, or those of the caller.

        Args:
            count: of axes.
            make: called with the figure where it is new.
            spatial: which of them are in three dimensions.

        Raises:
            InputError: the caller's are no axes, are more or fewer, or are not spatial where that is needed.
        """
        panels = list(np.ravel(np.asarray(make(self.figure) if self.is_new else self._ax, dtype=object)))
        if not self.is_new:
            _check_axes(panels, count, spatial)
            if count == 1 and self._title and not panels[0].get_title():
                panels[0].set_title(literal(self._title))
        self.axes = panels[0] if count == 1 else np.array(panels, dtype=object)
        return panels

    def legend(self, handles: Sequence[Any], labels: Sequence[str], **options: Any) -> None:
        """Put one legend for all panels on the figure, or into the first of the caller's axes."""
        if self.is_new:
            self.figure.legend(handles, labels, **options)
        else:
            np.ravel(self.axes)[0].legend(handles, labels)


def _check_axes(panels: Sequence[Any], count: int, spatial: Sequence[int]) -> None:
    from matplotlib.axes import Axes

    for panel in panels:
        if not isinstance(panel, Axes):
            raise InputError(f"ax: got a value of type {type(panel).__name__}; allowed: Axes of Matplotlib")
    if len(panels) != count:
        raise InputError(f"ax: {len(panels)} axes; allowed: {count}, for each panel of the plot one")
    for k in spatial:
        if not hasattr(panels[k], "get_zlim"):
            which = "ax" if count == 1 else f"ax[{k}]"
            raise InputError(f'{which}: is flat; allowed: axes in space, figure.add_subplot(projection="3d")')


@contextmanager
def sheet(width: float, height: float, path: Path | str | None, title: str = "", ax: Any = None) -> Iterator[Sheet]:
    """Give what a plot is drawn on, in the style of all figures; written where there is a path, when all is drawn.

    Without a path the figure is one of pyplot, which windows and notebooks show.

    Args:
        width, height: of a new figure, inches.
        path: of the file to write, with one of FIGURE_ENDINGS; None for none.
        title: of the figure.
        ax: axes of the caller to draw in; None for a new figure.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, the file cannot be written, or
            ``ax`` is no axes.
    """
    target = None if path is None else check_ending(path, *FIGURE_ENDINGS)
    mpl = _matplotlib()
    with mpl.rc_context(RC):
        if ax is not None:
            first = next(iter(np.ravel(np.asarray(ax, dtype=object))), None)
            drawn = Sheet(getattr(first, "figure", None), title, ax)
        elif target is not None:
            drawn = Sheet(_figure(width, height), title)
        else:
            from matplotlib import pyplot

            drawn = Sheet(pyplot.figure(figsize=(width, height)), title)
        try:
            yield drawn
        except BaseException:
            if ax is None and target is None:
                pyplot.close(drawn.figure)
            raise
        if drawn.is_new and title:
            left, top = 0.12 / width, 1.0 - 0.08 / height
            drawn.figure.text(left, top, literal(title), fontweight="bold", ha="left", va="top")
        drawn.outcome = (drawn.figure, drawn.axes)
        if target is not None:
            _write(drawn.figure, target)
            drawn.outcome = target


@contextmanager
def canvas(width: float, height: float, path: Path | str, title: str = "") -> Iterator[Any]:
    """Give a figure of that size in inches, in the style of all figures, that is written when all is drawn.

    Raises:
        InputError: as of ``sheet``.
    """
    with sheet(width, height, path, title) as drawn:
        yield drawn.figure


def _write(figure: Any, target: Path) -> None:
    root = getattr(figure, "figure", figure)  # of a subfigure
    ending = target.suffix
    write_atomically(
        target, lambda stream: root.savefig(stream, format=ending[1:], dpi=DPI, metadata=METADATA[ending]), read=None
    )


def check_kind(value: Any, kind: type, label: str, source: str) -> None:
    """Check what a plot is to be made of.

    Raises:
        InputError: it is of another kind; says the label, what was handed in, and where the right one comes from.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        text = f"{label}: got a value of type {type(value).__name__}"
        raise InputError(f"{text}; allowed: {article} {kind.__name__}, from {source}")


def panel_grid(figure: Any, rows: int, across: int, *, head: float, right: float = 0.2, **options: Any) -> Any:
    """Make panels (rows, across) below a head and left of a margin, both in inches; ``options`` are of the grid."""
    width, height = figure.get_size_inches().tolist()
    room = {"left": 0.62 / width, "right": 1.0 - right / width, "top": 1.0 - head / height, "bottom": 0.4 / height}
    shared = options.pop("sharex", True)
    return figure.subplots(rows, across, sharex=shared, squeeze=False, gridspec_kw={**room, **options})


def row_panel(figure: Any, left: float, width: float) -> Any:
    """Make a panel whose rows have names; left and width as shares of the figure's."""
    height = figure.get_figheight()
    return figure.add_axes((left, 0.45 / height, width, 1.0 - 0.8 / height))


def label_rows(axes: Any, names: Sequence[str]) -> NDArray[np.intp]:
    """Label the rows of a panel with names, the first on top; returns their places."""
    rows = np.arange(len(names))[::-1]
    axes.set_yticks(rows, [literal(name) for name in names])
    return rows


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
    drawn: Sheet,
    names: Sequence[str],
    values: Mapping[str, Any],
    label: str,
    *,
    left: float,
) -> None:
    """Draw two bars for each name, values (names,) by what they are of.

    Args:
        drawn: the plot, of BAR_ROOM and a row's height for each name.
        names: of the rows.
        values: lengths of the bars.
        label: of their axis.
        left: room of the names, of the figure's width.
    """
    [axes] = drawn.panels(1, lambda figure: row_panel(figure, left, 0.97 - left))
    rows = label_rows(axes, names)
    for lift, color, (of, lengths) in zip((0.2, -0.2), COLORS["m"].values(), values.items(), strict=False):
        axes.barh(rows + lift, lengths, 0.38, color=color, label=of)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(label)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)


def literal(text: str) -> str:
    """A text that Matplotlib does not read as mathematics."""
    return text.replace("$", r"\$")
