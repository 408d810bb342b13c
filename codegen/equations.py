"""Model -> Programs: one program per kernel, every intermediate bound as it arises.

``KERNELS`` is the table of what a kernel reads and writes; the functions below it say how.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from .recursion import inertial_rows, kinetic_energy
from .regroup import regroup
from .solve import solve

PARAMETERS = "p"
STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is written out, above it is a loop in C
STRAIGHT_CHRISTOFFEL = 6000  # up to so many operations the tensor is written out, above it is a loop over columns

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
    vectors = {name: (n,) for name in ("q", "v", "a", "u", "vector")}
    return {
        **vectors,
        "wrench": (len(model.links), 6),
        "matrix": (n, n),
        "tensor": (n, n, n),
        "pair": (2,),
        "reactions": (len(model.bodies), 6),
        "kinematics": (12 * len(model.frames) + 3 * len(model.bodies) + 3 * n,),
    }


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
        rows, _ = inertial_rows(self.model, self.bound, self.joints, v, a, self.bound.gravity)
        return [row + force for row, force in zip(rows, elastic_rows(self.bound, self.q, v), strict=True)]

    def matrix(self) -> Rows:
        """Entries of M on and above the diagonal."""
        return mass_matrix(self.model, self.bound, self.joints)


def derive(model: Model, kernel: str) -> Program:
    """The program of one kernel of KERNELS.

    Forward dynamics of more than STRAIGHT_SOLVE coordinates and large Christoffel tensors have no program of their
    own: their templates call other kernels in a loop (see ``loops``).
    """
    derivation = Derivation(model, regrouped=kernel not in DESCRIPTION_FRAMES)
    return finish(derivation.graph, kernel, _WRITERS[kernel](derivation))


def _vector(values: list[Scalar]) -> Outputs:
    return {("out", i): value for i, value in enumerate(values)}


def _mass_matrix(d: Derivation) -> Outputs:
    return _symmetric(d.matrix(), d.model.size)


def _symmetric(rows: Rows, n: int) -> Outputs:
    return {("out", i * n + j): rows.get((min(i, j), max(i, j)), 0.0) for i in range(n) for j in range(n)}


def _bias_force(d: Derivation) -> Outputs:
    return _vector(inertial_rows(d.model, d.bound, d.joints, d.v, d.still, (0.0, 0.0, 0.0))[0])


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


def _forward_dynamics(d: Derivation) -> Outputs:
    right = [drive - row for row, drive in zip(d.dynamics(d.v, d.still), d.u, strict=True)]
    matrix = d.matrix()
    acceleration, pivots = solve(d.model, matrix, right)
    outputs = _vector(acceleration)
    for i, pivot in enumerate(pivots):
        outputs["pivot", 2 * i] = pivot
        outputs["pivot", 2 * i + 1] = matrix[i, i]
    return outputs


def _coriolis(d: Derivation, v: list[Any]) -> list[Scalar]:
    entries, n = coriolis_matrix(d.model, d.bound, d.joints, v), d.model.size
    return [entries.get((i, j), 0.0) for i in range(n) for j in range(n)]


def _coriolis_matrix(d: Derivation) -> Outputs:
    return _vector(_coriolis(d, d.v))


def _christoffel(d: Derivation) -> Outputs:
    """Column by column: C at unit velocities, so that zeros fold and the rest is shared."""
    n = d.model.size
    outputs: Outputs = {}
    for k in range(n):
        velocity = [float(i == k) for i in range(n)]
        for ij, value in enumerate(_coriolis(d, velocity)):
            outputs["out", ij * n + k] = value
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
    _, total = inertial_rows(d.model, d.bound, d.joints, d.v, d.a, d.bound.gravity)
    return _vector([x for wrench in total for x in (*wrench.force, *wrench.moment)])


_WRITERS: Mapping[str, Callable[[Derivation], Outputs]] = {
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
}
