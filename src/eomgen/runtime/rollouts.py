"""Arguments of rollouts of all methods, states, drives over time, a controller's gains, and what they return."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ..errors import ArrayError, InputError
from ..names import show
from .calls import Calls
from .raw import Array

SHARE = 16  # states that are worth a separate thread
FIXED = {"rk4": 0, "implicit": 1}  # methods of steps of one length, and their numbers in C
NUMBERS = 2**62  # of all coordinates at all steps of all states, at most: C counts them
LONGEST = 1e30  # time, s: as of all numbers that descriptions and scenarios may have


class Rollout(tuple[Array, Array]):
    """q and v of a rollout, as ``Kernel.rollout`` returns them, and what its steps were.

    Attributes:
        steps: steps taken, of one state a number, of many (N,).
        rejected: steps that were tried again, shorter, likewise.
        largest, smallest: the longest and the shortest step, s, likewise.
        works: where they were integrated, of ``input_signals.WORKS``, J, (samples + 1, 4), of many (N, samples + 1, 4).
        z: of robots with internal states these, as q and v.
    """

    steps: Any
    rejected: Any
    largest: Any
    smallest: Any
    works: Any
    z: Array

    @classmethod
    def of(cls, q: Array, v: Array, **figures: Any) -> Rollout:
        """Return q and v with the attributes, by name."""
        rollout = cls((q, v))
        vars(rollout).update(figures)
        return rollout


@dataclass(frozen=True)
class FixedSteps:
    """Steps of one length of a rollout.

    Attributes:
        method: "rk4" or "implicit".
        dt: length of a step, s.
        steps: their number.
        every: one of so many steps is stored.

    Raises:
        InputError: the method is unknown.
    """

    method: str = "rk4"
    dt: float | None = None
    steps: int | None = None
    every: int = 1

    def __post_init__(self) -> None:
        if not isinstance(self.method, str) or self.method not in FIXED:
            raise InputError(f"rollout: method {show(self.method)} is unknown; allowed: {', '.join(FIXED)}")

    def fixed_steps(self, calls: Calls, count: int | None) -> tuple[float, int, int]:
        """Return dt (s), steps and every as a kernel takes them.

        Args:
            count: of states, None for a single one.

        Raises:
            InputError: one of them is not allowed.
        """
        most = most_rows(calls, count)
        steps, every = whole_number("steps", self.steps, most), whole_number("every", self.every, most)
        dt, least = as_number(self.dt), float(np.finfo(calls.dtype).tiny)
        if not least <= dt <= LONGEST:
            allowed = f"a number from {least:.3g}, the least above 0 that {calls.dtype} holds, to {LONGEST:g}"
            raise InputError(f"rollout: dt = {show(self.dt)} is not a length of time; {allowed} is allowed")
        return dt, steps, every


@dataclass(frozen=True)
class Control:
    """A joint controller, which adds kp (target - q) - kd v to the drives, and limits of these.

    Attributes:
        kp, kd: gains, a number for all principal coordinates or (n,); none without a controller.
        target: coordinates that it aims at, shapes as of the drives.
        effort: greatest forces of drives, (n,), N or N m, infinite where there is none; None where none is clipped.

    Raises:
        InputError: gains without a target, or a target without gains.
    """

    kp: ArrayLike | None = None
    kd: ArrayLike | None = None
    target: ArrayLike | None = None
    effort: Array | None = None

    def __post_init__(self) -> None:
        if (self.target is None) != (self.kp is None and self.kd is None):
            raise InputError("rollout: a controller needs a target, the coordinates that it aims at, and kp or kd")


@dataclass(frozen=True)
class Inputs:
    """States at the beginning of a rollout, drives and a controller, as ``Kernel.rollout`` takes them."""

    q0: ArrayLike
    v0: ArrayLike
    u: ArrayLike | None
    control: Control

    def count(self) -> int | None:
        """Return the number of states, or None for a single one: the leading axes of arrays that have one.

        Raises:
            ArrayError: arrays of different numbers of states.
        """
        sizes = {}
        arrays = ("q0", self.q0, 2), ("v0", self.v0, 2), ("u", self.u, 3), ("target", self.control.target, 3)
        for label, value, axes in arrays:
            if value is not None and len(shape := shape_of(value)) == axes:
                sizes[label] = shape[0]
        if not sizes:
            return None
        if len({size for size in sizes.values() if size != 1}) > 1:
            raise ArrayError(f"rollout: {', '.join(f'{size} states in {label}' for label, size in sizes.items())}")
        return max(sizes.values())


@dataclass(frozen=True)
class RolloutArrays:
    """States and drives as C takes them.

    Attributes:
        count: number of states, None for a single one that is no batch.
        starts: q, and velocities with internal states behind them, and how far apart two states lie.
        drives: u with forces beside drives behind it, and targets, and how far apart their numbers of two states and of
            two rows are.
        gains: kp and kd, as u, or none.
        effort: greatest forces of drives, as u, or none.
    """

    count: int | None
    starts: list[tuple[Array, int]]
    drives: list[tuple[Array, int, int]]
    gains: list[Array]
    effort: Array | None = None

    def fields(self, calls: Calls, state: int, step: int = 0) -> dict[str, Any]:
        """Return fields of a drive for C, from a state and a step on; the pointers must be kept alive."""
        view, fields = calls.raw.view, dict[str, Any]()
        for name, (array, of_state, of_step) in zip(("u", "target"), self.drives, strict=False):
            fields[name] = view(array.reshape(-1)[state * of_state + step * of_step :])
            fields[f"{name}_state"], fields[f"{name}_step"] = of_state, of_step
        if self.gains:
            fields["kp"], fields["kd"] = map(view, self.gains)
        if self.effort is not None:
            fields["effort"] = view(self.effort)
        return fields

    def trouble(self, calls: Calls) -> ArrayError | None:
        """Return the error that names an input that is not finite (``checks`` may have let it through), or None."""
        arrays = [(array, 0) for array, _ in self.starts] + [(array, apart) for array, _, apart in self.drives]
        for label, (array, apart) in zip(("q0", "v0", "u", "target"), arrays, strict=False):
            try:
                calls.arrays.refuse_not_finite(label, array, array.shape[-2:] if apart else array.shape[-1:])
            except ArrayError as error:
                return error
        return None


def read_arrays(calls: Calls, inputs: Inputs, rows: int, count: int | None) -> RolloutArrays:
    """Read states, drives and a controller of a rollout, in the arrays of the C.

    Args:
        rows: how many drives there may be one after the other.
        count: of states, None for a single one.

    Raises:
        ArrayError: arrays that do not fit together.
        InputError: gains that are not allowed.
    """
    control, u = inputs.control, np.zeros(calls.inputs, calls.dtype) if inputs.u is None else inputs.u
    states = ("q0", inputs.q0, calls.n), ("v0", inputs.v0, calls.rates)
    starts = [_start(calls, label, value, count, size) for label, value, size in states]
    drives = [_over_time(calls, "u", u, rows, count, calls.inputs)]
    gains = _controller_gains(calls, control)
    if control.target is not None:
        drives.append(_over_time(calls, "target", control.target, rows, count, calls.n))
    return RolloutArrays(
        count, starts, drives, gains, None if control.effort is None else control.effort.astype(calls.dtype)
    )


def shape_of(value: ArrayLike) -> tuple[int, ...]:
    """Return the shape of an array-like; () for rows of different lengths, which conversions refuse."""
    try:
        return value.shape if isinstance(value, np.ndarray) else np.shape(value)
    except ValueError:
        return ()


def _start(calls: Calls, label: str, value: ArrayLike, count: int | None, n: int) -> tuple[Array, int]:
    """Return n numbers of a state or many, and how far apart two lie."""
    array, states = _rows(calls, label, value, (n,))
    return array, n if states == count and count is not None else 0


def _over_time(
    calls: Calls, label: str, value: ArrayLike, steps: int, count: int | None, n: int
) -> tuple[Array, int, int]:
    """Return the value, n numbers each, and how far apart those of two states and of two steps are."""
    shape = shape_of(value)
    if len(shape) == 3:
        array, states = _rows(calls, label, value, (steps, n))
        if states not in (1, count):
            raise ArrayError(f"{label}: {states} states, but {count} in other arrays")
        return array, steps * n if states == count else 0, n
    if count is None and shape == (steps, n):
        return calls.array(label, value, (steps, n))[0], 0, n
    array, rows = _rows(calls, label, value, (n,))
    if rows is None:
        return array, 0, 0
    if rows != (steps if count is None else count):
        wanted = f"({steps}, {n}), a row for every step" if count is None else f"({count}, {n}), a row for every state"
        raise ArrayError(f"{label}: expected {calls.dtype} of shape ({n},) or {wanted}, got shape {array.shape}")
    return (array, 0, n) if count is None else (array, n, 0)


def _rows(calls: Calls, label: str, value: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, int | None]:
    """Return the array, and its number of rows; None where it is one alone."""
    array, lead = calls.array(label, value, shape)
    if len(lead) > 1:
        inner = ", ".join(map(str, shape))
        raise ArrayError(f"{label}: expected {calls.dtype} of shape ({inner}) or (N, {inner}), got shape {array.shape}")
    return array, lead[0] if lead else None


def _controller_gains(calls: Calls, control: Control) -> list[Array]:
    """Return kp and kd, zeros beside drives; none where there is no controller."""
    if control.target is None:
        return []
    gains: list[Array] = []
    driven: Sequence[int] = calls.raw.libraries.meta["driven"]  # coordinates that a controller may act on
    for label, value in (("kp", control.kp), ("kd", control.kd)):
        if isinstance(value, np.ndarray) and value.ndim == 0:
            value = value.item()
        if value is None or is_number(value):
            per_coordinate = [0.0] * calls.inputs
            for i in driven if value is not None else ():
                per_coordinate[i] = value  # type: ignore[call-overload]
            value = per_coordinate
        array, many = calls.array(label, value, (calls.inputs,))
        deviations = np.setdiff1d(np.arange(calls.n), driven)
        if many or (array < 0).any():
            raise InputError(f"rollout: {label} must be one number or (n,), none below 0")
        for i in deviations[array[deviations] != 0]:
            raise InputError(
                f"rollout: {label} is {array[i]} at {calls.coordinates[i]}; only principal coordinates, or the"
                " motors in front of them, have a drive that can be controlled; none that is prescribed"
            )
        gains.append(array)
    return gains


def whole_number(label: str, number: Any, most: int) -> int:
    """Return a number from 1 to the most that is allowed; InputError of another one."""
    if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 1 <= number <= most:
        raise InputError(f"rollout: {label} = {show(number)} is not a whole number from 1 to {most}")
    return int(number)


def as_number(value: Any) -> float:
    """Return a number as a float: infinite where that is too large for one, NaN where it is no number."""
    try:
        return float(value) if is_number(value) else np.nan
    except OverflowError:
        return np.inf


def is_number(value: Any) -> bool:
    """Return whether a value is a number and no truth value."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def most_rows(calls: Calls, count: int | None) -> int:
    """Return the most rows that all of so many states may have."""
    return NUMBERS // (calls.rates * max(count or 1, 1))


def allocate_states(calls: Calls, shape: tuple[int, ...], fewer: str, dtype: DTypeLike | None = None) -> Array:
    """Allocate arrays of states, NaN until they are reached; InputError without the memory, with what stores fewer."""
    try:
        return np.full(shape, np.nan, calls.dtype if dtype is None else dtype)
    except (MemoryError, ValueError):
        rows, numbers = shape[-2], float(np.prod(shape, dtype=np.float64))
        raise InputError(
            f"rollout: {rows} states to be stored take twice {numbers * calls.dtype.itemsize / 1e9:.3g} GB, more than"
            f" there is; {fewer} stores fewer"
        ) from None
