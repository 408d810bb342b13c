"""Design alternatives for one task: what the same motion costs each of them.

The search for a kinematic structure of the paper's section 7: drives, joint reaction wrenches and tool deviations of
several robots that do the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..codegen.kernels.groups import JOINT_REACTIONS, RIGID_MODEL, STRUCTURES, kernel_group
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..identifiers import check_kind
from ..kernel.stepping.methods import Method
from ..motion.ends import default_motion, principal_limits
from ..motion.exceeding import excess_notes, excesses
from ..motion.tool_path import ToolLine
from ..names import joint_of, kind_of, listed
from ..pipeline.building import build
from ..progress import Progress, tells_at_prompt
from ..robot.coordinates import force_unit_of, index_of, unit_of
from ..robot.model import build_model, program_coordinates, tool_of
from ..robot.value import Robot
from ..shown import Shown, prefixed
from ..simulation.controls import actuators
from ..simulation.references import MOVING_SHARE
from ..simulation.result import SimulationResult
from ..simulation.run import simulate

Line = tuple[ArrayLike, ArrayLike]

COUNTED = STRUCTURES
WIDTH = 34


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One robot's figures; peaks are the largest sizes over time.

    drives: by driven coordinate, a motor's at its shaft, N or N m.  reactions: by joint, (force N, moment N m) on its
    child link.  tool_deviation: m, largest and at the end, or None for a robot without deviations.  tool_travel: length
    of the programmed path of the tool, m.  operations: by kernel, of the C: multiplications and additions.  mass: kg
    moving.
    """

    robot: str
    coordinates: int
    mass: float
    operations: dict[str, tuple[int, int]]
    drives: dict[str, float]
    reactions: dict[str, tuple[float, float]]
    tool: str
    tool_travel: float
    tool_deviation: tuple[float, float] | None

    def rows(self) -> dict[str, str]:
        """Return texts by what they are."""
        rows = {"coordinates": str(self.coordinates), "moving mass [kg]": f"{self.mass:.4g}"}
        for name, (mul, add) in self.operations.items():
            rows[f"{name}, mul/add"] = f"{mul}/{add}"
        for name, value in self.drives.items():
            rows[f"drive {name} [{force_unit_of(name)}]"] = f"{value:.4g}"
        for name, (force, moment) in self.reactions.items():
            rows[f"support force {name} [N]"] = f"{force:.4g}"
            rows[f"support moment {name} [N m]"] = f"{moment:.4g}"
        rows["tool"] = self.tool
        rows["tool travel [m]"] = f"{self.tool_travel:.4g}"
        if self.tool_deviation is not None:
            rows["tool deviation, largest"] = prefixed(self.tool_deviation[0], "m", 4)
            rows["tool deviation, end"] = prefixed(self.tool_deviation[1], "m", 4)
        return rows


@dataclass(frozen=True)
class Comparison(Shown):
    """Robots side by side; ``task`` says in words what they all do, ``notes`` which limits they exceed doing it."""

    task: str
    entries: tuple[Entry, ...]
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {"task": self.task, "robots": [dict(vars(entry)) for entry in self.entries], "notes": list(self.notes)}

    def lines(self) -> list[str]:
        """Return a table: a column per robot."""
        columns = [entry.rows() for entry in self.entries]
        width = max(14, *(len(entry.robot) + 2 for entry in self.entries))
        labels = sorted(dict.fromkeys(label for column in columns for label in column), key=_order)
        size = max(WIDTH, *(len(label) for label in labels))
        lines = [self.task, "", " " * size + "".join(f"{entry.robot:>{width}}" for entry in self.entries)]
        lines += [f"{label:<{size}}" + "".join(f"{c.get(label, '-'):>{width}}" for c in columns) for label in labels]
        return [*lines, *(["", *self.notes] if self.notes else [])]


@tells_at_prompt("comparing")
def compare(
    robots: Sequence[RobotLike],
    *,
    duration: float = 2.0,
    goal: Sequence[float] | None = None,
    line: Line | None = None,
    tool: str | None = None,
    method: Method = "auto",
    progress: Progress | None = None,
) -> Comparison:
    """Let robots do the same and compare what it takes; each moves with all its coordinates, as ``simulate`` has it.

    Args:
        robots: two or more, with different names; each a Robot, the name of a built-in one, or the path of a
            description.
        duration: s; the motion takes 80 percent of it.
        goal: of the principal coordinates, of closed mechanisms of the driven ones, rad or m, the same numbers for
            every robot: they start where the first robot would (``default_motion``), which also says the goal if none
            is set.
        line: two points, (3,), m, base frame: the tool of every robot moves along that line instead (``ToolLine``).
        tool: frame or link, known to all; each robot's as in ``simulate`` by default.
        method: of the integration, see ``integrate``.
        progress: called with a fraction from 0 to 1 and a line of text.

    Raises:
        InputError: fewer than two robots, names that are equal, principal coordinates that do not match, a line
            that a tool cannot follow, or with a closed mechanism.
        LoopError: the motion leads where loops cannot close.
        IntegrationError: a motion could not be integrated.
    """
    check_kind("robots", robots, isinstance(robots, Iterable), "several robots")
    arms = [as_robot(robot) for robot in ([robots] if isinstance(robots, (Robot, str, Path)) else robots)]
    names = [robot.name for robot in arms]
    if len(arms) < 2:
        raise InputError(f"robots: {len(arms)}; allowed: two or more")
    if len(set(names)) < len(names):
        raise InputError(f"robots: {', '.join(names)}; allowed: robots with different names")
    if line is not None and any(robot.is_closed for robot in arms):
        closed = listed([robot.name for robot in arms if robot.is_closed])
        raise InputError(f"line: {closed} is closed by loops or couplings; allowed: a goal of the driven coordinates")
    if line is not None and goal is not None:
        raise InputError("goal and line are both set; allowed: one of them")
    motion = None if line is not None else _common_motion(arms, duration, goal)
    entries: list[Entry] = []
    notes: list[str] = []
    for robot in arms:
        options: dict[str, Any] = {"start": motion[0], "goal": motion[1]} if motion is not None else {}
        if line is not None:
            options["motion"] = _line_motion(robot, line, MOVING_SHARE * duration, tool)
        result = simulate(robot, duration=duration, tool=tool, method=method, progress=progress, **options)
        entries.append(_entry(robot, result))
        trajectory, x = result.trajectory, result.trajectory.coordinates
        notes += excess_notes(
            robot.name, excesses(robot, x, t=trajectory.t, q=trajectory.q, v=trajectory.v, u=trajectory.u)
        )
    if line is not None:
        task = f"tool along the line {_numbers(line[0])} to {_numbers(line[1])} m"
    else:
        assert motion is not None
        task = f"principal coordinates from {_numbers(motion[0])} to {_numbers(motion[1])}"
    return Comparison(f"{task} in {MOVING_SHARE * duration:g} of {duration:g} s", tuple(entries), tuple(notes))


def _movable(robot: Robot) -> list[str]:
    """Return names of the principal coordinates (none of free joints), of closed mechanisms of the driven ones."""
    if robot.is_closed:
        return list(program_coordinates(robot))
    names = build_model(robot.rigid()).coordinates
    kinds = {joint.name: joint.principal for joint in robot.joints}
    return [name for name in names if kinds[joint_of(name)] == kind_of(name)]


def _common_motion(robots: Sequence[Robot], duration: float, goal: Sequence[float] | None) -> tuple[Array, Array]:
    """Start and goal of all principal coordinates: the first robot's."""
    first = robots[0]
    kinds = [[unit_of(name) for name in _movable(robot)] for robot in robots]
    for robot, kind in zip(robots, kinds, strict=True):
        if kind != kinds[0]:
            raise InputError(
                f"{robot.name} has principal coordinates in {', '.join(kind)}, {first.name} in {', '.join(kinds[0])};"
                " allowed: the same, or a line of the tool"
            )
    driven = program_coordinates(first) if first.is_closed else build_model(first.rigid()).coordinates
    motion = default_motion(first, duration, driven, goal=goal)
    index = index_of(driven, _movable(first))
    return motion.start[index], motion.goal[index]


def _line_motion(robot: Robot, line: Line, duration: float, tool: str | None) -> ToolLine:
    rigid = build(robot.rigid(), kernels=RIGID_MODEL)
    limits = np.array([principal_limits(robot, name) for name in rigid.coordinates])
    guess = default_motion(robot, duration, rigid.coordinates)
    middle = (guess.start + guess.goal) / 2
    return ToolLine(rigid, tool_of(robot, tool, "tool"), *line, duration, guess=middle, limits=limits)


def _entry(robot: Robot, result: SimulationResult) -> Entry:
    kernels = () if robot.is_closed else kernel_group(robot, STRUCTURES, JOINT_REACTIONS)
    kernel = build(robot, kernels=kernels)
    motion = result.trajectory
    q, v, z = motion.q, motion.v, motion.z
    reactions = np.asarray(kernel.reactions(q, v, kernel.forward_dynamics(q, v, motion.u, z), z=z))
    index = actuators(kernel, result.program_coordinates).index
    deviation = np.linalg.norm(result.tool_deviation, axis=1)
    model = build_model(robot)
    path = np.diff(result.program_pose[:, :3, 3], axis=0)
    return Entry(
        robot=robot.name,
        coordinates=len(kernel.coordinates),
        mass=float(sum(robot.link(name).mass for name in model.links)),
        operations={name: (kernel.operations[name]["mul"], kernel.operations[name]["add"]) for name in COUNTED},
        drives={motion.coordinates[i]: float(np.abs(motion.u[:, i]).max()) for i in index},
        reactions={
            name: (_largest(reactions[:, k, :3]), _largest(reactions[:, k, 3:])) for k, name in enumerate(kernel.joints)
        },
        tool=result.tool,
        tool_travel=float(np.linalg.norm(path, axis=1).sum()),
        tool_deviation=(float(deviation.max()), float(deviation[-1])) if result.deviation_coordinates else None,
    )


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


def _order(label: str) -> int:
    """Return the place of a row by its kind: rows that not all robots have stand with those of their kind."""
    kinds = ("coordinates", "moving mass", *COUNTED, "drive", "support", "tool")
    return next(place for place, kind in enumerate(kinds) if label.startswith(kind))


def _numbers(values: ArrayLike) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in np.asarray(values, dtype=np.float64)) + ")"
