"""Robots with values changed by dotted paths: every number of every kind, what follows from it, and what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError, InputError
from eomgen.robot.checks import check_values
from eomgen.robot.inertia_policy import link_sizes, lowest_moments
from eomgen.robot.parameter_names import following_modes
from eomgen.robot.record import record_of
from eomgen.robot.value import INERTIA_KEYS, Robot
from tests.support.bending_mixtures import mixture
from tests.support.every_element import ROBOTS, robot_with
from tests.support.many_robots import many_robot
from tests.support.random_robots import seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

ARM = """
name = "arm"
[[links]]
name = "upper_arm"
mass = 2.0
com = [0.1, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.02, zz = 0.02 }
[[joints]]
name = "shoulder"
parent = "base"
child = "upper_arm"
type = "revolute"
placement = { rpy = [0.1, 0.2, 0.3] }
limits = [-1.0, 1.0]
x = { stiffness = 1e5, clearance = 1e-3 }
"""


def bodily(robot: Robot, path: str, value: float) -> bool:
    """Whether a link with this number of its inertia is a body, or was none before."""
    link, key = robot.link(path.split(".")[1]), path.rpartition(".")[2]
    size = link_sizes({link.name: link}, robot.joints)[link.name]
    inertia = tuple(value if name == key else x for name, x in zip(INERTIA_KEYS, link.inertia, strict=True))
    before, after = (lowest_moments([x], [size])[0] for x in (link, replace(link, inertia=inertia)))
    return bool(before < 0.0 or after >= 0.0)


def check_every_number(robot: Robot, most: int = 30) -> None:
    before = dict(robot.numbers())
    told = [path for path, value in before.items() if value is not None]
    for path in np.random.default_rng(0).permutation(told)[:most].tolist():
        value = before[path]
        assert value is not None
        new = value * (1.0 + 1e-9) if value else 1e-12
        if following_modes(robot, (path,)) is not None:
            refused(DescriptionError, "it follows from the link's modes", robot.with_value, path, 1.1 * value or 0.1)
            continue
        if ".inertia." in path and not bodily(robot, path, new):
            refused(DescriptionError, "no body can have the inertia", robot.with_value, path, new)
            continue
        changed = robot.with_value(path, new)
        after = dict(changed.numbers())
        assert after[path] == new, path
        others = [key for key in before if key != path and after[key] != before[key]]
        assert all(key.endswith(("smoothing", "tracking_time")) for key in others), (path, others)
        assert others or changed.with_value(path, value) == robot, path


@pytest.mark.parametrize("name", ["worn_arm", "geared_arm", "balanced_arm", "gough", "two_arms", "one_link"])
def test_every_number_by_its_parameters_name(name: str) -> None:
    check_every_number(eomgen.load_robot(name))


@pytest.mark.parametrize("number", seeds(0, 4, 100))
def test_random_robots(number: int) -> None:
    check_every_number(many_robot(number))


@pytest.mark.parametrize("seed", seeds(0, 3, 60))
def test_robots_that_bend_are_changed_and_recorded(seed: int) -> None:
    """Whatever parts they have; and their records, as results keep them, are read as they were."""
    robot = mixture(seed).robot
    check_every_number(robot)
    check_values(robot)
    assert robot_from_record(json.loads(json.dumps(record_of(robot, whole=True))), robot.source) == robot


@pytest.mark.parametrize("most", [40, pytest.param(200, marks=pytest.mark.soak)])
def test_every_force_element(most: int) -> None:
    for family in ROBOTS:
        check_every_number(robot_from_toml(robot_with(family)), most)


def test_what_changes_with_a_value() -> None:
    robot = robot_from_toml(ARM)
    heavier = robot.with_value("links.upper_arm.mass", 3)
    assert (heavier.link("upper_arm").mass, robot.link("upper_arm").mass) == (3.0, 2.0)
    assert heavier.with_value("links.upper_arm.mass", np.float64(2.0)) == robot
    turned = robot.with_value("joints.shoulder.placement.rpy.2", 0.5)
    expected = robot_from_toml(ARM.replace("0.2, 0.3]", "0.2, 0.5]"))
    assert turned == expected
    wider = robot.with_value("joints.shoulder.x.clearance", 2e-3)
    assert wider == robot_from_toml(ARM.replace("clearance = 1e-3", "clearance = 2e-3"))
    both = robot.with_values({"gravity": [0.0, -9.81, 0.0], "home.shoulder.gamma": 0.25, "name": "other"})
    assert (both.name, both.gravity, dict(both.home)) == ("other", (0.0, -9.81, 0.0), {"shoulder.gamma": 0.25})
    assert robot.with_value("joints.shoulder.limits", (-2.0, 2.0)).joint("shoulder").limits == (-2.0, 2.0)
    assert robot.with_value("links.0.com", np.array([0.2, 0.0, 0.0])).link("upper_arm").com == (0.2, 0.0, 0.0)


def test_kernels_have_it() -> None:
    robot = eomgen.load_robot("one_link")
    q = [0.0, 0.3]
    kernel = eomgen.build(robot.with_value("links.link1.mass", 3.0))
    assert np.allclose(kernel.mass_matrix(q)[0, 0], 3.0 * eomgen.build(robot).mass_matrix(q)[0, 0])


def test_what_is_refused() -> None:
    robot = eomgen.load_robot("worn_arm")
    for path, message in (
        ("links.elbow.mass", r"there is no 'elbow' in links.*; known: "),
        ("links.upper.mas", r"there is no 'mas' in links\.upper; did you mean 'mass'\?; known: 'name', 'mass', 'com'"),
        ("joints.shoulder.x.stiffnes", r"did you mean 'stiffness'\?"),
        ("joint.shoulder", r"there is no 'joint'; did you mean 'joints'\?"),
        ("links.upper.mass.kg", r"links\.upper\.mass is .*, which has no parts"),
        ("joints.shoulder.motor.ratio", r"joints\.shoulder\.motor is not given; allowed: a value for it as a whole"),
        ("links.99.mass", r"there is no '99'"),
    ):
        refused(DescriptionError, message, robot.with_value, path.replace("upper", robot.links[0].name), 1.0)
    first = robot.links[0].name
    for value in (-1.0, math.nan, math.inf, "heavy", None, [1.0], True, {}, 10**400):
        with pytest.raises(DescriptionError, match=rf"with_value: links\.{first}\.mass = "):
            robot.with_value(f"links.{first}.mass", value)
    refused(DescriptionError, "no body can have the inertia", robot.with_value, f"links.{first}.inertia.xx", 1e3)
    with pytest.raises(DescriptionError, match=r"with_value: joints\.shoulder\.type = 'welded'"):
        robot.with_value("joints.shoulder.type", "welded")
    for path in ("", 3, None, Path("links")):
        with pytest.raises(InputError, match="is no path; allowed: names with dots"):
            robot.with_value(path, 1.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="allowed: a path and a value, or a mapping"):
        robot.with_values(3)  # type: ignore[arg-type]
