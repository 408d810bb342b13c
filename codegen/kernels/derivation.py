"""One kernel's graph with a model bound in it: where every program begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from eomgen.robot.model import Model, turned_name, with_offset_angles

from ..forces.cut_journals import CutTouch, cut_touches
from ..forces.cuts import Deviating, deviating
from ..forces.joint_damping import Damper, dampers
from ..forces.journals import Touch, touches
from ..forces.rows import resisting_rows
from ..forces.scalar_functions import Functions
from ..forces.springs import Line, lines
from ..program.ir import Graph, Value
from ..program.passes import PARAMETERS
from ..tree.bound import Bound, bind
from ..tree.composite import Rows, mass_matrix
from ..tree.constraints import Closure, closures
from ..tree.followers import Followers
from ..tree.frames import choose_frames
from ..tree.frozen_joints import JointGeometry, geometry
from ..tree.recursion import inertial_rows
from ..tree.regrouping import regroup
from ..tree.spatial import Scalar

Outputs = dict[tuple[str, int], Value]


class Derivation:
    """One kernel's graph with the model's numbers, inputs and joint transforms bound in it.

    ``regrouped``: with the frames and pseudo-inertias that cost least (``choose_frames``, ``regroup``).

    ``dtype``: of the numbers that the C computes with.

    ``turned``: joints that turn freely read how they are turned, behind the parameters (``Model.turning``); ``turns``
    is how many of them there are.

    An angle that is not active but has an offset is a coordinate here whose q, v and a are zero; ``own`` are the places
    of the coordinates that kernels know, and what is written leaves the others out.  ``described`` is the model without
    such angles.

    Coordinates that follow others are coordinates here, too, and no inputs: ``followers`` moves them after their
    leaders, and maps what is written.
    """

    def __init__(self, model: Model, *, regrouped: bool = True, dtype: str = "float64", turned: bool = False) -> None:
        self.graph, self.dtype = Graph(), dtype
        self.described = model
        self.model, self.own = with_offset_angles(model)
        turns = [turned_name(model.bodies[k].joint) for k in model.turning] if turned else []
        self.turns = len(turns)
        slots = {name: slot for slot, name in enumerate((*model.parameters, *turns))}

        def value(name: str, number: float) -> Scalar:
            return self.graph.input(PARAMETERS, slots[name]) if name in slots else number

        self.q, self.v, self.a, self.u = (self._inputs(name) for name in "qvau")
        bound = bind(self.model, value, self.graph.sincos)
        self.followers = Followers(self.model, self.described, bound)
        self.followers.follow(self.q, positions=True)
        for x in (self.v, self.a):
            self.followers.follow(x)
        self.bound: Bound = regroup(self.model, choose_frames(self.model, bound)) if regrouped else bound
        self.joints: list[JointGeometry] = geometry(self.model, self.bound, self.q, self.graph.sincos)
        self.still: list[Scalar] = [0.0] * self.model.size
        self.functions = Functions(self.graph.call)

    def _inputs(self, name: str) -> list[Scalar]:
        found: list[Scalar] = [0.0] * self.model.size
        for place, index in enumerate(self.own):
            found[index] = self.graph.input(name, place)
        return found

    def vector(self, values: Sequence[Scalar]) -> Outputs:
        """A force per coordinate; those on followers act on their leaders."""
        return self.motion(self.followers.gather(values))

    def motion(self, values: Sequence[Scalar]) -> Outputs:
        """A velocity, acceleration or other change per coordinate."""
        return vector([values[i] for i in self.own])

    def rows(self, rows: Sequence[Mapping[int, Scalar]]) -> Outputs:
        """Derivatives of values by the coordinates, value by value; an absent one is zero."""
        found = [self.followers.row(row) for row in rows]
        return vector([row.get(i, 0.0) for row in found for i in self.own])

    def matrices(self, *blocks: Rows) -> Outputs:
        """Matrices over the coordinates, one after the other; an absent entry is zero."""
        blocks = tuple(map(self.followers.matrix, blocks)) if self.followers else blocks
        return vector([rows.get((i, j), 0.0) for rows in blocks for i in self.own for j in self.own])

    def dynamics(self, v: list[Any], a: list[Any]) -> list[Scalar]:
        """Inertial, gravity, spring and damper terms: the drives that the motion needs."""
        rows, _ = inertial_rows(self.model, self.bound, self.joints, v, a, self.bound.gravity, self.graph.note)
        return [row + force for row, force in zip(rows, self.forces(v), strict=True)]

    def resisting(self, q: list[Any], v: list[Any]) -> list[Scalar]:
        """Forces, (n,), that springs, dampers and other laws of the coordinates themselves take from the drives."""
        return resisting_rows(self.bound, q, v, self.functions)

    def lines(self, v: list[Any]) -> list[Line]:
        """Springs between two points, where q is and at the rates v."""
        return list(lines(self.model, self.bound, self.joints, v, self.functions, self.graph.note))

    def touches(self, v: list[Any]) -> list[Touch]:
        """Contacts of journals in their bearings, where q is and at the rates v."""
        return list(touches(self.bound, self.q, v, self.graph.sincos, self.functions, self.graph.note))

    @cached_property
    def dampers(self) -> list[Damper]:
        """Dampings of joints' own motions, where q is."""
        return list(dampers(self.bound, self.q, self.graph.sincos, self.graph.note))

    def forces(self, v: list[Any]) -> list[Scalar]:
        """Forces, (n,), that all springs and dampers, those of cut joints as well, take from the drives."""
        rows = self.resisting(self.q, v)
        for line in self.lines(v):
            ratio = line.pull().ratio
            for index, value in line.g.items():
                rows[index] = rows[index] + ratio * value
        for touch in self.touches(v):
            for index, value in touch.rows().items():
                rows[index] = rows[index] + value
        for damper in self.dampers:
            for index, value in damper.rows(v).items():
                rows[index] = rows[index] + value
        for own in self.deviating:
            force = own.resists(v, self.functions).force
            for index, arm in own.arms.items():
                rows[index] = rows[index] + force * arm
        for cut in self.cut_touches(v):
            for index, value in cut.rows().items():
                rows[index] = rows[index] + value
        return rows

    def cut_touches(self, v: list[Any]) -> list[CutTouch]:
        """Contacts of journals of cut joints, where q is and at the rates v."""
        if not self.bound.cut_journals:
            return []
        return list(cut_touches(self.bound, self.deviating, v, self.graph.sincos, self.functions))

    @cached_property
    def closures(self) -> list[Closure]:
        """The loops where q is."""
        return list(closures(self.model, self.bound, self.joints, self.graph.sincos, self.graph.note))

    @cached_property
    def deviating(self) -> list[Deviating]:
        """Coordinates of cut joints with a force, and elastic couplings, where q is."""
        if not (self.bound.cut_laws or self.bound.couplings):
            return []
        return deviating(self.bound, self.closures, self.q, self.functions)

    def matrix(self) -> Rows:
        """Entries of M on and above the diagonal."""
        return mass_matrix(self.model, self.bound, self.joints, self.graph.note)


def vector(values: list[Scalar]) -> Outputs:
    return {("out", i): value for i, value in enumerate(values)}
