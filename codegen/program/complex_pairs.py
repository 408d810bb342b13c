"""A program of real numbers as one of complex numbers, pairs of real ones; what depends on none of them is single."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from .ir import Graph, Instruction, Program, Value, finish


@dataclass(frozen=True)
class Pair:
    """A complex number, with the operators of arithmetic; the imaginary part is None where there is none."""

    real: Value
    imaginary: Value | None = None

    def __neg__(self) -> Pair:
        return Pair(-self.real, None if self.imaginary is None else -self.imaginary)

    def __add__(self, other: Pair) -> Pair:
        x, y = self.imaginary, other.imaginary
        imaginary = y if x is None else x if y is None else x + y
        return Pair(self.real + other.real, imaginary)

    def __sub__(self, other: Pair) -> Pair:
        x, y = self.imaginary, other.imaginary
        return Pair(self.real - other.real, x if y is None else -y if x is None else x - y)

    def __mul__(self, other: Pair) -> Pair:
        x, y = (other, self) if self.imaginary is None else (self, other)
        if x.imaginary is None:
            return Pair(x.real * y.real)
        if y.imaginary is None:
            return Pair(x.real * y.real, x.imaginary * y.real)
        real = x.real * y.real - x.imaginary * y.imaginary
        return Pair(real, x.real * y.imaginary + x.imaginary * y.real)

    def __truediv__(self, other: Pair) -> Pair:
        """Divide with one division of real numbers, by the sum of the squares of both of the divisor's numbers."""
        if other.imaginary is None:
            return self * Pair(1.0 / other.real)
        share = 1.0 / (other.real * other.real + other.imaginary * other.imaginary)
        return self * Pair(other.real * share, -(other.imaginary * share))


def on_pairs(
    program: Program, inputs: Mapping[str, int], dropped: Collection[str] = (), results: Collection[str] = ()
) -> Program:
    """Write a program of real numbers as one of complex numbers.

    Args:
        inputs: arrays that become complex, with their lengths: number i of one has its real part in place i and its
            imaginary part in place length + i.
        dropped: arrays of results that are left out.
        results: arrays of results that are complex whatever they depend on.

    Returns:
        The program: an array of results that is complex, as all are of which a number depends on complex ones, has,
        behind its real parts, as many imaginary parts; other results are single, as they were.

    Raises:
        AssertionError: an operation that has no meaning on complex numbers comes to one, as a comparison does.
    """
    graph = Graph(program.operations)
    pairs: list[Pair] = []
    for index, instruction in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        pairs.append(_pair(graph, program.name, instruction, [pairs[arg] for arg in instruction.args], inputs))
    outputs: dict[tuple[str, int], Value] = {}
    kept = {key: pairs[index] for key, index in program.outputs.items() if key[0] not in dropped}
    lengths: dict[str, int] = {}
    for (array, _), pair in kept.items():
        if pair.imaginary is not None or array in results:
            lengths[array] = 1 + max(place for name, place in kept if name == array)
    for (array, place), pair in kept.items():
        outputs[array, place] = pair.real
        if array in lengths:
            outputs[array, lengths[array] + place] = 0.0 if pair.imaginary is None else pair.imaginary
    return finish(graph, program.name, outputs)


def _pair(graph: Graph, name: str, instruction: Instruction, args: list[Pair], inputs: Mapping[str, int]) -> Pair:
    """Write an instruction on pairs of its arguments' values."""
    op, _, leaf = instruction
    if op == "input":
        array, place = leaf
        real = graph.input(array, place)
        return Pair(real, graph.input(array, inputs[array] + place) if array in inputs else None)
    if op == "const":
        return Pair(graph.constant(leaf))
    if all(x.imaginary is None for x in args):
        return Pair(graph.call(op, *(x.real for x in args)))
    operation = graph.operations[op]
    if op == "choose" and args[0].imaginary is None:
        gate, *both = args
        imaginary = graph.choose(gate.real, *(0.0 if x.imaginary is None else x.imaginary for x in both))
        return Pair(graph.choose(gate.real, *(x.real for x in both)), imaginary)
    assert operation.is_arithmetic, f"{name}: {op} of a complex number is not defined"
    assert operation.value is not None
    value: Pair = operation.value(*args)
    return value
