"""What single precision costs a robot: bounds hold beside independent dynamics, and errors come from what is named."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.samples.arithmetic import Arithmetic
from eomgen.errors import InputError, UnknownNameError
from eomgen.pipeline.single_precision import with_notes
from eomgen.pipeline.stages import Options, make_source
from eomgen.progress import no_report
from eomgen.robot.model import build_model
from eomgen.rounding import Float32Advice, Float32Errors, float32_advice, rounding_bound
from eomgen.rounding.whole import with_setup
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.geared_arms import two_link_arm
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

INVERSE = "inverse_dynamics"


@cache
def advice(robot: str, *kernels: str) -> Float32Advice:
    return float32_advice(robot, kernels)


def within_bounds(errors: Float32Errors) -> bool:
    """Whether no error was seen beyond its bound; double precision's own is in the margin."""
    return bool((errors.observed <= errors.bound + 1e-13 * errors.size).all())


@pytest.mark.parametrize("robot", ["one_link", "geared_arm"])
def test_observed_errors_are_within_bounds(robot: str) -> None:
    for kernel in (INVERSE, "mass_matrix", "energy", "kinematics"):
        errors = advice(robot, INVERSE, "mass_matrix", "energy", "kinematics").kernels[kernel]
        assert within_bounds(errors), kernel
        assert errors.observed.max() > 0.0


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 8, 200))
def test_observed_errors_of_random_robots_are_within_bounds(seed: int) -> None:
    robot = random_robot(seed)
    found = float32_advice(robot, (INVERSE, "mass_matrix", "bias_force"))
    for errors in found.kernels.values():
        assert within_bounds(errors), (seed, errors.kernel)
        assert sum(errors.sources.values()) == pytest.approx(1.0) or errors.worst is None


def test_single_precision_is_within_its_bound_beside_pinocchio() -> None:
    """Pinocchio computes with the numbers of the description; single precision rounds them, too."""
    robot = eomgen.load_robot("ur5")
    oracle, errors = PinocchioOracle(robot), advice("ur5", INVERSE).kernels[INVERSE]
    equations = derive_equations(build_model(robot), (INVERSE,), "float32")
    program = with_setup(equations.programs[INVERSE], equations.setup)
    rng, p = np.random.default_rng(1), np.array(list(equations.model.parameters.values()), np.float32)
    worst = np.zeros(6)
    for _ in range(50):
        q, v, a = (rng.uniform(-x, x, 6).astype(np.float32) for x in (3.0, 3.0, 10.0))
        inputs = {"q": q[:, None], "v": v[:, None], "a": a[:, None], "p": p[:, None]}
        single = Arithmetic("float32").run(program, inputs, rounding=False)["out"][:, 0]
        exact = oracle.inverse_dynamics(*(x.astype(np.float64) for x in (q, v, a)))
        worst = np.maximum(worst, np.abs(single - exact))
    assert (worst <= errors.bound + 1e-10).all()
    assert (worst > 1e-3 * errors.bound).all()


def test_a_stiff_gear_is_named_and_its_part_grows_with_it() -> None:
    """A deflection is a small difference of large angles: the spring makes a torque of its rounding."""
    bounds = []
    for stiffness in (1e3, 1e5):
        found = float32_advice(two_link_arm((2000.0, stiffness)), (INVERSE,)).kernels[INVERSE]
        bounds.append(found.bound[found.outputs.index("joint2.gamma")])
        parts = {name: part for name, part in found.sources.items() if "joints.joint2.motor.stiffness" in name}
    assert bounds[1] > 30.0 * bounds[0]
    assert found.worst in ("joint2.gamma", "joint2.motor")
    assert sum(parts.values()) > 0.5
    assert sum(found.sources.values()) == pytest.approx(1.0)
    assert next(iter(found.sources)) in parts


def test_deflections_are_ranges_of_gears() -> None:
    """A bound over all angles of a motor alone is of deflections that no gear has."""
    arm = two_link_arm()
    bounds = [
        rounding_bound(arm, INVERSE, ranges, dtype="float32").bound[2]
        for ranges in ({"deflection:joint2": (-1e-3, 1e-3)}, {}, {"deflection:joint2": (-10.0, 10.0)})
    ]
    assert bounds[0] < bounds[1] < 0.3 * bounds[2]
    found = rounding_bound(arm, INVERSE, {"deflection:joint2": (-1e-3, 1e-3)})
    assert found.ranges["deflection:joint2"] == (-1e-3, 1e-3)
    assert found.ranges["deflection:joint1"] == (-0.01, 0.01)
    everywhere = rounding_bound(arm, INVERSE, {"q": (-1.5, 1.5)})
    assert everywhere.ranges["joint1.gamma"] == (-1.5, 1.5)
    assert everywhere.ranges["joint1.motor"][1] == pytest.approx(151.0)
    assert everywhere.size.min() > 0.0
    assert found.size[2] < 0.95 * rounding_bound(arm, INVERSE).size[2]
    with pytest.raises(UnknownNameError, match="range of 'deflection:joint3'"):
        rounding_bound(arm, INVERSE, {"deflection:joint3": (0.0, 1.0)})


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_deflected_gears_are_within_their_bounds(sense: float) -> None:
    """Whichever way the motor turns, at the ends of the deflection as well."""
    arm = two_link_arm()
    joints = [replace(x, motor=replace(x.motor, ratio=sense * x.motor.ratio)) for x in arm.joints if x.motor]
    errors = float32_advice(replace(arm, joints=tuple(joints)), (INVERSE,)).kernels[INVERSE]
    assert within_bounds(errors)
    assert (errors.bound < 4.0 * errors.observed).all()


def test_numbers_that_single_precision_holds_cost_less() -> None:
    """A parameter that float32 holds exactly adds nothing by itself."""
    robot = two_link_arm()
    held = robot.with_value("links.link1.mass", 4.0)
    other = robot.with_value("links.link1.mass", 4.0 + 2.0**-23)
    tunable = [replace(x, tunable=("links.link1.mass",)) for x in (held, other)]
    first, second = (float32_advice(x, ("mass_matrix",)).kernels["mass_matrix"].bound[0] for x in tunable)
    assert 0.0 < first < second


def test_kernels_that_solve_are_observed_alone() -> None:
    errors = advice("one_link", "forward_dynamics").kernels["forward_dynamics"]
    assert np.isnan(errors.bound).all()
    assert 0.0 < errors.relative_observed.max() < 1e-4
    assert errors.units == ("m/s^2", "rad/s^2")
    assert "bound" not in errors.summary()


def test_what_is_composed_is_left_out_by_name() -> None:
    found = advice("four_bar", INVERSE, "tree_inverse_dynamics")
    assert found.left_out == {INVERSE: "composed of 'constrained_drives'"}
    assert set(found.kernels) == {"tree_inverse_dynamics"}


def test_wrong_names_and_errors_are_refused() -> None:
    refused(UnknownNameError, "kernel 'torque' is not one of this robot's", float32_advice, "one_link", ("torque",))
    refused(UnknownNameError, r"range of 'joint9\.gamma'", float32_advice, "one_link", (), {"joint9.gamma": (0.0, 1.0)})
    for within in (1e-9, 2.0, True, "1e-6"):
        with pytest.raises(InputError, match=r"within: .*allowed: an error by the size of results, from 1\.2e-07 to 1"):
            float32_advice("one_link", (), within=within)  # type: ignore[arg-type]


def test_results_say_themselves() -> None:
    found = advice("one_link", INVERSE, "mass_matrix")
    values = json.loads(json.dumps(found.as_dict()))
    outputs = values["kernels"][INVERSE]["outputs"]
    assert outputs["joint1.gamma"]["unit"] == "N m"
    assert outputs["joint1.x"]["unit"] == "N"
    assert outputs["joint1.gamma"]["bound"] >= outputs["joint1.gamma"]["observed"] > 0.0
    assert "joint1.gamma is off by at most" in str(found)
    lines = "\n".join(found.lines())
    assert "joint1.gamma, joint1.gamma, kg m^2" in lines
    assert "comes from:" in lines


def test_a_package_says_what_single_precision_costs() -> None:
    robot = eomgen.load_robot("one_link")
    source = make_source(robot, Options((INVERSE,), "float32"))
    files = {"one_link.h": source.header.encode(), "one_link.json": source.meta.encode(), "one_link.c": b""}
    noted = with_notes(robot, (INVERSE,), files, no_report)
    about = json.loads(noted["one_link.json"])["float32"]
    facts = advice("one_link", INVERSE).kernels[INVERSE].facts_of_worst()
    assert about == {INVERSE: json.loads(json.dumps(facts))}
    assert about[INVERSE]["observed"] <= about[INVERSE]["bound"]
    comment = noted["one_link.h"].decode().split("*/")[0]
    assert f" * {advice('one_link', INVERSE).kernels[INVERSE].summary()}\n" in comment
    assert json.loads(files["one_link.json"]).items() < json.loads(noted["one_link.json"]).items()
    assert noted["one_link.c"] == b""
