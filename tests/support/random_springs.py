"""Springs between points with random numbers, of every kind."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eomgen.robot.model import build_model
from eomgen.robot.value import Robot, Spring
from tests.support.random_robots import random_robot

KINDS = ("linear", "zero", "zero damped", "cable", "curve", "damper")


def random_spring(rng: np.random.Generator, name: str, links: tuple[str, str], kind: str) -> Spring:
    """A spring of a kind whose numbers count at lengths of about 1 m."""
    points = tuple(tuple(float(x) for x in rng.uniform(-0.5, 0.5, 3)) for _ in range(2))

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    spring = Spring(name, links, points)  # type: ignore[arg-type]
    if kind == "linear":
        return replace(spring, free_length=draw(0.1, 1.5), stiffness=draw(20.0, 200.0), damping=draw(0.0, 10.0))
    if kind == "zero":
        return replace(spring, stiffness=draw(20.0, 200.0), free_length=0.0 if rng.random() < 0.3 else None)
    if kind == "zero damped":
        return replace(spring, stiffness=draw(20.0, 200.0), damping=draw(1.0, 10.0))
    if kind == "cable":
        smoothing = draw(0.05, 0.5) if rng.random() < 0.7 else None
        return replace(
            spring, tension_only=True, free_length=draw(0.3, 1.0), stiffness=draw(50.0, 200.0),
            damping=draw(1.0, 20.0), smoothing=smoothing,
        )  # fmt: skip
    if kind == "curve":
        knots = np.cumsum(rng.uniform(0.1, 0.5, 5)) - 0.8
        forces = rng.uniform(-30.0, 30.0, 5)
        curve = tuple((float(x), float(y)) for x, y in zip(knots, forces, strict=True))
        return replace(spring, free_length=draw(0.2, 1.0), curve=curve, damping=draw(0.0, 5.0))
    return replace(spring, damping=draw(1.0, 20.0))


def with_springs(robot: Robot, seed: int, kinds: tuple[str, ...] = KINDS) -> Robot:
    """The robot with a spring of every kind between random links that move against each other."""
    rng = np.random.default_rng(seed)
    body_of = build_model(robot).body_of
    links = [robot.base, *(link.name for link in robot.links)]
    pairs = [(a, b) for a in links for b in links if body_of[a] != body_of[b]]
    springs = []
    for i, kind in enumerate(kinds):
        springs.append(random_spring(rng, f"spring{i + 1}", pairs[int(rng.integers(len(pairs)))], kind))
    return replace(robot, springs=tuple(springs))


TYPES = ("revolute", "prismatic", "fixed", "free")


def sprung(seed: int, joints: tuple[int, int] = (1, 4), **options: Any) -> Robot:
    """A random chain or tree with a spring of every kind; some joints with offsets."""
    rng = np.random.default_rng(seed)
    robot = random_robot(seed, joints=joints, tree=seed % 2 == 0, types=TYPES, **options)
    moved = [
        replace(j, offset=tuple(float(x) for x in rng.uniform(-0.2, 0.2, 6))) if j.coordinates and seed % 3 == 0 else j
        for j in robot.joints
    ]
    return with_springs(replace(robot, joints=tuple(moved)), seed)
