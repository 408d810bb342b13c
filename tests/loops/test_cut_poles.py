"""Angles of cut joints with forces at beta = +-90 degrees: refused by name there, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.steps.tolerances import coordinate_sizes
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

HALF = 1.5707963267948966
BODY = """
name = "pole"
gravity = [0.0, 0.0, 0.0]
home = {{ {home} }}
[[links]]
name = "cart"
mass = 1.0
com = [0.05, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.01, zz = 0.01 }}
[[joints]]
name = "joint"
parent = "base"
child = "cart"
type = "{kind}"
placement = {{ rpy = [{along}, 0.0, 0.0] }}
[[loops]]
name = "weld"
links = ["base", "cart"]
type = "fixed"
placements = [{{}}, {{ rpy = {turned} }}]
"""


def cut(kind: str, turned: list[float], angles: tuple[str, ...], along: float = 0.0, home: str = "") -> Robot:
    """One link that slides or turns, and an elastic cut joint to the base; ``along`` turns the joint's axis about x."""
    laws = "".join(f"{name} = {{ stiffness = 100.0, damping = 1.0 }}\n" for name in ("x", "y", "z", *angles))
    return robot_from_toml(BODY.format(kind=kind, along=along, home=home, turned=turned) + laws)


@pytest.mark.parametrize("angles", [("alpha", "beta", "gamma"), ("beta",)])
@pytest.mark.parametrize(("beta", "said"), [(HALF, "90"), (-HALF, "-90"), (1.5707963, "90")])
def test_frames_that_stay_at_the_pole(beta: float, said: str, angles: tuple[str, ...], built: Build) -> None:
    with pytest.raises(eomgen.errors.DescriptionError, match=rf"loops\.weld: its frames stay at beta = {said} degrees"):
        built(cut("prismatic", [0.0, beta, 0.0], angles), "forward_dynamics")


@pytest.mark.parametrize("beta", [HALF - 1e-3, HALF + 1e-5])
def test_frames_that_stay_beside_the_pole(beta: float, built: Build) -> None:
    """The angles that nothing turns hold nothing back."""
    kernel = built(cut("prismatic", [0.0, beta, 0.0], ("alpha", "beta", "gamma")), "forward_dynamics")
    assert kernel.forward_dynamics([0.1], [0.0], [0.0])[0] == pytest.approx(-10.0, rel=1e-12)


def test_frames_that_stay_without_tables_of_angles(built: Build) -> None:
    kernel = built(cut("prismatic", [0.0, HALF, 0.0], ()), "tree_forward_dynamics")
    assert kernel.forward_dynamics([0.1], [0.0], [0.0], cut=True)[0] == pytest.approx(-10.0, rel=1e-12)


@pytest.mark.parametrize(
    ("home", "at_the_pole"), [("", True), ('"joint.gamma" = 1e-5', False), ('"joint.gamma" = 0.3', False)]
)
def test_a_home_at_the_pole(home: str, at_the_pole: bool, built: Build) -> None:
    """Only steps that the tolerance chooses refer to what is there."""
    robot = cut("revolute", [0.0, HALF, 0.0], ("alpha", "beta", "gamma"), along=-HALF, home=home)
    kernel = built(robot, "forward_dynamics", "rollout")
    assert np.isfinite(kernel.forward_dynamics([0.3], [0.1], [0.0])).all()
    assert np.isfinite(kernel.rollout([0.3], [0.1], [0.0], 1e-4, 3, method="implicit")[0]).all()
    if at_the_pole:
        with pytest.raises(
            eomgen.errors.InputError, match=r"pole: home puts loops\.weld at beta = \+-90 degrees.*another home"
        ):
            coordinate_sizes(build_model(robot))
        with pytest.raises(eomgen.errors.InputError, match=r"loops\.weld at beta"):
            built(robot, "adaptive_rollout")
    else:
        assert np.isfinite(coordinate_sizes(build_model(robot))).all()
        adaptive = built(robot, "adaptive_rollout")
        assert np.isfinite(adaptive.rollout([0.3], [0.1], [0.0], duration=1e-3, samples=2, method="tsit5")[0]).all()


def test_a_home_at_the_pole_of_angles_that_nothing_moves() -> None:
    """A slide, whose offset turns the frames there: no size follows from them."""
    robot = cut("prismatic", [0.0, 0.0, 0.0], ("alpha", "beta", "gamma"))
    text = BODY.replace('type = "{kind}"', f'type = "{{kind}}"\noffset = {{{{ beta = {HALF} }}}}')
    laws = "".join(f"{name} = {{ stiffness = 100.0 }}\n" for name in ("x", "y", "z", "alpha", "beta", "gamma"))
    turned = robot_from_toml(text.format(kind="prismatic", along=0.0, home="", turned=[0.0, 0.0, 0.0]) + laws)
    assert turned != robot
    for wanted, found in zip(coordinate_sizes(build_model(robot)), coordinate_sizes(build_model(turned)), strict=True):
        assert np.allclose(found, wanted, rtol=1e-12)


def test_states_at_the_pole(built: Build) -> None:
    """Where frames come to it, the loop and the state are named."""
    robot = cut("revolute", [0.0, HALF, 0.0], ("alpha", "beta", "gamma"), along=-HALF, home='"joint.gamma" = 0.3')
    kernel = built(robot, "forward_dynamics", "cut_forces", "cut_poses", "energy")
    said = r"pole: loop weld is at beta = \+-90 degrees, where its alpha and gamma turn about one axis"
    with pytest.raises(eomgen.errors.SingularError, match=rf"forward_dynamics: {said}; allowed: poses beside it"):
        kernel.forward_dynamics([0.0], [0.1], [0.0])
    with pytest.raises(eomgen.errors.SingularError, match=rf"cut_forces: {said} in state \(1, 0\);"):
        kernel.cut_forces(np.array([[[0.3], [0.2]], [[0.0], [0.1]]]), np.zeros(1))
    assert np.isfinite(kernel.forward_dynamics([1e-6], [0.1], [0.0])).all()
