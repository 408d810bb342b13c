"""Long work in pieces that take milliseconds, so that Ctrl-C ends it, and what threads share of it.

A generated package carries a copy of this file.
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise

OPERATIONS = 30_000_000  # of a piece: 2 to 30 ms, 100 ms in code that nothing optimised
ROUND = 16  # states in multiples of it fill the vectors of any processor

Work = Callable[[int, int], Iterator[int]]


def states_at_once(operations: int) -> int:
    """How many states of so many operations each are a piece, at least one vector of them."""
    return max(OPERATIONS // max(operations, 1) // ROUND, 1) * ROUND


def shared(work: Work, count: int, threads: int) -> int:
    """Do work on many states, in threads where there are several.

    Nothing is lost of a piece that has begun when an exception such as KeyboardInterrupt comes, and no thread writes
    any more when it reaches the caller.

    Args:
        work: ``work(first, last)`` does pieces of these states as it is iterated, and yields for each -1, or the number
            of its first failure, which ends it.
        count: the number of states.
        threads: how many of them share the work.

    Returns:
        -1, or the first failure.
    """
    if threads < 2:
        return next((failed for failed in work(0, count) if failed >= 0), -1)
    over = threading.Event()

    def part(first: int, last: int) -> int:
        for failed in work(first, last):
            if failed >= 0 or over.is_set():
                return failed
        return -1

    edges = [count * i // threads for i in range(threads + 1)]
    parts = [_pool(threads).submit(part, *ends) for ends in pairwise(edges)]
    try:
        return min((failed for failed in (future.result() for future in parts) if failed >= 0), default=-1)
    except BaseException:
        over.set()
        wait([future for future in parts if not future.cancel()])
        raise


@functools.cache
def _pool_of(process: int, threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "eomgen")


def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads that wait for batches; a forked process gets its own."""
    return _pool_of(os.getpid(), threads)
