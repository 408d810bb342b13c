"""Generalized Maxwell elements: the states of their branches, what springs are stretched by."""

from __future__ import annotations

from ..numbers import Conflict, Values
from .states import State

BRANCHES = "maxwell"
MOST_BRANCHES = 8  # of a generalized Maxwell element


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
        is_bounded=False,
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
