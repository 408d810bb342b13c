"""A mass on a spring, and an arm that bends in all coordinates: what integrations are tested with."""

from __future__ import annotations

import numpy as np

from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Robot
from tests.support.random_robots import random_placement

NEEDED = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "energy")
MASS, STIFFNESS, DAMPING = 2.0, 800.0, 4.0


def oscillator(damping: float | None = DAMPING, gravity: float = 0.0) -> Robot:
    """A mass on a spring along z: w = 20 rad/s, and 5 percent of critical damping."""
    link = Link("mass", MASS, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    joint = Joint("slide", "base", "mass", "prismatic", coordinates={"z": Coordinate(STIFFNESS, damping)})
    return Robot("oscillator", (0.0, 0.0, gravity), (link,), (joint,))


def elastic_arm(seed: int = 5, damping: float = 1.0) -> Robot:
    """Two revolute joints of six coordinates, all with springs; about 1 to 20 Hz."""
    rng = np.random.default_rng(seed)
    table = {name: Coordinate(400.0, damping or None) for name in COORDINATES}
    links, joints = [], []
    for i, parent in ((1, "base"), (2, "link1")):
        com = tuple(float(x) for x in rng.uniform(-0.2, 0.2, 3))
        a, b, c = (float(x) for x in rng.uniform(0.02, 0.1, 3))
        links.append(Link(f"link{i}", float(rng.uniform(1.0, 4.0)), com, (b + c, a + c, a + b, 0.0, 0.003, -0.002)))
        joints.append(Joint(f"joint{i}", parent, f"link{i}", "revolute", random_placement(rng), coordinates=table))
    return Robot(f"arm{seed}", (0.0, 3.0, -9.0), tuple(links), tuple(joints))
