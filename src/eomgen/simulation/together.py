"""One scenario for many kernels of one code, their motions side by side in C: the samples of a sweep."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from ..arrays import Array, Mask
from ..errors import EomgenError
from ..integration.compiled import per_step
from ..integration.methods import IN_C
from ..integration.plan import IntegratorPlan
from ..integration.solve import system_of
from ..integration.steps import output_times, tolerances
from ..integration.system import System
from ..integration.trajectory import Trajectory
from ..robot.coordinates import index_of
from ..robot.value import Robot
from ..runtime.stepping import reading_inputs
from ..runtime.stepping.adaptive import DONE
from ..runtime.stepping.alternation import implicit_spans
from ..runtime.stepping.batch_motion import BatchMotion
from ..runtime.stepping.input_signals import InputSignals
from ..runtime.stepping.options import ErrorControl
from ..runtime.stepping.packed_inputs import PackedInputs
from ..scenario.value import Scenario
from .assembly import Assembly
from .initial import initial_state
from .loads import loaded_parameters
from .result import SimulationResult
from .run import loads_of, run_assembly
from .segments import Function, Loads, between, bounds, piece_times

Motion = SimulationResult | EomgenError

DRIVES, WRENCHES, POSE = "drives", "wrenches", "pose"  # parts of a result that are left out where nobody asks for them
NUMBERS = 1 << 24  # of coordinates and rates that motions side by side hold: 128 MB


def go_together(assembly: Assembly, plan: IntegratorPlan) -> bool:
    """Whether a scenario's motions can go side by side: in C, to the duration, and to the bit as alone.

    Of constraints that are redundant the closing of one state may depend on those beside it.
    """
    return plan.in_c and assembly.until is None and not assembly.kernel.raw.libraries.meta.get("redundant", False)


def run_together(
    robot: Robot,
    scenario: Scenario,
    assemblies: Sequence[Assembly],
    plan: IntegratorPlan,
    tool: str,
    parts: Collection[str],
) -> list[Motion]:
    """Motion of each assembly as ``run_assembly`` gives it, or the error that it raises, sooner; see ``go_together``.

    Samples are the same to the bit, whatever goes beside them.  Without energies, balance, contacts, rests, notes and
    the program's poses; a motion that does not come to its end is done by ``run_assembly``.

    Args:
        robot, scenario, tool: as of ``run_assembly``.
        assemblies: of kernels of one code, each with parameters of its own.
        plan: the integrator of all motions.
        parts: what the results have besides, of DRIVES, WRENCHES and POSE.
    """
    grid = output_times(scenario.duration, scenario.output_step)
    found: list[Motion | None] = [None] * len(assemblies)
    starts: dict[int, tuple[Array, Array]] = {}
    for i, assembly in enumerate(assemblies):
        try:
            starts[i] = initial_state(robot, scenario, assembly)[:2]
        except EomgenError as error:
            found[i] = error
    size = max(1, NUMBERS // (2 * grid.size * assemblies[0].kernel.n))
    order = list(starts)
    for k in range(0, len(order), size):
        some = order[k : k + size]
        crowd = _Crowd(robot, scenario, [assemblies[i] for i in some], plan, grid, parts)
        for i, motion in zip(some, crowd.motions([starts[i] for i in some], tool), strict=True):
            found[i] = motion
    return [_alone(robot, scenario, each, tool) if x is None else x for each, x in zip(assemblies, found, strict=True)]


def _alone(robot: Robot, scenario: Scenario, assembly: Assembly, tool: str) -> Motion:
    """A motion by itself, or the error that ends it."""
    assembly.kernel.parameters.update(loaded_parameters(robot, scenario, -np.inf))  # as before anything was picked up
    try:
        return run_assembly(robot, scenario, assembly, tool, lambda _fraction, _text: None, balance=False)
    except EomgenError as error:
        return error


@dataclass
class _Way:
    """One kernel's motion as far as it is there: q, v, u and wrenches of the pieces that are done."""

    assembly: Assembly
    loads: Loads
    q: Array
    v: Array
    rows: list[dict[str, Array]]
    spans: dict[str, float]
    steps: int = 0
    failed: bool = False


@dataclass(frozen=True, eq=False)
class _Crowd:
    """Motions that go side by side."""

    robot: Robot
    scenario: Scenario
    assemblies: Sequence[Assembly]
    plan: IntegratorPlan
    grid: Array
    parts: Collection[str]

    def motions(self, starts: Sequence[tuple[Array, Array]], tool: str) -> list[SimulationResult | None]:
        """The motions from these states; None of one that does not come to its end."""
        ways = [
            _Way(each, loads_of(each), *start, [], dict.fromkeys(IN_C, 0.0))
            for each, start in zip(self.assemblies, starts, strict=True)
        ]
        times = []
        for begin, end in pairwise(bounds(self.scenario, ways[0].loads, self.grid)):
            here = piece_times((begin, end), self.grid)
            keep = np.isin(here, self.grid)
            keep[-1] = end == self.scenario.duration  # else the next piece begins with this sample
            times.append(here[keep])
            self._piece([way for way in ways if not way.failed], here, keep)
        t = np.concatenate(times)
        program = ways[0].assembly.shown
        programmed = None if program is None else program.at(t)[0]
        return [None if way.failed else self._result(way, t, tool, programmed) for way in ways]

    def _piece(self, ways: Sequence[_Way], times: Array, keep: Mask) -> None:
        """Go on with motions over a piece, whose samples are at these times, s; ``keep`` says which ones count."""
        plan, shared = self.plan, None
        systems: list[tuple[_Way, System, InputSignals]] = []
        atols = []
        for way in ways:
            begun = self._begin(way, times)
            way.failed = begun is None
            if begun is None:
                continue
            system, atol = begun
            if shared is None or way.loads.wrench is not None:  # which know the kernel's own centres of mass
                shared = reading_inputs.input_signals(
                    system.kernel.calls, *self._between(way, times), way.loads.prescribed
                )
            systems.append((way, system, shared))
            atols.append(atol)
        if not systems:
            return
        going, _, loads = zip(*systems, strict=True)
        q, v = (np.array([getattr(way, name) for way in going]) for name in "qv")
        calls = [way.assembly.kernel.calls for way in going]
        control = per_step(ErrorControl(plan.method, plan.rtol, np.array(atols), plan.turns))
        motion = BatchMotion(calls, loads, times, q, v, control)
        while motion.go():
            pass
        for k, (way, system, data) in enumerate(systems):
            way.failed = motion.progress[k].reason != DONE
            if not way.failed:
                way.steps += motion.progress[k].steps
                way.spans = {name: way.spans[name] + span for name, span in motion.spans[k].items()}
                self._take(way, system, data, times, motion.samples[:, k], keep)

    def _between(self, way: _Way, times: Array) -> tuple[Function, Function | None]:
        """Drives and wrenches of a piece."""
        return between(way.loads, self.scenario, float(times[0]), float(times[-1]))

    def _begin(self, way: _Way, times: Array) -> tuple[System, Array] | None:
        """Begin a piece: its equations, and absolute tolerances; None where that is left to ``run_assembly``."""
        kernel, plan, begin = way.assembly.kernel, self.plan, float(times[0])
        kernel.parameters.update(loaded_parameters(self.robot, self.scenario, begin))
        try:
            system = system_of(kernel, *self._between(way, times), way.loads.prescribed)
            movable = system.begin(begin, way.q.copy(), way.v.copy()).size
            system.prescribe(begin, way.q, way.v)
            return (system, tolerances(system, way.q, plan)) if movable else None
        except EomgenError:
            return None

    def _take(self, way: _Way, system: System, data: InputSignals, times: Array, samples: Array, keep: Mask) -> None:
        """Take the samples of a piece, (2, T, n); the last one is where the next piece begins."""
        kernel, (q, v) = way.assembly.kernel, samples
        rows = {"q": q, "v": v}
        if DRIVES in self.parts or kernel.prescribed:  # which are put in place with them
            function = kernel.raw.adaptive
            assert function is not None
            system.loaded = PackedInputs(function.library, kernel.calls, data)
            rows["u"], trouble = system.forces_over(times, q, v)
            way.failed = trouble is not None
        wrench = self._between(way, times)[1] if WRENCHES in self.parts else None
        if wrench is not None:
            rows["wrench"] = np.array([wrench(*state) for state in zip(times.tolist(), q, v, strict=True)])
        if way.failed:
            return
        way.q, way.v = q[-1].copy(), v[-1].copy()
        way.rows.append(rows if keep.all() else {name: values[keep] for name, values in rows.items()})

    def _result(self, way: _Way, t: Array, tool: str, programmed: Array | None) -> SimulationResult:
        assembly, kernel = way.assembly, way.assembly.kernel
        whole: dict[str, Any] = {
            name: way.rows[0][name] if len(way.rows) == 1 else np.concatenate([row[name] for row in way.rows])
            for name in way.rows[0]
        }
        q, v, nothing = whole["q"], whole["v"], np.empty((0, kernel.n))
        info = {"steps": way.steps, **implicit_spans(self.plan.turns, way.spans)}
        method = self.plan.leading(info, float(t[-1]))
        driven = index_of(kernel.coordinates, assembly.driven)
        return SimulationResult(
            robot=self.robot.name,
            trajectory=Trajectory(t, q, v, whole.get("u", nothing), np.empty((0, 2)), kernel.coordinates, method, info),
            program_coordinates=assembly.driven,
            program_q=q[:, driven] if programmed is None else programmed,
            tool=tool,
            pose=np.asarray(kernel.frame_pose(q, tool)) if POSE in self.parts else np.empty((0, 4, 4)),
            program_pose=np.empty((0, 4, 4)),
            notes=(),
            versions=MappingProxyType({}),
            programmed=programmed is not None,
            prescribed=kernel.prescribed,
            links=kernel.links,
            wrench=whole.get("wrench"),
        )
