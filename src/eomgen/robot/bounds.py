"""Limits of one coordinate: of its position, its velocity, and the effort of its drive.

They are data of the robot: nothing stops at them (``stops`` do), and motions and drives that exceed them are reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..limits import LARGEST

LIMIT_KEYS = ("lower", "upper", "velocity", "effort")
FORCE_UNITS = {"rad": "N m", "m": "N"}  # of a drive, by the unit of the coordinate that it acts on


@dataclass(frozen=True)
class Limits:
    """Limits of a coordinate; None where the description has none.

    lower, upper: m or rad.  velocity: greatest speed in both directions, m/s or rad/s.  effort: greatest force of its
    drive in both directions, N or N m.
    """

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None

    def __bool__(self) -> bool:
        return bool(self.numbers())

    def numbers(self) -> dict[str, float]:
        """Return the limits that are set, by their keys."""
        return {key: value for key in LIMIT_KEYS if (value := getattr(self, key)) is not None}

    @property
    def range(self) -> tuple[float, float]:
        """Lower and upper limit, m or rad; infinite where there is none."""
        lower = -math.inf if self.lower is None else self.lower
        return lower, math.inf if self.upper is None else self.upper

    def behind(self, ratio: float) -> Limits:
        """Return the same limits of a motor on the other side of its gear, of the joint that it drives.

        Args:
            ratio: rad of the motor per rad or m of the joint, not 0.
        """
        ends = [None if x is None else x / ratio for x in (self.lower, self.upper)]
        lower, upper = ends if ratio > 0.0 else reversed(ends)
        velocity = None if self.velocity is None else self.velocity / abs(ratio)
        return Limits(lower, upper, velocity, None if self.effort is None else self.effort * abs(ratio))

    def within(self, other: Limits) -> Limits:
        """Return the nearer one of each pair of limits."""
        pairs = {key: [x for x in (getattr(self, key), getattr(other, key)) if x is not None] for key in LIMIT_KEYS}
        nearer = {key: (max(pair) if key == "lower" else min(pair)) for key, pair in pairs.items() if pair}
        return Limits(**nearer)


def limits_conflict(limits: Limits) -> tuple[str, str] | None:
    """Return the key and the message of limits that are not allowed; None if all are right."""
    for key, value in limits.numbers().items():
        if not abs(value) <= LARGEST:
            return f"limits.{key}", f"got {value!r}; allowed: a finite number of magnitude up to {LARGEST:g}"
        if key in ("velocity", "effort") and not value > 0.0:
            return f"limits.{key}", f"got {value!r}; allowed: a number greater than 0"
    lower, upper = limits.range
    if lower > upper:
        return "limits", f"lower is {lower!r} and upper is {upper!r}; allowed: lower <= upper"
    return None


def limit_texts(limits: Limits, unit: str) -> list[str]:
    """Return phrases about the limits of a coordinate, whose unit is "m" or "rad"."""
    units = {"lower": unit, "upper": unit, "velocity": f"{unit}/s", "effort": FORCE_UNITS[unit]}
    words = {"lower": "from", "upper": "to", "velocity": "speed up to", "effort": "effort up to"}
    return [f"{words[key]} {value:.6g} {units[key]}" for key, value in limits.numbers().items()]
