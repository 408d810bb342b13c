"""The .npz file of a simulation: arrays by name, and ``meta``, everything else as JSON.

It knows nothing of what the arrays mean; ``SimulationResult.save`` and ``load_result`` do.
"""

from __future__ import annotations

import json
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import write_atomically

FORMAT = 1  # raised when a reader of the old one would misread it
_DAMAGED = (  # what NumPy and zipfile raise for files that are not what they wrote
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


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
    try:
        with np.load(path, allow_pickle=False) as data:
            meta = json.loads(str(data["meta"]))
            if meta["format"] > FORMAT:
                raise InputError(
                    f"{path}: written by eomgen {meta['versions'].get('eomgen')}, which is newer than this one"
                )
            arrays = {name: np.array(data[name]) for name in data.files if name != "meta"}
        yield meta, arrays
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except _DAMAGED as error:
        raise InputError(f"{path}: is not a saved simulation ({error})") from None
