"""Names of coordinates, motions and forces: their order, their units, and their places in arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .value import LINEAR, MOTOR

UNITS = {"x": "m", "y": "m", "z": "m", "alpha": "rad", "beta": "rad", "gamma": "rad", MOTOR: "rad"}
MOTIONS = ("x", "y", "z", "rx", "ry", "rz")  # of a frame: displacement (m) and rotation vector (rad)
FORCES = ("fx", "fy", "fz", "mx", "my", "mz")  # of a wrench: force (N) and moment (N m)


def unit_of(coordinate: str) -> str:
    """Unit of a coordinate by its name, "m" or "rad"."""
    return "m" if coordinate.rpartition(".")[2] in LINEAR else "rad"


def index_of(names: Sequence[str], wanted: Sequence[str]) -> NDArray[np.intp]:
    """Where the wanted coordinates are among the names."""
    return np.array([names.index(name) for name in wanted], dtype=np.intp)
