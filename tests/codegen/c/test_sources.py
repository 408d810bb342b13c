"""The generated text: warnings, C++, determinism, literals, hostile names, and the committed sample."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2.meta import find_undeclared_variables

import eomgen
from eomgen.codegen.c.contexts import header_context, lane_context, number_context
from eomgen.codegen.c.metadata import kernel_metadata
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.c.source import Source, environment
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.description.load import robot_from_urdf
from eomgen.errors import DescriptionError, InputError
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Robot
from tests.oracles.force_laws import with_laws
from tests.support.builds import Build
from tests.support.c_project import WARNINGS
from tests.support.c_sources import check_symbols, elastic_tree, source_of, write_source
from tests.support.random_robots import random_robot
from tests.support.small_robots import free_body
from tests.support.soak import soaked

ROOT = Path(__file__).parents[3]


def elastic_chain() -> Robot:
    """Large enough to be split into several functions."""
    robot = random_robot(6, joints=(3, 3), types=("revolute",), max_coordinates=1)
    extra = {
        joint.name: dict.fromkeys(COORDINATES, Coordinate(100.0, 1.0)) for joint in robot.joints if joint.coordinates
    }
    return replace(robot.with_coordinates(extra), name="elastic_chain")


def worn_tree() -> Robot:
    """Forces of every kind."""
    robot = random_robot(7, joints=(3, 3), tree=True, types=("revolute", "prismatic", "free"))
    return replace(with_laws(robot, 7), name="worn_tree")


def worn_joint() -> Robot:
    """One joint with forces of every kind, for compilers that optimise."""
    return replace(with_laws(random_robot(7, joints=(1, 1), types=("free",)), 7), name="worn_joint")


ROBOTS = {
    "worn_joint": worn_joint,
    "worn_tree": worn_tree,
    "one_link": lambda: eomgen.load_robot("one_link"),
    "ur5": lambda: eomgen.load_robot("ur5"),
    "elastic_tree": elastic_tree,
    "elastic_chain": elastic_chain,
    "free_body": free_body,
}
QUICK = ("worn_joint", "one_link", "elastic_tree")


@cache
def equations_of(name: str) -> Equations:
    return derive_equations(build_model(ROBOTS[name]()))


def test_templates_ask_for_no_name_that_they_are_not_given() -> None:
    """Not even where a branch of theirs is not taken."""
    equations = equations_of("one_link")
    meta = kernel_metadata(equations, "float64")
    header = header_context(equations, "float64", meta, True)
    alone = {**header, **number_context(equations, "float64", meta)}
    given = {"kernel.h": header, "kernel.c": alone, "batches.c": {**alone, **lane_context(equations, "float64")}}
    for name, context in given.items():
        loader = environment().loader
        assert loader is not None
        text = loader.get_source(environment(), f"kernel/{name}.jinja")[0]
        wanted = find_undeclared_variables(environment().parse(text))
        assert len(wanted) > 5
        assert wanted <= context.keys(), name


@cache
def source_of_robot(name: str, dtype: str = "float64") -> Source:
    return render(equations_of(name), dtype)


def compiled(compiler: str, *arguments: str | Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    result = subprocess.run([compiler, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[:4000]
    assert result.stderr == ""


@pytest.mark.parametrize(
    ("name", "dtype"),
    soaked(product(ROBOTS, ["float64", "float32"]), {("worn_joint", "float64"), ("one_link", "float32")}),
)
def test_no_compiler_warns(name: str, dtype: str, tmp_path: Path) -> None:
    source = source_of_robot(name, dtype)
    write_source(source, tmp_path)
    small = name in ("one_link", "worn_joint", "free_body")
    assert name == "worn_joint" or ("_part1(" in source.code) != small
    ways = [("gcc", ["-O1"]), ("clang", ["-O0"]), ("gcc", ["-O0", "-DEOMGEN_VECTOR=0"])]
    for compiler, flags in ways if small and dtype == "float64" else ways[1:2]:
        if shutil.which(compiler):
            out = tmp_path / f"{compiler}.o"
            compiled(compiler, "-std=c99", *WARNINGS, *flags, "-c", tmp_path / f"{name}.c", "-o", out)
            check_symbols(out, source)


@pytest.mark.soak
@pytest.mark.parametrize(
    "flags",
    [("-march=native",), *(pytest.param((flag,), marks=pytest.mark.soak) for flag in ("-mavx2", "-mavx"))],
    ids=str,
)
@pytest.mark.parametrize("name", ["one_link", pytest.param("worn_tree", marks=pytest.mark.soak)])
def test_no_compiler_warns_of_vectors(name: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    source = source_of_robot(name)
    write_source(source, tmp_path)
    if "x86" not in platform.machine():
        flags = flags[-1:] if flags[0].startswith("-D") else ()
    for compiler in ("gcc", "clang"):
        if shutil.which(compiler):
            out = tmp_path / f"{compiler}.o"
            compiled(compiler, "-std=c99", *WARNINGS, "-O1", *flags, "-c", tmp_path / f"{name}.c", "-o", out)
            check_symbols(out, source)


@pytest.mark.parametrize("name", soaked(ROBOTS, QUICK))
def test_no_heap_and_no_static_state(name: str) -> None:
    code = source_of_robot(name).code
    assert not re.search(r"\b(malloc|calloc|realloc|free|alloca|printf|exit|abort)\s*\(", code), name
    assert all(re.match(r"\s*static const ", x) for x in re.findall(r"^[ \t]+static .*$", code, re.MULTILINE)), name


def test_header_in_cpp(tmp_path: Path) -> None:
    """A C++ program includes the header, twice, and links with the C."""
    source = source_of(eomgen.load_robot("one_link"))
    write_source(source, tmp_path)
    (tmp_path / "main.cpp").write_text(
        """
        #include "one_link.h"
        #include "one_link.h"
        #include <cstdio>
        int main() {
            const double p[ONE_LINK_PARAMETERS] = {0, -9.81, 0, 1e4}, q[ONE_LINK_DOF] = {0.2, 0.5};
            double h[ONE_LINK_HOISTED], M[ONE_LINK_DOF * ONE_LINK_DOF];
            one_link_setup(p, h);
            if (one_link_mass_matrix(h, q, M) != 0) return 1;
            std::printf("%.17g %.17g %.17g %.17g", M[0], M[1], M[2], M[3]);
            return 0;
        }
        """,
        encoding="ascii",
    )
    compiled("gcc", "-std=c99", "-c", tmp_path / "one_link.c", "-o", tmp_path / "one_link.o")
    program = tmp_path / "program"
    compiled("g++", "-std=c++11", *WARNINGS, tmp_path / "main.cpp", tmp_path / "one_link.o", "-o", program, "-lm")
    answer = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    expected = [1.0, -0.5 * np.sin(0.5), -0.5 * np.sin(0.5), 1 / 3]
    assert np.allclose([float(x) for x in answer.split()], expected, rtol=1e-15)


DIGEST = """
import hashlib, sys
sys.path.insert(0, {tests!r})
from tests.support.c_sources import elastic_tree, source_of
source = source_of(elastic_tree())
print(hashlib.sha256("".join((source.header, source.code, source.cdef, source.meta)).encode()).hexdigest())
"""


@pytest.mark.soak
def test_text_does_not_depend_on_the_hash_seed() -> None:
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", DIGEST.format(tests=str(ROOT))],
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for seed in range(2)
    ]
    answers = {process.communicate()[0].strip() for process in processes}
    source = source_of(elastic_tree())
    here = hashlib.sha256("".join((source.header, source.code, source.cdef, source.meta)).encode()).hexdigest()
    assert answers == {here}


def test_text_says_where_it_is_from_and_nothing_of_when_or_who(tmp_path: Path) -> None:
    path = tmp_path / "my_secret_folder" / "arm.toml"
    path.parent.mkdir()
    builtin = Path(eomgen.__file__).parent / "robots" / "one_link.toml"
    path.write_text(builtin.read_text(encoding="utf-8"), encoding="utf-8")
    source = source_of(eomgen.load_robot(path))
    assert source == source_of(eomgen.load_robot("one_link"))
    text = source.header + source.code + source.meta
    assert "my_secret_folder" not in text
    assert not re.search(r"\b20\d\d-\d\d|\d\d:\d\d", text)
    assert f"eomgen {eomgen.__version__}" in source.header
    assert "float64" in source.header or "double" in source.header
    assert text.isascii()


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_literals_read_back_as_the_same_number(number: float) -> None:
    text = SCALARS["float64"].literal(number)
    assert float(text) == number
    assert re.fullmatch(r"-?\d+(\.\d+)?(e[+-]\d+)?", text)
    assert re.search(r"[.e]", text)  # not an integer of C


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_single_literals_read_back_as_the_same_number(number: float) -> None:
    text = SCALARS["float32"].literal(number)
    assert np.float32(text[:-1]) == np.float32(number)
    assert re.fullmatch(r"-?\d+(\.\d+)?(e[+-]\d+)?f", text)
    assert re.search(r"[.e]", text)


HOSTILE = (
    "*/ __attribute__((constructor)) void f(void) { system(0); } /*",
    "ends in a backslash \\",
    "// comment ?\x3f/",
    "a\nb",
    "#include </etc/passwd>",
    "{{ name }}{% raw %}",
    "%s%n",
    "\N{BLACK STAR}\N{CJK UNIFIED IDEOGRAPH-4E2D}",
    '"; import os #',
)
URDF = """<robot name={robot}>
<link name={base}/>
<link name={link}><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name={joint} type="revolute"><parent link={base}/><child link={link}/><axis xyz="0 1 0"/>
<limit lower="-1" upper="2" effort="10" velocity="1"/></joint>
</robot>"""


def attribute(text: str) -> str:
    for letter, entity in (("&", "&amp;"), ("<", "&lt;"), ('"', "&quot;"), ("\n", "&#10;")):
        text = text.replace(letter, entity)
    return f'"{text}"'


@pytest.mark.parametrize("hostile", soaked(HOSTILE, HOSTILE[:4]))
def test_no_text_of_a_description_reaches_the_code(hostile: str, tmp_path: Path, built: Build) -> None:
    """Every word of the C, of its header and of the package that is not the generator's is an identifier."""
    names = {key: attribute(f"{hostile}{key}") for key in ("robot", "base", "link", "joint")}
    robot = robot_from_urdf(URDF.format(**names))
    hostile_source, plain = source_of(robot), source_of(replaced_names(robot))
    for text, other in (
        (getattr(hostile_source, key), getattr(plain, key)) for key in ("header", "code", "cdef", "meta")
    ):
        assert text.isascii()
        assert text.isprintable() or set(filter(lambda x: not x.isprintable(), text)) == {"\n"}
        for old, new in own_names(robot, replaced_names(robot)):
            text = re.sub(rf"(?<![A-Za-z0-9]){old}", new, text)
            text = re.sub(rf"(?<![A-Za-z0-9]){old.upper()}(?=_[A-Z])", new.upper(), text)
        assert squeezed(text) == squeezed(other)
    kernel = built(robot, "mass_matrix")
    assert kernel.mass_matrix([0.0]).shape == (1, 1)


def squeezed(text: str) -> str:
    return re.sub(r" +", " ", text)


def replaced_names(robot: Robot) -> Robot:
    link, joint = robot.links[0], robot.joints[0]
    joint = replace(joint, name="a_joint", parent="a_base", child="a_link")
    return replace(robot, name="a_robot", base="a_base", links=(replace(link, name="a_link"),), joints=(joint,))


def own_names(robot: Robot, other: Robot) -> Iterator[tuple[str, str]]:
    pairs = [(robot.name, other.name), (robot.base, other.base)]
    pairs += [(x.name, y.name) for x, y in zip(robot.links + robot.joints, other.links + other.joints, strict=True)]
    return iter(sorted(pairs, key=lambda pair: -len(pair[0])))


@pytest.mark.parametrize("where", ["name", "base", "links", "joints", "frames", "loops"])
@pytest.mark.parametrize("bad", ["*/ int x;", "a b", "", "1a", "a\n", "\N{LATIN SMALL LETTER E WITH ACUTE}"])
def test_names_of_a_robot_made_by_hand_are_checked(where: str, bad: str) -> None:
    """A Robot that no reader has seen: the same rule, before anything is written."""
    robot = eomgen.load_robot("four_bar")
    if where in ("name", "base"):
        robot = replace(robot, **{where: bad})
    else:
        items = getattr(robot, where)
        robot = replace(robot, **{where: (replace(items[0], name=bad), *items[1:])})
    with pytest.raises(DescriptionError, match="allowed: "):
        eomgen.build(robot)


@pytest.mark.parametrize(
    "name", soaked(("double", "int", "sin", "t1", "q", "h", "out", "main", "a" * 48), ("double", "t1", "out"))
)
def test_words_of_c_as_a_name(name: str, built: Build) -> None:
    """The name is a prefix, so a word of C or of the templates may be one."""
    robot = replace(eomgen.load_robot("one_link"), name=name)
    kernel = built(robot, "mass_matrix", "forward_dynamics", "kinematics", flags=("-O0", *WARNINGS))
    assert kernel.mass_matrix([0.0, 0.0]).shape == (2, 2)
    assert kernel.frame_pose([0.0, 0.0], "tcp")[0, 3] == 1.0


def test_a_number_too_large_for_a_float_is_named() -> None:
    with pytest.raises(InputError, match=r"float32 cannot hold 1e\+39"):
        SCALARS["float32"].literal(1e39)
