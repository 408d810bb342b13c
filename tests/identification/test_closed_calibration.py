"""Calibration of closed mechanisms: complete models by counting, blind ones fitted, encoders alone, predictions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import ArrayError, InputError
from eomgen.identification import CalibrationResult, MeasuredPoses, calibrate, load_calibration, poses_from_columns
from eomgen.identification.calibration.calibrated import placement_of
from eomgen.identification.geometry.error_model import ErrorModel, Rows, model_parameters, rows_of
from eomgen.identification.geometry.loop_constraints import closed_readings, closing_of, constants_of
from eomgen.identification.geometry.rotations import pose_from, vectors_of
from eomgen.identification.geometry.solve import algebraic_rank
from eomgen.identification.geometry.stations import Chain, Located, chain_of, located, matrix_of
from eomgen.motion.turns import rotation_of
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Robot

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
NOISE = (2e-5, 5e-5)
GOUGH = {f"leg{i}.z": (1.2, 0.12) for i in range(1, 7)}
DELTA = {f"arm{i}.gamma": (0.28, 0.45) for i in (1, 2, 3)}
BAR = {"joint1.gamma": (1.2, 0.8)}


def drawn(drives: dict[str, tuple[float, float]], count: int, seed: int) -> dict[str, Array]:
    """Columns of drives about a middle."""
    rng = np.random.default_rng(seed)
    return {name: middle + half * rng.uniform(-1.0, 1.0, count) for name, (middle, half) in drives.items()}


def model_of(robot: Robot, drives: dict[str, Array]) -> tuple[ErrorModel, Rows]:
    """The error model of a robot's frame tcp, and rows of its drives."""
    tree, frame, count = build_model(robot), robot.frames[0], len(next(iter(drives.values())))
    stations = chain_of(robot, {"tcp": (frame.link, matrix_of(frame.placement))})
    at = {s.name: k for k, s in enumerate(stations.stations) if s.joint is not None}
    places = {name: (at[name.split(".")[0]], COORDINATES.index(name.split(".")[1]), 1.0) for name in drives}
    blank = {f"tcp.{axis}": np.zeros(count) for axis in "xyz"}
    rows = rows_of(stations, robot, poses_from_columns(drives | blank, tree.coordinates, ["tcp"]), places)
    closing = closing_of(tree, stations, [place[:2] for place in places.values()], "poses")
    readings = closed_readings(stations, closing, tree, rows.readings, [""] * count)
    parameters = tuple(model_parameters(robot, stations, [0], {"tcp": True}))
    return ErrorModel(robot, stations, parameters, {0: np.eye(4)}, closing), replace(rows, readings=readings)


def stations_at(model: ErrorModel, chain: Chain, readings: Array) -> tuple[Located, Array]:
    """Where the stations of a chain are with loops closed, and their coordinates."""
    assert model.closing is not None
    constants, bases = constants_of(chain, model.robot, len(readings)), np.tile(np.eye(4), (len(readings), 1, 1))
    values = model.closing.closed(chain, readings + constants, constants, bases, 40)
    return located(chain, values, bases), values - constants


def moved(chain: Chain, k: int, six: Array) -> Chain:
    """The chain with the constant pose in front of a station moved by six coordinates."""
    stations = list(chain.stations)
    stations[k] = replace(stations[k], before=stations[k].before @ pose_from(six))
    return replace(chain, stations=tuple(stations))


def counted(model: ErrorModel, rows: Rows) -> int:
    """Rank of what moving all constant poses between stations, drives' zeros and the base does, by differences."""
    assert model.closing is not None
    chain, tool, h = model.chain, model.chain.tools["tcp"], 1e-5
    readings, passive = rows.readings, model.closing.passive
    pairs = [
        tuple(stations_at(model, moved(chain, k, sign * h * np.eye(6)[c]), readings)[0] for sign in (1.0, -1.0))
        for k in range(1, len(chain.stations))
        for c in range(6)
    ]
    for k, station in enumerate(chain.stations):
        for c, name in enumerate(COORDINATES):
            if station.joint is not None and name in station.joint.coordinates and (k, c) not in passive:
                step = np.zeros_like(readings)
                step[:, k, c] = h
                pairs.append(tuple(stations_at(model, chain, readings + sign * step)[0] for sign in (1.0, -1.0)))
    columns = [
        np.hstack([a.p[tool] - b.p[tool], vectors_of(a.R[tool] @ b.R[tool].transpose(0, 2, 1))]).ravel() / (2.0 * h)
        for a, b in pairs
    ]
    p = stations_at(model, chain, readings)[0].p[tool]
    for c in range(6):
        turn = np.eye(3)[c - 3] if c >= 3 else np.zeros(3)
        shift = np.cross(turn, p) + (np.eye(3)[c] if c < 3 else 0.0)
        columns.append(np.hstack([shift, np.tile(turn, (len(p), 1))]).ravel())
    A = np.array(columns).T
    sizes = np.linalg.norm(A, axis=0)
    values = np.linalg.svd(A[:, sizes > 1e-7] / sizes[sizes > 1e-7], compute_uv=False)
    return int((values > 1e-7 * values[0]).sum())


@pytest.mark.parametrize(
    ("name", "drives", "rank"),
    [
        pytest.param("gough", GOUGH, 42, marks=pytest.mark.soak),
        pytest.param("delta", DELTA, 42, marks=pytest.mark.soak),
        ("four_bar", BAR, 18),
        ("bennett", BAR, 18),
    ],
)
def test_models_are_complete_by_counting(name: str, drives: dict[str, tuple[float, float]], rank: int) -> None:
    """As many combinations as all constant poses of a mechanism have, moved one by one."""
    model, rows = model_of(eomgen.load_robot(name), drawn(drives, 15, 1))
    S = model.at(model.nominal, rows).sensitivities(model.chain.tools["tcp"])
    assert algebraic_rank(S.reshape(-1, S.shape[-1])) == counted(model, rows) == rank


def blind(name: str, drives: dict[str, Array], seed: int) -> tuple[Array, Array]:
    """Poses of a mechanism whose constant poses are all off: rotations and positions of its frame."""
    model, rows = model_of(eomgen.load_robot(name), drives)
    rng, chain = np.random.default_rng(seed), model.chain
    for k, station in enumerate(chain.stations):
        if station.joint is None or station.joint.type != "free":
            chain = moved(chain, k, rng.normal(size=6) * np.repeat([3e-4, 1e-3], 3)) if k else chain
    at, _ = stations_at(model, chain, rows.readings)
    return at.R[chain.tools["tcp"]], at.p[chain.tools["tcp"]]


def measured(drives: dict[str, Array], R: Array, p: Array, seed: int) -> dict[str, Array]:
    """Columns of a file, with noise."""
    rng = np.random.default_rng(seed)
    p = p + NOISE[0] * rng.normal(size=p.shape)
    R = rotation_of(NOISE[1] * rng.normal(size=p.shape)) @ R
    columns = drives | {f"tcp.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
    return columns | {f"tcp.r{axis}": x for axis, x in zip("xyz", vectors_of(R).T, strict=True)}


def found_of(robot: Robot, columns: dict[str, Array], **options: object) -> CalibrationResult:
    poses = poses_from_columns(columns, build_model(robot).coordinates, ["tcp"], encoders=True)
    return calibrate(robot, poses, **{"folds": 0, **options})  # type: ignore[arg-type]


@pytest.mark.soak
@pytest.mark.parametrize(("name", "drives"), [("gough", GOUGH), ("delta", DELTA)])
def test_blind_platforms_are_fitted_to_the_noise(
    name: str, drives: dict[str, tuple[float, float]], tmp_path: Path
) -> None:
    """All their constant poses are off; poses elsewhere are within intervals, from drives alone."""
    robot = eomgen.load_robot(name)
    given, others = drawn(drives, 40, 2), drawn(drives, 12, 3)
    found = found_of(robot, measured(given, *blind(name, given, 5), 7))
    assert found.rank == 42
    assert found.noise["tcp.position"] == pytest.approx(NOISE[0], rel=0.2)
    assert found.noise["tcp.orientation"] == pytest.approx(NOISE[1], rel=0.2)
    if name == "gough":
        with pytest.raises(InputError, match=r"predict: row 0: the loops of gough do not close there .*; allowed: "):
            found.predict([5.0, 1.2, 1.2, 1.2, 1.2, 1.2], "tcp")
    R, p = blind(name, others, 5)
    q = np.stack(list(others.values()), axis=1)
    poses, covariance = found.predict(q, "tcp", series=0)
    off = np.hstack([p - poses[:, :3, 3], vectors_of(R @ poses[:, :3, :3].transpose(0, 2, 1))])
    assert np.abs(off[:, :3]).max() < 1e-4
    within = np.abs(off) <= found.quantile * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert within.mean() > 0.85
    read = eomgen.load_robot(found.to_toml(tmp_path / "platform.toml"))
    model, rows = model_of(read, others)
    again, _ = stations_at(model, model.chain, rows.readings)
    own = found.predict(q, "tcp")[0]
    np.testing.assert_allclose(again.p[model.chain.tools["tcp"]], own[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(again.R[model.chain.tools["tcp"]], own[:, :3, :3], atol=1e-9)


def with_longer(side: int, change: float) -> Robot:
    """The linkage with its coupler (1) or rocker (0) longer."""
    robot = eomgen.load_robot("four_bar")
    loop = robot.loops[0]
    six = np.array([change, 0.0, 0.0, 0.0, 0.0, 0.0])
    placements = [
        placement_of(matrix_of(x) @ pose_from(six)) if i == side else x for i, x in enumerate(loop.placements)
    ]
    return replace(robot, loops=(replace(loop, placements=(placements[0], placements[1])),))


@pytest.mark.parametrize("side", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_a_coupler_or_rocker_that_is_longer_is_fitted(side: int, tmp_path: Path) -> None:
    """By 0.5 mm, from a kernel of its own."""
    robot, true = eomgen.load_robot("four_bar"), with_longer(side, 5e-4)
    kernel = eomgen.build(true)
    drive = np.sort(drawn(BAR, 40, 4)["joint1.gamma"])
    q, at = [], np.array(build_model(robot).home)
    for angle in drive:
        for share in (0.25, 0.5, 0.75, 1.0):
            at = at.copy()
            at[0] += share * (angle - at[0])
            at = np.asarray(kernel.assemble(at, ["joint1.gamma"]))
        q.append(at)
    p = kernel.frame_pose(np.array(q), "tcp")[:, :3, 3]
    columns = {"joint1.gamma": drive} | {f"tcp.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
    found = found_of(robot, columns, noise=NOISE)
    assert found.residuals["full"]["fitted"]["position"] < 1e-7
    model, rows = model_of(eomgen.load_robot(found.to_toml(tmp_path / "linkage.toml")), {"joint1.gamma": drive})
    own, _ = stations_at(model, model.chain, rows.readings)
    base = found.predict(drive[:, np.newaxis], "tcp")[0][:, :3, 3]
    np.testing.assert_allclose(own.p[model.chain.tools["tcp"]], base, atol=1e-10)


@pytest.mark.soak
def test_a_linkage_calibrates_itself_by_its_encoders() -> None:
    """Three encoders of a linkage with one degree of freedom: ratios of lengths and zeros, six in all, and no device.

    Passive coordinates elsewhere follow from what was found.
    """
    robot, true = eomgen.load_robot("four_bar"), with_longer(1, 5e-4)
    names, zero = ("joint2.gamma", "joint3.gamma"), 0.01
    given, others = drawn(BAR, 60, 5), drawn(BAR, 20, 6)

    def passive(drives: dict[str, Array]) -> Array:
        model, rows = model_of(true, drives)
        at = {s.name: k for k, s in enumerate(model.chain.stations) if s.joint is not None}
        q = stations_at(model, model.chain, rows.readings)[1]
        return np.stack([q[:, at[name.split(".")[0]], 5] for name in names], axis=1) + [0.0, zero]

    noise = 2e-5 * np.random.default_rng(1).normal(size=(60, 2))
    columns = given | dict(zip(names, (passive(given) + noise).T, strict=True))
    found = found_of(robot, columns, folds=5)
    assert found.frames == {}
    assert found.rank == found.rank_above_noise == 6
    assert any("encoders of passive coordinates count as measured" in note for note in found.notes)
    assert found.noise["joint2.gamma.encoder"] == pytest.approx(2e-5, rel=0.3)
    assert found.gains["full"]["orientation"].is_significant
    assert "mrad" in found.lines()[2]
    model, rows = model_of(robot, others)
    assert model.closing is not None
    own = ErrorModel(robot, found.model.chain, found.model.parameters, found.model.bases, found.model.closing)
    readings = np.zeros((20, len(own.chain.stations), 6))
    at = {s.name: k for k, s in enumerate(own.chain.stations) if s.joint is not None}
    before = {s.name: k for k, s in enumerate(model.chain.stations) if s.joint is not None}
    for name, k in at.items():
        readings[:, k] = rows.readings[:, before[name]]
    state = own.at(found.x, Rows(readings, np.zeros(20, dtype=np.int64), {}, np.zeros(readings.shape[:2]), None))
    predicted = np.stack([state.q[:, at[name.split(".")[0]], 5] for name in names], axis=1)
    S = state.passive_slopes()[:, [own.closing.passive.index((at[name.split(".")[0]], 5)) for name in names]]  # type: ignore[union-attr]
    deviation = np.sqrt(np.einsum("nip,pq,niq->ni", S, found.covariance, S))
    off = predicted - passive(others)
    assert np.abs(off).max() < 5e-5
    assert np.mean(np.abs(off) <= found.quantile * deviation) > 0.8


def test_slopes_of_encoders_are_derivatives() -> None:
    model, rows = model_of(eomgen.load_robot("four_bar"), drawn(BAR, 6, 2))
    assert model.closing is not None
    values = model.nominal + 0.5 * model.sizes * np.where(model.sizes > 0.05, 0.0, 1.0)
    S = model.at(values, rows).passive_slopes()
    ks, cs = np.array(model.closing.passive).T
    for i in range(len(values)):
        step = 1e-6 * np.eye(len(values))[i]
        ahead, behind = (model.at(values + x, rows).q[:, ks, cs] for x in (step, -step))
        np.testing.assert_allclose(S[:, :, i], (ahead - behind) / 2e-6, atol=1e-6)


def test_predictions_close_loops(tmp_path: Path) -> None:
    """From drives alone as from all coordinates; where nothing closes it is said."""
    robot = eomgen.load_robot("four_bar")
    given = drawn(BAR, 40, 8)
    model, rows = model_of(with_longer(1, 5e-4), given)
    p = stations_at(model, model.chain, rows.readings)[0].p[model.chain.tools["tcp"]]
    found = found_of(robot, given | {f"tcp.{axis}": x for axis, x in zip("xyz", p.T, strict=True)})
    one, _ = found.predict([1.0], "tcp")
    whole, _ = found.predict([1.0, -0.5, 1.4], "tcp")
    np.testing.assert_allclose(one, whole, atol=1e-9)
    again = load_calibration(found.save(tmp_path / "linkage.npz"))
    np.testing.assert_allclose(again.predict([[1.0], [1.2]], "tcp")[0][0], one, atol=1e-12)
    with pytest.raises(ArrayError, match=r"allowed: finite numbers of shape \(3,\) or \(N, 3\) or \(1,\) or \(N, 1\)"):
        found.predict([1.0, 0.0], "tcp")


@pytest.mark.soak
def test_misread_files_of_mechanisms_are_told() -> None:
    """Without closing them anew for each reading."""
    robot, given = eomgen.load_robot("four_bar"), drawn(BAR, 30, 8)
    model, rows = model_of(with_longer(1, 5e-4), given)
    p = stations_at(model, model.chain, rows.readings)[0].p[model.chain.tools["tcp"]]
    columns = given | {f"tcp.{axis}": x for axis, x in zip("xyz", p.T, strict=True)}
    for said, changed in (
        ("read as centimetres for metres", {f"tcp.{axis}": 100.0 * columns[f"tcp.{axis}"] for axis in "xyz"}),
        ("read as coordinates one row early", {f"tcp.{axis}": np.roll(columns[f"tcp.{axis}"], 1) for axis in "xyz"}),
    ):
        with pytest.raises(InputError, match=said):
            found_of(robot, columns | changed)


def test_nothing_measured_is_said() -> None:
    with pytest.raises(InputError, match="nothing is measured; allowed: columns of frames, or of passive coordinates"):
        found_of(eomgen.load_robot("four_bar"), drawn(BAR, 20, 1))
    with pytest.raises(InputError, match="nothing is measured"):
        poses_from_columns(drawn(BAR, 20, 1), build_model(eomgen.load_robot("four_bar")).coordinates, ["tcp"])


# A linkage with one drive


def four_bar(count: int = 25) -> tuple[ErrorModel, Rows, Array]:
    """The error model of a linkage, rows of its one drive, and values whose sizes are those expected."""
    model, rows = model_of(eomgen.load_robot("four_bar"), {"joint1.gamma": np.linspace(0.3, 6.0, count)})
    values = model.nominal + model.sizes * np.random.default_rng(2).normal(size=len(model.parameters))
    return model, rows, np.where(model.sizes > 0.05, 0.0, values)


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
