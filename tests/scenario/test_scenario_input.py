"""Scenarios that cannot be used: file, key, value and what is allowed are said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.errors import InputError
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.simulation.run import run_scenario

DURATION = "duration = 0.1\n"
MOTION = "[motion]\ntype = 'point_to_point'\n"

READING = [  # what the reader refuses, whatever the robot: text, place, reason
    ("", "the key 'duration' is missing", "a time in s"),
    ("duration = 0", "duration", "got 0; allowed: a number that is at least 1e-09"),
    ("duration = 'long'", "duration", "got 'long'; allowed: a number that is at least 1e-09"),
    ("duration = nan", "duration", "got nan; allowed: a number that is at least 1e-09"),
    ("duration = 1\ndurations = 2", "", "unknown key 'durations'; did you mean 'duration'?"),
    ("duration = = 1", "", "not valid TOML"),
    (DURATION + "output_step = -1", "output_step", "got -1"),
    (DURATION + "frame = 3", "frame", "got 3; allowed: a string"),
    (DURATION + "initial = 3", "initial", "got 3; allowed: a table"),
    (DURATION + "[initial]\nq = [1.0]", "initial.q", "a table of numbers"),
    (DURATION + "[initial]\nq = { a = 'x' }", "initial.q.a", "got 'x'; allowed: a finite number"),
    (DURATION + "[initial]\nq = { 'a b' = 1 }", "initial.q", "got the name 'a b'"),
    (DURATION + "[initial]\nequilibrium = 1", "initial.equilibrium", "got 1; allowed: true or false"),
    (DURATION + "[initial]\nequilibrium = true\nv = { a = 1 }", "initial.v", "state of rest"),
    (DURATION + "[initial]\nheld = ['a']", "initial.held", "with equilibrium = true only"),
    (DURATION + "[motion]\ngoal = [1]", "motion", "the key 'type' is missing; allowed: point_to_point"),
    (DURATION + "[motion]\ntype = 'spiral'", "motion.type", "got 'spiral'"),
    (DURATION + MOTION + "points = [[1]]", "motion", "unknown key 'points'"),
    (DURATION + MOTION + "goal = ['x']", "motion.goal.0", "got 'x'"),
    (DURATION + MOTION + "duration = 0", "motion.duration", "got 0"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1]]\nspeed = 1", "motion.points", "two or more"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]", "motion", "times or speed"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]\ntimes = [1, 1]", "motion.times", "increasing"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]\ntimes = [1]", "motion.times", "an array of 2 numbers"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]\nspeed = 0", "motion.speed", "greater than 0"),
    (
        DURATION + "[motion]\ntype = 'sampled'\nfile = 'm.txt'",
        "motion.file",
        "got 'm.txt'; allowed: the path of a .csv",
    ),
    (DURATION + "[motion]\ntype = 'sampled'\nfile = 'm.csv'", "motion.file", "does not exist"),
    (DURATION + "[motion]\ntype = 'line'\nfrom = [0, 0, 1]", "motion", "the key 'to' is missing"),
    (DURATION + "[motion]\ntype = 'line'\nfrom = [0, 0, 1]\nto = [0, 0, 1]", "motion.to", "another point"),
    (
        DURATION + "[motion]\ntype = 'circle'\ncenter = [0, 0, 0]\nnormal = [0, 0, 1]\nfrom = [1, 0, 1]",
        "motion.from",
        "in the plane",
    ),
    (
        DURATION + "[motion]\ntype = 'circle'\ncenter = [0, 0, 0]\nnormal = [0, 0, 0]\nfrom = [1, 0, 1]",
        "motion.normal",
        "not zero",
    ),
    (DURATION + "[control]\ntype = 'lqr'", "control.type", "allowed: none, torque, pd, computed_torque"),
    (DURATION + "[control]\ntype = 'pd'\nkp = 1", "control", "the key 'kd' is missing"),
    (DURATION + "[control]\ntype = 'pd'\nkp = -1\nkd = 1", "control.kp", "at least 0"),
    (DURATION + "[control]\ntype = 'pd'\nkp = { a = -1 }\nkd = 1", "control.kp.a", "at least 0"),
    (DURATION + "[control]\ntype = 'computed_torque'\nbandwidth = 0", "control.bandwidth", "greater than 0"),
    (DURATION + "[control]\ntype = 'torque'\nrows = [[0, 1]]", "control", "coordinates with rows"),
    (DURATION + "[control]\ntype = 'torque'\ncoordinates = ['a']\nrows = [[0]]", "control.rows.0", "array of 2"),
    (DURATION + "[control]\ntype = 'torque'\ncoordinates = ['a']\nrows = []", "control.rows", "no rows"),
    (
        DURATION + "[control]\ntype = 'torque'\ncoordinates = ['a']\nrows = [[1, 1], [0, 1]]",
        "control.rows.1",
        "got the time 0 after 1",
    ),
    (DURATION + "[prescribed]\na = 1", "prescribed", "written [[prescribed]]"),
    (DURATION + "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'a'", "prescribed[0]", "'amplitude' is missing"),
    (DURATION + "[[wrenches]]\nlink = 'a'", "wrenches[0]", "needs force and/or moment"),
    (DURATION + "[[wrenches]]\nforce = [1, 2, 3]", "wrenches[0]", "'link' is missing"),
    (DURATION + "[[wrenches]]\nlink = 'a'\nforce = [1, 2]", "wrenches[0].force", "array of 3"),
    (DURATION + "[[wrenches]]\nlink = 'a'\nforce = [1, 2, 3]\naxes = 'tool'", "wrenches[0].axes", "base, link"),
    (DURATION + "[[wrenches]]\nlink = 'a'\nforce = [1, 2, 3]\nt0 = 2\nt1 = 1", "wrenches[0].t1", "after t0"),
    (DURATION + "[[payloads]]\nlink = 'a'\npoint = [0, 0, 0]\nmass = 0", "payloads[0].mass", "greater than 0"),
    (DURATION + "[[payloads]]\nlink = 'a'\nmass = 1", "payloads[0]", "'point' is missing"),
    (
        DURATION + "[[payloads]]\nlink = 'a'\nmass = 1\npoint = [0, 0, 0]\ninertia = { xx = 1, yy = 1, zz = 5 }",
        "payloads[0].inertia",
        "no body can have",
    ),
    (DURATION + "[integrator]\nmethod = 'euler'", "integrator.method", "got 'euler'"),
    (DURATION + "[integrator]\nrtol = 2", "integrator.rtol", "from 1e-13"),
]

MEETING = [  # what a robot cannot do: robot, text, place, reason
    ("one_link", "frame = 'hand'", "frame", "'hand' is unknown; known: tcp"),
    ("one_link", "[initial]\nq = { joint9 = 1 }", "initial.q.joint9", "did you mean 'joint1'"),
    ("one_link", "[initial]\nq = { joint1 = 1, joint1.gamma = 1 }", None, "not valid TOML"),
    ("one_link", "[initial]\nequilibrium = true\nheld = ['joint1.y']", "initial.held", "'joint1.y'"),
    ("one_link", MOTION + "goal = [1, 2]", "motion.goal", "expected 1 numbers (joint1.gamma), got 2"),
    ("one_link", MOTION + "goal = { joint1.x = 1 }", "motion.goal", "no principal coordinate"),
    ("puma560", MOTION + "goal = { joint2 = 3.0 }", "motion.goal", "joint2.gamma = 3 rad; its limits are"),
    ("one_link", MOTION + "begin = 1.0", "motion.begin", "got 1; allowed: before the end"),
    ("one_link", MOTION + "[control]\ntype = 'none'", "motion", "nothing follows it under control.type = 'none'"),
    ("one_link", "[motion]\ntype = 'via'\npoints = [[1], [1]]\nspeed = 1", "motion.points.1", "where the point before"),
    ("puma560", "[motion]\ntype = 'line'\nfrom = [9, 0, 0]\nto = [1, 0, 0]", "motion", "does not reach"),
    ("puma560", "[motion]\ntype = 'line'\nframe = 'hand'\nfrom = [9, 0, 0]\nto = [1, 0, 0]", "motion.frame", "'hand'"),
    ("one_link", "[control]\ntype = 'torque'\ncoordinates = ['joint7']\nrows = [[0, 1]]", "control", "'joint7'"),
    ("one_link", "[control]\ntype = 'pd'\nkp = { joint1.x = 1 }\nkd = 1", "control.kp.joint1.x", "is not driven"),
    ("one_link", "[[wrenches]]\nlink = 'link7'\nforce = [0, 0, 1]", "wrenches[0].link", "did you mean 'link1'"),
    ("one_link", "[[payloads]]\nlink = 'base'\nmass = 1\npoint = [0, 0, 0]", "payloads[0].link", "no moving link"),
    (
        "one_link",
        "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'joint1.x'\namplitude = 1\nfrequency = 1",
        "prescribed[0].coordinate",
        "no prescribed coordinate; allowed: none",
    ),
    (
        "shaken_arm",
        "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'mount.x'\namplitude = 1\nfrequency = 1",
        "prescribed",
        "mount.y, mount.z, mount.alpha, mount.beta, mount.gamma is not given",
    ),
    ("one_link", "[initial]\nequilibrium = true\nq = { joint1 = 0.3 }\n[integrator]\natol = -1", None, "atol"),
]


@pytest.mark.parametrize(("text", "place", "reason"), READING)
def test_reading(text: str, place: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    message = str(caught.value)
    at = re.fullmatch(r"[^:]*(:[0-9]+:[0-9]+)?: (.*)", message)
    assert at is not None
    assert message.startswith(str(path))
    assert at[1]
    assert at[2].startswith(place)
    assert reason in message


@pytest.mark.parametrize(("robot", "text", "place", "reason"), MEETING)
def test_meeting_a_robot(robot: str, text: str, place: str | None, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        run_scenario(eomgen.load_robot(robot), scenario_from_toml(DURATION + text, source="bad.toml"))
    assert re.match(rf"bad\.toml(:[0-9]+:[0-9]+)?: {re.escape(place or '')}", str(caught.value))
    assert reason in str(caught.value)


def test_names_that_are_given_twice() -> None:
    text = DURATION + "[initial]\nq = { joint1 = 1, 'joint1.gamma' = 1 }"
    with pytest.raises(InputError, match=r"bad.toml:[0-9:]* initial.q.joint1.gamma: joint1.gamma is given twice"):
        run_scenario(eomgen.load_robot("one_link"), scenario_from_toml(text, source="bad.toml"))
    shake = "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'mount.x'\namplitude = 1\nfrequency = 1\n"
    with pytest.raises(
        InputError, match=r"bad.toml:[0-9:]* prescribed\[1\].coordinate: the motion of mount.x is given before"
    ):
        run_scenario(eomgen.load_robot("shaken_arm"), scenario_from_toml(DURATION + 2 * shake, source="bad.toml"))
    text = DURATION + shake + "[initial]\nq = { mount.x = 1 }"
    with pytest.raises(InputError, match=r"prescribed"):
        run_scenario(eomgen.load_robot("shaken_arm"), scenario_from_toml(text, source="bad.toml"))


@pytest.mark.parametrize(
    ("csv", "reason"),
    [
        ("t,joint1.gamma\n0,1\n0,2\n", "line 3: column 't': 0 after 0; allowed: increasing times"),
        ("t,joint1.gamma\n0,x\n", "line 2: column 'joint1.gamma': 'x'; allowed: a finite number"),
        ("time,joint1.gamma\n0,1\n", "there is no column t"),
        ("t\n0\n", "allowed: t, and coordinates"),
        ("", "has no values"),
    ],
)
def test_tables_in_files(csv: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "u.csv").write_text(csv)
    with pytest.raises(InputError) as caught:
        scenario_from_toml(DURATION + "[control]\ntype = 'torque'\nfile = 'u.csv'", folder=tmp_path)
    assert str(caught.value).startswith(str(tmp_path / "u.csv"))
    assert reason in str(caught.value)


def test_samples_that_do_not_last(tmp_path: Path) -> None:
    t = np.linspace(0.0, 0.05, 11)
    np.savez(tmp_path / "s.npz", **{"t": t, **{f"mount.{c}": t for c in ("x", "y", "z", "alpha", "beta", "gamma")}})
    text = DURATION + "[[prescribed]]\ntype = 'sampled'\nfile = 's.npz'"
    with pytest.raises(InputError, match=r"prescribed\[0\].file: .* has 0 to 0.05 s; allowed: samples from 0 to"):
        run_scenario(eomgen.load_robot("shaken_arm"), scenario_from_toml(text, source="bad.toml", folder=tmp_path))


def test_no_equilibrium_is_said() -> None:
    robot = eomgen.robot.Robot(**{**vars(eomgen.load_robot("one_link")), "gravity": (0.0, 0.0, 0.0)})
    text = DURATION + "[initial]\nequilibrium = true"
    with pytest.raises(
        InputError, match=r"bad.toml:[0-9:]* initial: one_link: no static equilibrium: nothing holds joint1.gamma"
    ):
        run_scenario(robot, scenario_from_toml(text, source="bad.toml"))


def test_files_that_are_not_there() -> None:
    with pytest.raises(InputError, match=r"there is no scenario 'puma560_circel'; did you mean 'puma560_circle'"):
        load_scenario("puma560_circel")
    with pytest.raises(InputError, match=r"missing.toml: there is no such file; allowed: an existing .toml file"):
        load_scenario("missing.toml")


def test_robots_with_loops_are_refused() -> None:
    with pytest.raises(InputError, match="four_bar has loops"):
        run_scenario(eomgen.load_robot("four_bar"), scenario_from_toml(DURATION))


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s.toml"
    path.write_text(DURATION + "[initial]\nq = { joint1 = 0.3 }\n")
    out = ["-o", str(tmp_path / "out"), "--no-plots"]
    assert cli.main(["simulate", "one_link", "--scenario", str(path), *out]) == 0
    printed = capsys.readouterr().out
    assert "2 coordinates, no program, 0.1 s" in printed
    assert "energy: " in printed
    result = eomgen.load_result(tmp_path / "out" / "trajectory.npz")
    assert result.series("joint1.gamma").values[0] == 0.3
    assert cli.main(["simulate", "one_link", "--scenario", str(path), "--duration", "1", *out]) == 1
    assert "--duration: given together with --scenario" in capsys.readouterr().err
    path.write_text(DURATION + "[motion]\ntype = 'spiral'\n")
    assert cli.main(["simulate", "one_link", "--scenario", str(path), *out]) == 1
    assert "s.toml:3:8: motion.type: got 'spiral'" in capsys.readouterr().err
