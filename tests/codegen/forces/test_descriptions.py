"""Descriptions of forces: what is read, recorded and named, what rigid robots keep, and what is refused."""

from __future__ import annotations

import json
import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.authoring.check import check_file
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.codegen.closed_form.trace import closed_form, refuse_springs
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import UNITS, make_layout, parameter_unit, step_variable
from eomgen.export.mujoco import left_out
from eomgen.pipeline.costs import RobotInfo, robot_info
from eomgen.robot import Bushing, JointDamping, JointStiffness, Placement
from eomgen.robot.elements.journal import Radial
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import least_of, number_of
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import LINEAR, Coordinate, Friction, Motor, Robot
from tests.codegen.forces.test_bushings import DAMPING, MOUNT, NUMBERS, PLACEMENTS, STIFFNESS, robot_of_text
from tests.codegen.forces.test_joint_damping import TUMBLER, ball
from tests.codegen.forces.test_journals import SWING
from tests.codegen.forces.test_laws import GIVEN, slider
from tests.codegen.forces.test_loads import LOADED, cut_pin, pin
from tests.codegen.forces.test_stops import STOPS, geared, stopped
from tests.support.every_element import tree
from tests.support.joint_table import joint_table, link_table
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

BLOCK = f"""
name = "slider"
gravity = [0.0, 0.0, 0.0]
{link_table("block", 2.0, inertia=(1.0, 1.0, 1.0))}
{joint_table("rail", "base", "block", "prismatic")}
z = {{ stiffness = 40.0, exponential = {{ force = 3.0, scale = 0.05 }} }}
"""
LAW, TABLE = "stiffness = 40.0, exponential = { force = 3.0, scale = 0.05 }", "{ force = 3.0, scale = 0.05 }"
WHEEL = f"""
name = "wheel"
{link_table("wheel", 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))}
{joint_table("pin", "base", "wheel", "revolute")}
x = {{ stiffness = 1e6 }}
gamma = {{ friction = {{ coefficient = 0.08, radius = 0.02 }} }}
"""
MATRIX_MOUNT = """[[bushings]]
name = "mount"
links = ["base", "fore"]
stiffness = { matrix = [[9.0, 0.0, 0.0, 0.0, 2.0, 0.0], [0.0, 8.0, 0.0, 0.0, 0.0, 0.0], \
[0.0, 0.0, 7.0, 0.0, 0.0, 0.0], \
[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]], \
at = { xyz = [0.0, 0.0, 0.1] } }
damping = { ratio = 0.1, at_hz = 5.0 }
"""
CLAMP = """[[loops]]
name = "clamp"
links = ["base", "fore"]
type = "revolute"
x = {}
y = {}
beta = {}
stiffness = { matrix = [[9.0, 0.0, 2.0], [0.0, 8.0, 0.0], [2.0, 0.0, 1.0]] }
damping = { loss_factor = 0.1, at_hz = 5.0 }
"""
ROWS = "[[9.0, 0.0, 2.0], [0.0, 8.0, 0.0], [2.0, 0.0, 1.0]]"


TEXTS = {
    "bushing": tree(beside=MOUNT + PLACEMENTS + NUMBERS),
    "exponential": BLOCK,
    "loaded friction": WHEEL,
    "loop's journal": SWING,
    "joint damping": TUMBLER,
    "bushing's matrix": tree(beside=MATRIX_MOUNT),
    "loop's matrix": tree(beside=CLAMP),
}
REFUSED: dict[
    str, list[tuple[str, str, str | tuple[str, ...]]]
] = {  # what is replaced by what, and patterns of the error
    "bushing": [
        ('["base", "fore"]', '["fore", "fore"]', r"mount\.links: .*two different links"),
        ('["base", "fore"]', '["base", "elbow"]', r"there is no link 'elbow'"),
        (str(STIFFNESS), "[1.0, 2.0]", r"mount\.stiffness: .*allowed: six numbers, for x, y, z, alpha, beta, gamma"),
        (str(STIFFNESS), str([[1.0] * 6] * 6), r"mount\.stiffness: .*six numbers, .*or a table \{ matrix"),
        (str(STIFFNESS), "{ matrix = [[1.0]] }", r"mount\.stiffness\.matrix: got 1 row; allowed: six, for x, y, z"),
        (str(DAMPING), "[1, 1, 1, 1, -2, 1]", r"mount\.damping\.4: got -2; allowed: a number that is at least 0"),
        (NUMBERS, "", r"mount: it has no force; allowed: with a stiffness or damping above 0"),
        (NUMBERS, "damping = [0, 0, 0, 0, 0, 0]\n", r"mount: it has no force"),
        ("[[bushings]]", f'[[bushings]]\nname = "mount"\nlinks = ["base", "upper"]\n{NUMBERS}[[bushings]]', "unique"),
        (
            "[[bushings]]",
            '[[springs]]\nname = "mount"\nlinks = ["base", "fore"]\nstiffness = 1.0\n[[bushings]]',
            r"the name 'mount' is taken by an earlier entry of \[\[springs\]\]; allowed: unique names",
        ),
        ("stiffness =", "stifness =", r"stifness.* did you mean 'stiffness'"),
    ],
    "exponential": [
        (TABLE, "{ force = 3.0 }", r"rail\.z\.exponential: the key 'scale' is missing; allowed: .* m or rad"),
        (TABLE, "{ scale = 3.0 }", r"rail\.z\.exponential: the key 'force' is missing; allowed: a force"),
        (TABLE, "{ force = -1, scale = 1 }", r"exponential\.force: got -1; allowed: .* at least 0"),
        (TABLE, "{ force = 1, scale = 0 }", r"exponential\.scale: got 0; allowed: .* at least 1e-12"),
        (TABLE, "{ force = 1, scale = -1 }", r"exponential\.scale: got -1; allowed"),
        (TABLE, "{ force = 1, scale = 1, s = 1 }", r"exponential: unknown key 's'"),
        (TABLE, "3", r"rail\.z\.exponential: got 3; allowed: a table with the keys 'force', 'scale'"),
        (
            "exponential =",
            "clearance = 0.1, exponential =",
            r"z\.exponential: clearance is set, too; allowed: an exponen",
        ),
        (
            "stiffness = 40.0",
            "curve = [[0, 0], [1, 1]]",
            r"z\.exponential: curve is set, too; allowed: .* without curve, which stands in the place of springs",
        ),
        ("stiffness = 40.0", 'role = "locked"', r"is locked, so that its exponential would do nothing"),
    ],
    "loaded friction": [
        ("x = { stiffness = 1e6 }", "", r"gamma\.friction\.coefficient: there is no load.* with x or y active"),
        ("{ stiffness = 1e6 }", "{ friction = { coulomb = 1.0 } }", r"gamma\.friction\.coefficient: there is no load"),
        ("x = {", "z = {", r"gamma\.friction\.coefficient: there is no load.* with x or y active"),
        (", radius = 0.02", "", r"gamma\.friction\.coefficient: there is no radius"),
        ("coefficient = 0.08, ", "coulomb = 1.0, ", r"gamma\.friction\.radius: there is no coefficient"),
        ("coefficient = 0.08, ", "", r"gamma\.friction: the key 'coulomb' is missing; allowed: .*coefficient"),
        ("0.08", "-0.08", r"gamma\.friction\.coefficient: .*-0\.08"),
        (
            "x = { stiffness = 1e6 }",
            "y = { stiffness = 1e6 }\nx = { stiffness = 1e6, friction = { coefficient = 0.1, radius = 1.0 } }",
            r"x\.friction\.radius: x does not turn",
        ),
        (
            "x = { stiffness = 1e6 }",
            "motor = { inertia = 1, ratio = 2, stiffness = 1, friction = { coefficient = 0.1 } }\nx = { damping = 1 }",
            r"motor\.friction\.coefficient: no joint load acts",
        ),
    ],
    "loop's journal": [
        ("\nx = {}", "", (r"loops\.pin\.radial", "x does not move", "x, y have tables")),
        ("y = {}", "y = { stiffness = 1e3, clearance = 1e-3 }", (r"loops\.pin\.radial", "y has a clearance, too")),
        ("stiffness = 1e6", "stiffness = 0.0", (r"loops\.pin\.radial\.stiffness", r"0\.0", "greater than 0")),
        ("1e6,", "1e6, length = 0.1,", ("alpha does not move", "x, y, alpha, beta have tables")),
        (
            "= 0.5 }\n",
            "= 0.5, friction = { coefficient = 0.1, radius = 0.01 } }\n",
            ("gamma does not move", "loop joint: with a table"),
        ),
    ],
    "joint damping": [
        ("linear = 2.0", "linear = -2.0", (r"joints\.root\.damping\.linear", r"-2\.0", "at least 0")),
        ("{ linear = 2.0, angular = 0.1 }", "{}", (r"joints\.root\.damping", "no number", "linear, angular")),
        ("{ linear = 2.0, angular = 0.1 }", "0.1", (r"joints\.root\.damping", r"0\.1", "table")),
        ("angular", "angulr", (r"joints\.root\.damping", "'angulr'", "did you mean 'angular'")),
        ('"free"', '"revolute"', (r"joints\.root\.damping\.linear", "nothing moves so", "x, y, z")),
    ],
    "bushing's matrix": [
        (
            "[[9.0, 0.0, 0.0, 0.0, 2.0, 0.0], [0.0, 8.0, 0.0, 0.0, 0.0, 0.0], ",
            "[",
            r"bushings\.mount\.stiffness\.matrix",
        ),
        ("2.0", "4.0", (r"bushings\.mount\.stiffness\.matrix", r"x\.beta", "up to 3", r"units\?")),
        ("ratio = 0.1, at_hz = 5.0", "linear = 1.0", (r"bushings\.mount\.damping", "'linear'", "ratio")),
        ("stiffness = {", "#", (r"bushings\.mount\.damping", "stiffness")),
        ("{ ratio = 0.1, at_hz = 5.0 }", "[[1.0], [2.0]]", (r"bushings\.mount\.damping", "six numbers", "matrix = ")),
    ],
    "loop's matrix": [
        (
            ROWS,
            str(np.diag([9.0, 8.0, 1.0, 1.0, 1.0, 1.0]).tolist()),
            (r"loops\.clamp\.stiffness\.matrix", "gamma is free and has no table", "gamma = {}"),
        ),
        ("loss_factor = 0.1, at_hz = 5.0", "angular = 1.0", (r"loops\.clamp\.damping", "'angular'", "ratio")),
        ("beta = {}\n", "", (r"loops\.clamp\.stiffness\.matrix", "3 rows", "2, for x, y, or six")),
        ("stiffness = {", "#", (r"loops\.clamp\.damping", "stiffness")),
    ],
}


@pytest.mark.parametrize(("name", "case"), [(name, i) for name, cases in REFUSED.items() for i in range(len(cases))])
def test_what_is_wrong_is_refused(name: str, case: int, tmp_path: Path) -> None:
    """By readers, and by ``eomgen check`` with the place."""
    (old, new, said), text = REFUSED[name][case], TEXTS[name]
    changed = text.replace(old, new)
    assert changed != text
    path = tmp_path / "my.toml"
    path.write_text(changed, encoding="utf-8")
    caught = refused(DescriptionError, "", robot_from_toml, changed, source="my.toml")
    for pattern in (said,) if isinstance(said, str) else said:
        assert re.search(pattern, str(caught)), caught
    found = check_file(path)
    assert found.errors
    assert all(f"{path}:" in line for line in found.lines)


@pytest.mark.parametrize("name", TEXTS)
def test_records_pickles_hashes_and_units(name: str) -> None:
    robot = robot_from_toml(TEXTS[name])
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    for key, value in robot.numbers():
        if value and key.startswith(("bushings.", "loops.", "joints.")):
            assert robot_hash(robot.with_value(key, 0.99 * value)) != robot_hash(robot), key
    assert all(parameter_unit(robot, key) in UNITS for key in build_model(robot).parameters)


MADE: dict[str, tuple[Callable[[], Robot], str]] = {  # robots made in Python, and what is said of them
    "few numbers": (lambda: mounted(stiffness=(1.0,) * 5), "stiffness: got 5 numbers"),
    "nan": (lambda: mounted(stiffness=(1.0, np.nan, 0, 0, 0, 0)), "stiffness: y: got nan"),
    "one link": (lambda: mounted(links=("base", "base")), "do not move against each other"),
    "no link": (lambda: mounted(links=("base", "other")), "'other'"),
    "a name": (lambda: mounted(name="m.ount"), "'m.ount'"),
    "no force": (lambda: mounted(stiffness=(0.0,) * 6), "it has no force"),
    "indefinite": (lambda: mounted(stiffness=JointStiffness({"x.x": 1.0, "x.y": 1.0})), "root of the product"),
    "isotropic mount": (lambda: mounted(damping=JointDamping(1.0)), "isotropic"),
    "a ratio of nothing": (
        lambda: mounted(stiffness=None, damping=JointDamping(ratio=0.1, at_hz=1.0)),
        "no table stiffness",
    ),
    "isotropic loop": (lambda: looped("loop's matrix", damping=JointDamping(1.0)), "isotropic"),
    "no scale": (
        lambda: slider(further={"exponential.force": 1.0}),
        r"z\.exponential\.scale: it is missing; allowed: a deviation in m or rad",
    ),
    "no exponential": (
        lambda: slider(further={"exponential.scale": 1.0}),
        r"z\.exponential\.scale: there is no exponential\.force",
    ),
    "no stiffness": (lambda: slider(clearance=0.1), r"joints\.rail\.z\.clearance: there is no stiffness"),
    "no load": (
        lambda: pin(x=Coordinate(), y=Coordinate()),
        r"joints\.pin\.gamma\.friction\.coefficient: there is no load",
    ),
    "a loaded motor": (
        lambda: on_shaft(pin(), Motor(0.1, 10.0, Coordinate(1e3), Friction(coefficient=0.1))),
        r"joints\.pin\.motor\.friction\.coefficient: no joint load acts",
    ),
    "no end": (
        lambda: stopped(lower=None, upper=None),
        r"rail\.z\.stops: there is no lower and no upper; allowed: with one of them",
    ),
    "ends that cross": (lambda: stopped(lower=0.3), r"rail\.z\.stops\.lower: got 0\.3; allowed: at most upper, 0\.2"),
    "soft stops": (lambda: stopped(stiffness=None), r"there is no stops\.stiffness"),
    "stops of a shaft": (
        lambda: on_shaft(geared(name="refused"), Motor(0.02, 10.0, Coordinate(300.0, further=STOPS))),
        r"j\.motor: friction, stops, drive, limits and role belong",
    ),
    "a rotor's spring": (
        lambda: on_shaft(
            geared(name="refused"), Motor(0.02, 10.0, Coordinate(3.0), further={"exponential.force": 1.0})
        ),
        r"j\.motor\.further: exponential is no law of a rotor; allowed: fr",
    ),
    "no deviation": (lambda: looped("loop's journal", coordinates={}), r"loops\.pin\.radial: x does not move"),
    "nan of a damper": (
        lambda: ball(JointDamping(angular=np.nan)),
        r"joints\.ball\.damping\.angular: got nan",
    ),
}


def mounted(
    name: str = "mount",
    links: tuple[str, str] = ("base", "fore"),
    stiffness: object = (1.0,) * 6,
    damping: object = None,
) -> Robot:
    mount = Bushing(name, links, stiffness=stiffness, damping=damping)  # type: ignore[arg-type]
    return replace(robot_from_toml(tree(beside="")), elements=(mount,))


def looped(text: str, **changes: object) -> Robot:
    robot = robot_from_toml(TEXTS[text])
    return replace(robot, loops=(replace(robot.loops[0], **changes),))


def on_shaft(robot: Robot, motor: Motor) -> Robot:
    return replace(robot, joints=(replace(robot.joints[0], motor=motor),))


@pytest.mark.parametrize("case", MADE)
def test_what_python_makes_is_refused_too(case: str) -> None:
    make, said = MADE[case]
    refused(DescriptionError, said, build_model, make())


def info_of(robot: Robot) -> RobotInfo:
    return RobotInfo(build_model(robot), {}, (), {}, {})


def test_bushings(tmp_path: Path) -> None:
    plain, robot = robot_of_text(""), robot_from_toml(TEXTS["bushing"])
    (mount,) = robot.elements
    assert "elements" not in record_of(plain)
    assert mount == Bushing("mount", ("base", "fore"), mount.placements, tuple(STIFFNESS), tuple(DAMPING))
    assert robot.rigid().elements == robot.elements
    assert Placement() == Bushing("mount", ("base", "fore")).placements[0]
    refused(InputError, r"the closed form knows no bushings \(mount\)", refuse_springs, build_model(robot))
    with pytest.raises(InputError, match=r"MuJoCo has no equal for bushings\.mount: left out"):
        eomgen.export_mjcf(robot, tmp_path / "robot.xml")


def test_exponential_springs() -> None:
    robot = robot_from_toml(BLOCK)
    given = robot.joints[0].coordinates["z"]
    assert given == Coordinate(40.0, further=GIVEN)
    assert given.law() == GIVEN
    assert hash(given) == hash(Coordinate(40.0))  # which need not tell them apart
    names = ("stiffness", "exponential.force", "exponential.scale")
    assert list(build_model(robot).parameters)[3:] == [f"joints.rail.z.{x}" for x in names]
    lines = robot_info(robot).lines()
    assert "  exponential.force 3, exponential.scale 0.05" in lines
    assert any(line.startswith("generalized_force") and line.split()[4] == "1" for line in lines)  # an exp


@pytest.mark.parametrize(("kind", "units"), [("prismatic", ["N", "m"]), ("revolute", ["N.m", "rad"])])
def test_units_of_fmi(kind: str, units: list[str]) -> None:
    robot = slider(further=GIVEN)
    table = {"z" if kind == "prismatic" else "gamma": Coordinate(further=GIVEN)}
    model = build_model(replace(robot, joints=(replace(robot.joints[0], type=kind, coordinates=table),)))
    found = [x for x in make_layout(model, step_variable(1e-3), model.home).variables if ".exponential." in x.name]
    assert [(x.unit, x.start, x.minimum) for x in found] == [(units[0], 3.0, 0.0), (units[1], 0.05, 1e-12)]
    assert all(UNITS[x.unit] for x in found)


def test_friction_under_load() -> None:
    """Numbers that go with the load go from rigid robots, also from what is tunable; coulomb stays."""
    friction = robot_from_toml(WHEEL).joints[0].coordinates["gamma"].friction
    assert friction == Friction(0.0, coefficient=0.08, radius=0.02)
    assert friction.smoothing == 4e-8
    plain = record_of(pin(Friction(1.0)))["joints"][0]["coordinates"]["gamma"]["friction"]
    assert set(plain) == {"coulomb", "static", "stribeck", "viscous", "smoothing"}
    name, bare = "joints.pin.gamma.friction", replace(LOADED, coefficient=None, radius=None)
    rigid = replace(pin(), tunable=(f"{name}.coefficient", f"{name}.coulomb")).rigid()
    assert rigid.joints[0].coordinates["gamma"].friction == bare
    assert rigid.tunable == (f"{name}.coulomb",)
    assert f"{name}.radius" not in build_model(rigid).parameters
    closed = cut_pin().rigid()
    assert closed.loops[0].coordinates == {"gamma": Coordinate(friction=bare)}
    assert build_model(closed).cut_laws


def test_journals_of_loops() -> None:
    robot = robot_from_toml(SWING)
    (loop,) = robot.loops
    assert loop.radial == Radial(1e-3, 1e6, None, 0.5)
    assert "radial" not in record_of(replace(robot, loops=(replace(loop, radial=None),)))["loops"][0]
    assert build_model(robot).cut_laws == (("pin", "x", Coordinate()), ("pin", "y", Coordinate()))
    assert (robot.rigid().loops[0].radial, robot.rigid().tunable) == (None, ())
    name = "loops.pin.radial.restitution_damping"
    assert (parameter_unit(robot, name), least_of(name)) == ("s/m", 0.0)
    info = info_of(robot)
    assert info.as_dict()["journals"] == {"pin.radial": loop.radial.law()}
    assert any(line.startswith("  radial: clearance 0.001") for line in info.lines())
    assert "loops.pin.radial: without clearance" in left_out(robot)
    refused(InputError, r"no journals of cut joints \(pin\)", closed_form, build_model(robot))


def test_damping_of_joints() -> None:
    robot = robot_from_toml(
        TUMBLER.replace('name = "tumbler"', 'name = "tumbler"\ntunable = ["joints.root.damping.*"]')
    )
    (joint,), names = robot.joints, tuple(f"joints.root.damping.{key}" for key in JointDamping.NUMBERS)
    assert joint.damping == robot.rigid().joints[0].damping == JointDamping(2.0, 0.1)
    assert "damping" not in record_of(replace(robot, joints=(replace(joint, damping=None),), tunable=()))["joints"][0]
    assert build_model(robot).turning == (0,)
    assert ball(JointDamping(angular=0.5)).rigid().joints[0].damping is None
    for name, number in zip(names, JointDamping.NUMBERS.values(), strict=True):
        assert number_of(name) is number
        assert least_of(name) == number.least
        assert parameter_unit(robot, name) in UNITS
    assert parameter_unit(robot, "joints.root.damping.angular") == "N.m.s/rad"
    info = info_of(robot)
    assert info.as_dict()["joint_damping"] == {"root": {"linear": 2.0, "angular": 0.1}}
    assert any(line == "root.damping: linear 2, angular 0.1" for line in info.lines())
    assert "damping of coordinates, none of joints (root)" in unknown_to_textbook(build_model(robot))
    assert (
        robot.tunable == robot.rigid().tunable == tuple(f"joints.root.damping.{key}" for key in ("linear", "angular"))
    )
    held = replace(joint, type="fixed", coordinates=dict.fromkeys(LINEAR, Coordinate()), damping=None)
    assert replace(robot, joints=(held,)).rigid().tunable == ()


def test_matrices_of_bushings_and_loops() -> None:
    robot = robot_from_toml(tree(beside=MATRIX_MOUNT + CLAMP))
    (mount,), (clamp,) = robot.elements, robot.loops
    K = np.diag([9.0, 8.0, 7.0, 1.0, 1.0, 1.0])
    K[0, 4] = K[4, 0] = 2.0
    assert mount.stiffness == JointStiffness.of(K.tolist(), at=Placement((0.0, 0.0, 0.1)))
    assert mount.damping == JointDamping(ratio=0.1, at_hz=5.0)
    assert clamp.stiffness == JointStiffness({"x.x": 9.0, "x.beta": 2.0, "y.y": 8.0, "beta.beta": 1.0})
    changed = robot.with_value("bushings.mount.stiffness.y.y", 6.0).with_value("loops.clamp.stiffness.x.beta", 1.0)
    assert changed.elements[0].law()["stiffness.y.y"] == 6.0
    assert changed.loops[0].stiffness.entries["x.beta"] == 1.0
    refused(DescriptionError, "units", robot.with_value, "bushings.mount.stiffness.x.beta", 100.0)
    lines = info_of(robot).lines()
    assert any(line.startswith("bushing mount from base to fore") for line in lines)
    assert sum("principal 7, 8, 9 N/m and" in line for line in lines) == 1
    assert any(line.split() == ["x", "9", "0", "2"] for line in lines)
    lost = {"bushings.mount: left out", "loops.clamp.stiffness: left out", "loops.clamp.damping: left out"}
    assert lost <= {*left_out(robot)}
    six = str(np.diag([9.0, 8.0, 5.0, 0.0, 1.0, 0.0]).tolist())
    assert robot_from_toml(tree(beside=CLAMP.replace(ROWS, six))).notes == (
        "loops.clamp.stiffness: rows of coordinates that do not move are left out: z",
    )
    assert (robot.rigid().loops[0].stiffness, robot.rigid().loops[0].damping) == (None, None)
