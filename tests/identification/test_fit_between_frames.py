"""Matrices of loop joints and bushings from motions and drives, by kernels of robots that have them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import FitResult, fit, load_fit
from eomgen.identification.stiffness.frame_pairs import pairs_of
from eomgen.identification.stiffness.solve import fitting_kernels
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot import Coordinate, JointDamping, JointStiffness, Robot
from eomgen.robot.elements import Bushing
from eomgen.robot.elements.matrices import PAIRS
from eomgen.robot.value import COORDINATES, Loop, Placement
from eomgen.runtime.kernel import Kernel
from tests.identification.test_closed_fits import closed_samples, columns_of, sines
from tests.identification.test_fit_matrices import bench, definite
from tests.loops.test_elastic_cuts import linkages
from tests.support.builds import Build
from tests.support.random_robots import Array
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

STEP, SAMPLES = 5e-4, 4000
BASE = Placement.from_rpy((0.1, -0.05, 0.2), (0.3, -0.2, 0.5))
OFF = Placement.from_rpy((0.1002, -0.0501, 0.1999), (0.3003, -0.1996, 0.5002))  # nearly the same: small deviations
NUMBERS = {"stiffness": definite(1, 2e4), "damping": definite(2, 200.0)}
KEYS = tuple(NUMBERS)
OWNERS = ("bushings", "loops")


def held(owner: str, *links: str, **matrices: object) -> Robot:
    """The bench, whose body or tip a bushing or a loop joint holds to a link, with these elements."""
    robot, ends = bench(), links or ("base", "body")
    if owner == "bushings":
        return replace(robot, elements=(Bushing("mount", ends, (BASE, OFF), **matrices),))
    tables = {name: Coordinate() for name in COORDINATES}
    offset = (1e-4, 0.0, None, 2e-4, 0.0, -1e-4)
    return replace(robot, loops=(Loop("mount", ends, "fixed", (BASE, OFF), tables, offset, **matrices),))


def of_numbers(numbers: dict[str, Array]) -> dict[str, object]:
    kinds = {"stiffness": JointStiffness, "damping": JointDamping}
    return {key: kinds[key].of(matrix.tolist()) for key, matrix in numbers.items()}


@cache
def motion(fastest: float) -> tuple[Array, Array, Array]:
    """q, v, a of small sums of sines of the body up to so many rad/s, and of large ones of the arm."""
    t, rng = np.arange(SAMPLES) * STEP, np.random.default_rng(5)
    w, phase = rng.uniform(0.15 * fastest, fastest, (5, 7)), rng.uniform(0.0, 6.0, (5, 7))
    size, angle = np.array([*(6 * [1e-3]), 0.1]), t[:, None, None] * w + phase
    q, v, a = np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)
    return size * q.sum(axis=1), size * v.sum(axis=1), size * a.sum(axis=1)


def measured(
    true: Kernel, *, noise: float = 0.0, seed: int = 0, rates: bool = True, fastest: float = 20.0
) -> MeasuredMotion:
    """The motion with the drives that it takes; noise is a share of each deviation's spread, where rates are not."""
    q, v, a = motion(fastest)
    u = np.asarray(true.inverse_dynamics(q, v, a, cut=bool(true.cut_laws)))
    off = noise * q.std(axis=0) * np.random.default_rng(seed).standard_normal(q.shape)
    off[:, 6] *= 1e-3
    columns = {"t": np.arange(SAMPLES) * STEP}
    for i, name in enumerate(true.coordinates):
        columns |= {name: q[:, i] + off[:, i], f"{name}.drive": u[:, i]}
        columns |= {f"{name}.rate": v[:, i], f"{name}.acceleration": a[:, i]} if rates else {}
    return motion_from_columns(columns, true.coordinates)


def fitted(built: Build, robot: Robot, given: MeasuredMotion, *names: str) -> FitResult:
    return fit(robot, given, matrices=names or None, kernel=built(robot, *fitting_kernels(robot)))


def kernel_of(built: Build, robot: Robot) -> Kernel:
    return built(robot, *fitting_kernels(robot))


def off_by(found: FitResult, key: str, expected: Array) -> float:
    """Largest error of a matrix scaled by its diagonal."""
    size = np.sqrt(np.diag(expected))
    return float(np.abs((np.array(found.matrix("mount", key).matrix) - expected) / np.outer(size, size)).max())


@pytest.mark.parametrize("links", [("base", "body"), ("tip", "base")], ids="-".join)
@pytest.mark.parametrize("owner", OWNERS)
def test_coordinates_are_those_of_the_generated_code(owner: str, links: tuple[str, str], built: Build) -> None:
    robot = held(owner, *links, **of_numbers(NUMBERS))
    kernel = kernel_of(built, robot)
    q, v, _ = motion(20.0)
    s, rows = pairs_of(robot)[owner, "mount"].deviations(kernel, q[:50])
    if owner == "loops":
        values, jacobian = kernel.cut_forces(q[:50], v[:50]), kernel.cut_jacobian(q[:50])
    else:
        more = built(robot, "element_forces", "element_jacobian")
        values, jacobian = more.element_forces(q[:50], v[:50]), more.element_jacobian(q[:50])
    np.testing.assert_allclose(s, np.asarray(values)[:, :, 0], atol=1e-14)
    np.testing.assert_allclose(rows, jacobian, atol=1e-13)


@pytest.mark.parametrize("owner", OWNERS)
@pytest.mark.parametrize("seed", soaked([1, 11, 21], [1]))
def test_random_matrices_are_recovered(seed: int, owner: str, built: Build) -> None:
    """Twice 21 entries without noise to 1e-6; again where they are described, without being asked for."""
    numbers = {"stiffness": definite(seed, 2e4), "damping": definite(seed + 1, 200.0)}
    whole = [f"{owner}.mount.{key}" for key in KEYS]
    given = measured(kernel_of(built, held(owner, **of_numbers(numbers))))
    bare = {"stiffness": 6 * (1e3,)} if owner == "bushings" else {}
    found = fitted(built, held(owner, **bare), given, *whole)
    assert not found.warnings
    assert not found.fitted
    assert len(found.parameters) == 42
    for key, matrix in numbers.items():
        assert off_by(found, key, matrix) < 1e-6
        part = found.matrix("mount", key)
        assert (part.owner, part.coordinates) == (owner, COORDINATES)
        assert part.lowest > 0.0
        assert part["x.x"].described == (1e3 if bare and key == "stiffness" else 0.0)
        assert found.parameters[f"{owner}.mount.{key}.x.beta"] == part["x.beta"].value
    made = {key: found.matrix("mount", key).element() for key in KEYS}
    wrong = JointStiffness.of((1.3 * numbers["stiffness"]).tolist())
    twice = fitted(built, held(owner, stiffness=wrong, damping=made["damping"]), given)
    for key, matrix in numbers.items():
        assert off_by(twice, key, matrix) < 1e-6
    assert twice.matrix(f"{owner}.mount")["x.beta"].described == pytest.approx(1.3 * numbers["stiffness"][0, 4])


@pytest.mark.parametrize("owner", OWNERS)
@pytest.mark.parametrize(("level", "runs"), [(0.005, 2), pytest.param(0.03, 12, marks=pytest.mark.soak)])
def test_intervals_cover_with_noise(level: float, runs: int, owner: str, built: Build) -> None:
    """Of 42 entries nine in ten and more, and the lowest eigenvalue within five of its standard errors."""
    true, inside, off = kernel_of(built, held(owner, **of_numbers(NUMBERS))), [], []
    bare = held(owner, **({"stiffness": 6 * (1e3,)} if owner == "bushings" else {}))
    for seed in range(runs):
        given = measured(true, noise=level, seed=seed, rates=False, fastest=40.0)
        found = fitted(built, bare, given, *(f"{owner}.mount.{key}" for key in KEYS))
        for key, matrix in NUMBERS.items():
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


@pytest.mark.parametrize("owner", OWNERS)
def test_chosen_entries_stand_beside_what_is_described(owner: str, built: Build) -> None:
    """Others count as described, and so does damping in proportion to the stiffness."""
    K = NUMBERS["stiffness"]
    wrong = K.copy()
    wrong[[0, 4], [4, 0]] *= 0.98
    wrong[1, 1] *= 1.01
    share = JointDamping(ratio=0.05, at_hz=20.0)
    given = measured(kernel_of(built, held(owner, stiffness=JointStiffness.of(K.tolist()), damping=share)))
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

    given = measured(kernel_of(built, sprung(true, 5e3)))
    found = fitted(built, sprung(robot, 4e3), given, "bushings.mount.stiffness.x.beta")
    part = found.matrix("mount")
    np.testing.assert_allclose(part.matrix, coupled, rtol=1e-6, atol=1e-6)
    assert part.element() == JointStiffness.of(np.array(part.matrix).tolist())
    assert [entry.coordinate for entry in found.fitted] == ["mount.z"]
    assert found["mount.z"].stiffness is not None
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


def test_a_loop_joint_with_rigid_coordinates(built: Build) -> None:
    """A linkage's pin whose x and y give way together, by the one drive of the crank: the loop's forces drop out."""
    matrix = np.array([[3e3, 800.0], [800.0, 5e3]])
    there = linkages("x = {}\ny = { damping = 4.0 }\ngamma = {}\n")[0]
    names = ("x", "y")

    def with_matrix(scale: float) -> Robot:
        (loop,) = there.loops
        return replace(there, loops=(replace(loop, stiffness=JointStiffness.of((scale * matrix).tolist(), names)),))

    kernel, true = kernel_of(built, with_matrix(0.4)), kernel_of(built, with_matrix(1.0))
    t = np.arange(1500) * 2e-3
    angles = sines(t, [1.0], 0.2, 5)[:, :, 0]
    q = np.stack([angles[0], -0.5 + 0.05 * np.sin(7 * t), 1.44 + 0.05 * np.cos(5 * t)], axis=1)
    v = np.stack([angles[1], 0.35 * np.cos(7 * t), -0.25 * np.sin(5 * t)], axis=1)
    a = np.stack([angles[2], -2.45 * np.sin(7 * t), -1.25 * np.cos(5 * t)], axis=1)
    u = np.asarray(true.inverse_dynamics(q, v, a, cut=True))
    given = motion_from_columns(columns_of(kernel, t, (q, v, a, u), rates=True), kernel.coordinates)
    found = fit(with_matrix(0.4), given, kernel=kernel)
    np.testing.assert_allclose(found.matrix("cut").matrix, matrix, rtol=1e-6)
    assert found["cut.y"].damping is not None
    assert found["cut.y"].damping.value == pytest.approx(4.0, rel=1e-6)
    chosen = fit(with_matrix(1.0), given, matrices=["loops.cut.stiffness.x.y"], kernel=true)
    assert chosen.matrix("cut").matrix == pytest.approx(matrix, rel=1e-6)


def test_a_loop_joint_that_is_rigid_but_for_what_is_coupled(built: Build) -> None:
    """A pin that gives way along x and turns: y closes the linkage, whatever its force is."""
    matrix, names = np.array([[3e3, 8.0], [8.0, 0.4]]), ("x", "gamma")
    there = replace(linkages("x = {}\ngamma = {}\n")[0], driven=("motor.gamma", "pin.gamma"))

    def with_matrix(scale: float) -> Robot:
        (loop,) = there.loops
        return replace(there, loops=(replace(loop, stiffness=JointStiffness.of((scale * matrix).tolist(), names)),))

    true, t = kernel_of(built, with_matrix(1.0)), np.arange(1200) * 2e-3
    assert true.constraints
    motions = sines(t, [0.0, 0.0], 1.0, 3) * np.array([0.05, 0.005])
    start = true.assemble(np.array([1.0, -0.5, 1.44]), ["motor.gamma"])
    motions[0] += start[:2]
    samples = closed_samples(true, start, ["motor.gamma", "pin.gamma"], t, motions)
    given = motion_from_columns(columns_of(true, t, samples, rates=True), true.coordinates)
    found = fit(with_matrix(0.4), given, kernel=kernel_of(built, with_matrix(0.4)))
    np.testing.assert_allclose(found.matrix("cut").matrix, matrix, rtol=1e-6)
    assert "not taken off" in found.notes[1]


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("loops.mount.stiffness", "names no entry; did you mean"),
        ("bushings.mount.stiffness.x.q", "names no entry"),
        ("bushings.mout.stiffness", "did you mean 'bushings.mount.stiffness'?"),
        ("bushings.mount", "names no entry"),
    ],
)
def test_wrong_names_are_refused(pattern: str, said: str, built: Build) -> None:
    robot = held("bushings", stiffness=6 * (1e3,))
    with pytest.raises(UnknownNameError, match=said):
        fitted(built, robot, measured(kernel_of(built, robot)), pattern)
