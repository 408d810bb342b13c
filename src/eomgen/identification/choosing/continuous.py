"""The best that any weights of the candidates reach: the bound of the continuous design (J. Kiefer, J. Wolfowitz).

    f(A) <= f(A(w)) + n (max_i s_i - sum_i w_i s_i),    s_i = tr(M_i grad f(A(w))),    A(w) = start + n sum_i w_i M_i

holds for every design of n poses, since f is concave; weights that grow with their slopes make it tight.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Index
from .information import Criterion, Information, inverse

CLOSE = 1e-3  # gap: of the p-th root of the determinant, or of the squared error
_STEPS = 5000
_LOOK = 10  # steps between looks at all candidates
_GONE = 1e-3  # of an equal share: weights that are left out until they are more informative than others


def bound_of(information: Information, criterion: Criterion, count: int) -> tuple[float, float]:
    """Return an upper bound of the criterion of so many poses, and the gap of these weights to it, as a share."""
    many = len(information.Y)
    weights = np.full(many, 1.0 / many)
    active = np.arange(many)
    power = 1.0 if criterion.tool is None else 0.5
    best, gap = np.inf, np.inf
    for step in range(_STEPS):
        A = information.total(count * weights)
        covariance = inverse(A)
        if step % _LOOK == 0:
            slopes = criterion.slopes(information.Y, covariance)
            value = criterion.value(A)
            best = min(best, value + count * float(slopes.max() - weights @ slopes))
            gap = (best - value) / (information.size if criterion.tool is None else max(abs(value), 1e-300))
            if gap <= CLOSE:
                break
            weights, active = _revived(weights, slopes, many)
        slopes = criterion.slopes(information.Y[active], covariance)
        moved = weights[active] * slopes**power
        weights[active] = moved / moved.sum()
    return best, gap


def _revived(weights: Array, slopes: Array, many: int) -> tuple[Array, Index]:
    """Return weights without the smallest, and with a little for the most informative candidate."""
    usual = float(weights @ slopes)
    kept = np.where((weights > _GONE / many) | (slopes > usual), weights, 0.0)
    kept[slopes > usual] = np.maximum(kept[slopes > usual], _GONE / many)
    kept /= kept.sum()
    return kept, np.flatnonzero(kept)
