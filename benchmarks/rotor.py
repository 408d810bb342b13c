"""Write docs/rotor.md: a rotor that bends in its bearings, beside Exudyn's.

    python -m benchmarks.rotor [--rounds ROUNDS] [--print]

Times are processor times of one motion, the least of rounds in which both take turns in one process on one core; errors
are those of the rotor's middle beside a motion of narrow tolerance, with which Exudyn's agrees in the limit.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.arrays import Array
from eomgen.bench.beside import processor_name
from eomgen.codegen.package.compile import find_compiler
from eomgen.errors import InternalError

from . import exudyn_peer
from .bars import Bar, conclusion
from .exudyn_peer import Settings
from .peers.contender import MissingPeer
from .peers.ours import USED
from .peers.run import one_core
from .rotor_model import SPEED, Rotor, robot, rotor

PAGE = Path(__file__).parents[1] / "docs" / "rotor.md"
DURATION, SAMPLES = 2.0, 200  # s
KERNELS = ("forward_dynamics", "rollout", "adaptive_rollout", "radau_rollout", "frame_pose")
STEPS = (20_000, 100_000, 400_000)  # of the linearly implicit method
TOLERANCES = (  # relative; absolute, m or rad
    *(("radau", rtol, 1e-3 * rtol) for rtol in (1e-2, 1e-4)),
    *(("rosenbrock", rtol, 1e-3 * rtol) for rtol in (1e-3, 1e-4, 1e-5)),
)
PUBLISHED = Settings("GeneralizedAlpha", 20_000)  # of Exudyn's example
OTHERS = (
    Settings("GeneralizedAlpha", 5_000),
    Settings("GeneralizedAlpha", 10_000),
    Settings("GeneralizedAlpha", 40_000),
    Settings("GeneralizedAlpha", 20_000, modified=False),
    Settings("GeneralizedAlpha", 20_000, radius=0.9),
    Settings("TrapezoidalIndex2", 20_000),
)
REFERENCE, FINE = 1e-11, (20_000, 40_000)  # our relative tolerance, and Exudyn's steps whose limit is extrapolated
AGREE = 0.05  # of the error of Exudyn's example: what both differ by in the limit
REQUIRED = 20.0  # times as fast as Exudyn at its error


@dataclass(frozen=True)
class Run:
    """A motion that is timed: who, by which method, what sets its steps; a call that returns places, steps, seconds."""

    label: str
    setting: str
    call: Callable[[], tuple[Array, int, float]]
    is_ours: bool


@dataclass(frozen=True)
class Row:
    """A run's steps, least processor time, s, and error, m."""

    run: Run
    steps: int
    seconds: float
    error: float


class Ours:
    """This project's rotor, compiled."""

    def __init__(self, made: Rotor) -> None:
        self.kernel = eomgen.build(robot(made), kernels=KERNELS, flags=USED)
        self.q = np.zeros(self.kernel.n)
        self.v = np.where(np.array(self.kernel.coordinates) == "pose.gamma", SPEED, 0.0)

    def motion(self, method: str, rtol: float, atol: float | None = None) -> tuple[Array, int, float]:
        """Return places of the middle at samples, steps, and processor time; ``atol``: m or rad, by SPEED of rates."""
        n, options = self.kernel.n, dict[str, Any]()
        if atol is not None:
            options["atol"] = np.repeat([atol, SPEED * atol], n)
        began = time.process_time()
        found = self.kernel.rollout(
            self.q, self.v, duration=DURATION, samples=SAMPLES, rtol=rtol, method=method, **options
        )
        seconds = time.process_time() - began
        return self.kernel.frame_pose(found[0], "middle")[:, :3, 3], int(found.steps), seconds

    def equal_steps(self, steps: int) -> tuple[Array, int, float]:
        """Return the same by equal linearly implicit steps."""
        began = time.process_time()
        found = self.kernel.rollout(
            self.q, self.v, dt=DURATION / steps, steps=steps, every=steps // SAMPLES, method="implicit"
        )
        seconds = time.process_time() - began
        return self.kernel.frame_pose(found[0], "middle")[:, :3, 3], steps, seconds


def runs(ours: Ours, made: Rotor) -> list[Run]:
    """Return all motions that are timed, Exudyn's published one first."""

    def their(settings: Settings) -> tuple[Array, int, float]:
        places, seconds = exudyn_peer.motion(made, settings, DURATION, SAMPLES)
        return places, settings.steps, seconds

    found = [
        Run(x.label, _length(x.steps), lambda x=x: their(x), False)  # type: ignore[misc]
        for x in (PUBLISHED, *OTHERS)
    ]
    found += [
        Run("`implicit`", _length(steps), lambda n=steps: ours.equal_steps(n), True)  # type: ignore[misc]
        for steps in STEPS
    ]
    found += [
        Run(f"`{method}`", f"rtol {rtol:.0e}, atol {atol:.0e}", lambda x=(method, rtol, atol): ours.motion(*x), True)  # type: ignore[misc]
        for method, rtol, atol in TOLERANCES
    ]
    return found


def _length(steps: int) -> str:
    return f"{1e6 * DURATION / steps:g} us"


@dataclass(frozen=True)
class Measured:
    """Rows of all runs; how far both are apart in the limit, m; the number of nodes; how far the middle moves, m."""

    rows: Sequence[Row]
    apart: float
    nodes: int
    moved: float


def measure(rounds: int) -> Measured:
    """Return what was measured.

    Raises:
        MissingPeer: Exudyn is not installed.
        InternalError: both do not move alike.
    """
    exudyn_peer.version()
    made = rotor()
    ours = Ours(made)
    expected, _, _ = ours.motion("radau", REFERENCE)
    coarse, fine = (exudyn_peer.motion(made, Settings(PUBLISHED.solver, n), DURATION, SAMPLES)[0] for n in FINE)
    apart = distance((4.0 * fine - coarse) / 3.0, expected)
    all_runs = runs(ours, made)
    first = [run.call() for run in all_runs]
    errors = [distance(places, expected) for places, _, _ in first]
    if not apart < AGREE * errors[0]:
        raise InternalError(f"in the limit the rotors are {apart:.3g} m apart, of an error of {errors[0]:.3g} m")
    least = [seconds for _, _, seconds in first]
    with one_core():
        for _ in range(rounds):
            least = [min(before, run.call()[2]) for before, run in zip(least, all_runs, strict=True)]
    rows = [
        Row(run, steps, seconds, error)
        for run, (_, steps, _), seconds, error in zip(all_runs, first, least, errors, strict=True)
    ]
    return Measured(rows, apart, len(made.nodes), distance(expected, expected[:1]))


def distance(one: Array, other: Array) -> float:
    """Return the greatest distance of two lists of places; infinite where one has no number."""
    apart = float(np.linalg.norm(one - other, axis=1).max())
    return apart if math.isfinite(apart) else math.inf


def fastest(rows: Sequence[Row], error: float) -> Row | None:
    """Return our fastest row that is as exact, or None."""
    return min((x for x in rows if x.run.is_ours and x.error <= error), key=lambda x: x.seconds, default=None)


def ratio(rows: Sequence[Row], theirs: Row) -> float | None:
    """Return the time of a row of Exudyn's by that of our fastest which is as exact; None where none is."""
    ours = fastest(rows, theirs.error)
    return None if ours is None else theirs.seconds / ours.seconds


TEXT = """# A rotor that bends

Written by `python -m benchmarks.rotor`; do not edit.

Exudyn's example `perfObjectFFRFreducedOrder` is a shaft with a disc and an unbalance that turns at 50 Hz in two
bearings, with eight free-free modes: {duration:g} s in 20,000 implicit steps. Here such a rotor is made of {nodes}
nodes (`benchmarks/rotor_model.py`), and Exudyn's `ObjectFFRFreducedOrder` and eomgen have the same mass and stiffness
matrices, modes, bearings and start. Errors are the greatest distance of the shaft's middle, at {samples} samples, from
a motion by `radau` at a relative tolerance of {reference:.0e}; Exudyn's motions extrapolated to infinitely short steps
are {apart:.1e} m from it. The middle moves by up to {moved:.2g} m.

Processor times of the integration alone, the least of rounds in which all take turns in one process on one core; the
last column is Exudyn's time by that of our fastest row that is as exact.

| | method | step | steps | largest error, m | ms | by eomgen's at the same error |
|---|---|---:|---:|---:|---:|---:|
{rows}

{required}

- Processor: {processor}
- eomgen: {compiler}, `{used}`, called from Python
- Exudyn: wheel exudyn {version}, its own C++, Euler parameters
"""


def page(measured: Measured) -> str:
    """Return the whole page."""
    return TEXT.format(
        duration=DURATION,
        nodes=measured.nodes,
        samples=SAMPLES,
        reference=REFERENCE,
        apart=measured.apart,
        moved=measured.moved,
        rows="\n".join(row_lines(measured.rows)),
        required=conclusion(bars(measured.rows)),
        processor=processor_name(),
        compiler=find_compiler().version.splitlines()[0],
        used=" ".join(USED),
        version=exudyn_peer.version(),
    )


def row_lines(rows: Sequence[Row]) -> list[str]:
    """Return lines of the table."""
    lines = []
    for row in rows:
        times = None if row.run.is_ours else ratio(rows, row)
        who = "eomgen" if row.run.is_ours else "Exudyn"
        lines.append(
            f"| {who} | {row.run.label} | {row.run.setting} | {row.steps} | {row.error:.1e} | {1e3 * row.seconds:.3g} |"
            f" {'' if times is None else f'{times:.0f}'} |"
        )
    return lines


def bars(rows: Sequence[Row]) -> list[Bar]:
    """Return what is required: of the example's settings, and of whichever of Exudyn's rows comes closest."""
    ratios = [ratio(rows, row) for row in rows if not row.run.is_ours]
    known = [x for x in ratios if x is not None]
    least = min(known) if len(known) == len(ratios) else None
    return [Bar("Exudyn's example", ratios[0], REQUIRED), Bar("the closest of Exudyn's settings", least, REQUIRED)]


def main() -> int:
    """Measure, and write the page or print it; say what is missing."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rotor")
    parser.add_argument("--rounds", type=int, default=3, help="rounds in turns (3)")
    parser.add_argument("--print", action="store_true", help="print the page, write nothing")
    options = parser.parse_args()
    try:
        text = page(measure(options.rounds))
    except MissingPeer as error:
        print(f"missing: Exudyn: {error}")
        return 0
    if options.print:
        print(text, end="")
    else:
        PAGE.write_text(text, encoding="ascii")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
