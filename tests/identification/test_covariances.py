"""Covariances of measurement errors: from files, one for all rows or one for each, and what is wrong with them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.cli import entry as cli
from eomgen.errors import ArrayError, InputError
from eomgen.identification import calibrate, load_calibration, read_covariances
from eomgen.identification.geometry.observations import observations_of
from tests.support.measured_poses import Trial, chain, trial

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
COUNT = 40


@cache
def made() -> Trial:
    return trial(chain(4, "RRP", special=True), 3, COUNT)


def mixed(size: int, seed: int = 0) -> Array:
    """A covariance with all its entries."""
    root = np.random.default_rng(seed).normal(size=(size, size))
    scale = np.repeat([5e-5, 1e-4], 3)[:size]
    return scale[:, np.newaxis] * (root @ root.T + np.eye(size)) * scale


def written(path: Path, matrix: Array) -> Path:
    names = [f"tcp.{part}" for part in ("x", "y", "z", "rx", "ry", "rz")[: matrix.shape[-1]]]
    rows = "\n".join(",".join(map(repr, row)) for row in matrix.reshape(-1, matrix.shape[-1]).tolist())
    path.write_text(f"# m^2, m rad, rad^2\n{','.join(names)}\n{rows}\n")
    return path


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("by_row", [False, True])
def test_errors_are_whitened_by_their_covariance(size: int, by_row: bool) -> None:
    """r^T C^-1 r of every row, by matrices of NumPy; rows with a weight; standard deviations are its diagonal."""
    poses = made().poses() if size == 6 else made().poses("rx", "ry", "rz")
    matrices = np.stack([mixed(size, seed) for seed in range(COUNT if by_row else 1)])
    seen = observations_of(poses, None, {"tcp": matrices if by_row else matrices[0]})
    r = np.random.default_rng(1).normal(size=seen.group.size)
    split = 3 * COUNT
    rows = r.reshape(-1, 3) if size == 3 else np.hstack([r[:split].reshape(-1, 3), r[split:].reshape(-1, 3)])
    wanted = sum(row @ np.linalg.solve(C, row) for row, C in zip(rows, np.tile(matrices, (COUNT, 1, 1)), strict=False))
    white = seen.whiten(r, seen.sigma)
    assert white @ white == pytest.approx(wanted, rel=1e-9)
    np.testing.assert_allclose(seen.whiten(np.stack([r, 2.0 * r], axis=1), seen.sigma)[:, 1], 2.0 * white, rtol=1e-12)
    np.testing.assert_allclose(seen.sigma[:3], np.sqrt(np.diag(matrices[0])[:3]))


def test_a_file_says_what_python_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """CSV and NPZ, one matrix and one per row; printed noise is that of the covariance."""
    puma, matrix = trial(eomgen.load_robot("puma560"), 0, COUNT), mixed(6)
    np.savez(tmp_path / "poses.npz", **{name: np.asarray(values) for name, values in puma.columns.items()})
    np.savez(tmp_path / "c.npz", tcp=np.tile(matrix, (COUNT, 1, 1)))
    files = [written(tmp_path / "c.csv", matrix), tmp_path / "c.npz"]
    np.testing.assert_allclose(read_covariances(files[:1])["tcp"], matrix, rtol=1e-15)
    by_row = written(tmp_path / "rows.csv", np.tile(matrix, (COUNT, 1, 1)))
    np.testing.assert_array_equal(read_covariances([by_row])["tcp"], read_covariances(files[1:])["tcp"])
    wanted = calibrate(puma.robot, puma.poses(), covariance={"tcp": matrix}, folds=0)
    assert wanted.noise["tcp.position"] == pytest.approx(np.sqrt(np.diag(matrix)[:3].mean()))
    for file in files:
        words = ["calibrate", "puma560", str(tmp_path / "poses.npz"), "--folds", "0", "--covariance", str(file)]
        assert cli.main([*words, "-o", str(tmp_path / "found.npz")]) == 0
        assert "um, known" in capsys.readouterr().out
        found = load_calibration(tmp_path / "found.npz")
        np.testing.assert_allclose(found.deviations, wanted.deviations, rtol=1e-6, atol=1e-12)


def test_covariances_are_checked(tmp_path: Path) -> None:
    poses = made().poses()
    rows = np.tile(mixed(6), (COUNT, 1, 1))
    rows[7] = -rows[7]
    skew = mixed(6)
    skew[0, 1] *= 1.001
    for value, said in (
        (rows, r"that of tcp \(poses: row 7\) is not symmetric and positive definite"),
        (skew, "that of tcp is not symmetric and positive definite"),
        (rows[:9], r"tcp has shape \(9, 6, 6\); allowed: \(3, 3\), \(40, 3, 3\), \(6, 6\), \(40, 6, 6\)"),
        (np.full((6, 6), np.nan), "not symmetric and positive definite"),
    ):
        with pytest.raises(ArrayError, match=said):
            calibrate(made().robot, poses, covariance={"tcp": value}, folds=0)
    (tmp_path / "few.csv").write_text("tcp.x,tcp.y,tcp.z\n1,0,0\n0,1,0\n")
    (tmp_path / "other.csv").write_text("tcp.x,probe.y,tcp.z\n1,0,0\n")
    np.savez(tmp_path / "text.npz", tcp=np.array("none"))
    good = written(tmp_path / "good.csv", mixed(3))
    for names, said in (
        (["few.csv"], "has 2 lines of 3 numbers; allowed: 3, or 3 for each pose"),
        (["other.csv"], "has the columns .*probe.y.*; allowed: columns F.x F.y F.z"),
        (["text.npz"], "array 'tcp' has dtype <U4; allowed: numbers"),
        ([good.name, good.name], "'tcp' has a covariance already; allowed: one of each frame"),
        (["c.txt"], r"allowed: a path that ends in .csv or .npz"),
        (["none.csv"], "cannot be read"),
    ):
        with pytest.raises(InputError, match=said):
            read_covariances([tmp_path / name for name in names])
