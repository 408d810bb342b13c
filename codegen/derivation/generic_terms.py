"""Terms of eqs. (11) and (12) of a robot's tree at random rational points, with random placements and inertias.

All numbers are rational and taken modulo a prime, where arithmetic is exact and quick: what vanishes identically is
zero, and what does not is zero about once in a thousand million times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.errors import DerivationError
from eomgen.names import joint_of
from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.value import ANGULAR

from ..joint.zeros import Tally, ZeroMap
from .fresh import Blocks

Residues = NDArray[np.int64]

PRIME = 2**31 - 1  # 3 modulo 4, so that 1 + t^2 has an inverse for every t
MOST_COORDINATES = 36  # of larger robots so many are drawn, the others stay where they are


def check_zeros(
    model: Model, whole: Model, blocks: Mapping[tuple[str, ...], Blocks], zeros: ZeroMap, seed: int = 0
) -> int:
    """Compare the map of zeros with the terms themselves; how many of those that survive were zero all the same.

    Args:
        model: what the map is of.
        whole: the same with angles that offsets turn as coordinates.

    Raises:
        DerivationError: a term that the map drops does not vanish.
    """
    rng = np.random.default_rng(seed)
    moving = np.array([i for body in model.bodies for i in body.indices])
    chosen = np.sort(rng.permutation(moving)[:MOST_COORDINATES])
    M, C = _terms(whole, blocks, [whole.coordinates.index(model.coordinates[i]) for i in chosen], rng)
    vanishing = 0
    for title, terms, tally in (("M", M, zeros.mass_matrix), ("C", C, zeros.christoffel)):
        survives = tally.mask[np.ix_(*(chosen,) * terms.ndim)]
        dropped = np.argwhere(~survives & (terms != 0))
        if len(dropped):
            raise _wrong(model, title, tally, [int(chosen[i]) for i in dropped[0]])
        vanishing += int((survives & (terms == 0)).sum())
    return vanishing


def _wrong(model: Model, title: str, tally: Tally, key: list[int]) -> DerivationError:
    names = [model.coordinates[i] for i in key]
    joint, place = joint_of(names[0]), "; ".join(names)
    reason = tally.zeros[int(tally.reason[tuple(key)])][0]
    return DerivationError(
        f"{joint}: {title}[{place}] is dropped by {reason!r}, and does not vanish; please report it",
        joint=joint,
        block=title,
        place=place,
    )


def _terms(
    model: Model, blocks: Mapping[tuple[str, ...], Blocks], chosen: Sequence[int], rng: np.random.Generator
) -> tuple[Residues, Residues]:
    """Compute M_sv and C_s,vw between chosen coordinates, (m, m) and (m, m, m), by the chain rule on A_0k."""
    m, at = len(chosen), {index: place for place, index in enumerate(chosen)}
    still = np.eye(4, dtype=np.int64), np.zeros((m, 4, 4), np.int64), np.zeros((m, m, 4, 4), np.int64)
    M, C = np.zeros((m, m), np.int64), np.zeros((m, m, m), np.int64)
    done: list[tuple[Residues, Residues, Residues]] = []
    for body in model.bodies:
        pose, D, D2 = done[body.parent] if body.parent != FIXED_BODY else still
        before, B = _times(pose, placed := _placement(rng)), placed
        points = [_circle(rng) if name in ANGULAR else (0, int(rng.integers(PRIME))) for name in body.active]
        A, dA, d2A = (_reduced(x) for x in blocks[body.active].values(points))
        across = _times(B, A)
        first, second = _times(D, across), _times(D2, across)
        places = [at.get(index) for index in body.indices]
        for place, block in zip(places, dA, strict=True):
            if place is not None:
                first[place] = _times(before, block)
                second[place] = second[:, place] = _times(D, _times(B, block))
        pairs = combinations_with_replacement(places, 2)
        for (v, w), block in zip(pairs, d2A, strict=True):
            if v is not None and w is not None:
                second[v, w] = second[w, v] = _times(before, block)
        done.append((_times(pose, across), first, second))
        moment = _times(first, _inertia(rng)).reshape(m, 16)
        M = (M + _products(moment, first.reshape(m, 16))) % PRIME
        C = (C + _products(moment, second.reshape(m * m, 16)).reshape(m, m, m)) % PRIME
    return M, C


def _products(left: Residues, right: Residues) -> Residues:
    """Compute left right^T."""
    total = np.zeros((len(left), len(right)), np.int64)
    for k in range(left.shape[1]):
        total = (total + left[:, k, None] * right[:, k]) % PRIME
    return total


def _times(left: Residues, right: Residues) -> Residues:
    """Multiply 4x4 matrices."""
    total: Residues = ((left[..., :, :, None] * right[..., None, :, :]) % PRIME).sum(axis=-2) % PRIME
    return total


def _reduced(entries: Any) -> Residues:
    numbers = np.array(entries, dtype=object) % PRIME
    return numbers.astype(np.int64).reshape(*numbers.shape[:-1], 4, 4)


def _circle(rng: np.random.Generator) -> tuple[int, int]:
    """Draw sine and cosine at a rational point of the circle: 2t / (1 + t^2), (1 - t^2) / (1 + t^2)."""
    t = int(rng.integers(2, PRIME))
    scale = pow(1 + t * t, -1, PRIME)
    return 2 * t * scale % PRIME, (1 - t * t) * scale % PRIME


def _placement(rng: np.random.Generator) -> Residues:
    """Draw a random placement, turned about z, x and z."""
    pose = np.eye(4, dtype=np.int64)
    for i, j in ((0, 1), (1, 2), (0, 1)):
        (sine, cosine), turn = _circle(rng), np.eye(4, dtype=np.int64)
        turn[i, i] = turn[j, j] = cosine
        turn[j, i], turn[i, j] = sine, PRIME - sine
        pose = _times(pose, turn)
    pose[:3, 3] = rng.integers(PRIME, size=3)
    return pose


def _inertia(rng: np.random.Generator) -> Residues:
    upper = np.triu(rng.integers(PRIME, size=(4, 4)))
    whole: Residues = upper + np.triu(upper, 1).T
    return whole
