"""Exports of robots whose laws have states or whose links bend: each takes them, or says what becomes of them."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.cli.entry import main
from eomgen.cli.export import FORMATS
from eomgen.codegen.arrays.sources import render_arrays
from eomgen.codegen.c.projects.ros2 import ros2_files
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.export import export_mjcf
from eomgen.export.fmu.pack import export_fmu
from eomgen.export.mujoco import left_out, mjcf
from eomgen.export.step import _velocities, default_step
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.levels import BASE
from tests.support.bending_robots import bent as _bent
from tests.support.bristles import (
    ARM,
    BRISTLES,
    GEARED,
    all_laws_text,
    bent,
    bristle_arm,
    bristle_gear,
    bristle_linkage,
    linkage_text,
    loop_text,
    servo_arm,
    servo_text,
    stateful_arm,
    stateful_linkage,
)
from tests.support.builds import Build
from tests.support.c_project import NO_EIGEN, WARNINGS, need, run
from tests.support.optional import OptionalModule, needs
from tests.support.random_robots import random_robot

pytestmark = pytest.mark.usefixtures("unoptimised")
SOAKED = (bristle_arm, bristle_gear, stateful_linkage, servo_arm)
ROBOTS = [stateful_arm, bristle_linkage, *(pytest.param(make, marks=pytest.mark.soak) for make in SOAKED)]
TEXTS = {
    bristle_arm: ARM,
    bristle_linkage: linkage_text(),
    bristle_gear: GEARED,
    stateful_arm: all_laws_text(),
    stateful_linkage: loop_text(),
    servo_arm: servo_text(),
}
PACKAGE = """
import json, sys
sys.modules["eomgen"] = None
import numpy as np
import bristle_arm as package
kernel, given = package.kernel, json.load(sys.stdin)
q, v, u, z = (np.array(given[key]) for key in "qvuz")
motion = kernel.rollout(q, v, u, 1e-4, 20, method="implicit", z=z)
rates = kernel.internal_state_derivatives(q, v, z, u)
found = [kernel.forward_dynamics(q, v, u, z), rates, *(x[-1] for x in (*motion, motion.z))]
print(json.dumps([list(kernel.internal_states), [[x.hex() for x in array.tolist()] for array in found]]))
"""
PLANT = """
#include "plant.hpp"
#include <cstdio>
namespace arm = eomgen::bristle_arm;
static_assert(arm::state_names.size() == BRISTLE_ARM_INTERNAL_STATES && arm::dof == BRISTLE_ARM_DOF);
static_assert(arm::states::{first} == 0 && arm::state_names[0] == "{name}");
static_assert(arm::dof + arm::state_names.size() == arm::rates);
int main()
{{
    arm::Plant plant;
    const arm::Plant::Numbers q{{{q}}};
    const arm::Plant::Rates v{{{v}}};
    const arm::Plant::Inputs u{{{u}}};
    plant.reset(q, v);
    bool good = true;
    for (int k = 0; k < 20; ++k) good = plant.step(u, 1e-4, arm::Method::implicit) && good;
    for (const double x : plant.q()) std::printf("%a ", x);
    for (const double x : plant.v()) std::printf("%a ", x);
    std::printf("%d %g\\n", good, plant.v()[arm::dof + arm::states::{first}]);
}}
"""


@pytest.mark.parametrize("make", ROBOTS)
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_written(
    name: str, make: Callable[[], Robot], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "wasm":
        needs("ziglang")
    path = tmp_path / "robot.toml"
    path.write_text(TEXTS[make], encoding="utf-8")
    more = {"mjcf": ["--approximate"], "fmu": ["--fmi", "3", "--method", "implicit"], "wasm": ["--kernels", "energy"]}
    assert main(["export", str(path), f"--{name}", "-o", str(tmp_path / "out"), *more.get(name, [])]) == 0
    assert any((tmp_path / "out").iterdir())
    if name == "mjcf":
        assert capsys.readouterr().err.count("without bristles") == 2
        assert main(["export", str(path), "--mjcf", "-o", str(tmp_path / "refused")]) == 1
        assert "without bristles" in capsys.readouterr().err


@pytest.mark.parametrize("make", ROBOTS)
def test_models_of_mujoco_have_coulomb_friction_in_their_place(make: Callable[[], Robot]) -> None:
    robot = make()
    notes = {note.split(":")[0].partition(".")[2] for note in left_out(robot)}
    named = {x.owner if x.prefix.startswith("loops.") else f"{x.owner}.{x.law}" for x in build_model(robot).states}
    assert notes >= named
    text = mjcf(robot, 1e-4, approximate=True)
    assert text.count('frictionloss="0.3"') == 2


def test_default_steps_follow_states_at_limits_of_velocity(tmp_path: Path) -> None:
    """Bristles at 40 rad/s: 300 N m/rad 40 rad/s / 0.3 N m = 4e4 1/s; MuJoCo has none, nor friction in its steps."""
    with pytest.raises(InputError, match=r"step: internal states of 'j1\.gamma', 'j2\.motor' .*: a step, limits"):
        export_fmu(bristle_arm(), tmp_path / "a.fmu", method="rk4")
    text = ARM.replace("friction = {", "limits = { velocity = 10.0 }, friction = {", 1)
    text = text.replace("ratio = 5.0\n", "ratio = 5.0\nlimits = { velocity = 40.0 }\n")
    limited = robot_from_toml(text)
    assert default_step(limited, "rk4") == 5e-6
    names = build_model(limited).coordinates
    still, fast = (dict(zip(names, v, strict=False)) for v in _velocities(limited))
    assert set(still.values()) == {0.0}
    assert (fast["j1.gamma"], fast["j2.motor"]) == (10.0, 40.0)
    assert default_step(limited, "implicit") == 1e-3
    with warnings.catch_warnings(action="ignore", category=eomgen.EomgenWarning):
        written = eomgen.export_mjcf(bristle_arm(), tmp_path / "a.xml", approximate=True)
    assert 'timestep="0.001"' in written.read_text()
    plain = robot_from_toml(ARM.replace('model = "lugre", ', "").replace(BRISTLES, ""))
    assert plain.without_states() is plain
    assert 1e-7 < default_step(plain, "rk4") < 1e-6  # 400 N m s/rad, over 1e-3 rad/s, beside 1e-3 kg m^2
    with warnings.catch_warnings(action="ignore", category=eomgen.EomgenWarning):
        written = eomgen.export_mjcf(plain, tmp_path / "b.xml", approximate=True)
    assert 'timestep="0.001"' in written.read_text()


@pytest.mark.parametrize("make", ROBOTS)
def test_python_on_arrays_has_the_kernels_numbers(make: Callable[[], Robot], built: Build) -> None:
    robot, module = make(), dict[str, Any]()
    kernel = built(robot, "forward_dynamics", "energy", "rollout")
    exec(render_arrays(build_model(robot), ("forward_dynamics", "energy")), module)
    assert tuple(module["STATES"]) == kernel.internal_states
    assert {name: tuple(x[:2]) for name, x in module.get("INPUTS", {}).items()} == {
        name: tuple(x) for name, x in kernel.inputs.items() if x.meaning not in ("force", "torque")
    }
    functions, (q, v, u, z) = module["make"](np), bent(kernel)
    if robot.is_closed:
        q, v = kernel.home[: q.size], 0.0 * v
    forces = [np.zeros(len(module["INPUTS"]))] if "INPUTS" in module else []
    rates = kernel.forward_dynamics(q, v, u, z), kernel.internal_state_derivatives(q, v, z, u)
    found = functions.forward_dynamics(q, v, z, u, *forces)
    np.testing.assert_allclose(found, np.concatenate(rates), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(functions.energy(q, v, z), kernel.energy(q, v, z=z), rtol=1e-12)
    if not robot.is_closed:
        found = functions.rollout(q, v, z, u, 1e-4, 10)
        motion = kernel.rollout(q, v, u, 1e-4, 10, z=z)
        np.testing.assert_allclose(found[2], motion.z, rtol=1e-12)
        np.testing.assert_allclose(found[0], motion[0], rtol=1e-12, atol=1e-15)


def test_components_of_ros_2_publish_no_inputs_of_drives_as_efforts() -> None:
    """Text alone: a robot with servo drives, and one without."""
    for make, has_efforts in ((servo_arm, False), (stateful_arm, True)):
        meta = json.loads(make_source(make(), Options(("rollout",), levels=(BASE,))).meta)
        component = ros2_files(meta)["component.cpp"]
        assert ("message_.effort[i] =" in component) == has_efforts
        assert ("inputs of drives" in component) != has_efforts


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm's generated package with its headers and its package of ROS 2."""
    options = Options(("forward_dynamics", "energy", "rollout"), flags=("-O0",), levels=(BASE,))
    return generate(bristle_arm(), tmp_path_factory.mktemp("generated"), options, ros2=True)


def test_packages_have_states_with_numpy_and_cffi_alone(package: Path) -> None:
    """Their names, their rates, rollouts with them: the bits of a kernel that was built here."""
    kernel = eomgen.build(bristle_arm(), kernels=("forward_dynamics", "energy", "rollout"))
    q, v, u, z = bent(kernel)
    given = json.dumps(dict(zip("qvuz", (x.tolist() for x in (q, v, u, z)), strict=True)))
    command = [sys.executable, "-c", PACKAGE]
    found = subprocess.run(command, input=given, cwd=package.parent, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    internal_states, arrays = json.loads(found.stdout)
    assert tuple(internal_states) == kernel.internal_states
    motion = kernel.rollout(q, v, u, 1e-4, 20, method="implicit", z=z)
    wanted = [
        kernel.forward_dynamics(q, v, u, z),
        kernel.internal_state_derivatives(q, v, z, u),
        motion[0][-1],
        motion[1][-1],
        motion.z[-1],
    ]
    for numbers, array in zip(arrays, wanted, strict=True):
        assert [float.fromhex(x) for x in numbers] == array.tolist()
    again = pickle.loads(pickle.dumps(kernel))
    assert again.internal_states == kernel.internal_states
    assert (again.internal_state_derivatives(q, v, z, u) == kernel.internal_state_derivatives(q, v, z, u)).all()


def test_headers_name_states_and_plants_move_with_them(package: Path, tmp_path: Path) -> None:
    """In C++: places by name, and the rollout of Python to the bit; the component takes z beside q."""
    need("gcc", "g++")
    kernel = eomgen.build(bristle_arm(), kernels=("forward_dynamics", "energy", "rollout"))
    q, v, u, z = bent(kernel)
    numbers = {key: ", ".join(x.hex() for x in array) for key, array in (("q", q), ("v", [*v, *z]), ("u", u))}
    first = kernel.internal_states[0]
    (tmp_path / "main.cpp").write_text(PLANT.format(first=first.replace(".", "_"), name=first, **numbers))
    (tmp_path / "include").mkdir()
    (tmp_path / "include/eomgen").symlink_to(package)
    plain = ("-std=c99", "-O0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
    run("gcc", *plain, *WARNINGS, "-c", package / "bristle_arm.c", "-o", tmp_path / "kernel.o")
    places = ("-I", tmp_path / "include", "-I", package / "ros2")
    made = tmp_path / "main"
    sources = (tmp_path / "main.cpp", tmp_path / "kernel.o")
    run("g++", "-std=c++17", *WARNINGS, NO_EIGEN, *places, *sources, "-o", made, "-lm")
    *found, good, state = run(made).split()
    motion = kernel.rollout(q, v, u, 1e-4, 20, method="implicit", z=z)
    np.testing.assert_array_equal([float.fromhex(x) for x in found], np.r_[motion[0][-1], motion[1][-1], motion.z[-1]])
    assert good == "1"
    assert float(state) == pytest.approx(motion.z[-1, 0], rel=1e-5)
    header = (package / "bristle_arm.h").read_text(encoding="ascii")
    for key, names in (("COORDINATE", kernel.coordinates), ("STATE", kernel.internal_states)):
        for place, name in enumerate(names):
            assert re.search(rf"BRISTLE_ARM_{key}_{name.replace('.', '_')} = {place},? /\* {name} \*/\n", header)
    mex = (package / "bristle_arm_mex.c").read_text(encoding="ascii")
    assert f'"{first}",' in mex and 'strcmp(name, "states")' in mex  # noqa: PT018
    component = (package / "ros2" / "component.cpp").read_text(encoding="ascii")
    assert 'declare_parameter<std::vector<double>>("z"' in component


mujoco = OptionalModule("mujoco")


@pytest.mark.parametrize("approximate", [False, True])
def test_models_of_mujoco(tmp_path: Path, approximate: bool) -> None:
    """Without its modes the nodes of a link would move freely, so that nothing approximates it."""
    robot = _bent(random_robot(1, (2, 2)), 1, (2,)).robot
    with pytest.raises(eomgen.InputError, match=r"links\.link1\.modes: no link of MuJoCo bends; allowed: .*beams"):
        export_mjcf(robot, tmp_path / "arm.xml", approximate=approximate)
    assert not list(tmp_path.iterdir())


def test_models_of_mujoco_by_segments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From Python and by the flag: bodies, joints and tendons of the chain; rigid links have none."""
    robot = eomgen.load_robot("flexible_arm")
    path = export_mjcf(robot, tmp_path / "arm.xml", step=1e-4, segments=2)
    model = mujoco.MjModel.from_xml_path(str(path))
    names = [model.joint(i).name for i in range(model.njnt)]
    of_segments = [f"{link}{k}.{key}" for link in ("upper", "forearm") for k in (1, 2) for key in ("y", "gamma")]
    assert names == ["shoulder.gamma", *of_segments[:4], "elbow.gamma", *of_segments[4:]]
    assert sum(model.body_mass) == pytest.approx(sum(x.mass for x in robot.links), rel=1e-12)
    words = ["export", "flexible_arm", "--mjcf", "--step", "1e-4", "-o", str(tmp_path / "same.xml"), "--segments"]
    assert main([*words, "2"]) == 0
    assert (tmp_path / "same.xml").read_bytes() == path.read_bytes()
    assert main([*words, "0"]) == 1
    assert "segments: got 0; allowed: a whole number from 1 to 100" in capsys.readouterr().err
    assert main(["export", "one_link", "--mjcf", "--segments", "2", "-o", str(tmp_path)]) == 1
    assert "no link of one_link bends by modes" in capsys.readouterr().err
    assert main(["export", "one_link", "--arrays", "--segments", "2", "-o", str(tmp_path)]) == 1
    assert "--segments: given without its format; allowed: with --mjcf" in capsys.readouterr().err


def test_algorithms_of_the_textbook() -> None:
    model = build_model(_bent(random_robot(1, (2, 2)), 1, (2,)).robot)
    assert "no links that bend (link1.mode1, " in unknown_to_textbook(model.tree)
