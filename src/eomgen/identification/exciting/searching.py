"""Motions within limits: random ones, and from them better ones, by gradients.

limits -> barrier, criterion -> BFGS; what still leaves the limits between samples goes on with nearer ones
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Array, Index
from ..estimating import SOLVED
from .allowed import Limits
from .constraints import Course, Held, barrier, beyond
from .descending import descended
from .fourier import FourierSeries, at_rest, waves
from .resting import standing
from .weighted_columns import WeightedColumns, information, smooth_criterion

SAMPLES = 24  # of a period of the highest harmonic, on which motions are optimised
CHECKED = 200  # of it, between which limits are checked
SHRINKING, SHRUNK = 0.8, 40  # a random motion becomes so much smaller, so often
FULL = 0.98  # of what limits leave: a random motion's size at first
WEIGHTS = (1e-2, 1e-3, 1e-4)  # of the barrier, one behind the other
STEPS = 200  # of the search for each, at most
ROUNDS = 6  # with nearer limits, where the motion leaves them
SPARE = 1e-5  # of a limit's width: so much nearer they become, beside what the motion leaves them by


@dataclass(frozen=True, eq=False)
class Search:
    """Fourier series within limits.

    Attributes:
        limits: of the m coordinates that move.
        duration: of the period, s.
        harmonics: their number.
        held: what limits hold.
        n: number of all coordinates; those that do not move are 0.
        index: numbers of those that move, (m,).
    """

    limits: Limits
    duration: float
    harmonics: int
    held: tuple[Held, ...]
    n: int
    index: Index

    @cached_property
    def combined(self) -> Array:
        """Coefficients of series that begin and end at rest, (2 N + 1, 2 N - 1)."""
        return at_rest(self.harmonics)

    @cached_property
    def coarse(self) -> Array:
        """Series at the times of the search, with derivatives, (3, T, 2 N - 1)."""
        return self._at(SAMPLES * self.harmonics)

    @cached_property
    def fine(self) -> Array:
        """Series at the times of checks, with derivatives, (3, T, 2 N - 1)."""
        return self._at(CHECKED * self.harmonics)

    def _at(self, samples: int) -> Array:
        t = np.asarray(np.arange(samples) * (self.duration / samples), dtype=np.float64)
        return np.asarray(waves(t, self.duration, self.harmonics) @ self.combined)

    def course(self, rows: Array, x: Array) -> Course:
        """Return the motion with these numbers, (m, 2 N - 1), at the times of rows; all coordinates, (T, n) each."""
        whole = np.zeros((3, rows.shape[1], self.n))
        whole[:, :, self.index] = rows @ x.T
        return whole[0], whole[1], whole[2]

    def series(self, x: Array) -> FourierSeries:
        """Return the motion with these numbers."""
        coefficients = x @ self.combined.T
        first = self.harmonics + 1
        return FourierSeries(
            self.limits.names, self.duration, coefficients[:, 0], coefficients[:, 1:first], coefficients[:, first:]
        )

    def admits(self, x: Array) -> bool:
        """Return whether a motion stays within all limits."""
        course = self.course(self.fine, x)
        return all((beyond(held, course) <= 0.0).all() for held in self.held)

    def random(self, rng: np.random.Generator, poses: Array) -> Array | None:
        """Return numbers of a random motion about one of these poses that fills what limits leave.

        None if all is too much.
        """
        x = np.zeros((len(self.index), self.combined.shape[1]))
        x[:, 0] = poses[rng.integers(len(poses))]
        x[:, 1:] = rng.standard_normal(x[:, 1:].shape)
        moved = np.abs(self.fine @ np.where(np.arange(x.shape[1]) > 0, x, 0.0).T).max(axis=1)
        room = np.minimum(self.limits.high - x[:, 0], x[:, 0] - self.limits.low)
        share = np.minimum.reduce([room / moved[0], self.limits.rates / moved[1], self.limits.accelerations / moved[2]])
        x[:, 1:] *= FULL * share[:, np.newaxis]
        for _ in range(SHRUNK):
            if self.admits(x):
                return x
            x[:, 1:] *= SHRINKING
        return None

    def poses(self, rng: np.random.Generator) -> Array:
        """Return random poses in which the robot may stand, (P, m); errors as ``standing``."""
        return standing(self.limits, self.held, self.n, self.index, rng)


def improved(search: Search, weighted: WeightedColumns, kind: str, x: Array) -> tuple[Array, str]:
    """Return numbers of a motion within limits about a local minimum of a criterion, and the status of the search.

    Args:
        search: the series and their limits.
        weighted: columns of base parameters along motions.
        kind: of CRITERIA.
        x: numbers of a motion within limits, (m, 2 N - 1), near which it is looked for.
    """
    scale, better = _scale(search), x
    narrowed = [np.zeros(len(held.names)) for held in search.held]
    for weight in (*WEIGHTS, *WEIGHTS[-1:] * ROUNDS):

        def value(z: Array, weight: float = weight, less: Sequence[Array] = narrowed) -> tuple[float, Array]:
            total, gradient = objective(search, weighted, kind, weight, less, z.reshape(x.shape) * scale)
            return total, (gradient * scale).ravel()

        z, ended = descended(value, (better / scale).ravel(), STEPS)
        better = z.reshape(x.shape) * scale
        if weight == WEIGHTS[-1]:
            course = search.course(search.fine, better)
            left = [beyond(held, course) for held in search.held]
            if all((room <= 0.0).all() for room in left):
                return better, SOLVED if ended else f"{STEPS} steps do not reach the least value of the criterion"
            narrowed = [
                less + np.where(room > 0.0, room + SPARE, 0.0) for less, room in zip(narrowed, left, strict=True)
            ]
    return _between(search, x, better), "the best motion leaves its limits between samples, and one on the way is taken"


def objective(
    search: Search, weighted: WeightedColumns, kind: str, weight: float, narrowed: Sequence[Array], x: Array
) -> tuple[float, Array]:
    """Return criterion and weighted barrier of the motion with numbers x, and the gradient by them, (m, 2 N - 1)."""
    course = search.course(search.coarse, x)
    W = weighted.columns(course, smooth=True)
    total, slope = smooth_criterion(kind, information(W))
    gradient = weighted.gradient(course, 2.0 * (W @ slope))
    hindered, back = barrier(search.held, course, narrowed)
    both = np.stack([a + weight * b for a, b in zip(gradient, back, strict=True)])[:, :, search.index]
    return total + weight * hindered, np.asarray(np.einsum("stm,stp->mp", both, search.coarse))


def _scale(search: Search) -> Array:
    """Return sizes of the numbers of motions, (m, 2 N - 1): half a range, and what the rates allow the harmonics."""
    half = (search.limits.high - search.limits.low) / 2.0
    moving = np.minimum(half, search.limits.rates * search.duration / (2.0 * np.pi * np.sqrt(search.harmonics)))
    scale = np.repeat(moving[:, np.newaxis], search.combined.shape[1], axis=1)
    scale[:, 0] = half
    return scale


def _between(search: Search, admitted: Array, wanted: Array) -> Array:
    """Return the motion between one within limits and one that is not, as far on as it stays within them."""
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2.0
        low, high = (middle, high) if search.admits(admitted + middle * (wanted - admitted)) else (low, middle)
    return np.asarray(admitted + low * (wanted - admitted))
