"""Bushings: their coordinates against SciPy's Euler angles, an elastic cut joint of six coordinates, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.codegen.closed_form.trace import refuse_springs
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, SingularError
from eomgen.integration.plan import why_stiff
from eomgen.robot import Bushing, Placement, Robot, record_of, robot_hash, robot_of
from eomgen.robot.model import build_model
from eomgen.state.springs import fastest_rates
from tests.support.builds import Build
from tests.support.every_element import TREE
from tests.support.random_robots import seeds
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
STIFFNESS, DAMPING = [900.0, 700.0, 800.0, 30.0, 20.0, 10.0], [3.0, 2.0, 1.0, 0.3, 0.2, 0.1]
PLACEMENTS = "placements = [{ xyz = [0.5, 0.1, 0.0], rpy = [0.2, -0.1, 0.3] }, { xyz = [0.1, 0.0, 0.05] }]\n"
NUMBERS = f"stiffness = {STIFFNESS}\ndamping = {DAMPING}\n"
MOUNT = '[[bushings]]\nname = "mount"\nlinks = ["base", "fore"]\n'


def robot_of_text(text: str, hip: str = "") -> Robot:
    return robot_from_toml(TREE.format(hip=hip, knee="", beside=text))


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
        np.testing.assert_allclose(kernel.element_forces(q, v)[:, 0], e, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(kernel.element_jacobian(q), J, atol=1e-9)
        np.testing.assert_allclose(kernel.element_forces(q, v)[:, 1], resisting, rtol=1e-7, atol=1e-7)
        idle = kernel.with_parameters({name: 0.0 for name in kernel.parameters if name.startswith("bushings.")})
        there = kernel.inverse_dynamics(q, v, 0.0 * q) - idle.inverse_dynamics(q, v, 0.0 * q)
        np.testing.assert_allclose(there, J.T @ resisting, rtol=1e-7, atol=1e-6)
        stored = kernel.energy(q, v)[1] - idle.energy(q, v)[1]
        np.testing.assert_allclose(stored, 0.5 * np.sum(np.array(STIFFNESS) * e**2), rtol=1e-12)


@pytest.mark.soak
def test_a_bushing_is_a_cut_joint_of_six_elastic_coordinates(built: Build) -> None:
    """Motions, derivatives, steps and what joints hold are equal."""
    names = ("x", "y", "z", "alpha", "beta", "gamma")
    tables = "".join(
        f"{x} = {{ stiffness = {k}, damping = {c} }}\n" for x, k, c in zip(names, STIFFNESS, DAMPING, strict=True)
    )
    cut = '[[loops]]\nname = "mount"\ntype = "fixed"\nlinks = ["base", "fore"]\n' + PLACEMENTS + tables
    one, other = built(robot_of_text(MOUNT + PLACEMENTS + NUMBERS)), built(robot_of_text(cut))
    rng = np.random.default_rng(5)
    for q, v, u in rng.uniform(-0.5, 0.5, (4, 3, one.n)):
        a = one.forward_dynamics(q, v, u)
        np.testing.assert_allclose(a, other.forward_dynamics(q, v, u), rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(one.reactions(q, v, a), other.reactions(q, v, a), rtol=1e-10, atol=1e-10)
        for x, y in zip(one.residual_jacobian(q, v, a), other.residual_jacobian(q, v, a), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-9)
        for method in ("rk4", "implicit", "rosenbrock", "tsit5"):
            fixed = {"dt": 1e-3, "steps": 20} if method in ("rk4", "implicit") else {"duration": 0.02, "samples": 3}
            ends = [kernel.rollout(q, v, u, method=method, **fixed) for kernel in (one, other)]
            np.testing.assert_allclose(ends[0][0], ends[1][0], rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("method", soaked(["implicit", "rosenbrock", "rk4"], ["rosenbrock"]))
def test_gradients_of_rollouts_are_differences(method: str, built: Build) -> None:
    kernel = built(robot_of_text(MOUNT + PLACEMENTS + NUMBERS))
    q, v, u = np.array([0.1, 0.2, -0.1]), np.array([0.3, -0.2, 0.1]), np.array([1.0, 0.5, 0.2])
    names, options = ("bushings.mount.stiffness.y", "bushings.mount.damping.gamma"), {"dt": 2e-3, "steps": 30}
    if method == "rosenbrock":
        options = {"duration": 0.06, "samples": 3, "rtol": 1e-11, "atol": 1e-13}

    def loss(t: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
        last = np.zeros_like(q)
        last[-1] = 1.0
        return float(q[-1].sum()), last, 0.0 * v

    _, found = kernel.rollout_gradient(q, v, u, loss=loss, parameters=names, method=method, **options)
    for name in names:
        number, ends = kernel.parameters[name], []
        for factor in (1.0 + 1e-5, 1.0 - 1e-5):
            moved = kernel.with_parameters({name: number * factor})
            ends.append(np.atleast_2d(moved.rollout(q, v, u, method=method, **options)[0])[-1].sum())
        expected = (ends[0] - ends[1]) / (2e-5 * number)
        np.testing.assert_allclose(found[name], expected, rtol=1e-5, atol=1e-12)


def test_what_does_not_act_is_in_no_equation(built: Build) -> None:
    """A zero is no parameter, and neither value nor row is computed for it; tunable makes it one."""
    along = robot_of_text(MOUNT + "stiffness = [900.0, 0, 0, 0, 0, 0]\n")
    kernel = built(along)
    assert kernel.element_rows == ("mount.x",)
    assert [name for name in kernel.parameters if name.startswith("bushings.")] == ["bushings.mount.stiffness.x"]
    assert kernel.operations["residual"]["div"] == 0
    text = TREE.format(hip="", knee="", beside=MOUNT + "stiffness = [900.0, 0, 0, 0, 0, 0]\n")
    tuned = build_model(robot_from_toml('tunable = ["bushings.mount.damping.y"]\n' + text))
    assert tuned.parameters["bushings.mount.damping.y"] == 0.0


def test_a_pole_is_named(built: Build) -> None:
    half = "rpy = [1.5707963267948966, 0.0, 0.0]"  # so that the hip turns about y of the first frame
    placed = f"placements = [{{ {half} }}, {{ {half} }}]\n"
    kernel = built(robot_of_text(MOUNT.replace('"fore"', '"upper"') + placed + NUMBERS))
    with pytest.raises(SingularError, match=r"mount is at beta = \+-90 degrees, where its alpha and gamma turn about"):
        kernel.forward_dynamics([-np.pi / 2, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('["base", "fore"]', '["fore", "fore"]', r"mount\.links: .*two different links"),
        ('["base", "fore"]', '["base", "elbow"]', r"there is no link 'elbow'"),
        (str(STIFFNESS), "[1.0, 2.0]", r"mount\.stiffness: .*allowed: six numbers, for x, y, z, alpha, beta, gamma"),
        (str(STIFFNESS), str([[1.0] * 6] * 6), r"mount\.stiffness: .*six numbers, .*or a table \{ matrix"),
        (str(STIFFNESS), "{ matrix = [[1.0]] }", r"mount\.stiffness\.matrix: got 1 row; allowed: six, for x, y, z"),
        (str(DAMPING), "[1, 1, 1, 1, -2, 1]", r"mount\.damping\.4: got -2; allowed: a number that is at least 0"),
        (NUMBERS, "", r"mount: it has no force; allowed: with a stiffness or damping above 0"),
        (NUMBERS, "damping = [0, 0, 0, 0, 0, 0]\n", r"mount: it has no force"),
        (
            "[[bushings]]",
            '[[bushings]]\nname = "mount"\nlinks = ["base", "upper"]\n' + NUMBERS + "[[bushings]]",
            "unique",
        ),
        (
            "[[bushings]]",
            '[[springs]]\nname = "mount"\nlinks = ["base", "fore"]\nstiffness = 1.0\n[[bushings]]',
            r"the name 'mount' is taken by an earlier entry of \[\[springs\]\]; allowed: unique names",
        ),
        ("stiffness =", "stifness =", r"stifness.* did you mean 'stiffness'"),
    ],
)
def test_refusals(old: str, new: str, said: str) -> None:
    text = MOUNT + PLACEMENTS + NUMBERS
    assert old in text
    with pytest.raises(DescriptionError, match=said):
        robot_of_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("bushing", "said"),
    [
        (Bushing("mount", ("base", "fore"), stiffness=(1.0,) * 5), "stiffness: got 5 numbers"),
        (Bushing("mount", ("base", "fore"), stiffness=(1.0, np.nan, 0, 0, 0, 0)), "stiffness: y: got nan"),
        (Bushing("mount", ("base", "base"), stiffness=(1.0,) * 6), "do not move against each other"),
        (Bushing("mount", ("base", "other"), stiffness=(1.0,) * 6), "'other'"),
        (Bushing("m.ount", ("base", "fore"), stiffness=(1.0,) * 6), "'m.ount'"),
        (Bushing("mount", ("base", "fore")), "it has no force"),
    ],
)
def test_bushings_made_in_python_are_refused_too(bushing: Bushing, said: str) -> None:
    robot = robot_of_text("")
    with pytest.raises(DescriptionError, match=said):
        build_model(Robot(**{**vars(robot), "elements": (bushing,)}))


def test_records_hashes_and_rigid_robots() -> None:
    plain, robot = robot_of_text(""), robot_of_text(MOUNT + PLACEMENTS + NUMBERS)
    assert robot_of(record_of(robot)) == robot
    assert "elements" not in record_of(plain)
    assert robot_hash(plain) != robot_hash(robot)
    made = Bushing("mount", ("base", "fore"), robot.elements[0].placements, tuple(STIFFNESS), tuple(DAMPING))
    assert made == robot.elements[0]
    assert robot.rigid().elements == robot.elements
    assert Placement() == Bushing("mount", ("base", "fore")).placements[0]


def test_methods_and_sizes_know_its_stiffness(built: Build) -> None:
    robot = robot_of_text(MOUNT + PLACEMENTS + NUMBERS)
    kernel, q = built(robot), np.array([0.1, 0.2, -0.1])
    assert why_stiff(kernel) == "there are springs"
    soft = kernel.with_parameters({name: 0.0 for name in kernel.parameters if ".stiffness." in name})
    assert why_stiff(soft) == ""
    heavy = soft.with_parameters({name: 1e6 for name in kernel.parameters if ".damping." in name})
    assert "dampers or friction take effect within" in why_stiff(heavy)
    J, M = kernel.element_jacobian(q), kernel.mass_matrix(q)
    swing = np.abs(np.linalg.eigvals(np.linalg.solve(M, J.T @ (np.array(STIFFNESS)[:, None] * J)))).max()
    np.testing.assert_allclose(fastest_rates(kernel, q)[0], np.sqrt(swing), rtol=1e-9)


@pytest.mark.soak
def test_simulations_conserve_or_book_energy() -> None:
    robot = robot_of_text(MOUNT + PLACEMENTS + f"stiffness = {STIFFNESS}\n")
    result = eomgen.simulate(robot, duration=0.2)
    assert np.isfinite(result.trajectory.q).all()
    assert np.ptp(result.trajectory.q, axis=0).max() > 1e-3


def test_what_does_not_know_bushings_says_so(tmp_path: Path) -> None:
    robot = robot_of_text(MOUNT + NUMBERS)
    with pytest.raises(InputError, match=r"the closed form knows no bushings \(mount\)"):
        refuse_springs(build_model(robot))
    with pytest.raises(InputError, match=r"MuJoCo has no equal for bushings\.mount: left out"):
        eomgen.export_mjcf(robot, tmp_path / "robot.xml")
