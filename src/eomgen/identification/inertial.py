"""Masses, inertias and friction from a measured motion and its drives: base parameters by least squares.

    Y_b(q, v, a) beta = u - laws(q, v)

over time, one row per coordinate whose force is known, each weighted by what its own noise is.  All terms pass the same
filters, as in ``fit``.  Where a drive stands still in a filter's window its dry friction is unknown, and its row is
left out.  What noise of the motion adds to the columns on average is not taken off.  ``consistent`` then chooses links
that have these base parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..description import RobotLike, as_robot
from ..errors import InputError
from ..motion.files import MeasuredMotion, measured_motion
from ..motion.smoothing import Differentiator, bell, filtered, noise_deviation
from ..names import component_name, joint_of, kind_of, listed, show
from ..pipeline.stages import build
from ..progress import StageReport
from ..robot.coordinates import force_unit_of
from ..robot.model import build_model
from ..robot.value import MOTOR, Friction, Robot
from ..runtime.kernel import Kernel
from ..shown import Shown
from .consistent import doubt, nearest_bodies, with_parameters
from .estimating import FIRST, HALF_WIDTHS, block_count, even_step, least_samples
from .identifiable import TERMS, BaseParameters, columns, combinations, regrouped, with_formulas

Array = NDArray[np.float64]

REWEIGHTED = 4  # times that weights follow the residuals
SPREAD = 0.5  # relative, of the description's numbers of single links
RESTING = 0.02  # of the rms of a rate: below it a drive stands still
NOISES = 3.0  # deviations of a rate's noise below which it stands still, too
LEFT = 0.25  # of all rows that a filter must leave
PIECE = 2000  # samples at a time whose whole regressor is in memory
EXACT = 1e-6  # of the largest residual: smaller ones weigh no more
UNDETERMINED = 1e-13  # of the greatest singular value: directions that round-off alone decides stay 0
MOST_NUMBERS = 100_000_000  # of all columns at all times


@dataclass(frozen=True)
class Residuals:
    """Residuals of a drive, rms, N or N m: of samples that parameters were fitted to, and of blocks held out.

    ``drive`` is the rms of the measured drive itself over the whole record, ``samples`` how many count.
    """

    fitted: float
    held_out: float
    drive: float
    samples: int

    @property
    def relative(self) -> tuple[float, float]:
        """Both, fitted and held out, over the drive's rms."""
        return self.fitted / max(self.drive, 1e-300), self.held_out / max(self.drive, 1e-300)


@dataclass(frozen=True)
class IdentifyResult(Shown):
    """Base parameters with their standard deviations, and what they leave of each drive.

    Attributes:
        robot: the description with links that have these base parameters, near to its own, and that are bodies.
        base: the combinations that the motion shows, with their formulas.
        base_values: of these, (b,), SI units.
        deviations: standard deviations, (b,), the jackknife's over blocks of time.
        described: the description's values of the same combinations, (b,).
        parameters: of the links, rotors and drives of ``robot`` by name, kg, kg m, kg m^2, N m s, N m and their like.
        residuals: by the names of the coordinates.
        width: of the filter, s.
        warnings, notes: lines about what is doubtful, and about the method.
    """

    robot: Robot
    base: BaseParameters
    base_values: Array
    deviations: Array
    described: Array
    parameters: dict[str, float]
    residuals: dict[str, Residuals]
    width: float
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def base_names(self) -> tuple[str, ...]:
        """Formulas of the combinations, such as "link2.mx + 0.4318 link3.m"."""
        return self.base.names

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            **self.base.as_dict(),
            "values": dict(zip(self.base_names, self.base_values.tolist(), strict=True)),
            "deviations": dict(zip(self.base_names, self.deviations.tolist(), strict=True)),
            "described": dict(zip(self.base_names, self.described.tolist(), strict=True)),
            "parameters": self.parameters,
            "residuals": {
                name: {**vars(found), "relative": dict(zip(("fitted", "held_out"), found.relative, strict=True))}
                for name, found in self.residuals.items()
            },
            "width": self.width,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Tables for people."""
        lines = [f"{self.base.robot}: {len(self.base)} base parameters by least squares", ""]
        lines.append(f"{'value':>12}{'std. dev.':>12}{'described':>12}  parameter")
        for name, *numbers in zip(self.base_names, self.base_values, self.deviations, self.described, strict=True):
            value, deviation, described = (float(x) for x in numbers)
            lines.append(f"{value:>12.5g}{deviation:>12.2g}{described:>12.5g}  {name}")
        lines += ["", f"{'residual, rms':<28}{'fitted':>12}{'held out':>12}{'of the drive':>24}"]
        for name, found in self.residuals.items():
            label, (fitted, held_out) = f"{name} [{force_unit_of(name)}]", found.relative
            share = f"{100 * fitted:.3g} %, {100 * held_out:.3g} %"
            lines.append(f"{label:<28}{found.fitted:>12.4g}{found.held_out:>12.4g}{share:>24}")
        return lines + ["", *(f"warning: {x}" for x in self.warnings), *(f"note: {x}" for x in self.notes)]


def identify(
    robot: RobotLike,
    motion: MeasuredMotion | Path | str,
    *,
    terms: Sequence[str] = TERMS,
    spread: float = SPREAD,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> IdentifyResult:
    """Base parameters of a robot from a motion and its drives.

    Geometry and gravity are the description's, and so are springs and all other laws of coordinates but for those that
    are sought: damping, dry friction and preload of coordinates with a drive.  The motion has samples at equal
    distances in time.  Forces are known where a drive is in the motion, and, 0, at coordinates that were measured and
    have none.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        motion: from ``read_motion`` or ``motion_from_columns``, or the path of a file.
        terms: what is sought, among TERMS, as of ``base_parameters``.
        spread: how far the description's numbers of single links are off, relative to themselves; what base parameters
            leave open stays near to them.
        kernel: of ``without_sought(robot, terms)``, float64, with regressor and inverse_dynamics; built if not given.

    Raises:
        InputError: the file or an argument cannot be used, samples are too few or not evenly spaced, no force is known,
            or the robot has loops or couplings.
    """
    robot = as_robot(robot)
    if not 0.0 < spread < np.inf:
        raise InputError(f"spread: {show(spread)}; allowed: a number above 0")
    if robot.is_closed:
        raise InputError(f"identify: {robot.name} has loops or couplings; allowed: robots without")
    if kernel is None:
        bare = without_sought(robot, terms)
        kernel = build(bare, kernels=("regressor", "inverse_dynamics"), progress=progress or (lambda _: None))
    motion = measured_motion(robot.name, motion, kernel.coordinates)
    step = even_step(motion)
    known, moving = _known(robot, motion), np.isin(kernel.coordinates, motion.measured)
    base = combinations(kernel, terms, moving, known)
    data = _Data(kernel, motion, base, known, step, is_dry="dry" in terms)
    shown, warnings = data.shown(base)
    if len(shown) < len(base):
        data.columns = data.columns[..., np.isin(base.chosen, shown.chosen)]
    found = [
        _Solution.of(data, half)
        for half in HALF_WIDTHS
        if len(motion.t) >= least_samples(FIRST + half) and data.share(half) >= LEFT
    ]
    if not found:
        raise InputError(
            f"{motion.source}: drives stand still too often between {len(motion.t)} samples; allowed: motions that"
            " turn round less often, or terms without dry"
        )
    best = min(found, key=lambda solution: float(np.log(solution.variances).sum()))
    drawn = _described(robot, kernel, shown)
    theta = nearest_bodies(shown, best.values, best.covariance, drawn, spread)
    parameters = dict(zip(shown.parameters, theta.tolist(), strict=True))
    deviations = np.sqrt(best.variances)
    warnings += _doubts(shown, best.values, deviations)
    sure = np.hypot(deviations, doubt(best.values))
    moved = float((np.abs(shown.matrix @ theta - best.values) / sure).max())
    notes = [*_notes(kernel, motion, data), f"links that are bodies: base values off by {moved:.2g} deviations at most"]
    return IdentifyResult(
        robot=with_parameters(robot, parameters),
        base=shown,
        base_values=best.values,
        deviations=deviations,
        described=shown.matrix @ drawn,
        parameters=parameters,
        residuals=data.residuals(best, motion),
        width=2 * (data.half + best.half) * step,
        warnings=tuple(warnings),
        notes=tuple(notes),
    )


def without_sought(robot: Robot, terms: Sequence[str]) -> Robot:
    """The robot without damping, dry friction and preload of coordinates with a drive, as far as they are sought."""
    model = build_model(robot)
    driven = {model.coordinates[i] for i in model.driven}
    lost: dict[str, Any] = {"damping": None} if "viscous" in terms else {}
    lost |= {"preload": None} if "offset" in terms else {}
    joints = []
    for joint in robot.joints:
        own = {
            name: replace(given, **lost, friction=_known_friction(given.friction, terms))
            if component_name(joint.name, name) in driven
            else given
            for name, given in joint.coordinates.items()
        }
        motor = joint.motor
        if motor is not None and component_name(joint.name, MOTOR) in driven:
            motor = replace(motor, friction=_known_friction(motor.friction, terms))
        joints.append(replace(joint, coordinates=own, motor=motor))
    gone = {f"joints.{name}.{key}" for name in driven for key in (*lost, "friction")}
    left = [name for name in robot.tunable if not name.startswith(tuple(gone))]
    return replace(robot, joints=tuple(joints), tunable=tuple(left))


def _known_friction(friction: Friction | None, terms: Sequence[str]) -> Friction | None:
    """Give what of a coordinate's friction is not sought."""
    if friction is None:
        return None
    viscous = None if "viscous" in terms else friction.viscous
    if "dry" not in terms:
        return replace(friction, viscous=viscous)
    return Friction(viscous=viscous, smoothing=friction.smoothing) if viscous else None


def _known(robot: Robot, motion: MeasuredMotion) -> NDArray[np.bool_]:
    """Coordinates at which the force is known, (n,): drives of the motion, and measured ones that have no drive."""
    model = build_model(robot)
    driven = {model.coordinates[i] for i in (*model.driven, *model.prescribed)}
    free = [name for name in motion.measured if name not in driven]
    known = np.isin(model.coordinates, [*motion.driven, *free]) & np.isin(model.coordinates, motion.measured)
    if not known.any():
        raise InputError(
            f"{motion.source}: no drive is known; allowed: columns such as {min(driven, default='')}.drive"
        )
    return np.asarray(known, dtype=np.bool_)


class _Data:
    """Columns and forces of the rows that are known, (T, r, b) and (T, r), behind the filter that differentiates.

    half: of that filter; 0 where rates and accelerations come with the motion.  names: of the rows' coordinates.
    resting: whether a drive stands still, (T, r), so that its dry friction is unknown.
    """

    def __init__(
        self,
        kernel: Kernel,
        motion: MeasuredMotion,
        base: BaseParameters,
        known: NDArray[np.bool_],
        step: float,
        *,
        is_dry: bool,
    ) -> None:
        if motion.v is not None and motion.a is not None:
            q, v, a, u, self.half = motion.q, motion.v, motion.a, motion.u, 0
            noise = np.zeros(kernel.n)
        else:
            narrow, self.half = Differentiator(FIRST, step), FIRST
            q, u = narrow(motion.q), narrow(motion.u)
            v = narrow(motion.q, 1) if motion.v is None else narrow(motion.v)
            a = narrow(motion.q, 2) if motion.v is None else narrow(motion.v, 1)
            order, given = (1, motion.q) if motion.v is None else (0, motion.v)
            noise = noise_deviation(given) * np.linalg.norm(narrow.weights[order])
        self.names = tuple(np.array(kernel.coordinates)[known].tolist())
        if len(q) * len(self.names) * len(base) > MOST_NUMBERS:
            raise InputError(
                f"{motion.source}: {len(motion.t)} samples; allowed: at most"
                f" {MOST_NUMBERS // (len(self.names) * len(base))} for {len(base)} parameters"
            )
        laws = np.asarray(kernel.inverse_dynamics(q, v, a))
        parts = []
        for first in range(0, len(q), PIECE):
            at = slice(first, first + PIECE)
            laws[at] -= np.asarray(kernel.regressor(q[at], v[at], a[at])) @ kernel.regressor_values
            parts.append(columns(kernel, q[at], v[at], a[at], base.terms)[1][:, known][..., base.chosen])
        self.columns: Array = np.concatenate(parts)
        self.forces: Array = (u - laws)[:, known]
        still = np.abs(v) <= np.maximum(RESTING * np.sqrt(np.mean(v**2, axis=0)), NOISES * noise)
        own = np.zeros(kernel.n, dtype=np.bool_)
        own[list(kernel.raw.libraries.meta["driven"])] = is_dry
        self.resting: NDArray[np.bool_] = (still & own)[:, known]

    def shown(self, base: BaseParameters) -> tuple[BaseParameters, list[str]]:
        """Give what of the combinations this motion can tell apart, and a warning where that is fewer."""
        rows = self.columns[~self.resting]
        if not len(rows):
            return base, []
        chosen, matrix = regrouped(np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64))
        if len(chosen) == len(base):
            return base, []
        whole = with_formulas(base.robot, base.terms, base.parameters, base.chosen[chosen], matrix @ base.matrix)
        return whole, [f"the motion shows {len(chosen)} of {len(base)} base parameters; others move it as these do"]

    def kept(self, half: int) -> NDArray[np.bool_]:
        """Rows without a standstill in the window of a filter, (T - 2 half, r)."""
        if not half:
            return ~self.resting
        counts = np.cumsum(np.vstack([np.zeros((1, self.resting.shape[1])), self.resting]), axis=0)
        return np.asarray(counts[2 * half + 1 :] == counts[: -2 * half - 1])

    def share(self, half: int) -> float:
        """How much of all rows a filter leaves; of the drive with the fewest."""
        return float(self.kept(half).mean(axis=0).min(initial=1.0))

    def residuals(self, solution: _Solution, motion: MeasuredMotion) -> dict[str, Residuals]:
        """Give the residuals of a solution by the names of the rows' coordinates."""
        found = {}
        for row, name in enumerate(self.names):
            drive = float(np.sqrt(np.mean(motion.u[:, motion.coordinates.index(name)] ** 2)))
            fitted, held_out = float(solution.fitted[row]), float(solution.held_out[row])
            found[name] = Residuals(fitted, held_out, drive, int(solution.counts[row]))
        return found


@dataclass(frozen=True)
class _Solution:
    """Weighted least squares behind a bell of that half width; variances are the jackknife's over blocks of time.

    covariance: that of white residuals, made as wide as the jackknife's on average.
    fitted, held_out: rms of residuals, (r,); counts: of samples, (r,).
    """

    half: int
    values: Array
    variances: Array
    covariance: Array
    fitted: Array
    held_out: Array
    counts: NDArray[np.intp]

    @classmethod
    def of(cls, data: _Data, half: int) -> _Solution:
        """Solve for the parameters, and once more without each block of time."""
        wide, (samples, rows, count) = bell(half), data.columns.shape
        X = filtered(data.columns.reshape(samples, -1), wide).reshape(-1, rows, count) if half else data.columns
        y, kept = (filtered(data.forces, wide) if half else data.forces), data.kept(half)
        size = np.sqrt(np.mean(X**2, axis=(0, 1)))
        size[size == 0.0] = 1.0
        both = np.concatenate([X / size, y[..., None]], axis=2) * kept[..., None]
        blocks = np.array_split(both, block_count(len(X), max(data.half + half, 1)))
        R = np.stack([[np.linalg.qr(_padded(block[:, row]), mode="r") for row in range(rows)] for block in blocks])
        counts, weights = kept.sum(axis=0), np.ones(rows)
        for _ in range(REWEIGHTED):
            values = _solved(R * weights[:, None, None])
            fitted = np.sqrt(_left(R, values).sum(axis=0) / np.maximum(counts, 1))
            weights = 1.0 / np.maximum(fitted, EXACT * max(float(fitted.max()), 1e-300))
        weighted = R * weights[:, None, None]
        merged = np.stack([np.linalg.qr(block.reshape(-1, count + 1), mode="r") for block in weighted])
        without = [_solved(np.delete(merged, place, axis=0)) for place in range(len(blocks))]
        left = sum(_left(block, x) for block, x in zip(R, without, strict=True))
        off = np.stack(without) - values
        variances = (off**2).sum(axis=0) * (len(blocks) - 1) / len(blocks)
        held_out = np.sqrt(left / np.maximum(counts, 1))
        variances = np.maximum(variances, 1e-300)
        covariance = _covariance(merged, variances) / np.outer(size, size)
        return cls(half, values / size, variances / size**2, covariance, fitted, held_out, counts)


def _covariance(R: Array, variances: Array) -> Array:
    """The covariance, (b, b), that rows of weighted triangles give, with these variances on average."""
    rows = R.reshape(-1, R.shape[-1])[:, :-1]
    white = np.linalg.pinv(rows.T @ rows, rcond=UNDETERMINED, hermitian=True)
    own = np.maximum(np.diagonal(white), 1e-300)
    return np.asarray(white * np.exp(np.mean(np.log(variances / own))))


def _padded(rows: Array) -> Array:
    """The rows, and rows of zeros until there are as many as columns."""
    return np.pad(rows, ((0, max(rows.shape[1] - len(rows), 0)), (0, 0)))


def _solved(R: Array) -> Array:
    """Least squares of stacked rows whose last column is the right side."""
    rows = np.asarray(np.linalg.qr(R.reshape(-1, R.shape[-1]), mode="r"))
    return np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=UNDETERMINED)[0])


def _left(R: Array, values: Array) -> Array:
    """Sums of squares of what values leave of triangles (..., b + 1, b + 1)."""
    return np.asarray(((R[..., :-1] @ values - R[..., -1]) ** 2).sum(axis=-1))


def _described(robot: Robot, kernel: Kernel, base: BaseParameters) -> Array:
    """The description's values of all parameters, (p,)."""
    theta = dict(zip(kernel.regressor_names, kernel.regressor_values.tolist(), strict=True))
    for name in (kernel.coordinates[i] for i in kernel.raw.libraries.meta["driven"]):
        joint = robot.joint(joint_of(name))
        given = joint.motor.rotor if joint.motor and kind_of(name) == MOTOR else joint.coordinates[kind_of(name)]
        dry = given.friction
        is_own = kind_of(name) != MOTOR  # a rotor's damping is its transmission's
        theta[f"{name}.viscous"] = (given.damping or 0.0) * is_own + (dry.viscous or 0.0 if dry else 0.0)
        theta[f"{name}.dry"] = dry.coulomb if dry else 0.0
        theta[f"{name}.offset"] = given.preload or 0.0
    return np.array([theta[name] for name in base.parameters])


def _doubts(base: BaseParameters, values: Array, deviations: Array) -> list[str]:
    """Warnings about parameters that the motion hardly shows, and about friction that drives."""
    hardly = [name for name, x, d in zip(base.names, values, deviations, strict=True) if abs(x) < 2.0 * d]
    found = [f"within two standard deviations of zero: {listed(hardly)}"] if hardly else []
    for name, x, d in zip(base.names, values, deviations, strict=True):
        if name.endswith((".viscous", ".dry")) and x < -2.0 * d:
            found.append(f"{name} is negative; is the drive's sign right?")
    return found


def _notes(kernel: Kernel, motion: MeasuredMotion, data: _Data) -> tuple[str, ...]:
    how = "central differences of eighth order behind a bell of 9 samples" if data.half else "from the file"
    notes = [f"rates and accelerations: {how}; all terms filtered alike; rows weighted by their residuals"]
    held = [name for name in kernel.coordinates if name not in motion.measured]
    if held:
        notes.append(f"not in the file, held at zero: {', '.join(held)}")
    if data.resting.any():
        notes.append(f"standstill left out: {100 * data.resting.mean():.3g} % of all samples of drives")
    return tuple(notes)
