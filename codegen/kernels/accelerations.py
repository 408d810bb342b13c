"""Accelerations from drives: M factorised, joints eliminated, and the step of a linearly implicit integration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..forces.rows import effects, stretches
from ..forces.springs import Along
from ..solve.elimination import Elimination
from ..solve.factorised import solve
from ..solve.rotors import Rotors
from ..tree.bound import Bound
from ..tree.spatial import Scalar
from .derivation import Derivation, Outputs

FACTORISED = "M = L^T D L factorised"
STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is tried beside the elimination


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


def implicit_step(d: Derivation) -> Outputs:
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
        armature[i] = armature[i] + d.functions.max(dt * law.by_v + square * law.by_s, 0.0)
    for place, i in enumerate(d.own):
        if i in d.model.driven:
            armature[i] = armature[i] + d.graph.input("added", place)
    slopes = {}
    for i, stretch in stretches(d.bound, ahead, d.v, d.functions).items():
        nonlinear = d.functions.max(dt * stretch.nonlinear.by_v + square * stretch.nonlinear.by_s, 0.0)
        slopes[i] = dt * stretch.linear.by_v + square * stretch.linear.by_s + nonlinear
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
        own, slope = answers[place], d.functions.max(dt * pull.by_rate + square * pull.by_e, 0.0)
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


@dataclass(frozen=True)
class Way:
    """One of several ways to write a kernel.

    most: coordinates up to which it is tried beside the others, because its program would be long; None for any number.
    prescribes: whether it can do with coordinates whose motion is given.
    """

    write: Callable[[Derivation], Outputs]
    most: int | None = None
    prescribes: bool = True


SOLVERS: Mapping[str, Way] = {
    FACTORISED: Way(_factorised, STRAIGHT_SOLVE, prescribes=False),  # M would have to be divided by what is known
    "joints eliminated in O(n)": Way(_eliminated),
}
