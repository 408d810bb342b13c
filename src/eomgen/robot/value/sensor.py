"""Sensors of a robot: what each measures, and where."""

from __future__ import annotations

from dataclasses import dataclass

AT_COORDINATES = ("encoder", "tachometer", "torque")
ON_FRAMES = ("accelerometer", "gyroscope", "imu", "position", "pose")  # and on links
SENSOR_KINDS = (*AT_COORDINATES, *ON_FRAMES)


@dataclass(frozen=True)
class Sensor:
    """A sensor: its kind, one of SENSOR_KINDS, and of which coordinate, frame or link.

    - encoder, tachometer: a coordinate's position or velocity; of a motor behind an elastic gear its own, on its side.
    - torque: what a joint carries along its coordinate, on the gear's output; of a motor, what its elastic gear
      carries to the joint.
    - accelerometer: specific force R^T (a - g) at the frame's origin in its axes; gyroscope: angular rate R^T w; imu:
      both.
    - position: of the frame's origin in the base; pose: rows of [R | X] in the base, (3, 4).
    """

    kind: str
    of: str

    @property
    def name(self) -> str:
        """Its name, "imu:tcp"."""
        return f"{self.kind}:{self.of}"
