"""Bouc-Wen hysteresis and Maxwell branches: formulas, closed forms, DOP853, energies, methods, wherever they act."""

from __future__ import annotations

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
from eomgen.errors import DescriptionError
from eomgen.export.mujoco import left_out, mjcf
from eomgen.robot.elements.loss_factor import fitted_branches, loss_factors
from eomgen.robot.model import build_model
from eomgen.runtime.stepping.input_signals import DriveData, InputSignals, Signal, Track, Waves
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from eomgen.state.springs import fastest_rates
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
K, A, BETA, GAMMA, N, SHARE = 50.0, 1.3, 20.0, -8.0, 1.7, 0.2
HYSTERESIS = (
    f'hysteresis = {{ model = "bouc_wen", stiffness = {K}, A = {A}, beta = {BETA}, gamma = {GAMMA}, n = {N},'
    f" share = {SHARE} }}"
)
SHARP = "hysteresis = { stiffness = 50.0, beta = 12.0, gamma = 8.0 }"  # n = 1: exponential branches
BRANCHES = ((30.0, 6.0), (20.0, 0.5))
MAXWELL = f"maxwell = [{', '.join(f'{{ stiffness = {k}, damping = {c} }}' for k, c in BRANCHES)}]"
SLIDE = """
name = "slide"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "body"
mass = 1.0
inertia = {{ xx = 0.1, yy = 0.1, zz = 0.1 }}
[[joints]]
name = "rail"
type = "prismatic"
parent = "base"
child = "body"
z = {{ {law} }}
"""
KERNELS = (
    *("forward_dynamics", "residual", "energy", "generalized_force", "residual_jacobian", "mass_matrix"),
    *("rollout", "adaptive_rollout", "radau_rollout"),
)


def slide(law: str) -> eomgen.Robot:
    return robot_from_toml(SLIDE.format(law=law))


def wound(s: float, v: float, z: float) -> tuple[float, float]:
    """Return z' and the force of the hysteresis, with its powers as they are written."""
    rate = A * v - BETA * abs(v) * abs(z) ** (N - 1.0) * z - GAMMA * v * abs(z) ** N
    return rate, SHARE * K * s + (1.0 - SHARE) * K * z


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(slide(HYSTERESIS), *KERNELS)


@pytest.fixture(scope="module")
def branched(built: Build) -> eomgen.Kernel:
    return built(slide(f"stiffness = 100.0, {MAXWELL}"), *KERNELS)


def test_hysteresis_is_bouc_and_wens(kernel: eomgen.Kernel) -> None:
    assert kernel.memory == ("rail.z.hysteresis.z",)
    rng = np.random.default_rng(0)
    for s, v, z, u in rng.normal(size=(20, 4)):
        rate, force = wound(s, v, z)
        assert kernel.forward_dynamics([s], [v], [u], [z]) == pytest.approx([u - force], rel=1e-12, abs=1e-12)
        assert kernel.memory_rates([s], [v], [z]) == pytest.approx([rate], rel=1e-12, abs=1e-14)
        stored = 0.5 * SHARE * K * s * s + 0.5 * (1.0 - SHARE) * K / A * z * z
        assert kernel.energy([s, 0.0], [v, z]) == pytest.approx([0.5 * v * v, stored], rel=1e-12)
    assert kernel.memory_rates([0.0], [2.0], [0.0]) == pytest.approx([2.0 * A], rel=1e-14)


def spline(t: Array, x: Array) -> Signal:
    """Return a smooth signal of one column through samples."""
    through = CubicSpline(t, x)
    return Signal(t, np.ascontiguousarray(through.c[::-1].T[:, :, np.newaxis]))


def pushed(end: float) -> InputSignals:
    """Return a force 6 sin(8 t) N, as a spline."""
    t = np.linspace(0.0, end, 41)
    return InputSignals(DriveData(torque=Track(spline(t, 6.0 * np.sin(8.0 * t)), np.array([0]))))


def test_all_methods_go_where_dop853_goes(kernel: eomgen.Kernel) -> None:
    """Under a constant force, from which the slide swings back several times."""
    end, push = 2.0, 4.0

    def derivatives(t: float, y: Array) -> list[float]:
        rate, force = wound(*y)
        return [y[1], push - force, rate]

    y = solve_ivp(derivatives, (0.0, end), [0.0, 1.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert y[0] != pytest.approx(y[2], rel=0.1)  # it yielded

    def error(**options: Any) -> float:
        motion = kernel.rollout([0.0], [1.0], [push], z=[0.0], **options)
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
    rng, states = np.random.default_rng(1), len(kernel.memory)
    q, v = rng.normal(size=(500, 1 + states)), rng.normal(size=(500, 1 + states))
    q[:, 1:] = 0.0
    passive = kernel.generalized_force(q, np.zeros_like(q)) - kernel.generalized_force(q, v)
    power = (passive * v).sum(axis=1)
    assert power.min() >= -1e-12
    assert power.max() > 1.0


@pytest.mark.parametrize("law", [HYSTERESIS, f"stiffness = 100.0, {MAXWELL}"])
def test_energies_balance(law: str, built: Build) -> None:
    kernel = built(slide(law), *KERNELS)
    states, loads = len(kernel.memory), pushed(1.0)
    for method in ("tsit5", "rosenbrock", "radau"):
        options: dict[str, Any] = {"method": method, "rtol": 1e-9, "loads": loads, "works": True, "z": np.zeros(states)}
        motion = kernel.rollout([0.1], [1.0], duration=1.0, samples=1, **options)
        rows = [(np.r_[motion[0][i], np.zeros(states)], np.r_[motion[1][i], motion.z[i]]) for i in (0, -1)]
        before, after = (kernel.energy(*row).sum() for row in rows)
        works = motion.works[-1]
        assert works[3] > 0.1
        assert after - before == pytest.approx(works[:3].sum() - works[3], abs=1e-7)


def test_lanes_and_single_precision(kernel: eomgen.Kernel, built: Build) -> None:
    q, v, z = np.full((5, 1), 0.05), 0.3 * np.arange(-2, 3)[:, None], 0.02 * np.arange(5)[:, None]
    for method in ("tsit5", "rosenbrock", "radau"):
        many = kernel.rollout(q, v, duration=0.2, method=method, z=z)
        for i in range(5):
            alone = kernel.rollout(q[i], v[i], duration=0.2, method=method, z=z[i])
            assert all((x[i] == y).all() for x, y in zip((*many, many.z), (*alone, alone.z), strict=True))
    single = built(slide(HYSTERESIS), "forward_dynamics", "adaptive_rollout", dtype="float32")
    few = single.rollout([0.0], [0.5], duration=0.2, method="tsit5", rtol=1e-4, z=[0.0])
    assert few.z[-1] == pytest.approx(
        kernel.rollout([0.0], [0.5], duration=0.2, method="tsit5", z=[0.0]).z[-1], rel=2e-3
    )


@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_gradients_of_rollouts(method: Any, built: Build) -> None:
    kernel = built(slide(HYSTERESIS), "rollout", "explicit_gradient", "implicit_gradient")
    names = [f"joints.rail.z.hysteresis.{key}" for key in ("stiffness", "A", "beta", "gamma", "n", "share")]

    described = {name: kernel.parameters[name] for name in names}

    def end(changed: dict[str, float]) -> float:
        kernel.parameters.update(changed)
        motion = kernel.rollout([0.1, 0.0], [0.5, 0.03], dt=1e-3, steps=200, method=method)
        kernel.parameters.update(described)
        return float(motion[0][-1, 0])

    def loss(t: Any, q: Array, v: Array) -> tuple[float, Array, Array]:
        by_q = np.zeros_like(q)
        by_q[-1, 0] = 1.0
        return float(q[-1, 0]), by_q, np.zeros_like(v)

    arguments: dict[str, Any] = {"dt": 1e-3, "steps": 200, "method": method, "loss": loss, "parameters": names}
    value, slopes = kernel.rollout_gradient([0.1, 0.0], [0.5, 0.03], **arguments)
    assert value == pytest.approx(end({}), rel=1e-14)
    for name in names:
        x = kernel.parameters[name]
        h = 1e-5 * max(abs(x), 0.1)
        expected = (end({name: x + h}) - end({name: x - h})) / (2.0 * h)
        assert slopes[name] == pytest.approx(expected, rel=1e-5, abs=1e-9), name


def complex_stiffness(kernel: eomgen.Kernel, w: float) -> complex:
    """Return the force on the slide over its deviation at an angular frequency, without its inertia, by K, B and M."""
    n = kernel.n
    K, B, M = kernel.residual_jacobian(np.zeros(n), np.zeros(n), np.zeros(n))
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


TURNED = (
    "hysteresis = { stiffness = 4.0, beta = 30.0, gamma = 10.0, n = 1.4, share = 0.3 },"
    " maxwell = [{ stiffness = 2.0, damping = 0.1 }]"
)
SEA = """
name = "drive"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "arm"
mass = 1.0
com = [0.2, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.02, zz = 0.02 }
[[joints]]
name = "elbow"
type = "revolute"
parent = "base"
child = "arm"
[joints.motor]
inertia = 1e-4
ratio = 50.0
stiffness = 200.0
damping = 0.1
hysteresis = { stiffness = 300.0, beta = 200.0, gamma = 100.0, n = 1.5, share = 0.4 }
maxwell = [{ stiffness = 100.0, damping = 2.0 }]
"""


def looped(name: str) -> eomgen.Robot:
    """Return a four-bar with laws in a joint and in the coordinates of its cut, or two wheels and an elastic belt."""
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


@pytest.mark.parametrize("name", ["drive", "four_bar", "belt", "gear"])
def test_wherever_laws_act_methods_agree_and_energies_balance(name: str, built: Build) -> None:
    robot = robot_from_toml(SEA) if name == "drive" else looped(name)
    kernel = built(
        robot, "forward_dynamics", "energy", "rollout", "adaptive_rollout", "radau_rollout", "generalized_force"
    )
    n, states = len(kernel.coordinates), len(kernel.memory)
    assert states == {"drive": 2, "four_bar": 5, "belt": 6, "gear": 4}[name]
    q = np.array([robot.home.get(x, 0.0) for x in kernel.coordinates])
    v, u, z = np.zeros(n), np.zeros(n), np.zeros(states)
    if name in ("belt", "gear"):
        v[0] = 2.0
        v[1:] = -4.0
    u[-1] = 0.05 if name == "drive" else 0.5
    methods = ["tsit5", "rosenbrock"] + (["radau"] if name != "four_bar" or not kernel.constraints else [])
    ends = []
    for options in (
        *({"method": method, "duration": 0.1, "rtol": 1e-9} for method in methods),
        {"method": "implicit", "dt": 2.5e-5, "steps": 4000},
        {"method": "rk4", "dt": 1e-4, "steps": 1000},
    ):
        adaptive = "duration" in options
        motion = kernel.rollout(q, v, u, z=z, works=adaptive, **options)
        ends.append(np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]]))
        if adaptive:
            rows = [(np.r_[motion[0][i], z], np.r_[motion[1][i], motion.z[i]]) for i in (0, -1)]
            before, after = (kernel.energy(*row).sum() for row in rows)
            works = motion.works[-1]
            assert after - before == pytest.approx(works[:3].sum() - works[3], abs=1e-6)
            assert works[3] > 0.0
    size = np.abs(ends[0]).max()
    assert np.abs(ends[0][n + n :]).min() > 1e-7
    for end, most in zip(ends[1:], (*[1e-6] * (len(methods) - 1), 1e-2, 1e-6), strict=True):
        assert np.abs(end - ends[0]).max() < most * size


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
        (
            "stiffness = 1.0, maxwell = { loss_factor = 0.1, band_hz = [1.0, 2.0], branches = 9 }",
            "branches",
            "from 1 to 8",
        ),
    ],
)
def test_what_cannot_be_is_refused(law: str, place: str, said: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        slide(law)
    assert "rail.z" in str(caught.value)
    assert place in str(caught.value)
    assert said in str(caught.value)


def test_friction_by_a_load_that_a_state_carries_is_refused() -> None:
    def loaded(law: str) -> eomgen.Robot:
        return slide(f"friction = {{ coefficient = 0.1 }} }}\nx = {{ stiffness = 1e3, {law}")

    assert loaded("damping = 1.0").joint("rail").coordinates["x"].damping == 1.0
    said = r"rail\.z\.friction.*x carries .* a law with states, hysteresis, maxwell"
    with pytest.raises(DescriptionError, match=said):
        loaded(f"{SHARP}, {MAXWELL}")


def test_a_transmission_has_a_spring_without_states() -> None:
    """So that robots without laws that have states have one."""
    with pytest.raises(DescriptionError, match="no spring between motor and joint"):
        robot_from_toml(SEA.replace("stiffness = 200.0\n", ""))


@pytest.mark.parametrize("name", ["drive", "four_bar", "belt", "gear"])
def test_robots_without_states_keep_all_else(name: str) -> None:
    robot = robot_from_toml(SEA) if name == "drive" else looped(name)
    plain = robot.without_states()
    assert plain.without_states() is plain
    assert build_model(plain).memory == ()
    numbers = {key: x for key, x in robot.numbers() if x is not None}
    kept = {key: x for key, x in numbers.items() if "hysteresis" not in key and "maxwell" not in key}
    for key in [key for key in numbers if key.endswith("hysteresis.share")]:  # whose spring has no state
        where = key.removesuffix(".hysteresis.share")
        stiffness = f"{where}.stiffness"
        kept[stiffness] = kept.get(stiffness, 0.0) + numbers[key] * numbers[f"{where}.hysteresis.stiffness"]
    found = {key: x for key, x in plain.numbers() if x is not None}
    assert found == pytest.approx({key: x for key, x in kept.items() if x or key in found})
    assert found.keys() >= kept.keys() - {key for key, x in kept.items() if not x}
    assert build_model(robot.rigid()).memory == ()


@pytest.mark.parametrize(
    "beside", ["", "stiffness = 5.0, stiffness_negative = 7.0", "stiffness = 5.0, clearance = 1e-3"]
)
def test_the_elastic_share_of_hysteresis_stays(beside: str, built: Build) -> None:
    """As a spring of both sides, where its force is that: far slower than any state, with z as it is at 0."""
    robot = slide(f"{HYSTERESIS}{beside and ', '}{beside}")
    whole, plain = built(robot), built(robot.without_states())
    assert plain.memory == ()
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


def test_python_on_arrays_is_the_kernel(kernel: eomgen.Kernel) -> None:
    """Logarithms among its functions."""
    module: dict[str, Any] = {}
    exec(render_arrays(build_model(slide(HYSTERESIS)), ("forward_dynamics", "energy")), module)
    functions, rng = module["make"](np), np.random.default_rng(5)
    for q, v, u in rng.normal(size=(10, 3, 2)):
        given = functions.forward_dynamics(q, v, u), functions.energy(q, v)
        for found, expected in zip(given, (kernel.forward_dynamics(q, v, u), kernel.energy(q, v)), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("name", ["drive", "belt"])
def test_models_of_mujoco_leave_them_out_by_name(name: str) -> None:
    model = build_model(robot_from_toml(SEA) if name == "drive" else looped(name))
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


def test_simulations_of_all_methods_agree_and_balance() -> None:
    """A slide that is let go: results have z by name."""
    robot = slide(f"stiffness = 100.0, {HYSTERESIS}, {MAXWELL}")
    text = 'duration = 0.5\n[initial]\nq = {{ "rail.z" = 0.3 }}\n[integrator]\nmethod = "{}"\nrtol = 1e-8\n'
    ends = []
    for method in ("auto", "rosenbrock", "radau", "DOP853"):
        result = run_scenario(robot, scenario_from_toml(text.format(method)))
        motion = result.trajectory
        assert motion.memory == ("rail.z.hysteresis.z", "rail.z.maxwell.0.z", "rail.z.maxwell.1.z")
        assert motion.z is not None
        assert result.balance is not None
        assert result.balance.relative_residue < 1e-5
        assert result.balance.of("dissipated")[-1] > 0.5
        ends.append(np.r_[motion.q[-1], motion.v[-1], motion.z[-1]])
    assert np.abs(np.array(ends) - ends[-1]).max() < 1e-5, ends
