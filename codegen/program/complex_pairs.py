"""A program of real numbers as one of complex numbers, pairs of real ones; what depends on none of them is single."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from .ir import Graph, Instruction, Program, Value, finish

Pair = tuple[Value, Value | None]  # real and imaginary part, None where that is none


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
    graph = Graph()
    pairs: list[Pair] = []
    for index, instruction in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        pairs.append(_pair(graph, program.name, instruction, [pairs[arg] for arg in instruction.args], inputs))
    outputs: dict[tuple[str, int], Value] = {}
    kept = {key: pairs[index] for key, index in program.outputs.items() if key[0] not in dropped}
    lengths: dict[str, int] = {}
    for (array, _), (_, imaginary) in kept.items():
        if imaginary is not None or array in results:
            lengths[array] = 1 + max(place for name, place in kept if name == array)
    for (array, place), (real, imaginary) in kept.items():
        outputs[array, place] = real
        if array in lengths:
            outputs[array, lengths[array] + place] = 0.0 if imaginary is None else imaginary
    return finish(graph, program.name, outputs)


def _pair(graph: Graph, name: str, instruction: Instruction, args: list[Pair], inputs: Mapping[str, int]) -> Pair:
    """Write an instruction on pairs of its arguments' values."""
    op, _, leaf = instruction
    if op == "input":
        array, place = leaf
        real = graph.input(array, place)
        return real, graph.input(array, inputs[array] + place) if array in inputs else None
    if op == "const":
        return graph.constant(leaf), None
    if all(imaginary is None for _, imaginary in args):
        return _single(graph, op, [real for real, _ in args]), None
    known = op in _PAIRS and (op != "choose" or args[0][1] is None)
    assert known, f"{name}: {op} of a complex number is not defined"
    return _PAIRS[op](graph, *args)


def _single(graph: Graph, op: str, args: list[Value]) -> Value:
    """Write an operation on real numbers."""
    if op in ("sin", "cos"):
        return graph.sincos(args[0])[op == "cos"]
    plain: Mapping[str, Callable[..., Value]] = {
        "neg": graph.neg,
        "add": graph.add,
        "sub": graph.sub,
        "mul": graph.mul,
        "div": graph.div,
        "choose": graph.choose,
    }
    return plain[op](*args) if op in plain else graph.call(op, *args)


def _neg(graph: Graph, x: Pair) -> Pair:
    return graph.neg(x[0]), None if x[1] is None else graph.neg(x[1])


def _add(graph: Graph, x: Pair, y: Pair) -> Pair:
    imaginary = y[1] if x[1] is None else x[1] if y[1] is None else graph.add(x[1], y[1])
    return graph.add(x[0], y[0]), imaginary


def _sub(graph: Graph, x: Pair, y: Pair) -> Pair:
    if y[1] is None:
        return graph.sub(x[0], y[0]), x[1]
    return graph.sub(x[0], y[0]), graph.neg(y[1]) if x[1] is None else graph.sub(x[1], y[1])


def _mul(graph: Graph, x: Pair, y: Pair) -> Pair:
    if x[1] is None:
        x, y = y, x
    assert x[1] is not None
    if y[1] is None:
        return graph.mul(x[0], y[0]), graph.mul(x[1], y[0])
    real = graph.sub(graph.mul(x[0], y[0]), graph.mul(x[1], y[1]))
    return real, graph.add(graph.mul(x[0], y[1]), graph.mul(x[1], y[0]))


def _div(graph: Graph, x: Pair, y: Pair) -> Pair:
    """Divide x by y with one division of real numbers, by the sum of the squares of both of y's numbers."""
    if y[1] is None:
        inverse = graph.div(1.0, y[0])
        assert x[1] is not None
        return graph.mul(x[0], inverse), graph.mul(x[1], inverse)
    share = graph.div(1.0, graph.add(graph.mul(y[0], y[0]), graph.mul(y[1], y[1])))
    return _mul(graph, x, (graph.mul(y[0], share), graph.neg(graph.mul(y[1], share))))


def _choose(graph: Graph, gate: Pair, x: Pair, y: Pair) -> Pair:
    imaginary = graph.choose(gate[0], 0.0 if x[1] is None else x[1], 0.0 if y[1] is None else y[1])
    return graph.choose(gate[0], x[0], y[0]), imaginary


_PAIRS: Mapping[str, Callable[..., Pair]] = {
    "neg": _neg,
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "choose": _choose,
}
