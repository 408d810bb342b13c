"""The library's vectors of states, and derivatives of accelerations by them, against NumPy."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.codegen.package.compile import FLAGS, WARNINGS
from tests.support.processors import skip_without

LIBRARY = Path(eomgen.__path__[0], "clib")
SOURCE = Path(__file__).with_name("lanes.c")
WIDTHS = [("-DEOM_VECTOR_BYTES=0",), (), ("-mavx2",), ("-mavx512f",), ("-DEOM_VECTOR_BYTES=64", "-Wno-psabi")]
LEFT = -77.0  # what nobody has written
Array = NDArray[Any]


@dataclass(frozen=True)
class Lanes:
    """Functions of ``lanes.c``, compiled for vectors of some width, and the dtype of their numbers."""

    ffi: cffi.FFI
    lib: Any
    dtype: str

    @property
    def width(self) -> int:
        """Return how many states a vector holds."""
        return int(self.lib.width())

    def pointer(self, array: Array) -> Any:
        real = "float" if self.dtype == "float32" else "double"
        return self.ffi.from_buffer(f"{real}[]", array)

    def pass_on(self, x: Array, y: Array, size: int) -> None:
        """Move states of ``size`` numbers from the rows of x into those of y."""
        count, (x_step, y_step) = len(x), (x.shape[1], y.shape[1])
        self.lib.pass_on(count, self.pointer(x), x_step, size, self.ffi.NULL, size, self.pointer(y), y_step)


DECLARED = """
int width(void);
void pass_on(size_t count, const REAL *x, size_t x_step, int read, const unsigned short *place, int written, REAL *y,
    size_t y_step);
void whole(REAL x, REAL *y);
void by_numbers(size_t count, const REAL *x, REAL *y);
void by_vectors(size_t count, const REAL *x, REAL *y);
int vanished(int n, const REAL *pivot);
int vanished_in_lanes(int n, int statuses, const REAL *pivots);
"""


LANES = [(flags, dtype) for flags in WIDTHS for dtype in ("float64", "float32")]


@pytest.fixture(
    scope="module",
    params=[lanes if i % 3 == 0 else pytest.param(lanes, marks=pytest.mark.soak) for i, lanes in enumerate(LANES)],
    ids=str,
)
def lanes(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Lanes:
    flags, dtype = request.param
    skip_without(flags)
    library = tmp_path_factory.mktemp("lanes") / "lanes.so"
    single = ("-DEOM_SINGLE",) if dtype == "float32" else ()
    command = ["cc", *WARNINGS, "-Werror", "-shared", "-fPIC", *FLAGS, *flags, *single, f"-I{LIBRARY}"]
    subprocess.run([*command, str(SOURCE), "-o", str(library), "-lm"], check=True)
    ffi = cffi.FFI()
    ffi.cdef(DECLARED.replace("REAL", "float" if dtype == "float32" else "double"))
    return Lanes(ffi, ffi.dlopen(str(library)), dtype)


def test_states_come_out_as_they_went_in(lanes: Lanes) -> None:
    """Of all counts up to three vectors and all sizes around them, whatever lies between the states."""
    rng = np.random.default_rng(0)
    for count in range(1, 3 * lanes.width + 1):
        for size in sorted({1, 2, 3, lanes.width - 1, lanes.width, lanes.width + 1, 2 * lanes.width + 3} - {0}):
            for apart in (0, 1, 5):
                x = rng.standard_normal((count, size + apart)).astype(lanes.dtype)
                y = np.full((count, size + apart + 1), LEFT, lanes.dtype)
                lanes.pass_on(x, y, size)
                assert np.array_equal(y[:, :size], x[:, :size]), (count, size, apart)
                assert (y[:, size:] == LEFT).all(), (count, size, apart)


def test_more_states_than_memory_is_asked_for(lanes: Lanes) -> None:
    x = np.random.default_rng(1).standard_normal((200, 17)).astype(lanes.dtype)
    y = np.full_like(x, LEFT)
    lanes.pass_on(x, y, 17)
    assert np.array_equal(x, y)


def test_results_that_repeat_are_written_from_their_places(lanes: Lanes) -> None:
    rng = np.random.default_rng(2)
    for count in range(1, 3 * lanes.width + 1):
        for written in (1, lanes.width, 40):
            place = rng.integers(0, 5, written).astype(np.uint16)
            x = rng.standard_normal((count, 5)).astype(lanes.dtype)
            for behind in range(lanes.width):  # the last whole vector of memory
                whole = np.full(count * written + behind + 1, LEFT, lanes.dtype)
                y = whole[behind:-1].reshape(count, written)
                sizes = (5, 5, lanes.ffi.from_buffer("unsigned short[]", place), written)
                target = lanes.pointer(whole) + behind
                lanes.lib.pass_on(count, lanes.pointer(x), *sizes, target, written)
                assert np.array_equal(y, x[:, place]), (count, written, behind)
                assert (np.delete(whole, slice(behind, behind + y.size)) == LEFT).all()


def test_one_state_for_all(lanes: Lanes) -> None:
    """States no numbers apart are one and the same."""
    x = np.arange(9.0).astype(lanes.dtype)
    y = np.zeros((2 * lanes.width + 1, 9), lanes.dtype)
    lanes.lib.pass_on(len(y), lanes.pointer(x), 0, 9, lanes.ffi.NULL, 9, lanes.pointer(y), 9)
    assert (y == x).all()


def test_bits_are_moved_and_not_computed(lanes: Lanes) -> None:
    """NaN, infinity, denormal numbers and the sign of zero."""
    tiny = np.finfo(lanes.dtype).smallest_subnormal
    x = np.resize(np.array([np.nan, np.inf, -np.inf, -0.0, tiny, -tiny], lanes.dtype), (3 * lanes.width, 7)).copy()
    y = np.zeros_like(x)
    lanes.pass_on(x, y, 7)
    assert x.tobytes() == y.tobytes()


def test_a_number_in_all_lanes(lanes: Lanes) -> None:
    for number in (0.25, -0.0, np.inf, np.nan, float(np.finfo(lanes.dtype).smallest_subnormal)):
        found = np.full(lanes.width, LEFT, lanes.dtype)
        lanes.lib.whole(number, lanes.pointer(found))
        assert found.tobytes() == np.full(lanes.width, number, lanes.dtype).tobytes() or np.isnan(number)
        assert np.array_equal(found, np.full(lanes.width, number, lanes.dtype), equal_nan=True)


def test_lanes_compute_what_numbers_do(lanes: Lanes) -> None:
    """Every function, of pairs among which are NaN, infinity, equal and denormal numbers and zeros of both signs."""
    tiny = float(np.finfo(lanes.dtype).smallest_subnormal)
    numbers = [0.0, -0.0, 1.5, -2.5, tiny, -tiny, np.inf, -np.inf, np.nan, 3.0]
    x = np.array([(a, b) for a in numbers for b in numbers], lanes.dtype)
    found = np.zeros((2, len(x), 6), lanes.dtype)
    for function, result in zip((lanes.lib.by_numbers, lanes.lib.by_vectors), found, strict=True):
        function(len(x), lanes.pointer(x), lanes.pointer(result))
    numbers_, vectors = (np.where(np.isnan(result), np.nan, result) for result in found)
    assert numbers_.tobytes() == vectors.tobytes()
    a, b = x.T
    with np.errstate(all="ignore"):
        expected = [np.where(a < b, b, a), np.where(a > 0, 1, 0), np.where(a > 0, b, -7.0), np.sqrt(b)]
    assert np.array_equal(numbers_[:, :4], np.transpose(expected).astype(lanes.dtype), equal_nan=True)
    with np.errstate(all="ignore"):
        assert np.allclose(numbers_[:, 4:], np.transpose([np.arctan2(a, b), np.exp(a)]), rtol=1e-6, equal_nan=True)


def test_the_first_pivot_that_vanishes_is_named(lanes: Lanes) -> None:
    """Beside its scale, and NaN as well; of the first lane that has one."""
    limit = 1e-12 if lanes.dtype == "float64" else 1e-5
    good = np.tile(np.array([[2.0, 3.0], [1.0, 1.0], [4.0 * limit, 2.0]], lanes.dtype), (lanes.width, 1, 1)).copy()
    assert lanes.lib.vanished(3, lanes.pointer(good)) == 0
    assert lanes.lib.vanished_in_lanes(3, 10, lanes.pointer(good)) == 0
    for bad in (0.0, -1.0, 0.5 * limit, np.nan):
        for lane in range(lanes.width):
            for i in range(3):
                pivots = good.copy()
                pivots[lane, i:] = (bad, 1.0)
                pivots[lane + 1 :, 0] = (bad, 1.0)
                assert lanes.lib.vanished(3, lanes.pointer(pivots[lane])) == 1 + i
                assert lanes.lib.vanished_in_lanes(3, 10, lanes.pointer(pivots)) == 1 + i + 10 * lane


DERIVATIVES = Path(__file__).with_name("derivatives.c")
OF_TREES = """
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
FFI = cffi.FFI()
FFI.cdef(OF_TREES)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    made = tmp_path_factory.mktemp("derivatives") / "derivatives.so"
    command = ["cc", *WARNINGS, "-Werror", "-shared", "-fPIC", *FLAGS, f"-I{LIBRARY}", "-DEOM_VECTOR_BYTES=16"]
    subprocess.run([*command, str(DERIVATIVES), "-o", str(made), "-lm"], check=True)
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
