"""Contents of a result's file: the one declaration by which results are written, read and checked.

``ARRAYS`` are its arrays, ``Meta`` is everything else.  Files without what is optional are older ones.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..forms.plain import value_of
from ..identifiers import IDENTIFIER_RULE, ROBOT_RULE, is_identifier, is_robot_name, is_state_name
from ..integration.contacts import Contact
from ..integration.resting import Rest
from ..limits import LARGEST_FINITE, LARGEST_FOUND, MOST_ENTRIES
from ..names import component_name, joint_of, kind_of, listed, show
from ..results.stored import Stored
from ..robot.coordinates import MODE, UNITS, is_kind, rotating_joints, unit_of
from ..robot.elements.journal import RADIAL
from .balance import TERMS

UNIT = re.compile(r"1|[A-Za-z]{1,3}(\^-?[1-9])?([ /][A-Za-z]{1,3}(\^-?[1-9])?){0,3}")  # of an internal state
_LARGEST_SUM = LARGEST_FOUND**2  # of energies: a motion that diverged has large ones
RESULT, TRAJECTORY, BALANCE, ERROR = "result", "trajectory", "balance", "error"  # where an array belongs
OLDER_NAMES = {"memory": "internal_states", "memory_units": "internal_state_units"}  # of arrays, in older files
DERIVED = ("units", "rotating", "quaternions")  # arrays that follow from others, for those who read with NumPy alone


@dataclass(frozen=True, kw_only=True)
class Owned(Stored):
    """An array of the file: its contents, its name in the file, and whose attribute of that name it is.

    Letters of shapes are T (samples), n (coordinates), p (driven coordinates), k (joints that have alpha, beta and
    gamma), s (internal states), links.  Those that are None otherwise are not in older files, nor of results that have
    no such thing.
    """

    name: str
    owner: str


def _array(name: str, owner: str, shape: tuple[str | int, ...], unit: str = "", **more: Any) -> Owned:
    return Owned(name=name, owner=owner, shape=shape, unit=unit, **more)


ARRAYS = (
    _array("coordinates", TRAJECTORY, ("n",), of=str),
    _array("units", RESULT, ("n",), of=str),
    _array("program_coordinates", RESULT, ("p",), of=str),
    _array("t", TRAJECTORY, ("T",), "s"),
    _array("q", TRAJECTORY, ("T", "n"), "m, rad"),
    _array("v", TRAJECTORY, ("T", "n"), "m/s, rad/s"),
    _array("u", TRAJECTORY, ("T", "n"), "N, N m", largest=_LARGEST_SUM),
    _array("energy", TRAJECTORY, ("T", 2), "J", largest=_LARGEST_SUM),
    _array("internal_states", TRAJECTORY, ("s",), of=str, otherwise=None),
    _array("internal_state_units", TRAJECTORY, ("s",), of=str, otherwise=None),
    _array("input_units", TRAJECTORY, ("n",), of=str, otherwise=None),
    _array("z", TRAJECTORY, ("T", "s"), otherwise=None),
    _array("rotating", TRAJECTORY, ("k",), of=str, otherwise=None),
    _array("quaternions", TRAJECTORY, ("T", "k", 4), otherwise=None, largest=1.0 + 1e-12),
    _array("program_q", RESULT, ("T", "p"), "m, rad"),
    _array("pose", RESULT, ("T", 4, 4), "1, m"),
    _array("program_pose", RESULT, ("T", 4, 4), "1, m"),
    _array("wrench", RESULT, ("T", "links", 6), "N, N m", otherwise=None),
    _array("q_error", ERROR, ("T", "n"), "m, rad", otherwise=None),
    _array("v_error", ERROR, ("T", "n"), "m/s, rad/s", otherwise=None),
    _array("z_error", ERROR, ("T", "s"), otherwise=None),
    _array("tool_error", ERROR, ("T", 3), "m", otherwise=None),
    _array("tool_rotation_error", ERROR, ("T",), "rad", otherwise=None),
    _array("work", BALANCE, ("T", len(TERMS)), "J", otherwise=None, largest=_LARGEST_SUM),
)


@dataclass(frozen=True, kw_only=True)
class Meta:
    """Everything that is no array; fields with a default are not in older files."""

    robot: str
    tool: str
    method: str = field(metadata={"owner": TRAJECTORY})
    info: Mapping[str, float] = field(metadata={"owner": TRAJECTORY})
    notes: tuple[str, ...]
    versions: Mapping[str, str]
    programmed: bool = True
    prescribed: tuple[str, ...] = ()
    passive: tuple[str, ...] = ()
    robot_hash: str = ""
    links: tuple[str, ...] = ()
    contacts: tuple[Contact, ...] = field(default=(), metadata={"owner": TRAJECTORY})
    rests: tuple[Rest, ...] = field(default=(), metadata={"owner": TRAJECTORY})
    scenario: Mapping[str, Any] = field(default_factory=dict)
    description: Mapping[str, Any] = field(default_factory=dict)
    stopped: Mapping[str, Any] = field(default_factory=dict)
    unresolved: float | None = field(default=None, metadata={"owner": ERROR})


@dataclass(frozen=True)
class Stop:
    """The entry ``stopped`` where the motion came to its end too early."""

    reason: str
    t: float
    coordinate: str
    q: tuple[float, ...]
    v: tuple[float, ...]
    z: tuple[float, ...] = ()


_MOST_NAMES = len(UNITS) * MOST_ENTRIES
COUNTS = ("steps", "evaluations", "jacobians", "wall_s")  # that ``info`` has, whatever the method


def meta_of(data: Mapping[str, Any], where: str) -> Meta:
    """Return the meta of a file or of a result that is to be written; undeclared entries are a newer eomgen's.

    Raises:
        InputError: something is missing, or of another type than is declared; the message begins with ``where``.
    """
    known = {item.name for item in fields(Meta)}
    meta: Meta = value_of(Meta, {key: value for key, value in data.items() if key in known}, where, LARGEST_FINITE)
    _check_names(where, "robot", [meta.robot], is_robot_name, ROBOT_RULE)
    _check_names(where, "tool", [meta.tool], is_identifier, IDENTIFIER_RULE)
    _check_names(where, "links", meta.links, is_identifier, IDENTIFIER_RULE)
    if meta.robot_hash and not re.fullmatch("[0-9a-f]{64}", meta.robot_hash):
        raise InputError(f"{where}: robot_hash: got {show(meta.robot_hash)}; allowed: 64 hexadecimal digits")
    sticking = list(dict.fromkeys(rest.coordinate for rest in meta.rests))
    _check_names(where, "rests", sticking, _may_stick, "names of coordinates and couplings")
    for key in COUNTS:
        if meta.info.get(key, -1) < 0:
            raise InputError(f"{where}: info: got {show(meta.info.get(key))} for {key}; allowed: a number from 0 on")
    return meta


def _may_stick(name: str) -> bool:
    """Return whether friction may act under this name: a coordinate, one of a loop joint, or a coupling."""
    owner, *kind = name.split(".")
    return is_identifier(owner) and (not kind or (len(kind) == 1 and kind[0] in UNITS))


def check_contents(meta: Meta, arrays: Mapping[str, NDArray[Any]], where: str) -> dict[str, Any]:
    """Return arrays as they are declared, names as tuples, without undeclared ones.

    Raises:
        InputError: an array is missing, has another dtype or shape, or a number that is none; names that do not belong
            together.  The message begins with ``where``.
    """
    sizes: dict[str, int] = {"links": len(meta.links)}
    checked: dict[str, Any] = {}
    for stored in ARRAYS:
        if stored.name in arrays:
            checked[stored.name] = _checked(stored, arrays[stored.name], sizes, f"{where}: array {stored.name}")
        elif stored.otherwise is not None:
            raise InputError(f"{where}: array {stored.name} is missing; allowed: a result with it")
    _check_coordinates(meta, checked, where)
    _check_errors(meta, checked, where)
    t = checked["t"]
    if not t.size:
        raise InputError(f"{where}: array t: got no samples; allowed: one or more")
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if late.size:
        i = int(late[0])
        raise InputError(f"{where}: array t: got {t[i + 1]:g} after {t[i]:g}; allowed: increasing times")
    return checked


def _check_errors(meta: Meta, arrays: Mapping[str, Any], where: str) -> None:
    """Refuse parts of an estimated global error without the others."""
    needed = {"q_error", "v_error", *(("z_error",) if "z" in arrays else ())}
    tool, given = (
        {"tool_error", "tool_rotation_error"},
        {item.name for item in ARRAYS if item.owner == ERROR} & set(arrays),
    )
    if meta.unresolved is None and given:
        raise InputError(f"{where}: unresolved: is missing beside {listed(sorted(given))}; allowed: both, or none")
    if meta.unresolved is None:
        return
    if given not in (needed, needed | tool):
        allowed = f"{listed(sorted(needed))}, and both or none of {listed(sorted(tool))}"
        raise InputError(f"{where}: arrays of errors: got {listed(sorted(given)) or 'none'}; allowed: {allowed}")
    if not 0.0 <= meta.unresolved <= 1.0:
        raise InputError(f"{where}: unresolved: got {meta.unresolved:g}; allowed: from 0 to 1")


def _checked(stored: Owned, array: NDArray[Any], sizes: dict[str, int], where: str) -> Any:
    wanted = stored.expected_shape(array.shape, sizes)
    if array.shape != wanted:
        text = ", ".join(map(str, stored.shape))
        raise InputError(f"{where}: got the shape {array.shape!s:.80}; allowed: ({text}), which is {wanted} here")
    if stored.of is str:
        if array.dtype.kind != "U" and array.size:
            raise InputError(f"{where}: got the dtype {array.dtype}; allowed: texts")
        if array.size > _MOST_NAMES:
            raise InputError(f"{where}: got {array.size} texts; allowed: up to {_MOST_NAMES}")
        return tuple(str(text) for text in array.tolist())
    if array.dtype.kind != "f" or array.dtype.itemsize != 8:
        raise InputError(f"{where}: got the dtype {array.dtype}; allowed: float64")
    array = array.astype(np.float64, copy=False)  # the order of bytes of this machine
    if array.size and not (array.min() >= -stored.largest and array.max() <= stored.largest):  # NaN is neither
        place = tuple(int(i) for i in np.argwhere(~(np.abs(array) <= stored.largest))[0])
        raise InputError(
            f"{where}: got {float(array[place])!r} at {list(place)};"
            f" allowed: finite numbers of magnitude up to {stored.largest:g}"
        )
    return array


def check_coordinates(names: Sequence[str], units: Sequence[str], where: str) -> None:
    """Refuse names that no coordinate has, that are there twice, or that have other units; InputError as above."""
    rule = f"JOINT.KIND with a kind of {', '.join(UNITS)}, or LINK.{MODE}1"
    _check_names(where, "coordinates", names, lambda x: is_identifier(joint_of(x)) and is_kind(kind_of(x)), rule)
    if not names:
        raise InputError(f"{where}: coordinates: got none; allowed: one or more")
    wanted = tuple(unit_of(name) for name in names)
    if tuple(units) != wanted:
        raise InputError(f"{where}: units: got {listed(units)}; allowed: {listed(wanted)}")


def check_internal_states(
    names: Sequence[str], units: Sequence[str], where: str, key: str, owners: Sequence[str] = ()
) -> None:
    """Refuse names that are not those of internal states, of some owners where they are known, or that are there twice.

    Units are those of names, one for each: SI units and their products.
    """

    def is_state(name: str) -> bool:
        return is_state_name(name) and (not owners or any(name.startswith(f"{owner}.") for owner in owners))

    _check_names(where, key, names, is_state, "OWNER.LAW.STATE with an owner of " + (listed(owners) or "any name"))
    if len(units) != len(names) or not all(UNIT.fullmatch(unit) for unit in units):
        raise InputError(
            f"{where}: {key.removesuffix('s')}_units: got {listed(units)}; allowed: a unit for each of {listed(names)}"
        )


def _check_coordinates(meta: Meta, arrays: Mapping[str, Any], where: str) -> None:
    """Refuse names of coordinates that the result does not have, wherever they stand."""
    coordinates = arrays["coordinates"]
    check_coordinates(coordinates, arrays["units"], where)
    states = arrays.get("internal_states") or ()
    there = [name in arrays for name in ("internal_states", "internal_state_units", "z")]
    if any(there) and not all(there):
        raise InputError(
            f"{where}: arrays internal_states, internal_state_units and z: got some of them; allowed: all, or none"
        )
    inputs = arrays.get("input_units") or ()
    if not all(UNIT.fullmatch(unit) for unit in inputs):
        raise InputError(f"{where}: input_units: got {listed(inputs)}; allowed: units")
    rotating = rotating_joints(coordinates)
    if arrays.get("rotating", rotating) != rotating:
        got = listed(arrays["rotating"])
        raise InputError(f"{where}: array rotating: got {got}; allowed: {listed(rotating) or 'no joint'}")
    cuts = (name for name in _cut_names(meta.description) if "." in name)
    journals = {component_name(joint_of(name), RADIAL) for name in (*coordinates, *cuts)}
    contacts = dict.fromkeys(contact.coordinate for contact in meta.contacts if contact.coordinate not in journals)
    followers = (str(coupling.get("of")) for coupling in _tables(meta.description, "couplings"))
    known = (*coordinates, *_cut_names(meta.description), *followers)
    check_internal_states(states, arrays.get("internal_state_units") or (), where, "array internal_states", known)
    for key, names, allowed in (
        ("array program_coordinates", arrays["program_coordinates"], coordinates),
        ("prescribed", meta.prescribed, coordinates),
        ("passive", meta.passive, coordinates),
        ("contacts", tuple(contacts), known),
    ):
        unknown = [name for name in names if name not in allowed]
        if unknown or len(set(names)) < len(names):
            what = unknown or names
            raise InputError(f"{where}: {key}: got {listed(what)}; allowed: each once, of {listed(allowed)}")
    if meta.stopped:
        stop: Stop = value_of(Stop, meta.stopped, f"{where}: stopped", LARGEST_FINITE)
        sizes = [len(x) for x in (stop.q, stop.v, stop.z)]
        if sizes != [len(coordinates)] * 2 + [len(states)] or stop.coordinate not in ("", *coordinates, *states):
            raise InputError(f"{where}: stopped: is not of these coordinates; allowed: {listed(coordinates)}")


def _cut_names(description: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of loop joints' coordinates, and of couplings, of a recorded robot: they may have a clearance.

    Records of another form have none.
    """
    cuts = [(loop.get("name"), loop.get("coordinates")) for loop in _tables(description, "loops")]
    names = [f"{name}.{kind}" for name, kinds in cuts if isinstance(kinds, Mapping) for kind in kinds]
    return (*names, *(str(coupling.get("name")) for coupling in _tables(description, "couplings")))


def _tables(description: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    items = description.get(key, ())
    return [item for item in items if isinstance(item, Mapping)] if isinstance(items, Sequence) else []


def _check_names(where: str, key: str, names: Sequence[str], is_allowed: Any, rule: str) -> None:
    for name in names:
        if not is_allowed(name):
            raise InputError(f"{where}: {key}: got {show(name)}; allowed: {rule}")
    if len(set(names)) < len(names):
        raise InputError(f"{where}: {key}: got {listed(names)}; allowed: each name once")
