"""Python's search for cycles of objects, which costs more than it finds where many objects arise and stay."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collection() -> Iterator[None]:
    """No search for cycles during a block, or in calls of a function that this decorates.

    Half of the time of a derivation, three quarters of that of reading many tables went into it, and both leave none.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
