"""Findings in residuals that a fit does not have: rows that are off, errors that go on, drift, patterns along joints.

All of it is looked at by default, on the full fit's residuals; where rows are off, on those of a robust fit without
them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...optional import optional_import
from ...shown import prefixed
from ..geometry.error_model import PLACEMENT, drive_terms
from ..geometry.observations import at_rows
from ..geometry.poses import MeasuredPoses
from ..geometry.solve import HIDDEN, Fit, Problem, fitted, whitened
from .drives import EXACT, best_group, is_round_off, with_columns
from .serial import Serial, serial_of

CHANCE = 1e-3  # that a row is called off, or a pattern is named, where there is nothing
DRIFT = "drift"
_EFFICIENCY = 0.37  # of a standard deviation from the median of the magnitude
_LITTLE = 5  # numbers more than unknowns, below which little is checked
_LOOSE = 0.05  # least share of a number that a fit leaves open
_LARGE = 0.1  # rad, m or 1: a pattern that no drive has
_NAMED = 12  # rows in a note
_MOST = 8  # patterns that are named


@dataclass(frozen=True)
class Pattern:
    """A pattern in residuals: drift over time, or the error of a drive.

    name: "drift", or the beginning of the drive's term ("joints.joint2.backlash").
    probability: of so much by chance, with all patterns that were tried.
    size: what it amounts to, m or rad, or of a gain or a coupling 1; of a drift the displacement of the base before the
    device from the first row to the last, m.  turn: of a drift, rad; else 0.
    """

    name: str
    probability: float
    size: float
    turn: float = 0.0


@dataclass(frozen=True)
class Diagnosis:
    """Findings in the residuals of a calibration.

    outlying: rows that are further off than chance has it, with their distance in usual standard deviations.
    correlation: of errors in neighbouring rows; 0 where none shows.
    effective: share of the numbers that independent ones would need to be; 1 without correlation.
    widened: by which deviations have grown for it: the largest ratio.
    patterns: what drift and drives would explain, the most significant first.
    is_checked: whether there are more numbers than unknowns, so that residuals say anything.
    """

    outlying: tuple[tuple[int, float], ...] = ()
    correlation: float = 0.0
    effective: float = 1.0
    widened: float = 1.0
    patterns: tuple[Pattern, ...] = ()
    is_checked: bool = True


def diagnosed(
    problem: Problem, full: Fit, rank: int, loss: str | None, *, is_serial: bool
) -> tuple[Diagnosis, Serial | None]:
    """Look at the residuals of the full fit.

    Args:
        problem: the full one.
        full: its fit.
        rank: independent combinations that the numbers show.
        loss: that of the fit.
        is_serial: whether to look for what neighbouring rows have in common: not where several were measured at once.

    Returns:
        the diagnosis, and what widens deviations, or None.
    """
    if problem.seen.group.size <= rank:
        return Diagnosis(is_checked=False), None
    if is_round_off(problem.seen.whiten(full.residuals, full.sigma) * np.sqrt(full.trust)):
        return Diagnosis(), None
    fit, outlying = full, outlying_rows(problem, full)
    if outlying:
        if loss is None:
            fit = fitted(problem, full.x, loss="huber")
            outlying = outlying_rows(problem, fit)
        rows = np.array([row for row, _ in outlying], dtype=np.intp)
        fit = replace(fit, trust=np.where(np.isin(problem.seen.row, rows), 1e-12, fit.trust))
    r, A = at_rows(problem.model, problem.rows, problem.seen, fit.x)
    white, S = whitened(problem, fit, r, A)
    U = _basis(S[:, problem.active])
    serial = serial_of(problem.seen, problem.rows.series, white - U @ (U.T @ white), U) if is_serial else None
    patterns = _patterns(problem, fit, white, U, 1.0 if serial is None else 1.0 / serial.effective)
    if serial is None:
        return Diagnosis(outlying, patterns=patterns), None
    return Diagnosis(outlying, serial.rho, serial.effective, patterns=patterns), serial


def outlying_rows(problem: Problem, fit: Fit) -> tuple[tuple[int, float], ...]:
    """Return rows with a vector that is further off than chance has it, with its length in usual standard deviations.

    The usual ones are from the median of the vectors' lengths, block by block, so that outliers do not hide themselves.
    """
    with optional_import("SciPy", "calibrate needs"):
        from scipy.special import chdtri, fdtrc
    seen = problem.seen
    white = seen.whiten(fit.residuals, fit.sigma) / np.sqrt(np.maximum(1.0 - fit.leverage, _LOOSE))
    for group, block in enumerate(seen.blocks):
        inside = seen.group == group
        lengths = np.linalg.norm(white[inside].reshape(-1, block.width), axis=1)
        white[inside] /= max(float(np.median(lengths) / np.sqrt(chdtri(block.width, 0.5))), EXACT)
    samples, place = np.unique(seen.sample, return_inverse=True)
    squares, many = np.bincount(place, white**2), np.bincount(place)
    freedoms = max(_EFFICIENCY * fit.freedoms, 1.0)
    off = np.flatnonzero(fdtrc(many, freedoms, squares / many) * samples.size < CHANCE)
    row_of = np.zeros(samples.size, dtype=np.intp)
    row_of[place] = seen.row
    outlying: dict[int, float] = {}
    for k in off.tolist():
        row = int(row_of[k])
        outlying[row] = max(outlying.get(row, 0.0), float(np.sqrt(squares[k])))
    return tuple(sorted(outlying.items(), key=lambda entry: -entry[1]))


def _basis(S: Array) -> Array:
    """Return an orthonormal basis of the directions that a fit takes away, (M, k)."""
    U, values, _ = np.linalg.svd(S, full_matrices=False)
    return np.asarray(U[:, (values > HIDDEN) & (values > 1e-9 * values.max(initial=0.0))])


def _patterns(problem: Problem, fit: Fit, white: Array, U: Array, inflation: float) -> tuple[Pattern, ...]:
    """Return patterns that explain more than chance does, one after the other, on the linearised problem.

    inflation: by which errors that go on make a drift look larger, as a variance.
    """
    known = {problem.model.parameters[i].name for i in problem.active}
    groups = [group for group in drive_terms(problem.model, problem.rows) if group[0].name not in known]
    _, S, columns = with_columns(problem, fit, groups)
    columns.insert(0, _drift_columns(problem, S))
    left = white - U @ (U.T @ white)
    freedoms, tried, patterns = fit.freedoms, len(columns), list[Pattern]()
    open_groups = list(range(len(columns)))
    while open_groups and len(patterns) < _MOST:
        by_chance = [inflation if k == 0 else 1.0 for k in open_groups]
        best = best_group(left, U, [columns[k] for k in open_groups], freedoms, by_chance)
        if best is None or best.probability * tried >= CHANCE:
            break
        k = open_groups.pop(best.index)
        if k == 0:
            sizes = problem.model.sizes[_base_places(problem)]
            values = best.values * sizes
            patterns.append(Pattern(DRIFT, best.probability * tried, _norm(values[:3]), _norm(values[3:])))
        else:
            group = groups[k - 1]
            values = best.values * np.array([term.size for term in group])
            name = group[0].name.removesuffix(".cos")
            patterns.append(Pattern(name, best.probability * tried, _norm(values)))
        U = np.hstack([U, best.Q])
        left = left - best.Q @ (best.Q.T @ left)
        freedoms -= best.Q.shape[1]
    return tuple(patterns)


def _norm(values: Array) -> float:
    return float(np.linalg.norm(values))


def _base_places(problem: Problem) -> list[int]:
    """Return parameters of the base before the device, six of the first series."""
    parameters = problem.model.parameters
    first = min(problem.model.bases)
    return [i for i, q in enumerate(parameters) if q.kind == PLACEMENT and q.station == 0 and q.series == first]


def _drift_columns(problem: Problem, S: Array) -> Array:
    """Return sensitivities of the base's six coordinates times time, (M, 6).

    Rows at equal distances, from -1/2 to 1/2.
    """
    parameters = problem.model.parameters
    total = np.zeros((len(S), 6))
    for i, parameter in enumerate(parameters):
        if parameter.kind == PLACEMENT and parameter.station == 0:
            total[:, parameter.coordinate] += S[:, i]
    count = len(problem.rows.series)
    time = np.arange(count) / max(count - 1, 1) - 0.5
    return np.asarray(total * time[problem.seen.row][:, np.newaxis])


def diagnosis_notes(about: Diagnosis, poses: MeasuredPoses, problem: Problem, rank: int) -> list[str]:
    """Return notes about outliers, correlation and patterns, for people."""
    if not about.is_checked:
        many = problem.seen.group.size
        return [
            f"nothing can be checked: {many} numbers of {len(poses.q)} rows for {rank} unknowns; residuals are no"
            " measure of anything, and without --noise there are no deviations"
        ]
    notes = list[str]()
    if (left := problem.seen.group.size - rank) < _LITTLE:
        notes.append(f"{left} numbers more than unknowns: residuals check little")
    if about.outlying:
        said = ", ".join(f"{_row(poses, row)} by {size:.3g}" for row, size in about.outlying[:_NAMED])
        more = f" and {len(about.outlying) - _NAMED} more" if len(about.outlying) > _NAMED else ""
        notes.append(
            f"outlying rows, by how many usual standard deviations they are off: {said}{more}; look at them, or count"
            " them less (--loss)"
        )
    if about.correlation:
        notes.append(
            f"errors go on from row to row: correlation {about.correlation:.2f} of neighbours in the measured order, as"
            f" if of {100 * about.effective:.0f} % of the rows; deviations are up to {about.widened:.3g} times as large"
            " as if they did not"
        )
    return notes + [_pattern_note(pattern) for pattern in about.patterns]


def _row(poses: MeasuredPoses, row: int) -> str:
    return f"row {row}" if poses.lines is None else f"row {row} (line {poses.lines[row]})"


def _pattern_note(pattern: Pattern) -> str:
    chance = f"by chance with a probability of {max(pattern.probability, 1e-300):.1g}"
    if pattern.name == DRIFT:
        return (
            f"residuals drift over time: as if the base or the device moved by {prefixed(pattern.size, 'm')} and"
            f" {prefixed(pattern.turn, 'rad')} from the first row to the last ({chance}); a new series where it"
            " happened fits it"
        )
    if pattern.size > _LARGE:
        why = "no drive has that much: is the column of that joint read rightly, its sense, unit and order?"
        return f"residuals show {pattern.name}, about {pattern.size:.2g} ({chance}): {why}"
    remedy = "--transmission-errors (drives=True) fits it"
    return f"residuals show {pattern.name}, about {pattern.size:.2g} ({chance}); {remedy}"
