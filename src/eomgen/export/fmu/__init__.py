"""Functional mock-up units, FMI 2.0 and 3.0: variables, XML, C, archive.

Uses what export uses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazily import attributes

if TYPE_CHECKING:
    from .pack import export_fmu as export_fmu
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(__name__, "pack: export_fmu")
