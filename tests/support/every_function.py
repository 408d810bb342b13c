"""A small program in C that calls all functions of a kernel in states of all sizes and writes what they return.

It reads and writes standard streams; on a bare machine (``BARE``) memory at fixed addresses.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.package.compile import FLAGS
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.value import Robot
from tests.support.c_project import write_source

STATES, TOGETHER = 9, 4  # states, of which the first are a batch
SPECIAL = (2, 3, 4)  # states of denormal numbers, infinities and NaN
GIVEN, SAID, ROOM = 0x60000000, 0x61000000, 1 << 22  # addresses on a bare machine, and bytes of each
MAIN = """
#include <stddef.h>
#include "{name}.h"
#define STATES {states}
#define TOGETHER {together}
{inputs}
static {real} p[{parameters}], h[{hoisted}], out[TOGETHER * {largest}];
#ifdef BARE
static const {real} *given = (const {real} *){given};
static {real} *answer = ({real} *){said};
static int take({real} *x, size_t count) {{ while (count--) *x++ = *given++; return 1; }}
static void put(const {real} *x, size_t count) {{ while (count--) *answer++ = *x++; }}
#else
#include <stdio.h>
static int take({real} *x, size_t count) {{ return fread(x, sizeof *x, count, stdin) == count; }}
static void put(const {real} *x, size_t count) {{ (void)fwrite(x, sizeof *x, count, stdout); }}
#endif
static void tell(long long status, size_t count)
{{
    const {real} said = ({real})status;
    put(&said, 1);
    put(out, count);
    for (size_t i = 0; i < count; ++i) out[i] = 0;
}}
int main(void)
{{
    if (!take(p, {parameters}){takes}) return 1;
    {name}_setup(p, h);
    for (int i = 0; i < STATES; ++i) {{
{single}
    }}
#ifndef BARE
{batch}
#endif
    return 0;
}}
#ifdef BARE
void reset(void);
void reset(void) {{ (void)main(); }}
#endif
"""


@dataclass(frozen=True)
class EveryFunction:
    """The C of a robot's kernels with main.c beside it.

    Attributes:
        code: the robot's C.
        given: what the program reads.
        dtype: of all that it reads and writes.
        calls: function and count of numbers of each of its calls in turn, a status before them; batches come last.
    """

    code: Path
    given: bytes
    dtype: str
    calls: tuple[tuple[str, int], ...]

    @property
    def alone(self) -> int:
        """Count the calls of one state each."""
        return len(self.calls) - len({name for name, _ in self.calls})

    def by_function(self, said: NDArray[np.floating]) -> dict[str, NDArray[np.floating]]:
        """Return what was written, by function: a status before each answer; without batches that are left out.

        Of a batch that is refused only that it is: how far it got, and which state it names, lanes decide.
        """
        parts: dict[str, list[NDArray[np.floating]]] = {}
        at = 0
        for number, (name, count) in enumerate(self.calls):
            answer = said[at : at + 1 + count]
            if number >= self.alone and answer.size and answer[0] != 0:
                answer = np.append(np.ones(1), np.zeros(count)).astype(said.dtype)
            if answer.size:
                parts.setdefault(name, []).append(answer)
            at += 1 + count
        return {name: np.concatenate(arrays) for name, arrays in parts.items()}


def states_of_all_sizes(name: str, size: int, dtype: str) -> NDArray[np.floating]:
    """Return an array (STATES, size): small, denormal and infinite numbers, NaN, and random ones of ordinary size."""
    rng = np.random.default_rng(list(name.encode()))
    states = rng.uniform(0.25, 1.0, (STATES, size)) * rng.choice((-1.0, 1.0), (STATES, size))
    if name == "chart":  # no coordinate follows the others
        return np.zeros((STATES, size), dtype)
    states[1] *= 2.0**-12
    states[SPECIAL[0]] *= 2.0**-1040 if dtype == "float64" else 2.0**-140
    if name != "q":  # whose sines are NaN then
        states[SPECIAL[1]] = np.copysign(np.inf, states[SPECIAL[1]])
    states[SPECIAL[2]] = np.nan
    return states.astype(dtype)


def every_function(robot: Robot, folder: Path, kernels: Sequence[str] = (), dtype: str = "float64") -> EveryFunction:
    """Write the C of a robot's kernels, all by default, and main.c into a folder."""
    source = make_source(robot, Options(tuple(kernels), dtype))
    meta = json.loads(source.meta)
    shapes = {name: int(np.prod(shape)) for name, shape in meta["shapes"].items()}
    functions = {
        name: entry for name, entry in meta["functions"].items() if entry["kind"] not in ("rollout", "adaptive")
    }
    read = sorted({array for entry in functions.values() for array in entry["reads"]})
    given = {name: states_of_all_sizes(name, shapes[name], dtype) for name in read}
    single, batch = [], []
    for name, entry in functions.items():
        size = shapes[entry["writes"]]
        frame = ", 0" if entry["kind"] == "frames" else ""
        one = "".join(f", {array}[i]" for array in entry["reads"])
        many = "".join(f", {array}[0], {shapes[array]}" for array in entry["reads"])
        single.append(f"        tell({robot.name}_{name}(h{one}{frame}, out), {size});")
        batch.append(f"    tell({robot.name}_{name}_batch(TOGETHER, h{many}{frame}, out), TOGETHER * {size});")
    real = "float" if dtype == "float32" else "double"
    values = np.array([*meta["parameters"].values()])
    text = MAIN.format(
        name=robot.name,
        real=real,
        given=hex(GIVEN),
        said=hex(SAID),
        states=STATES,
        together=TOGETHER,
        inputs="\n".join(f"static {real} {name}[STATES][{shapes[name]}];" for name in read),
        parameters=max(1, values.size),
        hoisted=max(1, meta["hoisted"]),
        largest=max(shapes.values()),
        takes="".join(f" || !take({name}[0], STATES * {shapes[name]})" for name in read),
        single="\n".join(single),
        batch="\n".join(batch),
    )
    write_source(source, folder)
    (folder / "main.c").write_text(text, encoding="ascii")
    arrays = [values if values.size else np.zeros(1), *(given[name] for name in read)]
    sizes = [(name, shapes[entry["writes"]]) for name, entry in functions.items()]
    calls = [*sizes * STATES, *((name, TOGETHER * size) for name, size in sizes)]
    data = b"".join(np.ascontiguousarray(array, dtype).tobytes() for array in arrays)
    return EveryFunction(folder / f"{robot.name}.c", data, dtype, tuple(calls))


def compiled(
    program: EveryFunction, compiler: Sequence[str], flags: Sequence[str], libraries: Sequence[str] = ("-lm",)
) -> Path:
    """Compile the program with our flags, and these behind them; return where it is."""
    out = program.code.with_name("program")
    files = [str(path) for path in sorted(out.parent.glob("*.c"))]
    subprocess.run([*compiler, *FLAGS, *flags, *files, "-o", str(out), *libraries], check=True, cwd=out.parent)
    return out


def said(
    program: EveryFunction, compiler: Sequence[str], flags: Sequence[str], machine: Sequence[str]
) -> NDArray[np.floating]:
    """Return numbers that the program writes, compiled and run so."""
    out = compiled(program, compiler, flags)
    found = subprocess.run([*machine, str(out)], input=program.given, capture_output=True, check=False)
    assert found.returncode == 0, (found.returncode, found.stderr[-1000:])
    return np.frombuffer(found.stdout, program.dtype)


def differing(found: NDArray[np.floating], expected: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which numbers differ in a bit or in the sign of a zero; what is no number has no sign."""
    same = (found == expected) & (np.signbit(found) == np.signbit(expected)) | np.isnan(found) & np.isnan(expected)
    return np.asarray(~same)
