"""Contents of files of finite elements: nodes, sets of them, and matrices by nodes and directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index
from ...errors import InputError
from ...identifiers import plain_path
from ..finite_elements import DIRECTIONS, MODAL, symmetric_from

Labels = NDArray[np.int64]
_WAYS = len(DIRECTIONS) + 2  # of keys: six directions, 6 for points without any, and room


@dataclass(frozen=True)
class Nodes:
    """Nodes by what the file calls them: labels, (N,), places, (N, 3), and sets of labels by their names.

    axes: directions of their displacements, columns, (N, 3, 3); None: those of the places' axes.
    """

    labels: Labels
    places: Array
    sets: Mapping[str, Labels] = field(default_factory=dict)
    axes: Array | None = None


@dataclass(frozen=True)
class Entries:
    """Entries of a matrix by their rows and columns: keys of a node and a direction, as ``keys_of`` makes them."""

    rows: Labels
    columns: Labels
    entries: Array
    path: Path


def keys_of(path: Path, labels: Labels, directions: Labels) -> Labels:
    """Return a number for each node and direction (1 to 6; 0 of a point without one), by which rows are sorted.

    Raises:
        InputError: a label or a direction is none.
    """
    wrong = np.flatnonzero((directions < 0) | (directions > len(DIRECTIONS)))
    if len(wrong):
        got = f"direction {directions[wrong[0]]} of node {labels[wrong[0]]}"
        raise InputError(f"{plain_path(path)}: got {got}; allowed: 1 to 6, x y z and rotations about them")
    wrong = np.flatnonzero(labels <= 0)
    if len(wrong):
        got = f"node {labels[wrong[0]]}"
        raise InputError(f"{plain_path(path)}: got {got}; allowed: numbers of nodes from 1 on, none of a solver's own")
    return labels * _WAYS + directions


def is_point(keys: Labels) -> NDArray[np.bool_]:
    """Whether keys are those of points without a direction."""
    return np.asarray(keys % _WAYS == 0)


def assembled(nodes: Nodes, matrices: Mapping[str, Entries], reduced: bool) -> tuple[Index, dict[str, Any]]:
    """Return the coordinates of matrices that share them, (n, 2), and the matrices, sparse.

    Args:
        nodes: places of nodes; of a reduced model, points that are not among them are amplitudes of modes.
        matrices: by name, with K, which has all coordinates.
        reduced: whether the model is a reduced one.

    Raises:
        InputError: a matrix has a node without a place, or not all directions of a node whose axes are others.
    """
    keys = np.unique(
        np.concatenate([matrix.rows for matrix in matrices.values()] + [m.columns for m in matrices.values()])
    )
    labels, directions = np.divmod(keys, _WAYS)
    order = np.argsort(nodes.labels, kind="stable")
    known = nodes.labels[order]
    at = np.minimum(np.searchsorted(known, labels), max(len(known) - 1, 0))
    has = (known[at] == labels) & (directions > 0) if len(known) else np.zeros(len(labels), dtype=bool)
    if not reduced and not has.all():
        label, way = int(labels[~has][0]), int(directions[~has][0])
        path = next(iter(matrices.values())).path
        raise InputError(
            f"{plain_path(path)}: node {label}, direction {way} has no place among the {len(known)} nodes that were "
            "read; allowed: nodes of the files beside it"
        )
    dofs = np.full((len(keys), 2), MODAL, dtype=np.intp)
    dofs[has, 0], dofs[has, 1] = order[at[has]], directions[has] - 1
    dofs[~has, 1] = 0
    found = {}
    for name, matrix in matrices.items():
        rows, columns = np.searchsorted(keys, matrix.rows), np.searchsorted(keys, matrix.columns)
        found[name] = symmetric_from(rows, columns, matrix.entries, len(keys), f"{plain_path(matrix.path)}: {name}")
    return dofs, found if nodes.axes is None else _turned(nodes.labels, nodes.axes, dofs, found)


def _turned(labels: Labels, axes: Array, dofs: Index, matrices: Mapping[str, Any]) -> dict[str, Any]:
    """Return matrices of displacements along the axes of places, out of those along axes of the nodes."""
    from scipy.sparse import csr_array

    rows = np.full((len(labels), 2, 3), -1, dtype=np.intp)
    of_nodes = np.flatnonzero(dofs[:, 0] != MODAL)
    rows[dofs[of_nodes, 0], dofs[of_nodes, 1] // 3, dofs[of_nodes, 1] % 3] = of_nodes
    others = (axes != np.eye(3)).any(axis=(1, 2))
    has = rows >= 0
    partly = np.argwhere(others[:, np.newaxis] & has.any(axis=2) & ~has.all(axis=2))
    if len(partly):
        label, kind = labels[partly[0, 0]], ("translation", "rotation")[partly[0, 1]]
        got = f"node {label} has a {kind} in a coordinate system of its own (CD), and not all three"
        raise InputError(f"nodes: {got}; allowed: all three or none, as they become those along x, y and z")
    node, which = np.nonzero(others[:, np.newaxis] & has.all(axis=2))
    mine = rows[node, which]
    left = np.setdiff1d(np.arange(len(dofs)), mine)
    places = np.concatenate([np.repeat(mine, 3, axis=1).ravel(), left])
    columns = np.concatenate([np.tile(mine, (1, 3)).ravel(), left])
    turn = csr_array((np.concatenate([axes[node].ravel(), np.ones(len(left))]), (places, columns)))
    return {name: (turn @ matrix @ turn.T).tocsr() for name, matrix in matrices.items()}


def merged(parts: list[Nodes]) -> Nodes:
    """Return all nodes of several files; InputError where none has one, or two differ about one."""
    if not any(len(part.labels) for part in parts):
        raise InputError("nodes: no file has them; allowed: .csv of node,x,y,z, .inp with *NODE, or .bdf with GRID")
    labels = np.concatenate([part.labels for part in parts])
    places = np.concatenate([part.places for part in parts])
    unique, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    axes = None
    if any(part.axes is not None for part in parts):
        usual = [np.tile(np.eye(3), (len(part.labels), 1, 1)) if part.axes is None else part.axes for part in parts]
        axes = np.concatenate(usual)
    for what, values in (("places", places), ("coordinate systems", axes)):
        differs = values is not None and (values[first][inverse.ravel()] != values).reshape(len(labels), -1).any(axis=1)
        if np.any(differs):
            raise InputError(f"nodes: node {labels[int(np.argmax(differs))]} is there with two {what}; allowed: one")
    sets = {name: mine for part in parts for name, mine in part.sets.items()}
    return Nodes(unique, places[first], sets, None if axes is None else axes[first])
