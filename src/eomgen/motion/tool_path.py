"""A path of a tool, straight, round or through points, as a motion of a robot's principal coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Required, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, InputError, ReachError
from ..forms.unusual_sizes import is_unusual, unit_question
from ..kernel.complete import Kernel
from ..kernel.inverse_kinematics.reaching import (
    Reached,
    Target,
    binding,
    point_text,
    reach,
    search,
    unreached,
    within_limits,
)
from ..kernel.inverse_kinematics.rotations import rotation_matrices
from ..kernel.stepping.input_signals import Signal
from ..names import show
from ..optional import optional_import
from ..runtime.arrays import numbers_in
from .point_to_point import QUINTIC, PointToPoint
from .splines import DEGREE, Spline, inner_knots, spline_signal
from .time_derivatives import Jump, by_time, composed, order_in, spline_series
from .turns import spherical, spherical_spline

Orientation = Literal["keep"] | tuple[ArrayLike | None, ArrayLike | None]

POINTS = 201  # of the path, between which joints follow a spline
FEWEST = 20  # of them between two points of a spline
JUMP = 0.3  # rad, m: a coordinate that changes by more between two of them has left the way
NEAR_LIMIT = 0.1  # of a coordinate's range: where it begins to spare its limit
LEAST_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Turning:
    """Orientations of a tool along its path.

    Attributes:
        first: at the beginning, (3, 3); None leaves it to the coordinates from which the path begins.
        along: from the first orientation to those at all points, (P, 3, 3).
    """

    first: Array | None
    along: Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Course:
    """Points of a tool's path.

    Attributes:
        name: of the path, for messages.
        points: (P, 3), m, base frame.
        parts: fraction of the path's length before them, (P,).
        t: when they are passed, (P,), s.
        turning: its orientations; None leaves them open.
    """

    name: str
    points: Array
    parts: Array
    t: Array
    turning: Turning | None = None

    def text(self, k: int) -> str:
        """Say where and when the point k is, for messages."""
        return f"{100.0 * self.parts[k]:.3g} % of its length, t = {self.t[k]:.4g} s"


class PathKeywords(TypedDict, total=False):
    """Keywords of ``ToolPath`` that lines and circles have, too."""

    guess: Required[Array]
    limits: Required[Array]
    start_time: float
    orientation: Orientation | None
    smooth: int


class ToolPath:
    """The tool's origin moves along points, with the profile of ``PointToPoint``; without an orientation it turns as
    the joints let it.

    Joints follow by inverse kinematics, each time by the least change that does it: the sum of squares of all
    coordinates' changes, rad and m alike.  Where that leads out of the limits, coordinates near their limits count more
    instead, up to a million times.

    Args:
        kernel: of the rigid robot, with kinematics; all its coordinates may move, as far as its loops let them.
        tool: a frame or link.
        points: (POINTS, 3), m, base frame, at equal parts of the path.
        duration: s.
        guess: coordinates, (n,), near which the first point is looked for.
        limits: lower and upper limits, (n, 2), infinite where there is none.
        start_time: s; until then the tool rests at the first point.
        name: of the path, for messages.
        orientation: of the tool's axes: "keep" holds that with which the path begins; a pair of rotations, (3, 3), is
            turned from the first to the second along the path, about one axis.  Without the first, the path begins with
            the orientation to which the least change from the guess leads; without the second, the first stays.
        smooth: of the profile, see ``PointToPoint``.

    Raises:
        InputError: SciPy is not installed, or another smoothness.
        ReachError: the tool cannot follow within the limits; says where, when and by how much.
        ArrayError: an orientation that is no rotation.
    """

    def __init__(  # noqa: PLR0913
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
        orientation: Orientation | None = None,
        smooth: int = QUINTIC,
    ) -> None:
        with optional_import("SciPy", f"a {name} of the tool needs"):
            from scipy.interpolate import make_interp_spline
        self.profile = PointToPoint(np.zeros(1), np.ones(1), duration, start_time, smooth=smooth)
        along = np.linspace(0.0, 1.0, len(points))
        times = np.linspace(start_time, start_time + duration, 20 * POINTS)
        when = np.interp(along, self.profile.at(times)[0][:, 0], times)
        course = Course(name, points, along, when, _turning(orientation, along))
        spline = make_interp_spline(
            along, _followed(kernel, tool, course, guess, limits), k=_degree(self.profile.smooth)
        )
        self._splines = (spline, spline.derivative(1), spline.derivative(2))

    @property
    def start(self) -> Array:
        """Coordinates at the beginning, (n,)."""
        return self.at(0.0)[0]

    @property
    def end(self) -> float:
        """The time from which the tool rests, s."""
        return self.profile.end

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times t of any shape.

        Each of shape (*t.shape, n); m, rad, s.
        """
        s, ds, dds = self.profile.at(t)
        q, by_s, by_ss = (spline(s[..., 0]) for spline in self._splines)
        return q, by_s * ds, by_ss * ds**2 + by_s * dds

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, n); see ``with_series``."""
        inner = self.profile.series(t, order)
        return composed(spline_series(self._splines[0], inner[0, ..., 0], order_in(order)), inner)

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump, by time; see ``with_series``."""
        spline = self._splines[0]
        low, high = (np.full(inner_knots(spline).shape, t) for t in (self.profile.begin, self.profile.end))
        for _ in range(60):  # the profile rises: bisection
            middle = 0.5 * (low + high)
            late = self.profile.at(middle)[0][:, 0] > inner_knots(spline)
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        return by_time([*self.profile.jumps(order), *(Jump(t, spline.k) for t in high.tolist())], order)

    def as_signal(self) -> Signal:
        """Return it as data for integrations in C."""
        return spline_signal(self._splines[0], self.profile.as_signal())


class ToolLine(ToolPath):
    """The tool's origin moves straight from one point to another; arguments and errors as ``ToolPath``, and

    Args:
        begin, end: points, (3,), m, base frame.
        **options: guess, limits, start_time, orientation and smooth, as ``ToolPath`` has them.

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
        **options: Unpack[PathKeywords],
    ) -> None:
        ends = np.array([space_point("begin", begin), space_point("end", end)])
        if np.array_equal(*ends):
            raise InputError(f"line: begins and ends at {point_text(ends[0])}; allowed: two different points")
        points = ends[0] + np.linspace(0.0, 1.0, POINTS)[:, np.newaxis] * (ends[1] - ends[0])
        super().__init__(kernel, tool, points, duration, name="line", **options)


class ToolCircle(ToolPath):
    """The tool's origin moves along a circle; arguments and errors as ``ToolPath``, and

    Args:
        center, normal: (3,), base frame; the tool turns about the normal as a right-handed screw does.
        begin: a point of the circle, (3,), m, base frame; in the plane through the center across the normal.
        angle: rad, of the whole path.
        **options: guess, limits, start_time, orientation and smooth, as ``ToolPath`` has them.

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
        **options: Unpack[PathKeywords],
    ) -> None:
        middle, axis, first = space_point("center", center), space_point("normal", normal), space_point("begin", begin)
        arm, length = first - middle, float(np.linalg.norm(axis))
        if not (length > 0.0 and np.isfinite(angle) and angle != 0.0 and np.linalg.norm(arm) > 0.0):
            raise InputError("circle: allowed: a normal, an angle and a radius that are not zero")
        axis /= length
        if abs(axis @ arm) > 1e-6 * np.linalg.norm(arm):
            raise InputError(f"circle: {point_text(first)} is not in the plane through the center, across the normal")
        arm -= (axis @ arm) * axis
        turn = angle * np.linspace(0.0, 1.0, POINTS)[:, np.newaxis]
        points = middle + np.cos(turn) * arm + np.sin(turn) * np.cross(axis, arm)
        super().__init__(kernel, tool, points, duration, name="circle", **options)


class ToolSpline(Spline):
    """The tool passes points in space at these times, at rest at the first and the last.

    Its origin follows a ``Spline``; orientations are interpolated spherically, with continuous angular
    velocity and acceleration (``turns.spherical_spline``).

    Args:
        kernel, tool, guess, limits: as ``ToolPath`` has them.
        points: (K, 3), m, base frame, two or more.
        times: (K,), s, rising.
        orientation: "keep", or the tool's axes at the points as columns, (K, 3, 3); open by default.
        smooth: k, from 2 to 6, see ``Spline``.

    Raises:
        ArrayError: arrays that do not fit together, or are not finite; other errors as ``ToolPath``.
    """

    def __init__(
        self,
        kernel: Kernel,
        tool: str,
        points: ArrayLike,
        times: ArrayLike,
        *,
        guess: Array,
        limits: Array,
        orientation: Literal["keep"] | ArrayLike | None = None,
        smooth: int = QUINTIC,
    ) -> None:
        rising = "two or more finite numbers that rise, s"
        knots = numbers_in("times", times, rising)
        if knots.ndim != 1 or knots.size < 2 or not (np.diff(knots) > 0.0).all():
            raise ArrayError(f"times: {show(times)}; allowed: {rising}")
        allowed = f"finite numbers ({knots.size}, 3), m"
        places = numbers_in("points", points, allowed)
        if places.shape != (knots.size, 3):
            raise ArrayError(f"points: got shape {places.shape}; allowed: {allowed}")
        pieces = max(FEWEST, -(-(POINTS - 1) // (knots.size - 1)))
        t = np.interp(np.arange(pieces * (knots.size - 1) + 1) / pieces, np.arange(knots.size), knots)
        way = Spline(knots, places, at_rest=True, smooth=smooth).at(t)[0]
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
        parts = lengths / lengths[-1] if lengths[-1] > 0.0 else np.linspace(0.0, 1.0, t.size)
        turning = None
        if isinstance(orientation, str):
            turning = _turning(_keep(orientation), parts)
        elif orientation is not None:
            rotations = rotation_matrices("orientation", orientation, (knots.size,))
            turning = Turning(rotations[0], lambda _: spherical_spline(knots, rotations, t, smooth))
        course = Course("spline", way, parts, t, turning)
        super().__init__(t, _followed(kernel, tool, course, guess, limits), at_rest=True, smooth=smooth)


def _degree(smooth: int) -> int:
    """Return the degree of splines along a path that are of the class C^smooth."""
    return max(DEGREE, smooth + 1 + smooth % 2)


def _keep(orientation: str) -> Literal["keep"]:
    if orientation != "keep":
        raise InputError(f"orientation: got {show(orientation)}; allowed: 'keep', or rotations")
    return "keep"


def _turning(orientation: Orientation | None, parts: Array) -> Turning | None:
    if orientation is None:
        return None
    ends = (None, None) if isinstance(orientation, str) and _keep(orientation) else orientation
    first, last = (None if R is None else rotation_matrices("orientation", R) for R in ends)
    return Turning(first, lambda begin: spherical(begin, begin if last is None else last, parts))


def _followed(kernel: Kernel, tool: str, course: Course, guess: Array, limits: Array) -> Array:
    """Return coordinates at the points of a course, (P, n); errors as of ``ToolPath``."""
    turning = course.turning
    target = Target(tool, course.points[0], None if turning is None else turning.first)
    begun = _first(kernel, target, course, guess, limits)
    axes = None
    if turning is not None:
        axes = turning.along(kernel.frame_pose(begun, tool)[:3, :3] if turning.first is None else turning.first)
    targets = [Target(tool, point, None if axes is None else axes[k]) for k, point in enumerate(course.points)]
    try:
        return _tracked(kernel, targets, course, begun, limits, sparing=False)
    except _LimitError as left:
        try:
            return _tracked(kernel, targets, course, begun, limits, sparing=True)
        except (ReachError, _LimitError):
            raise left.error from None


class _LimitError(Exception):
    """The least motion leaves the limits; ``error`` says where."""

    def __init__(self, error: ReachError) -> None:
        super().__init__(str(error))
        self.error = error


def _first(kernel: Kernel, target: Target, course: Course, guess: Array, limits: Array) -> Array:
    reached, is_there = search(kernel, target, guess, limits)
    if is_there:
        return reached.q
    label = f"{target.tool} does not reach {target.text()}"
    raise unreached(kernel, target, reached, limits, label, remark=far_point(target))


def _tracked(
    kernel: Kernel, targets: list[Target], course: Course, begun: Array, limits: Array, *, sparing: bool
) -> Array:
    """Return coordinates at all targets, each from those before; ``sparing`` is for those near their limits."""
    q = np.empty((len(targets), len(kernel.coordinates)))
    q[0] = begun
    for k in range(1, len(targets)):
        weights = _willingness(q[k - 1], limits) if sparing else None
        reached = reach(kernel, targets[k], q[k - 1], limits, weights=weights)
        jump = np.abs(reached.q - q[k - 1])
        label = f"{targets[k].tool} cannot follow the {course.name} at {targets[k].text()}"
        if not reached.is_there:
            hint = "it is out of reach, or the arm singular: it misses by"
            label = f"{label}, {course.text(k)}"
            raise unreached(kernel, targets[k], reached, limits, label, hint, far_point(targets[k]))
        if jump.max() > JUMP:
            name, most = kernel.coordinates[int(jump.argmax())], float(jump.max())
            what = f"the arm is singular there, {name} would jump by {most:.3g}"
            raise ReachError(
                f"{kernel.name}: {label}, {course.text(k)}: {what}", reached.distance, reached.angle, reached.q
            )
        if not within_limits(reached.q, limits):
            raise _LimitError(_beyond(kernel, targets[k], reached, q[k - 1], limits, label, course, k))
        q[k] = reached.q
    return q


def _willingness(q: Array, limits: Array) -> Array:
    """Return weights of coordinates, (n,): less than 1 near a limit, smoothly."""
    low, high = limits.T
    with np.errstate(invalid="ignore"):
        room = np.minimum(q - low, high - q) / (NEAR_LIMIT * (high - low))
    share = np.clip(np.where(np.isfinite(room), room, 1.0), 0.0, 1.0)
    return np.asarray(np.maximum(share**2 * (3.0 - 2.0 * share), LEAST_WEIGHT))


def _beyond(
    kernel: Kernel, target: Target, reached: Reached, before: Array, limits: Array, label: str, course: Course, k: int
) -> ReachError:
    """The error of a point that is reached beyond the limits alone."""
    inside = reach(kernel, target, before, limits, bounded=True)
    within = "" if inside.is_there else f"; within them it misses by {inside.text()}"
    what = f"{binding(kernel, target, reached, limits)}{within}"
    return ReachError(f"{kernel.name}: {label}, {course.text(k)}: {what}", inside.distance, inside.angle, inside.q)


def far_point(target: Target) -> str:
    """Ask whether a point that is far away is in other units; "" of others."""
    axes = zip("xyz", target.point.tolist(), strict=True)
    return next((unit_question(axis, x, "m") for axis, x in axes if is_unusual(x, "m")), "")


def space_point(label: str, value: ArrayLike) -> Array:
    allowed = "three finite numbers, m"
    point = numbers_in(label, value, allowed)
    if point.shape != (3,):
        raise ArrayError(f"{label}: got shape {point.shape}; allowed: {allowed}")
    return point
