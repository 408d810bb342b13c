"""Random robots with a joint that slides along a link that bends, in front of another one that bends."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eomgen.robot.geometry import COORDINATES
from eomgen.robot.model import build_model
from eomgen.robot.sections import AXES
from eomgen.robot.value import (
    BeamModes,
    Coordinate,
    Coupling,
    Frame,
    Joint,
    Link,
    LinkBeam,
    Placement,
    Robot,
    ShapesAlong,
    sliding_joint,
)
from tests.oracles.bending_lagrange import BendingOracle, Rail
from tests.support.bending_robots import bent
from tests.support.random_robots import Array, State

LENGTH = 1.4  # m, of the link along which the joint slides
NO_BEAM = LinkBeam(LENGTH, 7e10, 2.6e10, 4e-4, 2e-8, 5e-8, 3e-8, (0.85, 0.8), 2700.0, BeamModes(1))  # its length counts


def sliding_robot(seed: int, *, follows: bool = False) -> tuple[Robot, BendingOracle]:
    """Return a robot as eomgen takes it, and Lagrange's equations of it.

    Args:
        seed: of its numbers, and of the axis of the beam.
        follows: whether the coordinate that slides follows that of another joint.
    """
    rng = np.random.default_rng([seed, 77])
    names, joints = ("arm", "trolley", "fore"), []
    links = [
        Link(x, rng.uniform(1, 3), _tuple(0.2 * rng.normal(size=3)), (0.5, 0.6, 0.7, 0.05, 0.0, 0.1)) for x in names
    ]
    for joint, parent, child, kind in (
        ("shoulder", "base", "arm", "revolute"),
        ("cross", "arm", "trolley", "prismatic"),
        ("sway", "trolley", "fore", "revolute"),
    ):
        principal = "z" if kind == "prismatic" else "gamma"
        coordinate = Coordinate(stiffness=2.0, damping=0.1, armature=0.2)
        placement = Placement.from_rpy(_tuple(0.3 * rng.normal(size=3)), _tuple(rng.normal(size=3)))
        joints.append(Joint(joint, parent, child, kind, placement, coordinates={principal: coordinate}))
    axis = list(AXES)[seed % len(AXES)]
    gravity = _tuple(3.0 * rng.normal(size=3))
    plain = Robot("sliding", gravity, tuple(links), tuple(joints), (Frame("tool", "fore"), Frame("on", "trolley")))
    bending = bent(plain, seed, (2, 3))
    arm = bending.plain.link("arm")
    m, beam = arm.modes.count, replace(NO_BEAM, axis=axis)
    first = 0.3 * rng.normal(size=(6, m, 4)) * (rng.random(6) < 0.7)[:, None, None]
    half = 0.2 * rng.normal(size=(6, m, m, 3)) * (np.arange(6) < 3)[:, None, None, None] * (rng.random() < 0.7)
    second = half + half.transpose(0, 2, 1, 3)
    parts = sliding_joint(plain.joint("cross"), replace(arm, beam=beam), _shapes(first, second))
    slides, place = parts.joints
    straight = replace(plain.joint("cross"), placement=slides.placement)
    more = (Coupling("belt", "cross.z", {"shoulder.gamma": 0.4}, 0.3),) if follows else ()
    described = replace(
        bending.plain, joints=tuple(straight if x.name == "cross" else x for x in plain.joints), couplings=more
    )
    nodes = {x: y for x, y in bending.nodes.items() if x != "cross"}
    whole = replace(bending, plain=described, nodes=nodes, frames={})
    robot = whole.robot
    made = [y for x in robot.joints for y in ((slides, place) if x.name == "cross" else (x,))]
    robot = replace(
        robot, links=(*robot.links, parts.link), joints=tuple(made), couplings=(*robot.couplings, *parts.couplings)
    )
    rails = {"cross": Rail(LENGTH, first, second)}
    oracle = BendingOracle(described, whole.clouds, whole.nodes, build_model(robot).coordinates, rails)
    return robot, oracle


def sliding_state(robot: Robot, seed: int) -> State:
    """Draw a state: modal coordinates up to 0.4, the joint on the beam."""
    names = build_model(robot).coordinates
    rng = np.random.default_rng([seed, 78])
    q, v, a, u = rng.uniform(-1.0, 1.0, (4, len(names)))
    q = np.where(["mode" in name for name in names], 0.4 * q, q)
    return State(np.where([name == "cross.z" for name in names], LENGTH * (0.5 + 0.4 * q), q), v, a, u)


def _shapes(first: Array, second: Array) -> ShapesAlong:
    m = range(first.shape[1])
    return ShapesAlong(
        {kind: [(k, _tuple(row[k])) for k in m] for kind, row in zip(COORDINATES, first, strict=True) if row.any()},
        {
            kind: [(k, j, _tuple(row[k, j])) for k in m for j in m if k <= j]
            for kind, row in zip(COORDINATES, second, strict=True)
            if row.any()
        },
    )


def _tuple(x: Array) -> Any:
    return tuple(map(float, x))
