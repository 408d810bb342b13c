"""Figures: what is drawn is what was computed, in vectors, with units; figures and axes come back to the caller."""

from __future__ import annotations

import inspect
import json
import pkgutil
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import eomgen
from eomgen import analysis, pictures
from eomgen.analysis.modal_result import Modes
from eomgen.errors import InputError, UnknownNameError
from eomgen.files import FIGURE_ENDINGS
from eomgen.optional import NotInstalledError
from eomgen.pictures import energy as motion_plots
from eomgen.pictures.analysis import plot_mode_shapes
from eomgen.pictures.robot import plot_robot
from eomgen.pictures.scene import capsules, link_poses, spring_lines
from eomgen.pictures.simulation import plot_deviations, plot_result
from eomgen.pictures.zeros import plot_zeros
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.shown import Plotting, scale_of
from eomgen.simulation.result import SimulationResult, simulated_robot
from eomgen.simulation.run import run_scenario, simulate
from eomgen.sweep import plan_from_toml, run
from tests.oracles.force_laws import with_laws
from tests.support.bristles import block
from tests.support.measured_results import RESULTS
from tests.support.quick_builds import answer, python
from tests.support.random_motors import with_motors
from tests.support.random_robots import random_robot, random_state, with_random_loops
from tests.support.random_springs import with_springs
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

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


@cache
def simulated() -> SimulationResult:
    return run_scenario("one_link", scenario_from_toml(SCENARIO))


@pytest.fixture
def result() -> SimulationResult:
    return simulated()


def test_driven_coordinates_are_drawn_beside_their_program(result: SimulationResult) -> None:
    _, (upper, lower) = motion_plots.plot_tracking(result)
    program, reality = (line.get_ydata() for line in upper.get_lines()[:2])
    assert np.array_equal(program, result.series("joint1.gamma.program").values)
    assert np.array_equal(reality, result.series("joint1.gamma").values)
    factor = {"rad": 1.0, "mrad": 1e3, "urad": 1e6, "nrad": 1e9}[lower.get_title(loc="left").split(", ")[1]]
    assert np.allclose(lower.get_lines()[0].get_ydata() / factor, reality - program, atol=0, rtol=1e-14)
    assert np.abs(reality - program).max() > 0.0


def test_panels_of_rigid_joints_are_left_out(result: SimulationResult) -> None:
    names = ("j1.x", "j1.gamma", "j2.alpha", "j2.beta", "j3.y", "j3.alpha")
    motion = result.trajectory
    values = np.arange(6.0) + np.linspace(0.0, 0.1, motion.t.size)[:, None]
    many = replace(motion, coordinates=names, q=values, v=values, u=values)
    found = replace(result, trajectory=many, program_coordinates=("j1.gamma",))
    figure, _ = plot_deviations(found)
    panels = [panel for panel in figure.axes if panel.get_visible()]
    assert [panel.get_title(loc="left") for panel in panels] == ["j1, um", "j3, um", "j2, urad", "j3, urad"]
    drawn = [[line.get_ydata()[0] for line in panel.get_lines() if len(line.get_ydata()) > 2] for panel in panels]
    assert np.allclose([x for row in drawn for x in row], 1e6 * np.array([0.0, 4.0, 2.0, 3.0, 5.0]))
    assert [panel.get_xlabel() for panel in panels] == ["", "", "time, s", "time, s"]
    (legend,) = figure.legends
    labels = ["x, um", "y, um", "alpha, urad", "beta, urad", "reference at a standstill"]
    assert [text.get_text() for text in legend.get_texts()] == labels


def test_drawn_energies_balance(result: SimulationResult) -> None:
    """Kinetic and potential energy are the works less the dissipated, plus the residue of the panel below."""
    _, (upper, lower) = motion_plots.plot_energy(result)
    drawn = {line.get_label(): line.get_ydata() for line in upper.get_lines()}
    assert set(drawn) == {"kinetic energy", "potential energy", "work of drives", "work of wrenches"}
    sizes = {"J": 1.0, "mJ": 1e3, "uJ": 1e6, "nJ": 1e9, "pJ": 1e12}
    unit, residue_unit = (panel.get_ylabel().split(", ")[1] for panel in (upper, lower))
    left = drawn["kinetic energy"] + drawn["potential energy"] - drawn["work of drives"] - drawn["work of wrenches"]
    residue = lower.get_lines()[0].get_ydata() / sizes[residue_unit]
    assert np.allclose(left / sizes[unit], residue, rtol=0.0, atol=1e-14 * np.abs(left).max() + 1e-13)
    refused(InputError, "without an energy balance", motion_plots.plot_energy, replace(result, balance=None))


@pytest.mark.parametrize("seed", soaked(range(4), (1,)))
def test_the_drawn_zeros_are_zeros_of_the_kernel(seed: int) -> None:
    """Where the figure says that an entry vanishes, the compiled M and C have zeros in every state."""
    robot = random_robot(seed, (2, 3), 3, tree=True, armature=False)
    _, (left, right) = plot_zeros(build_model(robot))
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
    refused(InputError, "give it: --robot", simulated_robot, replace(again, description={}))
    heavier = json.loads(json.dumps(dict(again.description)))
    heavier["links"][0]["mass"] = 2.0
    refused(InputError, "is not that of its hash", simulated_robot, replace(again, description=heavier))


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
    refused(InputError, "this is no robot that was recorded", robot_of, record)


@pytest.mark.soak
def test_a_result_of_every_kind_keeps_its_robot(tmp_path: Path) -> None:
    robot = with_springs(random_robot(3, (2, 2), 3), 3)
    found = simulate(robot, duration=0.01, output_step=0.005)
    assert simulated_robot(eomgen.load_result(found.save(tmp_path / "r.npz"))) == robot


@pytest.mark.parametrize(
    "name", soaked(("two_arms", "four_bar", "balanced_arm", "geared_arm"), ("four_bar", "geared_arm"))
)
def test_a_robot_is_drawn_where_its_frames_are(name: str, tmp_path: Path) -> None:
    """Faces around every joint's origin; axes, cut joints, springs and frames where poses in space have them."""
    robot = eomgen.load_robot(name)
    coordinates = build_model(robot).coordinates
    q = np.array(build_model(robot).home) if robot.loops else np.linspace(0.1, 0.4, len(coordinates))
    pose = dict(zip(coordinates, q.tolist(), strict=True))
    _, axes = plot_robot(robot, pose=pose)
    poses = link_poses(robot, coordinates, q)
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
    first, again = (plot_robot(robot, tmp_path / f"{k}.svg", pose).read_bytes() for k in range(2))
    assert first == again
    refused(eomgen.UnknownNameError, r"pose: 'joint9.x' is unknown", plot_robot, robot, pose={"joint9.x": 1.0})


def modes_of(robot: Robot, eigenvalues: list[complex], shapes: Any, frame: str) -> Modes:
    names = build_model(robot).coordinates
    count, zero = len(eigenvalues), np.zeros(len(names))
    return Modes(
        robot=robot.name,
        coordinates=names,
        q=zero,
        eigenvalues=np.array(eigenvalues),
        shapes=np.array(shapes),
        frame=frame,
        frame_shapes=np.zeros((count, 6), complex),
        undamped=np.zeros(count),
        resolution=0.0,
        notes=(),
    )


def test_shapes_of_modes_are_those_of_small_motions() -> None:
    """A rod of 1 m that slides along x, and one that turns: its tip moves along y, however far it is enlarged."""
    robot = eomgen.load_robot("one_link")
    found = modes_of(robot, [10.0j, 20.0j], [[1e-3, 0.0], [0.0, 2e-3j + 5.0]], "link1")
    figure, _ = plot_mode_shapes(found, robot)
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
        plot_mode_shapes(found, "puma560")
    none = replace(found, eigenvalues=np.zeros(0, complex))
    refused(InputError, "modes: there are none to draw of 'one_link'", plot_mode_shapes, none, robot)


def test_a_mechanism_is_drawn_closed() -> None:
    """At home, or where the coordinates that a pose names close it; capsules of both links reach the cut joint."""
    robot = eomgen.load_robot("four_bar")
    kernel = eomgen.build(robot, kernels=("constraint", "constraint_jacobian", "cut_poses"))
    for pose, angle in (({}, 1.0), ({"joint1.gamma": 1.4}, 1.4)):
        _, axes = plot_robot(robot, pose=pose)
        home = np.array(build_model(robot).home)
        home[0] = angle
        q = kernel.assemble(home, fixed=["joint1.gamma"])
        poses = link_poses(robot, kernel.coordinates, q)
        cut = (poses["rocker"] @ [0.4, 0.0, 0.0, 1.0])[:3]
        assert any(np.allclose(np.array(line.get_data_3d()).mean(axis=1), cut, atol=1e-9) for line in axes.lines)
        ends = [(c.link, (poses[c.link] @ [*c.end, 1.0])[:3]) for c in capsules(robot)]
        assert {link for link, end in ends if np.allclose(end, cut, atol=1e-9)} == {"rocker", "coupler"}
    with pytest.raises(eomgen.LoopError, match="loop joint4"):
        plot_robot(robot, pose={"joint1.gamma": 1.4, "joint2.gamma": 1.4, "joint3.gamma": 0.0})


# Plots as users of Matplotlib take them: figures and axes come back, and the caller's axes are drawn in


VALUES = {"duration": 0.02, "motion": {"type": "point_to_point", "goal": {"joint1": 0.1}}}
PLAN = """
samples = 8
record = ["tool_deviation_max"]
[engine]
type = "rollout"
[[vary]]
parameter = "joints.joint1.x.stiffness"
uniform = { low = 1e4, high = 2e4 }
"""


@pytest.fixture(autouse=True)
def closed_figures() -> Iterator[None]:
    yield
    pyplot.close("all")


def _response(_: Path) -> Any:
    return analysis.response("one_link", ["link1.fx", "joint1.x"], ["link1.x", "joint1.x"], np.geomspace(1.0, 100.0, 9))


def swept(folder: Path) -> Any:
    return run("one_link", VALUES, plan_from_toml(PLAN), folder / "s", threads=1)


PLOTS: dict[str, tuple[Callable[[Path], Any], tuple[Any, ...], int]] = {  # what is plotted, more arguments, axes
    "plot_tool": (lambda _: simulated(), (), 4),
    "plot_series": (lambda _: simulated(), ("joint1.gamma", "joint1.gamma.drive", "joint1.x"), 3),
    "plot_states": (lambda _: run_scenario(block(), {"duration": 0.01}), (), 1),
    "plot_deviations": (lambda _: simulated(), (), 1),
    "plot_tracking": (lambda _: simulated(), (), 2),
    "plot_energy": (lambda _: simulated(), (), 2),
    "plot_zeros": (lambda _: build_model(eomgen.load_robot("one_link")), (), 2),
    "plot_robot": (lambda _: "one_link", (), 1),
    "plot_mode_shapes": (lambda _: analysis.modes("one_link"), ("one_link",), 1),
    "plot_tracks": (lambda _: analysis.modes_along("one_link", [{"joint1.gamma": x} for x in (0.0, 0.1)]), (), 2),
    "plot_response": (_response, (), 2),
    "plot_compliance": (
        lambda _: analysis.compliance_map("ur5", (0.3, 0.1, 0.3), (0.1, 0, 0), (0, 0.1, 0), (2, 2)),
        (),
        1,
    ),
    "plot_stress_resultants": (lambda _: analysis.deflection("flexible_arm"), (), 4),
    "plot_budget": (lambda _: analysis.budget(simulated(), "one_link"), (), 1),
    "plot_column": (swept, (), 2),
    "plot_accuracy": (RESULTS["accuracy"], (), 2),
    "plot_calibration": (RESULTS["calibration"], (), 1),
    "plot_compensation": (RESULTS["compensation"], (), 4),
    "plot_excitation": (RESULTS["excitation"], (), 3),
    "plot_fit": (RESULTS["fit"], (), 1),
    "plot_identification": (RESULTS["identification"], (), 1),
    "plot_poses": (RESULTS["poses"], (), 1),
    "plot_tolerance": (RESULTS["tolerance"], (), 2),
}
ELSEWHERE = {"plot_result", "plot_sweep", "plot_journals"}  # are tested below, or with journals


def test_every_plot_is_tested() -> None:
    names = {name for name in pictures.__all__ if name.startswith("plot_")}
    assert names == PLOTS.keys() | ELSEWHERE


@pytest.mark.parametrize("name", PLOTS)
def test_a_plot_returns_figure_and_axes_writes_a_path_and_draws_in_axes(name: str, tmp_path: Path) -> None:
    make, about, count = PLOTS[name]
    subject, plot = make(tmp_path), getattr(pictures, name)
    figure, axes = plot(subject, *about)
    assert isinstance(figure, Figure)
    assert figure is pyplot.gcf(), "windows and notebooks show it"
    panels = list(np.ravel(axes))
    count = len(panels) if name in ("plot_calibration", "plot_excitation") else count  # as many as were measured
    assert [isinstance(panel, Axes) for panel in panels] == [True] * count
    assert isinstance(axes, Axes) == (count == 1)
    path = plot(subject, *about, path=tmp_path / "figure.png")
    assert path == tmp_path / "figure.png"
    assert path.read_bytes().startswith(b"\x89PNG")
    mine = pyplot.figure()
    spatial = [hasattr(panel, "get_zlim") for panel in panels]
    own = [mine.add_subplot(1, count, k + 1, **({"projection": "3d"} if s else {})) for k, s in enumerate(spatial)]
    same, drawn = plot(subject, *about, ax=own if count > 1 else own[0])
    assert same is mine
    assert list(np.ravel(drawn)) == own
    for panel, other in zip(own, panels, strict=True):
        for mark in (panel, other):
            assert mark.has_data(), "something is drawn in every panel"
        drawn_lines, others = ([np.asarray(line.get_ydata()).tolist() for line in x.lines] for x in (panel, other))
        assert drawn_lines == others
    with pytest.raises(InputError, match=rf"^ax: {count + 1} axes; allowed: {count},"):
        plot(subject, *about, ax=[*own, mine.add_subplot()])
    refused(InputError, r"^ax: got a value of type str; allowed: Axes of Matplotlib", plot, subject, *about, ax="axes")
    if any(spatial):
        flat = [mine.add_subplot(1, count, k + 1) for k in range(count)]
        refused(InputError, r"^ax(\[0\])?: is flat; allowed: axes in space", plot, subject, *about, ax=flat)


def kinds_with_plots() -> Iterator[type[Plotting]]:
    """All classes of results that plot themselves, from all packages that have some."""
    for room in (analysis, eomgen.identification, eomgen.simulation, eomgen.sweep):
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            import_module(module.name)
    yield from Plotting.__subclasses__()


def test_the_plot_of_every_kind_is_a_function_that_takes_it() -> None:
    """A class names it as a text, as pictures are a room above it."""
    kinds = list(kinds_with_plots())
    assert len(kinds) > 10
    for kind in kinds:
        assert kind._plot in pictures.__all__, kind
        subject = next(iter(inspect.signature(getattr(pictures, kind._plot)).parameters.values()))
        assert re.search(rf"\b{kind.__name__}\b", str(subject.annotation)), (kind, subject)


@pytest.mark.soak
def test_results_plot_themselves(tmp_path: Path) -> None:
    """By the function of their kind, with its arguments."""
    for name, (make, about, _) in PLOTS.items():
        subject = make(tmp_path)
        if isinstance(subject, Plotting) and not name.endswith(("_tool", "_deviations", "_tracking", "_energy")):
            assert subject.plot(*about, path=tmp_path / f"{name}.svg").read_text().startswith("<?xml"), name
    figure, axes = simulated().plot()
    assert isinstance(figure, Figure)
    assert len(axes) == 4
    figure, axis = simulated().plot("joint1.gamma")
    curve = axis.lines[0].get_ydata()
    factor = 1e3 if axis.get_ylabel() == "mrad" else 1.0
    np.testing.assert_allclose(curve / factor, simulated().series("joint1.gamma").values, rtol=1e-14)
    with pytest.raises(UnknownNameError, match=r"^series: 'joint1.gama', did you mean|^series: 'joint1.gama'"):
        simulated().plot("joint1.gama")


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    refused(NotInstalledError, r'^plots need Matplotlib.*pip install "eomgen\[sim\]"', simulated().plot)


def test_figures_of_a_result_come_by_name(tmp_path: Path) -> None:
    drawn = pictures.plot_result(simulated())
    assert set(drawn) == {"tool", "deviations", "tracking", "energy"}
    assert all(isinstance(figure, Figure) for figure, _ in drawn.values())
    sweep = swept(tmp_path)
    _, axes = pictures.plot_sweep(sweep)
    assert [panel.get_xlabel().split(",")[0] for panel in axes] == ["tool_deviation_max", "standardized coefficient"]
    written = pictures.plot_sweep(sweep, tmp_path / "out", "tool_deviation_max")
    assert [path.name for path in written] == ["distribution.png", "sensitivity.png"]
    refused(InputError, r"^ax: comes together with a folder", pictures.plot_sweep, sweep, tmp_path, ax=axes)
    refused(UnknownNameError, "", pictures.plot_sweep, sweep, column="nothing")


WRONG = ("one_link", Path("out"), {}, None, 3, np.zeros(3), object())


@pytest.mark.parametrize("name", sorted({*PLOTS, *ELSEWHERE} - {"plot_robot"}))
def test_what_is_no_result_is_refused_by_name(name: str) -> None:
    """Where a result is asked for: a robot's name, a path, a dict, None, a number, an array."""
    plot = getattr(pictures, name)
    argument = next(iter(inspect.signature(plot).parameters))
    about = ("one_link",) if name == "plot_mode_shapes" else ()
    for wrong in WRONG:
        words = rf"^{argument}: got a value of type \w+; allowed: an? [A-Z]\w+, from "
        refused(InputError, words, plot, wrong, *about)


def test_round_off_is_not_drawn_as_a_response(tmp_path: Path) -> None:
    """A response of 1e-16 beside one of 1e-3 in the same unit is left out; a notch does not set the scale."""
    whole = _response(tmp_path)
    H = np.array(whole.H)
    assert np.abs(H).min() > 0.0
    H[..., 1] = 1e-16 * H[..., 0]
    H[3, 0, 0] = 1e-15 * np.abs(H[..., 0, 0]).max()
    _, (upper, _) = pictures.plot_response(replace(whole, H=H))
    labels = [line.get_label() for line in upper.lines]
    assert len(labels) == 2
    assert all(f"from {whole.inputs[0]}, " in label for label in labels)
    assert upper.get_ylim()[0] > 1e-8 * np.abs(H[..., 0, 0]).max()


def test_views_look_along_axes_of_the_base() -> None:
    for view, hidden in (("side", "y"), ("front", "x"), ("back", "x"), ("top", "z")):
        _, axes = pictures.plot_robot("puma560", view=view)
        ticks = {name: len(getattr(axes, f"get_{name}ticks")()) for name in "xyz"}
        assert [name for name, count in ticks.items() if not count] == [hidden]
    with warnings.catch_warnings(), pytest.raises(InputError, match=r"^view: 'sde', did you mean|^view: 'sde'"):
        pictures.plot_robot("puma560", view="sde")


def test_a_backend_that_is_none_is_refused() -> None:
    code = """
    import json
    from eomgen.errors import InputError
    from eomgen.pictures.style import sheet
    try:
        with sheet(1.0, 1.0, "x.svg"):
            pass
    except InputError as error:
        print(json.dumps(str(error)))
    """
    said = answer(python(code, MPLBACKEND="nonsense\x1b"))
    assert said == "the environment's MPLBACKEND is 'nonsense\\x1b'; allowed: a backend of Matplotlib"
