"""Bounds of errors of solutions, against what the worst allowed matrices, residuals and unknowns make of them.

Every term of the bounds is the largest one in some case, so that a bound without it would be exceeded.
"""

from __future__ import annotations

import numpy as np
import pytest

from eomgen.description.load import load_robot
from eomgen.runtime.derivatives.assemblies import assembled_errors
from eomgen.runtime.derivatives.equations_of_motion import linear_errors
from eomgen.runtime.derivatives.extended import Extended
from eomgen.runtime.derivatives.solution_errors import enclosed_inverse, matrix_of
from eomgen.runtime.raw import Array
from tests.runtime.test_closed_errors import built_closed, state_of
from tests.support.builds import Build

pytestmark = pytest.mark.quick


def extended(value: Array, bound: Array | float = 0.0) -> Extended:
    return Extended(value, np.zeros_like(value), np.broadcast_to(np.asarray(bound, float), value.shape))


def drawn(seed: int, count: int, size: int, scales: float) -> tuple[Array, Array]:
    """Draw matrices (N, m, m) whose rows and columns have sizes of many powers of ten, and solutions of unit size."""
    rng = np.random.default_rng(seed)
    rows, columns = (10.0 ** rng.uniform(-scales, scales, (count, size)) for _ in range(2))
    K = rng.normal(size=(count, size, size)) + 2.0 * np.eye(size)
    return K * rows[:, :, None] * columns[:, None, :], rng.normal(size=(count, size)) / columns


@pytest.mark.parametrize("scales", [0.0, 4.0])
@pytest.mark.parametrize(("of_matrix", "of_rest"), [(1e-3, 0.0), (0.0, 1e-6), (1e-4, 1e-4), (0.0, 0.0)])
def test_solutions_of_the_worst_equations_are_within_bounds(of_matrix: float, of_rest: float, scales: float) -> None:
    """K is known within of_matrix of its entries, what is left within of_rest of the right sides."""
    reached = 0.0
    for seed in range(20):
        rng, size = np.random.default_rng([seed, 1]), 2 + seed % 5
        K, x = drawn(seed, 8, size, scales)
        error = of_matrix * np.abs(K)
        matrix = enclosed_inverse(K, error)
        assert matrix.proved.all() or of_matrix > 0.0
        true = K + error * rng.choice([-1.0, 1.0], K.shape)
        spoilt = x * (1.0 + 1e-2 * rng.normal(size=x.shape))
        left = np.einsum("nij,nj->ni", true, spoilt - x)
        within = of_rest * np.abs(np.einsum("nij,nj->ni", np.abs(K), np.abs(x)))
        found = matrix.errors(extended(left - within * rng.choice([-1.0, 1.0], left.shape), within))
        ratio = np.abs(spoilt - x) / found.bound
        assert (ratio[found.proved] <= 1.0 + 1e-9).all()
        reached = max(reached, float(ratio[found.proved].max(initial=0.0)))
    assert reached > 0.7, "some come near their bounds"


def test_what_the_error_of_a_matrix_makes_counts() -> None:
    """With K = 1 known within e, an answer x = 1 + d of K x = b that leaves (1 - e) d may be off by d."""
    for e in (0.3, 0.9, 0.999):
        matrix = enclosed_inverse(np.ones((1, 1, 1)), np.full((1, 1, 1), e))
        found = matrix.errors(extended(np.array([[(1.0 - e) * 0.25]])))
        assert found.proved.all()
        assert 0.25 <= found.bound[0, 0] <= 0.25 * (1.0 + 1e-9)
    assert not enclosed_inverse(np.ones((1, 1, 1)), np.ones((1, 1, 1))).proved.any()


def test_singular_equations_are_not_proved() -> None:
    value = np.array([[[1.0, 2.0], [2.0, 4.0]], [[1.0, 2.0], [2.0, 4.0 + 1e-3]], [[np.nan, 0.0], [0.0, 1.0]]])
    assert enclosed_inverse(value, np.zeros_like(value)).proved.tolist() == [False, True, False]
    assert enclosed_inverse(value, np.full_like(value, 1e-3)).proved.tolist() == [False, False, False]


def test_matrices_of_affine_equations() -> None:
    K, x = drawn(0, 3, 4, 2.0)
    right = np.einsum("nij,nj->ni", K, x)
    within = 1e-9

    def equations(points: Array) -> Extended:
        return extended(np.einsum("nij,npj->npi", K, points) - right[:, None], within)

    value, error = matrix_of(equations, 3, 4, np.dtype("float64"))
    size = np.abs(K).max() + np.abs(right).max()
    assert np.abs(value - K).max() <= 4.0 * np.finfo(float).eps * size
    assert (error >= 2.0 * within).all(), "of the equations at a unit vector, and at zero"
    assert (error <= 2.0 * within * (1.0 + 1e-6) + 1e-15 * np.abs(K)).all()


def test_what_errors_of_unknowns_make_of_functions() -> None:
    """The worst signs of errors, and of errors of the functions' coefficients, reach the bound."""
    rng = np.random.default_rng(0)
    columns, zero, errors = rng.normal(size=(2, 3, 5)), rng.normal(size=(2, 1, 5)), rng.uniform(0.1, 1.0, (2, 3))
    bound = linear_errors(extended(columns, 1e-3), extended(zero, 2e-3), errors)
    worst = np.einsum("nkr,nk->nr", np.abs(columns - zero) + 3e-3, errors)
    assert (bound >= worst).all()
    assert (bound <= worst * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("off", [1e-6, 1e-10, 1e-13])
def test_states_that_are_not_quite_assembled(built: Build, off: float) -> None:
    """The distance of a state whose dependent coordinates were moved is within its bound, which is not far from it."""
    kernel = built_closed(built, robot := load_robot("four_bar"))
    q, free = state_of(kernel, robot, 3)["q"], np.array([False, True, True])
    near = assembled_errors(kernel.calls, q[None], free)
    assert near.proved.all()
    for moved in (np.array([0.0, off, 0.0]), np.array([0.0, -off, off])):
        found = assembled_errors(kernel.calls, (q + moved)[None], free)
        assert found.proved.all()
        assert found.bound[0, 0] == 0.0
        assert (found.bound[0] >= np.abs(moved) - near.bound[0] - 1e-16).all()
        assert found.bound.max() <= 1.1 * off + 2.0 * near.bound.max() + 1e-14
