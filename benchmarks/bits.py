"""Write docs/bits.md: which compilers, levels of optimisation and machines give the same bits, function by function.

    python -m benchmarks.bits [--output FILE] [ROBOT | ROBOT:float32 ...]

One small program in C calls every function on the samples that fresh binaries answer, infinities among them; each build
of it is compared with that of the compiler at hand.  What is not here is named on the page.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.codegen.package.compile import find_compiler
from eomgen.codegen.package.levels import level_flags
from eomgen.codegen.simt.sources import render_simt
from eomgen.robot.model import build_model
from eomgen.runtime.levels import BASE, allowed_levels
from tests.support import simt
from tests.support.every_function import GIVEN, ROOM, SAID, EveryFunction, compiled, differing, every_function, said
from tests.support.soak_page import commit

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "examples" / "controller"))

from image import Image  # noqa: E402

TARGET = ROOT / "docs" / "bits.md"
KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "kinematics", "energy", "inverse_dynamics_adjoint")
ON_THREADS = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "frame_poses", "frame_jacobians")
CASES = (
    ("one_link", "float64"),
    ("ur5", "float64"),
    ("ur5", "float32"),
    ("four_bar", "float64"),
    ("worn_arm", "float64"),
)
OPTIMISATION = ("-O0", "-O1", "-O2", "-O3")
ZIG = (sys.executable, "-m", "ziglang", "cc")
FUSED = "-ffp-contract=fast"
NODE = """
import { WASI } from "node:wasi";
import { readFileSync } from "node:fs";
const wasi = new WASI({ version: "preview1", args: [], env: {}, returnOnExit: true });
const module = await WebAssembly.compile(readFileSync(process.argv[2]));
process.exitCode = wasi.start(await WebAssembly.instantiate(module, wasi.getImportObject()));
"""
BARE_LINK = """SECTIONS
{
    .text 0x1000 : { KEEP(*(.text*)) *(.rodata*) }
    /DISCARD/ : { *(.ARM.ex*) }
    .data 0x20000000 : { *(.data*) *(.bss*) *(COMMON) }
}
"""
BACK = 0x200  # where reset returns to
TEXT = """# Matrix of bits

Written by `{command}`; do not edit. A build of a robot's C is compared with that by {reference}:
every function of these kernels ({kernels}),
for one state and for {together} side by side, in ordinary, small, denormal and infinite states,
and in those that are NaN.

A cell says how many functions answer alike, to the bit, with their statuses; then by how much the others differ at
most, by the largest number of the function's answers.

## Functions with equal bits

{table}

{different}

## What to know

- **What differs by design**: exponential functions, logarithms and angles of points are the C library's; products that
  are fused with sums round once. The row "fused" is here to show that the comparison sees what it should see.
- **Threads**: the [text for accelerators](simt.md) without contraction, for {states} random states, beside
  `eomgen.build`; of robots without loops.
- **Batches that are refused** (loops of their states are open) are refused alike; how far they got is not compared.
- **Not here when this was run**: {absent}.
- [x86-64 levels](levels.md) says what makes bits agree, [How far can I trust this](trust.md) what else is tested.

| | |
|---|---|
| commit | {commit} |
| date | {date} |
| processor | {processor} |
| compilers | {compilers} |
"""

Numbers = NDArray[np.floating]


@dataclass(frozen=True)
class Build:
    """A way to compile and to run; ``run`` returns what the program writes."""

    name: str
    run: Callable[[EveryFunction], Numbers]


@dataclass(frozen=True)
class Cell:
    """Of how many functions bits were compared, and the largest difference of those that differ."""

    functions: int
    different: Mapping[str, float]

    def __str__(self) -> str:
        equal = self.functions - len(self.different)
        worst = f", others within {max(self.different.values()):.0e}" if self.different else ""
        return f"{equal} of {self.functions}{worst}"


def hosted(
    compiler: Sequence[str], flags: Sequence[str], machine: Sequence[str] = ()
) -> Callable[[EveryFunction], Numbers]:
    """Return what compiles with these flags behind ours, and runs it on a machine."""
    return lambda program: said(program, compiler, flags, machine)


def in_node(program: EveryFunction) -> Numbers:
    """Compile to WebAssembly and run it by node."""
    from eomgen.export.wasm.compile import VECTORS, wasm_command

    script = program.code.with_name("run.mjs")
    script.write_text(NODE, encoding="ascii")
    return said(program, wasm_command(), VECTORS, ("node", "--no-warnings", str(script)))


def on_cortex_m7(program: EveryFunction) -> Numbers:
    """Compile for a bare Cortex-M7 and run it under unicorn; doubles and libm are zig's software."""
    import unicorn
    from unicorn import arm_const

    spec = importlib.util.find_spec("ziglang")
    assert spec is not None
    headers = Path(str(spec.origin)).parent / "lib" / "libc" / "include"
    program.code.with_name("link.ld").write_text(BARE_LINK, encoding="ascii")
    size = np.dtype(program.dtype).itemsize
    flags = ["-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp", "-ffreestanding", "-fbuiltin"]
    flags += [x for kind in ("arm-linux-musl", "generic-musl") for x in ("-isystem", str(headers / kind))]
    flags += ["-DBARE", f"-DEOM_VECTOR_BYTES={size}", "-Wl,-T,link.ld", "-Wl,-e,reset"]
    image = Image(compiled(program, ZIG, flags, ()))
    machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    machine.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
    for address, room in ((0, ROOM), (0x20000000, ROOM), (GIVEN, ROOM), (SAID, ROOM), (0xE0000000, 1 << 20)):
        machine.mem_map(address, room)
    for address, data in [*image.segments(), (GIVEN, program.given), (0xE000ED88, (0xF << 20).to_bytes(4, "little"))]:
        machine.mem_write(address, data)
    (start,) = (symbol.address for symbol in image.symbols() if symbol.name == "reset")
    machine.reg_write(arm_const.UC_ARM_REG_SP, 0x20000000 + ROOM)
    machine.reg_write(arm_const.UC_ARM_REG_LR, BACK | 1)
    machine.emu_start(start | 1, BACK)
    count = sum(1 + numbers for _, numbers in program.calls[: program.alone])
    return np.frombuffer(bytes(machine.mem_read(SAID, size * count)), program.dtype)


def builds() -> tuple[list[Build], list[str]]:
    """Return builds that can be made and run here, and what cannot."""
    found, absent = [], []
    here = {"gcc": shutil.which("gcc"), "clang": shutil.which("clang"), "zig": importlib.util.find_spec("ziglang")}
    commands = {"gcc": ("gcc",), "clang": ("clang",), "zig": (*ZIG, "-mcpu=baseline")}
    for name, there in here.items():
        if there:
            found += [Build(f"{name} {flag}", hosted(commands[name], (flag,))) for flag in OPTIMISATION]
        else:
            absent.append(name)
    compiler = find_compiler()
    for level in (x for x in allowed_levels() if x != BASE):
        flags = level_flags(level, compiler, fused=False)
        found.append(Build(f"{compiler.command[0]} -O2, {level}", hosted(compiler.command, flags)))
    if "v3" in allowed_levels():
        fused = (*level_flags("v3", compiler, fused=True), FUSED)
        found.append(Build(f"{compiler.command[0]} -O2, v3, fused", hosted(compiler.command, fused)))
    emulator = shutil.which("qemu-aarch64") or shutil.which("qemu-aarch64-static")
    others: dict[str, tuple[Any, Callable[[EveryFunction], Numbers]]] = {
        "64-bit ARM under qemu, zig -O2": (
            emulator and here["zig"],
            hosted((*ZIG, "-target", "aarch64-linux-musl", "-static"), (), (emulator or "",)),
        ),
        "WebAssembly in node, zig -O2": (shutil.which("node") and here["zig"], in_node),
        "Cortex-M7 under unicorn, zig -O2": (here["zig"] and importlib.util.find_spec("unicorn"), on_cortex_m7),
    }
    for name, (there, run) in others.items():
        if there:
            found.append(Build(name, run))
        else:
            absent.append(name)
    return found, absent


def compared(program: EveryFunction, found: Numbers, expected: Numbers) -> Cell:
    """Compare answers function by function; a build without batches has the first ones alone."""
    answers, right = program.by_function(found), program.by_function(expected[: found.size])
    different = {}
    for name, numbers in right.items():
        if differing(answers[name], numbers).any():
            different[name] = largest(answers[name], numbers)
    return Cell(len(right), different)


def largest(found: Numbers, expected: Numbers) -> float:
    """Return the largest difference by the largest finite number that is expected; infinity where one is not finite."""
    finite = np.isfinite(expected)
    if not np.array_equal(finite, np.isfinite(found)):
        return np.inf
    size = np.abs(expected[finite]).max(initial=0.0)
    return float(np.abs(found[finite] - expected[finite]).max(initial=0.0) / (size or 1.0))


def on_threads(name: str, dtype: str, language: str, folder: Path) -> Cell:
    """Compare the text for accelerators, run by the processor, with the kernel's functions."""
    robot = eomgen.load_robot(name)
    names = ON_THREADS
    source = render_simt(build_model(robot), names, dtype)
    made = simt.Compiled(source, folder, language)
    kernel, different = simt.built(robot, names, dtype), {}
    for function in names:
        arrays = simt.states(made.meta, function)
        answer, right = made.run(function, *arrays), simt.expected(kernel, function, arrays)
        if not simt.same_bits(answer, right):
            different[function] = largest(answer, right)
    return Cell(len(names), different)


def rows(
    cases: Sequence[tuple[str, str]], chosen: Sequence[Build], kernels: Sequence[str] = KERNELS
) -> Iterator[tuple[str, str, Cell]]:
    """Yield build, case and what was compared."""
    reference = find_compiler().command
    for name, dtype in cases:
        with tempfile.TemporaryDirectory() as folder:
            program = every_function(eomgen.load_robot(name), Path(folder), kernels, dtype)
            expected = said(program, reference, ("-O2",), ())
            for build in chosen:
                yield build.name, title(name, dtype), compared(program, build.run(program), expected)


def thread_rows(cases: Sequence[tuple[str, str]]) -> Iterator[tuple[str, str, Cell]]:
    """Yield the same of the text for accelerators, in its languages that run here, of robots without loops."""
    languages = {name: name.upper() for name in simt.LANGUAGES}
    if platforms := simt.opencl_platforms():
        languages["opencl"] = f"OpenCL by {platforms[0].name}"
    for language, (name, dtype) in product(languages, cases):
        if not eomgen.load_robot(name).loops:
            with tempfile.TemporaryDirectory() as folder:
                cell = on_threads(name, dtype, language, Path(folder))
                yield f"threads as {languages[language]}", title(name, dtype), cell


def title(name: str, dtype: str) -> str:
    """Return a column's heading."""
    return name if dtype == "float64" else f"{name}, {dtype}"


def table(cells: Mapping[tuple[str, str], Cell]) -> str:
    """Return the table: a row for each build, a column for each robot."""
    heads = list(dict.fromkeys(column for _, column in cells))
    lines = [f"| build | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for name in dict.fromkeys(row for row, _ in cells):
        lines.append(f"| {name} | {' | '.join(str(cells.get((name, head), '')) for head in heads)} |")
    return "\n".join(lines)


def differences(cells: Mapping[tuple[str, str], Cell]) -> str:
    """Name the functions that differ, by build and robot."""
    lines = [
        f"- {build}, {robot}: {', '.join(f'`{name}` {size:.0e}' for name, size in cell.different.items())}"
        for (build, robot), cell in cells.items()
        if cell.different
    ]
    return "\n".join(["Functions that differ:", "", *lines]) if lines else "No function differs."


def versions() -> str:
    """Say which compilers were taken."""
    said_of = [find_compiler().version.splitlines()[0]]
    others = {"clang": shutil.which("clang") and ("clang",), "zig": importlib.util.find_spec("ziglang") and ZIG}
    for name, command in others.items():
        if command:
            done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
            said_of.append(f"{name}: {done.stdout.splitlines()[0].split(' (')[0]}")
    return "; ".join(said_of)


def page(cases: Sequence[tuple[str, str]]) -> str:
    """Compare all builds of these robots in these precisions, and return the page."""
    chosen, absent = builds()
    if not simt.opencl_platforms():
        absent.append("OpenCL (pyopencl and a driver)")
    cells = {}
    for build, column, cell in chain(rows(cases, chosen), thread_rows(cases)):
        print(f"{build}: {column}: {cell}", file=sys.stderr, flush=True)
        cells[build, column] = cell
    reference = find_compiler().version.splitlines()[0]
    named = (
        () if tuple(cases) == CASES else (name if dtype == "float64" else f"{name}:{dtype}" for name, dtype in cases)
    )
    return TEXT.format(
        command=" ".join(("python -m benchmarks.bits", *named)),
        reference=f"`{reference}`, `-O2`",
        kernels=", ".join(f"`{name}`" for name in KERNELS),
        together=4,
        table=table(cells),
        different=differences(cells),
        states=simt.COUNT,
        absent=", ".join(absent) or "nothing",
        commit=commit(ROOT),
        date=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        processor=processor_name(),
        compilers=versions(),
    )


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bits")
    parser.add_argument("--output", type=Path, default=TARGET, metavar="FILE", help="default: docs/bits.md")
    parser.add_argument(
        "robots", nargs="*", metavar="ROBOT", help="built-in ones, in single precision as ROBOT:float32"
    )
    options = parser.parse_args()
    asked = [(name, dtype or "float64") for name, _, dtype in (text.partition(":") for text in options.robots)]
    options.output.write_text(page(tuple(asked) or CASES), encoding="utf-8")


if __name__ == "__main__":
    main()
