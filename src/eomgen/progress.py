"""Functions that callers hand in, and that long work tells how far it has come."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[float, str], None]  # called with the fraction that is done, from 0 to 1, and a line of text
StageReport = Callable[[str], None]  # called with a line of text when a stage begins

EVERY = 5.0  # s, after which long work says how far it has come where nothing moves on a terminal


def no_progress(_fraction: float, _text: str) -> None:
    """Say nothing: a Progress."""


def no_report(_text: str) -> None:
    """Say nothing: a StageReport."""


@contextmanager
def told_in_lines(title: str, say: Callable[[str], None], every: float = EVERY) -> Iterator[Progress]:
    """Give a Progress that says how far the block has come, in a line each ``every`` s; nothing of shorter blocks.

    Args:
        title: what the block does.
        say: called with each line, by a thread of its own.
        every: s.
    """
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

    thread = threading.Thread(target=tell, name="eomgen-progress", daemon=True)
    thread.start()
    try:
        yield report
    finally:
        done.set()
        thread.join()
