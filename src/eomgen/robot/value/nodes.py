"""Nodes of links that bend: the joints, links without mass and couplings that they are made of.

What stands on a node stands on its link, so that all that is known of followers holds for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from ...names import component_name
from ..geometry import COORDINATES, Matrix, Placement
from ..joint_types import PRINCIPAL
from ..sections import AXES
from .coordinate import Coordinate
from .coupling import Coupling
from .joint import Joint
from .link import Link
from .link_beam import ROOT as ROOT  # node where the link stands on its joint: the link itself
from .modes import Node
from .sliding import Series, SlidingShapes

SLIDING = "prismatic"  # type of joints that slide along a beam


def node_link(link: str, node: str) -> str:
    """Name the link without mass, and its joint, that a node of a link is made of: "arm_tip"."""
    return f"{link}_{node}"


def made_of(link: Link) -> Iterator[tuple[Link, Joint, tuple[Coupling, ...]]]:
    """Yield what each node of a link is made of: a link without mass, its joint, and couplings by the modes."""
    modes = link.modes
    for node in modes.nodes if modes is not None else ():
        assert modes is not None
        name, moving = node_link(link.name, node.name), node.moving()
        made = Link(name, 0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
        coordinates = {kind: Coordinate() for kind in moving}
        joint = Joint(name, link.name, name, "fixed", Placement(node.place), coordinates=coordinates)
        kinds = [component_name(link.name, kind) for kind in modes.names]
        yield made, joint, tuple(_coupling(node, name, kind, kinds) for kind in moving)


def _coupling(node: Node, owner: str, kind: str, modes: Sequence[str]) -> Coupling:
    """Return the coupling that makes one coordinate of a node follow the modes."""
    place = COORDINATES.index(kind)
    ratios = {name: ratio for name, ratio in zip(modes, node.Phi[place], strict=True) if ratio != 0.0}
    second = node.Psi[place] if node.Psi is not None and place < len(node.Psi) else ()
    bends = tuple(
        (modes[k], modes[j], row[j]) for k, row in enumerate(second) for j in range(k, len(modes)) if row[j] != 0.0
    )
    return Coupling(f"{owner}_{kind}", component_name(owner, kind), ratios, bends=bends)


@dataclass(frozen=True)
class ShapesAlong:
    """Functions of a place on a beam's axis, by which its modes move the coordinates of that.

    first: by coordinates, pairs of a mode's place among the modes and its function.  second: of pairs of modes.
    slopes: as those of ``SlidingShapes``.
    """

    first: Mapping[str, Sequence[tuple[int, Series]]]
    second: Mapping[str, Sequence[tuple[int, int, Series]]]
    slopes: Mapping[str, Sequence[tuple[float, Sequence[tuple[int, Series]]]]]


@dataclass(frozen=True)
class SlidingParts:
    """Link, joints and couplings of a joint that slides along a beam: it carries the link, which has no mass.

    That stands on the straight axis.  From there a second joint, which carries the joint's child, has the coordinates
    that the beam's modes move.
    """

    link: Link
    joints: tuple[Joint, Joint]
    couplings: tuple[Coupling, ...]


def sliding_joint(joint: Joint, link: Link, shapes: ShapesAlong) -> SlidingParts:
    """Return what a joint that slides along a link that is a beam is made of.

    Args:
        joint: as it is described, prismatic, from the link to its child; its coordinate is the distance from the root.
        link: the beam.
        shapes: of its modes.
    """
    assert link.beam is not None
    assert link.modes is not None
    name, by = node_link(link.name, joint.name), component_name(joint.name, PRINCIPAL[SLIDING])
    modes = [component_name(link.name, kind) for kind in link.modes.names]
    couplings = []
    for kind in COORDINATES:
        first = tuple((modes[k], series) for k, series in shapes.first.get(kind, ()))
        second = tuple((modes[k], modes[j], series) for k, j, series in shapes.second.get(kind, ()))
        groups = shapes.slopes.get(kind, ())
        slopes = tuple((sense, tuple((modes[k], series) for k, series in group)) for sense, group in groups)
        if first or second:
            sliding = SlidingShapes(by, link.beam.length, first, second, slopes)
            couplings.append(Coupling(f"{name}_{kind}", component_name(name, kind), {}, sliding=sliding))
    along = _along(link.beam.axis)
    slides = replace(joint, parent=link.name, child=name, placement=Placement(rotation=along))
    coordinates = {kind: Coordinate() for kind in (x.of.rpartition(".")[2] for x in couplings)}
    x, y, z = zip(*along, strict=True)
    back = Placement(rotation=(x, y, z))
    bent = Joint(name, name, joint.child, "fixed", back, coordinates=coordinates)
    return SlidingParts(Link(name, 0.0, (0.0, 0.0, 0.0), (0.0,) * 6), (slides, bent), tuple(couplings))


def sliding_joints(joints: Iterable[Joint], couplings: Iterable[Coupling]) -> dict[str, tuple[Joint, Joint]]:
    """Return joints that slide along beams, each with the one behind it whose coordinates modes move, by its name."""
    owners = {x.of.rpartition(".")[0]: x.sliding.by.rpartition(".")[0] for x in couplings if x.sliding is not None}
    named = {joint.name: joint for joint in joints}
    return {slides: (named[slides], named[bent]) for bent, slides in owners.items()}


def _along(axis: str) -> Matrix:
    """Return axes of which z is that of a beam along an axis of its link."""
    x, y, z = zip(*AXES[axis], strict=True)
    first, second, third = zip(y, z, x, strict=True)
    return first, second, third
