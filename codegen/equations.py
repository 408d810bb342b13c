"""Model -> Equations: one program per kernel, every intermediate bound as it arises."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eomgen.errors import InputError
from eomgen.model import Model, with_offset_angles

from .bodies import Bound, Scalar, bind
from .composite import Rows, coriolis_matrix, mass_matrix
from .constraints import Closure, closures
from .derivatives import residual_derivatives
from .elimination import Elimination
from .forces import effects, gravity_rows, resisting_rows, resisting_slopes, stretches
from .frames import choose_frames
from .freeze import JointGeometry, geometry
from .functions import Functions
from .ir import Graph, Program, Value, finish
from .kinematics import body_poses, external_rows, frame_poses, potential_energy
from .passes import PARAMETERS, hoist_parameters, run_passes
from .recursion import Wrench, inertial_rows, kinetic_energy
from .regroup import regroup
from .rotors import Rotors
from .signatures import KERNELS, LOOP_KERNELS, SPRING_KERNELS, available
from .solve import solve
from .springs import Along, Line, add_derivatives, lines
from .zeros import zero_map

STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is tried beside the elimination
FACTORISED = "M = L^T D L factorised"
DIVISION = 8  # a division takes about as long as so many products
STRAIGHT_CHRISTOFFEL = 12000  # up to so many operations the tensor is written out, above it is a loop over columns

DESCRIPTION_FRAMES = (
    "reactions",
    "kinematics",
    "external_force",
    "external_reactions",
    *LOOP_KERNELS,
)  # report, or are asked, in the description's frames

Outputs = dict[tuple[str, int], Value]


@dataclass(frozen=True)
class Equations:
    """The programs of a model: ``kernels`` are those a user may call, ``programs`` what is written out in C.

    ``setup`` computes what depends on parameters alone; ``loops`` names the kernels whose C calls another kernel in a
    loop, because a straight-line program would be too long; ``choices`` says which way was taken where there are two.
    """

    model: Model
    kernels: tuple[str, ...]
    setup: Program
    programs: Mapping[str, Program]
    loops: frozenset[str]
    choices: Mapping[str, str]


def derive_equations(model: Model, kernels: Sequence[str] = ()) -> Equations:
    """Model -> Equations, with every pass run.

    Args:
        kernels: names of KERNELS; all that there are for the model if empty.  Those of springs between points come
            with any: they are small, and integrations choose method and step by them.

    Raises:
        InputError: a kernel of loops or springs is asked for, but the robot has none.
    """
    known = available(model)
    for name in kernels:
        if name not in known:
            what = "springs" if name in SPRING_KERNELS else "loops"
            raise InputError(f"kernels: {name!r} is for robots with [[{what}]], and {model.name} has none")
    public = tuple(name for name in known if not kernels or name in kernels or name in SPRING_KERNELS)
    raw: dict[str, Program] = {}
    loops: set[str] = set()
    choices: dict[str, str] = {}

    def need(*names: str) -> None:
        for name in names:
            if name in raw:
                continue
            if name == "forward_dynamics":
                raw[name], choices[name] = derive_forward_dynamics(model)
            else:
                raw[name] = derive(model, name)

    for name in public:
        if KERNELS[name].calls:
            need(*KERNELS[name].calls)
            loops.add(name)
        elif name == "christoffel" and _columns_cost(model, raw) > STRAIGHT_CHRISTOFFEL:
            need("coriolis_matrix")
            loops.add(name)
            choices[name] = "a loop in C, one Coriolis matrix per unit velocity"
        else:
            need(name)
    setup, programs = hoist_parameters(list(raw.values()), len(model.parameters))
    return Equations(model, public, setup, dict(zip(raw, programs, strict=True)), frozenset(loops), choices)


def _columns_cost(model: Model, known: Mapping[str, Program]) -> int:
    """Operations of n Coriolis matrices: an upper bound for the written-out tensor."""
    program = known.get("coriolis_matrix") or derive(model, "coriolis_matrix")
    return model.size * sum(program.count().values())


class Derivation:
    """One kernel's graph with the model's numbers, inputs and joint transforms bound in it.

    ``regrouped``: with the frames and pseudo-inertias that cost least (``choose_frames``, ``regroup``).

    An angle that is not active but has an offset is a coordinate here whose q, v and a are zero; ``own`` are the places
    of the coordinates that kernels know, and what is written leaves the others out.
    """

    def __init__(self, model: Model, *, regrouped: bool = True) -> None:
        self.graph = Graph()
        self.model, self.own = with_offset_angles(model)
        slots = {name: slot for slot, name in enumerate(model.parameters)}

        def value(name: str, number: float) -> Scalar:
            return self.graph.input(PARAMETERS, slots[name]) if name in slots else number

        self.q, self.v, self.a, self.u = (self._inputs(name) for name in "qvau")
        bound = bind(self.model, value, self.graph.sincos)
        self.bound: Bound = regroup(self.model, choose_frames(self.model, bound)) if regrouped else bound
        self.joints: list[JointGeometry] = geometry(self.model, self.bound, self.q, self.graph.sincos)
        self.still: list[Scalar] = [0.0] * self.model.size
        self.functions = Functions.of(self.graph)

    def _inputs(self, name: str) -> list[Scalar]:
        found: list[Scalar] = [0.0] * self.model.size
        for place, index in enumerate(self.own):
            found[index] = self.graph.input(name, place)
        return found

    def vector(self, values: Sequence[Scalar]) -> Outputs:
        """A value per coordinate."""
        return _vector([values[i] for i in self.own])

    def matrices(self, *blocks: Rows) -> Outputs:
        """Matrices over the coordinates, one after the other; an absent entry is zero."""
        return _vector([rows.get((i, j), 0.0) for rows in blocks for i in self.own for j in self.own])

    def dynamics(self, v: list[Any], a: list[Any]) -> list[Scalar]:
        """Inertial, gravity, spring and damper terms: the drives that the motion needs."""
        rows, _ = inertial_rows(self.model, self.bound, self.joints, v, a, self.bound.gravity, self.graph.note)
        return [row + force for row, force in zip(rows, self.forces(v), strict=True)]

    def resisting(self, q: list[Any], v: list[Any]) -> list[Scalar]:
        """What springs, dampers and other forces of the coordinates themselves take from the drives."""
        return resisting_rows(self.bound, q, v, self.functions)

    def lines(self, v: list[Any]) -> list[Line]:
        """Springs between two points, where q is and at the rates v."""
        return list(lines(self.model, self.bound, self.joints, v, self.functions, self.graph.note))

    def forces(self, v: list[Any]) -> list[Scalar]:
        """What all springs and dampers take from the drives."""
        rows = self.resisting(self.q, v)
        for line in self.lines(v):
            ratio = line.pull().ratio
            for index, value in line.g.items():
                rows[index] = rows[index] + ratio * value
        return rows

    def matrix(self) -> Rows:
        """Entries of M on and above the diagonal."""
        return mass_matrix(self.model, self.bound, self.joints, self.graph.note)


def derive(model: Model, kernel: str) -> Program:
    """The program of one entry of WRITERS, or of forward dynamics by the solver that costs least."""
    if kernel == "forward_dynamics":
        return derive_forward_dynamics(model)[0]
    derivation = Derivation(model, regrouped=kernel not in DESCRIPTION_FRAMES)
    return run_passes(finish(derivation.graph, kernel, WRITERS[kernel](derivation)))


def derive_forward_dynamics(model: Model, solver: str = "") -> tuple[Program, str]:
    """The program of forward dynamics, and the name of its solver in SOLVERS.

    Args:
        solver: which one; the one that costs least if empty.
    """
    candidates = []
    for name, write in SOLVERS.items():
        derivation = Derivation(model)
        if name == FACTORISED and (derivation.model.prescribed or (not solver and model.size > STRAIGHT_SOLVE)):
            continue  # M would have to be divided by what is known; or its program would be long
        if solver in ("", name):
            program = run_passes(finish(derivation.graph, "forward_dynamics", write(derivation)))
            candidates.append((program, name))
    return min(candidates, key=lambda candidate: _cost(candidate[0]))


def _cost(program: Program) -> int:
    """Operations, a division as DIVISION of them."""
    count = program.count()
    return count["mul"] + count["add"] + DIVISION * count["div"]


def _vector(values: list[Scalar]) -> Outputs:
    return {("out", i): value for i, value in enumerate(values)}


def _mass_matrix(d: Derivation) -> Outputs:
    upper = d.matrix()
    return d.matrices({**upper, **{(j, i): value for (i, j), value in upper.items()}})


def _bias_force(d: Derivation) -> Outputs:
    return d.vector(inertial_rows(d.model, d.bound, d.joints, d.v, d.still, (0.0, 0.0, 0.0), d.graph.note)[0])


def _generalized_force(d: Derivation) -> Outputs:
    weights = gravity_rows(d.model, d.bound, d.joints)
    springs = d.forces(d.v)
    return d.vector([-(weight + spring) for weight, spring in zip(weights, springs, strict=True)])


def _external_force(d: Derivation) -> Outputs:
    return d.vector(_external(d)[0])


def _external_reactions(d: Derivation) -> Outputs:
    return _vector([-x for wrench in _external(d)[1] for x in (*wrench.force, *wrench.moment)])


def _external(d: Derivation) -> tuple[list[Scalar], list[Wrench]]:
    wrenches = [[d.graph.input("wrench", 6 * k + i) for i in range(6)] for k in range(len(d.model.links))]
    return external_rows(d.model, d.bound, d.joints, wrenches)


def _residual(d: Derivation) -> Outputs:
    return d.vector([row - drive for row, drive in zip(d.dynamics(d.v, d.a), d.u, strict=True)])


def _inverse_dynamics(d: Derivation) -> Outputs:
    return d.vector(d.dynamics(d.v, d.a))


def _residual_jacobian(d: Derivation) -> Outputs:
    found = residual_derivatives(d.model, d.bound, d.joints, d.v, d.a, d.graph.note)
    by_q, by_v = resisting_slopes(d.bound, d.q, d.v, d.functions)
    for key, slope in by_q.items():  # the same keys in both
        found.by_q[key] = found.by_q.get(key, 0.0) + slope
        found.by_v[key] = found.by_v.get(key, 0.0) + by_v[key]
    for line in d.lines(d.v):
        add_derivatives(line, d.v, found.by_q, found.by_v)
    return d.matrices(found.by_q, found.by_v, found.by_a)


def _solved(d: Derivation, acceleration: list[Scalar], pivots: list[tuple[Scalar, Scalar]]) -> Outputs:
    """Accelerations, and for every coordinate a pivot with the size that it is compared to."""
    outputs = d.vector(acceleration)
    for place, index in enumerate(d.own):
        outputs["pivot", 2 * place], outputs["pivot", 2 * place + 1] = pivots[index]
    return outputs


def _factorised(d: Derivation) -> Outputs:
    """M = L^T D L, solved for u minus everything but M a."""
    right = [drive - row for row, drive in zip(d.dynamics(d.v, d.still), d.u, strict=True)]
    matrix = d.matrix()
    acceleration, pivots = solve(d.model, matrix, right)
    return _solved(d, acceleration, [(pivot, matrix[i, i]) for i, pivot in enumerate(pivots)])


def _drives(d: Derivation, springs: list[Scalar]) -> list[Scalar]:
    """Drives less springs and dampers; of a prescribed coordinate its acceleration, which stands in u."""
    given = d.model.prescribed
    return [u if i in given else u - spring for i, (u, spring) in enumerate(zip(d.u, springs, strict=True))]


def _eliminated(d: Derivation) -> Outputs:
    """Joint by joint from the tips, without a mass matrix."""
    found = _by_elimination(d, d.bound, d.bound.armature, _drives(d, d.forces(d.v)), d.v, {})
    return _solved(d, *found)


def _by_elimination(
    d: Derivation,
    bound: Bound,
    armature: Sequence[Scalar],
    drives: list[Scalar],
    v: list[Any],
    slopes: Mapping[int, Scalar],
) -> tuple[list[Scalar], list[tuple[Scalar, Scalar]]]:
    """Accelerations and pivots: the motors' scalar rows, then the tree.

    ``slopes`` are those of the transmissions in an implicit step.
    """
    rotors = Rotors(d.model, bound, armature, drives, slopes)
    left = replace(bound, armature=tuple(rotors.armature))
    solved = Elimination(d.model, left, d.joints, v, rotors.drives, d.graph.note)
    rotors.release(solved.accelerations, solved.pivots)
    return solved.accelerations, solved.pivots


def _implicit_step(d: Derivation) -> Outputs:
    """Springs and dampers at the end of the step: they add to the diagonal of M, so the elimination stays O(n).

    Those of transmissions couple a motor to its joint alone (``Rotors``).  A law that is not linear is taken along its
    tangent at the coordinate that the rate leads to; a tangent that falls is left out, so that the matrix stays
    positive definite.
    ``added`` is what a joint's controller adds to the diagonal; it acts on coordinates that are driven.
    Springs between points act where their rates lead to, in the directions that they have; their tangents are no
    diagonal, and join in afterwards (``_with_lines``).
    """
    dt, square = d.graph.input("dt", 0), d.graph.input("dt", 1)
    ahead = [q + dt * v for q, v in zip(d.q, d.v, strict=True)]
    springs = d.resisting(ahead, d.v)
    pulls = [line.along(dt) for line in d.lines(d.v)]
    for pull in pulls:
        for i, arm in pull.arms.items():
            springs[i] = springs[i] + pull.tension * arm
    drives = _drives(d, springs)
    armature = list(d.bound.armature)
    for i, (stiffness, damping) in enumerate(zip(d.bound.stiffness, d.bound.damping, strict=True)):
        armature[i] = armature[i] + (dt * damping + square * stiffness)
    for i, law in effects(d.bound, ahead, d.v, d.functions).items():
        armature[i] = armature[i] + d.functions.larger(dt * law.by_v + square * law.by_s, 0.0)
    for place, i in enumerate(d.own):
        if i in d.model.driven:
            armature[i] = armature[i] + d.graph.input("added", place)
    slopes = {}
    for i, stretch in stretches(d.bound, ahead, d.v, d.functions).items():
        bent = d.functions.larger(dt * stretch.bent.by_v + square * stretch.bent.by_s, 0.0)
        slopes[i] = dt * stretch.linear.by_v + square * stretch.linear.by_s + bent
    accelerations, pivots = _by_elimination(d, d.bound, armature, drives, d.v, slopes)
    return _solved(d, _with_lines(d, armature, accelerations, pulls, dt, square, slopes), pivots)


def _with_lines(
    d: Derivation,
    armature: Sequence[Scalar],
    accelerations: list[Scalar],
    pulls: Sequence[Along],
    dt: Scalar,
    square: Scalar,
    slopes: Mapping[int, Scalar],
) -> list[Scalar]:
    """Accelerations with slope j j^T, j = dL/dq, of every spring between points added to the matrix.

    One rank at a time (J. Sherman, W. J. Morrison 1950): each takes the answer to its own j, which is one more
    elimination at rest and weightless, whose inertias are those of the first.
    """
    rest = replace(d.bound, gravity=(0.0, 0.0, 0.0))
    answers = []
    for pull in pulls:
        drives = [0.0 if i in d.model.prescribed else pull.arms.get(i, 0.0) for i in range(d.model.size)]
        answers.append(_by_elimination(d, rest, armature, drives, d.still, slopes)[0])
    found = list(accelerations)
    for place, pull in enumerate(pulls):
        own, slope = answers[place], d.functions.larger(dt * pull.by_rate + square * pull.by_e, 0.0)
        share = slope / (1.0 + slope * _along(pull, own))
        for other in (found, *answers[place + 1 :]):
            taken = share * _along(pull, other)
            other[:] = [x - taken * y for x, y in zip(other, own, strict=True)]
    return found


def _along(pull: Along, accelerations: Sequence[Scalar]) -> Scalar:
    """Acceleration of a spring's length."""
    total: Scalar = 0.0
    for index, arm in pull.arms.items():
        total = total + arm * accelerations[index]
    return total


def _euler_cosines(d: Derivation) -> Outputs:
    angles = ("alpha", "beta", "gamma")
    return _vector(
        [
            joint.rotations[1].cos if set(angles) <= set(body.active) else 1.0
            for body, joint in zip(d.model.bodies, d.joints, strict=True)
        ]
    )


def _coriolis_matrix(d: Derivation) -> Outputs:
    return d.matrices(coriolis_matrix(d.model, d.bound, d.joints, d.v, d.graph.note))


def _christoffel(d: Derivation) -> Outputs:
    """Column by column: C at unit velocities, so that zeros fold and the rest is shared.

    What vanishes only by an identity (C_i,ji = 0, say) would be left as round-off; the zero map knows it.
    """
    n = len(d.own)
    survives = zero_map(d.model).christoffel.mask[np.ix_(d.own, d.own, d.own)].reshape(n * n, n)
    outputs: Outputs = {}
    for k, index in enumerate(d.own):
        velocity = [float(i == index) for i in range(d.model.size)]
        column = d.matrices(coriolis_matrix(d.model, d.bound, d.joints, velocity, d.graph.note))
        for (_, ij), value in column.items():
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
    for index in d.own:
        values.extend(axes[index])
    return _vector(values)


def _energy(d: Derivation) -> Outputs:
    kinetic = kinetic_energy(d.model, d.bound, d.joints, d.v)
    potential = potential_energy(d.model, d.bound, d.joints, d.q)
    for law in effects(d.bound, d.q, d.v, d.functions).values():
        potential = potential + law.energy
    for stretch in stretches(d.bound, d.q, d.v, d.functions).values():
        potential = potential + stretch.whole.energy
    for line in d.lines(d.still):
        potential = potential + line.pull().energy
    return _vector([kinetic, potential])


def _reactions(d: Derivation) -> Outputs:
    _, total = inertial_rows(d.model, d.bound, d.joints, d.v, d.a, d.bound.gravity, d.graph.note)
    for line in d.lines(d.v):  # their forces pass the joints between both points by
        for k, held in line.wrenches():
            total[k] = total[k] + held
    return _vector([x for wrench in total for x in (*wrench.force, *wrench.moment)])


def _closures(d: Derivation) -> list[Closure]:
    return list(closures(d.model, d.bound, d.joints, d.graph.note))


def _constraint(d: Derivation) -> Outputs:
    return _vector([value for closure in _closures(d) for value in closure.values()])


def _constraint_jacobian(d: Derivation) -> Outputs:
    rows = [row for closure in _closures(d) for row in closure.jacobian()]
    return _vector([row.get(i, 0.0) for row in rows for i in d.own])


def _constraint_bias(d: Derivation) -> Outputs:
    return _vector([value for closure in _closures(d) for value in closure.bias(d.v)])


def _cut_poses(d: Derivation) -> Outputs:
    values: list[Scalar] = []
    for pose in (closure.pose() for closure in _closures(d)):
        for row, x in zip(pose.rotation, pose.origin, strict=True):
            values.extend((*row, x))
        values.extend((0.0, 0.0, 0.0, 1.0))
    return _vector(values)


def _spring_forces(d: Derivation) -> Outputs:
    return _vector([x for line in d.lines(d.v) for x in line.forces()])


def _spring_jacobian(d: Derivation) -> Outputs:
    found = [(1.0 / line.length(), line.g) for line in d.lines(d.still)]
    return _vector([g.get(i, 0.0) * inverse for inverse, g in found for i in d.own])


def _spring_stiffness(d: Derivation) -> Outputs:
    total: Rows = {}
    for line in d.lines(d.still):
        for place, value in line.stiffness().items():
            total[place] = total.get(place, 0.0) + value
    return d.matrices(total)


SOLVERS: Mapping[str, Callable[[Derivation], Outputs]] = {
    FACTORISED: _factorised,
    "joints eliminated in O(n)": _eliminated,
}

WRITERS: Mapping[str, Callable[[Derivation], Outputs]] = {
    "mass_matrix": _mass_matrix,
    "bias_force": _bias_force,
    "generalized_force": _generalized_force,
    "external_force": _external_force,
    "external_reactions": _external_reactions,
    "residual": _residual,
    "inverse_dynamics": _inverse_dynamics,
    "residual_jacobian": _residual_jacobian,
    "coriolis_matrix": _coriolis_matrix,
    "christoffel": _christoffel,
    "kinematics": _kinematics,
    "energy": _energy,
    "reactions": _reactions,
    "euler_cosines": _euler_cosines,
    "constraint": _constraint,
    "constraint_jacobian": _constraint_jacobian,
    "constraint_bias": _constraint_bias,
    "cut_poses": _cut_poses,
    "spring_forces": _spring_forces,
    "spring_jacobian": _spring_jacobian,
    "spring_stiffness": _spring_stiffness,
    "implicit_step": _implicit_step,
}
