"""Laws with internal states: LuGre friction, Bouc-Wen hysteresis and Maxwell branches, wherever they act.

They are compared with their formulas, the published experiment, closed forms, SciPy's DOP853, dense steps and balances.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline

import eomgen
from eomgen.codegen.arrays.sources import render_arrays
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, DescriptionError, InputError
from eomgen.export.mujoco import left_out, mjcf
from eomgen.kernel.stepping.input_signals import DriveData, InputSignals, Signal, Track, Waves
from eomgen.robot.elements.loss_factor import fitted_branches, loss_factors
from eomgen.robot.model import build_model
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from eomgen.state.springs import fastest_rates
from tests.support.bristles import (
    DAMPING,
    PULL,
    STIFFNESS,
    block,
    bristle_gear,
    bristle_linkage,
    rates,
)
from tests.support.builds import Build
from tests.support.drive_reference import DRIVES, servo
from tests.support.joint_table import joint_table, link_table, spring_table
from tests.support.refusals import refused
from tests.support.sliders import on_rail

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
ADAPTIVE = ("tsit5", "rosenbrock", "radau")
KERNELS = (
    *("forward_dynamics", "residual", "inverse_dynamics", "energy", "mass_matrix", "residual_jacobian"),
    *("forward_dynamics_jacobian", "generalized_force", "rollout", "adaptive_rollout", "radau_rollout"),
)
K, A, BETA, GAMMA, N, SHARE = 50.0, 1.3, 20.0, -8.0, 1.7, 0.2
HYSTERESIS = (
    f'hysteresis = {{ model = "bouc_wen", stiffness = {K}, A = {A}, beta = {BETA}, gamma = {GAMMA}, n = {N},'
    f" share = {SHARE} }}"
)
SHARP = "hysteresis = { stiffness = 50.0, beta = 12.0, gamma = 8.0 }"  # n = 1: exponential branches
LUGRE = 'model = "lugre", coulomb = 1.0, bristle_stiffness = 1e5'
FACTOR = "loss_factor = 0.1, band_hz = [1.0, 2.0]"
BRANCHES = ((30.0, 6.0), (20.0, 0.5))
MAXWELL = f"maxwell = [{', '.join(f'{{ stiffness = {k}, damping = {c} }}' for k, c in BRANCHES)}]"
ARM = f"""
name = "stateful_arm"
gravity = [0.0, -9.81, 0.0]
{link_table("l1", 2.0, (0.2, 0.01, 0.0), (0.1, 0.12, 0.13))}
{link_table("l2", 1.0, (0.2, 0.0, 0.05), (0.02, 0.03, 0.04))}
{link_table("l3", 0.5, (0.1, 0.0, 0.02), (0.01, 0.01, 0.02))}
{joint_table("j1", "base", "l1", "revolute")}
gamma.friction = {{ model = "lugre", coulomb = 1.0, bristle_stiffness = 1e4, bristle_damping = 30.0, fade = 0.05 }}
[joints.motor]
inertia = 1e-4
ratio = 50.0
stiffness = 1e4
damping = 5.0
friction = {{ model = "lugre", coulomb = 0.02, static = 0.03, stribeck = 1.0, bristle_stiffness = 20.0 }}
{joint_table("j2", "l1", "l2", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0], rpy = [0.5, 0.0, 0.0] }}
x = {{ stiffness = 1e5, damping = 100.0 }}
beta = {{ stiffness = 1e3, damping = 1.0, friction = {{ model = "lugre", coulomb = 0.1, bristle_stiffness = 1e3 }} }}
gamma = {{ friction = {{ model = "lugre", coulomb = 0.5, bristle_stiffness = 1e3, bristle_damping = 2.0 }} }}
stiffness = {{ matrix = [[1e4, 10.0, 0.0], [10.0, 20.0, 5.0], [0.0, 5.0, 10.0]] }}
{joint_table("j3", "l2", "l3", "revolute")}
placement = {{ xyz = [0.3, 0.0, 0.0] }}
gamma = {{ role = "prescribed", friction = {{ model = "lugre", coulomb = 0.1, bristle_stiffness = 1e3 }} }}
{spring_table("s1", "base", "l2", 300.0, 3.0)}
points = [[0.1, 0.5, 0.0], [0.2, 0.0, 0.0]]
free_length = 0.3
"""
TURNED = (
    "hysteresis = { stiffness = 4.0, beta = 30.0, gamma = 10.0, n = 1.4, share = 0.3 },"
    " maxwell = [{ stiffness = 2.0, damping = 0.1 }]"
)
SEA = f"""
name = "drive"
gravity = [0.0, -9.81, 0.0]
{link_table("arm", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}
{joint_table("elbow", "base", "arm", "revolute")}
[joints.motor]
inertia = 1e-4
ratio = 50.0
stiffness = 200.0
damping = 0.1
hysteresis = {{ stiffness = 300.0, beta = 200.0, gamma = 100.0, n = 1.5, share = 0.4 }}
maxwell = [{{ stiffness = 100.0, damping = 2.0 }}]
"""


def robot_of(name: str) -> eomgen.Robot:
    """Return a motor, a four-bar with laws in a joint and in its loop joint, or two wheels and an elastic belt."""
    if name in OTHERS:
        return OTHERS[name]()
    if name == "four_bar":
        text = (Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml").read_text()
        text = text.replace('name = "joint1"\n', f'name = "joint1"\ngamma = {{ {TURNED} }}\n')
        head, found, tail = text.partition("[[loops]]\n")
        laws = "stiffness = 2e3, damping = 5.0, hysteresis = { stiffness = 2e3, beta = 300.0, gamma = 100.0 }"
        return robot_from_toml(
            f"{head}{found}x = {{ {laws} }}\ny = {{ {laws}, maxwell = [{{ stiffness = 1e3, damping = 5.0 }}] }}\n{tail}"
        )
    wheels = "".join(
        f'[[joints]]\nname = "j{i}"\nparent = "base"\nchild = "w{i}"\ntype = "revolute"\n'
        f"gamma = {{ {TURNED} }}\nplacement = {{ xyz = [{i}.0, 0.0, 0.0] }}\n"
        for i in (1, 2)
    )
    links = "".join(
        f'[[links]]\nname = "w{i}"\nmass = 1.0\ninertia = {{ xx = 0.02, yy = 0.02, zz = 0.0{i} }}\n' for i in (1, 2)
    )
    belt = '[[couplings]]\nname = "belt"\nof = "j2.gamma"\nto = { "j1.gamma" = -2.0 }\n'
    law = {"belt": f"stiffness = 20.0\n{TURNED.replace(', maxwell', chr(10) + 'maxwell')}\n", "gear": ""}[name]
    return robot_from_toml(f'name = "wheels"\ngravity = [0.0, -9.81, 0.0]\n{links}{wheels}{belt}{law}')


OTHERS = {
    "drive": lambda: robot_from_toml(SEA),
    "bristled gear": bristle_gear,
    "bristled linkage": bristle_linkage,
}
WINDS = ("drive", "four_bar", "belt", "gear")  # with hysteresis and branches
BEGINS: dict[str, tuple[int, list[float], list[float], Any]] = {  # number of states; v, u and z
    "drive": (2, [0.0], [0.05], 0.0),
    "four_bar": (5, [0.0, 0.0, 0.0], [0.0, 0.0, 0.5], 0.0),
    "belt": (6, [2.0, -4.0], [0.0, 0.5], 0.0),
    "gear": (4, [2.0], [0.5], 0.0),
    "bristled gear": (2, [0.4], [1.0], [5e-4, -8e-4]),
    "bristled linkage": (2, [0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [5e-4, -8e-4]),
}


def slide(law: str) -> eomgen.Robot:
    return robot_from_toml(on_rail(law))


def wound(s: float, v: float, z: float) -> tuple[float, float]:
    """Return z' and the force of the hysteresis, with its powers as they are written."""
    rate = A * v - BETA * abs(v) * abs(z) ** (N - 1.0) * z - GAMMA * v * abs(z) ** N
    return rate, SHARE * K * s + (1.0 - SHARE) * K * z


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(block(), *KERNELS)


@pytest.fixture(scope="module")
def arm(built: Build) -> eomgen.Kernel:
    return built(robot_from_toml(ARM), *KERNELS)


@pytest.fixture(scope="module")
def hysteretic(built: Build) -> eomgen.Kernel:
    return built(slide(HYSTERESIS), *KERNELS)


@pytest.fixture(scope="module")
def branched(built: Build) -> eomgen.Kernel:
    return built(slide(f"stiffness = 100.0, {MAXWELL}"), *KERNELS)


def state_of(kernel: eomgen.Kernel, seed: int = 3) -> tuple[Any, Any, Any, Any]:
    """Return q, v, u of coordinates and z, as large as bristles bend."""
    rng, n = np.random.default_rng(seed), len(kernel.coordinates)
    q, v, u = (rng.normal(size=n) * size for size in (0.1, 0.1, 1.0))
    places = {name: i for i, name in enumerate(kernel.coordinates)}
    for name, led in kernel.motors.items():
        q[places[name]] = kernel.ratio(name) * q[places[led]] + 0.01
    sizes = np.asarray(kernel.raw.libraries.meta["sizes"])
    return (
        q,
        v,
        u,
        0.5 * rng.uniform(-1.0, 1.0, len(kernel.internal_states)) * sizes[len(sizes) - len(kernel.internal_states) :],
    )


def test_friction_is_the_papers(kernel: eomgen.Kernel) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, v, z, u = rng.normal(size=4) * [1.0, 2e-3, 1e-5, 1.0]
        rate, force = rates(v, z)
        a = kernel.forward_dynamics([x], [v], [u], [z])
        assert a == pytest.approx([u - PULL * x - force], rel=1e-12, abs=1e-12)
        assert kernel.internal_state_derivatives([x], [v], [z]) == pytest.approx([rate], rel=1e-12, abs=1e-15)
        kinetic, potential = kernel.energy([x], [v], z=[z])
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
    dt, x, z = 1e-3, np.array([0.2]), np.array([3e-6])
    q, rate, still = x + dt * v, np.array([v]), np.zeros(1)
    K, B, M = kernel.calls.run("residual_jacobian", None, (q, rate, still), z=z, whole=True)
    share = dt * B[0, 0] - dt * dt * B[0, 1] * B[1, 0] / (M[1, 1] + dt * B[1, 1])
    if share < 0.0:
        B[0] = 0.0
    flow = M[1, 1] * kernel.internal_state_derivatives(q, rate, z)
    left = np.r_[kernel.inverse_dynamics(q, rate, still, z=z), -flow]
    a = np.linalg.solve(M + dt * B + dt * dt * K, -left)
    motion = kernel.rollout(x, rate, dt=dt, steps=1, method="implicit", z=z)
    stepped = np.r_[motion[1][-1], motion.z[-1]]
    assert stepped == pytest.approx(np.r_[rate, z] + dt * a, rel=1e-10, abs=1e-18)


def test_arm_is_consistent(arm: eomgen.Kernel) -> None:
    """Motors, prescribed coordinates, matrices, springs: residual, slopes, mass matrix."""
    q, v, u, z = state_of(arm)
    n, size = q.size, q.size + z.size
    free = np.array([name not in arm.prescribed for name in arm.coordinates])

    def rates(v: Any, z: Any) -> Any:
        return arm.calls.run("forward_dynamics", None, (q, v, u), z=z, whole=True)

    a = rates(v, z)
    assert (a[:n] == arm.forward_dynamics(q, v, u, z)).all()
    assert (a[n:] == arm.internal_state_derivatives(q, v, z, u)).all()
    assert np.abs(arm.residual(q, v, a[:n], u, z=z)[free]).max() < 1e-9
    by_q, by_v, _ = arm.calls.run("forward_dynamics_jacobian", None, (q, v, u), z=z, whole=True)
    for j in range(size):
        step = 1e-7 * np.eye(size)[j] * (1.0 if j < n else 1e-3)
        rise = [rates(v + x * step[:n], z + x * step[n:]) for x in (-1.0, 1.0)]
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
    energy, (drives, prescribed, wrenches, dissipated) = arm.energy(*motion, z=motion.z).sum(axis=-1), motion.works[-1]
    assert dissipated > 0.0
    assert energy[-1] - energy[0] == pytest.approx(drives + prescribed + wrenches - dissipated, abs=1e-9)


def test_hysteresis_is_bouc_and_wens(hysteretic: eomgen.Kernel) -> None:
    assert hysteretic.internal_states == ("rail.z.hysteresis.z",)
    rng = np.random.default_rng(0)
    for s, v, z, u in rng.normal(size=(20, 4)):
        rate, force = wound(s, v, z)
        assert hysteretic.forward_dynamics([s], [v], [u], [z]) == pytest.approx([u - force], rel=1e-12, abs=1e-12)
        assert hysteretic.internal_state_derivatives([s], [v], [z]) == pytest.approx([rate], rel=1e-12, abs=1e-14)
        stored = 0.5 * SHARE * K * s * s + 0.5 * (1.0 - SHARE) * K / A * z * z
        assert hysteretic.energy([s], [v], z=[z]) == pytest.approx([0.5 * v * v, stored], rel=1e-12)
    assert hysteretic.internal_state_derivatives([0.0], [2.0], [0.0]) == pytest.approx([2.0 * A], rel=1e-14)


def spline(t: Array, x: Array) -> Signal:
    """Return a smooth signal of one column through samples."""
    through = CubicSpline(t, x)
    return Signal(t, np.ascontiguousarray(through.c[::-1].T[:, :, np.newaxis]))


def pushed(end: float) -> InputSignals:
    """Return a force 6 sin(8 t) N, as a spline."""
    t = np.linspace(0.0, end, 41)
    return InputSignals(DriveData(torque=Track(spline(t, 6.0 * np.sin(8.0 * t)), np.array([0]))))


def test_all_methods_go_where_dop853_goes(hysteretic: eomgen.Kernel) -> None:
    """Under a constant force, from which the slide swings back several times."""
    end, push = 2.0, 4.0

    def derivatives(t: float, y: Array) -> list[float]:
        rate, force = wound(*y)
        return [y[1], push - force, rate]

    y = solve_ivp(derivatives, (0.0, end), [0.0, 1.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert y[0] != pytest.approx(y[2], rel=0.1)  # it yielded

    def error(**options: Any) -> float:
        motion = hysteretic.rollout([0.0], [1.0], [push], z=[0.0], **options)
        return float(np.abs([motion[0][-1, 0] - y[0], motion[1][-1, 0] - y[1], motion.z[-1, 0] - y[2]]).max())

    for method in ("tsit5", "rosenbrock", "radau"):
        assert error(duration=end, method=method, rtol=1e-9) < 1e-6, method
    assert error(dt=1e-3, steps=2000, method="rk4") < 1e-6
    coarse, fine = (error(dt=end / steps, steps=steps, method="implicit") for steps in (2000, 4000))
    assert fine < 0.6 * coarse < 0.06


def test_monotonic_branch_is_exponential(built: Build) -> None:
    """With n = 1 and v > 0 z = (A / lambda) (1 - exp(-lambda s)), lambda = beta + gamma, whatever the motion is."""
    kernel = built(slide(SHARP), *KERNELS)
    motion = kernel.rollout([0.0], [3.0], duration=0.3, samples=60, method="radau", rtol=1e-10, z=[0.0])
    ahead = motion[1][:, 0] > 0.0
    s, z = motion[0][ahead, 0], motion.z[ahead, 0]
    assert s.max() > 0.3
    assert z == pytest.approx((1.0 - np.exp(-20.0 * s)) / 20.0, abs=1e-9)


@pytest.mark.parametrize("rate", [0.5, 20.0])
def test_dissipates_the_area_of_its_loop(built: Build, rate: float) -> None:
    """A prescribed motion s = 0.1 sin(rate t) goes through a loop that does not depend on how fast it is."""
    kernel = built(slide(f'role = "prescribed", {HYSTERESIS}'), *KERNELS, "inverse_dynamics")
    circle = 2.0 * np.pi / rate
    loads = InputSignals(prescribed=Waves(np.array([[0.1, rate, 0.0, 0.0]])))
    options: dict[str, Any] = {"method": "radau", "rtol": 1e-10, "loads": loads, "works": True}
    motion = kernel.rollout([0.0], [0.1 * rate], duration=15.0 * circle, samples=15, z=[0.0], **options)
    assert motion.z[14] == pytest.approx(motion.z[15], rel=1e-3)  # the loop closes
    lost = motion.works[15, 3] - motion.works[14, 3]

    def z_over(s0: float, s1: float, z0: float) -> Any:
        sense = 1.0 if s1 > s0 else -1.0
        slope = lambda s, z: [wound(0.0, sense, float(z[0]))[0] * sense]  # noqa: E731
        return solve_ivp(slope, (s0, s1), [z0], method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True)

    area, z = 0.0, float(motion.z[14, 0])
    for s0, s1 in ((0.0, 0.1), (0.1, -0.1), (-0.1, 0.0)):
        branch = z_over(s0, s1, z)
        area += quad(lambda s, branch=branch: (1.0 - SHARE) * K * branch.sol(s)[0], s0, s1, epsabs=1e-12)[0]
        z = float(branch.y[0, -1])
    assert lost == pytest.approx(area, rel=1e-5)
    prescribed = motion.works[15, 1] - motion.works[14, 1]
    assert prescribed == pytest.approx(lost, rel=1e-3)


@pytest.mark.parametrize("law", [HYSTERESIS, SHARP, MAXWELL])
def test_laws_never_give_more_than_they_store(law: str, built: Build) -> None:
    """At random states, also beyond those that motions come to: force times velocity is at least what storage takes."""
    kernel = built(slide(law), *KERNELS)
    rng, states = np.random.default_rng(1), len(kernel.internal_states)
    q, moving = rng.normal(size=(500, 1 + states))[:, :1], rng.normal(size=(500, 1 + states))
    v, z = moving[:, :1], moving[:, 1:]
    still, at = (
        kernel.calls.run("generalized_force", None, (q, x), z=y, whole=True) for x, y in ((0.0 * v, 0.0 * z), (v, z))
    )
    power = ((still - at) * moving).sum(axis=1)
    assert power.min() >= -1e-12
    assert power.max() > 1.0


@pytest.mark.parametrize("law", [HYSTERESIS, f"stiffness = 100.0, {MAXWELL}"])
def test_energies_balance(law: str, built: Build) -> None:
    kernel = built(slide(law), *KERNELS)
    states, loads = len(kernel.internal_states), pushed(1.0)
    for method in ("tsit5", "rosenbrock", "radau"):
        options: dict[str, Any] = {"method": method, "rtol": 1e-9, "loads": loads, "works": True, "z": np.zeros(states)}
        motion = kernel.rollout([0.1], [1.0], duration=1.0, samples=1, **options)
        before, after = kernel.energy(*motion, z=motion.z).sum(axis=-1)
        works = motion.works[-1]
        assert works[3] > 0.1
        assert after - before == pytest.approx(works[:3].sum() - works[3], abs=1e-7)


def complex_stiffness(kernel: eomgen.Kernel, w: float) -> complex:
    """Return the force on the slide over its deviation at an angular frequency, without its inertia, by K, B and M."""
    z = np.zeros(len(kernel.internal_states))
    K, B, M = kernel.calls.run("residual_jacobian", None, ([0.0], [0.0], [0.0]), z=z, whole=True)
    dynamic = K + 1j * w * B - w * w * M
    dynamic[1:, 1:] = 1j * w * B[1:, 1:] - w * w * M[1:, 1:]
    return complex(1.0 / np.linalg.inv(dynamic)[0, 0]) + w * w * M[0, 0]


def test_branches_have_maxwells_complex_stiffness(branched: eomgen.Kernel) -> None:
    """100 + sum of k (j w c) / (k + j w c)."""
    for w in (0.01, 1.0, 5.0, 40.0, 1e4):
        expected = 100.0 + sum(k * (1j * w * c) / (k + 1j * w * c) for k, c in BRANCHES)
        assert complex_stiffness(branched, w) == pytest.approx(expected, rel=1e-9)


def test_a_stiff_branch_is_a_damper(built: Build) -> None:
    stiff = built(slide("stiffness = 100.0, maxwell = [{ stiffness = 1e9, damping = 4.0 }]"), *KERNELS)
    damped = built(slide("stiffness = 100.0, damping = 4.0"), "forward_dynamics", "adaptive_rollout")
    one = stiff.rollout([0.1], [0.0], duration=0.5, method="rosenbrock", rtol=1e-8, z=[0.0])
    other = damped.rollout([0.1], [0.0], duration=0.5, method="tsit5", rtol=1e-10)
    assert one[0][-1] == pytest.approx(other[0][-1], abs=1e-6)
    assert one.steps < 1000


@pytest.mark.parametrize(("loss_factor", "branches"), [(0.02, 3), (0.3, 4), (1.0, 8)])
def test_loss_factor_is_what_the_note_says(loss_factor: float, branches: int, built: Build) -> None:
    """Over the band; and no branch of another stiffness is nearer by least squares."""
    table = f"maxwell = {{ loss_factor = {loss_factor}, band_hz = [0.5, 50.0], branches = {branches} }}"
    fit = fitted_branches(loss_factor, (0.5, 50.0), branches)
    count = len(fit.branches)
    robot = slide(f"stiffness = 100.0, {table}")
    (note,) = robot.notes
    assert f"the loss factor of {count} branches is {loss_factor:g} within " in note
    within = 1.06 * float(note.rpartition(" ")[2])  # of two digits
    kernel = built(robot, "residual_jacobian")
    w = 2.0 * np.pi * np.geomspace(0.5, 50.0, 40)
    stiffness = np.array([complex_stiffness(kernel, x) for x in w])
    assert np.abs(stiffness.imag / stiffness.real - loss_factor).max() <= within < 0.2 * loss_factor
    squares = np.sum((loss_factors(fit.branches, w) - loss_factor) ** 2)
    for i in range(count):
        for factor in (0.98, 1.02):
            changed = tuple(
                (k * (factor if i == j else 1.0), c * (factor if i == j else 1.0))
                for j, (k, c) in enumerate(fit.branches)
            )
            assert np.sum((loss_factors(changed, w) - loss_factor) ** 2) > 0.99 * squares


@pytest.mark.parametrize("name", BEGINS)
def test_wherever_laws_act_methods_agree_and_energies_balance(name: str, built: Build) -> None:
    robot, (states, v, u, z) = robot_of(name), BEGINS[name]
    names = ("forward_dynamics", "energy", "rollout", "adaptive_rollout", "radau_rollout", "generalized_force")
    kernel = built(robot, *names)
    n, z = len(kernel.coordinates), np.zeros(states) + z
    assert len(kernel.internal_states) == states
    q = np.array([robot.home.get(x, 0.0) for x in kernel.coordinates])
    v, u = np.resize(v, n), np.resize(u, n)
    methods = [method for method in ADAPTIVE if method != "radau" or not kernel.constraints]
    ends = []
    for options in (
        *({"method": method, "duration": 0.1, "rtol": 1e-9, "works": True} for method in methods),
        {"method": "implicit", "dt": 2.5e-5, "steps": 4000},
        {"method": "rk4", "dt": 1e-4, "steps": 1000},
    ):
        motion = kernel.rollout(q, v, u, z=z, **options)
        ends.append(np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]]))
        if "works" in options:
            before, after = kernel.energy(*motion, z=motion.z).sum(axis=-1)[[0, -1]]
            works = motion.works[-1]
            assert after - before == pytest.approx(works[:3].sum() - works[3], abs=1e-6)
            assert works[3] > 0.0
    size = np.abs(ends[0]).max()
    assert np.abs(ends[0][n + n :]).min() > 1e-7
    for end, most in zip(ends[1:], (*[1e-6] * (len(methods) - 1), 1e-2, 1e-6), strict=True):
        assert np.abs(end - ends[0]).max() < most * size


def test_bristles_of_a_follower_feel_its_velocity(built: Build) -> None:
    kernel = built(bristle_gear(), "forward_dynamics")
    level = 0.3 + 0.1 * np.exp(-64.0)
    found = kernel.internal_state_derivatives([0.3], [0.4], [5e-4, -8e-4])[1]
    assert found == pytest.approx(-0.8 + 300.0 * 0.8 * 8e-4 / level, rel=1e-12)


@pytest.mark.parametrize("name", ["bristles", "slide", "cascade"])
def test_lanes_are_bit_equal(name: str, arm: eomgen.Kernel, hysteretic: eomgen.Kernel, built: Build) -> None:
    """Of an arm with bristles, hysteresis, and a servo drive."""
    kernel = {"bristles": arm, "slide": hysteretic}.get(name) or built(servo(DRIVES[name][0]))
    q, v, u, z = state_of(kernel) if name == "bristles" else (np.array([0.05]), np.array([0.3]), np.array([2.0]), 0.02)
    Q, V = np.tile(q, (5, 1)), v + 0.1 * np.abs(v) * np.arange(-2, 3)[:, None]
    Z = z * np.linspace(0.5, 1.0, 5)[:, None] * np.ones(len(kernel.internal_states))
    for method in ADAPTIVE:
        many = kernel.rollout(Q, V, u, z=Z, duration=0.01, method=method)
        for i in range(5):
            alone = kernel.rollout(Q[i], V[i], u, z=Z[i], duration=0.01, method=method)
            assert all((x[i] == y).all() for x, y in zip((*many, many.z), (*alone, alone.z), strict=True))


@pytest.mark.parametrize("name", ["slide", "cascade"])
def test_single_precision_follows_double_precision(name: str, built: Build) -> None:
    robot = slide(HYSTERESIS) if name == "slide" else servo(DRIVES[name][0])
    motions = []
    for dtype in ("float32", "float64"):
        kernel, begin = built(robot, "forward_dynamics", "adaptive_rollout", dtype=dtype), np.zeros((3, 1), dtype)
        begin[1], begin[2] = (0.5, 0.0) if name == "slide" else (0.0, DRIVES[name][1])
        z, options = np.zeros(len(kernel.internal_states), dtype), {"duration": 0.2, "samples": 3, "rtol": 1e-4}
        motions.append(kernel.rollout(*begin, z=z, method="rosenbrock", **options))
    (single, of_single), (double, of_double) = ((x[0], x.z) for x in motions)
    np.testing.assert_allclose(single, double, atol=2e-3)
    np.testing.assert_allclose(of_single, of_double, atol=2e-3 * np.abs(of_double).max())


@pytest.mark.parametrize(
    ("law", "place", "said"),
    [
        ("hysteresis = { stiffness = 1.0, beta = 1.0 }", "hysteresis", "the key 'gamma' is missing"),
        ("hysteresis = { beta = 1.0, gamma = 0.5 }", "hysteresis", "there is no hysteresis.stiffness"),
        ("hysteresis = { stiffness = 1.0, beta = 1.0, gamma = -1.5 }", "hysteresis.gamma", "gives energy back"),
        ("hysteresis = { stiffness = 1.0, beta = 1.0, gamma = 0.5, share = 1.0 }", "hysteresis.share", "less than 1"),
        ("hysteresis = { stiffness = 1.0, beta = 1.0, gamma = 0.5, n = 0.5 }", "hysteresis.n", "at least 1"),
        ('hysteresis = { model = "dahl", stiffness = 1.0, beta = 1.0, gamma = 0.5 }', "hysteresis.model", "bouc_wen"),
        ("maxwell = []", "maxwell", "1 to 8 tables"),
        ("maxwell = 3.0", "maxwell", "an array of branches"),
        ("maxwell = [{ stiffness = 1.0 }]", "maxwell.0", "damping"),
        ("maxwell = [{ stiffness = 1.0, damping = 0.0 }]", "maxwell.0.damping", "0.0"),
        ("maxwell = { loss_factor = 0.1, band_hz = [1.0, 2.0] }", "maxwell", "the coordinate has no stiffness"),
        ("stiffness = 1.0, maxwell = { loss_factor = 0.1, band_hz = [2.0, 1.0] }", "maxwell.band_hz", "that rise"),
        ("stiffness = 1.0, maxwell = { loss_factor = 0.0, band_hz = [1.0, 2.0] }", "maxwell.loss_factor", "0.0"),
        ("stiffness = 1.0, maxwell = { band_hz = [1.0, 2.0] }", "maxwell", "loss_factor"),
        (f"stiffness = 1.0, maxwell = {{ {FACTOR}, branches = 9 }}", "branches", "from 1 to 8"),
        ('friction = { model = "lugre", coulomb = 1.0 }', "", "bristle_stiffness"),
        ("friction = { coulomb = 1.0, bristle_stiffness = 1e5 }", "", 'model = "lugre"'),
        ("friction = { coulomb = 1.0, bristle_damping = 3.0 }", "", "no bristle_stiffness"),
        ('friction = { model = "lugre", coulomb = 0.0, bristle_stiffness = 1e5 }', "", "bristles yield"),
        (f"friction = {{ {LUGRE}, smoothing = 1e-3 }}", "", "the model is lugre"),
        (f"friction = {{ {LUGRE}, bristle_damping = 316.0, fade = 1.0 }}", "", "fade"),
        ('friction = { model = "dahl", coulomb = 1.0 }', "", "dahl"),
    ],
)
def test_what_cannot_be_is_refused(law: str, place: str, said: str) -> None:
    caught = refused(DescriptionError, "", slide, law)
    assert "rail.z" in str(caught)
    assert place in str(caught)
    assert said in str(caught)


def test_friction_by_a_load_that_a_state_carries_is_refused() -> None:
    def loaded(law: str) -> eomgen.Robot:
        return slide(f"friction = {{ coefficient = 0.1 }} }}\nx = {{ stiffness = 1e3, {law}")

    assert loaded("damping = 1.0").joint("rail").coordinates["x"].damping == 1.0
    said = r"rail\.z\.friction.*x carries .* a law with internal states, hysteresis, maxwell"
    refused(DescriptionError, said, loaded, f"{SHARP}, {MAXWELL}")


def test_a_transmission_has_a_spring_without_states() -> None:
    """So that robots without laws that have states have one."""
    with pytest.raises(DescriptionError, match="no spring between motor and joint"):
        robot_from_toml(SEA.replace("stiffness = 200.0\n", ""))


@pytest.mark.parametrize("name", WINDS)
def test_robots_without_states_keep_all_else(name: str) -> None:
    robot = robot_of(name)
    plain = robot.without_states()
    assert plain.without_states() is plain
    assert build_model(plain).internal_states == ()
    numbers = {key: x for key, x in robot.numbers() if x is not None}
    kept = {key: x for key, x in numbers.items() if "hysteresis" not in key and "maxwell" not in key}
    for key in [key for key in numbers if key.endswith("hysteresis.share")]:  # whose spring has no state
        where = key.removesuffix(".hysteresis.share")
        stiffness = f"{where}.stiffness"
        kept[stiffness] = kept.get(stiffness, 0.0) + numbers[key] * numbers[f"{where}.hysteresis.stiffness"]
    found = {key: x for key, x in plain.numbers() if x is not None}
    assert found == pytest.approx({key: x for key, x in kept.items() if x or key in found})
    assert found.keys() >= kept.keys() - {key for key, x in kept.items() if not x}
    assert build_model(robot.rigid()).internal_states == ()


@pytest.mark.parametrize(
    "beside", ["", "stiffness = 5.0, stiffness_negative = 7.0", "stiffness = 5.0, clearance = 1e-3"]
)
def test_the_elastic_share_of_hysteresis_stays(beside: str, built: Build) -> None:
    """As a spring of both sides, where its force is that: far slower than any state, with z as it is at 0."""
    robot = slide(f"{HYSTERESIS}{beside and ', '}{beside}")
    whole, plain = built(robot), built(robot.without_states())
    assert plain.internal_states == ()
    for s in (-0.3, 0.2):
        forces = [kernel.generalized_force([s], [0.0], **z)[0] for kernel, z in ((whole, {"z": [0.0]}), (plain, {}))]
        lost = SHARE * K * s if "clearance" in beside else 0.0
        assert forces[1] - forces[0] == pytest.approx(lost, abs=1e-9)
    notes = left_out(robot)
    assert any(note.endswith("hysteresis: left out but for its elastic share, a spring") for note in notes) == (
        "clearance" not in beside
    )
    if "clearance" not in beside:
        text = mjcf(robot, 1e-3, approximate=True)
        assert float(text.partition('stiffness="')[2].partition('"')[0]) == pytest.approx(
            SHARE * K + 5.0 * bool(beside)
        )


def test_python_on_arrays_is_the_kernel(hysteretic: eomgen.Kernel) -> None:
    """Logarithms among its functions."""
    module: dict[str, Any] = {}
    exec(render_arrays(build_model(slide(HYSTERESIS)), ("forward_dynamics", "energy")), module)
    functions, rng = module["make"](np), np.random.default_rng(5)
    for q, v, z, u in rng.normal(size=(10, 4, 1)):
        given = functions.forward_dynamics(q, v, z, u), functions.energy(q, v, z)
        rates = hysteretic.calls.run("forward_dynamics", None, (q, v, u), z=z, whole=True)
        for found, expected in zip(given, (rates, hysteretic.energy(q, v, z=z)), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("name", ["drive", "belt"])
def test_models_of_mujoco_leave_them_out_by_name(name: str) -> None:
    model = build_model(robot_of(name))
    said = left_out(model.robot)
    assert all(any(note.startswith(f"{x.prefix}.{x.law}: left out") for note in said) for x in model.states)
    assert {x.unit for x in model.states} == {"rad"}
    assert {x.unit for x in build_model(slide(f"{HYSTERESIS}, {MAXWELL}")).states} == {"m"}


def test_fixed_steps_know_what_states_stretch(built: Build) -> None:
    """A transmission swings with all its springs between both inertias; a slide with what is stiff at first."""
    names = ("forward_dynamics", "mass_matrix", "inverse_dynamics")
    drive, block = (
        built(robot_from_toml(SEA), *names),
        built(slide(f"stiffness = 100.0, {HYSTERESIS}, {MAXWELL}"), *names),
    )
    inertias = 1e-4 * 50.0**2, 0.02 + 1.0 * 0.2**2
    assert fastest_rates(drive, np.zeros(drive.n))[0] == pytest.approx(np.sqrt(600.0 * sum(1.0 / x for x in inertias)))
    k = 100.0 + SHARE * K + (1.0 - SHARE) * K * A + sum(k for k, _ in BRANCHES)
    assert fastest_rates(block, np.zeros(block.n))[0] == pytest.approx(np.sqrt(k))


RELEASED = {  # from a spring: robot, duration, position, states, least dissipated energy in J, deviation
    "block": (block(), 0.3, 1.0, ("slide.z.friction.z",), 0.0, 1e-12),
    "slide": (
        slide(f"stiffness = 100.0, {HYSTERESIS}, {MAXWELL}"),
        *(0.5, 0.3, ("rail.z.hysteresis.z", "rail.z.maxwell.0.z", "rail.z.maxwell.1.z"), 0.5, 1e-5),
    ),
}


@pytest.mark.parametrize("name", RELEASED)
def test_simulations_of_all_methods_agree_and_balance(name: str, tmp_path: Path) -> None:
    """Results have z by name, also in files."""
    robot, duration, place, states, least, within = RELEASED[name]
    coordinate, ends = states[0].rpartition(".z.")[0] + ".z", []
    for method in ("auto", "rosenbrock", "radau", "scipy:DOP853"):
        initial = f'[initial]\nq = {{ "{coordinate}" = {place} }}\n'
        integrator = f'[integrator]\nmethod = "{method}"\nrtol = 1e-8\n'
        result = run_scenario(robot, scenario_from_toml(f"duration = {duration}\n{initial}{integrator}"))
        motion = result.trajectory
        assert (motion.coordinates, motion.internal_states) == ((coordinate,), states)
        assert motion.z.shape == (len(motion.t), len(states))
        assert motion.q.shape == motion.u.shape == (len(motion.t), 1)
        assert result.balance.relative_residue < 1e-5
        assert result.balance.of("dissipated")[-1] > least
        ends.append(np.r_[motion.q[-1], motion.v[-1], motion.z[-1]])
    assert all(end == pytest.approx(ends[-1], rel=1e-6, abs=within) for end in ends), ends
    result.save(tmp_path / "motion.npz")
    again = eomgen.load_result(tmp_path / "motion.npz").trajectory
    assert again.internal_states == motion.internal_states
    assert (again.z == motion.z).all()


def test_a_fade_that_keeps_friction_passive_is_taken() -> None:
    """sigma_1 v exp(-(v / fade)^2) is at most 0.43 sigma_1 fade: with 316 N s/m and 4 N up to fades of 0.029 m/s."""
    text = f'model = "lugre", coulomb = 1.0, bristle_stiffness = 1e5, bristle_damping = {DAMPING}, fade = '
    block(text + "0.0294")
    refused(DescriptionError, "fade", block, text + "0.0297")


def test_states_of_no_law_and_of_another_shape_are_refused(kernel: eomgen.Kernel, built: Build) -> None:
    refused(ArrayError, "z: expected", kernel.forward_dynamics, [0.0], [0.0], [0.0], [0.0, 0.0])
    refused(ArrayError, r"slide\.z\.friction\.z is nan", kernel.forward_dynamics, [0.0], [0.0], [0.0], [np.nan])
    refused(ArrayError, "atol: expected", kernel.rollout, [0.0], [0.0], duration=1.0, atol=[1.0] * 5, z=[0.0])
    plain = built(block("coulomb = 1.0"), "forward_dynamics")
    assert plain.internal_states == ()
    refused(InputError, "no force law", plain.forward_dynamics, [0.0], [0.0], [0.0], [0.0])


def test_states_that_velocities_drive_pass_the_samples_of_radau() -> None:
    """Their rates have the velocity of the end of a step in Euler's, and its mean in Radau's: 2e-19 s of it."""
    numbers = "coulomb = 1.0, static = 1.5, stribeck = 0.01, bristle_stiffness = 1e4, bristle_damping = 60.0"
    hanging = block(f'model = "lugre", {numbers}, viscous = 0.4', pull=0.0)
    kernel = eomgen.build(replace(hanging, gravity=(0.0, 0.0, -9.81)), kernels=("radau_rollout",))
    assert kernel.internal_states == ("slide.z.friction.z",)
