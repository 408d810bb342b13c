"""Mistakes that measured poses are made with, told by name: before a fit by ranges, after it by what explains more."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..geometry.error_model import Rows
from ..geometry.observations import ORIENTATION, POSITION, Observations
from ..geometry.poses import Measured, MeasuredPoses
from ..geometry.rotations import FOUR, READINGS
from ..geometry.solving import Fit
from ..geometry.stations import Chain
from .variants import Rms

Array = NDArray[np.float64]
Places = NDArray[np.intp]

TURN = 0.1  # rad: rms of orientations that are read in another convention, or more
OFF = 0.03  # of the reach: rms of positions that something is wrong with
_BETTER = 5.0  # times less: what an alternative must leave to be the cause
_ALIKE = 1e-3  # rad, or of the reach: poses that differ by less are all alike
_COPIED = 1e-12  # relative
_FAR = 5.0  # reaches: positions of one series spread no further
_ROUND = 4.0 * np.pi  # rad: joints without limits turn no further
_TOGETHER = 4.0  # standard deviations of a correlation that is none


def refuse_impossible(poses: MeasuredPoses, chain: Chain, rows: Rows) -> None:
    """Refuse what ranges alone show.

    Raises:
        InputError: a column copies another, poses are all alike, angles are degrees or a motor's, lengths millimetres.
    """
    _refuse_copies(poses)
    _refuse_alike(poses, chain)
    _refuse_angles(poses, chain, rows)
    stroke = sum(
        float(np.ptp(rows.readings[:, k, 2])) for k, station in enumerate(chain.stations) if station.principal == 2
    )
    for frame, measured in poses.frames.items():
        for number in np.unique(poses.series):
            inside = (poses.series == number) & np.isfinite(measured.position[:, 0])
            spread = float(np.ptp(measured.position[inside], axis=0).max()) if inside.any() else 0.0
            if spread > _FAR * (chain.reach + stroke):
                raise InputError(
                    f"{poses.source}: {frame}.x ... {frame}.z spread over {spread:.4g} m, the robot's reach is"
                    f" {chain.reach:.3g} m: millimetres for metres? allowed: m"
                )


def _refuse_copies(poses: MeasuredPoses) -> None:
    """InputError where two columns of coordinates, or of measurements, have the same numbers in all rows."""
    columns: dict[str, Array] = dict(zip(poses.coordinates, poses.q.T, strict=True))
    seen: dict[str, Array] = {}
    for frame, measured in poses.frames.items():
        seen |= {f"{frame}.{axis}": values for axis, values in zip("xyz", measured.position.T, strict=True)}
        seen[f"{frame}.distance"] = measured.distance
    for group in (columns, seen):
        known: list[tuple[str, Array]] = []
        for name, values in group.items():
            there = np.isfinite(values)
            if there.sum() < 3 or np.ptp(values[there]) == 0.0:
                continue
            for other, before in known:
                both = there & np.isfinite(before)
                if both.sum() > 2 and np.abs(values - before)[both].max() <= _COPIED * np.abs(values[both]).max():
                    raise InputError(
                        f"{poses.source}: column {name} copies column {other}; allowed: what was measured of each"
                    )
            known.append((name, values))


def _refuse_alike(poses: MeasuredPoses, chain: Chain) -> None:
    spread = np.ptp(poses.q, axis=0)
    if len(poses.q) > 1 and (spread < _ALIKE * max(chain.reach, 1.0)).all():
        name = poses.coordinates[int(spread.argmax())]
        raise InputError(
            f"{poses.source}: poses are all alike: no coordinate moves by more than {spread.max():.2g} ({name});"
            " allowed: poses over the workspace"
        )


def _refuse_angles(poses: MeasuredPoses, chain: Chain, rows: Rows) -> None:
    """InputError where joints turn further than they can: degrees, or angles of motors."""
    wrong, as_degrees = list[str](), True
    for k, station in enumerate(chain.stations):
        if station.principal is None or station.principal < 3 or station.joint is None:
            continue
        values = rows.readings[:, k, station.principal]
        limits = station.joint.limits
        low, high = limits if limits is not None and limits[0] < limits[1] else (-_ROUND, _ROUND)
        room = 0.5 * max(high - low, 1.0)
        if values.min() < low - room or values.max() > high + room:
            wrong.append(
                f"{station.name} goes from {values.min():.4g} to {values.max():.4g} rad,"
                f" allowed: {low:.4g} to {high:.4g}"
            )
            degrees = np.deg2rad(values)
            as_degrees &= bool(degrees.min() >= low - 0.1 * room and degrees.max() <= high + 0.1 * room)
    if wrong:
        cause = "degrees for radians" if as_degrees else "motor angles for joint angles, or degrees for radians"
        raise InputError(f"{poses.source}: {wrong[0]}: {cause}? allowed: angles of joints in rad")


@dataclass(frozen=True)
class Alternative:
    """Another way to read a file: in a few words, and what it makes of the poses."""

    text: str
    poses: MeasuredPoses


def alternatives(poses: MeasuredPoses, rms: Rms, reach: float) -> Iterator[Alternative]:
    """Other readings of a file whose residuals are too large to be those of a robot."""
    if rms.get(ORIENTATION, 0.0) > TURN:
        yield from _turned(poses)
    if rms.get(POSITION, 0.0) > OFF * reach:
        for text, factor in (("millimetres for metres", 1e-3), ("metres for millimetres", 1e3)):
            yield Alternative(text, _with_frames(poses, partial(_scaled, factor=factor)))
        yield Alternative("degrees for radians (coordinates)", replace(poses, q=np.deg2rad(poses.q)))
        yield Alternative("coordinates of the opposite sense", replace(poses, q=-poses.q))


def _turned(poses: MeasuredPoses) -> Iterator[Alternative]:
    widths = {m.written.shape[1] for m in poses.frames.values() if m.written is not None}
    for width in widths:
        readings: Mapping[str, Callable[[Array], Array]] = FOUR if width == 4 else READINGS
        units = (("", 1.0),) if width == 4 else (("", 1.0), (" in degrees", np.pi / 180.0))
        for name, reading in readings.items():
            for unit, factor in units:
                for other in ("", ", from the frame to the device"):

                    def read(
                        m: Measured,
                        reading: Callable[[Array], Array] = reading,
                        factor: float = factor,
                        back: bool = bool(other),
                        width: int = width,
                    ) -> Measured:
                        if m.written is None or m.written.shape[1] != width:
                            return m
                        there = np.isfinite(m.written).all(axis=1)
                        turned = m.orientation.copy()
                        turned[there] = reading(factor * m.written[there])
                        return replace(m, orientation=turned.transpose(0, 2, 1) if back else turned)

                    yield Alternative(f"{name}{unit}{other}", _with_frames(poses, read))


def _with_frames(poses: MeasuredPoses, change: Callable[[Measured], Measured]) -> MeasuredPoses:
    return replace(poses, frames={name: change(measured) for name, measured in poses.frames.items()})


def _scaled(measured: Measured, factor: float) -> Measured:
    return replace(
        measured,
        position=factor * measured.position,
        distance=factor * measured.distance,
        travel=factor * measured.travel,
    )


def judge_alternatives(
    poses: MeasuredPoses, rms: Rms, reach: float, again: Callable[[MeasuredPoses], Rms]
) -> list[str]:
    """Try other readings where residuals are too large; notes about them.

    Args:
        poses: as they were read.
        rms: what is left of them after the full fit.
        reach: of the robot, m.
        again: what is left when poses are fitted that were read in another way.

    Raises:
        InputError: another reading leaves several times less: that is what the file has.
    """
    tried: list[tuple[float, str, Rms]] = []
    limits = {ORIENTATION: TURN, POSITION: OFF * reach}
    large = [kind for kind, value in rms.items() if value > limits[kind]]
    for other in alternatives(poses, rms, reach):
        found = again(other.poses)
        share = max(found.get(kind, rms[kind]) / rms[kind] for kind in large)
        tried.append((share, other.text, found))
    if not tried:
        return []
    tried.sort(key=lambda entry: entry[0])
    share, text, found = tried[0]
    if share * _BETTER < 1.0:
        raise InputError(
            f"{poses.source}: as it is read {_said(rms)} is left; read as {text}: {_said(found)}; allowed: m and rad,"
            " orientations as --rotation (rotation=) says"
        )
    best = "; ".join(f"{text}: {_said(found)}" for _, text, found in tried[:3])
    return [f"residuals are large ({_said(rms)}); other readings leave no less: {best}"]


def _said(rms: Rms) -> str:
    units = {POSITION: "m", ORIENTATION: "rad"}
    return ", ".join(f"{value:.3g} {units[kind]} of {kind}" for kind, value in rms.items())


def correlation_within(seen: Observations, fit: Fit, groups: Places) -> tuple[float, float, float]:
    """Correlation of residuals that were measured at once, its standard error if there is none, and how many they are.

    groups: number of what was measured at once of every number, (M,).
    """
    white = seen.whiten(fit.residuals, fit.sigma) * np.sqrt(fit.trust)
    kinds = seen.kinds
    products = pairs = 0.0
    sizes: list[int] = []
    for key in range(3):
        for kind in (POSITION, ORIENTATION):
            axis = _axis(seen) == key
            inside = np.flatnonzero((kinds == kind) & axis)
            if not inside.size:
                continue
            sums = np.bincount(groups[inside], white[inside])
            squares = np.bincount(groups[inside], white[inside] ** 2)
            many = np.bincount(groups[inside])
            products += float((sums**2 - squares).sum()) / 2.0
            pairs += float((many * (many - 1)).sum()) / 2.0
            sizes += many[many > 0].tolist()
    if pairs == 0.0:
        return 0.0, np.inf, 1.0
    scale = float((white**2).mean())
    return (
        products / pairs / max(scale, 1e-300),
        float(1.0 / np.sqrt(pairs)),
        float(np.mean(np.square(sizes)) / np.mean(sizes)),
    )


def _axis(seen: Observations) -> Places:
    """Which of a block's components every number is, (M,)."""
    return np.concatenate([np.tile(np.arange(block.width), block.rows.size) for block in seen.blocks])


def at_once(poses: MeasuredPoses) -> Places:
    """Number, from 0, of what was measured at once, of every row: by ``body``, or where nothing moved between rows."""
    if poses.body is not None:
        return np.unique(poses.body, return_inverse=True)[1].reshape(-1).astype(np.intp)
    moved = np.any(np.diff(poses.q, axis=0) != 0.0, axis=1) | (np.diff(poses.series) != 0)
    return np.concatenate([[0], np.cumsum(moved)]).astype(np.intp)


def design_effect(poses: MeasuredPoses, seen: Observations, fit: Fit, units: Places) -> tuple[float, Sequence[str]]:
    """By how much variances grow because points were measured together, and a note that says so."""
    rho, error, many = correlation_within(seen, fit, units[seen.row])
    if many <= 1.0 or rho < _TOGETHER * error or rho < 0.05:
        return 1.0, ()
    effect = 1.0 + (many - 1.0) * rho
    said = "body" if poses.body is not None else "points at one pose"
    return effect, (
        f"points of one rigid body are not independent ({said}: correlation {rho:.2f} of residuals): deviations are"
        f" {np.sqrt(effect):.2f} times as large as if they were",
    )
