"""Poses and motions of frames, and readings of sensors; the center of mass and the momentum of all links."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..names import show
from ..runtime.bound import frame_number
from ..runtime.raw import Array
from .loop_assembly import LoopClosure

Reference = Literal["LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"]
REFERENCES: tuple[str, ...] = get_args(Reference)


class Kinematics(LoopClosure):
    """Kinematics of frames, where loops may be closed."""

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
        place, seen = frame_number(self.frames, frame), _checked(reference)
        linear, angular = np.split(self.functions.frame_velocities(q, v)[..., place, :], 2, axis=-1)
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
        place, seen = frame_number(self.frames, frame), _checked(reference)
        linear, angular = np.split(self.functions.frame_accelerations(q, v, a)[..., place, :], 2, axis=-1)
        if seen == "WORLD":
            velocity, rate = np.split(self.functions.frame_velocities(q, v)[..., place, :], 2, axis=-1)
            linear = linear + np.cross(velocity, rate) + np.cross(self.frame_pose(q, frame)[..., :3, 3], angular)
        return self._in_axes(q, frame, seen, linear, angular)

    def _in_axes(self, q: ArrayLike, frame: str, reference: str, linear: Array, angular: Array) -> Array:
        """Return two vectors of the base frame one behind the other, in the axes of a reference."""
        both = np.stack([linear, angular], axis=-2)
        if reference == "LOCAL":
            both = both @ self.frame_pose(q, frame)[..., :3, :3]
        return np.asarray(both.reshape(*both.shape[:-2], 6))


def _checked(reference: Any) -> str:
    """Return the reference.

    Raises:
        InputError: it is none of REFERENCES.
    """
    if not isinstance(reference, str) or reference not in REFERENCES:
        raise InputError(f"reference: {show(reference)}; allowed: {', '.join(REFERENCES)}")
    return reference
