"""The .npz file of a simulation: arrays by name, and ``meta``, everything else as JSON.

It knows nothing of what the arrays mean; ``SimulationResult.save`` and ``load_result`` do.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import write_atomically
from ..names import show
from ..npz import read_npz

FORMAT = 1  # raised when a reader of the old one would misread it
_DAMAGED = (ValueError, KeyError, TypeError, AttributeError, RuntimeError, OverflowError)  # of meta that is another's


def write_archive(path: Path | str, meta: Mapping[str, Any], arrays: Mapping[str, Any]) -> Path:
    """Write arrays, and values that JSON holds, to a temporary name first, and return the path.

    Raises:
        InputError: the file cannot be written.
    """
    text = json.dumps({"format": FORMAT, **meta})
    given: dict[str, Any] = dict(arrays)
    return write_atomically(Path(path), lambda stream: np.savez_compressed(stream, meta=text, **given))


@contextmanager
def open_archive(path: Path | str) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Give what ``write_archive`` wrote, meta and arrays, to a block that makes something of it.

    Raises:
        InputError: the file cannot be read, is of a newer eomgen, or the block does not find in it what it needs.
    """
    arrays: dict[str, Any] = read_npz(path)
    try:
        meta = json.loads(str(arrays.pop("meta")))
        if meta["format"] > FORMAT:
            raise InputError(
                f"{path}: written by eomgen {meta['versions'].get('eomgen')}, which is newer than this one"
            )
        yield meta, arrays
    except _DAMAGED as error:
        raise InputError(f"{path}: is not a saved simulation ({show(str(error))})") from None
