"""Nasty changes of what composed kernels do, in a robot's C or in the library's, which a fresh binary's samples see."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cffi
import pytest

import eomgen
from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels import equations as deriving
from eomgen.codegen.package.compile import FLAGS
from eomgen.codegen.samples.answers import samples
from eomgen.codegen.samples.stored import read_samples
from eomgen.pipeline.self_test import first_difference
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Coordinate, Robot
from tests.support.c_project import elastic_tree, write_source
from tests.support.mutant import Mutant
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import random_robot
from tests.support.soak import soaked


def stretched_bars() -> Robot:
    """Give the four-bar linkage with a pivot that shakes: where its angles are small, great forces hold it."""
    robot = eomgen.load_robot("four_bar")
    pivot = replace(robot.joints[2], coordinates={"x": Coordinate(prescribed=True), **robot.joints[2].coordinates})
    return replace(robot, joints=(*robot.joints[:2], pivot))


ROBOTS = {
    "closed": lambda: eomgen.load_robot("four_bar"),
    "driven": lambda: mechanism(7).robot,  # with a prescribed coordinate
    "shaken": lambda: eomgen.load_robot("shaken_arm"),
    "stretched": lambda: stretched_bars(),
    "tree": elastic_tree,
    "rounded": lambda: random_robot(59, joints=(2, 5), tree=True, max_coordinates=4),  # the description's turns are
}
DERIVATIVES, FOLLOWING = "clib/acceleration_derivatives.h", "clib/dependent_coordinates.h"
CODE = "{name}.c"
JACOBIAN = "forward_dynamics_jacobian"

# Robot, kernel, file, what it says, what it says instead.
NASTY = [
    ("tree", JACOBIAN, DERIVATIVES, "M[n * i + j] -= factor", "M[n * i + j] += factor"),
    ("tree", JACOBIAN, DERIVATIVES, "pivot[2 * k]; }", "pivot[2 * k + 1]; }"),
    ("tree", JACOBIAN, DERIVATIVES, "x[columns * i + j] -=", "x[columns * i + j] +="),
    ("tree", JACOBIAN, DERIVATIVES, "x[columns * k + j] -=", "x[columns * k + j] +="),
    ("tree", JACOBIAN, DERIVATIVES, "i < 2 * n * n; ++i", "i < n * n; ++i"),
    ("tree", JACOBIAN, DERIVATIVES, "by_u[(n + 1) * i] = one; }\n    }", "by_u[i] = one; }\n    }"),
    ("tree", JACOBIAN, CODE, "residual_jacobian(h, q, v, a, out)", "residual_jacobian(h, q, v, u, out)"),
    ("tree", "christoffel", CODE, "(i == k) ?", "(i == 0) ?"),
    ("tree", "christoffel", CODE, "? c[i] :", "? -c[i] :"),
    ("rounded", "christoffel", CODE, "1ULL) != 0U", "1ULL) == 0U"),
    ("tree", "christoffel", CODE, "1ULL) != 0U", "1ULL) == 0U"),
    ("shaken", JACOBIAN, DERIVATIVES, "? -by_u[n * i + j]", "? by_u[n * i + j]"),
    ("driven", JACOBIAN, DERIVATIVES, "M[(n + 1) * i] = one;", "M[(n + 1) * i] = zero;"),
    ("driven", JACOBIAN, DERIVATIVES, "(known[i] != 0)) ? WHOLE(C(0.0)) :", "(known[i] < 0)) ? WHOLE(C(0.0)) :"),
    ("closed", JACOBIAN, DERIVATIVES, "-D[at + size + i]", "D[at + size + i]"),
    ("closed", JACOBIAN, DERIVATIVES, "-D[at + 2 * size + i]", "-D[at + size + i]"),
    ("closed", JACOBIAN, DERIVATIVES, "by_q[entry] - D[at + i]", "by_q[entry] + D[at + i]"),
    ("closed", JACOBIAN, DERIVATIVES, "by_q[entry] - D[at + i]", "by_q[entry]"),
    ("closed", JACOBIAN, DERIVATIVES, "right[r] -= rows", "right[r] += rows"),
    ("closed", JACOBIAN, DERIVATIVES, "x[n * j] += Y[n * r + j]", "x[n * j] -= Y[n * r + j]"),
    ("closed", JACOBIAN, DERIVATIVES, "Y[n * r + j] * change[r]", "Y[j] * change[r]"),
    ("closed", JACOBIAN, DERIVATIVES, "rest[r] /= factors", "rest[r] *= factors"),
    ("closed", JACOBIAN, DERIVATIVES, "sum += factors[k * s + r]", "sum -= factors[k * s + r]"),
    ("closed", JACOBIAN, DERIVATIVES, "(matrix < 2) ?", "(matrix < 1) ?"),
    ("closed", JACOBIAN, DERIVATIVES, "pass <= refinements", "pass < 1"),
    ("closed", JACOBIAN, CODE, "found, &found[3], D)", "found, found, D)"),
    ("closed", "following", FOLLOWING, "J[n * r + i] -= factor", "J[n * r + i] += factor"),
    ("closed", "following", FOLLOWING, "] * v[i]", "] * out[i]"),
    ("closed", "following", FOLLOWING, "rate -= J[n * p + i] * v[i]", "rate += J[n * p + i] * v[i]"),
    ("closed", "following", FOLLOWING, "bias[row[s]]", "bias[row[p]]"),
    ("closed", "following", FOLLOWING, "rate -= J[n * p + i] * a[i]", "rate -= J[n * p + i] * v[i]"),
    ("closed", "following", FOLLOWING, "((EOM_SCALAR)0.0 - J[n * r + i])", "J[n * r + i]"),
    ("closed", "following", FOLLOWING, "last[n * (p + 1) + i]", "last[n * p + i]"),
    ("closed", "following", FOLLOWING, "(q[i] - last[i])", "(q[i] + last[i])"),
    ("closed", "following", FOLLOWING, "out[dependent[p]] += last", "out[dependent[p]] -= last"),
    ("closed", "following", FOLLOWING, "->residual(h, out, g);", "->residual(h, solved, g);"),
    ("closed", "forward_dynamics", CODE, "memcpy(out, &found[0]", "memcpy(out, &found[1]"),
    ("closed", "constraint_forces", CODE, "memcpy(out, &found[3]", "memcpy(out, &found[2]"),
    ("closed", "inverse_dynamics", CODE, "memcpy(out, found,", "memcpy(out, &found[1],"),
    ("closed", "inverse_dynamics", CODE, "u[i] = 0.0;", "u[i] = a[i];"),
    ("closed", "inverse_dynamics_under_load", CODE, "a, u, found)", "a, v, found)"),
    ("closed", "reactions", CODE, "out[i] + more[i]", "out[i] - more[i]"),
    ("closed", "reactions", CODE, "out[i] = out[i] + more[i]", "out[i] = out[i]"),
    ("closed", "reactions_under_load", CODE, "out[i] + more[i]", "more[i]"),
    ("closed", "loop_reactions", CODE, "loop_wrenches(h, q, v, &found[3]", "loop_wrenches(h, q, v, found"),
    ("closed", "loop_reactions_under_load", CODE, "&found[3], out)", "&found[2], out)"),
    ("closed", "forward_dynamics", "clib/constraint_checks.h", "return 1 + n + r +", "return n + r +"),
    ("closed", "inverse_dynamics", "clib/constraint_checks.h", "return 1 + n + r +", "return 2 + n + r +"),
]  # fmt: skip


@cache
def known(robot: str, kernel: str, dtype: str = "float64") -> tuple[Source, dict[str, Any]]:
    """The source of a robot's kernel and what it must answer."""
    ways = deriving._candidates

    def candidates(model: Model, name: str, *arguments: Any, **options: Any) -> Any:
        return [] if name == kernel else ways(model, name, *arguments, **options)

    with pytest.MonkeyPatch.context() as patch:  # so that a small robot has loops where others have long programs
        patch.setattr(deriving, "_candidates", candidates)
        patch.setattr(deriving, "STRAIGHT_COLUMNS", 0)
        equations = deriving.derive_equations(build_model(ROBOTS[robot]()), (kernel,), dtype)
    assert kernel in equations.calls, "it is composed"
    return render(equations, dtype, batches=False), dict(read_samples(samples(equations, dtype)))


def found_in(robot: str, kernel: str, folder: Path, change: tuple[str, str, str] | None = None) -> Any:
    """What samples find in a binary of a kernel, one of whose files is changed."""
    source, given = known(robot, kernel)
    write_source(source, folder)
    if change is not None:
        file, old, new = change
        path = folder / file.format(name=source.name)
        text = path.read_text(encoding="ascii")
        begin = text.index(f"int {source.name}_{kernel}(") if file == CODE else 0
        path.write_text(Mutant.replacing(file, text, old, new, begin).applied(text), encoding="ascii")
    ffi = cffi.FFI()
    ffi.cdef(source.cdef)
    library = folder / "changed.so"
    command = ["cc", *FLAGS, "-O0", "-w", "-shared", "-fPIC", str(folder / f"{source.name}.c"), "-o", str(library)]
    subprocess.run([*command, "-lm"], check=True)

    def load() -> Any:
        return SimpleNamespace(ffi=ffi, lib=ffi.dlopen(str(library)))

    return first_difference(load, json.loads(source.meta), given, bits=True, halves=("singles",))


FIRST = {(x[1], x[2]): x for x in reversed(NASTY)}.values()  # one of each kernel and file
STRETCHED = ("stretched", JACOBIAN)


@pytest.mark.parametrize(
    ("robot", "kernel"),
    soaked(
        sorted({STRETCHED, *(change[:2] for change in NASTY)}), {STRETCHED, *(x[:2] for x in FIRST if x[0] == "closed")}
    ),
)
def test_what_is_right_is_let_through(robot: str, kernel: str, tmp_path: Path) -> None:
    assert found_in(robot, kernel, tmp_path) is None


@pytest.mark.parametrize(("robot", "kernel", "file", "old", "new"), soaked(NASTY, FIRST), ids=lambda text: None)
def test_nasty_changes_are_refused(robot: str, kernel: str, file: str, old: str, new: str, tmp_path: Path) -> None:
    difference = found_in(robot, kernel, tmp_path, (file, old, new))
    assert kernel in difference.function
