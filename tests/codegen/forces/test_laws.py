"""Forces of coordinates beyond linear springs: against formulas with branches, SciPy, and the laws of mechanics."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import eomgen
from eomgen.adapters.mappings import DifferentiableFunction, kernels_for
from eomgen.analysis.holding import fixation_of
from eomgen.codegen.c.sources import render
from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.forces.laws import effect
from eomgen.codegen.forces.scalar_functions import Functions
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.tree.bound import BoundLaw
from eomgen.errors import ArrayError, EomgenWarning, InputError
from eomgen.export.mujoco import left_out, mjcf
from eomgen.integration.plan import choose_method
from eomgen.integration.solve import integrate
from eomgen.robot.laws import SHARP, SMOOTHING
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Friction, Joint, Link, Motor, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.assembly import kernels_of
from eomgen.state.drives import acceleration_slopes, drive_jacobian, places_of_forces
from eomgen.state.springs import coordinate_sizes, stiffnesses
from tests.oracles.complex_step import complex_steps
from tests.oracles.force_laws import (
    IN_TURNS,
    DriveOracle,
    LawOracle,
    coordinates,
    measured,
    random_coordinate,
    resistance,
    stored,
    with_drives,
    with_laws,
)
from tests.support.added_forces import (
    check_batches,
    check_closed_form,
    check_jacobians,
    check_oracle,
    check_single_precision,
)
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.optional import needs
from tests.support.random_robots import Array, State, random_robot, random_state, seeds
from tests.support.refusals import refused

TYPES = ("revolute", "prismatic", "fixed", "free")
NAMES = ("inverse_dynamics", "residual", "generalized_force", "forward_dynamics", "energy", "residual_jacobian")


def worn(seed: int, joints: tuple[int, int] = (1, 4)) -> Robot:
    return with_laws(random_robot(seed, joints=joints, tree=seed % 2 == 0, types=TYPES), seed)


def slider(mass: float = 2.0, name: str = "slider", **forces: Any) -> Robot:
    """A mass on a rail, no gravity."""
    link = Link("block", mass, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    joint = Joint("rail", "base", "block", "prismatic", coordinates={"z": Coordinate(**forces)})
    return Robot(name, (0.0, 0.0, 0.0), (link,), (joint,))


@pytest.mark.parametrize("seed", seeds(1300, 1, 12))
def test_forces_are_the_formulas(seed: int, built: Build) -> None:
    """One state at a time, and several on vectors."""
    robot = worn(seed)
    kernel, oracle = built(robot, *NAMES, "mass_matrix"), LawOracle(robot)
    states = [random_state(robot, seed + i) for i in range(9)]
    for s in states:
        check_oracle(kernel, oracle, s)
    check_batches(kernel, states, inverse_dynamics=3, generalized_force=2, energy=2)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(1320, 1, 10))
def test_slopes_are_those_of_the_forces(seed: int, built: Build) -> None:
    robot = worn(seed, (1, 3))
    check_jacobians(robot, [random_state(robot, seed + i) for i in range(3)], built)


@pytest.mark.parametrize("seed", [1330, 1331, 1332])
def test_closed_form_has_them(seed: int) -> None:
    """SymPy's equations against the program, on floats."""
    robot = with_laws(random_robot(seed, joints=(1, 2), max_size=3), seed)
    check_closed_form(robot, random_state(robot, seed))


@pytest.mark.parametrize("seed", seeds(1340, 1, 12))
def test_a_curve_is_scipys(seed: int, built: Build) -> None:
    """Values, slopes and energies; and again with other forces, set without recompiling."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 12))
    knots = np.cumsum(rng.uniform(0.01, 1.0, count)) - 1.5
    kernel = None
    for forces in (rng.uniform(-3, 3, count), np.sort(rng.uniform(-3, 3, count)), np.round(rng.uniform(-2, 2, count))):
        points = tuple(zip(knots.tolist(), forces.tolist(), strict=True))
        if kernel is None:
            kernel = built(slider(curve=points), "generalized_force", "residual_jacobian", "energy")
        kernel.parameters.update({f"joints.rail.z.curve.{i}": y for i, y in enumerate(forces.tolist())})
        scipys, s = PchipInterpolator(knots, forces), np.linspace(knots[0], knots[-1], 200)[:, None]
        at, none = np.concatenate([s, knots[:, None]]), np.zeros((200 + count, 1))
        assert close(kernel.generalized_force(at, none)[:, 0], -scipys(at[:, 0]), 1e-12)
        assert close(kernel.residual_jacobian(at, none, none)[0][:, 0, 0], scipys(at[:, 0], 1), 1e-10)
        energy, whole = kernel.energy(at, none)[:, 1], scipys.antiderivative()(at[:, 0])
        assert close(energy - energy[0], whole - whole[0], 1e-12)
        beyond = np.array([[knots[0] - 0.7], [knots[-1] + 0.7]])
        expected = [-measured(Coordinate(curve=points), float(x)) for x in beyond[:, 0]]
        if tuple(forces) == tuple(y for _, y in points):
            assert close(kernel.generalized_force(beyond, np.zeros((2, 1)))[:, 0], np.array(expected), 1e-12)
        assert abs(kernel.energy(np.zeros(1), np.zeros(1))[1]) <= 1e-12


def test_nothing_acts_inside_a_clearance(built: Build) -> None:
    kernel = built(slider(stiffness=1e7, clearance=1e-3, restitution_damping=0.4), "generalized_force", "energy")
    s = np.linspace(-1e-3, 1e-3, 41)[:, None]
    assert np.all(kernel.generalized_force(s, np.ones_like(s)) == 0.0)
    assert np.all(kernel.energy(s, 0 * s) == 0.0)
    outside = kernel.generalized_force(np.array([[-1.01e-3], [1.01e-3]]), np.zeros((2, 1)))
    assert outside[0] > 0.0 > outside[1]


@pytest.mark.parametrize("damping", [0.0, 0.6])
def test_a_clearance_creates_no_energy(damping: float, built: Build) -> None:
    """A mass that bounces between both ends: with damping energy falls at each of them, without it stays."""
    robot = slider(stiffness=4e4, stiffness_negative=2e4, cubic=1e6, clearance=0.02, smoothing=0.003)
    kernel = built(
        robot if not damping else replaced(robot, restitution_damping=damping), "rollout", "energy", "forward_dynamics"
    )
    q, v = kernel.rollout(np.zeros(1), np.array([1.5]), np.zeros(1), dt=2e-6, steps=250_000, every=50)
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.max(np.diff(energy)) <= 1e-7 * energy[0]
    assert np.count_nonzero(np.diff(np.sign(v[:, 0]))) >= 4  # that many times it has been thrown back
    assert energy[-1] < 0.5 * energy[0] if damping else abs(energy[-1] - energy[0]) <= 1e-6 * energy[0]


def replaced(robot: Robot, **forces: Any) -> Robot:
    joint = robot.joints[0]
    return replace(robot, joints=(replace(joint, coordinates={"z": replace(joint.coordinates["z"], **forces)}),))


def elastic_part(given: Coordinate) -> dict[str, float]:
    return {key: number for key, number in given.further.items() if not key.endswith("damping")}


@pytest.mark.parametrize("seed", seeds(1360, 1, 6))
def test_closed_cycles_take_energy(seed: int, built: Build) -> None:
    """Work of the forces of every coordinate along closed paths: never gained, and none where all is elastic."""
    robot = worn(seed).without_states()  # whose cycles are not those of a motion
    elastic = [
        replace(
            j,
            coordinates={
                k: replace(c, restitution_damping=None, friction=None, damping=None, further=elastic_part(c))
                for k, c in j.coordinates.items()
            },
        )
        for j in robot.joints
    ]
    rng = np.random.default_rng(seed)
    for name, joints in (("all", robot.joints), ("elastic", tuple(elastic))):
        still = replace(robot, name=f"cycle_{name}", joints=joints, gravity=(0.0, 0.0, 0.0))
        kernel = built(still, "generalized_force")
        t = np.arange(4000) / 4000 * 2 * np.pi
        amplitude, phase = rng.uniform(0.3, 0.9, kernel.n), rng.uniform(0, 6, kernel.n)
        q = amplitude * np.sin(t[:, None] + phase) + 0.2 * np.sin(2 * t[:, None])
        v = amplitude * np.cos(t[:, None] + phase) + 0.4 * np.cos(2 * t[:, None])
        work = np.mean(kernel.generalized_force(q, v) * v, axis=0) * 2 * np.pi
        assert np.all(work <= 1e-4), work
        if name == "elastic":
            assert np.all(np.abs(work) <= 1e-4), work


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_restitution_is_hunts_and_crossleys(side: float, built: Build) -> None:
    """At both ends: their equation in SciPy, and slow impacts that come back with 1 - alpha v of their speed v."""
    v0, mass, k = 0.5, 2.0, 1e5
    kernel = built(
        slider(mass, stiffness=k, clearance=0.01, smoothing=1e-6, restitution_damping=1.0),
        "rollout",
        "forward_dynamics",
    )
    for alpha in (0.015, 0.03, 0.06, 0.6):
        kernel.parameters["joints.rail.z.restitution_damping"] = 1.5 * alpha
        start = np.array([side * v0])
        _, v = kernel.rollout(np.zeros(1), start, np.zeros(1), dt=1e-6, steps=40_000, every=40_000)
        back = -side * v[-1, 0] / v0
        assert back == pytest.approx(published_restitution(alpha, v0, k, mass), abs=2e-4)
        assert back == pytest.approx(1.0 - alpha * v0, abs=2.0 * (1.5 * alpha * v0) ** 2)


def published_restitution(alpha: float, v0: float, k: float, mass: float) -> float:
    """Speed that comes back, over v0: m x'' = -(k x + 3/2 alpha k x x') from x = 0 on until it leaves."""

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], -k * y[0] * (1.0 + 1.5 * alpha * y[1]) / mass]

    def leaves(_: float, y: Array) -> float:
        return float(y[0])

    leaves.terminal, leaves.direction = True, -1.0  # type: ignore[attr-defined]
    found = solve_ivp(rate, (0.0, 1.0), [0.0, v0], rtol=1e-10, atol=1e-14, max_step=1e-4, events=leaves)
    return -float(found.y[1, -1]) / v0


def test_dry_friction_stops_a_mass(built: Build) -> None:
    """m v^2 / (2 F) is the way to rest; and at its level the force is Coulomb's."""
    robot = slider(mass=3.0, friction=Friction(coulomb=6.0, smoothing=1e-4))
    kernel = built(robot, "rollout", "forward_dynamics", "generalized_force")
    q, v = kernel.rollout(np.zeros(1), np.array([2.0]), np.zeros(1), dt=1e-5, steps=120_000, every=1000)
    assert q[-1, 0] == pytest.approx(3.0 * 4.0 / (2 * 6.0), rel=1e-3)
    assert abs(v[-1, 0]) < 1e-8
    assert kernel.generalized_force([0.0], [5.0]) == pytest.approx([-6.0])


@pytest.mark.parametrize("x", [1e-3, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("peak", [{}, {"static": 4.0, "stribeck": 0.5}, {"static": 4.0, "gaussian": 1e-3}])
def test_a_load_below_the_limit_creeps(x: float, peak: dict[str, float]) -> None:
    """Friction carries the part x of its limit at the velocity smoothing x / sqrt(1 - x^2): the creep of the docs."""
    numbers = {f"friction.{key}": number for key, number in {"coulomb": 3.0, **peak}.items()}
    smoothing = min(SMOOTHING, SHARP * peak.get("stribeck", peak.get("gaussian", 1.0)))
    creep = smoothing * x / np.sqrt(1.0 - x**2)
    functions = Functions(lambda name, *args: getattr(np, name)(*args))
    law = BoundLaw(0.0, 0.0, {**numbers, "friction.smoothing": smoothing})
    found = effect(law, 0.0, creep, functions).force
    assert found == pytest.approx(x * peak.get("static", 3.0), rel=1e-6)
    assert 10.0 * SMOOTHING * 0.9 / np.sqrt(1.0 - 0.9**2) == pytest.approx(0.8e-6, rel=0.05)


def test_a_gaussian_stribeck_curve(built: Build) -> None:
    """As exp(-(v / rate)^2) by itself, from slow rates to those where nothing of it is left; else a Lorentzian."""
    friction = Friction(coulomb=2.0, static=5.0, stribeck=0.1, shape="gaussian", smoothing=1e-9)
    rates = np.array([1e-6, 0.01, 0.05, 0.1, 0.2, 1.0, 10.0, 1e6])
    for sign in (1.0, -1.0):
        v = sign * rates
        expected = v / np.hypot(v, 1e-9) * (2.0 + 3.0 * np.exp(-((rates / 0.1) ** 2)))
        zero = np.zeros((len(v), 1))
        for dtype, off in (("float64", 1e-12), ("float32", 2e-6)):
            kernel = built(slider(friction=friction), "inverse_dynamics", dtype=dtype)
            force = np.asarray(kernel.inverse_dynamics(*(x.astype(dtype) for x in (zero, v[:, None], zero))))[:, 0]
            assert force == pytest.approx(expected, rel=off)
    assert Friction(2.0, 5.0, 0.1, shape="lorentzian") == Friction(2.0, 5.0, 0.1)
    assert "friction.gaussian" in friction.numbers()
    assert Friction.of({key[9:]: x for key, x in friction.numbers().items()}) == friction
    refused(ValueError, "shape 'bell'", Friction, 2.0, 5.0, 0.1, shape="bell")


def test_motion_is_scipys(built: Build) -> None:
    """All forces at once on one mass under a drive: the rollout against SciPy and the formulas with branches."""
    robot = slider(
        damping=0.4, preload=1.0, stiffness=900.0, stiffness_negative=500.0, cubic=2e4, clearance=0.1, smoothing=0.05,
        restitution_damping=0.8, friction=Friction(1.0, 1.6, 0.2, 0.1, 0.05),
    )  # fmt: skip
    kernel, given = built(robot, "rollout", "forward_dynamics"), robot.joints[0].coordinates["z"]

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], (3.0 - 0.4 * y[1] - resistance(given, y[0], y[1])) / 2.0]

    expected = solve_ivp(rate, (0.0, 1.0), [0.0, -2.5], rtol=1e-10, atol=1e-12, max_step=1e-3)
    q, v = kernel.rollout(np.zeros(1), np.array([-2.5]), np.array([3.0]), dt=2e-5, steps=50_000, every=50_000)
    assert q[-1, 0] == pytest.approx(expected.y[0, -1], abs=1e-7)
    assert v[-1, 0] == pytest.approx(expected.y[1, -1], abs=1e-6)


@pytest.mark.soak
@pytest.mark.parametrize("seed", [*seeds(1370, 1, 1), *seeds(1372, 0, 3)])
def test_implicit_steps_are_those_of_the_formula(seed: int, built: Build) -> None:
    """Forces and tangents where the rate leads to, tangents that fall left out: with the whole matrix, in NumPy.

    Friction counts by its secant, not by its tangent.  Internal states are left out: ``test_state_laws`` has them.
    """
    robot = worn(seed).without_states()
    kernel = built(robot, "rollout", *NAMES, "mass_matrix", "bias_force")
    s, dt, steps = random_state(robot, seed), 4e-3, 10
    laws = [bool(c.law()) for j in robot.joints for c in j.coordinates.values()]
    bare = built(
        replace(robot, name="bare", joints=tuple(
            replace(j, coordinates={k: c if not c.law() else Coordinate() for k, c in j.coordinates.items()})
            for j in robot.joints)),
        "residual_jacobian",
    )  # fmt: skip
    none, q, v = np.zeros(kernel.n), s.q, s.v
    for _ in range(steps):
        ahead = q + dt * v
        by_q, by_v, _ = kernel.residual_jacobian(ahead, v, none)
        geometry = bare.residual_jacobian(ahead, v, none)
        linear = np.array(
            [(c.stiffness or 0.0, c.damping or 0.0) for j in robot.joints for c in j.coordinates.values()]
        )
        K, B = (np.where(laws, np.diag(full - part), line)
                for full, part, line in zip((by_q, by_v), geometry, linear.T, strict=False))  # fmt: skip
        damping = linear[:, 1]
        bent = dt * (B - damping) + dt * dt * K
        for i, c in enumerate(c for j in robot.joints for c in j.coordinates.values()):
            straight = c.stiffness if c.clearance is None and c.stiffness_negative is None and c.stiffness else 0.0
            bent[i] = dt * damping[i] + dt * dt * straight + max(bent[i] - dt * dt * straight, 0.0)
            if c.friction is not None:  # beside a linear spring alone
                load = LawOracle(robot).loads(ahead, v)[i]
                secant = resistance(Coordinate(friction=c.friction), 0.0, v[i], load) / v[i]
                bent[i] = dt * (damping[i] + secant) + dt * dt * (c.stiffness or 0.0)
        weights = kernel.generalized_force(q, none) - kernel.generalized_force(ahead, none)
        gravity = weights + np.array([
            resistance(c, q[i], 0.0) - resistance(c, ahead[i], 0.0)
            for i, c in enumerate(c for j in robot.joints for c in j.coordinates.values())
        ])  # fmt: skip
        right = s.u - kernel.bias_force(q, v) + kernel.generalized_force(ahead, v) + gravity
        v = v + dt * np.linalg.solve(kernel.mass_matrix(q) + np.diag(bent), right)
        q = q + dt * v
    qs, vs = kernel.rollout(s.q, s.v, s.u, dt, steps, method="implicit")
    assert close(qs[-1], q, 1e-8)
    assert close(vs[-1], v, 1e-8)


def test_implicit_steps_stay_inside_a_stiff_clearance(built: Build) -> None:
    """Steps a hundred times too long for an explicit method: no impact gives speed."""
    robot = slider(stiffness=1e9, clearance=0.02, smoothing=1e-4, restitution_damping=0.5)
    kernel = built(robot, "rollout", "forward_dynamics")
    q, v = kernel.rollout(np.zeros(1), np.array([3.0]), np.zeros(1), dt=1e-3, steps=2000, method="implicit")
    assert np.max(np.abs(q)) <= 0.02 + 3.0 * 1e-3  # the way of one step
    assert np.max(np.abs(v)) <= 3.0 * (1 + 1e-12)
    assert np.abs(v[-1, 0]) < 1.0


@pytest.mark.soak
def test_simulation_with_clearances(built: Build) -> None:
    """Radau, a start inside the gap, and energy: gravity's work and what contacts take."""
    robot = replaced(slider(name="dropped"), stiffness=1e6, clearance=5e-3, restitution_damping=1.0)
    robot = replace(robot, gravity=(0.0, 0.0, -9.81))
    kernel = built(robot, "forward_dynamics", "energy", "mass_matrix", "inverse_dynamics")
    found = integrate(kernel, np.zeros(1), np.zeros(1), 0.5)
    assert found.method == "scipy:Radau"
    energy = np.asarray(found.energy).sum(axis=1)
    assert np.max(np.diff(energy)) <= 1e-4 * np.abs(energy).max()
    assert found.q[-1, 0] == pytest.approx(-5e-3, abs=2e-4)


def test_parameters_are_checked(built: Build) -> None:
    numbers = {"stiffness": 1e4, "friction": Friction(1.0, 2.0, 0.1), "clearance": 0.1}
    kernels = built(slider(**numbers), "generalized_force"), built(slider(further=GIVEN), "generalized_force")
    keys = ("clearance", "stiffness", "friction.coulomb", "friction.static"), ("exponential.force",)
    smallest = ("smoothing", "friction.smoothing", "friction.stribeck"), ("exponential.scale",)
    for kernel, least, tiny in zip(kernels, keys, smallest, strict=True):
        for key in least:
            with pytest.raises(InputError, match=f"rail.z.{key} = -1.0 is negative"):
                kernel.parameters[f"joints.rail.z.{key}"] = -1.0
        for key in tiny:
            with pytest.raises(InputError, match=f"rail.z.{key} = 0.0 is too small; at least 1e-12"):
                kernel.parameters[f"joints.rail.z.{key}"] = 0.0
    first, second = kernels
    assert first.parameters["joints.rail.z.smoothing"] == pytest.approx(5e-3)
    first.parameters["joints.rail.z.clearance"] = 0.2
    assert first.generalized_force([0.19], [0.0]) == pytest.approx([0.0], abs=1e-12)
    second.parameters.update({"joints.rail.z.exponential.force": 2.0, "joints.rail.z.exponential.scale": 0.1})
    assert second.generalized_force([0.1], [0.0]) == pytest.approx([-2.0 * (np.e - 1.0)], rel=1e-14)


F, SCALE = 3.0, 0.05
GIVEN = {"exponential.force": F, "exponential.scale": SCALE}


def test_energy_is_conserved(built: Build) -> None:
    """A mass that swings between the soft side and the steep one; implicitly it loses, and never gains."""
    kernel = built(slider(further=GIVEN), "rollout", "energy", "forward_dynamics")
    q, v = kernel.rollout(np.zeros(1), np.array([1.0]), np.zeros(1), dt=1e-4, steps=30_000, every=10)
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.max(np.abs(energy - energy[0])) <= 1e-9 * energy[0]
    assert q.min() < -0.2
    assert q.max() > 0.1
    q, v = kernel.rollout(np.zeros(1), np.array([1.0]), np.zeros(1), dt=2e-3, steps=3000, method="implicit")
    energy = kernel.energy(q, v).sum(axis=1)
    assert energy[-1] < energy[0]
    assert energy.max() <= 1.02 * energy[0]


def test_what_counts_as_its_stiffness(built: Build) -> None:
    """That at s = 0, on top of the linear spring's: "auto" is implicit, sizes follow, and it holds its coordinate."""
    robot = slider(further=GIVEN)
    kernel = built(robot, "forward_dynamics", "mass_matrix", "energy", "inverse_dynamics", "forward_dynamics_jacobian")
    assert stiffnesses(kernel) == pytest.approx([F / SCALE])
    assert stiffnesses(built(replaced(robot, stiffness=40.0), "energy")) == pytest.approx([40.0 + F / SCALE])
    assert coordinate_sizes(kernel, np.zeros(1))[0] == pytest.approx([min(1.0, 10.0 * 2.0 / (F / SCALE))])
    assert choose_method(kernel) == "scipy:Radau"
    assert robot.joints[0].coordinates["z"].has_stiffness
    deviation = replace(robot, joints=(replace(robot.joints[0], type="fixed"),))
    assert not fixation_of(deviation, built(replace(deviation, name="deviation"), "energy")).still.any()
    kernel.parameters["joints.rail.z.exponential.force"] = 0.0
    assert choose_method(kernel) == "scipy:DOP853"


def test_a_simulation(built: Build) -> None:
    """Radau against the static deviation under a constant drive, which a logarithm gives."""
    robot = slider(damping=20.0, further=GIVEN)
    kernel = built(robot, "forward_dynamics", "mass_matrix", "energy", "inverse_dynamics", "forward_dynamics_jacobian")
    found = integrate(kernel, np.zeros(1), np.zeros(1), 8.0, drive=lambda t, q, v: np.full_like(q, 30.0))
    assert found.method == "scipy:Radau"
    assert found.q[-1, 0] == pytest.approx(SCALE * np.log(1.0 + 30.0 / F), rel=1e-5)


def test_overflow_is_named(built: Build) -> None:
    kernel = built(
        slider(further=GIVEN), "forward_dynamics", "mass_matrix", "energy", "inverse_dynamics", "generalized_force"
    )
    with pytest.raises(ArrayError, match=r"generalized_force: rail\.z is -inf, out of numbers that are finite"):
        kernel.generalized_force([1000.0 * SCALE], [0.0])
    assert kernel.replaced(checks=False).generalized_force([1000.0 * SCALE], [0.0]) == [-np.inf]
    assert kernel.generalized_force([-1000.0 * SCALE], [0.0]) == [F]
    with pytest.raises(ArrayError, match=r"forward_dynamics: rail\.z is -inf"):
        integrate(kernel, np.array([1000.0 * SCALE]), np.zeros(1), 0.1, method="scipy:DOP853")


def test_mujoco_has_no_equal(tmp_path: Path) -> None:
    robot, mujoco = slider(stiffness=40.0, further=GIVEN), needs("mujoco")
    assert left_out(robot) == ["joints.rail.z.exponential: left out"]
    refused(InputError, r"no equal for joints\.rail\.z\.exponential: left out; allowed: without", mjcf, robot, 1e-3)
    with pytest.warns(EomgenWarning, match="exponential: left out"):
        path = eomgen.export_mjcf(robot, tmp_path / "slider.xml", approximate=True)
    assert mujoco.MjModel.from_xml_path(str(path)).jnt_stiffness == [40.0]


def test_transmissions_have_it(built: Build) -> None:
    """It may be a motor's only spring, in units of the joint's side."""
    robot = replace(slider(), joints=(replace(slider().joints[0], motor=Motor(0.1, 50.0, Coordinate(further=GIVEN))),))
    kernel = built(robot, "inverse_dynamics", "forward_dynamics", "energy", "mass_matrix")
    phi = 0.08
    q = np.array([0.3, 50.0 * (0.3 + phi)])
    force = F * np.expm1(phi / SCALE)
    assert kernel.inverse_dynamics(q, [0.0, 0.0], [0.0, 0.0]) == pytest.approx([-force, force / 50.0], rel=1e-13)
    assert kernel.energy(q, [0.0, 0.0])[1] == pytest.approx(F * (SCALE * np.expm1(phi / SCALE) - phi), rel=1e-12)
    assert stiffnesses(kernel) == pytest.approx([F / SCALE, F / SCALE / 2500.0])


def test_closed_form() -> None:
    form = readable_closed_form(build_model(slider(further=GIVEN)))
    assert any("exp(20.0*z_1)" in line for line in form.lines())
    assert "e^{20.0" in form.latex()


def test_bias_without_it(built: Build) -> None:
    """Derivatives of the bias force, which no spring is part of, also where the scale is a micrometre."""
    robot = slider(further={"exponential.force": 5.0, "exponential.scale": 1e-6})
    kernel = built(robot, *kernels_for("bias_force", "generalized_force"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert DifferentiableFunction(kernel, "bias_force").derivatives(np.zeros(1), np.ones(1))[0] == [[0.0]]
        by_q = DifferentiableFunction(kernel, "generalized_force").derivatives(np.zeros(1), np.zeros(1))[0]
    assert by_q == pytest.approx(np.array([[-5e6]]))


def test_scenarios_build_what_its_method_asks_for() -> None:
    implicit, explicit = (
        scenario_from_toml(f"duration = 1.0\n[integrator]\nmethod = '{x}'") for x in ("scipy:Radau", "rk4")
    )
    robot = slider(further=GIVEN)
    assert "adaptive_rollout" in kernels_of(robot, scenario_from_toml("duration = 1.0"))
    assert set(kernels_of(robot, implicit)) > set(kernels_of(robot, explicit))


@pytest.mark.parametrize(
    ("name", "words"),
    [("puma560", ("larger", "positive", "root", "exponential", "EOMGEN_INLINE")), ("ur5", ("spring_",))],
)
def test_others_have_no_code_of_forces(name: str, words: tuple[str, ...]) -> None:
    """Neither comparisons nor roots nor springs are in the C of a robot that has none of these forces."""
    source = render(derive_equations(build_model(eomgen.load_robot(name))))
    assert not any(word in code for word in words for code in source.codes.values())
    assert "spring_" not in source.header + source.meta


def rack() -> Robot:
    """A slide without gravity for each law that has no state."""
    rng, given = np.random.default_rng(3), Coordinate(40.0, 0.5)
    table = [random_coordinate(rng, kind, given) for kind in IN_TURNS]
    contact = replace(given, clearance=0.1, smoothing=0.01, restitution_damping=0.5)
    stops = {
        "stiffness": 4e3,
        "damping": 6.0,
        "restitution_damping": 0.3,
        "smoothing": 2e-3,
        "lower": -0.1,
        "upper": 0.2,
    }
    table += [replace(contact, stiffness=1e3), replace(given, further={f"stops.{key}": x for key, x in stops.items()})]
    friction = Friction(coulomb=2.0, static=5.0, stribeck=0.1, viscous=0.2, smoothing=1e-3)
    table += [replace(given, friction=friction), replace(given, cubic=7.0, preload=1.5, further=GIVEN)]
    links = tuple(replace(slider().links[0], name=f"block{i}") for i in range(len(table)))
    joints = tuple(
        replace(slider().joints[0], name=f"rail{i}", child=f"block{i}", coordinates={"z": law})
        for i, law in enumerate(table)
    )
    return replace(slider(name="rack"), links=links, joints=joints)


def test_every_law_on_a_slide(built: Build) -> None:
    """Forces and energies of the formulas with branches, slopes of complex steps; batches to the bit, and float32."""
    robot = rack()
    kernel, table = built(robot, "generalized_force", "residual_jacobian", "energy"), list(coordinates(robot))
    beside = [0.1, 0.105, 0.11, 0.2, 0.201, 0.2015]
    s, v = np.meshgrid(
        [*np.linspace(-0.4, 0.3, 36), *beside, *(-x for x in beside)], [-3.0, -0.2, -1e-3, 0.0, 0.05, 3.0]
    )
    q, rates = (np.repeat(x.ravel()[:, np.newaxis], kernel.n, axis=1) for x in (s, v))
    found = kernel.generalized_force(q, rates)
    for i, law in enumerate(table):
        forces = [resistance(law, *state) + 0.5 * state[1] for state in zip(s.ravel(), v.ravel(), strict=True)]
        assert close(-found[:, i], np.array(forces), 1e-13), i
    energies = [sum(stored(law, x) for law in table) for x in s[0]]
    assert close(kernel.energy(q[: s.shape[1]], 0.0 * q[: s.shape[1]])[:, 1], np.array(energies), 1e-11)
    assert abs(kernel.energy(0.0 * q[0], rates[0])[1]) <= 1e-14
    states = list(zip(q[::7], rates[::7], strict=True))
    assert np.array_equal(found[::7], [kernel.generalized_force(*state) for state in states])
    for x, y in states[::4]:
        motion = State(x, y, 0.0 * x, 0.0 * x)
        for block, name in zip(kernel.residual_jacobian(x, y, motion.a), "qva", strict=True):
            assert close(block, complex_steps(robot, motion, name))
    check_single_precision(kernel, robot, (q, rates), built, 2e-4)


def driven(seed: int, joints: tuple[int, int] = (1, 3), size: int = 5) -> Robot:
    """A random robot with a drive at least."""
    for attempt in range(50):
        robot = random_robot(seed + 1000 * attempt, joints=joints, max_size=size, types=TYPES[:3], armature=True)
        robot = with_drives(with_laws(robot, seed), seed)
        if build_model(robot).drives:
            return robot
    raise AssertionError(seed)


@pytest.mark.parametrize("seed", seeds(1360, 1, 16))
def test_kernels_are_the_equations_of_drives(seed: int, built: Build) -> None:
    robot = driven(seed)
    kernel, oracle = built(robot), DriveOracle(robot)
    n, states = len(kernel.coordinates), [random_state(robot, seed + i) for i in range(6)]
    run = partial(kernel.calls.run, out=None, whole=True)
    for s in states:
        Q, V, A, U = oracle.arrays(s)
        driven_by, state = (s.u, s.forces), (s.q, s.v, s.z, s.u, s.forces)
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a, z=s.z), oracle.inverse_dynamics(Q, V, A)[:n])
        residual = run("residual", values=(s.q, s.v, s.z, s.a, *driven_by))
        assert close(residual, oracle.residual(Q, V, A, U)[:n])
        forces, _, voltages = oracle.driven(Q, V, U)
        found, behind = run("drive_forces", values=state), list(build_model(robot).states_of_drives)
        assert close(found[:n], forces[:n])
        assert close(found[behind], voltages[behind])
        allowed = max(1e-11, 100 * np.finfo(float).eps * np.linalg.cond(kernel.mass_matrix(s.q)))
        found, expected = run("forward_dynamics", values=state), oracle.forward_dynamics(Q, V, U)
        assert close(found[:n], expected[:n], allowed)
        assert close(found[n:], expected[n:])
        assert close(kernel.energy(s.q, s.v, z=s.z), oracle.energy(Q, V))
    arrays = [np.array([getattr(s, x) for s in states]) for x in ("q", "v", "z", "u", "forces")]
    alone = [run("forward_dynamics", values=x) for x in zip(*arrays, strict=True)]
    assert close(run("forward_dynamics", values=arrays), np.array(alone), 1e-12)


@pytest.mark.parametrize("seed", seeds(1380, 1, 16))
def test_slopes_are_those_of_drives(seed: int, built: Build) -> None:
    """M da = (drives' slopes - residual's) d, and drives' slopes are differences of what they do."""
    robot = driven(seed)
    kernel, oracle = built(robot), DriveOracle(robot)
    n, calls = kernel.n, kernel.calls
    for i in range(3):
        s = random_state(robot, seed + i)
        Q, V, _, U = oracle.arrays(s)
        a = calls.run("forward_dynamics", None, (s.q, s.v, s.z, s.u, s.forces))
        by_q, by_v, M = calls.run("residual_jacobian", None, (s.q, s.v, a), z=s.z, whole=True)
        ours = drive_jacobian(kernel, s.q, V, s.u)
        scale = 1.0 / np.diagonal(M).copy()
        scale[:n] = 1.0 / np.abs(M[:n, :n]).max()
        blocks = acceleration_slopes(kernel, s.q, V, s.u, s.forces)
        wanted = (ours[0] - by_q, ours[1] - by_v, ours[2])
        for block, other in zip(blocks, wanted, strict=True):
            assert close(scale[:, None] * (M @ block), scale[:, None] * other, 1e-8)
        w = np.where(np.isnan(oracle.inertias()), 1.0, oracle.inertias())
        for which, slopes in enumerate(ours):
            for k in range(oracle.size) if which < 2 else {*range(n), *places_of_forces(kernel)}:
                h, ends, beside = 1e-6, [], []
                for sign in (1.0, -1.0, 2.0, -2.0):
                    moved = [Q.copy(), V.copy(), U.copy()]
                    moved[which][k] += sign * h
                    forces, rates, _ = oracle.driven(*moved)
                    kept = np.where(np.isnan(oracle.inertias()), forces, w * rates)
                    (ends if abs(sign) == 1.0 else beside).append(kept)
                one, two = (ends[0] - ends[1]) / (2.0 * h), (beside[0] - beside[1]) / (4.0 * h)
                smooth = np.abs(one - two) <= 1e-6 * (w + np.abs(one))  # no limit in between
                found = slopes[:, k] / w
                assert (np.abs(found - one / w) <= 1e-5 * (1.0 + np.abs(one / w)))[smooth].all(), (which, k)


@pytest.mark.parametrize("seed", [1400, 1401, 1402])
def test_closed_forms_have_drives(seed: int) -> None:
    robot = driven(seed, (1, 2), 3)
    model, oracle, s = build_model(robot), DriveOracle(robot), random_state(robot, seed)
    n = len(model.coordinates)
    s = replace(s, forces=0.0 * s.forces)
    function = closed_form(model).function("residual", "rates")
    residual, rates = function(s.q, s.v, s.a, s.u, z=s.z)
    Q, V, A, U = oracle.arrays(s)
    assert close(residual, oracle.residual(Q, V, A, U)[:n])
    places = list(model.states_of_drives)
    assert close(rates[[k - n for k in places]], oracle.driven(Q, V, U)[1][places])


@pytest.mark.parametrize("seed", seeds(1410, 1, 12))
def test_motions_by_all_methods_agree_and_energies_balance(seed: int, built: Build) -> None:
    """What drives take in is what energies gain and what dissipates; friction by its own smoothing."""
    robot = driven(seed, (1, 2), 4)
    kernel = built(robot)
    s = random_state(robot, seed)
    z, options = 0.1 * s.z, {"duration": 0.02, "samples": 2}
    motions: list[Array] = []
    for method, rtol in (("tsit5", 1e-8), ("rosenbrock", 1e-7), ("radau", 1e-8)):
        chosen: Any = {"method": method, "rtol": rtol, **options}
        motion = kernel.rollout(0.1 * s.q, 0.1 * s.v, s.u, z=z, **chosen)
        motions.append(np.hstack([*motion, motion.z]))
    for other in motions[:-1]:
        assert close(other, motions[-1], 2e-5)
    found = integrate(
        kernel, 0.1 * s.q, 0.1 * s.v, z0=z, duration=0.02, drive=s.u, method="radau", rtol=1e-8, works=True
    )
    gained = found.energy[-1].sum() - found.energy[0].sum()
    assert gained == pytest.approx(
        float((found.works[-1] - found.works[0]) @ [1.0, 1.0, 1.0, -1.0]), rel=1e-5, abs=1e-6
    )
