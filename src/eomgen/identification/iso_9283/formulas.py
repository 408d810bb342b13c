"""The formulas of ISO 9283:1998, clauses 7 and 8, on arrays: n cycles, positions in m, angles in rad."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index
from ..geometry.rotations import vectors_of

STEADY = 0.99  # of the greatest commanded speed, from which on a path's speed is looked at


@dataclass(frozen=True)
class Scatter:
    """Attained positions about their barycentre.

    barycentre: (3,), m.  mean, deviation: l-bar and S_l of the distances to it, m; S_l by n - 1, 0 of one cycle.
    """

    barycentre: Array
    mean: float
    deviation: float

    @property
    def repeatability(self) -> float:
        """RP_l = l-bar + 3 S_l, m."""
        return self.mean + 3.0 * self.deviation


def scatter(positions: Array) -> Scatter:
    """Return the scatter of positions, (n, 3), m."""
    barycentre = positions.mean(axis=0)
    distances = np.linalg.norm(positions - barycentre, axis=1)
    return Scatter(barycentre, float(distances.mean()), float(deviations(distances)))


def deviations(values: Array) -> Array:
    """Return standard deviations by n - 1 along the first axis; 0 of a single value."""
    if len(values) < 2:
        return np.zeros(values.shape[1:])
    return np.asarray(values.std(axis=0, ddof=1))


def turns_from(command: Array, attained: Array) -> Array:
    """Return angles a, b, c from the commanded to the attained orientation, (..., 3), rad, about the base's axes.

    They are the components of the rotation vector of R R_c^T, so that no pose is a pole.
    """
    return vectors_of(attained @ np.swapaxes(command, -1, -2))


def stabilization(t: Array, positions: Array, attained: Array, band: float) -> tuple[float, float]:
    """Return the stabilization time, s, and overshoot, m, of one stop: clauses 7.4 and 7.5.

    The time begins where the tool first comes within ``band`` of the attained position and ends where it comes in for
    good, both interpolated between samples.  Overshoot is the greatest distance after the first coming in, and 0 where
    that lies within the band.

    Args:
        t, positions: the record, (T,), s, increasing, and (T, 3), m; its last sample lies within the band.
        attained: the position that was attained, (3,), m.
        band: the limit band, m.
    """
    distance = np.linalg.norm(positions - attained, axis=1)
    inside = distance <= band
    first = int(np.argmax(inside))
    outside = np.flatnonzero(~inside[first:]) + first
    if not outside.size:
        return 0.0, 0.0
    farthest = float(distance[first:].max())
    last = int(outside[-1]) + 1
    return _crossing(t, distance, last, band) - _crossing(t, distance, first, band), farthest


def _crossing(t: Array, distance: Array, i: int, band: float) -> float:
    """Time at which the distance falls to the band in front of sample i, that is within it."""
    if i == 0:
        return float(t[0])
    share = (distance[i - 1] - band) / (distance[i - 1] - distance[i])
    return float(t[i - 1] + share * (t[i] - t[i - 1]))


def tangents(points: Array) -> Array:
    """Return the unit tangents, (m, 3), of a path through points, (m, 3), of which no two neighbours are the same."""
    along = np.empty_like(points)
    along[1:-1] = points[2:] - points[:-2]
    along[0], along[-1] = points[1] - points[0], points[-1] - points[-2]
    size = np.linalg.norm(along, axis=1)
    back = size == 0.0  # the path turns round on itself
    along[back] = (points[1:] - points[:-1])[np.flatnonzero(back) - 1]
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


def arc(points: Array) -> Array:
    """Return lengths of the path from its beginning to each point, (m,), m."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def at_planes(points: Array, along: Array, near: Index, attained: Array) -> Array:
    """Return the index at which an attained path goes through the normal planes of the commanded one.

    Args:
        points, along: of the commanded path, (m, 3) and its unit tangents.
        near: samples of the attained path that the search begins at, (m,).
        attained: the attained path, (k, 3), straight between its samples.

    Returns:
        Samples with their fractions, (m,); NaN where the path ends before the plane.
    """
    points_hit = np.full(len(points), np.nan)
    open_ones = np.arange(len(points))
    here = near.copy()
    height = np.einsum("mi,mi->m", attained[here] - points, along)
    hit = height == 0.0
    points_hit[hit] = here[hit]
    open_ones = open_ones[~hit]
    way = np.where(height < 0.0, 1, -1)  # behind the plane: on, in front of it: back
    while open_ones.size:
        following = here[open_ones] + way[open_ones]
        there = (following >= 0) & (following < len(attained))
        open_ones, following = open_ones[there], following[there]
        old = height[open_ones]
        new = np.einsum("mi,mi->m", attained[following] - points[open_ones], along[open_ones])
        through = (old < 0.0) != (new < 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = old / (old - new)
        points_hit[open_ones[through]] = (here[open_ones] + way[open_ones] * share)[through]
        here[open_ones], height[open_ones] = following, new
        open_ones = open_ones[~through]
    return points_hit


def between(values: Array, places: Array) -> Array:
    """Return values, (k, ...), at samples with fractions, (m,), linear between samples."""
    low = np.minimum(places.astype(np.intp), len(values) - 1)
    high = np.minimum(low + 1, len(values) - 1)
    share = (places - low).reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray(values[low] + share * (values[high] - values[low]))


def path_scatter(command: Array, attained: Array) -> tuple[Array, Array]:
    """Return distances of attained points of a path, (n, m, 3), from the commanded ones, (m, 3): (m,) each, m.

    The first are those of the barycentre from the command, the second l-bar + 3 S_l; the figures of clauses 8.2 and 8.3
    are the greatest of each.
    """
    barycentre = attained.mean(axis=0)
    distances = np.linalg.norm(attained - barycentre, axis=2)
    accuracy = np.linalg.norm(barycentre - command, axis=1)
    return accuracy, np.asarray(distances.mean(axis=0) + 3.0 * deviations(distances))


def speeds(t: Array, positions: Array) -> Array:
    """Return speeds along a path, (T,), m/s: differences of neighbouring samples on both sides."""
    if len(t) < 2:
        return np.zeros(len(t))
    return np.asarray(np.linalg.norm(np.gradient(positions, t, axis=0), axis=1))


def distance_to_path(point: Array, path: Array) -> float:
    """Return the distance of a point, (3,), from a path, (k, 3), straight between its points: clause 8.5, m."""
    begin, steps = path[:-1], np.diff(path, axis=0)
    squares = np.maximum(np.einsum("ki,ki->k", steps, steps), 1e-300)
    share = np.clip(np.einsum("ki,ki->k", point - begin, steps) / squares, 0.0, 1.0)
    return float(np.linalg.norm(begin + share[:, np.newaxis] * steps - point, axis=1).min())


def corner_overshoot(attained: Array, corner: Array, before: Array, behind: Array) -> float:
    """Return the overshoot of an attained path, (k, 3), over the line behind a corner: clause 8.5, m.

    It is the greatest distance from that line of points that have passed the corner and lie on the outer side, to which
    the path in front of the corner points; 0 where none does.

    Args:
        attained: positions around the corner, in their order, m.
        corner: its position, (3,), m.
        before, behind: unit vectors along the commanded path in front of the corner and behind it.
    """
    outward = before - (before @ behind) * behind
    arm = attained - corner
    past = arm @ behind
    off = np.linalg.norm(arm - past[:, np.newaxis] * behind, axis=1)
    return float(off[(past >= 0.0) & (arm @ outward > 0.0)].max(initial=0.0))
