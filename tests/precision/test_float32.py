"""Single precision: errors that are observed against double precision, and the operations that dominate them."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.errors import InputError, UnknownNameError
from eomgen.precision import Float32Advice, float32_advice, rounding_bound
from eomgen.precision.programs import output_values, with_setup
from eomgen.robot.model import build_model
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.geared_arms import two_link_arm
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

INVERSE = "inverse_dynamics"


@cache
def advice(robot: str, *kernels: str) -> Float32Advice:
    return float32_advice(robot, kernels)


@pytest.mark.parametrize("robot", ["one_link", "ur5", "geared_arm"])
def test_observed_errors_are_within_bounds(robot: str) -> None:
    """Where parameters are numbers that float32 holds, as gravity's are not, bounds are of the same errors."""
    held = eomgen.load_robot(robot)
    held = replace(held, gravity=tuple(float(np.float32(x)) for x in held.gravity))
    names = (INVERSE, "mass_matrix", "energy", "kinematics")
    for kernel, errors in float32_advice(held, names).kernels.items():
        bound = rounding_bound(held, kernel, dtype="float32").bound
        assert (errors.observed <= bound + 1e-13 * errors.size).all(), kernel
        assert errors.observed.max() > 0.0


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 8, 200))
def test_parts_of_random_robots_add_up(seed: int) -> None:
    for errors in float32_advice(random_robot(seed), (INVERSE, "mass_matrix", "bias_force")).kernels.values():
        assert errors.worst is None or not errors.dominant or sum(errors.dominant.values()) == pytest.approx(1.0)


def test_observed_errors_are_those_of_pinocchio() -> None:
    """Pinocchio computes with the numbers of the description; single precision rounds them, too."""
    robot = eomgen.load_robot("ur5")
    oracle, errors = PinocchioOracle(robot), advice("ur5", INVERSE).kernels[INVERSE]
    equations = derive_equations(build_model(robot), (INVERSE,), "float32")
    program = with_setup(equations.programs[INVERSE], equations.setup)
    rng, p = np.random.default_rng(1), np.array(list(equations.model.parameters.values()), np.float32)
    q, v, a = (rng.uniform(-x, x, (6, 256)).astype(np.float32) for x in (3.0, 3.0, 10.0))
    inputs = {"q": q, "v": v, "a": a, "p": np.repeat(p[:, None], 256, axis=1)}
    single = output_values(program, inputs, "float32", 6)
    exact = [oracle.inverse_dynamics(*(x[:, k].astype(np.float64) for x in (q, v, a))) for k in range(256)]
    worst = np.abs(single - np.transpose(exact)).max(axis=1)
    assert (worst < 3.0 * errors.observed).all()
    assert (worst > errors.observed / 3.0).all()


def test_errors_are_those_of_compiled_code(built: Build) -> None:
    robot, rng = eomgen.load_robot("one_link"), np.random.default_rng(3)
    errors = advice("one_link", INVERSE).kernels[INVERSE]
    single, double = (built(robot, INVERSE, dtype=dtype) for dtype in ("float32", "float64"))
    ends = {"q": (0.01, 3.0), "v": (0.1, 3.0), "a": (10.0, 10.0)}
    states = [(rng.uniform(-1.0, 1.0, (256, 2)) * most).astype(np.float32) for most in ends.values()]
    exact = double.inverse_dynamics(*(x.astype(np.float64) for x in states))
    worst = np.abs(single.inverse_dynamics(*states) - exact).max(axis=0)
    places = [errors.outputs.index(name) for name in single.coordinates]
    assert (worst < 3.0 * errors.observed[places]).all()
    assert (worst > errors.observed[places] / 3.0).all()


def test_a_stiff_gear_dominates_and_its_part_grows_with_it() -> None:
    """A deflection is a small difference of large angles: the spring makes a torque of its rounding."""
    seen = []
    for stiffness in (1e3, 1e5):
        found = float32_advice(two_link_arm((2000.0, stiffness)), (INVERSE,)).kernels[INVERSE]
        seen.append(found.observed[found.outputs.index("joint2.gamma")])
    assert seen[1] > 30.0 * seen[0]
    assert found.worst in ("joint2.gamma", "joint2.motor")
    parts = {name: part for name, part in found.dominant.items() if "joint2.motor" in name}
    assert sum(parts.values()) > 0.5
    assert next(iter(found.dominant)) in parts
    assert sum(found.dominant.values()) == pytest.approx(1.0)


def test_the_sine_of_a_pendulum_dominates_its_weight() -> None:
    found = advice("one_link", "gravity").kernels["gravity"]
    assert next(iter(found.dominant)) in ("sin of joint1.gamma", "cos of joint1.gamma")


def test_numbers_that_single_precision_holds_cost_less() -> None:
    """A parameter that float32 holds exactly adds nothing by itself."""
    robot = two_link_arm()
    held = robot.with_value("links.link1.mass", 4.0)
    other = robot.with_value("links.link1.mass", 4.0 + 0.99 * 2.0**-22)
    tunable = [replace(x, tunable=("links.link1.mass",)) for x in (held, other)]
    first, second = (float32_advice(x, ("mass_matrix",)).kernels["mass_matrix"].dominant for x in tunable)
    named = "parameter links.link1.mass"
    assert named not in first
    assert second[named] > 0.02


def test_ranges_are_the_callers() -> None:
    arm = two_link_arm()
    usual, wide = (float32_advice(arm, (INVERSE,), ranges).kernels[INVERSE] for ranges in ({}, {"q": (-3.0, 3.0)}))
    assert wide.size[2] > 10.0 * usual.size[2]


def test_kernels_that_solve_are_observed_too() -> None:
    errors = advice("one_link", "forward_dynamics").kernels["forward_dynamics"]
    assert 0.0 < errors.relative.max() < 1e-4
    assert errors.units == ("m/s^2", "rad/s^2")
    assert errors.dominant


def test_what_is_composed_is_left_out_by_name() -> None:
    found = advice("four_bar", INVERSE, "tree_inverse_dynamics")
    assert found.left_out == {INVERSE: "composed of 'constrained_drives'"}
    assert set(found.kernels) == {"tree_inverse_dynamics"}


def test_wrong_names_are_refused() -> None:
    refused(UnknownNameError, "kernel 'torque' is not one of this robot's", float32_advice, "one_link", ("torque",))
    refused(UnknownNameError, r"range of 'joint9\.gamma'", float32_advice, "one_link", (), {"joint9.gamma": (0.0, 1.0)})
    refused(InputError, "kernels", float32_advice, "one_link", "gravity")


def test_results_say_themselves() -> None:
    found = advice("one_link", INVERSE, "mass_matrix")
    values = json.loads(json.dumps(found.as_dict()))
    outputs = values["kernels"][INVERSE]["outputs"]
    assert outputs["joint1.gamma"]["unit"] == "N m"
    assert outputs["joint1.x"]["unit"] == "N"
    assert outputs["joint1.gamma"]["observed"] > 0.0
    assert "is off by" in str(found)
    lines = "\n".join(found.lines())
    assert "joint1.gamma, joint1.gamma, kg m^2" in lines
    assert "dominant operations of" in lines
