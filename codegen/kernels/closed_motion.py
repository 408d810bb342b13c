"""Inverse dynamics of a closed mechanism: drives, reactions, and the derivatives of what closes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from eomgen.names import kind_of
from eomgen.robot.model import Model
from eomgen.robot.value import ANGULAR

from ..program.forward_mode import gradients
from ..program.ir import Program
from ..solve.drives import WEIGHINGS, least_drives
from ..tree.constraints import Closure
from ..tree.recursion import NO_WRENCH, Wrench
from ..tree.spatial import Scalar, along
from .blocks import row_blocks
from .constraint_rows import gaps
from .derivation import Derivation, Outputs, vector

CLOSING = "closing_derivatives"


def drives(d: Derivation) -> Outputs:
    """Drives of a motion, multipliers, gaps with their rates, J a and J_dot v, what is left, and what was needed.

    Forces ``u`` act beside the drives.  Angles that only an offset turns do not move: nothing drives them.
    """
    own, names = set(d.own), d.model.coordinates
    found = gaps(d, d.v)
    rows = [gap.row(0.0) for gap in found]
    needed = [row - given for row, given in zip(d.followers.gather(d.dynamics(d.v, d.a)), d.u, strict=True)]
    active = [replace(row, arms={i: arm for i, arm in row.arms.items() if i in own}) for row in rows]
    driven = {i for i in (*d.model.driven, *d.model.prescribed) if i in own}
    parts = least_drives(active, needed, driven, lambda i: kind_of(names[i]) in ANGULAR, WEIGHINGS[d.dtype])
    u, multipliers, left = parts
    values = [u[i] for i in d.own] + multipliers
    values += [gap.value for gap in found] + [gap.rate(d.v) for gap in found]
    values += [row.along(d.a) for row in rows] + [gap.bias for gap in found]
    values += [x[i] for x in (left, needed) for i in d.own]
    return vector(values)


def closing_reactions(d: Derivation) -> Outputs:
    """Reactions of the tree's joints to the forces in the cuts, of multipliers."""
    total = [NO_WRENCH] * len(d.model.bodies)
    for closure, wrench in _rigid_wrenches(d):
        for k, carried in closure.wrenches(wrench.force, wrench.moment):
            total[k] = total[k] + carried
    return wrench_outputs(total)


def loop_reactions(d: Derivation) -> Outputs:
    """Wrenches of cut joints on their second links, in the cut frames there, where nothing in them is rigid."""
    return _of_cuts(d, {})


def loop_wrenches(d: Derivation) -> Outputs:
    """Return the wrenches of multipliers, for what is rigid."""
    return _of_cuts(d, {closure.number: wrench for closure, wrench in _rigid_wrenches(d)})


def _of_cuts(d: Derivation, rigid: Mapping[int, Wrench]) -> Outputs:
    """Wrenches of the cut joints with those of their elastic coordinates, as outputs."""
    total = [rigid.get(closure.number, NO_WRENCH) for closure in d.closures]
    for element in d.elements:
        for number, wrench in element.wrenches_in_cuts(d.v):
            total[number] = total[number] + wrench
    return wrench_outputs([closure.seen_from_b(x) for closure, x in zip(d.closures, total, strict=True)])


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
    for block in row_blocks(d.described):
        here = found[block.first : block.first + block.rows]
        columns = [d.own[column] for column in block.columns]
        arms = [{i: arm for i, arm in gap.arms.items() if i in place} for gap in here]
        values += [row.get(i, 0.0) for row in arms for i in columns]
        rates = [along(gap.arms, d.a) + gap.bias for gap in here]
        q, v = ([x[i] for i in columns] for x in (d.q, d.v))
        for inputs in (q, v):
            values += [x for row in gradients(d.graph, rates, inputs) for x in row]
        multipliers = [d.graph.input("multipliers", block.first + r) for r in range(block.rows)]
        factors = dict(enumerate(multipliers))
        pull = [along(factors, [row.get(i, 0.0) for row in arms]) for i in columns]
        second = gradients(d.graph, pull, q)
        values += [second[min(i, j)][max(i, j)] for i in range(len(columns)) for j in range(len(columns))]
    return vector(values)


def row_kinds(model: Model, program: Program) -> list[int]:
    """Give every row of the constraint a number for rows of its kind; -1 where nothing that is not prescribed moves it.

    Args:
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


def wrench_outputs(wrenches: Sequence[Wrench]) -> Outputs:
    """Forces and moments, wrench by wrench."""
    return vector([x for wrench in wrenches for x in (*wrench.force, *wrench.moment)])
