"""LuGre friction, which has a state z, the deflection of bristles:

    z' = v - sigma_0 |v| z / g(v),    F = sigma_0 z + sigma_1(v) z' + viscous v,
    g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)^2),    sigma_1(v) = bristle_damping exp(-(v / fade)^2).

C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A New Model for Control of Systems with Friction", IEEE
Transactions on Automatic Control 40 (1995).  It stores sigma_0 z^2 / 2.
"""

from __future__ import annotations

from collections.abc import Mapping

from eomgen.robot.internal_states.bristles import BRISTLES

from ...tree.spatial import Scalar
from ..element import StateSlopes
from ..laws import bell
from ..scalar_functions import Functions
from .formula import LawArguments, StateEffect


def lugre(x: LawArguments) -> StateEffect:
    """Return the friction of a coordinate's numbers."""
    numbers, v, f = x.numbers, x.v, x.f
    (z,), stiffness = x.z, numbers[BRISTLES]
    level, bend = _sliding(numbers, v, f)
    inverse = 1.0 / level
    speed, sign = f.max(v, -1.0 * v), 2.0 * f.step(v) - 1.0
    pull = stiffness * inverse  # over which bristles give way, per z
    rate = v - speed * (pull * z)
    g_z = -1.0 * (speed * pull)
    g_v = 1.0 - (pull * z) * (sign - speed * (bend * inverse))
    damping, fading = _damping(numbers, v, f)
    force, f_v, f_z = stiffness * z + damping * rate, damping * g_v + fading * rate, stiffness + damping * g_z
    viscous = numbers.get("friction.viscous", 0.0)
    slopes = StateSlopes(f_v + viscous, (f_z,), (g_v,), (0.0,), {(0, 0): g_z}, x.inertias)
    return StateEffect(force + viscous * v, (rate,), slopes)


def _sliding(numbers: Mapping[str, Scalar], v: Scalar, f: Functions) -> tuple[Scalar, Scalar]:
    """Return g(v) and its slope."""
    coulomb = numbers["friction.coulomb"]
    if "friction.static" not in numbers:
        return coulomb, 0.0
    more, slope = bell(numbers["friction.static"] - coulomb, numbers["friction.gaussian"], v, f)
    return coulomb + more, slope


def _damping(numbers: Mapping[str, Scalar], v: Scalar, f: Functions) -> tuple[Scalar, Scalar]:
    """Return sigma_1(v) and its slope."""
    damping = numbers.get("friction.bristle_damping", 0.0)
    return bell(damping, numbers["friction.fade"], v, f) if "friction.fade" in numbers else (damping, 0.0)
