"""Calibration: the error model against kernels, ranks by counting, truth recovered, traps by name, files."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.analysis.sensitivity import offset_sensitivity
from eomgen.cli import entry as cli
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.identification import CalibrationResult, MeasuredPoses, calibrate, load_calibration, poses_from_columns
from eomgen.identification.calibration.as_toml import FittedParameters, write_toml
from eomgen.identification.geometry.error_model import (
    COMPLIANCE,
    DRIVE,
    ErrorModel,
    ErrorParameter,
    Rows,
    model_parameters,
    rows_of,
)
from eomgen.identification.geometry.loop_constraints import closed_readings, closing_of
from eomgen.identification.geometry.rotations import from_rpy, pose_from
from eomgen.identification.geometry.solve import algebraic_rank
from eomgen.identification.geometry.stations import chain_of, forces_on, located, matrix_of
from eomgen.motion.turns import rotation_of
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Motor, Robot
from eomgen.runtime.inverse_kinematics.rotations import rpy_of, vector_of
from tests.support.measured_poses import Trial, chain, trial
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
DRIVES = {"gain", "eccentricity", "backlash", "coupling"}
TCP = [f"tcp.{part}" for part in ("x", "y", "z", "rx", "ry", "rz")]


@cache
def arm() -> Robot:
    """Two joints that turn and one that slides, with axes that are parallel and that meet."""
    return chain(4, "RRP", special=True)


@cache
def puma() -> Trial:
    return trial(eomgen.load_robot("puma560"), 0, 100)


# The error model


def test_stations_are_where_kernels_have_frames() -> None:
    """With offsets in all coordinates, and sensitivities as those of six coordinates in every joint."""
    rng = np.random.default_rng(1)
    nominal = arm()
    offsets = rng.normal(scale=0.1, size=(3, 6))
    robot = replace(
        nominal,
        joints=tuple(
            replace(joint, offset=tuple(map(float, row))) for joint, row in zip(nominal.joints, offsets, strict=True)
        ),
    )
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
    S = made.model.at(made.truth, made.rows).sensitivities(tool)
    for i in range(len(made.truth)):
        step = np.zeros(len(made.truth))
        step[i] = 1e-6 * (1.0 if made.model.parameters[i].kind != COMPLIANCE else 1e-5)
        ahead, behind = (made.model.at(made.truth + sign * step, made.rows).located for sign in (1.0, -1.0))
        slope = (ahead.p[tool] - behind.p[tool]) / (2.0 * step[i])
        turn = np.array([vector_of(a @ b.T) for a, b in zip(ahead.R[tool], behind.R[tool], strict=True)])
        whole = np.hstack([slope, turn / (2.0 * step[i])])
        np.testing.assert_allclose(S[:, :, i], whole, rtol=1e-5, atol=1e-5 * np.abs(whole).max() + 1e-9)


def test_forces_are_those_of_a_kernel() -> None:
    """Gravity and a wrench in every coordinate of joints with six of them, as the kernel has them."""
    names = ("x", "y", "z", "alpha", "beta", "gamma")
    robot = arm().with_coordinates({"joint2": {name: Coordinate() for name in names}})
    kernel = eomgen.build(robot, kernels=("generalized_force", "kinematics"))
    q = np.random.default_rng(5).uniform(-0.5, 0.5, kernel.n)
    stations = chain_of(robot, {"tcp": ("link3", matrix_of(robot.frames[0].placement))})
    values = np.zeros((1, len(stations.stations), 6))
    place = {station.name: k for k, station in enumerate(stations.stations)}
    where = [(place[name.split(".")[0]], names.index(name.split(".")[1])) for name in kernel.coordinates]
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
    poses = poses_from_columns(columns, build_model(made.robot).coordinates, ["tcp"])
    found = calibrate(made.robot, poses, folds=0)
    assert found.rank == 30 - fewer
    assert len(found.names) - len(found.merged) == found.rank


def test_a_point_on_the_last_axis_shows_two_less() -> None:
    robot = chain(3, "RRRRRR")
    robot = replace(
        robot, frames=(replace(robot.frames[0], placement=replace(robot.frames[0].placement, xyz=(0.0, 0.0, 0.1))),)
    )
    found = calibrate(robot, trial(robot, 2, 80, size=0.0, noise=(1e-9, 1e-9)).poses("rx", "ry", "rz"), folds=0)
    assert found.rank == 25


# Fits


def test_the_truth_is_recovered() -> None:
    """Of poses without noise what the truth predicts elsewhere, and its own values after the fit's gauge."""
    made = trial(chain(11, "RRPRRR"), 5, 60, noise=(0.0, 0.0))
    found = calibrate(made.robot, made.poses(), folds=0)
    assert found.residuals["full"]["fitted"]["position"] < 1e-12
    others = trial(chain(11, "RRPRRR"), 6, 20, noise=(0.0, 0.0))
    q = np.stack([others.columns[name] for name in build_model(made.robot).coordinates], axis=1)
    predicted, covariance = found.predict(q, "tcp", series=0)
    state = made.model.at(made.truth, others.rows)
    tool = made.model.chain.tools["tcp"]
    np.testing.assert_allclose(predicted[:, :3, 3], state.located.p[tool], atol=1e-10)
    np.testing.assert_allclose(predicted[:, :3, :3], state.located.R[tool], atol=1e-10)
    assert covariance.shape == (20, 6, 6)
    again = calibrate(found.calibrated, made.poses(), folds=0)  # the least change from the truth is none
    moved = [name for name in again.names if ".offset." in name]
    changes = [again[name] - found[name] for name in moved]
    assert np.abs(changes).max() < 1e-9


def test_variants_and_what_was_held_out() -> None:
    found = calibrate(puma().robot, puma().poses(), folds=5)
    assert found.rank == found.rank_above_noise == 30
    rms = {name: parts["held_out"]["position"] for name, parts in found.residuals.items()}
    assert list(rms) == ["placement", "zeros", "full", "prior"]
    assert rms["placement"] > rms["zeros"] > 10.0 * rms["full"]
    assert rms["full"] < 6e-5
    assert rms["prior"] < 6e-5
    assert found.residuals["full"]["fitted"]["position"] < rms["full"]
    assert found.noise["tcp.position"] == pytest.approx(5e-5, rel=0.15)
    assert found.noise["tcp.orientation"] == pytest.approx(1e-4, rel=0.15)
    assert found.gain is not None
    assert found.gain.low < found.gain.ratio < found.gain.high
    assert found.gain.is_significant
    assert not found.is_noise_known
    text = "\n".join(found.lines())
    assert "parallel axes" in found.merged["joints.joint3.offset.z"]
    assert "gain: zeros in position" in text
    assert json.loads(json.dumps(found.as_dict()))["rank"] == 30
    assert "base" in found.merged["joints.joint1.offset.gamma"]


def test_a_gain_in_orientation_alone_counts() -> None:
    """Each variant in each kind has its verdict: here positions are too noisy to show anything."""
    made = trial(chain(2, "RRRR"), 3, 60, noise=(2e-2, 2e-4))
    found = calibrate(made.robot, made.poses(), folds=8)
    assert found.gain is not None
    assert not found.gain.is_significant
    assert {name for name, gains in found.gains.items() if gains["orientation"].is_significant} >= {"full", "prior"}
    assert not any(gains["position"].is_significant for gains in found.gains.values())
    verdict = next(line for line in found.lines() if "gain" in line)
    assert verdict.startswith("gain: ")
    assert "full in orientation" in verdict
    assert "in position" not in verdict.partition(";")[0]
    assert found.as_dict()["gains"]["full"]["orientation"]["is_significant"]


def test_gains_are_ratios_of_the_table() -> None:
    """Ratios of every variant and kind are those of the table, intervals symmetric about their logarithms."""
    made = trial(chain(2, "RRR"), 3, 30)
    found = calibrate(made.robot, made.poses(), folds="loo")
    assert {(name, kind) for name, gains in found.gains.items() for kind in gains} == {
        (name, kind) for name in ("zeros", "full", "prior") for kind in ("position", "orientation")
    }
    for name, gains in found.gains.items():
        for kind, gain in gains.items():
            ratio = found.residuals["placement"]["held_out"][kind] / found.residuals[name]["held_out"][kind]
            assert gain.ratio == pytest.approx(ratio, rel=1e-9)
            assert np.log(gain.high / gain.ratio) == pytest.approx(np.log(gain.ratio / gain.low), rel=1e-6)


def test_norms_stand_beside_rms_per_axis() -> None:
    """Of three components each, so that a norm is sqrt(3) times as much; of distances both are one."""
    made = trial(chain(3, "RRRR"), 2, 60)
    found = calibrate(made.robot, made.poses(), folds=4)
    for parts in found.residuals.values():
        for kind in ("position", "orientation"):
            for part in ("fitted", "held_out"):
                assert parts[f"{part}_norm"][kind] == pytest.approx(np.sqrt(3.0) * parts[part][kind], rel=1e-9)
    head = found.lines()[2:4]
    assert head[0].startswith("rms of residuals")
    assert head[1].split() == ["per", "axis", "norm"] * 4
    position = np.stack([made.columns[name] for name in TCP[:3]], axis=1)
    columns = {name: values for name, values in made.columns.items() if name.endswith("gamma")}
    columns["tcp.distance"] = np.linalg.norm(position, axis=1)
    poses = poses_from_columns(columns, build_model(made.robot).coordinates, ["tcp"])
    parts = calibrate(made.robot, poses, folds=0).residuals["full"]
    assert parts["fitted_norm"]["position"] == pytest.approx(parts["fitted"]["position"], rel=1e-12)


def test_what_moves_nothing_is_one_line() -> None:
    """A branch that carries nothing that was measured; its names are in the values for JSON."""
    robot = chain(4, "RRR")
    joints = [
        replace(x, name=f"{x.name}b", parent=x.parent if x.parent == "base" else f"{x.parent}b", child=f"{x.child}b")
        for x in robot.joints
    ]
    links = [replace(link, name=f"{link.name}b") for link in robot.links]
    both = replace(robot, joints=(*robot.joints, *joints), links=(*robot.links, *links))
    found = calibrate(both, trial(robot, 3, 40).poses(), folds=0)
    unseen = [name for name, why in found.merged.items() if why == "it moves nothing that was measured"]
    assert len(unseen) == 18
    lines = [line for line in found.lines() if "nothing that was measured" in line]
    assert len(lines) == 1
    assert lines[0].startswith("18 parameters")
    assert not any(name in line for name in unseen for line in found.lines())
    assert set(unseen) <= set(found.as_dict()["merged"])


def test_no_gain_is_said() -> None:
    made = trial(arm(), 3, 40, size=0.0)
    found = calibrate(made.robot, made.poses(), folds=8)
    assert found.gain is not None
    assert not found.gain.is_significant
    assert any(line.startswith("no significant gain") for line in found.lines())
    assert found.residuals["prior"]["held_out"]["position"] <= found.residuals["full"]["held_out"]["position"]


def test_known_noise_and_lack_of_fit() -> None:
    poses = trial(arm(), 3, 60).poses()
    found = calibrate(arm(), poses, noise=(5e-5, 1e-4), folds=0)
    assert found.is_noise_known
    assert found.chi2 == pytest.approx(1.0, abs=0.25)
    assert not any("lack of fit" in note for note in found.notes)
    low = calibrate(arm(), poses, noise=(2e-5, 4e-5), folds=0)
    assert any(note.startswith("lack of fit") for note in low.notes)
    whole = calibrate(arm(), poses, covariance={"tcp": np.diag([5e-5] * 3 + [1e-4] * 3) ** 2}, folds=0)
    np.testing.assert_allclose(whole.values, found.values, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(whole.deviations, found.deviations, rtol=1e-6, atol=1e-12)
    columns = trial(arm(), 3, 60).columns | {
        f"tcp.sigma.{part[4:]}": np.full(60, 5e-5 if part[4] != "r" else 1e-4) for part in TCP
    }
    by_column = calibrate(arm(), poses_from_columns(columns, build_model(arm()).coordinates, ["tcp"]), folds=0)
    np.testing.assert_allclose(by_column.deviations, found.deviations, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
def test_outliers_are_down_weighted(loss: str) -> None:
    made = trial(arm(), 7, 60)
    columns = {name: values.copy() for name, values in made.columns.items()}
    for row in (5, 30, 31):
        columns["tcp.x"][row] += 0.02
    poses = poses_from_columns(columns, build_model(arm()).coordinates, ["tcp"])
    plain, robust = (calibrate(arm(), poses, folds=0, loss=given) for given in (None, loss))
    clean = calibrate(arm(), made.poses(), folds=0)
    assert {row for row, _ in robust.mistrusted} >= {5, 30, 31}
    q = np.stack([made.columns[name] for name in build_model(arm()).coordinates], axis=1)
    truth = clean.predict(q, "tcp")[0][:, :3, 3]
    off = [np.abs(found.predict(q, "tcp")[0][:, :3, 3] - truth).max() for found in (plain, robust)]
    assert off[1] < 0.2 * off[0]


def test_attached_frames_series_and_rows_without_them() -> None:
    """Two frames that the description does not have, two places of the device, empty cells."""
    robot = chain(8, "RRRRR")
    places = {
        name: pose_from(np.array(x))
        for name, x in {"ball": (0.1, -0.2, 0.3, 0.5, 1.0, -2.0), "probe": (-0.1, 0.0, 0.2, 2.0, 0.1, 1.0)}.items()
    }
    frames = {name: ("link5", pose) for name, pose in places.items()}
    made = trial(robot, 3, 90, frames=frames)
    columns = {name: values.copy() for name, values in made.columns.items()}
    second = np.arange(90) >= 50
    away = pose_from(np.array([-3.0, 1.0, 0.2, 2.0, -0.5, 0.7]))
    for name in frames:
        p = np.stack([columns[f"{name}.{axis}"] for axis in "xyz"], axis=1)
        R = rotation_of(np.stack([columns[f"{name}.r{axis}"] for axis in "xyz"], axis=1))
        p = np.where(second[:, np.newaxis], p @ away[:3, :3].T + away[:3, 3], p)
        R = np.where(second[:, np.newaxis, np.newaxis], away[:3, :3] @ R, R)
        columns |= {f"{name}.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
        columns |= {f"{name}.r{axis}": np.array([vector_of(x) for x in R])[:, i] for i, axis in enumerate("xyz")}
    for part in ("x", "y", "z", "rx", "ry", "rz"):
        columns[f"probe.{part}"][::3] = np.nan
        columns[f"ball.{part}"][1::3] = np.nan
    columns["series"] = np.where(second, 7.0, 3.0)
    poses = poses_from_columns(columns, build_model(robot).coordinates, ["ball", "probe"])
    found = calibrate(robot, poses, frames={"ball": "link5", "probe": "link5"}, folds=0)
    assert found.rank == 4 * 5 + 6 + 6 + 6
    assert found.residuals["full"]["fitted"]["position"] < 6e-5
    assert found["series.7.base.x"] != found["series.3.base.x"]
    assert found["frames.ball.z"] == pytest.approx(0.3, abs=0.05)


def test_stiffness_shows_under_loads() -> None:
    """Of a deviation and of a joint, with its deviation; a load along one axis shows less."""
    robot = arm().with_coordinates({"joint2": {"alpha": Coordinate(stiffness=5e4)}})
    rng = np.random.default_rng(0)
    loads = {f"tcp.{part}": rng.uniform(-200.0, 200.0, 80) for part in ("fx", "fy", "fz")}
    more = [
        ErrorParameter("joints.joint2.alpha.stiffness", COMPLIANCE, 2, 3, "force", 2e-5, 1e-5),
        ErrorParameter("joints.joint1.gamma.stiffness", COMPLIANCE, 1, 5, "force", 0.0, 4e-5),
    ]
    made = trial(robot, 1, 80, more=more, columns=loads, noise=(1e-5, 2e-5))
    found = calibrate(robot, made.poses(), stiffness=["joint1.gamma"], folds=0)
    for name, value in (("joints.joint2.alpha.stiffness", 1.0 / 3e-5), ("joints.joint1.gamma.stiffness", 1.0 / 4e-5)):
        deviation = float(found.deviations[found.names.index(name)])
        assert abs(found[name] - value) < 4.0 * deviation < 0.1 * value
    alpha = found.calibrated.joint("joint2").coordinates["alpha"]
    assert alpha.stiffness == found["joints.joint2.alpha.stiffness"]
    drive = found.calibrated.joint("joint1").coordinates["gamma"]
    assert drive.stiffness is None, "what yields behind a drive is no spring that pulls the joint to zero"
    still = replace(robot, gravity=(0.0, 0.0, 0.0))
    without = {name: values for name, values in made.columns.items() if name[:5] != "tcp.f"}
    poses = poses_from_columns(without, build_model(robot).coordinates, ["tcp"])
    assert "no load" in calibrate(still, poses, folds=0).merged["joints.joint2.alpha.stiffness"]


def test_terms_of_drives_are_taken_up_if_they_show() -> None:
    robot = chain(8, "RRR")
    more = [
        ErrorParameter("joints.joint2.gain", DRIVE, 2, 5, "gain", 0.0, 2e-3),
        ErrorParameter("joints.joint3.eccentricity.sin", DRIVE, 3, 5, "sin", 0.0, 1e-3),
        ErrorParameter("joints.joint1.backlash", DRIVE, 1, 5, "backlash", 0.0, 5e-4),
    ]
    made = trial(robot, 1, 100, more=more)
    found = calibrate(robot, made.poses(), drives=True, folds=0)
    drives = {name for name in found.names if set(name.split(".")) & DRIVES}
    wanted = {parameter.name for parameter in more}
    assert drives == wanted | {"joints.joint3.eccentricity.cos"}
    for parameter in more:
        deviation = found.deviations[found.names.index(parameter.name)]
        assert abs(found[parameter.name] - parameter.size) < 4.0 * deviation
    none = calibrate(robot, trial(robot, 1, 100).poses(), drives=True, folds=0)
    assert not any(set(name.split(".")) & DRIVES for name in none.names)


def test_drift_with_warmth() -> None:
    """Of a zero, by a column of temperatures."""
    robot = chain(8, "RRR")
    more = [ErrorParameter("joints.joint2.temperature.gamma", DRIVE, 2, 5, "temperature", 0.0, 5e-5)]
    made = trial(robot, 1, 100, more=more, columns={"temperature": np.linspace(20.0, 45.0, 100)})
    found = calibrate(robot, made.poses(), drives=True, folds=0)
    name = next(name for name in found.names if ".temperature." in name)
    assert name == more[0].name
    assert found[name] == pytest.approx(5e-5, rel=0.05)
    assert found.units[found.names.index(name)] == "rad/K"


def test_transmissions_give_way_behind_motors() -> None:
    """The angle of a motor's shaft over its ratio is the joint's, but for the wind-up of the transmission."""
    spring = Motor(1e-4, 80.0, Coordinate(stiffness=2e4, damping=1.0))
    nominal = chain(8, "RRR")
    robot = replace(nominal, joints=(nominal.joints[0], replace(nominal.joints[1], motor=spring), nominal.joints[2]))
    rng = np.random.default_rng(0)
    loads = {f"tcp.{part}": rng.uniform(-200.0, 200.0, 80) for part in ("fx", "fy", "fz")}
    more = [ErrorParameter("joints.joint2.motor.stiffness", COMPLIANCE, 2, 5, "force", 5e-5, 2e-5)]
    made = trial(nominal, 1, 80, more=more, columns=loads)
    columns = {name: values for name, values in made.columns.items() if name != "joint2.gamma"}
    columns["joint2.motor"] = 80.0 * made.columns["joint2.gamma"]
    poses = poses_from_columns(columns, build_model(robot).coordinates, ["tcp"])
    found = calibrate(robot, poses, folds=0)
    name = "joints.joint2.motor.stiffness"
    assert found[name] == pytest.approx(1.0 / 7e-5, rel=0.05)
    assert found.described[found.names.index(name)] == pytest.approx(2e4)
    motor = found.calibrated.joint("joint2").motor
    assert motor is not None
    assert motor.transmission.stiffness == found[name]
    both = columns | {"joint2.gamma": made.columns["joint2.gamma"]}
    poses = poses_from_columns(both, build_model(robot).coordinates, ["tcp"])
    with pytest.raises(InputError, match=r"joint2\.motor and its joint's coordinate are both there"):
        calibrate(robot, poses, folds=0)


def test_joints_that_move_nothing_measured_are_not_read() -> None:
    """Of a robot with a second arm: its column may be missing, its offsets are named; others may not."""
    robot = arm()
    other = replace(robot.joints[0], name="other", child="hand")
    whole = replace(robot, links=(*robot.links, replace(robot.links[0], name="hand")), joints=(*robot.joints, other))
    made = trial(arm(), 3, 40)
    names = build_model(whole).coordinates
    found = calibrate(whole, poses_from_columns(made.columns, names, ["tcp"]), folds=0)
    assert found.merged["joints.other.offset.gamma"] == "it moves nothing that was measured"
    alone = calibrate(arm(), made.poses(), folds=0)
    assert found.rank == alone.rank
    ours, theirs = found.predict(np.zeros(4), "tcp", series=0)[0], alone.predict(np.zeros(3), "tcp", series=0)[0]
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    part = {name: values for name, values in made.columns.items() if name != "joint2.gamma"}
    with pytest.raises(InputError, match=r"the column joint2.gamma is missing; allowed: all joints that move what was"):
        calibrate(whole, poses_from_columns(part, names, ["tcp"]), folds=0)


def test_what_is_fixed_stays() -> None:
    found = calibrate(arm(), trial(arm(), 3, 60).poses(), fixed=["frames.tcp", "joints.joint1.offset.x"], folds=0)
    assert not any(name.startswith("frames.") for name in found.names)
    assert "joints.joint1.offset.x" not in found.names
    with pytest.raises(UnknownNameError, match=r"there is no parameter .joints\.joint9"):
        calibrate(arm(), trial(arm(), 3, 60).poses(), fixed=["joints.joint9"], folds=0)


def test_points_measured_at_once_count_less() -> None:
    """Errors that four points at a pose have in common make deviations larger."""
    robot, rng = chain(8, "RRRR"), np.random.default_rng(3)
    made = trial(robot, 1, 40, noise=(1e-5, 1e-5))
    columns = {name: np.repeat(values, 4) for name, values in made.columns.items() if name[5:6] != "r"}
    columns = {name: values for name, values in columns.items() if not name.startswith("tcp.r")}
    for axis in "xyz":
        columns[f"tcp.{axis}"] = columns[f"tcp.{axis}"] + np.repeat(rng.normal(scale=5e-5, size=40), 4)
        columns[f"tcp.{axis}"] += rng.normal(scale=1e-5, size=160)
    poses = poses_from_columns(columns, build_model(robot).coordinates, ["tcp"])
    found = calibrate(robot, poses, folds=0)
    assert any("points of one rigid body are not independent" in note for note in found.notes)
    named = poses_from_columns(columns | {"body": np.repeat(np.arange(40), 4)}, build_model(robot).coordinates, ["tcp"])
    assert any("(body: correlation 0.9" in note for note in calibrate(robot, named, folds=0).notes)


# Closed mechanisms


def four_bar(count: int = 25) -> tuple[ErrorModel, Rows, Array]:
    """The error model of a linkage, rows of its one drive, and values whose sizes are those expected."""
    robot = eomgen.load_robot("four_bar")
    drive = np.linspace(0.3, 6.0, count)
    columns = {"joint1.gamma": drive} | {f"tcp.{axis}": np.zeros(count) for axis in "xyz"}
    tree = build_model(robot)
    stations = chain_of(robot, {"tcp": ("coupler", matrix_of(robot.frames[0].placement))})
    rows = rows_of(
        stations, robot, poses_from_columns(columns, tree.coordinates, ["tcp"]), {"joint1.gamma": (1, 5, 1.0)}
    )
    closing = closing_of(tree, stations, [(1, 5)], "poses")
    readings = closed_readings(stations, closing, tree, rows.readings, [""] * count)
    parameters = tuple(model_parameters(robot, stations, [0], {"tcp": True}))
    model = ErrorModel(robot, stations, parameters, {0: np.eye(4)}, closing)
    values = model.nominal + model.sizes * np.random.default_rng(2).normal(size=len(parameters))
    return model, replace(rows, readings=readings), np.where(model.sizes > 0.05, 0.0, values)


def test_closed_mechanisms_are_where_kernels_close_them() -> None:
    model, rows, _ = four_bar()
    kernel = eomgen.build(model.robot)
    state = model.at(model.nominal, rows)
    q = np.array(build_model(model.robot).home)
    for k, angle in enumerate(rows.readings[:, 1, 5]):
        for share in (0.5, 1.0):
            q[0] += share * (angle - q[0])
            q = np.asarray(kernel.assemble(q, ["joint1.gamma"]))
        pose = kernel.frame_pose(q, "tcp")
        np.testing.assert_allclose(state.located.p[model.chain.tools["tcp"], k], pose[:3, 3], atol=1e-9)


def test_sensitivities_through_loops_are_derivatives() -> None:
    model, rows, values = four_bar(count=6)
    tool = model.chain.tools["tcp"]
    S = model.at(values, rows).sensitivities(tool)[:, :3]
    for i in range(len(values)):
        step = 1e-6 * np.eye(len(values))[i]
        ahead, behind = (model.at(values + x, rows).located.p[tool] for x in (step, -step))
        np.testing.assert_allclose(S[:, :, i], (ahead - behind) / 2e-6, atol=1e-6)


@pytest.mark.soak
def test_a_linkage_is_calibrated_by_its_drive_alone(tmp_path: Path) -> None:
    model, rows, values = four_bar()
    p = model.at(values, rows).located.p[model.chain.tools["tcp"]]
    columns = {"joint1.gamma": rows.readings[:, 1, 5]} | {f"tcp.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
    poses = poses_from_columns(columns, build_model(model.robot).coordinates, ["tcp"])
    found = calibrate(model.robot, poses, folds=5)
    assert found.residuals["placement"]["fitted"]["position"] > 1e-5
    assert found.residuals["full"]["fitted"]["position"] < 1e-9
    assert found.residuals["full"]["held_out"]["position"] < 1e-6
    assert "loops.joint4.offset.x" in found.names
    read = eomgen.load_robot(found.to_toml(tmp_path / "linkage.toml"))
    assert read.loops[0].offset[0] == pytest.approx(found["loops.joint4.offset.x"], abs=1e-15)
    again = load_calibration(found.save(tmp_path / "linkage.npz"))
    np.testing.assert_array_equal(again.predict([1.0, -0.5, 1.4], "tcp")[0], found.predict([1.0, -0.5, 1.4], "tcp")[0])
    with pytest.raises(InputError, match=r"the column joint1.gamma is missing; allowed: all drives"):
        calibrate(model.robot, renamed(columns, model.robot), folds=0)


def renamed(columns: dict[str, Array], robot: Robot) -> MeasuredPoses:
    """The same poses with the drive's column under another joint's name."""
    other = {name.replace("joint1", "joint2"): values for name, values in columns.items()}
    return poses_from_columns(other, build_model(robot).coordinates, ["tcp"])


# Traps


TRAPS = {
    "millimetres for metres": lambda c: {name: 1e3 * c[name] for name in TCP[:3]},
    "degrees for radians": lambda c: {f"joint{i}.gamma": np.rad2deg(c[f"joint{i}.gamma"]) for i in range(1, 7)},
    "motor angles for joint angles": lambda c: {"joint2.gamma": 107.8 * c["joint2.gamma"]},
    "joint2.gamma copies column joint1.gamma": lambda c: {"joint2.gamma": c["joint1.gamma"]},
    "tcp.y copies column tcp.x": lambda c: {"tcp.y": c["tcp.x"]},
    "poses are all alike": lambda c: {f"joint{i}.gamma": 1.0 + 1e-6 * c[f"joint{i}.gamma"] for i in range(1, 7)},
    "fewer poses than unknowns": lambda c: {name: values[:4] for name, values in c.items()},
    "column 'weight': 0; allowed: a positive number": lambda c: {"weight": np.zeros(100)},
    "there is no frame 'tpc'; did you mean 'tcp'": lambda c: {"tpc.x": c["tcp.x"]},
    "column 'series': 0.5; allowed: a whole number": lambda c: {"series": np.full(100, 0.5)},
    "column 'tcp.sigma.x': -1; allowed: a positive number": lambda c: {"tcp.sigma.x": np.full(100, -1.0)},
    "column 'joint7.gamma' is unknown": lambda c: {"joint7.gamma": c["tcp.x"]},
    "read as rpy": lambda c: dict(zip(TCP[3:], np.array([rpy_of(x) for x in turned(c)]).T, strict=True)),
    "read as rotvector, from the frame to the device": lambda c: {name: -c[name] for name in TCP[3:]},
    "read as rotvector in degrees": lambda c: {name: np.rad2deg(c[name]) for name in TCP[3:]},
}


def turned(columns: dict[str, Array]) -> Array:
    return rotation_of(np.stack([columns[name] for name in TCP[3:]], axis=1))


SLOW = {
    *("read as rotvector in degrees", "read as rotvector, from the frame to the device", "read as rpy"),
    *("joint2.gamma copies column joint1.gamma", "tcp.y copies column tcp.x", "motor angles for joint angles"),
}


@pytest.mark.parametrize("said", soaked(TRAPS, set(TRAPS) - SLOW))
def test_traps_are_told_by_name(said: str) -> None:
    columns = puma().columns | TRAPS[said](puma().columns)
    names = build_model(puma().robot).coordinates
    with pytest.raises(InputError, match=said):
        calibrate(puma().robot, poses_from_columns(columns, names, ["tcp"]), folds=0)


def test_options_are_checked(tmp_path: Path) -> None:
    poses = trial(arm(), 3, 30).poses()
    cases: list[tuple[dict[str, Any], type[Exception], str]] = [
        ({"loss": "l1"}, InputError, "loss: 'l1'; allowed: huber"),
        ({"variant": "best"}, InputError, "variant: 'best'; allowed: placement"),
        ({"folds": 1}, InputError, "folds: 1; allowed"),
        ({"noise": (0.0, 1e-4)}, ArrayError, "noise: "),
        ({"sizes": (1.0,)}, ArrayError, "sizes: "),
        ({"confidence": 1.0}, InputError, "confidence: 1.0"),
        ({"frames": {"ball": "link9"}}, UnknownNameError, "there is no link 'link9'"),
        ({"frames": {"tcp": "link1"}}, InputError, "frames: 'tcp'"),
        ({"stiffness": ["joint9.x"]}, UnknownNameError, "there is no coordinate 'joint9.x'"),
        ({"covariance": {"tcp": np.zeros((6, 6))}}, ArrayError, "not symmetric and positive definite"),
    ]
    for options, error, said in cases:
        with pytest.raises(error, match=said):
            calibrate(arm(), poses, **{"folds": 0, **options})
    with pytest.raises(InputError, match=r"ends in \.csv or \.npz"):
        calibrate(arm(), tmp_path / "poses.txt")


# Files


def write_csv(path: Path, columns: dict[str, Array]) -> None:
    rows = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(["# measured", ",".join(columns), *rows]) + "\n")


def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Text, JSON, TOML, URDF and a result that loads again."""
    monkeypatch.chdir(tmp_path)
    columns = {name: values.copy() for name, values in puma().columns.items()}
    for name in TCP:
        columns[name][7] = np.nan
    write_csv(Path("poses.csv"), columns)
    words = ["calibrate", "puma560", "poses.csv", "--folds", "0"]
    files = ["--toml", "better.toml", "--urdf", "better.urdf", "-o", "found.npz"]
    assert cli.main([*words, *files, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["files"] == ["better.toml", "better.urdf", "found.npz"]
    assert said["rank"] == 30
    found = load_calibration("found.npz")
    assert found.as_dict() == {key: value for key, value in said.items() if key != "files"}
    q = np.stack([puma().columns[f"joint{i}.gamma"] for i in range(1, 7)], axis=1)[:9]
    predicted = found.predict(q, "tcp")[0]
    for name in ("better.toml", "better.urdf"):
        robot = eomgen.load_robot(name)
        stations = chain_of(robot, {"tcp": frame_of(robot)})
        values = np.zeros((9, len(stations.stations), 6))
        for i, station in enumerate(stations.stations):
            if station.joint is not None and station.offset is not None:
                values[:, i] = station.offset
                values[:, i, 5] += q[:, int(station.name[-1]) - 1]
        at = located(stations, values, np.tile(np.eye(4), (9, 1, 1)))
        np.testing.assert_allclose(at.p[stations.tools["tcp"]], predicted[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(at.R[stations.tools["tcp"]], predicted[:, :3, :3], atol=1e-12)
    text = Path("better.toml").read_text()
    assert "# +- " in text
    assert "with the sign of the coordinate" in text
    assert cli.main([*words, "-o", "figure.svg"]) == 0
    assert "joints.joint2.offset.gamma" in capsys.readouterr().out
    assert "<svg" in Path("figure.svg").read_text()
    assert cli.main([*words, "--attach", "tcp"]) == 1
    assert "attach: 'tcp'; allowed: F=LINK" in capsys.readouterr().err


def frame_of(robot: Robot) -> tuple[str, Array]:
    """Link and pose of the tool: a frame of TOML, a link of a URDF."""
    for frame in robot.frames:
        return frame.link, matrix_of(frame.placement)
    return "tcp", np.eye(4)


def test_an_urdf_gets_its_origins(tmp_path: Path) -> None:
    """Of joints with any axis, prismatic ones among them: a file that is read, changed and read again."""
    source = tmp_path / "arm.urdf"
    source.write_text(
        '<robot name="arm"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0.1 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        '<joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0.1"/>'
        '<axis xyz="1 0 1"/><limit lower="-0.3" upper="0.3" effort="1" velocity="1"/></joint>'
        '<joint name="j3" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0 0.2 0" rpy="0 1 0"/>'
        '<axis xyz="1 0 0"/></joint></robot>'
    )
    robot = eomgen.load_robot(source)
    made = trial(robot, 1, 50, frames={"c": ("c", np.eye(4))})
    found = calibrate(robot, made.poses(), folds=0)
    q = np.stack([made.columns[name] for name in build_model(robot).coordinates], axis=1)
    wanted = found.predict(q, "c")[0]
    for path in (found.to_urdf(tmp_path / "out" / "new.urdf"), found.to_toml(tmp_path / "out" / "new.toml")):
        other = eomgen.load_robot(path)
        kernel = eomgen.build(other, kernels=("kinematics",))
        np.testing.assert_allclose(kernel.frame_pose(q, "c_calibrated"), wanted, atol=1e-12)


RAIL = """name = "rail"
[[links]]
name = "slide"
mass = 1.0
[[joints]]
name = "rail"
parent = "base"
child = "slide"
type = "prismatic"
dh = { a = 0.2, alpha_deg = 90.0 }
[[frames]]
name = "tcp"
link = "slide"
placement = { xyz = [0.0, 0.0, 0.1], rpy_deg = [0.0, 45.0, 0.0] }
"""


@pytest.mark.parametrize("unit", ["_deg", ""])
def test_angles_are_written_in_the_unit_of_the_file(tmp_path: Path, unit: str) -> None:
    """Degrees stay degrees and radians radians, and both say the same robot to the last digits."""
    source = tmp_path / "rail.toml"
    text = RAIL if unit else RAIL.replace("alpha_deg = 90.0", "alpha = 1.5707963267948966").replace("rpy_deg", "rpy")
    source.write_text(text, encoding="utf-8")
    robot = eomgen.load_robot(source)
    values = {"joints.rail.axis.alpha": 0.02, "joints.rail.axis.beta": -0.01}
    values |= {f"frames.tcp.{kind}": 0.1 * i for i, kind in enumerate(COORDINATES)}
    stations = chain_of(robot, {"tcp": frame_of(robot)})
    found = FittedParameters(
        robot, stations, {"tcp": "slide"}, values, dict.fromkeys(values, 1e-4), dict.fromkeys(values, "rad")
    )
    path = write_toml(found, tmp_path / "new.toml")
    lines = [line.split("#")[0] for line in path.read_text().splitlines() if line.startswith("placement")]
    assert len(lines) == 2
    assert all(f"rpy{unit} = " in line for line in lines)
    again = eomgen.load_robot(path)
    for new, old in ((again.joints[0], found.calibrated.joints[0]), (again.frames[0], found.calibrated.frames[0])):
        np.testing.assert_allclose(matrix_of(new.placement), matrix_of(old.placement), atol=1e-14)
    assert not np.allclose(matrix_of(again.joints[0].placement), matrix_of(robot.joints[0].placement), atol=1e-3)


def test_a_file_to_begin_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "puma560", "--poses"]) == 0
    text = Path("puma560_poses.csv").read_text()
    header = next(line for line in text.splitlines() if not line.startswith("#"))
    assert header.split(",") == [*(f"joint{i}.gamma" for i in range(1, 7)), *TCP]
    assert cli.main(["calibrate", "puma560", "puma560_poses.csv"]) == 1
    assert "has no values; allowed: a header" in capsys.readouterr().err
    assert cli.main(["new", "nothing", "--poses"]) == 1
    assert "there is no robot 'nothing'" in capsys.readouterr().err


def test_damaged_results_are_refused(tmp_path: Path) -> None:
    made = trial(arm(), 3, 40)
    found = calibrate(arm(), made.poses(), folds=0)
    path = found.save(tmp_path / "found.npz")
    assert isinstance(load_calibration(path), CalibrationResult)
    arrays = dict(np.load(path))
    for key, value in (("meta", np.array("{}")), ("x", np.zeros(3)), ("covariance", np.full((3, 3), np.nan))):
        np.savez(path, **{**arrays, key: value})
        with pytest.raises(InputError):
            load_calibration(path)


def test_results_of_before_load(tmp_path: Path) -> None:
    """Files with the gain of the full fit alone, and without norms."""
    found = calibrate(arm(), trial(arm(), 3, 40).poses(), folds=4)
    arrays = dict(np.load(found.save(tmp_path / "found.npz")))
    meta = json.loads(str(arrays["meta"]))
    meta["gain"] = meta.pop("gains")["full"]["position"]
    meta["residuals"] = {
        name: {part: parts[part] for part in ("fitted", "held_out")} for name, parts in meta["residuals"].items()
    }
    np.savez(tmp_path / "before.npz", **{**arrays, "meta": np.array(json.dumps(meta))})
    read = load_calibration(tmp_path / "before.npz")
    assert read.gain == found.gain
    assert read.lines()


def test_readings_of_orientations() -> None:
    """Roll, pitch and yaw, quaternions, and rotation vectors say the same."""
    made = trial(arm(), 3, 40)
    R = turned(made.columns)
    angles = np.array([rpy_of(x) for x in R])
    np.testing.assert_allclose(from_rpy(angles), R, atol=1e-12)
    vectors = np.array([vector_of(x) for x in R])
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    quaternion = np.hstack([np.cos(half), np.sin(half) * vectors / (2.0 * half)])
    plain = {name: values for name, values in made.columns.items() if name not in TCP[3:]}
    names = build_model(arm()).coordinates
    wanted = calibrate(arm(), made.poses(), folds=0)
    for rotation, columns in (
        ("rpy", dict(zip(TCP[3:], angles.T, strict=True))),
        ("quaternion", dict(zip(("tcp.qw", "tcp.qx", "tcp.qy", "tcp.qz"), quaternion.T, strict=True))),
    ):
        poses = poses_from_columns(plain | columns, names, ["tcp"], rotation=rotation)
        np.testing.assert_allclose(calibrate(arm(), poses, folds=0).values, wanted.values, atol=1e-8)
