"""Rows of the comparison: our kernels and motions of benchmarks.peers, benchmarks.closed and benchmarks.precision."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.robot.value import COORDINATES, Robot

from ..closed import CASES, DIFFERENT, WINDOWS, closed_states, without_springs
from ..ladder import ladder
from ..peers import measure, python_calls
from ..peers.cases import CHAIN, ELASTIC, TITLES, case
from ..peers.measure import BATCH_STATES, STATES, states
from ..peers.run import STANDARD
from ..precision_cases import CHOSEN, FIXED, IN_TURN, ONE, PROBLEMS
from ..run import HERE, generic

Arrays = Sequence[NDArray[np.float64]]

FURTHER = ("energy", *python_calls.FRAMED)
DERIVATIVES = ("residual_jacobian", "forward_dynamics_jacobian", "hessian")
READS: Mapping[str, tuple[str, ...]] = {
    **python_calls.READS,
    "forward_dynamics_jacobian": measure.READS["forward_derivatives"],
    "hessian": measure.READS["second_derivatives"],
    "rollout": measure.READS["step"],
}
COUNTS = {  # keys of kernel.operations that are no names of methods
    "hessian": "inverse_dynamics_hessian",
    "rosenbrock": "adaptive_rollout",
    "tsit5": "adaptive_rollout",
    "radau": "radau_rollout",
}
TEN_STEPS = {"dt": 1e-3, "steps": 10, "every": 10, "method": "implicit"}
GRADIENT = {"dt": 1e-3, "steps": 100}
EVERY = 128  # steps of one length from sample to sample: explicit ones of stiff robots are stable
EXACT, CLOSE = 1e-6, 1e-3  # greatest relative differences between the results of kernels, of motions


@dataclass(frozen=True)
class Row:
    """A method of a kernel, or ``integrate``, with its arguments.

    Attributes:
        name: "peers/UR5/inverse_dynamics/4096"; with "/1" at its end, each call takes one of several states.
        robot: key of ``TITLES`` or ``CASES``, or a built-in name.
        draw: returns the arrays.
        out: the method has the keyword ``out``.
        tolerance: greatest relative difference between the results of both versions.
    """

    name: str
    robot: str
    call: str
    draw: Callable[[], Arrays] = field(repr=False)
    keywords: Mapping[str, Any] = field(default_factory=dict)
    out: bool = False
    tolerance: float = EXACT

    def request(self, folder: Path) -> dict[str, Any]:
        """Return what a child reads, and write the files that this names.

        Raises:
            MissingPeer: the robot is one of example-robot-data, which is not installed.
        """
        inputs = folder / f"{self.name.replace('/', ' ')}.npz"
        np.savez(inputs, *self.draw())
        robot, options = robot_file(self.robot, folder)
        counts = COUNTS.get(self.keywords.get("method", self.call), self.call)
        shared = {"name": self.name, "call": self.call, "keywords": self.keywords, "out": self.out, "counts": counts}
        return {**shared, "robot": robot, "options": options, "inputs": str(inputs), "each": self.name.endswith("/1")}


def rows() -> Iterator[Row]:
    """Yield all rows."""
    for key in TITLES:
        name = f"peers/{key.replace(' ', '_')}"
        for call in (*STANDARD, *(FURTHER if key in python_calls.ROBOTS else ())):
            yield from one_and_many(f"{name}/{call}", key, call, partial(_states, key, call), out=True)
        if key == ELASTIC:
            draw = partial(_states, key, "rollout")
            yield from one_and_many(f"{name}/ten_steps", key, "rollout", draw, keywords=TEN_STEPS)
        for call in DERIVATIVES if key != ELASTIC else ():
            yield Row(f"{name}/{call}/1", key, call, partial(_states, key, call, STATES))
        for method in {"UR5": FIXED, ELASTIC: ["implicit"]}.get(key, ()):
            keywords, draw = {**GRADIENT, "method": method}, partial(_start, key)
            yield Row(f"{name}/gradient/{method}", key, "rollout_gradient", draw, keywords)
    for key in CASES:
        draw = partial(_closed_states, key)
        yield from one_and_many(f"closed/{key}/forward_dynamics", key, "forward_dynamics", draw, out=True)
    for key, problem in PROBLEMS.items():
        steps = problem.samples * EVERY
        fixed = {"dt": problem.duration / steps, "steps": steps, "every": EVERY}
        adaptive = {"duration": problem.duration, "samples": problem.samples, "rtol": ONE}
        for method in (*CHOSEN, IN_TURN, *FIXED):
            keywords = {**(fixed if method in FIXED else adaptive), "method": method}
            call, draw = "integrate" if method == IN_TURN else "rollout", partial(_motion, key)
            yield Row(f"precision/{key}/{method}", key, call, draw, keywords, tolerance=CLOSE)


def one_and_many(name: str, robot: str, call: str, draw: Callable[[int], Arrays], **further: Any) -> Iterator[Row]:
    """Yield the rows of calls with one state and of a call with many."""
    yield Row(f"{name}/1", robot, call, partial(draw, STATES), **further)
    yield Row(f"{name}/{BATCH_STATES}", robot, call, partial(draw, BATCH_STATES), **further)


def chosen(patterns: Sequence[str]) -> list[Row]:
    """Return the rows that match a name, the beginning of one ("peers/UR5"), or one with * and ?; without patterns all.

    Raises:
        ValueError: a pattern matches no row.
    """

    def matches(name: str, pattern: str) -> bool:
        return f"{name}/".startswith(f"{pattern}/") or fnmatchcase(name, pattern)

    every = list(rows())
    for pattern in patterns:
        if not any(matches(row.name, pattern) for row in every):
            raise ValueError(f"ROW: {pattern!r} matches no row; --list prints all of them")
    return [row for row in every if not patterns or any(matches(row.name, pattern) for pattern in patterns)]


def robot_file(key: str, folder: Path) -> tuple[str, dict[str, Any]]:
    """Return what ``eomgen.load_robot`` of any version takes: a built-in name or a file, and keywords."""
    if key == CHAIN:
        shutil.copy(HERE / "data" / "puma560_generic.urdf", folder)
        coordinates = "\n".join(f"{name} = {{}}" for name in COORDINATES)
        text = f'name = "{key}"\nurdf = "puma560_generic.urdf"\n'
        text += "".join(f'[[joints]]\nname = "{x.name}"\n{coordinates}\n' for x in generic("puma560_generic").joints)
    elif key == "ladder":
        text = planar_text(ladder(WINDOWS))
    elif key in TITLES:
        path = case(key).urdf
        return (case(key).robot.name, {}) if path is None else (str(path), {"inertia": "warn", "urdf_mimic": False})
    else:
        return key, {}
    (folder / f"{key}.toml").write_text(text, encoding="ascii")
    return str(folder / f"{key}.toml"), {}


def planar_text(robot: Robot) -> str:
    """Return the description of a robot of joints and loops of one type each, whose frames are all parallel."""
    axes = ("xx", "yy", "zz", "xy", "xz", "yz")
    lines = [f'name = "{robot.name}"', f"gravity = {list(robot.gravity)}"]
    for link in robot.links:
        inertia = ", ".join(f"{x} = {number}" for x, number in zip(axes, link.inertia, strict=True))
        lines += ["[[links]]", f'name = "{link.name}"', f"mass = {link.mass}", f"com = {list(link.com)}"]
        lines.append(f"inertia = {{ {inertia} }}")
    for joint in robot.joints:
        lines += ["[[joints]]", *(f'{x} = "{getattr(joint, x)}"' for x in ("name", "parent", "child", "type"))]
        lines.append(f"placement = {{ xyz = {list(joint.placement.xyz)} }}")
    for loop in robot.loops:
        places = ", ".join(f"{{ xyz = {list(x.xyz)} }}" for x in loop.placements)
        lines += ["[[loops]]", f'name = "{loop.name}"', f"links = {list(loop.links)}", f'type = "{loop.type}"']
        lines.append(f"placements = [{places}]")
    return "\n".join(lines) + "\n"


def _states(key: str, call: str, count: int) -> Arrays:
    drawn = states(case(key).robot, count)
    return [drawn[name] for name in READS[call]]


@cache
def _closed(key: str) -> Arrays:
    return closed_states(without_springs(CASES[key].robot()), CASES[key], DIFFERENT)


def _closed_states(key: str, count: int) -> Arrays:
    return [np.resize(x, (count, x.shape[1])) for x in _closed(key)]


def _start(key: str) -> Arrays:
    drawn = states(case(key).robot, int(GRADIENT["steps"]))
    return 0.5 * drawn["q"][0], 0.1 * drawn["v"][0], 0.2 * drawn["u"]


@cache
def _motion(key: str) -> Arrays:
    q, u = PROBLEMS[key].start(eomgen.build(key))
    return q, np.zeros_like(q), u
