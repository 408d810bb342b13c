"""An identified robot as TOML: the description's own text with links, rotors and friction that were found."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...description.load import robot_from_toml
from ...errors import DescriptionError, InputError
from ...files import check_ending, write_atomically
from ...forms.toml_text import parse_toml
from ...names import joint_of, kind_of, split_component
from ...robot.value import INERTIA_KEYS, MOTOR, Joint, Link, Robot
from ..calibration.as_toml import block_of, numbers_text, own_text, relative_path, replace_line, unwritable

_CLOSE = 1e-12  # by how much what was written may be off when it is read again
_KEYS = {"armature": "armature", "viscous": "damping", "offset": "preload"}  # of a coordinate, by the terms sought
HEAD = (
    "# Identified.  Links have the mass (kg), the centre of mass (m, link's frame) and the inertia (kg m^2, about the",
    "# centre of mass, link's axes) of bodies that are near to the description and have the base parameters below,",
    "# sums that forces show, with their standard deviations behind +-.  Inertias ixx ... izz in their formulas are",
    "# about the origin of the link's frame.  Friction acts against the coordinate's rate; a preload acts against a",
    "# positive deviation, so that the drive has to overcome both.",
)


def write_toml(robot: Robot, parameters: Mapping[str, float], comments: Sequence[str], target: Path) -> Path:
    """Write the description of an identified robot, and return the path.

    Args:
        robot: with what was found.
        parameters: what was found, by the names of ``IdentifyResult.parameters``; the rest stays as it is written.
        comments: lines that begin with #.
        target: ends in .toml.

    Raises:
        InputError: another ending, the robot was read from no file, or something is not written there so that it can
            be changed.
    """
    check_ending(target, ".toml")
    text = toml_text(robot, parameters, comments, target.parent)
    _compare(robot, text, target)
    return write_atomically(target, lambda stream: stream.write(text.encode("utf-8")))


def toml_text(robot: Robot, parameters: Mapping[str, float], comments: Sequence[str], folder: Path) -> str:
    """The text for a file in that folder."""
    source = Path(robot.source)
    if not robot.source:
        raise InputError(f"{robot.name}: has no description to write into; allowed: a robot that was read from a file")
    is_urdf = source.suffix in (".urdf", ".xml")
    if is_urdf:
        body = [f'name = "{robot.name}"', f'urdf = "{relative_path(source, folder)}"', 'inertia = "warn"', ""]
    else:
        body = own_text(robot, source, folder)
    owners = {split_component(name)[0] for name in parameters}
    if owners.intersection(link.name for link in robot.links):
        for link in robot.links:
            if link.name in owners or link.mass == 0.0:
                _put_link(robot, link, body)
    for joint in robot.joints:
        for kind in dict.fromkeys(kind_of(name) for name in owners if joint_of(name) == joint.name):
            keys = {
                split_component(name)[1] for name in parameters if split_component(name)[0] == f"{joint.name}.{kind}"
            }
            _put_coordinate(robot, joint, kind, keys, body)
    first = 1 if body and body[0].startswith("#:schema") else 0
    return "\n".join([*body[:first], *HEAD, *comments, *body[first:]]) + "\n"


def _is_refined(body: Sequence[str]) -> bool:
    return any(re.match(r"\s*urdf\s*=", line) for line in body)


def _entry(robot: Robot, table: str, name: str, body: list[str]) -> tuple[int, int]:
    """Lines of an entry, which is added where a description refines an URDF."""
    block = block_of(body, table, name)
    if block is None:
        if not _is_refined(body):
            raise unwritable(robot, name)
        body += ["", f"[[{table}]]", f'name = "{name}"']
        block = block_of(body, table, name)
    assert block is not None
    return block


def _put_link(robot: Robot, link: Link, body: list[str]) -> None:
    inertia = ", ".join(f"{key} = {value!r}" for key, value in zip(INERTIA_KEYS, link.inertia, strict=True))
    texts = {"inertia": f"{{ {inertia} }}", "com": numbers_text(link.com), "mass": repr(link.mass)}
    for key, text in texts.items():  # the last one stands first
        _put(body, _entry(robot, "links", link.name, body), key, text, robot)


def _put(body: list[str], block: tuple[int, int], key: str, text: str, robot: Robot) -> None:
    """Put a key into an entry; what stands over several lines cannot be replaced."""
    at = [i for i in range(*block) if re.match(rf"\s*{key}\s*=", body[i])]
    if at:
        code = body[at[0]].split("#")[0]
        if code.count("[") != code.count("]") or code.count("{") != code.count("}"):
            raise unwritable(robot, key)
    replace_line(body, block, key, f"{key} = {text}", robot)


def _put_coordinate(robot: Robot, joint: Joint, kind: str, keys: set[str], body: list[str]) -> None:
    """Put the numbers of a coordinate or motor that were found into its table, beside the others."""
    block = _entry(robot, "joints", joint.name, body)
    at = [i for i in range(*block) if re.match(rf"\s*{kind}\s*=\s*\{{", body[i])]
    if not at and any(re.match(rf"\s*(\[joints\.{kind}\]|{kind}\.)", line) for line in body[slice(*block)]):
        raise unwritable(robot, f"{joint.name}.{kind}")
    table: dict[str, Any] = {}
    if at:
        try:
            read = parse_toml(body[at[0]], robot.source)[kind]
            table = dict(read) if isinstance(read, Mapping) else {}
        except DescriptionError:
            raise unwritable(robot, f"{joint.name}.{kind}") from None
    for key, value in _numbers(joint, kind, keys).items():
        table.pop(key, None)
        if value is not None:
            table[key] = value
    line = f"{kind} = {_inline(table)}"
    if at:
        body[at[0]] = line
    else:
        replace_line(body, block, kind, line, robot)


def _numbers(joint: Joint, kind: str, keys: set[str]) -> dict[str, Any]:
    """Numbers of a coordinate or motor that were found, by their keys in a description; None where there is none."""
    if kind == MOTOR:
        assert joint.motor is not None
        friction, spring = joint.motor.friction, joint.motor.transmission
        numbers = {"inertia": joint.motor.inertia, "stiffness": spring.stiffness, "damping": spring.damping}
        found: dict[str, Any] = {key: value for key, value in numbers.items() if key in keys}
    else:
        given = joint.coordinates[kind]
        found, friction = {key: getattr(given, key) for term, key in _KEYS.items() if term in keys}, given.friction
    if keys & {"dry", "viscous"}:
        own = None if friction is None else {key: value for key, value in vars(friction).items() if value is not None}
        found["friction"] = own
    return found


def _inline(value: Any) -> str:
    """A value in TOML, on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_inline(x)}" for key, x in value.items()) + " }" if value else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def _compare(robot: Robot, text: str, target: Path) -> None:
    """InputError where the text does not say what it should: it is read again."""
    try:
        read = robot_from_toml(text, source=str(target), folder=target.parent, inertia="warn")
    except DescriptionError as error:
        raise InputError(f"{robot.name}: what was found makes no robot: {error}") from None
    for link, other in zip(robot.links, read.links, strict=False):
        pairs = [(link.mass, other.mass), *zip(link.com, other.com, strict=True)]
        pairs += [*zip(link.inertia, other.inertia, strict=True)]
        if link.name != other.name or any(abs(a - b) > _CLOSE * max(1.0, abs(a)) for a, b in pairs):
            raise unwritable(robot, link.name)
    for joint, same in zip(robot.joints, read.joints, strict=False):
        for kind, given in joint.coordinates.items():
            one, two = ({**x.law(), "d": x.damping, "a": x.armature} for x in (given, same.coordinates[kind]))
            if any(abs((one[key] or 0.0) - (two.get(key) or 0.0)) > _CLOSE for key in one):
                raise unwritable(robot, f"{joint.name}.{kind}")
