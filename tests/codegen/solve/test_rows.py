"""The sparse system of rows against dense linear algebra."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from eomgen.codegen.solve.rows import PRECISIONS, Response, Row, RowSystem, elastic_row, elimination_order
from tests.support.random_robots import Array

EXACT = PRECISIONS["float64"]


def random_rows(rng: np.random.Generator, m: int, n: int, density: float) -> Array:
    return np.where(rng.random((m, n)) < density, rng.normal(size=(m, n)), 0.0)


def responses(J: Array, pivots: Array) -> list[Response]:
    """Those of a tree whose mass matrix is diagonal."""
    found = []
    for row in J:
        response = Response()
        for i, x in enumerate(row.tolist()):
            response.put(i, x, x / float(pivots[i]))
        found.append(response)
    return found


def rows_of(J: Array) -> list[Row]:
    return [Row({i: x for i, x in enumerate(row.tolist()) if x}, group="all") for row in J]


@pytest.mark.parametrize("seed", range(6))
def test_multipliers_solve_the_normal_equations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J, pivots, right = random_rows(rng, 7, 16, 0.4), rng.uniform(0.5, 2.0, 16), rng.normal(size=7)
    system = RowSystem(rows_of(J), responses(J, pivots), EXACT)
    found = system.multipliers(lambda r: float(right[r]))
    assert np.allclose(J @ np.diag(1.0 / pivots) @ J.T @ found, right, rtol=1e-11, atol=1e-11)


def test_redundant_rows_have_the_accelerations_of_the_others() -> None:
    """Rows that follow from others, and a row without arms, change no acceleration; multipliers stay finite."""
    rng = np.random.default_rng(3)
    J, pivots = random_rows(rng, 4, 9, 0.7), rng.uniform(0.5, 2.0, 9)
    a = rng.normal(size=9)
    twice = np.vstack([J, J[0] + J[1], 2.0 * J[3], np.zeros(9)])
    system = RowSystem(rows_of(twice), responses(twice, pivots), EXACT)
    found = np.array(system.multipliers(lambda r: float(twice[r] @ a)))
    lone = RowSystem(rows_of(J), responses(J, pivots), EXACT).multipliers(lambda r: float(J[r] @ a))
    assert np.allclose(twice.T @ found, J.T @ lone, rtol=1e-12, atol=1e-12)
    assert found[-1] == 0.0
    assert np.abs(found).max() < 100.0 * np.abs(lone).max()


@pytest.mark.parametrize("seed", range(4))
def test_elastic_rows_with_accelerations_that_stay_unknown(seed: int) -> None:
    """Many rows that end at one body: the system with its accelerations in it has the same solution."""
    rng = np.random.default_rng(seed)
    legs, each, hub = 8, 5, 3
    n = hub + legs * each
    J = np.zeros((legs * each, n))
    for leg in range(legs):
        own = slice(leg * each, (leg + 1) * each)
        J[own, :hub] = rng.normal(size=(each, hub))
        J[own, hub + leg * each : hub + (leg + 1) * each] = rng.normal(size=(each, each))
    A = rng.normal(size=(hub, hub))
    M = np.diag(rng.uniform(0.5, 2.0, n))
    M[:hub, :hub] = A @ A.T + np.eye(hub)
    rows = [elastic_row(dict(enumerate(row.tolist())), 1.0) for row in J]
    found_responses = []
    for row in J:
        response = Response()
        for i, (left, free) in enumerate(zip(row.tolist(), np.linalg.solve(M, row).tolist(), strict=True)):
            response.put(i, left, free)
        found_responses.append(response)
    block = {(i, j): float(M[i, j]) for i in range(hub) for j in range(i, hub)}
    right = rng.normal(size=len(J))
    wanted = np.linalg.solve(np.eye(len(J)) + J @ np.linalg.solve(M, J.T), right)
    for pivots, size in (([], len(J)), ([block], len(J) + hub)):
        system = RowSystem(rows, found_responses, EXACT, pivots)
        assert len(system.unknowns) == size
        assert np.allclose(system.multipliers(lambda r: float(right[r])), wanted, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_elastic_rows_of_any_slope(seed: int) -> None:
    """Slack ones, soft and stiff ones, some that follow from others; against the dense system with 50 digits."""
    rng, n = np.random.default_rng(seed), 6
    J = random_rows(rng, 7, n, 0.7)
    J[4], J[5] = J[0], 2.0 * J[1] - J[2]
    slopes = np.where(rng.random(7) < 0.7, 10.0 ** rng.uniform(-6.0, 8.0, 7), 0.0)
    pivots, a = rng.uniform(0.5, 2.0, n), rng.normal(size=n)
    rows = [
        elastic_row({i: x for i, x in enumerate(r) if x}, s) for r, s in zip(J.tolist(), slopes.tolist(), strict=True)
    ]
    found = np.array(RowSystem(rows, responses(J, pivots), EXACT).multipliers(lambda r: -float(J[r] @ a)))
    with mpmath.workdps(50):
        exact = mpmath.matrix(J)
        M = mpmath.diag(pivots.tolist())
        wanted = mpmath.lu_solve(M + exact.T * mpmath.diag(slopes.tolist()) * exact, M * mpmath.matrix(a))
    assert np.allclose(a + J.T @ found / pivots, np.array(wanted, dtype=float).ravel(), rtol=0.0, atol=1e-11)
    assert (found[slopes == 0.0] == 0.0).all()


@pytest.mark.parametrize("seed", range(4))
def test_elastic_rows_beside_rigid_ones(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 9
    J, pivots, a = random_rows(rng, 6, n, 0.7), rng.uniform(0.5, 2.0, n), rng.normal(size=n)
    slopes = np.array([0.0, 1e-3, 10.0, 1e4])
    rigid, right = rows_of(J[:2]), rng.normal(size=2)
    elastic = [
        elastic_row({i: x for i, x in enumerate(r) if x}, s) for r, s in zip(J[2:].tolist(), slopes, strict=True)
    ]
    goal = np.concatenate([right, np.zeros(4)]) - J @ a
    found = np.array(RowSystem([*rigid, *elastic], responses(J, pivots), EXACT).multipliers(lambda r: float(goal[r])))
    stiff = np.diag(pivots) + J[2:].T @ np.diag(slopes) @ J[2:]
    whole = np.block([[stiff, -J[:2].T], [J[:2], np.zeros((2, 2))]])
    wanted = np.linalg.solve(whole, np.concatenate([pivots * a, right]))[:n]
    assert np.allclose(a + J.T @ found / pivots, wanted, rtol=1e-10, atol=1e-10)


def test_the_order_leaves_a_chain_without_fill() -> None:
    """Of a star, the middle comes last; of a chain, every row couples one other at most when it is eliminated."""
    star = {(0, i): 1.0 for i in range(1, 8)}
    assert elimination_order(range(8), star)[-1] in (0, 7)
    chain = {(i, i + 1): 1.0 for i in range(20)}
    J = [Row({0: 1.0})] * 21
    assert len(J) == 21
    order = elimination_order(range(21), chain)
    left = set(order)
    for r in order:
        left.discard(r)
        assert sum((min(r, s), max(r, s)) in chain for s in left) <= 1
