"""The command line: one module per group of commands, each with a parser.

Uses all packages; no module of it imports another but ``shared`` and the table of ``entry``.
"""

from .entry import main

__all__ = ["main"]
