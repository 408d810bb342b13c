"""Write the measurements of docs/levels.md: how many times as fast wider instructions are.

    python -m benchmarks.levels [--rounds ROUNDS] [--print]

Ratios alone: the same kernel compiled for each level takes turns with itself, the loop in C.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.bench.textbook import compile_yardstick
from eomgen.codegen.package.compile import FLAGS, find_compiler
from eomgen.errors import EomgenWarning, InternalError
from eomgen.robot.model import build_model
from eomgen.runtime.levels import BASE, allowed_levels

from .peers.cases import ELASTIC, Case, case
from .peers.contender import Contender
from .peers.measure import READS, SIZES, states, time

PAGE = Path(__file__).parents[1] / "docs" / "levels.md"
BEGIN, END = "<!-- begin of ratios -->\n", "<!-- end of ratios -->"
ROBOTS = ("UR5", ELASTIC, "Talos")
KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
STATES, TOGETHER = 16, 1024  # of one call each, and of one call
FUSED = "-ffp-contract=fast"


def ways() -> dict[str, dict[str, object]]:
    """Return options of builds by what they are called, the base first."""
    options: dict[str, dict[str, object]] = {}
    for level in allowed_levels():
        options[level] = {"level": level}
        if level != BASE:
            options[f"{level}, fused"] = {"level": level, "flags": (FUSED,)}
    return options | {"native": {"native": True}}


def rows(chosen: Case, rounds: int) -> Iterator[tuple[str, bool, dict[str, float]]]:
    """Yield kernel, whether for states together, and by way the base's time over its time.

    The median of rounds in turns.
    """
    kernels = {way: eomgen.build(chosen.robot, kernels=KERNELS, **options) for way, options in ways().items()}  # type: ignore[arg-type]
    stopwatch = compile_yardstick(build_model(chosen.robot), FLAGS).stopwatch
    for together in (False, True):
        inputs = states(chosen.robot, TOGETHER if together else STATES)
        for name in KERNELS:
            arrays = [inputs[array] for array in READS[name]]
            size = SIZES[name](chosen.coordinates) if name in SIZES else chosen.coordinates
            contenders = [contender(way, kernel, name, together) for way, kernel in kernels.items()]
            check_bits(contenders, arrays, size)
            ns = time(stopwatch, contenders, arrays, size, max(5, rounds // 5) if together else rounds)
            yield name, together, {way: float(np.median(ns[BASE] / ns[way])) for way in ns if way != BASE}


def contender(way: str, kernel: eomgen.Kernel, name: str, together: bool) -> Contender:
    """Return a kernel as the stopwatch takes it."""
    function, setup = kernel.raw.functions[name], kernel.parameters.setup
    address = kernel.raw.address(name, batch=together)
    return Contender(way, address, setup.address(function.where(batch=together)), batch=together, kept=(kernel, setup))


def check_bits(contenders: Sequence[Contender], arrays: Sequence[np.ndarray], size: int) -> None:
    """Raise InternalError where levels without fused multiply-adds differ."""
    base, *others = (c for c in contenders if c.label in allowed_levels())
    expected = base.results(arrays, size)
    for other in others:
        if not np.array_equal(other.results(arrays, size), expected):
            raise InternalError(f"{other.label} gives other bits than {base.label}")


def table(ratios_of: Mapping[tuple[str, str], Mapping[str, float]]) -> list[str]:
    """Return rows by robot and kernel, a column for each way."""
    heads = list(next(iter(ratios_of.values())))
    lines = [f"| robot | kernel | {' | '.join(heads)} |", "|---|---" + "|---:" * len(heads) + "|"]
    for (robot, kernel), ratios in ratios_of.items():
        cells = [f"{ratios[head]:.2f}" for head in heads]
        lines.append(f"| {robot} | {kernel.replace('_', ' ')} | {' | '.join(cells)} |")
    return lines


def report(rounds: int) -> str:
    """Return both tables, and what they were measured on."""
    ratios_of: dict[bool, dict[tuple[str, str], dict[str, float]]] = {False: {}, True: {}}
    for key in ROBOTS:
        chosen = case(key)
        for kernel, together, ratios in rows(chosen, rounds):
            ratios_of[together][chosen.title, kernel] = ratios
            print(f"{chosen.title}: {kernel}{' together' if together else ''}: {ratios}", file=sys.stderr, flush=True)
    lines = [
        f"Measured by `python -m benchmarks.levels` on {processor_name()}, {find_compiler().version.splitlines()[0]}:",
        f"the time of `{BASE}` by that of the others, the median of rounds in which all take turns. One state a call:",
        "",
        *table(ratios_of[False]),
        "",
        f"{TOGETHER} states a call:",
        "",
        *table(ratios_of[True]),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, and write the figures into the page or print them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.levels")
    parser.add_argument("--rounds", type=int, default=200, help="rounds in turns (200)")
    parser.add_argument("--print", action="store_true", help="print the tables, write nothing")
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        text = report(options.rounds)
    if options.print:
        print(text, end="")
        return
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    PAGE.write_text(before + BEGIN + text + END + rest.split(END, 1)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
