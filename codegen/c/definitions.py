"""Programs as definitions of functions of C: everything that a template writes, chosen here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..kernels.signatures import SIGNATURES
from ..program.ir import Program
from .scalar_types import Scalar
from .statements import CHUNK, NO_STOPS, Function, reads, write_function

SHARED = ("h", "p")  # arrays with one number for all states
SHORT = 300  # values per function that several vectors go through: some 3 KB of instructions


@dataclass(frozen=True)
class Definition:
    """A function of C.

    name: with the robot's in front.
    text: what it computes.
    linkage: "static " or nothing.
    inputs: types and names of the arrays that it reads.
    outputs: types and names of those that it writes.
    turns: the macro of clib/lanes.h that takes sines and cosines in front, as C; empty where there are none.
    parts: each one's statements, and the arrays that these do not read; a single one is written in place.
    workspace: numbers that parts hand on.
    has_pivots: whether it has a pivot for every coordinate, which says whether the mass matrix can be inverted.
    gated: the first one that is left out where the gate is shut; None if there is no gate, or a single one.
    has_gate: whether it has a gate.
    several: name of the function that computes several vectors part by part; empty where there is none.
    writes: the array of its result.
    shared: statements of values that angles use more than once.
    angles: those whose sines and cosines are taken in front.
    no_angles: arrays that these do not read.
    """

    name: str
    text: str
    linkage: str
    inputs: tuple[tuple[str, str], ...]
    outputs: tuple[tuple[str, str], ...]
    turns: str
    parts: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    workspace: int
    has_pivots: bool
    gated: int | None = None
    has_gate: bool = False
    several: str = ""
    writes: str = ""
    shared: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    no_angles: tuple[str, ...] = ()


def define(
    program: Program,
    robot: str,
    scalar: Scalar,
    *,
    singular: str = "0",
    public: bool = False,
    packed: bool = False,
    several: bool = False,
) -> Definition:
    """Define a kernel's program on numbers, or on vectors with one state in every lane if ``scalar`` is such a vector.

    Args:
        singular: the status of pivots, as C.
        packed: whether the program writes its different results alone, ``lanes.pack``.
        several: whether several vectors are computed part by part, too, ``lanes.part_by_part``, in shorter parts.
    """
    lanes = scalar.spread
    pivots = any(array == "pivot" for array, _ in program.outputs)
    ending, chunk = f"return {singular if pivots else 0};", SHORT if several else CHUNK
    function = write_function(program, scalar, ending=ending, chunk=chunk)
    name = f"{robot}_{program.name}{'_packed' if packed else '_lanes' if lanes else ''}"
    definition = _definition(
        function, name, scalar, _turns(function, scalar), "" if public and not lanes else "static "
    )
    if not several or len(function.chunks) == 1:
        return definition
    text = "\n".join(function.shared + function.angles)
    return replace(
        definition,
        several=f"{robot}_{program.name}_several",
        writes=SIGNATURES[program.name].writes,
        angles=function.angles,
        no_angles=tuple(array for array in function.arrays if not reads(text, array)),
    )


def define_setup(program: Program, robot: str, scalar: Scalar) -> Definition:
    """Define the program that computes what depends on parameters alone."""
    return _definition(write_function(program, scalar, turning=False), f"{robot}_setup", scalar, "", "")


def define_share(program: Program, robot: str, scalar: Scalar, stops: Mapping[int, int] = NO_STOPS) -> Definition:
    """Define a run of a tree's nodes, or the angles of all of them, ``program.shares``."""
    name = f"{robot}_{program.name}{'_lanes' if scalar.spread else ''}"
    function = write_function(program, scalar, turning=False, stops=stops)
    return _definition(function, name, scalar, "", "EOM_PART ")


def _definition(function: Function, name: str, scalar: Scalar, turns: str, linkage: str) -> Definition:
    one = scalar.shared
    signature = SIGNATURES.get(function.name)
    return Definition(
        name,
        "" if signature is None else signature.text,
        linkage,
        tuple((one if array in SHARED else scalar.name, array) for array in function.arrays),
        tuple((scalar.name, array) for array in function.outputs),
        turns,
        tuple(zip(function.chunks, function.unused, strict=True)),
        function.workspace,
        "pivot" in function.outputs,
        function.gated,
        "gate" in function.outputs,
        shared=function.shared,
    )


def _turns(function: Function, scalar: Scalar) -> str:
    """Take sines of vectors where they stand; gather numbers in an array whose length fits vectors."""
    count, place = len(function.angles), function.contiguous_angles
    if not count:
        return ""
    if scalar.spread and place:
        return f"TURN_AT({count}, {place})"
    return f"TURN{'_LANES' if scalar.spread else ''}({count}, {', '.join(function.angles)})"
