"""Derivatives of the dynamics: against Pinocchio's, against complex steps of the program, and by their own laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels import acceleration_slopes
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.solve.factorised import solve_operations
from eomgen.errors import ArrayError, SingularError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Robot
from tests.oracles.complex_step import complex_steps
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.closeness import distance
from tests.support.optional import needs
from tests.support.random_robots import Array, State, random_robot, random_state, seeds, some_prescribed
from tests.support.refusals import refused

pin = needs("pinocchio")


TYPES = ("revolute", "prismatic", "fixed", "free")
JACOBIANS = ("residual_jacobian", "forward_dynamics_jacobian")


def by_pinocchio(robot: Robot, s: State) -> tuple[Array, Array, Array]:
    oracle = PinocchioOracle(robot)
    dq, dv, _ = pin.computeRNEADerivatives(oracle.model, oracle.data, s.q, s.v, s.a)
    return (
        np.array(dq) + np.diag(oracle.stiffness),
        np.array(dv) + np.diag(oracle.damping),
        oracle.mass_matrix(s.q),
    )


@pytest.mark.parametrize("seed", [*seeds(900, 1, 16), pytest.param(None, marks=pytest.mark.soak, id="elastic arm")])
def test_residual_jacobian_is_pinocchios(seed: int | None, built: Build) -> None:
    """Of random robots, and of 36 coordinates with springs, dampers and armatures."""
    if seed is None:
        robot, states = eomgen.load_robot("puma560_elastic"), range(1, 2)
    else:
        robot, states = random_robot(seed, joints=(1, 5), tree=seed % 2 == 0, types=TYPES), range(seed, seed + 3)
    kernel = built(robot, "residual_jacobian")
    for s in (random_state(robot, state) for state in states):
        for block, expected in zip(kernel.residual_jacobian(s.q, s.v, s.a), by_pinocchio(robot, s), strict=True):
            assert distance(block, expected) < 1e-11


@pytest.mark.parametrize("seed", seeds(920, 1, 8))
def test_residual_jacobian_is_that_of_the_residual(seed: int, built: Build) -> None:
    robot = random_robot(seed, joints=(1, 3), tree=seed % 2 == 0, types=TYPES)
    kernel, s = built(robot, "residual_jacobian"), random_state(robot, seed)
    for block, label in zip(kernel.residual_jacobian(s.q, s.v, s.a), "qva", strict=True):
        assert distance(block, complex_steps(robot, s, label)) < 1e-12


@pytest.mark.parametrize("seed", seeds(930, 1, 8))
def test_by_velocity_is_twice_the_coriolis_matrix(seed: int, built: Build) -> None:
    """The bias is a quadratic form of v with the Christoffel symbols, so that its derivative is 2 C."""
    robot = random_robot(seed, joints=(2, 4), tree=seed % 2 == 0, types=TYPES, forces=False)
    kernel, s = built(robot, "residual_jacobian", "coriolis_matrix"), random_state(robot, seed)
    _, by_v, _ = kernel.residual_jacobian(s.q, s.v, s.a)
    assert distance(by_v, 2.0 * kernel.coriolis_matrix(s.q, s.v)) < 1e-11


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(940, 1, 16))
def test_forward_dynamics_jacobian_is_pinocchios(seed: int, built: Build) -> None:
    """Against the articulated body algorithm's; springs and dampers by the chain rule."""
    robot = random_robot(seed, joints=(1, 5), tree=seed % 2 == 0, types=TYPES)
    kernel, oracle, s = built(robot, "forward_dynamics_jacobian"), PinocchioOracle(robot), random_state(robot, seed)
    oracle.model.armature = oracle.armature
    drive = s.u - oracle.stiffness * s.q - oracle.damping * s.v
    found = pin.computeABADerivatives(oracle.model, oracle.data, s.q, s.v, drive)
    by_q, by_v, inverse = (np.array(block) for block in found)
    inverse = np.triu(inverse) + np.triu(inverse, 1).T
    expected = (by_q - inverse * oracle.stiffness, by_v - inverse * oracle.damping, inverse)
    allowed = max(1e-11, 100 * np.finfo(float).eps * np.linalg.cond(oracle.mass_matrix(s.q)))
    for block, wanted in zip(kernel.forward_dynamics_jacobian(s.q, s.v, s.u), expected, strict=True):
        assert distance(block, wanted) < allowed


def test_zero_blocks_are_no_part_of_the_program() -> None:
    """Two branches know nothing of one another, and the base's translations move nothing's force."""
    links = [Link(name, 1.0, (0.1, 0.2, 0.3), (1.0, 1.1, 1.2, 0.0, 0.0, 0.0)) for name in "abc"]
    free = {name: Coordinate() for name in COORDINATES}
    joints = [
        Joint("root", "base", "a", "free", coordinates=free),
        Joint("left", "a", "b", "revolute", coordinates={"gamma": Coordinate()}),
        Joint("right", "a", "c", "revolute", coordinates={"gamma": Coordinate()}),
    ]
    robot = Robot("branches", (0.0, 0.0, -9.81), tuple(links), tuple(joints), ())
    program = derive(build_model(robot), "residual_jacobian")
    n = 8
    written = (key for key, at in program.outputs.items() if program.instructions[at].op != "const")
    entries = {divmod(index, n * n) for _, index in written}
    where = {(block, *divmod(rest, n)) for block, rest in entries}
    assert not any({row, column} == {6, 7} for _, row, column in where)
    assert not any(column < 3 for block, _, column in where if block < 2)  # translations of the base


@pytest.mark.soak
@pytest.mark.parametrize("name", JACOBIANS)
def test_batches_and_out(name: str, built: Build) -> None:
    robot = random_robot(970, joints=(3, 3), types=TYPES)
    kernel = built(robot, *JACOBIANS)
    states = [random_state(robot, seed) for seed in range(11)]
    q, v, last = (np.array([getattr(s, x) for s in states]) for x in ("q", "v", "a"))
    call = getattr(kernel, name)
    batch = call(q, v, last)
    assert [block.shape for block in batch] == [(11, kernel.n, kernel.n)] * 3
    for i in range(11):
        for many, one in zip(batch, call(q[i], v[i], last[i]), strict=True):
            assert distance(many[i], one) < 1e-10
    out = np.empty((11, 3, kernel.n, kernel.n))
    for block, expected in zip(call(q, v, last, out=out), batch, strict=True):
        assert np.shares_memory(block, out)
        assert np.array_equal(block, expected)


def test_of_stiffness_that_is_changed(built: Build) -> None:
    robot = random_robot(974, joints=(2, 2))
    name, given = next(
        (f"{joint.name}.{key}", c) for joint in robot.joints for key, c in joint.coordinates.items() if c.stiffness
    )
    kernel, s = built(robot, "residual_jacobian"), random_state(robot, 1)
    i = kernel.coordinates.index(name)
    before = kernel.residual_jacobian(s.q, s.v, s.a)[0][i, i]
    kernel.parameters[f"joints.{name}.stiffness"] = given.stiffness + 7.0
    assert kernel.residual_jacobian(s.q, s.v, s.a)[0][i, i] - before == pytest.approx(7.0)


def test_refusals(built: Build) -> None:
    robot = random_robot(976, joints=(1, 1), types=("free",), armature=False)
    kernel, s = built(robot, "euler_cosines", *JACOBIANS), random_state(robot, 1)
    refused(UnknownNameError, "mass_matrix", kernel.mass_matrix, s.q)
    refused(ArrayError, "a: expected", kernel.residual_jacobian, s.q, s.v, s.a[1:])
    q = s.q.copy()
    q[kernel.coordinates.index("joint1.beta")] = np.pi / 2
    refused(SingularError, r"forward_dynamics_jacobian.*joint1\.beta", kernel.forward_dynamics_jacobian, q, s.v, s.u)
    assert kernel.functions.euler_cosines(q) == pytest.approx([0.0], abs=1e-15)


@pytest.mark.soak
def test_loops_in_c_where_the_solution_is_long(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """They answer what the straight program does, and count what they do."""
    name = "forward_dynamics_jacobian"
    robot = replace(some_prescribed(random_robot(978, joints=(3, 3), tree=True), 978), name="straight")
    straight, s = built(robot, name), random_state(robot, 2)
    monkeypatch.setattr(acceleration_slopes, "MOST_PRODUCTS", -1)  # the cache does not know of it
    looped = built(replace(robot, name="looped"), "forward_dynamics", *JACOBIANS)
    for found, expected in zip(*(k.forward_dynamics_jacobian(s.q, s.v, s.u) for k in (looped, straight)), strict=True):
        assert distance(found, expected) < 1e-11
    parts = [looped.operations[part] for part in ("forward_dynamics", "residual_jacobian")]
    parts.append(solve_operations(build_model(robot)))
    total = looped.operations[name]
    assert total == {key: sum(part[key] for part in parts) for key in total}
    assert straight.operations[name]["div"] < total["div"]


def test_euler_cosines(built: Build) -> None:
    robot = random_robot(979, joints=(3, 3), types=("revolute", "free"))
    kernel, s = built(robot, "euler_cosines"), random_state(robot, 4)
    expected = []
    for joint in robot.joints:
        if joint.coordinates:
            whole = {"alpha", "beta", "gamma"} <= set(joint.coordinates)
            beta = s.q[kernel.coordinates.index(f"{joint.name}.beta")] if whole else 0.0
            expected.append(np.cos(beta))
    assert len(expected) == len(kernel.joints)
    assert np.allclose(kernel.functions.euler_cosines(s.q), expected, rtol=1e-15)
