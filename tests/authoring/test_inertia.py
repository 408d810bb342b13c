"""What eomgen check says of inertia that is missing, and the mass matrices that it looks at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.authoring.check import check_file
from eomgen.authoring.inertia import inertia_notes, mass_matrix
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import build_model
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.random_robots import random_robot, random_state, with_offsets

ROD = """
name = "rod"
links = [{ name = "rod", mass = 2.0, com = [0.5, 0.0, 0.0], inertia = { xx = 0.0, yy = 0.05, zz = 0.05 } }]
[[joints]]
name = "hinge"
parent = "base"
child = "rod"
type = "revolute"
x = { stiffness = 1e9, damping = 1e3 }
alpha = { stiffness = 1e4, damping = 1.0 }
beta = { stiffness = 1e4, damping = 1.0 }
"""
BARE = """<robot name="bare"><link name="base"/><link name="a"/><link name="b"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("seed", [70, 71])
def test_mass_matrices_are_those_of_kernels(seed: int, built: Build) -> None:
    robot = with_offsets(random_robot(seed, joints=(2, 3), tree=True), seed)
    kernel = built(robot, "mass_matrix")
    q = random_state(robot, seed).q
    assert close(mass_matrix(build_model(robot), q), kernel.mass_matrix(q), 1e-12)


def test_motors_and_armatures_count(built: Build) -> None:
    robot = eomgen.load_robot("geared_arm")
    kernel = built(robot, "mass_matrix")
    q = np.linspace(0.1, 0.7, kernel.n)
    assert close(mass_matrix(build_model(robot), q), kernel.mass_matrix(q), 1e-12)


def test_a_massless_robot_is_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bare.urdf"
    path.write_text(BARE, encoding="ascii")
    found = check_file(path)
    assert not found.errors
    assert any(note.startswith("0 kg: no link that moves has mass or inertia") for note in found.notes)


def test_links_that_leave_the_mass_matrix_singular_are_noted(tmp_path: Path) -> None:
    tip = (
        ROD.replace("com = [0.5, 0.0, 0.0]", "com = [0.5, 0.1, 0.2]").replace(
            "} }]", '} }, { name = "tip", mass = 0.0 }]'
        )
        + '[[joints]]\nname = "wrist"\nparent = "rod"\nchild = "tip"\ntype = "revolute"\n'
    )
    path = tmp_path / "tip.toml"
    path.write_text(tip.replace("xx = 0.0", "xx = 0.02"), encoding="ascii")
    (note,) = check_file(path).notes
    assert note.startswith("the mass matrix is singular in every state: 'wrist.gamma' moves no inertia; without mass")
    assert "inertia: 'tip'; give links mass" in note
    for change in (("xx = 0.0", "xx = 0.02"), ("alpha = {", "alpha = { armature = 0.01,")):
        assert inertia_notes(robot_from_toml(ROD.replace(*change))) == ()
    assert "'hinge.alpha'" in inertia_notes(robot_from_toml(ROD))[0]


@pytest.mark.parametrize("name", eomgen.builtin_robots())
def test_built_in_robots_have_inertia(name: str) -> None:
    assert inertia_notes(eomgen.load_robot(name)) == ()


def test_a_thin_rod_is_singular_at_its_own_axis(built: Build) -> None:
    """Not at x, which has 1e9 N/m and 2 kg; with what computes M, and without."""
    robot = robot_from_toml(ROD)
    zero = np.zeros((3, 4))
    for kernels in (("mass_matrix",), ("inverse_dynamics",)):
        kernel = built(robot, "forward_dynamics", *kernels)
        with pytest.raises(eomgen.SingularError, match=r"inverted at hinge\.alpha; what they move has no inertia"):
            kernel.forward_dynamics(*zero)
    kernel = built(robot, "forward_dynamics", "mass_matrix", "inverse_dynamics")
    q, _ = eomgen.state.static_equilibrium(kernel, zero[0], held=["hinge.gamma"])
    assert abs(q[0]) < 1e-6


@pytest.mark.parametrize("beta", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("kernels", [(), ("mass_matrix",)])
def test_upright_angles_are_a_pair(beta: float, kernels: tuple[str, ...], built: Build) -> None:
    kernel = built(robot_from_toml(ROD.replace("xx = 0.0", "xx = 0.02")), "forward_dynamics", *kernels)
    with pytest.raises(eomgen.SingularError, match=r"at hinge\.alpha and hinge\.gamma; hinge\.beta is at \+-pi/2"):
        kernel.forward_dynamics([0.0, 0.3, beta, 0.2], np.zeros(4), np.zeros(4))
