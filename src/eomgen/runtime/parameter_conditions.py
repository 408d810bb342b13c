"""Conditions between run-time parameters: matrices without negative energy, numbers of laws that go together.

A package of a robot without them does not carry this module.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..errors import InputError
from ..names import show

ROUND_OFF = 1e-9  # of a matrix scaled by its diagonal, and as many roundings of entries in single precision:
ROUNDINGS = 8.0
SPEEDS, TINY = 4000, 1e-12  # at which damping of bristles is looked at; least of it that counts, N s/m or N m s/rad
FADING = "bristle_damping or fade so low that bristles give no energy back"  # what is allowed of them
SEEN = 0.1  # of a direction's largest share, from which on its coordinates are named


@dataclass(frozen=True)
class Matrix:
    """A symmetric matrix whose entries are parameters, the others 0, and that has no motion of negative energy.

    Attributes:
        owner: its name, "joints.joint1.stiffness".
        coordinates: of its rows.
        places: of the entries, by the parameters' names: row and column.
        round_off: by which the matrix, scaled by its diagonal as units are mixed, may be negative, per row.
    """

    owner: str
    coordinates: Sequence[str]
    places: Mapping[str, tuple[int, int]]
    round_off: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its numbers."""
        return tuple(self.places)

    def fault(self, numbers: Mapping[str, float], given: Collection[str]) -> str:
        """Say what is wrong with numbers, by their names, and what is allowed; "" if nothing is."""
        if not (moving := self.negative(numbers)):
            return ""
        allowed = "entries of a positive semidefinite matrix"
        return f": {self.owner} would have a negative energy where {' and '.join(moving)} move; allowed: {allowed}"

    def negative(self, numbers: Mapping[str, float]) -> list[str]:
        """Return coordinates of a motion that has a negative energy with these numbers; none where no motion has."""
        matrix = np.zeros((len(self.coordinates),) * 2)
        for name, (i, j) in self.places.items():
            matrix[i, j] = matrix[j, i] = numbers[name]
        sizes = np.sqrt(np.maximum(matrix.diagonal(), 0.0))
        loose = matrix.any(axis=1) & (sizes == 0.0)
        if loose.any():  # what has no stiffness of its own, and what it is coupled to
            coupled = matrix[loose].any(axis=0) | loose
            return [name for name, is_coupled in zip(self.coordinates, coupled, strict=True) if is_coupled]
        held = sizes > 0.0
        scaled = matrix[np.ix_(held, held)] / np.outer(sizes[held], sizes[held])
        if not held.any() or not np.isfinite(scaled).all():
            return [] if not held.any() else list(self.coordinates)
        energies, motions = np.linalg.eigh(scaled)
        if energies[0] >= -self.round_off * len(scaled):
            return []
        shares = np.abs(motions[:, 0]) / np.abs(motions[:, 0]).max()
        names = [name for name, is_held in zip(self.coordinates, held, strict=True) if is_held]
        return [name for name, share in zip(names, shares, strict=True) if share >= SEEN]


@dataclass(frozen=True)
class Condition:
    """A condition between numbers of a law: their sum with ``factors`` is at least ``least``; ``allowed`` says it.

    Where there are no factors, damping of bristles fades as they slide faster, so that they give no energy back at any
    velocity: ``fades`` has the numbers by their keys.
    """

    factors: Mapping[str, float]
    least: float
    allowed: str
    fades: Mapping[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its numbers."""
        return (*self.factors, *self.fades.values())

    def fault(self, numbers: Mapping[str, float], given: Collection[str]) -> str:
        """Say beside which numbers those ``given`` are wrong, and what is allowed; "" if nothing is."""
        if self.holds(numbers):
            return ""
        beside = ", ".join(f"{x} is {numbers[x]:g}" for x in self.names if x not in given)
        return f"{beside and f', where {beside}'}; allowed: {self.allowed}"

    def holds(self, numbers: Mapping[str, float]) -> bool:
        """Return whether numbers, by their names, satisfy it."""
        if self.fades:
            return _fades({key: numbers[name] for key, name in self.fades.items()})
        return sum(factor * numbers[name] for name, factor in self.factors.items()) >= self.least


def _fades(numbers: Mapping[str, float]) -> bool:
    """Return whether bristle_damping exp(-(v / fade)^2) v is at most 4 times what bristles slide at, at any v."""
    coulomb, damping, fade = (numbers[f"friction.{key}"] for key in ("coulomb", "bristle_damping", "fade"))
    more, bell = numbers.get("friction.static", coulomb) - coulomb, numbers.get("friction.gaussian", 1.0)
    scales = [fade, 4.0 * coulomb / max(damping, TINY)] + [bell] * ("friction.gaussian" in numbers)
    v = np.geomspace(1e-3 * min(scales), 10.0 * max(scales), SPEEDS)
    far, near = (np.exp(-np.minimum((v / scale) ** 2, 700.0)) for scale in (fade, bell))
    return bool((damping * far * v <= 4.0 * (coulomb + more * near)).all())


def conditions_of(meta: Mapping[str, Any], dtype: DTypeLike) -> dict[str, list[Matrix | Condition]]:
    """Return the conditions that a package's metadata has, by the names of their numbers."""
    round_off = max(ROUND_OFF, ROUNDINGS * float(np.finfo(dtype).eps))
    conditions: list[Matrix | Condition] = []
    for owner, coordinates in meta.get("matrices", {}).items():
        pairs = [(i, j) for i in range(len(coordinates)) for j in range(i, len(coordinates))]
        names = {f"{owner}.{coordinates[i]}.{coordinates[j]}": (i, j) for i, j in pairs}
        places = {name: place for name, place in names.items() if name in meta["parameters"]}
        conditions.append(Matrix(owner, coordinates, places, round_off))
    for said in meta.get("conditions", ()):
        allowed = said.get("allowed", FADING)
        conditions.append(Condition(said.get("factors", {}), said.get("least", 0.0), allowed, said.get("fades", {})))
    found: dict[str, list[Matrix | Condition]] = {}
    for one in conditions:
        for name in one.names:
            found.setdefault(name, []).append(one)
    return found


def refuse_faults(
    conditions: Mapping[str, Sequence[Matrix | Condition]], values: Mapping[str, Any], number: Callable[[str], float]
) -> None:
    """Raise InputError where new values, with other parameters as they are, do not satisfy a condition.

    Args:
        conditions: by the names of their numbers.
        values: new ones, by name.
        number: gives a parameter as the kernel's dtype has it, a new one if it is among the values.
    """
    touched = {id(one): one for name in values for one in conditions.get(name, ())}
    for one in touched.values():
        fault = one.fault({name: number(name) for name in one.names}, values.keys())
        if fault:
            changed = ", ".join(f"{name} = {show(x)}" for name, x in values.items() if name in one.names)
            raise InputError(f"parameters: {changed}{fault} (``update`` changes several at once)")
