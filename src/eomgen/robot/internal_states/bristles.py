"""LuGre friction: its state, the deflection of bristles, and what its numbers must satisfy to be passive."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..numbers import SMALLEST, Conflict, Values
from .states import State

if TYPE_CHECKING:
    from ...arrays import Array

BRISTLES = "friction.bristle_stiffness"  # is there where friction is LuGre's, which has a state
BELL = "friction.gaussian"  # the velocity of its Stribeck curve
MODELS = (LUGRE,) = ("lugre",)  # of friction, beside the one without a state
GRID = 4000  # speeds, evenly spaced in their logarithms, at which the passivity of bristles is looked at

FADING = {"friction.bristle_damping", "friction.fade"}  # with both bristles are passive at all speeds
PASSIVITY = ("friction.coulomb", "friction.static", BELL, "friction.bristle_damping", "friction.fade")

BRISTLE = State(
    name="z",
    unit=("m", "rad"),
    size=lambda numbers: numbers["friction.coulomb"] / numbers[BRISTLES],
    is_bounded=True,
    inertia=lambda numbers: numbers[BRISTLES],
)


def bristle_states(numbers: Values) -> tuple[State, ...]:
    """Return the state of friction: the deflection of LuGre's bristles, and none of other friction."""
    return (BRISTLE,) if BRISTLES in numbers else ()


def bristle_conflict(numbers: Values) -> Conflict | None:
    """Return the conflict of LuGre friction: other models' numbers, no force to slide at, a fade that is too wide."""
    coulomb = numbers["friction.coulomb"]
    if coulomb < SMALLEST:
        return "friction.coulomb", f"got {coulomb!r}; allowed: at least {SMALLEST:g}, as bristles yield at it"
    for key in ("smoothing", "coefficient", "radius", "stribeck"):
        if f"friction.{key}" in numbers:
            what = "a Gaussian Stribeck curve" if key == "stribeck" else "LuGre friction without it"
            return f"friction.{key}", f"the model is lugre; allowed: {what}"
    excess = _unfaded(numbers) if "friction.fade" in numbers else None
    if excess is not None:
        v, force, most = excess
        said = f"bristle damping resists with {force:.4g} at the velocity {v:.4g}, more than 4 times {0.25 * most:.4g}"
        return "friction.fade", f"got {numbers['friction.fade']!r}: {said}; allowed: a lower velocity, or less damping"
    return None


def sliding_force(numbers: Values, v: Array) -> Array:
    """Return LuGre's g(v), N or N m: the force at which bristles slide at speeds v, with a Gaussian curve."""
    import numpy as np  # which keys and texts of laws do without

    coulomb = numbers["friction.coulomb"]
    more = numbers.get("friction.static", coulomb) - coulomb
    return np.asarray(coulomb + more * _bell(v / numbers.get(BELL, 1.0)))


def _bell(x: Array) -> Array:
    """Return exp(-x^2), of large x the number at 26, which is none beside others."""
    import numpy as np

    return np.asarray(np.exp(-(np.minimum(np.abs(x), 26.0) ** 2)))


def _unfaded(numbers: Values) -> tuple[float, float, float] | None:
    """Return the least speed v of a fine grid at which sigma_1(v) v > 4 g(v), with both; None without any."""
    import numpy as np  # which keys and texts of laws do without

    damping, fade = numbers.get("friction.bristle_damping", 0.0), numbers.get("friction.fade", math.inf)
    scales = [x for x in (fade, numbers.get(BELL)) if x is not None and math.isfinite(x)]
    scales.append(4.0 * numbers["friction.coulomb"] / max(damping, SMALLEST))
    v = np.geomspace(1e-3 * min(scales), 10.0 * max(scales), GRID)
    resists, most = damping * _bell(v / fade) * v, 4.0 * sliding_force(numbers, v)
    i = int(np.argmax(resists > most))
    return (float(v[i]), float(resists[i]), float(most[i])) if resists[i] > most[i] else None


def active_above(numbers: Values) -> float | None:
    """Return the speed (m/s or rad/s) above which LuGre friction can give energy back; None where it is passive.

    It is where sigma_1(v) |v| exceeds 4 g(v), to a percent; viscous friction, which raises it, is left out.
    """
    found = _unfaded(numbers) if BRISTLES in numbers else None
    return None if found is None else found[0]
