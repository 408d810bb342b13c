"""What is rigid in a cut joint, beside coordinates that have a force."""

from __future__ import annotations

import json
import pickle
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.errors import DescriptionError, InputError
from eomgen.robot.cuts import CUTS, Component, rigid_components
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR, Coordinate, Friction, Loop, Robot

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


def test_records_and_pickles() -> None:
    robot = four_bar(gamma=Coordinate(friction=Friction(1.0)), alpha=SPRING)
    assert tuple(robot.loops[0].coordinates) == ("alpha", "gamma")
    given = replace(robot, loops=(replace(robot.loops[0], offset=(None, 1e-3, None, None, None, None)),))
    for one in (robot, given):
        assert robot_of(json.loads(json.dumps(record_of(one)))) == one == pickle.loads(pickle.dumps(one))
    hash(robot.loops[0])
    plain = eomgen.load_robot("four_bar").loops[0]
    assert len({robot_hash(x) for x in (robot, given, replace(robot, loops=(plain,)))}) == 3


def test_a_loop_without_forces_is_recorded_as_before() -> None:
    (table,) = record_of(eomgen.load_robot("four_bar"))["loops"]
    assert set(table) == {"name", "links", "type", "placements"}
    bad = record_of(four_bar(x=SPRING))
    bad["loops"][0]["coordinates"]["w"] = bad["loops"][0]["coordinates"].pop("x")
    with pytest.raises(InputError, match="loop 'joint4': 'w' is no coordinate; allowed: x, y, z, alpha"):
        robot_of(bad)


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
    with pytest.raises(DescriptionError, match=message):
        build_model(four_bar(x=given))
