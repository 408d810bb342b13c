"""Readings of a robot's sensors: their names and units, what filters compare of them, and which a robot can carry."""

from __future__ import annotations

from collections.abc import Mapping

from ...names import component_name, joint_of, kind_of, listed, nearest, show
from ..geometry import LINEAR
from .joint import MOTOR
from .robot import Robot
from .sensor import AT_COORDINATES, SENSOR_KINDS, Sensor

Rows = tuple[tuple[str, str], ...]  # ending of a name, unit

_FORCE = tuple((f"f{axis}", "m/s^2") for axis in "xyz")
_RATE = tuple((f"w{axis}", "rad/s") for axis in "xyz")
_POSITION = tuple((axis, "m") for axis in "xyz")
_ROTATION = tuple((f"r{axis}", "rad") for axis in "xyz")
_POSE = tuple(pair for i in "123" for pair in (*((f"r{i}{j}", "1") for j in "123"), (f"x{i}", "m")))
_READINGS: Mapping[str, Rows] = {
    "accelerometer": _FORCE,
    "gyroscope": _RATE,
    "imu": _FORCE + _RATE,
    "position": _POSITION,
    "pose": _POSE,
}
_INNOVATIONS: Mapping[str, Rows] = {**_READINGS, "pose": _POSITION + _ROTATION}
_AT_COORDINATE = {"encoder": ("m", "rad"), "tachometer": ("m/s", "rad/s"), "torque": ("N", "N m")}


def readings(robot: Robot, sensor: Sensor) -> Rows:
    """Return names and units of what a sensor tells: ("imu:tcp.fx", "m/s^2"), ..."""
    return _named(robot, sensor, _READINGS)


def innovations(robot: Robot, sensor: Sensor) -> Rows:
    """Return names and units of the differences that filters compare; of a pose three angles for its rotation."""
    return _named(robot, sensor, _INNOVATIONS)


def sensor_conflict(robot: Robot, sensor: Sensor) -> str | None:
    """Say why a robot cannot carry a sensor, and what is allowed; None where it can."""
    if sensor.kind not in SENSOR_KINDS:
        return f"{show(sensor.kind)} is no sensor; allowed: {', '.join(SENSOR_KINDS)}"
    what = "coordinate" if sensor.kind in AT_COORDINATES else "frame or link"
    known = [*robot.coordinates]
    if sensor.kind not in AT_COORDINATES:
        known = [*(x.name for x in robot.frames), *(x.name for x in robot.links), robot.base]
    if sensor.of not in known:
        return f"{sensor.kind} {show(sensor.of)} is no {what}; allowed: {listed(known)}{nearest(sensor.of, known)}"
    return _torque_conflict(robot, sensor) if sensor.kind == "torque" else None


def _torque_conflict(robot: Robot, sensor: Sensor) -> str | None:
    """Say why no torque is measured there."""
    if sensor.of in robot.modal_coordinates:
        return f"{sensor.name}: a mode carries no torque; allowed: coordinates of joints and motors"
    motor = robot.joint(joint_of(sensor.of)).motor
    if kind_of(sensor.of) == MOTOR and motor is not None:
        if motor.transmission != motor.transmission.without_states():
            return f"{sensor.name}: the gear's law has states; allowed: gears whose torque follows from deflections"
    elif robot.is_closed:
        return f"{sensor.name}: loops and couplings carry part of it; allowed: trees, and motors behind elastic gears"
    return None


def _named(robot: Robot, sensor: Sensor, rows: Mapping[str, Rows]) -> Rows:
    if sensor.kind not in AT_COORDINATES:
        return tuple((component_name(sensor.name, ending), unit) for ending, unit in rows[sensor.kind])
    linear, angular = _AT_COORDINATE[sensor.kind]
    kind = kind_of(sensor.of)
    if kind == MOTOR and sensor.kind == "torque":  # on the output of its gear
        kind = robot.joint(joint_of(sensor.of)).principal
    return ((sensor.name, linear if kind in LINEAR else angular),)
