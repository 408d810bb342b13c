"""Derivatives of an explicit method's steps on stiff robots, which are not those of the motion: noticed, and refused.

Where a robot is stiff, error control keeps an explicit method's steps at the limit of its stability: what grows in a
step is seen in its error, and the next one is shorter.  Derivatives count the lengths of steps as constant, and grow
without end.  C tells of every step how far it is from that limit; where one is near it, derivatives are taken once more
along the same motion, with several steps, which are stable, in the place of each such one, and both must be of one
size.  Motions that are sensitive by themselves have derivatives that grow, too, in steps of any length alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ...names import show
from ...runtime.raw import Array

NEAR = 1.5  # a step times its fastest rate, of the 3.5 at which tsit5 is not stable any more
MOST = 64  # steps in the place of one: of one at rest it is not known how far it is from that limit
TIMES = 10.0  # so many times one another both derivatives may be: contacts are no finer in them
LEAST = 1e-6  # what is below that share of what derivatives are taken of is as good as nothing


class Pair(NamedTuple):
    """Derivatives of steps and of finer ones: ``name`` says by what, ``size`` is how large that is itself."""

    name: str
    whole: Array
    fine: Array
    size: float = 1.0


def substep_counts(stiffness: Array | None) -> Array | None:
    """Return the number of stable steps to take in the place of each, by its stiffness, (steps,).

    None if all of them are stable, or the method is.
    """
    if stiffness is None or not (stiffness > NEAR).any():
        return None
    wanted = np.minimum(stiffness, NEAR * MOST) / NEAR
    return np.where(stiffness > NEAR, 2 ** np.ceil(np.log2(np.maximum(wanted, 2.0))), 1).astype(np.int64)


def refuse_different(function: str, pairs: Iterable[Pair], largest: float, substeps: Sequence[Array]) -> None:
    """Refuse derivatives that are not those of finer steps.

    Args:
        pairs: of both, by what they are taken by.
        largest: size of what they are taken of.
        substeps: of every state with steps that are split, how many there are in the place of each.

    Raises:
        InputError: they differ, or are not finite; says by what, by how much, and what to take instead.
    """
    for name, whole, fine, size in pairs:
        one, other = (float(np.abs(x).max(initial=0.0)) for x in (whole, fine))
        if max(one, other) <= LEAST * largest / max(size, 1.0) or (one < TIMES * other and other < TIMES * one):
            continue
        every = np.concatenate(substeps)
        raise InputError(
            f"{function}: tsit5: {np.count_nonzero(every > 1)} of {every.size} steps are near the limit of its"
            f" stability, as the robot is stiff there, and derivatives of its steps are not those of the motion: by"
            f" {show(name)} {one:.3g}, of shorter steps {other:.3g}; take rosenbrock"
        )
