"""Times of kernels on a device, from 1,000 to 10,000,000 states: calls with rows and with tiles, checks on and off.

    python -m benchmarks.device [--where cuda] [--robot ur5] [--write]

With --write they go into docs/device.md, with the device's name.  Without a device nothing is written.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import eomgen

COUNTS = (1_024, 10_240, 102_400, 1_024_000, 10_240_000)  # whole tiles
FUNCTIONS = ("inverse_dynamics", "forward_dynamics")
ROUNDS = 20
PAGE = Path(__file__).parents[1] / "docs" / "device.md"
_TIMES = re.compile(r"(<!-- begin of times -->\n).*(<!-- end of times -->)", re.S)
HEAD = "| function | dtype | states | rows, us | tiles, us | tiles unchecked, us | a core of the processor, us |"


def least(work: Callable[[], Any], wait: Callable[[Any], Any]) -> float:
    """Return the least time of a call until its result is there, in microseconds."""
    wait(work())
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        wait(work())
        times.append(time.perf_counter() - begin)
    return 1e6 * min(times)


def rows(robot: str, where: str, dtype: str) -> Iterator[str]:
    """Yield lines of the table."""
    kernel = eomgen.build(robot, kernels=FUNCTIONS, dtype=dtype)
    device, quiet = kernel.device(where), kernel.with_checks(False).device(where)
    first = device.put(np.zeros((1, kernel.n)))
    for name in FUNCTIONS:
        for count in COUNTS:
            states = [np.random.default_rng(0).uniform(-1.0, 1.0, (count, kernel.n)).astype(dtype) for _ in range(3)]
            lying = [device.put(x) for x in states]
            tiles = [device.put(np.moveaxis(x.reshape(-1, device.tile, kernel.n), 1, -1)) for x in states]
            times = [
                least(lambda on=on, x=x, f=name: getattr(on, f)(*x), lambda _: device.get(first))  # type: ignore[misc]
                for on, x in ((device, lying), (device, tiles), (quiet, tiles))
            ]
            few = [x[:4096] for x in states]
            core = least(lambda f=name, x=few: getattr(kernel, f)(*x), lambda _: None) * count / len(few[0])  # type: ignore[misc]
            figures = " | ".join(f"{x:.0f}" for x in (*times, core))
            yield f"| {name} | {dtype} | {count} | {figures} |"


def table(robot: str, where: str) -> str:
    """Return what the page says."""
    name = eomgen.build(robot, kernels=FUNCTIONS).device(where).name
    lines = [line for dtype in ("float64", "float32") for line in rows(robot, where, dtype)]
    said = (
        f"{robot} on {name}: least of {ROUNDS} calls from Python until the result is there; the core's, from calls of"
        " at most 4096 states, checked."
    )
    return "\n".join([said, "", HEAD, "|---|---|---|---|---|---|---|", *lines]) + "\n"


def main() -> None:
    """Print the times, and write them where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--where", default="cuda", help="cuda, hip or opencl, with a number such as cuda:1")
    parser.add_argument("--robot", default="ur5")
    parser.add_argument("--write", action="store_true", help="write docs/device.md")
    options = parser.parse_args()
    try:
        text = table(options.robot, options.where)
    except eomgen.InputError as error:
        raise SystemExit(f"not measured: {error}") from None
    print(text)
    if options.write:
        PAGE.write_text(_TIMES.sub(lambda found: found[1] + text + found[2], PAGE.read_text()))


if __name__ == "__main__":
    main()
