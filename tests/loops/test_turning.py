"""Free and ball joints of closed mechanisms through the singularities of their angles.

A pendulum that a cut joint holds is compared with one on a ball joint, which turns by code of its own; a body on cut
hinges with its solution; a triangle of ball joints with itself in other axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.errors import SingularError
from eomgen.integration import integrate
from eomgen.kernel.complete import Kernel
from eomgen.loops.equilibrium import closed_equilibrium
from eomgen.robot import build_model
from eomgen.robot.value import Coordinate, Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, seeds
from tests.support.soak import soaked
from tests.support.turning_loops import (
    INTEGRATED,
    cranked_plate,
    held_at,
    held_pendulum,
    hinged_body,
    hung_pendulum,
    random_ring,
    triangle,
)

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

ANGLES, RATES = np.array([0.3, 0.2, 0.1]), np.array([2.0, 3.0, 1.0])
FIXED, CHOSEN = ("rk4", "implicit"), ("tsit5", "rosenbrock", "radau")
DURATION, SAMPLES = 4.0, 80


def turned(q: Array) -> Rotation:
    return Rotation.from_euler("XYZ", q)


def apart(q: Array, other: Array) -> float:
    """Largest angle between two rotations, rad."""
    return float(np.max((turned(q) * turned(other).inv()).magnitude()))


def roll(kernel: Kernel, q: Array, v: Array, method: str, u: Array | None = None, **more: Any) -> tuple[Array, Array]:
    """A rollout by any method; states at equal times."""
    if method in FIXED:
        more = {"dt": 2e-4, "steps": 20_000, "every": 250} | more
    else:
        more = {"duration": DURATION, "samples": SAMPLES, "rtol": 1e-9} | more
    return kernel.rollout(q, v, np.zeros(kernel.n) if u is None else u, method=method, **more)


@pytest.fixture(scope="module")
def held(built: Build) -> Kernel:
    return built(held_pendulum(), *INTEGRATED, "radau_rollout")


@pytest.fixture(scope="module")
def hung(built: Build) -> Array:
    """The other pendulum's angles at all samples, (SAMPLES + 1, 3)."""
    kernel = built(hung_pendulum(), "forward_dynamics", "energy", "rollout")
    return kernel.rollout(ANGLES, RATES, np.zeros(3), 1e-4, 40_000, every=500)[0]


@pytest.mark.parametrize("method", [*FIXED, *CHOSEN])
def test_rollouts_of_a_held_pendulum(method: str, held: Kernel, hung: Array) -> None:
    q, v = roll(held, *held_at(ANGLES, RATES), method)
    limit = {"rk4": 1e-11, "tsit5": 1e-8, "radau": 1e-8, "rosenbrock": 1e-6, "implicit": 0.2}[method]
    assert np.abs(np.cos(q[:, 4])).min() < 0.1  # it does come near
    assert np.abs(q[:, 3:] - hung).max() < limit
    assert np.abs(held.functions.constraint(q)).max() < 1e-11
    energy = held.energy(q, v).sum(axis=1)
    assert np.abs(energy - energy[0]).max() < limit


@pytest.mark.soak
@pytest.mark.parametrize(
    "method", soaked(("rk4", "scipy:DOP853", "scipy:Radau", "scipy:LSODA"), ("rk4", "scipy:LSODA"))
)
def test_integrations_of_a_held_pendulum(method: str, held: Kernel, hung: Array) -> None:
    step = {"step": 5e-4} if method == "rk4" else {}
    found = integrate(held, *held_at(ANGLES, RATES), DURATION, method=method, rtol=1e-8, output_step=0.05, **step)
    assert np.abs(found.q[:, 3:] - hung).max() < 1e-6
    assert found.info["gap"] < 1e-12
    assert found.info["gap_rate"] < 1e-12
    assert found.info["margin"] > 0.1  # poles are no singular poses
    assert np.abs(found.energy.sum(axis=1) - found.energy[0].sum()).max() < 1e-6


def test_forces_keep_their_meaning(held: Kernel) -> None:
    """Drives of described coordinates, held in rollouts and given to integrations; their work is what energy gains."""
    u = np.array([3.0, -2.0, 4.0, 0.3, -0.2, 0.1])
    q0, v0 = held_at(ANGLES, 0.5 * RATES)
    found = integrate(held, q0, v0, 1.0, drive=lambda t, q, v: u, rtol=1e-10, output_step=1e-3, method="scipy:DOP853")
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.45
    power = found.v @ u
    work = np.concatenate([[0.0], np.cumsum(0.5e-3 * (power[1:] + power[:-1]))])
    gained = found.energy.sum(axis=1) - found.energy[0].sum()
    slow = np.abs(np.cos(found.q[:, 4])) > 0.6  # elsewhere angles are too fast for the samples
    assert np.abs(gained - work)[slow].max() < 1e-5 * np.abs(gained).max()
    for method, more in (
        ("rk4", {"dt": 2e-4, "steps": 5000, "every": 5000}),
        ("tsit5", {"duration": 1.0, "samples": 1}),
    ):
        q, _ = roll(held, q0, v0, method, u, **more)
        assert np.abs(q[-1] - found.q[-1]).max() < 1e-7
    wrench = np.array([[0.0, 0.0, 0.0, 0.2, 0.1, -0.3]])
    plain, implicit = (
        integrate(held, q0, 2.0 * v0, 1.0, wrench=lambda t, q, v: wrench, rtol=1e-9, output_step=0.1, method=method)
        for method in ("scipy:DOP853", "scipy:Radau")
    )
    assert np.abs(np.cos(plain.q[:, 4])).min() < 0.45
    assert np.abs(plain.q - implicit.q).max() < 1e-6


@pytest.mark.parametrize("method", [*FIXED, *CHOSEN])
def test_states_of_a_batch_turn_apart(method: str, held: Kernel) -> None:
    """Bit by bit what each does alone, in threads, over several calls of C, at the pole itself and far from it."""
    rng = np.random.default_rng(1)
    angles, rates = rng.normal(size=(19, 3)), 2.0 * rng.normal(size=(19, 3))
    angles[5, 1], rates[5], rates[6] = np.pi / 2, 0.0, 0.0
    q, v = (np.array(x) for x in zip(*map(held_at, angles, rates), strict=True))
    how = (
        {"steps": 3000, "dt": 5e-4, "every": 100} if method in FIXED else {"duration": 1.5, "samples": 20, "rtol": 1e-5}
    )
    found = roll(held, q, v, method, **how)
    shared = roll(held.replaced(threads=2), q, v, method, **how)
    assert all(np.array_equal(x, y) for x, y in zip(found, shared, strict=True))
    for i in (0, 4, 5, 6, 18):
        alone = roll(held, q[i], v[i], method, **how)
        assert all(np.array_equal(x, y[i]) for x, y in zip(alone, found, strict=True))
    energy = held.energy(*found).sum(axis=-1)
    assert np.abs(energy - energy[:, :1]).max() < {"rk4": 1e-7, "implicit": 1.0}.get(method, 1e-2)


@pytest.mark.soak
@pytest.mark.parametrize("hinges", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_a_hinged_body_turns_on(hinges: int, built: Build) -> None:
    """Straight through the poles of its free joint, from one of them, too; of two hinges one is redundant."""
    kernel = built(hinged_body(hinges), *INTEGRATED, "radau_rollout")
    v0 = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    times = np.linspace(0.0, DURATION, SAMPLES + 1)
    for begin in (0.3, np.pi / 2):
        q0 = np.array([0.0, 0.0, 0.0, 0.0, begin, 0.0])
        for method in (*FIXED, *CHOSEN):
            q, v = roll(kernel, q0, v0, method)
            assert np.abs(q - np.multiply.outer(times, v0) - q0).max() < 1e-9, method
            assert np.abs(v - v0).max() < 1e-9, method
        found = integrate(kernel, q0, v0, DURATION, output_step=DURATION / SAMPLES)
        assert np.abs(found.q - np.multiply.outer(times, v0) - q0).max() < 1e-9
        assert found.info["redundant"] == 5.0 * (hinges - 1)


@pytest.mark.soak
def test_single_precision(built: Build, held: Kernel) -> None:
    kernel = built(held_pendulum(), *INTEGRATED, dtype="float32")
    q0, v0 = (x.astype(np.float32) for x in held_at(ANGLES, RATES))
    q, _ = kernel.rollout(q0, v0, np.zeros(6, np.float32), 1e-3, 2000, every=2000)
    expected, _ = held.rollout(*held_at(ANGLES, RATES), np.zeros(6), 1e-3, 2000, every=2000)
    assert apart(q[-1:, 3:].astype(np.float64), expected[-1:, 3:]) < 5e-3
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-5


def in_other_axes(
    kernel: Kernel, other: Kernel, q: Array, v: Array, links: Sequence[str] = ("first", "second")
) -> tuple[Array, Array]:
    """Coordinates and rates of a mechanism described with other axes whose links stand and move as these."""
    found = np.zeros(other.n)

    def poses(of: Kernel, x: Array) -> Array:
        return np.concatenate([of.frame_pose(x, name)[:3].ravel() for name in links])

    rng = np.random.default_rng(0)
    for step in range(600):
        missing = poses(kernel, q) - poses(other, found)
        if np.abs(missing).max() < 1e-14:
            break
        if step % 60 == 59:  # it leads nowhere from there
            found = rng.uniform(-1.5, 1.5, other.n)
            missing = poses(kernel, q) - poses(other, found)
        slopes = np.array([(poses(other, found + h) - poses(other, found - h)) / 2e-6 for h in 1e-6 * np.eye(other.n)])
        found = found + np.clip(np.linalg.lstsq(slopes.T, missing, rcond=None)[0], -0.3, 0.3)
    assert np.abs(poses(kernel, q) - poses(other, found)).max() < 1e-12
    here = np.vstack([kernel.frame_jacobian(q, name) for name in links])
    there = np.vstack([other.frame_jacobian(found, name) for name in links])
    return found, np.linalg.lstsq(there, here @ v, rcond=None)[0]


def test_loops_close_at_a_pole(held: Kernel) -> None:
    """Near the guess, whatever its angles; rates that the description's angles have not are refused."""
    angles = np.array([[0.3, np.pi / 2, 0.1], [0.2, 1e-3 - np.pi / 2, 0.1], [0.1, 0.2, 0.3]])
    guess = np.concatenate([np.zeros((3, 3)), angles], axis=1)
    q = held.assemble(guess)
    assert np.abs(held.functions.constraint(q)).max() < 1e-12
    assert np.abs(q - guess).max() < 1.0
    v = held.project_velocity(q, np.ones((3, 6)))
    assert np.abs(np.einsum("kij,kj->ki", held.functions.constraint_jacobian(q), v)).max() < 1e-12 * np.abs(v).max()
    for i in range(3):
        assert np.array_equal(held.assemble(guess[i]), q[i])
        assert np.allclose(held.project_velocity(q[i], np.ones(6)), v[i], rtol=1e-10, atol=0.0)
    assert held.assemble(guess[0], ["free.beta"])[4] == np.pi / 2
    pole, _ = held_at(angles[0], np.zeros(3))
    assert np.abs(held.project_velocity(pole, np.zeros(6))).max() == 0.0
    with pytest.raises(SingularError, match=r"free\.beta is at \+-pi/2"):
        held.project_velocity(pole, np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))


@pytest.mark.soak
@pytest.mark.parametrize("angle", soaked((0.0, np.pi / 2), (np.pi / 2,)))
def test_a_driven_plate_is_simulated_over_a_pole(angle: float) -> None:
    """Through a program, computed torque and an equilibrium at the beginning, which may be at a pole."""
    result = eomgen.simulate(
        cranked_plate(angle), duration=1.0, start={"hinge": angle}, goal={"hinge": angle + 3.0}, rtol=1e-8
    )
    q = result.trajectory.q
    assert np.abs(q[:, 0] - result.program_q[:, 0]).max() < 1e-9
    assert np.abs(q[:, 5] - q[:, 0]).max() < 1e-6
    assert q[-1, 0] == pytest.approx(angle + 3.0)
    assert np.abs(np.cos(q[:, 5])).min() < 1e-2
    assert result.trajectory.info["gap"] < 1e-11


@pytest.mark.soak
def test_equilibrium_at_a_pole(built: Build) -> None:
    """Near which the weight puts it: the crank hangs down, and the plate has turned by about a quarter."""
    kernel = built(cranked_plate(), *INTEGRATED)
    for guess in (1.2, np.pi / 2):
        q = closed_equilibrium(kernel, [guess, *np.zeros(4), guess, 0.0])
        poses = [(link, kernel.frame_pose(q, link.name)) for link in cranked_plate().links]
        centre = sum(link.mass * (pose @ [*link.com, 1.0])[:3] for link, pose in poses)
        assert centre[2] < 0.0
        assert abs(centre[0]) < 1e-8  # below the hinge
        assert np.abs(kernel.functions.constraint(q)).max() < 1e-11


@pytest.mark.soak
def test_a_prescribed_crank_takes_the_plate_over_the_poles(built: Build) -> None:
    """The force that the motion needs is what its energy says."""
    robot = cranked_plate()
    hinge, pose = robot.joints
    robot = replace(
        robot,
        name="led_plate",
        home={},
        joints=(replace(hinge, coordinates={"gamma": Coordinate(prescribed=True)}), pose),
    )
    kernel = built(robot, *INTEGRATED, "tree_inverse_dynamics")

    def motion(t: float) -> tuple[Array, Array, Array]:
        return np.array([3.0 * t]), np.array([3.0]), np.array([0.0])

    v0 = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0])
    q0 = kernel.assemble(np.zeros(7))
    v0 = kernel.project_velocity(q0, v0)
    found = integrate(kernel, q0, v0, 1.0, prescribed=motion, output_step=1e-3)
    assert np.abs(found.q[:, 5] - 3.0 * found.t).max() < 1e-9
    power = found.u[:, 0] * 3.0
    work = np.concatenate([[0.0], np.cumsum(0.5e-3 * (power[1:] + power[:-1]))])
    gained = found.energy.sum(axis=1) - found.energy[0].sum()
    assert np.abs(gained - work).max() < 1e-5 * np.abs(gained).max()


def test_what_turns_and_what_does_not() -> None:
    for robot, joints in (
        (held_pendulum(), ["free"]),
        (triangle(), ["shoulder", "elbow"]),
        (eomgen.load_robot("gough"), ["pose"]),
        (eomgen.load_robot("four_bar"), []),
    ):
        model = build_model(robot)
        assert [model.bodies[k].joint for k in model.turning] == joints


def check_in_other_axes(
    robot: Robot, other: Robot, seed: int, speed: float, steps: int, within: float, built: Build
) -> None:
    """Move a mechanism, and the same one whose poles lie elsewhere: energy, loops, and where links are."""
    kernel, again = built(robot, *INTEGRATED), built(other, *INTEGRATED)
    rng, links = np.random.default_rng(seed), [link.name for link in robot.links]
    if robot.home:
        q0 = np.array([robot.home[name] for name in kernel.coordinates])
    else:
        q0 = kernel.assemble(rng.normal(size=kernel.n))
    v0 = kernel.project_velocity(q0, speed * rng.normal(size=kernel.n))
    still, states = np.zeros(kernel.n), in_other_axes(kernel, again, q0, v0, links)
    (q, v), (there, _) = (
        x.rollout(*state, still, 1e-4, steps, every=100) for x, state in ((kernel, (q0, v0)), (again, states))
    )
    energy = kernel.energy(q, v)
    assert np.abs(energy.sum(axis=1) - energy[0].sum()).max() < 0.01 * within * max(1.0, np.abs(energy).max())
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-9
    for link in links:
        assert np.abs(kernel.frame_pose(q, link) - again.frame_pose(there, link)).max() < within
    if not robot.home:
        assert (np.abs(np.cos(q[:, [1, 4]])).min(axis=0) < 0.5).any() or seed > 0
        found = integrate(kernel, q0, v0, 1.5, rtol=1e-9, output_step=0.5)
        for link in links:
            assert (
                np.abs(kernel.frame_pose(q[[0, 50, 100, 150]], link) - kernel.frame_pose(found.q, link)).max() < within
            )


@pytest.mark.parametrize("seed", seeds(0, 0, 100))
def test_a_triangle_moves_the_same_in_other_axes(seed: int, built: Build) -> None:
    """Two ball joints in one loop."""
    check_in_other_axes(triangle(), triangle(turned=True), seed, 4.0, 15_000, 1e-5, built)


@pytest.mark.parametrize("seed", seeds(0, 0, 100))
def test_random_rings_move_the_same_in_other_axes(seed: int, built: Build) -> None:
    """Free, ball and hinge joints in a row, whose last link a cut joint holds."""
    check_in_other_axes(random_ring(seed), random_ring(seed, turned=True), seed, 3.0, 10_000, 1e-4, built)
