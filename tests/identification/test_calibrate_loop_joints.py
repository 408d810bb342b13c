"""Stiffness of loop joints from poses under loads: those of static equilibria of kernels, and what is written of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis import deflection
from eomgen.analysis.options import KERNELS
from eomgen.errors import InputError
from eomgen.identification import CalibrationResult, calibrate, load_calibration, poses_from_columns
from eomgen.identification.geometry.rotations import coordinates_of, vector_of, vectors_of
from eomgen.identification.geometry.stations import matrix_of
from eomgen.motion.turns import rotation_of
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.robot import Coordinate, JointStiffness, Robot
from eomgen.robot.elements.matrices import PAIRS
from eomgen.robot.value import COORDINATES
from tests.loops.test_elastic_cuts import linkages
from tests.support.builds import Build
from tests.support.random_robots import Array

pytestmark = pytest.mark.usefixtures("unoptimised")

TEXT = """name = "arm"
gravity = [0.0, 0.0, -9.81]
driven = ["joint1.gamma", "joint2.gamma"]
[[links]]
name = "upper"
mass = 6.0
com = [0.25, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.1, zz = 0.1 }
[[links]]
name = "fore"
mass = 3.0
com = [0.2, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.06, zz = 0.06 }
[[links]]
name = "tool"
mass = 4.0
com = [0.05, 0.02, 0.01]
inertia = { xx = 0.01, yy = 0.02, zz = 0.02 }
[[joints]]
name = "joint1"
parent = "base"
child = "upper"
type = "revolute"
[[joints]]
name = "joint2"
parent = "upper"
child = "fore"
type = "revolute"
placement = { xyz = [0.5, 0.0, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }
[[joints]]
name = "carrier"
parent = "base"
child = "tool"
type = "fixed"
placement = { xyz = [0.9, -0.1, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }
x = {}
y = {}
z = {}
alpha = {}
beta = {}
gamma = {}
[[loops]]
name = "flange"
links = ["fore", "tool"]
type = "fixed"
placements = [{ xyz = [0.4, 0.0, 0.1] }, {}]
x = { stiffness = 2e7, damping = 10.0 }
y = { stiffness = 3e7 }
z = { stiffness = 1e7 }
alpha = { stiffness = 8e4 }
beta = { damping = 1.0, stiffness = 9e4 }
gamma = { stiffness = 7e4 }
[[frames]]
name = "tcp"
link = "tool"
placement = { xyz = [0.1, 0.05, 0.02] }
"""
LOADS = tuple(f"tcp.{part}" for part in ("fx", "fy", "fz", "mx", "my", "mz"))
PLACES = tuple(f"tcp.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
TABLES = np.array([2e7, 3e7, 1e7, 8e4, 9e4, 7e4])
SIZES = (np.array([1.1, 0.8, 1.3, 0.9, 1.2, 0.7]) * TABLES) ** 0.5
FIXED = ("joints", "loops.flange.offset", "loops.flange.second")
WHOLE = ("loops.flange.stiffness",)
NAMES = {pair: f"loops.flange.stiffness.{pair[0]}.{pair[1]}" for pair in PAIRS}


def definite(seed: int) -> Array:
    """A random stiffness of the flange."""
    rows = np.random.default_rng(seed).normal(size=(14, 6))
    coupled = rows.T @ rows
    coupled /= np.sqrt(np.outer(np.diag(coupled), np.diag(coupled)))
    return np.asarray(coupled * np.outer(SIZES, SIZES))


K = definite(1)


def described(folder: Path, line: str = "") -> Robot:
    path = folder / "arm.toml"
    path.write_text(TEXT.replace('name = "flange"\n', f'name = "flange"\n{line}\n'), encoding="ascii")
    return eomgen.load_robot(path)


def with_matrix(robot: Robot, matrix: Array) -> Robot:
    """The robot with this stiffness of its flange, and none in tables."""
    (loop,) = robot.loops
    bare = {name: Coordinate() for name in COORDINATES}
    return replace(robot, loops=(replace(loop, coordinates=bare, stiffness=JointStiffness.of(matrix.tolist())),))


def loaded(robot: Robot, built: Build, rows: int = 20) -> dict[str, Array]:
    """Columns of poses of the tool under loads, by static equilibria of the robot's kernel."""
    rng, kernel = np.random.default_rng(0), built(robot, *KERNELS, "frame_pose")
    q, loads = rng.uniform(-0.7, 0.7, (rows, 2)), rng.uniform(-1.0, 1.0, (rows, 6)) * np.repeat([150.0, 40.0], 3)
    place = matrix_of(robot.joint("carrier").placement)
    poses = []
    for (a, b), load in zip(q.tolist(), loads, strict=True):
        held = np.array([a, b, *(6 * [0.0])])
        flange = np.asarray(kernel.frame_pose(held, "fore")) @ matrix_of(robot.loops[0].placements[0])
        carried = dict(zip(COORDINATES, coordinates_of(np.linalg.inv(place) @ flange).tolist(), strict=True))
        start = {"joint1": a, "joint2": b} | {f"carrier.{name}": value for name, value in carried.items()}
        poses.append(deflection(robot, start, frame="tcp", loads={"tcp": load}, kernel=kernel).pose)
    columns = {"joint1.gamma": q[:, 0], "joint2.gamma": q[:, 1]}
    columns |= {f"tcp.{axis}": np.array([pose[k, 3] for pose in poses]) for k, axis in enumerate("xyz")}
    turns = np.array([vector_of(pose[:3, :3]) for pose in poses])
    columns |= {f"tcp.r{axis}": turns[:, k] for k, axis in enumerate("xyz")}
    return columns | {name: loads[:, k] for k, name in enumerate(LOADS)}


def calibrated(robot: Robot, columns: dict[str, Array], **options: object) -> CalibrationResult:
    poses = poses_from_columns(columns, ["joint1.gamma", "joint2.gamma"], ["tcp"])
    return calibrate(robot, poses, folds=0, **options)


def off_by(found: CalibrationResult, expected: Array) -> float:
    """Largest error of the entries that were found, scaled by the diagonal."""
    size = np.sqrt(np.diag(expected))
    off = [
        (found[name] - expected[i, j]) / (size[i] * size[j])
        for (one, other), name in NAMES.items()
        for i, j in [(COORDINATES.index(one), COORDINATES.index(other))]
        if name in found.names
    ]
    return float(np.abs(off).max())


@pytest.mark.soak
def test_a_random_matrix_is_recovered(built: Build, tmp_path: Path) -> None:
    """All 21 entries to 1e-6 with known offsets, begun with the tables; and again where it is described."""
    robot = described(tmp_path)
    columns = loaded(with_matrix(robot, K), built)
    found = calibrated(robot, columns, stiffness=WHOLE, fixed=FIXED)
    assert set(NAMES.values()) <= set(found.names)
    assert off_by(found, K) < 1e-6
    units = dict(zip(found.names, found.units, strict=True))
    assert units[NAMES["x", "beta"]] == "N/rad"
    (loop,) = found.calibrated.loops
    assert loop.stiffness is not None
    assert all(coordinate.stiffness is None for coordinate in loop.coordinates.values())
    assert loop.coordinates["beta"].damping == 1.0
    again = load_calibration(found.save(tmp_path / "c.npz"))
    assert again.calibrated == found.calibrated
    q = np.array([[0.3, -0.4]])
    np.testing.assert_array_equal(again.predict(q, "tcp")[0], found.predict(q, "tcp")[0])
    written = eomgen.load_robot(found.to_toml(tmp_path / "calibrated.toml"))
    assert written.loops[0].stiffness == loop.stiffness
    assert written.loops[0].coordinates["x"] == Coordinate(damping=10.0)
    twice = calibrated(with_matrix(robot, 1.05 * K), columns, fixed=FIXED)  # without being asked
    assert off_by(twice, K) < 1e-6
    assert dict(zip(twice.names, twice.described, strict=True))[NAMES["x", "beta"]] == pytest.approx(1.05 * K[0, 4])


def test_tables_of_a_loop_joint_are_found(built: Build, tmp_path: Path) -> None:
    """Single coordinates are fitted in any case, as those of joints."""
    robot, six = described(tmp_path), np.diag(SIZES**2)
    found = calibrated(robot, loaded(with_matrix(robot, six), built), fixed=FIXED)
    for c, name in enumerate(COORDINATES):
        assert found[f"loops.flange.{name}.stiffness"] == pytest.approx(six[c, c], rel=1e-6)
        assert found.calibrated.loops[0].coordinates[name].stiffness == found[f"loops.flange.{name}.stiffness"]
    written = found.to_toml(tmp_path / "calibrated.toml")
    assert eomgen.load_robot(written).loops[0].coordinates == found.calibrated.loops[0].coordinates


def test_chosen_entries_stand_beside_what_is_described(built: Build, tmp_path: Path) -> None:
    wrong = K.copy()
    wrong[[0, 4], [4, 0]] *= 0.9
    wrong[1, 1] *= 1.2
    robot = described(tmp_path)
    columns = loaded(with_matrix(robot, K), built)
    chosen = ["loops.flange.stiffness.beta.x", "loops.flange.stiffness.y.y"]
    found = calibrated(with_matrix(robot, wrong), columns, stiffness=chosen, fixed=FIXED)
    assert [name for name in found.names if "stiffness" in name] == [NAMES["x", "beta"], NAMES["y", "y"]]
    assert off_by(found, K) < 1e-6
    assert found.calibrated.loops[0].stiffness is not None
    assert load_calibration(found.save(tmp_path / "c.npz")).calibrated == found.calibrated


@pytest.mark.parametrize("runs", [2, pytest.param(5, marks=pytest.mark.soak)])
def test_intervals_cover_with_noise(runs: int, built: Build, tmp_path: Path) -> None:
    """Where the device stands and where the tool is measured is found, too."""
    robot, inside = described(tmp_path), []
    exact = loaded(with_matrix(robot, K), built)
    for seed in range(10, 10 + runs):
        rng = np.random.default_rng(seed)
        off = {name: rng.normal(scale=4e-7 if "r" in name else 2e-7, size=exact[name].size) for name in PLACES}
        columns = exact | {name: exact[name] + off[name] for name in PLACES[:3]}
        turns, small = (np.stack([x[name] for name in PLACES[3:]], axis=1) for x in (exact, off))
        columns |= dict(zip(PLACES[3:], vectors_of(rotation_of(small) @ rotation_of(turns)).T, strict=True))
        found = calibrated(robot, columns, stiffness=WHOLE, fixed=FIXED)
        deviations = dict(zip(found.names, found.deviations, strict=True))
        for (one, other), name in NAMES.items():
            value = K[COORDINATES.index(one), COORDINATES.index(other)]
            inside.append(abs(found[name] - value) <= found.quantile * deviations[name])
    assert len(inside) == 21 * runs
    assert np.mean(inside) >= 0.9


def test_a_linkage_whose_pin_gives_way(built: Build) -> None:
    """x and y of a pin that closes four bars: what its other coordinates hold is said by name."""
    matrix, names = np.array([[3e5, 8e4], [8e4, 5e5]]), ("x", "y")
    home = {"motor.gamma": 1.0, "pin.gamma": -0.5, "pivot.gamma": 1.44}
    there = replace(linkages("x = {}\ny = {}\ngamma = {}\n")[0], home=home)

    def with_pin(scale: float) -> Robot:
        (loop,) = there.loops
        return replace(there, loops=(replace(loop, stiffness=JointStiffness.of((scale * matrix).tolist(), names)),))

    true, rng = with_pin(1.0), np.random.default_rng(4)
    kernel = built(true, *KERNELS, *mechanism_kernels(true), "cut_forces", "cut_jacobian")
    angles, loads = np.linspace(0.6, 1.4, 30), rng.uniform(-50.0, 50.0, (30, 2))
    load = np.pad(loads, ((0, 0), (0, 4)))
    stiff = replace(there, loops=(replace(there.loops[0], coordinates={}),))
    rigid = built(stiff, *mechanism_kernels(stiff))
    poses, q = [], np.array([1.0, -0.5, 1.44])
    for angle, wrench in zip(angles.tolist(), load, strict=True):
        q = rigid.assemble(np.array([angle, *q[1:]]), ["motor.gamma"])
        start = dict(zip(kernel.coordinates, q.tolist(), strict=True))
        poses.append(deflection(true, start, frame="coupler", loads={"coupler": wrench}, kernel=kernel).pose)
    columns = {"motor.gamma": angles, "coupler.fx": loads[:, 0], "coupler.fy": loads[:, 1]}
    columns |= {f"coupler.{axis}": np.array([pose[k, 3] for pose in poses]) for k, axis in enumerate("xyz")}
    columns |= {f"coupler.r{axis}": np.array([vector_of(x[:3, :3])[k] for x in poses]) for k, axis in enumerate("xyz")}
    given = poses_from_columns(columns, kernel.coordinates, ["coupler"])
    fixed = ("joints", "loops.cut.offset", "loops.cut.second")
    found = calibrate(with_pin(0.7), given, folds=0, fixed=fixed)
    for (i, j), pair in (((0, 0), "x.x"), ((0, 1), "x.y"), ((1, 1), "y.y")):
        assert found[f"loops.cut.stiffness.{pair}"] == pytest.approx(matrix[i, j], rel=1e-5)
    with pytest.raises(InputError, match=r"stiffness: cut\.z is held by the loops, too; allowed: drives of linkage"):
        calibrate(with_pin(0.7), given, folds=0, stiffness=["cut.z"])
