"""Straight tendons of MJCF between two sites as point-to-point spring-dampers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from eomgen.names import nearest, show
from eomgen.robot.value import Spring

from .bodies import Bodies, Names
from .defaults import Defaults
from .values import Item, Reading, triple

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_FORCES = ("stiffness", "damping", "frictionloss", "armature", "springyield")


def read_tendons(
    root: Element, reading: Reading, defaults: Defaults, bodies: Bodies, flags: Mapping[str, bool]
) -> None:
    """Read tendons that have forces into the draft; others do nothing.

    Raises:
        DescriptionError: a tendon with forces is no straight line between two sites, or has forces that springs lack.
    """
    elements = [element for section in root.iterfind("tendon") for element in section]
    names = Names(list(dict.fromkeys(name for element in elements if (name := element.get("name")))))
    for element in elements:
        text = element.get("name", "")
        where = f"tendon {show(text)}" if text else f"tendon, <{show(element.tag)[1:-1]}>"
        item = Item(reading, element, where, values=defaults.values(element, "tendon", where, None))
        if element.tag not in ("spatial", "fixed"):
            item.fail("unknown element; allowed: spatial, fixed")
        if "range" in item and item.values.get("limited") != "false":
            reading.draft.notes.append(f"nothing stops at the limits of tendon {show(text)}")
        if any(any(item.numbers(key, 1, 3)) for key in _FORCES):
            spring = _spring(item, text, bodies, flags)
            name = names.of[text] if text else names.fresh("tendon")
            if spring is not None:
                if name in reading.draft.elements:
                    item.fail("there are two tendons of this name; allowed: unique names")
                reading.draft.elements[name] = Spring(name, *spring)


def _spring(item: Item, text: str, bodies: Bodies, flags: Mapping[str, bool]) -> tuple | None:  # type: ignore[type-arg]
    """Return links, points, free length, stiffness and damping of a tendon; None where it does nothing."""
    ends = list(item.element)
    if item.element.tag != "spatial" or len(ends) != 2 or any(end.tag != "site" for end in ends):
        item.fail("it has forces and is no straight line between two sites; allowed: <spatial> with two <site>")
    for key in _FORCES[2:]:
        if any(item.numbers(key, 1, 3)):
            item.fail(f"{key} is {show(item.values[key])}, which is not supported; allowed: stiffness and damping")
    sites = []
    for end in ends:
        name = end.get("site", "")
        if name not in bodies.sites:
            known = list(bodies.sites)
            Item(item.reading, end, item.where).fail(
                f"there is no site {show(name)}{nearest(name, known)}; allowed: the name of a <site> of a body"
            )
        sites.append(bodies.sites[name])
    first, second = sites
    if first.body.carrier == second.body.carrier:
        return None  # its length is constant
    stiffness, damping = (
        _linear(item, key) if flags[flag] else 0.0 for key, flag in (("stiffness", "spring"), ("damping", "damper"))
    )
    length = item.numbers("springlength", 1, 2) or [-1.0]
    if len(length) == 2 and length[0] != length[1]:
        item.fail(f"springlength is {show(item.values['springlength'])}, with a slack range; allowed: one length")
    here = math.dist(first.body.world.point(first.xyz), second.body.world.point(second.xyz))
    free = here if length[0] == -1.0 else length[0]
    if free < 0.0:
        item.fail(f"springlength is {show(item.values['springlength'])}; allowed: at least 0 m, or -1")
    links = first.body.link, second.body.link
    if not stiffness and not damping:
        return None
    return links, (triple(first.xyz), triple(second.xyz)), free, stiffness or None, damping or None


def _linear(item: Item, key: str) -> float:
    coefficients = item.numbers(key, 1, 3)
    if any(coefficients[1:]) or min(coefficients, default=0.0) < 0.0:
        item.fail(f"{key} is {show(item.values[key])}; allowed: a number that is at least 0")
    return coefficients[0] if coefficients else 0.0
