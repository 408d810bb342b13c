"""Projects in C and C++: the commands of docs/embed.md, the examples against the Python kernel, packages of CMake."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.codegen.package.compile import FLAGS, NATIVE, carried_contents
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.runtime.levels import BASE
from tests.support.c_project import COMPILERS, WARNINGS, eigen_prefix, need, run, search_path

pytestmark = pytest.mark.quick

ROOT = Path(__file__).parents[3]
EMBED = (ROOT / "docs" / "embed.md").read_text(encoding="utf-8")
NEEDED = ("forward_dynamics", "inverse_dynamics", "energy", "kinematics", "rollout")
ALONE = Options(("mass_matrix",), levels=(BASE,))
START, GOAL = [0.0, -0.5, 0.5, 0.0, 0.0, 0.0], [0.8, -1.0, 1.2, 0.3, -0.4, 0.6]
DT, STEPS, EVERY = 1e-3, 1000, 50

Array = NDArray[np.float64]


def commands(text: str) -> list[str]:
    """The commands of a text's console blocks, in their order."""
    blocks = re.findall(r"```console\n(.*?)```", text, re.S)
    return [line.removeprefix("$ ") for block in blocks for line in block.splitlines()]


def arm() -> eomgen.Kernel:
    return eomgen.build(eomgen.load_robot("puma560"), kernels=NEEDED)


def environment(compiler: str, folder: Path) -> dict[str, str]:
    """Of a shell whose cc and c++ are the compiler, with CMake, Ninja and Eigen where pip put them."""
    need(compiler, COMPILERS[compiler], "cmake", "ninja")
    tools = folder / "tools"
    tools.mkdir()
    for name, program in (("cc", compiler), ("c++", COMPILERS[compiler])):
        (tools / name).symlink_to(str(shutil.which(program)))
    prefix = eigen_prefix()
    return {
        **os.environ,
        "PATH": os.pathsep.join((str(tools), search_path())),
        "CC": compiler,
        "CXX": COMPILERS[compiler],
        "CMAKE_GENERATOR": "Ninja",
        "CMAKE_PREFIX_PATH": str(prefix) if prefix else "",
    }


def of_c() -> Array:
    """What examples/c_arm prints: t, kinetic and potential energy, position of the flange."""
    kernel = arm()
    kp, kd = [400.0, 900.0, 400.0, 60.0, 60.0, 60.0], [40.0, 120.0, 40.0, 6.0, 6.0, 6.0]
    zero = np.zeros(6)
    q, v = kernel.rollout(START, zero, zero, DT, STEPS, every=EVERY, kp=kp, kd=kd, target=GOAL)
    t = np.arange(len(q)) * EVERY * DT
    return np.column_stack([t, kernel.energy(q, v), kernel.frame_pose(q, "tcp")[:, :3, 3]])


def of_cpp() -> Array:
    """What examples/cpp_arm prints: t, tracking error, speed and position of the flange."""
    model = arm()
    damping = "joints.joint2.gamma.damping"
    plant = model.replaced(parameters={damping: 1.5 * model.parameters[damping]})
    start, way = np.array(START), np.array(GOAL) - np.array(START)
    q, v, rows = start, np.zeros(6), []
    for k in range(STEPS + 1):
        x = 2 * np.pi * k * DT
        q_p, v_p, a_p = start + (x - np.sin(x)) / (2 * np.pi) * way, (1 - np.cos(x)) * way, 2 * np.pi * np.sin(x) * way
        if k % EVERY == 0:
            speed = plant.frame_jacobian(q, "tcp")[:3] @ v
            place = plant.frame_pose(q, "tcp")[:3, 3]
            rows.append([k * DT, np.linalg.norm(q - q_p), np.linalg.norm(speed), *place])
        u = model.inverse_dynamics(q, v, a_p + 400.0 * (q_p - q) + 40.0 * (v_p - v))
        a1, v2 = plant.forward_dynamics(q, v, u), v
        v2 = v + DT / 2 * a1
        a2 = plant.forward_dynamics(q + DT / 2 * v, v2, u)
        v3 = v + DT / 2 * a2
        a3 = plant.forward_dynamics(q + DT / 2 * v2, v3, u)
        v4 = v + DT * a3
        a4 = plant.forward_dynamics(q + DT * v3, v4, u)
        q = q + DT / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v = v + DT / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return np.array(rows)


def table(text: str, header: str) -> Array:
    lines = text.splitlines()
    assert lines[0] == header
    return np.array([[float(x) for x in line.split(",")] for line in lines[1:]])


@pytest.mark.soak
@pytest.mark.parametrize(
    "compiler", [pytest.param(name, marks=pytest.mark.soak if name == "clang" else ()) for name in COMPILERS]
)
def test_the_commands_of_the_documentation(compiler: str, tmp_path: Path) -> None:
    """Both examples in all ways, with warnings as errors; their numbers are the Python kernel's."""
    variables = environment(compiler, tmp_path)
    shutil.copytree(ROOT / "examples", tmp_path / "examples", ignore=shutil.ignore_patterns("*.py", "*.toml"))
    if shutil.which("pkg-config", path=variables["PATH"]) is None:
        pytest.skip("there is no pkg-config; pip install pkgconf")
    script = "set -e\n" + "".join(f"echo '## {line}'\n{line}\n" for line in commands(EMBED))
    result = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=variables, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, (result.stdout + result.stderr)[-6000:]
    cached = (tmp_path / "build/cpp_arm/CMakeCache.txt").read_text(encoding="utf-8")
    assert re.search(rf"^CMAKE_CXX_COMPILER:\w+=.*/{re.escape(COMPILERS[compiler])}$", cached, re.M)
    parts = dict(part.split("\n", 1) for part in result.stdout.split("## ")[1:])
    assert list(parts) == commands(EMBED)
    c, cpp = "t,kinetic,potential,x,y,z", "t,error,speed,x,y,z"
    for line, header, expected in (
        ("build/c_arm/c_arm", c, of_c()),
        ("build/c_arm_installed/c_arm", c, of_c()),
        ("build/c_arm_pc", c, of_c()),
        ("build/cpp_arm/cpp_arm", cpp, of_cpp()),
        ("build/cpp_arm_installed/cpp_arm", cpp, of_cpp()),
    ):
        assert expected.shape == (21, 6)
        assert np.abs(table(parts[line], header) - expected).max() <= 1e-12, line
    assert eigen_is_used(tmp_path / "build/cpp_arm") == (eigen_prefix() is not None)
    assert not eigen_is_used(tmp_path / "build/cpp_arm_installed")


def eigen_is_used(build: Path) -> bool:
    return "EOMGEN_EIGEN=1" in (build / "build.ninja").read_text(encoding="utf-8")


def test_readmes_of_the_examples_say_what_the_documentation_says() -> None:
    """Their commands are among those that the tests run, and links lead somewhere."""
    for folder in ("c_arm", "cpp_arm"):
        text = (ROOT / "examples" / folder / "README.md").read_text(encoding="ascii")
        found = commands(text)
        assert len(found) == 4
        assert set(found) <= set(commands(EMBED))
        for target in re.findall(r"\]\(([^)]+)\)", text):
            assert (ROOT / "examples" / folder / target).exists(), target
    for target in re.findall(r"\]\(([^)]+)\)", EMBED):
        assert (ROOT / "docs" / target.partition("#")[0]).exists(), target


def test_blocks_of_the_documentation_compile(tmp_path: Path) -> None:
    need("gcc", "g++")
    package = generate(
        eomgen.load_robot("puma560"), tmp_path, Options(NEEDED, flags=("-O0",), levels=(BASE,)), cmake=True
    )
    include = tmp_path / "include"
    include.mkdir()
    (include / "eomgen").symlink_to(package)
    (c,) = re.findall(r"```c\n(.*?)```", EMBED, re.S)
    (cpp,) = re.findall(r"```cpp\n(.*?)```", EMBED, re.S)
    headers = "#include <eomgen/puma560.h>\n"
    (tmp_path / "block.c").write_text(f"{headers}void f(const double *q);\nvoid f(const double *q)\n{{\n{c}}}\n")
    (tmp_path / "block.cpp").write_text(cpp)
    run("gcc", "-std=c99", "-Wall", "-Werror", "-I", include, "-fsyntax-only", tmp_path / "block.c")
    run("g++", "-std=c++17", "-Wall", "-Werror", "-I", include, "-fsyntax-only", tmp_path / "block.cpp")


TWO = """
cmake_minimum_required(VERSION 3.15)
project(two LANGUAGES C)
if(FETCHED)
    include(FetchContent)
    foreach(robot one_link ctype)
        FetchContent_Declare(${robot}_kernel SOURCE_DIR ${CMAKE_CURRENT_SOURCE_DIR}/${robot})
        FetchContent_MakeAvailable(${robot}_kernel)
    endforeach()
else()
    find_package(one_link CONFIG REQUIRED)
    find_package(ctype CONFIG REQUIRED)
endif()
add_executable(two main.c)
target_link_libraries(two PRIVATE eomgen::one_link eomgen::ctype)
"""
MAIN = """
#include <eomgen/ctype.h>
#include <eomgen/one_link.h>
#include <ctype.h>
#include <math.h>
#include <stdio.h>
int main(void)
{
    const double p[ONE_LINK_PARAMETERS] = { 0.0 }, q[2] = { 0.0, 0.5 };
    double h[ONE_LINK_HOISTED], one[4], other[4];
    one_link_setup(p, h);
    one_link_mass_matrix(h, q, one);
    ctype_setup(p, h);
    ctype_mass_matrix(h, q, other);
    printf("%.17g %.17g %.17g", one[1], other[1], isdigit('1') ? fabs(one[1]) : 0.0);
    return 0;
}
"""


@pytest.mark.soak
@pytest.mark.parametrize(
    "kind", ["shared", *(pytest.param(kind, marks=pytest.mark.soak) for kind in ("static", "fetched"))]
)
def test_two_kernels_in_one_program(kind: str, tmp_path: Path) -> None:
    """One named as a header of C; installed, moved, and found at the new place; or fetched."""
    variables = environment("gcc", tmp_path)
    names = ("one_link", "ctype")
    for name in names:
        robot = eomgen.load_robot("one_link")
        generate(replace(robot, name=name), tmp_path / "two", ALONE, cmake=True)
    (tmp_path / "two" / "CMakeLists.txt").write_text(TWO, encoding="ascii")
    (tmp_path / "two" / "main.c").write_text(MAIN, encoding="ascii")
    cmake = str(shutil.which("cmake", path=variables["PATH"]))

    def configured(source: Path, build: Path, *options: str) -> None:
        run(cmake, "-S", source, "-B", build, *options, env=variables)
        run(cmake, "--build", build, env=variables)

    options = ["-DFETCHED=ON"]
    if kind != "fetched":
        first, moved = tmp_path / "first", tmp_path / "moved"
        for name in names:
            shared = f"-DBUILD_SHARED_LIBS={'ON' if kind == 'shared' else 'OFF'}"
            configured(tmp_path / "two" / name, tmp_path / name, shared, "-DCMAKE_C_VISIBILITY_PRESET=hidden")
            run(cmake, "--install", tmp_path / name, "--prefix", first, env=variables)
        first.rename(moved)
        files = [path for path in moved.rglob("*") if path.is_file()]
        for path in files:
            assert str(tmp_path).encode() not in path.read_bytes(), path
        assert any(path.name.startswith("libeomgen_ctype.") for path in files)
        options = [f"-DCMAKE_PREFIX_PATH={moved}"]
    configured(tmp_path / "two", tmp_path / "program", *options)
    answer = run(tmp_path / "program" / "two")
    assert [float(x) for x in answer.split()] == pytest.approx(
        [-0.5 * np.sin(0.5)] * 2 + [0.5 * np.sin(0.5)], abs=1e-15
    )


def test_a_version_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    variables = environment("gcc", tmp_path)
    package = generate(eomgen.load_robot("one_link"), tmp_path, ALONE, cmake=True)
    cmake = str(shutil.which("cmake", path=variables["PATH"]))
    run(cmake, "-S", package, "-B", tmp_path / "build", env=variables)
    script = (
        f"include({tmp_path}/build/one_linkConfigVersion.cmake)\n"
        'message("${PACKAGE_VERSION} ${PACKAGE_VERSION_COMPATIBLE}")\n'
    )
    own_major, own_minor = (int(x) for x in eomgen.__version__.split(".")[:2])
    older = (own_major, own_minor - 1) if own_minor else (own_major - 1, 0)
    for major, minor, fits in (
        (own_major, own_minor, "TRUE"),
        (*older, "FALSE"),
        (own_major, own_minor + 1, "FALSE"),
        (own_major + 1, own_minor, "FALSE"),
    ):
        wanted = f"{major}.{minor}"
        head = "".join(
            f"set(PACKAGE_FIND_VERSION{key} {value})\n"
            for key, value in (("", wanted), ("_MAJOR", major), ("_MINOR", minor))
        )
        (tmp_path / "ask.cmake").write_text(head + "set(CMAKE_SIZEOF_VOID_P 8)\n" + script, encoding="ascii")
        answer = subprocess.run([cmake, "-P", tmp_path / "ask.cmake"], capture_output=True, text=True, check=True)
        assert answer.stderr.split() == [eomgen.__version__, fits]


@pytest.mark.soak
def test_headers_that_a_header_includes_are_installed_with_it(tmp_path: Path) -> None:
    """CMake installs the robot's header and all that it includes, which users alone would miss."""
    folder = generate("one_link", tmp_path, options=Options(("rollout",), levels=(BASE,)), cmake=True)
    project = (folder / "CMakeLists.txt").read_text(encoding="utf-8")
    seen = ["one_link.h"]
    for header in seen:
        included = re.findall(r'^#include "(.+)"$', (folder / header).read_text(encoding="utf-8"), re.M)
        seen += [place for name in included if (place := f"{Path(header).parent / name}") not in seen]
    assert len(seen) > 1
    assert set(seen) <= set(" ".join(re.findall(r"foreach\(header (.*?)\)", project)).split())


STEPS_ALONE = ("adaptive_steps.h", "input_forces.h", "sensitivities.h")


@pytest.mark.parametrize(
    ("kernels", "more"),
    [
        (("mass_matrix",), None),
        (("rollout",), ()),
        (("rollout", "adaptive_rollout"), STEPS_ALONE[:2]),
        pytest.param(("rollout", "explicit_gradient"), STEPS_ALONE, marks=pytest.mark.soak),
    ],
    ids=lambda x: None,
)
def test_a_package_carries_those_files_that_its_c_includes(
    kernels: tuple[str, ...], more: tuple[str, ...] | None, tmp_path: Path
) -> None:
    """It compiles from its own folder, into the functions of one state and into those of batches."""
    need("gcc")
    package = generate("one_link", tmp_path, Options(kernels, flags=("-O0",), levels=(BASE,)))
    header = (package / "one_link.h").read_text(encoding="ascii")
    declared = set(re.findall(r"^(?:void|int|long long|const char \*)\s?(one_link_\w+)\(", header, re.M))
    included = set[str]()
    for name, is_batch in (("one_link", False), ("one_link_batch", True)):
        run("gcc", "-c", *WARNINGS, "-std=c99", f"{name}.c", cwd=package)
        symbols = [line.split()[-2:] for line in run("nm", f"{name}.o", cwd=package).splitlines()]
        assert {x for kind, x in symbols if kind == "T"} == {x for x in declared if x.endswith("_batch") == is_batch}
        assert any("lanes" in symbol for _, symbol in symbols) == is_batch
        included |= set(run("gcc", "-std=c99", "-MM", f"{name}.c", cwd=package).split())
    carried = {path.relative_to(package).as_posix() for path in (package / "clib").iterdir()}
    assert carried == {place for place in included if place.startswith("clib/")}
    assert ("clib/fixed_steps.h" in carried) == (more is not None)
    assert {name for name in STEPS_ALONE if f"clib/{name}" in carried} == {*(more or ())}


def test_generate_without_cmake_is_as_before(tmp_path: Path) -> None:
    """Neither the cached package nor a plain one holds any of it; the text is the same from one time to the next."""
    robot, options = eomgen.load_robot("one_link"), ALONE

    def made(folder: str, cmake: bool) -> dict[str, bytes]:
        files = generate(robot, tmp_path / folder, options, cmake=cmake).iterdir()
        return {path.name: path.read_bytes() for path in files if path.is_file()}

    first, with_project, plain = made("a", True), made("b", True), made("a", False)
    added = {"CMakeLists.txt", "one_linkConfig.cmake", "one_link.pc.in", "one_link.hpp", "one_link_mex.c"}
    assert first == with_project
    assert set(first) - set(plain) == added
    assert plain == {name: text for name, text in first.items() if name not in added}
    for name in added:
        assert str(tmp_path) not in first[name].decode("ascii")
        assert not re.search(rb"\b20\d\d-\d\d|\d\d:\d\d", first[name])


def test_the_project_is_compiled_as_the_kernel_is(tmp_path: Path) -> None:
    for native in (False, True):
        levels = () if native else (BASE,)
        options = Options(("mass_matrix",), native=native, flags=("-fstack-protector",), levels=levels)
        package = generate(eomgen.load_robot("one_link"), tmp_path, options, cmake=True)
        (line,) = re.findall(r'"SHELL:(.*)"', (package / "CMakeLists.txt").read_text(encoding="ascii"))
        flags = (*FLAGS, *(NATIVE if native else ()), *options.flags)
        assert line.split() == ["-fno-fast-math", *(flag for flag in flags if flag != "-O2")]


@pytest.mark.parametrize("compiler", COMPILERS)
def test_fast_arithmetic_of_the_whole_project_stops_before_the_kernel(compiler: str, tmp_path: Path) -> None:
    variables = {**environment(compiler, tmp_path), "CFLAGS": "-O2 -ffast-math"}
    package = generate(eomgen.load_robot("one_link"), tmp_path, ALONE, cmake=True)
    cmake = str(shutil.which("cmake", path=variables["PATH"]))
    run(cmake, "-S", package, "-B", tmp_path / "build", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", env=variables)
    jobs = json.loads((tmp_path / "build/compile_commands.json").read_text(encoding="utf-8"))
    assert [Path(job["file"]).name for job in jobs] == ["one_link.c", "one_link_batch.c"]
    for job in jobs:
        command = shlex.split(job["command"])
        assert "-ffast-math" in command
        words = [word for word in command[1:] if word.startswith("-f")]
        asked = [compiler, *words, "-dM", "-E", "-xc", "/dev/null"]  # clang warns that it was told both
        macros = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
        assert "__FAST_MATH__" not in macros
        assert "#define __FINITE_MATH_ONLY__ 0" in macros


def test_the_committed_sample_is_current(tmp_path: Path) -> None:
    """``make sample`` writes it; the compiled module is not committed."""
    made = generate(eomgen.load_robot("one_link"), tmp_path, Options(flags=("-O0",), levels=(BASE,)))
    sample = ROOT / "generated" / "one_link"

    def texts(folder: Path) -> dict[str, str]:
        files = (path for path in folder.rglob("*") if path.suffix in (".py", ".c", ".h", ".json"))
        found = {path.relative_to(folder).as_posix(): path.read_text(encoding="ascii") for path in files}
        return {name: re.sub(r"SymPy [\w.]+ derived", "SymPy derived", text) for name, text in found.items()}

    assert texts(sample) == texts(made)
    codes = ("one_link.c", "one_link_batch.c")
    files = texts(sample)
    carried = carried_contents(json.loads(files["one_link.json"]), *(files[file] for file in codes))
    assert set(files) == {*carried, *codes, "__init__.py", "one_link.h", "one_link.json"}
