"""Steps of an inverse motion: halved until the motion changes by less than a tolerance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import IntegrationError
from ...progress import StageReport
from .motions import InverseMotion, Problem, balanced, inverted
from .zeros import InternalZeros

STEPS = 125  # of a motion, which are halved
HALVINGS = 5  # at most
TOLERANCE = 1e-8  # m or rad
NO_BETTER = 0.5  # of the change before, from which on round-off or jumps hold up what shorter steps bring


class Ends(NamedTuple):
    """First and last time of an inverse motion, s, and the zeros from drives to outputs there."""

    first: float
    last: float
    begin: InternalZeros
    end: InternalZeros


class RefinedMotion(NamedTuple):
    """An inverse motion, by how much halving its steps changed it, m or rad, and a note where that is too much."""

    motion: InverseMotion
    change: float = 0.0
    note: str = ""


def on_steps(problem: Problem, ends: Ends, count: int, progress: StageReport) -> InverseMotion:
    """Return the inverse motion on equal steps; errors of ``balanced`` and ``inverted``."""
    t = np.linspace(ends.first, ends.last, count + 1)
    progress(f"{count} steps in balance")
    still = balanced(problem, t)
    progress(f"Newton's method on {count} steps")
    resolved = np.pi * count / (ends.last - ends.first)
    return inverted(problem, t, still, (ends.begin.up_to(resolved), ends.end.up_to(resolved)))


def refine(
    problem: Problem, ends: Ends, count: int, most: int, tolerance: float, progress: StageReport
) -> RefinedMotion:
    """Return the inverse motion whose steps were halved until coordinates changed by less than a tolerance.

    Args:
        problem, ends: of the motion.
        count: of the steps to begin with.
        most: steps that are allowed.
        tolerance: m or rad, of a motor over its ratio.
        progress: called with a line of text when a stage begins.

    Raises:
        IntegrationError: Newton's method does not converge, however short the steps are.
    """
    motion: InverseMotion | None = None
    change, why = np.inf, f"{HALVINGS} halvings are made at most"
    failure: IntegrationError | None = None
    for steps in (count * 2**k for k in range(HALVINGS + 1)):
        if steps > most:
            why = f"{most} steps are allowed"
            break
        try:
            finer = on_steps(problem, ends, steps, progress)
        except IntegrationError as error:
            if motion is not None:  # round-off of shorter steps
                why = "Newton's method does not converge on shorter ones"
                break
            failure = error
            continue
        changed = np.inf if motion is None else _difference(problem, motion, finer)
        if changed >= NO_BETTER * change and np.isfinite(change):
            why = f"round-off, or jumps of the motion, hold up shorter ones (then {changed:.2g})"
            break
        motion, change = finer, changed
        if change <= tolerance:
            return RefinedMotion(motion, change)
    if motion is None:
        assert failure is not None
        raise failure
    if not np.isfinite(change):
        return RefinedMotion(motion, 0.0, f"steps are not halved to compare: {why}")
    return RefinedMotion(
        motion, change, f"halving steps still changed coordinates by more than {tolerance:.2g} m or rad: {why}"
    )


def _difference(problem: Problem, coarse: InverseMotion, fine: InverseMotion) -> float:
    """Return the greatest difference of coordinates at samples and halfway between them, m or rad."""
    t, sizes = coarse.spline.times, np.ones(problem.kernel.n)
    sizes[problem.index] = np.abs(problem.ratio)
    off = (coarse.spline.at(t)[0] - fine.spline.at(t)[0]) / sizes
    return float(np.abs(off).max())
