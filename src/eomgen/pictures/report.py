"""Pages about results: a title, lines, warnings, figures and tables, and nothing outside of them."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from .._version import __version__
from ..errors import InputError
from ..files import PAGE_ENDING, check_ending, write_atomically
from ..names import show
from .svg import inline_svg

TEMPLATE = "report/report.html.jinja"
WARNS = re.compile(  # notes of results that ask to be minded, among those that say how it was done
    r"\?$|\bexceed|\bbeyond\b|\bfailed\b|does not close|not in balance|no better|\bstopped\b|more may lead further"
    r"|never measured|still moves|\bsaturated\b|cannot be|check little|\bwere clipped\b|MuJoCo warns|\bsuspicious\b"
    r"|look at them|^not linear|is not explained|^lack of fit|as it is read, a calibration"
)


@dataclass(frozen=True)
class Figure:
    """name; caption; svg: an element, safe to put into a page as it is."""

    name: str
    caption: str
    svg: Any


@dataclass(frozen=True)
class Table:
    """A table of a page: texts; the first column names the row."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Report:
    """A self-contained page about a result, ready to be saved.

    Attributes:
        title: its heading.
        summary: lines about what came out.
        warnings: what is to be minded, in amber; of ``sorted_notes``.
        notes: how it was done, and what was assumed.
        missing: what the page should have and has not, each with its reason.
        figures: in the order of the page.
        tables: in the order of the page.
        made: date of the page, "2026-11-23"; that of the environment's SOURCE_DATE_EPOCH where it is set, in UTC.
    """

    title: str
    summary: tuple[str, ...]
    warnings: tuple[str, ...]
    missing: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()
    made: str = field(default_factory=lambda: _today().isoformat())

    def html(self) -> str:
        """One page that refers to nothing outside of it."""
        import jinja2

        environment = jinja2.Environment(
            loader=jinja2.PackageLoader("eomgen.templates", ""),
            undefined=jinja2.StrictUndefined,
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        return environment.get_template(TEMPLATE).render(report=self, version=__version__)

    def save(self, path: Path | str) -> Path:
        """Write the page and return its path; InputError of another ending than .html, or if it cannot be written."""
        target = check_ending(path, PAGE_ENDING, label="path")
        text = self.html().encode("utf-8", "replace")  # a lone surrogate of a name
        return write_atomically(target, lambda stream: stream.write(text), read=None)


def sorted_notes(notes: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the notes that are warnings, and those that say how it was done or what was assumed."""
    lines = tuple(notes)
    return tuple(x for x in lines if WARNS.search(x)), tuple(x for x in lines if not WARNS.search(x))


def _today() -> date:
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    if not epoch:
        return date.today()
    try:
        return datetime.fromtimestamp(int(epoch), tz=UTC).date()
    except (ValueError, OverflowError, OSError):  # as systems say it
        allowed = "seconds since 1970, up to the year 9999"
        raise InputError(f"the environment's SOURCE_DATE_EPOCH is {show(epoch)}; allowed: {allowed}") from None


def drawn(result: Any, drawings: Iterable[tuple[str, str, Callable[[Any, Path], Path]]]) -> tuple[Figure, ...]:
    """Figures of a result as elements of a page, by their names, captions and what draws them into a file.

    Raises:
        InputError: Matplotlib is not installed.
    """
    with tempfile.TemporaryDirectory(prefix="eomgen-") as folder:
        return tuple(figure_of(draw(result, Path(folder) / f"{name}.svg"), caption) for name, caption, draw in drawings)


def figure_of(path: Path, caption: str) -> Figure:
    """A figure in a file, .svg, as an element of a page; its name is that of the file."""
    from markupsafe import Markup, escape

    text = inline_svg(path.read_text(encoding="utf-8"), path.stem, str(escape(caption)))
    return Figure(path.stem, caption, Markup(text))  # Matplotlib has escaped what is in it
