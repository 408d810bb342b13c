"""Where frames are and how they move; the center of mass and the momentum of all links."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .compiled_code import CompiledCode
from .raw import Array


class Kinematics(CompiledCode):
    """Kinematics of frames and of the links' masses."""

    def frame_pose(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """A_0k of a frame or link in the base, (4, 4), m; eqs. (1) and (2).

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        return self.calls.run("frame_pose", out, (q,), (self.frame_index(frame),))

    def frame_jacobian(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """Velocity of a frame's origin and angular velocity per coordinate rate, (6, n): linear, angular, base axes.

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        return self.calls.run("frame_jacobian", out, (q,), (self.frame_index(frame),))

    def center_of_mass(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Center of mass of the links that move, (3,), m, in the base frame.

        Links that are fixed to the base do not count.
        """
        return self.calls.run("center_of_mass", out, (q,))

    def centroidal_momentum(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Momentum of the links that move, (6,), base frame: linear (kg m/s), angular about their center (kg m^2/s).

        Rotors of motors (``armature``) are not in it: a description does not say about which axes they turn.
        """
        return self.calls.run("centroidal_momentum", out, (q, v))
