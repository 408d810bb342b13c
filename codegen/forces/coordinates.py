"""Forces of coordinates themselves, Q_P of eq. (13): linear in coordinate and rate, and what ``laws`` add to them.

The coordinates e of a link's modes are resisted by K e + D e'.  The diagonals are stiffness and damping of single
coordinates, which may be parameters; what is beside them couples coordinates of one body, and is eliminated with its
modes.  Neither is definite by itself, their sum is never negative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import ClassVar

from eomgen.names import kind_of
from eomgen.robot.parameter_names import JOINTS
from eomgen.robot.value import MOTOR

from ..tree.bound import BoundModalCouplings
from ..tree.composite import Rows
from ..tree.spatial import Scalar, is_zero
from .element import ForceRows, ImplicitShare, Slopes
from .joint_stiffness import CoordinateMatrix
from .laws import Effect, bearing_load, effect, without_friction


class CoordinateLaws(ForceRows):
    """Springs, dampers and laws of all coordinates, those of motors at their shafts."""

    FAMILY: ClassVar[str] = JOINTS

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell whether numbers are those of coordinates and no motor's."""
        return super().has(family, owner) and kind_of(owner) != MOTOR

    def energies(self) -> Iterator[Scalar]:
        """Give energies of linear springs, then of laws."""
        q = self.at.q
        for law, s in zip(self.at.bound.laws, q, strict=True):
            yield 0.5 * law.stiffness * s * s
        yield from (law.energy for law in self._effects(q, self.at.still).values())

    def add_slopes(self, slopes: Slopes) -> None:
        """Add slopes of laws; those of straight lines are in ``residual_derivatives``."""
        bound, q, v, f = self.at.bound, slopes.q, slopes.v, self.at.functions
        effects = self._effects(q, v)
        for i, law in effects.items():
            slopes.add((i, i), law.by_s, law.by_rate)
        for i, law in effects.items():
            others = bound.laws[i].carriers
            carried = [self._without_friction(j, q, v) for j in others]
            for j, one, slope in zip(others, carried, bearing_load(carried, f)[1] if others else (), strict=True):
                slopes.add((i, j), law.by_load * slope * one.by_s, law.by_load * slope * one.by_v)

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of straight lines and laws."""
        for i, law in enumerate(self.at.bound.laws):
            share.on_coordinate(i, law.stiffness, law.damping)
        for i, acting in self._effects(share.q, share.v).items():
            share.bend(i, acting)

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give -Q_P."""
        laws = self.at.bound.laws
        yield from enumerate([x.stiffness * s + x.damping * rate for x, s, rate in zip(laws, q, v, strict=True)])
        yield from ((i, law.force) for i, law in self._effects(q, v).items())

    def _effects(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> dict[int, Effect]:
        """Return effects of laws beyond eq. (13), by the index of the coordinate."""
        effects, f = dict[int, Effect](), self.at.functions
        for i, law in enumerate(self.at.bound.laws):
            if law.numbers:
                load = (
                    bearing_load([self._without_friction(j, q, v) for j in law.carriers], f)[0] if law.carriers else 0.0
                )
                effects[i] = effect(law, q[i], v[i], f, load)
        return effects

    def _without_friction(self, j: int, q: Sequence[Scalar], v: Sequence[Scalar]) -> Effect:
        """Return the effect, without friction, of a coordinate that presses on others."""
        return without_friction(self.at.bound.laws[j], q[j], v[j], self.at.functions)


class ModalCouplings(ForceRows):
    """Entries of all links' modal stiffness and damping beside the diagonals."""

    @cached_property
    def matrices(self) -> list[tuple[CoordinateMatrix, CoordinateMatrix]]:
        """Stiffness and damping, link by link."""
        return [(_matrix(x.stiffness), _matrix(x.damping)) for x in self.at.bound.modal_couplings]

    def energies(self) -> Iterator[Scalar]:
        """Give K_kj e_k e_j."""
        q = self.at.q
        for K, _ in self.matrices:
            yield from (entry * (q[i] * q[j]) for (i, j), entry in K.entries.items())

    def add_slopes(self, slopes: Slopes) -> None:
        """Add K and D."""
        for K, D in self.matrices:
            K.add_to(slopes.by_q)
            D.add_to(slopes.by_v)

    def add_blocks(self, share: ImplicitShare) -> None:
        """Add c D + c^2 K; the diagonals, by which it is never negative, are those of coordinates."""
        for couplings in self.at.bound.modal_couplings:
            share.in_joint(partial(_slopes, couplings))

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give K e + D e'."""
        for (K, D), couplings in zip(self.matrices, self.at.bound.modal_couplings, strict=True):
            self.at.note(f"{couplings.link}: its modes work on each other")
            yield from K.times(q).items()
            yield from D.times(v).items()


def _matrix(entries: Mapping[tuple[int, int], Scalar]) -> CoordinateMatrix:
    return CoordinateMatrix({pair: entry for pair, entry in entries.items() if not is_zero(entry)})


def _slopes(couplings: BoundModalCouplings, c: Scalar, square: Scalar) -> Rows:
    """Return c D + square K above the diagonal."""
    return {pair: c * couplings.damping[pair] + square * entry for pair, entry in couplings.stiffness.items()}
