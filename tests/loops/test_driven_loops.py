"""Mechanisms with loops whose coordinates are partly prescribed, and offsets in loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.errors import LoopError, UnknownNameError
from eomgen.integration import integrate
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Placement, Robot
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.random_robots import random_state

KERNELS = (
    "constraint",
    "constraint_jacobian",
    "constraint_bias",
    "cut_poses",
    "constrained_dynamics",
    "residual",
    "mass_matrix",
    "inverse_dynamics",
    "forward_dynamics",
    "energy",
)


def given(robot: Robot, name: str, coordinate: str) -> Robot:
    """The robot with one coordinate prescribed, which then has no drive."""
    joints = []
    for joint in robot.joints:
        if joint.name == name:
            numbers = dict(joint.coordinates)
            numbers[coordinate] = replace(numbers[coordinate], prescribed=True)
            joint = replace(joint, coordinates=numbers)
        joints.append(joint)
    kept = None if robot.driven is None else tuple(x for x in robot.driven if x != f"{name}.{coordinate}")
    return replace(robot, joints=tuple(joints), driven=kept)


@pytest.mark.soak
def test_a_prescribed_crank_moves_as_its_force_moves_a_free_one(built: Build) -> None:
    free = ClosedLoops(built(eomgen.load_robot("four_bar"), *KERNELS))
    driven = ClosedLoops(built(given(eomgen.load_robot("four_bar"), "joint1", "gamma"), *KERNELS))
    crank = Harmonic([0.8], [1.5])
    moves = [np.ravel(x)[0] for x in crank(0.0)]
    q = driven.consistent_positions([moves[0], 0.7, 1.2])
    assert q[0] == moves[0]
    v = driven.consistent_velocities(q, [moves[1], 0.0, 0.0])
    result = integrate(driven.kernel, q, v, 0.5, prescribed=crank, step=1e-3, output_step=1e-3)
    assert result.info["gap"] <= 1e-12
    assert driven.redundancy(q).mobility == 0
    assert np.abs(result.q[:, 0] - [np.ravel(crank(t)[0])[0] for t in result.t]).max() == 0.0
    for i in range(0, result.t.size, 50):
        a = free.forward_dynamics(result.q[i], result.v[i], result.u[i]).a
        assert abs(a[0] - np.ravel(crank(result.t[i])[2])[0]) <= 1e-8 * max(1.0, np.abs(a).max())
    power = result.u[:, 0] * result.v[:, 0]
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2) * 1e-3])
    energy = result.energy.sum(axis=1)
    assert np.abs(energy - energy[0] - work).max() <= 1e-4 * np.ptp(energy)
    assert np.ptp(energy) >= 1.0


def test_prescribed_accelerations_that_open_a_loop_are_refused(built: Build) -> None:
    robot = given(given(eomgen.load_robot("four_bar"), "joint1", "gamma"), "joint3", "gamma")
    loops = ClosedLoops(built(robot, *KERNELS))
    q = ClosedLoops(built(eomgen.load_robot("four_bar"), *KERNELS)).consistent_positions([0.5, 0.2, 1.2])
    with pytest.raises(LoopError, match=r"joint4 opens at the prescribed accelerations: joint4\.[xy] .* m/s\^2"):
        loops.forward_dynamics(q, np.zeros(3), [1.0, 0.0, 1.0])
    assert np.abs(loops.forward_dynamics(q, np.zeros(3), np.zeros(3)).a).max() <= 1e-12


@pytest.mark.soak
def test_an_offset_in_a_loop_is_a_turned_placement(built: Build) -> None:
    """An offset of an angle alpha that does not move turns the joint's frame about x."""
    robot, rng = eomgen.load_robot("bennett"), np.random.default_rng(4)
    first = robot.joints[1]
    offset = replace(
        robot, joints=(robot.joints[0], replace(first, offset=(0.0, 0.0, 0.0, 0.02, 0.0, 0.0)), *robot.joints[2:])
    )
    R = np.array(first.placement.rotation) @ np.array(Placement.from_rpy((0.0, 0.0, 0.0), (0.02, 0.0, 0.0)).rotation)
    turned = replace(first, placement=Placement(first.placement.xyz, tuple(tuple(map(float, row)) for row in R)))  # type: ignore[arg-type]
    placed = replace(robot, joints=(robot.joints[0], turned, *robot.joints[2:]))
    a, b = (built(r, *KERNELS) for r in (offset, placed))
    state = random_state(robot, rng)
    q, v = state.q, state.v
    for name in ("constraint", "constraint_jacobian", "cut_poses"):
        assert np.abs(getattr(a, name)(q) - getattr(b, name)(q)).max() <= 1e-14
    assert np.abs(a.constraint_bias(q, v) - b.constraint_bias(q, v)).max() <= 1e-13


@pytest.mark.parametrize(("name", "driven"), [("four_bar", ["joint3.gamma"]), ("bennett", ["joint1.gamma"])])
def test_inverse_of_forward_dynamics(name: str, driven: list[str], built: Build) -> None:
    """Drives at one joint that make the accelerations which other drives made; they do the same work."""
    rng = np.random.default_rng(6)
    loops = ClosedLoops(built(eomgen.load_robot(name), *KERNELS))
    guess = [0.5, 0.2, 1.2] if name == "four_bar" else [1.0, 1.5, -1.0]
    q = loops.consistent_positions(guess, held=["joint1.gamma"])
    v = loops.consistent_velocities(q, rng.normal(size=3))
    u = rng.normal(size=3)
    a = loops.forward_dynamics(q, v, u).a
    found = loops.inverse_dynamics(q, v, a, driven=driven)
    assert [loops.kernel.coordinates[i] for i in np.flatnonzero(found.u)] == driven
    again = loops.forward_dynamics(q, v, found.u)
    assert np.abs(again.a - a).max() <= 1e-9 * np.abs(a).max()
    assert np.abs(again.multipliers - found.multipliers).max() <= 1e-8 * np.abs(found.multipliers).max()
    assert abs(found.u @ v - u @ v) <= 1e-9 * max(1.0, np.abs(u @ v))
    spread = loops.inverse_dynamics(q, v, a, driven=loops.kernel.coordinates)
    assert np.linalg.norm(spread.u) <= min(np.linalg.norm(u), np.linalg.norm(found.u)) + 1e-9
    assert np.abs(loops.forward_dynamics(q, v, spread.u).a - a).max() <= 1e-9 * np.abs(a).max()
    with pytest.raises(LoopError, match="drives at none cannot make this motion"):
        loops.inverse_dynamics(q, v, a, driven=[])
    with pytest.raises(LoopError, match="opens at the accelerations"):
        loops.inverse_dynamics(q, v, a + [0.0, 1.0, 0.0], driven=driven)
    with pytest.raises(UnknownNameError, match="driven: 'joint9' is unknown"):
        loops.inverse_dynamics(q, v, a, driven=["joint9"])


@pytest.mark.soak
def test_legs_of_goughs_platform_hold_it(built: Build) -> None:
    """Forces in six legs at rest balance the platform's weight, by virtual work of its six freedoms."""
    robot = eomgen.load_robot("gough")
    loops = ClosedLoops(built(robot, *KERNELS))
    names = loops.kernel.coordinates
    guess = np.zeros(24)
    guess[:6], guess[8::3] = [0.1, -0.05, 0.9, 0.1, -0.2, 0.15], 1.0
    q = loops.consistent_positions(guess, held=names[:6])
    zero = np.zeros(len(names))
    legs = [name for name in names if name.endswith(".z") and name.startswith("leg")]
    assert len(legs) == 6
    found = loops.inverse_dynamics(q, zero, zero, driven=legs)
    assert found.redundancy.mobility == 6
    a = loops.forward_dynamics(q, zero, found.u).a
    assert np.abs(a).max() <= 1e-9 * np.abs(found.u).max()


def test_contacts_in_a_loop_are_found(built: Build) -> None:
    """A stop for the rocker: it closes and opens where the rocker passes the end of its clearance."""
    robot = eomgen.load_robot("four_bar")
    stop = replace(robot.joints[2].coordinates["gamma"], stiffness=200.0, clearance=1.4, smoothing=1e-3)
    joints = (*robot.joints[:2], replace(robot.joints[2], coordinates={"gamma": stop}))
    loops = ClosedLoops(built(replace(robot, joints=joints, name="stopped_bars"), *KERNELS))
    q = loops.consistent_positions([0.5, 0.2, 1.2], held=["joint1.gamma"])
    v = loops.consistent_velocities(q, [4.0, 0.0, 0.0], held=["joint1.gamma"])
    motion = integrate(loops.kernel, q, v, 1.0, step=1e-3, output_step=1e-3)
    rocker = motion.of("joint3.gamma")
    crossings = np.flatnonzero((np.abs(rocker[1:]) > 1.4) != (np.abs(rocker[:-1]) > 1.4))
    assert len(motion.contacts) == len(crossings) >= 2
    for contact, i in zip(motion.contacts, crossings, strict=True):
        assert contact.coordinate == "joint3.gamma"
        assert motion.t[i] <= contact.t <= motion.t[i + 1]
        assert contact.closes == (abs(rocker[i + 1]) > 1.4)
