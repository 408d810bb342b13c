"""CalculiX: matrices of *FREQUENCY, SOLVER=MATRIXSTORAGE, in JOB.sti, JOB.mas and JOB.dof.

Each line of .sti and .mas has row, column and entry of one triangle; line k of .dof has the node and the direction of
row k as "node.direction".  Source: CalculiX CrunchiX (G. Dhondt), user's manual, *FREQUENCY, and src/matrixstorage.c,
which writes them.  With *TRANSFORM the directions are local ones, which these files do not say: leave it out.
"""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...identifiers import plain_path
from ..finite_elements import MOST_ROWS
from .contents import Entries, Labels, keys_of
from .text import SMALLER, integers, lines_of, refusal, rows_of_numbers

WHAT = "row, column, entry"


def read_directions(path: Path) -> Labels:
    """Return the keys of all rows of a .dof file."""
    labels, directions = array("q"), array("q")
    for line, text in lines_of(path):
        label, dot, direction = text.strip().partition(".")
        if not (dot and label.isdecimal() and direction.isdecimal() and len(label) < 16 and len(direction) == 1):
            raise refusal(path, line, text.strip(), "node.direction, as 12.3")
        if len(labels) == MOST_ROWS:
            raise refusal(path, line, f"more than {MOST_ROWS} rows", f"up to that, {SMALLER}")
        labels.append(int(label))
        directions.append(int(direction))
    return keys_of(path, np.array(labels, dtype=np.int64), np.array(directions, dtype=np.int64))


def read_matrix(path: Path, keys: Labels) -> Entries:
    """Return a matrix of a .sti or a .mas file, by the keys of its rows."""
    return by_numbers(path, rows_of_numbers(path, lines_of(path), 3, WHAT), keys)


def by_numbers(path: Path, table: Array, keys: Labels) -> Entries:
    """Return entries by the keys of their rows, of a table of row and column from 1 on, and entry."""
    places = integers(path, table[:, :2], "row or column")
    wrong = np.argwhere((places < 1) | (places > len(keys)))
    if len(wrong):
        got = f"{('row', 'column')[int(wrong[0, 1])]} {places[tuple(wrong[0])]}"
        raise InputError(f"{plain_path(path)}: got {got}; allowed: 1 to {len(keys)}, as there are so many directions")
    return Entries(keys[places[:, 0] - 1], keys[places[:, 1] - 1], table[:, 2], path)
