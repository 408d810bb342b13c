"""Covariances of what was measured of a frame: read from files, checked, the factors that whiten errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...errors import ArrayError, InputError
from ...files import as_path
from ...identifiers import check_kind
from ...motion.csv_columns import read_csv
from ...motion.measured_numbers import ALLOWED_DIVISOR, checked_numbers, is_divisor
from ...names import listed, show, split_component
from ...npz import read_npz
from ...robot.coordinates import MOTIONS

COVARIANCE_RULE = "columns F.x F.y F.z, or these and F.rx F.ry F.rz, of a frame F, and as many lines as columns"
_SYMMETRIC = 1e-9  # relative: by more than that sides differ


def read_covariances(paths: Iterable[Path | str]) -> dict[str, Array]:
    """Return covariances by frame from files, (c, c) or (R, c, c), m^2, m rad and rad^2.

    A .csv has the matrix of one frame under the names of its components, or one matrix per pose below each other.  A
    .npz has arrays by the names of frames.

    Raises:
        InputError: a file cannot be read, has other columns, or has a frame that another file has.
    """
    several = isinstance(paths, Iterable) and not isinstance(paths, (str, bytes))
    check_kind("paths", paths, several, "a sequence of paths")
    covariances: dict[str, Array] = {}
    for path in [as_path(each, "paths") for each in paths]:
        if path.suffix not in (".csv", ".npz"):
            raise InputError(f"covariance: {show(str(path))}; allowed: a path that ends in .csv or .npz")
        matrices = read_npz(path) if path.suffix == ".npz" else _from_csv(path)
        for frame, matrix in matrices.items():
            if frame in covariances:
                raise InputError(f"{path}: {show(frame)} has a covariance already; allowed: one of each frame")
            covariances[frame] = _numbers(path, frame, matrix)
    return covariances


def _numbers(path: Path, frame: str, matrix: Array) -> Array:
    return checked_numbers(frame, matrix, lambda row: f"{path}: row {row}")


def _from_csv(path: Path) -> Mapping[str, Array]:
    columns, _ = read_csv(path, rule=COVARIANCE_RULE)
    names = list(columns)
    frame = split_component(names[0])[0]
    size = len(names)
    if not frame or names not in ([f"{frame}.{key}" for key in MOTIONS[:many]] for many in (3, 6)):
        raise InputError(f"{path}: has the columns {listed(names)}; allowed: {COVARIANCE_RULE}")
    table = np.stack(list(columns.values()), axis=1)
    if len(table) % size:
        raise InputError(f"{path}: has {len(table)} lines of {size} numbers; allowed: {size}, or {size} for each pose")
    return {frame: table if len(table) == size else table.reshape(-1, size, size)}


def matrices_of(frame: str, value: ArrayLike, rows: int, sizes: Iterable[int]) -> Array:
    """Return covariances of a frame as float64, (c, c), or one for each of the rows of the poses, (rows, c, c).

    Raises:
        ArrayError: they have another shape.
    """
    matrices = np.array(value, dtype=np.float64)
    allowed = [shape for size in sizes for shape in ((size, size), (rows, size, size))]
    if matrices.shape not in allowed:
        shapes = ", ".join(map(str, allowed))
        raise ArrayError(f"covariance: {frame} has shape {matrices.shape}; allowed: {shapes}")
    return matrices


def whitening_factor(of: str, matrix: Array) -> Array:
    """Return the inverse of the Cholesky factor of a covariance, (c, c): it makes errors independent and of size 1.

    Raises:
        ArrayError: the matrix is not finite, symmetric and positive definite; ``of`` says whose it is.
    """
    variances = np.diag(matrix)
    if not is_divisor(variances).all():
        worst = float(variances[~is_divisor(variances)][0])
        raise ArrayError(
            f"covariance: that of {of} is not symmetric and positive definite: {worst:g} on its diagonal; allowed:"
            f" {ALLOWED_DIVISOR}"
        )
    scale = np.sqrt(np.outer(variances, variances))
    try:
        if not (np.isfinite(matrix).all() and (np.abs(matrix - matrix.T) <= _SYMMETRIC * scale).all()):
            raise np.linalg.LinAlgError
        return np.asarray(np.linalg.inv(np.linalg.cholesky(matrix)))
    except np.linalg.LinAlgError:
        raise ArrayError(f"covariance: that of {of} is not symmetric and positive definite; allowed: one") from None
