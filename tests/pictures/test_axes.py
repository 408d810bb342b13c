"""Plots as Matplotlib's users take them: figures and axes come back, and the caller's axes are drawn in."""

from __future__ import annotations

import inspect
import pkgutil
import re
import struct
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import eomgen
from eomgen import analysis, pictures
from eomgen.errors import EomgenWarning, InputError, UnknownNameError
from eomgen.identification import accuracy, poses, tolerance
from eomgen.optional import NotInstalledError
from eomgen.pictures.shapes import read_stl, urdf_shapes
from eomgen.robot import build_model
from eomgen.shown import Plotting
from eomgen.simulation import SimulationResult, run_scenario
from eomgen.sweep import plan_from_toml, run
from tests.pictures.test_measured_pages import MEASURED, calibration, fitted, identified
from tests.support.bristles import block
from tests.support.measured_results import _compensation, _excitation

pytestmark = pytest.mark.usefixtures("unoptimised")

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


@cache
def simulated() -> SimulationResult:
    return run_scenario("one_link", VALUES)


@cache
def modes() -> Any:
    return analysis.modes("one_link")


def _response(_: Path) -> Any:
    return analysis.response("one_link", ["link1.fx", "joint1.x"], ["link1.x", "joint1.x"], np.geomspace(1.0, 100.0, 9))


def _accuracy(folder: Path) -> Any:
    (folder / "a.csv").write_text(MEASURED)
    return accuracy(folder / "a.csv")


RESULTS: dict[str, tuple[Callable[[Path], Any], tuple[Any, ...], int]] = {  # what is plotted, more arguments, axes
    "plot_tool": (lambda _: simulated(), (), 4),
    "plot_series": (lambda _: simulated(), ("joint1.gamma", "joint1.gamma.drive", "joint1.x"), 3),
    "plot_states": (lambda _: run_scenario(block(), {"duration": 0.01}), (), 1),
    "plot_deviations": (lambda _: simulated(), (), 1),
    "plot_tracking": (lambda _: simulated(), (), 2),
    "plot_energy": (lambda _: simulated(), (), 2),
    "plot_zeros": (lambda _: build_model(eomgen.load_robot("one_link")), (), 2),
    "plot_robot": (lambda _: "one_link", (), 1),
    "plot_mode_shapes": (lambda _: modes(), ("one_link",), 1),
    "plot_tracks": (lambda _: analysis.modes_along("one_link", [{"joint1.gamma": x} for x in (0.0, 0.1)]), (), 2),
    "plot_response": (_response, (), 2),
    "plot_compliance": (
        lambda _: analysis.compliance_map("ur5", (0.3, 0.1, 0.3), (0.1, 0, 0), (0, 0.1, 0), (2, 2)),
        (),
        1,
    ),
    "plot_stress_resultants": (lambda _: analysis.deflection("flexible_arm"), (), 4),
    "plot_budget": (lambda _: analysis.budget(simulated(), "one_link"), (), 1),
    "plot_column": (lambda folder: run("one_link", VALUES, plan_from_toml(PLAN), folder / "s", threads=1), (), 2),
    "plot_accuracy": (_accuracy, (), 2),
    "plot_calibration": (lambda _: calibration(), (), 1),
    "plot_compensation": (_compensation, (), 4),
    "plot_excitation": (_excitation, (), 3),
    "plot_fit": (lambda _: fitted(), (), 1),
    "plot_poses": (lambda _: poses("ur5", count=6, candidates=30), (), 1),
    "plot_tolerance": (lambda _: tolerance("one_link", {"joints.*.offset.x": {"bound": 3e-4}}, random=5), (), 2),
}
ELSEWHERE = {"plot_result", "plot_sweep", "plot_identification", "plot_journals"}  # are tested below, or with journals


def test_every_plot_is_tested() -> None:
    names = {name for name in pictures.__all__ if name.startswith("plot_")}
    assert names == RESULTS.keys() | ELSEWHERE


@pytest.mark.parametrize("name", RESULTS)
def test_a_plot_returns_figure_and_axes_writes_a_path_and_draws_in_axes(name: str, tmp_path: Path) -> None:
    make, about, count = RESULTS[name]
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
    with pytest.raises(InputError, match=r"^ax: got a value of type str; allowed: Axes of Matplotlib"):
        plot(subject, *about, ax="axes")
    if any(spatial):
        flat = [mine.add_subplot(1, count, k + 1) for k in range(count)]
        with pytest.raises(InputError, match=r"^ax(\[0\])?: is flat; allowed: axes in space"):
            plot(subject, *about, ax=flat)


def kinds_with_plots() -> Iterator[type[Plotting]]:
    """All classes of results that plot themselves, from all rooms that have some."""
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
    for name, (make, about, _) in RESULTS.items():
        subject = make(tmp_path)
        if isinstance(subject, Plotting) and name not in (
            "plot_tool",
            "plot_deviations",
            "plot_tracking",
            "plot_energy",
        ):
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
    assert identified().plot is not None


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(NotInstalledError, match=r'^plots need Matplotlib.*pip install "eomgen\[sim\]"'):
        simulated().plot()


def test_figures_of_a_result_come_by_name(tmp_path: Path) -> None:
    drawn = pictures.plot_result(simulated())
    assert set(drawn) == {"tool", "deviations", "tracking", "energy"}
    assert all(isinstance(figure, Figure) for figure, _ in drawn.values())
    sweep = RESULTS["plot_column"][0](tmp_path)
    _, axes = pictures.plot_sweep(sweep)
    assert [panel.get_xlabel().split(",")[0] for panel in axes] == ["tool_deviation_max", "standardized coefficient"]
    written = pictures.plot_sweep(sweep, tmp_path / "out", "tool_deviation_max")
    assert [path.name for path in written] == ["distribution.png", "sensitivity.png"]
    with pytest.raises(InputError, match=r"^ax: comes together with a folder"):
        pictures.plot_sweep(sweep, tmp_path, ax=axes)
    with pytest.raises(UnknownNameError):
        pictures.plot_sweep(sweep, column="nothing")


WRONG = ("one_link", Path("out"), {}, None, 3, np.zeros(3), object())


@pytest.mark.parametrize("name", sorted({*RESULTS, *ELSEWHERE} - {"plot_robot"}))
def test_what_is_no_result_is_refused_by_name(name: str) -> None:
    """Where a result is asked for: a robot's name, a path, a dict, None, a number, an array."""
    plot = getattr(pictures, name)
    argument = next(iter(inspect.signature(plot).parameters))
    about = ("one_link",) if name == "plot_mode_shapes" else ()
    for wrong in WRONG:
        words = rf"^{argument}: got a value of type \w+; allowed: an? [A-Z]\w+, from "
        with pytest.raises(InputError, match=words):
            plot(wrong, *about)


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
        vertices, faces = read_stl(data)
        np.testing.assert_array_equal(vertices[faces], corners)
        assert len(np.unique(vertices, axis=0)) == len(vertices)
    for data in (binary(corners[:0]), b"solid x\nendsolid x\n", binary(np.full((1, 3, 3), np.nan))):
        with pytest.raises(ValueError, match="without triangles"):
            read_stl(data)


def test_meshes_are_drawn_and_missing_ones_named(tmp_path: Path) -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.2, 0.7]]])
    (tmp_path / "arm.stl").write_bytes(binary(corners))
    inertial = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"
    shown = "".join(
        f"<visual><geometry>{x}</geometry></visual>"
        for x in ("<mesh filename='arm.stl'/>", "<box size='1 2 3'/>", "<sphere radius='0.5'/>")
    )
    joint = "<joint name='{0}' type='continuous'><parent link='{1}'/><child link='{2}'/></joint>"
    urdf = tmp_path / "arm.urdf"
    gone = "<visual><geometry><mesh filename='gone.stl'/></geometry></visual>"
    urdf.write_text(
        f"<robot name='arm'><link name='ground'/><link name='a'>{inertial}{shown}</link>"
        f"<link name='b'>{inertial}{gone}</link>{joint.format('j', 'ground', 'a')}{joint.format('k', 'a', 'b')}</robot>"
    )
    robot = eomgen.load_robot(urdf)
    shapes, _ = urdf_shapes(robot)
    sizes = [np.ptp(shape.vertices, axis=0) for shape in shapes]
    np.testing.assert_allclose(sizes, [[0.3, 0.2, 0.7], [1.0, 2.0, 3.0], [1.0] * 3], rtol=1e-6)
    with pytest.warns(EomgenWarning, match=r"^arm: shape of b: there is no mesh 'gone.stl'"):
        _, axes = pictures.plot_robot(robot)
    assert len(axes.collections) == len(shapes) + 1, "three shapes, and the capsule of b"


def test_views_look_along_axes_of_the_base() -> None:
    for view, hidden in (("side", "y"), ("front", "x"), ("back", "x"), ("top", "z")):
        _, axes = pictures.plot_robot("puma560", view=view)
        ticks = {name: len(getattr(axes, f"get_{name}ticks")()) for name in "xyz"}
        assert [name for name, count in ticks.items() if not count] == [hidden]
    with warnings.catch_warnings(), pytest.raises(InputError, match=r"^view: 'sde', did you mean|^view: 'sde'"):
        pictures.plot_robot("puma560", view="sde")
