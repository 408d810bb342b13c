"""Programs in long arithmetic: exact values, and the worst roundings that an adversary can choose.

Adjoints are taken in long arithmetic at one point, by rules of their own.  Each instruction is then rounded by as much
as IEEE arithmetic allows, in the direction in which it moves an output: to first order no roundings move it farther.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mpmath

from eomgen.codegen.program.ir import Program, evaluate

DIGITS = 60
UNITS = {"float64": 2.0**-53, "float32": 2.0**-24}
mp = mpmath.mp.clone() if hasattr(mpmath.mp, "clone") else mpmath.MPContext()
mp.dps = DIGITS
Inputs = Mapping[str, Sequence[Any]]


def _sign(x: Any) -> int:
    return 1 if x > 0 else -1 if x < 0 else 0


CALLS: Mapping[str, Callable[..., Any]] = {
    "sqrt": mp.sqrt,
    "exp": mp.exp,
    "log": mp.log,
    "atan2": mp.atan2,
    "abs": abs,
    "max": lambda x, y: y if x < y else x,
    "step": lambda x: mp.mpf(1 if x > 0 else 0),
    "choose": lambda gate, x, y: x if gate > 0 else y,
}
SLOPES: Mapping[str, Callable[..., tuple[Any, ...]]] = {
    "neg": lambda x: (-1,),
    "add": lambda x, y: (1, 1),
    "sub": lambda x, y: (1, -1),
    "mul": lambda x, y: (y, x),
    "div": lambda x, y: (1 / y, -x / y / y),
    "sin": lambda x: (mp.cos(x),),
    "cos": lambda x: (-mp.sin(x),),
    "sqrt": lambda x: (1 / (2 * mp.sqrt(x)),),
    "exp": lambda x: (mp.exp(x),),
    "log": lambda x: (1 / x,),
    "atan2": lambda y, x: (x / (x * x + y * y), -y / (x * x + y * y)),
    "abs": lambda x: (_sign(x),),
    "max": lambda x, y: (0, 1) if x < y else (1, 0),
    "step": lambda x: (0,),
    "choose": lambda gate, x, y: (0, 1, 0) if gate > 0 else (0, 0, 1),
}
VALUES: Mapping[str, Callable[..., Any]] = {
    **CALLS,
    "neg": lambda x: -x,
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "sin": mp.sin,
    "cos": mp.cos,
}


def exact(program: Program, inputs: Inputs) -> dict[tuple[str, int], Any]:
    """Return the outputs of a program in long arithmetic."""
    long = {name: [mp.mpf(float(x)) for x in row] for name, row in inputs.items()}
    return evaluate(program, long, lambda x: (mp.sin(x), mp.cos(x)), CALLS)


def worst_error(program: Program, inputs: Inputs, output: int, *, dtype: str = "float64", fused: bool = False) -> float:
    """Return how far roundings move an output, each as large as it may be and in the direction of its adjoint.

    Args:
        program: without a setup.
        inputs: at one point.
        output: the value.
        dtype: of the numbers.
        fused: products may be fused with sums, for some of their uses.
    """
    instructions, unit = program.instructions, UNITS[dtype]
    long = {name: [mp.mpf(float(x)) for x in row] for name, row in inputs.items()}
    values = _run(program, long, lambda index, value, args: value)
    adjoint = [mp.mpf(0)] * len(instructions)
    adjoint[output] = mp.mpf(1)
    used: list[list[tuple[int, int, Any]]] = [[] for _ in instructions]  # user, its argument, what that adds
    for index in range(len(instructions) - 1, -1, -1):
        op, args, _ = instructions[index]
        if op in SLOPES:
            for place, (arg, slope) in enumerate(zip(args, SLOPES[op](*(values[arg] for arg in args)), strict=True)):
                adjoint[arg] += adjoint[index] * slope
                used[arg].append((index, place, adjoint[index] * slope))
    direction = [_sign(x) for x in adjoint]
    left_out: set[tuple[int, int, int]] = set()  # product, user, argument: fused there
    for index, uses in enumerate(used) if fused else ():
        summed = [use for use in uses if instructions[use[0]].op in ("add", "sub")]
        if instructions[index].op != "mul" or not summed:
            continue
        fixed = adjoint[index] - sum(x for *_, x in summed)
        upper, lower = (fixed + sum(s * max(s * x, 0) for *_, x in summed) for s in (1, -1))
        direction[index] = 1 if abs(upper) >= abs(lower) else -1
        direction[index] *= 1 if (upper if direction[index] > 0 else lower) * direction[index] >= 0 else -1
        left_out |= {(index, user, place) for user, place, x in summed if x * direction[index] < 0}

    def rounded(index: int, value: Any, args: Sequence[Any]) -> Any:
        return value + direction[index] * _rounding(program, index, value, args, unit)

    moved = _run(program, long, rounded, left_out)
    return float(abs(moved[output] - values[output]))


def _rounding(program: Program, index: int, value: Any, args: Sequence[Any], unit: float) -> Any:
    """Return by how much an instruction may be off; given powers of two and zeros round nothing."""
    op, places, _ = program.instructions[index]
    given = [x for x, arg in zip(args, places, strict=True) if program.instructions[arg].op in ("const", "input")]
    if op in ("sin", "cos"):
        _, exponent = mp.frexp(value)
        return 3 * unit * mp.mpf(2) ** min(int(exponent), 0)
    if op in ("exp", "log", "atan2"):
        return 4 * unit * abs(value)
    if op == "mul" and any(abs(mp.frexp(x)[0]) == 0.5 for x in given):
        return 0
    if op in ("add", "sub") and any(x == 0 for x in args):  # given, or a product with a given 0
        return 0
    return unit * abs(value) if op in ("add", "sub", "mul", "div", "sqrt") else 0


def _run(
    program: Program,
    inputs: Inputs,
    rounded: Callable[[int, Any, Sequence[Any]], Any],
    left_out: set[tuple[int, int, int]] = frozenset(),  # type: ignore[assignment]
) -> list[Any]:
    """Return all values; ``left_out`` are products that a user reads unrounded."""
    values: list[Any] = []
    unrounded: dict[int, Any] = {}
    for index, (op, args, leaf) in enumerate(program.instructions):
        if op == "const":
            values.append(mp.mpf(leaf))
            continue
        if op == "input":
            values.append(inputs[leaf[0]][leaf[1]])
            continue
        read = [unrounded[arg] if (arg, index, place) in left_out else values[arg] for place, arg in enumerate(args)]
        value = VALUES[op](*read)
        unrounded[index] = value
        values.append(rounded(index, value, read))
    return values
