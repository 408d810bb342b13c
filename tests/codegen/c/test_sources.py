"""The generated text: warnings, C++, determinism, literals, hostile names, and the committed sample."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from importlib.metadata import version
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
from eomgen.codegen.c.wrapping import COLUMNS, wrapped
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.description.load import robot_from_urdf
from eomgen.errors import DescriptionError, InputError
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Robot
from release.packages import link_package
from release.pythons import PYTHONS, interpreter
from tests.oracles.force_laws import with_laws
from tests.support.builds import Build
from tests.support.c_project import WARNINGS, check_symbols, elastic_tree, source_of, unwrapped, write_source
from tests.support.random_robots import random_robot
from tests.support.refusals import refused
from tests.support.small_robots import free_body
from tests.support.soak import WHOLE, soaked

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
def equations_of(name: str, dtype: str = "float64") -> Equations:
    return derive_equations(build_model(ROBOTS[name]()), dtype=dtype)


def test_templates_ask_for_no_name_that_they_are_not_given() -> None:
    """Not even where a branch of theirs is not taken."""
    equations = equations_of("one_link")
    meta = kernel_metadata(equations)
    header = header_context(equations, meta, True)
    alone = {**header, **number_context(equations, meta), "without_simd": False, "libm": False}
    code = {**alone, "opening": ""}
    given = {"kernel.h": header, "opening.c": alone, "kernel.c": code, "batches.c": {**code, **lane_context(equations)}}
    for name, context in given.items():
        loader = environment().loader
        text = loader.get_source(environment(), f"kernel/{name}.jinja")[0]
        wanted = find_undeclared_variables(environment().parse(text))
        assert len(wanted) > 5
        assert wanted <= context.keys(), name


@cache
def source_of_robot(name: str, dtype: str = "float64") -> Source:
    return render(equations_of(name, dtype))


def compiled(compiler: str, *arguments: str | Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    result = subprocess.run([compiler, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[:4000]
    assert result.stderr == ""


@pytest.mark.parametrize(("name", "dtype"), soaked(product(ROBOTS, ["float64", "float32"]), {("one_link", "float64")}))
def test_no_compiler_warns(name: str, dtype: str, tmp_path: Path) -> None:
    source = source_of_robot(name, dtype)
    write_source(source, tmp_path)
    small = name in ("one_link", "worn_joint", "free_body")
    assert name == "worn_joint" or ("_part1(" in source.code) != small
    ways = [("gcc", ["-O1"]), ("clang", ["-O0"]), ("gcc", ["-O0", "-DEOM_VECTOR_BYTES=0"])]
    compile_all(source, tmp_path, ways if small and dtype == "float64" else ways[1:2])


@pytest.mark.soak
@pytest.mark.skipif("x86" not in platform.machine(), reason="flags are those of x86")
@pytest.mark.parametrize("flag", ["-march=native", "-mavx2", "-mavx"])
@pytest.mark.parametrize("name", ["one_link", "worn_tree"])
def test_no_compiler_warns_of_vectors(name: str, flag: str, tmp_path: Path) -> None:
    source = source_of_robot(name)
    write_source(source, tmp_path)
    compile_all(source, tmp_path, [(compiler, ["-O1", flag]) for compiler in ("gcc", "clang")])


@pytest.mark.parametrize("name", soaked(ROBOTS, QUICK))
def test_no_heap_and_no_static_state(name: str) -> None:
    for code in source_of_robot(name).codes.values():
        assert not re.search(r"\b(malloc|calloc|realloc|free|alloca|printf|exit|abort)\s*\(", code), name
        assert all(re.match(r"\s*static const ", x) for x in re.findall(r"^[ \t]+static .*$", code, re.MULTILINE)), name


@pytest.mark.parametrize("name", soaked(ROBOTS, QUICK))
def test_lines_are_short(name: str) -> None:
    source = source_of_robot(name)
    assert [x for text in (source.header, *source.codes.values()) for x in text.splitlines() if len(x) > COLUMNS] == []


def test_lines_break_between_tokens() -> None:
    call = f"    f({', '.join(f'argument_{i}' for i in range(12))}); /* {'a word ' * 10}*/\n"
    texts = f'    const char *x = "{"many words " * 9}"; /* said */\n'
    comment = f"/* {'word ' * 30}*/\n#define X 1 /* {'word ' * 30}*/\n"
    broken = wrapped(call + texts + comment)
    assert [line[:20] for line in broken.splitlines()][:2] == ["    f(argument_0, ar", "            argument"]
    assert re.findall(r'"[^"]*"', broken) == re.findall(r'"[^"]*"', texts)
    assert all(len(line) <= COLUMNS for line in broken.splitlines())
    assert "\n#define X 1 /* word" in broken
    assert re.sub(r"\s+", " ", broken.replace("\n * ", " ")) == re.sub(r"\s+", " ", call + texts + comment)
    assert wrapped("x" * 200) == "x" * 200


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


def test_text_says_where_it_is_from_and_nothing_of_when_or_who(tmp_path: Path) -> None:
    path = tmp_path / "my_secret_folder" / "arm.toml"
    path.parent.mkdir()
    builtin = Path(eomgen.__file__).parent / "robots" / "one_link.toml"
    path.write_text(builtin.read_text(encoding="utf-8"), encoding="utf-8")
    source = source_of(eomgen.load_robot(path))
    assert source == source_of(eomgen.load_robot("one_link"))
    text = source.header + source.code + source.batch_code + source.meta
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
        assert unwrapped(text) == unwrapped(other)
    kernel = built(robot, "mass_matrix")
    assert kernel.mass_matrix([0.0]).shape == (1, 1)


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
    refused(DescriptionError, "allowed: ", eomgen.build, robot)


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
    refused(InputError, r"float32 cannot hold 1e\+39", SCALARS["float32"].literal, 1e39)


SEEDS = 100
LARGE_EVERY = 25  # seeds that also render 36 coordinates
DIGESTS = """
import hashlib, json, sys
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.c.sources import render
from eomgen import load_robot
from eomgen.robot import build_model
found = {}
for name in sys.argv[1:]:
    for dtype in ("float64", "float32"):
        source = render(derive_equations(build_model(load_robot(name)), dtype=dtype))
        text = chr(0).join((source.header, source.code, source.batch_code, source.cdef, source.meta))
        found[f"{name} {dtype}"] = hashlib.sha256(text.encode()).hexdigest()
print(json.dumps(found))
"""
SMALL, LARGE = ("one_link", "worn_arm", "four_bar"), ("puma560_elastic", "gough", "shaken_arm", "geared_arm")
NEEDED = ("sympy", "mpmath", "numpy", "jinja2", "markupsafe", "cffi", "pycparser")  # what could change a text
OTHERS = ("setuptools", "filelock", "platformdirs", "rich")


def digests(python: str, names: tuple[str, ...], seed: int, path: str = "") -> dict[str, str]:
    """Hashes of the texts by robot and dtype, of another process."""
    environment = {**os.environ, "PYTHONHASHSEED": str(seed), "PYTHONPATH": path}
    result = subprocess.run(
        [python, "-c", DIGESTS, *names], capture_output=True, text=True, check=False, env=environment
    )
    assert result.returncode == 0, result.stderr
    return dict(json.loads(result.stdout))


@pytest.mark.soak(most=1)
@pytest.mark.parametrize("part", range(4))
def test_a_hundred_hash_seeds(part: int) -> None:
    """Of small robots with every seed, of large ones with some."""
    began, seen = time.perf_counter(), 0
    expected = digests(sys.executable, SMALL + LARGE[:1], 12345)
    for seed in range(part, SEEDS, 4):
        names = SMALL + (LARGE[:1] if seed % LARGE_EVERY == part else ())
        for key, digest in digests(sys.executable, names, seed).items():
            assert digest == expected[key], (seed, key)
            seen += 1
    print(
        f"seeds {part}, {part + 4} ... {SEEDS - 4 + part}: {seen} texts the same, {time.perf_counter() - began:.0f} s"
    )


@pytest.mark.soak
@pytest.mark.parametrize("wanted", PYTHONS if WHOLE else PYTHONS[1:2])
def test_every_python_writes_the_same_text(wanted: str, tmp_path: Path) -> None:
    """With the same SymPy, in an environment of its own; NumPy as near as there is one for that Python."""
    python = interpreter(wanted)
    if python is None:
        pytest.skip(f"there is no Python {wanted} here")
    if sys.version_info[:2] == tuple(map(int, wanted.split("."))):
        pytest.skip("is the Python that runs")
    began = time.perf_counter()
    subprocess.run([python, "-m", "venv", tmp_path / "venv"], check=True, capture_output=True)
    other = str(tmp_path / "venv" / "bin" / "python")
    pinned = [f"{name}=={version(name)}" for name in NEEDED if name != "numpy"]
    exact, near = [f"numpy=={version('numpy')}"], ["numpy>=1.24"]
    install = [other, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:"]
    for numpy in (exact, near):
        done = subprocess.run([*install, *pinned, *numpy, *OTHERS], capture_output=True, text=True)
        if done.returncode == 0:
            break
    if done.returncode != 0:
        pytest.skip(f"packages cannot be installed for Python {wanted}: {done.stderr.strip().splitlines()[-1]}")
    names = SMALL + LARGE
    found, expected = digests(other, names, 0, str(link_package(tmp_path / "links"))), digests(sys.executable, names, 0)
    assert found == expected
    which = subprocess.run([other, "-c", "import numpy; print(numpy.__version__)"], capture_output=True, text=True)
    print(
        f"Python {wanted}, SymPy {version('sympy')}, NumPy {which.stdout.strip()}: {len(found)} texts the same as"
        f" with {sys.version.split()[0]}, {time.perf_counter() - began:.0f} s"
    )


@pytest.mark.soak
def test_another_hash_seed_and_the_tree_as_it_lies(tmp_path: Path) -> None:
    """The short form: one seed, and the package that the long form takes, which nobody has installed."""
    here = digests(sys.executable, SMALL[:1], 0)
    assert digests(sys.executable, SMALL[:1], 1, str(link_package(tmp_path / "links"))) == here
    assert len(here) == 2


def compile_all(source: Source, folder: Path, ways: Iterable[tuple[str, Sequence[str]]]) -> None:
    """Compile by compilers that are here, without a warning, and look at the symbols."""
    for compiler, flags in ways:
        if shutil.which(compiler):
            for file in source.codes:
                out = folder / f"{compiler}_{file}.o"
                compiled(compiler, "-std=c99", *WARNINGS, *flags, "-c", folder / file, "-o", out)
                check_symbols(out, source)
