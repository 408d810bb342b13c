"""Closed mechanisms: which constraints are redundant, which coordinates are independent, and how others follow.

Uses robot, runtime and state.
"""

from .equilibrium import closed_equilibrium
from .redundant import Redundancy, redundancy

__all__ = ["Redundancy", "closed_equilibrium", "redundancy"]
