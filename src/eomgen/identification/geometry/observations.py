"""Measurements as one vector of numbers, what an error model predicts of it, and by how much they differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arrays import Array, Index, Mask
from ...errors import ArrayError, InputError
from ...motion.measured_numbers import ALLOWED_DIVISOR, is_divisor
from ...names import listed, show
from ...robot.coordinates import MOTIONS
from .covariances import matrices_of, whitening_factor
from .error_model import ErrorModel, Rows, State
from .poses import Measured, MeasuredPoses
from .rotations import vectors_of

POSITION, ORIENTATION, DISTANCE, TRAVEL = "position", "orientation", "distance", "travel"
ENCODER = "encoder"  # of a passive coordinate of a closed mechanism
_LEAST = 1e-12  # m, below which a distance has no direction


@dataclass(frozen=True)
class Block:
    """Measurements of one kind of one frame: rows (R,), values, and the kind.

    Of an encoder the frame is the coordinate's name, and the place its station and coordinate.
    """

    frame: str
    kind: str
    rows: Index
    values: Array
    place: tuple[int, int] = (0, 0)

    @property
    def is_turn(self) -> bool:
        """Whether its numbers are angles."""
        return self.kind == ORIENTATION or (self.kind == ENCODER and self.place[1] >= 3)

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return 3 if self.kind in (POSITION, ORIENTATION) else 1


@dataclass(frozen=True)
class Observations:
    """M numbers in blocks, one behind the other.

    group: of each number, the index of its block; row: of the file; sample: index of what was measured at once of a
    frame, and is weighted as one.  sigma: standard deviations, (M,), NaN where not known.  weight: of information.
    mixed: places (R, c) of numbers whose errors go together, with the inverse factors of their covariances,
    (c, c) or (R, c, c).
    """

    blocks: tuple[Block, ...]
    group: Index
    row: Index
    sample: Index
    sigma: Array
    weight: Array
    mixed: tuple[tuple[Index, Array], ...]

    @property
    def kinds(self) -> NDArray[np.str_]:
        """Kind of every number: lengths are "position", angles "orientation", whatever was measured of them."""
        names = np.array([ORIENTATION if block.is_turn else POSITION for block in self.blocks])
        return np.asarray(names[self.group])

    def differences(self, state: State, tools: Mapping[str, int]) -> tuple[Array, Array]:
        """Return measured less predicted, (M,), and the sensitivities of what is predicted, (M, P)."""
        differences, slopes = list[Array](), list[Array]()
        by_frame: dict[str, Array] = {}
        for block in self.blocks:
            if block.kind == ENCODER:
                r, slope = _read(state, block)
                differences.append(r)
                slopes.append(slope)
                continue
            tool = tools[block.frame]
            if block.frame not in by_frame:
                by_frame[block.frame] = state.sensitivities(tool)
            J, rows = by_frame[block.frame], block.rows
            p = state.located.p[tool]
            if block.kind == POSITION:
                r, slope = block.values - p[rows], J[rows, :3]
            elif block.kind == ORIENTATION:
                r = vectors_of(block.values @ state.located.R[tool][rows].transpose(0, 2, 1))
                slope = J[rows, 3:]
            else:
                step, by = p[rows], J[rows, :3]
                if block.kind == TRAVEL:
                    step, by = step - p[rows - 1], by - J[rows - 1, :3]
                length = np.linalg.norm(step, axis=1)
                unit = step / np.maximum(length, _LEAST)[:, np.newaxis]
                r, slope = block.values - length, np.einsum("ni,nip->np", unit, by)
            differences.append(r.reshape(-1))
            slopes.append(slope.reshape(-1, slope.shape[-1]))
        return np.concatenate(differences), np.concatenate(slopes)

    def whiten(self, values: Array, sigma: Array) -> Array:
        """Return numbers, (M,) or (M, P), in units of their standard deviations ``sigma``, (M,)."""
        columns = values.reshape(len(values), -1)
        scaled = columns * (np.sqrt(self.weight) / sigma)[:, np.newaxis]
        for places, factor in self.mixed:
            root = np.sqrt(self.weight[places[:, :1]])
            scaled[places] = root[..., np.newaxis] * (factor @ columns[places])
        return np.asarray(scaled.reshape(values.shape))

    def part(self, kept: Mask) -> Index:
        """Return the index of the numbers whose rows are kept, (R,) of the file."""
        return np.flatnonzero(kept[self.row])


def _read(state: State, block: Block) -> tuple[Array, Array]:
    """Return differences, (R,), and sensitivities, (R, P), of an encoder of a passive coordinate."""
    closing = state.model.closing
    assert closing is not None
    k, c = block.place
    slope = state.passive_slopes()[block.rows, closing.passive.index(block.place)]
    r = block.values - state.q[block.rows, k, c]
    return (np.asarray(np.remainder(r + np.pi, 2.0 * np.pi) - np.pi) if block.is_turn else r), slope


def observations_of(
    poses: MeasuredPoses,
    noise: ArrayLike | None,
    covariance: Mapping[str, ArrayLike],
    encoders: Sequence[Block] = (),
) -> Observations:
    """Return all that was measured, with what is known of its noise.

    Args:
        poses: from a file.
        noise: standard deviations of lengths (m) and of rotations (rad) where the file has none; None: not known.
        covariance: of the errors of a frame, (3, 3) of its position or (6, 6) of position and turn, in place of that;
            or one for each of the R rows, (R, 3, 3) or (R, 6, 6).
        encoders: readings of passive coordinates.

    Raises:
        InputError: a standard deviation is missing in some rows, a covariance is none.
    """
    usual = (np.nan, np.nan) if noise is None else usual_noise(noise)
    blocks, sigma, sample = list[Block](), list[Array](), list[Index]()
    first = 0
    starts: dict[tuple[str, str], tuple[int, Block]] = {}
    for k, (frame, measured) in enumerate(poses.frames.items()):
        for block in _blocks(poses, measured):
            starts[frame, block.kind] = first, block
            blocks.append(block)
            sigma.append(_sigma(poses, measured, block, usual))
            sample.append(np.repeat(block.rows + k * len(poses.q), block.width))
            first += block.rows.size * block.width
    for k, block in enumerate(encoders, start=len(poses.frames)):
        blocks.append(block)
        sigma.append(np.full(block.rows.size, usual[block.is_turn]))
        sample.append(block.rows + k * len(poses.q))
    widths = [block.width * block.rows.size for block in blocks]
    row = np.concatenate([np.repeat(block.rows, block.width) for block in blocks])
    deviations = np.concatenate(sigma)
    mixed = []
    for frame, value in covariance.items():
        places, factor, deviation = _mixed(poses, frame, value, starts)
        mixed.append((places, factor))
        deviations[places] = deviation
    return Observations(
        tuple(blocks),
        np.repeat(np.arange(len(blocks)), widths),
        row,
        np.concatenate(sample),
        deviations,
        poses.weight[row],
        tuple(mixed),
    )


def _blocks(poses: MeasuredPoses, measured: Measured) -> list[Block]:
    follows = np.concatenate([[False], poses.series[1:] == poses.series[:-1]])
    parts = (
        (POSITION, measured.position, np.isfinite(measured.position).all(axis=1)),
        (ORIENTATION, measured.orientation, np.isfinite(measured.orientation).all(axis=(1, 2))),
        (DISTANCE, measured.distance, np.isfinite(measured.distance)),
        (TRAVEL, measured.travel, np.isfinite(measured.travel) & follows),
    )
    return [Block(measured.frame, kind, np.flatnonzero(rows), x[rows]) for kind, x, rows in parts if rows.any()]


def _sigma(poses: MeasuredPoses, measured: Measured, block: Block, usual: Sequence[float]) -> Array:
    """Return standard deviations of a block's numbers, NaN where they are not known."""
    keys = {POSITION: MOTIONS[:3], ORIENTATION: MOTIONS[3:]}.get(block.kind, (block.kind,))
    columns = []
    for key in keys:
        if key in measured.sigma:
            values = measured.sigma[key][block.rows]
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                place = poses.place(int(block.rows[bad[0]]))
                raise InputError(
                    f"{place}: column {measured.frame}.sigma.{key} is empty where {key} is measured; allowed: a number"
                )
            columns.append(values)
        else:
            columns.append(np.full(block.rows.size, usual[block.kind == ORIENTATION]))
    sigma = np.stack(columns, axis=1).reshape(-1)
    known = np.isfinite(sigma)
    if known.any() and not known.all():
        raise InputError(
            f"{poses.source}: {measured.frame}: standard deviations of some of {listed(keys)} alone; allowed: of all"
        )
    return sigma


def usual_noise(noise: ArrayLike) -> tuple[float, float]:
    """Return standard deviations of lengths (m) and of rotations (rad); ArrayError if they are none."""
    return two_divisors("noise", noise, "m and rad")


def two_divisors(label: str, divisors: ArrayLike, units: str) -> tuple[float, float]:
    """Return two numbers that can be divided by; ArrayError if they are none, with the label."""
    try:
        values = np.array(divisors, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != (2,) or not is_divisor(values).all():
        raise ArrayError(f"{label}: {show(str(divisors))}; allowed: {units}, each {ALLOWED_DIVISOR}")
    return float(values[0]), float(values[1])


def _mixed(
    poses: MeasuredPoses, frame: str, value: ArrayLike, starts: Mapping[tuple[str, str], tuple[int, Block]]
) -> tuple[Index, Array, Array]:
    """Return the index of the numbers that a covariance is of, inverse Cholesky factors, and standard deviations."""
    if (frame, POSITION) not in starts:
        known = [name for name, kind in starts if kind == POSITION]
        raise InputError(f"covariance: {show(frame)} has no measured position; allowed: {listed(known)}")
    whole = (frame, ORIENTATION) in starts
    matrices = matrices_of(frame, value, len(poses.q), (3, 6) if whole else (3,))
    first, block = starts[frame, POSITION]
    places = first + 3 * np.arange(block.rows.size)[:, np.newaxis] + np.arange(3)
    if matrices.shape[-1] == 6:
        second, turned = starts[frame, ORIENTATION]
        if not np.array_equal(block.rows, turned.rows):
            raise InputError(f"covariance: {frame} has positions without rotations; allowed: both in all rows")
        places = np.hstack([places, second + 3 * np.arange(block.rows.size)[:, np.newaxis] + np.arange(3)])
    if matrices.ndim == 2:
        return places, whitening_factor(frame, matrices), np.sqrt(np.diagonal(matrices))
    chosen = matrices[block.rows]
    named = [f"{frame} ({poses.place(row)})" for row in block.rows.tolist()]
    factors = np.stack([whitening_factor(of, matrix) for of, matrix in zip(named, chosen, strict=True)])
    return places, factors, np.sqrt(np.diagonal(chosen, axis1=1, axis2=2))


def at_rows(model: ErrorModel, rows: Rows, seen: Observations, x: Array) -> tuple[Array, Array]:
    """Return differences, (M,), and sensitivities, (M, P), with these values."""
    return seen.differences(model.at(x, rows), model.chain.tools)
