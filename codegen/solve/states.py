"""States of laws, eliminated before motors and joints: their rows of an implicit method's matrix are scalars.

A law with the resisting force f(v, z) and the rate g(v, z) of its state couples its coordinate i to the state k, whose
inertia w makes w z^2 / 2 the energy that it stores and whose acceleration is z':

    (M a)_i + c (f_v a_i + f_z a_k) = r_i,        w ((1 - c g_z) a_k - c g_v a_i) = r_k,

and taking a_k out leaves c f_v + c^2 f_z g_v / (1 - c g_z) on the diagonal of i and c f_z r_k / (w (1 - c g_z)) less on
its right side.  In forward dynamics c is 0.  No row of a loop or spring pushes a state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from eomgen.robot.model import Model

from ..tree.spatial import Scalar


class Slopes(Protocol):
    """Slopes of a law that its state's row takes, and the state's inertia."""

    @property
    def f_z(self) -> Scalar:
        """Of the force by the state."""

    @property
    def g_v(self) -> Scalar:
        """Of the state's rate by the coordinate's."""

    @property
    def g_z(self) -> Scalar:
        """Of the state's rate by the state."""

    @property
    def inertia(self) -> Scalar:
        """The state stores inertia z^2 / 2."""


@dataclass(frozen=True)
class StateRow:
    """a_k = inverse r_k + gain a_i, of a state k of a law on coordinate i; ``coupling`` is c f_z."""

    coordinate: int
    inverse: Scalar
    gain: Scalar
    coupling: Scalar

    @classmethod
    def of(cls, i: int, law: Slopes, c: Scalar, acts: Scalar) -> StateRow:
        """Return the row of a law with a step c; ``acts``: 1, or 0 where its force is left out of the matrix."""
        inverse = 1.0 / (1.0 - c * law.g_z)
        return cls(i, inverse * (1.0 / law.inertia), inverse * (c * law.g_v), acts * (c * law.f_z))


@dataclass(frozen=True)
class ScalarSlopes:
    """Slopes that are eliminated before the tree: of transmissions by their motors, rows of states by their indices."""

    transmissions: Mapping[int, Scalar] = field(default_factory=dict)
    states: Mapping[int, StateRow] = field(default_factory=dict)


class States:
    """Rows of the states of laws; ``drives`` (n,) are those of what is left."""

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
        self.inertias = inertias
        self.drives, self.rows = list(drives), {k: rows.get(k) for k in range(first, model.size)}
        for k, row in rows.items():
            if row.coordinate not in model.prescribed:  # there the right side is the acceleration itself
                i = row.coordinate
                self.drives[i] = self.drives[i] - row.coupling * (row.inverse * drives[k])

    def release(self, accelerations: list[Scalar], pivots: list[tuple[Scalar, Scalar]]) -> None:
        """Put rates of the states into the accelerations of the tree, and pivots that never vanish."""
        for k, row in self.rows.items():
            inverse = 1.0 / self.inertias[k] if row is None else row.inverse
            free = inverse * self.drives[k]
            accelerations[k] = free if row is None else free + row.gain * accelerations[row.coordinate]
            pivots[k] = (1.0, 1.0)

    def released(self, accelerations: list[Scalar]) -> list[Scalar]:
        """Write into accelerations by forces along rows what the states' rates change by; return them."""
        for k, row in self.rows.items():
            accelerations[k] = 0.0 if row is None else row.gain * accelerations[row.coordinate]
        return accelerations
