"""Drives at rest: the force and the states that follow from an input where all their rates vanish.

Within limits all signals of a drive are linear in its force then, so that they follow from the inside to the outside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from ..numbers import Values
from .drives import (
    CURRENT_LIMIT,
    LAG,
    RESISTANCE,
    TORQUE_CONSTANT,
    VOLTAGE_LIMIT,
    has_winding,
    loops_of,
    number_key,
)

CANCELS = 1e-12  # N or N m: what rounding leaves of forces that cancel, such as a weight above its pivot


class Standstill(NamedTuple):
    """A drive at rest: u = s + compliance F where it follows a position, else u = compliance F.

    Attributes:
        follows: whether it controls the position s of its coordinate.
        compliance: error per force, or input per force, that it takes; 0 where an integral leaves no error, so that the
            force is whatever holds the coordinate; infinite where no input makes a force.
        heeds: whether its input does anything at rest.
        greatest: force that its limits leave in both directions, N or N m; infinite without any.
        limit: name of the number that is this limit, "" without any.
        states: its states per force, by name.
    """

    follows: bool
    compliance: float
    heeds: bool
    greatest: float
    limit: str
    states: Mapping[str, float]

    def force(self, u: float, s: float) -> float:
        """Return the force that a drive whose compliance is not 0 exerts at its position s, N or N m."""
        free = (u - s if self.follows else u) / self.compliance
        return min(max(free, -self.greatest), self.greatest)

    def input(self, force: float, s: float) -> float:
        """Return an input under which it exerts a force within its limits at its position s."""
        return (s if self.follows else 0.0) + (self.compliance * force if math.isfinite(self.compliance) else 0.0)

    def can_exert(self, force: float) -> bool:
        """Tell whether its limits leave a force."""
        most = self.greatest if math.isfinite(self.compliance) else 0.0
        return abs(force) <= most * (1.0 + 1e-9) + CANCELS


def standstill_of(numbers: Values) -> Standstill:
    """Return what a drive with these numbers does at rest."""
    states: dict[str, float] = {}
    limits = [(math.inf, "")]

    def limited(key: str, signal: float) -> None:
        if key in numbers and signal > 0.0:
            limits.append((numbers[key] / signal, key))

    signal, current, loops = 1.0, 0.0, loops_of(numbers)  # signals are per force
    if has_winding(numbers):
        current = states["current"] = 1.0 / numbers[TORQUE_CONSTANT]
        signal = numbers[RESISTANCE] * current
        limited(VOLTAGE_LIMIT, signal)
        if "current" not in loops and signal:
            limited(CURRENT_LIMIT, current)
    elif LAG in numbers:
        states["force"] = 1.0
    heeds, compliant = True, True
    for loop in reversed(loops):
        measured = current if loop == "current" else 0.0
        kp, ki = (numbers.get(number_key(loop, name), 0.0) for name in ("kp", "ki"))
        limited(number_key(loop, "limit"), signal)
        heeds = bool(ki) or (bool(kp) and heeds)
        compliant = compliant and bool(ki or kp or not signal)  # a loop of kd alone hands on nothing
        states |= {f"integral_{loop}": signal / ki} if ki else {}
        states |= {f"filter_{loop}": measured} if number_key(loop, "filter") in numbers else {}
        signal = measured + (0.0 if ki or not kp else signal / kp)
        if loop == "current":
            limited(CURRENT_LIMIT, signal)
    greatest, limit = min(limits)
    follows = heeds and loops[:1] == ("position",)
    return Standstill(follows, signal if compliant else math.inf, heeds, greatest, limit, states)
