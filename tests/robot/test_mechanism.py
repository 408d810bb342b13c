"""Drives and home of a description."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.analysis.holding import pose_of
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.motion.ends import default_motion
from eomgen.robot.model import build_model, movable_coordinates, program_coordinates, rigid_coordinates
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Robot
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import random_robot

pytestmark = pytest.mark.usefixtures("unoptimised")

ARM = """
name = "arm"
{top}
[[links]]
name = "upper"
mass = 1.0
[[links]]
name = "fore"
mass = 1.0
[[joints]]
name = "shoulder"
parent = "base"
child = "upper"
type = "revolute"
limits = [-1.0, 2.0]
motor = {{ inertia = 1e-4, ratio = 50.0, stiffness = 1e4 }}
alpha = {{ stiffness = 1e5 }}
[[joints]]
name = "elbow"
parent = "upper"
child = "fore"
type = "revolute"
beta = {{ stiffness = 1e5 }}
[[joints]]
name = "shaft"
parent = "base"
child = "hub"
type = "revolute"
prescribed = ["gamma"]
[[links]]
name = "hub"
mass = 1.0
"""


def read(top: str = "") -> Robot:
    return robot_from_toml(ARM.format(top=top))


def driven(robot: Robot) -> list[str]:
    model = build_model(robot)
    return [model.coordinates[i] for i in model.driven]


def test_drives_are_the_named_ones_through_their_motors() -> None:
    assert driven(read()) == ["shoulder.motor", "elbow.gamma"]
    assert driven(read('driven = ["shoulder.gamma"]')) == ["shoulder.motor"]
    assert driven(read('driven = ["elbow.gamma", "shoulder.motor"]')) == ["shoulder.motor", "elbow.gamma"]
    assert driven(read('driven = ["elbow.beta"]')) == ["elbow.beta"]
    assert driven(read("driven = []")) == []


def test_the_rigid_robot_keeps_the_drives_that_move() -> None:
    robot = read('driven = ["elbow.beta", "shoulder.motor"]\nhome = { shoulder.gamma = 0.5, elbow.beta = 1e-3 }')
    assert robot.rigid().driven == ("shoulder.gamma",)
    assert dict(robot.rigid().home) == {"shoulder.gamma": 0.5}
    assert driven(robot.rigid()) == ["shoulder.gamma"]
    assert read().rigid().driven is None


@pytest.mark.parametrize("seed", range(20))
def test_the_rigid_robot_s_coordinates_are_those_of_its_model(seed: int) -> None:
    for robot in (random_robot(seed), mechanism(seed).robot, mechanism(seed + 20).robot):
        if not rigid_coordinates(robot):
            with pytest.raises(DescriptionError, match="no active coordinate"):
                build_model(robot.rigid())
            continue
        model = build_model(robot.rigid())
        assert rigid_coordinates(robot) == model.coordinates
        moving = [i for i in range(len(model.coordinates)) if i not in model.prescribed]
        assert movable_coordinates(robot) == tuple(model.coordinates[i] for i in moving)
        driven = model.driven if robot.is_closed else moving
        assert program_coordinates(robot) == tuple(model.coordinates[i] for i in driven)


def test_home_of_coordinates_and_of_motors() -> None:
    model = build_model(read('home = { "shoulder.gamma" = 0.5, elbow = { gamma = -0.25 } }'))
    assert dict(zip(model.coordinates, model.home, strict=True)) == {
        "shoulder.alpha": 0.0,
        "shoulder.gamma": 0.5,
        "shoulder.motor": 25.0,
        "elbow.beta": 0.0,
        "elbow.gamma": -0.25,
        "shaft.gamma": 0.0,
    }
    turned = build_model(read('home = { "shoulder.motor" = 3.0, "shaft.gamma" = 1.0 }'))
    assert turned.home == (0.0, 0.0, 3.0, 0.0, 0.0, 1.0)


def test_default_motions_begin_at_home() -> None:
    robot = read('home = { "shoulder.gamma" = 1.9 }')
    names = ("shoulder.gamma", "elbow.gamma")
    motion = default_motion(robot, 1.0, names)
    assert motion.start.tolist() == [1.9, 0.0]
    assert -1.0 <= motion.goal[0] < 1.9
    assert default_motion(read(), 1.0, names).start.tolist() == [0.0, 0.0]


def test_records_keep_the_drives_and_the_home() -> None:
    hashes = set()
    for top in ("", "driven = []", 'driven = ["elbow.gamma"]', 'home = { "elbow.gamma" = 1.0 }'):
        robot = read(top)
        assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
        hashes.add(robot_hash(robot))
    assert len(hashes) == 4
    assert {"driven", "home"}.isdisjoint(record_of(read()))


@pytest.mark.parametrize(
    ("top", "message"),
    [
        (
            'driven = ["elbow"]',
            r"line 3, column \d+: driven: there is no coordinate 'elbow'; did you mean 'elbow\.beta'",
        ),
        ('driven = ["elbow.x"]', r"driven: there is no coordinate 'elbow\.x'.*\(allowed: 'shoulder\.alpha', 'should"),
        ('driven = ["shaft.gamma"]', r"driven: the motion of 'shaft\.gamma' is prescribed; allowed: coordinates that"),
        ('driven = ["elbow.gamma", "elbow.gamma"]', r"driven: 'elbow\.gamma' is there twice; allowed: one name for"),
        (
            'driven = ["shoulder.motor", "shoulder.gamma"]',
            r"'shoulder\.motor' drives 'shoulder\.gamma', too; allowed: ",
        ),
        ('driven = "elbow.gamma"', r"driven: got 'elbow\.gamma'; allowed: an array of strings"),
        ('home = { "elbow.x" = 1.0 }', r"home: there is no coordinate 'elbow\.x'.*\(allowed: 'shoulder\.alpha', "),
        (
            'home = { "shoulder.gamma" = 2.5 }',
            r"home\.shoulder\.gamma: got 2\.5; allowed: within the limits, -1 to 2 ra",
        ),
        ('home = { "elbow.gamma" = inf }', r"home\.elbow\.gamma: got inf; allowed: a finite number"),
        ("home = 3", r"home: got 3; allowed: a table of numbers by joint or coordinate"),
    ],
)
def test_bad_drives_and_homes(top: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        read(top)


def test_a_robot_made_in_python_is_looked_at_too() -> None:
    for bad in (replace(read(), driven=("nothing.x",)), replace(read(), home={"nothing.x": 1.0})):
        with pytest.raises(DescriptionError, match=r"there is no coordinate 'nothing\.x'"):
            build_model(bad)


def test_poses_begin_at_home() -> None:
    robot = replace(eomgen.load_robot("one_link"), home={"joint1.gamma": 0.3})
    kernel = eomgen.build(robot)
    assert pose_of(robot, kernel, None) == pytest.approx([0.0, 0.3])
    assert pose_of(robot, kernel, {}) == pytest.approx([0.0, 0.3])
    assert np.array_equal(pose_of(robot, kernel, {"joint1": 0.1}), [0.0, 0.1])
