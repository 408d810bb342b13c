"""Monotone cubic interpolation between measured points, without a branch.

F. N. Fritsch, R. E. Carlson, "Monotone Piecewise Cubic Interpolation", SIAM Journal on Numerical Analysis 17 (1980);
slopes at inner points as weighted harmonic means (F. N. Fritsch, J. Butland 1984), at the ends by three points: what
SciPy's PchipInterpolator and MATLAB's pchip take.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from ..tree.spatial import Scalar
from .scalar_functions import Functions


def curve_pieces(
    knots: Sequence[float], forces: Sequence[Scalar], f: Functions
) -> tuple[list[Scalar], list[tuple[Scalar, Scalar]]]:
    """Return the pieces of the curve through points (knot, force), two at least.

    Returns:
        its slope at every knot, and for every interval the factors of t^2 and t^3, t from the interval's beginning.
    """
    widths = [b - a for a, b in pairwise(knots)]
    secants = [(b - a) * (1.0 / h) for h, (a, b) in zip(widths, pairwise(forces), strict=True)]
    if len(secants) == 1:
        return [secants[0], secants[0]], [(0.0, 0.0)]
    inner = [_inner_slope(*pair, *secant, f) for pair, secant in zip(pairwise(widths), pairwise(secants), strict=True)]
    first = _end_slope(widths[0], widths[1], secants[0], secants[1], f)
    last = _end_slope(widths[-1], widths[-2], secants[-1], secants[-2], f)
    slopes = [first, *inner, last]
    pieces = [
        ((3.0 * secant - 2.0 * a - b) * (1.0 / h), (a + b - 2.0 * secant) * (1.0 / (h * h)))
        for h, secant, (a, b) in zip(widths, secants, pairwise(slopes), strict=True)
    ]
    return slopes, pieces


def _inner_slope(before: float, behind: float, one: Scalar, other: Scalar, f: Functions) -> Scalar:
    """Return the weighted harmonic mean of two secants of one sign; 0 of two signs."""

    def mean(a: Scalar, b: Scalar) -> Scalar:
        """Return the weighted harmonic mean of the positive values, 0 if there is none."""
        below = (2.0 * behind + before) * b + (behind + 2.0 * before) * a
        return 3.0 * (before + behind) * (a * b) / (below + (1.0 - f.step(below)))

    rising = mean(f.max(one, 0.0), f.max(other, 0.0))
    return rising - mean(f.max(-one, 0.0), f.max(-other, 0.0))


def _end_slope(h: float, next_h: float, one: Scalar, other: Scalar, f: Functions) -> Scalar:
    """Return the slope of the parabola through three points, between 0 and three times the first secant."""
    parabola = ((2.0 * h + next_h) * one - h * other) * (1.0 / (h + next_h))
    most, least = 3.0 * f.max(one, 0.0), -3.0 * f.max(-one, 0.0)
    return -f.max(-f.max(parabola, least), -most)
