"""Arguments of calls on devices: which array is which, and numbers that are the same for all states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..names import show

MOST_STEPS = 2**31 - 1


def named_arrays(
    name: str, arrays: tuple[Any, ...], others: dict[str, Any], reads: Mapping[str, tuple[int, ...]]
) -> dict[str, Any]:
    """Return a call's arrays by their names; those given by name are taken out of the others.

    Raises:
        InputError: some are missing, twice, or too many.
    """
    labels = list(reads)
    given = dict(zip(labels, arrays, strict=False))
    twice = [label for label in labels if label in given and label in others]
    named = {label: others.pop(label) for label in labels if label in others and label not in given}
    whole = {label: {**given, **named}[label] for label in labels if label in given or label in named}
    if len(arrays) > len(labels) or twice or len(whole) < len(labels):
        missing = [label for label in labels if label not in whole]
        said = f"{len(arrays)} arrays" if len(arrays) > len(labels) else ", ".join(twice) + " twice"
        raise InputError(
            f"{name}: {', '.join(missing) + ' missing' if missing else said}; allowed: {', '.join(labels)}"
        )
    return whole


def named_outs(name: str, out: Any, writes: Mapping[str, tuple[int, ...]]) -> dict[str, Any]:
    """Return arrays to write to by their names.

    Raises:
        InputError: they are not as many as there are results.
    """
    if out is None:
        return {}
    if len(writes) == 1:
        return dict.fromkeys(writes, out)
    if not isinstance(out, (tuple, list)) or len(out) != len(writes):
        raise InputError(
            f"out: got {type(out).__name__}; allowed: a tuple of {len(writes)} arrays, {', '.join(writes)}"
        )
    return dict(zip(writes, out, strict=True))


def number_of(name: str, key: str, kind: str, value: Any, dtype: np.dtype[Any]) -> Any:
    """Return a number for all states with its type.

    Args:
        kind: "int", or "real" of the kernel's dtype.

    Raises:
        InputError: it is none, negative or not finite.
    """
    is_number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    is_allowed = is_number and math.isfinite(value) and value >= 0
    if kind == "int":
        if not is_allowed or value != int(value) or value > MOST_STEPS:
            raise InputError(f"{name}: {key} = {show(value)}; allowed: a whole number from 0 to {MOST_STEPS}")
        return np.int32(value)
    if not is_allowed:
        raise InputError(f"{name}: {key} = {show(value)}; allowed: a finite number from 0 on")
    return dtype.type(value)


def shown_shape(shape: Sequence[Any]) -> str:
    """Show a shape whose lengths may have names: (N, 6)."""
    return f"({', '.join(map(str, shape))})"
