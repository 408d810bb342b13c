"""What all fits have in common: samples at equal distances, blocks of time, intervals, doubts."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..motion.files import MeasuredMotion
from ..names import component_name
from ..optional import optional_import
from .estimates import KEYS, Estimate, FittedCoordinate

FIRST = 8  # half width of the filter that differentiates, samples
HALF_WIDTHS = (0, 8, 32, 128)  # of the filter behind it; the best of more would look better than it is
BLOCKS = (8, 40)  # least and most blocks of time: standard errors are the jackknife's, which leaves out one at a time
BLOCK_WIDTHS = 4  # half widths in a block, at least: what is in one block hardly correlates with the next
SIGNAL = 3.0  # variance of a motion over that of its noise, below which it does not count as one
EVEN = 1e-3  # of a step: by so much a sample's time may be off


def least_samples(half: int) -> int:
    """Samples that a filter of that half width needs."""
    return 2 * half + BLOCKS[0] * BLOCK_WIDTHS * half


def block_count(samples: int, half: int) -> int:
    """Blocks of time that so many samples behind a filter of that half width are cut into."""
    return min(BLOCKS[1], samples // (BLOCK_WIDTHS * half))


def even_step(motion: MeasuredMotion) -> float:
    """Distance of the samples, s.

    Raises:
        InputError: too few samples, or they are not evenly spaced.
    """
    if len(motion.t) < least_samples(FIRST):
        raise InputError(f"{motion.source}: {len(motion.t)} samples; a fit needs at least {least_samples(FIRST)}")
    step = float(motion.t[-1] - motion.t[0]) / (len(motion.t) - 1)
    off = np.abs(motion.t - motion.t[0] - step * np.arange(len(motion.t)))
    worst = int(off.argmax())
    if off[worst] > EVEN * step + 1e-9:
        raise InputError(
            f"{motion.source}: sample {worst} is at {motion.t[worst]:.9g} s; allowed for a fit: equal distances, here"
            f" {motion.t[0] + worst * step:.9g} s"
        )
    return step


def interval_of(
    value: float, variance: float, freedoms: int, confidence: float, described: float, width: float, unexplained: float
) -> Estimate:
    """A value with its interval, by Student's t with so many degrees of freedom; the rest as in ``Estimate``."""
    with optional_import("SciPy", "fit needs"):
        from scipy.stats import t as student
    quantile, error = float(student.ppf(0.5 + confidence / 2, freedoms)), float(np.sqrt(variance))
    low, high = value - quantile * error, value + quantile * error
    return Estimate(value, error, low, high, described, width, unexplained)


def doubts(entry: FittedCoordinate) -> list[str]:
    """Warnings about a fitted coordinate."""
    found = []
    for key in KEYS:
        estimate: Estimate | None = getattr(entry, key)
        if estimate is None:
            continue
        name = component_name(entry.coordinate, key)
        if estimate.low <= 0.0 <= estimate.high:
            found.append(f"{name}: its interval holds zero, so the motion does not determine it")
        elif estimate.value < 0.0:
            found.append(f"{name} is negative; is the drive known, and the inertia right?")
        elif estimate.unexplained > 0.5:
            found.append(f"{name}: {100 * estimate.unexplained:.0f} % of the force stays unexplained")
    return found
