"""Shares of each coordinate of each joint in a tool's deviation over a simulated motion.

To first order the tool moves by J_s s for every deviation s and for every error of a drive, J the Jacobian at the
program; what that leaves is of second order, and is stated.  In a closed mechanism J_s has what the passive coordinates
do behind s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import RANK, Array
from ..codegen.kernels.groups import FRAME_POSES
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..pipeline.building import build
from ..pipeline.mechanisms import mechanism_kernels
from ..robot.coordinates import MOTIONS, index_of, owner_of
from ..robot.model import build_model, tool_of
from ..robot.value import Robot
from ..shown import Plotting, Shown, scale_of
from ..simulation.result import SimulationResult
from ..tabular import Rows, TableColumn, Tabular
from .statics import motion_between


@dataclass(frozen=True)
class BudgetRow:
    """One coordinate's contribution, or the remainder: rms and peak size over time (m or rad), when, and its share.

    The share is the projection of the deviation onto it, integral(c . d) / integral(d . d): shares add up to
    1, and one that is negative makes the deviation smaller.
    """

    name: str
    rms: float
    peak: float
    peak_at: float
    share: float


@dataclass(frozen=True)
class Budget(Plotting, Shown, Tabular, plot="plot_budget"):
    """Error budget of a frame over time: its deviation by coordinates.

    Attributes:
        robot, frame: names.
        coordinates: names, n: deviations, and drives with their tracking errors.
        t: times, (T,), s.
        deviation: displacement (m) and rotation vector (rad) of the frame from its reference, (T, 6), base frame.
        contributions: of every coordinate to first order, (T, n, 6).
        notes: lines about what was assumed.
    """

    robot: str
    frame: str
    coordinates: tuple[str, ...]
    t: Array
    deviation: Array
    contributions: Array
    notes: tuple[str, ...]

    @property
    def remainder(self) -> Array:
        """The deviation less all contributions, (T, 6): of second order in the coordinates' deviations."""
        return np.asarray(self.deviation - self.contributions.sum(axis=1))

    def as_rows(self) -> Rows:
        """Return a row per time: deviation, contributions of the coordinates and remainder, each in six components.

        x, y and z are in m, rx, ry and rz in rad.
        """
        parts = {"deviation": self.deviation, **dict(zip(self.coordinates, self._columns(), strict=True))}
        parts["remainder"] = self.remainder
        columns = [TableColumn(name, "m or rad", values, MOTIONS, "motion") for name, values in parts.items()]
        return Rows("t", "s", self.t, columns, {"robot": self.robot, "frame": self.frame})

    def table(self, part: str = "displacement", by: str = "coordinate") -> tuple[BudgetRow, ...]:
        """Return rows of all coordinates, or joints, by falling rms, the remainder last.

        Args:
            part: "displacement" (m) or "rotation" (rad).
            by: "coordinate", or "joint", which has links that bend, too.

        Raises:
            InputError: another part, or by something else.
        """
        if by not in ("coordinate", "joint"):
            raise InputError(f"by: {by!r} is unknown; allowed: coordinate, joint")
        if part not in ("displacement", "rotation"):
            raise InputError(f"part: {part!r} is unknown; allowed: displacement, rotation")
        columns = slice(0, 3) if part == "displacement" else slice(3, 6)
        whole = self.deviation[:, columns]
        parts = self.joints() if by == "joint" else dict(zip(self.coordinates, self._columns(), strict=True))
        rows = [self._row(name, values[:, columns], whole) for name, values in parts.items()]
        rows.sort(key=lambda row: -row.rms)
        return (*rows, self._row("remainder", self.remainder[:, columns], whole))

    def _columns(self) -> Array:
        return np.swapaxes(self.contributions, 0, 1)

    def _row(self, name: str, values: Array, whole: Array) -> BudgetRow:
        size = np.linalg.norm(values, axis=1)
        peak = int(size.argmax())
        power = float(self._mean((whole * whole).sum(axis=1)))
        share = float(self._mean((values * whole).sum(axis=1))) / power if power > 0.0 else 0.0
        rms = float(np.sqrt(self._mean(size**2)))
        return BudgetRow(name, rms, float(size[peak]), float(self.t[peak]), share)

    def _mean(self, values: Array) -> Any:
        """Return the mean over time, by the trapezoidal rule."""
        if len(self.t) < 2:
            return values[0]
        return (0.5 * (values[1:] + values[:-1]) * np.diff(self.t)).sum() / (self.t[-1] - self.t[0])

    def joints(self) -> dict[str, Array]:
        """Return contributions summed over each joint's coordinates, and each bending link's: (T, 6) by name.

        Links that bend are "arm.modes".
        """
        by_owner: dict[str, Array] = {}
        for name, values in zip(self.coordinates, self._columns(), strict=True):
            owner = owner_of(name)
            by_owner[owner] = by_owner.get(owner, np.zeros_like(self.deviation)) + values
        return by_owner

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        tables = {
            space: {by: [dict(vars(row)) for row in self.table(space, by)] for by in ("coordinate", "joint")}
            for space in ("displacement", "rotation")
        }
        return {"robot": self.robot, "frame": self.frame, "samples": len(self.t), **tables, "notes": list(self.notes)}

    def lines(self, most: int = 15) -> list[str]:
        """Return ranked tables for people, of the ``most`` largest coordinates, then of the joints."""
        lines = [
            f"{self.robot}: error of {self.frame} against its reference trajectory, to first order in each coordinate"
        ]
        for space, columns, unit in (("displacement", slice(0, 3), "m"), ("rotation", slice(3, 6), "rad")):
            size = np.linalg.norm(self.deviation[:, columns], axis=1)
            rms = float(np.sqrt(self._mean(size**2)))
            scale, unit = scale_of(size.max(), unit)
            lines += ["", f"{space}: rms {scale * rms:.4g} {unit}, peak {scale * size.max():.4g} {unit}"]
            lines.append(
                f"{'coordinate, joint':<28}{f'rms [{unit}]':>12}{f'peak [{unit}]':>12}{'at [s]':>10}{'share':>9}"
            )
            rows = self.table(space)
            for row in (*rows[:-1][:most], rows[-1], *self.table(space, "joint")[:-1]):
                sizes = f"{scale * row.rms:>12.4g}{scale * row.peak:>12.4g}"
                lines.append(f"{row.name:<28}{sizes}{row.peak_at:>10.3f}{100 * row.share:>8.1f}%")
        return lines + [f"note: {note}" for note in self.notes]


class _Following:
    """How the passive coordinates of a closed mechanism follow the others on its reference trajectory.

    ``program`` are all coordinates there, (T, n), deviations zero.
    """

    def __init__(self, robot: Robot, result: SimulationResult) -> None:
        motion = result.trajectory
        names = motion.coordinates
        self.passive, prescribed = (index_of(names, names_of) for names_of in (result.passive, result.prescribed))
        loops = tuple(loop.rigid() for loop in robot.loops)
        firm = replace(robot, loops=loops, tunable=())
        kernel = build(firm, kernels=mechanism_kernels(firm))
        guess = np.zeros_like(motion.q)
        for columns in (self.passive, prescribed):
            guess[:, columns] = motion.q[:, columns]
        guess[:, index_of(names, result.program_coordinates)] = result.program_q
        held = [name for name in names if name not in result.passive]
        self.program = np.asarray(kernel.assemble(guess, held))
        J = kernel.functions.constraint_jacobian(self.program)
        self.others = np.setdiff1d(np.arange(len(names)), self.passive)
        self.slopes = -np.linalg.pinv(J[:, :, self.passive], rcond=RANK) @ J[:, :, self.others]

    def split(self, J: Array, off: Array) -> tuple[Array, Array]:
        """Return Jacobians, (T, 6, n), and deviations of coordinates, (T, n), dependent ones counted in their causes.

        Of passive coordinates that leaves what no other accounts for: compliant loop joints.
        """
        J, off = J.copy(), off.copy()
        off[:, self.passive] -= np.einsum("tij,tj->ti", self.slopes, off[:, self.others])
        J[:, :, self.others] += J[:, :, self.passive] @ self.slopes
        return J, off


def budget(
    result: SimulationResult, robot: RobotLike, *, frame: str | None = None, kernel: Kernel | None = None
) -> Budget:
    """Take the deviation of a frame in a simulation apart.

    Args:
        result: of ``simulate``.
        robot: the one that was simulated: a Robot, the name of a built-in one, or the path of a description.
        frame: frame or link; that of the result by default.
        kernel: of the robot, float64, with kinematics; built if None.

    Raises:
        InputError: the result is of another robot, or holds values that are not finite.
        LoopError: the rigid mechanism does not close on the reference.
        UnknownNameError: no frame or link of that name.
    """
    robot = as_robot(robot)
    check_kind("result", result, hasattr(result, "trajectory"), "a SimulationResult")
    motion = result.trajectory
    if build_model(robot).coordinates != motion.coordinates:
        raise InputError(
            f"result: {result.robot} has not the coordinates of {robot.name}; allowed: the robot simulated"
        )
    frame = tool_of(robot, frame or result.tool)
    kernel = kernel or build(robot, kernels=FRAME_POSES)
    program = np.zeros_like(motion.q)
    program[:, index_of(motion.coordinates, result.program_coordinates)] = result.program_q
    following = None
    if result.passive:
        following = _Following(robot, result)
        program = following.program
    before, after = (np.asarray(kernel.frame_pose(q, frame)) for q in (program, np.ascontiguousarray(motion.q)))
    J, off = np.asarray(kernel.frame_jacobian(program, frame)), motion.q - program
    if following is not None:
        J, off = following.split(J, off)
    contributions = np.swapaxes(J * off[:, np.newaxis, :], 1, 2)
    notes = []
    if frame == result.tool and np.abs(before - result.program_pose).max() > 1e-6:
        notes.append("the program's poses in the result are not those of this robot: its numbers have changed since")
    notes.append(f"of {', '.join(result.program_coordinates)}: the errors of the drives")
    deviation = np.array([motion_between(*pair) for pair in zip(before, after, strict=True)])
    return Budget(robot.name, frame, motion.coordinates, motion.t, deviation, contributions, tuple(notes))
