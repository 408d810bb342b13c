"""Everything measured, robot by robot -> Report.

had         which peers can be had, and why not          -> Peers
standard    one robot's kernels beside all peers          -> entries
growing     chains of more and more joints, for the plot  -> entries
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eomgen.bench.beside import processor_name
from eomgen.bench.clock import Stopwatch
from eomgen.codegen.package.compile import find_compiler

from . import casadi_peer, mujoco_peer, pinocchio_peer
from .casadi_peer import CasadiPeer
from .cases import ELASTIC, GROWING, TITLES, Case, case, chain
from .contender import Contender, MissingPeer
from .gradients import gradients
from .measure import BATCH_STATES, STATES, Disagreement, measure
from .mujoco_peer import MujocoPeer
from .ours import BATCH, NAME, TEXTBOOK, USED, Ours, Textbook
from .pinocchio_peer import PinocchioPeer
from .python_calls import python_calls
from .report import Call, Entry, Gradient, Report

Progress = Callable[[str], None]
STANDARD = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
BATCH_ROUNDS = 0.3  # of the rounds: a round takes as long as thousands of calls
GRADIENT_ROUNDS = 0.1  # of the rounds: a call goes through all steps, there and back
LARGEST_MATRIX = 36  # coordinates: the size of the code for a mass matrix grows with the square


@dataclass
class Run:
    """A run in progress: which peers there are, and what went wrong."""

    rounds: int
    progress: Progress
    missing: dict[str, str] = field(default_factory=dict)
    disagreements: list[str] = field(default_factory=list)

    def had(self) -> None:
        """Compile every peer once, so that a missing one is named once."""
        for module, make in (
            (pinocchio_peer, pinocchio_peer.library),
            (casadi_peer, casadi_peer.tracer),
            (mujoco_peer, mujoco_peer.library),
        ):
            self.progress(f"compiling {module.NAME} (minutes the first time)")
            try:
                make()
            except MissingPeer as error:
                self.missing[module.NAME] = str(error)
                self.progress(f"{module.NAME} is missing: {error}")

    def peers(self, chosen: Case, missing: dict[str, str]) -> dict[str, Any]:
        """Build the robot in every peer that can be had; the others' reasons go to ``missing``."""
        peers: dict[str, Any] = {TEXTBOOK: Textbook(chosen.robot)}
        for name, make in (
            (pinocchio_peer.NAME, lambda: PinocchioPeer(chosen)),
            (casadi_peer.NAME, lambda: CasadiPeer(chosen, USED)),
            (mujoco_peer.NAME, lambda: MujocoPeer(chosen.robot, mujoco_peer.CONTINUOUS)),
        ):
            if name in self.missing:
                continue
            if chosen.key == ELASTIC and name != mujoco_peer.NAME:
                missing[name] = "its `rnea`, `crba` and `aba` know no springs and dampers of joints"
                continue
            try:
                peers[name] = make()
            except MissingPeer as error:
                missing[name] = str(error)
        return peers

    def entry(
        self,
        chosen: Case,
        kernel: str,
        contenders: Sequence[Contender],
        stopwatch: Stopwatch,
        missing: dict[str, str],
        *,
        batch: bool = False,
        condition: Callable[[np.ndarray], float] | None = None,
    ) -> Entry:
        """Compare and time contenders; if they differ, an entry that says so and has no times."""
        base = Entry(chosen.key, chosen.title, chosen.coordinates, kernel, batch, missing=missing)
        rounds = max(3, round(self.rounds * BATCH_ROUNDS)) if batch else self.rounds
        self.progress(f"timing {kernel}{' in a batch' if batch else ''}")
        try:
            with one_core():
                timing = measure(
                    stopwatch,
                    contenders,
                    chosen.robot,
                    kernel,
                    rounds,
                    count=BATCH_STATES if batch else STATES,
                    condition=condition,
                )
        except (Disagreement, ArithmeticError) as error:
            self.disagreements.append(str(error))
            return Entry(**{**vars(base), "missing": {**missing, "not timed": str(error)}})
        ns = {label: timing.median(label) for label in timing.ns}
        ours = BATCH if batch else NAME
        ratios = {label: timing.ratio(label, ours) for label in ns if label != ours and ours in ns}
        return Entry(**{**vars(base), "ns": ns, "ratios": ratios, "difference": timing.difference})

    def standard(self, chosen: Case) -> Iterator[Entry]:
        """Yield every kernel of a robot: one state, a batch, derivatives, a step."""
        missing: dict[str, str] = {}
        peers = self.peers(chosen, missing)
        stopwatch = peers[TEXTBOOK].yardstick.stopwatch
        ours = Ours(chosen.robot, STANDARD, self.progress)
        for kernel in STANDARD:
            contenders = [ours.contender(kernel), *_contenders(peers, kernel)]
            condition = _condition(peers[TEXTBOOK], chosen.coordinates) if kernel == "forward_dynamics" else None
            yield self.entry(chosen, kernel, contenders, stopwatch, missing, condition=condition)
        for kernel in STANDARD:
            pinocchio = peers[pinocchio_peer.NAME].contenders(kernel) if pinocchio_peer.NAME in peers else []
            contenders = [ours.contender(kernel, batch=True), ours.contender(kernel), *pinocchio]
            condition = _condition(peers[TEXTBOOK], chosen.coordinates) if kernel == "forward_dynamics" else None
            yield self.entry(chosen, kernel, contenders, stopwatch, missing, batch=True, condition=condition)
        slopes = ("derivatives", "forward_derivatives", "second_derivatives")
        for kernel, name in (*((slope, pinocchio_peer.NAME) for slope in slopes), ("step", mujoco_peer.NAME)):
            if name not in peers or (kernel == "step") != (chosen.key == ELASTIC):
                continue
            made = Ours(chosen.robot, (kernel,), self.progress)
            if kernel == "step":
                contenders = [MujocoPeer(chosen.robot).contender(kernel)]
                single, many = (made.step(mujoco_peer.TIME_STEP, states) for states in (0, BATCH_STATES))
                yield self.entry(chosen, kernel, [single, *contenders], stopwatch, missing)
                yield self.entry(chosen, kernel, [many, single, *contenders], stopwatch, missing, batch=True)
                continue
            contenders = _contenders({name: peers[name]}, kernel)
            inverted = kernel == "forward_derivatives"
            condition = _condition(peers[TEXTBOOK], chosen.coordinates) if inverted else None
            yield self.entry(
                chosen, kernel, [made.contender(kernel), *contenders], stopwatch, missing, condition=condition
            )

    def growing(self, chosen: Case) -> Iterator[Entry]:
        """Yield the kernels of the plot: one state beside the textbook and Pinocchio, and a batch."""
        kernels = [k for k in STANDARD if k != "mass_matrix" or chosen.coordinates <= LARGEST_MATRIX]
        ours, textbook = Ours(chosen.robot, kernels, self.progress), Textbook(chosen.robot)
        stopwatch = textbook.yardstick.stopwatch
        pinocchio = None if pinocchio_peer.NAME in self.missing else PinocchioPeer(chosen)
        for kernel in kernels:
            others = [textbook.contender(kernel), *(pinocchio.contenders(kernel) if pinocchio else [])]
            condition = _condition(textbook, chosen.coordinates) if kernel == "forward_dynamics" else None
            yield self.entry(chosen, kernel, [ours.contender(kernel), *others], stopwatch, {}, condition=condition)
            yield self.entry(chosen, kernel, [ours.contender(kernel, batch=True)], stopwatch, {}, batch=True)


def run(
    rounds: int, progress: Progress, keys: Sequence[str] = (), growing: Sequence[int] = GROWING
) -> tuple[Report, list[str]]:
    """Return the report of a run, and what contenders disagreed on.

    Args:
        rounds: per row.
        progress: called with a line of text when something begins.
        keys: robots of ``TITLES``; all if empty.
        growing: numbers of joints of the chains in the plot.
    """
    going = Run(rounds, progress)
    going.had()
    entries: list[Entry] = []
    for key in keys or TITLES:
        progress(f"{key}:")
        try:
            entries += going.standard(case(key))
        except MissingPeer as error:
            going.missing[TITLES[key]] = str(error)
    chains: list[Entry] = []
    for joints in growing:
        progress(f"chain of {joints} joints:")
        chains += going.growing(chain(joints))
    calls: tuple[Call, ...] = ()
    slopes: tuple[Gradient, ...] = ()
    if not keys:
        progress("calls from Python:")
        try:
            calls = python_calls(rounds)
        except (MissingPeer, Disagreement) as error:
            going.disagreements += [str(error)] * isinstance(error, Disagreement)
        progress("gradients of rollouts:")
        try:
            slopes, without = gradients(max(3, round(rounds * GRADIENT_ROUNDS)))
            going.missing |= {f"gradients of rollouts ({number})": why for number, why in enumerate(without, 1)}
        except MissingPeer as error:
            going.missing["gradients of rollouts"] = str(error)
    about = machine(going.missing)
    measured = tuple(entries), tuple(chains), calls, slopes
    return Report(about, rounds, STATES, BATCH_STATES, going.missing, *measured), going.disagreements


def machine(missing: dict[str, str]) -> dict[str, str]:
    """Return what has to be said beside a time."""
    flags = " ".join((*pinocchio_peer.FLAGS, "-std=c++17", "-DNDEBUG"))
    said = {
        "Processor": processor_name(),
        "eomgen and textbook": f"{find_compiler().version.splitlines()[0]}, `{' '.join(USED)}`",
        "Pinocchio": f"wheel pin {pinocchio_peer.version()}, {_first_line(pinocchio_peer.cxx())}, `{flags}`"
        if "Pinocchio" not in missing
        else "",
        "MuJoCo": f"wheel mujoco {mujoco_peer.version()}, its own library" if "MuJoCo" not in missing else "",
        "CasADi": f"wheel casadi {casadi_peer.version()}" if "CasADi" not in missing else "",
    }
    return {key: value for key, value in said.items() if value}


def _first_line(command: str) -> str:
    import shlex
    import subprocess

    said = subprocess.run([*shlex.split(command), "--version"], capture_output=True, text=True, check=True).stdout
    return said.splitlines()[0]


def _contenders(peers: dict[str, Any], kernel: str) -> list[Contender]:
    """Return those of the peers that have the kernel."""
    contenders: list[Contender] = []
    if TEXTBOOK in peers and kernel in STANDARD:
        contenders.append(peers[TEXTBOOK].contender(kernel))
    if pinocchio_peer.NAME in peers and kernel in pinocchio_peer.CODE:
        contenders += peers[pinocchio_peer.NAME].contenders(kernel)
    if casadi_peer.NAME in peers and kernel in casadi_peer.KERNELS:
        contenders.append(peers[casadi_peer.NAME].contender(kernel))
    if mujoco_peer.NAME in peers and kernel in mujoco_peer.CODE:
        contenders.append(peers[mujoco_peer.NAME].contender(kernel))
    return contenders


def _condition(textbook: Textbook, n: int) -> Callable[[np.ndarray], float]:
    """Return the condition number of the mass matrix."""

    def condition(q: np.ndarray) -> float:
        matrix = np.zeros((n, n))
        textbook.yardstick.run("mass_matrix", [np.ascontiguousarray(q)], matrix)
        return float(np.linalg.cond(matrix))

    return condition


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process on one core, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
