"""Contacts of journals in round bearings written once more, with branches, 3D rotations and complex steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from eomgen.robot.elements.journal import Radial, SlidingFriction
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Robot
from tests.oracles.force_laws import smooth
from tests.support.random_robots import Array

STEP = 1e-30


def random_journals(robot: Robot, seed: int) -> Robot:
    """The robot with journals in about half of its moving joints, large enough to count in states of size 1."""
    rng, joints, count = np.random.default_rng(seed), [], 0
    for joint in robot.joints:
        if joint.coordinates and (rng.random() < 0.5 or not count):
            radial = random_radial(rng, turning="gamma" in joint.coordinates, kind=count)
            table = {name: joint.coordinates.get(name, Coordinate()) for name in COORDINATES}
            wanted = {*joint.coordinates, *radial.coordinates}
            joint = replace(joint, coordinates={k: v for k, v in table.items() if k in wanted}, radial=radial)
            count += 1
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


def random_radial(rng: np.random.Generator, turning: bool, kind: int) -> Radial:
    """Numbers of a journal; every other one has a length."""
    c, k, w, length, loss, mu, radius, rounding = rng.uniform(
        (0.05, 50.0, 0.05, 0.4, 0.1, 0.05, 0.05, 0.1), (0.3, 200.0, 0.4, 1.0, 1.5, 0.5, 0.4, 0.5)
    ).tolist()
    friction = SlidingFriction(mu, radius if turning else None, rounding) if rng.random() < 0.7 else None
    return Radial(c, k, length if kind % 2 == 0 else None, loss if rng.random() < 0.7 else None, w, friction)


@dataclass(frozen=True)
class Push:
    """One contact: distance from the axis, normal force, sliding rate, forces on the six coordinates, energy."""

    e: float
    normal: float
    slide: float
    force: Array
    energy: float


def contacts(given: Radial, q: Array, v: Array) -> Iterator[Push]:
    """Every contact of a journal whose joint has these six coordinates and rates."""
    c, w = given.clearance, given.smoothing
    assert w is not None
    for h in (0.0,) if given.length is None else (0.5 * given.length, -0.5 * given.length):
        at, arms = centre(q, h), np.array([centre(q + STEP * 1j * e, h).imag / STEP for e in np.eye(6)]).T
        e = float(np.hypot(*at))
        n = at / e if e > 0.0 else np.zeros(2)
        rate = arms @ v
        d, slope = smooth(e - c, w), min(max((e - c) / w, 0.0), 1.0)
        loss = given.restitution_damping or 0.0
        normal = given.stiffness * d * max(0.0, 1.0 + loss * slope * float(n @ rate))
        t, slide, rubbing = np.array([-n[1], n[0]]), 0.0, 0.0
        force = arms.T @ (normal * n)
        if given.friction is not None:
            radius = given.friction.radius or 0.0
            slide = float(t @ rate + radius * v[5])
            rounding = given.friction.smoothing
            assert rounding is not None
            rubbing = given.friction.coefficient * normal * slide / np.hypot(slide, rounding)
            force = force + arms.T @ (rubbing * t) + radius * rubbing * np.eye(6)[5]
        x = e - c
        stored = 0.0 if x <= 0.0 else x**3 / (6.0 * w) if x < w else w * w / 6.0 + 0.5 * x * (x - w)
        yield Push(e, normal, slide, -force, given.stiffness * stored)


def centre(q: Array, h: float) -> Array:
    """Where a point of the journal's axis is across the bearing's, by eq. (3)."""
    (ca, sa), (cb, sb) = ((np.cos(x), np.sin(x)) for x in q[3:5])
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    return np.asarray((q[:3] + about_x @ about_y @ np.array([0.0, 0.0, h]))[:2])


def pushes(robot: Robot, q: Array, v: Array) -> dict[str, list[Push]]:
    """The contacts of a robot's journals, by their joints' names."""
    names = build_model(robot).coordinates
    found: dict[str, list[Push]] = {}
    for joint in robot.joints:
        if joint.radial is not None:
            six = [names.index(f"{joint.name}.{key}") if key in joint.coordinates else -1 for key in COORDINATES]
            own = [np.array([x[i] if i >= 0 else 0.0 for i in six]) for x in (q, v)]
            found[joint.name] = list(contacts(joint.radial, *own))
    return found


def generalized(robot: Robot, q: Array, v: Array) -> tuple[Array, float]:
    """Forces of all journals on the robot's coordinates, (n,), and their energy."""
    names = build_model(robot).coordinates
    total, energy = np.zeros(len(names)), 0.0
    for joint, parts in pushes(robot, q, v).items():
        for part in parts:
            energy += part.energy
            for key, value in zip(COORDINATES, part.force, strict=True):
                if f"{joint}.{key}" in names:
                    total[names.index(f"{joint}.{key}")] += value
    return total, energy


def without(robot: Robot) -> Robot:
    """The same robot without its journals' contacts."""
    return replace(robot, joints=tuple(replace(joint, radial=None) for joint in robot.joints))


def step_matrix(robot: Robot, q: Array, v: Array, dt: float) -> tuple[Array, Array]:
    """What journals add to the matrix of a linearly implicit step, (n, n), and to the forces on its right side, (n,).

    Contacts are where the rates lead to, with the directions of motion that they have at q.
    """
    names: Mapping[str, int] = {name: i for i, name in enumerate(build_model(robot).coordinates)}
    matrix, force = np.zeros((len(names) + 1,) * 2), np.zeros(len(names) + 1)  # the last one takes what is not there
    for joint in robot.joints:
        given = joint.radial
        if given is not None:
            six = [names.get(f"{joint.name}.{key}", len(names)) for key in COORDINATES]
            own = [np.array([x[i] if i < len(names) else 0.0 for i in six]) for x in (q, v)]
            for h in (0.0,) if given.length is None else (0.5 * given.length, -0.5 * given.length):
                one, push = _contact_step(given, h, *own, dt)
                matrix[np.ix_(six, six)] += one
                np.add.at(force, six, push)
    return matrix[:-1, :-1], force[:-1]


def _contact_step(given: Radial, h: float, q: Array, v: Array, dt: float) -> tuple[Array, Array]:
    """The same of one contact on a joint's six coordinates, (6, 6) and (6,)."""
    arms = np.array([centre(q + STEP * 1j * e, h).imag / STEP for e in np.eye(6)]).T
    flat, rates = np.zeros(6), np.zeros(6)
    flat[:2], rates[:2], rates[5] = centre(q, h) + dt * (arms @ v), arms @ v, v[5]
    (push,) = contacts(replace(given, length=None), flat, rates)
    at = flat[:2] / push.e
    near, around = at @ arms, np.array([-at[1], at[0]]) @ arms
    speed, step = float(at @ rates[:2]), 1e-7
    by_s, by_v = (
        (normal_force(given, push.e + x, speed + y) - normal_force(given, push.e - x, speed - y)) / (2 * step)
        for x, y in ((step, 0.0), (0.0, step))
    )
    matrix = max(dt * by_v + dt * dt * by_s, 0.0) * np.outer(near, near)
    matrix += dt * dt * push.normal / push.e * np.outer(around, around)
    if given.friction is not None:
        assert given.friction.smoothing is not None
        sliding = around + (given.friction.radius or 0.0) * np.eye(6)[5]
        secant = given.friction.coefficient * push.normal / np.hypot(push.slide, given.friction.smoothing)
        matrix += dt * secant * np.outer(sliding, sliding)
    return matrix, arms.T @ push.force[:2] + push.force[5] * np.eye(6)[5]


def normal_force(given: Radial, e: float, speed: float) -> float:
    """The normal force at a distance from the axis and its rate."""
    place, moving = np.zeros(6), np.zeros(6)
    place[0], moving[0] = e, speed
    return next(contacts(replace(given, length=None, friction=None), place, moving)).normal
