"""Derivatives of accelerations: both ways to write them, by complex steps of the accelerations' program, and counts."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.acceleration_slopes import BY_FACTORS, BY_VALUES
from eomgen.codegen.kernels.equations import derive, derive_cheapest, derive_equations
from eomgen.codegen.kernels.operation_counts import operations
from eomgen.codegen.program.ir import evaluate
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.codegen.kernels.test_scale import equal_links, example, urdf
from tests.oracles.complex_step import COMPLEX
from tests.oracles.force_laws import with_laws
from tests.support.builds import Build
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, State, random_robot, random_state, seeds, some_prescribed, with_offsets
from tests.support.random_springs import with_springs

NAME = "forward_dynamics_jacobian"
STEP = 1e-30


def by_complex_steps(robot: Robot, s: State) -> Array:
    """Derivatives of the accelerations' program, (3, n, n), a column at a time."""
    model = build_model(robot)
    program, n = derive(model, "forward_dynamics"), model.size
    found = np.zeros((3, n, n))
    for matrix, label in enumerate("qvu"):
        for j in range(n):
            values = {x: [complex(y) for y in getattr(s, x)] for x in "qvu"}
            values["p"] = [complex(x) for x in model.parameters.values()] + [0j] * len(model.turning)
            values[label][j] += 1j * STEP
            out = evaluate(program, values, lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
            found[matrix, :, j] = [complex(out["out", i]).imag / STEP for i in range(n)]
    return found


def by_program(robot: Robot, s: State, way: str) -> Array:
    model = build_model(robot)
    program, n = derive_cheapest(model, NAME, way)[0], model.size
    values = {x: [float(y) for y in getattr(s, x)] for x in "qvu"}
    values["p"] = [*model.parameters.values(), *[0.0] * len(model.turning)]
    calls = {"sqrt": math.sqrt, "exp": math.exp, "log": math.log, "atan2": math.atan2}
    out = evaluate(program, values, calls=calls)
    return np.array([float(out["out", i]) for i in range(3 * n * n)]).reshape(3, n, n)


def robot_of(seed: int) -> Robot:
    """In turns a tree with offsets, with laws and springs between points, with motors, and with given motions."""
    if seed % 4 == 2:
        return geared_robot(seed, joints=(2, 3))
    robot = random_robot(seed, joints=(2, 3), max_size=9, tree=True, rods=False)
    if seed % 4 == 3:
        return some_prescribed(robot, seed)
    if seed % 4 == 0:
        return with_offsets(robot, seed)
    return with_springs(with_laws(robot, seed), seed)


def free_bodies_of(seed: int) -> Robot:
    """Joints with six coordinates alone, and with others behind or in front of them; armatures and laws."""
    types = ("free",) if seed % 3 else ("free", "free", "revolute")
    robot = random_robot(seed, joints=(2, 3), types=types, tree=seed % 2 == 0, rods=False)
    return with_springs(with_laws(robot, seed), seed) if seed % 4 == 3 else robot


@pytest.mark.parametrize("way", [BY_FACTORS, BY_VALUES])
@pytest.mark.parametrize("seed", seeds(0, 1, 80))
def test_both_ways_are_derivatives_of_the_accelerations(seed: int, way: str) -> None:
    robot = (robot_of, free_bodies_of)[seed % 2](seed // 2)
    s = motor_state(robot, seed)
    found, expected = by_program(robot, s, way), by_complex_steps(robot, s)
    condition = np.linalg.cond(expected[2])
    allowed = max(1e-11, 100.0 * np.finfo(float).eps * condition)
    for block, wanted in zip(found, expected, strict=True):
        assert np.abs(block - wanted).max() <= allowed * np.abs(wanted).max()


@pytest.mark.parametrize("seed", seeds(300, 1, 12))
def test_compiled(seed: int, built: Build) -> None:
    """One state, many of them, and the other type of numbers; the inverse mass matrix is symmetric to the bit."""
    robot = free_bodies_of(seed)
    kernel, s = built(robot, NAME), random_state(robot, seed)
    expected = by_complex_steps(robot, s)
    single = kernel.forward_dynamics_jacobian(s.q, s.v, s.u)
    allowed = max(1e-11, 100.0 * np.finfo(float).eps * np.linalg.cond(expected[2]))
    many = kernel.forward_dynamics_jacobian(np.tile(s.q, (9, 1)), s.v, s.u)
    for block, batch, wanted in zip(single, many, expected, strict=True):
        assert np.abs(block - wanted).max() <= allowed * np.abs(wanted).max()
        assert np.abs(batch - wanted).max() <= allowed * np.abs(wanted).max()
    assert np.array_equal(single[2], single[2].T)


def test_what_free_bodies_do_not_know_of_each_other() -> None:
    """Drives reach the joints next to theirs, and deviations upstream only those that turn what follows."""
    model = build_model(equal_links(5))
    program, n = derive_equations(model, (NAME,)).programs[NAME], model.size
    at = [program.outputs["out", i] for i in range(3 * n * n)]
    found = np.array([program.instructions[i].op != "const" for i in at]).reshape(3, 5, 6, 5, 6)
    far = [(k, j) for k in range(5) for j in range(5) if abs(k - j) > 1]
    assert not any(found[2, k, :, j].any() for k, j in far)
    assert not any(found[0, k, :, j, :3].any() for k, j in far)
    assert not any(found[1, k, :, j].any() for k, j in far if k < j)
    assert all(found[0, k, :, j, 3:].any() for k, j in far if k > j)


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("ur5", (1440, 1220, 4)),
        ("UR5 URDF", (1276, 1097, 5)),
        ("elastic", (20800, 16200, 18)),
        pytest.param("x6", (7700, 6000, 6), marks=pytest.mark.soak),
        ("Panda URDF", (3690, 3380, 7)),
        pytest.param("Talos reduced", (17200, 14900, 27), marks=pytest.mark.soak),
    ],
)
def test_operations_of_derivatives_hold_their_line(name: str, most: tuple[int, int, int]) -> None:
    """Multiplications, additions, divisions: one reciprocal per pivot, and no solution with dense columns."""
    robots = {
        "ur5": lambda: eomgen.load_robot("ur5"),
        "UR5 URDF": lambda: example("ur_description/urdf/ur5_robot.urdf"),
        "elastic": lambda: eomgen.load_robot("puma560_elastic"),
        "x6": lambda: urdf("puma560_generic", all_six=True),
        "Panda URDF": lambda: example("panda_description/urdf/panda.urdf"),
        "Talos reduced": lambda: example("talos_data/robots/talos_reduced.urdf"),
    }
    found = operations(derive_equations(build_model(robots[name]()), (NAME,)))[NAME]
    assert all(found[key] <= limit for key, limit in zip(("mul", "add", "div"), most, strict=True)), found
