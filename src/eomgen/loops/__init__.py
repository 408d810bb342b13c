"""A mechanism closed in one state: which constraints are redundant, and the freedoms that they leave.

Uses runtime and state.
"""

from .redundant import Redundancy, redundancy

__all__ = ["Redundancy", "redundancy"]
