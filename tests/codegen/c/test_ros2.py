"""Packages of ROS 2: the plant moves as the Python kernel says, without allocating; package.xml is valid."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.pipeline.stages import Options, generate
from eomgen.runtime.levels import BASE
from tests.support.c_project import NO_EIGEN, WARNINGS, need, run
from tests.support.soak import soaked

PROGRAM = """
#include "plant.hpp"
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <new>
static long allocations = 0;
void *operator new(std::size_t size) {{ ++allocations; return std::malloc(size); }}
void operator delete(void *p) noexcept {{ std::free(p); }}
void operator delete(void *p, std::size_t) noexcept {{ std::free(p); }}
namespace arm = eomgen::{name};
int main()
{{
    arm::Plant plant;
    const arm::Plant::Numbers q{{{q}}}, u{{{u}}};
    plant.reset(q, {{}});
    bool good = true;
    for (int k = 0; k < 50; ++k) good = plant.step(u, {dt}, arm::Method::{method}) && good;
    for (const double x : plant.q()) std::printf("%a ", x);
    for (const double x : plant.v()) std::printf("%a ", x);
    const arm::Plant::Numbers before = plant.q();
    const bool refused = !plant.step(u, NAN, arm::Method::{method}) && plant.q() == before;
    std::printf("%d %d %ld\\n", good, refused, allocations);
}}
"""


@pytest.mark.parametrize(
    ("name", "method"),
    soaked([("one_link", "rk4"), ("puma560_elastic", "implicit"), ("flexible_arm", "implicit")], {("one_link", "rk4")}),
)
def test_the_plant_moves_as_the_kernel_says(name: str, method: str, tmp_path: Path) -> None:
    need("gcc", "g++")
    kernel = eomgen.build(name, kernels=("rollout",), flags=("-O0",))
    package = generate(name, tmp_path, Options(("rollout",), flags=("-O0",), level=BASE), ros2=True)
    rng = np.random.default_rng(3)
    q, u, dt = rng.uniform(-1e-3, 1e-3, kernel.n), rng.uniform(-1.0, 1.0, kernel.n), 1e-4
    text = PROGRAM.format(
        name=name, q=", ".join(x.hex() for x in q), u=", ".join(x.hex() for x in u), dt=dt, method=method
    )
    (tmp_path / "main.cpp").write_text(text, encoding="ascii")
    (tmp_path / "include").mkdir()
    (tmp_path / "include/eomgen").symlink_to(package)
    kernel_flags = ("-std=c99", "-O0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
    run("gcc", *kernel_flags, *WARNINGS, "-c", package / f"{name}.c", "-o", tmp_path / "kernel.o")
    places = ("-I", tmp_path / "include", "-I", package / "ros2")
    made = tmp_path / "main"
    run(
        "g++",
        "-std=c++17",
        *WARNINGS,
        NO_EIGEN,
        *places,
        tmp_path / "main.cpp",
        tmp_path / "kernel.o",
        "-o",
        made,
        "-lm",
    )
    *numbers, good, refused, allocations = run(made).split()
    found = np.array([float.fromhex(x) for x in numbers])
    state = q, np.zeros(kernel.n)
    for _ in range(50):
        qs, vs = kernel.rollout(*state, u, dt, 1, method=method)
        state = qs[-1], vs[-1]
    np.testing.assert_array_equal(found, np.concatenate(state))
    assert (good, refused, allocations) == ("1", "1", "0")


def test_the_package_is_one_of_ament(tmp_path: Path) -> None:
    package = generate("one_link", tmp_path, Options(("rollout",), flags=("-O0",), level=BASE), ros2=True) / "ros2"
    root = ElementTree.parse(package / "package.xml").getroot()
    name = root.findtext("name")
    assert root.get("format") == "3"
    lists = (package / "CMakeLists.txt").read_text(encoding="ascii")
    assert f"project({name} " in lists
    for depend in root.findall("depend"):
        assert f"find_package({depend.text} REQUIRED)" in lists
    assert f'package="{name}"' in (package / "launch/robot.launch.py").read_text(encoding="ascii")
    compile((package / "launch/robot.launch.py").read_text(encoding="ascii"), "launch", "exec")
    catkin = pytest.importorskip("catkin_pkg.package")
    parsed = catkin.parse_package(str(package / "package.xml"))
    parsed.validate()


def test_a_package_without_rollouts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rollout"):
        generate("one_link", tmp_path, Options(("energy",), flags=("-O0",), level=BASE), ros2=True)
    assert not (tmp_path / "one_link").exists()
