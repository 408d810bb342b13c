"""Arms whose motors stand behind elastic gears, without other deviations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Coordinate, Motor, Robot

UR5_STIFFNESS = (2e4, 2e4, 1.5e4, 5e3, 5e3, 3e3)  # N m/rad
RATIO = 100.0


def two_link_arm(stiffness: tuple[float, float] = (2000.0, 1000.0), damping: tuple[float, float] = (0.0, 0.0)) -> Robot:
    """A vertical arm of two links of 0.4 m; rotors of 1.2 and 0.6 kg m^2 at the joints' side."""
    inertias = (1.2 / RATIO**2, 0.6 / RATIO**2)
    text = ['name = "two_link_arm"', "gravity = [0.0, -9.81, 0.0]"]
    for i, (mass, parent) in enumerate(((4.0, "base"), (3.0, "link1"))):
        place = "placement = { xyz = [0.4, 0.0, 0.0] }" if i else ""
        damper = f", damping = {damping[i]}" if damping[i] else ""
        text += [
            f'[[links]]\nname = "link{i + 1}"\nmass = {mass}\ncom = [0.2, 0.0, 0.0]',
            "inertia = { xx = 0.01, yy = 0.05, zz = 0.05 }",
            f'[[joints]]\nname = "joint{i + 1}"\nparent = "{parent}"\nchild = "link{i + 1}"\ntype = "revolute"',
            place,
            f"motor = {{ inertia = {inertias[i]!r}, ratio = {RATIO}, stiffness = {stiffness[i]}{damper} }}",
        ]
    return robot_from_toml("\n".join(text))


def geared_ur5(law: Callable[[float], Coordinate] = Coordinate) -> Robot:
    """The UR5 with a motor behind an elastic gear at every joint; ``law`` gives a transmission of its stiffness."""
    robot = eomgen.load_robot("ur5")
    joints = (
        replace(joint, motor=Motor(1e-4, RATIO, law(stiffness)))
        for joint, stiffness in zip(robot.joints, UR5_STIFFNESS, strict=True)
    )
    return replace(robot, name="geared_ur5", joints=tuple(joints))
