"""Feed-forward of robots whose deviations have no drive: a stable inversion, sampled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...kernel.complete import Kernel
from ...motion.time_derivatives import Jump
from ...names import listed
from ...pipeline.building import build
from ...progress import StageReport
from ...robot.coordinates import index_of
from ...robot.model import program_coordinates
from ...robot.value import MOTOR, Robot
from ...scenario.load import as_scenario
from ..feedforward_result import FeedForward, left_out
from ..gears import check_kinks, principal_of
from ..link_friction import smoothing_notes, with_smooth_friction
from .solve import KERNELS, SMOOTH, Inversion, InversionOptions, check_determined, invert, program_of, smoothness_note

SAMPLES = 1000  # steps of a motion by default


class InverseSamples(NamedTuple):
    """Times and options of a feed-forward by stable inversion, as of ``feedforward``."""

    t: Array | None
    outputs: Sequence[str] | None
    tolerance: float | None
    friction_smoothing: float | None


def inverse_feedforward(
    robot: Robot, motion: Any, loose: Sequence[str], wanted: InverseSamples, report: StageReport
) -> FeedForward:
    """Return the motion of all coordinates by which outputs follow a motion, and the forces of drives.

    Args:
        robot: whose coordinates ``loose`` have no drive.
        motion: as of ``feedforward``.
        loose: names of those of the links' side.
        wanted: times and options.
        report: called with a line of text when a stage begins.

    Raises:
        InputError: the robot is none of those whose motion a stable inversion determines; as ``stable_inversion``.
        IntegrationError: as ``stable_inversion``.
    """
    try:
        check_determined(robot)
    except InputError as error:
        said = str(error).removeprefix(f"{robot.name}: ")
        raise InputError(
            f"{robot.name}: nothing drives {listed(loose)}, which are no flat outputs of the drives, and"
            f" no stable inversion finds them: {said}"
        ) from None
    program, span, frame = program_of(robot, motion, None)
    scenario = None if hasattr(motion, "at") else as_scenario(motion)
    soft, widest = _with_smooth_friction(robot, program, span, wanted.friction_smoothing)
    reach = (0.0, span) if wanted.t is None else (float(wanted.t[0]), float(wanted.t[-1]))
    options = InversionOptions(
        frame=frame, outputs=wanted.outputs, duration=span, tolerance=wanted.tolerance, reach=reach
    )
    inversion = invert(soft, program, options, report)
    step = span / SAMPLES if scenario is None or scenario.output_step is None else scenario.output_step
    t = _samples(inversion, step) if wanted.t is None else wanted.t
    kernel = build(robot, kernels=KERNELS) if widest else inversion.problem.kernel
    notes = [] if scenario is None else [*left_out(scenario)]
    return _sampled(robot, kernel, inversion, t, (*notes, *smoothing_notes(widest)))


def _with_smooth_friction(
    robot: Robot, program: Any, span: float, smoothing: float | None
) -> tuple[Robot, dict[str, float]]:
    """Return the robot whose friction at links behind motors reverses over a velocity, and these by coordinate."""
    behind = [f"{joint.name}.{joint.principal}" for joint in robot.joints if joint.motor is not None]
    if not behind:
        return robot, {}
    names = program_coordinates(robot)
    v = np.abs(program.at(np.linspace(0.0, span, SAMPLES + 1))[1]).max(axis=0)
    fastest = {name: float(x) for name, x in zip(names, v, strict=True) if name in behind}
    return with_smooth_friction(robot, fastest, smoothing)


def _samples(inversion: Inversion, step: float) -> Array:
    """Return multiples of a step within the inverse motion, from 0 on where no zero grows before the motion, s."""
    first, last = inversion.refined.motion.spline.t[[0, -1]].tolist()
    before = int(np.floor(-first / step + 1e-9)) if (inversion.zeros.real > 0.0).any() else 0
    return np.asarray(step * np.arange(-before, int(np.floor(last / step + 1e-9)) + 1))


def _sampled(robot: Robot, kernel: Kernel, inversion: Inversion, t: Array, notes: Sequence[str]) -> FeedForward:
    """Return an inverse motion at times, and what it leaves there."""
    problem, refined = inversion.problem, inversion.refined
    spline = refined.motion.spline
    q, v, a = (np.ascontiguousarray(x) for x in spline.at(np.clip(t, *spline.t[[0, -1]])))
    force = np.asarray(kernel.residual(q, v, a, np.zeros_like(q)))
    u, residual = np.zeros_like(q), np.zeros(kernel.n)
    u[:, problem.index] = force[:, problem.index]
    residual[problem.undriven] = np.abs(force[:, problem.undriven]).max(axis=0)
    joints = [joint for joint in robot.joints if joint.motor is not None]
    motors = index_of(kernel.coordinates, [f"{joint.name}.{MOTOR}" for joint in joints])
    links = index_of(kernel.coordinates, [principal_of(joint) for joint in joints])
    ratios = [joint.motor.ratio for joint in joints if joint.motor is not None]
    notes = [*notes, *check_kinks(joints, [x[:, motors] / ratios - x[:, links] for x in (q, v, a)], t)]
    jumps: tuple[Jump, ...] = problem.program.jumps(SMOOTH) if hasattr(problem.program, "jumps") else ()
    jumps = tuple(x for x in jumps if t[0] <= x.t < t[-1])
    off = np.abs(q[0] - refined.motion.still[0]).max()
    began = f"at the first sample, {t[0]:.4g} s, coordinates are off from rest by {off:.2g} m or rad"
    return FeedForward(
        robot=robot.name,
        t=t,
        q=q,
        v=v,
        a=a,
        u=u,
        coordinates=kernel.coordinates,
        driven=tuple(kernel.coordinates[i] for i in sorted(problem.index.tolist())),
        residual=residual,
        jump_times=np.array([x.t for x in jumps]),
        jump_orders=np.array([float(x.order) for x in jumps]),
        notes=tuple(x for x in (*notes, smoothness_note(problem.program), refined.note, began) if x),
        outputs=problem.outputs,
        inverted=tuple(kernel.coordinates[i] for i in problem.undriven.tolist()),
    )
