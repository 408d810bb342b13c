"""Intervals of stiction: when Coulomb friction holds a coordinate along a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import check_kind
from ..robot.laws import SMOOTHING
from ..runtime.kernel import Kernel
from ..state.springs import cut_numbers, law_numbers, smoothings

NEAR = 25.0  # smoothings: slower than this friction is below 0.9992 of its limit


@dataclass(frozen=True)
class Rest:
    """An interval of time in which friction holds a coordinate (stiction).

    Attributes:
        coordinate: its name; of a loop joint LOOP.COORDINATE, of a coupling its name.
        begins, ends: the first and the last sample that sticks, s.
    """

    coordinate: str
    begins: float
    ends: float


def rests(kernel: Kernel, t: Array, q: Array, v: Array) -> tuple[Rest, ...]:
    """Return the intervals in which friction held coordinates along a motion, by time, to the distance of samples.

    A coordinate sticks where it has Coulomb friction and its velocity is below ``NEAR`` smoothings, or as many of the
    default one, in two successive samples at least.

    Args:
        kernel: with the parameters of the motion.
        t: times, (T,), s.
        q, v: coordinates and velocities, (T, n).
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    widths, intervals = smoothings(kernel), list[Rest]()
    if not widths or t.size < 2:
        return ()
    numbers = {name: laws for name, laws in law_numbers(kernel).items() if name not in kernel.prescribed}
    names = [name for name, laws in numbers.items() if _has_coulomb_friction(laws)]
    cut = [name for name, laws in cut_numbers(kernel).items() if _has_coulomb_friction(laws)]
    velocities = v[:, [kernel.coordinates.index(name) for name in names]]
    if cut:
        rows = kernel.cut_jacobian(q)[:, [kernel.cut_laws.index(name) for name in cut]]
        velocities = np.hstack([velocities, np.einsum("tij,tj->ti", rows, v)])
    for name, column in zip((*names, *cut), velocities.T, strict=True):
        slow = np.abs(column) <= NEAR * max(widths[name], SMOOTHING)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]])))
        for first, behind in edges.reshape(-1, 2).tolist():
            if behind - first > 1:
                intervals.append(Rest(name, float(t[first]), float(t[behind - 1])))
    return tuple(sorted(intervals, key=lambda rest: (rest.begins, rest.ends)))


def _has_coulomb_friction(laws: dict[str, float]) -> bool:
    """Return whether a coordinate's law numbers have Coulomb friction that is not 0."""
    return any(laws.get(f"friction.{key}") for key in ("coulomb", "static", "coefficient"))
