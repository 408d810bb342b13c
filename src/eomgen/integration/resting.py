"""Intervals of stiction: when Coulomb friction holds a coordinate along a motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Mask
from ..errors import ArrayError
from ..identifiers import check_kind
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel
from ..names import component_name
from ..robot.internal_states.bristles import BRISTLES, sliding_force
from ..robot.laws import SMOOTHING
from ..state.motors import acting
from ..state.springs import cut_numbers, law_numbers, smoothings

NEAR = 25.0  # smoothings: slower than this friction is below 0.9992 of its limit
YIELDING = 0.9992  # of the force at which bristles slide: so far they hold
CROSSINGS = 10.0  # 1/s: of the bristles' deflection; what is faster passes through it on its way back
BRISTLE_STATE = "friction.z"  # of LuGre friction, below the coordinate's name


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


def rests(kernel: Kernel, t: Array, q: Array, v: Array, z: Array | None = None) -> tuple[Rest, ...]:
    """Return the intervals in which friction held coordinates along a motion, by time, to the distance of samples.

    A coordinate sticks where it has Coulomb friction and its velocity is below ``NEAR`` smoothings, or as many of the
    default one, in two successive samples at least; with LuGre friction, where its bristles bend and do not yet yield,
    and it is slower than ``CROSSINGS`` of their largest deflections per second.

    Args:
        kernel: with the parameters of the motion.
        t: times, (T,), s.
        q, v: coordinates and velocities, (T, n).
        z: internal states, (T, m), of robots that have some.

    Raises:
        ArrayError: z is missing.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    if kernel.internal_states and z is None:
        raise ArrayError(f"z: missing; allowed: (T, {len(kernel.internal_states)})")
    widths, intervals = smoothings(kernel), list[Rest]()
    if not (widths or kernel.internal_states) or t.size < 2:
        return ()
    rates = dict(zip(acting(kernel), np.hstack([v, v @ follower_matrix(kernel)[0].T]).T, strict=True))
    rates |= dict(zip(kernel.internal_states, () if z is None else z.T, strict=False))
    laws = {name: x for name, x in law_numbers(kernel).items() if name not in kernel.prescribed}
    cut = {name: x for name, x in cut_numbers(kernel).items() if _has_coulomb_friction(x)}
    if cut:
        rows = kernel.functions.cut_jacobian(q)[:, [kernel.cut_laws.index(name) for name in cut]]
        rates |= dict(zip(cut, np.einsum("tij,tj->it", rows, v), strict=True))
    for name, numbers in (laws | cut).items():
        if not _has_coulomb_friction(numbers):
            continue
        if BRISTLES in numbers:
            held = _bristles_hold(numbers, rates[name], rates[component_name(name, BRISTLE_STATE)])
        else:
            held = np.abs(rates[name]) <= NEAR * max(widths[name], SMOOTHING)
        intervals += _intervals(name, t, held)
    return tuple(sorted(intervals, key=lambda rest: (rest.begins, rest.ends)))


def _intervals(name: str, t: Array, held: Mask) -> Iterator[Rest]:
    """Give the intervals of two samples and more in which a coordinate is held."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]])))
    for first, behind in edges.reshape(-1, 2).tolist():
        if behind - first > 1:
            yield Rest(name, float(t[first]), float(t[behind - 1]))


def _bristles_hold(numbers: Mapping[str, float], v: Array, z: Array) -> Mask:
    """Return where bristles bend and do not yield: LuGre friction of these numbers at v and z, (T,) each."""
    stiffness, static = numbers[BRISTLES], numbers.get("friction.static", 0.0)
    slow = np.abs(v) <= CROSSINGS * max(static, numbers["friction.coulomb"]) / stiffness
    return np.asarray(slow & (stiffness * np.abs(z) < YIELDING * sliding_force(numbers, v)))


def _has_coulomb_friction(laws: dict[str, float]) -> bool:
    """Return whether a coordinate's law numbers have Coulomb friction that is not 0."""
    return any(laws.get(f"friction.{key}") for key in ("coulomb", "static", "coefficient"))
