"""Long numbers in NAME.c are constants in front of it, each with the formula by which the description gives it."""

from __future__ import annotations

import math
import re

import pytest

import eomgen
from eomgen.codegen.c.scalar_types import UNKNOWN
from eomgen.codegen.tree.traced import Traced, origin_of
from eomgen.pipeline.generating import package_options
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from tests.support.soak import soaked

NUMBER = r"(?<![\w.])\d+\.?\d*(?:e[-+]?\d+)?"
DEFINED = re.compile(r"(?:/\* ((?:(?!\*/).)*?) \*/\n)?#define (EOM_C\d+) (\S+)(?: /\* ([^\n]*?) \*/)?\n", re.DOTALL)
ROBOTS = ("one_link", "ur5", "four_bar", "puma560_elastic", "panda", "delta", "gantry")


def constants(code: str) -> dict[str, tuple[str, str]]:
    """Literals and origins by name."""
    found = DEFINED.findall(code)
    return {name: (literal, (above or beside).replace("\n * ", " ")) for above, name, literal, beside in found}


def digits(literal: str) -> int:
    return len(re.sub(r"e.*|\D", "", literal).strip("0"))


@pytest.mark.parametrize("robot", soaked(ROBOTS, ROBOTS[:3]))
@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_no_long_number_stands_in_an_expression(robot: str, dtype: str) -> None:
    source = make_source(robot, package_options(robot, Options(dtype=dtype)))
    for code in source.codes.values():
        known = constants(code)
        plain = re.sub(r"/\*.*?\*/|\"[^\"]*\"", "", DEFINED.sub("", code), flags=re.DOTALL)
        assert [x for x in re.findall(NUMBER, plain) if "." in x and digits(x) > 4] == []
        assert set(re.findall(r"\bEOM_C\d+\b", plain)) == set(known)
        assert all(digits(literal) > 4 and origin for literal, origin in known.values())
        assert all(len(line) <= 120 for line in code.splitlines() if "EOM_C" in line and "define" in line)


@pytest.mark.parametrize("robot", soaked(("one_link", "ur5", "puma560", "panda"), ("one_link", "ur5")))
def test_formulas_give_the_constants(robot: str) -> None:
    """To the bit, from the description's numbers by their keys."""
    loaded = eomgen.load_robot(robot)
    values, tried = dict(loaded.numbers()), 0
    code = make_source(robot, package_options(robot)).code
    for literal, origin in constants(code).values():
        if origin.startswith("sums of products") or "," in origin:
            assert all(key in values or ", " in key for key in re.findall(r"[a-z]+\.[\w.]+\w", origin))
            continue
        assert origin != UNKNOWN
        keys = re.sub(r"[A-Za-z_]\w*(?:\.\w+)+", lambda match: repr(values[match[0]]), origin)
        assert eval(keys, {"__builtins__": {}}) == float(literal), origin
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
