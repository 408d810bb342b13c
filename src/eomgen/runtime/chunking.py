"""Long work in chunks of milliseconds, so that Ctrl-C ends it, shared among threads."""

from __future__ import annotations

import functools
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise

OPERATIONS = 100_000_000  # of a piece: 3 to 100 ms, 300 ms in code that nothing optimised
PATIENCE = 0.01  # s, until the caller looks for Ctrl-C: a signal that another thread gets does not end its wait
ROUND = 16  # states in multiples of it fill the vectors of any processor

Work = Callable[[int, int], Iterator[int]]


def states_at_once(operations: int) -> int:
    """Return how many states of so many operations each are a chunk, at least one vector of them."""
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
    crew = _Crew(work, [count * i // threads for i in range(threads + 1)])
    crew.work_in(_pool(os.getpid(), threads))
    return min((failed for failed in crew.failures if failed >= 0), default=-1)


class _Crew:
    """Shares of a work, one for each thread.

    Ctrl-C ends the caller between any two of its steps, also inside of the library's futures and events, which may then
    keep their locks; so this needs bare locks and lists alone.
    """

    def __init__(self, work: Work, edges: Sequence[int]) -> None:
        self.work, self.parts = work, list(pairwise(edges))
        self.failures, self.errors, self.done = [-1] * len(self.parts), list[BaseException](), [False] * len(self.parts)
        self._over = False
        self._begin, self._end = ([threading.Lock() for _ in self.parts] for _ in range(2))
        for lock in (*self._begin, *self._end):
            lock.acquire()

    def work_in(self, pool: ThreadPoolExecutor) -> None:
        """Do all shares and wait for them; none begins before all have a thread."""
        begun = False
        try:
            for i in range(len(self.parts)):
                pool.submit(self._part, i)
            begun = True
            for lock in self._begin:
                lock.release()
            for lock in self._end:
                while not lock.acquire(timeout=PATIENCE):
                    pass
        except BaseException:
            self._over = True
            for lock in self._begin:
                with suppress(RuntimeError):  # it is released already
                    lock.release()
            while begun and not all(self.done):
                time.sleep(PATIENCE / 10)
            raise
        for error in self.errors:
            raise error

    def _part(self, i: int) -> None:
        self._begin[i].acquire()
        try:
            for failed in self.work(*self.parts[i]) if not self._over else ():
                self.failures[i] = failed
                if failed >= 0 or self._over:
                    break
        except BaseException as error:  # the caller raises it
            self.errors.append(error)
        finally:
            self.done[i] = True
            self._end[i].release()


@functools.cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Return threads that wait for batches; a forked process gets new ones."""
    return ThreadPoolExecutor(threads, "eomgen")
