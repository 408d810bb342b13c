"""Builds of kernels that will be called, in a thread that works while the caller does what comes first."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from types import TracebackType

from ..errors import BuildError
from ..kernel.complete import Kernel
from ..runtime.raw import Method
from ..threads import begin_in_thread


class Ahead:
    """Work in a thread until the block ends that this is the context of; what has not begun by then is left out.

    The end of the block waits for what has begun, and raises the exception that ended the thread, unless the block
    itself ended by one.
    """

    def __init__(self) -> None:
        self._threads: list[Future[None]] = []
        self._over = False

    def __enter__(self) -> Ahead:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._over = True
        if kind is None or issubclass(kind, Exception):  # Ctrl-C waits for nothing
            wait(self._threads)
        if kind is None:
            for thread in self._threads:
                thread.result()

    def begin(self, *work: Callable[[], object]) -> None:
        """Do this in its order, in a thread of its own."""

        def run() -> None:
            for piece in work:
                if self._over:
                    return
                piece()

        self._threads.append(begin_in_thread(run))


def build_function(kernel: Kernel, method: Method, *, batch: bool = False) -> None:
    """Build a function of a kernel, for one state or for batches; whoever calls it is told what a build fails of."""
    with suppress(BuildError):  # the call builds again, and raises
        kernel.raw.function(method).where(batch=batch)
