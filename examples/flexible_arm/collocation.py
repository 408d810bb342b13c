"""Discrete steps of a model and their exact derivatives, of many states at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Array = Any
Dynamics = Callable[[Array, Array, Array], tuple[Array, tuple[Array, Array, Array]]]
GAUSS = np.array([[1 / 4, 1 / 4 - np.sqrt(3) / 6], [1 / 4 + np.sqrt(3) / 6, 1 / 4]])


class Collocation:
    """States after a duration under constant drives: collocation at Gauss's two points, fourth order, A-stable.

    Dynamics return accelerations of (N, n) states and their derivatives by q, v and u; ``select``, (n, drives), says
    which coordinates the drives act on.  Unknown are the accelerations at the two points; four iterations of Newton's
    method find them to 1e-7.
    """

    def __init__(self, dynamics: Dynamics, select: Array, duration: float, steps: int, iterations: int = 4) -> None:
        self.dynamics, self.select, self.iterations = dynamics, select, iterations
        self.steps, self.h = steps, duration / steps

    def __call__(self, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the states after the duration, (N, 2n), and their derivatives by states before and drives."""
        width, m = x.shape[1], u.shape[1]
        slopes = np.tile(np.eye(width, width + m), (len(x), 1, 1))
        forces = u @ self.select.T
        for _ in range(self.steps):
            x, by = self._step(x, forces)
            slopes = by[..., :width] @ slopes
            slopes[..., width:] += by[..., width:]
        return x, slopes[..., :width], slopes[..., width:]

    def _step(self, x: Array, forces: Array) -> tuple[Array, Array]:
        """Return the states after one step and their derivatives by [q, v, drives], (N, 2n, 2n + drives)."""
        (q, v), (count, n), h = np.split(x, 2, axis=1), forces.shape, self.h
        both, nodes = h * GAUSS, h * GAUSS.sum(axis=1)
        twice = both @ both
        acting = np.repeat(forces, 2, axis=0)
        a = np.zeros((count, 2, n))
        for iteration in range(self.iterations + 1):
            at_q = q[:, None] + nodes[:, None] * v[:, None] + np.einsum("ij,kjn->kin", twice, a)
            at_v = v[:, None] + np.einsum("ij,kjn->kin", both, a)
            rate, by = self.dynamics(at_q.reshape(-1, n), at_v.reshape(-1, n), acting)
            by_q, by_v, by_u = (block.reshape(count, 2, n, n) for block in by)
            matrix = np.einsum("ij,kinm->kinjm", -twice, by_q) + np.einsum("ij,kinm->kinjm", -both, by_v)
            matrix = matrix.reshape(count, 2 * n, 2 * n) + np.eye(2 * n)
            if iteration < self.iterations:
                short = rate.reshape(count, 2 * n, 1) - a.reshape(count, 2 * n, 1)
                a = a + np.linalg.solve(matrix, short).reshape(count, 2, n)
        right = np.concatenate([by_q, by_v + nodes[:, None, None] * by_q, by_u @ self.select], axis=-1)
        by_a = np.linalg.solve(matrix, right.reshape(count, 2 * n, -1)).reshape(count, 2, n, -1)
        weights = h / 2 * both.sum(axis=0)  # of accelerations in q; those in v are h / 2
        slopes = np.concatenate([np.einsum("j,kjnm->knm", weights, by_a), h / 2 * by_a.sum(axis=1)], axis=1)
        slopes[:, :, : 2 * n] += np.block([[np.eye(n), h * np.eye(n)], [np.zeros((n, n)), np.eye(n)]])
        return np.hstack([q + h * v + np.einsum("j,kjn->kn", weights, a), v + h / 2 * a.sum(axis=1)]), slopes
