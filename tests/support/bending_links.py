"""Random robots with links that bend: links of mass points whose deflections are polynomials of modal coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.robot.value import Coordinate, Coupling, Joint, Link, LinkModes, Node, Placement, Robot, made_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Points:
    """Mass points of a link: masses (N,), places (N, 3), modes (N, 3, m) and their second order (N, 3, m, m)."""

    mass: Array
    place: Array
    phi: Array
    psi: Array

    def at(self, e: Any) -> Any:
        """Return the places of the points, (N, 3), at modal coordinates e."""
        return self.place + self.phi @ e + 0.5 * (self.psi @ e) @ e


def random_points(rng: np.random.Generator, m: int, *, second: bool, count: int = 12) -> Points:
    """Draw mass points with m modes; ``second``: with terms of second order."""
    psi = 0.1 * rng.normal(size=(count, 3, m, m)) * second
    phi = 0.1 * rng.normal(size=(count, 3, m))
    place = 0.2 * rng.normal(size=(count, 3))
    return Points(rng.uniform(0.02, 0.1, count), place, phi, psi + psi.transpose(0, 1, 3, 2))


def link_of(name: str, points: Points, rng: np.random.Generator, nodes: int, *, drawn_in: bool) -> Link:
    """Return the link of these points, with nodes that move at random with its modes; ``drawn_in``: with squares."""
    m, mass = points.phi.shape[2], points.mass
    rho = np.hstack([points.place, np.ones((len(mass), 1))])
    whole = np.einsum("i,ia,ib->ab", mass, rho, rho)
    second = np.any(points.psi)
    made = []
    for number in range(nodes):
        Psi = 0.2 * rng.normal(size=(3, m, m))
        place = tuple(0.3 * rng.normal(size=3))
        Phi = nested(0.2 * rng.normal(size=(6, m)))
        made.append(Node(f"node{number}", place, Phi, nested(Psi + Psi.transpose(0, 2, 1)) if drawn_in else None))
    modes = LinkModes(
        nested(np.einsum("i,ia,ibk->kab", mass, rho, points.phi)),
        nested(np.einsum("i,iak,ibl->klab", mass, points.phi, points.phi)),
        nested(np.diag(rng.uniform(1.0, 5.0, m))),
        nested(np.diag(rng.uniform(0.05, 0.1, m))),
        tuple(made),
        nested(np.einsum("i,ia,ibkl->klab", mass, rho, points.psi)) if second else None,
    )
    com = whole[:3, 3] / whole[3, 3]
    about = whole[:3, :3] - whole[3, 3] * np.outer(com, com)
    inertia = np.trace(about) * np.eye(3) - about
    entries = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return Link(name, float(whole[3, 3]), nested(com), nested(np.array(entries)), modes)


def nested(x: Array) -> Any:
    """Return an array as nested tuples of floats."""
    return tuple(map(nested, x)) if x.ndim else float(x)


def bending_chain(rng: np.random.Generator, *, drawn_in: bool, second: bool = False) -> tuple[Robot, dict[str, Points]]:
    """Return a branched robot of two links that bend, with four joints, and the points of these links.

    Args:
        drawn_in: whether nodes have terms of second order.
        second: whether particles have some; their products with others are beyond the order of the equations.
    """
    points = {"arm": random_points(rng, 2, second=second), "fore": random_points(rng, 1, second=second)}
    arm, fore = (
        link_of(name, points[name], rng, nodes, drawn_in=drawn_in) for name, nodes in (("arm", 2), ("fore", 1))
    )
    tool, side = (Link(name, 0.7, (0.1, 0.0, 0.2), (0.1, 0.12, 0.1, 0.01, 0.0, 0.0)) for name in ("tool", "side"))
    turned = Placement.from_rpy((0.1, 0.2, 0.3), (0.3, 0.4, 0.5))
    gamma = {"gamma": Coordinate()}
    elbow = {"gamma": Coordinate(), "x": Coordinate(stiffness=10.0, damping=0.1)}
    joints = [
        Joint("shoulder", "base", "arm", "revolute", coordinates=gamma),
        Joint("elbow", "arm_node0", "fore", "revolute", turned, coordinates=elbow),
        Joint("slide", "fore_node0", "tool", "prismatic", turned, coordinates={"z": Coordinate()}),
        Joint("hinge", "arm_node1", "side", "revolute", turned, coordinates=gamma),
    ]
    links, couplings = [arm, fore, tool, side], list[Coupling]()
    for bending in (arm, fore):
        for link, joint, coupled in made_of(bending):
            links.append(link)
            joints.append(joint)
            couplings += coupled
    robot = Robot("bending_chain", (0.3, -0.5, -9.81), tuple(links), tuple(joints), couplings=tuple(couplings))
    return replace(robot, joints=_depth_first(robot)), points


def _depth_first(robot: Robot) -> tuple[Joint, ...]:
    order: list[Joint] = []

    def visit(link: str) -> None:
        for joint in robot.joints:
            if joint.parent == link:
                order.append(joint)
                visit(joint.child)

    visit(robot.base)
    return tuple(order)
