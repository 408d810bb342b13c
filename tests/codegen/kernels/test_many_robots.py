"""A thousand random robots of up to 36 coordinates: oracles, laws, and every form that the generator can choose."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.many_descriptions import check_descriptions
from tests.support.many_laws import CHECKS
from tests.support.many_oracles import check_forms, check_oracles
from tests.support.many_robots import FORMS, ROBOTS, Subject, many_robot, named, subject
from tests.support.soak import soaked

EVERYTHING: tuple[Callable[[Subject, Figures], None], ...] = (
    check_oracles,
    check_forms,
    check_descriptions,
    *CHECKS,
)
BLOCK = 20
QUICK = (9, 20, 29, 32, 55, 59, 62, 66)  # small ones, one of every form


def check(number: int, built: Build, figures: Figures, cache: Path) -> None:
    """Everything about one robot; what was compiled for it is removed."""
    robot = many_robot(number)
    with named(f"robot {number}"):
        s = subject(number, built)
        shutil.rmtree(cache)
        figures.count("robots")
        figures.count(f"robots, {s.form}")
        figures.count("states", len(s.q))
        figures.count("coordinates", s.model.size)
        for law in EVERYTHING:
            law(s, figures)
    assert s.robot == robot, "a check has changed the robot"


@pytest.mark.parametrize("number", soaked(QUICK, QUICK[::3]))
def test_a_few_robots(number: int, built: Build, figures: Figures, empty_cache: Path) -> None:
    check(number, built, figures, empty_cache)


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, ROBOTS, BLOCK))
def test_a_thousand_robots(first: int, built: Build, figures: Figures, empty_cache: Path) -> None:
    for number in range(first, first + BLOCK):
        check(number, built, figures, empty_cache)


@pytest.mark.soak
def test_the_thousand_have_all_that_there_is() -> None:
    """Sizes, branches, joints of 0 to 6 coordinates; and the quick ones have every form."""
    robots = [many_robot(number) for number in range(ROBOTS)]
    joints = [joint for robot in robots for joint in robot.joints]
    sizes = Counter(sum(len(joint.coordinates) for joint in robot.joints) for robot in robots)
    assert set(sizes) == set(range(1, 37))
    assert sizes[36] >= 5
    assert {len(joint.coordinates) for joint in joints} == set(range(7))
    assert {joint.type for joint in joints} == {"revolute", "prismatic", "fixed", "free"}
    branched = [len({joint.parent for joint in robot.joints}) < len(robot.joints) for robot in robots]
    assert 200 <= np.count_nonzero(branched) <= 600
    assert {number % len(FORMS) for number in QUICK} == set(range(len(FORMS)))
