"""Other ways to read a file of poses: units, axes, orientations, joints, rows; which one explains what was measured.

All readings, the file as it is among them, are fitted with the same simple model, base and tool transforms alone, and
compared by the same robust figure: the median of what is left, beside how far the measurements spread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...names import kind_of
from ..geometry.observations import ORIENTATION, POSITION, at_rows
from ..geometry.poses import Measured, MeasuredPoses
from ..geometry.rotations import FOUR, READINGS
from ..geometry.solve import Problem
from .variants import roughly_placed

Change = Callable[[MeasuredPoses], MeasuredPoses]

LENGTHS, ANGLES, AXES, ORIENTATIONS, JOINTS, ROWS = "lengths", "angles", "axes", "orientations", "joints", "rows"
EXPLAINED = 0.12  # of the spread of positions, or rad: what a reading that is right leaves at most
_BETTER = 5.0  # times less: what another reading must leave to be the cause
_TIED = 1.3  # times: readings that leave no more than that are as good
_PROMISING = 0.75  # of what the file as it is leaves: what a second cause is looked for beside
_SECOND = 3  # readings that a second one is looked for beside
_SAID = 8  # readings in a message


@dataclass(frozen=True)
class Reading:
    """Another reading of a file: its text, the kind of mistake, and the function that rereads poses."""

    text: str
    about: str
    change: Change


@dataclass(frozen=True)
class Left:
    """Remainder of a reading: medians of lengths (m) and angles (rad), and the share that is not explained."""

    medians: Mapping[str, float]
    shares: Mapping[str, float]

    @property
    def total(self) -> float:
        """The share of all that is not explained."""
        return sum(self.shares.values())

    @property
    def explains(self) -> bool:
        """Whether the reading may be right."""
        return all(share < EXPLAINED for share in self.shares.values())

    def is_like(self, other: Left) -> bool:
        """Return whether it leaves lengths and angles that are not much larger."""
        return all(value <= 1.5 * other.medians.get(kind, 0.0) for kind, value in self.medians.items())

    def __str__(self) -> str:
        units = {POSITION: "m", ORIENTATION: "rad"}
        return ", ".join(f"{value:.3g} {units[kind]} of {kind}" for kind, value in self.medians.items())


@dataclass(frozen=True)
class Judged:
    """Readings by what they leave, the best first: that of the file, the cause and what is as good, and the others."""

    as_read: Left
    cause: tuple[tuple[str, Left], ...]
    others: tuple[tuple[str, Left], ...]


def judged(poses: MeasuredPoses, again: Callable[[MeasuredPoses], Left], *, is_closed: bool) -> Judged:
    """Rank other readings of a file, alone and, where none explains it, two at a time.

    Args:
        poses: as they were read.
        again: what the simple model leaves of poses; InputError where it cannot be fitted.
        is_closed: whether a mechanism has to be closed anew for other coordinates, which are not tried then.
    """
    as_read = again(poses)
    readings = [x for x in readings_of(poses) if not (is_closed and x.about in (ANGLES, JOINTS))]
    tried = _tried(poses, again, [((reading,), reading.text) for reading in readings])
    if not (as_read.explains or any(_is_cause(left, as_read) for _, _, left in tried)):
        firsts = [entry for entry in tried if entry[2].total < _PROMISING * as_read.total][:_SECOND]
        pairs = [
            ((first[0][0], other), f"{first[1]} and {other.text}")
            for first in firsts
            for other in readings
            if other.about != first[0][0].about
        ]
        tried = sorted([*tried, *_tried(poses, again, pairs)], key=lambda entry: entry[2].total)
    ranked = [(text, left) for _, text, left in tried]
    if not ranked or not _is_cause(ranked[0][1], as_read):
        return Judged(as_read, (), tuple(ranked[:_SAID]))
    tied = [entry for entry in ranked if entry[1].total <= _TIED * ranked[0][1].total]
    return Judged(as_read, tuple(tied[:_SAID]), tuple(ranked[len(tied) :][:_SAID]))


def _is_cause(left: Left, as_read: Left) -> bool:
    return left.explains and left.total * _BETTER < as_read.total


def _tried(
    poses: MeasuredPoses,
    again: Callable[[MeasuredPoses], Left],
    candidates: Sequence[tuple[tuple[Reading, ...], str]],
) -> list[tuple[tuple[Reading, ...], str, Left]]:
    """Return the readings with what is left of them, the best first; without those that cannot be fitted."""
    readings_tried = []
    for readings, text in candidates:
        changed = poses
        for reading in readings:
            changed = reading.change(changed)
        try:
            readings_tried.append((readings, text, again(changed)))
        except (InputError, np.linalg.LinAlgError):
            continue
    return sorted(readings_tried, key=lambda entry: entry[2].total)


def left_of(problem: Problem, start: Array) -> Left:
    """Return the residuals of a problem with base and tool transforms alone: medians over vectors, by kind."""
    x = roughly_placed(problem, start)
    r, _ = at_rows(problem.model, problem.rows, problem.seen, x)
    medians, shares = dict[str, float](), dict[str, float]()
    kinds = problem.seen.kinds
    for group, block in enumerate(problem.seen.blocks):
        inside = problem.seen.group == group
        kind = str(kinds[inside][0])
        median = float(np.median(np.linalg.norm(r[inside].reshape(-1, block.width), axis=1)))
        spread = 1.0
        if kind == POSITION:
            values = block.values.reshape(-1, block.width)
            spread = float(np.median(np.linalg.norm(values - np.median(values, axis=0), axis=1)))
        medians[kind] = max(medians.get(kind, 0.0), median)
        shares[kind] = max(shares.get(kind, 0.0), median / max(spread, 1e-9))
    return Left(medians, shares)


def readings_of(poses: MeasuredPoses) -> Iterator[Reading]:
    """Yield all other readings of a file that are tried."""
    turned = any(m.written is not None or np.isfinite(m.orientation).any() for m in poses.frames.values())
    placed = any(np.isfinite(m.position).any() for m in poses.frames.values())
    yield from _units(poses)
    if placed:
        yield from _axes(turned)
    if turned:
        yield from _orientations(poses)
        yield from _mirrored_turns()
    if turned and placed:
        yield Reading("poses of the device in the frame (inverse)", AXES, lambda x: _with_frames(x, _inverse))
    yield from _joints(poses)
    for text, shift in (("coordinates one row late", 1), ("coordinates one row early", -1)):
        yield Reading(text, ROWS, _shifted(shift))


# Units


def _units(poses: MeasuredPoses) -> Iterator[Reading]:
    for text, factor in (
        ("millimetres for metres", 1e-3),
        ("metres for millimetres", 1e3),
        ("centimetres for metres", 1e-2),
        ("inches for metres", 0.0254),
    ):
        yield Reading(text, LENGTHS, _scaling(factor))
    turns = np.array([_turns(name) for name in poses.coordinates])
    scales = [
        ("degrees for radians (coordinates)", turns, np.pi / 180.0),
        ("radians for degrees (coordinates)", turns, 180.0 / np.pi),
        ("millimetres for metres (coordinates)", ~turns, 1e-3),
        ("metres for millimetres (coordinates)", ~turns, 1e3),
    ]
    for text, there, factor in scales:
        if there.any():
            yield Reading(text, ANGLES, _mixed(np.diag(np.where(there, factor, 1.0))))


def _turns(name: str) -> bool:
    return kind_of(name) not in ("x", "y", "z")


def _scaling(factor: float) -> Change:
    def change(m: Measured) -> Measured:
        return replace(m, position=factor * m.position, distance=factor * m.distance, travel=factor * m.travel)

    return lambda poses: _with_frames(poses, change)


# Axes


def _axes(turned: bool) -> Iterator[Reading]:
    """Yield axes mirrored and exchanged: of positions alone, or with orientations in the same axes."""
    eye = np.eye(3)
    odd = [(f"{axis} mirrored", eye - 2.0 * np.diag(eye[i])) for i, axis in enumerate("xyz")]
    odd += [(f"{'xyz'[i]} and {'xyz'[k]} swapped", eye[_exchanged(3, i, k)]) for i, k in combinations(range(3), 2)]
    if not turned:
        for text, M in odd:
            yield Reading(text, AXES, _moved(M, None))
        return
    for text, M in odd:
        yield Reading(f"{text}, of positions and orientations (left-handed axes)", AXES, _moved(M, M))
        yield Reading(f"{text}, of positions alone", AXES, _moved(M, None))
    for text, order in (("y, z, x for x, y, z", [2, 0, 1]), ("z, x, y for x, y, z", [1, 2, 0])):
        yield Reading(f"{text}, of positions alone", AXES, _moved(eye[order], None))


def _exchanged(count: int, i: int, k: int) -> list[int]:
    order = list(range(count))
    order[i], order[k] = k, i
    return order


def _moved(M: Array, of_turns: Array | None) -> Change:
    """Return positions M p, and orientations T R T^T where there is a T."""

    def change(m: Measured) -> Measured:
        R = m.orientation if of_turns is None else of_turns @ m.orientation @ of_turns.T
        return replace(m, position=m.position @ M.T, orientation=R)

    return lambda poses: _with_frames(poses, change)


def _mirrored_turns() -> Iterator[Reading]:
    for i, axis in enumerate("xyz"):
        T = np.eye(3)
        T[i, i] = -1.0
        yield Reading(f"{axis} mirrored, of orientations alone", ORIENTATIONS, _moved(np.eye(3), T))


# Orientations


def _orientations(poses: MeasuredPoses) -> Iterator[Reading]:
    """Yield every way to read the numbers of orientations that the file has."""
    for width in sorted({m.written.shape[1] for m in poses.frames.values() if m.written is not None}):
        units = (("", 1.0),) if width == 4 else (("", 1.0), (" in degrees", np.pi / 180.0))
        for name, reading in (FOUR if width == 4 else READINGS).items():
            for unit, factor in units:
                yield Reading(f"{name}{unit}", ORIENTATIONS, _reread(reading, factor, width, back=False))
                text = f"{name}{unit}, from the frame to the device"
                yield Reading(text, ORIENTATIONS, _reread(reading, factor, width, back=True))


def _reread(reading: Callable[[Array], Array], factor: float, width: int, *, back: bool) -> Change:
    def change(m: Measured) -> Measured:
        if m.written is None or m.written.shape[1] != width:
            return m
        there = np.isfinite(m.written).all(axis=1)
        turned = m.orientation.copy()
        turned[there] = reading(factor * m.written[there])
        return replace(m, orientation=turned.transpose(0, 2, 1) if back else turned)

    return lambda poses: _with_frames(poses, change)


def _inverse(m: Measured) -> Measured:
    back = m.orientation.transpose(0, 2, 1)
    return replace(m, orientation=back, position=-np.einsum("nij,nj->ni", back, m.position))


# Joints and rows


def _joints(poses: MeasuredPoses) -> Iterator[Reading]:
    names, eye = poses.coordinates, np.eye(len(poses.coordinates))
    turning = [i for i, name in enumerate(names) if _turns(name)]
    yield Reading("coordinates of the opposite sense", JOINTS, _mixed(-eye))
    for i, name in enumerate(names):
        yield Reading(f"{name} of the opposite sense", JOINTS, _mixed(eye - 2.0 * np.diag(eye[i])))
    for i, k in combinations(range(len(names)), 2):
        if _turns(names[i]) == _turns(names[k]):
            yield Reading(f"{names[i]} and {names[k]} swapped", JOINTS, _mixed(eye[_exchanged(len(names), i, k)]))
    for i in turning:
        for degrees in (90, -90, 180):
            text = f"{names[i]} with its zero off by {degrees} degrees"
            yield Reading(text, JOINTS, _mixed(eye, -np.deg2rad(degrees) * eye[i]))
    for i, k in zip(turning[1:], turning, strict=False):
        for text, sign in (("without", 1.0), ("with", -1.0)):
            mix = eye + sign * np.outer(eye[k], eye[i])
            yield Reading(f"{names[i]} counted {text} that of {names[k]}", JOINTS, _mixed(mix))


def _mixed(M: Array, shift: Array | float = 0.0) -> Change:
    """Return coordinates q M + shift, rows of q."""
    return lambda poses: replace(poses, q=poses.q @ M + shift)


def _shifted(by: int) -> Change:
    """Return coordinates of the row after (1) or before (-1) for what was measured in each.

    Rows at the end are left out.
    """

    def change(poses: MeasuredPoses) -> MeasuredPoses:
        rows = np.arange(max(-by, 0), len(poses.q) - max(by, 0))
        rows = rows[poses.series[rows] == poses.series[rows + by]]
        return replace(poses.part(rows), q=poses.q[rows + by])

    return change


def _with_frames(poses: MeasuredPoses, change: Callable[[Measured], Measured]) -> MeasuredPoses:
    return replace(poses, frames={name: change(measured) for name, measured in poses.frames.items()})
