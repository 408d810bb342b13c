"""Model -> Programs: one program per kernel, every intermediate bound as it arises.

``KERNELS`` is the table of what a kernel reads and writes; the functions below it say how.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from eomgen.model import Model

from .bodies import Bound, Scalar, bind
from .composite import Rows, coriolis_matrix, mass_matrix
from .forces import elastic_rows, gravity_rows
from .frames import choose_frames
from .freeze import JointGeometry, geometry
from .ir import Graph, Program, Value, finish
from .kinematics import body_poses, external_rows, frame_poses, potential_energy
from .passes import PARAMETERS, hoist_parameters, run_passes
from .recursion import inertial_rows, kinetic_energy
from .regroup import regroup
from .solve import coordinate_parents, solve
from .zeros import zero_map

STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is written out, above it is a loop in C
STRAIGHT_CHRISTOFFEL = 12000  # up to so many operations the tensor is written out, above it is a loop over columns

DESCRIPTION_FRAMES = ("reactions", "kinematics", "external_force")  # report, or are asked, in the description's frames

Outputs = dict[tuple[str, int], Value]


@dataclass(frozen=True)
class Signature:
    """Arrays that a kernel reads, by the name of their shape (see ``shapes``), and the shape that it writes."""

    reads: tuple[str, ...]
    writes: str


KERNELS: Mapping[str, Signature] = {
    "mass_matrix": Signature(("q",), "matrix"),
    "bias_force": Signature(("q", "v"), "vector"),
    "generalized_force": Signature(("q", "v"), "vector"),
    "external_force": Signature(("q", "wrench"), "vector"),
    "residual": Signature(("q", "v", "a", "u"), "vector"),
    "inverse_dynamics": Signature(("q", "v", "a"), "vector"),
    "forward_dynamics": Signature(("q", "v", "u"), "vector"),
    "coriolis_matrix": Signature(("q", "v"), "matrix"),
    "christoffel": Signature(("q",), "tensor"),
    "kinematics": Signature(("q",), "kinematics"),
    "energy": Signature(("q", "v"), "pair"),
    "reactions": Signature(("q", "v", "a"), "reactions"),
}


def shapes(model: Model) -> dict[str, tuple[int, ...]]:
    """Shape of every array that kernels read and write."""
    n = model.size
    vectors: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "v", "a", "u", "vector"), (n,))
    return {
        **vectors,
        "wrench": (len(model.links), 6),
        "matrix": (n, n),
        "tensor": (n, n, n),
        "pair": (2,),
        "reactions": (len(model.bodies), 6),
        "kinematics": (12 * len(model.frames) + 3 * len(model.bodies) + 3 * n,),
    }


@dataclass(frozen=True)
class Equations:
    """The programs of a model: ``kernels`` are those a user may call, ``programs`` what is written out in C.

    ``setup`` computes what depends on parameters alone; ``loops`` names the kernels whose C calls other kernels in a
    loop because a straight-line program would be too long, each with the reason.
    """

    model: Model
    kernels: tuple[str, ...]
    setup: Program
    programs: Mapping[str, Program]
    loops: Mapping[str, str]


def derive_equations(model: Model, kernels: Sequence[str] = ()) -> Equations:
    """Model -> Equations, with every pass run.

    Args:
        kernels: names of KERNELS; all of them if empty.
    """
    public = tuple(name for name in KERNELS if not kernels or name in kernels)
    raw: dict[str, Program] = {}
    loops: dict[str, str] = {}

    def need(*names: str) -> None:
        raw.update({name: run_passes(derive(model, name)) for name in names if name not in raw})

    for name in public:
        if name == "forward_dynamics" and model.size > STRAIGHT_SOLVE:
            need("mass_matrix", "right_side")
            loops[name] = f"{model.size} coordinates: M = L^T D L is factorised in a loop over the tree"
        elif name == "christoffel" and _columns_cost(model, raw) > STRAIGHT_CHRISTOFFEL:
            need("coriolis_matrix")
            loops[name] = f"{model.size} coordinates: one Coriolis matrix per unit velocity"
        else:
            need(name)
    setup, programs = hoist_parameters(list(raw.values()), len(model.parameters))
    return Equations(model, public, setup, dict(zip(raw, programs, strict=True)), loops)


def _columns_cost(model: Model, known: Mapping[str, Program]) -> int:
    """Operations of n Coriolis matrices: an upper bound for the written-out tensor."""
    program = known.get("coriolis_matrix") or run_passes(derive(model, "coriolis_matrix"))
    return model.size * sum(program.count().values())


def loop_operations(equations: Equations, name: str, counts: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
    """Operations of a kernel whose C is a loop over other kernels."""
    n = equations.model.size
    if name == "christoffel":
        return {key: n * number for key, number in counts["coriolis_matrix"].items()}
    parents = coordinate_parents(equations.model)
    depth = [0] * n
    for k in range(n):
        depth[k] = 0 if parents[k] < 0 else depth[parents[k]] + 1
    factor = sum(d * (d + 1) // 2 for d in depth)
    lower = sum(depth)
    solving = {"mul": factor + lower + 2 * lower + n, "add": factor + 2 * lower, "div": n, "sincos": 0}
    return {key: number + counts["mass_matrix"][key] + counts["right_side"][key] for key, number in solving.items()}


class Derivation:
    """One kernel's graph with the model's numbers, inputs and joint transforms bound in it."""

    """``regrouped``: with the frames and pseudo-inertias that cost least (``choose_frames``, ``regroup``)."""

    def __init__(self, model: Model, *, regrouped: bool = True) -> None:
        self.model, self.graph = model, Graph()
        slots = {name: slot for slot, name in enumerate(model.parameters)}

        def value(name: str, number: float) -> Scalar:
            return self.graph.input(PARAMETERS, slots[name]) if name in slots else number

        n = model.size
        self.q, self.v, self.a, self.u = ([self.graph.input(x, i) for i in range(n)] for x in "qvau")
        bound = bind(model, value, self.graph.sincos)
        self.bound: Bound = regroup(model, choose_frames(model, bound)) if regrouped else bound
        self.joints: list[JointGeometry] = geometry(model, self.bound, self.q, self.graph.sincos)
        self.still: list[Scalar] = [0.0] * n

    def dynamics(self, v: list[Any], a: list[Any]) -> list[Scalar]:
        """Inertial, gravity, spring and damper terms: the drives that the motion needs."""
        rows, _ = inertial_rows(self.model, self.bound, self.joints, v, a, self.bound.gravity, self.graph.note)
        return [row + force for row, force in zip(rows, elastic_rows(self.bound, self.q, v), strict=True)]

    def matrix(self) -> Rows:
        """Entries of M on and above the diagonal."""
        return mass_matrix(self.model, self.bound, self.joints, self.graph.note)


def derive(model: Model, kernel: str) -> Program:
    """The program of one entry of WRITERS."""
    derivation = Derivation(model, regrouped=kernel not in DESCRIPTION_FRAMES)
    return finish(derivation.graph, kernel, WRITERS[kernel](derivation))


def _vector(values: list[Scalar]) -> Outputs:
    return {("out", i): value for i, value in enumerate(values)}


def _mass_matrix(d: Derivation) -> Outputs:
    return _symmetric(d.matrix(), d.model.size)


def _symmetric(rows: Rows, n: int) -> Outputs:
    return {("out", i * n + j): rows.get((min(i, j), max(i, j)), 0.0) for i in range(n) for j in range(n)}


def _bias_force(d: Derivation) -> Outputs:
    return _vector(inertial_rows(d.model, d.bound, d.joints, d.v, d.still, (0.0, 0.0, 0.0), d.graph.note)[0])


def _generalized_force(d: Derivation) -> Outputs:
    weights = gravity_rows(d.model, d.bound, d.joints)
    springs = elastic_rows(d.bound, d.q, d.v)
    return _vector([-(weight + spring) for weight, spring in zip(weights, springs, strict=True)])


def _external_force(d: Derivation) -> Outputs:
    wrenches = [[d.graph.input("wrench", 6 * k + i) for i in range(6)] for k in range(len(d.model.links))]
    return _vector(external_rows(d.model, d.bound, d.joints, wrenches))


def _residual(d: Derivation) -> Outputs:
    return _vector([row - drive for row, drive in zip(d.dynamics(d.v, d.a), d.u, strict=True)])


def _inverse_dynamics(d: Derivation) -> Outputs:
    return _vector(d.dynamics(d.v, d.a))


def _right_hand_side(d: Derivation) -> list[Scalar]:
    return [drive - row for row, drive in zip(d.dynamics(d.v, d.still), d.u, strict=True)]


def _right_side(d: Derivation) -> Outputs:
    """u minus everything but M a: what forward dynamics solves for, when it solves in a loop."""
    return _vector(_right_hand_side(d))


def _forward_dynamics(d: Derivation) -> Outputs:
    right = _right_hand_side(d)
    matrix = d.matrix()
    acceleration, pivots = solve(d.model, matrix, right)
    outputs = _vector(acceleration)
    for i, pivot in enumerate(pivots):
        outputs["pivot", 2 * i] = pivot
        outputs["pivot", 2 * i + 1] = matrix[i, i]
    return outputs


def _coriolis(d: Derivation, v: list[Any]) -> list[Scalar]:
    entries, n = coriolis_matrix(d.model, d.bound, d.joints, v, d.graph.note), d.model.size
    return [entries.get((i, j), 0.0) for i in range(n) for j in range(n)]


def _coriolis_matrix(d: Derivation) -> Outputs:
    return _vector(_coriolis(d, d.v))


def _christoffel(d: Derivation) -> Outputs:
    """Column by column: C at unit velocities, so that zeros fold and the rest is shared.

    What vanishes only by an identity (C_i,ji = 0, say) would be left as round-off; the zero map knows it.
    """
    n = d.model.size
    survives = zero_map(d.model).christoffel.mask.reshape(n * n, n)
    outputs: Outputs = {}
    for k in range(n):
        velocity = [float(i == k) for i in range(n)]
        for ij, value in enumerate(_coriolis(d, velocity)):
            outputs["out", ij * n + k] = value if survives[ij, k] else 0.0
    return dict(sorted(outputs.items()))


def _kinematics(d: Derivation) -> Outputs:
    """Frames as rows of [R | X], then the bodies' origins, then the coordinates' axes."""
    bodies, axes = body_poses(d.model, d.joints)
    values: list[Scalar] = []
    for pose in frame_poses(d.model, d.bound, bodies):
        for row, x in zip(pose.rotation, pose.origin, strict=True):
            values.extend((*row, x))
    for pose in bodies:
        values.extend(pose.origin)
    for axis in axes:
        values.extend(axis)
    return _vector(values)


def _energy(d: Derivation) -> Outputs:
    kinetic = kinetic_energy(d.model, d.bound, d.joints, d.v)
    return _vector([kinetic, potential_energy(d.model, d.bound, d.joints, d.q)])


def _reactions(d: Derivation) -> Outputs:
    _, total = inertial_rows(d.model, d.bound, d.joints, d.v, d.a, d.bound.gravity, d.graph.note)
    return _vector([x for wrench in total for x in (*wrench.force, *wrench.moment)])


WRITERS: Mapping[str, Callable[[Derivation], Outputs]] = {
    "mass_matrix": _mass_matrix,
    "bias_force": _bias_force,
    "generalized_force": _generalized_force,
    "external_force": _external_force,
    "residual": _residual,
    "inverse_dynamics": _inverse_dynamics,
    "forward_dynamics": _forward_dynamics,
    "coriolis_matrix": _coriolis_matrix,
    "christoffel": _christoffel,
    "kinematics": _kinematics,
    "energy": _energy,
    "reactions": _reactions,
    "right_side": _right_side,
}
