"""What rollouts are given: states, drives over time, a controller's gains; and room for what they make of it.

A generated package carries a copy of this file.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError, InputError
from ..names import show
from .calls import Calls

Array = NDArray[Any]

NUMBERS = 2**62  # of all coordinates at all steps of all states, at most: C counts them
SHARE = 16  # states that are worth a thread of their own


def count_states(**values: ArrayLike | None) -> int | None:
    """Number of states, or None for a single one: the leading axes of those that have one."""
    sizes = {}
    for label, value in values.items():
        try:
            shape = np.shape(value) if value is not None else ()
        except ValueError:  # rows of different lengths, which are refused where they are converted
            continue
        if len(shape) == (2 if label in ("q0", "v0") else 3):
            sizes[label] = shape[0]
    if len({size for size in sizes.values() if size != 1}) > 1:
        raise ArrayError(f"rollout: {', '.join(f'{size} states in {label}' for label, size in sizes.items())}")
    return max(sizes.values()) if sizes else None


def start(calls: Calls, label: str, value: ArrayLike, count: int | None) -> tuple[Array, int]:
    """A state or many, and how far apart two lie."""
    array, states = _rows(calls, label, value, (calls.n,))
    return array, calls.n if states == count and count is not None else 0


def over_time(calls: Calls, label: str, value: ArrayLike, steps: int, count: int | None) -> tuple[Array, int, int]:
    """The value, and how far apart its numbers of two states and of two steps are."""
    n = calls.n
    if np.ndim(value) == 3:
        array, states = _rows(calls, label, value, (steps, n))
        if states not in (1, count):
            raise ArrayError(f"{label}: {states} states, but {count} in other arrays")
        return array, steps * n if states == count else 0, n
    if count is None and np.shape(value) == (steps, n):
        return calls.array(label, value, (steps, n))[0], 0, n
    array, rows = _rows(calls, label, value, (n,))
    if rows is None:
        return array, 0, 0
    if rows != (steps if count is None else count):
        wanted = f"({steps}, {n}), a row for every step" if count is None else f"({count}, {n}), a row for every state"
        raise ArrayError(f"{label}: expected {calls.dtype} of shape ({n},) or {wanted}, got shape {array.shape}")
    return (array, 0, n) if count is None else (array, n, 0)


def _rows(calls: Calls, label: str, value: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, int | None]:
    """The array, and its number of rows; None where it is one alone."""
    array, lead = calls.array(label, value, shape)
    if len(lead) > 1:
        inner = ", ".join(map(str, shape))
        raise ArrayError(f"{label}: expected {calls.dtype} of shape ({inner}) or (N, {inner}), got shape {array.shape}")
    return array, lead[0] if lead else None


def controller_gains(calls: Calls, driven: Sequence[int], kp: ArrayLike | None, kd: ArrayLike | None) -> list[Array]:
    """kp and kd, (n,) each; none where there is no controller."""
    if kp is None and kd is None:
        return []
    found = []
    for label, value in (("kp", kp), ("kd", kd)):
        if isinstance(value, np.ndarray) and value.ndim == 0:
            value = value.item()
        if value is None or is_number(value):
            given = [0.0] * calls.n
            for i in driven if value is not None else ():
                given[i] = value  # type: ignore[call-overload]
            value = given
        array, many = calls.array(label, value, (calls.n,))
        deviations = np.setdiff1d(np.arange(calls.n), driven)
        if many or (array < 0).any():
            raise InputError(f"rollout: {label} must be one number or (n,), none below 0")
        for i in deviations[array[deviations] != 0]:
            raise InputError(
                f"rollout: {label} is {array[i]} at {calls.coordinates[i]}; only principal coordinates, or the"
                " motors in front of them, have a drive that can be controlled; none that is prescribed"
            )
        found.append(array)
    return found


def whole_number(label: str, number: int | None, most: int) -> int:
    if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 1 <= number <= most:
        raise InputError(f"rollout: {label} = {show(number)} is not a whole number from 1 to {most}")
    return int(number)


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def room_for(calls: Calls, shape: tuple[int, ...]) -> Array:
    """Room for states, NaN until they are reached."""
    try:
        return np.full(shape, np.nan, calls.dtype)
    except (MemoryError, ValueError):
        rows, numbers = shape[-2], float(np.prod(shape, dtype=np.float64))
        raise InputError(
            f"rollout: {rows} states to be stored take twice {numbers * calls.dtype.itemsize / 1e9:.3g} GB, more than"
            " there is; a larger `every` stores fewer"
        ) from None


def not_finite(
    calls: Calls, starts: Sequence[tuple[Array, int]], drives: Sequence[tuple[Array, int, int]]
) -> ArrayError | None:
    """The error that names an input that is not finite (``checks`` may have let it through), or None."""
    given = [(array, 0) for array, _ in starts] + [(array, apart) for array, _, apart in drives]
    for label, (array, apart) in zip(("q0", "v0", "u", "target"), given, strict=False):
        try:
            calls.refuse_not_finite(label, array, array.shape[-2:] if apart else (calls.n,))
        except ArrayError as error:
            return error
    return None
