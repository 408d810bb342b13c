"""Values of declared types out of plain data, as JSON has it: for files that eomgen writes and reads again.

A frozen dataclass is the declaration: names, types, and optional fields (with a default).  Values have the declared
types, finite numbers up to a limit, and printable texts.
"""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from ..errors import InputError
from ..limits import LARGEST_FOUND
from ..names import nearest, show

MOST_DEPTH = 24  # of arrays and tables in each other where no type is declared
_WHOLE = 1 << 62
_SIZES = {"{": 240, "[": 96, ",": 64}  # bytes of memory, at most, per sign of JSON

Read = Callable[[Any], Any]


class Mismatch(Exception):
    """Data that is not of the declared type; ``places`` are the keys that lead to it, the innermost one first."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.places: list[str] = []

    @property
    def where(self) -> str:
        """The place, such as ``joints[0].placement.xyz[2]``."""
        return "".join(reversed(self.places)).removeprefix(".")


def value_of(kind: Any, data: object, where: str, largest: float = LARGEST_FOUND) -> Any:
    """Read data as a type: a dataclass, tuple[...], Mapping[str, ...], float, int, bool, str, Any, X | None.

    Args:
        kind: the type; of dataclasses the types of the fields count.
        data: of dicts, lists (or tuples), numbers, texts, true, false and none.
        where: the beginning of messages.
        largest: magnitude of numbers.

    Raises:
        InputError: with the place, what came and what is allowed.
    """
    try:
        return _reader(kind, largest)(data)
    except Mismatch as error:
        raise InputError(": ".join(text for text in (where, error.where, str(error)) if text)) from None


def parse_json(text: str, where: str, most: int) -> Any:
    """Return the values of a JSON text.

    Args:
        where: the beginning of messages.
        most: bytes of memory that its values may take.

    Raises:
        InputError: it is none, is nested too deeply, or would take more.
    """
    size = len(text) * (1 if text.isascii() else 4) + sum(n * text.count(sign) for sign, n in _SIZES.items())
    if size > most:
        raise InputError(f"{where}: its values may take {size} bytes; allowed: up to {most}")
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError(f"{where}: is nested too deeply; allowed: JSON of a few levels") from None
    except ValueError as error:
        raise InputError(f"{where}: is no JSON ({show(str(error))}); allowed: what eomgen wrote") from None


def printable(text: str) -> str:
    """Return the text with signs on which a terminal might act (ESC, line ends, marks of direction) escaped."""
    return text if text.isprintable() else "".join(x if x.isprintable() else ascii(x)[1:-1] for x in text)


@cache
def _reader(kind: Any, largest: float) -> Read:
    """Return a reader of a type, which raises Mismatch."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return _anything(largest)
    if origin in (types.UnionType, typing.Union):
        kinds = {dataclasses.is_dataclass(x): _reader(x, largest) for x in arguments if x is not type(None)}
        if len(kinds) == 1:
            (inner,) = kinds.values()
            return lambda data: None if data is None else inner(data)
        return lambda data: None if data is None else kinds[isinstance(data, Mapping)](data)
    if origin is tuple:
        return _sequence(tuple(_reader(one, largest) for one in arguments if one is not ...), ... in arguments)
    if _is_array(origin):
        return _array(largest)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _table(_reader(arguments[1], largest))
    if dataclasses.is_dataclass(kind):
        return _fields(typing.cast(type, kind), largest)
    return {float: lambda data: _number(data, largest), int: _whole, bool: _flag, str: _text}.get(kind, _nothing)


def _is_array(origin: Any) -> bool:
    """Tell whether the origin of a type is that of NumPy's arrays, without asking NumPy.

    ``NDArray`` is their class up to NumPy 2.4 and Python 3.11, behind these a name of it (PEP 695).
    """
    named = typing.get_origin(getattr(origin, "__value__", None)) or origin
    return getattr(named, "__name__", "") == "ndarray"


def _number(data: Any, largest: float) -> Any:
    if isinstance(data, bool) or not isinstance(data, (int, float)):
        raise Mismatch(f"got {show(data)}; allowed: a value of type float")
    if not -largest <= data <= largest:  # NaN, infinity and 10**400 among them
        raise Mismatch(f"got {show(data)}; allowed: a finite number of magnitude up to {largest:g}")
    return data


def _whole(data: Any) -> Any:
    if isinstance(data, bool) or not isinstance(data, int) or abs(data) >= _WHOLE:
        raise Mismatch(f"got {show(data)}; allowed: a value of type int")
    return data


def _flag(data: Any) -> Any:
    if not isinstance(data, bool):
        raise Mismatch(f"got {show(data)}; allowed: a value of type bool")
    return data


def _text(data: Any) -> Any:
    if not isinstance(data, str):
        raise Mismatch(f"got {show(data)}; allowed: a value of type str")
    return printable(data)


def _nothing(data: Any) -> Any:
    raise Mismatch(f"got {show(data)}; allowed: nothing, it is in no file")


def _sequence(items: tuple[Read, ...], repeated: bool) -> Read:
    def read(data: Any) -> Any:
        if not isinstance(data, (list, tuple)):
            raise Mismatch(f"got {show(data)}; allowed: an array")
        if not repeated and len(data) != len(items):
            raise Mismatch(f"got {show(list(data))}; allowed: an array of {len(items)}")
        values, index = [], 0
        try:
            for index, item in enumerate(data):
                values.append(items[0 if repeated else index](item))
        except Mismatch as error:
            error.places.append(f"[{index}]")
            raise
        return tuple(values)

    return read


def _array(largest: float) -> Read:
    """Return a reader of numbers, or rows of equally many numbers."""
    row = _sequence((lambda data: _number(data, largest),), True)

    def read(data: Any) -> Any:
        if not isinstance(data, (list, tuple)) or not data or not isinstance(data[0], (list, tuple)):
            return row(data)
        rows = _sequence((row,), True)(data)
        if any(len(one) != len(rows[0]) for one in rows):
            raise Mismatch("got rows of different lengths; allowed: rows of one length")
        return rows

    return read


def _table(item: Read) -> Read:
    def read(data: Any) -> Any:
        if not isinstance(data, Mapping):
            raise Mismatch(f"got {show(data)}; allowed: a table")
        values, key = {}, ""
        try:
            for key, value in data.items():
                values[_text(key)] = item(value)
        except Mismatch as error:
            error.places.append(f".{_short(key)}")
            raise
        return values

    return read


def field_types(kind: type, annotated: bool = False) -> dict[str, Any]:
    """Return the types of a dataclass's fields by name, with the metadata of ``Annotated`` if ``annotated``."""
    hints = typing.get_type_hints(kind, include_extras=annotated)
    return {item.name: hints[item.name] for item in dataclasses.fields(typing.cast(Any, kind))}


def _fields(kind: type, largest: float) -> Read:
    hints = field_types(kind)
    fields = {item.name: item for item in dataclasses.fields(typing.cast(Any, kind))}
    readers = {name: _reader(hints[name], largest) for name in fields}
    empty = dataclasses.MISSING
    needed = [name for name, x in fields.items() if x.default is empty and x.default_factory is empty]

    def read(data: Any) -> Any:
        if not isinstance(data, Mapping):
            raise Mismatch(f"got {show(data)}; allowed: a table")
        for key in data:
            if key not in fields:
                raise Mismatch(f"{show(key)} is unknown{nearest(str(key), fields)}; allowed: {', '.join(fields)}")
        for name in needed:
            if name not in data:
                raise Mismatch(f"the key {name!r} is missing; allowed: with {', '.join(needed)}")
        values, key = {}, ""
        try:
            for key, value in data.items():
                values[key] = readers[key](value)
        except Mismatch as error:
            error.places.append(f".{key}")
            raise
        try:
            return kind(**values)
        except InputError as error:
            raise Mismatch(str(error)) from None
        except (ValueError, TypeError, LookupError, ArithmeticError) as error:  # values that do not go together
            raise Mismatch(
                f"got {show(error.args[0] if error.args else '')}; allowed: numbers that go together"
            ) from None

    return read


def _anything(largest: float) -> Read:
    def read(data: Any, depth: int = MOST_DEPTH) -> Any:
        if isinstance(data, float):
            return _number(data, largest)
        if data is None or isinstance(data, bool):
            return data
        if isinstance(data, int):
            return _number(data, largest)
        if isinstance(data, str):
            return printable(data)
        if not depth:
            raise Mismatch(f"is nested too deeply; allowed: up to {MOST_DEPTH} levels")

        def inner(value: Any) -> Any:
            return read(value, depth - 1)

        if isinstance(data, Mapping):
            return _table(inner)(data)
        if isinstance(data, (list, tuple)):
            return list(_sequence((inner,), True)(data))
        raise Mismatch(f"got a value of type {type(data).__name__}; allowed: what JSON holds")

    return read


def _short(key: object) -> str:
    text = show(key)
    return text[1:-1] if isinstance(key, str) else text
