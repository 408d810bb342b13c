"""Isotropic damping of a joint's motion: of its origin's velocity and of its angular velocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar

from ...limits import LARGEST
from ..geometry import ANGULAR, LINEAR
from ..laws import Conflict, Number, by_key
from .joint_element import JointElement

JOINT_DAMPING = "damping"  # a joint's table of the damping of its motion as a whole
MOVED: dict[str, tuple[str, ...]] = {"linear": LINEAR, "angular": ANGULAR}


@dataclass(frozen=True)
class JointDamping(JointElement):
    """Resistance of a joint to motion, which does not depend on the coordinates that describe it.

    linear (N s/m): times the velocity of the joint's origin in the parent-side joint frame; angular (N m s/rad): times
    the child's angular velocity there.  None where the description has no number.
    """

    linear: float | None = None
    angular: float | None = None

    TABLE: ClassVar[str] = JOINT_DAMPING
    FAMILIES: ClassVar[Mapping[str, str]] = MappingProxyType({"joints": "joint_damping"})
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(
        Number("linear", "times the velocity of the joint's origin", ("N s/m",)),
        Number("angular", "times the joint's angular velocity", ("N m s/rad",)),
    )
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {"joints": "isotropic damping of the joint's motion, beside that of its coordinates"}
    )
    ROLE: ClassVar[str] = "joint's damping"
    BEYOND: ClassVar[str] = "damping of coordinates, none of joints"

    def conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        """Return the key ("" for the table) and the message of what is wrong with it in a joint; None if nothing is."""
        if not self.law():
            return "", f"it has no number; allowed: {', '.join(MOVED)}, or no table {JOINT_DAMPING}"
        for key, value in self.law().items():
            if not any(name in active for name in MOVED[key]):
                allowed = f"where one of {', '.join(MOVED[key])} is a coordinate of the joint"
                return key, f"nothing moves so; allowed: {allowed}"
            if not 0.0 <= value <= LARGEST:
                return key, f"got {value!r}; allowed: a finite number that is at least 0"
        return None

    def left_with(self, active: Mapping[str, Any]) -> JointDamping | None:
        """Return the damping of what still moves; None if that is nothing."""
        still = [key for key in self.law() if not any(name in active for name in MOVED[key])]
        left = replace(self, **dict.fromkeys(still))
        return left if left.law() else None
