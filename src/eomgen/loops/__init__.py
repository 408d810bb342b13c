"""Closed mechanisms: which constraints are redundant, which coordinates are independent, and how others follow.

Uses robot, runtime and state.
"""

from ..lazily import public_names
from .equilibrium import closed_equilibrium
from .redundant import Redundancy, redundancy

__all__ = ["Redundancy", "closed_equilibrium", "redundancy"]


def __dir__() -> list[str]:
    return public_names(globals(), __all__)
