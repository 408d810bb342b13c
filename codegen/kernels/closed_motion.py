"""Inverse dynamics of a closed mechanism: drives, reactions, and the derivatives of the constraint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
from .constraint_rows import closure_residuals
from .derivation import Derivation, Outputs, vector

CLOSING = "closing_derivatives"


def drives(d: Derivation) -> Outputs:
    """Return drives of a motion, multipliers, g, J v, J a, J_dot v, then forces that are left and that were needed.

    Forces ``u`` act beside the drives.  Angles that only an offset turns do not move: nothing drives them.
    """
    active, names = set(d.active), d.model.coordinates
    residuals = closure_residuals(d, d.v)
    rows = [residual.row(0.0) for residual in residuals]
    needed = [row - drive for row, drive in zip(d.followers.gather(d.dynamics(d.v, d.a)), d.u, strict=True)]
    moving_rows = [
        replace(row, jacobian_row={i: arm for i, arm in row.jacobian_row.items() if i in active}) for row in rows
    ]
    driven = {i for i in (*d.model.driven, *d.model.prescribed) if i in active}
    parts = least_drives(moving_rows, needed, driven, lambda i: kind_of(names[i]) in ANGULAR, WEIGHINGS[d.dtype])
    u, multipliers, left = parts
    values = [u[i] for i in d.active] + multipliers
    values += [residual.value for residual in residuals] + [residual.rate(d.v) for residual in residuals]
    values += [row.along(d.a) for row in rows] + [residual.bias for residual in residuals]
    values += [x[i] for x in (left, needed) for i in d.active]
    return vector(values)


def closing_reactions(d: Derivation) -> Outputs:
    """Compute reactions of the tree's joints to the forces in the cuts, of multipliers."""
    total = [NO_WRENCH] * len(d.model.bodies)
    for closure, wrench in _rigid_wrenches(d):
        for k, carried in closure.wrenches(wrench.force, wrench.moment):
            total[k] = total[k] + carried
    return wrench_outputs(total)


def loop_wrenches(d: Derivation, *, elastic: bool = False) -> Outputs:
    """Compute cut joints' wrenches on their second links, in the cut frames there, of multipliers.

    Args:
        elastic: whether nothing in them is rigid, so that there are no multipliers.
    """
    rigid = {} if elastic else {closure.number: wrench for closure, wrench in _rigid_wrenches(d)}
    total = [rigid.get(closure.number, NO_WRENCH) for closure in d.closures]
    for element in d.elements:
        for number, wrench in element.wrenches_in_cuts(d.v):
            total[number] = total[number] + wrench
    return wrench_outputs([closure.seen_from_b(x) for closure, x in zip(d.closures, total, strict=True)])


def _rigid_wrenches(d: Derivation) -> Iterator[tuple[Closure, Wrench]]:
    """Yield every loop with the wrench of its rigid directions on its second link, of input multipliers.

    It acts at the origin of frame b, in the axes of the common body.
    """
    first = 0
    for closure in d.closures:
        total = NO_WRENCH
        for r, component in enumerate(closure.parts):
            total = total + closure.direction(component).wrench(d.graph.input("multipliers", first + r))
        yield closure, total
        first += len(closure.parts)


def closing_derivatives(d: Derivation) -> Outputs:
    """Differentiate J^T lambda and J a + J_dot v, of multipliers: ``row_blocks`` one after the other.

    Of each loop J, the derivatives of J a + J_dot v by q and by v, and of J^T lambda by q, which is symmetric.
    """
    values: list[Scalar] = []
    place = set(d.active)
    residuals = closure_residuals(d, d.v)
    for block in row_blocks(d.described):
        here = residuals[block.first : block.first + block.rows]
        columns = [d.active[column] for column in block.columns]
        J = [{i: arm for i, arm in residual.jacobian_row.items() if i in place} for residual in here]
        values += [row.get(i, 0.0) for row in J for i in columns]
        rates = [along(residual.jacobian_row, d.a) + residual.bias for residual in here]
        q, v = ([x[i] for i in columns] for x in (d.q, d.v))
        for inputs in (q, v):
            values += [x for row in gradients(d.graph, rates, inputs) for x in row]
        multipliers = [d.graph.input("multipliers", block.first + r) for r in range(block.rows)]
        factors = dict(enumerate(multipliers))
        pull = [along(factors, [row.get(i, 0.0) for row in J]) for i in columns]
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
            moves = any(instruction.op != "const" or instruction.leaf != 0.0 for instruction in instructions)
            kinds.append(number.setdefault(kind, len(number)) if moves else -1)
        at += 3 * block.size + len(block.columns) ** 2
    return kinds


def wrench_outputs(wrenches: Sequence[Wrench]) -> Outputs:
    """Return forces and moments, wrench by wrench."""
    return vector([x for wrench in wrenches for x in (*wrench.force, *wrench.moment)])
