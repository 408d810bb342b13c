"""States of laws with memory: their names, inertias and sizes, and what their laws' numbers must satisfy.

A state z is a velocity of an inertia w without a link: w z^2 / 2 is the energy that it stores.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

Values = Mapping[str, float]
Conflict = tuple[str, str]  # key, message

SMALLEST = 1e-12  # least value of what is divided by, m, rad or per s
BRISTLES = "friction.bristle_stiffness"  # is there where friction is LuGre's, which has a state
BELL = "friction.gaussian"  # the velocity of its Stribeck curve
MODELS = (LUGRE,) = ("lugre",)  # of friction, beside the one without a state
WOUND, BRANCHES = "hysteresis", "maxwell"  # laws all of which have states
LOOPS = ("bouc_wen",)  # models of hysteresis
MOST_BRANCHES = 8  # of a generalized Maxwell element
GRID = 4000  # speeds, evenly spaced in their logarithms, at which the passivity of bristles is looked at
KEPT, SETTLES, INTEGRATOR = "kept", "settles", "integrator"  # what states are in a static equilibrium
WEIGHTLESS = 2.0**-80  # inertia of what stores no energy: exact to divide by, and far below what sums of energies see


@dataclass(frozen=True, kw_only=True)
class State:
    """A state of a law.

    Attributes:
        name: below the law's: "z".
        unit: of the laws of translations and of rotations.
        size: numbers -> what tolerances refer to.
        inertia: numbers, or scalars of a program in their places -> w, where the state stores w z^2 / 2; None of one
            that stores no energy, as integrals, filters and lags.
        kind: KEPT where any state rests, as bristles do; SETTLES where its rate vanishes at one value, which follows
            from all else; INTEGRATOR where its rate does not depend on it, so that all else must make that vanish.
    """

    name: str
    unit: tuple[str, str]
    size: Callable[[Values], float]
    inertia: Callable[[Mapping[str, Any]], Any] | None = None
    kind: str = KEPT


@dataclass(frozen=True)
class OwnedState:
    """A state of a law of somebody.

    Attributes:
        prefix: of the law's parameters: "joints.joint1.gamma", "joints.joint1.motor" of a rotor or a transmission,
            "loops.loop1.x", "couplings.gear".
        law: its name.
        numbers: of all laws there.
        state: what is said of it.
        is_linear: whether the law is that of a translation.
    """

    prefix: str
    law: str
    numbers: Values = field(hash=False)
    state: State
    is_linear: bool

    @property
    def owner(self) -> str:
        """Whose law it is: "joint1.gamma"."""
        return self.prefix.partition(".")[2]

    @property
    def name(self) -> str:
        """Its name, such as "joint1.gamma.friction.z"."""
        return f"{self.owner}.{self.law}.{self.state.name}"

    @property
    def unit(self) -> str:
        """Its unit."""
        return self.state.unit[0 if self.is_linear else 1]


BRISTLE = State(
    name="z",
    unit=("m", "rad"),
    size=lambda numbers: numbers["friction.coulomb"] / numbers[BRISTLES],
    inertia=lambda numbers: numbers[BRISTLES],
)


def bristles(numbers: Values) -> tuple[State, ...]:
    """Return the state of friction: the deflection of LuGre's bristles, and none of other friction."""
    return (BRISTLE,) if BRISTLES in numbers else ()


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
    inertia=lambda numbers: (
        (1.0 - numbers["hysteresis.share"]) * numbers["hysteresis.stiffness"] * (1.0 / numbers["hysteresis.A"])
    ),
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


def branches_of(numbers: Values) -> int:
    """Return how many Maxwell branches numbers have, from the first on without a gap."""
    return next((i for i in range(MOST_BRANCHES) if f"{BRANCHES}.{i}.stiffness" not in numbers), MOST_BRANCHES)


def branch_states(numbers: Values) -> tuple[State, ...]:
    """Return the states of Maxwell branches: what their springs are stretched by."""
    return tuple(_branch(i) for i in range(branches_of(numbers)))


def _branch(i: int) -> State:
    k, c = f"{BRANCHES}.{i}.stiffness", f"{BRANCHES}.{i}.damping"
    return State(
        name=f"{i}.z",
        unit=("m", "rad"),
        size=lambda numbers: min(1.0, numbers[c] / numbers[k]),
        inertia=lambda numbers: numbers[k],
    )


def branch_conflict(numbers: Values) -> Conflict | None:
    """Return the key and the message of branches that lack a number, or follow a gap."""
    count = branches_of(numbers)
    for key in (f"{BRANCHES}.{i}.{name}" for i in range(MOST_BRANCHES) for name in ("stiffness", "damping")):
        place = int(key.split(".")[1])
        if place < count and key not in numbers:
            return key, "it is missing; allowed: a damping in N s/m or N m s/rad, greater than 0"
        if place >= count and key in numbers:
            return key, f"branch {count} has no stiffness; allowed: branches without a gap, each with a stiffness"
    return None


def bristle_conflict(numbers: Values) -> Conflict | None:
    """Return the conflict of LuGre friction: other models' numbers, no force to slide at, a fade that is too wide."""
    coulomb = numbers["friction.coulomb"]
    if coulomb < SMALLEST:
        return "friction.coulomb", f"got {coulomb!r}; allowed: at least {SMALLEST:g}, as bristles yield at it"
    for key in ("smoothing", "coefficient", "radius", "stribeck"):
        if f"friction.{key}" in numbers:
            what = "a Gaussian Stribeck curve" if key == "stribeck" else "LuGre friction without it"
            return f"friction.{key}", f"the model is lugre; allowed: {what}"
    excess = _unfaded(numbers)
    if "friction.fade" in numbers and excess is not None:
        v, force, most = excess
        said = f"bristle damping resists with {force:.4g} at the velocity {v:.4g}, more than 4 times {0.25 * most:.4g}"
        return "friction.fade", f"got {numbers['friction.fade']!r}: {said}; allowed: a lower velocity, or less damping"
    return None


def sliding_force(numbers: Values, v: float) -> float:
    """Return LuGre's g(v), N or N m: the force at which bristles slide at the speed v, with a Gaussian curve."""
    coulomb = numbers["friction.coulomb"]
    more = numbers.get("friction.static", coulomb) - coulomb
    rate = numbers.get(BELL, 1.0)
    return coulomb + more * math.exp(-min((v / rate) ** 2, 700.0))


def _unfaded(numbers: Values) -> tuple[float, float, float] | None:
    """Return the least speed v of a fine grid at which sigma_1(v) v > 4 g(v), with both; None without any."""
    damping, fade = numbers.get("friction.bristle_damping", 0.0), numbers.get("friction.fade", math.inf)
    scales = [x for x in (fade, numbers.get(BELL)) if x is not None and math.isfinite(x)]
    scales.append(4.0 * numbers["friction.coulomb"] / max(damping, SMALLEST))
    low, high = 1e-3 * min(scales), 10.0 * max(scales)
    ratio = (high / low) ** (1.0 / (GRID - 1))
    v = low
    for _ in range(GRID):
        resists = damping * math.exp(-min((v / fade) ** 2, 700.0)) * v
        most = 4.0 * sliding_force(numbers, v)
        if resists > most:
            return v, resists, most
        v *= ratio
    return None


def active_above(numbers: Values) -> float | None:
    """Return the speed (m/s or rad/s) above which LuGre friction can give energy back; None where it is passive.

    It is where sigma_1(v) |v| exceeds 4 g(v), to a percent; viscous friction, which raises it, is left out.
    """
    found = _unfaded(numbers) if BRISTLES in numbers else None
    return None if found is None else found[0]
