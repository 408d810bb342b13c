"""Point-to-point motions, interpolations of orientations beside SciPy's, and limits that motions exceed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from eomgen.errors import ArrayError, InputError
from eomgen.motion.exceeding import ROUND_OFF, Excess, excess_notes, excesses
from eomgen.motion.point_to_point import PointToPoint
from eomgen.motion.turns import rotation_of, spherical, spherical_spline
from eomgen.robot.bounds import Limits
from eomgen.robot.geometry import rotation_from_rpy
from eomgen.robot.value import Coordinate, Coupling, Joint, Link, Motor, Robot
from eomgen.runtime.inverse_kinematics.rotations import rotation_matrices, rpy_of, vector_of

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


def test_angles_of_numpy_are_angles() -> None:
    exact = rotation_from_rpy((0.0, 1.0, 2.0))
    for rpy in (np.array([0, 1, 2]), np.array([0.0, 1.0, 2.0], np.float32), [np.int32(0), 1.0, 2]):
        assert rotation_from_rpy(rpy) == exact  # type: ignore[arg-type]
    for wrong in ((0.0, np.nan, 0.0), (0.0, np.inf, 0.0), (10**400, 0.0, 0.0), ("1", "2", "3"), (0.0, 1.0)):
        with pytest.raises(InputError, match=r"^rpy: .*three numbers of magnitude up to 1e\+30, rad"):
            rotation_from_rpy(wrong)  # type: ignore[arg-type]


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
    with pytest.raises(ArrayError, match=r"axes: .*allowed: "):
        rotation_matrices("axes", wrong)  # type: ignore[arg-type]


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
