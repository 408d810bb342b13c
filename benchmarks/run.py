"""Write docs/benchmarks.md: ``eomgen bench`` over several robots, as tables.

    python benchmarks/run.py [--repeat ROUNDS] [--output FILE] [ROBOT ...]

Counts are exact and the same on every machine.  Times are ratios alone: two contenders that took turns in one
process on one machine.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import eomgen
from eomgen.bench.beside import BenchResult, Contender, Row, bench
from eomgen.robot.value import COORDINATES, Coordinate, Robot

HERE = Path(__file__).parent
TARGET = HERE.parent / "docs" / "benchmarks.md"


def generic(name: str) -> Robot:
    """Return a robot of benchmarks/data: all ten inertial parameters of every link are non-zero."""
    return eomgen.load_robot(str(HERE / "data" / f"{name}.urdf"))


def six(robot: Robot) -> Robot:
    """Return the same chain with six active coordinates in every joint."""
    every = {
        joint.name: {name: Coordinate() for name in COORDINATES if name not in joint.coordinates}
        for joint in robot.joints
    }
    return replace(robot.with_coordinates(every), name=f"{robot.name}_x6")


ROBOTS: Mapping[str, Callable[[], Robot]] = {
    "puma560": lambda: eomgen.load_robot("puma560"),
    "puma560_elastic": lambda: eomgen.load_robot("puma560_elastic"),
    "ur5": lambda: eomgen.load_robot("ur5"),
    "puma560_generic": lambda: generic("puma560_generic"),
    "ur5_generic": lambda: generic("ur5_generic"),
    "puma560_generic_x6": lambda: six(generic("puma560_generic")),
    "ur5_generic_x6": lambda: six(generic("ur5_generic")),
}


def page(results: list[BenchResult], command: str) -> str:
    """Return the whole page."""
    first = results[0]
    lines = [
        "# Benchmarks",
        "",
        f"Written by `{command}`; do not edit.",
        "",
        "Operation counts are those of the emitted C and hold on every machine (a subtraction or a change of sign"
        " counts as an addition, a sine with its cosine as one). Beside a kernel stands a textbook algorithm as one"
        " writes it by hand, a loop over a table of links (`templates/bench/newton_euler.c.jinja`): recursive"
        " Newton-Euler for inverse dynamics, composite bodies for the mass matrix, articulated bodies for forward"
        " dynamics. Its operations are counted by running an instrumented copy of the same text. It knows nothing of"
        " zeros in the table beyond what is cheaper along a principal axis; leaving out the others is what a generator"
        " is for.",
        "",
        "The last column is the textbook's time per call by the kernel's: median over"
        f" {first.rounds} rounds in which both took turns (one process, the loop in C, {first.states} random states),"
        " with the quartiles in brackets. Above 1 the kernel is faster. Kernel and textbook agreed to"
        f" {max(result.error for result in results):.0e} (relative) or better before anything was timed.",
        "",
        f"- Processor: {first.processor}",
        f"- Compiler: {first.compiler}",
        f"- Flags of both: `{' '.join(first.flags)}`",
    ]
    for result in results:
        lines += ["", *table(result)]
    return "\n".join(lines) + "\n"


def table(result: BenchResult) -> list[str]:
    """Return the table of one robot: counts and ratios."""
    lines = [
        f"## {result.robot} ({result.coordinates} coordinates)",
        "",
        "| kernel | mul | add | div | sincos | textbook mul | add | div | sincos | time of textbook / kernel |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    return [*lines, *(_row(row) for row in result.rows)]


def _row(row: Row) -> str:
    ratio = row.note
    if row.ratio is not None and row.ratio_quartiles is not None:
        low, high = row.ratio_quartiles
        ratio = f"{row.ratio:.2f} ({low:.2f} - {high:.2f})"
    cells = [row.kernel.name, *_counts(row.kernel), *_counts(row.counterpart), ratio]
    return f"| {' | '.join(cells)} |"


def _counts(contender: Contender | None) -> list[str]:
    if contender is None:
        return [""] * 4
    return [str(contender.operations[key]) for key in ("mul", "add", "div", "sincos")]


def main() -> int:
    parser = argparse.ArgumentParser(
        description="Measure kernels beside Newton-Euler in C and write the page of tables."
    )
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help=f"of {', '.join(ROBOTS)} (default: all)")
    parser.add_argument("--repeat", type=int, default=100, metavar="ROUNDS", help="rounds per row (default 100)")
    parser.add_argument("--output", type=Path, default=TARGET, metavar="FILE", help="default: docs/benchmarks.md")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.robots if name not in ROBOTS]
    if unknown:
        parser.error(f"ROBOT: {unknown[0]!r} is unknown; allowed: {', '.join(ROBOTS)}")
    results = []
    for name in arguments.robots or ROBOTS:
        progress = _report(name) if sys.stderr.isatty() else _silent
        try:
            results.append(bench(ROBOTS[name](), repeat=arguments.repeat, progress=progress))
        except eomgen.InputError as error:
            print(error, file=sys.stderr)
            return 1
        print("\n".join([*results[-1].lines(), ""]))
    chosen = "" if not arguments.robots else " " + " ".join(arguments.robots)
    arguments.output.write_text(page(results, f"python benchmarks/run.py{chosen}"), encoding="ascii")
    print(f"wrote {arguments.output}")
    return 0


def _report(name: str) -> Callable[[str], None]:
    return lambda line: print(f"{name}: {line}", file=sys.stderr)


def _silent(_: str) -> None:
    """Report no progress."""


if __name__ == "__main__":
    sys.exit(main())
