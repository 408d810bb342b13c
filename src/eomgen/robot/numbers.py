"""Numbers of laws and elements: what is said of each, their values by key, and conflicts between values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

Values = Mapping[str, float]  # numbers by their keys
Conflict = tuple[str, str]  # key, message

SMALLEST = 1e-12  # least value of what is divided by, m, rad or per s

FORCE, LENGTH, RATE = ("N", "N m"), ("m", "rad"), ("m/s", "rad/s")
YIELD = ("1/m", "1/rad")
STIFFNESS, DAMPING, INERTIA = ("N/m", "N m/rad"), ("N s/m", "N m s/rad"), ("kg", "kg m^2")


@dataclass(frozen=True)
class Number:
    """One number of a law.

    Attributes:
        key: its name below the coordinate, with a dot where the law has a table.
        about: a line for who writes a description.
        unit: of translations and of rotations.
        least: the least value, None where any will do.
        needed: what the message calls allowed where it is missing; empty where it may be.
        default: its value from the law's other numbers, None where nothing follows from them.
    """

    key: str
    about: str
    unit: tuple[str, ...]
    least: float | None = 0.0
    needed: str = ""
    default: Callable[[Values], float | None] | None = None


@dataclass(frozen=True)
class Condition:
    """A condition between numbers of a law, which holds for run-time parameters, too.

    Attributes:
        factors: of the numbers, by their keys: the sum of the products is at least ``least``.
        least: that value.
        allowed: what messages call allowed.
    """

    factors: Mapping[str, float]
    least: float
    allowed: str


divisor = partial(Number, least=SMALLEST)  # a number that something is divided by


def by_key(*numbers: Number) -> Mapping[str, Number]:
    """Return the numbers by their keys."""
    return MappingProxyType({number.key: number for number in numbers})
