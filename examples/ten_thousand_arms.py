"""Ten thousand arms: which tolerance matters?

    python examples/ten_thousand_arms.py [SAMPLES]

Every arm of a series is a little different: its joints are bored at slightly other angles, its bearings are softer or
stiffer, its gripper is heavier.  The same motion is simulated for each of them; then the tolerances are ranked by what
they do to the fingertips.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import eomgen
from eomgen.sweep import plan_from_toml, run

HERE = Path(__file__).parent

MOTION = {
    "duration": 0.6,
    "frame": "fingertips",
    "motion": {
        "type": "point_to_point",
        "start": {"shoulder": 0.4, "elbow": -0.9, "wrist": 0.5},
        "goal": {"waist": 0.5, "shoulder": 0.6, "elbow": -1.1, "wrist": 0.5},
        "duration": 0.45,
    },
}

PLAN = """
samples = {samples}
seed = 1
design = "latin_hypercube"
record = ["tool_deviation_max", "tool_deviation_end"]

[[vary]]                                   # bores: 0.1 mrad
parameter = "joints.elbow.offset.alpha"
normal = {{ mean = 0.0, deviation = 1e-4 }}

[[vary]]
parameter = "joints.shoulder.offset.beta"
normal = {{ mean = 0.0, deviation = 1e-4 }}

[[vary]]                                   # bearings: 10 percent
parameter = "joints.waist.beta.stiffness"
normal = {{ mean = 1.0, deviation = 0.1, low = 0.5, high = 1.5 }}
relative = true

[[vary]]
parameter = "joints.shoulder.beta.stiffness"
normal = {{ mean = 1.0, deviation = 0.1, low = 0.5, high = 1.5 }}
relative = true

[[vary]]
parameter = "joints.wrist.beta.stiffness"
normal = {{ mean = 1.0, deviation = 0.1, low = 0.5, high = 1.5 }}
relative = true

[[vary]]                                   # the gripper's mass, of which the drives know the nominal value
parameter = "links.gripper.mass"
uniform = {{ low = 0.99, high = 1.01 }}
"""


def main(samples: int) -> None:
    robot = eomgen.load_robot(HERE / "gripper_arm_elastic.toml")
    with tempfile.TemporaryDirectory() as folder:
        result = run(robot, MOTION, plan_from_toml(PLAN.format(samples=samples)), Path(folder) / "sweep")
    low, median, high = 1e6 * result.percentiles("tool_deviation_max", (5.0, 50.0, 95.0))
    print(f"{samples} arms: off by {median:.0f} um at most, 90 % of them by {low:.0f} to {high:.0f} um")
    found = result.sensitivity("tool_deviation_max")
    print("\n".join(result.lines()))
    best = found.ranking[0]
    print(f"what matters most: {found.names[best]}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
