"""Contents of files of results: arrays by name in an .npz, and all else as JSON, in its text ``meta`` or alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import Reader, check_ending, read_regular, write_atomically
from ..forms.plain import parse_json, value_of
from ..identifiers import show_path
from ..limits import LARGEST_FOUND
from ..names import show
from ..npz import most_bytes
from .beside import JSON as JSON
from .beside import NPZ as NPZ
from .stored import ALLOWED, Stored

FORMAT = 1  # raised when a reader of the old one would misread it
META = "meta"
_MOST_BYTES = 1 << 26  # of a .json
_MOST_MEMORY = 1 << 29

Arrays = Mapping[str, NDArray[Any]]


class Contents:
    """The values of a file of a result, read by name.

    Attributes:
        path: of the file.
        plain: values that JSON holds.
        arrays: of an .npz.
    """

    def __init__(self, path: str, plain: Mapping[str, Any], arrays: Arrays) -> None:
        self.path, self.plain, self.arrays = path, plain, arrays

    def value(self, kind: Any, name: str, largest: float = LARGEST_FOUND) -> Any:
        """Return the plain value of a key as a type.

        Raises:
            InputError: it is missing, or of another type; names the file and the key.
        """
        if name not in self.plain:
            raise InputError(f"{self.path}: the key {name!r} is missing; {ALLOWED}")
        plain = self.plain[name]
        if is_dataclass(kind) and isinstance(plain, Mapping):  # whatever the defaults of its fields are
            for field in fields(kind):
                if field.name not in plain:
                    raise InputError(f"{self.path}: {name}: the key {field.name!r} is missing; {ALLOWED}")
        return value_of(kind, plain, f"{self.path}: {name}", largest)

    def array(self, name: str, stored: Stored) -> Any:
        """Return an array of the file by name, of the type that is declared; its shape is not checked.

        Raises:
            InputError: it is missing, or of another type; names the file and the array.
        """
        where = f"{self.path}: array {name if name.isascii() and name.isprintable() else show(name)}"
        if name not in self.arrays:
            raise InputError(f"{where} is missing; {ALLOWED}")
        return stored.read(self.arrays[name], where)

    def table(self, name: str) -> Contents:
        """Return the contents of a table among the plain values.

        Raises:
            InputError: it is no table; names the file and the key.
        """
        table = self.plain.get(name)
        if not isinstance(table, Mapping):
            raise InputError(f"{self.path}: {name}: got {show(table)}; allowed: a table")
        return Contents(f"{self.path}: {name}", table, {})


def write_npz(path: Path | str, plain: Mapping[str, Any], arrays: Mapping[str, Any], read: Reader) -> Path:
    """Write arrays, and values that JSON holds, to a temporary name first, and return the path.

    Args:
        path: of the file.
        plain: values that JSON holds.
        arrays: by name.
        read: reads the file back, see ``write_atomically``; not called where there are more bytes than half of what is
            usually read, so that a long simulation is not lost at its end.

    Raises:
        InputError: the file cannot be written, or cannot be read back.
    """
    members: dict[str, Any] = {**arrays, META: np.array(json.dumps(plain, default=as_plain))}
    is_usual = sum(np.asarray(x).nbytes for x in members.values()) <= most_bytes() // 2
    back = read if is_usual else None
    return write_atomically(Path(path), lambda stream: np.savez_compressed(stream, **members), read=back)


def write_json(path: Path | str, plain: Mapping[str, Any], read: Reader) -> Path:
    """Write values as .json, to a temporary name first, and return the path.

    Raises:
        InputError: another ending, a number that is not finite, or the file cannot be written, or cannot be read back
            by ``read``.
    """
    target = check_ending(path, JSON)
    try:
        text = json.dumps(plain, indent=1, default=as_plain, allow_nan=False)
    except ValueError:
        raise InputError(f"{show_path(str(target))}: the result has numbers that are not finite") from None
    return write_atomically(target, lambda stream: stream.write(text.encode("ascii")), read=read)


def plain_fields(result: Any, *left_out: str) -> dict[str, Any]:
    """Return the fields of a result by name as JSON holds them, without some of them."""
    return {x.name: as_plain(getattr(result, x.name)) for x in fields(result) if x.name not in left_out}


def as_plain(value: Any) -> Any:
    """Return a value as JSON holds it: arrays and tuples as lists, mappings and dataclasses as dicts."""
    if isinstance(value, np.ndarray):
        return as_plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: as_plain(x) for key, x in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_plain(x) for x in value]
    if is_dataclass(value):
        return plain_fields(value)
    return value


def read_json(path: Path | str) -> Any:
    """Read the values of a .json.

    Raises:
        InputError: the file cannot be read, or is no JSON; names the file.
    """
    try:
        text = read_regular(Path(path), _MOST_BYTES).decode("utf-8")
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error)
        allowed = "" if "allowed: " in reason else f"; {ALLOWED}"
        raise InputError(f"{path}: cannot be read: {reason}{allowed}") from None
    return parse_json(text, str(path), _MOST_MEMORY)


def plain_of(arrays: dict[str, NDArray[Any]], where: str) -> Any:
    """Take the text ``meta`` from the arrays of a file and return its values; None where there is no such text.

    Raises:
        InputError: it is no JSON; the message begins with ``where``.
    """
    text = arrays.pop(META, np.zeros(0))
    if text.shape != () or text.dtype.kind != "U":
        return None
    return parse_json(str(text), where, most_bytes() // 2)
