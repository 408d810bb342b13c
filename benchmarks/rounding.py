"""Write the table of docs/rounding.md: proved bounds compared with bounds and errors of random states.

python -m benchmarks.rounding [--print]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import eomgen
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.precision import rounding_bound
from eomgen.precision.adjoints import bound_outputs
from eomgen.precision.programs import output_values, with_setup
from eomgen.precision.ranges import chosen_ranges
from eomgen.precision.values import program_intervals
from eomgen.robot.model import build_model

PAGE = Path(__file__).parents[1] / "docs" / "rounding.md"
BEGIN, END = "<!-- begin of bounds -->\n", "<!-- end of bounds -->"
CASES = (
    ("one_link", "inverse_dynamics"),
    *(("ur5", kernel) for kernel in ("inverse_dynamics", "bias_force", "mass_matrix", "kinematics")),
    *(("puma560_elastic", kernel) for kernel in ("inverse_dynamics", "mass_matrix", "gravity", "kinematics")),
)
STATES, OBSERVED = 32, 2000  # random ones: bounded each by itself, and computed


def row(robot: str, kernel: str) -> str:
    """Return a row of the table: ratios are medians over the outputs that round, and the largest in brackets."""
    began = time.process_time()
    bound = rounding_bound(robot, kernel)
    took = time.process_time() - began
    equations = derive_equations(build_model(eomgen.load_robot(robot)), (kernel,))
    program = with_setup(equations.programs[kernel], equations.setup)
    ranges = chosen_ranges(equations.model, KERNELS[kernel].reads, {}, "float64")
    rng = np.random.default_rng(0)

    def states(count: int) -> dict[str, list[np.ndarray]]:
        return {name: [rng.uniform(*ends, count).astype("f4") for ends in rows] for name, rows in ranges.items()}

    points = {name: [(x, x) for x in map(np.float64, rows)] for name, rows in states(STATES).items()}
    found = program_intervals(program, "float64", points)
    places = [place for (_, place), index in program.outputs.items() if found.obstacles[index] < 0]
    each = bound_outputs(found, [program.outputs["out", place] for place in places])
    running = np.zeros(len(bound.outputs))
    running[places] = each.plain
    narrow = states(OBSERVED)
    wide = {name: [x.astype(np.float64) for x in rows] for name, rows in narrow.items()}
    single, double = (
        output_values(program, x, dtype, len(bound.outputs)) for dtype, x in (("float32", narrow), ("float64", wide))
    )
    observed = np.abs(single - double).max(axis=1)
    in_single = rounding_bound(robot, kernel, dtype="float32").bound
    cells = [
        robot,
        kernel.replace("_", " "),
        str(len(program.instructions)),
        f"{np.median(bound.relative[bound.bound > 0.0]):.0e}",
        _ratios(bound.bound, running),
        _ratios(in_single, observed),
        f"{took:.2f}",
    ]
    return f"| {' | '.join(cells)} |"


def _ratios(bounds: np.ndarray, beside: np.ndarray) -> str:
    rounds = (beside > 0.0) & np.isfinite(bounds)
    ratios = bounds[rounds] / beside[rounds]
    return f"{np.median(ratios):.3g} ({ratios.max():.2g})"


def table() -> Iterator[str]:
    """Yield the lines of the table."""
    yield f"Measured by `python -m benchmarks.rounding`, ranges as by default, {STATES} and {OBSERVED} random states:"
    yield ""
    yield (
        "| robot | kernel | instructions | bound by size, median | by largest bound of a state, median (largest)"
        " | by largest observed error, median (largest) | processor time with derivation, s |"
    )
    yield "|---|---|---:|---:|---:|---:|---:|"
    for robot, kernel in CASES:
        yield row(robot, kernel)


def main() -> None:
    """Write the table into the page, or print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rounding")
    parser.add_argument("--print", action="store_true", help="print the table, and leave the page as it is")
    options = parser.parse_args()
    text = "\n".join(table()) + "\n"
    if options.print:
        print(text)
        return
    page = PAGE.read_text(encoding="utf-8")
    front, rest = page.split(BEGIN)
    PAGE.write_text(front + BEGIN + text + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
