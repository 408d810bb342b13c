"""Forces of single coordinates written once more, with branches and SciPy, and random ones for random robots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

from eomgen.robot.laws import states_of
from eomgen.robot.model import build_model
from eomgen.robot.value import LINEAR, PRINCIPAL, Coordinate, Friction, Joint, Robot, carriers, load_dependent
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.drive_reference import drive
from tests.support.random_robots import Array, State

IN_TURNS = ("clearance", "one-sided", "curve", "friction", "cubic", "preload", "exponential", "stops", "plain")
WITH_STATES = ("bristles", "hysteresis", "branches")  # kinds that have states
KEYS = ("stiffness", "damping")
WOUND = ("stiffness", "A", "beta", "gamma", "n", "share")
KINDS = (*IN_TURNS, *WITH_STATES)


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
    if kind == "bristles":
        gaussian, coulomb, damping = maybe(0.1, 1.0), draw(0.5, 5.0), maybe(0.1, 3.0)
        static = None if gaussian is None else coulomb + draw(0.0, 3.0)
        fade = None if damping is None else draw(0.3, 1.0) * 4.0 * coulomb / (0.43 * damping)  # passive
        friction = Friction(
            coulomb, static, gaussian, maybe(0.1, 2.0), bristle_stiffness=draw(1.0, 20.0), bristle_damping=damping,
            fade=None if rng.random() < 0.3 else fade,
        )  # fmt: skip
        return replace(old, friction=friction)
    if kind == "hysteresis":
        found = {
            "stiffness": draw(5.0, 50.0), "A": draw(0.5, 2.0), "beta": draw(0.3, 2.0), "n": draw(1.0, 3.0),
            "share": draw(0.0, 0.8),
        }  # fmt: skip
        found["gamma"] = found["beta"] * draw(-1.0, 1.0)
        return replace(old, further={**old.further, **{f"hysteresis.{key}": value for key, value in found.items()}})
    if kind == "branches":
        numbers = ((f"maxwell.{i}", draw(5.0, 50.0), draw(0.5, 20.0)) for i in range(int(rng.integers(1, 4))))
        branches = {f"{name}.{key}": x for name, *two in numbers for key, x in zip(KEYS, two, strict=True)}
        return replace(old, further={**old.further, **branches})
    return old if kind == "plain" else replace(old, **{kind: draw(1.0, 10.0)})


def random_drive(rng: np.random.Generator) -> dict[str, float]:
    """Numbers of a servo drive: a lag, a winding or none, and some of the loops, some with integrals and limits."""

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    kind, loops = str(rng.choice(["lag", "winding", "winding", "none"])), []
    numbers: dict[str, float] = {}
    if kind == "lag":
        numbers["drive.lag"] = draw(0.05, 1.0)
    if kind == "winding":
        numbers |= {"drive.winding.resistance": draw(0.0, 2.0), "drive.winding.inductance": draw(0.05, 0.5)}
        numbers["drive.winding.torque_constant"] = draw(0.2, 2.0)
        numbers |= {f"drive.{x}_limit": draw(0.5, 5.0) for x in ("current", "voltage") if rng.random() < 0.5}
    names = ("position", "velocity", "current") if kind == "winding" else ("position", "velocity")
    loops = [name for name in names if rng.random() < (0.9 if kind == "none" and name == "velocity" else 0.6)]
    loops = loops or (["velocity"] if kind == "none" else [])
    for loop in loops:
        where = f"drive.controller.{loop}"
        numbers[f"{where}.kp"] = draw(0.5, 5.0)
        if rng.random() < 0.6:
            numbers[f"{where}.ki"] = draw(0.5, 5.0)
        if rng.random() < 0.4:
            numbers |= {f"{where}.kd": draw(0.1, 1.0), f"{where}.filter": draw(0.05, 0.5)}
        if rng.random() < 0.4:
            numbers[f"{where}.limit"] = draw(0.5, 5.0)
    return numbers


def with_drives(robot: Robot, seed: int) -> Robot:
    """The robot with servo drives at its principal coordinates, beside whatever laws these have."""
    rng, joints = np.random.default_rng([seed, 3]), []
    for joint in robot.joints:
        name = PRINCIPAL.get(joint.type, "")
        carrying = {x for others in load_dependent(joint.coordinates).values() for x in others}
        if name not in joint.coordinates or name in carrying or joint.motor is not None:
            joints.append(joint)
            continue
        if not joint.coordinates[name].prescribed:
            old = joint.coordinates[name]
            driven = replace(old, further={**old.further, **random_drive(rng)})
            joint = replace(joint, coordinates={**joint.coordinates, name: driven})
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


def drive_table(c: Coordinate) -> dict[str, Any]:
    """The table of a coordinate's drive, as a description has it; empty without one."""
    table: dict[str, Any] = {}
    for key, value in c.further.items():
        law, *path = key.split(".")
        if law == "drive":
            inner = table
            for name in path[:-1]:
                inner = inner.setdefault(name, {})
            inner[path[-1]] = value
    return table


def with_laws(robot: Robot, seed: int) -> Robot:
    """The robot with random forces in its coordinates, all kinds in turns; about half of all friction has bristles."""
    rng, other = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    order = [str(kind) for kind in rng.permutation(IN_TURNS)]
    joints, count = [], 0
    for joint in robot.joints:
        table = {}
        for name, given in joint.coordinates.items():
            table[name] = random_coordinate(rng, order[count % len(order)], given)
            if table[name].friction is not None and other.random() < 0.5:
                table[name] = random_coordinate(other, "bristles", table[name])
            count += 1
        joints.append(replace(joint, coordinates=_pressed(np.random.default_rng([seed, len(joints)]), table)))
    further = np.random.default_rng([seed, 2])
    return replace(robot, joints=tuple(_with_states(further, joint) for joint in joints))


def _with_states(rng: np.random.Generator, joint: Joint) -> Joint:
    """The joint with hysteresis and Maxwell branches at about a third of its coordinates; none where one presses."""
    kinds = [str(kind) for kind in rng.choice(["hysteresis", "branches", "plain", "plain"], len(joint.coordinates))]
    if any(c.friction is not None and c.friction.coefficient is not None for c in joint.coordinates.values()):
        return joint
    pairs = zip(joint.coordinates.items(), kinds, strict=True)
    return replace(joint, coordinates={name: random_coordinate(rng, kind, c) for (name, c), kind in pairs})


def _pressed(rng: np.random.Generator, table: dict[str, Coordinate]) -> dict[str, Coordinate]:
    """The coordinates, with friction that depends on a load where something presses."""
    found = dict(table)
    for name, given in table.items():
        if given.friction is not None and not states_of(given.law()) and carriers(name, table):
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


def state_law(c: Coordinate, s: float, v: float, states: Sequence[float]) -> tuple[float, list[float], list[float]]:
    """The force of laws with internal states, the rates of these, and their inertias."""
    force, rates, inertias, left = 0.0, list[float](), list[float](), list(states)
    if c.friction is not None and c.friction.bristle_stiffness is not None:
        force, rate = bristles(c.friction, v, left.pop(0))
        rates, inertias = [rate], [c.friction.bristle_stiffness]
    if "hysteresis.stiffness" in c.further:
        k, A, beta, gamma, n, share = (c.further[f"hysteresis.{key}"] for key in WOUND)
        z = left.pop(0)
        force += share * k * s + (1.0 - share) * k * z
        rates.append(A * v - beta * abs(v) * abs(z) ** (n - 1.0) * z - gamma * v * abs(z) ** n)
        inertias.append((1.0 - share) * k / A)
    for i, z in enumerate(left):
        k, damping = (c.further[f"maxwell.{i}.{key}"] for key in KEYS)
        force += k * z
        rates.append(v - k / damping * z)
        inertias.append(k)
    return force, rates, inertias


def bristles(f: Friction, v: float, z: float) -> tuple[float, float]:
    """The force of friction with bristles, and the rate of z."""
    assert f.bristle_stiffness is not None
    level = f.coulomb
    if f.static is not None and f.stribeck is not None:
        level += (f.static - f.coulomb) * np.exp(-((v / f.stribeck) ** 2))
    damping = (f.bristle_damping or 0.0) * (1.0 if f.fade is None else np.exp(-((v / f.fade) ** 2)))
    rate = v - f.bristle_stiffness * abs(v) / level * z
    return float(f.bristle_stiffness * z + damping * rate + (f.viscous or 0.0) * v), float(rate)


def resistance(c: Coordinate, s: float, v: float, load: float = 0.0) -> float:
    """Force against a deviation, without linear damping and internal states; ``load`` presses the joint, N."""
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
    if c.friction is not None and c.friction.bristle_stiffness is None:
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
    """Pinocchio for the bodies, and the forces of coordinates from here; internal states stand behind coordinates."""

    def __init__(self, robot: Robot) -> None:
        self.table, self.robot = list(coordinates(robot)), robot
        bare = [
            replace(j, coordinates={k: Coordinate(None, c.damping, c.armature) for k, c in j.coordinates.items()})
            for j in robot.joints
        ]
        self.bodies = PinocchioOracle(replace(robot, joints=tuple(bare)))
        self.n, ends = len(self.table), np.cumsum([len(self.table), *(len(states_of(c.law())) for c in self.table)])
        self.states = [slice(begin, end) for begin, end in pairwise(ends.tolist())]

    def forces(self, q: Array, v: Array) -> Array:
        """Of coordinates, then minus rates of states times their inertias."""
        laws = self.internal_states(q, v)
        own = [resistance(*x) for x in zip(self.table, q[: self.n], v[: self.n], self.loads(q, v), strict=True)]
        resisting = [force + more for force, (more, _, _) in zip(own, laws, strict=True)]
        return np.array(resisting + [-x * w for _, rates, sizes in laws for x, w in zip(rates, sizes, strict=True)])

    def internal_states(self, q: Array, v: Array) -> list[tuple[float, list[float], list[float]]]:
        """Force, rates and inertias of each coordinate's laws with internal states."""
        each = zip(self.table, q[: self.n].tolist(), v[: self.n].tolist(), self.states, strict=True)
        return [state_law(c, s, rate, v[places].tolist()) for c, s, rate, places in each]

    def inertias(self) -> Array:
        still = np.zeros(self.states[-1].stop)
        return np.array([w for _, _, sizes in self.internal_states(still, still) for w in sizes])

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
        bodies = self.bodies.inverse_dynamics(*(x[: self.n] for x in (q, v, a)))
        return np.concatenate([bodies, self.inertias() * a[self.n :]]) + self.forces(q, v)

    def generalized_force(self, q: Array, v: Array) -> Array:
        bodies = self.bodies.generalized_force(q[: self.n], v[: self.n])
        return np.concatenate([bodies, np.zeros(len(q) - self.n)]) - self.forces(q, v)

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        left = u - self.forces(q, v)
        bodies = self.bodies.forward_dynamics(q[: self.n], v[: self.n], left[: self.n])
        return np.concatenate([bodies, left[self.n :] / self.inertias()])

    def energy(self, q: Array, v: Array) -> Array:
        found = np.array(self.bodies.energy(q[: self.n], v[: self.n]))
        found[1] += sum(stored(c, s) for c, s in zip(self.table, q[: self.n], strict=True))
        found[1] += 0.5 * self.inertias() @ v[self.n :] ** 2
        shares = [
            c.further.get("hysteresis.share", 0.0) * c.further.get("hysteresis.stiffness", 0.0) for c in self.table
        ]
        found[1] += 0.5 * np.array(shares) @ q[: self.n] ** 2
        return found


class DriveOracle:
    """Equations of a robot with servo drives: ``LawOracle`` without them, and the drives from their own equations.

    Its arrays are of coordinates, then of internal states, those of drives among them, see ``arrays``.
    """

    def __init__(self, robot: Robot) -> None:
        joints = [replace(x, coordinates=self._bare(x)) for x in robot.joints]
        self.plain, self.model = LawOracle(replace(robot, joints=tuple(joints))), build_model(robot)
        self.n, self.size = len(self.model.coordinates), self.model.size
        within = {k for states in self.model.drives.values() for k in states}
        self.others = np.array([k for k in range(self.size) if k not in within])
        names = [state.state.name for state in self.model.states]
        self.drives = {
            i: (drive_table(self.plain_of(robot, i)), states, [names[k - self.n] for k in states])
            for i, states in self.model.drives.items()
        }

    @staticmethod
    def _bare(joint: Joint) -> dict[str, Coordinate]:
        return {name: c.without_drive() for name, c in joint.coordinates.items()}

    def plain_of(self, robot: Robot, i: int) -> Coordinate:
        return list(coordinates(robot))[i]

    def arrays(self, s: State) -> tuple[Array, Array, Array, Array]:
        """Return q, v, a and u with numbers of states behind: of q none, in u forces beside drives at first states."""
        u = np.concatenate([s.u, 0.0 * s.z])
        u[[states[0] for states in self.model.drives.values()]] = s.forces
        return np.concatenate([s.q, 0.0 * s.z]), np.concatenate([s.v, s.z]), np.concatenate([s.a, s.rates]), u

    def driven(self, q: Array, v: Array, u: Array) -> tuple[Array, Array, Array]:
        """Forces on coordinates, (size,), rates of states, and voltages less what the motion induces, by drives."""
        forces, rates, voltages = u.copy(), np.zeros(self.size), np.zeros(self.size)
        for i, (table, states, names) in self.drives.items():
            z = dict(zip(names, v[list(states)], strict=True))
            force, changes, voltage = drive(table, q[i], v[i], z, u[i])
            forces[i] = force + u[states[0]]
            forces[list(states)] = 0.0
            rates[list(states)] = [changes.get(name, -z[name]) for name in names]
            if "winding" in table:
                voltages[states[-1]] = voltage - table["winding"]["torque_constant"] * v[i]
        return forces, rates, voltages

    def inertias(self) -> Array:
        found = np.full(self.size, np.nan)
        for table, states, names in self.drives.values():
            for k, name in zip(states, names, strict=True):
                found[k] = table["winding"]["inductance"] if name == "current" else 1.0
        return found

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        found = np.zeros(self.size)  # what moves states of drives is no force on the robot
        found[self.others] = self.plain.inverse_dynamics(*(x[self.others] for x in (q, v, a)))
        return found

    def residual(self, q: Array, v: Array, a: Array, u: Array) -> Array:
        forces, rates, _ = self.driven(q, v, u)
        found = self.inertias() * (a - rates)
        needed = self.plain.inverse_dynamics(*(x[self.others] for x in (q, v, a)))
        found[self.others] = needed - forces[self.others]
        return found

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        forces, rates, _ = self.driven(q, v, u)
        found = rates
        found[self.others] = self.plain.forward_dynamics(*(x[self.others] for x in (q, v, forces)))
        return found

    def energy(self, q: Array, v: Array) -> Array:
        found = np.array(self.plain.energy(q[self.others], v[self.others]))
        w = self.inertias()
        for _, states, names in self.drives.values():
            found[1] += sum(0.5 * w[k] * v[k] ** 2 for k, x in zip(states, names, strict=True) if x == "current")
        return found
