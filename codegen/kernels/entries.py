"""Entries of the table of kernels: arrays that it reads and writes, where its C comes from; without SymPy."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

Kind = Literal[  # in the order in which C and packages have them
    "program",  # straight-line code of one writer
    "tangent",  # straight-line code, differentiated from another kernel's; there only if it is asked for
    "adjoint",  # the same, its gradient by a reverse sweep
    "hessian",  # the same, second derivatives
    "jet",  # straight-line code, time derivatives of another kernel's; there only if they are asked for
    "frames",  # straight-line code in shares of bodies and frames, which functions of a frame's number call
    "composed",  # a template that calls programs: ``templates/composed``
    "rollout",  # the same, by another call: many steps at once
    "adaptive",  # the same, with steps whose length the error controls
    "gradient",  # the same, and back through the steps; there only if it is asked for
]
KINDS: tuple[Kind, ...] = get_args(Kind)
Need = Literal["", "loops", "springs", "elements", "constraints", "cuts", "laws", "followers", "drives", "sensors"]


DERIVED: tuple[Kind, ...] = ("jet", "tangent", "adjoint", "hessian")

MethodClass = Literal["KernelMethods", "KernelFunctions"]
Diagnosis = Literal["", "mass", "forces", "gap", "gap_rows", "gap_bias", "drives", "loop_poses", "element_rows"]


@dataclass(frozen=True)
class ArrayAxes:
    """Axes, unit and meaning of an array that kernels read or write.

    axes: lengths, or names of lengths that depend on the robot: "coordinates", "links", "loops", ...
    unit: SI units of its numbers; empty where they depend on the kernel that writes it.
    text: what it holds.
    """

    axes: tuple[str | int, ...]
    unit: str = ""
    text: str = ""


PER_COORDINATE = ("coordinates",)
PER_RATE = ("rates",)  # of coordinates, then of internal states
ARRAYS: Mapping[str, ArrayAxes] = {
    "q": ArrayAxes(PER_COORDINATE, "m or rad", "coordinates"),
    "v": ArrayAxes(PER_COORDINATE, "m/s or rad/s", "velocities of the coordinates"),
    "z": ArrayAxes(("internal_states",), "", "internal states of force laws"),
    "a": ArrayAxes(PER_COORDINATE, "m/s^2 or rad/s^2", "accelerations of the coordinates"),
    "u": ArrayAxes(
        PER_COORDINATE, "N or N m", "actuator forces, or inputs of drives with states; accelerations if prescribed"
    ),
    "forces": ArrayAxes(("drives",), "N or N m", "forces beside drives with states, on their coordinates"),
    "wrench": ArrayAxes(("links", 6), "N, N m", "external force, then moment about the centre of mass, base frame"),
    "vector": ArrayAxes(PER_COORDINATE, "", "a number per coordinate"),
    "rate_vector": ArrayAxes(
        PER_RATE,
        "",
        "a number per coordinate, then per internal state; of forces what drives these, times their inertias",
    ),
    "matrix": ArrayAxes(PER_COORDINATE * 2, "", "a matrix over the coordinates"),
    "tensor": ArrayAxes(PER_COORDINATE * 3, "", "a number per triple of coordinates"),
    "derivatives": ArrayAxes((3, *PER_RATE * 2), "", "derivatives by q, by v and z, and by a or u"),
    "momenta": ArrayAxes((2, "coordinates"), "", "generalized momentum p = M v, then C^T v"),
    "pair": ArrayAxes((2,), "J", "kinetic, then potential energy"),
    "point": ArrayAxes((3,), "m", "a point, base frame"),
    "momentum": ArrayAxes((6,), "N s, N m s", "linear, then angular momentum, base frame"),
    "pose": ArrayAxes((4, 4), "m", "homogeneous transform of a frame to the base"),
    "jacobian": ArrayAxes((6, "coordinates"), "", "linear, then angular rows, base frame"),
    "poses": ArrayAxes(("frames", 3, 4), "m", "[R | X] of each frame"),
    "jacobians": ArrayAxes(("frames", 6, "coordinates"), "", "linear, then angular rows of each frame"),
    "frame_rates": ArrayAxes(("frames", 6), "", "a linear, then an angular vector of each frame"),
    "kinematics": ArrayAxes(("kinematics",), "", "frames, origins of bodies, axes of coordinates"),
    "joints": ArrayAxes(("joints",), "", "a number per joint"),
    "reactions": ArrayAxes(("joints", 6), "N, N m", "force, then moment on each joint's child link, joint axes"),
    "regressor": ArrayAxes(("coordinates", "inertial_parameters"), "", "rows of coordinates, columns of parameters"),
    "readings": ArrayAxes(("readings",), "", "readings of the sensors"),
    "constraints": ArrayAxes(("constraints",), "", "a number per component of the constraint"),
    "constraint_rows": ArrayAxes(("constraints", "coordinates"), "", "derivatives of the constraint by q"),
    "multipliers": ArrayAxes(("constraints",), "N or N m", "multipliers of the constraint"),
    "constrained": ArrayAxes(
        ("constrained",), "", "accelerations, derivatives of internal states, multipliers, g, J v"
    ),
    "settling": ArrayAxes(("settling",), "", "changes of q and v, then g"),
    "chart": ArrayAxes(("chart",), "", "which coordinates are independent, and the factors of the others"),
    "following": ArrayAxes(("following",), "", "q, v and a on the constraint, with the factors of a chart"),
    "driving": ArrayAxes(("driving",), "", "actuator forces, multipliers, g, J v, J a, J_dot v, forces left, needed"),
    "closing": ArrayAxes(("closing",), "", "derivatives of the constraint, loop by loop"),
    "cut_poses": ArrayAxes(("loops", 4, 4), "m", "homogeneous transform of each loop joint"),
    "loop_reactions": ArrayAxes(("loops", 6), "N, N m", "force, then moment of each loop joint"),
    "law_pairs": ArrayAxes(("cut_laws", 2), "", "deviation, then resisting force"),
    "law_rows": ArrayAxes(("cut_laws", "coordinates"), "", "derivatives of deviations by q"),
    "couplings": ArrayAxes(("couplings",), "N or N m", "a force per rigid coupling"),
    "spring_pairs": ArrayAxes(("springs", 2), "m, N", "length, then tension of each spring"),
    "spring_rows": ArrayAxes(("springs", "coordinates"), "", "derivatives of lengths by q"),
    "element_pairs": ArrayAxes(("element_rows", 2), "", "value, then resisting force"),
    "element_rows": ArrayAxes(("element_rows", "coordinates"), "", "derivatives of values by q"),
    "added": ArrayAxes(("inputs",), "", "added to the diagonal of the matrix of a step"),
    "kp": ArrayAxes(("inputs",), "", "stiffness of controllers, then inputs of drives with states"),
    "kd": ArrayAxes(("inputs",), "", "damping of controllers"),
    "rates": ArrayAxes(PER_RATE, "", "velocities that a stage's matrix is multiplied by"),
    "shifts": ArrayAxes(PER_COORDINATE, "", "displacements that a stage's matrix is multiplied by"),
    "dt": ArrayAxes((2,), "s, s^2", "step and its square"),
    "times": ArrayAxes((2,), "s, s^2", "factors of damping and stiffness"),
}


JOINED: Mapping[str, str] = {"z": "v", "dz": "dv", "forces": "u", "dforces": "du"}  # arrays, and what they stand behind


@dataclass(frozen=True)
class WrenchTerm:
    """Contribution of external wrenches to what a kernel computes.

    kernel: the kernel of q and the wrenches whose result is added.
    sign: 1 or -1.
    into: the argument that it is added to, where it is not the result.
    """

    kernel: str
    sign: float = 1.0
    into: str = ""


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
    wrench: how external wrenches enter, if they do.
    tree: the kernel that computes the same for the open tree, where the robot has constraints.
    loaded: the kernel that computes the same where generalized forces u act in addition, for closed loops.
    method: class of the generated method of its name in ``runtime/kernel_methods.py``, if there is one.
    otherwise: the argument by coordinate that the method returns where no drive has internal states, if it does.
    states: whether the result depends on internal states of force laws, or its C has their places among its arguments.
    in_balances: whether energy balances of integrations call it.
    diagnosis: what error messages take from it about a state: the mass matrix, the forces of a motion of the open tree,
        the constraint violation with its Jacobian and bias, drives of closed loops, poses of loop joints, Jacobian of
        force elements; or nothing.
    derivatives: kinds of the derivatives that there are of it.
    variants: of a derivative the functions of C among which its arguments choose, by name: the order of "jet", whether
        "tangent" and "adjoint" are by parameters, too, and the order of "adjoint", whose second one is a "hessian".
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
    wrench: WrenchTerm | None = None
    tree: str = ""
    loaded: str = ""
    method: MethodClass | None = None
    otherwise: str = ""
    states: bool = False
    in_balances: bool = False
    diagnosis: Diagnosis = ""
    derivatives: tuple[Kind, ...] = DERIVED
    variants: Mapping[str, Signature] = field(default_factory=dict)

    @property
    def is_joined(self) -> bool:
        """Whether integrations call it by another function, with z behind v and forces beside drives behind u."""
        return not JOINED.keys().isdisjoint(self.reads)

    @property
    def takes(self) -> tuple[str, ...]:
        """Optional arguments behind the arrays that methods take: "wrench", "z", "cut"."""
        has = {"wrench": bool(self.wrench or self.loaded), "z": self.states, "cut": bool(self.tree)}
        return tuple(name for name, there in has.items() if there)


class KernelTable(Mapping[str, Signature]):
    """Signatures by the names of kernels; by those of the functions of C, too, among which arguments choose.

    "f_jet" is one kernel, whose argument ``order`` chooses one of "f_jet1" to "f_jet4".  It is the names of kernels
    that are iterated over and counted.

    Attributes:
        compiled: signatures of all functions of C, by their names; what builds are asked for.
    """

    def __init__(self, rows: Mapping[str, Signature]) -> None:
        self._rows = dict(rows)
        self.compiled: Mapping[str, Signature] = {
            function: signature
            for name, row in rows.items()
            for function, signature in (row.variants or {name: row}).items()
        }

    def __getitem__(self, name: str) -> Signature:
        return self._rows[name] if name in self._rows else self.compiled[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)


def kernel(form: str, text: str, kind: Kind = "program", **more: Any) -> tuple[str, Signature]:
    """Read "name(array, ...) -> array": the kernel's name and its signature, ``more`` by its fields."""
    name, reads, writes = re.split(r"\(|\) -> ", form)
    return name, Signature(tuple(reads.split(", ")), writes, text, kind, **more)


def table(*rows: tuple[str, Signature]) -> dict[str, Signature]:
    """Return signatures by their names."""
    return dict(rows)


def with_internal_states(signature: Signature, *, states: bool, drives: bool) -> Signature:
    """Return a signature for robots with internal states: z behind v where it counts, forces beside drives behind u.

    Args:
        states: whether the robot has internal states.
        drives: whether some belong to drives, whose inputs stand in u.
    """
    behind = {"v": ("z",), "dv": ("dz",)} if states and signature.states else {}
    behind |= {"u": ("forces",), "du": ("dforces",)} if drives else {}
    return replace(signature, reads=tuple(y for x in signature.reads for y in (x, *behind.get(x, ()))))
