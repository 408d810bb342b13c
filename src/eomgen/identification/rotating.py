"""Derivatives of measured rotations, which have no poles, where those of their angles have."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..kernel.turning import angle_rates, body_rates
from ..motion.smoothing import local_polynomials
from ..state.turning import angle_accelerations, nearest_angles, quaternions


def rotation_derivatives(
    t: Array, angles: Array, rates: Array | None, window: int, degree: int
) -> tuple[Array, Array, Array]:
    """Return angles of Rx(alpha) Ry(beta) Rz(gamma), their velocities and accelerations, (T, 3) each.

    Local polynomials smooth angular velocities in the body's axes where rates were measured, else quaternions.

    Args:
        t: times, (T,), s.
        angles: that were measured, (T, 3).
        rates: likewise, or None.
        window, degree: of the polynomials, as ``local_polynomials`` takes them.
    """
    if rates is not None:
        spin, slope, _ = local_polynomials(t, body_rates(angles, rates), window, degree)
        nearest = angles
    else:
        p, dp, ddp = local_polynomials(t, quaternions(angles), window, degree)
        size = (p * p).sum(axis=1)[:, np.newaxis]  # near 1: polynomials do not keep it
        spin = 2.0 * _relative(p, dp) / size
        slope = 2.0 * (_relative(p, ddp) - (p * dp).sum(axis=1)[:, np.newaxis] * spin) / size
        nearest = nearest_angles(p, angles)
    v = angle_rates(nearest, spin)
    return nearest, v, angle_accelerations(nearest, v, slope)


def _relative(p: Array, other: Array) -> Array:
    """Return the last three of the conjugate of p times the other quaternion, (T, 3)."""
    (w, a), (s, b) = ((x[:, :1], x[:, 1:]) for x in (p, other))
    return w * b - s * a - np.cross(a, b)
