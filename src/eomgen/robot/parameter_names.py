"""Names of parameters that stay run-time values: ``tunable`` of a description, expanded to full names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..errors import DescriptionError
from ..names import nearest, parameter_name, parameter_path, show
from .value import COORDINATE_NUMBERS, COORDINATES, INERTIA_KEYS, LINEAR, MOTOR, Placement, Robot

FORMS = (
    "gravity[.x], links.LINK.mass, links.LINK.com[.x], links.LINK.inertia[.xx], "
    "joints.JOINT.COORDINATE.stiffness (or damping, armature), joints.JOINT.offset[.x], "
    "joints.JOINT.motor.inertia (or ratio), "
    "joints.JOINT.placement.xyz[.0] (or rpy), frames.FRAME.placement.xyz[.0] (or rpy), springs.SPRING.stiffness (or "
    "damping, free_length), springs.SPRING.points[.0.x]; * stands for any one component"
)


@dataclass(frozen=True)
class Parameter:
    """A number of the description that can be tuned: its name's components, and whether the description gives it."""

    path: tuple[str, ...]
    given: bool = True


def parameters(robot: Robot) -> Iterator[Parameter]:
    """Every number that could be a run-time parameter, in the order of the description."""
    for axis in LINEAR:
        yield Parameter(("gravity", axis))
    for link in robot.links:
        yield Parameter(("links", link.name, "mass"))
        for axis in LINEAR:
            yield Parameter(("links", link.name, "com", axis))
        for key in INERTIA_KEYS:
            yield Parameter(("links", link.name, "inertia", key))
    for joint in robot.joints:
        for name, value in zip(COORDINATES, joint.offset, strict=True):
            yield Parameter(("joints", joint.name, "offset", name), value is not None)
        yield from _placement(("joints", joint.name), joint.placement)
        for name, coordinate in joint.coordinates.items():
            for key in COORDINATE_NUMBERS:
                yield Parameter(("joints", joint.name, name, key), getattr(coordinate, key) is not None)
            for key in coordinate.law():
                yield Parameter(("joints", joint.name, name, *parameter_path(key)))
        for key, value in (joint.motor.numbers() if joint.motor else {}).items():
            yield Parameter(("joints", joint.name, MOTOR, *parameter_path(key)), value is not None)
    for frame in robot.frames:
        yield from _placement(("frames", frame.name), frame.placement)
    for spring in robot.springs:
        given = spring.law()
        for key in dict.fromkeys((*spring.optional, *given)):
            yield Parameter(("springs", spring.name, *parameter_path(key)), key in given)
        for index in "01":
            for axis in LINEAR:
                yield Parameter(("springs", spring.name, "points", index, axis))


def _placement(owner: tuple[str, str], placement: Placement) -> Iterator[Parameter]:
    for key in ("xyz", "rpy") if placement.rpy is not None else ("xyz",):
        for index in "012":
            yield Parameter((*owner, "placement", key, index))


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
    chosen: set[tuple[str, ...]] = set()
    for pattern in patterns:
        wanted = parameter_path(pattern)
        found = {item.path for item in known if _matches(wanted, item)}
        if not found:
            _refuse(robot, pattern, wanted, known)
        chosen |= found
    return tuple(parameter_name(*item.path) for item in known if item.path in chosen)


def _matches(wanted: tuple[str, ...], item: Parameter) -> bool:
    if len(wanted) < _shortest(item.path) or len(wanted) > len(item.path):
        return False
    if not item.given and wanted != item.path:
        return False
    return all(want in ("*", part) for want, part in zip(wanted, item.path, strict=False))


def _shortest(path: tuple[str, ...]) -> int:
    """Least number of components of a pattern for this parameter."""
    return {"gravity": 1, "links": 3, "joints": 4, "frames": 4, "springs": 3}[path[0]]


def _refuse(robot: Robot, pattern: str, wanted: tuple[str, ...], known: Sequence[Parameter]) -> None:
    reason = "no parameter has this name"
    if "rpy" in wanted and wanted[0] in ("joints", "frames"):
        reason += " (an rpy can be tuned only where the description gives it; dh does not)"
    paths = (item.path for item in known)
    hint = nearest(
        pattern, (parameter_name(*path[:n]) for path in paths for n in range(_shortest(path), len(path) + 1))
    )
    raise DescriptionError(f"{show(pattern)}: {reason}{hint} (allowed: {FORMS})", where="tunable", source=robot.source)
