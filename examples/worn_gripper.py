"""A worn gripper arm: clearance in the elbow, and a wrist whose stiffness was measured.

    python examples/worn_gripper.py

The arm swings to and fro about its waist; its elbow falls from one end of its play to the other.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import eomgen
from eomgen.scenario import scenario_from_toml

HERE = Path(__file__).parent

MOTION = """
duration = 1.6
output_step = 1e-3
frame = "fingertips"

[motion]
type = "via"
times = [0.0, 0.4, 0.8, 1.2]
points = [
  [0.0, 0.4, -0.9, 0.5],
  [0.6, 0.4, -0.9, 0.5],
  [0.0, 0.4, -0.9, 0.5],
  [0.6, 0.4, -0.9, 0.5],
]
"""


def unworn(robot: eomgen.Robot) -> eomgen.Robot:
    """The arm with hardly any play in its elbow."""
    elbow = robot.joint("elbow")
    tight = replace(elbow.coordinates["alpha"], clearance=1e-6, smoothing=1e-7)
    joints = [replace(j, coordinates={**j.coordinates, "alpha": tight}) if j is elbow else j for j in robot.joints]
    return replace(robot, joints=tuple(joints))


def say(name: str, result: eomgen.SimulationResult) -> None:
    """The tool's deviation, and when the elbow went from one end of its play to the other."""
    off = 1e6 * np.linalg.norm(result.tool_deviation, axis=1)
    print(f"{name}: off by {off.max():.0f} um at most, {np.sqrt(np.mean(off**2)):.0f} um rms")
    hits = [contact for contact in result.trajectory.contacts if contact.closes]
    for contact in hits[:6]:
        end = "upper" if contact.side > 0 else "lower"
        print(f"  {contact.t:.4f} s: {contact.coordinate} hits its {end} end at {1e3 * contact.rate:+.2f} mrad/s")
    print(f"  {len(hits)} hits in {result.trajectory.t[-1]:g} s")


def main() -> None:
    robot = eomgen.load_robot(HERE / "gripper_arm_worn.toml")
    kernel = eomgen.build(robot, kernels=("generalized_force", "residual_jacobian"))
    wrist = kernel.coordinates.index("wrist.beta")
    q, zero = np.zeros(kernel.n), np.zeros(kernel.n)
    for angle in (1e-4, 4e-4, 1e-3):
        q[wrist] = angle
        slope = kernel.residual_jacobian(q, zero, zero)[0][wrist, wrist]
        print(f"wrist at {1e3 * angle:.1f} mrad: {slope:8.0f} N m/rad, from the measured curve")
    scenario = scenario_from_toml(MOTION)
    say("worn", eomgen.run_scenario(robot, scenario))
    say("unworn", eomgen.run_scenario(unworn(robot), scenario))


if __name__ == "__main__":
    main()
