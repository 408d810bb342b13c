"""fit by the output-error method: LuGre friction from motions, what they do not show, intervals, other parameters."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import FitResult, fit, load_fit
from eomgen.identification.stiffness import output_error
from eomgen.identification.stiffness.levenberg_marquardt import Residuals, certainty, descend
from eomgen.identification.stiffness.output_error import output_error_kernels
from eomgen.identification.stiffness.simulated import run_of
from eomgen.kernel.stepping.input_signals import DriveData, InputSignals, Signal, Track
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot.model import build_model
from tests.loops.test_elastic_cuts import linkages
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.refusals import refused

pytestmark = [pytest.mark.usefixtures("unoptimised")]

KEYS = ("coulomb", "static", "stribeck", "viscous", "bristle_stiffness", "bristle_damping")
TRUE = dict(zip(KEYS, (1.0, 1.5, 0.01, 0.4, 1e4, 60.0), strict=True))
FAR = dict(zip(KEYS, (0.5, 2.4, 0.03, 0.8, 2e4, 100.0), strict=True))
PREFIX = "joints.slide.z.friction."
NAMES = {f"{PREFIX}{'gaussian' if key == 'stribeck' else key}": value for key, value in TRUE.items()}


def block(**numbers: float) -> eomgen.Robot:
    friction = ", ".join(f"{key} = {value!r}" for key, value in numbers.items())
    return on_slide(f'friction = {{ model = "lugre", {friction} }}')


def on_slide(laws: str) -> eomgen.Robot:
    return robot_from_toml(f"""
name = "block"
gravity = [0.0, -9.81, 0.0]
{link_table("body", 1.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("slide", "base", "body", "prismatic")}
z = {{ {laws} }}
""")


def pushes(duration: float, samples: int, hold: float = 1.4) -> tuple[Any, Any]:
    """Return times and forces that rock a block before it breaks away, and then let it slide, (T,) each."""
    t = np.linspace(0.0, duration, samples + 1)
    slow = hold * np.sin(2.0 * np.pi * 2.0 * t / duration) * t / duration
    return t, slow + 0.9 * np.sin(2.0 * np.pi * 6.8 * t / duration)


def measured(
    kernel: eomgen.Kernel, t: Any, u: Any, z: float = 0.0, noise: float = 0.0, seed: int = 1
) -> MeasuredMotion:
    """Return a motion of a block as radau integrates it, with white noise."""
    loads = InputSignals(DriveData(torque=Track(Signal.through(t, u[:, None]), np.array([0]))))
    span = {"duration": float(t[-1]), "samples": t.size - 1}
    options = span | ({"z": [z] * len(kernel.internal_states)} if kernel.internal_states else {})
    q, _ = kernel.rollout([0.0], [0.0], loads=loads, method="radau", rtol=1e-11, atol=1e-14, **options)
    more = noise * np.random.default_rng(seed).standard_normal(t.size)
    return motion_from_columns({"t": t, "slide.z": q[:, 0] + more, "slide.z.drive": u}, kernel.coordinates)


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(block(**TRUE), *output_error_kernels(), "radau_rollout")


def off(found: FitResult) -> dict[str, float]:
    """Return how far found numbers are off, relative."""
    return {name: abs(estimate.value / NAMES[name] - 1.0) for name, estimate in found.estimates.items()}


def test_a_sine_has_the_size_of_its_deviation(kernel: eomgen.Kernel) -> None:
    """Half the square of its amplitude is the variance over whole periods."""
    t = np.arange(400) / 100.0
    columns = {"t": t, "slide.z": 0.02 * np.sin(2.0 * np.pi * t), "slide.z.drive": np.zeros(400)}
    run = run_of(kernel, build_model(block(**TRUE)), motion_from_columns(columns, kernel.coordinates))
    assert run.sizes == pytest.approx([0.02 / np.sqrt(2.0)], rel=1e-9)


@pytest.mark.soak
def test_bristles_are_found_from_far_away(kernel: eomgen.Kernel) -> None:
    motion = measured(kernel, *pushes(4.0, 2000), z=5e-5)
    found = fit(block(**FAR), motion)
    assert set(found.estimates) == set(NAMES)
    assert max(off(found).values()) < 1e-6
    assert found.warnings == ()
    assert found.parameters == {name: estimate.value for name, estimate in found.estimates.items()}
    assert [x.estimate.described for x in found.numbers] == [FAR[key] for key in TRUE]
    [start] = [note for note in found.notes if "at the beginning of" in note]
    assert float(start.rsplit(" ", 1)[1]) == pytest.approx(5e-5, rel=1e-4)


def test_kernels_keep_their_parameters(kernel: eomgen.Kernel) -> None:
    before = dict(kernel.parameters)
    found = fit(block(**TRUE), measured(kernel, *pushes(1.0, 400), noise=1e-6), kernel=kernel)
    assert dict(kernel.parameters) == before
    assert found.estimates[PREFIX + "coulomb"].value != before[PREFIX + "coulomb"]
    assert found.status == "converged"


def test_unequal_times_are_resampled(kernel: eomgen.Kernel) -> None:
    motion, kept = measured(kernel, *pushes(1.0, 900)), np.cumsum(np.random.default_rng(0).integers(1, 4, 420))
    uneven = replace(motion, t=motion.t[kept], q=motion.q[kept], u=motion.u[kept])
    found = fit(block(**TRUE), uneven, parameters=[PREFIX + "coulomb"])
    assert found.status == "converged"
    assert off(found)[PREFIX + "coulomb"] < 1e-3
    assert "intervals from 1.111 to 3.333 ms, resampled" in found.notes[-1]


def test_a_fit_whose_steps_do_not_come_to_an_end_has_not_converged(
    kernel: eomgen.Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output_error, "STEPS", (1, 1))
    far = copy(kernel)
    far.parameters[PREFIX + "coulomb"] = 0.6
    found = fit(block(**{**TRUE, "coulomb": 0.6}), measured(kernel, *pushes(1.0, 400), noise=1e-6), kernel=far)
    assert "1 steps did not come to an end" in found.status
    assert any(text in found.status for text in found.warnings)


def deviations(kernel: eomgen.Kernel, seeds: range) -> Any:
    """Return found less true numbers of motions with noise, over standard errors, and whether intervals hold them."""
    t, u = pushes(2.0, 1000)
    clean, rows = measured(kernel, t, u), []
    for seed in seeds:
        more = 1e-6 * np.random.default_rng(seed).standard_normal(clean.q.shape)
        found = fit(block(**TRUE), replace(clean, q=clean.q + more), kernel=kernel)
        assert set(found.estimates) == set(NAMES)
        pairs = [(x, NAMES[name]) for name, x in found.estimates.items()]
        rows.append([(x.value - true) / x.standard_error for x, true in pairs])
        rows[-1] += [x.low <= true <= x.high for x, true in pairs]
    return np.array(rows, float)


@pytest.mark.soak
def test_intervals_are_those_of_noise(kernel: eomgen.Kernel) -> None:
    rows = deviations(kernel, range(6))
    off_by, held = rows[:, : len(NAMES)], rows[:, len(NAMES) :]
    assert 0.5 < np.sqrt(np.mean(off_by**2)) < 1.6
    assert held.mean() > 0.85


@pytest.mark.soak
def test_intervals_cover(kernel: eomgen.Kernel) -> None:
    held = deviations(kernel, range(100, 160))[:, len(NAMES) :]
    assert 0.91 < held.mean() < 0.985
    assert held.mean(axis=0).min() > 0.85


def test_what_a_motion_does_not_show_is_named(kernel: eomgen.Kernel) -> None:
    t = np.linspace(0.0, 1.0, 501)
    sticks = measured(kernel, t, 0.05 * np.sin(2.0 * np.pi * 3.0 * t), noise=1e-9)
    found = fit(block(**TRUE), sticks)
    doubted = " ".join(found.warnings)
    assert PREFIX + "viscous" in doubted
    assert PREFIX + "coulomb" in doubted  # at no speed beside that of the Stribeck curve
    assert PREFIX + "bristle_stiffness" not in doubted
    assert found.estimates[PREFIX + "bristle_stiffness"].value == pytest.approx(1e4, rel=1e-3)


def test_several_motions_count_together(kernel: eomgen.Kernel) -> None:
    t, u = pushes(1.0, 500)
    sliding = measured(kernel, t, u, noise=1e-6, seed=2)
    rocking = measured(kernel, t, 0.8 * np.sin(2.0 * np.pi * 3.0 * t), z=2e-5, noise=1e-8, seed=3)
    alone, both = (fit(block(**TRUE), motions, kernel=kernel) for motions in (sliding, [sliding, rocking]))
    name = PREFIX + "bristle_stiffness"
    assert both.estimates[name].standard_error < 0.2 * alone.estimates[name].standard_error
    assert abs(both.estimates[name].value - 1e4) < 5.0 * both.estimates[name].standard_error
    assert sum("at the beginning of" in note for note in both.notes) == 2


def test_numbers_can_be_chosen_and_saved(kernel: eomgen.Kernel, tmp_path: Any) -> None:
    motion = measured(kernel, *pushes(1.0, 500), noise=1e-7)
    found = fit(block(**{**TRUE, "coulomb": 0.8}), motion, parameters=[PREFIX + "coulomb"])
    assert list(found.estimates) == [PREFIX + "coulomb"]
    assert found.estimates[PREFIX + "coulomb"].value == pytest.approx(1.0, rel=1e-4)
    assert load_fit(found.save(tmp_path / "fit.json")) == found
    assert found.lines()[0] == "block: numbers by the output-error method"


WOUND = "damping = 20.0, hysteresis = {{ stiffness = {}, beta = {}, gamma = {}, n = {}, share = {} }}"
BRANCHES = (
    "stiffness = 1e5, damping = 1.0, maxwell = [{{ stiffness = {}, damping = {} }}, {{ stiffness = {}, damping = {} }}]"
)
LAWS = {  # with true numbers, and those to begin with
    WOUND: ((2e4, 300.0, 100.0, 1.5, 0.7), (3e4, 150.0, 50.0, 1.2, 0.5)),
    BRANCHES: ((2e4, 4000.0, 3e4, 300.0), (1e4, 3000.0, 5e4, 200.0)),
}


def rocked(law: str, noise: float) -> tuple[eomgen.Robot, MeasuredMotion, list[float]]:
    """Return a rail with numbers to begin with, its motion under a force that rises, and the true numbers."""
    true, begun = LAWS[law]
    robot, guess = (on_slide(law.format(*numbers)) for numbers in (true, begun))
    t = np.linspace(0.0, 4.0, 2001)
    slow = 50.0 * t * np.sin(2.0 * np.pi * t) + 40.0 * np.sin(6.2 * np.pi * t)
    force = slow + (10.0 * np.sin(60.0 * np.pi * t) if law == BRANCHES else 0.0)
    kernel = eomgen.build(robot, kernels=("radau_rollout",), flags=("-O0",))
    return guess, measured(kernel, t, force, noise=noise), list(true)


@pytest.mark.soak
@pytest.mark.parametrize("law", LAWS)
def test_hysteresis_and_branches_are_found(law: str) -> None:
    guess, motion, true = rocked(law, 0.0)
    found = fit(guess, motion)
    assert [x.estimate.value for x in found.numbers] == pytest.approx(true, rel=1e-6)
    guess, motion, true = rocked(law, 1e-7)
    noisy = fit(guess, motion)
    off = [(x.estimate.value - y) / x.estimate.standard_error for x, y in zip(noisy.numbers, true, strict=True)]
    assert max(map(abs, off)) < 4.0
    assert all(x.estimate.low < y < x.estimate.high for x, y in zip(noisy.numbers, true, strict=True)) or max(off) > 2.0


@pytest.mark.soak
def test_the_rate_of_hysteresis_and_its_stiffness_are_one_number() -> None:
    guess, motion, _ = rocked(WOUND, 1e-7)
    found = fit(guess, motion, parameters=["joints.slide.z.hysteresis"])
    assert [x.name for x in found.numbers] == ["joints.slide.z.hysteresis.n"]
    [warning] = found.warnings
    assert "do not determine" in warning
    assert "hysteresis.A" in warning
    assert "hysteresis.stiffness" in warning


WINDING = "damping = 3.0, drive = {{ winding = {{ resistance = {}, inductance = {}, torque_constant = {} }} }}"


def test_windings_are_found_by_their_voltages() -> None:
    true = 1.2, 6e-3, 4.0
    robot, guess = (on_slide(WINDING.format(*numbers)) for numbers in (true, (2.0, 1e-2, 3.0)))
    t = np.linspace(0.0, 2.0, 1001)
    volts = 10.0 * np.sin(2.0 * np.pi * (0.3 * t + 8.0 * t**2))
    kernel = eomgen.build(robot, kernels=("radau_rollout",), flags=("-O0",))
    motion = measured(kernel, t, volts, noise=1e-6)
    found = fit(guess, motion, parameters=["joints.slide.z.drive.winding"])
    assert [x.estimate.value for x in found.numbers] == pytest.approx(true, rel=1e-3)
    off = [(x.estimate.value - y) / x.estimate.standard_error for x, y in zip(found.numbers, true, strict=True)]
    assert max(map(abs, off)) < 4.0
    refused(InputError, "parameters: none; allowed: one at least, by name, as numbers of drives", fit, guess, motion)


PENDULUM = f"""
name = "standing"
gravity = [0.0, -9.81, 0.0]
{link_table("rod", 2.0, (0.0, 0.4, 0.0), (0.1, 0.01, 0.1))}
{joint_table("foot", "base", "rod", "revolute")}
gamma = {{ damping = 0.3 }}
"""


@pytest.mark.soak
def test_a_pendulum_that_falls_is_led_along_its_motion() -> None:
    robot = robot_from_toml(PENDULUM)
    kernel = eomgen.build(robot, kernels=(*output_error_kernels(), "inverse_dynamics"), flags=("-O0",))
    t = np.linspace(0.0, 12.0, 1201)
    phase = 2.0 * np.pi * 0.5 * t
    q, v, a = 0.3 * np.sin(phase), 0.3 * np.pi * np.cos(phase), -0.3 * np.pi**2 * np.sin(phase)
    u = kernel.inverse_dynamics(*(x[:, None] for x in (q, v, a)))[:, 0]
    noise = 1e-4 * np.random.default_rng(5).standard_normal(t.size)
    motion = motion_from_columns({"t": t, "foot.gamma": q + noise, "foot.gamma.drive": u}, kernel.coordinates)
    heavier = replace(robot, links=(replace(robot.links[0], mass=2.5),))
    names = ["links.rod.mass", "joints.foot.gamma.damping"]
    found = fit(heavier, motion, parameters=names, bandwidth=8.0)
    assert found.estimates["links.rod.mass"].value == pytest.approx(2.0, rel=2e-3)
    assert found.estimates["joints.foot.gamma.damping"].value == pytest.approx(0.3, rel=2e-2)
    assert any("led along the motion with 8 rad/s" in note for note in found.notes)
    for name, true in zip(names, (2.0, 0.3), strict=True):
        assert abs(found.estimates[name].value - true) < 4.0 * found.estimates[name].standard_error + 1e-3 * true


def test_refusals(kernel: eomgen.Kernel) -> None:
    motion = measured(kernel, *pushes(1.0, 400))
    robot = block(**TRUE)
    bar = eomgen.load_robot("four_bar")
    rubs = replace(bar.joints[0], coordinates={"gamma": robot.joint("slide").coordinates["z"]})
    bare = motion_from_columns({"t": motion.t, "slide.z": motion.q[:, 0]}, kernel.coordinates)
    closed = r"rigid loops or couplings \(joint4\.x, .*, \.\.\.\) and laws with internal states; allowed for parameters"
    unknown = {"parameters": ["joints.slide.z.friction.colour"]}
    for other, given, options, message in (
        (robot, motion, unknown, "no parameter has this name"),
        (
            robot,
            motion,
            {"coordinates": ["slide.z"]},
            r"coordinates: 'slide.z', and laws have states \('slide.z.friction.z'\)",
        ),
        (robot, motion, {"parameters": []}, "parameters: none"),
        (robot, bare, {}, r"has no 'slide\.z\.drive'"),
        (robot, motion, {"bandwidth": -1.0}, r"bandwidth: -1.0; allowed: a number of rad/s, at least 0"),
        (robot_from_toml(PENDULUM), motion, {"bandwidth": 2.0}, r"bandwidth: 2.0; allowed: with parameters"),
        (replace(bar, joints=(rubs, *bar.joints[1:])), motion, {}, closed),
    ):
        refused(UnknownNameError if options is unknown else InputError, message, fit, other, given, **options)


def test_steps_stay_above_bounds_and_end_where_there_is_no_way_on() -> None:
    x = np.linspace(0.0, 1.0, 50)

    def decay(values: Any) -> Residuals:
        curve = np.exp(-values[0] * x)
        return Residuals(np.exp(0.5 * x) - curve, (-x * curve)[:, None])  # asks for -0.5

    found = descend(decay, np.array([3.0]), np.array([0.0]), 60, small=1e-12, tell=lambda *_: None)
    assert 0.0 <= found.values[0] < 1e-3
    free = descend(decay, np.array([3.0]), np.array([-np.inf]), 60, small=1e-12, tell=lambda *_: None)
    assert free.is_converged
    assert free.values[0] == pytest.approx(-0.5, rel=1e-9)
    assert descend(lambda _: None, np.array([3.0]), np.array([0.0]), 60, small=0.0, tell=lambda *_: None) is None


def test_dependent_columns_are_not_determined() -> None:
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((400, 3))
    columns[:, 2] = 2.0 * columns[:, 1]
    jacobian = np.hstack([columns, np.zeros((400, 1))])
    sure = certainty(Residuals(rng.standard_normal(400), jacobian), np.ones(4), [slice(0, 400)], np.ones(1))
    assert np.isfinite(sure.errors).tolist() == [True, False, False, False]
    assert sure.is_white
    walk = np.cumsum(rng.standard_normal(400))
    assert not certainty(Residuals(walk, jacobian), np.ones(4), [slice(0, 400)], np.ones(1)).is_white


def test_springs_of_elastic_loops(built: Build) -> None:
    """A linkage whose pin is compliant in all that closes it, by the one drive of its crank."""
    pin = "x = {{ stiffness = {}, damping = {} }}\ny = {{ stiffness = {}, damping = 4.0 }}\ngamma = {{}}\n"
    text = pin + "".join(f"{name} = {{{{ stiffness = 1e3 }}}}\n" for name in ("z", "alpha", "beta"))
    names = ("loops.cut.x.stiffness", "loops.cut.x.damping", "loops.cut.y.stiffness")
    values, wrong = (2e3, 3.0, 4e3), (2.5e3, 4.0, 3e3)

    def linkage(numbers: tuple[float, ...]) -> eomgen.Robot:
        (robot, _) = linkages(text.format(*numbers))
        return replace(robot, driven=("motor.gamma",))

    kernel = built(linkage(values), *output_error_kernels())
    assert not kernel.constraints
    t = np.linspace(0.0, 0.6, 401)
    u = np.zeros((t.size, kernel.n))
    u[:, 0] = 0.4 * np.sin(25.0 * t)
    loads = InputSignals(DriveData(torque=Track(Signal.through(t, u), np.arange(kernel.n))))
    span = {"duration": float(t[-1]), "samples": t.size - 1, "method": "rosenbrock", "rtol": 1e-9, "atol": 1e-11}
    q, _ = kernel.rollout([1.0, -0.5, 1.44], [0.0] * 3, loads=loads, **span)
    noisy = q + 1e-6 * np.random.default_rng(2).standard_normal(q.shape)
    columns = {"t": t, "motor.gamma.drive": u[:, 0]} | dict(zip(kernel.coordinates, noisy.T, strict=True))
    found = fit(linkage(wrong), motion_from_columns(columns, kernel.coordinates), parameters=names, kernel=kernel)
    assert not found.warnings
    for name, value in zip(names, values, strict=True):
        estimate = found.estimates[name]
        assert estimate.value == pytest.approx(value, rel=0.01)
        assert abs(estimate.value - value) < 4.0 * estimate.standard_error
