"""Limits that motions exceed, of columns whose extremes are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen.motion.exceeding import ROUND_OFF, Excess, excess_notes, excesses
from eomgen.robot.bounds import Limits
from eomgen.robot.value import Coordinate, Coupling, Joint, Link, Motor, Robot

LIMITS = Limits(-0.5, 2.0, 3.0, 4.0)


def robot(limits: Limits = LIMITS) -> Robot:
    """A rod that a motor turns through a gear of -10, and a slide in front of it."""
    rod = Link("rod", 1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    motor = Motor(1e-3, -10.0, Coordinate(stiffness=1e4), limits=Limits(velocity=20.0))
    hinge = Joint("hinge", "sled", "rod", "revolute", coordinates={"gamma": Coordinate()}, motor=motor)
    slide = Joint("slide", "base", "sled", "prismatic", coordinates={"z": Coordinate()})
    sled = replace(rod, name="sled")
    return Robot("arm", (0.0, 0.0, 0.0), (sled, rod), (slide, hinge.with_limits("gamma", limits)))


def test_the_worst_of_each_is_told() -> None:
    t = np.linspace(0.0, 1.0, 11)
    q = np.zeros((11, 3))
    q[3, 1], q[5, 1], q[7] = -0.7, 2.1, 1.0
    v, u = np.zeros((11, 3)), np.zeros((11, 3))
    v[4, 1], v[6, 2] = -3.5, 19.0
    u[8, 2], u[9] = -0.5, 0.3  # at the motor, where 4 N m at the joint are 0.4
    names = ("slide.z", "hinge.gamma", "hinge.motor")
    found = excesses(robot(), names, t=t, q=q, v=v, u=u)
    assert found == (
        Excess("hinge.gamma", "position", -0.7, -0.5, "rad", t[3]),
        Excess("hinge.gamma", "speed", -3.5, 3.0, "rad/s", t[4]),
        Excess("hinge.motor", "effort", -0.5, 0.4, "N m", t[8]),
    )
    (note,) = excess_notes("the motion", found)
    assert note == (
        "the motion exceeds limits of the robot: hinge.gamma position -0.7 rad at 0.3 s (limit -0.5), hinge.gamma speed"
        " -3.5 rad/s at 0.4 s (limit 3), hinge.motor effort -0.5 N m at 0.8 s (limit 0.4)"
    )
    assert excess_notes("the motion", ()) == ()
    assert "and 1 more" in excess_notes("it", found * 3)[0]


@pytest.mark.parametrize(("part", "tells"), [(0.5, False), (2.0, True)])
def test_round_off_is_within(part: float, tells: bool) -> None:
    beyond = part * ROUND_OFF
    names = ("slide.z", "hinge.gamma", "hinge.motor")
    for rows in (
        {"q": np.array([[0.0, 2.0 * (1.0 + beyond), 0.0]])},
        {"v": np.array([[0.0, -3.0 * (1.0 + beyond), 0.0]])},
        {"u": np.array([[0.0, 0.0, 0.4 * (1.0 + beyond)]])},
    ):
        assert bool(excesses(robot(), names, **rows)) == tells
    open_end = robot(Limits(upper=0.0))
    assert bool(excesses(open_end, names, q=np.array([[0.0, beyond, 0.0]]))) == tells
    assert not excesses(open_end, names, q=np.array([[0.0, -1e9, 0.0]]))
    assert not excesses(robot(Limits()), names, q=np.full((1, 3), 1e3), v=np.full((1, 3), 19.0), u=np.full((1, 3), 1e3))


def test_followers_have_limits_of_their_own() -> None:
    """A finger at -2 times its leader plus 0.1: position and speed, by the coupling's numbers."""
    rod = Link("one", 1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    joints = [Joint(x, "base", x, "revolute", coordinates={"gamma": Coordinate()}) for x in ("one", "two")]
    joints[1] = joints[1].with_limits("gamma", LIMITS)
    gear = Coupling("gear", "two.gamma", {"one.gamma": -2.0}, 0.1)
    hand = Robot("hand", (0.0, 0.0, 0.0), (rod, replace(rod, name="two")), tuple(joints), couplings=(gear,))
    q, v = np.array([[0.0], [0.4], [-0.9]]), np.array([[1.6], [0.0], [0.0]])
    assert excesses(hand, ("one.gamma",), q=q, v=v) == (
        Excess("two.gamma", "position", pytest.approx(-0.7), -0.5, "rad"),
        Excess("two.gamma", "speed", pytest.approx(-3.2), 3.0, "rad/s"),
    )
    assert excesses(hand, ("one.gamma",), q=0.1 * q, v=0.1 * v) == ()
