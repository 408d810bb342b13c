"""A robot as values that JSON holds, and back; its hash, by which results and caches identify it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from ..errors import InputError
from ..forms.plain import value_of
from ..identifiers import check_kind
from ..lazily import kept
from ..limits import LARGEST
from ..names import show
from .value import COORDINATES, Joint, Loop, Robot


def record_of(robot: Robot, *, whole: bool = False) -> dict[str, Any]:
    """Return the robot as nested dicts, lists, numbers and texts; ``robot_of`` makes an equal robot of it.

    Fields that are marked LATER are left out where they have their defaults, so that records and hashes of robots that
    do not use them stay what they were; not in a ``whole`` one.
    """
    check_kind("robot", robot, isinstance(robot, Robot), "a Robot (from load_robot)")
    plain = _plain(robot, whole=whole)
    assert isinstance(plain, dict)
    return plain


def robot_of(record: Mapping[str, Any]) -> Robot:
    """Return the robot of a record; types are checked here, values by ``description.recorded``.

    Raises:
        InputError: it is no record of a robot, or one of a newer eomgen.
    """
    robot: Robot = value_of(Robot, record, "this is no robot that was recorded, or one of a newer eomgen", LARGEST)
    _refuse_unknown("joint", robot.joints, record["joints"])
    _refuse_unknown("loop", robot.loops, record.get("loops", ()))
    return robot


def _refuse_unknown(what: str, items: Sequence[Joint | Loop], records: Sequence[Mapping[str, Any]]) -> None:
    """Refuse unknown coordinates, which a joint or loop leaves out."""
    for item, record in zip(items, records, strict=True):
        for name in record.get("coordinates", {}):
            if name not in item.coordinates:
                raise InputError(
                    f"this is no robot that was recorded: {what} {show(item.name)}: {show(name)} is no coordinate;"
                    f" allowed: {', '.join(COORDINATES)}"
                )


def _plain(value: object, *, whole: bool) -> Any:
    if dataclasses.is_dataclass(value):
        fields = {item: getattr(value, item.name) for item in dataclasses.fields(value)}
        return {item.name: _plain(x, whole=whole) for item, x in fields.items() if whole or not _is_unused(item, x)}
    if isinstance(value, Mapping):
        return {key: _plain(x, whole=whole) for key, x in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(x, whole=whole) for x in value]
    return value


def _is_unused(item: dataclasses.Field[Any], value: object) -> bool:
    """Return whether a field that is marked LATER has its default."""
    if not item.metadata.get("later"):
        return False
    empty = item.default if item.default_factory is dataclasses.MISSING else item.default_factory()
    return bool(value == empty)


@kept
def robot_hash(robot: Robot) -> str:
    """Return the SHA-256 of a robot, hexadecimal: of all its values but ``source`` and ``notes``."""
    values_of = {**record_of(robot), "source": "", "notes": ""}
    return hashlib.sha256(json.dumps(values_of, sort_keys=True).encode()).hexdigest()
