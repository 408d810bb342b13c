"""Nodes of links that bend: the joints, links without mass and couplings that they are made of.

What stands on a node stands on its link, so that all that is known of followers holds for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...names import component_name
from ..geometry import COORDINATES, Placement
from .coordinate import Coordinate
from .coupling import Coupling
from .joint import Joint
from .link import Link
from .modes import Node

ROOT = "root"  # node where the link stands on its joint: the link itself


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
