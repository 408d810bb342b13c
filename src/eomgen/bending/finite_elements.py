"""A link as finite elements: nodes, sparse mass and stiffness matrices, its root and its interfaces.

Coordinates of finite elements are displacements of nodes, ``DIRECTIONS`` in the link's axes: three of a solid's node,
six of a shell's or a beam's.  Coordinates without a node (amplitudes of modes of an already reduced model) have node
-1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Index
from ..errors import InputError
from ..identifiers import is_identifier
from ..limits import LARGEST, MOST_MODES
from ..names import show

DIRECTIONS = ("x", "y", "z", "alpha", "beta", "gamma")
KINDS = ("node", "rbe2", "rbe3")
MODAL = -1  # node of a coordinate that is an amplitude of a mode
MOST_NODES = 50_000  # 150 000 unknowns of solids: their sparse factors take some GB, and minutes
MOST_ROWS = len(DIRECTIONS) * MOST_NODES  # of a matrix
MOST_ENTRIES = 30_000_000  # of one matrix: 480 MB
MOST_FACES = MOST_MODES // len(DIRECTIONS)  # interfaces, each of which has so many modes
FAR = 100.0  # of a link's size: interfaces that are further away were given in other units
BODY_CASES = tuple(f"body.{j}.{i}" for j in ("x", "y", "z", "1") for i in ("x", "y", "z"))
_NAMED = 5  # of things that are wrong


@dataclass(frozen=True)
class Interface:
    """A place of a link where joints, frames and loads stand.

    kind: "node", one node with six coordinates; "rbe2", a set of nodes that moves as a rigid body; "rbe3", the weighted
    mean of a set's displacements, which leaves the set free to deform.  nodes: rows of ``FiniteElements.nodes``.
    place: m, link frame.  weights: as many as nodes; of "rbe3" alone.
    """

    name: str
    kind: str
    nodes: Index
    place: Array
    weights: Array | None = None


@dataclass(frozen=True)
class FiniteElements:
    """A link's finite elements: SI units, link frame.

    nodes: (N, 3), m.  dofs: (n, 2), of each row of the matrices its node (a row of ``nodes``, or MODAL) and the number
    of its direction.  M, K: sparse, (n, n), symmetric.  root: nodes that stand on the link's joint, clamped; none: the
    link is free, as it is behind a joint of type "free".  count: modes beside those of the interfaces.  labels: (N,),
    what the file calls its nodes.  reduced: whether M and K are those of a reduced model, whose nodes carry no masses
    of their own.  stress: geometric stiffness matrices by load case, "body.x.y" or "tip.x" (``reduction`` says which).
    """

    nodes: Array
    dofs: Index
    M: Any
    K: Any
    root: Index
    interfaces: tuple[Interface, ...]
    count: int
    labels: Index
    reduced: bool = False
    stress: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def row_name(self, row: int) -> str:
        """Name a row of the matrices: "node 12, y"."""
        node, direction = self.dofs[row].tolist()
        return f"amplitude {row + 1}" if node == MODAL else f"node {self.labels[node]}, {DIRECTIONS[direction]}"

    def by_node(self) -> Index:
        """Return the rows of each node's coordinates, (N, 6); -1 where it has none."""
        rows = np.full((len(self.nodes), len(DIRECTIONS)), -1, dtype=np.intp)
        of_nodes = np.flatnonzero(self.dofs[:, 0] != MODAL)
        rows[self.dofs[of_nodes, 0], self.dofs[of_nodes, 1]] = of_nodes
        return rows


def stress_cases(interfaces: tuple[Interface, ...]) -> tuple[str, ...]:
    """Name all load cases of stiffening by rotation: 12 of the body, three of each interface."""
    return BODY_CASES + tuple(f"{interface.name}.{i}" for interface in interfaces for i in DIRECTIONS[:3])


def symmetric_from(rows: NDArray[Any], columns: NDArray[Any], entries: Array, size: int, what: str) -> Any:
    """Return a sparse matrix of entries by their places; of one triangle alone, the other is mirrored.

    Raises:
        InputError: a place is outside, or an entry is not finite; ``what`` begins the message.
    """
    from scipy.sparse import csr_array

    if not len(rows) == len(columns) == len(entries):
        got = f"{len(rows)} rows, {len(columns)} columns, {len(entries)} entries"
        raise InputError(f"{what}: got {got}; allowed: as many of each")
    if len(entries) > MOST_ENTRIES:
        raise InputError(f"{what}: has {len(entries)} entries; allowed: up to {MOST_ENTRIES}")
    for name, places in (("row", rows), ("column", columns)):
        outside = np.flatnonzero((places < 0) | (places >= size))
        if len(outside):
            k = int(outside[0])
            raise InputError(f"{what}: entry {k + 1} has {name} {places[k]}; allowed: 0 to {size - 1}")
    wrong = np.flatnonzero(~(np.abs(entries) <= LARGEST))
    if len(wrong):
        k = int(wrong[0])
        raise InputError(
            f"{what}: got {entries[k]} at row {rows[k]}, column {columns[k]}; allowed: numbers up to {LARGEST:g}"
        )
    matrix = csr_array((entries, (rows, columns)), shape=(size, size))
    if np.any(rows != columns) and (bool(np.all(rows >= columns)) or bool(np.all(rows <= columns))):
        diagonal = matrix.diagonal()
        matrix = (matrix + matrix.T).tocsr()
        matrix.setdiag(diagonal)
    return matrix


def checked(elements: FiniteElements) -> FiniteElements:
    """Return finite elements whose shapes, numbers and sets are right by themselves.

    Raises:
        InputError: they are not; the message has the number and the place.
    """
    n, nodes = len(elements.dofs), len(elements.nodes)
    if not 1 <= nodes <= MOST_NODES:
        raise InputError(
            f"nodes: got {nodes} nodes; allowed: 1 to {MOST_NODES}, reduce larger models where they are made"
        )
    wrong = np.argwhere(~(np.abs(elements.nodes) <= LARGEST))
    if len(wrong):
        i, j = wrong[0].tolist()
        got = f"{elements.nodes[i, j]} as {DIRECTIONS[j]} of node {elements.labels[i]}"
        raise InputError(f"nodes: got {got}; allowed: numbers up to {LARGEST:g}")
    for name, matrix in (("M", elements.M), ("K", elements.K), *elements.stress.items()):
        if matrix.shape != (n, n):
            raise InputError(f"{name}: got a matrix of {matrix.shape}; allowed: {(n, n)}, as there are {n} dofs")
    if len(elements.interfaces) > MOST_FACES:
        faces = f"{len(elements.interfaces)} interfaces; allowed: up to {MOST_FACES}"
        raise InputError(f"interface_names: got {faces}, each of which has {len(DIRECTIONS)} modes")
    _check_dofs(elements)
    _check_sets(elements)
    most = MOST_MODES - len(DIRECTIONS) * len(elements.interfaces)
    if not 0 <= elements.count <= most:
        raise InputError(f"count: got {elements.count}; allowed: 0 to {most} modes beside those of interfaces")
    if not elements.interfaces and not elements.count:
        raise InputError("count: got 0 modes and no interface; allowed: at least one of either")
    _check_stress(elements)
    return elements


def _check_dofs(elements: FiniteElements) -> None:
    """Refuse directions that are none, rows that are there twice, and nodes without all three translations."""
    of_node, direction = elements.dofs[:, 0], elements.dofs[:, 1]
    modal = of_node == MODAL
    outside = np.flatnonzero(~modal & ((of_node < 0) | (of_node >= len(elements.nodes))))
    if len(outside):
        k = int(outside[0])
        allowed = f"0 to {len(elements.nodes) - 1}, or {MODAL} of an amplitude"
        raise InputError(f"dofs: got node {of_node[k]} in row {k}; allowed: {allowed}")
    wrong = np.flatnonzero(~modal & ((direction < 0) | (direction >= len(DIRECTIONS))))
    if len(wrong):
        k = int(wrong[0])
        numbered = ", ".join(f"{i} ({name})" for i, name in enumerate(DIRECTIONS))
        raise InputError(f"dofs: got direction {direction[k]} in row {k}; allowed: {numbered}")
    places = of_node[~modal] * len(DIRECTIONS) + direction[~modal]
    unique, counts = np.unique(places, return_counts=True)
    if np.any(counts > 1):
        node, way = divmod(int(unique[counts > 1][0]), len(DIRECTIONS))
        raise InputError(f"dofs: node {elements.labels[node]}, {DIRECTIONS[way]} is there twice; allowed: once")
    has = elements.by_node() >= 0
    partly = np.flatnonzero(has.any(axis=1) & ~has[:, :3].all(axis=1))
    if len(partly):
        missing = ", ".join(
            name for name, there in zip(DIRECTIONS, has[partly[0], :3].tolist(), strict=False) if not there
        )
        raise InputError(
            f"dofs: node {elements.labels[partly[0]]} has no coordinate {missing}; allowed: x, y and z of each node: "
            "write the matrices without boundary conditions"
        )


def _check_sets(elements: FiniteElements) -> None:
    """Refuse sets of nodes that are empty, twice the same, without coordinates, or rigid in two sets."""
    names = [interface.name for interface in elements.interfaces]
    for name in names:
        if not is_identifier(name) or name == "root":
            raise InputError(f"interface_names: got {show(name)}; allowed: an identifier other than root")
        if names.count(name) > 1:
            raise InputError(f"interface_names: {show(name)} is there twice; allowed: once")
    rigid: dict[int, str] = {}
    sets = [("root", "rbe2", elements.root), *((i.name, i.kind, i.nodes) for i in elements.interfaces)]
    for name, kind, nodes in sets:
        _check_set(elements, name, kind, nodes)
        for node in nodes.tolist() if kind != "rbe3" else ():
            if node in rigid:
                twice = f"node {elements.labels[node]} is in {rigid[node]} and in {name}"
                raise InputError(f"{twice}; allowed: in one rigid set (rbe3 sets may share nodes)")
            rigid[node] = name
    size = float(np.ptp(elements.nodes, axis=0).max())
    for interface in elements.interfaces:
        _check_interface(elements, interface, size)


def _check_set(elements: FiniteElements, name: str, kind: str, nodes: Index) -> None:
    """Refuse a set of another kind, without nodes, with nodes twice, or with such that matrices do not have."""
    if kind not in KINDS:
        raise InputError(f"interface {name}: got the kind {show(kind)}; allowed: {', '.join(KINDS)}")
    if len(nodes) == 0 and name != "root":
        raise InputError(f"interface {name}: has no node; allowed: at least one")
    if kind == "node" and len(nodes) != 1:
        raise InputError(f"interface {name}: got {len(nodes)} nodes; allowed: one for the kind node")
    if np.any((nodes < 0) | (nodes >= len(elements.nodes))):
        raise InputError(f"{name}: got a node {nodes.min()} or {nodes.max()}; allowed: 0 to {len(elements.nodes) - 1}")
    if len(np.unique(nodes)) != len(nodes):
        raise InputError(f"{name}: has a node twice; allowed: once")
    bare = nodes[np.min(elements.by_node()[nodes, :3], axis=1, initial=0) < 0]
    if len(bare):
        label = elements.labels[bare[0]]
        raise InputError(f"{name}: node {label} has no coordinates in the matrices; allowed: nodes that have them")


def _check_interface(elements: FiniteElements, interface: Interface, size: float) -> None:
    """Refuse a place that is far from the nodes of an interface, by the link's size, and weights that are none."""
    if not np.all(np.abs(interface.place) <= LARGEST):
        got = f"got the place {interface.place.tolist()}"
        raise InputError(f"interface {interface.name}: {got}; allowed: numbers up to {LARGEST:g}")
    far = float(np.abs(interface.place - elements.nodes[interface.nodes].mean(axis=0)).max())
    if far > FAR * size:
        got = f"its place is {far:.3g} m from its nodes, the link has {size:.3g} m"
        raise InputError(f"interface {interface.name}: {got}; allowed: {FAR:g} times that, in units of the nodes")
    weights = interface.weights
    if weights is not None and not (
        len(weights) == len(interface.nodes) and bool(np.all((weights > 0.0) & (weights <= LARGEST)))
    ):
        raise InputError(f"interface {interface.name}: allowed: a positive weight for each of its nodes")


def _check_stress(elements: FiniteElements) -> None:
    """Refuse load cases that are not all there: Q without Psi is right without a payload only."""
    if not elements.stress:
        return
    cases = stress_cases(elements.interfaces)
    missing = [name for name in cases if name not in elements.stress]
    unknown = [name for name in elements.stress if name not in cases]
    if missing or unknown:
        what = f"lacks {', '.join(missing[:_NAMED])}" if missing else f"has {', '.join(map(show, unknown[:_NAMED]))}"
        raise InputError(f"stress: {what}; allowed: none, or all {len(cases)} load cases: {', '.join(cases)}")
