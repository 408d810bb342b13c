"""Descriptions with any keys, values and edits: a Robot comes of them, or one DescriptionError; nothing else."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eomgen.description.load import robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.robot.value import Robot
from tests.support.bad_files import ENTRIES as BAD_ENTRIES
from tests.support.description_samples import ARM, URDF
from tests.support.fuzzing import check_message, check_robot
from tests.support.mutations import as_toml
from tests.support.random_tables import ENTRIES, TOPS

FUZZ = settings(max_examples=200, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def outcome(read: Callable[[str], Robot], text: str) -> Robot | DescriptionError:
    """What comes of the text; any other exception is an error of this test."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return read(text)
        except DescriptionError as error:
            return error


def harmless(read: Callable[[str], Robot], text: str) -> None:
    """A Robot with clean names and finite numbers, or a DescriptionError in printable ASCII."""
    robot = outcome(read, text)
    if isinstance(robot, DescriptionError):
        check_message(robot)
    else:
        check_robot(robot)


def any_table(top: dict[str, object]) -> None:
    harmless(robot_from_toml, "\n".join(f"{key} = {as_toml(value)}" for key, value in top.items()))


def any_value(table: str, key: str, value: object) -> None:
    points = "stiffness = 1\nfree_length = 0.1\npoints = [[0, 0, 1], [1, 0, 0]]"
    more = f"{BAD_ENTRIES['loop']('placements = [{}, {}]')}\n{BAD_ENTRIES['spring'](points)}\n[[frames]]"
    closed = ARM.replace("[[frames]]", more)
    given = f"[[{table}]]\n{json.dumps(key)} = {as_toml(value)}\n"
    harmless(robot_from_toml, closed.replace(f"[[{table}]]\n", given, 1))
    line = re.compile(f"^{key} = .*$", re.MULTILINE)
    harmless(robot_from_toml, line.sub(lambda _: f"{key} = {as_toml(value)}", closed, count=1))


test_any_toml_table_is_harmless = FUZZ(given(TOPS)(any_table))


test_any_value_in_a_good_toml_is_harmless = FUZZ(given(*ENTRIES)(any_value))


@pytest.mark.soak
@settings(FUZZ, max_examples=2_000)
@given(TOPS)
def test_more_tables_are_harmless(top: dict[str, object]) -> None:
    any_table(top)


@pytest.mark.soak
@settings(FUZZ, max_examples=2_000)
@given(*ENTRIES)
def test_more_values_in_a_good_toml_are_harmless(table: str, key: str, value: object) -> None:
    any_value(table, key, value)


PIECES = [
    '"',
    "<",
    ">",
    "/>",
    "&amp;",
    "=",
    "{",
    "}",
    "[",
    "]",
    "\n",
    "nan",
    "-",
    "1e400",
    "-1",
    "0",
    "<link/>",
    "link1",
    '<joint name="j" type="fixed">',
    "upper",
    "base",
    "\0",
    "\N{SNOWMAN}",
    "]]>",
    "<!--",
    "'''",
    "x = ",
    "free",
]


EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(PIECES) | st.text(max_size=3)),
    min_size=1,
    max_size=4,
)


def edited(text: str, edits: list[tuple[float, int, str]]) -> str:
    for where, length, piece in edits:
        at = int(where * len(text))
        text = text[:at] + piece + text[at + length :]
    return text


@FUZZ
@given(EDITS)
def test_mutated_urdf_is_harmless(edits: list[tuple[float, int, str]]) -> None:
    harmless(lambda text: robot_from_urdf(text, inertia="project"), edited(URDF, edits))


@FUZZ
@given(EDITS)
def test_mutated_toml_is_harmless(edits: list[tuple[float, int, str]]) -> None:
    harmless(lambda text: robot_from_toml(text, inertia="project"), edited(ARM, edits))


NUMBERS = st.sampled_from(["0", "-0", "1e-320", "1e30", "-1e30", "1e-30", "3.14", "1.5707963267948966", "-2", "1e31"])


@FUZZ
@given(st.lists(NUMBERS, min_size=22, max_size=22))
def test_extreme_numbers_in_urdf_are_harmless(numbers: list[str]) -> None:
    values = iter(numbers)
    text = re.sub(r'(?<=[" ])-?[0-9.]+(?=[" ])', lambda found: next(values, "1"), URDF.split("?>")[1])
    harmless(lambda text: robot_from_urdf(text, inertia="project", urdf_damping=True), text)
