"""A robot as values that JSON holds, and back; its hash, by which results and caches know it again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import types
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any

from ..errors import InputError
from ..names import show
from . import value as values
from .value import Robot


def record_of(robot: Robot) -> dict[str, Any]:
    """The robot as nested dicts, lists, numbers and texts; ``robot_of`` makes an equal robot of it.

    Fields that are marked LATER are left out where they are empty, so that records and hashes of robots that do not use
    them stay what they were.
    """
    plain = _plain(robot)
    assert isinstance(plain, dict)
    return plain


def robot_of(record: Mapping[str, Any]) -> Robot:
    """The robot of a record.

    Raises:
        InputError: it is no record of a robot, or one of a newer eomgen.
    """
    try:
        robot = _value(Robot, record)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise InputError(f"this is no robot that was recorded, or one of a newer eomgen: {error}") from None
    assert isinstance(robot, Robot)
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


@cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind, vars(values))


def _value(kind: Any, data: Any) -> Any:
    """The data as a value of a type of ``robot``'s; TypeError, ValueError or KeyError if it is none."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        (inner,) = (argument for argument in arguments if argument is not type(None))
        return None if data is None else _value(inner, data)
    if origin is tuple:
        if not isinstance(data, list):
            raise TypeError(f"got {show(data)}; allowed: a list")
        kinds = [arguments[0]] * len(data) if arguments[1:] == (...,) else arguments
        return tuple(_value(one, x) for one, x in zip(kinds, data, strict=True))
    if origin is not None and issubclass(origin, Mapping):
        return {str(key): _value(arguments[1], x) for key, x in data.items()}
    if dataclasses.is_dataclass(kind):
        hints = _hints(typing.cast(type, kind))
        unknown = set(data) - {item.name for item in dataclasses.fields(kind)}
        if unknown:
            raise ValueError(f"{show(min(unknown))} is unknown")
        return typing.cast(Any, kind)(**{key: _value(hints[key], x) for key, x in data.items()})
    allowed = (int, float) if kind is float else (kind,)
    if not isinstance(data, allowed) or (isinstance(data, bool) and kind is not bool):
        raise TypeError(f"got {show(data)}; allowed: a value of type {kind.__name__}")
    return data


def robot_hash(robot: Robot) -> str:
    """SHA-256 of what a robot is, hexadecimal: of all its values but ``source`` and ``notes``."""
    values_of = {**record_of(robot), "source": "", "notes": ""}
    return hashlib.sha256(json.dumps(values_of, sort_keys=True).encode()).hexdigest()
