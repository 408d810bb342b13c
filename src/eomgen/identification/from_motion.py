"""From measured motion to forces: drives, springs, dampers and joint reaction wrenches; and to stiffness and damping.

The paper's inverse use of its model: from what the variations in the joints are, the forces and moments that belong to
them.  ``forces`` evaluates the equations of motion; ``fit`` finds parameters (``fitting``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ..arrays import Array
from ..codegen.kernels.groups import FORCES_OF_MOTIONS, kernel_group
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel
from ..motion.files import MeasuredMotion, measured_motion
from ..motion.measured_numbers import answers_in_numbers
from ..motion.smoothing import local_polynomials
from ..names import component_name, split_component
from ..pipeline.building import build
from ..pipeline.mechanisms import mechanism_kernels
from ..progress import StageReport, tells_at_prompt
from ..results.contents import Contents
from ..results.kinds import Kind, SavedColumns, declare
from ..results.stored import Stored
from ..robot.coordinates import FORCES, force_unit_of, index_of, unit_of
from ..robot.model import build_model
from ..robot.parameter_names import JOINTS
from ..robot.value import ANGULAR
from ..shown import Shown
from ..state.elements import damping_forces, stiffness_forces
from ..state.motors import deflections
from ..state.springs import law_numbers
from ..state.turning import quaternion_columns
from ..tabular import Rows, TableColumn, Tabular
from .closed_motions import closed_motion
from .relations import refuse_internal_states
from .rotating import rotation_derivatives
from .stiffness.result import KEYS

WINDOW, DEGREE = 11, 4


@dataclass(frozen=True, kw_only=True)
class ForcesResult(Shown, Tabular, SavedColumns):
    """Forces of a measured motion.

    In every coordinate required = drive + spring + damper + line + closing: what accelerates the links against gravity,
    and what exerts it.  Where nothing drives a coordinate, ``drive`` is what the springs and dampers leave unexplained.

    Attributes:
        robot: the robot's name.
        t: times, (T,), s.
        coordinates, joints: names, n and j of them.
        measured: names of the coordinates that were measured; the others are held at zero.
        q, v, a: the motion that was used, (T, n).
        required: M a + bias - Q_G, (T, n), N or N m.
        drive: u of inverse dynamics, (T, n), N or N m.
        spring, damper: -a s and -b s_dot of eq. (13), (T, n), N or N m.
        line: of springs and dampers between two points, (T, n), N or N m.
        closing: of what closes loops and couples coordinates, rigid or elastic, (T, n), N or N m.
        springs: names of those, s of them.
        lengths, tensions: of each, (T, s), m and N; tension is positive where it pulls.
        reactions: what each joint exerts on its child link, (T, j, 6): force, moment, in the joint frame after
            the motion (child side); N, N m.
        loops: names of the loop joints, l of them.
        loop_reactions: what each of those exerts on its second link, (T, l, 6): force, moment, at the origin and in the
            axes of the cut frame on that link; N, N m.
        is_closed: whether the robot has loops or couplings.
        notes: lines about the method and about what was assumed.
    """

    robot: str
    t: Annotated[Array, Stored(("T",), "s")]
    coordinates: Annotated[tuple[str, ...], Stored(("n",))]
    joints: Annotated[tuple[str, ...], Stored(("j",))]
    measured: tuple[str, ...]
    q: Annotated[Array, Stored(("T", "n"), "m, rad")]
    v: Annotated[Array, Stored(("T", "n"), "m/s, rad/s")]
    a: Annotated[Array, Stored(("T", "n"), "m/s^2, rad/s^2")]
    required: Annotated[Array, Stored(("T", "n"), "N, N m")]
    drive: Annotated[Array, Stored(("T", "n"), "N, N m")]
    spring: Annotated[Array, Stored(("T", "n"), "N, N m")]
    damper: Annotated[Array, Stored(("T", "n"), "N, N m")]
    line: Annotated[Array, Stored(("T", "n"), "N, N m")]
    closing: Annotated[Array, Stored(("T", "n"), "N, N m")]
    springs: Annotated[tuple[str, ...], Stored(("s",))]
    lengths: Annotated[Array, Stored(("T", "s"), "m")]
    tensions: Annotated[Array, Stored(("T", "s"), "N")]
    reactions: Annotated[Array, Stored(("T", "j", 6), "N, N m")]
    loops: Annotated[tuple[str, ...], Stored(("l",))]
    loop_reactions: Annotated[Array, Stored(("T", "l", 6), "N, N m")]
    is_closed: bool
    notes: tuple[str, ...]

    @property
    def supports(self) -> dict[str, Array]:
        """Reactions by the names of the joints, then of the loop joints, (T, 6) each, N and N m."""
        reactions = {name: self.reactions[:, k] for k, name in enumerate(self.joints)}
        return reactions | {name: self.loop_reactions[:, k] for k, name in enumerate(self.loops)}

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the forces of a coordinate: "line" where there are point-to-point springs, "closing" with loops."""
        more = ("line",) if self.springs else ()
        return ("required", "drive", "spring", "damper", *more, *(("closing",) if self.is_closed else ()))

    def as_rows(self) -> Rows:
        """Return a row per time: every coordinate, with .rate, .acceleration and each of ``parts``.

        Springs follow with .length and .tension; joints and loops with .reaction, in six components, N and N m; joints
        with alpha, beta and gamma with .qw, .qx, .qy and .qz, unit quaternions.
        """
        columns = []
        for i, name in enumerate(self.coordinates):
            unit, force = unit_of(name), force_unit_of(name)
            columns += [TableColumn(name, unit, self.q[:, i]), TableColumn(f"{name}.rate", f"{unit}/s", self.v[:, i])]
            columns.append(TableColumn(f"{name}.acceleration", f"{unit}/s^2", self.a[:, i]))
            columns += [TableColumn(f"{name}.{kind}", force, getattr(self, kind)[:, i]) for kind in self.parts]
        for i, name in enumerate(self.springs):
            columns.append(TableColumn(f"{name}.length", "m", self.lengths[:, i]))
            columns.append(TableColumn(f"{name}.tension", "N", self.tensions[:, i]))
        for name, wrench in self.supports.items():
            columns.append(TableColumn(f"{name}.reaction", "N or N m", wrench, FORCES, "force"))
        columns += [TableColumn(name, "", x) for name, x in quaternion_columns(self.coordinates, self.q).items()]
        return Rows("t", "s", self.t, columns, {"robot": self.robot})

    def as_dict(self) -> dict[str, Any]:
        """Return largest values with their signs and times, plain values, for JSON."""
        parts = self.parts
        between = {
            name: {"length": self._peak(self.lengths[:, i]), "tension": self._peak(self.tensions[:, i])}
            for i, name in enumerate(self.springs)
        }
        return {
            "robot": self.robot,
            "samples": len(self.t),
            "duration": float(self.t[-1] - self.t[0]),
            "coordinates": {
                name: {kind: self._peak(getattr(self, kind)[:, i]) for kind in parts}
                for i, name in enumerate(self.coordinates)
            },
            **({"springs": between} if between else {}),
            "reactions": {
                name: {
                    "force": self._peak(np.linalg.norm(wrench[:, :3], axis=1)),
                    "moment": self._peak(np.linalg.norm(wrench[:, 3:], axis=1)),
                }
                for name, wrench in self.supports.items()
            },
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return a table of the largest values for people."""
        facts = self.as_dict()
        lines = [f"{self.robot}: {len(self.t)} samples, {facts['duration']:g} s; largest values over time", ""]
        lines.append(f"{'coordinate':<28}" + "".join(f"{kind:>12}" for kind in self.parts))
        for name, row in facts["coordinates"].items():
            label = f"{name} [{force_unit_of(name)}]"
            lines.append(f"{label:<28}" + "".join(f"{entry['value']:>12.4g}" for entry in row.values()))
        lines += _peak_lines("spring between points", {"tension": "N", "length": "m"}, facts.get("springs", {}))
        lines += _peak_lines("joint reaction", {"force": "N", "moment": "N m"}, facts["reactions"])
        return lines + ["", *(f"note: {note}" for note in self.notes)]

    def columns(self) -> dict[str, Array]:
        """Return forces over time by name, (T,) each: t, NAME.required, NAME.drive, ..., JOINT.reaction.fx, ...

        Loop joints have the name of their loop.  Springs between two points: SPRING.length, SPRING.tension.
        """
        forces = (*self.parts, "length", "tension", "reaction")
        columns = [column for column in self.as_rows().columns if split_component(column.name)[1] in forces]
        return {"t": self.t, **{name: values for column in columns for name, values in column.flat()}}

    def _peak(self, values: Array) -> dict[str, float]:
        place = int(np.abs(values).argmax())
        return {"value": float(values[place]), "at": float(self.t[place])}


def _peak_lines(title: str, units: Mapping[str, str], facts: Mapping[str, Any]) -> list[str]:
    """Return lines of a table of two largest values of each, with their times; none where there are none."""
    (one, unit), (other, its_unit) = units.items()
    lines = ["", f"{title:<28}{f'{one} [{unit}]':>12}{'at [s]':>10}{f'{other} [{its_unit}]':>14}{'at [s]':>10}"]
    for name, row in facts.items():
        a, b = row[one], row[other]
        lines.append(f"{name:<28}{a['value']:>12.4g}{a['at']:>10.4g}{b['value']:>14.4g}{b['at']:>10.4g}")
    return lines if facts else []


_COLUMN = Stored(("T",), "N, N m")
_PARTS = ("required", "drive", "spring", "damper", "line", "closing")


def _rebuild(file: Contents) -> dict[str, Array]:
    """Return arrays of coordinates, springs, joints and loops that stand in a file as ``columns``."""
    names = {key: file.value(tuple[str, ...], key) for key in ("coordinates", "springs", "joints", "loops")}
    rows = len(file.array("t", _COLUMN))

    def stacked(owners: Sequence[str], kind: str) -> Array:
        columns = [file.array(f"{name}.{kind}", _COLUMN) for name in owners]
        return np.stack(columns, axis=-1) if columns else np.zeros((rows, 0))

    def wrenches(owners: Sequence[str]) -> Array:
        axes = [stacked(owners, f"reaction.{axis}") for axis in FORCES]
        return np.stack(axes, axis=-1)

    has = {"line": bool(names["springs"]), "closing": file.value(bool, "is_closed")}  # else they are 0, and not there
    nothing = np.zeros((rows, len(names["coordinates"])))
    return {
        **{term: stacked(names["coordinates"], term) if has.get(term, True) else nothing for term in _PARTS},
        "lengths": stacked(names["springs"], "length"),
        "tensions": stacked(names["springs"], "tension"),
        "reactions": wrenches(names["joints"]),
        "loop_reactions": wrenches(names["loops"]),
    }


declare(
    Kind(
        "forces",
        ForcesResult,
        what="forces of a motion",
        rebuilt=(*_PARTS, "lengths", "tensions", "reactions", "loop_reactions"),
        record=ForcesResult.columns,
        rebuild=_rebuild,
    )
)


@answers_in_numbers("motion")
@tells_at_prompt("evaluating")
def forces(
    robot: RobotLike,
    motion: MeasuredMotion | Path | str,
    *,
    window: int = WINDOW,
    degree: int = DEGREE,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> ForcesResult:
    """Return forces and moments that belong to a measured motion.

    Velocities and accelerations that the motion does not have come from local polynomials (``smoothing``), and so do
    then the coordinates: a longer window smooths more, and bends motions that are fast beside it.  Of joints that turn
    freely (``Model.turning``) quaternions or angular velocities are smoothed in the place of angles.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; the motion has its
            coordinates, and what is not measured is held at zero, or follows where loops and couplings say how.
        motion: from ``read_motion`` or ``motion_from_columns``, or the path of a file.
        window, degree: samples and degree of the local polynomials.
        kernel: of that robot, float64, with inverse_dynamics and reactions, with what closes loops
            (``mechanism_kernels``), with loop_reactions where there are loops, cut_forces and cut_jacobian where there
            are ``cut_laws``; built if None.  Its parameters count.

    Raises:
        InputError: the file or an argument cannot be used, a motion leaves a mechanism's coordinates open, or laws have
            states, which are not measured.
        LoopError: loops do not close near a sample, or the drives cannot make the motion.
    """
    robot = as_robot(robot)
    if kernel is None:
        names = (*kernel_group(robot, FORCES_OF_MOTIONS), *mechanism_kernels(robot))
        kernel = build(robot, kernels=names, progress=progress or (lambda _: None))
    refuse_internal_states(kernel, "robots without, as robot.without_states() is")
    motion = measured_motion(robot, motion, kernel.coordinates)
    _refuse_transmissions(kernel, motion)
    model = build_model(robot)
    q, v, a, notes = _derivatives(motion, window, degree, [model.bodies[k].joint for k in model.turning])
    following: tuple[str, ...] = ()
    if kernel.constraints:
        q, v, a, following = closed_motion(kernel, model, motion.measured, q, v, a)
    if following:
        notes.append(f"not in the file, they follow from the others: {', '.join(following)}")
    drive = np.asarray(kernel.inverse_dynamics(q, v, a))
    rows = deflections(kernel)
    numbers = (np.array([law.get(key, 0.0) for law in law_numbers(kernel).values()]) for key in KEYS)
    off = np.concatenate([np.zeros(kernel.n), follower_matrix(kernel)[1]])  # of followers, where coordinates are 0
    pairs_of = zip((q, v), (off, 0.0 * off), numbers, strict=True)
    spring, damper = (-((x @ rows.T + shift) * k) @ rows for x, shift, k in pairs_of)
    spring, damper = spring - stiffness_forces(kernel, q), damper - damping_forces(kernel, q, v)
    line, pairs = np.zeros_like(q), np.zeros((len(q), 0, 2))
    if kernel.springs:
        pairs = np.asarray(kernel.functions.spring_forces(q, v))
        line = -np.einsum("tsn,ts->tn", kernel.functions.spring_jacobian(q), pairs[..., 1])
    if kernel.element_rows:
        resisting = np.asarray(kernel.functions.element_forces(q, v))[..., 1]
        line = line - np.einsum("ten,te->tn", kernel.functions.element_jacobian(q), resisting)
    closing = _closing(kernel, q, v, np.asarray(kernel.inverse_dynamics(q, v, a, cut=True)) - drive)
    held = [name for name in motion.coordinates if name not in {*motion.measured, *following}]
    if held:
        notes.append(f"not in the file, held at zero: {', '.join(held)}")
    return ForcesResult(
        robot=robot.name,
        t=motion.t,
        coordinates=kernel.coordinates,
        joints=kernel.joints,
        measured=motion.measured,
        q=q,
        v=v,
        a=a,
        required=drive + spring + damper + line + closing,
        drive=drive,
        spring=spring,
        damper=damper,
        line=line,
        closing=closing,
        springs=kernel.springs,
        lengths=pairs[..., 0],
        tensions=pairs[..., 1],
        reactions=np.asarray(kernel.reactions(q, v, a)),
        loops=tuple(kernel.loops),
        loop_reactions=np.asarray(kernel.loop_reactions(q, v, a)) if kernel.loops else np.zeros((len(q), 0, 6)),
        is_closed=robot.is_closed,
        notes=tuple(notes),
    )


def _closing(kernel: Kernel, q: Array, v: Array, rigid: Array) -> Array:
    """Return generalized forces of what closes the loops, (T, n).

    Multipliers of the rigid constraint, and laws in cuts and couplings.
    """
    if not kernel.cut_laws:
        return rigid
    resisting = kernel.functions.cut_forces(q, v)[..., 1]
    return np.asarray(rigid - np.einsum("tcn,tc->tn", kernel.functions.cut_jacobian(q), resisting))


def _refuse_transmissions(kernel: Kernel, motion: MeasuredMotion) -> None:
    """Raise InputError where the force of a motor's transmission is not known from what was measured, or not linear."""
    for motor, principal in kernel.motors.items():
        for name in (motor, principal):
            if name not in motion.measured:
                raise InputError(
                    f"forces: {name} was not measured; allowed: both ends of the transmission in the motion"
                )
        names, places = tuple(kernel.parameters), kernel.elements[JOINTS].get(motor, {})
        laws = [names[place] for place in places.values() if not _is_plain(names[place])]
        if laws:
            raise InputError(f"forces: {laws[0]}: allowed: transmissions of stiffness and damping alone")


def _is_plain(name: str) -> bool:
    return ".friction." in name or name.endswith((*(f".{key}" for key in KEYS), ".inertia", ".ratio"))


def _derivatives(
    motion: MeasuredMotion, window: int, degree: int, turning: Sequence[str]
) -> tuple[Array, Array, Array, list[str]]:
    """Return coordinates, velocities and accelerations, and their origin; ``turning``: joints with 3-DOF rotation."""
    if motion.v is not None and motion.a is not None:
        return motion.q, motion.v, motion.a, ["rates and accelerations: from the file"]
    span = float(np.median(np.diff(motion.t))) * (window - 1) if len(motion.t) > 1 else 0.0
    method = f"local polynomials of degree {degree} through {window} samples ({span:.4g} s), Savitzky-Golay"
    if motion.v is not None:
        q, (v, a, _) = motion.q.copy(), local_polynomials(motion.t, motion.v, window, degree)
        notes = [f"rates: from the file, smoothed; accelerations: their derivatives; {method}"]
    else:
        q, v, a = local_polynomials(motion.t, motion.q, window, degree)
        notes = [f"coordinates smoothed, rates and accelerations: derivatives of {method}"]
    for joint in turning:
        at = index_of(motion.coordinates, [component_name(joint, angle) for angle in ANGULAR])
        rates = None if motion.v is None else motion.v[:, at]
        q[:, at], v[:, at], a[:, at] = rotation_derivatives(motion.t, motion.q[:, at], rates, window, degree)
    if turning:
        what = "quaternions" if motion.v is None else "angular velocities"
        notes.append(f"in the place of angles of {', '.join(turning)}: {what}, which have no poles")
    return q, v, a, notes
