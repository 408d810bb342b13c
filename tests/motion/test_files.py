"""Measured motions out of files, poses, point-to-point motions and limits that motions exceed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, InputError, ReachError, UnknownNameError
from eomgen.kernel.inverse_kinematics.rotations import rotation_matrices, rpy_of, vector_of
from eomgen.motion import inverse_kinematics
from eomgen.motion.csv_columns import read_csv
from eomgen.motion.exceeding import ROUND_OFF, Excess, excess_notes, excesses
from eomgen.motion.files import MeasuredMotion, motion_from_columns, read_motion, write_motion
from eomgen.motion.point_to_point import PointToPoint
from eomgen.motion.turns import rotation_of, spherical, spherical_spline
from eomgen.robot.bounds import Limits
from eomgen.robot.geometry import rotation_from_rpy
from eomgen.robot.value import Coordinate, Coupling, Joint, Link, Motor, Robot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused
from tests.support.scaras import scara

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]
NAMES = ("joint1.x", "joint1.gamma")


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(
        "# measured on the bench\n t , joint1.gamma,joint1.gamma.rate, joint1.gamma.drive\n"
        "0,0.1,1.5,-2\n\n# pause\n0.5,1e-3,2,3.25\n"
    )
    motion = read_motion(path, NAMES)
    assert motion.t.tolist() == [0.0, 0.5]
    assert motion.q.tolist() == [[0.0, 0.1], [0.0, 1e-3]]
    assert motion.v.tolist() == [[0.0, 1.5], [0.0, 2.0]]
    assert motion.a is None
    assert motion.u.tolist() == [[0.0, -2.0], [0.0, 3.25]]
    assert (motion.measured, motion.driven) == (("joint1.gamma",), ("joint1.gamma",))


def test_files_of_countries_with_decimal_commas(tmp_path: Path) -> None:
    """Semicolons and tabs separate values, with decimal points or decimal commas; cells may be empty."""
    path, text = tmp_path / "m.csv", "t, joint1.x,joint1.gamma.drive\n0,0.125,-1.5e-3\n1.012,,+7\n"
    path.write_text(text)
    plain, _ = read_csv(path, blanks=True)
    for mark, separator in ((".", ";"), (".", "\t"), (",", ";"), (",", "\t")):
        head, *rows = text.replace(",", separator).split("\n")
        path.write_text("\n".join([head, *(row.replace(".", mark) for row in rows)]))
        found, lines = read_csv(path, blanks=True)
        assert list(found) == list(plain)
        assert all(np.array_equal(found[name], plain[name], equal_nan=True) for name in plain)
        assert lines.tolist() == [2, 3]
        refused(InputError, "line 3: column 'joint1.x': ''; allowed: a finite number", read_motion, path, NAMES)
    path.write_text('"t";"joint1.x"\n"0,5";-1,5\n')
    assert read_motion(path, NAMES).q.tolist() == [[-1.5, 0.0]]


def test_columns_named_like_joints_are_principal_coordinates(tmp_path: Path) -> None:
    path, principal = tmp_path / "m.csv", {"joint1": "joint1.gamma", "t": "t.gamma"}
    path.write_text("t,joint1,joint1.rate,joint1.drive\n0,0.1,1.5,-2\n0.5,1e-3,2,3.25\n")
    motion = read_motion(path, NAMES, principal=principal)
    assert (motion.q[:, 1].tolist(), motion.v[:, 1].tolist(), motion.driven) == ([0.1, 1e-3], [1.5, 2.0], NAMES[1:])
    refused(InputError, r"m\.csv: column 'joint1' is unknown", read_motion, path, NAMES)
    path.write_text("t,joint1.gamma,joint1\n0,0.1,1.5\n")
    with pytest.raises(
        InputError, match=r"m\.csv: columns 'joint1' and 'joint1\.gamma' are one coordinate; allowed: one"
    ):
        read_motion(path, NAMES, principal=principal)


@pytest.mark.parametrize("with_rates", [True, False])
def test_what_is_written_is_read_to_the_bit(with_rates: bool, tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    q, v, a, u = random.normal(size=(4, 30, 2)) * 10.0 ** random.integers(-12, 9, (4, 30, 2))
    motion = MeasuredMotion(
        coordinates=NAMES,
        t=np.cumsum(random.uniform(1e-3, 1.0, 30)),
        q=q,
        v=v if with_rates else None,
        a=a if with_rates else None,
        u=np.where([False, True], u, 0.0),
        measured=NAMES,
        driven=NAMES[1:],
    )
    path = write_motion(tmp_path / "m.csv", motion, ["one", "two"])
    assert path.read_text().startswith("# one\n# two\nt,joint1.x,joint1.gamma,")
    again = read_motion(path, NAMES)
    for name in ("t", "q", "v", "a", "u"):
        ours, theirs = getattr(motion, name), getattr(again, name)
        assert (ours is None) == (theirs is None)
        assert ours is None or ours.tobytes() == theirs.tobytes(), name
    assert (again.measured, again.driven) == (NAMES, NAMES[1:])
    refused(InputError, r"m\.npz'; allowed: a path that ends in \.csv", write_motion, tmp_path / "m.npz", motion)


def test_npz_of_columns_and_of_a_simulation(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 5)
    np.savez(tmp_path / "a.npz", t=t, **{"joint1.x": t**2})
    assert np.array_equal(read_motion(tmp_path / "a.npz", NAMES).q[:, 0], t**2)
    from eomgen.simulation.run import simulate

    result = simulate(eomgen.load_robot("one_link"), duration=0.1)
    motion = read_motion(result.save(tmp_path / "trajectory.npz"), NAMES)
    for name in ("t", "q", "v", "u"):
        assert np.array_equal(getattr(motion, name), getattr(result.trajectory, name))
    assert motion.measured == NAMES


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("has no values", "header")),
        ("t,joint1.x\n", ("has no values",)),
        ("t,joint1.x\n0,1\n1,abc\n", ("line 3", "'joint1.x'", "'abc'", "finite number")),
        ("t,joint1.x\n0,1\n1,nan\n", ("line 3", "'joint1.x'", "'nan'", "finite number")),
        ("t,joint1.x\n0,1\n# c\n1\n", ("line 4", "1 values", "allowed: 2")),
        ("t,joint1.x\n0,1\n1,1\n1,2\n", ("line 4", "'t'", "1 after 1", "increasing")),
        ("t,joint1.x,joint1.x\n0,1,1\n", ("line 1", "column 3", "twice")),
        ("t,joint1.w\n0,1\n", ("'joint1.w'", "did you mean 'joint1.x'", "allowed: t")),
        ("joint1.x\n0\n", ("no column t",)),
        ("t\n0\n", ("no column is a coordinate", "joint1.x")),
        ("t,joint1.x,joint1.gamma,joint1.x.rate\n0,1,1,1\n", ("joint1.gamma.rate is missing",)),
        ("t,joint1.x,joint1.gamma.rate\n0,1,1\n", ("is missing",)),
        ("t,joint1.x,joint1.x.acceleration\n0,1,1\n", ("accelerations without rates",)),
    ],
)
def test_bad_csv_is_refused_with_its_place(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text)
    raised = refused(InputError, "", read_motion, path, NAMES)
    for word in (str(path), *words):
        assert word in str(raised)


def test_other_bad_files(tmp_path: Path) -> None:
    (tmp_path / "latin.csv").write_bytes(b"t,joint1.x\n0,\xff\n")
    (tmp_path / "no.npz").write_bytes(b"PK nothing")
    np.savez(tmp_path / "short.npz", t=np.arange(3.0), **{"joint1.x": np.arange(2.0)})
    np.savez(tmp_path / "text.npz", t=np.arange(3.0), **{"joint1.x": np.array(["a", "b", "c"])})
    np.savez(tmp_path / "shape.npz", t=np.arange(3.0), q=np.zeros((3, 1)), coordinates=NAMES)
    np.savez(tmp_path / "nan.npz", t=np.arange(3.0), **{"joint1.x": np.array([0.0, np.nan, 1.0])})
    for name, words in (
        ("missing.csv", ("cannot be read",)),
        ("m.txt", ("allowed: a path that ends in .csv or .npz",)),
        ("latin.csv", ("byte 13", "UTF-8")),
        ("no.npz", ("is no .npz",)),
        ("short.npz", ("'joint1.x'", "shape (2,)", "(3,)")),
        ("text.npz", ("'joint1.x'", "dtype <U1")),
        ("shape.npz", ("array q", "(3, 1)", "(3, 2)")),
        ("nan.npz", ("sample 1", "'joint1.x'", "nan")),
    ):
        raised = refused(InputError, "", read_motion, tmp_path / name, NAMES)
        assert all(word in str(raised) for word in words), str(raised)
    refused(InputError, "one length", motion_from_columns, {"t": np.arange(3.0), "joint1.x": np.arange(2.0)}, NAMES)


def arm(seed: int, axes: int) -> Robot:
    return random_robot(seed, types=("revolute",), rigid=True, forces=False, counts=[1] * axes, name="arm")


def with_limits(robot: Robot, low: float, high: float) -> Robot:
    return replace(robot, joints=tuple(replace(x, limits=(low, high)) if x.coordinates else x for x in robot.joints))


@pytest.mark.parametrize("seed", seeds(0, 1, 6))
@pytest.mark.parametrize("axes", [6, 7])
def test_random_arms_reach_random_poses(axes: int, seed: int, built: Build) -> None:
    robot = with_limits(arm(100 * axes + seed, axes), -2.5, 2.5)
    kernel, oracle, rng = built(robot, "kinematics"), PinocchioOracle(robot), np.random.default_rng(seed)
    there = rng.uniform(-2.3, 2.3, (10, axes))
    poses = np.array([oracle.frame_pose(q, "tcp") for q in there])
    near = inverse_kinematics(kernel, poses, robot=robot, guess=np.clip(there + 0.05, -2.5, 2.5))
    far = inverse_kinematics(kernel, poses[:4], robot=robot)
    for found, wanted in ((near, poses), (far, poses[:4])):
        assert found.shape == (len(wanted), axes)
        assert (np.abs(found) <= 2.5 + 1e-9).all()
        assert max(np.abs(oracle.frame_pose(q, "tcp") - T).max() for q, T in zip(found, wanted, strict=True)) < 1e-10
    assert np.array_equal(inverse_kinematics(kernel, poses[1], robot=robot), far[1])
    if axes == 7:  # the change from the guess is the least: nothing of it leaves the tool where it is
        small = inverse_kinematics(kernel, poses[0], robot=robot, guess=there[0] + 1e-4) - there[0] - 1e-4
        idle = np.linalg.svd(kernel.frame_jacobian(there[0], "tcp"))[2][-1]
        assert abs(idle @ small) < 1e-3 * np.linalg.norm(small)


def test_limits_are_kept_by_the_other_joints(built: Build) -> None:
    """A redundant arm goes another way where the least motion would leave a limit; without limits it does not."""
    robot = arm(703, 7)
    kernel, rng = built(robot, "kinematics"), np.random.default_rng(0)
    there = rng.uniform(-0.6, 0.6, 7)
    guess, pose = np.zeros(7), kernel.frame_pose(there, "tcp")
    free = inverse_kinematics(kernel, pose, robot=robot, guess=guess)
    j = int(np.abs(free - there).argmax())
    stop = 0.3 * there[j] + 0.7 * free[j]
    limits = (-3.0, float(stop)) if free[j] > stop else (float(stop), 3.0)
    joints = tuple(replace(x, limits=limits) if f"{x.name}.gamma" == kernel.coordinates[j] else x for x in robot.joints)
    bounded = replace(robot, joints=joints)
    kept = inverse_kinematics(kernel, pose, robot=bounded, guess=guess)
    assert limits[0] - 1e-9 <= kept[j] <= limits[1] + 1e-9 < 3.1
    assert np.abs(kernel.frame_pose(kept, "tcp") - pose).max() < 1e-10
    assert np.array_equal(inverse_kinematics(kernel, pose, robot=bounded, guess=guess, limits=False), free)
    given = np.tile([-np.inf, np.inf], (7, 1))
    given[j] = limits
    assert np.array_equal(inverse_kinematics(kernel, pose, guess=guess, limits=given), kept)
    with pytest.raises(ReachError, match=r"gets as near as .* mm and .* deg; .* is at its limit -?0\.05 rad") as caught:
        inverse_kinematics(kernel, pose, robot=with_limits(robot, -0.05, 0.05), guess=guess)
    nearest = kernel.frame_pose(caught.value.q, "tcp")
    assert np.linalg.norm(nearest[:3, 3] - pose[:3, 3]) == pytest.approx(caught.value.distance)
    turn = 0.5 * (np.trace(nearest[:3, :3].T @ pose[:3, :3]) - 1.0)
    assert np.arccos(turn) == pytest.approx(caught.value.angle, abs=1e-6)
    assert np.abs(caught.value.q).max() <= 0.05


def test_a_scara_cannot_tilt_its_tool(built: Build) -> None:
    robot = robot_from_toml(scara())
    kernel = built(robot, "kinematics")
    pose = kernel.frame_pose([0.3, 0.8, 0.1, -0.4], "tcp")
    assert np.abs(kernel.frame_pose(inverse_kinematics(kernel, pose, robot=robot), "tcp") - pose).max() < 1e-10
    c, s = np.cos(0.2), np.sin(0.2)
    tilted = pose @ np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    with pytest.raises(ReachError, match=r"scara: tcp does not reach .* m, rpy .* rad: .* 11\.46 deg") as caught:
        inverse_kinematics(kernel, tilted, robot=robot)
    assert caught.value.angle == pytest.approx(0.2, abs=1e-6)
    assert caught.value.distance < 1e-6
    point = inverse_kinematics(kernel, tilted[:3, 3], robot=robot)
    assert np.abs(kernel.frame_pose(point, "tcp")[:3, 3] - tilted[:3, 3]).max() < 1e-10
    assert pickled(caught.value).angle == caught.value.angle


def pickled(error: ReachError) -> ReachError:
    import pickle

    found = pickle.loads(pickle.dumps(error))
    assert isinstance(found, ReachError)
    assert str(found) == str(error)
    return found


@pytest.mark.soak
def test_a_platform_takes_a_pose() -> None:
    """Drives free, loops closed; legs within their limits."""
    robot = eomgen.load_robot("gough")
    kernel = eomgen.build(robot)
    pose = np.eye(4)
    turn = eomgen.robot.rotation_from_rpy((0.1, -0.05, 0.15))
    pose[:3, :3], pose[:3, 3] = turn, [0.05, -0.04, 1.15]
    q = inverse_kinematics(kernel, pose, robot=robot)
    assert np.abs(kernel.frame_pose(q, "tcp") - pose).max() < 1e-10
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-11
    legs = [kernel.coordinates.index(name) for name in robot.driven or ()]
    low = tuple(
        replace(x, limits=(1.0, float(q[legs].max()) - 0.01)) if x.name.startswith("leg") else x for x in robot.joints
    )
    with pytest.raises(ReachError, match=r"gets as near as .* mm and .* deg; .*leg\d\.z is at its limit") as caught:
        inverse_kinematics(kernel, pose, robot=replace(robot, joints=low))
    assert caught.value.q[legs].max() <= q[legs].max() - 0.01 + 1e-9
    assert np.abs(kernel.functions.constraint(caught.value.q)).max() < 1e-11
    pose[2, 3] = 9.0
    with pytest.raises(ReachError, match=r"gets as near as|loops do not close|not within"):
        inverse_kinematics(kernel, pose, robot=replace(robot, joints=low))


def test_what_cannot_be_asked(built: Build) -> None:
    robot = robot_from_toml(scara())
    kernel = built(robot, "kinematics")
    for wrong in (np.eye(3)[:2, :2], np.full(3, np.nan), "here", 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])):
        refused(ArrayError, "pose", inverse_kinematics, kernel, wrong)
    refused(ArrayError, r"guess: .*allowed", inverse_kinematics, kernel, np.eye(4), guess=[0.0])
    refused(ArrayError, r"limits: .*allowed", inverse_kinematics, kernel, np.eye(4), limits=[0.0, 1.0])
    with pytest.raises(UnknownNameError, match="frame: 'hand' is unknown; known: tcp"):
        inverse_kinematics(kernel, np.eye(4), frame="hand")
    refused(InputError, "other coordinates", inverse_kinematics, kernel, np.eye(4), robot=eomgen.load_robot("ur5"))


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
    refused(kind, text, PointToPoint, *values)


def test_a_time_is_a_number() -> None:
    refused(ArrayError, "t: holds NaN", MOTION.at, [0.0, np.nan])


def test_angles_of_numpy_are_angles() -> None:
    exact = rotation_from_rpy((0.0, 1.0, 2.0))
    for rpy in (np.array([0, 1, 2]), np.array([0.0, 1.0, 2.0], np.float32), [np.int32(0), 1.0, 2]):
        assert rotation_from_rpy(rpy) == exact  # type: ignore[arg-type]
    for wrong in ((0.0, np.nan, 0.0), (0.0, np.inf, 0.0), (10**400, 0.0, 0.0), ("1", "2", "3"), (0.0, 1.0)):
        refused(InputError, r"^rpy: .*three numbers of magnitude up to 1e\+30, rad", rotation_from_rpy, wrong)


def test_vectors_and_rotations_are_those_of_scipy() -> None:
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(400, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, np.newaxis]
    angles = np.concatenate(
        [rng.uniform(0.0, np.pi, 100), 10.0 ** rng.uniform(-9, -2, 100), np.pi - 10.0 ** rng.uniform(-9, 0, 200)]
    )
    vectors = angles[:, np.newaxis] * axes
    theirs = Rotation.from_rotvec(vectors).as_matrix()
    assert np.abs(rotation_of(vectors) - theirs).max() < 1e-14
    back = np.array([vector_of(R) for R in theirs])
    assert np.abs(back - vectors).max() < 1e-8  # near a half turn matrices know the axis to the root of round-off
    assert np.abs(rotation_of(back) - theirs).max() < 1e-14
    assert np.linalg.norm(vector_of(np.diag([1.0, -1.0, -1.0]))) == pytest.approx(np.pi, abs=1e-15)
    for rpy in (*rng.uniform(-1.5, 1.5, (20, 3)), (0.3, np.pi / 2, 0.0), (-0.4, -np.pi / 2, 0.0)):
        given = np.array(rotation_from_rpy((float(rpy[0]), float(rpy[1]), float(rpy[2]))))
        assert np.abs(given - Rotation.from_euler("xyz", rpy).as_matrix()).max() < 1e-15
        assert np.abs(rpy_of(given) - rpy).max() < 1e-12


def test_a_turn_is_scipys_slerp() -> None:
    for seed in range(5):
        ends = Rotation.random(2, random_state=seed)
        parts = np.linspace(0.0, 1.0, 21)
        found = spherical(*ends.as_matrix(), parts)
        assert np.abs(found - Slerp([0.0, 1.0], ends)(parts).as_matrix()).max() < 1e-14


def test_a_spline_of_orientations() -> None:
    """Passes its knots, rests at its ends, turns about one axis as its angles' spline, and has smooth rates."""
    knots, given = np.array([0.0, 0.4, 0.7, 1.5]), Rotation.random(4, random_state=1)
    assert np.abs(spherical_spline(knots, given.as_matrix(), knots) - given.as_matrix()).max() < 1e-14
    two = spherical_spline(np.array([0.0, 2.0]), given.as_matrix()[:2], np.linspace(0.0, 2.0, 11))
    r = np.linspace(0.0, 1.0, 11)
    assert np.abs(two - Slerp([0.0, 1.0], given[:2])(10 * r**3 - 15 * r**4 + 6 * r**5).as_matrix()).max() < 1e-13
    h = 1e-4
    t = np.arange(2, 15000 - 1) * h

    def rate(at: np.ndarray) -> np.ndarray:
        ahead, behind = (spherical_spline(knots, given.as_matrix(), at + x) for x in (h, -h))
        turned: np.ndarray = Rotation.from_matrix(ahead @ np.swapaxes(behind, 1, 2)).as_rotvec() / (2 * h)
        return turned

    velocity = rate(t)
    acceleration = np.diff(velocity, axis=0) / h
    assert np.abs(np.diff(velocity, axis=0)).max() < 1e-2 * np.abs(velocity).max()
    assert np.abs(np.diff(acceleration, axis=0)).max() < 1e-2 * np.abs(acceleration).max()  # no jump at a knot
    assert np.abs(velocity[[0, -1]]).max() < 1e-4 * np.abs(velocity).max()


@pytest.mark.parametrize(
    "wrong", [np.eye(4), np.diag([1.0, 1.0, -1.0]), 1.1 * np.eye(3), [["x"]], np.full((3, 3), np.nan)]
)
def test_what_is_no_rotation(wrong: object) -> None:
    refused(ArrayError, r"axes: .*allowed: ", rotation_matrices, "axes", wrong)


LIMITS = Limits(-0.5, 2.0, 3.0, 4.0)


def robot(limits: Limits = LIMITS) -> Robot:
    """A rod that a motor turns through a gear of -10, and a slide in front of it."""
    rod = Link("rod", 1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    motor = Motor(1e-3, -10.0, Coordinate(stiffness=1e4), limits=Limits(velocity=20.0))
    hinge = Joint("hinge", "sled", "rod", "revolute", coordinates={"gamma": Coordinate()}, motor=motor)
    slide = Joint("slide", "base", "sled", "prismatic", coordinates={"z": Coordinate()})
    sled = replace(rod, name="sled")
    return Robot("arm", (0.0, 0.0, 0.0), (sled, rod), (slide, hinge.with_limits("gamma", limits)))


def test_the_worst_of_each_is_told() -> None:
    t = np.linspace(0.0, 1.0, 11)
    q = np.zeros((11, 3))
    q[3, 1], q[5, 1], q[7] = -0.7, 2.1, 1.0
    v, u = np.zeros((11, 3)), np.zeros((11, 3))
    v[4, 1], v[6, 2] = -3.5, 19.0
    u[8, 2], u[9] = -0.5, 0.3  # at the motor, where 4 N m at the joint are 0.4
    names = ("slide.z", "hinge.gamma", "hinge.motor")
    found = excesses(robot(), names, t=t, q=q, v=v, u=u)
    assert found == (
        Excess("hinge.gamma", "position", -0.7, -0.5, "rad", t[3]),
        Excess("hinge.gamma", "speed", -3.5, 3.0, "rad/s", t[4]),
        Excess("hinge.motor", "effort", -0.5, 0.4, "N m", t[8]),
    )
    (note,) = excess_notes("the motion", found)
    assert note == (
        "the motion exceeds limits of the robot: hinge.gamma position -0.7 rad at 0.3 s (limit -0.5), hinge.gamma speed"
        " -3.5 rad/s at 0.4 s (limit 3), hinge.motor effort -0.5 N m at 0.8 s (limit 0.4)"
    )
    assert excess_notes("the motion", ()) == ()
    assert "and 1 more" in excess_notes("it", found * 3)[0]


@pytest.mark.parametrize(("part", "tells"), [(0.5, False), (2.0, True)])
def test_round_off_is_within(part: float, tells: bool) -> None:
    beyond = part * ROUND_OFF
    names = ("slide.z", "hinge.gamma", "hinge.motor")
    for rows in (
        {"q": np.array([[0.0, 2.0 * (1.0 + beyond), 0.0]])},
        {"v": np.array([[0.0, -3.0 * (1.0 + beyond), 0.0]])},
        {"u": np.array([[0.0, 0.0, 0.4 * (1.0 + beyond)]])},
    ):
        assert bool(excesses(robot(), names, **rows)) == tells
    open_end = robot(Limits(upper=0.0))
    assert bool(excesses(open_end, names, q=np.array([[0.0, beyond, 0.0]]))) == tells
    assert not excesses(open_end, names, q=np.array([[0.0, -1e9, 0.0]]))
    assert not excesses(robot(Limits()), names, q=np.full((1, 3), 1e3), v=np.full((1, 3), 19.0), u=np.full((1, 3), 1e3))


def test_followers_have_limits_of_their_own() -> None:
    """A finger at -2 times its leader plus 0.1: position and speed, by the coupling's numbers."""
    rod = Link("one", 1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    joints = [Joint(x, "base", x, "revolute", coordinates={"gamma": Coordinate()}) for x in ("one", "two")]
    joints[1] = joints[1].with_limits("gamma", LIMITS)
    gear = Coupling("gear", "two.gamma", {"one.gamma": -2.0}, 0.1)
    hand = Robot("hand", (0.0, 0.0, 0.0), (rod, replace(rod, name="two")), tuple(joints), couplings=(gear,))
    q, v = np.array([[0.0], [0.4], [-0.9]]), np.array([[1.6], [0.0], [0.0]])
    assert excesses(hand, ("one.gamma",), q=q, v=v) == (
        Excess("two.gamma", "position", pytest.approx(-0.7), -0.5, "rad"),
        Excess("two.gamma", "speed", pytest.approx(-3.2), 3.0, "rad/s"),
    )
    assert excesses(hand, ("one.gamma",), q=0.1 * q, v=0.1 * v) == ()
