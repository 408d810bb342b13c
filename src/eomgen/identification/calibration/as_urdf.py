"""A calibrated robot as a URDF: the calibrated origins of its file, or a plain one of a robot in TOML."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...arrays import Array
from ...description.load import load_robot
from ...description.urdf import IN_PLANE, TYPES
from ...description.xml_text import parse_xml
from ...errors import InputError
from ...files import check_ending, write_atomically
from ...forms.toml_text import read_text
from ...identifiers import unique_identifiers
from ...kernel.inverse_kinematics.rotations import rpy_of
from ...robot.bounds import Limits
from ...robot.joint_types import JOINT_TYPES, OWN_COORDINATES
from ...robot.value import Coordinate, Joint, Robot
from ..geometry.rotations import pose_from, pose_of
from ..geometry.stations import chain_of, located, matrix_of
from .as_toml import HEAD, FittedParameters
from .calibrated import OF_LINK, calibrated_robot, placements

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


_FAR = 1e3  # m or rad, of the end of a range that the description leaves open
_NONE = 1e6  # effort and velocity, which other readers need, where the description has none
_CLOSE = 1e-9  # m or rad, by which frames of what was written may be off when it is read again


def write_urdf(fitted: FittedParameters, target: Path) -> Path:
    """Write the URDF, which is compared with the calibrated robot when it is read back, and return the path.

    Raises:
        InputError: see ``CalibrationResult.to_urdf``.
    """
    check_ending(target, ".urdf")
    from xml.etree import ElementTree

    source = Path(fitted.robot.source)
    is_urdf = source.suffix in (".urdf", ".xml")
    root = parse_xml(read_text(source, str(source)), str(source)).root if is_urdf else _plain(fitted.robot)
    robot = calibrated_robot(fitted.robot, fitted.chain, fitted.links, fitted.values)
    elements = [element for element in root.findall("joint") if element.get("name")]
    names = unique_identifiers([str(element.get("name")) for element in elements])
    by_name = {names[str(element.get("name"))]: element for element in elements}
    for joint in robot.joints:
        if joint.name in by_name:
            _set_origin(by_name[joint.name], joint)
        elif any(joint.offset):
            raise InputError(f"{robot.name}: {joint.name} has offsets and is no joint of the URDF; allowed: its joints")
    _add_frames(root, fitted, robot)
    ElementTree.indent(root)
    comment = "".join(f"<!-- {line.removeprefix('# ')} -->\n" for line in HEAD[:1]) + (
        "<!-- Origins (and axes of prismatic joints) hold the offsets; m, rad. -->\n"
    )
    text = f'<?xml version="1.0"?>\n{comment}{ElementTree.tostring(root, encoding="unicode")}\n'
    compare = partial(_compare, robot=robot, fitted=fitted)
    return write_atomically(target, lambda stream: stream.write(text.encode("utf-8")), read=compare)


def _compare(path: Path, robot: Robot, fitted: FittedParameters) -> None:
    """Raise InputError where a reader of the file finds another robot than the calibrated one."""
    read = load_robot(path, inertia="warn")
    known = {link.name for link in read.links}
    frames = {new: (link, pose) for new, link, pose in _placed(fitted)}
    frames |= {link.name: (link.name, np.eye(4)) for link in robot.links if link.name in known}
    wanted, there = _poses_of(robot, frames), _poses_of(read, {name: (name, np.eye(4)) for name in frames})
    off = {name: float(np.abs(there[name] - pose).max()) for name, pose in wanted.items()}
    far = [name for name, value in off.items() if not value < _CLOSE]
    if far:
        raise InputError(
            f"{robot.name}: {far[0]} of the URDF would stand {off[far[0]]:.2g} m (or rad) off the calibrated robot's;"
            " allowed: joints that a URDF can say, or --toml (to_toml)"
        )


def _poses_of(robot: Robot, frames: Mapping[str, tuple[str, Array]]) -> dict[str, Array]:
    """Return rotations and positions of frames, (2, 3, 4): with coordinates at 0, and at numbers that names give."""
    chain = chain_of(robot, frames)
    values = np.zeros((2, len(chain.stations), 6))
    names = sorted(station.name for station in chain.stations if station.joint is not None)
    for k, station in enumerate(chain.stations):
        if station.offset is not None:
            values[:, k] = station.offset
        if station.joint is not None and station.principal is not None:
            values[1, k, station.principal] += 0.3 + 0.1 * np.sin(names.index(station.name))
    at = located(chain, values, np.tile(np.eye(4), (2, 1, 1)))
    return {name: np.concatenate([at.R[k], at.p[k, :, :, np.newaxis]], axis=2) for name, k in chain.tools.items()}


def urdf_of(robot: Robot) -> Element:
    """Return a URDF of a robot's links and joints, as an element of XML.

    Raises:
        InputError: a joint has active coordinates beside a principal one.
    """
    root = _plain(robot)
    for element, joint in zip(root.findall("joint"), robot.joints, strict=True):
        _set_origin(element, joint)
    return root


def _set_origin(element: Element, joint: Joint) -> None:
    """Write origin and axis of a joint with its offsets in them."""
    turn, offset = pose_of(joint.axis_turn), np.array([value or 0.0 for value in joint.offset])
    pose = matrix_of(joint.placement) @ turn @ pose_from(offset) @ turn.T
    if not offset.any() and element.find("origin") is not None:
        return
    _put(element, "origin", xyz=_numbers(pose[:3, 3]), rpy=_numbers(rpy_of(pose[:3, :3])))
    if joint.principal:
        along = turn[:3, :3] @ np.array([0.0, 0.0, 1.0])
        if joint.slides:  # moves along z before it turns
            along = turn[:3, :3] @ pose_from(offset)[:3, :3].T @ np.array([0.0, 0.0, 1.0])
        _put(element, "axis", xyz=_numbers(along))


def _add_frames(root: Element, fitted: FittedParameters, robot: Robot) -> None:
    """Add a link and a fixed joint for every measured frame with a calibrated placement."""
    taken = {tag: {str(element.get("name")) for element in root.findall(tag)} for tag in ("link", "joint")}
    texts = {name: text for text, name in unique_identifiers(list(taken["link"])).items()}
    for new, link, pose in _placed(fitted):
        if new in taken["link"]:
            raise InputError(f"{robot.name}: the URDF has a link {new!r} already; allowed: another name of the frame")
        names = itertools.chain([f"{new}_joint"], (f"{new}_joint_{k}" for k in itertools.count(2)))
        joint_name = next(name for name in names if name not in taken["joint"])
        taken["joint"].add(joint_name)
        _add(root, "link", name=new)
        joint = _add(root, "joint", name=joint_name, type="fixed")
        _add(joint, "parent", link=texts.get(link, link))
        _add(joint, "child", link=new)
        _add(joint, "origin", xyz=_numbers(pose[:3, 3]), rpy=_numbers(rpy_of(pose[:3, :3])))


def _placed(fitted: FittedParameters) -> Iterator[tuple[str, str, Array]]:
    """Yield the name in the URDF, the link and the pose there, (4, 4), of every frame with a calibrated placement."""
    links = {fitted.robot.base, *(link.name for link in fitted.robot.links)}
    for name, link, pose in placements(fitted.links, fitted.values):
        yield name + OF_LINK if name in links else name, link, pose


def _is_planar(joint: Joint) -> bool:
    """Return whether a joint is a planar one of a URDF: without forces in its plane, and offsets that turn its axes."""
    is_turned = any(joint.offset[3:])
    in_plane = [joint.coordinates.get(key) == Coordinate() for key in IN_PLANE[:2]]
    return joint.type == TYPES["planar"] and tuple(joint.coordinates) == IN_PLANE and all(in_plane) and not is_turned


def _plain(robot: Robot) -> Element:
    """Return a URDF of a robot's links and joints, without origins."""
    from xml.etree.ElementTree import Element

    root = Element("robot", {"name": robot.name})
    _add(root, "link", name=robot.base)
    for link in robot.links:
        element = _add(root, "link", name=link.name)
        if link.mass > 0.0:
            inertial = _add(element, "inertial")
            _add(inertial, "origin", xyz=_numbers(np.array(link.com)))
            _add(inertial, "mass", value=repr(link.mass))
            moments = dict(zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), map(repr, link.inertia), strict=True))
            _add(inertial, "inertia", **moments)
    for joint in robot.joints:
        kind, own = joint.principal, JOINT_TYPES[joint.type]
        further = [name for name in joint.coordinates if name not in OWN_COORDINATES[joint.type]]
        words = own.urdf
        if not words:
            known = ", ".join(word for kind in JOINT_TYPES.values() for word in kind.urdf)
            raise InputError(f"{robot.name}: {joint.name} is a {joint.type}; allowed in a URDF: {known}")
        if _is_planar(joint):
            further, kind, words = [], "", ("planar",)
        if further:
            raise InputError(
                f"{robot.name}: {joint.name}.{further[0]} is active; allowed in a URDF: principal coordinates alone"
            )
        limits = joint.limits_of(kind) if kind else Limits()
        bounded = any(map(math.isfinite, limits.range))
        element = _add(root, "joint", name=joint.name, type=words[0 if bounded else -1])
        _add(element, "parent", link=joint.parent)
        _add(element, "child", link=joint.child)
        if kind and (limits or joint.slides):
            low, high = limits.range
            drive = {"effort": repr(limits.effort or _NONE), "velocity": repr(limits.velocity or _NONE)}
            if bounded or joint.slides:
                drive |= {"lower": repr(max(low, -_FAR)), "upper": repr(min(high, _FAR))}
            _add(element, "limit", **drive)
    return root


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    from xml.etree.ElementTree import SubElement

    return SubElement(parent, tag, attributes)


def _put(parent: Element, tag: str, **attributes: str) -> None:
    """Set attributes of the child of that tag, which is added where there is none."""
    child = parent.find(tag)
    (_add(parent, tag) if child is None else child).attrib.update(attributes)


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
