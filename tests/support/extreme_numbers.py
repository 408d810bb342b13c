"""Measured files with numbers as no instrument gives them: analyses refuse them by name, or print finite numbers."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.identification import calibrate, fit, forces, identify, read_covariances, tolerance
from eomgen.identification.dynamics.solve import without_sought
from eomgen.identification.identifiable import TERMS
from eomgen.identification.iso_9283.solve import accuracy
from eomgen.kernel.complete import Kernel
from eomgen.robot.value import Robot
from tests.support.measured_poses import chain, trial
from tests.support.mutations import Chance, change_columns, npz
from tests.support.quick_builds import without_headers

COUNTS = {  # of quick tests, and of the soak
    "forces": (8, 160),
    "fit": (8, 160),
    "identify": (4, 80),
    "accuracy": (10, 200),
    "calibrate": (0, 60),
    "covariance": (3, 60),
    "tolerance": (10, 200),
}
KERNELS = {
    "forces": ("inverse_dynamics", "reactions"),
    "fit": ("inverse_dynamics", "mass_matrix"),
    "identify": ("regressor", "inverse_dynamics"),
}
ODD = re.compile(r"(?<![\w.])[+-]?(?:nan|inf)(?![\w.])")
Columns = Mapping[str, Any]
ARM = """
name = "arm"
gravity = [0, -9.81, 0]
links = [
    { name = "upper", mass = 3, com = [0.1, 0.02, 0.05], inertia = { xx = 0.02, yy = 0.05, zz = 0.06, xy = 0.001 } },
    { name = "fore", mass = 1.5, com = [0.15, -0.03, 0.02], inertia = { xx = 0.01, yy = 0.03, zz = 0.03 } },
]
[[joints]]
name = "joint1"
parent = "base"
child = "upper"
type = "revolute"
gamma = { damping = 0.7, armature = 0.2, friction = { coulomb = 2.0, smoothing = 0.01 } }
[[joints]]
name = "joint2"
parent = "upper"
child = "fore"
type = "revolute"
placement = { xyz = [0.3, 0, 0.05], rpy = [0.4, 0, 0.2] }
gamma = { stiffness = 4, damping = 0.3, armature = 0.05 }
"""


def kernel(robot: Robot, kind: str) -> Kernel:
    """Build what an analysis needs, quickly."""
    with pytest.MonkeyPatch.context() as patch:
        without_headers(patch)
        patch.setenv("CFLAGS", "-O0")
        return eomgen.build(without_sought(robot, TERMS) if kind == "identify" else robot, kernels=KERNELS[kind])


def motion_columns() -> Columns:
    found = {"t": np.arange(700) * 2e-3}
    for i, waves in enumerate((((3.0, 0.5), (17.0, 0.1)), ((4.0, 0.6), (19.0, 0.1)))):
        name, t = f"joint{i + 1}.gamma", found["t"]
        rate = sum(size * w * np.cos(w * t + i) for w, size in waves)
        drive = sum(9.0 * size * np.cos(w * t) for w, size in waves) + 2.0 * np.sign(rate)
        found |= {
            name: sum(size * np.sin(w * t + i) for w, size in waves),
            f"{name}.rate": rate,
            f"{name}.drive": drive,
        }
    return found


def accuracy_columns() -> Columns:
    rng = np.random.default_rng(1)
    found = {"pose": np.repeat(np.arange(1.0, 6.0), 30)}
    for axis in ("x", "y", "z", "rx", "ry", "rz"):
        found[f"tcp.{axis}"] = found["pose"] * 0.1 + 1e-4 * rng.normal(size=150)
        found[f"tcp.command.{axis}"] = found["pose"] * 0.1
    return found


@cache
def analysis(kind: str) -> tuple[Columns, Callable[[Path], Any]]:
    """Return columns that are right, and an analysis of a file of them."""
    if kind == "accuracy":
        return accuracy_columns(), accuracy
    if kind in KERNELS:
        robot, analyse = robot_from_toml(ARM), {"forces": forces, "fit": fit, "identify": identify}[kind]
        built = kernel(robot, kind)
        return motion_columns(), lambda path: analyse(robot, path, kernel=built)  # type: ignore[operator]
    measured = trial(chain(3, "RRR"), 5, 40)
    sizes = {
        f"tcp.sigma.{axis}": np.full(40, 5e-5 if len(axis) == 1 else 1e-4) for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    if kind == "calibrate":
        return {**measured.columns, **sizes, "weight": np.ones(40)}, lambda path: calibrate(measured.robot, path)
    if kind == "covariance":
        matrix = {name.replace("sigma.", ""): row for name, row in zip(sizes, np.eye(6) * 1e-8, strict=True)}
        poses = measured.poses()
        return matrix, lambda path: calibrate(measured.robot, poses, covariance=read_covariances([path]))

    def tolerances(path: Path) -> Any:
        with np.load(path) as found:
            given = {name: {"bound": float(values[0])} for name, values in found.items()}
        return tolerance(measured.robot, given, poses=np.zeros((2, 3)))

    names = (f"joints.joint{k}.offset.gamma" for k in (1, 2))
    return {name: np.array([1e-4 * k]) for k, name in enumerate(names, 1)}, tolerances


def ending_of(kind: str) -> str:
    """Return that of the file of an analysis."""
    return ".npz" if kind == "tolerance" else ".csv"


def packed(columns: Columns, suffix: str) -> bytes:
    """Return the file of columns, .csv or .npz."""
    if suffix == ".npz":
        return npz({name: np.asarray(values) for name, values in columns.items()})
    rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
    return "".join(f"{line}\n" for line in [",".join(columns), *(",".join(map(repr, row)) for row in rows)]).encode()


def written(path: Path, columns: Columns) -> Path:
    path.write_bytes(packed(columns, path.suffix))
    return path


def changed(kind: str, chance: Chance) -> bytes:
    """Return the file of an analysis with some numbers that are extreme, or, one in twenty, as it is."""
    columns = analysis(kind)[0]
    if "t" in columns and chance.random() < 0.3:
        columns = {**columns, "t": 2e-3 * np.cumsum([chance.choice((1.0, 1.2)) for _ in columns["t"]])}
    columns = change_columns(columns, chance) if chance.random() < 0.95 else columns
    return packed(columns, ending_of(kind))


def read(kind: str, path: Path) -> Any:
    """Analyse a file, and check that what is printed is finite."""
    with np.errstate(all="ignore"):
        result = analysis(kind)[1](path)
    odd = [line for line in result.lines() if ODD.search(line)]
    assert not odd, odd
    json.dumps(result.as_dict(), allow_nan=False)
    return result
