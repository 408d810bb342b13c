"""Second derivatives of inverse dynamics beside Pinocchio's: its first derivatives differenced, and its tensors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.peers import pinocchio_peer
from benchmarks.peers.cases import Case, case
from benchmarks.peers.contender import MissingPeer
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.optional import needs
from tests.support.random_robots import Array, State, random_robot, random_state

pin = needs("pinocchio")


TOLERANCE = 1e-9  # of a block, relative, max-norm
BLOCKS = {"q-q": (0, 0), "q-v": (0, 1), "v-v": (1, 1), "a-q": (2, 0)}
STEP, PLACES, FACTORS = 1e-3, (-2, -1, 1, 2), (1 / 12, -8 / 12, 8 / 12, -1 / 12)  # of differences of fourth order


def ur5() -> Robot:
    return case("UR5").robot


def some_robot() -> Robot:
    """A tree of joints with several coordinates each, springs, dampers and armatures."""
    return random_robot(77, joints=(3, 3), max_coordinates=4, tree=True)


def ours(robot: Robot, s: State, weights: Array) -> Array:
    """(3 n, 3 n), by evaluation of the program that the C is written from."""
    model = build_model(robot)
    program = derive(model, "inverse_dynamics_hessian")
    given = {"q": s.q, "v": s.v, "a": s.a, "cotangent_vector": weights}
    values = {name: list(map(float, array)) for name, array in given.items()}
    values["p"] = list(model.parameters.values())
    found = evaluate(program, values, lambda x: (math.sin(x), math.cos(x)))
    return np.array([found["out", i] for i in range(9 * model.size**2)], float).reshape(3 * model.size, 3 * model.size)


def assert_blocks_agree(found: Array, expected: Array, n: int) -> None:
    for name, (i, j) in BLOCKS.items():
        one, other = (x[i * n : (i + 1) * n, j * n : (j + 1) * n] for x in (found, expected))
        scale = float(np.abs(other).max())
        assert scale > 1e-3, name
        assert float(np.abs(one - other).max()) <= TOLERANCE * scale, name
    assert np.array_equal(found, found.T)
    assert not found[n:, 2 * n :].any()  # torques are linear in accelerations, whose factor no rate changes


def by_differences(robot: Robot, s: State, weights: Array) -> Array:
    """From Pinocchio's first derivatives; rows by q, v, a, columns by q and v, then zeros but for those by symmetry."""
    oracle, n = PinocchioOracle(robot), len(s.q)

    def gradient(q: Array, v: Array) -> Array:
        dq, dv, _ = pin.computeRNEADerivatives(oracle.model, oracle.data, q, v, s.a)
        return np.concatenate([weights @ dq, weights @ dv, oracle.mass_matrix(q) @ weights])

    whole, where = np.zeros((3 * n, 3 * n)), np.concatenate([s.q, s.v])
    for column, unit in enumerate(np.eye(2 * n)):
        ends = (where + place * STEP * unit for place in PLACES)
        parts = [factor * gradient(x[:n], x[n:]) for factor, x in zip(FACTORS, ends, strict=True)]
        whole[:, column] = np.sum(parts, axis=0) / STEP
    whole[:, 2 * n :] = np.vstack([whole[2 * n :, : 2 * n].T, np.zeros((n, n))])
    return whole


@pytest.mark.parametrize("robot", [ur5(), some_robot()], ids=["ur5", "random"])
def test_second_derivatives_are_those_of_pinocchio(robot: Robot) -> None:
    s = random_state(robot, 5)
    weights = np.random.default_rng(6).uniform(-1.0, 1.0, len(s.q))
    assert_blocks_agree(ours(robot, s, weights), by_differences(robot, s, weights), len(s.q))


@pytest.mark.soak
@pytest.mark.parametrize("name", ["ur5", "random"])
def test_second_derivatives_are_pinocchios_tensors_contracted(name: str) -> None:
    """`ComputeRNEASecondOrderDerivatives` is in its C++ headers alone, which take a minute to compile."""
    robot = ur5() if name == "ur5" else random_robot(78, joints=(3, 3), max_coordinates=4, forces=False, armature=False)
    try:
        peer = pinocchio_peer.PinocchioPeer(Case("UR5", robot), parts=(1, 4), flags=("-O0",))
    except MissingPeer as error:
        pytest.skip(str(error))
    s = random_state(robot, 5)
    n, weights = len(s.q), np.random.default_rng(6).uniform(-1.0, 1.0, len(s.q))
    given = [x.reshape(1, n) for x in (s.q, s.v, s.a, weights)]
    for contender in peer.contenders("second_derivatives"):
        found = contender.results(given, 9 * n * n).reshape(3 * n, 3 * n)
        assert_blocks_agree(ours(robot, s, weights), found, n)
