"""Free and ball joints over the poles of their angles: scenarios, files, streams, sweeps, programmed motions."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.errors import DescriptionError, InputError
from eomgen.identification import forces
from eomgen.motion.files import motion_from_columns
from eomgen.pictures.page import report_of
from eomgen.robot.value import ANGULAR, Coordinate, Frame, Joint, Link, Placement, Robot
from eomgen.scenario.load import scenario_from_values
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario, simulate
from eomgen.sweep import plan_from_toml, run
from tests.oracles.free_bodies import falling_body
from tests.support.small_robots import free_body

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
QUATERNION = ("free.qw", "free.qx", "free.qy", "free.qz")
Q0, V0 = np.array([0.0, 0.0, 8.0, 0.1, 0.2, 0.1]), np.array([1.0, 0.0, 0.0, 0.0, 4.0, 0.0])
NAMES = [f"free.{name}" for name in ("x", "y", "z", *ANGULAR)]
FALL: dict[str, Any] = {
    "duration": 1.2,
    "output_step": 0.01,
    "initial": {key: dict(zip(NAMES, x.tolist(), strict=True)) for key, x in (("q", Q0), ("v", V0))},
    "integrator": {"rtol": 1e-9},
}
STREAM = "fall.zarr"


def rotations(quaternion: Array) -> Rotation:
    """Of (w, x, y, z)."""
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1))


def apart(one: Rotation, other: Rotation) -> float:
    return float(np.max((one * other.inv()).magnitude()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fall")


@pytest.fixture(scope="module")
def fall(folder: Path) -> SimulationResult:
    """A body that tumbles while it falls."""
    stream = folder / STREAM if find_spec("zarr") else None
    return run_scenario(free_body(), scenario_from_values(FALL), stream=stream)


def test_a_scenario_over_the_poles(fall: SimulationResult) -> None:
    motion = fall.trajectory
    turned, origins = falling_body(free_body(), Q0, V0, motion.t)
    assert np.abs(np.cos(motion.q[:, 4])).min() < 0.1
    assert np.abs(np.diff(motion.q[:, 3])).max() > 0.2  # what angles do beside a pole
    quaternion = np.stack([fall.series(name).values for name in QUATERNION], axis=-1)
    assert apart(rotations(quaternion), turned) < 1e-7
    assert np.abs(motion.q[:, :3] - origins).max() < 1e-7
    assert np.abs(np.diff(quaternion, axis=0)).max() < 0.04  # half of the spin times the output step
    assert quaternion[0, 0] > 0.0
    assert apart(Rotation.from_matrix(fall.pose[:, :3, :3]), turned) < 1e-7
    assert fall.balance is not None
    assert abs(fall.balance.relative_residue) < 1e-7


def test_quaternions_in_files_and_tables(fall: SimulationResult, folder: Path) -> None:
    quaternion = fall.trajectory.quaternion("free")
    path = fall.save(folder / "trajectory.npz")
    with np.load(path) as data:
        assert data["rotating"].tolist() == ["free"]
        assert np.array_equal(data["quaternions"][:, 0], quaternion)
        arrays = {name: data[name] for name in data.files}
    again = eomgen.load_result(path)
    assert again.trajectory.rotating == ("free",)
    for i, name in enumerate(QUATERNION):
        found = again.series(name)
        assert (found.unit, found.values.tolist()) == ("", quaternion[:, i].tolist())
        for table in (fall.as_rows(), fall.trajectory.as_rows()):
            (column,) = (column for column in table.columns if column.name == name)
            assert column.values.tolist() == quaternion[:, i].tolist()
    kept = {name: array for name, array in arrays.items() if name not in ("rotating", "quaternions")}
    np.savez(folder / "old.npz", **kept)  # as files were before
    assert np.array_equal(eomgen.load_result(folder / "old.npz").trajectory.quaternion("free"), quaternion)
    for name, array, message in (
        ("rotating", np.array(["body"]), "array rotating: got 'body'; allowed: 'free'"),
        ("quaternions", 2.0 * quaternion[:, None], r"array quaternions: got .* of magnitude up to 1$"),
        ("quaternions", quaternion, r"array quaternions: got the shape \(121, 4\)"),
    ):
        np.savez(folder / "bad.npz", **{**arrays, name: array})
        with pytest.raises(InputError, match=message):
            eomgen.load_result(folder / "bad.npz")
    page = report_of(fall, modes=False)
    (row,) = next(table for table in page.tables if table.title.startswith("Rotations")).rows
    assert row == ("free", *(", ".join(f"{x:.6f}" for x in quaternion[i]) for i in (0, -1)))


def test_quaternions_of_a_stream(fall: SimulationResult, folder: Path) -> None:
    pytest.importorskip("zarr")
    found = eomgen.load_stream(folder / STREAM)
    for name in QUATERNION:
        ours = found.series(name)
        assert (ours.unit, ours.values.tolist()) == ("", fall.series(name).values.tolist())
    with pytest.raises(InputError, match=r"'free\.q' is unknown; known: .* or without, free\.qw, .*free\.qz"):
        found.series("free.q")


@pytest.mark.parametrize("rates", [True, False])
def test_forces_of_a_motion_over_the_poles(rates: bool, fall: SimulationResult, folder: Path) -> None:
    """Nothing but its weight acts on the body, whether rates were measured or not."""
    motion = fall.trajectory
    columns = {"t": motion.t, **dict(zip(NAMES, motion.q.T, strict=True))}
    columns[NAMES[3]] = (columns[NAMES[3]] + np.pi) % (2.0 * np.pi) - np.pi  # as many tell it
    if rates:
        columns |= {f"{name}.rate": x for name, x in zip(NAMES, motion.v.T, strict=True)}
    found = forces(free_body(), motion_from_columns(columns, tuple(NAMES)))
    inner = slice(6, -6)
    assert np.abs(found.drive[inner]).max() < (1e-4 if rates else 1e-3)
    assert np.abs(found.v - motion.v)[inner, :3].max() < 1e-4
    assert np.abs(np.cos(found.q) - np.cos(motion.q))[:, 3:].max() < 1e-4
    names = [column.name for column in found.as_rows().columns]
    assert names[-4:] == list(QUATERNION)
    assert "which have no poles" in found.notes[1]


def test_robots_without_such_joints_have_none(tmp_path: Path) -> None:
    result = simulate("one_link", duration=0.05)
    assert (result.trajectory.rotating, result.trajectory.quaternions) == ((), None)
    assert not [name for name in result.names if ".q" in name]
    with np.load(result.save(tmp_path / "r.npz")) as data:
        assert "quaternions" not in data.files
    plan = plan_from_toml(
        'record = ["quaternion_end"]\n[[vary]]\nparameter = "links.link1.mass"\ngrid = { values = [1.0] }\n'
    )
    with pytest.raises(DescriptionError, match=r"quaternion_end: no joint has alpha, beta and gamma; allowed: with a"):
        run("one_link", {"duration": 0.1}, plan, tmp_path / "sweep")


def test_sweeps_over_the_poles(tmp_path: Path) -> None:
    """Moments of inertia that vary: each sample ends where the body of that inertia does."""
    values = (0.095, 0.1, 0.11)
    plan = plan_from_toml(
        'record = ["quaternion_end", "coordinate_end"]\n[engine]\ntype = "rollout"\n'
        f'[[vary]]\nparameter = "links.body.inertia.xx"\ngrid = {{ values = {list(values)} }}\n'
    )
    found = run(free_body(), FALL, plan, tmp_path / "sweep", threads=1)
    assert not found.errors
    ends = np.stack([found.of(f"quaternion_end.{name}") for name in QUATERNION], axis=-1)
    assert np.abs(np.diff(ends, axis=0)).max() < 0.2  # of one sign
    (link,) = free_body().links
    for value, end in zip(values, ends, strict=True):
        other = replace(free_body(), links=(replace(link, inertia=(value, *link.inertia[1:])),))
        turned, _ = falling_body(other, Q0, V0, np.array([0.0, FALL["duration"]]))
        assert apart(rotations(end), turned[-1]) < 1e-7


def swinging(turn: Array) -> Robot:
    """A driven arm from which a body hangs in a ball joint, whose axes are turned, (3, 3)."""
    com, tensor = np.array([0.3, 0.0, 0.0]), np.diag([0.01, 0.02, 0.025])
    inertia = turn.T @ tensor @ turn
    entries = tuple(inertia[i] for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    at = Placement((0.4, 0.0, 0.0), tuple(map(tuple, turn.tolist())))  # type: ignore[arg-type]
    hinge = Joint("hinge", "base", "arm", "revolute", coordinates={"gamma": Coordinate()})
    ball = Joint("ball", "arm", "bob", "fixed", at, coordinates=dict.fromkeys(ANGULAR, Coordinate()))
    arm = Link("arm", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02, 0.0, 0.0, 0.0))
    bob = Link("bob", 0.5, tuple((turn.T @ com).tolist()), entries)  # type: ignore[arg-type]
    tip = Frame("tcp", "bob", Placement(tuple((turn.T @ com).tolist())))  # type: ignore[arg-type]
    return Robot("swinging", (0.0, 0.0, -9.81), (arm, bob), (hinge, ball), frames=(tip,))


@pytest.mark.soak
def test_a_programmed_motion_with_a_ball_over_the_pole() -> None:
    """Nothing holds the ball: the same motion as in axes whose angles stay far from their poles."""
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    plain, other = (simulate(swinging(x), goal=[0.1], duration=1.0, rtol=1e-9) for x in (np.eye(3), turn))
    betas = [np.abs(np.cos(found.trajectory.of("ball.beta"))).min() for found in (plain, other)]
    assert betas[0] < 0.1
    assert betas[1] > 0.5
    np.testing.assert_allclose(plain.pose[:, :3, 3], other.pose[:, :3, 3], atol=1e-6)
    np.testing.assert_allclose(plain.pose[:, :3, :3], other.pose[:, :3, :3] @ turn.T, atol=1e-5)
    np.testing.assert_allclose(plain.trajectory.u[:, 0], other.trajectory.u[:, 0], atol=1e-4)
    assert np.abs(np.diff(plain.trajectory.quaternion("ball"), axis=0)).max() < 0.1
    assert plain.balance is not None
    assert abs(plain.balance.relative_residue) < 1e-5
