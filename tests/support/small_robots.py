"""Small robots that several tests use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Robot

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
