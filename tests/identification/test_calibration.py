"""Calibration: truth recovered, variants, noise and its covariances, loads, stiffness, drives."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.identification import calibrate, load_calibration, read_covariances
from eomgen.identification.calibration.solve import problem_of
from eomgen.identification.calibration.variants import variants_of
from eomgen.identification.geometry.error_model import COMPLIANCE, DRIVE, ErrorParameter
from eomgen.identification.geometry.observations import observations_of
from eomgen.identification.geometry.rotations import pose_from
from eomgen.motion.turns import rotation_of
from eomgen.progress import no_report
from eomgen.robot.value import Coordinate, Motor, Robot
from tests.support.commands import command
from tests.support.measured_poses import TCP, Trial, arm, chain, puma, trial
from tests.support.measurements import calibrated, placed, poses_of, task_of
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]
DRIVES = {"gain", "eccentricity", "backlash", "coupling"}


def test_the_truth_is_recovered() -> None:
    """Of poses without noise what the truth predicts elsewhere, and its own values after the fit's gauge."""
    made = trial(chain(11, "RRPRRR"), 5, 60, noise=(0.0, 0.0))
    found = calibrate(made.robot, made.poses(), folds=0)
    assert found.residuals["full"]["fitted"]["position"] < 1e-12
    others = trial(chain(11, "RRPRRR"), 6, 20, noise=(0.0, 0.0))
    predicted, covariance = found.predict(others.poses().q, "tcp", series=0)
    state = made.model.at(made.truth, others.rows)
    tool = made.model.chain.tools["tcp"]
    np.testing.assert_allclose(predicted[:, :3, 3], state.located.p[tool], atol=1e-10)
    np.testing.assert_allclose(predicted[:, :3, :3], state.located.R[tool], atol=1e-10)
    assert covariance.shape == (20, 6, 6)
    again = calibrate(found.calibrated, made.poses(), folds=0)  # the least change from the truth is none
    assert np.abs([again[name] - found[name] for name in again.names if ".offset." in name]).max() < 1e-9


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
    assert found.gain.low < found.gain.ratio < found.gain.high
    assert found.gain.is_significant
    assert not found.is_noise_known
    text = "\n".join(found.lines())
    assert "parallel axes" in found.merged["joints.joint3.offset.z"]
    assert "gain: zeros in position" in text
    assert json.loads(json.dumps(found.as_dict()))["rank"] == 30
    assert "base" in found.merged["joints.joint1.offset.gamma"]


@pytest.mark.parametrize(
    ("loss", "is_distance"),
    [(None, False), (None, True), ("huber", True), pytest.param("huber", False, marks=pytest.mark.soak)],
)
def test_numbers_that_are_held_out_change_no_prediction(loss: str | None, is_distance: bool) -> None:
    """Neither values nor noise, weights or the prior of a fold depend on what was measured in it."""
    made = trial(chain(3, "RRR"), 2, 21, noise=(1e-3, 1e-3))
    columns = {name: x for name, x in made.columns.items() if ".r" not in name}
    if is_distance:
        columns |= {"tcp.distance": np.linalg.norm([columns[name] for name in TCP[:3]], axis=0)}
        columns = {name: x for name, x in columns.items() if name not in TCP}
    stiffness = () if is_distance else ("joint1.gamma", "joint2.gamma")
    poses = poses_of(made.robot, columns)
    problem, start = problem_of(task_of(made.robot, stiffness=stiffness), poses, careful=False)
    units = np.arange(21)
    predicted = []
    for size in (0.0, 0.3):
        (block,) = problem.seen.blocks
        values = block.values.copy()
        values[:7] += size * np.random.default_rng(0).normal(size=values[:7].shape)
        seen = replace(problem.seen, blocks=(replace(block, values=values),))
        variants = variants_of(replace(problem, seen=seen), start, loss, units, 3, 0.95, no_report)
        inside = problem.seen.row < 7
        predicted.append({name: values.ravel()[inside] - x[inside] for name, x in variants.held_out.items()})
    assert list(predicted[0]) == ["placement", "zeros", "full", "prior"]
    for name, before in predicted[0].items():
        np.testing.assert_allclose(predicted[1][name], before, rtol=0.0, atol=1e-12, err_msg=name)


def test_held_out_residuals_grow_by_what_was_fitted() -> None:
    """Of pure noise, with stiffness: by 1 / (1 - unknowns / numbers) where each pose is held out alone."""
    made = trial(chain(2, "RRR"), 3, 16, noise=(1e-3, 1e-3))
    names = [f"joint{i}.gamma" for i in (1, 2, 3)]
    found = calibrate(made.robot, made.poses("rx", "ry", "rz"), stiffness=names, folds="loo")
    rms = found.residuals["full"]
    expected = 1.0 / (1.0 - found.rank / (3 * 16))
    assert rms["held_out"]["position"] / rms["fitted"]["position"] == pytest.approx(expected, rel=0.1)


def series_of(counts: Sequence[int]) -> tuple[Robot, dict[str, Array]]:
    """Positions of a robot that other devices look at, one after the other, each as many times."""
    made = trial(chain(3, "RRR"), 4, sum(counts), noise=(1e-3, 1e-3))
    columns = {name: x.copy() for name, x in made.columns.items() if ".r" not in name}
    columns["series"] = np.repeat(np.arange(len(counts)), counts).astype(float)
    for k in range(len(counts)):
        away, inside = pose_from(np.array([k, 1.0, -k, 0.3 * k, 1.0, k])), columns["series"] == k
        p = np.stack([columns[name][inside] for name in TCP[:3]]) - away[:3, 3, np.newaxis]
        for name, values in zip(TCP[:3], away[:3, :3].T @ p, strict=True):
            columns[name][inside] = values
    return made.robot, columns


def test_rows_are_held_out_of_each_series() -> None:
    """No fold holds out all rows of a series, whose device would stand nowhere then."""
    robot, columns = series_of((9, 9, 9, 9))
    found = calibrated(robot, columns, folds=4)
    rms = found.residuals["full"]
    assert rms["fitted"]["position"] < rms["held_out"]["position"] < 3.0 * rms["fitted"]["position"]
    assert found.gains["full"]["position"].low > 1.0
    assert any(note.startswith("rows are held out of each of 4 series") for note in found.notes)


def test_rows_without_which_a_series_has_no_place_are_not_held_out() -> None:
    robot, columns = series_of((20, 12, 3))
    found = calibrated(robot, columns, folds=4)
    rms = found.residuals["full"]
    assert rms["held_out"]["position"] < 3.0 * rms["fitted"]["position"]
    assert any("of series '2' rows are not held out" in note for note in found.notes)


def test_a_turn_about_the_line_through_all_places_is_not_seen() -> None:
    """Two sockets: residuals turn with the base about the line through both, and seem to show it.

    The base stays where the first guess put it along that direction; all else is identifiable.
    """
    found = calibrate("ur5", Path(__file__).parent / "measured" / "two_sockets.csv", folds=0)
    assert (found.rank, found.rank_above_noise) == (24, 24)
    assert "turns the residuals" in found.merged["base.alpha"]
    assert "base.y, base.z" in found.merged["base.alpha"]
    assert not [name for name in ("base.x", "base.beta", "base.gamma") if name in found.merged]
    assert "base.alpha" not in "\n".join(found.lines()).partition("not identifiable")[0]


@pytest.mark.soak
def test_a_gain_in_orientation_alone_counts() -> None:
    """Each variant in each kind has its verdict: here positions are too noisy to show anything."""
    made = trial(chain(2, "RRRR"), 3, 60, noise=(2e-2, 2e-4))
    found = calibrate(made.robot, made.poses(), folds=8)
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
    found = calibrate(made.robot, made.poses(), folds=5)
    assert list(found.gains) == ["zeros", "full", "prior"]
    for name, gains in found.gains.items():
        assert list(gains) == ["position", "orientation"]
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
    parts = calibrated(made.robot, columns).residuals["full"]
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
    (line,) = (line for line in found.lines() if "nothing that was measured" in line)
    assert line.startswith("18 parameters")
    assert not any(name in line for name in unseen for line in found.lines())
    assert set(unseen) <= set(found.as_dict()["merged"])


def test_no_gain_is_said() -> None:
    made = trial(arm(), 3, 40, size=0.0)
    found = calibrate(made.robot, made.poses(), folds=8)
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
    columns = {f"tcp.sigma.{part[4:]}": np.full(60, 5e-5 if part[4] != "r" else 1e-4) for part in TCP}
    by_column = calibrated(arm(), trial(arm(), 3, 60).columns | columns)
    np.testing.assert_allclose(by_column.deviations, found.deviations, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
def test_outliers_are_down_weighted(loss: str) -> None:
    made = trial(arm(), 7, 60)
    columns = made.columns | {"tcp.x": made.columns["tcp.x"].copy()}
    columns["tcp.x"][[5, 30, 31]] += 0.02
    plain, robust = (calibrated(arm(), columns, loss=given) for given in (None, loss))
    assert {row for row, _ in robust.mistrusted} >= {5, 30, 31}
    clean = calibrate(arm(), made.poses(), folds=0)
    truth, *off = (x.predict(made.poses().q, "tcp")[0][:, :3, 3] for x in (clean, plain, robust))
    assert np.abs(off[1] - truth).max() < 0.2 * np.abs(off[0] - truth).max()


def test_attached_frames_series_and_rows_without_them() -> None:
    """Two frames that the description does not have, two places of the device, empty cells."""
    robot = chain(8, "RRRRR")
    places = {"ball": (0.1, -0.2, 0.3, 0.5, 1.0, -2.0), "probe": (-0.1, 0.0, 0.2, 2.0, 0.1, 1.0)}
    made = trial(robot, 3, 90, frames={name: ("link5", pose_from(np.array(x))) for name, x in places.items()})
    columns, second = dict(made.columns), np.arange(90) >= 50
    away = pose_from(np.array([-3.0, 1.0, 0.2, 2.0, -0.5, 0.7]))
    for name, missing in (("ball", 1), ("probe", 0)):
        p = np.stack([columns[f"{name}.{axis}"] for axis in "xyz"], axis=1)
        R = rotation_of(np.stack([columns[f"{name}.r{axis}"] for axis in "xyz"], axis=1))
        p[second], R[second] = p[second] @ away[:3, :3].T + away[:3, 3], away[:3, :3] @ R[second]
        there = placed(p, R, name)
        for values in there.values():
            values[missing::3] = np.nan
        columns |= there
    columns["series"] = np.where(second, 7.0, 3.0)
    found = calibrate(robot, poses_of(robot, columns, *places), frames=dict.fromkeys(places, "link5"), folds=0)
    assert found.rank == 4 * 5 + 6 + 6 + 6
    assert found.residuals["full"]["fitted"]["position"] < 6e-5
    assert found["series.7.base.x"] != found["series.3.base.x"]
    assert found["frames.ball.z"] == pytest.approx(0.3, abs=0.05)


@pytest.mark.soak
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
    apart = found.written_values[list(found.written).index("toml"), 0]  # fitted without that of the drive
    assert alpha.stiffness == apart[found.names.index("joints.joint2.alpha.stiffness")]
    assert alpha.stiffness == pytest.approx(found["joints.joint2.alpha.stiffness"], rel=0.01)
    drive = found.calibrated.joint("joint1").coordinates["gamma"]
    assert drive.stiffness is None, "what yields behind a drive is no spring that pulls the joint to zero"
    still = replace(robot, gravity=(0.0, 0.0, 0.0))
    without = {name: values for name, values in made.columns.items() if name[:5] != "tcp.f"}
    assert "no load" in calibrated(still, without).merged["joints.joint2.alpha.stiffness"]


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


@cache
def eccentric() -> Trial:
    """Positions of an arm with a drive that is off by far more than its offsets."""
    more = [ErrorParameter("joints.joint2.eccentricity.sin", DRIVE, 2, 5, "sin", 0.0, 2e-2)]
    return trial(chain(8, "RRR"), 1, 40, more=more)


def test_other_variants_are_those_without_terms_of_drives() -> None:
    """They begin with what is described, not with offsets that were fitted together with the terms."""
    made = eccentric()
    found, plain = (calibrate(made.robot, made.poses(), drives=drives, folds=4) for drives in (True, False))
    for name in ("placement", "zeros"):
        for part, values in plain.residuals[name].items():
            assert found.residuals[name][part] == pytest.approx(values, rel=1e-6), (name, part)
    assert found.gains["full"]["position"].low > 10.0
    placement = calibrate(made.robot, made.poses(), drives=True, folds=4, variant="placement")
    assert not any(placement[name] for name in placement.names if name.startswith("joints."))


def test_remarks_about_the_file_are_kept_with_terms_of_drives() -> None:
    """What was forced is said, besides the terms that were found."""
    made = eccentric()
    turn = {"joint1.gamma": made.columns["joint1.gamma"] + 2.0 * np.pi * np.arange(40)}
    found = calibrated(made.robot, made.columns | turn, drives=True, force=True)
    assert any(note.startswith("suspicious, and taken as it is") for note in found.notes)
    assert any(note.startswith("the data show joints.joint2.eccentricity") for note in found.notes)


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
    both = made.columns | {"joint2.motor": 80.0 * made.columns["joint2.gamma"]}
    found = calibrated(robot, {name: values for name, values in both.items() if name != "joint2.gamma"})
    name = "joints.joint2.motor.stiffness"
    assert found[name] == pytest.approx(1.0 / 7e-5, rel=0.05)
    assert found.described[found.names.index(name)] == pytest.approx(2e4)
    assert found.calibrated.joint("joint2").motor.transmission.stiffness == found[name]
    refused(InputError, r"joint2\.motor and its joint's coordinate are both there", calibrated, robot, both)


def test_joints_that_move_nothing_measured_are_not_read() -> None:
    """Of a robot with a second arm: its column may be missing, its offsets are named; others may not."""
    robot = arm()
    other = replace(robot.joints[0], name="other", child="hand")
    whole = replace(robot, links=(*robot.links, replace(robot.links[0], name="hand")), joints=(*robot.joints, other))
    made = trial(arm(), 3, 40)
    found = calibrated(whole, made.columns)
    assert found.merged["joints.other.offset.gamma"] == "it moves nothing that was measured"
    alone = calibrate(arm(), made.poses(), folds=0)
    assert found.rank == alone.rank
    ours, theirs = found.predict(np.zeros(4), "tcp", series=0)[0], alone.predict(np.zeros(3), "tcp", series=0)[0]
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    part = {name: values for name, values in made.columns.items() if name != "joint2.gamma"}
    with pytest.raises(InputError, match=r"the column joint2.gamma is missing; allowed: all joints that move what was"):
        calibrated(whole, part)


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
    columns = {name: np.repeat(values, 4) for name, values in made.columns.items() if not name.startswith("tcp.r")}
    for axis in "xyz":
        columns[f"tcp.{axis}"] += np.repeat(rng.normal(scale=5e-5, size=40), 4) + rng.normal(scale=1e-5, size=160)
    found = calibrated(robot, columns)
    assert any("points of one rigid body are not independent" in note for note in found.notes)
    named = calibrated(robot, columns | {"body": np.repeat(np.arange(40), 4)})
    assert any("(body: correlation 0.9" in note for note in named.notes)


# Covariances of measurement errors


COUNT = 40


@cache
def made() -> Trial:
    return trial(chain(4, "RRP", special=True), 3, COUNT)


def mixed(size: int, seed: int = 0) -> Array:
    """A covariance with all its entries."""
    root = np.random.default_rng(seed).normal(size=(size, size))
    scale = np.repeat([5e-5, 1e-4], 3)[:size]
    return scale[:, np.newaxis] * (root @ root.T + np.eye(size)) * scale


def written(path: Path, matrix: Array) -> Path:
    names = [f"tcp.{part}" for part in ("x", "y", "z", "rx", "ry", "rz")[: matrix.shape[-1]]]
    rows = "\n".join(",".join(map(repr, row)) for row in matrix.reshape(-1, matrix.shape[-1]).tolist())
    path.write_text(f"# m^2, m rad, rad^2\n{','.join(names)}\n{rows}\n")
    return path


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("by_row", [False, True])
def test_errors_are_whitened_by_their_covariance(size: int, by_row: bool) -> None:
    """r^T C^-1 r of every row, by matrices of NumPy; rows with a weight; standard deviations are its diagonal."""
    poses = made().poses() if size == 6 else made().poses("rx", "ry", "rz")
    matrices = np.stack([mixed(size, seed) for seed in range(COUNT if by_row else 1)])
    seen = observations_of(poses, None, {"tcp": matrices if by_row else matrices[0]})
    r = np.random.default_rng(1).normal(size=seen.group.size)
    split = 3 * COUNT
    rows = r.reshape(-1, 3) if size == 3 else np.hstack([r[:split].reshape(-1, 3), r[split:].reshape(-1, 3)])
    wanted = sum(row @ np.linalg.solve(C, row) for row, C in zip(rows, np.tile(matrices, (COUNT, 1, 1)), strict=False))
    white = seen.whiten(r, seen.sigma)
    assert white @ white == pytest.approx(wanted, rel=1e-9)
    np.testing.assert_allclose(seen.whiten(np.stack([r, 2.0 * r], axis=1), seen.sigma)[:, 1], 2.0 * white, rtol=1e-12)
    np.testing.assert_allclose(seen.sigma[:3], np.sqrt(np.diag(matrices[0])[:3]))


def test_a_file_says_what_python_says(tmp_path: Path) -> None:
    """CSV and NPZ, one matrix and one per row; printed noise is that of the covariance."""
    puma, matrix = trial(eomgen.load_robot("puma560"), 0, COUNT), mixed(6)
    np.savez(tmp_path / "poses.npz", **puma.columns)
    np.savez(tmp_path / "c.npz", tcp=np.tile(matrix, (COUNT, 1, 1)))
    files = [written(tmp_path / "c.csv", matrix), tmp_path / "c.npz"]
    np.testing.assert_allclose(read_covariances(files[:1])["tcp"], matrix, rtol=1e-15)
    by_row = written(tmp_path / "rows.csv", np.tile(matrix, (COUNT, 1, 1)))
    np.testing.assert_array_equal(read_covariances([by_row])["tcp"], read_covariances(files[1:])["tcp"])
    wanted = calibrate(puma.robot, puma.poses(), covariance={"tcp": matrix}, folds=0)
    assert wanted.noise["tcp.position"] == pytest.approx(np.sqrt(np.diag(matrix)[:3].mean()))
    for file in files:
        words = ("calibrate", "puma560", tmp_path / "poses.npz", "--folds", 0, "--covariance", file)
        assert "um, known" in command(*words, "-o", tmp_path / "found.npz")
        found = load_calibration(tmp_path / "found.npz")
        np.testing.assert_allclose(found.deviations, wanted.deviations, rtol=1e-6, atol=1e-12)


def test_covariances_are_checked(tmp_path: Path) -> None:
    poses = made().poses()
    rows = np.tile(mixed(6), (COUNT, 1, 1))
    rows[7] = -rows[7]
    skew = mixed(6)
    skew[0, 1] *= 1.001
    for value, said in (
        (rows, r"that of tcp \(poses: row 7\) is not symmetric and positive definite"),
        (skew, "that of tcp is not symmetric and positive definite"),
        (rows[:9], r"tcp has shape \(9, 6, 6\); allowed: \(3, 3\), \(40, 3, 3\), \(6, 6\), \(40, 6, 6\)"),
        (np.full((6, 6), np.nan), "not symmetric and positive definite"),
    ):
        refused(ArrayError, said, calibrate, made().robot, poses, covariance={"tcp": value}, folds=0)
    (tmp_path / "few.csv").write_text("tcp.x,tcp.y,tcp.z\n1,0,0\n0,1,0\n")
    (tmp_path / "other.csv").write_text("tcp.x,probe.y,tcp.z\n1,0,0\n")
    np.savez(tmp_path / "text.npz", tcp=np.array("none"))
    good = written(tmp_path / "good.csv", mixed(3))
    for names, said in (
        (["few.csv"], "has 2 lines of 3 numbers; allowed: 3, or 3 for each pose"),
        (["other.csv"], "has the columns .*probe.y.*; allowed: columns F.x F.y F.z"),
        (["text.npz"], "array 'tcp' has dtype <U4; allowed: numbers"),
        ([good.name, good.name], "'tcp' has a covariance already; allowed: one of each frame"),
        (["c.txt"], r"allowed: a path that ends in .csv or .npz"),
        (["none.csv"], "cannot be read"),
    ):
        refused(InputError, said, read_covariances, [tmp_path / name for name in names])
