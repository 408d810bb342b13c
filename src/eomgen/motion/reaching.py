"""Coordinates that bring a tool to a point, or into a pose: Levenberg and Marquardt's method, loops closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Mask
from ..errors import LoopError
from ..loops.chart import Chart
from ..robot.coordinates import unit_of
from ..runtime.kernel import Kernel
from .turns import rpy_of, vector_of

CLOSE = 1e-11  # m, times the point's largest coordinate or 1 m, and rad: what counts as reached
GUESSES, STEPS = 40, 100
STEP = 0.3  # rad, m: longest step of an iteration
AT_LIMIT = 1e-9  # m or rad
_LEAST_STEP = 1e-14  # m or rad: nothing is won any more


@dataclass(frozen=True, eq=False)
class Target:
    """Pose for a tool to reach.

    Attributes:
        tool: a frame or link.
        point: of its origin, (3,), m, base frame.
        axes: its axes as columns, (3, 3); None leaves them open.
    """

    tool: str
    point: Array
    axes: Array | None = None

    @property
    def close(self) -> float:
        """Distance that counts as reached, m."""
        return CLOSE * max(1.0, float(np.abs(self.point).max()))

    @property
    def rows(self) -> int:
        """Number of rows of ``error``: 3 of a point, 6 of a pose."""
        return 3 if self.axes is None else 6

    def error(self, kernel: Kernel, q: Array) -> Array:
        """Return the error at q: displacement, m, and rotation vector, rad, base frame, (3,) or (6,)."""
        pose = kernel.frame_pose(q, self.tool)
        off = self.point - pose[:3, 3]
        return off if self.axes is None else np.concatenate([off, vector_of(self.axes @ pose[:3, :3].T)])

    def slopes(self, kernel: Kernel, q: Array) -> Array:
        """Return the tool's Jacobian in the rows of ``error``, (3, n) or (6, n)."""
        J = kernel.frame_jacobian(q, self.tool)
        return np.array(J[:3] if self.axes is None else J)

    def text(self) -> str:
        """Say where that is, for messages."""
        place = point_text(self.point)
        if self.axes is None:
            return place
        return f"{place}, rpy ({', '.join(f'{x:.4g}' for x in np.round(rpy_of(self.axes), 9) + 0.0)}) rad"


@dataclass(frozen=True, eq=False)
class Reached:
    """Coordinates, (n,), and their remaining error, as ``Target.error`` has it; infinite where loops are open."""

    q: Array
    error: Array
    close: float

    @property
    def distance(self) -> float:
        """Distance that the tool's origin misses, m."""
        return float(np.linalg.norm(self.error[:3]))

    @property
    def angle(self) -> float:
        """Angle that its axes miss, rad; 0 where they are open."""
        return float(np.linalg.norm(self.error[3:]))

    @property
    def missed(self) -> float:
        """Distance and angle as one size, m and rad."""
        return float(np.linalg.norm(self.error))

    @property
    def is_there(self) -> bool:
        """Whether it is close enough."""
        return self.distance <= self.close and self.angle <= CLOSE

    def text(self) -> str:
        """Return the remaining error as text for messages."""
        if not np.isfinite(self.distance):
            return "its loops do not close"
        turn = f" and {round(np.degrees(self.angle), 9):.4g} deg" if self.error.size == 6 else ""
        return f"{round(1e3 * self.distance, 9):.4g} mm{turn}"


def reach(
    kernel: Kernel, target: Target, q: Array, limits: Array, *, bounded: bool = False, weights: Array | None = None
) -> Reached:
    """Return coordinates near a guess that bring the tool there, or as near as it gets.

    Each step is the least one, by the sum of squares of all coordinates' changes, rad and m alike.

    Args:
        kernel: with kinematics; of a robot with loops these stay closed.
        target: where the tool is to be.
        q: the guess, (n,).
        limits: lower and upper limits, (n, 2); where both are equal the coordinate stays.
        bounded: whether steps end at limits, of robots without loops; else limits are not looked at.
        weights: how willingly coordinates move, (n,), 1 for all by default: changes are divided by them before
            they are squared.
    """
    w = np.ones(kernel.n) if weights is None else weights
    if kernel.constraints:
        return _reach_closed(kernel, target, q, limits, w)
    held = limits[:, 0] == limits[:, 1]
    q, damping = (np.clip(q, limits[:, 0], limits[:, 1]) if bounded else q.copy()), 1e-8
    best = Reached(q, target.error(kernel, q), target.close)
    for _ in range(STEPS):
        if best.is_there:
            break
        J = target.slopes(kernel, best.q)
        step = _least_step(J, best.error, damping, w, held)
        if bounded:
            step = _bounded_step(J, best, damping, w, held, limits)
        step *= min(1.0, STEP / max(float(np.abs(step).max()), 1e-300))
        trial = best.q + step
        if bounded:
            trial = np.clip(trial, limits[:, 0], limits[:, 1])
        other = Reached(trial, target.error(kernel, trial), target.close)
        if other.missed < best.missed:
            best, damping = other, max(damping / 10.0, 1e-14)
        elif np.abs(step).max() < _LEAST_STEP:
            break
        else:
            damping *= 10.0
    return best


def _least_step(J: Array, error: Array, damping: Array | float, weights: Array, held: Mask) -> Array:
    """Return the damped step of least weighted change, (n,); those that are held have none."""
    w = np.where(held, 0.0, weights)
    U, S, Vt = np.linalg.svd(J * w, full_matrices=False)
    return np.asarray(w * (Vt.T @ (S / (S**2 + damping) * (U.T @ error))))


def _bounded_step(J: Array, reached: Reached, damping: float, weights: Array, held: Mask, limits: Array) -> Array:
    """Return the step without those coordinates that would leave their limits at once."""
    still = held.copy()
    while True:
        step = _least_step(J, reached.error, damping, weights, still)
        leaving = at_limits(reached.q, step, limits) & ~still
        if not leaving.any():
            return step
        still |= leaving


def at_limits(q: Array, step: Array, limits: Array) -> Mask:
    """Return which coordinates stand at a limit beyond which a step leads, (n,)."""
    low, high = limits.T
    return np.asarray(((q <= low + AT_LIMIT) & (step < 0.0)) | ((q >= high - AT_LIMIT) & (step > 0.0)))


def _reach_closed(kernel: Kernel, target: Target, q: Array, limits: Array, weights: Array) -> Reached:
    """Return ``reach`` along the motions that a closed mechanism allows."""
    held = limits[:, 0] == limits[:, 1]
    try:
        q = kernel.close(q, [name for name, stays in zip(kernel.coordinates, held, strict=True) if stays])
    except LoopError:
        return Reached(q, np.full(target.rows, np.inf), target.close)
    best, damping = Reached(q, target.error(kernel, q), target.close), 1e-8
    chart = Chart(kernel, q, prescribed=held)
    for _ in range(STEPS):
        if best.is_there or not chart.free.size:
            break
        tangent = chart.tangent_basis(chart.assemble(best.q)[1])
        orthogonal, _ = np.linalg.qr(
            tangent / weights[:, np.newaxis]
        )  # so that the least step is that of all coordinates
        along = weights[:, np.newaxis] * orthogonal
        U, S, Vt = np.linalg.svd(target.slopes(kernel, best.q) @ along, full_matrices=False)
        step = along @ (Vt.T @ (S / (S**2 + damping) * (U.T @ best.error)))
        step *= min(1.0, STEP / max(float(np.abs(step).max()), 1e-300))
        trial = best.q.copy()
        trial[chart.free] += step[chart.free]
        try:
            trial = chart.assemble(trial)[0]
        except LoopError:
            damping *= 10.0
            continue
        other = Reached(trial, target.error(kernel, trial), target.close)
        if other.missed < best.missed:
            best, damping = other, max(damping / 10.0, 1e-14)
            chart = Chart(kernel, best.q, prescribed=held)
        elif np.abs(step).max() < _LEAST_STEP:
            break
        else:
            damping *= 10.0
    return best


def search(kernel: Kernel, target: Target, guess: Array, limits: Array, guesses: int = GUESSES) -> Reached:
    """Return coordinates within the limits that bring the tool there: from the guess, or from others, always the same.

    Where none do, the nearest that are within the limits (of a robot with loops: the nearest of all).
    """
    tried = [False] if kernel.constraints or not np.isfinite(limits).any() else [False, True]
    for bounded in tried:
        ends = [Reached(guess, np.full(target.rows, np.inf), target.close)]
        for trial in starting_points(guess, limits, guesses):
            reached = reach(kernel, target, trial, limits, bounded=bounded)
            if reached.is_there and within_limits(reached.q, limits):
                return reached
            ends.append(reached)
    return min(ends, key=lambda end: end.missed)


def starting_points(guess: Array, limits: Array, guesses: int = GUESSES) -> Iterator[Array]:
    """Yield the guess, then others about it within the limits, always the same."""
    yield guess
    rng = np.random.default_rng(0)
    low, high = np.maximum(limits[:, 0], guess - 3.0), np.minimum(limits[:, 1], guess + 3.0)
    for _ in range(guesses):
        yield rng.uniform(np.minimum(low, high), high)


def within_limits(q: Array, limits: Array) -> bool:
    return bool(((limits[:, 0] - AT_LIMIT <= q) & (q <= limits[:, 1] + AT_LIMIT)).all())


def binding(kernel: Kernel, target: Target, reached: Reached, limits: Array) -> str:
    """Return text about the limits that keep a tool away, or that its coordinates leave; "" without any."""
    low, high = limits.T
    moving = low < high
    beyond = np.maximum(low - reached.q, reached.q - high)
    worst = int(np.argmax(np.where(moving, beyond, -np.inf)))
    if moving[worst] and beyond[worst] > AT_LIMIT:
        span = f"its limits are {limits[worst, 0]:.4g} to {limits[worst, 1]:.4g}"
        return f"{kernel.coordinates[worst]} = {reached.q[worst]:.4g}; {span}"
    if kernel.constraints:
        return ""
    pull = target.slopes(kernel, reached.q).T @ reached.error
    standing = at_limits(reached.q, pull, limits) & moving & (np.abs(pull) > 1e-6 * reached.missed)
    stops = np.where(pull < 0.0, low, high)
    return ", ".join(
        f"{name} is at its limit {stop:.4g} {unit_of(name)}"
        for name, stop, stands in zip(kernel.coordinates, stops, standing, strict=True)
        if stands
    )


def point_text(point: Array) -> str:
    """Return a point for messages."""
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ") m"
