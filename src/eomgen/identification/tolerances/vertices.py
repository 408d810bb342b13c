"""Worst cases: the vertex of all bounds at which a tool is farthest off, to first order without a search.

Sums of s_i t_i S_i with signs s fill a zonotope.  The farthest point of it is a vertex, every vertex lies on an edge
along some S_i, of a facet that has another S_j: all of them are looked at, K^2 of K.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array

_FLAT = 1e-12  # of the greatest product: on the facet


def farthest(generators: Array) -> tuple[float, Array]:
    """Return the length of the longest sum of vectors with signs, (3, K), and the signs, (K,)."""
    size = np.linalg.norm(generators, axis=0)
    used = np.flatnonzero(size > 1e-15 * size.max(initial=0.0))
    signs = np.ones(generators.shape[1])
    if used.size == 0:
        return 0.0, signs
    chosen = generators[:, used] / size[used].max()
    best, vertex = -1.0, np.ones(used.size)
    for i in range(used.size):
        trial = _vertices_along(chosen, i)
        lengths = np.linalg.norm(trial @ chosen.T, axis=1)
        k = int(lengths.argmax())
        if lengths[k] > best * (1.0 + 1e-12):
            best, vertex = float(lengths[k]), trial[k]
    signs[used] = vertex
    return best * float(size[used].max()), signs


def _vertices_along(generators: Array, i: int) -> Array:
    """Return signs, (M, K), of the ends of all edges along vector i: one of each pair of opposite ones.

    By the facet's normal, then by the side of the edge in the facet, then by the end of the edge.
    """
    edge = generators[:, i]
    normals = np.cross(edge, generators.T)  # of the facets, (K, 3); zero of what is parallel
    length = np.linalg.norm(normals, axis=1)
    apart = length > _FLAT * np.linalg.norm(edge) * np.linalg.norm(generators, axis=0)
    if not apart.any():
        normals = _across(edge)[np.newaxis]
    else:
        normals = normals[apart] / length[apart, np.newaxis]
    length_of_edge = float(np.linalg.norm(edge))
    along = _sign(edge @ generators, length_of_edge)
    across = _sign(np.cross(normals, edge) @ generators, length_of_edge)
    facet = _sign(normals @ generators, 1.0)
    vertices = []
    for side in (1.0, -1.0):
        for end in (1.0, -1.0):
            inner = np.where(across != 0.0, side * across, np.where(along != 0.0, end * along, 1.0))
            vertices.append(np.where(facet != 0.0, facet, inner))
    return np.concatenate(vertices)


def _across(edge: Array) -> Array:
    other = np.cross(edge, np.eye(3)[int(np.abs(edge).argmin())])
    return np.asarray(other / np.linalg.norm(other))


def _sign(values: Array, size: float) -> Array:
    """Return signs of products of a vector of that size with generators, the greatest of length 1.

    Signs are 0 where the products are round-off.
    """
    return np.where(values > _FLAT * size, 1.0, np.where(values < -_FLAT * size, -1.0, 0.0))
