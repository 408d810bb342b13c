"""Numbers that limits hold along a motion, how they change with it, and how far they go between samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index
from ...kernel.complete import Kernel
from ...robot.coordinates import force_unit_of, unit_of
from .allowed import Limits, Region

Course = tuple[Array, Array, Array]  # coordinates, velocities and accelerations of all coordinates, (T, n) each

RELAXED = 1e-4  # of a limit's width, or m: nearer than this to a limit, or beyond, the barrier is a parabola


@dataclass(frozen=True, eq=False)
class Held(ABC):
    """Numbers along a motion with their limits.

    Attributes:
        names: of the numbers, k of them, such as "joint1.gamma rate".
        units: theirs.
        low, high: least and greatest that is allowed, (k,); infinite where there is no limit.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Array
    high: Array

    @abstractmethod
    def values(self, course: Course) -> Array:
        """Return the numbers, (T, k)."""

    @abstractmethod
    def gradient(self, course: Course, weights: Array) -> Course:
        """Return derivatives of the sum of weighted numbers by coordinates, velocities and accelerations, (T, n)."""


@dataclass(frozen=True, eq=False)
class _Direct(Held):
    """Coordinates, velocities or accelerations themselves; order: 0, 1 or 2."""

    order: int
    index: Index

    def values(self, course: Course) -> Array:
        return np.asarray(course[self.order][:, self.index])

    def gradient(self, course: Course, weights: Array) -> Course:
        q, v, a = (np.zeros_like(x) for x in course)
        (q, v, a)[self.order][:, self.index] = weights
        return q, v, a


@dataclass(frozen=True, eq=False)
class _Drives(Held):
    """Drives without Coulomb friction, between limits that leave room for it, whichever way it acts."""

    kernel: Kernel
    index: Index

    def values(self, course: Course) -> Array:
        return np.asarray(self.kernel.inverse_dynamics(*course))[:, self.index]

    def gradient(self, course: Course, weights: Array) -> Course:
        whole = np.zeros_like(course[0])
        whole[:, self.index] = weights
        q, v, a = self.kernel.vjp(self.kernel.inverse_dynamics, course, whole)
        return q, v, a


@dataclass(frozen=True, eq=False)
class _Place(Held):
    """Position of a frame, as its region looks at it."""

    kernel: Kernel
    region: Region

    def values(self, course: Course) -> Array:
        if self.region.normals is not None:
            return np.asarray(self._points(course) @ self.region.normals.T)
        return np.asarray(np.linalg.norm(self._away(course), axis=1, keepdims=True))

    def gradient(self, course: Course, weights: Array) -> Course:
        q, v, a = course
        pull = (weights[:, :, np.newaxis] * self._normals(course)).sum(axis=1)
        J = np.asarray(self.kernel.frame_jacobian(q, self.region.frame))[:, :3]
        return np.einsum("tx,txn->tn", pull, J), np.zeros_like(v), np.zeros_like(a)

    def _points(self, course: Course) -> Array:
        return np.asarray(self.kernel.frame_pose(course[0], self.region.frame))[:, :3, 3]

    def _away(self, course: Course) -> Array:
        """Return from the point that the frame keeps clear of to the frame, (T, 3), m."""
        assert self.region.point is not None
        return np.asarray(self._points(course) - self.region.point)

    def _normals(self, course: Course) -> Array:
        """Return directions in which the numbers grow, (k, 3) or (T, 1, 3)."""
        if self.region.normals is not None:
            return self.region.normals
        away = self._away(course)
        size = np.linalg.norm(away, axis=1, keepdims=True)
        return np.asarray((away / np.maximum(size, 1e-12))[:, np.newaxis])


def held_by(limits: Limits, kernel: Kernel, rubbing: Array) -> tuple[Held, ...]:
    """Return all that limits hold.

    Args:
        limits: of the coordinates that move, m of them.
        kernel: without Coulomb friction, with inverse_dynamics and kinematics.
        rubbing: the Coulomb friction that drives may have to overcome, (m,), N or N m.
    """
    index = np.array([kernel.coordinates.index(name) for name in limits.names], dtype=np.intp)
    held: list[Held] = []
    for order, (kind, behind) in enumerate((("position", ""), ("rate", "/s"), ("acceleration", "/s^2"))):
        high = (limits.high, limits.rates, limits.accelerations)[order]
        low = limits.low if order == 0 else -high
        kept = np.flatnonzero(np.isfinite(high))
        names = tuple(f"{limits.names[i]} {kind}" for i in kept)
        units = tuple(unit_of(limits.names[i]) + behind for i in kept)
        if kept.size:
            held.append(_Direct(names, units, low[kept], high[kept], order, index[kept]))
    kept = np.flatnonzero(np.isfinite(limits.drives))
    if kept.size:
        names = tuple(f"{limits.names[i]} drive" for i in kept)
        units = tuple(force_unit_of(limits.names[i]) for i in kept)
        room = (limits.drives - rubbing)[kept]
        held.append(_Drives(names, units, -room, room, kernel, index[kept]))
    for region in limits.regions:
        names, none = region.names, np.full(len(region.low), np.inf)
        held.append(_Place(names, ("m",) * len(names), region.low, none, kernel, region))
    return tuple(held)


def widths(held: Held) -> Array:
    """Return the unit of distances to limits, (k,): from one limit to the other, 1 m where there is one alone."""
    both = np.isfinite(held.low) & np.isfinite(held.high)
    return np.where(both, np.where(both, held.high, 1.0) - np.where(both, held.low, 0.0), 1.0)


def extremes(held: Held, course: Course) -> tuple[Array, Array]:
    """Return least and greatest numbers of a whole period, between samples too, (k,) each.

    Between samples a number leaves the straight line by an eighth of its second difference at most.

    Args:
        held: the numbers.
        course: of a period at equal distances, without its end.
    """
    values = held.values(course)
    bend = np.abs(np.roll(values, 1, axis=0) - 2.0 * values + np.roll(values, -1, axis=0)).max(axis=0) / 8.0
    return values.min(axis=0) - bend, values.max(axis=0) + bend


def beyond(held: Held, course: Course) -> Array:
    """Return how far numbers go beyond their limits, (k,), in ``widths``; negative where room is left."""
    least, greatest = extremes(held, course)
    return np.asarray(np.maximum(held.low - least, greatest - held.high) / widths(held))


def barrier(everything: Sequence[Held], course: Course, narrowed: Sequence[Array]) -> tuple[float, Course]:
    """Sum of -log of all distances to limits, in ``widths``, and its gradient by the course.

    Near a limit and beyond it is the parabola that goes on smoothly (J. Hauser, A. Saccon 2006).

    Args:
        everything: the numbers that limits hold.
        course: the motion.
        narrowed: by how much limits are taken to be nearer, (k,) of each, in ``widths``.
    """
    total, gradient = 0.0, tuple(np.zeros_like(x) for x in course)
    for held, less in zip(everything, narrowed, strict=True):
        values, scale = held.values(course), widths(held)
        weights = np.zeros_like(values)
        for sign, limit in ((1.0, held.low), (-1.0, held.high)):
            kept = np.flatnonzero(np.isfinite(limit))
            room = sign * (values[:, kept] - limit[kept]) / scale[kept] - less[kept]
            value, slope = _penalty(room)
            total += value
            weights[:, kept] += sign * slope / scale[kept]
        for sum_, row in zip(gradient, held.gradient(course, weights), strict=True):
            sum_ += row
    q, v, a = gradient
    return total, (q, v, a)


def _penalty(room: Array) -> tuple[float, Array]:
    """Sum of -log(room), a parabola below RELAXED, and its slopes."""
    near = room < RELAXED
    safe = np.where(near, RELAXED, room)
    bent = room / RELAXED - 2.0
    values = np.where(near, 0.5 * (bent**2 - 1.0) - np.log(RELAXED), -np.log(safe))
    return float(values.sum()), np.where(near, bent / RELAXED, -1.0 / safe)
