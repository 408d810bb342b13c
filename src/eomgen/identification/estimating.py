"""Samples of a fit over time: equal distances, filters, blocks of time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Mask
from ..errors import InputError
from ..motion.files import MeasuredMotion
from ..motion.splines import DEGREE, Spline

FIRST = 8  # half width of the filter that differentiates, samples
HALF_WIDTHS = (0, 8, 32, 128)  # of the filter behind it; the best of more would look better than it is
BLOCKS = (8, 40)  # least and most blocks of time: standard errors are the jackknife's, which leaves out one at a time
BLOCK_WIDTHS = 4  # half widths in a block, at least: what is in one block hardly correlates with the next
SIGNAL = 3.0  # variance of a motion over that of its noise, below which it does not count as one
SOLVED = "converged"  # status of a fit
EVEN = 1e-3  # of a step: by so much a sample's time may be off
GAP = 3.5  # times the median interval: two lost samples are interpolated, and no more
RINGING = 16  # samples beside a jump in which a spline of degree 5 is off by more than 1e-6 of it


def least_samples(half: int) -> int:
    """Return samples that a filter of that half width needs."""
    return 2 * half + BLOCKS[0] * BLOCK_WIDTHS * half


def block_count(samples: int, half: int) -> int:
    """Return blocks of time that so many samples behind a filter of that half width are cut into."""
    return min(BLOCKS[1], samples // (BLOCK_WIDTHS * half))


@dataclass(frozen=True)
class EvenMotion:
    """Motion with equal sampling intervals: as recorded, or interpolated by splines.

    Attributes:
        motion: of T samples.
        step: sampling interval, s.
        recorded: times of the recorded samples, (T,), s.
        notes: description and accuracy of the resampling; empty if the motion was not resampled.
    """

    motion: MeasuredMotion
    step: float
    recorded: Array
    notes: tuple[str, ...] = ()

    def reached(self, faulty: Mask) -> Mask:
        """Return the samples, (T, n), that are affected by faulty recorded samples, (T, n), through spline ringing."""
        if not self.notes:
            return faulty
        at = np.searchsorted(self.recorded, self.motion.t).clip(0, len(faulty) - 1)
        window = np.ones(2 * RINGING + 1)
        near = [np.convolve(column, window)[RINGING:-RINGING] > 0.5 for column in faulty.T.astype(np.float64)]
        return np.asarray(np.stack(near, axis=1)[at])


def evenly_sampled(motion: MeasuredMotion) -> EvenMotion:
    """Return a motion with equal sampling intervals, as fits require.

    A motion with unequal intervals is resampled: interpolating splines are evaluated at the same number of equally
    spaced times.

    Raises:
        InputError: there are too few samples, or gaps between them.
    """
    if len(motion.t) < least_samples(FIRST):
        raise InputError(f"{motion.source}: {len(motion.t)} samples; a fit needs at least {least_samples(FIRST)}")
    step = float(motion.t[-1] - motion.t[0]) / (len(motion.t) - 1)
    off = np.abs(motion.t - motion.t[0] - step * np.arange(len(motion.t)))
    if off.max() <= EVEN * step + 1e-9:
        return EvenMotion(motion, step, motion.t)
    intervals = np.diff(motion.t)
    usual = float(np.median(intervals))
    odd = np.flatnonzero((intervals > GAP * usual) | (intervals < usual / GAP))
    if odd.size:
        late = int(odd[0]) + 1
        raise InputError(
            f"{motion.source}: sample {late} is at {motion.t[late]:.9g} s, {intervals[late - 1]:.4g} s behind the one"
            f" before; allowed for a fit: intervals from {usual / GAP:.4g} to {GAP * usual:.4g} s, {1.0 / GAP:.2g} to"
            f" {GAP:g} times their median: a file without gaps, or a part of it"
        )
    return _resampled(motion, step)


def _resampled(motion: MeasuredMotion, step: float) -> EvenMotion:
    """Return a motion interpolated at equally spaced times, with a note on the accuracy."""
    t, intervals = np.linspace(motion.t[0], motion.t[-1], len(motion.t)), 1e3 * np.diff(motion.t)
    arrays = {key: array for key in ("q", "v", "a", "u") if (array := getattr(motion, key)) is not None}
    columns = np.column_stack([*arrays.values(), *motion.states.values()])
    smooth, rougher = (Spline(motion.t, columns, at_rest=False, degree=k).at(t)[0] for k in (DEGREE, DEGREE - 2))
    span = np.ptp(columns, axis=0)
    doubt = 100.0 * float((np.abs(smooth - rougher).max(axis=0) / np.where(span > 0.0, span, np.inf)).max())
    n = len(motion.coordinates)
    parts = {key: smooth[:, k * n : (k + 1) * n] for k, key in enumerate(arrays)}
    states = dict(zip(motion.states, smooth[:, len(arrays) * n :].T, strict=True))
    note = (
        f"times of {motion.source}: intervals from {intervals.min():.4g} to {intervals.max():.4g} ms, resampled to"
        f" {1e3 * step:.5g} ms by splines of degree {DEGREE} through all samples; those of degree {DEGREE - 2} differ"
        f" by {doubt:.2g} % of a column's range at most; noise is estimated too small, by about a fifth"
    )
    q, u, v, a = parts["q"], parts["u"], parts.get("v"), parts.get("a")
    return EvenMotion(replace(motion, t=t, q=q, v=v, a=a, u=u, states=states), step, motion.t, (note,))
