"""Time a robot's kernels beside a textbook Newton-Euler algorithm in C, compiled with the same compiler and flags.

    stage               input    output
    build               Robot    Kernel       the generated C, from the cache where it is there
    compile_yardstick   Model    Yardstick    the textbook algorithms and a stopwatch in C
    compare             both     error        refused if they differ
    _measure            both     Row          alternately, in rounds, in one process, the loop in C

Single times move with the machine's load; the ratio of two that took turns moves much less.
"""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..codegen.kernels.groups import ASSEMBLY, INERTIA, STRUCTURES, kernel_group
from ..description import RobotLike, as_robot
from ..errors import InputError, InternalError, LoopError
from ..kernel.complete import Kernel
from ..names import component_name, listed
from ..pipeline.building import build
from ..pipeline.options import Options
from ..pipeline.stages import tools_for
from ..progress import StageReport, no_report
from ..robot.model import build_model, open_tree
from ..robot.value import MOTOR, Robot
from ..runtime.raw import RawFunction
from .clock import FRAME, Timed
from .textbook import COUNTERPARTS, Yardstick, compile_yardstick, unknown_to_textbook

STATES = 16  # random states that every sample cycles through: enough to defeat a lucky one, all in the first cache
CALLS = 200  # from Python, of a sample
SMALL = 1e-3  # m or rad about home, in which a closed mechanism is not looked for any more
BENT = 1e-2  # modal coordinates, whose deflections are small
TREE = "tree_"  # in front of the names of kernels whose loops are cut
TOLERANCE = 1e-9  # greatest relative difference between contenders that are timed


@dataclass(frozen=True)
class Contender:
    """One way of computing something: its operations, and nanoseconds per call (least and median of the rounds)."""

    name: str
    operations: Mapping[str, int]
    least: float
    median: float


@dataclass(frozen=True)
class Row:
    """A kernel and, where there is one, its textbook counterpart.

    ``ratio`` is the median over the rounds of counterpart's time by kernel's time, ``ratio_quartiles`` its spread,
    ``ratio_of_least`` the ratio of the least times.  ``note`` says why a kernel was not timed.
    """

    kernel: Contender
    counterpart: Contender | None = None
    ratio: float | None = None
    ratio_quartiles: tuple[float, float] | None = None
    ratio_of_least: float | None = None
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class BenchResult:
    """Measurements of ``bench``: one row per kernel, and what has to be said beside a time.

    ``error`` is the greatest relative difference (max-norm) between a kernel and its counterpart, None where the
    textbook's algorithms do not know the robot.  ``call`` is the
    median time of one call of the kernel's method ``called`` from Python (ns), with ``Kernel.checks`` and without, and
    ``is_direct`` says whether such calls go through the extension module, ``Functions.is_direct``.  ``note``
    says of a robot with loops which kernels close them, and that the textbook's algorithms know its tree alone.
    """

    robot: str
    coordinates: int
    compiler: str
    flags: tuple[str, ...]
    processor: str
    rounds: int
    states: int
    error: float | None
    rows: tuple[Row, ...] = field(default_factory=tuple)
    called: str = ""
    call: tuple[float, float] = (0.0, 0.0)
    is_direct: bool = False
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; times in ns per call."""
        return asdict(self)

    def lines(self) -> list[str]:
        """Return a table for the terminal: a counterpart stands under its kernel, with the ratio of times."""
        lines = [
            f"{self.robot}: {self.coordinates} coordinates; times in ns per call, {self.rounds} rounds in turns over"
            f" {self.states} states",
            f"{self.processor}; {self.compiler}; {' '.join(self.flags)}",
            *([] if self.error is None else [f"kernel and textbook agree to {self.error:.1e} (relative)"]),
            *([self.note] if self.note else []),
            "",
            f"{'':26}{'mul':>8}{'add':>8}{'div':>6}{'sincos':>8}{'median':>11}{'least':>11}{'ratio':>8}",
        ]
        for row in self.rows:
            lines.append(_line(row.kernel.name, row.kernel, row.note))
            if row.counterpart is not None:
                ratio = "" if row.ratio is None else f"{row.ratio:8.2f}"
                lines.append(_line("  " + row.counterpart.name, row.counterpart, ratio))
        if self.called:
            with_checks, without = (ns / 1e3 for ns in self.call)
            face = (
                ""
                if self.is_direct
                else " (through cffi: there is no extension module here, see kernel.functions.is_direct)"
            )
            lines += [
                "",
                f"kernel.{self.called} called from Python with one state: {with_checks:.3f} us{face}, with"
                f" kernel.checks = False, which does not look for NaN and infinity, {without:.3f} us",
            ]
        return [line.rstrip() for line in lines]


def _line(name: str, contender: Contender, end: str) -> str:
    counts = contender.operations
    count = f"{counts['mul']:8d}{counts['add']:8d}{counts['div']:6d}{counts['sincos']:8d}"
    times = f"{contender.median:11.1f}{contender.least:11.1f}" if contender.median else f"{'-':>11}{'-':>11} "
    return f"{name:26}{count}{times}{end}"


def bench(
    robot: RobotLike,
    *,
    repeat: int = 100,
    kernels: Sequence[str] = (),
    native: bool = False,
    flags: Sequence[str] = (),
    progress: StageReport = no_report,
) -> BenchResult:
    """Return operation counts and time per call of every kernel, beside Newton-Euler in C, alternately in this process.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        repeat: number of rounds; each times every contender of a row once, for at least 0.3 ms.
        kernels: names as in ``Options``; all of them if empty.
        native, flags: how both are compiled, see ``Options``.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: repeat is less than 1, or an option is unknown.
        BuildError: a compilation failed.
        InternalError: a kernel and its counterpart give different results; nothing is timed then.
    """
    robot = as_robot(robot)
    if isinstance(repeat, bool) or not isinstance(repeat, int) or repeat < 1:
        raise InputError(f"repeat: {repeat!r} is not a number of rounds; a whole number from 1 on is allowed")
    from ..codegen.package.compile import find_compiler

    options = Options(tuple(kernels), native=native, flags=tuple(flags))
    kernels = options.kernels or "all"
    kernel = build(robot, kernels=kernels, native=native, flags=options.flags, progress=progress)
    used = tools_for(options).flags
    progress("compiling the Newton-Euler algorithm")
    unknown = unknown_to_textbook(build_model(robot).tree)
    yardstick = compile_yardstick(build_model(robot).tree, used, is_known=not unknown)
    inputs = _inputs(robot, kernel)
    progress("comparing results")
    error = None if unknown else compare(kernel, yardstick, inputs)
    rows = []
    for function in kernel.raw.functions.values():
        progress(f"timing {function.name}")
        rows.append(_measure(kernel, yardstick, function, inputs, repeat))
    timed = [row.kernel.name for row in rows if not row.note and hasattr(type(kernel.functions), row.kernel.name)]
    called = next((name for name in (*COUNTERPARTS, *timed) if name in timed), "")
    call = _call_from_python(kernel, called, inputs, repeat) if called else (0.0, 0.0)
    return BenchResult(
        robot=robot.name,
        coordinates=kernel.n,
        compiler=find_compiler().version.splitlines()[0],
        flags=used,
        processor=processor_name(),
        rounds=repeat,
        states=STATES,
        error=error,
        rows=tuple(rows),
        called=called,
        call=call,
        is_direct=kernel.functions.is_direct,
        note="; ".join(filter(None, (unknown, _closed_note(robot, kernel)))),
    )


def _closed_note(robot: Robot, kernel: Kernel) -> str:
    """Say which kernels are of the closed mechanism, and which of its tree; "" where there is no difference."""
    closing = [name for name in kernel.raw.functions if _is_closed(kernel, name)]
    if kernel.couplings:
        return f"{listed(kernel.follower_names)} follow others, which the textbook's algorithms do not know"
    if not closing:
        return open_tree(robot)
    cut = listed([loop.name for loop in robot.loops] + [coupling.name for coupling in robot.couplings])
    return (
        f"{', '.join(closing)}: of the closed mechanism ({cut}), which the textbook's algorithms do not know; what"
        " stands beside one of those is of the open tree"
    )


def _call_from_python(kernel: Kernel, name: str, inputs: Mapping[str, Array], rounds: int) -> tuple[float, float]:
    """Return the median times of a kernel's method with one state, ns, with its checks and without, in turns.

    It is called as whoever builds the robot calls it: arrays of the kernel's dtype, a new one comes back.
    """
    function, shapes = kernel.raw.functions[name], kernel.raw.shapes
    arrays = {label: np.ascontiguousarray(inputs[label][0]).reshape(shapes[label]) for label in function.reads}
    arguments = (*(arrays[x] for x in function.arguments), *([kernel.frames[0]] if function.is_framed else []))
    states = {"z": arrays["z"]} if "z" in arrays else {}
    times = np.zeros((rounds, 2))
    methods = [getattr(kernel.replaced(checks=wanted).functions, name) for wanted in (True, False)]
    for method in methods:
        method(*arguments, **states)  # the first call may take another way
    for turn in times:
        for i, method in enumerate(methods):
            begin = time.perf_counter_ns()
            for _ in range(CALLS):
                method(*arguments, **states)
            turn[i] = (time.perf_counter_ns() - begin) / CALLS
    with_checks, without = (float(x) for x in np.median(times, axis=0))
    return with_checks, without


def processor_name() -> str:
    """Return the processor's name, as the machine gives it."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        named = re.search(r"^model name\s*:\s*(.+)$", info.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
        if named:
            return named.group(1).strip()
    import platform

    return platform.processor() or platform.machine()


def _inputs(robot: Robot, kernel: Kernel) -> dict[str, Array]:
    """Return random states, the same on every run, by the name of the array: shape (STATES, size).

    Principal coordinates over their whole range, deviations and rates small where a spring or damper is stiff, so
    that its force does not drown the others in the comparison.
    """
    rng = np.random.default_rng(1)
    q, v = list[Array](), list[Array]()
    modes = {link.name: link.modes.names for link in robot.links if link.modes is not None}
    for joint in robot.joints:
        for name, coordinate in joint.all_coordinates.items():
            if name == MOTOR and joint.motor is not None:  # it turns with its joint, to which the gear is stiff
                places = list(joint.coordinates)
                lead = places.index(joint.principal) - len(places)
                q.append(joint.motor.ratio * q[lead])
                v.append(joint.motor.ratio * v[lead])
                continue
            if component_name(joint.name, name) not in kernel.coordinates:  # it follows others
                continue
            wide = name == joint.principal or joint.is_free
            reach = min({"beta": 1.2}.get(name, 3.0) if wide else 0.3, 100.0 / max(coordinate.stiffness or 0.0, 1e-9))
            rate = min(2.0, 100.0 / max(coordinate.damping or 0.0, 1e-9))
            q.append(rng.uniform(-reach, reach, STATES))
            v.append(rng.uniform(-rate, rate, STATES))
        for _ in modes.get(joint.child, ()):
            q.append(rng.uniform(-BENT, BENT, STATES))
            v.append(rng.uniform(-1.0, 1.0, STATES))
    sizes, n = [x.state.size(x.numbers) for x in build_model(robot).states], kernel.n
    z = np.array([rng.uniform(-size, size, STATES) for size in sizes]).reshape(-1, STATES)
    inputs = {
        "q": np.ascontiguousarray(np.transpose(q)),
        "v": np.ascontiguousarray(np.transpose(v)),
        "a": rng.uniform(-2.0, 2.0, (STATES, n)),
        "z": np.ascontiguousarray(z.T),
        "u": rng.uniform(-20.0, 20.0, (STATES, n)),
        "forces": np.zeros((STATES, kernel.calls.inputs - n)),
        "wrench": rng.uniform(-20.0, 20.0, (STATES, 6 * len(kernel.links))),
    }
    return _closed_inputs(robot, inputs, rng) if kernel.constraints else inputs


def _closed_inputs(robot: Robot, inputs: dict[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    """Draw states of a closed mechanism: near home, with rates and accelerations that keep it closed."""
    model = build_model(robot)
    kernel = build(robot, kernels=kernel_group(robot, STRUCTURES, ASSEMBLY))
    driven = [model.coordinates[i] for i in model.driven]
    q, reach = np.tile(kernel.assemble(model.home), (STATES, 1)), 0.1
    away = rng.uniform(-1.0, 1.0, q.shape) * np.isin(kernel.coordinates, driven)
    while reach > SMALL:
        try:
            q = kernel.assemble(q + reach * away, fixed=driven)
            break
        except LoopError:
            reach *= 0.5
    v = kernel.project_velocity(q, np.minimum(np.abs(inputs["v"]), 1.0))
    return {**inputs, "q": q, "v": v, "a": kernel.forward_dynamics(q, v, inputs["u"], inputs["z"])}


def counterparts(kernel: Kernel) -> dict[str, str]:
    """Return names of the textbook's algorithms by the kernels beside which they stand.

    Articulated bodies know no prescribed coordinate, and none of them knows loops or what follows other coordinates.
    """
    pairs = {}
    for name in () if kernel.couplings else kernel.raw.functions:
        textbook = name.removeprefix(TREE)
        if textbook not in COUNTERPARTS or _is_closed(kernel, name):
            continue
        if COUNTERPARTS[textbook].prescribes or not kernel.prescribed:
            pairs[name] = textbook
    return dict(sorted(pairs.items(), key=lambda pair: list(COUNTERPARTS).index(pair[1])))


def _is_closed(kernel: Kernel, name: str) -> bool:
    """Return whether a function keeps loops closed and couplings."""
    from ..codegen.kernels.signatures import SIGNATURES

    known = SIGNATURES.get(name)
    return bool(
        kernel.constraints
        and known
        and (known.closed or any(SIGNATURES[x].writes == "constrained" for x in known.calls))
    )


def compare(kernel: Kernel, yardstick: Yardstick, inputs: Mapping[str, Array]) -> float:
    """Return the greatest relative difference (max-norm) between kernels and their counterparts over the states.

    Raises:
        InternalError: it is more than 1e-9 (forward dynamics: more than 100 condition numbers of round-off, too).
    """
    worst = 0.0
    for name, textbook_name in counterparts(kernel).items():
        function = kernel.raw.functions[name]
        for state in range(STATES):
            arrays = [np.ascontiguousarray(inputs[label][state]) for label in function.reads]
            ours, textbook = (np.zeros(kernel.raw.shapes[function.writes]) for _ in range(2))
            failed = _call(kernel, function, arrays, ours), yardstick.run(textbook_name, arrays, textbook)
            if any(failed):
                continue  # singular: said in the row
            error = float(np.max(np.abs(ours - textbook)) / max(np.max(np.abs(textbook)), 1e-300))
            allowed = TOLERANCE
            if COUNTERPARTS[textbook_name].solves:
                matrix = np.zeros((kernel.n, kernel.n))
                yardstick.run(*INERTIA, arrays[:1], matrix)
                allowed = max(allowed, 100.0 * float(np.linalg.cond(matrix)) * float(np.finfo(np.float64).eps))
            if not error <= allowed:
                title = COUNTERPARTS[textbook_name].title
                raise InternalError(
                    f"{kernel.name}: {name} differs from the {title} by {error:.1e} (relative, at most {allowed:.0e} is"
                    f" allowed) in state {state}; nothing was timed"
                )
            worst = max(worst, error)
    return worst


def _call(kernel: Kernel, function: RawFunction, arrays: Sequence[Array], out: Array) -> int:
    """Call a function for one state through C alone, so that a status comes back instead of an exception."""
    view, setup = kernel.raw.view, kernel.parameters.setup
    first_frame = (0,) if function.is_framed else ()
    return int(function.code(setup.pointer(function.library), *map(view, arrays), *first_frame, view(out)))


def _measure(
    kernel: Kernel, yardstick: Yardstick, function: RawFunction, inputs: Mapping[str, Array], rounds: int
) -> Row:
    """Time a kernel's function and its counterpart in turns."""
    name, raw, setup = function.name, kernel.raw, kernel.parameters.setup
    arrays = [inputs[label] for label in function.reads]
    out = np.zeros(int(np.prod(raw.shapes[function.writes])))
    counts = dict(kernel.operations[function.kernel])
    names, operations = [name], [counts]
    target = int(out.ctypes.data)
    timed = [Timed(raw.address(name), setup.address(function.library), target)]
    textbook = counterparts(kernel).get(name) if yardstick.is_known else None
    if textbook is not None:
        names.append(COUNTERPARTS[textbook].title)
        timed.append(Timed(yardstick.address(textbook), 0, target))
        operations.append(yardstick.operations(textbook, [np.ascontiguousarray(array[0]) for array in arrays], out))
    for state in range(STATES):
        failed = _call(kernel, function, [np.ascontiguousarray(array[state]) for array in arrays], out)
        if failed:
            why = f"no inertia along {kernel.coordinates[failed - 1]}" if failed <= kernel.n else "loops do not close"
            note = f"not timed: {why} in state {state}"
            return Row(Contender(name, counts, 0.0, 0.0), note=note)
    ns = yardstick.stopwatch.time(timed, FRAME if function.is_framed else len(arrays), arrays, rounds)
    contenders = [
        Contender(label, count, float(min(column)), statistics.median(column.tolist()))
        for label, count, column in zip(names, operations, ns.T, strict=True)
    ]
    if len(contenders) == 1:
        return Row(contenders[0])
    ratios = ns[:, 1] / ns[:, 0]
    low, middle, high = (float(x) for x in np.quantile(ratios, (0.25, 0.5, 0.75)))
    ours, other = contenders
    return Row(ours, other, middle, (low, high), other.least / ours.least)
