"""Compliance of a robot's tool over a plane of its workspace."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..codegen.kernels.groups import FRAME_POSES
from ..description import RobotLike, as_robot
from ..errors import InputError, IntegrationError
from ..kernel.complete import Kernel
from ..kernel.inverse_kinematics.reaching import Target, reach, starting_points, within_limits
from ..limits import MOST_COUNTED
from ..motion.ends import limits_beside
from ..motion.tool_path import space_point
from ..names import show
from ..pipeline.building import build
from ..pipeline.mechanisms import mechanism_kernels
from ..progress import Progress, StageReport, no_progress, tells_at_prompt
from ..results.kinds import Kind, Saved, declare
from ..results.stored import Stored
from ..robot.model import build_model, tool_of
from ..shown import Plotting, Shown, prefixed
from ..state.motors import turn_motors
from .holding import PoseLike
from .options import HeldRobot, StateKeywords, prepared
from .statics import deflection_of, fixed_at_rest

GUESSES = 12  # of coordinates, per point that a neighbour's do not lead to


@dataclass(frozen=True, kw_only=True)
class ComplianceMap(Plotting, Shown, Saved, plot="plot_compliance"):
    """Compliance over a grid of the tool's places; NaN where the tool cannot be.

    Attributes:
        robot, frame: names.
        coordinates: names, n.
        points: (A, B, 3), m, base frame: corner + a / (A - 1) first + b / (B - 1) second.
        q: loaded static equilibria, (A, B, n).
        deflection: (A, B, 6), see ``deflection.Deflection``.
        compliance: (A, B, 6, 6).
        notes: lines about what was assumed.
    """

    robot: Annotated[str, Stored(otherwise="")]
    frame: Annotated[str, Stored(otherwise="")]
    coordinates: Annotated[tuple[str, ...], Stored(("n",), of=str)]
    points: Annotated[Array, Stored(("A", "B", 3), "m")]
    q: Annotated[Array, Stored(("A", "B", "n"), "m, rad", unknown=True)]
    deflection: Annotated[Array, Stored(("A", "B", 6), "m, rad", unknown=True)]
    compliance: Annotated[Array, Stored(("A", "B", 6, 6), "SI", unknown=True)]
    notes: Annotated[tuple[str, ...], Stored(otherwise=())]

    @property
    def softest(self) -> Array:
        """Displacement per force in the direction where that is greatest, (A, B), m/N."""
        softest = np.full(self.points.shape[:2], np.nan)
        known = np.isfinite(self.compliance).all(axis=(2, 3))
        softest[known] = np.linalg.norm(self.compliance[known][:, :3, :3], 2, axis=(1, 2))
        return softest

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON; None where the tool cannot be."""
        softest = [[float(x) if np.isfinite(x) else None for x in row] for row in self.softest]
        return {
            "robot": self.robot,
            "frame": self.frame,
            "points": self.points.tolist(),
            "softest": softest,
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return lines of text about the map."""
        values = self.softest
        known = np.isfinite(values)
        lines = [f"{self.robot}: {self.frame} reaches {int(known.sum())} of {values.size} points"]
        if known.any():
            for word, flat in (("least", int(np.nanargmin(values))), ("most", int(np.nanargmax(values)))):
                place = ", ".join(f"{x:.4g}" for x in self.points.reshape(-1, 3)[flat])
                lines.append(f"  {word} compliance {prefixed(float(values.flat[flat]), 'm/N', 4)} at ({place}) m")
        return lines + [f"note: {note}" for note in self.notes]


declare(Kind("compliance_map", ComplianceMap, is_bare=True, is_finite=False))


@tells_at_prompt("deflecting")
def compliance_map(
    robot: RobotLike,
    corner: ArrayLike,
    first: ArrayLike,
    second: ArrayLike,
    points: tuple[int, int] = (21, 21),
    *,
    pose: PoseLike | None = None,
    frame: str | None = None,
    progress: Progress | None = None,
    **options: Unpack[StateKeywords],
) -> ComplianceMap:
    """Return compliance where the tool of the rigid robot is at the points of a parallelogram.

    Principal coordinates by inverse kinematics within their limits, from one point to the next the nearest ones; how
    the tool turns is left open.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        corner, first, second: a corner and the two edges from it, (3,) each, m, base frame.
        points: along the edges, 2 or more each.
        pose: near which the first point is looked for.
        frame: to look at; default as in ``simulate``.
        progress: called with a fraction from 0 to 1 and a line of text.
        **options: drives, kp, kd, fixed, loads, parameters and kernel, see ``StateOptions`` and ``deflection``.

    Raises:
        InputError: an argument cannot be used.
    """
    robot = as_robot(robot)
    places = _grid(corner, first, second, points)
    report = progress or no_progress
    arm = fixed_at_rest(prepared(robot, lambda text: report(0.0, text), **options))
    kernel, frame, q0 = arm.kernel, tool_of(robot, frame), arm.coordinates(pose)
    rigid = _rigid(arm, lambda text: report(0.0, text))
    index = [kernel.coordinates.index(name) for name in rigid.coordinates]
    names = build_model(robot).coordinates
    model = build_model(robot)
    driven = {names[model.motors.get(i, i)] for i in model.driven}  # joints, where motors are behind gears
    limits = limits_beside(robot, rigid.coordinates, driven, q0[index])
    shape = places.shape[:2]
    q, deflected, matrix = (np.full((*shape, *size), np.nan) for size in ((len(kernel.coordinates),), (6,), (6, 6)))
    guess, notes, unbalanced = q0, dict[str, None](), 0
    for count, (i, j) in enumerate(_serpentine(shape)):
        report(count / (shape[0] * shape[1]), "compliance")
        solution = _inverse_kinematics(rigid, frame, places[i, j], guess[index], q0[index], limits)
        if solution is None:
            continue
        reached = q0.copy()
        reached[index] = solution
        turn_motors(kernel, reached, ())
        guess = reached
        try:
            bent = deflection_of(arm, reached, frame)
        except IntegrationError:
            unbalanced += 1
            continue
        q[i, j], deflected[i, j], matrix[i, j] = bent.q, bent.deflection, bent.compliance
        notes |= dict.fromkeys(bent.notes)
    if unbalanced:
        notes[f"{unbalanced} points are reached, but have no static equilibrium"] = None
    return ComplianceMap(
        robot=robot.name,
        frame=frame,
        coordinates=kernel.coordinates,
        points=places,
        q=q,
        deflection=deflected,
        compliance=matrix,
        notes=tuple(notes),
    )


def _rigid(arm: HeldRobot, report: StageReport) -> Kernel:
    """Return the kernel by which the tool is placed.

    Of a closed mechanism that of the rigid one, which closes as a whole.
    """
    if not arm.robot.is_closed:
        return arm.kernel
    rigid = arm.robot.rigid()
    kernel = build(rigid, kernels=(*FRAME_POSES, *mechanism_kernels(rigid)), progress=report)
    kernel.parameters.update({name: x for name, x in arm.kernel.parameters.items() if name in kernel.parameters})
    return kernel


def _grid(corner: ArrayLike, first: ArrayLike, second: ArrayLike, points: tuple[int, int]) -> Array:
    begin, along, across = (space_point(*pair) for pair in (("corner", corner), ("first", first), ("second", second)))
    if np.linalg.norm(np.cross(along, across)) <= 1e-12 * np.linalg.norm(along) * np.linalg.norm(across):
        raise InputError("first and second: the edges span no plane; allowed: two that are not parallel, nor zero")
    whole = len(points) == 2 and all(isinstance(n, (int, np.integer)) and n >= 2 for n in points)
    if not whole or points[0] * points[1] > MOST_COUNTED:
        allowed = f"two whole numbers from 2 on, of {MOST_COUNTED} points together"
        raise InputError(f"points: {show(list(points))}; allowed: {allowed}")
    a, b = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in points), indexing="ij")
    return np.asarray(begin + a[..., np.newaxis] * along + b[..., np.newaxis] * across)


def _serpentine(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return every point beside the one before."""
    return [(i, j if i % 2 == 0 else shape[1] - 1 - j) for i in range(shape[0]) for j in range(shape[1])]


def _inverse_kinematics(
    kernel: Kernel, frame: str, point: Array, guess: Array, first: Array, limits: Array
) -> Array | None:
    """Return coordinates within the limits that put the frame there, from the guess or from others.

    None if there are none.
    """
    for trial in (guess, *islice(starting_points(first, limits), GUESSES)):
        solution = reach(kernel, Target(frame, point), trial, limits)
        if solution.is_there and within_limits(solution.q, limits):
            return solution.q
    return None
