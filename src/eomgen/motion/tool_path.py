"""A path of a tool, straight or round, as a motion of a robot's principal coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError, InputError, LoopError
from ..loops.chart import Chart
from ..optional import optional_import
from ..runtime.kernel import Kernel
from .point_to_point import PointToPoint

Array = NDArray[np.float64]

POINTS = 201  # of the path, between which joints follow a spline
CLOSE = 1e-11  # m, to the path at those points, times its length or 1 m
GUESSES, STEPS = 40, 100
REACH = 0.3  # rad, m: longest step of an iteration


class ToolPath:
    """The tool's origin moves along points, with the profile of ``PointToPoint``.

    Joints follow by inverse kinematics, each time the smallest change that does it; the tool turns as they let it.

    Args:
        kernel: of the rigid robot, with kinematics; all its coordinates may move, as far as its loops let them.
        tool: a frame or link.
        points: (POINTS, 3), m, base axes, at equal parts of the path.
        duration: s.
        guess: coordinates, (n,), near which the first point is looked for.
        limits: lower and upper limits, (n, 2), infinite where there is none.
        start_time: s; until then the tool rests at the first point.
        name: of the path, for messages.

    Raises:
        InputError: SciPy is not installed, or the tool cannot follow within the limits: the point is named.
    """

    def __init__(
        self,
        kernel: Kernel,
        tool: str,
        points: Array,
        duration: float,
        *,
        guess: Array,
        limits: Array,
        start_time: float = 0.0,
        name: str = "path",
    ) -> None:
        with optional_import("SciPy", f"a {name} of the tool needs"):
            from scipy.interpolate import make_interp_spline
        self.profile = PointToPoint(np.zeros(1), np.ones(1), duration, start_time)
        along = np.linspace(0.0, 1.0, POINTS)
        close = CLOSE * max(1.0, float(np.abs(points).max()))
        q = np.empty((POINTS, kernel.n))
        q[0] = _first(kernel, tool, points[0], guess, limits, close)
        for k in range(1, POINTS):
            q[k] = _reached(kernel, tool, points[k], q[k - 1], limits, close, name)
            if not within_limits(q[k], limits):
                worst = int(np.argmax(np.maximum(limits[:, 0] - q[k], q[k] - limits[:, 1])))
                raise InputError(
                    f"{kernel.name}: at {_show(points[k])} on the {name} {kernel.coordinates[worst]} ="
                    f" {q[k, worst]:.4g}; its limits are {limits[worst, 0]:.4g} to {limits[worst, 1]:.4g}"
                )
        spline = make_interp_spline(along, q, k=5)
        self._splines = (spline, spline.derivative(1), spline.derivative(2))

    @property
    def start(self) -> Array:
        """Coordinates at the beginning, (n,)."""
        return self.at(0.0)[0]

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Coordinates, rates and accelerations at times t of any shape; each of shape (*t.shape, n); m, rad, s."""
        s, ds, dds = self.profile.at(t)
        q, by_s, by_ss = (spline(s[..., 0]) for spline in self._splines)
        return q, by_s * ds, by_ss * ds**2 + by_s * dds


class ToolLine(ToolPath):
    """The tool's origin moves straight from one point to another; arguments and errors as ``ToolPath``, and

    Args:
        begin, end: points, (3,), m, base axes.
        start_time: s; until then the tool rests at ``begin``.

    Raises:
        ArrayError: a point that is not three finite numbers.
        InputError: the points coincide.
    """

    def __init__(
        self,
        kernel: Kernel,
        tool: str,
        begin: ArrayLike,
        end: ArrayLike,
        duration: float,
        *,
        guess: Array,
        limits: Array,
        start_time: float = 0.0,
    ) -> None:
        ends = np.array([space_point("begin", begin), space_point("end", end)])
        if np.array_equal(*ends):
            raise InputError(f"line: begins and ends at {_show(ends[0])}; allowed: two different points")
        points = ends[0] + np.linspace(0.0, 1.0, POINTS)[:, np.newaxis] * (ends[1] - ends[0])
        super().__init__(kernel, tool, points, duration, guess=guess, limits=limits, start_time=start_time, name="line")


class ToolCircle(ToolPath):
    """The tool's origin moves along a circle; arguments and errors as ``ToolPath``, and

    Args:
        center, normal: (3,), base axes; the tool turns about the normal as a right-handed screw does.
        begin: a point of the circle, (3,), m, base axes; in the plane through the center across the normal.
        angle: rad, of the whole path.
        start_time: s; until then the tool rests at ``begin``.

    Raises:
        ArrayError: a point that is not three finite numbers.
        InputError: there is no such circle.
    """

    def __init__(
        self,
        kernel: Kernel,
        tool: str,
        center: ArrayLike,
        normal: ArrayLike,
        begin: ArrayLike,
        angle: float,
        duration: float,
        *,
        guess: Array,
        limits: Array,
        start_time: float = 0.0,
    ) -> None:
        middle, axis, first = space_point("center", center), space_point("normal", normal), space_point("begin", begin)
        arm, length = first - middle, float(np.linalg.norm(axis))
        if not (length > 0.0 and np.isfinite(angle) and angle != 0.0 and np.linalg.norm(arm) > 0.0):
            raise InputError("circle: allowed: a normal, an angle and a radius that are not zero")
        axis /= length
        if abs(axis @ arm) > 1e-6 * np.linalg.norm(arm):
            raise InputError(f"circle: {_show(first)} is not in the plane through the center, across the normal")
        arm -= (axis @ arm) * axis
        turn = angle * np.linspace(0.0, 1.0, POINTS)[:, np.newaxis]
        points = middle + np.cos(turn) * arm + np.sin(turn) * np.cross(axis, arm)
        super().__init__(
            kernel, tool, points, duration, guess=guess, limits=limits, start_time=start_time, name="circle"
        )


def _first(kernel: Kernel, tool: str, point: Array, guess: Array, limits: Array, close: float) -> Array:
    """Coordinates within the limits that put the tool there: from the guess, or from others, always the same."""
    missed = np.inf
    for trial in starting_points(guess, limits):
        q, distance = reach(kernel, tool, point, trial, limits, close)
        missed = min(missed, distance)
        if distance <= close and within_limits(q, limits):
            return q
    reason = "not within its limits" if missed <= close else f"it gets as near as {missed:.3g} m"
    raise InputError(f"{kernel.name}: {tool} does not reach {_show(point)}: {reason}")


def starting_points(guess: Array, limits: Array) -> Iterator[Array]:
    yield guess
    rng = np.random.default_rng(0)
    low, high = np.maximum(limits[:, 0], guess - 3.0), np.minimum(limits[:, 1], guess + 3.0)
    for _ in range(GUESSES):
        yield rng.uniform(np.minimum(low, high), high)


def _reached(kernel: Kernel, tool: str, point: Array, q: Array, limits: Array, close: float, name: str) -> Array:
    found, distance = reach(kernel, tool, point, q, limits, close)
    if distance > close or np.abs(found - q).max() > REACH:
        raise InputError(
            f"{kernel.name}: {tool} cannot follow the {name} at {_show(point)}: it is out of reach, or the arm singular"
        )
    return found


def reach(kernel: Kernel, tool: str, point: Array, q: Array, limits: Array, close: float) -> tuple[Array, float]:
    """Levenberg and Marquardt's method: coordinates, and the distance that is left; loops stay closed."""
    if kernel.constraints:
        return _reach_closed(kernel, tool, point, q, limits, close)
    q, damping = q.copy(), 1e-8
    held = limits[:, 0] == limits[:, 1]
    error = point - kernel.frame_pose(q, tool)[:3, 3]
    for _ in range(STEPS):
        distance = float(np.linalg.norm(error))
        if distance <= close:
            break
        J = kernel.frame_jacobian(q, tool)[:3]
        J[:, held] = 0.0
        step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(3), error)
        step *= min(1.0, REACH / max(float(np.abs(step).max()), 1e-300))
        trial = q + step
        left = point - kernel.frame_pose(trial, tool)[:3, 3]
        if np.linalg.norm(left) < distance:
            q, error, damping = trial, left, max(damping / 10.0, 1e-14)
        else:
            damping *= 10.0
    return q, float(np.linalg.norm(error))


def _reach_closed(
    kernel: Kernel, tool: str, point: Array, q: Array, limits: Array, close: float
) -> tuple[Array, float]:
    """``reach`` by the independent coordinates of a closed mechanism; infinitely far where it does not close."""
    held = limits[:, 0] == limits[:, 1]
    try:
        q = kernel.close(q, [name for name, stays in zip(kernel.coordinates, held, strict=True) if stays])
    except LoopError:
        return q, np.inf
    damping, distance = 1e-8, np.inf
    for _ in range(STEPS):
        error = point - kernel.frame_pose(q, tool)[:3, 3]
        distance = float(np.linalg.norm(error))
        chart = Chart(kernel, q, given=held)
        if distance <= close or not chart.free.size:
            break
        J = kernel.frame_jacobian(q, tool)[:3] @ chart.ways(chart.close(q)[1])
        step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(3), error)
        trial = q.copy()
        trial[chart.free] += step * min(1.0, REACH / max(float(np.abs(step).max()), 1e-300))
        try:
            trial = chart.close(trial)[0]
        except LoopError:
            damping *= 10.0
            continue
        if np.linalg.norm(point - kernel.frame_pose(trial, tool)[:3, 3]) < distance:
            q, damping = trial, max(damping / 10.0, 1e-14)
        else:
            damping *= 10.0
    return q, distance


def within_limits(q: Array, limits: Array) -> bool:
    return bool(((limits[:, 0] - 1e-9 <= q) & (q <= limits[:, 1] + 1e-9)).all())


def space_point(label: str, value: ArrayLike) -> Array:
    try:
        point = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ArrayError(f"{label}: {value!r}; allowed: three finite numbers, m")
    return point


def _show(point: Sequence[float] | Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ") m"
