"""Derivatives of the residual and of the accelerations by coordinates, rates and drives.

Of trees, where no matrix is inverted by dense columns: either the derivatives of the residual at the motion that the
drives make pass through the factors of M = L^T D L, or those of the elimination's values are accumulated.  Behind
joints with all six coordinates the latter finds what little a body knows of those before and behind it: forces from its
neighbours, and the angular velocity that it is carried with.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence

from ..forces.element import ForceElement, Slopes
from ..program.accumulation import jacobian
from ..program.ir import Node
from ..solve.factorised import Factors, coordinates_in_front
from ..solve.free_bodies import bodies_apart
from ..tree.composite import Rows
from ..tree.derivatives import Derivatives, residual_derivatives
from ..tree.spatial import Scalar
from .accelerations import Variant, drives_left
from .closed import Pivots, eliminated, pivot_outputs
from .derivation import Derivation, Outputs

BY_FACTORS = "derivatives of the residual through M = L^T D L"
BY_VALUES = "values of the elimination accumulated"
MOST_PRODUCTS = 20000  # of the solution with M's factors, beyond which it is a loop in C
MOST_COORDINATES = 80  # of an elimination whose values are accumulated


def residual_slopes(d: Derivation, a: Sequence[Scalar]) -> Derivatives:
    """Differentiate the residual by q, v and a, at accelerations a."""
    slopes = residual_derivatives(d.tree, d.v, a)
    _add_forces(d, slopes.by_q, slopes.by_v, [element for element in d.elements if not element.IS_DRIVE])
    return slopes


def drive_slopes(d: Derivation) -> tuple[Rows, Rows, Rows]:
    """Differentiate what drives take from forces by q, v and their inputs."""
    by_q, by_v, by_u = dict[tuple[int, int], Scalar](), dict[tuple[int, int], Scalar](), dict[tuple[int, int], Scalar]()
    drives = [element for element in d.elements if element.IS_DRIVE]
    _add_forces(d, by_q, by_v, drives)
    for element in drives:
        by_u |= element.input_slopes(d.v)
    return by_q, by_v, by_u


def _add_forces(d: Derivation, by_q: Rows, by_v: Rows, elements: Iterable[ForceElement]) -> None:
    """Add derivatives of what resists the drives, but those of linear springs and dampers of single coordinates.

    Those by a coordinate that others follow are by their motions, too.
    """

    def moving(indices: Sequence[int]) -> list[int]:
        return [i for i in d.followers.leaders(indices) if i in d.rates]

    slopes = Slopes(d.graph, by_q, by_v, d.q, d.v, moving)
    for element in elements:
        element.add_slopes(slopes)


def _by_values(d: Derivation) -> Outputs:
    """Differentiate the elimination's program; resisting forces by their analytic derivatives."""
    drives = drives_left(d, d.forces(d.v))
    tree, pivots = eliminated(d, d.bound.armature, drives, d.v)
    by_q: Rows = {(i, i): law.stiffness for i, law in enumerate(d.bound.laws)}
    by_v: Rows = {(i, i): law.damping for i, law in enumerate(d.bound.laws)}
    _add_forces(d, by_q, by_v, d.elements)
    by_inputs = _by_inputs(d)
    partials: dict[Hashable, dict[Hashable, Scalar]] = {}
    for i, drive in enumerate(drives):
        if i not in d.model.prescribed and isinstance(drive, Node) and _key(drive) != _key(d.u[i]):
            own = {_key(d.u[i]): 1.0} if isinstance(d.u[i], Node) else {}  # no force acts on an internal state
            partials[drive.index] = _turned_round(d, i, by_q, by_v) | own | by_inputs[i]
    return _written(d, [_key(a) for a in tree.free], partials, pivots)


def _by_factors(d: Derivation) -> Outputs:
    """Differentiate M a = u - h at its solution, and solve with the factors of M.

    Rows of prescribed coordinates: their accelerations are u; in the other rows they stand on the right.
    """
    n, known = d.model.size, frozenset(d.model.prescribed)
    bias = d.dynamics_with_drives(d.v, d.still)
    whole = d.matrix()
    matrix = {pair: entry for pair, entry in whole.items() if known.isdisjoint(pair)} | {(i, i): 1.0 for i in known}
    held = {i: {j: whole.get((min(i, j), max(i, j)), 0.0) for j in known} for i in range(n) if i not in known}
    right = [d.u[i] if i in known else _right(d.u, bias[i], i, held[i]) for i in range(n)]
    factors = Factors(d.model, matrix)
    a = factors.solve(right)
    slopes, by_inputs = residual_slopes(d, a), _by_inputs(d)
    _add_forces(d, slopes.by_q, slopes.by_v, [element for element in d.elements if element.IS_DRIVE])
    partials: dict[Hashable, dict[Hashable, Scalar]] = {}
    for i in range(n):
        row = {i: 1.0} if i in known else {i: 1.0} | {j: -1.0 * entry for j, entry in held[i].items()}
        partials["row", i] = {_key(d.u[j]): entry for j, entry in row.items() if isinstance(d.u[j], Node)}
        if i not in known:
            partials["row", i] |= _turned_round(d, i, slopes.by_q, slopes.by_v) | by_inputs[i]
    front = coordinates_in_front(d.model)
    for i in range(n):
        partials["back", i] = {("row", i): 1.0}
        partials["solution", i] = {("back", i): factors.inverse[i]}
        partials["solution", i] |= {("solution", j): -1.0 * factors.factors[i, j] for j in front[i]}
    for i in range(n):
        for j in front[i]:
            partials["back", j]["back", i] = -1.0 * factors.factors[i, j]
    pivots = [(pivot, matrix[i, i]) for i, pivot in enumerate(factors.pivots)]
    return _written(d, [("solution", i) for i in range(n)], partials, pivots)


def _right(u: Sequence[Scalar], bias: Scalar, i: int, held: Mapping[int, Scalar]) -> Scalar:
    """Return drives less the bias and the accelerations that are known."""
    value = u[i] - bias
    for j, entry in held.items():
        value = value - entry * u[j]
    return value


def _by_inputs(d: Derivation) -> list[dict[Hashable, Scalar]]:
    """Return derivatives of the right sides by inputs of drives."""
    rows: list[dict[Hashable, Scalar]] = [{} for _ in range(d.model.size)]
    for element in d.elements:
        for (i, place), slope in element.input_slopes(d.v).items():
            rows[i][_key(d.columns_of_u[place])] = -1.0 * slope
    return rows


def _turned_round(d: Derivation, i: int, by_q: Rows, by_v: Rows) -> dict[Hashable, Scalar]:
    """Return row i of the derivatives by q and v, on the other side of the equation."""
    row: dict[Hashable, Scalar] = {}
    for x, rows in ((d.q, by_q), (d.v, by_v)):
        row |= {_key(x[j]): -1.0 * rows[i, j] for j in d.rates if (i, j) in rows}
    return row


def _written(
    d: Derivation,
    accelerations: Sequence[Hashable],
    partials: Mapping[Hashable, Mapping[Hashable, Scalar]],
    pivots: Pivots,
) -> Outputs:
    """Write three matrices, column by column; that by u is symmetric, but for prescribed ones and inputs of drives."""
    places, size = d.rates, len(d.rates)
    inputs = [_key(x[i]) for x in (d.q, d.v, d.columns_of_u) for i in places]
    rows = jacobian(d.graph, [accelerations[i] for i in places], inputs, partials)
    apart = {*d.model.prescribed, *d.drive_inputs, *d.model.states_of_drives}
    for place, i in enumerate(places):
        for other in range(place):
            if {i, places[other]}.isdisjoint(apart):
                rows[other][2 * size + place] = rows[place][2 * size + other]
    outputs = pivot_outputs(d, pivots)
    for column in range(size):
        for matrix in range(3):
            for place, row in enumerate(rows):
                outputs["out", (matrix * size + place) * size + column] = row[matrix * size + column]
    return outputs


def _key(x: Scalar) -> Hashable:
    """Return a value's index; a number stands for nothing that moves."""
    return x.index if isinstance(x, Node) else ("number", x)


def _is_short(d: Derivation) -> bool:
    """Whether the solution with M's factors takes few products: those of 2 n columns in both directions."""
    if d.followers:  # whose leaders' matrix is no tree's
        return False
    front = coordinates_in_front(d.model)
    behind = [0] * d.model.size
    for before in front:
        for i in before:
            behind[i] += 1
    total = 0
    for i, before in enumerate(front):
        whole = 1 + behind[before[-1] if before else i]
        total += 2 * len(before) * (whole + len(before) + 1 + behind[i])
    return total <= MOST_PRODUCTS


def _is_of_free_bodies(d: Derivation) -> bool:
    """Whether half of the coordinates and more are those of free bodies; never where some follow others."""
    if d.followers:
        return False
    free = bodies_apart(d.model, d.bound)
    moving = sum(len(body.active) for body, is_free in zip(d.model.bodies, free, strict=True) if is_free)
    return d.model.size <= min(2 * moving, MOST_COORDINATES)


SLOPES: Mapping[str, Variant] = {
    BY_FACTORS: Variant(_by_factors, suits=_is_short, on_demand=True),
    BY_VALUES: Variant(_by_values, suits=_is_of_free_bodies, on_demand=True),
}
