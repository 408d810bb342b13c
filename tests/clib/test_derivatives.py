"""Derivatives of accelerations on small systems, against NumPy's solutions of the whole system."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.codegen.package.compile import FLAGS, WARNINGS

LIBRARY = Path(eomgen.__path__[0], "clib")
SOURCE = Path(__file__).with_name("derivatives.c")
DECLARED = """
typedef struct { int blocks; const int *first; const int *rows; const int *width; const int *moved; int kept;
    const int *place; const int *start; const int *count; const int *kind; int kinds; int refinements; double share;
    double floor; } eom_constraint_rows;
int tree(int n, const int *parent, const int *known, double *out);
int tree_in_lanes(int n, const int *parent, const int *known, size_t count, double *out);
int closed(int n, const int *parent, const int *known, const eom_constraint_rows *rows, const double *D, double *out);
int closed_in_lanes(int n, const int *parent, const int *known, const eom_constraint_rows *rows, int size,
    const double *D, double *out);
"""
PARENTS = {"chain": (-1, 0, 1, 2), "branches": (-1, 0, 0, 2, 0), "two trees": (-1, 0, -1, 2)}
WIDTH = 2  # lanes of the least level
Array = NDArray[Any]
FFI = cffi.FFI()
FFI.cdef(DECLARED)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    made = tmp_path_factory.mktemp("derivatives") / "derivatives.so"
    command = ["cc", *WARNINGS, "-Werror", "-shared", "-fPIC", *FLAGS, f"-I{LIBRARY}", "-DEOMGEN_VECTOR=16"]
    subprocess.run([*command, str(SOURCE), "-o", str(made), "-lm"], check=True)
    return FFI.dlopen(str(made))


def numbers(values: Array) -> Any:
    return FFI.from_buffer("double[]", values)


def integers(values: Any) -> Any:
    return FFI.new("int[]", list(values))


def mass_matrix(parents: tuple[int, ...], rng: np.random.Generator) -> Array:
    """M = L^T D L: an entry is zero where neither coordinate is on the way of the other to the base."""
    n = len(parents)
    lower, on_way = np.eye(n), parents
    for i in range(n):
        above = on_way[i]
        while above >= 0:
            lower[i, above] = rng.standard_normal()
            above = on_way[above]
    return np.asarray(lower.T @ np.diag(rng.uniform(1.0, 2.0, n)) @ lower)


def of_tree(matrices: Array, known: Array) -> Array:
    """-M^-1 dr/dq, -M^-1 dr/dv and M^-1; a coordinate whose acceleration is known is u itself."""
    by_q, by_v, mass = matrices
    n, free = len(mass), np.flatnonzero(known == 0)
    found = np.zeros((3, n, n))
    inverse = np.linalg.inv(mass[np.ix_(free, free)])
    found[0][free], found[1][free] = -inverse @ by_q[free], -inverse @ by_v[free]
    given = np.flatnonzero(known)
    found[2][np.ix_(free, free)] = inverse
    found[2][np.ix_(free, given)] = -inverse @ mass[np.ix_(free, given)]
    found[2][given, given] = 1.0
    return found


@pytest.mark.parametrize("shape", PARENTS)
@pytest.mark.parametrize("prescribed", [(), (1,), (0, 3)], ids=str)
def test_of_a_tree(library: Any, shape: str, prescribed: tuple[int, ...]) -> None:
    """Of one state, and of as many lanes, to the bit the same."""
    rng, parents = np.random.default_rng(len(prescribed)), PARENTS[shape]
    n = len(parents)
    known = np.array([int(i in prescribed) for i in range(n)])
    given = np.array([[*rng.standard_normal((2, n, n)), mass_matrix(parents, rng)] for _ in range(WIDTH)])
    pointer = integers(known) if prescribed else FFI.NULL
    alone, together = given.copy(), given.copy()
    for state in alone:
        assert library.tree(n, integers(parents), pointer, numbers(state)) == 0
    assert library.tree_in_lanes(n, integers(parents), pointer, WIDTH, numbers(together)) == 0
    assert np.array_equal(alone, together)
    for state, matrices in zip(alone, given, strict=True):
        assert np.allclose(state, of_tree(matrices, known), rtol=1e-11, atol=1e-12)


def test_a_pivot_that_vanishes_is_named(library: Any) -> None:
    given = np.zeros((3, 2, 2))
    given[2] = [[1.0, 1.0], [1.0, 1.0]]  # of rank 1: the last pivot is eliminated first
    assert library.tree(2, integers((-1, 0)), FFI.NULL, numbers(given)) == 1


@pytest.mark.parametrize("redundant", [False, True])
@pytest.mark.parametrize("prescribed", [(), (2,)], ids=str)
def test_of_a_closed_mechanism(library: Any, redundant: bool, prescribed: tuple[int, ...]) -> None:
    """Two blocks of two rows and one, of which one row vanishes always; a row may stand there twice."""
    rng, parents = np.random.default_rng(7), (-1, 0, 1, -1, 3)
    n, columns = len(parents), ((0, 1, 3), (1, 3, 4))
    rows, known = (3, 1), np.array([int(i in prescribed) for i in range(n)])
    place, kind = (0, -1, 1, 2), (0, 1, 0)
    given, blocks, expected = [], [], []
    for _ in range(WIDTH):
        by_q, by_v, mass = *rng.standard_normal((2, n, n)), mass_matrix(parents, rng)
        J, by, packed = np.zeros((3, n)), np.zeros((2, 3, n)), []
        for b, (count, moved) in enumerate(zip(rows, columns, strict=True)):
            own = rng.standard_normal((3, count, len(moved)))
            if b == 0:
                own[:, 1] = 0.0
            if b == 0 and redundant:
                own[:, 2] = own[:, 0]
            curved = rng.standard_normal((len(moved), len(moved)))
            by_q[np.ix_(moved, moved)] += curved  # what the derivatives D take away again
            packed += [own.ravel(), curved.ravel()]
            for r in range(count):
                at = place[(0, 3)[b] + r]
                if at >= 0:
                    J[at, moved], by[:, at, moved] = own[0, r], own[1:, r]
        given.append([by_q.copy(), by_v, mass])
        for moved, curved in zip(columns, packed[1::2], strict=True):
            by_q[np.ix_(moved, moved)] -= curved.reshape(len(moved), -1)
        tree = of_tree(np.array([by_q, by_v, mass]), known)
        inverse = of_tree(np.array([by_q, by_v, mass]), known)[2] * (known[:, None] == 0) * (known == 0)
        reduced = np.linalg.pinv(J @ inverse @ J.T, rcond=1e-10)
        right = [-by[0], -by[1], np.zeros((3, n))]
        expected.append([x + inverse @ J.T @ (reduced @ (b - J @ x)) for x, b in zip(tree, right, strict=True)])
        blocks.append(np.concatenate(packed))
    alone, together, D = np.array(given), np.array(given), np.array(blocks)
    tables = [
        integers(x) for x in ((0, 3), rows, (3, 3), (*columns[0], *columns[1]), place, (0, 0, 3), (3, 3, 3), kind)
    ]
    first, count, width, moved_, places, start, widths, kinds = tables
    share = 1e-13 if redundant else 0.0
    c = FFI.new(
        "eom_constraint_rows *",
        [2, first, count, width, moved_, 3, places, start, widths, kinds, 2, 2, share, share],
    )
    pointer = integers(known) if prescribed else FFI.NULL
    for state, own in zip(alone, D, strict=True):
        assert library.closed(n, integers(parents), pointer, c, numbers(own), numbers(state)) == 0
    size = D.shape[1]
    assert library.closed_in_lanes(n, integers(parents), pointer, c, size, numbers(D), numbers(together)) == 0
    assert np.array_equal(alone, together)
    assert np.allclose(alone, expected, rtol=1e-7, atol=1e-8)
