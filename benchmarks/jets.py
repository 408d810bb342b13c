"""Write docs/jets.md: time derivatives along motions beside the values alone, in operations and in time.

    python -m benchmarks.jets [--repeat ROUNDS] [--output FILE]

Times are those of the C for one state, called in turn for many; orders take turns in one process on one core.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from pathlib import Path

import numpy as np

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.codegen.kernels.derived import MOTION, ORDERS
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.package.compile import find_compiler
from eomgen.codegen.program.forward_mode import tangent
from eomgen.codegen.program.ir import Program
from eomgen.codegen.program.passes import run_passes
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot

from .bars import Bar, conclusion
from .batches import CODE
from .peers.cases import ELASTIC, TITLES, MissingPeer, case
from .peers.contender import FFI, build_library
from .peers.measure import states
from .peers.run import one_core

TARGET = Path(__file__).parents[1] / "docs" / "jets.md"
ROBOTS = ("UR5", "PUMA 560", "Talos", ELASTIC)
KERNELS = ("inverse_dynamics", "forward_dynamics")
TIMED = (1, 2, 3)  # orders
MANY = 64  # states of a call, in the nearest caches
MOST: dict[tuple[str, str], float] = {  # operations of the second order by those of the value, required
    ("UR5", "inverse_dynamics"): 4.5,
    ("PUMA 560", "inverse_dynamics"): 4.5,
    ("Talos", "inverse_dynamics"): 4.5,
    (ELASTIC, "inverse_dynamics"): 4.8,
    **{(robot, "forward_dynamics"): 5.1 for robot in ROBOTS},
}
MOST_TIME = 2.7  # of the second order of 6R arms' inverse dynamics
FFI.cdef(
    "int in_turn(void *code, const double *h, const double *const *x, int reads, size_t n, size_t count, double *out);"
)


def robot_of(key: str) -> Robot:
    """Return a robot by its title.

    Raises:
        MissingPeer: its description is not installed.
    """
    return eomgen.load_robot("puma560") if key == "PUMA 560" else case(key).robot


def operations(program: Program) -> int:
    """Count operations of one run, a sine with its cosine as one."""
    return sum(program.count().values())


def nested(model: Model, kernel: str) -> Program:
    """Return the second time derivative by forward differentiation of forward differentiation; u is constant."""
    program = derive(model, kernel)
    for order in (1, 2):
        rates = dict(itertools.pairwise(MOTION[: 3 + order]))
        program = run_passes(tangent(program, rates, f"nested{order}"))
    return program


def counted(keys: tuple[str, ...]) -> tuple[str, list[Bar]]:
    """Return the table of operations, and what is required of it."""
    head = ["robot", "kernel", "operations", *(f"order {k}" for k in ORDERS), "order 2, nested"]
    lines = ["| " + " | ".join(head) + " |", "|---|---|" + "---:|" * (len(head) - 2)]
    bars = []
    for key in keys:
        model = build_model(robot_of(key))
        for kernel in KERNELS:
            value = operations(derive(model, kernel))
            ratios = [operations(derive(model, f"{kernel}_jet{k}")) / value for k in ORDERS]
            both = operations(nested(model, kernel)) / value
            bars.append(
                Bar(f"operations of the second order, {kernel}, {key}", ratios[1], MOST[key, kernel], at_most=True)
            )
            cells = [f"{x:.2f}" for x in ratios]
            cells[1] += f" {bars[-1].brackets}"
            row = [TITLES.get(key, key), kernel.replace("_", " "), str(value), *cells, f"{both:.2f}"]
            lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines), bars


def timed(keys: tuple[str, ...], rounds: int) -> tuple[str, list[Bar]]:
    """Return the table of times of the inverse dynamics, and what is required of it."""
    text = CODE.read_text(encoding="ascii")
    library = FFI.dlopen(
        str(build_library("one_by_one", "cc", [("-std=c99", "-O2", CODE.name)], (), {CODE.name: text}))
    )
    lines = [
        "| robot | value, ns | " + " | ".join(f"order {k}" for k in TIMED) + " |",
        "|---|---:|" + "---:|" * len(TIMED),
    ]
    bars = []
    for key in keys:
        ns = _times(library, robot_of(key), rounds)
        ratios = [x / ns[0] for x in ns[1:]]
        cells = [f"{x:.2f}" for x in ratios]
        if key in ("UR5", "PUMA 560"):
            bars.append(Bar(f"time of the second order, inverse dynamics, {key}", ratios[1], MOST_TIME, at_most=True))
            cells[1] += f" {bars[-1].brackets}"
        lines.append(f"| {TITLES.get(key, key)} | {ns[0]:.0f} | " + " | ".join(cells) + " |")
    return "\n".join(lines), bars


def _times(library: object, robot: Robot, rounds: int) -> list[float]:
    """Return the least times in ns of a state: of the inverse dynamics, then of its orders."""
    names = ("inverse_dynamics", *(f"inverse_dynamics_jet{k}" for k in TIMED))
    kernel, drawn = eomgen.build(robot, kernels=names), states(robot, MANY)
    rng, n = np.random.default_rng(2), kernel.n
    motion = [drawn["q"], drawn["v"], *(rng.uniform(-1.0, 1.0, (MANY, n)) for _ in TIMED), drawn["a"]]
    pointers = FFI.new("const double *[]", [FFI.cast("const double *", x.ctypes.data) for x in motion])
    setup, out = kernel.parameters.setup, np.zeros((len(TIMED) + 1, n))
    calls = []
    for order, name in enumerate(names):
        function = kernel.raw.functions[name]
        h = FFI.cast("const double *", setup.address(function.library))
        code = FFI.cast("void *", function.address())
        calls.append((code, h, pointers, 3 + order, n, MANY, FFI.cast("double *", out.ctypes.data)))
    best = [float("inf")] * len(calls)
    with one_core():
        for _ in range(rounds):
            for place, call in enumerate(calls):
                begin = time.perf_counter_ns()
                failed = library.in_turn(*call)  # type: ignore[attr-defined]
                best[place] = min(best[place], (time.perf_counter_ns() - begin) / MANY)
                assert not failed
    return best


TEXT = """# Time derivatives along motions

Written by `python -m benchmarks.jets`; do not edit.

`kernel.jet("inverse_dynamics", (q, v, a, jerk, snap), 2)` gives the drives of a motion with their first and second time
derivatives: what a motor behind an elastic gear needs, and whoever optimises a path. A robot's program is propagated
as a truncated Taylor series; pairs of numbers that a joint turns take no series of sine and cosine.
[Derivatives](derivatives.md) says how to call it.

## Operations

Additions, multiplications, divisions, and a sine with its cosine, by those of the value alone; the value and all lower
orders are computed as well. In brackets what is required. Behind them the second order alone by forward
differentiation twice, as automatic differentiation has it.

{counts}

## Time

The C for one state, inverse dynamics, by the time of the value alone; {many} states in turn, the least of {rounds}
rounds.

{times}

- Processor: {processor}
- Compiler: {compiler}

{conclusion}
"""


def main() -> int:
    parser = argparse.ArgumentParser(
        description="Count and time derivatives along motions and write the page of tables."
    )
    parser.add_argument("--repeat", type=int, default=2000, metavar="ROUNDS", help="rounds per row (default 2000)")
    parser.add_argument("--output", type=Path, default=TARGET, metavar="FILE", help="default: docs/jets.md")
    arguments = parser.parse_args()
    if arguments.repeat < 1:
        parser.error(f"--repeat: {arguments.repeat} is not a number of rounds; at least 1")
    keys = []
    for key in ROBOTS:
        try:
            robot_of(key)
        except MissingPeer as missing:
            print(f"{key} is left out: {missing}", file=sys.stderr)
        else:
            keys.append(key)
    counts, bars = counted(tuple(keys))
    times, more = timed(tuple(keys), arguments.repeat)
    text = TEXT.format(
        counts=counts,
        times=times,
        many=MANY,
        rounds=arguments.repeat,
        processor=processor_name(),
        compiler=find_compiler().version.splitlines()[0],
        conclusion=conclusion([*bars, *more], ".2f"),
    )
    arguments.output.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
