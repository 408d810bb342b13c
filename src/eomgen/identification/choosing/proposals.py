"""Poses that nobody has measured yet, as if they had been: what the error model takes, behind those that were."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...names import listed, show
from ..geometry.poses import Measured, MeasuredPoses, blank_frame
from ..geometry.stations import Chain, located
from .sampling import Ranges

POSE, POSITION, DISTANCE = "pose", "position", "distance"
Measure = Literal["pose", "position", "distance"]
MEASURES = (POSE, POSITION, DISTANCE)
WIDTHS = {POSE: 6, POSITION: 3, DISTANCE: 1}  # numbers of a frame in a pose


def proposed(
    chain: Chain, ranges: Ranges, q: Array, base: Array, series: int, measure: str, noise: tuple[float, float]
) -> MeasuredPoses:
    """Return rows that the described robot would show at q, (N, n), to a device that sees its base at ``base``.

    measure: one of MEASURES, of all frames of the chain.  noise: deviations of lengths (m) and rotations (rad).
    """
    at = located(chain, ranges.readings(chain, q), np.tile(base, (len(q), 1, 1)))
    lengths = dict.fromkeys(("x", "y", "z", "distance", "travel"), np.full(len(q), noise[0]))
    sigma = lengths | dict.fromkeys(("rx", "ry", "rz"), np.full(len(q), noise[1]))
    frames = {}
    for name, tool in chain.tools.items():
        seen: dict[str, Any] = {"position": at.p[tool]}
        if measure == POSE:
            seen["orientation"] = at.R[tool]
        elif measure == DISTANCE:
            seen = {"distance": np.linalg.norm(at.p[tool], axis=1)}
        frames[name] = replace(blank_frame(name, len(q)), sigma=sigma, **seen)
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
    """Return poses that were measured, and proposed ones behind them.

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
    """Return a frame in both; blank where it was not measured, with usual noise where a file has none."""
    tables = [poses.frames.get(name) or blank_frame(name, len(poses.q)) for poses in (before, more)]
    keys = dict.fromkeys(key for table in tables for key in table.sigma)
    sigma = {
        key: np.concatenate(
            [x.sigma.get(key, np.full(len(x.distance), noise[key in ("rx", "ry", "rz")])) for x in tables]
        )
        for key in keys
    }
    parts = ("position", "orientation", "distance", "travel", "wrench")
    stacked = {field: np.concatenate([getattr(table, field) for table in tables]) for field in parts}
    return Measured(frame=name, sigma=sigma, **stacked)
