"""Print how far links behind six elastic gears are off a motion without feedback, for docs/howto/feedforward.md.

    python -m benchmarks.elastic_gears

Rows are torques by ``eomgen.control.feedforward`` and by the inverse dynamics of the rigid arm over the gears' ratios,
in the same simulation by Radau's method with tight tolerances.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

import eomgen
from eomgen.control import FeedForward, feedforward
from eomgen.integration import integrate
from eomgen.motion import PointToPoint
from eomgen.robot.value import Coordinate, Motor, Robot

STIFFNESS = (2e4, 2e4, 1.5e4, 5e3, 5e3, 3e3)  # N m/rad
RATIO, ROTOR = 100.0, 1e-4  # kg m^2
START, GOAL, DURATION = (0.0, -1.2, 1.4, -0.5, 1.1, 0.2), (0.6, -0.8, 1.0, 0.1, 0.7, 0.5), 0.8


def geared_arm() -> Robot:
    """Return the UR5 with a motor behind an elastic gear at every joint."""
    robot = eomgen.load_robot("ur5")
    joints = (
        replace(joint, motor=Motor(ROTOR, RATIO, Coordinate(k)))
        for joint, k in zip(robot.joints, STIFFNESS, strict=True)
    )
    return replace(robot, name="geared_ur5", joints=tuple(joints))


def largest_error(robot: Robot, samples: FeedForward, motion: PointToPoint) -> float:
    """Return the largest error of a link's joint over the motion, rad, without feedback."""
    kernel = eomgen.build(robot)
    places = [i for i, name in enumerate(samples.coordinates) if not name.endswith(".motor")]
    found = integrate(
        kernel, samples.q[0], samples.v[0], DURATION, drive=samples.drive(), method="radau", rtol=1e-12, atol=1e-13
    )
    return float(np.abs(found.q[:, places] - motion.at(found.t)[0]).max())


def main() -> int:
    """Print the rows."""
    robot, motion = geared_arm(), PointToPoint(np.array(START), np.array(GOAL), DURATION, smooth=4)
    elastic = feedforward(robot, motion)
    motors = [name.endswith(".motor") for name in elastic.coordinates]
    rigid = replace(elastic, u=np.zeros_like(elastic.u))
    rigid.u[:, motors] = eomgen.build(robot.rigid()).inverse_dynamics(*motion.at(elastic.t)) / RATIO
    print("| torques of the motors | largest error of a joint |\n|---|---|")
    for name, samples in (("feed-forward of the elastic gears", elastic), ("computed torque of the rigid arm", rigid)):
        print(f"| {name} | {largest_error(robot, samples, motion):.0e} rad |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
