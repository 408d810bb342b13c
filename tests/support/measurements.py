"""Measured motions and poses made from arrays, and calibrations by them: for tests of identification."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eomgen.identification import CalibrationResult, MeasuredPoses, calibrate, poses_from_columns
from eomgen.identification.calibration.solve import Task, links_of
from eomgen.identification.geometry.error_model import SIZES
from eomgen.identification.geometry.rotations import vectors_of
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot

Array = NDArray[np.float64]


def columns_of(
    names: Sequence[str],
    t: Array,
    q: ArrayLike,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    u: ArrayLike | None = None,
) -> dict[str, Array]:
    """Return columns of a motion, whose arrays are (T, n); drives that are always 0 are left out."""
    found = {"t": t}
    for suffix, values in (("", q), (".rate", v), (".acceleration", a), (".drive", u)):
        if values is not None:
            columns = zip(names, np.asarray(values).T, strict=True)
            found |= {f"{name}{suffix}": x for name, x in columns if suffix != ".drive" or x.any()}
    return found


def motion_of(names: Sequence[str], *arrays: Any, **more: Any) -> MeasuredMotion:
    """Return the motion of these columns."""
    return motion_from_columns(columns_of(names, *arrays, **more), names)


def placed(p: Array, R: Array | None = None, frame: str = "tcp") -> dict[str, Array]:
    """Return columns of positions and, as rotation vectors, orientations of a frame."""
    found = {f"{frame}.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
    turns = () if R is None else zip("xyz", vectors_of(R).T, strict=True)
    return found | {f"{frame}.r{axis}": x for axis, x in turns}


def poses_of(robot: Robot, columns: dict[str, Array], *frames: str, **options: Any) -> MeasuredPoses:
    """Return measured poses of frames of a robot, by default of its tcp."""
    return poses_from_columns(columns, build_model(robot).coordinates, list(frames or ("tcp",)), **options)


def calibrated(robot: Robot, columns: dict[str, Array], **options: Any) -> CalibrationResult:
    """Return the calibration by poses of the tcp, without held-out rows where nothing else is asked for."""
    return calibrate(robot, poses_of(robot, columns), **{"folds": 0, **options})


def task_of(robot: Robot, **options: Any) -> Task:
    """The task of calibrating a robot by frames that it has."""
    known = dict.fromkeys(build_model(robot).frames, True)
    whole = {"noise": None, "covariance": {}, "loss": None, "fixed": (), "stiffness": (), "sizes": SIZES, **options}
    return Task(robot=robot, links=links_of(robot, {}), known=known, **whole)


def assert_slopes(
    S: Array, function: Callable[[Array], Array], x: Array, steps: ArrayLike, rel: float, floor: float = 0.0
) -> None:
    """Assert that the last axis of S has the derivatives of a function, by central differences of these steps.

    They may be off by ``rel`` of the largest derivative by the same number, and by ``floor``.
    """
    for i, h in enumerate(np.broadcast_to(steps, x.shape)):
        step = h * np.eye(len(x))[i]
        slope = (function(x + step) - function(x - step)) / (2.0 * h)
        np.testing.assert_allclose(S[..., i], slope, atol=rel * np.abs(slope).max() + floor, err_msg=str(i))
