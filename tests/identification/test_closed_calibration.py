"""Calibration of closed mechanisms: complete models by counting, blind ones, encoders, predictions, stiffness."""

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
from eomgen.identification.geometry.compliances import compliances_of
from eomgen.identification.geometry.error_model import (
    COMPLIANCE,
    OFFSET,
    ErrorModel,
    ErrorParameter,
    Rows,
    model_parameters,
    rows_of,
)
from eomgen.identification.geometry.loop_constraints import closed_readings, closing_of, constants_of
from eomgen.identification.geometry.rotations import pose_from, vectors_of
from eomgen.identification.geometry.solve import algebraic_rank
from eomgen.identification.geometry.stations import Chain, Located, chain_of, located, matrix_of
from eomgen.motion.turns import rotation_of
from eomgen.robot import Coordinate, JointStiffness
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Robot
from tests.support.measurements import assert_slopes, calibrated, placed, poses_of
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]
NOISE = (2e-5, 5e-5)
GOUGH = {f"leg{i}.z": (1.2, 0.12) for i in range(1, 7)}
DELTA = {f"arm{i}.gamma": (0.28, 0.45) for i in (1, 2, 3)}
BAR = {"joint1.gamma": (1.2, 0.8)}


def drawn(drives: dict[str, tuple[float, float]], count: int, seed: int) -> dict[str, Array]:
    """Columns of drives about a middle."""
    rng = np.random.default_rng(seed)
    return {name: middle + half * rng.uniform(-1.0, 1.0, count) for name, (middle, half) in drives.items()}


def model_of(
    robot: Robot,
    drives: dict[str, Array],
    more: dict[str, Array] | None = None,
    parameters: tuple[ErrorParameter, ...] = (),
) -> tuple[ErrorModel, Rows]:
    """The error model of a robot's frame tcp, and rows of its drives; more: further columns, with positions."""
    tree, frame, count = build_model(robot), robot.frames[0], len(next(iter(drives.values())))
    stations = chain_of(robot, {"tcp": (frame.link, matrix_of(frame.placement))})
    at = {s.name: k for k, s in enumerate(stations.stations) if s.joint is not None}
    places = {name: (at[name.split(".")[0]], COORDINATES.index(name.split(".")[1]), 1.0) for name in drives}
    given = drives | (more or {f"tcp.{axis}": np.zeros(count) for axis in "xyz"})
    rows = rows_of(stations, robot, poses_from_columns(given, tree.coordinates, ["tcp"]), places)
    closing = closing_of(tree, stations, [place[:2] for place in places.values()], "poses")
    readings = closed_readings(stations, closing, tree, rows.readings, [""] * count)
    parameters = parameters or tuple(model_parameters(robot, stations, [0], {"tcp": True}))
    return ErrorModel(robot, stations, parameters, {0: np.eye(4)}, closing), replace(rows, readings=readings)


def stations_at(model: ErrorModel, chain: Chain, readings: Array) -> tuple[Located, Array]:
    """Where the stations of a chain are with loops closed, and their coordinates."""
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
    return drives | placed(p, rotation_of(NOISE[1] * rng.normal(size=p.shape)) @ R)


def found_of(robot: Robot, columns: dict[str, Array], **options: object) -> CalibrationResult:
    return calibrate(robot, poses_of(robot, columns, encoders=True), **{"folds": 0, **options})


def longer_positions(given: dict[str, Array]) -> dict[str, Array]:
    """Columns of drives and positions of the linkage with a longer coupler."""
    model, rows = model_of(with_longer(1, 5e-4), given)
    return given | placed(stations_at(model, model.chain, rows.readings)[0].p[model.chain.tools["tcp"]])


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
    placements = list(loop.placements)
    placements[side] = placement_of(matrix_of(placements[side]) @ pose_from(six))
    return replace(robot, loops=(replace(loop, placements=tuple(placements)),))


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
    found = found_of(robot, {"joint1.gamma": drive, **placed(p)}, noise=NOISE)
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
    own = ErrorModel(robot, found.model.chain, found.model.parameters, found.model.bases, found.model.closing)
    readings = np.zeros((20, len(own.chain.stations), 6))
    at = {s.name: k for k, s in enumerate(own.chain.stations) if s.joint is not None}
    before = {s.name: k for k, s in enumerate(model.chain.stations) if s.joint is not None}
    for name, k in at.items():
        readings[:, k] = rows.readings[:, before[name]]
    state = own.at(found.x, Rows(readings, np.zeros(20, dtype=np.int64), {}, np.zeros(readings.shape[:2]), None))
    predicted = np.stack([state.q[:, at[name.split(".")[0]], 5] for name in names], axis=1)
    S = state.passive_slopes()[:, [own.closing.passive.index((at[name.split(".")[0]], 5)) for name in names]]
    deviation = np.sqrt(np.einsum("nip,pq,niq->ni", S, found.covariance, S))
    off = predicted - passive(others)
    assert np.abs(off).max() < 5e-5
    assert np.mean(np.abs(off) <= found.quantile * deviation) > 0.8


def test_slopes_of_encoders_are_derivatives() -> None:
    model, rows = model_of(eomgen.load_robot("four_bar"), drawn(BAR, 6, 2))
    values = model.nominal + 0.5 * model.sizes * np.where(model.sizes > 0.05, 0.0, 1.0)
    S = model.at(values, rows).passive_slopes()
    ks, cs = np.array(model.closing.passive).T
    assert_slopes(S, lambda x: model.at(x, rows).q[:, ks, cs], values, 1e-6, 0.0, 1e-6)


def test_predictions_close_loops(tmp_path: Path) -> None:
    """From drives alone as from all coordinates; where nothing closes it is said."""
    found = found_of(eomgen.load_robot("four_bar"), longer_positions(drawn(BAR, 40, 8)))
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
    robot, columns = eomgen.load_robot("four_bar"), longer_positions(drawn(BAR, 30, 8))
    for said, changed in (
        ("read as centimetres for metres", {f"tcp.{axis}": 100.0 * columns[f"tcp.{axis}"] for axis in "xyz"}),
        ("read as coordinates one row early", {f"tcp.{axis}": np.roll(columns[f"tcp.{axis}"], 1) for axis in "xyz"}),
    ):
        refused(InputError, said, found_of, robot, columns | changed)


def test_nothing_measured_is_said() -> None:
    with pytest.raises(InputError, match="nothing is measured; allowed: columns of frames, or of passive coordinates"):
        found_of(eomgen.load_robot("four_bar"), drawn(BAR, 20, 1))
    refused(InputError, "nothing is measured", poses_of, eomgen.load_robot("four_bar"), drawn(BAR, 20, 1))


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
    assert_slopes(S, lambda x: model.at(x, rows).located.p[tool], values, 1e-6, 0.0, 1e-6)


@pytest.mark.soak
def test_a_linkage_is_calibrated_by_its_drive_alone(tmp_path: Path) -> None:
    model, rows, values = four_bar()
    p = model.at(values, rows).located.p[model.chain.tools["tcp"]]
    columns = {"joint1.gamma": rows.readings[:, 1, 5], **placed(p)}
    found = calibrated(model.robot, columns, folds=5)
    assert found.residuals["placement"]["fitted"]["position"] > 1e-5
    assert found.residuals["full"]["fitted"]["position"] < 1e-9
    assert found.residuals["full"]["held_out"]["position"] < 1e-6
    assert "loops.joint4.offset.x" in found.names
    read = eomgen.load_robot(found.to_toml(tmp_path / "linkage.toml"))
    assert read.loops[0].offset[0] == pytest.approx(found["loops.joint4.offset.x"], abs=1e-15)
    again = load_calibration(found.save(tmp_path / "linkage.npz"))
    np.testing.assert_array_equal(again.predict([1.0, -0.5, 1.4], "tcp")[0], found.predict([1.0, -0.5, 1.4], "tcp")[0])
    with pytest.raises(InputError, match=r"the column joint1.gamma is missing; allowed: all drives"):
        calibrated(model.robot, {name.replace("joint1", "joint2"): values for name, values in columns.items()})


# Stiffness


COUNT = 24
SOFT = {(1, 5): ("joints.joint1.gamma.stiffness", 2e-4), (2, 0): ("joints.joint2.x.stiffness", 1e-6)}  # drive, bearing


def columns() -> dict[str, Array]:
    """Drive and loads of a four-bar linkage; positions are to come."""
    drive = np.linspace(0.3, 6.0, COUNT)
    load = {"tcp.fx": 40.0 * np.cos(7.0 * drive), "tcp.fy": -60.0 + 50.0 * np.sin(5.0 * drive), "tcp.mz": 3.0 * drive}
    return {"joint1.gamma": drive} | load | {f"tcp.{axis}": np.zeros(COUNT) for axis in "xyz"}


def linkage(given: dict[str, Array], parameters: tuple[ErrorParameter, ...]) -> tuple[ErrorModel, Rows]:
    return model_of(eomgen.load_robot("four_bar"), {"joint1.gamma": given["joint1.gamma"]}, given, parameters)


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
    assert_slopes(S, lambda x: model.at(x, rows).located.p[tool], x, 0.1 * np.abs(x), 2e-3)


def test_sensitivities_of_compliances_are_derivatives() -> None:
    """To first order: of deflections so small that they leave the lever arms of loads as they are."""
    model, rows = linkage(columns(), compliances())
    tool, x = model.chain.tools["tcp"], 1e-3 * model.nominal
    S = model.at(x, rows).sensitivities(tool)[:, :3]
    assert_slopes(S, lambda x: model.at(x, rows).located.p[tool], x, 0.1 * x, 2e-3)


def deflected() -> MeasuredPoses:
    """Positions of the soft linkage under its loads."""
    model, rows = linkage(columns(), compliances())
    p = model.at(model.nominal, rows).located.p[model.chain.tools["tcp"]]
    return poses_of(model.robot, columns() | placed(p))


def test_stiffness_of_a_linkage_is_found() -> None:
    asked = ["joint1.gamma", "joint2.x"]
    found = calibrate("four_bar", deflected(), stiffness=asked, folds=0, noise=(1e-6, 1e-6))
    for name, c in SOFT.values():
        assert found[name] == pytest.approx(1.0 / c, rel=0.01)
    rigid = calibrate("four_bar", deflected(), folds=0)
    assert rigid.residuals["full"]["fitted"]["position"] > 100.0 * found.residuals["full"]["fitted"]["position"]


@pytest.mark.parametrize(
    ("name", "why"), [("joint2.gamma", "follows from the drives"), ("joint2.alpha", "is held by the loops, too")]
)
def test_what_loops_hold_is_refused_by_name(name: str, why: str) -> None:
    with pytest.raises(InputError, match=f"stiffness: {name} {why}; allowed: drives of four_bar, and coordinates"):
        calibrate("four_bar", deflected(), stiffness=[name], folds=0)


def test_loops_that_nothing_closes_are_refused() -> None:
    """Loop joints whose dampers alone resist: springs would be as good as rigid ones."""
    robot = eomgen.load_robot("hexapod_elastic")
    damped = (replace(x, coordinates=dict.fromkeys(x.coordinates, Coordinate(damping=1.0))) for x in robot.loops)
    robot = replace(robot, loops=tuple(damped))
    tree, frame = build_model(robot), robot.frames[0].name
    given = {tree.coordinates[i]: np.linspace(-0.02, 0.02, 30) ** (k + 1) for k, i in enumerate(tree.driven)}
    given |= {f"{frame}.{axis}": np.linspace(0.0, 0.1, 30) ** (i + 1) for i, axis in enumerate("xyz")}
    with pytest.raises(InputError, match="hexapod_elastic: all loops are elastic in all coordinates"):
        calibrate(robot, poses_of(robot, given, frame), folds=0)


@pytest.mark.parametrize("kind", ["table", "matrix"])
def test_mechanisms_that_springs_alone_place_are_refused(kind: str) -> None:
    robot = eomgen.load_robot("four_bar")
    first, *others = robot.joints
    if kind == "matrix":
        others = [replace(x, stiffness=JointStiffness.of([[50.0]], ("gamma",))) for x in others]
    else:
        others = [replace(x, coordinates={"gamma": replace(x.coordinates["gamma"], stiffness=50.0)}) for x in others]
    with pytest.raises(InputError, match="four_bar: springs hold all coordinates but those of drives"):
        calibrate(replace(robot, joints=(first, *others)), deflected(), folds=0)


def test_offsets_move_what_loads_deflect() -> None:
    """Sensitivities are derivatives: an offset changes the arms of loads, and a deflection those of others."""
    given = columns()
    offsets = tuple(ErrorParameter(f"offset {k} {c}", OFFSET, k, c, "one", 0.0, 1.0) for k in (1, 2) for c in (0, 1, 5))
    model, rows = linkage(given, (*compliances(), *offsets))
    x, tool = model.nominal, model.chain.tools["tcp"]
    S, steps = model.at(x, rows).sensitivities(tool)[:, :3], [*(1e-3 * x[:2]), *[1e-5] * len(offsets)]
    assert_slopes(S, lambda x: model.at(x, rows).located.p[tool], x, steps, 3e-6, 1e-9)


@pytest.mark.parametrize(("poses", "most"), [("exact", 1e-11), ("rounded", 5e-7)])
def test_poses_without_noise_are_explained(poses: str, most: float) -> None:
    """Noise that is estimated begins large, and hides nothing in the end; round-off shows no outliers and no drives."""
    found = calibrate("four_bar", Path(__file__).parent / "measured" / f"{poses}_four_bar.csv", folds=0, drives=True)
    assert (found.rank, found.rank_above_noise) == (18, 18)
    assert max(found.residuals["full"]["fitted"].values()) < most
    assert not found.diagnosis.outlying
    assert not found.diagnosis.patterns
    assert not any("the data show" in note for note in found.notes)
    assert found["loops.joint4.second.x"] == pytest.approx(5e-4, abs=2e-6)
