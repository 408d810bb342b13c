"""Drives of a scenario: each is a callable (t, q, v) -> u for ``integrate``; q and v may be (n,) or (N, n)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .kernel import Kernel
from .motion import Program
from .programs import Rest
from .timetable import TimeTable

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Control(Protocol):
    """Drives over time and state."""

    batched: bool

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """u, N or N m, of the shape of q."""

    def resting(self) -> Control:
        """The drives whose program stays where it begins: those of the equilibrium at the start."""


@dataclass(frozen=True, eq=False)
class NoControl:
    """No drives."""

    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return np.zeros_like(q)

    def resting(self) -> Control:
        return self


@dataclass(frozen=True, eq=False)
class TableTorque:
    """Forces or torques of a table over time, of the coordinates at ``index``, (k,)."""

    table: TimeTable
    index: Index
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        u = np.zeros_like(q)
        u[..., self.index] = self.table.at(t)
        return u

    def resting(self) -> Control:
        return self


@dataclass(frozen=True)
class ComputedTorque:
    """Drives of the principal coordinates: u = ID_rigid(q, v, a + w^2 (q_d - q) + 2 w (v_d - v)); else 0.

    Attributes:
        rigid: kernel of the rigid robot; its coordinates are the driven and the prescribed ones.
        motion: program of the driven coordinates.
        index: where the rigid robot's coordinates are among the robot's.
        bandwidth: w, rad/s; the error of a rigid robot dies out as exp(-w t), critically damped.
        prescribed: t -> (q, v, a) of the prescribed coordinates, whose accelerations the drives know; None without any.
    """

    rigid: Kernel
    motion: Program
    index: Index
    bandwidth: float
    prescribed: Callable[[float], tuple[Array, Array, Array]] | None = None
    batched = True

    @property
    def _driven(self) -> NDArray[np.bool_]:
        return np.array([name not in self.rigid.prescribed for name in self.rigid.coordinates])

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        q_d, v_d, a_d = self.motion.at(t)
        q_m, v_m = np.ascontiguousarray(q[..., self.index]), np.ascontiguousarray(v[..., self.index])
        u = np.zeros_like(q)
        if self.prescribed is None:
            a = a_d + self.bandwidth * (self.bandwidth * (q_d - q_m) + 2.0 * (v_d - v_m))
            u[..., self.index] = self.rigid.inverse_dynamics(q_m, v_m, a)
            return u
        driven = self._driven
        a = np.empty_like(q_m)
        error, rate = q_d - q_m[..., driven], v_d - v_m[..., driven]
        a[..., driven] = a_d + self.bandwidth * (self.bandwidth * error + 2.0 * rate)
        a[..., ~driven] = self.prescribed(t)[2]
        u[..., self.index[driven]] = self.rigid.inverse_dynamics(q_m, v_m, a)[..., driven]
        return u

    def resting(self) -> Control:
        still = None if self.prescribed is None else _stopped(self.prescribed)
        return replace(self, motion=Rest(self.motion.start), prescribed=still)


def _stopped(
    prescribed: Callable[[float], tuple[Array, Array, Array]],
) -> Callable[[float], tuple[Array, Array, Array]]:
    def still(t: float) -> tuple[Array, Array, Array]:
        q = prescribed(t)[0]
        return q, np.zeros_like(q), np.zeros_like(q)

    return still


@dataclass(frozen=True, eq=False)
class JointPD:
    """Drives u = kp (q_d - q) + kd (v_d - v), on request with what holds the rigid robot against gravity where it is.

    Attributes:
        motion: program of the driven coordinates, m of them.
        index: where they are among the robot's, (m,).
        kp, kd: (m,), N/m and N s/m, or N m/rad and N m s/rad.
        rigid: kernel of the rigid robot; None without the feed-forward.
        rigid_index: where its coordinates are among the robot's.
    """

    motion: Program
    index: Index
    kp: Array
    kd: Array
    rigid: Kernel | None = None
    rigid_index: Index | None = None
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        q_d, v_d, _ = self.motion.at(t)
        u = np.zeros_like(q)
        if self.rigid is not None:
            q_m = np.ascontiguousarray(q[..., self.rigid_index])
            zero = np.zeros_like(q_m)
            u[..., self.rigid_index] = self.rigid.inverse_dynamics(q_m, zero, zero)
            given = [name in self.rigid.prescribed for name in self.rigid.coordinates]
            u[..., np.asarray(self.rigid_index)[given]] = 0.0
        u[..., self.index] += self.kp * (q_d - q[..., self.index]) + self.kd * (v_d - v[..., self.index])
        return u

    def resting(self) -> Control:
        return replace(self, motion=Rest(self.motion.start))
