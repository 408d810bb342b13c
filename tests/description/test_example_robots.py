"""All URDFs of example-robot-data: each ends in a working kernel; policies that refuse say where."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import DescriptionError, EomgenWarning, SingularError
from eomgen.robot.value import Robot
from tests.oracles.pinocchio_models import PinocchioOracle, UrdfOracle
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs

pytestmark = pytest.mark.usefixtures("unoptimised")

NOTHING_MOVES = {"quadrotor_base.urdf", "iris_simple.urdf", "ur3.urdf"}
EXAMPLES = example_urdfs()
MOVING = [path for path in EXAMPLES if path.name not in NOTHING_MOVES]
WITHOUT_INERTIA = {  # a tip that nothing resists: links of these files have neither mass nor inertia
    "romeo.urdf": r"[LR]\w+\.gamma",
    "romeo_laas_small.urdf": r"[lr]_gripper_joint\.gamma",
}
EVERY_KERNEL = (pytest.param("anymal-kinova.urdf", marks=pytest.mark.soak), "bolt.urdf", "TwoDofs.urdf")
TOLERANCE = 1e-12


def name_of(path: Path) -> str:
    return f"{path.parts[-3]}/{path.name}"


def load(path: Path, inertia: str | None = None) -> Robot:
    """The open tree, as Pinocchio reads it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return eomgen.load_robot(path, inertia=inertia, urdf_mimic=False)


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = TOLERANCE) -> bool:
    return bool(np.abs(found - expected).max() <= tolerance * np.abs(expected).max())


def test_the_examples_are_there() -> None:
    assert len(EXAMPLES) >= 69
    assert {path.name for path in EXAMPLES if path not in MOVING} == NOTHING_MOVES


def diagnosis(path: Path) -> DescriptionError | None:
    """The error with which a file is refused by the strictest policy."""
    try:
        eomgen.load_robot(path, inertia="error")
    except DescriptionError as error:
        return error
    return None


def quick(paths: list[Path]) -> list[Any]:
    """The paths; large robots, and more than one of a family, are for ``make soak``."""
    families, found = set(), list[Any]()
    for path in paths:
        joints = len(re.findall(r'<joint [^>]*type="[rcp]', path.read_text(encoding="utf-8")))
        kept = joints <= 7 and path.parts[-3] not in families
        families |= {path.parts[-3]} if kept else set()
        found.append(path if kept else pytest.param(path, marks=pytest.mark.soak))
    return found


@pytest.mark.parametrize("path", MOVING, ids=name_of)
def test_what_is_strange_in_an_example_is_said(path: Path) -> None:
    robot, error = load(path), diagnosis(path)
    assert any("no body can have" in note for note in robot.notes) == (error is not None)
    if error is not None:
        assert re.fullmatch(r"links\.[A-Za-z0-9_]+\.inertia", error.where)
        assert str(error).startswith(f"{path}:{error.line}:{error.column}: {error.where}: ")
        assert path.read_text(encoding="utf-8").splitlines()[error.line - 1].strip().startswith("<link")


@pytest.mark.parametrize("path", quick(MOVING), ids=name_of)
def test_example_ends_in_a_kernel(path: Path, built: Build) -> None:
    """With inertias as they are, which is the default, it equals Pinocchio."""
    robot = load(path)
    kernel = built(robot, "inverse_dynamics", "mass_matrix", "forward_dynamics")
    oracle, rng = UrdfOracle(path), np.random.default_rng(7)
    for _ in range(2):
        q, v, a, u = rng.uniform(-2, 2, (4, kernel.n))
        M = oracle.mass_matrix(q)
        assert close(kernel.mass_matrix(q), M)
        assert close(kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a))
        if path.name in WITHOUT_INERTIA:
            with pytest.raises(SingularError, match=WITHOUT_INERTIA[path.name]):
                kernel.forward_dynamics(q, v, u)
        else:
            limit = 100 * np.linalg.cond(M) * np.finfo(float).eps
            assert close(kernel.forward_dynamics(q, v, u), oracle.forward_dynamics(q, v, u), limit)


@pytest.mark.parametrize("path", quick([path for path in MOVING if diagnosis(path) is not None]), ids=name_of)
def test_projected_robots_work(path: Path, built: Build) -> None:
    """Where a link is no body: the nearest possible body gives a kernel too, of the robot as it then is."""
    robot = load(path, "project")
    assert any("projected to" in note for note in robot.notes)
    kernel, oracle = built(robot, "inverse_dynamics", "mass_matrix"), PinocchioOracle(robot)
    q, v, a = np.random.default_rng(8).uniform(-2, 2, (3, kernel.n))
    assert close(kernel.mass_matrix(q), oracle.mass_matrix(q))
    assert close(kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a))
    assert np.linalg.eigvalsh(kernel.mass_matrix(q))[0] >= -1e-12 * np.abs(kernel.mass_matrix(q)).max()


@pytest.mark.soak
@pytest.mark.parametrize("name", EVERY_KERNEL)
def test_every_kernel_of_some_examples(name: str, built: Build) -> None:
    path = next(path for path in MOVING if path.name == name)
    robot = load(path, "warn")
    kernel, oracle = built(robot), PinocchioOracle(robot)
    q, v, a = np.random.default_rng(9).uniform(-2, 2, (3, kernel.n))
    force = oracle.inverse_dynamics(q, v, a)
    size = np.abs(force).max() + np.abs(oracle.generalized_force(q, v)).max()
    assert np.abs(kernel.bias_force(q, v) - oracle.bias_force(q, v)).max() <= TOLERANCE * size
    assert np.abs(kernel.generalized_force(q, v) - oracle.generalized_force(q, v)).max() <= TOLERANCE * size
    assert np.abs(kernel.residual(q, v, a, force)).max() <= TOLERANCE * size
    assert np.abs(np.einsum("svw,v,w", kernel.christoffel(q), v, v) - oracle.bias_force(q, v)).max() <= TOLERANCE * size
    assert np.abs(kernel.coriolis_matrix(q, v) @ v - oracle.bias_force(q, v)).max() <= TOLERANCE * size
    assert close(kernel.energy(q, v), oracle.energy(q, v))
    assert close(kernel.reactions(q, v, a), oracle.reactions(q, v, a))
    for frame in kernel.frames:
        assert np.abs(kernel.frame_pose(q, frame) - oracle.frame_pose(q, frame)).max() <= 1e-13
        assert np.abs(kernel.frame_jacobian(q, frame) - oracle.frame_jacobian(q, frame)).max() <= 1e-13


def test_foreign_names_reach_the_kernel_as_identifiers(built: Build) -> None:
    """Names such as "base_link-arm" are mapped, and found again in the kernel."""
    changed = [path for path in MOVING if any("turned into identifiers" in note for note in load(path, "warn").notes)]
    assert changed
    for path in changed[:1]:
        kernel = built(load(path, "warn"), "inverse_dynamics", "mass_matrix", "forward_dynamics")
        for name in (*kernel.joints, *kernel.links, *kernel.frames):
            assert re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name)
