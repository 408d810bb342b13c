"""Damping of a joint's motion as a whole: isotropic, by a matrix, or proportional to its stiffness matrix."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

from ...limits import LARGEST
from ..fields import LATER, Picklable
from ..geometry import ANGULAR, COORDINATES, LINEAR, Placement
from ..numbers import Conflict, Number, by_key, divisor
from .joint_element import MatrixElement
from .joint_stiffness import JOINT_STIFFNESS
from .matrices import (
    ABOUT,
    PAIRS,
    Rows,
    carried,
    couples,
    entries_among,
    entries_of,
    entry_name,
    entry_numbers,
    matrix_conflict,
    matrix_of,
    names_of,
    ordered,
)

JOINT_DAMPING = "damping"  # a joint's table of the damping of its motion as a whole
MOVED: dict[str, tuple[str, ...]] = {"linear": LINEAR, "angular": ANGULAR}
SHARES: Mapping[str, float] = MappingProxyType({"ratio": 1.0 / math.pi, "loss_factor": 0.5 / math.pi})
FREQUENCY = "at_hz"  # of which the numbers of SHARES are
_ENTRIES = entry_numbers("damping matrix", (" s/m", " s/rad"))
_FORMS = "linear, angular or both; matrix; ratio with at_hz; loss_factor with at_hz"


@dataclass(frozen=True)
class JointDamping(Picklable, MatrixElement):
    """Resistance of a joint to motion, beside that of its coordinates, in one of three forms.

    linear (N s/m): times the velocity of the joint's origin in the parent-side joint frame; angular (N m s/rad): times
    the child's angular velocity there: both do not depend on the coordinates that describe the joint.
    entries: of a matrix D on and above the diagonal, as of ``JointStiffness``, N s/m, N s/rad, N m s/rad; the
    coordinates' velocities v are resisted by D v.
    ratio, loss_factor: D is tau times the joint's stiffness matrix, so that at the frequency ``at_hz`` motions have
    this damping ratio, tau = ratio / (pi at_hz), or this loss factor, tau = loss_factor / (2 pi at_hz).
    """

    linear: float | None = None
    angular: float | None = None
    entries: Mapping[str, float] = field(default_factory=dict, hash=False, metadata=LATER)
    ratio: float | None = field(default=None, metadata=LATER)
    loss_factor: float | None = field(default=None, metadata=LATER)
    at_hz: float | None = field(default=None, metadata=LATER)

    TABLE: ClassVar[str] = JOINT_DAMPING
    FAMILIES: ClassVar[Mapping[str, str]] = MappingProxyType({"joints": "joint_damping", "loops": "cut_damping"})
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(
        Number("linear", "times the velocity of the joint's origin", ("N s/m",)),
        Number("angular", "times the joint's angular velocity", ("N m s/rad",)),
        Number("ratio", "damping ratio at at_hz, in the place of a matrix: proportional to the stiffness", ("1",)),
        Number("loss_factor", "loss factor at at_hz, in the place of a matrix: proportional to the stiffness", ("1",)),
        divisor(FREQUENCY, "frequency at which ratio or loss_factor holds", ("1/s",)),
        *_ENTRIES,
    )
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "joints": "damping of the joint's motion, beside that of its coordinates: isotropic, by a matrix, or"
            " proportional to the joint's stiffness matrix",
            "loops": "damping between the loop joint's coordinates that have tables, by a matrix or proportional to"
            " the stiffness matrix",
            "frames": "by a matrix between the six coordinates, or proportional to the stiffness matrix",
            **{key: ABOUT[key] for key in ("matrix", "at")},
        }
    )
    ROLE: ClassVar[str] = "joint's damping"
    BEYOND: ClassVar[str] = "damping of coordinates, none of joints"

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", ordered(self.entries))

    @classmethod
    def of(cls, matrix: Rows, coordinates: Sequence[str] = COORDINATES, at: Placement | None = None) -> JointDamping:
        """Make it of a matrix, (n, n), N s/m, N s/rad, N m s/rad; arguments as of ``MatrixElement.of``."""
        return cls(entries=entries_of(matrix if at is None else carried(matrix, at), coordinates))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Coordinates that its matrix acts on."""
        return names_of(self.entries)

    @property
    def share(self) -> str:
        """Which of ``SHARES`` it has; "" where it is not proportional to the stiffness."""
        return next((key for key in SHARES if getattr(self, key) is not None), "")

    @property
    def is_isotropic(self) -> bool:
        """Whether it is the same whatever angles describe the joint."""
        return not self.entries and not self.share

    @property
    def needs(self) -> tuple[str, ...]:
        """The stiffness, where it is proportional to that."""
        return (JOINT_STIFFNESS,) if self.share else ()

    def law(self) -> dict[str, float]:
        """Return the numbers that are set, of a matrix those that are not 0, by their names."""
        numbers = {key: getattr(self, key) for key in (*MOVED, *SHARES, FREQUENCY)}
        return {**{key: value for key, value in numbers.items() if value is not None}, **self.entries}

    def numbers(self, active: Sequence[str]) -> Iterator[tuple[str, float | None]]:
        """Yield the numbers that are set, of a matrix all entries; a parameter may stand for one that is 0."""
        law = self.law()
        if not self.entries:
            yield from law.items()
            return
        for key in [entry_name(*pair) for pair in PAIRS if set(pair) <= set(active)]:
            yield key, law.get(key)

    def conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        """Return the key ("" for the table) and the message of what is wrong with it in a joint; None if nothing is."""
        if not self.law():
            return "", f"it has no number; allowed: {_FORMS}, or no table {JOINT_DAMPING}"
        forms = {"linear or angular": self.linear is not None or self.angular is not None, "matrix": bool(self.entries)}
        chosen = [x for x, there in (forms | {x: getattr(self, x) is not None for x in SHARES}).items() if there]
        if len(chosen) > 1:
            return "", f"it has {' and '.join(chosen)}; allowed: {_FORMS}"
        if bool(self.share) != (self.at_hz is not None):
            lacks = FREQUENCY if self.share else " or ".join(SHARES)
            return "", f"the key {lacks} is missing; allowed: {_FORMS}"
        wrong = self._matrix_conflict(active)
        if wrong is not None:
            return wrong
        for key, value in self.law().items():
            if key in MOVED and not any(name in active for name in MOVED[key]):
                allowed = f"where one of {', '.join(MOVED[key])} is a coordinate of the joint"
                return key, f"nothing moves so; allowed: {allowed}"
            least = self.NUMBERS[key].least
            if least is not None and not least <= value <= LARGEST:
                return key, f"got {value!r}; allowed: a finite number that is at least {least:g}"
        return None

    def _matrix_conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        unknown = next((key for key in self.entries if key not in self.NUMBERS), None)
        if unknown is not None:
            known = ", ".join(number.key for number in _ENTRIES)
            return unknown, f"there is no such entry; allowed: {known}"
        for name in names_of(self.entries):
            if name not in active:
                return "", f"{name} does not move; allowed: entries of {', '.join(active)}"
        names = tuple(name for name in COORDINATES if name in active)
        return matrix_conflict(matrix_of(self.entries, names), names)

    def left_with(self, active: Mapping[str, Any]) -> JointDamping | None:
        """Return the damping of what still moves; None if that is nothing."""
        still = [key for key in MOVED if not any(name in active for name in MOVED[key])]
        left = replace(self, **dict.fromkeys(still), entries=entries_among(self.entries, tuple(active)))
        return left if left.law() else None

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield what is beside the diagonal: MuJoCo's dampers act on single coordinates."""
        if couples(self.entries):
            yield ": its diagonal alone (dampers of MuJoCo act on single coordinates)"


def lag_of(numbers: Mapping[str, Any]) -> Any:
    """Return tau, s, of a damping that is proportional to the stiffness; 0 of others.

    Args:
        numbers: of the damping, by their names, as numbers or whatever else is calculated with.
    """
    lags = [numbers[key] * factor / numbers[FREQUENCY] for key, factor in SHARES.items() if key in numbers]
    return lags[0] if lags else 0.0
