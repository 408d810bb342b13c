"""Contenders compared, then timed in turns in one process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eomgen.bench.clock import Stopwatch, Timed
from eomgen.robot.value import Robot

from .contender import Contender

Array = NDArray[np.float64]

STATES = 16  # that a sample cycles through: all in the first cache
BATCH_STATES = 4096
TOLERANCE = 1e-8  # greatest relative difference (max-norm, per state) between contenders that are timed
CONDITION = 1e3  # and round-off times the condition of the mass matrix times this, for what inverts it
READS: Mapping[str, tuple[str, ...]] = {
    "inverse_dynamics": ("q", "v", "a"),
    "mass_matrix": ("q",),
    "forward_dynamics": ("q", "v", "u"),
    "derivatives": ("q", "v", "a"),
    "forward_derivatives": ("q", "v", "u"),
    "second_derivatives": ("q", "v", "a", "w"),
    "step": ("q", "v", "u"),
}
SIZES: Mapping[str, Callable[[int], int]] = {  # of results that are no vector
    "mass_matrix": lambda n: n * n,
    "derivatives": lambda n: 3 * n * n,
    "forward_derivatives": lambda n: 3 * n * n,
    "second_derivatives": lambda n: 9 * n * n,
    "step": lambda n: 2 * n,
}


class Disagreement(Exception):
    """Contenders give different results: no ratio of their times means anything."""


@dataclass(frozen=True)
class Timing:
    """Nanoseconds per state, (rounds,) by label, and the greatest relative difference of results."""

    ns: Mapping[str, Array]
    difference: float

    def median(self, label: str) -> float:
        return float(np.median(self.ns[label]))

    def ratio(self, label: str, ours: str) -> tuple[float, float, float]:
        """Return first quartile, median, third quartile over the rounds of that time by ours."""
        low, middle, high = np.quantile(self.ns[label] / self.ns[ours], (0.25, 0.5, 0.75))
        return float(low), float(middle), float(high)


def states(robot: Robot, count: int) -> dict[str, Array]:
    """Return random states, the same on every run, (count, n) by name.

    Principal coordinates over most of their range, deviations and rates small where a spring or damper is stiff, so
    that its force does not drown the others in the comparison.
    """
    rng = np.random.default_rng(1)
    reach, rate = [], []
    for joint in robot.joints:
        for name, coordinate in joint.coordinates.items():
            wide = name == joint.principal
            reach.append(min(3.0 if wide else 0.3, 100.0 / max(coordinate.stiffness or 0.0, 1e-9)))
            rate.append(min(2.0, 100.0 / max(coordinate.damping or 0.0, 1e-9)))
    n = len(reach)
    return {
        "q": rng.uniform(-1.0, 1.0, (count, n)) * reach,
        "v": rng.uniform(-1.0, 1.0, (count, n)) * rate,
        "a": rng.uniform(-2.0, 2.0, (count, n)),
        "u": rng.uniform(-20.0, 20.0, (count, n)),
        "w": rng.uniform(-1.0, 1.0, (count, n)),
    }


def compare(
    contenders: Sequence[Contender],
    arrays: Sequence[Array],
    size: int,
    tolerance: float | Array,
    what: str,
    compared: int | None = None,
) -> float:
    """Return the greatest relative difference (max-norm, per state) from the first contender.

    Args:
        contenders: at least one.
        arrays: their inputs, (states, n).
        size: of a result.
        tolerance: per state, or one for all.
        what: for the message.
        compared: how many numbers of a result; all if None.

    Raises:
        Disagreement: it is more than the tolerance in some state.
    """
    first = contenders[0].results(arrays, size)[:, :compared]
    scale = np.maximum(np.abs(first).max(axis=1), 1e-300)
    worst = 0.0
    for other in contenders[1:]:
        errors = np.abs(other.results(arrays, size)[:, :compared] - first).max(axis=1) / scale
        if not (errors <= tolerance).all():
            state = int(np.argmax(np.where(np.isnan(errors), np.inf, errors / tolerance)))
            raise Disagreement(
                f"{what}: {other.label} differs from {contenders[0].label} by {errors[state]:.1e} (relative) in state"
                f" {state}; nothing is timed"
            )
        worst = max(worst, float(errors.max()))
    return worst


def time(
    stopwatch: Stopwatch, contenders: Sequence[Contender], arrays: Sequence[Array], size: int, rounds: int
) -> dict[str, Array]:
    """Return nanoseconds per state by label, (rounds,)."""
    out = np.zeros(size * len(arrays[0]) if any(c.batch for c in contenders) else size)
    target = int(out.ctypes.data)
    timed = [Timed(c.code, c.h, 0 if c.keeps_result else target, c.batch) for c in contenders]
    ns = stopwatch.time(timed, len(arrays), arrays, rounds)
    return {contender.label: column for contender, column in zip(contenders, ns.T, strict=True)}


def measure(
    stopwatch: Stopwatch,
    contenders: Sequence[Contender],
    robot: Robot,
    kernel: str,
    rounds: int,
    *,
    count: int = STATES,
    condition: Callable[[Array], float] | None = None,
) -> Timing:
    """Compare, then time.

    Args:
        condition: condition number of the mass matrix at q, where the kernel inverts it.

    Raises:
        Disagreement: results differ.
    """
    inputs = states(robot, count)
    arrays = [inputs[name] for name in READS[kernel]]
    n = arrays[0].shape[1]
    size = SIZES[kernel](n) if kernel in SIZES else n
    tolerance: float | Array = TOLERANCE
    if condition is not None:
        eps = float(np.finfo(np.float64).eps)
        tolerance = np.array([max(TOLERANCE, CONDITION * eps * condition(q)) for q in arrays[0]])
    both = 2 * n * n if kernel == "derivatives" else None  # the third, by a, is the mass matrix
    difference = compare(contenders, arrays, size, tolerance, f"{robot.name}: {kernel}", both)
    return Timing(time(stopwatch, contenders, arrays, size, rounds), difference)
