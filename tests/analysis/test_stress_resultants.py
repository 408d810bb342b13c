"""Stress resultants of links that are beams: textbook cantilevers and spans, reactions of joints, files and figures."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis import deflection
from eomgen.bending.beam import beam_shapes
from eomgen.bending.beams.resultants import COMPONENTS, StressResultants
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.pictures import report_of
from eomgen.robot.value import AXES, Robot
from tests.support.commands import command, facts
from tests.support.joint_table import beam_table, frame_table, joint_table, link_table, loop_table

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

LENGTH, GRAVITY = 1.5, 9.81


def boom(axis: str = "x", section: str = "{ tube = [0.06, 0.05] }", gravity: str = "[0.0, 0.0, -9.81]") -> Robot:
    return robot_from_toml(boom_text(axis, section, gravity))


def boom_text(axis: str = "x", section: str = "{ tube = [0.06, 0.05] }", gravity: str = "[0.0, 0.0, -9.81]") -> str:
    return f"""
name = "boom"
gravity = {gravity}
{beam_table("tube", 1.5, section, "{ y = 2, z = 2 }", 2.63e10)}
axis = "{axis}"
{joint_table("slew", "base", "tube", "revolute")}
placement = {{ xyz = [0.1, 0.0, 0.2] }}
{frame_table("tcp", "tube")}
node = "tip"
"""


def crossed(beam: str) -> str:
    """Return a trolley that slides along a beam."""
    return f'{link_table("trolley", 5.0)}\n{joint_table("cross", beam, "trolley", "prismatic")}\nalong = "beam"\n'


def of(beam: StressResultants, name: str) -> np.ndarray:
    return beam.resultants[:, COMPONENTS.index(name)]


def test_a_cantilever_has_the_moments_of_the_textbook() -> None:
    """M = F (L - x) + q (L - x)^2 / 2, as far as the deflection, 3e-3 of the length, leaves the arms as they were."""
    robot = boom()
    link = robot.links[0]
    found = deflection(robot, loads={"tcp": [30.0, 20.0, -50.0, 3.0, 2.0, 1.0]})
    [beam] = found.beams
    q, arm = link.mass * GRAVITY / LENGTH, LENGTH - beam.x
    expected = {
        "N": np.full_like(arm, 30.0),
        "Vy": np.full_like(arm, 20.0),
        "Vz": -50.0 - q * arm,
        "T": np.full_like(arm, 3.0),
        "My": 50.0 * arm + q * arm**2 / 2 + 2.0,
        "Mz": 20.0 * arm + 1.0,
    }
    for name, values in expected.items():
        assert of(beam, name) == pytest.approx(values, abs=0.01 * 60.0), name
    # at the root they are the joint's reaction, at the tip the load
    kernel, still = eomgen.build(robot, kernels=("reactions", "external_reactions", "kinematics")), np.zeros(5)
    reactions = kernel.reactions(found.q, still, still, wrench={"tcp": [30.0, 20.0, -50.0, 3.0, 2.0, 1.0]})
    assert beam.resultants[0] == pytest.approx(-reactions[0], abs=1e-11)
    assert beam.resultants[-1] == pytest.approx(-reactions[1], abs=1e-11)
    # of a stiff beam they are the textbook's
    stiffness = {f"links.tube.modes.{k + 1}.stiffness": 1e6 * row[k] for k, row in enumerate(link.modes.K)}
    [stiff] = deflection(robot, parameters=stiffness).beams
    assert of(stiff, "My") == pytest.approx(q * arm**2 / 2, rel=1e-9, abs=1e-9)
    assert of(stiff, "Vz") == pytest.approx(-q * arm, rel=1e-9, abs=1e-9)
    # curvatures of two mode shapes have 5/6 of the weight's moment at the root
    Phi, _ = beam_shapes(link.beam, [0.0, 1e-6])
    curvature = (Phi[1, 4] - Phi[0, 4]) / 1e-6 @ deflection(robot).q[1:]
    assert link.beam.E * link.beam.Iy * curvature == pytest.approx(5 / 6 * q * LENGTH**2 / 2, rel=1e-3)


def test_stress_is_that_of_the_outermost_fibre(tmp_path: Path) -> None:
    """N / A + M r / I of a tube; of a rectangle both moments at a corner; none without the form of the section."""
    robot = boom()
    [beam] = deflection(robot, loads={"tcp": [1000.0, 20.0, -50.0, 0.0, 0.0, 0.0]}).beams
    made = robot.links[0].beam
    assert made.section == ("tube", (0.06, 0.05))
    M = np.hypot(of(beam, "My"), of(beam, "Mz"))
    assert beam.stress == pytest.approx(np.abs(of(beam, "N")) / made.A + M * 0.03 / made.Iy, rel=1e-12)
    changed = robot.with_value("links.tube.beam.Iy", 2e-7)
    assert changed.links[0].beam.section is None
    assert robot.with_value("links.tube.beam.E", 8e10).links[0].beam.section == made.section
    with pytest.raises(DescriptionError, match=r"links.tube.beam.section: its numbers follow from it"):
        robot.with_value("links.tube.beam.section", ["tube", [0.07, 0.05]])
    with pytest.raises(InputError, match=r"no link of one_link is a beam"):
        deflection("one_link").save(tmp_path / "beams.csv")


def test_files_and_figures_have_them(tmp_path: Path) -> None:
    """A row of the .csv for each section; a figure; JSON."""
    path, table, page = tmp_path / "boom.toml", tmp_path / "beams.csv", tmp_path / "boom.html"
    path.write_text(boom_text())
    [beam] = facts("deflection", path, "-o", table)["beams"]
    header, *rows = csv.reader(table.read_text().splitlines()[1:])
    assert header == ["beam", "x", *COMPONENTS, "stress"]
    assert [float(row[header.index("My")]) for row in rows] == beam["My"]
    assert {row[0] for row in rows} == {"tube"}
    again = tmp_path / "again.csv"
    assert deflection(boom()).save(again) == again
    assert again.read_text() == table.read_text()
    assert "beam tube: stress resultants" in command("deflection", path, "-o", tmp_path / "beams.svg")
    assert (tmp_path / "beams.svg").exists()
    assert f"wrote {page}" in command("deflection", path, "--report", page)
    assert "Stress resultants of tube" in page.read_text()
    for option in (("--map", *"000100010"), ("--matrix", "slew")):
        said = command("deflection", path, *option, "--report", page, code=1)
        assert f"report and {option[0][2:]} are both given; allowed: one of them" in said
    assert "no link of one_link is a beam" in command("deflection", "one_link", "-o", table, code=1)


@pytest.mark.soak
def test_a_page_has_their_numbers() -> None:
    """With deflection and compliance, and a figure; without beams there is none."""
    found = deflection(boom(), loads={"tcp": [0.0, 0.0, -50.0, 0.0, 0.0, 0.0]})
    page = report_of(found)
    tables = {table.title: {row[0]: row[1:] for row in table.rows} for table in page.tables}
    [beam] = found.beams
    moments = [float(row[4]) for row in tables["Stress resultants of tube"].values()]
    assert moments == pytest.approx(of(beam, "My"), 1e-5)
    stress = [float(row[-1]) for row in tables["Stress resultants of tube"].values()]
    assert stress == pytest.approx(1e-6 * beam.stress, rel=1e-5)
    assert [float(row[0]) for row in tables["Deflection"].values()] == pytest.approx(found.deflection, 1e-5)
    assert float(tables["Compliance, m, rad per N, N m"]["z"][2]) == pytest.approx(found.compliance[2, 2], 1e-3)
    assert tables["Static equilibrium"]["tube.mode3"][0] == f"{found.q[3]:.6g}"
    assert [figure.name for figure in page.figures] == ["stress_resultants"]
    assert not report_of(deflection("one_link")).figures


@pytest.mark.soak
@pytest.mark.parametrize("axis", ["y", "-z"])
def test_they_follow_the_axes_of_the_section(axis: str) -> None:
    """A beam along another axis under loads that are turned likewise."""
    R, load = np.array(AXES[axis]), np.array([[30.0, 20.0, -50.0], [3.0, 2.0, 1.0]])
    section = "{ bar = [0.06, 0.03] }"
    [straight] = deflection(boom(section=section), loads={"tcp": load.ravel()}, fixed=["slew.gamma"]).beams
    turned = boom(axis, section, str((R @ [0.0, 0.0, -GRAVITY]).tolist()))
    [beam] = deflection(turned, loads={"tcp": (load @ R.T).ravel()}, fixed=["slew.gamma"]).beams
    # axes of a bent section are turned about the link's axes, in their order: of second order
    assert beam.resultants == pytest.approx(straight.resultants, abs=2e-3)
    height, width = 0.06, 0.03
    made = turned.links[0].beam
    by_y, by_z = (np.abs(of(beam, name)) for name in ("My", "Mz"))
    expected = np.abs(of(beam, "N")) / made.A + by_y * height / 2 / made.Iy + by_z * width / 2 / made.Iz
    assert beam.stress == pytest.approx(expected, rel=1e-12)


SPAN = f"""
name = "span"
gravity = [0.0, -9.81, 0.0]
driven = []
{beam_table("bridge", 2.0, "{ box = [0.1, 0.06, 0.005] }", "{ y = 2, axial = 1 }")}
{joint_table("pin", "base", "bridge", "revolute")}
{loop_table("bearing", "base", "bridge", "spherical")}
nodes = ["root", "tip"]
x = {{}}
placements = [{{ xyz = [2.0, 0.0, 0.0] }}, {{}}]
{frame_table("tcp", "bridge")}
node = "tip"
"""


@pytest.mark.soak
def test_a_span_on_two_supports_has_the_moments_of_the_textbook() -> None:
    """M = q x (L - x) / 2, and what a moment at the bearing adds; a loop carries the tip."""
    robot = robot_from_toml(SPAN)
    q = robot.links[0].mass * GRAVITY / 2.0
    [beam] = deflection(robot).beams
    assert of(beam, "Mz") == pytest.approx(q * beam.x * (2.0 - beam.x) / 2.0, abs=1e-6)
    assert of(beam, "Vy") == pytest.approx(-q * (1.0 - beam.x), abs=1e-5)
    [loaded] = deflection(robot, loads={"tcp": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}).beams
    assert of(loaded, "Mz") - of(beam, "Mz") == pytest.approx(beam.x / 2.0, abs=1e-6)


@pytest.mark.soak
def test_a_load_between_the_ends_makes_a_step() -> None:
    """At a node in the middle of the beam: the shear force steps there, and the moment has a kink."""
    text = boom_text(gravity="[0.0, 0.0, 0.0]")
    node = "modes = { y = 2, z = 2 }\nnodes = { middle = 0.75 }"
    text = text.replace("modes = { y = 2, z = 2 }", node) + '[[frames]]\nname = "mid"\nlink = "tube"\nnode = "middle"\n'
    [beam] = deflection(robot_from_toml(text), loads={"mid": [0.0, 0.0, -10.0, 0.0, 0.0, 0.0]}).beams
    assert of(beam, "Vz") == pytest.approx(np.where(beam.x <= 0.75, -10.0, 0.0), abs=1e-4)
    assert of(beam, "My") == pytest.approx(10.0 * np.maximum(0.75 - beam.x, 0.0), abs=1e-4)


@pytest.mark.soak
@pytest.mark.parametrize("axis", ["x", "-z"])
def test_a_trolley_on_a_cantilever_makes_a_step_where_it_is(axis: str) -> None:
    """Its weight and a force on it, on a beam that is so stiff that it is the textbook's; at the root the reaction."""
    gravity = {"x": "[0.0, 0.0, -9.81]", "-z": "[-9.81, 0.0, 0.0]"}[axis]
    text = boom_text(axis, gravity=gravity)
    robot = robot_from_toml(text + crossed("tube"))
    link, force = robot.links[0], 20.0 / GRAVITY * np.array(robot.gravity)
    pose, loads = {"cross.z": 0.8}, {"trolley": [*force, 0.0, 0.0, 0.0]}
    stiffness = {f"links.tube.modes.{k + 1}.stiffness": 1e6 * row[k] for k, row in enumerate(link.modes.K)}
    [beam] = deflection(robot, pose, loads=loads, parameters=stiffness).beams
    q, arm, P = link.mass * GRAVITY / LENGTH, LENGTH - beam.x, 5.0 * GRAVITY + 20.0
    shear, bending = (np.hypot(of(beam, f"{kind}y"), of(beam, f"{kind}z")) for kind in "VM")
    assert shear == pytest.approx(q * arm + P * (beam.x < 0.8), rel=1e-7, abs=1e-6)
    assert bending == pytest.approx(q * arm**2 / 2 + P * np.maximum(0.8 - beam.x, 0.0), rel=1e-7, abs=1e-6)
    found = deflection(robot, pose, loads=loads)
    kernel, still = eomgen.build(robot, kernels=("reactions", "external_reactions", "kinematics")), np.zeros(6)
    reactions = dict(zip(kernel.joints, kernel.reactions(found.q, still, still, wrench=loads), strict=True))
    root, turn = -reactions["slew"].reshape(2, 3), np.array(AXES[axis])
    assert found.beams[0].resultants[0] == pytest.approx((root @ turn).ravel(), abs=1e-10)


@pytest.mark.soak
def test_a_trolley_on_a_span_has_the_moments_of_the_textbook() -> None:
    """M = P a b / L under it, on two supports."""
    robot = robot_from_toml(SPAN.replace("driven = []", 'driven = ["cross.z"]') + crossed("bridge"))
    [empty], [beam] = (
        deflection(robot, {"cross.z": 0.6}, loads={"trolley": [0.0, force, 0.0, 0.0, 0.0, 0.0]}).beams
        for force in (5.0 * GRAVITY, -30.0)
    )
    P = 5.0 * GRAVITY + 30.0
    expected = P * np.where(beam.x < 0.6, 1.4 * beam.x, 0.6 * (2.0 - beam.x)) / 2.0
    assert of(beam, "Mz") - of(empty, "Mz") == pytest.approx(expected, rel=1e-4, abs=1e-4)


LEVER = f"""
name = "lever"
gravity = [0, 0, -9.81]
driven = ["crank.gamma"]
{beam_table("lever", 1.0, "{ box = [0.02, 0.02, 0.002] }", "{ y = 1 }")}
{link_table("block", 1.0, inertia=(0.01, 0.01, 0.01))}
{link_table("arm", 1.0, (0.1, 0, 0), (0.01, 0.01, 0.01))}
{joint_table("pivot", "base", "lever", "revolute")}
placement = {{ rpy_deg = [90, 0, 0] }}
{joint_table("slide", "lever", "block", "prismatic")}
along = "beam"
{joint_table("crank", "base", "arm", "revolute")}
placement = {{ xyz = [0.3, 0, 0], rpy_deg = [90, 0, 0] }}
{loop_table("pin", "block", "arm", "spherical")}
placements = [{{}}, {{ xyz = [0.2, 0, 0] }}]
"""


@pytest.mark.soak
def test_beams_in_loops_are_held_by_drives() -> None:
    """A block that slides undriven, and is part of a loop: what is held is as if it were driven, alone."""
    robot, pose = robot_from_toml(LEVER), {"pivot": 0.3, "crank": 1.9, "slide": 0.4}
    [beam] = deflection(robot, pose, frame="block").beams
    assert of(beam, "Mz")[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.abs(of(beam, "Mz")).max() > 0.1
    other = replace(robot, driven=("pivot.gamma",))
    load = {"lever": [0.0, 3.0, -20.0, 1.0, 0.5, 0.2]}
    for loads in ({}, load):
        [beam] = deflection(robot, pose, frame="block", fixed=["pivot.gamma"], loads=loads).beams
        [expected] = deflection(other, pose, frame="block", loads=loads).beams
        assert of(expected, "Mz")[0] != pytest.approx(0.0, abs=0.1)
        for name in ("Vy", "N", "Mz"):
            size = np.abs(of(expected, "Mz")).max()
            assert of(beam, name) == pytest.approx(of(expected, name), rel=1e-6, abs=1e-6 * size)
