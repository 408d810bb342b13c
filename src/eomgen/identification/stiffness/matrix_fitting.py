"""Equations of the coordinates of a joint whose matrices are looked for, and the matrices that come of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...arrays import Array
from ...robot.elements.matrices import entry_name
from ...robot.value import COORDINATES
from .least_squares import Solution, best_of
from .matrix_entries import Entry, MatrixNumbers
from .result import FittedEntry, FittedMatrix

_SEEN = 0.1  # of a direction's largest share, from which on its coordinates are named


def shares_of(entry: Entry, lag: float, rows: Sequence[str], moving: Sequence[str]) -> Array:
    """Return what forces an entry of 1 has in rows, by deviations and rates of coordinates, (rows, moving, 2)."""
    shares = np.zeros((len(rows), len(moving), 2))
    for row, by in entry.pairs:
        if row in rows and by in moving:
            place = shares[rows.index(row), moving.index(by)]
            place[entry.column] = 1.0
            if lag:
                place[1] = lag
    return shares


def fitted_matrices(
    entries: Sequence[tuple[int, Entry]],
    solutions: Sequence[Solution],
    numbers: MatrixNumbers,
    confidence: float,
    step: float,
) -> Iterator[FittedMatrix]:
    """Yield the matrices of entries, each with the place of its column in solutions, of which the best one counts."""
    if not entries:
        return
    best = best_of(solutions, [place for place, _ in entries])
    groups: dict[tuple[str, str, str], list[tuple[int, Entry]]] = {}
    for place, entry in entries:
        groups.setdefault((entry.owner, entry.joint, entry.key), []).append((place, entry))
    for (owner, joint, key), own in groups.items():
        known = [(place, entry) for place, entry in own if np.isfinite(best.values[place])]
        if not known:
            continue
        described = numbers.entries(owner, joint, key)
        names = _coordinates([entry for _, entry in known], described)
        values = np.vstack([best.values, best.replicates])[:, [place for place, _ in known]]
        stack = _stack(names, [entry for _, entry in known], values, _described(names, described))
        lowest = _lowest(stack)
        yield FittedMatrix(
            joint=joint,
            key=key,
            coordinates=names,
            entries=tuple(
                FittedEntry(entry.entry, best.estimate(place, confidence, numbers.described(entry), step))
                for place, entry in known
            ),
            matrix=tuple(map(tuple, stack[0].tolist())),
            open=tuple(entry.entry for place, entry in own if not np.isfinite(best.values[place])),
            taken_in=tuple(entry.one for _, entry in known if numbers.takes_in(entry)),
            lowest=float(lowest[0]),
            lowest_error=best.deviation_of(lowest[0], lowest[1:]),
            owner=owner,
        )


def _coordinates(entries: Sequence[Entry], described: Mapping[str, float]) -> tuple[str, ...]:
    """Return the coordinates of what is found and of what is described beside it."""
    found = {name for entry in entries for name in (entry.one, entry.other)}
    beside = {name for path in described for name in path.split(".")}
    return tuple(name for name in COORDINATES if name in found | beside)


def _described(names: Sequence[str], described: Mapping[str, float]) -> Array:
    """Return the matrix that is described, without tables of coordinates, (n, n)."""
    matrix = np.zeros((len(names), len(names)))
    for i, one in enumerate(names):
        for j, other in enumerate(names[i:], i):
            matrix[i, j] = matrix[j, i] = described.get(entry_name(one, other), 0.0)
    return matrix


def _stack(names: Sequence[str], entries: Sequence[Entry], values: Array, described: Array) -> Array:
    """Return matrices with the values of entries, (N, entries), in a described one, (N, n, n)."""
    stack: Array = np.broadcast_to(described, (len(values), *described.shape)).copy()
    for entry, column in zip(entries, values.T, strict=True):
        i, j = names.index(entry.one), names.index(entry.other)
        stack[:, i, j] = stack[:, j, i] = column
    return stack


def _lowest(stack: Array) -> Array:
    """Return the lowest eigenvalues of matrices scaled by their diagonals, (N,)."""
    return np.asarray(np.linalg.eigvalsh(_scaled(stack))[:, 0])


def _scaled(stack: Array) -> Array:
    diagonal = np.abs(np.diagonal(stack, axis1=1, axis2=2))
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return np.asarray(stack / (size[:, :, np.newaxis] * size[:, np.newaxis, :]))


def doubts_about(found: FittedMatrix) -> list[str]:
    """Return warnings about a fitted matrix."""
    doubts = []
    for entry in found.entries:
        estimate, (one, _, other) = entry.estimate, entry.entry.partition(".")
        if one == other and estimate.low <= 0.0 <= estimate.high:
            doubts.append(f"{found.name}.{entry.entry}: its interval holds zero, so the motion does not determine it")
    shares = [entry.estimate.unexplained for entry in found.entries]
    if max(shares) > 0.5:
        doubts.append(f"{found.name}: {100 * max(shares):.0f} % of the force stays unexplained")
    if not found.is_definite:
        matrix = _scaled(np.array([found.matrix]))[0]
        direction = np.abs(np.linalg.eigh(matrix)[1][:, 0])
        names = [x for x, share in zip(found.coordinates, direction, strict=True) if share >= _SEEN * direction.max()]
        within = abs(found.lowest) < 2.0 * found.lowest_error
        why = (
            "which noise may explain" if within else "which noise does not; is the drive known, and the inertia right?"
        )
        as_described = "; what is not determined counts as described" if found.open else ""
        doubts.append(
            f"{found.name} is not positive semidefinite, and no description takes it: a motion along"
            f" {' and '.join(names)} has a negative energy, the eigenvalue {found.lowest:.3g} of the matrix scaled by"
            f" its diagonal with a standard error of {found.lowest_error:.2g}, {why}{as_described}"
        )
    return doubts
