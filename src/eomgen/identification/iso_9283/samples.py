"""Poses and paths of a plan's samples: each is simulated and taken as a cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...description import RobotLike
from ...errors import EomgenError, InputError
from ...progress import Progress
from ...simulation.result import SimulationResult
from ...sweep.plan import Plan
from .attained import Measured
from .simulated import from_simulations, load_of

MOST_SAMPLES = 10_000  # whose whole motions are held at once
_TOGETHER = 16  # samples that are done at once
_RECORD = ("tool_deviation_max",)  # so that motions have the tool's pose


def from_plan(
    robot: RobotLike, scenario: str | Path | Mapping[str, Any], plan: Plan, frame: str | None, progress: Progress
) -> Measured:
    """Simulate the samples of a plan; what is commanded is the program of the nominal robot.

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
    found = from_simulations(motions, labels, frame, "samples of a plan")
    varied = ", ".join(entry.parameter or f"scenario {entry.scenario}" for entry in plan.vary)
    notes = [
        f"cycles are samples of a plan that varies {varied}: their scatter is that of these numbers,"
        " between robots where they stay the same in a robot"
    ]
    notes += [f"{len(failed)} of {count} samples failed and are left out"] if failed else []
    load = load_of(job.scenario().as_dict())
    return replace(found, load=load, notes=(*notes, *found.notes))
