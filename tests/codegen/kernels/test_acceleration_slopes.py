"""Derivatives of accelerations: both ways to write them, by complex steps of the accelerations' program, and counts."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from benchmarks.run import six
from eomgen.codegen.c.operation_counts import operations
from eomgen.codegen.kernels.acceleration_slopes import BY_FACTORS, BY_VALUES
from eomgen.codegen.kernels.equations import derive_cheapest, derive_equations
from eomgen.codegen.program.ir import evaluate
from eomgen.errors import EomgenWarning
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Placement, Robot
from tests.oracles.complex_step import complex_jacobian
from tests.oracles.force_laws import with_laws
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, State, random_robot, random_state, seeds, some_prescribed, with_offsets
from tests.support.random_springs import with_springs

NAME = "forward_dynamics_jacobian"


def by_complex_steps(robot: Robot, s: State) -> Array:
    """Derivatives of the accelerations' program by q, by v and z, and by u, (3, n + m, n + m)."""
    arrays, n = {x: getattr(s, x) for x in "qvzu"}, s.q.size
    blocks = np.zeros((3, n + s.z.size, n + s.z.size))  # no column of u, nor of q, is one of an internal state
    for block, labels in zip(blocks, ("q", "vz", "u"), strict=True):
        found = [complex_jacobian(robot, "forward_dynamics", arrays, x) for x in labels if arrays[x].size]
        block[:, : sum(x.shape[1] for x in found)] = np.hstack(found)
    return blocks


def by_program(robot: Robot, s: State, way: str) -> Array:
    model = build_model(robot)
    program, n = derive_cheapest(model, NAME, way)[0], model.size
    values = {x: [float(y) for y in getattr(s, x)] for x in "qvzu"}
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
    condition = np.linalg.cond(expected[2][: s.q.size, : s.q.size])
    allowed = max(1e-11, 100.0 * np.finfo(float).eps * condition)
    for block, wanted in zip(found, expected, strict=True):
        assert np.abs(block - wanted).max() <= allowed * np.abs(wanted).max()


@pytest.mark.parametrize("seed", seeds(300, 1, 12))
def test_compiled(seed: int, built: Build) -> None:
    """One state, many of them, and the other type of numbers; the inverse mass matrix is symmetric to the bit."""
    robot = free_bodies_of(seed)
    kernel, s = built(robot, NAME), random_state(robot, seed)
    n, z = s.q.size, {"z": s.z} if s.z.size else {}
    expected = by_complex_steps(robot, s)[:, :n, :n]
    single = kernel.forward_dynamics_jacobian(s.q, s.v, s.u, **z)
    allowed = max(1e-11, 100.0 * np.finfo(float).eps * np.linalg.cond(expected[2]))
    many = kernel.forward_dynamics_jacobian(np.tile(s.q, (9, 1)), s.v, s.u, **z)
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


DATA = Path(__file__).parents[3] / "benchmarks" / "data"
COUNTED = (
    "inverse_dynamics",
    "mass_matrix",
    "forward_dynamics",
    "residual",
    "residual_jacobian",
    "coriolis_matrix",
    "generalized_force",
    "energy",
)


def equal_links(count: int) -> Robot:
    """A chain of elastic 6-DOF joints, every second one turned by a right angle; rotors on the driven angles."""
    links, joints = [], []
    for i in range(1, count + 1):
        links.append(Link(f"link{i}", 2.0, (0.1, 0.02, 0.03), (0.02, 0.03, 0.025, 0.001, 0.002, 0.003)))
        coordinates = {name: Coordinate(stiffness=1e5, damping=50.0) for name in COORDINATES[:5]}
        coordinates["gamma"] = Coordinate(damping=1.0)
        placement = Placement.from_rpy((0.3, 0.0, 0.1), (np.pi / 2 if i % 2 else -np.pi / 2, 0.0, 0.0))
        parent = f"link{i - 1}" if i > 1 else "base"
        joints.append(Joint(f"joint{i}", parent, f"link{i}", "revolute", placement, coordinates=coordinates))
    return Robot(f"equal{count}", (0.0, 0.0, -9.81), tuple(links), tuple(joints))


def counts(robot: Robot, kernels: tuple[str, ...]) -> dict[str, np.ndarray]:
    """(mul, add, div) of each kernel."""
    programs = derive_equations(build_model(robot), kernels).programs
    return {k: np.array([programs[k].count()[x] for x in ("mul", "add", "div")]) for k in kernels}


@pytest.mark.soak
def test_operations_grow_linearly() -> None:
    """Every two further links cost the same, to the operation, at both ends of a long chain."""
    kernels = ("residual", "forward_dynamics", "inverse_dynamics", "generalized_force")
    found = {count: counts(equal_links(count), kernels) for count in (4, 6, 8, 18, 20)}
    for kernel in kernels:
        step = found[6][kernel] - found[4][kernel]
        assert np.array_equal(found[8][kernel] - found[6][kernel], step), kernel
        assert np.array_equal(found[20][kernel] - found[18][kernel], step), kernel
        assert np.array_equal(found[20][kernel] - found[8][kernel], 6 * step), kernel


def test_a_step_of_a_rollout_grows_linearly() -> None:
    found = {}
    for count in (4, 6, 8):
        program = derive_equations(build_model(equal_links(count)), ("rollout",)).programs["implicit_step"]
        found[count] = program.count()
    assert {key: found[8][key] - found[6][key] for key in found[6]} == {
        key: found[6][key] - found[4][key] for key in found[4]
    }


@pytest.mark.soak
def test_a_long_chain(built: Build) -> None:
    """12 links, 72 coordinates: forward dynamics undoes inverse dynamics."""
    robot = equal_links(12)
    kernel = built(robot, "inverse_dynamics", "forward_dynamics", "residual")
    rng = np.random.default_rng(3)
    q, v, a = (scale * rng.standard_normal(kernel.n) for scale in (0.1, 0.5, 1.0))
    u = kernel.inverse_dynamics(q, v, a)
    assert np.abs(kernel.forward_dynamics(q, v, u) - a).max() < 1e-7
    assert np.abs(kernel.residual(q, v, a, u)).max() < 1e-9 * np.abs(u).max()


@pytest.mark.soak
def test_a_hundred_links() -> None:
    """600 coordinates: generated, compiled and right."""
    kernel = eomgen.build(equal_links(100), kernels=("residual", "forward_dynamics"))
    rng = np.random.default_rng(3)
    q, v, u = (scale * rng.standard_normal(kernel.n) for scale in (0.01, 0.1, 1.0))
    a = kernel.forward_dynamics(q, v, u)
    assert np.abs(kernel.residual(q, v, a, u)).max() < 1e-7 * np.abs(a).max()


def urdf(name: str, *, all_six: bool = False) -> Robot:
    robot = eomgen.load_robot(str(DATA / f"{name}.urdf"))
    return six(robot) if all_six else robot


def example(path: str) -> Robot:
    found = [urdf for urdf in example_urdfs() if urdf.as_posix().endswith(path)]
    if not found:
        pytest.skip("the wheel example-robot-data is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return eomgen.load_robot(found[0], inertia="warn", urdf_mimic=False)


SCALED = {
    "puma560_generic": lambda: urdf("puma560_generic"),
    "ur5_generic": lambda: urdf("ur5_generic"),
    "puma560_generic x6": lambda: urdf("puma560_generic", all_six=True),
    "puma560_elastic": lambda: eomgen.load_robot("puma560_elastic"),
    "ur5": lambda: eomgen.load_robot("ur5"),
    "UR5 URDF": lambda: example("ur_description/urdf/ur5_robot.urdf"),
    "Panda URDF": lambda: example("panda_description/urdf/panda.urdf"),
    "Talos reduced": lambda: example("talos_data/robots/talos_reduced.urdf"),
}
PARAMETERS_QUICK = ("puma560_generic", "ur5", "UR5 URDF")


@pytest.mark.parametrize(
    "name", [name if name in PARAMETERS_QUICK else pytest.param(name, marks=pytest.mark.soak) for name in SCALED]
)
def test_parameters_cost_little(name: str) -> None:
    """Masses that stay parameters: at most 1.15 times the counts; frames that a description calls links aside."""
    robot = SCALED[name]()
    tunable = replace(robot, tunable=tuple(f"links.{link.name}.mass" for link in robot.links if link.mass > 0.0))
    folded, kept = counts(robot, COUNTED), counts(tunable, COUNTED)
    for kernel in COUNTED:
        assert kept[kernel].sum() <= 1.15 * folded[kernel].sum(), kernel
