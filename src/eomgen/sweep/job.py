"""One sweep as a value that travels: what a sample of given numbers yields, on whichever machine."""

from __future__ import annotations

import copy
import hashlib
import json
import sys
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..arrays import Array
from ..errors import EomgenError, InputError
from ..files import open_regular
from ..forms.dotted_paths import set_path
from ..motion.exceeding import limits_known
from ..progress import no_progress
from ..robot.value import Robot
from ..scenario.load import scenario_from_values
from ..scenario.value import Scenario
from ..simulation.assembly import Assembly, assemble, kernels_of, with_kernel
from ..simulation.result import SimulationResult
from ..simulation.run import plan_of, run_assembly
from ..simulation.side_by_side import DRIVES, POSE, may_run_side_by_side, run_side_by_side
from .contents import SampleRow, finite_or_error
from .measures import BALANCED, NEEDS, READS, Column, exceeded_limits, measure, rigid_pose
from .plan import Plan

KEPT = 64  # assemblies that a process remembers, one for each scenario


@dataclass(frozen=True)
class Dimension:
    """A number that changes: its name, and where it is: "parameter" or "scenario"; ``unit`` of relative numbers."""

    kind: str
    name: str
    unit: float | None = None


@dataclass(frozen=True, kw_only=True)
class Job:
    """Everything that is the same for all samples of a sweep.

    robot: with all parameters that change among its ``tunable``.  values: of the scenario's TOML file, ``source`` and
    ``folder`` as ``scenario_from_values`` takes them.  columns: what a sample yields.
    """

    robot: Robot
    values: Mapping[str, Any]
    source: str
    folder: Path
    plan: Plan
    dimensions: tuple[Dimension, ...]
    tool: str
    columns: tuple[Column, ...] = ()

    @property
    def key(self) -> str:
        """Hash of everything that the numbers depend on."""
        from ..robot.record import robot_hash

        plan = str(replace(self.plan, source=""))
        parts = (robot_hash(self.robot), self.values, plan, str(self.dimensions), self.tool)
        return hashlib.sha256(json.dumps([*parts, file_hashes(self)], sort_keys=True).encode()).hexdigest()

    def kernels(self, scenario: Scenario) -> tuple[str, ...]:
        """Names of the kernels that its robot is built with."""
        further = [name for wanted in self.plan.record for name in NEEDS.get(wanted, ())]
        if "reactions" in further and scenario.wrenches:
            further.append("external_reactions")
        return tuple(dict.fromkeys((*kernels_of(self.robot, scenario), *further)))

    def scenario(self, sample: Sequence[float] = ()) -> Scenario:
        """The scenario of a sample's numbers; DescriptionError where it does not allow one of them."""
        return scenario_from_values(self.scenario_values(sample), source=self.source, folder=self.folder)

    def scenario_values(self, sample: Sequence[float]) -> dict[str, Any]:
        """The TOML file's values with a sample's numbers in their places."""
        values = copy.deepcopy(dict(self.values))
        for dimension, number in zip(self.dimensions, sample, strict=False):
            if dimension.kind == "scenario":
                set_path(values, dimension.name, number if dimension.unit is None else number * dimension.unit)
        return values

    def parameters(self, sample: Sequence[float]) -> dict[str, float]:
        """Parameters of the kernel by name."""
        return {
            dimension.name: number if dimension.unit is None else number * dimension.unit
            for dimension, number in zip(self.dimensions, sample, strict=True)
            if dimension.kind == "parameter"
        }


def file_hashes(job: Job) -> dict[str, str]:
    """Hash of every file that the scenario names, by its name."""
    found: dict[str, str] = {}

    def walk(value: Any) -> None:
        if isinstance(value, Mapping):
            if isinstance(value.get("file"), str) and (job.folder / value["file"]).is_file():
                found[value["file"]] = _digest(job.folder / value["file"])
            for item in value.values():
                walk(item)
        elif isinstance(value, list):
            for item in value:
                walk(item)

    walk(job.values)
    return found


def _digest(path: Path) -> str:
    found = hashlib.sha256()
    try:
        with open_regular(path, sys.maxsize) as stream:
            while block := stream.read(1 << 20):
                found.update(block)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return found.hexdigest()


@dataclass(frozen=True)
class Outcome:
    """Numbers that a sample yields by columns, and limits of the robot that its motion exceeds."""

    columns: tuple[Column, ...]
    record: Array
    exceeded: tuple[str, ...]


class SampleRunner:
    """Assemblies of a job by scenario, made once and shared by the threads of a process."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._limits = limits_known(job.robot)
        self._lock = threading.Lock()
        self._assemblies: OrderedDict[str, tuple[Scenario, Assembly]] = OrderedDict()

    def nominal(self, sample: Sequence[float]) -> tuple[Scenario, Assembly]:
        """Scenario and assembly of a sample's scenario with the robot's own parameters."""
        key = self._key(sample)
        with self._lock:
            if key in self._assemblies:
                self._assemblies.move_to_end(key)
                return self._assemblies[key]
            scenario = self.job.scenario(sample)
            kernels = self.job.kernels(scenario)
            found = scenario, assemble(self.job.robot, scenario, self.job.tool, no_progress, kernels)
            self._assemblies[key] = found
            if len(self._assemblies) > KEPT:
                self._assemblies.popitem(last=False)
            return found

    def rows(self, indices: Sequence[int], samples: Sequence[Sequence[float]]) -> list[SampleRow]:
        """The rows of samples, in their order; those of one scenario are done together."""
        found: dict[int, SampleRow] = {}
        for places in self._groups(samples):
            outcomes = self.outcomes([samples[i] for i in places])
            for i, outcome in zip(places, outcomes, strict=True):
                sample = tuple(samples[i])
                if isinstance(outcome, EomgenError):
                    found[i] = SampleRow(indices[i], sample, error=f"{type(outcome).__name__}: {outcome}")
                    continue
                record = tuple(outcome.record.tolist())
                error = finite_or_error(outcome.columns, record)
                row = SampleRow(indices[i], sample, error=error)
                found[i] = row if error else replace(row, record=record, exceeded=outcome.exceeded)
        return [found[i] for i in range(len(samples))]

    def motions(self, samples: Sequence[Sequence[float]]) -> list[SimulationResult | EomgenError]:
        """Motions of samples, in their order, or why there are none; those of one scenario are done together."""
        found: dict[int, SimulationResult | EomgenError] = {}
        for places in self._groups(samples):
            for i, (_, motion) in zip(places, self._moved([samples[i] for i in places]), strict=True):
                found[i] = motion
        return [found[i] for i in range(len(samples))]

    def _groups(self, samples: Sequence[Sequence[float]]) -> list[list[int]]:
        """Places of the samples by their scenario."""
        groups: dict[str, list[int]] = {}
        for i, sample in enumerate(samples):
            groups.setdefault(self._key(sample), []).append(i)
        return list(groups.values())

    def _key(self, sample: Sequence[float]) -> str:
        """Text of a sample's scenario, by which samples are done together."""
        if not any(dimension.kind == "scenario" for dimension in self.job.dimensions):
            return ""
        return json.dumps(self.job.scenario_values(sample), sort_keys=True)

    def outcomes(self, samples: Sequence[Sequence[float]]) -> list[Outcome | EomgenError]:
        """Return what samples of one scenario yield, or why they yield nothing."""
        found: list[Outcome | EomgenError] = []
        for assembly, motion in self._moved(samples):
            if isinstance(motion, EomgenError) or assembly is None:
                found.append(motion if isinstance(motion, EomgenError) else InputError("no motion"))
                continue
            try:
                columns, record = measure(motion, assembly, self.job.plan.record)
                exceeded = exceeded_limits(self.job.robot, motion) if self._limits else ()
                found.append(Outcome(columns, record, exceeded))
            except EomgenError as error:
                found.append(error)
        return found

    def _moved(
        self, samples: Sequence[Sequence[float]]
    ) -> list[tuple[Assembly | None, SimulationResult | EomgenError]]:
        """Assembly and motion of samples of one scenario, or no assembly and why there is none."""
        try:
            scenario, nominal = self.nominal(samples[0])
        except EomgenError as error:
            return [(None, error)] * len(samples)
        made: list[Assembly | EomgenError] = []
        for sample in samples:
            try:
                kernel = nominal.kernel.with_parameters(self.job.parameters(sample))
                made.append(with_kernel(nominal, self.job.robot, scenario, kernel))
            except EomgenError as error:
                made.append(error)
        assemblies = [item for item in made if isinstance(item, Assembly)]
        motions = iter(self._motions(scenario, nominal, assemblies))
        return [(item, next(motions)) if isinstance(item, Assembly) else (None, item) for item in made]

    def _motions(
        self, scenario: Scenario, nominal: Assembly, assemblies: list[Assembly]
    ) -> list[SimulationResult | EomgenError]:
        job, balance = self.job, BALANCED in self.job.plan.record
        found: list[SimulationResult | EomgenError] = []
        plan = plan_of(nominal, scenario)
        if assemblies and not balance and may_run_side_by_side(nominal, plan):
            parts = {part for name in job.plan.record for part in READS.get(name, ())}
            parts |= {DRIVES} if "effort" in self._limits else set()
            together = run_side_by_side(job.robot, scenario, assemblies, plan, job.tool, parts)
            return _with_programs(nominal, together) if POSE in parts else together
        for assembly in assemblies:
            try:
                result = run_assembly(job.robot, scenario, assembly, job.tool, no_progress, balance=balance)
                found.append(replace(result, program_pose=rigid_pose(nominal.kernel, result)))
            except EomgenError as error:
                found.append(error)
        return found


def _with_programs(
    nominal: Assembly, motions: Sequence[SimulationResult | EomgenError]
) -> list[SimulationResult | EomgenError]:
    """Motions with the poses of the nominal robot on their programs, which are the same where one is programmed."""
    found: list[SimulationResult | EomgenError] = []
    shared: Array | None = None
    for motion in motions:
        if isinstance(motion, EomgenError):
            found.append(motion)
            continue
        if shared is None or nominal.program is None:
            shared = rigid_pose(nominal.kernel, motion)
        found.append(replace(motion, program_pose=shared))
    return found
