"""Bouc-Wen hysteresis: its state, and what its numbers must satisfy to give no energy back."""

from __future__ import annotations

import math

from ..numbers import Condition, Conflict, Values
from .states import State

WOUND = "hysteresis"
MODELS = ("bouc_wen",)  # of hysteresis


def elastic_share(numbers: Values) -> float:
    """Return the stiffness of hysteresis that has no state, N/m or N m/rad; 0 without hysteresis."""
    return numbers[f"{WOUND}.share"] * numbers[f"{WOUND}.stiffness"] if f"{WOUND}.share" in numbers else 0.0


def hysteresis_states(numbers: Values) -> tuple[State, ...]:
    """Return the state of Bouc-Wen hysteresis, which stores (1 - share) stiffness z^2 / (2 A)."""
    return (HYSTERETIC,)


def _yield_size(numbers: Values) -> float:
    """Return the |z| at which hysteresis yields, (A / (beta + gamma))^(1 / n), at most 1; 1 where it never does."""
    A, beta, gamma, n = (numbers[f"{WOUND}.{key}"] for key in ("A", "beta", "gamma", "n"))
    level = beta + gamma if beta + gamma > 0.0 else beta
    return min(1.0, (A / level) ** (1.0 / n)) if level > 0.0 else 1.0


HYSTERETIC = State(
    name="z",
    unit=("m", "rad"),
    size=_yield_size,
    is_bounded=True,
    inertia=lambda numbers: (
        (1.0 - numbers["hysteresis.share"]) * numbers["hysteresis.stiffness"] * (1.0 / numbers["hysteresis.A"])
    ),
)


_PASSIVE = "gamma from -beta to beta, beyond which hysteresis gives energy back"
CONDITIONS = (
    *(Condition({f"{WOUND}.beta": 1.0, f"{WOUND}.gamma": sign}, 0.0, _PASSIVE) for sign in (-1.0, 1.0)),
    Condition({f"{WOUND}.share": -1.0}, -math.nextafter(1.0, 0.0), "share of less than 1"),
)


def hysteresis_conflict(numbers: Values) -> Conflict | None:
    """Return the key and the message of numbers with which hysteresis could give energy back."""
    beta, gamma, share = (numbers[f"{WOUND}.{key}"] for key in ("beta", "gamma", "share"))
    if abs(gamma) > beta:
        allowed = f"from -{beta!r} to {beta!r}, beta, beyond which hysteresis gives energy back"
        return f"{WOUND}.gamma", f"got {gamma!r}; allowed: {allowed}"
    if share >= 1.0:
        return f"{WOUND}.share", f"got {share!r}; allowed: less than 1; a spring without hysteresis is stiffness"
    return None
