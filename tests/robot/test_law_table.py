"""The table of laws is whole: what is on an entry, and what others have to have for it."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.forces.internal_states.formulas import STATE_FORMULAS
from eomgen.codegen.forces.laws import GROUPS
from eomgen.description.keys import COORDINATE, MOTOR_FORM
from eomgen.errors import DescriptionError
from eomgen.export.fmu.variables import UNITS, exponents, unit_name
from eomgen.forms.keys import Either
from eomgen.forms.tables import Few, Sub
from eomgen.robot.elements import Spring
from eomgen.robot.internal_states.branches import BRANCHES, branch_conflict
from eomgen.robot.internal_states.bristles import bristle_conflict
from eomgen.robot.internal_states.drives import DRIVE
from eomgen.robot.laws import BASIC, LAWS, NUMBERS, SHAPED
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import least_of, number_of
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Coordinate, Friction, Joint, Link, Robot
from eomgen.runtime.internal_states import BOUNDS, split_state
from tests.oracles.force_laws import KINDS, random_coordinate, with_laws
from tests.support.bristles import servo_arm, stateful_arm, stateful_linkage
from tests.support.random_robots import random_robot

ROOT = Path(__file__).parents[2]


def test_every_law_has_a_formula() -> None:
    formulas = {name for group in GROUPS for name in group}
    assert formulas | STATE_FORMULAS.keys() | {DRIVE} == LAWS.keys()  # a drive is an element by itself
    assert {law for law in LAWS if LAWS[law].states} == STATE_FORMULAS.keys() | {DRIVE}


@pytest.mark.parametrize("name", LAWS)
def test_every_law_has_texts_units_and_keys(name: str) -> None:
    law = LAWS[name]
    assert bool(law.about) == law.has_table
    assert bool(law.instead) == bool(law.excludes)
    assert set(law.absorbs) | set(law.excludes) <= {*LAWS, *NUMBERS, *(number.key for number in BASIC)}
    page = (ROOT / "docs" / "description.md").read_text(encoding="utf-8")
    for form in (COORDINATE, MOTOR_FORM):
        inner = form.keys
        if law.has_table:
            table = form.keys[name]
            assert table.about == law.about
            listed = table.options[0] if isinstance(table, Either) else table  # an array of tables, or one
            assert isinstance(listed, (Few, Sub))
            inner = listed.inner.keys  # type: ignore[union-attr]
        for number in law.numbers:
            key = number.key.rpartition(".")[2] if name == BRANCHES else number.key.removeprefix(f"{name}.")
            assert number.about
            if number.key in SHAPED:  # a word of the key shape stands for it
                assert key in json.dumps(inner["shape"].schema())
                assert f'shape = "{key}"' in page
                continue
            *tables, last = key.split(".")
            keys = inner
            for outer in tables:
                deeper = keys[outer]
                assert isinstance(deeper, Sub)
                keys = deeper.inner.keys  # type: ignore[union-attr]
            assert number.about in json.dumps(keys[last].schema(), ensure_ascii=False)
            for part in (*tables, last):
                assert part in page, f"docs/description.md does not name {part}"
    for number in law.numbers:
        assert len(number.unit) == 2
        assert all(unit_name(unit) in UNITS for unit in number.unit)


def test_every_law_is_among_those_of_random_robots() -> None:
    found: set[str] = set()
    for seed in range(20):
        robot = with_laws(random_robot(seed, joints=(2, 4)), seed)
        numbers = {key for joint in robot.joints for c in joint.coordinates.values() for key in c.law()}
        found |= {name for name, law in LAWS.items() if law.first in numbers}
    assert found == set(LAWS) - {DRIVE}


def test_names_of_states_say_whose_they_are() -> None:
    """Of joints, motors, branches, servo drives, loop joints and couplings."""
    states = [x for robot in (stateful_arm(), stateful_linkage(), servo_arm()) for x in build_model(robot).states]
    assert {"j1.gamma", "j2.motor", "joint4.gamma", "belt"} <= {x.owner for x in states}
    assert {x.law for x in states} == STATE_FORMULAS.keys() | {DRIVE}
    for x in states:
        assert split_state(x.name) == (x.owner, x.law, x.state.name)
    bounded = {f"{x.law}.{x.state.name}": x.numbers for x in states if x.state.is_bounded}
    assert bounded.keys() == BOUNDS.keys()  # a law says whether it bounds a state, integrations what the bound is
    assert all(BOUNDS[name](numbers) > 0.0 for name, numbers in bounded.items())


LUGRE = {"friction.coulomb": 1.0, "friction.bristle_stiffness": 1e4}


@pytest.mark.parametrize(
    ("rule", "numbers", "key", "begin", "end"),
    [
        (branch_conflict, {"maxwell.0.stiffness": 1.0}, "maxwell.0.damping", "it is missing", "greater than 0"),
        (branch_conflict, {"maxwell.1.damping": 1.0}, "maxwell.1.damping", "branch 0 has no", "each with a stiffness"),
        (bristle_conflict, {**LUGRE, "friction.coulomb": 0.0}, "friction.coulomb", "got 0.0", "bristles yield at it"),
        (bristle_conflict, {**LUGRE, "friction.radius": 0.1}, "friction.radius", "the model is lugre", "without it"),
        (bristle_conflict, {**LUGRE, "friction.stribeck": 0.1}, "friction.stribeck", "the model is", "Stribeck curve"),
        (
            bristle_conflict,
            {**LUGRE, "friction.bristle_damping": 50.0, "friction.fade": 1.0},
            "friction.fade",
            "got 1.0: bristle damping resists with 4",
            "or less damping",
        ),
    ],
)
def test_conflicts_of_states_name_the_key_and_what_is_allowed(
    rule: Callable[[dict[str, float]], tuple[str, str] | None],
    numbers: dict[str, float],
    key: str,
    begin: str,
    end: str,
) -> None:
    conflict = rule(numbers)
    assert conflict is not None
    place, message = conflict
    assert place == key
    assert message.startswith(begin)
    assert "; allowed: " in message
    assert message.endswith(end)


def test_units_of_fmi() -> None:
    """By hand."""
    assert exponents("1") == {}
    assert exponents("N.m/rad3") == {"kg": 1, "m": 2, "s": -2, "rad": -3}
    assert exponents("N.s/m") == {"kg": 1, "s": -1}
    assert exponents("N/m3") == {"kg": 1, "m": -2, "s": -2}
    assert exponents("J") == exponents("N.m") == {"kg": 1, "m": 2, "s": -2}
    assert (unit_name("N m s/rad"), unit_name("N/m^3")) == ("N.m.s/rad", "N/m3")


def test_numbers_of_parameters() -> None:
    expected = {
        "gravity.x": None,
        "links.smoothing.com.x": None,
        "joints.j.offset.x": None,
        "joints.j.placement.xyz.0": None,
        "joints.j.motor.inertia": None,
        "springs.s.points.0.x": None,
        "joints.j.x.stiffness": BASIC[0],
        "joints.j.x.cubic": NUMBERS["cubic"],
        "joints.j.motor.friction.smoothing": NUMBERS["friction.smoothing"],
        "joints.j.x.curve.12": NUMBERS["curve"],
        "springs.s.free_length": Spring.NUMBERS["free_length"],
        "springs.s.curve.1": Spring.NUMBERS["curve"],
    }
    assert {name: number_of(name) for name in expected} == expected
    least = {"links.a.mass": 0.0, "links.mass.com.x": None, "joints.j.x.smoothing": 1e-12, "joints.j.x.preload": None}
    assert {name: least_of(name) for name in least} == least


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_make_the_same_coordinate_again(kind: str) -> None:
    """Also after a record and a pickle."""
    given = random_coordinate(np.random.default_rng(3), kind, Coordinate(5.0, 0.5, 0.1))
    numbers = {key: value for key, value in given.law().items() if not key.startswith("curve.")}
    again = replace(Coordinate(given.stiffness, 0.5, 0.1), curve=given.curve).with_numbers(numbers)
    assert again == given
    assert again.law() == given.law()
    robot = slider(given)
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))


def slider(given: Coordinate) -> Robot:
    link = Link("block", 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    joint = Joint("rail", "base", "block", "prismatic", coordinates={"z": given})
    return Robot("slider", (0.0, 0.0, 0.0), (link,), (joint,))


def test_numbers_that_are_given_anew() -> None:
    """A table is replaced as a whole, and what follows from others follows anew."""
    old = Coordinate(1.0, clearance=0.1, restitution_damping=0.3, friction=Friction(1.0, 2.0, 0.5))
    new = old.with_numbers({"clearance": 0.2, "damping": 3.0, "friction.coulomb": 4.0})
    assert new == Coordinate(1.0, 3.0, clearance=0.2, restitution_damping=0.3, friction=Friction(4.0))
    assert (new.smoothing, new.friction) == (pytest.approx(0.01), Friction(4.0, smoothing=4e-8))


def test_records_and_hashes_are_those_of_before() -> None:
    """A robot without laws that came later is recorded as it was when there were none."""
    robot = eomgen.load_robot("worn_arm")
    assert robot_hash(robot) == HASH
    known = {"stiffness", "damping", "armature", "preload", "cubic", "stiffness_negative", "clearance"}
    known |= {"restitution_damping", "smoothing", "friction", "curve", "prescribed"}
    assert {item.name for item in fields(Coordinate)} == known | {"further", "limits"}
    for joint in record_of(robot)["joints"]:
        assert all(set(table) == known for table in joint["coordinates"].values())


HASH = "eeec6db057b71670a2a84589f3f63dde23aee6763dbee58c5dd9cc53a1243c82"


def test_numbers_that_no_law_has_are_refused() -> None:
    with pytest.raises(DescriptionError, match=r"rail\.z\.further: .*'quartic' is no number of a law; allowed: "):
        build_model(slider(Coordinate(1.0, further={"quartic": 1.0})))
    with pytest.raises(DescriptionError, match=r"rail\.z\.further: .*'cubic' is no number of a law"):
        build_model(slider(Coordinate(1.0, further={"cubic": 1.0})))
