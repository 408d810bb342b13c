"""Mechanisms with closed loops: accelerations and multipliers, and the nearest state that is closed.

M a + h = u + J^T lambda,    J a + J_dot v = 0,    g(q) = 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from eomgen.names import kind_of
from eomgen.robot.model import Model
from eomgen.robot.value import ANGULAR

from ..forces.cuts import coupled
from ..program.forward_mode import gradients
from ..program.ir import Node, Program, evaluate, finish
from ..solve.drives import WEIGHINGS, least_drives
from ..solve.elimination import Elimination
from ..solve.responses import EliminatedTree, Tree, total
from ..solve.rotors import Rotors
from ..solve.rows import PRECISIONS, Row, RowSystem
from ..tree.bound import Bound
from ..tree.constraints import Closure
from ..tree.recursion import NO_WRENCH, Wrench
from ..tree.spatial import Scalar, is_zero
from .blocks import row_blocks
from .derivation import Derivation, Outputs

CLOSING = "closing_derivatives"
Pivots = list[tuple[Scalar, Scalar]]
REDUNDANT = 1e-6  # of the largest singular value: below it rows follow from others
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


def is_redundant(model: Model) -> bool:
    """Whether some rows of the constraint follow from others at home, as far as home is closed."""
    d = Derivation(model)
    found = [gap for gap in gaps(d, d.still) if gap.arms]
    outputs = {("out", r * d.model.size + i): arm for r, gap in enumerate(found) for i, arm in gap.arms.items()}
    if not outputs:
        return False
    values = evaluate(finish(d.graph, "arms", outputs), {"q": model.home, "p": list(model.parameters.values())})
    J = np.zeros(len(found) * d.model.size)
    for (_, place), value in values.items():
        J[place] = value
    J = J.reshape(len(found), -1)[:, [i for i in range(d.model.size) if i not in d.model.prescribed]]
    return bool(np.linalg.matrix_rank(J, tol=REDUNDANT * np.linalg.norm(J, 2)) < len(found))


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


def drives(d: Derivation) -> Outputs:
    """Drives of a motion, multipliers, gaps with their rates, J a and J_dot v, what is left, and what was needed.

    Forces ``u`` act beside the drives.  Angles that only an offset turns do not move: nothing drives them.
    """
    own, names = set(d.own), d.model.coordinates
    found = gaps(d, d.v)
    rows = [gap.row(0.0) for gap in found]
    needed = [row - given for row, given in zip(d.dynamics(d.v, d.a), d.u, strict=True)]
    active = [replace(row, arms={i: arm for i, arm in row.arms.items() if i in own}) for row in rows]
    driven = {i for i in (*d.model.driven, *d.model.prescribed) if i in own}
    parts = least_drives(active, needed, driven, lambda i: kind_of(names[i]) in ANGULAR, WEIGHINGS[d.dtype])
    u, multipliers, left = parts
    values = [u[i] for i in d.own] + multipliers
    values += [gap.value for gap in found] + [gap.rate(d.v) for gap in found]
    values += [row.along(d.a) for row in rows] + [gap.bias for gap in found]
    values += [x[i] for x in (left, needed) for i in d.own]
    return dict(enumerate_outputs(values))


def closing_reactions(d: Derivation) -> Outputs:
    """Reactions of the tree's joints to the forces in the cuts, of multipliers."""
    total = [NO_WRENCH] * len(d.model.bodies)
    for closure, wrench in _rigid_wrenches(d):
        for k, carried in closure.wrenches(wrench.force, wrench.moment):
            total[k] = total[k] + carried
    return _wrench_outputs(total)


def loop_reactions(d: Derivation) -> Outputs:
    """Wrenches of cut joints on their second links, in the cut frames there, where nothing in them is rigid."""
    return _of_cuts(d, {})


def loop_wrenches(d: Derivation) -> Outputs:
    """The same of multipliers, for what is rigid."""
    return _of_cuts(d, {closure.number: wrench for closure, wrench in _rigid_wrenches(d)})


def _of_cuts(d: Derivation, rigid: Mapping[int, Wrench]) -> Outputs:
    """Wrenches of the cut joints with those of their elastic coordinates, as outputs."""
    total = [rigid.get(closure.number, NO_WRENCH) for closure in d.closures]
    for own in d.deviating:
        if own.closure is not None and own.direction is not None:
            force = own.resists(own.s, own.rate(d.v), d.functions).force
            total[own.closure.number] = total[own.closure.number] + own.direction.wrench(-1.0 * force)
    return _wrench_outputs([closure.seen_from_b(x) for closure, x in zip(d.closures, total, strict=True)])


def _rigid_wrenches(d: Derivation) -> Iterator[tuple[Closure, Wrench]]:
    """Every loop with the wrench on its second link of what is rigid in its cut, of the multipliers that are an input.

    It acts at the origin of frame b, in the axes of the common body.
    """
    first = 0
    for closure in d.closures:
        total = NO_WRENCH
        for r, part in enumerate(closure.parts):
            total = total + closure.direction(part).wrench(d.graph.input("multipliers", first + r))
        yield closure, total
        first += len(closure.parts)


def closing_derivatives(d: Derivation) -> Outputs:
    """Derivatives of J^T lambda and of J a + J_dot v, of multipliers: ``row_blocks`` one after the other.

    Of each loop J, the derivatives of J a + J_dot v by q and by v, and of J^T lambda by q, which is symmetric.
    """
    values: list[Scalar] = []
    place = set(d.own)
    found = gaps(d, d.v)
    for block in row_blocks(d.model):
        here = found[block.first : block.first + block.rows]
        columns = [i for i in block.columns if i in place]
        arms = [{i: arm for i, arm in gap.arms.items() if i in place} for gap in here]
        values += [row.get(i, 0.0) for row in arms for i in columns]
        rates = [Row(gap.arms, 0.0).along(d.a) + gap.bias for gap in here]
        q, v = ([x[i] for i in columns] for x in (d.q, d.v))
        for inputs in (q, v):
            values += [x for row in gradients(d.graph, rates, inputs) for x in row]
        multipliers = [d.graph.input("multipliers", block.first + r) for r in range(block.rows)]
        pull = [product(multipliers, [row.get(i, 0.0) for row in arms]) for i in columns]
        second = gradients(d.graph, pull, q)
        values += [second[min(i, j)][max(i, j)] for i in range(len(columns)) for j in range(len(columns))]
    return dict(enumerate_outputs(values))


def row_kinds(model: Model, program: Program) -> list[int]:
    """Give every row of the constraint a number for rows of its kind; -1 where nothing that is not prescribed moves it.

    Args:
        model: a robot with constraints.
        program: its closing_derivatives, of which the first block of every loop is that of J.
    """
    kinds, number, at = list[int](), dict[tuple[str, bool], int](), 0
    for block in row_blocks(model):
        for r, kind in enumerate(block.kinds):
            places = [at + r * len(block.columns) + i for i, x in enumerate(block.columns) if x not in model.prescribed]
            instructions = [program.instructions[program.outputs["out", place]] for place in places]
            moves = any(found.op != "const" or found.leaf != 0.0 for found in instructions)
            kinds.append(number.setdefault(kind, len(number)) if moves else -1)
        at += 3 * block.size + len(block.columns) ** 2
    return kinds


def product(factors: Sequence[Scalar], values: Sequence[Scalar]) -> Scalar:
    """Sum of the products."""
    found: Scalar = 0.0
    for factor, value in zip(factors, values, strict=True):
        found = found + factor * value
    return found


def _wrench_outputs(wrenches: Sequence[Wrench]) -> Outputs:
    return dict(enumerate_outputs([x for wrench in wrenches for x in (*wrench.force, *wrench.moment)]))


def enumerate_outputs(values: Sequence[Scalar]) -> Outputs:
    """Values one after the other."""
    return {("out", place): value for place, value in enumerate(values)}


def pivot_outputs(d: Derivation, pivots: Pivots) -> Outputs:
    """For every coordinate a pivot with the size that it is compared to."""
    outputs: Outputs = {}
    for place, index in enumerate(d.own):
        outputs["pivot", 2 * place], outputs["pivot", 2 * place + 1] = pivots[index]
    return outputs
