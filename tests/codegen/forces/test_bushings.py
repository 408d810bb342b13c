"""Bushings: their coordinates against SciPy's Euler angles, an elastic cut joint of six coordinates, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eomgen.codegen.kernels.equations import derive
from eomgen.description.load import robot_from_toml
from eomgen.errors import SingularError
from eomgen.integration.plan import why_stiff
from eomgen.robot import Bushing, JointDamping, JointStiffness, Placement, Robot
from eomgen.robot.model import build_model
from eomgen.state.springs import fastest_rates
from tests.support.builds import Build
from tests.support.every_element import tree
from tests.support.programs import dense_stage, run, staged
from tests.support.random_robots import random_state, seeds
from tests.support.small_robots import free_body

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]
STIFFNESS, DAMPING = [900.0, 700.0, 800.0, 30.0, 20.0, 10.0], [3.0, 2.0, 1.0, 0.3, 0.2, 0.1]
PLACEMENTS = "placements = [{ xyz = [0.5, 0.1, 0.0], rpy = [0.2, -0.1, 0.3] }, { xyz = [0.1, 0.0, 0.05] }]\n"
NUMBERS = f"stiffness = {STIFFNESS}\ndamping = {DAMPING}\n"
MOUNT = '[[bushings]]\nname = "mount"\nlinks = ["base", "fore"]\n'


def robot_of_text(text: str, hip: str = "") -> Robot:
    return robot_from_toml(tree(hip=hip, beside=text))


@pytest.mark.parametrize("seed", seeds(2, 2, 8))
def test_coordinates_are_those_of_scipy(seed: int, built: Build) -> None:
    """Forces are k e + c e_dot of T Rx Ry Rz, read from poses of both links."""
    robot, rng = robot_of_text(MOUNT + PLACEMENTS + NUMBERS, "x = {}\ny = {}\nalpha = {}\nbeta = {}\n"), None
    kernel, rng = built(robot), np.random.default_rng(seed)
    (mount,) = robot.elements

    def coordinates(q: Array) -> Array:
        poses = []
        for link, placement in zip(mount.links, mount.placements, strict=True):
            local = np.eye(4)
            local[:3, :3], local[:3, 3] = placement.rotation, placement.xyz
            poses.append(kernel.frame_pose(q, link) @ local)
        seen = np.linalg.solve(poses[0], poses[1])
        return np.concatenate([seen[:3, 3], Rotation.from_matrix(seen[:3, :3]).as_euler("XYZ")])

    for q, v in rng.uniform(-0.4, 0.4, (3, 2, kernel.n)):
        e, step = coordinates(q), 1e-6
        J = np.array([coordinates(q + step * x) - coordinates(q - step * x) for x in np.eye(kernel.n)]).T / (2.0 * step)
        resisting = np.array(STIFFNESS) * e + np.array(DAMPING) * (J @ v)
        assert kernel.element_rows == tuple(f"mount.{x}" for x in ("x", "y", "z", "alpha", "beta", "gamma"))
        np.testing.assert_allclose(kernel.functions.element_forces(q, v)[:, 0], e, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(kernel.functions.element_jacobian(q), J, atol=1e-9)
        np.testing.assert_allclose(kernel.functions.element_forces(q, v)[:, 1], resisting, rtol=1e-7, atol=1e-7)
        idle = kernel.replaced(parameters={name: 0.0 for name in kernel.parameters if name.startswith("bushings.")})
        there = kernel.inverse_dynamics(q, v, 0.0 * q) - idle.inverse_dynamics(q, v, 0.0 * q)
        np.testing.assert_allclose(there, J.T @ resisting, rtol=1e-7, atol=1e-6)
        stored = kernel.energy(q, v)[1] - idle.energy(q, v)[1]
        np.testing.assert_allclose(stored, 0.5 * np.sum(np.array(STIFFNESS) * e**2), rtol=1e-12)


def test_what_does_not_act_is_in_no_equation(built: Build) -> None:
    """A zero is no parameter, and neither value nor row is computed for it; tunable makes it one."""
    along = robot_of_text(MOUNT + "stiffness = [900.0, 0, 0, 0, 0, 0]\n")
    kernel = built(along)
    assert kernel.element_rows == ("mount.x",)
    assert [name for name in kernel.parameters if name.startswith("bushings.")] == ["bushings.mount.stiffness.x"]
    assert kernel.operations["residual"]["div"] == 0
    text = tree(beside=MOUNT + "stiffness = [900.0, 0, 0, 0, 0, 0]\n")
    tuned = build_model(robot_from_toml('tunable = ["bushings.mount.damping.y"]\n' + text))
    assert tuned.parameters["bushings.mount.damping.y"] == 0.0


def test_a_pole_is_named(built: Build) -> None:
    half = "rpy = [1.5707963267948966, 0.0, 0.0]"  # so that the hip turns about y of the first frame
    placed = f"placements = [{{ {half} }}, {{ {half} }}]\n"
    kernel = built(robot_of_text(MOUNT.replace('"fore"', '"upper"') + placed + NUMBERS))
    with pytest.raises(SingularError, match=r"mount is at beta = \+-90 degrees, where its alpha and gamma turn about"):
        kernel.forward_dynamics([-np.pi / 2, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0])


def test_methods_and_sizes_know_its_stiffness(built: Build) -> None:
    robot = robot_of_text(MOUNT + PLACEMENTS + NUMBERS)
    kernel, q = built(robot), np.array([0.1, 0.2, -0.1])
    assert why_stiff(kernel) == "there are springs"
    soft = kernel.replaced(parameters={name: 0.0 for name in kernel.parameters if ".stiffness." in name})
    assert why_stiff(soft) == ""
    heavy = soft.replaced(parameters={name: 1e6 for name in kernel.parameters if ".damping." in name})
    assert "dampers or friction take effect within" in why_stiff(heavy)
    J, M = kernel.functions.element_jacobian(q), kernel.mass_matrix(q)
    swing = np.abs(np.linalg.eigvals(np.linalg.solve(M, J.T @ (np.array(STIFFNESS)[:, None] * J)))).max()
    np.testing.assert_allclose(fastest_rates(kernel, q)[0], np.sqrt(swing), rtol=1e-9)


STIFF, DAMPED = (900.0, 700.0, 0.0, 30.0, 20.0, 0.0), (30.0, 20.0, 40.0, 0.0, 2.0, 1.0)
PLACES = (Placement((0.1, -0.2, 0.3)), Placement((0.2, 0.1, -0.1)))
RATIO, AT_HZ = 0.3, 2.0


def mounts() -> dict[str, tuple[Bushing, Array, Array]]:
    """Return bushings with their K and D, by what is written in them."""
    K, D = (np.asarray(rows.T @ rows) for rows in np.random.default_rng(4).normal(size=(2, 7, 6)))
    spring, damper, none = JointStiffness.of(K.tolist()), JointDamping.of(D.tolist()), np.zeros((6, 6))
    tables = {
        "numbers": (STIFF, DAMPED, np.diag(STIFF), np.diag(DAMPED)),
        "matrices": (spring, damper, K, D),
        "ratio": (spring, JointDamping(ratio=RATIO, at_hz=AT_HZ), K, RATIO / (np.pi * AT_HZ) * K),
        "damping alone": (None, damper, none, D),
    }
    return {
        name: (Bushing("mount", ("base", "body"), placements=PLACES, stiffness=k, damping=d), K, D)
        for name, (k, d, K, D) in tables.items()
    }


def held(mount: Bushing) -> Robot:
    """Return a body that is free but for the bushing."""
    return replace(free_body(), name="held", gravity=(0.0, 0.0, 0.0), elements=(mount,))


@pytest.mark.parametrize("c", [0.02, 0.2 + 0.3j])
@pytest.mark.parametrize("form", mounts())
def test_stages_are_the_dense_ones(form: str, c: complex) -> None:
    """K has J^T D d(J v)/dq beside J^T K J; of a complex c, whose factors serve a whole step, it has not."""
    mount, K, D = mounts()[form]
    model, h = build_model(held(mount)), 1e-5
    s, p = random_state(held(mount), 3), list(model.parameters.values())
    q, v = np.array(s.q), 5.0 * np.array(s.v)

    def J(at: Array) -> Array:
        return run(derive(model, "element_jacobian"), {"q": at.tolist(), "p": p}).reshape(6, 6)

    M = run(derive(model, "mass_matrix"), {"q": q.tolist(), "p": p}).reshape(6, 6)
    T = np.array([(J(q + h * x) - J(q - h * x)) @ v / (2.0 * h) for x in np.eye(6)]).T
    by_place = K @ J(q) + (0.0 if isinstance(c, complex) else D @ T)
    r, shifts = np.random.default_rng(0).normal(size=(2, 2, 6))
    found = staged(model, {"q": q.tolist(), "v": v.tolist(), "p": p}, c, r, shifts)
    expected, without = (
        dense_stage((M, J(q).T @ D @ J(q), J(q).T @ slopes), c, r, shifts) for slopes in (by_place, K @ J(q))
    )
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
    assert isinstance(c, complex) or np.abs(expected - without).max() > 1e-3 * np.abs(expected).max()


def test_fast_spins_in_dampers_take_long_steps(built: Build) -> None:
    """A body spins in a stiff damper beside its axis: the spin bounds the steps, not the damper."""
    at = (Placement(), Placement((0.01, 0.0, 0.0)))
    mount = Bushing("mount", ("base", "body"), placements=at, stiffness=(1e4,) * 3 + (0.0,) * 3)
    kernel = built(held(replace(mount, damping=(1e5,) * 3 + (0.0,) * 3)), "adaptive_rollout")
    q, v = np.zeros(6), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 300.0])
    loose, tight = (
        kernel.rollout(q, v, duration=0.1, samples=1, rtol=rtol, atol=1e-3 * rtol, method="rosenbrock")
        for rtol in (1e-4, 1e-6)
    )
    assert np.abs(loose[0][-1] - tight[0][-1]).max() < 1e-3
    assert loose.steps < 2000  # without slopes of the directions there are 5250
