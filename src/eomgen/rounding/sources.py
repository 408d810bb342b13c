"""Sources of rounding errors, in the words of a description: sines of coordinates, masses, springs.

Every number of the description is taken as a parameter.  An instruction's part of a bound is then counted to the
parameters that it depends on alone and to those that it is multiplied by, its own factor and the first one on its way
to the outputs; or to the angle whose sine it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..codegen.program.ir import Program
from ..names import parameter_path
from ..robot.model import Model
from ..robot.parameter_names import expand_tunable, parameters
from ..robot.value import Robot
from .intervals import Array

CONSTANTS, ARITHMETIC = "placements and other constants", "rotations and sums of motions"
_PLACED = ("placement", "placements", "offset", "points", "frames")  # numbers that stay constants
_NAMED = 3  # parameters that one source names


def with_parameters(robot: Robot) -> Robot:
    """Return the robot with its masses, springs and other numbers as parameters, but for placements and zeros."""
    values = robot.numbers()
    names = {name for name, value in values if value}
    wanted = [item for item in parameters(robot) if item.is_set and not set(_PLACED) & {item.path[0], *item.path[2:3]}]
    patterns = [name for item in wanted if (name := ".".join(item.path)) in names]
    return replace(robot, tunable=tuple(dict.fromkeys((*robot.tunable, *expand_tunable(robot, patterns)))))


def shares(model: Model, program: Program, parts: Array) -> dict[str, float]:
    """Return the sources of an output's bound with their parts in it, 0 to 1, the largest first.

    Args:
        model: of ``with_parameters``.
        program: of the kernel, from the parameters on.
        parts: (instructions,), what each adds to the bound.
    """
    names = tuple(model.parameters)
    reads, moves = _dependencies(program)
    factors = _factors(program, reads, moves)
    total = float(parts.sum()) or 1.0
    found: dict[str, float] = {}
    for index, part in enumerate(parts):
        if part > 0.0:
            source = _source(model, names, program, index, reads[index], moves[index], factors[index])
            found[source] = found.get(source, 0.0) + float(part) / total
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _dependencies(program: Program) -> tuple[list[frozenset[int]], list[frozenset[tuple[str, int]]]]:
    """Return per value the places of parameters that it depends on, and the inputs that are none."""
    reads: list[frozenset[int]] = []
    moves: list[frozenset[tuple[str, int]]] = []
    for op, args, leaf in program.instructions:
        if op == "input" and leaf[0] == "p":
            reads.append(frozenset((leaf[1],)))
            moves.append(frozenset())
        elif op == "input":
            reads.append(frozenset())
            moves.append(frozenset((leaf,)))
        else:
            reads.append(frozenset().union(*(reads[arg] for arg in args)))
            moves.append(frozenset().union(*(moves[arg] for arg in args)))
    return reads, moves


def _factors(
    program: Program, reads: Sequence[frozenset[int]], moves: Sequence[frozenset[tuple[str, int]]]
) -> list[frozenset[int]]:
    """Return per value the parameters of its own factor without states, and of the first that it is multiplied by."""
    own: list[frozenset[int]] = []
    for op, args, _ in program.instructions:
        alone = [reads[arg] for arg in args if reads[arg] and not moves[arg]] if op in ("mul", "div") else []
        own.append(alone[0] if len(alone) == 1 else frozenset())
    behind: list[frozenset[int]] = [frozenset()] * len(program.instructions)
    for index in range(len(program.instructions) - 1, -1, -1):
        for arg in program.instructions[index].args:
            is_factor = not moves[arg] and reads[arg] == own[index]
            behind[arg] = behind[arg] or (behind[index] if is_factor else own[index] or behind[index])
    return [one | other for one, other in zip(own, behind, strict=True)]


def _source(
    model: Model,
    names: Sequence[str],
    program: Program,
    index: int,
    reads: frozenset[int],
    moves: frozenset[tuple[str, int]],
    factor: frozenset[int],
) -> str:
    """Name what an instruction's rounding comes from."""
    op = program.instructions[index].op
    if op in ("sin", "cos") and moves:
        angles = sorted({place for array, place in moves if array == "q"})
        return f"sine and cosine of {' and '.join(model.coordinates[place] for place in angles)}"
    used = reads | factor if not moves else factor
    named = _named([names[place] for place in sorted(used) if place < len(names)])
    return named or (ARITHMETIC if moves else CONSTANTS)


def _named(names: Sequence[str]) -> str:
    """Name parameters: forces one by one, masses and inertias by their links, many by their number."""
    links = list(dict.fromkeys(path[1] for name in names if (path := parameter_path(name))[0] == "links"))
    forces = [name for name in names if parameter_path(name)[0] != "links"]
    parts = []
    if forces:
        parts.append(_few(forces, "numbers of forces"))
    if links:
        parts.append(f"{_few(links, 'links')}: mass and inertia")
    return ", ".join(parts)


def _few(names: Sequence[str], kind: str) -> str:
    return ", ".join(names) if len(names) <= _NAMED else f"{names[0]} to {names[-1]} ({len(names)} {kind})"
