"""Poses at which a mechanism's constraint loses rank: refused where they are met, and no others."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.constraint_rows import general_rank
from eomgen.description.load import robot_from_toml
from eomgen.errors import SingularError
from eomgen.integration import integrate
from eomgen.pipeline.mechanisms import assembly_kernels
from eomgen.robot.model import build_model
from eomgen.simulation.segments import joined_info
from tests.support.builds import Build
from tests.support.linkages import KERNELS

pytestmark = pytest.mark.usefixtures("unoptimised")

LINK = """
[[links]]
name = "{}"
mass = {}
com = [{}, 0.0, 0.0]
inertia = {{ xx = 0.002, yy = 0.01, zz = 0.012 }}
"""
JOINT = """
[[joints]]
name = "{}"
parent = "{}"
child = "{}"
type = "revolute"
placement = {{ xyz = [{}, 0.0, 0.0] }}
"""
CUT = """
[[loops]]
name = "hinge"
links = ["coupler", "rocker"]
type = "revolute"
placements = [{ xyz = [0.5, 0.0, 0.0] }, { xyz = [0.2, 0.0, 0.0] }]
"""


def parallelogram() -> eomgen.Robot:
    """Opposite rods of the same length: folded flat, at angles of zero, it may go on as an antiparallelogram."""
    text = 'name = "parallelogram"\ngravity = [0.0, -9.81, 0.0]\ndriven = ["motor.gamma"]\n'
    text += LINK.format("crank", 0.4, 0.1) + LINK.format("coupler", 1.0, 0.25) + LINK.format("rocker", 0.8, 0.1)
    text += JOINT.format("motor", "base", "crank", 0.0) + JOINT.format("pin", "crank", "coupler", 0.2)
    return robot_from_toml(text + JOINT.format("pivot", "base", "rocker", 0.5) + CUT)


def test_a_folded_parallelogram_is_refused(built: Build) -> None:
    """Its loop is named; close to it accelerations are still those of the limit."""
    kernel = built(parallelogram(), "forward_dynamics", "constraint_jacobian", "mass_matrix", "constraint_forces")
    flat, still, u = np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0])
    for call in (kernel.forward_dynamics, kernel.constraint_forces):
        with pytest.raises(SingularError, match=r"loop hinge is at a singular pose.*allowed: poses beside it"):
            call(flat, still, u)
    near = [kernel.forward_dynamics(np.array([e, -e, e]), still, u)[0] for e in (1e-2, 1e-3, 1e-4)]
    assert near == pytest.approx([near[1]] * 3, rel=1e-2)
    states = np.array([[1.0, -1.0, 1.0], [0.0, 0.0, 0.0]])
    with pytest.raises(SingularError, match=r"loop hinge is at a singular pose.* in state 1"):
        kernel.forward_dynamics(states, np.zeros((2, 3)), u)
    assert np.isfinite(kernel.forward_dynamics(flat, still, u, cut=True)).all()


def test_what_is_redundant_everywhere_is_not_singular() -> None:
    """Rows that follow from others in every closed state are solved as before; home may itself be singular."""
    expected = {"four_bar": 2, "bennett": 2, "andrews": 6}
    assert {name: general_rank(build_model(eomgen.load_robot(name))) for name in expected} == expected
    assert general_rank(build_model(parallelogram())) == 2


def test_bennetts_linkage_goes_on(built: Build) -> None:
    robot = eomgen.load_robot("bennett")
    kernel = built(robot, "forward_dynamics", *assembly_kernels(robot))
    q = kernel.assemble(np.array(build_model(robot).home))
    assert np.isfinite(kernel.forward_dynamics(q, np.zeros(3), np.array([1.0, 0.0, 0.0]))).all()


def test_a_motion_says_how_near_it_came(built: Build) -> None:
    """The margin is least where the parallelogram is flattest, and falls with the sine of its angle."""
    kernel = built(parallelogram(), *KERNELS)
    motion = integrate(kernel, np.array([0.6, -0.6, 0.6]), -np.array([1.0, -1.0, 1.0]), 0.1, method="rk4", step=2e-3)
    flattest = int(np.abs(np.sin(motion.q[:, 0])).argmin())
    assert motion.info["margin_at"] == motion.t[flattest]
    assert flattest > 0
    later = integrate(kernel, motion.q[0], motion.v[0], 0.05, method="rk4", step=2e-3)
    assert 0.0 < motion.info["margin"] < later.info["margin"] < 1.0
    joined = joined_info(later.info, {**motion.info, "margin_at": 0.15})
    assert (joined["margin"], joined["margin_at"]) == (motion.info["margin"], 0.15)
