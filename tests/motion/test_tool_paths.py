"""Motions of a tool with orientation, and reference trajectories of a smoothness with their time derivatives."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, InputError, ReachError
from eomgen.motion import (
    Harmonic,
    Jump,
    PointToPoint,
    Program,
    Spline,
    Standstill,
    TimeTable,
    ToolCircle,
    ToolLine,
    ToolPath,
    ToolSpline,
    inverse_kinematics,
    with_series,
)
from eomgen.motion.ends import limits_beside
from eomgen.motion.point_to_point import profile_factors, rest_to_rest
from eomgen.motion.splines import Columns
from eomgen.motion.time_derivatives import composed, spline_series
from eomgen.motion.turns import spherical_spline
from eomgen.robot.model import program_coordinates
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot
from tests.support.refusals import refused
from tests.support.scaras import scara

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]
START = np.array([0.3, -1.2, 1.4, -0.5, 1.1, 0.2])


@pytest.fixture(scope="module")
def ur5(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("ur5").rigid(), "kinematics")


def nowhere(kernel: eomgen.Kernel) -> Array:
    return np.tile([-np.inf, np.inf], (kernel.n, 1))


def profile(t: Array, duration: float) -> Array:
    r = np.clip(t / duration, 0.0, 1.0)
    return np.asarray(10 * r**3 - 15 * r**4 + 6 * r**5)


def is_smooth(program: Program, end: float) -> None:
    """Rates and accelerations are those of the positions and continuous; it rests at both ends."""
    h, t = 1e-5, np.linspace(-0.05, end + 0.05, 4001)
    _, v, a = program.at(t)
    ahead, behind = program.at(t + h), program.at(t - h)
    assert np.abs((ahead[0] - behind[0]) / (2 * h) - v).max() < 1e-5 * np.abs(v).max()
    assert np.abs((ahead[1] - behind[1]) / (2 * h) - a).max() < 1e-3 * np.abs(a).max()
    assert np.abs(ahead[2] - behind[2]).max() < 5e-3 * np.abs(a).max()
    for at in (0.0, end):
        assert np.abs(program.at(at)[1]).max() < 1e-9 * np.abs(v).max() + 1e-12
        assert np.abs(program.at(at)[2]).max() < 1e-6 * np.abs(a).max()


@pytest.mark.parametrize("smooth", [3, 4])
def test_paths_are_as_smooth_as_asked(ur5: eomgen.Kernel, smooth: int) -> None:
    begin = ur5.frame_pose(START, "tcp")[:3, 3]
    end = begin + [0.05, -0.15, 0.1]
    how = {"guess": START, "limits": nowhere(ur5), "orientation": "keep", "smooth": smooth}
    line = ToolLine(ur5, "tcp", begin, end, 0.8, start_time=0.1, **how)
    way = ToolSpline(ur5, "tcp", [begin, end, begin], [0.0, 0.5, 1.2], **how)
    t, h = np.array([0.2, 0.41, 0.7]), 1e-6
    for program, ends in ((line, (0.1, 0.9)), (way, (0.0, 1.2))):
        is_smooth(program, ends[1])
        assert program.jumps(smooth) == ()
        assert [x for x in program.jumps(smooth + 1) if x.t in ends] == [(x, smooth + 1) for x in ends]
        series, rates = program.series(t, 4), (program.series(t + h, 3) - program.series(t - h, 3)) / (2 * h)
        for order in range(4):
            np.testing.assert_allclose(series[order + 1], rates[order], atol=1e-4 * np.abs(series[order + 1]).max())
        np.testing.assert_allclose(series[:3], program.at(t), rtol=1e-9, atol=1e-9 * np.abs(series[2]).max())
    knots = [x.t for x in line.jumps(5) if x.t not in (0.1, 0.9)]
    assert len(knots) == 201 - 6  # of the path's spline of degree 5
    assert np.abs(np.diff(line.profile.at(np.array(knots))[0][:, 0], prepend=2 / 200) - 1 / 200).max() < 1e-12


def test_lines_and_circles_keep_an_orientation(ur5: eomgen.Kernel) -> None:
    pose = ur5.frame_pose(START, "tcp")
    begin, t = pose[:3, 3], np.linspace(0.0, 1.0, 301)
    keep = {"guess": START, "limits": nowhere(ur5), "orientation": "keep"}
    line = ToolLine(ur5, "tcp", begin, begin + [0.05, -0.15, 0.1], 1.0, **keep)
    circle = ToolCircle(ur5, "tcp", begin + [0, 0.08, 0], [1.0, 0, 0], begin, 2 * np.pi, 1.0, **keep)
    for program in (line, circle):
        found = ur5.frame_pose(program.at(t)[0], "tcp")
        assert np.abs(program.start - START).max() < 1e-12  # it begins where it is
        assert np.abs(found[:, :3, :3] - pose[:3, :3]).max() < 1e-8
        is_smooth(program, 1.0)
    off = ur5.frame_pose(line.at(t)[0], "tcp")[:, :3, 3] - begin
    assert np.abs(off - profile(t, 1.0)[:, np.newaxis] * [0.05, -0.15, 0.1]).max() < 1e-8
    arm = ur5.frame_pose(circle.at(t)[0], "tcp")[:, :3, 3] - begin - [0, 0.08, 0]
    assert np.abs(np.linalg.norm(arm, axis=1) - 0.08).max() < 1e-8
    free = ToolLine(ur5, "tcp", begin, begin + [0.05, -0.15, 0.1], 1.0, guess=START, limits=nowhere(ur5))
    turned = ur5.frame_pose(free.at(1.0)[0], "tcp")[:3, :3].T @ pose[:3, :3]
    assert np.arccos(0.5 * (np.trace(turned) - 1.0)) > 0.01  # without the key it turns as the joints let it


def test_a_line_turns_as_scipys_slerp(ur5: eomgen.Kernel) -> None:
    pose = ur5.frame_pose(START, "tcp")
    last = Rotation.from_rotvec([0.4, -0.3, 0.5]).as_matrix() @ pose[:3, :3]
    begin, end = pose[:3, 3], pose[:3, 3] + [0.05, -0.15, 0.1]
    t = np.linspace(0.0, 0.8, 201)
    for first in (None, Rotation.from_rotvec([-0.2, 0.1, 0.2]).as_matrix() @ pose[:3, :3]):
        program = ToolLine(ur5, "tcp", begin, end, 0.8, guess=START, limits=nowhere(ur5), orientation=(first, last))
        ends = Rotation.from_matrix([pose[:3, :3] if first is None else first, last])
        wanted = Slerp([0.0, 1.0], ends)(profile(t, 0.8)).as_matrix()
        found = ur5.frame_pose(program.at(t)[0], "tcp")
        assert np.abs(found[:, :3, :3] - wanted).max() < 1e-8
        assert np.abs(found[:, :3, 3] - begin - profile(t, 0.8)[:, np.newaxis] * (end - begin)).max() < 1e-8
        is_smooth(program, 0.8)


def test_a_spline_passes_its_poses(ur5: eomgen.Kernel) -> None:
    rng, times = np.random.default_rng(4), np.array([0.1, 0.5, 0.8, 1.4])
    poses = ur5.frame_pose(START + rng.uniform(-0.3, 0.3, (4, 6)), "tcp")
    points, axes = poses[:, :3, 3], poses[:, :3, :3]
    program = ToolSpline(ur5, "tcp", points, times, guess=START, limits=nowhere(ur5), orientation=axes)
    assert np.abs(ur5.frame_pose(program.at(times)[0], "tcp") - poses).max() < 1e-10
    t = np.linspace(0.1, 1.4, 333)
    between = ur5.frame_pose(program.at(t)[0], "tcp")[:, :3, :3]
    assert np.abs(between - spherical_spline(times, axes, t)).max() < 1e-7
    shifted = ToolSpline(ur5, "tcp", points, times - 0.1, guess=START, limits=nowhere(ur5), orientation=axes)
    is_smooth(shifted, 1.3)
    keep = ToolSpline(ur5, "tcp", points, times, guess=START, limits=nowhere(ur5), orientation="keep")
    found = ur5.frame_pose(keep.at(t)[0], "tcp")
    assert np.ptp(found[:, :3, :3], axis=0).max() < 1e-7
    assert np.abs(ur5.frame_pose(keep.at(times)[0], "tcp")[:, :3, 3] - points).max() < 1e-10
    free = ToolSpline(ur5, "tcp", points, times, guess=START, limits=nowhere(ur5))
    assert np.abs(ur5.frame_pose(free.at(times)[0], "tcp")[:, :3, 3] - points).max() < 1e-10
    spot = ToolSpline(
        ur5, "tcp", points[[0, 0]], [0.0, 1.0], guess=START, limits=nowhere(ur5), orientation=axes[:2]
    )  # turns on the spot
    assert np.abs(ur5.frame_pose(spot.at(t)[0], "tcp")[:, :3, 3] - points[0]).max() < 1e-8


def seven(limits: tuple[float, float] | None = None, which: str = "") -> Robot:
    robot = random_robot(703, types=("revolute",), rigid=True, forces=False, counts=[1] * 7, name="seven")
    joints = tuple(replace(x, limits=limits) if x.name == which else x for x in robot.joints)
    return replace(robot, joints=joints)


def test_redundant_arms_take_the_least_motion_within_their_limits(built: Build) -> None:
    kernel, guess = built(seven(), "kinematics"), np.random.default_rng(2).uniform(-0.5, 0.5, 7)
    pose = kernel.frame_pose(guess, "tcp")
    end = pose[:3, 3] + [0.2, 0.25, -0.2]

    def line(robot: Robot) -> ToolPath:
        between = limits_beside(robot, kernel.coordinates, program_coordinates(robot), guess)
        return ToolLine(kernel, "tcp", pose[:3, 3], end, 1.0, guess=guess, limits=between, orientation="keep")

    least, t = line(seven()), np.linspace(0.0, 1.0, 401)
    q, v, _ = least.at(t)
    for k in range(50, 351, 50):  # rates have no part that leaves the tool where it is
        idle = np.linalg.svd(kernel.frame_jacobian(q[k], "tcp"))[2][-1]
        assert abs(idle @ v[k]) < 0.01 * np.linalg.norm(v[k])
    j = int(np.abs(q[-1] - guess).argmax())
    stop = guess[j] + 0.7 * (q[-1, j] - guess[j])
    limits = (-3.0, float(stop)) if q[-1, j] > stop else (float(stop), 3.0)
    sparing = line(seven(limits, kernel.coordinates[j].split(".")[0]))
    found = sparing.at(t)[0]
    assert limits[0] - 1e-9 <= found[:, j].min()
    assert found[:, j].max() <= limits[1] + 1e-9
    assert np.abs(kernel.frame_pose(found, "tcp")[:, :3, :3] - pose[:3, :3]).max() < 1e-7
    is_smooth(sparing, 1.0)
    assert np.square(np.diff(found, axis=0)).sum() > np.square(np.diff(q, axis=0)).sum()


def place_and_time(error: ReachError) -> tuple[Array, float, float]:
    """The point, the part of the path and the time that a message names."""
    found = re.search(r"at \(([^)]*)\) m.*, ([0-9.e+-]+) % of its length, t = ([0-9.e+-]+) s", str(error))
    assert found is not None, str(error)
    return np.array([float(x) for x in found[1].split(",")]), float(found[2]) / 100, float(found[3])


def test_what_cannot_be_reached_is_said(built: Build) -> None:
    robot = robot_from_toml(scara())
    kernel = built(robot, "kinematics")
    guess = np.array([0.3, 0.8, 0.1, -0.4])
    limits = limits_beside(robot, kernel.coordinates, kernel.coordinates, guess)
    pose = kernel.frame_pose(guess, "tcp")
    begin = pose[:3, 3]

    def fail(end: Array, orientation: object) -> ReachError:
        with pytest.raises(ReachError) as caught:
            ToolLine(
                kernel, "tcp", begin, end, 1.0, guess=guess, limits=limits, orientation=orientation, start_time=0.5
            )  # type: ignore[arg-type]
        return caught.value

    tilted = Rotation.from_euler("x", 0.3).as_matrix() @ pose[:3, :3]
    error = fail(begin + [0, 0.1, 0], (None, tilted))
    point, part, t = place_and_time(error)
    assert "it misses by" in str(error)
    assert part == pytest.approx(0.005)
    assert error.angle == pytest.approx(0.005 * 0.3, rel=1e-3)
    assert f"{np.degrees(error.angle):.4g} deg" in str(error)
    assert profile(np.array(t - 0.5), 1.0) == pytest.approx(part, rel=0.05)
    out = begin + [0.4, 0.4, 0.0]
    error = fail(out, "keep")
    point, part, t = place_and_time(error)
    assert np.linalg.norm(point[:2]) == pytest.approx(0.7, abs=2e-2)  # the arms are stretched
    assert point == pytest.approx(begin + part * (out - begin), abs=2e-3)
    assert profile(np.array(t - 0.5), 1.0) == pytest.approx(part, rel=0.01)
    assert re.search(r"misses by [0-9.]+ mm and [0-9.e-]+ deg|would jump by", str(error))
    low = begin - [0.0, 0.0, 0.3]
    error = fail(low, "keep")
    point, part, t = place_and_time(error)
    assert point[2] == pytest.approx(0.3, abs=2e-3)  # 0.5 less the stroke and the tool
    assert re.search(r"stroke\.z = -0\.10\d*; its limits are -0\.1 to 0\.2; within them it misses by", str(error))
    assert error.distance < 2e-3
    begin = np.array([0.0, 0.0, 5.0])
    assert "does not reach (0, 0, 5) m: it gets as near as " in str(fail(low, None))


def test_orientations_that_cannot_be_used(ur5: eomgen.Kernel) -> None:
    ends = ([0.4, 0.1, 0.3], [0.4, 0.2, 0.3])
    options = {"guess": START, "limits": nowhere(ur5)}
    with pytest.raises(InputError, match="orientation: got 'hold'; allowed: 'keep'"):
        ToolLine(ur5, "tcp", *ends, 1.0, orientation="hold", **options)  # type: ignore[arg-type]
    with pytest.raises(ArrayError, match="orientation: is no rotation"):
        ToolLine(ur5, "tcp", *ends, 1.0, orientation=(2.0 * np.eye(3), None), **options)
    with pytest.raises(ArrayError, match=r"orientation\[1\]: is no rotation"):
        ToolSpline(ur5, "tcp", ends, [0.0, 1.0], orientation=[np.eye(3), -np.eye(3)], **options)
    for make, given, message in (
        (ToolSpline, (ends, [0.0]), r"(times|points): .*allowed"),
        (ToolSpline, (ends, [1.0, 1.0]), r"(times|points): .*allowed"),
        (ToolSpline, ([[0.0, 0.0]] * 2, [0.0, 1.0]), r"(times|points): .*allowed"),
        (ToolSpline, ([[np.nan] * 3] * 2, [0, 1]), r"(times|points): .*allowed"),
        (ToolSpline, (ends, [0.0, np.inf]), r"^times: .* has numbers that are not finite; allowed: .* that rise, s$"),
        (ToolSpline, ("here", [0.0, 1.0]), r"^points: 'here'; allowed: finite numbers \(2, 3\), m$"),
        (ToolLine, (["a", 0.0, 0.0], ends[1], 1.0), r"^begin: \['a', 0.0, 0.0\]; allowed: three finite numbers, m$"),
        (ToolLine, (ends[0], [0.4, 0.2], 1.0), r"^end: got shape \(2,\); allowed: three finite numbers, m$"),
    ):
        refused(ArrayError, message, make, ur5, "tcp", *given, **options)


@pytest.mark.soak
def test_a_platform_keeps_its_orientation() -> None:
    """A closed mechanism along a line: level all the way, its loops closed."""
    robot = eomgen.load_robot("gough")
    kernel = eomgen.build(robot)
    guess = np.array([robot.home.get(name, 0.0) for name in kernel.coordinates])
    limits = limits_beside(robot, kernel.coordinates, robot.driven or (), guess)
    turned = np.array(eomgen.robot.rotation_from_rpy((0.0, 0.1, 0.0)))
    ends = ([0.0, 0.0, 1.1], [0.06, 0.03, 1.05])
    line = ToolLine(kernel, "tcp", *ends, 1.0, guess=guess, limits=limits, orientation=(np.eye(3), turned))
    q = line.at(np.linspace(0.0, 1.0, 41))[0]
    pose, s = kernel.frame_pose(q, "tcp"), profile(np.linspace(0.0, 1.0, 41), 1.0)
    wanted = Rotation.from_euler("y", (0.1 * s)[:, np.newaxis]).as_matrix()
    assert np.abs(pose[:, :3, :3] - wanted).max() < 1e-8
    assert np.abs(pose[:, :3, 3] - ends[0] - s[:, np.newaxis] * np.subtract(*ends[::-1])).max() < 1e-8
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-8
    there = inverse_kinematics(kernel, pose[-1], robot=robot, guess=guess)
    assert np.abs(there - q[-1]).max() < 1e-7


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

    refused(
        InputError, r"motion: Held gives no time derivatives beyond accelerations; allowed: a prog", with_series, Held()
    )
    refused(InputError, r"order: -1; allowed: a whole number from 0 to 16", moved(2).series, 0.0, -1)
    refused(InputError, r"smooth: 7; allowed: a whole number from 2 to 6, or 'minimum_snap'", moved, 7)
    assert PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth="minimum_snap") == moved_by_one(3)  # type: ignore[arg-type]


def moved_by_one(smooth: int) -> PointToPoint:
    return PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth=smooth)
