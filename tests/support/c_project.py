"""The text of a robot's C, what its binary may hold, and compilers and build tools for generated projects."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.levels import supported
from tests.support.random_robots import random_robot

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
COMPILERS = {"gcc": "g++", "clang": "clang++"}  # of C, and of C++
NO_EIGEN = "-DEOMGEN_EIGEN=0"
PREAMBLE = """
#include "{name}.hpp"
#include <cstdio>
namespace arm = eomgen::{space};
template <class Numbers> void show(const char *name, const Numbers &numbers)
{{
    std::printf("%s", name);
    for (const auto &x : numbers) std::printf(" %a", static_cast<double>(x));
    std::puts("");
}}
template <class T, std::size_t N> const std::array<T, N> &found(const std::array<T, N> &x) {{ return x; }}
template <class T> const T &found(const std::optional<T> &x) {{ return x.value(); }}
"""


def eigen_prefix() -> Path | None:
    """Where the package cmeel-eigen installed Eigen, or None."""
    places = [Path(entry) / "cmeel.prefix" for entry in sys.path]
    return next((place for place in places if (place / "include/eigen3/Eigen/Core").exists()), None)


def need_eigen() -> tuple[str, str]:
    """The compiler's flags that find Eigen as a system header; skips the test where there is none."""
    prefix = eigen_prefix()
    if prefix is None:
        pytest.skip("there is no Eigen; pip install cmeel-eigen")
    return "-isystem", str(prefix / "include" / "eigen3")


def need(*programs: str) -> None:
    """Skip the test where a program is missing."""
    for program in programs:
        if shutil.which(program, path=search_path()) is None:
            pytest.skip(f"there is no {program}")


def search_path() -> str:
    """Where programs are looked for: first those that pip installed beside this Python."""
    return os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))


def run(*command: str | Path, **options: object) -> str:
    """What a command printed; it must succeed, and print nothing to stderr."""
    result = subprocess.run([str(x) for x in command], capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    assert result.returncode == 0, (result.stdout + result.stderr)[-6000:]
    assert result.stderr == ""
    return str(result.stdout)


def program(compiler: str, code: str, packages: Sequence[Path], folder: Path, *flags: str) -> Path:
    """C++17 and the C of packages, compiled without optimisation and linked.

    Args:
        compiler: "gcc" or "clang".
        code: of a program of C++, which includes the headers of the packages.
        packages: folders that ``generate`` wrote.
        folder: for what is made.
        flags: of the C++ compiler.
    """
    need(compiler, COMPILERS[compiler])
    (folder / "main.cpp").write_text(code, encoding="ascii")
    objects = []
    for code in (package / f"{package.name}{end}.c" for package in packages for end in ("", "_batch")):
        objects.append(folder / f"{code.stem}.o")
        run(compiler, "-std=c99", *WARNINGS, "-O0", "-ffp-contract=off", "-c", code, "-o", objects[-1])
    include = [part for package in packages for part in ("-iquote", str(package))]
    made = folder / "main"
    run(
        COMPILERS[compiler], "-std=c++17", *WARNINGS, *include, *flags, folder / "main.cpp", *objects, "-o", made, "-lm"
    )
    return made


def package_of(robot: Robot, folder: Path, *kernels: str, dtype: str = "float64") -> Path:
    """A generated package of all kernels or of some, with its project, compiled quickly for the best level here."""
    options = Options(kernels or ("all",), dtype, flags=("-O0",), levels=(supported()[-1],))
    return generate(robot, folder, options, cmake=True)


def elastic_tree() -> Robot:
    """A tree with more coordinates than are solved in straight lines, and parameters of every kind."""
    robot = random_robot(5, joints=(4, 4), tree=True, types=("revolute", "prismatic", "free"), max_coordinates=4)
    tunable = (
        f"links.{robot.links[0].name}.mass",
        f"links.{robot.links[-1].name}.com.x",
        "joints.joint2.placement.xyz.0",
    )
    return replace(robot, name="elastic_tree", tunable=tunable)


def write_source(source: Source, folder: Path) -> list[Path]:
    """Write header, code and the library that they include into a folder; return the files to compile."""
    for place, text in source.files.items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_text(text, encoding="ascii")
    return [folder / file for file in source.codes]


def unwrapped(text: str) -> str:
    """Return generated code without what depends on the length of names: line breaks, places of constants' comments."""
    constant = re.compile(r"/\* ((?:(?!\*/).)*) \*/\n(#define EOM_C\d+ \S+)\n", re.DOTALL)
    text = constant.sub(lambda match: f"{match[2]} /* {match[1]} */\n", text)
    return re.sub(r"\s+", " ", text.replace("\n * ", " "))


def source_of(robot: Robot, dtype: str = "float64") -> Source:
    return render(derive_equations(build_model(robot), dtype=dtype))


def check_symbols(library: Path, source: Source) -> None:
    """Nothing global is written, nothing is called but libm, and every global name begins with the robot's."""
    listed = subprocess.run(["nm", library], capture_output=True, text=True, check=True).stdout
    found = [line.split()[-2:] for line in listed.splitlines()]
    libm = {
        "sin",
        "cos",
        "sincos",
        "sinf",
        "cosf",
        "sincosf",
        "sqrt",
        "sqrtf",
        "exp",
        "expf",
        "log",
        "logf",
        "atan2",
        "atan2f",
    }
    libm |= {"round", "roundf", "pow"}
    compilers_own = {"memset", "memcpy", "memmove", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}
    sections = subprocess.run(["objdump", "-t", library], capture_output=True, text=True, check=True).stdout
    constant = {line.split()[-1] for line in sections.splitlines() if " .data.rel.ro" in line}  # but for relocation
    for kind, name in found:
        assert kind in "TtUrR" or name in constant, (kind, name)  # no data, no bss
        assert name in libm | compilers_own if kind == "U" else kind != "T" or name.startswith(f"{source.name}_")
