"""Robots in which nothing is zero by accident."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Placement, Robot
from tests.support.random_robots import random_link, random_rotation


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
