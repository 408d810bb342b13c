"""A calibrated robot as TOML: the description's own text with what was found in its places, or beside an URDF."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...description.builtin import BUILTIN, builtin_robots
from ...description.load import robot_from_toml
from ...errors import DescriptionError, InputError
from ...files import check_ending, write_atomically
from ...forms.toml_text import read_text
from ...names import parameter_name, show_path
from ...robot.coordinates import UNITS
from ...robot.value import COORDINATES, Joint, Robot
from ..geometry.error_model import BASE, FRAMES, JOINTS, LOOPS, SECOND, TILT
from ..geometry.stations import Chain, matrix_of
from .calibrated import OF_LINK, calibrated_robot, offset_of, placement_of, placements, second_of, stiffness_of, tilt_of

_CLOSE = 1e-12  # by how much what was written may be off when it is read again
HEAD = (
    "# Calibrated.  Offsets (m, rad) are added to the joint's six coordinates before they move anything, in its own",
    "# axes, with the sign of the coordinate: a positive offset.gamma turns the child as a positive gamma does.",
    "# Behind +- are standard deviations; a merged number is what the least change from the description gives it.",
)


@dataclass(frozen=True)
class Found:
    """Things to write: the robot as described, its stations, links of measured frames, and by name values,
    standard deviations and units."""

    robot: Robot
    chain: Chain
    links: Mapping[str, str]
    values: Mapping[str, float]
    deviations: Mapping[str, float]
    units: Mapping[str, str]

    @property
    def calibrated(self) -> Robot:
        """The robot with all of it."""
        return calibrated_robot(self.robot, self.chain, self.links, self.values)


def write_toml(found: Found, target: Path) -> Path:
    """Write the description with what was found, and return the path.

    Raises:
        InputError: see ``CalibrationResult.to_toml``.
    """
    check_ending(target, ".toml")
    text = toml_text(found, target.parent)
    _compare(found, text, target)
    return write_atomically(target, lambda stream: stream.write(text.encode("utf-8")))


def toml_text(found: Found, folder: Path) -> str:
    """The text for a file in that folder."""
    robot, source = found.robot, Path(found.robot.source)
    if not robot.source:
        raise InputError(f"{robot.name}: has no description to write into; allowed: a robot that was read from a file")
    lines = [*HEAD, *_comments(found)]
    if source.suffix in (".urdf", ".xml"):
        body = [f'name = "{robot.name}"', f'urdf = "{relative_path(source, folder)}"', ""]
    else:
        body = own_text(robot, source, folder)
    for joint in robot.joints:
        _put_joint(found, joint, body, robot)
    for loop in robot.loops:
        offset = offset_of(loop, found.values)
        if offset:
            _put_offset(found, LOOPS, loop.name, offset, body)
        if second_of(loop, found.values) is not None:
            _put_second(found, loop.name, body)
    own = {robot.base, *(link.name for link in robot.links)}
    for name, link, pose in placements(found.links, found.values):
        placed = placement_of(pose)
        rpy = placed.rpy or (0.0, 0.0, 0.0)
        text = f"placement = {{ xyz = {numbers_text(placed.xyz)}, rpy = {numbers_text(rpy)} }}"
        keys = [parameter_name(FRAMES, name, kind) for kind in UNITS if kind != "motor"]
        comment = "# +- " + ", ".join(deviation_text(found.deviations[key]) for key in keys)
        new = name + OF_LINK if name in own else name
        block = block_of(body, "frames", new)
        if block is None:
            body += ["", "[[frames]]", f'name = "{new}"', f'link = "{link}"', f"{text}  {comment}"]
        else:
            replace_line(body, block, "placement", f"{text}  {comment}", robot)
    first = 1 if body and body[0].startswith("#:schema") else 0
    return "\n".join([*body[:first], *lines, *body[first:]]) + "\n"


def own_text(robot: Robot, source: Path, folder: Path) -> list[str]:
    """Lines of the robot's own file; names of files in them lead to the same files from the new folder."""
    if str(source) in builtin_robots():
        return read_text(BUILTIN / f"{source}.toml", str(source)).splitlines()
    if source.suffix != ".toml":
        raise InputError(f"{robot.name}: was read from {show_path(str(source))}; allowed for TOML: .toml or .urdf")

    def moved(match: re.Match[str]) -> str:
        return f'{match[1]}"{relative_path(source.parent / match[2], folder)}"'

    text = read_text(source, str(source))
    return [re.sub(r'\b((?:urdf|curve)\s*=\s*)"([^"]+)"', moved, line) for line in text.splitlines()]


def relative_path(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def _comments(found: Found) -> list[str]:
    """Comments for what has no place in a description: where the base stands, terms of drives."""
    lines = []
    for name, value in found.values.items():
        parts = name.split(".")
        is_joint = parts[0] in (JOINTS, LOOPS) and (parts[2] in ("offset", TILT, SECOND) or parts[-1] == "stiffness")
        if is_joint and parts[-1] == "stiffness":
            is_joint = parts[2] in stiffness_of(found.robot.joint(parts[1]), found.values)
        if BASE in parts[:-1] or not (is_joint or parts[0] == FRAMES):
            lines.append(f"# {name} = {value!r} +- {deviation_text(found.deviations[name])} {found.units[name]}")
    return lines


def _put_joint(found: Found, joint: Joint, body: list[str], robot: Robot) -> None:
    offset, stiffness = offset_of(joint, found.values), stiffness_of(joint, found.values)
    tilt = tilt_of(joint, found.values)
    if not offset and not stiffness and tilt is None:
        return
    if block_of(body, JOINTS, joint.name) is None:
        if 'urdf = "' not in "\n".join(body):
            raise unwritable(robot, joint.name)
        body += ["", "[[joints]]", f'name = "{joint.name}"']
    if offset:
        _put_offset(found, JOINTS, joint.name, offset, body)
    if tilt is not None:
        _put_placement(found, joint, body)
    for kind, value in stiffness.items():
        block = block_of(body, JOINTS, joint.name)
        assert block is not None
        at = [i for i in range(*block) if re.match(rf"\s*{kind}\s*=\s*\{{", body[i])]
        if len(at) != 1 or "stiffness" not in body[at[0]]:
            raise unwritable(robot, f"{joint.name}.{kind}")
        key = parameter_name(JOINTS, joint.name, kind, "stiffness")
        changed = re.sub(r"(?<!_)\bstiffness\s*=\s*[^,}\s]+", f"stiffness = {value!r}", body[at[0]], count=1)
        body[at[0]] = f"{changed}  # stiffness +- {deviation_text(found.deviations[key])}"


def _put_offset(found: Found, table: str, name: str, offset: Mapping[str, float], body: list[str]) -> None:
    """The offsets of a joint, or of a loop's, in its entry."""
    block = block_of(body, table, name)
    if block is None:
        raise unwritable(found.robot, name)
    values = ", ".join(f"{kind} = {value!r}" for kind, value in offset.items())
    said = ", ".join(
        f"{deviation_text(found.deviations[parameter_name(table, name, 'offset', kind)])}" for kind in offset
    )
    replace_line(body, block, "offset", f"offset = {{ {values} }}  # +- {said}", found.robot)


def _put_placement(found: Found, joint: Joint, body: list[str]) -> None:
    """The placement of a joint with its first axis tilted, in the place of what is there."""
    block = block_of(body, JOINTS, joint.name)
    assert block is not None
    dh = [i for i in range(*block) if re.match(r"\s*dh\s*=", body[i])]
    for i in reversed(dh):
        del body[i]
    placed = found.calibrated.joint(joint.name).placement
    table = f"{{ xyz = {numbers_text(placed.xyz)}, rpy = {numbers_text(placed.rpy or (0.0, 0.0, 0.0))} }}"
    names = [parameter_name(JOINTS, joint.name, TILT, kind) for kind in COORDINATES[3:]]
    said = ", ".join(deviation_text(found.deviations[name]) for name in names if name in found.deviations)
    block = block_of(body, JOINTS, joint.name)
    assert block is not None
    replace_line(body, block, "placement", f"placement = {table}  # tilt of its axis +- {said}", found.robot)


def _put_second(found: Found, name: str, body: list[str]) -> None:
    """Placements of a cut joint whose frame on the second link has moved."""
    block = block_of(body, LOOPS, name)
    if block is None:
        raise unwritable(found.robot, name)
    loop = next(loop for loop in found.calibrated.loops if loop.name == name)
    tables = []
    for placement in loop.placements:
        placed = placement_of(matrix_of(placement))
        rpy = placed.rpy or (0.0, 0.0, 0.0)
        tables.append(f"{{ xyz = {numbers_text(placed.xyz)}, rpy = {numbers_text(rpy)} }}")
    keys = [parameter_name(LOOPS, name, SECOND, kind) for kind in COORDINATES]
    said = ", ".join(deviation_text(found.deviations[key]) for key in keys if key in found.deviations)
    line = f"placements = [{', '.join(tables)}]  # the second +- {said}"
    replace_line(body, block, "placements", line, found.robot)


def block_of(body: Sequence[str], table: str, name: str) -> tuple[int, int] | None:
    """Lines from the header of an entry of an array of tables to the next header; None where there is none."""
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


def _compare(found: Found, text: str, target: Path) -> None:
    """InputError where the text does not say what it should: it is read again."""
    wanted = found.calibrated
    try:
        read = robot_from_toml(text, source=str(target), folder=target.parent, inertia="warn")
    except DescriptionError as error:
        raise InputError(f"{found.robot.name}: what was found makes no robot: {error}") from None
    for joint, other in zip(wanted.joints, read.joints, strict=False):
        pairs = [(a or 0.0, b or 0.0) for a, b in zip(joint.offset, other.offset, strict=True)]
        pairs += [
            (x.stiffness or 0.0, other.coordinates[kind].stiffness or 0.0) for kind, x in joint.coordinates.items()
        ]
        pairs += [*zip(joint.placement.xyz, other.placement.xyz, strict=True)]
        rows = zip(joint.placement.rotation, other.placement.rotation, strict=True)
        pairs += [pair for a, b in rows for pair in zip(a, b, strict=True)]
        if joint.name != other.name or any(abs(a - b) > _CLOSE * max(1.0, abs(a)) for a, b in pairs):
            raise unwritable(found.robot, joint.name)
    for loop, again in zip(wanted.loops, read.loops, strict=False):
        pairs = [(a or 0.0, b or 0.0) for a, b in zip(loop.offset, again.offset, strict=True)]
        for placed, read_back in zip(loop.placements, again.placements, strict=True):
            pairs += zip(matrix_of(placed).ravel().tolist(), matrix_of(read_back).ravel().tolist(), strict=True)
        if loop.name != again.name or any(abs(a - b) > _CLOSE * max(1.0, abs(a)) for a, b in pairs):
            raise unwritable(found.robot, loop.name)


def deviation_text(value: float) -> str:
    """A standard deviation as comments have it."""
    return "unknown" if np.isnan(value) else f"{value:.2g}"


def numbers_text(values: Sequence[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def unwritable(robot: Robot, what: str) -> InputError:
    return InputError(
        f"{robot.name}: {what} is not written in {show_path(robot.source)} so that it can be changed; allowed: entries"
        " [[joints]] and [[frames]] with each table on one line"
    )
