"""States within a step: cubic Hermite interpolation of coordinates and velocities, past singular Euler angles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import Array
from ..kernel.turning import BACK, ON, SINGULAR, seen


class Cubics:
    """Cubics between states (q, v, z) in described coordinates; z is linear in time, or with its rates a parabola.

    Where the Euler angles of a joint with 3-DOF rotation are nearly singular, they change within a step by up to pi:
    the cubic is one of its other chart's angles then, and points on it are converted back.

    Args:
        joints: places of alpha and of x of such joints, as of ``RawKernel.turning``.
        n: number of coordinates.
    """

    def __init__(self, joints: Mapping[str, tuple[int, int]], n: int) -> None:
        self._joints, self._n = joints, n

    def at(self, t: float, t0: float, y0: Array, t1: float, y1: Array, rates: Array | None = None) -> Array:
        """Interpolate the state at t, s, between two at t0 and t1; ``rates``: of internal states at t0, (m,)."""
        near = y0[: self._n]
        turned = [places for places in self._joints.values() if _is_turned(places, y0, y1, self._n)]
        if not turned:
            return hermite(t, t0, y0, t1, y1, self._n, rates)
        ends = seen(np.stack([y0, y1]), turned, ON, np.zeros_like(near))
        between = hermite(t, t0, ends[0], t1, ends[1], self._n, rates)
        return np.asarray(seen(between[np.newaxis], turned, BACK, near)[0])

    def among(self, t: float, times: Array, states: Array) -> Array:
        """Interpolate the state at t, s, between two neighbours of states, (k, size), at times, (k,)."""
        k = min(max(int(np.searchsorted(times, t, side="right")) - 1, 0), times.size - 2)
        return self.at(t, float(times[k]), states[k], float(times[k + 1]), states[k + 1])


def _is_turned(places: tuple[int, int], y0: Array, y1: Array, n: int) -> bool:
    """Return whether the other chart of a joint is better for a step between two states: farther from singular."""
    states, beta = np.stack([y0, y1]), places[0] + 1
    if np.abs(np.cos(states[:, beta])).min() >= SINGULAR:
        return False
    other = seen(states, [places], ON, np.zeros(n))
    return bool(np.abs(np.cos(other[:, beta])).min() > np.abs(np.cos(states[:, beta])).min())


def hermite(t: float, t0: float, y0: Array, t1: float, y1: Array, n: int, rates: Array | None = None) -> Array:
    """Interpolate the state (q, v, z) at t on the cubic through q and v at both ends, (n,) each, z as ``Cubics``."""
    h = t1 - t0
    (q0, v0, z0), (q1, v1, z1) = ((y[:n], y[n : 2 * n], y[2 * n :]) for y in (y0, y1))
    x = (t - t0) / h
    d = q1 - q0
    a = h * (v0 + v1) - 2.0 * d
    b = 3.0 * d - h * (2.0 * v0 + v1)
    q = q0 + x * (h * v0 + x * (b + x * a))
    v = v0 + x * (2.0 * b + 3.0 * x * a) / h
    if not z0.size:
        return np.concatenate([q, v])
    bend = 0.0 if rates is None else x * (x - 1.0) * (z1 - z0 - h * rates)
    return np.concatenate([q, v, z0 + x * (z1 - z0) + bend])
