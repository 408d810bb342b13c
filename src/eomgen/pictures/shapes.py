"""Shapes that a URDF gives its links to be seen: meshes, boxes, cylinders, balls.

Meshes in .stl are read here; those in .dae, .obj and .ply with trimesh, which comes with the extra "view".
"""

from __future__ import annotations

import io
import os
import re
import struct
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DescriptionError, EomgenError
from ..files import read_regular
from ..forms.toml_text import read_text
from ..identifiers import unique_identifiers
from ..limits import LARGEST
from ..names import show
from ..optional import optional_import
from ..robot.geometry import rotation_from_rpy
from ..robot.value import Robot
from .scene import BentAxis, Capsule, capsule_mesh, capsules

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

ENDINGS = (".stl", ".dae", ".obj", ".ply")  # of meshes; archives, which grow when they are unpacked, are none
_MOST_MESH = 1 << 25  # bytes: 600,000 triangles of a binary STL
_MOST_TOGETHER = 1 << 27  # bytes of all meshes of a robot, each as often as it is shown
_MOST_NODES = 10_000  # of a scene in a .dae, each as often as it is shown
_DEEPEST = 50  # nodes in nodes of it
_MOST_HEADER = 1 << 14  # bytes
_ELEMENT = re.compile(rb"^element[ \t]+\w{1,99}[ \t]+([0-9]{1,18})[ \t\r]{0,9}$", re.MULTILINE)


Mesh = tuple[Array, NDArray[np.int32]]  # vertices (V, 3) and faces (F, 3)
_SIDES = 32  # of a cylinder
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])  # of a binary .stl
_CORNER = re.compile(rb"\bvertex[ \t]+(\S{1,40}[ \t]+\S{1,40}[ \t]+\S{1,40})")


@dataclass(frozen=True)
class Shape:
    """vertices (V, 3), m, in the link's frame; faces (F, 3)."""

    link: str
    vertices: Array
    faces: NDArray[np.int32]


def urdf_shapes(robot: Robot) -> tuple[list[Shape], list[str]]:
    """Return the shapes of the links, and lines about what could not be read; nothing where the robot is of no URDF."""
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
                with np.errstate(over="ignore", invalid="ignore"):  # of places that are refused then
                    vertices, faces = _placed(*_geometry(visual, path, room), _origin(visual))
            except unreadable() as error:  # the link is a capsule then
                notes.append(f"shape of {link}: {ascii(str(error))[1:-1][:300]}")
                continue
            shapes.append(Shape(link, vertices, faces))
    return shapes, notes


def unreadable() -> tuple[type[Exception], ...]:
    """Return what readers of meshes raise, ours and those of trimesh, of which COLLADA's has errors of its own."""
    collada: Any = sys.modules.get("collada.common")
    ours = (EomgenError, OSError, ValueError, struct.error)
    theirs = (ArithmeticError, AttributeError, ImportError, LookupError, RuntimeError, SyntaxError, TypeError)
    return (*ours, *theirs) if collada is None else (*ours, *theirs, collada.DaeError)


def _placed(vertices: Array, faces: NDArray[np.int32], pose: Array) -> Mesh:
    """Return a mesh in the link's frame; ValueError where there is nothing to draw, or vertices are no places."""
    placed = vertices @ pose[:3, :3].T + pose[:3, 3]
    if not len(vertices) or not len(faces):
        raise ValueError("it has no vertices or no faces; allowed: at least a triangle")
    if not (np.abs(placed) <= LARGEST).all():
        raise ValueError(f"it has vertices that are farther than {LARGEST:g} m; allowed: nearer ones")
    return placed, faces


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


def _geometry(visual: Element, urdf: Path, room: _Room) -> Mesh:
    """Return vertices (V, 3), m, in the axes of the visual, and faces (F, 3)."""
    geometry = next(iter(visual.iterfind("geometry/*")), None)
    if geometry is None:
        raise ValueError("there is no geometry")
    if geometry.tag == "mesh":
        scale = np.array(_numbers(geometry.get("scale", "1 1 1"), 3))
        place = mesh_path(geometry.get("filename", ""), urdf)
        ending = place.suffix.lower()
        if ending not in ENDINGS:
            raise ValueError(f"got {show(place.name)}; allowed: meshes that end in {', '.join(ENDINGS)}")
        data = read_regular(place, _MOST_MESH)
        room.take(len(data))
        check_mesh(data, ending)
        vertices, faces = read_stl(data) if ending == ".stl" else _loaded(data, ending)
        return vertices * scale, faces
    if geometry.tag == "box":
        return _box(_numbers(geometry.get("size", ""), 3))
    if geometry.tag == "sphere":
        return capsule_mesh(np.zeros(3), np.zeros(3), _numbers(geometry.get("radius", ""), 1)[0])
    if geometry.tag == "cylinder":
        radius, length = (_numbers(geometry.get(key, ""), 1)[0] for key in ("radius", "length"))
        return _cylinder(radius, length)
    raise ValueError(f"{show(geometry.tag)} is unknown")


def _loaded(data: bytes, ending: str) -> Mesh:
    """Return the mesh of a .dae, .obj or .ply."""
    with optional_import("trimesh", f"meshes that end in {ending} need", "links without are capsules"):
        import trimesh
    content = io.BytesIO(data)  # alone: no file that it names is opened behind it
    mesh: Any = trimesh.load(content, file_type=ending.lstrip("."), force="mesh")
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int32)


def read_stl(data: bytes) -> Mesh:
    """Return vertices (V, 3), in the file's unit, without those that are the same, and triangles (F, 3), of an STL.

    Args:
        data: all bytes of the file, binary or text; ``check_mesh`` has passed it.

    Raises:
        ValueError: it holds no triangles, or corners that are no numbers.
    """
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count or not data.lstrip().startswith(b"solid"):
        records = np.frombuffer(data, dtype=_FACET, count=max(count, 0), offset=min(84, len(data)))
        corners = records["corners"].reshape(-1, 3).astype(np.float64)
    else:
        words = b" ".join(_CORNER.findall(data)).split()
        corners = np.array(words, dtype=np.float64).reshape(-1, 3)
    if not len(corners) or len(corners) % 3 or not np.isfinite(corners).all():
        raise ValueError("a .stl without triangles; allowed: three corners for each facet, finite numbers")
    vertices, places = np.unique(corners, axis=0, return_inverse=True)
    return vertices, places.reshape(-1, 3).astype(np.int32)


def _box(size: Sequence[float]) -> Mesh:
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * size
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)


def _cylinder(radius: float, length: float) -> Mesh:
    """Return a cylinder about z, its middle at the origin."""
    k, ahead = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES
    angle = 2.0 * np.pi * k / _SIDES
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [np.column_stack([ring, np.full(_SIDES, z)]) for z in (-0.5 * length, 0.5 * length)]
    vertices = np.concatenate([*ends, [[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]]])
    bottom, top = np.full(_SIDES, 2 * _SIDES), np.full(_SIDES, 2 * _SIDES + 1)
    faces = [(k, ahead, _SIDES + ahead), (k, _SIDES + ahead, _SIDES + k), (bottom, ahead, k)]
    faces.append((top, _SIDES + k, _SIDES + ahead))
    return vertices, np.concatenate([np.stack(face, axis=1) for face in faces]).astype(np.int32)


def meshes_of(robot: Robot, shapes: Sequence[Shape]) -> list[tuple[str, Array, NDArray[np.int32]]]:
    """Return link, vertices (V, 3), m, in the link's frame, and faces (F, 3), of all that is drawn of rigid links.

    These are the shapes, and capsules of links without any; beside shapes of links with a mass alone, since a URDF has
    empty links, too.  What bends is drawn by ``bent_axes``.
    """
    bodies = [(shape.link, shape.vertices, shape.faces) for shape in shapes]
    return bodies + [(c.link, *capsule_mesh(c.begin, c.end, c.radius)) for c in bare_capsules(robot, shapes)]


def bare_capsules(robot: Robot, shapes: Sequence[Shape], axes: Sequence[BentAxis] | None = None) -> list[Capsule]:
    """Return the capsules of links without shapes; where there are shapes, of links with a mass alone.

    ``axes``: as of ``capsules``.
    """
    shaped = {shape.link for shape in shapes}
    heavy = {link.name for link in robot.links if link.mass > 0.0}
    return [c for c in capsules(robot, axes) if c.link not in shaped and (not shaped or c.link in heavy)]


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
        if os.path.isfile(place):
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
