"""Samples as bytes, to be kept beside a source; read without SymPy and without the equations."""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROUNDED = 4  # states in which other orders of computing show
STATES = ("ordinary", "small", "denormal", "infinite", "not a number", *("rounded",) * ROUNDED)
MEASURED = 4  # states of which is known what rounding does
UNNAMED = -1  # a status of which only is known that it is none of success
UNITS = 16.0  # in the last place that each term of an identity may be off by


def pack_samples(arrays: Mapping[str, Any]) -> bytes:
    """Pack arrays or numbers as bytes."""
    stream = io.BytesIO()
    filled: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    np.savez(stream, **filled)
    return zlib.compress(stream.getvalue(), 1)


def read_samples(data: bytes) -> dict[str, NDArray[Any]]:
    """Read arrays by name; S is the number of STATES, with which axes begin where nothing else is said.

    Returns:
        "p", "q", "v" and so on (S, size): inputs.  "h": what functions read, of the first parameters.  "setup":
        what is computed from each of "p".  For every function by its name: its answer (S, size), of frames (S, numbers,
        size) with the "frames" numbers; "NAME status" (S,), as C says it; "NAME near" (MEASURED, ...): by how much
        rounding may change the answer, infinity where it decides what is finite; "NAME bits" (): whether there is no
        choice but in the order of operations.
        "NAME places" (...,): where the numbers lie in an answer, of which only some are known.  "NAME matrix" and
        "NAME right": equations of the numbers at "NAME unknown", and "NAME within" what they may be off by.
        "rollout" and "adaptive_rollout" (methods, states, 2 n) are a step of "dt" from rest by each method, q and v, of
        drives within "effort" (states, n).
    """
    with np.load(io.BytesIO(zlib.decompress(data)), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}
