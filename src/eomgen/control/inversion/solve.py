"""Stable inversion: drives by which a robot's tool follows a motion, deviations without drives included.

Outputs y(q) = y_d(t), as many as drives, and the equations of motion of what has no drive determine all coordinates but
for how the internal motion begins and ends.  Bounded over all times is one solution alone: what grows forwards is found
backwards in time, so that drives begin before the motion does.  The unknown coordinates are splines (``collocation``);
Newton's method takes exact derivatives of the kernel.

Source: S. Devasia, D. Chen, B. Paden, "Nonlinear Inversion-Based Output Tracking", IEEE Trans. Automatic Control 41(7),
1996; E. Bayo, "A finite-element approach to control the end-point motion of a single-link flexible robot", J. Robotic
Systems 4(1), 1987.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...arrays import Array
from ...codegen.kernels.groups import CONTROLLED_INVERSION
from ...description import RobotLike, as_robot
from ...errors import InputError
from ...kernel.complete import Kernel
from ...limits import LARGEST, is_usable
from ...motion.point_to_point import Program
from ...names import component_name, listed, show
from ...pipeline.building import build
from ...progress import StageReport, no_report, tells_at_prompt
from ...robot.coordinates import MOTIONS, index_of
from ...robot.mechanism import leading_home
from ...robot.model import build_model, program_coordinates, tool_of
from ...robot.value import Robot
from ...runtime.arrays import names_in
from ...scenario.load import as_scenario
from ...scenario.value import Scenario
from ...simulation.assembly import by_coordinate, rigid_kernels
from ...simulation.controls import actuators
from ...simulation.references import make_reference
from ...state.springs import clearances, law_numbers
from .collocation import WIDTH
from .motions import Problem, zeros_at
from .refinement import STEPS, TOLERANCE, Ends, RefinedMotion, on_steps, refine
from .result import StableInversion
from .zeros import Complex

KERNELS = CONTROLLED_INVERSION
FEWEST, MOST = 24, 20_000  # steps
MOST_NUMBERS = 60_000_000  # of the linear equations
FADED = 1e-4  # of an internal motion: what is left of it before the first and after the last sample
AT_LEAST, LONGEST = 8, 0.5  # steps and part of the motion's duration, before and after it by default
POSES = 5  # at which zeros are looked at
BETWEEN = 1e-7  # m or rad, left between samples, from which on that is told
SMOOTH = 4  # derivatives of a motion that a drive behind a spring asks for

MotionLike: TypeAlias = "Program | Scenario | str | Path | Mapping[str, Any]"


@dataclass(frozen=True, kw_only=True)
class InversionOptions:
    """Options of an inversion, as of ``stable_inversion``; ``reach`` are times between which it is needed, s."""

    frame: str | None = None
    outputs: Sequence[str] | None = None
    duration: float | None = None
    step: float | None = None
    tolerance: float | None = None
    before: float | None = None
    after: float | None = None
    reach: tuple[float, float] = (0.0, 0.0)


class Inversion(NamedTuple):
    """A robot's inverse motion: what was asked for, and what came out.

    span: of the motion, s.  zeros: from drives to outputs at the beginning, rad/s.
    """

    problem: Problem
    refined: RefinedMotion
    span: float
    zeros: Complex


@tells_at_prompt("inverting")
def stable_inversion(  # noqa: PLR0913
    robot: RobotLike,
    motion: MotionLike,
    *,
    frame: str | None = None,
    outputs: Sequence[str] | None = None,
    duration: float | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    before: float | None = None,
    after: float | None = None,
    progress: StageReport = no_report,
) -> StableInversion:
    """Find drives and motions of all coordinates by which outputs follow a motion as without deviations.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        motion: of the principal coordinates, as ``simulate`` takes it, or a scenario with one, whose wrenches and
            payloads are not known to the drives.
        frame: whose pose follows where there are six drives; default as of ``simulate``.
        outputs: what follows instead, as many as there are drives: components of frames in the base frame ("tcp.x",
            "tcp.rz") and coordinates.  Default: the pose of the frame with six drives, else the driven coordinates.
        duration: of the motion, s; default its own, or that of the scenario.
        step: between samples, s; default one that is halved until coordinates change by less than the tolerance.
            Drives behind springs take four derivatives of the motion, whose round-off grows as steps get shorter:
            longer ones may be better.
        tolerance: m or rad, of a coordinate, of a motor over its ratio; default 1e-8.
        before, after: times before and after the motion in which drives act, s; default as long as internal motions
            take to fade to 1e-4, at most half the duration each.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: an argument is wrong, the robot has loops, couplings, prescribed coordinates, laws with internal
            states, servo drives or clearances, outputs cannot be followed at a pose, or zeros are imaginary.
        IntegrationError: Newton's method does not converge.
    """
    arm = as_robot(robot)
    options = InversionOptions(
        frame=frame, outputs=outputs, duration=duration, step=step, tolerance=tolerance, before=before, after=after
    )
    return _result(arm, invert(arm, motion, options, progress))


def invert(robot: Robot, motion: MotionLike, options: InversionOptions, progress: StageReport) -> Inversion:
    """Return the inverse motion of a robot, as ``stable_inversion``, whose errors it has."""
    check_determined(robot)
    if options.step is not None and options.tolerance is not None:
        raise InputError("tolerance: given together with step, which it would choose; allowed: one of both")
    tolerance = TOLERANCE if options.tolerance is None else _positive("tolerance", options.tolerance, "m or rad")
    program, span, named = program_of(robot, motion, options.duration)
    progress("building kernels")
    kernel = build(robot, kernels=KERNELS)
    if played := [name for name, gap in clearances(law_numbers(kernel)).items() if gap > 0.0]:
        raise InputError(
            f"{robot.name}: {listed(played)} has a clearance, in which nothing says where it is; allowed: robots"
            " without one"
        )
    problem = _problem(robot, kernel, program, named if options.frame is None else options.frame, options.outputs)
    progress("zeros from drives to outputs")
    step = span / STEPS if options.step is None else _positive("step", options.step)
    begin, *_, end = [zeros_at(problem, t) for t in np.linspace(0.0, span, POSES).tolist()]
    ahead = max(_margin("before", options.before, begin.values.real, step, span), -options.reach[0])
    behind = max(_margin("after", options.after, -end.values.real, step, span), options.reach[1] - span)
    count = int(np.ceil((span + ahead + behind) / step - 1e-9))
    most = min(MOST, MOST_NUMBERS // (WIDTH * kernel.n**2) - 1)
    if not FEWEST <= count <= most:
        raise InputError(f"step: {step:.3g} s makes {count} steps; allowed: {FEWEST} to {most} for {robot.name}")
    ends = Ends(-ahead, span + behind, begin, end)
    if options.step is None:
        refined = refine(problem, ends, count, most, tolerance, progress)
    else:
        refined = RefinedMotion(on_steps(problem, ends, count, progress))
    return Inversion(problem, refined, span, begin.values)


def check_determined(robot: Robot) -> None:
    """Raise InputError for robots whose motion outputs and drives' number do not determine."""
    if robot.loops or robot.own_couplings:
        raise InputError(f"{robot.name}: has loops or couplings; allowed: robots without them")
    model = build_model(robot)
    if model.prescribed:
        held = [model.coordinates[i] for i in model.prescribed]
        raise InputError(f"{robot.name}: {listed(held)} is prescribed; allowed: robots without prescribed coordinates")
    if model.drives:
        driven = [model.coordinates[i] for i in model.drives]
        raise InputError(f"{robot.name}: {listed(driven)} has a servo drive; allowed: drives whose inputs are forces")
    if model.internal_states:
        raise InputError(
            f"{robot.name}: its laws have states ({listed(model.internal_states)}); allowed: laws without states"
        )


def program_of(robot: Robot, motion: MotionLike, duration: float | None) -> tuple[Program, float, str | None]:
    """Return the program of a motion, its duration, s, and the frame that a scenario names."""
    given = None if duration is None else _positive("duration", duration)
    if hasattr(motion, "at"):
        program: Any = motion
        end = getattr(program, "end", None) if given is None else given
        if end is None:
            raise InputError(f"duration: {type(motion).__name__} does not say when it ends; allowed: a time, s")
        return program, float(end), None
    scenario = as_scenario(motion)
    if scenario.motion is None:
        scenario.fail("motion", "nothing moves; allowed: a scenario with a motion")
    tool = tool_of(robot, scenario.frame, scenario.label("frame") if scenario.source else "frame")
    if scenario.motion.type == "program":
        return scenario.motion.get("program"), scenario.duration if given is None else given, tool
    start = leading_home(robot) | by_coordinate(robot, scenario, "q", scenario.initial.q if scenario.initial else {})
    driven = program_coordinates(robot)
    program = make_reference(
        scenario, robot, driven, lambda: build(robot.rigid(), kernels=rigid_kernels(robot)), tool, start
    )
    return program, scenario.duration if given is None else given, tool


def _problem(
    robot: Robot, kernel: Kernel, program: Program, frame: str | None, outputs: Sequence[str] | None
) -> Problem:
    """Return what is to be solved, its outputs checked."""
    driven = program_coordinates(robot)
    if not driven:
        raise InputError(f"{robot.name}: nothing is driven; allowed: a robot with a principal coordinate")
    tool = tool_of(robot, frame)
    if outputs is None:
        posed = len(driven) == len(MOTIONS)
        if frame is not None and not posed:
            raise InputError(
                f"frame: {robot.name} has {len(driven)} drives, which do not move a frame by all six components;"
                " allowed: outputs, as many as drives"
            )
        outputs = [component_name(tool, x) for x in MOTIONS] if posed else driven
    names = tuple(names_in("outputs", outputs))
    if len(names) != len(driven):
        raise InputError(f"outputs: {len(names)} for {len(driven)} drives of {robot.name}; allowed: as many as drives")
    start = np.asarray(program.at(0.0)[0])
    if start.shape != (len(driven),):
        raise InputError(f"motion: moves {start.size} coordinates; allowed: {listed(driven)}")
    acting = actuators(kernel, driven)
    undriven = np.setdiff1d(np.arange(kernel.n), acting.index)
    places = np.asarray(index_of(kernel.coordinates, driven), dtype=np.intp)
    return Problem(kernel, program, places, acting.index, acting.ratios, undriven, names)


def _positive(label: str, value: float, unit: str = "s") -> float:
    if not (is_usable(value) and value > 0.0):
        what = "time" if unit == "s" else "number"
        raise InputError(f"{label}: {show(value)} {unit}; allowed: a {what} above 0, up to {LARGEST:g}")
    return float(value)


def _margin(label: str, given: float | None, rates: Array, step: float, span: float) -> float:
    """Return a time before or after the motion, s: as asked for, or what the slowest of these rates takes to fade."""
    if given is not None:
        if not (is_usable(given) and given >= 0.0):
            raise InputError(f"{label}: {show(given)} s; allowed: a time from 0, up to {LARGEST:g}")
        return float(given)
    slowest = rates[rates > 0.0].min(initial=np.inf)
    return float(min(max(-np.log(FADED) / slowest, AT_LEAST * step), LONGEST * span))


def _result(robot: Robot, found: Inversion) -> StableInversion:
    """Return the motion at its knots and halfway between them, and what is left."""
    problem, motion = found.problem, found.refined.motion
    kernel, t = problem.kernel, motion.spline.times
    q, v, a = motion.spline.at(t)
    force = np.asarray(kernel.residual(q, v, a, np.zeros_like(q)))
    lacking, still = np.abs(force[:, problem.undriven]), np.zeros((1, kernel.n))
    K = np.abs(np.diagonal(kernel.residual_jacobian(q[0], still[0], still[0])[0]))[problem.undriven]
    soft = K <= 0.0
    between = (lacking[1::2] / np.where(soft, np.inf, K)).max(initial=0.0)
    ends = [np.abs(q[i] - motion.still[i]).max() for i in (0, -1)]
    inertia = np.diagonal(kernel.mass_matrix(q[0]))[problem.index]
    notes = [] if not problem.undriven.size else [smoothness_note(problem.program)]
    notes.append(found.refined.note)
    if between > BETWEEN:
        notes.append(
            f"between the samples {between:.2g} m or rad is left; a smoother motion leaves less, and another step may"
        )
    return StableInversion(
        robot=robot.name,
        outputs=problem.outputs,
        drives=tuple(kernel.coordinates[i] for i in problem.index.tolist()),
        coordinates=kernel.coordinates,
        t=t,
        duration=found.span,
        q=q,
        v=v,
        u=force[:, problem.index],
        inertia=inertia,
        zeros=found.zeros,
        history=motion.history,
        change=found.refined.change,
        residual=float(lacking[::2].max(initial=0.0)),
        between=float(between),
        ends=(float(ends[0]), float(ends[1])),
        notes=tuple(note for note in notes if note),
    )


def smoothness_note(program: Program) -> str:
    """Say where derivatives of a program jump, which drives behind springs feel; "" where none does."""
    if not hasattr(program, "jumps"):
        return "the motion does not say whether its jerk jumps, where forces of drives behind springs do"
    jumps = program.jumps(SMOOTH)
    if not jumps:
        return ""
    order = min(jump.order for jump in jumps)
    times = ", ".join(f"{jump.t:.4g}" for jump in jumps[:4] if jump.order == order)
    return (
        f"the motion's derivative of order {order} jumps (at {times} s): forces of drives behind springs have peaks"
        f" there, the higher the nearer samples are; motions with continuous derivatives up to order {SMOOTH} have none"
    )
