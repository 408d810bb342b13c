"""Wrenches and payloads of scenarios against MuJoCo, Pinocchio, and robots that have the payload as a body."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import eomgen
from eomgen.integration.solve import integrate
from eomgen.robot.value import Joint, Link, Placement, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.loads import Wrenches, combined_body
from eomgen.simulation.run import run_scenario
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.random_robots import random_robot

pytestmark = pytest.mark.usefixtures("unoptimised")

TIGHT = "[integrator]\nmethod = 'DOP853'\nrtol = 1e-11\n"


def thick_robot(seed: int) -> Robot:
    return random_robot(seed, joints=(3, 3), types=("revolute", "prismatic"), rigid=True, forces=False)


@pytest.mark.parametrize("seed", [11, 12])
def test_wrenches_over_time_against_mujoco(seed: int) -> None:
    """xfrc_applied of MuJoCo, constant over its steps, is a table that holds."""
    robot, step = thick_robot(seed), 2e-4
    link = robot.joints[-1].child
    rng = np.random.default_rng(seed)
    rows = [[t, *rng.uniform(-3.0, 3.0, 6).tolist()] for t in (0.0, 0.06, 0.13)]
    text = (
        f"duration = 0.2\noutput_step = 0.02\n[[wrenches]]\nlink = '{link}'\nrows = {rows}\ninterpolation = 'hold'\n"
        "t0 = 0.03\n" + TIGHT
    )
    result = run_scenario(robot, scenario_from_toml(text))
    other = MujocoRobot(robot, step)
    q = np.zeros(other.model.nv)
    mujoco.mj_resetData(other.model, other.data)
    other.set_state(q, q)
    states = [q]
    for i in range(1000):
        t = i * step
        row = rows[int(np.searchsorted([0.06, 0.13], t + 1e-9))]
        other.data.xfrc_applied[other.model.body(link).id] = np.array(row[1:]) * (t > 0.03 - 1e-9)
        mujoco.mj_step(other.model, other.data)
        if (i + 1) % 100 == 0:
            states.append(np.array(other.data.qpos))
    assert np.abs(result.trajectory.q - states).max() < 1e-8 * max(1.0, np.abs(states).max())
    assert result.wrench is not None
    assert not result.wrench[1].any()
    assert np.array_equal(result.wrench[3, result.links.index(link)], rows[1][1:])


@pytest.mark.parametrize("axes", ["base", "link"])
def test_a_force_at_a_point_against_mujoco(axes: str) -> None:
    robot = thick_robot(13)
    link, rng = robot.joints[-1].child, np.random.default_rng(0)
    force, moment, point = rng.uniform(-2, 2, (3, 3))
    kernel, other = eomgen.build(robot, kernels=("external_force", "kinematics")), MujocoRobot(robot)
    text = (
        f"duration = 1.0\n[[wrenches]]\nlink = '{link}'\nforce = {force.tolist()}\nmoment = {moment.tolist()}\n"
        f"point = {point.tolist()}\naxes = '{axes}'\n"
    )
    wrenches = Wrenches(scenario_from_toml(text), robot, kernel)
    body = other.model.body(link).id
    for _ in range(5):
        q = rng.uniform(-1, 1, kernel.n)
        other.set_state(q, np.zeros(kernel.n))
        turn = other.data.xmat[body].reshape(3, 3)
        R, place = (turn if axes == "link" else np.eye(3)), other.data.xpos[body] + turn @ point
        found = np.zeros(kernel.n)
        mujoco.mj_applyFT(other.model, other.data, R @ force, R @ moment, place, body, found)
        assert np.abs(kernel.external_force(q, wrenches(0.0, q, q)) - found).max() < 1e-12 * max(1, np.abs(found).max())


def carrying(robot: Robot, link: str, load: Link) -> Robot:
    """The robot with the load as a further link, held by a fixed joint."""
    place = Joint("grip", link, "load", "fixed", Placement())
    return replace(robot, links=(*robot.links, replace(load, name="load")), joints=(*robot.joints, place))


@pytest.mark.parametrize("t0", [0.0, 0.123])
def test_a_payload_is_a_further_body(t0: float) -> None:
    """From t0 on the motion is that of a robot which has the load as a link held by a fixed joint."""
    robot = eomgen.load_robot("one_link")
    load = Link("load", 0.7, (0.9, 0.05, 0.02), (0.01, 0.02, 0.015, 0.001, 0.0, -0.002))
    xx, yy, zz, xy, _, yz = load.inertia
    text = (
        "duration = 0.4\noutput_step = 1e-2\n[initial]\nv = { joint1 = 1.5 }\n[[payloads]]\nlink = 'link1'\n"
        f"mass = {load.mass}\npoint = {list(load.com)}\nt0 = {t0}\n"
        f"inertia = {{ xx = {xx}, yy = {yy}, zz = {zz}, xy = {xy}, yz = {yz} }}\n" + TIGHT
    )
    result = run_scenario(robot, scenario_from_toml(text))
    t = result.trajectory.t
    heavy = eomgen.build(replace(carrying(robot, "link1", load), name="heavy"))
    light = eomgen.build(robot)
    options = {"method": "DOP853", "rtol": 1e-11}
    q0, v0, before = np.zeros(2), np.array([0.0, 1.5]), np.zeros((0, 2))
    if t0:
        first = integrate(light, q0, v0, t0, times=np.append(t[t < t0], t0), **options)
        q0, v0, before = first.q[-1], first.v[-1], first.q[:-1]
    rest = integrate(heavy, q0, v0, 0.4, times=np.append([t0] if t0 else [], t[t >= t0]), **options)
    expected = np.concatenate([before, rest.q[1:] if t0 else rest.q])
    assert np.abs(result.trajectory.q - expected).max() < 1e-9
    assert result.balance is not None
    assert result.balance.relative_residue < 1e-7
    brought = heavy.energy(q0, v0).sum() - light.energy(q0, v0).sum()
    assert result.balance.of("payloads")[-1] == pytest.approx(brought if t0 else 0.0, abs=1e-9)


def test_bodies_are_joined_as_pinocchio_adds_inertias() -> None:
    rng = np.random.default_rng(4)

    def body() -> tuple[Link, pin.Inertia]:
        found = pin.Inertia.Random()
        m, c, i = found.mass, found.lever, found.inertia
        return Link("l", m, tuple(c.tolist()), (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])), found

    for _ in range(5):
        pin.seed(int(rng.integers(1000)))
        (a, pin_a), (b, pin_b), (c, pin_c) = body(), body(), body()
        found, expected = combined_body(a, [b, c]), pin_a + pin_b + pin_c
        xx, yy, zz, xy, xz, yz = found.inertia
        assert found.mass == pytest.approx(expected.mass)
        assert np.allclose(found.com, expected.lever, atol=1e-13)
        assert np.allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], expected.inertia, atol=1e-12)
