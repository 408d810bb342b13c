"""Drives with states as forces at their shafts: robots without them, motions with what currents give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import InputError
from ...motion.files import MeasuredMotion
from ...robot.coordinates import force_unit_of
from ...robot.internal_states.drives import DRIVE, LAG, TORQUE_CONSTANT, has_drive, has_winding, input_of
from ...robot.mechanism import coordinate_of
from ...robot.model import build_model
from ...robot.value import Joint, Robot


def without_drives(robot: Robot) -> Robot:
    """Return the robot with forces in the place of drives with states."""
    joints = tuple(_without_drive(joint) for joint in robot.joints)
    if all(new is old for new, old in zip(joints, robot.joints, strict=True)):
        return robot
    made = replace(robot, joints=joints)
    known = {name for name, _ in made.numbers()}
    return replace(made, tunable=tuple(name for name in robot.tunable if name in known))


def _without_drive(joint: Joint) -> Joint:
    coordinates = {name: coordinate.without_drive() for name, coordinate in joint.coordinates.items()}
    motor = joint.motor
    if motor is not None and has_drive(motor.rotor.law()):
        motor = replace(motor, further=motor.rotor.without_drive().further)
    same = motor is joint.motor and all(new is joint.coordinates[name] for name, new in coordinates.items())
    return joint if same else replace(joint, coordinates=coordinates, motor=motor)


def at_shafts(robot: Robot, motion: MeasuredMotion) -> MeasuredMotion:
    """Return a motion whose drives are forces: of a winding torque_constant times the current, where that is known.

    Args:
        robot: with its drives.
        motion: of its coordinates.

    Raises:
        InputError: of a simulated drive without such a state, whose input says nothing of its force.
    """
    model, u, driven = build_model(robot), motion.u.copy(), list(motion.driven)
    for i in model.drives:
        name = model.coordinates[i]
        numbers = coordinate_of(robot, name).law()
        winding = has_winding(numbers)
        state = f"{name}.{DRIVE}.{'current' if winding else 'force'}"
        if state in motion.states and (winding or LAG in numbers):
            u[:, i] = (numbers[TORQUE_CONSTANT] if winding else 1.0) * motion.states[state]
            driven += [name] if name not in driven else []
        elif name in driven and any(x.startswith(f"{name}.{DRIVE}.") for x in motion.states):
            meaning, unit = input_of(numbers, name)
            raise InputError(
                f"{motion.source}: {name}.drive is a {meaning}, {unit}; allowed: {force_unit_of(name)} on the"
                f" coordinate, or a column {state} of a drive with winding or lag"
            )
    order = [name for name in motion.coordinates if name in driven]
    return motion if np.array_equal(u, motion.u) else replace(motion, u=u, driven=tuple(order))
