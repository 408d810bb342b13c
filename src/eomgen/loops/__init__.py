"""A mechanism closed in one state: consistent positions and rates, constraint forces, redundancy.

Uses runtime, robot and state.
"""

from .closed import ClosedLoops, LoopDynamics, LoopForces
from .redundant import Redundancy

__all__ = ["ClosedLoops", "LoopDynamics", "LoopForces", "Redundancy"]
