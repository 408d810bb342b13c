"""Bouc-Wen hysteresis: a spring of which a part yields, its deflection z a state.

    z' = A v - beta |v| |z|^(n-1) z - gamma v |z|^n,    F = share k s + (1 - share) k z.

R. Bouc, "Forced Vibration of Mechanical Systems with Hysteresis", 4th Conference on Nonlinear Oscillation, Prague 1967;
Y. K. Wen, "Method for Random Vibration of Hysteretic Systems", Journal of the Engineering Mechanics Division 102, 1976.
It stores share k s^2 / 2 + (1 - share) k z^2 / (2 A) and takes energy for good where |gamma| <= beta.
"""

from __future__ import annotations

from eomgen.robot.internal_states.bouc_wen import WOUND

from ...tree.spatial import Scalar
from ..element import StateSlopes
from ..scalar_functions import Functions
from .formula import LawArguments, StateEffect

LEAST = 1e-30  # in whose place stands a smaller |z|, so that its logarithm is a number


def hysteresis(x: LawArguments) -> StateEffect:
    """Return the hysteresis of a coordinate's numbers."""
    keys = ("stiffness", "A", "beta", "gamma", "n", "share")
    k, A, beta, gamma, n, part = (x.numbers[f"{WOUND}.{key}"] for key in keys)
    (z,), v, f = x.z, x.v, x.f
    size, power = _power(z, n - 1.0, f)  # |z| and |z|^(n - 1)
    bent, straight = beta * (power * z), gamma * (power * size)
    speed, sense, side = f.max(v, -1.0 * v), 2.0 * f.step(v) - 1.0, 2.0 * f.step(z) - 1.0
    rate = A * v - speed * bent - v * straight
    g_v = A - sense * bent - straight
    g_z = -1.0 * ((n * power) * (beta * speed + gamma * (v * side)))
    elastic = part * k
    yielding = k - elastic
    slopes = StateSlopes(0.0, (yielding,), (g_v,), (0.0,), {(0, 0): g_z}, x.inertias, elastic)
    return StateEffect(elastic * x.s + yielding * z, (rate,), slopes, 0.5 * (elastic * (x.s * x.s)))


def _power(z: Scalar, exponent: Scalar, f: Functions) -> tuple[Scalar, Scalar]:
    """Return |z| and its power."""
    size = f.max(z, -1.0 * z)
    return size, f.exp(exponent * f.log(f.max(size, LEAST)))
