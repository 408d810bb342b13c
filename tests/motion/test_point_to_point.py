"""Point-to-point motions: ends, derivatives, shapes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from eomgen import ArrayError, InputError
from eomgen.motion.point_to_point import PointToPoint

pytestmark = pytest.mark.quick

MOTION = PointToPoint((0.0, 1.0, -2.0), (1.0, 1.0, 3.0), 1.6, begin=0.25)


def test_rests_at_both_ends_and_beyond() -> None:
    for t, place in ((-5.0, MOTION.start), (0.25, MOTION.start), (MOTION.end, MOTION.goal), (99.0, MOTION.goal)):
        q, v, a = MOTION.at(t)
        assert np.allclose(q, place, rtol=0.0, atol=1e-15)
        assert not v.any()
        assert not a.any()
    assert np.allclose(MOTION.at(MOTION.begin + 0.8)[0], 0.5 * (MOTION.start + MOTION.goal), atol=1e-15)


def test_rates_are_the_derivatives() -> None:
    t, h = np.linspace(0.3, 1.8, 50), 1e-5
    (q1, v1, _), (q2, v2, _), (_, v, a) = MOTION.at(t - h), MOTION.at(t + h), MOTION.at(t)
    assert np.abs((q2 - q1) / (2 * h) - v).max() < 1e-8
    assert np.abs((v2 - v1) / (2 * h) - a).max() < 1e-8


def test_peaks_of_the_quintic() -> None:
    _, v, a = MOTION.at(np.linspace(0.0, 2.0, 20001))
    assert v[:, 2].max() == pytest.approx(1.875 * 5.0 / 1.6, rel=1e-6)
    assert a[:, 2].max() == pytest.approx(10.0 / np.sqrt(3.0) * 5.0 / 1.6**2, rel=1e-6)


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3)])
def test_times_of_any_shape(shape: tuple[int, ...]) -> None:
    t = np.random.default_rng(0).uniform(0.0, 2.0, shape)
    for values in MOTION.at(t):
        assert values.shape == (*shape, 3)
    for index in np.ndindex(*shape):
        assert all((x[index] == y).all() for x, y in zip(MOTION.at(t), MOTION.at(t[index]), strict=True))


def test_is_a_value() -> None:
    same = PointToPoint([0, 1, -2], np.array([1.0, 1.0, 3.0]), 1.6, 0.25)
    assert same == MOTION
    assert hash(same) == hash(MOTION)
    assert same != PointToPoint([0, 1, -2], [1, 1, 3], 1.7, 0.25)
    with pytest.raises(ValueError, match="read-only"):
        MOTION.start[0] = 1.0
    source = np.zeros(2)
    motion = PointToPoint(source, [1.0, 1.0], 1.0)
    source[0] = 7.0
    assert motion.start[0] == 0.0


@pytest.mark.parametrize(
    ("values", "kind", "text"),
    [
        (([0.0], [1.0, 2.0], 1.0), ArrayError, "goal: expected 1 values"),
        (([[0.0]], [1.0], 1.0), ArrayError, "start: .*shape \\(1, 1\\)"),
        (([], [], 1.0), ArrayError, "start"),
        (("far", [1.0], 1.0), ArrayError, "start: 'far'; allowed: finite numbers"),
        (([0.0, np.nan], [1.0, 1.0], 1.0), ArrayError, "start: element 1 is nan"),
        (([0.0], [1.0], 0.0), InputError, "duration: 0.0 s"),
        (([0.0], [1.0], np.inf), InputError, "duration: inf s"),
        (([0.0], [1.0], 1.0, np.nan), InputError, "begin: nan s"),
        (([0.0], [np.inf], 1.0, 0.0, ("joint1.gamma",)), ArrayError, "goal: joint1.gamma is inf"),
        (([0.0, 1.0], [0.0, 1.0], 1.0, 0.0, ("joint1.gamma",)), ArrayError, "start: expected .*\\(1,\\)"),
    ],
)
def test_refusals(values: tuple[object, ...], kind: type[Exception], text: str) -> None:
    with pytest.raises(kind, match=text):
        PointToPoint(*values)  # type: ignore[arg-type]


def test_a_time_is_a_number() -> None:
    with pytest.raises(ArrayError, match="t: holds NaN"):
        MOTION.at([0.0, np.nan])
