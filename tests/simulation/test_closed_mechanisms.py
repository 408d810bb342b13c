"""Simulations of mechanisms with loops and of followers: drives, controls, loads, tool paths, rest, stops."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.description import robot_from_toml
from eomgen.errors import DescriptionError, InputError, IntegrationStopped, LoopError
from eomgen.kernel.stepping.methods import IN_C
from eomgen.robot import Coupling, build_model, record_of, robot_hash
from eomgen.robot.value import Coordinate, Robot
from eomgen.scenario import scenario_from_toml
from eomgen.simulation.assembly import kernels_of
from eomgen.simulation.result import SimulationResult, load_result
from eomgen.simulation.run import run_scenario
from tests.loops.test_closing import GEARED
from tests.runtime.test_inverse_kinematics import SPLIT_ARM
from tests.support.commands import command
from tests.support.joint_table import joint_table, link_table
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = [pytest.mark.usefixtures("unoptimised")]


def run(robot: Robot | str, text: str) -> SimulationResult:
    found = eomgen.load_robot(robot) if isinstance(robot, str) else robot
    return run_scenario(found, scenario_from_toml(text))


def with_coordinate(robot: Robot, joint: str, name: str, given: Coordinate, label: str) -> Robot:
    joints = [
        replace(x, coordinates={**x.coordinates, name: given}) if x.name.startswith(joint) else x for x in robot.joints
    ]
    return replace(robot, name=label, joints=tuple(joints))


def follows(result: SimulationResult, within: float = 1e-7) -> None:
    """Closed, balanced, and where the program of its drives leads."""
    assert result.trajectory.info["gap"] <= 1e-11
    assert result.balance.relative_residue <= 1e-5
    assert np.abs(result.tool_deviation).max() <= within


@pytest.mark.parametrize("name", soaked(["four_bar", "bennett", "gough"], ["four_bar"]))
def test_drives_move_from_home_and_the_rest_follows(name: str) -> None:
    robot = eomgen.load_robot(name)
    result = eomgen.simulate(name, duration=0.5)
    follows(result)
    assert result.program_coordinates == robot.driven
    home = [robot.home.get(x, 0.0) for x in result.trajectory.coordinates]
    assert np.abs(result.trajectory.q[0] - home).max() <= 1e-9
    assert np.abs(result.tracking_error).max() <= 1e-6
    others = {x for x in result.trajectory.coordinates if x not in result.program_coordinates}
    assert set(result.passive) == others
    assert result.deviation_coordinates == ()
    idle = [result.trajectory.coordinates.index(x) for x in result.passive]
    assert (result.trajectory.u[:, idle] == 0.0).all()


@pytest.mark.soak
def test_a_robot_whose_loops_need_deviations_moves_freely() -> None:
    """There are no equations of its rigid robot, which nothing but drives and references take."""
    robot = robot_from_toml(SPLIT_ARM)
    result = run(robot, "duration = 0.02\n[initial]\nv = {'joint1.gamma' = 1.0}")
    assert result.program_coordinates == ("joint1.gamma",)
    assert result.passive == ()
    assert result.trajectory.q[-1, 0] == pytest.approx(0.02, rel=1e-5)
    with pytest.raises(DescriptionError, match="do not move against each other"):
        run(robot, "duration = 0.02\n[motion]\ntype = 'point_to_point'")


def test_stiff_cut_joints_are_integrated_implicitly() -> None:
    """Also where the joints of the tree are rigid: a cut joint without a rigid coordinate is one more spring."""
    robot, scenario = eomgen.load_robot("four_bar"), scenario_from_toml("duration = 1.0")
    (loop,) = robot.loops
    coordinates = {x: Coordinate(stiffness=1e8, damping=1e3) for x in ("x", "y", "z", "alpha", "beta")}
    elastic = replace(robot, loops=(replace(loop, coordinates=coordinates),))
    assert "adaptive_rollout" in kernels_of(elastic, scenario)
    implicit = scenario_from_toml("duration = 1.0\n[integrator]\nmethod = 'scipy:Radau'")
    assert "residual_jacobian" in kernels_of(elastic, implicit)
    assert "residual_jacobian" not in kernels_of(replace(robot, loops=()), scenario)


def test_the_work_of_a_drive_at_default_tolerances() -> None:
    table = "duration = 0.4\n[control]\ntype = 'torque'\ncoordinates = ['joint1']\nrows = [[0.0, 20.0], [0.4, 20.0]]\n"
    result = run("four_bar", table)
    assert result.balance.of("drives")[-1] >= 300.0
    assert result.balance.relative_residue <= 1e-5


def test_pd_control_holds_against_gravity() -> None:
    text = "duration = 0.2\n[control]\ntype = 'pd'\nkp = 200.0\nkd = 20.0\ngravity = true\n"
    still = run("four_bar", text)
    assert np.ptp(still.trajectory.q, axis=0).max() <= 1e-6
    sagging = run("four_bar", text.replace("gravity = true\n", "[initial]\nequilibrium = true\n"))
    assert 1e-4 < abs(sagging.trajectory.q[0, 0] - 1.0) < 0.1
    assert np.ptp(sagging.trajectory.q, axis=0).max() <= 1e-6  # it starts in balance


@pytest.mark.soak
def test_tools_of_platforms_follow_lines_and_circles() -> None:
    line = run("gough", "duration = 0.5\n[motion]\ntype = 'line'\nfrom = [0.0, 0.0, 1.1]\nto = [0.1, 0.05, 1.0]\n")
    follows(line)
    assert np.abs(line.pose[-1, :3, 3] - [0.1, 0.05, 1.0]).max() <= 1e-7
    text = "center = [0.0, 0.0, 1.1]\nnormal = [0, 0, 1.0]\nfrom = [0.1, 0, 1.1]\n"
    circle = run("gough", f"duration = 0.5\n[motion]\ntype = 'circle'\n{text}")
    follows(circle)
    assert np.abs(np.hypot(*circle.pose[:, :2, 3].T) - 0.1).max() <= 1e-6
    with pytest.raises(eomgen.EomgenError, match=r"tcp does not reach \(0, 0, 3\) m"):
        run("gough", "duration = 0.5\n[motion]\ntype = 'line'\nfrom = [0.0, 0.0, 3.0]\nto = [0.1, 0.05, 1.0]\n")


@pytest.mark.soak
def test_wrenches_and_payloads_on_a_platform() -> None:
    push = "[[wrenches]]\nlink = 'platform'\nt0 = 0.02\nt1 = 0.05\nforce = [50.0, 0, 0]\n"
    body = "[[payloads]]\nlink = 'platform'\nmass = 5.0\npoint = [0.0, 0.0, 0.1]\nt0 = 0.06\n"
    result = run("gough", f"duration = 0.1\n{push}{body}[control]\ntype = 'computed_torque'\n")
    assert result.balance.relative_residue <= 1e-4
    assert abs(result.balance.of("wrenches")[-1]) > 0.0
    assert result.trajectory.info["gap"] <= 1e-11
    assert 1e-5 < np.abs(result.tool_deviation).max() < 1e-2


def shaken() -> Robot:
    robot = eomgen.load_robot("four_bar")
    return with_coordinate(robot, "joint3", "x", Coordinate(prescribed=True), "shaken_bars")


SHAKE = "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'joint3.x'\namplitude = 0.02\nfrequency = 4.0\n"


def test_a_shaken_pivot_does_work_on_a_driven_linkage() -> None:
    result = run(shaken(), f"duration = 0.4\n{SHAKE}[motion]\ntype = 'point_to_point'\n")
    follows(result)
    moved = result.trajectory.of("joint3.x")
    assert np.abs(moved - 0.02 * np.sin(8.0 * np.pi * result.trajectory.t)).max() == 0.0
    assert abs(result.balance.of("prescribed")).max() > 1e-3


def test_prescribed_motions_that_open_a_loop_are_refused() -> None:
    far = SHAKE.replace("0.02", "0.9")
    with pytest.raises(LoopError, match=r"shaken_bars: loop joint4 comes open: joint4\.x .* allowed: .* at t = 0\.0"):
        run(shaken(), f"duration = 0.4\n{far}[motion]\ntype = 'point_to_point'\n")
    with pytest.raises(IntegrationStopped, match="loop joint4 comes open"):
        run(shaken(), f"duration = 0.4\n{far}[control]\ntype = 'none'\n[integrator]\nmethod = 'rk4'\n")


@pytest.mark.soak
def test_elastic_legs_deviate_from_the_rigid_mechanism() -> None:
    soft = Coordinate(stiffness=1e6, damping=1e2)
    robot = with_coordinate(eomgen.load_robot("gough"), "leg", "x", soft, "soft_legs")
    result = run(robot, "duration = 0.1\n[motion]\ntype = 'point_to_point'\n")
    follows(result, within=1e-4)
    assert set(result.deviation_coordinates) == {f"leg{i}.x" for i in range(1, 7)}
    assert 1e-7 < np.abs(result.deviations).max() < 1e-3


@pytest.mark.soak
@pytest.mark.parametrize("rigid", [("z", "alpha", "beta"), pytest.param((), marks=pytest.mark.soak)])
def test_elastic_cut_joints(rigid: tuple[str, ...]) -> None:
    robot = eomgen.load_robot("four_bar")
    soft = {name: Coordinate(stiffness=1e6, damping=1e2) for name in ("x", "y", "z", "alpha", "beta")}
    cut = replace(robot.loops[0], coordinates={name: soft[name] for name in soft if name not in rigid})
    soft_cut = replace(robot, name=f"soft_cut{len(rigid)}", loops=(cut,))
    result = run(soft_cut, "duration = 0.1\n[motion]\ntype = 'point_to_point'\n")
    assert result.trajectory.method in IN_C
    assert result.balance.relative_residue <= 1e-5
    assert 1e-7 < np.abs(result.tool_deviation).max() < 1e-3


@pytest.mark.soak
def test_geared_coordinates_follow_their_drive() -> None:
    geared = robot_from_toml(GEARED)
    motion = "duration = 0.2\n[motion]\ntype = 'point_to_point'\n"
    result = run(geared.with_constraints(), motion)
    follows(result)
    assert np.abs(result.trajectory.of("b.gamma") + 2.0 * result.trajectory.of("a.gamma")).max() <= 1e-12
    led = run(geared, motion)
    assert led.trajectory.coordinates == ("a.gamma",)
    assert np.abs(led.trajectory.of("a.gamma") - result.trajectory.of("a.gamma")).max() <= 1e-6  # of other steps
    assert led.trajectory.u[0, 0] == pytest.approx(result.trajectory.u[0].sum(), rel=1e-12)  # b has no drive


def test_drives_that_do_not_hold_or_contradict_are_refused() -> None:
    robot, many = eomgen.load_robot("gough"), replace(eomgen.load_robot("four_bar"), driven=None)
    programmed, head = "duration = 0.1\n[motion]\ntype = 'point_to_point'\n", "duration = 0.1\n[control]\ntype = "
    start = "'none'\n[initial]\nq = { joint1 = 0.3, joint3 = 0.1 }\n"
    loose = r"not held by drives at .*: leg6\.z stays loose; allowed: .* all 6 freedoms"
    opens = r"joint4 opens on the reference at t = .*: joint3\.gamma is off by .*; allowed"
    for other, text, message in (
        (replace(robot, driven=robot.driven[:5]), programmed, loose),
        (many, programmed, opens),
        ("four_bar", head + start, "joint4 does not close near the guess"),
    ):
        refused(LoopError, message, run, other, text)
    held = run(many, head + "'computed_torque'\n")
    assert np.count_nonzero(np.abs(held.trajectory.u[0]) > 1e-6) == 3  # the least drives share the load


def test_command(tmp_path: Path) -> None:
    said = command("simulate", "four_bar", "--duration", 0.2, "-o", tmp_path, "--no-plots")
    assert "four_bar: 3 coordinates, 1 of them driven" in said
    loaded = eomgen.load_result(tmp_path / "trajectory.npz")
    assert loaded.passive == ("joint2.gamma", "joint3.gamma")
    assert loaded.trajectory.info["gap"] <= 1e-11
    assert loaded.summary()["gap"] == loaded.trajectory.info["gap"]


CRANKED = "duration = 0.5\noutput_step = 1e-3\n[control]\ntype = 'torque'\ncoordinates = ['joint1']\n"
CRANKED += "rows = [[0.0, 15.0], [0.5, -15.0]]\n"


def crossings(deviation: NDArray[np.float64], clearance: float) -> list[tuple[int, bool]]:
    """Between which samples a deviation passes an end of its clearance, and whether it closes it."""
    beyond = np.abs(deviation) > clearance
    return [(int(i), bool(beyond[i + 1])) for i in np.flatnonzero(beyond[1:] != beyond[:-1])]


@pytest.mark.soak
@pytest.mark.parametrize("place", ["joint3.gamma", pytest.param("joint4.x", marks=pytest.mark.soak)])
def test_contacts_in_joints_of_a_loop(place: str, tmp_path: Path) -> None:
    """Found in the tree and in a cut joint where the deviation says so, in the result, and in its file."""
    robot = eomgen.load_robot("four_bar")
    if place == "joint4.x":
        stop, (loop,) = Coordinate(stiffness=1e5, damping=100.0, clearance=2e-3, smoothing=2e-4), robot.loops
        robot = replace(robot, loops=(replace(loop, coordinates={"x": stop}),), name="loose_bars")
    else:
        stop = Coordinate(stiffness=2000.0, damping=1.0, clearance=1.7, smoothing=1e-2)
        robot = with_coordinate(robot, "joint3", "gamma", stop, "stopped_bars")
    result = run(robot, CRANKED)
    motion, kernel = result.trajectory, eomgen.build(robot)
    cut = place in kernel.cut_laws
    deviation = kernel.functions.cut_forces(motion.q, motion.v)[:, 0, 0] if cut else motion.of(place)
    expected = crossings(deviation, stop.clearance)
    assert {contact.coordinate for contact in motion.contacts} == {place}
    assert len(motion.contacts) >= len(expected) >= 2
    for i, closes in expected:
        assert any(motion.t[i] <= x.t <= motion.t[i + 1] and x.closes == closes for x in motion.contacts)
    for contact in motion.contacts:
        assert (contact.rate * contact.side > 0.0) == contact.closes
    again = load_result(result.save(tmp_path / "run.npz"))
    assert again.trajectory.contacts == motion.contacts
    assert any(f"clearance of {place}: closed" in line for line in again.summary_lines())


# Followers


HAND = f"""
name = "hand"
home = {{ "two.gamma" = 0.4 }}
driven = ["two.gamma"]
{link_table("first", 0.5, (0.1, 0.0, 0.02), (0.01, 0.02, 0.02))}
{link_table("second", 0.5, (0.1, 0.0, 0.02), (0.01, 0.02, 0.02))}
{joint_table("one", "base", "first", "revolute")}
limits = [-1.0, 2.0]
gamma = {{ damping = 0.1 }}
{joint_table("two", "first", "second", "revolute")}
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
    said = r"home\.two\.gamma: got 0\.4, but it follows 'one\.gamma'; allowed: 0\.1"
    refused(DescriptionError, said, build_model, replace(hand, home={"one.gamma": 0.0, "two.gamma": 0.4}))
    result = eomgen.simulate(hand, duration=0.05)
    assert result.trajectory.coordinates == ("one.gamma",)
    assert result.trajectory.q[0] == pytest.approx(model.home)


def test_followers_come_to_their_stops_and_energy_balances(stopped: SimulationResult, tmp_path: Path) -> None:
    found = stopped.trajectory.contacts
    assert [(x.coordinate, x.kind, x.side, x.closes) for x in found[:1]] == [("two.gamma", "stop", -1, True)]
    q = np.interp(found[0].t, stopped.trajectory.t, stopped.trajectory.q[:, 0])
    assert 0.1 - 0.8 * q == pytest.approx(-0.6, abs=1e-3)
    assert stopped.balance.relative_residue <= 1e-4
    stopped.save(tmp_path / "result.npz")
    assert eomgen.load_result(tmp_path / "result.npz").trajectory.contacts == found


@pytest.mark.parametrize("said", ["q = { two = 0.1 }", 'q = { "two.gamma" = 0.1 }', "v = { two = 0.1 }"])
def test_scenarios_that_name_followers_are_refused(said: str, hand: Robot) -> None:
    scenario = scenario_from_toml(f"duration = 0.1\n{FREE}{said}\n")
    refusal = r"two\.gamma follows 'one\.gamma' by the coupling gear and is no independent coordinate"
    refused(DescriptionError, refusal, eomgen.run_scenario, hand, scenario)


@pytest.mark.soak
def test_results_that_have_followers_are_refused_by_name(hand: Robot, tmp_path: Path) -> None:
    """As results were written when followers were coordinates."""
    old = eomgen.run_scenario(hand.with_constraints(), scenario_from_toml(f"duration = 0.01\n{FREE}"))
    with pytest.raises(InputError, match=r"list of coordinates .* \('two\.gamma' follows others by couplings"):
        replace(old, description=record_of(hand), robot_hash=robot_hash(hand)).save(tmp_path / "old.npz")


def test_deviations_that_follow_what_drives_move_are_refused() -> None:
    """The rigid robot, which drives know, is held where a deviation is none; free motions need no drive."""
    robot = eomgen.load_robot("one_link")
    tied = replace(robot, couplings=(Coupling("tie", "joint1.x", {"joint1.gamma": 0.1}),))
    assert build_model(tied).coordinates == ("joint1.gamma",)
    said = r"one_link: without deviations, .* coupling 'tie' ties .*allowed: control\.type"
    refused(InputError, said, eomgen.simulate, tied, duration=0.01)
    found = eomgen.run_scenario(tied, scenario_from_toml(f"duration = 0.01\n{FREE}"))
    assert found.trajectory.q.shape[1] == 1
