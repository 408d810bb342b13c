"""Simulations of a robot with all its coordinates: a scenario, or a point-to-point motion of the joints.

``simulate`` moves the principal coordinates from point to point.  Their drives are computed torque on the rigid model,
with a PD law on measured coordinates: u = ID_rigid(q, v, a_reference + w^2 e + 2 w e').  Deviations have no drive.  The
robot starts in static equilibrium under these drives.  Where a motor drives a principal coordinate through a
transmission, its angle over the ratio is measured, its reference is the ratio times the joint's, and it gets the drive
over the ratio.
``run_scenario`` does what a scenario says (docs/scenario.md).
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from .._version import __version__
from ..arrays import Array
from ..description import RobotLike, as_robot
from ..errors import InputError, IntegrationStopped
from ..integration.plan import IntegratorPlan, plan_integration
from ..integration.reference_motions import references
from ..integration.steps import output_times
from ..integration.trajectory import Trajectory
from ..integration.until import Until
from ..kernel.complete import Kernel
from ..kernel.stepping.methods import EXPLICIT_METHODS, Method
from ..limits import LARGEST, is_usable
from ..motion.ends import Point, size_question
from ..motion.exceeding import excess_notes, excesses
from ..motion.point_to_point import Program
from ..motion.splines import Spline
from ..names import component_name, show
from ..pipeline.ahead import Ahead
from ..progress import Progress, no_progress, tells_at_prompt
from ..robot.coordinates import force_unit_of, index_of, unit_of
from ..robot.internal_states.drives import short_time_notes
from ..robot.model import build_model, rigid_coordinates, tool_of
from ..robot.value import MOTOR, Robot
from ..runtime.internal_states import cut_apart
from ..scenario.load import as_scenario
from ..scenario.value import Integrator, Scenario, Section
from ..state.drives import has_drives
from ..state.springs import law_numbers, stops
from .assembly import BANDWIDTH, Assembly, assemble, default_control
from .controls import ComputedTorque
from .initial import initial_state
from .result import SimulationResult, angle_between
from .sampled_drive import SampledDrive
from .segments import Loads, SegmentOptions, run_segments
from .stream import MotionStream
from .within import checked_within, run_within


@tells_at_prompt("simulating")
def simulate(  # noqa: PLR0913
    robot: RobotLike,
    *,
    duration: float = 2.0,
    start: Point | None = None,
    goal: Point | None = None,
    motion: Program | None = None,
    bandwidth: float = BANDWIDTH,
    tool: str | None = None,
    method: Method = "auto",
    rtol: float = 1e-6,
    step: float | None = None,
    output_step: float | None = None,
    global_error: bool = False,
    within: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> SimulationResult:
    """Move the robot from start to goal and integrate all its coordinates: a scenario of these values.

    The motion takes 80 percent of the duration, then its goal is kept.  A free joint is fixed where it is.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; with at least one principal
            coordinate.
        duration: s.
        start, goal: of the principal coordinates, rad or m: a value for each, in their order, or a mapping from names
            ("joint2", "joint2.gamma") to values.  By default from zero (or the nearest pose that is well inside the
            limits) by 45 degrees or 0.2 m to where there is more room, by less if the limits demand it.
        motion: of all driven coordinates of ``robot.rigid()``, instead of start and goal.
        bandwidth: of the drives' PD law, rad/s; without use where drives control positions by themselves.
        tool: frame or link of poses and TCP errors; default "tcp", else the first frame, else a link
            whose name ends with "tcp" or "tool0", else the end of the longest chain.
        method, rtol, step, output_step: see ``integrate``.
        global_error: whether the error of the integration is estimated, by two more motions with tolerances 30 and 1000
            times narrower: the result's ``global_error``.
        within: largest estimated errors that are allowed, by name: "tool" (m), "tool.rotation" (rad), a coordinate
            (m or rad).  The motion is integrated with ever narrower tolerances, from rtol on, until they are met.
        progress: called with a fraction from 0 to 1 and a line of text.

    Raises:
        InputError: an argument is wrong, nothing can be driven, SciPy is not installed.
        LoopError: loops do not close at the start, or on the way, or the drives do not hold the mechanism.
        IntegrationStopped: the motion could not be integrated to its end; see ``integrate``.  What there is of it is in
            the error's ``result``.
    """
    robot = as_robot(robot)
    if not (is_usable(bandwidth) and bandwidth > 0.0):
        raise InputError(f"bandwidth: {show(bandwidth)} rad/s; a number above 0, up to {LARGEST:g}, is allowed")
    if not (is_usable(duration) and duration > 0.0):
        raise InputError(f"duration: {show(duration)} s; a time above 0, up to {LARGEST:g}, is allowed")
    if output_step is not None and not (is_usable(output_step) and output_step > 0.0):
        raise InputError(f"output_step: {show(output_step)} s; a time above 0, up to {LARGEST:g}, is allowed")
    integrator = Integrator(method, rtol, None, step)
    if motion is not None and (start is not None or goal is not None):
        raise InputError("motion stands beside start or goal; allowed: one of them")
    kind = default_control(robot)
    ends = {key: value for key, value in (("start", start), ("goal", goal)) if value is not None}
    scenario = Scenario(
        float(duration),
        output_step=output_step,
        frame=tool,
        motion=Section("point_to_point", ends) if motion is None else Section("program", {"program": motion}),
        control=Section(kind, {"bandwidth": float(bandwidth)} if kind == "computed_torque" else {}),
        integrator=integrator,
    )
    return run_scenario(robot, scenario, progress=progress, global_error=global_error, within=within)


@tells_at_prompt("simulating")
def run_scenario(
    robot: RobotLike,
    scenario: Scenario | str | Path | Mapping[str, Any],
    *,
    progress: Progress | None = None,
    stream: Path | str | None = None,
    global_error: bool = False,
    within: Mapping[str, float] | None = None,
) -> SimulationResult:
    """Simulate a robot by a scenario: integrate all its coordinates.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        scenario: from ``load_scenario``, a built-in name, the path of a .toml file, or the values of one.
        progress: called with a fraction from 0 to 1 and a line of text.
        stream: a new folder to which q and v are written while they are integrated, see ``eomgen.load_stream``.
        global_error, within: as of ``simulate``; the latter not with a stream.

    Raises:
        InputError: the scenario does not fit the robot (file, key, value and what is allowed are named), or SciPy
            is not installed.
        LoopError: as of ``simulate``.
        IntegrationError: there is no static equilibrium at the start, or the motion could not be integrated to its
            end: as IntegrationStopped, whose ``result`` has the motion until then.  Or no tolerance brings errors
            within what is asked for.
    """
    robot, scenario, report = as_robot(robot), as_scenario(scenario), progress or no_progress
    tool = tool_of(robot, scenario.frame, scenario.label("frame") if scenario.source else "tool")

    def run(scenario: Scenario, *, estimated: bool) -> SimulationResult:
        with Ahead() as ahead:
            assembly = assemble(robot, scenario, tool, report, None, ahead)
            return run_assembly(robot, scenario, assembly, tool, report, stream, global_error=estimated)

    if within is None:
        return run(scenario, estimated=global_error)
    if stream is not None:
        raise InputError("within: the motion is integrated several times, and a stream has one; allowed: one of both")
    asked = checked_within(within, build_model(robot).coordinates, scenario)
    return run_within(partial(run, estimated=True), scenario, asked)


def run_assembly(
    robot: Robot,
    scenario: Scenario,
    assembly: Assembly,
    tool: str,
    report: Progress,
    stream: Path | str | None = None,
    *,
    balance: bool = True,
    global_error: bool = False,
) -> SimulationResult:
    """Run an assembled scenario, as ``run_scenario``; without ``balance`` faster."""
    kernel = assembly.kernel
    report(0.0, "static equilibrium at the start")
    q0, v0, loose = initial_state(robot, scenario, assembly)
    loads = loads_of(assembly)
    versions = {"eomgen": __version__, "numpy": np.__version__, "python": platform.python_version()}
    about: dict[str, Any] = {
        "robot": robot.name,
        "robot_hash": assembly.facts.robot_hash,
        "scenario": assembly.facts.scenario,
        "versions": versions,
    }
    samples = output_times(scenario.duration, scenario.output_step).size
    states = dict(zip(kernel.internal_states, kernel.internal_state_units, strict=True))
    opened = None if stream is None else MotionStream(stream, kernel.coordinates, samples, about, states)
    plan = plan_of(assembly, scenario, q0)

    def planned(rtol: float) -> IntegratorPlan:
        return plan_of(assembly, replace(scenario, integrator=Integrator(rtol=rtol)), q0)

    beside = references(plan, planned) if global_error else None
    options = SegmentOptions(plan, report, opened, balance, assembly.until, beside)
    n = kernel.n
    try:
        segments = run_segments(kernel, robot, scenario, loads, q0, v0, options)
    except IntegrationStopped as stop:
        stop.set_apart(n)
        if stop.trajectory is not None:
            stop.trajectory = stop.trajectory.apart(kernel)
        raise
    motion = segments.trajectory
    t, q = motion.t, motion.q
    driven = index_of(kernel.coordinates, assembly.driven)
    program_q = q[:, driven] if assembly.shown is None else assembly.shown.at(t)[0]
    rigid_q = np.zeros_like(q)
    prescribed = index_of(kernel.coordinates, kernel.prescribed)
    rigid_q[:, driven], rigid_q[:, prescribed] = program_q, q[:, prescribed]
    if assembly.path is not None:
        mechanism = index_of(kernel.coordinates, assembly.path.mechanism.rigid.coordinates)
        rigid_q[:, mechanism] = assembly.path.at(t)
    elif kernel.constraints:
        rigid_q = q
    v, z = cut_apart(motion.v, n)
    exerted = kernel.functions.drive_forces(q, v, motion.u, z=z) if has_drives(kernel) else motion.u
    notes = [
        *_method_note(motion, plan),
        *_assumptions(robot, loose, scenario, assembly),
        *short_time_notes(build_model(robot).states),
        *assembly.notes,
        *_beyond_stops(kernel, q0),
        *_large_goals(scenario, assembly.driven, program_q),
        *excess_notes("the motion", excesses(robot, kernel.coordinates, t=t, q=q, v=v, u=exerted)),
        *_clipped_note(assembly, motion),
        None if segments.balance is None else segments.balance.note(),
        *_end_note(assembly.until, motion),
    ]
    pose, estimate = np.asarray(kernel.frame_pose(q, tool)), segments.global_error
    if estimate is not None:
        exact = np.asarray(kernel.frame_pose(q - estimate.q_error, tool))
        turned = angle_between(exact, pose)
        estimate = replace(estimate, tool_error=pose[:, :3, 3] - exact[:, :3, 3], tool_rotation_error=turned)
    result = SimulationResult(
        robot=robot.name,
        trajectory=motion.apart(kernel),
        program_coordinates=assembly.driven,
        program_q=program_q,
        tool=tool,
        pose=pose,
        program_pose=np.asarray(kernel.frame_pose(rigid_q, tool)),
        notes=tuple(note for note in notes if note),
        versions=MappingProxyType(versions),
        programmed=assembly.program is not None,
        prescribed=kernel.prescribed,
        passive=_passive(robot, assembly),
        robot_hash=about["robot_hash"],
        scenario=MappingProxyType(about["scenario"]),
        links=kernel.links,
        wrench=segments.wrench,
        balance=segments.balance,
        description=MappingProxyType(dict(assembly.facts.description)),
        global_error=estimate,
        stopped=MappingProxyType({} if segments.stop is None else _stop_record(segments.stop, n)),
    )
    if segments.stop is not None:
        segments.stop.trajectory, segments.stop.result = result.trajectory, result
        raise segments.stop
    return result


def loads_of(assembly: Assembly) -> Loads:
    """Return the loads of an assembly's motion."""
    ends = (float(assembly.program.t[0]), float(assembly.program.t[-1])) if isinstance(assembly.program, Spline) else ()
    return Loads(assembly.drive, assembly.wrenches, assembly.prescribed, ends)


def plan_of(assembly: Assembly, scenario: Scenario, q: Array | None = None) -> IntegratorPlan:
    """Return the plan of an assembly's motion from q, (n,); errors as ``plan_integration``."""
    loads = assembly.drive, assembly.wrenches, assembly.prescribed
    return plan_integration(assembly.kernel, scenario.integrator, loads, q, scenario.duration)


def _passive(robot: Robot, assembly: Assembly) -> tuple[str, ...]:
    """Return the names of the coordinates that loops move: those of the rigid robot that nothing else moves."""
    if not robot.is_closed:
        return ()
    moved = {*assembly.driven, *assembly.kernel.prescribed}
    return tuple(name for name in rigid_coordinates(robot) if name not in moved)


def _stop_record(stop: IntegrationStopped, n: int) -> dict[str, Any]:
    """Return the record of why a result of n coordinates ends too early, in values that JSON holds."""
    stop.set_apart(n)
    state = {name: x.tolist() for name, x in (("q", stop.q), ("v", stop.v), ("z", stop.z)) if x is not None}
    return {"reason": str(stop), "t": stop.t, "coordinate": stop.coordinate, **state}


def _end_note(until: Until | None, motion: Trajectory) -> tuple[str, ...]:
    """Say whether and when the terminal event was reached."""
    if until is None:
        return ()
    if "ended_at" not in motion.info:
        return (f"{until.text} was not reached",)
    return (f"{until.text} reached at {motion.info['ended_at']:.6g} s, where the motion ends",)


def _method_note(motion: Trajectory, plan: IntegratorPlan) -> tuple[str, ...]:
    """Say which method "auto" chose, and why; nothing where a method was asked for."""
    if plan.asked != "auto":
        return ()
    if not plan.reason:
        share = 100.0 * motion.info.get("implicit_s", 0.0) / max(float(motion.t[-1] - motion.t[0]), 1e-300)
        switching = "method: automatic stiffness switching between"
        if len(plan.turns) > 2:
            methods = f"{', '.join(plan.turns[:-1])} and {plan.turns[-1]}"
            return (f"{switching} {methods}, implicit for {share:.0f} % of the time",)
        return (f"{switching} tsit5 and rosenbrock (implicit), the latter for {share:.0f} % of the time",)
    kind = "explicit" if motion.method in EXPLICIT_METHODS else "implicit"
    return (f"method: {motion.method} ({kind}), {plan.reason}",)


def _assumptions(robot: Robot, loose: tuple[str, ...], scenario: Scenario, assembly: Assembly) -> tuple[str, ...]:
    notes, programmed = [], assembly.program is not None
    computed = isinstance(assembly.drive, ComputedTorque)
    undisturbed = programmed and computed and not scenario.wrenches and not scenario.payloads
    if undisturbed and assembly.facts.is_rigid:
        notes.append("no joint has a deviation: the tool's tracking error is the integration's error")
    free = [joint.name for joint in robot.joints if joint.is_free]
    if free and programmed and not robot.is_closed:
        notes.append(f"free joint {', '.join(free)}: fixed where it is by drives on all its six coordinates")
    motors = [component_name(joint.name, MOTOR) for joint in robot.joints if joint.motor]
    if motors and programmed and not (isinstance(assembly.drive, SampledDrive) and assembly.drive.places is None):
        notes.append(f"drives act at {', '.join(motors)} and know their angles alone, not their joints'")
    if assembly.wanted is not None:
        notes.append("drives follow a compensated path; what is compared is the path that is wanted")
    if loose:
        why = "without a stiffness or a drive, or inside a clearance"
        notes.append(f"{why}, so not in balance at the start: {', '.join(loose)}")
    return tuple(notes)


def _beyond_stops(kernel: Kernel, q: Array) -> Iterator[str]:
    """Say which coordinates start beyond a stop, in lines."""
    places = dict(zip(kernel.coordinates, q.tolist(), strict=True))
    places |= {name: float(place) for name, (place, _) in kernel.followers(q).items()}
    for name, (lower, upper) in stops(law_numbers(kernel)).items():
        place, unit = places[name], unit_of(name)
        if not lower <= place <= upper:
            side, stop = ("upper", upper) if place > upper else ("lower", lower)
            yield f"{name} starts at {place:.6g} {unit}, beyond its {side} stop at {stop:.6g} {unit}"


def _large_goals(scenario: Scenario, driven: Sequence[str], program_q: Array) -> Iterator[str]:
    """Ask about goals that may be in degrees or millimetres; ``program_q`` (T, n), m or rad, of the driven ones."""
    if scenario.motion is None or scenario.motion.type not in ("point_to_point", "via"):
        return
    for name, ends in zip(driven, program_q[[0, -1]].T.tolist(), strict=True):
        asked = size_question(name, max(ends, key=abs))
        if asked:
            yield f"goal: {asked}"


def _clipped_note(assembly: Assembly, motion: Trajectory) -> tuple[str, ...]:
    """Say which drives were clipped, and for how many of the samples."""
    effort: Array | None = getattr(assembly.drive, "effort", None)
    if effort is None:
        return ()
    clipped, names = [], motion.coordinates
    for i in np.flatnonzero(np.isfinite(effort)):
        at_limit = np.abs(motion.u[:, i]) >= effort[i]
        if at_limit.any():
            first, share = float(motion.t[int(at_limit.argmax())]), 100.0 * float(at_limit.mean())
            limit = f"{names[i]} at {effort[i]:.4g} {force_unit_of(names[i])}"
            clipped.append(f"{limit}, {share:.0f} % of samples, first at {first:.4g} s")
    return (f"drives were clipped: {'; '.join(clipped)}",) if clipped else ("no drive was clipped at a sample",)
