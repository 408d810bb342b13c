"""Samples of a fit over time: equal distances, filters, blocks of time."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..motion.files import MeasuredMotion

FIRST = 8  # half width of the filter that differentiates, samples
HALF_WIDTHS = (0, 8, 32, 128)  # of the filter behind it; the best of more would look better than it is
BLOCKS = (8, 40)  # least and most blocks of time: standard errors are the jackknife's, which leaves out one at a time
BLOCK_WIDTHS = 4  # half widths in a block, at least: what is in one block hardly correlates with the next
SIGNAL = 3.0  # variance of a motion over that of its noise, below which it does not count as one
SOLVED = "converged"  # status of a fit
EVEN = 1e-3  # of a step: by so much a sample's time may be off


def least_samples(half: int) -> int:
    """Return samples that a filter of that half width needs."""
    return 2 * half + BLOCKS[0] * BLOCK_WIDTHS * half


def block_count(samples: int, half: int) -> int:
    """Return blocks of time that so many samples behind a filter of that half width are cut into."""
    return min(BLOCKS[1], samples // (BLOCK_WIDTHS * half))


def even_step(motion: MeasuredMotion) -> float:
    """Return the distance of the samples, s.

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
