"""Force elements in the equations of motion: rows, energy, wrenches, slopes, and share of implicit steps.

Every family of forces is a class here below, with its formulas, one file each; ``elements`` lists them, and the
writers of kernels loop over that list.  An element stands where q is; velocities are arguments.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from ..program.forward_mode import gradients
from ..program.ir import Graph, Node
from ..tree.composite import Rows
from ..tree.constraints import Closure
from ..tree.frozen_joints import PosedTree
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar
from .laws import Effect
from .scalar_functions import Functions

Member = TypeVar("Member")
POLE = 1e-7  # cosine of beta, below which alpha and gamma turn about one axis

SparseRow = Mapping[int, Scalar]  # derivatives of one value by coordinates, by their indices
Blocks = Callable[[Scalar, Scalar], Rows]  # slopes between values, on and above the diagonal, by c and c^2
Directions = Callable[[Scalar, Scalar], Sequence[tuple[SparseRow, Scalar]]]  # rank-one rows with slopes, likewise
Turn = Callable[[Scalar], tuple[Scalar, Scalar]]


@dataclass(frozen=True, kw_only=True)
class Setting(PosedTree):
    """A tree where q is, which forces act in.

    sincos, functions: of the scalars.  closures: gives the loops where q is.
    inputs: of drives, by the indices of their coordinates.
    """

    q: Sequence[Scalar]
    sincos: Turn
    functions: Functions
    closures: Callable[[], Sequence[Closure]]
    inputs: Mapping[int, Scalar]

    @property
    def still(self) -> list[Scalar]:
        """Velocities of a tree that does not move, (n,)."""
        return [0.0] * self.model.size


@dataclass
class Slopes:
    """Sparse derivatives of resisting forces by q and v, by (row, column), to which elements add theirs.

    moving: gives, of coordinates that a force depends on, those that are inputs of the graph and move them.
    """

    graph: Graph
    by_q: Rows
    by_v: Rows
    q: Sequence[Scalar]
    v: Sequence[Scalar]
    moving: Callable[[Sequence[int]], list[int]]

    def add(self, key: tuple[int, int], by_q: Scalar, by_v: Scalar) -> None:
        """Add to the derivatives of one row by one coordinate and its velocity."""
        add_to(self.by_q, key, by_q)
        add_to(self.by_v, key, by_v)

    def differentiate(self, rows: SparseRow, moved_by: Sequence[int]) -> None:
        """Add the derivatives of forces, which depend on these coordinates alone, by differentiating the graph."""
        moving = self.moving(moved_by)
        for x, into in ((self.q, self.by_q), (self.v, self.by_v)):
            inputs = {j: place for j in moving if isinstance(place := x[j], Node)}  # internal states have no positions
            derivatives = gradients(self.graph, list(rows.values()), list(inputs.values()))
            for i, row in zip(rows, derivatives, strict=True):
                for j, slope in zip(inputs, row, strict=True):
                    add_to(into, (i, j), slope)


@dataclass(frozen=True)
class Deflection:
    """A coordinate that a force element acts along: its name ("mount.x"), value, resisting force, and row by q."""

    name: str
    value: Scalar
    force: Scalar
    jacobian_row: SparseRow


@dataclass(frozen=True)
class StateSlopes:
    """Slopes of a resisting force f(s, v, z) and of the rates g(s, v, z) of its states, (k,).

    f_z, g_v, g_s, inertias: (k,); the states store inertias[k] z[k]^2 / 2.
    g_z: entries of (k, k) that do not vanish, by row and column, whose leading blocks are those of stable systems.
    """

    f_v: Scalar
    f_z: Sequence[Scalar]
    g_v: Sequence[Scalar]
    g_s: Sequence[Scalar]
    g_z: Rows
    inertias: Sequence[Scalar]
    f_s: Scalar = 0.0


@dataclass(frozen=True)
class StateSite:
    """Place at which a law with internal states acts: a row, of one coordinate or a motor's transmission too.

    states: their indices.
    """

    row: SparseRow
    states: Sequence[int]
    coordinate: int | None = None
    motor: int | None = None


class ImplicitShare(ABC):
    """Shares of elements in M + c D + c^2 K of an implicit method, and in the forces on its right side.

    q, v: where forces are taken, (n,) each; ``ahead`` is how long velocities have led there, 0 in stages.
    inputs: of drives, by the indices of their coordinates.  gains: of a controller of these inputs, kp and kd likewise.
    counts_turning: whether slopes of dampers by directions that turn are among them.
    """

    counts_turning = False

    def __init__(self, q: Sequence[Scalar], v: Sequence[Scalar], ahead: Scalar, inputs: Mapping[int, Scalar]) -> None:
        self.q, self.v, self.ahead, self.inputs = q, v, ahead, inputs
        self.gains: dict[int, tuple[Scalar, Scalar]] = {}
        self._made: dict[ForceElement, Any] = {}

    def made(self, element: ForceElement, make: Callable[[Sequence[Scalar]], list[Member]]) -> list[Member]:
        """Give what an element makes of the velocities, made once."""
        if element not in self._made:
            self._made[element] = make(self.v)
        members: list[Member] = self._made[element]
        return members

    @abstractmethod
    def push(self, i: int, force: Scalar) -> None:
        """Add a resisting force on coordinate i."""

    @abstractmethod
    def on_coordinate(self, i: int, stiffness: Scalar, damping: Scalar) -> None:
        """Add slopes of a straight line on coordinate i."""

    @abstractmethod
    def bend(self, i: int, law: Effect) -> None:
        """Add slopes of a law on coordinate i; none where its tangent falls."""

    @abstractmethod
    def in_internal_states(self, site: StateSite, law: StateSlopes) -> None:
        """Add slopes of a law with internal states: all of them, or those of the states' rates alone where the force
        would fall with the deviation's rate.
        """

    @abstractmethod
    def in_joint(self, slopes: Blocks) -> None:
        """Add slopes between coordinates of one joint or modes of one link, on and above the diagonal, by c and c^2.

        They are never negative, with what ``on_coordinate`` adds to these coordinates.
        """

    @abstractmethod
    def in_transmission(self, motor: int, linear: Effect, law: Effect) -> None:
        """Add slopes in the deflection of a motor's transmission: of a straight line, and of laws."""

    @abstractmethod
    def along(self, row: SparseRow, law: Effect, *, turns: bool = False) -> None:
        """Add a force along a direction, and its slopes as a rank-one row; none where the tangent falls.

        Args:
            row: the direction.
            law: the force.
            turns: whether the direction may turn far within a step, so that slopes by this count where
                ``counts_turning`` says so.
        """

    @abstractmethod
    def along_all(self, rows: SparseRow, directions: Directions) -> None:
        """Add forces by coordinates, and rank-one rows with slopes by c and c^2, which are never negative."""

    @abstractmethod
    def among(self, rows: SparseRow, members: Sequence[SparseRow], slopes: Blocks, *, turns: bool = False) -> None:
        """Add forces by coordinates, and slopes between values with the derivatives ``members``, by their places.

        The slopes are those on and above the diagonal, by c and c^2; never negative.  ``turns``: as of ``along``.
        """


class ForceElement(ABC):
    """All forces of one family in a tree.

    Its forces and their slopes each family must have; the other methods add nothing where a family has no such thing.
    Resisting forces are what the drives must overcome: minus generalized forces.
    """

    FAMILY: ClassVar[str] = ""  # of ``robot.parameter_names.FAMILIES``; none where the numbers are those of others
    IS_DRIVE: ClassVar[bool] = False  # whether it drives the robot, so that inverse dynamics asks for what it does

    def __init__(self, setting: Setting) -> None:
        self.at = setting

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell whether numbers of that family and owner, as of ``element_places``, are those of its forces."""
        return family == cls.FAMILY

    @abstractmethod
    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give resisting forces, N or N m, by coordinates, at the velocities v; one may have several."""

    @abstractmethod
    def add_slopes(self, slopes: Slopes) -> None:
        """Add derivatives of the resisting forces by q and v."""

    def passive(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give those of the resisting forces that no input of a drive makes."""
        yield from self.resist(v)

    def driving(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give generalized forces by which drives take energy in; nothing of others."""
        yield from ()

    def input_slopes(self, v: Sequence[Scalar]) -> Rows:
        """Return derivatives of the resisting forces by inputs of drives, columns by their coordinates."""
        return {}

    def energies(self) -> Iterator[Scalar]:
        """Give stored energies, J."""
        yield from ()

    def state_energies(self, v: Sequence[Scalar]) -> Iterator[Scalar]:
        """Give energies, J, that internal states store, which are among the velocities."""
        yield from ()

    def deflections(self, v: Sequence[Scalar]) -> Iterator[Deflection]:
        """Give what ``element_forces`` tells of, named as ``LinkElement.slopes`` does; none where other kernels do."""
        yield from ()

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints' reactions hold of forces between links: the body, and a wrench at its origin, its axes."""
        yield from ()

    def wrenches_in_cuts(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give wrenches on the second links of cut joints, by the loops' numbers, in the common bodies' axes."""
        yield from ()

    def advance(self, share: ImplicitShare) -> None:
        """Push forces where a linearly implicit step takes them, but those that ``add_rows`` adds with their slopes."""
        return

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of single coordinates to an implicit method's matrix."""
        return

    def add_blocks(self, share: ImplicitShare) -> None:
        """Add slopes between coordinates of one joint or modes of one link to an implicit method's matrix."""
        return

    def add_rows(self, share: ImplicitShare) -> None:
        """Add slopes along directions to an implicit method's matrix."""
        return

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give the largest stiffness that each coordinate feels by itself, N/m or N m/rad, by its index.

        Without those of coordinates' tables and of transmissions, which are known without equations.
        """
        yield from ()

    def poles(self, moving: Collection[int]) -> Iterator[tuple[str, Scalar]]:
        """Give what has angles with forces that are singular where a cosine vanishes, and that cosine.

        Args:
            moving: coordinates that count, by their indices.
        """
        yield from ()


class ForceRows(ForceElement):
    """Forces by coordinates and velocities, which a linearly implicit step takes where it takes these."""

    @abstractmethod
    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give resisting forces, N or N m, by coordinates, at q and v; one may have several."""

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        yield from self.rows(self.at.q, v)

    def advance(self, share: ImplicitShare) -> None:
        for i, force in self.rows(share.q, share.v):
            share.push(i, force)


def add_to(rows: Rows, key: tuple[int, int], value: Scalar) -> None:
    """Add to an entry of a sparse matrix."""
    rows[key] = rows.get(key, 0.0) + value
