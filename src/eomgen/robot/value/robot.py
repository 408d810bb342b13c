"""The robot: its links, joints, loops, elements and couplings, and the copies of it that are changed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from ...errors import UnknownNameError
from ...lazily import kept
from ...names import (
    component_name,
    html_table,
    joint_of,
    kind_of,
    nearest_or_all,
    parameter_name,
    show,
    split_component,
)
from ..bounds import Limits
from ..elements import Element, LinkElement
from ..elements.spring import Spring
from ..fields import LATER, Numbers, Picklable, below
from ..geometry import LINEAR, Vector
from .beam import Beam
from .coordinate import Coordinate
from .coupling import Coupling, first_contradiction, with_screws
from .joint import MOTOR, Joint, Loop
from .link import BASE, Frame, Link
from .nodes import node_link, sliding_joints
from .sensor import Sensor


@dataclass(frozen=True)
class Robot(Picklable):
    """A validated robot.  Links exclude the base; ``base`` is the base link's name in the description.

    joints are in depth-first order; ``loops`` are the joints that close it, cut; ``springs`` act between points of
    links, other ``elements`` between frames of links; ``couplings`` join coordinates; ``tunable`` names parameters that
    stay run-time values; ``notes`` are one-line remarks about the reading (an inertia that was projected, say), for the
    user to see.
    driven: names of the actuated coordinates (of a joint or its motor, which is the same drive); None: the
    principal ones; ``actuated_coordinates`` has the names in both cases.  home: where simulations start and assembly
    begins, m or rad by coordinate; default 0.
    beams: what some links and joints were made of, for ``with_value``; nothing else looks at them.
    sensors: what the kernel ``measurement`` tells, in its order; see ``eomgen.control.Measurement``.
    """

    name: str
    gravity: Vector
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...] = ()
    tunable: tuple[str, ...] = ()
    base: str = BASE
    source: str = ""
    notes: tuple[str, ...] = ()
    loops: tuple[Loop, ...] = ()
    springs: tuple[Spring, ...] = ()
    driven: tuple[str, ...] | None = field(default=None, metadata=LATER)
    home: Mapping[str, float] = field(default_factory=dict, hash=False, metadata=LATER)
    couplings: tuple[Coupling, ...] = field(default=(), metadata=LATER)
    elements: tuple[Element, ...] = field(default=(), metadata=LATER)
    beams: tuple[Beam, ...] = field(default=(), metadata=LATER)
    sensors: tuple[Sensor, ...] = field(default=(), metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "home", MappingProxyType(dict(self.home)))
        object.__setattr__(self, "couplings", with_screws(self.couplings, self.joints))

    def _repr_html_(self) -> str:
        """Return a small table, for notebooks."""
        rows = {
            "source": self.source or "none",
            "gravity, m/s^2": ", ".join(f"{x:g}" for x in self.gravity),
            "links": len(self.links),
            "mass, kg": f"{sum(link.mass for link in self.links):.6g}",
            "joints": len(self.joints),
            "coordinates": len(self.coordinates) - len(self.followers),
            "loops": len(self.loops),
            "springs between points": len(self.springs),
            "other force elements": len(self.elements),
            "couplings": len(self.couplings),
            "frames": ", ".join(frame.name for frame in self.frames) or "none",
        }
        return html_table(f"Robot {self.name}", rows)

    def show(self, path: Path | str | None = None, *, browser: bool | None = None) -> Any:
        """Show the robot as a page with a slider for each joint; nothing is simulated or compiled.

        Args:
            path: to write the page to, .html; None for none.
            browser: whether to open it; by default unless a notebook shows it, or it is written to a path.

        Returns:
            The page: notebooks show it below their cell, ``save(path)`` writes it, ``open()`` opens it in the browser.

        Raises:
            InputError: the file cannot be written.
        """
        from ...export.live.view import show_robot

        return show_robot(self, path, browser=browser)

    @property
    def link_elements(self) -> tuple[LinkElement, ...]:
        """All force elements between two links, springs first."""
        return (*self.springs, *self.elements)

    def numbers(self) -> Numbers:
        """Yield every number of the description that may be a parameter, by its name; None where one is not set."""
        yield from below("gravity", zip(LINEAR, self.gravity, strict=True))
        for link in self.links:
            yield from below(f"links.{link.name}", link.numbers())
        for joint in self.joints:
            yield from below(f"joints.{joint.name}", joint.numbers())
        for frame in self.frames:
            yield from below(f"frames.{frame.name}.placement", frame.placement.numbers())
        for loop in self.loops:
            yield from below(f"loops.{loop.name}", loop.numbers())
        for coupling in self.couplings:
            yield from below(f"couplings.{coupling.name}", coupling.numbers().items())
        for element in self.link_elements:
            yield from below(element.prefix, element.numbers())

    def link(self, name: str) -> Link:
        """Return the link of that name; UnknownNameError if there is none."""
        return _known("link", name, _links_by_name(self))

    def joint(self, name: str) -> Joint:
        """Return the joint of that name; UnknownNameError if there is none."""
        return _known("joint", name, _joints_by_name(self))

    @property
    @kept
    def coordinates(self) -> Mapping[str, Coordinate]:
        """Properties of all coordinates by their names, in the order of q, followers among them.

        Behind those of a joint stand the modes of the link that it carries; a motor's are its rotor's.
        """
        modes = {link.name: link.modes for link in self.links if link.modes is not None}
        found: dict[str, Coordinate] = {}
        for joint in self.joints:
            found |= {component_name(joint.name, kind): x for kind, x in joint.all_coordinates.items()}
            if joint.child in modes:
                own = modes[joint.child].coordinates()
                found |= {component_name(joint.child, kind): x for kind, x in own.items()}
        return MappingProxyType(found)

    @property
    def principal_coordinates(self) -> dict[str, str]:
        """Names of the principal coordinates that move, by joint, which files of measurements call them by, too."""
        kinds = {joint.name: (joint.principal, joint.coordinates) for joint in self.joints}
        return {name: component_name(name, kind) for name, (kind, own) in kinds.items() if kind in own and kind}

    @property
    def actuated_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that have a drive, in the order of q: those of ``driven``, or its default."""
        from ..mechanism import driven_coordinates

        return tuple(driven_coordinates(self, self.coordinates))

    @property
    @kept
    def modal_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that are modes of links, in the order of q."""
        bending = {link.name for link in self.links if link.modes is not None}
        joints = {joint.name: joint for joint in self.joints}
        kinds = {name: split_component(name) for name in self.coordinates}
        return tuple(
            name
            for name, (owner, kind) in kinds.items()
            if owner in bending and not (owner in joints and kind in joints[owner].all_coordinates)
        )

    @property
    @kept
    def nodes(self) -> dict[str, str]:
        """Links that bend, by the joints that their nodes are made of, and places on them where others slide."""
        places = sliding_joints(self.joints, self.couplings)
        return {bent.name: slides.parent for slides, bent in places.values()} | {
            node_link(link.name, node.name): link.name
            for link in self.links
            if link.modes is not None
            for node in link.modes.nodes
        }

    def limits_of(self, coordinate: str) -> Limits:
        """Return the limits of a coordinate by its name, "joint1.gamma"; an empty one where it has none."""
        if coordinate in self.modal_coordinates:
            return Limits()
        joint, name = split_component(coordinate)
        return self.joint(joint).limits_of(name)

    def coordinate_laws(self) -> Iterator[tuple[str, str, Coordinate]]:
        """Yield prefixes of parameters of laws, the kinds of their deviations ("x", "motor"), and their numbers.

        They are those of joints' coordinates and motors, then of transmissions, loop joints and couplings.
        """
        for joint in self.joints:
            for kind, coordinate in joint.all_coordinates.items():
                yield parameter_name("joints", joint.name, kind), kind, coordinate
        for joint in self.joints:
            if joint.motor is not None:
                prefix = parameter_name("joints", joint.name, MOTOR)
                yield prefix, joint.principal, joint.motor.transmission
        for loop in self.loops:
            yield from ((parameter_name("loops", loop.name, kind), kind, x) for kind, x in loop.coordinates.items())
        for coupling in self.couplings:
            if coupling.law is not None:
                yield parameter_name("couplings", coupling.name), kind_of(coupling.of), coupling.law

    @property
    def is_closed(self) -> bool:
        """True if something beside the tree holds coordinates: loops, or couplings but those of ``followers``."""
        return bool(self.loops or len(self.couplings) > len(self.followers))

    @property
    def followers(self) -> dict[str, Coupling]:
        """Couplings by the coordinates that they make followers, each behind its leaders.

        A follower is no coordinate of kernels: its position, velocity and acceleration are those that its leaders give
        it.  Of rigid couplings those stay constraints whose dependent coordinate moves a loop, belongs to a joint with
        a motor, a journal, or stiffness or damping as a whole, follows a motor, or has a drive and follows
        several, and those that ``is_constraint`` keeps.  z of a screw is a follower in any case but the last one.
        """
        acted_on = {x.name for x in self.joints if x.motor is not None or x.elements}
        shared = {x.of for x in self.couplings if len(x.to) - [*x.to.values()].count(0.0) != 1}
        acted_on |= {joint_of(name) for name in self.driven or () if name in shared}
        kept = (_in_loops(self) | acted_on).difference(self.nodes)  # which carry no mass of their own
        rigid = [x for x in self.couplings if x.law is None and not x.is_constraint]
        able = (x for x in rigid if x.pitch is not None or joint_of(x.of) not in kept)
        left = {x.of: x for x in able if all(kind_of(name) != MOTOR for name in x.to)}
        behind: dict[str, list[str]] = {}
        for name, coupling in left.items():
            for other in left.keys() & coupling.others:
                behind.setdefault(other, []).append(name)
        ahead = {name: len(left.keys() & coupling.others) for name, coupling in left.items()}
        ready = [name for name, count in ahead.items() if not count]
        for name in ready:  # which grows
            for other in behind.get(name, ()):
                ahead[other] -= 1
                ready += [other] if not ahead[other] else []
        return {name: left[name] for name in ready}

    def with_constraints(self) -> Robot:
        """Return the robot without followers: all rigid couplings are rows of the constraint.

        Coordinates of nodes follow the modes of their links as before: they are none of the robot's own.
        """
        own = {name for name in self.followers if joint_of(name) not in self.nodes}
        couplings = tuple(
            replace(x, is_constraint=True) if x.law is None and joint_of(x.of) not in self.nodes else x
            for x in self.couplings
        )
        return replace(self, couplings=couplings) if own else self

    @property
    def own_couplings(self) -> tuple[Coupling, ...]:
        """Couplings but for those that nodes of links that bend are made of."""
        nodes = self.nodes
        return tuple(x for x in self.couplings if joint_of(x.of) not in nodes)

    @kept
    def without_states(self) -> Robot:
        """Return the robot without laws that have states.

        Friction with bristles slides as at steady velocities, and the share of hysteresis that is elastic is stiffness.
        """
        made = replace(
            self,
            joints=tuple(x.without_states() for x in self.joints),
            loops=tuple(x.without_states() for x in self.loops),
            couplings=tuple(x.without_states() for x in self.couplings),
        )
        if made == self:
            return self
        known = {name for name, _ in made.numbers()}
        return replace(made, tunable=tuple(name for name in self.tunable if name in known))

    @kept
    def rigid(self) -> Robot:
        """Return the robot with deviations locked: principal and prescribed coordinates and free joints move.

        Stops of joints and internal states are left out: friction is that of sliding bristles.  Links do not bend.

        Where there are loops, coordinates without a stiffness move, too: the loops hold them.

        Loop joints are rigid in what their types block, couplings with a stiffness where that contradicts no other one.
        Transmissions are rigid: a motor counts as an armature, and the motion of one that is prescribed as its joint's.
        Springs and other force elements between links that then do not move against each other are left out.
        """
        nodes = self.nodes
        joints = [joint.rigid(loose=bool(self.loops) and joint.name not in nodes) for joint in self.joints]
        loops = [loop.rigid() for loop in self.loops]
        carrier = {self.base: self.base}
        for joint in joints:
            carrier[joint.child] = joint.child if joint.coordinates else carrier[joint.parent]
        springs = tuple(s for s in self.springs if carrier[s.links[0]] != carrier[s.links[1]])
        elements = tuple(x for x in self.elements if carrier[x.links[0]] != carrier[x.links[1]])
        moving = {f"{joint.name}.{name}" for joint in joints for name in joint.coordinates}
        drives = {f"{j.name}.{MOTOR}": f"{j.name}.{j.principal}" for j in self.joints if j.motor is not None}
        driven = None if self.driven is None else dict.fromkeys(drives.get(name, name) for name in self.driven)
        couplings: tuple[Coupling, ...] = ()
        for coupling in self.couplings:
            stiff = coupling.rigid(moving)
            if stiff is not None:
                fits = first_contradiction((*couplings, stiff)) is None
                couplings += (stiff if fits else coupling,)
        links = tuple(replace(link, modes=None) if link.modes is not None else link for link in self.links)
        made = replace(self, name=self.name[:42] + "_rigid", links=links, joints=tuple(joints), loops=tuple(loops))
        more = replace(made, couplings=couplings).followers.keys() - self.followers.keys()  # are coordinates here, too
        made = replace(
            made,
            springs=springs,
            elements=elements,
            driven=None if driven is None else tuple(name for name in driven if name in moving),
            home={name: value for name, value in self.home.items() if name in moving},
            couplings=tuple(replace(x, is_constraint=True) if not x.law and x.of in more else x for x in couplings),
            beams=(),
            sensors=(),
        )
        known = {name for name, _ in made.numbers()}
        return replace(made, tunable=tuple(name for name in self.tunable if name in known))

    def with_value(self, path: str, value: Any) -> Robot:
        """Return the robot with one value of its description changed, checked as those that are loaded.

        Args:
            path: keys and names with dots: a parameter ("links.arm.mass", "joints.joint1.x.stiffness", "gravity.z"), or
                a whole value ("links.arm.com", "joints.joint1.limits"), as which joints take tables with the keys of
                TOML ("joints.joint1.motor": {"inertia": 1e-4, "ratio": 100, "stiffness": 2e4}).  A number of a beam
                ("beams.boom.E") makes all its links and joints anew.
            value: a number, a list, a text or a mapping, in SI units; numbers that follow from it follow anew.

        Raises:
            DescriptionError: there is no such value (says what is there), or no robot can have it.
        """
        return self.with_values({path: value})

    def with_values(self, changes: Mapping[str, Any]) -> Robot:
        """Return the robot with several values changed at once, by their paths; see ``with_value``."""
        from ...description.changing import with_values

        return with_values(self, changes)

    def with_segments(self, segments: int, links: Collection[str] | None = None) -> Robot:
        """Return the robot with links that bend as chains of rigid segments with elastic joints, as ``[[beams]]`` are.

        A link "arm" that is a beam becomes a link without mass and a beam "arm" of links arm0, arm1, ..., which deflect
        along and about the axes that its modes move, and may do so far.  Nodes are links of the same names; so all that
        stands on them stays.  The first mode of each direction is damped as before, others by their frequencies more.

        Args:
            segments: of each chain, from 1 on.
            links: names of links; None for all that bend.

        Raises:
            InputError: no link bends; one that should become a chain is no beam, its modes are no longer the beam's, or
                couplings, drives or a home need its modes; a number of segments that no beam has; or names are taken.
        """
        from ...bending.beams.segments import with_segments

        return with_segments(self, segments, links)

    def with_coordinates(self, coordinates: Mapping[str, Mapping[str, Coordinate]]) -> Robot:
        """Return the robot with these coordinates (by joint, then by name) active, too."""
        joints = tuple(
            replace(joint, coordinates={**joint.coordinates, **coordinates.get(joint.name, {})})
            for joint in self.joints
        )
        return replace(self, joints=joints)


def _in_loops(robot: Robot) -> set[str]:
    """Return the names of the joints on a loop: they move the two sides of its loop joint against each other."""
    above = {joint.child: joint for joint in robot.joints}

    def path(link: str) -> set[str]:
        names = set()
        while link in above:
            names.add(above[link].name)
            link = above[link].parent
        return names

    return {name for loop in robot.loops for name in path(loop.links[0]) ^ path(loop.links[1])}


@kept
def _links_by_name(robot: Robot) -> dict[str, Link]:
    return {link.name: link for link in robot.links}


@kept
def _joints_by_name(robot: Robot) -> dict[str, Joint]:
    return {joint.name: joint for joint in robot.joints}


_Named = TypeVar("_Named", Link, Joint)


def _known(what: str, name: str, known: Mapping[str, _Named]) -> _Named:
    """Return the item of that name; UnknownNameError if there is none."""
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(f"{what}: {show(name)} is unknown{nearest_or_all(str(name), known)}")
    return known[name]
