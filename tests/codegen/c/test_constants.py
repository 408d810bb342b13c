"""Long numbers in NAME.c are constants in front of it, each with the formula by which the description gives it."""

from __future__ import annotations

import math
import re
from itertools import product

import pytest

import eomgen
from eomgen.codegen.c.scalar_types import UNKNOWN
from eomgen.codegen.tree.traced import Traced, origin_of
from eomgen.pipeline.generating import package_options
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.value import Robot
from tests.support.soak import soaked

NUMBER = r"(?<![\w.])\d+\.?\d*(?:e[-+]?\d+)?"
SHORT = ("one_link", "ur5", "worn_arm", "flexible_arm")
DEFINED = re.compile(r"(?:/\* ((?:(?!\*/).)*?) \*/\n)?#define (EOM_C\d+) (\S+)(?: /\* ([^\n]*?) \*/)?\n", re.DOTALL)


def constants(code: str) -> dict[str, tuple[str, str]]:
    """Literals and origins by name."""
    found = DEFINED.findall(code)
    return {name: (literal, (beside or above).replace("\n * ", " ")) for above, name, literal, beside in found}


def digits(literal: str) -> int:
    return len(re.sub(r"e.*|\D", "", literal).strip("0"))


def named_numbers(robot: Robot) -> dict[str, float]:
    """Numbers of the description, integrals of modes and points of curves, as comments call them."""
    values, xyz = dict(robot.numbers()), list(enumerate("xyz"))
    for link in robot.links:
        modes, where = link.modes, f"dm, links.{link.name})"
        for k, (i, x), (j, y) in product(range(modes.count if modes else 0), xyz, xyz):
            values[f"integral({x} phi{k + 1}.{y} {where}"] = modes.H0[k][i][j]
            values[f"integral(phi{k + 1}.{y} {where}"] = modes.H0[k][3][j]
            for m in range(modes.count):
                values[f"integral(phi{k + 1}.{x} phi{m + 1}.{y} {where}"] = modes.P[k][m][i][j]
                values[f"integral({x} psi{k + 1}{m + 1}.{y} {where}"] = modes.Q[k][m][i][j]
                values[f"integral(psi{k + 1}{m + 1}.{y} {where}"] = modes.Q[k][m][3][j]
                values[f"integral(phi{k + 1} . phi{m + 1} {where}"] = modes.masses[k][m]
    for coupling in robot.couplings:
        begin = f"couplings.{coupling.name}, second derivative by"
        values |= {f"{begin} {one} and {other}": bend for one, other, bend in coupling.bends}
    for name, coordinate in robot.coordinates.items():
        values |= {f"joints.{name}.curve.{i}.deviation": x for i, (x, _) in enumerate(coordinate.curve or ())}
    return values


@pytest.mark.parametrize("robot", eomgen.builtin_robots())
@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_no_long_number_stands_in_an_expression(robot: str, dtype: str) -> None:
    source = make_source(robot, package_options(robot, Options(dtype=dtype)))
    for code in source.codes.values():
        known = constants(code)
        plain = re.sub(r"/\*.*?\*/|\"[^\"]*\"", "", DEFINED.sub("", code), flags=re.DOTALL)
        assert [x for x in re.findall(NUMBER, plain) if "." in x and digits(x) > 4] == []
        assert set(re.findall(r"\bEOM_C\d+\b", plain)) == set(known)
        assert all(digits(literal) > 4 and origin not in ("", UNKNOWN) for literal, origin in known.values())
        assert all(len(line) <= 120 for line in code.splitlines() if "EOM_C" in line and "define" in line)


@pytest.mark.parametrize("robot", soaked(("one_link", "ur5", "worn_arm", "flexible_arm", "puma560", "panda"), SHORT))
def test_formulas_give_the_constants(robot: str) -> None:
    """To the bit, from the description's numbers by their keys, and from the integrals of modes."""
    values, tried = named_numbers(eomgen.load_robot(robot)), 0
    named = re.compile("|".join(map(re.escape, sorted(values, key=len, reverse=True))))
    code = make_source(robot, package_options(robot)).code
    for literal, origin in constants(code).values():
        formula = named.sub(lambda match: f"({values[match[0]]!r})", origin)
        if re.search(r"[a-df-z]", formula):
            assert origin.startswith("sums of products") or ", " in formula, origin
            continue
        assert eval(formula, {"__builtins__": {}}) == float(literal), origin
        tried += 1
    assert tried > 0


def test_arithmetic_of_traced_numbers() -> None:
    mass, com = Traced(2.0, "links.a.mass"), Traced(0.1, "links.a.com.x")
    moment = mass * com
    assert (moment, origin_of(moment)) == (0.2, "links.a.mass * links.a.com.x")
    total = 0.5 * (1.0 - moment) + com / (mass * mass)
    assert total == 0.5 * (1.0 - 0.2) + 0.1 / 4.0
    assert origin_of(total) == (
        "0.5 * (1.0 - links.a.mass * links.a.com.x) + links.a.com.x / (links.a.mass * links.a.mass)"
    )
    opposite = -moment
    assert -opposite is moment
    assert (moment + 0.0) is (1.0 * moment) is (moment / 1.0) is moment
    assert origin_of(-1.0 * (mass + com)) == "-(links.a.mass + links.a.com.x)"
    assert (mass - mass) == 0.0
    assert type(mass - mass) is float
    assert math.copysign(1.0, Traced(0.0, "zero") * -1.0) == -1.0
    long = sum((Traced(1.1 + i, f"links.link{i}.mass") for i in range(40)), 0.0)
    assert origin_of(long).endswith("links.link11.mass and 28 more")
