"""Poses that nobody has measured yet, as if they had been: what the error model takes, behind those that were."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...errors import InputError
from ...names import listed, show
from ..arrays import Array, Places
from ..geometry.poses import Measured, MeasuredPoses
from ..geometry.stations import Chain, located
from .sampling import Ranges

POSE, POSITION, DISTANCE = "pose", "position", "distance"
MEASURES = (POSE, POSITION, DISTANCE)
WIDTHS = {POSE: 6, POSITION: 3, DISTANCE: 1}  # numbers of a frame in a pose


def proposed(
    chain: Chain, ranges: Ranges, q: Array, base: Array, series: int, measure: str, noise: tuple[float, float]
) -> MeasuredPoses:
    """Rows that the described robot would show at coordinates q, (N, n), to a device that sees its base at ``base``.

    measure: one of MEASURES, of all frames of the chain.  noise: standard deviations of lengths (m) and turns (rad).
    """
    at = located(chain, ranges.readings(chain, q), np.tile(base, (len(q), 1, 1)))
    blank = np.full(len(q), np.nan)
    lengths = dict.fromkeys(("x", "y", "z", "distance", "travel"), np.full(len(q), noise[0]))
    sigma = lengths | dict.fromkeys(("rx", "ry", "rz"), np.full(len(q), noise[1]))
    frames = {
        name: Measured(
            frame=name,
            position=np.full((len(q), 3), np.nan) if measure == DISTANCE else at.p[tool],
            orientation=at.R[tool] if measure == POSE else np.full((len(q), 3, 3), np.nan),
            distance=np.linalg.norm(at.p[tool], axis=1) if measure == DISTANCE else blank,
            travel=blank,
            wrench=np.zeros((len(q), 6)),
            sigma=sigma,
        )
        for name, tool in chain.tools.items()
    }
    return MeasuredPoses(
        coordinates=ranges.names,
        q=q,
        frames=frames,
        series=np.full(len(q), series, dtype=np.int64),
        body=None,
        weight=np.ones(len(q)),
        temperature=None,
        source="candidates",
    )


def joined(before: MeasuredPoses, more: MeasuredPoses, noise: tuple[float, float]) -> MeasuredPoses:
    """Poses that were measured, and proposed ones behind them.

    Raises:
        InputError: the file of the former has other coordinates.
    """
    if set(before.coordinates) != set(more.coordinates):
        raise InputError(
            f"{before.source}: has the coordinates {listed(map(show, before.coordinates))}; allowed:"
            f" {listed(more.coordinates)}"
        )
    order = [before.coordinates.index(name) for name in more.coordinates]
    names = list(dict.fromkeys((*before.frames, *more.frames)))
    return MeasuredPoses(
        coordinates=more.coordinates,
        q=np.vstack([before.q[:, order], more.q]),
        frames={name: _both(name, before, more, noise) for name in names},
        series=np.concatenate([before.series, more.series]),
        body=None,
        weight=np.concatenate([before.weight, more.weight]),
        temperature=None,
        source=before.source,
    )


def _both(name: str, before: MeasuredPoses, more: MeasuredPoses, noise: tuple[float, float]) -> Measured:
    """A frame in both; blank where it was not measured, with usual noise where a file has none."""
    parts = [_part(poses.frames, name, len(poses.q)) for poses in (before, more)]
    keys = list(dict.fromkeys(key for part in parts for key in part.sigma))

    def stacked(values: Sequence[Array]) -> Array:
        return np.concatenate(list(values))

    def deviations(part: Measured, key: str) -> Array:
        usual = np.full(len(part.distance), noise[key in ("rx", "ry", "rz")])
        return part.sigma.get(key, usual)

    return Measured(
        frame=name,
        position=stacked([part.position for part in parts]),
        orientation=stacked([part.orientation for part in parts]),
        distance=stacked([part.distance for part in parts]),
        travel=stacked([part.travel for part in parts]),
        wrench=stacked([part.wrench for part in parts]),
        sigma={key: stacked([deviations(part, key) for part in parts]) for key in keys},
    )


def _part(frames: Mapping[str, Measured], name: str, rows: int) -> Measured:
    """Values that were measured of a frame, or blanks."""
    if name in frames:
        return frames[name]
    blank = np.full(rows, np.nan)
    return Measured(
        frame=name,
        position=np.full((rows, 3), np.nan),
        orientation=np.full((rows, 3, 3), np.nan),
        distance=blank,
        travel=blank,
        wrench=np.zeros((rows, 6)),
        sigma={},
    )


def rows_kept(poses: MeasuredPoses, kept: Places) -> MeasuredPoses:
    """The same of some of the rows."""
    frames = {
        name: Measured(
            frame=name,
            position=measured.position[kept],
            orientation=measured.orientation[kept],
            distance=measured.distance[kept],
            travel=measured.travel[kept],
            wrench=measured.wrench[kept],
            sigma={key: values[kept] for key, values in measured.sigma.items()},
        )
        for name, measured in poses.frames.items()
    }
    return MeasuredPoses(
        coordinates=poses.coordinates,
        q=poses.q[kept],
        frames=frames,
        series=poses.series[kept],
        body=None,
        weight=poses.weight[kept],
        temperature=None,
        source=poses.source,
    )
