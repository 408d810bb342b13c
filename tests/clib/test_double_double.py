"""Programs in double-double arithmetic: errors within bounds at 200 digits, and the bits of Python's arithmetic."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.c.extended import ORDER, Table, rows_of
from eomgen.codegen.program.ir import Program
from tests.codegen.program.test_running_errors import at_high, random_program
from tests.oracles import double_double
from tests.oracles.double_double import run_extended
from tests.support.soak import soaked

from .test_library import LIBRARY, WARNINGS

Array = NDArray[Any]
SINGLE = np.dtype("float32")
HARNESS = """
#include <stdio.h>
#include <stdlib.h>
#include "double_double.h"
%(tables)s
int main(int count, char **words)
{
    EOM_SCALAR q[8];
    EOM_SCALAR dq[8];
    (void)count;
    for (int i = 0; i < 4; ++i) { q[i] = (EOM_SCALAR)strtod(words[1 + i], NULL); }
    for (int i = 0; i < 4; ++i) { dq[i] = (EOM_SCALAR)strtod(words[5 + i], NULL); }
    const EOM_SCALAR *const arrays[3] = { q, q, dq };
    %(calls)s
    return 0;
}
"""


def written(number: int, table: Table) -> tuple[str, str]:
    """Return the C of a table, and a call that prints what it gives."""
    steps = ", ".join("{ " + ", ".join(map(str, row)) + " }" for row in table.steps)
    size = len(table.results)
    text = f"static const unsigned short step{number}[][5] = {{ {steps} }};\n"
    text += f"static const double constant{number}[] = {{ {', '.join((*table.constants, '0.0'))} }};\n"
    text += f"static const unsigned short result{number}[] = {{ {', '.join(map(str, table.results))} }};\n"
    call = (
        f"{{ const eom_extended_program p = {{ {len(table.steps)}, {size}, step{number}, constant{number},"
        f" result{number} }};"
        f" eom_bounded value[{table.places}]; EOM_SCALAR out[{3 * size}]; EOM(run_extended)(&p, arrays, value, out);"
        f' for (int i = 0; i < {3 * size}; ++i) {{ printf("%a ", (double)out[i]); }} printf("\\n"); }}'
    )
    return text, call


def answers(programs: list[Program], q: Array, radii: Array, folder: Path, *flags: str) -> list[Array]:
    """Return what the C gives of each program, (3, results)."""
    reads = ("h", "q", "dq") if radii.any() else ("h", "q")
    parts = [written(i, rows_of(program, reads)) for i, program in enumerate(programs)]
    source, program = folder / "programs.c", folder / "programs"
    tables, calls = ("\n".join(x) for x in zip(*parts, strict=True))
    source.write_text(HARNESS % {"tables": tables, "calls": calls}, encoding="ascii")
    command = ["gcc", *WARNINGS, "-O1", "-fsanitize=undefined", *flags, f"-I{LIBRARY}", str(source), "-lm"]
    subprocess.run([*command, "-o", str(program)], check=True)
    words = [str(program), *map(repr, [*q.tolist(), *radii.tolist()])]
    lines = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    return [np.array([float.fromhex(x) for x in line.split()]).reshape(3, -1) for line in lines]


def exact(program: Program, q: Array) -> list[Any]:
    with mpmath.workdps(200):
        high = at_high(program, {"q": q.tolist()})
        return [high[program.outputs["out", i]] for i in range(len(program.outputs))]


def within(found: Array, right: list[Any]) -> float:
    """Check the bounds of a program's results; return the largest share of a bound that an error takes."""
    largest = 0.0
    with mpmath.workdps(200):
        for high, low, bound, value in zip(*found, right, strict=True):
            if not np.isfinite(bound) or isinstance(value, mpmath.mpc) or not mpmath.isfinite(value):
                continue
            error = abs(mpmath.mpf(high) + mpmath.mpf(low) - value)
            assert error <= bound, (high, low, bound, float(error))
            largest = max(largest, float(error / bound) if bound > 0.0 else 0.0)
    return largest


def draw(seed: int, count: int) -> tuple[list[Program], Array]:
    """Return programs, and numbers that they read, which float32 holds."""
    rng = np.random.default_rng(seed)
    q = rng.choice([0.0, 1.0, -0.5, 3.0, *rng.normal(size=4), 1e-3 * rng.normal()], 4)
    programs = []
    while len(programs) < count:
        program = random_program(rng, 24)
        try:
            exact(program, q.astype(SINGLE).astype(float))
        except (ZeroDivisionError, OverflowError, ValueError):
            continue  # no numbers
        programs.append(program)
    return programs, q.astype(SINGLE).astype(float)


@pytest.mark.parametrize("seed", soaked(range(40), range(1)))
@pytest.mark.parametrize("flags", soaked(["", "-DEOM_SINGLE", "-mfma -ffp-contract=fast"], ["", "-DEOM_SINGLE"]))
def test_random_programs_are_within_bounds(seed: int, flags: str, tmp_path: Path) -> None:
    """With every operation; the C has the bits of Python, where its library's functions have."""
    programs, q = draw(seed, 40)
    dtype = SINGLE if flags == "-DEOM_SINGLE" else np.dtype("float64")
    still = np.zeros(4)
    shares = []
    for program, found in zip(programs, answers(programs, q, still, tmp_path, *flags.split()), strict=True):
        shares.append(within(found, exact(program, q)))
        with np.errstate(all="ignore"):
            expected = run_extended(program, {"q": [np.array([x]) for x in q]}, dtype, {})[:, 0].reshape(3, -1)
        if not {"exp", "log", "atan2"} & {x.op for x in program.instructions}:
            assert np.array_equal(found, expected, equal_nan=True)
    assert max(shares) > 1e-3, "bounds are near errors"


def test_numbers_within_radii(tmp_path: Path) -> None:
    """Bounds hold for all arguments in a box, which are tried beside its corners and inside."""
    programs, q = draw(3, 20)
    rng, radii = np.random.default_rng(0), np.array([1e-3, 1e-2, 0.0, 1e-6])
    found = answers(programs, q, radii, tmp_path)
    for _ in range(6):
        near = q + radii * rng.choice([-0.999, 0.999, 0.3], 4)
        for program, each in zip(programs, found, strict=True):
            try:
                within(each, exact(program, near))
            except (ZeroDivisionError, OverflowError, ValueError):
                continue


OMISSIONS = {  # an error that a rule forgets
    "add": lambda x, y: double_double._sum(x, y)._replace(error=x.error),
    "mul": lambda x, y: double_double._product(x, y)._replace(error=np.abs(x.x.high) * y.error),
    "choose": lambda gate, x, y: double_double._choice(gate._replace(error=np.zeros_like(gate.error)), x, y),
}


def check_many() -> None:
    for seed in range(12):
        programs, q = draw(seed, 12)
        columns = {"q": [np.array([x]) for x in q]}
        for program in programs:
            found = run_extended(program, columns, np.dtype("float64"), {})[:, 0].reshape(3, -1)
            within(found, exact(program, q))


@pytest.mark.parametrize("op", OMISSIONS)
def test_an_omission_is_seen(op: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(double_double, "_OPERATIONS", {**double_double._OPERATIONS, op: OMISSIONS[op]})
    with pytest.raises(AssertionError), np.errstate(all="ignore"):
        check_many()


def test_operations_are_numbered_as_in_c() -> None:
    text = (Path(LIBRARY) / "double_double.h").read_text(encoding="ascii")
    listed = text.split("enum {")[1].split("}")[0]
    assert [name.strip().removeprefix("DD_").lower() for name in listed.split(",")] == list(ORDER)


def test_angles_of_all_sizes() -> None:
    """Sines and cosines, also beside multiples of pi/2, within two units; beyond 2^30 rad there is no bound."""
    rng = np.random.default_rng(5)
    high = np.concatenate([rng.uniform(-4.0, 4.0, 200), 1e8 * rng.normal(size=100), np.arange(-50, 50) * (np.pi / 2)])
    low = high * rng.uniform(-1.0, 1.0, high.size) * 2.0**-54
    x = double_double.Pair(high, low)
    for quarter, function in ((0, mpmath.sin), (1, mpmath.cos)):
        found = double_double.pair_sine(x, quarter)
        with mpmath.workdps(80):
            for a, b, s, t in zip(high, low, *found, strict=True):
                assert abs(mpmath.mpf(s) + mpmath.mpf(t) - function(mpmath.mpf(a) + mpmath.mpf(b))) < 2.0**-103
    assert np.isnan(double_double.pair_sine(double_double.Pair(np.array([2e9]), np.zeros(1)), 0).high).all()
