"""Names of parameters that stay run-time values, ``tunable`` expanded to them, and which numbers of tables they are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from types import MappingProxyType
from typing import NoReturn

from ..errors import DescriptionError
from ..names import nearest, parameter_name, parameter_path, show
from .elements import JOINT_ELEMENTS, KINDS, Spring
from .laws import BASIC, NUMBERS, Number
from .value import COORDINATES, MOTOR, Robot

FORMS = (
    "gravity[.x], links.LINK.mass, links.LINK.com[.x], links.LINK.inertia[.xx], "
    "joints.JOINT.COORDINATE.stiffness (or damping, armature), joints.JOINT.offset[.x], "
    "joints.JOINT.damping.linear (or angular), joints.JOINT.motor.inertia (or ratio), "
    "joints.JOINT.placement.xyz[.0] (or rpy), frames.FRAME.placement.xyz[.0] (or rpy), "
    "loops.LOOP.COORDINATE.stiffness (or damping), loops.LOOP.offset[.x], "
    "loops.LOOP.placements[.0.xyz.0] (or rpy), couplings.COUPLING.ratio[.JOINT.COORDINATE], "
    "couplings.COUPLING.stiffness (or damping, offset), springs.SPRING.stiffness (or "
    "damping, free_length), springs.SPRING.points[.0.x], "
    + ", ".join(f"{table}.{x.KIND.upper()}.{next(iter(x.NUMBERS))}" for table, x in KINDS.items() if x is not Spring)
    + "; * stands for any one component"
)
Places = dict[str, dict[str, dict[str, int]]]  # of numbers in parameters, by family, owner, and name in its table
JOINTS, CUTS, BEARINGS, CUT_BEARINGS, MOTIONS = "coordinates", "cut_laws", "bearings", "cut_bearings", "joint_damping"
LINES = Spring.TABLE
_OF_COORDINATES: Mapping[str, Number] = MappingProxyType({**{number.key: number for number in BASIC}, **NUMBERS})
FAMILIES: Mapping[str, Mapping[str, Number]] = MappingProxyType(  # of forces, with their numbers
    {JOINTS: _OF_COORDINATES, CUTS: _OF_COORDINATES}
    | {family: x.NUMBERS for x in JOINT_ELEMENTS.values() for family in x.FAMILIES.values()}
    | {table: x.NUMBERS for table, x in KINDS.items()}
)
_OF_JOINTS = ("offset", "placement")
_LONG = 1000  # characters of a name that no parameter has which are looked at for a hint


@dataclass(frozen=True)
class Parameter:
    """A number of the description that can be tuned: its name's components, and whether the description gives it."""

    path: tuple[str, ...]
    given: bool = True


def parameters(robot: Robot) -> Iterator[Parameter]:
    """Every number that could be a run-time parameter, a joint's offset and placement in front of its forces."""
    found = (Parameter(parameter_path(name), value is not None) for name, value in robot.numbers())
    for _, owned in groupby(found, lambda item: item.path[:2]):
        yield from sorted(owned, key=lambda item: item.path[0] == "joints" and item.path[2] not in _OF_JOINTS)


def element_places(robot: Robot, names: Iterable[str]) -> Places:
    """Give the places of force elements' numbers among run-time parameters.

    Owners are coordinates ("joint1.x", "pin4.x"; of a motor its own stands for its transmission), couplings, joints,
    loops and springs, in the order of the description.

    Args:
        names: of the run-time parameters, in their order.
    """
    places = {name: place for place, name in enumerate(names)}
    found: Places = {family: {} for family in FAMILIES}
    for item in parameters(robot):
        place, element = places.get(parameter_name(*item.path)), _element_of(item.path)
        if element is not None and place is not None:
            family, owner, key = element
            found[family].setdefault(parameter_name(*owner), {})[parameter_name(*key)] = place
    return found


def _element_of(path: tuple[str, ...]) -> tuple[str, tuple[str, ...], tuple[str, ...]] | None:
    """The family of forces that a number belongs to, its owner, and its name in a table; None of other numbers."""
    kind, part = path[0], path[2] if len(path) > 2 else ""
    if kind == "couplings" or kind in KINDS:
        return CUTS if kind == "couplings" else kind, path[1:2], path[2:]
    if kind in ("joints", "loops") and part in (*COORDINATES, MOTOR):
        return {"joints": JOINTS, "loops": CUTS}[kind], path[1:3], path[3:]
    family = JOINT_ELEMENTS[part].FAMILIES.get(kind) if part in JOINT_ELEMENTS else None
    return None if family is None else (family, path[1:2], path[3:])


def expand_tunable(robot: Robot, patterns: Sequence[str]) -> tuple[str, ...]:
    """Full names of the parameters that the patterns mean, each once, in the order of the description.

    A pattern may stop early (``links.tool.com`` means x, y and z) and may have ``*`` as a whole component.  A value
    that the description does not give (a stiffness, say) is meant only by its full name, and then starts at zero.

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
    """Names by pattern, each as if it stood alone, () where nothing matches it; in one pass for all of them."""
    return {pattern: tuple(names) for pattern, names in _each(list(parameters(robot)), patterns).items()}


def _each(known: Sequence[Parameter], patterns: Sequence[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {pattern: [] for pattern in patterns}
    start = _tree(found, max(len(item.path) for item in known))
    for item in known:
        for pattern in _meaning(start, item):
            found[pattern].append(parameter_name(*item.path))
    return found


@dataclass(eq=False)
class _Node:
    """Patterns that begin alike: by their next component, and the one that ends here."""

    below: dict[str, _Node] = field(default_factory=dict)
    pattern: str | None = None


def _tree(patterns: Iterable[str], deepest: int) -> _Node:
    """The patterns by their components; without those that are longer than any parameter's name."""
    start = _Node()
    for pattern in patterns:
        node = start
        if pattern.count(".") < deepest:
            for part in parameter_path(pattern):
                node = node.below.setdefault(part, _Node())
            node.pattern = pattern
    return start


def _meaning(start: _Node, item: Parameter) -> Iterator[str]:
    """The patterns below a node that mean the parameter."""
    nodes, shortest = [start], _shortest(item.path)
    for length, part in enumerate(item.path, 1):
        choices = (part, "*") if item.given and part != "*" else (part,)
        nodes = [node.below[choice] for node in nodes for choice in choices if choice in node.below]
        if length == len(item.path) or (item.given and length >= shortest):
            yield from (node.pattern for node in nodes if node.pattern is not None)


def _shortest(path: tuple[str, ...]) -> int:
    """Least number of components of a pattern for this parameter."""
    return {"gravity": 1, "joints": 4, "frames": 4}.get(path[0], 3)


def _refuse(robot: Robot, pattern: str, known: Sequence[Parameter]) -> NoReturn:
    wanted, reason = parameter_path(pattern[:_LONG]), "no parameter has this name"
    if "rpy" in wanted and wanted[0] in ("joints", "frames", "loops"):
        reason += " (an rpy can be tuned only where the description gives it; dh does not)"
    paths = (item.path for item in known)
    hint = nearest(
        pattern, (parameter_name(*path[:n]) for path in paths for n in range(_shortest(path), len(path) + 1))
    )
    raise DescriptionError(f"{show(pattern)}: {reason}{hint} (allowed: {FORMS})", where="tunable", source=robot.source)


def number_of(parameter: str) -> Number | None:
    """Give the table's number that a run-time parameter is; None of what is no force."""
    element = _element_of(parameter_path(parameter))
    if element is None:
        return None
    family, _, key = element
    return FAMILIES[family].get(parameter_name(*key)) or FAMILIES[family].get(parameter_name(*key[:1]))


def least_of(parameter: str) -> float | None:
    """Give the least value that a run-time parameter may have; None where any number will do."""
    if parameter.startswith("links.") and parameter.endswith(".mass"):
        return 0.0
    number = number_of(parameter)
    return None if number is None else number.least
