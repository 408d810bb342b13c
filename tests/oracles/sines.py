"""Sines and cosines as ``turn`` of ``clib/lanes.h`` takes them, without fused multiply-adds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.c.functions import COEFFICIENTS

Array = NDArray[Any]


def polynomials(angles: Array) -> tuple[Array, Array]:
    """Return sines and cosines of angles no farther than the limit, of the angles' shape and dtype."""
    table, real = COEFFICIENTS[str(angles.dtype)], angles.dtype.type

    def polynomial(coefficients: Sequence[float]) -> Any:
        total = real(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            total = real(coefficient) + z * total
        return total

    shifted = angles * real(table.per_quarter) + real(table.shift)
    quarters = shifted - real(table.shift)
    r = angles
    for piece in table.quarter:
        r = r - quarters * real(piece)
    z = r * r
    s, c = r + r * z * polynomial(table.sine), real(1.0) - z * (real(0.5) - z * polynomial(table.cosine))
    quarter = shifted.view(np.int64 if real is np.float64 else np.int32)
    odd = (quarter & 1) != 0
    sine, cosine = np.where(odd, c, s), np.where(odd, s, c)
    return np.where(quarter & 2, -sine, sine), np.where((quarter + 1) & 2, -cosine, cosine)
