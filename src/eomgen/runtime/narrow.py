"""Arrays of coordinates alone, of kernels whose arrays have states of laws behind them.

There is one rule.  Arrays have the numbers of ``kernel.velocities``, states of laws behind coordinates, and so have
results; or all have those of ``kernel.coordinates`` alone, and so have results.  Functions that depend on the states
take them apart then, as z; the others need none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, InputError
from ..names import listed
from .arrays import BY_COORDINATE, Arrays, Lead, joint_lead
from .raw import Array, RawKernel

DERIVATIVE = re.compile(r"(_parameter)?_(tangent|adjoint|hessian)$")
REMEMBERING = frozenset(  # functions, also of the open tree and under load, whose results depend on states of laws
    (
        *("generalized_force", "residual", "inverse_dynamics", "forward_dynamics", "constraint_forces", "energy"),
        *("reactions", "loop_reactions", "coupling_forces", "residual_jacobian", "forward_dynamics_jacobian"),
        *("constrained_dynamics", "constrained_drives"),
    )
)


class Calls(Protocol):
    """What of checked calls is needed here: see ``calls.Calls``, whose arrays have n numbers, of coordinates narrow."""

    raw: RawKernel
    arrays: Arrays
    dtype: np.dtype[Any]
    memory: tuple[str, ...]
    n: int
    narrow: int

    @property
    def checks(self) -> bool:
        """Whether NaN and infinity are refused."""

    def array(self, label: str, value: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, Lead]:
        """Convert a value to an array of that shape, and tell the axes in front of it."""


def remembers(name: str) -> bool:
    """Return whether a function's result depends on states of laws."""
    plain = DERIVATIVE.sub("", name)
    return plain.removeprefix("tree_").removesuffix("_under_load") in REMEMBERING


def is_narrow(calls: Calls, value: Any) -> bool:
    """Return whether an array has numbers of coordinates alone, where states of laws stand behind these."""
    if not calls.memory:
        return False
    try:
        return bool(np.shape(value)[-1:] == (calls.narrow,))
    except ValueError:  # no array at all: checks say so
        return False


def widened(calls: Calls, label: str, value: ArrayLike, behind: Array | None = None) -> Array:
    """Return numbers of coordinates, (..., n), with states of laws behind them, zeros if not given."""
    array, lead = calls.array(label, value, (calls.narrow,))
    states = np.zeros(len(calls.memory), calls.dtype) if behind is None else behind
    both = joint_lead(label, lead, states.shape[:-1])
    return np.concatenate([np.broadcast_to(x, (*both, x.shape[-1])) for x in (array, states)], axis=-1)


def whole_array(calls: Calls, label: str, value: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Return an array of the kernel's length, and its leading axes; of coordinates alone with zeros behind them."""
    if is_narrow(calls, value):
        array = widened(calls, label, value)
        return array, array.shape[:-1]
    return calls.array(label, value, (calls.n,))


def states_apart(calls: Calls, z: ArrayLike) -> Array:
    """Return states of laws, (..., memory).

    Raises:
        InputError: no law has a state.
        ArrayError: another shape, or numbers that are not finite.
    """
    if not calls.memory:
        raise InputError(f"z: no law of {calls.raw.name} has a state; allowed: a call without z")
    states, _ = calls.arrays.taken("z", z, (len(calls.memory),), False)
    if calls.checks and not np.isfinite(states).all():
        where = np.argwhere(~np.isfinite(states))[0]
        raise ArrayError(f"z: {calls.memory[where[-1]]} is {states[tuple(where)]}; numbers must be finite")
    return states


def run_narrow(
    calls: Calls,
    name: str,
    out: Array | None,
    values: Sequence[ArrayLike],
    z: ArrayLike | None,
    run: Callable[[list[ArrayLike]], Array],
) -> Array | None:
    """Call a function with room for states of laws in arrays of coordinates alone, and return its result without them.

    Args:
        name: the function's.
        values: what it reads, in its order; others behind them stay as they are.
        z: states of laws apart.
        run: calls it with wide arrays.

    Returns:
        The result; None where all arrays are wide, and there is nothing to do here.

    Raises:
        InputError: z of a robot without states of laws.
        ArrayError: arrays of both lengths, or no z where the result depends on it.
    """
    states = None if z is None else states_apart(calls, z)
    function = calls.raw.functions.get(name)
    if function is None:
        raise calls.raw.missing(name)
    pairs = list(zip(function.reads, values, strict=False))
    long = [label for label, _ in pairs if calls.arrays.is_by_coordinate(label)]
    short = [label for label, value in pairs if label in long and is_narrow(calls, value)]
    if states is None and not short:
        return None
    refuse_mixed(calls, name, [pair for pair in pairs if pair[0] in long], apart=states is not None)
    wide = [
        widened(calls, label, value, states if label == "v" else None) if label in short else value
        for label, value in pairs
    ]
    result = run([*wide, *values[len(pairs) :]])
    narrow = cut(calls, result, function.writes)
    if out is None:
        return narrow
    out = calls.arrays.checked_out(out, narrow.shape, ())
    out[...] = narrow
    return out


def refuse_mixed(calls: Calls, name: str, pairs: Sequence[tuple[str, Any]], *, apart: bool = False) -> None:
    """Refuse arrays of coordinates, by their labels, of which some have states of laws behind them.

    Args:
        name: of the function that reads them, which may depend on such states.
        apart: whether z is given apart.

    Raises:
        ArrayError: it is so, or nothing says what z is.
    """
    n = calls.narrow
    short = [label for label, value in pairs if is_narrow(calls, value)]
    for label, value in pairs:
        if label not in short:
            why = "z stands apart" if apart else f"{short[0]} has"
            raise ArrayError(f"{label}: got {got(value)}; allowed: {n} numbers, as {why}")
    if not apart and remembers(name):
        plain = DERIVATIVE.sub("", name)
        said, or_z = (name, f"z, (..., {len(calls.memory)}), or ") if plain == name else (f"derivatives of {plain}", "")
        what = f"allowed: {or_z}arrays of {calls.n} numbers, with z behind v"
        raise ArrayError(f"{said}: arrays of {n} numbers lack states of laws, {listed(calls.memory)}; {what}")


def got(value: Any) -> str:
    """Say what an argument is: its shape, or its type where it has none."""
    try:
        return f"shape {np.shape(value)}"
    except ValueError:
        return type(value).__name__


def narrow_shape(calls: Calls, shape: tuple[int, ...], writes: str) -> tuple[int, ...]:
    """Return the shape of a result of that kind without states of laws."""
    if writes == "regressor":
        return (calls.narrow, *shape[1:])
    axes = BY_COORDINATE.get(writes, 0)
    return (*shape[: len(shape) - axes], *(calls.narrow,) * axes)


def cut(calls: Calls, result: Array, writes: str) -> Array:
    """Return the entries of coordinates of a result of that kind."""
    part = slice(calls.narrow)
    if writes == "regressor":  # its columns are parameters
        return np.ascontiguousarray(result[..., part, :])
    place: tuple[Any, ...] = (..., *((part,) * BY_COORDINATE.get(writes, 0)))
    return np.ascontiguousarray(result[place])
