"""Bodies of MJCF and their contents: links, joints and frames of a Draft."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eomgen.limits import LARGEST
from eomgen.names import (
    NAME_LENGTH,
    component_name,
    joint_of,
    kind_of,
    listed,
    nearest,
    show,
    to_identifier,
    unique_identifiers,
)
from eomgen.robot.bounds import Limits
from eomgen.robot.geometry import ZERO
from eomgen.robot.value import COORDINATES, Frame, Joint, Link

from .defaults import Defaults
from .elements import BODY_KEYS, FRAME_KEYS, GEOM_KEYS, INERTIAL_KEYS, SITE_KEYS, JointReader
from .geoms import NOTHING, Mass, Rules, bounded, combined_mass, geom_mass, inertial_mass
from .joints import Group, Moving, groups
from .values import HERE, Array, Item, Pose, Reading, triple

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_INSIDE = ("inertial", "joint", "freejoint", "geom", "site", "camera", "light", "body", "frame")
_REFUSED = {
    "attach": "another model is attached",
    "replicate": "bodies are replicated",
    "composite": "bodies are made by a rule",
    "flexcomp": "a body that deforms is not supported",
    "plugin": "plugins are not read",
}
_COPIED = ("attach", "replicate", "composite")  # what MuJoCo writes out as bodies


class Names:
    """Identifiers of the file's names, and new ones that clash with none of them."""

    def __init__(self, texts: Sequence[str], reserved: Collection[str] = ()) -> None:
        kept = unique_identifiers(list(dict.fromkeys([*reserved, *texts])))
        self._taken = set(kept.values())
        self._count: dict[str, int] = {}
        self.of = {text: self.fresh(text) if text in reserved else kept[text] for text in texts}

    def reserve(self, names: Iterable[str]) -> None:
        """Reserve names, so that no new identifier is one of these."""
        self._taken.update(names)

    def fresh(self, text: str) -> str:
        """Return the text as an identifier that is not taken."""
        stem = to_identifier(text)[: NAME_LENGTH - 9]
        name = stem
        while name in self._taken:
            self._count[stem] = self._count.get(stem, 1) + 1
            name = f"{stem}_{self._count[stem]}"
        self._taken.add(name)
        return name


@dataclass(frozen=True)
class Place:
    """A body: its link, the last link before it that moves by itself, and its pose with joint springs unloaded.

    reference: its pose in the reference position.
    """

    link: str
    carrier: str
    world: Pose
    reference: Pose


@dataclass(frozen=True)
class Site:
    """A point of a link (m) with axes (columns), in its frame, and the body that it is on."""

    body: Place
    xyz: Array
    rotation: Array


@dataclass
class Bodies:
    """Reads bodies into the draft.  ``sites`` are those with names, by these, and ``places`` such bodies.

    written: gets the element of each link and joint.
    coordinates: of the file's hinges and slides, by their names in the file, and values in the reference position.
    ranges: limits within which MuJoCo keeps coordinates, by their names here.
    """

    reading: Reading
    defaults: Defaults
    rules: Rules
    flags: Mapping[str, bool]
    written: dict[str, Element]
    sites: dict[str, Site] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
    coordinates: dict[str, tuple[str, float]] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)

    def note(self, text: str, name: str) -> None:
        """Add a name to a remark that several share in one line."""
        self.notes.setdefault(text, []).append(name)

    def read(self, root: Element) -> None:
        """Read all bodies, depth first as MuJoCo orders them."""
        trees = list(root.iterfind("worldbody"))
        self._name(trees)
        world = self.places["world"] = Place(self.reading.draft.base, self.reading.draft.base, HERE, HERE)
        self.joint_reader = JointReader(self.reading, self.defaults, self.flags, self.note)
        stack: list[tuple[Element, Pose, str | None, Place]] = []
        for tree in reversed(trees):
            stack += self._fill(tree, world, None, "worldbody")[::-1]
        while stack:  # a stack, not recursion: chains may be longer than Python's recursion limit
            element, frame, childclass, parent = stack.pop()
            stack += self._body(element, frame, childclass, parent)[::-1]
        changed = [
            f"{show(text)} -> {name}"
            for names in (self.links, self.joints)
            for text, name in names.of.items()
            if text != name and "." not in text
        ]
        if changed:
            more = f" and {len(changed) - 8} more" if len(changed) > 8 else ""
            self.reading.draft.notes.append(f"names turned into identifiers: {', '.join(changed[:8])}{more}")
        self.reading.draft.notes += [f"{text}: {listed(names)}" for text, names in self.notes.items()]
        self.reading.draft.ranges = self.ranges

    def _name(self, trees: Sequence[Element]) -> None:
        """Assign identifiers to bodies, joints and sites, before any is made up."""
        texts: dict[str, list[str]] = {}
        for tag, others in (("body", ()), ("joint", ("freejoint",)), ("site", ())):
            seen: dict[str, None] = {}
            for tree in trees:
                for element in tree.iter():
                    name = element.get("name") if element.tag in (tag, *others) else None
                    if not name:
                        continue
                    if name in seen or (tag == "body" and name == "world"):
                        what = "this is MuJoCo's name of the ground" if name == "world" else "the name is taken"
                        Item(self.reading, element, f"{tag} {show(name)}").fail(f"{what}; allowed: unique names")
                    seen[name] = None
            texts[tag] = list(seen)
        self.links = Names(texts["body"], {self.reading.draft.base})
        self.joints = Names(texts["joint"])
        self.site_names = Names(texts["site"], set(self.links.of.values()))  # one asks for poses of both by name
        self.links.reserve(self.site_names.of.values())

    def _contents(
        self, element: Element, childclass: str | None, where: str
    ) -> Iterator[tuple[Element, Pose, str | None]]:
        """Yield the elements in a body, with the pose and the default class of the frames around them."""
        stack = [(child, HERE, childclass) for child in reversed(element)]
        while stack:
            child, pose, inherited = stack.pop()
            if child.tag == "frame":
                item = Item(self.reading, child, f"{where}, <frame>", FRAME_KEYS)
                inner = pose @ item.pose()
                stack += [(inside, inner, child.get("childclass") or inherited) for inside in reversed(child)]
            elif child.tag in _INSIDE:
                yield child, pose, inherited
            else:
                item = Item(self.reading, child, where)
                if child.tag in _REFUSED:
                    refuse = item.leave if child.tag in _COPIED else item.fail
                    refuse(f"{_REFUSED[child.tag]} (<{child.tag}>); allowed: bodies that are written out")
                known = f"{nearest(str(child.tag), _INSIDE)} (allowed: {', '.join(_INSIDE)})"
                item.fail(f"unknown element <{show(child.tag)[1:-1]}>{known}")

    def _fill(
        self, element: Element, body: Place, childclass: str | None, where: str
    ) -> list[tuple[Element, Pose, str | None, Place]]:
        """Read the sites of a body into the draft; return the bodies in it."""
        inner = []
        for child, pose, inherited in self._contents(element, childclass, where):
            if child.tag == "body":
                inner.append((child, pose, inherited, body))
            elif child.tag == "site" and child.get("name"):
                self._site(child, pose, inherited, body, where)
            elif child.tag in ("joint", "freejoint") and where == "worldbody":
                Item(self.reading, child, where).fail(f"<{child.tag}> is in the world; allowed: inside of a body")
        return inner

    def _site(self, element: Element, frame: Pose, childclass: str | None, body: Place, where: str) -> None:
        name = element.get("name", "")
        where = f"site {show(name)}"
        values = self.defaults.values(element, "site", where, childclass)
        item = Item(self.reading, element, where, SITE_KEYS, values)
        pose = frame @ (item.line()[0] if "fromto" in item else item.pose())
        made = self.site_names.of[name]
        if made != name:
            self.note("sites that are called otherwise here", f"{name} -> {made}")
        self.reading.draft.frames[made] = Frame(made, body.link, pose.placement())
        self.sites[name] = Site(body, pose.xyz, pose.rotation)

    def _body(
        self, element: Element, frame: Pose, childclass: str | None, parent: Place
    ) -> list[tuple[Element, Pose, str | None, Place]]:
        """Read a body into the draft; return the bodies in it."""
        text = element.get("name", "")
        link = self.links.of[text] if text else self.links.fresh("body")
        where = f"body {show(text or link)}"
        item = Item(self.reading, element, where, BODY_KEYS)
        self.written[f"links.{link}"] = element
        if item.number("gravcomp") != 0.0:
            item.fail(f"gravcomp is {show(item.values['gravcomp'])}: a force that carries it; allowed: 0")
        if item.flag("mocap"):
            self.note("mocap bodies stay where they are", text or link)
        childclass = element.get("childclass") or childclass
        inside = list(self._contents(element, childclass, where))
        joints = [
            self.joint_reader.joint(child, pose, inherited, where)
            for child, pose, inherited in inside
            if child.tag in ("joint", "freejoint")
        ]
        base = self.reading.draft.base
        if any(joint.kind == "free" for joint in joints) and (len(joints) > 1 or parent.link != base):
            item.fail("a free joint is not the only one, or not in a body of the world; allowed: alone, in such a body")
        place = frame @ item.pose()
        moves = bool(joints) or parent.carrier != base
        world = parent.world @ place
        for joint in joints:
            world = world @ joint.spring_pose
        body = Place(link, link if joints else parent.carrier, world, parent.reference @ place)
        if text:
            self.places[text] = body
        self._joints(element, joints, place, parent.link, link)
        self.reading.draft.links[link] = self._link(link, inside, where, moves)
        return self._fill(element, body, childclass, where)

    def _joints(self, element: Element, joints: Sequence[Moving], place: Pose, parent: str, link: str) -> None:
        """Add the body's joints, with links without mass between them; the last carries the body's link."""
        before, anchor = place, np.zeros(3)
        grouped = list(groups(joints))
        for group in grouped:
            name = self._joint_name(group, link)
            anchor = group.anchor
            child = link if group is grouped[-1] and not anchor.any() else self.links.fresh(f"{link}_{name}")
            at = Pose(before.rotation, before.point(anchor))
            self._add(element, _joint(name, parent, child, group, at))
            for coordinate, moving in group.by_coordinate.items():
                if moving.limits is not None and moving.limited:
                    self.ranges[component_name(name, coordinate)] = moving.limits
                if moving.name and moving.kind in ("hinge", "slide"):
                    self.coordinates[moving.name] = component_name(name, coordinate), -(moving.offset or 0.0)
            if child != link:
                self.reading.draft.links[child] = Link(child, 0.0, ZERO, (0.0,) * 6)
            parent, before = child, Pose(HERE.rotation, -anchor)
        if parent != link or not grouped:
            name = self.joints.fresh(f"{link}_frame" if grouped else f"{link}_fixed")
            self._add(element, Joint(name, parent, link, "fixed", before.placement()))

    def _add(self, element: Element, joint: Joint) -> None:
        self.written[f"joints.{joint.name}"] = element
        self.reading.draft.joints[joint.name] = joint

    def start(self) -> dict[str, float]:
        """Return coordinates of the reference position that are not 0, but for those beyond limits."""
        positions = {}
        for name, value in self.coordinates.values():
            limits = self.reading.draft.joints[joint_of(name)].limits_of(kind_of(name)).range
            if value != 0.0 and limits[0] <= value <= limits[1]:
                positions[name] = value
        return positions

    def _joint_name(self, group: Group, link: str) -> str:
        if group.stem:
            return self.joints.fresh(group.stem)
        first = group.joints[0]
        if len(group.joints) == 1:
            if first.kind in ("ball", "free"):
                what = "angles alpha, beta, gamma, which are singular at beta = +-pi/2"
                self.note(f"{first.kind} joints are read with {what}", first.name or link)
            return self.joints.of[first.name] if first.name else self.joints.fresh(f"{link}_joint")
        name = self.joints.fresh(f"{link}_joint")
        for coordinate, joint in group.by_coordinate.items():
            self.note("joints of one body that became one", f"{joint.name or joint.kind} -> {name}.{coordinate}")
        return name

    def _link(self, name: str, inside: Sequence[tuple[Element, Pose, str | None]], where: str, moves: bool) -> Link:
        """Return mass and inertia: those of <inertial>, or of the geoms; bodies fixed to the world need none."""
        inertials = [(child, pose) for child, pose, _ in inside if child.tag == "inertial"]
        if len(inertials) > 1:
            Item(self.reading, inertials[1][0], where).fail("there are two <inertial>; allowed: one")
        body = NOTHING
        for child, pose in inertials:
            item = Item(self.reading, child, f"{where}, <inertial>", INERTIAL_KEYS)
            if pose is not HERE:
                item.fail("it is inside of a <frame>; allowed: in the body itself")
            body = inertial_mass(item)
        wanted = {"auto": not inertials, "true": True, "false": False}[self.rules.from_geoms]
        if moves and wanted:
            masses = [
                self._geom(child, pose, inherited, where) for child, pose, inherited in inside if child.tag == "geom"
            ]
            body = combined_mass([mass for mass in masses if mass.mass > 0.0] or [body])
        if moves:
            body = bounded(body, self.rules)
        i = body.inertia
        xx, yy, zz, xy, xz, yz = i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]
        xx, yy, zz, xy, xz, yz = (float(value) + 0.0 for value in (xx, yy, zz, xy, xz, yz))
        link = Link(name, body.mass, triple(body.com), (xx, yy, zz, xy, xz, yz))
        for what, value in (("mass", link.mass), ("inertia", float(np.abs(i).max()))):
            if not value <= LARGEST:
                self.reading.draft.fail(where, f"its {what} is {value:g}; allowed: up to {LARGEST:g}")
        return link

    def _geom(self, element: Element, frame: Pose, childclass: str | None, where: str) -> Mass:
        name = element.get("name")
        where = f"{where}, geom {show(name)}" if name else f"{where}, <geom>"
        values = self.defaults.values(element, "geom", where, childclass)
        return geom_mass(Item(self.reading, element, where, GEOM_KEYS, values), frame, self.rules)


def _joint(name: str, parent: str, child: str, group: Group, place: Pose) -> Joint:
    """Return a group of the file's joints as one of a Robot."""
    a, b, c = group.turn
    moving = group.by_coordinate
    coordinates = {coordinate: joint.coordinate for coordinate, joint in moving.items()}
    offset = tuple(moving[key].offset if key in moving else None for key in COORDINATES)
    turn = triple(a), triple(b), triple(c)
    damping = group.joints[0].damping
    made = Joint(name, parent, child, group.type, place.placement(), turn, coordinates, None, offset, damping=damping)
    for key, joint in moving.items():
        lower, upper = joint.limits or (None, None)
        made = made.with_limits(key, Limits(lower, upper, effort=joint.effort))
    return made
