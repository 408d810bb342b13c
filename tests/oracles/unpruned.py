"""Eqs. (11) and (12) on floats, batch by batch, without dropping anything: what pruning is held against."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from eomgen.codegen.joint.lemmas import joint_derivatives, joint_transform, step
from eomgen.codegen.tree.bound import bind
from eomgen.robot.model import FIXED_BODY, Body, Model

Array = NDArray[np.float64]


@cache
def _joint_functions(active: tuple[str, ...]) -> Any:
    derivatives = joint_derivatives(active)
    blocks = [joint_transform(active), *derivatives.first.values(), *derivatives.second.values()]
    return sp.lambdify(
        [[step(name).symbol for name in active]], [entry for block in blocks for entry in block], "numpy"
    )


def _joint_blocks(body: Body, q: Array) -> tuple[Array, Array, Array]:
    """The joint's transform and all its first and second derivatives, (N, 4, 4), (N, d, 4, 4), (N, d, d, 4, 4)."""
    d, count = len(body.active), len(q)
    entries = _joint_functions(body.active)(list(q[:, list(body.indices)].T))
    blocks = np.array([np.broadcast_to(entry, count) for entry in entries]).T.reshape(count, -1, 4, 4)
    return blocks[:, 0], blocks[:, 1 : d + 1], blocks[:, d + 1 :].reshape(count, d, d, 4, 4)


def brute_force(model: Model, q: Array) -> tuple[Array, Array]:
    """M and C of eqs. (11) and (12): (n, n) and (n, n, n) for one state (n,), with a leading axis for states (N, n)."""
    M, C = _batch(model, np.atleast_2d(q))
    return (M, C) if q.ndim > 1 else (M[0], C[0])


def _batch(model: Model, q: Array) -> tuple[Array, Array]:
    bound = bind(model, lambda _, number: number, lambda angle: (np.sin(angle), np.cos(angle)))
    N, n = q.shape
    M, C = np.zeros((N, n, n)), np.zeros((N, n, n, n))
    poses: list[tuple[list[int], Array, Array, Array]] = []  # coordinates on the way, the transform, its derivatives
    start: tuple[list[int], Array, Array, Array]
    start = ([], np.tile(np.eye(4), (N, 1, 1)), np.zeros((N, 0, 4, 4)), np.zeros((N, 0, 0, 4, 4)))
    for body, numbers in zip(model.bodies, bound.bodies, strict=True):
        way, A, D, D2 = poses[body.parent] if body.parent != FIXED_BODY else start
        B, H = np.eye(4), np.zeros((4, 4))
        B[:3, :3], B[:3, 3] = numbers.placement.rotation, numbers.placement.origin
        H[:3, :3], H[3, 3] = numbers.inertia.second, numbers.inertia.mass
        H[:3, 3] = H[3, :3] = numbers.inertia.first
        J, J1, J2 = _joint_blocks(body, q)
        A, D, D2 = A @ B, D @ B, D2 @ B
        mixed = D[:, :, None] @ J1[:, None]
        here = [*way, *body.indices]
        new = (
            A @ J,
            np.concatenate([D @ J[:, None], A[:, None] @ J1], axis=1),
            _joined(D2 @ J[:, None, None], mixed, A[:, None, None] @ J2),
        )
        poses.append((here, *new))
        d = len(here)
        rows = (new[1] @ H).reshape(N, d, 16)
        M[np.ix_(range(N), here, here)] += rows @ np.swapaxes(new[1].reshape(N, d, 16), 1, 2)
        terms = rows @ np.swapaxes(new[2].reshape(N, d * d, 16), 1, 2)
        C[np.ix_(range(N), here, here, here)] += terms.reshape(N, d, d, d)
    return M, C


def _joined(old: Array, mixed: Array, own: Array) -> Array:
    """Second derivatives by all pairs from those by old pairs, mixed ones, and pairs of the joint itself."""
    return np.concatenate(
        [np.concatenate([old, mixed], axis=2), np.concatenate([np.swapaxes(mixed, 1, 2), own], axis=2)], axis=1
    )
