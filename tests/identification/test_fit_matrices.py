"""Stiffness and damping from motions and drives: closed mechanisms; matrices of joints, loop joints and bushings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description.load import load_robot
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import FitResult, fit, load_fit
from eomgen.identification.stiffness.frame_pairs import pairs_of
from eomgen.identification.stiffness.least_squares import Noise
from eomgen.identification.stiffness.output_error import output_error_kernels
from eomgen.identification.stiffness.solve import fitting_kernels
from eomgen.kernel.complete import Kernel
from eomgen.kernel.stepping.input_signals import DriveData, InputSignals, Signal, Track
from eomgen.motion import write_motion
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.motion.smoothing import Differentiator
from eomgen.pictures import report_of
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.robot import Coordinate, JointDamping, JointStiffness, Robot
from eomgen.robot.elements import Bushing
from eomgen.robot.elements.matrices import PAIRS
from eomgen.robot.value import COORDINATES, Joint, Link, Loop, Placement
from tests.loops.test_elastic_cuts import linkages
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.commands import command, facts
from tests.support.joint_table import joint_table, link_table
from tests.support.measurements import motion_of
from tests.support.random_robots import Array
from tests.support.refusals import refused
from tests.support.soak import soaked
from tests.support.text_files import text_file

pytestmark = pytest.mark.usefixtures("unoptimised")

SPRINGS = {
    "joint1.gamma": (0.0, 0.4),
    "joint2.gamma": (3.0, 0.05),
    "joint3.gamma": (0.7, 0.2),
}
FAR = {f"joints.joint{i}.gamma.damping": c for i, c in ((1, 0.5), (2, 0.02), (3, 0.1))}


def sprung(name: str, springs: dict[str, tuple[float, float]], scale: float = 1.0) -> eomgen.Robot:
    """A built-in robot with stiffness and damping of these coordinates, times a factor."""
    robot = eomgen.load_robot(name)
    joints = []
    for joint in robot.joints:
        given = dict(joint.coordinates)
        for key, coordinate in joint.coordinates.items():
            if f"{joint.name}.{key}" in springs:
                k, c = springs[f"{joint.name}.{key}"]
                given[key] = replace(coordinate, stiffness=scale * k or None, damping=scale * c or None)
        joints.append(replace(joint, coordinates=given))
    return replace(robot, joints=tuple(joints))


@pytest.mark.soak
@pytest.mark.parametrize("seen", ["joint1.gamma", "joint2.gamma"], ids=["driven", "passive"])
def test_parameters_by_simulations(seen: str) -> None:
    """All dampers of a rigid loop from one coordinate and the drive; where it begins follows from that one, too."""
    true, far = (sprung("four_bar", {f"joint{i}.gamma": (0.0, c) for i, c in zip((1, 2, 3), all_c, strict=True)})
                 for all_c in ((0.2, 0.1, 0.3), (0.5, 0.02, 0.1)))  # fmt: skip
    names = (*output_error_kernels(), "radau_rollout", *mechanism_kernels(true))
    kernel = eomgen.build(true, kernels=tuple(dict.fromkeys(names)))
    q = kernel.assemble([0.8, 0.0, 0.0], fixed=["joint1.gamma"])
    v = kernel.project_velocity(q, [1.0, 0.0, 0.0], ["joint1.gamma"])
    t = np.linspace(0.0, 1.0, 301)
    u = 6.0 * np.sin(5.0 * t) + 3.0 * np.sin(17.0 * t)
    loads = InputSignals(DriveData(torque=Track(Signal.through(t, u[:, None]), np.array([0]))))
    span = {"duration": 1.0, "samples": 300, "rtol": 1e-11, "atol": 1e-13}
    found = kernel.rollout(q, v, loads=loads, method="radau", **span)[0][:, kernel.coordinates.index(seen)]
    motion = motion_from_columns({"t": t, seen: found, "joint1.gamma.drive": u}, kernel.coordinates)
    estimates = fit(
        far, motion, parameters=["joints.*.gamma.damping"], kernel=kernel.replaced(parameters=FAR)
    ).estimates
    for i, c in ((1, 0.2), (2, 0.1), (3, 0.3)):
        assert estimates[f"joints.joint{i}.gamma.damping"].value == pytest.approx(c, rel=1e-6)


def closed_samples(kernel: eomgen.Kernel, guess: Array, free: list[str], t: Array, motions: Array) -> tuple[Array, ...]:
    """Times, and q, v, a, u of a closed motion: ``motions`` (3, T, f) are of the coordinates that move freely."""
    index = [kernel.coordinates.index(name) for name in free]
    q, v, a = (np.zeros((t.size, kernel.n)) for _ in range(3))
    place = guess
    for k in range(t.size):
        place = place.copy()
        place[index] = motions[0, k]
        q[k] = place = kernel.assemble(place, free)
    v[:, index] = motions[1]
    v = kernel.project_velocity(q, v, free)
    rest = [i for i in range(kernel.n) if i not in index]
    a[:, index] = motions[2]
    J = kernel.functions.constraint_jacobian(q)
    missing = np.einsum("tmn,tn->tm", J, a) + kernel.functions.constraint_bias(q, v)
    a[:, rest] -= np.einsum("tnm,tm->tn", np.linalg.pinv(J[:, :, rest], rcond=1e-10), missing)
    return q, v, a, np.asarray(kernel.inverse_dynamics(q, v, a))


def sines(t: Array, means: list[float], size: float, seed: int) -> Array:
    """Sums of sines with both derivatives, (3, T, f)."""
    rng = np.random.default_rng(seed)
    w, phase = rng.uniform(2.0, 9.0, (4, len(means))), rng.uniform(0.0, 6.0, (4, len(means)))
    angle = t[:, None, None] * w + phase
    parts = size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle)
    return np.stack([part.sum(axis=1) + (means if i == 0 else 0.0) for i, part in enumerate(parts)])


def recorded(kernel: eomgen.Kernel, t: Array, samples: tuple[Array, ...], *, rates: bool = True) -> MeasuredMotion:
    """The samples as a file has them, drives at the driven coordinates."""
    q, v, a, u = samples
    return motion_of(kernel.coordinates, t, q, *((v, a) if rates else (None, None)), u)


def four_bar_samples(built: Build, t: Array) -> tuple[eomgen.Robot, eomgen.Kernel, tuple[Array, ...]]:
    """A linkage whose springs are not those of its description, which comes with its kernel."""
    robot = sprung("four_bar", SPRINGS, 0.3)
    kernel = built(robot, *fitting_kernels(robot))
    other = sprung("four_bar", SPRINGS)
    true = built(other, *fitting_kernels(other))
    guess = true.assemble(np.array([1.0, -0.5, 1.0]))
    return robot, kernel, closed_samples(true, guess, ["joint1.gamma"], t, sines(t, [1.2], 0.25, 3))


@pytest.mark.soak
def test_a_linkage_from_exact_samples(built: Build) -> None:
    """Five parameters by one measured drive, to round-off; the loop's forces need not be known."""
    t = np.arange(1200) * 2e-3
    robot, kernel, samples = four_bar_samples(built, t)
    result = fit(robot, recorded(kernel, t, samples), kernel=kernel)
    assert not result.warnings
    for name, (k, c) in SPRINGS.items():
        assert (result[name].stiffness is None) == (k == 0.0)
        if k:
            assert result[name].stiffness.value == pytest.approx(k, rel=1e-8)
            assert result[name].stiffness.described == pytest.approx(0.3 * k)
        assert result[name].damping.value == pytest.approx(c, rel=1e-8)


@pytest.mark.soak
def test_a_linkage_from_noisy_coordinates(built: Build, tmp_path: Path) -> None:
    """Rates and accelerations are derived; on the command line, too."""
    t = np.arange(3000) * 1e-3
    robot, kernel, (q, v, a, u) = four_bar_samples(built, t)
    exact = fit(robot, recorded(kernel, t, (q, v, a, u), rates=False), kernel=kernel)
    for entry in exact.fitted:
        for estimate, value in zip((entry.stiffness, entry.damping), SPRINGS[entry.coordinate], strict=True):
            if estimate is not None:
                assert estimate.value == pytest.approx(value, rel=5e-3)
    rng = np.random.default_rng(0)
    noisy = (q + 2e-5 * rng.standard_normal(q.shape), v, a, u * (1.0 + 1e-3 * rng.standard_normal(u.shape)))
    motion = write_motion(tmp_path / "motion.csv", recorded(kernel, t, noisy, rates=False))
    found = fit(robot, motion, kernel=kernel)
    for name, (k, c) in SPRINGS.items():
        if k:
            assert found[name].stiffness.value == pytest.approx(k, rel=0.03, abs=0.02)
        assert found[name].damping.value == pytest.approx(c, rel=0.1, abs=0.01)
    description = tmp_path / "four_bar.toml"
    text = (Path(eomgen.__file__).parent / "robots" / "four_bar.toml").read_text()
    table = "gamma = { stiffness = 1.0, damping = 0.1 }\n"
    description.write_text(text.replace('name = "joint2"\n', f'name = "joint2"\n{table}'))
    assert [entry["coordinate"] for entry in facts("fit", description, motion)["fitted"]] == ["joint2.gamma"]
    assert "joint2.gamma.stiffness" in command("fit", description, motion)


def test_what_a_linkage_does_not_say(built: Build) -> None:
    """Without its drive nothing, and at rest only sums of springs; names that are none are refused."""
    t = np.arange(1200) * 2e-3
    robot, kernel, samples = four_bar_samples(built, t)
    with pytest.raises(InputError, match=r"drives of 'joint1\.gamma' are not known.*allowed: their drives"):
        fit(robot, motion_of(kernel.coordinates, t, *samples[:3]), kernel=kernel)
    kept = np.repeat(samples[0][:1], t.size, axis=0)
    zero = np.zeros_like(kept)
    rest = (kept, zero, zero, kernel.inverse_dynamics(kept, zero, zero))
    still = fit(robot, recorded(kernel, t, rest), kernel=kernel)
    said = " ".join(still.warnings)
    assert "do not determine" in said
    assert not any(entry.damping for entry in still.fitted)
    refused(InputError, "joint9", fit, robot, recorded(kernel, t, samples), coordinates=["joint9.gamma"], kernel=kernel)


def of_the_pin(true: eomgen.Kernel) -> MeasuredMotion:
    """A motion of a linkage whose cut joint gives way, with the drives that it takes."""
    t = np.arange(1500) * 2e-3
    angles = sines(t, [1.0], 0.2, 5)[:, :, 0]
    q = np.stack([angles[0], -0.5 + 0.05 * np.sin(7 * t), 1.44 + 0.05 * np.cos(5 * t)], axis=1)
    v = np.stack([angles[1], 0.35 * np.cos(7 * t), -0.25 * np.sin(5 * t)], axis=1)
    a = np.stack([angles[2], -2.45 * np.sin(7 * t), -1.25 * np.cos(5 * t)], axis=1)
    return recorded(true, t, (q, v, a, np.asarray(true.inverse_dynamics(q, v, a, cut=True))))


def test_springs_in_a_cut_joint(built: Build) -> None:
    """Springs and dampers of a cut joint's coordinates, where nothing rigid closes the loop."""
    law = "stiffness = {}, damping = {}"
    six = f"x = {{{{ {law} }}}}\ny = {{{{ {law} }}}}\ngamma = {{{{ damping = 0.02 }}}}\n"
    here = linkages(six.format(1e4, 3.0, 2e4, 3.0))[0]
    there = linkages(six.format(5e3, 1.0, 5e4, 1.0))[0]
    kernel, true = built(there, *fitting_kernels(there)), built(here, *fitting_kernels(here))
    found = fit(there, of_the_pin(true), kernel=kernel)
    for name, value in (("cut.x.stiffness", 1e4), ("cut.y.stiffness", 2e4), ("cut.x.damping", 3.0)):
        assert found.parameters[f"loops.{name}"] == pytest.approx(value, rel=1e-6)


@pytest.mark.soak
def test_a_platform_from_exact_samples(built: Build) -> None:
    """Gough's platform: springs and dampers in its legs and at its universal joints, by six measured drives."""
    springs = {
        "leg1.z": (40.0, 5.0),
        "leg4.z": (0.0, 9.0),
        "universal1.alpha": (8.0, 0.3),
        "universal5.beta": (0.0, 0.7),
    }
    robot, other = (sprung("gough", springs, scale) for scale in (0.5, 1.0))
    kernel, true = (built(each, *fitting_kernels(each)) for each in (robot, other))
    legs = [f"leg{i}.z" for i in range(1, 7)]
    home = true.assemble(np.array([robot.home.get(name, 0.0) for name in true.coordinates]))
    means = [home[true.coordinates.index(name)] for name in legs]
    t = np.arange(900) * 2e-3
    samples = closed_samples(true, home, legs, t, sines(t, means, 0.01, 2))
    result = fit(robot, recorded(kernel, t, samples), kernel=kernel)
    assert not result.warnings
    assert {entry.coordinate for entry in result.fitted} == set(springs)
    for name, (k, c) in springs.items():
        assert result.parameters.get(f"joints.{name}.stiffness", 0.0) == pytest.approx(k, rel=1e-6)
        assert result.parameters[f"joints.{name}.damping"] == pytest.approx(c, rel=1e-6)


# Matrices: forces of those of joints are Pinocchio's, those of bushings and loop joints the generated code's


STEP, SAMPLES = 5e-4, 4000
T = np.arange(SAMPLES) * STEP
NAMES = (*(f"mount.{name}" for name in COORDINATES), "arm.gamma")
BASE = Placement.from_rpy((0.1, -0.05, 0.2), (0.3, -0.2, 0.5))
OFF = Placement.from_rpy((0.1002, -0.0501, 0.1999), (0.3003, -0.1996, 0.5002))  # nearly the same: small deviations
KEYS = ("stiffness", "damping")
OWNERS = ("joints", "bushings", "loops")


def definite(seed: int, scale: float, size: int = 6) -> Array:
    rows = np.random.default_rng(seed).normal(size=(size + 2, size))
    return np.asarray(scale * (rows.T @ rows))


K, D = definite(1, 2e4), definite(2, 200.0)


def bench(**elements: object) -> Robot:
    """A body whose six coordinates all may move, and an arm on it; all coordinates have a drive in the motions."""
    mount = Joint("mount", "base", "body", "fixed", coordinates={name: Coordinate() for name in COORDINATES})
    arm = Joint("arm", "body", "tip", "revolute", coordinates={"gamma": Coordinate()})
    links = (
        Link("body", 4.0, (0.02, -0.01, 0.05), (0.05, 0.04, 0.06, 0.001, 0.002, -0.001)),
        Link("tip", 1.0, (0.1, 0.0, 0.02), (0.01, 0.02, 0.02, 0.0, 0.0, 0.0)),
    )
    return Robot("bench", (0.0, 0.0, -9.81), links, (replace(mount, **elements), arm))


def held(owner: str, *links: str, **matrices: object) -> Robot:
    """The bench with these elements: of its first joint, or of a bushing or a loop joint that holds body or tip."""
    robot, ends = bench(), links or ("base", "body")
    if owner == "joints":
        return bench(**matrices)
    if owner == "bushings":
        return replace(robot, elements=(Bushing("mount", ends, (BASE, OFF), **matrices),))
    tables = {name: Coordinate() for name in COORDINATES}
    offset = (1e-4, 0.0, None, 2e-4, 0.0, -1e-4)
    return replace(robot, loops=(Loop("mount", ends, "fixed", (BASE, OFF), tables, offset, **matrices),))


def bare(owner: str) -> Robot:
    """The bench without numbers to begin with; a bushing has some."""
    return held(owner, **({"stiffness": 6 * (1e3,)} if owner == "bushings" else {}))


def of_numbers(numbers: dict[str, Array]) -> dict[str, object]:
    kinds = {"stiffness": JointStiffness, "damping": JointDamping}
    return {key: kinds[key].of(matrix.tolist()) for key, matrix in numbers.items()}


@cache
def motion(fastest: float = 20.0, moving: tuple[str, ...] = COORDINATES) -> tuple[Array, Array, Array]:
    """q, v, a of small sums of sines of the mount up to so many rad/s, and of large ones of the arm."""
    rng = np.random.default_rng(5)
    w, phase = rng.uniform(0.15 * fastest, fastest, (5, 7)), rng.uniform(0.0, 6.0, (5, 7))
    size = np.array([*(1e-3 * (name in moving) for name in COORDINATES), 0.1])
    angle = T[:, None, None] * w + phase
    parts = np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)
    return tuple(size * part.sum(axis=1) for part in parts)


@cache
def rigid_forces(fastest: float, moving: tuple[str, ...]) -> Array:
    """What moves the bodies without springs and dampers, by Pinocchio, (T, 7)."""
    oracle = PinocchioOracle(bench())
    return np.array([oracle.inverse_dynamics(*state) for state in zip(*motion(fastest, moving), strict=True)])


def measured(
    u: Array | None = None,
    *,
    stiffness: Array = K,
    damping: Array = D,
    noise: float = 0.0,
    seed: int = 0,
    rates: bool = True,
    moving: tuple[str, ...] = COORDINATES,
    fastest: float = 20.0,
) -> MeasuredMotion:
    """The motion with drives, by default those for matrices of the joint; noise is a share of deviations' spreads."""
    q, v, a = motion(fastest, moving)
    if u is None:
        u = rigid_forces(fastest, moving).copy()
        u[:, :6] += q[:, :6] @ stiffness + v[:, :6] @ damping
    off = noise * q.std(axis=0) * np.random.default_rng(seed).standard_normal(q.shape)
    off[:, 6] *= 1e-3
    return motion_of(NAMES, T, q + off, *((v, a) if rates else (None, None)), u)


def kernel_of(built: Build, robot: Robot) -> Kernel:
    return built(robot, *fitting_kernels(robot))


def forces_by(true: Kernel, fastest: float = 20.0) -> Array:
    return np.asarray(true.inverse_dynamics(*motion(fastest), cut=bool(true.cut_laws)))


def forces_of(built: Build, owner: str, numbers: dict[str, Array], fastest: float = 20.0) -> Array | None:
    """Drives for matrices of an element, (T, 7); those of joints are not asked of a kernel."""
    return None if owner == "joints" else forces_by(kernel_of(built, held(owner, **of_numbers(numbers))), fastest)


def fitted(built: Build, robot: Robot, given: MeasuredMotion, *names: str) -> FitResult:
    return fit(robot, given, matrices=names or None, kernel=built(robot, *fitting_kernels(robot)))


WHOLE = ("joints.mount.stiffness", "joints.mount.damping")


def off_by(found: FitResult, key: str, expected: Array) -> float:
    """Largest error of a matrix scaled by its diagonal."""
    size = np.sqrt(np.diag(expected))
    return float(np.abs((np.array(found.matrix("mount", key).matrix) - expected) / np.outer(size, size)).max())


@pytest.mark.parametrize("owner", OWNERS)
@pytest.mark.parametrize("seed", soaked([1, 11, 21], [1]))
def test_random_matrices_are_recovered(seed: int, owner: str, built: Build) -> None:
    """Twice 21 entries from seven forces without noise to 1e-6; and again where the description has them."""
    numbers = {"stiffness": definite(seed, 2e4), "damping": definite(seed + 1, 200.0)}
    given = measured(forces_of(built, owner, numbers), **numbers)
    found = fitted(built, bare(owner), given, *(f"{owner}.mount.{key}" for key in KEYS))
    assert not found.warnings
    assert not found.fitted
    assert len(found.parameters) == 42
    for key, matrix in numbers.items():
        assert off_by(found, key, matrix) < 1e-6
        part = found.matrix("mount", key)
        assert (part.owner, part.coordinates) == (owner, COORDINATES)
        assert part.lowest > 0.0
        for one, other in PAIRS:
            estimate = part[f"{one}.{other}"]
            begun = owner == "bushings" and key == "stiffness" and one == other
            assert estimate.described == (1e3 if begun else 0.0)
            assert found.parameters[f"{owner}.mount.{key}.{one}.{other}"] == estimate.value
            value = matrix[COORDINATES.index(one), COORDINATES.index(other)]
            assert estimate.value == pytest.approx(value, abs=1e-6 * np.abs(matrix).max())
    wrong = JointStiffness.of((1.3 * numbers["stiffness"]).tolist())
    again = held(owner, stiffness=wrong, damping=found.matrix("mount", "damping").element())
    twice = fitted(built, again, given)  # without being asked
    for key, matrix in numbers.items():
        assert off_by(twice, key, matrix) < 1e-6
    assert twice.matrix(f"{owner}.mount")["x.beta"].described == pytest.approx(1.3 * numbers["stiffness"][0, 4])


def test_derivatives_that_are_not_measured_do_little(built: Build) -> None:
    found = fitted(built, bench(), measured(rates=False), *WHOLE)
    assert off_by(found, "stiffness", K) < 1e-6
    assert off_by(found, "damping", D) < 1e-5


@pytest.mark.parametrize("owner", OWNERS)
@pytest.mark.parametrize(("level", "runs"), [(0.005, 3), pytest.param(0.03, 20, marks=pytest.mark.soak)])
def test_intervals_cover_with_noise(level: float, runs: int, owner: str, built: Build) -> None:
    """Of 42 entries nine in ten and more, and the lowest eigenvalue within five of its standard errors."""
    numbers, inside, off = {"stiffness": K, "damping": D}, [], []
    u = forces_of(built, owner, numbers, 40.0)
    for seed in range(runs if owner == "joints" else 2 * runs // 3):
        given = measured(u, noise=level, seed=seed, rates=False, fastest=40.0)
        found = fitted(built, bare(owner), given, *(f"{owner}.mount.{key}" for key in KEYS))
        for key, matrix in numbers.items():
            assert off_by(found, key, matrix) < (0.6 if key == "stiffness" else 4.0) * level
            size, part = np.sqrt(np.diag(matrix)), found.matrix("mount", key)
            lowest = np.linalg.eigvalsh(matrix / np.outer(size, size))[0]
            assert abs(part.lowest - lowest) < 5.0 * part.lowest_error
            for one, other in PAIRS:
                estimate = part[f"{one}.{other}"]
                value = matrix[COORDINATES.index(one), COORDINATES.index(other)]
                inside.append(estimate.low <= value <= estimate.high)
                off.append(abs(estimate.value - value) / estimate.standard_error)
    assert np.mean(inside) >= 0.9
    assert 0.4 < np.median(off) < 1.1  # 0.67 of a normal distribution


def test_what_noise_adds_is_known_on_average() -> None:
    """Products of noise in columns and right sides over a million samples, with a motor's inertia between them."""
    rng = np.random.default_rng(3)
    sigma, shares, inertia = np.array([0.5, 2.0]), rng.normal(size=(3, 2, 2, 2)), rng.normal(size=(2, 2))
    weights, wide = Differentiator(8, 0.5).weights, np.ones(3) / 3.0
    z = sigma * rng.standard_normal((1_000_000, 2))
    parts = np.stack([[np.convolve(np.convolve(x, w), wide, "valid") for x in z.T] for w in weights])
    columns = np.einsum("dkt,pfkd->tfp", parts[:2], shares, optimize=True)
    right = -np.einsum("kt,fk->tf", parts[2], inertia, optimize=True)
    of_X, of_y = Noise(sigma, shares, inertia, weights, True).behind(wide)
    found = np.einsum("tfp,tfq->pq", columns, columns) / len(columns)
    np.testing.assert_allclose(of_X, found, atol=0.02 * np.abs(found).max())
    found_y = np.einsum("tfp,tf->p", columns, right) / len(columns)
    np.testing.assert_allclose(of_y, found_y, atol=0.02 * np.abs(found_y).max())
    of_X, of_y = Noise(sigma, shares, inertia, weights, False).behind(wide)  # rates were measured
    columns = np.einsum("kt,pfk->tfp", parts[0], shares[..., 0], optimize=True)
    found = np.einsum("tfp,tfq->pq", columns, columns) / len(columns)
    np.testing.assert_allclose(of_X, found, atol=0.02 * np.abs(found).max())
    assert not of_y.any()


def test_chosen_entries_stand_beside_what_is_described(built: Build) -> None:
    """Others count as described: a matrix, a table's stiffness, which an entry of the diagonal takes in, and a lag."""
    own, table, lag = K, np.diag([0.0, 1e4, 0.0, 0.0, 2e3, 0.0]), 0.05 / (np.pi * 20.0)
    wrong = own.copy()
    wrong[[0, 4], [4, 0]] *= 0.98
    wrong[1, 1] *= 1.01
    robot = bench(stiffness=JointStiffness.of(wrong.tolist()), damping=JointDamping(ratio=0.05, at_hz=20.0))
    first, arm = robot.joints
    springs = zip(COORDINATES, np.diag(table).tolist(), strict=True)
    tables = {name: Coordinate(stiffness=x or None) for name, x in springs}
    robot = replace(robot, joints=(replace(first, coordinates=tables), arm))
    given = measured(stiffness=own + table, damping=lag * own)
    found = fitted(built, robot, given, "joints.mount.stiffness.beta.x", "joints.mount.stiffness.y.y")
    part = found.matrix("mount")
    assert [entry.entry for entry in part.entries] == ["x.beta", "y.y"]
    assert part["x.beta"].described == pytest.approx(0.98 * own[0, 4])
    assert part["x.beta"].value == pytest.approx(own[0, 4], rel=1e-5)
    assert part["y.y"].described == pytest.approx(1.01 * own[1, 1] + 1e4)
    assert part["y.y"].value == pytest.approx(own[1, 1] + 1e4, rel=1e-3)  # the table's part has no lag
    assert part.taken_in == ("y",)
    assert found.parameters["joints.mount.y.stiffness"] == 0.0
    assert "with it the tables of 'mount.y' have none" in found.notes[-1]
    assert {x.coordinate for x in found.fitted if x.stiffness} == {
        f"mount.{name}" for name in COORDINATES if name != "y"
    }


def test_what_cannot_be_seen_is_said_by_name(built: Build) -> None:
    moving = ("x", "y", "beta")
    found = fitted(built, bench(), measured(damping=0.0 * D, moving=moving), *WHOLE[:1])
    part = found.matrix("mount")
    seen = {f"{one}.{other}" for one, other in PAIRS if one in moving or other in moving}
    assert {entry.entry for entry in part.entries} == seen
    assert set(part.open) == {f"{one}.{other}" for one, other in PAIRS} - seen
    (said,) = [text for text in found.warnings if "do not determine" in text]
    assert "'mount.stiffness.z.z'" in said
    for one, other in ((one, other) for one, other in PAIRS if f"{one}.{other}" in seen):
        expected = K[COORDINATES.index(one), COORDINATES.index(other)]
        assert part[f"{one}.{other}"].value == pytest.approx(expected, abs=1e-6 * K.max())
    with pytest.raises(UnknownNameError, match=r"mount.stiffness: 'z.z' was not found; found: x.x, x.y"):
        part["z.z"]
    x = motion()[0][:, 0]
    few = motion_from_columns({"t": T, "mount.x": x, "mount.x.drive": K[0, 0] * x}, NAMES)
    (said,) = [x for x in fitted(built, bench(), few, "joints.mount.stiffness.x.*").warnings if "has them" in x]
    assert said.startswith("not fitted, as no measured coordinate with a known drive has them: 'mount.stiffness.x.y'")
    assert "'mount.stiffness.x.x'" not in said


def test_an_indefinite_matrix_is_reported_and_not_cut_off(built: Build) -> None:
    size = np.sqrt(np.diag(K))
    values, vectors = np.linalg.eigh(K / np.outer(size, size))
    values[0] = -0.05
    wrong = (vectors * values) @ vectors.T * np.outer(size, size)
    found = fitted(built, bench(), measured(stiffness=wrong), *WHOLE)
    part = found.matrix("mount")
    assert off_by(found, "stiffness", wrong) < 1e-6
    scaled = wrong / np.sqrt(np.outer(np.diag(wrong), np.diag(wrong)))
    assert part.lowest == pytest.approx(np.linalg.eigvalsh(scaled)[0], rel=1e-5)
    assert not part.is_definite
    (warning,) = found.warnings
    assert "mount.stiffness is not positive semidefinite" in warning
    assert "which noise does not" in warning
    assert not any(name.startswith("joints.mount.stiffness.") for name in found.parameters)
    assert any(name.startswith("joints.mount.damping.") for name in found.parameters)
    refused(InputError, r"mount\.stiffness: is not positive semidefinite", part.element)


@pytest.mark.soak
def test_a_linkage_with_a_matrix(built: Build) -> None:
    """Of a closed mechanism the entries come from its drives, too, whatever the loop's forces are."""
    matrix = np.array([[3e3, 40.0], [40.0, 2.0]])
    four_bar = load_robot("four_bar")

    def linkage(scale: float) -> Robot:
        first, *rest = four_bar.joints
        first = replace(
            first,
            coordinates={"x": Coordinate(damping=5.0), **first.coordinates},
            stiffness=JointStiffness.of((scale * matrix).tolist(), ("x", "gamma")),
        )
        return replace(four_bar, joints=(first, *rest), driven=("joint1.x", "joint1.gamma"))

    true, robot = built(linkage(1.0), *fitting_kernels(linkage(1.0))), linkage(0.4)
    t = np.arange(1200) * 2e-3
    guess = true.assemble(np.array([0.0, 1.0, -0.5, 1.0]))
    motions = sines(t, [0.0, 1.2], 1.0, 3) * np.array([1e-3, 0.25])
    motions[0, :, 1] += 0.9
    samples = closed_samples(true, guess, ["joint1.x", "joint1.gamma"], t, motions)
    given = recorded(true, t, samples)
    found = fit(robot, given, kernel=built(robot, *fitting_kernels(robot)))
    assert found.matrix("joint1").coordinates == ("x", "gamma")
    np.testing.assert_allclose(found.matrix("joint1").matrix, matrix, rtol=1e-5)


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("joints.mout.stiffness", "'joints.mout.stiffness' names no entry; did you mean 'joints.mount.stiffness'?"),
        ("joints.mount.stiffness.x.q", "names no entry"),
        ("mount.stiffness", "names no entry"),
        ("joints.mount", "names no entry"),
        ("", "names no entry"),
        ("joints.arm.stiffness", "names no entry"),
        ("joints.mount.stiffness.x.beta.y", "names no entry"),
        ("loops.mount.stiffness", "names no entry; did you mean"),
        ("bushings.mount.stiffness.x.q", "names no entry"),
        ("bushings.mout.stiffness", "did you mean 'bushings.mount.stiffness'?"),
        ("bushings.mount", "names no entry"),
    ],
)
def test_wrong_names_are_refused(pattern: str, said: str, built: Build) -> None:
    robot = bare("bushings" if pattern.startswith(("bushings", "loops")) else "joints")
    with pytest.raises(UnknownNameError, match=said):
        fitted(built, robot, motion_of(NAMES, T, *motion(), np.ones((SAMPLES, 7))), pattern)


def test_damping_of_another_form_is_not_looked_for(built: Build) -> None:
    for damping, form in ((JointDamping(linear=3.0), "isotropic"), (None, "proportional")):
        ratio = JointDamping(ratio=0.1, at_hz=3.0)
        robot = bench(stiffness=JointStiffness.of(K.tolist()), damping=damping or ratio)
        refused(InputError, f"the damping of mount is {form}", fitted, built, robot, measured(), "joints.mount.damping")


def test_results_are_kept_and_shown(tmp_path: Path, built: Build) -> None:
    found = fitted(built, bench(), measured(), "joints.mount.*.x.*")
    assert load_fit(found.save(tmp_path / "fit.json")) == found
    text = str(found)
    assert "mount.stiffness.x.beta" in text
    assert len(found.as_rows().values) == 12 + len([x for x in found.estimates if x.count(".") == 2])
    page = report_of(found)
    assert page.summary == ("10 parameters of 5 coordinates, 12 entries of 2 matrices",)
    q = motion()[0]
    u = rigid_forces(20.0, COORDINATES) + np.pad(q[:, :6] @ K, ((0, 0), (0, 1)))
    write_motion(tmp_path / "m.csv", motion_of(NAMES, T, q, u=u))
    rows = "".join(f"{name} = {{}}\n" for name in COORDINATES)
    words = (
        "fit",
        text_file(
            tmp_path / "bench.toml",
            f"""name = "bench"
gravity = [0.0, 0.0, -9.81]
{link_table("body", 4.0, (0.02, -0.01, 0.05))}
inertia = {{ xx = 0.05, yy = 0.04, zz = 0.06, xy = 0.001, xz = 0.002, yz = -0.001 }}
{link_table("tip", 1.0, (0.1, 0.0, 0.02), (0.01, 0.02, 0.02))}
{joint_table("mount", "base", "body", "fixed")}
{rows}
{joint_table("arm", "body", "tip", "revolute")}
""",
        ),
        tmp_path / "m.csv",
        "--matrices",
        "joints.mount.stiffness",
    )
    (matrix,) = facts(*words)["matrices"]
    np.testing.assert_allclose(matrix["matrix"], K, atol=1e-5 * K.max())


@pytest.mark.parametrize("links", [("base", "body"), ("tip", "base")], ids="-".join)
@pytest.mark.parametrize("owner", OWNERS[1:])
def test_coordinates_are_those_of_the_generated_code(owner: str, links: tuple[str, str], built: Build) -> None:
    robot = held(owner, *links, **of_numbers({"stiffness": K, "damping": D}))
    kernel = kernel_of(built, robot)
    q, v, _ = motion()
    s, rows = pairs_of(robot)[owner, "mount"].deviations(kernel, q[:50])
    if owner == "loops":
        values, jacobian = kernel.functions.cut_forces(q[:50], v[:50]), kernel.functions.cut_jacobian(q[:50])
    else:
        more = built(robot, "element_forces", "element_jacobian")
        values, jacobian = more.functions.element_forces(q[:50], v[:50]), more.functions.element_jacobian(q[:50])
    np.testing.assert_allclose(s, np.asarray(values)[:, :, 0], atol=1e-14)
    np.testing.assert_allclose(rows, jacobian, atol=1e-13)


@pytest.mark.parametrize("owner", OWNERS[1:])
def test_chosen_entries_between_frames(owner: str, built: Build) -> None:
    """Others count as described, and so does damping in proportion to the stiffness."""
    wrong = K.copy()
    wrong[[0, 4], [4, 0]] *= 0.98
    wrong[1, 1] *= 1.01
    share = JointDamping(ratio=0.05, at_hz=20.0)
    given = measured(forces_by(kernel_of(built, held(owner, stiffness=JointStiffness.of(K.tolist()), damping=share))))
    robot = held(owner, stiffness=JointStiffness.of(wrong.tolist()), damping=share)
    found = fitted(built, robot, given, f"{owner}.mount.stiffness.beta.x", f"{owner}.mount.stiffness.y.y")
    part = found.matrix("mount")
    assert [entry.entry for entry in part.entries] == ["x.beta", "y.y"]
    assert part["x.beta"].value == pytest.approx(K[0, 4], rel=1e-6)
    assert part["y.y"].value == pytest.approx(K[1, 1], rel=1e-6)
    assert part["y.y"].described == pytest.approx(1.01 * K[1, 1])
    with pytest.raises(InputError, match=r"the damping of mount is proportional to its stiffness \(ratio\)"):
        fitted(built, robot, given, f"{owner}.mount.damping")


def test_six_numbers_of_a_bushing_are_a_diagonal(built: Build, tmp_path: Path) -> None:
    """A chosen coupling stands beside them, and tables of joints that the description gives are found, too."""
    six = np.diag([2e4, 3e4, 1e4, 200.0, 300.0, 100.0])
    coupled = six.copy()
    coupled[[0, 4], [4, 0]] = 900.0
    robot, true = (
        held("bushings", stiffness=tuple(np.diag(six).tolist())),
        held("bushings", stiffness=JointStiffness.of(coupled.tolist())),
    )

    def sprung(robot: Robot, k: float) -> Robot:
        first, arm = robot.joints
        table = {**first.coordinates, "z": Coordinate(stiffness=k)}
        return replace(robot, joints=(replace(first, coordinates=table), arm))

    given = measured(forces_by(kernel_of(built, sprung(true, 5e3))))
    found = fitted(built, sprung(robot, 4e3), given, "bushings.mount.stiffness.x.beta")
    part = found.matrix("mount")
    np.testing.assert_allclose(part.matrix, coupled, rtol=1e-6, atol=1e-6)
    assert part.element() == JointStiffness.of(np.array(part.matrix).tolist())
    assert [entry.coordinate for entry in found.fitted] == ["mount.z"]
    assert found["mount.z"].stiffness.value == pytest.approx(5e3, rel=1e-6)
    assert load_fit(found.save(tmp_path / "fit.json")) == found
    both = fitted(built, sprung(robot, 4e3), given, "bushings.mount.stiffness.x.beta", "joints.mount.stiffness.z.z")
    assert [(x.owner, x.name) for x in both.matrices] == [
        ("joints", "mount.stiffness"),
        ("bushings", "mount.stiffness"),
    ]
    assert {"joints.mount.stiffness.z.z", "bushings.mount.stiffness.x.beta"} <= set(both.estimates)
    assert both.estimates["joints.mount.stiffness.z.z"].value == pytest.approx(5e3, rel=1e-6)
    assert both.matrix("bushings.mount")["x.beta"].value == pytest.approx(900.0, rel=1e-6)


def with_pin(robot: Robot, matrix: Array, names: tuple[str, ...]) -> Robot:
    (loop,) = robot.loops
    return replace(robot, loops=(replace(loop, stiffness=JointStiffness.of(matrix.tolist(), names)),))


def test_a_loop_joint_with_rigid_coordinates(built: Build) -> None:
    """A linkage's pin whose x and y give way together, by the one drive of the crank: the loop's forces drop out."""
    matrix = np.array([[3e3, 800.0], [800.0, 5e3]])
    there = linkages("x = {}\ny = { damping = 4.0 }\ngamma = {}\n")[0]
    names = ("x", "y")
    kernel, true = (
        kernel_of(built, with_pin(there, 0.4 * matrix, names)),
        kernel_of(built, with_pin(there, matrix, names)),
    )
    given = of_the_pin(true)
    found = fit(with_pin(there, 0.4 * matrix, names), given, kernel=kernel)
    np.testing.assert_allclose(found.matrix("cut").matrix, matrix, rtol=1e-6)
    assert found["cut.y"].damping.value == pytest.approx(4.0, rel=1e-6)
    chosen = fit(with_pin(there, matrix, names), given, matrices=["loops.cut.stiffness.x.y"], kernel=true)
    assert chosen.matrix("cut").matrix == pytest.approx(matrix, rel=1e-6)


def test_a_loop_joint_that_is_rigid_but_for_what_is_coupled(built: Build) -> None:
    """A pin that gives way along x and turns: y closes the linkage, whatever its force is."""
    matrix, names = np.array([[3e3, 8.0], [8.0, 0.4]]), ("x", "gamma")
    there = replace(linkages("x = {}\ngamma = {}\n")[0], driven=("motor.gamma", "pin.gamma"))
    true, t = kernel_of(built, with_pin(there, matrix, names)), np.arange(1200) * 2e-3
    assert true.constraints
    motions = sines(t, [0.0, 0.0], 1.0, 3) * np.array([0.05, 0.005])
    start = true.assemble(np.array([1.0, -0.5, 1.44]), ["motor.gamma"])
    motions[0] += start[:2]
    samples = closed_samples(true, start, ["motor.gamma", "pin.gamma"], t, motions)
    given = recorded(true, t, samples)
    found = fit(
        with_pin(there, 0.4 * matrix, names), given, kernel=kernel_of(built, with_pin(there, 0.4 * matrix, names))
    )
    np.testing.assert_allclose(found.matrix("cut").matrix, matrix, rtol=1e-6)
    assert "not taken off" in found.notes[1]
