"""Several states at a time: the same numbers as one state at a time, also of programs that go part by part."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c import contexts, definitions, lanes, statements
from eomgen.description.load import robot_from_toml
from eomgen.errors import SingularError
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Robot
from tests.support.bending_robots import bent
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.processors import skip_without
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

STATES = 21  # no multiple of any number of lanes
AGREEMENT = 1e-13  # relative, max-norm: sine and cosine of vectors are not those of libm
TYPES = ("revolute", "prismatic", "fixed", "free")
READS = {
    "mass_matrix": "q",
    "bias_force": "qv",
    "generalized_force": "qv",
    "residual": "qvau",
    "inverse_dynamics": "qva",
    "forward_dynamics": "qvu",
    "coriolis_matrix": "qv",
    "christoffel": "q",
    "energy": "qv",
    "reactions": "qva",
}
KERNELS = (*READS, "kinematics")


def drawn(seed: int) -> Robot:
    """Return a random tree; links of every fourth bend."""
    robot = random_robot(seed, joints=(1, 4), tree=seed % 2 == 0, types=TYPES)
    return bent(robot, seed, (0, 1, 2)).robot if seed % 4 == 3 else robot


def random_states(robot: Robot, seed: int) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    states = [random_state(robot, rng) for _ in range(STATES)]
    return {name: np.array([getattr(state, name) for state in states]) for name in "qvau"}


def calls(kernel: eomgen.Kernel) -> dict[str, tuple[Callable[..., Any], str]]:
    """Every method that takes batches, and the names of its arrays."""
    found: dict[str, tuple[Callable[..., Any], str]] = {
        name: (getattr(kernel, name), reads) for name, reads in READS.items()
    }
    for call in (kernel.frame_pose, kernel.frame_jacobian):
        found[call.__name__] = (functools.partial(call, frame=kernel.frames[-1]), "q")
    return found


def distance(found: Array, expected: Array) -> Array:
    """Per state, relative and in the max-norm."""
    difference = np.abs(found - expected).reshape(len(found), -1).max(axis=1)
    return np.asarray(difference / np.maximum(np.abs(expected).reshape(len(found), -1).max(axis=1), 1e-300))


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(700, 1, 8))
@pytest.mark.parametrize("native", [False, True])
def test_a_batch_agrees_with_single_states(seed: int, native: bool) -> None:
    robot = drawn(seed)
    kernel = eomgen.build(robot, kernels=KERNELS, native=native, flags=("-O1",))
    states = random_states(robot, seed)
    for name, (call, reads) in calls(kernel).items():
        arrays = [states[x] for x in reads]
        batch = call(*arrays)
        single = np.array([call(*(x[i] for x in arrays)) for i in range(STATES)])
        allowed = np.full(STATES, AGREEMENT)
        if name == "forward_dynamics":
            allowed *= np.linalg.cond(kernel.mass_matrix(states["q"]))
        scale = 1.0
        if name in ("bias_force", "coriolis_matrix", "christoffel", "inverse_dynamics", "residual"):
            scale = 100.0  # terms that cancel
        assert (distance(batch, single) <= scale * allowed).all(), name


@pytest.mark.parametrize("seed", [700, pytest.param(703, marks=pytest.mark.soak)])
@pytest.mark.parametrize(
    "flags", [(), ("-DEOM_VECTOR_BYTES=0",), pytest.param(("-mavx2",), marks=pytest.mark.soak), ("-mavx512f",)]
)
def test_without_contraction_no_bit_differs(seed: int, flags: tuple[str, ...]) -> None:
    skip_without(flags)
    robot = drawn(seed)
    kernel, states = eomgen.build(robot, kernels=KERNELS, flags=(*flags, "-O1")), random_states(robot, seed)
    for name, (call, reads) in calls(kernel).items():
        arrays = [states[x] for x in reads]
        single = [call(*(x[i] for x in arrays)) for i in range(STATES)]
        assert np.array_equal(call(*arrays), single), name


@pytest.mark.parametrize("seed", soaked((701, 704), (701,)))
@pytest.mark.parametrize("native", soaked((False, True), (False,)))
def test_a_state_does_not_know_its_neighbours(seed: int, native: bool) -> None:
    """Any part of a batch, in any order, beside anything: the same bits."""
    robot = random_robot(seed, joints=(1, 4), tree=seed % 2 == 0, types=TYPES)
    kernel, states = eomgen.build(robot, kernels=KERNELS, native=native, flags=("-O1",)), random_states(robot, seed)
    states["q"][7] *= 1e6  # sines of large angles go another way
    order = np.random.default_rng(seed).permutation(STATES)
    for name, (call, reads) in calls(kernel).items():
        arrays = [states[x] for x in reads]
        whole = call(*arrays)
        assert np.array_equal(call(*(x[order] for x in arrays)), whole[order]), name
        for part in (slice(0, 1), slice(3, 5), slice(2, 11), slice(STATES - 1, STATES)):
            assert np.array_equal(call(*(x[part] for x in arrays)), whole[part]), (name, part)


@pytest.mark.soak
def test_one_state_beside_a_batch_stands_for_all_of_it(built: Build) -> None:
    robot = random_robot(702, joints=(2, 3), types=TYPES)
    kernel, states = built(robot, *KERNELS), random_states(robot, 702)
    for name, reads in READS.items():
        if len(reads) > 1:
            call, others = getattr(kernel, name), [states[x] for x in reads[1:]]
            repeated = np.tile(states["q"][3], (STATES, 1))
            assert np.array_equal(call(states["q"][3], *others), call(repeated, *others)), name


def test_threads_change_nothing() -> None:
    kernel = eomgen.build(eomgen.load_robot("ur5"))
    rng = np.random.default_rng(1)
    q, v, a = rng.uniform(-3, 3, (3, 1999, 6))
    expected = kernel.inverse_dynamics(q, v, a), kernel.inverse_dynamics(q[0], v, a[5])
    assert kernel.threads == 1
    for threads in (2, 3, 7):
        kernel.threads = threads
        assert np.array_equal(kernel.inverse_dynamics(q, v, a), expected[0])
        assert np.array_equal(kernel.inverse_dynamics(q[0], v, a[5]), expected[1])
    assert np.array_equal(kernel.frame_pose(q, "tcp")[5], kernel.frame_pose(q[5:6], "tcp")[0])


@pytest.mark.parametrize("threads", [1, 4])
def test_the_first_state_that_cannot_be_solved_is_named(threads: int, built: Build) -> None:
    link = Link("body", 2.0, (0.1, 0.0, 0.0), (0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
    joint = Joint("free", "base", "body", "free", coordinates={name: Coordinate() for name in COORDINATES})
    kernel = built(Robot("floating", (0.0, 0.0, -9.81), (link,), (joint,)))
    kernel.threads = threads
    q, still = np.zeros((3000, 6)), np.zeros(6)
    for state in (2999, 1501, 733):
        q[state, 4] = np.pi / 2
        refused(SingularError, f"free.alpha and free.gamma in state {state}", kernel.forward_dynamics, q, still, still)
    kernel.threads = 1


def test_memory_behind_the_arrays_is_not_touched(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"))
    rng = np.random.default_rng(2)
    for count in range(1, 18):
        q = rng.uniform(-3, 3, (count, 6))
        room = np.full((count + 2, 6, 6), np.nan)
        kernel.mass_matrix(q, out=room[1:-1])
        assert np.isnan(room[[0, -1]]).all()
        assert np.isfinite(room[1:-1]).all()


@pytest.mark.soak
@pytest.mark.parametrize("flags", [(), ("-mavx512f",), ("-mavx2",)])
def test_results_stand_wherever_there_is_room(flags: tuple[str, ...]) -> None:
    """Matrices with zeros and mirrored halves, at any place in a vector of memory, of any number of states."""
    skip_without(flags)
    robot = random_robot(3, joints=(10, 10), tree=True, types=("revolute",), max_coordinates=1, forces=False)
    names = ("mass_matrix", "forward_dynamics_jacobian", "residual_jacobian")
    kernel = eomgen.build(robot, kernels=names, flags=(*flags, "-O1"))
    states = random_states(robot, 3)
    expected = np.array([kernel.mass_matrix(x) for x in states["q"]])
    assert (expected == 0.0).any()
    for first in range(9):
        for count in (1, 2, 7, 8, 9, STATES):
            size = count * 100
            room = np.full(first + size + 8, np.nan)
            out = room[first : first + size].reshape(count, 10, 10)
            kernel.mass_matrix(states["q"][:count], out=out)
            assert np.array_equal(out, expected[:count]), (first, count)
            assert np.isnan(room[:first]).all(), (first, count)
            assert np.isnan(room[first + size :]).all(), (first, count)
    for call, reads in ((kernel.residual_jacobian, "qva"), (kernel.forward_dynamics_jacobian, "qvu")):
        arrays = [states[x] for x in reads]
        for i in range(STATES):
            single = call(*(x[i] for x in arrays))
            assert all(np.array_equal(x[i], y) for x, y in zip(call(*arrays), single, strict=True)), (call, i)


@pytest.mark.parametrize("flags", [("-mavx2",), ("-mavx512f",)])
def test_a_failure_in_any_lane_is_found(flags: tuple[str, ...]) -> None:
    """Pivots are compared with their scales in all lanes at once, and the first failure is named all the same."""
    skip_without(flags)
    link = Link("body", 2.0, (0.1, 0.0, 0.0), (0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
    joint = Joint("free", "base", "body", "free", coordinates={name: Coordinate() for name in COORDINATES})
    robot = Robot("floating", (0.0, 0.0, -9.81), (link,), (joint,))
    kernel = eomgen.build(robot, flags=(*flags, "-O1"), kernels=("forward_dynamics",))
    still = np.zeros(6)
    for state in range(11):
        q = np.zeros((11, 6))
        q[state:, 4] = np.pi / 2
        refused(SingularError, f"free.alpha and free.gamma in state {state}", kernel.forward_dynamics, q, still, still)
    assert np.isfinite(kernel.forward_dynamics(np.zeros((11, 6)), still, still)).all()


N = 37  # states, no multiple of what vectors hold
WIDTHS = {"-DEOM_VECTOR_BYTES=0": 1, "-mno-avx": 2, "-mavx2": 4, "-mavx512f": 8}
POINT = f"""
name = "point"
{link_table("post", 0.0)}
{link_table("arm", 2.0, (0.0, 1.0, 0.0))}
{joint_table("turn", "base", "post", "revolute")}
{joint_table("lift", "post", "arm", "revolute")}
placement = {{ rpy = [0.0, 1.5707963267948966, 0.0] }}
"""  # where the arm points upwards its mass is on the first axis


@pytest.fixture
def short_parts(monkeypatch: pytest.MonkeyPatch, empty_cache: Path) -> None:
    """Programs of any length go in short parts; the cache does not know of that."""
    monkeypatch.setattr(lanes, "MANY", 1)
    monkeypatch.setattr(definitions, "SHORT", 20)
    for module in (contexts, statements):
        monkeypatch.setattr(module, "CHUNK", 20)


def tree(seed: int) -> Robot:
    return random_robot(seed, joints=(5, 7), tree=True, max_coordinates=1, name="tree")


@pytest.mark.parametrize("flag", soaked(tuple(WIDTHS), ("-mavx512f", "-mno-avx")))
@pytest.mark.parametrize("seed", soaked((1, 2, 3), (1,)))
@pytest.mark.usefixtures("short_parts")
def test_states_have_the_bits_that_they_have_alone(flag: str, seed: int, empty_cache: Path) -> None:
    """Whatever part of the last vector they fill."""
    skip_without([flag])
    kernel = eomgen.build(tree(seed), kernels=("forward_dynamics",), flags=("-O0", flag))
    (text,) = (path.read_text() for path in empty_cache.glob("packages/*/tree_batch.c"))
    assert "tree_forward_dynamics_several(" in text
    assert "tree_forward_dynamics_lanes_part2(" in text
    rng = np.random.default_rng(seed)
    q, v, u = rows = rng.uniform(-2, 2, (3, N, kernel.n))
    alone = np.array([kernel.forward_dynamics(*(x[k] for x in rows)) for k in range(N)])
    for count in (1, 8, 9, 16, 17, N):
        assert np.array_equal(kernel.forward_dynamics(*(x[:count] for x in rows)), alone[:count])
    expected = np.array([kernel.forward_dynamics(q[k], v[0], u[k]) for k in range(N)])
    assert np.array_equal(kernel.forward_dynamics(q, v[0], u), expected)


@pytest.mark.parametrize("flag", soaked(tuple(WIDTHS), ("-mavx512f", "-mavx2")))
@pytest.mark.usefixtures("short_parts")
def test_the_first_singular_state_is_named(flag: str, empty_cache: Path) -> None:
    """Whichever vector and lane it is in."""
    skip_without([flag])
    kernel = eomgen.build(robot_from_toml(POINT), kernels=("forward_dynamics", "mass_matrix"), flags=("-O0", flag))
    assert "part1" in next(empty_cache.glob("packages/*/point_batch.c")).read_text()
    for first in (0, 3, 7, 8, 15, 16, 30, N - 1):
        q, zero = np.full((N, 2), 0.3), np.zeros((N, 2))
        q[first:, 1] = np.pi / 2
        refused(SingularError, rf"turn\.gamma in state {first};", kernel.forward_dynamics, q, zero, zero)
