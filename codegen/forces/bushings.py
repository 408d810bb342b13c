"""Bushings: each of the six coordinates e of its second frame as seen from its first is resisted by k e + c e_dot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import ClassVar

from eomgen.names import component_name
from eomgen.robot.elements import Bushing

from ..tree.bound import BoundLaw
from ..tree.constraints import FramePair
from ..tree.spatial import Scalar
from .elastic_coordinates import ElasticCoordinate, ElasticCoordinates
from .element import Deflection
from .relative_placement import coordinates_of


class Bushings(ElasticCoordinates):
    """All bushings."""

    FAMILY: ClassVar[str] = Bushing.TABLE

    @cached_property
    def members(self) -> Sequence[ElasticCoordinate]:
        """The coordinates where q is, bushing by bushing."""
        at, members, parameters = self.at, list[ElasticCoordinate](), self.at.model.parameters
        for bushing in at.bound.elements[self.FAMILY]:
            at.note(f"{bushing.name}: bushing between {bushing.links[0]} and {bushing.links[1]}")
            where = component_name(self.FAMILY, bushing.name)
            pair = FramePair(at.model, at.joints, bushing.ends, where)
            known = {key: component_name(where, key) for key in bushing.numbers}
            slopes = Bushing.slopes({key: parameters[name] for key, name in known.items() if name in parameters})
            for name, (value, direction, _, row) in coordinates_of(pair, list(slopes), at.functions).items():
                law = BoundLaw(bushing.numbers[f"stiffness.{name}"], bushing.numbers[f"damping.{name}"])
                full_name = component_name(bushing.name, name)
                members.append(ElasticCoordinate(value, row, law, slopes[name][0], pair, direction, full_name))
        return members

    def deflections(self, v: Sequence[Scalar]) -> Iterator[Deflection]:
        """Give all six coordinates with a force of each bushing."""
        for coordinate in self.members:
            yield Deflection(
                coordinate.name, coordinate.s, coordinate.resists(v, self.at.functions).force, coordinate.jacobian_row
            )
