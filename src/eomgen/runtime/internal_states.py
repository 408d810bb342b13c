"""Internal states of force laws in rollouts: they stand behind velocities, and have bounds that they cannot leave.

A package of a robot without such laws does not carry this module.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, IntegrationStopped
from .arrays import joint_lead
from .calls import Calls
from .raw import Array
from .rollouts import Control, Inputs, Rollout

MARGIN = 1.1  # of the bounds of internal states, which errors of good steps do not reach
METHODS = "method='rosenbrock' or 'radau', or a shorter step"


def split_state(name: str) -> tuple[str, str, str]:
    """Return owner, law and state of the name of an internal state: "j1.x", "maxwell", "0.z" of "j1.x.maxwell.0.z"."""
    *words, state = name.split(".")
    if words[-1].isdigit():  # of a branch
        state = f"{words.pop()}.{state}"
    return ".".join(words[:-1]), words[-1], state


def cut_apart(rates: Array, coordinates: int) -> tuple[Array, Array]:
    """Return velocities of so many coordinates, and what stands behind these: internal states z."""
    return np.ascontiguousarray(rates[..., :coordinates]), np.ascontiguousarray(rates[..., coordinates:])


def joined_inputs(calls: Calls, z: ArrayLike | None, inputs: Inputs) -> Inputs:
    """Return inputs in the arrays of the C: z, 0 by default, stands behind v; efforts are as they are.

    Raises:
        InputError: z, and no force law has internal states.
        ArrayError: an array of another length.
    """
    if not calls.internal_states:
        calls.refuse_z(z)
        return inputs
    control, m = inputs.control, len(calls.internal_states)
    states = np.zeros(m, calls.dtype) if z is None else z
    v0 = behind(calls, ("v0", inputs.v0, calls.n), ("z", states, m))
    u, kp, kd = (padded(calls, x, y) for x, y in (("u", inputs.u), ("kp", control.kp), ("kd", control.kd)))
    effort = None if control.effort is None else np.append(control.effort, np.full(calls.inputs - calls.n, np.inf))
    return Inputs(inputs.q0, v0, u, Control(kp, kd, control.target, effort))


def taken_apart(calls: Calls, take: Callable[[], Rollout]) -> Rollout:
    """Return the result of steps with internal states of its own, also that of an IntegrationStopped."""
    if not calls.internal_states:
        return take()
    try:
        return _apart(take(), calls.n)
    except IntegrationStopped as error:
        error.set_apart(calls.n)
        if error.stored is not None:
            error.stored = _apart(Rollout.of(*error.stored), calls.n)
        raise


def _apart(rollout: Rollout, coordinates: int) -> Rollout:
    """Return q and v of so many coordinates, and what stands behind these in v as ``z``."""
    q, rates = rollout
    v, z = cut_apart(rates, coordinates)
    return Rollout.of(q, v, **vars(rollout), z=z)


def behind(calls: Calls, *parts: tuple[str, ArrayLike, int]) -> Array:
    """Return arrays of states, by name and length, one behind the other in the last axis."""
    taken = [calls.array(label, value, (size,)) for label, value, size in parts]
    lead: tuple[int, ...] = ()
    for (label, *_), (_, own) in zip(parts, taken, strict=True):
        lead = joint_lead(label, own, lead)
    return np.concatenate([np.broadcast_to(x, (*lead, x.shape[-1])) for x, _ in taken], axis=-1)


def padded(calls: Calls, label: str, value: ArrayLike | None) -> Any:
    """Return inputs of coordinates, (..., n), with zeros for forces beside drives behind; what is no array as it is.

    Raises:
        ArrayError: an array of another length.
    """
    try:
        shape = np.shape(value)  # type: ignore[arg-type]  # of None ()
    except ValueError:  # no array at all: checks say so
        return value
    if not shape:
        return value
    if shape[-1] != calls.n:
        raise ArrayError(f"{label}: got shape {shape}; allowed: ({calls.n},) or (..., {calls.n})")
    array = np.asarray(value)
    return np.concatenate([array, np.zeros((*array.shape[:-1], calls.inputs - calls.n), array.dtype)], axis=-1)


def _bristles(numbers: Mapping[str, float]) -> float:
    """Return the deflection at which bristles yield at the latest, m or rad."""
    level = max(numbers["friction.coulomb"], numbers.get("friction.static", 0.0))
    return level / numbers["friction.bristle_stiffness"]


def _hysteresis(numbers: Mapping[str, float]) -> float:
    """Return the deflection at which Bouc-Wen hysteresis yields, m or rad; infinite where it never does."""
    A, beta, gamma, n = (numbers[f"hysteresis.{key}"] for key in ("A", "beta", "gamma", "n"))
    return float((A / (beta + gamma)) ** (1.0 / n)) if beta + gamma > 0.0 else np.inf


BOUNDS: Mapping[str, Callable[[Mapping[str, float]], float]] = {  # by a state's name
    "friction.z": _bristles,
    "hysteresis.z": _hysteresis,
}


@dataclass(frozen=True)
class StateBounds:
    """Bounds of the states of a kernel's laws.

    Attributes:
        names: of the states, (s,).
        bounds: of their sizes, (..., s), infinite where nothing bounds one.
    """

    names: tuple[str, ...]
    bounds: Array

    @classmethod
    def of(cls, calls: Calls, begin: Array) -> StateBounds:
        """Return the bounds with the kernel's parameters as they are; what begins beyond one is bounded by itself.

        Args:
            begin: what a motion begins with, (..., n), whose last numbers are the states.
        """
        meta, values = calls.raw.libraries.meta, calls.parameters.state.values
        tables = {**meta["elements"].get("coordinates", {}), **meta["elements"].get("cut_laws", {})}
        limits = []
        for name in calls.internal_states:
            owner, law, state = split_state(name)
            bound = BOUNDS.get(f"{law}.{state}")
            numbers = {key: float(values[place]) for key, place in tables.get(owner, {}).items()}
            limits.append(bound(numbers) if bound is not None and numbers else np.inf)
        return cls(calls.internal_states, np.maximum(MARGIN * np.array(limits), np.abs(begin[..., -len(limits) :])))

    def within(self, v: Array) -> Array:
        """Return which states are within their bounds, (..., rows, s), in velocities with states behind them."""
        return np.asarray(np.abs(v[..., -len(self.names) :]) <= self.bounds[..., np.newaxis, :])

    def first_beyond(self, v: Array) -> tuple[tuple[int, ...], str] | None:
        """Return the place, (..., row, state), of the first state beyond its bound, and say so; None where none is.

        Args:
            v: velocities with states behind them, (..., rows, n); what is no number is left to others.
        """
        within = self.within(v) | np.isnan(v[..., -len(self.names) :])
        if within.all():
            return None
        place = tuple(int(i) for i in np.unravel_index(int(within.argmin()), within.shape))
        bound = np.broadcast_to(self.bounds[..., np.newaxis, :], within.shape)[place]
        size, name = abs(v[..., -len(self.names) :][place]), self.names[place[-1]]
        return place, f"{name} is {size:.3g}, and cannot exceed {bound:.3g}; allowed: {METHODS}"


def wrong_state(calls: Calls, method: str, v: Array) -> tuple[StateBounds, tuple[int, ...], str] | None:
    """Return the bounds of internal states, and of the first one that steps of a length let leave them what
    ``StateBounds.first_beyond`` does; None where none leaves them.

    Args:
        v: velocities with the states behind them, (..., rows, n).
    """
    if method != "rk4" or not calls.internal_states:
        return None
    bounds = StateBounds.of(calls, v[..., 0, :])
    beyond = bounds.first_beyond(v)
    return None if beyond is None else (bounds, *beyond)
