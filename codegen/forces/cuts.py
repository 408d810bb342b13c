"""Forces in the six coordinates of cut joints, and of elastic couplings.

A coordinate e of a cut joint's frame b as seen from a with a force keeps to its offset: it deviates by s = e - offset.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import ClassVar

from eomgen.names import parameter_name
from eomgen.robot.elements.joint_damping import JOINT_DAMPING
from eomgen.robot.elements.joint_stiffness import JOINT_STIFFNESS
from eomgen.robot.laws import stiffness_of
from eomgen.robot.parameter_names import CUT_MOTIONS, CUT_STIFFNESSES, CUTS
from eomgen.robot.value import COORDINATES

from ..tree.bound import Bound
from ..tree.constraints import Closure
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar
from .elastic_coordinates import CoupledCoordinates, ElasticCoordinate, ElasticCoordinates
from .internal_states.formulas import StateLaw, state_laws
from .relative_placement import coordinates_of
from .scalar_functions import Functions


class ElasticLoopCoordinates(ElasticCoordinates):
    """All coordinates of cut joints with a force, then elastic couplings, in the order of ``Model.cut_laws``."""

    FAMILY: ClassVar[str] = CUTS

    @cached_property
    def members(self) -> Sequence[ElasticCoordinate]:
        """The coordinates where q is."""
        at, members = self.at, list[ElasticCoordinate]()
        if not (at.bound.cut_laws or at.bound.couplings):
            return members
        for closure in at.closures():
            names = [name for name in COORDINATES if (closure.number, name) in at.bound.cut_laws]
            if names:
                members += _of_loop(at.bound, closure, names, at.functions)
        for coupling in at.bound.couplings:
            if coupling.law is not None:
                members.append(ElasticCoordinate(coupling.residual(at.q), dict(coupling.jacobian_row), coupling.law))
        laws = zip(members, self._described(), self._state_laws(members), strict=True)
        return [replace(coordinate, described=k, state_laws=states) for coordinate, k, states in laws]

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell whether numbers are those of its coordinates or of matrices between them."""
        return family in (cls.FAMILY, CUT_STIFFNESSES, CUT_MOTIONS)

    @cached_property
    def coupled(self) -> Sequence[CoupledCoordinates]:
        """The coordinates of cut joints with matrices."""
        matrices, coupled = self.at.bound.cut_matrices, list[CoupledCoordinates]()
        for number in dict.fromkeys(number for number, _ in matrices):
            members = {x.name: x for x in self.members if isinstance(x.pair, Closure) and x.pair.number == number}
            tables = [matrices.get((number, table)) for table in (JOINT_STIFFNESS, JOINT_DAMPING)]
            stiffness, damping = ({} if x is None else x.numbers for x in tables)
            coupled.append(CoupledCoordinates.of(members, stiffness, damping))
        return coupled

    def _described(self) -> Iterator[float]:
        """Yield stiffnesses by the description's numbers."""
        for owner, name, coordinate in self.at.model.cut_laws:
            path = ("loops", owner, name) if name else ("couplings", owner)
            k = self.at.model.parameters.get(parameter_name(*path, "stiffness"), 0.0)
            yield stiffness_of({"stiffness": k, **coordinate.law()}, tuple(x for x, _ in coordinate.curve or ()))

    def _state_laws(self, members: Sequence[ElasticCoordinate]) -> Iterator[tuple[StateLaw, ...]]:
        """Yield the laws with internal states of each."""
        model, bound = self.at.model, self.at.bound
        for coordinate, (owner, name, _) in zip(members, model.cut_laws, strict=True):
            prefix = parameter_name(*(("loops", owner, name) if name else ("couplings", owner)))
            yield tuple(state_laws(model, bound, prefix, coordinate.law.numbers))

    def wrenches_in_cuts(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give the forces on the loops' second links."""
        for coordinate, force in self.forces(v):
            if isinstance(coordinate.pair, Closure):
                yield coordinate.pair.number, coordinate.on_second(force)


def _of_loop(bound: Bound, closure: Closure, names: Sequence[str], f: Functions) -> Iterator[ElasticCoordinate]:
    offset = bound.cut_offsets[closure.number]
    members: dict[str, ElasticCoordinate] = {}
    for name, (value, direction, turn, row) in coordinates_of(closure, names, f).items():
        law = bound.cut_laws[closure.number, name]
        s = value - offset[COORDINATES.index(name)]
        members[name] = ElasticCoordinate(s, row, law, pair=closure, direction=direction, name=name, turn=turn)
    for coordinate in members.values():
        yield replace(coordinate, carriers=tuple(members[COORDINATES[other]] for other in coordinate.law.carriers))
