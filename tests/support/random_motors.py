"""Random motors behind transmissions in random robots, and an oracle: Pinocchio for bodies, formulas for the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eomgen.robot.value import PRINCIPAL, Coordinate, Motor, Robot
from tests.oracles.force_laws import KINDS, LawOracle, random_coordinate, resistance, stored
from tests.support.random_robots import Array, State, random_robot, state_of_coordinates, with_internal_states

TYPES = ("revolute", "prismatic", "fixed")
STIFF = Coordinate(stiffness=60.0, damping=2.0)


def geared_robot(
    seed: int, joints: tuple[int, int] = (1, 4), kinds: Sequence[str] = ("plain",), prescribed: float = 0.0
) -> Robot:
    """A random tree with motors on most of its principal coordinates, at least one.

    Args:
        kinds: of the transmissions' forces (``law_oracle.KINDS``), in turns; "friction" and "stops" are the rotor's.
        prescribed: how often a motor is prescribed.
    """
    for attempt in range(100):
        robot = random_robot(seed + 1000 * attempt, joints=joints, tree=seed % 2 == 0, types=TYPES)
        if any(joint.type in PRINCIPAL for joint in robot.joints):
            return with_motors(robot, seed, kinds, prescribed)
    raise AssertionError("no robot with a principal coordinate")


def with_motors(robot: Robot, seed: int, kinds: Sequence[str] = ("plain",), prescribed: float = 0.0) -> Robot:
    """The robot with random motors."""
    rng = np.random.default_rng(seed)
    able = [joint.name for joint in robot.joints if joint.type in PRINCIPAL]
    always, count, joints = str(rng.choice(able)), 0, []
    for joint in robot.joints:
        motor = None
        if joint.name in able and (joint.name == always or rng.random() < 0.7):
            motor, count = random_motor(rng, kinds[count % len(kinds)], rng.random() < prescribed), count + 1
        joints.append(replace(joint, motor=motor))
    return replace(robot, joints=tuple(joints))


def random_motor(rng: np.random.Generator, kind: str, prescribed: bool) -> Motor:
    """Numbers that count in states of size 1, gears of both senses."""
    spring = Coordinate(float(rng.uniform(20.0, 200.0)), float(rng.uniform(0.5, 5.0)))
    made = random_coordinate(rng, kind, spring)
    ratio = float(rng.choice([-1.0, 1.0]) * rng.uniform(1.5, 6.0))
    own = {key: value for key, value in made.further.items() if key.startswith("stops.")}
    spring = replace(made, friction=None, further={key: value for key, value in made.further.items() if key not in own})
    return Motor(float(rng.uniform(0.01, 0.3)), ratio, spring, made.friction, prescribed, own)


@dataclass(frozen=True)
class Gear:
    """A motor, with the indices of its coordinate and of the principal one."""

    at: int
    principal: int
    motor: Motor


def gears(robot: Robot) -> list[Gear]:
    """The robot's motors, counted by hand."""
    found, place = [], 0
    for joint in robot.joints:
        names = list(joint.coordinates)
        if joint.motor is not None:
            found.append(Gear(place + len(names), place + names.index(PRINCIPAL[joint.type]), joint.motor))
            place += 1
        place += len(names)
    return found


def without_motors(robot: Robot) -> Robot:
    """The links and joints alone."""
    return replace(robot, joints=tuple(replace(joint, motor=None) for joint in robot.joints))


def motor_state(robot: Robot, seed: int) -> State:
    """A random state whose transmissions are deflected by up to 0.5."""
    s, motors = state_of_coordinates(without_motors(robot), np.random.default_rng(seed)), gears(robot)
    rng = np.random.default_rng(seed + 5)
    n = len(s.q) + len(motors)
    own = np.setdiff1d(np.arange(n), [gear.at for gear in motors])
    q, v, a, u = (np.zeros(n) for _ in range(4))
    for whole, part in ((q, s.q), (v, s.v), (a, s.a), (u, s.u)):
        whole[own] = part
    for gear in motors:
        q[gear.at] = gear.motor.ratio * (q[gear.principal] + rng.uniform(-0.5, 0.5))
        v[gear.at] = gear.motor.ratio * (v[gear.principal] + rng.uniform(-1.0, 1.0))
        a[gear.at], u[gear.at] = rng.uniform(-2.0, 2.0, 2)
    return with_internal_states(robot, State(q, v, a, u), rng)


class MotorOracle:
    """The robot's equations of motion with Spong's rotors; arrays (n,) of one state."""

    def __init__(self, robot: Robot) -> None:
        self.gears, self.bodies = gears(robot), LawOracle(without_motors(robot))
        self.n = len(self.bodies.table) + len(self.gears)
        self.own = np.setdiff1d(np.arange(self.n), [gear.at for gear in self.gears])
        self.given = np.array([c.prescribed for joint in robot.joints for c in joint.all_coordinates.values()])

    def spread(self, values: Array) -> Array:
        """An array over the bodies' coordinates as one over all, zero at motors."""
        result = np.zeros((self.n,) * np.ndim(values))
        result[np.ix_(*(self.own,) * np.ndim(values))] = values
        return result

    def deflections(self, x: Array) -> Array:
        return np.array([x[gear.at] / gear.motor.ratio - x[gear.principal] for gear in self.gears])

    def transmitted(self, q: Array, v: Array) -> Array:
        """Resisting forces of transmissions and rotors' bearings, (n,)."""
        result = np.zeros(self.n)
        for gear, phi, rate in zip(self.gears, self.deflections(q), self.deflections(v), strict=True):
            spring = gear.motor.transmission
            force = resistance(spring, phi, rate) + (spring.damping or 0.0) * rate
            bearing = resistance(gear.motor.rotor, q[gear.at], v[gear.at])
            result[gear.at] += force / gear.motor.ratio + bearing
            result[gear.principal] -= force
        return result

    def rotors(self) -> Array:
        result = np.zeros(self.n)
        for gear in self.gears:
            result[gear.at] = gear.motor.inertia
        return result

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        own = self.own
        bodies = self.bodies.inverse_dynamics(q[own], v[own], a[own])
        return np.asarray(self.spread(bodies) + self.rotors() * a + self.transmitted(q, v))

    def mass_matrix(self, q: Array) -> Array:
        return self.spread(self.bodies.bodies.mass_matrix(q[self.own])) + np.diag(self.rotors())

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        """Of what is prescribed u is the acceleration."""
        free, a = ~self.given, np.where(self.given, u, 0.0)
        rest = (u - self.inverse_dynamics(q, v, a))[free]
        a[free] = np.linalg.solve(self.mass_matrix(q)[np.ix_(free, free)], rest)
        return a

    def energy(self, q: Array, v: Array) -> Array:
        found = self.bodies.energy(q[self.own], v[self.own])
        found[0] += 0.5 * self.rotors() @ (v * v)
        for gear, phi in zip(self.gears, self.deflections(q), strict=True):
            found[1] += stored(gear.motor.transmission, phi) + stored(gear.motor.rotor, q[gear.at])
        return np.asarray(found)


__all__ = ["KINDS", "STIFF", "MotorOracle", "geared_robot", "gears", "motor_state", "with_motors", "without_motors"]
