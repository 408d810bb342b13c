"""Results as .json files that say which kind they are of, written and read again with the types that they declare."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import InputError
from ..files import read_regular, write_atomically
from ..forms.plain import parse_json, value_of
from ..names import show_path

Result = TypeVar("Result")

FORMAT = 1  # raised when a reader of the old one would misread it
_MOST_BYTES = 1 << 26
_MOST_MEMORY = 1 << 29


def write_json(result: Any, kind: str, path: Path | str) -> Path:
    """Write all fields of a result as .json, to a temporary name first, and return the path.

    Raises:
        InputError: another ending, a number that is not finite, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".json":
        raise InputError(f"output: {show_path(str(target))}; allowed: a path that ends in .json")
    values = {field.name: getattr(result, field.name) for field in fields(result)}
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


def read_json(declared: type[Result], kind: str, path: Path | str) -> Result:
    """The result that ``write_json`` wrote.

    Raises:
        InputError: the file cannot be read, is of another kind, or has not what is declared.
    """
    try:
        text = read_regular(Path(path), _MOST_BYTES).decode("utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    data = parse_json(text, str(path), _MOST_MEMORY)
    if not isinstance(data, dict) or data.get("kind") != kind or data.get("format") != FORMAT:
        raise InputError(f"{path}: is no result of the kind {kind}; allowed: what its save wrote")
    rest = {key: value for key, value in data.items() if key not in ("kind", "format")}
    found: Any = value_of(declared, rest, str(path))
    arrays = {field.name: np.array(getattr(found, field.name)) for field in fields(found) if field.type == "Array"}
    result: Result = replace(found, **arrays)
    return result
