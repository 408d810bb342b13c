"""Coordinate systems of Nastran bulk data: node positions and displacement directions in the basic system.

CORD2R, CORD2C and CORD2S entries contain three points in a reference system: the origin, a point on the z axis, and a
point in the x-z half-plane.  CORD1R, CORD1C and CORD1S refer to three nodes, and an entry may define two systems.
Coordinates are x, y, z (R), r, theta, z (C) or r, theta, phi (S), with angles in degrees.  Directions of a cylindrical
or spherical system are those at the node; on the z axis those of the rectangular system of the same points.  Source:
MSC Nastran Quick Reference Guide, CORD1C to CORD2S, GRID and GRDSET.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...limits import MOST_SYSTEMS
from .bulk_data import Card, three_numbers, whole
from .text import refusal

CARDS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
GIVEN = f"a system of a {', '.join(CARDS[:-1])} or {CARDS[-1]} entry in this file"
_ON_AXIS = 1e-9  # of a node's distance from the origin
_STRAIGHT = 1e-9  # sine of the angle between the points that define a system

Point = tuple[int, Array]  # a system's number, and coordinates in it


@dataclass(frozen=True)
class System:
    """A coordinate system: its kind, R, C or S, its origin, (3,), and its rectangular axes, columns, (3, 3)."""

    kind: str
    origin: Array
    axes: Array

    def places(self, coordinates: Array) -> Array:
        """Return positions in the basic system, shape (k, 3)."""
        first, second, third = coordinates.T
        if self.kind != "R":
            polar, angle = (second, third) if self.kind == "S" else (90.0, second)
            radius = first * np.sin(np.radians(polar))
            height = first * np.cos(np.radians(second)) if self.kind == "S" else third
            first, second, third = radius * np.cos(np.radians(angle)), radius * np.sin(np.radians(angle)), height
        return np.asarray(np.column_stack([first, second, third]) @ self.axes.T + self.origin)

    def directions(self, places: Array) -> Array:
        """Return the displacement directions at positions in the basic system, as columns, shape (k, 3, 3)."""
        local = (places - self.origin) @ self.axes
        turn = np.tile(np.eye(3), (len(places), 1, 1))
        if self.kind != "R":
            radius = np.hypot(local[:, 0], local[:, 1])
            off = radius > _ON_AXIS * np.linalg.norm(local, axis=1)
            c, s = (local[off, k] / radius[off] for k in (0, 1))
            outward, around = np.stack([c, s, 0.0 * c], axis=1), np.stack([-s, c, 0.0 * c], axis=1)
            up = np.tile([0.0, 0.0, 1.0], (len(c), 1))
            if self.kind == "S":
                polar = np.arctan2(radius[off], local[off, 2])[:, np.newaxis]
                along, down = np.sin(polar), np.cos(polar)
                turn[off] = np.stack([along * outward + down * up, down * outward - along * up, around], axis=2)
            else:
                turn[off] = np.stack([outward, around, up], axis=2)
        return np.asarray(self.axes @ turn)


BASIC = System("R", np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class Definition:
    """Definition of a system: its kind (R, C or S) and its points, or the nodes at these points."""

    line: int
    kind: str
    points: tuple[Point, ...]
    nodes: tuple[int, ...]


def take(path: Path, card: Card, definitions: dict[int, Definition]) -> None:
    """Add the one or two systems of an entry to the definitions."""
    kind = card.name[-1]
    if card.name.startswith("CORD2"):
        fields = card.padded(11)
        reference = whole(path, card, fields[1], 0)
        given = tuple((reference, np.array(three_numbers(path, card, fields[k : k + 3]))) for k in (2, 5, 8))
        found = [(fields[0], Definition(card.line, kind, given, ()))]
    else:
        fields, found = card.padded(8), []
        for start in (0, 4) if any(fields[4:]) else (0,):
            nodes = tuple(whole(path, card, field) for field in fields[start + 1 : start + 4])
            found.append((fields[start], Definition(card.line, kind, (), nodes)))
    for text, definition in found:
        number = whole(path, card, text)
        if number == 0 or number in definitions or len(definitions) == MOST_SYSTEMS:
            raise refusal(path, card.line, f"system {number}", f"numbers from 1 on, once each, {MOST_SYSTEMS} systems")
        definitions[number] = definition


def resolved(path: Path, definitions: Mapping[int, Definition], nodes: Mapping[int, Point]) -> dict[int, System]:
    """Return the systems by their numbers, with the basic one as 0.

    Args:
        path: of the file, for messages.
        definitions: of systems by their numbers.
        nodes: at which systems are defined, by their numbers.

    Raises:
        InputError: a system or a node that defines one is missing, one refers to itself, or its points are in a line.
    """
    points: dict[int, tuple[Point, ...]] = {}
    for number, definition in definitions.items():
        missing = [node for node in definition.nodes if node not in nodes]
        if missing:
            raise refusal(path, definition.line, f"node {missing[0]}", "nodes of GRID entries in this file")
        points[number] = definition.points or tuple(nodes[node] for node in definition.nodes)
        unknown = [system for system, _ in points[number] if system and system not in definitions]
        if unknown:
            raise refusal(path, definition.line, f"system {unknown[0]}", f"0, or {GIVEN}")
    systems = {0: BASIC}
    try:
        before = {number: {system for system, _ in mine} for number, mine in points.items()}
        order = list(TopologicalSorter(before).static_order())
    except CycleError as error:
        number = error.args[1][0]
        raise refusal(
            path, definitions[number].line, f"system {number}, which refers to itself", "systems by others"
        ) from None
    for number in order:
        if number:
            places = [systems[system].places(coordinates[np.newaxis])[0] for system, coordinates in points[number]]
            systems[number] = _system(path, number, definitions[number], places)
    return systems


def _system(path: Path, number: int, definition: Definition, places: list[Array]) -> System:
    """Return a system by its origin, a point on its z axis, and one in the half-plane of x and z."""
    up, beside = places[1] - places[0], places[2] - places[0]
    normal = np.cross(up, beside)
    size = float(np.linalg.norm(up) * np.linalg.norm(beside))
    if not (np.isfinite(size) and np.linalg.norm(normal) > _STRAIGHT * size):
        raise refusal(path, definition.line, f"system {number}, its points in a line", "three points of a plane")
    z, y = up / np.linalg.norm(up), normal / np.linalg.norm(normal)
    return System(definition.kind, places[0], np.column_stack([np.cross(y, z), y, z]))
