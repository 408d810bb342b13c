"""Default classes of MJCF: attributes that elements inherit by their class, or by the childclass around them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eomgen.names import listed, nearest, show

from .values import TURNS, Item, Reading

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_ACTUATORS = dict.fromkeys(  # MuJoCo keeps one class of all of them
    ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor"),
    "actuator",
)
_TAGS = ("joint", "geom", "site", "tendon", "equality", "actuator")
_MOST_ATTRIBUTES = 128  # of a class, far more than MuJoCo knows: each element and each class inside copies them
Values = dict[str, str]


class Defaults:
    """The <default> elements of a file; a class inherits its parents' attributes and overrides them.

    Raises:
        DescriptionError: a class without a name, or two of one name.
    """

    def __init__(self, reading: Reading, root: Element) -> None:
        self._reading = reading
        self._main = "main"
        self._classes: dict[str, dict[str, Values]] = {"main": {tag: {} for tag in _TAGS}}
        for top in root.iterfind("default"):
            self._read(top)

    def _read(self, top: Element) -> None:
        name = top.get("class")
        if name and name != self._main:  # the outermost class may have any name
            self._classes[name] = self._classes["main"]
        self._fill(self._classes["main"], top)
        stack = [(child, self._classes["main"]) for child in reversed(top.findall("default"))]
        while stack:
            element, parent = stack.pop()
            item = Item(self._reading, element, "default", ("class",))
            name = element.get("class")
            if not name:
                item.fail("the attribute class is missing; allowed: a name, for a <default> inside of another")
            if name in self._classes:
                item.fail(f"there are two classes {show(name)}; allowed: unique names")
            made = dict(parent)  # what it does not change, it shares
            self._fill(made, element)
            self._classes[name] = made
            stack += [(child, made) for child in reversed(element.findall("default"))]

    def _fill(self, target: dict[str, Values], element: Element) -> None:
        for child in element:
            tag = _ACTUATORS.get(child.tag, child.tag)
            if tag in target:
                attributes = merged(target[tag], child.attrib)
                if len(attributes) > _MOST_ATTRIBUTES:
                    message = f"its class has {len(attributes)} attributes of <{child.tag}>"
                    where = f"default, <{child.tag}>"
                    Item(self._reading, child, where).fail(f"{message}; allowed: up to {_MOST_ATTRIBUTES}")
                target[tag] = attributes

    def values(self, element: Element, tag: str, where: str, childclass: str | None) -> Values:
        """Return the attributes of an element with those of its class; ``tag``: its name in defaults."""
        name = element.get("class") or childclass or "main"
        if name not in self._classes:
            known = list(self._classes)
            message = f"there is no default class {show(name)}{nearest(name, known)} (allowed: {listed(known)})"
            Item(self._reading, element, where).fail(message)
        return merged(self._classes[name][tag], element.attrib)


def merged(inherited: Values, attributes: Values) -> Values:
    """Merge attributes with inherited ones; of orientations but quat, the last alone counts."""
    gone = TURNS if any(key in attributes for key in TURNS) else ()
    return {**{key: value for key, value in inherited.items() if key not in gone}, **attributes}
