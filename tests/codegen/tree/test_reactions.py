"""Support reactions: they carry weights and loads, and they are what springs of elastic joints do in the limit."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.kernel.complete import Kernel
from eomgen.robot.model import FIXED_BODY, build_model
from eomgen.robot.value import Robot
from eomgen.state.equilibrium import static_equilibrium
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, random_state, seeds


def on_the_base(robot: Robot, kernel: Kernel, q: Array, reactions: Array) -> Array:
    """Sum of the wrenches of the joints next to the base, about the base's origin in its axes, (6,)."""
    total = np.zeros(6)
    for body, reaction in zip(build_model(robot).bodies, reactions, strict=True):
        if body.parent != FIXED_BODY:
            continue
        joint = robot.joint(body.joint)
        pose = kernel.frame_pose(q, joint.child)
        R = pose[:3, :3] @ np.array(joint.axis_turn)  # of the joint's frame
        force, moment = R @ reaction[:3], R @ reaction[3:]
        total += np.concatenate([force, moment + np.cross(pose[:3, 3], force)])
    return total


@pytest.mark.parametrize("seed", seeds(60, 2, 12))
def test_the_base_carries_weights_and_loads(seed: int, built: Build) -> None:
    """At rest the joints next to the base hold the weights of all moving links, and external wrenches on them."""
    robot = random_robot(seed, joints=(3, 6), tree=True, types=("revolute", "prismatic", "free"))
    kernel, s = built(robot, "reactions", "external_reactions", "kinematics"), random_state(robot, seed)
    zero = np.zeros(kernel.n)
    gravity = np.array(robot.gravity)
    wrench = np.random.default_rng(seed).normal(size=(len(kernel.links), 6))
    weight, load = np.zeros(6), np.zeros(6)
    for name, given in zip(kernel.links, wrench, strict=True):
        link, pose = robot.link(name), kernel.frame_pose(s.q, name)
        com = pose[:3, :3] @ np.array(link.com) + pose[:3, 3]
        weight += np.concatenate([link.mass * gravity, np.cross(com, link.mass * gravity)])
        load += np.concatenate([given[:3], given[3:] + np.cross(com, given[:3])])
    held = on_the_base(robot, kernel, s.q, kernel.reactions(s.q, zero, zero))
    assert np.abs(held + weight).max() <= 1e-11 * np.abs(weight).max()
    held = on_the_base(robot, kernel, s.q, kernel.reactions(s.q, zero, zero, wrench=wrench))
    assert np.abs(held + weight + load).max() <= 1e-11 * np.abs(weight).max()


def test_springs_of_stiff_joints_are_the_rigid_joints_reactions(built: Build) -> None:
    """At rest under gravity: k s of every deviation goes to the component of the rigid robot's reaction, as 1 / k."""
    elastic, rigid = eomgen.load_robot("puma560_elastic"), eomgen.load_robot("puma560_elastic").rigid()
    kernel = built(elastic)
    stiff = built(rigid, "reactions")
    pose = np.array([0.3, -0.8, 0.5, 0.4, 0.7, -0.2])
    principal = [i for i, name in enumerate(kernel.coordinates) if name.endswith(".gamma")]
    guess, zero = np.zeros(kernel.n), np.zeros(6)
    guess[principal] = pose
    reactions = stiff.reactions(pose, zero, zero)
    given = {name: value for name, value in kernel.parameters.items() if name.endswith(".stiffness")}
    errors = []
    for factor in (1.0, 10.0, 100.0):
        kernel.parameters.update({name: factor * value for name, value in given.items()})
        q, _ = static_equilibrium(kernel, guess, fixed=[kernel.coordinates[i] for i in principal])
        error = 0.0
        for k, joint in enumerate(kernel.joints):
            for place, name in enumerate(("x", "y", "z", "alpha", "beta")):
                coordinate = f"{joint}.{name}"
                spring = -factor * given[f"joints.{coordinate}.stiffness"] * q[kernel.coordinates.index(coordinate)]
                turned = _at_coordinate(name, pose[k], reactions[k])
                error = max(error, abs(spring - turned[place]) / np.abs(reactions[k]).max())
        errors.append(error)
    assert errors[0] <= 0.02
    assert errors[1] <= 0.15 * errors[0]
    assert errors[2] <= 0.15 * errors[1]


def _at_coordinate(name: str, gamma: float, reaction: Array) -> Array:
    """The reaction in the axes before the turn gamma about z, in which a joint's deviations come."""
    c, s = np.cos(gamma), np.sin(gamma)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([R @ reaction[:3], R @ reaction[3:]])
