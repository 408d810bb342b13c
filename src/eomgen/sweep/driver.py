"""Sweeps: one scenario of one robot for many values of their numbers, on all cores or many machines.

    plan, robot, scenario -> Job          what every sample has in common, checked; it travels by content
    plan                  -> Design       the numbers of sample i, from i alone
    Job, numbers          -> rows         in threads here, or by any executor of concurrent.futures
    rows                  -> SweepResult  placed by index, so that nothing depends on who did what when

docs/sweep.md says what plans are made of.
"""

from __future__ import annotations

import itertools
import os
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .._version import __version__
from ..description import RobotLike, as_robot
from ..errors import EomgenError, InputError
from ..files import as_path
from ..forms.dotted_paths import get_path
from ..forms.toml_text import parse_toml
from ..identifiers import parameter_path
from ..integration.plan import IntegratorPlan
from ..names import show
from ..progress import Progress, no_progress, tells_at_prompt
from ..robot.model import tool_of
from ..robot.parameter_names import expand_each, expand_tunable
from ..robot.value import Robot
from ..scenario.load import read_scenario, scenario_from_values
from ..scenario.value import Scenario
from ..simulation.assembly import Assembly
from ..simulation.run import plan_of
from ..simulation.side_by_side import may_run_side_by_side
from .contents import SampleRow, manifest_of, row_check
from .design import Design
from .job import Dimension, Job, SampleRunner
from .measures import BALANCED, check_record
from .plan import Distribution, Plan, as_plan
from .result import SweepResult
from .shipping import Builds, Content, builds_of, check_same, lacks_sources, pack, source_keys, unpack
from .store import FORMAT, SweepStore, opened

CHUNK = 16  # samples that are done together
FIRST, AHEAD = 8, 512  # chunks that wait at an executor: at first, at most


@tells_at_prompt("sweeping")
def run(
    robot: RobotLike,
    scenario: str | Path | Mapping[str, Any],
    plan: Plan | str | Path,
    output: Path | str,
    *,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Run all samples of a plan that the output folder does not have yet.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        scenario: built-in name or path of a .toml file, or the values of one.
        plan: from ``load_plan``, or the path of a .toml file.
        output: a new folder, or that of the same sweep, which goes on where it ended.
        threads: of this process; default: one per core.
        executor: of ``concurrent.futures`` (processes, Dask's ``client.get_executor()``, MPI's, joblib's loky) instead
            of threads; its workers have eomgen of the same version and a C compiler.
        progress: called with a fraction from 0 to 1 and a line of text with speed and time left.

    Raises:
        InputError: plan, scenario and robot do not fit, or the folder is of something else.  Samples that fail do not
            raise; their rows have the error.
    """
    robot, plan, folder = as_robot(robot), as_plan(plan), as_path(output, "output")
    if threads is not None and executor is not None:
        raise InputError("threads and executor are both set; allowed: one of them")
    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
        raise InputError(f"threads: {threads!r} is not a number of threads; a whole number from 1 on is allowed")
    report: Progress = progress or no_progress
    report(0.0, "preparing")
    job, design, notes = prepare(robot, scenario, plan)
    manifest = {"key": job.key, "eomgen": __version__, **_about(job, design, notes)}
    check = row_check(manifest_of({"format": FORMAT, **manifest}, "sweep"))
    with opened(folder, manifest, check) as store:
        missing = [i for i in range(len(design)) if i not in store.rows]
        if executor is not None:
            source = _by_executor(job, design, missing, executor)
        else:
            source = _by_threads(job, design, missing, threads or os.cpu_count() or 1)
        _collect(store, source, len(missing), report)
    return SweepResult.load(folder)


def prepare(
    robot: RobotLike, scenario: str | Path | Mapping[str, Any], plan: Plan
) -> tuple[Job, Design, tuple[str, ...]]:
    """Check a plan against robot and scenario; return the job, its samples, and notes about how it is done."""
    robot = as_robot(robot)
    if isinstance(scenario, Mapping):
        values, source, folder = dict(scenario), "scenario", Path()
    elif not isinstance(scenario, (str, Path)):
        raise InputError(
            f"scenario: got a value of type {type(scenario).__name__}; allowed: a built-in name, the path of a .toml"
            " file, or a dict of its values"
        )
    else:
        text, source, folder = read_scenario(scenario)
        values = dict(parse_toml(text, source))
    base = scenario_from_values(values, source=source, folder=folder)
    pairs = _dimensions(robot, values, base, plan)
    names = tuple(dimension.name for dimension, _ in pairs if dimension.kind == "parameter")
    swept = replace(robot, tunable=tuple(dict.fromkeys((*robot.tunable, *names))))
    tool = tool_of(robot, base.frame, base.label("frame"))
    dimensions = tuple(dimension for dimension, _ in pairs)
    job = Job(
        robot=swept,
        values=values,
        source=source,
        folder=folder.resolve(),
        plan=plan,
        dimensions=dimensions,
        tool=tool,
    )
    _, assembly = SampleRunner(job).nominal(())
    how = plan_of(assembly, base)
    reason = _not_rolled(assembly, how)
    if reason and plan.engine == "rollout":
        plan.fail("engine.type", f'"rollout": {reason}; allowed: "auto", "integrate"')
    check_record(plan, base, assembly)
    job = replace(job, dimensions=tuple(_scaled(plan, values, assembly.kernel.parameters, x) for x in pairs))
    outcome = SampleRunner(replace(job, dimensions=())).outcomes([()])[0]
    if isinstance(outcome, EomgenError):
        raise outcome
    job = replace(job, columns=outcome.columns)
    design = Design([entry for _, entry in pairs], plan.samples, plan.seed, plan.design)
    side = BALANCED not in plan.record and may_run_side_by_side(assembly, how)
    note = "each sample by the integrator of the scenario" + (", side by side in C" if side else "")
    return job, design, (note + (f", because rollouts cannot: {reason}" if reason else ""),)


def _not_rolled(assembly: Assembly, how: IntegratorPlan) -> str:
    """Say why rollouts cannot do a scenario; "" where they can."""
    if assembly.until is not None:
        return "until: motions that end before the duration does cannot be rollouts"
    if how.in_c:
        return ""
    return how.not_in_c if how.reason else f"integrator.method: {how.method} integrates in Python"


def _dimensions(
    robot: Robot, values: Mapping[str, Any], scenario: Scenario, plan: Plan
) -> list[tuple[Dimension, Distribution]]:
    """Return the numbers that vary, each with its distribution; a pattern stands for all names that match."""
    dimensions: list[tuple[Dimension, Distribution]] = []
    carrying = {load.link for load in scenario.payloads}
    meant = expand_each(robot, [entry.parameter or "" for entry in plan.vary])
    for i, entry in enumerate(plan.vary):
        unit = 1.0 if entry.relative else None
        if entry.scenario is not None:
            try:
                get_path(values, entry.scenario)
            except InputError as error:
                plan.fail(f"vary[{i}].scenario", str(error))
            dimensions.append((Dimension("scenario", entry.scenario, unit), entry.distribution))
            continue
        try:
            names = meant[entry.parameter or ""] or expand_tunable(robot, [entry.parameter or ""])
        except InputError as error:
            plan.fail(f"vary[{i}].parameter", getattr(error, "message", str(error)))
        for name in names:
            kind, owner, *_ = parameter_path(name)
            if kind == "links" and owner in carrying:
                plan.fail(
                    f"vary[{i}].parameter",
                    f"{name}: the scenario has a payload on this link; allowed: others, or payloads.0.mass as scenario",
                )
            dimensions.append((Dimension("parameter", name, unit), entry.distribution))
    twins = [name for name, many in Counter(x.name for x, _ in dimensions).items() if many > 1]
    if twins:
        plan.fail("vary", f"{twins[0]} is varied by more than one entry; allowed: by one")
    return dimensions


def _scaled(
    plan: Plan, values: Mapping[str, Any], parameters: Mapping[str, float], pair: tuple[Dimension, Distribution]
) -> Dimension:
    """Return the dimension with the nominal value of its relative numbers."""
    dimension, _ = pair
    if dimension.unit is None:
        return dimension
    nominal = parameters[dimension.name] if dimension.kind == "parameter" else get_path(values, dimension.name)
    if isinstance(nominal, bool) or not isinstance(nominal, (int, float)) or nominal == 0:
        plan.fail(
            "vary",
            f"{dimension.name} is {show(nominal)}, and relative numbers are multiples of it; allowed: not relative",
        )
    return replace(dimension, unit=float(nominal))


def _about(job: Job, design: Design, notes: Sequence[str]) -> dict[str, Any]:
    different = list(dict.fromkeys(design.distributions))
    places = [different.index(item) for item in design.distributions]
    return {
        "robot": job.robot.name,
        "tool": job.tool,
        "samples": len(design),
        "seed": job.plan.seed,
        "design": job.plan.design,
        "draws": job.plan.samples,
        "distributions": [item.as_dict() for item in different],
        "varied": [
            {"kind": x.kind, "name": x.name, "relative_to": x.unit, "distribution": place}
            for x, place in zip(job.dimensions, places, strict=True)
        ],
        "columns": [{"name": x.name, "unit": x.unit} for x in job.columns],
        "scenario": job.values,
        "notes": list(notes),
    }


def _chunks(indices: Sequence[int], design: Design) -> Iterator[tuple[list[int], list[tuple[float, ...]]]]:
    for first in range(0, len(indices), CHUNK):
        chosen = list(indices[first : first + CHUNK])
        yield chosen, [design.values(i) for i in chosen]


def _by_threads(job: Job, design: Design, missing: Sequence[int], threads: int) -> Iterator[list[SampleRow]]:
    runner, chunks = SampleRunner(job), _chunks(missing, design)
    pool = ThreadPoolExecutor(threads, "eomgen-sweep")
    waiting: set[Future[list[SampleRow]]] = set()
    try:
        while True:
            waiting |= {
                pool.submit(runner.rows, *chunk) for chunk in itertools.islice(chunks, 2 * threads - len(waiting))
            }
            if not waiting:
                return
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _by_executor(job: Job, design: Design, missing: Sequence[int], executor: Executor) -> Iterator[list[SampleRow]]:
    """Work at an executor; a worker that lacks the kernels says so once, and gets them with its next chunk."""
    builds = builds_of(job.robot, job.scenario(), job.kernels(job.scenario()))
    bundle = KernelBundle(job, builds, source_keys(builds))
    content: Content | None = None
    chunks, done = _chunks(missing, design), 0
    waiting: set[Future[Any]] = set()
    try:
        while True:
            # few at first, so that kernels are sent with a worker's first chunk alone
            fresh = itertools.islice(chunks, max(0, min(AHEAD, FIRST + done) - len(waiting)))
            waiting |= {executor.submit(work, bundle, None, *chunk) for chunk in fresh}
            if not waiting:
                return
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                outcome = future.result()
                if isinstance(outcome, MissingKernels):
                    content = content or pack(builds)
                    waiting.add(executor.submit(work, bundle, content, outcome.indices, outcome.samples))
                else:
                    done += 1
                    yield outcome
    finally:
        for future in waiting:
            future.cancel()


@dataclass(frozen=True)
class KernelBundle:
    """A job for workers, with its builds."""

    job: Job
    builds: Builds
    keys: tuple[str, ...]


@dataclass(frozen=True)
class MissingKernels:
    """Answer of a worker that has no kernel for the samples."""

    indices: list[int]
    samples: list[tuple[float, ...]]


_runners: dict[str, SampleRunner] = {}


def work(
    bundle: KernelBundle, content: Content | None, indices: list[int], samples: list[tuple[float, ...]]
) -> list[SampleRow] | MissingKernels:
    """Compute rows of samples in a worker's process."""
    key = bundle.job.key
    if key not in _runners:
        if lacks_sources(bundle.keys):
            if content is None:
                check_same(bundle.builds, bundle.keys)
                return MissingKernels(indices, samples)
            unpack(content, bundle.builds, bundle.keys)
        _runners.clear()  # of an earlier sweep
        _runners[key] = SampleRunner(bundle.job)
    return _runners[key].rows(indices, samples)


def _collect(store: SweepStore, source: Iterator[list[SampleRow]], missing: int, report: Progress) -> None:
    """Append rows as they come; those are kept whatever ends the work."""
    done, failed, began = 0, 0, time.monotonic()
    had = len(store.rows)
    report(had / max(had + missing, 1), f"{had} samples are there, {missing} to do")
    for rows in source:
        store.append(rows)
        done, failed = done + len(rows), failed + sum(bool(row.error) for row in rows)
        rate = done / max(time.monotonic() - began, 1e-9)
        left = (missing - done) / rate
        text = f"{had + done} of {had + missing} samples, {rate:.3g} per s, {left:.0f} s left"
        report((had + done) / (had + missing), text + (f", {failed} failed" if failed else ""))
