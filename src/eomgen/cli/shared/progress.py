"""Show how far a command has come: a bar on a terminal, lines in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from ...progress import Progress, StageReport, shown_alone, told_in_lines


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Give a Progress of a bar on a terminal; in a pipe, of lines on stderr if it takes that long."""
    with shown_alone(), _bar(title) if sys.stderr.isatty() else _lines(title) as report:
        yield report


@contextmanager
def stage_bar(title: str) -> Iterator[StageReport]:
    """Give a StageReport of ``progress_bar``, for work that cannot tell how long its stages take."""
    with progress_bar(title) as report:
        yield lambda text: report(0.0, text)


def _lines(title: str) -> AbstractContextManager[Progress]:
    return told_in_lines(title, lambda line: print(line, file=sys.stderr, flush=True))


@contextmanager
def _bar(title: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(title, total=None)

        def report(fraction: float, text: str) -> None:
            bars.update(task, description=text or title, total=1.0 if fraction > 0 else None, completed=fraction)

        yield report
