"""A robot as a page that moves: one file of HTML with its kernel as WebAssembly, its shapes, its drives.

Uses what export uses, and forms, loops, motion, integration, scenario, simulation and pictures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazily import attributes

if TYPE_CHECKING:
    from .page import export_live as export_live
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(__name__, "page: export_live")
