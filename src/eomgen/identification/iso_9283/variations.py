"""Multi-directional pose accuracy variation: one commanded pose that is reached from several directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...names import listed
from ..arrays import Array
from .attained import Pose, Record
from .formulas import arc
from .result import PoseFigures, VariationFigures, vector

DIRECTIONS = 3  # that the standard has, each normal to the others
_SAME = 1e-9  # m, and of entries of rotations: by less than that commands are the same
_APPROACH = 0.1  # of the way to a pose: its end says where it comes from
_ALIKE = np.deg2rad(45.0)  # between directions that differ


def same_command(one: Pose, other: Pose) -> bool:
    """Whether two poses are commanded alike."""
    if np.abs(one.position - other.position).max() > _SAME:
        return False
    if one.rotation is None or other.rotation is None:
        return one.rotation is other.rotation
    return bool(np.abs(one.rotation - other.rotation).max() <= _SAME)


def variation_figures(
    poses: Sequence[Pose], figures: Sequence[PoseFigures]
) -> tuple[tuple[VariationFigures, ...], list[str]]:
    """Variations of the poses that are commanded several times, clause 7.2.3, and notes about their directions."""
    groups = list[list[int]]()
    for i, pose in enumerate(poses):
        group = next((group for group in groups if same_command(poses[group[0]], pose)), None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    found, notes = [], list[str]()
    for group in groups:
        if len(group) > 1:
            found.append(_variation([figures[i] for i in group]))
            notes += _directions([poses[i] for i in group])
    return tuple(found), notes


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
    """Unit vector of the last part of the way to a pose; None where the record has no way."""
    way = arc(record.position)
    if not way[-1] > 0.0:
        return None
    begin = int(np.searchsorted(way, (1.0 - _APPROACH) * way[-1], side="right")) - 1
    step = record.last - record.position[begin]
    length = float(np.linalg.norm(step))
    return step / length if length > 0.0 else None
