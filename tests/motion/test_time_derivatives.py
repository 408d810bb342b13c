"""Reference trajectories of a smoothness, their time derivatives, and where these jump."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from eomgen.errors import InputError
from eomgen.motion import Harmonic, Jump, PointToPoint, Spline, Standstill, TimeTable, with_series
from eomgen.motion.point_to_point import profile_factors, rest_to_rest
from eomgen.motion.splines import Columns
from eomgen.motion.time_derivatives import composed, spline_series

pytestmark = pytest.mark.quick

Array = np.ndarray[Any, np.dtype[np.float64]]


def moved(smooth: int) -> PointToPoint:
    return PointToPoint(np.array([0.1, -1.0]), np.array([0.7, 2.0]), 0.8, 0.2, smooth=smooth)


def through_points(smooth: int) -> Spline:
    return Spline(
        [0.1, 0.3, 0.6, 0.7, 1.0], np.array([[0.0, 1], [1, 2], [0, 3], [-1, 0], [2, 1]]), at_rest=True, smooth=smooth
    )


def test_profiles_are_the_known_ones() -> None:
    assert profile_factors(2).tolist() == [0, 0, 0, 10, -15, 6]
    assert profile_factors(3).tolist() == [0, 0, 0, 0, 35, -84, 70, -20]
    assert profile_factors(4).tolist() == [0, 0, 0, 0, 0, 126, -420, 540, -315, 70]


@pytest.mark.parametrize("smooth", [2, 3, 4, 5, 6])
def test_profiles_agree_with_50_digits(smooth: int) -> None:
    r = np.array([0.0, 0.1, 0.5, 0.7, 0.999, 1.0])
    found = rest_to_rest(r, smooth, 2 * smooth + 2)
    with mpmath.workdps(50):
        factors = [mpmath.mpf(x) for x in profile_factors(smooth)]
        for order in range(2 * smooth + 3):
            exact = [float(mpmath.polyval(factors[::-1], mpmath.mpf(x))) for x in r.tolist()]
            size = max(float(abs(x)) for x in (*factors, 1))
            np.testing.assert_allclose(found[order], exact, rtol=1e-13, atol=2e-15 * size)
            factors = [i * x for i, x in enumerate(factors)][1:]
    assert not found[1 : smooth + 1, [0, -1]].any()
    assert found[smooth + 1, [0, -1]].all()


@pytest.mark.parametrize("smooth", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("make", [moved, through_points])
def test_series_are_derivatives_of_each_other(make: Any, smooth: int) -> None:
    program, h = make(smooth), 1e-6
    t = np.array([0.25, 0.44, 0.66, 0.93])
    here, before, behind = (program.series(x, 6) for x in (t, t - h, t + h))
    rates = (behind[:-1] - before[:-1]) / (2 * h)
    for order in range(6):
        np.testing.assert_allclose(here[order + 1], rates[order], atol=1e-5 * max(np.abs(here[order + 1 :]).max(), 1.0))
    for mine, expected in zip(program.at(t), here, strict=False):
        np.testing.assert_allclose(mine, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("smooth", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("make", [moved, through_points])
def test_motions_are_as_smooth_as_asked(make: Any, smooth: int) -> None:
    program = make(smooth)
    ends = [0.2, 1.0] if make is moved else [0.1, 1.0]
    assert program.jumps(smooth) == ()
    assert program.jumps(smooth + 1) == tuple(Jump(t, smooth + 1) for t in ends)
    inner = {0.3, 0.6, 0.7} if make is through_points else set()
    assert {t for t, order in program.jumps(2 * smooth + 1) if order == 2 * smooth + 1} == inner
    edge = 1e-12
    for end in ends:
        outside, inside = program.series(np.array([end - edge, end + edge]), smooth + 1).swapaxes(0, 1)
        np.testing.assert_allclose(
            outside[: smooth + 1], inside[: smooth + 1], atol=1e-3 + 2 * edge * np.abs(inside - outside).max()
        )
        assert np.abs(outside[-1] - inside[-1]).max() > 1.0
    if make is through_points:
        np.testing.assert_allclose(program.at(0.6)[0], [0.0, 3.0], atol=1e-12)


def test_the_minimum_snap_trajectory_has_the_least_integral_of_the_square_of_its_snap() -> None:
    x, weights = np.polynomial.legendre.leggauss(8)
    knots = through_points(3).t
    half = np.diff(knots)[:, np.newaxis] / 2
    t, weights = (knots[:-1, np.newaxis] + half * (1.0 + x)).ravel(), (half * weights).ravel()
    snaps = {smooth: through_points(smooth).series(t, 4)[4, :, 0] for smooth in (3, 4)}
    assert weights @ snaps[3] ** 2 < weights @ snaps[4] ** 2
    other = np.polynomial.Polynomial.fromroots([0.1] * 4 + [0.3, 0.6, 0.7] + [1.0] * 4).deriv(4)(t)  # leaves no point
    assert abs(weights @ (snaps[3] * other)) < 1e-9 * np.sqrt((weights @ snaps[3] ** 2) * (weights @ other**2))


def test_motions_that_do_not_rest_jump_at_their_ends() -> None:
    t = np.linspace(0.0, 1.0, 12)
    waving = Spline(t, np.sin(5.0 * t)[:, np.newaxis], at_rest=False)
    assert waving.jumps(2) == (Jump(0.0, 1), Jump(1.0, 1))
    assert len(waving.jumps(5)) == 2 + 6  # not-a-knot: two knots less at each end
    assert Columns(waving, np.array([0])).jumps(2) == waving.jumps(2)
    assert Standstill(np.array([1.0])).jumps(4) == ()
    assert Standstill(np.array([1.0])).series([0.0, 1.0], 2).tolist() == [
        [[1.0], [1.0]],
        [[0.0], [0.0]],
        [[0.0], [0.0]],
    ]


def test_a_shake_has_all_its_time_derivatives() -> None:
    shake = Harmonic([0.3, 0.1], [2.0, 1.0], [0.1, -0.4])
    series = shake.series(0.37, 5)
    for mine, expected in zip(shake(0.37), series, strict=False):
        np.testing.assert_allclose(mine, expected, rtol=1e-14)
    np.testing.assert_allclose(series[4:], series[:2] * (2 * np.pi * np.array([2.0, 1.0])) ** 4, rtol=1e-13)
    assert shake.jumps(9) == ()


def test_tables_jump_where_their_rows_or_slopes_do() -> None:
    table = TimeTable(("a", "b"), np.array([0.0, 1.0, 2.0, 4.0]), np.array([[0.0, 1], [1, 1], [2, 1], [0, 1]]))
    assert table.jumps(1) == (Jump(0.0, 1), Jump(2.0, 1), Jump(4.0, 1))
    series = table.series([-1.0, 0.5, 1.0, 3.0, 5.0], 2)
    np.testing.assert_allclose(series[0], [table.at(t) for t in (-1.0, 0.5, 1.0, 3.0, 5.0)])
    assert series[1, :, 0].tolist() == [0.0, 1.0, 1.0, -1.0, 0.0]
    assert not series[2].any()
    held = TimeTable(("a",), np.array([0.0, 1.0, 2.0]), np.array([[0.0], [0.0], [3.0]]), hold=True)
    assert held.jumps(3) == (Jump(2.0, 0),)
    assert held.series([1.0, 2.0], 1)[:, :, 0].tolist() == [[0.0, 3.0], [0.0, 0.0]]


def test_series_of_a_spline_over_a_profile_are_those_of_what_is_composed() -> None:
    path = through_points(2)._splines[0]
    profile = PointToPoint(np.array([0.1]), np.array([1.0]), 0.5, 0.1, smooth=4)
    t, h = np.array([0.2, 0.33, 0.55]), 1e-5

    def series(times: Array) -> Array:
        inner = profile.series(times, 5)
        return composed(spline_series(path, inner[0, ..., 0], 5), inner)

    here, rates = series(t), (series(t + h) - series(t - h))[:-1] / (2 * h)
    for order in range(4):
        np.testing.assert_allclose(here[order + 1], rates[order], atol=1e-6 * np.abs(here[order + 1 :]).max())


def test_what_has_no_series_is_refused_by_name() -> None:
    class Held:
        start = np.zeros(1)

        def at(self, t: Any) -> tuple[Array, Array, Array]:
            return (np.zeros(1),) * 3

    with pytest.raises(
        InputError, match=r"motion: Held gives no time derivatives beyond accelerations; allowed: a prog"
    ):
        with_series(Held())
    with pytest.raises(InputError, match=r"order: -1; allowed: a whole number from 0 to 16"):
        moved(2).series(0.0, -1)
    with pytest.raises(InputError, match=r"smooth: 7; allowed: a whole number from 2 to 6, or 'minimum_snap'"):
        moved(7)
    assert PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth="minimum_snap") == moved_by_one(3)  # type: ignore[arg-type]


def moved_by_one(smooth: int) -> PointToPoint:
    return PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth=smooth)
