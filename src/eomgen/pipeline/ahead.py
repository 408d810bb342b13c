"""Work that begins before its results are asked for: builds of kernels that will be called, beside what comes first."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from types import TracebackType

from ..runtime.kernel import Kernel

THREADS = max(2, min(os.cpu_count() or 1, 4))  # each waits for two or three compilers


class Ahead:
    """Threads for such work, until the block ends that it is the context of; what has not begun by then is left out.

    An exception ends a piece of work and nothing else: whoever asks for its result tries again, and is told.
    """

    def __init__(self) -> None:
        self._waiting: deque[Callable[[], object]] = deque()
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._working = 0  # threads that will look for further work

    def __enter__(self) -> Ahead:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with self._lock:
            self._waiting.clear()
        if kind is None or issubclass(kind, Exception):  # Ctrl-C waits for nothing
            for thread in self._threads:
                thread.join()

    def begin(self, *work: Callable[[], object]) -> None:
        """Do this in its order, on a few threads."""
        with self._lock:
            self._waiting.extend(work)
            new = min(len(work), THREADS - self._working)
            self._working += new
        for _ in range(new):
            self._threads.append(threading.Thread(target=self._work, name="eomgen ahead", daemon=True))
            self._threads[-1].start()

    def build(self, kernel: Kernel, *functions: str, batch: bool = False) -> None:
        """Begin to build functions of a kernel, for one state or for batches."""
        self.begin(*(partial(kernel.raw.function(name).where, batch=batch) for name in functions))

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._working -= 1
                    return
                piece = self._waiting.popleft()
            with suppress(Exception):
                piece()
