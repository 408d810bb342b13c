"""What finite elements are refused for: the number that is wrong, and the node and direction where it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import block_diag, csr_array

from eomgen.bending.element_files import arrays_of, elements_of, has_elements, read_elements
from eomgen.bending.finite_elements import FiniteElements, Interface
from eomgen.bending.link_files import read_link
from eomgen.bending.reducing import LinkSets, reduce_files
from eomgen.bending.reduction import reduce
from eomgen.errors import InputError
from tests.support.finite_elements import bar, beam

pytestmark = pytest.mark.quick

SMALL = {"counts": (3, 1, 1), "count": 2}


def _at(matrix: Any, row: int, column: int, add: float) -> Any:
    changed = matrix.tolil()
    changed[row, column] += add
    return changed.tocsr()


def _face(elements: FiniteElements, **about: Any) -> FiniteElements:
    return replace(elements, interfaces=(replace(elements.interfaces[0], **about),))


def _in_two(elements: FiniteElements) -> FiniteElements:
    """Return a bar and a second one that nothing holds."""
    n = len(elements.nodes)
    dofs = np.vstack([elements.dofs, elements.dofs + [n, 0]])
    both = {name: csr_array(block_diag([getattr(elements, name)] * 2)) for name in ("M", "K")}
    return replace(elements, nodes=np.vstack([elements.nodes] * 2), dofs=dofs, labels=np.arange(1, 2 * n + 1), **both)


def _clamped(elements: FiniteElements) -> FiniteElements:
    """Return matrices of a model that was written with its root held."""
    kept = np.flatnonzero(~np.isin(elements.dofs[:, 0], elements.root))
    small = {name: getattr(elements, name)[kept][:, kept] for name in ("M", "K")}
    return replace(elements, dofs=elements.dofs[kept], root=np.array([], dtype=np.intp), **small)


WRONG: dict[str, tuple[Callable[[FiniteElements], FiniteElements], str]] = {
    "unsymmetric": (
        lambda e: replace(e, K=_at(e.K, 7, 3, 1e5)),
        r"K: got .* between \(node 3, y\) and \(node 2, x\)|K: got .* between \(node 2, x\) and \(node 3, y\)",
    ),
    "springs to ground": (
        lambda e: replace(e, K=_at(e.K, 22, 22, 1e7)),
        r"K: got the translation along y by 1 m is resisted by 1e\+07 N at node 8, y, .* of the greatest sum of terms; "
        r"allowed: up to 1e-06",
    ),
    "nodes elsewhere": (
        lambda e: replace(e, nodes=e.nodes * [1.0, 2.0, 1.0]),
        "K: got the rotation about . by 1 rad is resisted by .* N at node",
    ),
    "held where it was written": (
        _clamped,
        r"K: got the translation along x by 1 m is resisted by .* at node",
    ),
    "negative mass": (
        lambda e: replace(e, M=_at(e.M, 4, 4, -1e3)),
        r"M: got -.* on the diagonal at node 2, y; allowed: 0 or",
    ),
    "masses by direction": (
        lambda e: replace(e, M=_at(e.M, 4, 4, 0.1)),
        "M: has masses of 12 kg along x, 12.1 kg along y, 12 kg along z; allowed: the same",
    ),
    "no masses": (lambda e: replace(e, M=e.M * 0.0), "M: all entries are 0"),
    "in two pieces": (
        _in_two,
        r"K, clamped: its pivot at node [0-9]+, . is .* of its diagonal; allowed|K, clamped: is singular",
    ),
    "root in a line": (
        lambda e: replace(e, root=e.root[:2]),
        "root: its displacements have rank 5 and leave the rotation about . open; allowed: rank 6",
    ),
    "interface of one node of solids": (
        lambda e: _face(e, kind="node", nodes=e.interfaces[0].nodes[:1]),
        "interface tip: its displacements have rank 3 and leave the rotation about . open; allowed: rank 6",
    ),
    "mean of a line": (
        lambda e: _face(e, kind="rbe3", nodes=e.interfaces[0].nodes[:2]),
        "interface tip: its displacements have rank 5",
    ),
    "interface at the root": (
        lambda e: _face(e, kind="rbe3", nodes=e.root),
        "interface tip: its flexibility along x is 0; allowed: above 0",
    ),
    "twice the same interface": (
        lambda e: replace(
            e, interfaces=tuple(replace(e.interfaces[0], kind="rbe3", name=name) for name in ("tip", "end"))
        ),
        "interfaces tip, end: their flexibility, scaled, has the eigenvalue .*; allowed: above 1e-12",
    ),
    "too many modes": (
        lambda e: replace(e, count=100),
        "count: got 100 modes; allowed: up to 24, as there are so many",
    ),
    "more modes than any": (lambda e: replace(e, count=1000), "count: got 1000; allowed: 0 to 194 modes beside"),
    "nothing to do": (lambda e: replace(e, interfaces=(), count=0), "count: got 0 modes and no interface"),
    "unknown kind": (lambda e: _face(e, kind="glue"), "interface tip: got the kind 'glue'; allowed: node, rbe2, rbe3"),
    "several nodes as one": (
        lambda e: _face(e, kind="node"),
        "interface tip: got 4 nodes; allowed: one for the kind node",
    ),
    "name of the root": (
        lambda e: _face(e, name="root"),
        "interface_names: got 'root'; allowed: an identifier other than",
    ),
    "no finite place": (lambda e: _face(e, place=np.array([np.nan, 0, 0])), "interface tip: got the place"),
    "place in other units": (
        lambda e: _face(e, place=np.array([1000.0, 0.0, 0.0])),
        "interface tip: its place is 999 m from its nodes, the link has 1 m; allowed: 100 times that",
    ),
    "one weight that counts": (
        lambda e: _face(e, kind="rbe3", weights=np.array([1.0, 1e-20, 1e-20, 1e-20])),
        "interface tip: its displacements have rank 3",
    ),
    "no positive weight": (
        lambda e: _face(e, kind="rbe3", weights=np.zeros(4)),
        "interface tip: allowed: a positive weight",
    ),
    "no finite node": (
        lambda e: replace(e, nodes=np.where(e.nodes == 0.05, np.inf, e.nodes)),
        "nodes: got inf as y of node 3; allowed: numbers up to",
    ),
    "a translation is missing": (
        lambda e: replace(e, dofs=e.dofs[:-1], M=e.M[:-1][:, :-1], K=e.K[:-1][:, :-1]),
        "dofs: node 16 has no coordinate z; allowed: x, y and z of each node",
    ),
    "a coordinate twice": (
        lambda e: replace(e, dofs=np.vstack([e.dofs[:-1], e.dofs[:1]])),
        "dofs: node 1, x is there twice; allowed: once",
    ),
    "direction that is none": (
        lambda e: replace(e, dofs=np.where(e.dofs == 2, 7, e.dofs)),
        "dofs: got node|dofs: got direction 7 in row 2; allowed: 0 .x., 1 .y.",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_link_is_refused(name: str) -> None:
    change, message = WRONG[name]
    with pytest.raises(InputError, match=message):
        reduce(change(bar(**SMALL)))


def test_large_links_are_refused_without_copies_of_their_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eomgen.bending.reduction.MOST_PIVOTS", 0)
    assert reduce(bar(**SMALL)).mass == pytest.approx(12.0)
    loose = _in_two(bar(**SMALL))
    n = loose.K.shape[0] // 2
    spring = 1e-9 * csr_array(np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(n)))  # between nodes at the same places
    with pytest.raises(InputError, match=r"K, clamped: a load moves node (1[7-9]|2[0-9]|3[0-2]), . as if it had"):
        reduce(replace(loose, K=loose.K + spring))


def test_what_is_asked_of_a_free_link_only_or_of_a_clamped_one() -> None:
    free = bar(clamped=False, **SMALL)
    with pytest.raises(InputError, match="root: has no node, and Craig-Bampton modes are asked for"):
        reduce(free, craig_bampton=True)
    massless = replace(beam(lumped=True, count=40, pieces=3))
    keep = massless.dofs[:, 1] < 3
    massless = replace(massless, M=massless.M.multiply(np.outer(keep, keep)).tocsr(), count=12)
    with pytest.raises(InputError, match="count: got 12 modes; allowed: up to 6, as so many have a mass"):
        reduce(massless)


def test_files_of_finite_elements_hold_what_they_were_written_from(tmp_path: Path) -> None:
    elements = bar("rbe3", counts=(3, 1, 1))
    elements = replace(elements, interfaces=(replace(elements.interfaces[0], weights=np.array([1.0, 2.0, 1.0, 2.0])),))
    path = tmp_path / "bar.npz"
    np.savez(path, **arrays_of(elements))
    found = read_elements(path)
    assert has_elements(arrays_of(elements))
    for name in ("nodes", "dofs", "root", "count", "reduced"):
        assert np.array_equal(getattr(found, name), getattr(elements, name))
    assert (found.K != elements.K).nnz == 0
    assert np.array_equal(found.interfaces[0].weights, elements.interfaces[0].weights)
    weighted = reduce_files([path], modes=2)
    assert weighted.frequencies != pytest.approx(reduce(bar("rbe3", counts=(3, 1, 1), count=2)).frequencies, rel=1e-6)
    link = weighted.save(tmp_path / "modes.npz")
    arrays = np.load(link)
    assert arrays["H0"].shape == (8, 4, 3)
    assert arrays["interface_names"].tolist() == ["tip"]
    assert arrays["interface_Phi"].shape == (1, 6, 8)
    body = read_link(link)
    assert body.modes.conflict() is None
    assert not body.is_free
    assert np.array_equal(np.array(body.modes.K), weighted.K)
    assert np.array_equal(np.array(body.modes.nodes[0].Phi), weighted.interface_Phi[0])
    free = reduce(bar(clamped=False, counts=(3, 1, 1), count=2)).save(tmp_path / "free.npz")
    assert read_link(free).is_free
    with pytest.raises(InputError, match=r"got sets beside a .npz; allowed: none"):
        reduce_files([path], LinkSets("x=0"), units="mm")


ARRAYS: dict[str, tuple[dict[str, Any], str]] = {
    "missing": ({"K_row": None}, "array 'K_row' is missing; allowed: a file of finite elements has it"),
    "no integers": ({"dofs": np.zeros((48, 2))}, "array 'dofs': has dtype float64; allowed: integers"),
    "shape": ({"nodes": np.zeros((16, 2))}, r"array 'nodes': has shape \(16, 2\); allowed: \(n, 3\)"),
    "outside": ({"M_row": np.full(9, 90), "M_col": np.zeros(9, int), "M_data": np.ones(9)}, "M: entry 1 has row 90"),
    "lengths": ({"M_row": np.zeros(3, int)}, "M: got 3 rows, .* columns"),
    "no number": (
        {"K_data": np.full(9, np.nan), "K_row": np.zeros(9, int), "K_col": np.zeros(9, int)},
        "K: got nan at row 0",
    ),
    "counts": ({"interface_counts": np.array([9])}, "interface_nodes: has 4 nodes; allowed: 9, the sum of"),
    "kinds": ({"interface_kinds": np.array(["rbe2", "rbe3"])}, "interface_kinds: has 2 entries; allowed: 1"),
    "members": ({"interface_nodes": np.array([0, 1, 2, 99])}, "interface_nodes: got 0 to 99; allowed: 0 to 15"),
    "root": ({"root": np.array([0, 99])}, "root: got a node 0 or 99; allowed: 0 to 15"),
    "cases": (
        {"stress_names": np.array(["a"]), **{f"stress_{k}": np.array([4]) for k in ("case", "row", "col", "data")}},
        "stress_case: got 4 to 4; allowed: 0 to 0",
    ),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_wrong_arrays_are_refused_by_name(name: str) -> None:
    changes, message = ARRAYS[name]
    arrays = {**arrays_of(bar(counts=(3, 1, 1))), **changes}
    with pytest.raises(InputError, match=message):
        elements_of({key: array for key, array in arrays.items() if array is not None})


def test_one_triangle_is_as_good_as_both() -> None:
    elements = bar(counts=(3, 1, 1))
    arrays = arrays_of(elements)
    for name in ("K", "M"):
        lower = arrays[f"{name}_row"] >= arrays[f"{name}_col"]
        arrays |= {f"{name}_{part}": arrays[f"{name}_{part}"][lower] for part in ("row", "col", "data")}
    assert abs(elements_of(arrays).K - elements.K).max() <= 1e-9 * abs(elements.K).max()


def test_models_beyond_memory_are_refused_by_size(monkeypatch: pytest.MonkeyPatch) -> None:
    elements = bar(counts=(3, 1, 1))
    many = {**arrays_of(elements), "nodes": np.zeros((1_000_000, 3))}
    with pytest.raises(InputError, match="nodes: got 1000000 nodes; allowed: 1 to 50000"):
        elements_of(many)
    monkeypatch.setattr("eomgen.bending.finite_elements.MOST_ENTRIES", 100)
    with pytest.raises(InputError, match=r"M: has .* entries; allowed: up to 100"):
        elements_of(arrays_of(elements))


def test_interfaces_are_values() -> None:
    face = Interface("tip", "rbe2", np.array([1]), np.zeros(3))
    assert face.weights is None


def _changed(array: np.ndarray, rng: np.random.Generator) -> Any:
    """Return an array that is wrong in some way, or None for none at all."""
    values = [0, -1, 1, 2**40, np.nan, np.inf, -1e300, 1e300, 1e-300, 3.5]
    kind = int(rng.integers(6))
    if kind == 0 or array.size == 0:
        return None
    if kind == 1:
        return array.ravel()[: int(rng.integers(array.size))]
    if kind == 2:
        return np.array(["rbe3", "tip"])[: int(rng.integers(3))]
    if kind == 3 and array.dtype.kind in "iuf":
        return array * float(rng.choice([-1.0, 0.0, 1e-9, 1e12]))
    if array.dtype.kind == "U":
        return np.array([rng.choice(["node", "rbe2", "rbe3", "", "root", "a b", "\x1b"])] * array.size)
    changed = array.astype(float if kind == 4 else array.dtype).copy()
    with np.errstate(invalid="ignore", over="ignore"):
        changed.flat[int(rng.integers(array.size))] = np.array(values[int(rng.integers(len(values)))]).astype(
            changed.dtype
        )
    return changed


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(4, 40))])
def test_random_changes_of_arrays_are_reduced_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    elements = bar(("rbe2", "rbe3")[seed % 2], counts=(2, 1, 1), count=2, clamped=seed != 3)
    arrays, refused = arrays_of(elements), 0
    for _ in range(60):
        changed = dict(arrays)
        for name in rng.choice(list(arrays), size=int(rng.integers(1, 3)), replace=False):
            changed[name] = _changed(arrays[name], rng)
        try:
            reduce(elements_of({name: array for name, array in changed.items() if array is not None}))
        except InputError as error:
            refused += str(error).count("allowed") > 0
    assert refused > 30
