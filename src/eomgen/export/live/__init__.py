"""A robot as a page that moves: one file of HTML with its kernel as WebAssembly, its shapes, its drives.

Uses what export uses, and forms, loops, motion, integration, scenario, simulation and pictures.
"""

from ...lazily import imports_when_used

with imports_when_used(globals()):
    from .page import export_live as export_live
