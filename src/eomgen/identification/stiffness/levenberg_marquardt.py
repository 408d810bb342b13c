"""Nonlinear least squares by Levenberg and Marquardt, and how sure their solution is.

D. W. Marquardt, "An Algorithm for Least-Squares Estimation of Nonlinear Parameters", SIAM Journal 11 (1963).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Mask

INDEPENDENT = 1e-6  # of the greatest singular value of scaled columns: below it a direction is undetermined
SHARE = 1e-4  # of a parameter in an undetermined direction: with less it is determined
BLIND = 1e-10  # of the motion: a parameter that changes it by less, all of it, is not seen
FACTOR = 4.0  # by which a number with a bound changes in a step, at most
DAMPING = 1e-3, 1e-12, 1e8  # of the first step, of the last ones, and where there is no way on
CHANGE = 1e-3  # standard errors of all parameters together: steps that change them by less are the last ones
BLOCKS = 40  # of time, over which errors are summed up where they are not white
WHITE = 5.0  # standard deviations of the autocorrelation of white noise, beyond which errors are not white


@dataclass(frozen=True)
class Residuals:
    """Measured less simulated motion over its noise, (N,), and derivatives of the latter by parameters, (N, p)."""

    errors: Array
    jacobian: Array

    @property
    def cost(self) -> float:
        """The sum of squares."""
        return float(self.errors @ self.errors)


Simulate = Callable[[Array], Residuals | None]  # of parameters, (p,); None where the motion does not reach its end


@dataclass(frozen=True)
class Descent:
    """Parameters at the end of the steps, (p,), the residuals there, and whether steps have become small."""

    values: Array
    residuals: Residuals
    is_converged: bool
    steps: int


def descend(
    simulate: Simulate,
    values: Array,
    least: Array,
    most: int,
    *,
    small: float,
    enough: float = 0.0,
    tell: Callable[[int, float], None],
) -> Descent | None:
    """Return where the sum of squares is least, from some values on; None where these have no motion.

    Args:
        simulate: gives residuals.
        values: to begin with, (p,).
        least: what they have to be at least, (p,), -inf where any will do.
        most: steps.
        small: change of the motion, rms over its noise, that a simulation hardly resolves.
        enough: rms of the residuals at which steps end, too.
        tell: is told of each step, with the rms of the residuals.
    """
    here = simulate(values)
    if here is None:
        return None
    damping, none, endless = DAMPING
    for step in range(most):
        error = float(np.sqrt(here.cost / here.errors.size))
        tell(step, error)
        if error <= enough:
            return Descent(values, here, is_converged=True, steps=step)
        while True:
            ahead = _step(here, values, least, damping)
            change = float(np.sqrt(np.mean((here.jacobian @ (ahead - values)) ** 2)))
            if change <= max(CHANGE * np.sqrt(here.cost) / here.errors.size, 1e-3 * small):
                return Descent(values, here, is_converged=True, steps=step)
            there = simulate(ahead)
            if there is not None and there.cost < here.cost:
                break
            if change <= small:  # round-off of the simulation
                return Descent(values, here, is_converged=True, steps=step)
            damping *= 10.0
            if damping > endless:
                return Descent(values, here, is_converged=False, steps=step)
        values, here, damping = ahead, there, max(0.1 * damping, none)
    return Descent(values, here, is_converged=False, steps=most)


def _step(here: Residuals, values: Array, least: Array, damping: float) -> Array:
    """Return values after a step; those at their bound that would go beyond it stay."""
    free = np.ones(values.size, dtype=bool)
    bounded = np.isfinite(least)
    while True:
        step = np.zeros(values.size)
        step[free] = _solved(here.jacobian[:, free], here.errors, damping)
        low = np.where(bounded & (values > 0.0), np.maximum(least, values / FACTOR), np.where(bounded, least, -np.inf))
        high = np.where(bounded & (values > 0.0), values * FACTOR, np.inf)
        beyond = free & (values <= least) & (step < 0.0)
        if not beyond.any():
            return np.asarray(np.clip(values + step, low, high))
        free &= ~beyond


def _solved(jacobian: Array, errors: Array, damping: float) -> Array:
    """Return the step of damped least squares, with columns in units of their norms."""
    sizes = np.linalg.norm(jacobian, axis=0)
    sizes[sizes == 0.0] = np.inf
    left, singular, right = np.linalg.svd(jacobian / sizes, full_matrices=False)
    return np.asarray(right.T @ (singular / (singular**2 + damping) * (left.T @ errors)) / sizes)


@dataclass(frozen=True)
class Certainty:
    """Standard errors, (p,), infinite where a parameter is not determined; freedoms of Student's t.

    is_white: whether the errors are those of white noise; if not, standard errors are those of blocks of time.
    """

    errors: Array
    freedoms: int
    is_white: bool


def certainty(residuals: Residuals, values: Array, columns: Sequence[slice], sizes: Array) -> Certainty:
    """Return how sure values are where the sum of squares is least.

    Args:
        residuals: there.
        values: (p,).
        columns: where the samples of one coordinate of one motion stand, in their order.
        sizes: rms of the motion over its noise, of each of ``columns``.
    """
    jacobian, errors = residuals.jacobian, residuals.errors
    norms = np.linalg.norm(jacobian, axis=0)
    whole = float(np.sqrt(sum(size**2 * len(errors[place]) for size, place in zip(sizes, columns, strict=True))))
    seen = norms * np.maximum(np.abs(values), 1e-9) > BLIND * whole
    covariance, lost = _inverse(jacobian[:, seen] / norms[seen])
    count = errors.size - int(seen.sum())
    white = all(_is_white(errors[place]) for place in columns)
    if white:
        covariance, freedoms = covariance * (residuals.cost / max(count, 1)), max(count, 1)
    else:
        scores = jacobian[:, seen] / norms[seen] * errors[:, np.newaxis]
        parts = [part.sum(axis=0) for place in columns for part in np.array_split(scores[place], BLOCKS)]
        blocks = np.array(parts).reshape(len(columns), BLOCKS, -1).sum(axis=0)
        freedoms = max(BLOCKS - int(seen.sum()), 1)
        covariance = covariance @ (blocks.T @ blocks) @ covariance * (BLOCKS / freedoms)
    deviations = np.full(values.size, np.inf)
    deviations[seen] = np.where(lost, np.inf, np.sqrt(np.maximum(np.diagonal(covariance), 0.0)) / norms[seen])
    return Certainty(deviations, freedoms, white)


def _inverse(scaled: Array) -> tuple[Array, Mask]:
    """Return the pseudoinverse of the normal equations of scaled columns, and which of these are not determined."""
    _, singular, right = np.linalg.svd(scaled, full_matrices=False)
    kept = singular > INDEPENDENT * singular.max(initial=0.0)
    lost = np.linalg.norm(right[~kept], axis=0) > SHARE
    inverse = (right[kept].T / singular[kept] ** 2) @ right[kept]
    return np.asarray(inverse), np.asarray(lost)


def _is_white(errors: Array) -> bool:
    """Tell whether the autocorrelation of errors over time is that of white noise."""
    off = errors - errors.mean()
    power = float(off @ off)
    if power == 0.0:
        return True
    return bool(abs(float(off[1:] @ off[:-1])) / power <= WHITE / np.sqrt(errors.size))
