"""The .npz file of a simulation: arrays by name, and ``meta``, everything else as JSON.

It knows nothing of what they mean; ``contents`` does.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import write_atomically
from ..forms.plain import parse_json, printable
from ..names import show
from ..npz import most_bytes, read_npz

FORMAT = 1  # raised when a reader of the old one would misread it


def write_archive(path: Path | str, meta: Mapping[str, Any], arrays: Mapping[str, Any]) -> Path:
    """Write arrays, and values that JSON holds, to a temporary name first, and return the path.

    Raises:
        InputError: the file cannot be written.
    """
    text = json.dumps({"format": FORMAT, **meta})
    given: dict[str, Any] = dict(arrays)
    return write_atomically(Path(path), lambda stream: np.savez_compressed(stream, meta=text, **given))


def read_archive(path: Path | str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read meta and arrays that ``write_archive`` wrote.

    Raises:
        InputError: the file cannot be read, is no such file, or is of a newer eomgen.
    """
    arrays = read_npz(path)
    text = arrays.pop("meta", np.zeros(0))
    if text.shape != () or text.dtype.kind != "U":
        raise InputError(f"{path}: is not a saved simulation (meta is no text); allowed: a file that eomgen wrote")
    meta = parse_json(str(text), f"{path}: meta", most_bytes() // 2)
    number = meta.get("format") if isinstance(meta, dict) else None
    if isinstance(number, bool) or not isinstance(number, int) or number < 1:
        raise InputError(
            f"{path}: is not a saved simulation (format: {show(number)}); allowed: a file that eomgen wrote"
        )
    if number > FORMAT:
        versions = meta.get("versions")
        version = versions.get("eomgen") if isinstance(versions, dict) else None
        raise InputError(
            f"{path}: written by eomgen {printable(str(version))[:40]}, which is newer than this one;"
            f" allowed: up to format {FORMAT}"
        )
    return meta, arrays
