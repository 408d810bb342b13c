"""Functional mock-up units, FMI 2.0 and 3.0: variables, XML, C, archive.

Uses what export uses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazily import attributes

if TYPE_CHECKING:
    from .pack import export_fmu

__all__ = ["export_fmu"]

_MODULES = {"export_fmu": "pack"}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
