"""Journals in bearings of cut joints: contacts in coordinates that follow from those of the tree.

A contact feels the deviations s of the cut joint's coordinates as that of a joint feels its coordinates (``journals``);
with their derivatives J = ds/dq its rows are J^T r, its rates J v, and directions of slopes become rows J^T d.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from eomgen.robot.value import COORDINATES

from ..tree.bound import Bound
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, is_zero
from .cuts import Deviating
from .journals import Touch, Turn, places
from .scalar_functions import Functions

Arms = dict[int, Scalar]


@dataclass(frozen=True)
class CutTouch:
    """A contact in coordinates of a cut joint, ``felt`` in their order, with the tree's indices in its arms."""

    touch: Touch
    felt: Sequence[Deviating]

    def ahead(self, dt: Scalar) -> CutTouch:
        """The contact where the rates lead to after dt, with the derivatives that it has here."""
        return replace(self, touch=self.touch.ahead(dt))

    def rows(self) -> Arms:
        """Resisting forces by the tree's coordinates."""
        return self._of_tree(self.touch.rows())

    def moved_by(self) -> list[int]:
        """Indices of the coordinates on which its forces depend."""
        return list(dict.fromkeys(i for own in self.felt for i in own.arms))

    def directions(self, dt: Scalar, square: Scalar) -> list[tuple[Arms, Scalar]]:
        """Directions of the tree's coordinates in which there are slopes, and these, as of ``Touch``."""
        return [(self._of_tree(arms), slope) for arms, slope in self.touch.directions(dt, square)]

    def arms(self) -> tuple[Arms, Arms]:
        """Derivatives of its place along x and along y by the tree's coordinates."""
        first = self.touch.place.first
        return tuple(self._of_tree({k: arm[axis] for k, arm in first.items()}) for axis in (0, 1))  # type: ignore[return-value]

    def wrenches(self) -> Iterator[tuple[int, Wrench]]:
        """Wrenches of the tree's joints that hold the resisting forces, as of ``Deviating``."""
        for k, force in self.touch.rows().items():
            yield from self.felt[k].wrenches(force)

    def on_second(self) -> Iterator[tuple[int, Wrench]]:
        """The loop's number and the wrench on its second link, force by force, in the common body's axes."""
        for k, force in self.touch.rows().items():
            own = self.felt[k]
            assert own.closure is not None
            assert own.direction is not None
            yield own.closure.number, own.direction.wrench(-1.0 * force)

    def _of_tree(self, rows: Mapping[int, Scalar]) -> Arms:
        found: Arms = {}
        for k, value in rows.items():
            for i, arm in self.felt[k].arms.items():
                found[i] = found.get(i, 0.0) + value * arm
        return found


def cut_touches(
    bound: Bound,
    deviating: Sequence[Deviating],
    v: Sequence[Scalar],
    sincos: Turn,
    f: Functions,
) -> Iterator[CutTouch]:
    """The contacts of all journals of cut joints.

    Args:
        deviating: coordinates of cut joints with a force, those that journals feel among them.
    """
    by_place = {(own.closure.number, own.name): own for own in deviating if own.closure is not None}
    for number, journal in bound.cut_journals.items():
        felt = [by_place[number, name] for name in journal.index]
        rates = [own.rate(v) for own in felt]
        turns = [_turn(own, bound.cut_offsets[number], sincos) for own in felt]
        for place in places(journal, [own.s for own in felt], turns.__getitem__):
            yield CutTouch(Touch(journal, place, rates, f), felt)


def _turn(own: Deviating, offsets: Sequence[Scalar], sincos: Turn) -> tuple[Scalar, Scalar]:
    """Sine and cosine of an angle's deviation; (0, 1) of what is none."""
    if own.turn is None:
        return 0.0, 1.0
    offset = offsets[COORDINATES.index(own.name)]
    if is_zero(offset):
        return own.turn
    (s, c), (sine, cosine) = own.turn, sincos(offset)
    return s * cosine - c * sine, c * cosine + s * sine
