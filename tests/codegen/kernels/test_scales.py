"""Robots of nanometres, and of masses that differ by a factor of 1e15: they build, and compute what larger ones do."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.authoring.inertia import inertia_notes
from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Robot
from tests.oracles.long_mass_matrix import exact_mass_matrix
from tests.oracles.roundings import mp
from tests.support.joint_table import frame_table, joint_table, link_table

KERNELS = ("mass_matrix", "bias_force", "inverse_dynamics", "forward_dynamics", "energy", "frame_pose", "regressor")
RATIOS = ((1.0, 1.0, 1e-15), (1.0, 1e-15, 1.0), (1e-15, 1.0, 1.0), (1.0, 1e-15, 1e-15), (1e-15, 1.0, 1e-15))


def arm(length: float = 1.0, masses: tuple[float, ...] = (1.0, 1.5, 0.7), gravity: float = 9.81) -> Robot:
    """Return an arm with a tool behind a fixed joint; all its lengths, m, and inertias are times a length."""
    tables, parent = [f'name = "arm"\ngravity = [0.0, 0.0, {-gravity * length!r}]'], "base"
    names = [*(f"link{k}" for k in range(len(masses))), "tool"]
    for k, (name, mass) in enumerate(zip(names, (*masses, masses[-1]), strict=True)):
        com = [x * length for x in (0.1, 0.02 * k, 0.15)]
        tables += [link_table(name, mass, com, [mass * length**2 * x for x in (0.01, 0.02, 0.015)])]
        tables += [joint_table(f"joint{k}", parent, name, "revolute" if name != "tool" else "fixed")]
        xyz = [x * length for x in (0.3, 0.1, 0.2)]
        tables += [f"placement = {{ xyz = {xyz}, rpy = [0.3, 0.7, {0.1 * k}] }}"]
        parent = name
    return robot_from_toml("\n".join([*tables, frame_table("tip", "tool", [0.1 * length] * 3)]))


@pytest.mark.parametrize(("length", "mass"), [(1e-9, 1e-20), (1e-9, 1.0), (1.0, 1e-20), (1e-6, 1e-12)])
def test_arms_of_nanometres_compute_what_larger_ones_do(length: float, mass: float) -> None:
    """Times are the same, so that forces are those of the larger arm times mass length, torques length more."""
    whole, small = arm(), arm(length, tuple(mass * x for x in (1.0, 1.5, 0.7)))
    assert inertia_notes(small) == ()
    one, other = (eomgen.build(robot, kernels=KERNELS) for robot in (whole, small))
    q, v, a, u = np.random.default_rng(1).uniform(-1.5, 1.5, (4, one.n))
    work = mass * length**2

    def same(name: str, factor: float, *arguments: object) -> None:
        ordinary, scaled = (getattr(kernel, name)(*arguments) for kernel in (one, other))
        assert scaled == pytest.approx(factor * ordinary, rel=1e-12, abs=1e-13 * factor * np.abs(ordinary).max())

    same("mass_matrix", work, q)
    same("bias_force", work, q, v)
    same("inverse_dynamics", work, q, v, a)
    same("energy", work, q, v)
    found = other.forward_dynamics(q, v, work * u)
    assert found == pytest.approx(one.forward_dynamics(q, v, u), rel=1e-10)
    tips = [kernel.frame_pose(q, "tip") for kernel in (one, other)]
    assert tips[1][:3, 3] == pytest.approx(length * tips[0][:3, 3], rel=1e-13)
    assert tips[1][:3, :3] == pytest.approx(tips[0][:3, :3], rel=1e-13)


@pytest.mark.parametrize("masses", RATIOS)
def test_masses_may_differ_by_a_factor_of_1e15(masses: tuple[float, ...]) -> None:
    robot = arm(masses=masses, gravity=0.0)
    assert inertia_notes(robot) == ()
    kernel = eomgen.build(robot, kernels=KERNELS)
    q, a = np.random.default_rng(2).uniform(-1.5, 1.5, (2, kernel.n))
    exact = exact_mass_matrix(robot, list(map(mp.mpf, q)))
    M = kernel.mass_matrix(q)
    for i in range(kernel.n):
        for j in range(kernel.n):
            assert abs(mp.mpf(M[i, j]) - exact[i, j]) <= 1e-14 * mp.sqrt(exact[i, i] * exact[j, j])
    u = np.array([float(x) for x in exact * mp.matrix(list(a))])
    assert kernel.forward_dynamics(q, np.zeros(kernel.n), u) == pytest.approx(a, rel=1e-11)


def test_an_arm_of_nanometres_has_every_kernel() -> None:
    kernel = eomgen.build(arm(1e-9, (1e-20, 1.5e-20, 0.7e-20)), kernels="all")
    assert kernel.inverse_dynamics([0.1, 0.2, 0.3], [0.0] * 3, [0.0] * 3).all()
