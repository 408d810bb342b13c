"""Closed mechanisms beside Pinocchio: states that close, the peer's text, comparison, tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from benchmarks import closed, closed_peer
from benchmarks.closed import CASES, Case, Count, Measured, Row, closed_states, page, row, without_springs
from benchmarks.closed_peer import DYNAMICS, LCABA
from benchmarks.peers.contender import MissingPeer
from benchmarks.peers.measure import states
from benchmarks.peers.ours import Ours as Kernels
from eomgen.bench.clock import Stopwatch
from eomgen.bench.textbook import compile_yardstick
from eomgen.robot.model import build_model
from tests.support.optional import needs

pytestmark = pytest.mark.usefixtures("unoptimised")


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """The peer takes minutes to compile."""

    def missing() -> Path:
        raise MissingPeer("not here")

    monkeypatch.setattr(closed_peer, "library", missing)


@pytest.mark.parametrize("name", ["gough", "four_bar", "andrews"])
def test_states_are_closed_and_stay_so(name: str) -> None:
    robot = without_springs(CASES[name].robot())
    q, v, u = closed_states(robot, CASES[name], 5)
    kernel = eomgen.build(robot, kernels=closed.LOOPS)
    assert q.shape == v.shape == u.shape == (5, kernel.n)
    assert np.abs(kernel.functions.constraint(q)).max() <= 1e-13
    rates = np.einsum("sij,sj->si", kernel.functions.constraint_jacobian(q), v)
    assert np.abs(rates).max() <= 1e-12 * np.abs(v).max()
    assert min(np.ptp(q, axis=0).max(), np.abs(v).max(axis=1).min()) > 0.1


def test_loops_as_the_peer_reads_them() -> None:
    needs("pinocchio")
    lines = closed_peer.loops_text(eomgen.load_robot("four_bar")).splitlines()
    numbers = [[float(x) for x in line.split()] for line in lines]
    turn = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    assert numbers == [[1], [3], [3, *turn, 0.4, 0, 0], [2, *turn, 0.5, 0, 0]]
    assert lines[2].startswith("3 ")  # which C++ reads as an integer
    gough = closed_peer.loops_text(CASES["gough"].robot()).splitlines()
    assert [line.split()[0] for line in gough[:3]] == ["6", "3", "6"]
    four_bar = eomgen.load_robot("four_bar")
    with pytest.raises(MissingPeer, match="closes no universal joint"):
        closed_peer.loops_text(replace(four_bar, loops=(replace(four_bar.loops[0], type="universal"),)))


@pytest.mark.soak
def test_rows_of_one_state_and_of_a_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both are compared with what stands for the peer; times are made up."""
    robot = eomgen.load_robot("one_link")
    kernels = Kernels(robot, ("forward_dynamics",), lambda line: None)
    single, batch = (kernels.contender("forward_dynamics", batch=many) for many in (False, True))
    peer, other = replace(single, label=DYNAMICS), replace(single, label=LCABA)
    given = states(robot, 5)
    arrays = [given[name] for name in "qvu"]
    stopwatch: Stopwatch = compile_yardstick(build_model(robot), ()).stopwatch
    seen = []

    def time(self: Stopwatch, timed, reads, arrays, rounds):  # type: ignore[no-untyped-def]
        seen.append(([x.batch for x in timed], reads, rounds))
        return np.tile([2.0, 12.0, 5.0], (rounds, 1))

    monkeypatch.setattr(Stopwatch, "time", time)
    case = Case("link", lambda: robot, CASES["gough"].guess, {}, {False: 6.5, True: 6.0})
    found = [row(stopwatch, case, [mine, peer, other], arrays, 20) for mine in (single, batch)]
    assert seen == [([False] * 3, 3, 20), ([True, False, False], 3, 6)]
    assert [
        (x.batch, bar.verdict if (bar := x.bar()) else None, x.ratios[DYNAMICS][1], x.ratios[LCABA][1]) for x in found
    ] == [
        (False, "missed", 6.0, 2.5),
        (True, "held", 6.0, 2.5),
    ]
    wrong = Kernels(replace(robot, gravity=(0.0, 0.0, 1.0)), ("forward_dynamics",), lambda line: None)
    differing = row(stopwatch, case, [single, wrong.contender("forward_dynamics")], arrays, 20)
    assert "differs" in differing.missing
    assert not differing.ratios
    bar = differing.bar()
    assert bar.verdict == "not measured"


def test_the_page() -> None:
    ratios = {DYNAMICS: (5.0, 6.0, 7.0), LCABA: (1.0, 2.0, 3.0)}
    gough = CASES["gough"].title
    rows = [
        Row(gough, False, {}, ratios, 2e-9, 5.0),
        Row(gough, True, {}, ratios, 1e-9, 30.0),
        Row("pair of tongs", False, missing="not here"),
    ]
    counts = [Count(gough, {"mul": 10, "add": 8, "div": 3, "sincos": 2}, (12, 9))]
    text = page(Measured(rows, counts, {(gough, DYNAMICS): 1, (gough, LCABA): 2}), 100)
    assert text.isascii()
    for line in (
        f"| {gough}, one state | 6.00 (5.00 - 7.00) | 2.00 (1.00 - 3.00) |",
        f"- Required of {gough}, one state: 5 times `constraintDynamics`: held.",
        f"- Required of {gough}, batch: 30 times `constraintDynamics`: missed.",
        "- pair of tongs: not timed, not here",
        f"| {gough} | 10 | 8 | 3 | 2 | 12, 9 |",
        f"| {gough} | 0, 1 | 1e-07, 2 |",
    ):
        assert line in text
    assert "is 2e-09." in text


@pytest.mark.soak
def test_without_the_peer_it_says_so(no_compiler: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    needs("pinocchio")
    assert closed.main(["four_bar", "--repeat", "1", "--output", str(tmp_path / "page")]) == 0
    assert "four-bar linkage: not timed, not here" in capsys.readouterr().out
    assert not (tmp_path / "page").exists()
    with pytest.raises(SystemExit):
        closed.main(["tongs"])
    assert "allowed: gough, four_bar" in capsys.readouterr().err


def test_a_step_of_an_elastic_mechanism_costs_few_times_its_open_tree() -> None:
    found = closed.elastic_step()
    assert 1.0 < found <= closed.STEP_AT_MOST
    assert f"{found:.1f} times" in closed.step_line(found)
    assert closed.step_line(7.0).endswith("at most 6: missed.")
