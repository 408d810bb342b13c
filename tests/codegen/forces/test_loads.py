"""Friction that depends on what presses its joint: formulas by hand, slopes, rest, energy, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.export.mujoco import mjcf
from eomgen.integration import integrate
from eomgen.robot.value import Coordinate, Friction, Joint, Link, Loop, Robot
from tests.support.added_forces import check_jacobians
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.random_robots import random_state

pytestmark = pytest.mark.usefixtures("unoptimised")

LOADED = Friction(0.3, 0.7, 0.2, 0.05, 0.1, coefficient=0.4, radius=0.5)
X, Y = Coordinate(50.0, 2.0, cubic=30.0), Coordinate(80.0, 1.0, preload=3.0)
LINK = Link("wheel", 2.0, (0.1, 0.05, 0.02), (0.1, 0.2, 0.25, 0.0, 0.0, 0.0))
CENTRED = Link("wheel", 2.0, (0.0, 0.0, 0.0), (0.1, 0.2, 0.25, 0.0, 0.0, 0.0))


def pin(friction: Friction = LOADED, link: Link = LINK, *, name: str = "pin_joint", **more: Coordinate) -> Robot:
    """A wheel on a pin that gives way in x and y."""
    table = {"x": X, "y": Y, "gamma": Coordinate(friction=friction), **more}
    joint = Joint("pin", "base", "wheel", "revolute", coordinates=table)
    return Robot(name, (0.0, -9.81, 0.0), (link,), (joint,))


def cut_pin(friction: Friction = LOADED) -> Robot:
    """The same wheel as a free body, held by a cut joint."""
    free = {name: Coordinate() for name in ("x", "y", "gamma")}
    joint = Joint("float", "base", "wheel", "fixed", coordinates=free)
    table = {"x": X, "y": Y, "z": Coordinate(), "gamma": Coordinate(friction=friction)}
    loop = Loop("pin", ("base", "wheel"), "spherical", coordinates=table)
    return Robot("cut_pin", (0.0, -9.81, 0.0), (LINK,), (joint,), loops=(loop,))


def by_hand(q: Any, v: Any, f: Friction = LOADED) -> Any:
    """The friction of gamma in the state (x, y, gamma)."""
    assert f.coefficient is not None
    assert f.radius is not None
    assert f.static is not None
    assert f.stribeck is not None
    assert f.viscous is not None
    carried = np.array([50.0 * q[0] + 30.0 * q[0] ** 3 + 2.0 * v[0], 80.0 * q[1] + 3.0 + v[1]])
    level = f.coulomb + f.coefficient * f.radius * np.hypot(*carried)
    level += (f.static - f.coulomb) / (1.0 + (v[2] / f.stribeck) ** 2)
    return level * v[2] / np.hypot(v[2], f.smoothing) + f.viscous * v[2]


def test_friction_is_that_of_the_radial_force(built: Build) -> None:
    """In a joint, in a cut joint, one state at a time, and in batches of both precisions."""
    rng = np.random.default_rng(7)
    q, v = rng.uniform(-1.0, 1.0, (2, 9, 3))
    wanted = [by_hand(*state) for state in zip(q, v, strict=True)]
    bare = built(pin(Friction(0.0)), "generalized_force")
    for dtype, allowed in (("float64", 1e-12), ("float32", 1e-4)):
        kernel = built(pin(), "generalized_force", dtype=dtype)
        states = q.astype(dtype), v.astype(dtype)
        found = bare.generalized_force(q, v) - kernel.generalized_force(*states)
        assert close(found[:, 2], np.array(wanted), allowed)
        assert close(found[:, :2], np.zeros((9, 2)), 10.0 * allowed)
        one = kernel.generalized_force(states[0][3], states[1][3])
        assert close(one, kernel.generalized_force(*states)[3], allowed)
    cut = eomgen.build(cut_pin())
    assert cut.cut_laws == ("pin.x", "pin.y", "pin.gamma")
    for i, state in enumerate(zip(q, v, strict=True)):
        assert cut.functions.cut_forces(*state)[2, 1] == pytest.approx(wanted[i], rel=1e-12)


@pytest.mark.parametrize("robot", [pin(), cut_pin()], ids=["joint", "cut joint"])
def test_jacobians_have_the_slope_by_the_load(robot: Robot, built: Build) -> None:
    """Complex steps, and off the diagonal what no other row has."""
    check_jacobians(robot, [random_state(robot, seed) for seed in range(3)], built)


def test_slopes_are_unsymmetric_and_finite_without_a_load(built: Build) -> None:
    kernel = built(pin(link=CENTRED), "residual_jacobian")
    by_q, by_v, _ = kernel.residual_jacobian([0.1, 0.0, 0.3], [0.0, 0.0, 1.0], np.zeros(3))
    assert abs(by_q[2, 0]) > 1.0
    assert abs(by_v[2, 1]) > 0.01
    assert np.abs(by_q[:2, 2]).max() < 1e-12
    at_none = kernel.residual_jacobian([0.0, -3.0 / 80.0, 0.3], [0.0, 0.0, 1.0], np.zeros(3))
    assert all(np.isfinite(block).all() for block in at_none)
    assert abs(at_none[0][2, 0]) < 1e-6


def test_a_sliding_guide_feels_what_is_across(built: Build) -> None:
    """Without a radius; contacts count by what they push, and friction of others does not count."""
    table = {
        "x": Coordinate(1e3, clearance=0.1, smoothing=1e-3, friction=Friction(5.0)),
        "z": Coordinate(friction=Friction(coefficient=0.2)),
    }
    joint = Joint("guide", "base", "wheel", "prismatic", coordinates=table)
    kernel = built(Robot("guide", (0.0, 0.0, 0.0), (CENTRED,), (joint,)), "generalized_force")
    assert kernel.generalized_force([0.05, 0.0], [1.0, 1.0])[1] == pytest.approx(0.0, abs=1e-6)  # inside the gap
    pushed = 1e3 * (0.1 - 0.5e-3)
    assert kernel.generalized_force([0.2, 0.0], [1.0, 1.0])[1] == pytest.approx(-0.2 * pushed)


def test_it_only_takes_energy(built: Build) -> None:
    """Its power is never positive, whatever the state, and a motion loses what it took."""
    kernel, bare = built(pin(), "generalized_force"), built(pin(Friction(0.0)), "generalized_force")
    q, v = np.random.default_rng(3).normal(size=(2, 200, 3))
    power = (kernel.generalized_force(q, v) - bare.generalized_force(q, v)) * v
    assert power.max() <= 1e-12
    assert power.min() < -1.0
    sharp = replace(LOADED, smoothing=4e-8)
    whole = built(pin(sharp), "forward_dynamics", "energy", "residual_jacobian", "mass_matrix", "inverse_dynamics")
    found = integrate(whole, [0.0, 0.0, 0.5], [0.0, 0.0, 5.0], 1.0, output_step=0.01)
    energy = np.asarray(found.energy).sum(axis=1)
    assert np.diff(energy).max() <= 1e-5 * np.ptp(energy)
    forces = np.array([by_hand(*state, sharp) for state in zip(found.q, found.v, strict=True)])
    taken = forces * found.v[:, 2] + found.v[:, :2] ** 2 @ [2.0, 1.0]  # and the dampers
    work = 0.5 * np.diff(found.t) @ (taken[1:] + taken[:-1])
    assert work == pytest.approx(energy[0] - energy[-1], rel=2e-3)


def test_a_wheel_comes_to_rest_under_its_weight(built: Build) -> None:
    """After J w / (mu r m g), in steps and by Radau; then it stays."""
    friction = Friction(coefficient=0.1, radius=0.05)
    stiff = {key: Coordinate(1e6, 1e3) for key in ("x", "y")}
    robot = pin(friction, CENTRED, name="braked_wheel", **stiff)
    kernel = built(
        robot, "forward_dynamics", "residual_jacobian", "mass_matrix", "inverse_dynamics", "energy", "rollout"
    )
    q = np.array([0.0, -2.0 * 9.81 / 1e6, 0.0])
    stops = 0.25 * 0.2 / (0.1 * 0.05 * 2.0 * 9.81)
    found = integrate(kernel, q, [0.0, 0.0, 0.2], 1.0, output_step=1e-3)
    assert found.method == "scipy:Radau"
    (rest,) = found.rests
    assert rest.begins == pytest.approx(stops, abs=2e-3)
    assert rest.ends == 1.0
    assert found.q[-1, 2] == pytest.approx(0.5 * 0.2 * stops, rel=1e-3)
    _, v = kernel.rollout(q, np.array([0.0, 0.0, 0.2]), np.zeros(3), dt=1e-3, steps=1000, method="implicit")
    assert np.abs(v[700:, 2]).max() < 1e-7
    assert v[250, 2] == pytest.approx(0.2 * (1.0 - 0.25 / stops), rel=1e-2)


def test_mujoco_has_no_such_friction() -> None:
    robot = pin(Friction(coefficient=0.1, radius=0.2), x=Coordinate(50.0), y=Coordinate(80.0))
    with pytest.raises(InputError, match=r"joints\.pin\.gamma\.friction: frictionloss.* without .*load"):
        mjcf(robot, 1e-3)
