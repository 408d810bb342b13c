"""Drives of a scenario: each a callable (t, q, v) -> u for ``integrate``; q and v may be (n,) or (N, n)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import Array, Index, Mask
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import DriveData, Gains, ModelDrive, Track
from ..motion.point_to_point import Program
from ..motion.splines import Standstill, signal_of
from ..motion.timetable import TimeTable
from ..robot.coordinates import index_of
from ..state.motors import shafts
from ..state.vectors import prescribed_mask
from .mechanism import Mechanism

SlopesFunction = Callable[[float, Array, Array], tuple[Array, Array]]
MotionOverTime = Callable[[float], tuple[Array, Array, Array]]  # t (s) -> coordinates, velocities, accelerations


class Control(Protocol):
    """Drives over time and state."""

    batched: bool

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate actuator forces u, N or N m, of the shape of q."""

    def standstill(self) -> Control:
        """Return the drives whose reference stays where it begins: those of the static equilibrium at the start."""

    def load_data(self) -> DriveData | None:
        """Return the time-signal input for integrations in C; None where only Python knows it."""


class _OpenLoop(Control):
    """Drives without feedback."""

    batched = True

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return derivatives by q and v, (n, n) each: zero."""
        nothing = np.zeros((q.size, q.size))
        return nothing, nothing

    def standstill(self) -> Control:
        return self


class NoControl(_OpenLoop):
    """No drives."""

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return np.zeros_like(q)

    def load_data(self) -> DriveData:
        return DriveData()


@dataclass(frozen=True, eq=False)
class TableTorque(_OpenLoop):
    """Forces or torques of a table over time, of the coordinates at ``index``, (k,); ``effort`` as of ``clipped``."""

    table: TimeTable
    index: Index
    effort: Array | None = None

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        u = np.zeros_like(q)
        u[..., self.index] = self.table.at(t)
        return clipped(u, self.effort)

    def load_data(self) -> DriveData:
        return DriveData(torque=Track(self.table.as_signal(), self.index), effort=self.effort)


@dataclass(frozen=True, eq=False)
class ReferenceControl(_OpenLoop):
    """Inputs of drives that control positions or velocities by themselves: the reference, at shafts times the ratio.

    Attributes:
        motion: reference trajectory of the m driven coordinates.
        actuators: where the drives are.
        of_velocity: which of them take a velocity, (m,); the others take a position.
    """

    motion: Program
    actuators: Actuators
    of_velocity: Mask

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        q_d, v_d, _ = self.motion.at(t)
        u = np.zeros_like(q)
        u[..., self.actuators.index] = np.where(self.of_velocity, v_d, q_d) * self.actuators.ratio
        return u

    def standstill(self) -> Control:
        return replace(self, motion=Standstill(self.motion.start))

    def load_data(self) -> DriveData | None:
        """Return the time-signal input for integrations in C; None of velocities, and where only Python knows it."""
        signal = signal_of(self.motion)
        if signal is None or self.of_velocity.any():
            return None
        scaled = replace(signal, coefficients=signal.coefficients * self.actuators.ratios)
        return DriveData(torque=Track(scaled, self.actuators.index))


def clipped(u: Array, effort: Array | None) -> Array:
    """Return drives, (n,) or (N, n), within +- their efforts, (n,), infinite where there is none; None clips none."""
    return u if effort is None else np.minimum(np.maximum(u, -effort), effort)


@dataclass(frozen=True, eq=False)
class Actuators:
    """Coordinates at which drives act and measure: principal ones, or the motors before them.

    Attributes:
        index: places of those among the robot's coordinates, (m,).
        ratio: of the gears in between, (m,), or 1.
    """

    index: Index
    ratio: Array | float = 1.0

    def measured(self, x: Array) -> Array:
        """Return coordinates or velocities of (n,) or (N, n) as seen at the joints, (m,) or (N, m)."""
        return np.ascontiguousarray(x[..., self.index] / self.ratio)

    def torques(self, joint: Array, like: Array) -> Array:
        """Return drives of the shape ``like`` that exert the joint forces ``joint``, (m,) or (N, m)."""
        u = np.zeros_like(like)
        u[..., self.index] = joint / self.ratio
        return u

    @property
    def ratios(self) -> Array:
        """Ratio of every gear, (m,)."""
        return np.broadcast_to(self.ratio, self.index.shape).astype(np.float64)


def actuators(kernel: Kernel, names: Sequence[str]) -> Actuators:
    """Return the actuators of principal coordinates, in the order of their names."""
    motors = shafts(kernel)
    index = np.asarray(index_of(kernel.coordinates, [motors.get(name, name) for name in names]), dtype=np.intp)
    ratios = [kernel.ratio(motors[name]) if name in motors else 1.0 for name in names]
    return Actuators(index, np.array(ratios) if motors else 1.0)


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """Drives of the principal coordinates: u = ID_rigid(q, v, a + w^2 (q_d - q) + 2 w (v_d - v)); else 0.

    Of one behind a motor q and v are the motor's over the ratio, and so is the motor's u.  It has no method ``slopes``:
    with derivatives of the rigid robot's inverse dynamics, whose build takes 1 s of a compiler for six joints, an
    implicit method would save a batch of 0.01 ms at each of its Jacobians.

    Attributes:
        rigid: kernel of the rigid robot; its coordinates are the driven and the prescribed ones.
        motion: reference trajectory of the driven coordinates.
        actuators: where the rigid robot's coordinates are measured and driven.
        bandwidth: w, rad/s; the error of a rigid robot dies out as exp(-w t), critically damped.
        prescribed: t -> (q, v, a) of the rigid robot's prescribed coordinates, whose accelerations the drives know;
            None without any.
        mechanism: of a rigid robot with loops: its inverse dynamics, and which coordinates are driven.
        effort: greatest forces of drives, (n,), as of ``clipped``.
    """

    rigid: Kernel
    motion: Program
    actuators: Actuators
    bandwidth: float
    prescribed: MotionOverTime | None = None
    mechanism: Mechanism | None = None
    effort: Array | None = None
    batched = True

    @cached_property
    def _driven(self) -> Mask:
        return ~prescribed_mask(self.rigid) if self.mechanism is None else self.mechanism.mask

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        q_d, v_d, a_d = self.motion.at(t)
        q_m, v_m = self.actuators.measured(q), self.actuators.measured(v)
        if self.prescribed is None and self.mechanism is None:
            a = a_d + self.bandwidth * (self.bandwidth * (q_d - q_m) + 2.0 * (v_d - v_m))
            return clipped(self.actuators.torques(self.rigid.inverse_dynamics(q_m, v_m, a), q), self.effort)
        driven = self._driven
        a = np.zeros_like(q_m)
        error, velocity_error = q_d - q_m[..., driven], v_d - v_m[..., driven]
        a[..., driven] = a_d + self.bandwidth * (self.bandwidth * error + 2.0 * velocity_error)
        if self.prescribed is not None:
            a[..., prescribed_mask(self.rigid)] = self.prescribed(t)[2]
        forces = self.rigid.inverse_dynamics if self.mechanism is None else self.mechanism.forces
        return clipped(self.actuators.torques(np.where(driven, forces(q_m, v_m, a), 0.0), q), self.effort)

    def load_data(self) -> DriveData | None:
        """Return the time-signal input for integrations in C; None of a reference that only Python can evaluate."""
        signal = signal_of(self.motion)
        if signal is None or not isinstance(self.prescribed, JointMotion | None):
            return None
        driven, place, ratio = self._driven, self.actuators.index, self.actuators.ratios
        column, prescribed = np.full(driven.size, -1), np.full(driven.size, -1)
        column[driven] = np.arange(int(driven.sum()))
        if self.prescribed is not None:
            prescribed[prescribed_mask(self.rigid)] = self.prescribed.index
        moved = None if self.mechanism is None else self.mechanism.load_data()
        model = ModelDrive(self.rigid.calls, place, ratio, column, prescribed, self.bandwidth, moved)
        return DriveData(program=Track(signal, place[driven]), ratio=ratio[driven], model=model, effort=self.effort)

    def standstill(self) -> Control:
        still = None if self.prescribed is None else _stopped(self.prescribed)
        return replace(self, motion=Standstill(self.motion.start), prescribed=still)


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of a rigid robot's prescribed coordinates, from that of the robot's; t -> (q, v, a).

    Attributes:
        prescribed: motion of the robot's prescribed coordinates.
        index: places among those, of the rigid robot's, (m,).
        ratio: of the gears in front of them, (m,).
    """

    prescribed: MotionOverTime
    index: Index
    ratio: Array

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        q, v, a = (x[self.index] / self.ratio for x in self.prescribed(t))
        return q, v, a


def _stopped(prescribed: MotionOverTime) -> MotionOverTime:
    def still(t: float) -> tuple[Array, Array, Array]:
        q = prescribed(t)[0]
        return q, np.zeros_like(q), np.zeros_like(q)

    return still


@dataclass(frozen=True, eq=False)
class JointPD:
    """Drives u = kp (q_d - q) + kd (v_d - v), on request with gravity compensation of the rigid robot.

    Of a joint behind a motor q and v are the motor's over the ratio, and so is the motor's u.

    Attributes:
        motion: reference trajectory of the m driven coordinates.
        actuators: where they are measured and driven.
        kp, kd: (m,), N/m and N s/m, or N m/rad and N m s/rad, at the joint.
        rigid: kernel of the rigid robot; None without the feed-forward.
        rigid_actuators: where its coordinates are measured and driven.
        mechanism: of a rigid robot with loops: its inverse dynamics.
        effort: greatest forces of drives, (n,), as of ``clipped``.
    """

    motion: Program
    actuators: Actuators
    kp: Array
    kd: Array
    rigid: Kernel | None = None
    rigid_actuators: Actuators | None = None
    mechanism: Mechanism | None = None
    effort: Array | None = None
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        q_d, v_d, _ = self.motion.at(t)
        error, velocity_error = q_d - self.actuators.measured(q), v_d - self.actuators.measured(v)
        u = self.actuators.torques(self.kp * error + self.kd * velocity_error, q)
        if self.rigid is not None and self.rigid_actuators is not None:
            q_m = self.rigid_actuators.measured(q)
            zero = np.zeros_like(q_m)
            forces = self.rigid.inverse_dynamics if self.mechanism is None else self.mechanism.forces
            gravity = np.where(prescribed_mask(self.rigid), 0.0, forces(q_m, zero, zero))
            u += self.rigid_actuators.torques(gravity, q)
        return clipped(u, self.effort)

    @property
    def slopes(self) -> SlopesFunction | None:
        """Derivatives by q and v, (n, n) each, (t, q, v) -> them; None with feed-forward, see ``ComputedTorque``."""
        return None if self.rigid is not None else self._gains

    def _gains(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        place, square = self.actuators.index, self.actuators.ratios**2
        slopes = np.zeros((2, q.size, q.size))
        slopes[:, place, place] = -self.kp / square, -self.kd / square
        if self.effort is not None:  # what is clipped does not answer to the state
            slopes[:, np.abs(replace(self, effort=None)(t, q, v)) > self.effort] = 0.0
        return slopes[0], slopes[1]

    def load_data(self) -> DriveData | None:
        """Return the time-signal input for integrations in C; None of a reference that only Python can evaluate."""
        signal = signal_of(self.motion)
        if signal is None:
            return None
        program, model = Track(signal, self.actuators.index), None
        if self.rigid is not None and self.rigid_actuators is not None:
            nothing, place = np.full(self.rigid.n, -1), self.rigid_actuators.index
            prescribed = np.where(prescribed_mask(self.rigid), 0, -1)
            ratios, moved = self.rigid_actuators.ratios, None if self.mechanism is None else self.mechanism.load_data()
            model = ModelDrive(self.rigid.calls, place, ratios, nothing, prescribed, None, moved)
        return DriveData(None, program, self.actuators.ratios, Gains(self.kp, self.kd), model, self.effort)

    def standstill(self) -> Control:
        return replace(self, motion=Standstill(self.motion.start))


@dataclass(frozen=True, eq=False)
class MixedControl:
    """Forces of some drives, and the reference of those that control a position or velocity by themselves.

    Attributes:
        forces: of all driven coordinates, of which those of the latter do not count.
        reference: of all driven coordinates.
        servos: places of drives that take it, (k,).
        effort: greatest forces of drives, (n,), as of ``clipped``.
    """

    forces: JointPD | ComputedTorque
    reference: ReferenceControl
    servos: Index
    effort: Array | None = None
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        u = clipped(self.forces(t, q, v), self.effort)
        u[..., self.servos] = self.reference(t, q, v)[..., self.servos]
        return u

    def standstill(self) -> Control:
        still = replace(self, reference=replace(self.reference, motion=Standstill(self.reference.motion.start)))
        forces = self.forces.standstill()
        assert isinstance(forces, JointPD | ComputedTorque)
        return replace(still, forces=forces)

    def load_data(self) -> None:
        """Return no time-signal input: drives of both kinds are known to Python alone."""
