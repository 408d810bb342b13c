"""Poses and paths of simulated motions, results or samples of a plan: cycles of a reference whose rests are poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path as File
from typing import Any

import numpy as np

from ...arrays import Array
from ...description import RobotLike
from ...errors import EomgenError, InputError
from ...names import show
from ...progress import Progress
from ...simulation.result import SimulationResult
from ...sweep.plan import Plan
from ..geometry.rotations import vectors_of
from .attained import Measured, Path, Pose, Record
from .formulas import speeds

SAME = 1e-9  # m, rad or s: by less than that references and times are the same
_ALLOWED = "; allowed: results of one program"
_FEWEST = 3  # points of a path
MOST_SAMPLES = 10_000  # whose whole motions are held at once
_TOGETHER = 16  # samples that are done at once
_RECORD = ("tool_deviation_max",)  # so that motions have the tool's pose
_CREEPING = 1e-5  # of the greatest step of a reference between two samples, below which it rests


def from_simulations(
    results: Sequence[SimulationResult], labels: Sequence[str], frame: str | None = None, source: str = "simulated"
) -> Measured:
    """Return poses and paths of results, whose ``labels`` are what messages call them.

    A pose is where the reference of the tool comes to rest after it moved, and where it ends; a path is what lies
    between.  Clause by clause, the tool's place at the end of the rest is what was attained.

    Raises:
        InputError: a result has no program, ended too early, looks at another frame, or commands something else than
            the first one.
    """
    for result, label in zip(results, labels, strict=True):
        _check(result, label, frame)
        _check_same(results[0], labels[0], result, label)
    first = results[0]
    t, program = first.trajectory.t, first.program_pose
    rests = _rests(program)
    poses, paths, begin = [], [], 0
    for number, (rest, end) in enumerate(rests, 1):
        whole = [_record(result.trajectory.t, result.pose, begin, end) for result in results]
        command = program[end]
        numbers = tuple(range(1, len(results) + 1))
        poses.append(Pose(str(number), command[:3, 3], command[:3, :3], tuple(whole), numbers))
        if rest - begin + 1 >= _FEWEST:
            paths.append(Path(str(number), _record(t, program, begin, rest), tuple(whole)))
        begin = end
    notes = _notes(results, poses)
    rate = float(speeds(t, program[:, :3, 3]).max())
    same = all(np.array_equal(result.pose, first.pose) for result in results)
    return Measured(
        source=source,
        robot=first.robot,
        frame=first.tool,
        load=load_of(first.scenario) if first.scenario else "",
        rate=f"up to {rate:.4g} m/s (commanded speed of {first.tool})",
        poses=tuple(poses),
        paths=tuple(paths),
        exact=same,
        notes=tuple(notes),
    )


def _check(result: SimulationResult, label: str, frame: str | None) -> None:
    if not result.programmed:
        raise InputError(f"{label}: nothing is programmed, so that no pose is commanded; allowed: with a motion")
    if result.stopped:
        raise InputError(f"{label}: the motion stopped too early; allowed: motions that come to their end")
    if frame is not None and frame != result.tool:
        raise InputError(
            f"frame: {show(frame)} is not the one that {label} looks at; allowed: {show(result.tool)}"
            " (the scenario's key frame says which)"
        )


def _check_same(first: SimulationResult, name: str, result: SimulationResult, label: str) -> None:
    """Raise InputError where a result is no cycle of the first one's program."""
    if result.tool != first.tool:
        raise InputError(f"{label}: looks at {show(result.tool)}, and {name} at {show(first.tool)}{_ALLOWED}")
    ours, theirs = result.trajectory.t, first.trajectory.t
    if ours.shape != theirs.shape or np.abs(ours - theirs).max() > SAME:
        raise InputError(
            f"{label}: has {ours.size} samples to {ours[-1]:g} s, and {name} {theirs.size} to {theirs[-1]:g} s,"
            f" or other times between{_ALLOWED} at the same times"
        )
    off = np.linalg.norm(result.program_pose[:, :3, 3] - first.program_pose[:, :3, 3], axis=1)
    turned = np.linalg.norm(vectors_of(_relative(first.program_pose, result.program_pose)), axis=1)
    if max(off.max(), turned.max()) > SAME:
        i = int(np.maximum(off, turned).argmax())
        raise InputError(
            f"{label}: commands another pose than {name}: by {off[i]:.3g} m and {turned[i]:.3g} rad at"
            f" {theirs[i]:.4g} s{_ALLOWED}"
        )


def _relative(one: Array, other: Array) -> Array:
    return np.swapaxes(one[:, :3, :3], 1, 2) @ other[:, :3, :3]


def _rests(program: Array) -> list[tuple[int, int]]:
    """Return first and last sample of each rest of the reference that follows upon a motion.

    The last sample always is one.
    """
    steps = np.linalg.norm(np.diff(program[:, :3, 3], axis=0), axis=1)
    turns = np.linalg.norm(vectors_of(_relative(program[:-1], program[1:])), axis=1)
    changes = np.maximum(steps, turns)
    moving = changes > max(SAME, _CREEPING * changes.max(initial=0.0))  # from each sample to the next
    last, departures = len(program) - 1, np.flatnonzero(moving)
    if not departures.size:
        return [(0, last)]
    arrivals = np.flatnonzero(moving & ~np.append(moving[1:], False)) + 1
    next_ones = np.append(departures, last)[np.searchsorted(departures, arrivals)]
    stays = list(zip(arrivals.tolist(), next_ones.tolist(), strict=True))
    return stays if stays[-1][1] == last else [*stays, (last, last)]


def _record(t: Array, pose: Array, begin: int, end: int) -> Record:
    rows = slice(begin, end + 1)
    return Record(t[rows], pose[rows, :3, 3], pose[rows, :3, :3])


def load_of(scenario: Mapping[str, Any]) -> str:
    """Return the payloads of a recorded scenario in words."""
    payloads = scenario.get("payloads", ())
    if not payloads:
        return "the robot as described, no payload"
    return ", ".join(f"{payload['mass']:g} kg on {payload['link']}" for payload in payloads)


def _notes(results: Sequence[SimulationResult], poses: Sequence[Pose]) -> list[str]:
    notes = []
    hashes = {result.robot_hash for result in results}
    if len(hashes) > 1:
        notes.append(f"the cycles are of {len(hashes)} different descriptions: their scatter is that between robots")
    for pose in poses:
        record = pose.cycles[0]
        assert record.t is not None
        if len(record.t) > 2 and (speed := float(speeds(record.t, record.position)[-1])) > 1e-4:
            notes.append(f"pose {pose.name}: the tool still moves at {speed:.2g} m/s when it is looked at")
    return notes


def from_plan(
    robot: RobotLike, scenario: str | File | Mapping[str, Any], plan: Plan, frame: str | None, progress: Progress
) -> Measured:
    """Simulate the samples of a plan; what is commanded is the reference of the nominal robot.

    Raises:
        InputError: plan, scenario and robot do not fit, there are too many samples, all of them fail, or what is
            commanded differs between them.
    """
    from ...sweep.driver import prepare
    from ...sweep.job import SampleRunner

    progress(0.0, "preparing")
    job, design, _ = prepare(robot, scenario, replace(plan, record=_RECORD))
    count = len(design)
    if not 2 <= count <= MOST_SAMPLES:
        raise InputError(f"{plan.source or 'plan'}: has {count} samples; allowed: 2 to {MOST_SAMPLES}")
    runner = SampleRunner(job)
    motions: list[SimulationResult] = []
    labels: list[str] = []
    failed: dict[int, EomgenError] = {}
    for begin in range(0, count, _TOGETHER):
        chosen = range(begin, min(begin + _TOGETHER, count))
        for i, motion in zip(chosen, runner.motions([design.values(i) for i in chosen]), strict=True):
            if isinstance(motion, EomgenError):
                failed[i] = motion
            else:
                motions.append(motion)
                labels.append(f"sample {i}")
        progress(chosen[-1] / count, f"{chosen[-1] + 1} of {count} samples")
    if len(motions) < 2:
        number, error = next(iter(failed.items()))
        raise InputError(f"{plan.source or 'plan'}: {len(failed)} of {count} samples fail; sample {number}: {error}")
    measured = from_simulations(motions, labels, frame, "samples of a plan")
    varied = ", ".join(entry.parameter or f"scenario {entry.scenario}" for entry in plan.vary)
    notes = [
        f"cycles are samples of a plan that varies {varied}: their scatter is that of these numbers,"
        " between robots where they stay the same in a robot"
    ]
    notes += [f"{len(failed)} of {count} samples failed and are left out"] if failed else []
    load = load_of(job.scenario().as_dict())
    return replace(measured, load=load, notes=(*notes, *measured.notes))
