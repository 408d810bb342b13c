"""Write results, figures and pages where options ask for them; remove or name older ones beside them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ...files import FIGURE_ENDINGS, PAGE_ENDING, check_ending
from ...results.beside import JSON, NPZ, is_ours, older_than, remove_ours
from .output import say, show_files, show_result, show_written


def check_output(options: argparse.Namespace, *endings: str) -> None:
    """Check the ending of -o before anything is computed.

    Raises:
        InputError: it is none of these, nor that of a figure.
    """
    if options.output is not None:
        check_ending(options.output, *endings, *FIGURE_ENDINGS)


def saved_or_drawn(options: argparse.Namespace, result: Any, *about: Any) -> list[Path]:
    """Write a result where -o says, after ``check_output``: its plot to a path of a figure, else what its save writes.

    Args:
        options: of the command.
        result: with ``plot`` and ``save``.
        about: further arguments of its plot.

    Returns:
        The path that was written, or none.
    """
    path = options.output
    if path is None:
        return []
    return [result.plot(*about, path=path) if path.suffix in FIGURE_ENDINGS else result.save(path)]


def pages_written(options: argparse.Namespace, result: Any) -> list[Path]:
    """Write the page about a result of measurements where --report asks for one; return its path."""
    if options.report is None:
        return []
    from ...pictures.measured.kinds import page_of

    return [page_of(result).save(options.report)]


def show_measured(options: argparse.Namespace, result: Any, written: Sequence[Path] = ()) -> None:
    """Print a result of measurements as ``show_files`` does, and write its page where --report asks for it."""
    written = [*written, *pages_written(options, result)]
    show_files(options, result.lines(), result.as_dict(), written)
    name_older_pages(written)


def show_and_write(options: argparse.Namespace, result: Any, *about: Any) -> None:
    """Print a result as ``show_result`` does, write it as ``saved_or_drawn`` does, and print what was written."""
    show_result(options, result)
    written = saved_or_drawn(options, result, *about)
    if not options.json:
        show_written(written)


def show_with_page(options: argparse.Namespace, result: Any, written: Iterable[Path] = ()) -> None:
    """Print a result as ``show_result`` does, with files that were written; and its page where --report asks for it."""
    written = [*written, *pages_written(options, result)]
    show_result(options, result)
    if not options.json:
        show_written(written)
    name_older_pages(written)


def remove_older(result: Path, names: Iterable[str], written: Iterable[Path] = (), *, replaced: bool = True) -> None:
    """Remove figures and pages that an older result left beside a new one, and say so; name those that stay.

    Args:
        result: the file of the new result.
        names: of files beside it, as ``results.beside`` knows them.
        written: with the new result.
        replaced: whether an older result was there; else the files are of something else, and stay.
    """
    older = older_than(result, names, written)
    removed, left = remove_ours(older) if replaced else ([], older)
    if removed:
        say(f"note: removed of the older result: {', '.join(map(str, removed))}", sys.stderr)
    _name_older(left)


def name_older_pages(written: Iterable[Path]) -> None:
    """Name pages that ``report`` may have written about older results, beside those that were written."""
    written = list(written)
    results = [path for path in written if path.suffix in (NPZ, JSON)]
    pages = [page for path in results for page in older_than(path, [path.with_suffix(PAGE_ENDING).name], written)]
    _name_older([page for page in pages if is_ours(page)])


def _name_older(paths: Sequence[Path]) -> None:
    if paths:
        say(f"note: older than the result beside, maybe of another one: {', '.join(map(str, paths))}", sys.stderr)
