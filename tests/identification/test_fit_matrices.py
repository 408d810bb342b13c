"""Matrices of joints from motions and drives: Pinocchio's forces and NumPy's matrices, with noise and without."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.cli import entry as cli
from eomgen.description.load import load_robot
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import FitResult, fit, load_fit
from eomgen.identification.stiffness.least_squares import Noise
from eomgen.identification.stiffness.solve import fitting_kernels
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.motion.smoothing import Differentiator
from eomgen.pictures import report_of
from eomgen.robot import Coordinate, JointDamping, JointStiffness, Robot
from eomgen.robot.elements.matrices import PAIRS
from eomgen.robot.value import COORDINATES, Joint, Link
from tests.identification.test_closed_fits import closed_samples, columns_of, sines
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
STEP = 5e-4


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


@cache
def motion(fastest: float, moving: tuple[str, ...] = COORDINATES) -> tuple[Array, Array, Array, Array]:
    """Times, and q, v, a of small sums of sines of the mount up to so many rad/s, and of large ones of the arm."""
    t = np.arange(4000) * STEP
    rng = np.random.default_rng(5)
    w, phase = rng.uniform(0.15 * fastest, fastest, (5, 7)), rng.uniform(0.0, 6.0, (5, 7))
    size = np.array([*(1e-3 * (name in moving) for name in COORDINATES), 0.1])
    angle = t[:, None, None] * w + phase
    parts = np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)
    q, v, a = (size * part.sum(axis=1) for part in parts)
    return t, q, v, a


@cache
def rigid_forces(fastest: float, moving: tuple[str, ...] = COORDINATES) -> Array:
    """What moves the bodies without springs and dampers, by Pinocchio, (T, 7)."""
    oracle, (_, *states) = PinocchioOracle(bench()), motion(fastest, moving)
    return np.array([oracle.inverse_dynamics(*state) for state in zip(*states, strict=True)])


def measured(
    stiffness: Array = K,
    damping: Array = D,
    *,
    noise: float = 0.0,
    seed: int = 0,
    rates: bool = True,
    moving: tuple[str, ...] = COORDINATES,
    fastest: float = 20.0,
) -> MeasuredMotion:
    """The motion with the drives that it takes; noise is a share of each deviation's spread, where rates are not."""
    t, q, v, a = motion(fastest, moving)
    u = rigid_forces(fastest, moving).copy()
    u[:, :6] += q[:, :6] @ stiffness + v[:, :6] @ damping
    off = noise * q.std(axis=0) * np.random.default_rng(seed).standard_normal(q.shape)
    off[:, 6] *= 1e-3
    names = (*(f"mount.{name}" for name in COORDINATES), "arm.gamma")
    columns = {"t": t}
    for i, name in enumerate(names):
        columns |= {name: q[:, i] + off[:, i], f"{name}.drive": u[:, i]}
        columns |= {f"{name}.rate": v[:, i], f"{name}.acceleration": a[:, i]} if rates else {}
    return motion_from_columns(columns, names)


def fitted(built: Build, robot: Robot, given: MeasuredMotion, *names: str) -> FitResult:
    return fit(robot, given, matrices=names or None, kernel=built(robot, *fitting_kernels(robot)))


WHOLE = ("joints.mount.stiffness", "joints.mount.damping")


def off_by(found: FitResult, key: str, expected: Array) -> float:
    """Largest error of a matrix scaled by its diagonal."""
    size = np.sqrt(np.diag(expected))
    return float(np.abs((np.array(found.matrix("mount", key).matrix) - expected) / np.outer(size, size)).max())


@pytest.mark.parametrize("seed", soaked([1, 11, 21], [1]))
def test_random_matrices_are_recovered(seed: int, built: Build) -> None:
    """Twice 21 entries from seven forces, without noise to 1e-6; and again where the description has them."""
    stiffness, damping = definite(seed, 2e4), definite(seed + 1, 200.0)
    given = measured(stiffness, damping)
    found = fitted(built, bench(), given, *WHOLE)
    assert not found.warnings
    assert not found.fitted
    assert off_by(found, "stiffness", stiffness) < 1e-6
    assert off_by(found, "damping", damping) < 1e-6
    assert found.matrix("mount").lowest > 0.0
    assert len(found.parameters) == 42
    for key, matrix in (("stiffness", stiffness), ("damping", damping)):
        for one, other in PAIRS:
            estimate = found.matrix("mount", key)[f"{one}.{other}"]
            assert estimate.described == 0.0
            assert found.parameters[f"joints.mount.{key}.{one}.{other}"] == estimate.value
            value = matrix[COORDINATES.index(one), COORDINATES.index(other)]
            assert estimate.value == pytest.approx(value, abs=1e-6 * np.abs(matrix).max())
    again = bench(
        stiffness=JointStiffness.of((1.3 * stiffness).tolist()), damping=found.matrix("mount", "damping").element()
    )
    twice = fitted(built, again, given)  # without being asked
    assert off_by(twice, "stiffness", stiffness) < 1e-6
    assert off_by(twice, "damping", damping) < 1e-6
    assert twice.matrix("mount")["x.beta"].described == pytest.approx(1.3 * stiffness[0, 4])


def test_derivatives_that_are_not_measured_do_little(built: Build) -> None:
    found = fitted(built, bench(), measured(rates=False), *WHOLE)
    assert off_by(found, "stiffness", K) < 1e-6
    assert off_by(found, "damping", D) < 1e-5


@pytest.mark.parametrize(("level", "runs"), [(0.005, 3), pytest.param(0.03, 20, marks=pytest.mark.soak)])
def test_intervals_cover_with_noise(level: float, runs: int, built: Build) -> None:
    """Of 42 entries nine in ten and more, and the lowest eigenvalue within four of its standard errors."""
    inside = []
    for seed in range(runs):
        found = fitted(built, bench(), measured(noise=level, seed=seed, rates=False, fastest=40.0), *WHOLE)
        assert off_by(found, "stiffness", K) < 0.6 * level
        for key, matrix in (("stiffness", K), ("damping", D)):
            size = np.sqrt(np.diag(matrix))
            lowest = np.linalg.eigvalsh(matrix / np.outer(size, size))[0]
            part = found.matrix("mount", key)
            assert abs(part.lowest - lowest) < 5.0 * part.lowest_error
            for one, other in PAIRS:
                estimate = part[f"{one}.{other}"]
                value = matrix[COORDINATES.index(one), COORDINATES.index(other)]
                inside.append(estimate.low <= value <= estimate.high)
    assert 0.9 <= np.mean(inside) < 1.0


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
    tables = {
        name: Coordinate(stiffness=x or None) for name, x in zip(COORDINATES, np.diag(table).tolist(), strict=True)
    }
    robot = replace(robot, joints=(replace(robot.joints[0], coordinates=tables), robot.joints[1]))
    given = measured(own + table, lag * own)
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
        "mount.x",
        "mount.z",
        "mount.alpha",
        "mount.beta",
        "mount.gamma",
    }
    kernel = built(robot, *fitting_kernels(robot))
    known = set(kernel.parameters)
    kernel.parameters.update(
        {name: x for name, x in found.parameters.items() if name in known and ".damping" not in name}
    )


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
    t, q, _, _ = motion(20.0)
    names = (*(f"mount.{name}" for name in COORDINATES), "arm.gamma")
    few = motion_from_columns({"t": t, "mount.x": q[:, 0], "mount.x.drive": K[0, 0] * q[:, 0]}, names)
    (said,) = [x for x in fitted(built, bench(), few, "joints.mount.stiffness.x.*").warnings if "has them" in x]
    assert said.startswith("not fitted, as no measured coordinate with a known drive has them: 'mount.stiffness.x.y'")
    assert "'mount.stiffness.x.x'" not in said


def test_an_indefinite_matrix_is_reported_and_not_cut_off(built: Build) -> None:
    size = np.sqrt(np.diag(K))
    values, vectors = np.linalg.eigh(K / np.outer(size, size))
    values[0] = -0.05
    wrong = (vectors * values) @ vectors.T * np.outer(size, size)
    found = fitted(built, bench(), measured(wrong), *WHOLE)
    part = found.matrix("mount")
    assert off_by(found, "stiffness", np.abs(np.diag(np.diag(wrong))) * 0.0 + wrong) < 1e-6
    scaled = wrong / np.sqrt(np.outer(np.diag(wrong), np.diag(wrong)))
    assert part.lowest == pytest.approx(np.linalg.eigvalsh(scaled)[0], rel=1e-5)
    assert not part.is_definite
    (warning,) = found.warnings
    assert "mount.stiffness is not positive semidefinite" in warning
    assert "which noise does not" in warning
    assert not any(name.startswith("joints.mount.stiffness.") for name in found.parameters)
    assert any(name.startswith("joints.mount.damping.") for name in found.parameters)
    with pytest.raises(InputError, match=r"mount\.stiffness: is not positive semidefinite"):
        part.element()


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
    given = motion_from_columns(columns_of(true, t, samples, rates=True), true.coordinates)
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
    ],
)
def test_wrong_names_are_refused(pattern: str, said: str, built: Build) -> None:
    with pytest.raises(UnknownNameError, match=said):
        fitted(built, bench(), measured(), pattern)


def test_damping_of_another_form_is_not_looked_for(built: Build) -> None:
    for damping, form in ((JointDamping(linear=3.0), "isotropic"), (None, "proportional")):
        ratio = JointDamping(ratio=0.1, at_hz=3.0)
        robot = bench(stiffness=JointStiffness.of(K.tolist()), damping=damping or ratio)
        with pytest.raises(InputError, match=f"the damping of mount is {form}"):
            fitted(built, robot, measured(), "joints.mount.damping")


def test_results_are_kept_and_shown(tmp_path: Path, built: Build, capsys: pytest.CaptureFixture[str]) -> None:
    found = fitted(built, bench(), measured(), "joints.mount.*.x.*")
    assert load_fit(found.save(tmp_path / "fit.json")) == found
    text = str(found)
    assert "mount.stiffness.x.beta" in text
    assert len(found.as_rows().values) == 12 + len([x for x in found.estimates if x.count(".") == 2])
    page = report_of(found)
    assert page.summary == ("10 parameters of 5 coordinates, 12 entries of 2 matrices",)
    t, q, _, _ = motion(20.0)
    names = (*(f"mount.{name}" for name in COORDINATES), "arm.gamma")
    u = rigid_forces(20.0) + np.pad(q[:, :6] @ K, ((0, 0), (0, 1)))
    head = ["t", *names, *(f"{name}.drive" for name in names)]
    np.savetxt(tmp_path / "m.csv", np.column_stack([t, q, u]), delimiter=",", header=",".join(head), comments="")
    rows = "".join(f"{name} = {{}}\n" for name in COORDINATES)
    (tmp_path / "bench.toml").write_text(
        f"""name = "bench"
gravity = [0.0, 0.0, -9.81]
[[links]]
name = "body"
mass = 4.0
com = [0.02, -0.01, 0.05]
inertia = {{ xx = 0.05, yy = 0.04, zz = 0.06, xy = 0.001, xz = 0.002, yz = -0.001 }}
[[links]]
name = "tip"
mass = 1.0
com = [0.1, 0.0, 0.02]
inertia = {{ xx = 0.01, yy = 0.02, zz = 0.02 }}
[[joints]]
name = "mount"
parent = "base"
child = "body"
type = "fixed"
{rows}
[[joints]]
name = "arm"
parent = "body"
child = "tip"
type = "revolute"
""",
        encoding="ascii",
    )
    command = ["fit", str(tmp_path / "bench.toml"), str(tmp_path / "m.csv"), "--matrices", "joints.mount.stiffness"]
    assert cli.main([*command, "--json"]) == 0
    (matrix,) = json.loads(capsys.readouterr().out)["matrices"]
    np.testing.assert_allclose(matrix["matrix"], K, atol=1e-5 * K.max())
