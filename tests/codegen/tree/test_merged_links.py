"""Links behind fixed joints: their merged inertia and frames, compared with 60-digit arithmetic of the description."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.codegen.tree.spatial import Pose, vec3
from eomgen.description.load import robot_from_toml
from eomgen.robot.geometry import IDENTITY, rotation_from_rpy
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.long_mass_matrix import exact_mass_matrix, long_pose
from tests.oracles.roundings import mp
from tests.support.joint_table import frame_table, joint_table, link_table

pytestmark = pytest.mark.quick

Array = np.ndarray[Any, Any]
WITHIN = 1e-12  # of sqrt(M_ii M_jj), or of the norm of a tensor


def _seen(R: Array, p: Array, point: Array) -> list[float]:
    """Return a point as seen from a frame at p with the axes R."""
    return [float(x) for x in R.T @ (point - p)]


def _placement(xyz: Sequence[float], rpy: Array) -> str:
    return f"placement = {{ xyz = {list(xyz)}, rpy = {list(map(float, rpy))} }}"


def _link(rng: np.random.Generator, name: str, com: Sequence[float]) -> str:
    A = rng.uniform(-0.1, 0.1, (3, 3))
    inertia = np.trace(A @ A.T) * np.eye(3) - A @ A.T
    entries = [float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return link_table(name, rng.uniform(0.1, 2.0), com, entries)


def far_tree(seed: int, tunable: Sequence[str] = (), bodies: int = 3, welds: int = 4) -> Robot:
    """Return a tree of bodies of welded links, whose frames are 1 m to 1 km from the masses; a frame near each mass."""
    rng = np.random.default_rng(seed)
    tables, frames = [f'name = "far{seed}"\ntunable = {list(tunable)}'], [("base", np.eye(3), np.zeros(3))]
    for k in range(bodies):
        parent, R, p = frames[rng.integers(len(frames))]
        frames = [(f"body{k}", np.eye(3), np.zeros(3))]
        tables += [_link(rng, f"body{k}", list(rng.uniform(-0.3, 0.3, 3)))]
        tables += [joint_table(f"joint{k}", parent, f"body{k}", ("revolute", "prismatic")[rng.integers(2)])]
        tables += [_placement(_seen(R, p, rng.uniform(-0.5, 0.5, 3)), rng.uniform(-3.0, 3.0, 3))]
        for i in range(welds):
            parent, R, p = frames[rng.integers(len(frames))]
            name, away, rpy = f"body{k}_{i}", rng.normal(size=3), rng.uniform(-3.0, 3.0, 3)
            far = 10.0 ** rng.uniform(0.0, 3.0) * away / np.linalg.norm(away)
            tables += [joint_table(f"weld{k}_{i}", parent, name, "fixed"), _placement(_seen(R, p, far), rpy)]
            R, p = R @ np.array(rotation_from_rpy(tuple(rpy))), far
            tables += [_link(rng, name, _seen(R, p, rng.uniform(-0.3, 0.3, 3)))]
            tables += [frame_table(f"near{k}_{i}", name, _seen(R, p, rng.uniform(-0.3, 0.3, 3)))]
            frames.append((name, R, p))
    return robot_from_toml("\n".join(tables))


@pytest.mark.parametrize("seed", range(12))
def test_mass_matrices_of_links_that_are_far_from_their_frames_are_exact_to_1e_12(seed: int) -> None:
    robot = far_tree(seed)
    model, rng = build_model(robot), np.random.default_rng(seed)
    q = [mp.mpf(x) for x in rng.uniform(-2.0, 2.0, model.size)]
    program = derive(model, "mass_matrix")
    found = evaluate(program, {"q": q}, lambda x: (mp.sin(x), mp.cos(x)))
    exact, n = exact_mass_matrix(robot, q), model.size
    for i in range(n):
        for j in range(n):
            assert abs(found["out", n * i + j] - exact[i, j]) <= WITHIN * mp.sqrt(exact[i, i] * exact[j, j])


@pytest.mark.parametrize("seed", range(12))
def test_merged_inertias_and_frames_are_the_exact_ones_rounded(seed: int) -> None:
    """About the merged mass centre; frames are near the masses, seen through frames that are far away."""
    robot = far_tree(seed)
    d = Derivation(build_model(robot), regrouped=False)
    own = {body.name: mp.eye(4) for body in d.model.bodies}
    body_of = {name: name for name in own}
    for joint in robot.joints:
        if joint.parent in own and not joint.coordinates:
            own[joint.child] = own[joint.parent] * long_pose(joint.placement.rotation, joint.placement.xyz)
            body_of[joint.child] = body_of[joint.parent]
    for body, bound in zip(d.model.bodies, d.bound.bodies, strict=True):
        links = [link for link in robot.links if body_of[link.name] == body.name]
        H = mp.matrix([[*row, x] for row, x in zip(bound.inertia.second, bound.inertia.first, strict=True)])
        exact = mp.zeros(3, 4)
        for link in links:
            R, com = own[link.name][:3, :3], (own[link.name] * mp.matrix([*link.com, 1]))[:3]
            xx, yy, zz, xy, xz, yz = link.inertia
            tensor = mp.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            second = R * ((xx + yy + zz) / mp.mpf(2) * mp.eye(3) - tensor) * R.T + link.mass * com * com.T
            for i in range(3):
                exact[i, 3] += link.mass * com[i]
                for j in range(3):
                    exact[i, j] += second[i, j]
        masses = mp.fsum(link.mass for link in links)
        found, meant = (X[:, :3] - X[:, 3] * X[:, 3].T / masses for X in (H, exact))
        assert mp.mnorm(found - meant, 1) <= WITHIN * mp.mnorm(meant, 1)
    for frame in robot.frames:
        exact = own[frame.link] * long_pose(frame.placement.rotation, frame.placement.xyz)
        found = d.bound.frames[frame.name][1]
        assert mp.mnorm(long_pose(found.rotation, found.origin) - exact, "f") <= 1e-15


def test_components_that_are_zero_but_for_rounding_of_the_description_are_zero() -> None:
    """0.3 + 0.4 - 0.7 = 6e-17 of the nearest floats, and right angles that two joints make together."""
    there = Pose(IDENTITY, (0.3, 1e-17, 0.0)).exact() @ Pose(IDENTITY, (0.4, 0.0, 0.0))
    assert (there @ Pose(IDENTITY, (-0.7, 0.0, 0.0))).rounded().origin == (0.0, 1e-17, 0.0)
    eighth = Pose(rotation_from_rpy((0.0, 0.0, np.pi / 4)), (0.0, 0.0, 0.0))
    assert (eighth.exact() @ eighth).rounded().rotation == rotation_from_rpy((0.0, 0.0, np.pi / 2))
    assert (eighth @ eighth).rotation != rotation_from_rpy((0.0, 0.0, np.pi / 2))


def test_products_of_poses_are_rounded_once() -> None:
    far = Pose(rotation_from_rpy((0.3, 0.4, 0.5)), (1e3, -1e3, 1e3))
    back = Pose(IDENTITY, vec3(_seen(np.array(far.rotation), np.array(far.origin), np.array([0.01, 0.02, 0.03]))))
    exact = long_pose(far.rotation, far.origin) * long_pose(back.rotation, back.origin)
    product = (far.exact() @ back).rounded()
    assert product.origin == tuple(float(exact[i, 3]) for i in range(3))
    assert (far @ back).origin != product.origin


def test_tunable_numbers_of_merged_links_stay_run_time_values() -> None:
    robot = far_tree(3, tunable=["links.body0_0.*", "joints.weld1_1.placement.*"])
    model, rng = build_model(robot), np.random.default_rng(3)
    q = list(map(mp.mpf, rng.uniform(-2.0, 2.0, model.size)))
    given = {"q": q, "p": list(map(mp.mpf, model.parameters.values()))}
    found = evaluate(derive(model, "mass_matrix"), given, lambda x: (mp.sin(x), mp.cos(x)))
    exact = exact_mass_matrix(robot, q)
    for i in range(model.size):
        assert abs(found["out", (model.size + 1) * i] - exact[i, i]) <= 1e-9 * exact[i, i]
