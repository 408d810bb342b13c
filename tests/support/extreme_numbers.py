"""Measured files with numbers as no instrument gives them: analyses refuse them by name, or print finite numbers.

    python -m tests.support.extreme_numbers KIND FIRST COUNT

prints a line of JSON: how many were accepted.
"""

from __future__ import annotations

import json
import random
import re
import tempfile
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.errors import InputError
from eomgen.identification import calibrate, fit, forces, identify, read_covariances, tolerance
from eomgen.identification.iso_9283.solve import accuracy
from eomgen.runtime.kernel import Kernel
from tests.support.fuzzing import check_message
from tests.support.measured_poses import chain, trial

LARGE = (1e30, 9e29, 1e31, 1e60, 1e150, 1e160, 1e200, 1e300, 1.7e308, np.inf, np.nan)
SMALL = (1e-30, 1e-31, 1e-150, 1e-200, 1e-300, 5e-324, 0.0)
ODD = re.compile(r"(?<![\w.])[+-]?(?:nan|inf)(?![\w.])")
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Case:
    """Columns that are right, and an analysis of a file of them."""

    columns: Columns
    analysed: Callable[[Path], Any]


def check_finite(result: Any) -> None:
    """Raise AssertionError where a result prints numbers that are not finite."""
    odd = [line for line in result.lines() if ODD.search(line)]
    assert not odd, odd
    json.dumps(result.as_dict(), allow_nan=False)


def written(path: Path, columns: Columns) -> Path:
    if path.suffix == ".npz":
        np.savez(path, **{name: np.asarray(values) for name, values in columns.items()})
    else:
        rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
        path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return path


def changed(columns: Columns, chance: random.Random) -> dict[str, np.ndarray]:
    """One number, a whole column, or the scale of one, that is extreme."""
    found = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    values = found[chance.choice(list(found))]
    size = chance.choice((*LARGE, *SMALL)) * chance.choice((1.0, -1.0))
    how = chance.choice(("one", "one", "some", "scale", "all"))
    with np.errstate(all="ignore"):
        if how == "scale":
            values *= size
        elif how == "all":
            values[...] = size
        else:
            values[[chance.randrange(len(values)) for _ in range(1 if how == "one" else 5)]] = size
    return found


def motion_columns() -> dict[str, np.ndarray]:
    t = np.arange(700) * 2e-3
    found = {"t": t}
    for i, waves in enumerate((((3.0, 0.5), (17.0, 0.1)), ((4.0, 0.6), (19.0, 0.1)))):
        name = f"joint{i + 1}.gamma"
        found[name] = sum(size * np.sin(w * t + i) for w, size in waves)
        found[f"{name}.rate"] = sum(size * w * np.cos(w * t + i) for w, size in waves)
        found[f"{name}.drive"] = sum(9.0 * size * np.cos(w * t) for w, size in waves) + 2.0 * np.sign(
            found[f"{name}.rate"]
        )
    return found


def accuracy_columns() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    found = {"pose": np.repeat(np.arange(1.0, 6.0), 30)}
    for axis in ("x", "y", "z", "rx", "ry", "rz"):
        found[f"tcp.{axis}"] = found["pose"] * 0.1 + 1e-4 * rng.normal(size=150)
        found[f"tcp.command.{axis}"] = found["pose"] * 0.1
    return found


def cases(arm: Any, kernels: Mapping[str, Kernel]) -> dict[str, Case]:
    """Analyses by name, of a robot of two joints and its kernels."""
    measured = trial(chain(3, "RRR"), 5, 40)
    poses = dict(measured.columns)
    poses |= {f"tcp.sigma.{axis}": np.full(40, 5e-5) for axis in "xyz"}
    poses |= {f"tcp.sigma.r{axis}": np.full(40, 1e-4) for axis in "xyz"}
    poses |= {"weight": np.ones(40)}
    covariance = {
        f"tcp.{part}": row for part, row in zip(("x", "y", "z", "rx", "ry", "rz"), np.eye(6) * 1e-8, strict=True)
    }
    table = {"joints.joint1.offset.gamma": np.array([1e-4]), "joints.joint2.offset.gamma": np.array([2e-4])}

    def tolerances(path: Path) -> Any:
        with np.load(path) as found:
            given = {name: {"bound": float(values[0])} for name, values in found.items()}
        return tolerance(measured.robot, given, poses=np.zeros((2, 3)))

    return {
        "forces": Case(motion_columns(), lambda path: forces(arm, path, kernel=kernels["forces"])),
        "fit": Case(motion_columns(), lambda path: fit(arm, path, kernel=kernels["fit"])),
        "identify": Case(motion_columns(), lambda path: identify(arm, path, kernel=kernels["identify"])),
        "accuracy": Case(accuracy_columns(), lambda path: accuracy(path)),
        "calibrate": Case(poses, lambda path: calibrate(measured.robot, path)),
        "covariance": Case(
            covariance,
            lambda path: calibrate(measured.robot, measured.poses(), covariance=read_covariances([path])),
        ),
        "tolerance": Case(table, tolerances),
    }


def run(case: Case, first: int, count: int, ending: str = ".csv") -> int:
    """Analyse files of these seeds; give how many were accepted."""
    accepted = 0
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", eomgen.EomgenWarning)
        for seed in range(first, first + count):
            path = written(Path(folder) / f"m{ending}", changed(case.columns, random.Random(f"extreme {seed}")))
            try:
                with np.errstate(all="ignore"):
                    found = case.analysed(path)
                check_finite(found)
                accepted += 1
            except InputError as error:
                check_message(error)
            except Exception as error:
                raise AssertionError(f"seed {seed}") from error
    return accepted
