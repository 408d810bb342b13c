"""Drives, home, couplings and loop joints of a description, and models that are derived once for each robot."""

from __future__ import annotations

import json
import pickle
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis.holding import pose_of
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.lazily import KEPT, kept
from eomgen.motion.ends import default_motion
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.joint_types import CUTS, Component, rigid_components
from eomgen.robot.model import build_model, movable_coordinates, open_tree, program_coordinates, rigid_coordinates
from eomgen.robot.parameter_names import least_of
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import (
    ANGULAR,
    COORDINATES,
    LINEAR,
    Coordinate,
    Coupling,
    Friction,
    Loop,
    Robot,
    first_contradiction,
)
from tests.support.joint_table import joint_table, link_table, loop_table
from tests.support.optional import needs
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")


def read(top: str = "") -> Robot:
    return robot_from_toml(f"""
name = "arm"
{top}
{link_table("upper", 1.0)}
{link_table("fore", 1.0)}
{joint_table("shoulder", "base", "upper", "revolute")}
limits = [-1.0, 2.0]
motor = {{ inertia = 1e-4, ratio = 50.0, stiffness = 1e4 }}
alpha = {{ stiffness = 1e5 }}
{joint_table("elbow", "upper", "fore", "revolute")}
beta = {{ stiffness = 1e5 }}
{joint_table("shaft", "base", "hub", "revolute")}
prescribed = ["gamma"]
{link_table("hub", 1.0)}
""")


def driven(robot: Robot) -> list[str]:
    model = build_model(robot)
    return [model.coordinates[i] for i in model.driven]


def test_drives_are_the_named_ones_through_their_motors() -> None:
    assert driven(read()) == ["shoulder.motor", "elbow.gamma"]
    assert driven(read('driven = ["shoulder.gamma"]')) == ["shoulder.motor"]
    assert driven(read('driven = ["elbow.gamma", "shoulder.motor"]')) == ["shoulder.motor", "elbow.gamma"]
    assert driven(read('driven = ["elbow.beta"]')) == ["elbow.beta"]
    assert driven(read("driven = []")) == []


def test_the_rigid_robot_keeps_the_drives_that_move() -> None:
    robot = read('driven = ["elbow.beta", "shoulder.motor"]\nhome = { shoulder.gamma = 0.5, elbow.beta = 1e-3 }')
    assert robot.rigid().driven == ("shoulder.gamma",)
    assert dict(robot.rigid().home) == {"shoulder.gamma": 0.5}
    assert driven(robot.rigid()) == ["shoulder.gamma"]
    assert read().rigid().driven is None


@pytest.mark.parametrize("seed", range(20))
def test_the_rigid_robot_s_coordinates_are_those_of_its_model(seed: int) -> None:
    needs("pinocchio")  # which closes the random mechanisms
    from tests.support.random_mechanisms import mechanism

    for robot in (random_robot(seed), mechanism(seed).robot, mechanism(seed + 20).robot):
        if not rigid_coordinates(robot):
            refused(DescriptionError, "no active coordinate", build_model, robot.rigid())
            continue
        model = build_model(robot.rigid())
        assert rigid_coordinates(robot) == model.coordinates
        moving = [i for i in range(len(model.coordinates)) if i not in model.prescribed]
        assert movable_coordinates(robot) == tuple(model.coordinates[i] for i in moving)
        driven = model.driven if robot.is_closed else moving
        assert program_coordinates(robot) == tuple(model.coordinates[i] for i in driven)


def test_home_of_coordinates_and_of_motors() -> None:
    model = build_model(read('home = { "shoulder.gamma" = 0.5, elbow = { gamma = -0.25 } }'))
    assert dict(zip(model.coordinates, model.home, strict=True)) == {
        "shoulder.alpha": 0.0,
        "shoulder.gamma": 0.5,
        "shoulder.motor": 25.0,
        "elbow.beta": 0.0,
        "elbow.gamma": -0.25,
        "shaft.gamma": 0.0,
    }
    turned = build_model(read('home = { "shoulder.motor" = 3.0, "shaft.gamma" = 1.0 }'))
    assert turned.home == (0.0, 0.0, 3.0, 0.0, 0.0, 1.0)


def test_default_motions_begin_at_home() -> None:
    robot = read('home = { "shoulder.gamma" = 1.9 }')
    names = ("shoulder.gamma", "elbow.gamma")
    motion = default_motion(robot, 1.0, names)
    assert motion.start.tolist() == [1.9, 0.0]
    assert -1.0 <= motion.goal[0] < 1.9
    assert default_motion(read(), 1.0, names).start.tolist() == [0.0, 0.0]


def test_records_keep_the_drives_and_the_home() -> None:
    tops = ("", "driven = []", 'driven = ["elbow.gamma"]', 'home = { "elbow.gamma" = 1.0 }')
    check_records(*map(read, tops))
    assert {"driven", "home"}.isdisjoint(record_of(read()))


@pytest.mark.parametrize(
    ("top", "message"),
    [
        (
            'driven = ["elbow"]',
            r"line 3, column \d+: driven: there is no coordinate 'elbow'; did you mean 'elbow\.beta'",
        ),
        ('driven = ["elbow.x"]', r"driven: there is no coordinate 'elbow\.x'.*\(allowed: 'shoulder\.alpha', 'should"),
        ('driven = ["shaft.gamma"]', r"driven: the motion of 'shaft\.gamma' is prescribed; allowed: coordinates that"),
        ('driven = ["elbow.gamma", "elbow.gamma"]', r"driven: 'elbow\.gamma' is there twice; allowed: one name for"),
        (
            'driven = ["shoulder.motor", "shoulder.gamma"]',
            r"'shoulder\.motor' drives 'shoulder\.gamma', too; allowed: ",
        ),
        ('driven = "elbow.gamma"', r"driven: got 'elbow\.gamma'; allowed: an array of strings"),
        ('home = { "elbow.x" = 1.0 }', r"home: there is no coordinate 'elbow\.x'.*\(allowed: 'shoulder\.alpha', "),
        (
            'home = { "shoulder.gamma" = 2.5 }',
            r"home\.shoulder\.gamma: got 2\.5; allowed: within the limits, -1 to 2 ra",
        ),
        ('home = { "elbow.gamma" = inf }', r"home\.elbow\.gamma: got inf; allowed: a finite number"),
        ("home = 3", r"home: got 3; allowed: a table of numbers by joint or coordinate"),
    ],
)
def test_bad_drives_and_homes(top: str, message: str) -> None:
    refused(DescriptionError, message, read, top)


def test_a_robot_made_in_python_is_looked_at_too() -> None:
    for bad in (replace(read(), driven=("nothing.x",)), replace(read(), home={"nothing.x": 1.0})):
        refused(DescriptionError, r"there is no coordinate 'nothing\.x'", build_model, bad)


def test_poses_begin_at_home() -> None:
    robot = replace(eomgen.load_robot("one_link"), home={"joint1.gamma": 0.3})
    kernel = eomgen.build(robot)
    assert pose_of(robot, kernel, None) == pytest.approx([0.0, 0.3])
    assert pose_of(robot, kernel, {}) == pytest.approx([0.0, 0.3])
    assert np.array_equal(pose_of(robot, kernel, {"joint1": 0.1}), [0.0, 0.1])


JOINTS = ("a", "b", "c", "d", "rack")
PLANAR = f"""
{loop_table("pin", "la", "lb", "planar")}
"""


def train(*couplings: str, top: str = "", folder: Path | None = None, more: str = "") -> Robot:
    """Five joints at the base; d is prescribed, the rack slides, a gives way along x."""
    lines = ['name = "train"', top]
    for name in JOINTS:
        kind = "prismatic" if name == "rack" else "revolute"
        lines += ["[[links]]", f'name = "l{name}"', "mass = 1.0"]
        lines += ["[[joints]]", f'name = "{name}"', 'parent = "base"', f'child = "l{name}"', f'type = "{kind}"']
        lines += ['prescribed = ["gamma"]'] if name == "d" else []
        lines += ["x = { stiffness = 1e6 }"] if name == "a" else []
    for i, text in enumerate(couplings):
        lines += ["[[couplings]]", f'name = "gear{i + 1}"', text]
    return robot_from_toml("\n".join([*lines, more]), folder=folder)


def test_rigid_and_elastic_couplings() -> None:
    robot = train(
        'of = "b.gamma"\nto = { "a.gamma" = -2.0, rack.z = 3.0 }\noffset = 0.5',
        'of = "c.gamma"\nto = { "a.gamma" = 1.0 }\nstiffness = 1e4\ndamping = 2.0\nclearance = 1e-3',
        more=PLANAR,
    )
    first, second = robot.couplings
    assert (first.of, dict(first.to), first.offset, first.law) == (
        "b.gamma",
        {"a.gamma": -2.0, "rack.z": 3.0},
        0.5,
        None,
    )
    assert second.law == Coordinate(1e4, 2.0, clearance=1e-3)
    model = build_model(robot)
    assert model.constraints == ("pin.z", "pin.alpha", "pin.beta", "gear1")
    assert model.cut_laws == (("gear2", "", second.law),)


def test_parameters_by_name() -> None:
    names = '["couplings.gear1.ratio", "couplings.*.ratio.a.gamma", "couplings.gear2.curve"]'
    robot = train(
        'of = "b.gamma"\nto = { "a.gamma" = -2.0, rack.z = 3.0 }\noffset = 0.5',
        'of = "rack.z"\nto = { "a.gamma" = 0.1 }\ncurve = [[-1.0, -2.0], [1.0, 2.0]]\nfriction = { coulomb = 1.0 }',
        top=f"tunable = {names}",
    )
    model = build_model(robot)
    known = {name: value for name, value in model.parameters.items() if name.startswith("couplings.")}
    assert known == {
        "couplings.gear1.ratio.a.gamma": -2.0,
        "couplings.gear1.ratio.rack.z": 3.0,
        "couplings.gear1.offset": 0.5,
        "couplings.gear2.ratio.a.gamma": 0.1,
        "couplings.gear2.friction.coulomb": 1.0,
        "couplings.gear2.friction.smoothing": 4e-8,
        "couplings.gear2.curve.0": -2.0,
        "couplings.gear2.curve.1": 2.0,
    }
    units = {name: parameter_unit(robot, name) for name in known}
    assert units["couplings.gear1.ratio.rack.z"] == "rad/m"
    assert units["couplings.gear2.ratio.a.gamma"] == "m/rad"
    assert (units["couplings.gear1.ratio.a.gamma"], units["couplings.gear1.offset"]) == ("1", "rad")
    assert (units["couplings.gear2.curve.0"], units["couplings.gear2.friction.coulomb"]) == ("N", "N")
    assert set(units.values()) <= UNITS.keys()
    assert least_of("couplings.gear2.friction.coulomb") == 0.0
    assert least_of("couplings.gear1.ratio.a.gamma") is None
    elastic = train('of = "b.gamma"\nto = { "a.gamma" = -2.0 }\nstiffness = 5.0\ndamping = 0.1')
    assert parameter_unit(elastic, "couplings.gear1.damping") == "N.m.s/rad"
    plain = build_model(train('of = "b.gamma"\nto = { "a.gamma" = -2.0 }'))
    assert not [name for name in plain.parameters if name.startswith("couplings.")]


def test_records_of_couplings() -> None:
    robot = train(
        'of = "b.gamma"\nto = { "rack.z" = 2.0, "a.gamma" = 1.0 }',
        'of = "c.gamma"\nto = {}\noffset = 0.1',
        'of = "rack.z"\nto = { "a.gamma" = 1.0 }\nstiffness = 3.0',
    )
    check_records(robot, train())
    assert "couplings" not in record_of(train())
    hash(robot.couplings[0])


def test_the_rigid_robot_has_rigid_gears() -> None:
    robot = train(
        'of = "b.gamma"\nto = { "a.gamma" = 2.0, "a.x" = 5.0 }\nstiffness = 1e4',
        'of = "a.x"\nto = { "a.gamma" = 4.0, "c.gamma" = 2.0 }\noffset = 1.0',
        'of = "c.gamma"\nto = { "b.gamma" = 1.0 }\ndamping = 3.0',
        'of = "b.gamma"\nto = { "rack.z" = 1.0 }\nstiffness = 1e3',
        top='tunable = ["couplings.gear1.ratio", "couplings.gear2.ratio"]',
    )
    rigid = robot.rigid()
    assert rigid.couplings == (  # what moved freely in the elastic robot is a coordinate of the rigid one
        Coupling("gear1", "b.gamma", {"a.gamma": 2.0}, is_constraint=True),
        Coupling("gear2_rigid", "a.gamma", {"c.gamma": -0.5}, -0.25, is_constraint=True),
        robot.couplings[2],
        robot.couplings[3],  # b follows from gear1
    )
    assert rigid.tunable == ("couplings.gear1.ratio.a.gamma",)
    assert build_model(rigid).constraints == ("gear1", "gear2_rigid")


@pytest.mark.parametrize(
    ("couplings", "message"),
    [
        (('of = "e.gamma"\nto = {}',), r"couplings\.gear1\.of: there is no coordinate 'e\.gamma'.*\(allowed: 'a\.x', "),
        (('of = "a.gama"\nto = {}',), r"'a\.gama'; did you mean 'a\.gamma'\?"),
        (('of = "a.gamma"\nto = { "b.x" = 1.0 }',), r"couplings\.gear1\.to: there is no coordinate 'b\.x'"),
        (('of = "a.gamma"\nto = { "a.gamma" = 1.0 }',), r"gear1\.to: 'a\.gamma' is coupled to itself; allowed: other"),
        (
            ('of = "d.gamma"\nto = { "a.gamma" = 1.0 }',),
            r"gear1\.of: the motion of 'd\.gamma' is prescribed; allowed: ",
        ),
        (
            ('of = "b.gamma"\nto = { "a.gamma" = 1.0 }', 'of = "b.gamma"\nto = {}\noffset = 0.1'),
            r"couplings\.gear2: b\.gamma follows from the coupling gear1; allowed: rigid couplings of different coord",
        ),
        (
            (
                'of = "b.gamma"\nto = { "a.gamma" = 1.0 }',
                'of = "a.gamma"\nto = { "c.gamma" = 1.0 }',
                'of = "c.gamma"\nto = { "b.gamma" = 2.0 }\noffset = 0.1',
            ),
            r"couplings\.gear3: it goes round in a circle: gear1 -> gear2 -> gear3 -> gear1; allowed: ",
        ),
        (('of = "b.gamma"',), r"couplings\.gear1: the key 'to' is missing; allowed: a table of ratios by coordinate"),
        (("to = {}",), r"couplings\.gear1: the key 'of' is missing; allowed: the name of a coordinate"),
        (('of = "b.gamma"\nto = { "a.gamma" = "2" }',), r"gear1\.to\.a\.gamma: got '2'; allowed: a finite number"),
        (('of = "b.gamma"\nto = [1.0]',), r"couplings\.gear1\.to: got \[1\.0\]; allowed: a table of numbers"),
        (('of = "b.gamma"\nto = {}\nclearance = 0.1',), r"gear1\.clearance: there is no stiffness at the end of it"),
        (('of = "b.gamma"\nto = {}\narmature = 0.1',), r"couplings\.gear1: unknown key 'armature'"),
        (('of = "b.gamma"\nto = {}\nstiffness = -1.0',), r"gear1\.stiffness: got -1\.0; allowed: a number that is at"),
    ],
)
def test_bad_couplings(couplings: tuple[str, ...], message: str) -> None:
    refused(DescriptionError, r"line \d+, column \d+: .*" + message, train, *couplings)


def test_what_may_stand_beside_each_other() -> None:
    """Elastic couplings may say anything; one that is rigid may follow a prescribed coordinate."""
    spring = "stiffness = 1e3"
    robot = train(
        'of = "b.gamma"\nto = { "a.gamma" = 1.0 }',
        f'of = "b.gamma"\nto = {{ "c.gamma" = 1.0 }}\n{spring}',
        f'of = "d.gamma"\nto = {{ "b.gamma" = 1.0 }}\n{spring}',
        'of = "rack.z"\nto = { "d.gamma" = 0.1, "b.gamma" = 0.2 }',
    )
    assert build_model(robot).constraints == ()
    assert list(robot.followers) == ["b.gamma", "rack.z"]
    assert build_model(robot).leaders["rack.z"] == ("a.gamma", "d.gamma")
    assert build_model(robot).tree.constraints == ("gear1", "gear4")


def test_a_record_with_bad_couplings_is_refused() -> None:
    robot = train('of = "b.gamma"\nto = {}')
    for bad in (
        Coupling("gear", "b.gamma", {"b.gamma": 1.0}),
        Coupling("gear", "b.gamma", {}, None, Coordinate(armature=1.0)),
        Coupling("0", "b.gamma", {}),
    ):
        refused(DescriptionError, r"couplings", build_model, Robot(**{**vars(robot), "couplings": (bad,)}))


def test_long_trains_are_looked_at_one_by_one() -> None:
    """A chain longer than Python's recursion limit, and its circle."""
    train = [Coupling(f"g{i}", f"j{i}.gamma", {f"j{i + 1}.gamma": 1.0}) for i in range(3000)]
    assert first_contradiction(train) is None
    found = first_contradiction([*train, Coupling("last", "j3000.gamma", {"j2999.gamma": 1.0})])
    assert found[1] == "it goes round in a circle: g2999 -> last -> g2999"


def test_info_lists_loops_couplings_drives_and_home() -> None:
    robot = train(
        'of = "b.gamma"\nto = { "a.gamma" = -2.0, rack.z = 3.0 }\noffset = 0.5',
        'of = "c.gamma"\nto = {}\nstiffness = 1e4\nclearance = 1e-3',
        top='driven = ["a.gamma"]\nhome = { a.gamma = 0.25, rack = { z = 1e-3 } }',
        more=PLANAR + "z = { stiffness = 1e7, damping = 2.0 }\ngamma = {}\n",
    )
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    for line in (
        "loop pin: planar joint between la and lb, cut",
        "  z [m]: stiffness 1e+07, damping 2",
        "  gamma [rad]: free",
        "coupling gear1: b.gamma = -2 a.gamma + 3 rack.z + 0.5, rigid",
        "coupling gear2: c.gamma = 0, stiffness 1e+04, clearance 0.001, smoothing 5e-05",
        "driven: a.gamma",
        "home: a.gamma 0.25 rad, rack.z 0.001 m",
    ):
        assert line in info.lines()
    found = json.loads(json.dumps(info.as_dict()))
    assert (found["loops"], found["constraints"]) == ({"pin": "planar"}, ["pin.alpha", "pin.beta", "gear1"])
    assert found["cut_laws"]["pin.z"] == {"stiffness": 1e7, "damping": 2.0}
    assert found["cut_laws"]["gear2"]["clearance"] == 1e-3
    assert found["couplings"]["gear1"] == {
        "of": "b.gamma",
        "to": {"a.gamma": -2.0, "rack.z": 3.0},
        "offset": 0.5,
        "rigid": True,
    }
    assert found["home"] == {"a.gamma": 0.25, "rack.z": 1e-3}
    said = "the loops are cut ('pin') and the couplings are left out ('gear1', 'gear2')"
    assert open_tree(robot) == f"{said}: all figures are those of the open tree"


SPRING = Coordinate(1e6, 10.0)


def loop(kind: str, *names: str) -> Loop:
    return Loop("cut", ("a", "b"), kind, coordinates=dict.fromkeys(names, SPRING))


def four_bar(**coordinates: Coordinate) -> Robot:
    robot = eomgen.load_robot("four_bar")
    return replace(robot, loops=(replace(robot.loops[0], coordinates=coordinates),))


def turned(angles: Mapping[str, float]) -> np.ndarray:  # type: ignore[type-arg]
    """Rx(alpha) Ry(beta) Rz(gamma)."""
    result = np.eye(3)
    for i, name in enumerate(ANGULAR):
        s, c = np.sin(angles[name]), np.cos(angles[name])
        j, k = (i + 1) % 3, (i + 2) % 3
        turn = np.eye(3)
        turn[j, j] = turn[k, k] = c
        turn[j, k], turn[k, j] = -s, s
        result = result @ turn
    return result


def value(part: Component, R: np.ndarray) -> float:  # type: ignore[type-arg]
    return sum(float(factor * R[i, j]) for factor, i, j in part.products)


@pytest.mark.parametrize("kind", CUTS)
def test_without_forces_it_is_what_the_type_blocks(kind: str) -> None:
    assert rigid_components(loop(kind)) == CUTS[kind]
    assert rigid_components(loop(kind, *LINEAR)) == tuple(part for part in CUTS[kind] if part.name not in LINEAR)
    assert rigid_components(loop(kind, *COORDINATES)) == ()


@pytest.mark.parametrize("elastic", [("alpha",), ("beta",), ("gamma",), ("alpha", "beta"), ("beta", "gamma")])
@pytest.mark.parametrize("kind", CUTS)
def test_rigid_angles_beside_others_vanish_alone(kind: str, elastic: tuple[str, ...]) -> None:
    """Each component is zero where its own angle is, whatever the angles are that have a force or are free."""
    parts = [part for part in rigid_components(loop(kind, *elastic)) if part.products]
    assert [part.name for part in parts] == [x.name for x in CUTS[kind] if x.products and x.name not in elastic]
    rng = np.random.default_rng(1)
    rigid = {part.name for part in parts}
    for _ in range(5):
        angles = {name: 0.0 if name in rigid else float(rng.uniform(-0.5, 0.5)) for name in ANGULAR}
        assert [value(part, turned(angles)) for part in parts] == pytest.approx([0.0] * len(parts), abs=1e-15)
        for part in parts:
            tilted = turned({**angles, part.name: 0.1})
            assert value(part, tilted) > 0.05
            others = [value(other, tilted) for other in parts if other is not part]
            assert others == pytest.approx([0.0] * len(others), abs=1e-15)


def test_rows_and_laws_of_a_model() -> None:
    model = build_model(four_bar(alpha=SPRING, x=Coordinate(1e7, clearance=1e-4), gamma=Coordinate(), y=Coordinate()))
    assert model.constraints == ("joint4.z", "joint4.beta")
    assert [(owner, name) for owner, name, _ in model.cut_laws] == [("joint4", "x"), ("joint4", "alpha")]
    names = [name for name in model.parameters if name.startswith("loops.")]
    assert names[:3] == ["loops.joint4.x.stiffness", "loops.joint4.x.clearance", "loops.joint4.x.smoothing"]
    assert names[3:] == ["loops.joint4.alpha.stiffness", "loops.joint4.alpha.damping"]


def test_a_coordinate_without_numbers_gets_one_that_is_tunable() -> None:
    robot = replace(four_bar(y=Coordinate()), tunable=("loops.joint4.y.damping",))
    model = build_model(robot)
    assert model.parameters["loops.joint4.y.damping"] == 0.0
    assert [(owner, name) for owner, name, _ in model.cut_laws] == [("joint4", "y")]


def test_records_of_cuts() -> None:
    """A loop without forces is recorded as before there were any."""
    plain, robot = eomgen.load_robot("four_bar"), four_bar(gamma=Coordinate(friction=Friction(1.0)), alpha=SPRING)
    assert tuple(robot.loops[0].coordinates) == ("alpha", "gamma")
    check_records(plain, robot, replace(robot, loops=(replace(robot.loops[0], offset=(None, 1e-3, *[None] * 4)),)))
    hash(robot.loops[0])
    (table,) = record_of(plain)["loops"]
    assert set(table) == {"name", "links", "type", "placements"}
    bad = record_of(four_bar(x=SPRING))
    bad["loops"][0]["coordinates"]["w"] = bad["loops"][0]["coordinates"].pop("x")
    refused(InputError, "loop 'joint4': 'w' is no coordinate; allowed: x, y, z, alpha", robot_of, bad)


def test_rigid_keeps_what_the_type_leaves_free() -> None:
    robot = replace(
        four_bar(x=SPRING, gamma=Coordinate(damping=1.0)),
        tunable=("loops.joint4.x.stiffness", "loops.joint4.gamma.damping", "loops.joint4.placements.0.xyz.0"),
    )
    rigid = robot.rigid()
    assert dict(rigid.loops[0].coordinates) == {"gamma": Coordinate(damping=1.0)}
    assert rigid.tunable == ("loops.joint4.gamma.damping", "loops.joint4.placements.0.xyz.0")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (Coordinate(armature=1.0), r"loops\.joint4\.x\.armature: it moves no inertia; allowed: stiffness"),
        (Coordinate(prescribed=True), r"loops\.joint4\.x: it has no motion to prescribe; allowed: "),
        (Coordinate(clearance=1e-3), r"loops\.joint4\.x\.clearance: there is no stiffness at the end of it; allowed: "),
    ],
)
def test_bad_coordinates(given: Coordinate, message: str) -> None:
    refused(DescriptionError, message, build_model, four_bar(x=given))


def test_a_robot_has_one_model() -> None:
    """An equal robot has its own: its numbers may have other signs of zero."""
    robot = eomgen.load_robot("puma560_elastic")
    assert build_model(robot) is build_model(robot)
    assert build_model(robot, with_followers=True) is not build_model(robot)
    assert robot.rigid() is robot.rigid()
    assert build_model(robot.rigid()) is build_model(robot.rigid())
    other = replace(robot)
    assert other == robot
    assert build_model(other).robot is other


def test_errors_are_raised_each_time() -> None:
    robot = replace(eomgen.load_robot("one_link"), name="no name")
    for _ in range(2):
        refused(DescriptionError, "no name", build_model, robot)


def test_what_is_kept_is_bounded() -> None:
    calls: list[object] = []
    function = kept(lambda owner: calls.append(owner))
    owners = [object() for _ in range(KEPT + 1)]
    for owner in (*owners, *owners[1:], owners[0]):
        function(owner)
    assert calls == [*owners, owners[0]]


def check_records(*robots: Robot) -> None:
    """Each is the same after a record and a pickle, and has a hash of its own."""
    for robot in robots:
        again = robot_of(json.loads(json.dumps(record_of(robot))))
        assert again == robot == pickle.loads(pickle.dumps(robot))
        assert robot_hash(again) == robot_hash(robot)
    assert len({robot_hash(robot) for robot in robots}) == len(robots)
