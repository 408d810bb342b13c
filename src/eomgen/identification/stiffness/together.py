"""Stiffness and damping of robots with loops and couplings: all parameters from one system of equations.

With N a basis of the motions that loops, couplings and unknown drives allow, their forces do no work along it, and

    N^T sum_i d_i (a_i s_i + b_i s_i_dot) = N^T y,    y = u - (M q_ddot + bias - Q_G),

is linear in the parameters; d_i = ds_i/dq is a unit vector, or of a cut joint's coordinate its row.  A motion does not
determine what lies in the null space of these columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, UnknownNameError
from ...motion.files import MeasuredMotion
from ...motion.smoothing import Differentiator, bell, filtered, noise_deviation
from ...names import component_name, listed, nearest, parameter_name, split_component
from ...ranks import RANK
from ...robot.model import Model, build_model, parameter_values
from ...robot.value import MOTOR, PRINCIPAL, Robot
from ...runtime.kernel import Kernel
from ...state.springs import cut_numbers
from ..closing import closed_motion
from ..estimating import FIRST, HALF_WIDTHS, SIGNAL, block_count, least_samples
from .result import KEYS, Estimate, FittedCoordinate, doubts, interval_of

Array = NDArray[np.float64]

INDEPENDENT = 1e-10  # of the greatest eigenvalue of the scaled normal equations: below it a direction is undetermined
SHARE = 1e-4  # of a parameter in an undetermined direction: with less it is determined


@dataclass(frozen=True)
class _Sought:
    """A coordinate whose parameters are looked for: of a joint, a cut joint or an elastic coupling.

    owner: "joints", "loops" or "couplings".  columns: places in KEYS.
    """

    owner: str
    name: str
    columns: tuple[int, ...]

    def parameter(self, column: int) -> str:
        """Name of the parameter in ``Kernel.parameters``."""
        return parameter_name(self.owner, self.name, KEYS[column])


@dataclass(frozen=True)
class _Motion:
    """A closed motion with the drives that are known, (T, n) each, and the coordinates that follow from the others."""

    q: Array
    v: Array
    a: Array
    u: Array
    half: int
    following: tuple[str, ...]


@dataclass(frozen=True)
class _Solution:
    """Values and variances of all parameters behind one filter; NaN where the motion does not determine one."""

    values: Array
    variances: Array
    half: int
    blocks: int
    unexplained: float


def fit_together(
    robot: Robot, kernel: Kernel, motion: MeasuredMotion, asked: Sequence[str], confidence: float, step: float
) -> tuple[list[FittedCoordinate], list[str]]:
    """Fitted coordinates and warnings.

    Args:
        robot, kernel: the closed robot, and a kernel with what ``solve.fitting_kernels`` names.
        motion: with samples at equal distances.
        asked: names of coordinates to fit; if empty those that the description gives stiffness or damping.
        confidence: of the intervals.
        step: distance of the samples, s.

    Raises:
        InputError: the motion leaves coordinates open, or its drives say nothing.
        LoopError: loops do not close near a sample.
    """
    model = build_model(robot)
    closed = _closed(kernel, model, motion, step)
    sought, warnings = _sought(model, kernel, motion, asked, closed.following)
    noise = dict(zip(kernel.coordinates, noise_deviation(motion.q).tolist(), strict=True))
    still = [item for item in sought if not _moves(kernel, closed, item, noise)]
    warnings += [f"{item.name} does not move enough to say anything" for item in still]
    sought = [item for item in sought if item not in still]
    if not sought:
        return [], warnings
    places = [(item, column) for item in sought for column in item.columns]
    columns, right = _system(kernel, model, motion, closed, places)
    found = [
        _solve(columns, right, half, closed.half + half)
        for half in HALF_WIDTHS
        if len(motion.t) >= least_samples(FIRST + half)
    ]
    described = dict(parameter_values(robot))
    fitted, open_names = [], []
    for item in sought:
        estimates: dict[int, Estimate | None] = dict.fromkeys(range(len(KEYS)))
        for column in item.columns:
            place = places.index((item, column))
            able = [solution for solution in found if np.isfinite(solution.values[place])]
            if not able:
                open_names.append(component_name(item.name, KEYS[column]))
                continue
            best = min(able, key=lambda solution: float(solution.variances[place]))
            value, variance = float(best.values[place]), float(best.variances[place])
            before = described.get(item.parameter(column)) or 0.0
            width = 2 * best.half * step
            estimates[column] = interval_of(
                value, variance, best.blocks - 1, confidence, before, width, best.unexplained
            )
        if any(estimates.values()):
            entry = FittedCoordinate(item.name, estimates[0], estimates[1], noise.get(item.name, 0.0), item.owner)
            warnings += doubts(entry)
            fitted.append(entry)
    if open_names:
        warnings.append(f"the motion and its drives do not determine {listed(open_names)}, or not one beside another")
    return fitted, warnings


def _closed(kernel: Kernel, model: Model, motion: MeasuredMotion, step: float) -> _Motion:
    """The motion with its loops closed; rates and accelerations of a file are taken as they are, or derived."""
    if motion.v is not None and motion.a is not None:
        q, v, a, u, half = motion.q, motion.v, motion.a, motion.u, 0
    else:
        narrow, half = Differentiator(FIRST, step), FIRST
        q, u = narrow(motion.q), narrow(motion.u)
        v, a = (
            (narrow(motion.q, 1), narrow(motion.q, 2)) if motion.v is None else (narrow(motion.v), narrow(motion.v, 1))
        )
    following: tuple[str, ...] = ()
    if kernel.constraints:
        q, v, a, following = closed_motion(kernel, model, motion.measured, q, v, a)
    return _Motion(q, v, a, u, half, following)


def _sought(
    model: Model, kernel: Kernel, motion: MeasuredMotion, asked: Sequence[str], following: Sequence[str]
) -> tuple[list[_Sought], list[str]]:
    """Coordinates to fit, and warnings about those that cannot be."""
    robot, numbers = model.robot, dict(parameter_values(model.robot))
    for name in asked:
        if name not in (known := (*kernel.coordinates, *kernel.cut_laws)):
            raise UnknownNameError(f"coordinates: {name!r} is unknown{nearest(name, known)}")
    driven = [kernel.coordinates[i] for i in model.driven]
    found, warnings = [], []
    for name in asked or (*kernel.coordinates, *kernel.cut_laws):
        owner = "joints" if name in kernel.coordinates else "loops" if "." in name else "couplings"
        given = [c for c, key in enumerate(KEYS) if numbers.get(parameter_name(owner, name, key)) is not None]
        columns = tuple(given) or ((0, 1) if asked else ())
        reason = _reason(robot, kernel, motion, name, following, driven)
        if columns and not reason:
            found.append(_Sought(owner, name, columns))
        elif columns:
            warnings.append(f"{name} {reason}")
    return found, warnings


def _reason(
    robot: Robot, kernel: Kernel, motion: MeasuredMotion, name: str, following: Sequence[str], driven: Sequence[str]
) -> str:
    """Say why a coordinate cannot be fitted; "" if it can."""
    if name not in kernel.coordinates:
        plain = "clearance" not in cut_numbers(kernel)[name] and name not in kernel.knots
        return "" if plain else "has a law that is not linear, which is not fitted"
    joint, short = split_component(name)
    part = robot.joint(joint)
    if part.motor is not None and short in (MOTOR, PRINCIPAL[part.type]):
        return "hangs on a transmission between motor and joint, which is not fitted"
    if name in kernel.prescribed:
        return "is prescribed: what moves it takes its forces, too"
    if name in driven and name not in motion.driven:
        return f"has a drive that is not known: a column {name}.drive"
    if name not in motion.measured and name not in following:
        return "was not measured, and counts as zero"
    return ""


def _moves(kernel: Kernel, closed: _Motion, item: _Sought, noise: dict[str, float]) -> bool:
    """Whether a coordinate moves more than its noise does."""
    s, _, _ = _deviation(kernel, closed, item)
    return bool(np.mean(s**2) > (1.0 + SIGNAL) * noise.get(item.name, 0.0) ** 2 + 1e-30)


def _deviation(kernel: Kernel, closed: _Motion, item: _Sought) -> tuple[Array, Array, Array]:
    """Deviation and rate of a coordinate, (T,) each, and its derivatives by all coordinates, (T, n)."""
    if item.owner == "joints":
        i = kernel.coordinates.index(item.name)
        return closed.q[:, i], closed.v[:, i], np.broadcast_to(np.eye(kernel.n)[i], closed.q.shape)
    i = kernel.cut_laws.index(item.name)
    arms = np.asarray(kernel.cut_jacobian(closed.q))[:, i]
    return np.asarray(kernel.cut_forces(closed.q, closed.v))[:, i, 0], np.einsum("tn,tn->t", arms, closed.v), arms


def _system(
    kernel: Kernel, model: Model, motion: MeasuredMotion, closed: _Motion, places: Sequence[tuple[_Sought, int]]
) -> tuple[Array, Array]:
    """Columns, (T, f, p), and right sides, (T, f), along the motions that are left to the mechanism."""
    N = _ways(kernel, model, motion, closed)
    y = closed.u - np.asarray(kernel.inverse_dynamics(closed.q, closed.v, closed.a, cut=True))
    columns = np.empty((*N.shape[::2], len(places)))
    for place, (item, column) in enumerate(places):
        s, rate, arms = _deviation(kernel, closed, item)
        moved = (s, rate)[column]
        y = y + kernel.parameters.get(item.parameter(column), 0.0) * moved[:, np.newaxis] * arms
        columns[:, :, place] = np.einsum("tnf,tn->tf", N, arms) * moved[:, np.newaxis]
    return columns, np.einsum("tnf,tn->tf", N, y)


def _ways(kernel: Kernel, model: Model, motion: MeasuredMotion, closed: _Motion) -> Array:
    """Motions along which neither loops, couplings nor unknown drives do work, (T, n, f); lengths by kinetic energy.

    The null space's projector is smooth over time; it is seen from the directions that it has most of on average.

    Raises:
        InputError: there are none.
    """
    names = kernel.coordinates
    unknown = {names[i] for i in model.driven}.difference(motion.driven) | set(kernel.prescribed)
    units = np.eye(kernel.n)[[name in unknown for name in names]]
    rows = np.broadcast_to(units, (len(closed.q), *units.shape))
    if kernel.constraints:
        rows = np.concatenate([kernel.constraint_jacobian(closed.q), rows], axis=1)
    inertia = np.diagonal(kernel.mass_matrix(closed.q), axis1=1, axis2=2).mean(axis=0)
    size = 1.0 / np.sqrt(np.maximum(inertia, 1e-12 * inertia.max()))
    scaled = rows * size
    projector = np.eye(kernel.n) - np.linalg.pinv(scaled, rcond=RANK) @ scaled
    left = round(float(np.trace(projector, axis1=1, axis2=2).max()))
    if not left:
        raise InputError(
            f"fit: {kernel.name}: the drives of {listed(sorted(unknown.difference(kernel.prescribed)))} are not known,"
            " and they hold all else; allowed: their drives as columns NAME.drive"
        )
    _, directions = np.linalg.eigh(projector.mean(axis=0))
    return np.asarray(size[:, np.newaxis] * (projector @ directions[:, -left:]))


def _solve(columns: Array, right: Array, half: int, width: int) -> _Solution:
    """Least squares behind a bell of that half width; variances are the jackknife's over blocks of time."""
    samples, ways, count = columns.shape
    wide = bell(half)
    X = filtered(columns.reshape(samples, -1), wide).reshape(-1, ways, count)
    y = filtered(right, wide)
    size = np.sqrt(np.mean(X**2, axis=(0, 1)))
    X = X / np.where(size > 0.0, size, 1.0)
    blocks = block_count(len(X), max(width, 1))
    parts = zip(np.array_split(X, blocks), np.array_split(y, blocks), strict=True)
    sums = [(np.einsum("tfp,tfq->pq", x, x), np.einsum("tfp,tf->p", x, r)) for x, r in parts]
    A, c = np.stack([a for a, _ in sums]), np.stack([b for _, b in sums])
    whole = A.sum(axis=0)
    eigenvalues, vectors = np.linalg.eigh(whole)
    kept = eigenvalues > INDEPENDENT * eigenvalues[-1]
    lost = np.linalg.norm(vectors[:, ~kept], axis=1) > SHARE
    B = vectors[:, kept]
    values = B @ np.linalg.solve(B.T @ whole @ B, B.T @ c.sum(axis=0))
    without = np.stack(
        [B @ np.linalg.solve(B.T @ (whole - a) @ B, B.T @ (c.sum(axis=0) - b)) for a, b in zip(A, c, strict=True)]
    )
    variances = ((without - values) ** 2).sum(axis=0) * (blocks - 1) / blocks
    residual = y - X @ values
    explained = float(np.sqrt(np.mean(residual**2) / max(float(np.mean(y**2)), 1e-300)))
    safe = np.where(size > 0.0, size, np.inf)
    missing = lost | (size == 0.0)
    return _Solution(
        np.where(missing, np.nan, values / safe),
        np.where(missing, np.nan, variances / safe**2),
        width,
        blocks,
        explained,
    )
