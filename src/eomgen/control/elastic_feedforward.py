"""Feed-forward of elastic gears: positions, velocities and torques of motors by which links follow a motion.

With tau the inverse dynamics of the links' side along the motion, a motor has the angle ratio (q + e), where the gear
transmits phi(e) + d e' = tau; its torque is that of its rotor and tau / ratio.  Time derivatives of tau are exact:
the kernel's jets.

Source: A. De Luca, "Feedforward/Feedback Laws for the Control of Flexible Robots", IEEE ICRA (2000).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..description import RobotLike, as_robot
from ..errors import ArrayError, InputError
from ..kernel.complete import Kernel
from ..limits import LARGEST, is_usable
from ..motion.time_derivatives import Jump, SmoothProgram, by_time, with_series
from ..names import listed, show
from ..pipeline.building import build
from ..progress import StageReport, no_report, tells_at_prompt
from ..robot.coordinates import coordinate_names, index_of
from ..robot.mechanism import driven_coordinates, leading_home
from ..robot.model import build_model, program_coordinates, tool_of
from ..robot.value import MOTOR, Robot
from ..runtime.arrays import numbers_in
from ..scenario.load import as_scenario
from ..scenario.value import Scenario
from ..simulation.assembly import by_coordinate
from ..simulation.mechanism import mechanism_of
from ..simulation.references import PrescribedMotion, make_reference
from .feedforward_result import FeedForward, left_out
from .gears import FINER, Gears, check_kinks, deflections, finer, gears_of, principal_of
from .inversion.feedforward import SAMPLES, InverseSamples, inverse_feedforward
from .link_friction import smoothing_notes, with_smooth_friction

MotionLike: TypeAlias = "SmoothProgram | Scenario | str | Path | Mapping[str, Any]"


class _Course(NamedTuple):
    """A motion for one robot, at times, (T,), s, and notes about it; ``start`` is where coordinates begin, by name."""

    program: SmoothProgram
    prescribed: Any
    t: Array
    start: Mapping[str, float]
    notes: tuple[str, ...]


@tells_at_prompt("feed-forward")
def feedforward(
    robot: RobotLike,
    motion: MotionLike,
    *,
    t: ArrayLike | None = None,
    prescribed: Any = None,
    friction_smoothing: float | None = None,
    outputs: Sequence[str] | None = None,
    tolerance: float | None = None,
    progress: StageReport | None = None,
) -> FeedForward:
    """Return positions, velocities and torques of drives by which the links of a robot follow a motion.

    Deflections of elastic gears follow from the forces that they transmit: of springs, cubic ones and measured curves
    by their inverse, and with a damper by a stable filter.  Of a robot with deviations that nothing drives all
    coordinates are those of a ``stable_inversion``, whose drives may begin before the motion, at times below 0.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        motion: a scenario with a motion, as ``run_scenario`` takes it, or a reference trajectory of all driven
            coordinates of ``robot.rigid()``, with time derivatives as of ``PointToPoint(..., smooth=4)``.
        t: times of the samples, (T,), s, increasing; default those of the scenario, or 1000 steps until
            the motion ends.
        prescribed: motion of prescribed coordinates beside a reference trajectory, such as ``Harmonic``.
        outputs: where deviations have no drive, what follows the motion, as of ``stable_inversion``: default the pose
            of the tool with six drives, else the driven coordinates.
        tolerance: m or rad, of the steps of a stable inversion.
        friction_smoothing: m/s or rad/s, over which Coulomb friction of links reverses; default 2 percent of a
            coordinate's highest velocity.  The residual says what that leaves of it.
        progress: called with a line of text when a stage of building begins.

    Raises:
        InputError: the motion is not smooth enough, a gear has backlash, internal states or no spring, a gear without a
            damper passes a jump of its spring's slope, a coordinate has no drive and a stable inversion does not
            determine it; each by its name.
        LoopError: loops do not close along the motion.
        IntegrationError: a stable inversion does not converge.
    """
    robot, report = as_robot(robot), progress or no_report
    check_smoothing(friction_smoothing)
    links = links_alone(robot)
    loose = _loose(robot, links)
    _check_driven(robot, links)
    if loose:
        samples = InverseSamples(None if t is None else _times(t), outputs, tolerance, friction_smoothing)
        return inverse_feedforward(robot, motion, loose, samples, report)
    for name, given in (("outputs", outputs), ("tolerance", tolerance)):
        if given is not None:
            raise InputError(f"{name}: {show(given)}; allowed: with deviations that nothing drives")
    gears = gears_of(robot)
    course = _scenario_course(robot, motion, t) if _is_scenario(motion) else _course(robot, motion, t, prescribed)
    report(f"building kernels of {links.name}")
    order = 0 if gears is None else (1 if gears.damped.all() else 2)
    kernel, alone = build(robot), build(links)
    check_flat(robot, links, kernel)
    jumps = _checked_jumps(course, order + 2, gears)
    if order == 1 and all(x.t == course.t[0] for x in _jumps(course, 4)):
        order = 2  # filters take more of the forces between samples
    times = course.t if gears is None or not gears.damped.any() else finer(course.t)
    series = _series(links, alone, course, times, order + 2)
    fastest = dict(zip(alone.coordinates, np.abs(series[1]).max(axis=0).tolist(), strict=True))
    soft, widest = with_smooth_friction(links, fastest, friction_smoothing)
    forces = _forces(build(soft) if widest else alone, series, order)
    real = alone.inverse_dynamics(*series[:3]) if widest else forces[0]
    return _assembled(robot, gears, kernel, _Links(alone, times, series, forces, real), course, jumps, widest)


def check_smoothing(friction_smoothing: float | None) -> None:
    """Refuse what is no velocity over which friction reverses, and not None."""
    if friction_smoothing is not None and not (is_usable(friction_smoothing) and friction_smoothing > 0.0):
        raise InputError(
            f"friction_smoothing: {show(friction_smoothing)}; allowed: a velocity above 0, up to {LARGEST:g}"
        )


class _Links(NamedTuple):
    """Motion of the links' side: times, time derivatives of coordinates, of forces, and forces with all friction."""

    kernel: Kernel
    t: Array
    series: tuple[Array, ...]
    forces: tuple[Array, ...]
    real: Array


def links_alone(robot: Robot) -> Robot:
    """Return a robot without its motors: their joints' principal coordinates are driven themselves.

    Raises:
        InputError: a coupling of motors.
    """
    motors = {f"{j.name}.{MOTOR}": principal_of(j) for j in robot.joints if j.motor is not None}
    for coupling in robot.couplings:
        coupled = [name for name in (coupling.of, *coupling.to) if name in motors]
        if coupled:
            raise InputError(
                f"couplings.{coupling.name}: it couples {coupled[0]}; allowed for feed-forward: motors that no coupling"
                " holds"
            )
    driven = None if robot.driven is None else tuple(dict.fromkeys(motors.get(name, name) for name in robot.driven))
    made = replace(
        robot,
        name=robot.name[:42] + "_links",
        joints=tuple(replace(joint, motor=None) for joint in robot.joints),
        driven=driven,
        home={name: value for name, value in robot.home.items() if name not in motors},
    )
    known = {name for name, _ in made.numbers()}
    return replace(made, tunable=tuple(name for name in made.tunable if name in known))


def _is_scenario(motion: object) -> bool:
    return isinstance(motion, (Scenario, str, Path, Mapping))


def _course(robot: Robot, motion: Any, t: ArrayLike | None, prescribed: Any) -> _Course:
    """Return the course of a reference trajectory."""
    program = with_series(motion)
    names = _prescribed_names(robot)
    if names and prescribed is None:
        raise InputError(f"prescribed: the motion of {listed(names)} is missing; allowed: one with series(t, order)")
    if prescribed is not None:
        with_series(prescribed, "prescribed")
    if t is None:
        end = float(getattr(motion, "end", 0.0))
        if not end > 0.0:
            raise InputError(f"t: {type(motion).__name__} has no end after 0 s; allowed: times of samples, (T,), s")
        t = np.linspace(0.0, end, SAMPLES + 1)
    times = _times(t)
    driven = program_coordinates(robot)
    size = np.shape(program.start)
    if size != (len(driven),):
        raise ArrayError(f"motion: its coordinates have shape {size}; allowed: ({len(driven)},), {listed(driven)}")
    return _Course(program, prescribed if names else None, times, leading_home(robot), ())


def _scenario_course(robot: Robot, motion: Any, t: ArrayLike | None) -> _Course:
    """Return the course of a scenario's motion; InputError where it has none."""
    scenario = as_scenario(motion)
    if scenario.motion is None:
        scenario.fail("motion", "there is none; allowed: a motion for feed-forward")
    names = _prescribed_names(robot)
    known = coordinate_names(robot), names, robot.principal_coordinates
    moved = PrescribedMotion(scenario, *known) if names or scenario.prescribed else None
    start = {
        **leading_home(robot),
        **by_coordinate(robot, scenario, "q", scenario.initial.q if scenario.initial else {}),
    }
    if moved is not None:
        start |= dict(zip(names, moved(0.0)[0].tolist(), strict=True))
    driven = program_coordinates(robot)
    if scenario.motion.type == "program":
        program = scenario.motion.get("program")
    else:
        tool = tool_of(robot, scenario.frame)
        program = make_reference(scenario, robot, driven, lambda: build(robot.rigid()), tool, start)
    step = scenario.output_step or scenario.duration / SAMPLES
    if t is None:
        t = np.linspace(0.0, scenario.duration, max(1, int(np.ceil(scenario.duration / step - 1e-9))) + 1)
    return _Course(with_series(program), moved, _times(t), start, left_out(scenario))


def _times(t: ArrayLike) -> Array:
    rising = "two or more finite times (T,) that increase, s"
    times = numbers_in("t", t, rising)
    if times.ndim != 1 or times.size < 2 or not (np.diff(times) > 0.0).all():
        raise ArrayError(f"t: {show(t)}; allowed: {rising}")
    return times


def _prescribed_names(robot: Robot) -> list[str]:
    """Return names of prescribed coordinates, without motors: their motion is what is looked for."""
    model = build_model(robot)
    names = [model.coordinates[i] for i in model.prescribed]
    return [name for name in names if not name.endswith(f".{MOTOR}")]


def _loose(robot: Robot, links: Robot) -> list[str]:
    """Return the coordinates of the links' side that nothing drives, prescribes or, in loops, closes."""
    moves = {*program_coordinates(links), *_prescribed_names(links)}
    if links.is_closed:
        moves |= set(coordinate_names(links.rigid()))
    return [name for name in build_model(links).coordinates if name not in moves]


def check_flat(robot: Robot, links: Robot, full: Kernel) -> None:
    """Refuse coordinates without drives, drives that take no forces, and laws with internal states, by name."""
    loose = _loose(robot, links)
    if loose:
        raise InputError(
            f"{robot.name}: nothing drives {listed(loose)}, which are no flat outputs of the drives; allowed for"
            " feed-forward without a stable inversion: robots whose joints deviate in elastic gears alone"
        )
    _check_driven(robot, links)
    _check_forces(robot, full)


def _check_driven(robot: Robot, links: Robot) -> None:
    """Refuse motions of coordinates that the description leaves without a drive."""
    drives = set(driven_coordinates(links, build_model(links).coordinates))
    undriven = [name for name in program_coordinates(links) if name not in drives]
    if undriven:
        raise InputError(f"{robot.name}: nothing drives {listed(undriven)}; allowed: robots whose 'driven' names them")


def _check_forces(robot: Robot, full: Kernel) -> None:
    """Refuse drives that take no forces, and laws with internal states, by name."""
    if full.internal_states:
        raise InputError(
            f"{robot.name}: laws have the states {listed(full.internal_states)}; allowed for feed-forward: robots whose"
            " forces depend on positions and velocities alone"
        )
    servos = [name for name, given in full.inputs.items() if name not in full.prescribed and not given.is_force]
    if servos:
        raise InputError(
            f"{robot.name}: the drive of {servos[0]} takes a {full.inputs[servos[0]].meaning}; allowed for"
            " feed-forward: drives that take forces"
        )


def _checked_jumps(course: _Course, order: int, gears: Gears | None) -> tuple[Jump, ...]:
    """Return where drives jump with the motion's highest derivative; InputError where a lower one jumps.

    Args:
        order: of the highest time derivative on which drives depend.
    """
    counted = _jumps(course, order)
    low = [x for x in counted if x.order < order]
    if low:
        words = {0: "its position", 1: "its velocity", 2: "its acceleration", 3: "its jerk"}
        who = "drives" if gears is None else "motors behind elastic gears"
        raise InputError(
            f"motion: {words[low[0].order]} jumps at t = {low[0].t:.6g} s, by which {who} would jump in velocity;"
            f" allowed: motions of class C^{order - 1}, such as smooth = {max(order, 2)} in [motion]"
        )
    return counted


def _jumps(course: _Course, order: int) -> tuple[Jump, ...]:
    """Return where time derivatives of a motion jump between its samples, those at its beginning if it rests before."""
    moved = () if course.prescribed is None else course.prescribed.jumps(order)
    first, last = course.t[0], course.t[-1]
    rests = not course.program.series(first, 1)[1].any()
    jumps = by_time((*course.program.jumps(order), *moved), order)
    return tuple(x for x in jumps if (first < x.t or (x.t == first and rests)) and x.t < last)


def _series(links: Robot, kernel: Kernel, course: _Course, t: Array, order: int) -> tuple[Array, ...]:
    """Return coordinates of the links' side at times and their time derivatives, order + 1 arrays (T, n)."""
    driven = program_coordinates(links)
    columns = index_of(kernel.coordinates, driven)
    whole = np.zeros((order + 1, t.size, len(kernel.coordinates)))
    whole[..., columns] = course.program.series(t, order)
    names = _prescribed_names(links)
    if names:
        whole[..., index_of(kernel.coordinates, names)] = course.prescribed.series(t, order)
    if not links.is_closed:
        return tuple(whole)
    start = {**course.start, **dict(zip(driven, course.program.at(float(t[0]))[0].tolist(), strict=True))}
    path = mechanism_of(kernel, driven, start).path(course.program, None, float(t[-1]))
    near = np.column_stack([np.interp(t, path.t, column) for column in path.q.T])
    others = np.setdiff1d(np.arange(near.shape[1]), columns)
    whole[0][:, others] = near[:, others]
    return kernel.close_series(tuple(whole), fixed=driven)


def _forces(kernel: Kernel, series: tuple[Array, ...], order: int) -> tuple[Array, ...]:
    """Return the forces of drives at the links' side, and their time derivatives up to an order, (T, n) each."""
    if order == 0:
        return (kernel.inverse_dynamics(*series[:3]),)
    return kernel.jet(kernel.inverse_dynamics, tuple(np.ascontiguousarray(x) for x in series), order)


def _assembled(
    robot: Robot,
    gears: Gears | None,
    kernel: Kernel,
    motion: _Links,
    course: _Course,
    jumps: tuple[Jump, ...],
    widest: Mapping[str, float],
) -> FeedForward:
    """Return the result: motors behind their gears beside the links."""
    links = motion.kernel
    place = np.asarray(index_of(kernel.coordinates, links.coordinates))
    every = slice(None, None, 1 if len(motion.t) == len(course.t) else FINER)
    whole = np.zeros((3, len(motion.t), len(kernel.coordinates)))
    whole[..., place] = motion.series[:3]
    left, notes = motion.real - motion.forces[0], list(course.notes)
    shafts: list[int] = []
    if gears is not None:
        behind = index_of(links.coordinates, [principal_of(joint) for joint in gears.joints])
        shafts = list(index_of(kernel.coordinates, gears.names))
        bent = deflections(gears, np.stack(motion.forces)[..., behind], motion.t)
        notes += check_kinks(gears.joints, bent, motion.t)
        for order, e in enumerate(bent):
            whole[order][:, shafts] = gears.ratios * (motion.series[order][:, behind] + e)
    q, v, a = (np.ascontiguousarray(x[every]) for x in whole)
    driven = driven_coordinates(robot, kernel.coordinates)
    u, residual = np.zeros_like(q), np.zeros(q.shape[1])
    direct = index_of(links.coordinates, [name for name in driven if name in links.coordinates])
    u[:, place[direct]] = motion.real[every][:, direct]
    if shafts:
        u[:, shafts] = kernel.inverse_dynamics(q, v, a, cut=robot.is_closed)[:, shafts]
        residual[place[behind]] = np.abs(left[:, behind]).max(axis=0)
    notes += smoothing_notes(widest)
    notes += [
        f"drives jump at t = {x.t:.6g} s, where the motion's derivative of order {x.order} does" for x in jumps[:5]
    ]
    notes += [f"and at {len(jumps) - 5} more times"] if len(jumps) > 5 else []
    return FeedForward(
        robot=robot.name,
        t=course.t,
        q=q,
        v=v,
        a=a,
        u=u,
        coordinates=kernel.coordinates,
        driven=tuple(driven),
        residual=residual,
        jump_times=np.array([x.t for x in jumps]),
        jump_orders=np.array([float(x.order) for x in jumps]),
        notes=tuple(notes),
    )
