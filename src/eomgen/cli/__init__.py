"""The command line: a module per group of commands.

Uses all packages; no module of it imports another but ``shared`` and the table of ``entry``.
"""

from .entry import main

__all__ = ["main"]
