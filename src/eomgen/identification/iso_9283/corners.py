"""Corners of commanded paths: by how much attained paths round them off, and how far they overshoot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from .attained import Path, Record
from .formulas import arc, at_planes, between, corner_overshoot, distance_to_path
from .result import CornerFigures

CYCLES = 3  # that the standard asks for
SHARPEST = np.deg2rad(170.0)  # a path that turns by more comes back, and has no outer side
BLUNTEST = np.deg2rad(20.0)  # between neighbouring steps of a command, from which on it is a corner
_STRAIGHT = 0.1  # of a corner's angle, by which the steps before and behind it may turn
_SHARP = np.deg2rad(60.0)  # corners that follow each other: no curve has so few points


@dataclass(frozen=True)
class Corner:
    """A corner of a commanded path.

    point: (3,), m.  before, behind: unit vectors of the path that comes and goes, (3,).  angle: between them, rad.
    first, last: points of the command that it lies between; they are the same where it is one of them.
    """

    point: Array
    before: Array
    behind: Array
    angle: float
    first: int
    last: int


def corner_figures(path: Path, command: Record) -> tuple[CornerFigures, ...]:
    """Return figures of all corners of a path whose command, (m, 3), has no rests: clause 8.5."""
    points = command.position
    corners = corners_of(points)
    if not corners:
        return ()
    length = arc(points)
    ends = [0.0, *(0.5 * (length[x.first] + length[x.last]) for x in corners), float(length[-1])]
    figures = []
    for i, corner in enumerate(corners):
        begin = 0.5 * (ends[i] + ends[i + 1])
        last = i + 2 == len(ends) - 1
        end = ends[i + 2] if last else 0.5 * (ends[i + 1] + ends[i + 2])
        parts = [_piece(points, length, record, begin, end) for record in path.cycles]
        figures.append(
            CornerFigures(
                along=ends[i + 1],
                angle=corner.angle,
                cycles=len(parts),
                rounding=max(distance_to_path(corner.point, piece) for piece in parts),
                overshoot=max(corner_overshoot(piece, corner.point, corner.before, corner.behind) for piece in parts),
            )
        )
    return tuple(figures)


def corners_of(points: Array) -> list[Corner]:
    """Return corners of a path through points, (m, 3): where straight parts meet, at a point or between two of them."""
    steps = np.diff(points, axis=0)
    tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    corners, k = [], 1
    while k < len(tangents):
        corner = _corner(points, tangents, k, k) or (
            _corner(points, tangents, k, k + 1) if k + 1 < len(tangents) else None
        )
        if corner is None:
            k += 1
        else:
            corners.append(corner)
            k = corner.last + 1
    return corners


def _corner(points: Array, tangents: Array, first: int, last: int) -> Corner | None:
    """Return the corner between the steps in front of ``first`` and behind ``last``, points of the path.

    None without one.
    """
    before, behind = tangents[first - 1], tangents[last]
    angle = _angle(before, behind)
    if not BLUNTEST <= angle <= SHARPEST:
        return None
    around = [(k - 1, k) for k in (first - 1, last + 1) if 1 <= k < len(tangents)]
    turns = [_angle(tangents[a], tangents[b]) for a, b in around]
    sharp = first == last and angle >= _SHARP
    if any(turn > _STRAIGHT * angle and not (sharp and turn >= _SHARP) for turn in turns):
        return None
    if first == last:
        return Corner(points[first], before, behind, angle, first, last)
    if min(_angle(before, tangents[first]), _angle(tangents[first], behind)) < _STRAIGHT * angle:
        return None  # one of both points is the corner
    chord = points[last] - points[first]
    cosine = float(before @ behind)
    share = (chord @ before - (chord @ behind) * cosine) / (1.0 - cosine**2)
    back = ((chord @ before) * cosine - chord @ behind) / (1.0 - cosine**2)
    if share < 0.0 or back > 0.0:  # both lines meet in front of the one and behind the other
        return None
    point = 0.5 * (points[first] + share * before + points[last] + back * behind)
    return Corner(point, before, behind, angle, first, last)


def _angle(one: Array, other: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _piece(points: Array, length: Array, record: Record, begin: float, end: float) -> Array:
    """Return the attained path between lengths of the commanded one, (k, 3): as far as it goes through their planes."""
    index = np.interp((begin, end), length, np.arange(len(points)))
    steps = np.diff(points, axis=0)[np.minimum(index.astype(np.intp), len(points) - 2)]
    tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    travelled = arc(record.position)
    near = np.searchsorted(travelled, np.array([begin, end]) / length[-1] * travelled[-1]).clip(0, len(travelled) - 1)
    places = at_planes(between(points, index), tangents, near.astype(np.intp), record.position)
    first = 0 if np.isnan(places[0]) else int(places[0])
    last = len(travelled) - 1 if np.isnan(places[1]) else int(np.ceil(places[1]))
    return record.position[first : max(last, first + 1) + 1]
