"""Poses to measure: better than random ones, near the bound, where they have to be; sequences; mistakes by name."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError, replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.identification import calibrate, poses, read_poses
from eomgen.identification.choosing.continuous import bound_of
from eomgen.identification.choosing.exchange import chosen_by
from eomgen.identification.choosing.information import Information, added, criterion_of, inverse, removed
from eomgen.identification.geometry.error_model import ErrorModel, Rows, model_parameters
from eomgen.identification.geometry.stations import chain_of, located, matrix_of
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.commands import command, facts
from tests.support.measured_poses import chain, trial
from tests.support.measurements import calibrated, placed, poses_of
from tests.support.optional import needs
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]


def limited(robot: Robot) -> Robot:
    """The robot with limits in all joints."""
    ends = {"revolute": (-2.5, 2.5), "prismatic": (-0.4, 0.4)}
    return replace(robot, joints=tuple(replace(joint, limits=ends[joint.type]) for joint in robot.joints))


@cache
def arm() -> Robot:
    return limited(chain(4, "RRP", special=True))


@cache
def six() -> Robot:
    return limited(chain(3, "RRRRRR"))


def readings(model: ErrorModel, q: Array) -> Array:
    found = np.zeros((len(q), len(model.chain.stations), 6))
    moving = [(k, s.principal) for k, s in enumerate(model.chain.stations) if s.principal is not None]
    for i, (k, c) in enumerate(moving):
        found[:, k, c] = q[:, i]
    return found


def sensitivities(robot: Robot, q: Array, parts: int) -> Array:
    """Rows of the tool's ``parts`` first components at principal coordinates, in units of noise and expected sizes."""
    stations = chain_of(robot, {"tcp": (robot.frames[0].link, matrix_of(robot.frames[0].placement))})
    model = ErrorModel(robot, stations, tuple(model_parameters(robot, stations, [0], {"tcp": True})), {0: np.eye(4)})
    r = readings(model, q)
    rows = Rows(r, np.zeros(len(q), dtype=np.int64), {}, np.zeros(r.shape[:2]), None)
    S = model.at(model.nominal, rows).sensitivities(stations.tools["tcp"])[:, :parts]
    return np.asarray(S * model.sizes / np.array([5e-5] * 3 + [1e-4] * 3)[:parts, np.newaxis])


def log_det(S: Array, V: Array, prior: float = 0.0) -> float:
    """Logarithm of the determinant of the information in directions V, (p, P)."""
    flat = S.reshape(-1, S.shape[-1]) @ V.T
    return float(np.linalg.slogdet(prior * np.eye(len(V)) + flat.T @ flat)[1])


def drawn(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    low, high = np.array([joint.limits for joint in robot.joints]).T
    return np.asarray(rng.uniform(low, high, (count, len(low))))


# What they tell


@pytest.mark.soak
@pytest.mark.parametrize(("measure", "parts", "few", "many"), [("pose", 6, 8, 12), ("position", 3, 12, 18)])
def test_two_thirds_chosen_are_no_worse_than_random_ones(measure: str, parts: int, few: int, many: int) -> None:
    """By the expected error of the tool, beside the median of random sets, of sensitivities that the test makes."""
    robot = eomgen.load_robot("puma560")
    found = poses(robot, count=few, measure=measure, criterion="V")
    rng = np.random.default_rng(2)
    elsewhere = sensitivities(robot, drawn(robot, rng, 200), 3)
    elsewhere = (elsewhere * 5e-5).reshape(-1, elsewhere.shape[-1])

    def error(q: Array) -> float:
        own = sensitivities(robot, q, parts).reshape(-1, elsewhere.shape[-1])
        covariance = np.linalg.inv(np.eye(own.shape[1]) + own.T @ own)
        return float(np.sqrt(np.einsum("ip,pq,iq->", elsewhere, covariance, elsewhere) / 200.0))

    others = [error(drawn(robot, rng, many)) for _ in range(50)]
    assert error(found.q) < np.median(others)
    assert error(found.q) == pytest.approx(found.error, rel=0.1)


@pytest.mark.parametrize(("measure", "parts"), [("pose", 6), ("position", 3)])
def test_as_many_chosen_are_better_than_random_ones(measure: str, parts: int) -> None:
    """By the determinant of sensitivities that the test makes itself, without what is known before."""
    found = poses(six(), count=18, measure=measure, candidates=200)
    S = sensitivities(six(), drawn(six(), np.random.default_rng(1), 300), parts)
    values, V = np.linalg.svd(S.reshape(-1, S.shape[-1]), full_matrices=False)[1:]
    V = V[values > 1e-9 * values[0]]
    assert found.size == len(V)
    own = sensitivities(six(), found.q, parts)
    rng = np.random.default_rng(2)
    others = [log_det(S[rng.choice(len(S), 18, replace=False)], V) for _ in range(50)]
    assert log_det(own, V) > max(others)
    assert found.value == pytest.approx(log_det(own, V, 1.0), rel=1e-6)


@pytest.mark.parametrize("criterion", ["D", "V"])
def test_many_are_near_the_bound(criterion: str) -> None:
    found = poses(six(), count=30, criterion=criterion, candidates=150)
    assert 0.95 < found.efficiency <= 1.0
    assert found.gap <= 1e-3
    assert (found.rank, found.rank_above_noise, found.size) == (30, 30, 30)


@cache
def little() -> Information:
    rng = np.random.default_rng(5)
    return Information(np.eye(3), 3.0 * rng.normal(size=(12, 2, 3)), np.diag([1.0, 2.0, 0.5]))


@pytest.mark.parametrize("name", ["D", "V"])
def test_exchange_and_bound_of_a_small_set(name: str) -> None:
    """Against all choices of four of twelve: no worse than the best by 1 %, and none above the bound."""
    information, judge = little(), criterion_of(name, little())

    def value(chosen: Any) -> float:
        return judge.value(information.total(np.bincount(chosen, minlength=12).astype(float)))

    values = [value(np.array(chosen)) for chosen in combinations(range(12), 4)]
    bound, gap = bound_of(information, judge, 4)
    chosen, is_best = chosen_by(information, judge, 4, bound, np.random.default_rng(0))
    assert is_best
    assert len(set(chosen.tolist())) == 4
    assert gap <= 1e-3
    assert max(values) <= bound
    assert judge.efficiency(value(chosen), max(values), 3) > 0.99
    repeated = [value(chosen) for chosen in np.random.default_rng(0).integers(12, size=(2000, 4))]
    assert max(repeated) <= bound
    assert judge.efficiency(max(repeated), bound, 3) > 0.8


@pytest.mark.parametrize("name", ["D", "V"])
def test_updates_gains_and_slopes(name: str) -> None:
    """Of single candidates, against inverses and differences of the whole."""
    information, judge = little(), criterion_of(name, little())
    weights = np.linspace(0.5, 1.5, 12)
    A = information.total(weights)
    Y, covariance = information.Y, inverse(A)
    np.testing.assert_allclose(added(covariance, Y[3]), np.linalg.inv(A + Y[3].T @ Y[3]), atol=1e-12)
    np.testing.assert_allclose(removed(added(covariance, Y[3]), Y[3]), covariance, atol=1e-12)
    gains, slopes = judge.gains(Y, covariance), judge.slopes(Y, covariance)
    for i, part in enumerate(Y):
        assert gains[i] == pytest.approx(judge.value(A + part.T @ part) - judge.value(A), rel=1e-9)
        ahead, behind = (judge.value(A + sign * 1e-6 * part.T @ part) for sign in (1.0, -1.0))
        assert slopes[i] == pytest.approx((ahead - behind) / 2e-6, rel=1e-5)


def test_the_error_of_the_tool_is_what_calibrations_have() -> None:
    """Predicted over poses elsewhere, beside the covariance of a calibration with these poses and noise."""
    noise = (5e-5, 1e-4)
    found = poses(arm(), count=12, noise=noise, candidates=200)
    by_error = poses(arm(), count=12, noise=noise, candidates=200, criterion="V")
    assert by_error.error < found.error
    S = sensitivities(arm(), found.q, 6)
    made = trial(arm(), 0, 12, noise=(0.0, 0.0), size=0.0)
    of_tool = located(made.model.chain, readings(made.model, found.q), np.tile(made.model.bases[0], (12, 1, 1)))
    tool = made.model.chain.tools["tcp"]
    columns = dict(zip(found.coordinates, found.q.T, strict=True)) | placed(of_tool.p[tool], of_tool.R[tool])
    fitted = calibrated(arm(), columns, noise=noise)
    elsewhere = drawn(arm(), np.random.default_rng(7), 400)
    covariance = fitted.predict(elsewhere, "tcp", series=0)[1]
    rms = float(np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2).mean()))
    assert found.error == pytest.approx(rms, rel=0.05)
    assert np.linalg.matrix_rank(S.reshape(-1, S.shape[-1]), tol=1e-6) == found.rank == fitted.rank


# Where they are


def test_poses_are_where_they_have_to_be() -> None:
    """In one of two boxes, within reach, seen by the device, within ranges; against a kernel."""
    low, high = np.array([0.0, -1.5, -1.5]), np.array([1.5, 1.5, 1.5])
    device = np.array([2.0, 0.0, 0.5])
    found = poses(
        six(),
        count=10,
        boxes=[[low, high], [-high, -high + 1e-3]],
        reach=(0.2, 1.0),
        device=device,
        angle=0.8,
        axis="-x",
        ranges={"joint2": (-1.0, 1.0)},
        candidates=60,
    )
    kernel = eomgen.build(six(), kernels=("kinematics",))
    pose = np.asarray(kernel.frame_pose(found.q, "tcp"))
    p = pose[:, :3, 3]
    assert ((p >= low) & (p <= high)).all()
    length = np.linalg.norm(p, axis=1)
    assert ((length >= 0.2) & (length <= 1.0)).all()
    toward = (device - p) / np.linalg.norm(device - p, axis=1, keepdims=True)
    assert ((-pose[:, :3, 0] * toward).sum(axis=1) >= np.cos(0.8)).all()
    assert (np.abs(found.q[:, 1]) <= 1.0).all()
    assert np.abs(found.q[:, 0]).max() > 1.0
    assert len({tuple(row) for row in found.q.tolist()}) == 10


def test_seeds_and_values() -> None:
    """The same seed, the same poses; another one, others; results are values."""
    needs("pandas")
    first, second, other = (poses(arm(), count=8, candidates=50, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.q, second.q)
    assert not np.array_equal(first.q, other.q)
    with pytest.raises(FrozenInstanceError):
        first.seed = 5
    assert "efficiency" in repr(first)
    assert len(first.to_pandas()) == 8


def test_distances_and_attached_frames() -> None:
    """From a device 6 fewer combinations; a frame that is attached has a placement to find."""
    found = poses(arm(), count=30, measure="distance", device=(2.0, 1.0, 0.5), candidates=200)
    assert found.size == 4 * 2 + 2 + 6 - 6
    attached = poses(arm(), count=10, frames={"ball": "link3"}, measure="position", candidates=100)
    assert attached.frames == ("ball",)
    assert "frames.ball.x" in attached.names
    assert attached.size == 4 * 2 + 2 + 6 - 3


# One set after the other


def test_measured_poses_count() -> None:
    """What is known already is not measured again: better than the same number chosen alone, and joins a file."""
    rng = np.random.default_rng(0)
    stuck = limited(replace(six(), joints=six().joints))
    made = trial(stuck, 5, 10)
    fixed = {f"joint{i}.gamma": 0.1 * rng.normal(size=10) for i in (1, 2, 3)}  # three joints have hardly moved
    measured = poses_of(stuck, made.columns | fixed)
    S = sensitivities(stuck, measured.q, 6)
    after = poses(stuck, count=6, after=measured, candidates=200)
    alone = poses(stuck, count=6, candidates=200)
    assert after.measured == 10
    assert after.error < after.error_before
    everything = sensitivities(stuck, drawn(stuck, rng, 300), 6).reshape(-1, S.shape[-1])
    values, V = np.linalg.svd(everything, full_matrices=False)[1:]
    V = V[values > 1e-9 * values[0]]
    together = [log_det(np.concatenate([S, sensitivities(stuck, q, 6)]), V, 1.0) for q in (after.q, alone.q)]
    assert together[0] > together[1]
    assert after.value == pytest.approx(together[0], abs=1e-3 * abs(together[0]))


def test_noise_of_a_first_fit(tmp_path: Path) -> None:
    made = trial(arm(), 3, 40, noise=(2e-4, 7e-4))
    first = calibrate(arm(), made.poses(), folds=0)
    path = first.save(tmp_path / "first.npz")
    found = poses(arm(), count=5, after=made.poses(), fit=path, candidates=50)
    assert found.noise == pytest.approx((first.noise["tcp.position"], first.noise["tcp.orientation"]))
    assert found.noise == pytest.approx((2e-4, 7e-4), rel=0.3)


# Mistakes


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"count": 0}, InputError, "count: 0; allowed: a whole number from 1"),
        ({"count": 2}, InputError, "count: 2 poses with 6 numbers each for 16 .*allowed: 3 poses or more"),
        ({"candidates": 5, "count": 9}, InputError, "candidates: 5; allowed: a whole number 9 to"),
        ({"seed": -1}, InputError, "seed: -1"),
        ({"criterion": "A"}, InputError, "criterion: 'A'; allowed: D, V"),
        ({"measure": "angle"}, InputError, "measure: 'angle'; allowed: pose, position, distance"),
        ({"measure": "distance"}, InputError, "without a device"),
        ({"frame": "tpc"}, UnknownNameError, "there is no frame 'tpc'; did you mean 'tcp'"),
        ({"frame": ()}, InputError, "allowed: names, each once"),
        ({"frames": {"ball": "link9"}}, UnknownNameError, "there is no link 'link9'"),
        ({"ranges": {"joint9": (0.0, 1.0)}}, UnknownNameError, "there is no coordinate 'joint9'"),
        ({"ranges": {"joint1": (1.0, 0.0)}}, ArrayError, "ranges: joint1: 1 .. 0; allowed: a lower end"),
        ({"boxes": [[5.0, 5.0, 5.0], [6.0, 6.0, 6.0]]}, InputError, r"boxes: 0 of .*tcp is in x 0"),
        ({"workspace": [[5.0, 5.0, 5.0], [6.0, 6.0, 6.0]]}, InputError, "workspace: 0 of "),
        ({"boxes": [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]}, ArrayError, "boxes: .*lower corners before upper"),
        ({"boxes": [1.0, 2.0]}, ArrayError, "boxes: .*allowed: finite numbers of shape"),
        ({"reach": (5.0, 6.0)}, InputError, "reach: 0 of "),
        ({"angle": 0.5}, InputError, "allowed: with device"),
        ({"angle": 4.0, "device": (1.0, 0.0, 0.0)}, InputError, "angle: 4.0; allowed"),
        ({"axis": "w"}, InputError, "axis: 'w'; allowed: x, y, z"),
        ({"noise": (0.0, 1.0)}, ArrayError, "noise: "),
        ({"sizes": (1.0,)}, ArrayError, "sizes: "),
        ({"fixed": ["joints.joint9"]}, UnknownNameError, "there is no parameter 'joints.joint9'"),
    ],
)
def test_mistakes_have_names(
    options: dict[str, Any], error: type[Exception], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eomgen.identification.choosing.sampling._ROUNDS", 3)
    refused(error, said, poses, arm(), **{"count": 5, "candidates": 30, **options})


def test_robots_that_cannot_be_planned() -> None:
    with pytest.raises(InputError, match=r"joint1.gamma has no limits; allowed: limits in the description, or a range"):
        poses(chain(4, "RRP"))
    refused(InputError, "has loops or couplings; allowed: robots that are trees", poses, "four_bar")
    made = trial(arm(), 3, 10)
    columns = {name: values for name, values in made.columns.items() if not name.startswith("joint3")}
    refused(InputError, r"the column joint3.z is missing", poses, arm(), after=poses_of(arm(), columns), candidates=50)


# Files


def test_a_file_to_fill_in(tmp_path: Path) -> None:
    """Coordinates come back exactly; filled in, it is calibrated from."""
    found = poses(arm(), count=8, candidates=60)
    path = found.to_csv(tmp_path / "plan.csv")
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert lines[0] == "joint1.gamma,joint2.gamma,joint3.z,tcp.x,tcp.y,tcp.z,tcp.rx,tcp.ry,tcp.rz"
    np.testing.assert_array_equal([[float(x) for x in line.split(",")[:3]] for line in lines[1:]], found.q)
    refused(InputError, "nothing is measured", read_poses, path, build_model(arm()).coordinates, ["tcp"])
    filled = [lines[0], *(line.replace(",,,,,,", ",0.1,0.2,0.3,0.0,0.0,0.0") for line in lines[1:])]
    path.write_text("\n".join(filled) + "\n")
    assert len(read_poses(path, build_model(arm()).coordinates, ["tcp"]).q) == 8
    refused(InputError, r"ends in \.csv", found.to_csv, tmp_path / "plan.npz")


def test_columns_named_like_joints(tmp_path: Path) -> None:
    path, principal = tmp_path / "p.csv", {"body": "body.gamma", "hinge": "hinge.gamma"}
    path.write_text("hinge,body.gamma,body,tcp.distance\n0.1,0.2,1,0.3\n")
    found = read_poses(path, [*principal.values()], ["tcp"], principal=principal)
    assert (found.coordinates, found.q.tolist(), found.body.tolist()) == (
        ("hinge.gamma", "body.gamma"),
        [[0.1, 0.2]],
        [1],
    )
    path.write_text("hinge,body,tcp.distance\n0.1,0.2,0.3\n")
    with pytest.raises(InputError, match=r"'body' is the name of a joint, too; allowed: with a column 'body\.gamma'"):
        read_poses(path, [*principal.values()], ["tcp"], principal=principal)


def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Text, JSON, a file; options reach the function, mistakes have names."""
    monkeypatch.chdir(tmp_path)
    words = ("poses", "puma560", "--count", 10, "--candidates", 60, "--measure", "position", "--seed", 4)
    more = ("--range", "joint1", -0.5, 0.5, "--box", -1, -1, 0, 1, 1, 2, "--criterion", "V")
    said = facts(*words, *more, "-o", "plan.csv")
    assert said["files"] == ["plan.csv"]
    options = {"ranges": {"joint1": (-0.5, 0.5)}, "boxes": [[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]], "criterion": "V"}
    wanted = poses("puma560", count=10, candidates=60, measure="position", seed=4, **options)
    assert said == {"files": ["plan.csv"], **json.loads(json.dumps(wanted.as_dict()))}
    out = command(*words)
    assert "criterion D (determinant of the information): " in out
    assert "not identifiable:" in out
    assert "range: joint1: 'a' is not a number; allowed: " in command(*words, "--range", "joint1", "a", 1, code=1)
    assert "ends in .csv" in command(*words, "-o", "plan.npz", code=1)
