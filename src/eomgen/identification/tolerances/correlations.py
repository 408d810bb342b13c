"""Correlations of tolerances: entries of a table as one matrix of coefficients, its groups, and a root to draw with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...arrays import Array, Index
from ...errors import DescriptionError
from ...names import listed, nearest, show
from .table import CORRELATIONS, MOST, Table, meant

KEYS = ("names", "coefficient", "matrix")
_NUMBER = "a number from -1 to 1"
_ROUND = 1e-12  # of coefficients that were computed
_LEAST = 1e-12  # times the size of a group: an eigenvalue that is zero but for round-off, on either side
_SHOWN = 0.1  # of the greatest component of an eigenvector: names that a refusal has


def read_correlations(table: Table) -> Array:
    """Return coefficients of correlation of a table's K parameters, (K, K), symmetric with ones on the diagonal.

    Entries whose names are all written out go before those with "*".

    Raises:
        DescriptionError: an entry with its place in the file, what came and what is allowed; a bounded parameter; a
            pair that stands twice; coefficients that no parameters can have together, with the names.
    """
    count = len(table.entries)
    correlation, ranks = np.eye(count), np.zeros((count, count), dtype=np.intp)
    tables = table.correlations
    if not isinstance(tables, (list, tuple)):
        message = f"{show(tables)}; allowed: tables [[{CORRELATIONS}]] with names and coefficient or matrix"
        raise table.refused((CORRELATIONS,), CORRELATIONS, message)
    for i, entry in enumerate(tables):
        chosen, block, rank = _read(table, i, entry)
        at = np.ix_(chosen, chosen)
        twice = np.argwhere(np.triu(ranks[at] == rank, 1))
        if len(twice):
            names = listed(table.entries[chosen[k]].name for k in twice[0])
            raise _refusal(table, i, "names", f"{names} are correlated twice; allowed: once")
        is_set = ~np.eye(len(chosen), dtype=bool) & (ranks[at] < rank)
        correlation[at] = np.where(is_set, block, correlation[at])
        ranks[at] = np.where(is_set, rank, ranks[at])
    _check_together(table, correlation)
    return correlation


def groups_of(correlation: Array) -> list[Index]:
    """Return indices of tolerances that are correlated, directly or by others, by groups of at least two."""
    linked = correlation != 0.0
    left = set(np.flatnonzero(linked.sum(axis=1) > 1).tolist())
    groups = []
    while left:
        group: set[int] = set()
        new = {min(left)}
        while new:
            group |= new
            new = set(np.flatnonzero(linked[sorted(new)].any(axis=0)).tolist()) - group
        left -= group
        groups.append(np.array(sorted(group), dtype=np.intp))
    return groups


def root_of(correlation: Array) -> Array:
    """Return a matrix L, (K, K), with L L^T the correlation, (K, K).

    Its rows are those of the identity where nothing is correlated.
    """
    root = np.eye(len(correlation))
    for group in groups_of(correlation):
        at = np.ix_(group, group)
        values, axes = np.linalg.eigh(correlation[at])
        root[at] = axes * np.sqrt(np.where(values > _LEAST * len(group), values, 0.0))
    return root


def plain_correlations(names: Sequence[str], correlation: Array) -> list[dict[str, Any]]:
    """Return the entries of a table that state the correlation, (K, K), of K names: names and matrix of each group."""
    return [
        {"names": [names[k] for k in group], "matrix": correlation[np.ix_(group, group)].tolist()}
        for group in groups_of(correlation)
    ]


def _read(table: Table, i: int, entry: Any) -> tuple[list[int], Array, int]:
    """Return indices of an entry's parameters, their coefficients, and its rank.

    The rank is 2 where all names are written out, else 1.
    """
    if not isinstance(entry, Mapping):
        raise _refusal(table, i, "", f"{show(entry)}; allowed: a table with names and coefficient or matrix")
    for key in entry:
        if key not in KEYS:
            raise _refusal(table, i, str(key), f"is unknown{nearest(str(key), KEYS)}; allowed: {', '.join(KEYS)}")
    sizes = [key for key in KEYS[1:] if key in entry]
    if len(sizes) != 1:
        message = f"has {' and '.join(sizes) or 'neither coefficient nor matrix'}; allowed: one of coefficient, matrix"
        raise _refusal(table, i, "", message)
    chosen, is_pattern = _chosen(table, i, entry.get("names"))
    if sizes == ["matrix"]:
        if is_pattern:
            message = "has a name with '*' beside a matrix, whose rows need an order; allowed: names written out"
            raise _refusal(table, i, "names", message)
        return chosen, _matrix(table, i, entry["matrix"], len(chosen)), 2
    value = entry["coefficient"]
    if not _is_coefficient(value):
        raise _refusal(table, i, "coefficient", f"{show(value)}; allowed: {_NUMBER}")
    return chosen, np.full((len(chosen), len(chosen)), np.clip(float(value), -1.0, 1.0)), 1 if is_pattern else 2


def _chosen(table: Table, i: int, names: Any) -> tuple[list[int], bool]:
    """Return indices of the parameters that names mean, in their order, and whether one of the names is a pattern."""
    is_list = isinstance(names, (list, tuple)) and all(isinstance(name, str) for name in names)
    if not is_list or not 0 < len(names) <= MOST:
        raise _refusal(table, i, "names", f"{show(names)}; allowed: an array of up to {MOST} names of the table")
    known = [entry.name for entry in table.entries]
    index = {name: k for k, name in enumerate(known)}
    places: list[int] = []
    for name in names:
        ones = meant(name, known)
        if not ones:
            message = f"the table has no {show(name)}{nearest(name, known)}; allowed: {listed(known)}"
            raise _refusal(table, i, "names", message)
        for one in ones:
            if table.entries[index[one]].bound is not None:
                message = (
                    f"{show(one)} is uniformly distributed within a bound; allowed: parameters with a deviation,"
                    " which are normal"
                )
                raise _refusal(table, i, "names", message)
            if index[one] in places:
                raise _refusal(table, i, "names", f"{show(one)} is there twice; allowed: once")
            places.append(index[one])
    if len(places) < 2:
        raise _refusal(table, i, "names", f"{show(known[places[0]])} is alone; allowed: at least two parameters")
    return places, any("*" in name for name in names)


def _matrix(table: Table, i: int, entry: Any, count: int) -> Array:
    """Return coefficients of an entry's matrix, (count, count)."""
    rows = entry.tolist() if isinstance(entry, np.ndarray) else entry
    is_square = (
        isinstance(rows, (list, tuple))
        and len(rows) == count
        and all(isinstance(row, (list, tuple)) and len(row) == count for row in rows)
    )
    if not is_square:
        raise _refusal(
            table, i, "matrix", f"{show(entry)}; allowed: {count} rows of {count} numbers, as there are names"
        )
    for j, row in enumerate(rows):
        for k, value in enumerate(row):
            if not _is_coefficient(value):
                raise _refusal(table, i, "matrix", f"row {j}, column {k}: {show(value)}; allowed: {_NUMBER}")
    matrix = np.array(rows, dtype=np.float64)
    for j in range(count):
        if abs(matrix[j, j] - 1.0) > _ROUND:
            raise _refusal(table, i, "matrix", f"row {j}, column {j}: {matrix[j, j]:g}; allowed: 1 on the diagonal")
    apart = np.argwhere(np.abs(matrix - matrix.T) > _ROUND)
    if len(apart):
        j, k = apart[0].tolist()
        got = f"row {j}, column {k}: {show(rows[j][k])}, but {show(rows[k][j])} the other way"
        raise _refusal(table, i, "matrix", f"{got}; allowed: symmetric matrices")
    matrix = np.clip(0.5 * (matrix + matrix.T), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


def _is_coefficient(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= 1.0 + _ROUND


def _check_together(table: Table, correlation: Array) -> None:
    """Refuse coefficients with which a sum of parameters would have a negative variance."""
    for group in groups_of(correlation):
        values, axes = np.linalg.eigh(correlation[np.ix_(group, group)])
        if values[0] < -_LEAST * len(group):
            along = np.abs(axes[:, 0])
            order = [k for k in np.argsort(-along, kind="stable") if along[k] > _SHOWN * along.max()]
            names = listed(table.entries[group[k]].name for k in order)
            message = (
                f"the matrix of {names} has the eigenvalue {values[0]:.3g}: a sum of them would have a negative"
                " variance; allowed: positive semidefinite matrices"
            )
            raise table.refused((CORRELATIONS,), CORRELATIONS, message)


def _refusal(table: Table, i: int, key: str, message: str) -> DescriptionError:
    """Return the error of an entry, or of a key of it, with its line in the file."""
    keys: Sequence[str] = (CORRELATIONS, str(i), *((key,) if key else ()))
    return table.refused(keys, f"{CORRELATIONS}[{i}]{f'.{key}' if key else ''}", message)
