"""Descriptions in TOML, built-in robots, those of makers, robots changed by paths, and where a robot is asked for."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.analysis.compliance import compliance_map
from eomgen.analysis.frequency import response
from eomgen.analysis.matrices import linearize
from eomgen.analysis.modal import modes, modes_along
from eomgen.analysis.sensitivity import offset_sensitivity
from eomgen.analysis.statics import deflection
from eomgen.analysis.structures import compare
from eomgen.analysis.tool_budget import budget
from eomgen.bench.beside import bench
from eomgen.description import RobotLike, as_robot
from eomgen.description.builtin import builtin_robots
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError, EomgenWarning, InputError
from eomgen.export.mujoco import mjcf
from eomgen.identification.from_motion import forces
from eomgen.identification.stiffness.solve import fit
from eomgen.pictures.browser import View
from eomgen.pictures.page import report_of
from eomgen.pictures.robot import plot_robot
from eomgen.pipeline.costs import robot_info
from eomgen.robot.bounds import Limits
from eomgen.robot.checks import check_values
from eomgen.robot.inertia_policy import link_sizes, lowest_moments, second_moments
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import following_modes
from eomgen.robot.record import record_of
from eomgen.robot.value import INERTIA_KEYS, Coordinate, Friction, Link, Robot
from eomgen.scenario import scenario_from_toml
from eomgen.simulation.result import simulated_robot
from eomgen.sweep.driver import run
from tests.support import bristles, makers
from tests.support.bending_mixtures import mixture
from tests.support.builds import Build
from tests.support.description_samples import ARM, URDF, example_urdfs, homogeneous, link_poses
from tests.support.every_element import ROBOTS, robot_with
from tests.support.joint_table import joint_table, link_table
from tests.support.many_robots import many_robot
from tests.support.quick_builds import ONE_LEVEL
from tests.support.random_robots import seeds
from tests.support.refusals import refused
from tests.support.text_files import text_file

pytestmark = pytest.mark.usefixtures("unoptimised")


def kinetic_matrix(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Mass matrix from central differences of the link poses: slow, and independent of every formula."""
    n, step = len(q), 1e-6
    matrix = np.diag([c.armature or 0.0 for j in robot.joints for c in j.coordinates.values()])
    tangents = []
    for k in range(n):
        shift = step * np.eye(n)[k]
        after, before = link_poses(robot, q + shift), link_poses(robot, q - shift)
        tangents.append({name: (after[name] - before[name]) / (2 * step) for name in after})
    for link, moment in zip(robot.links, second_moments(robot.links), strict=True):
        r = np.array([*link.com, 1.0])
        pseudo = link.mass * np.outer(r, r)
        pseudo[:3, :3] += moment
        for i in range(n):
            for j in range(n):
                matrix[i, j] += np.trace(tangents[i][link.name] @ pseudo @ tangents[j][link.name].T)
    return matrix


def gravity_torque(robot: Robot, q: np.ndarray) -> np.ndarray:
    """What the drives must hold against gravity, from central differences of the potential energy."""

    def potential(q: np.ndarray) -> float:
        poses = link_poses(robot, q)
        height = {link.name: np.dot(robot.gravity, (poses[link.name] @ [*link.com, 1.0])[:3]) for link in robot.links}
        return -sum(link.mass * height[link.name] for link in robot.links)

    return np.array([(potential(q + h) - potential(q - h)) / 2e-6 for h in 1e-6 * np.eye(len(q))])


def test_toml_fields() -> None:
    robot = robot_from_toml(ARM)
    assert (robot.name, robot.base, robot.gravity, robot.notes) == ("arm", "base", (0.0, 0.0, -9.81), ())
    assert robot.links[0] == Link("link1", 3.0, (0.1, 0.0, 0.0), (0.1, 0.2, 0.2, 0.0, 0.0, 0.0))
    joint1, joint2 = robot.joints
    assert dict(joint1.coordinates) == {"x": Coordinate(1e6, 10.0), "gamma": Coordinate(None, 0.1, 0.02)}
    assert joint1.limits == (-1.0, 2.0)
    assert joint1.placement.rpy is None
    assert dict(joint2.coordinates) == {"z": Coordinate()}
    assert joint2.placement.rpy == (0.0, 0.1, 0.0)
    assert [frame.name for frame in robot.frames] == ["tcp"]
    assert robot.tunable == ("links.link2.mass",)


def test_angles_in_degrees() -> None:
    """They give the same robot as the same angles in rad, right angles exactly; parameters are in rad."""
    given = ARM.replace("rpy = [0.0, 0.1, 0.0]", "rpy_deg = [90.0, 0.0, -180.0]")
    wanted = ARM.replace("rpy = [0.0, 0.1, 0.0]", f"rpy = [{math.pi / 2!r}, 0.0, {-math.pi!r}]")
    assert given not in (ARM, wanted)
    assert robot_from_toml(given) == robot_from_toml(wanted)
    assert robot_from_toml(given).joints[1].placement.rpy == (math.pi / 2, 0.0, -math.pi)
    placed = "placement = { xyz = [0.5, 0.0, 0.0], rpy = [0.0, 0.1, 0.0] }"
    assert placed in ARM
    degrees = ARM.replace(placed, "dh = { a = 0.5, alpha_deg = -90, theta_deg = 30 }")
    radians = ARM.replace(placed, f"dh = {{ a = 0.5, alpha = {-math.pi / 2!r}, theta = {math.radians(30.0)!r} }}")
    assert robot_from_toml(degrees) == robot_from_toml(radians)


def test_robot_is_immutable_and_pickles() -> None:
    robot = load_robot("puma560_elastic")
    assert pickle.loads(pickle.dumps(robot)) == robot
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.name = "x"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("kind", "active"), [("revolute", ["gamma"]), ("prismatic", ["z"]), ("fixed", []), ("free", list("xyz"))]
)
def test_active_coordinates(kind: str, active: list[str]) -> None:
    robot = robot_from_toml(ARM.replace('type = "prismatic"', f'type = "{kind}"'))
    angles = ["alpha", "beta", "gamma"] if kind == "free" else []
    assert list(robot.joints[1].coordinates) == active + angles


def test_forces_of_a_coordinate(tmp_path: Path) -> None:
    """What is given, what is filled in, and a curve from a file beside the description."""
    (tmp_path / "spring.csv").write_text("# measured\ns,F\n# by hand\n-1e-3,-5\n\n0, 0.5\n2e-3,9\n", encoding="ascii")
    friction = "friction = { coulomb = 1, static = 2, stribeck = 0.1 }"
    text = ARM.replace("gamma = {", f"gamma = {{ {friction},").replace(
        "x = { stiffness = 1e6,", 'y = { curve = "spring.csv" }\nx = { stiffness = 1e6, clearance = 2e-4, preload = -3,'
    )
    given = robot_from_toml(text, folder=tmp_path).joint("joint1").coordinates
    assert given["x"] == Coordinate(1e6, 10.0, clearance=2e-4, preload=-3.0, smoothing=1e-5)
    assert given["y"].curve == ((-1e-3, -5.0), (0.0, 0.5), (2e-3, 9.0))
    assert given["gamma"].friction == Friction(1.0, 2.0, 0.1, None, 4e-8)
    assert Friction(1.0).smoothing == 4e-8
    assert [
        name for name in build_model(robot_from_toml(text, folder=tmp_path)).parameters if name.startswith("joints.")
    ] == [
        *("joints.joint1.x.stiffness", "joints.joint1.x.damping", "joints.joint1.x.preload"),
        *("joints.joint1.x.clearance", "joints.joint1.x.smoothing"),
        *(f"joints.joint1.y.curve.{i}" for i in range(3)),
        "joints.joint1.gamma.damping",
        *(f"joints.joint1.gamma.friction.{key}" for key in ("coulomb", "static", "stribeck", "smoothing")),
    ]


def test_fixed_joint_as_elastic_mount() -> None:
    robot = robot_from_toml(ARM.replace('type = "prismatic"', 'type = "fixed"\nbeta = { stiffness = 1e3 }'))
    assert list(robot.joints[1].coordinates) == ["beta"]


def test_depth_first_order() -> None:
    links = "".join(f'[[links]]\nname = "{name}"\nmass = 1\n' for name in "abcd")
    joint = '[[joints]]\nname = "j{1}"\nparent = "{0}"\nchild = "{1}"\ntype = "revolute"\n'
    joints = "".join(joint.format(*pair) for pair in (("b", "d"), ("base", "b"), ("base", "a"), ("b", "c")))
    robot = robot_from_toml('name = "tree"\n' + joints + links)
    assert [joint.name for joint in robot.joints] == ["jb", "jd", "jc", "ja"]
    assert [link.name for link in robot.links] == ["b", "d", "c", "a"]


def test_long_chain_needs_no_recursion() -> None:
    count = 5000
    parts = ['name = "chain"\n']
    for k in range(count):
        parent = "base" if k == count - 1 else f"l{k + 1}"
        parts.append(f'[[links]]\nname = "l{k}"\nmass = 1\n[[joints]]\nname = "j{k}"\ntype = "revolute"\n')
        parts.append(f'parent = "{parent}"\nchild = "l{k}"\n')
    robot = robot_from_toml("".join(parts))
    assert robot.joints[0].name == f"j{count - 1}"
    assert len(robot.links) == count


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("gravity", ["gravity.x", "gravity.y", "gravity.z"]),
        ("gravity.z", ["gravity.z"]),
        ("links.*.mass", ["links.link1.mass", "links.link2.mass"]),
        ("links.link1.com", [f"links.link1.com.{k}" for k in "xyz"]),
        ("links.link2.inertia", [f"links.link2.inertia.{k}" for k in ("xx", "yy", "zz", "xy", "xz", "yz")]),
        ("joints.*.*.stiffness", ["joints.joint1.x.stiffness"]),
        ("joints.joint2.z.stiffness", ["joints.joint2.z.stiffness"]),
        ("joints.*.placement.rpy", [f"joints.joint2.placement.rpy.{k}" for k in range(3)]),
        ("joints.joint1.placement.xyz.2", ["joints.joint1.placement.xyz.2"]),
        ("frames.tcp.placement.xyz.0", ["frames.tcp.placement.xyz.0"]),
    ],
)
def test_tunable_names_expand(pattern: str, names: list[str]) -> None:
    robot = robot_from_toml(ARM.replace('"links.link2.mass"', f'"{pattern}", "{pattern}"'))
    assert list(robot.tunable) == names


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), -np.eye(3)]).tolist())
def test_thin_rod_and_massless_link_are_bodies(axis: list[float]) -> None:
    xx, yy, zz = (1 - abs(a) for a in axis)
    rod = ARM.replace("{ xx = 0.1, yy = 0.2, zz = 0.2 }", f"{{ xx = {xx}, yy = {yy}, zz = {zz} }}")
    rod = rod.replace("mass = 1.0\ninertia = { xx = 0.1, yy = 0.1, zz = 0.1 }", "mass = 0")
    assert robot_from_toml(rod).notes == ()


def test_inclined_rod_is_a_body() -> None:
    direction = np.array([1.0, 2.0, -3.0]) / math.sqrt(14.0)
    inertia = (np.eye(3) - np.outer(direction, direction)) / 12
    keys = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    table = ", ".join(f"{key} = {float(inertia[place])!r}" for key, place in keys.items())
    robot_from_toml(ARM.replace("{ xx = 0.1, yy = 0.2, zz = 0.2 }", f"{{ {table} }}"))


IMPOSSIBLE = ARM.replace("{ xx = 0.1, yy = 0.2, zz = 0.2 }", "{ xx = 0.1, yy = 0.2, zz = 0.5 }")


def test_inertia_warn_takes_it_as_it_is() -> None:
    with pytest.warns(EomgenWarning, match="link1"):
        robot = robot_from_toml(IMPOSSIBLE, inertia="warn")
    assert robot.links[0].inertia == (0.1, 0.2, 0.5, 0.0, 0.0, 0.0)
    assert "-0.1" in robot.notes[0]


def test_inertia_project_is_the_nearest_body() -> None:
    with pytest.warns(EomgenWarning, match="projected"):
        robot = robot_from_toml('inertia = "project"\n' + IMPOSSIBLE)
    # J_c = diag(0.3, 0.2, -0.1) becomes diag(0.3, 0.2, 0), so I = diag(0.2, 0.3, 0.5)
    assert np.allclose(robot.links[0].inertia, (0.2, 0.3, 0.5, 0, 0, 0), atol=1e-15)
    assert (robot.links[0].mass, robot.links[0].com) == (3.0, (0.1, 0.0, 0.0))
    with pytest.raises(DescriptionError):  # the keyword wins over the file
        robot_from_toml('inertia = "project"\n' + IMPOSSIBLE, inertia="error")


def refined(tmp_path: Path, toml: str, urdf: str = URDF) -> Robot:
    (tmp_path / "arm.urdf").write_text(urdf)
    return load_robot(text_file(tmp_path / "arm.toml", 'name = "mine"\nurdf = "arm.urdf"\n' + toml))


def test_toml_refines_urdf(tmp_path: Path) -> None:
    robot = refined(
        tmp_path,
        """
        [[joints]]
        name = "shoulder"
        x = { stiffness = 1e6 }
        [[links]]
        name = "upper"
        mass = 5
        [[links]]
        name = "tool"
        mass = 0.1
        [[joints]]
        name = "flange"
        parent = "lower"
        child = "tool"
        type = "fixed"
        [[frames]]
        name = "origin"
        link = "base"
        """,
    )
    plain = load_robot(tmp_path / "arm.urdf")
    assert (robot.name, robot.base) == ("mine", "ground")
    assert [joint.name for joint in robot.joints] == ["shoulder", "elbow", "flange"]
    assert dict(robot.joints[0].coordinates) == {
        "x": Coordinate(1e6),
        "gamma": Coordinate(limits=Limits(velocity=1.0, effort=10.0)),
    }
    assert robot.joints[0].axis_turn == plain.joints[0].axis_turn
    assert robot.links[0] == dataclasses.replace(plain.links[0], mass=5.0)
    assert robot.frames[0].link == "ground"


def test_toml_floats_the_root_of_an_urdf(tmp_path: Path) -> None:
    joint = '[[joints]]\nname = "float"\nparent = "base"\nchild = "ground"\ntype = "free"\n'
    robot = refined(tmp_path, joint + '[[links]]\nname = "ground"\nmass = 1.0\n')
    assert robot.base == "base"
    assert [link.name for link in robot.links] == ["ground", "upper", "lower"]
    urdf = URDF.replace('"ground"', '"base"')
    robot = refined(tmp_path, joint.replace('"base"', '"world"').replace('"ground"', '"base"'), urdf)
    assert (robot.base, robot.joints[0].child) == ("world", "base")


def test_builtin_robots_load_without_notes() -> None:
    assert set(builtin_robots()) >= {"one_link", "puma560", "puma560_elastic", "ur5", "worn_arm"}
    for name in builtin_robots():
        robot = load_robot(name)
        assert robot.name == name
        assert not robot.notes
        assert robot.frames


def test_one_link_is_the_papers_example() -> None:
    robot = load_robot("one_link")
    assert list(robot.joints[0].coordinates) == ["x", "gamma"]
    gamma = 0.7
    expected = [[1.0, -0.5 * math.sin(gamma)], [-0.5 * math.sin(gamma), 1 / 3]]
    assert np.allclose(kinetic_matrix(robot, np.array([0.01, gamma])), expected, atol=1e-9)
    assert np.allclose(gravity_torque(robot, np.array([0.0, gamma])), [0, 0.5 * 9.81 * math.cos(gamma)], atol=1e-8)


def test_puma_gravity_constants() -> None:
    """g1 to g5 of Armstrong, Khatib, Burdick (1986), table 6: -37.2, -8.44, 1.02, 0.249, -0.0282 N m."""
    robot = load_robot("puma560")
    at_zero = gravity_torque(robot, np.zeros(6))
    upright = gravity_torque(robot, np.array([0, -np.pi / 2, 0, 0, 0, 0]))
    stretched = gravity_torque(robot, np.array([0, 0, np.pi / 2, 0, 0, 0]))
    assert np.allclose(stretched[2], -8.44 - 0.0282, atol=0.03)  # forearm and hand held straight out
    assert np.allclose(at_zero[1], -37.2 + 0.249, atol=0.05)  # upper arm level, forearm up
    assert np.allclose(upright[1] - upright[2], -1.02, atol=0.01)  # g3 sin(q2)
    assert np.allclose(at_zero[[0, 3, 5]], 0.0, atol=1e-7)


def test_puma_mass_matrix() -> None:
    robot = load_robot("puma560")
    matrix = kinetic_matrix(robot, np.array([0.3, -0.5, 0.2, 0.1, 0.4, -0.2]))
    assert np.linalg.eigvalsh(matrix).min() > 0.1
    # arm stretched level: M11 = 1.14 + the moments of inertia about the vertical axis, some 4 kg m^2
    assert 2.5 < kinetic_matrix(robot, np.array([0, 0, np.pi / 2, 0, 0, 0]))[0, 0] < 5.5
    assert np.allclose(np.diag(matrix)[3:], [0.20, 0.18, 0.19], rtol=0.06)  # mostly motor inertia
    tcp = link_poses(robot, np.zeros(6))["link6"] @ homogeneous(robot.frames[0].placement)
    assert np.allclose(tcp[:3, 3], [0.4318 - 0.0203, 0.2435 - 0.0934, 0.4331 + 0.05625])


def test_puma_elastic_is_puma_with_36_coordinates() -> None:
    rigid, elastic = load_robot("puma560"), load_robot("puma560_elastic")
    assert rigid.links == elastic.links
    assert sum(len(joint.coordinates) for joint in elastic.joints) == 36
    for stiff, joint in zip(rigid.joints, elastic.joints, strict=True):
        assert dataclasses.replace(joint, coordinates=stiff.coordinates) == stiff
        assert joint.coordinates["gamma"] == stiff.coordinates["gamma"]
    names = [name for joint in elastic.joints for name in joint.coordinates]
    values = [c for joint in elastic.joints for c in joint.coordinates.values()]
    stretched = np.zeros(36)
    stretched[names.index("gamma", 12)] = np.pi / 2
    mass = kinetic_matrix(elastic, stretched)
    assert np.linalg.eigvalsh(mass).min() > 1e-5
    for k, (name, value) in enumerate(zip(names, values, strict=True)):
        if name != "gamma":  # damping is a few percent of critical for what hangs on the joint
            assert value.stiffness
            assert value.damping
            assert 0.01 < value.damping / (2 * math.sqrt(value.stiffness * mass[k, k])) < 0.1, (k, name)
    damped = np.array([name != "gamma" for name in names])
    stiffness = np.diag([value.stiffness or 0.0 for value in values])[np.ix_(damped, damped)]
    highest = np.linalg.eigvals(np.linalg.solve(mass[np.ix_(damped, damped)], stiffness)).real.max()
    assert math.sqrt(highest) / (2 * math.pi) < 5e3  # Hz: integrable with explicit methods


def test_ur5_matches_the_ros_description() -> None:
    robot = load_robot("ur5")
    paths = [path for path in example_urdfs() if path.name == "ur5_robot.urdf"]
    if not paths:
        pytest.skip("example-robot-data is not installed")
    ros = load_robot(paths[0])
    rng = np.random.default_rng(1)
    for q in rng.uniform(-3, 3, (20, 6)):
        mine, theirs = link_poses(robot, q)["link6"], link_poses(ros, q)
        half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])  # ROS turns base_link by pi against the maker's frame 0
        tool = half_turn @ np.linalg.inv(theirs["base_link"]) @ theirs["tool0"]
        assert np.allclose(tool, mine, atol=2e-10)  # the URDF writes pi/2 with twelve digits
    assert abs(sum(link.mass for link in robot.links) - sum(link.mass for link in ros.links)) < 4.0 + 0.06


def test_loading_imports_nothing_heavy() -> None:
    code = (
        "from eomgen.description import load_robot; load_robot('puma560_elastic')\n"
        "import sys; assert not {'sympy', 'scipy', 'matplotlib', 'jinja2', 'rich', 'pyexpat'} & set(sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_notes_say_where_bristles_can_give_energy_back() -> None:
    """Of joints, motors, loop joints and couplings: 0.5 N m s/rad is more than four times 0.3 N m above 2.4 rad/s."""
    for text, owners in (
        (bristles.ARM, ("joints.j1.gamma", "joints.j2.motor")),
        (
            bristles.loop_text() + bristles.FRICTION,
            ("joints.joint1.gamma", "joints.joint2.gamma", "loops.joint4.gamma", "couplings.belt"),
        ),
    ):
        assert not [note for note in robot_from_toml(text).notes if "energy" in note]
        notes = robot_from_toml(text.replace(", fade = 0.5", "")).notes
        said = [note.partition(" its ")[0] for note in notes if "bristle_damping can give energy back" in note]
        assert said == [f"{owner}.friction: above 2.4 rad/s" for owner in owners]


JOINT_ARM = f"""
name = "arm"
{link_table("upper_arm", 2.0, (0.1, 0.0, 0.0), (0.01, 0.02, 0.02))}
{joint_table("shoulder", "base", "upper_arm", "revolute")}
placement = {{ rpy = [0.1, 0.2, 0.3] }}
limits = [-1.0, 1.0]
x = {{ stiffness = 1e5, clearance = 1e-3 }}
"""


def bodily(robot: Robot, path: str, value: float) -> bool:
    """Whether a link with this number of its inertia is a body, or was none before."""
    link, key = robot.link(path.split(".")[1]), path.rpartition(".")[2]
    size = link_sizes({link.name: link}, robot.joints)[link.name]
    inertia = tuple(value if name == key else x for name, x in zip(INERTIA_KEYS, link.inertia, strict=True))
    before, after = (lowest_moments([x], [size])[0] for x in (link, replace(link, inertia=inertia)))
    return bool(before < 0.0 or after >= 0.0)


def check_every_number(robot: Robot, most: int = 30) -> None:
    before = dict(robot.numbers())
    told = [path for path, value in before.items() if value is not None]
    for path in np.random.default_rng(0).permutation(told)[:most].tolist():
        value = before[path]
        assert value is not None
        new = value * (1.0 + 1e-9) if value else 1e-12
        if following_modes(robot, (path,)) is not None:
            refused(DescriptionError, "it follows from the link's modes", robot.with_value, path, 1.1 * value or 0.1)
            continue
        if ".inertia." in path and not bodily(robot, path, new):
            refused(DescriptionError, "no body can have the inertia", robot.with_value, path, new)
            continue
        changed = robot.with_value(path, new)
        after = dict(changed.numbers())
        assert after[path] == new, path
        others = [key for key in before if key != path and after[key] != before[key]]
        assert all(key.endswith(("smoothing", "tracking_time")) for key in others), (path, others)
        assert others or changed.with_value(path, value) == robot, path


@pytest.mark.parametrize("name", ["worn_arm", "geared_arm", "balanced_arm", "gough", "two_arms", "one_link"])
def test_every_number_by_its_parameters_name(name: str) -> None:
    check_every_number(eomgen.load_robot(name))


@pytest.mark.parametrize("number", seeds(0, 4, 100))
def test_random_robots(number: int) -> None:
    check_every_number(many_robot(number))


@pytest.mark.parametrize("seed", seeds(0, 3, 60))
def test_robots_that_bend_are_changed_and_recorded(seed: int) -> None:
    """Whatever parts they have; and their records, as results keep them, are read as they were."""
    robot = mixture(seed).robot
    check_every_number(robot)
    check_values(robot)
    assert robot_from_record(json.loads(json.dumps(record_of(robot, whole=True))), robot.source) == robot


@pytest.mark.parametrize("most", [12, pytest.param(200, marks=pytest.mark.soak)])
def test_every_force_element(most: int) -> None:
    for family in ROBOTS:
        check_every_number(robot_from_toml(robot_with(family)), most)


def test_what_changes_with_a_value() -> None:
    robot = robot_from_toml(JOINT_ARM)
    heavier = robot.with_value("links.upper_arm.mass", 3)
    assert (heavier.link("upper_arm").mass, robot.link("upper_arm").mass) == (3.0, 2.0)
    assert heavier.with_value("links.upper_arm.mass", np.float64(2.0)) == robot
    turned = robot.with_value("joints.shoulder.placement.rpy.2", 0.5)
    expected = robot_from_toml(JOINT_ARM.replace("0.2, 0.3]", "0.2, 0.5]"))
    assert turned == expected
    wider = robot.with_value("joints.shoulder.x.clearance", 2e-3)
    assert wider == robot_from_toml(JOINT_ARM.replace("clearance = 1e-3", "clearance = 2e-3"))
    both = robot.with_values({"gravity": [0.0, -9.81, 0.0], "home.shoulder.gamma": 0.25, "name": "other"})
    assert (both.name, both.gravity, dict(both.home)) == ("other", (0.0, -9.81, 0.0), {"shoulder.gamma": 0.25})
    assert robot.with_value("joints.shoulder.limits", (-2.0, 2.0)).joint("shoulder").limits == (-2.0, 2.0)
    assert robot.with_value("links.0.com", np.array([0.2, 0.0, 0.0])).link("upper_arm").com == (0.2, 0.0, 0.0)


TABLES = {
    "motor": {"inertia": 1e-4, "ratio": 100.0, "stiffness": 2e4, "damping": 10.0, "friction": {"coulomb": 0.1}},
    "x": {"stiffness": 1e6, "hysteresis": {"stiffness": 1e3, "beta": 3.0, "gamma": 1.0}},
    "gamma.friction": {"coulomb": 3.0, "viscous": 1.0},
    "gamma.limits": {"lower": -1.0, "upper": 1.0, "effort": 3.0},
    "x.maxwell": [{"stiffness": 1e3, "damping": 1.0}],
    "dh": {"a": 0.1, "d": 0.2, "alpha": 0.3},
    "stops": {"stiffness": 1e5, "damping": 10.0},
    "offset": {"x": 1e-3},
    "stiffness": {"matrix": [[2.0, 0.5], [0.5, 1.0]]},
}


@pytest.mark.quick
@pytest.mark.parametrize("path", TABLES)
def test_tables_of_joints_have_the_keys_of_toml(path: str) -> None:
    plain = (
        'name = "arm"\nlinks = [{ name = "rod", mass = 1.0, com = [0.0, 0.0, 0.1], inertia = {xx=0.1,yy=0.1,zz=0.1} }]'
    )
    plain += '\n[[joints]]\nname = "hinge"\nparent = "base"\nchild = "rod"\ntype = "revolute"\nlimits = [-2.0, 2.0]\n'
    robot = robot_from_toml(plain + "x = { stiffness = 1.0 }")
    own = {key: x for key, x in {"x": "{ stiffness = 1.0 }"}.items() if path != key}
    given = json.dumps(TABLES[path]).replace(": ", " = ")
    if path.startswith("x."):
        own["x"], given = "{ stiffness = 1.0, " + f"{path[2:]} = {given} }}", ""
    lines = [f"{key} = {x}" for key, x in own.items()] + ([f"{path} = {given}"] if given else [])
    expected = robot_from_toml("\n".join([plain.replace("limits", "limits" if "limits" not in path else "#"), *lines]))
    changed = robot.with_value(f"joints.hinge.{path}", TABLES[path])
    assert replace(changed, notes=()) == replace(expected, notes=())
    assert changed.actuated_coordinates == (("hinge.motor",) if path == "motor" else ("hinge.gamma",))
    if isinstance(TABLES[path], dict):
        with pytest.raises(DescriptionError, match=r"with_value: joints\.hinge\..*stiff"):
            robot.with_value(f"joints.hinge.{path}", {"stiff": 1.0})


WRONG_TABLES: tuple[Any, ...] = ({}, {1: 2}, {"stiffness": math.nan}, {"stiffness": 10**400}, {"matrix": "k.csv"}, [{}])
WRONG_TABLES += (
    {"role": "locked"},
    {"inertia": 1.0, "ratio": 0.0, "stiffness": 1.0},
    {"xyz": "a"},
    {"lower": 2.0, "upper": 1.0},
)


@pytest.mark.quick
def test_wrong_tables_are_refused() -> None:
    """Or taken, where the joint has such a table; never with an error of Python's."""
    robot = robot_from_toml(JOINT_ARM)
    for path in ("x", "gamma", "motor", "placement", "radial", "offset", "name", "x.friction", "x.limits", "x.maxwell"):
        for value in WRONG_TABLES:
            with suppress(InputError):
                assert robot.with_value(f"joints.shoulder.{path}", value).joint("shoulder")
    refused(
        InputError, "with_value: the key 1 of a table; allowed: texts", robot.with_value, "joints.shoulder.x", {1: 2}
    )


def test_kernels_have_it() -> None:
    robot = eomgen.load_robot("one_link")
    q = [0.0, 0.3]
    kernel = eomgen.build(robot.with_value("links.link1.mass", 3.0))
    assert kernel.actuated_coordinates == robot.actuated_coordinates == ("joint1.gamma",)
    assert np.allclose(kernel.mass_matrix(q)[0, 0], 3.0 * eomgen.build(robot).mass_matrix(q)[0, 0])


def test_what_is_refused() -> None:
    robot = eomgen.load_robot("worn_arm")
    for path, message in (
        ("links.elbow.mass", r"there is no 'elbow' in links.*; known: "),
        ("links.upper.mas", r"there is no 'mas' in links\.upper; did you mean 'mass'\?; known: 'name', 'mass', 'com'"),
        ("joints.shoulder.x.stiffnes", r"did you mean 'stiffness'\?"),
        ("joint.shoulder", r"there is no 'joint'; did you mean 'joints'\?"),
        ("links.upper.mass.kg", r"links\.upper\.mass is .*, which has no parts"),
        ("joints.shoulder.motor.ratio", r"joints\.shoulder\.motor is not given; allowed: a value for it as a whole"),
        ("links.99.mass", r"there is no '99'"),
    ):
        refused(DescriptionError, message, robot.with_value, path.replace("upper", robot.links[0].name), 1.0)
    first = robot.links[0].name
    for value in (-1.0, math.nan, math.inf, "heavy", None, [1.0], True, {}, 10**400):
        with pytest.raises(DescriptionError, match=rf"with_value: links\.{first}\.mass = "):
            robot.with_value(f"links.{first}.mass", value)
    refused(DescriptionError, "no body can have the inertia", robot.with_value, f"links.{first}.inertia.xx", 1e3)
    with pytest.raises(DescriptionError, match=r"with_value: joints\.shoulder\.type = 'welded'"):
        robot.with_value("joints.shoulder.type", "welded")
    for path in ("", 3, None, Path("links")):
        with pytest.raises(InputError, match="is no path; allowed: names with dots"):
            robot.with_value(path, 1.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="allowed: a path and a value, or a mapping"):
        robot.with_values(3)  # type: ignore[arg-type]


FOLDER = Path(eomgen.__path__[0]) / "robots"
STATES = np.random.default_rng(20).uniform(-3.0, 3.0, (5, 7))


def tool(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Pose of the frame tcp, (4, 4)."""
    (frame,) = robot.frames
    return link_poses(robot, q)[frame.link] @ homogeneous(frame.placement)


def centres(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Centres of mass of the links in the base frame, (n, 3), m."""
    poses = link_poses(robot, q)
    return np.array([(poses[link.name] @ [*link.com, 1.0])[:3] for link in robot.links])


def centres_in(frames: Sequence[np.ndarray], given: Sequence[Sequence[float]]) -> np.ndarray:
    """The same from the frames of a table, with centres of mass in them."""
    return np.array([(frame @ [*com, 1.0])[:3] for frame, com in zip(frames, given, strict=True)])


@pytest.mark.parametrize(
    ("name", "table", "frames_of"),
    [
        ("ur5e", makers.UR5E, makers.classic_frames),
        ("ur20", makers.UR20, makers.classic_frames),
        ("ufactory850", makers.UFACTORY850, makers.modified_frames),
        ("panda", makers.PANDA, makers.modified_frames),
    ],
)
def test_published_tables(name: str, table: tuple[tuple[float, ...], ...], frames_of: makers.FramesOf) -> None:
    """Pose of the tool, masses and centres of mass at random angles."""
    robot = eomgen.load_robot(name)
    assert [link.mass for link in robot.links] == [row[4] for row in table]
    for state in STATES:
        q = state[: len(table)]
        frames = frames_of(table, q)
        end = frames[-1] @ makers.about_z(0.0, makers.PANDA_FLANGE if name == "panda" else 0.0)
        np.testing.assert_allclose(tool(robot, q), end, atol=2e-14)
        np.testing.assert_allclose(centres(robot, q), centres_in(frames, [row[5] for row in table]), atol=2e-14)


def test_two_tables_of_one_arm() -> None:
    """The maker's standard table of the UFACTORY 850 gives the pose that its modified one gives."""
    robot = eomgen.load_robot("ufactory850")
    for state in STATES:
        q = state[:6]
        np.testing.assert_allclose(tool(robot, q), makers.classic_frames(makers.UFACTORY850_CLASSIC, q)[-1], atol=2e-14)


@pytest.mark.parametrize("name", makers.URDFS)
def test_published_urdfs(name: str) -> None:
    """Pose of the tool at random angles; masses and centres of mass where they are published."""
    robot, (table, rpy) = eomgen.load_robot(name), makers.URDFS[name]
    masses = makers.URDF_MASSES.get(name)
    for state in STATES:
        frames = makers.urdf_frames(table, state[:6])
        np.testing.assert_allclose(tool(robot, state[:6]), frames[-1] @ makers.turned(rpy), atol=2e-14)
        if masses is not None:
            assert [link.mass for link in robot.links] == [mass for mass, _ in masses]
            wanted = centres_in(frames, [com for _, com in masses])
            np.testing.assert_allclose(centres(robot, state[:6]), wanted, atol=2e-12)


def test_a_table_through_c(built: Build) -> None:
    """What C answers is the product of the table, too."""
    robot = eomgen.load_robot("panda")
    kernel = built(robot, "kinematics")
    for q in STATES:
        end = makers.modified_frames(makers.PANDA, q)[-1] @ makers.about_z(0.0, makers.PANDA_FLANGE)
        np.testing.assert_allclose(kernel.frame_pose(q, "tcp"), end, atol=2e-14)


@pytest.mark.parametrize("name", makers.MAKERS)
def test_sources_are_said(name: str) -> None:
    """With an address; and which numbers are assumed."""
    text = (FOLDER / f"{name}.toml").read_text(encoding="ascii")
    head = " ".join(line.removeprefix("#").strip() for line in text.splitlines() if line.startswith("#"))
    assert "[1]" in head
    assert "https://" in head
    assert ("ASSUMED" in head) == (name in ("ufactory850", "kr6_r900", "lrmate200id"))
    assert ("ROS-Industrial's URDF" in head) == (name in makers.URDFS)


Call = Callable[[Any], object]
RESULT: Any = None  # results and plans are not looked at where the robot is wrong
CALLS: dict[str, Call] = {
    "build": eomgen.build,
    "generate": lambda robot: eomgen.generate(robot, Path("unused")),
    "robot_info": robot_info,
    "simulate": eomgen.simulate,
    "run_scenario": lambda robot: eomgen.run_scenario(robot, scenario_from_toml("duration = 1.0")),
    "simulated_robot": lambda robot: simulated_robot(RESULT, robot),
    "export_mjcf": lambda robot: eomgen.export_mjcf(robot, "unused.xml"),
    "mjcf": lambda robot: mjcf(robot, 1e-3),
    "export_wasm": lambda robot: eomgen.export_wasm(robot, "unused"),
    "export_wheel": lambda robot: eomgen.export_wheel(robot, "unused"),
    "float32_advice": lambda robot: eomgen.float32_advice(robot, ["inverse_dynamics"]),
    "rounding_bound": lambda robot: eomgen.rounding_bound(robot, "inverse_dynamics"),
    "export_simt": lambda robot: eomgen.export_simt(robot, "unused"),
    "export_arrays": lambda robot: eomgen.export_arrays(robot, "unused.py"),
    "export_live": lambda robot: eomgen.export_live(robot, "unused.html"),
    "export_fmu": lambda robot: eomgen.export_fmu(robot, "unused.fmu"),
    "modes": modes,
    "modes_along": lambda robot: modes_along(robot, [None]),
    "response": lambda robot: response(robot, ["joint1.x"], ["joint1.x"], [1.0]),
    "deflection": deflection,
    "linearize": linearize,
    "compliance_map": lambda robot: compliance_map(robot, [0, 0, 0], [1, 0, 0], [0, 1, 0]),
    "offset_sensitivity": lambda robot: offset_sensitivity(robot, [0.0], "link1"),
    "budget": lambda robot: budget(RESULT, robot),
    "compare": lambda robot: compare([robot, robot]),
    "sweep.run": lambda robot: run(robot, {"duration": 1.0}, RESULT, "unused"),
    "forces": lambda robot: forces(robot, "unused.csv"),
    "fit": lambda robot: fit(robot, "unused.csv"),
    "bench": bench,
    "plot_robot": lambda robot: plot_robot(robot, "unused.svg"),
}
OF_A_RESULT: dict[str, Call] = {
    "report_of": lambda robot: report_of(RESULT, robot),
    "View": lambda robot: View(RESULT, robot),
}


@pytest.mark.parametrize("call", (CALLS | OF_A_RESULT).values(), ids=[*CALLS, *OF_A_RESULT])
def test_a_value_that_is_no_robot_is_refused_by_its_type(call: Call) -> None:
    refused(eomgen.InputError, r"robot: got a value of type complex; allowed: a Robot .*one_link", call, 3j)


@pytest.mark.parametrize("call", (CALLS | OF_A_RESULT).values(), ids=[*CALLS, *OF_A_RESULT])
def test_a_name_is_that_of_a_robot(call: Call) -> None:
    refused(eomgen.DescriptionError, "there is no robot 'one_lnik'; did you mean 'one_link'", call, "one_lnik")


@pytest.mark.parametrize("kind", [str, Path])
@pytest.mark.parametrize("call", (CALLS | OF_A_RESULT).values(), ids=[*CALLS, *OF_A_RESULT])
def test_a_path_is_read(call: Call, kind: type, tmp_path: Path) -> None:
    path = text_file(tmp_path / "arm.toml", "name = 3")
    refused(eomgen.DescriptionError, r"arm\.toml:1:8: name", call, kind(path))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A description in a file: that of a robot with one coordinate."""
    return text_file(
        tmp_path / "pendulum.toml",
        """
        name = "pendulum"
        [[links]]
        name = "rod"
        mass = 1.0
        com = [0.5, 0.0, 0.0]
        inertia = { xx = 0.0, yy = 0.1, zz = 0.1 }
        [[joints]]
        name = "hinge"
        parent = "base"
        child = "rod"
        type = "revolute"
        """,
    )


def test_each_is_the_robot_itself(path: Path) -> None:
    robot = eomgen.load_robot("one_link")
    assert as_robot(robot) is robot
    assert as_robot("one_link") == robot
    assert as_robot(path) == as_robot(str(path)) == eomgen.load_robot(path)


@pytest.mark.parametrize("given", ["one_link", "path"])
def test_functions_do_for_a_name_or_a_path_what_they_do_for_the_robot(given: str, path: Path, tmp_path: Path) -> None:
    like: RobotLike = path if given == "path" else given
    robot = eomgen.load_robot(like)
    kernel = eomgen.build(like, kernels=("mass_matrix",), flags=("-O0",))
    assert kernel.coordinates == eomgen.build(robot, kernels=("mass_matrix",), flags=("-O0",)).coordinates
    package = eomgen.generate(like, str(tmp_path / "out"), ONE_LEVEL)
    assert json.loads((package / f"{robot.name}.json").read_text())["coordinates"] == list(kernel.coordinates)
    texts = [eomgen.export_mjcf(x, tmp_path / "arm.xml", step=1e-3).read_text() for x in (like, robot)]
    assert texts[0] == texts[1]


def test_an_analysis_takes_names() -> None:
    found = deflection("one_link")
    assert found.robot == "one_link"
    assert np.array_equal(found.q, deflection(eomgen.load_robot("one_link")).q)


def test_one_robot_is_nothing_to_compare() -> None:
    refused(eomgen.InputError, "robots: 1; allowed: two or more", compare, "one_link")


def test_no_function_of_the_facade_that_takes_a_robot_is_forgotten() -> None:
    for name in eomgen.__all__:
        value = getattr(eomgen, name)
        hints = getattr(value, "__annotations__", {})
        if callable(value) and not isinstance(value, type) and "robot" in hints:
            assert hints["robot"] == "RobotLike", name
            assert name in CALLS, name
