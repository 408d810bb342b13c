"""Links that bend in descriptions: what is read, what stands on their nodes, and how their numbers are changed."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import eomgen
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
from eomgen.errors import DescriptionError
from eomgen.identification.dynamics.as_toml import write_toml
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash
from eomgen.robot.value import BeamModes, Robot
from tests.bending.test_files import nodal, saved
from tests.support.beam_elements import Plane
from tests.support.description_samples import URDF
from tests.support.finite_elements import bar

pytestmark = pytest.mark.quick

BEAM = "length = 0.8, E = 7e10, G = 2.6e10, density = 2700, section = { tube = [0.03, 0.026] }"
MODES = "{ y = 2, z = 1, torsion = 1, axial = 1 }"
ARM = f"""
name = "crane"
[[links]]
name = "arm"
beam = {{ {BEAM}, modes = {MODES} }}
modal_damping = 0.01
[[links]]
name = "hand"
mass = 0.5
[[joints]]
name = "shoulder"
parent = "base"
child = "arm"
type = "revolute"
[[joints]]
name = "wrist"
parent = "arm"
node = "tip"
child = "hand"
type = "revolute"
[[frames]]
name = "eye"
link = "arm"
node = "tip"
placement = {{ xyz = [0.1, 0, 0] }}
[[frames]]
name = "foot"
link = "arm"
node = "root"
[[springs]]
name = "stay"
links = ["base", "arm"]
nodes = ["root", "tip"]
points = [[0, 1, 0], [0, 0, 0.01]]
stiffness = 100.0
"""
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
    assert link.beam is not None
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
    more = """
[[bushings]]
name = "mount"
links = ["arm", "base"]
nodes = ["tip", "root"]
stiffness = [1, 1, 1, 0, 0, 0]
[[loops]]
name = "pin"
links = ["base", "arm"]
nodes = ["root", "tip"]
type = "spherical"
"""
    closed = arm(ARM + more)
    assert closed.elements[0].links == ("arm_tip", "base")
    assert closed.loops[0].links == ("base", "arm_tip")


def test_the_mass_matrix_is_that_of_the_constants() -> None:
    """Straight and without a hand: modal masses, and coupling with the shoulder by the moment of the deflection."""
    robot = arm().with_value("links.hand.mass", 0.0)
    model, link = build_model(robot), robot.link("arm")
    assert link.modes is not None
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
    assert beam is not None
    assert modes is not None
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
    text = ARM.replace(f"beam = {{ {BEAM}, modes = {MODES} }}\nmodal_damping = 0.01", 'modes = "arm.npz"')
    (tmp_path / "crane.toml").write_text(text, encoding="ascii")
    robot = eomgen.load_robot(tmp_path / "crane.toml")
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
    assert damped.modes is not None
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
    text = ARM.replace(f"beam = {{ {BEAM}, modes = {MODES} }}", f"modes = {modes}")
    robot = robot_from_toml(text, folder=tmp_path)
    link, own = robot.link("arm"), reduce(replace(elements, count=1))
    assert link.modes is not None
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
        with pytest.raises(DescriptionError, match=message):
            robot_from_toml(text.replace(modes, wrong), folder=tmp_path)


@pytest.mark.parametrize("craig_bampton", [False, True])
def test_reduced_finite_elements_are_taken(craig_bampton: bool, tmp_path: Path) -> None:
    """What ``eomgen reduce`` writes: modes by themselves, or those of the interface that work on each other."""
    reduced = reduce(bar(count=2), craig_bampton=craig_bampton)
    reduced.save(tmp_path / "arm.npz")
    text = ARM.replace(f"beam = {{ {BEAM}, modes = {MODES} }}", 'modes = "arm.npz"')
    robot = robot_from_toml(text, folder=tmp_path).with_value("links.hand.mass", 0.0)
    link = robot.link("arm")
    assert link.modes is not None
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
    text, robots = ARM.replace(f"beam = {{ {BEAM}, modes = {MODES} }}", 'modes = "arm.npz"'), []
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
    text = ARM.replace(f"beam = {{ {BEAM}, modes = {MODES} }}\nmodal_damping = 0.01", 'modes = "arm.npz"')
    with pytest.raises(DescriptionError, match=r"links\.arm\.modes: .* free link, and joint 'shoulder' is revolute"):
        robot_from_toml(text, folder=tmp_path)
    robot = robot_from_toml(text.replace('"revolute"', '"free"', 1), folder=tmp_path)
    assert build_model(robot).coordinates[6:9] == MODE_NAMES[:3]


def test_numbers_of_a_beam_make_its_modes_anew() -> None:
    robot = arm()
    old = robot.link("arm").modes
    assert old is not None
    stiff = robot.with_values({"links.arm.beam.E": 1.4e11, "links.arm.beam.G": 5.2e10}).link("arm").modes
    assert stiff is not None
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
    assert changed is not None
    assert old is not None
    assert (changed.K[1][1], changed.D[0][0], changed.D[1][1]) == (7.0, 0.5, old.D[1][1])
    damped = robot.with_value("links.arm.modal_damping", 0.03).link("arm").modes
    assert damped is not None
    assert np.array(damped.D) == pytest.approx(3.0 * np.array(old.D), rel=1e-12)
    assert damped.K == old.K


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("links.arm.mass", 2.0, "links.arm.mass: it follows from the link's beam"),
        ("links.arm.com.x", 0.1, "links.arm.com: it follows from the link's beam"),
        ("links.arm.beam.E", -1.0, "links.arm.beam.E: got -1.0; allowed"),
        ("links.arm.beam.modes.y", 99, "links.arm.beam.modes.y: got 99; allowed: a whole number from 0 to 12"),
        ("links.arm.beam.width", 1.0, "there is no 'width' in links.arm.beam"),
        ("links.arm.modes.9.stiffness", 1.0, "there is no '9' in links.arm.modes"),
    ],
)
def test_bad_changes(path: str, value: float, said: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        arm().with_value(path, value)
    assert said in str(caught.value)


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
    text = ARM.replace(f"beam = {{ {BEAM}, modes = {MODES} }}\nmodal_damping = 0.01", 'modes = "arm.npz"')
    (tmp_path / "crane.toml").write_text(text, encoding="ascii")
    robot = eomgen.load_robot(tmp_path / "crane.toml")
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
    (tmp_path / "arm.toml").write_text(f'urdf = "arm.urdf"\n{more}', encoding="ascii")
    robot = eomgen.load_robot(tmp_path / "arm.toml")
    assert robot.link("lower").mass == pytest.approx(arm().link("arm").mass)
    assert "lower.mode1" in build_model(robot).coordinates


def test_robots_say_what_bends() -> None:
    info = RobotInfo(build_model(arm()), {}, (), {}, {})
    (line,) = (line for line in info.lines() if "bends" in line)
    assert line.startswith("link arm bends: 5 modes of ")
    assert line.endswith("Hz, each by itself; nodes tip")
    assert info.as_dict()["bending"]["arm"]["nodes"] == ["tip"]
    assert arm().rigid().link("arm").modes is None
