"""Functional mock-up units, FMI 2.0 and 3.0: variables, XML, C, archive.

Uses what export uses.
"""

from .pack import export_fmu

__all__ = ["export_fmu"]
