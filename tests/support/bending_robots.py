"""Random robots whose links bend: modes on links of any tree, nodes under joints and frames of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eomgen.robot.model import build_model
from eomgen.robot.value import Coupling, Frame, Joint, Link, LinkModes, Node, Robot, made_of
from eomgen.robot.value.nodes import node_link
from tests.oracles.bending_lagrange import BendingOracle, Cloud
from tests.support.bending_links import nested
from tests.support.random_robots import Array, State, random_state


@dataclass(frozen=True, eq=False)
class Bending:
    """A robot with links that bend.

    plain: the description in which joints and frames stand on links.  clouds: particles of links that bend.  nodes:
    on which node of its parent a joint stands; frames: a frame, likewise.  robot: as eomgen takes it.
    """

    plain: Robot
    clouds: Mapping[str, Cloud]
    nodes: Mapping[str, str]
    frames: Mapping[str, str]

    @property
    def robot(self) -> Robot:
        """Make nodes links: what stands on "tip" of "arm" has the parent "arm_tip"; depth first, nodes first."""
        made = {link.name: list(made_of(link)) for link in self.plain.links}
        joints: list[Joint] = []

        def visit(link: str) -> None:
            below = [x for x in self.plain.joints if x.parent == link]
            for _, joint, _ in made.get(link, ()):
                joints.append(joint)
                for child in below:
                    if node_link(link, self.nodes.get(child.name, "")) == joint.child:
                        joints.append(replace(child, parent=joint.child))
                        visit(child.child)
            for child in below:
                if child.name not in self.nodes:
                    joints.append(child)
                    visit(child.child)

        visit(self.plain.base)
        links = [x for link in self.plain.links for x in (link, *(node for node, _, _ in made[link.name]))]
        couplings = [x for link in self.plain.links for _, _, own in made[link.name] for x in own]
        frames = [
            replace(x, link=node_link(x.link, self.frames[x.name])) if x.name in self.frames else x
            for x in self.plain.frames
        ]
        return replace(
            self.plain,
            links=tuple(links),
            joints=tuple(joints),
            frames=tuple(frames),
            couplings=(*self.plain.couplings, *couplings),
        )

    def standing(self) -> dict[str, tuple[Frame, str | None]]:
        """Return frames of links by name, the base's and those of nodes among them, with the node they stand on."""
        links = (self.plain.base, *(x.name for x in self.plain.links))
        frames: dict[str, tuple[Frame, str | None]] = {x: (Frame(x, x), None) for x in links}
        frames |= {x.name: (x, self.frames.get(x.name)) for x in self.plain.frames}
        for x in self.plain.links:
            for node in x.modes.nodes if x.modes is not None else ():
                name = node_link(x.name, node.name)
                frames[name] = Frame(name, x.name), node.name
        return frames

    def oracle(self) -> BendingOracle:
        """Return Lagrange's equations of it, coordinates in the order of the model's."""
        return BendingOracle(self.plain, self.clouds, self.nodes, build_model(self.robot).coordinates)

    def state(self, seed: int) -> State:
        """Draw a state: modal coordinates up to 0.4, others as ``random_state`` draws them."""
        names = build_model(self.robot).coordinates
        drawn = random_state(replace(self.plain, links=tuple(replace(x, modes=None) for x in self.plain.links)), seed)
        own = [f"{joint.name}.{kind}" for joint in self.plain.joints for kind in joint.coordinates]
        rng = np.random.default_rng([seed, 9])
        columns = []
        for key, span in (("q", 0.4), ("v", 1.0), ("a", 1.0), ("u", 1.0)):
            values = dict(zip(own, getattr(drawn, key).tolist(), strict=True))
            modal = dict(zip(names, rng.uniform(-span, span, len(names)).tolist(), strict=True))
            columns.append(np.array([values.get(name, modal[name]) for name in names]))
        return State(*columns)


def bent(
    robot: Robot,
    seed: int,
    modes: Sequence[int] = (0, 1, 2, 3),
    *,
    second: bool | None = None,
    generic: bool = False,
) -> Bending:
    """Let links of a tree bend: those that joints carry which move, with numbers of modes drawn from some.

    Args:
        robot: of links and joints alone; its couplings are kept.
        seed: for modes, nodes, and what stands on them.
        modes: numbers to draw from, 0 of a link that stays rigid; the first link bends if one of them is not 0.
        second: deflections of second order (Q and Psi); at random if None.
        generic: deflections of particles of which nothing is zero by accident.
    """
    rng = np.random.default_rng([seed, 40])
    carried = {x.child for x in robot.joints if x.coordinates}
    links, clouds = list[Link](), dict[str, Cloud]()
    for link in robot.links:
        count = int(rng.choice(modes))
        if link.name in carried and not clouds:
            count = count or max(modes)
        if count and link.name in carried and link.mass > 0.0:
            quadratic = bool(rng.random() < 0.5) if second is None else second
            clouds[link.name] = _cloud(rng, link, count, second=quadratic, generic=generic)
            links.append(replace(link, modes=_link_modes(rng, clouds[link.name], second=quadratic)))
        else:
            links.append(link)
    names = {x.name: [node.name for node in x.modes.nodes] for x in links if x.modes is not None}

    def drawn(parents: Mapping[str, str]) -> dict[str, str]:
        standing = {name: link for name, link in parents.items() if link in names and rng.random() < 0.85}
        return {name: str(rng.choice(names[link])) for name, link in standing.items()}

    plain = replace(robot, links=tuple(links))
    nodes = drawn({x.name: x.parent for x in robot.joints})
    return Bending(plain, clouds, nodes, drawn({x.name: x.link for x in robot.frames}))


def with_mode_follower(bending: Bending, seed: int) -> Bending:
    """Let a coordinate of a joint follow a mode, in front of it or behind it in the tree, beside another coordinate."""
    rng = np.random.default_rng([seed, 41])
    modes = [f"{x.name}.{kind}" for x in bending.plain.links if x.modes is not None for kind in x.modes.names]
    own = [f"{x.name}.{kind}" for x in bending.plain.joints for kind in x.coordinates]
    follower, *others = rng.permutation(own).tolist()
    to = {str(rng.choice(modes)): float(rng.uniform(-1.0, 1.0))}
    to |= {name: float(rng.uniform(-1.0, 1.0)) for name in others[:1]}
    coupling = Coupling("follows", follower, to, float(rng.uniform(-0.2, 0.2)))
    return replace(bending, plain=replace(bending.plain, couplings=(coupling,)))


def _cloud(rng: np.random.Generator, link: Link, count: int, *, second: bool, generic: bool) -> Cloud:
    """Draw deflections of particles that have a rigid link's mass, centre of mass and inertia."""
    rigid = Cloud.of(link.mass, link.com, link.inertia)
    particles = len(rigid.mass)
    phi = rng.normal(size=(particles, 3, count)) * 0.3
    if rng.random() < 0.3 and not generic:  # bending in a plane
        phi[:, [0, 2]] = 0.0
    psi = rng.normal(size=(particles, 3, count, count)) * 0.2 * second
    return Cloud(rigid.mass, rigid.place, phi, psi + psi.transpose(0, 1, 3, 2))


def _link_modes(rng: np.random.Generator, cloud: Cloud, *, second: bool) -> LinkModes:
    H0, P, Q = cloud.constants()
    m = cloud.modes
    K, D = (np.diag(rng.uniform(0.5, 2.0, m)) for _ in range(2))
    beside = rng.spawn(1)[0]  # which leaves the numbers of rng as they are
    if beside.random() < 0.6:
        K, D = coupled(beside, K), coupled(beside, D)
    nodes = tuple(_node(rng, f"node{i + 1}", m, second=second) for i in range(int(rng.integers(1, 3))))
    return LinkModes(nested(H0), nested(P), nested(20.0 * K), nested(0.2 * D), nodes, nested(Q) if second else None)


def coupled(rng: np.random.Generator, diagonal: Array) -> Array:
    """Return a positive definite matrix with a diagonal, and entries beside it."""
    A = rng.uniform(-1.0, 1.0, diagonal.shape)
    gram = A @ A.T
    size = np.sqrt(np.diag(gram) / np.diag(diagonal))
    matrix: Array = 0.3 * diagonal + 0.7 * gram / np.outer(size, size)
    return matrix


def _node(rng: np.random.Generator, name: str, count: int, *, second: bool) -> Node:
    """Draw a node; about half of its rows of Phi move nothing."""
    Phi = rng.normal(size=(6, count)) * 0.3 * (rng.random(6) < 0.6)[:, None]
    Psi = rng.normal(size=(3, count, count)) * 0.3 * (rng.random(3) < 0.7)[:, None, None]
    place: Array = rng.uniform(-0.5, 0.5, 3)
    return Node(name, nested(place), nested(Phi), nested(Psi + Psi.transpose(0, 2, 1)) if second else None)
