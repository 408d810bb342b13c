"""Descriptions that are refused for their source, name, options or further files, and the largest that is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from eomgen.description.load import load_robot, robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.limits import MOST_ENTRIES
from eomgen.robot.value import Robot
from tests.support.bad_files import changed
from tests.support.description_samples import ARM, URDF
from tests.support.fuzzing import check_message
from tests.support.refusals import refused


def refusal(read: Callable[[str], Robot], text: str) -> str:
    """The message with which the text is refused."""
    caught = refused(DescriptionError, "", read, text)
    check_message(caught)
    return str(caught)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stiffness = 1e6", 'curve = "a.csv"', ("joints.joint1.x.curve", "'a.csv'", "relative")),
        (
            "limits = [-1, 2]",
            'stiffness = { matrix = "K.mtx" }',
            ("joints.joint1.stiffness.matrix", "'K.mtx'", "relative"),
        ),
        ("tunable =", 'urdf = "a.urdf"\ntunable =', ("urdf", "'a.urdf'", "relative")),
        ("mass = 3.0", 'modes = "arm.npz"', ("links.link1.modes", "'arm.npz'", "relative to this")),
    ],
)
def test_a_text_has_no_files_beside_it(old: str, new: str, words: tuple[str, ...]) -> None:
    message = refusal(robot_from_toml, changed(ARM, old, new))
    assert not [word for word in words if word not in message], message


def test_half_of_a_pair_of_surrogates_is_no_name() -> None:
    refusal(robot_from_urdf, '<robot name="\ud800"/>')


def test_as_many_links_as_there_may_be() -> None:
    """A long chain, then a bushy tree, of names that are no identifiers; bad_files.py has what goes beyond."""
    count = MOST_ENTRIES
    parts = ['<robot name="many">', *(f'<link name="l-{k}"/>' for k in range(count))]
    for k in range(1, count):
        parent = k - 1 if k < count // 2 else k // 2
        parts.append(f'<joint name="j-{k}" type="revolute"><parent link="l-{parent}"/><child link="l-{k}"/></joint>')
    text = "\n".join([*parts, "</robot>"])
    robot = robot_from_urdf(text)
    assert len(robot.links) == count - 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("absent.toml", None, ("absent.toml", "no such file")),
        ("arm.yaml", b"name: arm", ("there is no robot", ".toml, .urdf, .xml")),
        ("link.toml", b'urdf = "nowhere.urdf"', ("nowhere.urdf", "no such file")),
        ("type.toml", b'urdf = "nowhere.xml"', ("'nowhere.xml'", ".urdf")),
        ("control.toml", b'urdf = "\\u001b[31m.urdf"', ("x1b[31m", "no such file")),
        ("nul.toml", b'urdf = "a\\u0000.urdf"', ("x00", "allowed")),
    ],
)
def test_files_that_are_not_there(name: str, content: bytes | None, words: tuple[str, ...], tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    message = refusal(load_robot, str(tmp_path / name))
    assert not [word for word in words if word not in message], message


def test_a_urdf_behind_toml_is_named(tmp_path: Path) -> None:
    """Where the mistake is in it, or where the whole robot alone shows it; else the TOML is."""
    toml, urdf = tmp_path / "arm.toml", tmp_path / "arm.urdf"
    urdf.write_text(URDF)
    toml.write_text('name = "a"\nurdf = "arm.urdf"\n[[joints]]\nname = "elbo"\nx = {}\n')
    message = refusal(load_robot, str(toml))
    assert "joints.elbo" in message
    assert "mean 'elbow'" in message
    urdf.write_text(URDF.replace('"continuous"', '"cylindrical"'))
    assert "arm.urdf:21:3: joint 'elbow'" in refusal(load_robot, str(toml))
    urdf.write_text(URDF.replace('izz="0.15"', 'izz="9"'))
    for entry, place in (
        ('[[joints]]\nname = "elbow"\nx = {}\n', f"{urdf}:4:3: links.upper.inertia: no body can have"),
        ('[[links]]\nname = "upper"\n', f"{toml}:3:"),
    ):
        toml.write_text(f'name = "a"\nurdf = "arm.urdf"\n{entry}')
        assert refusal(lambda path: load_robot(path, inertia="error"), str(toml)).startswith(place)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("puma56", "mean 'puma560'"),
        ("", "one_link"),
        ("no\nsuch", r"'no\nsuch'"),
        ("ur5.TOML", "allowed"),
        *((source, "a name or a path") for source in (None, 3, b"ur5", ["ur5"])),
    ],
)
def test_unknown_robot(source: object, words: str) -> None:
    assert words in refusal(load_robot, source)  # type: ignore[arg-type]


def test_bad_policy_keyword() -> None:
    refused(DescriptionError, r"'off'.*error, warn, project", load_robot, "ur5", inertia="off")


@pytest.mark.parametrize("name", ["lambda", "class", "import"])
def test_python_keyword_as_robot_name(name: str) -> None:
    refused(DescriptionError, rf"(?s)name.*{name}.*no Python keyword", robot_from_toml, f'name = "{name}"\n')
