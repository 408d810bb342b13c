"""Random mechanisms with change points, at a known distance from them: where a second motion branches off."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mpmath as mp
import numpy as np

from eomgen.robot.value import Loop, Placement, Robot
from tests.support.linkages import hinge
from tests.support.random_robots import random_link, random_placement
from tests.support.recuts import placed, pose

DIGITS = 50


@dataclass(frozen=True)
class ChangePoint:
    """A mechanism.

    rank: of its constraint, but at singular poses.
    at: (distance, rad) -> coordinates by name of the closed state whose first crank is so far from the change point.
    """

    robot: Robot
    rank: int
    at: Callable[[float], Mapping[str, mp.mpf]]


def four_bar(seed: int, *, stands: bool = False, parallel: bool = False) -> ChangePoint:
    """A linkage whose four sides lie on one line at the change point.

    Args:
        stands: on a body that turns, about an axis of its own.
        parallel: with opposite sides of one length.
    """
    rng = np.random.default_rng([11, seed])
    while True:
        ground, crank, coupler = rng.uniform(0.2, 1.0, 3).tolist()
        signs = rng.choice([-1.0, 1.0], 2)
        if parallel:
            ground, crank, signs = coupler, crank, np.ones(2)
        rest = signs[0] * crank + signs[1] * coupler - ground
        if abs(rest) < 0.1:
            continue
        a, b, c = signs[0] * crank, signs[1] * coupler, rest
        ways = np.roots([b - b * b / c, -2.0 * a * b / c, a - a * a / c])  # the coupler's rate by the crank's
        if len(ways) == 2 and np.isreal(ways).all() and abs(ways[0] - ways[1]) > 0.2 and np.abs(ways).max() < 20.0:
            break
    way, rocker = float(rng.choice(ways.real)), abs(rest)
    begin = [0.0 if sign > 0.0 else 1.0 for sign in (*signs, rest)]
    rates = (1.0, way, (a + b * way) / c)
    stand = random_placement(rng)
    names, joints, base = ["crank", "coupler", "rocker"], [], "base"
    if stands:
        names, base = ["stand", *names], "stand"
        joints.append(hinge("turn", "base", "stand", random_placement(rng)))
    joints += [
        hinge("joint1", base, "crank", stand),
        hinge("joint2", "crank", "coupler", _at(crank)),
        hinge("joint3", base, "rocker", placed(pose(stand) @ pose(_at(ground)))),
    ]
    links = tuple(random_link(rng, name, rods=False) for name in names)
    cut = Loop("joint4", ("rocker", "coupler"), "revolute", (_at(rocker), _at(coupler)))
    robot = Robot(f"bar{seed}", (0.0, -9.81, 0.0), links, tuple(joints), loops=(cut,))

    def at(distance: float) -> Mapping[str, mp.mpf]:
        with mp.workdps(DIGITS):
            first, second, third = (
                mp.pi * turn + mp.mpf(distance) * rate for turn, rate in zip(begin, rates, strict=True)
            )
            for _ in range(60):
                gap = mp.matrix(
                    [
                        crank * mp.cos(first) + coupler * mp.cos(second) - ground - rocker * mp.cos(third),
                        crank * mp.sin(first) + coupler * mp.sin(second) - rocker * mp.sin(third),
                    ]
                )
                slope = mp.matrix(
                    [
                        [-coupler * mp.sin(second), rocker * mp.sin(third)],
                        [coupler * mp.cos(second), -rocker * mp.cos(third)],
                    ]
                )
                step = mp.lu_solve(slope, gap)
                second, third = second - step[0], third - step[1]
                if mp.norm(step) < 1e-40:
                    break
            found = {"joint1.gamma": first, "joint2.gamma": second - first, "joint3.gamma": third}
            return {**found, "turn.gamma": mp.mpf(0.3)}

    return ChangePoint(robot, 2, at)


def three_cranks(seed: int, home: float = 0.0) -> ChangePoint:
    """A rod on three parallel cranks of one length, one of which is redundant; all lie on one line at angles of zero.

    Args:
        home: angle of the cranks that the description says, rad.
    """
    rng = np.random.default_rng([12, seed])
    length, near, far = (float(rng.uniform(*x)) for x in ((0.3, 0.6), (0.4, 0.6), (0.9, 1.3)))
    stand = random_placement(rng)

    def hinged(name: str, child: str, distance: float) -> object:
        return hinge(name, "base", child, placed(pose(stand) @ pose(_at(distance))))

    links = tuple(random_link(rng, name, rods=False) for name in ("crank1", "rod", "crank2", "crank3"))
    joints = (
        hinge("joint1", "base", "crank1", stand),
        hinge("joint2", "crank1", "rod", _at(length)),
        hinged("joint3", "crank2", near),
        hinged("joint4", "crank3", far),
    )
    loops = tuple(
        Loop(f"cut{i}", (f"crank{i + 1}", "rod"), "revolute", (_at(length), _at(distance)))
        for i, distance in ((1, near), (2, far))
    )

    def at(distance: float) -> Mapping[str, mp.mpf]:
        turn = mp.mpf(distance)
        return {"joint1.gamma": turn, "joint2.gamma": -turn, "joint3.gamma": turn, "joint4.gamma": turn}

    begin = {name: float(x) for name, x in at(home).items()}
    robot = Robot(f"cranks{seed}", (0.0, -9.81, 0.0), links, joints, loops=loops, home=begin)
    return ChangePoint(robot, 3, at)


def _at(x: float) -> Placement:
    return Placement((x, 0.0, 0.0))
