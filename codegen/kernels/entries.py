"""Entries of the table of kernels: arrays that it reads and writes, where its C comes from; without SymPy."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Kind = Literal[
    "program",
    "tangent",
    "adjoint",
    "hessian",
    "jet",
    "frames",
    "composed",
    "rollout",
    "adaptive",
    "gradient",
]
KINDS: Mapping[Kind, str] = {  # in the order in which C and packages have them
    "program": "straight-line code of one writer",
    "tangent": "straight-line code, differentiated from another kernel's; there only if it is asked for",
    "adjoint": "the same, its gradient by a reverse sweep",
    "hessian": "the same, second derivatives",
    "jet": "straight-line code, time derivatives of another kernel's; there only if they are asked for",
    "frames": "straight-line code in shares of bodies and frames, which functions of a frame's number call",
    "composed": "a template that calls programs: ``templates/composed``",
    "rollout": "the same, by another call: many steps at once",
    "adaptive": "the same, with steps whose length the error controls",
    "gradient": "the same, and back through the steps; there only if it is asked for",
}
Need = Literal["", "loops", "springs", "elements", "constraints", "cuts", "laws", "followers", "drives", "sensors"]


@dataclass(frozen=True)
class Signature:
    """Arrays that a kernel reads and the one that it writes, by their names in ``shapes``, and what it computes.

    kind: where its C comes from and how it is called, one of KINDS.
    calls: the programs that its C calls, where the kind is "composed", "rollout", "adaptive" or "gradient"; of a
        composed one that stands in ``writers.VARIANTS``, too, only where none of these suits the robot.
    counts: of these the ones whose operations count as the kernel's; all if none is named.
    closed: the programs that its C calls where the robot has loops; they count, too.
    by_request: whether it is there only if it is asked for, as derivatives are.
    derivative_of: the function that it differentiates, where the kind is "tangent", "adjoint", "hessian", "jet" or
        "gradient".
    order: the highest of the time derivatives, where the kind is "jet".
    by_parameters: whether that is by run-time parameters, too, which a robot must have for it.
    functions: what users call instead of it, where the kind is "frames".
    columns_of: the program that its template calls once for every coordinate, where a program of all columns would be
        too long.
    solves: whether it inverts the mass matrix, and so fails where that is singular; the others always return 0.
    symmetric: whether it writes a matrix that is symmetric to the bit.
    needs: what a robot must have for it: "loops", "springs", "elements" (other force elements between two links),
        "constraints" (loops or couplings that are rigid in some direction), "cuts" (loops that are), "laws" (forces in
        cut joints, elastic couplings), "followers" (of rigid couplings, which are no coordinates), "drives" (that have
        states), "sensors" or nothing.
    beside: kernels that come with it where the robot has constraints: those of the open tree, of wrenches, of charts.
    mapped: whether packages say which of its entries vanish identically.
    vectors: whether its template is written for several states at a time, too; otherwise batches call it one by one.
    """

    reads: tuple[str, ...]
    writes: str
    text: str
    kind: Kind = "program"
    calls: tuple[str, ...] = ()
    counts: tuple[str, ...] = ()
    closed: tuple[str, ...] = ()
    by_request: bool = False
    derivative_of: str = ""
    order: int = 0
    by_parameters: bool = False
    functions: Mapping[str, Signature] = field(default_factory=dict)
    columns_of: str = ""
    solves: bool = False
    symmetric: bool = False
    needs: Need = ""
    beside: tuple[str, ...] = ()
    mapped: bool = False
    vectors: bool = True


def kernel(form: str, text: str, kind: Kind = "program", **more: Any) -> tuple[str, Signature]:
    """Read "name(array, ...) -> array": the kernel's name and its signature, ``more`` by its fields."""
    name, reads, writes = re.split(r"\(|\) -> ", form)
    return name, Signature(tuple(reads.split(", ")), writes, text, kind, **more)


def table(*rows: tuple[str, Signature]) -> dict[str, Signature]:
    """Return signatures by their names."""
    return dict(rows)
