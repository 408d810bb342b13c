"""Mistakes that measured poses are made with, told by name before a fit; what was measured at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Array, Index
from ...errors import InputError
from ...names import listed
from ..geometry.error_model import OFFSET, ZERO, Rows
from ..geometry.observations import DISTANCE, ORIENTATION, POSITION, TRAVEL, Observations
from ..geometry.poses import MeasuredPoses
from ..geometry.solve import Fit, Problem
from ..geometry.stations import Chain
from ..odd_angles import odd_angles_of

_ALIKE = 1e-3  # rad, or of the reach: poses that differ by less are all alike
_ONE_PLACE = 3e-4  # of the reach: measured places that spread less are one
_COPIED = 1e-12  # relative
_FAR = 5.0  # reaches: positions of one series spread no further
_LEAST, _MOST = 0.05, 2.5  # reaches: positions that may be in metres spread that far
_HUGE = 0.3  # of the reach: lengths that are further off are those of another robot, and are not written
_FAR_OFF = 30.0  # expected sizes: offsets that are larger are those of another robot
_TOGETHER = 4.0  # standard deviations of a correlation that is none


def refuse_impossible(poses: MeasuredPoses, chain: Chain) -> None:
    """Refuse what no measurement has.

    Raises:
        InputError: a column copies another, or poses are all alike.
    """
    _refuse_copies(poses)
    _refuse_alike(poses, chain)


def refuse_no_length(problem: Problem, source: str) -> None:
    """Refuse positions that stay at one place in every series, where all lengths of the robot are unknown.

    A smaller robot has smaller residuals then, and one without any length none.

    Raises:
        InputError: no length was measured.
    """
    model, rows = problem.model, problem.rows
    if any(block.kind in (DISTANCE, TRAVEL) for block in problem.seen.blocks):
        return
    places = [block for block in problem.seen.blocks if block.kind == POSITION]
    series = [rows.series[block.rows] for block in places]
    spread = [
        float(np.ptp(block.values[numbers == number], axis=0).max())
        for block, numbers in zip(places, series, strict=True)
        for number in np.unique(numbers).tolist()
    ]
    if not places or max(spread) > _ONE_PLACE * model.chain.reach or len(places) > 1 or _is_scale_known(problem):
        return
    raise InputError(
        f"{source}: no length was measured: {places[0].frame} stays at one place in each series, and the smaller the"
        " robot is taken, the smaller are the residuals; allowed: two places of a known distance in one series (one"
        " position of a tracker), a column of distances, or a length that stays as described (--fixed, fixed=)"
    )


def _is_scale_known(problem: Problem) -> bool:
    """Return whether a length of the robot stays as described, or is read: of a translation."""
    model = problem.model
    active = {(q.station, q.coordinate) for q in (model.parameters[i] for i in problem.active)}
    moving = {k for tool in model.chain.tools.values() for k in model.chain.ancestors(tool)}
    for k in sorted(moving):
        station = model.chain.stations[k]
        if station.principal is not None and station.principal < 3 and np.ptp(problem.rows.readings[:, k, :3]) > 0.0:
            return True
        if station.joint is None or station.principal is None:
            continue
        length = station.before[:3, :3].T @ station.before[:3, 3]
        if any(abs(length[c]) > _ALIKE * model.chain.reach and (k, c) not in active for c in range(3)):
            return True
    return False


def suspicion_of(poses: MeasuredPoses, chain: Chain, rows: Rows) -> str:
    """Return a message about ranges that the robot does not have: of angles and of positions.

    "" where there are none such.
    """
    angles = odd_angles(poses, chain, rows)
    if angles:
        return angles
    stroke = sum(
        float(np.ptp(rows.readings[:, k, 2])) for k, station in enumerate(chain.stations) if station.principal == 2
    )
    for frame, measured in poses.frames.items():
        for number in np.unique(poses.series):
            inside = (poses.series == number) & np.isfinite(measured.position[:, 0])
            spread = float(np.ptp(measured.position[inside], axis=0).max()) if inside.any() else 0.0
            if spread > _FAR * (chain.reach + stroke):
                whole = chain.reach + stroke
                guess = ": millimetres for metres?" if _LEAST * whole < 1e-3 * spread < _MOST * whole else ";"
                return (
                    f"{poses.source}: {frame}.x ... {frame}.z spread over {spread:.4g} m, the robot's reach is"
                    f" {chain.reach:.3g} m{guess} allowed: m"
                )
    return ""


def _refuse_copies(poses: MeasuredPoses) -> None:
    """Raise InputError where two columns of coordinates, or of measurements, have the same numbers in all rows."""
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


def odd_angles(poses: MeasuredPoses, chain: Chain, rows: Rows) -> str:
    """Return a message where joints turn further than they can: degrees, or angles of motors; else ""."""
    turning = [
        (station.name, station.joint, rows.readings[:, k, station.principal])
        for k, station in enumerate(chain.stations)
        if station.joint is not None and station.principal is not None and station.principal >= 3
    ]
    return odd_angles_of(poses.source, turning)


def implausible(problem: Problem, fit: Fit) -> list[str]:
    """Return a note about lengths that no robot of that size is off by: the fit is of another robot, or of none."""
    model, limit = problem.model, _HUGE * problem.model.chain.reach
    off = fit.x - model.nominal
    lengths = [
        i for i in problem.active if model.parameters[i].kind in (ZERO, OFFSET) and model.parameters[i].unit == "m"
    ]
    huge = [f"{model.parameters[i].name} by {off[i]:.3g} m" for i in lengths if abs(off[i]) > limit]
    if not huge:
        return []
    return [
        f"the fit is of another robot: {listed(huge)} off, more than {limit:.3g} m; what was measured does not say its"
        " lengths, or is of another robot; allowed: positions that spread over the workspace, distances, or lengths"
        " that stay as described (fixed)"
    ]


def far_off(problem: Problem, fit: Fit) -> list[str]:
    """Return a note about offsets that are too large for a robot that was built as it is described."""
    parameters = problem.model.parameters
    off = (fit.x - problem.model.nominal) / problem.model.sizes
    far = [i for i in problem.active if parameters[i].kind in (ZERO, OFFSET) and abs(off[i]) > _FAR]
    if not far:
        return []
    named = listed(
        [f"{parameters[i].name} by {fit.x[i] - parameters[i].nominal:.3g} {parameters[i].unit}" for i in far]
    )
    return [f"further off than a robot is built: {named}; is a zero, or a length, another one than in the description?"]


def correlation_within(seen: Observations, fit: Fit, groups: Index) -> tuple[float, float, float]:
    """Return the correlation of residuals measured at once, its standard error without any, and their number.

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


def _axis(seen: Observations) -> Index:
    """Return which of a block's components every number is, (M,)."""
    return np.concatenate([np.tile(np.arange(block.width), block.rows.size) for block in seen.blocks])


def at_once(poses: MeasuredPoses) -> Index:
    """Return for every row the number, from 0, of the group that was measured at once.

    Groups are those of ``body``, or else rows between which nothing moved.
    """
    if poses.body is not None:
        return np.unique(poses.body, return_inverse=True)[1].reshape(-1).astype(np.intp)
    moved = np.any(np.diff(poses.q, axis=0) != 0.0, axis=1) | (np.diff(poses.series) != 0)
    return np.concatenate([[0], np.cumsum(moved)]).astype(np.intp)


def design_effect(poses: MeasuredPoses, seen: Observations, fit: Fit, units: Index) -> tuple[float, Sequence[str]]:
    """Return by how much variances grow because points were measured together, and a note that says so."""
    rho, error, many = correlation_within(seen, fit, units[seen.row])
    if many <= 1.0 or rho < _TOGETHER * error or rho < 0.05:
        return 1.0, ()
    effect = 1.0 + (many - 1.0) * rho
    said = "body" if poses.body is not None else "points at one pose"
    return effect, (
        f"points of one rigid body are not independent ({said}: correlation {rho:.2f} of residuals): deviations are"
        f" {np.sqrt(effect):.2f} times as large as if they were",
    )
