"""Abaqus: matrices of *MATRIX OUTPUT and of *SUBSTRUCTURE MATRIX OUTPUT, and nodes of input files.

*MATRIX GENERATE with *MATRIX OUTPUT, FORMAT=MATRIX INPUT (the default) or LABELS writes JOB_STIF2.mtx and
JOB_MASS2.mtx: row node, its direction, column node, its direction, entry; one triangle or all of a symmetric matrix.
*SUBSTRUCTURE MATRIX OUTPUT, OUTPUT FILE=USER DEFINED writes a *USER ELEMENT: its nodes in comments, directions of the
first node, then those that change from a later one on, and *MATRIX, TYPE=STIFFNESS and TYPE=MASS, each the upper
triangle by columns. Sources: Abaqus Keywords Reference Guide, *MATRIX INPUT, *MATRIX OUTPUT, *SUBSTRUCTURE MATRIX
OUTPUT, *USER ELEMENT, *NODE and *NSET.  FORMAT=COORDINATE is refused: it does not say what its rows are.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...identifiers import plain_path
from ...limits import MOST_MATRICES, MOST_SET_MEMBERS, MOST_SETS
from ..finite_elements import DIRECTIONS, MOST_NODES
from .contents import Entries, Labels, Nodes, keys_of
from .text import SMALLER, Line, integers, lines_of, number_of, refusal, rows_of_numbers

WHAT = "row node, direction, column node, direction, entry"
_ELEMENT_NODES = "ELEMENT NODES"
_GENERATING = ("*NGEN", "*NFILL", "*NCOPY", "*NMAP", "*SYSTEM", "*INCLUDE", "*INSTANCE", "*PART", "*IMPORT")
_MOST_SUBSTRUCTURE = 3000  # coordinates
_MOST_TRIANGLE = _MOST_SUBSTRUCTURE * (_MOST_SUBSTRUCTURE + 1) // 2


def keyword_of(text: str) -> tuple[str, dict[str, str]]:
    """Return the keyword of a line that begins with one star, "*NODE", and its options; "" where it is none."""
    if not text.startswith("*") or text.startswith("**"):
        return "", {}
    words = [" ".join(word.split()) for word in text.split(",")]
    options = {}
    for word in words[1:]:
        key, _, value = word.partition("=")
        options[key.strip().upper()] = value.strip()
    return words[0].upper(), options


def is_substructure(path: Path) -> bool:
    """Whether a .mtx is a *USER ELEMENT; looks at lines until the first that says so or has numbers."""
    for _, text in lines_of(path):
        keyword, _ = keyword_of(text)
        if keyword == "*USER ELEMENT":
            return True
        if text.strip() and not text.startswith("*"):
            return False
    return False


def read_matrix(path: Path) -> Entries:
    """Return a matrix of *MATRIX OUTPUT."""
    numbers = (line for line in lines_of(path) if not line[1].lstrip().startswith("*"))
    table = rows_of_numbers(path, numbers, 5, WHAT, ",")
    places = integers(path, table[:, :4], "node or direction")
    rows, columns = keys_of(path, places[:, 0], places[:, 1]), keys_of(path, places[:, 2], places[:, 3])
    return Entries(rows, columns, table[:, 4], path)


@dataclass
class _Element:
    """A *USER ELEMENT as it is read: its nodes, and directions by the place of the node from which on they hold."""

    nodes: list[int]
    directions: dict[int, list[int]]
    matrices: dict[str, array[float]]


def read_substructure(path: Path) -> dict[str, Entries]:
    """Return the matrices K and M of a *USER ELEMENT, as far as it has them."""
    element = _Element([], {}, {})
    current, in_nodes = "", False
    for line, text in lines_of(path):
        if text.startswith("**"):
            in_nodes = _take_nodes(path, (line, text), element, in_nodes)
            continue
        in_nodes = False
        keyword, options = keyword_of(text)
        if keyword == "*MATRIX":
            current = options.get("TYPE", "").upper()
            element.matrices[current] = array("d")
            if len(element.matrices) > MOST_MATRICES:
                raise refusal(path, line, f"more than {MOST_MATRICES} matrices", "up to that")
        elif keyword:
            current = keyword
        elif current == "*USER ELEMENT" and text.strip():
            _take_directions(path, (line, text), element)
        elif current in element.matrices:
            _take_numbers(path, (line, text), element.matrices[current])
    keys = _keys(path, element)
    names = {"STIFFNESS": "K", "MASS": "M"}
    found = {
        names[kind]: _triangle(path, kind, keys, element.matrices[kind]) for kind in names if kind in element.matrices
    }
    if not found:
        raise InputError(f"{plain_path(path)}: has no *MATRIX, TYPE=STIFFNESS or TYPE=MASS; allowed: at least one")
    return found


def _take_nodes(path: Path, line: Line, element: _Element, in_nodes: bool) -> bool:
    """Take nodes out of a comment behind ** ELEMENT NODES; return whether the next comment may have more."""
    text = line[1].lstrip("*").strip()
    if text.upper().startswith(_ELEMENT_NODES):
        return True
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not in_nodes or not words or not all(word.isdecimal() and len(word) < 16 for word in words):
        return False
    element.nodes += [int(word) for word in words]
    if len(element.nodes) > _MOST_SUBSTRUCTURE:
        raise refusal(path, line[0], text[:40], f"up to {_MOST_SUBSTRUCTURE} nodes")
    return True


def _take_directions(path: Path, line: Line, element: _Element) -> None:
    words = [word.strip() for word in line[1].split(",") if word.strip()]
    if not words or not all(word.isdecimal() and len(word) < 8 for word in words):
        raise refusal(
            path, line[0], line[1].strip(), "directions of the first node, or a node's place and its directions"
        )
    numbers = [int(word) for word in words]
    place, directions = (numbers[0], numbers[1:]) if element.directions else (1, numbers)
    if len(directions) > len(DIRECTIONS) or place > _MOST_SUBSTRUCTURE:
        most = f"up to {len(DIRECTIONS)} directions of a node, and {_MOST_SUBSTRUCTURE} nodes"
        raise refusal(path, line[0], line[1].strip(), most)
    element.directions[place] = directions


def _take_numbers(path: Path, line: Line, found: array[float]) -> None:
    """Take the numbers of a line into a matrix."""
    for word in line[1].split(","):
        if word.strip():
            number = number_of(word)
            if number is None:
                raise refusal(path, line[0], word.strip(), "a finite number")
            if len(found) == _MOST_TRIANGLE:
                raise refusal(path, line[0], f"more than {_MOST_TRIANGLE} entries", f"up to that, {SMALLER}")
            found.append(number)


def _keys(path: Path, element: _Element) -> Labels:
    """Return the keys of a substructure's coordinates, node by node."""
    labels, directions, current = [], [], list[int]()
    for place, node in enumerate(element.nodes, 1):
        current = element.directions.get(place, current)
        labels += [node] * len(current)
        directions += current
    if not labels or len(labels) > _MOST_SUBSTRUCTURE:
        allowed = f"1 to {_MOST_SUBSTRUCTURE}, of ** ELEMENT NODES and the lines behind *USER ELEMENT"
        raise InputError(f"{plain_path(path)}: has {len(labels)} coordinates; allowed: {allowed}")
    return keys_of(path, np.array(labels, dtype=np.int64), np.array(directions, dtype=np.int64))


def _triangle(path: Path, kind: str, keys: Labels, entries: array[float]) -> Entries:
    """Return the entries of an upper triangle by columns."""
    n = len(keys)
    if len(entries) != n * (n + 1) // 2:
        allowed = f"{n * (n + 1) // 2}, a triangle of {n} coordinates"
        raise InputError(f"{plain_path(path)}: *MATRIX, TYPE={kind} has {len(entries)} numbers; allowed: {allowed}")
    columns, rows = np.tril_indices(n)
    return Entries(keys[rows], keys[columns], np.array(entries), path)


def read_nodes(path: Path) -> Nodes:
    """Return nodes and sets of nodes of an input file of Abaqus or CalculiX.

    Raises:
        InputError: it makes nodes in other ways than *NODE, or a line has something else.
    """
    labels, places, sets = list[int](), list[list[float]](), _Sets(path)
    current, options = "", dict[str, str]()
    for line, text in lines_of(path):
        if not text.strip() or text.startswith("**"):
            continue
        if text.startswith("*"):
            current, options = keyword_of(text)
            _refuse_generating(path, (line, text), current, options)
        elif current == "*NODE":
            label, place = _node(path, (line, text))
            labels.append(label)
            places.append(place)
            if "NSET" in options:
                sets.add(line, options["NSET"], range(label, label + 1))
            if len(labels) > MOST_NODES:
                raise refusal(path, line, f"more than {MOST_NODES} nodes", f"up to that, {SMALLER}")
        elif current == "*NSET":
            for members in _members(path, (line, text), sets, "GENERATE" in options):
                sets.add(line, options.get("NSET", ""), members)
    arrays = {name: np.unique(np.array(mine, dtype=np.int64)) for name, mine in sets.by_name.items()}
    return Nodes(np.array(labels, dtype=np.int64), np.array(places).reshape(-1, 3), arrays)


@dataclass
class _Sets:
    """Sets of nodes as they are read, by their names; how many nodes they have is known before these are there."""

    path: Path
    by_name: dict[str, array[int]] = field(default_factory=dict)
    count: int = 0

    def add(self, line: int, name: str, members: range | array[int]) -> None:
        """Add nodes to a set; to itself it adds nothing."""
        own = self.by_name.setdefault(name.upper(), array("q"))
        if members is own:
            return
        self.count += len(members)
        if self.count > MOST_SET_MEMBERS or len(self.by_name) > MOST_SETS:
            got = f"{len(self.by_name)} sets of {self.count} nodes"
            raise refusal(self.path, line, got, f"up to {MOST_SETS} sets, and {MOST_SET_MEMBERS} nodes of all together")
        own.extend(members)


def _refuse_generating(path: Path, line: Line, keyword: str, options: dict[str, str]) -> None:
    if keyword in _GENERATING or (keyword == "*NODE" and ({"SYSTEM", "INPUT"} & set(options))):
        allowed = "nodes by *NODE alone, in one file without parts and systems (or a .csv of node,x,y,z)"
        raise refusal(path, line[0], line[1].strip(), allowed)


def _node(path: Path, line: Line) -> tuple[int, list[float]]:
    words = [word.strip() for word in line[1].split(",")]
    numbers = [number_of(word) if word else 0.0 for word in words[1:4]]
    place = [number for number in numbers if number is not None]
    if not (words[0].isdecimal() and len(words[0]) < 16 and 1 <= len(numbers) == len(place)):
        raise refusal(path, line[0], line[1].strip(), "a node, x, y and z")
    return int(words[0]), place + [0.0] * (3 - len(place))


def _members(path: Path, line: Line, sets: _Sets, is_generated: bool) -> list[range | array[int]]:
    """Return the nodes of a line of *NSET: numbers and sets, or with GENERATE first, last and step."""
    words = [word.strip() for word in line[1].split(",") if word.strip()]
    if is_generated:
        numbers = [int(word) for word in words if word.isdecimal() and len(word) < 16]
        step = numbers[2] if len(numbers) > 2 else 1
        if not (len(numbers) == len(words) and len(numbers) in (2, 3) and step > 0):
            raise refusal(path, line[0], line[1].strip(), "first, last and step")
        return [range(numbers[0], numbers[1] + 1, step)]
    members: list[range | array[int]] = []
    for word in words:
        if word.isdecimal() and len(word) < 16:
            members.append(range(int(word), int(word) + 1))
        elif word.upper() in sets.by_name:
            members.append(sets.by_name[word.upper()])
        else:
            raise refusal(path, line[0], word, "numbers of nodes, and sets before it")
    return members
