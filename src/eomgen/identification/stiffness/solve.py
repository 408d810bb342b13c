"""Stiffness and damping of joints from a measured motion and known drives.

With N a basis of the motions that loops, couplings and unknown drives allow, their forces do no work along it, and

    N^T sum_i d_i (a_i s_i + b_i s_i_dot) = N^T y,    y = u - (M q_ddot + bias - Q_G),

is linear in the parameters; d_i = ds_i/dq is a unit vector, or of a loop joint's coordinate its row.  A motion does not
determine what lies in the null space of these columns.  In a tree N is the unit matrix: every coordinate has an
equation, a s + b s_dot = y, and is fitted by itself.

Three things keep noise out of the result: all terms pass the same filters, the first of which gives derivatives of
eighth order of what it returns; the width of the second is, for each parameter, the one with the smallest standard
error; and, in a tree, what white noise of the coordinate itself adds to the normal equations on average (errors in
variables) is taken off them.  Standard errors do not hold what noise does through terms that are not linear in the
motion: the tests see up to 1e-4 of a value.

The derivatives of y by the parameters are s and s_dot as they are measured, so that a fit is two batches of the kernel
without any difference: 0.1 s for 2,000 samples of the PUMA with 36 coordinates.  ``parameter_jacobian`` gives the same
columns, of parameters that the description has, in 0.5 s more, and after 0.5 s of a compiler.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import RANK, Array
from ...description import RobotLike, as_robot
from ...errors import InputError, UnknownNameError
from ...motion.files import MeasuredMotion, measured_motion
from ...motion.measured_numbers import answers_in_numbers
from ...motion.smoothing import Differentiator, bell, filtered, noise_deviation
from ...names import component_name, listed, nearest, parameter_name, split_component
from ...optional import optional_import
from ...pipeline.mechanisms import mechanism_kernels
from ...pipeline.stages import build
from ...progress import StageReport, tells_at_prompt
from ...robot.model import Model, build_model
from ...robot.value import MOTOR, PRINCIPAL, Robot
from ...runtime.kernel import Kernel
from ...state.springs import cut_numbers, law_numbers
from ..closed_motions import closed_motion
from ..estimating import FIRST, HALF_WIDTHS, SIGNAL, block_count, even_step, least_samples
from ..relations import refuse_followers
from .result import KEYS, Estimate, FitResult, FittedCoordinate, doubts

INDEPENDENT = 1e-10  # of the greatest eigenvalue of the scaled normal equations: below it a direction is undetermined
SHARE = 1e-4  # of a parameter in an undetermined direction: with less it is determined


@answers_in_numbers("motion")
@tells_at_prompt("fitting")
def fit(
    robot: RobotLike,
    motion: MeasuredMotion | Path | str,
    *,
    coordinates: Sequence[str] = (),
    confidence: float = 0.95,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> FitResult:
    """Return stiffness and damping of each coordinate from motion and known drives.

    Of deviations both are fitted; without a drive in the motion they have none.  Of principal coordinates, whose drive
    must be known, those that the description gives; transmissions of motors are not fitted.  The motion has samples at
    equal distances in time; what noise there is should be white and independent between coordinates.

    Of robots with loops and couplings those that the description gives are fitted, of loop joints and elastic couplings
    too, or those that are asked for: all together along what the loops leave free, so that the loops'
    forces need not be known.  A drive that is not in the motion takes its coordinate out of the equations.  There what
    noise adds on average is not taken off.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.  Masses, geometry,
            gravity and point-to-point springs count, its coordinates' stiffness and damping do not.
        motion: from ``read_motion`` or ``motion_from_columns``, or the path of a file.
        coordinates: names of those to fit; all that can be if empty.
        confidence: of the intervals, between 0 and 1; Student's t over blocks of time.
        kernel: of that robot, float64, with ``fitting_kernels``; built if None.

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
    model = build_model(robot)
    moved = _moved(kernel, model, motion, step)
    noise = dict(zip(kernel.coordinates, noise_deviation(motion.q).tolist(), strict=True))
    sought, warnings = _sought(model, kernel, motion, coordinates, moved.following)
    if not motion.driven:
        driven = [kernel.coordinates[i] for i in model.driven]
        such = f" such as {component_name(driven[0], 'drive')}" if driven else ""
        what = f"forces that drive {', '.join(driven)} are unknown" if driven else "nothing is driven"
        warnings.insert(0, f"the motion has no drives: no columns{such}; {what}")
    if robot.is_closed:
        still = [item for item in sought if not _moves(kernel, moved, item, noise)]
        warnings += [f"{item.name} does not move enough to say anything" for item in still]
        sought = [item for item in sought if item not in still]
        systems = iter([_together(kernel, model, motion, moved, sought)] if sought else [])
    else:
        systems = _alone(kernel, motion, moved, sought, noise)
    described, fitted, open_names = dict(robot.numbers()), list[FittedCoordinate](), list[str]()
    for system in systems:
        able = [half for half in HALF_WIDTHS if len(motion.t) >= least_samples(FIRST + half)]
        solutions = [_solve(system, half, moved.half + half) for half in able]
        for item in system.sought:
            estimates: dict[str, Estimate | None] = dict.fromkeys(KEYS)
            for column in item.columns:
                place = system.places.index((item, column))
                best = min(solutions, key=lambda one: float(one.variances[place]))
                if np.isfinite(best.values[place]):
                    before = described.get(item.parameter(column)) or 0.0
                    estimates[KEYS[column]] = _estimate(best, place, confidence, before, step)
                elif system.noise is None:
                    open_names.append(component_name(item.name, KEYS[column]))
            if any(estimates.values()):
                entry = FittedCoordinate(item.name, **estimates, noise=noise.get(item.name, 0.0), owner=item.owner)
                warnings += doubts(entry)
                fitted.append(entry)
            elif system.noise is not None:
                rms = float(np.sqrt(np.mean(motion.q[:, kernel.coordinates.index(item.name)] ** 2)))
                said = f"rms {rms:.2g}, its noise {noise[item.name]:.2g}"
                warnings.append(f"{item.name} does not move enough to say anything: {said}")
    if open_names:
        warnings.append(f"the motion and its drives do not determine {listed(open_names)}, or not one beside another")
    notes = _closed_notes(motion) if robot.is_closed else _notes(motion)
    return FitResult(robot.name, confidence, tuple(fitted), tuple(warnings), notes)


def fitting_kernels(robot: Robot) -> tuple[str, ...]:
    """Return names of the kernels that a fit calls."""
    laws = ("cut_forces", "cut_jacobian") if robot.is_closed and build_model(robot).cut_laws else ()
    return ("inverse_dynamics", *dict.fromkeys(("mass_matrix", *mechanism_kernels(robot), *laws)))


@dataclass(frozen=True)
class _Sought:
    """A coordinate whose parameters are looked for: of a joint, a loop joint or an elastic coupling.

    owner: "joints", "loops" or "couplings".  columns: places in KEYS.
    """

    owner: str
    name: str
    columns: tuple[int, ...]

    def parameter(self, column: int) -> str:
        """Name of the parameter in ``Kernel.parameters``."""
        return parameter_name(self.owner, self.name, KEYS[column])


@dataclass(frozen=True)
class _Moved:
    """A motion with its loops closed, and the drives that are known, (T, n) each.

    half: of the filter that they have passed.  weights: of that filter by order of the derivative, (3, w).  following:
    names of the coordinates that follow from the others.
    """

    q: Array
    v: Array
    a: Array
    u: Array
    half: int
    weights: Array
    following: tuple[str, ...]


@dataclass(frozen=True)
class _Noise:
    """White noise of a coordinate: its standard deviation, the filter's weights by order (3, w), the inertia that its
    second derivative acts on (0 where rates were measured), and whether rates are derivatives of it.
    """

    sigma: float
    weights: Array
    inertia: float
    is_derived: bool

    def behind(self, wide: Array) -> tuple[Array, Array]:
        """Return its average share in squares of s and s_dot, and in their products with y, (2,) each, filtered."""
        both = np.stack([np.convolve(row, wide) for row in self.weights])
        square = self.sigma**2 * (both @ both.T)
        if not self.is_derived:  # with measured velocities or accelerations, the noise of q is in no other term
            return np.array([square[0, 0], 0.0]), np.zeros(2)
        return np.array([square[0, 0], square[1, 1]]), np.array([-self.inertia * square[0, 2], 0.0])


@dataclass(frozen=True)
class _System:
    """Equations of some parameters: columns, (T, f, p), and right sides, (T, f).

    places: coordinate and place in KEYS of every column.  noise: of the one coordinate of a tree, whose columns are
    s and s_dot; None of a mechanism, where nothing is taken off.
    """

    sought: tuple[_Sought, ...]
    places: tuple[tuple[_Sought, int], ...]
    columns: Array
    right: Array
    noise: _Noise | None = None


@dataclass(frozen=True)
class _Solution:
    """Values and variances of all parameters behind one filter; NaN and infinite where one is not determined."""

    values: Array
    variances: Array
    half: int
    freedoms: int
    unexplained: float


def _moved(kernel: Kernel, model: Model, motion: MeasuredMotion, step: float) -> _Moved:
    """Return the motion with its loops closed; velocities and accelerations are a file's, or derivatives.

    The narrowest filter gives the derivatives, so that it hardly bends what is not linear in the motion.  Of a tree it
    is in front of all that a file has.
    """
    narrow, half = Differentiator(FIRST, step), FIRST
    is_whole = motion.v is not None and motion.a is not None
    if is_whole and model.robot.is_closed:
        q, v, a, u, half = motion.q, motion.v, motion.a, motion.u, 0
    else:
        q, u = narrow(motion.q), narrow(motion.u)
        v = narrow(motion.q, 1) if motion.v is None else narrow(motion.v)
        if motion.a is not None:
            a = narrow(motion.a)
        else:
            a = narrow(motion.q, 2) if motion.v is None else narrow(motion.v, 1)
    assert v is not None
    assert a is not None
    following: tuple[str, ...] = ()
    if kernel.constraints:
        q, v, a, following = closed_motion(kernel, model, motion.measured, q, v, a)
    return _Moved(q, v, a, u, half, narrow.weights, following)


def _sought(
    model: Model, kernel: Kernel, motion: MeasuredMotion, asked: Sequence[str], following: Sequence[str]
) -> tuple[list[_Sought], list[str]]:
    """Return coordinates to fit, and warnings about those that cannot be.

    Of a tree's deviations both parameters are fitted; elsewhere those that are described, or asked for.
    """
    numbers, known = dict(model.robot.numbers()), (*kernel.coordinates, *kernel.cut_laws)
    for name in asked:
        if name not in known:
            raise UnknownNameError(f"coordinates: {name!r} is unknown{nearest(name, known)}")
    driven = [kernel.coordinates[i] for i in model.driven]
    sought, warnings = [], []
    for name in asked or known:
        owner = "joints" if name in kernel.coordinates else "loops" if "." in name else "couplings"
        described = [c for c, key in enumerate(KEYS) if numbers.get(parameter_name(owner, name, key)) is not None]
        if model.robot.is_closed:
            columns = tuple(described) or ((0, 1) if asked else ())
            reason = _reason(model.robot, kernel, motion, name, following, driven) if columns else ""
        else:
            columns = tuple(described) if _is_principal(model.robot, name) else (0, 1)
            reason, columns = _reason_in_tree(model.robot, motion, name, columns, is_asked=bool(asked))
        if reason:
            warnings.append(f"{name} {reason}")
        elif columns:
            sought.append(_Sought(owner, name, columns))
    return sought, warnings


def _is_principal(robot: Robot, name: str) -> bool:
    joint, short = split_component(name)
    return PRINCIPAL.get(robot.joint(joint).type) == short


def _is_transmitted(robot: Robot, name: str) -> bool:
    """Return whether a coordinate hangs on the transmission between a motor and its joint."""
    joint, short = split_component(name)
    moved = robot.joint(joint)
    return moved.motor is not None and short in (MOTOR, PRINCIPAL[moved.type])


_TRANSMITTED = "hangs on a transmission between motor and joint, which is not fitted"
_UNMEASURED = "was not measured, and counts as zero"


def _reason_in_tree(
    robot: Robot, motion: MeasuredMotion, name: str, columns: tuple[int, ...], *, is_asked: bool
) -> tuple[str, tuple[int, ...]]:
    """Say why a tree's coordinate cannot be fitted, "" if it can or nobody asked; and the columns that are left."""
    if _is_transmitted(robot, name):
        return (_TRANSMITTED if is_asked else ""), ()
    if name not in motion.measured:
        return _UNMEASURED, ()
    if not columns:
        return ("is a principal coordinate without stiffness or damping in the description" if is_asked else ""), ()
    if _is_principal(robot, name) and name not in motion.driven:
        return f"is a principal coordinate, and its drive is not known: a column {name}.drive", ()
    return "", columns


def _reason(
    robot: Robot, kernel: Kernel, motion: MeasuredMotion, name: str, following: Sequence[str], driven: Sequence[str]
) -> str:
    """Say why a coordinate of a mechanism cannot be fitted; "" if it can."""
    if name not in kernel.coordinates:
        plain = "clearance" not in cut_numbers(kernel)[name] and name not in kernel.knots
        return "" if plain else "has a law that is not linear, which is not fitted"
    if _is_transmitted(robot, name):
        return _TRANSMITTED
    if name in kernel.prescribed:
        return "is prescribed: what moves it takes its forces, too"
    if name in driven and name not in motion.driven:
        return f"has a drive that is not known: a column {name}.drive"
    if name not in motion.measured and name not in following:
        return _UNMEASURED
    return ""


def _moves(kernel: Kernel, moved: _Moved, item: _Sought, noise: dict[str, float]) -> bool:
    """Return whether a coordinate moves more than its noise does."""
    s, _, _ = _deviation(kernel, moved, item)
    return bool(np.mean(s**2) > (1.0 + SIGNAL) * noise.get(item.name, 0.0) ** 2 + 1e-30)


def _deviation(kernel: Kernel, moved: _Moved, item: _Sought) -> tuple[Array, Array, Array]:
    """Return deviation and rate of a coordinate, (T,) each, and its derivatives by all coordinates, (T, n)."""
    if item.owner == "joints":
        i = kernel.coordinates.index(item.name)
        return moved.q[:, i], moved.v[:, i], np.broadcast_to(np.eye(kernel.n)[i], moved.q.shape)
    i = kernel.cut_laws.index(item.name)
    rows = np.asarray(kernel.cut_jacobian(moved.q))[:, i]
    return np.asarray(kernel.cut_forces(moved.q, moved.v))[:, i, 0], np.einsum("tn,tn->t", rows, moved.v), rows


def _alone(
    kernel: Kernel, motion: MeasuredMotion, moved: _Moved, sought: Sequence[_Sought], noise: dict[str, float]
) -> Iterator[_System]:
    """Yield the equation of every coordinate of a tree by itself."""
    y = moved.u - np.asarray(kernel.inverse_dynamics(moved.q, moved.v, moved.a))
    inertia = np.diagonal(kernel.mass_matrix(moved.q), axis1=1, axis2=2).mean(axis=0)
    numbers = law_numbers(kernel)
    for item in sought:
        i = kernel.coordinates.index(item.name)
        columns = np.stack([moved.q[:, i], moved.v[:, i]], axis=1)
        right = y[:, i] + columns @ np.array([numbers[item.name].get(key, 0.0) for key in KEYS])
        measured = _Noise(noise[item.name], moved.weights, float(inertia[i]), motion.v is None)
        places = tuple((item, column) for column in range(len(KEYS)))
        yield _System((item,), places, columns[:, np.newaxis], right[:, np.newaxis], measured)


def _together(
    kernel: Kernel, model: Model, motion: MeasuredMotion, moved: _Moved, sought: Sequence[_Sought]
) -> _System:
    """Return the equations of all coordinates of a mechanism, along the motions that are left to it."""
    places = tuple((item, column) for item in sought for column in item.columns)
    N = _free_motions(kernel, model, motion, moved)
    y = moved.u - np.asarray(kernel.inverse_dynamics(moved.q, moved.v, moved.a, cut=True))
    numbers = {**law_numbers(kernel), **cut_numbers(kernel)}
    columns = np.empty((*N.shape[::2], len(places)))
    for place, (item, column) in enumerate(places):
        s, rate, rows = _deviation(kernel, moved, item)
        x = (s, rate)[column][:, np.newaxis] * rows
        y = y + numbers[item.name].get(KEYS[column], 0.0) * x
        columns[:, :, place] = np.einsum("tnf,tn->tf", N, x)
    return _System(tuple(sought), places, columns, np.einsum("tnf,tn->tf", N, y))


def _free_motions(kernel: Kernel, model: Model, motion: MeasuredMotion, moved: _Moved) -> Array:
    """Return motions along which neither loops, couplings nor unknown drives do work, (T, n, f).

    Lengths are measured by kinetic energy.  The null space's projector is smooth over time; it is seen from the
    directions that it has most of on average.

    Raises:
        InputError: there are none.
    """
    names = kernel.coordinates
    unknown = {names[i] for i in model.driven}.difference(motion.driven) | set(kernel.prescribed)
    units = np.eye(kernel.n)[[name in unknown for name in names]]
    rows = np.broadcast_to(units, (len(moved.q), *units.shape))
    if kernel.constraints:
        rows = np.concatenate([kernel.constraint_jacobian(moved.q), rows], axis=1)
    inertia = np.diagonal(kernel.mass_matrix(moved.q), axis1=1, axis2=2).mean(axis=0)
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


def _solve(system: _System, half: int, width: int) -> _Solution:
    """Return least squares behind a bell of that half width; variances are the jackknife's over blocks of time.

    width: half width of all filters together, samples.
    """
    samples, motions, count = system.columns.shape
    wide = bell(half)
    X = filtered(system.columns.reshape(samples, -1), wide).reshape(-1, motions, count)
    y = filtered(system.right, wide)
    of_X, of_y = np.zeros((2, count)) if system.noise is None else system.noise.behind(wide)
    square = np.mean(X**2, axis=(0, 1))
    moving = square > (1.0 + SIGNAL) * of_X + 1e-30
    if system.noise is not None:
        moving &= moving[0] & np.isin(np.arange(count), system.sought[0].columns)
    blocks, size = block_count(len(X), max(width, 1)), np.sqrt(square[moving])
    values, variances = np.full(count, np.nan), np.full(count, np.inf)
    freedoms = blocks - (1 if system.noise is None else int(moving.sum()))
    if not moving.any():
        return _Solution(values, variances, width, freedoms, 1.0)
    X, of_X, of_y = X[..., moving] / size, of_X[moving] / size**2, of_y[moving] / size
    parts = list(zip(np.array_split(X, blocks), np.array_split(y, blocks), strict=True))
    A = np.stack([np.einsum("tfp,tfq->pq", x, x) - len(x) * np.diag(of_X) for x, _ in parts])
    c = np.stack([np.einsum("tfp,tf->p", x, r) - len(x) * of_y for x, r in parts])
    normal, right = (np.concatenate([x.sum(axis=0, keepdims=True), x.sum(axis=0) - x]) for x in (A, c))
    eigenvalues, vectors = np.linalg.eigh(normal)  # of all, then without one block each
    kept = np.abs(eigenvalues) > INDEPENDENT * np.abs(eigenvalues).max(axis=1, keepdims=True)
    lost = (np.linalg.norm(np.where(kept[:, np.newaxis], 0.0, vectors), axis=2) > SHARE).any(axis=0)
    inverse = (
        np.where(kept, 1.0 / np.where(kept, eigenvalues, 1.0), 0.0)[:, np.newaxis] * vectors @ vectors.swapaxes(1, 2)
    )
    solved = np.einsum("bpq,bq->bp", inverse, right)
    solved += np.einsum("bpq,bq->bp", inverse, right - np.einsum("bpq,bq->bp", normal, solved))  # against round-off
    off = solved[1:] - solved[0]
    residual = y - X @ solved[0]
    explained = float(np.sqrt(np.mean(residual**2) / max(float(np.mean(y**2)), 1e-300)))
    values[moving] = np.where(lost, np.nan, solved[0] / size)
    variances[moving] = np.where(lost, np.inf, (off**2).sum(axis=0) * (blocks - 1) / blocks / size**2)
    return _Solution(values, variances, width, freedoms, explained)


def _estimate(solution: _Solution, place: int, confidence: float, described: float, step: float) -> Estimate:
    """Return a parameter with its interval, by Student's t."""
    with optional_import("SciPy", "fit needs"):
        from scipy.stats import t as student
    quantile = float(student.ppf(0.5 + confidence / 2, solution.freedoms))
    value, error = float(solution.values[place]), float(np.sqrt(float(solution.variances[place])))
    low, high = value - quantile * error, value + quantile * error
    return Estimate(value, error, low, high, described, 2 * solution.half * step, solution.unexplained)


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
