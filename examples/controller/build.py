"""Generate, compile and run the controller: python examples/controller/build.py --help says what can be chosen."""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import calls
import numpy as np
import parts
from emulate import TICK, Run, by_qemu, by_unicorn
from image import Image, Sizes
from task import RATE, ROBOT, Task, simulated

import eomgen
from eomgen.pipeline import Options

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "controllers.md"
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
SAID = {"library": "libm's sine", "own": "its own sine"}
# sines of the C library, or of the polynomials in vectors of one float
SINES = {"library": ("-DEOM_LIBM", "-DEOM_VECTOR_BYTES=0"), "own": ("-DEOM_VECTOR_BYTES=4",)}
FLAGS = ("-O2", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-ffreestanding")
GCC = ("arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard", "-fstack-usage")
# zig uses no FPU unless it is named
ZIG_TARGET = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp", "-fstack-size-section")
ZIG = (sys.executable, "-m", "ziglang", "cc", *ZIG_TARGET)
EPS = float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class Built:
    """An executable, the sizes of its parts, and the bytes of stack that the compiler says of its own functions."""

    compiler: str
    version: str
    sine: str
    path: Path
    whole: Sizes
    parts: dict[str, Sizes]
    frames: dict[str, int]


def command(compiler: str) -> list[str]:
    """What compiles for the processor; zig's declarations of C are in its package."""
    if compiler == "gcc":
        return [*GCC, *FLAGS]
    spec = importlib.util.find_spec("ziglang")
    assert spec is not None
    assert spec.origin is not None
    headers = Path(spec.origin).parent / "lib" / "libc" / "include"
    return [
        *ZIG,
        *FLAGS,
        *(x for name in ("arm-linux-musl", "generic-musl") for x in ("-isystem", str(headers / name))),
    ]


def is_here(tool: str) -> bool:
    """Whether a compiler or emulator is there: gcc, zig, qemu, unicorn."""
    if tool in ("zig", "unicorn"):
        return importlib.util.find_spec({"zig": "ziglang"}.get(tool, tool)) is not None
    return shutil.which({"gcc": GCC[0], "qemu": "qemu-system-arm"}[tool]) is not None


def said(words: list[str], folder: Path) -> str:
    """What a command prints; it fails loudly."""
    found = subprocess.run(words, capture_output=True, text=True, check=False, cwd=folder)
    if found.returncode:
        raise SystemExit(f"{' '.join(words)}\n{found.stdout}{found.stderr}")
    return found.stdout


def built(compiler: str, sine: str, task: Task, out: Path) -> Built:
    """The generated kernel, the control law and the board's start, linked with sinf and cosf alone.

    sine: "library" for sinf and cosf; "own" for the generated polynomials, which leave angles beyond 5000 rad to them.
    """
    folder = out / f"{compiler}_{sine}"
    folder.mkdir(parents=True, exist_ok=True)
    package = eomgen.generate(ROBOT, out, Options(("inverse_dynamics",), "float32"))
    (folder / "task.h").write_text(task.header(), encoding="ascii")
    tool = [*command(compiler), f"-I{package.resolve()}", f"-I{folder.resolve()}", f"-I{HERE.resolve()}"]
    sources = [package / f"{ROBOT}.c", *(HERE / f"{name}.c" for name in ("controller", "main", "board"))]
    for source in sources:
        if source.stem in ("controller", ROBOT):  # memcpy of a few bytes is no call
            flags = [*WARNINGS, *SINES[sine], "-fbuiltin"]
        else:
            flags = ["-Wall", "-Wextra", "-Werror"]
        said([*tool, *flags, "-c", str(source.resolve()), "-o", f"{source.stem}.o"], folder)
    libraries = ["-nostdlib", "-lm", "-lgcc"] if compiler == "gcc" else []
    objects = [f"{source.stem}.o" for source in sources]
    said([*tool, f"-Wl,-T,{(HERE / 'board.ld').resolve()}", *objects, *libraries, "-o", "firmware.elf"], folder)
    whole = Image(folder / "firmware.elf").sizes()
    parts = {name: Image(folder / f"{name}.o").sizes() for name in (ROBOT, "controller", "main", "board")}
    version = said([*command(compiler)[: 1 if compiler == "gcc" else 4], "--version"], folder).splitlines()[0]
    sizes = frames(folder) if compiler == "gcc" else Image(folder / "firmware.elf").frames()
    return Built(compiler, version, sine, folder / "firmware.elf", whole, parts, sizes)


def frames(folder: Path) -> dict[str, int]:
    """Bytes of stack of every function compiled here, as gcc's -fstack-usage says them."""
    found = {}
    for path in folder.glob("*.su"):
        for line in path.read_text(encoding="utf-8").splitlines():
            place, size, kind = line.split("\t")
            assert kind == "static", f"{line}: a frame whose size is not known"
            found[place.rpartition(":")[2]] = int(size)
    return found


def chain(sizes: dict[str, int]) -> int:
    """Bytes of the functions that call each other in a step, down to libm's."""
    names = ("reset", "main", "controller_step", f"{ROBOT}_inverse_dynamics", "turn")
    return sum(sizes.get(name, 0) for name in names)  # one that is missing was compiled into its caller


def deviation(run: Run, task: Task) -> float:
    """The greatest difference of a drive from the host's float32 kernel, by the round-off of the greatest drive."""
    return float((np.abs(run.drives - task.u) / (EPS * np.abs(task.exact).max(axis=0))).max())


ROWS = (
    "the robot's C, bytes",
    "control law, bytes",
    "whole image: text / data / bss, bytes",
    "stack: frames of a step, without libm's, bytes",
    "stack: painted, all in all, bytes",
    "instructions of a step: least / mean / most",
    "of these the robot's C / control law / functions called",
    "instructions of a step by the board's clock, mean",
    "greatest difference from the host's float32 kernel, N m",
)


def table(results: list[tuple[Built, list[Run]]], task: Task) -> str:
    """The figures of the page."""
    columns = [cells(made, runs, task) for made, runs in results]
    head = [f"{made.compiler}, {SAID[made.sine]}" for made, _ in results]
    rows = [["", *head], ["---", *["---:" for _ in head]]]
    rows += [[name, *row] for name, row in zip(ROWS, zip(*columns, strict=True), strict=True)]
    versions = dict.fromkeys(f"{made.compiler}: {made.version}" for made, _ in results)
    u, exact = task.u, task.exact
    return "\n".join(
        [f"| {' | '.join(row)} |" for row in rows]
        + ["", f"Compilers: {'; '.join(versions)}.", ""]
        + [f"{len(u)} states of a second's motion under {RATE} steps a second, drives up to {np.abs(u).max():.0f} N m."]
        + [f"On the host, drives in float32 differ by up to {np.abs(u - exact).max():.1e} N m from those in float64."]
        + [f"The arm, {1e3 * task.error[0]:.0f} mrad off at first, ends {1e3 * task.error[-1]:.2f} mrad off."]
    )


def cells(made: Built, runs: list[Run], task: Task) -> list[str]:
    """A column of the table."""
    steps, parts, whole = len(task.q), made.parts, made.whole
    counted = next((run for run in runs if run.instructions), None)
    clocked = next((run for run in runs if run.ticks), None)
    column = [str(parts[ROBOT].text), str(parts["controller"].text), f"{whole.text} / {whole.data} / {whole.bss}"]
    column += [str(chain(made.frames)), " / ".join(sorted({str(run.stack) for run in runs}))]
    if counted is None:
        column += ["-", "-"]
    else:
        mean = sum(counted.instructions) / steps
        column.append(f"{min(counted.instructions)} / {mean:.0f} / {max(counted.instructions)}")
        column.append(" / ".join(f"{n / steps:.0f}" for n in shares(counted)))
    column.append("-" if clocked is None else f"{clocked.ticks * TICK / steps:.0f}")
    column.append(f"{max(np.abs(run.drives - task.u).max() for run in runs):.1e}")
    return column


def shares(run: Run) -> tuple[int, int, int]:
    """Instructions of the robot's C, of the control law, and of what they call: sinf, cosf, memcpy."""
    robot = sum(count for name, count in run.by_function.items() if name == "turn" or name.startswith(ROBOT))
    law = run.by_function["controller_step"]
    return robot, law, sum(run.by_function.values()) - robot - law


def filled(text: str, figures: str) -> str:
    """The page with its figures."""
    parts = re.split(r"(<!-- (?:begin|end) of figures -->)", text)
    assert len(parts) == 5, "the page has one place for figures"
    return "".join([*parts[:2], f"\n{figures}\n", *parts[3:]])


RUNNERS: dict[str, Callable[[Path], Run]] = {"qemu": by_qemu, "unicorn": by_unicorn}


def main() -> int:
    parser = argparse.ArgumentParser(description="A controller for a Cortex-M7: generated, compiled, run, measured.")
    parser.add_argument("--compiler", choices=("gcc", "zig"), action="append", help="what compiles (all that are here)")
    parser.add_argument("--emulator", choices=tuple(RUNNERS), action="append", help="what runs it (all that are here)")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/controller"), help="folder (out/controller)")
    parser.add_argument("--write", action="store_true", help="put the figures into docs/controllers.md")
    options = parser.parse_args()
    missing = [name for name in ("gcc", "zig", *RUNNERS) if not is_here(name)]
    if options.write and missing:
        raise SystemExit(f"not measured: {', '.join(missing)} missing; --write takes all compilers and emulators")
    compilers = options.compiler or [name for name in ("gcc", "zig") if is_here(name)]
    emulators = options.emulator or [name for name in RUNNERS if is_here(name)]
    if not compilers or not emulators:
        raise SystemExit("a compiler (gcc-arm-none-eabi, or ziglang) and an emulator (QEMU, or unicorn) are needed")
    task = simulated()
    results = []
    for compiler, sine in itertools.product(compilers, SINES):
        made = built(compiler, sine, task, options.output)
        runs = [RUNNERS[name](made.path) for name in emulators]
        for name, run in zip(emulators, runs, strict=True):
            print(
                f"{compiler}, {SAID[sine]}, {name}: {deviation(run, task):.1f} units of round-off off the host's drives"
            )
        results.append((made, runs))
    figures = table(results, task)
    print(figures)
    if options.write:
        PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), figures), encoding="utf-8")
        if calls.is_here():
            parts.write()
    return 0


if __name__ == "__main__":
    sys.exit(main())
