"""An independent oracle: Pinocchio's free flyer, whose base has a quaternion, of a URDF whose root floats."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.support.optional import OptionalModule

pin = OptionalModule("pinocchio")

Array = NDArray[np.float64]


def axes_of(angles: Array) -> Array:
    """Axes of alpha, beta and gamma as columns, as the turned body sees them, (3, 3)."""
    _, beta, gamma = angles
    first = Rotation.from_euler("YZ", [beta, gamma]).inv().apply([1.0, 0.0, 0.0])
    second = Rotation.from_euler("Z", gamma).inv().apply([0.0, 1.0, 0.0])
    return np.column_stack([first, second, [0.0, 0.0, 1.0]])


class Flyer:
    """States and motions of the robot, in Pinocchio's numbers.

    Arguments q, v and a are those of eomgen: six of the base, then those of hinges and slides.  ``turn`` (3, 3) has
    the axes in space that those of the base are in, as columns, in the described ones.
    """

    def __init__(self, text: str, turn: Array | None = None) -> None:
        self.model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        self.turn = np.eye(3) if turn is None else turn

    def configuration(self, q: Array) -> Array:
        """Place and quaternion (x, y, z, w) of the base, then those of the joints: (cos, sin) without limits."""
        whole = pin.neutral(self.model)
        whole[:3], whole[3:7] = self.turn @ q[:3], Rotation.from_matrix(self.described(q)).as_quat()
        for value, joint in zip(q[6:], list(self.model.joints)[2:], strict=True):
            at = slice(joint.idx_q, joint.idx_q + joint.nq)
            whole[at] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        return np.asarray(whole)

    def described(self, q: Array) -> Array:
        """Rotation of the base in the described axes, (3, 3)."""
        return np.asarray(self.turn @ Rotation.from_euler("XYZ", q[3:6]).as_matrix())

    def rates(self, q: Array, v: Array) -> Array:
        """Velocity and angular velocity of the base in its own axes, then rates of the joints."""
        velocity = Rotation.from_euler("XYZ", q[3:6]).inv().apply(v[:3])
        return np.concatenate([velocity, axes_of(q[3:6]) @ v[3:6], v[6:]])

    def slopes(self, q: Array, v: Array, a: Array) -> Array:
        """What ``rates`` change by where a are the accelerations."""
        inwards, axes = Rotation.from_euler("XYZ", q[3:6]).inv(), axes_of(q[3:6])
        spin, velocity = axes @ v[3:6], inwards.apply(v[:3])
        turning = v[3] * np.cross(axes[:, 0], spin) + v[4] * v[5] * np.cross(axes[:, 1], axes[:, 2])
        linear = inwards.apply(a[:3]) - np.cross(spin, velocity)
        return np.concatenate([linear, axes @ a[3:6] + turning, a[6:]])

    def accelerations(self, x: Array, w: Array, drives: Array) -> Array:
        """What rates w change by in a configuration x under drives of the joints; nothing drives the base."""
        return np.array(pin.aba(self.model, self.data, x, w, np.concatenate([np.zeros(6), drives])))

    def motion(self, x: Array, w: Array, drives: Array, dt: float, steps: int) -> tuple[Array, Array]:
        """Configuration and rates after steps of fourth order on the manifold, free of commutators.

        Celledoni, Marthinsen and Owren, Future Generation Computer Systems 19 (2003); of rates it is the classical
        method of Runge and Kutta.
        """
        for _ in range(steps):
            k1, a1 = w, self.accelerations(x, w, drives)
            x2 = self._along(x, 0.5 * dt * k1)
            k2 = w + 0.5 * dt * a1
            a2 = self.accelerations(x2, k2, drives)
            k3 = w + 0.5 * dt * a2
            a3 = self.accelerations(self._along(x, 0.5 * dt * k2), k3, drives)
            k4 = w + dt * a3
            a4 = self.accelerations(self._along(x2, dt * (k3 - 0.5 * k1)), k4, drives)
            x = self._along(x, dt / 12.0 * (3.0 * k1 + 2.0 * k2 + 2.0 * k3 - k4))
            x = self._along(x, dt / 12.0 * (3.0 * k4 + 2.0 * k2 + 2.0 * k3 - k1))
            w = w + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        return x, w

    def apart(self, x: Array, other: Array) -> float:
        """Largest difference of two configurations, m and rad."""
        return float(np.abs(pin.difference(self.model, x, other)).max())

    def _along(self, x: Array, step: Array) -> Array:
        return np.asarray(pin.normalize(self.model, pin.integrate(self.model, x, step)))
