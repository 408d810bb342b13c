"""Closed mechanisms: redundant constraints, independent and dependent coordinates.

Uses robot, runtime, kernel and state.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .equilibrium import closed_equilibrium as closed_equilibrium
    from .redundant import Redundancy as Redundancy
    from .redundant import redundancy as redundancy
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
