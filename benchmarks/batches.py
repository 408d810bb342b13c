"""Write docs/batches.md: many states in one call beside as many calls, for vectors of every width.

    python -m benchmarks.batches [--repeat ROUNDS] [--output FILE]

A ratio is the time of calls one by one, each result in its place, by that of one call.  Both take turns in one process
on one core, and agree before they are timed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.bench.clock import Stopwatch, Timed
from eomgen.bench.textbook import compile_yardstick
from eomgen.codegen.c.statements import trig_values
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.package.compile import find_compiler, processor
from eomgen.codegen.program.ir import Program
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot

from .peers.cases import CHAIN, TITLES, case
from .peers.contender import FFI, Contender, address, build_library
from .peers.measure import READS, compare, states
from .peers.run import one_core

TARGET = Path(__file__).parents[1] / "docs" / "batches.md"
CODE = Path(__file__).with_name("one_by_one.c")
ROBOTS = ("UR5", "Talos", CHAIN)
KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
FUSED = "-ffp-contract=fast"
LEVELS: Mapping[str, tuple[str, tuple[str, ...]]] = {  # name -> what the processor must have, flags
    "SSE2": ("", ()),
    "AVX2": ("avx2", ("-march=x86-64-v3", FUSED)),
    "AVX-512": ("avx512vl", ("-march=x86-64-v4", FUSED)),
}
MANY, FEW, COLD = 4096, 64, 8192  # states; the last ones take so long that one call is a sample
COPIES = 3  # of the code: where its pages happen to lie in memory may double the time of what is long
TOLERANCE = 1e-6  # of the comparison: sums of vectors may be fused where those of numbers are not
WITHOUT: Mapping[str, tuple[str, ...]] = {  # flags that take something away from the code
    "as it is": (),
    "memory is not asked ahead": ("-D__builtin_prefetch(x, write, level)=((void)0)",),
    "numbers change places one by one": ("-D__has_builtin(x)=0",),
}
FFI.cdef(
    "typedef struct { void *code; const double *h; size_t size; } Single;"
    "void one_by_one_1(void); void one_by_one_3(void); void forget(void);"
)


@dataclass(frozen=True)
class Rows:
    """Rows of a table: robot, kernel, and a number per column; None where it was not measured."""

    head: tuple[str, ...]
    cells: tuple[tuple[str, str, tuple[float | None, ...]], ...]
    digits: int = 2

    def lines(self) -> list[str]:
        """Return the rows as a table of Markdown."""
        lines = ["| robot | kernel | " + " | ".join(self.head) + " |", "|---|---|" + "---:|" * len(self.head)]
        for robot, kernel, ratios in self.cells:
            numbers = ["" if ratio is None else f"{ratio:.{self.digits}f}" for ratio in ratios]
            lines.append("| " + " | ".join((robot, kernel.replace("_", " "), *numbers)) + " |")
        return lines


class Measurement:
    """Ratios of robots' kernels, and what they need: a stopwatch, C that calls kernels one by one."""

    def __init__(self, rounds: int) -> None:
        self.rounds = rounds
        text = CODE.read_text(encoding="ascii")
        path = build_library("one_by_one", "cc", [("-std=c99", "-O2", CODE.name)], (), {CODE.name: text})
        self.library = FFI.dlopen(str(path))
        self.stopwatch: Stopwatch = compile_yardstick(build_model(eomgen.load_robot("one_link")), ()).stopwatch

    def ratio(self, robot: Robot, kernel: str, flags: Sequence[str], count: int, *, cold: bool = False) -> float:
        """Return the time of calls one by one, by that of one call.

        Args:
            flags: of the compiler.
            count: states.
            cold: whether arguments and results come from memory, because all caches are filled with something else.
        """
        inputs = states(robot, count)
        arrays = [inputs[name] for name in READS[kernel]]
        n = arrays[0].shape[1]
        size = n * n if kernel == "mass_matrix" else n
        pairs = [self._pair(robot, kernel, (*flags, f"-DCOPY={copy}"), len(arrays), size) for copy in range(COPIES)]
        compare([x for pair in pairs for x in pair], arrays, size, TOLERANCE, f"{robot.name}: {kernel}")
        out = np.zeros((count, size))
        empty = [Timed(address(FFI, FFI.cast("void *", self.library.forget)), 0, out.ctypes.data, True)] * cold
        timed = [y for pair in pairs for x in pair for y in (*empty, Timed(x.code, x.h, out.ctypes.data, True))]
        with one_core():
            ns = self.stopwatch.time(timed, len(arrays), arrays, self.rounds)[:, cold :: 1 + cold]
        batch, alone = ns.min(axis=0).reshape(COPIES, 2).min(axis=0)
        return float(alone / batch)

    def _pair(
        self, robot: Robot, kernel: str, flags: Sequence[str], reads: int, size: int
    ) -> tuple[Contender, Contender]:
        """Return one call for all states, and a call for each of them."""
        built = eomgen.build(robot, kernels=KERNELS, flags=flags)
        setup = built.parameters.setup
        h = setup.address(built.raw.function(kernel).library)
        code = FFI.cast("void *", built.raw.address(kernel))
        single = FFI.new("Single *", (code, FFI.cast("double *", h), size))
        called = FFI.cast("void *", getattr(self.library, f"one_by_one_{reads}"))
        return (
            Contender("batch", built.raw.address(kernel, batch=True), h, batch=True, kept=(built, setup)),
            Contender(
                "one by one", address(FFI, called), address(FFI, single), batch=True, kept=(built, setup, single)
            ),
        )

    def widths(self) -> Rows:
        """Return every kernel of every robot, for vectors of every width."""
        had = {name: flags for name, (feature, flags) in LEVELS.items() if feature in processor()}
        cells = []
        for key in ROBOTS:
            for kernel in KERNELS:
                ratios = {name: self.ratio(case(key).robot, kernel, flags, MANY) for name, flags in had.items()}
                cells.append((TITLES[key], kernel, tuple(ratios.get(name) for name in LEVELS)))
        return Rows(tuple(LEVELS), tuple(cells))

    def places(self) -> Rows:
        """Return where arguments and results lie: in the nearest caches, in the last one, in memory."""
        flags = self._widest()
        cells = []
        for key in ROBOTS[1:]:
            robot = case(key).robot
            for kernel in KERNELS:
                warm = [self.ratio(robot, kernel, flags, count) for count in (FEW, MANY)]
                cells.append((TITLES[key], kernel, (*warm, self.ratio(robot, kernel, flags, COLD, cold=True))))
        return Rows((f"{FEW} states", f"{MANY} states", f"{COLD} states, from memory"), tuple(cells))

    def parts(self) -> Rows:
        """Return what is lost without an optimization of the code, from memory."""
        flags = self._widest()
        cells = []
        for key in ROBOTS[1:]:
            robot = case(key).robot
            for kernel in KERNELS:
                ratios = [self.ratio(robot, kernel, (*flags, *more), COLD, cold=True) for more in WITHOUT.values()]
                cells.append((TITLES[key], kernel, tuple(ratios)))
        return Rows(tuple(WITHOUT), tuple(cells))

    def alive(self) -> Rows:
        """Return values that are kept for later statements, on the average and at most."""
        cells = []
        for key in ROBOTS[1:]:
            for kernel in KERNELS:
                equations = derive_equations(build_model(case(key).robot), (kernel,))
                cells.append((TITLES[key], kernel, alive(equations.programs[kernel])))
        return Rows(("on the average", "at most"), tuple(cells), digits=0)

    def _widest(self) -> tuple[str, ...]:
        """Return flags of the widest vectors that the processor has."""
        return [flags for feature, flags in LEVELS.values() if feature in processor()][-1]


def alive(program: Program) -> tuple[float, float]:
    """Return values between the statements of a program that later ones need: on the average, at most."""
    apart = trig_values(program)
    order = [i for i, x in enumerate(program.instructions) if x.args and i not in apart]
    place = {index: position for position, index in enumerate(order)}
    last = {arg: place[index] for index in order for arg in program.instructions[index].args if arg in place}
    change = np.zeros(len(order) + 1)
    for index, end in last.items():
        change[place[index] + 1] += 1
        change[end + 1] -= 1
    kept = np.cumsum(change)
    return float(kept.mean()), float(kept.max())


TEXT = """# Batches

Written by `python -m benchmarks.batches`; do not edit.

A kernel that gets several states at once computes them side by side, one in every lane of a vector: the same statements
as for one state, on vectors of 2, 4 or 8 numbers. A table's number is the time of calls one by one in C, each result in
its place, by that of one call; above 1 the batch is faster. Times are the least of {rounds} rounds in which {copies}
copies of both took turns on one core, after their results had been compared.

- Processor: {processor}
- Compiler: {compiler}

## Vectors of every width

{many} states, arguments and results in the last cache, as far as they fit: a mass matrix of 32 coordinates has 8 KB,
so {many} of them are 34 MB.

{widths}

## Where arguments and results lie

With the widest vectors of this processor.

{places}

## What matters

Parts of the code taken away, arguments and results in memory ({cold} states):

{parts}

- Memory. A state of 36 coordinates brings 864 bytes of arguments, and a processor that waits for them loses what its
  vectors gain. So every batch asks for the arguments of states further on, and for the places of their results, while
  it computes.
- Squares. Numbers of a state stand side by side in memory, but in a vector those of several states do. Squares of
  numbers are turned over in registers, and leave as whole vectors; for a mass matrix that is more than half of all
  instructions.
- Different results alone. A matrix that is symmetric or has zeros is held as its different numbers while it is
  computed, and a table says which stands where: all of a matrix of 36 coordinates, in eight lanes, would be {lanes} KB,
  more than the first cache.
- Pivots are compared with their scales lane by lane. Which coordinate has failed is looked for only if one has.
- The rest is sines and cosines, about a quarter of the time of inverse dynamics, and arithmetic. Both run near to what
  the multipliers of this processor can do.

A mass matrix is in the end as fast as memory takes it, one by one or in a batch: results of more than {memory} MB do
not stay in a cache, and that is the limit of its ratio, not the arithmetic. Stores that go past the caches win little
then, and take twice as long where results would have stayed.

What does not matter, as it turned out, is the order of statements. So many values are alive between two of them:

{alive}

A recursion along branches is a good order by itself: depth first from the outputs, or those statements first that end
most values, keep as many alive or more. The exception is forward dynamics of 6-DOF joints, where depth first is worth a
few percent. Longer or shorter functions (300 or 1500 values instead of 900), the compiler's scheduling, and squares
of zeros left out change times as little, in either direction.

No bit differs from what batches gave before any of this: it is a matter of where numbers lie, not of how they are
computed ([Theory](theory.md) says when a state has the same bits alone and in a batch).
"""


def main() -> int:
    parser = argparse.ArgumentParser(description="Time batches beside single states and write the page of tables.")
    parser.add_argument("--repeat", type=int, default=100, metavar="ROUNDS", help="rounds per row (default 100)")
    parser.add_argument("--output", type=Path, default=TARGET, metavar="FILE", help="default: docs/batches.md")
    arguments = parser.parse_args()
    if arguments.repeat < 1:
        parser.error(f"--repeat: {arguments.repeat} is not a number of rounds; at least 1")
    measurement = Measurement(arguments.repeat)
    tables = {name: "\n".join(getattr(measurement, name)().lines()) for name in ("widths", "places", "parts", "alive")}
    text = TEXT.format(
        rounds=arguments.repeat,
        copies=COPIES,
        processor=processor_name(),
        compiler=find_compiler().version.splitlines()[0],
        many=MANY,
        cold=COLD,
        memory=16,
        lanes=36 * 36 * 64 // 1000,
        **tables,
    )
    arguments.output.write_text(text, encoding="ascii")
    print("\n\n".join(tables.values()))
    print(f"wrote {arguments.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
