"""One sweep as a value that travels: how samples of numbers are computed, on whichever machine."""

from __future__ import annotations

import copy
import hashlib
import json
import os
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
    """A number that varies: its name, and where it is: "parameter" or "scenario"; ``unit`` of relative numbers."""

    kind: str
    name: str
    unit: float | None = None


@dataclass(frozen=True, kw_only=True)
class Job:
    """Everything that all samples of a sweep share.

    robot: with all parameters that vary among its ``tunable``.  values: of the scenario's TOML file, ``source`` and
    ``folder`` as ``scenario_from_values`` takes them.  columns: of a sample's numbers.
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
        inputs = (robot_hash(self.robot), self.values, plan, str(self.dimensions), self.tool)
        return hashlib.sha256(json.dumps([*inputs, file_hashes(self)], sort_keys=True).encode()).hexdigest()

    def kernels(self, scenario: Scenario) -> tuple[str, ...]:
        """Return the names of the kernels that its robot is built with."""
        further = [name for wanted in self.plan.record for name in NEEDS.get(wanted, ())]
        return tuple(dict.fromkeys((*kernels_of(self.robot, scenario), *further)))

    def scenario(self, sample: Sequence[float] = ()) -> Scenario:
        """Return the scenario of a sample's numbers; DescriptionError where it does not allow one of them."""
        return scenario_from_values(self.scenario_values(sample), source=self.source, folder=self.folder)

    def scenario_values(self, sample: Sequence[float]) -> dict[str, Any]:
        """Return the TOML file's values with a sample's numbers in their places."""
        values = copy.deepcopy(dict(self.values))
        for dimension, number in zip(self.dimensions, sample, strict=False):
            if dimension.kind == "scenario":
                set_path(values, dimension.name, number if dimension.unit is None else number * dimension.unit)
        return values

    def parameters(self, sample: Sequence[float]) -> dict[str, float]:
        """Return the kernel's parameters of a sample by name."""
        return {
            dimension.name: number if dimension.unit is None else number * dimension.unit
            for dimension, number in zip(self.dimensions, sample, strict=True)
            if dimension.kind == "parameter"
        }


def file_hashes(job: Job) -> dict[str, str]:
    """Return the hash of every file that the scenario names, by its name."""
    hashes: dict[str, str] = {}

    def walk(value: Any) -> None:
        if isinstance(value, Mapping):
            if isinstance(value.get("file"), str) and os.path.isfile(job.folder / value["file"]):
                hashes[value["file"]] = _digest(job.folder / value["file"])
            for item in value.values():
                walk(item)
        elif isinstance(value, list):
            for item in value:
                walk(item)

    walk(job.values)
    return hashes


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    try:
        with open_regular(path, sys.maxsize) as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return digest.hexdigest()


@dataclass(frozen=True)
class Outcome:
    """A sample's numbers by columns, and limits of the robot that its motion exceeds."""

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
        """Return a sample's scenario and its assembly with the robot's nominal parameters."""
        key = self._key(sample)
        with self._lock:
            if key in self._assemblies:
                self._assemblies.move_to_end(key)
                return self._assemblies[key]
            scenario = self.job.scenario(sample)
            kernels = self.job.kernels(scenario)
            assembled = scenario, assemble(self.job.robot, scenario, self.job.tool, no_progress, kernels)
            self._assemblies[key] = assembled
            if len(self._assemblies) > KEPT:
                self._assemblies.popitem(last=False)
            return assembled

    def rows(self, indices: Sequence[int], samples: Sequence[Sequence[float]]) -> list[SampleRow]:
        """Compute the rows of samples, in their order; those of one scenario side by side."""
        rows: dict[int, SampleRow] = {}
        for places in self._groups(samples):
            outcomes = self.outcomes([samples[i] for i in places])
            for i, outcome in zip(places, outcomes, strict=True):
                sample = tuple(samples[i])
                if isinstance(outcome, EomgenError):
                    rows[i] = SampleRow(indices[i], sample, error=f"{type(outcome).__name__}: {outcome}")
                    continue
                record = tuple(outcome.record.tolist())
                error = finite_or_error(outcome.columns, record)
                row = SampleRow(indices[i], sample, error=error)
                rows[i] = row if error else replace(row, record=record, exceeded=outcome.exceeded)
        return [rows[i] for i in range(len(samples))]

    def motions(self, samples: Sequence[Sequence[float]]) -> list[SimulationResult | EomgenError]:
        """Simulate samples: return motions, in their order, or errors; those of one scenario run side by side."""
        motions: dict[int, SimulationResult | EomgenError] = {}
        for places in self._groups(samples):
            for i, (_, motion) in zip(places, self._moved([samples[i] for i in places]), strict=True):
                motions[i] = motion
        return [motions[i] for i in range(len(samples))]

    def _groups(self, samples: Sequence[Sequence[float]]) -> list[list[int]]:
        """Return indices of the samples, grouped by their scenario."""
        groups: dict[str, list[int]] = {}
        for i, sample in enumerate(samples):
            groups.setdefault(self._key(sample), []).append(i)
        return list(groups.values())

    def _key(self, sample: Sequence[float]) -> str:
        """Return the text of a sample's scenario, by which samples are grouped."""
        if not any(dimension.kind == "scenario" for dimension in self.job.dimensions):
            return ""
        return json.dumps(self.job.scenario_values(sample), sort_keys=True)

    def outcomes(self, samples: Sequence[Sequence[float]]) -> list[Outcome | EomgenError]:
        """Return the outcomes of samples of one scenario, or errors."""
        outcomes: list[Outcome | EomgenError] = []
        for assembly, motion in self._moved(samples):
            if isinstance(motion, EomgenError) or assembly is None:
                outcomes.append(motion if isinstance(motion, EomgenError) else InputError("no motion"))
                continue
            try:
                columns, record = measure(motion, assembly, self.job.plan.record)
                exceeded = exceeded_limits(self.job.robot, motion) if self._limits else ()
                outcomes.append(Outcome(columns, record, exceeded))
            except EomgenError as error:
                outcomes.append(error)
        return outcomes

    def _moved(
        self, samples: Sequence[Sequence[float]]
    ) -> list[tuple[Assembly | None, SimulationResult | EomgenError]]:
        """Simulate samples of one scenario: return assemblies and motions, or None and errors."""
        try:
            scenario, nominal = self.nominal(samples[0])
        except EomgenError as error:
            return [(None, error)] * len(samples)
        made: list[Assembly | EomgenError] = []
        for sample in samples:
            try:
                kernel = nominal.kernel.replaced(parameters=self.job.parameters(sample))
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
        results: list[SimulationResult | EomgenError] = []
        plan = plan_of(nominal, scenario)
        if assemblies and not balance and may_run_side_by_side(nominal, plan):
            fields = {field for name in job.plan.record for field in READS.get(name, ())}
            fields |= {DRIVES} if "effort" in self._limits else set()
            batch = run_side_by_side(job.robot, scenario, assemblies, plan, job.tool, fields)
            return _with_reference_poses(nominal, batch) if POSE in fields else batch
        for assembly in assemblies:
            try:
                result = run_assembly(job.robot, scenario, assembly, job.tool, no_progress, balance=balance)
                results.append(replace(result, program_pose=rigid_pose(nominal.kernel, result)))
            except EomgenError as error:
                results.append(error)
        return results


def _with_reference_poses(
    nominal: Assembly, motions: Sequence[SimulationResult | EomgenError]
) -> list[SimulationResult | EomgenError]:
    """Add the nominal robot's reference poses to motions; they share them where there is a reference."""
    placed: list[SimulationResult | EomgenError] = []
    shared: Array | None = None
    for motion in motions:
        if isinstance(motion, EomgenError):
            placed.append(motion)
            continue
        if shared is None or nominal.program is None:
            shared = rigid_pose(nominal.kernel, motion)
        placed.append(replace(motion, program_pose=shared))
    return placed
