"""A mechanism closed in one state: consistent positions and rates, constraint forces, redundancy.

Uses runtime, robot and state.
"""

from .closed import ClosedLoops

__all__ = ["ClosedLoops"]
