"""Blocks of J in which the components of a constraint may have derivatives, loop by loop; without SymPy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eomgen.names import component_name
from eomgen.robot.joint_types import rigid_components

if TYPE_CHECKING:
    from eomgen.robot.model import Model


@dataclass(frozen=True)
class Block:
    """Rows of one loop or of one rigid coupling.

    Attributes:
        first: number of its first row.
        kinds: of its rows; those of one kind are compared to each other where they may be redundant.
        columns: the coordinates that may move it, in order.
    """

    first: int
    kinds: tuple[tuple[str, bool], ...]
    columns: tuple[int, ...]

    @property
    def rows(self) -> int:
        """Number of its rows."""
        return len(self.kinds)

    @property
    def size(self) -> int:
        """Numbers in it."""
        return self.rows * len(self.columns)


def row_blocks(model: Model) -> list[Block]:
    """Return the blocks of all loops and rigid couplings, in the order of ``Model.constraints``."""
    blocks: list[Block] = []

    def put(kinds: tuple[tuple[str, bool], ...], columns: set[int]) -> None:
        first = blocks[-1].first + blocks[-1].rows if blocks else 0
        blocks.append(Block(first, kinds, tuple(sorted(columns))))

    for loop in model.robot.loops:
        one, other = (set(model.ancestors(model.body_of[link])) for link in loop.links)
        columns = {i for k in one ^ other for i in _moving(model, k)}  # what moves both sides moves neither
        put(tuple((loop.name, component.axis is None) for component in rigid_components(loop)), columns)
    for coupling in model.rigid_couplings:
        names = {leader for x in (coupling.of, *coupling.to) for leader in model.leaders.get(x, (x,))}
        put(((coupling.name, False),), {model.coordinates.index(name) for name in names})
    return blocks


def _moving(model: Model, body: int) -> set[int]:
    """Return the coordinates that a body's joint moves by: its own, and those that its followers follow."""
    joint = model.robot.joint(model.bodies[body].joint)
    names = (component_name(joint.name, kind) for kind in joint.coordinates)
    return {model.coordinates.index(leader) for name in names for leader in model.leaders.get(name, (name,))}
