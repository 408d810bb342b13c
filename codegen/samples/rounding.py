"""States in which another order of sums and products shows: compilers that take arithmetic for algebra.

Sines and cosines tell on it at once, because their reduction to a quarter turn is a sum in a certain order.  Programs
without angles get numbers that are chosen for them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..program.ir import Program, users
from ..program.passes import summands
from .arithmetic import Arithmetic, Array

_SITES = 24  # of a program that are looked at, at most


def telling_lanes(
    programs: Sequence[Program], inputs: Mapping[str, Array], arithmetic: Arithmetic, count: int
) -> list[int]:
    """Choose lanes of inputs that show as many other orders of computing as so many can; the first if none does.

    Args:
        programs: those with angles are left out.
        inputs: arrays (size, lanes) by name.
    """
    shown = [
        x for program in programs if _is_plain(program, inputs, arithmetic) for x in _shown(program, inputs, arithmetic)
    ]
    lanes = inputs["q"].shape[1]
    open_ones = np.array(shown, np.bool_).reshape(len(shown), lanes)
    chosen: list[int] = []
    while len(chosen) < count:
        free = [lane for lane in range(lanes) if lane not in chosen]
        best = max(free, key=lambda lane: int(open_ones[:, lane].sum()))
        chosen.append(best)
        open_ones = open_ones[~open_ones[:, best]]
    return chosen


def _is_plain(program: Program, inputs: Mapping[str, Array], arithmetic: Arithmetic) -> bool:
    """Whether there are no angles, every bit is certain, and all that is read is there."""
    has_angles = any(instruction.op in ("sin", "cos") for instruction in program.instructions)
    return not has_angles and arithmetic.has_no_choice(program) and program.inputs() <= set(inputs)


def _shown(program: Program, inputs: Mapping[str, Array], arithmetic: Arithmetic) -> Iterator[NDArray[np.bool_]]:
    """Yield lanes (lanes,) in which a result changes, per place and order of computing that changes some."""
    values: list[Array] = []
    lanes = inputs["q"].shape[1]
    for op, args, leaf in program.instructions:
        if op == "input":
            value = inputs[leaf[0]][leaf[1]]
        elif op == "const":
            value = arithmetic.dtype.type(leaf)
        else:
            value = arithmetic.value(op, [values[arg] for arg in args])
        values.append(np.broadcast_to(value, (lanes,)))
    sites = list(_sites(program))
    for index, terms in sites[:: -(-len(sites) // _SITES) or 1]:
        for turned in range(1, len(terms)) if len(terms) < 4 else (1, 2):
            order = [*terms[turned:], *terms[:turned]]
            differing = _differs(program, index, _folded(program, index, order, values, arithmetic), values, arithmetic)
            if differing.any():
                yield differing


def _sites(program: Program) -> Iterator[tuple[int, list[tuple[int, int]]]]:
    """Yield sums and products of three and more, and quotients: the last value, and (sign, value) of its operands."""
    yield from ((index, terms) for index, terms in summands(program).items() if len(terms) > 2)
    count, instructions = users(program), program.instructions

    def factors(index: int) -> Iterator[int]:
        for arg in instructions[index].args:
            if instructions[arg].op == "mul" and count[arg] == 1:
                yield from factors(arg)
            else:
                yield arg

    inner = {arg for i in instructions if i.op == "mul" for arg in i.args if count[arg] == 1}
    for index, instruction in enumerate(instructions):
        if instruction.op == "mul" and index not in inner and len(product := list(factors(index))) > 2:
            yield index, [(1, factor) for factor in product]
        elif instruction.op == "div":
            yield index, [(1, arg) for arg in instruction.args]


def _folded(
    program: Program, index: int, terms: Sequence[tuple[int, int]], values: Sequence[Array], arithmetic: Arithmetic
) -> Array:
    """Compute a sum or product from left to right; a quotient, whose two come turned round, by the inverse."""
    op = program.instructions[index].op
    if op == "div":
        (_, divisor), (_, number) = terms
        inverse = arithmetic.value("div", [arithmetic.dtype.type(1.0), values[divisor]])
        quotient: Array = arithmetic.value("mul", [values[number], inverse])
        return quotient
    (sign, first), *rest = terms
    total: Array = values[first] if sign > 0 else arithmetic.value("neg", [values[first]])
    for sign, term in rest:
        total = arithmetic.value("mul" if op == "mul" else "add" if sign > 0 else "sub", [total, values[term]])
    return total


def _differs(
    program: Program, index: int, other: Array, values: Sequence[Array], arithmetic: Arithmetic
) -> NDArray[np.bool_]:
    """Return lanes (lanes,) in which a program writes other bits, if one of its values is another."""
    changed = {index: other}
    for place in range(index + 1, len(program.instructions)):
        op, args, _ = program.instructions[place]
        if not changed.keys().isdisjoint(args):
            changed[place] = arithmetic.value(op, [changed.get(arg, values[arg]) for arg in args])
    differing = np.zeros(other.shape, np.bool_)
    for place in changed.keys() & set(program.outputs.values()):
        differing |= changed[place] != values[place]
    return differing
