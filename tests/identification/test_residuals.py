"""Intervals of calibrations cover; residuals show outlying rows, correlated errors, drift, patterns along joints."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.errors import InputError
from eomgen.identification import CalibrationResult, calibrate, load_calibration
from eomgen.identification.calibration import diagnosing
from eomgen.identification.calibration.serial import correlated, serial_of
from eomgen.identification.geometry.error_model import DRIVE, ErrorParameter
from eomgen.identification.geometry.observations import observations_of
from eomgen.identification.geometry.rotations import vectors_of
from eomgen.motion.turns import rotation_of
from eomgen.robot.model import build_model
from tests.support.measured_poses import Trial, chain, trial, write_csv
from tests.support.measurements import calibrated, placed, poses_of
from tests.support.refusals import refused
from tests.support.soak import WHOLE

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]

NOISE = (5e-5, 1e-4)
KINDS = ("RRRRRR", "RRRRR", "RRPRRR", "PRRRRR", "RPRRRRR")


def inside(seed: int, is_known: bool) -> tuple[Array, Array]:
    """Whether intervals cover: of six components of ten poses elsewhere, and of parameters in the fit's gauge."""
    rng = np.random.default_rng(seed)
    robot = chain(rng, KINDS[seed % len(KINDS)])
    count = int(rng.integers(25, 60))
    made, clean = (trial(robot, seed, count, noise=noise) for noise in (NOISE, (0.0, 0.0)))
    found = calibrate(robot, made.poses(), noise=NOISE if is_known else None, folds=0)
    noise = (found.noise["tcp.position"], found.noise["tcp.orientation"])
    exact = calibrate(robot, with_truth(clean, made).poses(), noise=noise, folds=0)
    half = found.quantile * found.deviations
    shown = half > 1e-9 * np.abs(half).max()
    return elsewhere(found, made, seed), np.abs(found.values - exact.values)[shown] <= half[shown]


def with_truth(clean: Trial, made: Trial) -> Trial:
    """The poses of ``made`` without noise: those of ``clean``, which has the same true values."""
    at, tool = made.model.at(made.truth, made.rows).located, made.model.chain.tools["tcp"]
    return Trial(clean.robot, made.columns | placed(at.p[tool], at.R[tool]), made.model, made.rows, made.truth)


def elsewhere(found: CalibrationResult, made: Trial, seed: int) -> Array:
    """Whether intervals cover components of poses that were not measured, (10, 6)."""
    other = trial(made.robot, seed + 10_000, 10, noise=(0.0, 0.0))
    state = made.model.at(made.truth, other.rows)
    tool = made.model.chain.tools["tcp"]
    q = np.stack([other.columns[name] for name in build_model(made.robot).coordinates], axis=1)
    poses, covariance = found.predict(q, "tcp", series=0)
    turn = vectors_of(state.located.R[tool] @ poses[:, :3, :3].transpose(0, 2, 1))
    off = np.hstack([state.located.p[tool] - poses[:, :3, 3], turn])
    return np.abs(off) <= found.quantile * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


@pytest.mark.soak
@pytest.mark.parametrize("is_known", [False, pytest.param(True, marks=pytest.mark.soak)])
@pytest.mark.parametrize(
    ("arms", "about"),
    [(12, 0.06), pytest.param(1000 if WHOLE else 150, 0.02, marks=pytest.mark.soak)],
    ids=["some", "many"],
)
def test_intervals_cover(arms: int, about: float, is_known: bool) -> None:
    """95 % of them, with the noise known (normal) and estimated (Student's t)."""
    found = [inside(seed, is_known) for seed in range(arms)]
    for part in (0, 1):
        covered = np.concatenate([np.ravel(entry[part]) for entry in found])
        assert covered.mean() == pytest.approx(0.95, abs=about)


def test_the_trial_sees_intervals_that_are_too_small() -> None:
    """Half the noise that there is covers far less."""
    made = trial(chain(1, "RRRRR"), 1, 40, noise=NOISE)
    found = calibrate(made.robot, made.poses(), noise=(2e-5, 4e-5), folds=0)
    assert elsewhere(found, made, 1).mean() < 0.85


def changed(made: Trial, rows: object, off: float) -> dict[str, Array]:
    """Columns of a trial whose tool is off along x in these rows."""
    columns = made.columns | {"tcp.x": made.columns["tcp.x"].copy()}
    columns["tcp.x"][rows] += off
    return columns


def first_order(rng: np.random.Generator, rho: float, shape: tuple[int, int]) -> Array:
    """Numbers of variance 1 whose neighbours have a correlation of rho."""
    fresh = rng.normal(size=shape)
    found = fresh.copy()
    for i in range(1, len(fresh)):
        found[i] = rho * found[i - 1] + np.sqrt(1.0 - rho**2) * fresh[i]
    return found


def going_on(seed: int, rho: float) -> Trial:
    """Poses of a random arm whose errors go on from row to row."""
    rng = np.random.default_rng(seed)
    robot, count = chain(rng, KINDS[seed % len(KINDS)]), int(rng.integers(25, 60))
    made = trial(robot, seed, count, noise=(0.0, 0.0))
    tool = made.model.chain.tools["tcp"]
    at = made.model.at(made.truth, made.rows).located
    p = at.p[tool] + NOISE[0] * first_order(rng, rho, (count, 3))
    R = rotation_of(NOISE[1] * first_order(rng, rho, (count, 3))) @ at.R[tool]
    return Trial(robot, made.columns | placed(p, R), made.model, made.rows, made.truth)


# Rows that are off


def test_a_row_that_is_off_is_named_by_row_and_line(tmp_path: Path) -> None:
    """One row 1,000 standard deviations off, of a blind arm, without a loss; it spoils no other row's name."""
    for seed in range(3):
        made = trial(chain(seed, "RRRRR"), seed, 50)
        write_csv(tmp_path / "poses.csv", changed(made, 17, 1e3 * NOISE[0]))
        found = calibrate(made.robot, tmp_path / "poses.csv", folds=0)
        assert [row for row, _ in found.diagnosis.outlying] == [17]
        assert found.diagnosis.outlying[0][1] == pytest.approx(1000.0, rel=0.4)
        assert any("row 17 (line 20) by" in note for note in found.notes)
    made = trial(chain(1, "RRRRR"), 1, 50)
    assert not calibrate(made.robot, made.poses(), folds=0).diagnosis.outlying


def test_round_off_of_exact_numbers_is_no_outlier(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most residuals are 0, one is not; one that is off is named with a size that is a number."""
    caught, look = [], diagnosing.outlying_rows
    monkeypatch.setattr(diagnosing, "outlying_rows", lambda *given: caught.append(given) or look(*given))
    made = trial(chain(1, "RRRRR"), 1, 50)
    calibrate(made.robot, made.poses(), noise=NOISE, folds=0)
    problem, fit = caught[0]
    for off, rows in ((1e-16, ()), (1e-3, (int(problem.seen.row[0]),))):
        residuals = np.zeros_like(fit.residuals)
        residuals[0] = off
        named = look(problem, replace(fit, residuals=residuals))
        assert tuple(row for row, _ in named) == rows
        assert np.isfinite([size for _, size in named]).all()


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
@pytest.mark.parametrize("off", [pytest.param(1, marks=pytest.mark.soak), 5])
def test_robust_noise_is_that_of_the_others(loss: str, off: int) -> None:
    """Of 50 rows some are 1,000 standard deviations off: the noise is that of the rest."""
    made = trial(chain(2, "RRRRR"), 2, 50)
    found = calibrated(made.robot, changed(made, slice(10, 10 + 3 * off, 3), 1e3 * NOISE[0]), loss=loss)
    assert found.noise["tcp.position"] == pytest.approx(NOISE[0], rel=0.2)
    assert found.noise["tcp.orientation"] == pytest.approx(NOISE[1], rel=0.2)


# Errors that go on


def test_matrices_of_going_on_are_the_dense_ones() -> None:
    """R X, what the fit takes away and what widens deviations, with rows that were not measured and two series."""
    made = trial(chain(3, "RR"), 1, 14)
    columns = {name: values.copy() for name, values in made.columns.items()}
    for part in ("x", "y", "z"):
        columns[f"tcp.{part}"][[4, 9]] = np.nan
    columns["series"] = np.repeat([0.0, 1.0], 7)
    poses = poses_of(made.robot, columns)
    seen = observations_of(poses, (1e-4, 1e-4), {})
    axis = np.concatenate([np.tile(np.arange(block.width), block.rows.size) for block in seen.blocks])
    key = np.stack([seen.group, axis, poses.series[seen.row]])
    same = (key[:, :, np.newaxis] == key[:, np.newaxis]).all(axis=0)
    distance = np.abs(seen.row[:, np.newaxis] - seen.row).astype(float)
    rng = np.random.default_rng(0)
    U = np.linalg.qr(rng.normal(size=(len(axis), 5)))[0]
    R = np.where(same, 0.7**distance, 0.0)
    factor = np.linalg.cholesky(R)
    white = factor @ rng.normal(size=len(axis))
    found = serial_of(seen, poses.series, white - U @ (U.T @ white), U)
    R = np.where(same, found.rho**distance, 0.0)
    X = rng.normal(size=(len(axis), 3))
    np.testing.assert_allclose(correlated(found.steps, found.rho, X), R @ X, atol=1e-12)
    A = np.eye(len(axis)) - U @ U.T
    assert found.freedoms == pytest.approx(np.trace(A @ R) ** 2 / np.trace(A @ R @ A @ R), rel=1e-9)
    assert found.scale == pytest.approx((len(axis) - 5) / np.trace(A @ R), rel=1e-9)
    L = np.where(same & (distance == 1.0), 0.5, 0.0)
    left = A @ white
    assert np.trace(L @ A @ R @ A) / np.trace(A @ R @ A) == pytest.approx((left @ L @ left) / (left @ left), abs=2e-3)
    C = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(found.widened(C, X, estimated=False), C @ X.T @ R @ X @ C, atol=1e-12)


@pytest.mark.parametrize(
    ("arms", "about"),
    [(6, 0.04), pytest.param(300 if WHOLE else 80, 0.02, marks=pytest.mark.soak)],
    ids=["some", "many"],
)
def test_intervals_cover_where_errors_go_on(arms: int, about: float) -> None:
    """At a correlation of 0.8 intervals cover 95 %, of poses elsewhere and of parameters; they were 80 %."""
    covered, correlations, parameters = list[float](), list[float](), list[float]()
    for seed in range(arms):
        made = going_on(seed, 0.8)
        found = calibrate(made.robot, made.poses(), folds=0)
        noise = (found.noise["tcp.position"], found.noise["tcp.orientation"])
        exact = calibrate(made.robot, with_truth(made, made).poses(), noise=noise, folds=0)
        half = found.quantile * found.deviations
        shown = half > 1e-9 * np.abs(half).max()
        parameters.append(float(np.mean(np.abs(found.values - exact.values)[shown] <= half[shown])))
        covered.append(float(elsewhere(found, made, seed).mean()))
        correlations.append(found.diagnosis.correlation)
        assert any("errors go on from row to row" in note for note in found.notes)
        assert found.diagnosis.widened > 1.0
    assert np.mean(covered) == pytest.approx(0.95, abs=about)
    assert np.mean(parameters) == pytest.approx(0.96, abs=about)
    assert np.mean(correlations) == pytest.approx(0.8, abs=0.1)


def test_independent_errors_do_not_go_on() -> None:
    for seed in range(3):
        made = going_on(seed, 0.0)
        found = calibrate(made.robot, made.poses(), folds=0)
        assert found.diagnosis.correlation == 0.0
        assert not found.diagnosis.patterns
        assert not any("go on" in note or "drift" in note for note in found.notes)


# Drift and patterns


def test_a_drift_over_time_is_said_with_its_size() -> None:
    made = trial(chain(5, "RRRRR"), 5, 60)
    found = calibrated(made.robot, made.columns | {"tcp.y": made.columns["tcp.y"] + np.linspace(0.0, 4e-4, 60)})
    drift = found.diagnosis.patterns[0]
    assert drift.name == "drift"
    assert drift.size == pytest.approx(4e-4, rel=0.4)
    said = "residuals drift over time: as if the base or the device moved by"
    assert any(note.startswith(said) for note in found.notes)


@pytest.mark.parametrize(
    ("key", "factor"),
    [
        ("backlash", "backlash"),
        pytest.param("eccentricity.sin", "sin", marks=pytest.mark.soak),
        pytest.param("harmonic2.cos", "cos2", marks=pytest.mark.soak),
        ("gain", "gain"),
    ],
)
def test_a_pattern_along_a_joint_is_named(key: str, factor: str) -> None:
    """Blind arms with one error of a drive, by default; --drives fits what was named."""
    more = [ErrorParameter(f"joints.joint2.{key}", DRIVE, 2, 5, factor, 0.0, 5e-4)]
    made = trial(chain(6, "RRRRR"), 6, 60, more=more)
    found = calibrate(made.robot, made.poses(), folds=0)
    name = f"joints.joint2.{key.partition('.')[0]}"
    assert [pattern.name for pattern in found.diagnosis.patterns] == [name]
    assert found.diagnosis.patterns[0].size == pytest.approx(5e-4, rel=0.1)
    assert any(note.startswith(f"residuals show {name}, about ") for note in found.notes)
    fitted = calibrate(made.robot, made.poses(), folds=0, drives=True)
    assert not fitted.diagnosis.patterns
    assert fitted[f"joints.joint2.{key}"] == pytest.approx(5e-4, abs=4.0 * float(fitted.deviations[-1]) + 2e-5)


# Nothing to check


def test_as_many_numbers_as_unknowns_check_nothing(tmp_path: Path) -> None:
    """Five poses of six joints that turn: thirty numbers for thirty unknowns."""
    made = trial(chain(7, "RRRRRR"), 7, 40)
    columns = {name: values[:5] for name, values in made.columns.items()}
    found = calibrated(made.robot, columns)
    assert not found.diagnosis.is_checked
    assert any(note.startswith("nothing can be checked: 30 numbers of 5 rows for 30 unknowns") for note in found.notes)
    assert np.isnan(found.deviations).all()
    assert any("unknown" in line for line in found.lines())
    q = np.stack([columns[name] for name in build_model(made.robot).coordinates], axis=1)
    assert np.isnan(found.predict(q, "tcp")[1]).all()
    assert set(found.as_dict()["deviations"]) == {None}
    assert np.isnan(load_calibration(found.save(tmp_path / "found.npz")).deviations).all()
    known = calibrated(made.robot, columns, noise=NOISE)
    assert np.isfinite(known.deviations).all()
    assert any(note.startswith("nothing can be checked") for note in known.notes)


def test_a_loss_may_leave_no_number_any_weight() -> None:
    """Known noise that is far too small, and a loss that drops what is far off: nothing is left to correlate."""
    made = trial(chain(4, "RR"), 3, 30)
    columns = {name: made.columns[name] for name in ("joint1.gamma", "joint2.gamma", "tcp.x", "tcp.y", "tcp.z")}
    columns["tcp.x"] = np.zeros(30)
    found = calibrated(made.robot, columns, noise=(1e-4, 1e-4), loss="tukey")
    assert [weight for _, weight in found.mistrusted] == [0.0] * 30
    assert found.diagnosis.correlation == 0.0


# Files


def test_a_diagnosis_is_saved(tmp_path: Path) -> None:
    made = going_on(1, 0.8)
    found = calibrated(made.robot, changed(made, 3, 0.01))
    path = found.save(tmp_path / "found.npz")
    assert load_calibration(path).diagnosis == found.diagnosis
    assert json.loads(json.dumps(found.as_dict()))["diagnosis"]["outlying"][0]["row"] == 3
    arrays = dict(np.load(path))
    for wrong in ({}, {**found.as_dict()["diagnosis"], "outlying": [3]}, [], {"correlation": "x"}):
        meta = json.loads(str(arrays["meta"])) | {"diagnosis": wrong}
        np.savez(path, **{**arrays, "meta": np.array(json.dumps(meta))})
        refused(InputError, "diagnosis", load_calibration, path)
