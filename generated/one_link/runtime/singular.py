"""Coordinates at which a mass matrix is singular."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .raw import Array

VANISHED = 1e-11  # of the largest inertia, in units of each coordinate: round-off
NEARLY = 1e-4  # the same in single precision
NO_SIZE = 1e-14  # of the largest inertia: what a coordinate without any counts with
SMALL = 1e-4  # of the largest inertia: coordinates with less weigh alike where null vectors are looked at
SHARE = 0.1  # of a null vector's largest component: smaller ones are not named
UPRIGHT = 1e-5  # cosine of an angle beta that is at +-pi/2
ADVICE = (
    "give links mass and inertia, or the coordinate an armature, or merge a link without mass with its parent; where a"
    " spring or damper moves it, rollouts with method='implicit' do without"
)


def inertias(M: Array, least: float = NO_SIZE) -> Array:
    """Return each coordinate's inertia, (..., m), at least that fraction of the largest one."""
    inertia = np.asarray(np.diagonal(M, axis1=-2, axis2=-1), dtype=np.float64)
    largest = inertia.max(axis=-1, initial=0.0, keepdims=True)
    return np.asarray(np.maximum(inertia, np.maximum(least * largest, 1e-300)))


def scaled_eigenvalues(M: Array) -> tuple[Array, Array]:
    """Return eigenvalues and eigenvectors of a mass matrix, (m, m), scaled so that kilograms and kg m^2 compare."""
    size = np.sqrt(inertias(M))
    values, vectors = np.linalg.eigh(np.asarray(M, dtype=np.float64) / np.outer(size, size))
    return values, vectors


def null_coordinates(M: Array, names: Sequence[str], limit: float = VANISHED) -> tuple[str, ...]:
    """Return names of the coordinates that can move so that M v = 0, or nearly so: the components of its null vectors.

    Args:
        M: a mass matrix, (m, m).
        limit: scaled eigenvalues below it are zero; the smallest one always is.
    """
    values, vectors = scaled_eigenvalues(M)
    null = vectors[:, values <= max(limit, values[0])] / np.sqrt(inertias(M))[:, np.newaxis]
    null *= np.sqrt(inertias(M, SMALL))[:, np.newaxis]  # a component counts, though its inertia is small
    parts = np.linalg.norm(null / np.linalg.norm(null, axis=0), axis=1)
    return tuple(name for name, share in zip(names, parts, strict=True) if share > SHARE * parts.max())


def singular_place(coordinates: Sequence[str], q: Array, names: Sequence[str]) -> tuple[str, str]:
    """Return names of the coordinates where a mass matrix cannot be inverted, for people, and the reason.

    Args:
        coordinates: ``null_coordinates``, or what stands for them.
        q: coordinates in that state, (n,), m or rad.
    """
    values = dict(zip(names, q.tolist(), strict=True))
    for name in coordinates:
        joint, _, kind = name.rpartition(".")
        alpha, beta, gamma = (f"{joint}.{angle}" for angle in ("alpha", "beta", "gamma"))
        turns = kind in ("alpha", "beta", "gamma") and {alpha, beta, gamma} <= values.keys()
        if turns and abs(np.cos(values[beta])) < UPRIGHT:
            return (
                f"{alpha} and {gamma}",
                f"{beta} is at +-pi/2, where Euler angles are singular: both turn about one axis",
            )
    return " and ".join(coordinates), f"what they move has no inertia along that motion; {ADVICE}"
