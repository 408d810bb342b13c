"""MJCF in, Draft out: MuJoCo's models of hinges, slides, balls and free joints, with springs, dampers and armature.

A body is a link of its name and frame; its joints become joints of up to six coordinates (``mjcf.joints``).  What acts
on the motion and has no equal here is refused; contacts and actuators are left out, with notes, and so are limits where
no stops are asked for.

Source: MuJoCo documentation, XML reference and modeling.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element

from eomgen.errors import DescriptionError
from eomgen.limits import MOST_ENTRIES
from eomgen.names import is_robot_name, joint_of, kind_of, listed, nearest, show, to_robot_name
from eomgen.robot.bounds import Limits
from eomgen.robot.geometry import ZERO

from ..draft import Draft
from ..xml_text import Xml, parse_xml
from .actuators import read_efforts
from .bodies import Bodies
from .defaults import Defaults
from .equalities import read_equalities
from .geoms import Rules
from .other_files import nan_in, nan_message
from .tendons import read_tendons
from .values import Item, NeedsMujoco, Reading, triple

_IGNORED = ("asset", "contact", "keyframe", "sensor", "size", "statistic", "visual")
_READ = (
    *("compiler", "option", "default", "worldbody", "tendon", "equality", "actuator"),
    *("custom", "deformable", "extension"),
)
_NO_EFFECT = ("skin",)  # of <deformable>
VELOCITY = ".limits.velocity"  # behind a coordinate's name: a <numeric> with the limit of its speed
_FLAGS = ("gravity", "spring", "damper", "frictionloss")  # of <flag>: those that count here
_EXPANDED = (
    "one file without it, as MuJoCo writes it: python -c \"import mujoco; mujoco.mj_saveLastXML('whole.xml',"
    " mujoco.MjModel.from_xml_path('model.xml'))\""
)


def root_tag(text: str) -> str:
    """Return the name of the first element of an XML text, "" where there is none; nothing is parsed."""
    at = text.find("<")
    while at >= 0:
        if text.startswith("<!--", at):
            at = text.find("-->", at)
        elif text[at + 1 : at + 2] not in ("!", "?"):
            rest = text[at + 1 : at + 80].replace("/", " ").replace(">", " ")
            return (rest.split() or [""])[0]
        at = text.find("<", at + 1) if at >= 0 else -1
    return ""


def draft_from_mjcf(text: str, source: str, path: Path | None = None) -> Draft:
    """Read an MJCF model.

    Args:
        text: the XML.
        source: the file's name, for messages.
        path: the file, where there is one: what only MuJoCo's compiler knows goes through that, if it is installed.

    Raises:
        DescriptionError: anything that is no model, or that acts on the motion and has no equal here; with the element
            and its line.
    """
    xml = parse_xml(text, source, "mujoco")
    try:
        return _draft(xml, source)
    except NeedsMujoco as refusal:
        if path is None:
            raise
        return _compiled(path, refusal, xml)


def _draft(xml: Xml, source: str) -> Draft:
    """Return the draft of a file's elements."""
    reading, written = _reading(xml.root, source, xml.notes), dict[str, Element]()
    try:
        _read(xml.root, reading, written)
    except DescriptionError as error:
        error.line, error.column = xml.place(reading.at) or (None, None)
        raise
    draft = reading.draft
    draft.foreign = set(draft.links)
    whole = xml.root if (bodies := xml.root.find("worldbody")) is None else bodies
    draft.places = lambda wheres: xml.places_of([written.get(".".join(x.split(".")[:2]), whole) for x in wheres])
    return draft


def _compiled(path: Path, refusal: NeedsMujoco, xml: Xml) -> Draft:
    """Return the draft of a file as MuJoCo compiles it; its elements have no lines."""
    from .compiled import compiled_model  # only who has such a file asks for MuJoCo

    source = refusal.source
    try:
        compiled = compiled_model(path, refusal, xml)
    except DescriptionError as error:
        if error.line is None:
            error.line, error.column = refusal.line, refusal.column
        raise
    reading = _reading(compiled.root, source, (*xml.notes, *compiled.warnings))
    _read(compiled.root, reading, {})
    draft = reading.draft
    reason = refusal.message.partition("; allowed")[0]
    draft.notes.insert(0, f"read as MuJoCo {compiled.version} compiles it ({refusal.where}: {reason})")
    draft.foreign = set(draft.links)
    return draft


def _reading(root: Element, source: str, notes: Iterable[str]) -> Reading:
    return Reading(Draft(source, base="world", xml_source=source, notes=list(notes)), root)


def _read(root: Element, reading: Reading, written: dict[str, Element]) -> None:
    draft = reading.draft
    if root.tag != "mujoco":
        draft.fail("", f"the root element is {show(root.tag)}; allowed: 'mujoco'")
    _refuse_many(root, reading)
    for element in root.iter("include"):
        Item(reading, element, "include").leave(f"includes are not read; allowed: {_EXPANDED}")
    for child in root:
        if child.tag not in (*_READ, *_IGNORED):
            known = (*_READ, *_IGNORED)
            message = f"unknown element <{show(child.tag)[1:-1]}>{nearest(str(child.tag), known)}"
            Item(reading, child, "mujoco").fail(f"{message} (allowed: {', '.join(known)})")
    _name(root, reading)
    rules = _compiler(root, reading)
    flags = _option(root, reading)
    _refuse(root, reading)
    defaults = Defaults(reading, root)
    bodies = Bodies(reading, defaults, rules, flags, written)
    bodies.read(root)
    read_tendons(root, reading, defaults, bodies, flags)
    read_equalities(root, reading, defaults, bodies, written)
    read_efforts(root, reading, defaults, bodies)
    _read_velocities(root, reading)
    if (nan := nan_in(root)) is not None:  # where nothing reads it here
        Item(reading, nan[0], show(nan[0].tag)[1:-1]).fail(nan_message(*nan))
    _remarks(root, reading)


def _refuse_many(root: Element, reading: Reading) -> None:
    seen: Counter[str] = Counter()
    for element in root.iter():
        seen[element.tag] += 1
        if seen[element.tag] > MOST_ENTRIES:
            count, tag = sum(1 for _ in root.iter(element.tag)), show(element.tag)[1:-1]
            where = f"{tag} number {seen[element.tag]}"
            Item(reading, element, where).fail(f"there are {count} <{tag}>; allowed: up to {MOST_ENTRIES}")


def _name(root: Element, reading: Reading) -> None:
    name = root.get("model") or "mujoco_model"
    reading.draft.name = name if is_robot_name(name) else to_robot_name(name)
    if reading.draft.name != name:
        reading.draft.notes.append(f"model {show(name)} is called {reading.draft.name} here")


def _compiler(root: Element, reading: Reading) -> Rules:
    """Read how angles and inertias are written; a later <compiler> overrides an earlier one."""
    values: dict[str, str] = {}
    rules = Rules()
    for element in root.iterfind("compiler"):
        values.update(element.attrib)
        item = Item(reading, element, "compiler", values=values)
        radian = item.choice("angle", ("degree", "radian"), "degree") == "radian"
        reading.angle = 1.0 if radian else math.pi / 180.0
        reading.eulerseq = item.values.get("eulerseq", "xyz")
        if len(reading.eulerseq) != 3 or set(reading.eulerseq) - set("xyzXYZ"):
            item.fail(f"eulerseq is {show(reading.eulerseq)}; allowed: three of the letters x y z X Y Z")
        if item.choice("coordinate", ("local", "global"), "local") == "global":
            item.fail("coordinate is 'global'; allowed: 'local'")
        if item.number("settotalmass", -1.0) > 0.0:
            item.leave("settotalmass scales all masses; allowed: masses as they are to be")
        groups = item.numbers("inertiagrouprange", 2) or [0.0, 5.0]
        rules = Rules(
            item.choice("inertiafromgeom", ("auto", "true", "false"), "auto"),
            (int(groups[0]), int(groups[1])),
            item.number("boundmass", minimum=0.0),
            item.number("boundinertia", minimum=0.0),
            item.flag("balanceinertia"),
        )
        if item.flag("alignfree"):
            reading.draft.notes.append("alignfree is left out: frames of free bodies stay as they are written")
    return rules


def _option(root: Element, reading: Reading) -> dict[str, bool]:
    """Read gravity into the draft; return which of _FLAGS are on."""
    on = dict.fromkeys(_FLAGS, True)
    for element in root.iterfind("option"):
        item = Item(reading, element, "option")
        if "gravity" in item:
            reading.draft.gravity = triple(item.vector("gravity"))
        for key in ("density", "viscosity"):
            if item.number(key) != 0.0:
                message = f"{key} is {item.number(key):g}: forces of a fluid are not supported"
                item.fail(f"{message}; allowed: 0")
        for flag in element.iterfind("flag"):
            inner = Item(reading, flag, "option, <flag>")
            for key in _FLAGS:
                on[key] = inner.choice(key, ("enable", "disable"), "enable" if on[key] else "disable") == "enable"
            if inner.choice("passive", ("enable", "disable"), "enable") == "disable":
                on["spring"] = on["damper"] = False
    if not on["gravity"]:
        reading.draft.gravity = ZERO
    return on


def _read_velocities(root: Element, reading: Reading) -> None:
    """Put velocity limits into the draft, which MuJoCo knows as numbers without a meaning."""
    for section in root.iterfind("custom"):
        for element in section.iterfind("numeric"):
            name, ending, rest = element.get("name", "").partition(VELOCITY)
            joint = reading.draft.joints.get(joint_of(name)) if ending and not rest and "." in name else None
            if joint is not None and kind_of(name) in joint.coordinates:
                value = Item(reading, element, f"numeric {show(element.get('name'))}").numbers("data", 1)
                limits = joint.limits_of(kind_of(name)).within(Limits(velocity=value[0] if value else None))
                reading.draft.joints[joint.name] = joint.with_limits(kind_of(name), limits)


def _refuse(root: Element, reading: Reading) -> None:
    """Refuse elements outside of bodies that act on the motion and are not supported."""
    for section in root.iterfind("deformable"):
        for element in section:
            if element.tag not in _NO_EFFECT:
                Item(reading, element, "deformable").fail("a body that deforms is not supported; allowed: without it")
    for section in root.iterfind("extension"):
        Item(reading, section, "extension").fail("plugins are not read; allowed: a model without them")


def _remarks(root: Element, reading: Reading) -> None:
    """Add notes on elements that are left out on purpose."""
    names = [
        element.get("name") or f"<{show(element.tag)[1:-1]}>"
        for section in root.iterfind("actuator")
        for element in section
    ]
    if names:
        what = "of actuators limits of force are read, not gains, damping and armature (drives are u)"
        reading.draft.notes.append(f"{what}: {listed(names)}")
    bodies = [geom for body in root.iter("body") for geom in body.iterfind("geom")]
    if bodies or root.find("contact") is not None:
        reading.draft.notes.append("contacts between geoms are left out")
