"""A programmed joint motion of a robot with all its coordinates: what its deviations do to the tool.

The principal coordinates follow a smooth point-to-point motion.  Their drives are computed torque on the rigid model,
with a PD law on what is measured: u = ID_rigid(q, v, a_program + w^2 e + 2 w e').  Deviations have no drive.  The robot
starts at rest, in balance under these drives.  Where a motor drives a principal coordinate through a transmission, its
angle over the ratio is measured, its program is the ratio times the joint's, and it gets the drive over the ratio.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._version import __version__
from .equilibrium import static_equilibrium
from .errors import DescriptionError, InputError, UnknownNameError
from .integrate import (
    METHODS,
    IntegrationStopped,
    Progress,
    Trajectory,
    choose_method,
    integrate,
    stiffnesses,
)
from .kernel import Kernel
from .model import build_model
from .motion import PointToPoint, Program
from .pipeline import build
from .result import SimulationResult, index_of, load_result, unit_of
from .robot import MOTOR, PRINCIPAL, Robot

Array = NDArray[np.float64]
Point = Mapping[str, float] | Sequence[float] | Array

MOVING_PART = 0.8  # of the duration; the rest shows what rings after the motion
# What a simulation calls; the larger kernels would take longer to compile than to simulate.
RIGID_KERNELS = ("inverse_dynamics", "kinematics")
KERNELS = (*RIGID_KERNELS, "forward_dynamics", "mass_matrix", "external_force", "energy")
SPAN_ANGULAR, SPAN_LINEAR = np.pi / 4, 0.2  # rad, m: default motion of a joint, if its limits leave room for it

__all__ = [
    "METHODS",
    "ComputedTorque",
    "IntegrationStopped",
    "SimulationResult",
    "Trajectory",
    "default_motion",
    "integrate",
    "load_result",
    "simulate",
    "static_equilibrium",
]


@dataclass(frozen=True)
class ComputedTorque:
    """Drives of the principal coordinates: u = ID_rigid(q, v, a + w^2 (q_d - q) + 2 w (v_d - v)); else 0.

    Of one behind a motor q and v are the motor's over the ratio, and so is the motor's u.
    A drive for ``integrate``; q and v may be (n,) or (N, n).

    Attributes:
        rigid: kernel of the rigid robot; its coordinates are those that are driven.
        motion: their program.
        index: where they, or their motors, are among the robot's coordinates.
        bandwidth: w, rad/s; the error of a rigid robot dies out as exp(-w t), critically damped.
        ratio: of the gears in front of them, (p,), or 1.
    """

    rigid: Kernel
    motion: Program
    index: NDArray[np.intp]
    bandwidth: float
    ratio: Array | float = 1.0
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        q_d, v_d, a_d = self.motion.at(t)
        q_m, v_m = (np.ascontiguousarray(x[..., self.index] / self.ratio) for x in (q, v))
        a = a_d + self.bandwidth * (self.bandwidth * (q_d - q_m) + 2.0 * (v_d - v_m))
        u = np.zeros_like(q)
        u[..., self.index] = self.rigid.inverse_dynamics(q_m, v_m, a) / self.ratio
        return u


def computed_torque(kernel: Kernel, rigid: Kernel, motion: Program, bandwidth: float) -> ComputedTorque:
    """The drives of a robot's kernel that follow a motion of its rigid model's coordinates; see ``ComputedTorque``."""
    motors = {principal: motor for motor, principal in kernel.motors.items()}
    index = index_of(kernel.coordinates, [motors.get(name, name) for name in rigid.coordinates])
    ratios = [kernel.ratio(motors[name]) if name in motors else 1.0 for name in rigid.coordinates]
    return ComputedTorque(rigid, motion, index, float(bandwidth), np.array(ratios) if motors else 1.0)


def simulate(
    robot: Robot,
    *,
    duration: float = 2.0,
    start: Point | None = None,
    goal: Point | None = None,
    motion: Program | None = None,
    bandwidth: float = 30.0,
    tool: str | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    step: float | None = None,
    output_step: float | None = None,
    progress: Progress | None = None,
) -> SimulationResult:
    """Move the robot from start to goal and integrate all its coordinates.

    The motion takes 80 percent of the duration, then its goal is held.  A free joint is held where it is.

    Args:
        robot: with at least one principal coordinate.
        duration: s.
        start, goal: of the principal coordinates, rad or m: a value for each, in their order, or a mapping from names
            ("joint2", "joint2.gamma") to values.  By default from zero (or the nearest pose that is well inside the
            limits) by 45 degrees or 0.2 m to where there is more room, by less if the limits demand it.
        motion: of all coordinates of ``robot.rigid()``, instead of start and goal.
        bandwidth: of the drives' PD law, rad/s.
        tool: frame or link to look at; default "tcp", else the first frame, else a link
            whose name ends with "tcp" or "tool0", else the end of the longest chain.
        method, rtol, step, output_step: see ``integrate``.
        progress: called with a fraction from 0 to 1 and a line of text.

    Raises:
        InputError: an argument is wrong, nothing can be driven, the robot has loops, SciPy is not installed.
        IntegrationError: the motion could not be integrated; see ``integrate``.
    """
    report: Progress = progress or (lambda _fraction, _text: None)
    if not (np.isfinite(bandwidth) and bandwidth > 0.0):
        raise InputError(f"bandwidth: {bandwidth!r} rad/s; a finite number greater than 0 is allowed")
    if not (np.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: {duration!r} s; a finite time greater than 0 is allowed")
    if method not in METHODS:
        raise InputError(f"method: {method!r} is unknown; allowed: {', '.join(METHODS)}")
    if robot.loops:
        loops = ", ".join(loop.name for loop in robot.loops)
        raise InputError(f"simulate: {robot.name} has loops ({loops}); eomgen.loops integrates mechanisms with loops")
    if shaken := build_model(robot).prescribed:
        names = build_model(robot).coordinates
        raise InputError(
            f"{robot.name}: {', '.join(names[i] for i in shaken)} prescribed, and a simulation from point to point has"
            " no motion for that; eomgen.simulate.integrate takes one: prescribed=eomgen.motion.Harmonic(...), say"
        )
    tool = tool_of(robot, tool)
    if motion is not None and (start is not None or goal is not None):
        raise InputError("motion is given together with start or goal; allowed: one of them")
    motion = motion or default_motion(robot, MOVING_PART * duration, _driven(robot), start=start, goal=goal)
    kernel, rigid = _build_both(robot, report)
    drive = computed_torque(kernel, rigid, motion, bandwidth)
    report(0.0, "static equilibrium at the start")
    q0, loose = _balanced_start(kernel, drive)
    options: dict[str, Any] = {"rtol": rtol, "step": step, "output_step": output_step, "progress": progress}
    trajectory = integrate(kernel, q0, np.zeros(kernel.n), duration, drive=drive, method=method, **options)
    program_q = motion.at(trajectory.t)[0]
    return SimulationResult(
        robot.name,
        trajectory,
        rigid.coordinates,
        program_q,
        tool,
        np.asarray(kernel.frame_pose(trajectory.q, tool)),
        np.asarray(rigid.frame_pose(program_q, tool)),
        (*_method_note(kernel, method, trajectory.method), *_assumptions(robot, loose)),
        MappingProxyType({"eomgen": __version__, "numpy": np.__version__, "python": platform.python_version()}),
    )


def default_motion(
    robot: Robot,
    duration: float,
    coordinates: Sequence[str],
    *,
    start: Point | None = None,
    goal: Point | None = None,
) -> PointToPoint:
    """Point-to-point motion of these coordinates (those of ``robot.rigid()``); see ``simulate`` for start and goal.

    Raises:
        InputError: a value outside the joint's limits, a wrong number of them.
        UnknownNameError: a name that is no principal coordinate.
    """
    if not (np.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: {duration!r} s; a motion takes a finite time greater than 0")
    default_start, default_goal = [], []
    for name in coordinates:
        limits, held = _limits(robot, name)
        begin, end = (0.0, 0.0) if held else _default_span(limits, unit_of(name))
        default_start.append(begin)
        default_goal.append(end)
    first = _point(robot, coordinates, "start", start, np.array(default_start))
    last = _point(robot, coordinates, "goal", goal, np.array(default_goal))
    return PointToPoint(first, last, duration, names=tuple(coordinates))


def _driven(robot: Robot) -> tuple[str, ...]:
    """Names of the coordinates of the rigid model."""
    try:
        return build_model(robot.rigid()).coordinates
    except DescriptionError:
        raise InputError(
            f"{robot.name}: no joint has a principal coordinate, so there is nothing to drive; "
            "eomgen.simulate.integrate integrates free motions"
        ) from None


def _build_both(robot: Robot, report: Progress) -> tuple[Kernel, Kernel]:
    """Kernels of the robot and of its rigid model; one and the same if nothing deviates."""
    kernel = build(robot, kernels=KERNELS, progress=lambda text: report(0.0, text))
    if len(_driven(robot)) == kernel.n:
        return kernel, kernel
    rigid = build(robot.rigid(), kernels=RIGID_KERNELS, progress=lambda text: report(0.0, f"rigid model: {text}"))
    return kernel, rigid


def tool_of(robot: Robot, tool: str | None) -> str:
    """The frame to look at; by default "tcp", the first frame, a link called so, or the end of the longest chain."""
    known = build_model(robot).frames
    if tool is not None and tool not in known:
        raise UnknownNameError(f"tool: {tool!r} is unknown; known: {', '.join(known)}")
    depth = {robot.base: 0}
    for joint in robot.joints:
        depth[joint.child] = depth[joint.parent] + bool(joint.coordinates)
    candidates = ["tcp"] if "tcp" in known else [frame.name for frame in robot.frames]
    candidates += [name for name in known if name.endswith(("tcp", "tool0"))]
    return tool or (candidates[0] if candidates else max(depth, key=lambda name: depth[name]))


def _balanced_start(kernel: Kernel, drive: ComputedTorque) -> tuple[Array, tuple[str, ...]]:
    """Equilibrium under the drives at t = 0, and the names of the coordinates that nothing holds.

    Inside a clearance nothing does, so that its coordinate starts in the middle; with a joint that has backlash the
    motor takes up its side.
    """
    guess = np.zeros(kernel.n)
    guess[index_of(kernel.coordinates, drive.rigid.coordinates)] = drive.motion.start
    guess[drive.index] = drive.motion.start * drive.ratio
    played = {kernel.motors.get(name, name) for name in kernel.coordinates if _has_play(kernel, name)}
    driven = {kernel.coordinates[i] for i in drive.index}
    loose = tuple(
        name
        for name, k in zip(kernel.coordinates, stiffnesses(kernel), strict=True)
        if (k == 0.0 or name in played) and name not in driven
    )
    q0, _ = static_equilibrium(kernel, guess, u=lambda q: drive(0.0, q, np.zeros_like(q)), held=loose)
    return q0, loose


def _has_play(kernel: Kernel, name: str) -> bool:
    return f"joints.{name}.clearance" in kernel.parameters


def _method_note(kernel: Kernel, asked: str, taken: str) -> tuple[str, ...]:
    if asked != "auto":
        return ()
    if choose_method(kernel) == "DOP853":
        return (f"method: {taken} (explicit), because nothing has a stiffness",)
    return (
        f"method: {taken} (implicit), because there are springs; its steps follow the motion, not the fastest spring",
    )


def _assumptions(robot: Robot, loose: tuple[str, ...]) -> tuple[str, ...]:
    notes = []
    if robot.rigid().joints == robot.joints:
        notes.append("no joint has a deviation: what the tool is off by is the integration's error")
    free = [joint.name for joint in robot.joints if joint.type == "free"]
    if free:
        notes.append(f"free joint {', '.join(free)}: held where it is by drives on all its six coordinates")
    motors = [f"{joint.name}.{MOTOR}" for joint in robot.joints if joint.motor]
    if motors:
        notes.append(f"drives act at {', '.join(motors)} and know their angles alone, not their joints'")
    if loose:
        why = "without a stiffness of its own or a drive, or inside a clearance"
        notes.append(f"{why}, so not in balance at the start: {', '.join(loose)}")
    return tuple(notes)


def principal_limits(robot: Robot, coordinate: str) -> tuple[float, float]:
    """Limits of a driven coordinate, m or rad; infinite if there are none, zero where it is held: of a free joint."""
    limits, held = _limits(robot, coordinate)
    return (0.0, 0.0) if held else limits


def _limits(robot: Robot, coordinate: str) -> tuple[tuple[float, float], bool]:
    """Limits of a driven coordinate (infinite if there are none), and whether it is held: one of a free joint."""
    joint_name, _, name = coordinate.rpartition(".")
    joint = robot.joint(joint_name)
    if PRINCIPAL.get(joint.type) != name:
        return (-np.inf, np.inf), True
    return joint.limits or (-np.inf, np.inf), False


def _default_span(limits: tuple[float, float], unit: str) -> tuple[float, float]:
    """Start near zero, well inside the limits, and a goal on the side where there is more room."""
    low, high = limits
    span = SPAN_ANGULAR if unit == "rad" else SPAN_LINEAR
    if not (np.isfinite(low) and np.isfinite(high)):
        low, high = max(low, -4.0 * span), min(high, 4.0 * span)
        if low >= high:  # one limit, beyond the default span
            low, high = (low, low + 4.0 * span) if np.isfinite(limits[0]) else (high - 4.0 * span, high)
    margin = 0.1 * (high - low)
    start = min(max(0.0, low + margin), high - margin)
    length = min(span, 0.4 * (high - low))
    return start, start + length if high - start >= start - low else start - length


def _point(robot: Robot, coordinates: Sequence[str], label: str, given: Point | None, default: Array) -> Array:
    """The point of all driven coordinates, from what the user gave, inside the limits."""
    if given is None:
        return default
    point: Array = default.copy()
    movable = [i for i, name in enumerate(coordinates) if not _limits(robot, name)[1]]
    if isinstance(given, Mapping):
        places = {coordinates[i]: i for i in movable} | {coordinates[i].rpartition(".")[0]: i for i in movable}
        for name, value in given.items():
            if name not in places:
                known = ", ".join(coordinates[i] for i in movable)
                raise UnknownNameError(f"{label}: {name!r} is no principal coordinate; known: {known}")
            point[places[name]] = _number(f"{label}: {name}", value)
    else:
        values = list(given) if np.ndim(given) == 1 else []
        if len(values) != len(movable):
            names = ", ".join(coordinates[i] for i in movable)
            raise InputError(f"{label}: expected {len(movable)} numbers ({names}), got {np.size(given)}")
        point[movable] = [_number(f"{label}: {coordinates[i]}", v) for i, v in zip(movable, values, strict=True)]
    for i in movable:
        low, high = _limits(robot, coordinates[i])[0]
        if not low - 1e-9 <= point[i] <= high + 1e-9:
            unit = unit_of(coordinates[i])
            raise InputError(
                f"{label}: {coordinates[i]} = {point[i]:g} {unit}; its limits are {low:g} to {high:g} {unit}"
            )
    return point


def _number(label: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{label} = {value!r} is not a number") from None
    if not np.isfinite(number):
        raise InputError(f"{label} = {number} is not finite")
    return number
