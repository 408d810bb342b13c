"""Pages about results: a title, lines, warnings, figures and tables, and nothing outside of them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..files import write_atomically
from .svg import inline_svg

TEMPLATE = "report/report.html.jinja"


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
        warnings: what is to be minded.
        missing: what the page should have and has not, each with its reason.
        figures: in the order of the page.
        tables: in the order of the page.
    """

    title: str
    summary: tuple[str, ...]
    warnings: tuple[str, ...]
    missing: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()

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
        return environment.get_template(TEMPLATE).render(report=self)

    def save(self, path: Path | str) -> Path:
        """Write the page and return its path; InputError if it cannot be written."""
        text = self.html().encode("utf-8", "replace")  # a lone surrogate of a name
        return write_atomically(Path(path), lambda stream: stream.write(text))


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
