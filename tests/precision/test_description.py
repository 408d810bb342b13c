"""Errors against the description at 60 digits are within the bound and 1e-12 relative, of compiled code as well."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.description.load import robot_from_toml
from eomgen.precision import rounding_bound
from eomgen.precision.programs import output_values, with_setup
from eomgen.precision.ranges import chosen_ranges, deflections, random_states
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.long_dynamics import evaluated, mp
from tests.support.builds import Build
from tests.support.geared_arms import two_link_arm
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import random_robot, seeds

pytestmark = pytest.mark.quick

GENERATION = 1e-12  # relative, what rounding at generation adds at most
FUNCTIONS = ("inverse_dynamics", "mass_matrix", "gravity")
STATES = 4
MERGED = f"""
name = "merged"
{link_table("hub", 1e-3, inertia=(1e-9, 1e-9, 1e-9))}
{link_table("tip", 1.0, (-31.99, 0.0, 0.0), (1e-5, 1e-5, 1e-5))}
{joint_table("hinge", "base", "hub", "revolute")}
{joint_table("weld", "hub", "tip", "fixed")}
placement = {{ xyz = [32.0, 0.0, 0.0] }}
"""
FAR = f"""
name = "far"
{link_table("hub", 1.0, (0.0, 0.1, 0.0), (1e-3, 1e-3, 1e-3))}
{link_table("tip", 1.0, (-50.003, 40.0, 0.7), (1e-4, 1e-4, 1e-4))}
{link_table("load", 2.0, (50.0, -40.1, 0.3), (1e-4, 1e-4, 1e-4))}
{joint_table("hinge", "base", "hub", "revolute")}
{joint_table("elbow", "hub", "tip", "revolute")}
placement = {{ xyz = [50.0, -40.0, 0.0], rpy = [0.3, 0.2, 0.1] }}
{joint_table("slide", "tip", "load", "prismatic")}
placement = {{ xyz = [-100.0, 80.0, 0.0], rpy = [0.3, 1.2, 0.1] }}
"""


@cache
def robot_of(name: str) -> Robot:
    made = {"merged": MERGED, "far": FAR}
    if name in made:
        return robot_from_toml(made[name])
    if name == "tree":
        return random_robot(3, joints=(4, 4), tree=True)
    return two_link_arm() if name == "two_link_arm" else eomgen.load_robot(name)


def beyond(robot: Robot, kernel: str, compiled: eomgen.Kernel | None = None, vanishing: float = GENERATION) -> float:
    """Return the largest error beyond the bound, by the output's size.

    An output below the share ``vanishing`` of the largest one counts by that: rotations cancel in it.
    """
    model = build_model(robot)
    equations, reads = derive_equations(model, (kernel,)), KERNELS[kernel].reads
    states = random_states(chosen_ranges(model, reads, {}, "float64"), deflections(model, {}), STATES)
    bound = rounding_bound(robot, kernel).bound
    assert np.isfinite(bound).all()
    if compiled is None:
        program = with_setup(equations.programs[kernel], equations.setup)
        computed = output_values(program, states, "float64", len(bound))
    else:
        arrays = [np.ascontiguousarray(np.transpose(states[name])) for name in reads]
        computed = getattr(compiled, kernel)(*arrays).reshape(STATES, -1).T
    worst = -np.inf
    for state in range(STATES):
        exact = evaluated(robot, kernel, {name: [row[state] for row in rows] for name, rows in states.items()})
        size = np.array([abs(float(x)) for x in exact])
        size[size < vanishing * size.max()] = size.max()
        error = [float(abs(mp.mpf(float(x)) - y)) for x, y in zip(computed[:, state], exact, strict=True)]
        worst = max(worst, float(((error - bound) / size).max()))
    return worst


ROBOTS = ("one_link", "ur5", "two_link_arm", "tree", "far")


@pytest.mark.parametrize("kernel", FUNCTIONS)
@pytest.mark.parametrize("name", [*ROBOTS, "puma560_elastic"])
def test_programs_are_within_the_bound_and_1e_12_of_the_description(name: str, kernel: str) -> None:
    assert beyond(robot_of(name), kernel) <= GENERATION


@pytest.mark.parametrize("kernel", FUNCTIONS[:2])
def test_merged_links_are_within_the_bound_and_1e_12_of_the_description(kernel: str) -> None:
    assert beyond(robot_of("merged"), kernel) <= GENERATION


@pytest.mark.parametrize("name", ["one_link", "far"])
def test_compiled_code_is_within_the_bound_and_1e_12_of_the_description(name: str, built: Build) -> None:
    kernel = built(robot_of(name), *FUNCTIONS)
    assert max(beyond(robot_of(name), function, kernel) for function in FUNCTIONS) <= GENERATION


@pytest.mark.soak
@pytest.mark.parametrize("name", ["ur5", "two_link_arm", "tree", "puma560_elastic"])
def test_compiled_code_of_more_robots_is_within_the_bound(name: str, built: Build) -> None:
    kernel = built(robot_of(name), *FUNCTIONS)
    assert max(beyond(robot_of(name), function, kernel) for function in FUNCTIONS) <= GENERATION


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 10, 200))
def test_random_trees_are_within_the_bound_and_1e_12_of_the_description(seed: int) -> None:
    """Directions that are nearly normal to each other leave some outputs a thousand times smaller than their terms."""
    robot = random_robot(seed, tree=True)
    assert max(beyond(robot, function, vanishing=1e-3) for function in FUNCTIONS) <= GENERATION


def test_a_bound_that_leaves_out_rounding_or_a_wrong_mass_is_noticed() -> None:
    robot = robot_of("ur5")
    states = random_states(chosen_ranges(build_model(robot), "qva", {}, "float64"), (), 1)
    arrays = {name: [row[0] for row in rows] for name, rows in states.items()}
    heavier = robot.with_value("links.link6.mass", robot.links[-1].mass * (1.0 + 1e-10))
    one, other = (evaluated(x, "inverse_dynamics", arrays) for x in (robot, heavier))
    bound = rounding_bound(robot, "inverse_dynamics").bound
    apart = [float(abs(x - y)) for x, y in zip(one, other, strict=True)]
    assert (apart > bound + GENERATION * np.abs([float(x) for x in one])).any()
