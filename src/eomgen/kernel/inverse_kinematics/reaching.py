"""Inverse kinematics: coordinates that bring a frame to a point or into a pose, by the Levenberg-Marquardt method."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import ReachError
from ...names import kind_of
from ..kinematics import Kinematics
from ..loop_assembly import closed_near, tangent_directions
from .rotations import Array, rpy_of, vector_of

Mask = NDArray[np.bool_]

CLOSE = {8: 1e-11, 4: 1e-5}  # m, times the point's largest coordinate or 1 m, and rad: reached, by a number's bytes
GUESSES, STEPS = 40, 100
STEP = 0.3  # rad, m: longest step of an iteration
AT_LIMIT = 1e-9  # m or rad
_LEAST_STEP = 1e-14  # m or rad: nothing is won any more


@dataclass(frozen=True, eq=False)
class Target:
    """Pose that a tool is to reach.

    Attributes:
        tool: a frame or link.
        point: of its origin, (3,), m, base frame.
        axes: its axes as columns, (3, 3); None leaves them open.
    """

    tool: str
    point: Array
    axes: Array | None = None

    def error(self, kernel: Kinematics, q: Array) -> Array:
        """Return what is missing at q: displacement, m, and rotation vector, rad, base frame, (3,) or (6,)."""
        pose = kernel.frame_pose(q, self.tool)
        off = self.point - pose[:3, 3]
        return off if self.axes is None else np.concatenate([off, vector_of(self.axes @ pose[:3, :3].T)])

    def jacobian(self, kernel: Kinematics, q: Array) -> Array:
        """Return the tool's Jacobian in the rows of ``error``, (3, n) or (6, n)."""
        J = kernel.frame_jacobian(q, self.tool)
        return np.array(J[:3] if self.axes is None else J, np.float64)

    def reached(self, kernel: Kinematics, q: Array | None, guess: Array | None = None) -> Reached:
        """Return how near q, (n,), is; where it is None, that the loops do not close near a guess."""
        tolerance = CLOSE[kernel.dtype.itemsize]
        close = (tolerance * max(1.0, float(np.abs(self.point).max())), tolerance)
        if q is None:
            assert guess is not None
            return Reached(guess, np.full(3 if self.axes is None else 6, np.inf), close)
        return Reached(q, self.error(kernel, q), close)

    def text(self) -> str:
        """Say where that is, for messages."""
        place = point_text(self.point)
        if self.axes is None:
            return place
        return f"{place}, rpy ({', '.join(f'{x:.4g}' for x in np.round(rpy_of(self.axes), 9) + 0.0)}) rad"


@dataclass(frozen=True, eq=False)
class Reached:
    """Coordinates and the residual of a pose there.

    Attributes:
        q: (n,).
        error: as ``Target.error`` has it; infinite where the loops do not close.
        close: distance, m, and angle, rad, that count as reached.
    """

    q: Array
    error: Array
    close: tuple[float, float]

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
        """Norm of both together, m and rad."""
        return float(np.linalg.norm(self.error))

    @property
    def is_there(self) -> bool:
        """Whether it is close enough."""
        return self.distance <= self.close[0] and self.angle <= self.close[1]

    def text(self) -> str:
        """Say what is missing, for messages."""
        if not np.isfinite(self.distance):
            return "its loops do not close"
        turn = f" and {round(np.degrees(self.angle), 9):.4g} deg" if self.error.size == 6 else ""
        return f"{round(1e3 * self.distance, 9):.4g} mm{turn}"


def reach(
    kernel: Kinematics,
    target: Target,
    q: Array,
    limits: Array,
    *,
    bounded: bool = False,
    weights: Array | None = None,
) -> Reached:
    """Return coordinates near a guess that bring the tool there, or as near as it gets; loops are closed.

    Each step is the least one, by the sum of squares of all coordinates' changes, rad and m alike.  Of a robot with
    loops it is one that their constraint allows, after which they are closed again.

    Args:
        kernel: with kinematics; of a robot with loops with all that ``assemble`` takes.
        target: where the tool is to be.
        q: the guess, (n,).
        limits: lower and upper limits, (n, 2); where both are equal the coordinate stays.
        bounded: whether steps end at limits; else limits are not looked at.
        weights: how willingly coordinates move, (n,), 1 for all if not given: changes are divided by them before
            they are squared.
    """
    w = np.ones(len(kernel.coordinates)) if weights is None else weights
    low, high = limits.T
    held = low == high
    q = (np.clip(q, low, high) if bounded else q).astype(kernel.dtype)
    begun = _assembled(kernel, q, held, limits, bounded=bounded)
    reached, damping = target.reached(kernel, begun, q), 1e-8
    for _ in range(STEPS if begun is not None else 0):
        if reached.is_there:
            break
        J = target.jacobian(kernel, reached.q)
        step, still = _least_step(kernel, J, reached, damping, w, held), held
        if bounded:
            step, still = _bounded_step(kernel, J, reached, damping, w, held, limits)
        step *= min(1.0, STEP / max(float(np.abs(step).max()), 1e-300))
        trial = reached.q + step
        if bounded:
            trial = np.clip(trial, low, high)
        closed = _assembled(kernel, trial.astype(kernel.dtype), still, limits, bounded=bounded)
        other = target.reached(kernel, closed, trial)
        if other.missed < reached.missed:
            reached, damping = other, max(damping / 10.0, 1e-14)
        elif np.abs(step).max() < _LEAST_STEP:
            break
        else:
            damping *= 10.0
    return reached


def _assembled(kernel: Kinematics, q: Array, held: Mask, limits: Array, *, bounded: bool) -> Array | None:
    """Return a state near q, (n,), whose loops are closed, within the limits if ``bounded``; None if there is none."""
    if not kernel.constraints:
        return q
    closed = closed_near(kernel.calls, q, ~held)
    if closed is None or not bounded or within_limits(closed, limits):
        return closed
    low, high = limits.T
    beyond = (closed < low) | (closed > high)
    closed = closed_near(kernel.calls, np.clip(closed, low, high).astype(kernel.dtype), ~(held | beyond))
    return closed if closed is not None and within_limits(closed, limits) else None


def _least_step(kernel: Kinematics, J: Array, reached: Reached, damping: float, weights: Array, held: Mask) -> Array:
    """Return the damped step of least weighted change, (n,); those that are held have none."""
    w = np.where(held, 0.0, weights)
    scaled = J * w
    if not kernel.constraints:
        return np.asarray(w * _damped(scaled, reached.error, damping))
    tangent = tangent_directions(kernel.calls, reached.q, w)
    return np.asarray(w * (tangent @ _damped(scaled @ tangent, reached.error, damping)))


def _damped(A: Array, error: Array, damping: float) -> Array:
    """Return the y that makes |A y - error|^2 + damping |y|^2 least."""
    if not A.shape[1]:
        return np.zeros(0)
    U, S, Vt = np.linalg.svd(A, full_matrices=False)
    return np.asarray(Vt.T @ (S / (S**2 + damping) * (U.T @ error)))


def _bounded_step(
    kernel: Kinematics,
    J: Array,
    reached: Reached,
    damping: float,
    weights: Array,
    held: Mask,
    limits: Array,
) -> tuple[Array, Mask]:
    """Return the step without those coordinates that would leave their limits at once, and which stay, (n,) each."""
    still = held.copy()
    while True:
        step = _least_step(kernel, J, reached, damping, weights, still)
        leaving = at_limits(reached.q, step, limits) & ~still
        if not leaving.any():
            return step, still
        still |= leaving


def at_limits(q: Array, step: Array, limits: Array) -> Mask:
    """Return which coordinates stand at a limit beyond which a step leads, (n,)."""
    low, high = limits.T
    return np.asarray(((q <= low + AT_LIMIT) & (step < 0.0)) | ((q >= high - AT_LIMIT) & (step > 0.0)))


def search(
    kernel: Kinematics, target: Target, guess: Array, limits: Array, guesses: int = GUESSES
) -> tuple[Reached, bool]:
    """Look for coordinates within the limits that bring the tool there, from the guess, then from others.

    Returns:
        They and True; where there are none, the nearest that are within the limits, and False.  The other starting
        points are always the same.
    """
    ends = list[Reached]()
    for bounded in (False, True) if np.isfinite(limits).any() else (False,):
        ends = []
        for trial in starting_points(guess, limits, guesses):
            reached = reach(kernel, target, trial, limits, bounded=bounded)
            if reached.is_there and within_limits(reached.q, limits):
                return reached, True
            ends.append(reached)
    return min(ends, key=lambda end: end.missed), False


def starting_points(guess: Array, limits: Array, guesses: int = GUESSES) -> Iterator[Array]:
    """Yield the guess, then others about it within the limits, always the same."""
    yield guess
    rng = np.random.default_rng(0)
    low, high = np.maximum(limits[:, 0], guess - 3.0), np.minimum(limits[:, 1], guess + 3.0)
    for _ in range(guesses):
        yield rng.uniform(np.minimum(low, high), high)


def within_limits(q: Array, limits: Array) -> bool:
    """Return whether all coordinates, (n,), are within their limits, (n, 2)."""
    return bool(((limits[:, 0] - AT_LIMIT <= q) & (q <= limits[:, 1] + AT_LIMIT)).all())


def unreached(
    kernel: Kinematics,
    target: Target,
    reached: Reached,
    limits: Array,
    label: str,
    hint: str = "",
    remark: str = "",
) -> ReachError:
    """Return the error of a target that is missed, or reached beyond the limits alone: by how much.

    Args:
        label: what the message begins with after the robot's name.
        hint: what stands before the residual, instead of "it gets as near as".
        remark: what the message ends with.
    """
    bound = binding(kernel, target, reached, limits)
    if reached.is_there:
        what = f"not within its limits: {bound}"
    else:
        what = f"{hint or 'it gets as near as'} {reached.text()}{f'; {bound}' if bound else ''}"
    end = f"; {remark}" if remark else ""
    return ReachError(f"{kernel.name}: {label}: {what}{end}", reached.distance, reached.angle, reached.q)


def binding(kernel: Kinematics, target: Target, reached: Reached, limits: Array) -> str:
    """Say which limits keep a tool away, or which its coordinates leave; "" without any."""
    low, high = limits.T
    moving = low < high
    beyond = np.maximum(low - reached.q, reached.q - high)
    worst = int(np.argmax(np.where(moving, beyond, -np.inf)))
    if moving[worst] and beyond[worst] > AT_LIMIT:
        span = f"its limits are {limits[worst, 0]:.4g} to {limits[worst, 1]:.4g}"
        return f"{kernel.coordinates[worst]} = {reached.q[worst]:.4g}; {span}"
    if not np.isfinite(reached.missed):
        return ""
    pull = target.jacobian(kernel, reached.q).T @ reached.error
    if kernel.constraints:
        tangent = tangent_directions(kernel.calls, reached.q, moving.astype(np.float64))
        pull = tangent @ (tangent.T @ pull)
    standing = at_limits(reached.q, pull, limits) & moving & (np.abs(pull) > 1e-6 * reached.missed)
    stops = np.where(pull < 0.0, low, high)
    return ", ".join(
        f"{name} is at its limit {stop:.4g} {'m' if kind_of(name) in ('x', 'y', 'z') else 'rad'}"
        for name, stop, stands in zip(kernel.coordinates, stops, standing, strict=True)
        if stands
    )


def point_text(point: Array) -> str:
    """Write a point for messages."""
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ") m"
