"""Answers of composed kernels: numbers that programs write, and identities between programs and answers.

The loops of composed kernels are those of the C library, which has further tests; a robot's build asks whether they
read what belongs to them.  Arrays have lanes behind their axes, those of an identity its states in front.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from eomgen.robot.model import Model

from ..c.contexts import OPEN_GAPS, PIVOT_LIMITS
from ..joint.zeros import zero_map
from ..kernels.blocks import row_blocks
from ..kernels.bodies import jacobian_columns
from ..kernels.constraint_rows import deriving_precision
from ..solve.rows import Precision
from .arithmetic import SAFETY, Array, spread
from .stored import MEASURED, UNITS, UNNAMED


class Identity(NamedTuple):
    """Equations matrix x = right, within ``near``, of the numbers x that stand at ``places``, (k, c), of an answer.

    matrix is (MEASURED, rows, k), right and near are (MEASURED, rows, c); near is infinite where nothing is said.
    """

    places: Array
    matrix: Array
    right: Array
    near: Array


class Answer(NamedTuple):
    """Numbers (., lanes) of an answer that are known, status (lanes,), places of the numbers; None: all there are.

    ``exact`` is False where the C library's sines may be other ones than those of samples.
    """

    known: Array
    status: Array
    places: Array | None = None
    identity: Identity | None = None
    exact: bool = True


Run = Callable[..., tuple[Array, Array]]  # run(program, **inputs): its answer, and the status of every lane
Composed = Callable[[Model, Run, Mapping[str, Array]], Answer]

_SINGULAR = 1e6  # condition from which rows of a chart tell nothing of what follows


def status_of(pivot: Array) -> Array:
    """Return the status (lanes,) of pivots and their scales (2 n, lanes): 0, or 1 + i of the first that vanishes."""
    limit = pivot.dtype.type(PIVOT_LIMITS[str(pivot.dtype)])
    failed = ~(pivot[::2] > limit * pivot[1::2])
    status: Array = np.where(failed.any(axis=0), 1 + failed.argmax(axis=0), 0)
    return status


def _measured(values: Array) -> tuple[Array, Array]:
    """Return values (MEASURED, ...) of states, and by how much rounding may change them, of values (..., lanes)."""
    states, near = values[..., :MEASURED], SAFETY * spread(values)
    return np.moveaxis(states, -1, 0).astype(np.float64), np.moveaxis(near, -1, 0).astype(np.float64)


def _identity(places: Array, matrix: Array, right: Array, near: Array) -> Identity:
    """Say nothing where rates are infinite."""
    said = np.isfinite(near) & np.isfinite(right) & np.isfinite(matrix).all(axis=-1, keepdims=True)
    return Identity(
        places.astype(np.int32),
        np.nan_to_num(matrix),
        np.nan_to_num(right),
        np.where(said, near, np.inf).astype(np.float32),
    )


def christoffel(model: Model, run: Run, inputs: Mapping[str, Array]) -> Answer:
    """Return some columns of the tensor: column k is the Coriolis matrix at unit velocity k, where it survives.

    Contracted with a velocity, the tensor lacks the round-off of the description that the Coriolis matrix has there.
    """
    n, q, survives, tensor = model.size, inputs["q"], zero_map(model).christoffel.mask, []
    columns = sorted({n // 2, n - 1})
    for k in columns:
        v = np.zeros_like(q)
        v[k] = 1.0
        C = run("coriolis_matrix", v=v)[0]
        tensor.append(np.where(survives[:, :, k].reshape(-1, 1), C, np.zeros_like(C)))
    places = np.concatenate([np.arange(k, n**3, n) for k in columns])
    return Answer(np.concatenate(tensor), np.zeros(q.shape[1], np.int64), places)


def forward_dynamics_jacobian(model: Model, run: Run, inputs: Mapping[str, Array], *, of_tree: bool = False) -> Answer:
    """Put derivatives of accelerations into the residual's, M da = -dr, and into those of constraints, J da = right.

    Where loops are closed M da + dr is what multipliers push, so what J pushes is taken away from these equations.
    """
    n, m, known = model.size, 0 if of_tree else len(model.constraints), list(model.prescribed)
    solution, status = run("constrained_dynamics" if m else "tree_forward_dynamics" if of_tree else "forward_dynamics")
    by_q, by_v, M = run("residual_jacobian", a=solution[:n])[0].reshape(3, n, n, -1).copy()
    J, right = np.zeros_like(M, shape=(m, *M.shape[1:])), np.zeros_like(M, shape=(m, 3, *M.shape[1:]))
    if m:
        D, at = run("closing_derivatives", a=solution[:n], multipliers=solution[n : n + m])[0], 0
        for block in row_blocks(model):
            rows, columns = slice(block.first, block.first + block.rows), list(block.columns)
            parts = np.split(D[at : at + 3 * block.size], 3)
            J[rows, columns], *slopes = (block_rows.reshape(block.rows, len(columns), -1) for block_rows in parts)
            right[rows, :2, columns] = -np.stack(slopes, axis=1)
            at += 3 * block.size + len(columns) ** 2
            by_q[np.ix_(columns, columns)] -= D[at - len(columns) ** 2 : at].reshape(len(columns), len(columns), -1)
        status = _with_residuals(model, solution[n + m :], status, inputs["v"])
    by_u = np.broadcast_to(np.eye(n, dtype=M.dtype)[..., np.newaxis], M.shape)
    if model.beside:
        driven = run("drive_jacobian")[0].reshape(3, n, n, -1)
        by_q, by_v, by_u = by_q - driven[0], by_v - driven[1], by_u.copy()
        by_u[:, list(model.states_of_drives)] = 0.0
        for i, place in model.beside.items():
            by_u[i, place], by_u[:, i] = 1.0, driven[2, :, i]
    B = np.concatenate([-by_q, -by_v, by_u], axis=1)
    B[known, : 2 * n], M[known], M[known, known] = 0.0, 0.0, 1.0
    moving = [i for i in range(n) if i not in known]
    lost = ~np.isfinite(M[np.ix_(moving, moving)]).all(axis=(0, 1)) & ((status == 0) | (status > n))
    status = np.where(lost, UNNAMED, status)  # a pivot of M is no number
    regular = np.linalg.slogdet(np.moveaxis(M, -1, 0).astype(np.float64))[0] != 0.0
    answered = (((status == 0) | (status > n)) & regular)[:MEASURED]
    places = np.arange(3 * n * n).reshape(3, n, n).transpose(1, 0, 2).reshape(n, 3 * n)
    matrix, right, near = _constrained_system(model, (M, B, J, right.reshape(m, *B.shape[1:])), answered)
    near = np.where(answered[:, np.newaxis, np.newaxis], near, np.inf)
    identity = _identity(places, matrix, right, near)
    return Answer(np.zeros((0, M.shape[-1]), M.dtype), status, np.zeros(0, np.int64), identity)


def _constrained_system(
    model: Model, equations: tuple[Array, Array, Array, Array], answered: Array
) -> tuple[Array, Array, Array]:
    """Return matrix, right sides and round-off of M x = B, freed of what J pushes, and J x = right below it."""
    dtype = equations[0].dtype
    (M, near_M), (B, near_B), (J, near_J), (right, near_right) = map(_measured, equations)
    unit, double = (UNITS * M.shape[1] * float(np.finfo(x).eps) for x in (dtype, np.float64))
    M = np.where(answered[:, np.newaxis, np.newaxis], M, np.eye(M.shape[1]))
    diagonal = np.sqrt(np.abs(np.einsum("sii->si", M)))
    near_M += unit * (np.abs(M) + diagonal[:, :, np.newaxis] * diagonal[:, np.newaxis])
    x = np.linalg.solve(M, B)
    if not J.shape[1]:
        return M, B, near_M @ np.abs(x) + near_B
    pushed = np.nan_to_num(J)
    pushed[..., list(model.prescribed)] = 0.0
    Y = np.linalg.solve(M, pushed.swapaxes(1, 2))
    precision = deriving_precision(model, int((pushed != 0.0).any(axis=(0, 2)).sum()), str(dtype))
    multipliers, rest, share, norm = _multipliers(model, J @ Y, right - J @ x, precision)
    size = np.abs(x) + np.abs(Y) @ multipliers
    near_B += near_M @ size + near_J.swapaxes(1, 2) @ multipliers
    near_right += (near_J + unit * np.abs(J)) @ size + unit * norm * multipliers.max(axis=1, keepdims=True)
    near_right += share @ (np.abs(Y).swapaxes(1, 2) @ near_B + near_right)
    _, singular, rows = np.linalg.svd(pushed, full_matrices=False)
    rows = rows * (singular > M.shape[1] * np.finfo(dtype).eps * singular[:, :1])[..., np.newaxis]
    free = np.eye(M.shape[1]) - rows.swapaxes(1, 2) @ rows
    near_B = np.abs(free) @ near_B + double * (np.abs(M) @ size + np.abs(B)).sum(axis=1, keepdims=True)
    near_B += double * singular[:, :1, np.newaxis] * multipliers.max(axis=1, keepdims=True)  # what J pushes beside free
    matrix, near = np.concatenate([free @ M, J], axis=1), np.concatenate([near_B, near_right], axis=1)
    return matrix, np.concatenate([free @ B, right - rest], axis=1), near


def _multipliers(model: Model, A: Array, rest: Array, precision: Precision) -> tuple[Array, Array, Array, Array]:
    """Return sizes of multipliers that meet A x = rest, and what is left of it where rows are redundant.

    The library factors A with a little of its diagonal more, and each solution leaves that times the multipliers.
    Beside both come the share that it leaves of a change of rest, and the norm of what is factored.
    """
    kinds = [kind for block in row_blocks(model) for kind in block.kinds]
    same = np.array([[precision.floor + precision.added * (a == b) for b in kinds] for a in kinds])
    added = np.einsum("rt,stt->sr", same, A)[..., np.newaxis]
    added = np.where(added > 0.0, added, 1.0)
    factored = A + added * np.eye(len(kinds))
    size = np.zeros_like(rest)
    for _ in range(precision.refinements + 1):
        change = np.linalg.solve(factored, rest)
        size, rest = size + np.abs(change), added * change
    return size, rest, np.abs(added * np.linalg.inv(factored)), np.linalg.norm(factored, axis=(1, 2), keepdims=True)


def _constrained(model: Model, run: Run, inputs: Mapping[str, Array], *, forces: bool) -> Answer:
    """Return accelerations or multipliers with the loops closed, and whether they are."""
    solution, status = run("constrained_dynamics")
    a, multipliers, residuals = np.split(solution, [model.size, model.size + len(model.constraints)])
    return Answer(multipliers if forces else a, _with_residuals(model, residuals, status, inputs["v"]))


def dependent_coordinates(model: Model, run: Run, inputs: Mapping[str, Array]) -> Answer:
    """Put velocities, accelerations and slopes into J v = 0, J a = -bias and J dq = 0; Newton's method takes no step.

    What does not follow is as in the inputs; coordinates that do begin along the chart's slopes.
    """
    n, m, (q, v, a, chart) = model.size, len(model.constraints), (inputs[x].copy() for x in ("q", "v", "a", "chart"))
    bound, rows = (np.flatnonzero(marks[:, 0] == 1.0).tolist() for marks in (chart[:n], chart[n : n + m]))
    free, rank = [i for i in range(n) if i not in bound], len(bound)
    last, *slopes = chart[n + m + 1 :].reshape(m + 1, n, -1)
    for i, slope in zip(bound, slopes, strict=False):
        for k in range(n):
            q[i] = q[i] + slope[k] * (inputs["q"][k] - last[k])
    g, J = run("constraint", q=q)[0], run("constraint_jacobian", q=q)[0].reshape(m, n, -1)[rows].astype(np.float64)
    inverse = np.linalg.pinv(np.nan_to_num(np.moveaxis(J[:, bound], -1, 0)))
    v[bound] = -np.einsum("lrs,sil,il->rl", inverse, J[:, free], v[free])
    bias, others = run("constraint_bias", q=q, v=v)[0][rows], J.copy()
    others[:, bound] = 0.0
    terms = np.stack([others * v, others * a], axis=1)  # of J v and J a without what is bound
    right = np.concatenate([terms.sum(axis=2), others], axis=1)
    right[:, 1] += bias
    (jacobian, near_jacobian), (right, near) = _measured(J[:, bound]), _measured(-right)
    size = np.abs(right) + _measured(np.abs(terms).sum(axis=(1, 2)))[0][..., np.newaxis]
    far = np.abs(inverse[:MEASURED]) @ size
    condition = (np.linalg.cond(jacobian) if rank else np.ones(MEASURED))[:, np.newaxis, np.newaxis]
    unit = UNITS * n * float(np.finfo(q.dtype).eps) * np.abs(jacobian).sum(axis=(1, 2), keepdims=True)
    near = near + near_jacobian @ far + unit * condition * far.max(axis=1, initial=0.0, keepdims=True)
    near = np.where(condition < _SINGULAR, near, np.inf)
    out = np.arange((3 + m) * n + m)
    moved = out[: 3 * n].reshape(3, n, 1)
    places = np.concatenate([*moved[1:, bound], out[3 * n : (3 + rank) * n].reshape(rank, n)], axis=1)
    known = np.concatenate([q, v[free], a[free], np.zeros(((m - rank) * n, q.shape[1]), q.dtype), g])
    at = np.concatenate([moved[0, :, 0], *moved[1:, free, 0], out[(3 + rank) * n :]])
    return Answer(known, np.zeros(q.shape[1], np.int64), at, _identity(places, jacobian, right, near), exact=False)


def _with_residuals(model: Model, residuals: Array, status: Array, v: Array) -> Array:
    """Add to a status (lanes,) that of closure residuals and their rates (2 m, lanes)."""
    still = np.ones((len(model.constraints), v.shape[1]), residuals.dtype)
    return _first(status, 1 + model.size, residuals, np.concatenate([still, still * _largest(v)]))


def _largest(*arrays: Array) -> Array:
    """Return the largest size of numbers (., lanes), at least 1, (lanes,); NaN does not count."""
    sizes = np.abs(np.concatenate(arrays))
    largest: Array = np.where(sizes > 1.0, sizes, sizes.dtype.type(1.0)).max(axis=0)
    return largest


def _first(status: Array, reason: int, values: Array, scale: Array) -> Array:
    """Return the status (lanes,), or where it is 0 that of the first value (., lanes) beyond round-off."""
    beyond = ~(np.abs(values) <= scale * values.dtype.type(OPEN_GAPS[str(values.dtype)]))
    statuses: Array = np.where(status != 0, status, np.where(beyond.any(axis=0), reason + beyond.argmax(axis=0), 0))
    return statuses


def _driven(
    of: Callable[[Run, Array, Array], Array], model: Model, run: Run, inputs: Mapping[str, Array], *, loaded: bool
) -> Answer:
    """Answer with drives and multipliers of constrained_drives, and say whether these drives make the motion."""
    n, m = model.size, len(model.constraints)
    solution = run("constrained_drives", **({} if loaded else {"u": np.zeros_like(inputs["u"])}))[0]
    u, multipliers, residuals, pull, bias, left, needed = np.split(solution, np.cumsum([n, m, 2 * m, m, m, n]))
    status = _with_residuals(model, residuals, np.zeros(solution.shape[1], np.int64), inputs["v"])
    status = _first(status, 1 + n + 2 * m, pull + bias, _largest(inputs["a"], bias))
    return Answer(of(run, u, multipliers), _first(status, 1 + n + 3 * m, left, _largest(needed)))


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
    "following": dependent_coordinates,
    "forward_dynamics": partial(_constrained, forces=False),
    "forward_dynamics_jacobian": forward_dynamics_jacobian,
    "tree_forward_dynamics_jacobian": partial(forward_dynamics_jacobian, of_tree=True),
    **{name: partial(_driven, of, loaded=False) for name, of in DRIVEN.items()},
    **{f"{name}_under_load": partial(_driven, of, loaded=True) for name, of in DRIVEN.items()},
}


def _frame_pose(model: Model, k: Array, frame: int) -> Array:
    """Return the pose (16, lanes) of a frame from what the program of frames writes."""
    last = np.zeros((4, k.shape[1]), k.dtype)
    last[3] = 1.0
    return np.concatenate([k[12 * frame : 12 * frame + 12], last])


def _frame_jacobian(model: Model, k: Array, frame: int) -> Array:
    """Return the Jacobian (6 n, lanes) of a frame from what the program of frames writes."""
    out = np.zeros((6, model.size, k.shape[1]), k.dtype)
    for s, column in jacobian_columns(model, k, frame).items():
        for i, entry in enumerate(column):
            out[i, s] = entry
    return out.reshape(6 * model.size, -1)


FRAMED: Mapping[str, Callable[[Model, Array, int], Array]] = {
    "frame_pose": _frame_pose,
    "frame_jacobian": _frame_jacobian,
}
