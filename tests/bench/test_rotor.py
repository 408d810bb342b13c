"""A rotor beside Exudyn's: its finite elements, its frequencies, both motions, and the page."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import exudyn_peer, rotor
from benchmarks.exudyn_peer import Settings
from benchmarks.peers.contender import MissingPeer
from benchmarks.rotor import Row, Run, bars, distance, ratio, row_lines
from benchmarks.rotor_model import DENSITY, LENGTH, MODES, SHAFT, UNBALANCE, robot
from benchmarks.rotor_model import rotor as made_rotor
from eomgen.bending.checks import rigid_motions
from eomgen.robot.model import build_model
from tests.support.optional import needs


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
