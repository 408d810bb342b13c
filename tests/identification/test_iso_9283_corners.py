"""Multi-directional variation of poses and deviations at corners by ISO 9283, against numbers by hand."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.identification import AccuracyResult, accuracy, load_accuracy
from eomgen.identification.iso_9283.attained import Path as Way
from eomgen.identification.iso_9283.attained import Record
from eomgen.identification.iso_9283.corners import corners_of
from eomgen.identification.iso_9283.formulas import corner_overshoot, distance_to_path
from eomgen.identification.iso_9283.solve import figures_of
from tests.support.pose_files import MM, at, measured, turned, write

Array = NDArray[np.float64]
SQUARE = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.1, 0.0], [0.0, 0.1, 0.0]])


def dense(points: Array, step: float = 0.005) -> Array:
    """A path with points between its corners."""
    parts = [
        a + np.linspace(0.0, 1.0, round(float(np.linalg.norm(b - a)) / step), endpoint=False)[:, np.newaxis] * (b - a)
        for a, b in pairwise(points)
    ]
    return np.vstack([*parts, points[-1:]])


def three_directions(folder: Path) -> AccuracyResult:
    """One command as poses 1 to 3, two cycles each, 1, 2 and 4 mm off along x, y and z; and another pose between."""
    offsets = MM * np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    command = np.array([[0.5, 0.1, 0.9]] * 3 + [[0.6, 0.1, 0.9]])
    rows = np.repeat(np.arange(4), 2)
    angles = np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, -0.02, 0.0], [0.0, 0.0, 0.0]])
    columns = {"pose": rows + 1, **at((command + offsets)[rows]), **turned(angles[rows])}
    columns |= {**at(command[rows], "tool.command"), **turned(np.zeros((8, 3)), "tool.command")}
    return accuracy(write(folder / "measured.csv", columns))


def test_variation_by_hand(tmp_path: Path) -> None:
    """The farthest barycentres are those of y and z, sqrt(2^2 + 4^2) mm; angles differ by 10, 20 and 30 mrad."""
    found = three_directions(tmp_path)
    (variation,) = found.variations
    assert variation.poses == ("1", "2", "3")
    assert variation.cycles == 2
    assert variation.position == pytest.approx(MM * np.sqrt(20.0))
    np.testing.assert_allclose(variation.turned or (), [0.01, 0.02, 0.03], atol=1e-12)
    assert [pair.poses for pair in found.distances] == [("3", "4")]
    assert found.summary()["vAP"] == variation.position
    (note,) = [note for note in found.notes if "vAP" in note]
    assert note.endswith("one pose reached from 3 directions, which their records do not show")
    assert "4.472" in "\n".join(found.lines())
    again = load_accuracy(found.save(tmp_path / "figures.json"))
    assert again == found


@pytest.mark.parametrize(("third", "said"), [([0.0, 0.0, 0.1], "3 directions"), ([0.1, 0.02, 0.0], "are 11 deg apart")])
def test_directions_of_recorded_approaches(third: list[float], said: str, tmp_path: Path) -> None:
    t, ways = np.linspace(0.0, 1.0, 11), np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], third])
    records = [(1.0 - t)[:, np.newaxis] * way for way in ways for _ in range(2)]
    columns = {
        "pose": np.repeat([1, 2, 3], 22),
        "cycle": np.tile(np.repeat([1, 2], 11), 3),
        "t": np.tile(t, 6),
        **at(np.vstack(records)),
        **at(np.zeros((66, 3)), "tool.command"),
    }
    (note,) = [note for note in accuracy(write(tmp_path / "m.csv", columns)).notes if "vAP" in note]
    assert note.endswith(said)


def test_two_directions_are_fewer_than_those_of_the_standard(tmp_path: Path) -> None:
    columns = {"pose": [1, 1, 2, 2], **at(np.zeros((4, 3))), **at(np.zeros((4, 3)), "tool.command")}
    found = accuracy(write(tmp_path / "m.csv", columns))
    assert [variation.position for variation in found.variations] == [0.0]
    assert not found.distances
    assert any(note.endswith("the standard has 3") for note in found.notes)


def test_formulas_of_corners_by_hand() -> None:
    """A chamfer of 3 mm leaves 3 / sqrt(2) mm; what is past the corner and outside counts, and nothing else."""
    ex, ey = np.eye(3)[0], np.eye(3)[1]
    chamfer = np.array([[-10.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 10.0, 0.0]])
    assert distance_to_path(np.zeros(3), chamfer) == pytest.approx(3.0 / np.sqrt(2.0))
    assert corner_overshoot(chamfer, np.zeros(3), ex, ey) == 0.0
    beyond = np.array([[-10.0, 0.0, 0.0], [9.0, -1.0, 0.0], [1.0, 2.0, 2.0], [-5.0, 3.0, 0.0], [0.0, 10.0, 0.0]])
    assert corner_overshoot(beyond, np.zeros(3), ex, ey) == pytest.approx(np.sqrt(5.0))


@pytest.mark.parametrize("step", [0.1, 0.005])
def test_corners_of_a_path_by_hand(step: float) -> None:
    """Two cycles: a chamfer of 4 mm at the first corner, 2 mm beyond the second; each keeps its greatest."""
    command = SQUARE if step == 0.1 else dense(SQUARE, step)
    rounded = dense(np.array([[0.0, 0.0, 0.0], [0.196, 0.0, 0.0], [0.2, 0.004, 0.0], [0.2, 0.1, 0.0], [0.0, 0.1, 0.0]]))
    corner = [
        [0.0, 0.0, 0.0],
        [0.2, 0.0, 0.0],
        [0.2, 0.102, 0.0],
        [0.19, 0.102, 0.0],
        [0.18, 0.1, 0.0],
        [0.0, 0.1, 0.0],
    ]
    beyond = dense(np.array(corner), 0.001)
    way = Way("1", Record(None, command, None), tuple(Record(None, x, None) for x in (rounded, beyond)))
    (path,) = figures_of(measured(paths=[way])).paths
    first, second = path.corners
    assert (first.along, second.along) == pytest.approx((0.2, 0.3))
    assert first.angle == second.angle == pytest.approx(np.pi / 2.0)
    assert first.rounding == pytest.approx(MM * 4.0 / np.sqrt(2.0))
    assert first.overshoot == pytest.approx(0.0, abs=1e-12)
    assert second.rounding == pytest.approx(0.0, abs=1e-12)
    assert second.overshoot == pytest.approx(2.0 * MM)


def test_corners_between_points_and_curves_that_have_none() -> None:
    """A corner that sampling cuts off is where both lines meet; a circle, a line and a way back have none."""
    points = dense(SQUARE[:3], 0.007)
    cut = np.delete(points, int(np.argmin(np.linalg.norm(points - SQUARE[1], axis=1))), axis=0)
    (corner,) = corners_of(cut)
    np.testing.assert_allclose(corner.point, SQUARE[1], atol=1e-12)
    angle = np.linspace(0.0, np.pi, 13)
    assert not corners_of(np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    assert not corners_of(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))
    assert not corners_of(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
