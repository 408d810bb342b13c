"""Several states at a time, one in every lane of a vector: which kernels fit, and what repeats."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..kernels.equations import Equations
from ..kernels.signatures import BATCHES, KERNELS, PARTS, SIGNATURES, SINGLES, functions, signatures_of
from ..program.ir import GATE, Program
from .statements import handed_on, split, trig_values, workspace

PACKED, LEAST = 0.75, 100  # different numbers of a result are kept alone where they are no more, of so many at least
MANY = 4000  # statements, about 35 KB of instructions: more than a first cache holds
FEW = 512  # numbers of a state in arrays
LANE_VALUES = 8192  # values that a kernel for several states may keep on the stack: 512 KB of the longest vectors


def batched(equations: Equations) -> list[str]:
    """List kernels that work on several states at a time: public ones whose arrays fit the stack as vectors."""
    size = {key: int(np.prod(shape)) for key, shape in equations.interface["shapes"].items()}
    known = signatures_of(equations.model)
    size |= {"kept": kept_size(equations), "pair_kept": kept_size(equations, "pair_kept")}

    def values(name: str) -> int:
        signature = known[name]
        if name in equations.shares:
            between = {key for run in equations.shares[name].runs for key in run.program.outputs}
            results = [function.writes for function in signature.functions.values()]
            return len(between) + sum(size[array] for array in (*signature.reads, *results))
        arrays = sum(size[array] for array in (*signature.reads, signature.writes))
        if name in equations.programs:
            program = equations.programs[name]
            apart = trig_values(program)
            return arrays + 3 * len(apart) + workspace(handed_on(program, split(program, apart)))
        per_state = len(equations.setup.outputs) if signature.kind == "adaptive" else 0  # every state's
        if any(SIGNATURES[program].writes == "pair_kept" for program in calls_of(equations, name)):
            per_state += radau_room(equations)
        return per_state + arrays + max(values(program) for program in calls_of(equations, name))

    public = [name for name in KERNELS.compiled if name in equations.kernels and _has_lanes(equations, name)]
    return [name for name in public if values(name) <= LANE_VALUES]


def part_by_part(program: Program) -> bool:
    """Whether several vectors go through a program part by part: its instructions fill a cache, its arrays do not."""
    statements = sum(bool(instruction.args) for instruction in program.instructions)
    numbers = len(program.outputs) + sum(instruction.op == "input" for instruction in program.instructions)
    return statements >= MANY and numbers <= FEW and (GATE, 0) not in program.outputs


def _has_lanes(equations: Equations, name: str) -> bool:
    """True if there is C of the kernel for vectors: a program, or a template that is written for both."""
    known, composed = KERNELS[name], KERNELS[name].kind in ("composed", "rollout", "adaptive")
    return known.vectors and (name in equations.programs or composed or bool(known.closed))


def kept_size(equations: Equations, array: str = "kept") -> int:
    """Count numbers of an array of factors that a step hands to its stages; none where nothing is solved for."""
    factors = next(name for name, signature in PARTS.items() if signature.writes == array)
    program = equations.programs.get(factors)
    return sum(key[0] == "out" for key in program.outputs) if program else 0


def radau_room(equations: Equations) -> int:
    """Count numbers that steps of Radau IIA keep, about as ``EOM_RADAU_ROOM`` counts them."""
    n, m = equations.model.size, len(equations.model.constraints)
    return 62 * n + 15 * m + kept_size(equations) + 2 * kept_size(equations, "pair_kept")


def calls_of(equations: Equations, name: str) -> tuple[str, ...]:
    """List programs that the C of a kernel needs."""
    return equations.calls.get(name, (name,))


def functions_of_libraries(
    equations: Equations, *, batches: bool = True, scalar: bool = False
) -> dict[str, tuple[str, ...]]:
    """List the functions of the scalar and of the batch library, without the robot's name in front.

    The library "singles" has those for one state, and batches that call these state by state; "batches" has those that
    work on vectors.  Each begins with "setup", which a library of both has once.  With ``scalar`` none work on vectors.
    """
    known = functions(equations.kernels, signatures_of(equations.model))
    singles = [function.name for function in known]
    singles += [f"{x.name}_joined" for x in known if x.signature.in_balances and x.signature.is_joined]
    if not batches:
        return {SINGLES: ("setup", *singles)}
    vectors = [] if scalar else [f"{function.name}_batch" for function in functions(batched(equations))]
    alone = {function.name for function in functions(equations.kernels) if function.kind == "gradient"}
    looped = [f"{x.name}_batch" for x in known if f"{x.name}_batch" not in vectors and x.name not in alone]
    halves = {SINGLES: ("setup", *singles, *looped)}
    return halves if scalar else {**halves, BATCHES: ("setup", *vectors)}


@dataclass(frozen=True)
class Packing:
    """A program that writes each of its different results once, and for every place of "out" the result's number."""

    program: Program
    size: int
    places: tuple[int, ...]


def pack(program: Program) -> Packing | None:
    """Put a program's different results side by side; None where it has few, or nearly all are different.

    Zeros, and the half of a symmetric matrix that mirrors the other one, leave the cache to what is computed.
    """
    written = {key[1]: index for key, index in program.outputs.items() if key[0] == "out"}
    number: dict[int, int] = {}
    places = tuple(number.setdefault(written[place], len(number)) for place in sorted(written))
    if len(places) < LEAST or len(number) > PACKED * len(places):
        return None
    others = {key: index for key, index in program.outputs.items() if key[0] != "out"}
    results = {("out", place): index for index, place in number.items()}
    return Packing(replace(program, outputs={**results, **others}), len(number), places)
