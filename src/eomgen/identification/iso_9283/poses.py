"""Figures of poses, of the distances between them, of the stops at them, and of the directions of their approach."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...arrays import Array
from ...errors import InputError, UnknownNameError
from ...names import listed, nearest, show
from .attained import Pose, Record
from .formulas import arc, deviations, scatter, stabilization, turns_from
from .result import DistanceFigures, PoseFigures, StopFigures, VariationFigures, vector

_FEWEST = 3  # samples of an approach
DIRECTIONS = 3  # that the standard has, each normal to the others
_SAME = 1e-9  # m, and of entries of rotations: by less than that commands are the same
_APPROACH = 0.1  # of the way to a pose: its end says where it comes from
_ALIKE = np.deg2rad(45.0)  # between directions that differ


def pose_figures(pose: Pose) -> PoseFigures:
    """Return figures of a pose."""
    spread = scatter(pose.attained)
    offset = spread.barycentre - pose.position
    turned = turning = None
    attained = pose.attained_rotation
    if pose.rotation is not None and attained is not None:
        angles = turns_from(pose.rotation, attained)
        turned, turning = vector(angles.mean(axis=0)), vector(3.0 * deviations(angles))
    return PoseFigures(
        name=pose.name,
        cycles=len(pose.cycles),
        command=vector(pose.position),
        barycentre=vector(spread.barycentre),
        offset=vector(offset),
        accuracy=float(np.linalg.norm(offset)),
        mean=spread.mean,
        deviation=spread.deviation,
        repeatability=spread.repeatability,
        turned=turned,
        turning=turning,
        attained=tuple(vector(position) for position in pose.attained),
    )


def distance_figures(poses: Sequence[Pose], pairs: Sequence[tuple[str, str]] | None) -> tuple[DistanceFigures, ...]:
    """Return distances of pairs of poses, by name; of each and the next one without pairs.

    Raises:
        InputError: both poses of a pair have no cycle in common; UnknownNameError: there is no pose of that name.
    """
    by_name = {pose.name: pose for pose in poses}
    following = [(a.name, b.name) for a, b in pairwise(poses) if not same_command(a, b)]
    wanted = following if pairs is None else list(pairs)
    figures = []
    for pair in wanted:
        for name in pair:
            if name not in by_name:
                raise UnknownNameError(
                    f"distances: there is no pose {show(name)}{nearest(name, by_name)}; known: {listed(by_name)}"
                )
        one, other = (by_name[name] for name in pair)
        both = [label for label in one.labels if label in other.labels]
        if pairs is None and not both:
            continue
        if not both:
            raise InputError(f"distances: poses {listed(pair)} have no cycle in common; allowed: one or more")
        figures.append(_distance(one, other, both))
    return tuple(figures)


def _distance(one: Pose, other: Pose, both: Sequence[int]) -> DistanceFigures:
    """Return the distance of two poses in the cycles that they have in common, by their labels: clause 7.3."""
    rows = [[pose.labels.index(label) for label in both] for pose in (one, other)]
    wanted, attained = other.position - one.position, other.attained[rows[1]] - one.attained[rows[0]]
    length, lengths = float(np.linalg.norm(wanted)), np.linalg.norm(attained, axis=1)
    turned = turning = None
    first, last = one.attained_rotation, other.attained_rotation
    if one.rotation is not None and other.rotation is not None and first is not None and last is not None:
        angles = np.abs(turns_from(first[rows[0]], last[rows[1]]))
        commanded = np.abs(turns_from(one.rotation, other.rotation))
        turned, turning = vector(angles.mean(axis=0) - commanded), vector(3.0 * deviations(angles))
    return DistanceFigures(
        poses=(one.name, other.name),
        cycles=len(both),
        command=length,
        mean=float(lengths.mean()),
        accuracy=float(lengths.mean()) - length,
        repeatability=3.0 * float(deviations(lengths)),
        by_axis=vector(np.abs(attained).mean(axis=0) - np.abs(wanted)),
        by_axis_repeatability=vector(3.0 * deviations(np.abs(attained))),
        turned=turned,
        turning=turning,
    )


def stop_figures(
    poses: Sequence[Pose], figures: Sequence[PoseFigures], band: float | None
) -> tuple[tuple[StopFigures, ...], list[str]]:
    """Return stops of the poses whose approach was recorded, and notes about those that have no band."""
    stops, without = [], []
    for pose, figure in zip(poses, figures, strict=True):
        if any(record.t is None or len(record.t) < _FEWEST for record in pose.cycles):
            continue
        width = figure.repeatability if band is None else band
        if not width > 0.0:
            without.append(pose.name)
            continue
        outcomes = [
            stabilization(record.t, record.position, record.last, width)
            for record in pose.cycles
            if record.t is not None
        ]
        times, overshoots = zip(*outcomes, strict=True)
        stops.append(
            StopFigures(
                pose=pose.name,
                cycles=len(outcomes),
                band=width,
                time=float(np.mean(times)),
                overshoot=max(overshoots),
            )
        )
    text = "stabilization and overshoot need a limit band, and the repeatability is 0: give a band in m (--band)"
    return tuple(stops), [text] if without else []


def same_command(one: Pose, other: Pose) -> bool:
    """Return whether two poses are commanded alike."""
    if np.abs(one.position - other.position).max() > _SAME:
        return False
    if one.rotation is None or other.rotation is None:
        return one.rotation is other.rotation
    return bool(np.abs(one.rotation - other.rotation).max() <= _SAME)


def variation_figures(
    poses: Sequence[Pose], figures: Sequence[PoseFigures]
) -> tuple[tuple[VariationFigures, ...], list[str]]:
    """Give variations of the poses that are commanded several times, clause 7.2.3, and notes about their directions."""
    groups = list[list[int]]()
    for i, pose in enumerate(poses):
        group = next((group for group in groups if same_command(poses[group[0]], pose)), None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    variations, notes = [], list[str]()
    for group in groups:
        if len(group) > 1:
            variations.append(_variation([figures[i] for i in group]))
            notes += _directions([poses[i] for i in group])
    return tuple(variations), notes


def _variation(group: Sequence[PoseFigures]) -> VariationFigures:
    barycentres = np.array([item.barycentre for item in group])
    turned = [item.turned for item in group if item.turned is not None]
    return VariationFigures(
        poses=tuple(item.name for item in group),
        cycles=min(item.cycles for item in group),
        position=float(np.linalg.norm(barycentres[:, np.newaxis] - barycentres, axis=2).max()),
        turned=vector(np.ptp(np.array(turned), axis=0)) if len(turned) == len(group) else None,
    )


def _directions(group: Sequence[Pose]) -> list[str]:
    """Say where directions are not known, are alike, or are not as many as in the standard."""
    names = listed(pose.name for pose in group)
    said = f"poses {names} are commanded alike: vAP takes them as one pose reached from {len(group)} directions"
    approaches = [_approach(pose.cycles[0]) for pose in group]
    known = [way for way in approaches if way is not None]
    if len(known) < len(group):
        said += ", which their records do not show"
    else:
        cosines = np.array(known) @ np.array(known).T
        least = float(np.arccos(np.clip(cosines[np.triu_indices(len(known), 1)], -1.0, 1.0)).min())
        if least < _ALIKE:
            said += f", of which two are {np.rad2deg(least):.0f} deg apart"
    if len(group) != DIRECTIONS:
        said += f"; the standard has {DIRECTIONS}"
    return [said]


def _approach(record: Record) -> Array | None:
    """Return the unit vector of the end of the way to a pose; None where the record has no way."""
    way = arc(record.position)
    if not way[-1] > 0.0:
        return None
    begin = int(np.searchsorted(way, (1.0 - _APPROACH) * way[-1], side="right")) - 1
    step = record.last - record.position[begin]
    length = float(np.linalg.norm(step))
    return step / length if length > 0.0 else None
