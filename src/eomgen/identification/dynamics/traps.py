"""Mistakes that records of motions are made with, told by name: before a fit by sizes, after it by residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...arrays import Array, Mask
from ...errors import InputError
from ...motion.files import MeasuredMotion
from ...motion.smoothing import Differentiator
from ...names import component_name
from ...robot.coordinates import force_unit_of, unit_of
from ...robot.value import ANGULAR, Robot
from ..estimating import FIRST
from ..odd_angles import odd_angles_of
from .further import STRIBECK, Sought, State
from .regression import Data, Solution

_SLOW, _FAR_APART = 0.05, 0.1  # rate in rad/s or m/s that nothing exceeds, and s between samples: times are no seconds
_MOVES = 1e-3  # of the fastest coordinate: slower ones may be noise
_ROUND_OFF = 1e-12  # of a coordinate from one sample to the next
_ALIKE = 0.2  # of the rms of a derivative: by so much a column of rates may be off
_FACTORS = (  # of a rate over the derivative of its coordinate
    (1e-3, "times in milliseconds"),
    (1e3, "times in milliseconds"),
    (180.0 / np.pi, "rates in degrees per second and coordinates in rad, or the other way round"),
    (np.pi / 180.0, "rates in degrees per second and coordinates in rad, or the other way round"),
    (-1.0, "another sign"),
)
_SATURATED = 1e-6  # of a drive's span, next to an end of it
_RUN, _SHARE = 12, 2e-3  # samples and share of all that stand there beside each other
_USUAL, _JUMP, _JUMPS_BY = 0.99, 12.0, 1e-4  # quantile of bends; times that, and of a coordinate's span: a jump
_SLOW_SHARE, _FEWEST, _CLEARLY = 2.0, 4, 4.0  # times the slowest rate, samples, standard errors: friction there
_NEAR = 2.0  # of the slowest rate: Stribeck's rate there is extrapolated
BAD = 0.3  # of a drive's rms: residuals that something is wrong with
BETTER = 3.0  # times less: what another reading must leave to be the cause


def refuse_impossible(robot: Robot, motion: MeasuredMotion, step: float) -> None:
    """Refuse what sizes alone show.

    Raises:
        InputError: angles are degrees or those of motors, times are milliseconds, rates are not those of the
            coordinates, or a drive is 0 at all times.
    """
    _refuse_angles(robot, motion)
    narrow = Differentiator(FIRST, step)
    slopes = narrow(motion.q, 1)
    if motion.v is not None:
        _refuse_foreign(motion, slopes, narrow(motion.v), ".rate")
        if motion.a is not None:
            _refuse_foreign(motion, narrow(motion.v, 1), narrow(motion.a), ".acceleration")
    fastest = float(np.abs(slopes).max())
    if step >= _FAR_APART and fastest < _SLOW and np.ptp(motion.q, axis=0).max() > _SLOW:
        raise InputError(
            f"{motion.source}: samples are {step:.4g} s apart, and nothing moves faster than {fastest:.3g} rad/s or"
            " m/s: milliseconds for seconds? allowed: times in s"
        )
    for name in motion.driven:
        if not motion.u[:, motion.coordinates.index(name)].any():
            raise InputError(
                f"{motion.source}: {component_name(name, 'drive')} is 0 in every sample; allowed: measured drives, and"
                " no column where there is none"
            )


def spoiled(motion: MeasuredMotion) -> tuple[Mask, list[str]]:
    """Find samples in which a drive stands at its greatest or least value, or beside which a coordinate jumps.

    Returns:
        Whether a sample is no good, (T, n), by the coordinate whose force is not known there; and warnings.
    """
    faulty, warnings = np.zeros(motion.q.shape, dtype=np.bool_), []
    for name in motion.driven:
        i = motion.coordinates.index(name)
        u = motion.u[:, i]
        for end in (u.max(), u.min()):
            at = np.abs(u - end) <= _SATURATED * np.ptp(u)
            runs = at[:-1] & at[1:]
            if np.ptp(u) > 0.0 and runs.sum() >= max(_RUN, _SHARE * len(u)):
                faulty[:, i] |= at
                warnings.append(
                    f"{component_name(name, 'drive')} stands at {end:.4g} in {int(at.sum())} samples: saturated? they"
                    " are left out"
                )
    intervals = np.diff(motion.t)
    middles = motion.t[:-1] + 0.5 * intervals
    share, size = (middles[1:-1] - middles[:-2]) / (middles[2:] - middles[:-2]), float(np.median(intervals))
    for name in motion.measured if len(intervals) > 2 else ():
        i = motion.coordinates.index(name)
        steps = np.diff(motion.q[:, i])
        slopes = steps / intervals * size
        bend = np.abs(slopes[1:-1] - (1.0 - share) * slopes[:-2] - share * slopes[2:])
        usual = max(float(np.quantile(bend, _USUAL)), _ROUND_OFF * float(np.abs(motion.q[:, i]).max()))
        jumps = np.flatnonzero(bend > max(_JUMP * usual, _JUMPS_BY * float(np.ptp(motion.q[:, i]))))
        if jumps.size:
            at = int(jumps[bend[jumps].argmax()]) + 1
            faulty[np.unique(np.clip(jumps[:, None] + np.arange(4), 0, len(faulty) - 1))] = True
            warnings.append(
                f"{name} jumps by {steps[at]:.3g} rad or m at {motion.t[at]:.6g} s: an encoder that lost counts?"
                " samples beside it are left out"
            )
    return faulty, warnings


def offset_warnings(motion: MeasuredMotion, robot: Robot, left: Callable[[MeasuredMotion], float]) -> list[str]:
    """Warn of joints whose angles fit much better with an offset of a quarter or half a revolution.

    Args:
        motion: whose residuals are large.
        robot: of which.
        left: what a motion leaves, as a sum of logarithms of residuals.
    """
    before, best = left(motion), (0.0, "")
    for joint in robot.joints:
        name = component_name(joint.name, joint.principal)
        if joint.principal not in ANGULAR or name not in motion.measured:
            continue
        for degrees in (90, -90, 180):
            q = motion.q.copy()
            q[:, motion.coordinates.index(name)] += np.deg2rad(degrees)
            gain = before - left(replace(motion, q=q))
            if gain > max(best[0], np.log(BETTER)):
                text = f"{name} + {degrees} degrees leaves {np.exp(gain):.3g} times less: is its zero there?"
                best = gain, text
    return [best[1]] if best[1] else []


def _refuse_angles(robot: Robot, motion: MeasuredMotion) -> None:
    """Raise InputError where joints turn further than they can: degrees, or angles of motors."""
    coupled = {name for coupling in robot.own_couplings for name in (coupling.of, *coupling.to)}
    turning = []
    for joint in robot.joints:
        name = component_name(joint.name, joint.principal)
        if joint.principal in ANGULAR and name in motion.measured and (joint.limits is not None or name not in coupled):
            turning.append((name, joint, motion.q[:, motion.coordinates.index(name)]))
    if message := odd_angles_of(motion.source, turning):
        raise InputError(message)


def _refuse_foreign(motion: MeasuredMotion, slopes: Array, measured: Array, suffix: str) -> None:
    """Raise InputError where a column is not the derivative of the one that it should be."""
    largest = float(np.sqrt(np.mean(slopes**2, axis=0)).max())
    largest = max(largest, _ROUND_OFF * float(np.abs(motion.q).max()) / float(motion.t[1] - motion.t[0]) / _MOVES)
    for name in motion.measured:
        i = motion.coordinates.index(name)
        size = float(np.sqrt(np.mean(slopes[:, i] ** 2)))
        if size <= _MOVES * largest or np.sqrt(np.mean((measured[:, i] - slopes[:, i]) ** 2)) <= _ALIKE * size:
            continue
        factor = float(measured[:, i] @ slopes[:, i]) / float(slopes[:, i] @ slopes[:, i])
        off = np.sqrt(np.mean((measured[:, i] - factor * slopes[:, i]) ** 2))
        if off > _ALIKE * abs(factor) * size:
            continue  # noise, or a motion of which the filter takes much away
        cause = next((text for x, text in _FACTORS if abs(factor / x - 1.0) < 0.1), "other units")
        raise InputError(
            f"{motion.source}: {name}{suffix} is {factor:.4g} times the derivative of what it belongs to: {cause}?"
            " allowed: s, and m or rad"
        )


def other_readings(data: Data, solution: Solution) -> list[str]:
    """Return warnings about drives that fit much better with the other sign, and about too large residuals."""
    share = solution.fitted / data.drive_sizes()
    if share.max() < BAD:
        return []
    size = float(np.log(np.maximum(solution.fitted, 1e-300)).sum())
    for row, name in enumerate(data.names):
        turned = Solution.of(data.turned(row), solution.half)
        better = size - float(np.log(np.maximum(turned.fitted, 1e-300)).sum())
        if better > np.log(BETTER):
            return [f"{name}.drive in the other sense leaves {np.exp(better):.3g} times less: another sign?"]
    worst = int(share.argmax())
    return [
        f"{data.names[worst]}: {100 * share[worst]:.3g} % of the drive stay unexplained; are angles those of joints, in"
        " rad, times in s, and drives in N or N m at the joints?"
    ]


def uncovered_friction(data: Data, solution: Solution, sought: Sought, state: State) -> list[str]:
    """Return warnings about friction at rates that the motion does not have, where Stribeck's curve is sought.

    Below the slowest sample that counts the curve is extrapolated.  It may rise further there, which shows where the
    slowest samples have more friction than the curve.

    Args:
        data: with what was found taken off.
        solution: there.
        sought: with the coordinates whose curves were found.
        state: these curves.
    """
    _, drives, fitted, kept = data.over_time(solution)
    v, onto = data.v[solution.half : len(data.v) - solution.half], sought.matrix
    window, warnings = 2 * (data.half + solution.half) + 1, []
    rates = dict(zip(sought.rubbing, state.rates.tolist(), strict=True)) if STRIBECK in sought.terms else {}
    for i in data.relations.rubbing:
        row = int(np.abs(onto[i]).argmax()) if onto[i].any() else -1
        counts = kept[:, row] & (v[:, i] != 0.0)
        if row < 0 or not counts.any():
            continue
        speed, name = np.abs(v[counts, i]), sought.coordinates[i]
        slowest, slow = float(speed.min()), speed <= _SLOW_SHARE * speed.min()
        more = (np.sign(v[counts, i]) * (drives - fitted)[counts, row] / onto[i, row])[slow]
        error = float(solution.fitted[row] / abs(onto[i, row])) * np.sqrt(min(window, len(more)) / len(more))
        from_here = f"the slowest sample that counts, {slowest:.3g} {unit_of(name)}/s"
        if len(more) >= _FEWEST and more.mean() > _CLEARLY * error:
            warnings.append(
                f"{name}: the range of the motion does not cover Stribeck friction: near {from_here}, friction is"
                f" {more.mean():.2g} {force_unit_of(name)} above the curve, and may rise further below"
            )
        elif rates.get(i, np.inf) < _NEAR * slowest:
            warnings.append(
                f"{name}: the range of the motion does not cover Stribeck friction: its rate {rates[i]:.3g} is near"
                f" {from_here}, below which the curve is extrapolated"
            )
    return warnings
