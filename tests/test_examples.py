"""The tutorials run, and say what their texts promise."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


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


def test_your_urdf_made_elastic(capsys: pytest.CaptureFixture[str]) -> None:
    text = said("elastic_urdf.py", capsys)
    own, loaded = numbers(r"sag by ([0-9.]+) um", text)
    (stiffness,) = numbers(r"z: ([0-9.]+) N/um", text)
    assert abs(loaded - own - 20.0 / stiffness) <= 0.02 * (loaded - own)
    assert 30.0 < numbers(r"mode at ([0-9.]+) Hz", text)[0] < 50.0
    assert 1e2 < numbers(r"off by up to ([0-9.]+) um", text)[0] < 1e3
    assert "waist.beta" in text


def test_a_worn_gripper_arm(capsys: pytest.CaptureFixture[str]) -> None:
    text = said("worn_gripper.py", capsys)
    slopes = numbers(r"mrad: +([0-9.]+) N m/rad", text)
    assert slopes == sorted(slopes)
    worn, tight = numbers(r"off by ([0-9]+) um at most", text)
    assert worn > 1.2 * tight
    assert "hits its upper end" in text
    assert "hits its lower end" in text


def test_ten_thousand_arms(capsys: pytest.CaptureFixture[str]) -> None:
    """With few of them; the gripper's mass, which the drives do not know, comes first."""
    text = said("ten_thousand_arms.py", capsys, "24")
    assert "24 samples, 0 failed" in text
    assert "what matters most: links.gripper.mass" in text
    low, high = numbers(r"by ([0-9]+) to", text) + numbers(r"to ([0-9]+) um", text)
    assert low < high
