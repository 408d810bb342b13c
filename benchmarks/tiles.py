"""Write docs/tiles.md: calls from Python on tiles of states beside the same calls on rows.

    python -m benchmarks.tiles [--repeat ROUNDS] [--output FILE]

Rows and tiles take turns in one process on one core, after their results have been compared to the bit.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.codegen.package.compile import find_compiler

from .bars import Bar, conclusion
from .peers.cases import ELASTIC, TITLES, MissingPeer, case
from .peers.measure import READS, states
from .peers.run import one_core

TARGET = Path(__file__).parents[1] / "docs" / "tiles.md"
ROBOTS = ("UR5", "Talos", ELASTIC)
KERNELS = ("inverse_dynamics", "forward_dynamics")
DTYPES = ("float64", "float32")
MANY = 4096  # states
LEAST_SINGLE = 1.5  # times as fast as double precision, on tiles, required of UR5
CALLS = ("rows", "rows, out", "tiles", "tiles, out", "pack", "unpack")


def timed(key: str, dtype: str, rounds: int) -> dict[str, list[float]]:
    """Return the least times in ns of a state: of each kernel those of CALLS.

    Raises:
        SystemExit: tiles have other bits than rows.
        MissingPeer: the robot's description is not installed.
    """
    robot = case(key).robot
    kernel, drawn = eomgen.build(robot, kernels=KERNELS, dtype=dtype), states(robot, MANY)
    found = {}
    for name in KERNELS:
        rows = [drawn[x].astype(dtype) for x in READS[name]]
        tiles = [kernel.tiled.pack(x) for x in rows]
        on_rows, on_tiles = getattr(kernel, name), getattr(kernel.tiled, name)
        for _ in range(2):  # the first call arms the extension module
            out, in_tiles = on_rows(*rows), on_tiles(*tiles)
        if kernel.tiled.unpack(in_tiles, MANY).tobytes() != out.tobytes():
            sys.exit(f"{robot.name}: {name}: tiles have other bits than rows")
        calls: tuple[Callable[[], Any], ...] = (
            partial(on_rows, *rows),
            partial(on_rows, *rows, out=out),
            partial(on_tiles, *tiles),
            partial(on_tiles, *tiles, out=in_tiles),
            partial(kernel.tiled.pack, rows[0]),
            partial(kernel.tiled.unpack, in_tiles, MANY),
        )
        best = [float("inf")] * len(calls)
        with one_core():
            for _ in range(rounds):
                for place, call in enumerate(calls):
                    begin = time.perf_counter_ns()
                    call()
                    best[place] = min(best[place], (time.perf_counter_ns() - begin) / MANY)
        found[name] = best
    return found


def table(keys: tuple[str, ...], rounds: int) -> tuple[str, list[Bar]]:
    """Return the table of times, and what is required of them."""
    lines = ["| robot | kernel | dtype | " + " | ".join(CALLS) + " | rows by tiles |"]
    lines.append("|---|---|---|" + "---:|" * (len(CALLS) + 1))
    bars = []
    for key in keys:
        tiles = {}
        for dtype in DTYPES:
            for name, best in timed(key, dtype, rounds).items():
                words, ratio = name.replace("_", " "), best[0] / best[2]
                numbers = " | ".join(f"{x:.1f}" for x in best)
                lines.append(f"| {TITLES[key]} | {words} | {dtype} | {numbers} | {ratio:.2f} |")
                tiles[name, dtype] = best[2]
        if key == "UR5":
            for name in KERNELS:
                ratio = tiles[name, "float64"] / tiles[name, "float32"]
                bars.append(Bar(f"{name.replace('_', ' ')} in single precision", ratio, LEAST_SINGLE))
    return "\n".join(lines), bars


TEXT = """# Tiles

Written by `python -m benchmarks.tiles`; do not edit.

C computes a state in every lane of a vector, and a vector wants one number of several states side by side. Rows of
states, (N, n), are transposed on their way in and out; tiles, (ceil(N / W), n, W), are loaded as they are.
`kernel.tiled` has the methods of the kernel on tiles, with the same bits; W, `kernel.tiled.width`, is 8 in double and
16 in single precision on every processor. [Roll out many states](howto/many_states.md#tiles) says how to call it.

Nanoseconds a state of {many} in calls from Python, with checks for NaN and infinity, the least of {rounds} rounds in
which all took turns on one core. With `out` a result has memory that is there already; `pack` and `unpack` are the
conversions of one array of states.

{table}

What a conversion takes is more than what tiles save in one call: they are for whoever keeps states in them.
{conclusion}

- Processor: {processor}
- Compiler: {compiler}
"""


def main() -> int:
    parser = argparse.ArgumentParser(description="Time calls on tiles beside those on rows and write the page.")
    parser.add_argument("--repeat", type=int, default=500, metavar="ROUNDS", help="rounds per row (default 500)")
    parser.add_argument("--output", type=Path, default=TARGET, metavar="FILE", help="default: docs/tiles.md")
    arguments = parser.parse_args()
    if arguments.repeat < 1:
        parser.error(f"--repeat: {arguments.repeat} is not a number of rounds; at least 1")
    keys = []
    for key in ROBOTS:
        try:
            case(key)
        except MissingPeer as missing:
            print(f"{key} is left out: {missing}", file=sys.stderr)
        else:
            keys.append(key)
    lines, bars = table(tuple(keys), arguments.repeat)
    text = TEXT.format(
        table=lines,
        many=MANY,
        rounds=arguments.repeat,
        conclusion=conclusion(bars, ".2f"),
        processor=processor_name(),
        compiler=find_compiler().version.splitlines()[0],
    )
    arguments.output.write_text(text, encoding="ascii")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
