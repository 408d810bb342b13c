"""The tool's error in the tool frame, and the change of a reference that undoes it as far as one can."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Array
from ..geometry.rotations import vectors_of

DAMPING = 1e-2  # of the greatest singular value: directions that need more of the drives are left where they are


def tool_error(want: Array, pose: Array) -> Array:
    """Return by how much poses, (T, 4, 4), are off those wanted: (T, 6), m and rad, in the wanted tool's axes."""
    turned = np.swapaxes(want[:, :3, :3], 1, 2)
    off = (turned @ (pose[:, :3, 3] - want[:, :3, 3])[..., np.newaxis])[..., 0]
    return np.hstack([off, vectors_of(turned @ pose[:, :3, :3])])


def in_tool_axes(jacobian: Array, want: Array) -> Array:
    """Return Jacobians of a frame in the base frame, (T, 6, m), in the wanted tool's axes."""
    turned = np.swapaxes(want[:, :3, :3], 1, 2)
    return np.concatenate([turned @ jacobian[:, :3], turned @ jacobian[:, 3:]], axis=1)


@dataclass(frozen=True, eq=False)
class Reach:
    """Effects of changes of a reference on the tool, sample by sample.

    Attributes:
        slopes: change of the tool in its axes by that of the reference, (T, 6, m).
        weights: of the tool's axes, (6,).
    """

    slopes: Array
    weights: Array

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array, Array]:
        """U (T, 6, k), inverse singular values with damping, shares of what is reached, and V^T (T, k, m)."""
        U, values, Vt = np.linalg.svd(self.weights[:, np.newaxis] * self.slopes, full_matrices=False)
        damping = DAMPING * np.maximum(values[:, :1], 1e-300)
        inverse = values / (values**2 + damping**2)
        return U, inverse, values * inverse, Vt

    def undoing(self, error: Array) -> Array:
        """Return changes of the reference, (T, m), that undo errors, (T, 6), by weighted and damped least squares."""
        U, inverse, _, Vt = self._parts
        along = np.einsum("tik,ti->tk", U, self.weights * error)
        return np.asarray(-np.einsum("tkj,tk->tj", Vt, inverse * along))

    def reached(self, error: Array) -> Array:
        """Return the weighted errors that changes of the reference can undo, (T, 6)."""
        U, _, shares, _ = self._parts
        along = np.einsum("tik,ti->tk", U, self.weights * error)
        return np.asarray(np.einsum("tik,tk->ti", U, shares * along))

    def beyond(self, error: Array) -> Array:
        """Return the errors, (T, 6), that no change of the reference undoes; 0 along axes without a weight."""
        left = self.weights * error - self.reached(error)
        return np.where(self.weights > 0.0, left / np.where(self.weights > 0.0, self.weights, 1.0), 0.0)

    @property
    def shares(self) -> Array:
        """The fraction of a small motion along each axis that cannot be undone, (6,), mean of all samples."""
        U, _, shares, _ = self._parts
        return np.asarray(1.0 - np.einsum("tik,tk,tik->ti", U, shares, U).mean(axis=0))

    @property
    def rank(self) -> tuple[int, int]:
        """The least and the greatest number of directions that can be corrected, of all samples."""
        numbers = (self._parts[2] > 0.5).sum(axis=1)
        return int(numbers.min()), int(numbers.max())
