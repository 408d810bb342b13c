"""Write the figures of docs/kalman_filters.md: times of filters here, instructions on an emulated Cortex-M7.

    python -m benchmarks.observers [--rounds ROUNDS] [--print]

Times are the least of many calls, of one core.  Instructions are counted by unicorn, of code that zig compiles; without
these packages their table is left out.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from eomgen.bench.beside import processor_name
from eomgen.codegen.package.compile import find_compiler
from eomgen.control import observer
from eomgen.control.kalman_filter import FORMS
from eomgen.control.observer_source import observer_files

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "examples" / "controller"))

from calls import instructions, is_here, linked  # noqa: E402

PAGE = ROOT / "docs" / "kalman_filters.md"
BEGIN, END = "<!-- begin of figures -->\n", "<!-- end of figures -->"
JOINTS = [f"joint{i}.gamma" for i in range(1, 7)]
ENCODERS = [f"encoder:{joint}" for joint in JOINTS]
BOTH = [*ENCODERS, *(f"tachometer:{joint}" for joint in JOINTS)]
ELASTIC, RIGID = "puma560_elastic", "puma560"
FLAGS = {"-O3": ("-O3",), "-O3 -march=native": ("-O3", "-march=native")}
CALLS = 20  # after each beginning
MAIN = """#include <stdio.h>
#include <time.h>
#include "{name}_observer.h"
static {name}_observer filter;
static double now(void)
{{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}}
int main(void)
{{
    const {real} q[{n}] = {{ 0 }}, v[{n}] = {{ 0 }}, u[{n}] = {{ 0 }}, y[{m}] = {{ 0 }};
    double least[3] = {{ 1e9, 1e9, 1e9 }};
    for (int round = 0; round < {rounds}; ++round) {{
        {name}_observer_setup(&filter, q, v);
        for (int k = 0; k < {calls}; ++k) {{
            const double begin = now();
            if ({name}_observer_predict(&filter, u) != 0) {{ return 1; }}
            const double half = now();
            (void){name}_observer_update(&filter, y);
            const double end = now();
            const double took[3] = {{ half - begin, end - half, end - begin }};
            for (int i = 0; i < 3; ++i) {{ least[i] = (took[i] < least[i]) ? took[i] : least[i]; }}
        }}
    }}
    printf("%g %g %g\\n", least[0], least[1], least[2]);
    return 0;
}}
"""
ENTRY = """#include "{name}_observer.h"
static {name}_observer filter;
static float q[{n}], v[{n}], u[{n}], y[{m}];
void setup(void) {{ {name}_observer_setup(&filter, q, v); }}
void predict(void) {{ (void){name}_observer_predict(&filter, u); }}
void update(void) {{ (void){name}_observer_update(&filter, y); }}
void reset(void) {{ setup(); predict(); update(); }}
"""


def write(files: dict[str, str], folder: Path) -> None:
    """Write texts by their places in a folder."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="ascii")


def run(words: Sequence[str], folder: Path) -> str:
    """Return what a command prints; its failure ends all."""
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
    return done.stdout


def timed(dtype: str, rounds: int) -> dict[str, list[str]]:
    """Return rows of the table of times by forms: in one precision, for each choice of flags."""
    real, rows = "float" if dtype == "float32" else "double", dict[str, list[str]]()
    with TemporaryDirectory() as name:
        folder = Path(name)
        compiler = [*find_compiler().command]
        for form in FORMS:
            made = observer(ELASTIC, BOTH, dt=1e-3, form=form, dtype=dtype)  # type: ignore[arg-type]
            about = {"name": ELASTIC, "real": real, "n": made.kernel.n, "m": len(BOTH), "rounds": rounds}
            write({**observer_files(made), "main.c": MAIN.format(**about, calls=CALLS)}, folder)
            for number, (said, flags) in enumerate(FLAGS.items()):
                robot = f"robot{number}.o"
                if not (folder / robot).exists():  # which is the same for all forms
                    run([*compiler, *flags, "-c", f"{ELASTIC}.c", "-o", robot], folder)
                run([*compiler, *flags, "main.c", f"{ELASTIC}_observer.c", robot, "-o", "main", "-lm"], folder)
                predict, update, both = (float(x) for x in run([str(folder / "main")], folder).split())
                row = f"| {form.replace('_', ' ')} | {real} | `{said}` | {predict:.1f} | {update:.1f} | {both:.1f} |"
                rows.setdefault(form, []).append(row)
    return rows


def counted(form: str) -> str:
    """Return the row of instructions of the rigid arm's filter in single precision on a Cortex-M7."""
    made = observer(RIGID, ENCODERS, dt=1e-3, form=form, dtype="float32")  # type: ignore[arg-type]
    with TemporaryDirectory() as name:
        entry = ENTRY.format(name=RIGID, n=made.kernel.n, m=len(ENCODERS))
        path = linked(observer_files(made), entry, Path(name))
        counts = instructions(path, ("setup", *("predict", "update") * 2))
    return (
        f"| {form.replace('_', ' ')} | {len(made.states)} | {counts[-2]} | {counts[-1]} | {counts[-2] + counts[-1]} |"
    )


def figures(rounds: int) -> str:
    """Return the tables."""
    compiler = run([*find_compiler().command, "--version"], ROOT).splitlines()[0]
    times = [timed(dtype, rounds) for dtype in ("float64", "float32")]
    lines = [
        f"`{ELASTIC}`, 72 states, {len(BOTH)} measurements: times in us, the least of {CALLS * rounds} calls.",
        "",
        "| form | numbers | flags | prediction | update | both |",
        "|---|---|---|---:|---:|---:|",
        *(row for form in FORMS for of_type in times for row in of_type[form]),
        "",
        f"Processor: {processor_name()}. Compiler: {compiler}.",
    ]
    if is_here():
        lines += [
            "",
            f"`{RIGID}` in `float`, {len(ENCODERS)} encoders: instructions on an emulated Cortex-M7, zig `-O2`.",
            "",
            "| form | states | prediction | update | both |",
            "|---|---:|---:|---:|---:|",
            *map(counted, FORMS),
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and write, or print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200, help="beginnings of each filter (200)")
    parser.add_argument("--print", action="store_true", help="print the tables alone")
    options = parser.parse_args()
    text = figures(options.rounds)
    if options.print:
        print(text)
        return
    page = PAGE.read_text(encoding="utf-8")
    begin, end = page.index(BEGIN) + len(BEGIN), page.index(END)
    PAGE.write_text(page[:begin] + text + page[end:], encoding="utf-8")


if __name__ == "__main__":
    main()
