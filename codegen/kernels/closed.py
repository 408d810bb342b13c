"""Mechanisms with closed loops: accelerations and multipliers, and the nearest state that is closed.

M a + h = u + J^T lambda,    J a + J_dot v = 0,    g(q) = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from eomgen.robot.model import Model

from ..forces.cuts import coupled
from ..program.ir import Node, evaluate, finish
from ..solve.elimination import Elimination
from ..solve.responses import EliminatedTree, Tree, total
from ..solve.rotors import Rotors
from ..solve.rows import PRECISIONS, Row, RowSystem
from ..tree.bound import Bound
from ..tree.spatial import Scalar, is_zero
from .derivation import Derivation, Outputs

Pivots = list[tuple[Scalar, Scalar]]
ROUND_OFF = 1e-12  # m, or a number: arms below it at random poses are zero
_SAMPLES = 3
PLANE = "the loop moves in a plane: nothing moves it along this direction"
NO_SLOPES: Mapping[int, Scalar] = MappingProxyType({})


@dataclass(frozen=True)
class Gap:
    """A component of the loops' constraint: g, its derivatives by the coordinates, J_dot v, and rows of its kind."""

    value: Scalar
    arms: dict[int, Scalar]
    bias: Scalar
    group: object
    is_weak: bool = False  # but for round-off it vanishes for the description's numbers

    def row(self, right: Scalar) -> Row:
        """The row that makes J a ``right``."""
        return Row(self.arms, right, group=self.group, is_weak=self.is_weak)

    def rate(self, v: Sequence[Scalar]) -> Scalar:
        """J v."""
        return Row(self.arms, 0.0).along(v)


def gaps(d: Derivation, v: Sequence[Scalar]) -> list[Gap]:
    """Components of the constraint, of all loops and rigid couplings, in the order of ``Model.constraints``.

    Arms that vanish are left out.  Prescribed coordinates have arms, too: they move the loops, but no multiplier moves
    them.
    """
    found = []
    for closure in d.closures:
        parts = zip(closure.parts, closure.values(), closure.jacobian(), closure.bias(v), strict=True)
        for part, value, row, bias in parts:
            arms = {index: arm for index, arm in row.items() if not is_zero(arm)}
            found.append(Gap(value, arms, bias, (closure.number, part.axis is None)))
    for number, coupling in enumerate(d.bound.couplings):
        if coupling.law is None:
            value = coupled(coupling.arms, coupling.offset, d.q)
            found.append(Gap(value, dict(coupling.arms), 0.0, ("coupling", number)))
    return _without_round_off(d, found)


def vanishing_rows(model: Model) -> tuple[tuple[str, str], ...]:
    """Components of the constraint that no coordinate changes, in any state, by name with the reason."""
    if not model.constraints:
        return ()
    d = Derivation(model)
    found = zip(model.constraints, gaps(d, d.still), strict=True)
    return tuple((name, PLANE) for name, gap in found if not gap.arms)


def _without_round_off(d: Derivation, found: Sequence[Gap]) -> list[Gap]:
    """The components without arms that are round-off wherever the mechanism is: of one in a tilted plane, say.

    Where an arm is round-off for the description's numbers alone, and not for others that may be tuned, its row keeps
    it, and is weighed against the rows of all loops.
    """
    outputs = {("arm", place): arm for place, arm in enumerate(arm for gap in found for arm in gap.arms.values())}
    if not any(isinstance(arm, Node) for arm in outputs.values()):
        return list(found)
    program, rng = finish(d.graph, "arms", outputs), np.random.default_rng(0)
    numbers = np.array(list(d.model.parameters.values()))
    largest = []
    for tuned in (0.0, 0.1):
        sizes = np.zeros(len(outputs))
        for _ in range(_SAMPLES):
            p = numbers * (1.0 + tuned * rng.normal(size=numbers.size)) + tuned * rng.normal(size=numbers.size)
            values = evaluate(program, {"q": rng.uniform(-1.5, 1.5, d.model.size).tolist(), "p": p.tolist()})
            sizes = np.maximum(sizes, np.abs(list(values.values())))
        largest.append(iter((sizes > ROUND_OFF).tolist()))
    kept = []
    for gap in found:
        now, ever = ({index for index in gap.arms if next(sizes)} for sizes in largest)
        arms = {index: arm for index, arm in gap.arms.items() if index in ever}
        kept.append(replace(gap, arms=arms, is_weak=bool(arms) and not now))
    return kept


def eliminated(
    d: Derivation,
    armature: Sequence[Scalar],
    drives: list[Scalar],
    v: list[Any],
    slopes: Mapping[int, Scalar] = NO_SLOPES,
    *,
    bound: Bound | None = None,
    coupled: bool = False,
) -> tuple[EliminatedTree, Pivots]:
    """The tree with its accelerations, and pivots with what they are compared to: motors first, then joints.

    Args:
        armature, drives, v: of every coordinate.
        slopes: of the transmissions in an implicit step.
        bound: the model's numbers, where they are not the derivation's.
        coupled: whether rows come on top.
    """
    bound = bound or d.bound
    rotors = Rotors(d.model, bound, armature, drives, slopes)
    left = replace(bound, armature=tuple(rotors.armature))
    solved = Elimination(d.model, left, d.joints, v, rotors.drives, d.graph.note, coupled=coupled)
    rotors.release(solved.accelerations, solved.pivots)
    return EliminatedTree(rotors, solved, solved.accelerations), solved.pivots


def with_rows(d: Derivation, tree: Tree, rows: Sequence[Row]) -> tuple[list[Scalar], list[Scalar]]:
    """Accelerations, (n,), with the forces of the rows, and the multipliers of all rows."""
    given = set(d.model.prescribed)
    pushing = [
        replace(row, arms={i: arm for i, arm in row.arms.items() if i not in given}) if given else row for row in rows
    ]
    responses = [tree.respond(row) for row in pushing]
    system = RowSystem(pushing, responses, PRECISIONS[d.dtype], tree.pivots())
    multipliers = system.multipliers(lambda r: rows[r].right - tree.along(rows[r], responses[r]))
    return tree.accelerations(total(responses, multipliers)), multipliers


def constrained(d: Derivation, tree: Tree, pivots: Pivots) -> Outputs:
    """Accelerations, multipliers, gaps and their rates, one after the other."""
    found = gaps(d, d.v)
    accelerations, multipliers = with_rows(d, tree, [gap.row(-gap.bias) for gap in found])
    values = [accelerations[i] for i in d.own] + multipliers
    values += [gap.value for gap in found] + [gap.rate(d.v) for gap in found]
    return {**dict(enumerate_outputs(values)), **pivot_outputs(d, pivots)}


def settling(d: Derivation, tree: Tree, pivots: Pivots) -> Outputs:
    """Changes of q and v towards the nearest closed state in the metric of the kinetic energy, and the gaps before."""
    found = gaps(d, d.still)
    closing = with_rows(d, tree, [gap.row(-gap.value) for gap in found])[0]
    slowing = with_rows(d, tree, [gap.row(-gap.rate(d.v)) for gap in found])[0]
    values = [x[i] for x in (closing, slowing) for i in d.own] + [gap.value for gap in found]
    return {**dict(enumerate_outputs(values)), **pivot_outputs(d, pivots)}


def enumerate_outputs(values: Sequence[Scalar]) -> Outputs:
    """Values one after the other."""
    return {("out", place): value for place, value in enumerate(values)}


def pivot_outputs(d: Derivation, pivots: Pivots) -> Outputs:
    """For every coordinate a pivot with the size that it is compared to."""
    outputs: Outputs = {}
    for place, index in enumerate(d.own):
        outputs["pivot", 2 * place], outputs["pivot", 2 * place + 1] = pivots[index]
    return outputs
