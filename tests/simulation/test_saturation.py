"""Scenarios whose drives are clipped at the efforts of their robot: C beside Python, energy, notes, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, IntegrationError
from eomgen.export.live.acting import acting_on
from eomgen.progress import no_progress
from eomgen.robot.bounds import Limits
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.scenario.value import Scenario
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

ARM = """
name = "arm"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "link1"
mass = 2.0
com = [0.3, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.1, zz = 0.1 }
[[links]]
name = "link2"
mass = 1.0
com = [0.3, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.1, zz = 0.1 }
[[joints]]
name = "joint1"
parent = "base"
child = "link1"
type = "revolute"
y = { stiffness = 2e4, damping = 20.0 }
gamma = { limits = { velocity = 1e3, effort = 12.0 } }
[[joints]]
name = "joint2"
parent = "link1"
child = "link2"
type = "revolute"
placement = { xyz = [0.6, 0.0, 0.1] }
gamma = { friction = { coulomb = 0.1 } }
motor = { inertia = 1e-4, ratio = -50.0, stiffness = 2e3, damping = 1.0, limits = { effort = 0.08 } }
"""
CONTROLS = {
    "computed": "type = 'computed_torque'",
    "pd": "type = 'pd'\nkp = 300\nkd = 20\ngravity = true",
    "torque": "type = 'torque'\ncoordinates = ['joint1', 'joint2']\nrows = [[0, 0, 0], [0.1, 30, -0.2], [0.4, -30, 0]]",
}


def scenario(control: str, method: str = "auto", saturate: str = "saturate = true") -> Scenario:
    motion = (
        ""
        if "torque'" in control and "computed" not in control
        else ("[motion]\ntype = 'point_to_point'\nstart = [0.0, 0.0]\ngoal = [-0.8, 0.4]\n")
    )
    integrator = f"[integrator]\nmethod = '{method}'\nrtol = 1e-7\n"
    start = "[initial]\nequilibrium = false\n"
    return scenario_from_toml(
        f"duration = 0.5\noutput_step = 0.005\n{start}{motion}[control]\n{control}\n{saturate}\n{integrator}"
    )


def drives(result: SimulationResult) -> np.ndarray:
    """The largest drives of joint1 and of joint2's motor."""
    names = result.trajectory.coordinates
    index = [names.index("joint1.gamma"), names.index("joint2.motor")]
    return np.asarray(np.abs(result.trajectory.u[:, index]).max(axis=0))


@pytest.mark.parametrize("control", soaked(CONTROLS, ("pd",)))
def test_drives_are_clipped_in_c_and_in_python(control: str) -> None:
    """By the same amounts, at the joint and at a motor behind a gear, and the energy balances."""
    robot = robot_from_toml(ARM)
    by_c = run_scenario(robot, scenario(CONTROLS[control]))
    by_python = run_scenario(robot, scenario(CONTROLS[control], "BDF"))
    free = run_scenario(robot, scenario(CONTROLS[control], saturate=""))
    assert drives(free)[0] > 12.5
    assert drives(by_c)[0] == drives(by_python)[0] == 12.0
    assert drives(by_c)[1] <= 0.08
    size = np.abs(by_c.trajectory.q - free.trajectory.q).max()
    assert size > 1e-2
    assert np.abs(by_c.trajectory.q - by_python.trajectory.q).max() < 1e-3 * size
    for result in (by_c, by_python):
        assert result.balance is not None
        assert result.balance.relative_residue < 1e-4
        assert not any("exceeds limits" in note for note in result.notes)
        (note,) = [note for note in result.notes if "clipped" in note]
        assert "joint1.gamma at 12 N m, " in note
    (note,) = [note for note in free.notes if "exceeds limits" in note]
    assert "joint1.gamma effort" in note
    assert "(limit 12)" in note
    assert not any("clipped" in note for note in free.notes)


@pytest.mark.soak
def test_what_cannot_be_clipped_is_named() -> None:
    weak = robot_from_toml(ARM.replace(", effort = 12.0", "").replace(", limits = { effort = 0.08 }", ""))
    with pytest.raises(DescriptionError, match=r"control\.saturate: no drive has a limit of its effort; allowed: a"):
        run_scenario(weak, scenario(CONTROLS["pd"]))
    closed = _limited(replace(eomgen.load_robot("four_bar"), driven=("joint1.gamma", "joint2.gamma")))
    kernel = eomgen.build(closed)
    q = kernel.assemble([closed.home.get(name, 0.0) for name in kernel.coordinates])
    closed = replace(closed, home=dict(zip(kernel.coordinates, q.tolist(), strict=True)))
    text = "duration = 0.02\n[control]\ntype = 'computed_torque'\n"
    assert run_scenario(closed, scenario_from_toml(text)).trajectory.t[-1] == 0.02
    with pytest.raises(DescriptionError, match=r"control\.saturate: .* are more drives than the 1 freedoms of"):
        run_scenario(closed, scenario_from_toml(f"{text}saturate = true\n"))


def test_drives_too_weak_for_the_start_are_named() -> None:
    """Joint 1 bears (2 0.3 + 1 0.9) 9.81 N m at rest, stretched out; joint 2 can hold its link."""
    whole = scenario(CONTROLS["computed"])
    message = (
        r"no static equilibrium within the efforts of its drives: joint1\.gamma would have to do 14\.7\d? N m, its"
    )
    with pytest.raises(IntegrationError, match=message) as raised:
        run_scenario(robot_from_toml(ARM), replace(whole, initial=None))
    assert "joint2" not in str(raised.value)
    strong = robot_from_toml(ARM.replace("effort = 12.0", "effort = 15.0"))
    assert run_scenario(strong, replace(whole, initial=None)).trajectory.u[0, 1] == pytest.approx(14.715, rel=1e-3)


def _limited(robot: Robot) -> Robot:
    joints = tuple(
        joint.with_limits("gamma", Limits(effort=5.0)) if "gamma" in joint.coordinates else joint
        for joint in robot.joints
    )
    return replace(robot, joints=joints)


def test_a_page_does_not_clip() -> None:
    with pytest.raises(InputError, match=r"saturate: drives that are clipped are not in a page; allowed: without"):
        acting_on(robot_from_toml(ARM), scenario(CONTROLS["pd"]), "link2", no_progress, [])
