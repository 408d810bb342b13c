"""Couplings between coordinates: what they say, their parameters, and what contradicts itself."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest

from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.model import build_model, open_tree
from eomgen.robot.parameter_names import least_of
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Coordinate, Coupling, Robot, first_contradiction

JOINTS = ("a", "b", "c", "d", "rack")
LOOP = """
[[loops]]
name = "pin"
links = ["la", "lb"]
type = "planar"
"""


def read(*couplings: str, top: str = "", folder: Path | None = None, more: str = "") -> Robot:
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
    robot = read(
        'of = "b.gamma"\nto = { "a.gamma" = -2.0, rack.z = 3.0 }\noffset = 0.5',
        'of = "c.gamma"\nto = { "a.gamma" = 1.0 }\nstiffness = 1e4\ndamping = 2.0\nclearance = 1e-3',
        more=LOOP,
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
    robot = read(
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
    elastic = read('of = "b.gamma"\nto = { "a.gamma" = -2.0 }\nstiffness = 5.0\ndamping = 0.1')
    assert parameter_unit(elastic, "couplings.gear1.damping") == "N.m.s/rad"
    plain = build_model(read('of = "b.gamma"\nto = { "a.gamma" = -2.0 }'))
    assert not [name for name in plain.parameters if name.startswith("couplings.")]


def test_records_and_pickles() -> None:
    robot = read(
        'of = "b.gamma"\nto = { "rack.z" = 2.0, "a.gamma" = 1.0 }',
        'of = "c.gamma"\nto = {}\noffset = 0.1',
        'of = "rack.z"\nto = { "a.gamma" = 1.0 }\nstiffness = 3.0',
    )
    again = robot_of(json.loads(json.dumps(record_of(robot))))
    assert again == robot == pickle.loads(pickle.dumps(robot))
    assert robot_hash(again) == robot_hash(robot) != robot_hash(read())
    assert "couplings" not in record_of(read())
    hash(robot.couplings[0])


def test_the_rigid_robot_has_rigid_gears() -> None:
    robot = read(
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
    with pytest.raises(DescriptionError, match=r"line \d+, column \d+: .*" + message):
        read(*couplings)


def test_what_may_stand_beside_each_other() -> None:
    """Elastic couplings may say anything; one that is rigid may follow a prescribed coordinate."""
    spring = "stiffness = 1e3"
    robot = read(
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
    robot = read('of = "b.gamma"\nto = {}')
    for bad in (
        Coupling("gear", "b.gamma", {"b.gamma": 1.0}),
        Coupling("gear", "b.gamma", {}, None, Coordinate(armature=1.0)),
        Coupling("0", "b.gamma", {}),
    ):
        with pytest.raises(DescriptionError, match=r"couplings"):
            build_model(Robot(**{**vars(robot), "couplings": (bad,)}))


def test_long_trains_are_looked_at_one_by_one() -> None:
    """A chain longer than Python's recursion limit, and its circle."""
    train = [Coupling(f"g{i}", f"j{i}.gamma", {f"j{i + 1}.gamma": 1.0}) for i in range(3000)]
    assert first_contradiction(train) is None
    found = first_contradiction([*train, Coupling("last", "j3000.gamma", {"j2999.gamma": 1.0})])
    assert found is not None
    assert found[1] == "it goes round in a circle: g2999 -> last -> g2999"


def test_info_lists_loops_couplings_drives_and_home() -> None:
    robot = read(
        'of = "b.gamma"\nto = { "a.gamma" = -2.0, rack.z = 3.0 }\noffset = 0.5',
        'of = "c.gamma"\nto = {}\nstiffness = 1e4\nclearance = 1e-3',
        top='driven = ["a.gamma"]\nhome = { a.gamma = 0.25, rack = { z = 1e-3 } }',
        more=LOOP + "z = { stiffness = 1e7, damping = 2.0 }\ngamma = {}\n",
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
    assert found["constraints"] == ["pin.alpha", "pin.beta", "gear1"]
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
