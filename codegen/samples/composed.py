"""Answers of kernels that are templates of their own, step by step as ``templates/composed`` has them.

Arrays have lanes behind their own axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from eomgen.robot.model import Model

from ..c.contexts import OPEN_GAPS, PIVOT_LIMITS
from ..joint.zeros import zero_map
from ..kernels.blocks import row_blocks
from ..kernels.bodies import jacobian_columns
from ..kernels.constraint_rows import deriving_precision
from ..solve.factorised import coordinates_in_front
from ..solve.rows import Precision
from .arithmetic import Array

Run = Callable[..., tuple[Array, Array]]  # run(program, **inputs): its answer, and the status of every lane
Composed = Callable[[Model, Run, Mapping[str, Array]], tuple[Array, Array]]


def status_of(pivot: Array) -> Array:
    """Status (lanes,) of pivots and their scales (2 n, lanes): 0, or 1 + i of the first that vanishes."""
    limit = pivot.dtype.type(PIVOT_LIMITS[str(pivot.dtype)])
    failed = ~(pivot[::2] > limit * pivot[1::2])
    found: Array = np.where(failed.any(axis=0), 1 + failed.argmax(axis=0), 0)
    return found


def christoffel(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Some columns of the tensor: column k is the Coriolis matrix at the unit velocity k."""
    lanes, survives, columns = inputs["q"].shape[1], zero_map(model).christoffel.mask, _columns(model)
    q = np.tile(inputs["q"], len(columns))
    v = np.zeros_like(q)
    for place, k in enumerate(columns):
        v[k, place * lanes : (place + 1) * lanes] = 1.0
    matrices = np.split(run("coriolis_matrix", q=q, v=v)[0], len(columns), axis=1)
    masks = [survives[:, :, k].reshape(-1, 1) for k in columns]
    found = [np.where(mask, x, np.zeros_like(x)) for mask, x in zip(masks, matrices, strict=True)]
    return np.concatenate(found), np.zeros(lanes, np.int64)


def _columns(model: Model) -> list[int]:
    return sorted({0, model.size // 2, model.size - 1})


def christoffel_places(model: Model) -> Array:
    """Places of the tensor's entries that are sampled; a loop in C writes them all."""
    return np.concatenate([np.arange(k, model.size**3, model.size) for k in _columns(model)])


def forward_dynamics_jacobian(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Derivatives of the accelerations: those of the residual, solved with M = L^T D L along the branches."""
    return _closed_derivatives(model, run, inputs) if model.constraints else _of_tree(model, run, "forward_dynamics")


def _of_tree(model: Model, run: Run, accelerations: str) -> tuple[Array, Array]:
    a, status = run(accelerations)
    out, _, own = _solved(model, run("residual_jacobian", a=a)[0].reshape(3, model.size, model.size, -1).copy())
    return out.reshape(-1, a.shape[1]), np.where(status != 0, status, own)


def _closed_derivatives(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """With the loops closed: changes of the multipliers make up for what the tree alone would open."""
    n, m, (_, lanes) = model.size, len(model.constraints), inputs["q"].shape
    found, status = run("constrained_dynamics")
    a, multipliers = found[:n], found[n : n + m]
    out: Array = run("residual_jacobian", a=a)[0].reshape(3, n, n, lanes).copy()
    D = run("closing_derivatives", a=a, multipliers=multipliers)[0]
    J = np.zeros_like(D, shape=(m, n, lanes))
    right = np.zeros_like(D, shape=(m, 3, n, lanes))
    at = 0
    for block in row_blocks(model):
        rows, columns = slice(block.first, block.first + block.rows), list(block.columns)
        parts = np.split(D[at : at + 3 * block.size], 3)
        J[rows, columns], *slopes = (part.reshape(block.rows, len(columns), lanes) for part in parts)
        for matrix, slope in enumerate(slopes):
            right[rows, matrix, columns] = -slope
        at += 3 * block.size
        second = D[at : at + len(columns) ** 2].reshape(len(columns), len(columns), lanes)
        out[0][np.ix_(columns, columns)] = out[0][np.ix_(columns, columns)] - second
        at += len(columns) ** 2
    out, back, own = _solved(model, out)
    x: Array = out.transpose(1, 0, 2, 3).reshape(n, 3 * n, lanes)
    pushed = J.copy()
    pushed[:, list(model.prescribed)] = 0.0
    kinds = [kind for block in row_blocks(model) for kind in block.kinds]
    kept = [r for r, row in enumerate(pushed) if (row != 0.0).any()]
    J, pushed, right = J[kept], pushed[kept], right[kept]
    Y = back(pushed.transpose(1, 0, 2).copy())
    right = right.reshape(len(kept), 3 * n, lanes)
    moved = [block.columns for block in row_blocks(model) for _ in range(block.rows)]
    for r, row in enumerate(kept):
        for i in moved[row]:
            right[r] = right[r] - J[r, i] * x[i]
    A = np.zeros_like(D, shape=(len(kept), len(kept), lanes))
    for r, row in enumerate(kept):
        for i in moved[row]:
            A[r] = A[r] + J[r, i] * Y[i]
    upper = np.triu_indices(len(kept), 1)
    A[upper] = A[upper[::-1]]
    precision = deriving_precision(model, len(kept), str(A.dtype))
    change = _multipliers(A, right, [kinds[r] for r in kept], precision)
    for r in range(len(kept)):
        x = x + Y[:, r, np.newaxis] * change[r]
    out = x.reshape(n, 3, n, lanes).transpose(1, 0, 2, 3)
    status = np.where(status != 0, status, own)
    return out.reshape(-1, lanes), _with_gaps(model, found[n + m :], status, inputs["v"])


def _multipliers(A: Array, right: Array, kinds: Sequence[object], precision: Precision) -> Array:
    """Solution (m, columns, lanes) of a symmetric system (m, m, lanes) that may be singular, refined."""
    m = len(A)
    added: dict[object, Array] = {}
    whole = zero = np.zeros_like(A[0, 0])
    for r in range(m):
        whole = whole + A[r, r]
        added[kinds[r]] = added.get(kinds[r], zero) + A[r, r]
    F = A.copy()
    for r in range(m):
        own = added[kinds[r]] * A.dtype.type(precision.added)
        F[r, r] = F[r, r] + (own + whole * A.dtype.type(precision.floor))
    for r in range(m):
        for s in range(r + 1, m):
            factor = F[s, r] / F[r, r]
            for t in range(r + 1, s + 1):
                F[s, t] = F[s, t] - factor * F[t, r]
    change = np.zeros_like(right)
    for step in range(precision.refinements + 1):
        rest = right.copy()
        for s in range(m if step else 0):
            rest = rest - A[:, s, np.newaxis] * change[s]
        for r in range(m):
            for s in range(r):
                rest[r] = rest[r] - F[r, s] * rest[s]
            rest[r] = rest[r] / F[r, r]
        for r in reversed(range(m)):
            total = np.zeros_like(rest[r])
            for s in range(r + 1, m):
                total = total + F[s, r] * rest[s]
            rest[r] = rest[r] - total / F[r, r]
            change[r] = change[r] + rest[r]
    return change


def _solved(model: Model, out: Array) -> tuple[Array, Callable[[Array], Array], Array]:
    """Derivatives by those of the residual (3, n, n, lanes), what solves with M for more, and the pivots' status."""
    n, lanes = model.size, out.shape[-1]
    M, known = out[2].copy(), list(model.prescribed)
    out[:2, known] = 0.0
    M[known], M[:, known] = 0.0, 0.0
    M[known, known] = 1.0
    scale, chains = M[range(n), range(n)].copy(), coordinates_in_front(model)
    for k in reversed(range(n)):
        for place, i in enumerate(chains[k]):
            factor = M[k, i] / M[k, k]
            for j in chains[k][place:]:
                M[i, j] = M[i, j] - factor * M[k, j]
            M[k, i] = factor
    pivot = M[range(n), range(n)]
    by_u = np.zeros_like(M)
    by_u[:, known] = -out[2][:, known]
    by_u[known] = 0.0
    by_u[range(n), range(n)] = 1.0

    def back(x: Array) -> Array:
        for k in reversed(range(n)):
            for i in chains[k]:
                x[i] = x[i] - M[k, i] * x[k]
        for k in range(n):
            x[k] = x[k] / pivot[k]
            for i in chains[k]:
                x[k] = x[k] - M[k, i] * x[i]
        return x

    out = np.stack([back(x) for x in (-out[0], -out[1], by_u)])
    return out, back, status_of(np.stack([pivot, scale], axis=1).reshape(2 * n, lanes))


def _constrained(model: Model, run: Run, inputs: Mapping[str, Array], *, forces: bool) -> tuple[Array, Array]:
    """Accelerations or multipliers with the loops closed, and whether they are."""
    found, status = run("constrained_dynamics")
    a, multipliers, gaps = np.split(found, [model.size, model.size + len(model.constraints)])
    return multipliers if forces else a, _with_gaps(model, gaps, status, inputs["v"])


def following(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Rates and accelerations that follow along the loops, where a chart allows no step of Newton's method."""
    n, m, (q, v, a, chart) = model.size, len(model.constraints), (inputs[x].copy() for x in ("q", "v", "a", "chart"))
    bound, rows = (np.flatnonzero(marks[:, 0] == 1.0).tolist() for marks in (chart[:n], chart[n : n + m]))
    last = chart[n + m + 1 :].reshape(m + 1, n, -1)
    moved = {p: q[i].copy() for p, i in enumerate(bound)}
    for p in moved:
        for i in range(n):
            moved[p] = moved[p] + last[p + 1, i] * (q[i] - last[0, i])
    for p, i in enumerate(bound):
        q[i] = moved[p]
    g, J = run("constraint", q=q)[0], run("constraint_jacobian", q=q)[0].reshape(m, n, -1)
    J, order = _inverted(J[rows], bound)
    others = [i for i in range(n) if i not in bound]
    for p, k in enumerate(bound):
        v[k] = 0.0
        for i in others:
            v[k] = v[k] - J[p, i] * inputs["v"][i]
    bias = run("constraint_bias", q=q, v=v)[0]
    for p, k in enumerate(bound):
        a[k] = 0.0
        for s, i in enumerate(bound):
            a[k] = a[k] - J[p, i] * np.choose(order[s], bias[rows])
        for i in others:
            a[k] = a[k] - J[p, i] * inputs["a"][i]
    slopes = np.zeros((m, n, q.shape[1]), q.dtype)
    slopes[: len(rows), others] = 0.0 - J[:, others]
    return np.concatenate([q, v, a, slopes.reshape(m * n, -1), g]), np.zeros(q.shape[1], np.int64)


def _inverted(J: Array, bound: Sequence[int]) -> tuple[Array, Array]:
    """J (k, n, lanes) with some columns' inverse in these and its product with the others, and the order of its rows.

    The columns of the inverse are those of the rows in that order, (k, lanes).
    """
    J, lanes = J.copy(), np.arange(J.shape[2])
    order = np.tile(np.arange(len(bound))[:, np.newaxis], len(lanes))
    for p, column in enumerate(bound):
        best = np.full(len(lanes), p)
        for r in range(p + 1, len(bound)):
            best = np.where(np.abs(J[r, column]) > np.abs(J[best, column, lanes]), r, best)
        for x in (J.transpose(0, 2, 1), order):
            first = x[p].copy()
            x[p], x[best, lanes] = x[best, lanes], first
        pivot = J[p, column].copy()
        J[p, column] = 1.0
        J[p] = J[p] / pivot
        for r in range(len(bound)):
            factor = J[r, column].copy()
            J[r, column] = np.where((r == p) | (factor == 0.0), factor, 0.0)
            J[r] = np.where((r == p) | (factor == 0.0), J[r], J[r] - factor * J[p])
    return J, order


def _with_gaps(model: Model, gaps: Array, status: Array, v: Array) -> Array:
    """The status (lanes,) with that of gaps and their rates (2 m, lanes)."""
    still = np.ones((len(model.constraints), v.shape[1]), gaps.dtype)
    return _first(status, 1 + model.size, gaps, np.concatenate([still, still * _largest(v)]))


def _largest(*arrays: Array) -> Array:
    """The largest size of numbers (., lanes), at least 1, (lanes,); NaN does not count."""
    sizes = np.abs(np.concatenate(arrays))
    found: Array = np.where(sizes > 1.0, sizes, sizes.dtype.type(1.0)).max(axis=0)
    return found


def _first(status: Array, reason: int, values: Array, scale: Array) -> Array:
    """The status (lanes,), or where it is 0 that of the first value (., lanes) that is more than round-off."""
    beyond = ~(np.abs(values) <= scale * values.dtype.type(OPEN_GAPS[str(values.dtype)]))
    found: Array = np.where(status != 0, status, np.where(beyond.any(axis=0), reason + beyond.argmax(axis=0), 0))
    return found


def _driven(
    of: Callable[[Run, Array, Array], Array], model: Model, run: Run, inputs: Mapping[str, Array], *, loaded: bool
) -> tuple[Array, Array]:
    """Answer with drives and multipliers of constrained_drives, and say whether these drives make the motion."""
    n, m = model.size, len(model.constraints)
    found = run("constrained_drives", **({} if loaded else {"u": np.zeros_like(inputs["u"])}))[0]
    u, multipliers, gaps, pull, bias, left, needed = np.split(found, np.cumsum([n, m, 2 * m, m, m, n]))
    status = _with_gaps(model, gaps, np.zeros(found.shape[1], np.int64), inputs["v"])
    status = _first(status, 1 + n + 2 * m, pull + bias, _largest(inputs["a"], bias))
    return of(run, u, multipliers), _first(status, 1 + n + 3 * m, left, _largest(needed))


def _reactions(run: Run, u: Array, multipliers: Array) -> Array:
    return np.asarray(run("tree_reactions")[0] + run("closing_reactions", multipliers=multipliers)[0])


DRIVEN: Mapping[str, Callable[[Run, Array, Array], Array]] = {
    "inverse_dynamics": lambda run, u, multipliers: u,
    "reactions": _reactions,
    "loop_reactions": lambda run, u, multipliers: run("loop_wrenches", multipliers=multipliers)[0],
}


COMPOSED: Mapping[str, Composed] = {
    "christoffel": christoffel,
    "constraint_forces": partial(_constrained, forces=True),
    "following": following,
    "forward_dynamics": partial(_constrained, forces=False),
    "forward_dynamics_jacobian": forward_dynamics_jacobian,
    "tree_forward_dynamics_jacobian": lambda model, run, _: _of_tree(model, run, "tree_forward_dynamics"),
    **{name: partial(_driven, of, loaded=False) for name, of in DRIVEN.items()},
    **{f"{name}_under_load": partial(_driven, of, loaded=True) for name, of in DRIVEN.items()},
}
PLACES: Mapping[str, Callable[[Model], Array]] = {"christoffel": christoffel_places}  # of answers that are not whole


def _frame_pose(model: Model, k: Array, frame: int) -> Array:
    """Pose (16, lanes) of a frame from what the program of frames writes."""
    last = np.zeros((4, k.shape[1]), k.dtype)
    last[3] = 1.0
    return np.concatenate([k[12 * frame : 12 * frame + 12], last])


def _frame_jacobian(model: Model, k: Array, frame: int) -> Array:
    """Jacobian (6 n, lanes) of a frame from what the program of frames writes."""
    out = np.zeros((6, model.size, k.shape[1]), k.dtype)
    for s, column in jacobian_columns(model, k, frame).items():
        for i, entry in enumerate(column):
            out[i, s] = entry
    return out.reshape(6 * model.size, -1)


FRAMED: Mapping[str, Callable[[Model, Array, int], Array]] = {
    "frame_pose": _frame_pose,
    "frame_jacobian": _frame_jacobian,
}
