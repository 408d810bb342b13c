"""Tolerances allocated backwards: which to tighten, and how far, so that a tool is as accurate as wanted at least cost.

    least sum of c_i (1 / x_i - 1)    with sum_i A_pi x_i^2 <= V_p at every pose p    and x_i <= 1

x_i is a tolerance over what it was.  In z = x^2 the problem is convex: z_i = min(1, (c_i / (2 (A^T m)_i))^(2/3)) for
multipliers m of the poses, which are iterated by scaling each with its pose's excess.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Array, Mask
from ...errors import InputError
from ...limits import LARGEST, is_usable
from ...names import listed, show
from ...results.contents import plain_fields
from ...shown import Shown
from ..estimating import SOLVED
from .regions import radii

_ROUNDS = 20  # of the ratio between radius and trace, which changes little
_STEPS = 2000  # of the multipliers
_CLOSE = 1e-9
_HALVINGS = 50
_POWER = 1.5  # of the scaling: exact for one pose
_SHOWN_FROM = 1e-6  # tightening that is one


@dataclass(frozen=True, kw_only=True)
class Allocation(Shown):
    """Tolerances that reach an accuracy.

    Attributes:
        accuracy: wanted radius of position, m; confidence: probability of being within.
        names, units: of the K parameters.
        before, after: their deviations or bounds, whichever the table has, (K,).
        factors: after / before, (K,); 1 of what stays.
        radius_before, radius: the greatest of all poses, m.
        cost: sum of cost times (before / after - 1).
        status: "converged", or why the cost may not be the least.
    """

    accuracy: float
    confidence: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    before: Array
    after: Array
    factors: Array
    radius_before: float
    radius: float
    cost: float
    status: str = SOLVED

    @property
    def tightened(self) -> tuple[str, ...]:
        """Names of what is tightened, the most first."""
        order = np.argsort(self.factors, kind="stable")
        return tuple(self.names[k] for k in order if self.factors[k] < 1.0 - _SHOWN_FROM)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {**plain_fields(self), "tightened": list(self.tightened)}

    def lines(self) -> list[str]:
        """Return a table of what is tightened."""
        share = f"{100 * self.confidence:g} % coverage radius"
        head = f"{share} {1e3 * self.radius:.4g} mm instead of {1e3 * self.radius_before:.4g} mm"
        if not self.tightened:
            return [f"{head}: nothing has to be tightened for {1e3 * self.accuracy:.4g} mm"]
        width = max(len(name) for name in self.tightened) + 2
        lines = [
            f"{head}, at a cost of {self.cost:.4g}, {self.status}",
            "",
            f"{'tighten':<{width}}{'from':>12}{'to':>12}  unit",
        ]
        for name in self.tightened:
            k = self.names.index(name)
            lines.append(f"{name:<{width}}{self.before[k]:>12.4g}{self.after[k]:>12.4g}  {self.units[k]}")
        return lines


def allocated(
    names: tuple[str, ...],
    units: tuple[str, ...],
    before: Array,
    scaled: Array,
    costs: Array,
    fixed: Mask,
    accuracy: float,
    confidence: float,
) -> Allocation:
    """Return the allocation; scaled: sensitivities of position times standard deviations, (N, 3, K).

    Raises:
        InputError: the accuracy is no positive number, or what is fixed alone makes it impossible.
    """
    if not (is_usable(accuracy) and accuracy > 0.0):
        raise InputError(f"accuracy: {show(accuracy)}; allowed: a positive number, m, up to {LARGEST:g}")
    first = _radii(scaled, np.ones(len(names)), confidence)
    held = _radii(scaled, fixed.astype(np.float64), confidence)
    if held.max() >= accuracy:
        what = listed(name for name, is_held in zip(names, fixed, strict=True) if is_held)
        raise InputError(f"accuracy: {accuracy:g} m; allowed: above {held.max():.4g} m, which {what} alone make")
    x, status = np.ones(len(names)), SOLVED
    if first.max() > accuracy:
        x, status = _tightened(scaled, costs, fixed, float(accuracy), confidence)
    return Allocation(
        accuracy=float(accuracy),
        confidence=confidence,
        names=names,
        units=units,
        before=before,
        after=before * x,
        factors=x,
        radius_before=float(first.max()),
        radius=float(_radii(scaled, x, confidence).max()),
        cost=float((costs * (1.0 / x - 1.0)).sum()),
        status=status,
    )


def _radii(scaled: Array, x: Array, confidence: float) -> Array:
    deviations = scaled * x
    return radii(deviations @ deviations.transpose(0, 2, 1), confidence)


def _tightened(scaled: Array, costs: Array, fixed: Mask, accuracy: float, confidence: float) -> tuple[Array, str]:
    """Return factors, (K,), and a status: the radius is that of the trace times a ratio, corrected until it stays."""
    A = (scaled**2).sum(axis=1)  # (N, K)
    x = np.ones(len(costs))
    m = np.ones(len(A))
    status = f"{_ROUNDS} rounds do not bring the radius to rest"
    for _ in range(_ROUNDS):
        radius, traces = _radii(scaled, x, confidence), A @ x**2
        shown = traces > 0.0
        V = np.full(len(A), np.inf)
        V[shown] = traces[shown] * (accuracy / radius[shown]) ** 2
        z, m, is_least = least(A, V, costs, fixed, m)
        last, x = x, np.sqrt(z)
        if np.abs(x - last).max() < 1e-7:
            status = SOLVED if is_least else f"{_STEPS} steps do not reach the least cost"
            break

    def scaled_by(share: float) -> Array:
        return np.where(fixed, 1.0, x * share)

    low, high = 0.0, 1.0  # what round-off and the last change of the ratio leave
    if _radii(scaled, x, confidence).max() <= accuracy:
        return x, status
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _radii(scaled, scaled_by(middle), confidence).max() <= accuracy:
            low = middle
        else:
            high = middle
    return scaled_by(low), status


def least(A: Array, V: Array, costs: Array, fixed: Mask, m: Array) -> tuple[Array, Array, bool]:
    """Return squares of the factors, (K,), multipliers, (N,), beginning with these, and whether they converged.

    A: variances by pose and parameter, (N, K).  V: those that are allowed, (N,); inf where all are.
    """
    bound = np.flatnonzero(np.isfinite(V))
    ratios = A[bound] / V[bound, np.newaxis]
    room = np.maximum(1.0 - ratios[:, fixed].sum(axis=1), 1e-6)
    ratios = np.where(fixed, 0.0, ratios) / room[:, np.newaxis]
    some = np.maximum(m[bound], 1e-12)
    z, is_done = np.ones(len(costs)), False
    for _ in range(_STEPS):
        slope = ratios.T @ some
        with np.errstate(divide="ignore"):
            z = np.where(slope > 0.0, np.minimum(1.0, (0.5 * costs / np.maximum(slope, 1e-300)) ** (2.0 / 3.0)), 1.0)
        use = ratios @ z
        is_done = use.max() < 1.0 + _CLOSE and float(some @ np.abs(1.0 - use)) < _CLOSE * float(some.sum())
        if is_done:
            break
        some = np.maximum(some * use**_POWER, 1e-30)
    multipliers = m.copy()
    multipliers[bound] = some
    return z, multipliers, is_done
