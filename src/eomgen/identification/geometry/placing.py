"""Rough poses of bases and attached frames, which the Gauss-Newton method begins with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from .error_model import ErrorModel, Rows
from .observations import DISTANCE, ORIENTATION, POSITION, Observations
from .rotations import nearest_rotation, pose_of
from .stations import located

_RANK = 1e-8  # of the greatest singular value: what does not show is left at 0


@dataclass(frozen=True)
class _Seen:
    """A frame in one series: the carrier's pose in the robot's base frame, and what was measured of it."""

    R: Array
    p: Array
    position: Array
    turned: Array
    distance: Array


def placed(model: ErrorModel, rows: Rows, seen: Observations, known: Mapping[str, bool]) -> ErrorModel:
    """Return the model with bases and attached frames where measured poses of the nominal robot put them.

    known: of every measured frame, whether the description places it.  Such frames place the bases, if there are any.
    """
    fitted, settled = model, {frame for frame, is_known in known.items() if is_known}
    open_series = list(model.bases)
    while open_series or settled != set(known):
        pairs = [
            (frame in settled, number not in open_series, frame, number)
            for frame in known
            for number in model.bases
            if frame not in settled or number in open_series
        ]
        pairs = [pair for pair in pairs if _count(seen, rows, pair[2], pair[3])]
        if not pairs:
            return fitted
        has_frame, has_base, frame, number = max(
            pairs, key=lambda pair: (pair[0] or pair[1], _count(seen, rows, pair[2], pair[3]))
        )
        about = _seen(fitted, rows, seen, frame, number)
        tool = fitted.chain.stations[fitted.chain.tools[frame]].before
        base = fitted.bases[number]
        if has_frame:
            base = _base(about, tool)
        elif has_base:
            tool = _tool(about, base)
        else:
            base, tool = _both(about)
        fitted = _with(fitted, frame, tool, number, base)
        settled.add(frame)
        open_series = [other for other in open_series if other != number]
    return fitted


def _with(model: ErrorModel, frame: str, tool: Array, number: int, base: Array) -> ErrorModel:
    at = model.chain.tools[frame]
    stations = tuple(replace(s, before=tool) if k == at else s for k, s in enumerate(model.chain.stations))
    chain = replace(model.chain, stations=stations)
    return replace(model, chain=chain, bases={**model.bases, number: base})


def _count(seen: Observations, rows: Rows, frame: str, number: int) -> int:
    return sum(
        block.width * int((rows.series[block.rows] == number).sum()) for block in seen.blocks if block.frame == frame
    )


def _seen(model: ErrorModel, rows: Rows, seen: Observations, frame: str, number: int) -> _Seen:
    """Return measurements of a frame in a series; NaN where it was not."""
    chosen = np.flatnonzero(rows.series == number)
    many = len(chosen)
    of_offsets = rows.readings[chosen].copy()
    for parameter in model.parameters:
        if parameter.factor == "one":
            of_offsets[:, parameter.station, parameter.coordinate] += parameter.nominal
    at = located(model.chain, of_offsets, np.tile(np.eye(4), (many, 1, 1)))
    carrier = model.chain.stations[model.chain.tools[frame]].parent
    values = {POSITION: np.full((many, 3), np.nan), ORIENTATION: np.full((many, 3, 3), np.nan)}
    values[DISTANCE] = np.full(many, np.nan)
    for block in seen.blocks:
        if block.frame == frame and block.kind in values:
            inside = rows.series[block.rows] == number
            values[block.kind][np.searchsorted(chosen, block.rows[inside])] = block.values[inside]
    return _Seen(at.R[carrier], at.p[carrier], values[POSITION], values[ORIENTATION], values[DISTANCE])


def _base(about: _Seen, tool: Array) -> Array:
    """Return the base before the device where the frame's place on its link is known."""
    R, p = about.R @ tool[:3, :3], about.p + about.R @ tool[:3, 3]
    there, turned = np.isfinite(about.position[:, 0]), np.isfinite(about.turned[:, 0, 0])
    if not there.any():
        if turned.any():
            return pose_of(nearest_rotation(np.einsum("nij,nkj->ik", about.turned[turned], R[turned])), np.zeros(3))
        return _from_distances(p, about.distance)
    middle, where = p[there].mean(axis=0), about.position[there].mean(axis=0)
    M = np.einsum("ni,nj->ij", about.position[there] - where, p[there] - middle)
    if turned.any():
        spread = max(float(np.mean((p[there] - middle) ** 2)), 1e-12)
        M = M / spread + np.einsum("nij,nkj->ik", about.turned[turned], R[turned])
    turn = nearest_rotation(M)
    return pose_of(turn, where - turn @ middle)


def _from_distances(p: Array, distance: Array) -> Array:
    """Return the base with the device's origin where the distances meet.

    Its axes are taken as the device's, since distances do not show them.
    """
    there = np.isfinite(distance)
    if there.sum() < 4:
        return np.eye(4)
    A = np.hstack([2.0 * p[there], np.ones((there.sum(), 1))])
    origin = np.linalg.lstsq(A, (p[there] ** 2).sum(axis=1) - distance[there] ** 2, rcond=_RANK)[0][:3]
    return pose_of(np.eye(3), -origin)


def _tool(about: _Seen, base: Array) -> Array:
    """Return the frame on its link where the base is known."""
    there, turned = np.isfinite(about.position[:, 0]), np.isfinite(about.turned[:, 0, 0])
    R = base[:3, :3] @ about.R
    turn, origin = np.eye(3), np.zeros(3)
    if turned.any():
        turn = nearest_rotation(np.einsum("nji,njk->ik", R[turned], about.turned[turned]))
    if there.any():
        off = about.position[there] - base[:3, 3] - about.p[there] @ base[:3, :3].T
        origin = np.einsum("nji,nj->ni", R[there], off).mean(axis=0)
    return pose_of(turn, origin)


def _both(about: _Seen) -> tuple[Array, Array]:
    """Return base and frame together, from positions p + R t = Q m + c, linear in t, Q and c.

    Measured rotations count, too.
    """
    there, turned = np.isfinite(about.position[:, 0]), np.isfinite(about.turned[:, 0, 0])
    Q = np.eye(3)
    if turned.any():
        Q = _turn_of_base(about.R[turned], about.turned[turned])
    elif there.sum() >= 5:
        m, many = about.position[there], int(there.sum())
        middle = m.mean(axis=0)
        A = np.zeros((many, 3, 15))
        A[:, :, :3] = -about.R[there]
        for i in range(3):
            A[:, i, 3 + 3 * i : 6 + 3 * i] = m - middle
        A[:, :, 12:] = np.eye(3)
        solution = np.linalg.lstsq(A.reshape(-1, 15), about.p[there].reshape(-1), rcond=_RANK)[0]
        Q = nearest_rotation(np.asarray(solution[3:12]).reshape(3, 3))
    t, c = np.zeros(3), np.zeros(3)
    if there.any():
        A = np.concatenate([about.R[there], np.tile(-np.eye(3), (there.sum(), 1, 1))], axis=2)
        b = about.position[there] @ Q.T - about.p[there]
        solution = np.linalg.lstsq(A.reshape(-1, 6), b.reshape(-1), rcond=_RANK)[0]
        t, c = np.asarray(solution, float).reshape(2, 3)
    elif np.isfinite(about.distance).any():
        c = -_from_distances(about.p, about.distance)[:3, 3]
    base = pose_of(Q.T, -Q.T @ c)
    turn = _tool(about, base)[:3, :3] if turned.any() else np.eye(3)
    return base, pose_of(turn, t)


def _turn_of_base(R: Array, measured: Array) -> Array:
    """Return Q of R_i X = Q measured_i for all i, by the null space of both rotations, (3, 3).

    It is the rotation from the device to the base.
    """
    A = np.zeros((len(R), 9, 18))
    for i in range(3):
        for j in range(3):  # row i of R X, column j: sum R[i, k] X[k, j]; less sum Q[i, k] M[k, j]
            A[:, 3 * i + j, j:9:3] = R[:, i, :]
            A[:, 3 * i + j, 9 + 3 * i : 12 + 3 * i] = -measured[:, :, j]
    _, values, rows = np.linalg.svd(A.reshape(-1, 18), full_matrices=False)
    if values.size < 18 or values[-2] < 1e-6 * values[0]:
        return nearest_rotation(np.einsum("nij,nkj->ik", R, measured))  # as if the frame stood as its link
    Q = rows[-1, 9:].reshape(3, 3)
    return nearest_rotation(Q if np.linalg.det(Q) > 0.0 else -Q)
