"""A calibrated robot as TOML: the description's text with calibrated values in their places, or beside a URDF."""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...description.builtin import BUILTIN, builtin_robots
from ...description.load import load_robot
from ...errors import InputError
from ...files import check_ending, write_atomically
from ...forms.toml_text import read_text
from ...identifiers import show_path
from ...names import parameter_name
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS, JointStiffness
from ...robot.elements.matrices import matrix_of as matrix_rows
from ...robot.value import COORDINATES, Joint, Loop, Placement, Robot
from ..geometry.error_model import BASE, FRAMES, JOINTS, LOOPS, SECOND, TILT
from ..geometry.stations import Chain, matrix_of
from .calibrated import (
    ENTRIES,
    OF_LINK,
    calibrated_robot,
    fitted_entries,
    is_said,
    matrix_of_joint,
    offset_of,
    owner_of,
    placement_of,
    placements,
    second_of,
    stiffness_of,
    taken_in,
    tilt_of,
)

Numbers = Callable[[Robot], Iterator[tuple[str, Sequence[float | None]]]]  # by name

_CLOSE = 1e-12  # by how much what was written may be off when it is read again
HEAD = (
    "# Calibrated.  Offsets (m, rad) are added to the joint's six coordinates before they move anything, in its",
    "# axes, with the sign of the coordinate: a positive offset.gamma turns the child as a positive gamma does.",
    "# Behind +- are standard deviations; a number that is not identifiable has the least change from the description.",
)
APART = "# Of a fit with terms that no description has; all other numbers here are of a fit without them:"


@dataclass(frozen=True)
class FittedParameters:
    """Parameters to write: the robot as described, its stations, links of measured frames, and by name values,
    standard deviations and units."""

    robot: Robot
    chain: Chain
    links: Mapping[str, str]
    values: Mapping[str, float]
    deviations: Mapping[str, float]
    units: Mapping[str, str]

    @property
    def calibrated(self) -> Robot:
        """Calibrated robot."""
        return calibrated_robot(self.robot, self.chain, self.links, self.values)

    def said(self, *name: str) -> str:
        """Return standard deviations as comments have them: of a name's six components, as far as they were fitted."""
        keys = [parameter_name(*name, kind) for kind in COORDINATES]
        return "+- " + ", ".join(deviation_text(self.deviations[key]) for key in keys if key in self.deviations)


def write_toml(fitted: FittedParameters, target: Path) -> Path:
    """Write the description with calibrated values, and return the path.

    Raises:
        InputError: see ``CalibrationResult.to_toml``.
    """
    check_ending(target, ".toml")
    return write_compared((fitted.robot, fitted.calibrated), partial(toml_text, fitted), target, _numbers)


def toml_text(fitted: FittedParameters, folder: Path) -> str:
    """Return the text for a file in that folder."""
    robot, lines = fitted.robot, [*HEAD, *_comments(fitted)]
    body = body_of(robot, folder)
    for joint in robot.joints:
        _put_joint(fitted, joint, body, robot)
    for loop in robot.loops:
        offset = offset_of(loop, fitted.values)
        if offset:
            _put_offset(fitted, LOOPS, loop.name, offset, body)
        _put_springs(fitted, loop, body)
        if second_of(loop, fitted.values) is not None:
            _put_second(fitted, loop.name, body)
    links = {robot.base, *(link.name for link in robot.links)}
    for name, link, pose in placements(fitted.links, fitted.values):
        new = name + OF_LINK if name in links else name
        block = block_of(body, "frames", new)
        table = _table(placement_of(pose), _in_degrees(body, block))
        line = f"placement = {table}  # {fitted.said(FRAMES, name)}"
        if block is None:
            body += ["", "[[frames]]", f'name = "{new}"', f'link = "{link}"', line]
        else:
            replace_line(body, block, "placement", line, robot)
    return headed(lines, body)


def body_of(robot: Robot, folder: Path, *more: str) -> list[str]:
    """Return lines for a file in that folder that say what the robot's file does.

    They are those of a robot in TOML; of a URDF they name it as the one to refine, with more lines.

    Raises:
        InputError: the robot was read from no file, or from one of another format.
    """
    source = Path(robot.source)
    if not robot.source:
        raise InputError(f"{robot.name}: has no description to write into; allowed: a robot that was read from a file")
    if source.suffix in (".urdf", ".xml"):
        return [f'name = "{robot.name}"', f'urdf = "{relative_path(source, folder)}"', *more, ""]
    return own_text(robot, source, folder)


def headed(head: Sequence[str], body: Sequence[str]) -> str:
    """Return the text of a file: lines for its head, which come behind that of editors, and its body."""
    first = 1 if body and body[0].startswith("#:schema") else 0
    return "\n".join([*body[:first], *head, *body[first:]]) + "\n"


def own_text(robot: Robot, source: Path, folder: Path) -> list[str]:
    """Return lines of the robot's file; names of files in them lead to the same files from the new folder."""
    if str(source) in builtin_robots():
        return read_text(BUILTIN / f"{source}.toml", str(source)).splitlines()
    if source.suffix != ".toml":
        raise InputError(f"{robot.name}: was read from {show_path(str(source))}; allowed for TOML: .toml or .urdf")

    def moved(match: re.Match[str]) -> str:
        return f'{match[1]}"{relative_path(source.parent / match[2], folder)}"'

    text = read_text(source, str(source))
    return [re.sub(r'\b((?:urdf|curve|matrix|modes)\s*=\s*)"([^"]+)"', moved, line) for line in text.splitlines()]


def relative_path(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def _comments(fitted: FittedParameters) -> list[str]:
    """Return comments for what has no place in a description: where the base stands, terms that it cannot have."""
    bases, terms = list[str](), list[str]()
    for name, value in fitted.values.items():
        line = f"# {name} = {value!r} +- {deviation_text(fitted.deviations[name])} {fitted.units[name]}"
        if BASE in name.split(".")[:-1]:
            bases.append(line)
        elif not is_said(fitted.robot, fitted.values, name):
            terms.append(line)
    return [*bases, *([APART] if terms else []), *terms]


def _put_joint(fitted: FittedParameters, joint: Joint, body: list[str], robot: Robot) -> None:
    offset, stiffness = offset_of(joint, fitted.values), stiffness_of(joint, fitted.values)
    tilt, matrix = tilt_of(joint, fitted.values), matrix_of_joint(joint, fitted.values)
    if not offset and not stiffness and tilt is None and matrix is None:
        return
    if block_of(body, JOINTS, joint.name) is None:
        if 'urdf = "' not in "\n".join(body):
            raise unwritable(robot, joint.name)
        body += ["", "[[joints]]", f'name = "{joint.name}"']
    if offset:
        _put_offset(fitted, JOINTS, joint.name, offset, body)
    if tilt is not None:
        _put_placement(fitted, joint, body)
    _put_springs(fitted, joint, body)


def _put_springs(fitted: FittedParameters, joint: Joint | Loop, body: list[str]) -> None:
    """Write the stiffness of a joint, or of a loop joint, into tables of its coordinates and into its matrix."""
    owner, matrix = owner_of(joint), matrix_of_joint(joint, fitted.values)
    for kind, value in stiffness_of(joint, fitted.values).items():
        block = block_of(body, owner, joint.name)
        if block is None:
            raise unwritable(fitted.robot, joint.name)
        at = [i for i in range(*block) if re.match(rf"\s*{kind}\s*=\s*\{{", body[i])]
        if len(at) != 1 or "stiffness" not in body[at[0]]:
            raise unwritable(fitted.robot, f"{joint.name}.{kind}")
        key = parameter_name(owner, joint.name, kind, "stiffness")
        changed = re.sub(r"(?<!_)\bstiffness\s*=\s*[^,}\s]+", f"stiffness = {value!r}", body[at[0]], count=1)
        body[at[0]] = f"{changed}  # stiffness +- {deviation_text(fitted.deviations[key])}"

    if matrix is not None:
        _put_matrix(fitted, joint, matrix, body)


def _put_matrix(fitted: FittedParameters, joint: Joint | Loop, matrix: JointStiffness, body: list[str]) -> None:
    """Write the stiffness matrix of a joint into its entry, and take out what tables of its coordinates had."""
    robot, owner = fitted.robot, owner_of(joint)
    for kind in taken_in(joint, matrix, fitted.values):
        block = block_of(body, owner, joint.name)
        if block is None:
            raise unwritable(robot, joint.name)
        at = [i for i in range(*block) if re.match(rf"\s*{kind}\s*=\s*\{{", body[i])]
        if len(at) != 1 or "stiffness" not in body[at[0]]:
            raise unwritable(robot, f"{joint.name}.{kind}")
        without = re.sub(r"(?<!_)\bstiffness\s*=\s*[^,}\s]+\s*,?\s*", "", body[at[0]], count=1)
        body[at[0]] = re.sub(r",\s*\}", " }", without)
    names = [name for name in COORDINATES if name in joint.coordinates]
    rows = ", ".join(numbers_text(row) for row in matrix_rows(matrix.entries, names))
    forces = [matrix.preload.get(name, 0.0) for name in names]
    preload = f", preload = {numbers_text(forces)}" if any(forces) else ""
    block = block_of(body, owner, joint.name)
    if block is None:
        raise unwritable(robot, joint.name)
    keys = [parameter_name(owner, joint.name, JOINT_STIFFNESS, key) for key in fitted_entries(joint, fitted.values)]
    said = ", ".join(f"{key.partition('.stiffness.')[2]} {deviation_text(fitted.deviations[key])}" for key in keys)
    line = f"stiffness = {{ matrix = [{rows}]{preload} }}  # over {', '.join(names)}; +- {said}"
    replace_line(body, block, JOINT_STIFFNESS, line, robot)


def _put_offset(fitted: FittedParameters, table: str, name: str, offset: Mapping[str, float], body: list[str]) -> None:
    """Write the offsets of a joint, or of a loop joint, into its entry."""
    block = block_of(body, table, name)
    if block is None:
        raise unwritable(fitted.robot, name)
    values = ", ".join(f"{kind} = {value!r}" for kind, value in offset.items())
    line = f"offset = {{ {values} }}  # {fitted.said(table, name, 'offset')}"
    replace_line(body, block, "offset", line, fitted.robot)


def _put_placement(fitted: FittedParameters, joint: Joint, body: list[str]) -> None:
    """Replace the placement of a joint by one with its first axis tilted."""
    block = block_of(body, JOINTS, joint.name)
    assert block is not None
    degrees = _in_degrees(body, block)
    dh = [i for i in range(*block) if re.match(r"\s*dh\s*=", body[i])]
    for i in reversed(dh):
        del body[i]
    table = _table(fitted.calibrated.joint(joint.name).placement, degrees)
    block = block_of(body, JOINTS, joint.name)
    assert block is not None
    line = f"placement = {table}  # tilt of its axis {fitted.said(JOINTS, joint.name, TILT)}"
    replace_line(body, block, "placement", line, fitted.robot)


def _put_second(fitted: FittedParameters, name: str, body: list[str]) -> None:
    """Replace the placements of a loop joint whose frame on the second link has moved."""
    block = block_of(body, LOOPS, name)
    if block is None:
        raise unwritable(fitted.robot, name)
    loop = next(loop for loop in fitted.calibrated.loops if loop.name == name)
    degrees = _in_degrees(body, block)
    tables = ", ".join(_table(placement_of(matrix_of(placement)), degrees) for placement in loop.placements)
    line = f"placements = [{tables}]  # the second {fitted.said(LOOPS, name, SECOND)}"
    replace_line(body, block, "placements", line, fitted.robot)


def _in_degrees(body: Sequence[str], block: tuple[int, int] | None) -> bool:
    """Return whether the placement of an entry, or its dh, is written in degrees: it is written so again."""
    lines = body[slice(*block)] if block is not None else []
    return any(re.match(r"\s*(dh|placements?)\s*=[^#]*_deg\s*=", line) for line in lines)


def _table(placement: Placement, degrees: bool) -> str:
    """Write a placement as an inline table, its angles in the unit of the file."""
    rpy = placement.rpy or (0.0, 0.0, 0.0)
    key, angles = ("rpy_deg", [math.degrees(angle) for angle in rpy]) if degrees else ("rpy", rpy)
    return f"{{ xyz = {numbers_text(placement.xyz)}, {key} = {numbers_text(angles)} }}"


def block_of(body: Sequence[str], table: str, name: str) -> tuple[int, int] | None:
    """Return lines from the header of an entry of an array of tables to the next header; None where there is none."""
    heads = [i for i, line in enumerate(body) if re.match(r"\s*\[", line)] + [len(body)]
    for first, last in itertools.pairwise(heads):
        if re.match(rf"\s*\[\[\s*{table}\s*\]\]", body[first]):
            inside = (re.match(r"\s*name\s*=\s*[\"']([^\"']*)[\"']", line) for line in body[first:last])
            if any(match is not None and match[1] == name for match in inside):
                return first, last
    return None


def replace_line(body: list[str], block: tuple[int, int], key: str, line: str, robot: Robot) -> None:
    """Put a line in the place of that of a key, or behind the name."""
    at = [i for i in range(*block) if re.match(rf"\s*{key}\s*=", body[i])]
    if at:
        if body[at[0]].count("{") != body[at[0]].split("#")[0].count("}"):
            raise unwritable(robot, key)
        body[at[0]] = line
        return
    name = next(i for i in range(*block) if re.match(r"\s*name\s*=", body[i]))
    body.insert(name + 1, line)


def _numbers(robot: Robot) -> Iterator[tuple[str, Sequence[float | None]]]:
    """Yield numbers of a description that a calibration changes, by the joints' names."""
    for joint in robot.joints:
        yield joint.name, (*joint.offset, *_springs_of(joint), *matrix_of(joint.placement).ravel().tolist())
    for loop in robot.loops:
        places = np.ravel([matrix_of(placement) for placement in loop.placements]).tolist()
        yield loop.name, (*loop.offset, *_springs_of(loop), *places)


def _springs_of(joint: Joint | Loop) -> Iterator[float | None]:
    """Yield the stiffness of tables of a joint, then the entries of its matrix."""
    for kind in COORDINATES:
        yield joint.coordinates[kind].stiffness if kind in joint.coordinates else None
    entries = joint.stiffness.entries if joint.stiffness else {}
    yield from (entries.get(key) for key in ENTRIES)


def write_compared(robots: tuple[Robot, Robot], text: Callable[[Path], str], target: Path, numbers: Numbers) -> Path:
    """Write a description that is compared with the calibrated robot when it is read back, and return the path.

    Args:
        robots: as described, and as calibrated.
        text: folder -> the text of a file there.
        target: of the file.
        numbers: that are compared, by names for messages.

    Raises:
        InputError: the text says something else, or the file cannot be written.
    """
    described, wanted = robots

    def compare(path: Path) -> None:
        read = load_robot(path, inertia="warn")
        for (name, ours), (other, theirs) in zip(numbers(wanted), numbers(read), strict=False):
            pairs = [(a or 0.0, b or 0.0) for a, b in zip(ours, theirs, strict=False)]
            far = any(abs(a - b) > _CLOSE * max(1.0, abs(a)) for a, b in pairs)
            if far or name != other or len(ours) != len(theirs):
                raise unwritable(described, name)

    written = text(target.parent).encode("utf-8")
    return write_atomically(target, lambda stream: stream.write(written), read=compare)


def deviation_text(value: float) -> str:
    """Return a standard deviation as comments have it."""
    return "unknown" if np.isnan(value) else f"{value:.2g}"


def numbers_text(values: Sequence[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def unwritable(robot: Robot, what: str) -> InputError:
    return InputError(
        f"{robot.name}: {what} is not written in {show_path(robot.source)} so that it can be changed; allowed: entries"
        " [[joints]] and [[frames]] with each table on one line"
    )
