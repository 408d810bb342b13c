"""Bodies of a compiled model and their joints and sites: links, joints and frames of a Draft."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eomgen.identifiers import to_identifier, unique_identifiers
from eomgen.names import NAME_LENGTH, component_name, joint_of, kind_of, listed, show
from eomgen.robot.bounds import Limits
from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.geometry import ZERO
from eomgen.robot.value import COORDINATES, Coordinate, Frame, Friction, Joint, Link

from ..draft import Draft
from .compiled import Model, text_of
from .joints import Group, Moving, groups
from .poses import Array, Pose, rotation_from_quaternion, tidy, triple

_ROUND_OFF = 1e-14  # of an inertia's greatest entry


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


@dataclass
class Bodies:
    """Reads bodies into the draft; all lists are in the order of MuJoCo's elements.

    Attributes:
        links: of each body.
        carriers: of each body, the last link on the way to it that moves by itself.
        coordinates: of each hinge and slide, by its number: its coordinate, and the value in the reference position.
        written: lines of links and joints by their places in the description, such as "links.arm".
        notes: remarks that several elements share, with their names.
    """

    model: Model
    draft: Draft
    links: list[str] = field(default_factory=list)
    carriers: list[str] = field(default_factory=list)
    coordinates: dict[int, tuple[str, float]] = field(default_factory=dict)
    written: dict[str, int | None] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)

    def note(self, text: str, name: str) -> None:
        """Add a name to a remark that several share in one line."""
        self.notes.setdefault(text, []).append(name)

    def read(self) -> None:
        """Read all bodies, depth first as MuJoCo orders them, and their sites."""
        self._name()
        self.links.append(self.draft.base)
        self.carriers.append(self.draft.base)
        self.draft.ranges = {}
        for index in range(1, self.model.count("body")):
            self._body(index)
        for index, name in enumerate(self.model.names["site"]):
            if name:
                self._site(index, name)
        changed = [
            f"{show(text)} -> {name}"
            for names in (self.link_names, self.joint_names)
            for text, name in names.of.items()
            if text != name and "." not in text
        ]
        if changed:
            more = f" and {len(changed) - 8} more" if len(changed) > 8 else ""
            self.draft.notes.append(f"names turned into identifiers: {', '.join(changed[:8])}{more}")
        self.draft.notes += [f"{text}: {listed(names)}" for text, names in self.notes.items()]

    def start(self) -> dict[str, float]:
        """Return coordinates of the reference position that are not 0, but for those beyond limits."""
        positions = {}
        for name, value in self.coordinates.values():
            limits = self.draft.joints[joint_of(name)].limits_of(kind_of(name)).range
            if value != 0.0 and limits[0] <= value <= limits[1]:
                positions[name] = value
        return positions

    def _name(self) -> None:
        """Assign identifiers to bodies, joints and sites, before any is made up."""
        bodies, joints, sites = ([x for x in self.model.names[kind] if x] for kind in ("body", "joint", "site"))
        self.link_names = Names([text for text in bodies if text != "world"], {self.draft.base})
        self.joint_names = Names(joints)
        self.site_names = Names(sites, set(self.link_names.of.values()))  # one asks for poses of both by name
        self.link_names.reserve(self.site_names.of.values())

    def _site(self, index: int, name: str) -> None:
        made = self.site_names.of[name]
        if made != name:
            self.note("sites that are called otherwise here", f"{name} -> {made}")
        link = self.links[int(self.model["site_bodyid"][index])]
        self.draft.frames[made] = Frame(made, link, self.model.pose("site_", index).placement())

    def _body(self, index: int) -> None:
        """Read a body into the draft."""
        model, text = self.model, self.model.names["body"][index]
        link = self.link_names.of[text] if text else self.link_names.fresh("body")
        if model["body_gravcomp"][index]:
            given = f"{model['body_gravcomp'][index]:g}"
            model.fail("body", index, f"gravcomp is {given}: a force that carries it; allowed: 0")
        if model["body_mocapid"][index] >= 0:
            self.note("mocap bodies stay where they are", text or link)
        if index in model.aligned:
            what = "frames of free bodies are at their centres of mass, as MuJoCo aligns them (align, alignfree)"
            self.note(what, text or link)
        first, count = (int(model[key][index]) for key in ("body_jntadr", "body_jntnum"))
        joints = [self._moving(number, text or link) for number in range(first, first + count)]
        parent = int(model["body_parentid"][index])
        self.links.append(link)
        self.carriers.append(link if joints else self.carriers[parent])
        self.written[f"links.{link}"] = model.lines["body"][index]
        self._joints(index, joints, self.links[parent], link)
        has_mass = self.carriers[index] != self.draft.base or index in model.explicit
        self.draft.links[link] = self._link(link, index) if has_mass else _massless(link)

    def _joints(self, body: int, joints: Sequence[Moving], parent: str, link: str) -> None:
        """Add the body's joints, with links without mass between them; the last carries the body's link."""
        before, anchor = self.model.pose("body_", body), np.zeros(3)
        grouped = list(groups(joints))
        for group in grouped:
            name = self._joint_name(group, link)
            anchor = group.anchor
            child = link if group is grouped[-1] and not anchor.any() else self.link_names.fresh(f"{link}_{name}")
            at = Pose(before.rotation, before.xyz + before.rotation @ anchor)
            self._add(_joint(name, parent, child, group, at), group.joints[0].index)
            for coordinate, moving in group.by_coordinate.items():
                if moving.limits is not None and moving.limited and self.draft.ranges is not None:
                    self.draft.ranges[component_name(name, coordinate)] = moving.limits
                if moving.kind in ("hinge", "slide"):
                    self.coordinates[moving.index] = component_name(name, coordinate), -(moving.offset or 0.0)
            if child != link:
                self.draft.links[child] = _massless(child)
            parent, before = child, Pose(np.eye(3), -anchor)
        if parent != link or not grouped:
            name = self.joint_names.fresh(f"{link}_frame" if grouped else f"{link}_fixed")
            self._add(Joint(name, parent, link, "fixed", before.placement()), None)
            self.written[f"joints.{name}"] = self.model.lines["body"][body]

    def _add(self, joint: Joint, index: int | None) -> None:
        self.draft.joints[joint.name] = joint
        if index is not None:
            self.written[f"joints.{joint.name}"] = self.model.lines["joint"][index]

    def _joint_name(self, group: Group, link: str) -> str:
        if group.stem:
            return self.joint_names.fresh(group.stem)
        first = group.joints[0]
        if len(group.joints) == 1:
            if first.kind in ("ball", "free"):
                what = "angles alpha, beta, gamma, which are singular at beta = +-pi/2"
                self.note(f"{first.kind} joints are read with {what}", first.name or link)
            return self.joint_names.of[first.name] if first.name else self.joint_names.fresh(f"{link}_joint")
        name = self.joint_names.fresh(f"{link}_joint")
        for coordinate, joint in group.by_coordinate.items():
            self.note("joints of one body that became one", f"{joint.name or joint.kind} -> {name}.{coordinate}")
        return name

    def _link(self, name: str, index: int) -> Link:
        """Return mass and inertia in the body's axes; round-off becomes 0, which prunes the equations."""
        model = self.model
        turn = rotation_from_quaternion(model["body_iquat"][index])
        full: Array = turn @ np.diag(model["body_inertia"][index]) @ turn.T
        full = np.where(np.abs(full) < _ROUND_OFF * np.abs(full).max(), 0.0, full) + 0.0
        xx, yy, zz, xy, xz, yz = (float(full[at]) for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        return Link(name, float(model["body_mass"][index]), triple(model["body_ipos"][index]), (xx, yy, zz, xy, xz, yz))

    def _moving(self, index: int, body: str) -> Moving:
        """Read a joint of a body, in the body's axes."""
        model, kind = self.model, self.model.words["jnt_type"][index]
        name, dof = model.names["joint"][index], int(model["jnt_dofadr"][index])
        if any(model.numbers("jnt_springyield", index)):
            model.fail("joint", index, "springyield is set, which is not supported; allowed: springs that do not yield")
        axis, anchor = tidy(model["jnt_axis"][index]), model["jnt_pos"][index]
        if kind in ("ball", "free"):
            return self._quaternion(index, name or body, Moving(index, name, kind, axis, anchor))
        at = int(model["jnt_qposadr"][index])
        ref, springref = (float(model[key][at]) for key in ("qpos0", "qpos_spring"))
        limits = self._limits(index, name or body)
        return Moving(
            *(index, name, kind, axis, anchor, self._coordinate(index, dof, springref, name or body)),
            offset=-ref if ref else None,
            limits=limits,
            limited=self._stops(index),
            effort=self._effort(index, name or body),
        )

    def _quaternion(self, index: int, name: str, joint: Moving) -> Moving:
        """Return a ball or free joint; forces on its quaternion, but for damping, are others than those on angles."""
        model, dof = self.model, int(self.model["jnt_dofadr"][index])
        forces = (("stiffness", "jnt_stiffness", index), ("armature", "dof_armature", dof))
        for key, array, at in (*forces, ("frictionloss", "dof_frictionloss", dof)):
            numbers = model.numbers(array, at)
            if any(numbers):
                way = "<freejoint/>" if joint.kind == "free" else "three hinges about x, y and z"
                message = f"{key} is {text_of(numbers)}, which acts otherwise on the angles of eomgen"
                model.fail("joint", index, f"{message}; allowed: 0 (or {way})")
        if model["jnt_limited"][index]:
            self.note("the range of ball joints is left out", name)
        value, _ = model.law("joint", index, "dof_damping", dof, cubic=False)
        made = JointDamping(linear=value if joint.kind == "free" else None, angular=value) if value else None
        origin = np.zeros(3) if joint.kind == "free" else joint.anchor
        return replace(joint, axis=np.array([0.0, 0.0, 1.0]), anchor=origin, damping=made)

    def _coordinate(self, index: int, dof: int, springref: float, name: str) -> Coordinate:
        model = self.model
        stiffness, cubic = model.law("joint", index, "jnt_stiffness", index)
        damping, _ = model.law("joint", index, "dof_damping", dof, cubic=False)
        if cubic and springref:
            model.fail("joint", index, f"springref is {springref:g} with a cubic stiffness; allowed: springref 0")
        armature, friction = (model.numbers(key, dof)[0] for key in ("dof_armature", "dof_frictionloss"))
        for key, value in (("armature", armature), ("frictionloss", friction)):
            if value < 0.0:
                model.fail("joint", index, f"{key} is {value:g}; allowed: a number that is at least 0")
        if model.disabled & {"mjDSBL_FRICTIONLOSS", "mjDSBL_CONSTRAINT"}:
            friction = 0.0
        if friction:
            self.note("frictionloss is read as Coulomb friction that reverses smoothly", name)
        return Coordinate(
            stiffness=stiffness or None,
            damping=damping or None,
            armature=armature or None,
            preload=-stiffness * springref or None,
            cubic=cubic or None,
            friction=Friction(friction) if friction else None,
        )

    def _effort(self, index: int, name: str) -> float | None:
        """Return the greatest total force of the joint's actuators, N or N m."""
        ends = self.model.numbers("jnt_actfrcrange", index)
        if ends[0] != -ends[1]:
            self.note("effort is the greater end of actuatorfrcrange, which is not symmetric", name)
        return max(map(abs, ends)) or None

    def _limits(self, index: int, name: str) -> tuple[float, float] | None:
        """Return the range, rad or m; nothing stops at it unless stops are asked for."""
        unit = math.pi / 180.0 if index in self.model.degrees else 1.0
        lower, upper = (unit * value for value in self.model.numbers("jnt_range", index))
        if not self.model["jnt_limited"][index] and not (lower or upper):
            return None
        if lower > upper:
            self.model.fail("joint", index, f"range is {text_of([lower, upper])}; allowed: lower <= upper")
        if self._stops(index):
            self.draft.unstopped.append(name)
        return lower, upper

    def _stops(self, index: int) -> bool:
        """Return whether MuJoCo keeps a joint within its limits."""
        off = self.model.disabled & {"mjDSBL_LIMIT", "mjDSBL_CONSTRAINT"}
        return bool(self.model["jnt_limited"][index]) and not off


def _massless(name: str) -> Link:
    return Link(name, 0.0, ZERO, (0.0,) * 6)


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
