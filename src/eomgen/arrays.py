"""Arrays of numbers: their type, ranks of matrices, and columns that are as independent as possible."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]

RANK = 1e-7  # singular values below this fraction of the greatest one belong to redundant constraints


def rank_by(S: NDArray[Any], share: float = RANK) -> int:
    """Return the rank: how many singular values are above this share of the greatest one; 0 where there are none."""
    return int(np.count_nonzero(share * S.max(initial=0.0) < S))


def rank_of(J: NDArray[Any], share: float = RANK) -> int:
    """Return the rank of a matrix J, (m, n), which may be empty."""
    return rank_by(np.linalg.svd(J, compute_uv=False), share)


def independent_columns(J: NDArray[Any], rank: int) -> list[int]:
    """Choose ``rank`` columns of J that are as independent as possible, by the Gram-Schmidt method with pivoting."""
    left, columns = J.copy(), list[int]()
    for _ in range(rank):
        norms = np.linalg.norm(left, axis=0)
        norms[columns] = -1.0
        columns.append(int(norms.argmax()))
        unit = left[:, columns[-1]] / norms[columns[-1]]
        for _ in range(2):  # once more for round-off
            left -= np.outer(unit, unit @ left)
    return columns
