"""Write docs/precision.*: error over time of integrators, ours beside SciPy's, SUNDIALS' and MuJoCo's.

    python -m benchmarks.precision [--rounds ROUNDS] [--page] [PROBLEM ...]

A point of the diagram is one run of one contender with one tolerance or length of steps: its error, and the least time
of its process in rounds in which all runs take turns in it on one core; what runs beside it would lengthen long runs
alone.  Builds are not counted.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eomgen.bench.beside import processor_name
from eomgen.codegen.package.compile import find_compiler
from eomgen.errors import EomgenError

from . import precision_page
from .peers import mujoco_peer
from .peers.contender import MissingPeer
from .peers.run import one_core
from .precision_cases import OTHERS, OURS, PROBLEMS, Motion, Problem, Run
from .precision_report import Measured, Point, Report, read

Array = NDArray[np.float64]

DOCS = Path(__file__).parents[1] / "docs"
AGREE = 5e-12  # m or rad: the references, or nothing is measured
LONG = 1.0  # s: a run that takes longer is taken LONG_ROUNDS times at most
LONG_ROUNDS = 2
ENDLESS = 30.0  # s: and settings of the same contender that ask for more are left out
WORST, BEST = 1.0, 1e-10  # m or rad: errors above are not kept, and below nothing narrower is asked for
Progress = Callable[[str], None]


class Disagreement(Exception):
    """The references differ: no error means anything."""


@dataclass
class _Timed:
    """A run, the least of its times, s, and its coordinates and steps; ``why`` it failed."""

    run: Run
    best: float = np.inf
    spent: float = 0.0
    times: int = 0
    q: Array = field(default_factory=lambda: np.empty(0))
    steps: int = 0
    why: str = ""

    def again(self) -> None:
        """Run once more, unless it fails or is too long."""
        if self.why or (self.times >= LONG_ROUNDS and self.spent > LONG * self.times):
            return
        began = time.process_time()
        try:
            self.q, self.steps = self.run.call()
        except (EomgenError, ArithmeticError) as error:
            self.why = str(error)
        spent = time.process_time() - began
        self.spent, self.times, self.best = self.spent + spent, self.times + 1, min(self.best, spent)


def measure(
    problem: Problem, rounds: int, progress: Progress, contenders: Sequence[str] = (*OURS, *OTHERS)
) -> Measured:
    """Return all contenders at one problem.

    Raises:
        Disagreement: two of our methods do not agree on what is exact.
    """
    progress(f"{problem.key}: building")
    motion = Motion(problem)
    exact, other = motion.exact()
    difference = float(np.abs(exact - other).max())
    if not difference <= AGREE:
        raise Disagreement(
            f"{problem.key}: {' and '.join(name for name, _ in problem.references)} differ by {difference:.1e}"
        )
    with one_core():
        timed = list(_first(motion, contenders, exact, progress))
        for number in range(1, rounds):
            progress(f"{problem.key}: round {number + 1} of {rounds}")
            for each in timed:
                each.again()
    points = [_point(each, exact) for each in timed if not each.why]
    kept = tuple(p for p in points if p.error <= WORST)
    missing = dict(motion.missing)
    for name in contenders:
        if name not in missing and not any(p.contender == name for p in kept):
            missing[name] = next((each.why for each in timed if each.run.contender == name), "") or "no run is exact"
    return Measured(problem.key, difference, kept, missing)


def _first(motion: Motion, contenders: Sequence[str], exact: Array, progress: Progress) -> list[_Timed]:
    """Make every run once; what asks for more than a contender's last precise or longest one is left out."""
    timed: list[_Timed] = []
    for name in contenders:
        progress(f"{motion.problem.key}: {name}")
        done = False
        for run in motion.runs([name]):
            if done and not run.wanted:
                break
            each = _Timed(run)
            each.again()
            timed.append(each)
            done = done or each.best > ENDLESS or (not each.why and np.abs(each.q - exact).max() < BEST)
    return timed


def _point(timed: _Timed, exact: Array) -> Point:
    wrong = np.abs(timed.q - exact)
    run = timed.run
    return Point(run.contender, run.setting, float(wrong.max()), float(wrong[-1].max()), timed.best, timed.steps)


def machine() -> dict[str, str]:
    """Return what has to be said beside a time."""
    import importlib.metadata

    def version(name: str) -> str:
        try:
            return importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            return "not installed"

    said = {"Processor": processor_name(), "Compiler": find_compiler().version.splitlines()[0]}
    said |= {"SciPy": version("scipy"), "SUNDIALS": f"through scikit-sundae {version('scikit-sundae')}"}
    try:
        mujoco_peer.library()
        said["MuJoCo"] = f"wheel mujoco {mujoco_peer.version()}, its own library, the loop over steps in C"
    except MissingPeer as error:
        said["MuJoCo"] = f"missing in this run, {error}"
    return said


def main(words: Sequence[str] | None = None) -> int:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.precision",
        description="Measure error over time of integrators, and write docs/precision.json, .md and .svg.",
    )
    parser.add_argument("problems", nargs="*", metavar="PROBLEM", help=f"of {', '.join(PROBLEMS)}: the rest stays")
    parser.add_argument("--rounds", type=int, default=5, metavar="ROUNDS", help="of all runs (default 5)")
    parser.add_argument("--page", action="store_true", help="write page and figure from the last run, time nothing")
    parser.add_argument("--output", type=Path, default=DOCS, metavar="FOLDER", help="default: docs")
    arguments = parser.parse_args(words)
    unknown = [name for name in arguments.problems if name not in PROBLEMS]
    if unknown:
        parser.error(f"PROBLEM: {unknown[0]!r} is unknown; allowed: {', '.join(PROBLEMS)}")
    if arguments.rounds < 1:
        parser.error(f"--rounds: {arguments.rounds} is not a number of rounds; at least 1")
    stored = arguments.output / "precision.json"
    if not arguments.page:
        progress = (lambda line: print(line, file=sys.stderr)) if sys.stderr.isatty() else (lambda line: None)
        before = {each.problem: each for each in read(stored).found} if arguments.problems and stored.exists() else {}
        measured: dict[str, Measured] = {}
        for name in arguments.problems or PROBLEMS:
            measured[name] = measure(PROBLEMS[name], arguments.rounds, progress)
            whole = before | measured
            kept = tuple(whole[problem] for problem in PROBLEMS if problem in whole)
            Report(machine(), arguments.rounds, kept).write(stored)
    report = read(stored)
    (arguments.output / "precision.md").write_text(precision_page.page(report), encoding="ascii")
    precision_page.draw(report, arguments.output / "precision.svg")
    print("\n".join(precision_page.lines(report)))
    print(f"wrote {arguments.output}/precision.*")
    return 0


if __name__ == "__main__":
    sys.exit(main())
