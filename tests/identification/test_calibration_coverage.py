"""Intervals of calibrations cover what they say, over many synthetic arms: poses elsewhere, and parameters."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.identification import CalibrationResult, calibrate, poses_from_columns
from eomgen.identification.geometry.rotations import vectors_of
from eomgen.robot.model import build_model
from tests.support.measured_poses import Trial, chain, trial
from tests.support.soak import WHOLE

pytestmark = pytest.mark.usefixtures("unoptimised")

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
    state = made.model.at(made.truth, made.rows)
    tool = made.model.chain.tools["tcp"]
    columns = {name: made.columns[name] for name in build_model(made.robot).coordinates}
    columns |= {f"tcp.{axis}": x for axis, x in zip("xyz", state.located.p[tool].T, strict=True)}
    columns |= {f"tcp.r{axis}": x for axis, x in zip("xyz", vectors_of(state.located.R[tool]).T, strict=True)}
    return Trial(clean.robot, columns, made.model, made.rows, made.truth)


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
    names = build_model(made.robot).coordinates
    poses = poses_from_columns(made.columns, names, ["tcp"])
    found = calibrate(made.robot, poses, noise=(2e-5, 4e-5), folds=0)
    assert elsewhere(found, made, 1).mean() < 0.85
