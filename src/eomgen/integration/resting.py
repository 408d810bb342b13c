"""Times at which dry friction holds a coordinate along a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..robot.laws import SMOOTHING
from ..runtime.kernel import Kernel
from ..state.springs import cut_numbers, law_numbers, smoothings

NEAR = 25.0  # smoothings: slower than this friction is below 0.9992 of its limit


@dataclass(frozen=True)
class Rest:
    """A time during which friction holds a coordinate.

    Attributes:
        coordinate: its name; of a cut joint LOOP.COORDINATE, of a coupling its name.
        begins, ends: the first and the last sample at rest, s.
    """

    coordinate: str
    begins: float
    ends: float


def rests(kernel: Kernel, t: Array, q: Array, v: Array) -> tuple[Rest, ...]:
    """When friction held coordinates along a motion, by time, as exactly as its samples are apart.

    Held is what has dry friction and is slower than ``NEAR`` smoothings, or than as many of the default one, in two
    samples at least that follow each other.

    Args:
        kernel: with the parameters of the motion.
        t: times, (T,), s.
        q, v: coordinates and rates, (T, n).
    """
    known, found = smoothings(kernel), list[Rest]()
    if not known or t.size < 2:
        return ()
    numbers = {name: given for name, given in law_numbers(kernel).items() if name not in kernel.prescribed}
    names = [name for name, given in numbers.items() if _is_dry(given)]
    cut = [name for name, given in cut_numbers(kernel).items() if _is_dry(given)]
    rates = v[:, [kernel.coordinates.index(name) for name in names]]
    if cut:
        rows = kernel.cut_jacobian(q)[:, [kernel.cut_laws.index(name) for name in cut]]
        rates = np.hstack([rates, np.einsum("tij,tj->ti", rows, v)])
    for name, column in zip((*names, *cut), rates.T, strict=True):
        slow = np.abs(column) <= NEAR * max(known[name], SMOOTHING)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]])))
        for first, behind in edges.reshape(-1, 2).tolist():
            if behind - first > 1:
                found.append(Rest(name, float(t[first]), float(t[behind - 1])))
    return tuple(sorted(found, key=lambda rest: (rest.begins, rest.ends)))


def _is_dry(given: dict[str, float]) -> bool:
    """Whether numbers of a coordinate have dry friction that is not 0."""
    return any(given.get(f"friction.{key}") for key in ("coulomb", "static", "coefficient"))
