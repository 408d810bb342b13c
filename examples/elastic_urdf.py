"""Your URDF, made elastic: how far is a real arm's tool from where its program says?

    python examples/elastic_urdf.py

``gripper_arm.urdf`` is a rigid arm.  ``gripper_arm_elastic.toml`` names the URDF and gives joints the directions in
which they yield; everything else stays in the URDF.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import eomgen
from eomgen.analysis import budget, deflection, modes
from eomgen.scenario import scenario_from_toml

HERE = Path(__file__).parent
POSE = {"shoulder": 0.4, "elbow": -0.9, "wrist": 0.5}

MOTION = """
duration = 1.2
frame = "fingertips"

[motion]
type = "point_to_point"
start = { shoulder = 0.4, elbow = -0.9, wrist = 0.5 }
goal = { waist = 0.8, shoulder = 0.7, elbow = -1.2, wrist = 0.5 }
duration = 0.7
"""


def main() -> None:
    rigid = eomgen.load_robot(HERE / "gripper_arm.urdf")
    robot = eomgen.load_robot(HERE / "gripper_arm_elastic.toml")
    print(f"{rigid.name}: {len(eomgen.build(rigid, kernels=('mass_matrix',)).coordinates)} coordinates as a URDF,")
    kernel = eomgen.build(robot, kernels=("mass_matrix",))
    print(f"{kernel.n} with deviations: {', '.join(kernel.coordinates)}")

    # 1. How does it sag, by its own weight and under 20 N at the fingertips?
    for load in (0.0, 20.0):
        found = deflection(robot, POSE, frame="fingertips", loads={"fingertips": [0, 0, -load, 0, 0, 0]})
        print(f"{load:4.0f} N down: the fingertips sag by {-1e6 * found.deflection[2]:.1f} um")
    print(f"stiffness of the fingertips, z: {1e-6 / found.compliance[2, 2]:.3f} N/um")

    # 2. What does it ring at, with the drives locked?
    lowest = modes(robot, POSE, frame="fingertips")
    for hertz, ratio in list(zip(lowest.frequencies, lowest.damping_ratios, strict=True))[:3]:
        print(f"mode at {hertz:.1f} Hz, damped {100 * ratio:.1f} %")

    # 3. How far is the tool off during a motion, and whose fault is it?
    result = eomgen.run_scenario(robot, scenario_from_toml(MOTION))
    off = np.linalg.norm(result.tool_deviation, axis=1)
    print(f"in motion the fingertips are off by up to {1e6 * off.max():.0f} um")
    print("\n".join(budget(result, robot).lines()[:8]))


if __name__ == "__main__":
    main()
