"""Equality constraints of MJCF: coupled joints, connected points and welded frames.

MuJoCo's are soft, by a spring and a damper of its solver; here they are rigid couplings and loops.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from eomgen.names import listed, show
from eomgen.robot.value import Coupling, Loop

from .bodies import Bodies, Names, Place
from .defaults import Defaults
from .values import HERE, Array, Item, Pose, Reading, tidy

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_READ = ("joint", "connect", "weld")
_SHARED = ("name", "class", "active", "solref", "solimp")
_IDENTITY = (0.0, 1.0, 0.0, 0.0, 0.0)  # default coefficients of a polynomial
_AGREES = 1e-9  # m or rad: allowed difference of a reference position from its coupling
_KEYS = {
    "joint": (*_SHARED, "joint1", "joint2", "polycoef"),
    "connect": (*_SHARED, "body1", "body2", "anchor", "site1", "site2"),
    "weld": (*_SHARED, "body1", "body2", "anchor", "relpose", "site1", "site2", "torquescale"),
}


def read_equalities(
    root: Element, reading: Reading, defaults: Defaults, bodies: Bodies, written: dict[str, Element]
) -> None:
    """Read active constraints into the draft; ``written`` gets the element of each loop and coupling.

    Raises:
        DescriptionError: one that is no joint, connect or weld, is not linear, or has an unknown name.
    """
    elements = [element for section in root.iterfind("equality") for element in section]
    texts = list(dict.fromkeys(name for element in elements if (name := element.get("name"))))
    names, seen = Names(texts), dict[str, None]()
    for element in elements:
        text, tag = element.get("name", ""), show(element.tag)[1:-1]
        where = f"equality {show(text or element.tag)}"
        item = Item(reading, element, where, values=defaults.values(element, "equality", where, None))
        if not item.flag("active", True):
            continue
        if element.tag not in _READ:
            allowed = f"{', '.join(_READ)}, or without it, or with active='false'"
            item.fail(f"<{tag}> constrains the motion softly, which has no equal here; allowed: {allowed}")
        item = Item(reading, element, where, _KEYS[element.tag], item.values)
        if text in seen:
            item.fail("there are two of this name; allowed: unique names")
        name = names.of[text] if text else names.fresh(tag)
        if text:
            seen[text] = None
        if element.tag == "joint":
            reading.draft.couplings[name] = _coupling(item, name, bodies)
            written[f"couplings.{name}"] = element
        else:
            reading.draft.loops[name] = _loop(item, name, bodies)
            written[f"loops.{name}"] = element
    made = [*reading.draft.couplings, *reading.draft.loops]
    if made:
        reading.draft.notes.append(f"equality constraints, which are soft in MuJoCo, are read as rigid: {listed(made)}")
        reading.draft.home = _consistent_home(bodies.start(), reading.draft.couplings.values())


def _consistent_home(start: dict[str, float], couplings: Iterable[Coupling]) -> dict[str, float]:
    """Return the reference position without coordinates that couplings put elsewhere."""
    gone: set[str] = set()
    rules = list(couplings)
    for _ in rules:
        for x in rules:
            there = sum((ratio * start.get(name, 0.0) for name, ratio in x.to.items()), x.offset or 0.0)
            if abs(start.get(x.of, 0.0) - there) > _AGREES or not gone.isdisjoint(x.to):
                gone.add(x.of)
    return {name: value for name, value in start.items() if name not in gone}


def _coupling(item: Item, name: str, bodies: Bodies) -> Coupling:
    """Return the coupling y - y0 = a + b (x - x0), with the joints' positions y0 and x0 in the reference position."""
    what = "hinge or slide of that name"
    of, start = item.named("joint1", bodies.coordinates, what)
    coefficients = item.numbers("polycoef", 1, 5)
    a, b, *further = (*coefficients, *_IDENTITY[len(coefficients) :])
    if any(further):
        item.fail(f"polycoef is {show(item.values['polycoef'])}; allowed: a constant and a linear term")
    if "joint2" not in item:
        return Coupling(name, of, {}, start + a)
    other, begin = item.named("joint2", bodies.coordinates, what)
    return Coupling(name, of, {other: b}, (start + a - b * begin) or None)


def _loop(item: Item, name: str, bodies: Bodies) -> Loop:
    """Return the loop of a connect (a ball joint) or a weld (a fixed joint)."""
    kind = "spherical" if item.element.tag == "connect" else "fixed"
    if "site1" in item or "site2" in item:
        ends = [_site(item, key, bodies) for key in ("site1", "site2")]
    elif kind == "spherical":
        if "anchor" not in item:
            item.fail("there is no anchor; allowed: an anchor in body1, or two sites")
        ends = _meeting(item, bodies, Pose(np.eye(3), item.vector("anchor")))
    else:
        ends = _meeting(item, bodies, _relative(item))
    (first, at_first), (second, at_second) = ends
    if first.link == second.link:
        item.fail(f"both ends are on {show(first.link)}; allowed: two different bodies")
    if kind == "spherical":  # how its frames are turned does not matter
        at_first, at_second = Pose(np.eye(3), at_first.xyz), Pose(np.eye(3), at_second.xyz)
    return Loop(name, (first.link, second.link), kind, (at_first.placement(), at_second.placement()))


def _site(item: Item, key: str, bodies: Bodies) -> tuple[Place, Pose]:
    site = item.named(key, bodies.sites, "such site")
    return site.body, Pose(site.rotation, site.xyz)


def _meeting(item: Item, bodies: Bodies, relative: Pose | None) -> list[tuple[Place, Pose]]:
    """Return both bodies with a pose in body1 and the same in body2, in the reference position; None: body2's."""
    first = item.named("body1", bodies.places, "such body")
    second = item.named("body2", bodies.places, "such body", "world")
    across = _inverse(first.reference) @ second.reference
    if relative is None:
        return [(first, across), (second, HERE)]
    if item.element.tag == "weld":
        return [(first, relative), (second, HERE)]
    return [(first, relative), (second, _inverse(across) @ relative)]  # the anchor of a ball


def _relative(item: Item) -> Pose | None:
    """Return the pose of body2 in body1 of a weld; None where it is that of the reference position."""
    values = item.numbers("relpose", 7)
    if not any(values[3:]):
        return None
    quat: Array = np.array(values[3:])
    return Pose(tidy(item.turned(quat)), np.array(values[:3]))


def _inverse(pose: Pose) -> Pose:
    back = pose.rotation.T
    return Pose(back, -(back @ pose.xyz))
