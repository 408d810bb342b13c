"""Bushings: each of the six coordinates e of its second frame as seen from its first is resisted by k e + c e_dot.

Or by matrices between them (``CoupledCoordinates``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import ClassVar

from eomgen.names import component_name
from eomgen.robot.elements import MATRICES, Bushing
from eomgen.robot.elements.joint_damping import SHARES

from ..tree.bound import BoundLaw
from ..tree.constraints import FramePair
from ..tree.spatial import Scalar, is_zero
from .elastic_coordinates import CoupledCoordinates, ElasticCoordinate, ElasticCoordinates
from .element import Deflection
from .relative_placement import coordinates_of


class Bushings(ElasticCoordinates):
    """All bushings."""

    FAMILY: ClassVar[str] = Bushing.TABLE
    TURNS: ClassVar[bool] = True  # no joint bounds how their frames turn

    @cached_property
    def members(self) -> Sequence[ElasticCoordinate]:
        """The coordinates where q is, bushing by bushing."""
        return [coordinate for members in self._by_bushing.values() for coordinate in members.values()]

    @cached_property
    def coupled(self) -> Sequence[CoupledCoordinates]:
        """The coordinates of bushings with matrices."""
        coupled = list[CoupledCoordinates]()
        for bushing in self.at.bound.elements[self.FAMILY]:
            stiffness, damping = (_below(key, bushing.numbers) for key in MATRICES)
            if any("." in key or key in SHARES for key in (*stiffness, *damping)):
                coupled.append(CoupledCoordinates.of(self._by_bushing[bushing.name], stiffness, damping))
        return coupled

    @cached_property
    def _by_bushing(self) -> dict[str, dict[str, ElasticCoordinate]]:
        """The coordinates where q is by the bushing's name and theirs."""
        at, by_bushing, parameters = self.at, dict[str, dict[str, ElasticCoordinate]](), self.at.model.parameters
        for bushing in at.bound.elements[self.FAMILY]:
            at.note(f"{bushing.name}: bushing between {bushing.links[0]} and {bushing.links[1]}")
            where = component_name(self.FAMILY, bushing.name)
            pair = FramePair(at, bushing.ends, where)
            known = {key: component_name(where, key) for key in bushing.numbers}
            given = {key: parameters[name] for key, name in known.items() if name in parameters}
            members = by_bushing[bushing.name] = {}
            names = list(Bushing.slopes(given))
            for name, (value, direction, _, row) in coordinates_of(pair, names, at.functions).items():
                law = BoundLaw(bushing.numbers[f"stiffness.{name}"], bushing.numbers[f"damping.{name}"])
                full_name = component_name(bushing.name, name)
                described = given.get(f"stiffness.{name}", 0.0)
                members[name] = ElasticCoordinate(value, row, law, described, pair, direction, full_name)
        return by_bushing

    def deflections(self, v: Sequence[Scalar]) -> Iterator[Deflection]:
        """Give all six coordinates with a force of each bushing."""
        for coordinate in self.members:
            yield Deflection(coordinate.name, coordinate.s, self.force_on(coordinate, v), coordinate.jacobian_row)


def _below(key: str, numbers: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Return the numbers below a key that are not 0, without the key."""
    return {name[len(key) + 1 :]: x for name, x in numbers.items() if name.startswith(f"{key}.") and not is_zero(x)}
