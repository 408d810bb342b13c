"""A robot as a page that moves: one file of HTML with its kernel as WebAssembly, its shapes, its drives.

Uses what export uses, and forms, loops, motion, integration, scenario, simulation and pictures.
"""

from typing import TYPE_CHECKING

from ...lazily import lazy_names

if TYPE_CHECKING:
    from .page import export_live as export_live
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
