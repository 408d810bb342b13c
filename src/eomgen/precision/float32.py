"""Robot -> what single precision costs it: errors observed against double precision, and their dominant operations.

stage              input                 output
derive_equations   Model, both dtypes    Equations  the programs that C is rendered from
output_values      Programs, states      errors     of float32 against float64, with the description's parameters
contributions      Program, states       parts      of the worst output's error bound at these states, by operations
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..codegen.kernels.equations import Equations, derive_equations
from ..codegen.kernels.groups import ADVICE_ON_FLOAT32, kernel_group
from ..codegen.kernels.signatures import signatures_of
from ..codegen.program.ir import Program
from ..description import RobotLike, as_robot
from ..identifiers import check_kind
from ..progress import StageReport, no_report, tells_at_prompt
from ..robot.model import Model, build_model
from .adjoints import contributions
from .bounds import NO_RANGES, Ranges, check_kernel, no_program, output_names
from .float32_result import Float32Advice, Float32Errors, worst_output
from .intervals import Array
from .programs import note_of, output_values, with_setup
from .ranges import check_ranges, chosen_ranges, deflections, input_name, random_states
from .units import output_units
from .values import program_intervals

STATES = 256  # random ones


@tells_at_prompt("comparing")
def float32_advice(
    robot: RobotLike,
    kernels: Sequence[str] = (),
    ranges: Ranges = NO_RANGES,
    *,
    progress: StageReport = no_report,
) -> Float32Advice:
    """Return the errors of a robot's kernels in single precision, with the operations that dominate them.

    Programs are evaluated in float32 and in float64 at 256 random states of the ranges, which float32 holds exactly;
    parameters are rounded to float32 in the first and the description's in the second.  The dominant operations are
    those with the largest parts in the first-order error bound of the worst output at these states.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernels: names; those that control and simulate if none is given.
        ranges: as of ``rounding_bound``.
        progress: called with a line of text when a kernel's turn comes.

    Returns:
        Largest errors and magnitudes of the outputs of each kernel; kernels composed of others are left out by name.

    Raises:
        InputError: an unknown name, or ends that are no range.
    """
    check_kind("kernels", kernels, isinstance(kernels, (list, tuple)), "a list of names of kernels")
    model = build_model(as_robot(robot))
    check_ranges(model, ranges)
    for name in kernels:
        check_kernel(model, name)
    wanted = tuple(kernels) or kernel_group(model, ADVICE_ON_FLOAT32)
    progress("deriving equations")
    single, double = (derive_equations(model, wanted, dtype) for dtype in ("float32", "float64"))
    found: dict[str, Float32Errors] = {}
    left_out: dict[str, str] = {}
    for name in wanted:
        if reason := no_program(single, name) or no_program(double, name):
            left_out[name] = reason
            continue
        progress(f"comparing {name}")
        found[name] = _errors(name, single, double, ranges)
    return Float32Advice(robot=model.name, kernels=found, left_out=left_out)


def _errors(kernel: str, single: Equations, double: Equations, ranges: Ranges) -> Float32Errors:
    """Compare a kernel's programs, and name the operations that dominate the worst error."""
    model, names = single.model, output_names(single.model, kernel)
    narrow, wide = (with_setup(equations.programs[kernel], equations.setup) for equations in (single, double))
    chosen = chosen_ranges(model, signatures_of(model)[kernel].reads, ranges, "float32")
    states = random_states(chosen, deflections(model, ranges), STATES, "float32")
    exact = output_values(wide, {**states, "p": _described(model, states["p"])}, "float64", len(names))
    off = np.abs(output_values(narrow, states, "float32", len(names)) - exact)
    observed, size = (np.where(np.isfinite(x), np.abs(x), 0.0).max(axis=1, initial=0.0) for x in (off, exact))
    worst = worst_output(observed, size)
    return Float32Errors(
        kernel=kernel,
        outputs=names,
        units=output_units(model, kernel, names),
        observed=observed,
        size=size,
        worst=None if worst is None else names[worst],
        dominant={} if worst is None else _dominant(model, narrow, states, worst),
    )


def _described(model: Model, rows: Sequence[Array]) -> list[Array]:
    """Return parameters as the description has them, where a range does not set them."""
    values = [*model.parameters.values(), *[0.0] * len(model.turning)]
    return [
        np.full_like(row, value) if (row == np.float32(value)).all() else row
        for value, row in zip(values, rows, strict=True)
    ]


def _dominant(model: Model, program: Program, states: Mapping[str, Sequence[Array]], output: int) -> dict[str, float]:
    """Return the parts of operations in an output's error bound, 0 to 1, the largest first; none where it has none."""
    usable = np.isfinite([row for rows in states.values() for row in rows]).all(axis=0)
    points = {array: [(row[usable], row[usable]) for row in rows] for array, rows in states.items()}
    off = [float(np.abs(x[0] - y[0])) for x, y in zip(states["p"], _described(model, states["p"]), strict=True)]
    found = program_intervals(program, "float32", points, rounded={"p": off})
    index = program.outputs["out", output]
    if found.obstacles[index] >= 0:
        return {}
    each = contributions(found, index).sum(axis=1)
    parts: dict[str, float] = {}
    for place in np.flatnonzero(each):
        name = _operation(model, program, int(place))
        parts[name] = parts.get(name, 0.0) + float(each[place] / each.sum())
    return dict(sorted(parts.items(), key=lambda item: -item[1]))


def _operation(model: Model, program: Program, index: int) -> str:
    """Name an operation by the inputs that it takes, or by the comment of the C that it belongs to.

    A parameter is named alone, and a constant by the operation that takes it, if one does.
    """
    op, args, leaf = program.instructions[index]
    if op == "input":
        return f"parameter {input_name(model, *leaf)}"
    if op == "const":
        user = next((i for i, x in enumerate(program.instructions) if index in x.args), None)
        return f"constant in {'a result' if user is None else _operation(model, program, user)}"
    leaves = [program.instructions[arg].leaf for arg in args if program.instructions[arg].op == "input"]
    taken = " and ".join(input_name(model, *x) for x in dict.fromkeys(leaves))
    return f"{op} of {taken}" if taken else f"{op} ({note_of(program, index)})"
