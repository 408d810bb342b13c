"""Force limits of MJCF's actuators, as efforts of the coordinates that they act on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eomgen.names import joint_of, kind_of, listed, show
from eomgen.robot.bounds import Limits

from .bodies import Bodies
from .defaults import Defaults
from .elements import LIMITED
from .values import Item, Reading

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


def read_efforts(root: Element, reading: Reading, defaults: Defaults, bodies: Bodies) -> None:
    """Put force limits of actuators into the draft; of several on one joint their sum, where all have one."""
    efforts_of: dict[str, list[float | None]] = {}
    uneven: list[str] = []
    for section in root.iterfind("actuator"):
        for element in section:
            joint = element.get("joint") or element.get("jointinparent") or ""
            if joint not in bodies.coordinates:
                continue
            where = f"actuator {show(element.get('name') or element.tag)}"
            item = Item(reading, element, where, values=defaults.values(element, "actuator", where, None))
            efforts_of.setdefault(bodies.coordinates[joint][0], []).append(_effort(item, uneven))
    for name, efforts in efforts_of.items():
        if None not in efforts:
            owner, kind = reading.draft.joints[joint_of(name)], kind_of(name)
            limits = owner.limits_of(kind).within(Limits(effort=sum(effort or 0.0 for effort in efforts)))
            reading.draft.joints[owner.name] = owner.with_limits(kind, limits)
    if uneven:
        what = "effort is the greater end of a range of forces that is not symmetric"
        reading.draft.notes.append(f"{what}: {listed(uneven)}")


def _effort(item: Item, uneven: list[str]) -> float | None:
    """Return the greatest force of an actuator, N or N m at its joint; None where it has no limit."""
    gear = abs((item.numbers("gear", 1, 6) or [1.0])[0])
    efforts = []
    for kind, gain in {"force": 1.0, **({"ctrl": _gain(item)} if _is_motor(item) else {})}.items():
        ends = item.numbers(f"{kind}range", 2)
        if item.choice(f"{kind}limited", LIMITED, "auto") == "false" or not any(ends):
            continue
        if ends[0] > ends[1]:
            item.fail(f"{kind}range is {show(item.values[f'{kind}range'])}; allowed: lower <= upper")
        if ends[0] != -ends[1]:
            uneven.append(item.element.get("name") or f"<{item.element.tag}>")
        efforts.append(gear * gain * max(map(abs, ends)))
    return min(efforts, default=0.0) or None


def _is_motor(item: Item) -> bool:
    """Return whether the force is a gain times the control."""
    kinds = (("gaintype", "fixed"), ("biastype", "none"), ("dyntype", "none"))
    plain = all(item.values.get(key, kind) == kind for key, kind in kinds)
    return item.element.tag == "motor" or (item.element.tag == "general" and plain)


def _gain(item: Item) -> float:
    gains = item.numbers("gainprm", 1, 10) if item.element.tag == "general" else []
    return abs((gains or [1.0])[0])
