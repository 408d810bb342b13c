"""Pages of benchmarks: required figures, what starts and first builds cost, and a rotor compared with Exudyn's."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import builds, exudyn_peer, rotor
from benchmarks.bars import Bar, conclusion
from benchmarks.builds import Cost, Package
from benchmarks.exudyn_peer import Settings
from benchmarks.peers.contender import MissingPeer
from benchmarks.rotor import Row, Run, bars, distance, ratio, row_lines
from benchmarks.rotor_model import DENSITY, LENGTH, MODES, SHAFT, UNBALANCE, robot
from benchmarks.rotor_model import rotor as made_rotor
from eomgen.bending.checks import rigid_motions
from eomgen.pipeline import KERNEL_NAMES
from eomgen.robot.model import build_model
from tests.support.optional import needs


def test_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The least of all rounds of each, with what Python and compilers spent in that round."""
    walls = iter([3.0, 2.0, 9.0, 1.0, 4.0, 8.0])
    monkeypatch.setattr(builds, "STARTS", {"`import numpy`": ("-c", "pass")})
    monkeypatch.setattr(builds, "build", lambda robot, kernels: Cost(wall := next(walls), wall / 2, wall / 4, 50.0))
    cpu = iter([5.0, 3.0, 4.0])
    monkeypatch.setattr(builds, "PACKAGES", {"one_link": 4.0})
    monkeypatch.setattr(builds, "package", lambda robot: Package(robot, next(cpu), 2.8, 7000, 3000, 280.4, 21.6))
    page = tmp_path / "page.md"
    assert builds.main(["one_link", "--rounds", "3", "--output", str(page)]) == 0
    text = page.read_text(encoding="ascii")
    assert re.search(r"^\| `import numpy` \| 0\.\d\d \|$", text, re.MULTILINE)
    assert "| one_link | forward dynamics, from Python's start | 3.00 | 1.50 | 0.75 | 50 |" in text
    assert "| one_link | all kernels | 1.00 | 0.50 | 0.25 | 50 |" in text
    assert "derivatives of" not in text.split("|", 1)[1]  # of some robots alone
    assert "the least of\n3 rounds in turns" in text
    assert "| one_link | 3.00 (4) | 2.80 (2.67, missed) | 7,000 | 3,000 | 280 | 22 |" in text
    assert "Required figures that are missed: package one_link, clock, s (2.8 of 2.67)." in text
    page.write_text("")
    assert builds.main(["--page", "--output", str(page)]) == 0
    assert page.read_text(encoding="ascii") == text
    monkeypatch.setattr(builds, "package", lambda robot: Package(robot, 2.5, 2.0, 7000, 3000, 280.4, 21.6))
    assert builds.main(["--packages", "--rounds", "1", "--output", str(page)]) == 0
    assert page.read_text(encoding="ascii").startswith(text[: text.index("| one_link | 3.00 (4)")])
    assert "| one_link | 2.50 (4) | 2.00 (2.67) |" in page.read_text(encoding="ascii")


def test_the_committed_page_is_that_of_the_last_run() -> None:
    assert builds.page(builds.read(builds.PAGE.with_suffix(".json"))) == builds.PAGE.read_text(encoding="ascii")


def test_what_is_to_hold_stands_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives are built as often as is said, the rest in all rounds."""
    made: list[str] = []

    def build(robot: str, kernels: str) -> Cost:
        made.append(kernels)
        return Cost(7.0, 2.0, 9.0, 400.0)

    monkeypatch.setattr(builds, "STARTS", {})
    monkeypatch.setattr(builds, "PACKAGES", {})
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


@pytest.mark.soak
def test_a_package_that_imports() -> None:
    made = builds.package("one_link")
    assert made.cpu > 0.1
    assert made.wall > 0.1
    assert made.lines > made.python_lines > 100
    assert 10.0 < made.kilobytes < 300.0
    assert 0.0 < made.import_ms < 5000.0


BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize(
    ("bar", "verdict", "brackets"),
    [
        (Bar("ratio", 9.1, 10.0), "missed", "(10, missed)"),
        (Bar("ratio", 10.0, 10.0), "held", "(10)"),
        (Bar("seconds", 5.1, 5.0, at_most=True), "missed", "(5, missed)"),
        (Bar("seconds", 5.0, 5.0, at_most=True), "held", "(5)"),
        (Bar("ratio", None, 10.0), "not measured", "(10)"),
        (Bar("ratio", float("nan"), 10.0), "missed", "(10, missed)"),
        (Bar("seconds", float("nan"), 5.0, at_most=True), "missed", "(5, missed)"),
    ],
)
def test_verdicts(bar: Bar, verdict: str, brackets: str) -> None:
    assert (bar.verdict, bar.brackets) == (verdict, brackets)


def test_a_missed_bar_is_never_called_held() -> None:
    held, missed, absent = Bar("a", 2.0, 1.0), Bar("b", 18.2, 30.0), Bar("c", None, 3.0)
    assert conclusion([held]) == "All 1 required figures are held."
    assert conclusion([held, missed]) == "Required figures that are missed: b (18.2 of 30)."
    assert conclusion([held, absent]) == "Required and not measured: c."
    assert conclusion([missed, absent]).count(".") == 3


def test_nobody_else_decides() -> None:
    """No other module of benchmarks writes a verdict of its own."""
    for path in BENCHMARKS.rglob("*.py"):
        if path.name == "bars.py":
            continue
        words = {node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)}
        assert not words & {"held", "missed", "MISSED", "not measured"}, path


def test_finite_elements_are_those_of_a_free_body() -> None:
    """No energy in six motions; the mass of prisms whose sections are octagons, and of the unbalance."""
    made = made_rotor()
    n = len(made.nodes)
    R = rigid_motions(made.nodes, np.array([(node, d) for node in range(n) for d in range(3)]))
    assert np.abs(made.K @ R).max() < 1e-9 * np.abs(made.K).max()
    octagon = 2.0 * np.sqrt(2.0)
    shaft = DENSITY * LENGTH * octagon * SHAFT**2
    disc = DENSITY * 0.02 * octagon * (0.2**2 - SHAFT**2)
    assert made.masses.sum() == pytest.approx(shaft + disc + UNBALANCE, rel=1e-9)
    M = np.repeat(made.masses, 3)
    assert made.modes.T @ (M[:, None] * made.modes) == pytest.approx(np.eye(MODES), abs=1e-9)
    assert np.abs(R.T @ (M[:, None] * made.modes)).max() < 1e-6
    assert build_model(robot(made)).size == 6 + MODES


def row(*, ours: bool, seconds: float, error: float) -> Row:
    return Row(Run("x", "1 us", lambda: (np.zeros((1, 3)), 1, 0.0), ours), 10, seconds, error)


def test_ratios_are_those_of_the_fastest_that_is_as_exact() -> None:
    theirs = row(ours=False, seconds=4.0, error=1e-4)
    mine = [row(ours=True, seconds=s, error=e) for s, e in ((0.01, 1e-3), (0.2, 1e-4), (0.1, 1e-5))]
    assert ratio([theirs, *mine], theirs) == pytest.approx(40.0)
    assert ratio([theirs, mine[0]], theirs) is None
    assert [bar.verdict for bar in bars([theirs, *mine])] == ["held", "held"]
    assert [bar.verdict for bar in bars([theirs, mine[0]])] == ["not measured", "not measured"]
    slow = row(ours=False, seconds=1.0, error=1e-4)
    assert [bar.verdict for bar in bars([theirs, slow, *mine])] == ["held", "missed"]
    assert row_lines([theirs, *mine])[0] == "| Exudyn | x | 1 us | 10 | 1.0e-04 | 4e+03 | 40 |"
    assert distance(np.zeros((2, 3)), np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0]])) == 5.0
    assert distance(np.zeros((1, 3)), np.full((1, 3), np.nan)) == np.inf


def test_without_exudyn_it_is_said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def missing() -> str:
        raise MissingPeer("not here")

    monkeypatch.setattr(exudyn_peer, "version", missing)
    monkeypatch.setattr("sys.argv", ["rotor"])
    assert rotor.main() == 0
    assert capsys.readouterr().out == "missing: Exudyn: not here\n"


@pytest.mark.soak
def test_both_move_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over 0.02 s, a revolution: within the step errors of Exudyn's steps of 2 us."""
    needs("exudyn", extra="bench")
    monkeypatch.setattr(rotor, "DURATION", 0.02)
    monkeypatch.setattr(rotor, "SAMPLES", 20)
    made = made_rotor()
    expected = rotor.Ours(made).motion("radau", 1e-9)[0]
    found = exudyn_peer.motion(made, Settings("TrapezoidalIndex2", 10_000), 0.02, 20)[0]
    assert distance(found, expected) < 1e-4 * distance(expected, expected[:1])
