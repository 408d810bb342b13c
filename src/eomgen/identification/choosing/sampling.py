"""Candidate poses: random ones within ranges whose frames are in boxes, within reach, and seen by the device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array, Mask
from ...errors import ArrayError, InputError, UnknownNameError
from ...names import component_name, nearest_or_all, show
from ...robot.value import COORDINATES, Robot
from ..geometry.stations import Chain, Located, located

AXES = ("x", "y", "z", "-x", "-y", "-z")
_DRAWN = 2000  # poses at once
_ROUNDS = 150
_NEAR = 0.05  # of a range: steps from poses that are inside to further ones


@dataclass(frozen=True)
class Ranges:
    """Coordinates that move, their stations and coordinates, and ends of their ranges, (n,) each, m or rad."""

    names: tuple[str, ...]
    places: tuple[tuple[int, int], ...]
    low: Array
    high: Array

    def readings(self, chain: Chain, q: Array) -> Array:
        """Return six coordinates of every station, (N, S, 6), constants of the description included, at (N, n)."""
        readings = np.zeros((len(q), len(chain.stations), 6))
        for k, station in enumerate(chain.stations):
            if station.offset is not None and station.principal is not None:
                readings[:, k] = station.offset
        for i, (k, c) in enumerate(self.places):
            readings[:, k, c] += q[:, i]
        return readings


@dataclass(frozen=True)
class Where:
    """Regions for measured frames, in the axes of the robot's base.

    boxes: lower and upper corners, (B, 2, 3), m; one of them holds the origin of every frame; None: anywhere.
    reach: least and greatest distance of the origins from the base's, m, or None.
    device: place of the measuring device, (3,), m, or None.
    angle: between the frame's axis and the direction to the device at most, rad, or None: seen from everywhere.
    axis: one of AXES.
    """

    boxes: Array | None = None
    reach: tuple[float, float] | None = None
    device: Array | None = None
    angle: float | None = None
    axis: str = "z"

    def kept(self, chain: Chain, at: Located) -> dict[str, Mask]:
        """Return which of N poses are inside, (N,), by the name of what limits them."""
        masks: dict[str, Mask] = {}
        tools = list(chain.tools.values())
        p = at.p[tools]
        if self.boxes is not None:
            inside = (p[:, :, np.newaxis] >= self.boxes[:, 0]) & (p[:, :, np.newaxis] <= self.boxes[:, 1])
            masks["boxes"] = np.asarray(inside.all(axis=-1).any(axis=-1).all(axis=0))
        if self.reach is not None:
            length = np.linalg.norm(p, axis=-1)
            masks["reach"] = np.asarray(((length >= self.reach[0]) & (length <= self.reach[1])).all(axis=0))
        if self.angle is not None and self.device is not None:
            toward = self.device - p
            toward /= np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-12)
            sign = -1.0 if self.axis.startswith("-") else 1.0
            axis = sign * at.R[tools][..., "xyz".index(self.axis[-1])]
            masks["angle"] = np.asarray(((toward * axis).sum(axis=-1) >= np.cos(self.angle)).all(axis=0))
        return masks


def ranges_of(robot: Robot, chain: Chain, requested: Mapping[str, Sequence[float]]) -> Ranges:
    """Return ranges of all principal coordinates: requested ones, by the coordinate's or the joint's name, or limits.

    Raises:
        UnknownNameError: there is no coordinate of a name.
        InputError: a coordinate has neither limits nor a range, or a range is none.
    """
    places = {
        component_name(station.name, COORDINATES[station.principal]): (k, station.principal)
        for k, station in enumerate(chain.stations)
        if station.principal is not None
    }
    owners = {name.rpartition(".")[0]: name for name in places}
    if not places:
        raise InputError(f"poses: {robot.name} has no joint that turns or slides; allowed: robots that have one")
    said = {}
    for name, ends in requested.items():
        if name not in places and name not in owners:
            raise UnknownNameError(f"ranges: there is no coordinate {name!r}{nearest_or_all(name, places)}")
        said[owners.get(name, name)] = _ends(f"ranges: {name}", ends)
    bounds = []
    for name, (k, _) in places.items():
        joint = chain.stations[k].joint
        limits = said.get(name) or (joint.limits if joint is not None else None)
        if limits is None or not np.isfinite(limits).all():
            raise InputError(f"ranges: {name} has no limits; allowed: limits in the description, or a range for it")
        bounds.append(limits)
    low, high = np.array(bounds, dtype=np.float64).T
    return Ranges(tuple(places), tuple(places.values()), low, high)


def where_from(
    boxes: ArrayLike | None,
    reach: Sequence[float] | None,
    device: ArrayLike | None,
    angle: float | None,
    axis: str,
) -> Where:
    """Return limits of places from options.

    Raises:
        ArrayError: a box or a place has another shape.
        InputError: another option cannot be used.
    """
    if axis not in AXES:
        raise InputError(f"axis: {show(axis)}; allowed: {', '.join(AXES)}")
    if angle is not None and not 0.0 < angle <= np.pi:
        raise InputError(f"angle: {show(angle)}; allowed: a number above 0, up to pi")
    if angle is not None and device is None:
        raise InputError("angle: nothing says where the device is; allowed: with device")
    span = None if reach is None else _ends("reach", reach)
    place = None if device is None else _array("device", device, (3,))
    return Where(boxes_from("boxes", boxes), span, place, angle, axis)


def boxes_from(label: str, boxes: ArrayLike | None) -> Array | None:
    """Return boxes, (B, 2, 3), from one, (2, 3), or several; None as it is."""
    if boxes is None:
        return None
    shape = np.shape(boxes)
    corners = _array(label, boxes, (2, 3) if len(shape) == 2 else (shape[:1] or (1,)) + (2, 3)).reshape(-1, 2, 3)
    if not len(corners) or (corners[:, 0] > corners[:, 1]).any():
        raise ArrayError(
            f"{label}: {show(corners.tolist())}; allowed: lower corners before upper ones, at least one box"
        )
    return corners


def sampled(
    chain: Chain, ranges: Ranges, where: Where, count: int, least: int, rng: np.random.Generator, label: str
) -> Array:
    """Return coordinates of so many poses, (N, n): random ones within the ranges.

    Where few of them are inside, more are drawn near those.

    Raises:
        InputError: fewer than ``least`` are inside; it names what excludes the others.
    """
    poses = np.empty((0, len(ranges.names)))
    seen: dict[str, int] = {}
    width = ranges.high - ranges.low
    for round_number in range(_ROUNDS):
        q = rng.uniform(ranges.low, ranges.high, (_DRAWN, len(width)))
        if round_number and len(poses):
            near = poses[rng.integers(len(poses), size=_DRAWN // 2)]
            near = near + _NEAR * width * rng.normal(size=near.shape)
            q[: len(near)] = np.where((near < ranges.low) | (near > ranges.high), q[: len(near)], near)
        at = located(chain, ranges.readings(chain, q), np.tile(np.eye(4), (len(q), 1, 1)))
        inside = np.ones(len(q), dtype=bool)
        for name, kept in where.kept(chain, at).items():
            seen[name] = seen.get(name, 0) + int(kept.sum())
            inside &= kept
        poses = np.vstack([poses, q[inside]])
        if len(poses) >= count:
            return poses[:count]
    if len(poses) < least:
        none = [name for name, many in seen.items() if not many]
        names = label or ", ".join(none or list(seen))
        raise InputError(
            f"{names}: {len(poses)} of {_ROUNDS * _DRAWN} poses within the ranges are there; allowed: at least {least}"
            f" ({_extent(chain, ranges, rng)})"
        )
    return poses


def _extent(chain: Chain, ranges: Ranges, rng: np.random.Generator) -> str:
    """Return the region that frames reach at all, for a message."""
    q = rng.uniform(ranges.low, ranges.high, (_DRAWN, len(ranges.names)))
    at = located(chain, ranges.readings(chain, q), np.tile(np.eye(4), (len(q), 1, 1)))
    parts = []
    for frame, tool in chain.tools.items():
        low, high = at.p[tool].min(axis=0), at.p[tool].max(axis=0)
        spans = [f"{axis} {a:.3g} .. {b:.3g}" for axis, a, b in zip("xyz", low, high, strict=True)]
        parts.append(f"{frame} is in {', '.join(spans)} m")
    return "; ".join(parts)


def _ends(label: str, requested: Sequence[float]) -> tuple[float, float]:
    low, high = _array(label, requested, (2,))
    if not low < high:
        raise ArrayError(f"{label}: {low:g} .. {high:g}; allowed: a lower end below the upper one")
    return float(low), float(high)


def _array(label: str, numbers: ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        values = np.array(numbers, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != shape or not np.isfinite(values).all():
        raise ArrayError(f"{label}: {show(str(numbers))}; allowed: finite numbers of shape {shape}")
    return values
