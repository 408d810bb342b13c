"""One kernel's graph with a model bound in it: where every program begins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

from eomgen.robot.model import Model, turned_name, with_offset_angles

from ..forces.element import ForceElement, Setting
from ..forces.elements import ELEMENTS
from ..forces.scalar_functions import Functions
from ..program.ir import Graph, Value
from ..program.passes import PARAMETERS
from ..tree.bending import bent
from ..tree.bound import Bound, bind
from ..tree.composite import Rows, mass_matrix
from ..tree.constraints import Closure, closures
from ..tree.followers import Followers
from ..tree.frames import choose_frames
from ..tree.frozen_joints import JointGeometry, PosedTree, geometry
from ..tree.recursion import inertial_rows
from ..tree.regrouping import regroup
from ..tree.spatial import Scalar
from ..tree.traced import Traced

Outputs = dict[tuple[str, int], Value]


class Derivation:
    """One kernel's graph with the model's numbers, inputs and joint transforms bound in it.

    ``regrouped``: with the frames and pseudo-inertias that cost least (``choose_frames``, ``regroup``).

    ``dtype``: of the numbers that the C computes with.

    ``turned``: 3-DOF rotations read their charts, behind the parameters (``Model.turning``); ``turns`` counts them.

    An angle that is not active but has an offset is a coordinate here whose q, v and a are zero; ``active`` are the
    places of the coordinates that kernels know, and what is written leaves the others out.  ``described`` is the model
    without such angles.

    ``states``: whether internal states are read, which are 0 else.  They stand behind the coordinates here, as
    velocities of inertias of their own; ``rates`` are the places of all that has a rate: active coordinates, then
    states.

    Coordinates that follow others are coordinates here, too, and no inputs: ``followers`` moves them after their
    leaders, and maps what is written.

    ``u`` are forces on coordinates, ``drive_inputs`` inputs of drives with states by the indices of their coordinates:
    kernels read these in u, and forces beside such drives in an array of their own.  In derivatives by u, whose columns
    are ``columns_of_u``, these forces stand at the first states of the drives.
    """

    def __init__(
        self,
        model: Model,
        *,
        regrouped: bool = True,
        dtype: str = "float64",
        turned: bool = False,
        states: bool = True,
    ) -> None:
        self.graph, self.dtype = Graph(), dtype
        self.described = model
        self.model, self.active = with_offset_angles(model)
        first = len(self.model.coordinates)
        self.states = range(first, self.model.size)
        self.rates = (*self.active, *self.states)
        turns = [turned_name(model.bodies[k].joint) for k in model.turning] if turned else []
        self.turns = len(turns)
        slots = {name: slot for slot, name in enumerate((*model.parameters, *turns))}

        def value(name: str, number: float) -> Scalar:
            if name in slots:
                return self.graph.input(PARAMETERS, slots[name])
            return Traced(number, name) if number else number

        self.q, self.v, self.a, self.u = (self.inputs(name) for name in "qvau")
        for place, k in enumerate(self.states if states else ()):
            self.v[k], self.a[k] = self.graph.input("z", place), self.graph.input("zdot", place)
        self.drive_inputs = {i: self.u[i] for i in self.model.drives}
        self.columns_of_u = list(self.u)
        for place, (i, of_drive) in enumerate(self.model.drives.items()):
            self.u[i] = self.columns_of_u[of_drive[0]] = self.graph.input("forces", place)
        bound = bind(self.model, value, self.graph.sincos, near=regrouped, named=Traced)
        self.followers = Followers(self.model, self.described, bound)
        self.followers.place(self.q)
        self.followers.follow(self.v)
        self.followers.accelerate(self.a, self.v)
        bound = regroup(self.model, choose_frames(self.model, bound)) if regrouped else bound
        self.bound: Bound = bent(self.model, bound, self.q, self.followers)
        self.joints: list[JointGeometry] = geometry(self.model, self.bound, self.q, self.graph.sincos)
        self.tree = PosedTree(self.model, self.bound, self.joints, self.graph.note)
        self.still: list[Scalar] = [0.0] * self.model.size
        self.coasting = self.followers.accelerate(list(self.still), self.v)  # leaders are not accelerated
        self.functions = Functions(self.graph.call)

    def inputs(self, name: str, *, states: bool = False) -> list[Scalar]:
        """Read an array of the coordinates that kernels know, and of internal states behind them; 0 at the others."""
        array: list[Scalar] = [0.0] * self.model.size
        for place, index in enumerate(self.rates if states else self.active):
            array[index] = self.graph.input(name, place)
        return array

    def vector(self, values: Sequence[Scalar]) -> Outputs:
        """Write a force per coordinate; those on followers act on their leaders."""
        gathered = self.followers.gather(values)
        return vector([gathered[i] for i in self.active])

    def motion(self, values: Sequence[Scalar]) -> Outputs:
        """Write an acceleration or other change per coordinate, then that of each internal state."""
        return vector([values[i] for i in self.rates])

    def rows(self, rows: Sequence[Mapping[int, Scalar]]) -> Outputs:
        """Write derivatives of values by the coordinates, value by value; an absent one is zero."""
        mapped = [self.followers.row(row) for row in rows]
        return vector([row.get(i, 0.0) for row in mapped for i in self.active])

    def matrices(self, *blocks: Rows, states: bool = False) -> Outputs:
        """Write matrices over coordinates, and internal states behind them, one after the other; else 0."""
        blocks = tuple(map(self.followers.matrix, blocks)) if self.followers else blocks
        places = self.rates if states else self.active
        return vector([rows.get((i, j), 0.0) for rows in blocks for i in places for j in places])

    def dynamics(self, v: list[Any], a: list[Any]) -> list[Scalar]:
        """Compute inertial, gravity, spring and damper terms: the forces on coordinates that the motion needs.

        Whatever drives make is not among them, and rows of their states are 0.
        """
        rows, _ = inertial_rows(self.tree, v, a, self.bound.gravity)
        forces = self._sum(x for element in self.elements if not element.IS_DRIVE for x in element.resist(v))
        needed = [row + force for row, force in zip(rows, forces, strict=True)]
        for k in self.model.states_of_drives:
            needed[k] = 0.0
        return needed

    def dynamics_with_drives(self, v: list[Any], a: list[Any]) -> list[Scalar]:
        """Compute the same less what drives do with their inputs; of states the rows of their rates."""
        rows, _ = inertial_rows(self.tree, v, a, self.bound.gravity)
        return [row + force for row, force in zip(rows, self.forces(v), strict=True)]

    @cached_property
    def elements(self) -> tuple[ForceElement, ...]:
        """All forces of springs, dampers, contacts and friction, where q is."""
        setting = Setting(
            **vars(self.tree),
            q=self.q,
            sincos=self.graph.sincos,
            functions=self.functions,
            closures=lambda: self.closures,
            inputs=self.drive_inputs,
        )
        return tuple(family(setting) for family in ELEMENTS)

    def forces(self, v: list[Any]) -> list[Scalar]:
        """Sum the forces, (n,), that all elements take, those of drives negative."""
        return self._sum(x for element in self.elements for x in element.resist(v))

    def passive_forces(self, v: list[Any]) -> list[Scalar]:
        """Sum those of the same forces, (n,), that no input of a drive makes."""
        return self._sum(x for element in self.elements for x in element.passive(v))

    def _sum(self, forces: Iterable[tuple[int, Scalar]]) -> list[Scalar]:
        rows: list[Scalar] = [0.0] * self.model.size
        for index, force in forces:
            rows[index] = rows[index] + force
        return rows

    @cached_property
    def closures(self) -> list[Closure]:
        """The loops where q is."""
        return list(closures(self.tree, self.graph.sincos))

    def matrix(self) -> Rows:
        """Compute the entries of M on and above the diagonal."""
        return mass_matrix(self.tree)


def vector(values: list[Scalar]) -> Outputs:
    return {("out", i): value for i, value in enumerate(values)}
