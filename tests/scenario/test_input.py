"""Scenarios that cannot be used: file, key, value and what is allowed are said."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.support.bad_files import CIRCLE, DURATION, LINE, MOTION, SHAKEN
from tests.support.commands import command
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

SHAKE = "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'mount.x'\namplitude = 1\nfrequency = 1\n"
MEETING = [  # what a robot cannot do: robot, text, place, reason
    ("one_link", "frame = 'hand'", "frame", "'hand' is unknown; known: tcp"),
    ("one_link", "[initial]\nq = { joint9 = 1 }", "initial.q.joint9", "did you mean 'joint1'"),
    ("one_link", "[initial]\nq = { joint1 = 1, joint1.gamma = 1 }", None, "not valid TOML"),
    ("one_link", "[initial]\nequilibrium = true\nheld = ['joint1.y']", "initial.held", "'joint1.y'"),
    ("one_link", "[initial]\nz = { joint1.friction.z = 1 }", "initial.z.joint1.friction.z", "no law of one_link has a"),
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
        SHAKE.replace("mount", "joint1"),
        "prescribed[0].coordinate",
        "no prescribed coordinate; allowed: none",
    ),
    ("shaken_arm", SHAKE, "prescribed", "mount.y, mount.z, mount.alpha, mount.beta, mount.gamma is missing"),
    ("shaken_arm", 2 * SHAKE, "prescribed[1].coordinate", "the motion of mount.x is there already"),
    ("shaken_arm", SHAKE + "[initial]\nq = { mount.x = 1 }", "", "prescribed"),
    ("one_link", "[initial]\nq = { joint1 = 1, 'joint1.gamma' = 1 }", "initial.q.joint1.gamma", "stands twice"),
    ("one_link", "[initial]\nequilibrium = true\nq = { joint1 = 0.3 }\n[integrator]\natol = -1", None, "atol"),
]


@pytest.mark.parametrize(
    ("radians", "degrees"),
    [
        (CIRCLE + "angle = {!r}", CIRCLE + "angle_deg = 90"),
        (SHAKEN + "phase = {!r}", SHAKEN + "phase_deg = 90"),
        (LINE + "orientation = {{ from = [{!r}, 0, 0] }}", LINE + "orientation = {{ from_deg = [90, 0, 0] }}"),
    ],
)
def test_degrees_are_taken_for_radians(radians: str, degrees: str) -> None:
    texts = radians.format(math.pi / 2), degrees.format()
    by_radians, by_degrees = (scenario_from_toml(DURATION + text) for text in texts)
    assert by_degrees.motion == by_radians.motion
    assert by_degrees.prescribed == by_radians.prescribed


@pytest.mark.parametrize(("robot", "text", "place", "reason"), MEETING)
def test_meeting_a_robot(robot: str, text: str, place: str | None, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        run_scenario(eomgen.load_robot(robot), scenario_from_toml(DURATION + text, source="bad.toml"))
    assert re.match(rf"bad\.toml(:[0-9]+:[0-9]+)?: {re.escape(place or '')}", str(caught.value))
    assert reason in str(caught.value)


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
    said = r"bad.toml:[0-9:]* initial: one_link: no static equilibrium: nothing holds joint1.gamma"
    refused(InputError, said, run_scenario, robot, scenario_from_toml(text, source="bad.toml"))


def test_files_that_are_not_there() -> None:
    with pytest.raises(InputError, match=r"there is no scenario 'puma560_circel'; did you mean 'puma560_circle'"):
        load_scenario("puma560_circel")
    with pytest.raises(InputError, match=r"missing.toml: there is no such file; allowed: an existing .toml file"):
        load_scenario("missing.toml")


def test_command(tmp_path: Path) -> None:
    path, out = tmp_path / "s.toml", tmp_path / "out"
    path.write_text(DURATION + "[initial]\nq = { joint1 = 0.3 }\n")
    words = ("simulate", "one_link", "--scenario", path, "-o", out, "--no-plots")
    printed = command(*words)
    assert "2 coordinates, no reference, 0.1 s" in printed
    assert "energy: " in printed
    assert eomgen.load_result(out / "trajectory.npz").series("joint1.gamma").values[0] == 0.3
    assert "--duration: given together with --scenario" in command(*words, "--duration", 1, code=1)
    path.write_text(DURATION + "[motion]\ntype = 'spiral'\n")
    assert "s.toml:3:8: motion.type: got 'spiral'" in command(*words, code=1)
