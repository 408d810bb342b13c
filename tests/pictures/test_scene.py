"""The scene of a result: its geometry against kernels, Pinocchio and laws; bent links; its server and its page."""

from __future__ import annotations

import base64
import json
import shutil
import socket
import struct
import subprocess
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import EomgenWarning, InputError
from eomgen.export.live.geometry import geometry_of
from eomgen.export.live.view import contents_of_view
from eomgen.identification import tolerance
from eomgen.integration.trajectory import Trajectory
from eomgen.motion.files import MeasuredMotion
from eomgen.pictures import plot_mode_shapes, plot_robot
from eomgen.pictures import shapes as visuals
from eomgen.pictures.browser import View
from eomgen.pictures.framing import Camera, drawn_points, first_factor, framed, largest_power, up_of
from eomgen.pictures.scene import (
    Array,
    Region,
    accelerations,
    bent_axes,
    capsule_mesh,
    capsules,
    exaggerated,
    extent,
    link_poses,
    program_positions,
    quaternions,
    reaction_forces,
    spring_lines,
)
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from tests.description.test_beams import crane
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.pictures.test_plots import modes_of
from tests.support.bending_robots import bent
from tests.support.browser import open_page
from tests.support.commands import errors_of
from tests.support.description_samples import example_urdfs
from tests.support.joint_table import beam_table, frame_table, joint_table
from tests.support.optional import needs
from tests.support.random_robots import random_robot, random_state, with_offsets
from tests.support.refusals import refused
from tests.support.small_robots import bending_arm
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

SCENARIO = """
duration = 0.4
output_step = 0.002
[motion]
type = "point_to_point"
goal = { joint1 = 0.4, joint2 = -0.6 }
[[wrenches]]
link = "link2"
force = [4.0, 2.0, 3.0]
"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return bending_arm()


@pytest.fixture(scope="module")
def result(robot: Robot) -> SimulationResult:
    return run_scenario(robot, scenario_from_toml(SCENARIO))


@pytest.mark.parametrize("seed", soaked(range(6), (0, 1)))
def test_poses_are_those_of_kernels_and_of_pinocchio(seed: int) -> None:
    robot = random_robot(seed, (2, 4), tree=True, types=("revolute", "prismatic", "free", "fixed"))
    moved = with_offsets(robot, seed) if seed % 2 else robot
    kernel = eomgen.build(moved, kernels=("kinematics",), flags=("-O0",))
    states = [random_state(robot, seed + k).q for k in range(3)]
    poses = link_poses(moved, kernel.coordinates, states)
    for name in kernel.frames:
        assert np.abs(poses[name] - kernel.frame_pose(np.array(states), name)).max() < 1e-12
    if moved is robot:
        oracle = PinocchioOracle(robot)
        for q in states:
            one = link_poses(robot, kernel.coordinates, q)
            for name in kernel.frames:
                assert np.abs(one[name] - oracle.frame_pose(q, name)).max() < 1e-12


def test_program_and_exaggeration(result: SimulationResult, robot: Robot) -> None:
    """Factor 1 is reality, 0 the program; the tool's poses are those of the result."""
    names, tool = result.trajectory.coordinates, result.tool
    assert np.abs(link_poses(robot, names, exaggerated(result, 1.0))[tool] - result.pose).max() < 1e-12
    assert np.abs(link_poses(robot, names, exaggerated(result, 0.0))[tool] - result.program_pose).max() < 1e-12
    assert np.array_equal(exaggerated(result, 0.0), program_positions(result))
    off, ten = result.trajectory.q - program_positions(result), exaggerated(result, 10.0) - program_positions(result)
    assert np.allclose(ten, 10.0 * off, rtol=1e-9, atol=1e-15)


def test_capsules_reach_what_is_on_their_links(robot: Robot) -> None:
    found = {(c.link, tuple(c.end)) for c in capsules(robot)}
    assert {("link1", (0.4, 0.0, 0.0)), ("link2", (0.3, 0.0, 0.0)), ("base", (0.0, 0.0, 0.0))} <= found
    for spring in robot.springs:
        assert set(zip(spring.links, spring.points, strict=True)) <= found
    bare = replace(robot, frames=(), springs=())
    assert ("link2", (0.15, 0.0, 0.0)) in {(c.link, tuple(c.end)) for c in capsules(bare)}
    assert extent(bare) == pytest.approx(0.4 + 0.15)
    legs = {(c.link, tuple(c.end)) for c in capsules(eomgen.load_robot("gough"))}
    assert {("cylinder3", (0.0, 0.0, 0.5)), ("rod3", (0.0, 0.0, -0.5))} <= legs, "all on them is at their origins"
    larger = replace(
        bare,
        joints=tuple(
            replace(j, placement=replace(j.placement, xyz=tuple(10 * x for x in j.placement.xyz))) for j in bare.joints
        ),
    )
    assert capsules(larger)[0].radius > 5.0 * capsules(bare)[0].radius


@pytest.mark.parametrize("seed", range(4))
def test_capsule_meshes_are_closed_and_have_a_capsules_volume(seed: int) -> None:
    trimesh = needs("trimesh")
    rng = np.random.default_rng(seed)
    begin, end, radius = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.05, 0.3)
    if seed == 0:
        end = begin
    vertices, faces = capsule_mesh(begin, end, radius)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    volume = np.pi * radius**2 * (np.linalg.norm(end - begin) + 4.0 / 3.0 * radius)
    assert 0.94 * volume < mesh.volume < volume  # inside, and turned outwards
    line = end - begin
    s = np.clip((vertices - begin) @ line / max(line @ line, 1e-300), 0.0, 1.0)
    assert np.allclose(np.linalg.norm(vertices - begin - s[:, None] * line, axis=1), radius)


def test_quaternions_are_scipys() -> None:
    from scipy.spatial.transform import Rotation

    turns = Rotation.random(200, random_state=0)
    turns = Rotation.concatenate([turns, Rotation.from_rotvec(np.pi * np.eye(3)), Rotation.identity(1)])
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3] = turns.as_matrix()
    found, expected = quaternions(poses), turns.as_quat()[:, [3, 0, 1, 2]]
    assert np.abs(np.abs((found * expected).sum(axis=1)) - 1.0).max() < 1e-12
    assert (found[:, 0] >= 0.0).all()


def test_springs_are_as_long_as_the_kernel_says(robot: Robot, result: SimulationResult) -> None:
    kernel = eomgen.build(robot, kernels=("spring_forces",), flags=("-O0",))
    motion = result.trajectory
    ends = spring_lines(robot, link_poses(robot, motion.coordinates, motion.q))
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    q, zero = motion.q[::20], np.zeros_like(motion.q[::20])
    assert np.abs(kernel.functions.spring_forces(q, zero)[..., 0] - lengths[::20]).max() < 1e-12


@pytest.mark.soak
def test_reactions_carry_what_accelerates_and_weighs(result: SimulationResult, robot: Robot) -> None:
    """Newton's law for all links: base joint's force + wrench + weight = rate of momentum, differenced over time."""
    loose = replace(robot, springs=(), name="loose")
    finer = SCENARIO.replace("0.002", "0.0002") + "[integrator]\nrtol = 1e-9\n"
    found = run_scenario(loose, scenario_from_toml(finer))
    kernel = eomgen.build(
        loose, kernels=("residual", "mass_matrix", "reactions", "external_reactions", "external_force"), flags=("-O0",)
    )
    forces = reaction_forces(kernel, loose, found)
    motion, wrench = found.trajectory, found.wrench
    poses = link_poses(loose, motion.coordinates, motion.q)
    momentum = sum(link.mass * (poses[link.name] @ np.append(link.com, 1.0))[:, :3] for link in loose.links)
    h = motion.t[1] - motion.t[0]
    rate = (momentum[2:] - 2.0 * momentum[1:-1] + momentum[:-2]) / h**2
    weight = sum(link.mass for link in loose.links) * np.array(loose.gravity)
    left = forces[1:-1, 0] + wrench[1:-1, :, :3].sum(axis=1) + weight - rate
    inner = slice(2, -2)
    assert np.abs(left[inner]).max() < 2e-3 * np.abs(forces).max()
    exact = np.gradient(motion.v, motion.t, axis=0)
    assert np.abs(accelerations(kernel, found) - exact)[inner].max() < 1e-2 * np.abs(exact).max()


# The first look

NOTHING_MOVES = """
duration = 0.1
output_step = 0.01
[motion]
type = "point_to_point"
goal = [0.3]
"""


def projected(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Place of points in a square window, whose edges are at 1 and -1, and their depth, (P, 3)."""
    ahead = (camera.look_at - camera.position) / np.linalg.norm(camera.look_at - camera.position)
    right = np.cross(ahead, camera.up)
    right /= np.linalg.norm(right)
    off = points - camera.position
    depth = off @ ahead
    place = off @ np.stack([right, np.cross(right, ahead)], axis=1) / (depth * np.tan(0.5 * camera.fov))[:, None]
    return np.concatenate([place, depth[:, None]], axis=1)


@pytest.mark.parametrize("seed", range(12))
def test_the_camera_sees_all_points_and_little_else(seed: int) -> None:
    rng = np.random.default_rng(seed)
    up = rng.normal(size=3)
    up /= np.linalg.norm(up)
    points = rng.normal(size=(int(rng.integers(1, 30)), 3)) * rng.choice([0.0, 1e-3, 1.0], size=3) + rng.normal(size=3)
    found = projected(framed(points, up, 0.8, margin=1e-3), points)
    assert (found[:, 2] > 0.0).all()
    assert np.abs(found[:, :2]).max() < 0.81
    assert np.ptp(points, axis=0).max() < 0.1 or np.abs(found[:, :2]).max() > 0.3


@pytest.mark.parametrize("name", ["worn_arm", "puma560", "andrews", "one_link"])
def test_up_is_against_gravity_and_plane_robots_are_seen_from_the_front(name: str) -> None:
    robot = load_robot(name)
    up = up_of(robot)
    assert np.linalg.norm(up) == pytest.approx(1.0)
    if any(robot.gravity):
        assert up @ np.array(robot.gravity) == pytest.approx(-np.linalg.norm(robot.gravity))
    names = build_model(robot).coordinates
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (20, len(names)))
    states[:, [i for i, one in enumerate(names) if not one.endswith(".gamma")]] = 0.0
    camera = framed(drawn_points(robot, names, states).reshape(-1, 3), up, 0.8)
    direction = (camera.position - camera.look_at) / np.linalg.norm(camera.position - camera.look_at)
    assert name == "puma560" or direction[2] > 0.8  # they move in the plane of x and y
    assert direction @ up > 0.1


def test_deviations_are_visible_at_first(result: SimulationResult, robot: Robot) -> None:
    """The largest is a tenth of the robot's size, or 0.5 rad, less than a step of the slider below."""
    factor = first_factor(result, robot)
    assert factor > 1.0
    names, program = result.trajectory.coordinates, program_positions(result)
    points = drawn_points(robot, names, result.trajectory.q) - drawn_points(robot, names, program)
    angles = [i for i, unit in enumerate(result.units) if unit == "rad"]
    share = np.linalg.norm(points, axis=2).max() / (0.1 * extent(robot))
    share = max(share, np.abs(result.trajectory.q - program)[:, angles].max() / 0.5)
    assert 10.0**-0.05 < factor * share * (1.0 + 1e-9) <= 1.0 + 2e-9
    assert largest_power(result, robot) == pytest.approx(np.log10(factor) + 1.0)
    large = replace(result, trajectory=replace(result.trajectory, q=program + 1e6 * (result.trajectory.q - program)))
    assert (first_factor(large, robot), largest_power(large, robot)) == (1.0, 1.0)


def test_a_rigid_robot_is_drawn_as_it_is() -> None:
    rigid = replace(load_robot("one_link").with_coordinates({}), name="rigid")
    rigid = replace(
        rigid, joints=tuple(replace(j, coordinates={"gamma": j.coordinates["gamma"]}) for j in rigid.joints)
    )
    found = run_scenario(rigid, scenario_from_toml(NOTHING_MOVES))
    assert found.deviation_coordinates == ()
    assert (first_factor(found, rigid), largest_power(found, rigid)) == (1.0, 1.0)
    off = found.program_q + np.linspace(0.0, 1e-3, found.trajectory.t.size)[:, None]  # a drive that follows poorly
    poor = replace(found, trajectory=replace(found.trajectory, q=off))
    assert (first_factor(poor, rigid), largest_power(poor, rigid) > 2.5) == (1.0, True)


# Meshes


INERTIAL = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"


def arm(folder: Path, links: Mapping[str, Sequence[str]], origin: str = "") -> Robot:
    """A chain of links of an URDF, which are shown by these geometries."""
    rows, parent = ["<link name='ground'/>"], "ground"
    for name, shown in links.items():
        seen = "".join(f"<visual>{origin}<geometry>{one}</geometry></visual>" for one in shown)
        ends = f"<parent link='{parent}'/><child link='{name}'/>"
        rows.append(f"<link name='{name}'>{INERTIAL}{seen}</link>")
        rows.append(f"<joint name='to_{name}' type='continuous'>{ends}</joint>")
        parent = name
    (folder / "arm.urdf").write_text(f"<robot name='arm'>{''.join(rows)}</robot>")
    return load_robot(folder / "arm.urdf")


def test_shapes_of_an_urdf(tmp_path: Path) -> None:
    needs("trimesh").creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    shown = (
        "<mesh filename='box.stl' scale='0.1 0.1 0.1'/>",
        "<cylinder radius='0.1' length='0.5'/>",
        "<mesh filename='package://nowhere/x.stl'/>",
    )
    robot = arm(tmp_path, {"a-b": shown}, "<origin xyz='1 0 0' rpy='0 0 1.5707963267948966'/>")
    shapes, notes = visuals.urdf_shapes(robot)
    assert [shape.link for shape in shapes] == ["a_b", "a_b"]
    assert np.allclose(shapes[0].vertices.max(axis=0), [1.1, 0.05, 0.15])
    assert np.allclose(np.ptp(shapes[1].vertices, axis=0), [0.2, 0.2, 0.5], atol=2e-3)
    assert len(notes) == 1
    assert "package://nowhere/x.stl" in notes[0]
    (tmp_path / "arm.urdf").unlink()
    assert visuals.urdf_shapes(robot)[0] == []
    assert "cannot be read any more" in visuals.urdf_shapes(robot)[1][0]


def binary(corners: np.ndarray[Any, Any], header: bytes = b"") -> bytes:
    rows = b"".join(struct.pack("<12fH", *np.zeros(3), *triangle.ravel(), 0) for triangle in corners)
    return header.ljust(80, b"\0") + struct.pack("<I", len(corners)) + rows


def test_stl_files_are_read_in_both_forms() -> None:
    corners = np.random.default_rng(3).integers(-4, 5, (7, 3, 3)).astype(float)
    text = "solid x\n" + "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f" vertex {x:g} {y:.1f} {z:e}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in corners
    )  # fmt: skip
    for data in (binary(corners), binary(corners, b"solid by some tool"), text.encode()):
        vertices, faces = visuals.read_stl(data)
        np.testing.assert_array_equal(vertices[faces], corners)
        assert len(np.unique(vertices, axis=0)) == len(vertices)
    for data in (binary(corners[:0]), b"solid x\nendsolid x\n", binary(np.full((1, 3, 3), np.nan))):
        refused(ValueError, "without triangles", visuals.read_stl, data)


def test_meshes_are_drawn_and_missing_ones_named(tmp_path: Path) -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.2, 0.7]]])
    (tmp_path / "arm.stl").write_bytes(binary(corners))
    shown = ("<mesh filename='arm.stl'/>", "<box size='1 2 3'/>", "<sphere radius='0.5'/>")
    robot = arm(tmp_path, {"a": shown, "b": ("<mesh filename='gone.stl'/>",)})
    shapes, _ = visuals.urdf_shapes(robot)
    sizes = [np.ptp(shape.vertices, axis=0) for shape in shapes]
    np.testing.assert_allclose(sizes, [[0.3, 0.2, 0.7], [1.0, 2.0, 3.0], [1.0] * 3], rtol=1e-6)
    page, missing = geometry_of(robot, build_model(robot).coordinates, np.zeros(build_model(robot).size))
    assert "gone.stl" in missing[0]
    for mesh, shape in zip(page["meshes"], shapes, strict=True):
        numbers, faces = (base64.b64decode(mesh[key]) for key in ("vertices", "faces"))
        assert mesh["link"] == shape.link == "a"
        np.testing.assert_array_equal(np.frombuffer(numbers, "<f4").reshape(-1, 3), shape.vertices.astype("<f4"))
        np.testing.assert_array_equal(np.frombuffer(faces, "<u4").reshape(-1, 3), shape.faces)
    with pytest.warns(EomgenWarning, match=r"^arm: shape of b: there is no mesh 'gone.stl'"):
        _, axes = plot_robot(robot)
    assert len(axes.collections) == len(shapes) + 1, "three shapes, and the capsule of b"


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ("", "it has no vertices or no faces; allowed: "),
        ("v 0 0 0\nv 1e300 0 0\nv 0 1 0\n", "farther than 1e+30 m; allowed: "),
        ("v 0 0 0\nv 1 0 1e20\nv 0 1 0\n", "farther than 1e+30 m; allowed: "),
    ],
)
def test_meshes_without_places_are_left_out(corners: str, words: str, tmp_path: Path) -> None:
    needs("trimesh")
    (tmp_path / "x.obj").write_text(f"{corners}f 1 2 3\n")
    shapes, notes = visuals.urdf_shapes(arm(tmp_path, {"a": ("<mesh filename='x.obj' scale='2 2 1e300'/>",)}))
    assert shapes == []
    assert words in notes[0]


def test_meshes_of_a_package_are_found() -> None:
    needs("collada", "example_robot_data")
    (path,) = [path for path in example_urdfs() if path.name == "ur5_robot.urdf"]
    shapes, notes = visuals.urdf_shapes(load_robot(path))
    assert notes == []
    assert {"base_link", "shoulder_link", "upper_arm_link", "wrist_3_link"} <= {shape.link for shape in shapes}
    (upper,) = [shape for shape in shapes if shape.link == "upper_arm_link"]
    assert 0.4 < np.ptp(upper.vertices, axis=0).max() < 0.7  # m: the arm is 0.425 m from axis to axis


def collada(nodes: str) -> bytes:
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><library_nodes>'
        f'{nodes}</library_nodes><library_visual_scenes><visual_scene id="s"><node id="top">'
        '<instance_node url="#n0"/></node></visual_scene></library_visual_scenes></COLLADA>'
    ).encode()


def doubling(depth: int) -> str:
    """Nodes of which each shows the next one twice."""
    shown = "".join(f"<node id='n{i}'>{2 * f'<instance_node url=chr#n{i + 1}chr/>'}</node>" for i in range(depth))
    return shown.replace("chr", '"') + f"<node id='n{depth}'/>"


HOSTILE_MESHES = {  # name, content and words of the note
    "archive": ("x.zip", b"PK", "allowed: meshes that end in .stl, .dae, .obj, .ply"),
    "archive of collada": ("x.zae", b"PK", "allowed: meshes that end in .stl"),
    "compressed": ("x.stl.gz", b"\x1f\x8b", "allowed: meshes that end in .stl"),
    "triangles that are not there": ("x.stl", bytes(80) + b"\xff\xff\xff\x7f" + bytes(50), "2147483647 triangles"),
    "points that are not there": (
        "x.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n",
        "4000000000 elements",
    ),
    "no header": ("x.ply", b"ply\n", "with a header"),
    "entities": ("x.dae", b'<!DOCTYPE x [<!ENTITY a "b">]><COLLADA/>', "document type or an entity"),
    "nodes that double": ("x.dae", collada(doubling(30)), "allowed: up to 10000"),
    "nodes that show themselves": (
        "x.dae",
        collada("<node id='n0'><instance_node url='#n0'/></node>"),
        "show themselves",
    ),
}


@pytest.mark.parametrize("case", HOSTILE_MESHES)
def test_meshes_that_grow_are_left_out(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh = needs("trimesh")
    monkeypatch.setattr(trimesh, "load", lambda *_, **__: pytest.fail("it has been unpacked"))
    name, content, words = HOSTILE_MESHES[case]
    (tmp_path / name).write_bytes(content)
    shapes, notes = visuals.urdf_shapes(arm(tmp_path, {"a": (f"<mesh filename='{name}'/>",)}))
    assert shapes == []
    assert words in notes[0]


def test_meshes_are_counted_as_often_as_they_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs("trimesh").creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    size = (tmp_path / "box.stl").stat().st_size
    monkeypatch.setattr(visuals._Room, "__init__", lambda room: setattr(room, "left", 3 * size))
    shapes, notes = visuals.urdf_shapes(arm(tmp_path, {"a": 5 * ("<mesh filename='box.stl'/>",)}))
    assert len(shapes) == 3
    assert len(notes) == 2
    assert "together" in notes[0]


# The server


@pytest.fixture
def view(result: SimulationResult) -> Iterator[View]:
    needs("viser")
    shown = View(result, port=free_port())
    yield shown
    shown.close()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def test_what_stops_a_view_reaches_who_waits(view: View) -> None:
    view._speed, view._playing = None, True
    with pytest.raises(AttributeError, match="value"):
        view.wait()


def test_the_server_answers(view: View) -> None:
    with urllib.request.urlopen(view.address, timeout=20) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read().lower()
    assert f'<iframe src="{view.address}"' in view._repr_html_(), "a notebook shows it"
    import viser
    from websockets.sync.client import connect

    protocol = f"viser-v{viser.__version__}"
    with connect(view.address.replace("http", "ws"), subprotocols=[protocol], max_size=None) as stream:
        assert len(stream.recv(timeout=20)) > 100


def test_the_first_view_frames_the_whole_motion(view: View, result: SimulationResult, robot: Robot) -> None:
    assert view.factor == pytest.approx(first_factor(result, robot))
    given = view._server.initial_camera
    camera = Camera(given.position, given.look_at, given.up, given.fov)
    assert np.allclose(given.up, up_of(robot))
    rows = [program_positions(result), exaggerated(result, view.factor)]
    points = drawn_points(robot, result.trajectory.coordinates, np.concatenate(rows)).reshape(-1, 3)
    found = projected(camera, points)
    assert 0.5 < np.abs(found[:, :2]).max() < 1.0
    assert (found[:, 2] > given.near).all()
    assert (found[:, 2] < given.far).all()


def test_controls_move_the_scene(view: View, result: SimulationResult, robot: Robot) -> None:
    names = result.trajectory.coordinates
    tip = "link2"
    for share, power in ((0.0, 0.0), (1.0, 0.0), (0.5, 1.0)):
        view.time, view.factor = share * result.trajectory.t[-1], 10.0**power
        k = int(np.abs(result.trajectory.t - view.time).argmin())
        for kind, q in (("reality", exaggerated(result, 10.0**power)), ("program", program_positions(result))):
            pose = link_poses(robot, names, q[k])[tip]
            assert np.allclose(view.drawn(kind, tip), [*pose[:3, 3], *quaternions(pose)], atol=1e-9)
    assert not view.playing
    view.playing = True
    start = view.time
    deadline = time.monotonic() + 10.0
    while view.time == start and time.monotonic() < deadline:
        time.sleep(0.02)
    assert view.time != start


def test_tolerances_are_drawn_around_the_tool(result: SimulationResult, robot: Robot) -> None:
    needs("viser")
    sizes = {"joints.*.offset.z": {"deviation": 1e-4}, "joints.*.offset.x": {"deviation": 3e-4}}
    motion = motion_of(result)
    found = tolerance(robot, sizes, "link2", along=motion)
    shown = View(result, tolerance=found, port=free_port())
    try:
        shown.factor = 10.0
        for share in (0.0, 0.7):
            shown.time = share * result.trajectory.t[-1]
            handle = shown._ellipsoid
            k = int(np.abs(found.t - shown.time).argmin()) if found.t is not None else 0
            assert np.allclose(handle.position, shown.drawn("reality", "link2")[:3])
            assert sorted(handle.scale)[1:] == pytest.approx(sorted(10.0 * found.ellipsoids()[0][k])[1:], rel=1e-6)
    finally:
        shown.close()


def test_regions_that_are_of_something_else(result: SimulationResult, robot: Robot) -> None:
    sizes = {"joints.*.offset.z": {"deviation": 1e-4}}
    refused(InputError, "tolerance: is at poses; allowed", Region, tolerance(robot, sizes, "link2"), robot.name)
    refused(InputError, "tolerance: is of robot", Region, tolerance("one_link", sizes), robot.name)


def motion_of(result: SimulationResult) -> MeasuredMotion:
    motion, names = result.trajectory, result.trajectory.coordinates
    return MeasuredMotion(
        coordinates=names, t=motion.t, q=motion.q, v=None, a=None, u=motion.u, measured=names, driven=names
    )


def test_what_cannot_be_viewed(result: SimulationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs("viser")
    refused(InputError, "port: 0; allowed", View, result, port=0)
    refused(InputError, "give it: --robot", View, replace(result, description={}))
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    result.save(tmp_path / "trajectory.npz")
    assert 'pip install "eomgen[view]"' in errors_of("view", tmp_path, "--no-browser")


def test_a_browser_shows_the_scene_and_its_slider_moves_it(view: View) -> None:
    with open_page() as found:
        page = found.page
        page.goto(view.address)
        page.get_by_text("deviations x 10^").wait_for(timeout=30000)
        page.wait_for_timeout(3000)
        sliders = page.get_by_role("slider")
        assert sliders.count() == 2
        before, factor = page.screenshot(), view.factor
        sliders.nth(1).focus()
        for _ in range(12):
            page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(2000)
        assert view.factor < factor
        assert page.screenshot() != before
        sliders.nth(0).focus()
        for _ in range(40):
            page.keyboard.press("ArrowRight")
        page.wait_for_timeout(2000)
        assert view.time > 0.0
        assert found.errors == []
        assert all(url.startswith((view.address, "data:", "blob:", "ws:")) for url in found.requests)


# Links that bend: where their nodes are, closed, the same in figures, views and pages


MODULES = Path(__file__).parents[2] / "templates" / "live"
NODE = shutil.which("node")

BOOM = f"""
name = "boom"
{beam_table("tube", 1.5, "{ bar = [0.06, 0.04] }", "{ y = 2, z = 1, torsion = 1 }", 2.63e10)}
axis = "y"
{joint_table("slew", "base", "tube", "revolute")}
{frame_table("tcp", "tube")}
node = "tip"
"""


@pytest.fixture(scope="module")
def boom() -> Robot:
    return robot_from_toml(BOOM)


def drawn(robot: Robot, seed: int) -> tuple[tuple[str, ...], Array, dict[str, Any]]:
    """Return names of coordinates, their values at random, and these by name."""
    names = build_model(robot).coordinates
    q = np.random.default_rng(seed).uniform(-0.3, 0.3, len(names))
    return names, q, dict(zip(names, q, strict=True))


def test_a_view_keeps_an_elastic_joint_that_carries_a_link_that_bends(boom: Robot) -> None:
    """Of which nothing else moves: the link bends, and the joint has a slider."""
    elastic = 'type = "fixed"\ngamma = { stiffness = 1e4 }'
    page = contents_of_view(robot_from_toml(BOOM.replace('type = "revolute"', elastic)))
    assert {one["name"] for one in page["sliders"]} == set(build_model(boom).coordinates)
    assert [one["link"] for one in page["bent"]] == ["tube"]


@pytest.mark.parametrize("axis", ["x", "-z"])
def test_what_slides_along_a_beam_is_drawn_on_its_bent_axis(axis: str) -> None:
    """In figures and in views, where each mode has a slider; at every section, with its rotation."""
    robot = crane(axis)
    (bent_axis,), names = bent_axes(robot), build_model(robot).coordinates
    _, _, values = drawn(robot, 3)
    count = len(bent_axis.stations.places)
    states = np.array([[values[name] for name in names]] * count)
    states[:, names.index("cross.z")] = np.linalg.norm(bent_axis.stations.places, axis=1)
    poses = link_poses(robot, names, states)
    sections = poses["bridge"][0] @ bent_axis.poses(values)
    np.testing.assert_allclose(poses["trolley"], sections, atol=1e-9)
    assert np.abs(poses["trolley"] - link_poses(robot, names, 0.0 * states)["trolley"])[-1].max() > 0.01
    page = contents_of_view(robot)
    assert {one["name"] for one in page["sliders"]} == set(names)
    assert [page["coordinates"][i] for i in page["modes"]] == list(bent_axis.modes)
    assert "bridge_cross" not in {c["link"] for c in page["capsules"]}


@pytest.mark.parametrize("seed", soaked(range(12), (0, 1, 2)))
def test_axes_end_at_the_frames_of_nodes(seed: int, boom: Robot) -> None:
    """With their position and rotation; capsules do not lead there."""
    robot = bent(random_robot(seed, (2, 4), tree=True), seed).robot if seed else boom
    names, q, values = drawn(robot, seed)
    poses = link_poses(robot, names, q)
    axes = bent_axes(robot)
    assert {axis.link for axis in axes} == {x.name for x in robot.links if x.modes is not None and x.modes.nodes}
    ends = {(c.link, tuple(c.end)) for c in capsules(robot)}
    for axis in axes:
        sections = poses[axis.link] @ axis.poses(values)
        (node,) = (name for name, place in axis.nodes.items() if np.allclose(place, axis.stations.places[-1]))
        np.testing.assert_allclose(sections[-1], poses[node], atol=1e-9)
        assert (axis.link, axis.nodes[node]) not in ends
    every = drawn_points(robot, names, np.stack([q, 0.0 * q]))
    for axis in axes:
        middle = (poses[axis.link] @ axis.poses(values))[10, :3, 3]
        assert np.abs(every[0] - middle).sum(axis=-1).min() < 1e-12


def test_a_bent_beam_is_a_closed_tube_of_its_volume(boom: Robot) -> None:
    (axis,) = bent_axes(boom)
    _, _, values = drawn(boom, 1)
    for case, rtol in (({}, 1e-9), ({name: 0.1 * x for name, x in values.items()}, 0.02)):
        vertices, faces = axis.mesh(case)
        corners = vertices[faces]
        volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0
        assert volume == pytest.approx(0.06 * 0.04 * 1.5, rel=rtol), "outwards"
    places = [tuple(np.round(x, 9)) for x in axis.mesh({})[0]]
    triangles = [tuple(places[i] for i in face) for face in faces]
    edges = Counter((t[i], t[(i + 1) % 3]) for t in triangles for i in range(3) if len(set(t)) == 3)
    assert all(edges[end, begin] == count for (begin, end), count in edges.items())


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_pages_bend_links_as_python_does(tmp_path: Path, boom: Robot) -> None:
    """To the digits of single precision; a vertex goes with its link near the root, with the node near the tip."""
    script = """
import { BentAxis } from "#live/bent";
import { plotsOf } from "#live/plots";
import { readFileSync } from "node:fs";
const found = JSON.parse(readFileSync(0, "utf8")).map(({ bent, q }) => bent.map((data) => {
  const axis = new BentAxis(data), vertices = [...axis.bend(q)], last = vertices.length / 3 - 1;
  return { vertices, faces: axis.faces(), near: [0, last].map((i) => axis.nearest(i)) };
}));
const one = { drives: [], closed: false, states: [], coordinates: ["a.gamma", "b.mode1", "b.mode2"] };
const plot = plotsOf({ ...one, deviations: [0, 1, 2], units: ["rad", "1", "1"] }).get("b.modes");
console.log(JSON.stringify([found, [plot.names, plot.unit, plot.value({ q: [3, 4, 5] })]]));
"""
    shutil.copytree(MODULES, tmp_path / "live", ignore=shutil.ignore_patterns("three"))
    (tmp_path / "live" / "runner.mjs").write_text(script, encoding="ascii")
    robots = [boom, *(bent(random_robot(seed, (2, 3)), seed, (2, 3)).robot for seed in range(2))]
    given, expected = list[Any](), list[Any]()
    for seed, robot in enumerate(robots):
        names, q, values = drawn(robot, seed)
        geometry, _ = geometry_of(robot, names, q)
        given.append({"bent": geometry["bent"], "q": q.tolist()})
        expected.append([(axis, *axis.mesh(values)) for axis in bent_axes(robot)])
    command = [str(NODE), str(tmp_path / "live" / "runner.mjs")]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found, plot = json.loads(done.stdout)
    assert plot == [["mode1", "mode2"], "1", [4, 5]], "plots have modes, too"
    for answers, wanted in zip(found, expected, strict=True):
        assert wanted
        for answer, (axis, vertices, faces) in zip(answers, wanted, strict=True):
            np.testing.assert_allclose(np.reshape(answer["vertices"], (-1, 3)), vertices, atol=3e-6)
            assert set(map(tuple, np.reshape(answer["faces"], (-1, 3)).tolist())) == set(map(tuple, faces.tolist()))
            assert answer["near"][0] == axis.link
            assert answer["near"][1] in axis.nodes


def test_a_page_without_a_simulation_has_a_slider_for_each_mode(boom: Robot) -> None:
    """A mode's ends bend the link by 0.15 of the robot's size, or turn it by half a radian."""
    page = contents_of_view(boom)
    (found,) = page["bent"]
    assert found["link"] == "tube"
    assert [page["coordinates"][i] for i in found["modes"]] == [f"tube.mode{k}" for k in range(1, 5)]
    assert page["modes"] == found["modes"]
    sliders = {one["name"]: one for one in page["sliders"]}
    assert sliders.keys() == set(page["coordinates"])
    assert sliders["tube.mode1"]["high"] == -sliders["tube.mode1"]["low"] == pytest.approx(0.15 * 1.5, rel=0.05)
    assert sliders["tube.mode4"]["high"] == pytest.approx(0.5), "which twists"
    assert all(c["link"] != "tube" for c in page["capsules"])
    assert len(json.dumps(page["bent"])) < 12_000, "pages stay small"


def test_figures_draw_links_bent(boom: Robot) -> None:
    pose = {"slew.gamma": 0.4, "tube.mode1": 0.2, "tube.mode3": -0.1}
    _, axes = plot_robot(boom, pose=pose)
    names = build_model(boom).coordinates
    q = np.array([pose.get(name, 0.0) for name in names])
    (axis,), poses = bent_axes(boom), link_poses(boom, names, q)
    vertices, faces = axis.mesh({name: np.asarray(x) for name, x in pose.items()})
    base = vertices @ poses["tube"][:3, :3].T + poses["tube"][:3, 3]
    corners = [np.asarray(x._faces) for x in axes.collections if hasattr(x, "_faces")]
    assert any(len(x) == len(faces) and np.allclose(x, base[faces], atol=1e-9) for x in corners)
    assert len(axes.lines) == 1, "the joint's axis; a node is no joint to see"
    shape = [float(name == "tube.mode1") for name in names]
    figure, _ = plot_mode_shapes(modes_of(boom, [10.0j], [shape], "tcp"), boom)
    assert figure.axes[0].get_title() == "mode 1: 1.592 Hz"
    lines = [np.array(line.get_data_3d()).T for line in figure.axes[0].lines]
    rest, *sides = [line for line in lines if len(line) > 2]
    assert len(sides) == 2
    np.testing.assert_allclose(sides[0] + sides[1], 2.0 * rest, atol=1e-9)
    way = (sides[1] - rest)[:, 2]  # along y of the section, which is z where the beam runs along y
    np.testing.assert_allclose(way / way[-1], axis.stations.Phi[:, 2, 0] / axis.stations.Phi[-1, 2, 0], atol=1e-6)


@pytest.mark.soak
def test_a_view_bends_links_exaggerated(boom: Robot) -> None:
    needs("viser")
    scenario = 'duration = 0.05\noutput_step = 0.005\n[motion]\ntype = "point_to_point"\ngoal = { slew = 0.4 }\n'
    result = run_scenario(boom, scenario_from_toml(scenario))
    assert isinstance(result.trajectory, Trajectory)
    assert first_factor(result, boom) > 1.0
    view = View(result, port=free_port())
    try:
        (axis,), names = bent_axes(boom), result.trajectory.coordinates
        view.time, view.factor = result.trajectory.t[-1], 30.0
        for kind, q in (("reality", exaggerated(result, 30.0)[-1]), ("program", program_positions(result)[-1])):
            values = {name: np.asarray(x) for name, x in zip(names, q, strict=True)}
            np.testing.assert_allclose(view.bent(kind)[0], axis.mesh(values)[0], atol=1e-6)
        assert np.abs(view.bent("reality")[0] - view.bent("program")[0]).max() > 1e-3
    finally:
        view.close()
