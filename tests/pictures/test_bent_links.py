"""Links that bend, as they are drawn: where their nodes are, closed, the same in figures, views and pages."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eomgen.analysis.modal_result import Modes
from eomgen.description.load import robot_from_toml
from eomgen.export.live.geometry import geometry_of
from eomgen.export.live.view import contents_of_view
from eomgen.integration.trajectory import Trajectory
from eomgen.pictures import View, plot_mode_shapes, plot_robot
from eomgen.pictures.framing import drawn_points, first_factor
from eomgen.pictures.scene import Array, bent_axes, capsules, exaggerated, link_poses, program_positions
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.description.test_sliding import crane
from tests.support.bending_robots import bent
from tests.support.random_robots import random_robot
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

MODULES = Path(__file__).parents[2] / "templates" / "live"
NODE = shutil.which("node")

BOOM = """
name = "boom"
[[links]]
name = "tube"
[links.beam]
length = 1.5
E = 7.0e10
G = 2.63e10
density = 2700.0
section = { bar = [0.06, 0.04] }
axis = "y"
modes = { y = 2, z = 1, torsion = 1 }
[[joints]]
name = "slew"
parent = "base"
child = "tube"
type = "revolute"
[[frames]]
name = "tcp"
link = "tube"
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


def test_figures_draw_links_bent(tmp_path: Path, boom: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.figure import Figure

    figures = list[Any]()
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure))
    pose = {"slew.gamma": 0.4, "tube.mode1": 0.2, "tube.mode3": -0.1}
    plot_robot(boom, tmp_path / "boom.svg", pose)
    names = build_model(boom).coordinates
    q = np.array([pose.get(name, 0.0) for name in names])
    (axis,), poses = bent_axes(boom), link_poses(boom, names, q)
    vertices, faces = axis.mesh({name: np.asarray(x) for name, x in pose.items()})
    base = vertices @ poses["tube"][:3, :3].T + poses["tube"][:3, 3]
    corners = [np.asarray(x._faces) for x in figures[0].axes[0].collections if hasattr(x, "_faces")]
    assert any(len(x) == len(faces) and np.allclose(x, base[faces], atol=1e-9) for x in corners)
    assert len(figures[0].axes[0].lines) == 1, "the joint's axis; a node is no joint to see"
    shapes = np.zeros((1, len(names)))
    shapes[0, names.index("tube.mode1")] = 1.0
    found = Modes(
        robot="boom",
        coordinates=names,
        q=0.0 * q,
        eigenvalues=np.array([10.0j]),
        shapes=shapes,
        frame="tcp",
        frame_shapes=np.zeros((1, 6), complex),
        undamped=np.zeros(1),
        resolution=0.0,
        notes=(),
    )
    plot_mode_shapes(found, boom, tmp_path / "modes.svg")
    lines = [np.array(line.get_data_3d()).T for line in figures[1].axes[0].lines]
    rest, *sides = [line for line in lines if len(line) > 2]
    assert len(sides) == 2
    np.testing.assert_allclose(sides[0] + sides[1], 2.0 * rest, atol=1e-9)
    way = (sides[1] - rest)[:, 2]  # along y of the section, which is z where the beam runs along y
    np.testing.assert_allclose(way / way[-1], axis.stations.Phi[:, 2, 0] / axis.stations.Phi[-1, 2, 0], atol=1e-6)


@pytest.mark.soak
def test_a_view_bends_links_exaggerated(boom: Robot) -> None:
    pytest.importorskip("viser")
    from tests.pictures.test_scene import free_port

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
