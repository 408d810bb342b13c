"""Finite elements in a .npz: nodes, sparse M and K, the root and the interfaces.

nodes                       (N, 3), m, link frame
dofs                        (n, 2), of each row of the matrices: row of nodes, and 0 to 5 for x y z alpha beta gamma;
                            node -1: an amplitude of a mode of an already reduced model
M_row, M_col, M_data        entries of M, kg and m; both triangles or one of them; entries of one place are added
K_row, K_col, K_data        entries of K, N and m
root                        rows of nodes that are clamped; none, or no such array: the link is free
interface_names             (I,), texts
interface_kinds             (I,), "node", "rbe2" or "rbe3"
interface_counts            (I,), nodes of each
interface_nodes             rows of nodes, one interface after the other
interface_weights           as many, of "rbe3"; without: the same for all
interface_places            (I, 3), m; without: the mean of each interface's nodes
count                       modes beside those of interfaces; without: 6
reduced                     whether M and K are those of a reduced model; without: if there are amplitudes
stress_names                (C,), load cases, and stress_case, stress_row, stress_col, stress_data: entries of their
                            geometric stiffness matrices, each with the number of its case
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Index
from ..errors import InputError
from ..identifiers import plain_path
from ..names import show
from ..npz import read_npz
from .finite_elements import (
    MODAL,
    MOST_ENTRIES,
    MOST_FACES,
    MOST_NODES,
    MOST_ROWS,
    FiniteElements,
    Interface,
    checked,
    stress_cases,
    symmetric_from,
)

Arrays = Mapping[str, NDArray[Any]]

COUNT = 6  # modes beside those of interfaces, where nothing is said
NAMES = (
    *("nodes", "dofs", "root", "count", "reduced"),
    *(f"{matrix}_{part}" for matrix in ("M", "K") for part in ("row", "col", "data")),
    *(f"interface_{part}" for part in ("names", "kinds", "counts", "nodes", "weights", "places")),
    *(f"stress_{part}" for part in ("names", "case", "row", "col", "data")),
)


def has_elements(arrays: Arrays) -> bool:
    """Whether arrays of a file are those of finite elements."""
    return "K_data" in arrays or "M_data" in arrays


def read_elements(path: Path | str) -> FiniteElements:
    """Read a link's finite elements from a .npz; the module's docstring has its arrays.

    Raises:
        InputError: the file cannot be read, is too large, or holds something else; the message has the array.
    """
    arrays = read_npz(path, NAMES)
    try:
        return elements_of(arrays)
    except InputError as error:
        raise InputError(f"{plain_path(path)}: {error}") from None


def elements_of(arrays: Arrays) -> FiniteElements:
    """Return the finite elements of arrays by their names.

    Raises:
        InputError: they are not; the message has the array.
    """
    count = len(_shaped(_of(arrays, "nodes", "iuf", "numbers"), "nodes", (None, 3)))
    if count > MOST_NODES:
        raise InputError(
            f"nodes: got {count} nodes; allowed: 1 to {MOST_NODES}, reduce larger models where they are made"
        )
    nodes, dofs = _numbers(arrays, "nodes", (None, 3)), _integers(arrays, "dofs", (None, 2), MOST_ROWS)
    matrices = {}
    for name in ("M", "K"):
        rows, columns = (_integers(arrays, f"{name}_{part}", (None,), MOST_ENTRIES) for part in ("row", "col"))
        entries = _numbers(arrays, f"{name}_data", (None,), MOST_ENTRIES)
        matrices[name] = symmetric_from(rows, columns, entries, len(dofs), name)
    root = _integers(arrays, "root", (None,), MOST_NODES) if "root" in arrays else np.array([], dtype=np.intp)
    count = int(_integers(arrays, "count", ())) if "count" in arrays else COUNT
    reduced = bool(_integers(arrays, "reduced", ())) if "reduced" in arrays else bool(np.any(dofs[:, 0] == MODAL))
    interfaces = _interfaces(arrays, nodes)
    labels, stress = np.arange(len(nodes)), _stress(arrays, len(dofs), len(stress_cases(interfaces)))
    return checked(
        FiniteElements(nodes, dofs, matrices["M"], matrices["K"], root, interfaces, count, labels, reduced, stress)
    )


def arrays_of(elements: FiniteElements) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file of finite elements."""
    arrays: dict[str, Any] = {"nodes": elements.nodes, "dofs": elements.dofs, "root": elements.root}
    for name, matrix in (("M", elements.M.tocoo()), ("K", elements.K.tocoo())):
        arrays |= {f"{name}_row": matrix.row, f"{name}_col": matrix.col, f"{name}_data": matrix.data}
    arrays["count"], arrays["reduced"] = np.array(elements.count), np.array(elements.reduced)
    faces = elements.interfaces
    if faces:
        arrays["interface_names"] = np.array([face.name for face in faces])
        arrays["interface_kinds"] = np.array([face.kind for face in faces])
        arrays["interface_counts"] = np.array([len(face.nodes) for face in faces])
        arrays["interface_nodes"] = np.concatenate([face.nodes for face in faces])
        arrays["interface_places"] = np.array([face.place for face in faces])
        weights = [np.ones(len(face.nodes)) if face.weights is None else face.weights for face in faces]
        arrays["interface_weights"] = np.concatenate(weights)
    if elements.stress:
        parts = [matrix.tocoo() for matrix in elements.stress.values()]
        arrays["stress_names"] = np.array(list(elements.stress))
        arrays["stress_case"] = np.concatenate([np.full(part.nnz, k) for k, part in enumerate(parts)])
        for name, key in (("row", "row"), ("col", "col"), ("data", "data")):
            arrays[f"stress_{name}"] = np.concatenate([getattr(part, key) for part in parts])
    return arrays


def _interfaces(arrays: Arrays, nodes: Array) -> tuple[Interface, ...]:
    """Return the interfaces of a file; their places are those of their nodes' means where it has none."""
    if "interface_names" not in arrays:
        return ()
    names, kinds = (_texts(arrays, f"interface_{part}", MOST_FACES) for part in ("names", "kinds"))
    counts = _integers(arrays, "interface_counts", (None,), MOST_FACES)
    members = _integers(arrays, "interface_nodes", (None,), MOST_FACES * MOST_NODES)
    for name, length in (("interface_kinds", len(kinds)), ("interface_counts", len(counts))):
        if length != len(names):
            raise InputError(f"{name}: has {length} entries; allowed: {len(names)}, as interface_names has")
    if np.any(counts < 0) or counts.sum() != len(members):
        raise InputError(
            f"interface_nodes: has {len(members)} nodes; allowed: {counts.sum()}, the sum of interface_counts"
        )
    if np.any((members < 0) | (members >= len(nodes))):
        raise InputError(f"interface_nodes: got {members.min()} to {members.max()}; allowed: 0 to {len(nodes) - 1}")
    ends = np.cumsum(counts)
    sets = [members[end - count : end] for end, count in zip(ends.tolist(), counts.tolist(), strict=True)]
    weights = None
    if "interface_weights" in arrays:
        weights = _numbers(arrays, "interface_weights", (len(members),))
    places = _numbers(arrays, "interface_places", (len(names), 3)) if "interface_places" in arrays else None
    faces = []
    for k, (name, kind, mine) in enumerate(zip(names, kinds, sets, strict=True)):
        if len(mine) == 0:
            raise InputError(f"interface {show(name)}: has no node; allowed: at least one")
        place = nodes[mine].mean(axis=0) if places is None else places[k]
        own = weights[ends[k] - counts[k] : ends[k]] if weights is not None and kind == "rbe3" else None
        faces.append(Interface(name, kind, mine, place, own))
    return tuple(faces)


def _stress(arrays: Arrays, size: int, most: int) -> dict[str, Any]:
    """Return geometric stiffness matrices by load case, of which there are so many at most."""
    if "stress_names" not in arrays:
        return {}
    names = _texts(arrays, "stress_names", most)
    case, rows, columns = (
        _integers(arrays, f"stress_{part}", (None,), most * MOST_ENTRIES) for part in ("case", "row", "col")
    )
    entries = _numbers(arrays, "stress_data", (len(case),))
    if not len(rows) == len(columns) == len(case):
        got = f"{len(case)} cases, {len(rows)} rows, {len(columns)} columns"
        raise InputError(f"stress_case: got {got}; allowed: as many of each")
    if np.any((case < 0) | (case >= len(names))):
        raise InputError(f"stress_case: got {case.min()} to {case.max()}; allowed: 0 to {len(names) - 1}")
    matrices = {}
    for k, name in enumerate(names):
        if name in matrices:
            raise InputError(f"stress_names: {show(name)} is there twice; allowed: once")
        mine = case == k
        matrices[name] = symmetric_from(rows[mine], columns[mine], entries[mine], size, f"stress {name}")
    return matrices


def _of(arrays: Arrays, name: str, kinds: str, allowed: str) -> NDArray[Any]:
    if name not in arrays:
        raise InputError(f"array {show(name)} is missing; allowed: a file of finite elements has it")
    array = arrays[name]
    if array.dtype.kind not in kinds and array.size:
        raise InputError(f"array {show(name)}: has dtype {array.dtype}; allowed: {allowed}")
    return array


def _shaped(array: NDArray[Any], name: str, shape: tuple[int | None, ...], most: int | None = None) -> NDArray[Any]:
    """Return an array of that shape, of so many rows at most, before it is made another."""
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits:
        text = ", ".join("n" if want is None else str(want) for want in shape)
        raise InputError(f"array {show(name)}: has shape {array.shape}; allowed: ({text})")
    if most is not None and len(array) > most:
        raise InputError(f"array {show(name)}: has {len(array)} entries; allowed: up to {most}")
    return array


def _numbers(arrays: Arrays, name: str, shape: tuple[int | None, ...], most: int | None = None) -> Array:
    return _shaped(_of(arrays, name, "iuf", "numbers"), name, shape, most).astype(np.float64)


def _integers(arrays: Arrays, name: str, shape: tuple[int | None, ...], most: int | None = None) -> Index:
    return _shaped(_of(arrays, name, "iub", "integers"), name, shape, most).astype(np.intp)


def _texts(arrays: Arrays, name: str, most: int) -> list[str]:
    return [str(text) for text in _shaped(_of(arrays, name, "U", "texts"), name, (None,), most)]
