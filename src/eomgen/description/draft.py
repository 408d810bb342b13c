"""A description while it is read (Draft), and the check that its joints and links form one tree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

from ..errors import DescriptionError
from ..names import listed, nearest, show
from ..robot.elements import LinkElement
from ..robot.geometry import Vector
from ..robot.value import BASE, Beam, Coupling, Frame, Joint, Link, Loop

Place = tuple[int, int | None]  # line and column, from 1; None where the column is not known
GRAVITY: Vector = (0.0, 0.0, -9.81)


def spot(source: str, place: Place | None) -> str:
    """Return ``source:line:column`` in ASCII, as errors have it, as far as known."""
    error = DescriptionError("", source=source if source.isascii() and source.isprintable() else ascii(source))
    error.line, error.column = place or (None, None)
    return error.place


@dataclass
class Draft:
    """A robot while it is being read: links, joints and so on by name, in the order of the description.

    links holds the root link of a URDF as well; joints has the order in which a parent's children follow each other;
    ranges has limits by the names of coordinates where a format has them for any, None where joints' limits
    are all; unstopped names the joints at whose limits nothing stops unless stops are asked for.
    inherited names the links and joints that a URDF brought in; foreign the links whose inertia is that of a URDF or
    MJCF, which stands in the file xml_source, and places gives line and column of links.NAME and the like in it.
    free_modes names the links whose modes are those of a free link, sliding the joints that slide along their parents.
    """

    source: str
    name: str = ""
    base: str = BASE
    gravity: Vector = GRAVITY
    links: dict[str, Link] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)
    frames: dict[str, Frame] = field(default_factory=dict)
    loops: dict[str, Loop] = field(default_factory=dict)
    couplings: dict[str, Coupling] = field(default_factory=dict)
    elements: dict[str, LinkElement] = field(default_factory=dict)
    beams: dict[str, Beam] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] | None = None
    unstopped: list[str] = field(default_factory=list)
    driven: tuple[str, ...] | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    inherited: tuple[str, ...] = ()
    foreign: set[str] = field(default_factory=set)
    free_modes: set[str] = field(default_factory=set)
    sliding: list[str] = field(default_factory=list)
    xml_source: str = ""
    places: Callable[[Sequence[str]], list[Place | None]] = lambda wheres: [None for _ in wheres]

    def fail(self, where: str, message: str) -> NoReturn:
        """Raise the DescriptionError of this description."""
        raise DescriptionError(message, where=where, source=self.source)

    def spots(self, names: Sequence[str]) -> list[str]:
        """Return ``file:line:column`` of each link whose inertia is that of a URDF or MJCF, "" of the others."""
        places = self.places([f"links.{name}" for name in names])
        return [
            spot(self.xml_source, place) if name in self.foreign else ""
            for name, place in zip(names, places, strict=True)
        ]

    @property
    def pairs(self) -> dict[str, tuple[str, str]]:
        """Links that each loop and force element joins, by the place of this key."""
        pairs = {f"loops.{name}.links": loop.links for name, loop in self.loops.items()}
        return pairs | {f"{element.prefix}.links": element.links for element in self.elements.values()}

    def check_ends(self) -> None:
        """Raise DescriptionError if a frame, loop or force element is on a link that does not exist."""
        for frame in self.frames.values():
            self.check_link(frame.link, f"frames.{frame.name}.link")
        for where, links in self.pairs.items():
            for place, link in enumerate(links):
                self.check_link(link, f"{where}.{place}")

    def check_link(self, name: str, where: str) -> None:
        """Raise DescriptionError unless ``name`` is the base or a link."""
        if name != self.base and name not in self.links:
            known = [self.base, *(link for link in self.links if link != self.base)]
            allowed = "the base or a link: " + listed(known)
            self.fail(where, f"there is no link {show(name)}{nearest(name, known)} (allowed: {allowed})")


def ordered_joints(draft: Draft) -> list[Joint]:
    """Return the joints in depth-first order from the base, children in the order of the description.

    Raises:
        DescriptionError: a link that does not exist, has two parents or none, or is in a cycle.
    """
    carrier = _carriers(draft)
    children: dict[str, list[Joint]] = {}
    for joint in draft.joints.values():
        children.setdefault(joint.parent, []).append(joint)
    result: list[Joint] = []
    stack = children.get(draft.base, [])[::-1]
    while stack:  # a stack, not recursion: chains may be longer than Python's recursion limit
        joint = stack.pop()
        result.append(joint)
        stack += children.get(joint.child, [])[::-1]
    loose = [name for name in draft.links if name != draft.base and name not in carrier]
    if loose:
        draft.fail(
            f"links.{loose[0]}",
            f"no joint has this link as its child (there are {len(loose)} such links: "
            f"{listed(loose)}); allowed: every link but the base {show(draft.base)} is the child of one joint",
        )
    if len(result) < len(draft.joints):
        reached = {joint.name for joint in result}
        _fail_cycle(draft, carrier, next(joint for name, joint in draft.joints.items() if name not in reached))
    return result


def _carriers(draft: Draft) -> dict[str, Joint]:
    """Return the joint that carries each link, by the link's name."""
    carrier: dict[str, Joint] = {}
    for joint in draft.joints.values():
        where = f"joints.{joint.name}"
        draft.check_link(joint.parent, f"{where}.parent")
        if joint.child == draft.base:
            draft.fail(f"{where}.child", f"{show(joint.child)} is the base and is carried by no joint; allowed: a link")
        draft.check_link(joint.child, f"{where}.child")
        if joint.child in carrier:
            other = carrier[joint.child].name
            draft.fail(
                f"{where}.child",
                f"link {show(joint.child)} is already the child of joint {show(other)}; allowed: one parent per link",
            )
        carrier[joint.child] = joint
    return carrier


def _fail_cycle(draft: Draft, carrier: dict[str, Joint], joint: Joint) -> NoReturn:
    seen: dict[str, None] = {}
    while joint.name not in seen:  # every parent on this way is a carried link, or the base would have been reached
        seen[joint.name] = None
        joint = carrier[joint.parent]
    names = list(seen)
    cycle = names[names.index(joint.name) :]
    draft.fail(
        f"joints.{joint.name}",
        f"the joints {listed(cycle)} form a cycle; allowed: a tree that grows from the base {show(draft.base)}",
    )
