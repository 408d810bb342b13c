"""Corrected programs: how near they bring the tool, what they leave and why, their files, and who is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import EomgenError, InputError, IntegrationError
from eomgen.identification import CompensationResult, accuracy, compensate, load_compensation
from eomgen.identification.compensating.bounds import within_limits
from eomgen.identification.compensating.reach import Reach
from eomgen.identification.compensating.result import HeldBack, Variant, sizes
from eomgen.identification.compensating.setting import Setting
from eomgen.identification.compensating.splines import Basis
from eomgen.motion.files import read_motion
from eomgen.motion.splines import Spline
from eomgen.motion.timetable import TimeTable
from eomgen.pictures import plot_compensation, report_of
from eomgen.robot.coordinates import FORCES
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.scenario.value import Initial, Integrator, Payload, Scenario, Section, Wrench
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.plan import plan_from_toml
from tests.support.commands import command, facts
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]

ARM = f"""
name = "arm"
{link_table("upper", 6.0, (0.2, 0.0, 0.0), (0.02, 0.1, 0.1))}
{link_table("fore", 3.0, (0.15, 0.0, 0.0), (0.01, 0.04, 0.04))}
{joint_table("shoulder", "base", "upper", "revolute")}
limits = [-1.6, 1.6]
placement = {{ rpy = [1.5707963267948966, 0.0, 0.0] }}
y = {{ stiffness = 1e6, damping = 800.0 }}
beta = {{ stiffness = 4e4, damping = 20.0 }}
{joint_table("elbow", "upper", "fore", "revolute")}
limits = [-2.5, 2.5]
placement = {{ xyz = [0.4, 0.0, 0.0] }}
y = {{ stiffness = 5e5, damping = 400.0 }}
{frame_table("tcp", "fore", (0.35, 0.0, 0.0))}
"""

SWING = f"""
name = "swing"
{link_table("beam", 2.0, (0.3, 0.0, 0.0), (0.001, 0.06, 0.06))}
{joint_table("hinge", "base", "beam", "revolute")}
placement = {{ rpy = [1.5707963267948966, 0.0, 0.0] }}
motor = {{ ratio = 50.0, inertia = 1e-4, stiffness = 5e3, damping = 10.0 }}
{frame_table("tip", "beam", (0.6, 0.0, 0.0))}
"""

REACH = """
duration = 0.5
output_step = 2e-3
[motion]
type = "point_to_point"
start = { shoulder = 0.4, elbow = -1.0 }
goal = { shoulder = 0.9, elbow = -0.5 }
duration = 0.35
"""
PD = """
[control]
type = "pd"
kp = { shoulder = 4000.0, elbow = 1500.0 }
kd = { shoulder = 150.0, elbow = 40.0 }
"""
PLANE = {"z": 0.0, "rx": 0.0, "ry": 0.0, "rz": 0.0}  # what two joints cannot do besides


@pytest.fixture(scope="module")
def arm() -> Robot:
    return robot_from_toml(ARM)


@pytest.fixture(scope="module")
def reach() -> Scenario:
    return scenario_from_toml(REACH)


@pytest.fixture(scope="module")
def found(arm: Robot, reach: Scenario) -> CompensationResult:
    return compensate(arm, reach, weights=PLANE, robustness=0.2, draws=2)


def test_tool_comes_where_the_rigid_one_would(found: CompensationResult) -> None:
    before, after = sizes(found.before), sizes(found.after)
    assert before[1][0] > 300e-6
    assert after[1][0] < 2e-6
    assert found.gain == pytest.approx(before[0][0] / after[0][0])
    assert found.gain > 100.0
    assert min(found.history) < 0.01 * found.history[0]
    assert found.rank == (2, 2)
    assert np.abs(found.corrected - found.program).max() < 2e-3  # it is a correction, not another way


def test_stiffness_that_is_wrong_leaves_a_quarter_at_most(found: CompensationResult) -> None:
    """Deflections go with 1 / k: of 1 / 0.8 and 1 / 1.2 of them one is taken, which leaves a fifth of each."""
    assert [item.label for item in found.robustness[:2]] == ["-20 %", "+20 %"]
    assert len(found.robustness) == 4
    assert min(item.gain for item in found.robustness) >= 4.0
    soft, stiff = found.robustness[:2]
    rms = sizes(found.before)[0][0]
    assert soft.position_before == pytest.approx(rms / 0.8, rel=0.02)
    assert stiff.position_before == pytest.approx(rms / 1.2, rel=0.02)
    assert soft.gain == pytest.approx(5.0, rel=0.05)


def test_scenario_that_is_written_does_the_same(found: CompensationResult, arm: Robot, tmp_path: Path) -> None:
    """Its simulation is compared with the wanted program; between the samples, too, the tool is there."""
    written = found.to_scenario(tmp_path / "better.toml")
    assert [path.name for path in written] == ["better.csv", "better_wanted.csv", "better.toml"]
    scenario = load_scenario(tmp_path / "better.toml")
    result = eomgen.run_scenario(arm, replace(scenario, output_step=1e-3))
    assert result.tool == found.frame == "tcp"
    turned = np.swapaxes(result.program_pose[:, :3, :3], 1, 2)
    off = (turned @ result.tool_deviation[..., np.newaxis])[..., 0]
    assert np.abs(off - found.after[:, :3]).max() < 5e-8  # where the profile sets in, its spline is off by as much
    assert "a compensated path" in " ".join(result.notes)
    assert np.abs(result.program_q[::2] - found.program).max() < 1e-12

    motion = read_motion(tmp_path / "better.csv", build_model(arm).coordinates)
    assert motion.measured == found.coordinates
    columns = [motion.coordinates.index(name) for name in motion.measured]
    assert np.array_equal(motion.q[:, columns], found.corrected)
    slopes = np.gradient(found.corrected, found.t, axis=0)[2:-2]
    assert np.abs(motion.v[2:-2, columns] - slopes).max() < 1e-3 * np.abs(motion.v).max()
    assert np.abs(motion.v[[0, -1]]).max() < 1e-4 * np.abs(motion.v).max()  # it rests at both ends


def test_motion_that_stops_is_taken_up_with_a_shorter_step(
    arm: Robot, reach: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, whole = [], Setting.run

    def run(self: Setting, samples: Array | None, parameters: dict[str, float] | None = None) -> SimulationResult:
        calls.append(samples)
        if len(calls) == 1:
            raise IntegrationError("it diverges")
        return whole(self, samples, parameters)

    monkeypatch.setattr(Setting, "run", run)
    found = compensate(arm, reach, weights=PLANE, iterations=4, step=4e-3)
    assert len(found.history) == 4
    assert found.gain > 10.0
    first, second = (x - found.program for x in calls[:2] if x is not None)
    assert np.abs(second - 0.5 * first).max() < 1e-12


def test_first_sample_is_in_balance(found: CompensationResult) -> None:
    """The sag at the start is corrected before anything moves: nothing swings in from there."""
    assert np.linalg.norm(found.before[0, :2]) > 100e-6
    assert np.linalg.norm(found.after[:20, :2], axis=1).max() < 0.5e-6


@pytest.mark.soak
def test_rest_states_are_corrected_without_a_simulation(arm: Robot, reach: Scenario) -> None:
    """A robot that stands at a corrected sample has its tool where the rigid one would have it."""
    still = compensate(arm, reach, weights=PLANE, mode="static", step=4e-3)
    moved = compensate(arm, reach, weights=PLANE, mode="static", accelerations=True, step=4e-3)
    assert still.history == ()
    before, static, whole = (sizes(x)[0][0] for x in (still.before, still.after, moved.after))
    assert static < 0.65 * before  # the motion is quick
    assert whole < 0.3 * static
    assert sizes(still.after[-20:])[0][0] < 0.1 * sizes(still.before[-20:])[0][0]  # where it stands again
    for i in (30, 125):
        q = dict(zip(still.coordinates, still.corrected[i].tolist(), strict=True))
        stands = {"start": q, "goal": q}
        scenario = Scenario(0.01, output_step=0.01, motion=Section("point_to_point", stands))
        there = eomgen.run_scenario(arm, scenario).pose[0]
        program = dict(zip(still.coordinates, still.program[i].tolist(), strict=True))
        rigid = eomgen.run_scenario(
            arm, replace(scenario, motion=Section("point_to_point", {"start": program, "goal": program}))
        )
        assert np.linalg.norm(there[:3, 3] - rigid.program_pose[0, :3, 3]) < 1e-9
        assert np.linalg.norm(rigid.pose[0, :3, 3] - rigid.program_pose[0, :3, 3]) > 50e-6


def test_what_drives_cannot_reach_is_named(arm: Robot, reach: Scenario) -> None:
    """Two joints in a plane do not correct a push across it, nor turns and places at once."""
    push = Wrench("fore", TimeTable(FORCES, np.zeros(1), np.array([[0.0, 20.0, 0.0, 0.0, 0.0, 0.0]]), True))
    found = compensate(arm, replace(reach, wrenches=(push,)), iterations=6)
    assert found.rank == (2, 2)
    assert found.shares[2] == pytest.approx(1.0)
    assert found.shares[3] == pytest.approx(1.0)
    assert sum(found.shares) == pytest.approx(4.0, abs=0.01)
    figures = found.figures()
    assert figures["z"]["before_rms"] > 50e-6
    assert figures["z"]["after_rms"] == pytest.approx(figures["z"]["before_rms"], rel=0.05)
    assert figures["z"]["beyond_rms"] == pytest.approx(figures["z"]["after_rms"], rel=0.05)
    assert "z: 100 % of it cannot be corrected" in "\n".join(found.lines())


@pytest.mark.soak
def test_limits_hold_corrections_back(reach: Scenario) -> None:
    upper = -0.4999999  # rad: where the program goes, and the sagging arm would have to go further
    text = ARM.replace("limits = [-2.5, 2.5]", f"limits = [-2.5, {upper}]")
    found = compensate(robot_from_toml(text), reach, weights=PLANE, iterations=8)
    assert found.corrected[:, 1].max() <= upper + 1e-12
    (held,) = found.limits
    assert held.coordinate == "elbow.gamma"
    assert 0.05 < held.seconds < 0.5
    assert held.position > 20e-6
    assert "limits hold elbow.gamma back" in "\n".join(found.lines())
    assert sizes(found.after)[0][0] < sizes(found.before)[0][0]


def test_rates_and_drives_have_limits(arm: Robot, reach: Scenario, found: CompensationResult) -> None:
    rates = np.abs(np.gradient(found.program, found.t, axis=0)).max(axis=0)
    limit = float(rates[0])  # which the program needs itself
    slow = compensate(arm, reach, weights=PLANE, rates={"shoulder": limit}, iterations=4)
    fine = Basis(slow.t, 125, (False, False))
    reached = fine.rates @ fine.fit(slow.corrected)
    assert np.abs(reached[:, 0]).max() <= limit * 1.0001
    lagging = scenario_from_toml(REACH + PD)
    strong = compensate(arm, lagging, weights=PLANE, mode="static", step=4e-3)
    weak = compensate(arm, lagging, weights=PLANE, mode="static", step=4e-3, drives={"elbow": 11.595})
    assert any("limits of drives ('elbow.gamma') leave" in note for note in weak.notes)
    peaks = [elbow_peak(arm, lagging, x) for x in (weak.program, weak.corrected, strong.corrected)]
    assert peaks[0] < peaks[1] < 11.5951 < 11.6 < peaks[2]
    assert 0.0 < np.abs(weak.corrected - weak.program).max() < np.abs(strong.corrected - strong.program).max()


def elbow_peak(robot: Robot, scenario: Scenario, samples: Array) -> float:
    """The greatest torque of the elbow along samples, N m."""
    program = Spline(np.linspace(0.0, scenario.duration, len(samples)), samples, at_rest=False)
    result = eomgen.run_scenario(robot, replace(scenario, motion=Section("program", {"program": program})))
    return float(np.abs(result.series("elbow.gamma.drive").values).max())


def test_pd_drives_that_lag_and_sag() -> None:
    """A law kp e + kd e' needs an error to do anything: the program goes where that is the error that it needs."""
    robot = robot_from_toml(ARM)
    found = compensate(robot, scenario_from_toml(REACH + PD), weights=PLANE)
    assert sizes(found.before)[1][0] > 5e-3
    assert sizes(found.after)[1][0] < 20e-6


@pytest.mark.soak
def test_motor_behind_a_transmission() -> None:
    """What is programmed is the joint, measured and driven is the motor: the spring's wind-up is corrected."""
    robot = robot_from_toml(SWING)
    for mode, gain, duration in (("dynamic", 50.0, 0.5), ("static", 5.0, 2.0)):
        motion = 'output_step = 5e-3\n[motion]\ntype = "point_to_point"\ngoal = { hinge = 0.5 }\n'
        scenario = scenario_from_toml(f"duration = {duration}\n{motion}")
        found = compensate(robot, scenario, mode=mode, robustness=0.2, draws=0)
        assert sizes(found.before)[1][0] > 500e-6
        assert found.rank == (1, 1)
        assert found.gain > gain
        assert min(item.gain for item in found.robustness) >= 3.0


@pytest.mark.soak
def test_joint_in_its_play_goes_with_the_program() -> None:
    """Where nothing loads a gear with backlash, its joint has no state of rest of its own."""
    upright = SWING.replace("placement = { rpy = [1.5707963267948966, 0.0, 0.0] }", "")
    robot = robot_from_toml(upright.replace("damping = 10.0 }", "damping = 10.0, clearance = 2e-4 }"))
    scenario = scenario_from_toml(
        'duration = 0.5\noutput_step = 0.02\n[motion]\ntype = "point_to_point"\ngoal = { hinge = 0.5 }\n'
    )
    found = compensate(robot, scenario, mode="static")
    assert np.abs(found.corrected - found.program).max() < 1e-9
    assert sizes(found.after)[1][0] == pytest.approx(sizes(found.before)[1][0], rel=0.01)


def test_sweeps_compare_with_what_is_wanted(found: CompensationResult, arm: Robot, tmp_path: Path) -> None:
    found.to_scenario(tmp_path / "better.toml")
    vary = '[[vary]]\nparameter = "joints.elbow.y.stiffness"\nuniform = { low = 1.0, high = 1.0001 }\nrelative = true\n'
    plan = plan_from_toml("samples = 2\nseed = 1\n" + vary)
    cycles = accuracy(robot=arm, scenario=str(tmp_path / "better.toml"), plan=plan)
    assert len(cycles.poses) == 1
    assert cycles.poses[0].accuracy < 1e-6
    assert max(path.accuracy for path in cycles.paths) < 2e-6


def test_a_saved_result_has_a_page(found: CompensationResult, tmp_path: Path) -> None:
    """Errors by axis in um, what is out of reach, other robots."""
    command("report", found.save(tmp_path / "found.npz"))
    page = report_of(found)
    assert (tmp_path / "found.html").read_text() == page.html()
    tables = {table.title: {row[0]: row[1:] for row in table.rows} for table in page.tables}
    rms = found.figures()["position"]["after_rms"]
    assert float(tables["Errors of the tool, um and urad"]["position"][2]) == pytest.approx(1e6 * rms, rel=1e-3)
    assert len(tables["Other robots, rms of position"]) == len(found.robustness)


def test_results_are_saved_and_load_again(found: CompensationResult, tmp_path: Path) -> None:
    again = load_compensation(found.save(tmp_path / "found.npz"))
    assert again.lines() == found.lines()
    assert again.as_dict() == json.loads(json.dumps(found.as_dict()))
    assert np.array_equal(again.corrected, found.corrected)
    assert again.scenario.as_dict() == found.scenario.as_dict()
    again.to_scenario(tmp_path / "again.toml")
    found.to_scenario(tmp_path / "found.toml")
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "found.csv").read_bytes()
    refused(InputError, r"allowed: a path that ends in \.npz", found.save, tmp_path / "found.json")
    refused(InputError, r"allowed: a path that ends in \.toml", found.to_scenario, tmp_path / "found.csv")
    np.savez(tmp_path / "other.npz", t=np.zeros(3))
    refused(InputError, "is no result of the kind compensation", load_compensation, tmp_path / "other.npz")
    arrays = dict(np.load(tmp_path / "found.npz"))
    np.savez(tmp_path / "short.npz", **{**arrays, "after": arrays["after"][:5]})
    refused(InputError, r"array after has shape \(5, 6\)", load_compensation, tmp_path / "short.npz")


def test_everything_of_a_scenario_is_written(found: CompensationResult, tmp_path: Path) -> None:
    """What a file says of loads, drives, initial state and integration comes out of it again."""
    (tmp_path / "shake.csv").write_text("t,platform.x\n0.0,0.0\n1.0,0.1\n", encoding="ascii")
    table = TimeTable(FORCES, np.array([0.0, 0.2]), np.arange(12.0).reshape(2, 6), False)
    harmonic = {"amplitude": 0.1, "frequency": 2.0, "phase": 0.0, "offset": 0.0}
    whole = Scenario(
        1.0,
        output_step=2e-3,
        frame="tcp",
        initial=Initial({"joint1.x": 1e-4}, {}, True, ("joint1.x",)),
        control=Section("pd", {"kp": {"joint1": 4000.0, "joint2.gamma": 1.5}, "kd": 3.0, "gravity": True}),
        prescribed=(
            Section("harmonic", {"coordinate": "platform.y", **harmonic}),
            Section("sampled", {"file": str(tmp_path / "shake.csv")}),
        ),
        wrenches=(Wrench("fore", table, "link", (0.1, 0.0, 0.0), 0.1, 0.3), Wrench("fore", table)),
        payloads=(Payload("fore", 2.0, (0.1, 0.0, 0.0), (0.01, 0.02, 0.02, 0.0, 0.0, 0.0), 0.2, 0.4),),
        until=Section("coordinate", {"coordinate": "joint1", "value": 0.3}),
        integrator=Integrator("scipy:Radau", 1e-8, 1e-9, 1e-3),
    )
    replace(found, scenario=whole).to_scenario(tmp_path / "whole.toml")
    again = load_scenario(tmp_path / "whole.toml").as_dict()
    motion = again.pop("motion")
    assert motion["type"] == "sampled"
    assert again == whole.as_dict()


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(ARM, encoding="ascii")
    Path("reach.toml").write_text(REACH, encoding="ascii")
    words = ("compensate", "arm.toml", "--weights", "z=0", "rx=0", "ry=0", "rz=0", "--scenario")
    out = command(*words, "reach.toml", "--iterations", 5, "--write-scenario", "new.toml", "-o", "new.npz")
    assert "position [um]" in out
    values = facts(*words, "reach.toml", "--iterations", 5, "-o", "new.svg")
    assert values["errors"]["position"]["after_peak"] < 10e-6
    assert values["rank"] == [2, 2]
    assert "before, um" in Path("new.svg").read_text(encoding="utf-8")
    saved = load_compensation("new.npz")
    assert saved.gain == pytest.approx(values["gain"])
    assert plot_compensation(saved, tmp_path / "again.svg").read_bytes() == Path("new.svg").read_bytes()
    second = facts(*words, "new.toml", "--iterations", 1)  # one that is corrected already
    left = values["errors"]["position"]["after_rms"]
    assert second["errors"]["position"]["before_rms"] == pytest.approx(left, rel=1e-3)


LINE = "duration = 0.5\n[motion]\ntype = 'line'\nfrom = [0.5, 0.0, 0.0]\nto = [2.0, 0.0, 0.0]"
RIGID = re.sub(r"^(y|beta) = .*\n", "", ARM, flags=re.M)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": "tpc"}, "frame: 'tpc' is unknown"),
        ({"mode": "fast"}, "mode: 'fast' is unknown; allowed: static, dynamic"),
        ({"weights": {"w": 1.0}}, "weights: 'w'.*allowed: x, y, z, rx, ry, rz"),
        ({"weights": {"x": -1.0}}, "weights: x = -1.0; allowed: 0, or a number from"),
        ({"weights": dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 0.0)}, "weights: all are 0"),
        ({"rates": {"wrist": 1.0}}, "rates: 'wrist' is not driven"),
        ({"rates": {"elbow": 0.0}}, "rates: elbow = 0.0; allowed: a number from 1e-30"),
        ({"drives": {"elbow.y": 1.0}}, "drives: 'elbow.y' is not driven"),
        ({"robustness": 1.5}, "robustness: 1.5; allowed: a share between 0 and 1"),
        ({"draws": -1}, "draws: -1"),
        ({"iterations": 0}, "iterations: 0; allowed: 1 or more"),
        ({"step": 0.2}, "step: .* allowed: 24 to 100000"),
        ({"robot": "four_bar"}, "four_bar: has loops or couplings"),
        ({"robot": RIGID}, "arm: no joint deviates.*nothing to correct"),
        ({"scenario": "duration = 0.5"}, "nothing is programmed"),
        ({"scenario": REACH + "[control]\ntype = 'none'"}, "nothing follows"),
        ({"scenario": LINE}, "motion: .*line"),
    ],
)  # fmt: skip
def test_refusals(change: dict[str, Any], message: str) -> None:
    given = {"robot": ARM, "scenario": REACH, **change}
    robot = given.pop("robot")
    scenario = scenario_from_toml(given.pop("scenario"))
    with pytest.raises(EomgenError, match=message):
        compensate(robot if robot == "four_bar" else robot_from_toml(robot), scenario, **given)


def test_wanted_motion_of_a_closed_robot_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("t,joint1.gamma\n0.0,0.0\n1.0,0.1\n", encoding="ascii")
    text = 'duration = 1.0\n[motion]\ntype = "sampled"\nfile = "m.csv"\nwanted = "m.csv"\n'
    with pytest.raises(InputError, match=r"motion\.wanted: four_bar has loops or couplings"):
        eomgen.run_scenario("four_bar", scenario_from_toml(text, folder=tmp_path))
    with pytest.raises(InputError, match=r"wanted.*which does not exist"):
        scenario_from_toml(text.replace('wanted = "m', 'wanted = "n'), folder=tmp_path)


def test_reach_splits_errors() -> None:
    """A part that changes undo to first order, and one that none does; together they are the error."""
    rng = np.random.default_rng(5)
    slopes, error = rng.normal(size=(4, 6, 3)), rng.normal(size=(4, 6))
    weights = np.array([1.0, 2.0, 1.0, 0.1, 0.0, 0.3])
    reach = Reach(slopes, weights)
    left = error + (slopes @ reach.undoing(error)[..., np.newaxis])[..., 0]
    assert np.abs(weights * (left - reach.beyond(error))).max() < 1e-2 * np.abs(error).max()
    systems = zip(slopes, error, strict=True)
    best = np.array([np.linalg.lstsq(weights[:, None] * A, -weights * e, rcond=None)[0] for A, e in systems])
    assert np.abs(reach.undoing(error) - best).max() < 0.02 * np.abs(best).max()
    assert reach.beyond(error)[:, 4] == pytest.approx(0.0)
    assert reach.rank == (3, 3)
    assert reach.shares.sum() == pytest.approx(3.0, abs=0.01)


def test_held_back_corrections_have_no_kink(found: CompensationResult) -> None:
    """Up to most of the room nothing is changed; beyond, the limit is never passed, and curvature stays continuous."""

    class Room:
        limits = np.array([[-1.0, 0.1]])
        rates = np.array([np.inf])
        original = np.zeros((2001, 1))

    given = np.linspace(-0.5, 0.5, 2001)[:, np.newaxis]
    taken = within_limits(Room(), given)
    small = np.abs(given) < 0.08
    assert np.array_equal(taken[small], given[small])
    assert taken.max() <= 0.1
    assert taken[-1] == pytest.approx(0.1, rel=1e-3)
    assert np.abs(np.diff(taken[:, 0], 2)).max() < 45.0 * (given[1, 0] - given[0, 0]) ** 2


def test_splines_rest_at_their_ends() -> None:
    t = np.linspace(0.0, 2.0, 201)
    free, resting = Basis(t, 10, (False, False)), Basis(t, 10, (True, True))
    samples = np.sin(t)[:, np.newaxis]
    assert np.abs(free.values @ free.fit(samples) - samples).max() < 1e-5
    fitted = resting.fit(samples)
    assert np.abs((resting.rates @ fitted)[[0, -1]]).max() < 1e-9
    assert free.values.shape[1] - resting.values.shape[1] == 2


def test_parts_of_a_result() -> None:
    assert Variant("x", 2.0, 1.0, 0.5, 1.0).gain == 4.0
    assert vars(HeldBack("a", 1.0, 2.0, 3.0))["seconds"] == 1.0
    error = np.zeros((2, 6))
    error[0] = [3.0, 4.0, 0.0, 0.0, 0.0, 1.0]
    assert sizes(error) == ((pytest.approx(np.sqrt(12.5)), pytest.approx(np.sqrt(0.5))), (5.0, 1.0))


@pytest.mark.soak
def test_puma_of_the_demo() -> None:
    """The demo's tool is 95 um off; with its program corrected it is less than 2 um off, and that is no luck."""
    found = compensate("puma560_elastic", robustness=0.2)
    assert sizes(found.before)[1][0] > 90e-6
    assert sizes(found.after)[1][0] < 2e-6
    assert min(item.gain for item in found.robustness) >= 4.0
