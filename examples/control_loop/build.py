"""Generate, build and run the control loop: python examples/control_loop/build.py --help says what can be chosen."""

from __future__ import annotations

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import task

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.control import write_feedforward, write_observer
from eomgen.pipeline import Options

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "realtime.md"
SANITIZERS = "address,undefined"
SECONDS = 20  # of each run that is measured
BUSY = "while True: pass"
PERCENTILES = "median / 99 % / 99.9 % / most"
BEGIN, END = "<!-- begin of jitter -->\n", "<!-- end of jitter -->"


def generated(folder: Path) -> Path:
    """Write all C that eomgen makes for the loop, and its task; return the folder."""
    model, plant = task.model(), task.plant()
    eomgen.generate(plant, folder, Options(("rollout",), levels=("v1",)), cmake=True)
    eomgen.generate(model.rigid(), folder, Options(("mass_matrix",), levels=("v1",)), cmake=True)
    write_feedforward(model, folder / "controller", dt=task.DT)
    write_observer(task.kalman_filter(), folder / "controller")
    (folder / "task.h").write_text(task.header(), encoding="ascii")
    return folder


def cmake() -> str:
    """Return the path of CMake, that of pip beside this Python first; SystemExit without one."""
    found = shutil.which("cmake", path=os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"])))
    if found is None:
        raise SystemExit("there is no cmake: pip install cmake ninja")
    return found


def built(out: Path, *, sanitizers: str = "", source: Path = HERE) -> Path:
    """Configure and compile; return the program.

    out: folder for what is made.  sanitizers: of the compiler, SANITIZERS.  source: of CMakeLists.txt.
    """
    folder = out / ("sanitized" if sanitizers else "build")
    given = (f"-DGENERATED={(out / 'generated').resolve()}", f"-DSANITIZERS={sanitizers}")
    for words in (
        ("-S", str(source), "-B", str(folder), *given),
        ("--build", str(folder), f"--parallel={os.cpu_count()}"),
    ):
        done = subprocess.run([cmake(), *words], capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.stdout + done.stderr)
    return folder / "control_loop"


def measured(program: Path, priority: int) -> list[str]:
    """Return the cells of a run's row, while as many other processes as processors compute."""
    words = [str(program), "--realtime", "--seconds", str(SECONDS), "--priority", str(priority)]
    with ExitStack() as stack:
        for _ in range(os.cpu_count() or 1):
            stack.callback(stack.enter_context(subprocess.Popen([sys.executable, "-c", BUSY])).kill)
        text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    if "memory: locked" not in text or (priority and "scheduler: SCHED_FIFO" not in text):
        raise SystemExit(f"not measured: memory and priorities are for root alone\n{text}")
    times = re.findall(r"^(?:wake-up late by|controller) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+)$", text, re.MULTILINE)
    counts = re.findall(r"missed deadlines: (\d+); page faults: (\d+)", text)[0]
    scheduler = f"`SCHED_FIFO`, {priority}" if priority else "normal"
    return [scheduler, *(" / ".join(row) for row in times), *counts]


def figures(program: Path) -> str:
    """Return the figures of the page."""
    head = ["scheduler", f"wake-up late by, us: {PERCENTILES}", f"controller, us: {PERCENTILES}"]
    head += ["missed deadlines", "page faults"]
    rows = [measured(program, priority) for priority in (80, 0)]
    table = [f"| {' | '.join(row)} |" for row in (head, ["---", *["---:"] * 4], *rows)]
    preemption = " ".join(re.findall(r"PREEMPT\w*", platform.version()))
    kernel = f"Linux {platform.release().partition('-')[0]} {preemption}"
    return "\n".join([*table, "", f"{SECONDS} s each; {processor_name()}, {os.cpu_count()} processors; {kernel}.", ""])


def main() -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description="A control loop of an elastic UR5 in C: generate, build, run.")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/control_loop"), help="folder (out/control_loop)")
    parser.add_argument("--sanitize", action="store_true", help="build with the sanitizers address and undefined")
    parser.add_argument("--write", action="store_true", help="measure jitter, and put it into docs/realtime.md")
    parser.add_argument("arguments", nargs="*", help="of the program, behind --")
    options = parser.parse_args()
    generated(options.output / "generated")
    program = built(options.output, sanitizers=SANITIZERS if options.sanitize else "")
    if not options.write:
        return subprocess.run([str(program), *options.arguments], check=False).returncode
    text = PAGE.read_text(encoding="utf-8")
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    PAGE.write_text(text[:begin] + figures(program) + text[end:], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
