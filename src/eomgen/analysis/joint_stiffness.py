"""Stiffness matrices of single joints at a state, and files of them for finite-element programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..description import RobotLike
from ..errors import UnknownNameError
from ..files import check_ending, write_atomically, write_csv
from ..names import component_name, joint_of, nearest_or_all, parameter_name
from ..progress import StageReport, tells_at_prompt
from ..robot.elements.matrices import entries_of, matrix_lines
from ..robot.elements.stiffness_center import principal_line
from ..robot.parameter_names import number_of
from ..robot.value import COORDINATES, Robot
from ..runtime.kernel import Kernel
from ..shown import Shown
from .at_rest import closed, rest
from .holding import PoseLike
from .options import StateKeywords, prepared, warn_of
from .statics import fixed_at_rest

if TYPE_CHECKING:
    from typing_extensions import Unpack

ENDINGS = (".csv", ".npz", ".mtx")  # of files that it is written to
UNITS = "N/m, N/rad, N m/rad"


@dataclass(frozen=True, kw_only=True)
class JointStiffnessMatrix(Shown):
    """Stiffness of a joint at a static equilibrium: what resists small motions of its child link in its parent link.

    Attributes:
        robot, joint: names.
        coordinates: of the joint, those that move about the state, n of "x" to "gamma".
        deviation: their values there, (n,), m or rad.
        matrix: derivatives of the forces that resist them, (n, n), N/m, N/rad, N m/rad: of the joint's springs, curves,
            contacts and stiffness matrix together; gravity, loads and elements between links are not in it.
        rigid: coordinates that the joint does not have.
        held: those that are held in this state: by locked drives, or prescribed.
        notes: lines about what was assumed.
    """

    robot: str
    joint: str
    coordinates: tuple[str, ...]
    deviation: Array
    matrix: Array
    rigid: tuple[str, ...]
    held: tuple[str, ...]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "robot": self.robot,
            "joint": self.joint,
            "deviation": dict(zip(self.coordinates, self.deviation.tolist(), strict=True)),
            "matrix": self.matrix.tolist(),
            "rigid": list(self.rigid),
            "held": list(self.held),
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return the matrix for people, with its principal stiffnesses."""
        entries = entries_of(self.matrix.tolist(), self.coordinates)
        lines = [f"{self._title()}, {UNITS}", "", *matrix_lines(entries, self.coordinates)]
        lines += [f"  {principal_line(entries)}", *(f"  {text}" for text in self._without())]
        return lines + [f"note: {note}" for note in self.notes]

    def save(self, path: Path | str) -> Path:
        """Write the matrix, and return the path: .csv or .mtx (Matrix Market) as text, or .npz.

        A .csv has the coordinates in front of the rows, a .npz in its array ``coordinates`` beside ``K``.  Rows of what
        is rigid or held are in none of them: comments, and the arrays ``rigid`` and ``held``, name these.
        """
        target = check_ending(path, *ENDINGS, label="path")
        comments = [f"{self._title()}, {UNITS}", *self._without()]
        if target.suffix == ".csv":
            return write_csv(target, [self.coordinates, *self.matrix.tolist()], comments)
        if target.suffix == ".mtx":
            comments.insert(1, f"rows and columns: {', '.join(self.coordinates)}")
            text = _market(self.matrix, comments).encode("ascii")
            return write_atomically(target, lambda stream: stream.write(text))
        texts = {key: np.array(getattr(self, key), dtype=np.str_) for key in ("coordinates", "rigid", "held")}
        names: dict[str, Any] = {"robot": self.robot, "joint": self.joint, "deviation": self.deviation, **texts}
        return write_atomically(target, lambda stream: np.savez(stream, K=self.matrix, **names))

    def _title(self) -> str:
        pairs = zip(self.coordinates, self.deviation, strict=True)
        place = ", ".join(f"{name} = {x + 0.0:.6g}" for name, x in pairs)
        return f"{self.robot}: stiffness of {self.joint} at {place}"

    def _without(self) -> list[str]:
        """Return lines about coordinates without a row: infinitely stiff, and not without stiffness."""
        kinds = {"rigid": self.rigid, "held in this state": self.held}
        return [f"{kind}, without a row: {', '.join(names)}" for kind, names in kinds.items() if names]


def _market(matrix: Array, comments: list[str]) -> str:
    """Return the text of a symmetric matrix in Matrix Market's form of arrays: its lower half by columns."""
    lines = ["%%MatrixMarket matrix array real symmetric", *(f"% {text}" for text in comments)]
    lines.append(f"{len(matrix)} {len(matrix)}")
    return "\n".join([*lines, *(repr(x) for j, row in enumerate(matrix.T.tolist()) for x in row[j:]), ""])


@tells_at_prompt("deflecting")
def joint_stiffness_matrix(
    robot: RobotLike,
    joint: str,
    pose: PoseLike | None = None,
    *,
    progress: StageReport | None = None,
    **options: Unpack[StateKeywords],
) -> JointStiffnessMatrix:
    """Return the stiffness matrix of a joint in the static equilibrium at a pose.

    It is over the joint's coordinates that move about the state, at its origin, in the axes of its parent-side frame.
    Drives are "locked", or "pd", whose gains kp count as springs.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        joint: name of one of its joints; not of a loop's.
        pose: see ``holding.pose_of``.
        progress: called with a line of text when a stage of building begins.
        **options: drives, kp, kd, held, loads, parameters and kernel, see ``StateOptions``.

    Raises:
        UnknownNameError: there is no joint of that name, or nothing of it moves.
        InputError: an argument cannot be used, or drives are free.
        IntegrationError: there is no static equilibrium near the pose.
    """
    arm = fixed_at_rest(prepared(robot, progress, **options))
    kernel, fixation = arm.kernel, arm.fixation
    active = _coordinates_of(arm.robot, joint)
    index = {name: k for k, name in enumerate(kernel.coordinates) if joint_of(name) == joint}
    places = {name: index.get(component_name(joint, name)) for name in active}
    moving = {name: k for name, k in places.items() if k is not None and not fixation.locked[k]}
    if not moving:
        raise UnknownNameError(
            f"joint: nothing of {joint} moves in this state ({', '.join(active)} held); allowed: a joint with"
            " deviations, or drives 'pd'"
        )
    q = closed(kernel, arm.coordinates(pose), fixation.locked)
    state = rest(kernel, q, fixation, arm.loads, sagging=True)
    own = list(moving.values())
    slopes = _slopes(kernel, joint, state.q)[np.ix_(own, own)] + np.diag(fixation.kp[own])
    notes = (*fixation.notes, *state.notes)
    warn_of(notes)
    return JointStiffnessMatrix(
        robot=arm.robot.name,
        joint=joint,
        coordinates=tuple(moving),
        deviation=state.q[own],
        matrix=0.5 * (slopes + slopes.T) + 0.0,
        rigid=tuple(name for name in COORDINATES if name not in active),
        held=tuple(name for name in active if name not in moving),
        notes=notes,
    )


def _coordinates_of(robot: Robot, joint: str) -> tuple[str, ...]:
    """Return the coordinates of a joint in their order; UnknownNameError where there is none."""
    joints = {x.name: tuple(name for name in COORDINATES if name in x.coordinates) for x in robot.joints}
    if joint not in joints:
        raise UnknownNameError(f"joint: there is no joint {joint!r}{nearest_or_all(joint, joints)}")
    if not joints[joint]:
        moving = [name for name, coordinates in joints.items() if coordinates]
        raise UnknownNameError(f"joint: {joint} is rigid; allowed: {', '.join(moving)}")
    return joints[joint]


def _slopes(kernel: Kernel, joint: str, q: Array) -> Array:
    """Return derivatives of all forces by all coordinates that the springs of a joint make, (n, n).

    All laws of springs are linear in their forces: with twice these there is the same once more, exactly.
    """
    owned, zero = parameter_name("joints", joint, ""), np.zeros(kernel.n)
    forces = {name: 2.0 * x for name, x in kernel.parameters.items() if name.startswith(owned) and _is_spring(name)}
    once: Callable[..., Any] = kernel.residual_jacobian
    twice: Callable[..., Any] = kernel.with_parameters(forces).residual_jacobian
    return np.asarray(twice(q, zero, zero)[0] - once(q, zero, zero)[0])


def _is_spring(parameter: str) -> bool:
    """Return whether a parameter is a force of a spring, or one per deviation."""
    number = number_of(parameter)
    return number is not None and all(unit.startswith("N") and " s" not in unit for unit in number.unit)
