"""Bounds that states of laws cannot leave: where fixed explicit steps do, they are too long for the laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..calls import Calls
from ..raw import Array

MARGIN = 1.1  # of a bound, which errors of good steps do not reach


def _bristles(numbers: Mapping[str, float]) -> float:
    """Return the deflection at which bristles yield at the latest, m or rad."""
    level = max(numbers["friction.coulomb"], numbers.get("friction.static", 0.0))
    return level / numbers["friction.bristle_stiffness"]


BOUNDS: Mapping[str, Callable[[Mapping[str, float]], float]] = {"friction.z": _bristles}  # by a state's name
METHODS = "method='rosenbrock' or 'radau', or a shorter step"


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
    def of(cls, calls: Calls, names: tuple[str, ...], begin: Array) -> StateBounds:
        """Return the bounds with the kernel's parameters as they are; what begins beyond one is bounded by itself.

        Args:
            begin: what a motion begins with, (..., n), whose last numbers are the states.
        """
        meta, values = calls.raw.libraries.meta, calls.parameters.state.values
        laws, limits = meta["elements"].get("coordinates", {}), []
        for name in names:
            joint, kind, state = name.split(".", 2)
            numbers = {key: float(values[place]) for key, place in laws.get(f"{joint}.{kind}", {}).items()}
            limits.append(BOUNDS[state](numbers) if state in BOUNDS else np.inf)
        return cls(names, np.maximum(MARGIN * np.array(limits), np.abs(begin[..., -len(names) :])))

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
