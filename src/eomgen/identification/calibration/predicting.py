"""Readings of configurations that nobody measured, as the error model takes them; loops closed."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ...errors import ArrayError, InputError
from ...robot.model import build_model
from ...robot.value import COORDINATES
from ..geometry.error_model import ErrorModel, State
from ..geometry.loop_constraints import CLOSED, closed_readings


def readings_from(model: ErrorModel, q: Array) -> Array:
    """Return six coordinates of every station, (N, S, 6), from those of a robot's joints, (n,) or (N, n), m or rad.

    Of a closed mechanism from those of its drives alone, too, (d,) or (N, d); the others then close the described one.

    Raises:
        ArrayError: q has another shape, or is not finite.
        InputError: loops do not close in a row.
    """
    chain, closing = model.chain, model.closing
    every = [
        (k, c)
        for k, station in enumerate(chain.stations)
        if station.joint is not None
        for c, name in enumerate(COORDINATES)
        if name in station.joint.coordinates
    ]
    drives = every if closing is None else [place for place in every if place not in closing.passive]
    sizes = list(dict.fromkeys((len(every), len(drives))))
    if q.ndim not in (1, 2) or q.shape[-1] not in sizes or not np.isfinite(q).all():
        shapes = " or ".join(f"({size},) or (N, {size})" for size in sizes)
        raise ArrayError(f"q: got shape {q.shape}; allowed: finite numbers of shape {shapes}")
    places = every if q.shape[-1] == len(every) else drives
    flat = q.reshape(-1, len(places))
    readings = np.zeros((len(flat), len(chain.stations), 6))
    for i, (k, c) in enumerate(places):
        readings[:, k, c] = flat[:, i]
    if closing is None or len(places) == len(every):
        return readings
    rows = [f"predict: row {row}" for row in range(len(flat))]
    return closed_readings(chain, closing, build_model(model.robot), readings, rows)


def refuse_open(model: ErrorModel, state: State) -> None:
    """Raise InputError where loops are not closed."""
    closing = model.closing
    if closing is None:
        return
    violations = np.abs(closing.residuals(model.chain, state.located, state.q)).max(axis=1)
    bad = np.flatnonzero(~(violations < CLOSED))
    if bad.size:
        raise InputError(
            f"predict: row {bad[0]}: the loops of the calibrated {model.robot.name} do not close (by"
            f" {violations[bad[0]]:.2g}); allowed: drives within its reach, and passive coordinates near those that"
            " close"
        )
