"""Links that bend as chains of rigid segments: for programs that know no modes, and for deflections that are not small.

A link that is a beam becomes a massless link of its name, where its joint stands, and a ``Beam`` from there to the link
of its tip, whose segments have elastic joints in their middles.  Chains are made of the beam's material and section, so
that forces and moments at the tip deflect them as they deflect the beam, for any number of segments; frequencies tend
to the beam's with its cube in bending, with its square in twist and stretch.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from ...errors import InputError
from ...limits import MOST_ENTRIES, MOST_SEGMENTS
from ...names import component_name, joint_of, listed, nearest_or_all, show
from ...robot.geometry import Matrix, Placement
from ...robot.sections import AXES
from ...robot.value import BASE, COORDINATES, Beam, Joint, Link, LinkBeam, Robot, made_of, node_link, sliding_joints
from ..beam import beam_modes

_MOVED = {"y": ("y", "gamma"), "z": ("z", "beta"), "torsion": ("alpha",), "axial": ("x",)}  # by a direction's modes
_SAME = 1e-9  # relative: that stiffness of modes may be off the beam's
_STILL = (0.0, 0.0, 0.0)


def with_segments(robot: Robot, segments: int, links: Collection[str] | None = None) -> Robot:
    """Return the robot with links that bend as chains of rigid segments; see ``Robot.with_segments``."""
    known = {link.name: link for link in robot.links if link.modes is not None}
    if isinstance(segments, bool) or not isinstance(segments, int):
        raise InputError(f"segments: got {show(segments)}; allowed: a whole number from 1 to {MOST_SEGMENTS}")
    if not known:
        raise InputError(f"segments: no link of {robot.name} bends by modes; allowed: robots with links that do")
    for name in links or ():
        if name not in known:
            raise InputError(f"links: {show(name)} does not bend by modes{nearest_or_all(str(name), known)}")
    chains = [_Chain.of(link, segments) for name, link in known.items() if links is None or name in links]
    _check_rest(robot, chains)
    _check_names(robot, chains)
    return _rebuilt(robot, chains)


@dataclass(frozen=True)
class _Chain:
    """A link that bends, with the beam of segments in its place."""

    link: Link
    beam: Beam

    @staticmethod
    def of(link: Link, segments: int) -> _Chain:
        """Return the chain of a link.

        Raises:
            InputError: the link is no beam, or its modes are no longer the beam's; or no beam has so many segments.
        """
        assert link.modes is not None
        if link.beam is None:
            where = f"links.{link.name}.modes"
            raise InputError(f"{where}: a file says nothing of sections; allowed: chains of links that are beams")
        _check_stiffness(link, link.beam)
        given = link.beam
        moved = [key for way, count in given.modes.counts.items() if count for key in _MOVED[way]]
        beam = Beam(
            link.name,
            link.name,
            node_link(link.name, link.modes.nodes[0].name),  # its tip
            given.length,
            segments,
            given.E,
            given.G,
            given.A,
            given.Iy,
            given.Iz,
            given.J,
            given.shear,
            given.density,
            given.axis,
            damping=_damping(link, given),
            rigid=tuple(key for key in COORDINATES if key not in moved),
        )
        conflict = beam.conflict()
        if conflict is not None:
            key, message = conflict
            raise InputError(f"segments: {message}" if key == "segments" else f"links.{link.name}: {message}")
        return _Chain(link, beam)

    @property
    def modes(self) -> set[str]:
        """Names of the link's modal coordinates."""
        assert self.link.modes is not None
        return {component_name(self.link.name, kind) for kind in self.link.modes.names}

    @property
    def own(self) -> set[str]:
        """Names of joints of the link's nodes, which the chain has in their place."""
        return {joint.name for _, joint, _ in made_of(self.link)}

    @property
    def root(self) -> Link:
        """The link where its joint carries it: without mass, which the chain has."""
        return Link(self.link.name, 0.0, _STILL, (0.0,) * 6)

    def joints(self) -> Iterator[Joint]:
        """Yield the chain's joints, and those of nodes between its ends."""
        yield from self.beam.joints()
        assert self.link.modes is not None
        for node in self.link.modes.nodes[1:]:
            yield self._between(node_link(self.link.name, node.name), _distance(node.place, self.beam.axis))

    def _between(self, name: str, distance: float) -> Joint:
        """Return the joint that fixes a node's link, so far from the root, to the segment that it stands on."""
        turn, span = AXES[self.beam.axis], self.beam.span
        back: Matrix = tuple(zip(*turn, strict=True))  # type: ignore[assignment]  # three columns of three
        at = min(int(distance / span + 0.5), self.beam.segments)
        if not at:  # whose frame is the root's
            along = turn[0][0] * distance, turn[1][0] * distance, turn[2][0] * distance
            return Joint(name, self.beam.link_names[0], name, "fixed", Placement(along))
        place = Placement((distance - (at - 0.5) * span, 0.0, 0.0), back)
        return Joint(name, self.beam.link_names[at], name, "fixed", place)


def _distance(place: tuple[float, float, float], axis: str) -> float:
    """Return how far along the beam a place of its axis is, m."""
    turn = AXES[axis]
    return turn[0][0] * place[0] + turn[1][0] * place[1] + turn[2][0] * place[2]


def _check_stiffness(link: Link, beam: LinkBeam) -> None:
    """Refuse modes whose stiffness is not their beam's any more, as that of fitted ones."""
    assert link.modes is not None
    for k, row in enumerate(beam_modes(beam).K):
        found, of_beam = link.modes.K[k][k], row[k]
        if abs(found - of_beam) > _SAME * of_beam:
            where = f"links.{link.name}.modes.{k + 1}.stiffness"
            raise InputError(f"{where}: {found:g} J, and that of the beam is {of_beam:g} J; allowed: the beam's")


def _damping(link: Link, beam: LinkBeam) -> tuple[float, ...]:
    """Return damping of each coordinate of a segment by its stiffness, s: that of the first mode of its direction."""
    assert link.modes is not None
    damping, first = dict.fromkeys(COORDINATES, 0.0), 0
    for way, count in beam.modes.counts.items():
        if count:
            ratio = link.modes.D[first][first] / link.modes.K[first][first]
            damping |= dict.fromkeys(_MOVED[way], ratio)
        first += count
    return tuple(damping[key] for key in COORDINATES)


def _check_rest(robot: Robot, chains: list[_Chain]) -> None:
    """Refuse what stands on modes that a chain does not have."""
    modes = {name for chain in chains for name in chain.modes}
    own = {name for chain in chains for name in chain.own}
    carrying = {chain.link.name for chain in chains}
    for name, (slides, _) in sliding_joints(robot.joints, robot.couplings).items():
        if slides.parent in carrying:
            what = f"joints.{name}: it slides along {slides.parent}, and along a chain of segments nothing can slide"
            raise InputError(f"{what}; allowed: links along which no joint slides")
    for coupling in robot.couplings:
        others = modes.intersection(coupling.others)
        if joint_of(coupling.of) not in own and (coupling.of in modes or others):
            found = coupling.of if coupling.of in modes else min(others)
            raise InputError(f"couplings.{coupling.name}: it couples {found}; allowed: coordinates of joints")
    driven = sorted(modes.intersection(robot.driven or ()))
    if driven:
        raise InputError(f"driven: {listed(driven)}; allowed: coordinates of joints")
    bent = [name for name in robot.home if name in modes and robot.home[name] != 0.0]
    if bent:
        value = f"{robot.home[bent[0]]:g}"
        raise InputError(f"home.{bent[0]}: {value}, and chains of segments begin straight; allowed: 0, or none")


def _check_names(robot: Robot, chains: list[_Chain]) -> None:
    """Refuse names of others, and more links than a robot may have."""
    own = {name for chain in chains for name in chain.own}
    links, joints = {BASE, robot.base, *(x.name for x in robot.links)}, {x.name for x in robot.joints} - own
    for chain in chains:
        beam = chain.beam
        taken = [*filter(links.__contains__, beam.link_names), *filter(joints.__contains__, beam.joint_names)]
        if taken:
            what = f"links or joints of its chain would have the names of others: {listed(dict.fromkeys(taken))}"
            raise InputError(f"links.{chain.link.name}: {what}; allowed: other names of either")
        links |= set(beam.link_names)
        joints |= set(beam.joint_names)
    if len(links) > MOST_ENTRIES:
        raise InputError(f"segments: with them there are {len(links)} links; allowed: up to {MOST_ENTRIES}")


def _rebuilt(robot: Robot, chains: list[_Chain]) -> Robot:
    """Return the robot with the chains in the place of their links."""
    by_link = {chain.link.name: chain for chain in chains}
    own, modes = ({name for chain in chains for name in getattr(chain, of)} for of in ("own", "modes"))
    links: list[Link] = []
    for link in robot.links:
        chain = by_link.get(link.name)
        links += [link] if chain is None else [chain.root, *chain.beam.links()]
    first = {min(chain.own): chain for chain in chains}
    joints: list[Joint] = []
    for joint in robot.joints:
        if joint.name in first:
            joints += first[joint.name].joints()
        elif joint.name not in own:
            joints.append(joint)
    gone = tuple(f"links.{name}." for name in by_link)  # their numbers, and notes on them
    made = replace(
        robot,
        links=tuple(links),
        joints=_depth_first(robot.base, joints),
        couplings=tuple(x for x in robot.couplings if joint_of(x.of) not in own),
        home={name: x for name, x in robot.home.items() if name not in modes},
        beams=(*robot.beams, *(chain.beam for chain in chains)),
        notes=tuple(x for x in robot.notes if not x.startswith(gone)),
    )
    known = {name for name, _ in made.numbers() if not name.startswith(gone)}
    return replace(made, tunable=tuple(name for name in made.tunable if name in known))


def _depth_first(base: str, joints: list[Joint]) -> tuple[Joint, ...]:
    """Return joints in depth-first order, those on one link in the order in which they are."""
    above: dict[str, list[Joint]] = {}
    for joint in joints:
        above.setdefault(joint.parent, []).append(joint)
    ordered, pending = list[Joint](), above.get(base, [])[::-1]
    while pending:  # chains may be longer than Python's limit of recursion
        joint = pending.pop()
        ordered.append(joint)
        pending += above.get(joint.child, [])[::-1]
    return tuple(ordered)
