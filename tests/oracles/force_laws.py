"""Forces of single coordinates written once more, with branches and SciPy, and random ones for random robots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

from eomgen.robot.value import LINEAR, Coordinate, Friction, Robot, carriers
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.random_robots import Array

KINDS = ("clearance", "one-sided", "curve", "friction", "cubic", "preload", "exponential", "stops", "plain")


def random_coordinate(rng: np.random.Generator, kind: str, old: Coordinate) -> Coordinate:
    """The coordinate with forces of a kind, large enough to count in states of size 1."""

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def maybe(low: float, high: float) -> float | None:
        return draw(low, high) if rng.random() < 0.5 else None

    if kind == "clearance":
        return replace(
            old,
            stiffness=draw(50.0, 200.0),
            clearance=draw(0.05, 0.3),
            smoothing=maybe(0.05, 0.4),
            stiffness_negative=maybe(0.0, 200.0),
            cubic=maybe(1.0, 50.0),
            restitution_damping=maybe(0.1, 1.5),
            preload=maybe(-5.0, 5.0),
        )
    if kind == "one-sided":
        return replace(old, stiffness=draw(10.0, 200.0), stiffness_negative=draw(0.0, 100.0), cubic=maybe(1.0, 20.0))
    if kind == "exponential":
        return replace(
            old,
            further={"exponential.force": draw(1.0, 10.0), "exponential.scale": draw(0.5, 2.0)},
            preload=maybe(-5.0, 5.0),
            cubic=maybe(1.0, 10.0),
        )
    if kind == "stops":
        found = {
            "stops.stiffness": draw(50.0, 200.0),
            "stops.damping": maybe(0.5, 20.0),
            "stops.restitution_damping": maybe(0.1, 1.5),
            "stops.smoothing": draw(0.05, 0.4),
            "stops.lower": draw(-0.5, 0.0),
            "stops.upper": maybe(0.0, 0.5),
        }
        return replace(old, further={key: value for key, value in found.items() if value is not None})
    if kind == "curve":
        count = int(rng.integers(2, 9))
        knots = np.cumsum(rng.uniform(0.05, 0.5, count)) - draw(0.0, 1.5)
        forces = rng.uniform(-20.0, 20.0, count)
        if rng.random() < 0.5:
            forces = np.sort(forces)
        points = tuple((float(x), float(y)) for x, y in zip(knots, forces, strict=True))
        return replace(old, stiffness=None, curve=points)
    if kind == "friction":
        stribeck = maybe(0.1, 1.0)
        coulomb = draw(0.5, 5.0)
        static = None if stribeck is None else coulomb + draw(0.0, 3.0)
        shape = "gaussian" if stribeck is not None and stribeck > 0.55 else None
        return replace(
            old, friction=Friction(coulomb, static, stribeck, maybe(0.1, 2.0), maybe(0.05, 0.5), shape=shape)
        )
    return old if kind == "plain" else replace(old, **{kind: draw(1.0, 10.0)})


def with_laws(robot: Robot, seed: int) -> Robot:
    """The robot with random forces in its coordinates, all kinds in turns."""
    rng = np.random.default_rng(seed)
    order = [str(kind) for kind in rng.permutation(KINDS)]
    joints, count = [], 0
    for joint in robot.joints:
        table = {}
        for name, given in joint.coordinates.items():
            table[name] = random_coordinate(rng, order[count % len(order)], given)
            count += 1
        joints.append(replace(joint, coordinates=_pressed(np.random.default_rng([seed, len(joints)]), table)))
    return replace(robot, joints=tuple(joints))


def _pressed(rng: np.random.Generator, table: dict[str, Coordinate]) -> dict[str, Coordinate]:
    """The coordinates, with friction that depends on a load where something presses."""
    found = dict(table)
    for name, given in table.items():
        if given.friction is not None and carriers(name, table):
            radius = None if name in LINEAR else float(rng.uniform(0.1, 0.5))
            loaded = replace(given.friction, coefficient=float(rng.uniform(0.1, 1.0)), radius=radius)
            found[name] = replace(given, friction=loaded)
    return found


def coordinates(robot: Robot) -> Iterator[Coordinate]:
    for joint in robot.joints:
        yield from joint.coordinates.values()


def smooth(x: float, w: float) -> float:
    """Penetration: a parabola over the smoothing, then straight."""
    if x <= 0.0:
        return 0.0
    return x * x / (2.0 * w) if x < w else x - w / 2.0


def resistance(c: Coordinate, s: float, v: float, load: float = 0.0) -> float:
    """Force against a deviation, without linear damping; ``load`` presses the joint, N."""
    total = c.preload or 0.0
    k, k_negative, cubic = c.stiffness or 0.0, c.stiffness_negative, c.cubic or 0.0
    if k_negative is None:
        k_negative = k
    if c.clearance is not None:
        assert c.smoothing is not None
        side = 1.0 if s > 0.0 else -1.0
        x = abs(s) - c.clearance
        d, d_dot = smooth(x, c.smoothing), min(max(x / c.smoothing, 0.0), 1.0) * side * v
        elastic = (k if s > 0.0 else k_negative) * d + cubic * d**3
        total += side * elastic * max(0.0, 1.0 + (c.restitution_damping or 0.0) * d_dot)
    else:
        total += (k if s > 0.0 else k_negative) * s + cubic * s**3
    if "exponential.force" in c.further:
        total += c.further["exponential.force"] * np.expm1(s / c.further["exponential.scale"])
    if c.curve is not None:
        total += measured(c, s)
    total += stopped(c, s, v)
    if c.friction is not None:
        f = c.friction
        level = f.coulomb
        if f.static is not None and f.stribeck is not None:
            z = v / f.stribeck
            level += (f.static - f.coulomb) * (np.exp(-z * z) if f.shape == "gaussian" else 1.0 / (1.0 + z**2))
        if f.coefficient is not None:
            level += f.coefficient * (1.0 if f.radius is None else f.radius) * load
        assert f.smoothing is not None
        total += level * v / np.hypot(v, f.smoothing) + (f.viscous or 0.0) * v
    return float(total)


def stopped(c: Coordinate, s: float, v: float) -> float:
    """The push of the stops, with which it resists; each pushes or does nothing."""
    given = {key.removeprefix("stops."): value for key, value in c.further.items() if key.startswith("stops.")}
    total = 0.0
    for end, side in (("lower", -1.0), ("upper", 1.0)):
        if end in given:
            x, w = side * (s - given[end]), given["smoothing"]
            elastic, d_dot = given["stiffness"] * smooth(x, w), min(max(x / w, 0.0), 1.0) * side * v
            factor = 1.0 + given.get("restitution_damping", 0.0) * d_dot
            total += side * max(0.0, elastic * factor + given.get("damping", 0.0) * d_dot)
    return total


def measured(c: Coordinate, s: float) -> float:
    """SciPy's curve, continued along its tangents."""
    assert c.curve is not None
    x, y = (np.array(column) for column in zip(*c.curve, strict=True))
    found = PchipInterpolator(x, y)
    at = float(np.clip(s, x[0], x[-1]))
    return float(found(at) + found(at, 1) * (s - at))


def stored(c: Coordinate, s: float) -> float:
    """Elastic energy by quadrature."""
    elastic = replace(c, friction=None)
    places = [x for x, _ in c.curve or ()]
    if c.clearance is not None:
        assert c.smoothing is not None
        places += [sign * (c.clearance + x) for sign in (-1, 1) for x in (0.0, c.smoothing)]
    for end, side in (("lower", -1.0), ("upper", 1.0)):
        if f"stops.{end}" in c.further:
            places += [c.further[f"stops.{end}"] + side * x for x in (0.0, c.further["stops.smoothing"])]
    inside = sorted({0.0, s, *(x for x in places if min(0.0, s) < x < max(0.0, s))}, reverse=bool(s < 0.0))
    total = 0.0
    for a, b in pairwise(inside):
        total += quad(lambda x: resistance(elastic, x, 0.0), a, b, epsabs=1e-13, epsrel=1e-12)[0]
    return total


class LawOracle:
    """Pinocchio for the bodies, and the forces of coordinates from here."""

    def __init__(self, robot: Robot) -> None:
        self.table, self.robot = list(coordinates(robot)), robot
        bare = [
            replace(j, coordinates={k: Coordinate(None, c.damping, c.armature) for k, c in j.coordinates.items()})
            for j in robot.joints
        ]
        self.bodies = PinocchioOracle(replace(robot, joints=tuple(bare)))

    def forces(self, q: Array, v: Array) -> Array:
        return np.array([resistance(*x) for x in zip(self.table, q, v, self.loads(q, v), strict=True)])

    def loads(self, q: Array, v: Array) -> list[float]:
        """What presses each coordinate: the forces across it without friction, with damping, of the same joint."""
        found: list[float] = []
        for joint in self.robot.joints:
            at = dict(zip(joint.coordinates, range(len(found), len(found) + len(joint.coordinates)), strict=True))
            for name in joint.coordinates:
                forces = []
                for other in {"x": "yz", "y": "xz", "z": "xy", "alpha": "yz", "beta": "xz", "gamma": "xy"}[name]:
                    if other in at:
                        c, s, rate = joint.coordinates[other], q[at[other]], v[at[other]]
                        forces.append(resistance(replace(c, friction=None), s, rate) + (c.damping or 0.0) * rate)
                found.append(float(np.linalg.norm(forces)) if forces else 0.0)
        return found

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        return np.asarray(self.bodies.inverse_dynamics(q, v, a) + self.forces(q, v))

    def generalized_force(self, q: Array, v: Array) -> Array:
        return np.asarray(self.bodies.generalized_force(q, v) - self.forces(q, v))

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        return np.asarray(self.bodies.forward_dynamics(q, v, u - self.forces(q, v)))

    def energy(self, q: Array, v: Array) -> Array:
        found = np.array(self.bodies.energy(q, v))
        found[1] += sum(stored(c, s) for c, s in zip(self.table, q, strict=True))
        return found
