"""Terms of eqs. (11) and (12) of a robot's tree at random rational points, with random placements and inertias.

All numbers are rational and taken modulo a prime, where arithmetic is exact and quick: what vanishes identically is
zero, and what does not is zero about once in a thousand million times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.joint.facts import facts_of
from eomgen.codegen.joint.zeros import ZeroMap
from eomgen.robot.geometry import Entries, JointFacts
from eomgen.robot.model import FIXED_BODY, Model, with_offset_angles
from eomgen.robot.value import ANGULAR

Residues = NDArray[np.int64]

PRIME = 2**31 - 1  # 3 modulo 4, so that 1 + t^2 has an inverse for every t
MOST_COORDINATES = 36  # of larger robots so many are drawn, the others stay where they are


def blocks_at(facts: JointFacts, at: Sequence[tuple[Any, Any]]) -> tuple[list[Any], list[list[Any]], list[list[Any]]]:
    """Evaluate the transform, first and second derivatives of a joint; entries row by row, of any exact type.

    Args:
        at: per active coordinate (0, position) of a translation, (sine, cosine) of an angle.
    """
    values: dict[tuple[str, str], Any] = {}
    for name, (sine, cosine) in zip(facts.active, at, strict=True):
        values |= {("sin", name): sine, ("cos", name): cosine} if name in ANGULAR else {("", name): cosine}

    def flat(matrix: Entries) -> list[Any]:
        return [
            sum(coefficient * math.prod(values[factor] for factor in factors) for coefficient, factors in entry)
            for row in matrix
            for entry in row
        ]

    return flat(facts.transform), list(map(flat, facts.first)), list(map(flat, facts.second))


def check_zeros(model: Model, zeros: ZeroMap, seed: int = 0) -> int:
    """Assert that all terms that a map of zeros drops vanish; how many of those that survive were zero all the same."""
    rng = np.random.default_rng(seed)
    moving = np.array([i for body in model.bodies for i in body.indices])
    chosen = np.sort(rng.permutation(moving)[:MOST_COORDINATES])
    whole, _ = with_offset_angles(model)
    M, C = _terms(whole, [whole.coordinates.index(model.coordinates[i]) for i in chosen], rng)
    vanishing = 0
    for title, terms, tally in (("M", M, zeros.mass_matrix), ("C", C, zeros.christoffel)):
        survives = tally.mask[np.ix_(*(chosen,) * terms.ndim)]
        dropped = np.argwhere(~survives & (terms != 0))
        names = ["; ".join(model.coordinates[chosen[i]] for i in key) for key in dropped]
        assert not names, f"{title}[{names[0]}] is dropped, and does not vanish"
        vanishing += int((survives & (terms == 0)).sum())
    return vanishing


def _terms(model: Model, chosen: Sequence[int], rng: np.random.Generator) -> tuple[Residues, Residues]:
    """Compute M_sv and C_s,vw between chosen coordinates, (m, m) and (m, m, m), by the chain rule on A_0k."""
    m, at = len(chosen), {index: place for place, index in enumerate(chosen)}
    still = np.eye(4, dtype=np.int64), np.zeros((m, 4, 4), np.int64), np.zeros((m, m, 4, 4), np.int64)
    M, C = np.zeros((m, m), np.int64), np.zeros((m, m, m), np.int64)
    done: list[tuple[Residues, Residues, Residues]] = []
    for body in model.bodies:
        pose, D, D2 = done[body.parent] if body.parent != FIXED_BODY else still
        before, B = _times(pose, placed := _placement(rng)), placed
        points = [_circle(rng) if name in ANGULAR else (0, int(rng.integers(PRIME))) for name in body.active]
        A, dA, d2A = (_reduced(x) for x in blocks_at(facts_of(model, body.active), points))
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
