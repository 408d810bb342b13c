"""A robot as a page that moves: one file of HTML with its kernel as WebAssembly, its shapes, its drives.

Uses what export uses, and forms, loops, motion, integration, scenario, simulation and pictures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazily import attributes

if TYPE_CHECKING:
    from .page import export_live

__all__ = ["export_live"]

_MODULES = {"export_live": "page"}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
