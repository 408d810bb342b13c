"""Robot, kernel, ranges -> proved bounds of the rounding errors of its outputs.

stage             input                   output
derive_equations  Model                   Equations    the programs that C is rendered from
with_setup        Program and setup       Program      one line of instructions, parameters in front
enclose           Program, ranges         Enclosures   every value as it may be computed
bound_outputs     Enclosures              Bounds       adjoints times roundings
_sizes            Program, ranges         magnitudes   of random states, beside which bounds are small or large
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ..codegen.kernels.bodies import axes_of
from ..codegen.kernels.equations import Equations, derive_equations
from ..codegen.kernels.signatures import DTYPES, KERNELS, available, shapes
from ..codegen.program.ir import Program
from ..codegen.program.numeric import evaluate_lanes
from ..description import RobotLike, as_robot
from ..errors import InputError, UnknownNameError, check_kind
from ..names import listed, show
from ..progress import StageReport, no_report
from ..robot.model import Model, build_model
from .adjoints import bound_outputs
from .enclosures import Enclosures, enclose
from .intervals import Array
from .ranges import (
    Deflection,
    Range,
    as_intervals,
    check_ranges,
    chosen_ranges,
    deflections,
    held_errors,
    random_states,
    shown_ranges,
)
from .result import RoundingBound, RoundingBounds
from .whole import with_setup

STATES = 64  # random ones that sizes are taken from
Ranges = Mapping[str, Sequence[float]]
NO_RANGES: Ranges = MappingProxyType({})
_OF_CONSTRAINTS = ("multiplier of", "residual of", "rate of")  # what constrained_dynamics gives for each


def rounding_bound(
    robot: RobotLike, kernel: str, ranges: Ranges = NO_RANGES, *, dtype: str = "float64"
) -> RoundingBound:
    """Prove how large rounding errors of a kernel's outputs may be, over ranges of inputs and parameters.

    The exact result is that of the kernel's formulas for the very inputs that are handed in.  Arithmetic is that of
    IEEE 754 with denormal numbers, rounded to nearest; a sine or cosine is within 3 units in the last place (what
    eomgen's C computes is, and what C libraries have), an exponential function, logarithm or angle within 2.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernel: name of a kernel that solves no equations, such as "inverse_dynamics" or "kinematics".
        ranges: (least, largest) by name: of a coordinate ("joint2.gamma"); its velocity, acceleration or force
            ("v:joint2.gamma", "a:joint2.gamma", "u:joint2.gamma"); a run-time parameter; all of an array ("q", "v",
            "a", "u", "wrench"); or how far a gear is deflected, motor / ratio - joint ("deflection:joint2").  By
            default coordinates have their limits, or +-3 rad and +-1 m, deviations, modes and deflections +-0.01;
            velocities +-3 rad/s and +-1 m/s, of deviations +-0.1; accelerations +-10; forces +-100; all else +-1;
            parameters have their values.
        dtype: "float64" or "float32".

    Raises:
        InputError: a kernel that solves equations or is composed of others, an unknown name, or ends that are no range.
    """
    model = build_model(as_robot(robot))
    check_ranges(model, ranges)
    check_dtype(dtype)
    check_kind("kernel", kernel, isinstance(kernel, str), "the name of a kernel")
    known = available(model)
    if kernel not in known:
        raise UnknownNameError(f"kernel {show(kernel)} is not one of this robot's; known: {', '.join(known)}")
    if KERNELS[kernel].solves:
        raise InputError(
            f"kernel {kernel!r} solves equations and has no bound over ranges; allowed: {listed(bounded(model))}, or"
            " kernel.with_errors for a result of it"
        )
    equations = derive_equations(model, (kernel,), dtype)
    reason = no_program(equations, kernel)
    if reason:
        raise InputError(
            f"kernel {kernel!r} has no bound: it is {reason}; allowed: programs of their own, or"
            " kernel.with_errors for a result of it"
        )
    return bound_program(equations, kernel, ranges, dtype)


def rounding_bounds(
    robot: RobotLike,
    kernels: Sequence[str] = (),
    ranges: Ranges = NO_RANGES,
    *,
    dtype: str = "float64",
    progress: StageReport = no_report,
) -> RoundingBounds:
    """Return ``rounding_bound`` of several kernels; of all that come without a request if none is named.

    Args:
        robot, ranges, dtype: as of ``rounding_bound``.
        kernels: names; those of solves are refused, or left out where none is named.
        progress: called with a line of text when a kernel's turn comes.

    Raises:
        InputError: see ``rounding_bound``.
    """
    found: dict[str, RoundingBound] = {}
    if kernels:
        for name in kernels:
            progress(f"bounding {name}")
            found[name] = rounding_bound(robot, name, ranges, dtype=dtype)
        return RoundingBounds(kernels=found, left_out={})
    model = build_model(as_robot(robot))
    check_ranges(model, ranges)
    check_dtype(dtype)
    left_out = {name: "they solve equations" for name in _usual(model) if KERNELS[name].solves}
    progress("deriving equations")
    equations = derive_equations(model, bounded(model), dtype)
    for name in bounded(model):
        reason = no_program(equations, name)
        if reason:
            left_out[name] = reason
            continue
        progress(f"bounding {name}")
        found[name] = bound_program(equations, name, ranges, dtype)
    return RoundingBounds(kernels=found, left_out=left_out)


def _usual(model: Model) -> tuple[str, ...]:
    """Name the kernels that there are without a request."""
    return tuple(x for x in available(model) if not (KERNELS[x].by_request or KERNELS[x].derivative_of))


def bounded(model: Model) -> tuple[str, ...]:
    """Name kernels that there are without a request and solve no equations."""
    return tuple(name for name in _usual(model) if not KERNELS[name].solves)


def check_dtype(dtype: str) -> None:
    if not isinstance(dtype, str) or dtype not in DTYPES:
        raise InputError(f"dtype {show(dtype)}: allowed: {listed(DTYPES)}")


def no_program(equations: Equations, kernel: str) -> str:
    """Say why a kernel is no program of its own, or nothing."""
    if KERNELS[kernel].kind == "extended":
        return "in double-double arithmetic"
    if kernel in equations.calls:
        return f"composed of {listed(equations.calls[kernel])}"
    return "" if kernel in equations.programs else "no program"


@dataclass(frozen=True)
class Enclosed:
    """A kernel's program with enclosures of its values, and its outputs.

    Attributes:
        gears: how far they are deflected.
        program: from the parameters on.
        chosen: ranges by array and element.
        found: its enclosures.
        names: of all outputs.
        places: of outputs that are written, the indices of their values.
        with_bounds: places of those that have a bound.
        refused: the others by name, with the instruction and the range that say why.
    """

    gears: Sequence[Deflection]
    program: Program
    chosen: Mapping[str, Sequence[Range]]
    found: Enclosures
    names: tuple[str, ...]
    places: Mapping[int, int]
    with_bounds: list[int]
    refused: Mapping[str, str]


def enclosed(equations: Equations, kernel: str, ranges: Ranges, dtype: str, rounded: Collection[str] = ()) -> Enclosed:
    """Enclose the values of a kernel that is a program.

    Args:
        equations: with the kernel's program.
        kernel, ranges, dtype: as of ``rounding_bound``.
        rounded: arrays whose elements the exact result takes as they are in double precision, "p" with the values that
            the description gives to parameters; others are exact as ``dtype`` holds them.
    """
    model, signature = equations.model, KERNELS[kernel]
    program = with_setup(equations.programs[kernel], equations.setup)
    chosen = chosen_ranges(model, signature.reads, ranges, dtype)
    held = {array: held_errors(model, array, chosen[array], dtype) for array in rounded if array in chosen}
    gears = deflections(model, ranges)
    found = enclose(program, dtype, as_intervals(chosen), held, gears)
    shape = shapes(model, (kernel,))[signature.writes]
    names = _frame_names(model) if signature.kind == "frames" else _output_names(model, signature.writes, shape)
    places = {place: index for (array, place), index in program.outputs.items() if array == "out"}
    with_bounds = [place for place, index in places.items() if found.obstacles[index] < 0]
    refused = {}
    for place in sorted(places.keys() - set(with_bounds)):
        obstacle = found.obstacles[places[place]]
        refused[names[place]] = f"{describe(program, obstacle)}: {found.reasons[obstacle]}"
    return Enclosed(gears, program, chosen, found, names, places, with_bounds, refused)


def bound_program(
    equations: Equations, kernel: str, ranges: Ranges, dtype: str, rounded: Collection[str] = ()
) -> RoundingBound:
    """Bound the outputs of a kernel that is a program."""
    model, made = equations.model, enclosed(equations, kernel, ranges, dtype, rounded)
    names, program = made.names, made.program
    bound, fused, share = np.zeros(len(names)), np.zeros(len(names)), np.zeros(len(names))
    worst = [""] * len(names)
    without = list(made.places.keys() - set(made.with_bounds))
    bound[without] = fused[without] = np.inf
    if made.with_bounds:
        places = made.with_bounds
        bounds = bound_outputs(made.found, [made.places[place] for place in places])
        bound[places], fused[places], share[places] = bounds.plain, bounds.fused, bounds.share
        for place, index in zip(places, bounds.worst, strict=True):
            worst[place] = "" if index < 0 else describe(program, index)
    return RoundingBound(
        robot=model.name,
        kernel=kernel,
        dtype=dtype,
        outputs=names,
        bound=bound,
        fused=fused,
        size=output_sizes(made),
        worst=tuple(worst),
        share=share,
        refused=made.refused,
        ranges=shown_ranges(model, made.chosen, _read(made.found), made.gears),
    )


def _read(found: Enclosures) -> set[tuple[str, int]]:
    """Return (array, index) of all inputs that a program reads."""
    return {instruction.leaf for instruction in found.program.instructions if instruction.op == "input"}


def output_sizes(made: Enclosed) -> Array:
    """Return largest magnitudes of a kernel's outputs, (outputs,), in random states of the ranges."""
    size, program = len(made.names), replace(made.program, wide=frozenset())
    inputs = random_states(made.chosen, made.gears, STATES)
    with np.errstate(all="ignore"):
        out = evaluate_lanes(program, inputs, "float64").get("out", np.zeros((size, STATES)))
    found = np.zeros(size)
    found[: len(out)] = np.nanmax(np.where(np.isfinite(out), np.abs(out), 0.0), axis=1, initial=0.0)
    return found


def _output_names(model: Model, writes: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Name outputs by coordinates where a side has all of them, else by places from 0: "joint1.gamma, joint2.gamma"."""
    if writes == "pair":
        return "kinetic", "potential"
    if writes == "constrained":
        return (*model.velocities, *(f"{kind} {name}" for kind in _OF_CONSTRAINTS for name in model.constraints))
    sides = [model.velocities if length == model.size else tuple(map(str, range(length))) for length in shape]
    return (
        tuple(", ".join(sides[k][i] for k, i in enumerate(at)) for at in np.ndindex(*shape)) if math.prod(shape) else ()
    )


def _frame_names(model: Model) -> tuple[str, ...]:
    """Name what the program of frames writes: entries of [R | X] per frame, bodies' origins, coordinates' axes."""
    poses = [f"{frame}[{row}, {column}]" for frame in model.frames for row in range(3) for column in range(4)]
    origins = [f"origin of {body.name}[{k}]" for body in model.bodies for k in range(3)]
    axes = [f"axis of {axis.name}[{k}]" for axis in axes_of(model) for k in range(3)]
    return (*poses, *origins, *axes)


def describe(program: Program, index: int) -> str:
    """Say which instruction it is: its number, operation, and the comment of the C in front of it."""
    op = program.instructions[index].op
    note = next((program.notes[i] for i in sorted(program.notes, reverse=True) if i <= index), "in front")
    return f"{op} {index} ({note})"
