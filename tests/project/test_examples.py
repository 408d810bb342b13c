"""The tutorials run, and say what their texts promise."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from tests.support.optional import needs

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

EXAMPLES = Path(__file__).parents[2] / "examples"


def said(name: str, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    before = sys.argv
    sys.argv = [name, *arguments]
    try:
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    finally:
        sys.argv = before
    return capsys.readouterr().out


def numbers(pattern: str, text: str) -> list[float]:
    return [float(found) for found in re.findall(pattern, text)]


@pytest.mark.soak
def test_your_urdf_made_elastic(capsys: pytest.CaptureFixture[str]) -> None:
    text = said("elastic_urdf.py", capsys)
    own, loaded = numbers(r"sag by ([0-9.]+) um", text)
    (stiffness,) = numbers(r"z: ([0-9.]+) N/um", text)
    assert abs(loaded - own - 20.0 / stiffness) <= 0.02 * (loaded - own)
    assert 30.0 < numbers(r"mode at ([0-9.]+) Hz", text)[0] < 50.0
    assert 1e2 < numbers(r"off by up to ([0-9.]+) um", text)[0] < 1e3
    assert "waist.beta" in text


@pytest.mark.soak
def test_a_worn_gripper_arm(capsys: pytest.CaptureFixture[str]) -> None:
    text = said("worn_gripper.py", capsys)
    slopes = numbers(r"mrad: +([0-9.]+) N m/rad", text)
    assert slopes == sorted(slopes)
    worn, tight = numbers(r"off by ([0-9]+) um at most", text)
    assert worn > 1.2 * tight
    assert "hits its upper end" in text
    assert "hits its lower end" in text


@pytest.mark.soak
def test_ten_thousand_arms(capsys: pytest.CaptureFixture[str]) -> None:
    """With few of them; the gripper's mass, which the drives do not know, comes first."""
    text = said("ten_thousand_arms.py", capsys, "24")
    assert "24 samples, 0 failed" in text
    assert "what matters most: links.gripper.mass" in text
    low, high = numbers(r"by ([0-9]+) to", text) + numbers(r"to ([0-9]+) um", text)
    assert low < high


@pytest.mark.soak
def test_least_effort(capsys: pytest.CaptureFixture[str]) -> None:
    text = said("least_effort.py", capsys, "20")
    some, best, approximate = numbers(r"effort ([0-9.]+) N", text)
    assert best < 0.9 * some
    assert approximate == pytest.approx(best, rel=1e-2)
    _, exact, limited = numbers(r", ([0-9]+) iterations", text)
    assert exact <= 20 < 100 <= limited  # 8 and 210 when this was written
    assert max(numbers(r"defect ([0-9.e+-]+),", text)) < 1e-8
    assert max(numbers(r"ends: ([0-9.e+-]+) J, [0-9.e+-]+ J;", text) + numbers(r", ([0-9.e+-]+) J;", text)) < 1e-12


def test_the_least_effort_is_that_of_the_kernel() -> None:
    """The optimum's defects, boundaries and effort, computed again from the kernel on NumPy arrays."""
    needs("casadi")
    example = runpy.run_path(str(EXAMPLES / "least_effort.py"))
    robot = robot_from_toml(example["ARM"])
    kernel = eomgen.build(robot, kernels=(*example["kernels_for"]("forward_dynamics"), "energy"))
    problem = example["Collocation"](kernel, 20)
    some = problem.solve(0.0)
    best = problem.solve(problem.effort, some)
    h, n = example["DURATION"] / 20, kernel.n
    for motion in (some, best):
        x = motion.states
        torques = np.zeros((41, n))
        torques[:, [kernel.coordinates.index(name) for name in kernel.motors]] = motion.drives.T
        slopes = np.hstack([x[:, n:], kernel.forward_dynamics(x[:, :n], x[:, n:], torques[::2])])
        middle = (x[:-1] + x[1:]) / 2 + h / 8 * (slopes[:-1] - slopes[1:])
        inner = np.hstack([middle[:, n:], kernel.forward_dynamics(middle[:, :n], middle[:, n:], torques[1::2])])
        defects = x[1:] - x[:-1] - h / 6 * (slopes[:-1] + 4 * inner + slopes[1:])
        assert np.abs(defects / problem.scale).max() < 1e-8
        joints = [kernel.coordinates.index(name) for name in ("shoulder.gamma", "elbow.gamma")]
        for place, angles in ((0, example["START"]), (-1, example["GOAL"])):
            assert np.allclose(x[place, joints], angles, rtol=0.0, atol=1e-8)
            assert np.abs(slopes[place] / problem.scale).max() < 1e-8
        squares = (torques**2).sum(axis=1)
        weights = np.tile([2.0, 4.0], 21)[:41]
        weights[[0, -1]] = 1.0
        assert motion.effort == pytest.approx(h / 6 * weights @ squares, rel=1e-12)
    assert best.effort < 0.9 * some.effort


@pytest.mark.soak
def test_identify_worn_arm(capsys: pytest.CaptureFixture[str]) -> None:
    """All seven numbers are found, by gradients alone."""
    text = said("identify_worn_arm.py", capsys, "3000")
    (found,) = numbers(r"-> ([0-9.]+) \(", text)
    assert 0.4 < found < 0.6
    pairs = re.findall(r"([0-9.]+) of the drawing's, truly ([0-9.]+)", text)
    assert len(pairs) == 7
    assert all(abs(float(ratio) / float(true) - 1.0) < 0.02 for ratio, true in pairs)


@pytest.mark.soak
def test_learned_friction(capsys: pytest.CaptureFixture[str]) -> None:
    text = said("learned_friction.py", capsys)
    before, after = numbers(r"by ([0-9.]+) rad", text), numbers(r"friction, ([0-9.]+) with", text)
    assert len(before) == 2
    assert all(with_it < 0.05 * without for without, with_it in zip(before, after, strict=True))
    pairs = re.findall(r"([+-][0-9.]+) \(([+-][0-9.]+)\)", text)
    assert len(pairs) == 8
    assert all(abs(float(learned) - float(true)) < 0.1 for learned, true in pairs)
