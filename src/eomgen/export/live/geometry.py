"""Shapes of a robot, as plain values: the shapes that other views show, too."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arrays import Array
from ...pictures.framing import drawn_points, framed, up_of
from ...pictures.scene import SLENDER, BentAxis, bent_axes, extent, slides_along_beams
from ...pictures.shapes import Shape, bare_capsules, urdf_shapes
from ...robot.value import LINEAR, Robot

FIELD_OF_VIEW = np.radians(38.0)
MOST_MESH = 24 << 20  # bytes of all meshes of a page; more would take long to open
DRUM = 1.7  # radius of what stands for a joint, of a capsule's


def geometry_of(robot: Robot, coordinates: Sequence[str], poses: ArrayLike) -> tuple[dict[str, Any], list[str]]:
    """Return shapes, sizes and the first view, as JSON holds them; and lines about what is not drawn.

    Args:
        robot: as it is described.
        coordinates: n names.
        poses: coordinates of poses that the first view is to show, (K, n), m or rad.
    """
    shapes, notes = urdf_shapes(robot)
    if sum(shape.vertices.size * 4 + shape.faces.size * 4 for shape in shapes) > MOST_MESH:
        notes.append(f"meshes take more than {MOST_MESH >> 20} MB: links are drawn as capsules")
        shapes = []
    axes = bent_axes(robot)
    bare = bare_capsules(robot, shapes, axes)
    size, up = extent(robot), up_of(robot)
    places = np.concatenate([drawn_points(robot, coordinates, q, shapes) for q in np.atleast_2d(np.asarray(poses))])
    camera = framed(places, up, float(FIELD_OF_VIEW), 2.0 * SLENDER * size)
    geometry = {
        "base": robot.base,
        "capsules": [
            {"link": c.link, "begin": c.begin.tolist(), "end": c.end.tolist(), "radius": c.radius} for c in bare
        ],
        "meshes": [_mesh(shape) for shape in shapes],
        "bent": [_bent(axis, coordinates) for axis in axes],
        "drums": [] if shapes else _drums(robot, DRUM * SLENDER * size),
        "rods": [] if shapes else _rods(robot, SLENDER * size),
        "springs": [{"links": list(x.links), "points": [list(p) for p in x.origins()]} for x in robot.link_elements],
        "size": size,
        "up": up.tolist(),
        "floor": float((places @ up).min()) - 0.06 * size,
        "camera": {
            "position": camera.position.tolist(),
            "look_at": camera.look_at.tolist(),
            "fov": camera.fov,
            "away": float(np.linalg.norm(camera.position - camera.look_at)),
        },
    }
    return geometry, notes


def tool_place(robot: Robot, tool: str) -> tuple[str, list[float]]:
    """Return the link that a frame or link named ``tool`` is on, and its origin there, m."""
    for frame in robot.frames:
        if frame.name == tool:
            return frame.link, list(frame.placement.xyz)
    return tool, [0.0, 0.0, 0.0]


def _mesh(shape: Shape) -> dict[str, Any]:
    return {
        "link": shape.link,
        "vertices": _packed(shape.vertices.astype("<f4")),
        "faces": _packed(shape.faces.astype("<u4")),
    }


def _bent(axis: BentAxis, coordinates: Sequence[str]) -> dict[str, Any]:
    """Return an axis as the script ``bent`` takes it: rows of Phi and Psi that are zero are null."""
    stations = axis.stations
    return {
        "link": axis.link,
        "modes": [coordinates.index(name) for name in axis.modes],
        "places": _packed(stations.places.astype("<f4")),
        "Phi": [_row(stations.Phi[:, row]) for row in range(6)],
        "Psi": [_row(stations.Psi[:, row]) for row in range(3)],
        "outline": _packed(axis.outline.astype("<f4")),
        "nodes": [{"link": name, "place": list(place)} for name, place in axis.nodes.items()],
    }


def _row(values: Array) -> str | None:
    return _packed(values.astype("<f4")) if values.any() else None


def _packed(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")


def packed(array: ArrayLike) -> str:
    """Return numbers as little-endian double precision in base64."""
    return _packed(np.asarray(array, dtype="<f8"))


def _drums(robot: Robot, radius: float) -> list[dict[str, Any]]:
    """Return joints that move, in their child links: where their axes are, and whether links slide along them."""
    drums = []
    on_beams = slides_along_beams(robot)
    for joint in robot.joints:
        if not joint.principal or joint in on_beams:
            continue
        axis = np.array(joint.axis_turn)[:, 2]
        drums.append(
            {"link": joint.child, "axis": axis.tolist(), "slides": joint.principal in LINEAR, "radius": radius}
        )
    return drums


def _rods(robot: Robot, radius: float) -> list[dict[str, Any]]:
    """Return rods of sliding joints: between the points of both links that are one where nothing is pushed out."""
    on_beams = slides_along_beams(robot)
    return [
        {
            "links": [joint.parent, joint.child],
            "points": [list(joint.placement.xyz), [0.0, 0.0, 0.0]],
            "radius": 0.6 * radius,
        }
        for joint in robot.joints
        if joint.slides and joint not in on_beams
    ]
