"""Internal states, eliminated before motors and joints: blocks of an implicit method's matrix, one for each law.

A law with the resisting force f(s, v, z) along the row J = ds/dq, and the rates g(s, v, z) of its states, couples
coordinates to these, whose inertias w make w z^2 / 2 the energy that they store and whose accelerations are z' = a_z:

    M a + J^T ((c f_v + c^2 f_s) J a + c f_z a_z) = r,        w ((1 - c g_z) a_z - c (g_v + c g_s) J a) = r_z.

With E = (1 - c g_z)^-1, taking a_z out leaves J^T (c f_v + c^2 (f_s + f_z E (g_v + c g_s))) J in the matrix, of a law
on a coordinate on the diagonal alone, and J^T c f_z E r_z / w less on the right side.  In forward dynamics c is 0.  No
row of a loop or spring pushes a state.

E is found without a choice of pivots: 1 - c g_z has none that vanish where the leading blocks of g_z are stable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from eomgen.robot.model import Model

from ..forces.element import StateSlopes
from ..tree.composite import Rows
from ..tree.spatial import Scalar, along, is_zero


def _inverse(law: StateSlopes, c: Scalar) -> Rows:
    """Return the entries of E = (1 - c g_z)^-1 that do not vanish."""
    k = len(law.inertias)
    left: list[dict[int, Scalar]] = [{i: 1.0} for i in range(k)]
    right: list[dict[int, Scalar]] = [{i: 1.0} for i in range(k)]
    for (i, j), slope in law.g_z.items():
        left[i][j] = left[i].get(j, 0.0) - c * slope
    for p in range(k):
        inverse = 1.0 / left[p][p]
        right[p] = {j: x * inverse for j, x in right[p].items()}
        left[p] = {j: x * inverse for j, x in left[p].items() if j > p}
        for i in range(k):
            factor = left[i].get(p, 0.0)
            if i == p or is_zero(factor):
                continue
            for into, row in ((left[i], left[p]), (right[i], right[p])):
                for j, x in row.items():
                    into[j] = into.get(j, 0.0) - factor * x
    return {(i, j): x for i in range(k) for j, x in right[i].items()}


def share(law: StateSlopes, c: Scalar, square: Scalar) -> Scalar:
    """Return c f_v + c^2 (f_s + f_z E (g_v + c g_s)): the law's share in a matrix once the states are out."""
    whole = c * law.f_v + square * law.f_s
    for (i, j), x in _inverse(law, c).items():
        whole = whole + square * (law.f_z[i] * (law.g_v[j] + c * law.g_s[j])) * x
    return whole


@dataclass(frozen=True)
class StateRow:
    """a_k = sum of inverse[j] r_j + gain J a, of a state k of a law along the row J; ``coupling`` is c f_z."""

    along: Mapping[int, Scalar]
    inverse: Mapping[int, Scalar]
    gain: Scalar
    coupling: Scalar

    def free(self, right: Sequence[Scalar]) -> Scalar:
        """Return the rate where the law's deviation stays."""
        rate: Scalar = 0.0
        for j, x in self.inverse.items():
            rate = rate + x * right[j]
        return rate

    def gained(self, accelerations: Sequence[Scalar]) -> Scalar:
        """Return what accelerations add to the rate."""
        return self.gain * along(self.along, accelerations)


def state_rows(
    row: Mapping[int, Scalar], states: Sequence[int], law: StateSlopes, c: Scalar, acts: Scalar
) -> dict[int, StateRow]:
    """Return the rows of a law's states, by their indices, with a step c.

    Args:
        row: J, along which the law acts, by the coordinates' indices.
        states: indices of the states.
        law: its slopes.
        c: the step.
        acts: 1, or 0 where its force is left out of the matrix.
    """
    by_row: list[dict[int, Scalar]] = [{} for _ in states]
    for (i, j), x in _inverse(law, c).items():
        by_row[i][j] = x
    rows = {}
    for place, k in enumerate(states):
        inverse = {states[j]: x * (1.0 / law.inertias[j]) for j, x in by_row[place].items()}
        gain: Scalar = 0.0
        for j, x in by_row[place].items():
            gain = gain + x * (c * (law.g_v[j] + c * law.g_s[j]))
        rows[k] = StateRow(row, inverse, gain, acts * (c * law.f_z[place]))
    return rows


@dataclass(frozen=True)
class ScalarSlopes:
    """Slopes that are eliminated before the tree: of transmissions by their motors, rows of states by their indices."""

    transmissions: Mapping[int, Scalar] = field(default_factory=dict)
    states: Mapping[int, StateRow] = field(default_factory=dict)


class States:
    """Rows of the internal states; ``drives`` (n,) are those of what is left."""

    def __init__(
        self, model: Model, inertias: Sequence[Scalar], drives: Sequence[Scalar], rows: Mapping[int, StateRow]
    ) -> None:
        """Take the states out.

        Args:
            model: whose states stand behind its coordinates.
            inertias: of states and, before them, coordinates.
            drives: right sides, (n,); of a prescribed coordinate its acceleration.
            rows: of an implicit method, by the index of the state; none in forward dynamics.
        """
        first = len(model.coordinates)
        self.drives, self.rows = list(drives), {k: rows.get(k) for k in range(first, model.size)}
        self.free = {
            k: (1.0 / inertias[k]) * drives[k] if row is None else row.free(drives) for k, row in self.rows.items()
        }
        for k, row in rows.items():
            for i, arm in row.along.items():
                if i not in model.prescribed:  # there the right side is the acceleration itself
                    self.drives[i] = self.drives[i] - arm * (row.coupling * self.free[k])

    def release(self, accelerations: list[Scalar], pivots: list[tuple[Scalar, Scalar]]) -> None:
        """Put rates of the states into the accelerations of the tree, and pivots that never vanish."""
        for k, row in self.rows.items():
            free = self.free[k]
            accelerations[k] = free if row is None else free + row.gained(accelerations)
            pivots[k] = (1.0, 1.0)

    def released(self, accelerations: list[Scalar]) -> list[Scalar]:
        """Write into accelerations by forces along rows what the states' rates change by; return them."""
        for k, row in self.rows.items():
            accelerations[k] = 0.0 if row is None else row.gained(accelerations)
        return accelerations
