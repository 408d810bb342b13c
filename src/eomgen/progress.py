"""Functions that callers hand in, and that long work tells how far it has come; lines in notebooks and at a prompt."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from .identifiers import check_kind

Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")

Progress = Callable[[float, str], None]  # called with the fraction that is done, from 0 to 1, and a line of text
StageReport = Callable[[str], None]  # called with a line of text when a stage begins

EVERY = 5.0  # s, after which long work says how far it has come where nothing moves on a terminal
_SHOWN = threading.Lock()  # held while progress is shown, by whatever


def no_progress(_fraction: float, _text: str) -> None:
    """Say nothing: a Progress."""


def no_report(_text: str) -> None:
    """Say nothing: a StageReport."""


@contextmanager
def told_in_lines(title: str, say: Callable[[str], None], every: float = EVERY) -> Iterator[Progress]:
    """Give a Progress that says how far the block has come, in a line each ``every`` s; nothing of shorter blocks.

    Args:
        title: what the block does.
        say: called with each line, by a thread of its own, which its exceptions end; they are raised behind the block.
        every: s.
    """
    from concurrent.futures import ThreadPoolExecutor  # with logging, which short commands do without

    latest, done = [(0.0, "")], threading.Event()

    def tell() -> None:
        seconds = every
        while not done.wait(every):
            fraction, text = latest[-1]
            percent = f" {100.0 * fraction:.0f} %" if fraction > 0.0 else ""
            say(f"{title}:{percent}{f' {text}' if text and text != title else ''} ({seconds:.0f} s)")
            seconds += every

    def report(fraction: float, text: str) -> None:
        latest[:] = [(fraction, text)]

    with ThreadPoolExecutor(1, "eomgen-progress") as pool:
        telling = pool.submit(tell)
        try:
            yield report
        finally:
            done.set()
    telling.result()


@contextmanager
def shown_alone() -> Iterator[bool]:
    """Give whether nothing else shows progress now; until the block ends, nothing else does by ``told_at_prompt``."""
    first = _SHOWN.acquire(blocking=False)
    try:
        yield first
    finally:
        if first:
            _SHOWN.release()


def is_at_prompt() -> bool:
    """Return whether somebody types what is run: into Python, IPython or a notebook, all of which set sys.ps1."""
    return hasattr(sys, "ps1")


@contextmanager
def told_at_prompt(title: str, progress: Callable[..., None] | None = None) -> Iterator[Callable[..., None]]:
    """Give a Progress that is a StageReport, too: the caller's, or at a prompt one of lines as of commands, on stderr.

    Args:
        title: what the block does, as commands say it.
        progress: of the caller; None, ``no_progress`` and ``no_report`` are none.
    """
    if progress not in (None, no_progress, no_report):
        yield progress
        return
    if not is_at_prompt():
        yield _silent
        return
    with shown_alone() as first:
        if not first:
            yield _silent
            return
        with told_in_lines(title, lambda line: print(line, file=sys.stderr, flush=True), EVERY) as report:
            yield lambda *about: report(*(0.0, *about)[-2:])


def tells_at_prompt(title: str) -> Callable[[Callable[Arguments, Returned]], Callable[Arguments, Returned]]:
    """Decorate a function with a keyword ``progress``: called at a prompt without one, it gets ``told_at_prompt``."""

    def decorate(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
        @wraps(function)
        def telling(*args: Arguments.args, **keywords: Arguments.kwargs) -> Returned:
            own: Any = keywords.pop("progress", None)
            check_kind("progress", own, own is None or callable(own), "a function, or None")
            if own is not None:
                keywords["progress"] = own
            if not is_at_prompt():
                return function(*args, **keywords)
            with told_at_prompt(title, own) as report:
                keywords["progress"] = report
                return function(*args, **keywords)

        return telling

    return decorate


def _silent(*_about: Any) -> None:
    """Say nothing, as a Progress or a StageReport."""
