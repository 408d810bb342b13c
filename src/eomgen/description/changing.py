"""A robot with some values of its description changed, by dotted paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Any

from ..errors import DescriptionError, InputError
from ..forms.dotted_paths import CURVE, numbered
from ..limits import LARGEST
from ..names import listed, nearest, show
from ..robot.elements import KINDS
from ..robot.elements.joint_element import MatrixElement
from ..robot.elements.matrices import PAIRS, entry_name
from ..robot.geometry import Placement, rotation_from_rpy
from ..robot.inertia_policy import Judged, apply_inertia_policy, link_sizes, lowest_moments
from ..robot.record import record_of, robot_of
from ..robot.value import COORDINATES, INERTIA_KEYS, Friction, LinkModes, Robot
from .bending.beams import with_changed_beams
from .bending.links import with_changed_bending
from .draft import Draft
from .keys import COORDINATE, JOINT, LINK
from .load import read_joint
from .recorded import robot_from_record

AXES = ("x", "y", "z")
NAMED_BY_KEY = ("home", "to", "further", "preload")  # mappings whose keys may have dots, and where others may be added
INSIDE = ("coordinates", "transmission", "law", "further", "entries")  # whose values stand for ones of what they are in
OTHER_NAMES = {"to": "ratio"}  # of parameters


@dataclass
class _Value:
    """A value of a record: what holds it, its key there, the object that it was made of, and what else is on the way.

    parts: records of parts on the way, each with its object, whose numbers may follow from others.
    """

    holder: Any
    key: Any
    origin: Any
    parts: list[tuple[dict[str, Any], Any]] = field(default_factory=list)

    @property
    def now(self) -> Any:
        return self.holder[self.key]


def with_values(robot: Robot, changes: Mapping[str, Any]) -> Robot:
    """Return a robot with some values of its description changed, checked as those that are loaded.

    Args:
        robot: it stays what it is.
        changes: values by path: names of parameters ("links.arm.mass", "joints.joint1.x.stiffness"), and whole ones
            ("links.arm.com", "joints.joint1.limits"); tables of joints as in TOML ("joints.joint1.motor").  Numbers
            that follow from others follow anew, and all links and joints of a beam one of whose numbers
            ("beams.boom.length") is changed, and all modes and nodes of a link one of whose beam's
            ("links.arm.beam.E") is.

    Raises:
        DescriptionError: there is no such value; says what there is.  Or the robot would be none that can be loaded.
    """
    if not isinstance(changes, Mapping):
        raise InputError(f"with_value: {show(changes)}; allowed: a path and a value, or a mapping from paths to values")
    record, origin = _record(robot), robot
    for path, value in changes.items():
        if not isinstance(path, str) or not path:
            raise InputError(f"with_value: {show(path)} is no path; allowed: names with dots, as 'links.arm.mass'")
        plain = _plain(value)
        joint, keys = _joint_table(origin, path, plain)
        if joint is None:
            _change(record, origin, path, plain)
        else:
            origin = _with_joint_table(robot_of(record), joint, keys, plain)
            record = _record(origin)
    said = "; ".join(f"{path} = {show(value)}" for path, value in changes.items())
    try:
        changed = robot_from_record(record, robot.source)
        if changed.beams != robot.beams:
            whole = with_changed_beams(changed, robot.beams)
            changed = robot_from_record(record_of(whole, whole=True), robot.source)
        if any(link.modes is not None for link in robot.links):
            whole = with_changed_bending(changed, robot)
            if whole != changed:
                changed = robot_from_record(record_of(whole, whole=True), robot.source)
        _refuse_inertias(robot, changed)
    except InputError as error:
        raise DescriptionError(f"{getattr(error, 'message', error)}", where=_where(said, error)) from None
    return changed


def _record(robot: Robot) -> dict[str, Any]:
    """Return the record of a robot without couplings of screws, which follow from joints."""
    record = record_of(robot, whole=True)
    kept = (coupling.pitch is None or coupling.is_constraint for coupling in robot.couplings)
    return {**record, "couplings": [*compress(record["couplings"], kept)]}


def _where(said: str, error: InputError) -> str:
    place = getattr(error, "where", "")
    return f"with_value: {said}" + (f": {place}" if place else "")


def _plain(value: Any) -> Any:
    """Return arrays and tuples as lists, and NumPy's numbers as Python's."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        unnamed = [key for key in value if not isinstance(key, str)]
        if unnamed:
            raise InputError(f"with_value: the key {show(unnamed[0])} of a table; allowed: texts")
        return {key: _plain(x) for key, x in value.items()}
    return [_plain(x) for x in value] if isinstance(value, (list, tuple)) else value


def _joint_table(robot: Robot, path: str, value: Any) -> tuple[str | None, list[str]]:
    """Return the joint and the keys of a path at which a description has the value as a table; None where it has none.

    A table, or an array of tables, is read by the keys of TOML.
    """
    family, _, rest = path.partition(".")
    name, *keys = rest.split(".")
    first = value[0] if isinstance(value, list) and value else value
    joint = next((x for x in robot.joints if x.name == name), None)
    if family != "joints" or joint is None or not isinstance(first, dict):
        return None, keys
    of_joint = len(keys) == 1 and keys[0] in JOINT.keys
    of_coordinate = len(keys) == 2 and keys[0] in joint.coordinates and keys[1] in COORDINATE.keys
    return (name if of_joint or of_coordinate else None), keys


def _with_joint_table(robot: Robot, name: str, keys: Sequence[str], value: Any) -> Robot:
    """Return the robot with a table of a joint, or of one of its coordinates, read as that of a description."""
    joint, key = robot.joint(name), keys[0]
    coordinates = dict(joint.coordinates)
    if len(keys) == 2:
        value = {keys[1]: value}
        coordinates[key] = replace(coordinates[key], limits=None) if keys[1] == "limits" else coordinates[key]
    else:
        coordinates.pop(key, None)
    draft = Draft(robot.source, joints={name: replace(joint, coordinates=coordinates)})
    try:
        entry = JOINT.read({key: value}, f"joints.{name}", "", ())
        made = read_joint(name, entry, draft, None)
    except DescriptionError as error:
        error.where = f"with_value: {error.where}"
        raise
    joints = tuple(made if x.name == name else x for x in robot.joints)
    return replace(robot, joints=joints, notes=(*robot.notes, *draft.notes))


def _change(record: dict[str, Any], robot: Robot, path: str, value: Any) -> None:
    """Put a value where a path leads."""
    parts, done = path.split("."), 0
    if isinstance(value, dict) and parts[::2] == ["links", "inertia"]:
        table = LINK.read({"inertia": value}, ".".join(parts[:-1]), "", ()).table("inertia")
        assert table is not None
        value = [table.number(key) or 0.0 for key in INERTIA_KEYS]
    here = _Value({"robot": record}, "robot", robot)
    relaxed: list[tuple[dict[str, Any], Any]] = []
    while done < len(parts):
        known = dict(_below(here))
        size = next((n for n in range(len(parts) - done, 0, -1) if ".".join(parts[done : done + n]) in known), 0)
        if not size and here.key in NAMED_BY_KEY and isinstance(here.now, dict):
            rest = ".".join(parts[done:])
            known[rest] = _Value(here.now, rest, None)
            size = len(parts) - done
        if not size:
            raise DescriptionError(_unknown(".".join(parts[:done]), parts[done], here.now, known), where=path)
        here = known[".".join(parts[done : done + size])]
        relaxed += here.parts
        done += size
    for part, origin in relaxed:
        _free_derived(part, origin, here)
    old = here.holder.get(here.key) if isinstance(here.holder, dict) else here.holder[here.key]
    number = isinstance(value, int) and not isinstance(value, bool)
    as_float = number and abs(value) < LARGEST and not isinstance(old, (int, bool))
    here.holder[here.key] = float(value) if as_float else value
    for part, origin in relaxed:
        if isinstance(origin, Placement):
            _turn(part, origin)


def _below(here: _Value) -> Iterator[tuple[str, _Value]]:
    """Yield what is below a value, by the parts of paths that lead there."""
    now, origin = here.now, here.origin
    if isinstance(now, list):
        of_six = INERTIA_KEYS if here.key == "inertia" else COORDINATES
        names: Sequence[str] = {len(AXES): AXES, len(of_six): of_six}.get(len(now), ())
        for i, name in numbered(now, names):
            if here.key == CURVE:
                yield name, _Value(now[i], 1, None, here.parts)
            else:
                yield name, _Value(now, i, _item(origin, i), _part(now[i], _item(origin, i)))
    elif isinstance(now, dict):
        if isinstance(origin, LinkModes):
            for k in range(origin.count):
                yield f"{k + 1}.stiffness", _Value(now["K"][k], k, None)
                yield f"{k + 1}.damping", _Value(now["D"][k], k, None)
        for key in now:
            child = _item(origin, key)
            value = _Value(now, key, child, _part(now[key], child))
            yield key, value
            if key in OTHER_NAMES:
                yield OTHER_NAMES[key], value
            if isinstance(origin, Friction) and key == "stribeck" and origin.shape:
                yield origin.shape, value  # as the parameter is named
            if key == "elements" and here.key == "robot":
                for table in KINDS:
                    chosen = [i for i, x in enumerate(child) if table == x.TABLE]
                    if chosen:
                        entries = {table: [now[key][i] for i in chosen]}
                        yield table, _Value(entries, table, [child[i] for i in chosen])
            if key in INSIDE and isinstance(now[key], dict):
                for name, inner in _below(value):
                    if name not in now:
                        yield name, replace(inner, parts=[*value.parts, *inner.parts])
                if isinstance(origin, MatrixElement):  # entries that are 0
                    zeros = [name for pair in PAIRS if (name := entry_name(*pair)) not in now[key]]
                    yield from ((name, _Value(now[key], name, None)) for name in zeros)


def _item(origin: Any, key: Any) -> Any:
    """Return what an object has under a key, an index or as an attribute; None where there is nothing."""
    if isinstance(origin, Mapping):
        return origin.get(key)
    if isinstance(origin, Sequence) and not isinstance(origin, str):
        return origin[key] if isinstance(key, int) and key < len(origin) else None
    return getattr(origin, key, None) if isinstance(key, str) else None


def _part(now: Any, origin: Any) -> list[tuple[dict[str, Any], Any]]:
    return [(now, origin)] if isinstance(now, dict) and dataclasses.is_dataclass(origin) else []


def _free_derived(part: dict[str, Any], origin: Any, changed: _Value) -> None:
    """Leave out numbers of a part that follow from others, so that they follow anew; not the one that is changed."""
    for item in dataclasses.fields(origin):
        value = getattr(origin, item.name)
        if item.name == "further":
            for key in value:
                rest = {name: x for name, x in value.items() if name != key}
                kept = changed.key == key and changed.holder is part["further"]
                if not kept and replace(origin, further=rest).further.get(key) == value[key]:
                    part["further"].pop(key, None)
        elif isinstance(value, float) and item.default is None:
            kept = changed.key == item.name and changed.holder is part
            if not kept and getattr(replace(origin, **{item.name: None}), item.name) == value:
                part[item.name] = None


def _turn(part: dict[str, Any], origin: Placement) -> None:
    """Let the axes of a placement follow from roll, pitch and yaw that are changed; forget these where axes are."""
    rpy = part["rpy"]
    if rpy is not None and rpy != _plain(origin.rpy):
        if isinstance(rpy, list) and len(rpy) == 3 and all(isinstance(x, (int, float)) for x in rpy):
            x, y, z = rpy
            part["rotation"] = _plain(rotation_from_rpy((float(x), float(y), float(z))))
    elif part["rotation"] != _plain(origin.rotation):
        part["rpy"] = None


def _unknown(place: str, part: str, now: Any, known: Mapping[str, Any]) -> str:
    """Say that there is nothing of that name, and what there is."""
    where = f" in {place}" if place else ""
    if now is None:
        return f"{place} is not given; allowed: a value for it as a whole"
    if not known:
        return f"{place} is {show(now)}, which has no parts"
    return f"there is no {show(part)}{where}{nearest(part, known)}; known: {listed(known, 20)}"


def _refuse_inertias(before: Robot, after: Robot) -> None:
    """Refuse inertias that no body can have, of links that could be bodies before, as reading does."""
    links = {link.name: link for link in before.links}
    sizes = link_sizes({link.name: link for link in after.links}, after.joints)
    changed = [link for link in after.links if link != links.get(link.name)]
    were = [links.get(link.name, link) for link in changed]
    lowest = lowest_moments(were, [sizes[link.name] for link in changed]) if changed else ()
    judged = [Judged(link, "error", sizes[link.name]) for link, x in zip(changed, lowest, strict=True) if x >= 0.0]
    if judged:
        apply_inertia_policy(judged)
