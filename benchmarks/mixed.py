"""Write the table of docs/rounding.md: what some instructions in double precision give, and cost a Cortex-M7.

python -m benchmarks.mixed [--print]
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import eomgen
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Coordinate, Motor, Robot
from eomgen.rounding import float32_advice
from eomgen.rounding.advice_result import Float32Errors
from eomgen.rounding.ranges import chosen_ranges, deflections, random_states

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "rounding.md"
BEGIN, END = "<!-- begin of mixed -->\n", "<!-- end of mixed -->"
STATES = 8  # of which each is a call
STIFFNESS, RATIO, INERTIA = (2e4, 2e4, 1.5e4, 5e3, 5e3, 3e3), 100.0, 1e-4  # N m/rad, and kg m^2 of rotors
ENTRY = """#include "{name}.h"
static const {real} states[{count}][{size}] = {{
{rows}
}};
static const {real} p[] = {{ {parameters}, 0 }};
static {real} h[{hoisted}], out[{outputs}];
static int k, status;
void setup(void) {{ {name}_setup(p, h); }}
void sample(void) {{ status |= {name}_{kernel}(h, {arguments}, out); ++k; }}
void reset(void) {{ setup(); sample(); }}
"""


def elastic_ur5() -> Robot:
    """The UR5 with a motor behind an elastic gear at every joint."""
    robot = eomgen.load_robot("ur5")
    motors = (Motor(INERTIA, RATIO, Coordinate(stiffness)) for stiffness in STIFFNESS)
    joints = (replace(joint, motor=motor) for joint, motor in zip(robot.joints, motors, strict=True))
    return replace(robot, name="elastic_ur5", joints=tuple(joints))


def built_in(name: str) -> Callable[[], Robot]:
    return lambda: eomgen.load_robot(name)


CASES: tuple[tuple[str, Callable[[], Robot], str, float], ...] = (
    ("`ur5` with elastic gears, linear", elastic_ur5, "inverse_dynamics", 1e-5),
    ("`ur5` with elastic gears, linear", elastic_ur5, "generalized_force", 1e-6),
    ("`geared_arm`", built_in("geared_arm"), "inverse_dynamics", 1e-5),
    ("`worn_arm`", built_in("worn_arm"), "energy", 1e-6),
    ("`ur5`", built_in("ur5"), "inverse_dynamics", 5e-6),
)


def instructions_of(robot: Robot, kernel: str, dtype: str, within: float | None) -> int:
    """Return the mean number of instructions of a call on an emulated Cortex-M7."""
    sys.path.insert(0, str(ROOT / "examples" / "controller"))
    try:
        from calls import instructions, linked
    finally:
        sys.path.pop(0)
    source = make_source(robot, Options((kernel,), dtype, batches=False, within=within))
    with TemporaryDirectory() as name:
        entry = entry_of(build_model(robot), kernel, dtype, source.files[f"{robot.name}.h"])
        path = linked(source.files, entry, Path(name), dtype=dtype)
        counts = instructions(path, ("setup", *["sample"] * STATES))
    return round(float(np.mean(counts[1:])))


def entry_of(model: Model, kernel: str, dtype: str, header: str) -> str:
    """Write what calls a kernel at random states, the same for all types of numbers."""
    reads = KERNELS[kernel].reads
    states = random_states(chosen_ranges(model, reads, {}, "float32"), deflections(model, {}), STATES, "float32")
    rows = np.concatenate([np.array(states[array]) for array in reads]).T
    starts = np.cumsum([0, *(len(states[array]) for array in reads)])
    hoisted = re.search(r"_HOISTED (\d+)", header)
    assert hoisted is not None
    values = np.array(list(model.parameters.values()), dtype)
    suffix = "f" if dtype == "float32" else ""
    return ENTRY.format(
        name=model.name,
        kernel=kernel,
        real="float" if dtype == "float32" else "double",
        count=STATES,
        size=rows.shape[1],
        rows=",\n".join("    { " + ", ".join(f"{float(x).hex()}{suffix}" for x in row) + " }" for row in rows),
        parameters=", ".join(f"{float(x).hex()}{suffix}" for x in values),
        hoisted=max(1, int(hoisted[1])),
        outputs=max(2, model.size),
        arguments=", ".join(f"&states[k][{start}]" for start in starts[:-1]),
    )


def row(title: str, robot: Robot, kernel: str, within: float) -> str:
    """Return a row of the table."""
    single, some = (float32_advice(robot, (kernel,), within=x).kernels[kernel] for x in (None, within))
    kinds = (("float32", None), ("float32", within), ("float64", None))
    counts = [instructions_of(robot, kernel, *kind) for kind in kinds]
    cells = [
        title,
        kernel.replace("_", " "),
        f"{within:.0e}",
        f"{some.in_double} of {some.operations}",
        *(f"{_largest(errors.relative, errors):.1e}" for errors in (single, some)),
        *(f"{_largest(errors.relative_observed, errors):.1e}" for errors in (single, some)),
        *map(str, counts),
    ]
    return f"| {' | '.join(cells)} |"


def _largest(ratios: np.ndarray, errors: Float32Errors) -> float:
    return float(ratios[np.isfinite(ratios) & (errors.size > 1e-10 * errors.size.max())].max())


def table() -> Iterator[str]:
    """Yield the lines of the table."""
    yield (
        f"Written by `python -m benchmarks.mixed`: {STATES} random states, zig, unicorn's Cortex-M7 with double"
        " precision in software; errors are the largest, by the size of outputs:"
    )
    yield ""
    yield (
        "| robot | kernel | `--float32-within` | operations in double | bound, float | bound, mixed | observed, float"
        " | observed, mixed | instructions, float | mixed | double |"
    )
    yield "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    for title, make, kernel, within in CASES:
        yield row(title, make(), kernel, within)


def main() -> None:
    """Write the table into the page, or print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mixed")
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
