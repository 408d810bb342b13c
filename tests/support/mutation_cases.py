"""Small robots with every feature that the derivation knows, and what Pinocchio and formulas say of one state each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import eomgen
from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import (
    ANGULAR,
    COORDINATES,
    LINEAR,
    Coordinate,
    Link,
    Placement,
    Robot,
    load_dependent,
)
from tests.oracles.force_laws import random_coordinate, resistance, with_laws
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.oracles.springs import SpringOracle, pulled, stored
from tests.support.bending_robots import bent
from tests.support.random_motors import MotorOracle, geared_robot, motor_state, without_motors
from tests.support.random_robots import Array, State, random_robot, some_prescribed, with_offsets
from tests.support.random_springs import with_springs

DT = 0.02  # of an implicit step, s
ALL = ("revolute", "prismatic", "fixed", "free")


@dataclass(frozen=True)
class Case:
    """A robot in a state: ``inputs`` of kernels by name, ``expected`` results by kernel, flat, as they are written.

    ``determinant`` is that of M's rows that are not prescribed, None where the pivots of forward dynamics have another
    product; ``left_out`` the factors that the elimination has no pivots for.
    """

    name: str
    model: Model
    inputs: Mapping[str, Array]
    expected: Mapping[str, Array]
    determinant: float | None
    left_out: float


def _placed(robot: Robot, first: int = 1) -> Robot:
    """The robot with every placement turned about one axis: y, z, x in turns, or from another axis on."""
    joints = []
    for k, joint in enumerate(robot.joints):
        rpy = tuple(0.4 + 0.1 * k if i == (k + first) % 3 else 0.0 for i in range(3))
        placement = Placement.from_rpy((0.3, -0.2, 0.1 * k), rpy)  # type: ignore[arg-type]
        joints.append(replace(joint, placement=placement, axis_turn=IDENTITY))
    return replace(robot, joints=tuple(joints))


def _rotors(robot: Robot, names: tuple[str, ...]) -> Robot:
    """The robot with armatures on the named coordinates of joints with all six, and on no others of theirs."""
    joints = []
    for k, joint in enumerate(robot.joints):
        table = dict(joint.coordinates)
        if len(table) == 6:
            drawn = {name: 0.1 + 0.07 * i + 0.03 * k for i, name in enumerate(COORDINATES)}
            table = {name: replace(c, armature=drawn[name] if name in names else None) for name, c in table.items()}
        joints.append(replace(joint, coordinates=table))
    return replace(robot, joints=tuple(joints))


def _active(robot: Robot) -> set[str]:
    return {name for joint in robot.joints for name in joint.coordinates}


def _has_rods(robot: Robot) -> bool:
    """Links without a moment of inertia about one axis."""

    def least(link: Link) -> float:
        xx, yy, zz, xy, xz, yz = link.inertia
        return float(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0])

    return any(least(link) < 1e-6 for link in robot.links)


def _presses(robot: Robot) -> bool:
    """Friction that depends on a load, whose tangents formulas of this file leave open."""
    return any(load_dependent(joint.coordinates) for joint in robot.joints)


def _types(robot: Robot) -> list[str]:
    return [joint.type for joint in robot.joints]


def _every_number(robot: Robot) -> Robot:
    names = tuple(name for name, value in robot.numbers() if value is not None and ".armature" not in name)
    return replace(robot, tunable=names)


def _all_laws(robot: Robot, seed: int, kind: str) -> Robot:
    """Every coordinate with a force of one kind."""
    rng = np.random.default_rng(seed)
    joints = []
    for joint in robot.joints:
        table = {name: random_coordinate(rng, kind, given) for name, given in joint.coordinates.items()}
        joints.append(replace(joint, coordinates=table))
    return replace(robot, joints=tuple(joints))


def _some_motors_given(seed: int) -> Robot:
    return geared_robot(seed, (2, 3), ("clearance", "friction", "cubic"), prescribed=0.4)


def _falling(seed: int) -> Robot:
    """Motors whose transmissions pull less, the more they are deflected, beside a straight line."""
    robot = geared_robot(seed, (2, 2), ("cubic",))
    joints = []
    for joint in robot.joints:
        if joint.motor is not None:
            spring = replace(joint.motor.transmission, cubic=-300.0)
            joint = replace(joint, motor=replace(joint.motor, transmission=spring))
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


MAKERS: Mapping[str, tuple[int, Callable[[int], Robot], Callable[[Robot], bool]]] = {
    "chain": (11, lambda s: random_robot(s, (3, 3), max_size=7), lambda r: len(_active(r)) == 6),
    "puma560": (0, lambda s: eomgen.load_robot("puma560"), lambda r: True),
    "rigid": (20, lambda s: random_robot(s, (3, 3), rigid=True), lambda r: "prismatic" in _types(r)),
    "tree": (
        30,
        lambda s: random_robot(s, (4, 4), max_coordinates=4, max_size=9, tree=True),
        lambda r: len({j.parent for j in r.joints}) < len(r.joints),
    ),
    "free": (
        40,
        lambda s: _rotors(random_robot(s, (3, 3), types=("free",), tree=True), ()),
        lambda r: len({j.parent for j in r.joints}) < len(r.joints),
    ),
    "rotors of free bodies": (
        50,
        lambda s: _rotors(random_robot(s, (3, 3), types=("revolute", "free"), max_coordinates=2), ANGULAR),
        lambda r: [t for t in _types(r) if t != "fixed"] == ["revolute", "free", "free"] and not _has_rods(r),
    ),
    "six rotors": (
        60,
        lambda s: _rotors(random_robot(s, (3, 3), types=("revolute", "free"), max_coordinates=2), COORDINATES),
        lambda r: [t for t in _types(r) if t != "fixed"] == ["revolute", "free", "revolute"],
    ),
    "prescribed": (
        72,
        lambda s: some_prescribed(random_robot(s, (3, 3), max_size=9, types=ALL, tree=True), s),
        lambda r: len({c[:1] for j in r.joints for c in j.coordinates if j.coordinates[c].prescribed}) > 3,
    ),
    "offsets": (
        80,
        lambda s: with_offsets(random_robot(s, (3, 3), max_size=7, types=ALL[:3], tree=True), s),
        lambda r: len(r.joints) > 3,
    ),
    "laws": (
        90,
        lambda s: with_laws(random_robot(s, (3, 3), max_size=7), s),
        lambda r: build_model(r).size == sum(len(j.coordinates) for j in r.joints) == 7 and not _presses(r),
    ),
    "motors": (
        100,
        _some_motors_given,
        lambda r: len({j.motor.prescribed for j in r.joints if j.motor}) == 2 and build_model(r).size < 10,
    ),
    "springs": (
        110,
        lambda s: with_springs(random_robot(s, (3, 3), max_size=7, tree=True), s),
        lambda r: True,
    ),
    "placed about one axis": (
        130,
        lambda s: _placed(random_robot(s, (3, 3), max_size=7, types=("prismatic", "fixed"))),
        lambda r: len(r.joints) == 3 and any(len(j.coordinates) > 2 for j in r.joints[1:]),
    ),
    "falling transmissions": (100, _falling, lambda r: build_model(r).size < 10),
    "friction under two loads": (
        140,
        lambda s: with_laws(random_robot(s, (2, 2), max_size=7), s),
        lambda r: any(len(pressing) > 1 for j in r.joints for pressing in load_dependent(j.coordinates).values()),
    ),
    "six coordinates": (
        150,
        lambda s: random_robot(s, counts=(6, 6), armature=False),
        lambda r: not _has_rods(r),
    ),
    "placed about y": (
        160,
        lambda s: _placed(random_robot(s, (3, 3), max_size=7), 0),
        lambda r: len(r.joints) == 3 and len(r.joints[1].coordinates) > 2,
    ),
    "parameters": (
        120,
        lambda s: _every_number(with_offsets(random_robot(s, (2, 2), max_size=5), s)),
        lambda r: any(j.type == "fixed" for j in r.joints),
    ),
}


# What formulas of this file leave open: tangents of friction by its load, pivots of translations taken out together.
UNKNOWN = {"friction under two loads": ("implicit_step",), "six coordinates": ("forward_dynamics",)}

SMALL: Mapping[str, Callable[[int], Robot]] = {  # for the closed form, whose traces are O(n^3)
    "small tree": lambda s: random_robot(s, (3, 3), max_size=3, max_coordinates=1, tree=True),
    "small laws": lambda s: with_laws(random_robot(s, (1, 2), max_size=3), s),
    "small clearance": lambda s: _all_laws(random_robot(s, (1, 1), max_size=2), s, "clearance"),
    "small friction": lambda s: _all_laws(random_robot(s, (1, 1), max_size=2), s, "friction"),
    "small motors": lambda s: geared_robot(s, (1, 1), ("cubic",)),
    "small chain": lambda s: random_robot(s, (2, 2), max_size=3),
    "small offsets": lambda s: with_offsets(random_robot(s, (2, 2), max_size=3), s, active_angles=True),
}


@cache
def small_cases() -> tuple[Case, ...]:
    """Robots with up to four coordinates."""
    found = []
    for k, (name, make) in enumerate(SMALL.items()):
        robot = next(r for r in map(make, range(200 + k, 400)) if 2 <= build_model(r).size <= 4)
        found.append(Oracle(robot).case(name, motor_state(robot, k)))
    return tuple(found)


@cache
def flexible_cases() -> tuple[tuple[Model, State, dict[str, Array]], ...]:
    """Robots of one joint whose link bends, a state of each, and what Lagrange's equations of particles say."""
    found = []
    for seed in (2, 11):
        bending = bent(random_robot(seed, (1, 1), 1, max_size=3), seed, (1, 1))
        s, oracle = bending.state(seed), bending.oracle()
        expected = {"mass_matrix": oracle.mass_matrix(s.q), "bias": oracle.bias_force(s.q, s.v)}
        expected |= {"residual": oracle.residual(s.q, s.v, s.a, s.u), "christoffel": oracle.christoffel(s.q)}
        expected |= dict(zip(("kinetic", "potential"), oracle.energy(s.q, s.v), strict=True))
        found.append((build_model(bending.robot), s, expected))
    return tuple(found)


@cache
def cases() -> tuple[Case, ...]:
    """All cases, in the order in which they are tried."""
    return (*(_case(name) for name in MAKERS), _flexible(4))


def _case(name: str) -> Case:
    seed, make, wanted = MAKERS[name]
    for attempt in range(seed, seed + 2000):
        robot = make(attempt)
        if wanted(robot):
            s = motor_state(robot, attempt)
            oracle = Oracle(robot)
            free = ~oracle.motors.given
            if np.linalg.cond(oracle.motors.mass_matrix(s.q)[np.ix_(free, free)]) < 1e4:  # no rod at a tip
                return oracle.case(name, s)
    raise AssertionError(f"no robot for {name}")


def _flexible(seed: int) -> Case:
    """Two joints and links of one or two modes, against Lagrange's equations of particles; all laws are linear."""
    bending = bent(random_robot(seed, (2, 2), 3, max_size=5), seed, (1, 2))
    model, s, oracle = build_model(bending.robot), bending.state(seed), bending.oracle()
    still, h, driven = np.zeros(len(s.q)), 1e-6, [*model.driven]
    added = np.linspace(0.1, 0.5, len(s.q))
    M, residual = oracle.mass_matrix(s.q), oracle.residual(s.q, s.v, s.a, s.u)
    A = M + DT * oracle.dampers + DT * DT * oracle.springs
    A[driven, driven] += added[driven]
    by_q, by_v = (
        [oracle.residual(s.q + x, s.v + y, s.a, s.u) - oracle.residual(s.q - x, s.v - y, s.a, s.u) for x, y in steps]
        for steps in ([(h * e, still) for e in np.eye(len(still))], [(still, h * e) for e in np.eye(len(still))])
    )
    found = {
        "mass_matrix": M,
        "residual": residual,
        "inverse_dynamics": residual + s.u,
        "bias_force": oracle.bias_force(s.q, s.v),
        "energy": np.array(oracle.energy(s.q, s.v)),
        "forward_dynamics": np.linalg.solve(M, M @ s.a - residual),
        "christoffel": oracle.christoffel(s.q),
        "implicit_step": np.linalg.solve(A, M @ s.a - residual - DT * oracle.springs @ s.v),
        "residual_jacobian": np.array([np.array(by_q).T / (2 * h), np.array(by_v).T / (2 * h), M]),
    }
    inputs = {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "added": added, "dt": np.array([DT, DT * DT])}
    inputs["p"] = np.array([*model.parameters.values()])
    return Case("flexible links", model, inputs, {name: np.ravel(x) for name, x in found.items()}, None, 1.0)


class Oracle:
    """Everything that kernels compute, from Pinocchio and formulas, of one robot in one state."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, build_model(robot)
        self.motors = MotorOracle(replace(robot, springs=()))
        self.bodies: PinocchioOracle = self.motors.bodies.bodies
        self.springs = SpringOracle(without_motors(robot))
        self.own = self.motors.own

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        pulls = self.motors.spread(self.springs.external(q[self.own], v[self.own]))
        return self.motors.inverse_dynamics(q, v, a) - pulls

    def case(self, name: str, s: State) -> Case:
        own, n = self.own, len(s.q)
        rng = np.random.default_rng(n)
        wrench, added = rng.uniform(-3.0, 3.0, (len(self.model.links), 6)), rng.uniform(0.1, 0.5, n)
        q, v, still = s.q[own], s.v[own], np.zeros(n)
        spread, given = self.motors.spread, self.motors.given
        M, inverse = self.motors.mass_matrix(s.q), self.inverse_dynamics(s.q, s.v, s.a)
        rest, bias = self.inverse_dynamics(s.q, s.v, still), spread(self.bodies.bias_force(q, v))
        weight = spread(self.bodies.weights(q))
        found = {
            "inverse_dynamics": inverse,
            "residual": inverse - s.u,
            "bias_force": bias,
            "mass_matrix": M,
            "regressor": inverse + bias - rest + weight,  # times the described parameters
            "generalized_force": bias - rest,
            "forward_dynamics": _accelerations(M, s.u - rest, s.u, given),
            "energy": self._energy(s),
            "kinematics": self._kinematics(q),
            "external_force": spread(self.bodies.external_force(q, wrench)),
            "reactions": self.springs.reactions(q, v, s.a[own]),
            "coriolis_matrix": spread(self.bodies.coriolis_matrix(q, v)),
            "implicit_step": self._implicit_step(s, added),
        }
        if not any(x for joint in self.robot.joints for x in joint.offset):
            under_wrench = self.bodies.reactions_with(q, v, s.a[own], wrench)
            found["external_reactions"] = under_wrench - self.bodies.reactions(q, v, s.a[own])
        if name in ("chain", "offsets") or name in SMALL:
            found["christoffel"] = self._christoffel(q)
        if name in ("chain", "laws", "motors", "friction under two loads"):
            found["residual_jacobian"] = self._slopes(s, M)
        inputs = {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "added": added, "dt": np.array([DT, DT * DT])}
        inputs |= {"wrench": wrench.ravel(), "p": np.array(list(self.model.parameters.values()))}
        flat = {kernel: np.ravel(value) for kernel, value in found.items() if kernel not in UNKNOWN.get(name, ())}
        return Case(name, self.model, inputs, flat, *self._determinant(M, given))

    def _determinant(self, M: Array, given: Array) -> tuple[float | None, float]:
        """That of the free rows; of a free body one factor of mass of three is a pivot."""
        six = [j for j in self.robot.joints if j.type == "free"]
        if any(j.coordinates["x"].armature is None and j.coordinates["alpha"].armature is not None for j in six):
            return None, 1.0
        if any(c.prescribed for j in six for c in j.coordinates.values()):
            return None, 1.0
        body_of, left_out = self.model.body_of, 1.0
        for child in (j.child for j in six if j.coordinates["x"].armature is None):
            left_out *= sum(link.mass for link in self.robot.links if body_of[link.name] == body_of[child]) ** 2
        return float(np.linalg.det(M[np.ix_(~given, ~given)])), left_out

    def _energy(self, s: State) -> Array:
        found = self.motors.energy(s.q, s.v)
        q, v = s.q[self.own], s.v[self.own]
        lengths = self.springs.forces(q, v)[:, 0] if self.robot.springs else []
        found[1] += sum(stored(spring, length) for spring, length in zip(self.robot.springs, lengths, strict=True))
        return found

    def _kinematics(self, q: Array) -> Array:
        rows = [self.bodies.frame_pose(q, frame)[:3] for frame in self.model.frames]
        moving = [joint for joint in self.robot.joints if joint.coordinates]
        origins = [self.bodies.frame_pose(q, joint.child)[:3, 3] for joint in moving]
        axes: list[Array] = []
        for joint in moving:
            J = self.bodies.frame_jacobian(q, joint.child)
            for name in joint.coordinates:
                place = self._place(joint.name, name)
                axes.append(J[:3, place] if name in LINEAR else J[3:, place])
            if joint.motor is not None:
                axes.append(np.zeros(3))
        return np.concatenate([*(row.ravel() for row in rows), *origins, *axes])

    def _place(self, joint: str, name: str) -> int:
        """Index of a coordinate among those of the bodies."""
        names = [f"{j.name}.{c}" for j in self.robot.joints for c in j.coordinates]
        return names.index(f"{joint}.{name}")

    def _christoffel(self, q: Array) -> Array:
        """From the quadratic form v -> bias: C_s,vw = (b(e_v + e_w) - b(e_v) - b(e_w)) / 2."""
        m = len(q)
        unit = np.eye(m)
        own = [self.bodies.bias_force(q, e) for e in unit]
        C = np.zeros((m, m, m))
        for i in range(m):
            for j in range(m):
                C[:, i, j] = (self.bodies.bias_force(q, unit[i] + unit[j]) - own[i] - own[j]) / 2
        return self.motors.spread(C)

    def _slopes(self, s: State, M: Array) -> Array:
        """Central differences of inverse dynamics by q and v, and M."""
        h, n = 1e-6, len(s.q)
        columns = [
            [self.inverse_dynamics(s.q + h * e, s.v, s.a) - self.inverse_dynamics(s.q - h * e, s.v, s.a) for e in E]
            if by == "q"
            else [
                self.inverse_dynamics(s.q, s.v + h * e, s.a) - self.inverse_dynamics(s.q, s.v - h * e, s.a) for e in E
            ]
            for by, E in (("q", np.eye(n)), ("v", np.eye(n)))
        ]
        return np.array([np.array(block).T / (2 * h) for block in columns] + [M])

    def _implicit_step(self, s: State, added: Array) -> Array:
        """(M + tangents) a = u - what resists where the rates lead to; tangents of laws that fall are left out."""
        A, own, n = self.motors.mass_matrix(s.q), self.own, len(s.q)
        ahead, still = s.q + DT * s.v, np.zeros(n)
        table = self.motors.bodies.table
        law_now = self.motors.spread(self.motors.bodies.forces(s.q[own], s.v[own]))
        law_then = self.motors.spread(self.motors.bodies.forces(ahead[own], s.v[own]))
        right = s.u - self.motors.inverse_dynamics(s.q, s.v, still) + law_now - law_then
        right += self.motors.transmitted(s.q, s.v) - self.motors.transmitted(ahead, s.v)
        for i, c in zip(own, table, strict=True):
            A[i, i] += _slope(c, ahead[i], s.v[i]) + DT * (c.damping or 0.0)
        for gear, phi, rate in zip(
            self.motors.gears, self.motors.deflections(ahead), self.motors.deflections(s.v), strict=True
        ):
            spring = gear.motor.transmission
            slope = _slope(spring, phi, rate) + DT * (spring.damping or 0.0)
            arm = np.zeros(n)
            arm[gear.at], arm[gear.principal] = 1.0 / gear.motor.ratio, -1.0
            A += slope * np.outer(arm, arm)
            A[gear.at, gear.at] += _slope(Coordinate(friction=gear.motor.friction), 0.0, s.v[gear.at])
        driven = list(self.model.driven)
        A[driven, driven] += added[driven]
        for spring, arm, (length, _) in self._arms(s):
            rate = float(arm @ s.v)
            e, h = length + DT * rate, 1e-6
            right -= arm * pulled(spring, e, rate)
            by_e = (pulled(spring, e + h, rate) - pulled(spring, e - h, rate)) / (2 * h)
            by_rate = (pulled(spring, e, rate + h) - pulled(spring, e, rate - h)) / (2 * h)
            A += max(DT * by_rate + DT * DT * by_e, 0.0) * np.outer(arm, arm)
        return _accelerations(A, right, s.u, self.motors.given)

    def _arms(self, s: State) -> list[tuple]:
        if not self.robot.springs:
            return []
        q, v = s.q[self.own], s.v[self.own]
        J = [self.motors.spread(row) for row in self.springs.jacobian(q)]
        return list(zip(self.robot.springs, J, self.springs.forces(q, v), strict=True))


def _accelerations(M: Array, right: Array, u: Array, given: Array) -> Array:
    """M a = right; of what is prescribed u is the acceleration."""
    a, free = np.where(given, u, 0.0), ~given
    a[free] = np.linalg.solve(M[np.ix_(free, free)], (right - M @ a)[free])
    return a


def _slope(c: Coordinate, s: float, v: float) -> float:
    """dt by_v + dt^2 by_s of a coordinate without its damping: of a law at least 0, of a linear spring as it is.

    Of friction the secant counts.
    """
    h, linear, secant = 1e-6, 0.0, 0.0
    if c.friction is not None:
        secant, c = resistance(Coordinate(friction=c.friction), 0.0, v) / v, replace(c, friction=None)
    if c.clearance is None and c.stiffness_negative is None and c.stiffness is not None:
        linear, c = c.stiffness, replace(c, stiffness=None)
    by_s = (resistance(c, s + h, v) - resistance(c, s - h, v)) / (2 * h)
    by_v = (resistance(c, s, v + h) - resistance(c, s, v - h)) / (2 * h)
    return DT * DT * linear + max(DT * by_v + DT * DT * by_s, 0.0) + DT * secant
