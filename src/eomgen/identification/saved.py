"""Results as files that say which kind they are of, written and read again.

A .json file has all fields of a result with the types that they declare, or what it follows from; an .npz file has
arrays, and everything else as one text of JSON, ``meta``.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import check_ending, read_regular, write_atomically
from ..forms.plain import field_types, parse_json, value_of
from ..limits import LARGEST_FOUND
from ..names import show, show_path
from ..npz import read_npz

Result = TypeVar("Result")
Arrays = Mapping[str, NDArray[Any]]

FORMAT = 1  # raised when a reader of the old one would misread it
_MOST_BYTES = 1 << 26
_MOST_MEMORY = 1 << 29
_NO_NUMBER = re.compile(r"(?<![\w.])(?:nan|inf)(?![\w.])")
_DAMAGED = (  # what values that do not go together raise
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    ArithmeticError,
    AssertionError,
    RecursionError,
)
_ALLOWED = "allowed: what its save wrote"


@contextmanager
def damage_named(path: Path | str, what: str) -> Iterator[None]:
    """Around code that makes a result of a file's values: wrong ones become an InputError, "PATH: is no WHAT".

    Refusals that do not name the file get its name.
    """
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)
            yield
    except InputError as error:
        if str(path) in str(error):
            raise
        allowed = "" if "allowed: " in str(error) else f"; {_ALLOWED}"
        raise InputError(f"{path}: {error}{allowed}") from None
    except _DAMAGED as error:
        why = f"{type(error).__name__}: {error}" if not isinstance(error, (ValueError, AssertionError)) else str(error)
        raise InputError(f"{path}: is no {what} ({show(why)}); {_ALLOWED}") from None


def declared_values(declared: type, values: Any, names: Iterable[str], where: str) -> dict[str, Any]:
    """Read fields of a dataclass from plain values, each as the type that the dataclass declares.

    Raises:
        InputError: one is missing or of another type, with ``where`` and its key.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{where}: got {show(values)}; allowed: a table")
    types, found = field_types(declared), {}
    for name in names:
        if name not in values:
            raise InputError(f"{where}: the key {name!r} is missing; {_ALLOWED}")
        found[name] = value_of(types[name], values[name], f"{where}: {name}")
    return found


def declared_value(kind: Any, values: Mapping[str, Any], name: str, where: str, largest: float = LARGEST_FOUND) -> Any:
    """Read the value of a key as a type; errors as ``declared_values``."""
    if name not in values:
        raise InputError(f"{where}: the key {name!r} is missing; {_ALLOWED}")
    return value_of(kind, values[name], f"{where}: {name}", largest)


def number_arrays(arrays: Arrays, names: Iterable[str], path: str, kinds: str = "fiu") -> dict[str, Any]:
    """Read arrays of a file by name: of numbers as float64, of truth values (``kinds`` "b") as they are.

    Raises:
        InputError: one is missing, or of another kind.
    """
    found = {}
    for name in names:
        if name not in arrays:
            raise InputError(f"{path}: array {name} is missing; {_ALLOWED}")
        if arrays[name].dtype.kind not in kinds:
            what = "truth values" if kinds == "b" else "numbers"
            raise InputError(f"{path}: array {name} has dtype {show(str(arrays[name].dtype))}; allowed: {what}")
        found[name] = arrays[name] if kinds == "b" else np.asarray(arrays[name], dtype=np.float64)
    return found


def check_whole(found: Any, path: str) -> None:
    """Check that a result can say itself in numbers.

    Raises:
        InputError: it prints what is no number, or a value of it is not finite.
    """
    text = "\n".join(found.lines())
    if _NO_NUMBER.search(text):
        raise InputError(f"{path}: it has numbers that are not finite, or too large; {_ALLOWED}")


def check_shapes(found: Arrays, shapes: Mapping[str, tuple[int, ...]], path: str) -> None:
    """Check shapes and numbers of a file's arrays.

    Raises:
        InputError: an array has another shape, or a number in it is not finite.
    """
    for name, shape in shapes.items():
        array = found[name]
        if array.shape != shape or not (np.abs(array) <= LARGEST_FOUND).all():
            raise InputError(f"{path}: array {name} has shape {array.shape}; allowed: {shape}, finite numbers")


# All fields as they are declared


def write_json(result: Any, kind: str, path: Path | str) -> Path:
    """Write all fields of a result as .json, to a temporary name first, and return the path.

    Raises:
        InputError: another ending, a number that is not finite, or the file cannot be written.
    """
    return write_plain({field.name: getattr(result, field.name) for field in fields(result)}, kind, path)


def read_json(declared: type[Result], kind: str, path: Path | str) -> Result:
    """The result that ``write_json`` wrote.

    Raises:
        InputError: the file cannot be read, is of another kind, or has not what is declared.
    """
    found: Any = value_of(declared, read_plain(kind, path), str(path))
    with damage_named(path, kind):
        arrays = {
            field.name: np.array(getattr(found, field.name), dtype=np.float64)
            for field in fields(found)
            if field.type == "Array"
        }
        result: Result = replace(found, **arrays)
    return result


# Plain values


def write_plain(values: Mapping[str, Any], kind: str, path: Path | str) -> Path:
    """Write values as .json, to a temporary name first, and return the path; errors as ``write_json``."""
    target = check_ending(path, ".json")
    try:
        text = json.dumps({"kind": kind, "format": FORMAT, **values}, indent=1, default=_plain, allow_nan=False)
    except ValueError:
        raise InputError(f"{show_path(str(target))}: the result has numbers that are not finite") from None
    return write_atomically(target, lambda stream: stream.write(text.encode("ascii")))


def _plain(value: Any) -> Any:
    """Arrays as lists, dataclasses as tables."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return {field.name: getattr(value, field.name) for field in fields(value)}


def read_plain(kind: str, path: Path | str) -> dict[str, Any]:
    """The values that ``write_plain`` wrote.

    Raises:
        InputError: the file cannot be read, or is of another kind.
    """
    try:
        text = read_regular(Path(path), _MOST_BYTES).decode("utf-8")
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error)
        allowed = "" if "allowed: " in reason else f"; {_ALLOWED}"
        raise InputError(f"{path}: cannot be read: {reason}{allowed}") from None
    data = parse_json(text, str(path), _MOST_MEMORY)
    if not isinstance(data, dict) or data.get("kind") != kind or data.get("format") != FORMAT:
        raise InputError(f"{path}: is no result of the kind {kind}; allowed: what its save wrote")
    return {key: value for key, value in data.items() if key not in ("kind", "format")}


# Arrays, and everything else as text


def write_arrays(arrays: Arrays, meta: Mapping[str, Any], kind: str, path: Path | str) -> Path:
    """Write arrays and plain values as .npz, to a temporary name first, and return the path.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    text = np.array(json.dumps({"kind": kind, "format": FORMAT, **meta}))
    own: dict[str, Any] = {**arrays, "meta": text}
    return write_atomically(check_ending(path, ".npz"), lambda stream: np.savez_compressed(stream, **own))


def read_arrays(kind: str, path: Path | str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays and plain values that ``write_arrays`` wrote.

    Raises:
        InputError: the file cannot be read, or is of another kind.
    """
    arrays = read_npz(path)
    data = parse_json(str(arrays.pop("meta", "null")), str(path), _MOST_MEMORY)
    if not isinstance(data, dict) or data.get("kind") != kind or data.get("format") != FORMAT:
        raise InputError(f"{path}: is no result of the kind {kind}; allowed: what its save wrote")
    return arrays, data
