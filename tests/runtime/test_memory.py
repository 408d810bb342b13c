"""Laws with states: LuGre friction beside its formulas, the published experiment, dense steps, and balances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, DescriptionError, InputError
from eomgen.runtime.stepping.input_signals import DriveData, InputSignals, Signal, Track
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

STIFFNESS, DAMPING, VISCOUS, COULOMB, STATIC, STRIBECK = 1e5, float(np.sqrt(1e5)), 0.4, 1.0, 1.5, 1e-3  # published
PULL = 2.0  # N/m of the spring that pulls a mass of 1 kg
BLOCK = """
name = "block"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "body"
mass = 1.0
inertia = {{ xx = 0.1, yy = 0.1, zz = 0.1 }}
[[joints]]
name = "slide"
type = "prismatic"
parent = "base"
child = "body"
z = {{ stiffness = {pull}, friction = {{ {friction} }} }}
"""
PUBLISHED = (
    f'model = "lugre", coulomb = {COULOMB}, static = {STATIC}, stribeck = {STRIBECK}, bristle_stiffness = {STIFFNESS},'
    f" bristle_damping = {DAMPING}, viscous = {VISCOUS}"
)
ARM = """
name = "remembering_arm"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "l1"
mass = 2.0
com = [0.2, 0.01, 0.0]
inertia = { xx = 0.1, yy = 0.12, zz = 0.13 }
[[links]]
name = "l2"
mass = 1.0
com = [0.2, 0.0, 0.05]
inertia = { xx = 0.02, yy = 0.03, zz = 0.04 }
[[links]]
name = "l3"
mass = 0.5
com = [0.1, 0.0, 0.02]
inertia = { xx = 0.01, yy = 0.01, zz = 0.02 }
[[joints]]
name = "j1"
type = "revolute"
parent = "base"
child = "l1"
gamma = { friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e4, bristle_damping = 30.0, fade = 0.05 } }
[joints.motor]
inertia = 1e-4
ratio = 50.0
stiffness = 1e4
damping = 5.0
friction = { model = "lugre", coulomb = 0.02, static = 0.03, stribeck = 1.0, bristle_stiffness = 20.0 }
[[joints]]
name = "j2"
type = "revolute"
parent = "l1"
child = "l2"
placement = { xyz = [0.4, 0.0, 0.0], rpy = [0.5, 0.0, 0.0] }
x = { stiffness = 1e5, damping = 100.0 }
beta = { stiffness = 1e3, damping = 1.0, friction = { model = "lugre", coulomb = 0.1, bristle_stiffness = 1e3 } }
gamma = { friction = { model = "lugre", coulomb = 0.5, bristle_stiffness = 1e3, bristle_damping = 2.0 } }
stiffness = { matrix = [[1e4, 10.0, 0.0], [10.0, 20.0, 5.0], [0.0, 5.0, 10.0]] }
[[joints]]
name = "j3"
type = "revolute"
parent = "l2"
child = "l3"
placement = { xyz = [0.3, 0.0, 0.0] }
gamma = { role = "prescribed", friction = { model = "lugre", coulomb = 0.1, bristle_stiffness = 1e3 } }
[[springs]]
name = "s1"
links = ["base", "l2"]
points = [[0.1, 0.5, 0.0], [0.2, 0.0, 0.0]]
stiffness = 300.0
damping = 3.0
free_length = 0.3
"""
KERNELS = (
    *("forward_dynamics", "residual", "inverse_dynamics", "energy", "mass_matrix", "residual_jacobian"),
    *("forward_dynamics_jacobian", "generalized_force", "rollout", "adaptive_rollout", "radau_rollout"),
)


def block(friction: str = PUBLISHED, pull: float = PULL) -> eomgen.Robot:
    return robot_from_toml(BLOCK.format(friction=friction, pull=pull))


def rates(v: Any, z: Any) -> tuple[Any, Any]:
    """Return z' and the friction of the published numbers, as the paper writes them."""
    level = COULOMB + (STATIC - COULOMB) * np.exp(-((v / STRIBECK) ** 2))
    rate = v - STIFFNESS * np.abs(v) * z / level
    return rate, STIFFNESS * z + DAMPING * rate + VISCOUS * v


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(block(), *KERNELS)


@pytest.fixture(scope="module")
def arm(built: Build) -> eomgen.Kernel:
    return built(robot_from_toml(ARM), *KERNELS)


def state_of(kernel: eomgen.Kernel, seed: int = 3) -> tuple[Any, Any, Any, Any]:
    """Return q, v, u of coordinates and z, as large as bristles bend."""
    rng, n = np.random.default_rng(seed), len(kernel.coordinates)
    q, v, u = (rng.normal(size=n) * size for size in (0.1, 0.1, 1.0))
    places = {name: i for i, name in enumerate(kernel.coordinates)}
    for name, led in kernel.motors.items():
        q[places[name]] = kernel.ratio(name) * q[places[led]] + 0.01
    sizes = np.asarray(kernel.raw.libraries.meta["sizes"])
    return q, v, u, 0.5 * rng.uniform(-1.0, 1.0, len(kernel.memory)) * sizes[len(sizes) - len(kernel.memory) :]


def test_friction_is_the_papers(kernel: eomgen.Kernel) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, v, z, u = rng.normal(size=4) * [1.0, 2e-3, 1e-5, 1.0]
        rate, force = rates(v, z)
        a = kernel.forward_dynamics([x], [v], [u], [z])
        assert a == pytest.approx([u - PULL * x - force], rel=1e-12, abs=1e-12)
        assert kernel.memory_rates([x], [v], [z]) == pytest.approx([rate], rel=1e-12, abs=1e-15)
        kinetic, potential = kernel.energy([x, 0.0], [v, z])
        assert (kinetic, potential) == pytest.approx((0.5 * v * v, 0.5 * (PULL * x * x + STIFFNESS * z * z)), rel=1e-12)


def test_published_experiment(kernel: eomgen.Kernel) -> None:
    """A unit mass is pulled by a spring at 0.1 m/s: it sticks, breaks away at 1.5 N and slips."""
    end = 9.0

    def derivatives(t: float, y: Any) -> Any:
        rate, force = rates(y[1], y[2])
        return np.array([y[1], PULL * (0.1 * t - y[0]) - force, rate])

    times = np.linspace(0.0, end, 19)
    tolerances = {"rtol": 1e-12, "atol": [1e-14, 1e-14, 1e-17]}
    y = solve_ivp(derivatives, (0.0, end), np.zeros(3), method="DOP853", t_eval=times, **tolerances).y
    pulled = Signal(np.array([0.0, end]), np.array([[[0.0], [0.1 * PULL]]]))
    loads = InputSignals(DriveData(torque=Track(pulled, np.array([0]))))
    assert y[0].max() > 0.1  # it slipped
    for method, rtol, most in (("tsit5", 1e-8, 1e-5), ("rosenbrock", 1e-8, 1e-5), ("radau", 1e-8, 1e-7)):
        motion = kernel.rollout([0.0], [0.0], duration=end, samples=18, method=method, rtol=rtol, loads=loads, z=[0.0])
        q, v = motion
        errors = q[:, 0] - y[0], v[:, 0] - y[1], STIFFNESS * (motion.z[:, 0] - y[2])
        assert max(np.abs(x).max() for x in errors) < most, method


@pytest.mark.parametrize("v", [1e-4, -1e-3, 2e-3, 0.05])
def test_implicit_step_is_the_dense_one(kernel: eomgen.Kernel, v: float) -> None:
    """(M + dt B + dt^2 K) a = u - h at q + dt v, without the row of the force where its slopes would fall."""
    dt, state = 1e-3, (np.array([0.2, 0.0]), np.array([v, 3e-6]))
    q, rate = state[0] + dt * state[1] * [1.0, 0.0], state[1]
    K, B, M = kernel.residual_jacobian(q, rate, np.zeros(2))
    share = dt * B[0, 0] - dt * dt * B[0, 1] * B[1, 0] / (M[1, 1] + dt * B[1, 1])
    if share < 0.0:
        B[0] = 0.0
    a = np.linalg.solve(M + dt * B + dt * dt * K, -kernel.inverse_dynamics(q, rate, np.zeros(2)))
    stepped = kernel.rollout(*state, dt=dt, steps=1, method="implicit")[1][-1]
    assert stepped == pytest.approx(state[1] + dt * a, rel=1e-10, abs=1e-18)


def test_arm_is_consistent(arm: eomgen.Kernel) -> None:
    """Motors, prescribed coordinates, matrices, springs: residual, slopes, mass matrix."""
    q, v, u, z = state_of(arm)
    n, free = q.size, np.array([name not in arm.prescribed for name in arm.velocities])
    Q, V, U = np.r_[q, 0.0 * z], np.r_[v, z], np.r_[u, 0.0 * z]
    a = arm.forward_dynamics(Q, V, U)
    assert (a[:n] == arm.forward_dynamics(q, v, u, z)).all()
    assert (a[n:] == arm.memory_rates(q, v, z, u)).all()
    assert np.abs(arm.residual(Q, V, a, U)[free]).max() < 1e-9
    by_q, by_v, _ = arm.forward_dynamics_jacobian(Q, V, U)
    for j in range(Q.size):
        step = 1e-7 * np.eye(Q.size)[j] * (1.0 if j < n else 1e-3)
        rise = [(arm.forward_dynamics(Q, V + x * step, U)) for x in (-1.0, 1.0)]
        assert (rise[1] - rise[0]) / (2.0 * step.sum()) == pytest.approx(
            by_v[:, j], rel=1e-4, abs=1e-4 * np.abs(by_v[:, j]).max()
        )
        assert (by_q[:, j] == 0.0).all() or j < n  # no position of a state acts on anything


def test_methods_agree_and_balance(arm: eomgen.Kernel) -> None:
    """All methods go to one motion, and its energies balance: bristles store what they do not dissipate."""
    q, v, u, z = state_of(arm)
    duration = 0.01

    def end(**options: Any) -> Any:
        motion = arm.rollout(q, v, u, z=z, **options)
        return np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]])

    whole = end(duration=duration, method="radau", rtol=1e-11)
    for method, rtol, most in (("tsit5", 1e-8, 1e-6), ("rosenbrock", 1e-8, 1e-5), ("radau", 1e-6, 1e-4)):
        assert end(duration=duration, method=method, rtol=rtol) == pytest.approx(whole, rel=most), method
    coarse, fine = (np.abs(end(dt=dt, steps=round(duration / dt), method="rk4") - whole) for dt in (8e-6, 4e-6))
    assert (fine < 0.3 * coarse + 1e-9 * np.abs(whole)).all()
    coarse, fine = (np.abs(end(dt=dt, steps=round(duration / dt), method="implicit") - whole) for dt in (2e-5, 1e-5))
    assert (fine < 0.7 * coarse + 1e-6 * np.abs(whole)).all()
    motion = arm.rollout(q, v, u, z=z, duration=duration, method="radau", rtol=1e-10, works=True)
    states = (np.concatenate([motion[0], 0.0 * motion.z], axis=-1), np.concatenate([motion[1], motion.z], axis=-1))
    energy, (drives, prescribed, wrenches, dissipated) = arm.energy(*states).sum(axis=-1), motion.works[-1]
    assert dissipated > 0.0
    assert energy[-1] - energy[0] == pytest.approx(drives + prescribed + wrenches - dissipated, abs=1e-9)


def test_lanes_are_bit_equal(arm: eomgen.Kernel) -> None:
    q, v, u, z = state_of(arm)
    Q, V, Z = np.tile(q, (5, 1)), v + 0.01 * np.arange(5)[:, None], np.tile(z, (5, 1))
    for method in ("tsit5", "rosenbrock", "radau"):
        many = arm.rollout(Q, V, u, z=Z, duration=0.01, method=method)
        for i in range(5):
            alone = arm.rollout(Q[i], V[i], u, z=Z[i], duration=0.01, method=method)
            assert all((x[i] == y).all() for x, y in zip((*many, many.z), (*alone, alone.z), strict=True))


@pytest.mark.parametrize(
    ("friction", "said"),
    [
        ('model = "lugre", coulomb = 1.0', "bristle_stiffness"),
        ("coulomb = 1.0, bristle_stiffness = 1e5", 'model = "lugre"'),
        ("coulomb = 1.0, bristle_damping = 3.0", "no bristle_stiffness"),
        ('model = "lugre", coulomb = 0.0, bristle_stiffness = 1e5', "bristles yield"),
        ('model = "lugre", coulomb = 1.0, bristle_stiffness = 1e5, smoothing = 1e-3', "the model is lugre"),
        ('model = "lugre", coulomb = 1.0, bristle_stiffness = 1e5, bristle_damping = 316.0, fade = 1.0', "fade"),
        ('model = "dahl", coulomb = 1.0', "dahl"),
    ],
)
def test_what_cannot_be_is_refused(friction: str, said: str) -> None:
    with pytest.raises(DescriptionError, match=said):
        block(friction)


def test_a_fade_that_keeps_friction_passive_is_taken() -> None:
    """sigma_1 v exp(-(v / fade)^2) is at most 0.43 sigma_1 fade: with 316 N s/m and 4 N up to fades of 0.029 m/s."""
    text = f'model = "lugre", coulomb = 1.0, bristle_stiffness = 1e5, bristle_damping = {DAMPING}, fade = '
    block(text + "0.0294")
    with pytest.raises(DescriptionError, match="fade"):
        block(text + "0.0297")


def test_states_of_no_law_and_of_another_shape_are_refused(kernel: eomgen.Kernel, built: Build) -> None:
    with pytest.raises(ArrayError, match="z: expected"):
        kernel.forward_dynamics([0.0], [0.0], [0.0], [0.0, 0.0])
    with pytest.raises(ArrayError, match=r"slide\.z\.friction\.z is nan"):
        kernel.forward_dynamics([0.0], [0.0], [0.0], [np.nan])
    with pytest.raises(ArrayError, match="atol: expected"):
        kernel.rollout([0.0], [0.0], duration=1.0, atol=[1.0] * 5, z=[0.0])
    plain = built(block("coulomb = 1.0"), "forward_dynamics")
    assert plain.memory == ()
    with pytest.raises(InputError, match="no law"):
        plain.forward_dynamics([0.0], [0.0], [0.0], [0.0])


FRICTION = (
    'gamma = { friction = { model = "lugre", coulomb = 0.3, static = 0.4, stribeck = 0.1, bristle_stiffness = 300.0,'
    " bristle_damping = 0.5, fade = 0.5 } }"
)
GEARED = """
name = "geared"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "a"
mass = 1.0
com = [0.2, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.02, zz = 0.02 }}
[[links]]
name = "b"
mass = 0.5
com = [0.1, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.01, zz = 0.01 }}
[[joints]]
name = "j1"
parent = "base"
child = "a"
type = "revolute"
{friction}
[[joints]]
name = "j2"
parent = "a"
child = "b"
type = "revolute"
placement = {{ xyz = [0.4, 0.0, 0.0] }}
{friction}
[[couplings]]
name = "gear"
of = "j2.gamma"
to = {{ "j1.gamma" = -2.0 }}
"""


def crank_rocker() -> eomgen.Robot:
    """Return the built-in linkage with bristles in two joints."""
    text = (Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml").read_text()
    for name in ("joint1", "joint2"):
        text = text.replace(f'name = "{name}"\n', f'name = "{name}"\n{FRICTION}\n')
    return robot_from_toml(text)


@pytest.mark.parametrize("closed", [True, False])
def test_states_in_loops_and_of_followers(closed: bool, built: Build) -> None:
    """Explicit and implicit steps go to one motion whose energies balance; a follower's bristles feel its rate."""
    robot = crank_rocker() if closed else robot_from_toml(GEARED.format(friction=FRICTION))
    kernel = built(robot, "forward_dynamics", "energy", "rollout", "adaptive_rollout", "generalized_force")
    assert len(kernel.memory) == 2
    q = [robot.home[name] for name in kernel.coordinates] if closed else [0.3]
    v, u, z = [0.0, 0.0, 0.0] if closed else [0.4], [3.0, 0.0, 0.0] if closed else [1.0], [5e-4, -8e-4]
    if not closed:
        level = 0.3 + 0.1 * np.exp(-64.0)
        assert kernel.memory_rates(q, v, z)[1] == pytest.approx(-0.8 + 300.0 * 0.8 * 8e-4 / level, rel=1e-12)
    ends, duration = [], 0.2
    for options in (
        {"duration": duration, "method": "tsit5", "rtol": 1e-9},
        {"duration": duration, "method": "rosenbrock", "rtol": 1e-9, "works": True},
        {"dt": 2e-4, "steps": 1000, "method": "rk4"},
        {"dt": 1e-4, "steps": 2000, "method": "implicit"},
    ):
        motion = kernel.rollout(q, v, u, z=z, **options)
        ends.append(np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]]))
        if "works" in options:
            states = (
                [np.r_[motion[0][i], 0.0, 0.0] for i in (0, -1)],
                [np.r_[motion[1][i], motion.z[i]] for i in (0, -1)],
            )
            before, after = (kernel.energy(*x).sum() for x in zip(*states, strict=True))
            works = motion.works[-1]
            assert after - before == pytest.approx(works[:3].sum() - works[3], abs=1e-6)
    assert ends[1] == pytest.approx(ends[0], rel=1e-5)
    assert ends[2] == pytest.approx(ends[0], rel=1e-5)
    assert ends[3] == pytest.approx(ends[0], rel=1e-2)


def test_simulations_have_states_and_balance(tmp_path: Path) -> None:
    """A block that its spring pulls back: results keep z, also in files, and the energies of all methods balance."""
    scenario = 'duration = 0.3\n[initial]\nq = {{ "slide.z" = 1.0 }}\n[integrator]\nmethod = "{}"\nrtol = 1e-8\n'
    ends = []
    for method in ("auto", "rosenbrock", "radau", "DOP853"):
        result = run_scenario(block(), scenario_from_toml(scenario.format(method)))
        motion = result.trajectory
        assert (motion.coordinates, motion.memory) == (("slide.z",), ("slide.z.friction.z",))
        assert motion.z is not None
        assert motion.z.shape == motion.q.shape == motion.u.shape
        assert result.balance is not None
        assert result.balance.relative_residue < 1e-5
        ends.append(np.r_[motion.q[-1], motion.v[-1], motion.z[-1]])
    assert all(end == pytest.approx(ends[-1], rel=1e-6) for end in ends)
    result.save(tmp_path / "motion.npz")
    again = eomgen.load_result(tmp_path / "motion.npz").trajectory
    assert again.memory == motion.memory
    assert (again.z == motion.z).all()


def test_states_that_velocities_drive_pass_the_samples_of_radau() -> None:
    """Their rates have the velocity of the end of a step in Euler's, and its mean in Radau's: 2e-19 s of it."""
    numbers = "coulomb = 1.0, static = 1.5, stribeck = 0.01, bristle_stiffness = 1e4, bristle_damping = 60.0"
    hanging = block(f'model = "lugre", {numbers}, viscous = 0.4', pull=0.0)
    kernel = eomgen.build(replace(hanging, gravity=(0.0, 0.0, -9.81)), kernels=("radau_rollout",))
    assert kernel.memory == ("slide.z.friction.z",)
