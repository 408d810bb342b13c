"""Zeros of a robot from its drives to its outputs: how what is not prescribed moves while the outputs stay.

With S the rows without a drive of M x'' + D x' + K x, and J the outputs' derivative, they are the finite s for which
[S (M s^2 + D s + K); J] is singular: rates of the internal dynamics of an inversion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index, Mask
from ...errors import InputError
from ...optional import optional_import
from .collocation import equilibrated

Complex = NDArray[np.complex128]

INFINITE = 1e3  # times the rate of a mean spring and mass: what is faster belongs to drives behind springs
ON_AXIS = 1e-7  # of a zero's magnitude: a real part that is round-off
STILL = 1e-3  # rad/s, below which a zero is 0: something that nothing holds


class InternalZeros(NamedTuple):
    """Finite zeros by magnitude.

    Attributes:
        values: (z,), rad/s.
        shapes: how coordinates move in each, (n, z).
        amplitudes: what makes its amplitude of coordinates and of their rates, (z, 2, n).
    """

    values: Complex
    shapes: Complex
    amplitudes: Complex

    def up_to(self, rate: float) -> InternalZeros:
        """Return those up to a magnitude, rad/s."""
        return self.where(np.abs(self.values) <= rate)

    def where(self, mask: Mask) -> InternalZeros:
        """Return those of a mask, (z,)."""
        return InternalZeros(self.values[mask], self.shapes[:, mask], self.amplitudes[mask])


def internal_zeros(tangents: tuple[Array, Array, Array], undriven: Index, slopes: Array) -> InternalZeros:
    """Return the finite zeros about a state at rest.

    Args:
        tangents: K, D and M about rest, (n, n) each.
        undriven: rows without a drive.
        slopes: of the outputs, (m, n).

    Raises:
        InputError: SciPy is not installed.
    """
    with optional_import("SciPy", "a stable inversion needs"):
        from scipy.linalg import eig
    K, D, M = (x[undriven] for x in tangents)
    n, rate = slopes.shape[1], _mean_rate(*tangents, undriven)
    rows, columns = equilibrated(np.vstack([np.abs(K) + rate**2 * np.abs(M), np.abs(slopes)]))
    d = len(undriven)
    K, D, M = (rows[:d, np.newaxis] * x * columns for x in (K, D, M))
    J = rows[d:, np.newaxis] * slopes * columns
    zero = np.zeros((n, n))
    left = np.block([[zero, np.eye(n)], [-np.vstack([K, J]), -np.vstack([rate * D, 0.0 * J])]])
    right = np.block([[np.eye(n), zero], [zero, np.vstack([rate**2 * M, 0.0 * J])]])
    (above, below), duals, shapes = eig(left, right, left=True, right=True, homogeneous_eigvals=True)
    finite = np.flatnonzero(np.abs(above) <= INFINITE * np.abs(below))
    zeros = rate * above[finite] / below[finite]
    order = np.argsort(np.abs(zeros), kind="stable")
    chosen = finite[order]
    amplitudes = (duals[:, chosen].conj().T @ right).reshape(-1, 2, n) / columns
    amplitudes[:, 1] /= rate
    return InternalZeros(zeros[order], columns[:, np.newaxis] * shapes[:n, chosen], amplitudes)


def refuse_undamped(found: InternalZeros, M: Array, names: Sequence[str], where: str) -> None:
    """Refuse zeros on the imaginary axis, by frequency and by the coordinate that moves most in them.

    Raises:
        InputError: there is one; no bounded motion follows from the outputs then.
    """
    for zero, shape in zip(found.values.tolist(), found.shapes.T, strict=True):
        if abs(zero) > STILL and abs(zero.real) > ON_AXIS * abs(zero):
            continue
        share = np.abs(shape.conj() * (M @ shape))
        name = names[int(np.argmax(share))]
        if abs(zero) <= STILL:
            raise InputError(
                f"{name}: nothing holds it {where} while the outputs stay, so that no motion of it follows from theirs;"
                " allowed: a stiffness and damping there, or other outputs"
            )
        hertz = abs(zero) / (2.0 * np.pi)
        raise InputError(
            f"{name}: swings at {hertz:.4g} Hz {where} while the outputs stay, and nothing damps it (a zero on the"
            " imaginary axis), so that no bounded motion of it follows from theirs; allowed: damping there, or other"
            " outputs"
        )


def _mean_rate(K: Array, D: Array, M: Array, undriven: Index) -> float:
    """Return the geometric mean of rates of springs and masses of coordinates without a drive, rad/s."""
    stiffness, mass, damping = (np.abs(np.diagonal(x))[undriven] for x in (K, M, D))
    held = (stiffness > 0.0) & (mass > 0.0)
    if held.any():
        return float(np.exp(0.5 * np.log(stiffness[held] / mass[held]).mean()))
    damped = (damping > 0.0) & (mass > 0.0)
    return float(np.exp(np.log(damping[damped] / mass[damped]).mean())) if damped.any() else 1.0
