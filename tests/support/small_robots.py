"""Small robots that several tests use, an arm for pictures, and robots in which nothing is zero by accident."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Placement, Robot
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.random_robots import random_link, random_rotation
from tests.support.random_springs import with_springs

Q0, V0 = np.array([0.1, -0.2, 0.3, 0.3, 0.2, 0.1]), np.array([0.1, -0.2, 0.3, 2.0, 3.0, 1.0])  # of the body


def free_body() -> Robot:
    """One body that may move in every way."""
    link = Link("body", 2.0, (0.1, 0.0, 0.05), (0.1, 0.12, 0.09, 0.01, 0.0, 0.0))
    joint = Joint("free", "base", "body", "free", coordinates=dict.fromkeys(COORDINATES, Coordinate()))
    return Robot("free_body", (0.0, 0.0, -9.81), (link,), (joint,))


def tumbler() -> Robot:
    """The body with nothing on it, not even its weight."""
    return replace(free_body(), name="tumbler", gravity=(0.0, 0.0, 0.0))


def held_body() -> Robot:
    """One body with all six coordinates, of which one has a law of no force: its joint stays as it is described."""
    robot = free_body()
    (joint,) = robot.joints
    held = replace(joint, coordinates={**joint.coordinates, "gamma": Coordinate(preload=0.0)})
    return replace(robot, name="held_body", joints=(held,))


def generic(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with placements and links in which nothing is zero by accident (and nothing is welded on)."""

    def placement() -> Placement:
        x, y, z = rng.uniform(0.2, 0.6, 3)
        r, p, w = rng.uniform(0.3, 1.2, 3)
        return Placement.from_rpy((x, y, z), (r, p, w))

    def link(name: str) -> Link:
        made = random_link(rng, name)
        J = random_rotation(rng) @ np.diag(rng.uniform(0.01, 0.1, 3))
        tensor = np.trace(J @ J.T) * np.eye(3) - J @ J.T
        inertia = tuple(float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        x, y, z = (float(c) for c in rng.uniform(0.1, 0.3, 3))
        return replace(made, com=(x, y, z), inertia=inertia)  # type: ignore[arg-type]

    joints = tuple(replace(joint, placement=placement()) for joint in robot.joints)
    return replace(robot, joints=joints, links=tuple(link(old.name) for old in robot.links))


def chain(joints: int) -> Robot:
    """A chain of joints with all six coordinates active, generic placements and links."""
    rng = np.random.default_rng(7)
    links = tuple(random_link(rng, f"link{i + 1}") for i in range(joints))
    active = {name: Coordinate() for name in COORDINATES}
    parents = ["base", *(link.name for link in links)]
    made = tuple(Joint(f"joint{i + 1}", parents[i], links[i].name, "free", coordinates=active) for i in range(joints))
    return generic(Robot("chain", (0.0, 0.0, -9.81), links, made), rng)


ARM = f"""
name = "arm"
{link_table("link1", 3.0, (0.2, 0.0, 0.0), (0.01, 0.05, 0.05))}
{link_table("link2", 1.5, (0.15, 0.0, 0.0), (0.005, 0.02, 0.02))}
{joint_table("joint1", "base", "link1", "revolute")}
x = {{ stiffness = 2e5, damping = 80.0 }}
alpha = {{ stiffness = 4e3, damping = 3.0 }}
{joint_table("joint2", "link1", "link2", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }}
y = {{ stiffness = 1e5, damping = 60.0 }}
gamma = {{ damping = 0.2 }}
{frame_table("tcp", "link2", (0.3, 0.0, 0.0))}
"""


def bending_arm() -> Robot:
    """The arm with a spring of every kind between its links."""
    return with_springs(robot_from_toml(ARM), 0)
