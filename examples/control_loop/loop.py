"""The same loop in Python: what the program of C is compared with."""

from __future__ import annotations

import numpy as np
import task
from numpy.typing import NDArray

import eomgen
from eomgen.control import feedforward

Array = NDArray[np.float64]


class Encoders:
    """Readings of the motors' encoders: noise of two uniform numbers, then ticks."""

    def __init__(self) -> None:
        """Begin as the program does."""
        self._state = task.SEED

    def read(self, angles: Array) -> Array:
        """Return what the encoders read at these angles, (6,)."""
        noise = np.array([self._uniform() + self._uniform() for _ in angles])
        return task.TICK * np.floor(angles / task.TICK + noise - 0.5)

    def _uniform(self) -> float:
        self._state = (task.FACTOR * self._state + task.SUMMAND) % 2**64
        return float((self._state >> 11) * 2.0**-53)


def reference() -> tuple[Array, Array, Array]:
    """Return positions, velocities and torques of the motors, (samples + 1, 6) each, there and back."""
    t = task.DT * np.arange(round((task.MOVE + task.REST) / task.DT))
    both = [feedforward(task.model(), motion, t=t) for motion in task.moves()]
    motors = [name.endswith(".motor") for name in both[0].coordinates]
    q, v, u = (np.concatenate([getattr(way, key)[:, motors] for way in both]) for key in ("q", "v", "u"))
    return np.vstack([q, q[:1]]), np.vstack([v, v[:1]]), np.vstack([u, u[:1]])


def simulated() -> Array:
    """Return rows of t, the plant's q, the filter's q and the torques, as the program logs them, there and back."""
    plant = eomgen.build(task.plant(), kernels=("rollout",))
    rigid = eomgen.build(task.model().rigid(), kernels=("mass_matrix",))
    kalman, encoders, (q_d, v_d, forward) = task.kalman_filter(), Encoders(), reference()
    motors, limits = np.array([name.endswith(".motor") for name in plant.coordinates]), np.array(task.TORQUE)
    q, v, held = np.zeros(plant.n), np.zeros(plant.n), np.zeros(plant.n)
    q[~motors] = np.array(task.FROM) + task.OFF
    q[motors] = task.RATIO * q[~motors]
    y, u, rows = encoders.read(q[motors]), forward[0], []
    kalman.begin(np.column_stack([y / task.RATIO, y]).ravel())
    for k in range(1, len(q_d)):
        held[motors] = u
        kalman.update(encoders.read(q[motors]))
        kalman.predict(held)  # to the time from which on the next torque acts
        a = task.BANDWIDTH**2 * (q_d[k] - kalman.q[motors]) + 2.0 * task.BANDWIDTH * (v_d[k] - kalman.v[motors])
        u = forward[k] + rigid.mass_matrix(kalman.q[~motors]) @ a / task.RATIO**2
        u = np.clip(u, -limits, limits)
        steps = plant.rollout(
            q, v, held, task.DT / task.SUBSTEPS, task.SUBSTEPS, every=task.SUBSTEPS, method="implicit"
        )
        q, v = (x[-1] for x in steps)
        rows.append([task.DT * k, *q, *kalman.q, *u])
    return np.array(rows)
