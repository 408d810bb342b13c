"""Write docs/closed.md: forward dynamics of mechanisms with loops beside Pinocchio's.

    python -m benchmarks.closed [--repeat ROUNDS] [--output FILE] [MECHANISM ...]

A ratio is Pinocchio's time by eomgen's, both C or C++ in one process on one core, in turns; they agree before they are
timed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.bench.clock import Stopwatch
from eomgen.bench.textbook import compile_yardstick
from eomgen.codegen.c.operation_counts import operations
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.package.compile import find_compiler
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot

from .bars import Bar
from .closed_peer import CODE, DYNAMICS, LCABA, ClosedPeer, Settings
from .ladder import ladder, ladder_state
from .peers import pinocchio_peer
from .peers.contender import Contender, MissingPeer
from .peers.measure import Disagreement, Timing, compare, time
from .peers.ours import USED
from .peers.ours import Ours as Kernels
from .peers.run import one_core

Array = NDArray[np.float64]
TARGET = Path(__file__).parents[1] / "docs" / "closed.md"
STATES, DIFFERENT, MANY = 16, 64, 4096  # of one state's row; of the batch, which repeats them; in the batch
TOLERANCE = 1e-7  # relative: lcaba's regularised elimination reaches no more
RESIDUAL = 1e-12  # that ends Pinocchio's iteration early
WINDOWS = 40
LADDERS = {2: (266, 207), 200: None}  # windows of ladders that are counted as well, and the most operations
BATCH_ROUNDS = 0.3  # of the rounds: a round takes as long as thousands of calls
LOOPS = ("constraint", "constraint_jacobian")
KERNEL = "forward_dynamics"
ELASTIC, STEP_AT_MOST = "hexapod_elastic", 6.0  # what a step of the open tree may be multiplied by
DIVISION = 8  # a division takes about as long as so many products


@dataclass(frozen=True)
class Case:
    """A mechanism: a guess of a closed state from random numbers, and what the peer's algorithms are set to."""

    title: str
    robot: Callable[[], Robot]
    guess: Callable[[np.random.Generator], tuple[Array, Array]]
    settings: Mapping[str, Settings]
    required: Mapping[bool, float] = field(default_factory=dict)  # batch or not -> least ratio to constraintDynamics
    most: tuple[int, int] | None = None  # multiplications and additions


# ---- ours


class Ours:
    """This project's side: forward dynamics with the loops closed.  The one place that says what is called."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def contenders(self) -> Sequence[Contender]:
        """Return the kernel for one state, and for many."""
        made = Kernels(self.robot, (KERNEL,), lambda line: None)
        return [made.contender(KERNEL), made.contender(KERNEL, batch=True)]

    def operations(self) -> Mapping[str, int]:
        """Return operations of the kernel for one state."""
        return operations(derive_equations(build_model(self.robot), (KERNEL,)))[KERNEL]


# ---- states


def closed_states(robot: Robot, case: Case, count: int) -> list[Array]:
    """Return random q, v, u, (count, n) each, that close the loops to round-off; the same on every run."""
    kernel, rng = eomgen.build(robot, kernels=LOOPS), np.random.default_rng(1)
    drawn: list[tuple[Array, Array, Array]] = []
    while len(drawn) < count:
        q, v = case.guess(rng)
        for _ in range(30):
            g = kernel.functions.constraint(q)
            if np.abs(g).max() < 1e-14:
                break
            q = q - np.linalg.lstsq(kernel.functions.constraint_jacobian(q), g, rcond=1e-9)[0]
        if np.abs(kernel.functions.constraint(q)).max() > 1e-13:
            continue
        J = kernel.functions.constraint_jacobian(q)
        for _ in range(2):
            v = v - np.linalg.lstsq(J, J @ v, rcond=1e-9)[0]
        drawn.append((q, v, rng.uniform(-1.0, 1.0, len(q))))
    return [np.array(column) for column in zip(*drawn, strict=True)]


def _gough(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a pose of the platform, and the legs that reach it."""
    robot = eomgen.load_robot("gough")
    pose = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) + rng.uniform(-0.15, 0.15, 6)
    (sa, sb, sc), (ca, cb, cc) = np.sin(pose[3:]), np.cos(pose[3:])
    R = np.array([[cb * cc, -cb * sc, sb], [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
                  [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb]])  # fmt: skip
    q = [*pose]
    for i, loop in enumerate(robot.loops):
        leg = pose[:3] + R @ loop.placements[0].xyz - robot.joint(f"universal{i + 1}").placement.xyz
        length = float(np.linalg.norm(leg))
        q += [np.arctan2(-leg[1], leg[2]), np.arcsin(leg[0] / length), length]
    return np.array(q), rng.uniform(-1.0, 1.0, len(q))


def _four_bar(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a crank's angle, with the circles of coupler and rocker cut above the ground."""
    angle = rng.uniform(-3.0, 3.0)
    tip = 0.2 * np.exp(1j * angle)
    reach = abs(0.5 - tip)
    coupler = np.angle(0.5 - tip) + np.arccos((0.25 + reach * reach - 0.16) / (reach))
    rocker = np.angle(tip + 0.5 * np.exp(1j * coupler) - 0.5)
    return np.array([angle, coupler - angle, rocker]), rng.uniform(-3.0, 3.0, 3)


def _andrews(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a state near the published start (F. Mazzia, C. Magherini, Test Set for IVP Solvers), the crank turned."""
    start = {"beta": -0.0617138900142764, "gamma": 0.45527981916307, "phi": 0.222668390165886,
             "delta": 0.487364979543843, "omega": -0.222668390165886, "epsilon": 1.23054744454982}  # fmt: skip
    joints = [joint.name for joint in eomgen.load_robot("andrews").joints]
    q = np.array([start.get(name, 0.0) for name in joints])
    turned = rng.uniform(-0.6, 0.6)
    q[joints.index("beta")] += turned
    q[joints.index("theta")] -= 0.75 * turned  # as they start
    return q, rng.uniform(-100.0, 100.0, len(q))


def _ladder(windows: int, rng: np.random.Generator) -> tuple[Array, Array]:
    return ladder_state(windows, rng.uniform(0.5, 2.6), rng.uniform(-2.0, 2.0))


def _settings(dynamics: tuple[float, int], lcaba: tuple[float, int]) -> Mapping[str, Settings]:
    """Return Pinocchio's regularisation and iterations: the fastest that agree."""
    return {DYNAMICS: Settings(dynamics[0], RESIDUAL, dynamics[1]), LCABA: Settings(lcaba[0], RESIDUAL, lcaba[1])}


CASES: Mapping[str, Case] = {
    "gough": Case(
        "Gough's platform",
        partial(eomgen.load_robot, "gough"),
        _gough,
        _settings((0.0, 1), (1e-7, 1)),
        {False: 5.0, True: 30.0},
        (4900, 4100),
    ),
    "four_bar": Case(
        "four-bar linkage",
        partial(eomgen.load_robot, "four_bar"),
        _four_bar,
        _settings((1e-10, 1), (1e-5, 2)),
        most=(128, 84),
    ),
    "andrews": Case(
        "Andrews' mechanism",
        partial(eomgen.load_robot, "andrews"),
        _andrews,
        _settings((1e-10, 1), (3e-5, 2)),
        most=(640, 470),
    ),
    "ladder": Case(
        f"ladder of {WINDOWS} windows",
        partial(ladder, WINDOWS),
        partial(_ladder, WINDOWS),
        _settings((1e-10, 2), (1e-4, 5)),
        most=(6118, 4881),
    ),
}


# ---- rows


@dataclass(frozen=True)
class Row:
    """What was measured of a mechanism, for one state or per state of a batch.

    ns: medians, nanoseconds per state, by label.  ratios: quartiles of the peer's time by ours, by label.
    """

    title: str
    batch: bool
    ns: Mapping[str, float] = field(default_factory=dict)
    ratios: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    difference: float = 0.0
    required: float | None = None
    missing: str = ""

    def bar(self) -> Bar | None:
        """Return what is required of the ratio to constraintDynamics, or None."""
        measured = self.ratios[DYNAMICS][1] if DYNAMICS in self.ratios else None
        return None if self.required is None else Bar(self.title, measured, self.required)


@dataclass(frozen=True)
class Count:
    """Operations of a mechanism's kernel, and how many multiplications and additions there may be."""

    title: str
    operations: Mapping[str, int]
    most: tuple[int, int] | None = None


@dataclass(frozen=True)
class Measured:
    """A run: rows, operations, and the most iterations of the peer by (title, algorithm)."""

    rows: Sequence[Row]
    counts: Sequence[Count]
    iterations: Mapping[tuple[str, str], int]
    step: float | None = None  # operations of an elastic mechanism's implicit step by those of its open tree


def without_springs(robot: Robot) -> Robot:
    """Return the robot without springs between points, which Pinocchio does not have."""
    return replace(robot, springs=())


def measure(names: Sequence[str], rounds: int, progress: Callable[[str], None]) -> Measured:
    """Compare and time every mechanism; return its rows."""
    stopwatch = compile_yardstick(build_model(eomgen.load_robot("one_link")), ()).stopwatch
    rows, iterations = [], {}
    for name in names:
        case = CASES[name]
        progress(f"{name}: building")
        robot = without_springs(case.robot())
        mine = Ours(robot).contenders()
        try:
            peer = ClosedPeer(robot)
            others = [peer.contender(algorithm, case.settings[algorithm]) for algorithm in CODE]
        except MissingPeer as error:
            rows.append(Row(case.title, False, missing=str(error)))
            continue
        different = closed_states(robot, case, DIFFERENT)
        for first in mine:
            progress(f"{name}: timing{' a batch' if first.batch else ''}")
            arrays = [np.tile(x, (MANY // DIFFERENT, 1)) if first.batch else x[:STATES].copy() for x in different]
            rows.append(row(stopwatch, case, [first, *others], arrays, rounds))
        iterations |= {(case.title, other.label): peer.iterations(other) for other in others}
    return Measured(rows, list(counted(names, progress)), iterations, elastic_step(progress))


def elastic_step(progress: Callable[[str], None] = lambda line: None) -> float:
    """Return operations of a linearly implicit step with elastic loops, by those with the loops open."""
    progress(f"{ELASTIC}: counting a linearly implicit step")
    whole = eomgen.load_robot(ELASTIC)
    costs = []
    for robot in (whole, replace(whole, loops=())):
        count = derive(build_model(robot), "implicit_step").count()
        costs.append(count["mul"] + count["add"] + DIVISION * count["div"])
    return costs[0] / costs[1]


def counted(names: Sequence[str], progress: Callable[[str], None]) -> Iterator[Count]:
    """Yield operations of the mechanisms, and of shorter and longer ladders."""
    wanted = [(CASES[name].title, CASES[name].robot, CASES[name].most) for name in names]
    if "ladder" in names:
        wanted += [(f"ladder of {n} windows", partial(ladder, n), most) for n, most in LADDERS.items()]
    for title, make, most in wanted:
        progress(f"{title}: counting")
        yield Count(title, Ours(make()).operations(), most)


def row(stopwatch: Stopwatch, case: Case, contenders: Sequence[Contender], arrays: Sequence[Array], rounds: int) -> Row:
    """Compare our contender, which comes first, with the others; without times if they differ."""
    batch = contenders[0].batch
    base = Row(case.title, batch, required=case.required.get(batch))
    size, label = arrays[0].shape[1], contenders[0].label
    try:
        difference = compare(contenders, arrays, size, TOLERANCE, f"{case.title}: forward dynamics")
    except (Disagreement, ArithmeticError) as error:
        return replace(base, missing=str(error))
    rounds = max(3, round(rounds * BATCH_ROUNDS)) if batch else rounds
    with one_core():
        timing = Timing(time(stopwatch, contenders, arrays, size, rounds), difference)
    ns = {contender.label: timing.median(contender.label) for contender in contenders}
    ratios = {other.label: timing.ratio(other.label, label) for other in contenders[1:]}
    return replace(base, ns=ns, ratios=ratios, difference=difference)


# ---- page

TEXT = """# Closed mechanisms

Written by `python -m benchmarks.closed`; do not edit.

Forward dynamics with the loops closed, beside Pinocchio's `constraintDynamics` and `lcaba`. A number is Pinocchio's
time by eomgen's, above 1 eomgen is faster: the median of {rounds} rounds (batches: {few}) in which all took turns on
one core, the loop in C, with the quartiles in brackets. A row of one state goes through {states} states; eomgen takes
the {many} states of a batch in one call, Pinocchio one after the other. Nothing is timed before the accelerations
agree: the greatest relative difference in this run is {difference:.0e}.

{ratios}

{required}

- Processor: {processor}
- eomgen: {compiler}, `{used}`
- Pinocchio: wheel pin {version}, `{flags}`, its headers alone, everything initialised once

## Operations

Of the kernel for one state, as its C says them: a subtraction counts as an addition, a sine with its cosine as one.

{operations}

{step}

## The mechanisms

- Gough's platform and the four-bar linkage are built in. In the plane a revolute joint is closed in Pinocchio as a
  point: three rows in the place of five, of which one is redundant.
- Andrews' squeezing mechanism is timed without its spring, which Pinocchio does not have; its operations are with it.
- The ladder of {windows} four-bar windows is problem A02 of the IFToMM library of multibody benchmarks.
- Loops are closed to round-off in all states. Pinocchio's settings are the fastest that agree: regularisation and most
  iterations of a state are

{settings}
"""


def page(measured: Measured, rounds: int) -> str:
    """Return the whole page."""
    return TEXT.format(
        rounds=rounds,
        few=max(3, round(rounds * BATCH_ROUNDS)),
        states=STATES,
        many=MANY,
        difference=max((row.difference for row in measured.rows), default=0.0),
        ratios="\n".join(ratio_lines(measured.rows)),
        required="\n".join(required_lines(measured.rows)),
        processor=processor_name(),
        compiler=find_compiler().version.splitlines()[0],
        used=" ".join(USED),
        version=pinocchio_peer.version(),
        flags=" ".join(pinocchio_peer.FLAGS),
        operations="\n".join(operation_lines(measured.counts)),
        step=step_line(measured.step),
        windows=WINDOWS,
        settings="\n".join(setting_lines(measured.iterations)),
    )


def ratio_lines(rows: Sequence[Row]) -> list[str]:
    """Return the table of ratios."""
    lines = [f"| mechanism | {' | '.join(CODE)} |", "|---" + "|---:" * len(CODE) + "|"]
    for row in rows:
        cells = [_quartiles(row.ratios.get(label)) for label in CODE]
        what = f"per state of {MANY}" if row.batch else "one state"
        lines.append(f"| {row.title}, {what} | {' | '.join(cells)} |")
    return lines + [f"- {row.title}: not timed, {row.missing}" for row in rows if row.missing]


def required_lines(rows: Sequence[Row]) -> list[str]:
    """Return the required ratios, and whether they are reached."""
    return [
        f"- Required of {row.title}, {'batch' if row.batch else 'one state'}: {bar.required:g} times"
        f" `{DYNAMICS}`: {bar.verdict}."
        for row in rows
        if (bar := row.bar()) is not None
    ]


def operation_lines(counts: Sequence[Count]) -> list[str]:
    """Return the table of operations."""
    names = ("mul", "add", "div", "sincos")
    lines = [f"| mechanism | {' | '.join(names)} | mul and add at most |", "|---" + "|---:" * (len(names) + 1) + "|"]
    for count in counts:
        cells = [str(count.operations[name]) for name in names]
        bars = [Bar(x, count.operations[x], y, at_most=True) for x, y in zip(names, count.most or (), strict=False)]
        missed = ", missed" * any(bar.is_missed for bar in bars)
        most = "" if count.most is None else f"{count.most[0]}, {count.most[1]}{missed}"
        lines.append(f"| {count.title} | {' | '.join(cells)} | {most} |")
    return lines


def step_line(step: float | None) -> str:
    """Return what a linearly implicit step with elastic loops costs."""
    if step is None:
        return ""
    bar = Bar(ELASTIC, step, STEP_AT_MOST, at_most=True)
    return (
        f"A linearly implicit step of `{ELASTIC}`, all of whose joints have six coordinates, the cut ones too, takes"
        f" {step:.1f} times the operations\nof the same robot with its loops open, a division as {DIVISION}; at most"
        f" {STEP_AT_MOST:g}: {bar.verdict}."
    )


def setting_lines(iterations: Mapping[tuple[str, str], int]) -> list[str]:
    """Return the table of Pinocchio's settings."""
    by_title = {case.title: case for case in CASES.values()}
    titles = dict.fromkeys(title for title, _ in iterations)
    lines = [f"| mechanism | {' | '.join(CODE)} |", "|---" + "|---" * len(CODE) + "|"]
    for title in titles:
        cells = [f"{by_title[title].settings[x].mu:g}, {iterations[title, x]}" for x in CODE]
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return lines


def _quartiles(ratio: tuple[float, float, float] | None) -> str:
    return "" if ratio is None else f"{ratio[1]:.2f} ({ratio[0]:.2f} - {ratio[2]:.2f})"


def main(words: Sequence[str] | None = None) -> int:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.closed", description="Time closed mechanisms beside Pinocchio and write the page."
    )
    parser.add_argument("mechanisms", nargs="*", metavar="MECHANISM", help=f"of {', '.join(CASES)}: writes nothing")
    parser.add_argument("--repeat", type=int, default=100, metavar="ROUNDS", help="rounds per row (default 100)")
    parser.add_argument("--output", type=Path, metavar="FILE", default=TARGET, help="default: docs/closed.md")
    arguments = parser.parse_args(words)
    unknown = [name for name in arguments.mechanisms if name not in CASES]
    if unknown:
        parser.error(f"MECHANISM: {unknown[0]!r} is unknown; allowed: {', '.join(CASES)}")
    if arguments.repeat < 1:
        parser.error(f"--repeat: {arguments.repeat} is not a number of rounds; at least 1")
    progress = (lambda line: print(line, file=sys.stderr)) if sys.stderr.isatty() else (lambda line: None)
    measured = measure(arguments.mechanisms or list(CASES), arguments.repeat, progress)
    print("\n".join([*ratio_lines(measured.rows), *required_lines(measured.rows), *operation_lines(measured.counts)]))
    for row in measured.rows:
        print(f"{row.title}{', batch' * row.batch}: ns " + ", ".join(f"{x} {ns:.0f}" for x, ns in row.ns.items()))
    if arguments.mechanisms:
        return 0
    arguments.output.write_text(page(measured, arguments.repeat), encoding="ascii")
    print(f"wrote {arguments.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
