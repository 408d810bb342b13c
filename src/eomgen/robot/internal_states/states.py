"""Internal states: their names, inertias and sizes.

In equations a state z is a velocity of an inertia w without a link: w z^2 / 2 is the energy that it stores; w is 1 of a
state that stores none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..numbers import Values


@dataclass(frozen=True, kw_only=True)
class State:
    """An internal state.

    Attributes:
        name: below the law's: "z".
        unit: of the laws of translations and of rotations.
        size: numbers -> what tolerances refer to.
        is_bounded: whether its law keeps it within a bound, which long steps of explicit methods may leave
            (``runtime.internal_states.BOUNDS``).
        inertia: numbers, or scalars of a program in their places -> w, where the state stores w z^2 / 2; None of one
            that stores no energy, as integrals, filters and lags.
    """

    name: str
    unit: tuple[str, str]
    size: Callable[[Values], float]
    is_bounded: bool
    inertia: Callable[[Mapping[str, Any]], Any] | None = None


@dataclass(frozen=True)
class OwnedState:
    """An internal state of somebody.

    Attributes:
        prefix: of the law's parameters: "joints.joint1.gamma", "joints.joint1.motor" of a rotor or a transmission,
            "loops.loop1.x", "couplings.gear".
        law: its name.
        numbers: of all laws there.
        state: what is said of it.
        is_linear: whether the law is that of a translation.
    """

    prefix: str
    law: str
    numbers: Values = field(hash=False)
    state: State
    is_linear: bool

    @property
    def owner(self) -> str:
        """Whose law it is: "joint1.gamma"."""
        return self.prefix.partition(".")[2]

    @property
    def name(self) -> str:
        """Its name, such as "joint1.gamma.friction.z"."""
        return f"{self.owner}.{self.law}.{self.state.name}"

    @property
    def unit(self) -> str:
        """Its unit."""
        return self.state.unit[0 if self.is_linear else 1]
