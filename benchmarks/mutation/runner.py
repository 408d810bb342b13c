"""Run the checks of the tests on mutants, each in a process that is forked from a warm one."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from tests.support.mutant import Mutant

LIMIT = 60  # s of processor time for one mutant: an endless loop
CODES = {0: "survived", 1: "wrong", 2: "error"}


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant: "survived", "wrong" (a check failed), "error" (it raised) or "timeout"; and its time."""

    mutant: Mutant
    result: str
    seconds: float


def run(mutants: Sequence[Mutant], judge: Callable[[Mutant], None], processes: int) -> Iterator[Outcome]:
    """Yield outcomes as they come.

    Args:
        judge: runs the checks on a mutant; what it raises says "wrong" (a check failed) or "error".
        processes: how many at once.
    """
    gc.collect()
    gc.freeze()  # or every child would copy what it only collects
    waiting, running = list(reversed(mutants)), dict[int, Mutant]()
    while waiting or running:
        while waiting and len(running) < processes:
            mutant = waiting.pop()
            running[_start(mutant, judge)] = mutant
        pid, status, used = os.wait4(-1, 0)
        result = CODES[os.waitstatus_to_exitcode(status)] if os.WIFEXITED(status) else "timeout"
        yield Outcome(running.pop(pid), result, used.ru_utime + used.ru_stime)


def _start(mutant: Mutant, judge: Callable[[Mutant], None]) -> int:
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        return pid
    code = 2
    try:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, LIMIT)
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        sys.setrecursionlimit(1000)
        judge(mutant)
        code = 0
    except BaseException as error:  # Failed: of pytest.raises; InternalError: a proof of the generator
        code = 1 if type(error).__name__ in ("AssertionError", "Failed", "InternalError") else 2
    finally:
        os._exit(code)


class Clock:
    """Says how far a run is, on a terminal or in a log, every half minute."""

    def __init__(self, total: int) -> None:
        self.total, self.done, self.last, self.alive = total, 0, time.monotonic(), 0

    def tick(self, result: str) -> None:
        self.done += 1
        self.alive += result == "survived"
        if time.monotonic() - self.last > 30.0 or self.done == self.total:
            self.last = time.monotonic()
            print(f"{self.done} of {self.total} mutants, {self.alive} survived", flush=True)
