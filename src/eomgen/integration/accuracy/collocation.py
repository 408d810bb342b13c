"""Radau IIA collocation of many short spans at once: the reference that local errors are measured by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from ...arrays import Array, Index

Accelerations = Callable[[Array, Array, Array], Array]  # times, (N,), y and y', (N, f) each -> y'', (N, f)

STAGES = 5  # order 9: of the integrators DOP853 comes nearest, with order 8 over longer spans
ROUNDS = 10  # of Newton's method
CONVERGED = 1e-3  # of a local error: what the last round may still change
LOST = 1e3  # round-offs that a state may be left open by
ROUND_OFF = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Radau:
    """Radau IIA method of s stages (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.5).

    Attributes:
        c: nodes in (0, 1], (s,).
        a: coefficients, (s, s); the last row has the weights.
        squared: a @ a, (s, s), by which y follows from y''.
        values: eigenvalues of a, of two conjugate ones the first alone, (k,).
        to, back: from stages to eigenvectors, (k, s), and back, (s, k), with twice the first of two conjugate ones.
    """

    c: Array
    a: Array
    squared: Array
    values: Array
    to: Array
    back: Array


def radau(stages: int) -> Radau:
    """Return the Radau IIA method of so many stages."""
    x = Polynomial([0.0, 1.0])
    c = np.sort((x ** (stages - 1) * (x - 1.0) ** stages).deriv(stages - 1).roots().real)
    c[-1] = 1.0
    powers = np.arange(1, stages + 1)
    a = (c[:, np.newaxis] ** powers / powers) @ np.linalg.inv(c[:, np.newaxis] ** (powers - 1))
    values, vectors = np.linalg.eig(a)
    kept = values.imag >= 0.0
    share = np.where(values.imag[kept] > 0.0, 2.0, 1.0)
    return Radau(c, a, a @ a, values[kept], np.linalg.inv(vectors)[kept], vectors[:, kept] * share)


METHOD = radau(STAGES)


@dataclass(frozen=True, eq=False)
class LinearSpans:
    """Linearised equations y'' = by_y y + by_rate y' of K spans, with what solves the stages of each.

    Attributes:
        h: lengths, s, (K,).
        by_y, by_rate: derivatives of accelerations, (K, f, f).
        inverse: of 1 - mu by_rate - mu^2 by_y, with mu = h times an eigenvalue of the method, (k, K, f, f).
    """

    h: Array
    by_y: Array
    by_rate: Array
    inverse: Any

    @classmethod
    def of(cls, h: Array, by_y: Array, by_rate: Array) -> LinearSpans:
        """Invert the matrices of the stages."""
        mu = _mu(h)
        inverse = np.linalg.inv(np.eye(by_y.shape[-1], dtype=np.complex128) - mu * by_rate - mu**2 * by_y)
        return cls(h, by_y, by_rate, np.asarray(inverse))

    def solve(self, rows: Index, residuals: Array) -> Array:
        """Return Newton's change of the stages' accelerations of some spans, (R, s, f), for their residuals."""
        inner = METHOD.to @ residuals  # (R, k, f)
        solved = (self.inverse[:, rows] @ np.swapaxes(inner, 0, 1)[..., np.newaxis])[..., 0]
        return np.asarray((METHOD.back @ np.swapaxes(solved, 0, 1)).real)

    def propagators(self) -> Array:
        """Return the linear maps of (y, y') over each span, (K, 2f, 2f): the method's stability function."""
        f, h, mu = self.by_y.shape[-1], self.h[:, np.newaxis, np.newaxis], _mu(self.h)
        weight = (METHOD.back[-1] * METHOD.to.sum(axis=1))[:, np.newaxis, np.newaxis, np.newaxis] * mu
        from_y, from_rate = self.inverse @ self.by_y, self.inverse @ (self.by_rate + mu * self.by_y)
        whole = np.zeros((self.h.size, 2 * f, 2 * f))
        whole[:, :f, :f] = np.eye(f) + (weight * mu * from_y).sum(axis=0).real
        whole[:, :f, f:] = h * np.eye(f) + (weight * mu * from_rate).sum(axis=0).real
        whole[:, f:, :f] = (weight * from_y).sum(axis=0).real
        whole[:, f:, f:] = np.eye(f) + (weight * from_rate).sum(axis=0).real
        return whole


def _mu(h: Array) -> Array:
    return np.asarray(METHOD.values[:, np.newaxis, np.newaxis, np.newaxis] * h[:, np.newaxis, np.newaxis])


@dataclass(frozen=True, eq=False)
class Solved:
    """Ends of spans.

    Attributes:
        y, rate: there, (K, f) each.
        stages: accelerations at the nodes, (K, s, f).
        is_good: which of them Newton's method has solved, (K,).
    """

    y: Array
    rate: Array
    stages: Array
    is_good: Array


def collocate(
    accelerations: Accelerations,
    begin: tuple[Array, Array, Array],
    linear: LinearSpans,
    guess: Array,
    errors: tuple[Array, Array],
    target: tuple[Array, Array] | None = None,
) -> Solved:
    """Solve y'' = f(t, y, y') over spans by Newton's method with constant derivatives.

    Args:
        accelerations: f.
        begin: times, s, (K,), y and y', (K, f) each.
        linear: the linearised equations.
        guess: accelerations at the nodes, (K, s, f).
        errors: sizes of the local errors of y and of y', (K,) each, to a fraction of which spans are solved.
        target: y and y' at the ends, (K, f) each, whose distances are the local errors, instead of ``errors``.
    """
    t, y, rate = begin
    stages, h, f = guess.copy(), linear.h[:, np.newaxis], y.shape[1]
    times, is_good, left = t[:, np.newaxis] + h * METHOD.c, np.zeros(t.size, dtype=bool), np.arange(t.size)
    end_y, end_rate = y.copy(), rate.copy()
    for _ in range(ROUNDS):
        a, span = stages[left], h[left, np.newaxis]
        at_rate = rate[left, np.newaxis] + span * (METHOD.a @ a)
        at_y = y[left, np.newaxis] + span * METHOD.c[:, np.newaxis] * rate[left, np.newaxis]
        at_y += span**2 * (METHOD.squared @ a)
        found = accelerations(times[left].ravel(), at_y.reshape(-1, f), at_rate.reshape(-1, f)).reshape(a.shape)
        stages[left] = a + linear.solve(left, found - a)
        before = end_y[left], end_rate[left]
        end_rate[left] = rate[left] + h[left] * (METHOD.a[-1] @ stages[left])
        end_y[left] = y[left] + h[left] * rate[left] + h[left] ** 2 * (METHOD.squared[-1] @ stages[left])
        moved = [np.linalg.norm(x[left] - old, axis=1) for x, old in zip((end_y, end_rate), before, strict=True)]
        if target is not None:
            sizes = [
                np.linalg.norm(x[left] - end[left], axis=1) for x, end in zip(target, (end_y, end_rate), strict=True)
            ]
        else:
            sizes = [x[left] for x in errors]
        floors = [ROUND_OFF * np.linalg.norm(x[left], axis=1) for x in (y, rate)]
        checks = list(zip(moved, sizes, floors, strict=True))
        is_good[left] = np.logical_and.reduce([m <= size + LOST * floor for m, size, floor in checks])
        left = left[~np.logical_and.reduce([m <= CONVERGED * size + 4.0 * floor for m, size, floor in checks])]
        if not left.size:
            break
    return Solved(end_y, end_rate, stages, is_good)
