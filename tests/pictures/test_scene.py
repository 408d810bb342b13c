"""The scene of a result: its geometry against kernels, Pinocchio and laws; its server and, with a browser, its page."""

from __future__ import annotations

import socket
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.description.load import load_robot
from eomgen.errors import InputError
from eomgen.identification import tolerance
from eomgen.motion.files import MeasuredMotion
from eomgen.pictures import shapes as visuals
from eomgen.pictures.browser import View
from eomgen.pictures.framing import Camera, drawn_points, first_factor, framed, largest_power, up_of
from eomgen.pictures.scene import (
    Region,
    accelerations,
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
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.bending_arm import bending_arm
from tests.support.browser import open_page
from tests.support.description_samples import example_urdfs
from tests.support.random_robots import random_robot, random_state, with_offsets
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
    trimesh = pytest.importorskip("trimesh")
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
    assert np.abs(kernel.spring_forces(q, zero)[..., 0] - lengths[::20]).max() < 1e-12


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
    assert wrench is not None
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


def test_shapes_of_an_urdf(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    inertial = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"
    geometry = (
        "<mesh filename='box.stl' scale='0.1 0.1 0.1'/>",
        "<cylinder radius='0.1' length='0.5'/>",
        "<mesh filename='package://nowhere/x.stl'/>",
    )
    origin = "<origin xyz='1 0 0' rpy='0 0 1.5707963267948966'/>"
    shown = "".join(f"<visual>{origin}<geometry>{text}</geometry></visual>" for text in geometry)
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        f"<robot name='arm'><link name='ground'/><link name='a-b'>{inertial}{shown}</link>"
        "<joint name='j' type='continuous'><parent link='ground'/><child link='a-b'/></joint></robot>"
    )
    robot = load_robot(urdf)
    shapes, notes = visuals.urdf_shapes(robot)
    assert [shape.link for shape in shapes] == ["a_b", "a_b"]
    assert np.allclose(shapes[0].vertices.max(axis=0), [1.1, 0.05, 0.15])
    assert np.allclose(np.ptp(shapes[1].vertices, axis=0), [0.2, 0.2, 0.5], atol=2e-3)
    assert len(notes) == 1
    assert "package://nowhere/x.stl" in notes[0]
    urdf.unlink()
    assert visuals.urdf_shapes(robot)[0] == []
    assert "cannot be read any more" in visuals.urdf_shapes(robot)[1][0]


def test_meshes_of_a_package_are_found() -> None:
    (path,) = [path for path in example_urdfs() if path.name == "ur5_robot.urdf"]
    pytest.importorskip("collada")
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
    trimesh = pytest.importorskip("trimesh")
    monkeypatch.setattr(trimesh, "load", lambda *_, **__: pytest.fail("it has been unpacked"))
    name, content, words = HOSTILE_MESHES[case]
    (tmp_path / name).write_bytes(content)
    shapes, notes = visuals.urdf_shapes(shown_by(tmp_path, name, 1))
    assert shapes == []
    assert words in notes[0]


def test_meshes_are_counted_as_often_as_they_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    size = (tmp_path / "box.stl").stat().st_size
    monkeypatch.setattr(visuals._Room, "__init__", lambda room: setattr(room, "left", 3 * size))
    shapes, notes = visuals.urdf_shapes(shown_by(tmp_path, "box.stl", 5))
    assert len(shapes) == 3
    assert len(notes) == 2
    assert "together" in notes[0]


def shown_by(folder: Path, mesh: str, times: int) -> Robot:
    """A robot whose link is shown by a mesh, so many times."""
    inertial = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"
    shown = times * f"<visual><geometry><mesh filename='{mesh}'/></geometry></visual>"
    urdf = folder / "arm.urdf"
    urdf.write_text(
        f"<robot name='arm'><link name='ground'/><link name='a'>{inertial}{shown}</link>"
        "<joint name='j' type='continuous'><parent link='ground'/><child link='a'/></joint></robot>"
    )
    return load_robot(urdf)


# The server


@pytest.fixture
def view(result: SimulationResult) -> Iterator[View]:
    pytest.importorskip("viser")
    shown = View(result, port=free_port())
    yield shown
    shown.close()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def test_the_server_answers(view: View) -> None:
    with urllib.request.urlopen(view.address, timeout=20) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read().lower()
    assert f'<iframe src="{view.address}"' in view._repr_html_(), "a notebook shows it"
    import viser
    from websockets.sync.client import connect

    protocol = f"viser-v{viser.__version__}"
    with connect(view.address.replace("http", "ws"), subprotocols=[protocol], max_size=None) as stream:  # type: ignore[list-item]
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
    pytest.importorskip("viser")
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
    with pytest.raises(InputError, match="tolerance: is at poses; allowed"):
        Region(tolerance(robot, sizes, "link2"), robot.name)
    with pytest.raises(InputError, match="tolerance: is of robot"):
        Region(tolerance("one_link", sizes), robot.name)


def motion_of(result: SimulationResult) -> MeasuredMotion:
    motion, names = result.trajectory, result.trajectory.coordinates
    return MeasuredMotion(
        coordinates=names, t=motion.t, q=motion.q, v=None, a=None, u=motion.u, measured=names, driven=names
    )


def test_what_cannot_be_viewed(
    result: SimulationResult, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="port: 0; allowed"):
        View(result, port=0)
    with pytest.raises(InputError, match="give it: --robot"):
        View(replace(result, description={}))
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    result.save(tmp_path / "trajectory.npz")
    assert cli.main(["view", str(tmp_path), "--no-browser"]) == 1
    assert 'pip install "eomgen[view]"' in capsys.readouterr().err


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
