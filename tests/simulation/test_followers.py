"""Simulations of robots some of whose coordinates follow others: where they start, what stops them, what is kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.robot import Coupling, Robot, build_model, record_of, robot_hash
from eomgen.scenario import scenario_from_toml
from eomgen.simulation.result import SimulationResult

pytestmark = pytest.mark.usefixtures("unoptimised")

LINK = "mass = 0.5\ncom = [0.1, 0.0, 0.02]\ninertia = { xx = 0.01, yy = 0.02, zz = 0.02 }\n"
HAND = f"""
name = "hand"
home = {{ "two.gamma" = 0.4 }}
driven = ["two.gamma"]
[[links]]
name = "first"
{LINK}
[[links]]
name = "second"
{LINK}
[[joints]]
name = "one"
parent = "base"
child = "first"
type = "revolute"
limits = [-1.0, 2.0]
gamma = {{ damping = 0.1 }}
[[joints]]
name = "two"
parent = "first"
child = "second"
type = "revolute"
limits = [-0.8, 0.8]
placement = {{ xyz = [0.2, 0.0, 0.0], rpy = [1.2, 0.0, 0.0] }}
gamma = {{ damping = 0.2, armature = 0.02, stops = {{ lower = -0.6, upper = 0.6, stiffness = 1e3, damping = 1.0 }} }}
[[couplings]]
name = "gear"
of = "two.gamma"
to = {{ "one.gamma" = -0.8 }}
offset = 0.1
"""
FREE = '[control]\ntype = "none"\n[initial]\nequilibrium = false\n'


@pytest.fixture(scope="module")
def hand() -> Robot:
    return robot_from_toml(HAND)


@pytest.fixture(scope="module")
def stopped(hand: Robot, unoptimised: None) -> SimulationResult:
    """A motion in which the follower comes to its stop."""
    text = f"duration = 0.3\n{FREE}q = {{ one = 0.4 }}\nv = {{ one = 3.0 }}\n"
    return eomgen.run_scenario(hand, scenario_from_toml(text))


def test_home_drives_and_limits_of_followers_are_those_of_their_leaders(hand: Robot) -> None:
    model = build_model(hand)
    assert model.coordinates == ("one.gamma",)
    assert model.home == pytest.approx([(0.4 - 0.1) / -0.8])
    assert model.driven == (0,)
    assert eomgen.motion.principal_limits(hand, "one.gamma") == pytest.approx(((0.8 - 0.1) / -0.8, 0.9 / 0.8))
    with pytest.raises(
        DescriptionError, match=r"home\.two\.gamma: got 0\.4, but it follows 'one\.gamma'; allowed: 0\.1"
    ):
        build_model(replace(hand, home={"one.gamma": 0.0, "two.gamma": 0.4}))
    result = eomgen.simulate(hand, duration=0.05)
    assert result.trajectory.coordinates == ("one.gamma",)
    assert result.trajectory.q[0] == pytest.approx(model.home)


def test_followers_come_to_their_stops_and_energy_balances(stopped: SimulationResult, tmp_path: Path) -> None:
    found = stopped.trajectory.contacts
    assert [(x.coordinate, x.kind, x.side, x.closes) for x in found[:1]] == [("two.gamma", "stop", -1, True)]
    q = np.interp(found[0].t, stopped.trajectory.t, stopped.trajectory.q[:, 0])
    assert 0.1 - 0.8 * q == pytest.approx(-0.6, abs=1e-3)
    assert stopped.balance is not None
    assert stopped.balance.relative_residue <= 1e-4
    stopped.save(tmp_path / "result.npz")
    assert eomgen.load_result(tmp_path / "result.npz").trajectory.contacts == found


@pytest.mark.parametrize("said", ["q = { two = 0.1 }", 'q = { "two.gamma" = 0.1 }', "v = { two = 0.1 }"])
def test_scenarios_that_name_followers_are_refused(said: str, hand: Robot) -> None:
    scenario = scenario_from_toml(f"duration = 0.1\n{FREE}{said}\n")
    with pytest.raises(
        DescriptionError, match=r"two\.gamma follows 'one\.gamma' by the coupling gear and is no independent coordinate"
    ):
        eomgen.run_scenario(hand, scenario)


@pytest.mark.soak
def test_results_that_have_followers_are_refused_by_name(hand: Robot, tmp_path: Path) -> None:
    """As results were written when followers were coordinates."""
    old = eomgen.run_scenario(hand.with_constraints(), scenario_from_toml(f"duration = 0.01\n{FREE}"))
    replace(old, description=record_of(hand), robot_hash=robot_hash(hand)).save(tmp_path / "old.npz")
    with pytest.raises(InputError, match=r"list of coordinates .* \('two\.gamma' follows others by couplings"):
        eomgen.load_result(tmp_path / "old.npz")


def test_deviations_that_follow_what_drives_move_are_refused() -> None:
    """The rigid robot, which drives know, is held where a deviation is none; free motions need no drive."""
    robot = eomgen.load_robot("one_link")
    tied = replace(robot, couplings=(Coupling("tie", "joint1.x", {"joint1.gamma": 0.1}),))
    assert build_model(tied).coordinates == ("joint1.gamma",)
    with pytest.raises(
        InputError, match=r"one_link: without deviations, .* coupling 'tie' ties .*allowed: control\.type"
    ):
        eomgen.simulate(tied, duration=0.01)
    found = eomgen.run_scenario(tied, scenario_from_toml(f"duration = 0.01\n{FREE}"))
    assert found.trajectory.q.shape[1] == 1
