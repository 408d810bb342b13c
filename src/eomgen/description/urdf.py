"""URDF in, Draft out: a small reader that trusts nothing it reads.

The joint frame is placement . axis_turn, so that its z is the joint's axis; the child link's frame is the URDF's.
Ignored: visual, collision, transmission and everything else that is neither link nor joint of the robot.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NoReturn

from ..errors import DescriptionError
from ..identifiers import is_robot_name, to_robot_name, unique_identifiers
from ..limits import LARGEST, MOST_ENTRIES
from ..names import component_name, listed, nearest, show
from ..robot.bounds import Limits
from ..robot.geometry import IDENTITY, ZERO, Matrix, Vector, axis_turn, turn_inertia
from ..robot.joint_types import JOINT_TYPES
from ..robot.laws import SMOOTHING
from ..robot.value import Coordinate, Coupling, Friction, Joint, Link, Placement
from .draft import Draft, spot
from .xml_text import NUMBER, Xml, parse_xml

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

TYPES = {word: name for name, kind in JOINT_TYPES.items() for word in kind.urdf} | {
    "planar": "revolute",  # with x and y
}
IN_PLANE = ("x", "y", "gamma")  # coordinates of a planar joint, about and across its axis
SDF = (
    "SDF is not read; allowed: the URDF that it was made from, or MJCF, as sdformat_mjcf of"
    " https://github.com/gazebosim/gz-mujoco writes it"
)
_XACRO = "a file that ends in .xacro, which eomgen[xacro] expands with --xacro, or xacro=True"
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_ENDLESS = ("inf", "+inf", "infinity")
_FIRST_COUNTS = ("axis", "limit", "dynamics")  # where several differ: so they do in urdfdom, and so in Pinocchio


def draft_from_urdf(
    text: str, source: str, *, damping: bool = False, friction: bool = False, mimic: bool = True
) -> Draft:
    """Read a URDF.

    Args:
        text: the XML.
        source: the file's name, for messages.
        damping: put <dynamics damping> into the principal coordinates; otherwise a note says that it is left out.
        friction: the same for <dynamics friction>, as Coulomb friction.
        mimic: make couplings of <mimic>; otherwise a note says that the joints are independent.

    Raises:
        DescriptionError: anything that is not a robot, with the element and the name it belongs to.
    """
    xml = parse_xml(text, source)
    reader = _Reader(xml, damping, friction, mimic)
    try:
        return reader.read()
    except DescriptionError as error:
        error.line, error.column = xml.place(reader.at) or (None, None)
        raise


class _Reader:
    """One URDF being read; ``where`` of a message is the element's kind and name, ``at`` the element being read."""

    def __init__(self, xml: Xml, damping: bool, friction: bool, mimic: bool) -> None:
        self.xml = xml
        self.draft = Draft(xml.source, xml_source=xml.source, notes=list(xml.notes))
        self.draft.places = lambda wheres: xml.places_of([self.element(where) for where in wheres])
        self.root = self.at = xml.root
        self.written: dict[str, Element] = {}  # by what messages about the whole robot say: links.NAME
        self.mended: list[tuple[Element, str]] = []  # elements that are not as they should be, and how they are read
        self.damping, self.friction, self.mimic = damping, friction, mimic
        self.damped: list[str] = []
        self.with_friction: list[str] = []
        self.unlimited: list[str] = []  # limits of velocity and effort that are not above 0
        self.mimics: dict[str, Element] = {}  # by the joints that follow
        self.planar: list[str] = []
        self.unmoved: list[str] = []  # those of them that have no coordinate to follow with

    def fail(self, where: str, message: str) -> NoReturn:
        self.draft.fail(where, message)

    def element(self, where: str) -> Element:
        """Return the element of the link or joint in a message about the whole robot, as in joints.NAME.child."""
        return self.written.get(".".join(where.split(".")[:2]), self.root)

    def read(self) -> Draft:
        root = self.root
        if root.tag == "sdf":
            self.fail("", f"the root element is 'sdf', not 'robot': {SDF}")
        if root.tag != "robot":
            self.fail("", f"the root element is {show(root.tag)}; allowed: 'robot'")
        macro = _macro(root)
        if macro:
            self.fail("robot", f"{show(macro)} is a xacro macro; allowed: a URDF that xacro has expanded, or {_XACRO}")
        links, joints = self._named(root, "link"), self._named(root, "joint")
        if not links:
            self.fail("robot", "there is no <link>; allowed: at least one link and one joint that moves")
        self._name_robot(root)
        link_names = self._identifiers("link", list(links))
        joint_names = self._identifiers("joint", list(joints))
        for name, element in links.items():
            self.written[f"links.{link_names[name]}"] = self.at = element
            self.draft.links[link_names[name]] = self._link(link_names[name], element, f"link {show(name)}")
        for name in sorted(joints):  # the order in which urdfdom, and so Pinocchio, visits the children of a link
            self.written[f"joints.{joint_names[name]}"] = self.at = joints[name]
            joint = self._joint(joint_names[name], joints[name], f"joint {show(name)}", link_names)
            self.draft.joints[joint.name] = joint
        if self.mimic:
            for name, element in self.mimics.items():
                self._follow(name, element, joint_names)
        self.at = root
        self.draft.foreign = set(self.draft.links)
        self.draft.base = self._root()
        self._remarks()
        return self.draft

    def _named(self, root: Element, tag: str) -> dict[str, Element]:
        """Return the robot's links or joints by their name as written."""
        elements: dict[str, Element] = {}
        for element in root.iterfind(tag):
            self.at = element
            name = element.get("name")
            if not name:
                self.fail(f"{tag} number {len(elements) + 1}", "the attribute name is missing; allowed: a unique name")
            if name in elements:
                self.fail(f"{tag} {show(name)}", f"there are two {tag}s of this name; allowed: unique names")
            if len(elements) == MOST_ENTRIES:
                count = len(root.findall(tag))
                self.fail(f"{tag} {show(name)}", f"there are {count} {tag}s; allowed: up to {MOST_ENTRIES}")
            elements[name] = element
        return elements

    def _name_robot(self, root: Element) -> None:
        self.at = root
        name = root.get("name")
        if not name:
            self.fail("robot", "the attribute name is missing; allowed: a name")
        self.draft.name = name if is_robot_name(name) else to_robot_name(name)
        if self.draft.name != name:
            self.draft.notes.append(f"robot {show(name)} is called {self.draft.name} here")

    def _identifiers(self, tag: str, names: list[str]) -> dict[str, str]:
        result = unique_identifiers(names)
        changed = [f"{show(name)} -> {new}" for name, new in result.items() if name != new]
        if changed:
            more = f" and {len(changed) - 8} more" if len(changed) > 8 else ""
            self.draft.notes.append(f"{tag} names turned into identifiers: {', '.join(changed[:8])}{more}")
        return result

    def _link(self, name: str, element: Element, where: str) -> Link:
        inertial = self._only(element, "inertial", where)
        if inertial is None:
            return Link(name, 0.0, ZERO, (0.0,) * 6)
        where += ", <inertial>"
        origin = self._origin(inertial, where)
        mass_element = self._only(inertial, "mass", where)
        if mass_element is None:
            self.fail(where, "there is no <mass>; allowed: <mass value='...'/> in kg")
        mass = self._number(mass_element, "value", f"{where}, <mass>")
        if mass < 0.0:
            self.fail(f"{where}, <mass>", f"value is {mass:g}; allowed: a mass of at least 0 kg")
        moments = self._only(inertial, "inertia", where)
        if moments is None:
            return Link(name, mass, origin.xyz, (0.0,) * 6)
        xx, yy, zz, xy, xz, yz = (self._number(moments, key, f"{where}, <inertia>") for key in _MOMENTS)
        return Link(name, mass, origin.xyz, turn_inertia((xx, yy, zz, xy, xz, yz), origin.rotation))

    def _joint(self, name: str, element: Element, where: str, links: dict[str, str]) -> Joint:
        kind = element.get("type", "")
        if kind not in TYPES:
            got = f"type is {show(kind)}" if "type" in element.attrib else "the attribute type is missing"
            self.fail(where, f"{got}; allowed: {', '.join(TYPES)}")
        parent, child = (links[self._end(element, end, where, links)] for end in ("parent", "child"))
        turn, coordinates, limits = IDENTITY, {}, None
        if kind == "planar":
            turn, coordinates = self._axis(element, where), {key: Coordinate() for key in IN_PLANE}
            self.planar.append(name)
        elif (own := JOINT_TYPES[TYPES[kind]]).principal:
            turn = self._axis(element, where)
            dynamics = self._dynamics(element, where, name)
            limits, drive = self._limits(element, where, name, ranged=kind != "continuous")
            coordinates = {own.principal: replace(dynamics, limits=drive or None)}
        else:
            coordinates = {key: Coordinate() for key in own.coordinates or ()}
        mimic = self._only(element, "mimic", where)
        if mimic is not None:
            self.mimics[name] = mimic
        return Joint(name, parent, child, TYPES[kind], self._origin(element, where), turn, coordinates, limits)

    def _follow(self, name: str, element: Element, names: dict[str, str]) -> None:
        """Couple a joint that follows another: value = multiplier * that of the other + offset."""
        self.written[f"couplings.{name}"] = self.at = element
        where = f"joint {show(name)}, <mimic>"
        kind = self.draft.joints[name].principal
        text = element.get("joint", "")
        multiplier = self._number(element, "multiplier", where, 1.0)
        offset = self._number(element, "offset", where, 0.0)
        if text not in names or names[text] in self.planar or not self.draft.joints[names[text]].principal:
            what = "has no coordinate to follow" if text in names else f"is not there{nearest(text, names)}"
            self.mended.append((element, f"{where}: the joint {show(text)} {what}; it is read as independent"))
            return
        if not kind or name in self.planar:
            self.unmoved.append(name)
            return
        other = self.draft.joints[names[text]]
        to = {component_name(other.name, other.principal): multiplier}
        self.draft.couplings[name] = Coupling(name, component_name(name, kind), to, offset or None)

    def _end(self, element: Element, end: str, where: str, links: dict[str, str]) -> str:
        end_element = self._only(element, end, where)
        name = None if end_element is None else end_element.get("link")
        if not name:
            self.fail(where, f"there is no <{end} link='...'/>; allowed: the name of a link")
        if name not in links:
            message = f"there is no link {show(name)}{nearest(name, links)} (allowed: {listed(links)})"
            self.fail(f"{where}, <{end}>", message)
        return name

    def _axis(self, element: Element, where: str) -> Matrix:
        axis_element = self._only(element, "axis", where)
        axis = (
            (1.0, 0.0, 0.0)
            if axis_element is None
            else self._vector(axis_element, "xyz", f"{where}, <axis>", (1.0, 0.0, 0.0))
        )
        if math.hypot(*axis) < 1e-12:
            self.fail(f"{where}, <axis>", f"xyz is {show(list(axis))}; allowed: a vector with a direction")
        return axis_turn(axis)

    def _limits(
        self, element: Element, where: str, name: str, *, ranged: bool
    ) -> tuple[tuple[float, float] | None, Limits]:
        """Return a joint's range, if it has one, and its velocity and effort limits; 0 and inf stand for none."""
        limit = self._only(element, "limit", where)
        if limit is None:
            return None, Limits()
        where += ", <limit>"
        texts = {key: limit.get(key, "").strip() for key in ("velocity", "effort") if key in limit.attrib}
        endless = [key for key, text in texts.items() if text.lower() in _ENDLESS]
        numbers = {key: self._number(limit, key, where) for key in texts if key not in endless}
        self.unlimited += [f"{name} {key}" for key in texts if key in endless or not numbers[key] > 0.0]
        drive = Limits(**{key: value for key, value in numbers.items() if value > 0.0})
        if not ranged or not {"lower", "upper"} & set(limit.attrib):
            return None, drive
        lower, upper = (self._number(limit, key, where, 0.0) for key in ("lower", "upper"))
        if lower > upper:
            said = f"{where}: lower is {lower:g} and upper is {upper:g}; they are read the other way round"
            self.mended.append((limit, said))
        return (min(lower, upper), max(lower, upper)), drive

    def _dynamics(self, element: Element, where: str, name: str) -> Coordinate:
        """Return the principal coordinate with damping and friction as far as they are wanted."""
        dynamics = self._only(element, "dynamics", where)
        if dynamics is None:
            return Coordinate()
        where += ", <dynamics>"
        damping, friction = (self._number(dynamics, key, where, 0.0) for key in ("damping", "friction"))
        if damping < 0.0:
            self.fail(where, f"damping is {damping:g}; allowed: at least 0")
        if friction < 0.0 and self.friction:
            self.fail(where, f"friction is {friction:g}; allowed: at least 0")
        if damping:
            self.damped.append(name)
        if friction:
            self.with_friction.append(name)
        return Coordinate(
            damping=damping if damping and self.damping else None,
            friction=Friction(friction) if friction and self.friction else None,
        )

    def _origin(self, element: Element, where: str) -> Placement:
        origin = self._only(element, "origin", where)
        if origin is None:
            return Placement()
        where += ", <origin>"
        xyz = self._vector(origin, "xyz", where, ZERO)
        if "rpy" not in origin.attrib:
            return Placement(xyz)
        return Placement.from_rpy(xyz, self._vector(origin, "rpy", where, ZERO))

    def _only(self, element: Element, tag: str, where: str) -> Element | None:
        """Return the child element of that tag; None if there is none."""
        children = element.findall(tag)
        self.at = children[-1] if children else element
        if len(children) > 1:
            same = all(_content(other) == _content(children[0]) for other in children[1:])
            if not same and tag not in _FIRST_COUNTS:
                self.fail(where, f"there are {len(children)} elements <{tag}> that differ; allowed: one")
            which = "which say the same" if same else "of which the first counts, as in other readers"
            self.mended.append((children[1], f"{where}: there are {len(children)} elements <{tag}>, {which}"))
            self.at = children[0]
        return children[0] if children else None

    def _number(self, element: Element, key: str, where: str, default: float | None = None) -> float:
        text = element.get(key)
        if text is None:
            if default is None:
                self.fail(where, f"the attribute {key} is missing; allowed: a finite number")
            return default
        return self._float(text.strip(), key, where)

    def _vector(self, element: Element, key: str, where: str, default: Vector) -> Vector:
        text = element.get(key)
        if text is None:
            return default
        words = text.split()
        if len(words) != 3:
            self.fail(where, f"{key} is {show(text)}; allowed: three numbers")
        x, y, z = (self._float(word, key, where) for word in words)
        return x, y, z

    def _float(self, text: str, key: str, where: str) -> float:
        value = float(text) if NUMBER.fullmatch(text) else math.nan
        if not abs(value) <= LARGEST:
            self.fail(where, f"{key} is {show(text)}; allowed: a finite number of magnitude up to {LARGEST:g}")
        return value + 0.0  # turns -0.0 into 0.0

    def _root(self) -> str:
        """Return the one link without a parent."""
        children = {joint.child for joint in self.draft.joints.values()}
        roots = [name for name in self.draft.links if name not in children]
        if len(roots) != 1:
            what = f"there are {len(roots)} links without a parent joint: {listed(roots)}"
            what = what if roots else "every link is the child of a joint, so the joints form a cycle"
            self.fail("robot", f"{what}; allowed: a tree with one root link")
        return roots[0]

    def _remarks(self) -> None:
        notes = self.draft.notes
        places = self.xml.places_of([element for element, _ in self.mended])
        for place, (_, said) in zip(places, self.mended, strict=True):
            notes.append(f"{spot(self.xml.source, place)}: {said}")
        if self.mimics and not self.mimic:
            notes.append(f"mimic joints are read as independent (urdf_mimic=True couples them): {listed(self.mimics)}")
        elif self.draft.couplings:
            notes.append(f"mimic joints are coupled rigidly to those they follow: {listed(self.draft.couplings)}")
        if self.planar:
            said = "move along x and y and about gamma, which alone has a drive by default"
            notes.append(f"planar joints {said}; <limit> and <dynamics> of them are left out: {listed(self.planar)}")
        if self.unmoved:
            notes.append(f"<mimic> is left out of joints without a coordinate: {listed(self.unmoved)}")
        if self.unlimited:
            notes.append(f"<limit> is read as none where it is not a finite number above 0: {listed(self.unlimited)}")
        if self.damped and not self.damping:
            notes.append(f"<dynamics damping> is left out (urdf_damping=True reads it): {listed(self.damped)}")
        if self.with_friction and not self.friction:
            notes.append(f"<dynamics friction> is left out (urdf_friction=True reads it): {listed(self.with_friction)}")
        elif self.with_friction:
            what = f"Coulomb friction that reverses smoothly, over {SMOOTHING:g} rad/s or m/s"
            notes.append(f"<dynamics friction> is read as {what}: {listed(self.with_friction)}")


def _macro(root: Element) -> str:
    """Return the tag of the first element of xacro, by its prefix or its namespace; "" if there is none."""
    declared = {name.removeprefix("xmlns:") for name, value in root.attrib.items() if "xacro" in value}
    for child in root:
        prefix, colon, _ = child.tag.partition(":")
        if "xacro" in child.tag or (colon and (prefix in declared or "xacro" in child.get(f"xmlns:{prefix}", ""))):
            return child.tag
    return ""


def _content(element: Element) -> tuple[object, ...]:
    """Return the contents of an element: attributes with single blanks, and its elements."""
    attributes = {key: value.split() for key, value in element.attrib.items()}
    return element.tag, attributes, [(child.tag, dict(child.attrib)) for child in element.iter()][1:]
