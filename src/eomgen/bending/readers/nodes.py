"""Nodes of a .csv: a header node,x,y,z and a line for each node; for programs whose own lists of nodes have no
reader."""

from __future__ import annotations

from pathlib import Path

from ..finite_elements import MOST_NODES
from .contents import Nodes
from .text import integers, lines_of, refusal, rows_of_numbers

HEADER = ("node", "x", "y", "z")


def read_nodes(path: Path) -> Nodes:
    """Return the nodes of a .csv."""
    lines = (line for line in lines_of(path) if not line[1].startswith("#"))
    number, text = next(lines, (1, ""))
    if tuple(word.strip().lower() for word in text.split(",")) != HEADER:
        raise refusal(path, number, text, f"a header {','.join(HEADER)}")
    table = rows_of_numbers(path, lines, 4, ", ".join(HEADER), ",", most=MOST_NODES)
    return Nodes(integers(path, table[:, 0], "node"), table[:, 1:])
