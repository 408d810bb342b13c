"""Equations of motion at states, affine in what is solved for, and bounds of errors of their solutions.

Trees: M a + h = u.  Closed mechanisms: M a + h = u + J^T lambda, J a + J_dot v = 0.  Their drives: of all u that make a
motion with some lambda those with the least sum of squares, u = -mu where there is a drive, 0 elsewhere, J mu = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..calls import Calls
from ..raw import Array
from .extended import EPS, IN_EXTENDED, Extended, run_extended
from .solution_errors import Equations, Matrix, SolutionErrors, enclosed_inverse, matrix_of

CHUNK = 64  # states whose matrices are there at once
RESIDUAL, CLOSED = f"residual{IN_EXTENDED}", f"constrained_residual{IN_EXTENDED}"


@dataclass(frozen=True)
class States:
    """Arguments of a function at N states: arrays (N, size) of the kernel's dtype by their names."""

    calls: Calls
    arrays: Mapping[str, Array]

    def chunks(self) -> Sequence[tuple[slice, States]]:
        """Split the states into parts whose matrices fit in memory."""
        count = len(next(iter(self.arrays.values())))
        parts = [slice(begin, begin + CHUNK) for begin in range(0, count, CHUNK)]
        return [(part, States(self.calls, {name: x[part] for name, x in self.arrays.items()})) for part in parts]

    @property
    def count(self) -> int:
        """Number of states."""
        return len(self.arrays["q"])

    def places(self, *, prescribed: bool) -> list[int]:
        """Return places of coordinates and states of laws, those of prescribed ones among them or not."""
        return [i for i, name in enumerate(self.calls.coordinates) if prescribed or name not in self.calls.prescribed]

    def run(self, name: str, **points: Array) -> Extended:
        """Run a function in double-double arithmetic at points, (N, P, size) by name, and at the states else."""
        wide = {label: array[:, np.newaxis] for label, array in self.arrays.items()} | points
        reads = self.calls.raw.functions[name].reads
        zero = {label: np.zeros(self.calls.raw.shapes[label], self.calls.dtype) for label in reads if label not in wide}
        return run_extended(self.calls, name, [{**wide, **zero}[label] for label in reads], inner=1)


def tree_accelerations(states: States, a: Array) -> SolutionErrors:
    """Bound the errors of accelerations a, (N, n), of a tree under drives u; of prescribed ones there are none."""
    free = states.places(prescribed=False)

    def equations(points: Array) -> Extended:
        return states.run(RESIDUAL, a=_with(a, free, points)).at(..., free)

    found = solved(equations, a[:, free], states)
    bound = np.zeros(a.shape)
    bound[:, free] = found.bound
    return SolutionErrors(bound, found.proved)


def closed_accelerations(states: States, solution: Array) -> SolutionErrors:
    """Bound the errors of accelerations and multipliers of a closed mechanism under drives u, (N, n + m)."""
    n, free = states.calls.n, states.places(prescribed=False)
    m = states.calls.raw.shapes["multipliers"][0]
    a, multipliers = solution[:, :n], solution[:, n : n + m]

    def equations(points: Array) -> Extended:
        arrays = {"a": _with(a, free, points[..., : len(free)]), "multipliers": points[..., len(free) :]}
        return states.run(CLOSED, **arrays).at(..., [*free, *range(n, n + m)])

    unknowns = np.concatenate([a[:, free], multipliers], axis=1)
    rows = moved_rows(states.calls, states.arrays["q"][0], free)
    found = solved(equations, unknowns, states, [*range(len(free)), *(len(free) + r for r in rows)])
    bound = np.zeros((states.count, n + m))
    bound[:, [*free, *range(n, n + m)]] = found.bound
    return SolutionErrors(bound, found.proved)


def closed_drives(states: States, u: Array, multipliers: Array) -> SolutionErrors:
    """Bound the errors of drives and multipliers of a motion a of a closed mechanism, (N, n + m)."""
    calls = states.calls
    n, m = calls.n, calls.raw.shapes["multipliers"][0]
    meta = calls.raw.libraries.meta
    prescribed = [i for i, name in enumerate(calls.coordinates) if name in calls.prescribed]
    driven = sorted({*meta["driven"], *prescribed})
    others = [i for i in range(n) if i not in driven]

    def equations(points: Array) -> Extended:
        """M a + h - u - J^T lambda of u = -mu at drives, then J mu."""
        mu, drives = np.ascontiguousarray(points[..., :n]), np.zeros((*points.shape[:-1], n), calls.dtype)
        drives[..., driven] = -mu[..., driven]
        first = states.run(CLOSED, u=drives, multipliers=np.ascontiguousarray(points[..., n:])).at(..., slice(n))
        moved, still = (states.run(CLOSED, a=x).at(..., slice(n, None)) for x in (mu, np.zeros_like(mu)))
        second = moved - still
        return Extended(*(np.concatenate(pair, axis=-1) for pair in zip(first, second, strict=True)))

    value, error = matrix_of(equations, states.count, n + m, calls.dtype)
    mu = -np.asarray(u, np.float64)
    for state, J in enumerate(value[:, n:, :n]):  # what of mu no drive says keeps J mu = 0
        mu[state, others] = np.linalg.lstsq(J[:, others], -J[:, driven] @ mu[state, driven], rcond=None)[0]
    unknowns = np.concatenate([mu.astype(calls.dtype), multipliers], axis=1)
    rows = moved_rows(calls, states.arrays["q"][0], list(range(n)))
    left = equations(unknowns[:, np.newaxis]).at(slice(None), 0)
    found = _bounded(value, error, left, [*range(n), *(n + r for r in rows)])
    found.bound[:, others] = 0.0  # no drives, but mu
    return found


def solved(equations: Equations, solution: Array, states: States, kept: list[int] | None = None) -> SolutionErrors:
    """Bound errors of solutions of affine equations, (N, unknowns); see ``_bounded``."""
    value, error = matrix_of(equations, states.count, solution.shape[1], states.calls.dtype)
    left = equations(np.ascontiguousarray(solution[:, np.newaxis])).at(slice(None), 0)
    return _bounded(value, error, left, list(range(solution.shape[1])) if kept is None else kept)


def _bounded(value: Array, error: Array, left: Extended, kept: list[int]) -> SolutionErrors:
    """Bound errors by a matrix, (N, k, k), with its errors, and by what is left of the equations, (N, k).

    Equations and unknowns that are not ``kept`` are of constraints that no coordinate changes: their forces are 0.
    """
    matrix: Matrix = enclosed_inverse(value[:, kept][:, :, kept], error[:, kept][:, :, kept])
    found = matrix.errors(left.at(slice(None), kept))
    bound = np.zeros(left.high.shape)
    bound[:, kept] = found.bound
    return SolutionErrors(bound, found.proved)


def moved_rows(calls: Calls, q: Array, moving: list[int]) -> list[int]:
    """Return components of the constraint that some of the moving coordinates change, by J away from q, (n,)."""
    away = (np.asarray(q, np.float64) + np.linspace(0.3, 0.7, calls.n)).astype(calls.dtype)
    J = calls.run("constraint_jacobian", None, (away,))[:, moving]
    return [int(r) for r in np.flatnonzero(np.abs(J).max(axis=1, initial=0.0) > 0.0)]


def _with(whole: Array, places: list[int], points: Array) -> Array:
    """Return arrays of states, (N, n), at points, (N, P, n), with the points' numbers at places."""
    wide = np.repeat(whole[:, np.newaxis], points.shape[1], axis=1)
    wide[..., places] = points
    return wide


def in_chunks(states: States, arrays: Sequence[Array], bound: Callable[..., SolutionErrors]) -> SolutionErrors:
    """Bound errors part by part."""
    parts = [bound(part, *(x[place] for x in arrays)) for place, part in states.chunks()]
    return SolutionErrors(np.concatenate([x.bound for x in parts]), np.concatenate([x.proved for x in parts]))


def linear_errors(columns: Extended, zero: Extended, errors: Array) -> Array:
    """Bound what errors of unknowns, (N, k), make of functions that are affine in them, (N, results).

    Args:
        columns: the functions at unit vectors, (N, k, results).
        zero: at zero, (N, 1, results).
    """
    value, error = (columns - zero).rounded
    total: Array = np.einsum("nkr,nk->nr", np.abs(value) + error, errors) * (1.0 + (2 + errors.shape[1]) * EPS)
    return total
