"""Poses and Jacobians by the C library: an arm written by hand, whose kinematics is known."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.soak import soaked

from .test_library import HERE, LIBRARY, WARNINGS

UPPER, FOREARM = 0.8, 0.5  # m
STATES = np.array([[0.0, 0.0, 0.0], [0.7, 0.2, -1.1], [-2.9, -0.1, 0.4]])  # rad, m, rad
Array = NDArray[np.float64]


def answers(states: Array, folder: Path, *flags: str) -> Array:
    """What the program says of all frames and states, (3, states, 17 + 6 n)."""
    program = folder / "arm"
    command = ["gcc", *WARNINGS, "-O0", "-ffp-contract=off", "-fsanitize=address,undefined", *flags]
    subprocess.run([*command, f"-I{LIBRARY}", str(HERE / "arm.c"), "-lm", "-o", str(program)], check=True)
    words = [str(program), str(UPPER), str(FOREARM), *map(repr, states.ravel().tolist())]
    text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return np.array(text.split(), dtype=np.float64).reshape(3, len(states), -1)


def expected(q: Array, frame: int) -> tuple[Array, Array]:
    """Pose, (4, 4), and Jacobian, (6, 3), of a frame: of the base, at the upper link's end, at the forearm's."""
    angle, reach = (0.0, q[0], q[0] + q[2])[frame], (0.0, UPPER, UPPER + q[1])[frame]
    along, across = np.array([np.cos(q[0]), np.sin(q[0])]), np.array([-np.sin(q[0]), np.cos(q[0])])
    tip = np.array([np.cos(angle), np.sin(angle)]) * (FOREARM if frame == 2 else 0.0)
    tip_across = np.array([-tip[1], tip[0]])
    pose, jacobian = np.eye(4), np.zeros((6, 3))
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:2, 3] = reach * along + tip
    if frame >= 1:
        jacobian[:2, 0], jacobian[5, 0] = reach * across + tip_across, 1.0
    if frame == 2:
        jacobian[:2, 1], jacobian[:2, 2], jacobian[5, 2] = along, tip_across, 1.0
    return pose, jacobian


@pytest.mark.parametrize("vector", soaked(["0", "16", "32"], ["0", "32"]))
def test_an_arm_written_by_hand(vector: str, tmp_path: Path) -> None:
    """Poses and Jacobians of all frames, with rotations and a translation, by lanes to the bit."""
    flags = (f"-DEOMGEN_VECTOR={vector}", *(("-mavx",) if vector == "32" else ()))
    for frame, rows in enumerate(answers(STATES, tmp_path, *flags)):
        for q, row in zip(STATES, rows, strict=True):
            pose, jacobian = expected(q, frame)
            assert row[:16].reshape(4, 4) == pytest.approx(pose, abs=1e-15)
            assert row[16:-1].reshape(6, 3) == pytest.approx(jacobian, abs=1e-15)
            assert row[-1] == 1.0


@pytest.mark.soak
def test_axes_of_one_coordinate_add_up(tmp_path: Path) -> None:
    """A forearm that turns with the upper link: the columns of both axes are one."""
    states = STATES[:, :2]
    for frame, rows in enumerate(answers(states, tmp_path, "-DFOLLOWS")):
        for q, row in zip(states, rows, strict=True):
            pose, jacobian = expected(np.append(q, q[0]), frame)
            assert row[:16].reshape(4, 4) == pytest.approx(pose, abs=1e-15)
            together = np.stack([jacobian[:, 0] + jacobian[:, 2], jacobian[:, 1]], axis=1)
            assert row[16:-1].reshape(6, 2) == pytest.approx(together, abs=1e-15)
            assert row[-1] == 1.0
