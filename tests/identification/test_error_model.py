"""The error model of calibration: poses, forces and sensitivities against kernels, ranks by counting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.analysis.sensitivity import offset_sensitivity
from eomgen.identification import calibrate
from eomgen.identification.geometry.error_model import COMPLIANCE, DRIVE, ErrorParameter, Rows
from eomgen.identification.geometry.rotations import vectors_of
from eomgen.identification.geometry.solve import algebraic_rank
from eomgen.identification.geometry.stations import chain_of, forces_on, located, matrix_of
from eomgen.robot.value import COORDINATES, Coordinate
from tests.support.measured_poses import TCP, arm, chain, trial
from tests.support.measurements import assert_slopes, calibrated

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]


def test_stations_are_where_kernels_have_frames() -> None:
    """With offsets in all coordinates, and sensitivities as those of six coordinates in every joint."""
    rng = np.random.default_rng(1)
    nominal = arm()
    offsets = rng.normal(scale=0.1, size=(3, 6))
    joints = (replace(joint, offset=tuple(row)) for joint, row in zip(nominal.joints, offsets.tolist(), strict=True))
    robot = replace(nominal, joints=tuple(joints))
    q = rng.uniform(-1.0, 1.0, (5, 3))
    of_frame = {"tcp": ("link3", matrix_of(robot.frames[0].placement))}
    model = trial(robot, 0, 5).model
    readings = np.zeros((5, len(model.chain.stations), 6))
    for k in range(3):
        readings[:, k + 1, 2 if robot.joints[k].type == "prismatic" else 5] = q[:, k]
    assert model.chain.tools == chain_of(robot, of_frame).tools
    rows = Rows(readings, np.zeros(5, dtype=np.int64), {}, np.zeros((5, 5)), None)
    state = replace(model, bases={0: np.eye(4)}).at(model.nominal, rows)
    kernel = eomgen.build(robot, kernels=("kinematics",))
    pose = np.asarray(kernel.frame_pose(q, "tcp"))
    tool = model.chain.tools["tcp"]
    np.testing.assert_allclose(state.located.R[tool], pose[:, :3, :3], atol=1e-14)
    np.testing.assert_allclose(state.located.p[tool], pose[:, :3, 3], atol=1e-14)
    names, slopes = offset_sensitivity(robot, q, "tcp", parameters=dict(kernel.parameters))
    own = {parameter.name: i for i, parameter in enumerate(model.parameters)}
    S = state.sensitivities(tool)[:, :, [own[name] for name in names]]
    np.testing.assert_allclose(S, slopes, atol=1e-13)


def test_sensitivities_are_derivatives() -> None:
    """Of base, frame, offsets, compliances and drives, by finite differences; deflections are those of the load."""
    robot = arm()
    load = {f"tcp.{part}": np.linspace(-50.0, 80.0, 6) for part in ("fx", "fy", "fz", "mz")}
    more = [
        ErrorParameter("joints.joint2.alpha.stiffness", COMPLIANCE, 2, 3, "force", 1e-8, 1e-8),
        ErrorParameter("joints.joint1.gain", DRIVE, 1, 5, "gain", 0.0, 1e-3),
        ErrorParameter("joints.joint1.eccentricity.cos", DRIVE, 1, 5, "cos", 0.0, 1e-3),
        ErrorParameter("joints.joint2.coupling.joint1", DRIVE, 2, 5, "coupling", 0.0, 1e-3, 1),
    ]
    made = trial(robot, 3, 6, more=more, columns=load, noise=(0.0, 0.0))
    tool = made.model.chain.tools["tcp"]
    there = made.model.at(made.truth, made.rows)
    back = there.located.R[tool].transpose(0, 2, 1)

    def pose(x: Array) -> Array:
        at = made.model.at(x, made.rows).located
        return np.hstack([at.p[tool], vectors_of(at.R[tool] @ back)])

    steps = [1e-11 if parameter.kind == COMPLIANCE else 1e-6 for parameter in made.model.parameters]
    assert_slopes(there.sensitivities(tool), pose, made.truth, steps, 1e-5, 1e-9)


def test_forces_are_those_of_a_kernel() -> None:
    """Gravity and a wrench in every coordinate of joints with six of them, as the kernel has them."""
    robot = arm().with_coordinates({"joint2": {name: Coordinate() for name in COORDINATES}})
    kernel = eomgen.build(robot, kernels=("generalized_force", "kinematics"))
    q = np.random.default_rng(5).uniform(-0.5, 0.5, kernel.n)
    stations = chain_of(robot, {"tcp": ("link3", matrix_of(robot.frames[0].placement))})
    values = np.zeros((1, len(stations.stations), 6))
    place = {station.name: k for k, station in enumerate(stations.stations)}
    where = [(place[name.split(".")[0]], COORDINATES.index(name.split(".")[1])) for name in kernel.coordinates]
    for (k, c), value in zip(where, q, strict=True):
        values[0, k, c] = value
    wrench = np.array([[3.0, -5.0, 7.0, 0.5, 0.2, -0.4]])
    at = located(stations, values, np.eye(4)[np.newaxis])
    found = forces_on(stations, at, np.array(robot.gravity), {stations.tools["tcp"]: wrench})
    expected = kernel.generalized_force(q, np.zeros(kernel.n)) + kernel.frame_jacobian(q, "tcp").T @ wrench[0]
    np.testing.assert_allclose([found[0, k, c] for k, c in where], expected, atol=1e-12)


# Ranks


@pytest.mark.parametrize("special", [False, True])
@pytest.mark.parametrize("kinds", ["R", "RR", "RPR", "PRR", "RRRRRR", "PPRRRP"])
def test_ranks_are_those_of_the_count(kinds: str, special: bool) -> None:
    """4 R + 2 P + 6 of poses, and less of positions, distances from a point and distances between positions.

    Beside it the rank of finite differences of the predictions.
    """
    robot = chain(len(kinds) + 7 * special, kinds, special)
    made = trial(robot, 2, 120, noise=(0.0, 0.0))
    tool = made.model.chain.tools["tcp"]
    state = made.model.at(made.model.nominal, made.rows)
    S = state.sensitivities(tool)
    count = 4 * kinds.count("R") + 2 * kinds.count("P") + 6
    assert algebraic_rank(S.reshape(-1, S.shape[-1])) == count
    columns = []
    for i in range(S.shape[-1]):
        step = np.eye(S.shape[-1])[i] * 1e-5
        ahead, behind = (made.model.at(made.model.nominal + x, made.rows).located for x in (step, -step))
        parts = [(ahead.p[tool] - behind.p[tool]).ravel(), (ahead.R[tool] - behind.R[tool]).ravel()]
        columns.append(np.concatenate(parts) / 2e-5)
    values = np.linalg.svd(np.array(columns), compute_uv=False)
    assert np.count_nonzero(values > 1e-7 * values[0]) == count


@pytest.mark.parametrize(("measured", "fewer"), [("pose", 0), ("position", 3), ("distance", 6), ("travel", 9)])
def test_ranks_of_what_is_measured(measured: str, fewer: int) -> None:
    made = trial(chain(3, "RRRRRR"), 2, 80, noise=(1e-6, 1e-6))
    position = np.stack([made.columns[name] for name in TCP[:3]], axis=1)
    columns = {name: values for name, values in made.columns.items() if name.endswith("gamma")}
    if measured in ("pose", "position"):
        columns |= {name: made.columns[name] for name in TCP[: 6 if measured == "pose" else 3]}
    elif measured == "distance":
        columns["tcp.distance"] = np.linalg.norm(position, axis=1)
    else:
        columns["tcp.travel"] = np.concatenate([[0.0], np.linalg.norm(np.diff(position, axis=0), axis=1)])
    found = calibrated(made.robot, columns)
    assert found.rank == 30 - fewer
    assert len(found.names) - len(found.merged) == found.rank


def test_a_point_on_the_last_axis_shows_two_less() -> None:
    robot = chain(3, "RRRRRR")
    (frame,) = robot.frames
    robot = replace(robot, frames=(replace(frame, placement=replace(frame.placement, xyz=(0.0, 0.0, 0.1))),))
    found = calibrate(robot, trial(robot, 2, 80, size=0.0, noise=(1e-9, 1e-9)).poses("rx", "ry", "rz"), folds=0)
    assert found.rank == 25
