"""The page of what starts and first builds cost."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks import builds
from benchmarks.builds import Cost


def test_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The least of all rounds of each, with what Python and compilers spent in that round."""
    walls = iter([3.0, 2.0, 9.0, 1.0, 4.0, 8.0])
    monkeypatch.setattr(builds, "STARTS", {"`import numpy`": ("-c", "pass")})
    monkeypatch.setattr(builds, "build", lambda robot, kernels: Cost(wall := next(walls), wall / 2, wall / 4, 50.0))
    page = tmp_path / "page.md"
    assert builds.main(["one_link", "--rounds", "3", "--output", str(page)]) == 0
    text = page.read_text(encoding="ascii")
    assert re.search(r"^\| `import numpy` \| 0\.\d\d \|$", text, re.MULTILINE)
    assert "| one_link | forward dynamics, from Python's start | 3.00 | 1.50 | 0.75 | 50 |" in text
    assert "| one_link | all kernels | 1.00 | 0.50 | 0.25 | 50 |" in text
    assert "the least of\n3 rounds in turns" in text


def test_a_build_in_a_process_of_its_own() -> None:
    cost = builds.build("one_link", "")
    assert cost.wall > cost.python > 0.0
    assert cost.compilers > 0.0
    assert cost.memory > 1.0
