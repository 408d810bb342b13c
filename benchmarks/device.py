"""Times of kernels on a device of CUDA beside GRiD, frax and MuJoCo Warp, from 1,000 to 10,000,000 states.

    python -m benchmarks.device [--robot ur5] [--seconds 300] [--without GRiD] [--write]

Two times each: of a call from Python until its result is there, and of one of many that are begun before the first one
is waited for, which is the kernel's own where that takes longer than to begin it.  Results of all are compared.  With
--write tables go into docs/device.md, with the device's name.  Without a device nothing is written; contenders that are
not installed have no rows.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import platform
import re
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen

from .device_peers import BLOCKS, CONTENDERS, FUNCTIONS, Absent, Work, built

COUNTS = (1_024, 10_240, 102_400, 1_024_000, 10_240_000)  # whole tiles
MOST_DERIVATIVES = 1_024_000  # states whose derivatives, 108 numbers of an arm, are taken
DTYPES = ("float64", "float32")
ROUNDS, QUEUED = 30, 10
LONG = 0.5  # s, after which no more rounds begin
SLOW = 0.02  # s of a call, beside which it does not matter how calls are begun
CORE = 4_096  # states of a call of a core, from which larger ones are reckoned
CLOSE = {"float64": 1e-9, "float32": 2e-2}  # by the largest number of a result; accelerations of an arm's light wrist
WHEELS = {"GRiD": "grid-rbd", "frax": "frax", "MuJoCo Warp": "mujoco-warp", "JAX": "jax", "PyTorch": "torch"}
PAGE = Path(__file__).parents[1] / "docs" / "device.md"
_TIMES = re.compile(r"(<!-- begin of times -->\n).*(<!-- end of times -->)", re.S)
Array = NDArray[Any]


def measured(work: Work) -> tuple[float, float]:
    """Return the least time of a call until its result is there, and of one among many, in microseconds."""
    one = _least(work, 1)
    return 1e6 * one, 1e6 * (one if one > SLOW else _least(work, QUEUED))


def _least(work: Work, calls: int) -> float:
    for _ in range(3):
        work.begin()
    work.wait()
    times, first = list[float](), time.perf_counter()
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        for _ in range(calls):
            work.begin()
        work.wait()
        end = time.perf_counter()
        times.append((end - begin) / calls)
        if end - first > LONG:
            break
    return min(times)


def core(robot: str, function: str, dtype: str, states: Sequence[Array]) -> float:
    """Return the time of a core of the processor for so many states, in microseconds, from calls of few of them."""
    few, kernel = [x[:CORE] for x in states], built(robot, dtype, True)[0]
    method = getattr(kernel, function)
    work = Work(lambda: method(*few), lambda: None, lambda: method(*few))
    return 1e6 * _least(work, 1) * len(states[0]) / len(few[0])


class Table:
    """Times by function, dtype and number of states, and why some are not there."""

    def __init__(self, robot: str, ends: float, without: Sequence[str]) -> None:
        self.robot, self.ends = robot, ends
        self.contenders = {name: make for name, make in CONTENDERS.items() if name not in without}
        self.times: dict[tuple[str, str, int, str], tuple[float, float]] = {}
        self.why: dict[str, str] = {}

    def fill(self) -> Iterator[int]:
        """Measure all, and yield each number of states when it is done; say what there is no time for."""
        for count in COUNTS:
            for dtype in DTYPES:
                for function in FUNCTIONS:
                    if count <= MOST_DERIVATIVES or "jacobian" not in function:
                        self._fill(function, dtype, count)
            yield count

    def _fill(self, function: str, dtype: str, count: int) -> None:
        rng = np.random.default_rng(0)
        states = [rng.uniform(-1.0, 1.0, (count, built(self.robot, dtype, True)[0].n)).astype(dtype) for _ in range(3)]
        wanted = getattr(built(self.robot, dtype, True)[0], function)(*(x[-CORE:] for x in states))
        if isinstance(wanted, tuple):
            wanted = np.stack(wanted[:BLOCKS], 1)
        time_of_core = core(self.robot, function, dtype, states)
        self.times[function, dtype, count, "core"] = time_of_core, time_of_core
        for name, make in self.contenders.items():
            if time.monotonic() > self.ends:
                self.why.setdefault(name, "no time was left")
                continue
            try:
                work = make(self.robot, function, dtype, states)
                found = measured(work)
                result = work.result()[-CORE:]
            except Absent as absent:
                self.why.setdefault(name, str(absent))
                continue
            except Exception as failure:  # each library has errors of its own, where memory is too little
                self.why[f"{name}, {function}, {dtype}, {count}"] = f"{type(failure).__name__}: {str(failure)[:200]}"
                continue
            difference = float(np.abs(result - wanted).max() / np.abs(wanted).max())
            if not difference <= CLOSE[dtype]:
                self.why[f"{name}, {function}, {dtype}, {count}"] = f"differs by {difference:.0e}"
                continue
            self.times[function, dtype, count, name] = found
            said = " ".join(f"{x:.0f}" for x in found)
            print(
                f"{function} {dtype} {count} {name}: {said} us, differs by {difference:.0e}",
                file=sys.stderr,
                flush=True,
            )

    def lines(self, which: int) -> Iterator[str]:
        """Yield lines of the table of calls (0), or of many calls (1)."""
        names = [name for name in CONTENDERS if any(key[3] == name for key in self.times)]
        yield f"| function | dtype | states | {' | '.join(names)} | a core |"
        yield "|---|---|---:" + "|---:" * (len(names) + 1) + "|"
        for function in FUNCTIONS:
            for dtype in DTYPES:
                for count in COUNTS:
                    cells = [self.times.get((function, dtype, count, name)) for name in (*names, "core")]
                    if any(cells[:-1]):
                        said = " | ".join("" if cell is None else f"{cell[which]:,.0f}" for cell in cells)
                        yield f"| {function} | {dtype} | {count:,} | {said} |"

    def text(self) -> str:
        """Return what the page says."""
        versions = [f"{title} {_version(wheel)}" for title, wheel in WHEELS.items() if _version(wheel)]
        name = built(self.robot, DTYPES[0], True)[1].name
        return "\n".join(
            [
                f"`{self.robot}` on {name}, with a processor {_processor()}; {', '.join(versions)}. Microseconds of a"
                f" call from Python until the result is there, the least of up to {ROUNDS}:",
                "",
                *self.lines(0),
                "",
                f"Microseconds of a call among {QUEUED} that are begun one after the other and then waited for:",
                "",
                *self.lines(1),
                "",
                f"A core's are those of {CORE:,} states, from Python, checked. Results of all were compared with the"
                " processor's. Derivatives are those by coordinates and velocities; eomgen's by drives, too.",
                "Where nothing stands, a contender has no such function, dtype or number of states.",
                "",
                *(f"- Not there: {name}: {why}." for name, why in self.why.items()),
            ]
        )


def _version(wheel: str) -> str:
    try:
        return importlib.metadata.version(wheel)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _processor() -> str:
    try:
        found = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text(encoding="utf-8"))
    except OSError:
        found = None
    return found[1] if found else platform.processor()


def main() -> None:
    """Print the tables, and write them where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="ur5")
    parser.add_argument("--seconds", type=float, default=600.0, help="after which nothing more is begun")
    parser.add_argument("--without", action="append", default=[], choices=list(CONTENDERS), help="leave one out")
    parser.add_argument("--write", action="store_true", help="write docs/device.md")
    options = parser.parse_args()
    table = Table(options.robot, time.monotonic() + options.seconds, options.without)
    try:
        built(options.robot, DTYPES[0], True)
    except eomgen.InputError as error:
        raise SystemExit(f"not measured: {error}") from None
    for _ in table.fill():  # whoever is stopped has what there is
        text = f"{table.text()}\n"
        if options.write:
            PAGE.write_text(_TIMES.sub(lambda found, text=text: found[1] + text + found[2], PAGE.read_text()))  # type: ignore[misc]
    print(text)


if __name__ == "__main__":
    main()
