"""Reference trajectories of the driven coordinates by a scenario, and prescribed motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError, ReachError
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import Track, Waves
from ..motion.ends import default_ends, limits_beside, point_of
from ..motion.files import MeasuredMotion, read_motion
from ..motion.point_to_point import QUINTIC, PointToPoint, Program, smoothness
from ..motion.splines import Columns, Spline
from ..motion.time_derivatives import Jump, by_time, waves
from ..motion.tool_path import Orientation, ToolCircle, ToolLine, ToolSpline
from ..robot.coordinates import coordinate_names
from ..robot.geometry import Vector, rotation_from_rpy
from ..robot.value import Robot
from ..scenario.value import Scenario, Section

MOVING_SHARE = 0.8  # of the duration; the rest shows what rings after the motion


class PrescribedMotion:
    """Motions of prescribed coordinates, each harmonic or a spline; t -> (q, v, a), (m,) each."""

    def __init__(
        self, scenario: Scenario, coordinates: Sequence[str], names: Sequence[str], principal: Mapping[str, str]
    ) -> None:
        numbers = np.zeros((4, len(names)))  # amplitude, frequency, phase, offset
        seen: dict[str, str] = {}
        self._splines: list[tuple[Spline, list[int], list[int]]] = []

        def take(name: str, key: str) -> int:
            if name not in names:
                scenario.refuse(key, name, names, "is no prescribed coordinate")
            if name in seen:
                scenario.fail(key, f"the motion of {name} is there already, by {seen[name]}; allowed: once")
            seen[name] = key
            return names.index(name)

        for place, section in enumerate(scenario.prescribed):
            key = f"prescribed[{place}]"
            if section.type == "harmonic":
                name = section.get("coordinate")
                i = take(principal.get(name, name), f"{key}.coordinate")
                numbers[:, i] = [section.get(name, 0.0) for name in ("amplitude", "frequency", "phase", "offset")]
                continue
            motion = read_motion(section.get("file"), coordinates, principal=principal)
            _check_covers(scenario, f"{key}.file", motion)
            here = [take(name, f"{key}.file") for name in motion.measured]
            columns = [coordinates.index(name) for name in motion.measured]
            self._splines.append((Spline(motion.t, motion.q[:, columns], at_rest=False), here, columns))
        missing = [name for name in names if name not in seen]
        if missing:
            scenario.fail(
                "prescribed",
                f"the motion of {', '.join(missing)} is missing; allowed: one [[prescribed]] entry for each",
            )
        self._numbers = numbers

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        amplitude, frequency, phase, offset = self._numbers
        omega = 2.0 * np.pi * frequency
        wave = amplitude * np.sin(omega * t + phase)
        q, v, a = offset + wave, amplitude * omega * np.cos(omega * t + phase), -(omega**2) * wave
        for spline, here, _ in self._splines:
            q[here], v[here], a[here] = spline.at(t)
        return q, v, a

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, m)."""
        rows = waves(self._wave, t, order)
        for spline, here, _ in self._splines:
            rows[..., here] = spline.series(t, order)
        return rows

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump, by time: at ends and knots of sampled motions."""
        return by_time((jump for spline, _, _ in self._splines for jump in spline.jumps(order)), order)

    @property
    def _wave(self) -> Array:
        amplitude, frequency, phase, offset = self._numbers
        return np.stack([amplitude, 2.0 * np.pi * frequency, phase, offset], axis=1)

    def load_data(self) -> Waves:
        """Return the time-signal inputs for integrations in C."""
        return Waves(self._wave, [Track(spline.as_signal(), np.array(here)) for spline, here, _ in self._splines])


def _check_covers(scenario: Scenario, key: str, motion: MeasuredMotion) -> None:
    if motion.t.size < 2 or motion.t[0] > 0.0 or motion.t[-1] < scenario.duration:
        span = f"{motion.t[0]:g} to {motion.t[-1]:g} s"
        scenario.fail(
            key, f"{motion.source} has {span}; allowed: samples from 0 to the duration, {scenario.duration:g} s"
        )


def make_reference(
    scenario: Scenario,
    robot: Robot,
    driven: Sequence[str],
    rigid: Callable[[], Kernel],
    tool: str,
    initial_q: Mapping[str, float],
) -> Program:
    """Return the reference trajectory of a scenario.

    Args:
        scenario: with a motion.
        robot: whose limits hold.
        driven: names of the driven coordinates, the columns of the reference.
        rigid: gives the kernel of the rigid robot, with kinematics; its coordinates are the driven and the prescribed.
        tool: frame of lines and circles if they name none.
        initial_q: initial positions by coordinate: of driven ones where the reference may begin, of prescribed ones
            where they are.

    Raises:
        InputError: a name or number does not fit the robot, or the tool cannot follow.
    """
    section = scenario.motion
    assert section is not None
    start, goal = default_ends(robot, driven)
    start = np.array([initial_q.get(name, x) for name, x in zip(driven, start, strict=True)])
    begin = section.get("begin", 0.0)
    duration = section.get("duration", MOVING_SHARE * (scenario.duration - begin))
    if duration <= 0.0:
        scenario.fail("motion.begin", f"got {begin:g}; allowed: before the end, {scenario.duration:g} s")

    def label(key: str) -> str:
        return scenario.label(f"motion.{key}")

    if section.type == "point_to_point":
        first = point_of(robot, driven, label("start"), section.get("start"), start)
        last = point_of(robot, driven, label("goal"), section.get("goal"), goal)
        return PointToPoint(first, last, duration, begin, tuple(driven), _smooth(section))
    if section.type == "via":
        return _via(section, robot, driven, label, start)
    if section.type == "sampled":
        motion = read_motion(section.get("file"), coordinate_names(robot), principal=robot.principal_coordinates)
        names = [name for name in motion.measured if name in driven]
        if not names or motion.t.size < 2:
            scenario.fail(
                "motion.file", f"{motion.source} has no motion of a driven coordinate; allowed: {', '.join(driven)}"
            )
        points = np.tile(start, (motion.t.size, 1))
        points[:, [driven.index(name) for name in names]] = motion.q[:, [motion.coordinates.index(n) for n in names]]
        return Spline(motion.t, points, at_rest=False)
    guess = start if robot.is_closed else (start + goal) / 2  # where loops are known to close
    turned = section.get("orientation") is not None or section.get("rpy") is not None
    if turned:  # its orientation is to be that of the pose from which the scenario begins, as far as it says
        guess = np.where([name in initial_q for name in driven], start, guess)
    model = rigid()
    guesses = dict(zip(driven, guess, strict=True)) | {
        name: x for name, x in initial_q.items() if name in model.coordinates
    }
    return _tool_reference(scenario, section, robot, driven, model, tool, guesses, (begin, duration))


def _via(section: Section, robot: Robot, driven: Sequence[str], label: Callable[[str], str], start: Array) -> Spline:
    points = [start]
    for i, point in enumerate(section.get("points")):
        points.append(point_of(robot, driven, label(f"points.{i}"), point, points[-1]))
    path = np.array(points[1:])
    distances = [float(np.abs(b - a).max()) for a, b in pairwise(path)]
    if section.get("times") is None and min(distances) <= 0.0:
        place = label(f"points.{int(np.argmin(distances)) + 1}")
        raise InputError(f"{place}: is where the point before is; allowed: another point, or times instead of speed")
    return Spline(_times(section, distances), path, at_rest=True, smooth=_smooth(section))


def _smooth(section: Section) -> int:
    return smoothness(section.get("smooth", QUINTIC))


def _times(section: Section, distances: Sequence[float]) -> Array:
    """Return when points are passed, (K,), s: the section's times, or by the speeds over the distances between them."""
    if section.get("times") is not None:
        return np.array(section.get("times"))
    spans = np.array(distances) / section.get("speed")
    return np.asarray(section.get("begin", 0.0) + np.concatenate([[0.0], np.cumsum(spans)]))


def _tool_reference(
    scenario: Scenario,
    section: Section,
    robot: Robot,
    driven: Sequence[str],
    rigid: Kernel,
    tool: str,
    guesses: Mapping[str, float],
    span: tuple[float, float],
) -> Program:
    frame = section.get("frame", tool)
    if frame not in rigid.frames:
        scenario.refuse("motion.frame", frame, rigid.frames)
    where = np.array([guesses.get(name, 0.0) for name in rigid.coordinates])
    limits = limits_beside(robot, rigid.coordinates, driven, where)
    index = np.array([rigid.coordinates.index(name) for name in driven], dtype=np.intp)
    begin, duration = span
    options: dict[str, Any] = {"guess": where, "limits": limits, "smooth": _smooth(section)}
    try:
        if section.type == "spline":
            return Columns(_spline(section, rigid, frame, options), index)
        options |= {"start_time": begin, "orientation": _orientation(section.get("orientation"))}
        if section.type == "line":
            ends = (section.get("from"), section.get("to"))
            return Columns(ToolLine(rigid, frame, *ends, duration, **options), index)
        center, normal, start = (section.get(key) for key in ("center", "normal", "from"))
        angle = section.get("angle", 2.0 * np.pi)
        return Columns(ToolCircle(rigid, frame, center, normal, start, angle, duration, **options), index)
    except ReachError as error:
        message = f"{scenario.label('motion')}: {error}"
        raise ReachError(message, error.distance, error.angle, error.q) from None
    except InputError as error:
        raise InputError(f"{scenario.label('motion')}: {error}") from None


def _orientation(entry: str | Mapping[str, Vector] | None) -> Orientation | None:
    """Return the orientation of a line or circle, from its table's entry."""
    if entry is None:
        return None
    if isinstance(entry, str):
        return "keep"
    first, last = (None if entry.get(key) is None else rotation_from_rpy(entry[key]) for key in ("from", "to"))
    return first, last


def _spline(section: Section, rigid: Kernel, frame: str, options: Mapping[str, Any]) -> ToolSpline:
    points, rpy = np.array(section.get("points")), section.get("rpy")
    distances = [float(np.linalg.norm(b - a)) for a, b in pairwise(points)]
    orientation = section.get("orientation") if rpy is None else [rotation_from_rpy(angles) for angles in rpy]
    return ToolSpline(rigid, frame, points, _times(section, distances), orientation=orientation, **options)
