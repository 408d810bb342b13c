"""Static deflection and stiffness of a frame under gravity and wrenches, and stiffness of single joints there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ..arrays import Array, rank_of
from ..bending.beams.resultants import COMPONENTS, StressResultants, stress_resultants
from ..codegen.kernels.groups import FRAME_POSES, JOINT_REACTIONS, kernel_group
from ..codegen.kernels.signatures import KERNELS
from ..description import RobotLike
from ..description.matrix_files import read_matrix
from ..errors import InputError, LoopError, UnknownNameError
from ..files import check_ending, write_atomically, write_csv
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..names import component_name, joint_of, nearest_or_all, parameter_name
from ..pipeline.building import build
from ..progress import StageReport, tells_at_prompt
from ..robot.coordinates import MOTIONS, index_of
from ..robot.elements.matrices import entries_of, matrix_lines
from ..robot.elements.stiffness_center import principal_line
from ..robot.model import tool_of
from ..robot.parameter_names import number_of
from ..robot.value import AXES, COORDINATES, Link, Robot, node_link
from ..robot.value.nodes import SLIDING
from ..runtime.bound import wrench_rows
from ..shown import Plotting, Shown, scale_of
from .at_rest import closed, rest
from .holding import Fixation, PoseLike, floating, floating_cuts
from .options import HeldRobot, StateKeywords, prepared, warn_of
from .tangent_system import moving_basis, refuse_singular_pose

RANK = 1e-9  # of the greatest principal compliance: what is taken to be zero
SOFT = 1e-13  # of the greatest stiffness, scaled: nothing holds what has less
MATRIX_ENDINGS = (".csv", ".npz", ".mtx")  # of files that it is written to
LEFT = 1e-6  # of the greatest force in an equilibrium: what its search may leave
UNITS = "N/m, N/rad, N m/rad"
NO_BEAM = "no link of {} is a beam, whose stress resultants could be written; allowed: with --map or --matrix"


@dataclass(frozen=True, kw_only=True)
class Deflection(Plotting, Shown, plot="plot_stress_resultants"):
    """A frame under load, beside the rigid robot; its plot has the stress resultants of beams.

    Attributes:
        robot, frame: names.
        coordinates: names, n.
        q: the loaded static equilibrium, (n,), m or rad.
        u: forces that hold it, (n,), N or N m.
        rigid_pose, pose: of the frame without and with all deviations, (4, 4), base frame, m.
        deflection: displacement (m) and rotation vector (rad) from the one to the other, (6,), base frame.
        by_loads: what the wrenches add to gravity's deflection, (6,).
        compliance: change of displacement and rotation per change of a wrench at the frame, (6, 6), base frame: m/N,
            rad/N, m/(N m), rad/(N m); the derivative at the loaded state.
        stiffness: its inverse, (6, 6), or None where there is none.
        rank: of the compliance, in units that make both of its diagonal blocks one size.
        notes: lines about what was assumed.
        beams: stress resultants of links that are beams.
    """

    robot: str
    frame: str
    coordinates: tuple[str, ...]
    q: Array
    u: Array
    rigid_pose: Array
    pose: Array
    deflection: Array
    by_loads: Array
    compliance: Array
    stiffness: Array | None
    rank: int
    notes: tuple[str, ...]
    beams: tuple[StressResultants, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "robot": self.robot,
            "frame": self.frame,
            "q": dict(zip(self.coordinates, self.q.tolist(), strict=True)),
            "u": dict(zip(self.coordinates, self.u.tolist(), strict=True)),
            "deflection": dict(zip(MOTIONS, self.deflection.tolist(), strict=True)),
            "by_loads": dict(zip(MOTIONS, self.by_loads.tolist(), strict=True)),
            "compliance": self.compliance.tolist(),
            "stiffness": None if self.stiffness is None else self.stiffness.tolist(),
            "rank": self.rank,
            **({"beams": [beam.as_dict() for beam in self.beams]} if self.beams else {}),
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return deflection and stiffness for people."""
        lines = [f"{self.robot}: {self.frame} beside that of the rigid robot, base frame", ""]
        lines.append(f"{'':<10}{'deflection':>14}{'of it by loads':>16}")
        for k, component in enumerate(MOTIONS):
            mine = slice(0, 3) if k < 3 else slice(3, 6)
            scale, unit = scale_of([self.deflection[mine], self.by_loads[mine]], "m" if k < 3 else "rad")
            numbers = f"{scale * self.deflection[k]:>14.5g}{scale * self.by_loads[k]:>16.5g}"
            lines.append(f"{component + ' [' + unit + ']':<10}{numbers}")
        matrix, title = (
            self.compliance,
            f"compliance [m, rad per N, N m], of rank {self.rank} of 6: no stiffness matrix",
        )
        if self.stiffness is not None:
            matrix, title = self.stiffness, "stiffness [N, N m per m, rad]"
        lines += ["", title]
        lines += ["".join(f"{value:>13.4g}" for value in row) for row in matrix]
        for beam in self.beams:
            lines += ["", *beam.lines()]
        return lines + [f"note: {note}" for note in self.notes]

    def save(self, path: Path | str) -> Path:
        """Write the stress resultants of beams to a .csv, a row for every section, and return the path.

        Raises:
            InputError: no link of the robot is a beam, or the file cannot be written.
        """
        target = check_ending(path, ".csv", label="path")
        if not self.beams:
            raise InputError(f"path: {NO_BEAM.format(self.robot)}")
        rows: list[list[Any]] = [["beam", "x", *COMPONENTS, "stress"]]
        for beam in self.beams:
            stress = [""] * len(beam.x) if beam.stress is None else beam.stress.tolist()
            for x, row, most in zip(beam.x.tolist(), beam.resultants.tolist(), stress, strict=True):
                rows.append([beam.link, x, *row, most])
        return write_csv(target, rows, [f"{self.robot}: stress resultants of beams, m, N, N m, N/m^2"], read=None)


@tells_at_prompt("deflecting")
def deflection(
    robot: RobotLike,
    pose: PoseLike | None = None,
    *,
    frame: str | None = None,
    progress: StageReport | None = None,
    **options: Unpack[StateKeywords],
) -> Deflection:
    """Return deflection and stiffness of a frame in the static equilibrium at a pose.

    Drives are "locked", or "pd": springs kp (target - q) about the pose, which sag under gravity, too.  The rigid
    robot is the pose itself; of a robot with loops the pose with its loops closed.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; prescribed coordinates stay.
        pose: see ``holding.pose_of``.
        frame: to look at; default as in ``simulate``.
        progress: called with a line of text when a stage of building begins.
        **options: drives, kp, kd, fixed, loads, parameters and kernel, see ``StateOptions``.

    Raises:
        InputError: an argument cannot be used, drives are free, nothing holds a coordinate, or a loop is singular.
        IntegrationError: there is no static equilibrium near the pose.
    """
    arm = fixed_at_rest(prepared(robot, progress, **options))
    bent = deflection_of(arm, arm.coordinates(pose), tool_of(arm.robot, frame))
    warn_of(bent.notes)
    return replace(bent, beams=_stress_resultants(arm, bent.q))


def _stress_resultants(arm: HeldRobot, q: Array) -> tuple[StressResultants, ...]:
    """Return stress resultants of all links that are beams, in a static equilibrium q, (coordinates,).

    Raises:
        InputError: of a robot with loops that neither drives nor held coordinates alone hold.
    """
    robot, kernel = arm.robot, arm.kernel
    beams = [(link, link.beam) for link in robot.links if link.beam is not None]
    if not beams:
        return ()
    reacting = kernel
    if not kernel.raw.has(*JOINT_REACTIONS):
        reacting = build(robot, kernels=() if robot.is_closed else kernel_group(robot, FRAME_POSES, JOINT_REACTIONS))
        reacting.parameters.update(kernel.parameters)
    still = np.zeros(len(kernel.coordinates))
    z = arm.fixation.z
    try:
        wrenches = reacting.reactions(q, still, still, wrench=arm.loads or None, z=z)
    except LoopError as error:
        wrenches = _reactions_of_held(arm, q, error)
    reactions = dict(zip(reacting.joints, wrenches, strict=True))  # of joints on their children, in their own axes
    gravity = [kernel.parameters[parameter_name("gravity", axis)] for axis in "xyz"]
    found = []
    for link, beam in beams:
        assert link.modes is not None
        loads = _beam_loads(arm, link, np.array(AXES[beam.axis])[:, 0], q, reactions)
        e = q[index_of(kernel.coordinates, [component_name(link.name, kind) for kind in link.modes.names])]
        turn = np.asarray(kernel.frame_pose(q, link.name))[:3, :3]
        found.append(stress_resultants(link, beam, e, turn.T @ gravity, loads))
    return tuple(found)


def _reactions_of_held(arm: HeldRobot, q: Array, error: LoopError) -> Array:
    """Return reactions, (joints, 6), in an equilibrium q, (coordinates,), in which held coordinates hold a mechanism.

    What holds them is what the tree needs there beside J^T lambda, where lambda follows from the coordinates that are
    not held; their forces count as external ones, so that nothing is left to drives.

    Args:
        arm: with loops.
        q: in static equilibrium.
        error: of reactions by drives alone.

    Raises:
        InputError: held coordinates do not hold it, or stand against each other through loops.
    """
    kernel, still = arm.kernel, np.zeros(len(arm.kernel.coordinates))
    whole, z = build(arm.robot), arm.fixation.z
    whole.parameters.update(kernel.parameters)
    held = arm.fixation.still
    needed = whole.inverse_dynamics(q, still, still, wrench=arm.loads or None, cut=True, z=z)
    J = whole.functions.constraint_jacobian(q)
    multipliers = np.linalg.lstsq(J[:, ~held].T, needed[~held], rcond=RANK)[0]
    holding = needed - J.T @ multipliers
    if rank_of(J[:, ~held]) < rank_of(J) or np.abs(holding[~held]).max(initial=0.0) > LEFT * np.abs(needed).max():
        stay, driven = (
            ", ".join(np.array(kernel.coordinates)[mask]) or "nothing"
            for mask in (arm.fixation.still, arm.fixation.driven)
        )
        raise InputError(
            f"{arm.robot.name}: stress resultants of beams follow from what passes its loops, but {stay} is held, and"
            f" {driven} is driven; allowed: fixed=[], or as many coordinates in it as hold the mechanism"
        ) from error
    total = holding * held
    if arm.loads:
        total = total + whole.functions.external_force(q, arm.loads)
    values, calls = (q, still, still, total), whole.calls
    return calls.run_with_wrench(
        KERNELS[JOINT_REACTIONS[0]].loaded, None, values, wrench_rows(calls, q, arm.loads or None), z
    )


def _beam_loads(
    arm: HeldRobot, link: Link, along: Array, q: Array, reactions: Mapping[str, Array]
) -> list[tuple[float, Array, Array]]:
    """Return what acts on a beam where nodes and sliding joints are: place, pose, wrench, see ``stress_resultants``.

    Args:
        arm: with the kernel.
        link: the beam.
        along: its direction, link frame, (3,).
        q: coordinates, (coordinates,).
        reactions: of each joint on its child link, (6,), in the joint's axes.
    """
    assert link.modes is not None
    robot, kernel = arm.robot, arm.kernel
    pose = np.asarray(kernel.frame_pose(q, link.name))

    def seen(name: str) -> Array:
        return np.asarray(np.linalg.solve(pose, kernel.frame_pose(q, name)))

    loads: list[tuple[float, Array, Array]] = []
    for node in link.modes.nodes:
        name = node_link(link.name, node.name)
        if name in reactions:  # else no mode moves it: it stands at the root
            loads.append((float(along @ node.place), seen(name), -reactions[name]))
    for joint in robot.joints:  # behind what slides on the straight axis, a joint has what the modes do there
        name = node_link(link.name, joint.name)
        if joint.type == SLIDING and (joint.parent, joint.child) == (link.name, name) and name in reactions:
            loads.append((float(along @ seen(name)[:3, 3]), seen(robot.joint(name).child), -reactions[name]))
    return loads


def fixed_at_rest(arm: HeldRobot) -> HeldRobot:
    """Lock everything that stays in the state; InputError if drives are free."""
    held = arm.fixation
    if held.drives == "free":
        raise InputError("drives: 'free' drives hold nothing in place; allowed: locked, pd")
    return replace(arm, fixation=replace(held, locked=held.still & ~(held.driven & (held.kp > 0.0))))


def deflection_of(arm: HeldRobot, q: Array, frame: str) -> Deflection:
    """Return deflection and stiffness of a frame near coordinates q, (n,), of the rigid robot.

    Errors as ``deflection``.
    """
    kernel, fixation, loads = arm.kernel, arm.fixation, arm.loads
    q = closed(kernel, q, fixation.locked)
    state = rest(kernel, q, fixation, loads, sagging=True)
    unloaded = rest(kernel, q, fixation, {}, sagging=True).q if loads else state.q
    rigid_pose, pose, before = (np.asarray(kernel.frame_pose(x, frame)) for x in (q, state.q, unloaded))
    compliance = _compliance(kernel, state.q, state.tangent.K + np.diag(fixation.kp), fixation, frame)
    rank, stiffness = _inverse(compliance)
    whole = motion_between(rigid_pose, pose)
    return Deflection(
        robot=arm.robot.name,
        frame=frame,
        coordinates=kernel.coordinates,
        q=state.q,
        u=state.u,
        rigid_pose=rigid_pose,
        pose=pose,
        deflection=whole,
        by_loads=whole - motion_between(rigid_pose, before),
        compliance=compliance,
        stiffness=stiffness,
        rank=rank,
        notes=(*fixation.notes, *state.notes),
    )


def motion_between(first: Array, second: Array) -> Array:
    """Return displacement and rotation vector from one pose, (4, 4), to another, (6,), in the base frame."""
    turn = second[:3, :3] @ first[:3, :3].T
    skew = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (np.trace(turn) - 1.0)
    if cosine < -0.999:  # near half a turn the axis is that of the symmetric matrix
        values, axes = np.linalg.eigh(0.5 * (turn + turn.T))
        axis = axes[:, int(np.argmax(values))]
        skew = axis * np.arctan2(sine, cosine) * (1.0 if axis @ skew >= 0.0 else -1.0)
    elif sine > 0.0:
        skew = skew * (np.arctan2(sine, cosine) / sine)
    return np.concatenate([second[:3, 3] - first[:3, 3], skew])


def _compliance(kernel: Kernel, q: Array, K: Array, fixation: Fixation, frame: str) -> Array:
    """Return J K^-1 J^T over what may move; coordinates that float in their clearance stay, also of loop joints."""
    stuck = np.isin(kernel.coordinates, floating(kernel, q))
    refuse_singular_pose(kernel, q, ~(fixation.locked | stuck))
    cuts = np.isin(kernel.cut_laws, floating_cuts(kernel, q))
    stays = kernel.functions.cut_jacobian(q)[cuts] if cuts.any() else None
    basis, independent = moving_basis(kernel, q, ~(fixation.locked | stuck), stays)
    J = kernel.frame_jacobian(q, frame) @ basis
    if not independent:
        return np.zeros((6, 6))
    matrix = basis.T @ K @ basis
    root = np.sqrt(np.maximum(np.abs(np.diagonal(matrix)), 1e-300))
    scaled = matrix / np.outer(root, root)
    _, values, directions = np.linalg.svd(scaled)
    if values[-1] <= SOFT * values[0]:
        loose = independent[int(np.argmax(np.abs(directions[-1])))]
        drive = "; fixed names all that stays, driven coordinates too" if fixation.driven[loose] else ""
        raise InputError(
            f"{kernel.name}: nothing holds {kernel.coordinates[loose]}: its compliance is infinite{drive};"
            " list it in fixed"
        )
    return np.asarray((J / root) @ np.linalg.solve(scaled, (J / root).T))


def _inverse(compliance: Array) -> tuple[int, Array | None]:
    """Rank and, if that is 6, the inverse; lengths are measured so that both diagonal blocks have one size."""
    linear, angular = (float(np.linalg.norm(block)) for block in (compliance[:3, :3], compliance[3:, 3:]))
    length = np.sqrt(linear / angular) if linear > 0.0 and angular > 0.0 else 1.0
    size = np.repeat([1.0, length], 3)
    scaled = compliance * np.outer(size, size)
    values = np.linalg.svd(scaled, compute_uv=False)
    rank = int((values > RANK * values[0]).sum()) if values[0] > 0.0 else 0
    return rank, np.asarray(np.linalg.inv(scaled) * np.outer(size, size)) if rank == 6 else None


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
        target = check_ending(path, *MATRIX_ENDINGS, label="path")
        comments = [f"{self._title()}, {UNITS}", *self._without()]
        if target.suffix == ".csv":
            return write_csv(target, [self.coordinates, *self.matrix.tolist()], comments, read=read_matrix)
        if target.suffix == ".mtx":
            comments.insert(1, f"rows and columns: {', '.join(self.coordinates)}")
            text = _market(self.matrix, comments).encode("ascii")
            return write_atomically(target, lambda stream: stream.write(text), read=read_matrix)
        texts = {key: np.array(getattr(self, key), dtype=np.str_) for key in ("coordinates", "rigid", "held")}
        names: dict[str, Any] = {"robot": self.robot, "joint": self.joint, "deviation": self.deviation, **texts}
        return write_atomically(target, lambda stream: np.savez(stream, K=self.matrix, **names), read=read_matrix)

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
        **options: drives, kp, kd, fixed, loads, parameters and kernel, see ``StateOptions``.

    Raises:
        UnknownNameError: there is no joint of that name, or nothing of it moves.
        InputError: an argument cannot be used, or drives are free.
        IntegrationError: there is no static equilibrium near the pose.
    """
    check_kind("joint", joint, isinstance(joint, str), "the name of a joint")
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
    if not slopes.any():
        notes = (*notes, f"no spring of {joint} acts here; what holds its links is in the stiffness of a frame")
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
    """Return the coordinates of a joint in their order; UnknownNameError where there is none, or it is a node."""
    if joint in robot.nodes:
        link = robot.nodes[joint]
        raise UnknownNameError(
            f"joint: {joint} is a node of link {link}, which bends; allowed: a joint (that of modes is"
            f" links.{link}.modes.1.stiffness)"
        )
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
    twice: Callable[..., Any] = kernel.replaced(parameters=forces).residual_jacobian
    z = np.zeros(len(kernel.internal_states))
    return np.asarray(twice(q, zero, zero, z=z)[0] - once(q, zero, zero, z=z)[0])


def _is_spring(parameter: str) -> bool:
    """Return whether a parameter is a force of a spring, or one per deviation."""
    number = number_of(parameter)
    return number is not None and all(unit.startswith("N") and " s" not in unit for unit in number.unit)
