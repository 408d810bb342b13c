"""Stiffness of closed mechanisms in calibrations: deflections that passive coordinates follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import InputError
from eomgen.identification import MeasuredPoses, calibrate, poses_from_columns
from eomgen.identification.geometry.compliances import compliances_of
from eomgen.identification.geometry.error_model import COMPLIANCE, OFFSET, ErrorModel, ErrorParameter, Rows, rows_of
from eomgen.identification.geometry.loop_constraints import closed_readings, closing_of
from eomgen.identification.geometry.stations import chain_of, matrix_of
from eomgen.robot import Coordinate, JointStiffness
from eomgen.robot.model import build_model

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
COUNT = 24
SOFT = {(1, 5): ("joints.joint1.gamma.stiffness", 2e-4), (2, 0): ("joints.joint2.x.stiffness", 1e-6)}  # drive, bearing


def columns() -> dict[str, Array]:
    """Drive and loads of a four-bar linkage; positions are to come."""
    drive = np.linspace(0.3, 6.0, COUNT)
    load = {"tcp.fx": 40.0 * np.cos(7.0 * drive), "tcp.fy": -60.0 + 50.0 * np.sin(5.0 * drive), "tcp.mz": 3.0 * drive}
    return {"joint1.gamma": drive} | load | {f"tcp.{axis}": np.zeros(COUNT) for axis in "xyz"}


def linkage(given: dict[str, Array], parameters: tuple[ErrorParameter, ...]) -> tuple[ErrorModel, Rows]:
    robot = eomgen.load_robot("four_bar")
    tree = build_model(robot)
    chain = chain_of(robot, {"tcp": ("coupler", matrix_of(robot.frames[0].placement))})
    rows = rows_of(chain, robot, poses_from_columns(given, tree.coordinates, ["tcp"]), {"joint1.gamma": (1, 5, 1.0)})
    closing = closing_of(tree, chain, [(1, 5)], "poses")
    readings = closed_readings(chain, closing, tree, rows.readings, [""] * len(rows.series))
    return ErrorModel(robot, chain, parameters, {0: np.eye(4)}, closing), replace(rows, readings=readings)


def compliances() -> tuple[ErrorParameter, ...]:
    return tuple(ErrorParameter(name, COMPLIANCE, *place, "force", c, c) for place, (name, c) in SOFT.items())


def test_deflections_are_those_of_least_energy() -> None:
    """The derivative of e^2 / 2 c less the work of weights and loads vanishes, by differences along closed poses."""
    model, rows = linkage(columns(), compliances())
    state = model.at(model.nominal, rows)
    found = state.factors * model.nominal
    assert np.abs(found).max(axis=0) == pytest.approx(np.array([3e-3, 2e-5]), rel=9.0)  # far above round-off
    rigid = tuple(ErrorParameter(f"offset {i}", OFFSET, *place, "one", 0.0, 1.0) for i, place in enumerate(SOFT))
    other = replace(model, parameters=rigid)
    tool, base = model.chain.tools["tcp"], np.array(model.robot.gravity)

    def work(row: int, e: Array) -> float:
        at = other.at(e, rows.part(np.array([row]))).located
        total = sum(
            station.mass * float(base @ (at.p[k, 0] + at.R[k, 0] @ station.com))
            for k, station in enumerate(model.chain.stations)
            if station.com is not None
        )
        load = rows.loads[tool][row]
        angle = np.arctan2(at.R[tool, 0, 1, 0], at.R[tool, 0, 0, 0])
        return total + float(load[:3] @ at.p[tool, 0]) + float(load[5]) * float(angle)

    for row in (0, 7, 15):
        for i, h in enumerate((1e-5, 1e-5)):
            step = h * np.eye(2)[i]
            force = (work(row, found[row] + step) - work(row, found[row] - step)) / (2.0 * h)
            assert found[row, i] == pytest.approx(model.nominal[i] * force, rel=1e-4, abs=1e-12)
    np.testing.assert_allclose(other.at(found[7], rows.part(np.array([7]))).located.p[tool], state.located.p[tool, 7:8])


MATRIX = np.array([[1e6, -6e5], [-6e5, 8e5]])  # N/m, between x and y of joint2


def test_deflections_by_a_matrix_couple_coordinates() -> None:
    """e = C f between two coordinates that the loop takes up; sensitivities are derivatives through it, too."""
    robot = eomgen.load_robot("four_bar")
    joint = replace(
        robot.joint("joint2"),
        coordinates={**robot.joint("joint2").coordinates, "x": Coordinate(), "y": Coordinate()},
        stiffness=JointStiffness.of(MATRIX.tolist(), ("x", "y")),
    )
    robot = replace(robot, joints=tuple(joint if x.name == "joint2" else x for x in robot.joints))
    chain = chain_of(robot, {"tcp": ("coupler", matrix_of(robot.frames[0].placement))})
    parameters = tuple(compliances_of(chain, robot))
    assert [parameter.name.partition("stiffness.")[2] for parameter in parameters] == ["x.x", "x.y", "y.y"]
    plain, rows = linkage(columns(), parameters)
    tree = build_model(robot)
    model = replace(plain, robot=robot, chain=chain, closing=closing_of(tree, chain, [(1, 5)], "poses"))
    state, C, tool = model.at(model.nominal, rows), np.linalg.inv(MATRIX), model.chain.tools["tcp"]
    forces = state.factors[:, [0, 2]]  # in x and in y
    np.testing.assert_allclose(state.factors[:, 1], forces[:, 1])
    np.testing.assert_allclose(state.back[:, 0], forces[:, 0])
    offsets = tuple(ErrorParameter(f"offset {c}", OFFSET, 2, c, "one", 0.0, 1.0) for c in (0, 1))
    rigid = replace(model, parameters=offsets)
    for row in (0, 7, 15):
        bent = rigid.at(C @ forces[row], rows.part(np.array([row])))
        np.testing.assert_allclose(bent.located.p[tool, 0], state.located.p[tool, row], atol=1e-12)
    x = 1e-3 * model.nominal
    S = model.at(x, rows).sensitivities(tool)[:, :3]
    for i, c in enumerate(x):
        step = 0.1 * abs(c) * np.eye(3)[i]
        ahead, behind = (model.at(x + change, rows).located.p[tool] for change in (step, -step))
        slope = (ahead - behind) / (2.0 * step[i])
        np.testing.assert_allclose(S[:, :, i], slope, atol=2e-3 * np.abs(slope).max())


def test_sensitivities_of_compliances_are_derivatives() -> None:
    """To first order: of deflections so small that they leave the lever arms of loads as they are."""
    model, rows = linkage(columns(), compliances())
    tool, x = model.chain.tools["tcp"], 1e-3 * model.nominal
    S = model.at(x, rows).sensitivities(tool)[:, :3]
    for i, c in enumerate(x):
        step = 0.1 * c * np.eye(2)[i]
        ahead, behind = (model.at(x + change, rows).located.p[tool] for change in (step, -step))
        slope = (ahead - behind) / (2.0 * step[i])
        np.testing.assert_allclose(S[:, :, i], slope, atol=2e-3 * np.abs(slope).max())


def measured() -> MeasuredPoses:
    """Positions of the soft linkage under its loads."""
    model, rows = linkage(columns(), compliances())
    p = model.at(model.nominal, rows).located.p[model.chain.tools["tcp"]]
    given = columns() | {f"tcp.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
    return poses_from_columns(given, build_model(model.robot).coordinates, ["tcp"])


def test_stiffness_of_a_linkage_is_found() -> None:
    asked = ["joint1.gamma", "joint2.x"]
    found = calibrate("four_bar", measured(), stiffness=asked, folds=0, noise=(1e-6, 1e-6))
    for name, c in SOFT.values():
        assert found[name] == pytest.approx(1.0 / c, rel=0.01)
    rigid = calibrate("four_bar", measured(), folds=0)
    assert rigid.residuals["full"]["fitted"]["position"] > 100.0 * found.residuals["full"]["fitted"]["position"]


@pytest.mark.parametrize(
    ("name", "why"), [("joint2.gamma", "follows from the drives"), ("joint2.alpha", "is held by the loops, too")]
)
def test_what_loops_hold_is_refused_by_name(name: str, why: str) -> None:
    with pytest.raises(InputError, match=f"stiffness: {name} {why}; allowed: drives of four_bar, and coordinates"):
        calibrate("four_bar", measured(), stiffness=[name], folds=0)


def test_loops_that_nothing_closes_are_refused() -> None:
    """Loop joints whose dampers alone resist: springs would be as good as rigid ones."""
    robot = eomgen.load_robot("hexapod_elastic")
    loops = []
    for loop in robot.loops:
        damped = {name: Coordinate(damping=1.0) for name in loop.coordinates}
        loops.append(replace(loop, coordinates=damped))
    robot = replace(robot, loops=tuple(loops))
    tree = build_model(robot)
    drives = [tree.coordinates[i] for i in tree.driven]
    given = {name: np.linspace(-0.02, 0.02, 30) ** (i + 1) for i, name in enumerate(drives)}
    given |= {f"{robot.frames[0].name}.{axis}": np.linspace(0.0, 0.1, 30) ** (i + 1) for i, axis in enumerate("xyz")}
    poses = poses_from_columns(given, tree.coordinates, [robot.frames[0].name])
    with pytest.raises(InputError, match="hexapod_elastic: all loops are elastic in all coordinates"):
        calibrate(robot, poses, folds=0)


@pytest.mark.parametrize("kind", ["table", "matrix"])
def test_mechanisms_that_springs_alone_place_are_refused(kind: str) -> None:
    robot = eomgen.load_robot("four_bar")
    given = measured()
    joints = []
    for joint in robot.joints:
        if joint.name != "joint1" and kind == "matrix":
            joint = replace(joint, stiffness=JointStiffness.of([[50.0]], ("gamma",)))
        elif joint.name != "joint1":
            joint = replace(joint, coordinates={"gamma": replace(joint.coordinates["gamma"], stiffness=50.0)})
        joints.append(joint)
    with pytest.raises(InputError, match="four_bar: springs hold all coordinates but those of drives"):
        calibrate(replace(robot, joints=tuple(joints)), given, folds=0)


def test_offsets_move_what_loads_deflect() -> None:
    """Sensitivities are derivatives: an offset changes the arms of loads, and a deflection those of others."""
    given = columns()
    offsets = tuple(ErrorParameter(f"offset {k} {c}", OFFSET, k, c, "one", 0.0, 1.0) for k in (1, 2) for c in (0, 1, 5))
    model, rows = linkage(given, (*compliances(), *offsets))
    x, tool = model.nominal, model.chain.tools["tcp"]
    S = model.at(x, rows).sensitivities(tool)[:, :3]
    for i, size in enumerate([*(1e-3 * x[:2]), *[1e-5] * len(offsets)]):
        step = size * np.eye(len(x))[i]
        ahead, behind = (model.at(x + change, rows).located.p[tool] for change in (step, -step))
        slope = (ahead - behind) / (2.0 * size)
        np.testing.assert_allclose(
            S[:, :, i], slope, rtol=3e-6, atol=1e-9 + 3e-6 * np.abs(slope).max(), err_msg=model.parameters[i].name
        )
