"""States within a step: on the cubic through coordinates and rates at its ends, past angles that are singular."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..runtime.turning import BACK, ON, SINGULAR, seen
from ..state.vectors import Array


class Cubics:
    """Cubics between states as described, (2n,).

    Where the angles of a joint that turns freely are nearly singular, they turn within a step by up to half a turn: the
    cubic is one of its other angles then, and what is on it is described again.

    Args:
        joints: places of alpha and of x of such joints, as of ``RawKernel.turning``.
    """

    def __init__(self, joints: Mapping[str, tuple[int, int]]) -> None:
        self._joints = joints

    def at(self, t: float, t0: float, y0: Array, t1: float, y1: Array) -> Array:
        """The state at t, s, between two at t0 and t1."""
        turned = [places for places in self._joints.values() if _is_turned(places, y0, y1)]
        if not turned:
            return hermite(t, t0, y0, t1, y1)
        near = y0[: y0.size // 2]
        ends = seen(np.stack([y0, y1]), turned, ON, np.zeros_like(near))
        return np.asarray(seen(hermite(t, t0, ends[0], t1, ends[1])[np.newaxis], turned, BACK, near)[0])

    def among(self, t: float, times: Array, states: Array) -> Array:
        """The state at t, s, between two neighbours of states, (k, 2n), at times, (k,)."""
        k = min(max(int(np.searchsorted(times, t, side="right")) - 1, 0), times.size - 2)
        return self.at(t, float(times[k]), states[k], float(times[k + 1]), states[k + 1])


def _is_turned(places: tuple[int, int], y0: Array, y1: Array) -> bool:
    """Whether the other angles of a joint are better ones for a step between two states: farther from singular ones."""
    own, beta = np.stack([y0, y1]), places[0] + 1
    if np.abs(np.cos(own[:, beta])).min() >= SINGULAR:
        return False
    other = seen(own, [places], ON, np.zeros(y0.size // 2))
    return bool(np.abs(np.cos(other[:, beta])).min() > np.abs(np.cos(own[:, beta])).min())


def hermite(t: float, t0: float, y0: Array, t1: float, y1: Array) -> Array:
    """The state at t on the cubic through q and v at both ends, (2n,)."""
    n, h = y0.size // 2, t1 - t0
    x = (t - t0) / h
    d = y1[:n] - y0[:n]
    a = h * (y0[n:] + y1[n:]) - 2.0 * d
    b = 3.0 * d - h * (2.0 * y0[n:] + y1[n:])
    q = y0[:n] + x * (h * y0[n:] + x * (b + x * a))
    return np.concatenate([q, y0[n:] + x * (2.0 * b + 3.0 * x * a) / h])
