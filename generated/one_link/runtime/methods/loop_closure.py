"""Loops of a mechanism: the constraint that closes them, their cut joints, and states that are closed.

A generated package carries a copy of this file.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..closing import closed_positions, closed_rates
from ..closing import roots as found_roots
from .compiled_code import CompiledCode

Array = NDArray[Any]


class LoopClosure(CompiledCode):
    """The constraint of closed loops, and states that meet it."""

    def constraint(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """g(q), (constraints,): zero where the loops are closed.

        Of frame b on a loop's second link, seen from frame a on its first: x, y, z (m) of its origin, and sines of its
        turns alpha, beta, gamma about x, y, z, as far as the cut joint blocks them (``eomgen.robot.cuts``).
        """
        return self.calls.run("constraint", out, (q,))

    def constraint_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """J = dg/dq, (constraints, n), exact; J v is the rate of g."""
        return self.calls.run("constraint_jacobian", out, (q,))

    def constraint_bias(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """J_dot v, (constraints,): the second derivative of g is J a + J_dot v."""
        return self.calls.run("constraint_bias", out, (q, v))

    def cut_poses(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Pose of frame b seen from frame a of each loop, (loops, 4, 4), m: the motion of the cut joint."""
        return self.calls.run("cut_poses", out, (q,))

    def cut_coordinates(self, q: ArrayLike) -> Array:
        """Coordinates of the loops' cut joints, (loops, 6): x, y, z (m), alpha, beta, gamma (rad) as of other joints.

        They are those of frame b on a loop's second link, seen from frame a on its first, where the angles turn about
        x, then y, then z; zero in what the joint blocks, where the loops are closed.
        """
        poses = self.cut_poses(q)
        R = poses[..., :3, :3]
        angles = (
            np.arctan2(-R[..., 1, 2], R[..., 2, 2]),
            np.arctan2(R[..., 0, 2], np.hypot(R[..., 0, 0], R[..., 0, 1])),
            np.arctan2(-R[..., 0, 1], R[..., 0, 0]),
        )
        return np.concatenate([poses[..., :3, 3], np.stack(angles, axis=-1)], axis=-1)

    def close(self, q: ArrayLike, held: Iterable[str] = (), *, roots: int | None = None) -> Array:
        """Coordinates near a guess that close all loops, (n,); Levenberg and Marquardt's method.

        Args:
            q: the guess, (n,), or many of them.
            held: names of coordinates that stay at their guess; prescribed ones do.
            roots: find so many ways to close the loops, or as many as there are, from random guesses about this one
                (always the same): (roots, n), the nearest first, angles within half a turn of the guess.  Where fewer
                coordinates are held than the mechanism has freedoms, they are any of infinitely many.

        Raises:
            LoopError: they do not close near the guess, or only turned over; names the loop and its remaining gap.
            UnknownNameError: a held coordinate is none.
            InputError: the robot has no loops, or roots of many states are asked for.
        """
        if roots is not None:
            return found_roots(self.calls, q, held, roots)
        return closed_positions(self.calls, q, held)

    def close_rates(self, q: ArrayLike, v: ArrayLike, held: Iterable[str] = ()) -> Array:
        """Rates that keep the loops closed, (n,), those with the least kinetic energy of the difference to a guess.

        That is what a sudden closing of the loops makes of the guess, too.

        Args:
            q: coordinates that close the loops, (n,).
            v: the guess, (n,).
            held: names of coordinates whose rates stay; those of prescribed ones do.

        Raises:
            LoopError: the loops are open at q, or the rates that are held open one; names it and what remains.
            SingularError: M is not positive definite, or angles at +-pi/2 have no such rates.
            UnknownNameError, InputError: as of ``close``.
        """
        return closed_rates(self.calls, q, v, held)
