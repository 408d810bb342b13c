"""Motors behind transmissions: Pinocchio, SymPy's Lagrangian, closed forms of vibration, and laws of mechanics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import eomgen
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.joint.zeros import zero_map
from eomgen.errors import SingularError
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, Motor, Robot
from tests.oracles.force_laws import resistance
from tests.oracles.lagrange import LagrangeOracle
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.added_forces import check_closed_form, check_jacobians
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.programs import answer, by_solvers
from tests.support.random_motors import KINDS, STIFF, MotorOracle, geared_robot, gears, motor_state, without_motors
from tests.support.random_robots import Array, random_robot, seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

ROD = Link("rod", 2.0, (0.0, 0.0, 0.0), (0.3, 0.3, 0.4, 0.0, 0.0, 0.0))


def one_joint(motor: Motor, kind: str = "revolute", name: str = "geared") -> Robot:
    """A body on one joint, balanced on its axis, no gravity."""
    given = {"gamma" if kind == "revolute" else "z": Coordinate()}
    return Robot(name, (0.0, 0.0, 0.0), (ROD,), (Joint("joint1", "base", "rod", kind, coordinates=given, motor=motor),))


def with_motors_changed(robot: Robot, change: Callable[[Motor], Motor]) -> Robot:
    return replace(robot, joints=tuple(replace(j, motor=j.motor and change(j.motor)) for j in robot.joints))


@pytest.mark.parametrize("seed", seeds(1900, 1, 14))
def test_all_kernels_of_random_robots(seed: int, built: Build) -> None:
    """One state at a time, and several on vectors."""
    robot = geared_robot(seed, kinds=KINDS[seed % 7 :] + KINDS[: seed % 7], prescribed=0.3 * (seed % 3 == 0))
    kernel, oracle = built(robot), MotorOracle(robot)
    bare, own = PinocchioOracle(without_motors(robot)), oracle.own
    states = [motor_state(robot, seed + i) for i in range(5)]
    for s in states:
        expected = oracle.inverse_dynamics(s.q, s.v, s.a)
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), expected)
        assert close(kernel.residual(s.q, s.v, s.a, s.u), expected - s.u)
        M = kernel.mass_matrix(s.q)
        assert close(M, oracle.mass_matrix(s.q))
        assert np.array_equal(M, M.T)
        assert np.linalg.eigvalsh(M).min() > 0.0 or np.linalg.cond(M) > 1e12
        bias = oracle.spread(bare.bias_force(s.q[own], s.v[own]))
        assert close(kernel.bias_force(s.q, s.v), bias)
        assert close(kernel.coriolis_matrix(s.q, s.v) @ s.v, bias)
        assert close(np.einsum("svw,v,w->s", kernel.christoffel(s.q), s.v, s.v), bias)
        still = oracle.inverse_dynamics(s.q, s.v, np.zeros(kernel.n))
        assert close(kernel.generalized_force(s.q, s.v), bias - still)
        assert close(kernel.energy(s.q, s.v), oracle.energy(s.q, s.v), 1e-9)
        assert close(kernel.reactions(s.q, s.v, s.a), bare.reactions(s.q[own], s.v[own], s.a[own]))
        jacobian = np.zeros((6, kernel.n))
        jacobian[:, own] = bare.frame_jacobian(s.q[own], "tcp").reshape(6, -1)
        assert close(kernel.frame_jacobian(s.q, "tcp"), jacobian)
        assert close(kernel.frame_pose(s.q, "tcp"), bare.frame_pose(s.q[own], "tcp"))
        wrench = np.random.default_rng(seed).uniform(-5.0, 5.0, (len(kernel.links), 6))
        assert close(kernel.functions.external_force(s.q, wrench), oracle.spread(bare.external_force(s.q[own], wrench)))
        free = ~oracle.given
        condition = np.linalg.cond(M[np.ix_(free, free)])
        accelerations = kernel.forward_dynamics(s.q, s.v, s.u)
        assert np.array_equal(accelerations[oracle.given], s.u[oracle.given])
        found, wanted = accelerations, oracle.forward_dynamics(s.q, s.v, s.u)
        assert np.abs(found - wanted).max() < max(1e-10, 1e3 * 2e-16 * condition) * np.abs(wanted).max()
    q, v, a = (np.array([getattr(s, x) for s in states]) for x in "qva")
    assert close(kernel.inverse_dynamics(q, v, a)[3], kernel.inverse_dynamics(q[3], v[3], a[3]))
    assert close(kernel.frame_jacobian(q, "tcp")[3], kernel.frame_jacobian(q[3], "tcp"))


@pytest.mark.parametrize("seed", [1921, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (1923, 1924))])
def test_against_sympys_lagrangian(seed: int, built: Build) -> None:
    """The bodies by LagrangesMethod, rotors and springs by Lagrange's equations of their own energies."""
    robot = geared_robot(seed, (1, 2))
    kernel, s, motors = built(robot, "residual"), motor_state(robot, seed), gears(robot)
    own = MotorOracle(robot).own
    expected = np.zeros(kernel.n)
    expected[own] = LagrangeOracle(without_motors(robot)).residual(*(x[own] for x in (s.q, s.v, s.a, s.u)))
    for gear in motors:
        expected[gear.at] -= s.u[gear.at]
        t = sp.Symbol("t")
        theta, q = sp.Function("theta")(t), sp.Function("q")(t)
        phi, m = theta / gear.motor.ratio - q, gear.motor
        k, b = m.transmission.stiffness, m.transmission.damping
        L = m.inertia * theta.diff(t) ** 2 / 2 - k * phi**2 / 2
        R = b * phi.diff(t) ** 2 / 2  # Rayleigh's dissipation
        swap = {}
        for x, i in ((theta, gear.at), (q, gear.principal)):
            swap |= {x.diff(t, 2): s.a[i], x.diff(t): s.v[i], x: s.q[i]}
        for x, i in ((theta, gear.at), (q, gear.principal)):
            row = L.diff(x.diff(t)).diff(t) - L.diff(x) + R.diff(x.diff(t))
            for old in sorted(swap, key=sp.count_ops, reverse=True):  # second derivatives before first ones
                row = row.subs(old, swap[old])
            expected[i] += float(row)
    assert close(kernel.residual(s.q, s.v, s.a, s.u), expected)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(1930, 1, 7))
def test_derivatives(seed: int, built: Build) -> None:
    robot = geared_robot(seed, (1, 3), kinds=KINDS[seed % 7 :] + KINDS[: seed % 7])
    check_jacobians(robot, [motor_state(robot, seed + i) for i in range(2)], built)


@pytest.mark.parametrize("seed", seeds(1940, 1, 4))
def test_both_solvers_agree(seed: int) -> None:
    robot = geared_robot(seed, (2, 3))
    s = motor_state(robot, seed)
    first, second = by_solvers(robot, "forward_dynamics", q=s.q, v=s.v, u=s.u).values()
    assert close(first, second, 1e-9)


@pytest.mark.parametrize("seed", [1950, 1951, 1952])
def test_closed_form(seed: int) -> None:
    """SymPy's equations against the program, on floats."""
    robot = geared_robot(seed, (1, 1), kinds=(KINDS[seed % 7],))
    model, s = build_model(robot), motor_state(robot, seed)
    check_closed_form(robot, s)
    M = closed_form(model).function("mass_matrix")(s.q, s.v, s.a, s.u)
    assert close(answer(robot, "mass_matrix", s).reshape(M.shape), M)


def whole_step(oracle: MotorOracle, q: Array, v: Array, u: Array, dt: float, added: Array) -> Array:
    """Acceleration of a linearly implicit step by the whole matrix; tangents of laws by differences of the formulas.

    Friction counts by its secant.
    """
    given, free, none = oracle.given, ~oracle.given, np.zeros(len(q))
    table, ahead = oracle.bodies.table, q + dt * v
    matrix = oracle.mass_matrix(q) + np.diag(added)
    for i, c in zip(oracle.own, table, strict=True):
        matrix[i, i] += dt * (c.damping or 0.0) + dt * dt * (c.stiffness or 0.0)
    for gear, phi, rate in zip(oracle.gears, oracle.deflections(ahead), oracle.deflections(v), strict=True):
        spring, across = gear.motor.transmission, np.zeros(len(q))
        across[gear.at], across[gear.principal] = 1.0 / gear.motor.ratio, -1.0
        bent = spring.clearance is not None or spring.stiffness_negative is not None
        k = 0.0 if bent else spring.stiffness or 0.0
        law = dt * dt * (tangent(spring, phi, rate, 0) - k) + dt * tangent(spring, phi, rate, 1)
        slope = dt * (spring.damping or 0.0) + dt * dt * k + max(law, 0.0)
        matrix += slope * np.outer(across, across)
        bearing = resistance(Coordinate(friction=gear.motor.friction), 0.0, v[gear.at]) / v[gear.at]
        matrix[gear.at, gear.at] += dt * bearing
    bodies = oracle.inverse_dynamics(q, v, none)
    springs = oracle.spread(np.array([(c.stiffness or 0.0) for c in table])) * (ahead - q)
    right = u - bodies - springs - oracle.transmitted(ahead, v) + oracle.transmitted(q, v)
    a = np.where(given, u, 0.0)
    right = right - matrix @ a
    a[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
    return a


def tangent(c: Coordinate, s: float, v: float, by: int, h: float = 1e-5) -> float:
    """Derivative of a law's force by deviation (0) or rate (1), to 1e-9 away from its corners."""
    ds, dv = (h, 0.0) if by == 0 else (0.0, h)
    forces = [resistance(c, s + x * ds, v + x * dv) for x in (-2, -1, 1, 2)]
    return float(np.dot(forces, [1.0, -8.0, 8.0, -1.0]) / (12.0 * h))


@pytest.mark.parametrize("seed", seeds(1960, 1, 18))
def test_an_implicit_step_is_that_of_the_whole_matrix(seed: int, built: Build) -> None:
    """All kinds of forces; motors and principal coordinates that are prescribed; a controller of the motors."""
    robot = geared_robot(seed, kinds=KINDS[seed % 7 :] + KINDS[: seed % 7], prescribed=0.4 * (seed % 2))
    if seed % 3 == 0:  # the joint's motion is given, the motor is free
        first = gears(robot)[0]
        name = build_model(robot).coordinates[first.principal]
        joint = robot.joint(name.rpartition(".")[0])
        key = name.rpartition(".")[2]
        table = {**joint.coordinates, key: replace(joint.coordinates[key], prescribed=True)}
        changed = replace(joint, coordinates=table)
        robot = replace(robot, joints=tuple(changed if j.name == joint.name else j for j in robot.joints))
    kernel, oracle, s = built(robot, "rollout"), MotorOracle(robot), motor_state(robot, seed)
    dt, kp, kd = 5e-3, 40.0, 3.0
    _, vs = kernel.rollout(s.q, s.v, s.u, dt, 1, method="implicit")
    wanted = whole_step(oracle, s.q, s.v, s.u, dt, np.zeros(kernel.n))
    assert close((vs[1] - s.v) / dt, wanted, 1e-7)
    driven = np.zeros(kernel.n)
    driven[list(build_model(robot).driven)] = 1.0
    target = s.q + 0.1
    _, vs = kernel.rollout(s.q, s.v, s.u, dt, 1, method="implicit", kp=kp, kd=kd, target=target)
    u = s.u + driven * (kp * (target - s.q - dt * s.v) - kd * s.v)
    wanted = whole_step(oracle, s.q, s.v, u, dt, driven * (dt * kd + dt * dt * kp))
    assert close((vs[1] - s.v) / dt, wanted, 1e-7)


def test_what_is_driven() -> None:
    """Motors in the place of their joints; nothing where the motor's motion is given; the motor of a given joint."""
    motor = Motor(0.1, 10.0, STIFF)
    robot = one_joint(motor)
    assert build_model(robot).coordinates == ("joint1.gamma", "joint1.motor")
    assert build_model(robot).driven == (1,)
    given = build_model(one_joint(replace(motor, prescribed=True)))
    assert (given.driven, given.prescribed) == ((), (1,))
    joint = replace(robot.joints[0], coordinates={"gamma": Coordinate(prescribed=True)})
    held = build_model(replace(robot, joints=(joint,)))
    assert (held.driven, held.prescribed) == ((1,), (0,))


@pytest.mark.parametrize(("kind", "load"), [("revolute", 0.4), ("prismatic", 2.0)])
def test_resonance_of_two_masses(kind: str, load: float, built: Build) -> None:
    """Motor against load: w^2 = k (1 / J_load + 1 / (J N^2)); a motion in that mode is a cosine."""
    J, ratio, k = 2e-4, -80.0, 3e3
    kernel = built(one_joint(Motor(J, ratio, Coordinate(k)), kind, f"two_masses_{kind}"))
    w = np.sqrt(k * (1.0 / load + 1.0 / (J * ratio**2)))
    by_q, _, M = kernel.residual_jacobian(*np.zeros((3, 2)))
    assert np.allclose(np.sort(np.linalg.eigvals(np.linalg.solve(M, by_q)).real), [0.0, w * w], rtol=1e-12, atol=1e-6)
    start = 1e-3 * np.array([-J * ratio**2 / load, ratio])  # nothing turns on the whole
    period = 2.0 * np.pi / w
    q, v = kernel.rollout(start, np.zeros(2), np.zeros(2), period / 1000, 3250, every=250)
    phase = np.cos(w * period / 4 * np.arange(len(q)))
    assert np.abs(q / start - phase[:, None]).max() < 1e-8
    assert np.abs(v / start).max() < w * (1.0 + 1e-9)


@pytest.mark.soak
def test_a_stiff_transmission_is_a_rigid_gear(built: Build) -> None:
    """The motion goes to that of the joint with armature J N^2 as 1 / k; implicit steps need no smaller dt for it."""
    robot = geared_robot(1985, (2, 3))
    robot = with_motors_changed(robot, lambda m: replace(m, transmission=Coordinate(1e3, 30.0)))
    rigid = replace(
        without_motors(robot),
        name="rigid_gears",
        joints=tuple(replace(j, coordinates={**j.coordinates, **_driven_table(j)}, motor=None) for j in robot.joints),
    )
    kernel, stiff, motors = built(robot, "rollout"), built(rigid, "rollout"), gears(robot)
    own, s = MotorOracle(robot).own, motor_state(robot, 3)
    q, v, u = s.q.copy(), s.v.copy(), s.u.copy()
    for gear in motors:
        q[gear.at], v[gear.at] = gear.motor.ratio * q[gear.principal], gear.motor.ratio * v[gear.principal]
    force = u[own].copy()
    for gear in motors:
        force[int(np.flatnonzero(own == gear.principal)[0])] += gear.motor.ratio * u[gear.at]
    steps, dt = 200, 1e-3
    wanted = stiff.rollout(q[own], v[own], force, dt, steps, method="implicit")[0][-1]
    errors = []
    for k in (1e5, 1e6, 1e7):
        for gear in motors:
            name = kernel.coordinates[gear.at]
            kernel.parameters[f"joints.{name}.stiffness"], kernel.parameters[f"joints.{name}.damping"] = k, k / 50
        found = kernel.rollout(q, v, u, dt, steps, method="implicit")[0][-1]
        errors.append(float(np.abs(found[own] - wanted).max()))
        for gear in motors:
            assert abs(found[gear.at] / gear.motor.ratio - found[gear.principal]) < 1e3 / k
    assert errors[2] < 1e-4
    assert 7.0 < errors[0] / errors[1] < 13.0
    assert 7.0 < errors[1] / errors[2] < 13.0


def _driven_table(joint: Joint) -> dict[str, Coordinate]:
    """The principal coordinate with the rotor as an armature."""
    if joint.motor is None:
        return {}
    name = "gamma" if joint.type == "revolute" else "z"
    given = joint.coordinates[name]
    return {name: replace(given, armature=(given.armature or 0.0) + joint.motor.inertia * joint.motor.ratio**2)}


def test_the_rigid_robot_has_the_rotors_as_armatures(built: Build) -> None:
    robot = geared_robot(1986, (2, 3))
    rigid = robot.rigid()
    assert not any(joint.motor for joint in rigid.joints)
    for joint, old in zip(rigid.joints, robot.joints, strict=True):
        if old.motor is not None:
            assert joint.coordinates.items() >= _driven_table(old).items()
    prescribed = geared_robot(1987, (2, 2), prescribed=1.0)
    assert all(
        joint.rigid().coordinates["gamma" if joint.type == "revolute" else "z"].prescribed
        for joint in prescribed.joints
        if joint.motor
    )


@pytest.mark.soak
@pytest.mark.parametrize("kind", soaked(["clearance", "curve", "plain", "one-sided"], ["clearance"]))
def test_energy_stays(kind: str, built: Build) -> None:
    """Without damping: springs, backlash and curves of transmissions give back what they take."""
    rng = np.random.default_rng(7)
    robot = without_damping(geared_robot(1990, (3, 3), kinds=(kind,)))
    kernel, s = built(robot, "rollout", "energy"), motor_state(robot, int(rng.integers(100)))
    q, v = kernel.rollout(s.q, s.v, np.zeros(kernel.n), 2e-5, 20000, every=500)
    energy = kernel.energy(q, v)
    total = energy.sum(axis=1)
    assert np.ptp(energy[:, 0]) > 1.0  # there is something to conserve
    assert np.abs(total - total[0]).max() < 1e-7 * np.abs(energy).max()


def without_damping(robot: Robot) -> Robot:
    def rid(motor: Motor) -> Motor:
        spring = replace(motor.transmission, damping=None, restitution_damping=None)
        return replace(motor, transmission=spring, friction=None)

    def table(joint: Joint) -> dict[str, Coordinate]:
        return {name: replace(c, damping=None, friction=None) for name, c in joint.coordinates.items()}

    robot = with_motors_changed(robot, rid)
    return replace(robot, joints=tuple(replace(joint, coordinates=table(joint)) for joint in robot.joints))


def test_backlash_lets_go(built: Build) -> None:
    """Inside the gap the load turns on as it was and the motor alone feels its drive; beyond, the ends push."""
    c, k = 0.01, 1e3
    motor = Motor(1e-3, 20.0, Coordinate(k, clearance=c, smoothing=1e-6))
    kernel = built(one_joint(motor, name="backlash"), "forward_dynamics", "rollout")
    for phi, push in ((0.0, 0.0), (0.9 * c, 0.0), (-0.9 * c, 0.0), (1.5 * c, 0.5 * c * k), (-1.5 * c, -0.5 * c * k)):
        a = kernel.forward_dynamics([0.3, 20.0 * (0.3 + phi)], [1.0, 2.0], [0.0, 0.7])
        assert np.allclose(a, [push / 0.4, (0.7 - push / 20.0) / 1e-3], rtol=2e-4, atol=1e-9)
    q, _ = kernel.rollout(np.zeros(2), np.zeros(2), [0.0, 1.0], 1e-4, 20, every=2)  # 1/2 a t^2 / N < c until 20 ms
    assert np.allclose(q[:6, 1], 0.5 * 1e3 * (np.arange(6) * 2e-4) ** 2, atol=1e-12)
    assert np.array_equal(q[:, 0], np.zeros(11))


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(1995, 1, 2))
def test_inertia_and_ratio_are_parameters(seed: int, built: Build) -> None:
    """Set without recompiling, they do what they do in the description."""
    robot = geared_robot(seed, (2, 2), kinds=("clearance",))
    names = [build_model(robot).coordinates[gear.at] for gear in gears(robot)]
    tunable = tuple(f"joints.{name}.{key}" for name in names for key in ("inertia", "ratio"))
    kernel = built(replace(robot, name="tuned", tunable=tunable), "residual", "rollout")
    other = with_motors_changed(robot, lambda m: replace(m, inertia=0.7 * m.inertia, ratio=-1.3 * m.ratio))
    for gear, name in zip(gears(other), names, strict=True):
        kernel.parameters[f"joints.{name}.inertia"] = gear.motor.inertia
        kernel.parameters[f"joints.{name}.ratio"] = gear.motor.ratio
        assert kernel.ratio(name) == gear.motor.ratio
    again, s = built(other, "residual", "rollout"), motor_state(other, seed)
    assert close(kernel.residual(s.q, s.v, s.a, s.u), again.residual(s.q, s.v, s.a, s.u))
    for found, wanted in zip(
        *(k.rollout(s.q, s.v, s.u, 1e-3, 5, method="implicit") for k in (kernel, again)), strict=True
    ):
        assert close(found, wanted)


def test_a_rotor_without_inertia_is_named(built: Build) -> None:
    robot = replace(one_joint(Motor(0.1, 5.0, STIFF), name="light"), tunable=("joints.joint1.motor.inertia",))
    kernel = built(robot, "forward_dynamics")
    kernel.parameters["joints.joint1.motor.inertia"] = 0.0
    refused(SingularError, r"joint1\.motor", kernel.forward_dynamics, *np.zeros((3, 2)))


@pytest.mark.parametrize("seed", seeds(2000, 1, 6))
def test_zeros_and_blocks(seed: int, built: Build) -> None:
    """What the map says vanishes does, and every motor has its inertia alone."""
    robot = geared_robot(seed, (2, 4))
    model, kernel = build_model(robot), built(robot, "mass_matrix", "christoffel")
    zeros = zero_map(model)
    states = [motor_state(robot, i) for i in range(3)]
    C = np.abs([kernel.christoffel(s.q) for s in states]).max(axis=0)
    assert np.all(C[~zeros.christoffel.mask] < 1e-12)
    blocks = kernel.blocks(states[0].q)
    for gear in gears(robot):
        mask = zeros.mass_matrix.mask[gear.at].copy()
        assert mask[gear.at]
        mask[gear.at] = False
        assert not mask.any()
        assert not zeros.christoffel.mask[gear.at].any()
        name = model.coordinates[gear.at]
        assert blocks.mass[name, name] == gear.motor.inertia
        assert blocks.row(name, "motor")[[b.joint for b in model.bodies].index(name[:-6])] == gear.motor.inertia
    bare = zero_map(build_model(without_motors(robot)))
    for key in ("mass_matrix", "christoffel"):
        found, wanted = getattr(zeros, key), getattr(bare, key)
        assert dict(found.zeros).items() >= dict(wanted.zeros).items()
    assert (zeros.by_antisymmetry, zeros.independent) == (bare.by_antisymmetry, bare.independent)
    assert zeros.christoffel.survivors == bare.christoffel.survivors


def test_robots_without_motors_have_no_trace_of_them(built: Build) -> None:
    kernel = built(random_robot(2011, joints=(1, 1)), "energy")
    assert kernel.motors == {}
    refused(eomgen.UnknownNameError, "motor", kernel.ratio, "joint1.motor")
