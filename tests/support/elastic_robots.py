"""Random robots whose joints give way, with springs and dampers of numbers that suit integrations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomgen.robot.value import COORDINATES, Coordinate, Link, Robot
from tests.support.random_robots import random_robot, with_offsets


def elastic_robot(seed: int, joints: int = 3, tree: bool = False) -> Robot:
    """Joints of all six coordinates, each with a spring, a damper and a third with armature; compact links.

    Springs of 50 to 500 N/m or N m/rad, at some kg and kg m^2: about 1 to 10 Hz.
    """
    rng = np.random.default_rng(seed)
    types = ("revolute", "prismatic")
    robot = random_robot(rng, (joints, joints), types=types, tree=tree, forces=False, name=f"mujoco{seed}")
    links = tuple(_compact(rng, link) for link in robot.links)
    moving = []
    for joint in robot.joints:
        table = {name: _properties(rng) for name in COORDINATES} if joint.coordinates else {}
        moving.append(replace(joint, coordinates=table))
    return replace(robot, links=links, joints=tuple(moving))


def _properties(rng: np.random.Generator) -> Coordinate:
    stiffness, damping = rng.uniform(50.0, 500.0), rng.uniform(0.5, 5.0)
    armature = rng.uniform(0.01, 0.3) if rng.random() < 0.3 else None
    return Coordinate(float(stiffness), float(damping), None if armature is None else float(armature))


def _compact(rng: np.random.Generator, link: Link) -> Link:
    """A body of at least a decimetre in all directions: MuJoCo takes no thin rod, and nothing swings fast."""
    a, b, c = (float(value) for value in rng.uniform(0.02, 0.1, 3))  # principal second moments
    com = tuple(float(0.5 * value) for value in link.com)
    return Link(link.name, float(rng.uniform(1.0, 6.0)), com, (b + c, a + c, a + b, 0.003, -0.002, 0.001))


def random_elastic(seed: int) -> Robot:
    """A random robot with dampers everywhere and springs on all deviations; seeds from 4 have offsets."""
    robot = random_robot(seed, joints=(2, 3), tree=seed % 2 == 0, types=("revolute", "prismatic", "fixed"))
    rng = np.random.default_rng(seed)
    joints = []
    for joint in robot.joints:
        principal = {"revolute": "gamma", "prismatic": "z"}.get(joint.type)
        table = {
            name: replace(
                given,
                stiffness=None if name == principal else float(rng.uniform(3e3, 3e4)),
                damping=float(rng.uniform(0.5, 20.0)),
            )
            for name, given in joint.coordinates.items()
        }
        joints.append(replace(joint, coordinates=table))
    robot = replace(robot, joints=tuple(joints))
    return with_offsets(robot, seed) if seed >= 4 else robot
