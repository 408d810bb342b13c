"""The page of what starts and first builds cost."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks import builds
from benchmarks.builds import Cost
from eomgen.pipeline import KERNEL_NAMES


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
    assert "derivatives of" not in text.split("|", 1)[1]  # of some robots alone
    assert "the least of\n3 rounds in turns" in text
    page.write_text("")
    assert builds.main(["--page", "--output", str(page)]) == 0
    assert page.read_text(encoding="ascii") == text


def test_the_committed_page_is_that_of_the_last_run() -> None:
    assert builds.page(builds.read(builds.PAGE.with_suffix(".json"))) == builds.PAGE.read_text(encoding="ascii")


def test_what_is_to_hold_stands_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives are built as often as is said, the rest in all rounds."""
    made: list[str] = []

    def build(robot: str, kernels: str) -> Cost:
        made.append(kernels)
        return Cost(7.0, 2.0, 9.0, 400.0)

    monkeypatch.setattr(builds, "STARTS", {})
    monkeypatch.setattr(builds, "build", build)
    text = builds.page(builds.measure(["ur5"], 3, 1))
    assert "| ur5 | derivatives of the dynamics | 7.00 (5, missed) | 2.00 | 9.00 | 400 (2000) |" in text
    assert "| ur5 | derivatives of all kernels | 7.00 (5, missed) | 2.00 | 9.00 | 400 (2000) |" in text
    assert "Required figures that are missed: ur5, derivatives of the dynamics, s (7.0 of 5); ur5" in text
    assert [made.count(builds.BUILDS[what]) for what in builds.BUILDS] == [3, 3, 1, 1]
    assert set(builds.MEASURED) <= set(KERNEL_NAMES)


@pytest.mark.soak
def test_a_build_in_a_process_of_its_own() -> None:
    cost = builds.build("one_link", "")
    assert cost.wall > cost.python > 0.0
    assert cost.compilers > 0.0
    assert cost.memory > 1.0
