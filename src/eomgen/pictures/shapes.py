"""Shapes that an URDF gives its links to be seen: meshes, boxes, cylinders, balls; read with trimesh."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DescriptionError
from ..files import read_regular
from ..forms.toml_text import read_text
from ..names import show, unique_identifiers
from ..robot.geometry import rotation_from_rpy
from ..robot.value import Robot

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

Array = NDArray[np.float64]

_MOST_MESH = 1 << 25  # bytes: 600,000 triangles of a binary STL


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
    shapes = []
    elements = [element for element in root.iterfind("link") if element.get("name")]
    names = unique_identifiers([element.get("name", "") for element in elements])
    for element in elements:
        link = names[element.get("name", "")]
        for visual in element.iterfind("visual"):
            try:
                vertices, faces = _geometry(visual, path)
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
    values = [float(part) for part in text.split()]
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"got {show(text)}; allowed: {count} numbers")
    return values


def _geometry(visual: Element, urdf: Path) -> tuple[Array, NDArray[np.int32]]:
    import trimesh

    mesh: Any
    found = next(iter(visual.iterfind("geometry/*")), None)
    if found is None:
        raise ValueError("there is no geometry")
    scale = np.ones(3)
    if found.tag == "mesh":
        scale = np.array(_numbers(found.get("scale", "1 1 1"), 3))
        place = mesh_path(found.get("filename", ""), urdf)
        content = io.BytesIO(read_regular(place, _MOST_MESH))  # alone: no file that it names is opened behind it
        mesh = trimesh.load(content, file_type=place.suffix.lower().lstrip("."), force="mesh")
    elif found.tag == "box":
        mesh = trimesh.creation.box(_numbers(found.get("size", ""), 3))
    elif found.tag == "sphere":
        mesh = trimesh.creation.icosphere(radius=_numbers(found.get("radius", ""), 1)[0])
    elif found.tag == "cylinder":
        radius, length = (_numbers(found.get(key, ""), 1)[0] for key in ("radius", "length"))
        mesh = trimesh.creation.cylinder(radius, length)
    else:
        raise ValueError(f"{show(found.tag)} is unknown")
    return np.asarray(mesh.vertices, dtype=np.float64) * scale, np.asarray(mesh.faces, dtype=np.int32)


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
