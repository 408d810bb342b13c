"""Least squares of base parameters over time: columns, filters, weights, blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index, Mask
from ...errors import InputError
from ...kernel.complete import Kernel
from ...motion.files import MeasuredMotion
from ...motion.smoothing import Differentiator, bell, filtered, noise_deviation
from ...names import component_name
from ...state.springs import law_numbers
from ..estimating import FIRST, block_count, least_samples
from ..identifiable import (
    MODES,
    TRANSMISSIONS,
    BaseParameters,
    columns,
    inertial_places,
    modal_places,
    regrouped,
    with_formulas,
)
from .further import NEIGHBOURS, Sought, State
from .result import Residuals

FIRSTS = (FIRST, 16, 32, 64, 128)  # half widths of the filter that differentiates
NOISY = 0.1  # of the rms of an acceleration: noise that the next wider one is taken for
STRICT = 0.3  # of that, where small deflections are sought beside accelerations
REWEIGHTED, ALIKE = 200, 1e-4  # times that weights follow the residuals at most, and by how much they still change
RESTING = 0.02  # of the rms of a rate: below it a drive stands still
NOISES = 3.0  # deviations of a rate's noise below which it stands still, too
FILTERS = (0, 8, 16, 32, 128)  # half widths of the second filter, samples
AS_GOOD = 5.0  # times the least share of a force that is not predicted: white noise alone makes such a difference
LEFT = 0.25  # of the rows of every drive that a filter must leave
PIECE = 2000  # samples at a time whose columns are in memory
SIZES = {"stiffness": 1e5, "damping": 1e2}  # N m/rad, N m s/rad: deflections are small, and no round-off
CLEAR = 0.2  # of a column's square: what noise must leave of it for a parameter to be identifiable
EXACT = 1e-6  # of the largest residual: smaller ones weigh no more
ROUND_OFF = 1e-9  # of the forces in a row: residuals are no smaller
TRUSTED = 5e-5  # of the forces in a row, to which they are known at most where links are chosen
UNDETERMINED = 1e-13  # of the greatest singular value: directions that round-off alone decides stay 0


class Data:
    """Columns and forces of the rows that are known, (T, r, b) and (T, r), behind the filter that differentiates.

    Columns are made anew, PIECE samples at a time, wherever they are needed, and are never all in memory.

    half: of that filter; 0 where velocities and accelerations come with the motion.  names: of the rows' coordinates.
    resting: whether a drive stands still, (T, r), so that its Coulomb friction is unknown.  total: measured drives, and
    laws what of them is the description's, (T, r).  v: rates, (T, n).  spoiled_samples: (T, n) of the motion, whose
    rows are left out as those at rest are.
    """

    def __init__(
        self,
        kernel: Kernel,
        motion: MeasuredMotion,
        base: BaseParameters,
        known: Mask,
        step: float,
        spoiled_samples: Mask | None = None,
    ) -> None:
        assert base.relations is not None
        self.kernel, self.motion, self.base, self.known, self.step = kernel, motion, base, known, step
        self.relations, self._narrow, self.half = base.relations, None, 0
        self._q, self.v, self._a, noise = self._motion()
        self.names = tuple(np.array(self.relations.rows)[known].tolist())
        laws = np.asarray(kernel.inverse_dynamics(self._q, self.v, self._a))
        places = inertial_places(kernel, base.terms, self.relations)
        for at in self.chunks():
            sought = np.asarray(kernel.functions.regressor(self._q[at], self.v[at], self._a[at]))[..., places]
            laws[at] -= sought @ kernel.regressor_values[places]
        if MODES in base.terms:
            numbers = law_numbers(kernel)
            for i in modal_places(kernel):
                own = numbers[kernel.coordinates[i]]
                laws[:, i] -= own["stiffness"] * self._q[:, i] + own["damping"] * self.v[:, i]
        self.laws: Array = self.relations.forces(laws)[:, known]
        still = np.abs(self.v) <= np.maximum(RESTING * np.sqrt(np.mean(self.v**2, axis=0)), NOISES * noise)
        rubs = np.zeros(kernel.n, dtype=np.bool_)
        rubs[list(self.relations.rubbing)] = "dry" in base.terms
        self.resting: Mask = self.relations.rows_of(still & rubs)[:, known]
        bad = spoiled_samples
        if bad is not None and bad.any():
            window = np.ones(2 * self.half + 1)
            near = np.stack([np.convolve(x, window, "valid") > 0.5 for x in bad.T.astype(np.float64)], axis=1)
            self.resting |= self.relations.rows_of(near)[:, known]
        self.total = self.measured(motion.u)
        self.forces: Array = self.total - self.laws

    _narrow: Differentiator | None
    extra: Callable[[slice], Array] | None = None  # columns beside those of the base parameters
    extra_count = 0

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self.base) + self.extra_count

    def chunks(self, lost: int = 0) -> Iterator[slice]:
        """Give the samples whose columns are in memory at a time; without as many at the end as a filter loses."""
        samples = len(self.v) - lost
        return (slice(first, min(first + PIECE, samples)) for first in range(0, samples, PIECE))

    def columns(self, at: slice) -> Array:
        """Make the columns at some samples, (t, r, count)."""
        rows = columns(self.kernel, self._q[at], self.v[at], self._a[at], self.base.terms, self.relations)[1]
        block = rows[:, self.known][..., self.base.chosen]
        return block if self.extra is None else np.concatenate([block, self.extra(at)], axis=-1)

    def triangle(self, counting: Mask, size: Array | float = 1.0) -> Array:
        """Give what QR leaves of all columns, (count, count): R of the rows that count, (T, r), over their size."""
        R = np.zeros((self.count, self.count))
        for at in self.chunks():
            R = merged(R, (self.columns(at) / size)[counting[at]])
        return R

    def _motion(self) -> tuple[Array, Array, Array, Array]:
        """Return coordinates, velocities and accelerations behind the filter, (T, n), and the velocities' noise."""
        motion = self.motion
        if motion.v is not None and motion.a is not None:
            return motion.q, motion.v, motion.a, np.zeros(len(motion.coordinates))
        self._narrow = narrow = self._differentiator()
        self.half = narrow.half
        v = narrow(motion.q, 1) if motion.v is None else narrow(motion.v)
        a = narrow(motion.q, 2) if motion.v is None else narrow(motion.v, 1)
        order, measured = (1, motion.q) if motion.v is None else (0, motion.v)
        noise = noise_deviation(measured) * np.linalg.norm(narrow.weights[order])
        if not self.relations.is_coupled:
            return narrow(motion.q), v, a, noise
        free, matrix = list(self.relations.free), self.relations.matrix.T  # exactly, which kernels ask for
        q = narrow(motion.q)[:, free] @ matrix + self.relations.offset
        return q, v[:, free] @ matrix, a[:, free] @ matrix, noise

    def _differentiator(self) -> Differentiator:
        """Return the narrowest filter behind which noise is small beside all accelerations, and else the widest."""
        motion, places = self.motion, [self.motion.coordinates.index(name) for name in self.motion.measured]
        measured, order = (motion.q, 2) if motion.v is None else (motion.v, 1)
        strict = STRICT if TRANSMISSIONS in self.base.terms else 1.0
        unit = np.ones(len(motion.coordinates))
        for rotor, _, ratio in self.relations.motors:  # shafts beside joints, as these turn
            unit[rotor] = 1.0 / abs(ratio)
        measured = measured * unit
        noise, differentiator = noise_deviation(measured)[places], Differentiator(FIRST, self.step)
        for half in FIRSTS:
            if len(motion.t) < least_samples(half):
                break
            differentiator = Differentiator(half, self.step)
            size = np.sqrt(np.mean(differentiator(measured[:, places], order) ** 2, axis=0))
            off = noise * np.linalg.norm(differentiator.weights[order])
            if (off <= strict * np.maximum(NOISY * size, RESTING * size.max())).all():
                break
        return differentiator

    def measured(self, u: Array) -> Array:
        """Return forces of the rows, (T, r), behind the filter, of drives at all coordinates."""
        return self.relations.forces(self._narrow(u) if self._narrow else u)[:, self.known]

    def at(self, sought: Sought, state: State) -> Data:
        """Return the data with present values of what forces are not linear in."""
        data = copy(self)
        data.total = self.measured(sought.drives_of(state, self.motion.u))
        data.forces = data.total - self.laws - sought.friction(state, self.v) @ sought.matrix
        ends = int(np.ceil(abs(state.delay) / self.step)) + NEIGHBOURS if state.delay else 0
        if ends:
            data.resting = self.resting.copy()
            data.resting[:ends], data.resting[-ends:] = True, True
        return data

    def beside(self, extra: Callable[[slice], Array]) -> Data:
        """Give the same data with further columns, (t, r, e) of t samples, beside those of the base parameters."""
        data = copy(self)
        data.extra, data.extra_count = extra, extra(slice(0, 1)).shape[-1]
        return data

    def with_steps(self, sought: Sought, state: State, solution: Solution) -> Data:
        """Give the same data with columns of steps of what forces are not linear in, about a state and its solution."""
        predicted = self.predicted(solution)
        slopes = np.gradient(predicted, self.step, axis=0)
        return self.beside(lambda at: sought.columns(state, predicted[at], slopes[at], self.v[at]))

    def turned(self, row: int) -> Data:
        """Return the data with one drive in the other sense."""
        data = copy(self)
        data.forces = self.forces.copy()
        data.forces[:, row] -= 2.0 * self.total[:, row]
        return data

    def predicted(self, solution: Solution) -> Array:
        """Return forces of the rows, (T, r), by known terms and identified parameters."""
        values = solution.values[: self.count]
        return np.concatenate([self.columns(at) @ values for at in self.chunks()]) + self.total - self.forces

    def shown(self, base: BaseParameters) -> tuple[BaseParameters, list[str]]:
        """Return the combinations that this motion can distinguish, and a warning where these are fewer."""
        if self.resting.all():
            return base, []
        size = np.array([SIZES.get(base.parameters[place].rpartition(".")[2], 1.0) for place in base.chosen])
        chosen, matrix = regrouped(self.triangle(~self.resting) * size)
        matrix = matrix * size[chosen][:, None] / size
        if len(chosen) == len(base):
            return base, []
        places, whole = base.chosen[chosen], matrix @ base.matrix
        formulas = with_formulas(base.robot, base.terms, base.parameters, places, whole, base.relations)
        return formulas, [f"the motion shows {len(chosen)} of {len(base)} base parameters; others move it as these do"]

    def kept(self, half: int) -> Mask:
        """Return rows without a standstill in the window of a filter, (T - 2 half, r)."""
        if not half:
            return ~self.resting
        counts = np.cumsum(np.vstack([np.zeros((1, self.resting.shape[1])), self.resting]), axis=0)
        return np.asarray(counts[2 * half + 1 :] == counts[: -2 * half - 1])

    def column_noise(self, half: int, count: int) -> Array:
        """Give variances of what white noise of the motion adds to columns of transmissions and modes, (r, count).

        They are 0 elsewhere.

        Behind the first filter and a bell of that half width.  Deflections are small beside what they are the
        difference of, so that noise of both ends counts there long before it does elsewhere.
        """
        variances, motion = np.zeros((len(self.names), count)), self.motion
        names = [self.base.parameters[place] for place in self.base.chosen]
        first = np.ones((2, 1)) if self._narrow is None else self._narrow.weights[: 2 if motion.v is None else 1]
        gains = [float((np.convolve(row, bell(half) if half else [1.0]) ** 2).sum()) for row in first]
        angles = noise_deviation(motion.q)
        rates = angles if motion.v is None else noise_deviation(motion.v)
        ends = [(rotor, {rotor: 1.0 / ratio, joint: -1.0}) for rotor, joint, ratio in self.relations.motors]
        ends += [(mode, {mode: 1.0}) for mode in modal_places(self.kernel)]
        for owner, row in ends:
            force, places = np.zeros(len(motion.coordinates)), list(row)
            force[places] = list(row.values())
            onto = self.relations.forces(force)[self.known]
            for key, noise, gain in (("stiffness", angles, gains[0]), ("damping", rates, gains[-1])):
                name = component_name(motion.coordinates[owner], key)
                if name in names:
                    variances[:, names.index(name)] = onto**2 * gain * ((force[places] * noise[places]) ** 2).sum()
        return variances

    def residuals(self, solution: Solution, of_robot: Array) -> dict[str, Residuals]:
        """Give the residuals of a solution, and of the robot, (r,), by the names of the rows' coordinates."""
        residuals, drives = {}, self.drive_sizes().tolist()
        for row, name in enumerate(self.names):
            drive = drives[row]
            fitted, held_out = float(solution.fitted[row]), float(solution.held_out[row])
            residuals[name] = Residuals(fitted, held_out, drive, int(solution.counts[row]), float(of_robot[row]))
        return residuals

    def drive_sizes(self) -> Array:
        """Return the rms of the drive in each row, (r,); where there is none, of the forces that are known."""
        drives, known = (np.sqrt(np.mean(x**2, axis=0)) for x in (self.total, self.forces))
        return np.asarray(np.maximum(np.where(drives > 0.0, drives, known), 1e-300))

    def over_time(self, solution: Solution) -> tuple[Array, Array, Array, Mask]:
        """Return times, (T,), and drives, measured and predicted behind the filter, and whether they count, (T, r)."""
        drives, fitted = self.total, self.predicted(solution)
        if solution.half:
            drives, fitted = (filtered(x, bell(solution.half)) for x in (drives, fitted))
        cut = self.half + solution.half
        return self.motion.t[cut : len(self.motion.t) - cut], drives, fitted, self.kept(solution.half)


def chosen_filter(data: Data, widths: Sequence[int]) -> tuple[int, str]:
    """Choose the second filter: its half width, samples, and a note with the alternatives.

    Noise and vibration in the columns bias parameters behind a filter that lets them pass, with small standard
    deviations.  So filters are left out behind which much more of the forces is not predicted in blocks of time that
    were held out, at any coordinate; of the others that with the smallest standard deviations is chosen.

    Raises:
        InputError: no filter leaves enough samples.
    """
    samples, first = len(data.motion.t), data.half or FIRST
    fitting = [half for half in widths if samples >= least_samples(first + half)]
    if not fitting:
        raise InputError(
            f"{data.motion.source}: {samples} samples; a filter of half width {min(widths)} needs at least"
            f" {least_samples(first + min(widths))}"
        )
    solutions = [Solution.of(data, half) for half in fitting if data.kept(half).mean(axis=0).min(initial=1.0) >= LEFT]
    if not solutions:
        raise InputError(
            f"{data.motion.source}: drives stand still too often between {samples} samples; allowed: motions that"
            " turn round less often, narrower filters, or terms without dry"
        )
    if len(solutions) == 1:
        return solutions[0].half, f"second filter: half width {solutions[0].half} samples, without an alternative"
    shares = np.array([x.unpredicted for x in solutions])
    worse = (shares / shares.min(axis=0)).max(axis=1)
    good = [x for x, ratio in zip(solutions, worse, strict=True) if ratio <= max(AS_GOOD, worse.min())]
    best = min(good, key=lambda x: float(np.log(x.variances).sum()))
    worst = [f"{x.half}: {100.0 * share.max():.3g} %" for x, share in zip(solutions, shares, strict=True)]
    return best.half, (
        f"second filter: half width {best.half} samples; not predicted of held-out forces behind each, at the worst"
        f" coordinate: {', '.join(worst)}"
    )


@dataclass(frozen=True)
class Solution:
    """Weighted least squares behind a bell of that half width; variances are the jackknife's over blocks of time.

    root: square root of the information on the b base parameters, (b, b): that of white residuals, made as small as the
    jackknife's on average.
    fitted, held_out: rms of residuals, (r,); counts: of samples, (r,).  noise_share: of a column's square beside all
    others, what is noise, (b,).  rows: triangles of columns and forces of each row, (r, count + 1, count + 1).
    is_converged: whether weights and residuals have become consistent.
    """

    half: int
    values: Array
    variances: Array
    root: Array
    fitted: Array
    held_out: Array
    counts: Index
    noise_share: Array
    rows: Array
    is_converged: bool

    @classmethod
    def of(cls, data: Data, half: int) -> Solution:
        """Solve for the parameters, and once more without each block of time."""
        kept, count = data.kept(half), data.count
        blocks = block_count(len(kept), max(data.half + half, 1))
        R, size = _triangles(data, half, kept, blocks)
        counts, rows = kept.sum(axis=0), _compressed(R.swapaxes(0, 1))
        blurred = data.column_noise(half, count) / size**2
        seen = np.stack([block.sum(axis=0) for block in np.array_split(kept, blocks)])  # samples, (blocks, r)
        values, weights, fitted, is_converged = _reweighted(rows, counts, blurred)
        triangles = _compressed(R * weights[:, None, None])
        noise = seen * weights**2 @ blurred
        without = [
            _solved(np.delete(triangles, place, axis=0), noise.sum(axis=0) - noise[place]) for place in range(blocks)
        ]
        left = sum(_left(block, x) for block, x in zip(R, without, strict=True))
        off = np.stack(without) - values
        variances = (off**2).sum(axis=0) * (blocks - 1) / blocks
        held_out = np.sqrt(left / np.maximum(counts, 1))
        variances = np.maximum(variances, 1e-300)
        trusted = 1.0 / np.maximum(fitted, TRUSTED * _forces(rows, counts))
        root = _root(rows * trusted[:, None, None], variances, len(data.base))
        share = _noise_share(triangles, noise.sum(axis=0))
        rows[..., :-1] *= size
        known = (values / size, variances / size**2, root * size[: len(data.base)])
        return cls(half, *known, fitted, held_out, counts, share, rows, is_converged)

    @property
    def unpredicted(self) -> Array:
        """Return the share of each row's forces that is not predicted in blocks held out, (r,)."""
        return np.maximum(self.held_out / np.maximum(_forces(self.rows, self.counts), 1e-300), ROUND_OFF)

    def left_of(self, values: Array) -> Array:
        """Return rms of what other values, (count,), leave of the rows' forces, (r,)."""
        return np.asarray(np.sqrt(_left(self.rows, values) / np.maximum(self.counts, 1)))


def _reweighted(rows: Array, counts: Index, blurred: Array) -> tuple[Array, Array, Array, bool]:
    """Return values, weights, (r,), residuals, (r,), and whether weights are the inverse of the residuals.

    Args:
        rows: triangles of each row, (r, count + 1, count + 1).
        counts: samples of each row, (r,).
        blurred: variances of what noise adds to columns, (r, count).
    """
    weights = np.ones(len(rows))
    for _ in range(REWEIGHTED):
        values = _solved(rows * weights[:, None, None], counts * weights**2 @ blurred)
        fitted = np.sqrt(_left(rows, values) / np.maximum(counts, 1))
        least = np.maximum(EXACT * float(fitted.max()), ROUND_OFF * _forces(rows, counts))
        following = 1.0 / np.maximum(fitted, np.maximum(least, 1e-300))
        if np.abs(np.log(following / weights)).max() <= ALIKE:
            return values, weights, fitted, True
        weights = following
    return values, weights, fitted, False


def _compressed(R: Array) -> Array:
    """Return a triangle for each of stacked triangles, (k, count + 1, count + 1), from (k, m, count + 1, count + 1)."""
    return np.stack([np.linalg.qr(block.reshape(-1, block.shape[-1]), mode="r") for block in R])


def _forces(rows: Array, counts: Index) -> Array:
    """Return rms of the forces of rows, (r,)."""
    return np.asarray(np.linalg.norm(rows[..., -1], axis=-1) / np.sqrt(np.maximum(counts, 1)))


def _root(rows: Array, variances: Array, base: int) -> Array:
    """Return a square root of the information on the first parameters, (base, base), whatever the others are.

    Args:
        rows: weighted triangles.
        variances: of all parameters, (count,), with which the information agrees on average where it is less.
        base: number of the first parameters.
    """
    order = [*range(base, len(variances)), *range(base)]
    R = np.asarray(np.linalg.qr(rows.reshape(-1, rows.shape[-1])[:, order], mode="r"))
    _, singular, axes = np.linalg.svd(R)
    singular = np.maximum(singular, UNDETERMINED * singular.max(initial=0.0))
    white = np.maximum(((axes / np.maximum(singular, 1e-300)[:, None]) ** 2).sum(axis=0), 1e-300)
    wider = np.exp(0.5 * np.mean(np.log(variances[order] / white)))
    many = len(variances) - base
    return np.asarray(R[many:, many:] / max(float(wider), 1.0))


def _noise_share(R: Array, noise: Array) -> Array:
    """Return the share of noise in what a column has beside all others, (b,), of stacked triangles."""
    shares, places = np.zeros(len(noise)), np.flatnonzero(noise)
    if places.size:
        rows = R.reshape(-1, R.shape[-1])[:, :-1]
        variance = np.diagonal(np.linalg.pinv(rows.T @ rows, rcond=UNDETERMINED, hermitian=True))[places]
        shares[places] = noise[places] * variance
    return shares


def _triangles(data: Data, half: int, kept: Mask, blocks: int) -> tuple[Array, Array]:
    """Give R of each block of time and row of forces, (blocks, r, b + 1, b + 1), columns and forces, behind a bell.

    Columns are over their rms at all times, (b,), which comes with them.

    Args:
        kept: rows that count, (T - 2 half, r).
    """
    R = np.zeros((blocks, kept.shape[1], data.count + 1, data.count + 1))
    squares, wide = np.zeros(data.count), bell(half)
    block_of = np.repeat(np.arange(blocks), [len(rows) for rows in np.array_split(kept, blocks)])
    for at in data.chunks(2 * half):
        seen = slice(at.start, at.stop + 2 * half)
        both = np.concatenate([data.columns(seen), data.forces[seen, :, None]], axis=2)
        if half:
            both = filtered(both.reshape(len(both), -1), wide).reshape(-1, *both.shape[1:])
        squares += (both[..., :-1] ** 2).sum(axis=(0, 1))
        both *= kept[at, :, None]
        for block in np.unique(block_of[at]):
            R[block] = merged(R[block], both[block_of[at] == block].swapaxes(0, 1))
    size = np.sqrt(squares / kept.size)
    size[size == 0.0] = 1.0
    R[..., :-1] /= size
    return R, size


def merged(R: Array, rows: Array) -> Array:
    """Give the triangle, (..., b, b), of a triangle's rows and further ones, (..., t, b)."""
    return np.asarray(np.linalg.qr(np.concatenate([R, rows], axis=-2), mode="r"))


def _solved(R: Array, noise: Array) -> Array:
    """Solve least squares of stacked rows whose last column is the right side, (b,).

    noise: what noise adds to the diagonal of the normal matrix, (b,), which is taken off it (errors in variables) where
    more is left than ``CLEAR`` of a column's length.
    """
    rows = np.asarray(np.linalg.qr(R.reshape(-1, R.shape[-1]), mode="r"))
    plain = np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=UNDETERMINED)[0])
    places = np.flatnonzero(noise)
    if not places.size or len(rows) < len(plain):
        return plain
    triangle = rows[: len(plain), :-1]
    if np.abs(np.diagonal(triangle)).min() <= UNDETERMINED * np.abs(triangle).max():
        return plain
    # (R'R - E D E') x = R'y by Woodbury's formula, in the few columns that noise is in
    inner = np.linalg.solve(triangle.T, np.eye(len(plain))[:, places])
    variance = 1.0 / (inner**2).sum(axis=0)  # of a column, beside all others
    kept = noise[places] <= (1.0 - CLEAR) * variance
    inner, places = inner[:, kept], places[kept]
    middle = np.diag(1.0 / noise[places]) - inner.T @ inner
    if not places.size or np.linalg.eigvalsh(middle)[0] <= 0.0:
        return plain
    return np.asarray(plain + np.linalg.solve(triangle, inner @ np.linalg.solve(middle, plain[places])))


def _left(R: Array, values: Array) -> Array:
    """Return sums of squares of what values leave of triangles (..., b + 1, b + 1)."""
    return np.asarray(((R[..., :-1] @ values - R[..., -1]) ** 2).sum(axis=-1))
