"""Speed per error: what is kept of runs, who is the fastest that is exact enough, the page and the figure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from benchmarks import precision, precision_page
from benchmarks.peers.contender import MissingPeer
from benchmarks.peers.mujoco_peer import MujocoPeer
from benchmarks.precision_cases import ERRORS, OTHERS, OURS, PROBLEMS, TOLERANCES, Motion, Problem
from benchmarks.precision_report import Measured, Point, Report, read
from tests.support.optional import needs

pytestmark = pytest.mark.usefixtures("unoptimised")

DOCS = Path(__file__).parents[2] / "docs"


def one_link(**given: object) -> Problem:
    """A rod on a joint that gives way, let go for a moment."""
    first = next(iter(PROBLEMS.values()))
    return replace(
        first,
        key="one_link",
        title="one link",
        duration=0.05,
        samples=5,
        start=lambda kernel: (np.zeros(kernel.n), np.zeros(kernel.n)),
        missing={},
        **given,
    )


@pytest.fixture
def found() -> Measured:
    points = (
        Point("eomgen tsit5", 1e-6, 5e-7, 4e-7, 0.002, 90),
        Point("eomgen rosenbrock", 1e-6, 2e-4, 1e-4, 0.001, 40),
        Point("scipy:Radau", 1e-6, 5e-7, 1e-7, 0.060, 30),
        Point("CVODE", 1e-6, 9e-5, 1e-7, 0.012, 30),
    )
    missing = {"MuJoCo RK4": "no equal", "MuJoCo discrete": "no equal"}
    return Measured("puma560_elastic", 3e-12, points, missing)


def test_the_fastest_that_is_exact_enough(found: Measured) -> None:
    assert found.cheapest(OURS, 1e-3) == found.points[1]
    assert found.cheapest(OURS, 1e-4) == found.points[0]
    assert found.cheapest(OURS, 1e-8) is None
    assert [found.ratio(error) for error in ERRORS] == [12.0, 6.0, 30.0, 30.0, None, None]


def test_tables(found: Measured, tmp_path: Path) -> None:
    report = Report({"Processor": "some"}, 3, (found,))
    report.write(tmp_path / "report.json")
    assert read(tmp_path / "report.json") == report
    said = precision_page.lines(report)
    assert [line.split()[-1] for line in said] == ["held", "missed", "held", "held", "3", "3", "held", "held", "missed"]
    text = precision_page.page(report)
    assert text.isascii()
    assert "| CVODE | 12 | 12 | - | - | - | - |" in text
    ratios = ("12.0 (10)", "6.0 (10, missed)", "30.0 (10)", "30.0 (10)", "- (3)", "- (3)")
    assert f"| best of the others by best of ours | {' | '.join(ratios)} |" in text
    assert "| best of ours without Radau IIA by best of ours | 1.00 | 1.00 | 1.00 | 1.00 | - | - |" in text
    assert "- MuJoCo `RK4`, MuJoCo `discrete`: no equal." in text
    assert "elastic PUMA 560 (36 DOF) at 1e-04 (6.0 of 10)" in text
    assert "CVODE at a relative tolerance of 1e-06, at the same error (6.0 of 10)" in text
    assert "required 10: missed." in text
    assert "12.0 (CVODE) | 6.0 (CVODE) | 30.0 (scipy:Radau)" in precision_page.ratios(report)


def test_figures_are_the_same_bytes(found: Measured, tmp_path: Path) -> None:
    for name in ("one.svg", "two.svg"):
        precision_page.draw(Report({}, 1, (found,) * 3), tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_the_page_is_that_of_the_last_run() -> None:
    """Every problem has points, and of every contender some, or a reason why not."""
    report = read(DOCS / "precision.json")
    assert precision_page.page(report) == (DOCS / "precision.md").read_text(encoding="ascii")
    assert [each.problem for each in report.found] == list(PROBLEMS)
    for each in report.found:
        assert each.difference <= precision.AGREE
        assert {p.contender for p in each.points} | set(each.missing) == {*OURS, *OTHERS}
        assert all(each.cheapest(OURS, error) for error in ERRORS)


def test_errors_shrink_with_the_setting() -> None:
    """Ours, SciPy's and SUNDIALS', at a small robot."""
    problem, names = one_link(), ("eomgen tsit5", "eomgen radau", "eomgen auto", "eomgen rk4", "scipy:Radau", "CVODE")
    measured = precision.measure(problem, 2, lambda line: None, names)
    assert measured.difference <= precision.AGREE
    for name in names:
        points = [p for p in measured.points if p.contender == name]
        assert len(points) >= 2, (name, measured.missing)
        assert points[-1].error <= 1e-8
        assert all(p.end <= p.error and p.seconds > 0.0 for p in points)
    assert {p.setting for p in measured.points if p.contender == "scipy:Radau"} <= set(TOLERANCES)


def test_references_that_differ_are_refused() -> None:
    with pytest.raises(precision.Disagreement, match="one_link: tsit5 and rk4 differ"):
        precision.measure(one_link(references=(("tsit5", 1e-10), ("rk4", 1))), 1, lambda line: None, ())


def test_mujoco_goes_the_same_way() -> None:
    """Its RK4 tends to what is exact, and ``discrete`` is our linearly implicit step."""
    needs("mujoco")
    motion = Motion(one_link())
    robot = eomgen.load_robot("one_link")
    try:
        fourth, first = (MujocoPeer(robot, name) for name in ("RK4", "discrete"))
    except MissingPeer as missing:
        pytest.skip(str(missing))
    exact, ours = motion.exact()[0], motion.fixed("implicit", 8)[0]
    assert np.abs(motion.simulated(fourth, 64)[0] - exact).max() <= 1e-8
    assert np.abs(motion.simulated(first, 8)[0] - ours).max() <= 1e-12
    with pytest.raises(ArithmeticError, match="diverges"):
        MujocoPeer(robot, "RK4").rollout(motion.q, motion.v, motion.u, 0.5, 1000, 1000)
