"""Stiffness and damping of joints from a measured motion and known drives.

In every coordinate the equation of motion is linear in them,

    a s + b s_dot = y,    y = u - (M s_ddot + bias - Q_G),

so both follow from least squares over time, coordinate by coordinate.  Three things keep noise out of the result: all
terms pass the same filters, the first of which gives derivatives of eighth order of what it returns; the width of the
second is, for each parameter, the one with the smallest standard error; and what white noise of the coordinate itself
adds to the normal equations on average (errors in variables) is taken off them.  Standard errors do not hold what noise
does through terms that are not linear in the motion: the tests see up to 1e-4 of a value.

The derivatives of y by the parameters are s and s_dot as they are measured, so that a fit is two batches of the kernel
without any difference: 0.1 s for 2,000 samples of the PUMA with 36 coordinates.  ``parameter_jacobian`` gives the same
columns, of parameters that the description has, in 0.5 s more, and after 0.5 s of a compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...description import RobotLike, as_robot
from ...errors import InputError, UnknownNameError
from ...motion.files import MeasuredMotion, measured_motion
from ...motion.measured_numbers import answers_in_numbers
from ...motion.smoothing import Differentiator, bell, filtered, noise_deviation
from ...names import nearest, split_component
from ...pipeline.closing import mechanism_kernels
from ...pipeline.stages import build
from ...progress import StageReport
from ...robot.model import build_model
from ...robot.value import MOTOR, PRINCIPAL, Robot
from ...runtime.kernel import Kernel
from ...state.springs import coordinate_numbers
from ..estimating import FIRST, HALF_WIDTHS, SIGNAL, block_count, even_step, least_samples
from ..relations import refuse_followers
from .result import KEYS, Estimate, FitResult, FittedCoordinate, doubts, interval_of
from .together import fit_together

Array = NDArray[np.float64]


@answers_in_numbers("motion")
def fit(
    robot: RobotLike,
    motion: MeasuredMotion | Path | str,
    *,
    coordinates: Sequence[str] = (),
    confidence: float = 0.95,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> FitResult:
    """Stiffness and damping of each coordinate from motion and known drives.

    Of deviations both are fitted; without a drive in the motion they have none.  Of principal coordinates, whose drive
    must be known, those that the description gives; transmissions of motors are not fitted.  The motion has samples at
    equal distances in time; what noise there is should be white and independent between coordinates.

    Of robots with loops and couplings those that the description gives are fitted, of cut joints and elastic couplings
    too, or those that are asked for: all together along what the loops leave free (``together``), so that the loops'
    forces need not be known.  A drive that is not in the motion takes its coordinate out of the equations.  There what
    noise adds on average is not taken off.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.  Masses, geometry,
            gravity and springs between points count, its coordinates' stiffness and damping do not.
        motion: from ``read_motion`` or ``motion_from_columns``, or the path of a file.
        coordinates: names of those to fit; all that can be if empty.
        confidence: of the intervals, between 0 and 1; Student's t over blocks of time.
        kernel: of that robot, float64, with ``fitting_kernels``; built if not given.

    Raises:
        InputError: the file or an argument cannot be used, samples are too few or not evenly spaced, or they leave a
            mechanism's coordinates open.
        LoopError: loops do not close near a sample.
    """
    robot = as_robot(robot).with_constraints()
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence: {confidence!r}; allowed: a number between 0 and 1")
    if kernel is None:
        kernel = build(robot, kernels=fitting_kernels(robot), progress=progress or (lambda _: None))
    refuse_followers(kernel)
    motion = measured_motion(robot.name, motion, kernel.coordinates)
    step = even_step(motion)
    if robot.is_closed:
        together, doubted = fit_together(robot, kernel, motion, coordinates, confidence, step)
        return FitResult(robot.name, confidence, tuple(together), tuple(doubted), _closed_notes(motion))
    wanted, warnings = _wanted(robot, motion, coordinates)
    noise = noise_deviation(motion.q)
    terms = _Terms(kernel, motion, step)
    candidates = [_Filtered(terms, half) for half in HALF_WIDTHS if len(motion.t) >= least_samples(FIRST + half)]
    fitted = []
    for name in wanted:
        i = kernel.coordinates.index(name)
        solved = (_solve(data, i, noise[i], _columns(robot, name)) for data in candidates)
        found = [solution for solution in solved if solution is not None]
        best = {c: min(found, key=lambda s: s.variance(c)) for c in (0, 1) if any(c in s.columns for s in found)}
        if not best:
            rms = float(np.sqrt(np.mean(motion.q[:, i] ** 2)))
            warnings.append(f"{name} does not move enough to say anything: rms {rms:.2g}, its noise {noise[i]:.2g}")
            continue
        estimates = [_estimate(robot, name, c, best.get(c), confidence, step) for c in (0, 1)]
        entry = FittedCoordinate(name, estimates[0], estimates[1], float(noise[i]))
        warnings += doubts(entry)
        fitted.append(entry)
    return FitResult(robot.name, confidence, tuple(fitted), tuple(warnings), _notes(motion))


def fitting_kernels(robot: Robot) -> tuple[str, ...]:
    """Names of the kernels that a fit calls."""
    laws = ("cut_forces", "cut_jacobian") if robot.is_closed and build_model(robot).cut_laws else ()
    return ("inverse_dynamics", *dict.fromkeys(("mass_matrix", *mechanism_kernels(robot), *laws)))


class _Terms:
    """Coordinates, rates and y of every coordinate, (T - 2 FIRST, n): what is linear in the parameters.

    The narrowest filter gives the derivatives, so that it hardly bends what is not linear in the motion.
    """

    def __init__(self, kernel: Kernel, motion: MeasuredMotion, step: float) -> None:
        narrow = self.narrow = Differentiator(FIRST, step)
        self.measured_rates = motion.v is not None
        self.q = narrow(motion.q)
        self.v = narrow(motion.q, 1) if motion.v is None else narrow(motion.v)
        if motion.a is not None:
            a = narrow(motion.a)
        else:
            a = narrow(motion.q, 2) if motion.v is None else narrow(motion.v, 1)
        stiffness, damping = spring_rates(kernel)
        needed = np.asarray(kernel.inverse_dynamics(self.q, self.v, a)) - stiffness * self.q - damping * self.v
        self.y = narrow(motion.u) - needed
        self.inertia: Array = np.diagonal(kernel.mass_matrix(self.q), axis1=1, axis2=2).mean(axis=0)


class _Filtered:
    """The terms, filtered once more: q, v, y, (T - 2 half, n), and the covariances of what white noise of q becomes.

    ``noise[i, j]`` belongs to derivatives i and j of filtered white noise of variance 1.
    """

    def __init__(self, terms: _Terms, half: int) -> None:
        wide = bell(half)
        self.terms, self.half = terms, FIRST + half
        self.q, self.v, self.y = (filtered(x, wide) for x in (terms.q, terms.v, terms.y))
        both = np.stack([np.convolve(row, wide) for row in terms.narrow.weights])
        self.noise = both @ both.T


@dataclass(frozen=True)
class _Solution:
    """Least squares of one coordinate with one filter; ``columns`` of (stiffness, damping) that were found."""

    columns: tuple[int, ...]
    values: Array
    covariance: Array
    blocks: int
    half: int
    unexplained: float

    def variance(self, column: int) -> float:
        """Variance of a parameter; infinite if it was not found."""
        place = self.columns.index(column) if column in self.columns else -1
        return float(self.covariance[place, place]) if place >= 0 else np.inf


def _solve(data: _Filtered, i: int, sigma: float, columns: tuple[int, ...]) -> _Solution | None:
    """Compensated least squares; None where the coordinate does not move, or in one block of time alone."""
    noise, count = sigma**2 * data.noise, len(data.q)
    X = np.stack([data.q[:, i], data.v[:, i]], axis=1)
    y = data.y[:, i]
    # With rates or accelerations of their own, the noise of q is in no other term.
    derived = not data.terms.measured_rates
    of_X = np.array([noise[0, 0], noise[1, 1] if derived else 0.0])
    of_y = np.array([-data.terms.inertia[i] * noise[0, 2] if derived else 0.0, 0.0])
    moving = np.mean(X**2, axis=0) > (1.0 + SIGNAL) * of_X + 1e-30
    columns = tuple(c for c in columns if moving[c])
    if not columns or not moving[0]:
        return None
    keep = list(columns)
    X, of_X, of_y = X[:, keep], of_X[keep], of_y[keep]
    size = np.sqrt(np.mean(X**2, axis=0))
    blocks = block_count(count, data.half)
    parts = [
        (len(p), p.T @ p, p.T @ r) for p, r in zip(np.array_split(X, blocks), np.array_split(y, blocks), strict=True)
    ]
    A = np.stack([product - samples * np.diag(of_X) for samples, product, _ in parts])
    c = np.stack([product - samples * of_y for samples, _, product in parts])
    whole = A.sum(axis=0)
    left = whole - A  # without one block each
    if np.linalg.cond(np.concatenate([whole[np.newaxis], left]) / np.outer(size, size)).max() > 1e10:
        return None
    values = np.linalg.solve(whole, c.sum(axis=0))
    residual = y - X @ values
    without = np.linalg.solve(left, (c.sum(axis=0) - c)[..., np.newaxis])[..., 0] - values
    covariance = without.T @ without * (blocks - 1) / blocks
    explained = float(np.sqrt(np.mean(residual**2) / max(float(np.mean(y**2)), 1e-300)))
    return _Solution(columns, values, covariance, blocks, data.half, explained)


def _estimate(
    robot: Robot, name: str, column: int, solution: _Solution | None, confidence: float, step: float
) -> Estimate | None:
    """The parameter with its interval, by Student's t."""
    if solution is None:
        return None
    value = float(solution.values[solution.columns.index(column)])
    joint, short = split_component(name)
    described = getattr(robot.joint(joint).coordinates[short], KEYS[column]) or 0.0
    width, freedoms = 2 * solution.half * step, solution.blocks - len(solution.columns)
    return interval_of(value, solution.variance(column), freedoms, confidence, described, width, solution.unexplained)


def spring_rates(kernel: Kernel) -> tuple[Array, Array]:
    """Stiffness and damping of every coordinate as the kernel has them, (n,) each; zero where there is none.

    Motors have none: what stands in their tables is their transmissions'.
    """
    own = np.array([name not in kernel.motors for name in kernel.coordinates])
    return own * coordinate_numbers(kernel, "stiffness"), own * coordinate_numbers(kernel, "damping")


def _columns(robot: Robot, name: str) -> tuple[int, ...]:
    """Which of (stiffness, damping) are fitted: both for a deviation, else those that the description gives."""
    joint, short = split_component(name)
    if PRINCIPAL.get(robot.joint(joint).type) != short:
        return (0, 1)
    given = robot.joint(joint).coordinates[short]
    return tuple(column for column, key in enumerate(KEYS) if getattr(given, key) is not None)


def _wanted(robot: Robot, motion: MeasuredMotion, asked: Sequence[str]) -> tuple[list[str], list[str]]:
    """Coordinates to fit, and warnings about those that cannot be."""
    for name in asked:
        if name not in motion.coordinates:
            raise UnknownNameError(f"coordinates: {name!r} is unknown{nearest(name, motion.coordinates)}")
    wanted, warnings = [], []
    for name in asked or motion.coordinates:
        joint, short = split_component(name)
        if robot.joint(joint).motor is not None and short in (MOTOR, PRINCIPAL[robot.joint(joint).type]):
            if asked:
                warnings.append(f"{name} hangs on a transmission between motor and joint, which is not fitted")
            continue
        principal = PRINCIPAL.get(robot.joint(joint).type) == short
        if name not in motion.measured:
            warnings.append(f"{name} was not measured, and counts as zero")
        elif principal and not _columns(robot, name):
            if asked:
                warnings.append(f"{name} is a principal coordinate without stiffness or damping in the description")
        elif principal and name not in motion.driven:
            warnings.append(f"{name} is a principal coordinate, and its drive is not known: a column {name}.drive")
        else:
            wanted.append(name)
    return wanted, warnings


def _notes(motion: MeasuredMotion) -> tuple[str, ...]:
    how = (
        "derivatives: central differences of eighth order behind a bell of 9 samples"
        if motion.a is None
        else "rates and accelerations from the file"
    )
    still = [name for name in motion.coordinates if name not in motion.driven]
    notes = [f"{how}; all terms filtered alike; what white noise adds on average is taken off"]
    if still:
        notes.append(f"without a drive in the file, taken as zero: {', '.join(still)}")
    return tuple(notes)


def _closed_notes(motion: MeasuredMotion) -> tuple[str, ...]:
    how = (
        "rates and accelerations: from the file"
        if motion.v is not None and motion.a is not None
        else "derivatives: central differences of eighth order behind a bell of 9 samples"
    )
    return (
        f"{how}; loops closed at every sample; balanced along what loops and couplings leave free",
        "noise of the motion makes stiffness look softer: what it adds is not taken off",
    )
