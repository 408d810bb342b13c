"""Steps of integrations as their templates take them, on the numbers of samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.steps.methods import TSIT5, W643
from .arithmetic import Array
from .composed import Run


def clipped(u: Array, effort: Array) -> Array:
    """Return drives within +- their efforts, (n, lanes) both; what is no number stays so."""
    drives: Array = np.where(u > effort, effort, np.where(u < -effort, -effort, u))
    return drives


def one_step(method: int, run: Run, q: Array, v: Array, u: Array, dt: Any) -> tuple[Array, Array]:
    """Step without a controller; return coordinates and rates (2, n, lanes), and the status of every lane.

    Method 0 is the classical Runge-Kutta method, 1 the linearly implicit one.
    """
    if method == 1:
        times = np.stack([np.broadcast_to(t, q.shape[1:]) for t in (dt, dt * dt)])
        a, status = run("implicit_step", q=q, v=v, u=u, added=np.zeros_like(q), dt=times)
        v = v + dt * a
        return np.stack([q + dt * v, v]), status
    one = q.dtype.type
    q_sum, v_sum, q_here, v_here = np.zeros_like(q), np.zeros_like(q), q, v
    status = np.zeros(q.shape[1], np.int64)
    for fraction, weight in zip(map(one, (0.5, 0.5, 1.0, 0.0)), map(one, (1.0, 2.0, 2.0, 1.0)), strict=True):
        a, failed = run("forward_dynamics", q=q_here, v=v_here, u=u)
        status = np.where(status != 0, status, failed)
        q_sum, v_sum = q_sum + weight * v_here, v_sum + weight * a
        q_here, v_here = q + fraction * dt * v_here, v + fraction * dt * a
    return np.stack([q + dt / one(6.0) * q_sum, v + dt / one(6.0) * v_sum]), status


def one_adapted_step(method: int, run: Run, q: Array, v: Array, u: Array, dt: Any) -> tuple[Array, Array]:
    """Take a step with error control that allows anything: method 0 is the Rosenbrock method, 1 the explicit pair.

    2 is Radau IIA, which in a step that short comes to what one of Euler's comes to, but for rounding.  Returns states
    as ``one_step``, and the first status of every lane: a step with one that is not 0 is not taken.
    """
    status = np.zeros(q.shape[1], np.int64)

    def checked(name: str, **changed: Array) -> tuple[Array, Array]:
        answer, failed = run(name, **changed)
        np.copyto(status, failed, where=status == 0)
        return answer, failed

    way = (_rosenbrock, _explicit, _euler)[method]
    return way(checked, q, v, u, dt), status


def _euler(run: Run, q: Array, v: Array, u: Array, dt: Any) -> Array:
    a = run("forward_dynamics", q=q, v=v, u=u)[0]
    return np.stack([q + dt * v, v + dt * a])


def _rosenbrock(run: Run, q: Array, v: Array, u: Array, dt: Any) -> Array:
    one, nothing = q.dtype.type, np.zeros_like(q)
    ahead, back, weight, _ = (x.astype(q.dtype) for x in W643.transformed())
    inverse, c = one(1.0) / dt, one(W643.diagonal) * dt
    times = np.stack([np.broadcast_to(t, q.shape[1:]) for t in (c, c * c)])
    kept = run("stage_factors", q=q, v=v, kp=nothing, kd=nothing, times=times)[0]
    parts: list[tuple[Array, Array]] = []
    for stage in range(len(weight)):
        q_here, v_here, q_back, v_back = q, v, nothing, nothing
        for j, (x, y) in enumerate(parts):
            q_here, v_here = q_here + ahead[stage, j] * x, v_here + ahead[stage, j] * y
            q_back, v_back = q_back + back[stage, j] * x, v_back + back[stage, j] * y
        shifts = v_here + inverse * q_back
        a = run("forward_dynamics", q=q_here, v=v_here, u=u)[0] + inverse * v_back
        v_part = c * (a + run("stage_solution", q=q, kept=kept, rates=a, shifts=shifts)[0])
        parts.append((c * (v_part + shifts), v_part))
    q_end, v_end = q, v
    for j, (x, y) in enumerate(parts):
        q_end, v_end = q_end + weight[j] * x, v_end + weight[j] * y
    return np.stack([q_end, v_end])


def _explicit(run: Run, q: Array, v: Array, u: Array, dt: Any) -> Array:
    ahead, nothing = TSIT5.a.astype(q.dtype), np.zeros_like(q)
    rates: list[tuple[Array, Array]] = []
    q_here, v_here = q, v
    for stage in range(len(ahead)):
        q_sum, v_sum = nothing, nothing
        for j, (x, y) in enumerate(rates):
            q_sum, v_sum = q_sum + ahead[stage, j] * x, v_sum + ahead[stage, j] * y
        if stage:
            q_here, v_here = q + dt * q_sum, v + dt * v_sum
        rates.append((v_here, run("forward_dynamics", q=q_here, v=v_here, u=u)[0]))
    return np.stack([q_here, v_here])
