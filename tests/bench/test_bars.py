"""Bars of benchmarks: one function decides, and every page that has bars says which are missed."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import builds, closed, precision_page
from benchmarks.bars import bracket, is_held, verdict
from benchmarks.builds import Cost
from benchmarks.peers import page as peers_page
from benchmarks.peers import report as peers_report
from benchmarks.precision_cases import OURS
from benchmarks.precision_report import Found, Report, read

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CELL = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?) \((\d+(?:\.\d+)?)(, missed)?\)")


def test_who_decides() -> None:
    assert is_held(10.0, 10.0)
    assert not is_held(9.99, 10.0)
    assert not is_held(float("nan"), 10.0)
    assert not is_held(float("nan"), 10.0, at_most=True)
    assert is_held(10.0, 10.0, at_most=True)
    assert not is_held(10.01, 10.0, at_most=True)
    assert is_held(None, 10.0) is None
    assert [verdict(x, 2.0) for x in (3.0, 1.0, None)] == ["held", "missed", "not measured"]
    assert [bracket(x, 2.0) for x in (3.0, 1.0, None)] == [" (2)", " (2, missed)", " (2)"]
    assert bracket(3.0, 2.0, at_most=True) == " (2, missed)"
    assert bracket(1.0, None) == ""


def slower(report: Report, contenders: tuple[str, ...], factor: float) -> Report:
    """The report with other times of some."""

    def changed(found: Found) -> Found:
        points = [replace(p, seconds=p.seconds * (factor if p.contender in contenders else 1.0)) for p in found.points]
        return replace(found, points=tuple(points))

    return replace(report, found=tuple(map(changed, report.found)))


def test_speed_per_error() -> None:
    """Ratios at one tolerance count as those of the tables do."""
    last = read(DOCS / "precision.json")
    text = precision_page.page(last)
    rows = precision_page.at_one_tolerance(last.of(precision_page.NAMED[0]))  # type: ignore[arg-type]
    for what, ratio, bar, _ in rows:
        assert (what in text.split("Required ratios that are missed: ")[-1].split("\n")[0]) == (not is_held(ratio, bar))
        assert f"; required {bar:g}: {verdict(ratio, bar)}." in text
    fast, slow = (slower(last, tuple(OURS), factor) for factor in (1e-3, 1e3))
    assert "All required ratios are held." in precision_page.page(fast)
    assert "missed" not in precision_page.page(fast) + precision_page.readme(fast)
    text = precision_page.page(slow)
    assert "All required" not in text
    assert text.count(", missed)") == 5 * len(last.found)
    assert precision_page.readme(slow).count(", missed)") == 5 * len(last.found)
    assert {line.split()[-1] for line in precision_page.lines(slow)} == {"missed"}
    gone = replace(last, found=tuple(replace(x, points=()) for x in last.found))
    assert "All required" not in precision_page.page(gone)
    assert "Required ratios that are not measured: " in precision_page.page(gone)


def test_beside_other_peoples() -> None:
    """Every required ratio of a run that is a thousand times slower."""
    last = peers_report.read(DOCS / "peers.json")
    entries = []
    for entry in last.entries:
        ratios = {label: (x[0] / 1e3, x[1] / 1e3, x[2] / 1e3) for label, x in entry.ratios.items()}
        entries.append(replace(entry, ratios=ratios))
    slow = replace(last, entries=tuple(entries))
    count = sum(line.endswith("missed") for line in peers_page.lines(slow))
    assert count > 20
    for text in (peers_page.readme(slow), peers_page.page(slow)):
        assert text.count(", missed)") == count


def test_first_builds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(builds, "STARTS", {})
    monkeypatch.setattr(builds, "build", lambda robot, kernels: Cost(5.01, 1.0, 1.0, 2000.5))
    assert builds.page(["ur5"], 1, 1).count("| 5.01 (5, missed) | 1.00 | 1.00 | 2000 (2000, missed) |") == 2
    monkeypatch.setattr(builds, "build", lambda robot, kernels: Cost(5.0, 1.0, 1.0, 2000.0))
    assert "missed)" not in builds.page(["ur5"], 1, 1)


def test_closed_mechanisms() -> None:
    row = closed.Row("gough", False, {}, {closed.DYNAMICS: (4.0, 4.9, 5.0)}, 0.0, 5.0)
    assert closed.required_lines([row])[0].endswith(": missed.")
    assert closed.required_lines([replace(row, ratios={})])[0].endswith(": not measured.")
    count = closed.Count("gough", {"mul": 13, "add": 8, "div": 3, "sincos": 2}, (12, 9))
    assert closed.operation_lines([count])[-1].endswith("| 12, 9: missed |")
    assert "at most" in closed.step_line(closed.STEP_AT_MOST + 0.1)
    assert closed.step_line(closed.STEP_AT_MOST + 0.1).endswith(": missed.")


@pytest.mark.parametrize("name", ["README.md", "docs/peers.md", "docs/precision.md", "docs/builds.md"])
def test_committed_pages_say_what_is_missed(name: str) -> None:
    """Every number with its bar, read off the page."""
    text = (ROOT / name).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("|") or "beside MuJoCo's `discrete`" in line]
    cells = [cell for line in lines for cell in CELL.findall(line)]
    assert len(cells) > 3
    for number, bar, missed in cells:
        held = is_held(float(number), float(bar), at_most=name == "docs/builds.md")
        assert bool(missed) == (not held), (name, number, bar)


def test_nobody_else_decides() -> None:
    """No page compares with a bar by itself."""
    for path in sorted((ROOT / "benchmarks").rglob("*.py")):
        if path.name == "bars.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Compare):
                names = {x.id for x in ast.walk(node) if isinstance(x, ast.Name)}
                names |= {x.attr for x in ast.walk(node) if isinstance(x, ast.Attribute)}
                compared = any(isinstance(op, (ast.Lt, ast.LtE, ast.Gt, ast.GtE)) for op in node.ops)
                assert not (compared and names & {"bar", "bars", "required", "STEP_AT_MOST", "BARS"}), (
                    path,
                    node.lineno,
                )
