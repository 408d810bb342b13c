"""Figures: what is drawn is what was computed, in vectors, with units; the robot that a result keeps."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

import eomgen
from eomgen.analysis.modal_result import Modes
from eomgen.errors import InputError
from eomgen.files import FIGURE_ENDINGS
from eomgen.pictures import energy as motion_plots
from eomgen.pictures.analysis import plot_mode_shapes
from eomgen.pictures.robot import plot_robot
from eomgen.pictures.simulation import plot_deviations, plot_result
from eomgen.pictures.zeros import plot_zeros
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.shown import scale_of
from eomgen.simulation.result import SimulationResult, simulated_robot
from eomgen.simulation.run import run_scenario, simulate
from tests.oracles.force_laws import with_laws
from tests.support.random_motors import with_motors
from tests.support.random_robots import random_robot, random_state, with_random_loops
from tests.support.random_springs import with_springs
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

SCENARIO = """
duration = 0.2
output_step = 0.005
[motion]
type = "point_to_point"
goal = [0.3]
[[wrenches]]
link = "link1"
force = [1.0, 2.0, 3.0]
"""


@pytest.fixture(scope="module")
def result() -> SimulationResult:
    return run_scenario(eomgen.load_robot("one_link"), scenario_from_toml(SCENARIO))


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The figures of Matplotlib that are written, kept."""
    kept, write = list[Any](), Figure.savefig

    def keeping(figure: Figure, *arguments: Any, **options: Any) -> None:
        kept.append(figure)
        write(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", keeping)
    return kept


def test_driven_coordinates_are_drawn_beside_their_program(
    result: SimulationResult, figures: list[Any], tmp_path: Path
) -> None:
    motion_plots.plot_tracking(result, tmp_path / "tracking.svg")
    upper, lower = figures[0].axes
    program, reality = (line.get_ydata() for line in upper.get_lines()[:2])
    assert np.array_equal(program, result.series("joint1.gamma.program").values)
    assert np.array_equal(reality, result.series("joint1.gamma").values)
    factor = {"rad": 1.0, "mrad": 1e3, "urad": 1e6, "nrad": 1e9}[lower.get_title(loc="left").split(", ")[1]]
    assert np.allclose(lower.get_lines()[0].get_ydata() / factor, reality - program, atol=0, rtol=1e-14)
    assert np.abs(reality - program).max() > 0.0


def test_panels_of_rigid_joints_are_left_out(result: SimulationResult, figures: list[Any], tmp_path: Path) -> None:
    names = ("j1.x", "j1.gamma", "j2.alpha", "j2.beta", "j3.y", "j3.alpha")
    motion = result.trajectory
    values = np.arange(6.0) + np.linspace(0.0, 0.1, motion.t.size)[:, None]
    many = replace(motion, coordinates=names, q=values, v=values, u=values)
    found = replace(result, trajectory=many, program_coordinates=("j1.gamma",))
    plot_deviations(found, tmp_path / "deviations.svg")
    panels = [panel for panel in figures[0].axes if panel.get_visible()]
    assert [panel.get_title(loc="left") for panel in panels] == ["j1, um", "j3, um", "j2, urad", "j3, urad"]
    drawn = [[line.get_ydata()[0] for line in panel.get_lines() if len(line.get_ydata()) > 2] for panel in panels]
    assert np.allclose([x for row in drawn for x in row], 1e6 * np.array([0.0, 4.0, 2.0, 3.0, 5.0]))
    assert [panel.get_xlabel() for panel in panels] == ["", "", "time, s", "time, s"]


def test_drawn_energies_balance(result: SimulationResult, figures: list[Any], tmp_path: Path) -> None:
    """Kinetic and potential energy are the works less the dissipated, plus the residue of the panel below."""
    motion_plots.plot_energy(result, tmp_path / "energy.svg")
    upper, lower = figures[0].axes
    drawn = {line.get_label(): line.get_ydata() for line in upper.get_lines()}
    assert set(drawn) == {"kinetic energy", "potential energy", "work of drives", "work of wrenches"}
    sizes = {"J": 1.0, "mJ": 1e3, "uJ": 1e6, "nJ": 1e9, "pJ": 1e12}
    unit, residue_unit = (panel.get_ylabel().split(", ")[1] for panel in (upper, lower))
    left = drawn["kinetic energy"] + drawn["potential energy"] - drawn["work of drives"] - drawn["work of wrenches"]
    residue = lower.get_lines()[0].get_ydata() / sizes[residue_unit]
    assert np.allclose(left / sizes[unit], residue, rtol=0.0, atol=1e-14 * np.abs(left).max() + 1e-13)
    with pytest.raises(InputError, match="without an energy balance"):
        motion_plots.plot_energy(replace(result, balance=None), tmp_path / "none.svg")


@pytest.mark.parametrize("seed", soaked(range(4), (1,)))
def test_the_drawn_zeros_are_zeros_of_the_kernel(seed: int, figures: list[Any], tmp_path: Path) -> None:
    """Where the figure says that an entry vanishes, the compiled M and C have zeros in every state."""
    robot = random_robot(seed, (2, 3), 3, tree=True, armature=False)
    plot_zeros(build_model(robot), tmp_path / "zeros.svg")
    left, right = figures[0].axes[:2]
    survives = np.asarray(left.images[0].get_array()) == 0
    counts = np.ma.filled(right.images[0].get_array(), 0)
    kernel = eomgen.build(robot, kernels=("mass_matrix", "christoffel"))
    states = [random_state(robot, 10 * seed + k).q for k in range(5)]
    M = np.array([kernel.mass_matrix(q) for q in states])
    C = np.array([kernel.christoffel(q) for q in states])
    assert np.abs(M[:, ~survives]).max(initial=0.0) < 1e-12 * np.abs(M).max()
    moving = (np.abs(C) > 1e-10 * max(float(np.abs(C).max()), 1.0)).any(axis=0).sum(axis=2)
    assert (counts >= moving).all()
    assert survives.shape == counts.shape == (kernel.n, kernel.n)


def test_figures_are_vectors_with_units(result: SimulationResult, tmp_path: Path) -> None:
    for ending in FIGURE_ENDINGS:
        names = [path.name for path in plot_result(result, tmp_path, ending)]
        assert names == [f"{name}{ending}" for name in ("tool", "deviations", "tracking", "energy")]
    text = {name: (tmp_path / f"{name}.svg").read_text() for name in ("tool", "deviations", "tracking", "energy")}
    for name, words in {
        "tool": ("x, m", "time, s", "reference trajectory (rigid robot)"),
        "deviations": ("joint1, um", "time, s"),
        "tracking": ("joint1.gamma, rad", "time, s"),
        "energy": ("since the start, ", "residue, "),
    }.items():
        for word in words:
            assert word in text[name], (name, word)
        ElementTree.fromstring(text[name])
        assert "<image" not in text[name]
        assert (tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    before = (tmp_path / "energy.svg").read_bytes()
    assert plot_result(result, tmp_path, ".svg")[-1].read_bytes() == before
    with pytest.raises(InputError, match=re.escape("allowed: a path that ends in .svg, .pdf, .png")):
        plot_result(result, tmp_path, ".jpg")


def test_names_are_no_mathematics(result: SimulationResult, tmp_path: Path) -> None:
    hostile = replace(result, robot="a$\\frac{$ & <b>", tool="$x_{$")
    (path,) = [path for path in plot_result(hostile, tmp_path, ".svg") if path.stem == "tool"]
    texts = "".join(ElementTree.fromstring(path.read_text()).itertext())
    assert "a$\\frac{$ & <b>: $x_{$ against its reference trajectory" in texts


def test_units_have_prefixes() -> None:
    cases = {
        2.0: (1.0, "m"),
        0.5: (1e3, "mm"),
        1e-3: (1e3, "mm"),
        9e-4: (1e6, "um"),
        3e-20: (1e12, "pm"),
        0.0: (1.0, "m"),
    }
    assert {value: scale_of(np.array([0.0, -value]), "m") for value in cases} == cases
    assert scale_of(np.zeros(0), "J") == (1.0, "J")
    assert scale_of([np.nan, 2e-3, -np.inf], "m/s") == (1e3, "mm/s")
    assert {unit: scale_of(2e-3, unit) for unit in ("", "1", "kg", "kg m^2", "m^2", "s^-1", "Hz")} == {
        unit: (1.0, unit) for unit in ("", "1", "kg", "kg m^2", "m^2", "s^-1", "Hz")
    }


# The robot in a result


def robots() -> list[Robot]:
    found = [eomgen.load_robot(name) for name in eomgen.builtin_robots()]
    for seed in range(12):
        robot = random_robot(seed, (2, 4), tree=True, types=("revolute", "prismatic", "free", "fixed"))
        found += [robot, with_springs(robot, seed), with_laws(robot, seed)]
        found.append(with_motors(random_robot(seed, (2, 3), types=("revolute", "prismatic")), seed))
        found.append(with_random_loops(random_robot(seed, (3, 4)), seed, ("spherical",)))
    return found


def test_robots_come_back_from_their_records() -> None:
    for robot in robots():
        again = robot_of(json.loads(json.dumps(record_of(robot))))
        assert again == robot
        assert robot_hash(again) == robot_hash(robot)


def test_the_robot_comes_back_from_a_result(result: SimulationResult, tmp_path: Path) -> None:
    robot = eomgen.load_robot("one_link")
    again = eomgen.load_result(result.save(tmp_path / "r.npz"))
    assert simulated_robot(again) == robot
    assert simulated_robot(again, robot) is robot
    with pytest.raises(InputError, match="puma560 is not what was simulated as one_link"):
        simulated_robot(again, eomgen.load_robot("puma560"))
    with pytest.raises(InputError, match="give it: --robot"):
        simulated_robot(replace(again, description={}))
    heavier = json.loads(json.dumps(dict(again.description)))
    heavier["links"][0]["mass"] = 2.0
    with pytest.raises(InputError, match="is not that of its hash"):
        simulated_robot(replace(again, description=heavier))


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("name",), 3),
        (("gravity",), [1.0, 2.0]),
        (("gravity",), "abc"),
        (("links", 0, "mass"), "1"),
        (("links", 0, "mass"), True),
        (("links", 0, "colour"), "red"),
        (("joints", 0, "coordinates"), [1]),
        (("joints", 0), None),
    ],
)
def test_what_is_no_record_is_refused(place: tuple[Any, ...], value: object) -> None:
    record: Any = json.loads(json.dumps(record_of(eomgen.load_robot("one_link"))))
    inner = record
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with pytest.raises(InputError, match="this is no robot that was recorded"):
        robot_of(record)


@pytest.mark.soak
def test_a_result_of_every_kind_keeps_its_robot(tmp_path: Path) -> None:
    robot = with_springs(random_robot(3, (2, 2), 3), 3)
    found = simulate(robot, duration=0.01, output_step=0.005)
    assert simulated_robot(eomgen.load_result(found.save(tmp_path / "r.npz"))) == robot


@pytest.mark.parametrize(
    "name", soaked(("two_arms", "four_bar", "balanced_arm", "geared_arm"), ("four_bar", "geared_arm"))
)
def test_a_robot_is_drawn_where_its_frames_are(name: str, tmp_path: Path, figures: list[Any]) -> None:
    """Faces around every joint's origin; axes, cut joints, springs and frames where poses in space have them."""
    from eomgen.pictures.scene import link_poses, spring_lines

    robot = eomgen.load_robot(name)
    coordinates = build_model(robot).coordinates
    q = np.array(build_model(robot).home) if robot.loops else np.linspace(0.1, 0.4, len(coordinates))
    path = plot_robot(robot, tmp_path / "robot.svg", dict(zip(coordinates, q.tolist(), strict=True)))
    poses = link_poses(robot, coordinates, q)
    (axes,) = figures[0].axes
    lines = [np.array(line.get_data_3d()).T for line in axes.lines]
    moving = [poses[joint.child][:3, 3] for joint in robot.joints if joint.coordinates]
    for origin in moving:
        assert any(np.allclose(line.mean(axis=0), origin, atol=1e-12) for line in lines)
    for ends in spring_lines(robot, poses):
        assert any(np.allclose(line, ends, atol=1e-12) for line in lines)
    assert len(lines) == len(moving) + len(robot.springs) + len(robot.loops)
    for loop in robot.loops:
        for link, placement in zip(loop.links, loop.placements, strict=True):
            end = (poses[link] @ [*placement.xyz, 1.0])[:3]
            assert any(np.allclose(line.mean(axis=0), end, atol=1e-9) for line in lines)
    again = plot_robot(robot, tmp_path / "again.svg", dict(zip(coordinates, q.tolist(), strict=True)))
    assert path.read_bytes() == again.read_bytes()
    with pytest.raises(eomgen.UnknownNameError, match=r"pose: 'joint9.x' is unknown"):
        plot_robot(robot, path, {"joint9.x": 1.0})


def test_shapes_of_modes_are_those_of_small_motions(tmp_path: Path, figures: list[Any]) -> None:
    """A rod of 1 m that slides along x, and one that turns: its tip moves along y, however far it is enlarged."""
    robot = eomgen.load_robot("one_link")
    shapes = np.array([[1e-3, 0.0], [0.0, 2e-3j + 5.0]])
    found = Modes(
        robot="one_link",
        coordinates=("joint1.x", "joint1.gamma"),
        q=np.zeros(2),
        eigenvalues=np.array([10.0j, 20.0j]),
        shapes=shapes,
        frame="link1",
        frame_shapes=np.zeros((2, 6), complex),
        undamped=np.zeros(2),
        resolution=0.0,
        notes=(),
    )
    plot_mode_shapes(found, robot, tmp_path / "shapes.svg")
    (figure,) = figures
    for axes, direction in zip(figure.axes, np.eye(3), strict=False):
        lines = [np.array(line.get_data_3d()).T for line in axes.lines]
        tips = sorted(
            (line[1] for line in lines if np.abs(line[1]).max() > 0.5), key=lambda tip: float(tip @ direction)
        )
        assert len(tips) == 3, "to one side, at rest, to the other"
        np.testing.assert_allclose(tips[1], [1.0, 0.0, 0.0], atol=1e-12)
        for tip, sign in ((tips[0], -1.0), (tips[2], 1.0)):
            np.testing.assert_allclose(tip - tips[1], sign * 0.12 * direction, atol=1e-9)
    with pytest.raises(InputError, match="modes: are of robot 'one_link'; allowed: those of 'puma560'"):
        plot_mode_shapes(found, "puma560", tmp_path / "x.svg")
    none = replace(found, eigenvalues=np.zeros(0, complex))
    with pytest.raises(InputError, match="modes: there are none to draw of 'one_link'"):
        plot_mode_shapes(none, robot, tmp_path / "x.svg")


def test_a_mechanism_is_drawn_closed(tmp_path: Path, figures: list[Any]) -> None:
    """At home, or where the coordinates that a pose names close it; capsules of both links reach the cut joint."""
    from eomgen.pictures.scene import capsules, link_poses

    robot = eomgen.load_robot("four_bar")
    plot_robot(robot, tmp_path / "home.svg")
    plot_robot(robot, tmp_path / "moved.svg", {"joint1.gamma": 1.4})
    kernel = eomgen.build(robot, kernels=("constraint", "constraint_jacobian", "cut_poses"))
    for figure, angle in zip(figures, (1.0, 1.4), strict=True):
        home = np.array(build_model(robot).home)
        home[0] = angle
        q = kernel.assemble(home, held=["joint1.gamma"])
        poses = link_poses(robot, kernel.coordinates, q)
        cut = (poses["rocker"] @ [0.4, 0.0, 0.0, 1.0])[:3]
        (axes,) = figure.axes
        assert any(np.allclose(np.array(line.get_data_3d()).mean(axis=1), cut, atol=1e-9) for line in axes.lines)
        ends = [(c.link, (poses[c.link] @ [*c.end, 1.0])[:3]) for c in capsules(robot)]
        assert {link for link, end in ends if np.allclose(end, cut, atol=1e-9)} == {"rocker", "coupler"}
    with pytest.raises(eomgen.LoopError, match="loop joint4"):
        plot_robot(robot, tmp_path / "open.svg", {"joint1.gamma": 1.4, "joint2.gamma": 1.4, "joint3.gamma": 0.0})
