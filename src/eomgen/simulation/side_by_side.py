"""One scenario for many kernels of one code, their motions integrated side by side in C: the samples of a sweep."""

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
from ..integration.plan import IntegratorPlan
from ..integration.solve import system_of
from ..integration.steps import output_times, tolerances
from ..integration.system import System
from ..integration.trajectory import Trajectory
from ..kernel.stepping import reading_inputs
from ..kernel.stepping.adaptive import DONE
from ..kernel.stepping.alternation import implicit_spans
from ..kernel.stepping.input_signals import InputSignals
from ..kernel.stepping.methods import IN_C
from ..kernel.stepping.motions import BatchMotion
from ..kernel.stepping.options import ErrorControl
from ..kernel.stepping.packed_inputs import PackedInputs
from ..robot.coordinates import index_of
from ..robot.value import Robot
from ..scenario.value import Scenario
from .assembly import Assembly
from .initial import initial_state
from .loads import loaded_parameters
from .result import SimulationResult
from .run import loads_of, run_assembly
from .segments import Function, Loads, between, bounds, piece_times

Motion = SimulationResult | EomgenError

DRIVES, WRENCHES, POSE = "drives", "wrenches", "pose"  # of a result, left out where nobody asks for them
NUMBERS = 1 << 24  # of coordinates and velocities that motions side by side hold: 128 MB


def may_run_side_by_side(assembly: Assembly, plan: IntegratorPlan) -> bool:
    """Return whether a scenario's motions may run side by side: in C, to the duration, and to the bit as alone.

    With redundant constraints the projection of one state may depend on those beside it.
    """
    return plan.in_c and assembly.until is None and not assembly.kernel.raw.libraries.meta.get("redundant", False)


def run_side_by_side(
    robot: Robot,
    scenario: Scenario,
    assemblies: Sequence[Assembly],
    plan: IntegratorPlan,
    tool: str,
    parts: Collection[str],
) -> list[Motion]:
    """Return the motion of each assembly as ``run_assembly``, or the error that it raises, sooner.

    See ``may_run_side_by_side``.  Samples are the same to the bit, whatever goes beside them.  Without energies,
    balance, contacts, stiction, notes and the reference's poses; a motion that does not come to its end is done by
    ``run_assembly``.

    Args:
        robot, scenario, tool: as of ``run_assembly``.
        assemblies: of kernels of one code, each with its parameters.
        plan: the integrator of all motions.
        parts: what the results have besides, of DRIVES, WRENCHES and POSE.
    """
    grid = output_times(scenario.duration, scenario.output_step)
    motions: list[Motion | None] = [None] * len(assemblies)
    starts: dict[int, tuple[Array, Array]] = {}
    for i, assembly in enumerate(assemblies):
        try:
            starts[i] = initial_state(robot, scenario, assembly)[:2]
        except EomgenError as error:
            motions[i] = error
    size = max(1, NUMBERS // (2 * grid.size * assemblies[0].kernel.calls.rates))
    order = list(starts)
    for k in range(0, len(order), size):
        some = order[k : k + size]
        batch = _Batch(robot, scenario, [assemblies[i] for i in some], plan, grid, parts)
        for i, motion in zip(some, batch.motions([starts[i] for i in some], tool), strict=True):
            motions[i] = motion
    return [
        _alone(robot, scenario, each, tool) if x is None else x for each, x in zip(assemblies, motions, strict=True)
    ]


def _alone(robot: Robot, scenario: Scenario, assembly: Assembly, tool: str) -> Motion:
    """Return a motion by itself, or the error that ends it."""
    assembly.kernel.parameters.update(loaded_parameters(robot, scenario, -np.inf))  # as before anything was picked up
    try:
        return run_assembly(robot, scenario, assembly, tool, lambda _fraction, _text: None, balance=False)
    except EomgenError as error:
        return error


@dataclass
class _Member:
    """One kernel's motion so far: q, v, u and wrenches of the pieces that are done."""

    assembly: Assembly
    loads: Loads
    q: Array
    v: Array
    rows: list[dict[str, Array]]
    spans: dict[str, float]
    steps: int = 0
    failed: bool = False


@dataclass(frozen=True, eq=False)
class _Batch:
    """Motions that are integrated side by side."""

    robot: Robot
    scenario: Scenario
    assemblies: Sequence[Assembly]
    plan: IntegratorPlan
    grid: Array
    parts: Collection[str]

    def motions(self, starts: Sequence[tuple[Array, Array]], tool: str) -> list[SimulationResult | None]:
        """Return the motions from these states; None of one that does not come to its end."""
        members = [
            _Member(each, loads_of(each), *start, [], dict.fromkeys(IN_C, 0.0))
            for each, start in zip(self.assemblies, starts, strict=True)
        ]
        times = []
        for begin, end in pairwise(bounds(self.scenario, members[0].loads, self.grid)):
            here = piece_times((begin, end), self.grid)
            keep = np.isin(here, self.grid)
            keep[-1] = end == self.scenario.duration  # else the next piece begins with this sample
            times.append(here[keep])
            self._piece([member for member in members if not member.failed], here, keep)
        t = np.concatenate(times)
        program = members[0].assembly.shown
        programmed = None if program is None else program.at(t)[0]
        return [None if member.failed else self._result(member, t, tool, programmed) for member in members]

    def _piece(self, members: Sequence[_Member], times: Array, keep: Mask) -> None:
        """Advance motions over a piece, whose samples are at these times, s; ``keep`` says which ones count."""
        plan, shared = self.plan, None
        systems: list[tuple[_Member, System, InputSignals]] = []
        atols = []
        for member in members:
            begun = self._begin(member, times)
            member.failed = begun is None
            if begun is None:
                continue
            system, atol = begun
            if shared is None or member.loads.wrench is not None:  # which know the kernel's centres of mass
                shared = reading_inputs.input_signals(
                    system.kernel.calls, *self._between(member, times), member.loads.prescribed
                )
            systems.append((member, system, shared))
            atols.append(atol)
        if not systems:
            return
        going, _, loads = zip(*systems, strict=True)
        q, v = (np.array([getattr(member, name) for member in going]) for name in "qv")
        calls = [member.assembly.kernel.calls for member in going]
        control = per_step(ErrorControl(plan.method, plan.rtol, np.array(atols), plan.turns))
        motion = BatchMotion(calls, loads, times, q, v, control)
        while motion.go():
            pass
        for k, (member, system, data) in enumerate(systems):
            member.failed = motion.progress[k].reason != DONE
            if not member.failed:
                member.steps += motion.progress[k].steps
                member.spans = {name: member.spans[name] + span for name, span in motion.turns[k].spans.items()}
                self._take(member, system, data, times, tuple(x[k] for x in motion.samples), keep)

    def _between(self, member: _Member, times: Array) -> tuple[Function, Function | None]:
        """Return drives and wrenches of a piece."""
        return between(member.loads, self.scenario, float(times[0]), float(times[-1]))

    def _begin(self, member: _Member, times: Array) -> tuple[System, Array] | None:
        """Begin a piece: return equations and absolute tolerances; None where that is left to ``run_assembly``."""
        kernel, plan, begin = member.assembly.kernel, self.plan, float(times[0])
        kernel.parameters.update(loaded_parameters(self.robot, self.scenario, begin))
        try:
            system = system_of(kernel, *self._between(member, times), member.loads.prescribed)
            movable = system.begin(begin, member.q.copy(), member.v.copy()).size
            system.prescribe(begin, member.q, member.v)
            return (system, tolerances(system, member.q, plan)) if movable else None
        except EomgenError:
            return None

    def _take(
        self, member: _Member, system: System, data: InputSignals, times: Array, samples: Sequence[Array], keep: Mask
    ) -> None:
        """Take the samples of a piece, q and v, (T, n); the last one is where the next piece begins."""
        kernel, (q, v) = member.assembly.kernel, samples
        rows = {"q": q, "v": v}
        if DRIVES in self.parts or kernel.prescribed:  # which are put in place with them
            function = kernel.raw.adaptive
            assert function is not None
            system.loaded = PackedInputs(function.library, kernel.calls, data)
            rows["u"], trouble = system.forces_over(times, q, v)
            member.failed = trouble is not None
        wrench = self._between(member, times)[1] if WRENCHES in self.parts else None
        if wrench is not None:
            rows["wrench"] = np.array([wrench(*state) for state in zip(times.tolist(), q, v, strict=True)])
        if member.failed:
            return
        member.q, member.v = q[-1].copy(), v[-1].copy()
        member.rows.append(rows if keep.all() else {name: values[keep] for name, values in rows.items()})

    def _result(self, member: _Member, t: Array, tool: str, programmed: Array | None) -> SimulationResult:
        assembly, kernel = member.assembly, member.assembly.kernel
        whole: dict[str, Any] = {
            name: member.rows[0][name] if len(member.rows) == 1 else np.concatenate([row[name] for row in member.rows])
            for name in member.rows[0]
        }
        q, v, nothing = whole["q"], whole["v"], np.empty((0, kernel.n))
        parts = t, q, v, whole.get("u", nothing), np.empty((0, 2))
        info = {"steps": member.steps, **implicit_spans(self.plan.turns, member.spans)}
        method = self.plan.leading(info, float(t[-1]))
        driven = index_of(kernel.coordinates, assembly.driven)
        return SimulationResult(
            robot=self.robot.name,
            trajectory=Trajectory(*parts, kernel.coordinates, method, info).apart(kernel),
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
