"""URDFs with mimic joints against Pinocchio's models that know them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio
import pytest

import eomgen
from eomgen.errors import ArrayError, EomgenWarning
from eomgen.motion import inverse_kinematics
from eomgen.motion.ends import principal_limits
from eomgen.robot.value import PRINCIPAL
from tests.support.description_samples import example_urdfs
from tests.support.random_robots import Array

Build = Callable[..., eomgen.Kernel]

KERNELS = ("mass_matrix", "inverse_dynamics", "forward_dynamics", "kinematics")
EXAMPLES = {path.stem: path for path in example_urdfs()}
MIMICS = (
    "panda",
    *(pytest.param(name, marks=pytest.mark.soak) for name in ("baxter", "tiago_pro", "pr2")),
)


def by_name(model: pinocchio.Model) -> tuple[list[str], Callable[[Array], Array]]:
    """Names of the joints that have positions of their own, and what makes Pinocchio's q of these joints' angles."""
    joints = [i for i in range(1, model.njoints) if model.joints[i].shortname() != "JointModelMimic"]

    def placed(angles: Array) -> Array:
        q = pinocchio.neutral(model)
        for i, x in zip(joints, angles, strict=True):
            joint = model.joints[i]
            q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        return q

    return [model.names[i] for i in joints], placed


@pytest.mark.soak
@pytest.mark.parametrize("name", ["talos_full_v2", "romeo"])
@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_mimics_are_projections_of_free_joints(name: str, built: Build) -> None:
    """Pinocchio 4.1 makes no mimic models of these; what it has of their free joints is projected here."""
    path = EXAMPLES[name]
    robot, model = eomgen.load_robot(path, inertia="warn"), pinocchio.buildModelFromUrdf(str(path))
    kernel, data = built(robot, *KERNELS), model.createData()
    names, placed = by_name(model)
    known = [f"{joint}.{PRINCIPAL[robot.joint(joint).type]}" for joint in names]
    assert kernel.follower_names

    def angles(q: Array, v: Array) -> tuple[Array, Array]:
        followers = kernel.followers(q, v)
        moving = {**dict(zip(kernel.coordinates, zip(q, v, strict=True), strict=True)), **followers}
        found = np.array([moving[name][:2] for name in known])
        return found[:, 0], found[:, 1]

    still = np.zeros(kernel.n)
    G = np.array([angles(still, unit)[1] for unit in np.eye(kernel.n)]).T
    assert G.shape == (model.nv, kernel.n)
    rng = np.random.default_rng(4)
    for q, v, a in rng.uniform(-1.0, 1.0, (5, 3, kernel.n)):
        p = placed(angles(q, v)[0])
        M = np.triu(pinocchio.crba(model, data, p))
        M = G.T @ (M + np.triu(M, 1).T) @ G
        assert np.abs(kernel.mass_matrix(q) - M).max() <= 1e-12 * np.abs(M).max()
        drives = G.T @ pinocchio.rnea(model, data, p, G @ v, G @ a)
        assert np.abs(kernel.inverse_dynamics(q, v, a) - drives).max() <= 1e-11 * max(1.0, np.abs(drives).max())


@pytest.mark.parametrize("name", MIMICS)
@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_mimics_are_pinocchios(name: str, built: Build) -> None:
    path = EXAMPLES[name]
    robot, model = eomgen.load_robot(path, inertia="warn"), pinocchio.buildModelFromUrdf(str(path), mimic=True)
    kernel, data = built(robot, *KERNELS), model.createData()
    assert kernel.follower_names
    names, placed = by_name(model)
    order = [names.index(coordinate.rsplit(".", 1)[0]) for coordinate in kernel.coordinates]
    assert sorted(order) == list(range(model.nv))
    back = np.argsort(order)
    rng = np.random.default_rng(4)
    for q, v, a in rng.uniform(-1.0, 1.0, (5, 3, kernel.n)):
        p, rates, accelerations = placed(q[back]), v[back], a[back]
        M = np.triu(pinocchio.crba(model, data, p))
        M = (M + np.triu(M, 1).T)[np.ix_(order, order)]
        size = np.abs(M).max()
        assert np.abs(kernel.mass_matrix(q) - M).max() <= 1e-12 * size
        drives = pinocchio.rnea(model, data, p, rates, accelerations)[order]
        assert np.abs(kernel.inverse_dynamics(q, v, a) - drives).max() <= 1e-11 * max(1.0, np.abs(drives).max())
        pinocchio.framesForwardKinematics(model, data, p)
        for frame in model.frames:
            if frame.type == pinocchio.FrameType.BODY and frame.name in kernel.frames:
                pose = data.oMf[model.getFrameId(frame.name, pinocchio.FrameType.BODY)].homogeneous
                assert np.abs(kernel.frame_pose(q, frame.name) - pose).max() <= 1e-12 * max(1.0, np.abs(pose).max())
        if np.linalg.cond(M) < 1e12:
            assert np.abs(kernel.forward_dynamics(q, v, kernel.inverse_dynamics(q, v, a)) - a).max() <= 1e-8
            expected = np.linalg.solve(M, drives - pinocchio.rnea(model, data, p, rates, 0.0 * a)[order])
            assert np.abs(expected - a).max() <= 1e-8


@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_arrays_of_the_old_length_are_refused_by_name(built: Build) -> None:
    """Followers of a Panda's hand are coordinates with urdf_mimic=False alone."""
    path: Path = EXAMPLES["panda"]
    kernel = built(eomgen.load_robot(path, inertia="warn"), "mass_matrix")
    with pytest.raises(ArrayError, match=r"got shape \(9,\) \(panda_finger_joint2\.z follows others and is none"):
        kernel.mass_matrix(np.zeros(9))
    with pytest.raises(ArrayError, match=r"got shape \(10,\)$"):
        kernel.mass_matrix(np.zeros(10))
    free = built(eomgen.load_robot(path, inertia="warn", urdf_mimic=False), "mass_matrix")
    assert free.mass_matrix(np.zeros(9)).shape == (9, 9)
    assert free.follower_names == ()


@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_the_hand_of_a_panda_reaches_where_it_was(built: Build) -> None:
    """Fingers that follow each other do not hinder inverse kinematics, nor the drives of any state."""
    robot = eomgen.load_robot(EXAMPLES["panda"], inertia="warn")
    kernel = built(robot, "kinematics", "inverse_dynamics")
    ends = np.array([principal_limits(robot, name) for name in kernel.coordinates])
    rng = np.random.default_rng(0)
    for q in rng.uniform(ends[:, 0], ends[:, 1], (25, kernel.n)):
        pose = kernel.frame_pose(q, "panda_hand")
        found = inverse_kinematics(kernel, pose, robot=robot, frame="panda_hand")
        assert np.abs(kernel.frame_pose(found, "panda_hand") - pose).max() <= 1e-6
        assert np.isfinite(kernel.inverse_dynamics(q, q, q)).all()
