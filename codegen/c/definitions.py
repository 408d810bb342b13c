"""Programs as definitions of functions of C: everything that a template writes, chosen here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ..kernels.entries import Signature
from ..program.ir import Program
from .scalar_types import Scalar
from .statements import CHUNK, NO_NAMES, NO_STOPS, Function, reads, write_function

SHARED = ("h", "p")  # arrays with one number for all states
SHORT = 300  # values per function that several vectors go through: some 3 KB of instructions


@dataclass(frozen=True)
class Definition:
    """A function of C on numbers or vectors of them.

    name: with the robot's in front.
    function: its statements.
    scalar: type of what it computes.
    linkage: "static " or nothing.
    several: name of the function that computes several vectors part by part; empty where there is none.
    signature: of its kernel; None of runs of bodies and of the setup.
    """

    name: str
    function: Function
    scalar: Scalar
    linkage: str = ""
    several: str = ""
    signature: Signature | None = None

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """Types and names of the arrays that it reads."""
        one, scalar = self.scalar.shared, self.scalar.name
        return [(one if array in SHARED else scalar, array) for array in self.function.arrays]

    @property
    def outputs(self) -> list[tuple[str, str]]:
        """Types and names of those that it writes."""
        return [(self.scalar.name, array) for array in self.function.outputs]

    @property
    def turns(self) -> str:
        """The macro of clib/lanes.h that takes sines and cosines in front, as C; empty where there are none.

        Of vectors where they stand; numbers are gathered in an array whose length fits vectors.
        """
        angles, place = self.function.angles, self.function.contiguous_angles
        if not angles:
            return ""
        if self.scalar.spread and place:
            return f"EOM_SIN_COS_AT({len(angles)}, {place})"
        return f"EOM_SIN_COS{'_LANES' if self.scalar.spread else ''}({len(angles)}, {', '.join(angles)})"

    @property
    def parts(self) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
        """Statements of each part, and the arrays that these do not read; a single one is written in place."""
        return list(zip(self.function.chunks, self.function.unused, strict=True))

    @property
    def no_angles(self) -> list[str]:
        """Arrays that the angles do not read."""
        text = "\n".join(self.function.shared + self.function.angles)
        return [array for array in self.function.arrays if not reads(text, array)]


def define(
    program: Program,
    signature: Signature,
    robot: str,
    scalar: Scalar,
    *,
    singular: str = "0",
    public: bool = False,
    form: Literal["", "packed", "several"] = "",
    names: Mapping[str, str] = NO_NAMES,
) -> Definition:
    """Define a kernel's program on numbers, or on vectors with one state in every lane if ``scalar`` is such a vector.

    Args:
        singular: the status of pivots, as C.
        form: "packed" if the program writes its different results alone, ``lanes.pack``; "several" if several vectors
            are computed part by part, too, ``lanes.part_by_part``, in shorter parts.
        names: of ``write_function``.
    """
    pivots = any(array == "pivot" for array, _ in program.outputs)
    ending, chunk = f"return {singular if pivots else 0};", SHORT if form == "several" else CHUNK
    function = write_function(program, scalar, signature, ending=ending, chunk=chunk, names=names)
    name = f"{robot}_{program.name}"
    together = f"{name}_several" if form == "several" and len(function.chunks) > 1 else ""
    name += "_packed" if form == "packed" else "_lanes" if scalar.spread else ""
    linkage = "" if public and not scalar.spread else "static "
    return Definition(name, function, scalar, linkage, together, signature)


def define_setup(program: Program, robot: str, scalar: Scalar, parameters: Sequence[str]) -> Definition:
    """Define the program that computes what depends on parameters alone, which have these names."""
    leaves = {place: program.instructions[index] for (_, place), index in program.outputs.items()}
    copied = {place: leaf.leaf[1] for place, leaf in leaves.items() if leaf.op == "input" and leaf.leaf[0] == "p"}
    names = {f"h[{place}]": parameters[i] for place, i in copied.items() if i < len(parameters)}
    return Definition(f"{robot}_setup", write_function(program, scalar, turning=False, names=names), scalar)


def define_share(program: Program, robot: str, scalar: Scalar, stops: Mapping[int, int] = NO_STOPS) -> Definition:
    """Define a run of a tree's nodes, or the angles of all of them, ``program.shares``."""
    name = f"{robot}_{program.name}{'_lanes' if scalar.spread else ''}"
    return Definition(name, write_function(program, scalar, turning=False, stops=stops), scalar, "EOM_PART ")
