"""A robot as values that JSON holds, and back; its hash, by which results and caches know it again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from ..forms.plain import value_of
from ..limits import LARGEST
from ..names import show
from .value import COORDINATES, Robot


def record_of(robot: Robot) -> dict[str, Any]:
    """The robot as nested dicts, lists, numbers and texts; ``robot_of`` makes an equal robot of it.

    Fields that are marked LATER are left out where they are empty, so that records and hashes of robots that do not use
    them stay what they were.
    """
    plain = _plain(robot)
    assert isinstance(plain, dict)
    return plain


def robot_of(record: Mapping[str, Any]) -> Robot:
    """The robot of a record, whose types are what they should be; ``description.recorded`` checks what they say.

    Raises:
        InputError: it is no record of a robot, or one of a newer eomgen.
    """
    robot: Robot = value_of(Robot, record, "this is no robot that was recorded, or one of a newer eomgen", LARGEST)
    for joint, given in zip(robot.joints, record["joints"], strict=True):
        for name in given.get("coordinates", {}):
            if name not in joint.coordinates:
                raise InputError(
                    f"this is no robot that was recorded: joint {show(joint.name)}: {show(name)} is no coordinate;"
                    f" allowed: {', '.join(COORDINATES)}"
                )
    return robot


def _plain(value: object) -> Any:
    if dataclasses.is_dataclass(value):
        fields = {item: getattr(value, item.name) for item in dataclasses.fields(value)}
        return {item.name: _plain(x) for item, x in fields.items() if x or not item.metadata.get("later")}
    if isinstance(value, Mapping):
        return {key: _plain(x) for key, x in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(x) for x in value]
    return value


def robot_hash(robot: Robot) -> str:
    """SHA-256 of what a robot is, hexadecimal: of all its values but ``source`` and ``notes``."""
    values_of = {**record_of(robot), "source": "", "notes": ""}
    return hashlib.sha256(json.dumps(values_of, sort_keys=True).encode()).hexdigest()
