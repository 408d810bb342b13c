"""What a description says of inertia: whether accelerations can be found at all, before anything is generated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..names import listed
from ..robot.model import FIXED_BODY, Model, build_model
from ..robot.value import ANGULAR, COORDINATES, INERTIA_KEYS, LINEAR, Joint, Placement, Robot
from ..runtime.singular import VANISHED, null_coordinates, scaled_eigenvalues

Array = NDArray[np.float64]

MOST = 300  # coordinates: mass matrices of more are not looked at, so that a check stays quick
STATES = 3  # at random, which are singular by chance never all
ADVICE = "give links mass and inertia, or the coordinate an armature"


def inertia_notes(robot: Robot) -> tuple[str, ...]:
    """Lines about inertia that is missing: nothing that moves has any, or M is singular in every state."""
    if not any(joint.coordinates for joint in robot.joints):
        return ()
    model = build_model(robot)
    moving = [robot.link(name) for name in model.links]
    if not any(link.mass or any(link.inertia) for link in moving):
        return (f"0 kg: no link that moves has mass or inertia, so that there are no accelerations; {ADVICE}",)
    if model.size > MOST:
        return ()
    free = [i for i in range(model.size) if i not in model.prescribed]
    names = [model.coordinates[i] for i in free]
    found: list[str] = list(names)
    rng = np.random.default_rng(0)
    for _ in range(STATES if free else 0):
        M = mass_matrix(model, rng.uniform(0.2, 0.9, model.size))[np.ix_(free, free)]
        if scaled_eigenvalues(M)[0][0] > VANISHED:
            return ()
        null = null_coordinates(M, names)
        found = [name for name in found if name in null]
    if not found:
        return ()
    resting = [link.name for link in moving if not link.mass and not any(link.inertia)]
    without = f"; without mass and inertia: {listed(resting)}" if resting else ""
    return (f"the mass matrix is singular in every state: {listed(found)} moves no inertia{without}; {ADVICE}",)


def mass_matrix(model: Model, q: Array) -> Array:
    """M of the tree in one state, (n, n), from the Jacobians of its links.

    Args:
        model: the tree.
        q: (n,), m or rad.
    """
    robot = model.robot
    poses = {robot.base: np.eye(4)}
    columns: dict[str, list[tuple[int, bool, Array, Array]]] = {robot.base: []}  # index, turns, axis, origin
    M = np.zeros((model.size, model.size))
    index = 0
    for joint in robot.joints:
        pose = poses[joint.parent] @ _pose(joint.placement) @ _turned(joint)
        inner = list(columns[joint.parent])
        for place, name in enumerate(COORDINATES):
            value = joint.offset[place] or 0.0
            if name in joint.coordinates:
                inner.append((index, name in ANGULAR, pose[:3, place % 3].copy(), pose[:3, 3].copy()))
                M[index, index] += joint.coordinates[name].armature or 0.0
                value += float(q[index])
                index += 1
            pose = pose @ _elementary(name, value)
        if joint.motor is not None:
            M[index, index] += joint.motor.inertia
            index += 1
        poses[joint.child], columns[joint.child] = pose @ _turned(joint).T, inner
    for link in robot.links:
        if model.body_of[link.name] == FIXED_BODY:
            continue
        R, com = poses[link.name][:3, :3], poses[link.name] @ np.array([*link.com, 1.0])
        linear, angular = np.zeros((2, 3, model.size))
        for i, turns, axis, origin in columns[link.name]:
            linear[:, i] = np.cross(axis, com[:3] - origin) if turns else axis
            angular[:, i] = axis if turns else 0.0
        M += link.mass * linear.T @ linear + angular.T @ (R @ _tensor(link.inertia) @ R.T) @ angular
    return M


def _tensor(inertia: tuple[float, ...]) -> Array:
    given = dict(zip(INERTIA_KEYS, inertia, strict=True))
    return np.array([[given["".join(sorted(a + b))] for b in LINEAR] for a in LINEAR])


def _pose(placement: Placement) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = placement.rotation, placement.xyz
    return pose


def _turned(joint: Joint) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = joint.axis_turn
    return pose


def _elementary(name: str, value: float) -> Array:
    """The transform of one coordinate: a translation along an axis, or a rotation about it."""
    pose, k = np.eye(4), COORDINATES.index(name) % 3
    if name in LINEAR:
        pose[k, 3] = value
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        pose[i, i] = pose[j, j] = np.cos(value)
        pose[j, i], pose[i, j] = np.sin(value), -np.sin(value)
    return pose
