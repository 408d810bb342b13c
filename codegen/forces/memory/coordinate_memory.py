"""Laws with states on coordinates: what their formulas give becomes rows, slopes, energies and implicit shares.

A state is the velocity of an inertia w without a link, and minus w times its rate is the force that resists it: what it
stores is w z^2 / 2, so that powers of all generalized forces together are those that the law takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import ClassVar

from eomgen.robot.parameter_names import JOINTS

from ...tree.spatial import Scalar
from ..element import ForceElement, ImplicitShare, Slopes
from .bristles import lugre
from .formula import Remembered, StateEffect

Acting = list[tuple[int, tuple[int, ...], StateEffect]]  # index of the coordinate, those of the states, effect

STATE_FORMULAS: Mapping[str, Callable[[Remembered], StateEffect]] = {"friction": lugre}


class MemoryLaws(ForceElement):
    """Laws with states of all coordinates that have such."""

    FAMILY: ClassVar[str] = JOINTS

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell of no numbers: they are those of coordinates' laws."""
        return False

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give forces on coordinates, and minus the rates of their states times the inertias of these."""
        yield from self._rows(self.at.q, v)

    def energies(self) -> Iterator[Scalar]:
        """Give what deviations store."""
        for _, _, law in self._laws(self.at.q, self.at.still):
            yield law.energy

    def state_energies(self, v: Sequence[Scalar]) -> Iterator[Scalar]:
        """Give what states store."""
        model = self.at.model
        for k, (_, _, state) in enumerate(model.states, len(model.coordinates)):
            if state.inertia is not None:
                yield 0.5 * self.at.bound.armature[k] * (v[k] * v[k])

    def add_slopes(self, slopes: Slopes) -> None:
        """Add slopes of forces and of states' rates."""
        for i, states, law in self._laws(slopes.q, slopes.v):
            by = law.slopes
            slopes.add((i, i), by.f_s, by.f_v)
            for k, w, f_z, g_s, g_v in zip(states, by.inertias, by.f_z, by.g_s, by.g_v, strict=True):
                slopes.add((i, k), 0.0, f_z)
                slopes.add((k, i), -1.0 * (w * g_s), -1.0 * (w * g_v))
            for (row, column), g_z in by.g_z.items():
                slopes.add((states[row], states[column]), 0.0, -1.0 * (by.inertias[row] * g_z))

    def advance(self, share: ImplicitShare) -> None:
        """Push forces, and what drives the states."""
        for i, force in self._rows(share.q, share.v):
            share.push(i, force)

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of forces and of states' rates."""
        for i, states, law in self._laws(share.q, share.v):
            share.in_memory(i, states, law.slopes)

    def _rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        for i, states, law in self._laws(q, v):
            yield i, law.force
            for k, w, rate in zip(states, law.slopes.inertias, law.rates, strict=True):
                yield k, -1.0 * (w * rate)

    def _laws(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Acting:
        bound, f, acting = self.at.bound, self.at.functions, Acting()
        for name, formula in STATE_FORMULAS.items():
            for i, states in self.at.model.remembering.get(name, {}).items():
                z, inertias = [v[k] for k in states], [bound.armature[k] for k in states]
                acting.append((i, states, formula(Remembered(bound.laws[i].numbers, q[i], v[i], z, inertias, f))))
        return acting
