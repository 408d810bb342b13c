"""Damping of a joint's own motion: of its origin's velocity and of its angular velocity, alike in all directions."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace

from ..limits import LARGEST
from .laws import JOINT_DAMPING

MOVED: dict[str, tuple[str, ...]] = {"linear": ("x", "y", "z"), "angular": ("alpha", "beta", "gamma")}


@dataclass(frozen=True)
class JointDamping:
    """Resistance of a joint to motion, which does not depend on what coordinates describe it.

    linear (N s/m): times the velocity of the joint's origin in the frame in front of it; angular (N m s/rad): times
    the child's angular velocity there.  None where the description gives no number.
    """

    linear: float | None = None
    angular: float | None = None

    def law(self) -> dict[str, float]:
        """The numbers that are given, by their names."""
        return {key: value for key, value in vars(self).items() if value is not None}

    def left_with(self, active: Container[str]) -> JointDamping | None:
        """The damping of what moves where only these coordinates do; None if that is nothing."""
        still = [key for key in self.law() if not any(name in active for name in MOVED[key])]
        left = replace(self, **dict.fromkeys(still))
        return left if left.law() else None


def damping_conflict(given: JointDamping, active: Container[str]) -> tuple[str, str] | None:
    """The key ("" for the table) and the message of what is wrong with a joint's damping; None if nothing is.

    Args:
        active: the joint's coordinates.
    """
    if not given.law():
        return "", f"it has no number; allowed: {', '.join(MOVED)}, or no table {JOINT_DAMPING}"
    for key, value in given.law().items():
        if not any(name in active for name in MOVED[key]):
            return key, f"nothing moves so; allowed: where one of {', '.join(MOVED[key])} is a coordinate of the joint"
        if not 0.0 <= value <= LARGEST:
            return key, f"got {value!r}; allowed: a finite number that is at least 0"
    return None
