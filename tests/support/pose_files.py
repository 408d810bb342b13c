"""Measured files of poses and paths, and values with figures known by hand: for tests of ISO 9283."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eomgen.identification.iso_9283.attained import Measured, Pose
from eomgen.identification.iso_9283.attained import Path as Way

Array = NDArray[np.float64]
MM = 1e-3

# Four cycles whose barycentre is 3 mm off (1, 2, 2): distances 3, 3, 4, 4 mm, so l-bar = 3.5 mm, S_l = sqrt(1 / 3) mm
CROSS = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, -4.0, 0.0]])
OFFSET = np.array([1.0, 2.0, 2.0])


def write(path: Path, columns: Mapping[str, object]) -> Path:
    """A measured file of columns, .csv or .npz by its suffix."""
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    if path.suffix == ".npz":
        np.savez(path, **arrays)  # type: ignore[arg-type]
        return path
    rows = [",".join(f"{x:.17g}" for x in row) for row in np.stack(list(arrays.values()), axis=1)]
    path.write_text("\n".join([",".join(arrays), *rows]) + "\n", encoding="ascii")
    return path


def at(position: Array, owner: str = "tool", kinds: str = "x y z") -> dict[str, Array]:
    """Columns of positions, or of whatever three numbers."""
    return {f"{owner}.{kind}": column for kind, column in zip(kinds.split(), np.asarray(position).T, strict=True)}


def turned(vectors: Array, owner: str = "tool") -> dict[str, Array]:
    """Columns of rotation vectors."""
    return at(vectors, owner, "rx ry rz")


def measured(poses: Sequence[Pose] = (), paths: Sequence[Way] = ()) -> Measured:
    """Poses and paths as if they were read from a file."""
    return Measured("measured", "", "tool", "", "", tuple(poses), tuple(paths), exact=False, notes=())


def line(size: int = 11) -> Array:
    """Points of a straight line of 1 m along x."""
    return np.linspace(0.0, 1.0, size)[:, np.newaxis] * [1.0, 0.0, 0.0]


# One pose, commanded twice and attained twice
GOOD = {"pose": [1, 1], **at(np.zeros((2, 3))), **at(np.zeros((2, 3)), "tool.command")}
