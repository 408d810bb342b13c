"""Poses at rest within limits: random ones, or those that lie nearest to them are led inside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Array, Index
from ...errors import InputError
from .allowed import Limits
from .constraints import Course, Held, barrier, widths
from .descending import descended

POSES = 2000  # random ones that are looked at to begin with
MIDDLE = 0.8  # of its range: where a coordinate is in half of them
ENOUGH = 20  # poses within limits: where there are fewer, others are led to them
LED = 10  # of these, the nearest ones
STEPS = 100  # on the way, at most


def standing(limits: Limits, held: Sequence[Held], n: int, index: Index, rng: np.random.Generator) -> Array:
    """Return poses in which a robot may stand, (P, m).

    Args:
        limits: of the coordinates that move, m of them.
        held: what limits hold.
        n: number of all coordinates; others are 0.
        index: numbers of those that move, (m,).
        rng: of the random poses.

    Raises:
        InputError: there are none; it names the limit that the nearest one is farthest from.
    """
    low, high = limits.low, limits.high
    width = np.where(np.arange(POSES) % 2, 1.0, MIDDLE)[:, np.newaxis] * (high - low)
    poses = (low + high) / 2.0 + (rng.random((POSES, len(low))) - 0.5) * width

    def course(q: Array) -> Course:
        whole = np.zeros((len(q), n))
        whole[:, index] = q
        return whole, np.zeros_like(whole), np.zeros_like(whole)

    out = _beyond(held, course(poses))
    inside = out.max(axis=1) <= 0.0
    if inside.sum() >= ENOUGH:
        return np.asarray(poses[inside])
    none = [np.zeros(len(entry.names)) for entry in held]

    def value(z: Array) -> tuple[float, Array]:
        total, gradient = barrier(held, course((z * (high - low))[np.newaxis]), none)
        return total, gradient[0][0, index] * (high - low)

    far = np.flatnonzero(~inside)
    nearest = far[np.argsort(np.maximum(out[far], 0.0).sum(axis=1), kind="stable")[:LED]]
    led = np.array([descended(value, poses[k] / (high - low), STEPS)[0] for k in nearest]) * (high - low)
    left = _beyond(held, course(led))
    poses_at_rest = np.concatenate([poses[inside], led[left.max(axis=1) <= 0.0]])
    if not len(poses_at_rest):
        raise InputError(f"limits: no pose at rest is within all of them; {_nearest(held, course(led), left)}")
    return poses_at_rest


def _beyond(held: Sequence[Held], course: Course) -> Array:
    """Return how far poses are beyond limits, (P, all limits), in ``widths``; negative within."""
    parts = []
    for entry in held:
        values = entry.values(course)
        parts.append(np.maximum(entry.low - values, values - entry.high) / widths(entry))
    return np.concatenate(parts, axis=1)


def _nearest(held: Sequence[Held], course: Course, left: Array) -> str:
    """Say which limit the nearest pose is farthest from."""
    pose = int(left.max(axis=1).argmin())
    k = int(left[pose].argmax())
    for entry in held:
        if k < len(entry.names):
            break
        k -= len(entry.names)
    value = float(entry.values(course)[pose, k])
    low, high, unit = float(entry.low[k]), float(entry.high[k]), entry.units[k]
    ends = [f"from {low:.4g}"] * bool(np.isfinite(low)) + [f"to {high:.4g}"] * bool(np.isfinite(high))
    return f"the nearest one has {entry.names[k]} {value:.4g} {unit}; allowed: {' '.join(ends)} {unit}"
