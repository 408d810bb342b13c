"""Journals in bearings of cut joints: contacts in coordinates that follow from those of the tree.

A contact feels the deviations s of the cut joint's coordinates as that of a joint feels its coordinates (``journals``);
with their derivatives J = ds/dq its rows are J^T r, its rates J v, and directions of slopes become rows J^T d.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from eomgen.robot.parameter_names import CUT_BEARINGS
from eomgen.robot.value import COORDINATES

from ..tree.constraints import Closure
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, add_row, is_zero
from .cuts import ElasticLoopCoordinates
from .elastic_coordinates import ElasticCoordinate, moved_by
from .element import ForceElement, ImplicitShare, Slopes, Turn
from .journals import BearingContact, places

SparseRow = dict[int, Scalar]


@dataclass(frozen=True)
class LoopBearingContact:
    """A contact in coordinates of a cut joint, ``felt`` in their order, each with its row by the tree's coordinates."""

    touch: BearingContact
    felt: Sequence[ElasticCoordinate]

    def ahead(self, dt: Scalar) -> LoopBearingContact:
        """Return the contact where the rates lead to after dt, with the derivatives that it has here."""
        return replace(self, touch=self.touch.ahead(dt))

    def rows(self) -> SparseRow:
        """Return resisting forces by the tree's coordinates."""
        return self.of_tree(self.touch.rows())

    def directions(self, dt: Scalar, square: Scalar) -> list[tuple[SparseRow, Scalar]]:
        """Return directions of the tree's coordinates with slopes, and these, as of ``BearingContact``."""
        return [(self.of_tree(row), slope) for row, slope in self.touch.directions(dt, square)]

    def of_tree(self, rows: Mapping[int, Scalar]) -> SparseRow:
        """Map rows by the cut joint's coordinates to rows by those of the tree."""
        row: SparseRow = {}
        for k, value in rows.items():
            add_row(row, value, self.felt[k].jacobian_row)
        return row


class LoopBearingContacts(ForceElement):
    """The contacts of all journals of cut joints."""

    FAMILY: ClassVar[str] = CUT_BEARINGS

    def contacts(self, v: Sequence[Scalar]) -> list[LoopBearingContact]:
        """Give the contacts at the velocities v."""
        at, contacts = self.at, list[LoopBearingContact]()
        if not at.bound.cut_journals:
            return contacts
        members = ElasticLoopCoordinates(at).members
        by_place = {
            (coordinate.pair.number, coordinate.name): coordinate
            for coordinate in members
            if isinstance(coordinate.pair, Closure)
        }
        for number, journal in at.bound.cut_journals.items():
            felt = [by_place[number, name] for name in journal.index]
            rates = [coordinate.rate(v) for coordinate in felt]
            turns = [_turn(coordinate, at.bound.cut_offsets[number], at.sincos) for coordinate in felt]
            for place in places(journal, [coordinate.s for coordinate in felt], turns.__getitem__):
                contacts.append(LoopBearingContact(BearingContact(journal, place, rates, at.functions), felt))
        return contacts

    def _forces(self, v: Sequence[Scalar]) -> Iterator[tuple[ElasticCoordinate, Scalar]]:
        """Yield coordinates of cut joints with the forces that resist them, contact by contact."""
        for cut in self.contacts(v):
            yield from ((cut.felt[k], force) for k, force in cut.touch.rows().items())

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the contacts' forces."""
        for cut in self.contacts(v):
            yield from cut.rows().items()

    def energies(self) -> Iterator[Scalar]:
        """Give energies of the penetrations."""
        yield from (cut.touch.normal.energy for cut in self.contacts(self.at.still))

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints hold of the contacts' forces."""
        for coordinate, force in self._forces(v):
            yield from coordinate.wrenches(force)

    def wrenches_in_cuts(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give the forces on the loops' second links."""
        for coordinate, force in self._forces(v):
            assert isinstance(coordinate.pair, Closure)
            yield coordinate.pair.number, coordinate.on_second(force)

    def add_slopes(self, slopes: Slopes) -> None:
        """Add derivatives, differentiating the graph."""
        for cut in self.contacts(slopes.v):
            slopes.differentiate(cut.rows(), moved_by(cut.felt))

    def add_rows(self, share: ImplicitShare) -> None:
        """Add forces where the velocities lead to, and their slopes."""
        for cut in self.contacts(share.v):
            there = cut.ahead(share.ahead)
            share.along_all(there.rows(), there.directions)

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give the stiffness of all contacts as if they touched along x and along y."""
        for cut in self.contacts(self.at.still):
            k, first = cut.touch.journal.numbers["stiffness"], cut.touch.place.first
            for row in [cut.of_tree({i: arm[axis] for i, arm in first.items()}) for axis in (0, 1)]:
                yield from ((i, k * (arm * arm)) for i, arm in row.items())


def _turn(coordinate: ElasticCoordinate, offsets: Sequence[Scalar], sincos: Turn) -> tuple[Scalar, Scalar]:
    """Return sine and cosine of an angle's deviation; (0, 1) of what is none."""
    if coordinate.turn is None:
        return 0.0, 1.0
    offset = offsets[COORDINATES.index(coordinate.name)]
    if is_zero(offset):
        return coordinate.turn
    (s, c), (sine, cosine) = coordinate.turn, sincos(offset)
    return s * cosine - c * sine, c * cosine + s * sine
