"""Poses and motions of frames, and readings of sensors; the center of mass and the momentum of all links."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..names import show
from .compiled_code import CompiledCode
from .raw import Array

Reference = Literal["LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"]
REFERENCES: tuple[str, ...] = get_args(Reference)


class Kinematics(CompiledCode):
    """Kinematics of frames and of the links' masses."""

    def frame_pose(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """Return A_0k of a frame or link in the base, (4, 4), m; eqs. (1) and (2).

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        return self.calls.run("frame_pose", out, (q,), (self.frame_index(frame),))

    def frame_jacobian(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """Return a frame's Jacobian, (6, n), in the base frame: its origin's velocity, then angular velocity, per rate.

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        return self.calls.run("frame_jacobian", out, (q,), (self.frame_index(frame),))

    def frame_velocities(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return velocities of frames, (frames, 6), in the base frame: of the origin (m/s), then angular (rad/s)."""
        return self.calls.run("frame_velocities", out, (q, v))

    def frame_accelerations(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return accelerations of frames, (frames, 6), in the base frame: of origins (m/s^2), then angular (rad/s^2).

        Gravity is not in it: a frame at rest has none.
        """
        return self.calls.run("frame_accelerations", out, (q, v, a))

    def imu(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return what IMUs on all frames read, (frames, 6), each in its frame's axes.

        Of its accelerometer the specific force R^T (a - g), m/s^2, of its gyroscope the angular rate R^T w, rad/s: at
        rest it reads the acceleration that holds it against gravity.
        """
        return self.calls.run("imu", out, (q, v, a))

    def measurement(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return readings of the robot's sensors, (readings,), in the order of ``eomgen.control.Measurement.names``."""
        return self.calls.run("measurement", out, (q, v, a))

    def generalized_momentum(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the generalized momentum p = M v and, below it, C^T v = dT/dq, (2, n).

        On a motion p' = u + C^T v + generalized_force(q, v) + external forces, which a momentum observer finds so.
        """
        return self.calls.run("generalized_momentum", out, (q, v))

    def frame_velocity(
        self, q: ArrayLike, v: ArrayLike, frame: str, reference: Reference = "LOCAL_WORLD_ALIGNED"
    ) -> Array:
        """Return the velocity of a frame or link, (6,): linear (m/s), angular (rad/s).

        Args:
            q, v: (n,).
            frame: one of ``frames``.
            reference: as in Pinocchio: "LOCAL_WORLD_ALIGNED", the velocity of the frame's origin in the base frame;
                "LOCAL", the same in the frame's axes; "WORLD", in the base frame, the velocity of that point of the
                body that is at the base's origin.

        Raises:
            UnknownNameError: no frame or link of that name.
            InputError: another reference.
        """
        place, seen = self.frame_index(frame), _checked(reference)
        linear, angular = np.split(self.frame_velocities(q, v)[..., place, :], 2, axis=-1)
        if seen == "WORLD":
            linear = linear + np.cross(self.frame_pose(q, frame)[..., :3, 3], angular)
        return self._in_axes(q, frame, seen, linear, angular)

    def frame_acceleration(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, frame: str, reference: Reference = "LOCAL_WORLD_ALIGNED"
    ) -> Array:
        """Return the acceleration of a frame or link, (6,): linear (m/s^2), angular (rad/s^2), without gravity.

        Args:
            q, v, a: (n,).
            frame: one of ``frames``.
            reference: "LOCAL_WORLD_ALIGNED", the acceleration of the frame's origin in the base frame; "LOCAL", the
                same in the frame's axes (Pinocchio's classical accelerations); "WORLD", the rate of ``frame_velocity``
                in "WORLD" (Pinocchio's spatial acceleration).

        Raises:
            UnknownNameError: no frame or link of that name.
            InputError: another reference.
        """
        place, seen = self.frame_index(frame), _checked(reference)
        linear, angular = np.split(self.frame_accelerations(q, v, a)[..., place, :], 2, axis=-1)
        if seen == "WORLD":
            velocity, rate = np.split(self.frame_velocities(q, v)[..., place, :], 2, axis=-1)
            linear = linear + np.cross(velocity, rate) + np.cross(self.frame_pose(q, frame)[..., :3, 3], angular)
        return self._in_axes(q, frame, seen, linear, angular)

    def frame_bias_acceleration(
        self, q: ArrayLike, v: ArrayLike, frame: str, reference: Reference = "LOCAL_WORLD_ALIGNED"
    ) -> Array:
        """Return the rate of a frame's Jacobian times v, J_dot v, (6,): linear (m/s^2), angular (rad/s^2).

        It is ``frame_acceleration`` where a is 0: acceleration is J a + J_dot v.  J of "LOCAL_WORLD_ALIGNED" is
        ``frame_jacobian``.

        Args:
            q, v: (n,).
            frame: one of ``frames``.
            reference: as of ``frame_acceleration``.

        Raises:
            UnknownNameError: no frame or link of that name.
            InputError: another reference.
        """
        return self.frame_acceleration(q, v, np.zeros(self.n, self.dtype), frame, reference)

    def _in_axes(self, q: ArrayLike, frame: str, reference: str, linear: Array, angular: Array) -> Array:
        """Return two vectors of the base frame one behind the other, in the axes of a reference."""
        both = np.stack([linear, angular], axis=-2)
        if reference == "LOCAL":
            both = both @ self.frame_pose(q, frame)[..., :3, :3]
        return np.asarray(both.reshape(*both.shape[:-2], 6))

    def center_of_mass(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the center of mass of the links that move, (3,), m, in the base frame.

        Links that are fixed to the base do not count.
        """
        return self.calls.run("center_of_mass", out, (q,))

    def centroidal_momentum(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the momentum of moving links, (6,), base frame: linear (kg m/s), angular about the center (kg m^2/s).

        Rotors of motors (``armature``) are not in it: a description does not say about which axes they turn.
        """
        return self.calls.run("centroidal_momentum", out, (q, v))


def _checked(reference: Any) -> str:
    """Return the reference.

    Raises:
        InputError: it is none of REFERENCES.
    """
    if not isinstance(reference, str) or reference not in REFERENCES:
        raise InputError(f"reference: {show(reference)}; allowed: {', '.join(REFERENCES)}")
    return reference
