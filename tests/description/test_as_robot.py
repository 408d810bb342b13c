"""A robot where a robot is asked for: a Robot, a built-in name or a path, in every function of the interface."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.analysis.compliance import compliance_map
from eomgen.analysis.frequency import response
from eomgen.analysis.matrices import linearize
from eomgen.analysis.modal import modes, modes_along
from eomgen.analysis.sensitivity import offset_sensitivity
from eomgen.analysis.statics import deflection
from eomgen.analysis.structures import compare
from eomgen.analysis.tool_budget import budget
from eomgen.bench.beside import bench
from eomgen.description import RobotLike, as_robot
from eomgen.export.mujoco import mjcf
from eomgen.identification.from_motion import forces
from eomgen.identification.stiffness.solve import fit
from eomgen.pictures.browser import View
from eomgen.pictures.page import report_of
from eomgen.pictures.robot import plot_robot
from eomgen.pipeline.costs import robot_info
from eomgen.scenario import scenario_from_toml
from eomgen.simulation.result import simulated_robot
from eomgen.sweep.driver import run
from tests.support.quick_builds import ONE_LEVEL
from tests.support.refusals import refused

Call = Callable[[Any], object]

RESULT: Any = None  # results and plans are not looked at where the robot is wrong
CALLS: dict[str, Call] = {
    "build": eomgen.build,
    "generate": lambda robot: eomgen.generate(robot, Path("unused")),
    "robot_info": robot_info,
    "simulate": eomgen.simulate,
    "run_scenario": lambda robot: eomgen.run_scenario(robot, scenario_from_toml("duration = 1.0")),
    "simulated_robot": lambda robot: simulated_robot(RESULT, robot),
    "export_mjcf": lambda robot: eomgen.export_mjcf(robot, "unused.xml"),
    "mjcf": lambda robot: mjcf(robot, 1e-3),
    "export_wasm": lambda robot: eomgen.export_wasm(robot, "unused"),
    "export_wheel": lambda robot: eomgen.export_wheel(robot, "unused"),
    "float32_advice": lambda robot: eomgen.float32_advice(robot, ["inverse_dynamics"]),
    "rounding_bound": lambda robot: eomgen.rounding_bound(robot, "inverse_dynamics"),
    "export_simt": lambda robot: eomgen.export_simt(robot, "unused"),
    "export_arrays": lambda robot: eomgen.export_arrays(robot, "unused.py"),
    "export_live": lambda robot: eomgen.export_live(robot, "unused.html"),
    "export_fmu": lambda robot: eomgen.export_fmu(robot, "unused.fmu"),
    "modes": modes,
    "modes_along": lambda robot: modes_along(robot, [None]),
    "response": lambda robot: response(robot, ["joint1.x"], ["joint1.x"], [1.0]),
    "deflection": deflection,
    "linearize": linearize,
    "compliance_map": lambda robot: compliance_map(robot, [0, 0, 0], [1, 0, 0], [0, 1, 0]),
    "offset_sensitivity": lambda robot: offset_sensitivity(robot, [0.0], "link1"),
    "budget": lambda robot: budget(RESULT, robot),
    "compare": lambda robot: compare([robot, robot]),
    "sweep.run": lambda robot: run(robot, {"duration": 1.0}, RESULT, "unused"),
    "forces": lambda robot: forces(robot, "unused.csv"),
    "fit": lambda robot: fit(robot, "unused.csv"),
    "bench": bench,
    "plot_robot": lambda robot: plot_robot(robot, "unused.svg"),
}
OF_A_RESULT: dict[str, Call] = {
    "report_of": lambda robot: report_of(RESULT, robot),
    "View": lambda robot: View(RESULT, robot),
}


@pytest.mark.parametrize("call", (CALLS | OF_A_RESULT).values(), ids=[*CALLS, *OF_A_RESULT])
def test_a_value_that_is_no_robot_is_refused_by_its_type(call: Call) -> None:
    refused(eomgen.InputError, r"robot: got a value of type complex; allowed: a Robot .*one_link", call, 3j)


@pytest.mark.parametrize("call", (CALLS | OF_A_RESULT).values(), ids=[*CALLS, *OF_A_RESULT])
def test_a_name_is_that_of_a_robot(call: Call) -> None:
    refused(eomgen.DescriptionError, "there is no robot 'one_lnik'; did you mean 'one_link'", call, "one_lnik")


@pytest.mark.parametrize("kind", [str, Path])
@pytest.mark.parametrize("call", (CALLS | OF_A_RESULT).values(), ids=[*CALLS, *OF_A_RESULT])
def test_a_path_is_read(call: Call, kind: type, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text("name = 3", encoding="ascii")
    refused(eomgen.DescriptionError, r"arm\.toml:1:8: name", call, kind(path))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A description in a file: that of a robot with one coordinate."""
    target = tmp_path / "pendulum.toml"
    target.write_text(
        """
        name = "pendulum"
        [[links]]
        name = "rod"
        mass = 1.0
        com = [0.5, 0.0, 0.0]
        inertia = { xx = 0.0, yy = 0.1, zz = 0.1 }
        [[joints]]
        name = "hinge"
        parent = "base"
        child = "rod"
        type = "revolute"
        """,
        encoding="ascii",
    )
    return target


def test_each_is_the_robot_itself(path: Path) -> None:
    robot = eomgen.load_robot("one_link")
    assert as_robot(robot) is robot
    assert as_robot("one_link") == robot
    assert as_robot(path) == as_robot(str(path)) == eomgen.load_robot(path)


@pytest.mark.parametrize("given", ["one_link", "path"])
def test_functions_do_for_a_name_or_a_path_what_they_do_for_the_robot(given: str, path: Path, tmp_path: Path) -> None:
    like: RobotLike = path if given == "path" else given
    robot = eomgen.load_robot(like)
    kernel = eomgen.build(like, kernels=("mass_matrix",), flags=("-O0",))
    assert kernel.coordinates == eomgen.build(robot, kernels=("mass_matrix",), flags=("-O0",)).coordinates
    package = eomgen.generate(like, str(tmp_path / "out"), ONE_LEVEL)
    assert json.loads((package / f"{robot.name}.json").read_text())["coordinates"] == list(kernel.coordinates)
    texts = [eomgen.export_mjcf(x, tmp_path / "arm.xml", step=1e-3).read_text() for x in (like, robot)]
    assert texts[0] == texts[1]


def test_an_analysis_takes_names() -> None:
    found = deflection("one_link")
    assert found.robot == "one_link"
    assert np.array_equal(found.q, deflection(eomgen.load_robot("one_link")).q)


def test_one_robot_is_nothing_to_compare() -> None:
    refused(eomgen.InputError, "robots: 1; allowed: two or more", compare, "one_link")


def test_no_function_of_the_facade_that_takes_a_robot_is_forgotten() -> None:
    for name in eomgen.__all__:
        value = getattr(eomgen, name)
        hints = getattr(value, "__annotations__", {})
        if callable(value) and not isinstance(value, type) and "robot" in hints:
            assert hints["robot"] == "RobotLike", name
            assert name in CALLS, name
