"""Beams, links that bend and joints along them in descriptions: reading, changes, and what is refused."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

import eomgen
from eomgen.authoring.check import check_file
from eomgen.authoring.inertia import mass_matrix
from eomgen.bending.beam import beam_inertia, beam_modes
from eomgen.bending.bending_body import BendingBody
from eomgen.bending.element_files import arrays_of
from eomgen.bending.files import write_constants
from eomgen.bending.reduction import reduce
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.description.load import robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError, InputError
from eomgen.identification.dynamics.as_toml import write_toml
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot import Beam
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash
from eomgen.robot.value import COORDINATES, BeamModes, Placement, Robot
from tests.bending.test_files import nodal, saved
from tests.support.beam_elements import Plane
from tests.support.beams import SIZES, STEEL, cantilever, toml
from tests.support.description_samples import URDF
from tests.support.finite_elements import bar
from tests.support.joint_table import beam_table, frame_table, joint_table, link_table, loop_table
from tests.support.refusals import refused
from tests.support.text_files import text_file

pytestmark = pytest.mark.quick
EXAMPLE = Path(__file__).parents[2] / "examples" / "flexible_boom.toml"
SECTION: dict[str, Any] = {**dict.fromkeys(SIZES), "section": {"tube": [0.06, 0.05]}}


def test_the_example_is_read() -> None:
    """A chain of links that fixed joints end, in the order of the tree; all of it named after the beam."""
    robot = eomgen.load_robot(EXAMPLE)
    names = [f"boom{k}" for k in range(7)]
    assert [joint.name for joint in robot.joints] == ["slew", *names, "boom_tip", "wrist"]
    assert [link.name for link in robot.links] == ["turntable", *names, "head", "gripper"]
    assert build_model(robot).coordinates == (
        "slew.gamma",
        *(f"{name}.{key}" for name in names[1:] for key in COORDINATES),
        "wrist.gamma",
    )
    assert robot.rigid().beams == ()
    assert build_model(robot.rigid()).coordinates == ("slew.gamma", "wrist.gamma")
    checked = check_file(EXAMPLE)
    assert (checked.errors, checked.notes) == ((), ())
    assert checked.summary == {"links": 10, "coordinates": 38}
    (beam,) = robot.beams
    assert beam.mass == pytest.approx(2700.0 * math.pi / 4 * (0.06**2 - 0.05**2) * 2.0)


def test_stiffness_and_damping_of_a_segment() -> None:
    """The formulas of the middle of a segment; damping proportional to each."""
    E, G, l = STEEL["E"], STEEL["G"], 1.3 / 4  # noqa: E741
    py, pz = (12 * E * I / (G * 2e-3 * k * l**2) for I, k in ((3e-7, 0.8), (4e-7, 0.6)))  # noqa: E741
    stiffness = {
        "x": E * 2e-3 / l,
        "y": 12 * E * 3e-7 / (l**3 * (1 + py)),
        "z": 12 * E * 4e-7 / (l**3 * (1 + pz)),
        "alpha": G * 5e-7 / l,
        "beta": E * 4e-7 / l,
        "gamma": E * 3e-7 / l,
    }
    w = 2 * math.pi * 40.0
    for damping, factors in (
        (None, [0.0] * 6),
        ({"ratio": 0.02, "at_hz": 40.0}, [2 * 0.02 / w] * 6),
        ({"loss_factor": 0.02, "at_hz": 40.0}, [0.02 / w] * 6),
        (1e-4, [1e-4] * 6),
        (0, [0.0] * 6),
        ([1e-4, 0, 0, 2e-4, 3e-4, 4e-4], [1e-4, 0, 0, 2e-4, 3e-4, 4e-4]),
    ):
        robot = cantilever(segments=4, damping=damping)
        for name in ("boom1", "boom4"):
            for (key, wanted), factor in zip(stiffness.items(), factors, strict=True):
                coordinate = robot.joint(name).coordinates[key]
                assert coordinate.stiffness == pytest.approx(wanted, rel=1e-13)
                assert (coordinate.damping or 0.0) == pytest.approx(factor * wanted, rel=1e-13)
                assert (coordinate.damping is None) == (factor == 0.0)


def test_numbers_beside_a_section_stand_in_the_place_of_its_own() -> None:
    """Also shear coefficients, which then need no Poisson's ratio."""
    plain = cantilever(**SECTION).beams[0]
    J, nu = math.pi / 32 * (0.06**4 - 0.05**4), STEEL["E"] / (2 * STEEL["G"]) - 1
    square = (1 + (5 / 6) ** 2) ** 2
    shear = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * (5 / 6) ** 2)
    assert (plain.J, *plain.shear) == pytest.approx((J, shear, shear))
    changed = cantilever(**{**SECTION, "J": 1e-6, "shear": [0.4, 0.3], "G": 1e9}).beams[0]
    assert (changed.A, changed.Iy, changed.Iz) == (plain.A, plain.Iy, plain.Iz)
    assert (changed.J, changed.shear, changed.G) == (1e-6, (0.4, 0.3), 1e9)


def test_rigid_coordinates_are_none() -> None:
    robot = cantilever(segments=3, rigid=["x", "alpha"])
    assert list(robot.joint("boom2").coordinates) == ["y", "z", "beta", "gamma"]
    assert build_model(robot).size == 12


def test_beams_follow_each_other_and_carry_joints_where_a_node_is() -> None:
    """A beam on another one's tip, a frame and a link at an inner node; tunable numbers of a segment."""
    more = f"""
tunable = ["links.boom1.mass"]
{link_table("tool", 1.0)}
{link_table("bob", 0.5)}
{joint_table("hinge", "boom1", "bob", "revolute")}
[[beams]]
name = "jib"
parent = "head"
child = "tool"
length = 0.4
segments = 1
E = 7e10
G = 2.6e10
density = 2700
section = {{ rod = 0.02 }}
"""
    top, _, rest = more.partition("[[links]]")
    robot = robot_from_toml(top + toml({}, 1.0, "[[links]]" + rest))
    assert [joint.name for joint in robot.joints] == [
        *("boom0", "boom1", "hinge", "boom2", "boom_tip", "jib0", "jib1", "jib_tip")
    ]
    assert build_model(robot).parameters["links.boom1.mass"] == robot.link("boom1").mass
    assert "joints.boom1.beta.stiffness" in build_model(robot).parameters


def test_a_beam_behind_a_urdf(tmp_path: Path) -> None:
    """'base' is its root link; a beam's child is a link that the TOML adds."""
    (tmp_path / "arm.urdf").write_text(URDF, encoding="ascii")
    beam = toml({"parent": "lower"}).replace('name = "crane"', 'urdf = "arm.urdf"')
    robot = eomgen.load_robot(text_file(tmp_path / "arm.toml", beam))
    assert robot.joints[-1].child == "head"
    for parent in ("base", "ground"):
        (tmp_path / "arm.toml").write_text(beam.replace('parent = "lower"', f'parent = "{parent}"'), encoding="ascii")
        robot = eomgen.load_robot(tmp_path / "arm.toml")
        assert robot.joint("boom0").parent == robot.base == "ground"
        assert robot.with_value("beams.boom.segments", 3).joint("boom0").parent == "ground"
    (tmp_path / "arm.toml").write_text(beam.replace('"lower"', '"lowr"'), encoding="ascii")
    with pytest.raises(DescriptionError, match=r"arm\.toml:[0-9]+:[0-9]+: beams\.boom\.parent: .*'lowr'.*'lower'"):
        eomgen.load_robot(tmp_path / "arm.toml")


def test_more_links_than_there_may_be() -> None:
    """Those of beams count."""
    beams = []
    for k in range(50):
        parent = "base" if not k else f"head{k - 1}"
        keys = toml({"name": f"b{k}_", "parent": parent, "child": f"head{k}", "segments": 100})
        beams.append(keys.replace('name = "crane"', "").replace('name = "head"', f'name = "head{k}"'))
    text = 'name = "crane"\n' + "".join(beams)
    with pytest.raises(DescriptionError, match=r"beams\.b49_\.segments: got 100, and .* 5100; allowed: up to 5000"):
        robot_from_toml(text)


def test_a_beams_numbers_are_changed() -> None:
    """Its links and joints follow, those of others stay, as if the description had them so."""
    more = (
        '[[links]]\nname = "bob"\nmass = 1\n[[joints]]\nname = "first"\nparent = "base"\nchild = "bob"\ntype = "free"\n'
    )
    robot = robot_from_toml(toml({}, 2.0, more))
    changes: tuple[tuple[str, Any, dict[str, Any] | None], ...] = (
        ("beams.boom.length", 2.5, {"length": 2.5}),
        ("beams.boom.segments", 5, {"segments": 5}),
        ("beams.boom.Iy", 1e-6, {"Iy": 1e-6}),
        ("beams.boom.shear", [0.5, 0.4], {"shear": [0.5, 0.4]}),
        ("beams.boom.shear.y", 0.6, None),
        ("beams.boom.axis", "-z", {"axis": "-z"}),
        ("beams.boom.damping.gamma", 1e-4, {"damping": [0, 0, 0, 0, 0, 1e-4]}),
        ("beams.boom.rigid", ["x"], {"rigid": ["x"]}),
        ("beams.boom.placement.rpy", [0.1, 0.2, 0.3], {"placement": {"rpy": [0.1, 0.2, 0.3]}}),
        ("beams.boom.name", "jib", {"name": "jib"}),
    )
    for path, value, keys in changes:
        if keys is None:
            refused(DescriptionError, r"beams\.boom\.shear", robot.with_value, path, value)
            continue
        changed = robot.with_value(path, value)
        assert record_of(changed) == record_of(robot_from_toml(toml(keys, 2.0, more))), path
    assert robot.with_value("links.boom1.mass", 1.0).beams == robot.beams
    moved = robot.with_values({"joints.boom1.x.stiffness": 7.0, "beams.boom.E": 7e10})
    assert moved == robot.with_value("beams.boom.E", 7e10)
    assert moved.joint("boom2").coordinates["x"].stiffness == pytest.approx(7e10 * 2e-3 / 0.65)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("beams.boom.E", -1.0, r"beams\.boom\.E: got -1\.0; allowed: a number greater than 0"),
        ("beams.boom.segments", 0, r"beams\.boom\.segments: got 0; allowed: a whole number from 1 to 100"),
        ("beams.boom.segments", 2.5, "segments: got 2.5; allowed: a value of type int"),
        ("beams.boom.axis", "w", "beams.boom.axis: got 'w'; allowed: x, y, z, -x"),
        ("beams.boom.rigid", ["x", "x"], "each once, not all"),
        ("beams.boom.damping", [1.0], "six numbers that are at least 0"),
        ("beams.boom.child", "nobody", "there is no link 'nobody'"),
        ("beams.boom.chld", 1, "there is no 'chld' in beams.boom; did you mean 'child'"),
        ("beams.bom.E", 1, "there is no 'bom' in beams; did you mean 'boom'"),
        ("beams.boom.length", 1e-24, "its segments have the stiffness x"),
        ("beams.boom.name", "a" * 127, "at most 124 characters"),
        ("beams.boom.placement.rotation", [[1, 0, 0]] * 3, "no rotation"),
        ("links.arm.mass", 2.0, r"links\.arm\.mass: it follows from the link's beam"),
        ("links.arm.com.x", 0.1, r"links\.arm\.com: it follows from the link's beam"),
        ("links.arm.beam.E", -1.0, r"links\.arm\.beam\.E: got -1\.0; allowed"),
        ("links.arm.beam.modes.y", 99, r"links\.arm\.beam\.modes\.y: got 99; allowed: a whole number from 0 to 12"),
        ("links.arm.beam.width", 1.0, r"there is no 'width' in links\.arm\.beam"),
        ("links.arm.modes.9.stiffness", 1.0, r"there is no '9' in links\.arm\.modes"),
    ],
)
def test_numbers_that_no_beam_has_are_refused(path: str, value: object, said: str) -> None:
    refused(DescriptionError, said, (arm() if path.startswith("links") else cantilever()).with_value, path, value)


def test_fewer_segments_than_something_names() -> None:
    robot = robot_from_toml('tunable = ["links.boom2.mass"]\n' + toml({}, 1.0))
    refused(DescriptionError, r"tunable: 'links\.boom2\.mass'", robot.with_value, "beams.boom.segments", 1)


def test_links_and_joints_keep_their_names() -> None:
    """More segments than there are names for."""
    more = '[[links]]\nname = "boom3"\nmass = 1\n[[joints]]\nname = "boom4"\nparent = "base"\nchild = "boom3"\n'
    robot = robot_from_toml(toml({}, 1.0, more + 'type = "revolute"\n'))
    with pytest.raises(DescriptionError, match=r"with_value: .* have the names 'boom3', 'boom4'; allowed"):
        robot.with_value("beams.boom.segments", 4)
    assert robot.with_value("beams.boom.segments", 1).link("boom3").mass == 1.0


def test_records_of_robots_with_beams() -> None:
    """And robots without have none of them: their hashes stay."""
    robot = cantilever(segments=3, axis="-y", placement={"xyz": [1.0, 2.0, 3.0]}, damping=1e-4, rigid=["x"])
    assert robot_from_record(json.loads(json.dumps(record_of(robot))), "r") == robot
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert robot_hash(robot) != robot_hash(cantilever(segments=3))
    assert "beams" not in record_of(eomgen.load_robot("ur5"))
    record = json.loads(json.dumps(record_of(robot)))
    record["beams"][0]["E"] = -1.0
    refused(DescriptionError, r"beams\.boom\.E", robot_from_record, record, "r")


def test_a_link_of_a_beam_has_no_place_in_a_description(tmp_path: Path) -> None:
    robot = eomgen.load_robot(EXAMPLE)
    with pytest.raises(InputError, match=r"flexible_boom: boom1 is not written in .*flexible_boom\.toml"):
        write_toml(robot, {"boom1.mass": 1.0}, [], tmp_path / "identified.toml")
    assert not (tmp_path / "identified.toml").exists()


def test_info_says_what_a_beam_is() -> None:
    robot = cantilever(segments=3, rigid=["x"])
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    (line,) = [line for line in info.lines() if line.startswith("beam ")]
    assert line == (
        "beam boom from base to head, 1.3 m along x: links boom0 to boom3, 3 x 5 coordinates, 20.28 kg;"
        " EA 4.2e+08, GJ 40000, EIy 84000, EIz 63000 (N, N m^2), shear 0.8, 0.6"
    )
    (facts,) = json.loads(json.dumps(info.as_dict()))["beams"]
    assert facts["links"] == ["boom0", "boom1", "boom2", "boom3"]
    assert facts["joints"][-1] == "boom_tip"
    assert (facts["mass"], facts["rigid"]) == (pytest.approx(20.28), ["x"])
    assert "beams" not in RobotInfo(build_model(eomgen.load_robot("one_link")), {}, (), {}, {}).as_dict()


def test_a_beam_in_python() -> None:
    """Links and joints of a value, for robots that are made in Python."""
    E, G, density = STEEL.values()
    beam = Beam("boom", "base", "head", 1.3, 2, E, G, 2.0e-3, 4.0e-7, 3.0e-7, 5.0e-7, (0.8, 0.6), density)
    robot = cantilever()
    assert beam == robot.beams[0]
    assert beam.links() == robot.links[:-1]
    assert beam.joints() == robot.joints
    assert beam.placement == Placement()


def crane(axis: str = "x") -> Robot:
    return robot_from_toml(crane_text(axis))


def crane_text(axis: str = "x") -> str:
    return f"""
name = "crane"
{beam_table("bridge", 4.0, "{ tube = [0.1, 0.09] }", "{ y = 3, z = 2 }")}
axis = "{axis}"
nodes = {{ quarter = 1.0, middle = 2.0 }}
{link_table("trolley", 5.0)}
{joint_table("rail", "base", "bridge", "prismatic")}
{joint_table("cross", "bridge", "trolley", "prismatic")}
along = "beam"
z = {{ damping = 2.0 }}
{frame_table("mid", "bridge")}
node = "middle"
"""


def test_a_joint_along_a_beam_is_two() -> None:
    """It slides along the straight axis, and stands where the beam is deflected to; limits are the beam's ends."""
    robot = crane()
    slides, place = robot.joint("cross"), robot.joint("bridge_cross")
    assert (slides.parent, slides.child, slides.type) == ("bridge", "bridge_cross", "prismatic")
    assert (place.parent, place.child, place.type) == ("bridge_cross", "trolley", "fixed")
    assert slides.limits == (0.0, 4.0)
    assert slides.coordinates["z"].damping == 2.0
    assert list(place.coordinates) == ["x", "y", "z", "beta", "gamma"]
    assert robot.nodes == {"bridge_tip": "bridge", "bridge_quarter": "bridge", "bridge_middle": "bridge"} | {
        "bridge_cross": "bridge"
    }
    model = build_model(robot)
    assert model.coordinates == ("rail.z", *(f"bridge.mode{k}" for k in range(1, 6)), "cross.z")
    assert model.leaders["bridge_cross.y"] == ("bridge.mode1", "bridge.mode2", "bridge.mode3", "cross.z")
    assert robot.frames[0].link == "bridge_middle"


@pytest.mark.parametrize("axis", ["x", "-y", "z"])
def test_where_a_joint_along_a_beam_is_at_a_node_they_move_alike(axis: str) -> None:
    robot = crane(axis)
    values = {f"bridge.mode{k}": 0.01 * k for k in range(1, 6)} | {"cross.z": 1.0}
    found = {name: coupling.value(lambda name: values.get(name, 0.0)) for name, coupling in robot.followers.items()}
    for kind in robot.joint("bridge_cross").coordinates:
        assert found[f"bridge_cross.{kind}"] == pytest.approx(found[f"bridge_quarter.{kind}"], rel=1e-11, abs=1e-15)
    turned = np.array(robot.joint("cross").placement.rotation) @ np.array(
        robot.joint("bridge_cross").placement.rotation
    )
    assert turned.tolist() == np.eye(3).tolist()
    along = np.array(robot.joint("cross").placement.rotation)[:, 2]
    assert along.tolist() == (np.array(robot.joint("bridge_quarter").placement.xyz)).tolist()


def test_changes_and_records() -> None:
    """Shapes follow numbers of the beam; through JSON and pickle nothing changes."""
    robot = crane()
    longer = robot.with_value("links.bridge.beam.length", 5.0)
    assert longer == robot_from_toml(crane_text().replace("length = 4.0", "length = 5.0"))
    assert longer.joint("cross").limits == (0.0, 5.0)
    planar = robot.with_value("links.bridge.beam.modes.z", 0)
    assert list(planar.joint("bridge_cross").coordinates) == ["x", "y", "gamma"]
    assert planar.with_value("links.bridge.beam.modes.z", 2) == robot
    moved = robot.with_value("links.bridge.beam.nodes.middle", 2.5)
    assert moved.joint("bridge_middle").placement.xyz == (2.5, 0.0, 0.0)
    with pytest.raises(
        DescriptionError, match=r"beam\.nodes: its nodes would be 'tip', 'other'; allowed: .* 'quarter'"
    ):
        robot.with_value("links.bridge.beam.nodes", {"other": 1.0})
    with pytest.raises(DescriptionError, match=r"there is no 'quart' in links\.bridge\.beam\.nodes"):
        robot.with_value("links.bridge.beam.nodes.quart", 1.0)
    record = json.loads(json.dumps(record_of(robot)))
    assert robot_from_record(record, "") == robot
    assert pickle.loads(pickle.dumps(robot)) == robot


def test_rigid_robots_slide_along_straight_links() -> None:
    assert build_model(crane().rigid()).coordinates == ("rail.z", "cross.z")


BEAM = "length = 0.8, E = 7e10, G = 2.6e10, density = 2700, section = { tube = [0.03, 0.026] }"
MODES = "{ y = 2, z = 1, torsion = 1, axial = 1 }"
ARM = f"""
name = "crane"
[[links]]
name = "arm"
beam = {{ {BEAM}, modes = {MODES} }}
modal_damping = 0.01
{link_table("hand", 0.5)}
{joint_table("shoulder", "base", "arm", "revolute")}
{joint_table("wrist", "arm", "hand", "revolute")}
node = "tip"
{frame_table("eye", "arm")}
node = "tip"
placement = {{ xyz = [0.1, 0, 0] }}
{frame_table("foot", "arm")}
node = "root"
[[springs]]
name = "stay"
links = ["base", "arm"]
nodes = ["root", "tip"]
points = [[0, 1, 0], [0, 0, 0.01]]
stiffness = 100.0
"""
LINE = f"beam = {{ {BEAM}, modes = {MODES} }}"
OF_FILE = ARM.replace(f"{LINE}\nmodal_damping = 0.01", 'modes = "arm.npz"')
MODE_NAMES = tuple(f"arm.mode{k}" for k in range(1, 6))


def arm(text: str = ARM) -> Robot:
    return robot_from_toml(text)


def test_a_beam_is_a_link_that_bends() -> None:
    """Mass, com and inertia are those of a tube, modes those of ``beam_modes``; modes stand behind the joint."""
    robot = arm()
    link, area = robot.link("arm"), math.pi / 4 * (0.03**2 - 0.026**2)
    second, mass = math.pi / 64 * (0.03**4 - 0.026**4), 2700.0 * area * 0.8
    assert link.mass == pytest.approx(mass, rel=1e-13)
    assert link.com == pytest.approx((0.4, 0.0, 0.0), rel=1e-13)
    across = 2700.0 * second * 0.8 + mass * 0.8**2 / 12
    inertia = (2 * 2700.0 * second * 0.8, across, across, 0.0, 0.0, 0.0)
    assert link.inertia == pytest.approx(inertia, rel=1e-12)
    assert link.beam.modes == BeamModes(2, 1, 1, 1)
    assert link.modes == beam_modes(link.beam, 0.01)
    model = build_model(robot)
    assert model.coordinates == ("shoulder.gamma", *MODE_NAMES, "wrist.gamma")
    assert model.parameters["links.arm.modes.2.stiffness"] == link.modes.K[1][1]


def test_what_stands_on_a_node() -> None:
    """Joints, frames and springs at the tip; on the root they stand on the link itself."""
    robot = arm()
    assert [link.name for link in robot.links] == ["arm", "arm_tip", "hand"]
    assert robot.joint("wrist").parent == "arm_tip"
    assert [frame.link for frame in robot.frames] == ["arm_tip", "arm"]
    assert robot.springs[0].links == ("base", "arm_tip")
    assert robot.joint("arm_tip").placement.xyz == (0.8, 0.0, 0.0)
    assert set(robot.followers) == {f"arm_tip.{kind}" for kind in robot.joint("arm_tip").coordinates}
    more = f"""
[[bushings]]
name = "mount"
links = ["arm", "base"]
nodes = ["tip", "root"]
stiffness = [1, 1, 1, 0, 0, 0]
{loop_table("pin", "base", "arm", "spherical")}
nodes = ["root", "tip"]
"""
    closed = arm(ARM + more)
    assert closed.elements[0].links == ("arm_tip", "base")
    assert closed.loops[0].links == ("base", "arm_tip")


def test_the_mass_matrix_is_that_of_the_constants() -> None:
    """Straight and without a hand: modal masses, and coupling with the shoulder by the moment of the deflection."""
    robot = arm().with_value("links.hand.mass", 0.0)
    model, link = build_model(robot), robot.link("arm")
    M = mass_matrix(model, np.zeros(model.size))[:6, :6]
    assert M[1:, 1:] == pytest.approx(np.array(link.modes.masses), abs=1e-12)
    axial = [H0[0][1] - H0[1][0] for H0 in link.modes.H0]
    assert M[0, 1:] == pytest.approx(axial, abs=1e-12)
    assert M[0, 0] == pytest.approx(link.inertia[2] + link.mass * 0.16, rel=1e-12)


def test_a_hand_at_the_tip_lowers_the_frequencies() -> None:
    """As a body at the tip of the continuous beam does, joints locked: nodes carry what stands on them."""
    text = ARM.replace("y = 2, z = 1", "y = 5, z = 5").replace(
        "mass = 0.5", "mass = 0.5\ninertia = {xx=0, yy=4e-3, zz=4e-3}"
    )
    robot = arm(text)
    model, beam = build_model(robot), robot.link("arm").beam
    modes = robot.link("arm").modes
    M, K = mass_matrix(model, np.zeros(model.size)), np.array(modes.K)
    places = [model.coordinates.index(f"arm.mode{k}") for k in range(1, 11)]
    own = M[np.ix_(places, places)]
    plane = Plane(
        beam.E * beam.Iz, beam.shear[0] * beam.G * beam.A, beam.density * beam.A, beam.density * beam.Iz, beam.length
    )
    for at in (slice(0, 5), slice(5, 10)):
        found = np.sqrt(eigh(K[at, at], own[at, at], eigvals_only=True)[:3])
        exact = [plane.exact_frequency(x, 0.5, 4e-3) for x in found]
        assert found[0] == pytest.approx(exact[0], rel=1e-9)
        assert found == pytest.approx(exact, rel=1e-3)


def test_modes_out_of_files(tmp_path: Path) -> None:
    """Constants as those of the beam itself, and modes of nodes; masses given beside them have to be the same."""
    link = arm().link("arm")
    assert link.beam is not None
    assert link.modes is not None
    write_constants(tmp_path / "arm.npz", BendingBody(beam_inertia(link.beam), link.modes, is_free=False))
    text = OF_FILE
    robot = eomgen.load_robot(text_file(tmp_path / "crane.toml", text))
    assert robot.link("arm") == replace(link, beam=None, modal_damping=None)
    assert [x.name for x in robot.couplings] == [x.name for x in arm().couplings]
    twice = text.replace('"arm.npz"', '"arm.npz"\nmodal_damping = 0.02')
    with pytest.raises(DescriptionError, match=r"links\.arm\.modal_damping: the file has D; allowed: one of them"):
        robot_from_toml(twice, folder=tmp_path)
    with pytest.raises(DescriptionError, match=r"links\.arm\.mass: got 2, and that of its modes is 0\.380007"):
        robot_from_toml(text.replace('"arm.npz"', '"arm.npz"\nmass = 2'), folder=tmp_path)
    same = text.replace('"arm.npz"', f'"arm.npz"\nmass = {link.mass:.9g}\ncom = [0.4, 0, 0]')
    assert robot_from_toml(same, folder=tmp_path).links == robot.links
    saved(nodal(), tmp_path)
    damped = robot_from_toml(text.replace('"arm.npz"', '"arm.npz"\nmodal_damping = 0.02'), folder=tmp_path).link("arm")
    assert [node.name for node in damped.modes.nodes] == ["tip", "middle"]
    (note,) = robot_from_toml(text, folder=tmp_path).notes
    below = 0.1 * math.sqrt(np.array(damped.modes.K)[0, 0])
    assert note.startswith("links.arm.modes: stiffening by rotation is left out, as there is no Q")
    assert f"below {below:.3g} rad/s" in note
    wanted = 0.04 * np.sqrt(np.diag(np.array(damped.modes.K)))  # masses are 1
    assert np.diag(np.array(damped.modes.D)) == pytest.approx(wanted, rel=1e-9)
    (tmp_path / "arm.npz").write_bytes(b"PK")
    with pytest.raises(DescriptionError, match=r"crane\.toml:\d+:\d+: links\.arm\.modes: .*arm\.npz: is no \.npz"):
        eomgen.load_robot(tmp_path / "crane.toml")


def test_a_table_says_how_a_file_is_taken(tmp_path: Path) -> None:
    """Finite elements, with other modes than the file asks for, and placed in the link's frame."""
    elements = bar(counts=(2, 1, 1), count=2)
    np.savez(tmp_path / "arm.npz", **arrays_of(elements))  # type: ignore[arg-type]
    modes = '{ file = "arm.npz", count = 1, placement = { xyz = [0, 0.1, 0], rpy_deg = [0, 0, 90] } }'
    text = ARM.replace(LINE, f"modes = {modes}")
    robot = robot_from_toml(text, folder=tmp_path)
    link, own = robot.link("arm"), reduce(replace(elements, count=1))
    assert link.modes.count == 7
    assert link.com == pytest.approx((0.0, 0.1 + own.com[0], 0.0), abs=1e-12)
    assert link.modes.nodes[0].place == pytest.approx((0.0, 1.1, 0.0), abs=1e-12)
    assert own.notes() == [note.partition(": ")[2] for note in robot.notes]
    for wrong, message in (
        ("{ count = 1 }", r"links\.arm\.modes: the key 'file' is missing; allowed: the path of a \.npz file"),
        ('{ file = "arm.txt" }', r"links\.arm\.modes\.file: got 'arm\.txt'; allowed: the path of a \.npz file"),
        ('{ file = "arm.npz", count = 201 }', r"links\.arm\.modes\.count: got 201; allowed: .* from 0 to 200"),
        ('{ file = "arm.npz", count = 195 }', r"arm\.npz: got 195 modes|arm\.npz: count: got 195; allowed: 0 to 194"),
        ('{ file = "arm.npz", units = "inch" }', r"links\.arm\.modes\.units: got 'inch'; allowed: 'm', 'mm'|m, mm"),
        ('{ file = "arm.npz", scale = 2 }', r"links\.arm\.modes: .*'scale'"),
    ):
        refused(DescriptionError, message, robot_from_toml, text.replace(modes, wrong), folder=tmp_path)


@pytest.mark.parametrize("craig_bampton", [False, True])
def test_reduced_finite_elements_are_taken(craig_bampton: bool, tmp_path: Path) -> None:
    """What ``eomgen reduce`` writes: modes by themselves, or those of the interface that work on each other."""
    reduced = reduce(bar(count=2), craig_bampton=craig_bampton)
    reduced.save(tmp_path / "arm.npz")
    text = ARM.replace(LINE, 'modes = "arm.npz"')
    robot = robot_from_toml(text, folder=tmp_path).with_value("links.hand.mass", 0.0)
    link = robot.link("arm")
    assert link.mass == pytest.approx(reduced.mass, rel=1e-12)
    assert np.array(link.modes.K) == pytest.approx(reduced.K, rel=1e-12)
    assert (np.count_nonzero(np.array(link.modes.D)) == len(reduced.K)) != craig_bampton
    assert [note.partition(":")[0] for note in robot.notes] == ["links.arm.modes"]
    assert bool(link.modes.couplings("K")) == bool(link.modes.couplings("D")) == craig_bampton
    assert link.modes.line("arm").endswith("; coupled by K and D" if craig_bampton else "rotation")
    model = build_model(robot)
    M = mass_matrix(model, np.zeros(model.size))[1:9, 1:9]
    assert pytest.approx(np.einsum("klaa->kl", reduced.P), abs=1e-9) == M


def test_modes_of_craig_and_bampton_move_as_their_combinations(tmp_path: Path) -> None:
    """Forces of one motion, and its energies, in both sets of modal coordinates: e_cb = T e, r = T^T r_cb."""
    text, robots = ARM.replace(LINE, 'modes = "arm.npz"'), []
    for craig_bampton in (False, True):
        reduce(bar(count=2), craig_bampton=craig_bampton).save(tmp_path / "arm.npz")
        robots.append(robot_from_toml(text, folder=tmp_path))
    models, links = [build_model(x) for x in robots], [x.link("arm").modes for x in robots]
    alone, coupled = (x for x in links if x is not None)
    T = eigh(np.array(coupled.K), np.array(coupled.masses))[1]
    signs = np.sign(np.sum((np.array(coupled.nodes[0].Phi) @ T) * np.array(alone.nodes[0].Phi), axis=0))
    T = T * signs
    assert np.array(coupled.nodes[0].Phi) @ T == pytest.approx(np.array(alone.nodes[0].Phi), abs=1e-7)
    n, m = models[0].size, alone.count
    whole = np.eye(n)
    whole[1 : 1 + m, 1 : 1 + m] = T
    rng = np.random.default_rng(3)
    q, v, a = rng.uniform(-1.0, 1.0, (3, n)) * np.where([".mode" in x for x in models[0].coordinates], 0.05, 1.0)
    forces, energies = [], []
    for model, turn in zip(models, (np.eye(n), whole), strict=True):
        state = {"q": [*turn @ q], "v": [*turn @ v], "a": [*turn @ a], "p": list(model.parameters.values())}
        found = evaluate(derive(model, "inverse_dynamics"), state)
        forces.append(turn.T @ np.array([found["out", i] for i in range(n)]))
        energies.append([float(x) for x in evaluate(derive(model, "energy"), state).values()])
    assert forces[1] == pytest.approx(forces[0], abs=1e-7 * np.abs(forces[0]).max())
    assert energies[1] == pytest.approx(energies[0], rel=1e-8)


def test_modes_of_a_free_link_need_a_free_joint(tmp_path: Path) -> None:
    saved(nodal(free=True), tmp_path)
    text = OF_FILE
    with pytest.raises(DescriptionError, match=r"links\.arm\.modes: .* free link, and joint 'shoulder' is revolute"):
        robot_from_toml(text, folder=tmp_path)
    robot = robot_from_toml(text.replace('"revolute"', '"free"', 1), folder=tmp_path)
    assert build_model(robot).coordinates[6:9] == MODE_NAMES[:3]


def test_numbers_of_a_beam_make_its_modes_anew() -> None:
    robot = arm()
    old = robot.link("arm").modes
    stiff = robot.with_values({"links.arm.beam.E": 1.4e11, "links.arm.beam.G": 5.2e10}).link("arm").modes
    assert np.array(stiff.K) == pytest.approx(2.0 * np.array(old.K), rel=1e-10)
    assert np.array(stiff.D) == pytest.approx(math.sqrt(2.0) * np.array(old.D), rel=1e-10)
    heavy = robot.with_value("links.arm.beam.density", 5400.0).link("arm")
    assert heavy.mass == pytest.approx(2.0 * robot.link("arm").mass)
    longer = robot.with_value("links.arm.beam.length", 1.6)
    assert longer.joint("arm_tip").placement.xyz == (1.6, 0.0, 0.0)
    assert longer.link("arm").com == (0.8, 0.0, 0.0)
    planar = robot.with_values({"links.arm.beam.modes.z": 0, "links.arm.beam.modes.torsion": 0})
    assert build_model(planar).coordinates == ("shoulder.gamma", *MODE_NAMES[:3], "wrist.gamma")
    assert list(planar.joint("arm_tip").coordinates) == ["x", "y", "gamma"]
    assert {x.name for x in planar.couplings} == {f"arm_tip_{kind}" for kind in ("x", "y", "gamma")}
    assert [x.name for x in planar.joints] == [x.name for x in robot.joints]
    again = planar.with_values({"links.arm.beam.modes.z": 1, "links.arm.beam.modes.torsion": 1})
    assert again == robot


def test_numbers_of_modes() -> None:
    """Stiffness and damping of one, the damping of all; the rest stays."""
    robot = arm()
    changed = (
        robot.with_values({"links.arm.modes.2.stiffness": 7.0, "links.arm.modes.1.damping": 0.5}).link("arm").modes
    )
    old = robot.link("arm").modes
    assert (changed.K[1][1], changed.D[0][0], changed.D[1][1]) == (7.0, 0.5, old.D[1][1])
    damped = robot.with_value("links.arm.modal_damping", 0.03).link("arm").modes
    assert np.array(damped.D) == pytest.approx(3.0 * np.array(old.D), rel=1e-12)
    assert damped.K == old.K


def test_records_and_copies() -> None:
    """Through JSON and pickle, and with a hash of its own; records of rigid links have nothing of modes."""
    robot = arm()
    record = json.loads(json.dumps(record_of(robot)))
    assert robot_from_record(record, "") == robot
    assert robot_hash(robot_from_record(record, "")) == robot_hash(robot)
    assert robot_hash(robot.with_value("links.arm.beam.E", 7.1e10)) != robot_hash(robot)
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert set(record["links"][2]) == {"name", "mass", "com", "inertia"}
    record["links"][0]["modes"]["K"] = [[1.0]]
    with pytest.raises(DescriptionError, match=r"links\.arm\.modes\.H0: allowed: an array of 1 x 4 x 3 numbers"):
        robot_from_record(record, "")


def test_a_text_with_other_numbers_leads_to_the_same_files(tmp_path: Path) -> None:
    """What identification writes into another folder."""
    saved(nodal(), tmp_path)
    text = OF_FILE
    robot = eomgen.load_robot(text_file(tmp_path / "crane.toml", text))
    heavy = robot.with_value("links.hand.mass", 0.7)
    (tmp_path / "new").mkdir()
    written = write_toml(heavy, {"hand.mass": 0.7}, (), tmp_path / "new" / "crane.toml")
    again = eomgen.load_robot(written)
    assert again.links == heavy.links
    assert again.joints == robot.joints


def test_a_beam_refines_a_link_of_a_urdf(tmp_path: Path) -> None:
    """The link's mass and inertia are those of the beam, without a note on the URDF's."""
    (tmp_path / "arm.urdf").write_text(URDF, encoding="ascii")
    more = f'[[links]]\nname = "lower"\nbeam = {{ {BEAM}, modes = {{ y = 1 }} }}\n'
    robot = eomgen.load_robot(text_file(tmp_path / "arm.toml", f'urdf = "arm.urdf"\n{more}'))
    assert robot.link("lower").mass == pytest.approx(arm().link("arm").mass)
    assert "lower.mode1" in build_model(robot).coordinates


def test_robots_say_what_bends() -> None:
    info = RobotInfo(build_model(arm()), {}, (), {}, {})
    (line,) = (line for line in info.lines() if "bends" in line)
    assert line.startswith("link arm bends: 5 modes of ")
    assert line.endswith("Hz, each by itself; nodes tip")
    assert info.as_dict()["bending"]["arm"]["nodes"] == ["tip"]
    assert arm().rigid().link("arm").modes is None
