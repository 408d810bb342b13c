"""An identified robot as TOML: the description's text with identified links, rotors and friction."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ...errors import DescriptionError, InputError
from ...files import check_ending
from ...forms.toml_text import parse_toml
from ...names import joint_of, kind_of, split_component
from ...robot.coordinates import is_mode
from ...robot.internal_states.bristles import LUGRE
from ...robot.model import build_model
from ...robot.value import INERTIA_KEYS, MOTOR, Joint, Link, Robot
from ..calibration.as_toml import block_of, body_of, headed, numbers_text, replace_line, unwritable, write_compared
from ..consistent import carried_by

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
        robot: the identified one.
        parameters: identified values, by the names of ``IdentifyResult.parameters``; the rest stays as it is written.
        comments: lines that begin with #.
        target: ends in .toml.

    Raises:
        InputError: another ending, the robot was read from no file, or something is not written there so that it can
            be changed.
    """
    check_ending(target, ".toml")
    return write_compared((robot, robot), partial(toml_text, robot, parameters, comments), target, _changed)


def toml_text(robot: Robot, parameters: Mapping[str, float], comments: Sequence[str], folder: Path) -> str:
    """Return the text for a file in that folder."""
    modes = [name for name in parameters if is_mode(split_component(name)[0])]
    if modes:
        raise InputError(
            f"{modes[0]}: follows from a link's beam or file of modes, and has no place of its own in a description;"
            " allowed: the robot of the result, or E and modal_damping as the notes say them"
        )
    body = body_of(robot, folder, 'inertia = "warn"')
    owners, nodes = {split_component(name)[0] for name in parameters}, robot.nodes
    if owners.intersection(link.name for link in robot.links):
        bodies = build_model(robot).bodies
        on_nodes = {carried_by(robot, x.links) for x in bodies if x.name in owners and x.name in nodes}
        for link in robot.links:
            is_identified = link.name in owners or link.name in on_nodes or link.mass == 0.0
            if is_identified and link.name not in nodes:
                _put_link(robot, link, body)
    for joint in robot.joints:
        for kind in dict.fromkeys(kind_of(name) for name in owners if joint_of(name) == joint.name):
            keys = {
                split_component(name)[1] for name in parameters if split_component(name)[0] == f"{joint.name}.{kind}"
            }
            _put_coordinate(robot, joint, kind, keys, body)
    return headed([*HEAD, *comments], body)


def _is_refined(body: Sequence[str]) -> bool:
    return any(re.match(r"\s*urdf\s*=", line) for line in body)


def _entry(robot: Robot, table: str, name: str, body: list[str]) -> tuple[int, int]:
    """Return lines of an entry, which is added where a description refines a URDF."""
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
    """Put identified numbers of a coordinate or motor into its table, beside the others."""
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
    """Return identified numbers of a coordinate or motor, by their keys in a description.

    None where there is none.
    """
    if kind == MOTOR:
        assert joint.motor is not None
        friction, spring = joint.motor.friction, joint.motor.transmission
        numbers = {"inertia": joint.motor.inertia, "stiffness": spring.stiffness, "damping": spring.damping}
        law: dict[str, Any] = {key: value for key, value in numbers.items() if key in keys}
    else:
        coordinate = joint.coordinates[kind]
        law, friction = (
            {key: getattr(coordinate, key) for term, key in _KEYS.items() if term in keys},
            coordinate.friction,
        )
    if keys & {"dry", "viscous"}:
        plain = None if friction is None else {key: value for key, value in vars(friction).items() if value is not None}
        if plain is not None and friction is not None and friction.bristle_stiffness is not None:
            plain = {"model": LUGRE, **plain}
        law["friction"] = plain
    return law


def _inline(value: Any) -> str:
    """Return a value in TOML, on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_inline(x)}" for key, x in value.items()) + " }" if value else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def _changed(robot: Robot) -> Iterator[tuple[str, Sequence[float | None]]]:
    """Yield numbers of a description that an identification changes, by names of links and coordinates."""
    for link in robot.links:
        yield link.name, (link.mass, *link.com, *link.inertia)
    for joint in robot.joints:
        for kind, coordinate in joint.coordinates.items():
            yield f"{joint.name}.{kind}", (coordinate.damping, coordinate.armature, *coordinate.law().values())
