"""Periodic motions that begin and end at rest: finite Fourier series (J. Swevers et al. 1997)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...shown import Shown


@dataclass(frozen=True, eq=False)  # arrays have no one truth
class FourierSeries(Shown):
    """q = offset + sum over k = 1 .. N of sines_k sin(k w t) + cosines_k cos(k w t), w = 2 pi / duration.

    Before 0 and after ``duration`` the motion rests where it begins.

    Attributes:
        names: of the coordinates, m.
        duration: of the period, s.
        offset: (m,), m or rad.
        sines, cosines: (m, N), m or rad.
    """

    names: tuple[str, ...]
    duration: float
    offset: Array
    sines: Array
    cosines: Array

    @property
    def harmonics(self) -> int:
        """Their number N."""
        return int(self.sines.shape[1])

    @property
    def start(self) -> Array:
        """Coordinates at the beginning and at the end, (m,)."""
        return np.asarray(self.offset + self.cosines.sum(axis=1))

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times t; each of shape (*t.shape, m)."""
        times = np.asarray(t, dtype=np.float64)
        inside = ((times >= 0.0) & (times <= self.duration))[..., np.newaxis]
        coefficients = np.concatenate([self.offset[:, np.newaxis], self.sines, self.cosines], axis=1)
        rows = waves(np.clip(times, 0.0, self.duration), self.duration, self.harmonics)
        q, v, a = rows @ coefficients.T
        return q, np.where(inside, v, 0.0), np.where(inside, a, 0.0)


def waves(t: Array, duration: float, harmonics: int) -> Array:
    """Return offset, sines and cosines at times t with their first and second derivatives, (3, *t.shape, 2 N + 1)."""
    rates = 2.0 * np.pi / duration * np.arange(1, harmonics + 1)
    angles = rates * t[..., np.newaxis]
    s, c, one = np.sin(angles), np.cos(angles), np.ones((*t.shape, 1))
    return np.stack(
        [
            np.concatenate([one, s, c], axis=-1),
            np.concatenate([0.0 * one, rates * c, -rates * s], axis=-1),
            np.concatenate([0.0 * one, -(rates**2) * s, -(rates**2) * c], axis=-1),
        ]
    )


def at_rest(harmonics: int) -> Array:
    """Return coefficients (2 N + 1, 2 N - 1) whose combinations have no rate and no acceleration at t = 0.

    Rates there are the sum of k sines_k, accelerations that of k^2 cosines_k: one sine and one cosine follow from the
    others.  Columns are orthonormal in coefficients times k, so that no harmonic moves faster than the others.
    """
    k = np.arange(1.0, harmonics + 1)
    basis = np.zeros((2 * harmonics + 1, 2 * harmonics - 1))
    basis[0, 0] = 1.0
    basis[1 : harmonics + 1, 1:harmonics] = _across(np.ones(harmonics)) / k[:, np.newaxis]
    basis[harmonics + 1 :, harmonics:] = _across(k) / k[:, np.newaxis]
    return basis


def _across(row: Array) -> Array:
    """Return orthonormal columns, (N, N - 1), on which a row vanishes."""
    return np.asarray(np.linalg.qr(row[:, np.newaxis], mode="complete")[0][:, 1:])
