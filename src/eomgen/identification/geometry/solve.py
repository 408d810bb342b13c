"""Gauss-Newton on the whole error model: scaled columns, whitened rows, least change where none shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index, Mask
from ..estimating import SOLVED
from .error_model import ErrorModel, Rows
from .observations import Observations, at_rows

ALGEBRAIC = 1e-10  # of the greatest singular value of normed columns: what is less is none
HIDDEN = 0.03  # of an expected size, in units of its noise: what shows less keeps its nominal value
_PRESENT = 0.5  # of an unseen direction: what of it is in the active parameters, for it to be one of theirs
_ROUND_OFF = 1e-13  # of the longest column: what is shorter is 0
_BLOCK = 2  # rows of a block over its columns
_STEPS = 100  # of Gauss-Newton, at most
ROUGH = 4  # steps of a fit that another one goes on from
_TRIES = 12  # of a step, each damped ten times as much as the one before
_LEAST_DAMPING = 1e-3  # of directions that show an expected size as much as its noise, 1
_UPWARD = 1e-6  # share of the sum of squares that a step may add: no noise shows that
_RETURNED = 1e-4  # share that the way back along directions that do not show may add
_STILL = 3  # steps one after the other that gain no more than that, behind which a fit has ended
_PROMISED = 1e-2  # share of the sum of squares that a further step may promise where a fit is at its least
_SMALL = 1e-9  # of a step, in expected sizes
_ROUNDS = 25  # of noise that is estimated, or weights that follow from residuals
_SETTLED = 1e-3  # relative change of estimated noise
_FLOOR = 1e-9  # m or rad, below which noise is round-off: nothing measures that well
_MAD = 1.4826  # standard deviation over the median of the magnitude, normal distribution
_NEAR = 3.0  # standard deviations: what is not further off says how large the noise is
_OF_NEAR = 0.97333  # mean square of normal numbers that are not further off
_LOOSE = 0.05  # least share of a number that a fit leaves open

Loss = Literal["huber", "cauchy", "tukey"]
LOSSES: dict[str, Callable[[Array], Array]] = {  # weight of a sample by its size u; 95 % efficient with normal errors
    "huber": lambda u: np.minimum(1.0, 1.345 / np.maximum(u, 1e-300)),
    "cauchy": lambda u: 1.0 / (1.0 + (u / 2.385) ** 2),
    "tukey": lambda u: np.where(u < 4.685, (1.0 - np.minimum(u / 4.685, 1.0) ** 2) ** 2, 0.0),
}


@dataclass(frozen=True)
class Problem:
    """A fit to make: a model, its rows, the numbers measured, and which parameters may change.

    active: indices of these.  prior: standard deviation of their change from nominal, (P,), infinite without one.
    kept: places of the numbers that count, for folds; None: all.
    unseen: directions of change in expected sizes, (k, P), along which noise alone seems to show something; None: none.
    """

    model: ErrorModel
    rows: Rows
    seen: Observations
    active: Index
    prior: Array | None = None
    kept: Index | None = None
    unseen: Array | None = None

    def projected(self, S: Array) -> Array:
        """Return sensitivities of the active parameters per expected size, (m, p), without unseen directions."""
        if self.unseen is None:
            return S
        N = self.unseen[:, self.active]
        Q = np.linalg.qr(S @ N[np.linalg.norm(N, axis=1) > _PRESENT].T)[0]
        return np.asarray(S - Q @ (Q.T @ S))


@dataclass(frozen=True)
class Fit:
    """Estimated values and noise.

    Attributes:
        x: all values, (P,).
        sigma: standard deviations of all numbers, (M,), known or estimated.
        trust: weights by the loss, (M,), 1 without one.
        residuals: measured less predicted, (M,).
        covariance: of x, (P, P), in the gauge of the least change; what is hidden has its expected size.
        shown: directions that the numbers show, for degrees of freedom.
        freedoms: numbers less these.
        chi2: sum of squares of whitened residuals that count.
        leverage: of the numbers that count, (m,).
        status: "converged", or what has not.
    """

    x: Array
    sigma: Array
    trust: Array
    residuals: Array
    covariance: Array
    shown: float
    freedoms: float
    chi2: float
    leverage: Array
    status: str = SOLVED


@dataclass(frozen=True)
class _Linear:
    """A linearised problem in expected sizes: singular values, directions (k, p), what they ask for, hidden ones.

    S: whitened sensitivities, with rows for a prior; white: whitened differences.
    """

    values: Array
    V: Array
    asked: Array
    U: Array
    hidden: Array
    S: Array
    white: Array

    def cost(self, step: Array) -> float:
        """Return the sum of squares behind a step, (p,)."""
        return float(((self.white - self.S @ step) ** 2).sum())

    def step(self, z: Array, damping: float) -> Array:
        """Return the change of z, (p,): what directions ask for, and back to 0 where none shows.

        damping: in numbers per noise squared of one expected size; 0: the whole step.
        """
        return np.asarray(self.V.T @ (self.asked * self.values**2 / (self.values**2 + damping)) + self.back(z, damping))

    def back(self, z: Array, damping: float) -> Array:
        """Return the part of a step along directions that do not show."""
        return np.asarray((self.V.T @ (self.V @ z) - z) / (1.0 + damping))


def fitted(
    problem: Problem, x: Array, sigma: Array | None = None, loss: str | None = None, trust: Array | None = None
) -> Fit:
    """Fit the active parameters, beginning with the values x, (P,).

    Args:
        problem: what to fit.
        x: first values of all parameters; others than the active keep them.
        sigma: standard deviations of all numbers, (M,), which then stay; by default those known, others estimated.
        loss: one of LOSSES: samples count the less, the more they are off.
        trust: weights of all numbers, (M,), where there is no loss; 1 by default.
    """
    seen = problem.seen
    kept = np.arange(seen.group.size) if problem.kept is None else problem.kept
    estimated = np.zeros(seen.group.size, dtype=bool) if sigma is not None else np.isnan(seen.sigma)
    deviations = seen.sigma.copy() if sigma is None else sigma.copy()
    trust = np.ones(seen.group.size) if trust is None else trust
    r, A = at_rows(problem.model, problem.rows, seen, x)
    if estimated.any():
        deviations = _scaled(seen, deviations, estimated, r, trust, kept, trust[kept], _median_size)
    for round_number in range(_ROUNDS):
        x, r, A, linear, status = _descend(problem, x, r, A, deviations, trust, kept, _STEPS)
        before = deviations.copy(), trust.copy()
        leverage = (linear.U**2).sum(axis=1)
        if loss is not None:
            trust = _trust(seen, r, deviations, LOSSES[loss], kept, bool(estimated.any()))
        if estimated.any():
            scale = _robust_size if loss is not None else _rms_size
            deviations = _scaled(seen, deviations, estimated, r, trust, kept, leverage, scale)
        moved = np.abs(np.log(deviations / before[0])).max(), np.abs(trust - before[1]).max()
        if max(moved) < _SETTLED or (round_number and not estimated.any() and loss is None):
            break
    else:
        status = "noise and weights, which follow from residuals, do not settle" if status == SOLVED else status
    white = _weighed(seen, r, deviations, trust)[kept]
    shown = float((linear.U**2).sum())
    return Fit(
        x=x,
        sigma=deviations,
        trust=trust,
        residuals=r,
        covariance=_covariance(problem, linear),
        shown=shown,
        freedoms=max(float(trust[kept].sum()) - shown, 0.0),
        chi2=float(white @ white),
        leverage=(linear.U**2).sum(axis=1),
        status=status,
    )


def roughly(problem: Problem, x: Array, steps: int = ROUGH) -> Array:
    """Return values, (P,), near enough to begin a fit with.

    All noise that is not known is that of what is left at x.
    """
    seen = problem.seen
    r, A = at_rows(problem.model, problem.rows, seen, x)
    places, ones = np.arange(seen.group.size), np.ones(seen.group.size)
    sigma = _scaled(seen, seen.sigma, np.isnan(seen.sigma), r, ones, places, ones, _median_size)
    return _descend(problem, x, r, A, sigma, ones, places, steps)[0]


def whitened(problem: Problem, fit: Fit, r: Array, A: Array) -> tuple[Array, Array]:
    """Return differences and sensitivities per expected size, whitened by the noise of a fit, (M,) and (M, P)."""
    scale = problem.model.sizes
    return _weighed(problem.seen, r, fit.sigma, fit.trust), _weighed(problem.seen, A * scale, fit.sigma, fit.trust)


def _weighed(seen: Observations, values: Array, sigma: Array, trust: Array) -> Array:
    root = np.sqrt(trust)
    return seen.whiten(values, sigma) * (root if values.ndim == 1 else root[:, np.newaxis])


def _descend(
    problem: Problem, x: Array, r: Array, A: Array, sigma: Array, trust: Array, kept: Index, steps: int
) -> tuple[Array, Array, Array, _Linear, str]:
    """Give values, differences and sensitivities at the least sum of squares near x, the problem linearised, a status.

    Steps are damped while the sum grows, those along directions that show little more than others: what shows well is
    corrected in each step, though a long one along a curved valley is not possible.
    """
    model, active = problem.model, problem.active
    sizes, nominal = model.sizes[active], model.nominal[active]

    def cost(r: Array, x: Array) -> float:
        white = _weighed(problem.seen, r, sigma, trust)[kept]
        change = (x - model.nominal) / problem.prior if problem.prior is not None else np.zeros(1)
        return float(white @ white + change @ change)

    best, damping, still, has_ended = cost(r, x), 0.0, 0, False
    linear = _linear(problem, r, A, x, sigma, trust, kept)
    for _ in range(steps):
        z = (x[active] - nominal) / sizes
        has_ended = np.abs(linear.step(z, 0.0)).max(initial=0.0) < _SMALL
        if has_ended:
            break
        damping = 0.1 * damping if damping > _LEAST_DAMPING else 0.0
        for _ in range(_TRIES):
            step = linear.step(z, damping)
            tried = x.copy()
            tried[active] = nominal + sizes * (z + step)
            new_r, new_A = at_rows(model, problem.rows, problem.seen, tried)
            new = cost(new_r, tried)
            returned = min(linear.cost(linear.back(z, damping)), (1.0 + _RETURNED) * best)
            if new <= max(best, returned) * (1.0 + _UPWARD) + 1e-300:
                break
            damping = max(10.0 * damping, _LEAST_DAMPING)
        else:
            break
        gained = best - new
        x, r, A, best = tried, new_r, new_A, new
        linear = _linear(problem, r, A, x, sigma, trust, kept)
        still = still + 1 if gained <= _UPWARD * best else 0
        has_ended = still == _STILL or bool(gained <= 1e-12 * best and np.abs(step).max() < 1e-6)
        if has_ended:
            break
    least = linear.cost(linear.step((x[active] - nominal) / sizes, 0.0))
    is_least = has_ended or least >= (1.0 - _PROMISED) * best
    return x, r, A, linear, SOLVED if is_least else "the steps of the fit do not reach the least sum of squares"


def _linear(problem: Problem, r: Array, A: Array, x: Array, sigma: Array, trust: Array, kept: Index) -> _Linear:
    """Return the problem linearised at x, in the directions that show: above round-off and above noise.

    A prior is a row for each parameter; it holds all directions, so that none is hidden.
    """
    active, sizes = problem.active, problem.model.sizes[problem.active]
    S = problem.projected(_weighed(problem.seen, A[:, active], sigma, trust)[kept] * sizes)
    white = _weighed(problem.seen, r, sigma, trust)[kept]
    if problem.prior is not None:
        held = sizes / problem.prior[active]
        change = (x - problem.model.nominal)[active] / sizes
        S, white = np.vstack([S, np.diag(held)]), np.concatenate([white, -held * change])
    R, norms = normed_triangle(S)
    rank = _rank(np.linalg.svd(R, compute_uv=False))
    _, values, V = np.linalg.svd(R * norms)
    hidden = V[rank:rank]
    if problem.prior is None:
        shown = min(rank, int((values > HIDDEN).sum()))
        hidden, rank = V[shown:rank], shown
    values, V = values[:rank], V[:rank]
    U = S @ V.T / values
    return _Linear(values, V, (U.T @ white) / values, U[: kept.size], hidden, S, white)


def _covariance(problem: Problem, linear: _Linear) -> Array:
    """Return the covariance of all values, (P, P); in hidden directions that of the expected sizes."""
    many = len(problem.model.parameters)
    roots = np.vstack([linear.V / linear.values[:, np.newaxis], linear.hidden]) * problem.model.sizes[problem.active]
    covariance = np.zeros((many, many))
    covariance[np.ix_(problem.active, problem.active)] = roots.T @ roots
    return covariance


def _scaled(
    seen: Observations,
    sigma: Array,
    estimated: Mask,
    r: Array,
    trust: Array,
    kept: Index,
    leverage: Array,
    scale: Callable[[Array, Array, Array, Array], float | None],
) -> Array:
    """Return standard deviations, (M,).

    Where they are not known, one for each block, by a scale of its numbers that count.

    scale: of differences, their weights of information, weights by the loss, and leverages; None: it stays as it is.
    """
    scaled = np.array(sigma)
    for group in range(len(seen.blocks)):
        inside = seen.group[kept] == group
        places = kept[inside]
        if places.size and estimated[places[0]]:
            size = scale(r[places], seen.weight[places], trust[places], leverage[inside])
            if size is not None:
                scaled[seen.group == group] = max(size, _FLOOR)
    return scaled


def _median_size(r: Array, weight: Array, trust: Array, leverage: Array) -> float:
    """Return noise to begin with: the size of what is not explained yet."""
    return _MAD * float(np.median(np.abs(r) * np.sqrt(weight)))


def _rms_size(r: Array, weight: Array, trust: Array, leverage: Array) -> float | None:
    """Return noise by a block's share of the degrees of freedom."""
    freedoms = float(trust.sum() - leverage.sum())
    return float(np.sqrt(float((trust * weight * r**2).sum()) / freedoms)) if freedoms > 0.5 else None


def _robust_size(r: Array, weight: Array, trust: Array, leverage: Array) -> float:
    """Return noise that outliers do not enlarge.

    The median of the magnitudes (MAD) says what is near; the root of the mean square of that is the estimate, with what
    the tails of a normal distribution lack.  A weighted mean square would grow with every outlier's size.
    """
    loose = np.sqrt(np.maximum(1.0 - np.minimum(leverage / np.maximum(trust, 1e-6), 1.0), _LOOSE))
    size = np.abs(r) * np.sqrt(weight) / loose
    near = size <= _NEAR * max(_MAD * float(np.median(size)), _FLOOR)
    return float(np.sqrt(float((size[near] ** 2).mean()) / _OF_NEAR))


def _trust(
    seen: Observations, r: Array, sigma: Array, loss: Callable[[Array], Array], kept: Index, rescaled: bool
) -> Array:
    """Return weights of all numbers, (M,), one for each sample, by its size over the noise or the usual sample."""
    white = seen.whiten(r, sigma) ** 2
    many = np.bincount(seen.sample)
    size = np.sqrt(np.bincount(seen.sample, white) / np.maximum(many, 1))
    if rescaled:
        there = np.unique(seen.sample[kept])
        usual = float(np.median(size[there]))
        size = size / max(usual, 1e-300) * float(np.sqrt(1.0 - 2.0 / (9.0 * np.median(many[there]))) ** 3)
    return np.asarray(loss(size)[seen.sample])


def algebraic_rank(S: Array) -> int:
    """Rank of sensitivities, (m, p), whatever the sizes of their columns."""
    R, norms = normed_triangle(S)
    return _rank(np.linalg.svd(R[:, norms > 0.0], compute_uv=False)) if norms.any() else 0


def normed_triangle(S: Array) -> tuple[Array, Array]:
    """Return R of S = Q R, (p, p) at most, with columns of length 1, and the lengths.

    Both are 0 where S is round-off.
    """
    R: NDArray[Any] = S
    while len(R) > _BLOCK * S.shape[1]:  # in blocks: one large matrix would wait for threads
        many = len(R) // (_BLOCK * S.shape[1])
        end = many * _BLOCK * S.shape[1]
        reduced = np.asarray(np.linalg.qr(R[:end].reshape(many, -1, S.shape[1]), mode="r"))
        R = np.vstack([reduced.reshape(-1, S.shape[1]), R[end:]])
    R = np.asarray(np.linalg.qr(R, mode="r"))
    norms = np.linalg.norm(R, axis=0)
    norms[norms <= _ROUND_OFF * norms.max(initial=0.0)] = 0.0
    return np.where(norms > 0.0, R / np.where(norms > 0.0, norms, 1.0), 0.0), norms


def _rank(values: NDArray[Any]) -> int:
    return int((values > ALGEBRAIC * values.max(initial=0.0)).sum())
