"""Kernels of robots with beams beside MuJoCo, and a simulated motion's balance of energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.export.mujoco import left_out
from eomgen.simulation.run import simulate
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.beams import cantilever, straight
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.joint_table import joint_table

pytestmark = pytest.mark.usefixtures("unoptimised")
ARM = f"""
[[links]]
name = "arm"
mass = 2.0
com = [0.1, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.03, zz = 0.03 }}
{joint_table("wrist", "head", "arm", "revolute")}
"""


def crane(**keys: Any) -> eomgen.Robot:
    """A beam of two segments, not along an axis of the base, that carries a head and an arm behind a joint."""
    placement = {"xyz": [0.1, 0.2, 0.3], "rpy": [0.3, -0.2, 0.5]}
    return cantilever(3.0, ARM, placement=placement, axis="-y", damping={"ratio": 0.2, "at_hz": 30.0}, **keys)


def test_a_beam_moves_as_mujocos(built: Build, figures: Figures) -> None:
    """M and inverse dynamics, springs and dampers among them, of the chain as MuJoCo has it."""
    robot = crane()
    assert left_out(robot) == []
    kernel, oracle = built(robot, "mass_matrix", "inverse_dynamics"), MujocoRobot(robot)
    assert kernel.n == 13
    for i in range(4):
        q, v, a = np.random.default_rng(i).uniform(-0.3, 0.3, (3, kernel.n))
        M, force = oracle.mass_matrix(q), oracle.inverse_dynamics(q, v, a)
        figures.at_most("M", float(np.abs(kernel.mass_matrix(q) - M).max() / np.abs(M).max()), 1e-10)
        error = np.abs(kernel.inverse_dynamics(q, v, a) - force).max() / np.abs(force).max()
        figures.at_most("inverse dynamics", float(error), 1e-10)


def test_a_kernel_has_the_straight_beams_mass_matrix(built: Build) -> None:
    robot = crane()
    model = straight(robot)
    M = built(robot, "mass_matrix", "inverse_dynamics").mass_matrix(np.zeros(13))
    assert pytest.approx(model.M, abs=1e-12 * np.abs(M).max()) == M


@pytest.mark.soak
def test_energy_of_a_motion_is_balanced(figures: Figures) -> None:
    """An arm on the tip of a soft beam turns, the beam swings, and its damping takes a part of what the drive gives."""
    result = simulate(crane(E=1e9, G=4e8), duration=0.3)
    figures.at_most("balance", result.balance.relative_residue, 1e-5)
    assert abs(result.balance.of("dissipated")[-1]) > 1e-3 * result.balance.size
    motion = result.trajectory
    assert np.ptp(motion.q[:, motion.coordinates.index("boom2.beta")]) > 1e-5


def test_a_rigid_beam_is_a_welded_one() -> None:
    robot = crane().rigid()
    assert [joint.name for joint in robot.joints if joint.coordinates] == ["wrist"]
    assert robot.beams == ()
