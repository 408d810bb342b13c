"""Figures of paths: attained points that belong to points of the command, and velocities."""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Index, Mask
from ...errors import InputError
from ..geometry.poses import rows_at
from .attained import Path, Record
from .corners import corner_figures
from .formulas import STEADY, arc, at_planes, between, deviations, path_scatter, speeds, tangents, turns_from
from .result import PathFigures, SpeedFigures, vector

MATCHES = ("plane", "sample")
_FEWEST = 3  # points of a path
_SAME = 1e-9  # s: by less than that times are the same


def path_figures(path: Path, match: str) -> PathFigures:
    """Return figures of a path; ``match`` is one of MATCHES.

    Raises:
        InputError: it has too few points, or no point that all cycles pass; cycles have other samples than the command.
    """
    command = _without_rests(path.command)
    if len(command.position) < _FEWEST:
        raise InputError(
            f"path {path.name}: its command has {len(command.position)} different points; allowed: {_FEWEST} or more"
        )
    if match == "plane":
        attained, turns, kept = _by_planes(path, command)
    else:
        attained, turns, kept = _by_samples(path)
        command = path.command
    if not kept.any():
        raise InputError(
            f"path {path.name}: no point is passed by all cycles; allowed: paths that follow their command (match:"
            " sample compares row by row)"
        )
    accuracy, repeatability = path_scatter(command.position[kept], attained[:, kept])
    length = arc(command.position)
    turned = turning = None
    if turns is not None:
        turned = vector(np.abs(turns[:, kept].mean(axis=0)).max(axis=0))
        turning = vector(3.0 * deviations(turns[:, kept]).max(axis=0))
    along = length[kept]
    return PathFigures(
        name=path.name,
        cycles=len(path.cycles),
        length=float(length[-1]),
        points=int(kept.sum()),
        left_out=int((~kept).sum()),
        accuracy=float(accuracy.max()),
        repeatability=float(repeatability.max()),
        accuracy_at=float(along[accuracy.argmax()]),
        repeatability_at=float(along[repeatability.argmax()]),
        turned=turned,
        turning=turning,
        speed=_speed(path),
        corners=corner_figures(path, _without_rests(path.command)),
        along=tuple(along.tolist()),
        offsets=tuple(accuracy.tolist()),
        scatters=tuple(repeatability.tolist()),
    )


def _without_rests(command: Record) -> Record:
    """Return the command without points that repeat the one before: a path's tangent is there nowhere."""
    steps = np.linalg.norm(np.diff(command.position, axis=0), axis=1)
    return rows_at(command, np.concatenate([[True], steps > 0.0]))


def _by_planes(path: Path, command: Record) -> tuple[Array, Array | None, Mask]:
    """Return where cycles pass the normal planes: positions (n, m, 3), rotations from the command, passed by all."""
    along = tangents(command.position)
    share = arc(command.position)
    positions, turns = [], []
    kept = np.ones(len(command.position), dtype=bool)
    for record in path.cycles:
        near = _near(command, record, share / share[-1])
        places = at_planes(command.position, along, near, record.position)
        kept &= np.isfinite(places)
        places = np.nan_to_num(places)
        positions.append(between(record.position, places))
        if command.rotation is not None and record.rotation is not None:
            turns.append(_turns_at(command.rotation, record.rotation, places))
    whole = np.stack(turns) if len(turns) == len(path.cycles) else None
    return np.stack(positions), whole, kept


def _near(command: Record, record: Record, share: Array) -> Index:
    """Return samples of a cycle that are about where the points of the command are.

    They are those at the same time, or at the same share of the way.
    """
    if command.t is not None and record.t is not None:
        nearest = np.searchsorted(record.t - record.t[0], command.t - command.t[0])
    else:
        length = arc(record.position)
        nearest = np.searchsorted(length / length[-1] if length[-1] > 0.0 else length, share)
    return np.asarray(np.minimum(nearest, len(record.position) - 1), dtype=np.intp)


def _turns_at(command: Array, attained: Array, places: Array) -> Array:
    """Return rotations from commanded axes at samples with fractions: linear between both neighbours."""
    low = np.minimum(places.astype(np.intp), len(attained) - 1)
    high = np.minimum(low + 1, len(attained) - 1)
    first, last = turns_from(command, attained[low]), turns_from(command, attained[high])
    return np.asarray(first + (places - low)[:, np.newaxis] * (last - first))


def _by_samples(path: Path) -> tuple[Array, Array | None, Mask]:
    """Return cycles whose samples are those of the command, row by row; a rest behind its end is left out."""
    command, size = path.command, len(path.command.position)
    positions, turns = [], []
    for number, record in enumerate(path.cycles, 1):
        rests = len(record.position) > size and _begins_with(record.t, command.t)
        if len(record.position) != size and not rests:
            raise InputError(
                f"path {path.name}: cycle {number} has {len(record.position)} samples and its command {size};"
                " allowed: equally many, or match: plane"
            )
        positions.append(record.position[:size])
        if command.rotation is not None and record.rotation is not None:
            turns.append(turns_from(command.rotation, record.rotation[:size]))
    whole = np.stack(turns) if len(turns) == len(path.cycles) else None
    return np.stack(positions), whole, np.ones(size, dtype=bool)


def _begins_with(t: Array | None, first: Array | None) -> bool:
    return t is not None and first is not None and bool(np.abs(t[: len(first)] - first).max() <= _SAME)


def _speed(path: Path) -> SpeedFigures | None:
    """Return velocities where the command is nearly as fast as it ever is; None without times."""
    command = path.command
    if command.t is None or any(record.t is None or len(record.t) < _FEWEST for record in path.cycles):
        return None
    wanted = speeds(command.t, command.position)
    steady = wanted >= STEADY * wanted.max()
    if not wanted.max() > 0.0:
        return None
    begin, end = command.t[steady][[0, -1]] - command.t[0]
    means, swings = [], []
    for record in path.cycles:
        assert record.t is not None
        clock = record.t - record.t[0]
        inside = (clock >= begin) & (clock <= end)
        if not inside.any():
            return None
        attained = speeds(record.t, record.position)[inside]
        means.append(float(attained.mean()))
        swings.append(float(np.ptp(attained)))
    clock = command.t - command.t[0]
    mean = float(wanted[(clock >= begin) & (clock <= end)].mean())
    return SpeedFigures(
        command=mean,
        accuracy=float(np.mean(means)) / mean - 1.0,
        repeatability=3.0 * float(deviations(np.array(means))) / mean,
        fluctuation=max(swings),
    )
