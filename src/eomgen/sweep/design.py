"""Numbers of a sweep's samples: each from its index alone, so that no order of work changes them.

A counter-based generator (Philox) is set to the draw's index; its key is made of the seed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from .plan import Distribution

LEAST, MOST = 2.0**-54, 1.0 - 2.0**-53  # bounds of uniform numbers: normal ones stay finite
_DRAWS, _STRATA = 0, 1  # streams of the generator
_NORMAL = NormalDist()


class Design:
    """Design of experiments of a plan: at every point of the product of the grids the same ``draws`` of random numbers.

    Sample i is draw i % draws at point i // draws; of the grids the last one changes fastest.

    Args:
        distributions: one for each of d numbers.
        draws, seed, design: as a plan has them.
    """

    def __init__(self, distributions: Sequence[Distribution], draws: int, seed: int, design: str) -> None:
        self.distributions, self._draws = tuple(distributions), draws
        self._key = np.random.SeedSequence(seed).generate_state(2, np.uint64)
        self._random = [j for j, item in enumerate(self.distributions) if item.kind != "grid"]
        self._points = math.prod(len(item.values) for item in self.distributions if item.kind == "grid")
        self._strata: list[NDArray[np.int64]] = []
        if design == "latin_hypercube":
            self._strata = [self._generator(_STRATA, j).permutation(draws) for j in range(len(self._random))]

    def __len__(self) -> int:
        return self._points * self._draws

    def values(self, index: int) -> tuple[float, ...]:
        """Return the d numbers of a sample."""
        point, draw = divmod(index, self._draws)
        numbers = [0.0] * len(self.distributions)
        for j in reversed([j for j, item in enumerate(self.distributions) if item.kind == "grid"]):
            grid = self.distributions[j].values
            point, place = divmod(point, len(grid))
            numbers[j] = grid[place]
        for j, u in zip(self._random, self.uniforms(draw), strict=True):
            numbers[j] = quantile(self.distributions[j], u)
        return tuple(numbers)

    def uniforms(self, draw: int) -> list[float]:
        """Return numbers between 0 and 1, one for each distribution that is no grid."""
        uniforms = self._generator(_DRAWS, draw).random(len(self._random))
        if self._strata:
            uniforms = (np.array([strata[draw] for strata in self._strata]) + uniforms) / self._draws
        clipped: list[float] = np.clip(uniforms, LEAST, MOST).tolist()
        return clipped

    def _generator(self, stream: int, counter: int) -> np.random.Generator:
        return np.random.Generator(np.random.Philox(key=self._key, counter=[0, 0, counter, stream]))


def quantile(distribution: Distribution, u: float) -> float:
    """Return the quantile of a distribution at u, 0 < u < 1."""
    low, high = distribution.low, distribution.high
    if distribution.kind == "uniform":
        assert low is not None
        assert high is not None
        return min(low + (high - low) * u, high)
    mean, deviation = distribution.mean, distribution.deviation
    a = -math.inf if low is None else (low - mean) / deviation
    b = math.inf if high is None else (high - mean) / deviation
    mirrored = a + b > 0.0  # in the lower tail a share keeps its digits
    if mirrored:
        a, b, u = -b, -a, 1.0 - u
    p, q = _NORMAL.cdf(a), _NORMAL.cdf(b)
    share = min(max(p + (q - p) * u, 5e-324), MOST)
    z = min(max(_NORMAL.inv_cdf(share), a), b)
    value = mean + deviation * (-z if mirrored else z)
    return min(max(value, -math.inf if low is None else low), math.inf if high is None else high)
