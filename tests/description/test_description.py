"""Descriptions in TOML, and the built-in robots."""

from __future__ import annotations

import dataclasses
import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eomgen.description.builtin import builtin_robots
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import DescriptionError, EomgenWarning
from eomgen.robot.bounds import Limits
from eomgen.robot.inertia_policy import second_moments
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Friction, Link, Robot
from tests.support import bristles
from tests.support.description_samples import ARM, URDF, example_urdfs, homogeneous, link_poses


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
    (tmp_path / "arm.toml").write_text('name = "mine"\nurdf = "arm.urdf"\n' + toml)
    return load_robot(tmp_path / "arm.toml")


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
