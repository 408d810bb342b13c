"""Figures of poses, of the distances between them, and of the stops at them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...errors import InputError, UnknownNameError
from ...names import listed, nearest, show
from .attained import Pose
from .formulas import deviations, scatter, stabilization, turns_from
from .result import DistanceFigures, PoseFigures, StopFigures, vector
from .variations import same_command

_FEWEST = 3  # samples of an approach


def pose_figures(pose: Pose) -> PoseFigures:
    """Figures of a pose."""
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
    """Distances of pairs of poses, by name; of each and the next one where no pairs are given.

    Raises:
        InputError: both poses of a pair have no cycle in common; UnknownNameError: there is no pose of that name.
    """
    by_name = {pose.name: pose for pose in poses}
    following = [(a.name, b.name) for a, b in pairwise(poses) if not same_command(a, b)]
    wanted = following if pairs is None else list(pairs)
    found = []
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
        found.append(_distance(one, other, both))
    return tuple(found)


def _distance(one: Pose, other: Pose, both: Sequence[int]) -> DistanceFigures:
    """Distance of two poses in the cycles that they have in common, by their labels: clause 7.3."""
    rows = [[pose.labels.index(label) for label in both] for pose in (one, other)]
    wanted, found = other.position - one.position, other.attained[rows[1]] - one.attained[rows[0]]
    length, lengths = float(np.linalg.norm(wanted)), np.linalg.norm(found, axis=1)
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
        by_axis=vector(np.abs(found).mean(axis=0) - np.abs(wanted)),
        by_axis_repeatability=vector(3.0 * deviations(np.abs(found))),
        turned=turned,
        turning=turning,
    )


def stop_figures(
    poses: Sequence[Pose], figures: Sequence[PoseFigures], band: float | None
) -> tuple[tuple[StopFigures, ...], list[str]]:
    """Stops of the poses whose approach was recorded, and notes about those that have no band."""
    found, without = [], []
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
        found.append(
            StopFigures(
                pose=pose.name,
                cycles=len(outcomes),
                band=width,
                time=float(np.mean(times)),
                overshoot=max(overshoots),
            )
        )
    text = "stabilization and overshoot need a limit band, and the repeatability is 0: give a band in m (--band)"
    return tuple(found), [text] if without else []
