"""Flexible links: constants of their modes from beams, finite elements and files.

Uses npz, files and robot; NumPy alone, SciPy where finite elements are reduced.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .reduced_link import ReducedLink as ReducedLink
    from .reducing import LinkSets as LinkSets
    from .reducing import reduce_files as reduce_files
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
