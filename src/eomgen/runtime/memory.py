"""States of laws apart from coordinates: arrays of n numbers and z, packed as the C has them, and taken apart again.

In the C a state of a law stands behind the coordinates as a velocity: q has a number there that acts on nothing, v the
state, a its rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, InputError
from ..names import listed
from .arrays import joint_lead
from .calls import Calls
from .raw import Array


@dataclass(frozen=True)
class Memory:
    """States of a kernel's laws.

    Attributes:
        calls: of the kernel.
        names: of the states, such as "joint1.gamma.friction.z".
    """

    calls: Calls
    names: tuple[str, ...]

    @classmethod
    def of(cls, calls: Calls, names: tuple[str, ...]) -> Memory:
        """Return the states of that names; InputError where there are none, so that z means nothing."""
        if not names:
            raise InputError(f"z: no law of {calls.raw.name} has a state; allowed: a call without z")
        return cls(calls, names)

    @property
    def coordinates(self) -> int:
        """Number of coordinates before the states."""
        return self.calls.n - len(self.names)

    def packed(self, values: Sequence[tuple[str, ArrayLike]], z: ArrayLike) -> list[Array]:
        """Return arrays of coordinates with room for states behind them: z behind v, zeros behind all others.

        Args:
            values: label and array, (..., n), the second one those of velocities.
            z: (..., states).

        Raises:
            ArrayError: another shape, or numbers that are not finite.
        """
        arrays = [self.calls.array(label, value, (self.coordinates,)) for label, value in values]
        states, lead = self.calls.arrays.taken("z", z, (len(self.names),), False)
        if self.calls.checks and not np.isfinite(states).all():
            where = np.argwhere(~np.isfinite(states))[0]
            raise ArrayError(f"z: {self.names[where[-1]]} is {states[tuple(where)]}; numbers must be finite")
        whole = []
        for place, (label, (array, own)) in enumerate(zip((label for label, _ in values), arrays, strict=True)):
            behind = states if place == 1 else np.zeros(len(self.names), self.calls.dtype)
            both = joint_lead(label, own, lead) if place == 1 else own
            parts = [np.broadcast_to(x, (*both, x.shape[-1])) for x in (array, behind)]
            whole.append(np.concatenate(parts, axis=-1))
        return whole

    def padded(self, value: ArrayLike | None) -> Any:
        """Return numbers of coordinates, (..., n), with zeros of states behind them; a number, or nothing, as it is."""
        if value is None or not np.ndim(value) or np.shape(value)[-1] != self.coordinates:
            return value
        array = np.asarray(value)
        return np.concatenate([array, np.zeros((*array.shape[:-1], len(self.names)), array.dtype)], axis=-1)

    def coordinates_of(self, array: Array, out: Array | None = None) -> Array:
        """Return the numbers of coordinates, in ``out`` if there is one."""
        return self._written(array[..., : self.coordinates], out)

    def states_of(self, array: Array, out: Array | None = None) -> Array:
        """Return the numbers of states, in ``out`` if there is one."""
        return self._written(array[..., self.coordinates :], out)

    def _written(self, part: Array, out: Array | None) -> Array:
        if out is None:
            return np.ascontiguousarray(part)
        out = self.calls.arrays.checked_out(out, part.shape, ())
        out[...] = part
        return out

    def tolerance(self, atol: ArrayLike | None) -> Array | None:
        """Return absolute tolerances of q, then of v, of which those of states are by default; None for all such.

        Raises:
            InputError: an array, which would lack those of the states.
        """
        if atol is None:
            return None
        if np.ndim(atol):
            raise InputError(f"atol: an array beside z lacks tolerances of {listed(self.names)}; allowed: a number")
        sizes = np.asarray(self.calls.raw.libraries.meta["sizes"])
        n, whole = self.coordinates, np.full(2 * self.calls.n, float(np.asarray(atol)))
        behind = np.r_[n : self.calls.n, self.calls.n + n : 2 * self.calls.n]
        whole[behind] = 1e-6 * sizes[behind]
        return whole
