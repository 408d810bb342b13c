"""How the work grows: with equal links, and with numbers that stay parameters."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from benchmarks.run import six
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.errors import EomgenWarning
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Placement, Robot
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs

DATA = Path(__file__).parents[3] / "benchmarks" / "data"
COUNTED = (
    "inverse_dynamics",
    "mass_matrix",
    "forward_dynamics",
    "residual",
    "residual_jacobian",
    "coriolis_matrix",
    "generalized_force",
    "energy",
)


def equal_links(count: int) -> Robot:
    """A chain of elastic 6-DOF joints, every second one turned by a right angle; rotors on the driven angles."""
    links, joints = [], []
    for i in range(1, count + 1):
        links.append(Link(f"link{i}", 2.0, (0.1, 0.02, 0.03), (0.02, 0.03, 0.025, 0.001, 0.002, 0.003)))
        coordinates = {name: Coordinate(stiffness=1e5, damping=50.0) for name in COORDINATES[:5]}
        coordinates["gamma"] = Coordinate(damping=1.0)
        placement = Placement.from_rpy((0.3, 0.0, 0.1), (np.pi / 2 if i % 2 else -np.pi / 2, 0.0, 0.0))
        parent = f"link{i - 1}" if i > 1 else "base"
        joints.append(Joint(f"joint{i}", parent, f"link{i}", "revolute", placement, coordinates=coordinates))
    return Robot(f"equal{count}", (0.0, 0.0, -9.81), tuple(links), tuple(joints))


def operations(robot: Robot, kernels: tuple[str, ...]) -> dict[str, np.ndarray]:
    """(mul, add, div) of each kernel."""
    programs = derive_equations(build_model(robot), kernels).programs
    return {k: np.array([programs[k].count()[x] for x in ("mul", "add", "div")]) for k in kernels}


@pytest.mark.soak
def test_operations_grow_linearly() -> None:
    """Every two further links cost the same, to the operation, at both ends of a long chain."""
    kernels = ("residual", "forward_dynamics", "inverse_dynamics", "generalized_force")
    found = {count: operations(equal_links(count), kernels) for count in (4, 6, 8, 18, 20)}
    for kernel in kernels:
        step = found[6][kernel] - found[4][kernel]
        assert np.array_equal(found[8][kernel] - found[6][kernel], step), kernel
        assert np.array_equal(found[20][kernel] - found[18][kernel], step), kernel
        assert np.array_equal(found[20][kernel] - found[8][kernel], 6 * step), kernel


def test_a_step_of_a_rollout_grows_linearly() -> None:
    found = {}
    for count in (4, 6, 8):
        program = derive_equations(build_model(equal_links(count)), ("rollout",)).programs["implicit_step"]
        found[count] = program.count()
    assert {key: found[8][key] - found[6][key] for key in found[6]} == {
        key: found[6][key] - found[4][key] for key in found[4]
    }


@pytest.mark.soak
def test_a_long_chain(built: Build) -> None:
    """12 links, 72 coordinates: forward dynamics undoes inverse dynamics."""
    robot = equal_links(12)
    kernel = built(robot, "inverse_dynamics", "forward_dynamics", "residual")
    rng = np.random.default_rng(3)
    q, v, a = (scale * rng.standard_normal(kernel.n) for scale in (0.1, 0.5, 1.0))
    u = kernel.inverse_dynamics(q, v, a)
    assert np.abs(kernel.forward_dynamics(q, v, u) - a).max() < 1e-7
    assert np.abs(kernel.residual(q, v, a, u)).max() < 1e-9 * np.abs(u).max()


@pytest.mark.soak
def test_a_hundred_links() -> None:
    """600 coordinates: generated, compiled and right."""
    kernel = eomgen.build(equal_links(100), kernels=("residual", "forward_dynamics"))
    rng = np.random.default_rng(3)
    q, v, u = (scale * rng.standard_normal(kernel.n) for scale in (0.01, 0.1, 1.0))
    a = kernel.forward_dynamics(q, v, u)
    assert np.abs(kernel.residual(q, v, a, u)).max() < 1e-7 * np.abs(a).max()


def urdf(name: str, *, all_six: bool = False) -> Robot:
    robot = eomgen.load_robot(str(DATA / f"{name}.urdf"))
    return six(robot) if all_six else robot


def example(path: str) -> Robot:
    found = [urdf for urdf in example_urdfs() if urdf.as_posix().endswith(path)]
    if not found:
        pytest.skip("the wheel example-robot-data is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return eomgen.load_robot(found[0], inertia="warn", urdf_mimic=False)


ROBOTS = {
    "puma560_generic": lambda: urdf("puma560_generic"),
    "ur5_generic": lambda: urdf("ur5_generic"),
    "puma560_generic x6": lambda: urdf("puma560_generic", all_six=True),
    "puma560_elastic": lambda: eomgen.load_robot("puma560_elastic"),
    "ur5": lambda: eomgen.load_robot("ur5"),
    "UR5 URDF": lambda: example("ur_description/urdf/ur5_robot.urdf"),
    "Panda URDF": lambda: example("panda_description/urdf/panda.urdf"),
    "Talos reduced": lambda: example("talos_data/robots/talos_reduced.urdf"),
}
QUICK = ("puma560_generic", "ur5", "UR5 URDF")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.soak) for name in ROBOTS]
)
def test_parameters_cost_little(name: str) -> None:
    """Masses that stay parameters: at most 1.15 times the operations; frames that a description calls links aside."""
    robot = ROBOTS[name]()
    tunable = replace(robot, tunable=tuple(f"links.{link.name}.mass" for link in robot.links if link.mass > 0.0))
    folded, kept = operations(robot, COUNTED), operations(tunable, COUNTED)
    for kernel in COUNTED:
        assert kept[kernel].sum() <= 1.15 * folded[kernel].sum(), kernel
