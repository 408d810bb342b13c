"""Robot, kernel, ranges -> static bounds of the rounding errors of its outputs.

stage              input                 output
derive_equations   Model                 Equations         the programs that C is rendered from
with_setup         Program and setup     Program           one line of instructions, parameters in front
program_intervals  Program, ranges       ProgramIntervals  every value as it may be computed
bound_outputs      ProgramIntervals      Bounds            adjoints times roundings
output_values      Program, ranges       magnitudes        of random states, for relative bounds
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ..codegen.kernels.bodies import axes_of
from ..codegen.kernels.equations import Equations, derive_equations
from ..codegen.kernels.signatures import DTYPES, KERNELS, available, shapes, signatures_of
from ..codegen.program.ir import Program
from ..description import RobotLike, as_robot
from ..errors import InputError, UnknownNameError
from ..identifiers import check_kind
from ..names import listed, show
from ..progress import StageReport, no_report
from ..robot.model import Model, build_model
from .adjoints import bound_outputs
from .intervals import Array
from .programs import describe, output_values, with_setup
from .ranges import as_intervals, check_ranges, chosen_ranges, deflections, random_states, shown_ranges
from .result import RoundingBound, RoundingBounds
from .values import program_intervals

STATES = 64  # random ones that sizes are taken from
Ranges = Mapping[str, Sequence[float]]
NO_RANGES: Ranges = MappingProxyType({})
_OF_CONSTRAINTS = ("multiplier of", "residual of", "rate of")  # what constrained_dynamics gives for each


def rounding_bound(
    robot: RobotLike, kernel: str, ranges: Ranges = NO_RANGES, *, dtype: str = "float64"
) -> RoundingBound:
    """Bound the rounding errors of a kernel's outputs over ranges of inputs and parameters.

    The bound is proved: no state of the ranges has a larger error.  Its premises:

    - The error is the distance from the exact equations of the description for the inputs handed in.  Rounding at
      generation, of constants that are computed once from the description, adds at most 1e-12 relative and is not
      counted; to an output in which rotations of the description cancel, 1e-12 of the largest output.
    - Ranges are the caller's and are never narrowed.  Inputs without a range of the caller's have the defaults below,
      and the result's ``ranges`` name them.
    - Arithmetic is that of IEEE 754 with denormal numbers, rounded to nearest.  A sine or cosine is within 3 units in
      the last place, an exponential function, logarithm or atan2 within 2.

    Kernels that solve equations are bounded as far as intervals of their program allow: where a pivot's interval
    contains 0, the bound is infinite, and ``refused`` names the instruction and the interval.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernel: name of a kernel, such as "inverse_dynamics" or "kinematics".
        ranges: (least, largest) by name: of a coordinate ("joint2.gamma"); its velocity, acceleration or force
            ("v:joint2.gamma", "a:joint2.gamma", "u:joint2.gamma"); a run-time parameter; all of an array ("q", "v",
            "a", "u", "wrench"); or the deflection of a gear, motor / ratio - joint ("deflection:joint2").  By default
            coordinates have their limits, or +-3 rad and +-1 m; deviations and modes +-0.01; motors follow their
            joints within a deflection of +-0.01, unless the caller gives their range or that of "q"; velocities are
            +-3 rad/s and +-1 m/s, of deviations +-0.1; accelerations +-10; forces +-100; all else +-1; parameters
            have their values.
        dtype: "float64" or "float32".

    Returns:
        Bounds, magnitudes and dominant instructions of the outputs, with the ranges.

    Raises:
        InputError: the kernel is composed of others, a name is unknown, or ends are no range.
    """
    model = build_model(as_robot(robot))
    _check(model, ranges, dtype)
    check_kernel(model, kernel)
    equations = derive_equations(model, (kernel,), dtype)
    reason = no_program(equations, kernel)
    if reason:
        raise InputError(f"kernel {kernel!r} has no bound: it is {reason}; allowed: programs of their own")
    return _bound_program(equations, kernel, ranges, dtype)


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
        kernels: names; those composed of others are refused, or left out where none is named.
        progress: called with a line of text when a kernel's turn comes.

    Raises:
        InputError: see ``rounding_bound``.
    """
    found: dict[str, RoundingBound] = {}
    left_out: dict[str, str] = {}
    for name in kernels:
        progress(f"bounding {name}")
        found[name] = rounding_bound(robot, name, ranges, dtype=dtype)
    if kernels:
        return RoundingBounds(kernels=found, left_out=left_out)
    model = build_model(as_robot(robot))
    _check(model, ranges, dtype)
    progress("deriving equations")
    usual = tuple(x for x in available(model) if not (KERNELS[x].by_request or KERNELS[x].derivative_of))
    equations = derive_equations(model, usual, dtype)
    for name in usual:
        if reason := no_program(equations, name):
            left_out[name] = reason
            continue
        progress(f"bounding {name}")
        found[name] = _bound_program(equations, name, ranges, dtype)
    return RoundingBounds(kernels=found, left_out=left_out)


def _check(model: Model, ranges: Ranges, dtype: str) -> None:
    """Check names and ends of ranges, and the dtype."""
    check_ranges(model, ranges)
    if not isinstance(dtype, str) or dtype not in DTYPES:
        raise InputError(f"dtype {show(dtype)}: allowed: {listed(DTYPES)}")


def check_kernel(model: Model, kernel: str) -> None:
    """Raise UnknownNameError of a kernel that the model does not have."""
    check_kind("kernel", kernel, isinstance(kernel, str), "the name of a kernel")
    known = available(model)
    if kernel not in known:
        raise UnknownNameError(f"kernel {show(kernel)} is not one of this robot's; known: {', '.join(known)}")


def no_program(equations: Equations, kernel: str) -> str:
    """Say why a kernel is no program of its own, or nothing."""
    if kernel in equations.calls:
        return f"composed of {listed(equations.calls[kernel])}"
    return "" if kernel in equations.programs else "no program"


def _bound_program(equations: Equations, kernel: str, ranges: Ranges, dtype: str) -> RoundingBound:
    """Bound the outputs of a kernel that is a program."""
    model, program = equations.model, with_setup(equations.programs[kernel], equations.setup)
    chosen, gears = chosen_ranges(model, signatures_of(model)[kernel].reads, ranges, dtype), deflections(model, ranges)
    found = program_intervals(program, dtype, as_intervals(chosen), gears)
    names = output_names(model, kernel)
    bound, fused, share = np.zeros(len(names)), np.zeros(len(names)), np.zeros(len(names))
    worst, refused = [""] * len(names), {}
    places = {place: index for (array, place), index in program.outputs.items() if array == "out"}
    for place in sorted(places):
        obstacle = found.obstacles[places[place]]
        if obstacle >= 0:
            bound[place] = fused[place] = np.inf
            refused[names[place]] = f"{describe(program, obstacle)}: {found.reasons[obstacle]}"
    bounded = [place for place in places if names[place] not in refused]
    if bounded:
        bounds = bound_outputs(found, [places[place] for place in bounded])
        bound[bounded], fused[bounded], share[bounded] = bounds.plain, bounds.fused, bounds.share
        for place, index in zip(bounded, bounds.worst, strict=True):
            worst[place] = "" if index < 0 else describe(program, index)
    return RoundingBound(
        robot=model.name,
        kernel=kernel,
        dtype=dtype,
        outputs=names,
        bound=bound,
        fused=fused,
        size=_sizes(output_values(program, random_states(chosen, gears, STATES), "float64", len(names))),
        worst=tuple(worst),
        share=share,
        refused=refused,
        ranges=shown_ranges(model, chosen, _read(program), gears),
    )


def _read(program: Program) -> set[tuple[str, int]]:
    """Return (array, index) of all inputs that a program reads."""
    return {instruction.leaf for instruction in program.instructions if instruction.op == "input"}


def _sizes(values: Array) -> Array:
    """Return the largest finite magnitudes of outputs, (outputs,), in states (outputs, states)."""
    sizes: Array = np.where(np.isfinite(values), np.abs(values), 0.0).max(axis=1, initial=0.0)
    return sizes


def output_names(model: Model, kernel: str) -> tuple[str, ...]:
    """Name outputs by coordinates where a side has all of them, else by places from 0: "joint1.gamma, joint2.gamma"."""
    writes = KERNELS[kernel].writes
    shape = shapes(model, (kernel,))[writes]
    if KERNELS[kernel].kind == "frames":
        return _frame_names(model)
    if writes == "pair":
        return "kinetic", "potential"
    if writes == "constrained":
        return (*model.velocities, *(f"{kind} {name}" for kind in _OF_CONSTRAINTS for name in model.constraints))
    named = {len(names): names for names in (model.velocities, model.coordinates)}
    sides = [named.get(length) or tuple(map(str, range(length))) for length in shape]
    return (
        tuple(", ".join(sides[k][i] for k, i in enumerate(at)) for at in np.ndindex(*shape)) if math.prod(shape) else ()
    )


def _frame_names(model: Model) -> tuple[str, ...]:
    """Name what the program of frames writes: entries of [R | X] per frame, bodies' origins, coordinates' axes."""
    poses = [f"{frame}[{row}, {column}]" for frame in model.frames for row in range(3) for column in range(4)]
    origins = [f"origin of {body.name}[{k}]" for body in model.bodies for k in range(3)]
    axes = [f"axis of {axis.name}[{k}]" for axis in axes_of(model) for k in range(3)]
    return (*poses, *origins, *axes)
