"""Answers of kernels that are templates of their own, step by step as ``templates/composed`` has them.

Arrays have lanes behind their own axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from eomgen.robot.model import Model

from ..c.contexts import OPEN_GAPS, PIVOT_LIMITS
from ..joint.zeros import zero_map
from ..solve.factorised import coordinate_parents
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


def christoffel_places(model: Model) -> Array:
    """Places of the tensor's entries that are sampled; a loop in C writes them all."""
    places = np.arange(model.size**3).reshape((model.size,) * 3)
    return np.concatenate([places[:, :, k].ravel() for k in _columns(model)])


def _columns(model: Model) -> list[int]:
    return sorted({0, model.size // 2, model.size - 1})


def forward_dynamics_jacobian(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Derivatives of the accelerations: those of the residual, solved with M = L^T D L along the branches."""
    n, lanes = inputs["q"].shape
    a, status = run("tree_forward_dynamics" if model.constraints else "forward_dynamics")
    out = run("residual_jacobian", a=a)[0].reshape(3, n, n, lanes).copy()
    M, known = out[2].copy(), list(model.prescribed)
    out[:2, known] = 0.0
    M[known], M[:, known] = 0.0, 0.0
    M[known, known] = 1.0
    scale, chains = M[range(n), range(n)].copy(), _chains(model)
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
    for x in (np.negative(out[0], out=out[0]), np.negative(out[1], out=out[1]), by_u):
        for k in reversed(range(n)):
            for i in chains[k]:
                x[i] = x[i] - M[k, i] * x[k]
        for k in range(n):
            x[k] = x[k] / pivot[k]
            for i in chains[k]:
                x[k] = x[k] - M[k, i] * x[i]
    out[2] = by_u
    own = status_of(np.stack([pivot, scale], axis=1).reshape(2 * n, lanes))
    return out.reshape(-1, lanes), np.where(status != 0, status, own)


def _chains(model: Model) -> list[list[int]]:
    """Coordinates in front of each one, the nearest first."""
    parents = coordinate_parents(model)

    def before(k: int) -> Iterator[int]:
        while (k := parents[k]) >= 0:
            yield k

    return [list(before(k)) for k in range(model.size)]


def forward_dynamics(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Accelerations with the loops closed, and whether they are."""
    found, status = run("constrained_dynamics")
    return found[: model.size], _with_gaps(model, found, status, inputs["v"])


def constraint_forces(model: Model, run: Run, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Multipliers, and whether the loops are closed."""
    found, status = run("constrained_dynamics")
    m = len(model.constraints)
    return found[model.size : model.size + m], _with_gaps(model, found, status, inputs["v"])


def _with_gaps(model: Model, found: Array, status: Array, v: Array) -> Array:
    """The status (lanes,) with that of gaps and their rates, the last numbers of what is found."""
    n, m, one = model.size, len(model.constraints), found.dtype.type
    size = np.where(np.abs(v) > one(1.0), np.abs(v), one(1.0))  # NaN does not count
    scale = np.concatenate([np.ones((m, v.shape[1]), found.dtype), np.tile(size.max(axis=0), (m, 1))])
    opened = ~(np.abs(found[n + m :]) <= scale * one(OPEN_GAPS[str(found.dtype)]))
    own = np.where(opened.any(axis=0), 1 + n + opened.argmax(axis=0), 0)
    result: Array = np.where(status != 0, status, own)
    return result


COMPOSED: Mapping[str, Composed] = {
    "christoffel": christoffel,
    "constraint_forces": constraint_forces,
    "forward_dynamics": forward_dynamics,
    "forward_dynamics_jacobian": forward_dynamics_jacobian,
}
PLACES: Mapping[str, Callable[[Model], Array]] = {"christoffel": christoffel_places}  # of answers that are not whole


def frame_pose(model: Model, k: Array, frame: int) -> Array:
    """Pose (16, lanes) of a frame from what the program of frames writes."""
    last = np.zeros((4, k.shape[1]), k.dtype)
    last[3] = 1.0
    return np.concatenate([k[12 * frame : 12 * frame + 12], last])


def frame_jacobian(model: Model, k: Array, frame: int) -> Array:
    """Jacobian (6 n, lanes) of a frame from what the program of frames writes."""
    n, frames = model.size, len(model.frames)
    out = np.zeros((6, n, k.shape[1]), k.dtype)
    origins, axes = 12 * frames, 12 * frames + 3 * len(model.bodies)
    link = {f.name: f.link for f in model.robot.frames}.get(model.frames[frame], model.frames[frame])
    body = model.body_of[link]
    while body >= 0:
        origin = k[origins + 3 * body :]
        arm = [k[12 * frame + 3 + 4 * i] - origin[i] for i in range(3)]
        for s in range(model.bodies[body].first, model.bodies[body].first + len(model.bodies[body].active)):
            axis = k[axes + 3 * s : axes + 3 * s + 3]
            if model.coordinates[s].endswith((".alpha", ".beta", ".gamma")):
                for i, (y, z) in enumerate(((1, 2), (2, 0), (0, 1))):
                    out[i, s] = axis[y] * arm[z] - axis[z] * arm[y]
                out[3:, s] = axis
            else:
                out[:3, s] = axis
        body = model.bodies[body].parent
    return out.reshape(6 * n, -1)


FRAMED: Mapping[str, Callable[[Model, Array, int], Array]] = {
    "frame_pose": frame_pose,
    "frame_jacobian": frame_jacobian,
}


def one_step(method: int, run: Run, q: Array, u: Array, dt: Any) -> tuple[Array, Array]:
    """Coordinates and rates (2, n, lanes) after a step from rest without a controller, and the status of every lane.

    Method 0 is the classical Runge-Kutta method, 1 the linearly implicit one.
    """
    v = np.zeros_like(q)
    if method == 1:
        times = np.stack([np.broadcast_to(t, q.shape[1:]) for t in (dt, dt * dt)])
        a, status = run("implicit_step", q=q, v=v, u=u, added=np.zeros_like(q), dt=times)
        v = v + dt * a
        return np.stack([q + dt * v, v]), status
    one = q.dtype.type
    q_sum, v_sum, q_here, v_here = np.zeros_like(q), np.zeros_like(q), q, v
    status = np.zeros(q.shape[1], np.int64)
    for part, weight in zip(map(one, (0.5, 0.5, 1.0, 0.0)), map(one, (1.0, 2.0, 2.0, 1.0)), strict=True):
        a, failed = run("forward_dynamics", q=q_here, v=v_here, u=u)
        status = np.where(status != 0, status, failed)
        q_sum, v_sum = q_sum + weight * v_here, v_sum + weight * a
        q_here, v_here = q + part * dt * v_here, v + part * dt * a
    return np.stack([q + dt / one(6.0) * q_sum, v + dt / one(6.0) * v_sum]), status
