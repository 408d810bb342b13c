"""Shapes that a URDF gives its links to be seen: meshes, boxes, cylinders, balls; read with trimesh."""

from __future__ import annotations

import io
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DescriptionError
from ..files import read_regular
from ..forms.toml_text import read_text
from ..names import show, unique_identifiers
from ..robot.geometry import rotation_from_rpy
from ..robot.value import Robot

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

ENDINGS = (".stl", ".dae", ".obj", ".ply")  # of meshes; archives, which grow when they are unpacked, are none
_MOST_MESH = 1 << 25  # bytes: 600,000 triangles of a binary STL
_MOST_TOGETHER = 1 << 27  # bytes of all meshes of a robot, each as often as it is shown
_MOST_NODES = 10_000  # of a scene in a .dae, each as often as it is shown
_DEEPEST = 50  # nodes in nodes of it
_MOST_HEADER = 1 << 14  # bytes
_ELEMENT = re.compile(rb"^element[ \t]+\w{1,99}[ \t]+([0-9]{1,18})[ \t\r]{0,9}$", re.MULTILINE)


@dataclass(frozen=True)
class Shape:
    """vertices (V, 3), m, in the link's frame; faces (F, 3)."""

    link: str
    vertices: Array
    faces: NDArray[np.int32]


def urdf_shapes(robot: Robot) -> tuple[list[Shape], list[str]]:
    """The shapes of the links, and lines about what could not be read; nothing where the robot is of no URDF file."""
    from ..description.xml_text import parse_xml

    path, notes = Path(robot.source), list[str]()
    if path.suffix != ".urdf":
        return [], notes
    try:
        root = parse_xml(read_text(path, str(path)), str(path)).root
    except DescriptionError:
        return [], [f"{path} cannot be read any more: links are drawn as capsules"]
    shapes, room = [], _Room()
    elements = [element for element in root.iterfind("link") if element.get("name")]
    names = unique_identifiers([element.get("name", "") for element in elements])
    for element in elements:
        link = names[element.get("name", "")]
        for visual in element.iterfind("visual"):
            try:
                vertices, faces = _geometry(visual, path, room)
            except Exception as error:  # whatever a reader of meshes raises: the link is a capsule then
                notes.append(f"shape of {link}: {ascii(str(error))[1:-1][:300]}")
                continue
            pose = _origin(visual)
            shapes.append(Shape(link, vertices @ pose[:3, :3].T + pose[:3, 3], faces))
    return shapes, notes


def _origin(visual: Element) -> Array:
    pose, origin = np.eye(4), visual.find("origin")
    if origin is not None:
        x, y, z = _numbers(origin.get("rpy", "0 0 0"), 3)
        pose[:3, :3], pose[:3, 3] = rotation_from_rpy((x, y, z)), _numbers(origin.get("xyz", "0 0 0"), 3)
    return pose


def _numbers(text: str, count: int) -> list[float]:
    values = [float(word) for word in text.split()]
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"got {show(text)}; allowed: {count} numbers")
    return values


@dataclass
class _Room:
    """Bytes of meshes that may still be read for a robot."""

    left: int = _MOST_TOGETHER

    def take(self, size: int) -> None:
        """Count a mesh; ValueError where it is too much."""
        if size > self.left:
            raise ValueError(f"the meshes of the robot have more than {_MOST_TOGETHER} bytes together; allowed: less")
        self.left -= size


def _geometry(visual: Element, urdf: Path, room: _Room) -> tuple[Array, NDArray[np.int32]]:
    import trimesh

    mesh: Any
    geometry = next(iter(visual.iterfind("geometry/*")), None)
    if geometry is None:
        raise ValueError("there is no geometry")
    scale = np.ones(3)
    if geometry.tag == "mesh":
        scale = np.array(_numbers(geometry.get("scale", "1 1 1"), 3))
        place = mesh_path(geometry.get("filename", ""), urdf)
        ending = place.suffix.lower()
        if ending not in ENDINGS:
            raise ValueError(f"got {show(place.name)}; allowed: meshes that end in {', '.join(ENDINGS)}")
        data = read_regular(place, _MOST_MESH)
        room.take(len(data))
        check_mesh(data, ending)
        content = io.BytesIO(data)  # alone: no file that it names is opened behind it
        mesh = trimesh.load(content, file_type=ending.lstrip("."), force="mesh")
    elif geometry.tag == "box":
        mesh = trimesh.creation.box(_numbers(geometry.get("size", ""), 3))
    elif geometry.tag == "sphere":
        mesh = trimesh.creation.icosphere(radius=_numbers(geometry.get("radius", ""), 1)[0])
    elif geometry.tag == "cylinder":
        radius, length = (_numbers(geometry.get(key, ""), 1)[0] for key in ("radius", "length"))
        mesh = trimesh.creation.cylinder(radius, length)
    else:
        raise ValueError(f"{show(geometry.tag)} is unknown")
    return np.asarray(mesh.vertices, dtype=np.float64) * scale, np.asarray(mesh.faces, dtype=np.int32)


def check_mesh(data: bytes, ending: str) -> None:
    """Refuse a mesh that would be larger in memory than its file, before it is unpacked.

    Args:
        data: all bytes of the file.
        ending: of ENDINGS.

    Raises:
        ValueError: it says of itself that it holds more than it has bytes for, or shows parts of it without end.
        DescriptionError: a .dae is no XML, or has entities.
    """
    if ending == ".stl" and not (data[:512].lstrip().startswith(b"solid") or b"facet" in data[:1024]):
        count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else 0
        if len(data) < 84 or count * 50 > len(data) - 84:
            raise ValueError(
                f"a .stl of {len(data)} bytes says that it has {count} triangles; allowed: one that is whole"
            )
    elif ending == ".ply":
        end = data.find(b"end_header", 0, _MOST_HEADER)
        counts = [int(number) for number in _ELEMENT.findall(data[: max(end, 0)])]
        if end < 0 or sum(counts) > len(data) - end:
            text = f"a .ply of {len(data)} bytes says that it has {sum(counts)} elements"
            raise ValueError(f"{text}; allowed: one that is whole, with a header")
    elif ending == ".dae":
        _check_scene(data)


def _check_scene(data: bytes) -> None:
    """Refuse a .dae whose nodes show each other without end, or too often."""
    from ..description.xml_text import parse_xml

    root = parse_xml(data.decode("utf-8-sig", "replace"), ".dae", "COLLADA").root
    nodes: dict[str, Element] = {}
    for element in root.iter():
        element.tag = element.tag.rpartition(":")[2]
        if element.tag == "node" and "id" in element.attrib:
            nodes.setdefault(element.attrib["id"], element)
    counted: dict[Element, int] = {}
    open_nodes: set[Element] = set()

    def count(node: Element) -> int:
        if node in open_nodes or len(open_nodes) > _DEEPEST:
            raise ValueError("the nodes of a .dae show themselves, or each other too deeply; allowed: a tree")
        if node not in counted:
            open_nodes.add(node)
            total = 1
            for inner in node:
                shown = nodes.get(inner.get("url", "").lstrip("#")) if inner.tag == "instance_node" else None
                shown = inner if inner.tag == "node" else shown
                total += 0 if shown is None else count(shown)
            open_nodes.discard(node)
            counted[node] = total
        return counted[node]

    total = sum(count(node) for scene in root.iter("visual_scene") for node in scene.iterfind("node"))
    if total > _MOST_NODES:
        raise ValueError(f"a .dae shows {total} nodes; allowed: up to {_MOST_NODES}")


def mesh_path(name: str, urdf: Path) -> Path:
    """The file of a mesh: beside the URDF, or of ``package://``, looked for in ROS_PACKAGE_PATH and above the URDF.

    Raises:
        ValueError: there is none.
    """
    for place in _places(name, urdf.resolve()):
        if place.is_file():
            return place
    raise ValueError(f"there is no mesh {show(name)}; packages are looked for above the URDF and in ROS_PACKAGE_PATH")


def _places(name: str, urdf: Path) -> Iterator[Path]:
    if not name.startswith("package://"):
        yield urdf.parent / name.removeprefix("file://")
        return
    inner = name.removeprefix("package://")
    package, _, rest = inner.partition("/")
    roots = [Path(text) for text in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if text]
    for folder in (*roots, *urdf.parents):
        yield folder / inner
        if folder.name == package:
            yield folder / rest
