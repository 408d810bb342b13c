"""Rotations as vectors, and interpolations of orientations, beside SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from eomgen.errors import ArrayError, InputError
from eomgen.motion.turns import rotation_of, spherical, spherical_spline
from eomgen.robot.geometry import rotation_from_rpy
from eomgen.runtime.inverse_kinematics.rotations import rotation_matrices, rpy_of, vector_of

pytestmark = pytest.mark.quick


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
