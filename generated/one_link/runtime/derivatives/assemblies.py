"""How far assembled states of a closed mechanism are from exact ones.

In a box about q of radii rho the constraint g has one zero, of coordinates that depend on the others, if
|R g(q)| + |1 - R J| rho <= rho with J over the box and an approximate inverse R of J(q).

Source: R. Krawczyk, "Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken", Computing 4, 1969; J over
a box is bounded as running errors are, from radii of the coordinates on.
"""

from __future__ import annotations

import numpy as np

from ..calls import Calls
from ..raw import Array
from .equations_of_motion import moved_rows
from .extended import AROUND, EPS, IN_EXTENDED, run_extended
from .solution_errors import DEPENDENT, SolutionErrors

TRIES = 4  # of radii, each larger than the last one


def assembled_errors(calls: Calls, q: Array, free: Array) -> SolutionErrors:
    """Bound how far states, (N, n), are from exactly assembled ones, in which other than dependent coordinates stay.

    Args:
        free: which coordinates may differ, (n,).
    """
    moving = [int(i) for i in np.flatnonzero(free)]
    rows = moved_rows(calls, q[0], moving) if len(q) else []
    J = calls.run("constraint_jacobian", None, (q,)).astype(np.float64)[:, rows]
    bound, proved = np.zeros(q.shape), np.zeros(len(q), np.bool_)
    g, of_g = run_extended(calls, f"constraint{IN_EXTENDED}", (q,)).at(slice(None), rows).rounded
    for state in range(len(q)):
        dependent = _dependent(J[state], moving)
        if len(dependent) < len(rows):
            near = np.abs(np.linalg.pinv(J[state][:, moving], rcond=DEPENDENT)) @ (np.abs(g[state]) + of_g[state])
            bound[state, moving] = near
            continue
        radii = _enclosed(calls, q[state], (g[state], of_g[state]), rows, dependent)
        if radii is None:
            bound[state] = np.inf
            continue
        bound[state, dependent], proved[state] = radii, True
    return SolutionErrors(bound, proved)


def _enclosed(
    calls: Calls, q: Array, residual: tuple[Array, Array], rows: list[int], dependent: list[int]
) -> Array | None:
    """Return radii about q in which there is one zero of the constraint, (dependent,); None if none is proved."""
    J = calls.run("constraint_jacobian", None, (q,)).astype(np.float64)[np.ix_(rows, dependent)]
    try:
        R = np.linalg.inv(J)
    except np.linalg.LinAlgError:
        return None
    size, terms = np.abs(R), len(rows) + 3
    g, of_g = residual
    step = (np.abs(R @ g) + size @ (of_g + 2.0 * terms * EPS * np.abs(g))) * (1.0 + terms * EPS)
    radii = 2.0 * step + 0.01 * step.max(initial=0.0) + float(np.finfo(calls.dtype).tiny)
    for _ in range(TRIES):
        box = np.zeros(calls.n, calls.dtype)
        box[dependent] = np.nextafter(radii.astype(calls.dtype), np.asarray(np.inf, calls.dtype))
        value, error = run_extended(calls, f"constraint_jacobian{AROUND}", (q, box)).rounded
        value, error = value[np.ix_(rows, dependent)], error[np.ix_(rows, dependent)]
        one = np.eye(len(rows))
        off = np.abs(one - R @ value) + size @ error + terms * EPS * (size @ np.abs(value) + one)
        reached = (step + off @ box[dependent].astype(np.float64)) * (1.0 + terms * EPS)
        if (reached <= box[dependent]).all():
            return np.asarray(reached)
        radii = 2.0 * reached
    return None


def _dependent(J: Array, moving: list[int]) -> list[int]:
    """Choose as many of the moving columns of J, (rows, n), as are independent, those of most size first."""
    left, chosen = J[:, moving].copy(), list[int]()
    largest = np.linalg.norm(left, axis=0).max(initial=0.0)
    while len(chosen) < len(J):
        sizes = np.linalg.norm(left, axis=0)
        best = int(sizes.argmax()) if sizes.size else 0
        if not sizes.size or not sizes[best] > DEPENDENT * largest:
            break
        chosen.append(moving[best])
        direction = left[:, best] / sizes[best]
        left = left - np.outer(direction, direction @ left)
        left[:, best] = 0.0
    return chosen
