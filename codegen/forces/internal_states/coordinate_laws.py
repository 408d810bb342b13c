"""Laws with internal states on coordinates, and between motors and joints: rows, slopes, energies and implicit shares.

A state is the velocity of an inertia w without a link, and minus w times its rate is the force that resists it: what it
stores is w z^2 / 2, so that powers of all generalized forces together are those that the law takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

from ...tree.spatial import Scalar, along
from ..element import ForceRows, ImplicitShare, Slopes, SparseRow, StateSite
from .formula import StateEffect
from .formulas import StateLaw, state_laws


class InternalStateLaws(ForceRows):
    """Laws with internal states of all coordinates and transmissions that have such."""

    @cached_property
    def laws(self) -> list[tuple[StateSite, StateLaw]]:
        """The laws of coordinates in their order, then of transmissions, and where they act."""
        model, bound = self.at.model, self.at.bound
        laws = list[tuple[StateSite, StateLaw]]()
        for i, name in enumerate(model.coordinates):
            for law in state_laws(model, bound, f"joints.{name}", bound.laws[i].numbers):
                laws.append((StateSite({i: 1.0}, law.states, coordinate=i), law))
        for motor, between in bound.transmissions.items():
            row: SparseRow = {motor: between.inverse_ratio, between.principal: -1.0}
            for law in state_laws(model, bound, f"joints.{model.coordinates[motor]}", between.law.numbers):
                laws.append((StateSite(row, law.states, motor=motor), law))
        return laws

    def energies(self) -> Iterator[Scalar]:
        """Give what deviations store."""
        for _, effect in self._effects(self.at.q, self.at.still):
            yield effect.energy

    def state_energies(self, v: Sequence[Scalar]) -> Iterator[Scalar]:
        """Give what states store, those of loop joints and couplings among them."""
        model = self.at.model
        for k, x in enumerate(model.states, len(model.coordinates)):
            if x.state.inertia is not None:
                yield 0.5 * self.at.bound.armature[k] * (v[k] * v[k])

    def add_slopes(self, slopes: Slopes) -> None:
        """Add slopes of forces and of states' rates."""
        for at, effect in self._effects(slopes.q, slopes.v):
            by, states = effect.slopes, at.states
            for i, arm in at.row.items():
                for j, other in at.row.items():
                    slopes.add((i, j), by.f_s * arm * other, by.f_v * arm * other)
                for k, w, f_z, g_s, g_v in zip(states, by.inertias, by.f_z, by.g_s, by.g_v, strict=True):
                    slopes.add((i, k), 0.0, f_z * arm)
                    slopes.add((k, i), -1.0 * (w * g_s) * arm, -1.0 * (w * g_v) * arm)
            for (row, column), g_z in by.g_z.items():
                slopes.add((states[row], states[column]), 0.0, -1.0 * (by.inertias[row] * g_z))

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of forces and of states' rates of coordinates."""
        for at, effect in self._effects(share.q, share.v):
            if at.motor is None:
                share.in_internal_states(at, effect.slopes)

    def add_rows(self, share: ImplicitShare) -> None:
        """Add slopes of forces and of states' rates of transmissions."""
        for at, effect in self._effects(share.q, share.v) if self.at.bound.transmissions else ():
            if at.motor is not None:
                share.in_internal_states(at, effect.slopes)

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give forces along the deflections, and minus the rates of states times their inertias."""
        for at, effect in self._effects(q, v):
            yield from ((i, effect.force * arm) for i, arm in at.row.items())
            yield from effect.state_rows(at.states)

    def _effects(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> list[tuple[StateSite, StateEffect]]:
        f = self.at.functions
        return [(at, law.effect(along(at.row, q), along(at.row, v), v, f)) for at, law in self.laws]
