"""Choice of poses: the best one after the other, then exchanges while one of them gains (V. Fedorov)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Index
from .information import Criterion, Information, added, inverse, removed

ENOUGH = 0.95  # of the bound
_STARTS = 10  # of exchanges: few poses have many choices that no single exchange betters
_PASSES = 50  # over all chosen ones
_GAIN = 1e-9  # of the function's gain, below which an exchange is none


def chosen_by(
    information: Information, criterion: Criterion, count: int, possible: float, rng: np.random.Generator
) -> tuple[Index, bool]:
    """Return indices of the chosen candidates, the most informative ones first, and whether no exchange betters them.

    possible: the bound; while less than ENOUGH of it is reached, exchanges begin anew with random candidates.
    """
    many = len(information.Y)
    best, reached, is_done = np.zeros(0, dtype=np.intp), -np.inf, False
    for start in range(_STARTS):
        first = rng.choice(many, count, replace=False) if start else _greedy(information, criterion, count)
        chosen, ended = _exchanged(information, criterion, first)
        value = criterion.value(information.total(np.bincount(chosen, minlength=many).astype(np.float64)))
        if value > reached:
            best, reached, is_done = chosen, value, ended
        if criterion.efficiency(reached, possible, information.size) >= ENOUGH:
            break
    return best[_greedy(replace(information, Y=information.Y[best]), criterion, count)], is_done


def _greedy(information: Information, criterion: Criterion, count: int) -> Index:
    """Return the candidate that gains most, again and again."""
    covariance, left, chosen = inverse(information.start), np.arange(len(information.Y)), list[int]()
    for _ in range(count):
        best = int(criterion.gains(information.Y[left], covariance).argmax())
        chosen.append(int(left[best]))
        covariance = added(covariance, information.Y[left[best]])
        left = np.delete(left, best)
    return np.array(chosen, dtype=np.intp)


def _exchanged(information: Information, criterion: Criterion, chosen: Index) -> tuple[Index, bool]:
    """Return the chosen ones with each replaced by the best candidate, and whether that ended with none better."""
    design = chosen.copy()
    free = np.ones(len(information.Y), dtype=bool)
    free[design] = False
    for _ in range(_PASSES):
        covariance = inverse(information.total(np.bincount(design, minlength=free.size).astype(np.float64)))
        swaps = 0
        for k, pose in enumerate(design.tolist()):
            without = removed(covariance, information.Y[pose])
            free[pose] = True
            places = np.flatnonzero(free)
            gains = criterion.gains(information.Y[places], without)
            best, kept = int(gains.argmax()), float(gains[np.searchsorted(places, pose)])
            if gains[best] > kept + _GAIN * abs(kept):
                design[k] = places[best]
                swaps += 1
                covariance = added(without, information.Y[design[k]])
            free[design[k]] = False
        if not swaps:
            return np.asarray(design), True
    return np.asarray(design), False
