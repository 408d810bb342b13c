"""Names of run-time parameters, patterns of ``tunable`` expanded to them, and their numbers in tables of laws."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from types import MappingProxyType
from typing import Any, NoReturn

from ..errors import DescriptionError
from ..identifiers import parameter_path
from ..names import nearest, parameter_name, show
from .coordinates import MODE
from .elements import JOINT_ELEMENTS, KINDS, Spring
from .internal_states.bristles import FADING, PASSIVITY
from .laws import BASIC, LAWS, NUMBERS
from .numbers import Number
from .value import COORDINATES, MOTOR, Robot

FORMS = (
    "gravity[.x], links.LINK.mass (or com[.x], inertia[.xx], modes.1.stiffness), joints.JOINT.COORDINATE.stiffness (or"
    " damping, armature), joints.JOINT.offset[.x] (or pitch, placement.xyz[.0], placement.rpy[.0], stiffness.x.beta,"
    " damping.x.beta, damping.linear, motor.inertia, motor.ratio), frames.FRAME.placement.xyz[.0] (or rpy),"
    " loops.LOOP.COORDINATE.stiffness (or damping), loops.LOOP.offset[.x] (or placements[.0.xyz.0]),"
    " couplings.COUPLING.ratio[.JOINT.COORDINATE] (or stiffness, damping, offset), springs.SPRING.stiffness (or"
    " damping, free_length, points[.0.x]), "
    + ", ".join(f"{table}.{x.KIND.upper()}.{next(iter(x.NUMBERS))}" for table, x in KINDS.items() if x is not Spring)
    + "; * stands for any one component"
)
Places = dict[str, dict[str, dict[str, int]]]  # of numbers in parameters, by family, owner, and name in its table
JOINTS, CUTS, BEARINGS, CUT_BEARINGS, MOTIONS = "coordinates", "cut_laws", "bearings", "cut_bearings", "joint_damping"
STIFFNESSES, CUT_STIFFNESSES, CUT_MOTIONS = "joint_stiffness", "cut_stiffness", "cut_damping"
LINES = Spring.TABLE
_OF_COORDINATES: Mapping[str, Number] = MappingProxyType({**{number.key: number for number in BASIC}, **NUMBERS})
FAMILIES: Mapping[str, Mapping[str, Number]] = MappingProxyType(  # of forces, with their numbers
    {JOINTS: _OF_COORDINATES, CUTS: _OF_COORDINATES}
    | {family: x.NUMBERS for x in JOINT_ELEMENTS.values() for family in x.FAMILIES.values()}
    | {table: x.NUMBERS for table, x in KINDS.items()}
)
_OF_JOINTS = ("offset", "pitch", "placement")
BODY = ("mass", "com", "inertia")  # of a link
OF_MODES = ("beam", "modal_damping")  # what modes of a link follow from
_LONG = 1000  # characters of a name that no parameter has which are looked at for a hint


@dataclass(frozen=True)
class Parameter:
    """A number of the description that can be tuned: its name's components, and whether the description sets it."""

    path: tuple[str, ...]
    is_set: bool = True


def parameters(robot: Robot) -> Iterator[Parameter]:
    """Yield every number that could be a run-time parameter, a joint's offset and placement before its forces.

    Mass, centre of mass and inertia of a link that bends are none: its modes are of the same mass.
    """
    every = ((parameter_path(name), value is not None) for name, value in robot.numbers())
    bending = _bending(robot)
    all_numbers = (Parameter(path, is_set) for path, is_set in every if not _is_of_modes(path, bending))
    for _, owned in groupby(all_numbers, lambda item: item.path[:2]):
        yield from sorted(owned, key=lambda item: item.path[0] == "joints" and item.path[2] not in _OF_JOINTS)


def _bending(robot: Robot) -> set[str]:
    return {link.name for link in robot.links if link.modes is not None}


def _is_of_modes(path: Sequence[str], bending: set[str]) -> bool:
    """Whether a number is of a body whose modes have its mass, too."""
    return path[0] == "links" and len(path) > 2 and path[1] in bending and path[2] in BODY


def following_modes(robot: Robot, names: Iterable[str]) -> tuple[str, str] | None:
    """Return the first name of a number that modes follow from, or has their mass, and what to say of it; else None."""
    bending = _bending(robot)
    for name in names:
        path = parameter_path(name[:_LONG])
        if len(path) < 3 or path[0] != "links" or path[1] not in bending:
            continue
        stiffness = f"links.{path[1]}.modes.1.stiffness (or damping)"
        if path[2] in BODY:
            message = f"the modes of {path[1]} are of the same mass, so that it is no parameter"
            return name, f"{message}; allowed: {stiffness}, or a payload on a node of it"
        if path[2] in OF_MODES:
            message = f"the modes of {path[1]} follow from it, so that it is no parameter"
            return name, f"{message}; allowed: {stiffness}, or another robot, of Robot.with_value"
    return None


def element_places(robot: Robot, names: Iterable[str]) -> Places:
    """Return the indices of force elements' numbers among run-time parameters.

    Owners are coordinates ("joint1.x", "pin4.x"; a motor's stands for its transmission), couplings, joints,
    loops and springs, in the order of the description.

    Args:
        names: of the run-time parameters, in their order.
    """
    places = {name: place for place, name in enumerate(names)}
    families: Places = {family: {} for family in FAMILIES}
    for item in parameters(robot):
        place, element = places.get(parameter_name(*item.path)), _element_of(item.path)
        if element is not None and place is not None:
            family, owner, key = element
            families[family].setdefault(parameter_name(*owner), {})[parameter_name(*key)] = place
    return families


def _element_of(path: tuple[str, ...]) -> tuple[str, tuple[str, ...], tuple[str, ...]] | None:
    """Return the family of forces that a number belongs to, its owner, and its name in a table; None of others."""
    kind, table = path[0], path[2] if len(path) > 2 else ""
    if kind == "couplings" or kind in KINDS:
        return CUTS if kind == "couplings" else kind, path[1:2], path[2:]
    if kind == "links" and table == "modes":
        return JOINTS, (path[1], f"{MODE}{path[3]}"), path[4:]
    if kind in ("joints", "loops") and table in (*COORDINATES, MOTOR):
        return {"joints": JOINTS, "loops": CUTS}[kind], path[1:3], path[3:]
    family = JOINT_ELEMENTS[table].FAMILIES.get(kind) if table in JOINT_ELEMENTS else None
    return None if family is None else (family, path[1:2], path[3:])


def is_entry(parameter: str) -> bool:
    """Whether a run-time parameter is an entry of a symmetric matrix: "joints.joint1.stiffness.x.beta"."""
    path = parameter_path(parameter)
    return _element_of(path) is not None and path[-1] in COORDINATES and path[-2] in COORDINATES


def matrices(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the symmetric matrices whose entries are among run-time parameters: coordinates, in their order, by name.

    A matrix is called as its entries are in front of their coordinates: "joints.joint1.stiffness".

    Args:
        names: of the run-time parameters.
    """
    found: dict[str, set[str]] = {}
    for name in names:
        path = parameter_path(name)
        if is_entry(name):
            found.setdefault(parameter_name(*path[:-2]), set()).update(path[-2:])
    return {owner: [name for name in COORDINATES if name in moved] for owner, moved in found.items()}


def conditions(robot: Robot, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return what run-time parameters of laws must satisfy together, as plain values.

    Each has its numbers with their factors, the least value of the sum of the products, and what is allowed; or "fades"
    with the numbers of bristles whose damping has to fade, by their keys.

    Args:
        robot: whose parameters they are.
        names: of the run-time parameters.
    """
    every, found = list(names), list[dict[str, Any]]()
    for family in (JOINTS, CUTS):
        for places in element_places(robot, every)[family].values():
            own = {key: every[place] for key, place in places.items()}
            for law in LAWS.values():
                for one in law.conditions:
                    if one.factors.keys() <= own.keys():
                        factors = {own[key]: factor for key, factor in one.factors.items()}
                        found.append({"factors": factors, "least": one.least, "allowed": one.allowed})
            if own.keys() >= FADING:
                found.append({"fades": {key: own[key] for key in PASSIVITY if key in own}})
    return found


def expand_tunable(robot: Robot, patterns: Sequence[str]) -> tuple[str, ...]:
    """Return the full names of the parameters that match the patterns, each once, in the order of the description.

    A pattern may stop early (``links.tool.com`` means x, y and z) and may have ``*`` as a whole component.  A value
    that the description does not set (a stiffness, say) matches its full name alone, and then starts at zero.

    Raises:
        DescriptionError: a pattern that no parameter matches.
    """
    if not patterns:
        return ()
    known = list(parameters(robot))
    meant = _each(known, patterns)
    for pattern, names in meant.items():
        if not names:
            _refuse(robot, pattern, known)
    chosen = {name for names in meant.values() for name in names}
    return tuple(name for item in known if (name := parameter_name(*item.path)) in chosen)


def expand_each(robot: Robot, patterns: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return names by pattern, each as if it stood alone, () where nothing matches it; in one pass for all of them."""
    return {pattern: tuple(names) for pattern, names in _each(list(parameters(robot)), patterns).items()}


def _each(known: Sequence[Parameter], patterns: Sequence[str]) -> dict[str, list[str]]:
    matches: dict[str, list[str]] = {pattern: [] for pattern in patterns}
    start = _tree(matches, max(len(item.path) for item in known))
    for item in known:
        for pattern in _meaning(start, item):
            matches[pattern].append(parameter_name(*item.path))
    return matches


@dataclass(eq=False)
class _Node:
    """Patterns that begin alike: by their next component, and the one that ends here."""

    below: dict[str, _Node] = field(default_factory=dict)
    pattern: str | None = None


def _tree(patterns: Iterable[str], deepest: int) -> _Node:
    """Return the prefix tree of the patterns, without those that are longer than any parameter's name."""
    start = _Node()
    for pattern in patterns:
        node = start
        if pattern.count(".") < deepest:
            for component in parameter_path(pattern):
                node = node.below.setdefault(component, _Node())
            node.pattern = pattern
    return start


def _meaning(start: _Node, item: Parameter) -> Iterator[str]:
    """Yield the patterns below a node that match the parameter."""
    nodes, shortest = [start], _shortest(item.path)
    for length, component in enumerate(item.path, 1):
        choices = (component, "*") if item.is_set and component != "*" else (component,)
        nodes = [node.below[choice] for node in nodes for choice in choices if choice in node.below]
        if length == len(item.path) or (item.is_set and length >= shortest):
            yield from (node.pattern for node in nodes if node.pattern is not None)


def _shortest(path: tuple[str, ...]) -> int:
    """Return the least number of components of a pattern for this parameter."""
    if path[2:3] == ("modes",):
        return 5
    return {"gravity": 1, "joints": 4, "frames": 4}.get(path[0], 3)


def _refuse(robot: Robot, pattern: str, known: Sequence[Parameter]) -> NoReturn:
    if (bound := following_modes(robot, (pattern,))) is not None:
        raise DescriptionError(f"{show(pattern)}: {bound[1]}", where="tunable", source=robot.source)
    wanted, reason = parameter_path(pattern[:_LONG]), "no parameter has this name"
    if "rpy" in wanted and wanted[0] in ("joints", "frames", "loops"):
        reason += " (an rpy can be tuned only where the description has it; dh has none)"
    paths = (item.path for item in known)
    hint = nearest(
        pattern, (parameter_name(*path[:n]) for path in paths for n in range(_shortest(path), len(path) + 1))
    )
    raise DescriptionError(f"{show(pattern)}: {reason}{hint} (allowed: {FORMS})", where="tunable", source=robot.source)


def number_of(parameter: str) -> Number | None:
    """Return the law table's number of a run-time parameter; None of one that is no force."""
    element = _element_of(parameter_path(parameter))
    if element is None:
        return None
    family, _, key = element
    return FAMILIES[family].get(parameter_name(*key)) or FAMILIES[family].get(parameter_name(*key[:1]))


def least_of(parameter: str) -> float | None:
    """Return the least value that a run-time parameter may have; None where any number will do."""
    if parameter.startswith("links.") and parameter.endswith(".mass"):
        return 0.0
    number = number_of(parameter)
    return None if number is None else number.least


def leasts(robot: Robot, names: Iterable[str]) -> dict[str, float]:
    """Return the least values of run-time parameters by name, as of ``least_of``; more for diagonals of coupled modes.

    Args:
        robot: whose parameters they are.
        names: of them; those that may have any value are left out.
    """
    bending = [link for link in robot.links if link.modes is not None]
    higher = {
        parameter_name("links", link.name, key): least
        for link in bending
        for key, least in (link.modes.least() if link.modes is not None else {}).items()
    }
    found = {name: higher.get(name, least_of(name)) for name in names}
    return {name: least for name, least in found.items() if least is not None}
