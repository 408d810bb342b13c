"""Work in threads, whose exceptions reach the caller; and whether Python is about to end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from .errors import BuildError

T = TypeVar("T")


def check_not_ending() -> None:
    """Raise an error in a daemon thread if Python is exiting and would not finish its work.

    Raises:
        BuildError: the main thread has ended.
    """
    if threading.current_thread().daemon and not threading.main_thread().is_alive():
        raise BuildError("Python is exiting; nothing is built any more")


def begin_in_thread(work: Callable[[], T]) -> Future[T]:
    """Start ``work()`` in a daemon thread; ``result()`` waits for it and re-raises its exception."""
    future = Future[T]()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # the caller raises it
            future.set_exception(error)

    threading.Thread(target=run, name="eomgen work", daemon=True).start()
    return future


def in_new_thread(work: Callable[[], T]) -> T:
    """Run ``work()`` in a new thread and return its result or re-raise its exception.

    A library that was linked with fast arithmetic turns denormal numbers off in the thread that loads it, and there
    alone.
    """
    return begin_in_thread(work).result()
