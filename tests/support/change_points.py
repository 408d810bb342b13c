"""Random mechanisms with change points, in the plane and in space, at a known distance from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import mpmath as mp
import numpy as np

from eomgen.robot.value import Coordinate, Joint, Loop, Placement, Robot
from tests.support.linkages import hinge
from tests.support.random_robots import Array, random_link, random_placement, random_rotation
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


Equation = Callable[[mp.mpf, mp.mpf], mp.mpf]
MORE = DIGITS + 10


def spherical_bar(seed: int, *, stands: bool = False) -> ChangePoint:
    """A linkage whose four axes meet in one point, and lie in one plane at the change point.

    Args:
        stands: on a body that turns, about an axis of its own.
    """
    rng = np.random.default_rng([13, seed])
    with mp.workdps(MORE):
        while True:
            ground, crank, coupler = rng.uniform(0.3, 1.3, 3).tolist()
            signs = rng.choice([-1.0, 1.0], 2)
            rest = signs[0] * crank + signs[1] * coupler - ground
            if not 0.15 < abs(rest) < 2.6:
                continue
            begin, flip = (mp.pi * (x < 0.0) for x in (signs[0], signs[0] * signs[1]))
            axis = _axis(begin, crank, flip, coupler)
            base_axis = mp.matrix([mp.sin(ground), 0, mp.cos(ground)])
            cosine = _dot(axis(0, 0), base_axis)
            equation = _less(lambda x, y, a=axis, b=base_axis: _dot(a(x, y), b), cosine)
            rocker, ways = float(mp.acos(cosine)), _ways(equation)
            if len(ways) == 2 and 0.15 < rocker < 2.9:
                break
    way, heights = ways[rng.integers(2)], rng.uniform(0.3, 1.0, 4)

    def arc(first: int, angle: float, last: int) -> Placement:
        return placed(_lift(-heights[first]) @ _about_y(angle) @ _lift(heights[last]))

    stand, names, joints, base = random_placement(rng), ["crank", "coupler", "rocker"], [], "base"
    if stands:
        names, base = ["stand", *names], "stand"
        joints.append(hinge("turn", "base", "stand", random_placement(rng)))
    joints += [
        hinge("joint1", base, "crank", placed(pose(stand) @ _lift(heights[0]))),
        hinge("joint2", "crank", "coupler", arc(0, crank, 1)),
        hinge("joint3", base, "rocker", placed(pose(stand) @ _about_y(ground) @ _lift(heights[2]))),
    ]
    cut = Loop("joint4", ("rocker", "coupler"), "revolute", (arc(2, rocker, 3), arc(1, coupler, 3)))
    links = tuple(random_link(rng, name, rods=False) for name in names)

    def at(distance: float) -> Mapping[str, mp.mpf]:
        with mp.workdps(DIGITS):
            first = mp.mpf(distance)
            second = _followed(equation, first, way)
            seen = _turn(1, -mp.mpf(ground)) * axis(first, second)
            found = {"joint1.gamma": begin + first, "joint2.gamma": flip + second}
            return {**found, "joint3.gamma": mp.atan2(seen[1], seen[0]), "turn.gamma": mp.mpf(0.3)}

    return ChangePoint(Robot(f"spherical{seed}", (0.0, -9.81, 0.0), links, tuple(joints), loops=(cut,)), 2, at)


def rod_on_balls(seed: int) -> ChangePoint:
    """A rod between the balls of two cranks, RSSR, at right angles to the ways of both at the change point."""
    rng = np.random.default_rng([14, seed])
    with mp.workdps(MORE):
        while True:
            along, radii = _unit(rng.standard_normal(3)), rng.uniform(0.15, 0.7, 2).tolist()
            near = rng.uniform(-0.5, 0.5, 3)
            ends = near, near + rng.uniform(0.4, 1.2) * along
            frames = [_crank_frame(rng, end, radius, along) for end, radius in zip(ends, radii, strict=True)]
            tips = _tips([mp.matrix(frame.tolist()) for frame in frames], radii)
            begin = _stationary(_between(tips))
            if begin is None:
                continue
            whole = _between(tips)
            square = whole(*begin)
            equation = _less(lambda x, y, f=whole, b=begin: f(b[0] + x, b[1] + y), square)
            ways, turned = _ways(equation), random_rotation(rng)
            if len(ways) == 2 and abs((turned.T @ frames[0][:3, :3].T @ along)[0]) < 0.6:
                break
        length = float(mp.sqrt(square))
    way, ball = ways[rng.integers(2)], np.eye(4)
    ball[:3, :3], ball[0, 3] = turned, radii[0]
    links = tuple(random_link(rng, name, rods=False) for name in ("crank", "rod", "rocker"))
    angles = {name: Coordinate() for name in ("alpha", "beta", "gamma")}
    joints = (
        hinge("joint1", "base", "crank", placed(frames[0])),
        Joint("ball", "crank", "rod", "spherical", placed(ball), coordinates=angles),
        hinge("joint3", "base", "rocker", placed(frames[1])),
    )
    cut = Loop("cut", ("rocker", "rod"), "spherical", (_at(radii[1], 0.0), _at(0.0, length)))
    to_crank, to_ball = (mp.matrix(x.T.tolist()) for x in (frames[0][:3, :3], turned))

    def at(distance: float) -> Mapping[str, mp.mpf]:
        with mp.workdps(DIGITS):
            first = mp.mpf(distance)
            one, two = begin[0] + first, begin[1] + _followed(equation, first, way)
            P, Q = tips(one, two)
            x, y, z = to_ball * (_turn(2, -one) * (to_crank * ((Q - P) / mp.norm(Q - P))))
            found = {"joint1.gamma": one, "joint3.gamma": two, "ball.gamma": mp.mpf(0.3)}
            return {**found, "ball.alpha": mp.atan2(-y, z), "ball.beta": mp.asin(x)}

    return ChangePoint(Robot(f"rssr{seed}", (0.0, -9.81, 0.0), links, joints, loops=(cut,)), 3, at)


def two_bars(seed: int, *, regular: bool = False) -> ChangePoint:
    """Two planar linkages, the second one on the coupler of the first.

    Args:
        regular: whether the first one stays away from its own change point.
    """
    one, two = four_bar(seed + 500000), four_bar(seed + 700000)

    def named(name: str) -> str:
        return "coupler" if name == "base" else f"second_{name}"

    def renamed(joint: Joint) -> Joint:
        return replace(joint, name=named(joint.name), parent=named(joint.parent), child=named(joint.child))

    def cut(loop: Loop) -> Loop:
        return replace(loop, name=named(loop.name), links=(named(loop.links[0]), named(loop.links[1])))

    links = (*one.robot.links, *(replace(link, name=named(link.name)) for link in two.robot.links))
    joints = (*one.robot.joints, *map(renamed, two.robot.joints))
    robot = replace(one.robot, links=links, joints=joints, loops=(*one.robot.loops, *map(cut, two.robot.loops)))

    def at(distance: float) -> Mapping[str, mp.mpf]:
        first = one.at(0.1 if regular else distance)
        return {**first, **{named(name): angle for name, angle in two.at(distance).items()}}

    return ChangePoint(robot, 4, at)


def _axis(begin: mp.mpf, crank: float, flip: mp.mpf, coupler: float) -> Callable[[mp.mpf, mp.mpf], mp.matrix]:
    """Give the last axis of a spherical chain by its two angles."""
    last = _turn(1, mp.mpf(coupler)) * mp.matrix([0, 0, 1])
    return lambda x, y: _turn(2, begin + x) * (_turn(1, mp.mpf(crank)) * (_turn(2, flip + y) * last))


def _crank_frame(rng: np.random.Generator, end: Array, radius: float, along: Array) -> Array:
    """Give the pose, (4, 4), of a crank's axis whose end moves at right angles to a direction."""
    y = _unit(np.cross(along, rng.standard_normal(3)))
    z = _unit(np.cross(y, rng.standard_normal(3)))
    x = np.cross(y, z)
    frame = np.eye(4)
    frame[:3] = np.stack([x, y, z, end - radius * x], axis=1)
    return frame


def _tips(frames: list[mp.matrix], radii: list[float]) -> Callable[[mp.mpf, mp.mpf], list[mp.matrix]]:
    """Give the ends of two cranks by their angles."""

    def tips(*angles: mp.mpf) -> list[mp.matrix]:
        arms = ([r * mp.cos(t), r * mp.sin(t), 0, 1] for r, t in zip(map(mp.mpf, radii), angles, strict=True))
        return [(frame * mp.matrix(arm))[:3, 0] for frame, arm in zip(frames, arms, strict=True)]

    return tips


def _between(tips: Callable[[mp.mpf, mp.mpf], list[mp.matrix]]) -> Equation:
    """Give the square of the distance between two ends."""

    def square(x: mp.mpf, y: mp.mpf) -> mp.mpf:
        P, Q = tips(x, y)
        return _dot(Q - P, Q - P)

    return square


def _slopes(f: Equation, x: mp.mpf, y: mp.mpf) -> tuple[mp.matrix, mp.matrix]:
    """First and second derivatives, by differences."""
    h = mp.mpf(10) ** -(MORE // 4)
    near = {(i, j): f(x + i * h, y + j * h) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    both = (near[1, 1] - near[1, -1] - near[-1, 1] + near[-1, -1]) / 4
    first = mp.matrix([near[1, 0] - near[-1, 0], near[0, 1] - near[0, -1]]) / (2 * h)
    ends = [near[i, j] + near[-i, -j] - 2 * near[0, 0] for i, j in ((1, 0), (0, 1))]
    return first, mp.matrix([[ends[0], both], [both, ends[1]]]) / h**2


def _stationary(f: Equation) -> tuple[mp.mpf, mp.mpf] | None:
    """Find where the slopes vanish, from within round-off of doubles; None where that is no single point."""
    x = mp.matrix([0, 0])
    for _ in range(8):
        slope, curve = _slopes(f, *x)
        if abs(mp.det(curve)) < 1e-4:
            return None
        x = x - mp.lu_solve(curve, slope)
    return (x[0], x[1]) if mp.norm(x) < 1e-10 else None


def _ways(f: Equation) -> list[mp.mpf]:
    """Find the rates of the second angle by the first in which the branches leave; none where they are much alike."""
    curve = _slopes(f, mp.mpf(0), mp.mpf(0))[1]
    rest = -mp.det(curve)
    if rest <= 0 or abs(curve[1, 1]) < 1e-6:
        return []
    ways = [(-curve[0, 1] + sign * mp.sqrt(rest)) / curve[1, 1] for sign in (-1, 1)]
    return ways if abs(ways[1] - ways[0]) > 0.2 and max(map(abs, ways)) < 20.0 else []


def _followed(f: Equation, first: mp.mpf, way: mp.mpf) -> mp.mpf:
    """Find the second angle on a branch by the first."""
    second, h = first * way, mp.mpf(10) ** -30
    for _ in range(80):
        step = f(first, second) * 2 * h / (f(first, second + h) - f(first, second - h))
        second = second - step
        if abs(step) < mp.mpf(10) ** -(DIGITS - 15):
            break
    return second


def _less(f: Equation, value: mp.mpf) -> Equation:
    return lambda x, y: f(x, y) - value


def _turn(axis: int, angle: mp.mpf) -> mp.matrix:
    found, (i, j) = mp.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    found[i, i] = found[j, j] = mp.cos(angle)
    found[j, i] = mp.sin(angle)
    found[i, j] = -found[j, i]
    return found


def _dot(x: mp.matrix, y: mp.matrix) -> mp.mpf:
    return (x.T * y)[0]


def _unit(x: Array) -> Array:
    return np.asarray(x / np.linalg.norm(x))


def _about_y(angle: float) -> Array:
    return pose(Placement.from_rpy((0.0, 0.0, 0.0), (0.0, angle, 0.0)))


def _lift(height: float) -> Array:
    return pose(_at(0.0, float(height)))


def _at(x: float, z: float = 0.0) -> Placement:
    return Placement((x, 0.0, z))
